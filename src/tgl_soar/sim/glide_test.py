"""A gliding test flight in still air: steady glides for the polar, doublets for identification.

High up and far from everything, in a wind that is the same everywhere: the aircraft glides
upwind at about the wind's speed, so that it falls but hardly moves over the ground.  A pilot
flies it by hand, as one would: pitch held steady for the glides, the elevator let stand, thrown
to one side and the other for the doublets.  The module is on board, watches and logs.

Speeds are those of an aircraft whose best glide is at `BEST_MPS` and its slowest at `SLOW_MPS`;
another one's lie between its own, and its pilot moves surfaces that do more by less.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, sqrt
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.autopilot import (
    AutopilotState,
    Output,
    initial_state,
    step,
)
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Start
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame, euler_from_quaternion
from tgl_soar.sim.aircraft import (
    AircraftModel,
    Glide,
    aircraft_model,
    braked,
    glide_at,
    highest_pitch_glide,
)
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors, SurfacesParams
from tgl_soar.sim.servos import servo_params
from tgl_soar.sim.world import Truth, World
from tgl_soar.types import AutopilotStatus, Inputs, SurfaceCommand

STEP_S: Final = 1.0 / 200.0
HEIGHT_M: Final = 500.0
WIND_MPS: Final = 9.2
SPEEDS_MPS: Final = (9.0, 8.6, 8.2, 7.9, 7.6, 8.4, 9.3, 10.0, 10.7, 11.4)  # of the steady glides
BEST_MPS: Final = 9.2
SLOW_MPS: Final = 7.4
PACE_STEP: Final = 0.05  # no pilot knows it better
# Pitch and roll acceleration of full deflections at these speeds, that the pilot's hand is for.
HAND_RADPS2: Final = 31.0, 67.0
HAND_MPS: Final = 8.5
GLIDE_S: Final = 8.0  # at each of them, the way there included
DOUBLETS: Final = 8
DOUBLET_EVERY_S: Final = 4.0
DOUBLET_SPEED_MPS: Final = 9.4
HALF_S: Final = 0.25  # of a doublet, to one side
THROW: Final = 0.2
REST_S: Final = 0.4  # before it
AFTER_S: Final = 1.3
PULSES: Final = 4  # of the brake, after the doublets, to the last of its positions and back
PULSE_S: Final = 0.6
READ_BACK: Final = SurfacesParams(200.0, 0.005)


class GlideTick(NamedTuple):
    """One tick of the module on board, and the truth."""

    inputs: Inputs
    output: Output
    state: AutopilotState
    truth: Truth


class EvenAir:
    """The same wind everywhere and for ever."""

    def __init__(self, wind_mps: float) -> None:
        self.reference_wind_mps = wind_mps

    def wind_at(
        self,
        x_m: float,  # noqa: ARG002
        y_m: float,  # noqa: ARG002
        z_m: float,  # noqa: ARG002
        time_s: float,  # noqa: ARG002
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s]."""
        return self.reference_wind_mps, 0.0, 0.0

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s] at many places."""
        x, _, _ = broadcast(x_m, y_m, z_m)
        return np.full_like(x, self.reference_wind_mps), np.zeros_like(x), np.zeros_like(x)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """Above the ground."""
        return z_m > 0.0


def fly(
    airframe: Airframe,
    *,
    seed: int = 1,
    turbulence: float = 0.0,
    servo_delay_s: float | None = None,
    speeds_mps: tuple[float, ...] = SPEEDS_MPS,
    doublets: int = DOUBLETS,
    pitot: bool = False,
    imu: bool = True,
    sensors: Sensors | None = None,
    brakes: tuple[float, ...] = (0.0,),
    pulses: int = PULSES,
) -> Iterator[GlideTick]:
    """The flight, tick by tick.  `servo_delay_s`: where it is not that of the airframe file;
    sensors: in place of those of pitot and imu;
    brakes: at each of them every speed is glided; the doublets are flown with the first, and then,
    if they are several, the brake is moved to the last and back, `pulses` times; speeds_mps: of an
    aircraft of the usual pace."""
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    pace = pace_of(model)
    wind_mps = pace * WIND_MPS
    servo = servo_params(airframe.model)
    if servo_delay_s is not None:
        servo = servo._replace(delay_s=servo_delay_s)
    world = World(
        model,
        servo,
        EvenAir(wind_mps),
        SoaringFrame(0.0, 0.0, 0.0, 0.0),
        Start(0.0, HEIGHT_M),
        seed=seed,
        turbulence=turbulence,
        length_scale_m=20.0,
        sensors=sensors or sensors_of(pitot=pitot, imu=imu),
    )
    speeds = _speeds(model, pace, speeds_mps)
    plan = [(brake, _glide(model, speed, brake)) for brake in brakes for speed in speeds]
    throwing = brakes[0], _glide(model, pace * DOUBLET_SPEED_MPS, brakes[0])
    laws = laws_from(ParameterSet(), world.frame)
    state = initial_state()
    pilot = _Pilot(wind_mps, *_hand(model, pace))
    gliding_s = len(plan) * GLIDE_S
    throws = doublets + (pulses if len(brakes) > 1 else 0)
    end_s = gliding_s + (DOUBLET_EVERY_S * (throws + 1) if throws else 0.0)
    while world.time_s < end_s and not world.crashed:
        now = world.time_s
        if now < gliding_s:
            (brake, glide), since_s = plan[int(now / GLIDE_S)], inf
        else:
            (brake, glide), since_s = throwing, (now - gliding_s) % DOUBLET_EVERY_S
            if now - gliding_s < DOUBLET_EVERY_S:  # on the way to this speed
                since_s = inf
        moves_brake = since_s < inf and now - gliding_s >= DOUBLET_EVERY_S * (doublets + 1)
        if moves_brake and REST_S <= since_s < REST_S + PULSE_S:
            brake = brakes[-1]
        inputs = Inputs(
            time_s=now,
            position=world.position,
            attitude=world.attitude,
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=False,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
        )
        truth = world.truth
        state, output = step(laws, state, inputs)
        yield GlideTick(inputs, output, state, truth)
        world.step(
            pilot.command(inputs, glide, since_s, throws=not moves_brake)._replace(brake=brake)
        )


def pace_of(model: AircraftModel) -> float:
    """How fast this aircraft glides, of one whose best glide is at `BEST_MPS`."""
    lift = sqrt(model.CD0 / model.CD_lift)
    weight = model.mass_kg * model.gravity_mps2
    best = sqrt(2.0 * weight / (model.air_density_kgpm3 * model.wing_area_m2 * lift))
    return round(best / BEST_MPS / PACE_STEP) * PACE_STEP


def _speeds(model: AircraftModel, pace: float, usual: tuple[float, ...]) -> list[float]:
    """The speeds of this aircraft: below its best glide's nearer to that, or further, as its
    slowest is."""
    best = pace * BEST_MPS
    slow = (best - highest_pitch_glide(model).horizontal_mps) / (BEST_MPS - SLOW_MPS)
    slow = round(slow, 1)
    if (pace, slow) == (1.0, 1.0):
        return list(usual)
    return [best + (pace if speed > BEST_MPS else slow) * (speed - BEST_MPS) for speed in usual]


def wind_of(airframe: Airframe) -> float:
    """The wind [m/s], from north, that this aircraft glides against."""
    return pace_of(aircraft_model(asdict(airframe.airframe), airframe.model)) * WIND_MPS


def _hand(model: AircraftModel, pace: float) -> tuple[float, float]:
    """By how much the elevator, and the ailerons, are moved, of what is usual."""
    pressure = 0.5 * model.air_density_kgpm3 * (pace * HAND_MPS) ** 2 * model.wing_area_m2
    pitch = pressure * model.chord_m * model.Cm_elevator / model.iyy_kgm2
    roll = pressure * model.span_m * model.Cl_aileron / model.ixx_kgm2
    return round(HAND_RADPS2[0] / pitch, 1), round(HAND_RADPS2[1] / roll, 1)


def _glide(model: AircraftModel, speed_mps: float, brake: float) -> Glide:
    """At a speed, or at the slowest that the aircraft can be held at with this brake."""
    own = braked(model, brake)
    return glide_at(own, max(1.02 * highest_pitch_glide(own).horizontal_mps, speed_mps))


def sensors_of(*, pitot: bool = False, imu: bool = True) -> Sensors:
    """What the aircraft carries."""
    return Sensors(
        imu=MEMS_IMU if imu else None, airspeed=PITOT if pitot else None, surfaces=READ_BACK
    )


class _Pilot:
    """Holds pitch and wings with an eye on the speed; lets the elevator stand, and throws it."""

    def __init__(self, wind_mps: float, elevator: float, ailerons: float) -> None:
        self._wind_mps, self._elevator, self._ailerons = wind_mps, elevator, ailerons
        self._standing = 0.0
        self._integral = 0.0
        self._pitch_trim_rad = 0.0

    def command(
        self, inputs: Inputs, glide: Glide, since_s: float, *, throws: bool
    ) -> SurfaceCommand:
        """`since_s`: since the elevator began to stand for a doublet, or, unless it throws, for a
        move of the brake; infinite: there is none."""
        if inputs.attitude.sequence == 0 or inputs.position.sequence == 0:
            return SurfaceCommand(glide.elevator, 0.0, 0.0)
        roll, pitch, heading = euler_from_quaternion(*inputs.attitude.quaternion)
        p, q, r = inputs.attitude.rates_frd_radps
        aileron = self._ailerons * (-1.2 * roll - 0.06 * p)
        sides = SurfaceCommand(0.0, aileron, -0.6 * heading - 0.2 * r)
        if since_s < REST_S + 2.0 * HALF_S + AFTER_S:
            throw = 0.0
            if throws and REST_S <= since_s < REST_S + HALF_S:
                throw = THROW
            elif throws and REST_S + HALF_S <= since_s < REST_S + 2.0 * HALF_S:
                throw = -THROW
            return sides._replace(elevator=self._standing + self._elevator * throw)
        # Facing north into a wind from there: the wind, and how fast it is gone against.
        speed_mps = self._wind_mps + inputs.position.velocity_north_mps
        too_fast_mps = min(max(speed_mps - glide.horizontal_mps, -1.0), 1.0)
        self._pitch_trim_rad += 0.008 * too_fast_mps * STEP_S
        error = glide.pitch_rad + self._pitch_trim_rad - pitch
        self._integral += error * STEP_S
        hold = 1.5 * error + self._integral - 0.15 * q
        self._standing = glide.elevator + self._elevator * hold
        return sides._replace(elevator=self._standing)

"""A gliding test flight in still air: steady glides for the polar, doublets for identification.

High up and far from everything, in a wind that is the same everywhere: the aircraft glides
upwind at about the wind's speed, so that it falls but hardly moves over the ground.  A pilot
flies it by hand, as one would: pitch held steady for the glides, the elevator let stand, thrown
to one side and the other for the doublets.  The module is on board, watches and logs.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
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
    brakes: tuple[float, ...] = (0.0,),
    pulses: int = PULSES,
) -> Iterator[GlideTick]:
    """The flight, tick by tick.  `servo_delay_s`: where it is not that of the airframe file;
    brakes: at each of them every speed is glided; the doublets are flown with the first, and then,
    if they are several, the brake is moved to the last and back, `pulses` times."""
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    servo = servo_params(airframe.model)
    if servo_delay_s is not None:
        servo = servo._replace(delay_s=servo_delay_s)
    world = World(
        model,
        servo,
        EvenAir(WIND_MPS),
        SoaringFrame(0.0, 0.0, 0.0, 0.0),
        Start(0.0, HEIGHT_M),
        seed=seed,
        turbulence=turbulence,
        length_scale_m=20.0,
        sensors=Sensors(
            imu=MEMS_IMU if imu else None, airspeed=PITOT if pitot else None, surfaces=READ_BACK
        ),
    )
    plan = [(brake, _glide(model, speed, brake)) for brake in brakes for speed in speeds_mps]
    throwing = brakes[0], glide_at(braked(model, brakes[0]), DOUBLET_SPEED_MPS)
    laws = laws_from(ParameterSet(), world.frame)
    state = initial_state()
    pilot = _Pilot()
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


def _glide(model: AircraftModel, speed_mps: float, brake: float) -> Glide:
    """At a speed, or at the slowest that the aircraft can be held at with this brake."""
    own = braked(model, brake)
    return glide_at(own, max(1.02 * highest_pitch_glide(own).horizontal_mps, speed_mps))


class _Pilot:
    """Holds pitch and wings with an eye on the speed; lets the elevator stand, and throws it."""

    def __init__(self) -> None:
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
        roll, pitch, heading = euler_from_quaternion(*inputs.attitude[2:6])
        p, q, r = inputs.attitude[6:9]
        sides = SurfaceCommand(0.0, -1.2 * roll - 0.06 * p, -0.6 * heading - 0.2 * r)
        if since_s < REST_S + 2.0 * HALF_S + AFTER_S:
            throw = 0.0
            if throws and REST_S <= since_s < REST_S + HALF_S:
                throw = THROW
            elif throws and REST_S + HALF_S <= since_s < REST_S + 2.0 * HALF_S:
                throw = -THROW
            return sides._replace(elevator=self._standing + throw)
        # Facing north into a wind from there: the wind, and how fast it is gone against.
        speed_mps = WIND_MPS + inputs.position.velocity_north_mps
        too_fast_mps = min(max(speed_mps - glide.horizontal_mps, -1.0), 1.0)
        self._pitch_trim_rad += 0.008 * too_fast_mps * STEP_S
        error = glide.pitch_rad + self._pitch_trim_rad - pitch
        self._integral += error * STEP_S
        self._standing = glide.elevator + 1.5 * error + self._integral - 0.15 * q
        return sides._replace(elevator=self._standing)

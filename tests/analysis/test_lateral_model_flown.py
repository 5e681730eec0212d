"""The lateral loop against a flight of small motions, tick by tick: what is pushed into a surface's
command comes back through aircraft, sensors, estimate and laws as the linear model has it."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from msgspec.structs import asdict
from numpy.typing import NDArray

from tgl_soar.analysis.lateral_model import BREAKS, lateral_loop
from tgl_soar.analysis.linear_controller import fix_matrices
from tgl_soar.analysis.linear_plant import Condition
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.heading import heading_setpoint, heading_step, leading_speed, sideways_step
from tgl_soar.control.lateral_schedule import (
    heading_gains,
    lateral_bandwidth,
    roll_gains,
    sideways_gains,
)
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.pid import PidState
from tgl_soar.control.pitch_schedule import speed_within
from tgl_soar.geometry import euler_from_quaternion, euler_rates
from tgl_soar.sim.aircraft import AircraftState, aircraft_model, glide_at, gliding_state, step
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params, servo_start, servo_step
from tgl_soar.types import SurfaceCommand

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
TICKS = 90
SMALL = 1e-6
AT_REST = PidState(0.0, 0.0)

Floats = NDArray[np.float64]


def condition(
    imu: bool, attitude_s: float, fix_s: float, step_hz: int = 200, command_s: float = 0.0
) -> Condition:
    """Fixes at 50 Hz; with accelerometers the autopilot's attitudes are later, and unused."""
    sensors: Sensors = USUAL_SENSORS._replace(
        position=USUAL_SENSORS.position._replace(rate_hz=50.0, delay_s=fix_s),
        attitude=USUAL_SENSORS.attitude._replace(
            rate_hz=100.0, delay_s=attitude_s + (0.02 if imu else 0.0)
        ),
        imu=MEMS_IMU._replace(rate_hz=100.0, delay_s=attitude_s) if imu else None,
    )
    return Condition(
        model=aircraft_model(asdict(AIRFRAME.airframe), AIRFRAME.model),
        servo=servo_params(AIRFRAME.model),
        speed_mps=9.0,
        lean_rad=0.26,
        sensors=sensors,
        command_delay_s=command_s,
        step_hz=step_hz,
    )


def laws(use_imu: bool = True) -> Laws:
    return laws_from(VALUES.changed({"EST_IMU": float(use_imu)}), SITE.frame())


def pushed() -> Floats:
    return np.random.default_rng(9).standard_normal((TICKS, 2))


def truth_of(state: AircraftState) -> Floats:
    """y, its rate, roll, heading and their rates."""
    roll, pitch, heading = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
    rates = euler_rates(
        roll,
        pitch,
        state.roll_rate_frd_radps,
        state.pitch_rate_frd_radps,
        state.yaw_rate_frd_radps,
    )
    return np.array([state.y_m, state.velocity_y_mps, roll, heading, rates[0], rates[2]])


def flown(known: Laws, there: Condition, inertial: bool, late: int, fix_late: int) -> Floats:
    """The commands of aileron and rudder before what is pushed in, for a size of 1."""
    dt = 1.0 / there.step_hz
    every = there.step_hz // 50
    trim = glide_at(there.model, there.speed_mps)
    wind = (trim.horizontal_mps, 0.0, trim.sink_mps)
    servo = there.servo._replace(delay_s=there.servo.delay_s + there.command_delay_s)
    surfaces = [servo_start(servo, dt), servo_start(servo, dt)]
    take, _ = fix_matrices(known.motion, every * dt, dt, there.sensors, inertial)
    age = late * dt
    faster = lateral_bandwidth(known.lateral_schedule, age)
    side = sideways_gains(known.sideways, known.lateral_schedule, faster)
    lead = leading_speed(
        known.heading, side.kd, known.target.x_m, speed_within(known.schedule, trim.airspeed_mps)
    )
    to_roll = roll_gains(known.roll, known.lateral_schedule, faster, trim.airspeed_mps)
    to_turn = heading_gains(known.heading, known.lateral_schedule, faster, trim.airspeed_mps)
    bank, roll, turn = AT_REST, AT_REST, AT_REST
    samples = deque([np.zeros(6)] * (late + 1), maxlen=late + 1)
    fixes = deque([np.zeros(2)] * (fix_late + 1), maxlen=fix_late + 1)
    estimate, fixed_at = np.zeros(2), 0
    state, found = gliding_state(trim, wind), []
    for k, push in enumerate(pushed()):
        samples.append(truth_of(state))
        fixes.append(samples[-1][:2])
        sample = samples[0]
        y, vy = sample[0] + age * sample[1], sample[1]
        if not inertial:
            if (k - fix_late) % every == 0:
                ahead = np.array([estimate[0] + every * dt * estimate[1], estimate[1]])
                estimate = ahead + take @ (fixes[0] - ahead)
                fixed_at = k - fix_late
            y, vy = estimate[0] + (k - fixed_at) * dt * estimate[1], estimate[1]
        wanted = heading_setpoint(known.heading, known.target.x_m, float(y))
        bank, level = sideways_step(side, bank, wanted, lead, float(vy), dt, 0)
        now = float(sample[2] + age * sample[4]), float(sample[3] + age * sample[5])
        roll, aileron = attitude_step(
            to_roll, roll, level.output, now[0], float(sample[4]), 0.0, dt, 0
        )
        turn, rudder = heading_step(to_turn, turn, wanted, now[1], float(sample[5]), 0.0, dt)
        asked = np.array([aileron.output, rudder.output])
        found.append(asked)
        surfaces = [
            servo_step(servo, surface, float(command), dt)
            for surface, command in zip(surfaces, asked + SMALL * push, strict=True)
        ]
        moved = SurfaceCommand(trim.elevator, surfaces[0].deflection, surfaces[1].deflection)
        state = step(there.model, state, moved, wind, wind, dt)
    return np.array(found) / SMALL


def predicted(known: Laws, there: Condition) -> tuple[Floats, int]:
    loop = lateral_loop(known, there)
    assert loop.breaks == BREAKS == ("aileron", "rudder")
    assert loop.step_s == 1.0 / there.step_hz
    a, b, c, d = loop.system
    x, found = np.zeros(len(a[0])), []
    for k, u in enumerate(pushed()):
        n = k % len(a)
        found.append(c[n] @ x + d[n] @ u)
        x = a[n] @ x + b[n] @ u
    return np.array(found), len(a)


def alike(
    there: Condition, *, inertial: bool, late: int, fix_late: int = 0, use_imu: bool = True
) -> None:
    known = laws(use_imu)
    ours, period = predicted(known, there)
    assert period == (1 if inertial else there.step_hz // 50)
    theirs = flown(known, there, inertial, late, fix_late)
    for n in (0, 1):
        scale = float(np.abs(theirs[:, n]).max())
        assert scale > 0.0
        assert ours[:, n] == pytest.approx(theirs[:, n], abs=1e-4 * scale), BREAKS[n]


@pytest.mark.parametrize(("attitude_s", "late"), [(0.0, 0), (0.02, 4)])
def test_with_accelerometers_the_loop_is_the_flown_one(attitude_s: float, late: int) -> None:
    alike(condition(True, attitude_s, 0.03), inertial=True, late=late)


@pytest.mark.parametrize(("attitude_s", "late"), [(0.0, 0), (0.01, 2)])
@pytest.mark.parametrize(("fix_s", "fix_late"), [(0.0, 0), (0.03, 6)])
def test_by_fixes_alone_likewise(attitude_s: float, late: int, fix_s: float, fix_late: int) -> None:
    alike(condition(False, attitude_s, fix_s), inertial=False, late=late, fix_late=fix_late)


def test_accelerometers_that_are_not_used_are_none() -> None:
    """Attitudes are the autopilot's then, with their delay."""
    there = condition(True, 0.0, 0.01)
    alike(there, inertial=False, late=4, fix_late=2, use_imu=False)


def test_late_commands_and_another_tick_are_those_of_the_condition() -> None:
    alike(condition(True, 0.0, 0.0, command_s=0.0125), inertial=True, late=0)
    alike(condition(True, 0.01, 0.0, step_hz=100), inertial=True, late=1)

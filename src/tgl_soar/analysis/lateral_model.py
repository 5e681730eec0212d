"""Roll and heading, linear about a hovering glide: the same margins for the lateral loops.

As `linear_model` does for pitch, by central differences of what flies (`heading_setpoint`,
`sideways_step`, `attitude_step`, `heading_step`) and of what is flown (`aircraft.step`,
`servo_step`); wings level and in the middle, neither motion moves the other to first order.

    y, v_y → heading setpoint → bank setpoint → aileron command     roll and its rate
                              → rudder command                      heading and its rate

Both surfaces act on both angles.  The loop is opened at one surface, the other one closed:

    aileron, rudder    plant input: the command

The place x, by which the waypoint's distance is known, is that of the target line.
"""

from __future__ import annotations

from functools import partial
from itertools import accumulate, pairwise
from math import cos, tan
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.analysis.linear_controller import fix_matrices, goes_by_accelerations
from tgl_soar.analysis.linear_model import Loop
from tgl_soar.analysis.linear_plant import (
    Condition,
    Matrix,
    Periodic,
    differences,
    without_idle,
)
from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.heading import (
    heading_setpoint,
    heading_step,
    leading_speed,
    sideways_step,
)
from tgl_soar.control.lateral_schedule import (
    heading_gains,
    lateral_bandwidth,
    roll_gains,
    sideways_gains,
)
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidState
from tgl_soar.control.pitch_schedule import speed_within
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.aircraft import Glide, glide_at, gliding_state, step
from tgl_soar.sim.sensors import sensor_timing
from tgl_soar.sim.servos import ServoParams, ServoState, servo_start, servo_step
from tgl_soar.types import SurfaceCommand

BREAKS: Final = ("aileron", "rudder")
_BODY: Final = 6  # y, vy, roll, heading, roll rate, yaw rate; the latter two about body axes
_TRUTH: Final = 6  # y, vy, roll, heading, and the rates of these two
_LAWS: Final = 5  # bank setpoint: integral, rate; aileron: integral, rate; rudder: rate


class _Layout(NamedTuple):
    """What all ticks of a loop share."""

    laws: Laws
    condition: Condition
    trim: Glide
    servo: ServoParams
    inertial: bool
    late: int  # ticks, of attitude or accelerations
    fix_late: int  # ticks, of a fix
    fix_period: int
    period: int
    take: Matrix  # what a fix's innovations add to the estimate
    ends: tuple[int, ...]  # of the parts of the state: see `_tick`


def lateral_loop(laws: Laws, condition: Condition) -> Loop:
    """The closed loop; inputs: into the commands, outputs: these commands, in the order of
    `BREAKS`.  Errors: ValueError where the aircraft has no such glide."""
    dt = 1.0 / condition.step_hz
    servo = condition.servo._replace(delay_s=condition.servo.delay_s + condition.command_delay_s)
    surface = 1 + len(servo_start(servo, dt).pending)  # a deflection, and what is on its way to it
    sensors = condition.sensors
    inertial = goes_by_accelerations(laws, sensors)
    source = sensors.imu if sensors.imu is not None and inertial else sensors.attitude
    late = sensor_timing("attitude", source.rate_hz, source.delay_s, condition.step_hz).delay_steps
    fixes = sensor_timing(
        "position", sensors.position.rate_hz, sensors.position.delay_s, condition.step_hz
    )
    take, _ = fix_matrices(laws.motion, fixes.period_steps * dt, dt, sensors, inertial)
    from_fixes = 0 if inertial else 2
    sizes = (
        *(_BODY + 2 * surface, _TRUTH * late),
        *(from_fixes * fixes.delay_steps, from_fixes, _LAWS),
    )
    layout = _Layout(
        laws=laws,
        condition=condition,
        trim=glide_at(condition.model, condition.speed_mps),
        servo=servo,
        inertial=inertial,
        late=late,
        fix_late=fixes.delay_steps,
        fix_period=fixes.period_steps,
        period=1 if inertial else fixes.period_steps,
        take=take,
        ends=tuple(accumulate(sizes)),
    )
    size = layout.ends[-1]
    jacobians = [
        differences(partial(_tick, layout, phase), np.zeros(size + len(BREAKS)))
        for phase in range(layout.period)
    ]
    return Loop(
        dt,
        without_idle(
            Periodic(
                [each[:size, :size] for each in jacobians],
                [each[:size, size:] for each in jacobians],
                [each[size:, :size] for each in jacobians],
                [each[size:, size:] for each in jacobians],
            )
        ),
        BREAKS,
    )


def _tick(layout: _Layout, phase: int, vector: Matrix) -> Matrix:
    """States and what is injected to next states and commands.

    States: aircraft with its servos, samples on their way, fixes on theirs, the estimate made of
    fixes, and what the laws remember.
    """
    laws, trim = layout.laws, layout.trim
    dt = 1.0 / layout.condition.step_hz
    plant, line, fixes, estimate, remembered = (
        vector[begin:end] for begin, end in pairwise((0, *layout.ends))
    )
    truth = _measured(trim, plant)
    samples = np.concatenate([truth, line])
    measured, age_s = samples[len(line) :], layout.late * dt
    y, vy = measured[0] + age_s * measured[1], measured[1]
    if not layout.inertial:
        waiting = np.concatenate([truth[:2], fixes])
        since = (phase - layout.fix_late) % layout.fix_period
        if since == 0:
            interval_s = layout.fix_period * dt
            carried = np.array([estimate[0] + interval_s * estimate[1], estimate[1]])
            estimate = carried + layout.take @ (waiting[-2:] - carried)
        fixes = waiting[: len(fixes)]
        y, vy = estimate[0] + (layout.fix_late + since) * dt * estimate[1], estimate[1]

    bank_i, bank_rate, roll_i, roll_d, heading_d = remembered.tolist()
    wanted = heading_setpoint(laws.heading, laws.target.x_m, float(y))
    airspeed = trim.airspeed_mps
    f = lateral_bandwidth(laws.lateral_schedule, age_s)
    level = sideways_gains(laws.sideways, laws.lateral_schedule, f)
    leading = leading_speed(
        laws.heading, level.kd, laws.target.x_m, speed_within(laws.schedule, airspeed)
    )
    bank, bank_terms = sideways_step(
        level,
        PidState(bank_i, bank_rate),
        wanted,
        leading,
        float(vy),
        dt,
        0,
    )
    rolled, aileron = attitude_step(
        roll_gains(laws.roll, laws.lateral_schedule, f, airspeed),
        PidState(roll_i, roll_d),
        bank_terms.output,
        float(measured[2] + age_s * measured[4]),
        float(measured[4]),
        0.0,
        dt,
        0,
    )
    turned, rudder = heading_step(
        heading_gains(laws.heading, laws.lateral_schedule, f, airspeed),
        PidState(0.0, heading_d),
        wanted,
        float(measured[3] + age_s * measured[5]),
        float(measured[5]),
        0.0,
        dt,
    )
    injected = vector[layout.ends[-1] :]
    commands = (aileron.output + float(injected[0]), rudder.output + float(injected[1]))
    return np.concatenate(
        [
            _flown(layout, plant, commands),
            samples[: len(line)],
            fixes,
            estimate,
            [bank.integral, bank.rate, rolled.integral, rolled.rate, turned.rate],
            [aileron.output, rudder.output],
        ]
    )


def _measured(trim: Glide, plant: Matrix) -> Matrix:
    """What sensors see; the rates are those of roll and heading, pitched by the glide."""
    y, vy, roll, heading, p, r = plant[:_BODY]
    pitch = trim.pitch_rad
    return np.array([y, vy, roll, heading, p + r * tan(pitch), r / cos(pitch)])


def _flown(layout: _Layout, plant: Matrix, commands: tuple[float, float]) -> Matrix:
    """Servos and aircraft a tick later."""
    trim, servo = layout.trim, layout.servo
    dt = 1.0 / layout.condition.step_hz
    surface = (len(plant) - _BODY) // 2
    moved = [
        servo_step(servo, ServoState(float(own[0]), tuple(own[1:].tolist())), float(command), dt)
        for own, command in zip(
            (plant[_BODY : _BODY + surface], plant[_BODY + surface :]), commands, strict=True
        )
    ]
    y, vy, roll, heading, p, r = (float(value) for value in plant[:_BODY])
    wind = (trim.horizontal_mps, 0.0, trim.sink_mps)
    qw, qx, qy, qz = quaternion_from_euler(roll, trim.pitch_rad, heading)
    before = gliding_state(trim, wind)._replace(
        y_m=y,
        velocity_y_mps=vy,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        roll_rate_frd_radps=p,
        yaw_rate_frd_radps=r,
        aileron=float(plant[_BODY]),
        rudder=float(plant[_BODY + surface]),
    )
    surfaces = SurfaceCommand(trim.elevator, moved[0].deflection, moved[1].deflection)
    after = step(layout.condition.model, before, surfaces, wind, wind, dt)
    roll, _, heading = euler_from_quaternion(after.qw, after.qx, after.qy, after.qz)
    return np.array(
        [
            *(after.y_m, after.velocity_y_mps, roll, heading),
            *(after.roll_rate_frd_radps, after.yaw_rate_frd_radps),
            *(value for each in moved for value in (each.deflection, *each.pending)),
        ]
    )

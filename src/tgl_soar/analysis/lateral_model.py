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
from itertools import pairwise
from math import cos, tan
from typing import Final

import numpy as np

from tgl_soar.analysis.linear_model import (
    Condition,
    Loop,
    Matrix,
    Periodic,
    differences,
    fix_matrices,
)
from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.heading import heading_setpoint, heading_step, sideways_step
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidState
from tgl_soar.control.schedule import speed_within
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.aircraft import Glide, glide_at, gliding_state, step
from tgl_soar.sim.sensors import sensor_timing
from tgl_soar.sim.servos import ServoParams, ServoState, servo_start, servo_step
from tgl_soar.types import SurfaceCommand

BREAKS: Final = ("aileron", "rudder")
_BODY: Final = 6  # y, vy, roll, heading, roll rate, yaw rate; the latter two about body axes
_TRUTH: Final = 6  # y, vy, roll, heading, and the rates of these two
_LAWS: Final = 5  # bank setpoint: integral, rate; aileron: integral, rate; rudder: rate


def lateral_loop(laws: Laws, condition: Condition) -> Loop:
    """The closed loop; inputs: into the commands, outputs: these commands, in the order of
    `BREAKS`.  Errors: ValueError where the aircraft has no such glide."""
    trim = glide_at(condition.model, condition.speed_mps)
    dt = 1.0 / condition.step_hz
    servo = condition.servo._replace(delay_s=condition.servo.delay_s + condition.command_delay_s)
    pending = len(servo_start(servo, dt).pending)
    surface = 1 + pending  # a deflection, and what is on its way to it
    plant_size = _BODY + 2 * surface

    sensors = condition.sensors
    inertial = sensors.imu is not None and laws.motion.use_imu
    source = sensors.imu if sensors.imu is not None and inertial else sensors.attitude
    late = sensor_timing("attitude", source.rate_hz, source.delay_s, condition.step_hz).delay_steps
    timing = sensor_timing(
        "position", sensors.position.rate_hz, sensors.position.delay_s, condition.step_hz
    )
    period = 1 if inertial else timing.period_steps
    fix_line = 0 if inertial else timing.delay_steps
    filtered = 0 if inertial else 2
    take, _ = fix_matrices(laws.motion, timing.period_steps * dt, dt, sensors, inertial)
    airspeed = speed_within(laws.schedule, trim.airspeed_mps)
    sizes = np.cumsum([0, plant_size, _TRUTH * late, 2 * fix_line, filtered, _LAWS])
    size = int(sizes[-1])

    def tick(phase: int, vector: Matrix) -> Matrix:
        """States and what is injected to next states and commands."""
        plant, line, fixes, estimate, law = (vector[begin:end] for begin, end in pairwise(sizes))
        into_aileron, into_rudder = vector[size:]
        truth = _measured(trim, plant)
        samples = [truth, *(line[_TRUTH * i : _TRUTH * (i + 1)] for i in range(late))]
        seen, age_s = samples[-1], late * dt
        roll, roll_rate = seen[2] + age_s * seen[4], seen[4]
        heading, heading_rate = seen[3] + age_s * seen[5], seen[5]
        if inertial:
            y, vy = seen[0] + age_s * seen[1], seen[1]
        else:
            waiting = [truth[:2], *(fixes[2 * i : 2 * i + 2] for i in range(fix_line))]
            since = (phase - timing.delay_steps) % period
            if since == 0:
                carried = np.array([estimate[0] + period * dt * estimate[1], estimate[1]])
                estimate = carried + take @ (waiting[-1] - carried)
            fixes = np.concatenate(waiting)[: 2 * fix_line]
            y, vy = estimate[0] + (timing.delay_steps + since) * dt * estimate[1], estimate[1]

        bank_i, bank_rate, roll_i, roll_d, heading_d = law.tolist()
        wanted = heading_setpoint(laws.heading, laws.target.x_m, float(y))
        bank, bank_terms = sideways_step(
            laws.sideways, PidState(bank_i, bank_rate), wanted, airspeed, float(vy), dt, 0
        )
        rolled, aileron = attitude_step(
            laws.roll,
            PidState(roll_i, roll_d),
            bank_terms.output,
            float(roll),
            float(roll_rate),
            0.0,
            dt,
            0,
        )
        turned, rudder = heading_step(
            laws.heading,
            PidState(0.0, heading_d),
            wanted,
            float(heading),
            float(heading_rate),
            0.0,
            dt,
        )
        flown = _flown(
            condition,
            trim,
            servo,
            plant,
            (aileron.output + into_aileron, rudder.output + into_rudder),
        )
        return np.concatenate(
            [
                flown,
                np.concatenate(samples)[: _TRUTH * late],
                fixes,
                estimate,
                [bank.integral, bank.rate, rolled.integral, rolled.rate, turned.rate],
                [aileron.output, rudder.output],
            ]
        )

    jacobians = [
        differences(partial(tick, phase), np.zeros(size + len(BREAKS))) for phase in range(period)
    ]
    return Loop(
        dt,
        Periodic(
            [each[:size, :size] for each in jacobians],
            [each[:size, size:] for each in jacobians],
            [each[size:, :size] for each in jacobians],
            [each[size:, size:] for each in jacobians],
        ),
        BREAKS,
    )


def _measured(trim: Glide, plant: Matrix) -> Matrix:
    """What sensors see; the rates are those of roll and heading, pitched by the glide."""
    y, vy, roll, heading, p, r = plant[:_BODY]
    pitch = trim.pitch_rad
    return np.array([y, vy, roll, heading, p + r * tan(pitch), r / cos(pitch)])


def _flown(
    condition: Condition,
    trim: Glide,
    servo: ServoParams,
    plant: Matrix,
    commands: tuple[float, float],
) -> Matrix:
    """Servos and aircraft a tick later."""
    dt = 1.0 / condition.step_hz
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
    after = step(condition.model, before, surfaces, wind, wind, dt)
    roll, _, heading = euler_from_quaternion(after.qw, after.qx, after.qy, after.qz)
    return np.array(
        [
            *(after.y_m, after.velocity_y_mps, roll, heading),
            *(after.roll_rate_frd_radps, after.yaw_rate_frd_radps),
            *(value for each in moved for value in (each.deflection, *each.pending)),
        ]
    )

"""How much the two loops bear that hold a point: one opened while the other is closed.

The rigid body hovers in an air of a given gradient, linearised by differences of the very functions
that fly: servo, aircraft, the line's law, pitch, and the brake's feed-forward.  Along the line the
loop is opened at the brake's command, across it at the elevator's, where the line alone is looked
at too.  Measurements are taken as they are; what is late in them counts as delay of the commands.

    L(z) = -C_s(z) S_b^-1 P(z)      C_s = D (K + K_i T / (z - 1)) (v_s + k_s e_s)
    alpha = min 2 |1 + L| / |1 - L|                 the balanced disk margin

(Seiler, Packard and Gahinet, An Introduction to Disk Margins, 2020.)  6 dB and 45 degrees need
alpha of 0.67 and 0.83.
"""

from __future__ import annotations

from math import cos, inf, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.linear_controller import goes_by_accelerations
from tgl_soar.analysis.linear_plant import Condition, Matrix, differences
from tgl_soar.control.attitude import attitude_step, followed_rate
from tgl_soar.control.gain_blend import pid_between, soaring_between
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidGains, PidState
from tgl_soar.control.pitch_schedule import pitch_gains, soaring_gains
from tgl_soar.control.point_hold import brake_effect
from tgl_soar.control.soaring import SoaringGains, SoaringState, soaring_step
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.aircraft import Glide, Wind, braked, glide_at, gliding_state, step
from tgl_soar.sim.servos import servo_moved
from tgl_soar.types import SurfaceCommand, polar_slope

FREQUENCIES_RADPS: Final = np.geomspace(0.05, 200.0, 400)
_BODY: Final = 8  # x, z, vx, vz, pitch, pitch rate, elevator, brake
_LAWS: Final = 5  # integral and rate of both laws of pitch, and the last setpoint
_UNLIMITED: Final = 1e9


class BrakeMargin(NamedTuple):
    """Disk margins; 0: unstable."""

    alpha: float  # of the brake's loop, the elevator's closed
    crossover_radps: float  # of it: the highest at which its gain is 1; 0: nowhere
    elevator_alpha: float  # of the elevator's loop, the brake's closed
    line_alpha: float  # of the elevator's loop with the brake at rest


class _Opened(NamedTuple):
    """x' = a x + brake u_b + elevator u_e; the laws command gains x + through u_b of elevator."""

    a: Matrix
    brake: Matrix
    elevator: Matrix
    gains: Matrix
    through: float
    along: Matrix  # place and speed along the line


def brake_margin(laws: Laws, condition: Condition) -> BrakeMargin:
    """The margin about half of the brake.  Errors: ValueError without a glide or a brake."""
    if not laws.brake.available:
        raise ValueError("no brake: this airframe has none, or the route does not command it")
    opened = _opened(laws, condition)
    dt, gains, speed = 1.0 / condition.step_hz, laws.brake, condition.speed_mps
    eta = eta_from_lean(condition.lean_rad)
    sinks = sin(eta) - polar_slope(laws.wind.aerodynamics.polar, speed) * cos(eta)
    scale = sinks / (gains.sink * speed**3)

    # The integral of the brake's law is one state more.
    n = len(opened.a)
    asked = np.zeros((1, n + 1))
    asked[:, :n] = np.array([[gains.kp_per_s, 1.0]]) @ opened.along
    a = np.zeros((n + 1, n + 1))
    a[:n, :n] = opened.a
    a[n:] = gains.ki_per_s * dt * asked
    a[n, n] = 1.0
    brake, elevator = (np.vstack([b, [[0.0]]]) for b in (opened.brake, opened.elevator))
    by_brake = scale * gains.kv * asked
    by_brake[0, n] = scale
    by_elevator = np.hstack([opened.gains, [[0.0]]])

    both = brake + elevator * opened.through  # what a brake does, its feed-forward with it
    pitched = a + elevator @ by_elevator
    stable = _is_stable(pitched + both @ by_brake)
    along = _loop(pitched, both, by_brake, dt)
    held = _loop(a + brake @ by_brake, elevator, by_elevator + opened.through * by_brake, dt)
    alone = _loop(opened.a, opened.elevator, opened.gains, dt)
    above = np.flatnonzero(np.abs(along) >= 1.0)
    return BrakeMargin(
        alpha=_disk(along) if stable else 0.0,
        crossover_radps=float(FREQUENCIES_RADPS[above[-1]]) if len(above) else 0.0,
        elevator_alpha=_disk(held) if stable else 0.0,
        line_alpha=_disk(alone) if _is_stable(opened.a + opened.elevator @ opened.gains) else 0.0,
    )


def _loop(a: Matrix, b: Matrix, c: Matrix, dt_s: float) -> NDArray[np.complex128]:
    """L(z) = -c (z - a)^-1 b at every frequency: c asks for what b then does."""
    found = np.empty(len(FREQUENCIES_RADPS), dtype=np.complex128)
    for i, frequency in enumerate(FREQUENCIES_RADPS):
        z = np.exp(1j * frequency * dt_s)
        found[i] = -(c @ np.linalg.solve(z * np.eye(len(a)) - a, b))[0, 0]
    return found


def _disk(loop: NDArray[np.complex128]) -> float:
    return float(np.min(2.0 * np.abs(1.0 + loop) / np.abs(1.0 - loop)))


def _is_stable(a: Matrix) -> bool:
    return bool(np.abs(np.linalg.eigvals(a)).max() < 1.0 + 1e-9)


def _opened(laws: Laws, condition: Condition) -> _Opened:
    """Aircraft, servos, delays and the laws of pitch, opened at both commands."""
    bias = 0.5
    trim = glide_at(braked(condition.model, bias), condition.speed_mps)
    dt, eta = 1.0 / condition.step_hz, eta_from_lean(condition.lean_rad)
    waits = max(1, round(condition.command_delay_s / dt))
    inertial = goes_by_accelerations(laws, condition.sensors)
    soaring, pitch = _gains(laws, condition, inertial)
    follows = laws.setpoint_weight if inertial else 0.0
    still = brake_effect(laws.brake, bias, condition.speed_mps)

    def tick(vector: Matrix) -> Matrix:
        x, z, vx, vz, angle, rate, elevator, brake = (float(v) for v in vector[:_BODY])
        outer, outer_rate, inner, inner_rate, followed = map(float, vector[_BODY : _BODY + _LAWS])
        elevators = list(vector[_BODY + _LAWS : _BODY + _LAWS + waits])
        brakes = list(vector[_BODY + _LAWS + waits : _BODY + _LAWS + 2 * waits])
        command, moved = float(vector[-2]), float(vector[-1])
        effect = brake_effect(laws.brake, bias + command, condition.speed_mps)
        line, terms = soaring_step(
            soaring,
            SoaringState(PidState(outer, outer_rate), 0.0, 0),
            effect.pitch_rad - still.pitch_rad,
            e_rho(0.0, 0.0, eta, x, z),
            e_rho(0.0, 0.0, eta, vx, vz),
            dt,
            0,
        )
        law, moves = attitude_step(
            pitch,
            PidState(inner, inner_rate),
            terms.output,
            angle,
            rate,
            effect.elevator - still.elevator,
            dt,
            0,
            setpoint_rate_radps=followed_rate(follows, terms.output, followed, inf, dt),
        )
        servo = condition.servo
        elevator_next = servo_moved(
            servo, trim.elevator + elevator, trim.elevator + float(elevators[0]), dt
        )
        brake_next = servo_moved(servo, bias + brake, bias + float(brakes[0]), dt)
        qw, qx, qy, qz = quaternion_from_euler(0.0, trim.pitch_rad + angle, 0.0)
        before = gliding_state(trim, _wind(condition, trim, 0.0, 0.0), x, 0.0, z)._replace(
            velocity_x_mps=vx,
            velocity_z_mps=vz,
            qw=qw,
            qx=qx,
            qy=qy,
            qz=qz,
            pitch_rate_frd_radps=rate,
            elevator=trim.elevator + elevator,
            brake=bias + brake,
        )
        after = step(
            condition.model,
            before,
            SurfaceCommand(elevator_next, 0.0, 0.0, brake_next),
            _wind(condition, trim, x, z),
            _wind(condition, trim, x + vx * dt, z + vz * dt),
            dt,
        )
        _, angle_next, _ = euler_from_quaternion(after.qw, after.qx, after.qy, after.qz)
        return np.array(
            [
                *(after.x_m, after.z_m, after.velocity_x_mps, after.velocity_z_mps),
                *(angle_next - trim.pitch_rad, after.pitch_rate_frd_radps),
                *(elevator_next - trim.elevator, brake_next - bias),
                *(line.pid.integral, line.pid.rate, law.integral, law.rate, terms.output),
                *(*elevators[1:], moved, *brakes[1:], command),
                moves.output,
            ]
        )

    size = _BODY + _LAWS + 2 * waits
    return _parts(differences(tick, np.zeros(size + 2)), size, eta)


def _parts(jacobian: Matrix, size: int, eta_rad: float) -> _Opened:
    """Of a state of that size, then the commands of brake and elevator."""
    along = np.zeros((2, size))
    along[0, :2] = along[1, 2:4] = cos(eta_rad), sin(eta_rad)
    return _Opened(
        a=jacobian[:size, :size],
        brake=jacobian[:size, size : size + 1],
        elevator=jacobian[:size, size + 1 :],
        gains=jacobian[size:, :size],
        through=float(jacobian[size:, size][0]),
        along=along,
    )


def _gains(laws: Laws, condition: Condition, inertial: bool) -> tuple[SoaringGains, PidGains]:
    """Of the line and of pitch, as they are scheduled, without limits."""
    eta = eta_from_lean(condition.lean_rad)
    weight = 1.0 if inertial else 0.0
    soaring = soaring_gains(
        soaring_between(laws.soaring, laws.soaring_imu, weight),
        laws.schedule,
        weight,
        condition.speed_mps,
        eta,
    )
    soaring = soaring._replace(
        slew_radps=_UNLIMITED,
        pid=soaring.pid._replace(
            output_min=-_UNLIMITED, output_max=_UNLIMITED, integral_max=_UNLIMITED
        ),
    )
    pitch = pitch_gains(
        pid_between(laws.pitch, laws.pitch_imu, weight), laws.schedule, condition.speed_mps
    )._replace(output_min=-_UNLIMITED, output_max=_UNLIMITED, integral_max=_UNLIMITED)
    return soaring, pitch


def _wind(condition: Condition, trim: Glide, x_m: float, z_m: float) -> Wind:
    u_x, u_z, w_x, w_z = condition.gradient_per_s
    return trim.horizontal_mps + u_x * x_m + u_z * z_m, 0.0, trim.sink_mps + w_x * x_m + w_z * z_m

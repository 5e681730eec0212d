"""The aircraft, linear about a hovering glide, with the gusts, the servo and the way to it.

Everything is made by differences of what is flown: `aircraft.step`, `servo_step`, `dryden_step`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.gusts import DrydenState, dryden_params, dryden_step
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.aircraft import AircraftModel, AircraftState, Glide, glide_at, gliding_state, step
from tgl_soar.sim.sensors import Sensors
from tgl_soar.sim.servos import ServoParams, ServoState, servo_start, servo_step
from tgl_soar.types import SurfaceCommand

Matrix = NDArray[np.float64]

TRUTH: Final = 4  # e_rho, its rate, pitch, pitch rate: what the controller measures
_STEP: Final = 1e-6  # of differences: far inside every limit, far above rounding
# A state that a tick changes by less is held: far below what an integral adds in one, far above
# rounding in differences.
HELD: Final = 1e-9
_UNIFORM: Final = (0.0, 0.0, 0.0, 0.0)
_AIRCRAFT: Final = 7  # x, z, vx, vz, pitch, pitch rate, deflection; then pending, then gusts
_GUST: Final = 4  # u, w, and two memories of w


class Condition(NamedTuple):
    """One aircraft hovering at one place, and how its sensors and its surfaces are reached."""

    model: AircraftModel
    servo: ServoParams
    speed_mps: float  # horizontal airspeed, which is the wind
    lean_rad: float
    sensors: Sensors  # with accelerometers or without
    command_delay_s: float = 0.0  # from the tick to the servo, beyond the hold of one tick
    gradient_per_s: tuple[float, float, float, float] = _UNIFORM  # du/dx, du/dz, dw/dx, dw/dz
    step_hz: int = 200


class Gusts(NamedTuple):
    """Dryden turbulence."""

    intensity: float  # a fraction of the reference wind
    reference_wind_mps: float
    length_scale_m: float = 1.5


class Periodic(NamedTuple):
    """x' = A_k x + B_k u, y = C_k x + D_k u, k the tick of the period."""

    a: list[Matrix]
    b: list[Matrix]
    c: list[Matrix]
    d: list[Matrix]


def differences(function: Callable[[Matrix], Matrix], at: Matrix) -> Matrix:
    """The Jacobian by central differences: shape (len of the result, len of `at`)."""
    columns = []
    for i in range(len(at)):
        shift = np.zeros(len(at))
        shift[i] = _STEP
        columns.append((function(at + shift) - function(at - shift)) / (2.0 * _STEP))
    return np.array(columns).T


def field_gradient(field: WindField, x_m: float, z_m: float) -> tuple[float, float, float, float]:
    """du/dx, du/dz, dw/dx, dw/dz [1/s] at a place of a field."""

    def wind(place: Matrix) -> Matrix:
        u, _, w = field.wind_at(float(place[0]), 0.0, float(place[1]), 0.0)
        return np.array([u, w])

    (u_x, u_z), (w_x, w_z) = differences(wind, np.array([x_m, z_m])).tolist()
    return u_x, u_z, w_x, w_z


def without_idle(system: Periodic) -> Periodic:
    """Without states that nothing moves: an integral whose gain is 0 stays where it is, at 0.

    No input reaches it; left in, its pole at 0 would be taken for a loop that does not settle.
    """
    a, b, c, d = system
    hold = np.eye(len(a[0]))
    moved = np.zeros(len(hold), dtype=bool)
    for ak, bk in zip(a, b, strict=True):
        moved |= np.any(np.abs(ak - hold) > HELD, axis=1) | np.any(np.abs(bk) > HELD, axis=1)
    return Periodic(
        [ak[np.ix_(moved, moved)] for ak in a],
        [bk[moved] for bk in b],
        [ck[:, moved] for ck in c],
        d,
    )


class Plant(NamedTuple):
    """Inputs: command, two white numbers of the gusts; outputs: e_rho, pitch, and their rates."""

    condition: Condition
    trim: Glide
    a: Matrix
    b_command: Matrix  # (n, 1)
    b_gust: Matrix  # (n, 2)
    c: Matrix  # (4, n)


def linear_plant(condition: Condition, gusts: Gusts | None = None) -> Plant:
    """The aircraft hovering at its condition.  Errors: ValueError where it has no such glide."""
    trim = glide_at(condition.model, condition.speed_mps)
    dt = 1.0 / condition.step_hz
    servo = condition.servo._replace(delay_s=condition.servo.delay_s + condition.command_delay_s)
    pending = len(servo_start(servo, dt).pending)
    size = _AIRCRAFT + pending + _GUST
    if gusts is None:
        gusts = Gusts(0.0, condition.speed_mps)
    dryden = dryden_params(gusts.intensity, gusts.reference_wind_mps, gusts.length_scale_m, dt)

    def tick(vector: Matrix) -> Matrix:
        """States, command and white numbers, all as deviations, to the next states."""
        x, z, vx, vz = vector[:4]
        deflection = vector[_AIRCRAFT - 1]
        waiting = vector[_AIRCRAFT : _AIRCRAFT + pending] + trim.elevator
        u, w, w1, w2 = vector[_AIRCRAFT + pending : size]
        command, white_u, white_w = vector[size:]
        air, (u_next, _, w_next) = dryden_step(
            dryden,
            DrydenState(u=float(u), v1=0.0, v2=0.0, w1=float(w1), w2=float(w2)),
            float(white_u),
            0.0,
            float(white_w),
        )
        moved = servo_step(
            servo,
            ServoState(trim.elevator + deflection, tuple(waiting)),
            trim.elevator + command,
            dt,
        )
        before = _hovering(trim, vector[:_AIRCRAFT])
        after = step(
            condition.model,
            before,
            SurfaceCommand(moved.deflection, 0.0, 0.0),
            _wind(condition, trim, x, z, u, w),
            _wind(condition, trim, x + vx * dt, z + vz * dt, u_next, w_next),
            dt,
        )
        _, pitch, _ = euler_from_quaternion(after.qw, after.qx, after.qy, after.qz)
        return np.array(
            [
                after.x_m,
                after.z_m,
                after.velocity_x_mps,
                after.velocity_z_mps,
                pitch - trim.pitch_rad,
                after.pitch_rate_frd_radps,
                moved.deflection - trim.elevator,
                *(value - trim.elevator for value in moved.pending),
                *(u_next, w_next, air.w1, air.w2),
            ]
        )

    jacobian = differences(tick, np.zeros(size + 3))
    eta = eta_from_lean(condition.lean_rad)
    c = np.zeros((TRUTH, size))
    for i in (0, 1):
        c[i, 2 * i] = e_rho(0.0, 0.0, eta, 1.0, 0.0)
        c[i, 2 * i + 1] = e_rho(0.0, 0.0, eta, 0.0, 1.0)
    c[2, 4] = c[3, 5] = 1.0
    a = jacobian[:, :size]
    if condition.gradient_per_s == _UNIFORM:
        a, kept = _along_the_line_dropped(a, eta)
        jacobian = kept @ jacobian
        c = c @ kept.T
        c[0] = 0.0
        c[0, 0] = 1.0
    return Plant(
        condition=condition,
        trim=trim,
        a=a,
        b_command=jacobian[:, size : size + 1],
        b_gust=jacobian[:, size + 1 :],
        c=c,
    )


def _along_the_line_dropped(a: Matrix, eta_rad: float) -> tuple[Matrix, Matrix]:
    """Where the air is the same everywhere, the place along the line is in no equation: a pole at
    1 that says nothing.  Of x and z only e_rho is kept, in the place of x."""
    kept = np.delete(np.eye(len(a)), 1, axis=0)
    kept[0, 0], kept[0, 1] = -sin(eta_rad), cos(eta_rad)
    back = np.linalg.pinv(kept)
    return kept @ a @ back, kept


def _hovering(trim: Glide, deviation: Matrix) -> AircraftState:
    x, z, vx, vz, pitch, rate, deflection = (float(value) for value in deviation)
    state = gliding_state(trim, (trim.horizontal_mps, 0.0, trim.sink_mps), x, 0.0, z)
    qw, qx, qy, qz = quaternion_from_euler(0.0, trim.pitch_rad + pitch, 0.0)
    return state._replace(
        velocity_x_mps=vx,
        velocity_z_mps=vz,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        pitch_rate_frd_radps=rate,
        elevator=trim.elevator + deflection,
    )


def _wind(
    condition: Condition, trim: Glide, x: float, z: float, u: float, w: float
) -> tuple[float, float, float]:
    u_x, u_z, w_x, w_z = condition.gradient_per_s
    return (
        float(trim.horizontal_mps + u_x * x + u_z * z + u),
        0.0,
        float(trim.sink_mps + w_x * x + w_z * z + w),
    )

"""The loop, linear about a hovering glide: poles, margins, and what gusts do to it.

Everything is made by differences of what flies and of what is flown: `aircraft.step`,
`servo_step`, `dryden_step`, the laws `soaring_step` and `attitude_step`, and the estimator's
`spread`, `position_taken` and `velocity_taken`.  Nothing is written down a second time but how
these are connected, tick by tick:

    sensors see the state at tick n → estimate → e_rho to pitch setpoint → elevator command
    → transport and servo → aircraft at tick n + 1

Fixes come every N ticks, so that the loop is periodic: Φ is its map over N ticks and

    poles                 ln(eigenvalues of Φ) / (N dt)
    response at ω         the part e^{jωt} of the answer to an injected e^{jωt}, all else left out,
                          as a multisine in flight would measure it

The loop is opened at two places, one at a time, the rest of it closed:

    elevator   plant input: the command
    e_rho      plant output: e_rho with its rate, which is the same loop as the pitch setpoint

With L the open loop there, S = 1 / (1 + L), T = 1 − S, the **disk margin** (Seiler, Packard,
Gahinet, "An Introduction to Disk Margins", IEEE Control Systems 40(5), 2020, balanced: σ = 0) is

    α = 1 / max_ω |S − 1/2| = 2 / max_ω |S − T|      0 where the loop is unstable

It promises a gain margin of (2 + α) / (2 − α) up and down and a phase margin of 2 atan(α / 2), at
once: α = 0.67 is 6 dB, 0.83 is 45°.  The classical margins are at least that, and given beside it.

What is left out: limits of rate and travel, the lateral motion, trim_step (slow), what the envelope
cuts.  With accelerations the estimate of place and velocity follows the truth by itself (the
accelerometers feel what the aircraft does), so that the filter's errors come from noise alone; the
delay of fixes then only makes them older, and is left out of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import atan, cos, log10, pi, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from tgl_soar.air.field import WindField
from tgl_soar.air.gusts import DrydenState, dryden_params, dryden_step
from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidState
from tgl_soar.control.schedule import pitch_gains, schedule_at_age, soaring_gains
from tgl_soar.control.scheduling import pid_between, soaring_between
from tgl_soar.control.soaring import SoaringState, soaring_step
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    position_taken,
    spread,
    velocity_taken,
)
from tgl_soar.estimation.motion_state import ACCELERATION_S, BIAS_S, MotionGains
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.aircraft import AircraftModel, AircraftState, Glide, glide_at, gliding_state, step
from tgl_soar.sim.sensors import Sensors, sensor_timing
from tgl_soar.sim.servos import ServoParams, ServoState, servo_start, servo_step
from tgl_soar.types import SurfaceCommand

Matrix = NDArray[np.float64]
Complex = NDArray[np.complex128]

BREAKS: Final = ("elevator", "e_rho")
FREQUENCIES_RADPS: Final = np.geomspace(0.2, 300.0, 260)
_STEP: Final = 1e-6  # of differences: far inside every limit, far above rounding
_UNIFORM: Final = (0.0, 0.0, 0.0, 0.0)


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


class Margin(NamedTuple):
    """Of the loop, opened at one place."""

    alpha: float  # disk margin; 0: unstable
    at_radps: float  # where it is least
    gain_up_db: float  # until it rings; inf: never
    gain_down_db: float  # towards less gain, negative; -inf: never
    phase_deg: float
    delay_s: float  # that it bears


class Activity(NamedTuple):
    """What turbulence and noise make of the loop: standard deviations."""

    e_rho_m: float
    pitch_rad: float
    pitch_rate_radps: float
    elevator: float  # commanded


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


# --- the plant: gusts, servo and transport, aircraft ---------------------------------------------

_AIRCRAFT: Final = 7  # x, z, vx, vz, pitch, pitch rate, deflection; then pending, then gusts
_GUST: Final = 4  # u, w, and two memories of w
_TRUTH: Final = 4  # e_rho, its rate, pitch, pitch rate: what the controller measures


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
    c = np.zeros((_TRUTH, size))
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


# --- the controller: sensors, estimator, laws ----------------------------------------------------

_NOISES: Final = 5  # white: fix's place, fix's velocity, attitude, gyro, specific force


def linear_controller(laws: Laws, condition: Condition, errors: bool = False) -> Periodic:
    """Inputs: the truth's four, an injection into the pitch setpoint, noises.  Outputs: elevator
    command, pitch setpoint before the injection.

    errors: with what the filter's errors add where accelerations are used (no margin needs it).
    """
    sensors, dt = condition.sensors, 1.0 / condition.step_hz
    timing = sensor_timing(
        "position", sensors.position.rate_hz, sensors.position.delay_s, condition.step_hz
    )
    inertial = sensors.imu is not None and laws.motion.use_imu
    source = sensors.imu if sensors.imu is not None and inertial else sensors.attitude
    late = sensor_timing("attitude", source.rate_hz, source.delay_s, condition.step_hz).delay_steps
    period = timing.period_steps if errors or not inertial else 1
    fix_line = 0 if inertial else timing.delay_steps
    line = late * _TRUTH
    filter_size = 2 if not inertial else 3 if errors else 0
    size = line + 2 * fix_line + filter_size + 4
    take, carry = fix_matrices(laws.motion, timing.period_steps * dt, dt, sensors, inertial)
    weight = 1.0 if inertial else 0.0
    airspeed = glide_at(condition.model, condition.speed_mps).airspeed_mps
    schedule = schedule_at_age(laws.schedule, late * dt)
    soaring = soaring_gains(
        soaring_between(laws.soaring, laws.soaring_imu, weight),
        schedule,
        weight,
        airspeed,
        eta_from_lean(condition.lean_rad),
    )
    pitch = pitch_gains(pid_between(laws.pitch, laws.pitch_imu, weight), schedule, airspeed)
    soaring = soaring._replace(
        slew_radps=1e9,  # linear: no limit acts
        pid=soaring.pid._replace(output_min=-1e9, output_max=1e9, integral_max=1e9),
    )
    pitch = pitch._replace(output_min=-1e9, output_max=1e9, integral_max=1e9)
    has_velocity = 1.0 if sensors.position.gives_velocity else 0.0

    def tick(phase: int, vector: Matrix) -> Matrix:
        """States, the truth, an injection, noises to next states, command and setpoint."""
        truth = vector[size : size + _TRUTH]
        injected = vector[size + _TRUTH]
        n_place, n_velocity, n_attitude, n_gyro, n_force = vector[size + _TRUTH + 1 :]
        seen_line = [vector[_TRUTH * i : _TRUTH * (i + 1)] for i in range(late)]
        sample = truth + np.array([0.0, 0.0, n_attitude, n_gyro])
        seen = seen_line[-1] if late else sample
        after_line = [sample, *seen_line[:-1]] if late else []
        # What is late is carried on by its rate, as the estimator does.
        pitch_rad, rate_radps = seen[2] + late * dt * seen[3], seen[3]

        start = line
        fixes = [vector[start + 2 * i : start + 2 * i + 2] for i in range(fix_line)]
        start += 2 * fix_line
        estimate = vector[start : start + filter_size]
        start += filter_size
        after_fixes: list[Matrix] = []
        if inertial:
            e, e_rate = seen[0] + late * dt * seen[1], seen[1]
            if errors:  # truth less estimate, driven by noise alone
                estimate = carry @ estimate + np.array([0.5 * dt * dt, dt, 0.0]) * n_force
                if phase == 0:
                    noise = np.array([n_place, has_velocity * n_velocity])
                    estimate = estimate - take @ (noise + estimate[:2])
                e, e_rate = e - estimate[0], e_rate - estimate[1]
        else:
            fix = np.array([truth[0] + n_place, truth[1] + n_velocity])
            arrived = fixes[-1] if fix_line else fix
            after_fixes = [fix, *fixes[:-1]] if fix_line else []
            since = (phase - timing.delay_steps) % period
            if since == 0:
                predicted = np.array([estimate[0] + period * dt * estimate[1], estimate[1]])
                estimate = predicted + take @ (arrived - predicted)
            age = (timing.delay_steps + since) * dt
            e, e_rate = estimate[0] + age * estimate[1], estimate[1]

        outer, outer_rate, inner, inner_rate = vector[start : start + 4]
        soared, outer_terms = soaring_step(
            soaring,
            SoaringState(PidState(float(outer), float(outer_rate)), 0.0, 0),
            0.0,
            float(e),
            float(e_rate),
            dt,
            0,
        )
        flown, inner_terms = attitude_step(
            pitch,
            PidState(float(inner), float(inner_rate)),
            outer_terms.output + float(injected),
            float(pitch_rad),
            float(rate_radps),
            0.0,
            dt,
            0,
        )
        return np.concatenate(
            [
                *after_line,
                *after_fixes,
                estimate,
                [soared.pid.integral, soared.pid.rate, flown.integral, flown.rate],
                [inner_terms.output, outer_terms.output],
            ]
        )

    a, b, c, d = [], [], [], []
    for phase in range(period):
        inputs = np.eye(size + _TRUTH + 1 + _NOISES)  # no limit acts: it is linear as it stands
        jacobian = np.array([tick(phase, unit) for unit in inputs]).T
        a.append(jacobian[:size, :size])
        b.append(jacobian[:size, size:])
        c.append(jacobian[size:, :size])
        d.append(jacobian[size:, size:])
    return Periodic(a, b, c, d)


@lru_cache(
    maxsize=64
)  # a minute of ticks, whatever the gains of the loop: its results are read only
def fix_matrices(
    gains: MotionGains, interval_s: float, dt_s: float, sensors: Sensors, inertial: bool
) -> tuple[Matrix, Matrix]:
    """The filter at rest: what a fix's innovations (place, velocity before it) add to the errors,
    and how errors (place, velocity, bias) are carried on over a tick."""
    coupling = 1.0 if inertial else 0.0
    if inertial:
        assert sensors.imu is not None
        density = gains.force_sd_mps2**2 / sensors.imu.rate_hz
        bias_density = gains.bias_sd_mps2**2 / BIAS_S
    else:
        density = 2.0 * gains.unknown_sd_mps2**2 * ACCELERATION_S
        bias_density = 0.0
    velocity = sensors.position.gives_velocity

    def taken(covariance: Covariance, place: float, rate: float) -> Errors:
        none = Errors(*(0.0,) * 10, covariance)
        errors = position_taken(none, place, 0.0, 0.0, gains.fix_sd_m**2)
        if velocity:
            left = rate - errors.velocity_x_mps
            errors = velocity_taken(errors, left, 0.0, 0.0, gains.velocity_sd_mps**2)
        return errors

    bias = gains.bias_sd_mps2**2 if inertial else 0.0
    covariance = Covariance(pp=1.0, pv=0.0, pb=0.0, vv=1.0, vb=0.0, bb=bias)
    # A filter of bandwidth ω settles in a few / ω; the slowest here, the bias, in about 10 s.
    for _ in range(round(60.0 / interval_s)):
        covariance = Covariance(*spread(covariance, interval_s, coupling, density, bias_density))
        settled = covariance
        covariance = taken(covariance, 0.0, 0.0).covariance
    columns = []
    for place, rate in ((1.0, 0.0), (0.0, 1.0)):
        errors = taken(settled, place, rate)
        columns.append([errors.x_m, errors.velocity_x_mps, errors.bias_x_mps2])
    take = np.array(columns).T
    carry = np.array([[1.0, dt_s, -0.5 * dt_s * dt_s], [0.0, 1.0, -dt_s], [0.0, 0.0, 1.0]])
    return (take if inertial else take[:2]), carry


# --- the loop closed -----------------------------------------------------------------------------


class Loop(NamedTuple):
    """The closed loop.  Inputs: into the elevator command, into the pitch setpoint, two gusts'
    white numbers, noises.  Outputs: elevator command, pitch setpoint, e_rho, rate, pitch, rate."""

    step_s: float
    system: Periodic
    breaks: tuple[str, ...] = BREAKS  # inputs and outputs of these come first, in this order


def close_loop(plant: Plant, controller: Periodic) -> Loop:
    """Plant and controller, connected."""
    n, inputs = len(plant.a), 2 + 2 + _NOISES
    a: list[Matrix] = []
    b: list[Matrix] = []
    c: list[Matrix] = []
    d: list[Matrix] = []
    for ka, kb, kc, kd in zip(*controller, strict=True):
        m = len(ka)
        truth_b, rest_b = kb[:, :_TRUTH], kb[:, _TRUTH:]
        truth_d, rest_d = kd[:, :_TRUTH], kd[:, _TRUTH:]
        command = np.zeros((1, n + m))
        command[:, :n], command[:, n:] = truth_d[:1] @ plant.c, kc[:1]
        full = np.zeros((n + m, n + m))
        full[:n, :n] = plant.a
        full[:n] += plant.b_command @ command
        full[n:, :n], full[n:, n:] = truth_b @ plant.c, ka
        into = np.zeros((n + m, inputs))
        others = [1, *range(4, inputs)]  # the setpoint's injection, and noises
        into[:n, 0:1] = plant.b_command
        into[:n, 2:4] = plant.b_gust
        into[:n, others] += plant.b_command @ rest_d[:1]
        into[n:, others] = rest_b
        out = np.zeros((2 + _TRUTH, n + m))
        out[:2, :n], out[:2, n:] = truth_d @ plant.c, kc
        out[2:, :n] = plant.c
        through = np.zeros((2 + _TRUTH, inputs))
        through[:2, others] = rest_d
        a.append(full)
        b.append(into)
        c.append(out)
        d.append(through)
    return Loop(1.0 / plant.condition.step_hz, Periodic(a, b, c, d))


def poles(loop: Loop) -> Complex:
    """Of the closed loop [1/s], slowest first; what is forgotten within a tick is left out."""
    period = _period_map(loop)
    values = np.linalg.eigvals(period).astype(np.complex128)
    values = values[np.abs(values) > 1e-6]
    rates = np.log(values) / (len(loop.system.a) * loop.step_s)
    return np.asarray(rates[np.argsort(-rates.real)])


def is_stable(loop: Loop) -> bool:
    """Whether every pole decays."""
    return bool(np.max(np.abs(np.linalg.eigvals(_period_map(loop)))) < 1.0)


def _period_map(loop: Loop) -> Matrix:
    product = np.eye(len(loop.system.a[0]))
    for a in loop.system.a:
        product = a @ product
    return product


def response(loop: Loop, source: int, out: int, radps: Matrix) -> Complex:
    """The answer at the same frequency of an output to an input, shape of `radps`."""
    a, b, c, d = loop.system
    period = len(a)
    z = np.exp(1j * radps * loop.step_s)[:, None]
    forced = np.zeros((len(radps), len(a[0])), dtype=np.complex128)
    for k in range(period):
        forced = forced @ a[k].T + z**k * b[k][:, source]
    left = z[:, :, None] ** period * np.eye(len(a[0])) - _period_map(loop)
    state = np.linalg.solve(left, forced[:, :, None])[:, :, 0]
    total = np.zeros(len(radps), dtype=np.complex128)
    for k in range(period):
        total += (state @ c[k][out]) / z[:, 0] ** k + d[k][out, source]
        state = state @ a[k].T + z**k * b[k][:, source]
    return total / period


def sensitivity(loop: Loop, at: str, radps: Matrix) -> Complex:
    """S at one of the loop's breaks: what is there, of what is injected there."""
    i = loop.breaks.index(at)
    return 1.0 + response(loop, i, i, radps)


def open_loop(loop: Loop, at: str, radps: Matrix) -> Complex:
    """L at one of the loop's breaks, negative feedback: S = 1 / (1 + L)."""
    s = sensitivity(loop, at, radps)
    return (1.0 - s) / s


def margin(loop: Loop, at: str) -> Margin:
    """The margins at one of the loop's breaks."""
    if not is_stable(loop):
        return Margin(
            alpha=0.0, at_radps=0.0, gain_up_db=0.0, gain_down_db=0.0, phase_deg=0.0, delay_s=0.0
        )
    radps = FREQUENCIES_RADPS
    s = sensitivity(loop, at, radps)
    peak = np.abs(s - 0.5)
    worst = int(np.argmax(peak))
    up, down = _gain_margins_db((1.0 - s) / s)
    phase, delay = _phase_margin(radps, (1.0 - s) / s)
    return Margin(
        alpha=float(1.0 / peak[worst]),
        at_radps=float(radps[worst]),
        gain_up_db=up,
        gain_down_db=down,
        phase_deg=phase,
        delay_s=delay,
    )


def disk_margin(loop: Loop, radps: Matrix = FREQUENCIES_RADPS) -> float:
    """α of the worse break, over these frequencies; 0: unstable."""
    peaks = [np.max(np.abs(sensitivity(loop, at, radps) - 0.5)) for at in loop.breaks]
    return float(1.0 / max(peaks)) if is_stable(loop) else 0.0


def promised_gain_db(alpha: float) -> float:
    """The gain, up and down, that a disk margin promises."""
    return 20.0 * log10((2.0 + alpha) / (2.0 - alpha)) if alpha < 2.0 else float("inf")


def promised_phase_rad(alpha: float) -> float:
    """The phase that a disk margin promises."""
    return 2.0 * atan(0.5 * alpha)


def _gain_margins_db(open_loop: Complex) -> tuple[float, float]:
    """The nearest crossings of the negative real axis, beyond and before -1."""
    real, imag = open_loop.real, open_loop.imag
    up, down = float("inf"), float("-inf")
    for k in np.flatnonzero(imag[:-1] * imag[1:] < 0.0):
        share = imag[k] / (imag[k] - imag[k + 1])
        where = real[k] + share * (real[k + 1] - real[k])
        if where < 0.0:
            gain = -20.0 * log10(-where)
            if gain >= 0.0:
                up = min(up, gain)
            else:
                down = max(down, gain)
    return up, down


def _phase_margin(radps: Matrix, open_loop: Complex) -> tuple[float, float]:
    """The least phase [deg] and delay [s] at the crossings of gain 1; inf where there are none."""
    size = np.log(np.abs(open_loop))
    phase, delay = float("inf"), float("inf")
    for k in np.flatnonzero(size[:-1] * size[1:] < 0.0):
        share = size[k] / (size[k] - size[k + 1])
        there = open_loop[k] * (open_loop[k + 1] / open_loop[k]) ** share
        angle = float(np.angle(-there))  # from -1; positive: what lag would use up
        phase = min(phase, abs(np.degrees(angle)))
        lag = angle if angle > 0.0 else angle + 2.0 * pi
        delay = min(delay, lag / float(radps[k] ** (1.0 - share) * radps[k + 1] ** share))
    return phase, delay


# --- turbulence and noise ------------------------------------------------------------------------


def activity(laws: Laws, condition: Condition, gusts: Gusts) -> Activity:
    """Standard deviations under turbulence and the sensors' noise, averaged over the period.

    Errors: ValueError where the loop is unstable.
    """
    loop = close_loop(
        linear_plant(condition, gusts), linear_controller(laws, condition, errors=True)
    )
    if not is_stable(loop):
        raise ValueError(f"unstable at {condition.speed_mps:g} m/s: there is no steady activity")
    sensors = condition.sensors
    imu = sensors.imu
    scale = np.zeros(2 + 2 + _NOISES)
    scale[2:] = [
        1.0,
        1.0,
        sensors.position.noise_m,
        sensors.position.velocity_noise_mps,
        sensors.attitude.noise_rad,
        imu.rate_noise_radps if imu is not None else sensors.attitude.rate_noise_radps,
        imu.force_noise_mps2 if imu is not None else 0.0,
    ]
    a, b, c, d = loop.system
    white = [into * scale for into in b]
    period, gathered = np.eye(len(a[0])), np.zeros_like(a[0])
    for ak, bk in zip(a, white, strict=True):
        period = ak @ period
        gathered = ak @ gathered @ ak.T + bk @ bk.T
    variance = solve_discrete_lyapunov(period, gathered)
    total = np.zeros(2 + _TRUTH)
    for ak, bk, ck, dk in zip(a, white, c, d, strict=True):
        total += np.diag(ck @ variance @ ck.T + (dk * scale) @ (dk * scale).T)
        variance = ak @ variance @ ak.T + bk @ bk.T
    sigma = np.sqrt(total / len(a))
    return Activity(
        e_rho_m=float(sigma[2]),
        pitch_rad=float(sigma[4]),
        pitch_rate_radps=float(sigma[5]),
        elevator=float(sigma[0]),
    )

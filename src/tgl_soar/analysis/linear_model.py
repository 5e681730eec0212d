"""The loop, linear about a hovering glide: poles, margins, and what gusts do to it.

Everything is made by differences of what flies (`linear_controller`) and of what is flown
(`linear_plant`).  Nothing is written down a second time but how these are connected, tick by tick:

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
cuts.
"""

from __future__ import annotations

from math import atan, log10, pi
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from tgl_soar.analysis.linear_controller import NOISES, linear_controller
from tgl_soar.analysis.linear_plant import (
    TRUTH,
    Condition,
    Gusts,
    Matrix,
    Periodic,
    Plant,
    linear_plant,
    without_idle,
)
from tgl_soar.control.laws import Laws

Complex = NDArray[np.complex128]

BREAKS: Final = ("elevator", "e_rho")
FREQUENCIES_RADPS: Final = np.geomspace(0.2, 300.0, 260)


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


class Loop(NamedTuple):
    """The closed loop.  Inputs: into the elevator command, into the pitch setpoint, two gusts'
    white numbers, noises.  Outputs: elevator command, pitch setpoint, e_rho, rate, pitch, rate."""

    step_s: float
    system: Periodic
    breaks: tuple[str, ...] = BREAKS  # inputs and outputs of these come first, in this order


def close_loop(plant: Plant, controller: Periodic) -> Loop:
    """Plant and controller, connected."""
    n, inputs = len(plant.a), 2 + 2 + NOISES
    a: list[Matrix] = []
    b: list[Matrix] = []
    c: list[Matrix] = []
    d: list[Matrix] = []
    for ka, kb, kc, kd in zip(*controller, strict=True):
        m = len(ka)
        truth_b, rest_b = kb[:, :TRUTH], kb[:, TRUTH:]
        truth_d, rest_d = kd[:, :TRUTH], kd[:, TRUTH:]
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
        out = np.zeros((2 + TRUTH, n + m))
        out[:2, :n], out[:2, n:] = truth_d @ plant.c, kc
        out[2:, :n] = plant.c
        through = np.zeros((2 + TRUTH, inputs))
        through[:2, others] = rest_d
        a.append(full)
        b.append(into)
        c.append(out)
        d.append(through)
    return Loop(1.0 / plant.condition.step_hz, without_idle(Periodic(a, b, c, d)))


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
        fraction = imag[k] / (imag[k] - imag[k + 1])
        where = real[k] + fraction * (real[k + 1] - real[k])
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
        fraction = size[k] / (size[k] - size[k + 1])
        there = open_loop[k] * (open_loop[k + 1] / open_loop[k]) ** fraction
        angle = float(np.angle(-there))  # from -1; positive: what lag would use up
        phase = min(phase, abs(np.degrees(angle)))
        lag = angle if angle > 0.0 else angle + 2.0 * pi
        delay = min(delay, lag / float(radps[k] ** (1.0 - fraction) * radps[k + 1] ** fraction))
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
    scale = np.zeros(2 + 2 + NOISES)
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
    total = np.zeros(2 + TRUTH)
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

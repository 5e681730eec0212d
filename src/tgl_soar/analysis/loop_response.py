"""The open loop as a flight shows it: from a multisine on the pitch setpoint, with confidence.

The soaring law's setpoint b becomes a = b + r, r the multisine (`control.excitation`).  The loop is
broken **at the pitch setpoint**: it goes from there through the pitch loop, the aircraft, e_rho,
the estimator and the soaring law back to b.  With R, A, B the parts of r, a, b at one tone,

    S = A / R = 1 / (1 + L)        sensitivity there
    L = −B / A = 1 / S − 1         open loop, of negative feedback

The same flight shows the loop broken **at the elevator**, the plant's input, around both loops:
with the pitch law's path from setpoint to elevator F = kp + ki dt / (1 − z^-1), z = e^{jω dt},
which is known, and the command u,

    S = U / (F R)

Turbulence moves a as well, and comes back through b: B / A alone would take a part of it for the
loop, towards −1.  It knows nothing of r: the cross-spectra are taken with r, over whole periods of
the multisine, in each of which R, A and U are fitted to the ticks by least squares beside a mean
and a trend (ticks need not be even).  With n periods,

    S   = sum(A R*) / sum|R|²
    s²  = sum|A − S R|² / (n − 1),   |error of S|² / (s² / sum|R|²)  ~  F(2, 2 (n − 1))

(Pintelon, Schoukens: System Identification, 2nd ed., ch. 2.)  The disc of S maps to a disc of L.
Between the tones ln|L| and phase are interpolated over ln ω; margins have the middle 95 % of what
`DRAWS` draws of S from its distribution give.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, pi
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import Series
from tgl_soar.control.excitation import LEAD_S, PERIODS, RUNNING, TONES, WINDOW_S

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

AT_SETPOINT: Final = "pitch setpoint"
AT_ELEVATOR: Final = "elevator"
TONES_RADPS: Final[Floats] = 2.0 * pi * np.array(TONES) / WINDOW_S
PERIOD_S: Final = WINDOW_S / PERIODS
CONFIDENCE: Final = 0.95
DRAWS: Final = 400
LEAST_PERIODS: Final = 2  # one alone says nothing of its own uncertainty
MISSING_MAX: Final = 0.02  # of a period's ticks: beyond it the log has a gap there
_GRID: Final = 200  # points between the first tone and the last


class Bounded(NamedTuple):
    """A number and the interval that holds it with `CONFIDENCE`; NaN: no such crossing between the
    first tone and the last."""

    value: float
    low: float
    high: float


class FlownMargins(NamedTuple):
    """What the interpolated loop says."""

    gain_db: Bounded  # until it rings: where the phase crosses −180°
    phase_deg: Bounded  # where the gain crosses 1
    alpha: Bounded  # disk margin: 1 / max|S − 1/2|


class LoopResponse(NamedTuple):
    """The loop broken at one place.  Arrays have the shape of `TONES_RADPS`."""

    at: str
    sensitivity: Complex
    variance: Floats  # of it, complex: of both parts together
    coherence: Floats  # of response and multisine, 0 … 1
    periods: int
    margins: FlownMargins

    @property
    def open_loop(self) -> Complex:
        """L at the tones."""
        return opened(self.sensitivity)

    @property
    def radius(self) -> Floats:
        """Of the disc about S that holds it with `CONFIDENCE`."""
        from scipy.stats import f

        quantile = f.ppf(CONFIDENCE, 2, 2 * (self.periods - 1))
        return np.asarray(np.sqrt(quantile * self.variance))


def opened(sensitivity: Complex) -> Complex:
    """L of S."""
    return np.asarray(1.0 / sensitivity - 1.0)


def open_loop_discs(response: LoopResponse) -> tuple[Complex, Floats]:
    """Centres and radii of the discs that hold L; NaN where S may be 0."""
    s, radius = response.sensitivity, response.radius
    power = np.abs(s) ** 2 - radius**2
    inside = np.where(power > 0.0, power, np.inf)
    unknown = np.where(power > 0.0, 0.0, np.nan)
    return np.asarray(np.conj(s) / inside - 1.0 + unknown), radius / inside + unknown


# --- from the log ------------------------------------------------------------------------------


def loop_responses(excitation: Series) -> list[LoopResponse]:
    """The loop at both breaks, from all multisines of a flight; at the elevator only where our own
    loop moves it.  Empty: there are not enough whole periods."""
    periods = [period for run in _runs(excitation) for period in _periods(excitation, *run)]
    if len(periods) < LEAST_PERIODS:
        return []
    injected = np.array([_tones(p.time_s, p["injected_rad"]) for p in periods])
    setpoint = np.array([_tones(p.time_s, p["setpoint_rad"]) for p in periods])
    found = [_response(AT_SETPOINT, injected, setpoint)]
    paths = [_elevator_path(p) for p in periods]
    if all(np.isfinite(path).all() for path in paths):
        elevator = np.array([_tones(p.time_s, p["elevator"]) for p in periods])
        found.append(_response(AT_ELEVATOR, injected * np.array(paths), elevator))
    return found


def _runs(excitation: Series) -> list[tuple[float, float]]:
    """When each multisine began, and its last tick [s]."""
    runs = excitation["standing"] == RUNNING
    edges = np.flatnonzero(np.diff(np.concatenate([[False], runs, [False]]).astype(int)))
    times = excitation.time_s
    return [
        (float(times[i]), float(times[j - 1])) for i, j in zip(edges[::2], edges[1::2], strict=True)
    ]


def _periods(excitation: Series, begun_s: float, last_s: float) -> list[Series]:
    """The whole periods of one multisine, also of one that was stopped."""
    step = float(np.median(np.diff(excitation.time_s)))
    found = []
    for k in range(PERIODS):
        begin = begun_s + LEAD_S + k * PERIOD_S
        # Half a tick less: a period's last tick is not the next one's first.
        period = excitation.within(begin - 0.5 * step, begin + PERIOD_S - 0.5 * step)
        known = all(np.isfinite(period[name]).all() for name in ("injected_rad", "setpoint_rad"))
        whole = begin + PERIOD_S <= last_s + step
        if whole and known and len(period) >= (1.0 - MISSING_MAX) * PERIOD_S / step:
            shifted = period.time_s - begin
            found.append(Series(shifted, period.columns, period.source))
    return found


def _tones(time_s: Floats, values: Floats) -> Complex:
    """The complex amplitude of each tone, beside a mean and a trend."""
    angles = np.outer(time_s, TONES_RADPS)
    columns = [np.cos(angles), -np.sin(angles), np.ones((len(time_s), 1)), time_s[:, None]]
    fitted, *_ = np.linalg.lstsq(np.hstack(columns), values, rcond=None)
    n = len(TONES_RADPS)
    return np.asarray(fitted[:n] + 1j * fitted[n : 2 * n])


def _elevator_path(period: Series) -> Complex:
    """F at the tones, by the gains that the law's own terms show; NaN where it does not act."""
    error = period["setpoint_rad"] - period["pitch_rad"]
    step = np.diff(period.time_s)
    grown = np.diff(period["elevator_i"])
    added = error[1:] * step
    power = float(error @ error)
    if not (isfinite(power) and power > 0.0):
        return np.full(len(TONES_RADPS), np.nan, dtype=np.complex128)
    kp = float(period["elevator_p"] @ error) / power
    ki = float(grown @ added) / float(added @ added)
    dt = float(np.median(step))
    delayed = np.exp(-1j * TONES_RADPS * dt)
    path = kp + ki * dt / (1.0 - delayed)
    return np.asarray(path if kp > 0.0 else np.full(len(path), np.nan, dtype=np.complex128))


def _response(at: str, reference: Complex, answer: Complex) -> LoopResponse:
    """S from a reference and what became of it, each of shape (periods, tones)."""
    n = len(reference)
    power = np.sum(np.abs(reference) ** 2, axis=0)
    cross = np.sum(answer * np.conj(reference), axis=0)
    s = cross / power
    left = np.sum(np.abs(answer - s * reference) ** 2, axis=0) / (n - 1)
    variance = left / power
    coherence = np.abs(cross) ** 2 / (power * np.sum(np.abs(answer) ** 2, axis=0))
    return LoopResponse(
        at=at,
        sensitivity=s,
        variance=variance,
        coherence=coherence,
        periods=n,
        margins=_margins(s, variance, n),
    )


# --- margins -----------------------------------------------------------------------------------


def interpolated(open_loop: Complex) -> tuple[Floats, Complex]:
    """L between the tones: frequencies [rad/s] and values."""
    from scipy.interpolate import PchipInterpolator

    x = np.log(TONES_RADPS)
    grid = np.linspace(x[0], x[-1], _GRID)
    size = PchipInterpolator(x, np.log(np.abs(open_loop)))(grid)
    phase = PchipInterpolator(x, np.unwrap(np.angle(open_loop)))(grid)
    return np.exp(grid), np.exp(size + 1j * phase)


def margins_between_tones(sensitivity: Complex) -> tuple[float, float, float]:
    """Gain margin [dB], phase margin [deg] and disk margin; NaN where nothing crosses, and where
    the disk margin falls on beyond the tones."""
    _, loop = interpolated(opened(sensitivity))
    return _gain_margin_db(loop), _phase_margin_deg(loop), _disk_margin(loop)


def _disk_margin(loop: Complex) -> float:
    """The least between the tones; at the last or first of them it may be less further on."""
    distance = np.abs(1.0 / (1.0 + loop) - 0.5)
    least = int(np.argmax(distance))
    return float(1.0 / distance[least]) if 0 < least < len(distance) - 1 else float("nan")


def _gain_margin_db(loop: Complex) -> float:
    """The least gain that brings a crossing of the negative real axis to −1."""
    real, imag = loop.real, loop.imag
    found = []
    for k in np.flatnonzero((imag[:-1] * imag[1:] < 0.0) & (real[:-1] < 0.0)):
        weight = imag[k] / (imag[k] - imag[k + 1])
        there = real[k] + weight * (real[k + 1] - real[k])
        found.append(-20.0 * np.log10(-there))
    above = [gain for gain in found if gain >= 0.0]
    return float(min(above)) if above else float("nan")


def _phase_margin_deg(loop: Complex) -> float:
    """The least phase to −1 where the gain crosses 1."""
    size = np.log(np.abs(loop))
    found = []
    for k in np.flatnonzero(size[:-1] * size[1:] < 0.0):
        weight = size[k] / (size[k] - size[k + 1])
        there = loop[k] * (loop[k + 1] / loop[k]) ** weight
        found.append(abs(float(np.degrees(np.angle(-there)))))
    return min(found) if found else float("nan")


def _margins(s: Complex, variance: Floats, periods: int) -> FlownMargins:
    """Each margin with what its uncertainty leaves."""
    draws = np.random.default_rng(0)  # the same log, the same page
    freedom = 2 * (periods - 1)
    rows = []
    for _ in range(DRAWS):
        normal = draws.standard_normal(len(s)) + 1j * draws.standard_normal(len(s))
        scale = np.sqrt(freedom / draws.chisquare(freedom, len(s)))
        rows.append(margins_between_tones(s + np.sqrt(0.5 * variance) * scale * normal))
    found = margins_between_tones(s)
    return FlownMargins(
        *(_bounded(v, c) for v, c in zip(found, zip(*rows, strict=True), strict=True))
    )


def _bounded(value: float, drawn: Sequence[float]) -> Bounded:
    known = np.array([v for v in drawn if isfinite(v)])
    if not isfinite(value) or len(known) < 0.5 * DRAWS:
        return Bounded(value, float("nan"), float("nan"))
    low, high = np.quantile(known, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE])
    return Bounded(value, float(low), float(high))

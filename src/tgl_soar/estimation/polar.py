"""The glide polar from gliding flight: the paper's third-order regression.

    sink(u) = c0 + c1 u + c2 u² + c3 u³            least squares over the glides (u_i, sink_i)

u     m/s  horizontal airspeed          sink  m/s  positive down, in air at rest
θ     rad  pitch: one discrete attitude is one glide

With n glides, X the matrix of powers of u and e the residuals, s² = eᵀe / (n − 4), the
coefficients have the covariance s² (XᵀX)⁻¹ and the fitted sink at u the standard error
s √(xᵀ (XᵀX)⁻¹ x), x = (1, u, u², u³). That times t(n − 4) holds what noise does to a cubic.
But the polar of a wing near its stall is none: what a fourth power would change at u is taken as
an error of its own.  So is what every glide of a test may share: a sideslip of three degrees, from
a bank or heading that is believed wrongly, adds C_Dβ sin² β = 0.3 · 0.0027 to a C_D of 0.09, one
per cent of sink (`SHARED`), and no log of positions and attitudes shows it.  The confidence band is
the root of the sum of the three squares.
The powers are taken of (u − centre) / scale inside, which keeps the normal matrix well
conditioned; the polar itself is in u.

A log gives glides through `glides_from_log`. While the speed V along the path changes, the
vertical speed is no sink; the energy height h + V² / 2g falls at the sink that a steady glide
would have, so

    sink = − (dh/dt + (V / g) dV/dt)

With a brake the polar is one of a family.  Its drag adds, at the lift that carries the weight,

    sink(u, b) = sink(u) + k b u³            k = ρ S C_Db / 2 m g, b the brake, 0 … 1

so that glides at several positions of it give k beside the cubic, all by one least squares.

A polar is refused rather than guessed: too few speeds, no minimum of sink, sink that is not
positive. Outside its range it is not a number (`types.polar_sink`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from math import hypot, isfinite, nan, sqrt
from typing import TYPE_CHECKING, Final, NamedTuple

from tgl_soar.types import GRAVITY_MPS2, GlidePolar, polar_sink, polar_slope

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# A cubic has four coefficients; two more speeds show whether it is the right curve.
FEWEST_SPEEDS: Final = 6
# Speeds nearer to each other than this are one attitude flown twice.
SAME_SPEED_MPS: Final = 0.1
# The slowest and fastest glide: nearer to each other, the curvature is noise.
NARROWEST_SPAN: Final = 1.15
# Glides are of one position of the brake as long as that stays within a fiftieth; a family needs
# the sink of a quarter of it, some 0.08 m/s, to be distinguished from noise.
BRAKE_SLACK: Final = 0.02
BRAKE_SPAN: Final = 0.25

SHARED: Final = 0.01  # of sink: an error that all glides of a test have alike

_Band = tuple[tuple[float, float, float, float], ...]


class PolarFit(NamedTuple):
    """A fitted polar, and how certain it is."""

    polar: GlidePolar
    residuals_mps: tuple[float, ...]  # measured − fitted sink, in the order of the glides
    residual_rms_mps: float  # s: over the degrees of freedom, not over the glides
    residual_max_mps: float
    standard_errors: tuple[float, float, float, float]  # of c0 … c3
    degrees_of_freedom: int
    speeds: int  # distinct ones
    min_sink_speed_mps: float
    min_sink_mps: float
    best_glide_speed_mps: float  # NaN where it lies outside the range
    best_glide_ratio: float  # horizontal speed / sink there
    centre_mps: float  # of the scaled speed (u − centre) / scale
    scale_mps: float
    covariance: _Band  # 4 × 4, of the coefficients in powers of the scaled speed
    left_out: tuple[float, ...]  # fourth order − third: a polynomial in the scaled speed [m/s]


class PolarFamilyFit(NamedTuple):
    """A fitted family of polars."""

    fit: PolarFit  # with the brake retracted; residuals are those of all glides
    brake_sink: float  # k [s²/m²]
    brake_sink_error: float  # its standard error


class GlideStretch(NamedTuple):
    """One stretch of steady gliding."""

    pitch_rad: float
    speed_mps: float  # horizontal, through the air
    sink_mps: float
    duration_s: float
    brake: float = 0.0  # 0 … 1


def fit_polar(
    speed_mps: Sequence[float], sink_mps: Sequence[float], *, to_the_slowest: bool = False
) -> PolarFit:
    """The third-order polar of a table of glides: speeds and sinks [m/s], one each per glide.

    Valid from the slowest to the fastest glide.  to_the_slowest: the slowest is known to be that of
    the aircraft, so that the least sink may be there.
    Errors: ValueError saying what is wrong with the table and what would help.
    """
    import numpy as np

    speed, sink = _checked(speed_mps, sink_mps)
    distinct = _distinct(speed)
    if distinct < FEWEST_SPEEDS:
        raise ValueError(
            f"polar: {distinct} distinct speeds ({SAME_SPEED_MPS} m/s apart) from {len(speed)}"
            f" glides; a cubic needs at least {FEWEST_SPEEDS}: glide at more pitch attitudes"
        )
    slowest, fastest = float(speed.min()), float(speed.max())
    if fastest < NARROWEST_SPAN * slowest:
        raise ValueError(
            f"polar: all speeds lie between {slowest:.2f} and {fastest:.2f} m/s; the fastest must"
            f" be at least {NARROWEST_SPAN} times the slowest: glide at steeper pitch too"
        )
    centre, scale = 0.5 * (slowest + fastest), 0.5 * (fastest - slowest)
    powers = np.vander((speed - centre) / scale, 4, increasing=True)
    scaled, *_ = np.linalg.lstsq(powers, sink, rcond=None)
    residuals = sink - powers @ scaled
    freedom = len(speed) - 4
    variance = float(residuals @ residuals) / freedom
    covariance = variance * np.linalg.inv(powers.T @ powers)

    # The fourth power's own part, at right angles to the others: its coefficient adds alone.
    fourth = ((speed - centre) / scale) ** 4
    shared, *_ = np.linalg.lstsq(powers, fourth, rcond=None)
    own = fourth - powers @ shared
    left_out = float(own @ sink) / float(own @ own) * np.array([*-shared, 1.0])

    # (u − centre)^k / scale^k written out in powers of u
    turn = np.array(
        [
            [1.0, -centre / scale, (centre / scale) ** 2, -((centre / scale) ** 3)],
            [0.0, 1.0 / scale, -2.0 * centre / scale**2, 3.0 * centre**2 / scale**3],
            [0.0, 0.0, 1.0 / scale**2, -3.0 * centre / scale**3],
            [0.0, 0.0, 0.0, 1.0 / scale**3],
        ]
    )
    c0, c1, c2, c3 = (float(c) for c in turn @ scaled)
    errors = np.sqrt(np.diag(turn @ covariance @ turn.T))
    polar = GlidePolar(c0=c0, c1=c1, c2=c2, c3=c3, speed_min_mps=slowest, speed_max_mps=fastest)
    at_the_end = to_the_slowest and polar_slope(polar, slowest) >= 0.0
    min_speed = slowest if at_the_end else _minimum(polar)
    best_speed = best_glide_speed(polar)
    return PolarFit(
        polar=polar,
        residuals_mps=tuple(float(e) for e in residuals),
        residual_rms_mps=sqrt(variance),
        residual_max_mps=float(np.max(np.abs(residuals))),
        standard_errors=(float(errors[0]), float(errors[1]), float(errors[2]), float(errors[3])),
        degrees_of_freedom=freedom,
        speeds=distinct,
        min_sink_speed_mps=min_speed,
        min_sink_mps=polar_sink(polar, min_speed),
        best_glide_speed_mps=best_speed,
        best_glide_ratio=best_speed / polar_sink(polar, best_speed),
        centre_mps=centre,
        scale_mps=scale,
        covariance=tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in covariance),
        left_out=tuple(float(c) for c in left_out),
    )


def fit_polar_family(
    speed_mps: Sequence[float], sink_mps: Sequence[float], brake: Sequence[float]
) -> PolarFamilyFit:
    """The family of polars of a table of glides, each with its brake (0 retracted, 1 all of it).

    The shape of the cubic comes from all glides together.  Errors: ValueError, as `fit_polar`; for
    a brake that is not within 0 … 1, or that hardly moved.
    """
    import numpy as np

    speed, sink = _checked(speed_mps, sink_mps)
    out = np.asarray(brake, dtype=np.float64)
    if out.shape != speed.shape:
        raise ValueError(f"polar: {len(speed)} glides and {len(out)} brakes: one each")
    for row, b in enumerate(out.tolist()):
        if not -BRAKE_SLACK <= b <= 1.0 + BRAKE_SLACK:
            raise ValueError(f"polar: glide {row} has brake {b}: must be from 0 to 1")
    if np.ptp(out) < BRAKE_SPAN:
        raise ValueError(
            f"polar: the brake stays within {out.min():.2f} and {out.max():.2f}; glide with it"
            f" retracted and further out, {BRAKE_SPAN} apart at least"
        )
    middle, half = 0.5 * float(speed.max() + speed.min()), 0.5 * float(np.ptp(speed)) or 1.0
    powers = np.vander((speed - middle) / half, 4, increasing=True)
    known = np.column_stack([powers, out * speed**3])
    found, *_ = np.linalg.lstsq(known, sink, rcond=None)
    k = float(found[4])
    if k <= 0.0:
        raise ValueError(
            f"polar: with the brake out it sinks less ({k:.2g} u³): are its ends exchanged?"
        )
    left = sink - known @ found
    freedom = len(speed) - 5
    if freedom < 1:
        raise ValueError(f"polar: {len(speed)} glides are too few for a family: fly six or more")
    variance = float(left @ left) / freedom * float(np.linalg.pinv(known.T @ known)[4, 4])
    clean = sink - k * out * speed**3
    return PolarFamilyFit(fit_polar(speed.tolist(), clean.tolist()), k, sqrt(variance))


def sink_standard_error(fit: PolarFit, speed_mps: float) -> float:
    """Standard error of the fitted sink [m/s] at a speed [m/s]; NaN outside the polar's range."""
    if not fit.polar.speed_min_mps <= speed_mps <= fit.polar.speed_max_mps:
        return nan
    s = (speed_mps - fit.centre_mps) / fit.scale_mps
    powers = (1.0, s, s * s, s * s * s)
    total = 0.0
    for row, a in zip(fit.covariance, powers, strict=True):
        total += a * sum(c * b for c, b in zip(row, powers, strict=True))
    return sqrt(max(0.0, total))


def sink_band(fit: PolarFit, speed_mps: float, confidence: float = 0.95) -> tuple[float, float]:
    """Lower and upper sink [m/s] that hold the true curve at a speed [m/s] with a confidence.

    (NaN, NaN) outside the polar's range. Errors: ValueError for a confidence not within 0 … 1.
    """
    noise = student_t(confidence, fit.degrees_of_freedom) * sink_standard_error(fit, speed_mps)
    s = (speed_mps - fit.centre_mps) / fit.scale_mps
    middle = polar_sink(fit.polar, speed_mps)
    beyond = sum(c * s**k for k, c in enumerate(fit.left_out))
    half = hypot(noise, beyond, SHARED * middle)
    return middle - half, middle + half


@lru_cache(maxsize=64)
def student_t(confidence: float, degrees_of_freedom: int) -> float:
    """The t with P(|T| <= t) = confidence, to about 1e-4 of itself up to a confidence of 0.999.

    With t = √ν tan φ the two-sided probability is ∫₀^φ cos^(ν−1) / ∫₀^(π/2) cos^(ν−1).
    Errors: ValueError for a confidence not within 0 … 1 or no degree of freedom.
    """
    import numpy as np

    if not 0.0 < confidence < 1.0 or degrees_of_freedom < 1:
        raise ValueError(
            f"confidence {confidence} with {degrees_of_freedom} degrees of freedom: needs a"
            " number between 0 and 1, and at least 1"
        )
    phi = np.linspace(0.0, 0.5 * np.pi, 100_001)
    density = np.cos(phi) ** (degrees_of_freedom - 1)
    density[-1] = 1.0 if degrees_of_freedom == 1 else 0.0
    cumulated = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))))
    angle = np.interp(confidence, cumulated / cumulated[-1], phi)
    return float(np.sqrt(degrees_of_freedom) * np.tan(angle))


def glides_from_log(
    time_s: Sequence[float],
    pitch_rad: Sequence[float],
    speed_mps: Sequence[float],
    climb_mps: Sequence[float],
    brake: Sequence[float] | None = None,
    *,
    window_s: float = 2.0,
    pitch_spread_rad: float = 0.01,
    speed_change_mps2: float = 0.2,
    climb_change_mps2: float = 0.02,
) -> tuple[GlideStretch, ...]:
    """Steady glides in a log of still air: time, pitch, horizontal airspeed and climb (up > 0).

    The log is cut into windows of `window_s`. A window counts where rows cover it, pitch keeps
    within `pitch_spread_rad` (standard deviation), the speed along the path changes by less
    than `speed_change_mps2` (what it still changes is taken out by the energy height), and climb
    by less than `climb_change_mps2`: a path that curves carries another lift than the weight,
    and one per cent of lift is one or two of sink.  With a brake it counts where that stands.
    Errors: ValueError for columns of unequal length, values that are not finite, time that
    does not increase, or no steady window at all.
    """
    import numpy as np

    columns = {
        "time_s": time_s,
        "pitch_rad": pitch_rad,
        "speed_mps": speed_mps,
        "climb_mps": climb_mps,
        "brake": [0.0] * len(time_s) if brake is None else brake,
    }
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    for name, values in arrays.items():
        if values.shape != arrays["time_s"].shape or values.ndim != 1:
            raise ValueError(f"log: {name} has shape {values.shape}, time_s another: one row each")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise ValueError(f"log: {name}[{bad[0]}] = {values[bad[0]]}: not finite; leave it out")
    time, pitch = arrays["time_s"], arrays["pitch_rad"]
    speed, climb, out = arrays["speed_mps"], arrays["climb_mps"], arrays["brake"]
    _check_windows(time, window_s)

    path = np.hypot(speed, climb)
    glides = []
    window = np.floor((time - time[0]) / window_s).astype(np.int64)
    for number in range(int(window[-1]) + 1):
        rows = np.flatnonzero(window == number)
        span_s = float(time[rows[-1]] - time[rows[0]]) if rows.size else 0.0
        if rows.size < 5 or span_s < 0.8 * window_s:
            continue
        if np.max(np.diff(time[rows])) > 0.25 * window_s:
            continue  # what happened in the gap is not known
        t = time[rows] - time[rows].mean()
        change = float(t @ path[rows] / (t @ t))  # slope of V over the window
        curving = float(t @ climb[rows] / (t @ t))
        if (
            np.std(pitch[rows]) > pitch_spread_rad
            or abs(change) > speed_change_mps2
            or abs(curving) > climb_change_mps2
            or np.ptp(out[rows]) > BRAKE_SLACK
        ):
            continue
        mean_path = float(path[rows].mean())
        glides.append(
            GlideStretch(
                pitch_rad=float(pitch[rows].mean()),
                speed_mps=float(speed[rows].mean()),
                sink_mps=float(-climb[rows].mean()) - mean_path * change / GRAVITY_MPS2,
                duration_s=span_s,
                brake=float(out[rows].mean()),
            )
        )
    if not glides:
        raise ValueError(
            f"log: none of {int(window[-1]) + 1} windows of {window_s} s is a steady glide (pitch"
            f" within {pitch_spread_rad} rad, speed changing below {speed_change_mps2} m/s², climb"
            f" below {climb_change_mps2} m/s²): hold each pitch longer"
        )
    return tuple(glides)


def _check_windows(time: NDArray[np.float64], window_s: float) -> None:
    """Errors: ValueError for time that does not increase, or no window."""
    if time.size < 2 or any(b <= a for a, b in pairwise(time.tolist())):
        raise ValueError("log: time_s must increase from row to row, over at least two rows")
    if not 0.0 < window_s < 1e4:
        raise ValueError(f"window_s = {window_s}: must be positive")


def _checked(
    speed_mps: Sequence[float], sink_mps: Sequence[float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The table as arrays. Errors: ValueError for anything that is no glide."""
    import numpy as np

    if len(speed_mps) != len(sink_mps):
        raise ValueError(f"polar: {len(speed_mps)} speeds and {len(sink_mps)} sinks: one each")
    for row, (u, s) in enumerate(zip(speed_mps, sink_mps, strict=True)):
        if not (isfinite(u) and isfinite(s)):
            raise ValueError(f"polar: glide {row} is ({u}, {s}): not finite; leave it out")
        if not 0.0 < u < 100.0:
            raise ValueError(f"polar: glide {row} has speed {u} m/s: must be from 0 to 100 m/s")
        if s <= 0.0:
            raise ValueError(
                f"polar: glide {row} has sink {s} m/s: sink is positive down, and every glide in"
                " still air sinks; turn the sign, or leave out flight in rising air"
            )
        if s >= u:
            raise ValueError(
                f"polar: glide {row} sinks {s} m/s at {u} m/s: steeper than 45 degrees is no"
                " glide; are the columns swapped?"
            )
    return np.asarray(speed_mps, dtype=np.float64), np.asarray(sink_mps, dtype=np.float64)


def _distinct(speed: NDArray[np.float64]) -> int:
    """Speeds that are at least `SAME_SPEED_MPS` apart."""
    count, last = 0, float("-inf")
    for u in sorted(float(u) for u in speed):
        if u - last >= SAME_SPEED_MPS - 1e-9:
            count, last = count + 1, u
    return count


def _minimum(polar: GlidePolar) -> float:
    """The speed of least sink [m/s]. Errors: ValueError where the range holds no minimum."""
    low, high = polar.speed_min_mps, polar.speed_max_mps
    between = f"between {low:.2f} and {high:.2f} m/s"
    if polar_slope(polar, low) >= 0.0:
        raise ValueError(
            f"polar: no minimum of sink {between}: it grows from the slowest glide on; add"
            " slower glides, nearer to the stall"
        )
    if polar_slope(polar, high) <= 0.0:
        raise ValueError(
            f"polar: no minimum of sink {between}: it still falls at the fastest glide; add"
            " faster ones, or look for wrong rows"
        )
    # a quadratic with a sign change between the ends has exactly one root there
    for _ in range(80):
        middle = 0.5 * (low + high)
        if polar_slope(polar, middle) < 0.0:
            low = middle
        else:
            high = middle
    least = polar_sink(polar, 0.5 * (low + high))
    if least <= 0.0:
        raise ValueError(
            f"polar: the cubic sinks {least:.3f} m/s at {low:.2f} m/s, less than nothing: the"
            " glides do not cover that speed, or rows are wrong"
        )
    return 0.5 * (low + high)


def best_glide_speed(polar: GlidePolar) -> float:
    """The speed of the best glide [m/s], where sink = u d sink/du; NaN outside the range."""
    low, high = polar.speed_min_mps, polar.speed_max_mps

    def excess(u: float) -> float:
        return u * polar_slope(polar, u) - polar_sink(polar, u)

    if excess(low) >= 0.0 or excess(high) <= 0.0:
        return nan
    for _ in range(80):
        middle = 0.5 * (low + high)
        if excess(middle) < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)

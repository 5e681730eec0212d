"""The soaring law's gains at another lean than the one that they were found at.

Above the short period's slow end, with lean l and airspeed V, pitch moves e_rho by

    e_rho / theta = -(g cos l + V s sin l) / s²

so that the outer loop, kp + kd s times that, is to the highest order of each frequency

    w_c = kp V sin l + kd g cos l      its crossover: the loop is w_c / s there
    h   = kd V sin l                   its gain beyond the crossover, down to which it falls
    k0  = kp g cos l                   its stiffness, w² at low frequencies

The same kp and kd that cross at 7 rad/s on a line leaning 15 degrees cross at 14 rad/s on one
leaning 40, where the pitch loop no longer follows, and never fall below 1.  At another lean,
therefore, w_c stays what it is at the lean that the gains were found at, together with

    h    on lines that lean further:   kd = h / (V sin l),      kp = (w_c - kd g cos l) / (V sin l)
    k0   on lines that lean less:      kp = k0 / (g cos l),     kd = (w_c - kp V sin l) / (g cos l)

and ki in its ratio to kp.  Both give the gains as they were found where the lean is the one of the
finding, so that they are continuous in the lean; a line turns slowly (TGL_ROT_SLEW), and integrals
are in the unit of the output whatever the gain: nothing steps.  On a line that leans downwind the
gains are those of an upright one: what such a line lacks no gain can give.

No number of this is tuned: what was found at one lean is kept at the others.
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import Final, NamedTuple

from tgl_soar.control.pid import PidGains
from tgl_soar.control.soaring import SoaringGains

GRAVITY_MPS2: Final = 9.80665
SPEED_MIN_MPS: Final = 1.0  # nothing that soars was found to fly slower
LEAN_MAX_RAD: Final = pi / 3.0  # of a line that can be set


class FoundAt(NamedTuple):
    """Where the soaring law's gains were found."""

    eta_rad: float  # the line's inclination from the downstream axis, leaning upwind
    airspeed_mps: float  # below SPEED_MIN_MPS: the gains are flown as they are, on every line


def gains_at_lean(gains: SoaringGains, found_at: FoundAt, eta_rad: float) -> SoaringGains:
    """The gains for a line of this inclination."""
    if eta_rad == found_at.eta_rad or not found_at.airspeed_mps >= SPEED_MIN_MPS:
        return gains
    lean = min(LEAN_MAX_RAD, max(0.0, eta_rad - 0.5 * pi))
    found_lean = found_at.eta_rad - 0.5 * pi
    drift_found, rise_found = _effects(found_lean, found_at.airspeed_mps)
    drift, rise = _effects(lean, found_at.airspeed_mps)
    pid = gains.pid
    crossover = pid.kp * rise_found + pid.kd * drift_found
    if rise > rise_found:
        kd = pid.kd * rise_found / rise
        kp = (crossover - kd * drift) / rise
    else:
        kp = pid.kp * drift_found / drift
        kd = (crossover - kp * rise) / drift
    ki = pid.ki * kp / pid.kp if pid.kp > 0.0 else pid.ki
    return SoaringGains(
        PidGains(
            kp=kp,
            ki=ki,
            kd=kd,
            rate_filter_radps=pid.rate_filter_radps,
            integral_max=pid.integral_max,
            output_min=pid.output_min,
            output_max=pid.output_max,
        ),
        gains.slew_radps,
    )


def _effects(lean_rad: float, airspeed_mps: float) -> tuple[float, float]:
    """Of the pitch on e_rho: g cos l [m/s²] by drifting, V sin l [m/s] by rising."""
    return GRAVITY_MPS2 * cos(lean_rad), airspeed_mps * sin(lean_rad)

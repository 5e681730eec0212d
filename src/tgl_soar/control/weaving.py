"""The weave: how far off the wind the nose goes, so that as much of the airspeed is kept upwind.

From side to side, b to either side of the way, the nose off the wind by chi on the straight legs
and turning through the wind between them.  Each way from side to side has a turn from one side of
the wind to the other, at omega, and a leg of t_l:

    m(chi) = (2 sin chi / omega + t_l cos chi) / (2 chi / omega + t_l)
    t_l V sin chi = 2 b − 2 V (1 − cos chi) / omega

is what of V is kept upwind on average, less the farther off the nose is and the wider the weave.
`control.landing` says how much may be kept.
"""

from __future__ import annotations

from math import acos, cos, sin
from typing import Final

# omega, of the setpoint.  The nose follows slower, with 10 degrees of bank and the rudder at 0.3 in
# the first turns: what they go upwind beyond m(chi) is planned for as it comes (docs/theory.md).
WEAVE_RADPS: Final = 1.0
WEAVE_MIN_RAD: Final = 0.15  # 1 %: not worth turning for
HALVINGS: Final = 8  # of chi: to a third of a degree


def mean_cosine(angle_rad: float, half_width_m: float, speed_mps: float) -> float:
    """m(chi): what a weave keeps of its airspeed upwind; chi > 0."""
    turn_s = 2.0 * angle_rad / WEAVE_RADPS
    turn_m = 2.0 * speed_mps * (1.0 - cos(angle_rad)) / WEAVE_RADPS
    leg_s = max(0.0, 2.0 * half_width_m - turn_m) / (speed_mps * sin(angle_rad))
    upwind_s = 2.0 * sin(angle_rad) / WEAVE_RADPS + leg_s * cos(angle_rad)
    return upwind_s / (turn_s + leg_s)


def weave_angle(cosine: float, half_width_m: float, speed_mps: float, most_rad: float) -> float:
    """chi [rad], the least that keeps no more of the airspeed than a cosine, or the most there is:
    most_rad, or what turns without a leg between them make of the width."""
    narrowest = 1.0 - half_width_m * WEAVE_RADPS / speed_mps
    high = min(most_rad, acos(narrowest)) if narrowest > -1.0 else most_rad
    if not (cosine < 1.0 and high > WEAVE_MIN_RAD):  # false for NaN
        return 0.0
    low = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if mean_cosine(middle, half_width_m, speed_mps) > cosine:
            low = middle
        else:
            high = middle
    return high

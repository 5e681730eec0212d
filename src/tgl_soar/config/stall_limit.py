"""The largest angle of attack that may be flown, from the stall of the airframe file.

Lift stops growing about `stall_alpha_rad`; `stall_width_rad` beyond it the curve's slope is
1 / (1 + e), about a quarter of what it was (`estimation.aerodynamics.lift_drag`), while the drag
of the separated flow rises with nearly all of its own slope.  From there on a higher nose no
longer bends the path, it only sinks: that is the stall, on any airframe, and the limit.

    ALPHA_MAX = stall_alpha + stall_width
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees

from tgl_soar.config.parameters import INDEX, PARAMETERS


def stall_limit(model: Mapping[str, float]) -> dict[str, float]:
    """ALPHA_MAX [deg], within its range; nothing where `[model]` names no stall.

    A whole tenth of a degree: no stall is known better, and it is what an operator reads.
    """
    if not ("stall_alpha_rad" in model and "stall_width_rad" in model):
        return {}
    allowed = PARAMETERS[INDEX["ALPHA_MAX"]]
    limit = round(degrees(model["stall_alpha_rad"] + model["stall_width_rad"]), 1)
    return {"ALPHA_MAX": min(allowed.maximum, max(allowed.minimum, limit))}

"""The site file of a draft, in words that say what is measured and what is guessed."""

from __future__ import annotations

import json
from math import ceil
from pathlib import Path
from typing import Final

from tgl_soar.analysis.terrain.draft import LEAN_DEG, SiteDraft, farthest
from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.geometry import ned_from_soaring

GRID_FILE: Final = "air.npz"
VEER_ROOM_DEG: Final = 20.0  # how far a steady wind turns in an afternoon

_TEXT: Final = """\
# A first draft, by `tgl-soar site init` from {model}.
# Ground: a model of heights, metres off, and without the trees and masts that have grown or been
# built since. Wind and contour: A GUESS, potential flow over that ground, which knows no friction,
# no wake and no valley. Walk the place, look at map.png and plane.png, and correct this file.
#
# Origin of the soaring frame: the crest; x downstream and across the ridge, z up from there. The
# slope is {steepest:.0f} degrees at its steepest.
{landing}
[site]
name = {name}
origin_north_m = {north:.2f}
origin_east_m = {east:.2f}
origin_down_m = {down:.2f}
wind_from_deg = {wind_from:g}
ridge_deg = {ridge:g}

# The place that was named, at the model's height of its ground: put here what the autopilot
# reports when it stands there, or all heights are off by the difference.
[position]
sources = ["global_position"]
{home}

# A GUESS: potential flow over the profile across the ridge, as the simulation blows it.
[air]
kind = "grid"
file = "{grid}"
wind_mps = {wind:g}
zero_cells = "solid"

[start]
x_m = {start[0]}
z_m = {start[1]}

# The highest ground of the strip of FENCE_Y_MAX to either side: nowhere below the model's, and
# at most {above:.1f} m above it. CLEAR_MIN keeps the aircraft away from it.
[ground]
profile = [
{profile}
]

# On the guessed contour. They move with the wind of the day, and the contour with them.
[lines]
{lines}

# The fence is where no soaring is left and the pilot is to have the aircraft:
#   FENCE_X_MIN, FENCE_Z_MAX  where the updraft guessed falls below the least sink, or the ceiling
#   FENCE_X_MAX  the crest: behind it a real flow separates
#   FENCE_Y_MAX  as far to either side as the ground was looked at
#   FENCE_Z_MIN  half of CLEAR_MIN above the lowest ground before the slope
[parameters]
TGL_X = {a[0]}
TGL_Z = {a[1]}
TGL_LEAN = {lean:.1f}
TGL_STEP_MAX = {step:.1f}
WPT_X = {waypoint:.1f}
CLEAR_MIN = {clearance:.1f}
FENCE_X_MIN = {bounds[0]:.1f}
FENCE_X_MAX = {bounds[1]:.1f}
FENCE_Y_MAX = {half_width:.1f}
FENCE_Z_MIN = {bounds[2]:.1f}
FENCE_Z_MAX = {bounds[3]:.1f}
{veer}"""

_VEER: Final = """\
# The wind comes from {oblique:.0f} degrees to the {side} of straight at the ridge; the nose follows
# it there, and {room:.0f} degrees further as it turns.
VEER_MAX = {most:.0f}
"""

CONTOUR_WARNING: Final = """
# A GUESS, of the [air] above: where the ground's friction and the valley's wind have it, only a
# flight can say.
"""


def site_text(draft: SiteDraft, name: str) -> str:
    """All of a site file but its `[contour]`."""
    frame, home = draft.frame, draft.terrain.home
    first = draft.lines["a"]
    return _TEXT.format(
        model=Path(draft.terrain.elevation.name).name,
        steepest=draft.steepest_deg,
        ridge=draft.ridge_deg,
        landing=_landing(draft),
        name=json.dumps(name),
        north=frame.origin_north_m,
        east=frame.origin_east_m,
        down=frame.origin_down_m,
        wind_from=round(draft.wind_from_deg, 1),
        home=f"home = {{ latitude_deg = {home.latitude_deg:.7f}, longitude_deg ="
        f" {home.longitude_deg:.7f}, altitude_m = {home.altitude_m:.2f} }}",
        grid=GRID_FILE,
        wind=draft.wind_mps,
        start=first,
        above=draft.ground.above_m + 0.05,  # rounded up
        profile="\n".join(f"  [{x:.3f}, {z:.2f}]," for x, z in draft.ground.points),
        lines="\n".join(f"{n} = {{ x_m = {x}, z_m = {z} }}" for n, (x, z) in draft.lines.items()),
        a=first,
        lean=LEAN_DEG,
        step=max(2.0, ceil(farthest(draft.lines))),
        waypoint=max(-2000.0, 5.0 / 3.0 * draft.bounds[0]),  # as the shipped hill has it
        clearance=draft.clearance_m,
        bounds=draft.bounds,
        half_width=draft.half_width_m,
        veer=_veer(draft.oblique_deg),
    )


def _veer(oblique_deg: float) -> str:
    """What an oblique wind needs; "" for one that blows straight at the ridge."""
    if round(oblique_deg, 1) == 0.0:
        return ""
    oblique = abs(oblique_deg)
    most = min(PARAMETERS[INDEX["VEER_MAX"]].maximum, ceil(oblique) + VEER_ROOM_DEG)
    return _VEER.format(
        oblique=oblique,
        side="right" if oblique_deg > 0.0 else "left",
        room=most - oblique,
        most=most,
    )


def landing_place(draft: SiteDraft) -> tuple[float, float] | None:
    """Latitude and longitude [deg] of the landing place; None: there is none."""
    if draft.landing is None:
        return None
    north, east, _ = ned_from_soaring(draft.frame, draft.landing[0], 0.0, draft.landing[1])
    latitude, longitude = draft.terrain.place(north, east)
    return float(latitude), float(longitude)


def _landing(draft: SiteDraft) -> str:
    place = landing_place(draft)
    if draft.landing is None or place is None:
        return (
            "# No level place before the slope was found within the profile: find one, on foot.\n"
        )
    return (
        f"# Level before the slope, and to be looked at on foot: x = {draft.landing[0]:.0f} m,"
        f" z = {draft.landing[1]:.0f} m,\n# at {place[0]:.5f}, {place[1]:.5f}.\n"
    )

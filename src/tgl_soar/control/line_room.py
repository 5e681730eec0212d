"""How far an aircraft may slide along its line: down to the ground or the fence, and up to it.

Down the line its way ends where the clearance is the least that may be, or at the fence; up the
line at the fence.  Over a narrow ridge a line that leans much may pass into the ground and come out
again at its back: the first place that is too near the ground ends the way.
"""

from __future__ import annotations

from math import cos, sin
from typing import Final, NamedTuple

from tgl_soar.control.envelope import Fence, clearance
from tgl_soar.types import Ground

DEPTH_MIN_M: Final = 0.3  # no air is rougher than this, however near the ground
DEPTH_MAX_M: Final = 50.0  # where the ground is farther, or not known
HALVINGS: Final = 14  # of the search for the clearance: 50 m to 3 mm


class LineRoom(NamedTuple):
    """How far along the line the aircraft may go from where it is, and how deep the air is."""

    down_m: float  # 0 or more
    down_is_fence: bool
    up_m: float
    depth_m: float


def line_room(
    least_m: float, fence: Fence, ground: Ground, x_m: float, z_m: float, eta_rad: float
) -> LineRoom:
    """Of an aircraft at (x, z) on a line of this inclination.  least_m: of the clearance."""
    along_x, along_z = cos(eta_rad), max(0.1, sin(eta_rad))
    down, up = (z_m - fence.z_min_m) / along_z, (fence.z_max_m - z_m) / along_z
    if along_x < 0.0:  # up the line is upstream
        down = min(down, (fence.x_max_m - x_m) / -along_x)
        up = min(up, (x_m - fence.x_min_m) / -along_x)
    elif along_x > 0.0:
        down = min(down, (x_m - fence.x_min_m) / along_x)
        up = min(up, (fence.x_max_m - x_m) / along_x)
    down, up = max(0.0, down), max(0.0, up)
    far = min(down, DEPTH_MAX_M)
    by_fence = True
    if clearance(ground, x_m - far * along_x, z_m - far * along_z) < least_m:
        by_fence = False
        down = _way_to_ground(ground, x_m, z_m, along_x, along_z, far, least_m)
    # Below a ridge the line may come out again: the first corner that is too near bars it.
    for i in range(ground.points):
        way = (x_m - ground.x_m[i]) / along_x if along_x != 0.0 else 0.0
        if not 0.0 < way < min(down, DEPTH_MAX_M):
            continue
        if clearance(ground, ground.x_m[i], z_m - way * along_z) < least_m:
            by_fence = False
            down = _way_to_ground(ground, x_m, z_m, along_x, along_z, way, least_m)
    depth = max(DEPTH_MIN_M, min(DEPTH_MAX_M, down + least_m))
    return LineRoom(down_m=down, down_is_fence=by_fence, up_m=up, depth_m=depth)


def _way_to_ground(
    ground: Ground,
    x_m: float,
    z_m: float,
    along_x: float,
    along_z: float,
    far_m: float,
    least_m: float,
) -> float:
    """How far down the line the clearance is as much as that; at `far_m` it is less."""
    near, far = 0.0, far_m
    if clearance(ground, x_m, z_m) < least_m:
        far = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (near + far)
        if clearance(ground, x_m - middle * along_x, z_m - middle * along_z) < least_m:
            far = middle
        else:
            near = middle
    return near

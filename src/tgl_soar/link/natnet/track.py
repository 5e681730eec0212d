"""Whether one pose can have followed the last.

    frozen   bit for bit the last pose: cameras always have noise
    jumped   farther from the last than flight leads: another body's id, another origin, a ghost

After a jump no pose is accepted until the pose is back near the last good one, or has held its
new place for `SETTLE_S`: then it is where the body is, whatever has happened.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.types import NAN, isfinite

SETTLE_S: Final = 1.0
RETURN_S: Final = 0.2  # of flight: so far from the last good place it may be back
JUMP_M: Final = 0.05  # what noise and a re-solved body may move at once

GOOD: Final = 0
FROZEN: Final = 1
JUMPED: Final = 2
SETTLING: Final = 3


class PoseTrack:
    """One body's poses, one after another; times are those of the poses."""

    def __init__(self, max_speed_mps: float) -> None:
        self.jump_m = NAN  # how far the last jump was
        self._max_speed_mps = max_speed_mps
        self._last: RigidBody | None = None
        self._last_s = NAN
        self._good: RigidBody | None = None
        self._good_s = NAN
        self._settling_s = NAN  # since when the new place holds; NaN: there was no jump

    def reset(self) -> None:
        """The next pose is the first."""
        self._last = self._good = None
        self._settling_s = NAN

    def judge(self, body: RigidBody, time_s: float) -> int:
        """What a pose is, after those before it; times grow."""
        before, before_s = self._last, self._last_s
        if before is not None and body.pose == before.pose:
            return FROZEN
        self._last, self._last_s = body, time_s
        if before is not None:
            distance_m = _distance(before, body)
            if distance_m > self._reach_m(time_s - before_s):
                return self._jumped(body, time_s, distance_m)
        if time_s - self._settling_s < SETTLE_S:
            return SETTLING
        return self._found(body, time_s)

    def _jumped(self, body: RigidBody, time_s: float, distance_m: float) -> int:
        good, settling = self._good, isfinite(self._settling_s)
        if settling and good is not None:
            near_m = self._reach_m(min(RETURN_S, time_s - self._good_s))
            if _distance(good, body) <= near_m:
                return self._found(body, time_s)
        self.jump_m = distance_m
        self._settling_s = time_s
        return JUMPED

    def _found(self, body: RigidBody, time_s: float) -> int:
        self._good, self._good_s = body, time_s
        self._settling_s = NAN
        return GOOD

    def _reach_m(self, elapsed_s: float) -> float:
        return JUMP_M + self._max_speed_mps * elapsed_s


def _distance(one: RigidBody, other: RigidBody) -> float:
    dx, dy, dz = one.x_m - other.x_m, one.y_m - other.y_m, one.z_m - other.z_m
    return sqrt(dx * dx + dy * dy + dz * dz)

"""How the simulated Pixhawk takes a pose that a companion measures for it.

With VISO_TYPE = 1 it takes VISION_POSITION_ESTIMATE, and ODOMETRY in LOCAL_FRD with BODY_FRD; it
drops ODOMETRY in other frames, and what is no rotation, without a word.  While poses come they
are its position, carried on with its own velocity for as long as they are old (VISO_DELAY_MS);
when they stop it has no position at all.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.types import PositionFix

LOST_S: Final = 1.0
UNIT: Final = 1e-5  # how far the norm of a quaternion may be from 1
FAR_M: Final = 1e5


class ExternalPose:
    """The newest pose, and what was dropped."""

    def __init__(self) -> None:
        self.accepted = 0
        self.dropped = 0
        self.newest: Any = None  # the message
        self._at: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._came_s = float("-inf")

    def take(self, message: Any, time_s: float) -> None:
        """One pose of a companion."""
        if not _is_usable(message):
            self.dropped += 1
            return
        self.accepted += 1
        self.newest = message
        self._at = message.x, message.y, message.z
        self._came_s = time_s

    def is_in_use(self) -> bool:
        """Whether the position comes from here, or came until it stopped."""
        return self.accepted > 0

    def fix(
        self, own: PositionFix, before: PositionFix, time_s: float, delay_s: float
    ) -> PositionFix:
        """The position with this aid: `own` is what it would be without, `before` the last."""
        if time_s - self._came_s > LOST_S:
            return before
        age_s = own.time_s - (self._came_s - delay_s)
        north, east, down = (
            at + speed * age_s if isfinite(speed) else at
            for at, speed in zip(self._at, own.velocity_ned_mps, strict=True)
        )
        return own._replace(north_m=north, east_m=east, down_m=down)


def _is_usable(message: Any) -> bool:
    if not all(abs(number) < FAR_M for number in (message.x, message.y, message.z)):
        return False
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_ODOMETRY:
        if (message.frame_id, message.child_frame_id) != (
            mavlink.MAV_FRAME_LOCAL_FRD,
            mavlink.MAV_FRAME_BODY_FRD,
        ):
            return False
        norm = sum(q * q for q in message.q) ** 0.5
        return bool(abs(norm - 1.0) < UNIT)
    return all(map(isfinite, (message.roll, message.pitch, message.yaw)))

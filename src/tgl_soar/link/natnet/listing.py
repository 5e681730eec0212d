"""Which rigid bodies a server streams, over some seconds: for whoever sets a hall up.

No sockets, no clock: frames and their times are given.
"""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.types import NAN


class Row(NamedTuple):
    """One body."""

    id: int
    name: str  # "": the server has not told it
    tracked: bool  # in the last frame that had it
    tracked_share: float  # of the frames that had it
    rate_hz: float  # of the frames that had it; NaN: one only
    age_s: float  # of its last pose when that came, from its exposure; NaN: not known
    seen_s: float  # since it was in a frame last
    pose: RigidBody  # the last one


class _Seen:
    """What is known of one body."""

    def __init__(self, now_s: float) -> None:
        self.first_s = self.last_s = now_s
        self.frames = self.tracked = 0
        self.age_s = NAN
        self.pose: RigidBody | None = None


class BodyListing:
    """Takes the bodies of each frame."""

    def __init__(self) -> None:
        self._seen: dict[int, _Seen] = {}

    def take(self, bodies: list[RigidBody], age_s: float, now_s: float) -> None:
        """One frame that has come now; how old it was."""
        for body in bodies:
            seen = self._seen.setdefault(body.id, _Seen(now_s))
            seen.frames += 1
            seen.tracked += body.is_tracked
            seen.last_s, seen.age_s, seen.pose = now_s, age_s, body

    def rows(self, models: dict[str, int], now_s: float) -> list[Row]:
        """Every body that was in a frame, by its id, with its name among the definitions."""
        names = {number: name for name, number in models.items()}
        rows = []
        for number, seen in sorted(self._seen.items()):
            if seen.pose is None:
                continue
            over_s = seen.last_s - seen.first_s
            rows.append(
                Row(
                    id=number,
                    name=names.get(number, ""),
                    tracked=seen.pose.is_tracked,
                    tracked_share=seen.tracked / seen.frames,
                    rate_hz=(seen.frames - 1) / over_s if over_s > 0.0 else NAN,
                    age_s=seen.age_s,
                    seen_s=now_s - seen.last_s,
                    pose=seen.pose,
                )
            )
        return rows

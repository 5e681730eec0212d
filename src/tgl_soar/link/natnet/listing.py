"""Which rigid bodies a server streams, over some seconds: for whoever sets a hall up.

No sockets, no clock: frames and their times are given.
"""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.types import NAN


class BodyRow(NamedTuple):
    """One body."""

    id: int
    name: str  # "": the server has not sent it
    tracked: bool  # in the last frame that had it
    tracked_fraction: float  # of the frames that had it
    rate_hz: float  # of the frames that had it; NaN: one only
    age_s: float  # of its last pose when that came, from its exposure; NaN: not known
    silent_s: float  # since it was in a frame last
    pose: RigidBody  # the last one


class _BodyRecord:
    """What is known of one body."""

    def __init__(self, now_s: float) -> None:
        self.first_s = self.last_s = now_s
        self.frames = self.tracked = 0
        self.age_s = NAN
        self.pose: RigidBody | None = None


class BodyListing:
    """Takes the bodies of each frame."""

    def __init__(self) -> None:
        self._bodies: dict[int, _BodyRecord] = {}

    def take(self, bodies: list[RigidBody], age_s: float, now_s: float) -> None:
        """One frame that has come now; how old it was."""
        for body in bodies:
            body_record = self._bodies.setdefault(body.id, _BodyRecord(now_s))
            body_record.frames += 1
            body_record.tracked += body.is_tracked
            body_record.last_s, body_record.age_s, body_record.pose = now_s, age_s, body

    def rows(self, models: dict[str, int], now_s: float) -> list[BodyRow]:
        """Every body that was in a frame, by its id, with its name among the definitions."""
        names = {number: name for name, number in models.items()}
        rows = []
        for number, body_record in sorted(self._bodies.items()):
            if body_record.pose is None:
                continue
            over_s = body_record.last_s - body_record.first_s
            rows.append(
                BodyRow(
                    id=number,
                    name=names.get(number, ""),
                    tracked=body_record.pose.is_tracked,
                    tracked_fraction=body_record.tracked / body_record.frames,
                    rate_hz=(body_record.frames - 1) / over_s if over_s > 0.0 else NAN,
                    age_s=body_record.age_s,
                    silent_s=now_s - body_record.last_s,
                    pose=body_record.pose,
                )
            )
        return rows

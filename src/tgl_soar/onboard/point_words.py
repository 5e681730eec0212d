"""How the point on the line stands, in words, when that changes."""

from __future__ import annotations

from tgl_soar.control.brake import HOLDS, LINE_ONLY, POINT_TEXTS
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.outbound import Outbox


class PointWords:
    """Follows how it stands, from tick to tick."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._standing = LINE_ONLY

    def tick(self, standing: int) -> None:
        """A tick has gone by."""
        if standing != self._standing:
            self._standing = standing
            self._outbox.tell_all([point_words(standing)])


def point_words(standing: int) -> tuple[int, str]:
    """Severity and text of a standing."""
    severity = SEVERITY_INFO if standing in (LINE_ONLY, HOLDS) else SEVERITY_WARNING
    return severity, f"point: {POINT_TEXTS[standing]}"

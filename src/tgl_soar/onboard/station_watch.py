"""Whether a ground station is still there, and what its silence means for an engagement.

An operator who has lost the link can neither move the line nor disengage.  OP_GCS_LOSS says what
the module then does, and OP_GCS_S for how long a station may be silent.  The heartbeat of any of
the operators' systems counts, over any link.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings

STAY: Final = 0.0  # values of OP_GCS_LOSS
DISENGAGE: Final = 1.0


class StationWatch:
    """Counts how long every ground station has been silent."""

    def __init__(self, settings: FlightSettings, outbox: Outbox) -> None:
        self._settings = settings
        self._outbox = outbox
        self.restart()

    def restart(self) -> None:
        """The clock is another one from here on."""
        self._received_s = float("-inf")  # a heartbeat
        self._is_reported = False

    def received(self, now_s: float) -> None:
        """A ground station's heartbeat has come."""
        if self._is_reported and self._settings.engage:
            self._outbox.tell(SEVERITY_INFO, "a ground station is there again")
        self._received_s = now_s
        self._is_reported = False

    def refusal(self, now_s: float) -> str:
        """Why nobody can engage now; "" if it can be tried."""
        values = self._settings.values
        if values["OP_GCS_LOSS"] == STAY or not self._is_silent(now_s):
            return ""
        return f"no ground station for {values['OP_GCS_S']:g} s, and OP_GCS_LOSS asks for one"

    def look(self, now_s: float) -> str:
        """Why the engagement ends now; "" if it goes on.  Silence is reported once."""
        values = self._settings.values
        if not self._settings.engage:
            self._is_reported = False
            return ""
        if not self._is_silent(now_s):
            return ""
        silent = f"no ground station for {values['OP_GCS_S']:g} s"
        if values["OP_GCS_LOSS"] == DISENGAGE:
            return silent
        if not self._is_reported and self._received_s != float("-inf"):
            self._outbox.tell(SEVERITY_WARNING, f"{silent}: flying on")
        self._is_reported = True
        return ""

    def _is_silent(self, now_s: float) -> bool:
        return not now_s - self._received_s <= self._settings.values["OP_GCS_S"]

"""Whether the receiver of satellites is accurate enough to engage with, by its own word.

Only a site that counts on latitude and longitude asks: a local position may come from poses that
somebody sends to the autopilot, while its receiver sees nothing in a hall.  A receiver that reports
nothing is accepted: many do not.  In flight a worse accuracy is reported and ends nothing, for
a place that is wrong by some metres is still flown better than none.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.vehicle.gnss_accuracy import GnssAccuracy
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings

BETTER: Final = 0.8  # of the limit: accurate enough again; a report at the limit is reported once


class GnssWatch:
    """Compares what the receiver reports with GPS_ACC_H and GPS_ACC_V."""

    def __init__(self, settings: FlightSettings, accuracy: GnssAccuracy, outbox: Outbox) -> None:
        self._settings = settings
        self._accuracy = accuracy
        self._outbox = outbox
        self._is_reported = False

    def refusal(self, now_s: float) -> str:
        """What of it is too inaccurate to engage with now; "": nothing that is known."""
        return self._worse(now_s, 1.0)

    def look(self, now_s: float) -> None:
        """Tell once in flight that it has become worse, and that it is good enough again."""
        if not self._settings.engage:
            self._is_reported = False
        elif not self._is_reported and (worse := self._worse(now_s, 1.0)):
            self._is_reported = True
            self._outbox.tell(SEVERITY_WARNING, worse)
        elif self._is_reported and not self._worse(now_s, BETTER):
            self._is_reported = False
            self._outbox.tell(SEVERITY_INFO, "the receiver is accurate enough again")

    def _worse(self, now_s: float, fraction: float) -> str:
        """What is worse than a share of what is allowed."""
        if not self._accuracy.counts:
            return ""
        values = self._settings.values
        figures = zip(
            self._accuracy.known(now_s), ("GPS_ACC_H", "GPS_ACC_V"), ("", " up"), strict=True
        )
        for sigma_m, name, where in figures:
            if values[name] > 0.0 and sigma_m > fraction * values[name]:  # false for NaN
                return f"receiver uncertain by {sigma_m:.1f} m{where}: above {name}"
        return ""

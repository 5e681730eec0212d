"""EXC_START, the switch of the multisine: what it does is reported, and it goes back by itself."""

from __future__ import annotations

from math import degrees

from tgl_soar.config.line_changes import LOOP
from tgl_soar.control.excitation import (
    DONE,
    EXCITATION_TEXTS,
    IDLE,
    RUNNING,
    WHOLE_S,
    ExcitationState,
)
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings


class ExcitationSwitch:
    """Follows how the multisine stands, from tick to tick."""

    def __init__(self, settings: FlightSettings, outbox: Outbox) -> None:
        self._settings = settings
        self._outbox = outbox
        self._standing = IDLE
        self._values = settings.values  # what it flies with

    def tick(self, excitation: ExcitationState) -> None:
        """A tick has gone by.  Where it has ended, or cannot begin, EXC_START is 0 again."""
        before, self._standing = self._standing, excitation.standing
        if self._standing == before:
            if before == RUNNING and self._settings.values is not self._values:
                self._look()
            return
        self._outbox.tell_all(excitation_words(before, excitation))
        if self._standing == RUNNING:
            self._values = self._settings.values
        if self._standing not in (IDLE, RUNNING) and self._settings.values["EXC_START"] != 0.0:
            self._settings.assign("EXC_START", 0.0)

    def _look(self) -> None:
        """Something was set while it runs: of another loop another multisine is to be flown."""
        before, self._values = self._values, self._settings.values
        if any(before[name] != self._values[name] for name in LOOP):
            self._outbox.tell(SEVERITY_WARNING, "multisine: another loop is to be measured now")
            self._settings.assign("EXC_START", 0.0)


def excitation_words(before: int, excitation: ExcitationState) -> list[tuple[int, str]]:
    """What is to be said of another standing: severities and texts."""
    standing = excitation.standing
    if standing == IDLE:
        return []
    if standing == RUNNING:
        amplitude = f"+-{degrees(excitation.amplitude_rad):.2g} deg"
        return [(SEVERITY_INFO, f"multisine: {amplitude} of pitch setpoint, {WHOLE_S:g} s")]
    if standing == DONE:
        return [(SEVERITY_INFO, "multisine: done")]
    verb = "stopped" if before == RUNNING else "refused"
    return [(SEVERITY_WARNING, f"multisine: {verb}: {EXCITATION_TEXTS[standing]}")]

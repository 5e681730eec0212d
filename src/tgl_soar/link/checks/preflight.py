"""Is the vehicle set up as the module needs it?

The parameters that the firmware's file in `link/autopilots` names are read one by one and held
against what it wants of them.  A request that stays without an answer is repeated; a parameter
that never answers counts as missing, which is right where other releases have it only.

Nothing is changed and nothing else is asked of the vehicle, so this may be run at any time.
No socket and no clock here: messages and time are arguments.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.autopilot_setup_check import ParameterReading
from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.autopilots.requirements import MUST, Finding, Needs, compare
from tgl_soar.link.messages import Heartbeat, ParamRequestRead, ParamValue

BURST: Final = 4  # requests in one call: radios are slow, and drop what does not fit


class Preflight:
    """Reads and compares; `poll` returns what to send, `findings` the result."""

    def __init__(self, flavour: Flavour, needs: Needs, system_id: int) -> None:
        self.flavour = flavour
        self._needs = needs
        self._rows = flavour.requirements(needs)
        names = [name for row in self._rows for name in row.names] + list(flavour.asked)
        self._reading = ParameterReading(flavour, system_id, names, BURST)
        self._heartbeat: Heartbeat | None = None

    @property
    def answers(self) -> dict[str, float]:
        """What has answered so far."""
        return self._reading.answers

    def take(self, message: object) -> None:
        """Take in one message of the autopilot."""
        if isinstance(message, Heartbeat):
            self._heartbeat = message
        elif isinstance(message, ParamValue):
            self._reading.take(message)

    @property
    def received(self) -> bool:
        """Whether there is an autopilot."""
        return self._heartbeat is not None

    @property
    def mismatch(self) -> str:
        """Why it is another firmware or vehicle than that of the airframe file; or ""."""
        return "" if self._heartbeat is None else self.flavour.mismatch(self._heartbeat)

    def done(self, now_s: float) -> bool:
        """Whether every parameter has answered or never will."""
        return self._reading.done(now_s)

    def poll(self, now_s: float) -> list[ParamRequestRead]:
        """The requests that are due."""
        return self._reading.poll(now_s)

    def findings(self) -> list[Finding]:
        """Every row with what the vehicle has."""
        return compare(self._rows, self.answers)

    def wrong(self) -> list[Finding]:
        """The rows that are not as wanted: what must be changed before what should be."""
        wrong = [finding for finding in self.findings() if not finding.ok]
        return sorted(wrong, key=lambda finding: finding.requirement.level != MUST)

    def refusal(self) -> str:
        """Why commands of ours will be ignored; "" if they will not."""
        return self.flavour.refusal(self.answers, self._needs.override_system)

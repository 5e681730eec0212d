"""Is the vehicle set up as the module needs it?

The parameters that the firmware's file in `link/autopilots` names are read one by one and held
against what it wants of them.  A request that stays without an answer is repeated; a parameter
that never answers counts as missing, which is right where other releases have it only.

Nothing is changed and nothing else is asked of the vehicle, so this may be run at any time.
No socket and no clock here: messages and time are arguments.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.autopilots.requirements import MUST, Finding, Needs, compare
from tgl_soar.link.messages import (
    COMPONENT_AUTOPILOT,
    Heartbeat,
    ParamRequestRead,
    ParamValue,
)

ASK_S: Final = 0.8  # before a parameter is asked for again
ASK_TIMES: Final = 4
BURST: Final = 4  # requests in one call: radios are slow, and drop what does not fit


class Preflight:
    """Reads and compares; `poll` says what to send, `findings` how it came out."""

    def __init__(self, flavour: Flavour, needs: Needs, system_id: int) -> None:
        self.flavour = flavour
        self.answers: dict[str, float] = {}
        self._needs = needs
        self._system_id = system_id
        self._rows = flavour.requirements(needs)
        names = [name for row in self._rows for name in row.names] + list(flavour.asked)
        # How often each was asked for, and when last.
        self._waiting = {name: (0, float("-inf")) for name in dict.fromkeys(names)}
        self._heartbeat: Heartbeat | None = None

    def hear(self, message: object) -> None:
        """Take in one message of the autopilot."""
        if isinstance(message, Heartbeat):
            self._heartbeat = message
        elif isinstance(message, ParamValue) and message.param_id in self._waiting:
            del self._waiting[message.param_id]
            self.answers[message.param_id] = self.flavour.value_of(message)

    @property
    def heard(self) -> bool:
        """Whether there is an autopilot."""
        return self._heartbeat is not None

    @property
    def mismatch(self) -> str:
        """Why it is another firmware or vehicle than that of the airframe file; or ""."""
        return "" if self._heartbeat is None else self.flavour.mismatch(self._heartbeat)

    def done(self, now_s: float) -> bool:
        """Whether every parameter has answered or never will."""
        return all(
            times >= ASK_TIMES and now_s - asked_s >= ASK_S
            for times, asked_s in self._waiting.values()
        )

    def poll(self, now_s: float) -> list[ParamRequestRead]:
        """The requests that are due."""
        due = [
            name
            for name, (times, asked_s) in self._waiting.items()
            if times < ASK_TIMES and now_s - asked_s >= ASK_S
        ][:BURST]
        for name in due:
            self._waiting[name] = self._waiting[name][0] + 1, now_s
        return [ParamRequestRead(self._system_id, COMPONENT_AUTOPILOT, name, -1) for name in due]

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

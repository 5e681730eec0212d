"""Asking the autopilot whether it will obey us and is set up, before that shows in the air.

An ArduPilot ignores overrides of a sender that its parameters do not name, and does not report it;
an RC_OVERRIDE_TIME of 3 s leaves the surfaces where they were for so long when the module has
died. What the firmware's file wants as MUST is read when the autopilot first sends and after it
has restarted: each parameter a few times, a few in a second, so that the slowest radio bears it.
Nothing is changed.  A value that is sent for another reason, as when a station sets it, counts
too.

An autopilot that does not answer is assumed to be set up: what is known to be wrong holds the
engagement back, what is not known is reported.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.autopilots.requirements import MUST, Finding, Needs, compare, remedy
from tgl_soar.link.messages import COMPONENT_AUTOPILOT, Outbound, ParamRequestRead, ParamValue
from tgl_soar.types import NEVER_S

ASK_S: Final = 0.8  # before a parameter is asked for again
ASK_TIMES: Final = 4
BURST: Final = 2  # requests at once, and how soon the next: 640 bytes a second at most
BURST_S: Final = 0.1
NAMED: Final = 3  # of the parameters that have not answered


class ParameterReading:
    """Reads parameters of the autopilot by their names, one by one."""

    def __init__(
        self, flavour: Flavour, target_system: int, names: Iterable[str], burst: int = BURST
    ) -> None:
        self.answers: dict[str, float] = {}
        self._flavour = flavour
        self._target_system = target_system
        self._names = tuple(dict.fromkeys(names))
        self._burst = burst
        self._waiting: dict[str, tuple[int, float]] = {}  # how often asked for, and when last
        self.ask(self._names)

    def restart(self) -> None:
        """It may be another one: ask for everything again."""
        self.answers.clear()
        self.ask(self._names)

    def ask(self, names: Iterable[str]) -> None:
        """Ask for some again; until they answer, what they were stands."""
        for name in names:
            self._waiting[name] = (0, NEVER_S)

    def ask_again(self, names: Iterable[str]) -> None:
        """Ask again for those that this firmware has and that are not being asked for."""
        for name in names:
            times = self._waiting[name][0] if name in self._waiting else ASK_TIMES
            if name in self.answers and times >= ASK_TIMES:
                self.ask((name,))

    def take(self, message: ParamValue) -> bool:
        """Take in a parameter of the autopilot; whether it is one of these."""
        if message.param_id not in self._names:
            return False
        self._waiting.pop(message.param_id, None)
        number = self._flavour.codec.number
        self.answers[message.param_id] = number(message.param_value, message.param_type)
        return True

    def done(self, now_s: float, names: Iterable[str] = ()) -> bool:
        """Whether each has answered or never will; of `names`, whether each had time to."""
        if names:
            asked = [self._waiting[name] for name in names if name in self._waiting]
            return all(times > 0 and now_s - asked_s >= ASK_S for times, asked_s in asked)
        return all(
            times >= ASK_TIMES and now_s - asked_s >= ASK_S
            for times, asked_s in self._waiting.values()
        )

    def poll(self, now_s: float) -> list[ParamRequestRead]:
        """The requests that are due."""
        due: list[str] = []
        for name, (times, asked_s) in self._waiting.items():
            if times < ASK_TIMES and now_s - asked_s >= ASK_S:
                due.append(name)
                if len(due) == self._burst:
                    break
        for name in due:
            self._waiting[name] = (self._waiting[name][0] + 1, now_s)
        return [
            ParamRequestRead(self._target_system, COMPONENT_AUTOPILOT, name, -1) for name in due
        ]


class SetupInquiry:
    """Whose commands does it obey, and is it set up as the module needs it?"""

    def __init__(
        self, flavour: Flavour, target_system: int, override_system: int, needs: Needs | None = None
    ) -> None:
        """`needs`: without them it is asked only whom it obeys."""
        rows = () if needs is None else flavour.requirements(needs)
        self._rows = tuple(row for row in rows if row.level == MUST)
        self._flavour = flavour
        self._override_system = override_system
        names = [*flavour.asked, *(name for row in self._rows for name in row.names)]
        self._reading = ParameterReading(flavour, target_system, names)
        self._due_s = NEVER_S
        self._reported: dict[str, str] = {}  # by what it is about

    def restart(self) -> None:
        """Ask again."""
        self._reading.restart()
        self._due_s = NEVER_S

    def take(self, message: ParamValue) -> None:
        """A parameter of the autopilot."""
        self._reading.take(message)

    def poll(self, now_s: float) -> tuple[list[Outbound], list[str]]:
        """The requests that are due, and new complaints: each once."""
        if now_s < self._due_s:
            return [], []
        self._due_s = now_s + BURST_S
        reading, notices = self._reading, []
        asked: list[Outbound] = [*reading.poll(now_s)]
        if self._flavour.asked and reading.done(now_s, self._flavour.asked):
            notices += self._once("sender", self._refusal())
        if not asked and self._rows and reading.done(now_s):
            wrong = self._wrong()
            notices += self._once("wrong", f"cannot be engaged: {_summary(wrong)}" if wrong else "")
            notices += self._once("unknown", self._unknown())
        return asked, notices

    def held_back(self) -> str:
        """Why the module is not to be engaged, by what is known; "" if nothing is."""
        refusal, wrong = self._refusal(), self._wrong()
        if refusal:
            return refusal
        return _summary(wrong) if wrong else ""

    def ask_again(self) -> None:
        """Somebody was held back: what is wrong may have been corrected meanwhile."""
        self._reading.ask_again([finding.name for finding in self._wrong()])
        if self._refusal():
            self._reading.ask_again(self._flavour.asked)

    def _refusal(self) -> str:
        return self._flavour.refusal(self._reading.answers, self._override_system)

    def _wrong(self) -> list[Finding]:
        """What has answered and is not as it must be."""
        found = compare(self._rows, self._reading.answers)
        return [finding for finding in found if finding.value is not None and not finding.ok]

    def _unknown(self) -> str:
        """That rows which every release has did not answer."""
        found = compare(self._rows, self._reading.answers)
        names = [f.name for f in found if f.value is None and not f.ok]
        if not names:
            return ""
        names = list(dict.fromkeys(names))
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        return (
            f"not known how the autopilot is set up: {', '.join(names[:NAMED])}{more} did not"
            " answer (tgl-soar preflight)"
        )

    def _once(self, about: str, text: str) -> list[str]:
        before, self._reported[about] = self._reported.get(about, ""), text
        return [text] if text and text != before else []


def _summary(wrong: list[Finding]) -> str:
    """The first in full, and how many more."""
    first = wrong[0]
    more = f", and {len(wrong) - 1} more (tgl-soar preflight)" if len(wrong) > 1 else ""
    return f"{remedy(first)}, it is {first.value:g}: {first.requirement.why}{more}"

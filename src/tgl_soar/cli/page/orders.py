"""What is asked of the module: parameters and commands, until they are confirmed or refused.

    a parameter   PARAM_SET, again every `RETRY_S`, until PARAM_VALUE shows the value; refused when
                  PARAM_ERROR answers, or another value stands although it was set
    a line        of more than one changed number: staged (TGL_STAGE 1, the numbers, 0), so that it
                  moves as one; of one number: that parameter
    a command     COMMAND_LONG, again with a higher confirmation, until COMMAND_ACK

What the page shows is the module's echo, never what was requested.  One change of parameters is
under way at a time; a line that still waits gives way to a newer one.  Commands wait for nothing,
and an abort or a release drops what is still to be set: what the module holds staged of it, too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.page.settling_preview import GhostLine
from tgl_soar.cli.page.station import StationAnswer
from tgl_soar.config.line_changes import DROPPED, LINE
from tgl_soar.config.parameters import as_wire_value
from tgl_soar.link.messages import (
    RESULT_ACCEPTED,
    RESULT_CANCELLED,
    RESULT_DENIED,
    RESULT_FAILED,
    RESULT_IN_PROGRESS,
    RESULT_TEMPORARILY_REJECTED,
    RESULT_UNSUPPORTED,
)

RETRY_S: Final = 0.5
GIVE_UP_S: Final = 5.0
STANDS_S: Final = 0.6  # another value for so long after a set: it was refused
ENGAGE: Final = mavlink.MAV_CMD_USER_1
RELEASE: Final = mavlink.MAV_CMD_USER_2
ABORT: Final = mavlink.MAV_CMD_USER_3
WORDS: Final = {ENGAGE: "engage", RELEASE: "release", ABORT: "abort"}
RESULTS: Final = {
    RESULT_ACCEPTED: "done",
    RESULT_TEMPORARILY_REJECTED: "refused for now",
    RESULT_DENIED: "denied: this station is none of the module's operators",
    RESULT_UNSUPPORTED: "the module does not know this command",
    RESULT_FAILED: "the module disengaged before the line was reached",
    RESULT_IN_PROGRESS: "engaging",
    RESULT_CANCELLED: "disengaged before the line was reached",
}
WAITING: Final = 32  # changes of parameters at most
MOVING: Final = (*LINE, "TGL_PRESET", "TGL_PLACE")  # parameters that move the line


class OrderStation(Protocol):
    """The station that asks: the page's, or MAVProxy."""

    parameters: dict[str, float]  # as the module has echoed them
    on_answer: Callable[[StationAnswer], None]

    def set(self, name: str, value: float) -> None:
        """Send one PARAM_SET."""

    def command(self, number: int, confirmation: int) -> None:
        """Send one COMMAND_LONG without parameters."""


class Done:
    """What came of something that was asked: words for a person."""

    __slots__ = ("ok", "text", "who")

    def __init__(self, who: str, ok: bool, text: str) -> None:
        self.who, self.ok, self.text = who, ok, text


@dataclass
class _Change:
    """Parameters that are set in steps; each step's are set together."""

    who: str
    words: str
    steps: list[dict[str, float]]
    is_line: bool = False
    staged: bool = False
    step: int = 0
    began_s: float = float("nan")
    sent_s: float = float("-inf")
    stands_since_s: dict[str, float] = field(default_factory=dict)  # another value

    @property
    def is_staging(self) -> bool:
        """Whether the module may hold some of it, staged."""
        return self.staged and self.began_s == self.began_s


@dataclass
class _Command:
    who: str
    number: int
    confirmation: int = 0
    began_s: float = float("nan")
    sent_s: float = float("-inf")
    is_answered: bool = False


class Orders:
    """Carries them out, one change of parameters after the other."""

    def __init__(self, station: OrderStation, done: Callable[[Done], None]) -> None:
        """done: called with what came of each."""
        self._station = station
        self._done = done
        self._waiting: deque[_Change] = deque()
        self._commands: dict[int, _Command] = {}
        self._undo: list[GhostLine] = []
        station.on_answer = self._answered

    @property
    def is_busy(self) -> bool:
        """Whether parameters are being set."""
        return bool(self._waiting)

    @property
    def undo_count(self) -> int:
        """How many moves can be taken back."""
        return len(self._undo)

    def line(self) -> GhostLine | None:
        """The line as the module commands it; None: not known yet."""
        values = self._station.parameters
        if not all(name in values for name in LINE):
            return None
        return GhostLine(*(values[name] for name in LINE))

    # --- asked ----------------------------------------------------------------------------------

    def move(self, who: str, wanted: GhostLine, *, keeps_undo: bool = True) -> None:
        """Move the line."""
        now = self.line()
        if now is None:
            self._done(Done(who, False, "the module's parameters are not known yet: wait"))
            return
        wanted = GhostLine(*(as_wire_value(value) for value in wanted))
        pairs = zip(LINE, now, wanted, strict=True)
        changes = {name: new for name, old, new in pairs if new != old}
        if not changes:
            return
        words = f"line to x {wanted.x_m:.2f} m, z {wanted.z_m:.2f} m, lean {wanted.lean_deg:.1f}°"
        # Other than 0: somebody stages, or what was staged was dropped, and single numbers may be
        # refused until a move is staged again.
        is_staging = self._station.parameters.get("TGL_STAGE", 0.0) != 0.0
        staged = len(changes) > 1 or is_staging
        steps = [{"TGL_STAGE": 1.0}, changes, {"TGL_STAGE": 0.0}] if staged else [changes]
        if keeps_undo:
            self._remember(now)
        # What waits and was not begun is an older request for the same line.
        self._waiting = deque(c for c in self._waiting if not c.is_line or c.began_s == c.began_s)
        self._add(_Change(who, words, steps, is_line=True, staged=staged))

    def preset(self, who: str, number: int, name: str) -> None:
        """Put the line where the site has its n-th."""
        now = self.line()
        if now is not None:
            self._remember(now)
        self._add(_Change(who, f"line {name}", [{"TGL_PRESET": float(number)}], is_line=True))

    def undo(self, who: str) -> None:
        """The line where it stood before the last move, whoever made it."""
        if self._undo:
            self.move(who, self._undo.pop(), keeps_undo=False)
        else:
            self._done(Done(who, False, "nothing to undo"))

    def set(self, who: str, name: str, value: float) -> None:
        """Set one parameter; one that moves the line can be taken back."""
        value, now = as_wire_value(value), self.line()
        is_line = name in MOVING
        if is_line and now is not None and self._station.parameters.get(name) != value:
            self._remember(now)
        self._add(_Change(who, f"{name} = {value:g}", [{name: value}], is_line=is_line))

    def command(self, who: str, number: int) -> None:
        """Engage, release or abort."""
        if number != ENGAGE:
            is_staging = any(change.is_staging for change in self._waiting)
            self._waiting.clear()
            if is_staging:  # or the next change of anything would make that move
                self._add(_Change(who, "the staged move's end", [{"TGL_STAGE": DROPPED}]))
            self._commands.pop(ENGAGE, None)
        self._commands[number] = _Command(who, number)

    def _add(self, change: _Change) -> None:
        if len(self._waiting) >= WAITING:
            self._done(Done(change.who, False, f"{change.words}: too much is waiting already"))
        else:
            self._waiting.append(change)

    def _remember(self, line: GhostLine) -> None:
        if not self._undo or self._undo[-1] != line:
            self._undo = [*self._undo[-49:], line]

    # --- carried out ----------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Send what is due, and give up what nobody answers."""
        for command in list(self._commands.values()):
            self._command(command, now_s)
        if self._waiting:
            self._change(self._waiting[0], now_s)

    def _command(self, command: _Command, now_s: float) -> None:
        if command.began_s != command.began_s:
            command.began_s = now_s
        if command.is_answered:
            return
        if now_s - command.began_s > GIVE_UP_S:
            del self._commands[command.number]
            text = f"{WORDS[command.number]}: the module does not answer"
            self._done(Done(command.who, False, text))
        elif now_s - command.sent_s >= RETRY_S:
            self._station.command(command.number, command.confirmation)
            command.sent_s, command.confirmation = now_s, min(255, command.confirmation + 1)

    def _change(self, change: _Change, now_s: float) -> None:
        if change.began_s != change.began_s:
            change.began_s = now_s
        if now_s - change.began_s > GIVE_UP_S:
            self._end(change, False, "not confirmed: the module does not answer")
            return
        stands = self._station.parameters
        wanted = change.steps[change.step]
        if change.sent_s > float("-inf") and all(stands.get(n) == v for n, v in wanted.items()):
            self._next_step(change, now_s)
            return
        for name, since_s in change.stands_since_s.items():
            if now_s - since_s > STANDS_S and stands.get(name) != wanted.get(name):
                self._end(change, False, f"refused: {name} stays {stands.get(name, 0.0):g}")
                return
        if now_s - change.sent_s >= RETRY_S:
            for name, value in wanted.items():
                if stands.get(name) != value or change.sent_s == float("-inf"):
                    self._station.set(name, value)
            change.sent_s = now_s

    def _next_step(self, change: _Change, now_s: float) -> None:
        change.step += 1
        change.sent_s, change.stands_since_s = float("-inf"), {}
        if change.step == len(change.steps):
            self._end(change, True, "confirmed")
        else:
            self._change(change, now_s)

    def _end(self, change: _Change, ok: bool, result: str) -> None:
        self._waiting.popleft()
        if not ok and change.is_line and self._undo and self._undo[-1] == self.line():
            self._undo.pop()
        if not ok and change.staged and self._station.parameters.get("TGL_STAGE") == 1.0:
            self._station.set("TGL_STAGE", DROPPED)  # what is staged is not to be moved to later
        self._done(Done(change.who, ok, f"{change.words}: {result}"))

    def _answered(self, answer: StationAnswer) -> None:
        """The module has answered somebody's set or command."""
        if answer.kind == "ack":
            self._acknowledged(answer)
            return
        if not self._waiting:
            return
        change = self._waiting[0]
        wanted = change.steps[change.step]
        if answer.name not in wanted or change.sent_s == float("-inf"):
            return
        if answer.kind == "error":
            self._end(change, False, "refused by the module; its words are in the list of messages")
        elif answer.value != wanted[answer.name]:
            change.stands_since_s.setdefault(answer.name, change.sent_s)

    def _acknowledged(self, answer: StationAnswer) -> None:
        command = self._commands.get(answer.command)
        if command is None:
            return
        result = RESULTS.get(answer.result, f"result {answer.result}")
        if answer.result == RESULT_IN_PROGRESS:
            if not command.is_answered:
                command.is_answered = True
                self._done(Done(command.who, True, f"{WORDS[command.number]}: {result}"))
            return
        del self._commands[answer.command]
        ok = answer.result == RESULT_ACCEPTED
        self._done(Done(command.who, ok, f"{WORDS[command.number]}: {result}"))

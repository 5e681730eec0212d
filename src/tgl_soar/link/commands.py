"""Commands of an operator: engage, release, abort, and what a ground station asks by command.

    MAV_CMD_USER_1   engage: take the surfaces and soar
    MAV_CMD_USER_2   release: disengage; also takes an abort back
    MAV_CMD_USER_3   abort: disengage, and stay so until released

By COMMAND_LONG or COMMAND_INT to (vehicle's system, our component).  The user commands have no
meaning to any firmware: an autopilot that does not yet know the way to this component executes
what is addressed to it, and must not find a command of its own in it.

Engaging takes time: the entry checks are the next tick's, and the line then slides from the
aircraft to its target.  So its answer is IN_PROGRESS, again once a second, and in the end
ACCEPTED (the aircraft is on the line), TEMPORARILY_REJECTED (a check refused), FAILED (the module
disengaged by itself) or CANCELLED (an operator released).  A station that repeats a
command, because the answer was lost, gets the answer again; nothing is done twice.  But what looks
like a repeated release may be a new one whose first frame was lost: while the module is engaged it
is done, and an abort always is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, TypeAlias

from tgl_soar.link.messages import (
    CAPABILITY_COMMAND_INT,
    CAPABILITY_FTP,
    CAPABILITY_MAVLINK2,
    CAPABILITY_PARAM_ENCODE_C_CAST,
    COMMAND_GET_MESSAGE_INTERVAL,
    COMMAND_REQUEST_AUTOPILOT_CAPABILITIES,
    COMMAND_REQUEST_MESSAGE,
    COMMAND_SET_MESSAGE_INTERVAL,
    COMMAND_USER_1,
    COMMAND_USER_2,
    COMMAND_USER_3,
    ID_AUTOPILOT_VERSION,
    ID_MESSAGE_INTERVAL,
    RESULT_ACCEPTED,
    RESULT_CANCELLED,
    RESULT_DENIED,
    RESULT_FAILED,
    RESULT_IN_PROGRESS,
    RESULT_TEMPORARILY_REJECTED,
    RESULT_UNSUPPORTED,
    AutopilotVersion,
    CommandAck,
    CommandInt,
    CommandLong,
    MessageInterval,
    Outbound,
    Source,
)

ENGAGE: Final = COMMAND_USER_1
RELEASE: Final = COMMAND_USER_2
ABORT: Final = COMMAND_USER_3
NOTHING: Final = 0

PROGRESS_S: Final = 1.0  # between two IN_PROGRESS
REPEAT_S: Final = 10.0  # so long after a command a confirmation > 0 repeats it
MAX_REMEMBERED: Final = 16
ANSWERS_PER_S: Final = 20.0  # to strangers, and to what nothing that flies depends on
ANSWERS_AT_ONCE: Final = 20.0
UNKNOWN_PROGRESS: Final = 255

Command: TypeAlias = CommandLong | CommandInt


class CommandAnswer(NamedTuple):
    """What a command leads to."""

    outbound: list[Outbound]  # to the station that sent it
    request: int = NOTHING  # ENGAGE, RELEASE or ABORT: to be done now
    reason: str = ""  # of a refusal, for the operator


class TelemetrySource(Protocol):
    """What can be asked for by number."""

    def once(self, message_id: int) -> Outbound | None:
        """A message now; None: there is none of this number."""
        ...

    def set_interval(self, message_id: int, interval_us: float) -> bool:
        """Send it so often; -1 never, 0 as by default; False: that cannot be."""
        ...

    def interval_us(self, message_id: int) -> int:
        """How often it is sent; -1: not, 0: it is not ours."""
        ...


@dataclass(slots=True)
class CommandCounters:
    """What operators commanded."""

    commands: int = 0  # for us
    repeated: int = 0
    refused: int = 0
    unsupported: int = 0
    unanswered: int = 0  # of a flood


@dataclass(slots=True)
class _Done:
    """The last command of its kind from one sender."""

    time_s: float
    result: int
    progress_s: float = 0.0  # when IN_PROGRESS is to be sent again
    entered: bool = False  # the entry checks have passed


class CommandServer:
    """Answers the commands of every station; pure logic, time is an argument."""

    def __init__(
        self, own: Source, telemetry: TelemetrySource, version: tuple[int, int, int]
    ) -> None:
        self.counters = CommandCounters()
        self._own = own
        self._telemetry = telemetry
        major, minor, patch = version
        self._version = AutopilotVersion(
            CAPABILITY_COMMAND_INT
            | CAPABILITY_FTP
            | CAPABILITY_MAVLINK2
            | CAPABILITY_PARAM_ENCODE_C_CAST,
            major << 24 | minor << 16 | patch << 8,
        )
        self._done: dict[tuple[Source, int], _Done] = {}
        self._answers = ANSWERS_AT_ONCE
        self._answered_s = float("-inf")

    def is_for_us(self, source: Source, message: Command) -> bool:
        """A release may be addressed to all components at once; all else names ours."""
        if source == self._own or message.target_system not in (0, self._own.system):
            return False
        to_all = message.target_component == 0 and message.command in (RELEASE, ABORT)
        return to_all or message.target_component == self._own.component

    def handle(
        self,
        source: Source,
        message: Command,
        now_s: float,
        *,
        forbidden: str = "",
        held_back: str = "",
        engaged: bool = False,
    ) -> CommandAnswer:
        """What a command for us leads to.

        `forbidden`: why this sender may not command at all; `held_back`: why nobody can engage
        now; "" if they may.  `engaged`: the module is, or is about to be.
        """
        self.counters.commands += 1
        number = message.command
        before = self._done.get((source, number))
        if number == ABORT or (number == RELEASE and engaged):
            before = None  # never taken for a repetition: the one before is undone
        confirmation = message.confirmation if isinstance(message, CommandLong) else 0
        if before is not None and confirmation > 0 and now_s - before.time_s <= REPEAT_S:
            self.counters.repeated += 1
            return CommandAnswer([_ack(source, number, before.result)])
        flies = number in (ENGAGE, RELEASE, ABORT)
        if (forbidden or not flies) and not self.may_answer(now_s):
            self.counters.unanswered += 1
            return CommandAnswer([])
        if forbidden and (flies or number == COMMAND_SET_MESSAGE_INTERVAL):
            # Not remembered: strangers must not crowd out what operators have asked for.
            self.counters.refused += 1
            return CommandAnswer([_ack(source, number, RESULT_DENIED)], NOTHING, forbidden)
        if not flies:
            return self._asked(source, message)
        request, result, reason = number, RESULT_ACCEPTED, ""
        if number == ENGAGE:
            result = RESULT_IN_PROGRESS
            if held_back:
                request, result, reason = NOTHING, RESULT_TEMPORARILY_REJECTED, held_back
        self.counters.refused += reason != ""
        self._remember(source, number, _Done(now_s, result, now_s + PROGRESS_S))
        # The first answer to an engagement follows the entry checks, with the next tick.
        outbound: list[Outbound] = (
            [] if result == RESULT_IN_PROGRESS else [_ack(source, number, result)]
        )
        return CommandAnswer(outbound, request, reason)

    def engagement(self, *, flying: bool, settled: bool, withdrawn: bool) -> list[CommandAck]:
        """The module's mode has changed: the answers to those who asked it to engage.

        flying: it is engaged; settled: and is on its line; withdrawn: an operator released.
        """
        outbound: list[CommandAck] = []
        for (source, number), done in self._done.items():
            if number != ENGAGE or done.result != RESULT_IN_PROGRESS:
                continue
            if settled:
                done.result = RESULT_ACCEPTED
            elif not flying:
                refused = RESULT_FAILED if done.entered else RESULT_TEMPORARILY_REJECTED
                done.result = RESULT_CANCELLED if withdrawn else refused
            elif done.entered:
                continue
            done.entered = True
            outbound.append(_ack(source, number, done.result))
        return outbound

    def poll(self, now_s: float) -> list[CommandAck]:
        """IN_PROGRESS, once a second, to those who wait."""
        outbound: list[CommandAck] = []
        if not self._done:
            return outbound
        for (source, number), done in self._done.items():
            if done.result == RESULT_IN_PROGRESS and now_s >= done.progress_s:
                done.progress_s = now_s + PROGRESS_S
                done.time_s = now_s
                outbound.append(_ack(source, number, done.result))
        return outbound

    def may_answer(self, now_s: float) -> bool:
        """Whether a flood leaves room for one more answer that nothing which flies depends on."""
        if now_s > self._answered_s:
            earned = (now_s - self._answered_s) * ANSWERS_PER_S
            self._answers = min(ANSWERS_AT_ONCE, self._answers + earned)
            self._answered_s = now_s
        if self._answers < 1.0:
            return False
        self._answers -= 1.0
        return True

    def rebase(self) -> None:
        """The clock was changed: nobody waits any more."""
        self._done.clear()
        self._answers = ANSWERS_AT_ONCE
        self._answered_s = float("-inf")

    def _asked(self, source: Source, message: Command) -> CommandAnswer:
        """Messages by number: nothing that flies depends on them, so anybody may ask for one;
        how often all stations get it is the operators' choice."""
        number, (one, two) = message.command, message.params[:2]
        outbound: list[Outbound] = []
        result = RESULT_ACCEPTED
        if number == COMMAND_REQUEST_AUTOPILOT_CAPABILITIES:
            outbound.append(self._version)
        elif number == COMMAND_REQUEST_MESSAGE:
            result = self._request(one, two, outbound)
        elif number == COMMAND_GET_MESSAGE_INTERVAL:
            result = self._request(float(ID_MESSAGE_INTERVAL), one, outbound)
        elif number == COMMAND_SET_MESSAGE_INTERVAL:
            whole = _whole(one) >= 0 and two == two
            if not whole or not self._telemetry.set_interval(int(one), two):
                result = RESULT_DENIED
        else:
            self.counters.unsupported += 1
            result = RESULT_UNSUPPORTED
        return CommandAnswer([_ack(source, number, result), *outbound])

    def _request(self, one: float, two: float, outbound: list[Outbound]) -> int:
        number = _whole(one)
        if number == ID_AUTOPILOT_VERSION:
            outbound.append(self._version)
            return RESULT_ACCEPTED
        if number == ID_MESSAGE_INTERVAL:
            about = _whole(two)
            if about < 0:
                return RESULT_DENIED
            outbound.append(MessageInterval(about, self._telemetry.interval_us(about)))
            return RESULT_ACCEPTED
        message = self._telemetry.once(number) if number >= 0 else None
        if message is None:
            return RESULT_DENIED
        outbound.append(message)
        return RESULT_ACCEPTED

    def _remember(self, source: Source, number: int, done: _Done) -> None:
        self._done.pop((source, number), None)
        if len(self._done) >= MAX_REMEMBERED:
            del self._done[next(iter(self._done))]
        self._done[source, number] = done


def _ack(source: Source, command: int, result: int) -> CommandAck:
    progress = UNKNOWN_PROGRESS if result == RESULT_IN_PROGRESS else 0
    return CommandAck(
        command=command,
        result=result,
        target_system=source.system,
        target_component=source.component,
        progress=progress,
    )


def _whole(value: float) -> int:
    """A message's number from a float's place; -1: it is none."""
    return int(value) if 0.0 <= value <= 65535.0 and value == int(value) else -1

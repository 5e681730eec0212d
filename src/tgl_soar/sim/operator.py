"""An operator at a ground station: engages the module and moves its line, over real MAVLink.

It does what a person would do with the parameter page of a ground station: a `PARAM_SET` to
component 191, a look at the `PARAM_VALUE` that answers, again if none comes, and a look at
the telemetry before the next step.  It owns no clock and no socket: datagrams and the time
come in, datagrams go out, so that it can take part in a lockstep simulation.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isclose, isfinite
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.parameters import as_wire_value
from tgl_soar.control.supervisor import BREAKING_OFF, CAPTURING, LANDING, LAUNCHING, SOARING

RETRY_S = 0.5
GIVE_UP_S = 10.0  # without an answer to a set for so long, nobody is there
LOOK_S = 1.0  # the position is watched for so long before engaging
ARM_TIMEOUT_S = 180.0  # since the autopilot's start: ArduPlane's estimator takes half a minute
LEG_TIMEOUT_S = 40.0  # for a line that stands to begin to move, or to be at its target
HOME_TIMEOUT_S = 180.0  # from breaking off to the ground
SEARCH_TIMEOUT_S = 120.0  # for a search to find one
WORDS_S = 0.5  # the reason of a release may come after it
DISTURBED_S = 2.0  # so long it looks on where a fault has made the module disengage
READY_S = 60.0  # a crashed aircraft lies for 10 s and is carried back to the start
READY = 2.0  # of soar_mode
HOMEWARD = (BREAKING_OFF, LANDING)  # the same
LANDED = "released: on the ground"
FOUND = 2.0  # of SRCH_START
OVER = (0.0, 4.0)  # the same
LINE = {"TGL_X": "line_x", "TGL_Z": "line_z", "TGL_LEAN": "line_lean"}
# Why a flight by the clock ends where a process was not let run for some tenths of a second.
HICCUPS = ("attitude lost", "position lost", "autopilot silent")


class OperatorError(RuntimeError):
    """The flight cannot go on; the message says what was tried and what came back."""

    def __init__(self, words: str, *, is_of_machine: bool = False) -> None:
        """`is_of_machine`: where it flies by the clock, a machine that is too busy may be why."""
        super().__init__(words)
        self.is_of_machine = is_of_machine


@dataclass(frozen=True)
class PlannedLeg:
    """One place to fly at: parameters to set, and how long to stay once the line stands."""

    name: str
    parameters: dict[str, float]
    stay_s: float
    searches: bool = False  # the module is to find the line itself
    surveys: bool = False  # the module moves the line itself, and is done where SRV_START is 0
    launches: bool = False  # it begins in a hand

    def to_set(self) -> list[tuple[str, float]]:
        """What is set before it, in this order."""
        return [*self.parameters.items(), *([("LNC_START", 1.0)] if self.launches else [])]


@dataclass
class FlownLeg:
    """When a leg happened, in the vehicle's time."""

    leg: PlannedLeg
    asked_s: float
    stopped_s: float = float("nan")  # the line stood still at its target
    ended_s: float = float("nan")
    by_hand: bool = False  # another ground station has moved the line meanwhile
    broken_off: bool = False  # the module has left for the landing place before it was over
    released: str = ""  # why the module has disengaged, where a fault was to show what it does
    # The line that a search has found, or that another ground station has moved it to.
    found: dict[str, float] = field(default_factory=dict)
    moved_s: float = float("-inf")  # when that was last seen to move

    def follow(self, telemetry: LastTelemetry) -> None:
        """Take the line that is flown for this leg's."""
        shown = {name: telemetry.values.get(key, float("nan")) for name, key in LINE.items()}
        if shown != self.found and all(isfinite(value) for value in shown.values()):
            self.found, self.moved_s = shown, telemetry.time_s

    def is_moved_by_hand(self, telemetry: LastTelemetry) -> bool:
        """Whether the line's parameters are no longer those that this leg set."""
        if self.leg.searches:
            self.by_hand = telemetry.parameters.get("SRCH_START") in OVER
            return self.by_hand
        self.by_hand = self.by_hand or any(
            telemetry.parameters.get(name) != as_wire_value(value)
            for name, value in self.leg.parameters.items()
        )
        return self.by_hand

    def is_over(self, telemetry: LastTelemetry) -> bool:
        """Whether the line has stood for as long as it is to, or the survey has ended."""
        has_surveyed = self.leg.surveys and telemetry.parameters.get("SRV_START") == 0.0
        return has_surveyed or telemetry.time_s - self.stopped_s >= self.leg.stay_s

    def line_stands(self, telemetry: LastTelemetry, engaged_s: float) -> bool:
        """Whether the line that is flown is the one that was asked for: before it is engaged the
        module shows the target itself, and so it may in a hand."""
        if telemetry.shown("soar_mode") == LAUNCHING:
            return False
        if self.leg.searches:
            found = telemetry.parameters.get("SRCH_START") == FOUND
            return found and telemetry.shown("soar_mode") == SOARING
        return all(
            isclose(telemetry.shown(LINE[name]), value, abs_tol=1e-3)
            and telemetry.stamps[LINE[name]] > engaged_s
            for name, value in self.leg.parameters.items()
            if name in LINE
        )


@dataclass
class LastTelemetry:
    """The last that telemetry reported."""

    time_s: float = float("nan")  # the vehicle's
    values: dict[str, float] = field(default_factory=dict)  # NAMED_VALUE_FLOAT by name
    stamps: dict[str, float] = field(default_factory=dict)  # the vehicle's time of each
    texts: list[str] = field(default_factory=list)  # STATUSTEXT, oldest first
    # Those of the module alone, and when the first piece of each came.
    reported: list[tuple[float, str]] = field(default_factory=list)
    parameters: dict[str, float] = field(default_factory=dict)
    module_alive: bool = False
    armed: bool = False

    def take(self, kind: str, message: Any, *, of_module: bool) -> None:
        """One message of the vehicle."""
        if kind == "STATUSTEXT":
            self._take_text(str(message.text), message.id, message.chunk_seq)
            if of_module:
                is_more = bool(message.id and message.chunk_seq and self.reported)
                begun_s, begun = self.reported.pop() if is_more else (self.time_s, "")
                self.reported.append((begun_s, begun + str(message.text)))
        elif kind in ("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED"):
            self.time_s = message.time_boot_ms * 1e-3
        elif kind == "NAMED_VALUE_FLOAT":
            self.time_s = message.time_boot_ms * 1e-3
            name = message.name.rstrip("\0")
            self.values[name], self.stamps[name] = message.value, self.time_s
        elif of_module and kind == "HEARTBEAT":
            self.module_alive = True
        elif kind == "HEARTBEAT" and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
            self.armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED != 0
        elif of_module and kind == "PARAM_VALUE":
            self.parameters[message.param_id.rstrip("\0")] = message.param_value

    def _take_text(self, text: str, number: int, chunk: int) -> None:
        """A text, or one more piece of a long one."""
        if number and chunk and self.texts:
            self.texts[-1] += text
        else:
            self.texts.append(text)

    def shown(self, name: str) -> float:
        """The last value of a telemetry name; NaN where none has come."""
        return self.values.get(name, float("nan"))

    def reason(self, since: int = 0) -> str:
        """The newest words of a release, of the texts from one on; "": there are none."""
        texts = reversed(self.texts[since:])
        return next((text for text in texts if text.startswith("released")), "")

    def words(self) -> str:
        """The newest texts, each once."""
        return "; ".join([*dict.fromkeys(self.texts)][-3:]) or "nothing"

    def why_disarmed(self) -> str:
        """The newest text of a firmware's checks, or what was reported last."""
        checks = [text for text in self.texts if text.startswith(("PreArm", "Preflight", "Arm"))]
        return checks[-1].strip() if checks else self.words()


def disengaged(telemetry: LastTelemetry) -> OperatorError:
    """That of a module which has disengaged by itself."""
    words = telemetry.words()
    is_of_machine = any(hiccup in words for hiccup in HICCUPS)
    return OperatorError(f"the module disengaged by itself: {words}", is_of_machine=is_of_machine)


class Operator:
    """Flies a plan of legs.

    receive() takes datagrams; step() is called after them and returns what to send.
    """

    def __init__(
        self,
        legs: list[PlannedLeg],
        system: int,
        component: int,
        own_system: int = 254,
        *,
        when_armed: bool = False,
        again: int = 0,
        watch_s: float | None = None,
        goes_home: bool = False,
        is_disturbed: bool = False,
    ) -> None:
        """`when_armed`: it engages nothing before the vehicle is armed.  `again`: so often it
        engages again and repeats the leg where a hiccup of the machine has ended the flight.
        `watch_s`: where the module disengages by itself it looks on for so long, and is done.
        `goes_home`: after the last leg it breaks off, and the module lands.  `is_disturbed`: faults
        are injected, so that a module that disengages ends the flight, and is no error."""
        self.telemetry = LastTelemetry()
        self.hiccups: list[str] = []  # the report of each
        self.flown: list[FlownLeg] = []
        self.done = False
        self._legs = legs
        self._when_armed = when_armed
        self._again = again
        self._watch_s = watch_s
        self._goes_home = goes_home
        self._is_disturbed = is_disturbed
        self._homeward_s = float("nan")
        self._texts_before = 0  # of those that were received before it broke off
        self._released_s = float("nan")
        self._target = (system, component)
        self._codec = mavlink.MAVLink(None, own_system, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._codec.robust_parsing = True
        self._out: list[bytes] = []
        self._to_set: list[tuple[str, float]] = []
        self._sent_s = float("-inf")
        self._first_sent_s = float("nan")
        self._heartbeat_s = float("-inf")
        self._engaged = False
        self._engaged_s = float("nan")
        self._known_since_s = float("nan")
        self._line = [float("nan")] * len(LINE)  # as it was last shown
        self._patient_since_s = float("nan")  # the leg has begun, or the line was seen to move
        self._stage = "wait"

    # --- what arrives ---------------------------------------------------------------------
    def receive(self, data: bytes) -> bool:
        """Take in one datagram; whether anything in it came from the vehicle."""
        from_vehicle = False
        for message in self._codec.parse_buffer(bytearray(data)) or ():
            kind = message.get_type()
            if kind == "BAD_DATA" or message.get_srcSystem() != self._target[0]:
                continue
            from_vehicle = True
            if kind == "TIMESYNC":
                if message.tc1 == 0:
                    self._pack(self._codec.timesync_encode(message.ts1, message.ts1))
            else:
                source = (message.get_srcSystem(), message.get_srcComponent())
                self.telemetry.take(kind, message, of_module=source == self._target)
        return from_vehicle

    # --- what to do -----------------------------------------------------------------------
    def step(self, now_s: float) -> list[bytes]:
        """What to send now; `now_s` only paces heartbeats and repetitions."""
        if not 0.0 <= now_s - self._heartbeat_s < 1.0:  # simulated time begins again, at zero
            self._heartbeat_s = now_s
            self._pack(
                self._codec.heartbeat_encode(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
                )
            )
        while self._act(now_s):
            pass
        out, self._out = self._out, []
        return out

    def _act(self, now_s: float) -> bool:
        """Do one thing; whether another may follow from it at once.

        All that can be done is done, so that another call without news does nothing: a flight
        in lockstep must not depend on how often a slow machine calls.
        """
        if self._to_set:
            self._set_next(now_s)
            return not self._to_set
        if self.done:
            return False
        before = self._stage, self._engaged, isfinite(self._engaged_s), len(self.flown)
        self._next_stage()
        return before != (self._stage, self._engaged, isfinite(self._engaged_s), len(self.flown))

    def _next_stage(self) -> None:
        """Wait for the module, then leg by leg: set, wait for the line to stand, stay."""
        if self._stage == "watch":
            self._look_on()
        elif self._stage in ("released", "again"):
            self._recover()
        elif self._stage == "home":
            self._wait_for_landing()
        elif self._stage == "down":
            self._conclude_landing()
        elif self._stage in ("move", "stay") and self._breaks_off():
            self._break_off(self.flown[-1])
        elif self._stage == "wait":
            known = self.telemetry.module_alive and isfinite(self.telemetry.shown("soar_x"))
            may_begin = self.telemetry.armed or not self._when_armed
            known = known and may_begin
            if not may_begin and self.telemetry.time_s > ARM_TIMEOUT_S:
                why = self.telemetry.why_disarmed()
                raise OperatorError(f"not armed {ARM_TIMEOUT_S:g} s after its start: {why}")
            if not (known and isfinite(self._known_since_s)):
                self._known_since_s = self.telemetry.time_s
            elif self.telemetry.time_s - self._known_since_s >= LOOK_S:
                self._begin_leg(0)
        elif self._stage == "move":
            flown = self.flown[-1]
            if not self._engaged:
                self._engaged = True
                self._to_set = [("OP_ENGAGE", 1.0)]
            elif self._engaged_s != self._engaged_s:
                self._engaged_s = self.telemetry.time_s  # it has been confirmed
            elif self._line_stands(flown) or flown.is_moved_by_hand(self.telemetry):
                flown.stopped_s = self.telemetry.time_s
                if flown.leg.searches:
                    flown.found = {
                        name: self.telemetry.shown(shown) for name, shown in LINE.items()
                    }
                self._stage = "stay"
            else:
                self._wait_for_line(flown)
        elif self._stage == "stay":
            flown = self.flown[-1]
            if flown.is_moved_by_hand(self.telemetry):
                flown.follow(self.telemetry)
            if flown.leg.searches and not (self._line_stands(flown) or flown.by_hand):
                self._stage = "move"  # it has found a better one, or its place is gone
            elif flown.is_over(self.telemetry):
                flown.ended_s = self.telemetry.time_s
                if len(self.flown) == len(self._legs):
                    self._legs_flown()
                else:
                    self._begin_leg(len(self.flown))
        if self._engaged and self.telemetry.parameters.get("OP_ENGAGE") == 0.0 and not self._to_set:
            self._engaged, self._engaged_s = False, float("nan")
            self._stage, self._released_s = "released", self.telemetry.time_s
            if self._watch_s is not None:
                self._stage = "watch"
            elif isfinite(self._homeward_s):
                self._stage = "down"
            elif self._is_disturbed:
                self._stage, self._watch_s = "watch", DISTURBED_S
            elif self._again <= len(self.hiccups):
                raise disengaged(self.telemetry)

    def _legs_flown(self) -> None:
        """All of them: it is over, or the way home begins."""
        if self._goes_home:
            self._turn_home()
            self._to_set = [("ESC_START", 1.0)]
        else:
            self.done = True

    # --- the way home ---------------------------------------------------------------------
    @property
    def broke_off(self) -> bool:
        """Whether it has left for the landing place, whoever wanted that, and not come back."""
        return isfinite(self._homeward_s)

    def _breaks_off(self) -> bool:
        """Whether the module is on its way home: another station, or it itself, has asked for it.
        Where it was to be seen what it does, nothing is made of it."""
        return self._watch_s is None and self.telemetry.shown("soar_mode") in HOMEWARD

    def _break_off(self, flown: FlownLeg) -> None:
        """The leg ends here."""
        flown.broken_off, flown.ended_s = True, self.telemetry.time_s
        self._turn_home()

    def _turn_home(self) -> None:
        self._stage, self._homeward_s = "home", self.telemetry.time_s
        self._texts_before = len(self.telemetry.texts)

    def _wait_for_landing(self) -> None:
        """Errors: `OperatorError` after too long."""
        flown = self.flown[-1]
        if flown.broken_off and self.telemetry.shown("soar_mode") in (CAPTURING, SOARING):
            # Somebody has called it back.
            flown.broken_off, flown.ended_s = False, float("nan")
            self._stage, self._homeward_s = "move", float("nan")
            self._patient_since_s = self.telemetry.time_s
        elif self.telemetry.time_s - self._homeward_s > HOME_TIMEOUT_S:
            raise OperatorError(
                f"not down within {HOME_TIMEOUT_S:g} s of breaking off: {self.telemetry.words()}"
            )

    def _conclude_landing(self) -> None:
        """It has disengaged on the way home.  Errors: `OperatorError` where that was no landing."""
        reason = self.telemetry.reason(self._texts_before)
        if reason.startswith(LANDED):
            self.done = True
        elif self.telemetry.time_s - self._released_s >= WORDS_S:
            if reason:
                raise disengaged(self.telemetry)
            self.done = True  # its words are lost, and the truth will tell

    # --- a module that has disengaged, and what it is asked for ---------------------------

    def _look_on(self) -> None:
        """The module has disengaged by itself, as was to be seen."""
        assert self._watch_s is not None
        if self.telemetry.time_s - self._released_s >= self._watch_s:
            flown = self.flown[-1]
            if not isfinite(flown.stopped_s):
                flown.stopped_s = flown.asked_s
            if not isfinite(flown.ended_s):
                flown.ended_s = self._released_s
            if self._is_disturbed:
                reason = self.telemetry.reason().removeprefix("released: ")
                flown.released = reason or "its reason was not received"
            self.done = True

    def _recover(self) -> None:
        """The module has disengaged by itself: see why, and repeat the leg once it is ready."""
        since_s = self.telemetry.time_s - self._released_s
        if self._stage == "released" and since_s >= WORDS_S:
            reason = self.telemetry.reason()
            if not any(hiccup in reason for hiccup in HICCUPS):
                raise disengaged(self.telemetry)
            self.hiccups.append(reason)
            self._stage = "again"
        elif self._stage == "again" and self.telemetry.shown("soar_mode") == READY:
            self._begin_leg(len(self.flown) - 1)
        elif since_s > READY_S:
            words = f"not ready again within {READY_S:g} s: {self.telemetry.words()}"
            raise OperatorError(words, is_of_machine=True)

    def _begin_leg(self, number: int) -> None:
        leg = self._legs[number]
        del self.flown[number:]  # where it is repeated
        self.flown.append(FlownLeg(leg, self.telemetry.time_s))
        self._patient_since_s = self.telemetry.time_s
        self._to_set = leg.to_set()
        self._stage = "move"

    def _wait_for_line(self, flown: FlownLeg) -> None:
        """Errors: `OperatorError` after too long."""
        searches = flown.leg.searches
        limit_s = SEARCH_TIMEOUT_S if searches else LEG_TIMEOUT_S
        before, self._line = self._line, [self.telemetry.shown(name) for name in LINE.values()]
        if not searches and any(abs(a - b) > 0.0 for a, b in zip(before, self._line, strict=True)):
            self._patient_since_s = self.telemetry.time_s  # minutes, over a large hill
        if self.telemetry.time_s - self._patient_since_s <= limit_s:
            return
        what = "no place to soar was found" if searches else "the line did not come to its target"
        raise OperatorError(
            f"leg {flown.leg.name}: {what} within {limit_s:g} s; the module says:"
            f" {self.telemetry.words()}"
        )

    def _line_stands(self, flown: FlownLeg) -> bool:
        return flown.line_stands(self.telemetry, self._engaged_s)

    def _set_next(self, now_s: float) -> None:
        """Send the first set that is due, and drop it once its value is answered."""
        name, value = self._to_set[0]
        if self.telemetry.parameters.get(name) == as_wire_value(value):
            self._to_set.pop(0)
            self._first_sent_s = float("nan")
            self._sent_s = float("-inf")
            if self._to_set:
                self._set_next(now_s)
            return
        if now_s - self._first_sent_s > GIVE_UP_S:
            words = self.telemetry.words()
            raise OperatorError(
                f"PARAM_SET {name} = {value:g} was not confirmed within {GIVE_UP_S:g} s;"
                f" the module says: {words}",
                is_of_machine=name not in words,  # else it is refused
            )
        if now_s - self._sent_s >= RETRY_S:
            if self._first_sent_s != self._first_sent_s:
                self._first_sent_s = now_s
            self._sent_s = now_s
            self._pack(
                self._codec.param_set_encode(
                    *self._target, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
                )
            )

    def _pack(self, message: Any) -> None:
        self._out.append(bytes(message.pack(self._codec)))

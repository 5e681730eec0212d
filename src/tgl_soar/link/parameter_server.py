"""The MAVLink parameter server: what a ground station reads and sets.

Pure logic: a message and the time in, messages out.  A set is checked and applied as one
before the answer is made, and the tick reads `values` only between two messages, so nothing is
ever half applied.

Every parameter is REAL32, with a constant count and indices without gaps.  The answer to a set
is always a PARAM_VALUE with the value that stands after it (or is staged: `line_changes`); a
refused one is followed by a STATUSTEXT with the reason.  Requests for values are remembered as
a set of indices: asking twice costs nothing, and a flood of requests is answered at
`VALUES_PER_S` all the same.

A station that keeps the parameters of a vehicle asks for `_HASH_CHECK` before it asks for all of
them: a number that changes when any of them does, as PX4 answers it.  It is no parameter: it is in
no list, has no index, and is the one answer that is a whole number, as its four bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from struct import pack, unpack
from typing import Final

from tgl_soar.config.line_changes import LineChanges
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.link.component_metadata import checksum_of
from tgl_soar.link.hot_frames import float32
from tgl_soar.link.messages import (
    PARAM_ERROR_DOES_NOT_EXIST,
    PARAM_ERROR_PERMISSION_DENIED,
    PARAM_ERROR_VALUE_OUT_OF_RANGE,
    PARAM_TYPE_REAL32,
    PARAM_TYPE_UINT32,
    SEVERITY_WARNING,
    Inbound,
    Outbound,
    ParamError,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Source,
)
from tgl_soar.link.telemetry import StatusTexts
from tgl_soar.types import isfinite

VALUES_PER_S: Final = 100.0
VALUES_PER_POLL: Final = 2
COMPLAINTS_PER_S: Final = 4.0  # refused sets reported in words; the values are always answered
COMPLAINTS_AT_ONCE: Final = 8.0
HASH: Final = "_HASH_CHECK"
_HASH_INDEX: Final = 65535  # MAVLink's own word for none
_PARAM_TYPES_INTEGER: Final = range(1, 9)
_BY_NAME: Final = tuple(sorted(p.name for p in PARAMETERS))
_EXPONENT: Final = 0x7F80_0000


@dataclass(slots=True)
class ParameterCounters:
    """What the operator did."""

    sets: int = 0
    refused: int = 0
    answered: int = 0


class ParameterServer:
    """Serves one set of parameters to every station that asks."""

    def __init__(
        self,
        own: Source,
        values: ParameterSet,
        texts: StatusTexts | None = None,
        line: LineChanges | None = None,
    ) -> None:
        self.values = values
        self.line = line or LineChanges()
        self.counters = ParameterCounters()
        self._own = own
        self._texts = texts or StatusTexts()
        self._due: dict[int, None] = {}  # indices asked for, in order
        self._next_s = float("-inf")
        self._complaints = COMPLAINTS_AT_ONCE
        self._complained_s = float("-inf")

    def handle(
        self, source: Source, message: Inbound, now_s: float, *, flying: bool
    ) -> list[Outbound]:
        """The answers that are to be sent at once; [] if the message is not for us."""
        if source == self._own or not self._is_for_us(message):
            return []
        if isinstance(message, ParamSet):
            return self._set(source, message, now_s, flying)
        if isinstance(message, ParamRequestRead):
            return self._read(source, message, now_s)
        if isinstance(message, ParamRequestList):
            for index in range(len(PARAMETERS)):
                self._due.setdefault(index)
        return []

    def poll(self, now_s: float) -> list[Outbound]:
        """Values asked for, a few at a time."""
        outbound: list[Outbound] = []
        if not self._due:
            return outbound
        self._next_s = max(self._next_s, now_s - VALUES_PER_POLL / VALUES_PER_S)
        while self._due and self._next_s <= now_s and len(outbound) < VALUES_PER_POLL:
            index = next(iter(self._due))
            del self._due[index]
            outbound.append(self.value_message(index))
            self.counters.answered += 1
            self._next_s += 1.0 / VALUES_PER_S
        return outbound

    def assign(self, name: str, value: float) -> list[Outbound]:
        """A change made by the module itself; it is sent to every station."""
        self.values = self.values.changed({name: value})
        return [self.value_message(INDEX[name])]

    def drop_staged(self) -> list[Outbound]:
        """The module itself drops a staged move: what stands in its place, for every station."""
        answer = self.line.leave(self.values)
        self.values = answer.values
        return [self.value_message(INDEX[name]) for name in answer.reported]

    def refuse(
        self, source: Source, message: ParamSet, reason: str, now_s: float
    ) -> list[Outbound]:
        """A set that its sender may not make, or not now: what stands, and why."""
        if source == self._own or not self._is_for_us(message) or message.param_id not in INDEX:
            return []
        self.counters.sets += 1
        self.counters.refused += 1
        error = _error(source, message.param_id, PARAM_ERROR_PERMISSION_DENIED)
        words = self._complain(f"{message.param_id}: {reason}", now_s, error)
        return [self.value_message(INDEX[message.param_id]), *words]

    @property
    def is_busy(self) -> bool:
        """Whether values that were asked for are still to be sent."""
        return bool(self._due)

    def value_message(self, index: int) -> ParamValue:
        """The value that stands."""
        if index == _HASH_INDEX:
            return self._hash_message()
        name = PARAMETERS[index].name
        value = self.line.shown(self.values, name)
        return ParamValue(
            param_id=name,
            param_value=value,
            param_type=PARAM_TYPE_REAL32,
            param_count=len(PARAMETERS),
            param_index=index,
        )

    def _hash_message(self) -> ParamValue:
        """CRC-32 of all names and values in the order of the names, as PX4 and QGroundControl
        count it: from 0, and not inverted at its end."""
        wire = b"".join(
            name.encode("ascii") + pack("<f", float32(self.line.shown(self.values, name)))
            for name in _BY_NAME
        )
        number = checksum_of(wire)
        if number & _EXPONENT == _EXPONENT:
            number ^= 0x0080_0000  # not a number as a float: it would not arrive as it is
        (as_float,) = unpack("<f", pack("<I", number))
        return ParamValue(
            param_id=HASH,
            param_value=as_float,
            param_type=PARAM_TYPE_UINT32,
            param_count=len(PARAMETERS),
            param_index=_HASH_INDEX,
        )

    def rebase(self) -> None:
        """The clock was changed: what was timed by the old one is reset."""
        self._next_s = float("-inf")
        self._complained_s = float("-inf")
        self._complaints = COMPLAINTS_AT_ONCE

    def _is_for_us(self, message: Inbound) -> bool:
        if not isinstance(message, ParamSet | ParamRequestRead | ParamRequestList):
            return False
        return message.target_system in (0, self._own.system) and message.target_component in (
            0,
            self._own.component,
        )

    def _set(self, source: Source, message: ParamSet, now_s: float, flying: bool) -> list[Outbound]:
        name = message.param_id
        if name == HASH:
            return [self._hash_message()]  # a station that knows them all sends this
        if name not in INDEX:
            # Sent to every component, it may be meant for another one.
            if message.target_component == 0:
                return []
            self.counters.refused += 1
            unknown = _error(source, name, PARAM_ERROR_DOES_NOT_EXIST)
            return self._complain(f"{name}: no such parameter", now_s, unknown)
        self.counters.sets += 1
        refused = _error(source, name, PARAM_ERROR_VALUE_OUT_OF_RANGE)
        try:
            value = _value_of(message)
            answer = self.line.set(self.values, name, value, flying=flying)
        except ParameterError as error:
            self.counters.refused += 1
            return [self.value_message(INDEX[name]), *self._complain(str(error), now_s, refused)]
        self.values = answer.values
        outbound: list[Outbound] = [
            self.value_message(INDEX[reported]) for reported in answer.reported
        ]
        if answer.refusal:
            self.counters.refused += 1
            outbound += self._complain(answer.refusal, now_s, refused)
        elif answer.warning:
            outbound += self._complain(answer.warning, now_s)
        return outbound

    def _read(self, source: Source, message: ParamRequestRead, now_s: float) -> list[Outbound]:
        index = message.param_index
        if index < 0:
            index = _HASH_INDEX if message.param_id == HASH else INDEX.get(message.param_id, -1)
        if 0 <= index < len(PARAMETERS) or (index == _HASH_INDEX and message.param_index < 0):
            self._due.setdefault(index)
            return []
        if message.target_component == 0:
            return []
        asked = message.param_id if message.param_index < 0 else f"index {message.param_index}"
        error = _error(source, message.param_id, PARAM_ERROR_DOES_NOT_EXIST, message.param_index)
        return self._complain(f"{asked}: no such parameter", now_s, error)

    def _complain(self, text: str, now_s: float, error: ParamError | None = None) -> list[Outbound]:
        """A PARAM_ERROR for programs and words for people, unless too many were sent lately."""
        if now_s > self._complained_s:
            earned = (now_s - self._complained_s) * COMPLAINTS_PER_S
            self._complaints = min(COMPLAINTS_AT_ONCE, self._complaints + earned)
            self._complained_s = now_s
        if self._complaints < 1.0:
            return []
        self._complaints -= 1.0
        words = self._texts.chunks(SEVERITY_WARNING, text)
        return [*words] if error is None else [error, *words]


def _error(to: Source, name: str, error: int, index: int = -1) -> ParamError:
    return ParamError(
        target_system=to.system,
        target_component=to.component,
        param_id=name,
        param_index=index,
        error=error,
    )


def _value_of(message: ParamSet) -> float:
    """The number that the station means.

    Sent as an integer type it is either a number turned into a float or the integer's bytes
    put in a float's place: stations differ.  The first gives a whole number, the second one
    that is tiny, huge or none at all; only zero is both.
    """
    value = message.param_value
    if message.param_type == PARAM_TYPE_REAL32:
        return value
    whole = isfinite(value) and value == int(value) and abs(value) < 1e6
    if message.param_type in _PARAM_TYPES_INTEGER and whole:
        return value
    raise ParameterError(message.param_id, f"{value:g}", "send it as REAL32")

"""The flight log: a ULog of the ticks and a `.tlog` of the wire, written while flying.

The loop packs a record for each thing that happens into a buffer that was there from the start,
and hands a full buffer to a thread; the thread alone opens, writes and syncs.  No disk, however
slow, holds up a tick: when no buffer is free, records are dropped, counted, and the gap is
marked with ULog's dropout message.  Whatever the disk refuses is told once, and the flight goes
on without a log.

    ULog     header, formats, what was flown with; parameters; then rows (`declaration`)
    .tlog    for each frame 8 bytes of µs since 1970, big-endian, and the frame

Frames that come are written down only so far as their kind may (`allowance`): a flood of what is
refused is counted and sampled, and costs no older flight.

What was recorded is handed over every half a second and synced every second, so that a loss of
power costs no more.  A log is cut into parts, of which each can be read and replayed by itself:
it begins with all parameters, the state and the inputs as they stand.

ULog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import os
import queue
import struct
import threading
import time
from collections.abc import Callable, Mapping
from math import inf
from os import write
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.config.parameters import PARAMETERS, ParameterSet
from tgl_soar.onboard.flightlog import allowance, files
from tgl_soar.onboard.flightlog.allowance import Allowance
from tgl_soar.onboard.flightlog.declaration import STREAMS, TOPICS, packer, record_size
from tgl_soar.onboard.flightlog.recorder import LinkReport, Recorder
from tgl_soar.onboard.realtime import clock_ns, clock_s
from tgl_soar.types import Inputs, isfinite

BUFFER_BYTES: Final = 65536
BUFFERS: Final = 48  # 3 MB: nearly a minute of a disk that does not answer
FLUSH_S: Final = 0.5
SYNC_S: Final = 1.0
BATCH_TICKS: Final = 8  # packed together: one after the other is faster than each by itself
BATCH_FRAMES: Final = 100  # at most
_FRAMES_PHASE: Final = BATCH_TICKS // 2  # not in the tick that packs ticks
STATE_TICKS: Final = 400  # between two rows of the state
STOP_S: Final = 2.0  # so long the end of the process waits for the disk
STACK_BYTES: Final = 256 * 1024  # memory is locked: a thread's stack of 8 MB would be resident
LARGEST_BYTES: Final = 1_000_000_000  # of all logs together, unless told otherwise
_PARTS: Final = 10  # so many parts make up the largest
_REFUSED: Final = 100  # one part in so many of all logs is the most that refused frames take
FIRST_US: Final = 60_000_000  # of a flight: never deleted while it is flown
FLOOD_TICKS: Final = 2048  # between two words in the log about frames that were left out
_TEXT_CHARS: Final = 8000  # of a file's text in one message

_MAGIC: Final = b"\x55\x4c\x6f\x67\x01\x12\x35\x01"
_HEAD: Final = struct.Struct("<HB")
_SETUP_SIGNING: Final = b"\x00\x01\x00"  # it carries a key: never written down
_STAMP: Final = struct.Struct(">Q").pack
_STAMP_BYTES: Final = 8
SEVERITY_WARNING: Final = 4  # MAVLink's, and so ULog's
_LARGEST_INT: Final = 0x7FFFFFFF
_LARGEST_FLOAT32: Final = 3.4028234e38


class LogMetadata(NamedTuple):
    """What a log says of its flight before it begins."""

    words: Mapping[str, str]  # versions, names, how it was started
    texts: Mapping[str, str]  # whole files


def message(kind: str, body: bytes) -> bytes:
    """One message of a ULog."""
    return _HEAD.pack(len(body), ord(kind)) + body


def _preamble(metadata: LogMetadata) -> bytes:
    """What every part begins with, after its header."""
    made = [message("B", bytes(40))]
    made += [message("F", topic.format.encode()) for topic in TOPICS.values()]
    for key, word in metadata.words.items():
        made.append(message("I", _keyed(key, word.encode()[: BUFFER_BYTES // 2])))
    for key, text in metadata.texts.items():
        for at in range(0, max(1, len(text)), _TEXT_CHARS):
            piece = text[at : at + _TEXT_CHARS].encode()
            made.append(message("M", bytes([at > 0]) + _keyed(key, piece)))
    return b"".join(made)


def _keyed(key: str, value: bytes) -> bytes:
    name = f"char[{len(value)}] {key}".encode()
    return bytes([len(name)]) + name + value


_SUBSCRIPTIONS: Final = b"".join(
    message("A", struct.pack("<BH", 0, topic.number) + topic.name.encode())
    for topic in TOPICS.values()
)


class _Order(NamedTuple):
    """For the thread: a buffer to write, and the file that it belongs to."""

    ending: str  # "ulg" or "tlog"
    buffer: bytearray
    length: int
    begins_us: (
        int  # the buffer begins a new part, at this time of the loop's clock; -1: it does not
    )


_Orders = queue.SimpleQueue[_Order | None]
_Given = TypeVar("_Given")


class _Buffers:
    """Those that are free."""

    def __init__(self, count: int, patient: bool) -> None:
        self._count = count
        self._patient = patient
        self._free: queue.SimpleQueue[bytearray] = queue.SimpleQueue()
        for _ in range(count):
            self._free.put(bytearray(BUFFER_BYTES))

    def take(self) -> bytearray | None:
        """One, if there is one; a patient loop waits for it."""
        try:
            return self._free.get(self._patient, STOP_S)
        except queue.Empty:
            return None

    def give_back(self, buffer: bytearray) -> None:
        self._free.put(buffer)

    @property
    def plenty(self) -> bool:
        """Whether the disk keeps up, or is waited for."""
        return self._patient or self._free.qsize() > self._count // 2


class _Spool:
    """The loop's end of one file: fills buffers and hands them over."""

    def __init__(self, ending: str, free: _Buffers, orders: _Orders) -> None:
        self.ending = ending
        self.buffer = bytearray()  # empty: none is there
        self.at = 0
        self._handed_bytes = 0  # of this part
        self._begins_us = -1
        self._free = free
        self._orders = orders

    @property
    def part_bytes(self) -> int:
        """Of this part so far."""
        return self._handed_bytes + self.at

    def room(self, size: int) -> bool:
        """Whether so much can be put at `at`; a full buffer is handed over for it."""
        if self.at + size <= len(self.buffer):
            return True
        self.hand_over()
        if not self.buffer:
            self.buffer = self._free.take() or bytearray()
        return size <= len(self.buffer)

    def write(self, data: bytes) -> bool:
        """Whether it found room."""
        size = len(data)
        if not self.room(size):
            return False
        self.buffer[self.at : self.at + size] = data
        self.at += size
        return True

    def hand_over(self) -> None:
        """What is there goes to the thread."""
        if self.at > 0:
            self._orders.put(_Order(self.ending, self.buffer, self.at, self._begins_us))
            self._handed_bytes += self.at
            self.buffer, self.at, self._begins_us = bytearray(), 0, -1

    def begin_part(self, time_us: int) -> None:
        """What comes next goes into another file."""
        self.hand_over()
        self._handed_bytes = 0
        self._begins_us = time_us


class FlightRecorder(Recorder):
    """Writes a flight's log into a folder."""

    def __init__(
        self,
        folder: Path,
        metadata: LogMetadata,
        now_s: float,
        *,
        largest_bytes: int = LARGEST_BYTES,
        patient: bool = False,
        unix_s: Callable[[], float] = time.time,
        buffers: int = BUFFERS,
    ) -> None:
        """`now_s`: the loop's clock.  `largest_bytes`: of all logs in the folder.

        `patient`: the loop waits for the disk rather than drop anything; not in an aircraft.
        """
        self.dropped = 0  # ticks and frames: there was no room
        self.ours = Allowance(allowance.OURS)
        self.autopilot = Allowance(allowance.AUTOPILOT)
        self.stations = Allowance(allowance.STATIONS)
        self.refused = Allowance(allowance.REFUSED, largest_bytes // _REFUSED)
        self._left_out_told = 0
        self._flood_due = 0  # the tick from which it is told again
        orders: _Orders = queue.SimpleQueue()
        self._on = True
        self._free = _Buffers(buffers, patient)
        self._rows = _Spool("ulg", self._free, orders)
        self._wire = _Spool("tlog", self._free, orders)
        self._disk = _Disk(folder, _preamble(metadata), largest_bytes, unix_s, self._free, orders)
        self._part_bytes = largest_bytes // _PARTS
        self._unix_offset_us = int(unix_s() * 1e6) - clock_ns() // 1000
        self._ticks = 0
        self._time_us = _microseconds(now_s)
        self._frames: list[tuple[int, bytes]] = []
        self._waiting: list[tuple[int, int, Inputs, Output]] = []
        self._flushed_s = -inf
        self._wire_is_due = False  # to be handed over once its frames are packed
        self._lost_us = -1  # since when ticks are dropped; -1: none are
        self._values: ParameterSet | None = None
        self._last: tuple[Any, ...] = _NOTHING_YET
        self._state: AutopilotState | None = None
        self._state_due = 0

    def start(self) -> None:
        """Begin the thread that writes."""
        self._disk.start()

    @property
    def path(self) -> Path | None:
        """The ULog that is being written; None: none yet."""
        return self._disk.path

    # --- what happens -------------------------------------------------------------------------

    def parameters(self, values: ParameterSet) -> None:
        """The values with which the next tick flies."""
        self._pack_waiting()
        before, self._values = self._values, values
        if before is None:
            self._begin_part()
        elif self._on and self._lost_us < 0 and not self._tell_changes(before, values):
            self._drop(1, self._time_us)

    def tick(self, inputs: Inputs, output: Output, state: AutopilotState) -> None:
        """A tick is done: what it had, what it decided, what it leaves."""
        self._ticks = number = self._ticks + 1
        self._state = state
        if self._on:
            self._time_us = time_us = _microseconds(inputs.time_s)
            self._waiting.append((number, time_us, inputs, output))
            if number % BATCH_TICKS == 0:
                self._pack_waiting()

    def leave_out(self, time_s: float, state: AutopilotState) -> None:
        """A tick is done that there is no time to write down."""
        self._pack_waiting()
        self._ticks += 1
        self._state = state
        self._time_us = _microseconds(time_s)
        if self._on:
            self._drop(1, self._time_us)

    def reset(self, state: AutopilotState) -> None:
        """The next tick begins from this state, whatever the last one left."""
        self._pack_waiting()
        self._state = state
        if self._on and self._rows.room(_STATE_BYTES):
            self._pack(_PACK_STATE, _STATE_BYTES, True, state)
        elif self._on:
            self._drop(1, self._time_us)

    def frame(self, frame: bytes) -> None:
        """A frame of ours went out on any link."""
        self._keep(frame, self.ours)

    def heard(self, link: int, frame: bytes, wanted: bool) -> None:
        """A frame came on a link; one that carries a key is left out."""
        if len(frame) > 9 and frame[8] == 1 and frame[7:10] == _SETUP_SIGNING:
            return
        known = self.autopilot if link == 0 else self.stations
        self._keep(frame, known if wanted else self.refused)

    def _keep(self, frame: bytes, kind: Allowance) -> None:
        """As far as there is room for its kind."""
        if not self._on or not kind.takes(_STAMP_BYTES + len(frame), self._time_us):
            return
        self._frames.append((clock_ns(), frame))
        if len(self._frames) >= BATCH_FRAMES:
            self._pack_frames()

    def text(self, severity: int, text: str) -> None:
        """Words for the operator; MAVLink's severity is ULog's too."""
        if self._on:
            level = ord("0") + max(0, min(7, severity))
            words = text.encode("utf-8", "replace")[:_TEXT_CHARS]
            self._rows.write(message("L", struct.pack("<BQ", level, self._time_us) + words))

    def link(self, report: LinkReport) -> None:
        """How the link did of late."""
        if self._on and self._rows.room(_LINK_BYTES):
            self._pack(_PACK_LINK, _LINK_BYTES, *report)

    def poll(self) -> list[str]:
        """Hand over what is there, every half a second; what is to be told the operator."""
        phase = self._ticks % BATCH_TICKS
        if not self._on or phase not in (0, _FRAMES_PHASE):
            return []
        if phase == _FRAMES_PHASE:
            self._pack_frames()
            if self._wire_is_due and self._free.plenty:
                self._wire.hand_over()
            self._wire_is_due = False
            return []
        if self._disk.trouble:
            self._on = False
            return [*self._disk.said(), f"no flight log: {self._disk.trouble}; flying on"]
        written = self._rows.part_bytes + self._wire.part_bytes
        if written >= self._part_bytes and self._free.plenty:
            self._pack_frames()
            self._begin_part()
        now_s = clock_s()
        if now_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = now_s
            if self._free.plenty:
                self._rows.hand_over()
                self._wire_is_due = True
        return [*self._disk.said(), *self._flooded()]

    @property
    def left_out(self) -> int:
        """Frames that were not written down, for there were too many of their kind."""
        kinds = self.ours, self.autopilot, self.stations, self.refused
        return sum(kind.left_out for kind in kinds)

    def _flooded(self) -> list[str]:
        """What is to be told of frames that are left out: once; the log is told how many."""
        left_out = self.left_out
        if left_out == self._left_out_told or self._ticks < self._flood_due:
            return []
        is_first = self._left_out_told == 0
        self._left_out_told = left_out
        self._flood_due = self._ticks + FLOOD_TICKS
        refused = self.refused.left_out
        self.text(
            SEVERITY_WARNING,
            f"wire: {left_out} frames are not in the .tlog so far, {refused} of them refused or"
            f" of strangers; of these {self.refused.taken} are",
        )
        return ["a flood of frames: the .tlog holds only some of them"] if is_first else []

    def stop(self) -> list[str]:
        """The flight is over: write the rest, unless the disk takes too long."""
        self._pack_waiting()
        self._pack_frames()
        self._flood_due = 0
        self._flooded()
        self._rows.hand_over()
        self._wire.hand_over()
        in_time = self._disk.stop()
        said = self._disk.said()
        if self.left_out:
            said.append(
                f"flight log: {self.left_out} frames of a flood are not in the .tlog,"
                f" {self.refused.left_out} of them refused or of strangers"
            )
        if self._on and self._disk.trouble:
            said.append(f"flight log cut: {self._disk.trouble}")
        elif not in_time:
            said.append(f"flight log cut: {self.path}: the disk does not answer")
        elif self._on and self.path is not None:
            said.append(f"flight log: {self.path}")
        if self.dropped:
            said.append(
                f"flight log: {self.dropped} records are missing: disk or computer were too slow"
            )
        self._on = False
        return said

    # --- rows ---------------------------------------------------------------------------------

    def _pack(self, pack: Callable[..., None], size: int, *values: Any) -> None:
        """One record, where there is room for it; left out if its numbers fit no field."""
        rows = self._rows
        try:
            pack(rows.buffer, rows.at, self._time_us, self._ticks, *values)
        except (struct.error, OverflowError):
            tame = [clamped(value) for value in values]
            try:
                pack(rows.buffer, rows.at, self._time_us, self._ticks, *tame)
            except struct.error:
                self.dropped += 1
                return
        rows.at += size

    def _pack_frames(self) -> None:
        """The frames since the last time."""
        offset_us = self._unix_offset_us
        stamped = [_STAMP(ns // 1000 + offset_us) + frame for ns, frame in self._frames]
        if not self._wire.write(b"".join(stamped)):
            self.dropped += len(stamped)
        self._frames.clear()

    def _pack_waiting(self) -> None:
        """The ticks since the last time, the inputs that have changed before each."""
        rows, waiting = self._rows, self._waiting
        if not waiting:
            return
        if not rows.room(_BATCH_ROOM) or (self._lost_us >= 0 and not self._end_gap(waiting[0][1])):
            self._drop(len(waiting), waiting[0][1])
            waiting.clear()
            return
        buffer, at, last = rows.buffer, rows.at, self._last
        for number, time_us, inputs, output in waiting:
            try:
                for place, pack, size in _PACKED_STREAMS:
                    sample = inputs[place]
                    if sample is not last[place] and sample != last[place]:
                        pack(buffer, at, time_us, number, sample)
                        at += size
                _PACK_TICK(buffer, at, time_us, number, inputs, output)
                at += _TICK_BYTES
            except (struct.error, OverflowError):
                at = self._pack_tame(at, time_us, number, inputs, output)
            last = inputs
        rows.at, self._last = at, last
        self._pack(_PACK_SLOW, _SLOW_BYTES, waiting[-1][3])
        waiting.clear()
        if self._ticks >= self._state_due and self._state is not None:
            self._state_due = self._ticks + STATE_TICKS
            self._pack(_PACK_STATE, _STATE_BYTES, False, self._state)

    def _pack_tame(self, at: int, time_us: int, number: int, inputs: Inputs, output: Output) -> int:
        """A tick with a number that its field cannot hold; where the next one goes."""
        buffer, begin = self._rows.buffer, at
        try:
            for place, pack, size in _PACKED_STREAMS:
                pack(buffer, at, time_us, number, clamped(inputs[place]))
                at += size
            _PACK_TICK(buffer, at, time_us, number, clamped(inputs), clamped(output))
        except struct.error:
            self.dropped += 1
            return begin
        return at + _TICK_BYTES

    def _drop(self, count: int, since_us: int) -> None:
        """There was no room: the log goes on after a gap."""
        self.dropped += count
        if self._lost_us < 0:
            self._lost_us = since_us

    def _begin_part(self) -> None:
        """Another file, that needs none of those before it."""
        self._pack_waiting()
        rows = self._rows
        rows.begin_part(self._time_us)
        self._wire.begin_part(self._time_us)
        assert self._values is not None
        told = (_told(index, value) for index, (_, value) in enumerate(self._values))
        rows.write(b"".join(told) + _SUBSCRIPTIONS)
        self._last = _NOTHING_YET  # the next tick writes all of its inputs
        if self._state is not None:
            self._pack(_PACK_STATE, _STATE_BYTES, False, self._state)

    def _tell_changes(self, before: ParameterSet | None, values: ParameterSet | None) -> bool:
        """The parameters that have changed, or all of them; whether there was room."""
        rows = self._rows
        for index, (declared, value) in enumerate(values or ()):
            if before is not None and before[declared.name] == value:
                continue
            if not (rows.write(_told(index, value)) and rows.room(_PARAMETER_BYTES)):
                return False
            self._pack(_PACK_PARAMETER, _PARAMETER_BYTES, index, value)
        return True

    def _end_gap(self, time_us: int) -> bool:
        """Ticks were dropped: say how long, and begin anew; whether there is room to go on."""
        lost_ms = max(0, min(0xFFFF, (time_us - self._lost_us) // 1000))
        self._rows.write(message("O", struct.pack("<H", lost_ms)))
        self._last = _NOTHING_YET
        self._state_due = 0
        if not (self._tell_changes(None, self._values) and self._rows.room(_BATCH_ROOM)):
            return False
        self._lost_us = -1
        return True


class _Disk:
    """The thread that writes, and all that only it touches."""

    def __init__(
        self,
        folder: Path,
        preamble: bytes,
        largest_bytes: int,
        unix_s: Callable[[], float],
        free: _Buffers,
        orders: _Orders,
    ) -> None:
        self.trouble = ""  # why nothing more is written
        self.path: Path | None = None
        self._folder = folder
        self._preamble = preamble
        self._largest_bytes = largest_bytes
        self._unix_s = unix_s
        self._free = free
        self._orders = orders
        self._flight = 0  # the number of this one
        self._stem: Path | None = None  # of this flight's files
        self._said: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._open: dict[str, int] = {}  # descriptors by ending
        self._parts = {"ulg": 0, "tlog": 0}
        self._begun_us = -1  # the first part
        self._first_parts = 0  # begun in the flight's first minute
        self._synced_s = -inf
        self._worker: threading.Thread | None = None

    def start(self) -> None:
        before = threading.stack_size(STACK_BYTES)
        try:
            self._worker = threading.Thread(target=self._work, name="flight log", daemon=True)
            self._worker.start()
        finally:
            threading.stack_size(before)

    def stop(self) -> bool:
        """Whether all was written in time."""
        self._orders.put(None)
        if self._worker is None:
            return True
        self._worker.join(STOP_S)
        return not self._worker.is_alive()

    def _work(self) -> None:
        while (order := self._orders.get()) is not None:
            if not self.trouble:
                self._try(self._write, order)
            self._free.give_back(order.buffer)
        for ending in tuple(self._open):
            self._try(self._close, ending)

    def _try(self, action: Callable[[_Given], None], given: _Given) -> None:
        """Whatever goes wrong ends the log and nothing else."""
        try:
            action(given)
        except OSError as error:
            self.trouble = f"{error.filename or self.path or self._folder}: {error.strerror}"
        except Exception as error:
            self.trouble = f"{self.path or self._folder}: {error!r}"

    def _write(self, order: _Order) -> None:
        if order.begins_us >= 0:
            self._begin(order.ending, order.begins_us)
        _write_all(self._open[order.ending], memoryview(order.buffer)[: order.length])
        now_s = clock_s()
        if now_s - self._synced_s >= SYNC_S:
            self._synced_s = now_s
            for descriptor in self._open.values():
                os.fsync(descriptor)

    def _begin(self, ending: str, begins_us: int) -> None:
        """The next part of a file."""
        self._close(ending)
        if self._stem is None:
            self._stem = self._name()
        if ending == "ulg":
            if self._parts[ending]:
                self._make_room()
            else:
                self._begun_us = begins_us
            if begins_us - self._begun_us < FIRST_US:
                self._first_parts = self._parts[ending] + 1
        self._parts[ending] += 1
        path = files.part_name(self._stem, self._parts[ending], ending)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._open[ending] = descriptor
        if ending == "ulg":
            self.path = path
            _write_all(descriptor, memoryview(_MAGIC + struct.pack("<Q", begins_us)))
            _write_all(descriptor, memoryview(self._preamble))

    def _name(self) -> Path:
        """This flight's: the number after the last one that is there."""
        self._folder.mkdir(parents=True, exist_ok=True)
        self._flight = 1 + max((file.flight for file in files.kept_in(self._folder)), default=0)
        self._make_room()
        stem = files.flight_name(self._folder, self._flight, self._unix_s())
        stem.parent.mkdir(exist_ok=True)
        return stem

    def _make_room(self) -> None:
        """For the next part; whose logs went for it is told."""
        coming_bytes = self._largest_bytes // _PARTS
        deleted = files.make_room(
            self._folder, self._largest_bytes, coming_bytes, self._flight, self._first_parts
        )
        if deleted:
            first, last = deleted[0].flight, deleted[-1].flight
            whose = f"flight {first}" if first == last else f"flights {first} to {last}"
            self._said.put(f"no room: {len(deleted)} log files of {whose} deleted")

    def said(self) -> list[str]:
        """What is to be told since the last time."""
        words = []
        while not self._said.empty():
            words.append(self._said.get())
        return words

    def _close(self, ending: str) -> None:
        descriptor = self._open.pop(ending, None)
        if descriptor is not None:
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


def _write_all(descriptor: int, data: memoryview) -> None:
    while data:
        written = write(descriptor, data)  # not in the slice: mypyc would call it twice
        data = data[written:]


def _told(index: int, value: float) -> bytes:
    """ULog's own message of a parameter."""
    return _PARAMETER_HEADS[index] + struct.pack("<f", value)


def _parameter_head(name: str) -> bytes:
    key = f"float {name}".encode()
    return _HEAD.pack(len(key) + 5, ord("P")) + bytes([len(key)]) + key


def _microseconds(time_s: float) -> int:
    """A time stamp; 0 for what is none."""
    return int(time_s * 1e6) if 0.0 <= time_s < 1e12 else 0


def clamped(value: Any) -> Any:
    """A value that fits its field: beyond the largest lies infinity."""
    if isinstance(value, tuple):
        tame = map(clamped, value)
        return value._make(tame) if hasattr(value, "_make") else tuple(tame)
    if isinstance(value, float) and isfinite(value) and abs(value) > _LARGEST_FLOAT32:
        return inf if value > 0.0 else -inf
    if isinstance(value, int) and not isinstance(value, bool):
        return max(-_LARGEST_INT - 1, min(_LARGEST_INT, value))
    return value


_PARAMETER_HEADS: Final = tuple(_parameter_head(declared.name) for declared in PARAMETERS)
_PACKED_STREAMS: Final = tuple(
    (Inputs._fields.index(name), packer(name), record_size(name)) for name in STREAMS
)
_NOTHING_YET: Final = (None,) * len(Inputs._fields)
_PACK_TICK, _TICK_BYTES = packer("tick"), record_size("tick")
_PACK_SLOW, _SLOW_BYTES = packer("slow"), record_size("slow")
_PACK_STATE, _STATE_BYTES = packer("state"), record_size("state")
_PACK_LINK, _LINK_BYTES = packer("link"), record_size("link")
_PACK_PARAMETER, _PARAMETER_BYTES = packer("parameter"), record_size("parameter")
_BATCH_ROOM: Final = (
    _SLOW_BYTES
    + _STATE_BYTES
    + BATCH_TICKS * (_TICK_BYTES + sum(size for _, _, size in _PACKED_STREAMS))
)

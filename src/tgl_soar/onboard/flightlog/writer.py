"""The flight log: a ULog of the ticks and a `.tlog` of the wire, written while flying.

The loop packs a record for each thing that happens into a buffer that was there from the start,
and hands a full buffer (`spool`) to a thread (`disk`); the thread alone opens, writes and syncs.
No disk, however slow, holds up a tick: when no buffer is free, records are dropped, counted, and
the gap is marked with ULog's dropout message.  What the disk refuses is reported once, and the
flight goes on without a log.

    ULog     header, formats, what was flown with; parameters; then rows (`topics`)
    .tlog    for each frame 8 bytes of µs since 1970, big-endian, and the frame

Inbound frames are written down only so far as their kind may (`allowance`): a flood of what is
refused is counted and sampled, and costs no older flight.

What was recorded is handed over every half a second and synced every second, so that a loss of
power costs no more.  A log is cut into parts, each of which can be read and replayed by itself:
it begins with all parameters, the state and the inputs as they stand.
"""

from __future__ import annotations

import queue
import struct
import time
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any, Final

from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.onboard.flightlog.allowance import Allowance, WireAllowance
from tgl_soar.onboard.flightlog.disk import PARTS, Disk
from tgl_soar.onboard.flightlog.recorder import LinkReport, Recorder
from tgl_soar.onboard.flightlog.spool import BUFFERS, Buffers, Orders, Spool
from tgl_soar.onboard.flightlog.topics import STREAMS, packer, record_size
from tgl_soar.onboard.flightlog.ulog_messages import (
    SUBSCRIPTIONS,
    TEXT_CHARS,
    LogMetadata,
    message,
    parameter_message,
    preamble_of,
)
from tgl_soar.onboard.realtime import clock_ns, clock_s
from tgl_soar.types import FLOAT32_MAX, Inputs, isfinite

FLUSH_S: Final = 0.5
BATCH_TICKS: Final = 8  # packed together: one after the other is faster than each by itself
BATCH_FRAMES: Final = 100  # at most
_FRAMES_PHASE: Final = BATCH_TICKS // 2  # not in the tick that packs ticks
STATE_TICKS: Final = 400  # between two rows of the state
LARGEST_BYTES: Final = 1_000_000_000  # of all logs together, unless another number is given
FLOOD_TICKS: Final = 2048  # between two messages in the log about frames that were left out

_SETUP_SIGNING: Final = b"\x00\x01\x00"  # it carries a key: never written down
_STAMP: Final = struct.Struct(">Q").pack
_STAMP_BYTES: Final = 8
SEVERITY_WARNING: Final = 4  # MAVLink's, and so ULog's
_LARGEST_INT: Final = 0x7FFFFFFF


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
        self.allowance = WireAllowance(largest_bytes)
        self._left_out_reported = 0
        self._flood_due = 0  # the tick from which it is reported again
        orders: Orders = queue.SimpleQueue()
        self._on = True
        self._free = Buffers(buffers, patient)
        self._rows = Spool("ulg", self._free, orders)
        self._wire = Spool("tlog", self._free, orders)
        self._disk = Disk(folder, preamble_of(metadata), largest_bytes, unix_s, self._free, orders)
        self._part_bytes = largest_bytes // PARTS
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
        """The ULog of the flight, its first part; None: none yet."""
        return self._disk.path

    # --- what happens -------------------------------------------------------------------------

    def parameters(self, values: ParameterSet) -> None:
        """The values with which the next tick flies."""
        self._pack_waiting()
        before, self._values = self._values, values
        if before is None:
            self._begin_part()
        elif self._on and self._lost_us < 0 and not self._write_changes(before, values):
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

    def outbound(self, frame: bytes) -> None:
        """A frame of ours went out on any link."""
        self._keep(frame, self.allowance.ours)

    def inbound(self, link: int, frame: bytes, wanted: bool) -> None:
        """A frame came on a link; one that carries a key is left out."""
        if len(frame) > 9 and frame[8] == 1 and frame[7:10] == _SETUP_SIGNING:
            return
        room = self.allowance
        known = room.autopilot if link == 0 else room.stations
        self._keep(frame, known if wanted else room.refused)

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
            words = text.encode("utf-8", "replace")[:TEXT_CHARS]
            self._rows.write(message("L", struct.pack("<BQ", level, self._time_us) + words))

    def link(self, report: LinkReport) -> None:
        """How the link did of late."""
        if self._on and self._rows.room(_LINK_BYTES):
            self._pack(_PACK_LINK, _LINK_BYTES, *report)

    def poll(self) -> list[str]:
        """Hand over what is there, every half a second; messages for the operator."""
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
            return [*self._disk.messages(), f"no flight log: {self._disk.trouble}; flying on"]
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
        return [*self._disk.messages(), *self._flooded()]

    def _flooded(self) -> list[str]:
        """Messages about frames that are left out: once; the log holds how many."""
        left_out = self.allowance.left_out
        if left_out == self._left_out_reported or self._ticks < self._flood_due:
            return []
        is_first = self._left_out_reported == 0
        self._left_out_reported = left_out
        self._flood_due = self._ticks + FLOOD_TICKS
        self.text(
            SEVERITY_WARNING,
            f"wire: {left_out} frames are not in the .tlog so far, {self.allowance.strangers}",
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
        messages = self._disk.messages()
        if self.allowance.left_out:
            messages.append(self.allowance.summary)
        if self._on and self._disk.trouble:
            messages.append(f"flight log cut: {self._disk.trouble}")
        elif not in_time:
            messages.append(f"flight log cut: {self.path}: the disk does not answer")
        elif self._on and self.path is not None:
            messages.append(f"flight log: {self.path}")
        if self.dropped:
            messages.append(
                f"flight log: {self.dropped} records are missing: disk or computer were too slow"
            )
        self._on = False
        return messages

    # --- rows ---------------------------------------------------------------------------------

    def _pack(self, pack: Callable[..., None], size: int, *values: Any) -> None:
        """One record, where there is room for it; left out if its numbers fit no field."""
        rows = self._rows
        try:
            pack(rows.buffer, rows.at, self._time_us, self._ticks, *values)
        except (struct.error, OverflowError):
            fitting = [clamped(value) for value in values]
            try:
                pack(rows.buffer, rows.at, self._time_us, self._ticks, *fitting)
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
                at = self._pack_fitted(at, time_us, number, inputs, output)
            last = inputs
        rows.at, self._last = at, last
        self._pack(_PACK_SLOW, _SLOW_BYTES, waiting[-1][3])
        waiting.clear()
        if self._ticks >= self._state_due and self._state is not None:
            self._state_due = self._ticks + STATE_TICKS
            self._pack(_PACK_STATE, _STATE_BYTES, False, self._state)

    def _pack_fitted(
        self, at: int, time_us: int, number: int, inputs: Inputs, output: Output
    ) -> int:
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
        declared = (
            parameter_message(index, value) for index, (_, value) in enumerate(self._values)
        )
        rows.write(b"".join(declared) + SUBSCRIPTIONS)
        self._last = _NOTHING_YET  # the next tick writes all of its inputs
        if self._state is not None:
            self._pack(_PACK_STATE, _STATE_BYTES, False, self._state)

    def _write_changes(self, before: ParameterSet | None, values: ParameterSet | None) -> bool:
        """The parameters that have changed, or all of them; whether there was room."""
        rows = self._rows
        for index, (declared, value) in enumerate(values or ()):
            if before is not None and before[declared.name] == value:
                continue
            if not (rows.write(parameter_message(index, value)) and rows.room(_PARAMETER_BYTES)):
                return False
            self._pack(_PACK_PARAMETER, _PARAMETER_BYTES, index, value)
        return True

    def _end_gap(self, time_us: int) -> bool:
        """Ticks were dropped: say how long, and begin again; whether there is room to go on."""
        lost_ms = max(0, min(0xFFFF, (time_us - self._lost_us) // 1000))
        self._rows.write(message("O", struct.pack("<H", lost_ms)))
        self._last = _NOTHING_YET
        self._state_due = 0
        if not (self._write_changes(None, self._values) and self._rows.room(_BATCH_ROOM)):
            return False
        self._lost_us = -1
        return True


def _microseconds(time_s: float) -> int:
    """A time stamp; 0 for what is none."""
    return int(time_s * 1e6) if 0.0 <= time_s < 1e12 else 0


def clamped(value: Any) -> Any:
    """A value that fits its field: beyond the largest lies infinity."""
    if isinstance(value, tuple):
        fitting = map(clamped, value)
        return value._make(fitting) if hasattr(value, "_make") else tuple(fitting)
    if isinstance(value, float) and isfinite(value) and abs(value) > FLOAT32_MAX:
        return inf if value > 0.0 else -inf
    if isinstance(value, int) and not isinstance(value, bool):
        return max(-_LARGEST_INT - 1, min(_LARGEST_INT, value))
    return value


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

"""The log's writer, call by call: when it packs, what it drops, and what it says.

The thread of the disk does not run: what would be written waits in its orders.
"""

from __future__ import annotations

import struct
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tgl_soar.autopilot import AutopilotState, Output, initial_state, step
from tgl_soar.config.parameters import PARAMETERS, ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.onboard.flightlog import writer
from tgl_soar.onboard.flightlog.recorder import LinkReport
from tgl_soar.onboard.flightlog.spool import BUFFERS
from tgl_soar.onboard.flightlog.topics import STREAMS, TOPICS, record_size
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder, clamped
from tgl_soar.types import (
    NO_ATTITUDE,
    NO_FIX,
    AutopilotStatus,
    GlidePolar,
    Inputs,
    RangeSample,
)

METADATA = LogMetadata({}, {})
LAWS = laws_from(ParameterSet(), SoaringFrame(0.0, 0.0, 0.0, 0.0))
FRAME = b"\xfd" + bytes(20)
UNIX_S = 1_700_000_000.0


class Message(NamedTuple):
    kind: str
    body: bytes


def inputs_at(time_s: float) -> Inputs:
    return Inputs(
        time_s=time_s,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False),
        engage=False,
    )


STATE, OUTPUT = step(LAWS, initial_state(), inputs_at(1.0))


class Log:
    """A recorder without its thread, and the loop's clock."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, **options: Any) -> None:
        self.now_s = 50.0
        patch.setattr(writer, "clock_s", lambda: self.now_s)
        patch.setattr(writer, "clock_ns", lambda: round(self.now_s * 1e9))
        self.recorder = FlightRecorder(
            folder, METADATA, 1.0, unix_s=lambda: UNIX_S, **({"buffers": 40} | options)
        )
        self._kept: dict[str, bytes] = {"ulg": b"", "tlog": b""}
        self.begun: list[tuple[str, int]] = []
        self.time_s = 1.0
        self.ticked = 0

    def begins(self) -> Log:
        self.recorder.parameters(ParameterSet())
        return self

    def tick(self, count: int = 1, output: Output = OUTPUT, state: AutopilotState = STATE) -> None:
        for _ in range(count):
            self.ticked += 1
            self.time_s = 1.0 + 0.005 * self.ticked
            self.recorder.tick(inputs_at(self.time_s), output, state)

    def written(self, ending: str = "ulg") -> bytes:
        """All that was packed so far."""
        recorder = self.recorder
        orders = recorder._disk._orders
        while not orders.empty():
            order = orders.get()
            if order is None:  # the end
                continue
            if order.begins_us >= 0:
                self.begun.append((order.ending, order.begins_us))
            self._kept[order.ending] += bytes(order.buffer[: order.length])
            recorder._free.give_back(order.buffer)
        spool = recorder._rows if ending == "ulg" else recorder._wire
        return self._kept[ending] + bytes(spool.buffer[: spool.at])

    def messages(self) -> list[Message]:
        data, at, found = self.written(), 0, []
        while at < len(data):
            size, kind = struct.unpack_from("<HB", data, at)
            found.append(Message(chr(kind), data[at + 3 : at + 3 + size]))
            at += 3 + size
        assert at == len(data)
        return found

    def rows(self, topic: str) -> list[bytes]:
        """The bodies of the rows of a topic, behind its number."""
        number = TOPICS[topic].number
        return [
            m.body[2:]
            for m in self.messages()
            if m.kind == "D" and struct.unpack_from("<H", m.body)[0] == number
        ]

    def frames(self) -> list[tuple[int, bytes]]:
        data, size = self.written("tlog"), 8 + len(FRAME)
        assert len(data) % size == 0
        return [
            (struct.unpack_from(">Q", data, at)[0], data[at + 8 : at + size])
            for at in range(0, len(data), size)
        ]


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Log:
    return Log(tmp_path, monkeypatch)


def stamp(row: bytes) -> int:
    return int(struct.unpack_from("<Q", row)[0])


# --- ticks --------------------------------------------------------------------------------------


def test_ticks_are_packed_by_eights_each_with_its_own_time(log: Log) -> None:
    log.begins().tick(7)
    assert log.rows("tick") == []
    log.tick()
    rows = log.rows("tick")
    assert [stamp(row) for row in rows] == [
        pytest.approx(1e6 + 5000 * i, abs=1) for i in range(1, 9)
    ]
    log.tick(8)
    assert len(log.rows("tick")) == 16
    assert len(log.rows("slow")) == 2
    assert log.recorder.dropped == 0


def test_an_input_is_written_when_it_has_changed(log: Log) -> None:
    log.begins().tick(16)
    assert [len(log.rows(name)) for name in STREAMS] == [1] * len(STREAMS)
    one = inputs_at(2.0)._replace(rangefinder=RangeSample(1, 2.0, 7.0))
    for same in (one, one._replace(rangefinder=RangeSample(1, 2.0, 7.0)), one):
        log.recorder.tick(same, OUTPUT, STATE)
    log.tick(5)
    assert len(log.rows("rangefinder")) == 3  # there, and gone again
    assert len(log.rows("position")) == 1


def test_the_state_is_written_every_400_ticks(log: Log) -> None:
    log.begins().tick(400)
    assert len(log.rows("state")) == 1
    log.tick(16)
    assert len(log.rows("state")) == 2
    log.tick(384)
    assert len(log.rows("state")) == 2
    log.tick(16)
    assert len(log.rows("state")) == 3
    log.recorder.reset(STATE)
    assert len(log.rows("state")) == 4


def test_what_a_busy_computer_leaves_out_is_a_gap_of_its_length(log: Log) -> None:
    log.begins().tick(10)
    log.recorder.leave_out(1.06, STATE)
    assert len(log.rows("tick")) == 10  # what waited is packed before the gap
    for i in range(20):
        log.recorder.leave_out(1.065 + 0.005 * i, STATE)
    assert log.recorder.dropped == 21
    log.ticked = 31
    log.tick(8)  # up to the next eight: the 32nd to 39th
    (gap,) = [m for m in log.messages() if m.kind == "O"]
    assert struct.unpack("<H", gap.body) == (100,)  # from 1.060 s to 1.160 s
    assert len(log.rows("tick")) == 11  # the 32nd alone is packed so far
    log.tick(8)
    assert len(log.rows("tick")) == 19
    # After it everything stands there again: parameters, state and all inputs.
    assert len(log.rows("parameter")) == len(PARAMETERS)
    assert len(log.rows("state")) == 2
    assert len(log.rows("position")) == 2


@pytest.mark.parametrize(("gap_s", "lost_ms"), [(0.5, 500), (70.0, 0xFFFF), (-0.5, 0)])
def test_a_gap_is_reported_in_milliseconds_as_far_as_its_field_goes(
    log: Log, gap_s: float, lost_ms: int
) -> None:
    log.begins().tick(8)
    log.recorder.leave_out(5.0, STATE)
    for _ in range(7):
        log.recorder.tick(inputs_at(5.0 + gap_s), OUTPUT, STATE)
    (gap,) = [m for m in log.messages() if m.kind == "O"]
    assert struct.unpack("<H", gap.body) == (lost_ms,)


def test_a_gap_that_begins_with_the_clock_begins_once(log: Log) -> None:
    log.begins()
    log.recorder.leave_out(0.0, STATE)
    log.recorder.leave_out(0.25, STATE)
    for _ in range(6):
        log.recorder.tick(inputs_at(0.5), OUTPUT, STATE)
    (gap,) = [m for m in log.messages() if m.kind == "O"]
    assert struct.unpack("<H", gap.body) == (500,)


def test_without_a_free_buffer_ticks_are_dropped_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Log(tmp_path, monkeypatch, buffers=2)
    log.begins()
    batches = 0
    while log.recorder.dropped == 0:
        log.tick(8)
        batches += 1
    assert log.recorder.dropped == 8
    log.tick(8)
    assert log.recorder.dropped == 16
    assert len(log.rows("tick")) == 8 * (batches - 1)
    log.tick(8)
    assert log.recorder.dropped == 16
    (gap,) = [m for m in log.messages() if m.kind == "O"]
    assert struct.unpack("<H", gap.body) == (80,)


def test_a_number_that_fits_no_field_costs_one_tick_nothing_else(log: Log) -> None:
    log.begins().tick(3)
    huge = OUTPUT._replace(vehicle=OUTPUT.vehicle._replace(x_m=1e300))
    log.tick(1, huge)
    log.tick(4)
    assert len(log.rows("tick")) == 8
    assert log.recorder.dropped == 0


# --- parameters, words, links -------------------------------------------------------------------


def test_of_parameters_what_has_changed_is_written(log: Log) -> None:
    log.begins().tick(4)
    assert len([m for m in log.messages() if m.kind == "P"]) == len(PARAMETERS)
    log.recorder.parameters(ParameterSet())
    assert log.rows("parameter") == []
    log.recorder.parameters(ParameterSet().changed({"TGL_X": 0.7, "TGL_Z": 1.7}))
    assert len(log.rows("parameter")) == 2
    assert len([m for m in log.messages() if m.kind == "P"]) == len(PARAMETERS) + 2
    assert len(log.rows("tick")) == 4  # the ticks before come before
    log.recorder.leave_out(2.0, STATE)
    log.recorder.parameters(ParameterSet())  # in a gap: at its end all are written
    assert len(log.rows("parameter")) == 2


@pytest.mark.parametrize(("severity", "level"), [(-1, "0"), (0, "0"), (4, "4"), (7, "7"), (8, "7")])
def test_words_have_mavlinks_severity(log: Log, severity: int, level: str) -> None:
    log.begins().tick(1)
    log.recorder.text(severity, "ä" * 5000)
    (body,) = [m.body for m in log.messages() if m.kind == "L"]
    assert chr(body[0]) == level
    assert struct.unpack_from("<Q", body, 1)[0] == pytest.approx(1_005_000, abs=1)
    assert len(body) == 9 + 8000


def test_a_report_of_the_link_is_a_row(log: Log) -> None:
    log.begins()
    values = range(len(LinkReport._fields))
    log.recorder.link(LinkReport._make(values))
    assert len(log.rows("link")) == 1


# --- frames -------------------------------------------------------------------------------------


@pytest.mark.interpreted
def test_frames_have_the_time_of_day_at_which_they_came(log: Log) -> None:
    log.begins()
    log.now_s = 50.25
    log.recorder.outbound(FRAME)
    log.now_s = 51.5
    log.recorder.inbound(0, FRAME, True)
    assert log.frames() == []
    log.tick(4)
    log.recorder.poll()
    begun_us = int(UNIX_S * 1e6)
    assert log.frames() == [(begun_us + 250_000, FRAME), (begun_us + 1_500_000, FRAME)]


def test_a_hundred_frames_are_packed_at_once(log: Log) -> None:
    log.begins()
    for _ in range(99):
        log.recorder.outbound(FRAME)
    assert log.frames() == []
    log.recorder.outbound(FRAME)
    assert len(log.frames()) == 100


def test_each_link_s_frames_are_of_their_kind(log: Log) -> None:
    log.begins()
    room = log.recorder.allowance

    def taken() -> tuple[int, ...]:
        return room.ours.taken, room.autopilot.taken, room.stations.taken, room.refused.taken

    log.recorder.outbound(FRAME)
    assert taken() == (1, 0, 0, 0)
    for link, wanted, found in (
        *((0, True, (1, 1, 0, 0)), (1, True, (1, 1, 1, 0)), (2, True, (1, 1, 2, 0))),
        *((0, False, (1, 1, 2, 1)), (1, False, (1, 1, 2, 2))),
    ):
        log.recorder.inbound(link, FRAME, wanted)
        assert taken() == found


def test_a_frame_costs_its_room_and_that_of_its_stamp(log: Log) -> None:
    log.begins()
    large = bytes(992)
    taken = 0
    while log.recorder.allowance.stations.left_out == 0:
        log.recorder.inbound(1, large, True)
        taken += 1
    assert taken == 201  # of 1000 bytes, 200 of ten seconds' 20 kB, and one too many


@pytest.mark.parametrize(
    ("frame", "kept"),
    [
        (bytes(7) + b"\x00\x01\x00" + bytes(10), False),
        (bytes(7) + b"\x00\x01\x00", False),
        (bytes(7) + b"\x00\x01", True),  # no message: it ends within its number
        (bytes(7) + b"\x01\x01\x00" + bytes(10), True),
        (bytes(7) + b"\x00\x02\x00" + bytes(10), True),
        (bytes(7) + b"\x00\x01\x01" + bytes(10), True),
    ],
)
def test_a_frame_with_a_key_is_never_written_down(log: Log, frame: bytes, kept: bool) -> None:
    log.begins()
    log.recorder.inbound(1, frame, True)
    assert log.recorder.allowance.stations.taken == int(kept)


def test_frames_without_a_free_buffer_are_dropped_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Log(tmp_path, monkeypatch, buffers=1)
    log.begins()
    for _ in range(100):
        log.recorder.outbound(FRAME)
    assert log.recorder.dropped == 100
    for _ in range(5):
        log.recorder.outbound(FRAME)
    log.tick(4)
    log.recorder.poll()
    assert log.recorder.dropped == 105


# --- handing over -------------------------------------------------------------------------------


def handed(log: Log) -> list[str]:
    orders = log.recorder._disk._orders
    found = []
    while not orders.empty():
        order = orders.get()
        assert order is not None
        found.append(order.ending)
    return found


@pytest.mark.interpreted
def test_what_is_there_is_handed_over_every_half_a_second(log: Log) -> None:
    """Rows in the tick that packs ticks, frames four ticks later."""
    log.begins()
    log.recorder.outbound(FRAME)
    for n in range(1, 9):
        log.tick()
        assert log.recorder.poll() == []
        assert handed(log) == (["ulg"] if n == 8 else [])
    log.tick(4)
    log.recorder.poll()
    assert handed(log) == ["tlog"]
    log.now_s += 0.49
    for _ in range(12):
        log.recorder.outbound(FRAME)
        log.tick()
        log.recorder.poll()
    assert handed(log) == []
    log.now_s += 0.02
    log.tick(8)
    log.recorder.poll()
    assert handed(log) == ["ulg"]
    log.tick(4)
    log.recorder.poll()
    assert handed(log) == ["tlog"]


def test_a_disk_that_does_not_keep_up_is_given_full_buffers_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Log(tmp_path, monkeypatch, buffers=2)
    log.begins()
    log.recorder.outbound(FRAME)
    log.tick(8)
    log.recorder.poll()
    assert handed(log) == []


def test_a_part_ends_with_a_tenth_of_all_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Log(tmp_path, monkeypatch, largest_bytes=1_000_000)
    log.begins()
    assert log.recorder._part_bytes == 100_000
    sizes: list[int] = []
    while len(sizes) < 2:
        before = log.recorder._rows.part_bytes + log.recorder._wire.part_bytes
        log.tick(8)
        log.recorder.outbound(FRAME)
        log.recorder.poll()
        now = log.recorder._rows.part_bytes
        log.written()
        if now < before:
            sizes.append(before)
    row = 8 * (record_size("tick") + 2000)
    assert all(100_000 - row < size < 100_000 for size in sizes)
    assert [ending for ending, _ in log.begun].count("ulg") >= 2
    # The next one stands alone.
    assert len([m for m in log.messages() if m.kind == "P"]) == 3 * len(PARAMETERS)


def test_what_the_disk_refuses_is_reported_once_and_the_flight_goes_on(log: Log) -> None:
    log.begins()
    log.recorder._disk.trouble = "/log: no space"
    log.tick(8)
    assert log.recorder.poll() == ["no flight log: /log: no space; flying on"]
    before = log.written()
    log.tick(16)
    log.recorder.outbound(FRAME)
    log.recorder.text(4, "words")
    log.recorder.leave_out(3.0, STATE)
    log.recorder.reset(STATE)
    assert log.recorder.poll() == []
    assert log.written() == before
    assert log.recorder.dropped == 0


def test_a_flood_is_reported_once_and_counted_in_the_log(log: Log) -> None:
    log.begins().tick(8)
    assert log.recorder.poll() == []
    log.recorder.allowance.refused.left_out = 7

    def reported() -> list[bytes]:
        return [m.body for m in log.messages() if m.kind == "L"]

    log.tick(8)
    assert log.recorder.poll() == ["a flood of frames: the .tlog holds only some of them"]
    assert reported()[0].endswith(b"of these 0 are")
    assert chr(reported()[0][0]) == "4"
    assert b"wire: 7 frames" in reported()[0]
    log.tick(8)
    assert log.recorder.poll() == []  # nothing new
    log.recorder.allowance.refused.left_out = 9
    log.tick(2040 - 8)
    assert log.recorder.poll() == []
    assert len(reported()) == 1
    log.tick(8)
    assert log.recorder.poll() == []
    assert b"wire: 9 frames" in reported()[1]


@pytest.mark.interpreted
def test_at_the_end_it_says_where_the_log_is_and_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Log(tmp_path, monkeypatch)
    log.begins().tick(11)
    log.recorder.outbound(FRAME)
    assert log.recorder.stop() == []
    assert len(log.rows("tick")) == 11
    assert len(log.frames()) == 1
    path = tmp_path / "0001.ulg"
    for changes, words in (
        ({"path": path}, f"flight log: {path}"),
        ({"trouble": "no space"}, "flight log cut: no space"),
    ):
        log = Log(tmp_path, monkeypatch)
        for name, value in changes.items():
            setattr(log.recorder._disk, name, value)
        log.recorder.dropped = 3
        assert log.recorder.stop() == [
            words, "flight log: 3 records are missing: disk or computer were too slow"
        ]  # fmt: skip
        assert log.recorder.stop() != [words]  # it is off
    log = Log(tmp_path, monkeypatch)
    monkeypatch.setattr(log.recorder._disk, "stop", lambda: False)
    assert log.recorder.stop() == ["flight log cut: None: the disk does not answer"]


def test_at_the_end_rows_and_frames_go_to_the_disk(log: Log) -> None:
    """What stays in a buffer is in no file."""
    log.begins().tick(11)
    log.recorder.outbound(FRAME)
    log.recorder.stop()
    orders = log.recorder._disk._orders
    found = [orders.get() for _ in range(orders.qsize())]
    assert [order.ending for order in found if order is not None] == ["ulg", "tlog"]
    assert found[-1] is None  # the end, behind them


def test_buffers_are_forty_eight_and_all_logs_a_gigabyte(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0)
    assert recorder._part_bytes == 100_000_000
    taken = 0
    while recorder._free.take() is not None:
        taken += 1
    assert taken == BUFFERS


# --- numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        (1.5, 1.5),
        (3.4e38, 3.4e38),
        (3.5e38, inf),
        (-3.5e38, -inf),
        (inf, inf),
        (2**31 - 1, 2**31 - 1),
        (2**31, 2**31 - 1),
        (-(2**31), -(2**31)),
        (-(2**31) - 1, -(2**31)),
        (True, True),
        ((1e300, 2), (inf, 2)),
    ],
)
def test_a_number_fits_its_field_or_is_the_largest_that_does(given: Any, kept: Any) -> None:
    assert clamped(given) == kept
    assert type(clamped(given)) is type(given)


def test_named_tuples_keep_their_names() -> None:
    polar = GlidePolar(c0=1e300, c1=1.0, c2=nan, c3=0.0, speed_min_mps=-1e300, speed_max_mps=2.0)
    found = clamped(polar)
    assert isinstance(found, GlidePolar)
    assert (found.c0, found.c1, found.speed_min_mps) == (inf, 1.0, -inf)
    assert found.c2 != found.c2


@pytest.mark.parametrize(
    ("time_s", "time_us"), [(1.25, 1_250_000), (0.0, 0), (-1.0, 0), (nan, 0), (1e12, 0), (inf, 0)]
)
def test_what_is_no_time_is_written_as_none(log: Log, time_s: float, time_us: int) -> None:
    log.begins()
    for _ in range(8):
        log.recorder.tick(inputs_at(time_s), OUTPUT, STATE)
    assert [stamp(row) for row in log.rows("tick")] == [time_us] * 8

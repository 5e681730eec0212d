"""Empty, cut, foreign, damaged and clock-jumping logs: what is readable, and the report."""

from __future__ import annotations

import random
import struct
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import flown
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs import tlog
from tgl_soar.analysis.logs.clocks import Straightened
from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.analysis.logs.tlog import _split
from tgl_soar.analysis.logs.ulog_reader import LogError, read_log

Write = Callable[[Path], Path]
WRITERS: dict[str, Write] = {
    "ours": flown.our_log,
    "px4": flown.px4_log,
    "dataflash": flown.dataflash_log,
    "tlog": flown.tlog,
}
every_writer = pytest.mark.parametrize("writer", WRITERS)


def attitudes(flight: FlightData) -> int:
    return 0 if flight.attitude is None else len(flight.attitude)


@pytest.mark.parametrize("data", [b"", b"\0" * 5000, b"not a log at all", b"ULog\x01\x12\x35\x01"])
def test_what_is_no_log_is_refused_by_name(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(data)
    with pytest.raises(LogError, match=r"flight\.ulg"):
        read_flight(path)


def test_a_folder_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_flight(tmp_path)
    with pytest.raises(LogError, match="cannot be read"):
        read_flight(tmp_path / "none.ulg")


def test_a_picture_is_no_log_and_the_known_formats_are_named(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20)
    with pytest.raises(LogError, match=r"known are .*ULog.*DataFlash.*tlog"):
        read_flight(path)


@every_writer
def test_the_name_does_not_matter(tmp_path: Path, writer: str) -> None:
    path = WRITERS[writer](tmp_path)
    other = tmp_path / "flight.txt"
    path.rename(other)
    assert attitudes(read_flight(other)) > 100


@every_writer
def test_a_log_that_breaks_off_is_read_up_to_there(tmp_path: Path, writer: str) -> None:
    path = WRITERS[writer](tmp_path)
    whole = read_flight(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(0.6 * len(data)) + 5])
    cut = read_flight(path)
    assert 0.4 * attitudes(whole) < attitudes(cut) < 0.8 * attitudes(whole)
    assert cut.lost
    assert any("cut off" in text or "whole" in text for text in cut.lost)


@every_writer
def test_damage_in_the_middle_costs_little_more_than_itself(tmp_path: Path, writer: str) -> None:
    path = WRITERS[writer](tmp_path)
    whole = read_flight(path)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 300] = random.Random(1).randbytes(300)
    path.write_bytes(bytes(data))
    damaged = read_flight(path)
    assert attitudes(damaged) > 0.85 * attitudes(whole)  # a wrong length may swallow some
    assert damaged.lost


@pytest.mark.parametrize("jump_s", [-3600.0, -3.0, 7200.0])
@pytest.mark.parametrize("write", [flown.px4_log, flown.dataflash_log])
def test_a_clock_that_is_set_in_flight_is_straightened(
    tmp_path: Path, write: Callable[..., Path], jump_s: float
) -> None:
    boot_us = round(flown.BOOT_S * 1e6)
    jump_us = max(round(jump_s * 1e6), -boot_us - round(flown.LEG_S * 1e6))
    flight = read_flight(write(tmp_path, jump_us=jump_us))
    assert flight.duration_s == pytest.approx(2 * flown.LEG_S, abs=1.5)
    assert any("ran back" in text or "leapt" in text for text in flight.lost)
    whole = read_flight(write(tmp_path))
    assert attitudes(flight) == attitudes(whole)
    for series in flight.series().values():
        assert np.all(np.diff(series.time_s) >= 0.0)


@pytest.mark.parametrize("jump_s", [-600.0, 86_400.0, 1.7e9, -1.7e9])
def test_a_recorders_clock_is_no_matter_where_the_autopilot_tells_its_own(
    tmp_path: Path, jump_s: float
) -> None:
    flight = read_flight(flown.tlog(tmp_path, recorder_jump_us=round(jump_s * 1e6)))
    assert flight.attitude is not None
    assert flight.duration_s == pytest.approx(2 * flown.LEG_S, abs=0.1)
    assert any("recorder's clock leaps" in text for text in flight.lost)


def test_a_newer_ulog_says_that_it_is_newer_or_reads(tmp_path: Path) -> None:
    flight = read_flight(flown.px4_log(tmp_path, version=9))
    assert attitudes(flight) > 100


def test_our_log_of_another_layout_is_read_and_said_to_be_of_another(tmp_path: Path) -> None:
    path = flown.our_log(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"char[1] ver_log2", b"char[1] ver_log9"))
    flight = read_flight(path)
    assert attitudes(flight) > 100
    assert any("layout 9" in text for text in flight.lost)


def test_attitude_alone_is_a_flight_too(tmp_path: Path) -> None:
    others = [name for name in flown.PX4 if name != "vehicle_attitude"]
    flight = read_flight(flown.px4_log(tmp_path, leave_out=others))
    assert set(flight.series()) == {"attitude"}
    assert any("position" in text for text in flight.missing)


def test_data_that_nothing_defines_is_left_out_and_said_to_be(tmp_path: Path) -> None:
    """Among such messages pyulog alone would seek back without end."""
    path = tmp_path / "flight.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8) + b"\0\0R" + b"\x01\0D\0" * 5)
    assert read_log(path).losses == [
        "damaged: 6 messages before the first subscription are left out"
    ]


# --- what the fuzzer found --------------------------------------------------------------------


def dataflash(tmp_path: Path, *kinds: tuple[int, str, str, bytes]) -> FlightData:
    """A log with a record of each kind (number, letters, columns, body), all of them ATT's; of
    `LEVEL` with two, as there is more that is whole than that is damaged."""
    own = flown._format_record(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    parts = [own]
    for number, letters, columns, body in kinds:
        parts.append(flown._format_record(number, 3 + len(body), "ATT", letters, columns))
        parts += [b"\xa3\x95" + bytes([number]) + body] * (2 if body is LEVEL else 1)
    path = tmp_path / "flight.bin"
    path.write_bytes(b"".join(parts))
    return read_flight(path)


ATT = "TimeUS,Roll,Pitch,Yaw"
LEVEL = struct.pack("<Qfff", 1_000_000, 0.0, 90.0, 0.0)


def test_a_column_without_a_name_makes_no_kind_of_record(tmp_path: Path) -> None:
    whole = (129, "Qfff", ATT, LEVEL)
    nameless = (130, "QB", "TimeUS,", bytes(9))
    flight = dataflash(tmp_path, nameless, whole)
    assert attitudes(flight) == 2
    assert flight.lost == ("12 of 325 bytes belong to no whole record: the file is cut off or"
                           " damaged there",)  # fmt: skip


@pytest.mark.parametrize("letters", ["QfZf", "Zfff"])
def test_an_angle_or_a_time_that_is_called_a_text_is_none(tmp_path: Path, letters: str) -> None:
    body = bytes(struct.calcsize("<" + "".join(flown._LETTERS[letter] for letter in letters)))
    flight = dataflash(tmp_path, (129, letters, ATT, body))
    assert flight.attitude is None
    assert "the log holds no attitude" in flight.missing


def test_a_number_described_again_does_not_change_what_came_before(tmp_path: Path) -> None:
    shorter = (129, "QB", "TimeUS,Roll", bytes(9))
    flight = dataflash(tmp_path, (129, "Qfff", ATT, LEVEL), shorter)
    assert flight.attitude is not None
    assert flight.attitude["pitch_rad"] == pytest.approx([np.pi / 2] * 2)


def ulog(tmp_path: Path, topics: dict[str, str], rows: list[tuple[int, bytes]]) -> Path:
    """A log of ours with these topics, and rows of them by number."""
    parts = [b"ULog\x01\x12\x35\x01" + bytes(8), b"\x19\0I\x10char[8] sys_nametgl_soar"]
    for name, fields in topics.items():
        parts.append(flown.ulog_message("F", f"{name}:{fields}".encode()))
    for number, name in enumerate(topics):
        parts.append(flown.ulog_message("A", struct.pack("<BH", 0, number) + name.encode()))
    parts += [flown.ulog_message("D", struct.pack("<H", n) + body) for n, body in rows]
    path = tmp_path / "flight.ulg"
    path.write_bytes(b"".join(parts))
    return path


def test_a_topic_of_parameters_without_its_ticks_tells_no_changes(tmp_path: Path) -> None:
    fields = "uint64_t timestamp;uint16_t index;float value;"
    log = read_log(ulog(tmp_path, {"parameter": fields}, [(0, bytes(14))]))
    assert log.changes == []
    assert len(log.topics["parameter"]["value"]) == 1


ARRAYS = "".join(f"uint8_t[65535] {name};" for name in "abcdefgh")


@pytest.mark.parametrize(
    "topics",
    [
        {"t": ARRAYS},
        {"a": "uint8_t[65535] x;", "t": "a[65535] x;"},
        {"empty": "", "b": "empty[65535] x;", "t": "b[65535] x;"},
        {"t": "t[9] x;"},
        {f"t{i}": f"t{i + 1} x;" for i in range(3000)},
        {"t": "uint8_t[65535] x;nothing y;"},
    ],
    ids=["wide", "nested", "of nothing", "of itself", "deep", "unknown at its end"],
)
def test_a_short_log_takes_little_memory_whatever_it_says_of_itself(
    tmp_path: Path, topics: dict[str, str]
) -> None:
    small = "uint64_t timestamp;float x;"
    rows = [(number, bytes(12)) for number in range(len(topics) + 1)]
    path = ulog(tmp_path, {**topics, "small": small}, rows)
    read_log(path)  # what is imported once is no part of it
    tracemalloc.start()
    log = read_log(path)
    grown = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert set(log.topics) == {"small"}
    # A field of pyulog's is a hundred bytes or two in all its tables, and a byte of the file.
    assert grown < 200_000 + 200 * path.stat().st_size
    assert any("does not fit its rows" in text for text in log.losses)


def test_words_from_before_the_first_sample_make_no_flight_shorter_than_none(
    tmp_path: Path,
) -> None:
    path = ulog(tmp_path, {"tick": "uint64_t timestamp;uint8_t mode;"}, [])
    row = flown.ulog_message("D", struct.pack("<HQB", 0, 20_000_000, 1))
    words = flown.ulog_message("L", b"4" + struct.pack("<Q", 1_000_000) + b"armed")
    path.write_bytes(path.read_bytes() + row + words)
    flight = read_flight(path)
    assert [event.time_s for event in flight.events] == [-19.0]
    assert flight.duration_s == 0.0


def test_memory_that_does_not_suffice_is_not_called_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hungry(*_: object, **__: object) -> None:
        raise MemoryError

    path = ulog(tmp_path, {"small": "uint64_t timestamp;float x;"}, [(0, bytes(12))])
    monkeypatch.setattr("pyulog.ULog", hungry)
    with pytest.raises(MemoryError):
        read_log(path)


def test_one_number_is_subscribed_to_once(tmp_path: Path) -> None:
    """Else each of many subscriptions would be followed for the sake of one row."""
    path = ulog(tmp_path, {"small": "uint64_t timestamp;float x;"}, [(0, bytes(12))])
    again = flown.ulog_message("A", struct.pack("<BH", 1, 0) + b"small")
    path.write_bytes(path.read_bytes() + again * 50 + flown.ulog_message("D", bytes(14)))
    log = read_log(path)
    assert [len(topic["x"]) for topic in log.topics.values()] == [2]
    assert log.losses[0] == "damaged: a subscription to small does not fit its rows"


@every_writer
@settings(max_examples=15)
@given(data=st.data())
def test_no_damage_makes_a_reader_raise_anything_but_its_own_error(
    writer: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = _whole(writer, tmp_path_factory)
    begin = data.draw(st.integers(0, len(whole) - 1))
    length = data.draw(st.integers(1, 4000))
    damaged = bytearray(whole[begin : begin + length] if data.draw(st.booleans()) else whole[:9000])
    for _ in range(data.draw(st.integers(0, 20))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        damaged[:16] = whole[:16]
    path = tmp_path_factory.getbasetemp() / f"damaged_{writer}"
    path.write_bytes(bytes(damaged))
    with suppress(LogError):
        assert read_flight(path).duration_s >= 0.0


_BYTES: dict[str, bytes] = {}


def _whole(writer: str, factory: pytest.TempPathFactory) -> bytes:
    if writer not in _BYTES:
        _BYTES[writer] = WRITERS[writer](factory.mktemp("whole")).read_bytes()
    return _BYTES[writer]


@pytest.mark.parametrize("writer", ["ours", "px4", "dataflash", "tlog"])
def test_a_log_is_read_from_the_disk_once(
    tmp_path: Path, writer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, reads = WRITERS[writer](tmp_path), []
    read_bytes = Path.read_bytes

    def counted(self: Path) -> bytes:
        reads.append(self)
        return read_bytes(self)

    monkeypatch.setattr(Path, "read_bytes", counted)
    read_flight(path)
    assert reads == [path]


def test_damage_in_a_tlog_is_searched_for_frames_and_not_walked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hole of zeros in the middle, as a full or bad card leaves it."""
    whole = _split(WRITERS["tlog"](tmp_path).read_bytes())[0]
    stamped = [us.to_bytes(8, "big") for us in whole.stamp_us]
    frames = [
        time + b"\xfd" + checked + checksum
        for time, checked, checksum in zip(stamped, whole.checked, whole.checksum, strict=True)
    ]
    hole, middle = bytes(1_000_000), len(frames) // 2
    places: list[int] = []
    frame_length = tlog._frame_length

    def counted(data: bytes, head: int) -> int:
        places.append(head)
        return frame_length(data, head)

    monkeypatch.setattr(tlog, "_frame_length", counted)
    found, skipped = _split(b"".join((*frames[:middle], hole, *frames[middle:])))
    assert skipped >= len(hole)
    assert len(frames) - len(found.number) <= 1  # none is lost but that before the hole
    assert len(places) < len(frames) + 20


def test_frames_that_were_recorded_late_do_not_turn_time_back(tmp_path: Path) -> None:
    """Of an autopilot that reports no clock of its own."""
    sender, parts = mavlink.MAVLink(None, 1, 1), []
    for stamp_us in (3_000_000, 1_000_000, 2_900_000, 3_100_000):
        message = mavlink.MAVLink_attitude_message(0, *(0.0,) * 6)
        parts.append(stamp_us.to_bytes(8, "big") + bytes(message.pack(sender)))
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"".join(parts))
    attitude = read_flight(path).attitude
    assert attitude is not None
    assert len(attitude) == 4
    assert np.all(np.diff(attitude.time_s) >= 0.0)


# --- clocks -----------------------------------------------------------------------------------


def test_a_single_stamp_far_off_is_left_out() -> None:
    times = np.arange(0.0, 10.0, 0.1)
    times[40], times[60] = 1e13, 0.0
    clocks = Straightened({"a": times})
    assert len(clocks.rows["a"]) == 98
    assert clocks.time_s["a"][-1] == pytest.approx(9.9)
    assert "2 of 100 samples" in clocks.lost[0]


def test_a_sample_that_came_late_goes_to_its_place() -> None:
    clocks = Straightened({"a": np.array([1.0, 1.1, 1.3, 1.2, 1.4])})
    assert clocks.rows["a"].tolist() == [0, 1, 3, 2, 4]
    assert clocks.lost == []


def test_time_begins_with_the_earliest_sample() -> None:
    """Of two there is no usual pace that time could be continued at."""
    clocks = Straightened({"a": np.array([100.0, 99.0]), "b": np.array([99.5])})
    assert clocks.time_s["a"].tolist() == [0.0, 1.0]
    assert clocks.time_s["b"].tolist() == [0.5]


def test_streams_stay_together_over_a_step_back() -> None:
    """A slow stream steps back by another amount than the fast one, and yet by the same clock."""
    true = {"fast": np.arange(0.0, 20.0, 0.01), "slow": np.arange(0.0, 20.0, 0.7)}
    stamps = {name: np.where(t > 10.0, t - 8.0, t) for name, t in true.items()}
    clocks = Straightened(stamps)
    for name, t in true.items():
        np.testing.assert_allclose(clocks.time_s[name], t, atol=0.011)
    assert len(clocks.lost) == 1

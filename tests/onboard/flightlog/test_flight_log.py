"""The log that a flight leaves: what others read in it, and what becomes of it on a bad disk."""

from __future__ import annotations

import errno
import os
import struct
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logged_flight import AIRFRAME, METADATA, LoggedFlight, logs_in, recorded
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pyulog import ULog

from tgl_soar.analysis.logs.meanings import meaning_of
from tgl_soar.analysis.logs.ulog_reader import FlightLog, LogError, read_log
from tgl_soar.autopilot import initial_state, step
from tgl_soar.config.parameters import PARAMETERS, ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.signing import Signing
from tgl_soar.onboard.flightlog import disk, files
from tgl_soar.onboard.flightlog.allowance import Allowance
from tgl_soar.onboard.flightlog.topics import STREAMS, TOPICS, record_size, unit_of
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata, preamble_of
from tgl_soar.onboard.flightlog.writer import BATCH_TICKS, FLUSH_S, STATE_TICKS, FlightRecorder
from tgl_soar.onboard.module import Onboard
from tgl_soar.types import NO_ATTITUDE, NO_FIX, AutopilotStatus, Inputs

TICK_S = 0.005
TICKS = 799  # of four seconds: the first attitude comes with the second step


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("logs"))


@pytest.fixture(scope="module")
def log(path: Path) -> FlightLog:
    return read_log(path)


def test_a_name_that_is_no_utf8_stands_in_it_with_a_question_mark() -> None:
    written = preamble_of(LogMetadata({"airframe_file": "/a\udcfc.toml"}, {"site": "\udcfc"}))
    assert b"airframe_file/a?.toml" in written
    assert written.endswith(b"char[1] site?")


# --- the declaration and its page -------------------------------------------------------------


@pytest.mark.interpreted
def test_every_field_is_explained() -> None:
    fields = [field for topic in TOPICS.values() for field in topic.fields]
    assert [f"{f.owner or f.name}" for f in fields if not meaning_of(f)] == []
    assert all(f.code for f in fields)


def test_every_length_speed_and_angle_has_a_unit() -> None:
    tick = {field.name: unit_of(field) for field in TOPICS["tick"].fields}
    assert tick["vehicle_x_m"] == "m"
    assert tick["vehicle_pitch_rate_radps"] == "rad/s"
    assert tick["soaring_i"] == "rad"
    assert tick["elevator_i"] == "of full travel"
    assert tick["mode"] == ""


def test_a_minute_of_a_full_flight_is_small() -> None:
    """All that an autopilot sends, at 200 Hz."""
    rates = {"tick": 200.0, "attitude": 200.0, "imu": 200.0, "position": 50.0, "surfaces": 50.0}
    rates |= {"airspeed": 20.0, "autopilot": 1.0, "link": 0.5}
    rates |= {"slow": 200.0 / BATCH_TICKS, "state": 200.0 / STATE_TICKS}
    bytes_a_second = sum(rate * record_size(name) for name, rate in rates.items())
    assert 60.0 * bytes_a_second <= 5.0e6


# --- what is in it ----------------------------------------------------------------------------


def test_pyulog_reads_all_of_it(path: Path) -> None:
    ulog = ULog(str(path))
    rows = {dataset.name: len(dataset.data["timestamp"]) for dataset in ulog.data_list}
    assert rows["tick"] == rows["attitude"] == TICKS
    assert rows["position"] == 199
    assert rows["autopilot"] == 4
    assert ulog.dropouts == []
    assert not ulog.file_corruption
    assert list(ulog.initial_parameters) == [parameter.name for parameter in PARAMETERS]
    assert ulog.initial_parameters["TGL_X"] == np.float32(0.2)
    names = [name for _, name, _ in ulog.changed_parameters]
    assert "TGL_X" in names
    assert ulog.msg_info_dict["sys_name"] == "tgl_soar"
    words = [m.message for m in ulog.logged_messages]
    assert "capturing: engaged" in words
    assert words[-1] == "tgl_soar stopped"


def test_it_holds_what_was_flown(log: FlightLog, tmp_path: Path) -> None:
    """Against the module's own last output, and the same flight flown again."""
    recorder = FlightRecorder(tmp_path, METADATA, 0.0)
    flight = LoggedFlight(recorder)
    flight.run(4.0)
    output = flight.onboard.output
    assert output is not None
    tick = log.topics["tick"]
    assert tick["time_s"][-1] == output.time_s
    assert tick["command_elevator"][-1] == output.command.elevator
    assert tick["vehicle_x_m"][-1] == np.float32(output.vehicle.x_m)
    assert tick["soaring_i"][-1] == np.float32(output.soaring.i)
    assert tick["mode"][-1] == output.mode
    assert tick["line_eta_rad"][-1] == np.float32(output.line.eta_rad)  # from the slow rows
    assert len(tick["line_eta_rad"]) == TICKS
    attitude = log.topics["attitude"]
    assert attitude["qw"][-1] == flight.onboard.session.attitude.qw
    assert log.texts["airframe"] == AIRFRAME.read_text()
    assert log.losses == []
    changed = {change.name: change.value for change in log.changes}
    assert changed["TGL_X"] == flight.onboard.parameters.values["TGL_X"]


def test_the_same_flight_leaves_the_same_log(path: Path, tmp_path: Path) -> None:
    assert recorded(tmp_path).read_bytes() == path.read_bytes()


def test_pymavlink_reads_the_wire(path: Path) -> None:
    wire = path.with_suffix(".tlog")
    reader = mavutil.mavlink_connection(str(wire))
    kinds: dict[str, int] = {}
    while (message := reader.recv_match()) is not None:
        kinds[message.get_type()] = kinds.get(message.get_type(), 0) + 1
    reader.close()
    assert kinds["ATTITUDE_QUATERNION"] == 800  # what came
    assert kinds["RC_CHANNELS_OVERRIDE"] > 600  # what went
    assert kinds["PARAM_SET"] == 2
    assert "BAD_DATA" not in kinds
    year = time.gmtime(int.from_bytes(wire.read_bytes()[:8], "big") / 1e6).tm_year
    assert year == time.gmtime().tm_year


def test_mavlogdump_prints_the_wire(path: Path) -> None:
    """The program itself, as pymavlink installs it."""
    program = Path(sysconfig.get_path("scripts")) / "mavlogdump.py"
    dumped = subprocess.run(
        [sys.executable, program, "--types", "PARAM_SET", path.with_suffix(".tlog")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert dumped.returncode == 0, dumped.stderr
    lines = [line for line in dumped.stdout.splitlines() if ": PARAM_SET {" in line]
    assert ["OP_ENGAGE" in lines[0], "TGL_X" in lines[1]] == [True, True]
    assert len(lines) == 2


def test_a_key_on_the_wire_is_not_written_down(tmp_path: Path) -> None:
    key = bytes(range(1, 33))
    recorder = FlightRecorder(tmp_path, METADATA, 0.0)
    recorder.start()
    flight = LoggedFlight(recorder)
    flight.receive(mavlink.MAVLink_setup_signing_message(1, 191, key, 0), station=True)
    flight.run(0.1)
    recorder.stop()
    (wire,) = logs_in(tmp_path, "tlog")
    assert wire.stat().st_size > 0
    assert key not in wire.read_bytes()


def test_a_number_that_fits_no_float_is_logged_as_infinite(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0)
    recorder.start()
    recorder.parameters(ParameterSet())
    laws, state = laws_from(ParameterSet(), SoaringFrame(0.0, 0.0, 0.0, 0.0)), initial_state()
    fix = NO_FIX._replace(sequence=2**70, time_s=0.0, north_m=1e300)
    inputs = Inputs(
        time_s=0.0,
        position=fix,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False),
        engage=False,
    )
    state, output = step(laws, state, inputs)
    output = output._replace(line=output.line._replace(e_rho_m=-1e300))
    recorder.tick(inputs, output, state)
    recorder.tick(inputs._replace(time_s=0.005), output._replace(mode=1000), state)
    recorder.stop()
    log = read_log(logs_in(tmp_path)[0])
    assert len(log.topics["tick"]["tick"]) == 1  # there is no mode 1000
    assert log.topics["tick"]["e_rho_m"][0] == -inf
    assert log.topics["position"]["sequence"][0] == 2**31 - 1


def test_what_is_received_before_the_first_parameters_ends_no_log(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0)
    recorder.start()
    recorder.inbound(0, b"received", True)
    recorder.parameters(ParameterSet())
    assert "cut" not in " ".join(recorder.stop())
    assert b"received" in logs_in(tmp_path, "tlog")[0].read_bytes()


def test_what_was_on_the_wire_goes_to_the_disk_within_a_second(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0)
    recorder.start()
    LoggedFlight(recorder).run(0.4)
    time.sleep(FLUSH_S)
    LoggedFlight(recorder).run(0.1)
    (wire,) = logs_in(tmp_path, "tlog")
    until_s = time.monotonic() + 5.0
    while wire.stat().st_size == 0 and time.monotonic() < until_s:
        time.sleep(0.01)
    assert wire.stat().st_size > 0
    recorder.stop()


# --- parts, and room on the disk --------------------------------------------------------------


def test_a_long_flight_is_cut_into_parts_that_stand_alone(tmp_path: Path) -> None:
    first = recorded(tmp_path, largest_bytes=2_000_000)
    parts = logs_in(tmp_path)
    assert len(parts) >= 2
    assert parts[0] == first
    assert parts[1].stem == f"{first.stem}_part2"
    last = 0
    for part in parts:
        log = read_log(part)
        ticks = log.topics["tick"]["tick"]
        assert ticks[0] == last + 1  # nothing is lost between them
        last = ticks[-1]
        assert log.topics["state"]["tick"][0] == ticks[0] - 1
        for name in STREAMS:
            assert log.topics[name]["tick"][0] == ticks[0], name
        assert len(log.parameters) == len(list(ParameterSet()))
        assert log.texts["site"]
        assert log.losses == []
    assert last == TICKS
    assert read_log(parts[-1]).parameters["TGL_X"] == np.float32(0.3)


def test_a_log_in_parts_is_named_by_its_first_from_which_all_are_read(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, largest_bytes=2_000_000, patient=True)
    recorder.start()
    LoggedFlight(recorder).run(4.0)
    words = recorder.stop()
    parts = logs_in(tmp_path)
    assert len(parts) >= 2
    assert recorder.path == parts[0]
    assert f"flight log: {parts[0]}" in words


def test_the_oldest_logs_make_room_and_nothing_else_goes(tmp_path: Path) -> None:
    day = tmp_path / "2026-01-01"
    day.mkdir()
    for flight in (1, 2, 3):
        (day / f"10_00_00_flight{flight:03d}.ulg").write_bytes(bytes(400_000))
        (day / f"10_00_00_flight{flight:03d}.tlog").write_bytes(bytes(100_000))
    (day / "notes.txt").write_bytes(bytes(400_000))
    recorded(tmp_path, 0.2, largest_bytes=1_300_000)
    names = {path.name[-14:] for path in logs_in(tmp_path)}
    assert "flight001.ulg"[-14:] not in {name[-13:] for name in names}
    assert (day / "10_00_00_flight003.ulg").exists()
    assert (day / "notes.txt").exists()
    assert any("flight004" in name for name in names)


class Disk(NamedTuple):
    """Of `os.statvfs`."""

    f_bavail: int
    f_frsize: int = 1


@pytest.mark.parametrize(
    ("free", "gone"),
    [
        (5_000_000, []),  # more than the next part needs
        (1_000_000, [1]),  # two parts more would fit: the next one takes 90 % of what is free
        (10_000, [1, 2]),  # half of all that can be had, not all of it
        (0, [1, 2]),
    ],
)
def test_a_full_disk_costs_no_more_old_flights_than_help(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, gone: list[int]
) -> None:
    """Flights 1 to 4 were flown, 5 is being flown, and a part of 1.5 MB is coming."""
    day = tmp_path / "2026-01-01"
    day.mkdir()
    for flight in (1, 2, 3, 4, 5):
        (day / f"10_00_00_flight{flight:03d}.ulg").write_bytes(bytes(800_000))
    monkeypatch.setattr(os, "statvfs", lambda _folder: Disk(free))
    deleted = files.make_room(tmp_path, 1_000_000_000, 1_500_000, 5)
    assert [file.flight for file in deleted] == gone
    assert len(logs_in(tmp_path)) == 5 - len(gone)


def test_a_full_disk_takes_neither_the_last_flight_nor_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded(tmp_path, 0.2)
    monkeypatch.setattr(os, "statvfs", lambda _folder: Disk(0))
    recorded(tmp_path, largest_bytes=2_000_000)
    names = [path.name for path in logs_in(tmp_path)]
    assert any("flight001" in name for name in names)
    assert sum("flight002" in name for name in names) > 1  # with all of its parts


# --- a flood ----------------------------------------------------------------------------------

FLOOD_HZ = 4000  # of frames, while the module flies


def stranger() -> bytes:
    """The longest frame there is, of an unknown system."""
    return longest(mavlink.MAVLink(None, 77, 1))


def longest(codec: Any) -> bytes:
    message = mavlink.MAVLink_statustext_message(6, b"x" * 50, 1, 0)
    filled = mavlink.MAVLink_encapsulated_data_message(1, [7] * 253)
    return bytes(max((message.pack(codec), filled.pack(codec)), key=len))


def wrongly_signed() -> bytes:
    codec = mavlink.MAVLink(None, 1, 1)
    codec.signing.secret_key = bytes(range(2, 34))
    codec.signing.sign_outgoing = True
    codec.signing.timestamp = 2**47
    return longest(codec)


def unknown() -> bytes:
    return bytes((0xFD, 255, 0, 0, 0, 1, 1, 0xFF, 0xEE, 0xDD)) + b"a" * 257


def is_read(onboard: Onboard, link: int) -> bool:
    """Whether the loop would read a link once more in this tick: another than the autopilot's
    has so much of the decoder's work between two ticks, and the rest waits in its socket."""
    while link > 0 and onboard.links.is_waiting(link) and onboard.links.may_read(link):
        onboard.event(b"", 0.0, link)
    return link == 0 or onboard.links.may_read(link)


FLOODS: dict[str, tuple[Callable[[], bytes], bool]] = {
    "of a stranger": (stranger, False),
    "signed with another key": (wrongly_signed, True),
    "unsigned": (stranger, True),
    "of a number that nobody knows": (unknown, False),
}


@pytest.mark.parametrize("link", [0, 1])
@pytest.mark.parametrize("flood", FLOODS)
def test_a_flood_of_what_is_refused_costs_no_earlier_flight(
    tmp_path: Path, flood: str, link: int
) -> None:
    """Four seconds of it leave room in what is not yet taken; the flood alone would be 4 MB."""
    make, is_signed = FLOODS[flood]
    day = tmp_path / "2026-01-01"
    day.mkdir()
    for number in (1, 2):
        (day / f"10_00_00_flight{number:03d}.ulg").write_bytes(bytes(1_000_000))
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, largest_bytes=3_500_000, patient=True)
    recorder.start()
    key = bytes(range(1, 33)) if is_signed else None
    flight = LoggedFlight(recorder, signing=Signing(key, 1.6e9, 0.0), unsigned_autopilot=is_signed)
    flight.onboard.add_link(lambda _frame: True)
    frame = make()
    offered, received = 0, 0
    while flight.world.time_s < 4.0:
        flight.run(TICK_S)
        flight.onboard.idle(flight.world.time_s)  # in lockstep a round of the loop
        waiting = round(TICK_S * FLOOD_HZ)
        offered += waiting
        while waiting and is_read(flight.onboard, link):
            waiting -= 1
            received += 1
            flight.onboard.event(frame, flight.world.time_s, link)
    flight.onboard.stop()
    reported = recorder.stop()
    assert offered * len(frame) > 4_000_000
    assert received * len(frame) > 1_000_000  # several times what the log takes of it
    assert {path.name[-13:-4] for path in logs_in(tmp_path)} >= {"flight001", "flight002"}
    wire = b"".join(path.read_bytes() for path in logs_in(tmp_path, "tlog"))
    assert 10 <= wire.count(frame) <= 60  # a sample, from its beginning to its end
    refused = recorder.allowance.refused
    assert 0 <= refused.taken - wire.count(frame) <= 2  # the operator's own, where they must sign
    assert refused.taken + refused.left_out <= received + 2
    assert flight.console.count("a flood of frames: the .tlog holds only some of them") == 1
    assert any(f"{refused.left_out} of them refused or of strangers" in words for words in reported)
    last = read_log(logs_in(tmp_path)[-1]).words[-1].text
    assert last.startswith(
        f"wire: {recorder.allowance.left_out} frames are not in the .tlog so far, "
    )


def test_what_refused_frames_take_in_all_has_an_end(tmp_path: Path) -> None:
    """However long the flight."""
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, largest_bytes=10_000_000)
    frame = stranger()
    for second in range(3600):
        recorder.allowance.refused.takes(len(frame), second * 1_000_000)
    taken = recorder.allowance.refused.taken
    assert 0.9 * 100_000 < taken * len(frame) <= 100_000


def test_a_frame_finds_room_as_it_is_earned_and_no_more() -> None:
    room = Allowance(100)  # bytes a second: a thousand at once
    assert [room.takes(500, 0) for _ in range(3)] == [True, True, False]
    assert not room.takes(500, 4_900_000)
    assert room.takes(500, 5_000_000)
    assert [room.takes(500, 10**9) for _ in range(3)] == [True, True, False]
    assert not room.takes(500, 0)  # the clock was reset
    assert room.takes(500, 5_000_000)
    assert (room.taken, room.left_out) == (6, 4)


def test_what_flies_is_written_down_to_the_last_frame(path: Path) -> None:
    """The allowances are many times what an honest link brings."""
    reader = mavutil.mavlink_connection(str(path.with_suffix(".tlog")))
    at_s: list[float] = []
    while (message := reader.recv_match(type="ATTITUDE_QUATERNION")) is not None:
        at_s.append(message.time_boot_ms)
    reader.close()
    assert len(set(at_s)) == len(at_s) == 800


def test_the_first_minute_of_a_flight_stays_while_it_is_flown(tmp_path: Path) -> None:
    """Parts 1 to 3 were begun in it; part 4 goes, as do all older flights."""
    day = tmp_path / "2026-01-01"
    day.mkdir()
    for part in ("", "_part2", "_part3", "_part4", "_part5"):
        (day / f"10_00_00_flight002{part}.ulg").write_bytes(bytes(1000))
        (day / f"10_00_00_flight002{part}.tlog").write_bytes(bytes(1000))
    (day / "09_00_00_flight001.ulg").write_bytes(bytes(1000))
    deleted = files.make_room(tmp_path, 10_000, 1000, 2, 3)
    assert [(file.flight, file.part) for file in deleted] == [(1, 1), (2, 4)]
    deleted = files.make_room(tmp_path, 5_000, 1000, 2, 3)  # more than can be had
    assert [(file.flight, file.part) for file in deleted] == [(2, 4), (2, 5), (2, 5)]
    assert [file.part for file in files.kept_in(tmp_path)] == [1, 1, 2, 2, 3, 3]


@pytest.mark.interpreted  # native code holds the constant itself
def test_a_long_flight_in_little_room_keeps_its_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of its own parts, those in the middle go."""
    monkeypatch.setattr(disk, "FIRST_US", 1_000_000)
    recorded(tmp_path, 6.0, largest_bytes=500_000)
    parts = [file.part for file in files.kept_in(tmp_path)]
    assert parts[0] == 1
    assert len(set(parts)) < max(parts)  # some are gone
    first = read_log(logs_in(tmp_path)[0])
    assert first.topics["tick"]["tick"][0] == 1


def test_what_was_deleted_is_reported(tmp_path: Path) -> None:
    day = tmp_path / "2026-01-01"
    day.mkdir()
    for number in (1, 2, 3):
        (day / f"10_00_00_flight{number:03d}.ulg").write_bytes(bytes(500_000))
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, largest_bytes=1_000_000, patient=True)
    recorder.start()
    flight = LoggedFlight(recorder)
    flight.run(0.2)
    reported = [*flight.console, *recorder.stop()]
    assert "no room: 2 log files of flights 1 to 2 deleted" in reported


def test_names_tell_day_and_flight_or_count_where_no_day_is_known(tmp_path: Path) -> None:
    day = time.strftime("%Y-%m-%d", time.gmtime())
    first = recorded(tmp_path, 0.1)
    assert first.parent.name == day
    assert first.stem.endswith("_flight001")
    recorded(tmp_path, 0.1, unix_s=lambda: 0.0)
    assert [path.name for path in logs_in(tmp_path / "undated")] == ["flight002.ulg"]


# --- a bad disk -------------------------------------------------------------------------------


def flown_on(folder: Path) -> tuple[LoggedFlight, FlightRecorder]:
    """A flight whose log meets trouble: it must go on."""
    recorder = FlightRecorder(folder, METADATA, 0.0, patient=True)
    recorder.start()
    flight = LoggedFlight(recorder)
    flight.run(1.5)
    end = time.monotonic() + 5.0
    while not recorder._disk.trouble and time.monotonic() < end:
        time.sleep(0.01)
    flight.run(0.6)
    assert flight.onboard.counters.ticks == 419
    output = flight.onboard.output
    assert output is not None
    assert output.active
    return flight, recorder


def warnings(flight: LoggedFlight) -> list[str]:
    return [line for line in flight.console if "log" in line]


@pytest.mark.parametrize("folder", ["/dev/null/logs", "/proc/logs"])
def test_no_folder_is_reported_once_and_the_flight_goes_on(folder: str) -> None:
    flight, recorder = flown_on(Path(folder))
    (only,) = warnings(flight)
    assert only.startswith("no flight log: ")
    assert folder.split("/")[1] in only
    assert recorder.stop() == []


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EIO])
def test_a_write_that_fails_is_reported_once_and_the_flight_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    written = 0

    def write(descriptor: int, data: Any) -> int:
        nonlocal written
        written += len(data)
        if written > 60_000:
            raise OSError(number, os.strerror(number))
        return os.write(descriptor, data)

    monkeypatch.setattr(disk, "write", write)
    flight, _ = flown_on(tmp_path)
    (only,) = warnings(flight)
    assert os.strerror(number) in only


def test_what_a_limit_on_files_lets_through_can_be_read(tmp_path: Path) -> None:
    """A real limit of the kernel's, in a process of its own."""
    code = (
        "import resource, signal, sys; from pathlib import Path\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "from logged_flight import *\n"
        "recorder = FlightRecorder(Path(sys.argv[1]), METADATA, 0.0, patient=True)\n"
        "recorder.start(); flight = LoggedFlight(recorder); flight.run(3.0)\n"
        "print(flight.onboard.counters.ticks, *flight.console, *recorder.stop(), sep='|')\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        cwd=Path(__file__).parent,
    )
    ticks, *words = run.stdout.strip().split("|")
    assert int(ticks) == 599
    assert len([word for word in words if "File too large" in word]) == 1
    log = read_log(logs_in(tmp_path)[0])
    assert len(log.topics["tick"]["tick"]) > 50
    assert any("cut off" in loss for loss in log.losses)


def test_a_disk_that_does_not_answer_holds_up_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All buffers are full: ticks are dropped, and the log goes on behind a mark."""
    import threading

    gate = threading.Event()

    def write(descriptor: int, data: Any) -> int:
        gate.wait()
        return os.write(descriptor, data)

    monkeypatch.setattr(disk, "write", write)
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, buffers=4)
    recorder.start()
    flight = LoggedFlight(recorder)
    flight.run(3.0)
    assert recorder.dropped > 0
    gate.set()
    end = time.monotonic() + 5.0
    while not recorder._free.plenty and time.monotonic() < end:
        time.sleep(0.01)
    flight.run(0.5)
    reported = recorder.stop()
    assert any("records are missing" in text for text in reported)
    log = read_log(logs_in(tmp_path)[0])
    ticks = log.topics["tick"]["tick"]
    assert ticks[-1] == 699
    (jump,) = np.flatnonzero(np.diff(ticks) > 1)
    after = ticks[jump + 1]
    assert after + BATCH_TICKS - 1 in log.topics["state"]["tick"]
    assert after in log.topics["position"]["tick"]
    assert any("too slow" in loss for loss in log.losses)


# --- damaged logs -----------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(fraction=st.floats(0.0, 1.0))
def test_a_log_cut_anywhere_reads_up_to_the_cut(path: Path, fraction: float) -> None:
    data = path.read_bytes()
    _cut_reads(path, data, int(fraction * len(data)))


def test_a_log_cut_around_any_boundary_reads_up_to_the_cut(path: Path) -> None:
    data = path.read_bytes()
    at, boundaries = 16, []
    while at < len(data):
        boundaries.append(at)
        at += 3 + struct.unpack_from("<H", data, at)[0]
    kinds: dict[int, list[int]] = {}
    for boundary in boundaries:
        kinds.setdefault(data[boundary + 2], []).append(boundary)
    for places in kinds.values():
        for place in places[:2]:
            for cut in (place - 1, place, place + 1, place + 2, place + 3, place + 5):
                _cut_reads(path, data, cut)


def _cut_reads(path: Path, data: bytes, cut: int) -> None:
    shorter = path.with_name("cut.bin")
    shorter.write_bytes(data[:cut])
    if cut < 16:
        with pytest.raises(LogError, match=r"empty|not a ULog"):
            read_log(shorter)
        return
    log = read_log(shorter)
    whole = read_log(path) if cut % 7 == 0 else None
    ticks = log.topics.get("tick", {}).get("tick", np.empty(0))
    assert list(ticks) == list(range(1, len(ticks) + 1))
    # All whole rows are there: what is missing is less than one tick's records.
    before = data[:cut].count(struct.pack("<HBH", record_size("tick") - 3, ord("D"), 0))
    assert len(ticks) >= before - 1
    if whole is not None:
        for name, topic in log.topics.items():
            for key, column in topic.items():
                if name == "tick" and key not in {f.name for f in TOPICS["tick"].fields}:
                    continue  # spread from rows that are cut off too
                same = whole.topics[name][key][: len(column)]
                assert column.tobytes() == same.tobytes()


@settings(max_examples=60, deadline=None)
@given(
    at=st.floats(0.0, 1.0),
    garbage=st.binary(min_size=1, max_size=200) | st.just(bytes(4096)),
    inserted=st.booleans(),
)
def test_a_damaged_log_gives_what_is_left_and_no_traceback(
    path: Path, at: float, garbage: bytes, inserted: bool
) -> None:
    data = path.read_bytes()
    place = 16 + int(at * (len(data) - 16))
    rest = data[place:] if inserted else data[place + len(garbage) :]
    damaged = path.with_name("damaged.bin")
    damaged.write_bytes(data[:place] + garbage + rest)
    try:
        log = read_log(damaged)
    except LogError:
        return
    assert len(log.topics.get("tick", {}).get("tick", ())) <= 801


def test_zeros_at_the_end_are_reported(path: Path, tmp_path: Path) -> None:
    """A file system's usual answer to a loss of power."""
    data = path.read_bytes()
    (tmp_path / "zeros.ulg").write_bytes(data + bytes(30_000))
    log = read_log(tmp_path / "zeros.ulg")
    assert len(log.topics["tick"]["tick"]) == TICKS
    assert log.losses == ["cut off: the last 30000 bytes are no whole message"]


def test_one_bad_byte_in_the_middle_costs_a_few_rows(path: Path, tmp_path: Path) -> None:
    data = bytearray(path.read_bytes())
    at = data.find(struct.pack("<HBH", record_size("tick") - 3, ord("D"), 0), len(data) // 2)
    data[at + 2] = 0xFF
    (tmp_path / "bad.ulg").write_bytes(data)
    log = read_log(tmp_path / "bad.ulg")
    assert len(log.topics["tick"]["tick"]) >= 798
    assert any(loss.startswith("damaged: ") for loss in log.losses)
    assert any("ticks are missing after" in loss for loss in log.losses)


@pytest.mark.parametrize(
    ("data", "why"),
    [(b"", "empty"), (b"MZ" * 100, "not a ULog"), (b"\xfd" * 15, "not a ULog")],
)
def test_a_file_that_is_no_log_is_reported(tmp_path: Path, data: bytes, why: str) -> None:
    (tmp_path / "x.ulg").write_bytes(data)
    with pytest.raises(LogError, match=why):
        read_log(tmp_path / "x.ulg")
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "missing.ulg")


def test_a_clock_that_jumps_is_reported(tmp_path: Path) -> None:
    """The simulator was restarted: the loop's clock goes back, the ticks count on."""
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, patient=True)
    recorder.start()
    recorder.parameters(ParameterSet())
    laws, state = laws_from(ParameterSet(), SoaringFrame(0.0, 0.0, 0.0, 0.0)), initial_state()
    for time_s in (5.0, 5.005, 0.0, 0.005):
        inputs = Inputs(
            time_s=time_s,
            position=NO_FIX,
            attitude=NO_ATTITUDE,
            autopilot=AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False),
            engage=False,
        )
        state, output = step(laws, state, inputs)
        recorder.tick(inputs, output, state)
    recorder.stop()
    log = read_log(logs_in(tmp_path)[0])
    assert list(log.topics["tick"]["time_s"]) == [5.0, 5.005, 0.0, 0.005]
    assert log.losses == ["tick: the clock goes back after 5.005 s, 1 times"]


def test_another_layout_is_reported(path: Path, tmp_path: Path) -> None:
    data = path.read_bytes()
    old, new = b"char[1] ver_log2", b"char[1] ver_log9"
    assert data.count(old) == 1
    (tmp_path / "other.ulg").write_bytes(data.replace(old, new))
    assert "layout 9" in read_log(tmp_path / "other.ulg").losses[0]


def test_ticks_that_a_busy_computer_leaves_out_are_missed_and_marked(tmp_path: Path) -> None:
    recorder = FlightRecorder(tmp_path, METADATA, 0.0, patient=True)
    recorder.start()
    flight = LoggedFlight(recorder)
    flight.run(1.0)
    flight.onboard.load_shedding.value = 1.0
    flight.run(0.5)
    flight.onboard.load_shedding.value = 0.0
    flight.run(0.5)
    recorder.stop()
    log = read_log(logs_in(tmp_path)[0])
    ticks = log.topics["tick"]["tick"]
    assert list(ticks) == [*range(1, 200), *range(300, 400)]
    assert log.losses == [
        "nothing was written for 500 ms: disk or computer were too slow",
        "100 ticks are missing after tick 199",
    ]


def test_the_state_is_kept_now_and_then(log: FlightLog) -> None:
    assert list(log.topics["state"]["tick"])[:4] == [0, 0, BATCH_TICKS, BATCH_TICKS + STATE_TICKS]

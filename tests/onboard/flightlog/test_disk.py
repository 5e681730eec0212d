"""The thread that writes a log: what lies in its files, when it is safe, and what it says."""

from __future__ import annotations

import os
import queue
import stat
import struct
import threading
from pathlib import Path
from typing import Any

import pytest

from tgl_soar.onboard.flightlog import disk, files
from tgl_soar.onboard.flightlog.disk import Disk
from tgl_soar.onboard.flightlog.spool import BUFFER_BYTES, Buffers, Order, Orders

NOON_2026 = 1_795_000_000.0
MINUTE_US = 60_000_000
ULOG = b"ULog\x01\x12\x35"  # how each file of that format begins, before its version
KB = 1000


class Log:
    """Orders as the loop gives them, and the disk that carries them out."""

    def __init__(self, folder: Path, largest_bytes: int = 10_000 * KB) -> None:
        self.orders: Orders = queue.SimpleQueue()
        self.free = Buffers(2, patient=True)
        self.disk = Disk(
            folder, b"preamble", largest_bytes, lambda: NOON_2026, self.free, self.orders
        )

    def order(self, data: bytes, begins_us: int = -1, ending: str = "ulg") -> None:
        """Given, and what lies in the buffer behind it is none of it."""
        buffer = bytearray(data + b"rest")
        self.orders.put(Order(ending, buffer, len(data), begins_us))

    def write(self) -> list[str]:
        """All that was ordered; what is reported of it."""
        self.disk.start()
        assert self.disk.stop()
        return self.disk.messages()


@pytest.fixture
def log(tmp_path: Path) -> Log:
    return Log(tmp_path / "state/logs")


def contents(log: Log) -> dict[str, bytes]:
    """Of all files, by what their names say beyond the hour."""
    assert log.disk.path is not None
    folder = log.disk.path.parents[1]
    return {kept.path.name[9:]: kept.path.read_bytes() for kept in files.kept_in(folder)}


# --- what is written ------------------------------------------------------------------------------


def test_a_log_begins_with_its_header_time_and_preamble_and_goes_on_in_order(log: Log) -> None:
    log.order(b"one", 0)
    log.order(b"two")
    log.order(b"wire", 0, "tlog")
    assert log.write() == []
    written = contents(log)
    assert written == {
        "flight001.ulg": written["flight001.ulg"],
        "flight001.tlog": b"wire",
    }
    assert written["flight001.ulg"].startswith(ULOG)
    assert written["flight001.ulg"][8:] == struct.pack("<Q", 0) + b"preambleonetwo"
    assert log.disk.trouble == ""


def test_each_part_has_a_header_and_a_time_of_its_own_and_the_first_names_the_log(log: Log) -> None:
    for k in range(3):
        log.order(b"rows", 5 + k)
    log.write()
    written = contents(log)
    assert list(written) == ["flight001.ulg", "flight001_part2.ulg", "flight001_part3.ulg"]
    for k, data in enumerate(written.values()):
        assert data[8:] == struct.pack("<Q", 5 + k) + b"preamblerows"
    assert log.disk.path is not None
    assert log.disk.path.name.endswith("flight001.ulg")


def test_the_wires_first_part_names_no_log_and_both_are_counted_alone(log: Log) -> None:
    log.order(b"wire", 0, "tlog")
    log.order(b"rows", 0)
    log.order(b"more", 9, "tlog")
    log.write()
    assert set(contents(log)) == {"flight001.ulg", "flight001.tlog", "flight001_part2.tlog"}
    assert log.disk.path is not None
    assert log.disk.path.suffix == ".ulg"


def test_flights_go_on_from_the_last_that_is_there(tmp_path: Path) -> None:
    (tmp_path / "undated").mkdir()
    for flight in (7, 9):
        (tmp_path / f"undated/flight{flight:03d}.ulg").write_bytes(b"")
    log = Log(tmp_path)
    log.order(b"rows", 0)
    log.write()
    assert [kept.flight for kept in files.kept_in(tmp_path)] == [7, 9, 10]


def test_anybody_may_read_a_log_and_only_its_owner_writes_it(log: Log) -> None:
    before = os.umask(0)
    try:
        log.order(b"rows", 0)
        log.write()
    finally:
        os.umask(before)
    assert log.disk.path is not None
    assert stat.S_IMODE(log.disk.path.stat().st_mode) == 0o644


@pytest.mark.interpreted
def test_what_a_disk_takes_in_pieces_is_written_whole(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk, "write", lambda fd, data: os.write(fd, data[:3]))
    log.order(b"0123456789", 0)
    log.write()
    assert contents(log)["flight001.ulg"].endswith(b"preamble0123456789")


def test_buffers_come_back_to_the_loop(log: Log) -> None:
    taken = [log.free.take() for _ in range(2)]
    for k, buffer in enumerate(taken):
        assert buffer is not None
        log.orders.put(Order("ulg", buffer, 4, -k))
    log.write()
    again = [log.free.take() for _ in range(2)]
    assert [len(each or b"") for each in again] == [BUFFER_BYTES] * 2


# --- a loss of power ------------------------------------------------------------------------------


@pytest.mark.interpreted
def test_files_are_synced_once_a_second_and_as_they_are_closed(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = iter((100.0, 100.9, 101.1, 101.2, 102.2))
    done: list[Any] = []
    monkeypatch.setattr(disk, "clock_s", lambda: next(times))
    for name in ("fsync", "close"):
        monkeypatch.setattr(os, name, lambda _fd, name=name: done.append(name))

    def write(_fd: int, data: Any) -> int:
        done.append("write")
        return len(data)

    monkeypatch.setattr(disk, "write", write)
    log.order(b"rows", 0)
    for _ in range(4):
        log.order(b"rows")
    log.write()
    assert done == [
        *("write", "write", "write", "fsync"),  # header, preamble and rows
        "write",
        *("write", "fsync"),
        "write",
        *("write", "fsync"),
        *("fsync", "close"),
    ]


@pytest.mark.interpreted
def test_a_part_is_synced_and_closed_as_the_next_one_begins(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[int] = []
    real_close = os.close

    def close(fd: int) -> None:
        closed.append(fd)
        real_close(fd)

    monkeypatch.setattr(os, "close", close)
    for k in range(3):
        log.order(b"rows", k)
    log.order(b"wire", 0, "tlog")
    log.write()
    assert len(closed) == 4


# --- trouble --------------------------------------------------------------------------------------


@pytest.mark.interpreted
def test_what_a_disk_refuses_ends_the_log_and_frees_all_that_comes(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[None] = []

    def write(_fd: int, _data: Any) -> int:
        calls.append(None)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(disk, "write", write)
    for _ in range(3):
        log.order(b"rows", 0)
    log.write()
    assert len(calls) == 1
    assert log.disk.trouble.endswith("flight001.ulg: No space left on device")
    assert all(log.free.take() is not None for _ in range(2 + 3))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    log = Log(tmp_path / "file/logs")
    log.order(b"rows", 0)
    log.write()
    assert log.disk.trouble == f"{tmp_path}/file/logs: Not a directory"
    assert log.disk.path is None


def test_a_mistake_of_ours_ends_the_log_and_not_the_thread(log: Log) -> None:
    log.order(b"rows", -1)  # that begins no part, and there is none
    log.write()
    assert "KeyError('ulg')" in log.disk.trouble


# --- room -----------------------------------------------------------------------------------------


class Rooms:
    """What is asked of `files.make_room`, and what it has deleted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *flights: int) -> None:
        self.asked: list[tuple[int, int, int, int]] = []
        self.deleted = [files.Kept(flight, 1, KB, Path("x")) for flight in flights]
        monkeypatch.setattr(files, "make_room", self._make)

    def _make(self, _folder: Path, *numbers: int) -> list[files.Kept]:
        self.asked.append((numbers[0], numbers[1], numbers[2], numbers[3]))
        deleted, self.deleted = self.deleted, []
        return deleted


@pytest.mark.interpreted
def test_before_each_part_there_is_room_made_for_a_tenth_of_all(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And of this flight nothing goes that was begun in its first minute."""
    rooms = Rooms(monkeypatch)
    begun_us = 7_000
    for after_us in (0, MINUTE_US // 2, MINUTE_US - 1, MINUTE_US + 1, 2 * MINUTE_US):
        log.order(b"rows", begun_us + after_us)
        log.order(b"wire", begun_us + after_us, "tlog")
    assert log.write() == []
    largest, coming = 10_000 * KB, 1_000 * KB
    assert rooms.asked == [(largest, coming, 1, first) for first in (0, 1, 2, 3, 3)]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("flights", "words"),
    [
        ((), []),
        ((4,), ["no room: 1 log files of flight 4 deleted"]),
        ((4, 4), ["no room: 2 log files of flight 4 deleted"]),
        ((4, 5, 6), ["no room: 3 log files of flights 4 to 6 deleted"]),
    ],
)
def test_which_flights_lost_logs_is_reported_once(
    log: Log, monkeypatch: pytest.MonkeyPatch, flights: tuple[int, ...], words: list[str]
) -> None:
    Rooms(monkeypatch, *flights)
    log.order(b"rows", 0)
    assert log.write() == words
    assert log.disk.messages() == []


# --- the thread -----------------------------------------------------------------------------------


def test_a_log_that_was_never_begun_is_ended_in_time(log: Log) -> None:
    assert log.disk.stop()


@pytest.mark.interpreted
def test_an_end_that_the_disk_holds_up_is_distinguished_from_one_that_it_does_not(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = threading.Event()
    monkeypatch.setattr(disk, "STOP_S", 0.05)
    monkeypatch.setattr(disk, "write", lambda _fd, data: gate.wait() and len(data))
    log.order(b"rows", 0)
    log.disk.start()
    assert not log.disk.stop()
    gate.set()
    assert log.disk.stop()


def test_its_thread_takes_little_memory_and_others_as_much_as_before(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All memory is locked: the usual 8 MB would be there for nothing."""
    asked: list[int] = []
    real = threading.stack_size
    before = real()

    def stack_size(size: int = 0) -> int:
        asked.append(size)
        return real(size)

    monkeypatch.setattr(threading, "stack_size", stack_size)
    log.disk.start()
    log.disk.stop()
    assert real() == before
    first, last = asked
    assert 32 * 1024 <= first <= 1024 * 1024  # of Python's least, and an eighth of the usual
    assert last == before

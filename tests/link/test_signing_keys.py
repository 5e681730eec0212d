"""The files of key and timestamp: who may read them, what is refused, and when a block of stamps is
written.  The disk's thread runs on simulated time."""

from __future__ import annotations

import errno
import os
import stat
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.messages import Source
from tgl_soar.link.signing import EPOCH_S, LAST_STAMP, TICKS_PER_S, Signing
from tgl_soar.link.signing_keys import (
    DAMAGED,
    UNSIGNED,
    Secret,
    SigningError,
    TimestampFile,
    keep_timestamp,
    load_key,
    peers_of,
    save_key,
    signing_from,
)

KEY, OTHER_KEY = bytes(range(1, 33)), bytes(range(2, 34))
WALL_S = EPOCH_S + 4e8  # some day of 2027
HALF_BLOCK_S, LOOK_S = 2.0, 0.25
AUTOPILOT = Source(1, 1)


def signing() -> Signing:
    return Signing(KEY, WALL_S, 0.0)


def key_in(folder: Path, key: bytes = KEY) -> Path:
    path = folder / "key"
    save_key(path, key)
    return path


def timestamp_in(folder: Path) -> Path:
    return folder / "key.timestamp"


# --- the key -------------------------------------------------------------------------------------


def test_nothing_is_signed_and_nothing_is_allowed_unless_it_is_asked_for(tmp_path: Path) -> None:
    assert Secret() == UNSIGNED
    assert (UNSIGNED.unsigned_autopilot, UNSIGNED.allow_setup) == (False, False)
    ours = signing_from(UNSIGNED, 5.0)
    assert not ours.is_on
    assert ours.key is None
    with pytest.raises(SigningError):
        signing_from(Secret(tmp_path / "none"), 0.0)


def test_a_key_file_s_key_signs_from_now_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "time", lambda: WALL_S)
    ours = signing_from(Secret(key_in(tmp_path)), 100.0)
    assert ours.key == KEY
    assert ours.timestamp == round((WALL_S - EPOCH_S) * TICKS_PER_S)
    ours.advance(103.0)  # of the clock that it was given
    assert ours.timestamp == round((WALL_S + 3.0 - EPOCH_S) * TICKS_PER_S)


@pytest.mark.parametrize("allow", [True, False])
def test_a_key_that_is_there_is_used_whether_another_may_come_or_not(
    tmp_path: Path, allow: bool
) -> None:
    assert signing_from(Secret(key_in(tmp_path), allow_setup=allow), 0.0).key == KEY


def test_where_a_first_key_may_come_over_the_air_none_need_be_there(tmp_path: Path) -> None:
    ours = signing_from(Secret(tmp_path / "key", allow_setup=True), 0.0)
    assert not ours.is_on
    assert TimestampFile(tmp_path / "key").load() == ours.reserved > ours.timestamp


@pytest.mark.parametrize("reserve", [True, False])
def test_a_block_of_stamps_is_reserved_at_the_start_unless_another_process_has_it(
    tmp_path: Path, reserve: bool
) -> None:
    ours = signing_from(Secret(key_in(tmp_path)), 0.0, reserve=reserve)
    assert timestamp_in(tmp_path).exists() == reserve
    assert (ours.reserved < LAST_STAMP) == reserve


def test_a_disk_that_cannot_be_written_keeps_nobody_from_starting(tmp_path: Path) -> None:
    path = key_in(tmp_path)
    (tmp_path / "key.timestamp.new").mkdir()
    ours = signing_from(Secret(path), 0.0)
    assert ours.key == KEY
    assert ours.reserved == LAST_STAMP  # everything is obeyed


@pytest.mark.parametrize("others", [0o040, 0o020, 0o010, 0o004, 0o002, 0o001, 0o077])
def test_a_key_that_anybody_else_may_touch_is_no_secret(tmp_path: Path, others: int) -> None:
    path = key_in(tmp_path)
    path.chmod(0o600 | others)
    words = rf"{path}: others may read or write it \(mode {0o600 | others:04o}\).* chmod 600 {path}"
    with pytest.raises(SigningError, match=words):
        load_key(path)


@pytest.mark.parametrize("mode", [0o400, 0o600, 0o700])
def test_what_its_owner_alone_may_do_with_it_is_no_matter(tmp_path: Path, mode: int) -> None:
    path = key_in(tmp_path)
    path.chmod(mode)
    assert load_key(path) == KEY


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "has 0 bytes; a key has 32"),
        (bytes(31), "has 31 bytes; a key has 32"),
        (b"x" * 33, "has more than 32 bytes; a key has 32"),
        (b"x" * 4000, "has more than 32 bytes; a key has 32"),
        (bytes(32), "all zeros is no key"),
    ],
)
def test_a_file_of_another_size_or_of_zeros_is_no_key(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = key_in(tmp_path, content)
    with pytest.raises(SigningError, match=f"{path}: {words}"):
        load_key(path)


def test_a_missing_key_file_says_how_one_of_32_bytes_is_made(tmp_path: Path) -> None:
    path = tmp_path / "none"
    words = rf"{path}: cannot be read: No such file.*umask 077; head -c 32 /dev/urandom > {path}"
    with pytest.raises(SigningError, match=words):
        load_key(path)


# --- how a file is replaced ----------------------------------------------------------------------


def test_a_new_key_replaces_the_old_one_for_its_owner_alone(tmp_path: Path) -> None:
    path = key_in(tmp_path)
    beside = tmp_path / "key.new"  # a process was killed here: longer, and others may read it
    beside.write_bytes(bytes(100))
    beside.chmod(0o644)
    save_key(path, OTHER_KEY)
    assert path.read_bytes() == OTHER_KEY
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [each.name for each in tmp_path.iterdir()] == ["key"]


def test_a_key_is_its_owner_s_alone_from_its_first_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not only once it has been given its name."""
    modes: list[int] = []
    change = os.fchmod

    def observed(fd: int, mode: int) -> None:
        modes.append(stat.S_IMODE(os.fstat(fd).st_mode))
        change(fd, mode)

    monkeypatch.setattr(os, "fchmod", observed)
    before = os.umask(0)
    try:
        save_key(tmp_path / "key", KEY)
    finally:
        os.umask(before)
    assert modes == [0o600]


def test_a_symbolic_link_at_the_place_is_not_written_through(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious", encoding="ascii")
    (tmp_path / "key.new").symlink_to(victim)
    with pytest.raises(OSError, match="symbolic links"):
        save_key(tmp_path / "key", KEY)
    assert victim.read_text(encoding="ascii") == "precious"


def test_a_disk_that_is_full_leaves_the_old_key_and_nothing_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = key_in(tmp_path)
    closed: list[None] = []
    close = os.close

    def full(_fd: int, _data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    monkeypatch.setattr(os, "close", lambda fd: closed.append(close(fd)))
    with pytest.raises(OSError, match="No space"):
        save_key(path, OTHER_KEY)
    assert len(closed) == 1
    assert load_key(path) == KEY


def test_file_and_folder_are_closed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[bool] = []
    close = os.close

    def observed(fd: int) -> None:
        closed.append(stat.S_ISDIR(os.fstat(fd).st_mode))
        close(fd)

    monkeypatch.setattr(os, "close", observed)
    save_key(tmp_path / "key", KEY)
    assert closed == [False, True]


# --- the timestamp -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "loaded"),
    [
        (b"123456\n", 123456),
        (b"0", 0),
        (b"%d" % (2**48 - 1), 2**48 - 1),
        (b"%d" % 2**48, 2**48 - 1),  # MAVLink has 48 bits for it
        (b"", DAMAGED),
        (b"many", DAMAGED),
        (b"\xff", DAMAGED),
    ],
)
def test_what_is_kept_is_read_and_damage_is_distinguished_from_nothing(
    tmp_path: Path, content: bytes, loaded: int
) -> None:
    file = TimestampFile(tmp_path / "key")
    assert file.load() == 0
    timestamp_in(tmp_path).write_bytes(content)
    assert file.load() == loaded
    assert DAMAGED < 0  # no stamp of any sender


def test_a_file_that_cannot_be_read_is_damaged(tmp_path: Path) -> None:
    timestamp_in(tmp_path).mkdir()
    assert TimestampFile(tmp_path / "key").load() == DAMAGED


def test_a_block_is_four_seconds_and_the_next_is_due_when_half_of_it_is_used(
    tmp_path: Path,
) -> None:
    """A disk may take two seconds to answer."""
    file, ours = TimestampFile(tmp_path / "key"), signing()
    assert not file.is_ahead(ours)  # nothing is known to be on the disk
    file.reserve(ours)
    assert ours.reserved == file.load() == ours.timestamp + round(2 * HALF_BLOCK_S * TICKS_PER_S)
    ours.timestamp += round(HALF_BLOCK_S * TICKS_PER_S)
    assert file.is_ahead(ours)
    ours.timestamp += 1
    assert not file.is_ahead(ours)


def test_at_the_end_of_all_stamps_there_is_no_more_to_reserve(tmp_path: Path) -> None:
    file, ours = TimestampFile(tmp_path / "key"), signing()
    ours.timestamp = LAST_STAMP - 5
    file.reserve(ours)
    assert file.load() == ours.reserved == LAST_STAMP
    assert file.is_ahead(ours)


# --- the disk's thread ---------------------------------------------------------------------------


class Disk(NamedTuple):
    """A thread that is run to its end where it would begin to wait for the process to end."""

    looks_s: list[float]  # how long it has slept each time
    script: list[Callable[[], None]]  # what happens while it sleeps; then the process ends
    daemons: list[bool]
    ended: list[bool]  # that the process ends: it was asked to
    joined_s: list[float]


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    made = Disk(looks_s=[], script=[], daemons=[], ended=[], joined_s=[])

    class Event:
        def wait(self, timeout: float) -> bool:
            made.looks_s.append(timeout)
            if not made.script:
                return True
            made.script.pop(0)()
            return False

        def set(self) -> None:
            made.ended.append(True)

    class Thread:
        def __init__(self, target: Callable[[], None], name: str, daemon: bool) -> None:
            assert name
            self._target = target
            made.daemons.append(daemon)

        def start(self) -> None:
            self._target()

        def join(self, timeout: float) -> None:
            assert made.ended  # or the wait would not end
            made.joined_s.append(timeout)

    monkeypatch.setattr(threading, "Event", Event)
    monkeypatch.setattr(threading, "Thread", Thread)
    return made


def test_in_flight_the_disk_is_written_every_two_seconds_and_is_always_ahead(
    tmp_path: Path, disk: Disk
) -> None:
    ours, path, flight_s = signing(), tmp_path / "key", 40.0
    TimestampFile(path).reserve(ours)
    leads_s: list[float] = []
    kept: set[int] = set()
    complaints: list[str] = []

    def look() -> None:
        on_disk = TimestampFile(path).load()
        assert on_disk == ours.reserved  # never before it is there
        kept.add(on_disk)
        ours.advance(LOOK_S * len(disk.looks_s))
        leads_s.append((on_disk - ours.timestamp) / TICKS_PER_S)

    disk.script.extend([look] * round(flight_s / LOOK_S))
    keep_timestamp(ours, path, complaints.append)
    assert set(disk.looks_s) == {LOOK_S}
    assert min(leads_s) == pytest.approx(HALF_BLOCK_S - LOOK_S, abs=0.01)
    assert flight_s / (HALF_BLOCK_S + LOOK_S) <= len(kept) <= flight_s / HALF_BLOCK_S + 1
    assert TimestampFile(path).load() == ours.timestamp  # at the end the very last one
    assert complaints == []


def test_the_end_waits_two_seconds_for_the_disk_and_no_thread_outlives_the_process(
    tmp_path: Path, disk: Disk
) -> None:
    keep_timestamp(signing(), tmp_path / "key", lambda _: None)()
    assert disk.joined_s == [2.0]
    assert disk.daemons == [True]


def test_without_a_key_file_nothing_is_kept(disk: Disk) -> None:
    keep_timestamp(signing(), None, lambda _: None)()
    assert (disk.daemons, disk.looks_s) == ([], [])


def test_a_disk_that_fails_is_reported_once_and_tried_again(tmp_path: Path, disk: Disk) -> None:
    ours, path, blocked = signing(), tmp_path / "key", tmp_path / "key.timestamp.new"
    blocked.mkdir()
    complaints: list[str] = []
    on_disk: list[int] = []

    def look() -> None:
        on_disk.append(TimestampFile(path).load())

    disk.script.extend((look, look, look, blocked.rmdir, look))
    ours.reserved = ours.timestamp
    keep_timestamp(ours, path, complaints.append)
    (complaint,) = complaints
    assert complaint.startswith("the signing timestamp cannot be kept: ")
    assert "may be accepted again" in complaint
    assert on_disk[:3] == [0, 0, 0]
    assert on_disk[3] > ours.timestamp
    assert TimestampFile(path).load() == ours.timestamp


def test_while_the_disk_fails_every_command_is_obeyed(tmp_path: Path, disk: Disk) -> None:
    """Operators are not shut out by a full disk: nothing waits to be reserved any more."""
    ours = signing()
    (tmp_path / "key.timestamp.new").mkdir()
    ours.reserved = ours.timestamp
    reserved: list[int] = []
    disk.script.extend((lambda: None, lambda: reserved.append(ours.reserved)))
    keep_timestamp(ours, tmp_path / "key", lambda _: None)
    assert reserved == [LAST_STAMP]


# --- peers ---------------------------------------------------------------------------------------


def heartbeat(source: Source, key: bytes | None) -> bytes:
    codec = mavlink.MAVLink(None, source.system, source.component)
    codec.signing.secret_key = key
    codec.signing.sign_outgoing = key is not None
    codec.signing.timestamp = round((WALL_S - EPOCH_S) * TICKS_PER_S)
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(codec))


@pytest.mark.parametrize("excused", [None, AUTOPILOT])
def test_who_signs_and_who_need_not_are_peers_and_nobody_else_is(excused: Source | None) -> None:
    is_peer = peers_of(signing(), excused)
    assert is_peer(heartbeat(AUTOPILOT, None)) == (excused == AUTOPILOT)
    assert is_peer(heartbeat(Source(255, 190), KEY))
    for stranger in (heartbeat(Source(1, 2), None), heartbeat(Source(255, 190), OTHER_KEY), b"hi"):
        assert not is_peer(stranger)

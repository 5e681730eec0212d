"""Signatures, against pymavlink's own; and the files of key and timestamp."""

from __future__ import annotations

import os
import stat
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Heartbeat, Source
from tgl_soar.link.signing import (
    CLOCK_IS_SET_S,
    DISK_S,
    EPOCH_S,
    LAST_STAMP,
    LATEST,
    MAX_STREAMS,
    TICKS_PER_S,
    Signing,
)
from tgl_soar.link.signing_keys import (
    RESERVE_S,
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
WALL_S = EPOCH_S + 1e8
NOW_TICKS = round(1e8 * TICKS_PER_S)


def ticks(time_s: float) -> int:
    return round(time_s * TICKS_PER_S)


def signing(key: bytes | None = KEY) -> Signing:
    return Signing(key, WALL_S, 0.0)


def peer(key: bytes | None = KEY, *, ticks: int = NOW_TICKS, link: int = 3) -> Any:
    codec = mavlink.MAVLink(None, 255, 190)
    codec.signing.secret_key = key
    codec.signing.sign_outgoing = key is not None
    codec.signing.timestamp = ticks
    codec.signing.link_id = link
    return codec


def frame(codec: Any) -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(codec))


def test_what_a_peer_with_the_key_signs_is_let_in() -> None:
    ours, theirs = signing(), peer()
    assert all(ours.accepts(frame(theirs)) for _ in range(10))
    assert ours.counters.good == 10


def test_a_replayed_frame_is_not() -> None:
    ours, theirs = signing(), peer()
    first, second = frame(theirs), frame(theirs)
    assert ours.accepts(second)
    assert not ours.accepts(second)
    assert not ours.accepts(first)
    assert ours.counters.replayed == 2
    assert ours.accepts(frame(theirs))


def test_what_is_unsigned_or_signed_by_others_is_not() -> None:
    ours = signing()
    assert not ours.accepts(frame(peer(None)))
    assert not ours.accepts(frame(peer(OTHER_KEY)))
    good = frame(peer())
    for at in range(len(good)):
        assert not ours.accepts(good[:at] + bytes((good[at] ^ 1,)) + good[at + 1 :]), at
    old = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(peer(None), force_mavlink1=True)
    assert not ours.accepts(bytes(old))
    assert ours.accepts(good)  # none of all that has corrupted the stream


def test_who_is_excused_is_counted_apart_from_who_is_refused() -> None:
    ours = signing()
    plain = frame(peer(None))
    assert [ours.accepts(plain, excused=excused) for excused in (True, False, True)] == [
        True, False, True,
    ]  # fmt: skip
    assert (ours.counters.excused, ours.counters.unsigned, ours.counters.good) == (2, 1, 0)


def test_a_forged_frame_from_the_future_does_not_shut_the_operator_out() -> None:
    ours = signing()
    ours.accepts(frame(peer(OTHER_KEY, ticks=NOW_TICKS + 10**9)))
    assert ours.accepts(frame(peer()))


@pytest.mark.parametrize(("behind_s", "in_time"), [(9.0, True), (11.0, False)])
def test_a_new_stream_may_be_ten_seconds_behind(behind_s: float, in_time: bool) -> None:
    theirs = peer(ticks=NOW_TICKS - ticks(behind_s))
    assert signing().accepts(frame(theirs)) == in_time


def test_the_link_id_is_part_of_the_stream() -> None:
    """A station with two radios counts on each of them by itself."""
    ours = signing()
    assert ours.accepts(frame(peer(link=3, ticks=NOW_TICKS + 500)))
    assert ours.accepts(frame(peer(link=4, ticks=NOW_TICKS + 400)))
    assert not ours.accepts(frame(peer(link=3, ticks=NOW_TICKS + 400)))


def test_streams_of_another_key_are_dropped_with_it() -> None:
    """A station starts again with a new key, and must not be held to what it signed before."""
    ours = signing()
    assert ours.accepts(frame(peer(ticks=NOW_TICKS + ticks(5.0))))
    ours.replace_key(OTHER_KEY, 0)
    assert not ours.accepts(frame(peer(ticks=NOW_TICKS + ticks(6.0))))
    assert ours.accepts(frame(peer(OTHER_KEY, ticks=NOW_TICKS)))


def test_the_same_key_once_more_makes_no_record_good_again() -> None:
    """Stations send a key several times, for it is not acknowledged."""
    ours = signing()
    recorded = frame(peer(ticks=NOW_TICKS + ticks(1.0)))
    assert ours.accepts(recorded)
    ours.replace_key(KEY, NOW_TICKS)
    assert not ours.accepts(recorded)


def received_from(ours: Signing, system: int, stamp: int) -> bool:
    """Whether a heartbeat of a system is let in."""
    codec = peer(ticks=stamp)
    codec.srcSystem = system
    return ours.accepts(frame(codec))


def test_there_is_room_for_so_many_streams_and_no_more() -> None:
    """To forget one of the last 10 s would make records of it good again."""
    ours = signing()
    assert all(received_from(ours, system, NOW_TICKS) for system in range(1, MAX_STREAMS + 1))
    assert not received_from(ours, 200, NOW_TICKS + 1)
    assert received_from(ours, 1, NOW_TICKS + 1)  # one that is known goes on
    ours.advance(30.0)
    late = NOW_TICKS + ticks(30.0)
    assert received_from(ours, 200, late)  # the others are old: what they sent is refused anyway
    assert not received_from(ours, 1, NOW_TICKS + 1)
    assert received_from(ours, 1, late)


# --- what commands ----------------------------------------------------------------------------


COMMANDING: dict[str, Any] = {
    "engage": mavlink.MAVLink_command_long_message(1, 191, 31010, 0, *[0] * 7),
    "engage, as an integer": mavlink.MAVLink_command_int_message(1, 191, 0, 31010, 0, 0, *[0] * 7),
    "parameter": mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9),
    "key": mavlink.MAVLink_setup_signing_message(1, 191, [7] * 32, 0),
}


@pytest.fixture(params=COMMANDING)
def message(request: pytest.FixtureRequest) -> Any:
    return COMMANDING[request.param]


def signed(message: Any, codec: Any) -> bytes:
    return bytes(message.pack(codec))


def test_a_command_must_be_later_than_our_start(message: Any) -> None:
    """A heartbeat need not: an honest station may be some seconds behind."""
    ours, theirs = signing(), peer(ticks=NOW_TICKS - ticks(3.0))
    assert ours.accepts(frame(theirs))
    assert not ours.accepts(signed(message, theirs))
    theirs.signing.timestamp = NOW_TICKS + 1  # it has received ours, or three seconds have passed
    assert ours.accepts(signed(message, theirs))


def test_no_record_of_before_a_restart_is_good_after_it(message: Any) -> None:
    """Whatever the clocks are: of a station ahead of us, of ours, that goes back to 1999."""
    for ahead_s in (-5.0, 0.0, 0.01, 300.0, 1e6):
        before, theirs = signing(), peer(ticks=NOW_TICKS + ticks(ahead_s))
        before.advance(5.0)  # a station that lags began 5 s after us
        theirs.signing.timestamp += ticks(5.0)
        heartbeat, command = frame(theirs), signed(message, theirs)
        assert before.accepts(heartbeat)
        assert before.accepts(command)
        for wall_s in (WALL_S, WALL_S + 5.0, EPOCH_S - 1e9):
            after = Signing(KEY, wall_s, 0.0, kept=before.timestamp)
            assert not after.accepts(heartbeat)
            assert not after.accepts(command)
            theirs.signing.timestamp = after.next_timestamp() + 1  # it receives ours
            assert after.accepts(signed(message, theirs))


def test_a_command_held_back_on_its_way_is_too_old(message: Any) -> None:
    """It is jammed, recorded, and sent a minute later to a module that flies."""
    ours, theirs = signing(), peer(ticks=NOW_TICKS + 1)
    assert ours.accepts(frame(theirs))
    held_back = signed(message, theirs)
    ours.advance(9.0)
    assert ours.accepts(held_back)
    held_back = signed(message, theirs)
    ours.advance(60.0)
    assert not ours.accepts(held_back)
    assert ours.accepts(frame(theirs))  # what does not command may come as late as it likes


def test_a_slow_clock_shuts_no_operator_out_in_flight(message: Any) -> None:
    """Another station is 400 s ahead and takes our stamp with it; this one never follows."""
    ours, theirs = signing(), peer(ticks=NOW_TICKS + 1)
    assert ours.accepts(frame(theirs))
    assert received_from(ours, 200, NOW_TICKS + ticks(400.0))
    for now_s in (1.0, 20.0, 100.0):
        ours.advance(now_s)
        theirs.signing.timestamp = NOW_TICKS + ticks(now_s)
        assert ours.accepts(signed(message, theirs)), now_s


def test_a_station_that_only_counts_on_from_ahead_of_us_is_received(message: Any) -> None:
    """pymavlink looks at its clock once, and from then on adds one with each frame."""
    ours, theirs = signing(), peer(ticks=NOW_TICKS + ticks(400.0))
    for now_s in (0.0, 60.0, 300.0):
        ours.advance(now_s)
        assert ours.accepts(signed(message, theirs)), now_s


def test_a_command_waits_until_its_stamp_is_on_the_disk(message: Any, tmp_path: Path) -> None:
    """From a station that is far ahead; the frame that came too early is not good later."""
    file = TimestampFile(tmp_path / "key")
    ours, theirs = signing(), peer(ticks=NOW_TICKS + ticks(300.0))
    file.reserve(ours)
    assert file.is_ahead(ours)
    command = signed(message, theirs)
    assert not ours.accepts(command)
    assert ours.counters.early == 1
    assert not file.is_ahead(ours)
    file.reserve(ours)
    assert not ours.accepts(command)
    assert ours.accepts(signed(message, theirs))
    assert file.load() >= theirs.signing.timestamp


def test_a_disk_that_does_not_answer_shuts_nobody_out_for_long(message: Any) -> None:
    ours, theirs = signing(), peer(ticks=NOW_TICKS + ticks(20.0))
    for begun_s in (2.0, 30.0):  # each time again
        ours.reserved = NOW_TICKS + ticks(begun_s - 1.0)
        ours.advance(begun_s)
        assert not ours.accepts(signed(message, theirs))
        ours.advance(begun_s + DISK_S + 0.1)
        assert ours.accepts(signed(message, theirs))
        assert ours.accepts(frame(theirs))
        ours.reserved = LAST_STAMP  # it has answered
        ours.advance(begun_s + 1.0)
        theirs.signing.timestamp += ticks(20.0)


def test_what_does_not_command_waits_for_no_disk() -> None:
    ours = signing()
    ours.reserved = NOW_TICKS
    assert ours.accepts(frame(peer(ticks=NOW_TICKS + ticks(20.0))))


def test_our_timestamp_is_the_latest_of_wall_clock_peers_and_file() -> None:
    ours = signing()
    assert ours.timestamp == NOW_TICKS
    ours.advance(2.0)
    assert ours.timestamp == NOW_TICKS + 2 * TICKS_PER_S
    ours.accepts(frame(peer(ticks=NOW_TICKS + 10 * TICKS_PER_S)))
    assert ours.timestamp == NOW_TICKS + 10 * TICKS_PER_S
    ours.advance(1.0)
    assert ours.next_timestamp() == NOW_TICKS + 10 * TICKS_PER_S + 1
    without_a_clock = Signing(KEY, EPOCH_S - 1e9, 0.0, kept=77)
    assert without_a_clock.next_timestamp() == 78


DAMAGED = (2**48 - 1, NOW_TICKS + 20 * 366 * 86_400 * TICKS_PER_S, -1)


@pytest.mark.parametrize("kept", DAMAGED)
def test_a_damaged_timestamp_does_not_mute_us(kept: int) -> None:
    ours = Signing(KEY, CLOCK_IS_SET_S + 1e7, 0.0, kept=kept)
    assert ours.kept_is_damaged
    now = round((CLOCK_IS_SET_S + 1e7 - EPOCH_S) * TICKS_PER_S)
    assert ours.timestamp == now
    assert ours.accepts(frame(peer(ticks=now)))  # no frame is taken for a replay
    encoder = Encoder(Source(1, 191), ours, 0)
    assert peer(ticks=now).decode(
        bytearray(
            encoder.encode(
                Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
            )
        )
    )


def test_a_peer_s_clock_that_is_years_ahead_is_not_taken_over() -> None:
    ours = Signing(KEY, CLOCK_IS_SET_S, 0.0)
    before = ours.timestamp
    assert ours.accepts(frame(peer(ticks=2**48 - 5)))  # it has the key
    ours.replace_key(OTHER_KEY, 2**48 - 1)
    assert ours.timestamp == before


def test_without_a_clock_all_but_the_end_of_the_bits_is_accepted() -> None:
    later = round((CLOCK_IS_SET_S + 1e9 - EPOCH_S) * TICKS_PER_S)  # 2057
    assert Signing(KEY, 0.0, 0.0, kept=later).timestamp == later
    assert Signing(KEY, 0.0, 0.0, kept=LATEST + 1).kept_is_damaged


def test_pymavlink_accepts_what_we_sign_and_our_decoder_what_it_signs() -> None:
    ours = signing()
    theirs = peer()
    encoders = [Encoder(Source(1, 191), ours, 0), Encoder(Source(255, 191), ours, 0)]
    for i in range(20):
        made = encoders[i % 2].encode(
            Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
        )
        assert theirs.decode(bytearray(made)).get_signed()
    decoder = Decoder(stream=False, accept=ours.accepts)
    assert len(decoder.feed(frame(theirs) + frame(peer(OTHER_KEY)) + frame(theirs))) == 2
    assert decoder.counters.refused == 1


def test_without_a_key_all_is_let_in_and_nothing_signed() -> None:
    ours = signing(None)
    assert ours.accepts(frame(peer(None)))
    assert (
        len(
            Encoder(Source(1, 191), ours).encode(
                Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4)
            )
        )
        == 21
    )


def test_a_listener_takes_only_who_signs_for_its_peer() -> None:
    is_peer = peers_of(signing(), Source(1, 1))
    assert is_peer(frame(peer()))
    assert not is_peer(frame(peer(None)))
    assert not is_peer(frame(peer(ticks=NOW_TICKS - ticks(11.0))))  # a record
    assert not is_peer(b"hello")
    autopilot = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
    assert is_peer(bytes(autopilot.pack(mavlink.MAVLink(None, 1, 1))))


def test_a_recorded_frame_takes_no_place() -> None:
    ours, theirs = signing(), peer()
    is_peer, recorded = peers_of(ours, None), frame(theirs)
    assert is_peer(recorded)
    assert is_peer(recorded)  # to ask stores nothing
    assert ours.accepts(recorded)
    assert not is_peer(recorded)
    assert is_peer(frame(theirs))
    assert not is_peer(frame(peer(ticks=NOW_TICKS - 61 * TICKS_PER_S, link=4)))


# --- files ------------------------------------------------------------------------------------


def test_a_key_file_is_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "key"
    save_key(path, KEY)
    assert load_key(path) == KEY
    for mode in (0o640, 0o604, 0o620, 0o644):
        path.chmod(mode)
        with pytest.raises(SigningError, match="others may read or write it"):
            load_key(path)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "has 0 bytes"),
        (KEY[:-1], "has 31 bytes"),
        (KEY + b"\n", "more than 32"),
        (bytes(32), "zeros"),
    ],
)
def test_what_is_no_key_is_refused(tmp_path: Path, content: bytes, why: str) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(SigningError, match=why):
        load_key(path)


def test_a_key_file_that_cannot_be_looked_at_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a folder of another user's, on the way to a first key over the air."""
    key = tmp_path / "key"

    def forbidden(path: Path, *_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    for name in ("stat", "open"):
        monkeypatch.setattr(Path, name, forbidden)
    with pytest.raises(SigningError, match=f"{key}: cannot be read: Permission denied"):
        signing_from(Secret(key, allow_setup=True), 0.0)


def test_a_missing_key_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(SigningError, match="urandom"):
        signing_from(Secret(tmp_path / "none"), 0.0)
    assert not signing_from(Secret(tmp_path / "none", allow_setup=True), 0.0).is_on
    assert not signing_from(Secret(), 0.0).is_on


def test_what_is_reserved_outlasts_a_loss_of_power(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The new file is on the disk before it has its name, and the name before it is used."""
    synced: list[tuple[bool, bool]] = []  # a folder, with the new name in it
    sync, file = os.fsync, tmp_path / "key.timestamp"

    def fsync(fd: int) -> None:
        sync(fd)
        synced.append((stat.S_ISDIR(os.fstat(fd).st_mode), file.exists()))

    monkeypatch.setattr(os, "fsync", fsync)
    ours = Signing(KEY, time.time(), 0.0)
    TimestampFile(tmp_path / "key").reserve(ours)
    assert synced == [(False, False), (True, True)]


def test_the_timestamp_is_kept_and_garbage_is_no_timestamp(tmp_path: Path) -> None:
    key = tmp_path / "key"
    save_key(key, KEY)
    file = TimestampFile(key)
    assert file.load() == 0
    far = Signing(KEY, time.time(), 0.0).timestamp + 86_400 * TICKS_PER_S  # of a peer
    file.save(far)
    assert file.load() == far
    assert (tmp_path / "key.timestamp").stat().st_mode & 0o777 == 0o600
    assert signing_from(Secret(key), 0.0).timestamp >= far
    for garbage in (b"many\n", b"", b"-5", b"\xff\0", b"9" * 5000):
        (tmp_path / "key.timestamp").write_bytes(garbage)
        ours = signing_from(Secret(key), 0.0, reserve=False)
        assert ours.kept_is_damaged  # which is reported: what was recorded before may be accepted
        assert abs(ours.timestamp - Signing(KEY, time.time(), 0.0).timestamp) < ticks(5.0)


def test_stamps_are_reserved_before_they_are_used_and_again_by_whoever_comes(
    tmp_path: Path,
) -> None:
    """Killed at any moment, the next process begins behind all that this one may have used."""
    key = tmp_path / "key"
    save_key(key, KEY)
    latest = 0
    for _ in range(4):
        ours = signing_from(Secret(key), 0.0)
        assert ours.timestamp > latest
        assert TimestampFile(key).load() == ours.reserved == ours.timestamp + ticks(RESERVE_S)
        latest = ours.reserved - 1
        watchdog = signing_from(Secret(key), 0.0, reserve=False)  # goes on in the dead one's block
        assert watchdog.timestamp == ours.reserved == TimestampFile(key).load()


def test_an_end_in_order_writes_down_the_very_last_stamp(tmp_path: Path) -> None:
    key = tmp_path / "key"
    save_key(key, KEY)
    ours = signing_from(Secret(key), 0.0)
    ours.next_timestamp()
    complaints: list[str] = []
    keep_timestamp(ours, key, complaints.append)()
    assert TimestampFile(key).load() == ours.timestamp
    assert complaints == []


def test_where_no_stamp_can_be_kept_it_is_reported_and_operators_are_received(
    tmp_path: Path,
) -> None:
    key = tmp_path / "key"
    save_key(key, KEY)
    (tmp_path / "key.timestamp").mkdir()
    ours = signing_from(Secret(key), 0.0)
    complaints: list[str] = []
    ours.reserved = ours.timestamp
    keep_timestamp(ours, key, complaints.append)()
    (complaint,) = complaints
    assert complaint.startswith("the signing timestamp cannot be kept: ")
    assert ours.reserved == LAST_STAMP


def test_a_command_from_a_clock_that_is_years_ahead_is_refused() -> None:
    """It could not be kept over a restart, so that its record would be obeyed then."""
    ours = Signing(KEY, CLOCK_IS_SET_S, 0.0)
    ahead = peer(ticks=LATEST + 1)
    command = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
    assert ours.accepts(frame(ahead))
    assert not ours.accepts(bytes(command.pack(ahead)))

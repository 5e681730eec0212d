"""Signatures, against pymavlink's own; and the files of key and timestamp."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.codec import Decoder, Encoder
from tgl_soar.link.keys import (
    Secret,
    SigningError,
    TimestampFile,
    load_key,
    peers_of,
    save_key,
    signing_from,
)
from tgl_soar.link.messages import Heartbeat, Source
from tgl_soar.link.signing import CLOCK_IS_SET_S, EPOCH_S, LATEST, TICKS_PER_S, Signing

KEY, OTHER_KEY = bytes(range(1, 33)), bytes(range(2, 34))
WALL_S = EPOCH_S + 1e8
NOW_TICKS = round(1e8 * TICKS_PER_S)


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
    assert all(ours.lets_in(frame(theirs)) for _ in range(10))
    assert ours.counters.good == 10


def test_a_replayed_frame_is_not() -> None:
    ours, theirs = signing(), peer()
    first, second = frame(theirs), frame(theirs)
    assert ours.lets_in(second)
    assert not ours.lets_in(second)
    assert not ours.lets_in(first)
    assert ours.counters.replayed == 2
    assert ours.lets_in(frame(theirs))


def test_what_is_unsigned_or_signed_by_others_is_not() -> None:
    ours = signing()
    assert not ours.lets_in(frame(peer(None)))
    assert not ours.lets_in(frame(peer(OTHER_KEY)))
    good = frame(peer())
    for at in range(len(good)):
        assert not ours.lets_in(good[:at] + bytes((good[at] ^ 1,)) + good[at + 1 :]), at
    old = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(peer(None), force_mavlink1=True)
    assert not ours.lets_in(bytes(old))
    assert ours.lets_in(good)  # none of all that has spoilt the stream


def test_a_forged_frame_from_the_future_does_not_shut_the_operator_out() -> None:
    ours = signing()
    ours.lets_in(frame(peer(OTHER_KEY, ticks=NOW_TICKS + 10**9)))
    assert ours.lets_in(frame(peer()))


@pytest.mark.parametrize(("behind_s", "in_time"), [(59.0, True), (61.0, False)])
def test_a_new_stream_may_be_a_minute_behind(behind_s: float, in_time: bool) -> None:
    theirs = peer(ticks=NOW_TICKS - round(behind_s * TICKS_PER_S))
    assert signing().lets_in(frame(theirs)) == in_time


def test_our_timestamp_is_the_latest_of_wall_clock_peers_and_file() -> None:
    ours = signing()
    assert ours.timestamp == NOW_TICKS
    ours.advance(2.0)
    assert ours.timestamp == NOW_TICKS + 2 * TICKS_PER_S
    ours.lets_in(frame(peer(ticks=NOW_TICKS + 10 * TICKS_PER_S)))
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
    assert ours.lets_in(frame(peer(ticks=now)))  # nobody is held for a replay
    encoder = Encoder(Source(1, 191), ours, 0)
    assert peer(ticks=now).decode(bytearray(encoder.encode(Heartbeat(18, 8, 0, 0, 4))))


def test_a_peer_s_clock_that_is_years_ahead_is_not_taken_over() -> None:
    ours = Signing(KEY, CLOCK_IS_SET_S, 0.0)
    before = ours.timestamp
    assert ours.lets_in(frame(peer(ticks=2**48 - 5)))  # it knows the key
    ours.replace_key(OTHER_KEY, 2**48 - 1)
    assert ours.timestamp == before


def test_without_a_clock_all_but_the_end_of_the_bits_is_believed() -> None:
    later = round((CLOCK_IS_SET_S + 1e9 - EPOCH_S) * TICKS_PER_S)  # 2057
    assert Signing(KEY, 0.0, 0.0, kept=later).timestamp == later
    assert Signing(KEY, 0.0, 0.0, kept=LATEST + 1).kept_is_damaged


def test_pymavlink_believes_what_we_sign_and_our_decoder_what_it_signs() -> None:
    ours = signing()
    theirs = peer()
    encoders = [Encoder(Source(1, 191), ours, 0), Encoder(Source(255, 191), ours, 0)]
    for i in range(20):
        made = encoders[i % 2].encode(Heartbeat(18, 8, 0, 0, 4))
        assert theirs.decode(bytearray(made)).get_signed()
    decoder = Decoder(stream=False, accept=ours.lets_in)
    assert len(decoder.feed(frame(theirs) + frame(peer(OTHER_KEY)) + frame(theirs))) == 2
    assert decoder.counters.refused == 1


def test_without_a_key_all_is_let_in_and_nothing_signed() -> None:
    ours = signing(None)
    assert ours.lets_in(frame(peer(None)))
    assert len(Encoder(Source(1, 191), ours).encode(Heartbeat(18, 8, 0, 0, 4))) == 21


def test_a_listener_takes_only_who_signs_for_its_peer() -> None:
    is_peer = peers_of(signing(), Source(1, 1))
    assert is_peer(frame(peer()))
    assert not is_peer(frame(peer(None)))
    assert not is_peer(b"hello")
    autopilot = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
    assert is_peer(bytes(autopilot.pack(mavlink.MAVLink(None, 1, 1))))


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


def test_a_missing_key_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(SigningError, match="urandom"):
        signing_from(Secret(tmp_path / "none"))
    assert not signing_from(Secret(tmp_path / "none", allow_setup=True)).is_on
    assert not signing_from(Secret()).is_on


def test_the_timestamp_is_kept_and_garbage_is_no_timestamp(tmp_path: Path) -> None:
    key = tmp_path / "key"
    save_key(key, KEY)
    file = TimestampFile(key)
    assert file.load() == 0
    far = Signing(KEY, time.time(), 0.0).timestamp + 86_400 * TICKS_PER_S  # of a peer
    file.save(far)
    assert file.load() == far
    assert (tmp_path / "key.timestamp").stat().st_mode & 0o777 == 0o600
    assert signing_from(Secret(key)).timestamp >= far
    (tmp_path / "key.timestamp").write_text("many\n")
    assert file.load() == 0

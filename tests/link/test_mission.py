"""Reading the autopilot's mission, over our own codec."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilot_setup_check import ASK_S, ASK_TIMES
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import (
    CommandLong,
    HomeMessage,
    MissionAck,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    Source,
)
from tgl_soar.link.mission import ITEMS_MAX, MissionLanding, MissionReading, landings_of

OWN = Source(1, 191)


def item(seq: int, command: int, target: int = 191, x: int = 0, y: int = 0) -> MissionItemInt:
    return MissionItemInt(
        target_system=1, target_component=target, seq=seq, command=command, x=x, y=y
    )


def test_it_asks_item_by_item_and_thanks() -> None:
    reading = MissionReading(OWN)
    assert reading.poll(0.0) == []  # it was not asked for
    reading.begin()
    home, asked = reading.poll(0.0)
    assert isinstance(home, CommandLong)
    assert (home.target_system, home.command, home.params[0]) == (1, 512, 242.0)
    assert asked == MissionRequestList(1, 1)
    reading.take(HomeMessage(1, 2, 3))
    assert reading.home == HomeMessage(1, 2, 3)
    assert reading.poll(0.1) == []
    reading.take(MissionCount(1, 190, 9))  # a ground station's
    reading.take(MissionCount(1, 191, 2))
    assert reading.poll(0.2) == [MissionRequestInt(1, 1, 0)]
    reading.take(item(1, 21))  # not the one that was asked for
    reading.take(item(0, 189, target=190))
    assert reading.poll(0.3) == []
    reading.take(item(0, 189))
    assert reading.poll(0.4) == [MissionRequestInt(1, 1, 1)]
    assert not reading.is_known
    reading.take(item(1, 21))
    assert reading.poll(0.5) == [MissionAck(1, 1, 0)]
    assert reading.is_known
    assert [i.command for i in reading.items] == [189, 21]
    assert reading.poll(9.0) == []
    reading.restart()
    assert not reading.is_known
    assert reading.home is None
    assert reading.poll(9.0) == [home, asked]


def test_a_lost_answer_is_asked_for_again_and_then_given_up() -> None:
    reading = MissionReading(OWN)
    reading.begin()
    now, sent = 0.0, 0
    while not reading.failed and now < 60.0:
        sent += len(reading.poll(now))
        now += 0.05
    assert sent == 2 * ASK_TIMES  # its home, too
    assert reading.failed == "its mission cannot be read: no answer"
    assert now == pytest.approx(ASK_TIMES * ASK_S, abs=0.2)
    assert not reading.is_known


def test_a_mission_without_an_end_is_not_read() -> None:
    reading = MissionReading(OWN)
    reading.begin()
    reading.poll(0.0)
    reading.take(MissionCount(1, 191, ITEMS_MAX + 1))
    assert str(ITEMS_MAX) in reading.failed
    assert reading.poll(1.0) == []


def test_landings_are_found_with_their_touch_down() -> None:
    items = [item(0, 16), item(1, 21), item(2, 189), item(3, 16), item(4, 21, x=10, y=-20)]
    assert landings_of(items) == [
        MissionLanding(begins=2, touches=4, latitude_deg=1e-6, longitude_deg=-2e-6)
    ]
    assert landings_of(items[:4]) == []


def test_its_messages_pass_the_codec() -> None:
    theirs = mavlink.MAVLink(None, 1, 1)
    decoder, encoder = Decoder(stream=False), Encoder(OWN)
    sent = (
        theirs.mission_count_encode(1, 191, 3),
        theirs.mission_item_int_encode(1, 191, 2, 6, 21, 0, 1, 0, 0, 0, 0, 520000000, -44000000, 5),
        theirs.mission_current_encode(7),
        theirs.home_position_encode(520000000, -44000000, -3500, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0, 0),
    )
    received = [decoder.feed(bytes(message.pack(theirs)))[0].message for message in sent]
    assert received == [
        MissionCount(1, 191, 3),
        item(2, 21, x=520000000, y=-44000000),
        MissionCurrent(7),
        HomeMessage(520000000, -44000000, -3500),
    ]
    reader = mavlink.MAVLink(None)
    data = b"".join(
        encoder.encode(m)
        for m in (MissionRequestList(1, 1), MissionRequestInt(1, 1, 4), MissionAck(1, 1, 0))
    )
    kinds = [message.get_type() for message in reader.parse_buffer(bytearray(data))]
    assert kinds == ["MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK"]

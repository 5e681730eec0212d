"""The receiver's own accuracy: what it keeps on the ground, and what is reported in flight."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, setup, texts

from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.messages import GpsRawInt, Received, Source

FLYING = (CAPTURING, SOARING)
NEEDS = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)


def by_satellites(*, gps: bool = True) -> Flight:
    return Flight(flown=setup()._replace(needs=NEEDS._replace(gps=gps)))


def report(
    flight: Flight, h_acc: int, v_acc: int, *, seconds: float = 2.0, fix_type: int = 3
) -> None:
    """The receiver reports these [mm], once a second, for so long."""
    for _ in range(round(seconds)):
        flight.receive(
            mavlink.MAVLink_gps_raw_int_message(
                0, fix_type, 0, 0, 0, 100, 100, 0, 0, 10, h_acc=h_acc, v_acc=v_acc
            )
        )
        flight.run(1.0)


@pytest.mark.parametrize(
    ("h_acc", "v_acc", "word"),
    [
        (3100, 1000, "uncertain by 3.1 m: above GPS_ACC_H"),
        (1000, 5100, "uncertain by 5.1 m up: above GPS_ACC_V"),
    ],
)
def test_engaging_is_refused_while_the_receiver_is_uncertain(
    h_acc: int, v_acc: int, word: str
) -> None:
    flight = by_satellites()
    report(flight, h_acc, v_acc)
    flight.set("OP_ENGAGE", 1.0)
    report(flight, h_acc, v_acc)
    assert flight.mode_now not in FLYING
    refusal = "".join(texts(flight.outbound()))
    assert word in refusal
    report(flight, 1000, 1000, seconds=1.0)
    flight.set("OP_ENGAGE", 1.0)
    report(flight, 1000, 1000)
    assert flight.mode_now in FLYING


def test_by_force_and_without_a_limit_it_is_engaged_all_the_same() -> None:
    for name, value in (("OP_FORCE", 1.0), ("GPS_ACC_H", 0.0)):
        flight = by_satellites()
        report(flight, 9000, 1000)
        flight.set(name, value)
        flight.set("OP_ENGAGE", 1.0)
        report(flight, 9000, 1000)
        assert flight.mode_now in FLYING


@pytest.mark.parametrize(
    ("h_acc", "v_acc", "fix_type"), [(0, 0, 3), (2**32 - 1, 2**32 - 1, 3), (9000, 9000, 1)]
)
def test_what_is_not_known_is_no_reason(h_acc: int, v_acc: int, fix_type: int) -> None:
    """Not reported, all bits, or of a receiver that has no fix: the position has checks of its
    own."""
    flight = by_satellites()
    report(flight, h_acc, v_acc, fix_type=fix_type)
    flight.set("OP_ENGAGE", 1.0)
    report(flight, h_acc, v_acc, fix_type=fix_type)
    assert flight.mode_now in FLYING


def test_an_old_report_is_no_reason() -> None:
    flight = by_satellites()
    report(flight, 9000, 9000)
    flight.run(5.5)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert flight.mode_now in FLYING


def test_in_a_hall_the_receiver_is_not_asked() -> None:
    flight = by_satellites(gps=False)
    report(flight, 99000, 99000)
    flight.set("OP_ENGAGE", 1.0)
    report(flight, 99000, 99000)
    assert flight.mode_now in FLYING
    assert flight.onboard.session.streams.wanted(24) is None


def test_in_flight_it_is_reported_once_and_ends_nothing() -> None:
    flight = by_satellites()
    assert flight.onboard.session.streams.wanted(24) is not None
    report(flight, 1000, 1000)
    flight.set("OP_ENGAGE", 1.0)
    report(flight, 1000, 1000, seconds=3.0)
    flight.outbound()
    for h_acc in (3500, 2900, 3200):  # about the limit: reported once
        report(flight, h_acc, 1000)
    reported = [text for text in texts(flight.outbound()) if "receiver" in text]
    assert reported == ["receiver uncertain by 3.5 m: above GPS_ACC_H"]
    assert flight.mode_now in FLYING
    report(flight, 2000, 1000)
    assert "the receiver is accurate enough again" in texts(flight.outbound())


def test_another_senders_report_is_ignored() -> None:
    flight = by_satellites()
    session = flight.onboard.session
    session.handle(Received(Source(9, 1), GpsRawInt(3, 90000, 90000)), flight.now_s)
    h_m, _ = session.receiver.known(flight.now_s)
    assert h_m != h_m
    assert session.counters.foreign == 1

"""Whether the autopilot's own position is measured, by the flags of its estimator."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_sensor_samples import AUTOPILOT, BRIDGE, STRANGER, receive, session

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.px4 import Px4
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.messages import (
    COMMAND_SET_MESSAGE_INTERVAL,
    RESULT_UNSUPPORTED,
    CommandAck,
    CommandLong,
    EkfStatusReport,
    EstimatorStatus,
    Inbound,
    LocalPositionNed,
    VisionPositionEstimate,
)
from tgl_soar.link.session import Session
from tgl_soar.link.sources import LOCAL_POSITION, VISION, PositionSources
from tgl_soar.link.vehicle.estimator_status import STATUS_AGE_MAX_S

HEIGHT = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS
RELATIVE = mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_PRED_POS_HORIZ_REL
ABSOLUTE = mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS
CONSTANT = mavlink.EKF_CONST_POS_MODE
AIDED = HEIGHT | RELATIVE | ABSOLUTE


def wired(message: Any) -> Inbound:
    """A message as it comes out of a link."""
    frame = message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    (received,) = Decoder(stream=False).feed(bytes(frame))
    assert received.source == AUTOPILOT
    return received.message


def ekf3(flags: int) -> Inbound:
    return wired(mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.2, 0.0, 0.3, 0.0, 0.1))


def ekf2(flags: int) -> Inbound:
    rest = (0.1, 0.2, 0.0, 0.3, 0.0, 0.1, 0.5, 0.7)
    return wired(mavlink.MAVLink_estimator_status_message(123_456_789, flags, *rest))


def place(talk: Session, time_ms: int) -> bool:
    """Whether the next position is taken for dead reckoned."""
    before = talk.position.sequence
    at = LocalPositionNed(time_boot_ms=time_ms, x=1.0, y=2.0, z=-3.0, vx=0.1, vy=0.0, vz=0.0)
    receive(talk, at, time_ms / 1000.0)
    assert talk.position.sequence == before + 1
    return talk.position.reckoned


def test_both_firmwares_messages_are_read() -> None:
    for status, kind in ((ekf3, EkfStatusReport), (ekf2, EstimatorStatus)):
        for flags in (AIDED, 0, 0xFFFF):
            message = status(flags)
            assert isinstance(message, kind)
            assert message.flags == flags


@pytest.mark.parametrize(
    ("status", "before", "now", "reckoned"),
    [
        (ekf3, AIDED, AIDED, False),
        (ekf3, AIDED, HEIGHT | RELATIVE, True),  # the wind alone aids it
        (ekf3, AIDED, HEIGHT | CONSTANT, True),
        (ekf3, AIDED, 0, True),  # it is not healthy
        (ekf3, HEIGHT | RELATIVE, HEIGHT | RELATIVE, False),  # by optical flow, all the time
        (ekf3, HEIGHT | CONSTANT, HEIGHT | CONSTANT, True),  # it never had a fix
        (ekf3, HEIGHT | CONSTANT, HEIGHT | RELATIVE | CONSTANT, True),  # an airspeed and no fix
        (ekf3, HEIGHT | CONSTANT, AIDED, False),
        (ekf3, AIDED, AIDED | 1 << 15, False),  # a glitch: it is the receiver that is wrong
        (ekf2, AIDED | CONSTANT, AIDED | CONSTANT, False),  # at rest
        (ekf2, AIDED, AIDED & ~mavlink.EKF_PRED_POS_HORIZ_ABS, True),  # aided by the wind
        (ekf2, AIDED, HEIGHT | mavlink.EKF_PRED_POS_HORIZ_REL, True),
        (ekf2, HEIGHT | RELATIVE, HEIGHT | RELATIVE, False),  # by cameras
        (ekf2, HEIGHT | RELATIVE, HEIGHT, True),
    ],
)
def test_a_position_is_reckoned_where_the_estimator_has_lost_what_it_had(
    status: Any, before: int, now: int, reckoned: bool
) -> None:
    talk = session()
    assert not place(talk, 1000)  # without a report nothing is uncertain
    receive(talk, status(before), 1.1)
    place(talk, 1200)
    receive(talk, status(now), 1.3)
    assert place(talk, 1400) == reckoned
    receive(talk, status(AIDED), 1.5)
    assert not place(talk, 1600)


def test_an_uncertainty_holds_until_the_autopilot_restarts() -> None:
    talk = session()
    receive(talk, ekf3(AIDED), 500.0)
    receive(talk, ekf3(HEIGHT | RELATIVE), 500.2)
    assert place(talk, 500_300)
    assert place(talk, 560_000)
    for k in range(40):  # its clock begins again
        if k == 20:
            assert talk.counters.reboots == 1
            assert not talk.position.reckoned
            receive(talk, ekf3(HEIGHT | RELATIVE), 560.5)  # all that this start has had
        at = LocalPositionNed(time_boot_ms=1000 + 20 * k, x=1.0, y=2.0, z=0.0, vx=0, vy=0, vz=0)
        receive(talk, at, 560.1 + 0.02 * k)
    assert talk.position.time_s == pytest.approx(560.88)
    assert not talk.position.reckoned


def of_the_silence(talk: Session) -> list[str]:
    texts = [text for _, text in talk.notices if "estimator" in text and "EKF" not in text]
    talk.notices.clear()
    return texts


@pytest.mark.parametrize(
    ("flags", "words", "reckoned"),
    [(AIDED, "measured, which nobody knows now", False), (HEIGHT, "dead reckoned, which", True)],
)
def test_what_was_reported_too_long_ago_is_reported_once_and_an_uncertainty_stays(
    flags: int, words: str, reckoned: bool
) -> None:
    talk = session()
    receive(talk, ekf3(AIDED), 1.0)
    receive(talk, ekf3(flags), 1.2)
    talk.poll(1.2 + STATUS_AGE_MAX_S)
    assert of_the_silence(talk) == []
    for k in range(50):
        talk.poll(1.3 + STATUS_AGE_MAX_S + 0.1 * k)
    (reported,) = of_the_silence(talk)
    assert words in reported
    assert place(talk, 12_000) == reckoned
    receive(talk, ekf3(AIDED), 12.1)
    assert not place(talk, 12_200)
    (reported,) = of_the_silence(talk)
    assert reported.endswith("reports again")
    talk.poll(12.0 + STATUS_AGE_MAX_S)
    assert of_the_silence(talk) == []


def test_who_never_spoke_is_not_missed_and_a_clock_that_is_set_makes_no_silence() -> None:
    talk = session()
    talk.poll(1000.0)
    receive(talk, ekf3(AIDED), 1000.1)
    talk.rebase(5000.0)
    talk.poll(5000.0 + STATUS_AGE_MAX_S)
    assert of_the_silence(talk) == []
    talk.poll(5000.1 + STATUS_AGE_MAX_S)
    assert len(of_the_silence(talk)) == 1


def test_nobody_else_has_a_say_and_what_the_autopilot_did_not_measure_is_not_meant() -> None:
    sources = PositionSources((VISION, LOCAL_POSITION))
    talk = session(sources=sources, vision_from=[BRIDGE])
    for status in (ekf3(AIDED), ekf3(HEIGHT)):
        receive(talk, status, 1.0, STRANGER)
    assert talk.counters.foreign == 2
    assert not place(talk, 1100)
    receive(talk, ekf3(HEIGHT), 1.2)
    assert place(talk, 1300)
    pose = VisionPositionEstimate(
        usec=1_400_000, x=1.0, y=2.0, z=-3.0, roll=0.0, pitch=0.0, yaw=0.0
    )
    for k in range(200):
        receive(talk, pose._replace(usec=pose.usec + 20_000 * k), 1.4 + 0.02 * k, BRIDGE)
    assert talk.position.source == VISION
    assert not talk.position.reckoned


@pytest.mark.parametrize(
    ("flavour", "number", "name"),
    [(ArduPilot, 193, "EKF_STATUS_REPORT"), (Px4, 230, "ESTIMATOR_STATUS")],
)
def test_each_firmware_is_asked_for_its_own_and_a_refusal_is_reported(
    flavour: type[Any], number: int, name: str
) -> None:
    talk = session(flavour)
    asked = False
    for k in range(400):
        now_s = 0.05 * k
        for request in talk.poll(now_s):
            if not isinstance(request, CommandLong):
                continue
            assert request.command == COMMAND_SET_MESSAGE_INTERVAL
            own = request.params[0] == number
            if own:
                assert request.params[1] == 200_000.0
            asked |= own
            result = RESULT_UNSUPPORTED if own else 0
            answer = CommandAck(
                command=COMMAND_SET_MESSAGE_INTERVAL,
                result=result,
                target_system=1,
                target_component=191,
            )
            receive(talk, answer, now_s)
    assert asked
    texts = [text for _, text in talk.notices if name in text]
    assert len(texts) == 1
    assert "dead reckoned looks like any other" in texts[0]

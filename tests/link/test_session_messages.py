"""Which senders' messages a session takes, what is due when, and what another clock resets."""

from __future__ import annotations

from math import isnan
from typing import Any

import pytest
from test_session import (
    AUTOPILOT,
    CHANNELS,
    MANUAL,
    OWN,
    STATION,
    attitude,
    position,
    receive,
    session,
)

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.messages import (
    ID_DISTANCE_SENSOR,
    ID_GPS_RAW_INT,
    SEVERITY_WARNING,
    AttitudeQuaternion,
    CommandAck,
    DistanceSensor,
    EkfStatusReport,
    EstimatorStatus,
    GlobalPositionInt,
    GpsRawInt,
    Heartbeat,
    HighresImu,
    HomeMessage,
    LocalPositionNed,
    MissionCurrent,
    MissionRequestList,
    Odometry,
    ParamRequestRead,
    ParamValue,
    RawImu,
    ScaledImu,
    ServoOutputRaw,
    Source,
    SysStatus,
    Timesync,
    VfrHud,
    VisionPositionEstimate,
    Wind,
    WindCov,
)
from tgl_soar.link.session import Session, SessionOptions
from tgl_soar.link.sources import VISION, PositionSources

STRANGER = Source(2, 1)
NEEDS = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)
MEASUREMENTS = (
    *(RawImu, ScaledImu, HighresImu, AttitudeQuaternion, LocalPositionNed, Odometry),
    *(GlobalPositionInt, VfrHud, ServoOutputRaw, DistanceSensor, GpsRawInt, EkfStatusReport),
    *(EstimatorStatus, Wind, WindCov),
)


def noughts(kind: Any) -> Any:
    """A message whose fields are all 0."""
    return kind(*(0 for _ in kind._fields))


def session_with(**options: Any) -> Session:
    return Session(
        SessionOptions(own=OWN, flavour=ArduPilot(CHANNELS, 1), loop_rate_hz=200.0)._replace(
            **options
        )
    )


# --- whose messages -----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_a_measurement_of_another_is_counted_and_not_used(kind: Any) -> None:
    talk = session()
    assert receive(talk, noughts(kind), 1.0, STRANGER) == []
    assert receive(talk, noughts(kind), 1.0, STATION) == []
    assert talk.counters.foreign == 2
    assert talk.attitude.sequence == talk.imu.sequence == talk.position.sequence == 0
    assert talk.airspeed.sequence == talk.surfaces.sequence == talk.rangefinder.sequence == 0


@pytest.mark.parametrize("kind", [Heartbeat, SysStatus, ParamValue, CommandAck, MissionCurrent])
def test_what_is_no_measurement_is_ignored_of_another(kind: Any) -> None:
    talk = session()
    assert receive(talk, noughts(kind), 1.0, STRANGER) == []
    assert talk.counters.foreign == 0
    assert talk.mission.current == -1


def test_vision_is_taken_of_those_that_may_send_it_alone() -> None:
    tracker = Source(1, 197)
    message = noughts(VisionPositionEstimate)._replace(covariance=(), usec=1_000_000, x=1.0)
    for may, sender in (
        (tracker, tracker),
        (tracker, AUTOPILOT),
        (tracker, STRANGER),
        (AUTOPILOT,) * 2,
    ):
        talk = session_with(vision_from=(may,), sources=PositionSources((VISION,)))
        receive(talk, message, 1.0, sender)
        assert (talk.position.sequence == 1) == (sender == may)
        assert talk.counters.foreign == int(sender != may)


def test_each_message_of_the_autopilot_goes_to_what_it_is_for() -> None:
    talk = session_with(needs=NEEDS, rangefinder=True)
    receive(talk, MANUAL, 1.0)
    receive(talk, attitude(1000), 1.0)
    receive(talk, position(1000), 1.0)
    receive(
        talk,
        RawImu(time_usec=1_000_000, xacc=0, yacc=0, zacc=-1000, xgyro=100, ygyro=200, zgyro=300),
        1.0,
    )
    receive(talk, SysStatus(16, 16), 1.0)  # a pitot tube
    receive(talk, VfrHud(9.5, 0.0), 1.0)
    receive(talk, ServoOutputRaw(1_000_000, 0, (1500,) * 16), 1.0)
    receive(
        talk,
        DistanceSensor(
            time_boot_ms=1000,
            min_distance=10,
            max_distance=5000,
            current_distance=700,
            id=0,
            orientation=25,
            signal_quality=0,
        ),
        1.0,
    )
    receive(talk, HomeMessage(10, 20, 30), 1.0)
    receive(talk, MissionCurrent(3), 1.0)
    receive(talk, GpsRawInt(3, 1500, 2500), 1.0)
    receive(talk, EkfStatusReport(0), 1.0)
    receive(talk, Wind(270.0, 8.0), 1.0)
    assert talk.has_heartbeat
    assert (talk.attitude.sequence, talk.imu.sequence, talk.position.sequence) == (1, 1, 1)
    assert talk.airspeed.airspeed_mps == 9.5
    assert talk.servos_us[:2] == (1500, 1500)
    assert talk.surfaces.elevator == 0.0
    assert talk.rangefinder.range_m == 7.0
    assert talk.vehicle_time_s == pytest.approx(1.0, abs=1e-3)  # of a whole millisecond
    assert talk.mission.home == HomeMessage(10, 20, 30)
    assert talk.wind.known(1.0) == pytest.approx((0.0, 8.0))
    assert talk.mission.current == 3
    assert talk.receiver.known(1.0) == (1.5, 2.5)
    assert talk.counters.foreign == 0
    assert (talk.custom_mode, talk.mismatch) == (0, "")
    assert not talk.position.reckoned
    receive(talk, position(1020), 1.02)
    assert talk.position.reckoned  # by an estimator that claims nothing


def test_parameters_of_the_autopilot_answer_what_was_asked() -> None:
    talk = session_with(needs=NEEDS)
    receive(talk, MANUAL, 1.0)
    (asked,) = {m.param_id for m in talk.poll(1.0) if isinstance(m, ParamRequestRead)} & {
        "MAV_GCS_SYSID"
    } or {"SYSID_MYGCS"}
    receive(
        talk,
        ParamValue(param_id=asked, param_value=77.0, param_type=9, param_count=100, param_index=0),
        1.1,
    )
    assert "77" in talk.inquiry.held_back()


# --- what is wanted -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message_id", "rate_hz"),
    [
        ({}, ID_DISTANCE_SENSOR, None),
        ({"rangefinder": True}, ID_DISTANCE_SENSOR, 20.0),
        ({}, ID_GPS_RAW_INT, None),
        ({"needs": NEEDS}, ID_GPS_RAW_INT, 1.0),
        ({"needs": NEEDS._replace(gps=False)}, ID_GPS_RAW_INT, None),
    ],
)
def test_streams_are_asked_for_where_something_uses_them(
    options: dict[str, Any], message_id: int, rate_hz: float | None
) -> None:
    talk = session_with(**options)
    stream = talk.streams.wanted(message_id)
    assert (stream.rate_hz if stream else None) == rate_hz
    if message_id == ID_GPS_RAW_INT:
        assert talk.receiver.counts == (rate_hz is not None)


def test_a_loop_that_is_slower_needs_its_attitude_less_often() -> None:
    talk = session()
    talk.set_loop_rate(50.0)
    stream = talk.streams.wanted(31)
    assert stream is not None
    assert stream.rate_hz == 50.0


# --- what is due --------------------------------------------------------------------------------


@pytest.mark.parametrize(("late_s", "next_s"), [(0.99, 2.0), (1.01, 3.01)])
def test_a_heartbeat_that_is_a_little_late_keeps_its_beat_and_one_after_a_pause_does_not(
    late_s: float, next_s: float
) -> None:
    talk = session()
    talk.heartbeat_if_due(0.0)
    assert talk.heartbeat_if_due(0.999) == []
    assert talk.heartbeat_if_due(1.0 + late_s) == [talk.heartbeat()]
    assert talk.heartbeat_if_due(next_s - 0.005) == []
    assert len(talk.heartbeat_if_due(next_s + 0.005)) == 1


def test_our_heartbeat_has_the_number_of_this_start() -> None:
    assert session().heartbeat().custom_mode == 1 << 8
    assert session_with(start=5).heartbeat().custom_mode == 5 << 8


def test_an_autopilot_is_asked_for_its_time_and_in_lockstep_it_is_not() -> None:
    for lockstep in (False, True):
        talk = session(lockstep=lockstep)
        assert talk.poll(0.5) == []  # before it was received
        receive(talk, MANUAL, 0.5)
        asked = [m for m in talk.poll(0.5) if isinstance(m, Timesync)]
        assert asked == ([] if lockstep else [Timesync(0, 500_000_000)])


def test_of_answers_only_the_autopilot_s_tell_the_way() -> None:
    talk = session()
    receive(talk, MANUAL, 0.5)
    talk.poll(0.5)
    assert isnan(talk.round_trip_s)
    assert receive(talk, Timesync(7, 500_000_000), 0.52, STATION) == []
    assert isnan(talk.round_trip_s)
    assert receive(talk, Timesync(7, 500_000_000), 0.53) == []
    assert talk.round_trip_s == pytest.approx(0.03)


def test_a_mission_is_read_when_it_is_asked_for() -> None:
    talk = session()
    talk.mission.begin()
    receive(talk, MANUAL, 0.5)
    assert MissionRequestList(1, 1) in talk.poll(0.5)


def test_complaints_are_warnings_and_words_of_sources_go_on() -> None:
    talk = session()
    receive(talk, MANUAL, 0.5)
    talk.poll(0.5)
    for name in ("SYSID_MYGCS", "MAV_GCS_SYSID"):
        receive(
            talk,
            ParamValue(
                param_id=name, param_value=77.0, param_type=9, param_count=100, param_index=0
            ),
            0.6,
        )
    talk.sources.notices.append((5, "another source"))
    for i in range(60):
        talk.poll(0.7 + 0.1 * i)
    assert (5, "another source") in talk.notices
    assert talk.sources.notices == []
    complaints = [severity for severity, text in talk.notices if "77" in text]
    assert complaints == [SEVERITY_WARNING]


# --- acknowledgements ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("system", "component", "ours"),
    [
        *((1, 191, True), (0, 0, True), (0, 191, True), (1, 0, True)),
        *((2, 191, False), (1, 190, False), (0, 190, False), (2, 0, False)),
    ],
)
def test_an_answer_is_ours_by_both_of_its_numbers(system: int, component: int, ours: bool) -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    talk.poll(0.0)
    stream = talk.streams.wanted(31)
    assert stream is not None
    receive(
        talk,
        CommandAck(command=511, result=3, target_system=system, target_component=component),
        0.1,
    )
    assert stream.given_up == ours


def test_an_answer_to_another_command_is_none() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    talk.poll(0.0)
    receive(talk, CommandAck(command=512, result=3, target_system=1, target_component=191), 0.1)
    stream = talk.streams.wanted(31)
    assert stream is not None
    assert not stream.given_up


# --- another clock ------------------------------------------------------------------------------


def talked(**options: Any) -> Session:
    """A session in which everything has come that is reset by another clock."""
    talk = session_with(needs=NEEDS, **options)
    talk.mission.begin()
    receive(talk, MANUAL, 99.0)
    talk.heartbeat_if_due(99.0)
    for now_s in (99.0, 99.1):
        talk.poll(now_s)
        receive(
            talk, CommandAck(command=511, result=3, target_system=1, target_component=191), now_s
        )
    receive(talk, Timesync(7, 99_000_000_000), 99.2)
    receive(talk, GpsRawInt(3, 1500, 2500), 99.3)
    receive(talk, MissionCurrent(4), 99.3)
    receive(talk, Wind(270.0, 8.0), 99.3)
    receive(talk, EkfStatusReport(831), 99.3)
    receive(talk, attitude(99_300), 99.3)
    receive(talk, position(99_300), 99.3)
    stream = talk.streams.wanted(31)
    assert stream is not None
    assert stream.given_up
    assert talk.receiver.known(99.3) == (1.5, 2.5)
    assert talk.wind.known(99.3) == pytest.approx((0.0, 8.0))
    assert talk.round_trip_s == pytest.approx(0.2)
    talk.presence.take(noughts(Heartbeat)._replace(custom_mode=9 << 8), 99.3)
    assert not talk.presence.is_alone(99.3)
    return talk


def is_reset(talk: Session, now_s: float) -> None:
    stream = talk.streams.wanted(31)
    assert stream is not None
    assert not stream.given_up
    assert isnan(talk.round_trip_s)
    assert talk.mission.current == -1
    assert talk.mission.restarts == 1
    assert isnan(talk.receiver.known(now_s)[0])
    assert isnan(talk.wind.known(now_s)[0])
    assert talk.heartbeat_if_due(now_s - 0.01) == []
    assert talk.heartbeat_if_due(now_s) == [talk.heartbeat()]
    asked = talk.poll(now_s)
    assert MissionRequestList(1, 1) in asked
    assert any(isinstance(m, ParamRequestRead) for m in asked)
    assert any(isinstance(m, Timesync) for m in asked)


def test_a_new_clock_of_ours_forgets_all_that_was_timed_by_the_old_one() -> None:
    talk = talked()
    talk.rebase(5.0)
    assert talk.status.time_s == 5.0
    assert talk.presence.is_alone(5.0)
    is_reset(talk, 5.0)
    assert isnan(talk.receiver.known(99.4)[0])  # not even where the new one comes to that time
    for i in range(100):  # nor was the estimator silent for as long as the clocks are apart
        talk.poll(5.0 + 0.05 * i)
    assert not any("estimator" in text for _, text in talk.notices)


def test_a_new_clock_of_the_autopilot_s_forgets_all_that_was_asked_of_it() -> None:
    talk = talked()
    for i in range(3):
        receive(talk, attitude(1000 + 5 * i), 99.4)
    assert talk.counters.reboots == talk.status.boots == 1
    is_reset(talk, 99.4)


def test_a_queue_on_the_link_is_forgotten_with_the_clock() -> None:
    """Answers that take 0.3 s longer than the first: samples are 0.25 s older than they seem."""
    talk = session()
    receive(talk, MANUAL, 0.0)
    for i in range(20):
        asked = [m for m in talk.poll(i * 1.01) if isinstance(m, Timesync)]
        for question in asked:
            receive(talk, Timesync(7, question.ts1), question.ts1 * 1e-9 + (0.3 if i else 0.0))
    receive(talk, attitude(20_000), 20.0)
    assert talk.attitude.time_s == pytest.approx(19.75, abs=1e-3)
    for i in range(3):
        receive(talk, attitude(1000 + 5 * i), 20.1)
    assert talk.counters.reboots == 1
    assert talk.attitude.time_s == pytest.approx(20.1, abs=6e-3)


def test_senders_are_remembered_however_their_messages_are_used() -> None:
    talk = session()
    receive(talk, noughts(Heartbeat), 0.0, STRANGER)
    receive(talk, attitude(1), 0.0)
    assert talk.senders == {STRANGER, AUTOPILOT}
    for system in range(3, 40):
        receive(talk, noughts(Heartbeat), 0.0, Source(system, 1))
    assert len(talk.senders) == 32

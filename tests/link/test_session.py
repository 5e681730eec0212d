"""The conversation with an autopilot, stepped with time as an argument."""

from math import atan2, cos, degrees, isnan, nan, sin, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.clock import MICROSECONDS_WRAP_S, ClockMap, StampedStreams
from tgl_soar.link.messages import (
    AttitudeQuaternion,
    CommandAck,
    CommandLong,
    EkfStatusReport,
    Heartbeat,
    Inbound,
    LocalPositionNed,
    Odometry,
    Outbound,
    ParamRequestRead,
    ParamValue,
    RawImu,
    Received,
    ServoOutputRaw,
    Source,
    SysStatus,
    Timesync,
    VfrHud,
)
from tgl_soar.link.session import Session, SessionOptions
from tgl_soar.link.stream_requests import StreamRequests

OWN = Source(1, 191)
AUTOPILOT = Source(1, 1)
STATION = Source(255, 190)
CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
MANUAL = Heartbeat(type=1, autopilot=3, base_mode=81 | 128, custom_mode=0, system_status=4)
AUTO = Heartbeat(type=1, autopilot=3, base_mode=81, custom_mode=10, system_status=4)


def session(*, lockstep: bool = False) -> Session:
    return Session(
        SessionOptions(
            own=OWN, flavour=ArduPilot(CHANNELS, 1), loop_rate_hz=200.0, lockstep=lockstep
        )
    )


def receive(
    session: Session, message: Inbound, now_s: float, source: Source = AUTOPILOT
) -> list[Outbound]:
    return session.handle(Received(source, message), now_s)


def attitude(time_ms: int, w: float = 1.0) -> AttitudeQuaternion:
    return AttitudeQuaternion(
        time_boot_ms=time_ms,
        q1=w,
        q2=0.0,
        q3=0.0,
        q4=0.0,
        rollspeed=0.1,
        pitchspeed=0.2,
        yawspeed=0.3,
    )


def position(time_ms: int, x: float = 1.0) -> LocalPositionNed:
    return LocalPositionNed(time_boot_ms=time_ms, x=x, y=2.0, z=-3.0, vx=0.1, vy=0.2, vz=0.3)


def requests(messages: list[Outbound]) -> list[tuple[float, float]]:
    return [(m.params[0], m.params[1]) for m in messages if isinstance(m, CommandLong)]


# --- identities -------------------------------------------------------------------------------


def test_our_heartbeat_comes_once_a_second() -> None:
    talk = session()
    beats = [m for i in range(2001) for m in talk.heartbeat_if_due(i * 0.005)]
    assert len(beats) == 11
    assert beats[0] == Heartbeat(
        type=18, autopilot=8, base_mode=1, custom_mode=1 << 8, system_status=1
    )  # mode boot


def test_heartbeats_do_not_catch_up_after_a_pause() -> None:
    talk = session()
    talk.heartbeat_if_due(0.0)
    assert sum(len(talk.heartbeat_if_due(100.0 + i * 0.005)) for i in range(300)) == 2


def test_only_the_vehicle_s_own_autopilot_is_accepted() -> None:
    talk = session()
    receive(
        talk,
        Heartbeat(type=6, autopilot=8, base_mode=0, custom_mode=0, system_status=4),
        1.0,
        STATION,
    )
    receive(talk, MANUAL, 1.0, Source(2, 1))
    receive(talk, MANUAL, 1.0, Source(1, 190))
    receive(talk, Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4), 1.0)
    receive(talk, Heartbeat(type=6, autopilot=3, base_mode=81, custom_mode=0, system_status=4), 1.0)
    assert not talk.has_heartbeat
    receive(talk, attitude(1), 1.0, Source(2, 1))
    receive(talk, position(1), 1.0, Source(2, 1))
    assert talk.attitude.sequence == talk.position.sequence == 0
    assert talk.counters.foreign == 2
    assert set(talk.senders) == {STATION, Source(2, 1), Source(1, 190), AUTOPILOT}
    receive(talk, MANUAL, 2.0)
    assert talk.status[:3] == (2.0, True, True)
    receive(talk, AUTO, 3.0)
    assert talk.status[:3] == (3.0, False, False)


def test_senders_are_remembered_in_bounds() -> None:
    talk = session()
    for system in range(2, 256):
        receive(talk, MANUAL, 0.0, Source(system, 1))
    assert len(talk.senders) == 32


def test_timesync_requests_are_answered_and_answers_are_not() -> None:
    talk = session()
    assert receive(talk, Timesync(0, 77), 1.5, STATION) == [Timesync(1_500_000_000, 77)]
    assert receive(talk, Timesync(5, 77), 1.5) == []
    step = session(lockstep=True)
    assert receive(step, Timesync(0, 77), 1.5) == [Timesync(77, 77)]
    assert receive(step, Timesync(0, 0), 1.5) == [Timesync(1, 0)]


# --- streams ----------------------------------------------------------------------------------


def asked_over(talk: Session, seconds: float, *, result: int | None, start_s: float = 0.0) -> int:
    """How often is asked if every request gets this result and nothing streams."""
    count = 0
    for i in range(round(seconds / 0.005)):
        now = start_s + i * 0.005
        made = requests(talk.poll(now))
        count += len(made)
        if made and result is not None:
            receive(
                talk,
                CommandAck(command=511, result=result, target_system=1, target_component=191),
                now,
            )
    return count


def test_nothing_is_asked_before_the_autopilot_is_received() -> None:
    assert asked_over(session(), 5.0, result=None) == 0


def test_the_streams_are_asked_for_one_at_a_time() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    assert requests(talk.poll(0.0)) == [(31.0, 5000.0)]
    assert requests(talk.poll(0.1)) == []
    receive(talk, CommandAck(command=511, result=0, target_system=1, target_component=191), 0.1)
    assert requests(talk.poll(0.1)) == [(32.0, 20000.0)]
    assert requests(talk.poll(0.7)) == [(36.0, 20000.0)]  # the second answer is lost
    later = []
    for i in range(3):
        receive(
            talk,
            CommandAck(command=511, result=0, target_system=1, target_component=191),
            0.8 + 0.1 * i,
        )
        later += requests(talk.poll(0.8 + 0.1 * i))
    assert later == [(27.0, 5000.0), (74.0, 50000.0), (1.0, 1000000.0)]


def test_a_stream_that_comes_is_not_asked_for_again() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    made = []
    for i in range(4000):
        now = i * 0.005
        made += requests(talk.poll(now))
        receive(talk, CommandAck(command=511, result=0, target_system=1, target_component=191), now)
        receive(talk, attitude(i * 5), now)
        if i % 4 == 0:
            receive(talk, position(i * 5), now)
            receive(talk, ServoOutputRaw(i * 5000, 0, (1500,) * 16), now)
        receive(
            talk,
            RawImu(time_usec=i * 5000, xacc=0, yacc=0, zacc=-1000, xgyro=0, ygyro=0, zgyro=0),
            now,
        )
        if i % 10 == 0:
            receive(talk, VfrHud(9.0, 0.0), now)
        if i % 200 == 0:
            receive(talk, SysStatus(0, 0), now)
        if i % 40 == 0:
            receive(talk, EkfStatusReport(831), now)
    assert len(made) == 7


def test_a_stream_that_stays_away_is_asked_for_ever_more_seldom() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    first = asked_over(talk, 12.0, result=None)
    later = asked_over(talk, 100.0, result=None, start_s=12.0)
    assert 7 * 3 <= first <= 7 * 4
    assert 7 * 5 <= later <= 7 * 8


def test_a_stream_that_is_too_slow_is_asked_for_again() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    made = []
    for i in range(1000):
        now = i * 0.01  # 100 Hz come where 200 were asked for
        made += requests(talk.poll(now))
        receive(talk, attitude(i * 10), now)
    assert made.count((31.0, 5000.0)) >= 3


def test_a_denied_rate_is_reported_once_with_the_way_out_and_a_lower_one_asked_for() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    allowed_us = 25000.0  # ArduPlane at its default loop of 50 Hz allows 40
    made = []
    for i in range(200):
        now = i * 0.005
        asked = requests(talk.poll(now))
        made += asked
        for _, interval in asked:
            receive(
                talk,
                CommandAck(
                    command=511,
                    result=2 if interval < allowed_us else 0,
                    target_system=1,
                    target_component=191,
                ),
                now,
            )
    rates = [round(1e6 / interval) for number, interval in made if number == 31.0]
    assert rates == [200, 160, 125, 100, 80, 50, 40]
    reported = [text for _, text in talk.notices if "ATTITUDE" in text]
    assert reported == [
        "ATTITUDE_QUATERNION at 200 Hz denied: set SCHED_LOOP_RATE to 250 or more;"
        " asking for 160 Hz"
    ]


def test_a_refusal_that_comes_late_is_not_that_of_the_next_stream() -> None:
    """On a busy line: the acknowledgement names no message."""
    streams = StreamRequests(1)
    streams.want(132, "DISTANCE_SENSOR", 20.0)
    streams.want(31, "ATTITUDE_QUATERNION", 200.0)
    (first,), (second,) = streams.poll(0.0), streams.poll(0.6)
    assert (first.params[0], second.params[0]) == (132.0, 31.0)
    streams.acknowledged(3, 0.7)  # unsupported: the rangefinder
    attitude = streams.wanted(31)
    assert attitude is not None
    assert not attitude.given_up
    asked_s = next(s for s in range(1, 60) if any(m.params[0] == 31.0 for m in streams.poll(s)))
    streams.acknowledged(3, asked_s + 0.1)
    assert attitude.given_up


def test_an_unsupported_position_leads_to_odometry() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    made = []
    for i in range(200):
        now = i * 0.005
        asked = requests(talk.poll(now))
        made += asked
        for number, _ in asked:
            receive(
                talk,
                CommandAck(
                    command=511,
                    result=3 if number == 32.0 else 0,
                    target_system=0,
                    target_component=0,
                ),
                now,
            )
    assert (331.0, 20000.0) in made
    assert made.count((32.0, 20000.0)) == 1
    assert any("LOCAL_POSITION_NED at 50 Hz unsupported" in text for _, text in talk.notices)


def test_an_answer_to_another_system_is_not_ours() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    talk.poll(0.0)
    receive(talk, CommandAck(command=511, result=3, target_system=255, target_component=190), 0.1)
    receive(talk, CommandAck(command=400, result=3, target_system=1, target_component=191), 0.1)
    receive(
        talk, CommandAck(command=511, result=3, target_system=1, target_component=191), 0.1, STATION
    )
    talk.poll(0.2)
    assert talk.notices == []


def test_after_a_reboot_all_is_asked_for_again_and_we_greet_at_once() -> None:
    talk = session()
    receive(talk, MANUAL, 0.0)
    assert asked_over(talk, 1.0, result=0) == 7
    receive(talk, attitude(300_000), 1.0)
    receive(talk, position(300_000), 1.0)
    for late_ms in (1_000, 1_005):
        receive(talk, attitude(late_ms), 1.1)
    assert talk.counters.reboots == 0
    receive(talk, attitude(1_010), 1.1)
    assert talk.counters.reboots == 1
    assert isinstance(talk.heartbeat_if_due(1.1)[0], Heartbeat)
    assert requests(talk.poll(1.1)) == [(31.0, 5000.0)]
    assert talk.attitude.time_s == pytest.approx(1.1)
    receive(talk, position(1_001), 1.102)
    assert talk.position.sequence == 2
    assert talk.counters.reboots == 1
    assert any("restarted" in text for _, text in talk.notices)


# --- whose overrides it obeys -----------------------------------------------------------------


def complaints(answers: dict[str, float], *, override_system: int = 255) -> tuple[int, list[str]]:
    """(questions, complaints) of ten seconds with an autopilot that has these parameters."""
    talk = Session(
        SessionOptions(
            own=OWN,
            flavour=ArduPilot(CHANNELS, 1),
            loop_rate_hz=200.0,
            override_system=override_system,
        )
    )
    receive(talk, MANUAL, 0.0)
    questions = 0
    for i in range(100):
        for m in talk.poll(i * 0.1):
            if isinstance(m, ParamRequestRead):
                questions += 1
                assert (m.target_system, m.target_component) == (1, 1)
                if m.param_id in answers:
                    receive(
                        talk,
                        ParamValue(
                            param_id=m.param_id,
                            param_value=answers[m.param_id],
                            param_type=9,
                            param_count=900,
                            param_index=5,
                        ),
                        i * 0.1,
                    )
    return questions, [text for _, text in talk.notices if "ignores" in text]


def test_an_autopilot_that_obeys_is_not_complained_about() -> None:
    """The names of other releases, which it does not have, are asked for four times each."""
    assert complaints({"SYSID_MYGCS": 255.0}) == (1 + 2 * 4, [])


def test_an_autopilot_that_would_ignore_us_is_reported_once_with_the_way_out() -> None:
    questions, reported = complaints({"SYSID_MYGCS": 254.0})
    assert questions == 1 + 2 * 4
    assert reported == [
        "the autopilot ignores our surfaces: its SYSID_MYGCS is 254, our override_system_id 255;"
        " make them the same"
    ]


@pytest.mark.parametrize(
    ("system", "obeyed"), [(249, False), (250, True), (252, True), (253, False)]
)
def test_newer_firmware_obeys_a_range(system: int, obeyed: bool) -> None:
    answers = {"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 252.0}
    assert (complaints(answers, override_system=system)[1] == []) == obeyed
    assert complaints({"MAV_GCS_SYSID": 250.0}, override_system=250)[1] == []


def test_an_autopilot_that_does_not_answer_is_asked_a_few_times_and_accepted() -> None:
    assert complaints({}) == (12, [])


def asked_of_mute(needs: Needs) -> tuple[dict[int, int], list[str], str]:
    """(questions in each second, what is reported, what holds back) of an autopilot that answers no
    question about its parameters."""
    talk = Session(
        SessionOptions(own=OWN, flavour=ArduPilot(CHANNELS, 1), loop_rate_hz=200.0, needs=needs)
    )
    receive(talk, MANUAL, 0.0)
    questions: dict[int, int] = {}
    for i in range(6000):
        now_s = i * 0.01
        asked = [m for m in talk.poll(now_s) if isinstance(m, ParamRequestRead)]
        if asked:
            questions[int(now_s)] = questions.get(int(now_s), 0) + len(asked)
    reported = [text for _, text in talk.notices if "not known how the autopilot is set up" in text]
    return questions, reported, talk.inquiry.held_back()


def test_a_mute_autopilot_is_reported_once_and_holds_nothing_back() -> None:
    needs = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=False)
    questions, reported, held_back = asked_of_mute(needs)
    assert max(questions.values()) <= 20  # 640 bytes a second, beside the streams
    assert max(questions) < 20  # and then no more
    (words,) = reported
    assert words.endswith("did not answer (tgl-soar preflight)")
    assert held_back == ""


# --- measurements -----------------------------------------------------------------------------


def test_measurements_become_samples() -> None:
    talk = session()
    receive(talk, attitude(1000), 50.0)
    receive(talk, position(1000), 50.0)
    assert talk.attitude == (1, 50.0, 1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3)
    assert talk.position[:8] == (1, 50.0, 1.0, 2.0, -3.0, 0.1, 0.2, 0.3)
    assert 1.0 <= talk.vehicle_time_s <= 1.001


def test_repeated_late_and_broken_samples_are_refused_and_counted() -> None:
    talk = session()
    receive(talk, attitude(1000), 1.0)
    receive(talk, attitude(1000), 1.0)
    receive(talk, attitude(995), 1.0)
    receive(talk, attitude(1005, nan), 1.0)
    receive(talk, position(1000), 1.0)
    receive(talk, position(990), 1.0)
    receive(talk, position(1020, nan), 1.0)
    assert talk.attitude.sequence == talk.position.sequence == 1
    assert talk.counters.stale == 3
    assert talk.counters.not_finite == 2
    receive(talk, attitude(1005), 1.01)
    assert talk.attitude.sequence == 2


@given(st.lists(st.integers(0, 2**32 - 1), max_size=60))
def test_whatever_the_stamps_a_sample_is_never_from_the_future(stamps: list[int]) -> None:
    talk = session()
    for i, stamp in enumerate(stamps):
        receive(talk, attitude(stamp), i * 0.005)
        receive(talk, position(stamp), i * 0.005)
        assert not talk.attitude.time_s > i * 0.005 + 1e-8  # rounding
        assert not talk.position.time_s > i * 0.005 + 1e-8


def test_the_mapped_time_has_none_of_the_link_s_jitter() -> None:
    talk = session()
    jitter = (0.004, 0.0, 0.009, 0.002, 0.007)
    errors = []
    for i in range(1000):
        true_s = i * 0.005
        receive(talk, attitude(20_000 + i * 5), 100.0 + true_s + 0.003 + jitter[i % 5])
        errors.append(talk.attitude.time_s - (100.0 + true_s + 0.003))
    # Each loop of five has one sample without jitter; between two the map moves by 1e-4 of 25 ms.
    assert max(abs(e) for e in errors[10:]) < 1e-5


def test_a_slow_stream_shares_what_the_fast_one_learnt_of_the_clock() -> None:
    talk = session()
    for i in range(100):
        receive(talk, attitude(i * 5), 10.0 + i * 0.005)
    receive(talk, position(495), 10.0 + 0.495 + 0.060)  # 60 ms late, and the first of its kind
    assert talk.position.time_s == pytest.approx(10.495, abs=1e-4)


def test_odometry_in_body_frd_is_turned_into_ned() -> None:
    """Heading east, nose up by 30 degrees, flying straight ahead at 10 m/s."""
    talk = session()
    yaw, pitch = 1.5707963, 0.5235988
    q = (
        cos(yaw / 2) * cos(pitch / 2),
        -sin(yaw / 2) * sin(pitch / 2),
        cos(yaw / 2) * sin(pitch / 2),
        sin(yaw / 2) * cos(pitch / 2),
    )
    for frame, child in ((1, 12), (20, 12), (1, 8)):
        stamp = 1000 + 1000 * talk.position.sequence
        odometry = Odometry(
            time_usec=stamp,
            frame_id=frame,
            child_frame_id=child,
            x=1,
            y=2,
            z=-3,
            q=q,
            vx=10.0,
            vy=0,
            vz=0,
            rollspeed=0.1,
            pitchspeed=0.2,
            yawspeed=0.3,
        )
        receive(talk, odometry, 1.0 + 1e-6 * stamp)
        fix = talk.position
        assert (fix.north_m, fix.east_m, fix.down_m) == (1, 2, -3)
        assert fix.velocity_north_mps == pytest.approx(0.0, abs=1e-5)
        assert fix.velocity_east_mps == pytest.approx(10 * cos(pitch), abs=1e-5)
        assert fix.velocity_down_mps == pytest.approx(-10 * sin(pitch), abs=1e-5)
    assert talk.position.sequence == talk.attitude.sequence == 3
    qw, qx, qy, qz = talk.attitude[2:6]
    yaw_back = atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
    assert degrees(yaw_back) == pytest.approx(90.0, abs=1e-4)


def test_odometry_in_local_frames_keeps_its_velocity() -> None:
    talk = session()
    q = (sqrt(0.5), 0.0, 0.0, sqrt(0.5))
    receive(
        talk,
        Odometry(
            time_usec=5,
            frame_id=1,
            child_frame_id=1,
            x=1,
            y=2,
            z=-3,
            q=q,
            vx=4.0,
            vy=5.0,
            vz=6.0,
            rollspeed=0,
            pitchspeed=0,
            yawspeed=0,
        ),
        1.0,
    )
    assert talk.position[5:8] == (4.0, 5.0, 6.0)


@pytest.mark.parametrize("q", [(0.0,) * 4, (nan,) * 4, (0.97, 0.0, 0.0, 0.0)])
def test_a_velocity_in_body_axes_needs_an_attitude(q: tuple[float, float, float, float]) -> None:
    """A quaternion of zeros, MAVLink's for an unknown one, would leave it as it is."""
    talk = session()
    receive(
        talk,
        Odometry(
            time_usec=5,
            frame_id=1,
            child_frame_id=12,
            x=1,
            y=2,
            z=-3,
            q=q,
            vx=4,
            vy=5,
            vz=6,
            rollspeed=0,
            pitchspeed=0,
            yawspeed=0,
        ),
        1.0,
    )
    assert talk.position[2:5] == (1, 2, -3)
    assert all(isnan(component) for component in talk.position[5:8])


def test_odometry_in_frames_of_another_kind_is_refused_and_reported_once() -> None:
    talk = session()
    for i, (frame, child) in enumerate(((4, 12), (21, 12), (1, 21), (0, 0))):
        odometry = Odometry(
            time_usec=10 * i,
            frame_id=frame,
            child_frame_id=child,
            x=1,
            y=2,
            z=3,
            q=(1.0, 0.0, 0.0, 0.0),
            vx=0,
            vy=0,
            vz=0,
            rollspeed=0,
            pitchspeed=0,
            yawspeed=0,
        )
        receive(talk, odometry, 1.0)
    assert talk.position.sequence == 0
    assert talk.counters.wrong_frame == 4
    assert len(talk.notices) == 1


def test_two_position_messages_do_not_mix() -> None:
    talk = session()
    odometry = Odometry(
        time_usec=1_000_000,
        frame_id=1,
        child_frame_id=12,
        x=7,
        y=8,
        z=9,
        q=(nan,) * 4,
        vx=0,
        vy=0,
        vz=0,
        rollspeed=0,
        pitchspeed=0,
        yawspeed=0,
    )
    receive(talk, position(1000), 1.0)
    receive(talk, odometry, 1.1)
    assert talk.position.north_m == 1.0
    receive(talk, odometry._replace(time_usec=1_600_000), 1.7)  # the other has fallen silent
    assert talk.position.north_m == 7.0
    receive(talk, position(1800), 1.8)
    assert talk.position.north_m == 7.0


def test_in_lockstep_an_odometry_that_comes_first_leaves_attitude_to_its_message() -> None:
    """PX4 streams ODOMETRY unasked; the pace of lockstep is ATTITUDE_QUATERNION's alone."""
    talk = session(lockstep=True)
    receive(
        talk,
        Odometry(
            time_usec=1_000_000,
            frame_id=1,
            child_frame_id=12,
            x=7,
            y=8,
            z=9,
            q=(1, 0, 0, 0),
            vx=0,
            vy=0,
            vz=0,
            rollspeed=0,
            pitchspeed=0,
            yawspeed=0,
        ),
        1.0,
    )
    receive(talk, attitude(1_004), 1.0)
    assert talk.attitude.sequence == 1


def test_in_lockstep_the_vehicle_s_time_is_the_time() -> None:
    talk = session(lockstep=True)
    receive(talk, attitude(5000), 987.0)
    receive(talk, position(4980), 987.0)
    assert talk.attitude.time_s == 5.0
    assert talk.position.time_s == 4.98


def test_a_new_clock_makes_what_was_timed_by_the_old_one_begin_again() -> None:
    talk = session(lockstep=True)
    receive(talk, MANUAL, 5000.0)
    talk.heartbeat_if_due(5000.0)
    talk.poll(5000.0)
    talk.rebase(3.0)
    assert talk.status.time_s == 3.0
    assert isinstance(talk.heartbeat_if_due(3.0)[0], Heartbeat)
    assert requests(talk.poll(3.0)) == [(31.0, 5000.0)]


# --- the clock alone --------------------------------------------------------------------------


def test_the_map_follows_a_vehicle_whose_quartz_runs_slow() -> None:
    """50 parts per million for 200 s are 10 ms; the map must not lag behind by more than 1 ms."""
    clock, error = ClockMap(), 0.0
    for i in range(40_000):
        stamp = i * 0.005
        arrival = stamp * (1 + 50e-6) + (0.0005 if i % 7 else 0.0)
        error = max(error, abs(clock.observe(stamp, arrival) - stamp * (1 + 50e-6)))
    assert error < 0.001


def order_of(streams: StampedStreams, *stamps_s: float) -> list[bool]:
    """Whether stamps were taken, where nothing but their order shows it."""
    return [streams.time_of("a", stamp_s, 0.0) is not None for stamp_s in stamps_s]


def test_what_stamps_say() -> None:
    streams = StampedStreams(lockstep=True)
    assert order_of(streams, 10.0, 10.005, 9.5, 10.01) == [True, True, False, True]
    assert order_of(streams, 5.0, 5.005) == [False, False]
    assert streams.reboots == 0
    assert order_of(streams, 5.01, 5.015, 4.9, 5.015) == [True, True, False, False]
    assert streams.reboots == 1


def test_frames_that_were_long_under_way_are_no_reboot() -> None:
    """One now and then, or several whose stamps do not count on: late, whatever their age."""
    streams = StampedStreams(lockstep=True)
    assert order_of(streams, 10.0) == [True]
    for late, new in ((5.0, 10.005), (5.005, 10.01), (5.01, 10.015)):
        assert order_of(streams, late, new) == [False, True]
    assert order_of(streams, 5.0, 4.0, 3.0, 2.0) == [False] * 4
    assert streams.reboots == 0


def test_a_parameter_that_is_no_number_is_reported_and_holds_back() -> None:
    """RC_OPTIONS is looked at bit by bit: a NaN has none, and must not end the process."""
    needs = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=False)
    talk = Session(
        SessionOptions(own=OWN, flavour=ArduPilot(CHANNELS, 1), loop_rate_hz=200.0, needs=needs)
    )
    receive(talk, MANUAL, 0.0)
    sent = ParamValue(
        param_id="RC_OPTIONS", param_value=nan, param_type=9, param_count=900, param_index=5
    )
    receive(talk, sent, 0.0)
    for i in range(3000):
        talk.poll(i * 0.02)
    assert any("RC_OPTIONS" in text for _, text in talk.notices)
    assert "RC_OPTIONS" in talk.inquiry.held_back()


@pytest.mark.parametrize("silent_s", [250.0, 700.0, 4000.0, 9000.0])
def test_a_counter_that_has_begun_again_in_a_long_silence_goes_on(silent_s: float) -> None:
    """SERVO_OUTPUT_RAW counts microseconds in 32 bits: 71.6 minutes."""
    streams, times = StampedStreams(lockstep=False), []
    step_s, begins_s, resumes_s = 0.25, 4100.0, 4100.0 + silent_s
    for i in range(round((silent_s + 200.0) / step_s)):
        stamp_s = 4000.0 + step_s * i
        now_s = stamp_s + 7000.0
        assert streams.time_of("attitude", stamp_s, now_s, quantised=True) is not None
        if not begins_s < stamp_s < resumes_s:
            stamp_us = round(stamp_s * 1e6) % 2**32
            found = streams.time_of("servos", stamp_us * 1e-6, now_s, wrap_s=MICROSECONDS_WRAP_S)
            assert found is not None
            times.append(found[0] - now_s)
    assert len(times) > 700
    assert max(map(abs, times)) < 1e-3
    assert streams.reboots == streams.refused == 0

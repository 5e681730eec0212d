"""A clock that was reset above the last stamp received, against samples that are only late."""

from math import isfinite

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.clock import MILLISECONDS_WRAP_S, STEADY_LATE_S, StampedStreams
from tgl_soar.link.messages import AttitudeQuaternion, Heartbeat, LocalPositionNed, Received, Source
from tgl_soar.link.session import Session, SessionOptions

OWN = Source(1, 191)
SERVO = SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900)
ATTITUDE, POSITION = "attitude", "position"


class Ages:
    """Streams at 100 and 20 Hz of one clock, and how old the attitudes are when they come."""

    def __init__(self) -> None:
        self.streams = StampedStreams(lockstep=False)
        self.attitude_s = self.position_s = 0.0

    def receive(self, key: str, uptime_s: float, now_s: float) -> float:
        times = self.streams.time_of(key, uptime_s % MILLISECONDS_WRAP_S, now_s, quantised=True)
        assert times is not None
        return now_s - times[0]

    def run(
        self, now_s: float, uptime_s: float, for_s: float, late_s: float = 0.0, pace: float = 1.0
    ) -> None:
        """From a wall time and an uptime on; pace: uptime that arrives in a second."""
        for i in range(round(for_s * 100)):
            then_s, wall_s = uptime_s + 0.01 * i, now_s + 0.01 * i / pace
            self.attitude_s = self.receive(ATTITUDE, then_s, wall_s)
            if i % 5 == 0:
                self.position_s = self.receive(POSITION, then_s - late_s, wall_s)


def test_a_restart_above_the_last_stamp_is_a_new_clock() -> None:
    """Up for 5 s, 10 s of silence, received again when it has been up for 8 s."""
    ages = Ages()
    ages.run(2.0, 2.0, 5.0)
    ages.run(17.0, 10.0, 0.9 * STEADY_LATE_S)
    assert ages.streams.reboots == 0
    assert ages.attitude_s == pytest.approx(7.0, abs=0.01)
    ages.run(17.0 + STEADY_LATE_S, 10.0 + STEADY_LATE_S, 1.0)
    assert ages.streams.reboots == 1
    assert ages.attitude_s < 0.01
    assert ages.position_s < 0.01
    ages.run(20.0, 13.0, 60.0)
    assert ages.streams.reboots == 1


def test_what_has_waited_while_we_stood_still_is_no_restart() -> None:
    """Three seconds at once, thirty in six, and what is received is then as fresh as ever."""
    ages = Ages()
    ages.run(2.0, 2.0, 5.0)
    ages.run(10.0, 7.0, 3.0, pace=1e3)
    ages.run(10.003, 10.003, 5.0)
    assert ages.attitude_s < 0.01
    ages.run(45.003, 15.003, 36.0, pace=6.0)
    ages.run(51.003, 51.003, 1.0)
    assert ages.streams.reboots == 0
    assert ages.attitude_s < 0.01


def test_a_link_that_has_become_slow_is_no_restart() -> None:
    ages = Ages()
    ages.run(2.0, 2.0, 5.0)
    ages.run(9.0, 7.0, 20.0)
    assert ages.streams.reboots == 0
    assert ages.attitude_s == pytest.approx(2.0, abs=0.01)  # and says so


def test_one_stream_that_is_late_alone_is_late() -> None:
    """A position that was true 3 s ago must not pass for new."""
    ages = Ages()
    ages.run(2.0, 2.0, 5.0)
    ages.run(7.0, 7.0, 3.0)
    for i in range(100):  # the positions skip: they are of 3 s before, then go on
        ages.receive(ATTITUDE, 15.0 + 0.05 * i, 15.0 + 0.05 * i)
        late = ages.receive(POSITION, 12.0 + 0.05 * i, 15.0 + 0.05 * i)
    assert late == pytest.approx(3.0, abs=0.01)
    assert ages.streams.reboots == 0


def test_a_counter_that_wraps_is_no_restart() -> None:
    ages = Ages()
    ages.run(2.0, MILLISECONDS_WRAP_S - 2.0, 5.0)
    assert ages.streams.reboots == 0
    assert ages.attitude_s < 0.01


def test_the_session_asks_again_and_says_so() -> None:
    talk = Session(
        SessionOptions(
            own=OWN,
            flavour=ArduPilot(SurfaceChannels(elevator=SERVO, aileron=SERVO, rudder=SERVO), 1),
            loop_rate_hz=200.0,
        )
    )

    def stretch(now_s: float, uptime_s: float, for_s: float) -> None:
        for i in range(round(for_s * 200)):
            wall_s, stamp = now_s + 0.005 * i, round(1e3 * uptime_s) + 5 * i
            messages = [
                AttitudeQuaternion(
                    time_boot_ms=stamp,
                    q1=1,
                    q2=0,
                    q3=0,
                    q4=0,
                    rollspeed=0,
                    pitchspeed=0,
                    yawspeed=0,
                )
            ]
            if i % 4 == 0:
                talk.handle(
                    Received(
                        talk.autopilot,
                        LocalPositionNed(time_boot_ms=stamp, x=0, y=0, z=0, vx=0, vy=0, vz=0),
                    ),
                    wall_s,
                )
            if i % 200 == 0:
                talk.handle(
                    Received(
                        talk.autopilot,
                        Heartbeat(
                            type=1, autopilot=3, base_mode=129, custom_mode=0, system_status=4
                        ),
                    ),
                    wall_s,
                )
            for message in messages:
                talk.handle(Received(talk.autopilot, message), wall_s)

    stretch(2.0, 2.0, 5.0)
    stretch(17.0, 10.0, 3.0)
    assert talk.counters.reboots == talk.status.boots == 1
    assert any("autopilot restarted" in text for _, text in talk.notices)
    assert 20.0 - talk.attitude.time_s < 0.02
    assert 20.0 - talk.position.time_s < 0.04


@given(
    st.lists(
        st.tuples(
            st.sampled_from((ATTITUDE, POSITION)),
            st.one_of(st.floats(0, 30), st.floats(0, MILLISECONDS_WRAP_S)),
            st.floats(0, 20),
        ),
        max_size=80,
    )
)
def test_whatever_stamps_come_times_are_finite_and_not_of_the_future(
    stamps: list[tuple[str, float, float]],
) -> None:
    streams, now = StampedStreams(lockstep=False), 100.0
    for key, stamp_s, step_s in stamps:
        now += step_s
        times = streams.time_of(key, stamp_s, now, quantised=True)
        if times is not None:
            assert isfinite(times[0])
            assert times[0] <= now + 1e-3

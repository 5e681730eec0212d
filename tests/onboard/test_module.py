"""The module without sockets: bytes and time in, frames out, read back by pymavlink."""

import itertools
import random
from collections.abc import Callable, Iterator
from math import isfinite, nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.supervisor import (
    BOOT,
    CAPTURING,
    HOLDING,
    READY,
    RELEASED,
    SOARING,
    STANDBY,
)
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.clock import ROW
from tgl_soar.link.messages import Source
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.operators import ABSENT_S
from tgl_soar.onboard.search_switch import SearchEngine
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.onboard.surface_control import RELEASE_FRAMES
from tgl_soar.onboard.telemetry_values import FAST, SLOW

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
STEP_S = 0.0005


def setup() -> ModuleSetup:
    return ModuleSetup(
        own=Source(1, 191),
        override=Source(255, 191),
        flavour=ArduPilot(CHANNELS, 1),
        frame=SoaringFrame(0.0, 0.0, 0.0, 0.0),
        parameters=ParameterSet(),
    )


class Flight:
    """The module, and a vehicle that hangs in the air where it is and says so."""

    def __init__(
        self,
        *,
        lockstep: bool = False,
        now_s: float = 1000.0,
        flown: ModuleSetup | None = None,
        before_first: Callable[[], None] = lambda: None,
        search: SearchEngine | None = None,
    ) -> None:
        self.now_s = now_s
        self.boot_s = now_s  # when the vehicle's clock began
        self.frames: list[bytes] = []
        self.console: list[str] = []
        self.takes = True
        self.onboard = Onboard(
            flown or setup(),
            self._send,
            now_s,
            ModuleOptions(
                lockstep=lockstep,
                console=self.console.append,
                before_first=before_first,
                search=search,
            ),
        )
        self.attitude_hz, self.position_hz, self.heartbeat_hz = 200.0, 50.0, 1.0
        self.status = mavlink.MAV_STATE_ACTIVE
        self.kind = (1, 3)  # MAV_TYPE, MAV_AUTOPILOT
        self.mode = 0
        self.base_mode = 81  # disarmed
        self.quaternion = [1.0, 0.0, 0.0, 0.0]
        self.north_m = 0.0
        self._sent = 0
        self._vehicle = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._due = {"attitude": now_s, "position": now_s, "heartbeat": now_s}

    def _send(self, frame: bytes) -> bool:
        if self.takes:
            self.frames.append(frame)
        return self.takes

    @property
    def mode_now(self) -> int:
        output = self.onboard.output
        return output.mode if output is not None else -1

    def receive(self, message: Any, *, station: bool = False) -> None:
        sender = self._station if station else self._vehicle
        frame = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        self.onboard.event(bytes(frame), self.now_s)

    def set(self, name: str, value: float) -> None:
        self.receive(
            mavlink.MAVLink_param_set_message(1, 191, name.encode(), value, 9), station=True
        )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            stamp_ms = round((self.now_s - self.boot_s) * 1e3)
            noise = 1e-6 * (stamp_ms % 7)  # nothing that is measured repeats itself
            if self._is_due("heartbeat", self.heartbeat_hz):
                self.receive(
                    mavlink.MAVLink_heartbeat_message(
                        *self.kind, self.base_mode, self.mode, self.status, 3
                    )
                )
            if self._is_due("position", self.position_hz):
                self.receive(
                    mavlink.MAVLink_local_position_ned_message(
                        stamp_ms, self.north_m, 0, noise, 0, 0, 0
                    )
                )
            if self._is_due("attitude", self.attitude_hz):
                qw, qx, qy, qz = self.quaternion
                qx += noise
                self.receive(
                    mavlink.MAVLink_attitude_quaternion_message(stamp_ms, qw, qx, qy, qz, 0, 0, 0)
                )
            if self.onboard.clocking.due(self.now_s):
                self.onboard.periodic(self.now_s)

    def _is_due(self, what: str, rate_hz: float) -> bool:
        if rate_hz <= 0.0:
            self._due[what] = self.now_s
            return False
        if self.now_s < self._due[what] - 1e-9:
            return False
        self._due[what] += 1.0 / rate_hz
        return True

    def outbound(self, kind: str | None = None) -> list[Any]:
        """What was sent since the last call."""
        frames, self._sent = self.frames[self._sent :], len(self.frames)
        messages = [mavlink.MAVLink(None).decode(bytearray(f)) for f in frames]
        return [m for m in messages if kind is None or m.get_type() == kind]

    def engaged(self) -> "Flight":
        self.run(1.0)
        self.set("OP_ENGAGE", 1.0)
        self.run(0.1)
        assert self.mode_now == CAPTURING
        return self


@pytest.fixture
def flight() -> Flight:
    return Flight()


def texts(messages: list[Any]) -> list[str]:
    return [m.text for m in messages if m.get_type() == "STATUSTEXT"]


# --- keeping time -----------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 250.0])
@pytest.mark.parametrize("attitude_hz", [0.0, 50.0, 200.0])
def test_ticks_come_at_exactly_the_rate_that_is_claimed(rate_hz: float, attitude_hz: float) -> None:
    flight = Flight()
    flight.attitude_hz = attitude_hz
    flight.run(0.5)
    flight.set("LOOP_RATE", rate_hz)
    flight.run(0.5)
    before = flight.onboard.counters.ticks
    flight.run(10.0)
    assert flight.onboard.counters.ticks - before == pytest.approx(10 * rate_hz, abs=1)
    assert flight.onboard.pacer.counters.skipped == 0


def test_every_loop_runs_at_its_own_rate(flight: Flight) -> None:
    flight.engaged().run(1.0)
    flight.outbound()
    flight.run(10.0)
    count: dict[tuple[str, int], int] = {}
    names: dict[str, int] = {}
    for m in flight.outbound():
        key = (m.get_type(), m.get_srcSystem())
        count[key] = count.get(key, 0) + 1
        if m.get_type() == "NAMED_VALUE_FLOAT":
            names[m.name] = names.get(m.name, 0) + 1
    assert count["HEARTBEAT", 1] == 10
    assert count["RC_CHANNELS_OVERRIDE", 255] == pytest.approx(2000, abs=1)
    assert set(names) == {*FAST, *SLOW}
    assert all(names[name] == pytest.approx(50, abs=1) for name in FAST)
    assert all(names[name] == pytest.approx(10, abs=1) for name in SLOW)
    assert count["DEBUG_FLOAT_ARRAY", 1] == pytest.approx(20, abs=1)
    assert all(key[1] == 1 for key in count if key[0] != "RC_CHANNELS_OVERRIDE")


def test_ticks_follow_the_attitude_where_it_comes_at_the_rate(flight: Flight) -> None:
    flight.run(5.0)
    counters = flight.onboard.pacer.counters
    assert counters.on_sample >= counters.ticks - 40


def test_ticks_follow_an_attitude_that_comes_with_odometry(flight: Flight) -> None:
    """A vehicle that sends its attitude in no other message."""
    flight.attitude_hz = flight.position_hz = 0.0
    flight.run(0.5)
    assert not flight.onboard.pacer.locked
    for n in range(200):
        flight.run(0.005)
        x = 1e-6 * (n % 7)
        flight.receive(
            mavlink.MAVLink_odometry_message(
                time_usec=round((flight.now_s - flight.boot_s) * 1e6),
                frame_id=mavlink.MAV_FRAME_LOCAL_NED,
                child_frame_id=mavlink.MAV_FRAME_LOCAL_NED,
                x=x, y=0.0, z=0.0, q=[1.0, x, 0.0, 0.0], vx=0.0, vy=0.0, vz=0.0,
                rollspeed=0.0, pitchspeed=0.0, yawspeed=0.0,
                pose_covariance=[nan] * 21, velocity_covariance=[nan] * 21,
            )
        )  # fmt: skip
    assert flight.onboard.session.attitude.sequence > 100
    assert flight.onboard.pacer.locked


def test_the_heartbeat_tells_the_mode_at_once(flight: Flight) -> None:
    flight.run(1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.05)
    flight.attitude_hz = 0.0
    flight.run(0.5)
    reported = [(m.custom_mode & 0xFF, m.system_status) for m in flight.outbound("HEARTBEAT")]
    assert (CAPTURING, mavlink.MAV_STATE_ACTIVE) in reported
    assert (RELEASED, mavlink.MAV_STATE_CRITICAL) in reported
    assert reported[-1] == (flight.mode_now, mavlink.MAV_STATE_STANDBY)


# --- greeting ---------------------------------------------------------------------------------


def test_the_heartbeat_is_the_first_thing_said(flight: Flight) -> None:
    flight.takes = False  # nothing was received yet
    flight.run(0.3)
    assert flight.frames == []
    flight.takes = True
    flight.set("TGL_X", 1.0)
    first = flight.outbound()
    assert [m.get_type() for m in first[:2]] == ["HEARTBEAT", "PARAM_VALUE"]
    assert (first[0].get_srcSystem(), first[0].get_srcComponent()) == (1, 191)
    assert (first[0].type, first[0].autopilot) == (18, 8)


def test_the_streams_are_asked_for(flight: Flight) -> None:
    flight.attitude_hz = flight.position_hz = 0.0
    flight.run(3.0)
    asked = {(m.param1, m.param2) for m in flight.outbound("COMMAND_LONG")}
    assert {(31.0, 5000.0), (32.0, 20000.0), (36.0, 20000.0), (27.0, 5000.0)} <= asked


def test_a_new_peer_is_greeted_before_anything_else(flight: Flight) -> None:
    flight.run(1.5)
    flight.outbound()
    flight.onboard.relinked()
    flight.set("TGL_X", 1.0)
    assert [m.get_type() for m in flight.outbound()[:2]] == ["HEARTBEAT", "PARAM_VALUE"]


# --- surfaces ---------------------------------------------------------------------------------


def test_no_surface_moves_before_it_is_engaged(flight: Flight) -> None:
    flight.run(3.0)
    assert flight.outbound("RC_CHANNELS_OVERRIDE") == []


def test_overrides_go_out_as_their_own_sender_with_their_own_count(flight: Flight) -> None:
    flight.engaged().run(1.0)
    sent = flight.outbound()
    overrides = [m for m in sent if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    others = [m for m in sent if m.get_type() != "RC_CHANNELS_OVERRIDE"]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in overrides} == {(255, 191)}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in others} == {(1, 191)}
    for messages in (overrides, others):
        seqs = [m.get_seq() for m in messages]
        assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(seqs))
    for m in overrides:
        assert 1100 <= m.chan2_raw <= 1900
        assert m.chan3_raw == m.chan5_raw == 65535
        assert m.chan9_raw == m.chan18_raw == 0


def assert_released(messages: list[Any]) -> None:
    """The last overrides give the three channels back, a few times, and then there are none."""
    overrides = [m for m in messages if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    released = [m for m in overrides if m.chan2_raw == 0]
    assert len(released) == RELEASE_FRAMES
    assert overrides[-RELEASE_FRAMES:] == released
    for m in released:
        assert (m.chan1_raw, m.chan2_raw, m.chan4_raw) == (0, 0, 0)
        assert m.chan3_raw == 65535


def test_letting_go_releases_the_channels_and_is_silent(flight: Flight) -> None:
    flight.engaged()
    flight.set("OP_ENGAGE", 0.0)
    flight.run(2.0)
    sent = flight.outbound()
    assert_released(sent)
    assert texts(sent)[-2:] == ["standby: operator disengaged", "ready: can be engaged"]
    flight.run(2.0)
    assert flight.outbound("RC_CHANNELS_OVERRIDE") == []


def test_engaging_again_during_the_release_takes_the_surfaces_again(flight: Flight) -> None:
    flight.engaged()
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.05)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.02)
    flight.outbound()
    flight.run(1.0)
    assert all(m.chan2_raw != 0 for m in flight.outbound("RC_CHANNELS_OVERRIDE"))


def test_stopping_gives_the_surfaces_back(flight: Flight) -> None:
    flight.engaged()
    flight.onboard.stop()
    sent = flight.outbound()
    assert_released(sent)
    assert texts(sent)[-1] == "tgl_soar stopped"


# --- faults -----------------------------------------------------------------------------------


def silent_autopilot(flight: Flight) -> None:
    flight.heartbeat_hz = 0.0


def other_mode(flight: Flight) -> None:
    flight.mode = 10


def no_attitude(flight: Flight) -> None:
    flight.attitude_hz = 0.0


def no_position(flight: Flight) -> None:
    flight.position_hz = 0.0


def broken_attitude(flight: Flight) -> None:
    flight.quaternion = [nan, 0.0, 0.0, 0.0]


def far_away(flight: Flight) -> None:
    flight.north_m = 300.0


FAULTS = [
    (silent_autopilot, "autopilot silent", 5.0),
    (other_mode, "autopilot not in the mode that obeys", 1.5),
    (no_attitude, "attitude lost", 0.5),
    (no_position, "position lost", 4.0),
    (broken_attitude, "attitude lost", 0.5),
    (far_away, "e_rho beyond CAPTURE_MAX", 2.0),
]


@pytest.mark.parametrize(("fault", "reason", "within_s"), FAULTS)
def test_a_fault_disengages_and_turns_the_switch_back(
    flight: Flight, fault: Any, reason: str, within_s: float
) -> None:
    flight.engaged().outbound()
    fault(flight)
    flight.run(within_s + 1.0)
    sent = flight.outbound()
    assert_released(sent)
    switch = [m for m in sent if m.get_type() == "PARAM_VALUE" and m.param_id == "OP_ENGAGE"]
    assert [m.param_value for m in switch if m.param_value != 2.0] == [0.0]  # 2: it had engaged
    assert any(text == f"released: {reason}" for text in texts(sent))
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert flight.mode_now in (STANDBY, READY)  # what is missing is missing still


def test_a_short_gap_in_the_position_is_flown_through(flight: Flight) -> None:
    flight.engaged()
    flight.position_hz = 0.0
    flight.run(0.6)
    assert flight.mode_now == HOLDING
    flight.position_hz = 50.0
    flight.run(0.2)
    assert flight.mode_now == CAPTURING


def test_a_refused_engagement_turns_the_switch_back_too(flight: Flight) -> None:
    flight.mode = 10
    flight.run(1.0)
    flight.outbound()
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    sent = flight.outbound()
    assert "released: autopilot not in the mode that obeys" in texts(sent)
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert [m for m in sent if m.get_type() == "RC_CHANNELS_OVERRIDE"] == []


def test_an_autopilot_that_restarts_in_flight_is_released_and_waits_to_be_asked(
    flight: Flight,
) -> None:
    flight.engaged().outbound()
    flight.boot_s = flight.now_s
    flight.run(5.0)
    sent = flight.outbound()
    assert "released: autopilot has restarted" in texts(sent)
    asked = {m.param1 for m in sent if m.get_type() == "COMMAND_LONG" and m.command == 511}
    assert {31.0, 32.0} <= asked  # the streams, attitude and position among them, once more
    assert flight.mode_now == READY
    assert flight.onboard.session.counters.reboots == 1


@settings(max_examples=30, deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=20), st.randoms(use_true_random=False))
def test_whatever_arrives_commands_stay_inside_the_channels(
    garbage: list[bytes], chance: random.Random
) -> None:
    flight = Flight().engaged()
    flight.outbound()
    for junk in garbage:
        flight.onboard.event(junk, flight.now_s)
        numbers = [chance.choice([nan, 0.0, 1.0, 1e38, -1e38]) for _ in range(7)]
        stamp = chance.choice([0, 1500, 2**32 - 1])
        flight.receive(mavlink.MAVLink_attitude_quaternion_message(stamp, *numbers))
        flight.receive(mavlink.MAVLink_local_position_ned_message(stamp, *numbers[:6]))
        flight.run(0.02)
    for m in flight.outbound("RC_CHANNELS_OVERRIDE"):
        for pulse in (m.chan1_raw, m.chan2_raw, m.chan4_raw):
            assert pulse == 0 or 1100 <= pulse <= 1900
    assert flight.onboard.counters.unsendable == 0


def test_a_flood_of_sets_cannot_put_off_the_tick(flight: Flight) -> None:
    """`run` asks between two datagrams whether the tick can wait."""
    flight.engaged()
    assert not flight.onboard.clocking.overdue(flight.now_s)
    flight.now_s += 0.0076  # half a period more than the locked loop waits for its sample
    for i in range(50):
        flight.set("TGL_X", i / 100)
    assert flight.onboard.clocking.overdue(flight.now_s)


# --- settings ---------------------------------------------------------------------------------


def test_a_set_line_is_flown_on_the_next_tick(flight: Flight) -> None:
    flight.run(0.5)
    flight.set("TGL_X", 0.25)
    flight.set("TGL_CAPTURE", 0.08)
    flight.run(0.01)
    assert flight.onboard.counters.laws_changed == 1  # one tick, however many were set
    assert flight.onboard.output is not None
    assert flight.onboard.output.line.x_m == 0.25


def test_a_refused_set_leaves_the_laws_alone(flight: Flight) -> None:
    flight.run(0.5)
    flight.set("TGL_X", nan)
    assert flight.onboard.counters.laws_changed == 0
    sent = flight.outbound()
    answer = ["PARAM_VALUE", "PARAM_ERROR", "STATUSTEXT"]
    assert [m.get_type() for m in sent[-3:]] == answer
    assert sent[-2].error == mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
    assert sent[-2].param_id == "TGL_X"
    assert "not finite" in sent[-1].text


def test_what_is_reported_to_the_operator_is_reported_on_the_console(flight: Flight) -> None:
    flight.engaged()
    assert "capturing: engaged" in flight.console


# --- lockstep ---------------------------------------------------------------------------------


def simulator(flight: Flight, steps: int) -> Iterator[int]:
    """Steps of 5 ms as a simulator sends them; what comes back is left in `flight.frames`."""
    for i in range(steps):
        noise = 1e-6 * (i % 7)  # nothing that is measured repeats itself
        if i % 200 == 0:
            flight.receive(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        if i % 4 == 0:
            flight.receive(mavlink.MAVLink_local_position_ned_message(i * 5, 0, 0, noise, 0, 0, 0))
        flight.receive(mavlink.MAVLink_attitude_quaternion_message(i * 5, 1, noise, 0, 0, 0, 0, 0))
        flight.receive(mavlink.MAVLink_timesync_message(0, 1_000_000_000 + i * 5_000_000))
        yield i


def test_in_lockstep_each_new_attitude_is_one_tick_and_nothing_else_is() -> None:
    flight = Flight(lockstep=True)
    for i in simulator(flight, 1000):
        assert flight.onboard.counters.ticks == i + 1
        assert flight.onboard.output is not None
        assert flight.onboard.output.time_s == pytest.approx(i * 0.005)
        flight.now_s += 0.5  # the wall clock runs 100 times faster, and does not matter
        assert not flight.onboard.clocking.due(flight.now_s)
        flight.onboard.idle(flight.now_s)
    flight.receive(mavlink.MAVLink_attitude_quaternion_message(4995, 1, 0, 0, 0, 0, 0, 0))
    flight.receive(mavlink.MAVLink_attitude_quaternion_message(4990, 1, 0, 0, 0, 0, 0, 0))
    assert flight.onboard.counters.ticks == 1000


def test_in_lockstep_the_answer_to_timesync_comes_after_the_tick_s_frames() -> None:
    flight = Flight(lockstep=True)
    for i in simulator(flight, 400):
        sent = flight.outbound()
        if i == 200:
            flight.set("OP_ENGAGE", 1.0)
        assert sent[-1].get_type() == "TIMESYNC"
        assert sent[-1].ts1 == 1_000_000_000 + i * 5_000_000
        assert sent[-1].tc1 != 0
        if i > 201:
            assert "RC_CHANNELS_OVERRIDE" in [m.get_type() for m in sent]


def test_in_lockstep_the_wall_clock_leaves_no_trace() -> None:
    """Two flights, one on a slow machine that was idle for a while before: the same bytes."""
    traces = []
    for idle, slow in ((3, 0.001), (500, 0.9)):
        flight = Flight(lockstep=True, now_s=7.0 if idle == 3 else 123456.0)
        flight.receive(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        for _ in range(idle):
            flight.now_s += 0.05
            flight.onboard.idle(flight.now_s)
        assert {m.get_type() for m in flight.outbound()} == {"HEARTBEAT"}
        del flight.frames[:]
        for i in simulator(flight, 1200):
            flight.now_s += slow
            flight.onboard.idle(flight.now_s)
            if i == 300:
                flight.set("OP_ENGAGE", 1.0)
            if i == 600:
                flight.set("TGL_X", nan)
        traces.append(flight.frames)
    assert len(traces[0]) > 2300
    assert traces[0] == traces[1]


def test_in_lockstep_a_simulator_that_begins_again_finds_the_module_in_standby() -> None:
    flight = Flight(lockstep=True)
    for i in simulator(flight, 800):
        if i == 300:
            flight.set("OP_ENGAGE", 1.0)
    assert flight.mode_now == CAPTURING or flight.mode_now == SOARING
    for i in simulator(flight, 100):
        if i >= ROW - 1:
            assert flight.mode_now in (BOOT, STANDBY, READY)
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert flight.onboard.output is not None
    assert flight.onboard.output.time_s == pytest.approx(99 * 0.005)
    assert isfinite(flight.onboard.output.vehicle.x_m)


# --- stations that come back ------------------------------------------------------------------


def station_beats(flight: Flight, seconds: float) -> list[Any]:
    """A ground station's heartbeats, and what the module says meanwhile."""
    flight.outbound()
    for _ in range(round(seconds)):
        flight.receive(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), station=True)
        flight.run(1.0)
    return flight.outbound()


def test_a_station_that_was_away_receives_the_state(flight: Flight) -> None:
    station_beats(flight, 2.0)
    flight.engaged()
    flight.run(1.5)
    flight.run(ABSENT_S)
    sent = station_beats(flight, 1.0)
    shown = [m.param_value for m in sent if m.get_type() == "PARAM_VALUE"]
    assert shown == [2.0]
    assert "soaring" in texts(sent) or "capturing" in texts(sent)
    # And one that was not away, or is unknown, is sent nothing of it.
    assert not [m for m in station_beats(flight, 3.0) if m.get_type() == "PARAM_VALUE"]


def test_what_is_wrong_with_a_stream_is_reported_with_the_mode(flight: Flight) -> None:
    flight.engaged().outbound()
    flight.north_m = 300.0
    flight.run(1.0)
    sent = texts(flight.outbound())
    where = sent.index("released: e_rho beyond CAPTURE_MAX")
    assert sent[where + 1] == "position jumps"

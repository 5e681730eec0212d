"""Streams and commands of the simulated autopilot: default rates, groups, intervals and their
limits, and the result of every command."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.routing import RoutedFrame, split_frames
from tgl_soar.sim.vehicle.commands import take_command
from tgl_soar.sim.vehicle.message_streams import GROUND_RATES_HZ
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.sensed import GROUNDED, Sensed
from tgl_soar.sim.vehicle.vehicle_links import VehicleLink
from tgl_soar.types import AttitudeSample, PositionFix

SURFACES = load_airframe(shipped("airframes/eclipson_c.toml")).surfaces
STEP_HZ = 200
COMPANION, STATION = 1, 2
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4  # MAV_RESULT


def sensed(step: int, *, flying: bool = False) -> Sensed:
    """Every sample new, taken at that step."""
    time_s = step / STEP_HZ
    return GROUNDED._replace(
        attitude=AttitudeSample(
            sequence=step,
            time_s=time_s,
            qw=1.0,
            qx=0.0,
            qy=0.0,
            qz=0.0,
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        ),
        position=PositionFix(
            sequence=step,
            time_s=time_s,
            north_m=1.0,
            east_m=2.0,
            down_m=3.0,
            velocity_north_mps=0.0,
            velocity_east_mps=0.0,
            velocity_down_mps=0.0,
        ),
        flying=flying,
    )


class Autopilot:
    """With one link of each kind."""

    def __init__(self, **options: Any) -> None:
        self.pixhawk = Pixhawk(SURFACES, STEP_HZ, **options)
        self.pixhawk.add_link(COMPANION, ground=False)
        self.pixhawk.add_link(STATION, ground=True)

    def steps(self, n: int, *, flying: bool = False) -> dict[int, list[Any]]:
        """What each link receives in so many steps."""
        for _ in range(n):
            self.pixhawk.step(sensed(self.pixhawk.steps + 1, flying=flying))
        received: dict[int, list[Any]] = {COMPANION: [], STATION: []}
        for link, data in self.pixhawk.take_datagrams():
            received[link] += [f.message for f in split_frames(mavlink.MAVLink(None), data)[0]]
        return received

    def counts(self, n: int, link: int) -> dict[str, int]:
        names = [message.get_type() for message in self.steps(n)[link]]
        return {name: names.count(name) for name in sorted(set(names))}

    def command(self, number: int, *params: float, link: int = COMPANION) -> list[Any]:
        """Of a ground station, 255; what is answered on its link."""
        seven = [*params, *[0.0] * (7 - len(params))]
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *seven)
        self.pixhawk.receive(link, bytes(message.pack(mavlink.MAVLink(None, 255, 190))))
        return [
            frame.message
            for to, data in self.pixhawk.take_datagrams()
            if to == link
            for frame in split_frames(mavlink.MAVLink(None), data)[0]
        ]

    def result(self, number: int, *params: float, link: int = COMPANION) -> int:
        answers = self.command(number, *params, link=link)
        acknowledged = [m for m in answers if m.get_type() == "COMMAND_ACK"]
        assert len(acknowledged) == 1
        assert acknowledged[0].command == number
        return int(acknowledged[0].result)


@pytest.fixture
def autopilot() -> Autopilot:
    made = Autopilot()
    made.steps(1)
    return made


# --- rates ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "rate_hz"),
    [
        ("SYS_STATUS", 1),
        ("SYSTEM_TIME", 1),
        ("ATTITUDE", 4),
        ("LOCAL_POSITION_NED", 4),
        ("VFR_HUD", 4),
        ("SERVO_OUTPUT_RAW", 2),
        ("RC_CHANNELS", 2),
    ],
)
def test_a_station_is_sent_so_often_without_a_request(name: str, rate_hz: int) -> None:
    assert Autopilot().counts(2 * STEP_HZ, STATION)[name] == 2 * rate_hz
    assert len(GROUND_RATES_HZ) == 7


def test_a_companion_is_sent_nothing_but_a_heartbeat_a_second() -> None:
    assert Autopilot().counts(3 * STEP_HZ, COMPANION) == {"HEARTBEAT": 3}


@pytest.mark.parametrize(
    ("group", "names"),
    [
        (2, {"SYS_STATUS"}),  # EXTENDED_STATUS
        (3, {"SERVO_OUTPUT_RAW", "RC_CHANNELS"}),  # RC_CHANNELS
        (6, {"GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"}),  # POSITION
        (10, {"ATTITUDE"}),  # EXTRA1
        (11, {"VFR_HUD"}),  # EXTRA2
        (12, {"SYSTEM_TIME"}),  # EXTRA3
        (99, set()),
    ],
)
def test_a_group_of_streams_is_what_its_number_means(group: int, names: set[str]) -> None:
    autopilot = Autopilot()
    codec = mavlink.MAVLink(None, 255, 190)
    start = mavlink.MAVLink_request_data_stream_message(1, 1, group, 10, 1)
    autopilot.pixhawk.receive(COMPANION, bytes(start.pack(codec)))
    counts = autopilot.counts(STEP_HZ, COMPANION)
    del counts["HEARTBEAT"]
    assert set(counts) == names
    assert set(counts.values()) <= {10}
    stop = mavlink.MAVLink_request_data_stream_message(1, 1, group, 10, 0)
    autopilot.pixhawk.receive(COMPANION, bytes(stop.pack(codec)))
    assert autopilot.counts(STEP_HZ, COMPANION) == {"HEARTBEAT": 1}


def test_a_group_of_raw_sensors_is_the_inertial_ones() -> None:
    autopilot = Autopilot()
    start = mavlink.MAVLink_request_data_stream_message(1, 1, 1, 10, 1)
    autopilot.pixhawk.receive(COMPANION, bytes(start.pack(mavlink.MAVLink(None, 255, 190))))
    link = autopilot.pixhawk.links.get(COMPANION)
    assert link is not None
    assert set(link.streams) == {mavlink.MAVLINK_MSG_ID_RAW_IMU}


def test_all_groups_may_be_asked_for_at_once_and_a_rate_of_0_stops_them() -> None:
    autopilot = Autopilot()
    link = autopilot.pixhawk.links.get(COMPANION)
    assert link is not None
    for rate, streams in ((5, 9), (0, 0)):
        request = mavlink.MAVLink_request_data_stream_message(1, 1, 0, rate, 1)
        autopilot.pixhawk.receive(COMPANION, bytes(request.pack(mavlink.MAVLink(None, 255, 190))))
        assert len(link.streams) == streams


def test_an_interval_is_in_microseconds_and_comes_from_the_next_step_on(
    autopilot: Autopilot,
) -> None:
    assert autopilot.result(511, 30, 50_000.0) == ACCEPTED
    received = autopilot.steps(100)[COMPANION]
    stamps = [m.time_boot_ms for m in received if m.get_type() == "ATTITUDE"]
    assert stamps == list(range(10, 510, 50))


@pytest.mark.parametrize(
    ("interval_us", "result"), [(3125.0, ACCEPTED), (3124.0, DENIED), (3126.0, ACCEPTED)]
)
def test_the_fastest_stream_is_four_fifths_of_the_loops_rate(
    autopilot: Autopilot, interval_us: float, result: int
) -> None:
    """320 Hz of 400."""
    assert autopilot.result(511, 30, interval_us) == result


def test_a_stream_that_is_faster_than_the_steps_comes_at_every_step(autopilot: Autopilot) -> None:
    autopilot.command(511, 30, 3125.0)
    assert autopilot.counts(100, COMPANION)["ATTITUDE"] == 100


def test_a_slow_stream_is_as_slow_as_it_was_asked_for(autopilot: Autopilot) -> None:
    autopilot.command(511, 30, 2e9)
    interval, acknowledged = autopilot.command(510, 30)
    assert interval.interval_us == 2_000_000_000
    assert acknowledged.result == ACCEPTED


def test_a_stream_is_not_slower_than_can_be_reported(autopilot: Autopilot) -> None:
    autopilot.command(511, 30, 1e30)
    link = autopilot.pixhawk.links.get(COMPANION)
    assert link is not None
    assert link.streams[30].interval_steps == 2000 * STEP_HZ
    assert autopilot.command(510, 30)[0].interval_us == 2_000_000_000  # below 2**31


def test_what_cannot_be_streamed_is_denied(autopilot: Autopilot) -> None:
    for message_id in (0, 148, 12345, -1):
        assert autopilot.result(511, message_id, 100_000.0) == DENIED


def test_0_is_the_default_of_the_link_and_less_is_never(autopilot: Autopilot) -> None:
    for link, default in ((STATION, 4), (COMPANION, 0)):
        autopilot.command(511, 30, 100_000.0, link=link)
        autopilot.command(511, 30, 0.0, link=link)
        assert autopilot.counts(STEP_HZ, link).get("ATTITUDE", 0) == default
        autopilot.command(511, 30, -1.0, link=link)
        assert "ATTITUDE" not in autopilot.counts(STEP_HZ, link)
    assert autopilot.result(511, 83, 0.0, link=STATION) == DENIED
    assert autopilot.result(511, 33, 0.0, link=STATION) == ACCEPTED  # none by default
    assert "GLOBAL_POSITION_INT" not in autopilot.counts(STEP_HZ, STATION)


def test_the_attitude_goes_last_whatever_is_asked_for_after_it(autopilot: Autopilot) -> None:
    autopilot.command(511, 31, 5000.0)
    autopilot.command(511, 30, 5000.0)
    names = [m.get_type() for m in autopilot.steps(1)[COMPANION]]
    assert names == ["ATTITUDE", "ATTITUDE_QUATERNION"]


@pytest.mark.parametrize(
    ("message_id", "interval_us"),
    [
        (30, -1),  # could be had
        (0, 1_000_000),  # the heartbeat
        (12345, 0),  # not available
        (65535, 0),
    ],
)
def test_an_interval_is_reported(autopilot: Autopilot, message_id: int, interval_us: int) -> None:
    interval, acknowledged = autopilot.command(510, message_id)
    assert (interval.message_id, interval.interval_us) == (message_id, interval_us)
    assert acknowledged.result == ACCEPTED


def test_an_interval_is_reported_in_whole_steps(autopilot: Autopilot) -> None:
    autopilot.command(511, 30, 52_000.0)
    assert autopilot.command(510, 30)[0].interval_us == 50_000


@pytest.mark.parametrize("message_id", [-1, 65536])
def test_the_interval_of_no_message_is_denied(autopilot: Autopilot, message_id: int) -> None:
    assert autopilot.result(510, message_id) == DENIED


# --- commands -------------------------------------------------------------------------------------


def test_a_message_is_sent_once(autopilot: Autopilot) -> None:
    answers = autopilot.command(512, 30)
    assert [m.get_type() for m in answers] == ["ATTITUDE", "COMMAND_ACK"]
    assert answers[1].result == ACCEPTED


def test_the_version_is_sent_as_asked_for_in_either_way(autopilot: Autopilot) -> None:
    for command in ((512, 148), (520, 1)):
        version, acknowledged = autopilot.command(*command)
        assert version.get_type() == "AUTOPILOT_VERSION"
        assert version.flight_sw_version >> 24 == 4
        assert acknowledged.result == ACCEPTED


@pytest.mark.parametrize(
    ("one", "two", "result", "mode"),
    [
        (1.0, 5.0, ACCEPTED, 5),
        (1.0, 0.0, ACCEPTED, 0),
        (3.0, 5.0, ACCEPTED, 5),  # other flags beside
        (0.0, 5.0, DENIED, 0),
        (2.0, 5.0, DENIED, 0),
        (1.0, 7.0, FAILED, 0),
    ],
)
def test_a_mode_is_set_by_its_number(
    autopilot: Autopilot, one: float, two: float, result: int, mode: int
) -> None:
    assert autopilot.result(176, one, two) == result
    assert autopilot.pixhawk.mode == mode
    if mode:
        assert "mode FBWA (asked by system 255)" in autopilot.pixhawk.take_events()


@pytest.mark.parametrize(
    ("flying", "one", "two", "result", "armed"),
    [
        (False, 0.0, 0.0, ACCEPTED, False),
        (True, 0.0, 0.0, FAILED, True),
        (True, 0.0, 21196.0, ACCEPTED, False),
        (True, 0.0, 21195.0, FAILED, True),
        (True, 1.0, 0.0, ACCEPTED, True),
    ],
)
def test_it_is_disarmed_in_flight_only_with_force(
    autopilot: Autopilot, flying: bool, one: float, two: float, result: int, armed: bool
) -> None:
    autopilot.steps(1, flying=flying)
    assert autopilot.result(400, one, two) == result
    assert autopilot.pixhawk.armed == armed


def test_it_shows_at_once_that_it_was_disarmed_and_armed(autopilot: Autopilot) -> None:
    for one in (0.0, 1.0):
        beats = [m for m in autopilot.command(400, one) if m.get_type() == "HEARTBEAT"]
        assert [beat.base_mode >= 128 for beat in beats] == [one == 1.0]
    assert [m.get_type() for m in autopilot.command(400, 1.0)] == ["COMMAND_ACK"]  # it is already


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("place", [0, 1])
def test_a_number_that_is_not_given_is_denied(
    autopilot: Autopilot, value: float, place: int
) -> None:
    params = [1.0, 1.0]
    params[place] = value
    assert autopilot.result(400, *params) == DENIED
    assert autopilot.pixhawk.armed


def test_a_command_that_it_does_not_know_is_unsupported(autopilot: Autopilot) -> None:
    assert autopilot.result(22) == UNSUPPORTED


def test_an_answer_is_for_whoever_asked(autopilot: Autopilot) -> None:
    [acknowledged] = autopilot.command(22)
    assert (acknowledged.target_system, acknowledged.target_component) == (255, 190)
    assert (acknowledged.progress, acknowledged.result_param2) == (0, 0)


def test_a_command_with_whole_numbers_is_a_command_too(autopilot: Autopilot) -> None:
    message = mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1.0, 5.0, 0, 0, 0, 0, 0)
    autopilot.pixhawk.receive(COMPANION, bytes(message.pack(mavlink.MAVLink(None, 255, 190))))
    assert autopilot.pixhawk.mode == 5


def test_an_answer_goes_to_the_link_that_was_given() -> None:
    link = VehicleLink(mavlink.MAVLink(None, 1, 1), ground=False)
    message = mavlink.MAVLink_command_long_message(1, 1, 22, 0, *[0.0] * 7)
    frame = RoutedFrame(b"", message, 9, 8)
    take_command(Pixhawk(SURFACES, STEP_HZ), link, frame)
    assert len(link.outbox) == 1

"""What is asked of an autopilot, how often (docs/sensors.md), and what replaces a refused one."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.messages import (
    RESULT_ACCEPTED,
    RESULT_DENIED,
    RESULT_UNSUPPORTED,
    SEVERITY_WARNING,
)
from tgl_soar.link.sources import (
    DEFAULT_ORDER,
    GLOBAL_POSITION,
    LOCAL_POSITION,
    MOCAP,
    ODOMETRY,
    VISION,
    PositionSources,
)
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.message_rates import MessageRates

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
LOOP_HZ = 200.0
PLANE_ALWAYS = {  # the page's table, of the messages that every ArduPlane is asked for
    "ATTITUDE_QUATERNION": LOOP_HZ,
    "SERVO_OUTPUT_RAW": 50.0,
    "VFR_HUD": 20.0,
    "EKF_STATUS_REPORT": 5.0,
    "SYS_STATUS": 1.0,
}


class Asked:
    """A vehicle's streams, as the module asks for them."""

    def __init__(
        self,
        firmware: str = "ardupilot",
        route: str | None = None,
        imu: int | None = None,
        sources: Sequence[int] = DEFAULT_ORDER,
    ) -> None:
        self.streams = StreamRequests(1)
        self.notices: list[tuple[int, str]] = []
        self.rates = MessageRates(
            flavour(firmware, route, CHANNELS, 1),
            imu,
            LOOP_HZ,
            PositionSources(sources),
            Ledger(SessionCounters(), self.notices, self.streams),
        )
        self.now_s = 0.0

    def wanted(self) -> dict[str, float]:
        """Rates by name; each number is that of its name."""
        found = {stream.name: stream.rate_hz for stream in self.streams.all_wanted()}
        for stream in self.streams.all_wanted():
            assert stream.message_id == getattr(mavlink, f"MAVLINK_MSG_ID_{stream.name}")
        return found

    def beyond(self, always: dict[str, float]) -> dict[str, float]:
        return {n: hz for n, hz in self.wanted().items() if always.get(n) != hz}

    def answer(self, name: str, result: int) -> Asked:
        """All streams are asked for once; the named one is answered otherwise than the rest."""
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        self.now_s += 100.0
        for _ in range(20):
            for command in self.streams.poll(self.now_s):
                is_named = command.params[0] == number
                self.streams.acknowledged(result if is_named else RESULT_ACCEPTED, self.now_s)
                if is_named:
                    self.rates.poll_refusals()
                    return self
        raise AssertionError(f"{name} is not asked for")


# --- what is asked for ---------------------------------------------------------------------------


def test_an_arduplane_is_asked_for_what_the_page_says() -> None:
    assert Asked().wanted() == {**PLANE_ALWAYS, "RAW_IMU": 200.0, "LOCAL_POSITION_NED": 50.0}


def test_a_px4_is_asked_for_its_own_messages() -> None:
    assert Asked("px4", "manual_control").wanted() == {
        "ATTITUDE_QUATERNION": 200.0,
        "HIGHRES_IMU": 200.0,
        "LOCAL_POSITION_NED": 50.0,
        "SERVO_OUTPUT_RAW": 50.0,
        "VFR_HUD": 20.0,
        "ESTIMATOR_STATUS": 5.0,
        "SYS_STATUS": 1.0,
    }


def test_a_paparazzi_has_no_accelerations_and_says_nothing_of_its_estimator() -> None:
    assert Asked("paparazzi").wanted() == {
        "ATTITUDE_QUATERNION": 200.0,
        "LOCAL_POSITION_NED": 50.0,
        "SERVO_OUTPUT_RAW": 50.0,
        "VFR_HUD": 20.0,
        "SYS_STATUS": 1.0,
    }


@pytest.mark.parametrize(
    ("imu", "found"),
    [
        (None, {"RAW_IMU": 200.0}),
        (mavlink.MAVLINK_MSG_ID_SCALED_IMU, {"SCALED_IMU": 200.0}),
        (mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, {"HIGHRES_IMU": 200.0}),
        (mavlink.MAVLINK_MSG_ID_RAW_IMU, {"RAW_IMU": 200.0}),
        (0, {}),
    ],
)
def test_the_airframe_file_chooses_the_accelerations(
    imu: int | None, found: dict[str, float]
) -> None:
    always = {**PLANE_ALWAYS, "LOCAL_POSITION_NED": 50.0}
    assert Asked(imu=imu).beyond(always) == found


@pytest.mark.parametrize(
    ("sources", "found"),
    [
        ((LOCAL_POSITION,), {"LOCAL_POSITION_NED": 50.0}),
        ((LOCAL_POSITION, ODOMETRY), {"LOCAL_POSITION_NED": 50.0}),
        ((ODOMETRY,), {"ODOMETRY": 50.0}),
        ((GLOBAL_POSITION,), {"GLOBAL_POSITION_INT": 50.0}),
        (
            (GLOBAL_POSITION, LOCAL_POSITION),
            {"GLOBAL_POSITION_INT": 50.0, "LOCAL_POSITION_NED": 50.0},
        ),
        ((MOCAP, VISION), {}),  # of another source
    ],
)
def test_positions_are_asked_for_as_the_site_file_names_them(
    sources: tuple[int, ...], found: dict[str, float]
) -> None:
    assert Asked(sources=sources).beyond({**PLANE_ALWAYS, "RAW_IMU": 200.0}) == found


def test_where_the_module_changes_the_mode_heartbeats_are_asked_for_before_all_else() -> None:
    """Five a second: so soon it is known that the pilot has chosen another mode."""
    asked = Asked("px4", "attitude")
    assert asked.wanted()["HEARTBEAT"] == 5.0
    (first,) = asked.streams.poll(0.0)
    assert first.params[:2] == (float(mavlink.MAVLINK_MSG_ID_HEARTBEAT), 200_000.0)
    assert "HEARTBEAT" not in Asked("px4", "manual_control").wanted()
    assert "HEARTBEAT" not in Asked("ardupilot", "override").wanted()
    assert Asked("ardupilot", "attitude").wanted()["HEARTBEAT"] == 5.0


def test_without_that_the_attitude_is_asked_for_first() -> None:
    """Nothing flies without it."""
    (first,) = Asked().streams.poll(0.0)
    assert first.params[:2] == (float(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION), 5_000.0)


def test_another_rate_of_the_loop_changes_attitude_and_accelerations_alone() -> None:
    asked = Asked()
    before = asked.wanted()
    asked.rates.set_loop_rate(100.0)
    assert asked.wanted() == {**before, "ATTITUDE_QUATERNION": 100.0, "RAW_IMU": 100.0}
    without = Asked(imu=0)
    without.rates.set_loop_rate(100.0)
    assert without.wanted()["ATTITUDE_QUATERNION"] == 100.0


def test_receiver_and_rangefinder_are_asked_for_where_there_is_one() -> None:
    asked = Asked()
    before = asked.wanted()
    asked.rates.want_accuracy()
    assert asked.wanted() == {**before, "GPS_RAW_INT": 1.0}
    asked.rates.want_rangefinder()
    assert asked.wanted() == {**before, "GPS_RAW_INT": 1.0, "DISTANCE_SENSOR": 20.0}


# --- what is refused -----------------------------------------------------------------------------


def test_a_rate_that_is_denied_is_asked_for_more_slowly_and_the_way_out_is_reported() -> None:
    asked = Asked().answer("RAW_IMU", RESULT_DENIED)
    words = "RAW_IMU at 200 Hz denied: set SCHED_LOOP_RATE to 250 or more; asking for 160 Hz"
    assert asked.notices == [(SEVERITY_WARNING, words)]
    assert asked.wanted()["RAW_IMU"] == 160.0
    asked.rates.poll_refusals()
    assert len(asked.notices) == 1  # once


def test_each_firmware_has_its_own_way_out() -> None:
    ((_, words),) = Asked("px4").answer("HIGHRES_IMU", RESULT_DENIED).notices
    assert words == (
        "HIGHRES_IMU at 200 Hz denied: raise MAV_x_RATE of this link, and its baud rate;"
        " asking for 160 Hz"
    )


def test_accelerations_that_are_not_there_are_asked_for_by_the_next_message() -> None:
    asked = Asked().answer("RAW_IMU", RESULT_UNSUPPORTED)
    assert asked.notices == [(SEVERITY_WARNING, "RAW_IMU at 200 Hz unsupported")]
    assert "RAW_IMU" not in asked.wanted()
    assert asked.wanted()["SCALED_IMU"] == 200.0
    asked.rates.set_loop_rate(100.0)
    assert asked.wanted()["SCALED_IMU"] == 100.0
    assert "RAW_IMU" not in asked.wanted()
    asked.answer("SCALED_IMU", RESULT_UNSUPPORTED)
    assert not {"RAW_IMU", "SCALED_IMU"} & {*asked.wanted()}
    asked.rates.set_loop_rate(50.0)  # no more to choose from
    assert asked.wanted()["ATTITUDE_QUATERNION"] == 50.0


def test_accelerations_that_were_chosen_have_no_other() -> None:
    asked = Asked(imu=mavlink.MAVLINK_MSG_ID_HIGHRES_IMU).answer("HIGHRES_IMU", RESULT_UNSUPPORTED)
    assert not {"RAW_IMU", "SCALED_IMU", "HIGHRES_IMU"} & {*asked.wanted()}


@pytest.mark.parametrize(
    ("sources", "found"),
    [((LOCAL_POSITION, ODOMETRY), {"ODOMETRY": 50.0}), ((LOCAL_POSITION,), {})],
)
def test_odometry_carries_what_a_local_position_does_where_the_site_file_takes_it(
    sources: tuple[int, ...], found: dict[str, float]
) -> None:
    asked = Asked(sources=sources).answer("LOCAL_POSITION_NED", RESULT_UNSUPPORTED)
    assert asked.beyond({**PLANE_ALWAYS, "RAW_IMU": 200.0}) == found


def test_odometry_is_not_asked_for_where_only_the_rate_was_too_high() -> None:
    asked = Asked().answer("LOCAL_POSITION_NED", RESULT_DENIED)
    assert "ODOMETRY" not in asked.wanted()
    assert asked.wanted()["LOCAL_POSITION_NED"] == 40.0


def test_what_has_nothing_in_its_place_leaves_all_others_as_they_are() -> None:
    asked = Asked()
    before = asked.wanted()
    asked.answer("SERVO_OUTPUT_RAW", RESULT_UNSUPPORTED)
    del before["SERVO_OUTPUT_RAW"]
    assert asked.wanted() == before


def refused(name: str, result: int, firmware: str = "ardupilot") -> str:
    asked = Asked(firmware, "attitude")
    asked.rates.want_accuracy()
    asked.rates.want_rangefinder()
    ((severity, words),) = asked.answer(name, result).notices
    assert severity == SEVERITY_WARNING
    return words


@pytest.mark.parametrize(
    ("firmware", "name", "rate", "words"),
    [
        ("ardupilot", "EKF_STATUS_REPORT", "5", "dead reckoned looks like any other"),
        ("px4", "ESTIMATOR_STATUS", "5", "dead reckoned looks like any other"),
        ("ardupilot", "GPS_RAW_INT", "1", "how accurate the receiver is remains unknown"),
        ("ardupilot", "DISTANCE_SENSOR", "20", "height over the ground is not measured"),
    ],
)
def test_what_is_not_known_without_a_message_is_reported_once_it_is_given_up(
    firmware: str, name: str, rate: str, words: str
) -> None:
    text = refused(name, RESULT_UNSUPPORTED, firmware)
    assert text.startswith(f"{name} at {rate} Hz unsupported: ")
    assert text.endswith(words)


@pytest.mark.parametrize(
    ("name", "slower"), [("EKF_STATUS_REPORT", "2"), ("DISTANCE_SENSOR", "10")]
)
def test_what_comes_more_slowly_is_known_still(name: str, slower: str) -> None:
    text = refused(name, RESULT_DENIED)
    assert "SCHED_LOOP_RATE" in text
    assert text.endswith(f"; asking for {slower} Hz")


def test_the_slowest_rate_that_is_denied_is_given_up() -> None:
    text = refused("GPS_RAW_INT", RESULT_DENIED)
    assert text == "GPS_RAW_INT at 1 Hz denied: how accurate the receiver is remains unknown"


@pytest.mark.parametrize(
    ("result", "end"), [(RESULT_DENIED, "; asking for 2 Hz"), (RESULT_UNSUPPORTED, "")]
)
def test_without_more_heartbeats_the_pilot_s_mode_is_seen_later(result: int, end: str) -> None:
    """They come once a second of themselves."""
    text = refused("HEARTBEAT", result)
    assert text.endswith(f": a mode that the pilot chooses is seen up to a second later{end}")

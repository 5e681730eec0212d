"""What the simulated Pixhawk reports of its sensors, and how it takes a pose."""

from __future__ import annotations

from math import inf, nan, radians, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from samples import attitude_sample, imu_sample
from scipy.spatial.transform import Rotation

from tgl_soar.config.airframe import Surface, Surfaces
from tgl_soar.config.site import HomePosition
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.messages import DistanceSensor, EkfStatusReport, GpsRawInt
from tgl_soar.link.sensor_units import range_of
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.estimator_status import EstimatorAids
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.reports import _body_from_ned
from tgl_soar.sim.vehicle.sensed import Sensed
from tgl_soar.types import (
    NO_ATTITUDE,
    AirspeedSample,
    PositionFix,
    RangeSample,
)

STEP_HZ = 200
LINK = 1
SURFACES = Surfaces(
    elevator=Surface(channel=2, reversed=True),
    aileron=Surface(channel=1),
    rudder=Surface(channel=4, pwm_min=1200, pwm_trim=1510, pwm_max=1800),
)
HOME = HomePosition(latitude_deg=51.99, longitude_deg=4.375, altitude_m=20.0)
FORCE = (0.7654321, -0.3, -9.6543)
RATES = (0.0123456, -0.2, 0.05)


class Wire:
    """A companion's end of the only link."""

    def __init__(self, **options: Any) -> None:
        self.pixhawk = Pixhawk(SURFACES, STEP_HZ, home=HOME, **options)
        self.pixhawk.add_link(LINK, ground=False)
        self.codec = mavlink.MAVLink(None, 1, 191)
        self.reader = mavlink.MAVLink(None)
        self.reader.robust_parsing = True
        self.says(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))

    def says(self, message: Any) -> None:
        self.pixhawk.receive(LINK, bytes(message.pack(self.codec)))

    def wants(self, message_id: int, rate_hz: float) -> None:
        interval_us = 1e6 / rate_hz
        self.says(
            mavlink.MAVLink_command_long_message(
                *(1, 1, 511, 0, message_id, interval_us, 0, 0, 0, 0, 0)
            )
        )

    def runs(self, steps: int, *, pitot: bool = True) -> list[Any]:
        received: list[Any] = []
        for _ in range(steps):
            self.pixhawk.step(sensed(self.pixhawk.steps + 1, pitot=pitot))
            for _, data in self.pixhawk.take_datagrams():
                received += self.reader.parse_buffer(data) or []
        return received


def sensed(step: int, *, pitot: bool = True) -> Sensed:
    time_s = (step - 1) / STEP_HZ
    return Sensed(
        attitude=attitude_sample(step, time_s, (1.0, 0.0, 0.0, 0.0), RATES),
        position=PositionFix(
            sequence=1 + step // 4,
            time_s=time_s,
            north_m=12.0,
            east_m=-34.0,
            down_m=-5.0,
            velocity_north_mps=0.1,
            velocity_east_mps=0.2,
            velocity_down_mps=0.3,
        ),
        airspeed_mps=8.5,
        flying=True,
        imu=imu_sample(step, time_s, FORCE, RATES),
        pitot=AirspeedSample(1 + step // 4, time_s, 9.0) if pitot else AirspeedSample(0, nan, nan),
    )


def named(messages: list[Any], name: str) -> list[Any]:
    return [m for m in messages if m.get_type() == name]


def test_inertial_messages_come_at_the_rate_asked_for_in_their_own_units() -> None:
    wire = Wire(uptime_s=100.0)
    for message_id in (27, 26, 105):
        wire.wants(message_id, 100.0)
    received = wire.runs(200)
    raw, scaled, high = (named(received, n) for n in ("RAW_IMU", "SCALED_IMU", "HIGHRES_IMU"))
    assert len(raw) == len(scaled) == len(high) == 100
    for m in (raw[-1], scaled[-1]):
        # Milli-g and milliradians, cut off toward zero.
        assert (m.xacc, m.yacc, m.zacc) == (78, -30, -984)
        assert (m.xgyro, m.ygyro, m.zgyro) == (12, -200, 50)
    assert (high[-1].xacc, high[-1].zgyro) == pytest.approx((FORCE[0], RATES[2]))
    assert raw[-1].time_usec == high[-1].time_usec == pytest.approx(100.99e6)
    assert scaled[-1].time_boot_ms == 100_990


@pytest.mark.parametrize("reckoned", [False, True])
def test_the_estimator_says_whether_its_position_is_measured(reckoned: bool) -> None:
    """As EKF3: without fixes the absolute position goes, what the wind aids stays."""
    wire = Wire()
    wire.wants(193, 5.0)
    aids = EstimatorAids(Ledger(SessionCounters(), [], StreamRequests(1)))
    for reckons in (False, reckoned):
        for _ in range(200):
            now = sensed(wire.pixhawk.steps + 1)
            now = now._replace(position=now.position._replace(reckoned=reckons))
            wire.pixhawk.step(now)
        datagrams = [data for _, data in wire.pixhawk.take_datagrams()]
        reports = [
            received.message
            for data in datagrams
            for received in Decoder(stream=False).feed(data)
            if isinstance(received.message, EkfStatusReport)
        ]
        assert len(reports) == pytest.approx(200 / STEP_HZ * 5, abs=1)
        for report in reports[1:]:
            aids.on_status(report, 1.0)
            assert aids.reckons == reckons


def test_the_attitude_goes_out_last_in_every_step() -> None:
    wire = Wire()
    wire.wants(31, 200.0)
    for message_id in (27, 32, 36, 74):
        wire.wants(message_id, 200.0)
    for _ in range(20):
        received = wire.runs(1)
        assert received[-1].get_type() == "ATTITUDE_QUATERNION"
        assert len(named(received, "RAW_IMU")) == 1


def test_without_a_sensor_there_is_no_message_and_no_health() -> None:
    wire = Wire()
    wire.wants(1, 1.0)
    wire.wants(74, 10.0)
    status, hud = (named(wire.runs(20, pitot=False), n)[-1] for n in ("SYS_STATUS", "VFR_HUD"))
    assert not status.onboard_control_sensors_present & 16
    assert hud.airspeed == pytest.approx(8.5)  # its own guess


def test_the_airspeed_is_equivalent_and_read_ten_times_a_second() -> None:
    wire = Wire()
    wire.wants(1, 1.0)
    wire.wants(74, 50.0)
    received = wire.runs(20)
    assert named(received, "SYS_STATUS")[-1].onboard_control_sensors_health & 16
    hud = named(received, "VFR_HUD")[-1]
    assert hud.alt == pytest.approx(25.0)
    assert hud.airspeed == pytest.approx(9.0 * sqrt((1 - 2.25577e-5 * 25.0) ** 4.2559), abs=1e-3)


def test_differential_pressure_is_the_barometer_s_on_the_one_and_the_pitot_s_on_the_other() -> None:
    """9 m/s are 0.495 hPa at 25 m; a pitot that is read every fourth step is new as often."""
    for px4 in (False, True):
        wire = Wire(allow_odometry=px4)
        wire.wants(105, 200.0)
        high = named(wire.runs(41), "HIGHRES_IMU")
        marked = [bool(m.fields_updated & 1 << 10) for m in high]
        assert all(m.fields_updated & 0x3F == 0x3F for m in high)
        if px4:
            assert high[-1].diff_pressure == pytest.approx(0.495, abs=0.002)
            assert sum(marked) == 11
        else:
            assert high[-1].diff_pressure < 0.0
            assert all(marked)


def test_the_hill_has_a_latitude() -> None:
    wire = Wire()
    wire.wants(33, 50.0)
    place = named(wire.runs(10), "GLOBAL_POSITION_INT")[-1]
    assert (place.lat * 1e-7 - 51.99) * 111_268 == pytest.approx(12.0, abs=0.02)
    assert (place.lon * 1e-7 - 4.375) * 68_680 == pytest.approx(-34.0, abs=0.05)
    assert (place.alt, place.relative_alt) == (25_000, 5_000)
    assert (place.vx, place.vy, place.vz) == (10, 20, 30)


# --- a pose from a companion ------------------------------------------------------------------


def vision(x: float = 1.0, roll: float = 0.0, z: float = -3.0) -> Any:
    return mavlink.MAVLink_vision_position_estimate_message(
        5_000_000, x, 2.0, z, roll, 0.0, radians(90.0), [0.0] * 21
    )


def odometry(frames: tuple[int, int] = (20, 12), w: float = 1.0) -> Any:
    return mavlink.MAVLink_odometry_message(
        *(5_000_000, *frames, 7.0, 8.0, -9.0, [w, 0.0, 0.0, 0.0], 0, 0, 0, 0, 0, 0),
        *([0.0] * 21, [0.0] * 21),
    )


def position_of(wire: Wire) -> tuple[float, float, float]:
    fix = named(wire.runs(10), "LOCAL_POSITION_NED")[-1]
    return fix.x, fix.y, fix.z


def test_a_pose_becomes_its_position_only_where_it_is_set_to_take_it() -> None:
    for viso_type, north_m in ((0.0, 12.0), (1.0, 1.0)):
        wire = Wire(parameters={"VISO_TYPE": viso_type})
        wire.wants(32, 50.0)
        wire.says(vision())
        assert position_of(wire)[0] == pytest.approx(north_m, abs=0.01)


def test_a_pose_from_beyond_the_air_is_taken_and_nothing_is_raised() -> None:
    wire = Wire(parameters={"VISO_TYPE": 1.0})
    wire.wants(105, 50.0)
    wire.says(vision(z=-5e4))
    assert named(wire.runs(40), "HIGHRES_IMU")[-1].abs_pressure == 0.0


def late(step: int, *, by: int = 20) -> Sensed:
    """What is measured `by` steps before it is there."""
    now = sensed(step)
    time_s = (step - 1 - by) / STEP_HZ
    return now._replace(
        position=now.position._replace(time_s=time_s),
        imu=now.imu._replace(time_s=time_s),
        pitot=now.pitot._replace(time_s=time_s),
        rangefinder=RangeSample(step, time_s, 3.0),
    )


STAMPED = {"LOCAL_POSITION_NED": 32, "GPS_RAW_INT": 24, "ODOMETRY": 331, "HIGHRES_IMU": 105,
           "SCALED_IMU": 26, "DISTANCE_SENSOR": 132}  # fmt: skip


def test_after_a_boot_nothing_is_reported_that_was_measured_before() -> None:
    wire = Wire(allow_odometry=True, parameters={"VISO_TYPE": 1.0})
    pixhawk = wire.pixhawk
    wire.says(vision())
    for step in range(1, 400):
        pixhawk.step(late(step))
    pixhawk.shut_down()
    pixhawk.step(late(400))
    pixhawk.boot()
    assert not pixhawk.external.is_in_use()
    pixhawk.take_datagrams()
    times_s: dict[str, list[float]] = {name: [] for name in STAMPED}
    for step in range(401, 451):
        for number in STAMPED.values():
            wire.says(mavlink.MAVLink_command_long_message(1, 1, 512, 0, number, *[0] * 6))
        pixhawk.step(late(step))
        for _, data in pixhawk.take_datagrams():
            for m in wire.reader.parse_buffer(data) or []:
                if m.get_type() in times_s:
                    stamp = m.to_dict()
                    times_s[m.get_type()].append(
                        stamp["time_boot_ms"]
                        if "time_boot_ms" in stamp
                        else stamp["time_usec"] / 1e3
                    )
    for name, stamps in times_s.items():
        assert 25 <= len(stamps) <= 31, name  # 20 steps must go by, and one to the next request
        assert all(0.0 <= stamp <= 150.0 for stamp in stamps), name
        assert stamps == sorted(stamps)


def test_the_position_stops_when_poses_stop() -> None:
    wire = Wire(parameters={"VISO_TYPE": 1.0})
    wire.wants(32, 50.0)
    wire.says(vision())
    assert len(named(wire.runs(400), "LOCAL_POSITION_NED")) <= 51
    assert named(wire.runs(50), "LOCAL_POSITION_NED") == []
    wire.says(vision(x=2.0))
    assert position_of(wire)[0] == pytest.approx(2.0, abs=0.01)


def test_what_the_firmware_drops_without_a_word_is_dropped() -> None:
    wire = Wire(parameters={"VISO_TYPE": 1.0})
    for wrong in (odometry((1, 8)), odometry((1, 12)), odometry(w=1.0001), vision(roll=nan)):
        wire.says(wrong)
    assert (wire.pixhawk.external.accepted, wire.pixhawk.external.dropped) == (0, 4)
    wire.wants(32, 50.0)
    wire.says(odometry())
    assert position_of(wire) == pytest.approx((7.0, 8.0, -9.0), abs=0.03)


WILD = st.one_of(st.floats(width=32), st.sampled_from([nan, inf, -inf, 3.4e38, -3.4e38]))


@settings(max_examples=60, deadline=None)
@given(st.lists(WILD, min_size=6, max_size=6), st.integers(0, 2**64 - 1))
def test_no_pose_can_stop_it(pose: list[float], stamp: int) -> None:
    wire = Wire(parameters={"VISO_TYPE": 1.0})
    for message_id in (32, 33, 74):
        wire.wants(message_id, 50.0)
    wire.says(mavlink.MAVLink_vision_position_estimate_message(stamp, *pose, [nan] * 21))
    assert len(named(wire.runs(8), "LOCAL_POSITION_NED")) == 2


def test_a_rangefinders_distances_reach_the_module_as_they_are() -> None:
    """Through pymavlink and our decoder; what does not come back is refused there."""
    wire = Wire(uptime_s=10.0)
    wire.wants(132, 20.0)
    reports: list[DistanceSensor] = []
    for k in range(200):
        now = sensed(wire.pixhawk.steps + 1)
        away_m = 12.345 if k < 100 else nan
        sample = RangeSample(1 + k // 10, now.attitude.time_s, away_m)
        wire.pixhawk.step(now._replace(rangefinder=sample))
        for _, data in wire.pixhawk.take_datagrams():
            received = Decoder(stream=False).feed(data)
            reports += [r.message for r in received if isinstance(r.message, DistanceSensor)]
    assert len(reports) == pytest.approx(20, abs=2)
    measured = [range_of(report) for report in reports]
    assert measured[0] == pytest.approx(12.345, abs=0.006)
    assert measured[-1] is None
    assert (reports[0].min_distance, reports[0].max_distance) == (20, 4000)


def test_without_a_rangefinder_no_distance_is_sent() -> None:
    wire = Wire()
    wire.wants(132, 20.0)
    assert named(wire.runs(100), "DISTANCE_SENSOR") == []


def test_the_receiver_reports_its_accuracy_and_no_dilution() -> None:
    wire = Wire()
    wire.wants(24, 1.0)
    reports = []
    for _ in range(400):
        wire.pixhawk.step(sensed(wire.pixhawk.steps + 1))
        for _, data in wire.pixhawk.take_datagrams():
            received = Decoder(stream=False).feed(data)
            reports += [r.message for r in received if isinstance(r.message, GpsRawInt)]
    assert reports
    assert (reports[-1].fix_type, reports[-1].h_acc, reports[-1].v_acc) == (3, 800, 1200)


def test_odometry_turns_velocities_into_the_body() -> None:
    """Against scipy's rotations, whatever the attitude."""
    draw = np.random.default_rng(5)
    for turned in Rotation.random(20, rng=5):
        x, y, z, w = turned.as_quat()
        attitude = NO_ATTITUDE._replace(qw=w, qx=x, qy=y, qz=z)
        velocity = draw.normal(size=3)
        found = _body_from_ned(attitude, *velocity)
        assert found == pytest.approx(turned.inv().apply(velocity), abs=1e-12)

"""Each message that the simulated autopilot reports of itself, field by field."""

from __future__ import annotations

from math import cos, isnan, nan, pi, radians, sin
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from samples import attitude_sample, imu_sample, position_fix

from tgl_soar.config.site import HomePosition
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL, FlightStatus
from tgl_soar.sim.vehicle.reports import VehicleReports
from tgl_soar.sim.vehicle.sensed import GROUNDED, Sensed
from tgl_soar.sim.vehicle.vehicle_clock import VehicleClock
from tgl_soar.types import NO_AIRSPEED, NO_IMU, NO_RANGE, AirspeedSample, RangeSample

STEP_HZ, UPTIME_S = 200, 100.0
HOME = HomePosition(latitude_deg=51.99, longitude_deg=4.375, altitude_m=20.0)
OUTPUTS = SimpleNamespace(servo_pwm=tuple(range(1001, 1019)), channel_pwm=tuple(range(1101, 1119)))
ROLL, PITCH, YAW = radians(10.0), radians(-5.0), radians(-90.0)
RATES = (0.1, -0.2, 0.3)
SEEN = Sensed(
    attitude=attitude_sample(5, 1.0, quaternion_from_euler(ROLL, PITCH, YAW), RATES),
    position=position_fix(3, 0.98, (12.0, -34.0, -5.0), (3.0, -4.0, 0.5)),
    airspeed_mps=8.5,
    flying=True,
    imu=imu_sample(6, 0.995, (0.5, -0.25, -9.5), (0.01, 0.02, 0.03)),
    pitot=AirspeedSample(2, 0.97, 9.0),
    rangefinder=RangeSample(4, 0.9, 3.21),
)
# Streams of samples, by what they carry.
CARRIED = {
    "attitude": ("ATTITUDE", "ATTITUDE_QUATERNION"),
    "position": ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY", "GPS_RAW_INT"),
    "imu": ("RAW_IMU", "SCALED_IMU", "HIGHRES_IMU"),
    "rangefinder": ("DISTANCE_SENSOR",),
}
UNASKED = ("SYS_STATUS", "SYSTEM_TIME", "VFR_HUD", "EKF_STATUS_REPORT", "SERVO_OUTPUT_RAW",
           "RC_CHANNELS")  # fmt: skip
BITS = {"gyro": 1, "accelerometer": 2, "differential pressure": 16}  # of MAV_SYS_STATUS_SENSOR


def reports(
    sensed: Sensed = SEEN,
    *,
    home: HomePosition | None = HOME,
    px4: bool = True,
    status: FlightStatus | None = None,
) -> VehicleReports:
    clock = VehicleClock(STEP_HZ, UPTIME_S)
    clock.steps = STEP_HZ  # one second
    made = VehicleReports(
        clock, status or FlightStatus(), OUTPUTS, home, allow_odometry=px4  # type: ignore[arg-type]
    )  # fmt: skip
    made.take(sensed)
    return made


def number(name: str) -> int:
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))


def built(name: str, sensed: Sensed = SEEN, **keys: Any) -> Any:
    message = reports(sensed, **keys).build(number(name))
    assert message is None or message.get_type() == name
    return message


def test_every_message_can_be_built_of_what_is_not_a_number() -> None:
    """As under the faults `attitude.nan` and `position.nan`."""
    lost = SEEN._replace(
        attitude=SEEN.attitude._replace(qw=nan, qx=nan, qy=nan, qz=nan),
        position=position_fix(3, 0.98, (nan, nan, nan), (nan, nan, nan)),
    )
    made = reports(lost)
    link = mavlink.MAVLink(None, 1, 1)
    for message_id in made.streamable:
        message = made.build(message_id)
        assert message is not None
        message.pack(link)
    assert built("VFR_HUD", lost).heading == 0
    assert built("GLOBAL_POSITION_INT", lost).hdg == 65_535


# --- which there are -----------------------------------------------------------------------------


def test_all_these_can_be_streamed_and_odometry_where_it_is_allowed() -> None:
    names = {*UNASKED, *(name for group in CARRIED.values() for name in group)}
    assert set(reports().streamable) == {number(name) for name in names}
    assert set(reports(px4=False).streamable) == {number(name) for name in names - {"ODOMETRY"}}
    assert built("ODOMETRY", px4=False) is None
    for name in ("HEARTBEAT", "AUTOPILOT_VERSION"):  # once, where it is asked for
        assert built(name).get_type() == name
    assert reports().build(number("PARAM_VALUE")) is None


@pytest.mark.parametrize(("part", "names"), CARRIED.items())
def test_a_message_is_of_its_sample_and_is_none_without(part: str, names: tuple[str, ...]) -> None:
    none: dict[str, Any] = {
        "attitude": GROUNDED.attitude,
        "position": GROUNDED.position,
        "imu": NO_IMU,
        "rangefinder": NO_RANGE,
    }
    for name in names:
        assert reports().sequence(number(name)) == getattr(SEEN, part).sequence
        assert built(name) is not None
        assert built(name, SEEN._replace(**{part: none[part]})) is None
        others = {other: value for other, value in none.items() if other != part}
        assert built(name, SEEN._replace(**others)) is not None


@pytest.mark.parametrize("name", UNASKED)
def test_the_others_are_new_at_every_step_from_the_first_on(name: str) -> None:
    made = reports(GROUNDED)
    assert made.sequence(number(name)) == STEP_HZ + 1
    assert made.build(number(name)) is not None


# --- what each says ------------------------------------------------------------------------------


@pytest.mark.parametrize(("armed", "mode"), [(True, MANUAL), (False, FBWA)])
def test_a_heartbeat_is_that_of_a_fixed_wing_under_ardupilot(armed: bool, mode: int) -> None:
    message = reports(status=FlightStatus(mode=mode, armed=armed)).heartbeat()
    assert message.type == mavlink.MAV_TYPE_FIXED_WING
    assert message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    custom_manual_stabilized = 1 | 64 | 16
    assert message.base_mode == custom_manual_stabilized + 128 * armed
    assert message.custom_mode == mode
    assert message.system_status == (4 if armed else 3)  # active, standby
    assert message.mavlink_version == 3


@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize("pitot", [True, False])
def test_its_status_has_the_sensors_that_have_reported(imu: bool, pitot: bool) -> None:
    sensed = SEEN if imu else SEEN._replace(imu=NO_IMU)
    sensed = sensed if pitot else sensed._replace(pitot=NO_AIRSPEED)
    message = built("SYS_STATUS", sensed)
    has = (BITS["gyro"] + BITS["accelerometer"]) * imu + BITS["differential pressure"] * pitot
    assert message.onboard_control_sensors_present == has
    assert message.onboard_control_sensors_enabled == has
    assert message.onboard_control_sensors_health == has
    assert message.voltage_battery == 11_400  # mV, of three cells
    assert (message.current_battery, message.battery_remaining) == (-1, -1)  # unknown
    assert 0 < message.load < 1000  # per mille
    assert (message.drop_rate_comm, message.errors_comm) == (0, 0)
    errors = [getattr(message, f"errors_count{i}") for i in (1, 2, 3, 4)]
    assert errors == [0, 0, 0, 0]


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        # Of EKF_STATUS_FLAGS: 1 attitude, 2 and 4 velocities, 8, 16 and 32 positions, 128 constant
        # position, 256 and 512 predicted ones.
        ("measured", (2, 8, 16, 256, 512)),
        ("reckoned", (2, 8, 256)),
        ("none", (128,)),
    ],
)
def test_the_estimator_says_how_it_is_aided(kind: str, more: tuple[int, ...]) -> None:
    position = {
        "measured": SEEN.position,
        "reckoned": SEEN.position._replace(reckoned=True),
        "none": GROUNDED.position,
    }[kind]
    message = built("EKF_STATUS_REPORT", SEEN._replace(position=position))
    assert message.flags == 1 + 4 + 32 + sum(more)
    variances = (
        message.velocity_variance,
        message.pos_horiz_variance,
        message.pos_vert_variance,
        message.compass_variance,
        message.terrain_alt_variance,
    )
    assert variances == (0.0,) * 5


def test_times_are_since_boot_and_of_the_samples() -> None:
    assert built("SYSTEM_TIME").time_boot_ms == 101_000
    assert built("SYSTEM_TIME").time_unix_usec == 0  # no receiver has reported it
    for name, ms in (("ATTITUDE", 101_000), ("ATTITUDE_QUATERNION", 101_000),
                     ("LOCAL_POSITION_NED", 100_980), ("GLOBAL_POSITION_INT", 100_980),
                     ("SCALED_IMU", 100_995), ("DISTANCE_SENSOR", 100_900),
                     ("RC_CHANNELS", 101_000)):  # fmt: skip
        assert built(name).time_boot_ms == ms, name
    for name, us in (("RAW_IMU", 100_995_000), ("HIGHRES_IMU", 100_995_000),
                     ("ODOMETRY", 100_980_000), ("GPS_RAW_INT", 100_980_000),
                     ("SERVO_OUTPUT_RAW", 101_000_000)):  # fmt: skip
        assert built(name).time_usec == us, name


def test_the_attitude_is_the_same_in_both_of_its_messages() -> None:
    angles, quaternion = built("ATTITUDE"), built("ATTITUDE_QUATERNION")
    assert (angles.roll, angles.pitch, angles.yaw) == pytest.approx((ROLL, PITCH, YAW))
    four = quaternion.q1, quaternion.q2, quaternion.q3, quaternion.q4
    assert four == pytest.approx(quaternion_from_euler(ROLL, PITCH, YAW))
    for message in (angles, quaternion):
        assert (message.rollspeed, message.pitchspeed, message.yawspeed) == RATES


def test_the_local_position_is_the_fix() -> None:
    message = built("LOCAL_POSITION_NED")
    assert (message.x, message.y, message.z) == (12.0, -34.0, -5.0)
    assert (message.vx, message.vy, message.vz) == (3.0, -4.0, 0.5)


def test_odometry_has_the_place_in_ned_and_the_velocity_in_the_body() -> None:
    level = SEEN._replace(attitude=attitude_sample(5, 1.0, quaternion_from_euler(0, 0, YAW), RATES))
    message = built("ODOMETRY", level)
    assert message.frame_id == mavlink.MAV_FRAME_LOCAL_NED
    assert message.child_frame_id == mavlink.MAV_FRAME_BODY_FRD
    assert (message.x, message.y, message.z) == (12.0, -34.0, -5.0)
    # Facing west: west is ahead, north is to the right.
    assert (message.vx, message.vy, message.vz) == pytest.approx((4.0, 3.0, 0.5))
    assert message.q == pytest.approx([cos(YAW / 2), 0.0, 0.0, sin(YAW / 2)])
    assert (message.rollspeed, message.pitchspeed, message.yawspeed) == RATES
    for covariance in (message.pose_covariance, message.velocity_covariance):
        assert len(covariance) == 21
        assert isnan(covariance[0])  # unknown
        assert covariance[1:] == [0.0] * 20


def test_odometry_takes_the_attitude_nearest_to_its_position() -> None:
    made = reports(GROUNDED)
    for k in range(10):
        yawed = attitude_sample(k + 1, 0.9 + 0.01 * k, quaternion_from_euler(0, 0, 0.1 * k))
        made.take(SEEN._replace(attitude=yawed))
        made.take(SEEN._replace(attitude=yawed))  # once each
    for time_s, nearest in ((0.9, 0), (0.934, 3), (0.936, 4), (0.5, 0), (2.0, 9)):
        made.take(made.sensed._replace(position=SEEN.position._replace(time_s=time_s)))
        half = 0.05 * nearest
        expected = pytest.approx([cos(half), 0.0, 0.0, sin(half)])
        assert made.build(number("ODOMETRY")).q == expected  # type: ignore[union-attr]
    made.forget()  # and then it has the latest alone
    at = SEEN.position._replace(time_s=0.9)
    made.take(SEEN._replace(attitude=yawed, position=at))
    q = made.build(number("ODOMETRY")).q  # type: ignore[union-attr]
    assert q == pytest.approx([cos(0.45), 0.0, 0.0, sin(0.45)])


def test_attitudes_are_kept_for_as_long_as_a_position_may_be_late() -> None:
    """At 200 Hz more than half a second, and not for ever."""
    made = reports(GROUNDED)
    for k in range(400):
        made.take(SEEN._replace(attitude=SEEN.attitude._replace(sequence=k + 1, time_s=k / 200)))
    assert 0.5 < 399 / 200 - made._attitudes[0].time_s < 1.0


def test_the_display_has_heading_height_and_speeds() -> None:
    message = built("VFR_HUD")
    assert message.groundspeed == pytest.approx(5.0)
    assert message.heading == 270
    assert message.alt == 25.0
    assert message.climb == -0.5
    assert message.throttle == 0
    assert message.airspeed == pytest.approx(9.0, abs=0.02)  # of the pitot, at sea level
    assert built("VFR_HUD", SEEN._replace(pitot=NO_AIRSPEED)).airspeed == 8.5  # an estimate
    assert built("VFR_HUD", home=None).alt == 5.0
    lost = SEEN.position._replace(
        velocity_north_mps=nan, velocity_east_mps=nan, velocity_down_mps=nan
    )
    unknown = built("VFR_HUD", SEEN._replace(position=lost))
    assert (unknown.groundspeed, abs(unknown.climb)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("yaw_rad", "shown"), [(0.0, 0), (pi / 2, 90), (-0.001, 0), (-0.02, 359), (3.14159, 180)]
)
def test_the_displays_heading_is_in_whole_degrees_below_360(yaw_rad: float, shown: int) -> None:
    turned = attitude_sample(1, 1.0, quaternion_from_euler(0.0, 0.0, yaw_rad))
    assert built("VFR_HUD", SEEN._replace(attitude=turned)).heading == shown


def test_pulses_are_those_of_the_servos_and_of_the_receiver() -> None:
    servos, channels = built("SERVO_OUTPUT_RAW"), built("RC_CHANNELS")
    assert servos.port == 0
    raw = [getattr(servos, f"servo{i}_raw") for i in range(1, 17)]
    assert raw == list(range(1001, 1017))
    assert channels.chancount == 18
    assert [getattr(channels, f"chan{i}_raw") for i in range(1, 19)] == list(range(1101, 1119))
    assert channels.rssi == 254  # full


def test_microseconds_of_servos_wrap_at_32_bits() -> None:
    made = reports()
    made._clock.uptime_s = 2.0**32 * 1e-6 - 0.5  # before a second has gone by
    assert made.build(number("SERVO_OUTPUT_RAW")).time_usec == 500_000  # type: ignore[union-attr]


def test_a_pitots_sample_is_new_in_one_message() -> None:
    made = reports()
    new = mavlink.HIGHRES_IMU_UPDATED_DIFF_PRESSURE

    def marked() -> bool:
        return bool(made.build(number("HIGHRES_IMU")).fields_updated & new)  # type: ignore[union-attr]

    assert [marked(), marked()] == [True, False]
    made.take(SEEN._replace(pitot=AirspeedSample(3, 1.0, 9.5)))
    assert [marked(), marked()] == [True, False]


def test_places_and_distances_are_those_of_their_sensors() -> None:
    place, receiver, laser = (
        built(name) for name in ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "DISTANCE_SENSOR")
    )
    assert (place.relative_alt, place.alt, place.hdg) == (5_000, 25_000, 27_000)
    assert (receiver.h_acc, receiver.v_acc) == (800, 1_200)
    assert laser.current_distance == 321
    assert built("GLOBAL_POSITION_INT", home=None).lat == 0


def test_the_version_is_that_of_a_release_that_takes_what_we_send() -> None:
    message = built("AUTOPILOT_VERSION")
    float_parameters, integer_commands, mavlink_2 = 2, 8, 8192  # MAV_PROTOCOL_CAPABILITY
    assert message.capabilities == float_parameters + integer_commands + mavlink_2
    official = 255
    assert message.flight_sw_version.to_bytes(4, "big") == bytes((4, 6, 3, official))
    rest = (message.middleware_sw_version, message.os_sw_version, message.board_version)
    assert rest == (0, 0, 0)
    assert (message.vendor_id, message.product_id, message.uid) == (0, 0, 0)
    for field in ("flight", "middleware", "os"):
        assert getattr(message, f"{field}_custom_version") == [0] * 8

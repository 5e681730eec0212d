"""The simulated Pixhawk's sensors as its firmware reports them: units, steps, stamps, limits.

As in ArduPlane, integers are cut off toward zero as C does; stamps of milliseconds count whole
ones.  The airspeed that it shows is the equivalent one, read ten times a second; the
"differential pressure" of its HIGHRES_IMU is the barometer's less that at the ground.  As in PX4
(`px4`), that field is the pitot tube's, and marked as new only when it is.
"""

from __future__ import annotations

from math import cos, degrees, isfinite, radians, sin, sqrt
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.site import HomePosition
from tgl_soar.sim.sensors import RangeParams
from tgl_soar.types import AirspeedSample, AttitudeSample, ImuSample, PositionFix, RangeSample

MILLI_G_MPS2: Final = 9.80665e-3
PITOT_READ_S: Final = 0.1
SEA_LEVEL_HPA: Final = 1013.25
TEMPERATURE_C: Final = 15.0
ZERO_CELSIUS_K: Final = 273.15
INERTIAL: Final = (
    mavlink.HIGHRES_IMU_UPDATED_XACC
    | mavlink.HIGHRES_IMU_UPDATED_YACC
    | mavlink.HIGHRES_IMU_UPDATED_ZACC
    | mavlink.HIGHRES_IMU_UPDATED_XGYRO
    | mavlink.HIGHRES_IMU_UPDATED_YGYRO
    | mavlink.HIGHRES_IMU_UPDATED_ZGYRO
)
BAROMETER: Final = (
    mavlink.HIGHRES_IMU_UPDATED_ABS_PRESSURE
    | mavlink.HIGHRES_IMU_UPDATED_PRESSURE_ALT
    | mavlink.HIGHRES_IMU_UPDATED_TEMPERATURE
)
_EQUATOR_M: Final = 6_378_137.0
_E2: Final = 6.694379990141e-3
_INT16: Final = 32767
HEADING_UNKNOWN: Final = 65535


def thousandths(values: tuple[float, ...], unit: float = 1.0) -> list[int]:
    """In thousandths of a unit, cut off toward zero and limited to 16 bits; NaN becomes 0."""
    return [int(max(-_INT16, min(_INT16, v / unit * 1e3))) if v == v else 0 for v in values]


def raw_imu(sample: ImuSample, time_us: int) -> Any:
    """RAW_IMU: milli-g, millirad/s, microseconds."""
    force = thousandths(sample.force_frd_mps2, 1e3 * MILLI_G_MPS2)
    return mavlink.MAVLink_raw_imu_message(
        time_us, *force, *thousandths(sample.rates_frd_radps), 0, 0, 0, 0, 2500
    )


def scaled_imu(sample: ImuSample, time_ms: int) -> Any:
    """SCALED_IMU: the same numbers, milliseconds."""
    force = thousandths(sample.force_frd_mps2, 1e3 * MILLI_G_MPS2)
    return mavlink.MAVLink_scaled_imu_message(
        time_ms, *force, *thousandths(sample.rates_frd_radps), 0, 0, 0, 2500
    )


def attitude_quaternion(sample: AttitudeSample, time_ms: int) -> Any:
    """ATTITUDE_QUATERNION: as it was sampled."""
    return mavlink.MAVLink_attitude_quaternion_message(
        time_ms, *sample.quaternion, *sample.rates_frd_radps
    )


def local_position_ned(fix: PositionFix, time_ms: int) -> Any:
    """LOCAL_POSITION_NED: as it was fixed."""
    return mavlink.MAVLink_local_position_ned_message(
        time_ms, *fix.place_ned_m, *fix.velocity_ned_mps
    )


def highres_imu(
    sample: ImuSample, time_us: int, height_m: float, pitot: AirspeedSample, *, px4: bool, new: bool
) -> Any:
    """HIGHRES_IMU at a height above mean sea level.  new: the pitot's sample is."""
    absolute_hpa = SEA_LEVEL_HPA * density_ratio(height_m) ** 1.235  # 5.2559 / 4.2559
    updated = INERTIAL | BAROMETER
    if px4:
        density = 100.0 * absolute_hpa / (287.05 * (TEMPERATURE_C + ZERO_CELSIUS_K))
        differential_hpa = 0.005 * density * pitot.airspeed_mps**2 if pitot.sequence else 0.0
        updated |= mavlink.HIGHRES_IMU_UPDATED_DIFF_PRESSURE if new else 0
    else:
        differential_hpa = absolute_hpa - SEA_LEVEL_HPA
        updated |= mavlink.HIGHRES_IMU_UPDATED_DIFF_PRESSURE
    return mavlink.MAVLink_highres_imu_message(
        time_usec=time_us,
        xacc=sample.force_x_frd_mps2,
        yacc=sample.force_y_frd_mps2,
        zacc=sample.force_z_frd_mps2,
        xgyro=sample.roll_rate_frd_radps,
        ygyro=sample.pitch_rate_frd_radps,
        zgyro=sample.yaw_rate_frd_radps,
        xmag=0.0,
        ymag=0.0,
        zmag=0.0,
        abs_pressure=absolute_hpa,
        diff_pressure=differential_hpa,
        pressure_alt=height_m,
        temperature=TEMPERATURE_C,
        fields_updated=updated,
    )


def distance_sensor(sample: RangeSample, params: RangeParams, time_ms: int) -> Any:
    """DISTANCE_SENSOR of a laser that looks down, in whole centimetres.

    What does not come back is shown beyond the largest distance, and of no quality.
    """
    largest_cm = round(100.0 * params.max_m)
    returned = isfinite(sample.range_m)
    return mavlink.MAVLink_distance_sensor_message(
        time_ms,
        round(100.0 * params.min_m),
        largest_cm,
        round(100.0 * min(sample.range_m, 655.0)) if returned else largest_cm + 100,
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        255,
        signal_quality=100 if returned else 1,
    )


def gps_raw_int(
    fix: PositionFix, home: HomePosition | None, time_us: int, accuracy_m: tuple[float, float]
) -> Any:
    """GPS_RAW_INT of a place near a home; no fix without one.

    accuracy_m: what the receiver reports, horizontally and in height; dilutions are not known.
    """
    if home is None or not _is_place(fix):
        return mavlink.MAVLink_gps_raw_int_message(
            time_usec=time_us,
            fix_type=mavlink.GPS_FIX_TYPE_NO_FIX,
            lat=0,
            lon=0,
            alt=0,
            eph=65535,
            epv=65535,
            vel=65535,
            cog=65535,
            satellites_visible=255,
        )
    latitude_deg, longitude_deg, height_m = geodetic(home, fix.north_m, fix.east_m, fix.down_m)
    horizontal, vertical = (round(1e3 * each) for each in accuracy_m)
    return mavlink.MAVLink_gps_raw_int_message(
        time_usec=time_us,
        fix_type=mavlink.GPS_FIX_TYPE_3D_FIX,
        lat=round(latitude_deg * 1e7),
        lon=round(longitude_deg * 1e7),
        alt=round(height_m * 1e3),
        eph=65535,
        epv=65535,
        vel=65535,
        cog=65535,
        satellites_visible=14,
        h_acc=horizontal,
        v_acc=vertical,
    )


def density_ratio(height_m: float) -> float:
    """Of the standard atmosphere, to sea level; 0 above 44 km, where its formula ends."""
    return float(max(1.0 - 2.25577e-5 * height_m, 0.0) ** 4.2559)


class ShownAirspeed:
    """The equivalent airspeed that VFR_HUD shows: of the pitot tube, read at its own pace."""

    def __init__(self) -> None:
        self._read_s = float("-inf")
        self.equivalent_mps = 0.0

    def step(self, time_s: float, pitot: AirspeedSample, height_m: float) -> None:
        """Read it, if it is time."""
        if pitot.sequence and time_s - self._read_s >= PITOT_READ_S - 1e-9:
            self._read_s = time_s
            self.equivalent_mps = pitot.airspeed_mps * sqrt(density_ratio(height_m))


def global_position(fix: PositionFix, home: HomePosition | None, time_ms: int, yaw: float) -> Any:
    """GLOBAL_POSITION_INT of a place near a home; latitude and longitude are zero without one.

    A fix without numbers is all zero; the heading of a yaw [rad] without a number is not known.
    """
    velocity = [
        round(max(-327.0, min(327.0, v)) * 100.0) if v == v else 0 for v in fix.velocity_ned_mps
    ]
    heading = round(degrees(yaw) % 360.0 * 100.0) % 36000 if isfinite(yaw) else HEADING_UNKNOWN
    if home is None or not _is_place(fix):
        above_mm = round(-1e3 * fix.down_m) if isfinite(fix.down_m) else 0
        return mavlink.MAVLink_global_position_int_message(
            time_ms, 0, 0, 0, above_mm, *velocity, heading
        )
    latitude_deg, longitude_deg, height_m = geodetic(home, fix.north_m, fix.east_m, fix.down_m)
    return mavlink.MAVLink_global_position_int_message(
        time_ms,
        round(latitude_deg * 1e7),
        round(longitude_deg * 1e7),
        round(height_m * 1e3),
        round(-fix.down_m * 1e3),
        *velocity,
        heading,
    )


def _is_place(fix: PositionFix) -> bool:
    return isfinite(fix.north_m) and isfinite(fix.east_m) and isfinite(fix.down_m)


def geodetic(
    home: HomePosition, north_m: float, east_m: float, down_m: float
) -> tuple[float, float, float]:
    """Latitude, longitude [deg] and height [m] of a place near a home, by radii of curvature."""
    latitude = radians(home.latitude_deg)
    bulge = 1.0 - _E2 * sin(latitude) ** 2
    normal_m = _EQUATOR_M / sqrt(bulge)
    meridian_m = normal_m * (1.0 - _E2) / bulge
    height_m = home.altitude_m - down_m
    north_rad = north_m / (meridian_m + height_m)
    east_rad = east_m / ((normal_m + height_m) * cos(latitude))
    return home.latitude_deg + degrees(north_rad), home.longitude_deg + degrees(east_rad), height_m

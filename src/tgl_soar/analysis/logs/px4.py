"""PX4's ULog as a flight."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import (
    RATES,
    Event,
    FlightData,
    LoggedMode,
    Series,
    changes_of,
    euler,
    series,
    with_missing,
)
from tgl_soar.analysis.logs.ulog import Topics
from tgl_soar.analysis.logs.ulog_reader import FlightLog

Floats = NDArray[np.float64]

# vehicle_status.nav_state, as PX4 numbers it.
_MODES: Final = {
    0: "Manual",
    1: "Altitude",
    2: "Position",
    3: "Mission",
    4: "Hold",
    5: "Return",
    10: "Acro",
    12: "Descend",
    13: "Termination",
    14: "Offboard",
    15: "Stabilized",
    17: "Takeoff",
    18: "Land",
}


_IMU: Final = {
    "force_x_frd_mps2": "accelerometer_m_s2[0]",
    "force_y_frd_mps2": "accelerometer_m_s2[1]",
    "force_z_frd_mps2": "accelerometer_m_s2[2]",
    "roll_rate_frd_radps": "gyro_rad[0]",
    "pitch_rate_frd_radps": "gyro_rad[1]",
    "yaw_rate_frd_radps": "gyro_rad[2]",
}
_XYZ: Final = ("xyz[0]", "xyz[1]", "xyz[2]")
_METADATA: Final = {
    "sys_name": "system",
    "ver_hw": "hardware",
    "ver_sw": "software version",
    "ver_sw_branch": "branch",
}


def read_px4(log: FlightLog) -> FlightData:
    """A flight that PX4 logged."""
    topics = Topics(log)
    speed = {"airspeed_mps": "true_airspeed_m_s"}
    place = "vehicle_local_position"
    torque = dict(zip(("aileron", "elevator", "rudder"), _XYZ, strict=True))
    controls = {"aileron": "control[0]", "elevator": "control[1]", "rudder": "control[2]"}
    flight = FlightData(
        name=log.path.name,
        kind="PX4 ULog",
        position=topics.take(place, {"north_m": "x", "east_m": "y", "down_m": "z"}),
        velocity=topics.take(place, {"north_mps": "vx", "east_mps": "vy", "down_mps": "vz"}),
        attitude=_attitude(topics),
        airspeed=topics.take("airspeed_validated", speed) or topics.take("airspeed", speed),
        rates=topics.take("vehicle_angular_velocity", dict(zip(RATES, _XYZ, strict=True))),
        imu=topics.take("sensor_combined", _IMU),
        surfaces=topics.take("vehicle_torque_setpoint", torque)
        or topics.take("actuator_controls_0", controls),
        outputs=topics.take("actuator_outputs", {str(i + 1): f"output[{i}]" for i in range(16)}),
        setpoints=_setpoints(topics),
        autopilot_modes=_modes(topics),
        events=tuple(sorted([*topics.events(), *_failsafes(topics)])),
        parameters=topics.parameters(),
        metadata={word: str(log.info[key]) for key, word in _METADATA.items() if key in log.info},
        streams=topics.time_s,
        lost=topics.lost,
    )
    wanted = ("position", "attitude", "airspeed", "surfaces", "setpoints", "tracking", "line")
    return with_missing(flight, (*wanted, "air"))


def _attitude(topics: Topics) -> Series | None:
    name = "vehicle_attitude"
    if not topics.has(name, "q[0]"):
        return None
    roll, pitch, yaw = euler(*(topics.column(name, f"q[{i}]") for i in range(4)))
    good = np.isfinite(roll)
    angles = {"roll_rad": roll[good], "pitch_rad": pitch[good], "yaw_rad": yaw[good]}
    return series(topics.time_s[name][good], name, **angles)


def _setpoints(topics: Topics) -> Series | None:
    name = "vehicle_attitude_setpoint"
    if topics.has(name, "pitch_body"):
        roll, pitch = topics.column(name, "roll_body"), topics.column(name, "pitch_body")
    elif topics.has(name, "q_d[0]"):  # since version 1.16 as a quaternion alone
        roll, pitch, _ = euler(*(topics.column(name, f"q_d[{i}]") for i in range(4)))
    else:
        return None
    unknown = np.full(len(roll), np.nan)
    return series(topics.time_s[name], name, pitch_rad=pitch, roll_rad=roll, heading_rad=unknown)


def _modes(topics: Topics) -> tuple[LoggedMode, ...]:
    if not topics.has("vehicle_status", "nav_state"):
        return ()
    numbers = topics.column("vehicle_status", "nav_state").astype(int).tolist()
    names = [_MODES.get(number, f"mode {number}") for number in numbers]
    return changes_of(topics.time_s["vehicle_status"], names)


def _failsafes(topics: Topics) -> list[Event]:
    if not topics.has("vehicle_status", "failsafe"):
        return []
    failsafe = topics.column("vehicle_status", "failsafe")
    begins = topics.time_s["vehicle_status"][np.diff(failsafe, prepend=0.0) > 0.0]
    return [Event(t, "message", "failsafe") for t in begins.tolist()]

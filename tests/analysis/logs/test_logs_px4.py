"""PX4's log as a flight, from topics that are made up: which topic, which column, which mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tgl_soar.analysis.logs.flight_data import Event, FlightData, LoggedMode
from tgl_soar.analysis.logs.px4 import read_px4
from tgl_soar.analysis.logs.ulog_reader import FlightLog, Words

N = 12
TIME_S = 0.1 * np.arange(N)
STAMPS = np.round((30.0 + TIME_S) * 1e6).astype(np.uint64)
X, Y, Z, W = Rotation.from_euler("ZYX", [1.0, 0.2, -0.3]).as_quat().tolist()


def about(time_s: float) -> Any:
    """Stamps are whole microseconds."""
    return pytest.approx(time_s)


def rows(**columns: Any) -> dict[str, Any]:
    return {"timestamp": STAMPS, **{name: v + 0.0 * TIME_S for name, v in columns.items()}}


def numbered(name: str, count: int, first: float = 0.0) -> dict[str, float]:
    return {f"{name}[{i}]": first + i for i in range(count)}


def quaternion(name: str) -> dict[str, float]:
    return {f"{name}[{i}]": value for i, value in enumerate((W, X, Y, Z))}


def read(topics: dict[str, Any], **given: Any) -> FlightData:
    log = FlightLog(path=Path("px4.ulg"), topics=topics, **{"parameters": {}, **given})
    return read_px4(log)


def first(series: Any, *names: str) -> list[float]:
    assert series is not None
    return [float(series[name][0]) for name in names]


def test_place_speed_and_rates_are_read_by_their_topics() -> None:
    flight = read(
        {
            "vehicle_local_position": rows(x=1, y=2, z=3, vx=4, vy=5, vz=6),
            "vehicle_angular_velocity": rows(**numbered("xyz", 3, 7.0)),
            "sensor_combined": rows(
                **numbered("accelerometer_m_s2", 3, 11.0), **numbered("gyro_rad", 3, 21.0)
            ),
        }
    )
    rates = [f"{axis}_rate_frd_radps" for axis in ("roll", "pitch", "yaw")]
    assert first(flight.position, "north_m", "east_m", "down_m") == [1, 2, 3]
    assert first(flight.velocity, "north_mps", "east_mps", "down_mps") == [4, 5, 6]
    assert first(flight.rates, *rates) == [7, 8, 9]
    assert first(flight.imu, *(f"force_{axis}_frd_mps2" for axis in "xyz")) == [11, 12, 13]
    assert first(flight.imu, *rates) == [21, 22, 23]
    assert (flight.name, flight.kind) == ("px4.ulg", "PX4 ULog")
    assert set(flight.streams) == {
        "vehicle_local_position",
        "vehicle_angular_velocity",
        "sensor_combined",
    }


def test_newer_topics_stand_before_older_ones() -> None:
    speed = {"true_airspeed_m_s": 8.0}
    older = {
        "airspeed": rows(true_airspeed_m_s=9.0),
        "actuator_controls_0": rows(**numbered("control", 3, 1.0)),
    }
    newer = {
        "airspeed_validated": rows(**speed),
        "vehicle_torque_setpoint": rows(**numbered("xyz", 3, 4.0)),
    }
    names = ("aileron", "elevator", "rudder")
    flight = read({**older, **newer})
    assert first(flight.airspeed, "airspeed_mps") == [8.0]
    assert first(flight.surfaces, *names) == [4, 5, 6]
    flight = read(older)
    assert first(flight.airspeed, "airspeed_mps") == [9.0]
    assert first(flight.surfaces, *names) == [1, 2, 3]


def test_sixteen_outputs_are_numbered_from_one() -> None:
    flight = read({"actuator_outputs": rows(**numbered("output", 16, 1000.0))})
    assert flight.outputs is not None
    assert list(flight.outputs.columns) == [str(n) for n in range(1, 17)]
    assert first(flight.outputs, "1", "16") == [1000, 1015]


def test_attitudes_are_angles_and_what_is_no_rotation_is_left_out() -> None:
    topic = rows(**quaternion("q"))
    for i in range(4):
        topic[f"q[{i}]"][3] = 0.0
    flight = read({"vehicle_attitude": topic})
    assert flight.attitude is not None
    assert len(flight.attitude) == N - 1
    assert flight.attitude.time_s == pytest.approx(np.delete(TIME_S, 3))
    angles = first(flight.attitude, "roll_rad", "pitch_rad", "yaw_rad")
    assert angles == pytest.approx([-0.3, 0.2, 1.0])


def test_setpoints_are_angles_or_since_version_1_16_a_quaternion() -> None:
    angles = {"roll_body": 0.1, "pitch_body": 0.4}
    older = read({"vehicle_attitude_setpoint": rows(**angles, **quaternion("q_d"))}).setpoints
    assert first(older, "roll_rad", "pitch_rad") == [0.1, 0.4]
    newer = read({"vehicle_attitude_setpoint": rows(**quaternion("q_d"))}).setpoints
    assert first(newer, "roll_rad", "pitch_rad") == pytest.approx([-0.3, 0.2])
    assert older is not None
    assert np.isnan(older["heading_rad"]).all()
    assert read({"vehicle_attitude_setpoint": rows(other=1.0)}).setpoints is None


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (0, "Manual"),
        (1, "Altitude"),
        (2, "Position"),
        (3, "Mission"),
        (4, "Hold"),
        (5, "Return"),
        (10, "Acro"),
        (12, "Descend"),
        (13, "Termination"),
        (14, "Offboard"),
        (15, "Stabilized"),
        (17, "Takeoff"),
        (18, "Land"),
        (99, "mode 99"),
    ],
)
def test_modes_are_named_as_px4_numbers_them(number: int, name: str) -> None:
    states = np.where(np.arange(N) < 6, 77, number)
    flight = read({"vehicle_status": rows(nav_state=states)})
    assert flight.autopilot_modes == (
        LoggedMode(0.0, "mode 77"),
        LoggedMode(about(0.6), name),
    )


def test_each_beginning_of_a_failsafe_is_an_event_among_the_others() -> None:
    failsafe = np.zeros(N, dtype=bool)
    failsafe[[2, 3, 8]] = True
    flight = read(
        {"vehicle_status": {"timestamp": STAMPS, "failsafe": failsafe}},
        words=[Words(30.5, 6, " hello ")],
        parameters={"GAIN": 2.0},
    )
    assert flight.events == (
        Event(about(0.2), "message", "failsafe"),
        Event(about(0.5), "message", "hello"),
        Event(about(0.8), "message", "failsafe"),
    )
    assert flight.parameters == {"GAIN": 2.0}
    at_once = read({"vehicle_status": {"timestamp": STAMPS, "failsafe": ~failsafe}})
    assert [event.time_s for event in at_once.events] == pytest.approx([0.0, 0.4, 0.9])


def test_what_the_log_lacks_is_none_and_named() -> None:
    flight = read(
        {"vehicle_status": rows(other=1.0)},
        info={"sys_name": "PX4", "ver_hw": "V5", "ver_sw": "abc", "ver_sw_branch": "main", "x": 1},
    )
    assert flight.autopilot_modes == ()
    assert flight.events == ()
    assert flight.series() == {}
    assert flight.metadata == {
        "system": "PX4",
        "hardware": "V5",
        "software version": "abc",
        "branch": "main",
    }
    words = " ".join(flight.missing)
    for name in ("position", "attitude", "airspeed", "surface", "setpoints", "e_rho", "line"):
        assert name in words
    assert len(flight.missing) == 8

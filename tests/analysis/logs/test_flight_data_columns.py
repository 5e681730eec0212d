"""The columns of each series of a flight, as reports and replays ask for them by name."""

from __future__ import annotations

import pytest

from tgl_soar.analysis.logs.flight_data import COLUMNS, RATES

ROLL, PITCH, YAW = (f"{axis}_rate_frd_radps" for axis in ("roll", "pitch", "yaw"))
EXPECTED = {
    "position": "north_m east_m down_m",
    "velocity": "north_mps east_mps down_mps",
    "attitude": "roll_rad pitch_rad yaw_rad",
    "rates": f"{ROLL} {PITCH} {YAW}",
    "airspeed": "airspeed_mps",
    "imu": f"force_x_frd_mps2 force_y_frd_mps2 force_z_frd_mps2 {ROLL} {PITCH} {YAW}",
    "path": "x_m y_m z_m",
    "motion": "velocity_x_mps velocity_y_mps climb_mps",
    "heading": "heading_rad",
    "surfaces": "elevator aileron rudder",
    "brake": "brake",
    "setpoints": "pitch_rad roll_rad heading_rad",
    "tracking": "e_rho_m",
    "line": "x_m z_m eta_rad moving",
    "air": "wind_mps updraft_mps",
    "ages": "position_age_s attitude_age_s heartbeat_age_s",
    "margins": "clearance_m stall_rad",
    "forecast": "standing chance ahead_s z_m",
    "throttle": "fraction climb_mps",
    "point": "standing off_m brake",
    "excitation": "standing injected_rad setpoint_rad pitch_rad elevator elevator_p elevator_i",
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_series_has_these_columns_in_this_order(name: str) -> None:
    assert COLUMNS[name] == tuple(EXPECTED[name].split())


def test_no_other_series_has_columns() -> None:
    assert set(COLUMNS) == set(EXPECTED)
    assert (ROLL, PITCH, YAW) == RATES

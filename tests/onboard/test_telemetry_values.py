"""What the module reports of itself: every number under its own name, in its own unit."""

from __future__ import annotations

from math import degrees, isnan, radians

import pytest
from test_module import Flight

from tgl_soar.geometry import SoaringFrame
from tgl_soar.onboard.telemetry_values import ARRAY, float_array, wind_cov
from tgl_soar.types import NO_AIR


def test_the_array_holds_each_number_under_its_name() -> None:
    output = Flight().engaged().onboard.output
    assert output is not None
    # All of them differ, so that none can stand in another's place.
    line = output.line._replace(e_rho_m=0.11, e_rho_rate_mps=0.12, x_m=1.3, z_m=2.4, eta_rad=1.9)
    vehicle = output.vehicle._replace(
        x_m=5.1,
        y_m=5.2,
        z_m=5.3,
        velocity_x_mps=0.61,
        velocity_y_mps=0.62,
        climb_mps=0.63,
        roll_rad=0.71,
        pitch_rad=0.72,
        heading_rad=0.73,
    )
    throttle = output.throttle._replace(climb_mps=0.35)
    output = output._replace(line=line, vehicle=vehicle, throttle=throttle)
    reported = dict(zip(ARRAY, float_array(output, 1.0).data, strict=True))
    assert reported["mode"] == output.mode
    assert (reported["e_rho"], reported["e_rho_rate"]) == (0.11, 0.12)
    assert (reported["line_x"], reported["line_z"]) == (1.3, 2.4)
    assert reported["line_lean"] == degrees(1.9) - 90.0
    assert (reported["x"], reported["y"], reported["z"]) == (5.1, 5.2, 5.3)
    assert (reported["speed_x"], reported["speed_y"], reported["climb"]) == (0.61, 0.62, 0.63)
    attitude = tuple(map(degrees, (0.71, 0.72, 0.73)))
    assert (reported["roll"], reported["pitch"], reported["heading"]) == attitude
    setpoints, command, health = output.setpoints, output.command, output.health
    assert reported["pitch_sp"] == degrees(setpoints.pitch_rad)
    assert reported["heading_sp"] == degrees(setpoints.heading_rad) or isnan(setpoints.heading_rad)
    assert (reported["elevator"], reported["aileron"], reported["rudder"]) == tuple(command)[:3]
    assert reported["ele_p"] == output.elevator.p
    assert reported["rud_d"] == output.rudder.d
    assert reported["pushed"] == 0.35
    ages = health.position_age_s, health.attitude_age_s, health.heartbeat_age_s
    assert (reported["age_pos"], reported["age_att"], reported["age_ap"]) == ages
    assert reported["imu_weight"] == output.imu_weight
    assert reported["faults"] == health.faults


def test_the_wind_is_reported_with_what_of_it_is_estimated_across() -> None:
    west = SoaringFrame(0.0, 0.0, 0.0, radians(270.0))
    air = NO_AIR._replace(wind_mps=7.0, cross_wind_mps=2.0, updraft_mps=1.0)
    message = wind_cov(air, west, 1.0)  # to the right, facing west, is north
    assert (message.wind_x, message.wind_y, message.wind_z) == pytest.approx((2.0, 7.0, -1.0))

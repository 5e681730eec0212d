"""What the module tells of itself: every number under its own name, in its own unit."""

from __future__ import annotations

from math import degrees, isnan

from test_onboard import Flight

from tgl_soar.onboard.instruments import ARRAY, float_array


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
    output = output._replace(line=line, vehicle=vehicle)
    told = dict(zip(ARRAY, float_array(output, 1.0).data, strict=True))
    assert told["mode"] == output.mode
    assert (told["e_rho"], told["e_rho_rate"]) == (0.11, 0.12)
    assert (told["line_x"], told["line_z"]) == (1.3, 2.4)
    assert told["line_lean"] == degrees(1.9) - 90.0
    assert (told["x"], told["y"], told["z"]) == (5.1, 5.2, 5.3)
    assert (told["speed_x"], told["speed_y"], told["climb"]) == (0.61, 0.62, 0.63)
    attitude = tuple(map(degrees, (0.71, 0.72, 0.73)))
    assert (told["roll"], told["pitch"], told["heading"]) == attitude
    setpoints, command, health = output.setpoints, output.command, output.health
    assert told["pitch_sp"] == degrees(setpoints.pitch_rad)
    assert told["heading_sp"] == degrees(setpoints.heading_rad) or isnan(setpoints.heading_rad)
    assert (told["elevator"], told["aileron"], told["rudder"]) == tuple(command)[:3]
    assert told["ele_p"] == output.elevator.p
    assert told["rud_d"] == output.rudder.d
    ages = health.position_age_s, health.attitude_age_s, health.heartbeat_age_s
    assert (told["age_pos"], told["age_att"], told["age_ap"]) == ages
    assert told["imu_weight"] == output.imu_weight
    assert told["faults"] == health.faults

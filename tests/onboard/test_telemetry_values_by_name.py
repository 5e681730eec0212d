"""Every number that a station is shown, held to its name: an output in which no two numbers are
alike, and the place in it that each name stands for."""

from __future__ import annotations

from functools import reduce
from itertools import count
from math import cos, degrees, inf, isnan, nan, sin
from typing import Any

import pytest

from tgl_soar.autopilot import Output
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.messages import (
    ID_COMPONENT_METADATA,
    ID_DEBUG_FLOAT_ARRAY,
    ID_NAMED_VALUE_FLOAT,
    ID_NAV_CONTROLLER_OUTPUT,
    ID_WIND_COV,
    ComponentMetadata,
)
from tgl_soar.onboard.flightlog.topics import rebuilt
from tgl_soar.onboard.telemetry_values import (
    ARRAY,
    ARRAY_ID,
    FAST,
    SLOW,
    Panel,
    fast_value,
    float_array,
    health_bits,
    named_value,
    nav_controller_output,
    slow_value,
    wind_cov,
)

OUTPUT: Output = rebuilt(Output, (0.25 + 0.5 * n for n in count(1)))
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.3)
HEALTHY = 7.0  # position, attitude and autopilot

IN_DEGREES = {
    "pitch_sp": "setpoints.pitch_rad",
    "heading_sp": "setpoints.heading_rad",
    "roll": "vehicle.roll_rad",
    "pitch": "vehicle.pitch_rad",
    "heading": "vehicle.heading_rad",
    "rho_p": "soaring.p",
    "rho_i": "soaring.i",
    "rho_d": "soaring.d",
    "stall": "margins.stall_rad",
    "alpha": "air.alpha_rad",
    "exc_pitch": "excitation.pitch_rad",
}
AS_IT_IS = {
    "e_rho": "line.e_rho_m",
    "e_rho_rate": "line.e_rho_rate_mps",
    "soar_x": "vehicle.x_m",
    "soar_z": "vehicle.z_m",
    "soar_mode": "mode",
    "mode": "mode",
    "line_x": "line.x_m",
    "line_z": "line.z_m",
    "line_moving": "line.moving",
    "x": "vehicle.x_m",
    "y": "vehicle.y_m",
    "z": "vehicle.z_m",
    "speed_x": "vehicle.velocity_x_mps",
    "speed_y": "vehicle.velocity_y_mps",
    "climb": "vehicle.climb_mps",
    "rho_saturated": "soaring.saturated",
    "elevator": "command.elevator",
    "ele_p": "elevator.p",
    "ele_i": "elevator.i",
    "ele_d": "elevator.d",
    "ele_saturated": "elevator.saturated",
    "aileron": "command.aileron",
    "ail_p": "aileron.p",
    "ail_i": "aileron.i",
    "ail_d": "aileron.d",
    "ail_saturated": "aileron.saturated",
    "rudder": "command.rudder",
    "rud_p": "rudder.p",
    "rud_d": "rudder.d",
    "pushed": "throttle.climb_mps",
    "age_pos": "health.position_age_s",
    "age_att": "health.attitude_age_s",
    "age_ap": "health.heartbeat_age_s",
    "faults": "health.faults",
    "airspeed": "air.airspeed_mps",
    "wind": "air.wind_mps",
    "updraft": "air.updraft_mps",
    "excess": "air.excess_mps",
    "wind_sd": "air.wind_sigma_mps",
    "updraft_sd": "air.updraft_sigma_mps",
    "imu_weight": "imu_weight",
    "gain_speed": "gains.airspeed_mps",
    "rho_gain_p": "gains.rho_p",
    "rho_gain_i": "gains.rho_i",
    "rho_gain_d": "gains.rho_d",
    "ele_gain_p": "gains.ele_p",
    "ele_gain_i": "gains.ele_i",
    "ele_gain_d": "gains.ele_d",
    "exc_state": "excitation.standing",
    "clearance": "margins.clearance_m",
    "fc_state": "forecast.standing",
    "fc_chance": "forecast.chance",
    "fc_time": "forecast.ahead_s",
    "fc_z": "forecast.z_m",
    "pt_state": "point.standing",
    "pt_off": "point.off_m",
    "brake": "command.brake",
    "esc_left": "launch_landing.height_left_m",
    "esc_time": "launch_landing.time_left_s",
    "throttle": "throttle.fraction",
    "thr_used": "throttle.used_s",
}
# Not of the output.
LOSS, ROUND_TRIP_S, LACKS = 0.125, 0.03, 37
GIVEN = {"loss": LOSS, "rtt_ms": 30.0, "entry": float(LACKS), "health": HEALTHY}


def there(path: str) -> Any:
    return reduce(getattr, path.split("."), OUTPUT)


def wanted(name: str) -> float:
    if name in GIVEN:
        return GIVEN[name]
    if name == "line_lean":
        return degrees(OUTPUT.line.eta_rad) - 90.0
    return degrees(there(IN_DEGREES[name])) if name in IN_DEGREES else float(there(AS_IT_IS[name]))


@pytest.mark.parametrize("turn", range(len(FAST)))
def test_each_fast_number(turn: int) -> None:
    assert fast_value(OUTPUT, turn) == pytest.approx(wanted(FAST[turn]))


@pytest.mark.parametrize("turn", range(26))
def test_each_slow_number(turn: int) -> None:
    found = slow_value(OUTPUT, LOSS, ROUND_TRIP_S, LACKS, turn)
    assert found == pytest.approx(wanted(SLOW[turn]))


def test_each_number_of_the_array() -> None:
    message = float_array(OUTPUT, 2.5)
    found = dict(zip(ARRAY, message.data, strict=True))
    assert found == pytest.approx({name: wanted(name) for name in ARRAY})
    assert (message.time_usec, message.array_id) == (2_500_000, ARRAY_ID)
    assert len(ARRAY) <= 58  # what a DEBUG_FLOAT_ARRAY holds
    assert len(SLOW) == 26


def test_health_is_three_bits() -> None:
    nothing = OUTPUT.health._replace(position_ok=False, attitude_ok=False, autopilot_ok=False)
    for name, bit in (("position_ok", 1.0), ("attitude_ok", 2.0), ("autopilot_ok", 4.0)):
        health = nothing._replace(**{name: True})
        assert health_bits(OUTPUT._replace(health=health)) == bit


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("stall", "margins.stall_rad"),
        ("clearance", "margins.clearance_m"),
        ("fc_time", "forecast.ahead_s"),
        ("esc_time", "launch_landing.time_left_s"),
    ],
)
def test_what_is_infinite_is_not_known_to_a_station(name: str, path: str) -> None:
    field, number = path.split(".")
    inner = getattr(OUTPUT, field)._replace(**{number: inf})
    output = OUTPUT._replace(**{field: inner})
    assert isnan(slow_value(output, LOSS, ROUND_TRIP_S, LACKS, SLOW.index(name)))


def test_stamps_are_the_vehicle_s_milliseconds_and_begin_again_at_zero() -> None:
    assert named_value("x", 12.3456, 1.0).time_boot_ms == 12_345
    assert named_value("x", 2.0**32 * 1e-3 + 0.25, 1.0).time_boot_ms == 250
    for unknown in (nan, -1.0, 1e10):
        assert named_value("x", unknown, 1.0).time_boot_ms == 0


def test_the_instruments_of_a_station() -> None:
    found = nav_controller_output(OUTPUT)
    setpoints = OUTPUT.setpoints
    assert found.nav_roll == pytest.approx(degrees(setpoints.roll_rad))
    assert found.nav_pitch == pytest.approx(degrees(setpoints.pitch_rad))
    assert found.nav_bearing == found.target_bearing == round(degrees(setpoints.heading_rad))
    assert found.alt_error == OUTPUT.line.z_m - OUTPUT.vehicle.z_m
    assert found.xtrack_error == OUTPUT.line.e_rho_m
    assert (found.wp_dist, found.aspd_error) == (0, 0.0)
    none = OUTPUT._replace(setpoints=setpoints._replace(heading_rad=nan))
    assert nav_controller_output(none).nav_bearing == 0


def test_the_wind_blows_towards_where_the_site_says() -> None:
    """From 0.3 rad east of north: towards the south and west."""
    air = OUTPUT.air._replace(cross_wind_mps=0.0)
    found = wind_cov(air, FRAME, 3.0)
    assert found.wind_x == pytest.approx(-air.wind_mps * cos(0.3))
    assert found.wind_y == pytest.approx(-air.wind_mps * sin(0.3))
    assert found.wind_z == pytest.approx(-air.updraft_mps)
    assert (found.horiz_accuracy, found.vert_accuracy) == (
        air.wind_sigma_mps,
        air.updraft_sigma_mps,
    )
    assert found.time_usec == 3_000_000


def test_what_goes_out_and_how_often() -> None:
    panel = Panel(FRAME, lambda: LACKS)
    flows = panel.flows()
    assert [(flow.message_id, flow.interval_s) for flow in flows] == [
        (ID_NAMED_VALUE_FLOAT, 0.2),
        (ID_NAMED_VALUE_FLOAT, 1.0),
        (ID_DEBUG_FLOAT_ARRAY, 0.5),
        (ID_NAV_CONTROLLER_OUTPUT, inf),
        (ID_WIND_COV, inf),
        (ID_COMPONENT_METADATA, inf),
    ]
    makers = [flow.build for flow in flows]
    assert [make(0) for make in makers[:5]] == [None] * 5  # before the first tick
    panel.look(OUTPUT, 2.5, LOSS, ROUND_TRIP_S)
    messages: list[Any] = [make(0) for make in makers]
    assert (messages[0].name, messages[0].value) == ("e_rho", OUTPUT.line.e_rho_m)
    assert (messages[1].name, messages[1].value) == ("climb", OUTPUT.vehicle.climb_mps)
    assert messages[2:5] == [
        float_array(OUTPUT, 2.5),
        nav_controller_output(OUTPUT),
        wind_cov(OUTPUT.air, FRAME, 2.5),
    ]
    assert isinstance(messages[5], ComponentMetadata)
    assert messages[5].time_boot_ms == 2500
    entry: Any = makers[1](SLOW.index("entry"))
    assert entry.value == LACKS

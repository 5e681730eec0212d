"""The wind's direction, as it is estimated in flight, and what the flight makes of it."""

from __future__ import annotations

from functools import cache
from math import atan2, cos, degrees, inf, nan, radians, sin
from statistics import fmean
from typing import NamedTuple

import pytest

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.wind_record import RecordedField, WindRecord
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.control.supervisor import SOARING
from tgl_soar.estimation.cross_wind import (
    VEER_RADPS,
    CrossWindParams,
    across_air,
    cross_wind_step,
    veer,
    veer_step,
)
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import NO_AIR, AirEstimate, VehicleState

PARAMS = CrossWindParams(radians(50.0), 6.0)
OFF = PARAMS._replace(veer_max_rad=0.0)
SPEED_MPS, ALPHA_RAD, PITCH_RAD = 9.0, 0.06, 0.02
DT_S = 0.005


def vehicle(heading_rad: float, velocity_y_mps: float, roll_rad: float = 0.0) -> VehicleState:
    return VehicleState(
        time_s=0.0,
        x_m=0.0,
        y_m=0.0,
        z_m=0.0,
        velocity_x_mps=0.0,
        velocity_y_mps=velocity_y_mps,
        climb_mps=0.0,
        roll_rad=roll_rad,
        pitch_rad=PITCH_RAD,
        heading_rad=heading_rad,
        roll_rate_radps=0.0,
        pitch_rate_radps=0.0,
        heading_rate_radps=0.0,
    )


AIR = NO_AIR._replace(airspeed_mps=SPEED_MPS, alpha_rad=ALPHA_RAD, wind_mps=8.0)
FLAT_MPS = SPEED_MPS * cos(ALPHA_RAD - PITCH_RAD)  # of the velocity through the air


def estimated(params: CrossWindParams, at: VehicleState, air: AirEstimate, seconds: float) -> float:
    cross = 0.0
    for _ in range(round(seconds / DT_S)):
        cross = cross_wind_step(params, cross, at, air, DT_S)
    return cross


def test_at_rest_the_wind_comes_from_where_the_nose_points() -> None:
    cross = estimated(PARAMS, vehicle(radians(30.0), 0.0), AIR, 60.0)
    assert cross == pytest.approx(-FLAT_MPS * sin(radians(30.0)), rel=1e-3)
    along = FLAT_MPS * cos(radians(30.0))
    assert degrees(veer(PARAMS, cross, along)) == pytest.approx(30.0, abs=0.1)


def test_what_drifts_to_the_right_is_blown_there() -> None:
    cross = estimated(PARAMS, vehicle(0.0, 2.0), AIR, 60.0)
    assert cross == pytest.approx(2.0, rel=1e-3)
    assert veer(PARAMS, cross, 8.0) == pytest.approx(-atan2(2.0, 8.0), rel=1e-3)  # from the left


def test_the_estimate_follows_in_its_time_constant() -> None:
    cross = estimated(PARAMS, vehicle(0.0, 1.0), AIR, PARAMS.time_s)
    assert cross == pytest.approx(1.0 - 0.3679, abs=2e-3)


def test_a_bank_is_no_wind() -> None:
    """Banked to the right, what flows along the body's z axis comes from the right below."""
    banked = estimated(PARAMS, vehicle(0.0, 0.0, radians(10.0)), AIR, 60.0)
    assert banked == pytest.approx(SPEED_MPS * sin(ALPHA_RAD) * sin(radians(10.0)), rel=1e-3)


def test_switched_off_there_is_none() -> None:
    assert estimated(OFF, vehicle(0.5, 3.0), AIR, 10.0) == 0.0
    assert veer(OFF, 5.0, 8.0) == 0.0


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_what_is_no_number_changes_nothing(bad: float) -> None:
    for at, air in (
        (vehicle(bad, 0.0), AIR),
        (vehicle(0.0, bad), AIR),
        (vehicle(0.0, 0.0), AIR._replace(airspeed_mps=bad)),
        (vehicle(0.0, 0.0), NO_AIR),
    ):
        assert cross_wind_step(PARAMS, 1.5, at, air, DT_S) == 1.5
    assert veer(PARAMS, 1.0, nan) == 0.0


def test_what_is_flown_goes_there_at_its_rate_and_no_further() -> None:
    assert veer_step(0.3, -0.2, 0.1) == pytest.approx(0.25)
    assert veer_step(0.3, 0.9, 0.1) == pytest.approx(0.35)
    assert veer_step(0.3, 0.32, 0.1) == pytest.approx(0.32)


def test_it_is_within_its_limit_and_never_turns_the_nose_downwind() -> None:
    assert veer(PARAMS, -30.0, 1.0) == PARAMS.veer_max_rad
    assert veer(PARAMS, 30.0, 1.0) == -PARAMS.veer_max_rad
    assert veer(PARAMS, 5.0, -1.0) == 0.0


def test_the_air_at_the_aircraft_is_met_with_the_drift_taken_out() -> None:
    at = vehicle(0.3, 2.0)
    assert across_air(at, 0.0) is at
    assert across_air(at, 0.5) == at._replace(velocity_y_mps=1.5)


# --- in flight --------------------------------------------------------------------------------

VEER_DEG, RATE_DEGPS, BEGIN_S, END_S = 40.0, 2.0, 12.0, 70.0


class Flown(NamedTuple):
    """The last twenty seconds of a flight."""

    modes: set[int]
    y_m: list[float]
    z_m: list[float]
    e_rho_m: list[float]
    veer_rad: list[float]
    true_veer_rad: list[float]  # of the air at the aircraft


def turning(veer_max_deg: float) -> ClosedLoop:
    """Before the hill, in a wind that turns by 40 degrees at 2 degrees a second."""
    airframe_file, site_file = shipped("airframes/eclipson_c.toml"), shipped("sites/hill.toml")
    airframe, site = load_airframe(airframe_file), load_site(site_file)
    assert site.air is not None
    values = load_parameters(airframe, airframe_file, site, site_file)
    values = values.changed({**line_parameters(site.lines["b"]), "VEER_MAX": veer_max_deg})
    times = [0.0, BEGIN_S, BEGIN_S + VEER_DEG / RATE_DEGPS]
    record = WindRecord(Schedule([0.0], [7.0]), Schedule(times, [0.0, 0.0, radians(VEER_DEG)]))
    field = RecordedField(build_field(site.air), record)
    world = make_world(airframe, site, seed=4, turbulence=0.01, field=field)
    return ClosedLoop(world, values)


@cache
def flown(veer_max_deg: float) -> Flown:
    """In that wind."""
    loop = turning(veer_max_deg)
    world, field = loop.world, loop.world.field
    found = Flown(modes=set(), y_m=[], z_m=[], e_rho_m=[], veer_rad=[], true_veer_rad=[])
    for _ in range(round(END_S / DT_S)):
        output = loop.tick()
        if loop.state.time_s < END_S - 20.0:
            continue
        truth = world.truth
        u, v, _ = field.wind_at(truth.x_m, truth.y_m, truth.z_m, loop.state.time_s)
        found.modes.add(output.mode)
        found.y_m.append(truth.y_m)
        found.z_m.append(truth.z_m)
        found.e_rho_m.append(output.line.e_rho_m)
        found.veer_rad.append(atan2(-output.air.cross_wind_mps, output.air.wind_mps))
        found.true_veer_rad.append(atan2(-v, u))
    return found


def test_the_nose_follows_the_wind_and_the_aircraft_stays_in_the_middle() -> None:
    found = flown(50.0)
    assert found.modes == {SOARING}
    assert fmean(y * y for y in found.y_m) ** 0.5 <= 0.5
    assert fmean(e * e for e in found.e_rho_m) ** 0.5 <= 0.02
    error = fmean(found.veer_rad) - fmean(found.true_veer_rad)
    assert abs(degrees(error)) <= 3.0


def test_without_it_the_aircraft_slips_through_the_air_and_sits_lower() -> None:
    """The same wind, the same gusts: sideslip costs drag, and drag costs height."""
    slipping, facing = flown(0.0), flown(50.0)
    assert slipping.modes == {SOARING}
    assert fmean(facing.z_m) >= fmean(slipping.z_m) + 0.3


def test_set_to_nothing_in_flight_nothing_of_the_estimate_is_left() -> None:
    loop = turning(50.0)
    for _ in range(100):
        output = loop.tick()
    assert output.active
    memory = loop.state.memory
    loop.state = loop.state._replace(memory=memory._replace(cross_wind_mps=3.0))
    loop.change({"VEER_MAX": 0.0})
    loop.tick()
    assert loop.state.memory.cross_wind_mps == 0.0


@pytest.mark.parametrize("lowered_deg", [0.0, 5.0])
def test_lowered_in_flight_the_heading_setpoint_does_not_step(lowered_deg: float) -> None:
    loop = turning(50.0)
    for _ in range(100):
        loop.tick()
    memory = loop.state.memory
    memory = memory._replace(cross_wind_mps=-4.0, veer_rad=radians(30.0))
    loop.state = loop.state._replace(memory=memory)
    before_rad = loop.tick().setpoints.heading_rad
    assert degrees(before_rad) == pytest.approx(30.0, abs=3.0)
    loop.change({"VEER_MAX": lowered_deg})
    for _ in range(round(1.5 / DT_S)):
        output = loop.tick()
        assert output.active
        assert abs(output.setpoints.heading_rad - before_rad) <= 1.2 * VEER_RADPS * DT_S
        before_rad = output.setpoints.heading_rad
    assert degrees(before_rad) <= lowered_deg + 3.0

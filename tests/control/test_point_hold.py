"""The brake along the line: its law, its feed-forward, and how it says what it cannot do."""

from __future__ import annotations

from math import cos, nan, radians, sin
from typing import Any

import pytest
from samples import STILL

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.point_hold import (
    ABOVE_BAND,
    BELOW_BAND,
    DEAD,
    FADE_PER_S,
    HOLDS,
    LINE_ONLY,
    NO_BRAKE,
    NO_POINT,
    OUTSIDE_S,
    RESTS,
    UNEVEN,
    Around,
    BrakeGains,
    BrakeState,
    brake_effect,
    brake_step,
    set_aside,
)
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.aerodynamics import brake_sink, braked
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim import aircraft
from tgl_soar.sim.aircraft import AircraftModel
from tgl_soar.sim.world import flown_aircraft
from tgl_soar.types import THEIRS, VehicleState, polar_sink

WITH, WITHOUT = (shipped(f"airframes/eclipson_c{end}.toml") for end in ("_spoilers", ""))
SITE = shipped("sites/tunnel.toml")
ETA = radians(105.0)
TARGET = TargetLine(0.0, 1.0, ETA)
DT = 0.005
SPEED_MPS = 9.0


def laws(path: object = WITH, loops: int = 0, **changed: float) -> Laws:
    airframe, site = load_airframe(str(path)), load_site(SITE)
    values = load_parameters(airframe, str(path), site, SITE).changed({"TGL_HOLD": 1.0, **changed})
    return laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), airframe.aerodynamics(), loops=loops)


def gains(**changed: Any) -> BrakeGains:
    return laws().brake._replace(**changed)


def at(along_m: float, speed_mps: float = 0.0) -> VehicleState:
    """On the line, so far up along it, sliding up at a speed."""
    nothing = STILL
    return nothing._replace(
        x_m=TARGET.x_m + along_m * cos(ETA),
        z_m=TARGET.z_m + along_m * sin(ETA),
        velocity_x_mps=speed_mps * cos(ETA),
        climb_mps=speed_mps * sin(ETA),
    )


def steps(
    of: BrakeGains,
    vehicle: VehicleState,
    seconds: float,
    state: BrakeState = NO_POINT,
    *,
    on_the_line: bool = True,
    answers: bool = True,
) -> BrakeState:
    aero = laws().wind.aerodynamics
    for _ in range(round(seconds / DT)):
        now = around(state)._replace(on_the_line=on_the_line, answers=answers)
        state = brake_step(of, aero, state, TARGET, ETA, vehicle, SPEED_MPS, now, DT)
    return state


def around(state: BrakeState) -> Around:
    """Nothing hinders, and the brake goes where it is wanted."""
    return Around(
        on_the_line=True,
        answers=True,
        blocked=0,
        room=1.0,
        brake=state.brake,
        aileron=0.0,
        inertial=False,
        up_free=True,
        down_free=True,
    )


def test_it_fades_in_to_its_bias_where_nothing_disturbs_and_out_again() -> None:
    state = steps(gains(), at(0.0), 1.0)
    assert state.standing == RESTS
    assert state.brake == pytest.approx(0.5 * FADE_PER_S, abs=1e-9)
    state = steps(gains(), at(0.0), 2.0, state)
    assert state.standing == HOLDS
    assert state.brake == pytest.approx(0.5, abs=1e-9)
    state = steps(gains(wanted=False), at(0.0), 1.0, state)
    assert state.standing == LINE_ONLY
    assert state.brake == pytest.approx(0.25, abs=0.01)
    assert steps(gains(wanted=False), at(0.0), 1.1, state).brake == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_too_high_or_rising_asks_for_more_brake(sign: float) -> None:
    begun = steps(gains(), at(0.0), 3.0)
    off = steps(gains(), at(sign * 0.02), DT, begun)
    rises = steps(gains(), at(0.0, sign * 0.05), DT, begun)
    assert sign * (off.brake - 0.5) > 0.0
    assert sign * (rises.brake - 0.5) > 0.0
    assert off.off_m == pytest.approx(sign * 0.02)


def test_the_sink_it_adds_is_the_laws_whatever_the_speed() -> None:
    of, aero = gains(ki_per_s=0.0), laws().wind.aerodynamics
    added = []
    for speed in (8.0, 11.0):
        state = NO_POINT._replace(weight=1.0, standing=HOLDS, x_m=0.0, z_m=1.0)
        state = brake_step(of, aero, state, TARGET, ETA, at(0.0, 0.05), speed, around(state), DT)
        added.append((state.brake - of.bias) * of.sink * speed**3)
    assert added[0] == pytest.approx(added[1], rel=0.1)  # but for the polar's slope
    assert added[0] == pytest.approx(of.kv * 0.05, rel=0.1)


def test_the_point_starts_at_the_aircraft_and_moves_at_limited_speed() -> None:
    of = gains(along_m=0.5)
    state = steps(of, at(0.0), DT)
    assert state.off_m == pytest.approx(0.0, abs=of.speed_max_mps * DT + 1e-9)
    state = steps(of, at(0.0), 1.0, state)
    assert state.off_m == pytest.approx(-of.speed_max_mps, abs=0.01)
    state = steps(of, at(0.0), 5.0, state)
    assert (state.x_m, state.z_m) == pytest.approx(at(0.5)[1:4:2])


@pytest.mark.parametrize(("along", "standing"), [(0.3, BELOW_BAND), (-0.3, ABOVE_BAND)])
def test_at_the_end_of_its_travel_for_long_the_point_is_outside_the_band(
    along: float, standing: int
) -> None:
    state = steps(gains(), at(0.0), 3.0)
    state = steps(gains(), at(along), 1.5 * OUTSIDE_S, state)  # 1 - exp(-1.5) = 0.78
    assert state.standing == HOLDS
    wound = state.pid.integral
    state = steps(gains(), at(along), 0.3 * OUTSIDE_S, state)
    assert state.standing == standing
    assert state.pid.integral == wound  # it stopped
    assert steps(gains(), at(-along), OUTSIDE_S, state).standing == HOLDS


def test_a_brake_that_does_not_answer_ends_it_until_the_operator_asks_again() -> None:
    state = steps(gains(), at(0.0), 3.0)
    state = steps(gains(), at(0.0), 0.1, state, answers=False)
    assert state.standing == DEAD
    state = steps(gains(), at(0.0), 3.0, state)
    assert (state.standing, state.brake) == (DEAD, 0.0)
    state = steps(gains(wanted=False), at(0.0), DT, state)
    assert steps(gains(), at(0.0), 3.0, state).standing == HOLDS


@pytest.mark.parametrize("standing", [DEAD, UNEVEN])
def test_a_brake_that_was_given_up_is_not_tried_by_the_next_flight_either(standing: int) -> None:
    flown = steps(gains(), at(0.0), 3.0)._replace(standing=standing)
    again = steps(gains(), at(0.0), 3.0, set_aside(gains(), flown))
    assert (again.standing, again.brake) == (standing, 0.0)
    well = set_aside(gains(), steps(gains(), at(0.0), 3.0))
    assert well == NO_POINT
    assert set_aside(gains(wanted=False), flown) == NO_POINT  # it was mended on the ground


def test_without_a_brake_or_a_route_for_it_the_line_alone_is_flown_and_that_is_reported() -> None:
    for of in (laws(WITHOUT).brake, laws(loops=THEIRS).brake):
        state = steps(of, at(0.1), 3.0)
        assert (state.standing, state.brake) == (NO_BRAKE, 0.0)
        assert brake_effect(of, 1.0, SPEED_MPS) == (0.0, 0.0)


def test_off_the_line_or_without_a_place_it_fades_out_and_begins_at_the_aircraft_again() -> None:
    state = steps(gains(), at(0.0), 3.0)
    for lost in (
        steps(gains(), at(0.0), 0.1, state, on_the_line=False),
        steps(gains(), at(nan), 0.1, state),
        steps(gains(), at(0.0, nan), 0.1, state),
    ):
        assert lost.brake == pytest.approx(0.475)
        assert lost.standing == RESTS
        back = steps(gains(), at(0.2), DT, lost)
        assert back.off_m == pytest.approx(0.0, abs=0.01)


def plane() -> AircraftModel:
    model = flown_aircraft(load_airframe(WITH))
    assert isinstance(model, AircraftModel)
    return model


@pytest.mark.parametrize("speed", [9.5, 11.0])
@pytest.mark.parametrize("brake", [0.3, 1.0])
def test_its_feed_forward_is_what_the_models_glides_need(speed: float, brake: float) -> None:
    clean, dirty = (
        plane().glide_at(speed),
        aircraft.glide_at(aircraft.braked(plane(), brake), speed),
    )
    effect = brake_effect(gains(), brake, speed)
    turned, trimmed = dirty.pitch_rad - clean.pitch_rad, dirty.elevator - clean.elevator
    # Two parts that nearly cancel; of second order is that a steeper glide at the same horizontal
    # speed is a faster one, which takes a third of either.
    part = brake * gains().lift_rad
    assert effect.pitch_rad == pytest.approx(turned, abs=part / 3.0)
    assert effect.elevator == pytest.approx(trimmed, abs=part / 3.0)


@pytest.mark.parametrize("speed", [9.0, 11.0])
def test_the_polar_of_a_braked_airframe_is_that_of_its_glides(speed: float) -> None:
    aero = laws().wind.aerodynamics
    most = brake_sink(aero) * speed**3
    assert most == pytest.approx(0.34 * (speed / 9.0) ** 3, rel=0.06)
    for brake in (0.5, 1.0):
        clean, dirty = (
            plane().glide_at(speed),
            aircraft.glide_at(aircraft.braked(plane(), brake), speed),
        )
        added = polar_sink(braked(aero, brake).polar, speed) - polar_sink(aero.polar, speed)
        assert added == pytest.approx(brake * most)
        assert added == pytest.approx(dirty.sink_mps - clean.sink_mps, rel=0.15)
    assert braked(aero, 0.0) is aero

"""The forecast in the loop: when it disengages, when it does not, and what is reported."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace

from tgl_soar.air.field import WindField
from tgl_soar.air.gusts import ScaledField
from tgl_soar.autopilot import initial_state, step
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.site import Start
from tgl_soar.control import forecast as f
from tgl_soar.control.conditions import forecast_conditions, search_conditions
from tgl_soar.control.envelope import clearance
from tgl_soar.control.laws import laws_from
from tgl_soar.control.supervisor import (
    CAPTURING,
    REASON_NOWHERE,
    RELEASED,
    SETTLES,
    SOARING,
)
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.reports import ForecastWords, mode_words
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.flight import inputs_at
from tgl_soar.sim.world import build_field, make_world

AIRFRAME_PATH = shipped("airframes/eclipson_c.toml")
ENGAGED_S = 0.2  # the simulated aircraft is held until then


@cache
def field_of(site: str) -> WindField:
    air = load_site(shipped(f"sites/{site}.toml")).air
    assert air is not None
    return build_field(air)


def flown(
    site_name: str,
    x_m: float,
    z_m: float,
    duration_s: float,
    *,
    wind: float = 1.0,
    turbulence: float = 0.01,
    seed: int = 1,
    **parameters: float,
) -> tuple[Trajectory, float, float]:
    """A flight from rest on a line through the start, the clearance where it ended, CLEAR_MIN."""
    airframe, path = load_airframe(AIRFRAME_PATH), shipped(f"sites/{site_name}.toml")
    site = load_site(path)
    values = load_parameters(airframe, AIRFRAME_PATH, site, path)
    values = values.changed({"TGL_X": x_m, "TGL_Z": z_m, "TGL_LEAN": 20.0, **parameters})
    world = make_world(
        airframe,
        replace(site, start=Start(x_m=x_m, z_m=z_m)),
        seed=seed,
        turbulence=turbulence,
        field=ScaledField(field_of(site_name), wind),
    )
    flight = fly(world, values, (), duration_s)
    left_m = clearance(site.known_ground(), flight["x_m"][-1], flight["z_m"][-1])
    return flight, left_m, values["CLEAR_MIN"]


NOWHERE = "disengaged: no place to settle on this line"


@pytest.mark.parametrize(
    ("site", "x_m", "z_m", "wind", "duration_s"),
    [
        ("tunnel", -0.3, 1.2, 1.0, 4.0),  # upstream of the foot of the board
        ("tunnel", 0.8, 1.6, 0.75, 4.0),  # too little wind
        ("hill", -13.5, 6.0, 1.0, 10.0),  # far upstream of the hill
    ],
)
def test_a_line_without_a_crossing_ends_in_the_pilots_hands_with_height_to_land(
    site: str, x_m: float, z_m: float, wind: float, duration_s: float
) -> None:
    """Far upstream of the hill it falls behind its line as fast, which is not what is asked for."""
    flight, left_m, least_m = flown(
        site, x_m, z_m, duration_s, wind=wind, FC_ACT=f.DISENGAGE_EARLY, CAPTURE_MAX=10.0
    )
    assert flight.ended == NOWHERE
    assert left_m > least_m


@pytest.mark.parametrize(
    ("act", "mode", "ahead_s", "chance", "disengages"),
    [
        (f.DISENGAGE, CAPTURING, 3.0, 0.02, True),
        (f.DISENGAGE, SOARING, 3.0, 0.02, False),  # it may come back
        (f.DISENGAGE, SOARING, 0.9, 0.02, True),
        (f.DISENGAGE, SOARING, 0.9, 0.3, False),  # it may well settle
        (f.DISENGAGE_EARLY, SOARING, 3.0, 0.02, True),
        (f.REPORT, CAPTURING, 0.5, 0.02, False),
    ],
)
def test_when_it_disengages(
    act: int, mode: int, ahead_s: float, chance: float, disengages: bool
) -> None:
    airframe, path = load_airframe(AIRFRAME_PATH), shipped("sites/tunnel.toml")
    values = load_parameters(airframe, AIRFRAME_PATH, load_site(path), path)
    laws = laws_from(values.changed({"FC_ACT": float(act)}), SoaringFrame(0.0, 0.0, 0.0, 0.0))
    nowhere = f.NO_FORECAST._replace(standing=f.TOO_LOW, ahead_s=ahead_s, chance=chance)
    settles = forecast_conditions(laws, mode, nowhere) == SETTLES
    assert settles is not disengages


@pytest.mark.parametrize("mode", [CAPTURING, SOARING])
@pytest.mark.parametrize("ahead_s", [0.9, 3.0])
def test_where_no_search_can_begin_4_acts_as_2(mode: int, ahead_s: float) -> None:
    airframe, path = load_airframe(AIRFRAME_PATH), shipped("sites/tunnel.toml")
    values = load_parameters(airframe, AIRFRAME_PATH, load_site(path), path)
    nowhere = f.NO_FORECAST._replace(standing=f.TOO_LOW, ahead_s=ahead_s, chance=0.02)

    def found(**changes: float) -> tuple[int, int]:
        laws = laws_from(values.changed(changes), SoaringFrame(0.0, 0.0, 0.0, 0.0))
        return forecast_conditions(laws, mode, nowhere), search_conditions(laws, False)

    as_2 = found(FC_ACT=2.0)
    assert found(FC_ACT=4.0, SRCH_START=4.0) == as_2
    if mode == CAPTURING and ahead_s > 1.0:
        assert as_2[0] == 0
        assert found(FC_ACT=4.0)[0] == SETTLES  # a search is to begin


@pytest.mark.parametrize("start_m", [-0.6, 0.6])
def test_a_line_with_a_crossing_is_flown_on(start_m: float) -> None:
    """Line b of the tunnel from above and below the crossing, at 3 %."""
    flight, _, _ = flown("tunnel", 0.60, 1.68 + start_m, 5.0, turbulence=0.03)
    assert flight.ended == ""
    assert flight["mode"][-1] == SOARING
    assert set(flight["forecast"]) == {f.UNKNOWN, f.SETTLES}
    known = flight["forecast"] == f.SETTLES
    assert flight["time_s"][known][0] == pytest.approx(ENGAGED_S + f.WINDOW_S, abs=0.15)


def test_it_may_be_reported_alone_or_not_made_at_all() -> None:
    upstream = ("tunnel", -0.3, 1.2, 3.6)
    reported, _, _ = flown(*upstream, FC_ACT=f.REPORT)
    assert f.TOO_LOW in reported["forecast"]
    assert reported.ended != NOWHERE
    silent, _, _ = flown(*upstream, FC_ACT=f.OFF)
    assert set(silent["forecast"]) == {f.UNKNOWN}
    assert np.array_equal(silent["z_m"][:200], reported["z_m"][:200])


def test_every_leg_on_a_line_is_foreseen_by_itself() -> None:
    """Out of control nothing is foreseen, and nothing of before is kept."""
    airframe, path = load_airframe(AIRFRAME_PATH), shipped("sites/tunnel.toml")
    site = load_site(path)
    values = load_parameters(airframe, AIRFRAME_PATH, site, path)
    world = make_world(airframe, site, seed=1, turbulence=0.0, field=field_of("tunnel"))
    laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
    state = initial_state()
    for k in range(300):
        state, output = step(laws, state, inputs_at(k / 200, world.now.samples, True))
        world.held = not output.active
        world.step(output.command)
    assert output.forecast.standing == f.SETTLES
    state, output = step(laws, state, inputs_at(1.5, world.now.samples, False))
    assert not output.active
    state, output = step(laws, state, inputs_at(1.505, world.now.samples, False))
    assert np.isnan(state.forecast.begun_s)
    assert output.forecast.standing == f.UNKNOWN


# --- words ------------------------------------------------------------------------------------


def output_with(standing: int, *, mode: int = SOARING, reason: int = 0):  # type: ignore[no-untyped-def]
    airframe, path = load_airframe(AIRFRAME_PATH), shipped("sites/tunnel.toml")
    site = load_site(path)
    values = load_parameters(airframe, AIRFRAME_PATH, site, path)
    world = make_world(airframe, site, seed=1, turbulence=0.0, field=field_of("tunnel"))
    laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
    _, output = step(laws, initial_state(), inputs_at(0.0, world.now.samples, False))
    forecast = f.NO_FORECAST._replace(standing=standing, ahead_s=1.2)
    return output._replace(
        mode=mode, reason=reason, active=mode == SOARING, forecast=forecast,
        health=output.health._replace(faults=0),
    )  # fmt: skip


def test_a_forecast_that_ends_nothing_is_reported_once_and_so_is_its_end() -> None:
    words = ForecastWords()
    nowhere = (SEVERITY_WARNING, "no place to settle: sinks below CLEAR_MIN in 1.2 s")
    assert words.look(output_with(f.SETTLES)) == []
    assert words.look(output_with(f.TOO_LOW)) == [nowhere]
    assert words.look(output_with(f.TOO_LOW)) == []
    assert words.look(output_with(f.SETTLES)) == [
        (SEVERITY_INFO, "a place to settle is foreseen again")
    ]
    assert words.look(output_with(f.SETTLES)) == []


def test_where_it_disengages_the_reason_is_followed_by_what_is_foreseen() -> None:
    ended = output_with(f.TOO_LOW, mode=RELEASED, reason=REASON_NOWHERE)
    assert mode_words(ended) == [
        (SEVERITY_ERROR, "released: no place to settle on this line"),
        (SEVERITY_WARNING, "sinks below CLEAR_MIN in 1.2 s"),
    ]
    assert ForecastWords().look(ended) == []  # not a second time

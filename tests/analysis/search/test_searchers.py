"""Baselines by hand, and one search flown: from upstream of the board's foot."""

from __future__ import annotations

from math import isfinite, radians

import pytest

from tgl_soar.analysis.experiments.lift.search import MAP
from tgl_soar.analysis.search.episode import fly_episode
from tgl_soar.analysis.search.places import place
from tgl_soar.analysis.search.scoring import Score, score
from tgl_soar.analysis.search.searchers import (
    SEARCHERS,
    Baseline,
    ExtremumSeeking,
    StartLine,
    Upright,
    Walk,
    searcher,
)
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.control.search.rollout import Guards, Moving
from tgl_soar.control.target_line import LineLimits, LineState, eta_from_lean
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.lift_map import Reading
from tgl_soar.types import NO_GROUND

ETA = eta_from_lean(radians(15.0))
BOX = Box(x_min_m=-20.0, x_max_m=0.0, z_min_m=0.0, z_max_m=20.0)
GUARDS = Guards(
    box=BOX,
    ground=NO_GROUND,
    clearance_m=1.0,
    landing_m=1.5,
    speed_min_mps=7.3,
    speed_max_mps=13.0,
    line=LineLimits(0.5, 0.5, radians(5.0)),
)


def sighting(time_s: float, climb_mps: float = 0.0, energy_mps: float = 0.0) -> Sighting:
    line = LineState(x_m=-5.0, z_m=10.0, eta_rad=ETA, speed_mps=0.0, moving=False)
    reading = Reading(
        x_m=-5.0,
        z_m=10.0,
        wind_mps=9.0,
        updraft_mps=1.4,
        airspeed_mps=9.0,
        energy_mps=energy_mps,
        since_s=0.2,
    )
    return Sighting(
        time_s=time_s,
        dt_s=0.2,
        reading=reading,
        moving=Moving(-5.0, 10.0, climb_mps, line),
        climb_mps=climb_mps,
        over_ground_m=10.0,
        guards=GUARDS,
        pitot=True,
        carried=False,
    )


def seconds(baseline: Baseline, count: float, climb_mps: float = 0.0) -> None:
    for k in range(round(count / 0.2)):
        baseline.look(sighting(0.2 * k, climb_mps))


def test_the_line_through_the_start_stays_and_claims() -> None:
    line = StartLine(sighting(0.0))
    seconds(line, 5.0)
    assert not line.look(sighting(5.0)).soaring
    seconds(line, 3.0)
    decision = line.look(sighting(8.0))
    assert decision.soaring
    assert decision.target == line.begin
    seconds(line, 9.0, -1.0)
    assert not line.look(sighting(20.0, -1.0)).soaring


def test_a_baseline_gives_up_at_the_height_for_landing() -> None:
    line = StartLine(sighting(0.0))
    low = sighting(1.0, -1.5)._replace(over_ground_m=2.0)
    assert "height" in line.look(low).given_up
    assert line.look(low._replace(over_ground_m=2.2)).given_up == ""


def test_extremum_seeking_goes_up_the_slope_of_what_it_meets() -> None:
    seeking = ExtremumSeeking(sighting(0.0))
    for k in range(400):
        aside = seeking.target.x_m - seeking.begin.x_m
        decision = seeking.look(sighting(0.2 * k, 0.3, energy_mps=-0.5 * (aside + 4.0)))
    assert decision.target.x_m < seeking.begin.x_m - 0.5  # less of it downstream


def test_the_walk_takes_steps_of_its_constants_and_keeps_what_is_good() -> None:
    walk = Walk(sighting(0.0), "hill", 3)
    places = set()
    for k in range(200):
        walk.look(sighting(0.2 * k, 0.8))
        places.add(walk.at)
        step = ((walk.at[0] - walk.best[0]) ** 2 + (walk.at[1] - walk.best[1]) ** 2) ** 0.5
        assert step <= 1.0 + 1e-9
    assert len(places) > 5
    still = Walk(sighting(0.0), "hill", 3)
    seconds(still, 30.0)
    assert still.stays >= 10
    assert still.target == still.begin


def test_saos_holds_x_and_drops_z() -> None:
    upright = Upright(sighting(0.0))
    assert upright.look(sighting(0.2)).target.eta_rad == pytest.approx(eta_from_lean(0.0))


def test_each_searcher_has_a_name() -> None:
    polar = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
    there = place("hill", 3)
    for name in SEARCHERS:
        assert searcher(name, there, polar, sighting(0.0)).look(sighting(0.2)).given_up == ""
    with pytest.raises(KeyError):
        searcher("nobody", there, polar, sighting(0.0))


@pytest.mark.long
def test_from_upstream_of_the_foot_the_map_finds_what_a_line_does_not() -> None:
    """A start without a crossing, and with: in the module's own closed loop."""
    pytest.importorskip("numba")
    airframe = load_airframe(shipped("airframes/eclipson_c.toml"))
    polar = airframe.polar.as_polar()
    there = place("tunnel", 10_009)

    def flown(name: str) -> Score:
        return score(
            fly_episode(there, airframe, name, lambda first: searcher(name, there, polar, first))
        )

    scores = {name: flown(name) for name in (MAP, "line through the start")}
    assert scores[MAP].soared
    assert isfinite(scores[MAP].claimed_s)
    assert not scores["line through the start"].soared
    assert scores["line through the start"].in_time

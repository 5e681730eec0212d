"""The three places: what is flown there, what a place's figures come to of several flights, each
claim and word on both sides of its bound."""

from __future__ import annotations

from functools import cache
from math import cos, inf, isnan, nan, sin, sqrt
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from by_hand import ScriptedFlyer, flight, leg, signs
from test_places import PLACES, place

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper import places as places_module
from tgl_soar.analysis.experiments.paper.places import (
    JUDGED,
    ROUGH,
    FlownPlace,
    _row,
    _stalled,
    in_its_wind,
    place_claims,
    places,
    places_why,
    score_place,
    stepped,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import PreparedScenario, Scenario, prepare, slide_at
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion, leverage
from tgl_soar.analysis.report import field_figure as field_figures
from tgl_soar.config.files import ConfigError, shipped
from tgl_soar.types import polar_sink, polar_slope


@cache
def at_b() -> tuple[Scenario, float]:
    scenario = Context(flyer=ScriptedFlyer(lambda _: None)).scenario("places")
    return in_its_wind(scenario, shipped("sites/hill.toml"), "b")


def prepared() -> PreparedScenario:
    return prepare(at_b()[0])


# --- what is flown ------------------------------------------------------------------------------


def test_a_flight_with_a_step_lasts_a_hundred_seconds() -> None:
    """The wind rises by 3 % from 40 to 45 s; the slowest slide's two time constants are left alone
    at the beginning and after it."""
    placed, wind_mps = at_b()
    risen = stepped(placed, wind_mps)
    assert risen.duration_s == 100.0
    assert risen.wind is not None
    assert risen.wind.times_s == [40.0, 45.0]
    assert risen.wind.mps == pytest.approx([wind_mps, 1.03 * wind_mps])
    assert [(change.time_s, change.line) for change in risen.changes] == [(45.0, "b")]
    assert risen.unscored_s == [(0.0, 17.0), (40.0, 62.0)]
    assert risen.turbulence is not None
    assert risen.turbulence.intensity == 0.01
    assert (JUDGED, ROUGH) == (0.01, 0.03)


def test_a_place_is_alone_in_its_scenario_in_a_steady_wind() -> None:
    placed, wind_mps = at_b()
    assert list(placed.lines) == [placed.first_line] == ["b"]
    assert placed.wind is not None
    assert placed.wind.times_s == [0.0, 1.0]
    assert placed.wind.mps == [wind_mps, wind_mps]


@pytest.mark.parametrize(("refused", "found"), [
    (0, 1.0), (1, 0.95), (2, 1.05), (3, 0.9), (4, 1.1), (5, 0.85), (6, 1.15),
])  # fmt: skip
def test_winds_are_tried_by_twentieths_the_nearest_first(
    monkeypatch: pytest.MonkeyPatch, refused: int, found: float
) -> None:
    """So many of them have not the place."""
    asked: list[float] = []

    def prepare_later(given: Scenario) -> None:
        assert given.wind is not None
        asked.append(given.wind.mps[0])
        if len(asked) <= refused:
            raise ConfigError("not here")

    scenario = Context(flyer=ScriptedFlyer(lambda _: None)).scenario("places")
    monkeypatch.setattr(places_module, "prepare", prepare_later)
    _, wind_mps = in_its_wind(scenario, shipped("sites/tunnel.toml"), "b")
    assert wind_mps == pytest.approx(8.5 * found)
    assert len(asked) == refused + 1


# --- one place ----------------------------------------------------------------------------------


def one(
    rms_m: float = 0.006, along_m: float = 0.0, ended: str = "", alpha_rad: float = 0.0, **more: Any
) -> FlownScenario:
    return flight(
        leg("b", rms_e_rho_m=rms_m, along_m=along_m, **more),
        leg("b", along_m=along_m + 0.02),
        ended=ended,
        path={"alpha_rad": np.array([alpha_rad, alpha_rad])},
    )


def scored(
    still: list[FlownScenario], rough: list[FlownScenario], step: list[FlownScenario]
) -> FlownPlace:
    placed, wind_mps = at_b()
    flights = {JUDGED: still, ROUGH: rough}
    return score_place(("a hill", "b"), wind_mps, placed, flights, stepped(placed, wind_mps), step)


def test_a_place_is_scored_at_both_turbulences_and_with_the_step() -> None:
    still = [one(0.03, 0.01, dispersion_m=0.03), one(0.01, -0.01, dispersion_m=0.04)]
    lost = one(0.5, ended="left the air at x 1, y 0, z 2 m")
    found = scored(still, [one(), lost], [one(along_m=0.1), one(along_m=0.2), lost])
    assert (found.site, found.line, found.wind_mps) == ("a hill", "b", at_b()[1])
    assert (found.flights, found.survived) == (2, {JUDGED: 2, ROUGH: 1})
    assert found.rms_e_rho_m[JUDGED] == pytest.approx(sqrt(5e-4))
    assert found.rms_e_rho_m[ROUGH] == inf
    assert found.dispersion_m[JUDGED] == pytest.approx(sqrt((9 + 16) / 2.0 + 1.0) / 100.0)
    assert found.apart_m[JUDGED] == pytest.approx(0.02 / sqrt(2.0))
    assert found.shift.flown_m == pytest.approx(0.02)
    assert found.shift_lost == 1
    assert found.ended == ("left the air at x 1, y 0, z 2 m",) * 2
    assert found.lost == 2
    assert scored([one()], [flight()], [one()]).rms_e_rho_m[ROUGH] == inf  # none was scored
    assert isnan(scored([one()], [flight()], [one()]).dispersion_m[ROUGH])


def test_a_places_slopes_are_those_of_polar_and_field() -> None:
    found = scored([one()], [one()], [one()])
    target, at = prepared().lines["b"]
    assert at is not None
    polar, u = prepared().polar, at.wind_mps
    assert (found.x_m, found.z_m, found.local_mps) == (at.x_m, at.z_m, u)
    assert found.speed_ratio == pytest.approx(1.0, abs=1e-3)
    assert found.polar_slope == pytest.approx(polar_slope(polar, u))
    assert found.margin == pytest.approx(polar_sink(polar, u) / u - polar_slope(polar, u))
    slide = slide_at(polar, target, at)
    assert (found.leverage, found.rate_per_s) == (leverage(slide), slide.rate_per_s)
    c, s = 0.05 * cos(target.eta_rad), 0.05 * sin(target.eta_rad)
    high, low = (
        prepared().field.wind_at(at.x_m + k * c, 0.0, at.z_m + k * s, 0.0)[0] for k in (1, -1)
    )
    assert found.wind_slope_per_s == pytest.approx((high - low) / 0.1)
    air = prepare(with_turbulence(at_b()[0], ROUGH)).site.air
    assert air is not None
    reference = prepared().field.reference_wind_mps
    tau = air.turbulence.length_scale_m / reference
    for intensity in (JUDGED, ROUGH):
        expected = dryden_dispersion(slide, intensity * reference, tau)
        assert found.formula_m[intensity] == pytest.approx(expected)


def test_a_wing_stalled_where_it_was_beyond_within_three_seconds_of_the_end() -> None:
    time = np.array([0.0, 6.9, 7.0, 9.0, 10.0])

    def stalls(*alphas: float) -> bool:
        path = {"time_s": time, "alpha_rad": np.array(alphas)}
        return _stalled(flight(leg(end_s=10.0), path=path), 0.3)

    assert not stalls(0.5, 0.5, 0.1, 0.1, 0.1)
    assert stalls(0.1, 0.1, 0.31, 0.1, 0.1)
    assert stalls(0.1, 0.1, 0.1, 0.1, 0.31)
    assert not stalls(0.1, 0.1, 0.3, 0.3, 0.3)


def test_flights_that_were_lost_with_a_stall_are_counted_and_a_point_mass_has_none() -> None:
    stall = prepared().airframe.model["stall_alpha_rad"]
    lost = one(ended="left the air", alpha_rad=stall + 0.01)
    unstalled = one(ended="left the air", alpha_rad=stall - 0.01)
    whole = one(alpha_rad=stall + 0.01)
    flights = [lost, unstalled, whole]
    assert scored(flights, flights, flights).stalled == 3
    placed, wind_mps = at_b()
    point = msgspec.structs.replace(placed, model="point_mass")
    found = score_place(
        ("a hill", "b"), wind_mps, point, {JUDGED: flights, ROUGH: flights},
        stepped(point, wind_mps), flights,
    )  # fmt: skip
    assert found.stalled == 0


def test_a_row_is_in_centimetres() -> None:
    s = place("a", -0.07, 0.1)._replace(x_m=-1.234, z_m=2.345, wind_slope_per_s=0.256)
    assert _row(s) == (
        "a hill", "[a]", "7.00", "-1.23, 2.35", "8.00", "0.900", "-0.070", "+0.100", "+0.26",
        "8 of 8", "0.60", "1.00", "3.00", "3.00", "6 of 8", "lost", "+10.0 ± 1.0", "+0.0", "+10.0",
    )  # fmt: skip
    alone = s._replace(shift=s.shift._replace(error_m=inf, off_m=nan, predicted_m=nan))
    assert _row(alone)[-3:] == ("+10.0 ± –", "–", "–")


# --- claims -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("which", "what", "value", "held"),
    [
        (0, "polar_slope", 0.0, "✗✓✓✓"),
        (1, "polar_slope", 0.0, "✗✓✓✓"),
        (2, "polar_slope", -0.1, "✓✓✓✓"),
        (0, "rms_e_rho_m", {JUDGED: 0.03, ROUGH: inf}, "✓✓✓✓"),
        (0, "rms_e_rho_m", {JUDGED: 0.0301, ROUGH: 0.0}, "✓✗✓✓"),
        (1, "rms_e_rho_m", {JUDGED: 0.0301, ROUGH: 0.0}, "✓✗✓✓"),
        (2, "rms_e_rho_m", {JUDGED: 0.0301, ROUGH: 0.0}, "✓✓✗✓"),
        (3, "rms_e_rho_m", {JUDGED: 0.0301, ROUGH: 0.0}, "✓✓✗✓"),
        (1, "shift_lost", 1, "✓✓✓✓"),  # [a2] is not asked for its shift
        (2, "shift_lost", 1, "✓✓✓✗"),
        (3, "shift_lost", 1, "✓✓✓✗"),
    ],
)
def test_each_place_is_judged_by_its_own_bound(
    which: int, what: str, value: Any, held: str
) -> None:
    several = list(PLACES)
    several[which] = several[which]._replace(**{what: value})
    assert signs(place_claims(several)) == held


@pytest.mark.parametrize(
    ("a_m", "b_m", "c_m", "sign"),
    [
        (0.10, 0.0, -0.10, "✓"),
        (0.025, -0.02, -0.06, "✓"),  # 2.4 errors of a centimetre
        (0.023, -0.02, -0.06, "?"),
        (0.10, 0.04, -0.023, "?"),
        (0.10, 0.04, -0.025, "✓"),
        (0.10, 0.065, -0.10, "✓"),  # apart by more than 2.4 · √2 cm
        (0.10, 0.067, -0.10, "?"),
        (0.10, 0.14, -0.10, "✗"),
        (0.10, -0.067, -0.10, "?"),
        (0.10, -0.14, -0.10, "✗"),
        (0.10, 0.04, 0.05, "✗"),
    ],
)
def test_b_lies_in_between_beyond_the_errors_of_both(
    a_m: float, b_m: float, c_m: float, sign: str
) -> None:
    several = [place("a", -0.07, a_m), PLACES[1], place("b", 0.15, b_m), place("c", 0.2, c_m)]
    assert signs(place_claims(several))[3] == sign


def test_each_air_has_its_own_claims_and_words() -> None:
    other = [s._replace(site="before it", wind_slope_per_s=-0.1) for s in PLACES]
    other[3] = other[3]._replace(rms_e_rho_m={JUDGED: inf, ROUGH: inf}, shift_lost=3)
    claims = place_claims([*PLACES, *other])
    assert signs(claims) == "✓✓✓✓✓✓✗✗"
    assert [("before it" in claim.text) for claim in claims] == [False] * 4 + [True] * 4
    assert claims[1].measured == "8 of 8 at [a], 0.60 cm; 8 of 8 at [a2], 0.60 cm"
    assert claims[6].measured == "8 of 8 at [b], 0.60 cm; 8 of 8 at [c]"
    assert claims[7].measured.endswith("-5.0 ± 1.0 cm at [c] (3 of 8 lost)")
    gone = [*PLACES[:3], place("c", 0.2, nan, lost=8)]
    assert place_claims(gone)[3].measured.endswith("all lost at [c]")
    words = places_why([*PLACES, *other])
    assert "a hill: wind grows by +0.20 m/s" in words
    assert "before it: wind grows by -0.10 m/s" in words
    assert "2 at [a], 2 at [a2], 2 at [b], 5 at [c]" in words
    assert "Flights ended by: left the air." in words
    silent = [s._replace(ended=()) for s in PLACES]
    assert "ended by" not in places_why(silent)


def test_leverages_are_reported_from_the_least_to_the_greatest() -> None:
    several = [s._replace(leverage=0.9 + 0.01 * k) for k, s in enumerate(PLACES)]
    assert "is 0.90 to 0.93 at all of these places" in places_why(several)


@pytest.mark.parametrize(("stalled", "is_reason"), [(3, True), (2, False)])
def test_more_than_half_must_have_stalled(stalled: int, is_reason: bool) -> None:
    slow = PLACES[0]._replace(survived={JUDGED: 8, ROUGH: 4}, stalled=stalled)
    kept = PLACES[1]._replace(survived={JUDGED: 8, ROUGH: 8})
    words = places_why([slow, kept, *PLACES[2:]])
    assert f"Near it 4 flights of 48 were lost; in {stalled} of them" in words
    assert ("no more lift to give" in words) is is_reason
    assert ("most of them did not stall" in words) is not is_reason
    level = slow._replace(wind_slope_per_s=0.0)
    assert "0 were lost where the wind falls going down the line, and 4 where" in places_why(
        [level, kept, *PLACES[2:]]
    )


# --- the whole ----------------------------------------------------------------------------------


def flown(job: ScenarioJob) -> FlownScenario:
    """On [a] it rises by 5 cm, on [c] it sinks by as much, on [b] it stays."""
    line = job.scenario.first_line
    moved_m = {"a": 0.05, "a2": 0.04, "b": 0.0, "c": -0.05}[line] + 0.001 * (job.seed - 4.5)
    return flight(
        leg(line, rms_e_rho_m=0.01),
        *([leg(line, along_m=moved_m)] if job.scenario.changes else []),
        seed=job.seed,
    )


@cache
def concluded() -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(flown)
    return places(Context(flyer=flyer)), flyer.jobs


def test_every_place_is_flown_in_all_three_airs_in_two_turbulences_and_with_a_step() -> None:
    result, jobs = concluded()
    flights = []
    for job in jobs:
        given = job.scenario
        assert given.site is not None
        assert given.turbulence is not None
        kind = "step" if given.changes else f"{given.turbulence.intensity:g}"
        flights.append((Path(given.site).stem, given.first_line, kind, job.seed))
    assert flights == [
        (site, line, kind, seed)
        for site in ("hill", "tunnel", "tunnel_polynomial")
        for line in ("a", "a2", "b", "c")
        for kind in ("0.01", "0.03", "step")
        for seed in range(1, 9)
    ]
    assert signs(result.claims) == "✓" * 12
    (table,) = result.tables
    assert [row[1] for row in table.rows] == ["[a]", "[a2]", "[b]", "[c]"] * 3
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert len(result.numbers["places"]) == 12
    assert result.numbers["places"][0]["shift"]["flown_m"] == pytest.approx(0.05)
    assert "with 3 % more wind half-way" in result.flown
    assert "0.825, 0.85, 1, 1.05 of best glide's" in result.flown
    assert len(result.changed) == 1


def test_each_air_is_drawn_in_the_wind_of_its_best_glide(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(field_figures, "field_figure", lambda *given: drawn.append(given))
    result = places(Context(flyer=ScriptedFlyer(flown), quick=True, figures=tmp_path))
    assert result.figures == tuple(f"places_{n}.png" for n in (1, 2, 3))
    assert [given[0] for given in drawn] == [tmp_path / name for name in result.figures]
    by_air = [result.numbers["places"][n : n + 4] for n in (0, 4, 8)]
    for given, names in zip(drawn, by_air, strict=True):
        marked = given[5]
        assert [(each.x_m, each.z_m) for each in marked] == [(p["x_m"], p["z_m"]) for p in names]
        others = {p["wind_mps"] for p in names} - {names[2]["wind_mps"]}
        assert given[6] == (
            f"{names[0]['site']}, wind and contour at {names[2]['wind_mps']:.2f} m/s"
            + ("; others lie off it" if others else "")
        )

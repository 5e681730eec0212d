"""A step of wind: what is flown, and what is read from paths that are drawn by hand; each claim on
both sides of its bounds."""

from __future__ import annotations

from functools import cache
from math import cos, isnan, nan, sin
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from by_hand import ScriptedFlyer, crossing_along, flight, signs
from test_gust_response import gust_change

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper.gust_response import (
    WindEffect,
    gust,
    gust_why,
    sensitivity_claims,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import prepare
from tgl_soar.analysis.report import curves_figure as curves_figures
from tgl_soar.types import polar_sink

END_M: Final = {"a": 0.03, "b": 0.02, "c": 0.001, "d": -0.02}
BEST: Final = 10.0


def flown(job: ScenarioJob) -> FlownScenario:
    """Up the line since 25 s: 1 cm after half a second, 5 cm at most within five, 40 cm at six,
    and END_M from eight seconds on; before, 30 cm up, and far away earlier than 15 s.  Seed 8 is
    lost at [b], somewhere else."""
    line = job.scenario.first_line
    target = prepare(job.scenario).lines[line].target
    time = np.arange(0.0, 45.01, 0.05)
    since = time - 25.0
    end_m = END_M[line]
    way = np.interp(since, [0.0, 1.0, 2.0, 5.0, 6.0, 8.0], [0.0, 0.02, 0.05, 0.0, 0.4, end_m])
    way = way + 0.3 + 0.001 * (job.seed - 4.5) * (since > 0.0)
    way[time < 14.99] = 9.0
    lost = line == "b" and job.seed == 8
    if lost:
        way = way + 5.0
    path = {
        "time_s": time,
        "x_m": target.x_m + cos(target.eta_rad) * way,
        "z_m": target.z_m + sin(target.eta_rad) * way,
    }
    return flight(seed=job.seed, path=path, ended="hit the board" if lost else "")


@cache
def concluded() -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(flown)
    return gust(Context(flyer=flyer)), flyer.jobs


def test_a_step_of_four_tenths_about_the_wind_that_names_the_places_is_flown() -> None:
    placed = prepare(Context(flyer=ScriptedFlyer(flown)).scenario("gust"))
    jobs = concluded()[1]
    assert [(j.scenario.first_line, j.seed) for j in jobs] == [
        (line, seed) for line in "abcd" for seed in range(1, 9)
    ]
    for job in jobs:
        wind, target = job.scenario.wind, placed.lines[job.scenario.first_line].target
        assert wind is not None
        assert wind.mps == pytest.approx([8.3, 8.7])
        assert wind.times_s == [25.0, 25.2]
        (spec,) = job.scenario.lines.values()
        assert (spec.x_m, spec.z_m) == (target.x_m, target.z_m)


def test_the_way_up_the_line_is_that_since_the_step_of_flights_that_lasted() -> None:
    for place in concluded()[0].numbers["places"]:
        line = place["line"]
        # The lost one of [b] takes with it the noise that stood against the others'.
        apart = -0.0005 if line == "b" else 0.0
        assert place["lost"] == (line == "b")
        assert place["at_once_m"] == pytest.approx(0.01 + apart, abs=1e-4)
        assert place["highest_m"] == pytest.approx(0.05 + apart, abs=1e-4)
        assert place["in_the_end_m"] == pytest.approx(END_M[line] + apart, abs=1e-4)


def test_a_standard_error_is_that_of_the_flights_that_lasted() -> None:
    """They are a millimetre apart from one to the next, at any time since the step."""
    for place in concluded()[0].numbers["places"]:
        lasted = 7 if place["line"] == "b" else 8
        error_m = 0.001 * float(np.std(np.arange(lasted), ddof=1)) / lasted**0.5
        for what in ("at_once", "highest", "in_the_end"):
            assert place[f"{what}_error_m"] == pytest.approx(error_m, rel=1e-6)


def test_a_single_flight_decides_no_sign() -> None:
    result = gust(Context(flyer=ScriptedFlyer(flown), quick=True))
    assert len(result.seeds) == 1
    assert signs(result.claims) == "✓??"
    assert result.tables[1].rows[0][1].endswith(" ± –")


def test_slopes_are_those_of_polar_and_field_where_the_place_is_named() -> None:
    placed = prepare(Context(flyer=ScriptedFlyer(flown)).scenario("gust"))
    polar = placed.polar
    places = {place["line"]: place for place in concluded()[0].numbers["places"]}
    best_mps = concluded()[0].numbers["best_glide_mps"]
    assert places["a"]["wind_mps"] == pytest.approx(0.9 * best_mps, rel=1e-3)
    for line, place in places.items():
        u = place["wind_mps"]
        slope = (polar_sink(polar, u + 0.001) - polar_sink(polar, u - 0.001)) / 0.002
        assert place["sink_mps"] == pytest.approx(polar_sink(polar, u))
        # On the contour updraft is sink.
        assert place["updraft_gain"] == pytest.approx(polar_sink(polar, u) / u, rel=1e-3)
        assert place["sink_gain"] == pytest.approx(slope, rel=1e-4)
        assert place["margin"] == pytest.approx(place["updraft_gain"] - place["sink_gain"])
        (job,) = [j for j in concluded()[1] if (j.scenario.first_line, j.seed) == (line, 1)]
        stepped = prepare(job.scenario)
        shift = crossing_along(stepped, line, 100.0) - crossing_along(stepped, line, 0.0)
        assert place["predicted_m"] == pytest.approx(shift, abs=1e-4)


def test_the_tables_are_in_centimetres() -> None:
    slopes, ways = concluded()[0].tables
    a = concluded()[0].numbers["places"][0]
    flown = ("+1.0 ± 0.1", "+5.0 ± 0.1", "+3.0 ± 0.1")  # 1.87 mm over the root of eight
    assert ways.rows[0] == ("a", *flown, f"{100 * a['predicted_m']:+.1f}")
    assert slopes.rows[0] == (
        "a",
        f"{a['wind_mps']:.2f}",
        f"{a['sink_mps']:.3f}",
        f"{a['updraft_gain']:+.3f}",
        f"{a['sink_gain']:+.3f}",
        f"{a['margin']:+.3f}",
    )
    assert [row[0] for row in ways.rows] == [row[0] for row in slopes.rows] == list("abcd")
    assert "Flown, 0.4 m/s more wind in the tunnel" in ways.title


def test_a_place_that_lost_all_has_no_way_and_no_claim() -> None:
    lost = gust(
        Context(flyer=ScriptedFlyer(lambda job: flight(ended="hit the board", seed=job.seed)))
    )
    for place in lost.numbers["places"]:
        assert place["lost"] == 8
        assert isnan(place["in_the_end_m"])
        assert isnan(place["at_once_m"])
    assert signs(lost.claims) == "✓✗✗"
    assert "32 flights lost" in lost.claims[1].measured


def test_claims_are_of_what_was_flown() -> None:
    result = concluded()[0]
    assert signs(result.claims) == "✓✗✗"  # [b] lost one; at once all go up
    assert [each.claim for each in result.changed] == [
        *("the aircraft's answer to a gust",) * 4,
        "the step of wind",
    ]
    assert "+3.0 ± 0.1 cm at a" in result.claims[1].measured
    assert "thrown up at every place" in result.why
    assert result.seeds == tuple(range(1, 9))


# --- claims -------------------------------------------------------------------------------------


def change(ratio: float, margin: float, once_m: float, end_m: float) -> WindEffect:
    return gust_change("a", ratio * BEST, margin, once_m, end_m)


SLOW, AT_BEST, BEYOND = (
    change(0.95, 0.1, 0.01, 0.03),
    change(1.0, 0.0, 0.0, 0.0),
    change(1.02, -0.02, -0.01, -0.02),
)


@pytest.mark.parametrize(
    ("ratio", "is_slow"), [(0.985, True), (0.989, True), (0.991, False), (0.994, False)]
)
def test_a_place_is_slow_below_ninety_nine_hundredths_of_best_glide(
    ratio: float, is_slow: bool
) -> None:
    """A place that falls has not what is asked of slow ones; between them nothing is asked."""
    falls = change(ratio, -0.1, -0.05, -0.05)
    assert signs(sensitivity_claims([falls, AT_BEST, BEYOND], BEST)) == (
        "✗✗✗" if is_slow else "✓✓✓"
    )


@pytest.mark.parametrize(
    ("ratio", "is_best", "is_beyond"),
    [
        (0.9945, False, False),
        (0.9955, True, False),
        (1.0045, True, False),
        (1.0055, False, True),
        (1.5, False, True),
    ],
)
def test_best_glide_is_half_a_hundredth_wide(ratio: float, is_best: bool, is_beyond: bool) -> None:
    rises, falls = change(ratio, 0.1, 0.05, 0.05), change(ratio, -0.1, -0.05, -0.05)
    claims = [signs(sensitivity_claims([SLOW, each], BEST)) for each in (rises, falls)]
    is_asked = is_best or is_beyond
    assert claims == ["✗✗✗" if is_asked else "✓✓✓", "✗✗✗" if is_best else "✓✓✓"]


@pytest.mark.parametrize(
    ("what", "place", "value", "claims"),
    [
        ("updraft_gain", 0, 0.1549, "✗✓✓"),
        ("updraft_gain", 0, 0.1551, "✓✓✓"),
        ("updraft_gain", 1, 0.1549, "✓✓✓"),
        ("updraft_gain", 1, 0.1551, "✗✓✓"),
        ("updraft_gain", 1, 0.1449, "✗✓✓"),
        ("updraft_gain", 2, 0.1449, "✓✓✓"),
        ("updraft_gain", 2, 0.1451, "✗✓✓"),
        ("in_the_end_m", 0, 0.0141, "✓✓✓"),
        ("in_the_end_m", 0, 0.014, "✓?✓"),
        ("in_the_end_m", 0, 0.0139, "✓✗✓"),
        ("in_the_end_m", 1, 0.0139, "✓✓✓"),
        ("in_the_end_m", 1, -0.0141, "✓✗✓"),
        ("in_the_end_m", 2, -0.0141, "✓✓✓"),
        ("in_the_end_m", 2, -0.014, "✓?✓"),
        ("in_the_end_m", 2, -0.0139, "✓✗✓"),
        ("at_once_m", 0, 0.0021, "✓✓✓"),
        ("at_once_m", 0, 0.002, "✓✓?"),
        ("at_once_m", 0, 0.0019, "✓✓✗"),
        ("at_once_m", 1, 0.0019, "✓✓✓"),
        ("at_once_m", 1, -0.0021, "✓✓✗"),
        ("at_once_m", 2, -0.0021, "✓✓✓"),
        ("at_once_m", 2, -0.002, "✓✓?"),
        ("at_once_m", 2, -0.0019, "✓✓✗"),
        ("in_the_end_m", 0, -0.03, "✓✗✓"),
        ("in_the_end_m", 2, 0.03, "✓✗✓"),
        ("at_once_m", 0, -0.01, "✓✓✗"),
        ("at_once_m", 2, 0.01, "✓✓✗"),
        ("in_the_end_m", 0, nan, "✓✗✓"),
    ],
)
def test_a_place_is_judged_by_its_bound(what: str, place: int, value: Any, claims: str) -> None:
    """5 mm/s of margin, 1.4 cm in the end and 2 mm at once; sink gains 0.15."""
    several = [SLOW, AT_BEST, BEYOND]
    several[place] = several[place]._replace(**{what: value})
    assert signs(sensitivity_claims(several, BEST)) == claims


@pytest.mark.parametrize(
    ("what", "place", "error_m", "claims"),
    [
        ("in_the_end", 0, 0.0066, "✓✓✓"),  # 1.6 cm, over 1.4, are 2.4 standard errors of 0.67 cm
        ("in_the_end", 0, 0.0067, "✓?✓"),
        ("in_the_end", 1, 0.0058, "✓✓✓"),  # as 1.4 cm are of 0.58 cm
        ("in_the_end", 1, 0.0059, "✓?✓"),
        ("in_the_end", 2, 0.0024, "✓✓✓"),
        ("in_the_end", 2, 0.0026, "✓?✓"),
        ("at_once", 0, 0.0033, "✓✓✓"),
        ("at_once", 0, 0.0034, "✓✓?"),
        ("at_once", 1, 0.00083, "✓✓✓"),
        ("at_once", 1, 0.00084, "✓✓?"),
        ("at_once", 2, 0.0033, "✓✓✓"),
        ("at_once", 2, 0.0034, "✓✓?"),
    ],
)
def test_a_bound_within_the_standard_errors_leaves_a_claim_open(
    what: str, place: int, error_m: Any, claims: str
) -> None:
    several = [SLOW, AT_BEST, BEYOND]
    several[place] = several[place]._replace(**{f"{what}_error_m": error_m})
    assert signs(sensitivity_claims(several, BEST)) == claims


def test_what_is_open_at_one_place_hides_no_other_that_falls() -> None:
    several = [SLOW._replace(in_the_end_m=-0.03), AT_BEST, BEYOND._replace(in_the_end_error_m=1.0)]
    assert signs(sensitivity_claims(several, BEST)) == "✓✗✓"


def test_losses_anywhere_break_both_claims_of_the_aircraft() -> None:
    for k in range(3):
        several = [SLOW, AT_BEST, BEYOND]
        several[k] = several[k]._replace(lost=2)
        claims = sensitivity_claims(several, BEST)
        assert signs(claims) == "✓✗✗"
        assert claims[1].measured.endswith("2 flights lost")
    assert sensitivity_claims([SLOW], BEST)[1].measured.endswith("0 flights lost")


def test_an_aircraft_is_thrown_up_where_all_places_are_at_once() -> None:
    assert "thrown up at every place" in gust_why([SLOW, SLOW])
    assert "thrown" not in gust_why([SLOW, AT_BEST])  # not at all is not up
    assert "thrown" not in gust_why([SLOW, BEYOND])


def test_the_figure_shows_ways_in_centimetres_and_updrafts_through_the_origin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(curves_figures, "curves_figure", lambda *given: drawn.append(given))
    result = gust(Context(flyer=ScriptedFlyer(flown), figures=tmp_path))
    assert result.figures == ("gust.png",)
    ((path, panels, _),) = drawn
    assert path == tmp_path / "gust.png"
    rays, margins, histories = panels
    a = result.numbers["places"][0]
    sink, at_a = rays.series[0], rays.series[1]
    polar = prepare(Context(flyer=ScriptedFlyer(flown)).scenario("gust")).polar
    assert (sink.x[0], sink.x[-1]) == pytest.approx(
        (polar.speed_min_mps, min(polar.speed_max_mps, 11.0))
    )
    assert sink.y == pytest.approx([polar_sink(polar, u) for u in sink.x])
    assert at_a.x == pytest.approx([a["wind_mps"] - 0.7, a["wind_mps"] + 0.9])
    assert at_a.y == pytest.approx([a["updraft_gain"] * u for u in at_a.x])
    curve, zero, first = margins.series[:3]
    assert (zero.x, zero.y) == ([curve.x[0], curve.x[-1]], [0.0, 0.0])
    assert (first.x, first.y) == ([a["wind_mps"]], [a["margin"]])
    assert np.interp(a["wind_mps"], curve.x, curve.y) == pytest.approx(a["margin"], abs=1e-3)
    assert [mark.x for mark in margins.marks] == [result.numbers["best_glide_mps"]]
    assert [note.text for note in margins.notes] == list("abcd")
    moved, dashed = histories.series[:2]
    assert (min(moved.x), max(moved.x)) == pytest.approx((-0.95, 7.95))
    assert np.interp(2.0, moved.x, moved.y) == pytest.approx(5.0, abs=0.01)
    assert dashed.y == pytest.approx([100.0 * a["predicted_m"]] * 2)
    assert dashed.x == [6.5, 8.0]
    assert 7.0 < histories.notes[0].x < 8.0  # at its end
    assert histories.notes[0].y == pytest.approx(moved.y[-1])

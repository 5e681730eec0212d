"""Air that changes: what is flown, and the numbers that come of legs that are written by hand, each
computed again from the field, from the polar or from the legs themselves."""

from __future__ import annotations

from functools import cache
from math import cos, inf, isnan, nan, sin, sqrt
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from by_hand import ScriptedFlyer, crossing_along, flight, leg, signs
from test_changing_air import shift, slope_shift

from tgl_soar.air.zeuc import excess_gradient
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper.changing_air import (
    both_legs,
    pinned,
    predicted_shift,
    shift_of,
    slope,
    slope_claims,
    wind,
    wind_claims,
    wind_why,
)
from tgl_soar.analysis.experiments.paper.still_lines import polar_bias_m
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import (
    Scenario,
    WindSchedule,
    prepare,
    slide_at,
)
from tgl_soar.analysis.report import flight_figure as flight_figures
from tgl_soar.types import polar_sink, polar_slope

LATE_S = 1000.0


@cache
def scenario(name: str) -> Scenario:
    return Context(flyer=ScriptedFlyer(lambda _: None)).scenario(name)


# --- a shift ------------------------------------------------------------------------------------


def two_legs(begin_m: float, end_m: float, **more: Any) -> FlownScenario:
    """On a, on b, and on a again."""
    first = leg("a", along_m=begin_m, mean_z_m=1.0 + begin_m, **more)
    last = leg("a", along_m=end_m, mean_z_m=1.0 + 0.5 * end_m, **more)
    return flight(first, leg("b"), last)


def test_a_shift_is_of_the_flights_that_flew_both_legs() -> None:
    flights = [two_legs(0.0, 0.10), two_legs(0.02, 0.16), flight(leg("a", along_m=5.0))]
    assert [(a.along_m, b.along_m) for a, b in both_legs(flights, "a")] == [(0, 0.1), (0.02, 0.16)]
    assert both_legs(flights, "b") == []
    found = shift_of(prepare(scenario("slope")), flights, "a")
    assert found.line == "a"
    assert found.flown_m == pytest.approx(0.12)  # of 0.10 and 0.14
    assert found.error_m == pytest.approx(0.02)  # half their distance
    assert found.up_m == pytest.approx(0.055)  # of 0.05 and 0.06
    nobody = shift_of(prepare(scenario("slope")), flights, "b")
    assert isnan(nobody.flown_m)
    assert nobody.error_m == inf
    assert isnan(nobody.worst_off_m)
    assert isnan(nobody.worst_glide_m)


def test_a_shift_is_held_against_that_of_each_flights_own_contour() -> None:
    """Own places: before and after, by the fitted cubic and by the glides themselves."""

    def one(flown_m: float, cubic_m: float, glide_m: float) -> FlownScenario:
        before = leg("a", along_m=0.01, own_predicted_along_m=0.04, own_glide_along_m=0.05)
        after = leg(
            "a",
            along_m=0.01 + flown_m,
            own_predicted_along_m=0.04 + cubic_m,
            own_glide_along_m=0.05 + glide_m,
        )
        return flight(before, after)

    flights = [one(0.10, 0.09, 0.095), one(0.10, 0.13, 0.102)]
    found = shift_of(prepare(scenario("slope")), flights, "a")
    assert found.off_m == pytest.approx(-0.01)  # of +1 cm and −3 cm
    assert found.off_error_m == pytest.approx(0.02)
    assert found.worst_off_m == pytest.approx(-0.03)
    assert found.worst_glide_m == pytest.approx(0.005)


def test_a_single_flights_shift_is_known_by_its_samples_in_time() -> None:
    prepared = prepare(scenario("slope"))
    target, at = prepared.lines["a"]
    assert at is not None
    rate = slide_at(prepared.polar, target, at).rate_per_s
    before = leg("a", dispersion_m=0.03, scored_s=20.0)
    after = leg("a", dispersion_m=0.04, scored_s=10.0)
    found = shift_of(prepared, [flight(before, after)], "a")
    # One independent value every two time constants.
    expected = sqrt(0.03**2 / (20.0 * rate / 2.0) + 0.04**2 / (10.0 * rate / 2.0))
    assert found.error_m == pytest.approx(expected)
    assert found.off_error_m == pytest.approx(expected)
    brief = [leg("a", dispersion_m=0.03, scored_s=0.1)] * 2
    assert shift_of(prepared, [flight(*brief)], "a").error_m == pytest.approx(0.03 * sqrt(2.0))
    # Two flights are known by what sets them apart, here by nothing.
    assert shift_of(prepared, [flight(before, after)] * 2, "a").error_m == 0.0


@pytest.mark.parametrize("line", ["a", "c"])
def test_the_shift_that_is_predicted_is_that_of_the_contour_up_the_line(line: str) -> None:
    prepared = prepare(scenario("slope"))
    expected = crossing_along(prepared, line, LATE_S) - crossing_along(prepared, line, 0.0)
    assert expected > 0.02
    assert predicted_shift(prepared, line) == pytest.approx(expected, abs=1e-4)


def test_without_a_contour_there_is_no_shift_to_predict() -> None:
    prepared = prepare(scenario("slope"))
    target, _ = prepared.lines["a"]
    far = target._replace(z_m=9.0)
    for line in (prepared.lines["a"]._replace(crossing=None), prepared.lines["a"]._replace(
        target=far
    )):  # fmt: skip
        lines = {**prepared.lines, "a": line}
        assert isnan(predicted_shift(prepared._replace(lines=lines), "a"))


# --- slope --------------------------------------------------------------------------------------


def slope_flown(job: ScenarioJob) -> FlownScenario:
    """It rises by 10 cm, each flight by another millimetre; its own contour by 9 cm."""
    apart = 0.001 * (job.seed - 4.5)
    before = [leg(line, own_predicted_along_m=0.0) for line in "abc"]
    after = [
        leg(line, along_m=0.10 + apart, mean_z_m=1.08, own_predicted_along_m=0.09) for line in "cba"
    ]
    return flight(*before, *after, seed=job.seed)


@cache
def slope_result(quick: bool = False, dispersion: bool = False) -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(slope_flown)
    result = slope(Context(flyer=flyer, quick=quick, dispersion=dispersion))
    return result, flyer.jobs


def test_slope_is_flown_in_calm_air_once_and_in_turbulence_with_every_seed() -> None:
    def flown(jobs: list[ScenarioJob]) -> list[tuple[float, int]]:
        return [(j.scenario.turbulence.intensity, j.seed) for j in jobs if j.scenario.turbulence]

    eight = range(1, 9)
    assert flown(slope_result()[1]) == [(0.0, 1), *((0.01, seed) for seed in eight)]
    assert flown(slope_result(quick=True)[1]) == [(0.01, 1)]
    dispersed = [(i, seed) for i in (0.0, 0.01) for seed in eight]
    assert flown(slope_result(dispersion=True)[1]) == dispersed


def test_slopes_shifts_are_listed_for_each_air_and_line() -> None:
    result, _ = slope_result()
    shifts = result.numbers["shifts"]
    assert [(i, [s["line"] for s in each]) for i, each in shifts.items()] == [
        ("0.0", ["a", "b", "c"]),
        ("0.01", ["a", "b", "c"]),
    ]
    for each in shifts["0.01"]:
        assert each["flown_m"] == pytest.approx(0.10)
        assert each["off_m"] == pytest.approx(0.01)
        assert each["error_m"] == pytest.approx(0.001 * sqrt(6.0 / 8.0))
    rows = result.tables[0].rows
    assert [row[:2] for row in rows] == [
        *(("calm", line) for line in "abc"),
        *(("1 %", line) for line in "abc"),
    ]
    predicted = f"{100 * shifts['0.01'][0]['predicted_m']:+.1f}"
    assert rows[3][2:] == (predicted, "+10.0 ± 0.1", "+1.0 ± 0.1", "+8.0")
    assert len(rows[0]) == len(result.tables[0].columns)


def test_slope_lists_six_legs_and_judges_that_all_were_flown() -> None:
    result, _ = slope_result()
    assert [row[:2] for row in result.tables[1].rows] == [
        *(("calm", line) for line in "abccba"),
        *(("1 %", line) for line in "abccba"),
    ]
    assert signs(result.claims) == "✓✓✓"
    assert result.seeds == tuple(range(1, 9))
    short = ScriptedFlyer(lambda job: flight(*slope_flown(job).legs[:5]))
    assert signs(slope(Context(flyer=short)).claims)[2] == "✗"


def test_a_quick_slope_is_judged_by_twice_the_bound() -> None:
    """One flight, known to some millimetres, 3 cm off its own contour's shift."""

    def off(_: ScenarioJob) -> FlownScenario:
        before = [leg(line, dispersion_m=0.001, scored_s=200.0) for line in "abc"]
        after = [
            leg(n, along_m=0.1, own_predicted_along_m=0.07, dispersion_m=0.001, scored_s=200.0)
            for n in "cba"
        ]
        return flight(*before, *after)

    assert signs(slope(Context(flyer=ScriptedFlyer(off), quick=True)).claims)[1] == "✓"
    assert signs(slope(Context(flyer=ScriptedFlyer(off))).claims)[1] == "✗"


def test_slope_names_the_line_that_is_farthest_off_its_shift() -> None:
    off = [slope_shift("a", 0.10, 0.004), slope_shift("b", 0.12, -0.009)]
    for shifts in (off, off[::-1]):
        words = slope_claims(shifts)[1].measured
        assert "at most 0.9 ± 0.4 cm in the mean (b), of one flight there 1.8 cm" in words
    assert "+10.0 ± 0.4 cm at a, +12.0 ± 0.4 cm at b" in words.replace(
        "+12.0 ± 0.4 cm at b, +10.0 ± 0.4 cm at a", "+10.0 ± 0.4 cm at a, +12.0 ± 0.4 cm at b"
    )
    one = slope_shift("a", 0.10, 0.0)._replace(error_m=inf)
    assert "+10.0 ± – cm at a" in slope_claims([one])[1].measured


def test_a_contour_that_does_not_rise_is_no_agreement() -> None:
    same = [slope_shift("a", 0.10, 0.0), slope_shift("b", 0.12, 0.01)]
    assert signs(slope_claims([same[0]._replace(predicted_m=-0.01), same[1]])) == "✗✓"
    assert signs(slope_claims([same[0]._replace(predicted_m=0.0), same[1]])) == "✗✓"


@pytest.mark.parametrize(("off_m", "sign"), [(0.010, "✓"), (0.011, "?"), (0.029, "?"), (0.03, "✗")])
def test_flown_and_predicted_agree_within_two_centimetres(off_m: float, sign: str) -> None:
    """Known to 4 mm: 2.4 of these are 9.6 mm."""
    assert signs(slope_claims([slope_shift("a", 0.1, off_m)]))[1] == sign


# --- wind ---------------------------------------------------------------------------------------

SHIFTS = {"a": 0.04, "b": 0.02, "c": 0.0, "d": -0.02}


def wind_flown(job: ScenarioJob) -> FlownScenario:
    """Each line its shift, in the small step half of it; a lost flight on line b of seed 3."""
    line = job.scenario.first_line
    assert job.scenario.wind is not None
    step_mps = job.scenario.wind.mps[1] - job.scenario.wind.mps[0]
    moved_m = SHIFTS[line] * step_mps + 0.001 * (job.seed - 4.5)
    before = leg(line, dispersion_m=0.01)
    after = leg(line, along_m=moved_m, own_predicted_along_m=moved_m + 0.002)
    time = np.arange(0.0, 80.0 if job.seed < 8 else 75.0, 1.0)
    target = prepare(job.scenario).lines[line].target
    path = {
        "time_s": time,
        "x_m": target.x_m + 0.0 * time,
        "z_m": target.z_m + 0.01 * job.seed + 0.0 * time,
        "wind_mps": 8.0 + 0.1 * job.seed + 0.0 * time,
        "alpha_rad": 0.0 * time,
    }
    ended = "hit the board" if (line, job.seed) == ("b", 3) else ""
    return flight(before, after, seed=job.seed, path=path, ended=ended)


@cache
def wind_result(quick: bool = False) -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(wind_flown)
    return wind(Context(flyer=flyer, quick=quick)), flyer.jobs


def test_wind_is_flown_in_two_steps_in_calm_air_and_in_turbulence() -> None:
    def flown(jobs: list[ScenarioJob]) -> set[tuple[str, float, tuple[float, ...], int]]:
        found = set()
        for job in jobs:
            given = job.scenario
            assert given.turbulence is not None
            assert given.wind is not None
            assert {c.line for c in given.changes} == {given.first_line} == set(given.lines)
            mps = tuple(given.wind.mps)
            found.add((given.first_line, given.turbulence.intensity, mps, job.seed))
        return found

    small, whole = (8.25, 8.75), (8.5, 9.5)
    calm = {(line, 0.0, step, 1) for line in "abcd" for step in (small, whole)}
    gusty = {
        (line, 0.01, step, s) for line in "abcd" for step in (small, whole) for s in range(1, 9)
    }
    assert flown(wind_result()[1]) == calm | gusty
    assert flown(wind_result(quick=True)[1]) == calm


def test_the_lines_stay_where_they_were_placed_in_the_scenarios_wind() -> None:
    placed = prepare(scenario("wind")).lines
    for job in wind_result()[1]:
        (name, spec), = job.scenario.lines.items()  # fmt: skip
        assert (spec.x_m, spec.z_m, spec.speed_ratio) == (*placed[name].target[:2], None)
        assert spec.lean_deg == 20.0


def test_winds_table_goes_by_step_and_then_by_line() -> None:
    rows = wind_result()[0].tables[0].rows
    words = ("8.25 → 8.75, calm", "8.25 → 8.75, 1 %", "8.5 → 9.5, calm", "8.5 → 9.5, 1 %")
    assert [row[:2] for row in rows] == [(each, line) for each in words for line in "abcd"]
    a = wind_result()[0].numbers["shifts"]["a, 8.5 → 9.5, 1 %"]
    names = ("first_order_m", "half_way_m", "predicted_m")
    assert rows[12][2:] == (
        "0.900",
        f"{a['margin']:+.3f}",
        f"{a['margin_half_way']:+.3f}",
        *(f"{100 * a[name]:+.1f}" for name in names),
        f"{100 * (a['predicted_m'] + a['polar_error_m']):+.1f}",
        "+4.0 ± 0.1",
        "-0.2 ± 0.0",
        "0",
    )
    assert rows[13][-1] == "1"  # lost on b


def first_order_at(mps: float) -> float:
    """How far the place of line a moves along it for each m/s, in a wind that is `mps` [m/s]."""
    base = scenario("wind")
    target = prepare(base).lines["a"].target
    still = pinned(msgspec.structs.replace(base, first_line="a", changes=[]), "a", target)
    step = 0.01
    moved = [
        crossing_along(prepare(msgspec.structs.replace(still, wind=held)), "a", 0.0)
        for held in (
            WindSchedule(times_s=[0.0, 1.0], mps=[mps + by, mps + by]) for by in (-step, step)
        )
    ]
    return (moved[1] - moved[0]) / (2.0 * step)


def test_winds_numbers_are_those_of_the_contour_before_half_way_and_after() -> None:
    """The sensitivity by hand: E grows by u · margin / V for each m/s of a wind of V, and the place
    by that over the slope of excess updraft along the line."""
    result = wind_result()[0].numbers["shifts"]
    base = scenario("wind")
    placed = prepare(base).lines
    assert len(result) == 16
    for line, sign in (("a", 1.0), ("d", -1.0)):
        found = result[f"{line}, 8.5 → 9.5, 1 %"]
        assert np.sign(found["margin"]) == sign
        assert found["speed_ratio"] == pytest.approx({"a": 0.9, "d": 1.012}[line], abs=0.002)
        target = placed[line].target
        still = pinned(msgspec.structs.replace(base, first_line=line, changes=[]), line, target)
        moved: dict[float, float] = {}
        for mps in (8.5, 9.0, 9.5):
            held = WindSchedule(times_s=[0.0, 1.0], mps=[mps, mps])
            prepared = prepare(msgspec.structs.replace(still, wind=held))
            at = prepared.lines[line].crossing
            assert at is not None
            moved[mps] = crossing_along(prepared, line, 0.0)
            u = at.wind_mps
            margin = polar_sink(prepared.polar, u) / u - polar_slope(prepared.polar, u)
            gx, gz = excess_gradient(prepared.field, prepared.polar, at.x_m, at.z_m)
            steep = gx * cos(target.eta_rad) + gz * sin(target.eta_rad)
            per_mps = -u * margin / mps / steep
            if mps == 8.5:
                assert found["margin"] == pytest.approx(margin, rel=1e-4)
                assert found["first_order_m"] == pytest.approx(per_mps, rel=1e-3)
                bias = polar_bias_m(prepared, at)
            elif mps == 9.0:
                assert found["margin_half_way"] == pytest.approx(margin, rel=1e-3, abs=1e-5)
                assert found["half_way_m"] == pytest.approx(per_mps, rel=1e-3, abs=1e-5)
            else:
                assert found["polar_error_m"] == pytest.approx(
                    polar_bias_m(prepared, at) - bias, abs=1e-6
                )
        assert found["predicted_m"] == pytest.approx(moved[9.5] - moved[8.5], abs=1e-4)
    small, whole = (result[f"a, {step}, calm"] for step in ("8.25 → 8.75", "8.5 → 9.5"))
    assert small["half_way_m"] == pytest.approx(0.5 * whole["first_order_m"], rel=1e-3)
    assert small["first_order_m"] == pytest.approx(0.5 * first_order_at(8.25), rel=5e-3)
    assert wind_result()[0].numbers["best_glide_mps"] == pytest.approx(
        prepare(base).lines["c"].crossing.wind_mps, abs=0.02  # type: ignore[union-attr]
    )  # fmt: skip


def test_the_dispersion_that_wind_is_held_against_is_the_lesser_of_two() -> None:
    shifts = wind_result()[0].numbers["shifts"]
    # Before the wind rises each flight shows 1 cm about its own place, at which all of them are.
    assert shifts["a, 8.5 → 9.5, 1 %"]["dispersion_m"] == pytest.approx(0.01)
    assert shifts["a, 8.5 → 9.5, calm"]["dispersion_m"] == 0.0
    wide = ScriptedFlyer(lambda job: flight(*(leg(job.scenario.first_line, dispersion_m=9.0),) * 2))
    formula = wind(Context(flyer=wide)).numbers["shifts"]["a, 8.5 → 9.5, 1 %"]["dispersion_m"]
    assert 0.01 < formula < 0.1
    nobody = ScriptedFlyer(lambda job: flight(leg(job.scenario.first_line), ended="hit the board"))
    alone = wind(Context(flyer=nobody)).numbers["shifts"]["a, 8.5 → 9.5, 1 %"]
    assert alone["dispersion_m"] == pytest.approx(formula)
    assert alone["lost"] == 8


def test_wind_is_judged_at_one_per_cent_and_a_quick_one_in_calm_air() -> None:
    result, _ = wind_result()
    assert signs(result.claims) == "✗✗✗✗"  # b lost a flight
    assert [each.claim for each in result.changed] == [
        "rises, stays, falls",
        "wind hardly moves the hovering point",
        "the place moves as TGL ∩ ZEUC does",
    ]
    assert "+4.0 ± 0.1 cm at a, +2.0 ± 0.1 cm at b (1 flights lost)" in result.claims[1].measured
    assert "+2.0 ± 0.1 cm at a, +1.0 ± 0.1 cm at b" in result.claims[0].measured
    assert result.claims[2].measured.endswith("2 flights lost")
    assert result.claims[3].measured.endswith("1 flights lost")
    quick = wind_result(quick=True)[0].claims
    assert "+3.6 ± " in quick[1].measured  # seed 1 is 3.5 mm short of 4 cm
    assert "+1.7 ± " in quick[0].measured


def test_winds_reasons_are_of_calm_air() -> None:
    """In the whole step: what its own glides leave of calm air's shift."""
    shifts = wind_result()[0].numbers["shifts"]
    calm = {key: s for key, s in shifts.items() if "calm" in key}
    off = {
        key: abs(s["flown_m"] - s["predicted_m"] - s["polar_error_m"]) for key, s in calm.items()
    }
    whole = [s for key, s in calm.items() if "8.5 → 9.5" in key]
    first = max(abs(s["first_order_m"] - s["predicted_m"]) for s in whole)
    assert f"shift of the contour by up to {100 * first:.1f} cm" in wind_result()[0].why
    assert f"agree within {100 * max(off.values()):.1f} cm" in wind_result()[0].why


@pytest.mark.parametrize(("half_way_m", "finite"), [(0.081, True), (0.079, False)])
def test_half_way_is_the_better_guess_where_it_misses_less_than_half(
    half_way_m: float, finite: bool
) -> None:
    """Predicted 10 cm: from before by 6 cm, so 4 cm off; 2 cm are half of that."""
    one = shift("a", 0.10)._replace(first_order_m=0.06, half_way_m=half_way_m)
    words = wind_why([shift("b", 0.01)._replace(first_order_m=0.01, half_way_m=0.01), one], [one])
    assert "up to 4.0 cm; taken" in words
    assert f"up to {abs(100 * (half_way_m - 0.1)):.1f} cm. " in words
    assert ("as much slower before as it is faster after" in words) is finite
    assert ("Neither is the shift of a finite step" in words) is not finite


def test_what_calm_air_leaves_takes_off_what_the_cubic_is_wrong_by() -> None:
    one = shift("a", 0.10, 0.07)._replace(polar_error_m=0.02, worst_glide_m=-0.004)
    other = shift("d", -0.03, -0.025)
    for calm in ([one, other], [other, one]):
        assert "agree within 1.0 cm in calm air, in both steps (worst at a)" in wind_why(calm, calm)
        assert "agree within 0.5 cm in calm air, in both steps (worst at d)" in wind_why(
            calm, calm, dispersed=True
        )
    nowhere = shift("b", 0.1, nan)
    assert "(worst at b)" in wind_why([one], [one, nowhere, other])


@pytest.mark.parametrize(("moved_m", "sign"), [(0.0110, "✓"), (0.0125, "?"), (0.0165, "✗")])
def test_a_place_at_best_glide_stays_within_a_centimetre_and_a_half(
    moved_m: float, sign: str
) -> None:
    """STAYS_M is 1.4 cm; known to 1 mm, 2.4 of which are 2.4 mm."""
    small = [shift("a", 0.05), shift("b", 0.03), shift("c", moved_m), shift("d", -0.02)]
    assert signs(wind_claims(small, small))[0] == sign


def test_each_place_has_its_sign() -> None:
    whole = [shift("a", 0.05), shift("b", 0.05), shift("c", 0.0), shift("d", -0.03)]
    assert signs(wind_claims(whole, whole))[0] == "✓"
    for i, other in ((0, -0.05), (1, -0.05), (3, 0.03)):
        turned = [s._replace(flown_m=other) if j == i else s for j, s in enumerate(whole)]
        assert signs(wind_claims(turned, whole))[0] == "✗"


def test_wind_names_what_moved_by_the_most_standard_deviations() -> None:
    """Half a centimetre of two millimetres is more than two centimetres of three."""
    whole = [
        shift("a", 0.05),
        shift("b", 0.02),
        shift("c", 0.006)._replace(dispersion_m=0.002),
        shift("d", -0.03),
    ]
    words = wind_claims(whole, whole)[3].measured
    assert "by at most 0.6 ± 0.1 cm (at c), 3.0 standard deviations; 0 flights lost" in words
    fallen = [*whole[:2], shift("c", 0.0), shift("d", -0.055)]
    assert "by at most 5.5 ± 0.1 cm (at d), 1.8 " in wind_claims(whole, fallen)[3].measured
    calm = [*whole[:3], whole[3]._replace(dispersion_m=0.0)]
    assert "(at d), inf standard deviations" in wind_claims(whole, calm)[3].measured


def test_winds_third_claim_names_the_place_that_is_farthest_off() -> None:
    whole = [shift("a", 0.05), shift("b", 0.05, 0.065), shift("c", 0.0), shift("d", -0.03)]
    words = wind_claims(whole[:1] * 4, whole)[2].measured
    assert "at most 1.5 ± 0.1 cm in the mean (b), of one flight there 1.5 cm" in words
    nowhere = [*whole[:3], shift("d", -0.03, nan)]
    assert "(d)" in wind_claims(nowhere, whole)[2].measured


# --- figures ------------------------------------------------------------------------------------


def test_winds_figure_shows_centimetres_from_the_place_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(flight_figures, "flight_figure", lambda *given: drawn.append(given))
    result = wind(Context(flyer=ScriptedFlyer(wind_flown), figures=tmp_path))
    assert result.figures == ("wind.png",)
    (path, air, lines, x, z, panels, _, spans), = drawn  # fmt: skip
    assert len(x) == len(z) == 0  # no one flight is drawn
    assert path == tmp_path / "wind.png"
    assert air.later_label == "ZEUC at 9.5 m/s"
    assert [line.name for line in lines] == ["a", "b", "c", "d"]
    heights, winds = panels
    assert "mean of 8 flights" in heights.label
    placed = prepare(scenario("wind")).lines["a"]
    assert placed.crossing is not None
    tan = sin(placed.target.eta_rad)
    base = crossing_along(prepare(scenario("wind")), "a", 0.0)
    # All are 4.5 cm above the line's point in the mean.
    flown, dashed = heights.traces[:2]
    np.testing.assert_allclose(flown.y, 100 * (0.045 * tan - base), atol=0.02)
    assert flown.time_s[0] == 6.0  # from five seconds on
    shifts = result.numbers["shifts"]["a, 8.5 → 9.5, 1 %"]
    np.testing.assert_allclose(dashed.y, 100 * shifts["predicted_m"])
    assert dashed.time_s.tolist() == [40.0, 74.0]  # as far as all have flown
    np.testing.assert_allclose(winds.traces[0].y, 8.45)
    assert spans.items == [(30.0, 40.0, "wind rises")]

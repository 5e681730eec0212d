"""Lines held still: what is flown, what a leg's figures come to of several flights, and each claim
and note on both sides of its bound."""

from __future__ import annotations

from functools import cache
from math import degrees, inf, isnan, nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from by_hand import ScriptedFlyer, flight, leg, signs
from test_still_lines import leg as summary

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper import still_lines
from tgl_soar.analysis.experiments.paper.still_lines import (
    LegSummary,
    MissOfFlight,
    apart_note,
    back,
    bias_note,
    dispersion_note,
    flown_lines,
    known_place_note,
    leg_by_line,
    leg_rows,
    place_claim,
    polar_bias_m,
    pooled_or_nan,
    rotate,
    settled_claim,
    stall_words,
    static,
    summarise,
    translate,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import PreparedScenario, prepare, slide_at
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion
from tgl_soar.sim.world import flown_aircraft
from tgl_soar.types import polar_sink


@cache
def prepared(name: str = "static") -> PreparedScenario:
    return prepare(Context(flyer=ScriptedFlyer(lambda _: None)).scenario(name))


# --- one leg of several flights -----------------------------------------------------------------


def flown(*legs: Any, alpha_rad: tuple[float, ...] = (0.0, 0.0), **more: Any) -> FlownScenario:
    return flight(*legs, path={"alpha_rad": np.array(alpha_rad)}, **more)


def test_a_summary_is_of_all_flights_of_its_leg() -> None:
    one = flown(
        leg(
            settling_s=1.0, rms_e_rho_m=0.03, peak_e_rho_m=0.05, rms_y_m=0.1, rms_bank_rad=0.07,
            along_m=0.02, own_predicted_along_m=0.05, own_glide_along_m=0.01, mean_x_m=1.0,
            mean_z_m=2.0, dispersion_m=0.03,
        )
    )  # fmt: skip
    other = flown(
        leg(
            settling_s=3.0, rms_e_rho_m=0.01, peak_e_rho_m=0.01, rms_y_m=0.7, rms_bank_rad=0.01,
            along_m=-0.04, own_predicted_along_m=-0.05, own_glide_along_m=-0.06, mean_x_m=2.0,
            mean_z_m=4.0, dispersion_m=0.04,
        )
    )  # fmt: skip
    third = flown(leg(peak_e_rho_m=0.02, along_m=0.02, mean_x_m=0.0, mean_z_m=0.0))
    (found,) = summarise(prepared(), [one, other])
    assert (found.line, found.flights, found.settling_s) == ("a", 2, 3.0)
    assert found.rms_e_rho_m == pytest.approx(sqrt(5e-4))
    assert found.peak_e_rho_m == pytest.approx(0.03)
    assert found.rms_y_m == pytest.approx(0.5)
    assert found.rms_bank_rad == pytest.approx(0.05)
    assert found.miss_m == pytest.approx(-0.01)
    assert found.miss_error_m == pytest.approx(0.03)  # half of 6 cm
    assert found.apart_m == pytest.approx(0.06 / sqrt(2.0))
    assert found.own_miss_m == pytest.approx(-0.01)  # of −3 and +1 cm
    assert found.own_error_m == pytest.approx(0.02)
    assert found.worst_glide_m == pytest.approx(0.02)
    assert (found.mean_x_m, found.mean_z_m) == pytest.approx((1.5, 3.0))
    # Of each about its own place, and these about their mean: 2 cm to either side.
    assert found.dispersion_m == pytest.approx(sqrt((9 + 16) / 2.0 + 4.0) / 100.0)
    (of_three,) = summarise(prepared(), [one, other, third])
    assert of_three.peak_e_rho_m == pytest.approx(0.02)  # the one in the middle
    assert of_three.mean_x_m == pytest.approx(1.0)


def test_a_flights_mean_is_known_by_its_dispersion_and_its_slide() -> None:
    """One independent value every two time constants; the formula's dispersion at the least."""
    line = prepared().lines["a"]
    assert line.crossing is not None
    slide = slide_at(prepared().polar, line.target, line.crossing)
    air = prepared().site.air
    assert air is not None
    wind = prepared().field.reference_wind_mps
    formula = dryden_dispersion(slide, 0.01 * wind, air.turbulence.length_scale_m / wind)
    (found,) = summarise(prepared(), [flown(leg(dispersion_m=0.5, scored_s=40.0, along_m=0.02))])
    error = 0.5 / sqrt(40.0 * slide.rate_per_s / 2.0)
    assert found.known_to_m == pytest.approx(error)
    assert found.miss_error_m == found.own_error_m == pytest.approx(error)
    assert found.worst_own == found.worst_file
    assert found.worst_own == pytest.approx(MissOfFlight(0.02, error))
    assert found.dispersion_formula_m == pytest.approx(formula)
    (steady,) = summarise(prepared(), [flown(leg(dispersion_m=0.0, scored_s=0.1))])
    assert steady.known_to_m == pytest.approx(formula)  # and no better than by one value
    (least,) = summarise(
        prepared(), [flown(leg(dispersion_m=d, scored_s=40.0)) for d in (0.5, 0.1)]
    )
    assert least.known_to_m == pytest.approx(error)


def test_in_calm_air_the_formula_is_nothing() -> None:
    calm = prepare(with_turbulence(prepared().scenario, 0.0))
    (found,) = summarise(calm, [flown(leg())])
    assert found.dispersion_formula_m == 0.0


def test_legs_go_by_their_order_and_time_beyond_the_stall_by_flights() -> None:
    stall = prepared().airframe.model["stall_alpha_rad"]
    over, under = stall + 0.01, stall - 0.01
    legs = [leg(settling_s=s) for s in (1.0, 2.0, 3.0)]
    flights = [flown(*legs, alpha_rad=(over, under)), flown(*legs[:2], alpha_rad=(under, under))]
    found = summarise(prepared(), flights)
    assert [(each.settling_s, each.flights) for each in found] == [(1.0, 2), (2.0, 2), (3.0, 1)]
    assert {each.stalled_fraction for each in found} == {0.25}
    assert summarise(prepared(), [flown()]) == []


def test_the_farthest_flight_is_that_which_is_off_for_certain() -> None:
    assert MissOfFlight(0.05, 0.01).beyond_m == pytest.approx(0.02)
    assert MissOfFlight(-0.05, 0.01).beyond_m == pytest.approx(0.02)
    assert MissOfFlight(0.02, 0.01).beyond_m == 0.0
    assert MissOfFlight(nan, 0.01).beyond_m == inf
    vague = leg(along_m=0.06, dispersion_m=0.5, scored_s=10.0)
    certain = leg(along_m=-0.05, dispersion_m=0.0, scored_s=1000.0)
    (found,) = summarise(prepared(), [flown(vague), flown(certain)])
    assert found.worst_own.miss_m == found.worst_file.miss_m == -0.05
    # Where none is off for certain it is the farthest.
    weak = [leg(along_m=m, dispersion_m=0.5, scored_s=1.0) for m in (0.01, -0.03, 0.02)]
    (found,) = summarise(prepared(), [flown(each) for each in weak])
    assert found.worst_own.miss_m == -0.03
    own = leg(along_m=0.06, own_predicted_along_m=0.06, dispersion_m=0.0, scored_s=1000.0)
    (found,) = summarise(prepared(), [flown(own), flown(certain)])
    assert found.worst_own.miss_m == -0.05
    assert found.worst_file.miss_m == 0.06


def test_a_leg_is_reported_in_centimetres_and_degrees() -> None:
    one = summary(0.012)._replace(
        settling_s=2.34, rms_e_rho_m=0.0056, peak_e_rho_m=0.023, rms_y_m=0.123, rms_bank_rad=0.05,
        miss_error_m=0.003, own_miss_m=-0.021, own_error_m=0.004, apart_m=0.011,
        dispersion_m=0.034, dispersion_formula_m=0.045,
    )  # fmt: skip
    flights = [flown(), flown(ended="hit the board")]
    (row,) = leg_rows(0.01, flights, [one])
    assert row == (
        "1 %", "a", "1 of 2", "2.3", "0.56", "2.3", "12.3", f"{degrees(0.05):.1f}", "+1.2 ± 0.3",
        "-2.1 ± 0.4", "1.1", "3.4", "4.5",
    )  # fmt: skip
    ((*_, apart, _, formula),) = leg_rows(0.0, flights, [one._replace(flights=1)])
    assert (apart, formula) == ("–", "–")
    assert leg_rows(0.0, flights, [one])[0][0] == "calm"
    assert leg_rows(0.0, flights, [one._replace(flights=2)])[0][-3] == "1.1"


# --- claims -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one_m", "error_m", "sign"),
    [
        (0.0, 0.0149, "✓"),
        (0.0, 0.0151, "?"),
        (0.0749, 0.0151, "?"),  # three errors may be chance
        (0.0749, 0.0149, "✗"),  # 7.5 less 4.5 is more than 3 cm
        (0.0739, 0.0149, "✓"),
        (nan, 0.001, "✗"),
    ],
)
def test_each_flight_is_within_three_centimetres_for_all_that_is_known(
    one_m: float, error_m: float, sign: str
) -> None:
    several = [summary(0.0, one_m=0.0, one_error_m=0.001), summary(0.0, one_m=one_m,
               one_error_m=error_m)]  # fmt: skip
    assert signs([place_claim(several)]) == sign


def test_twice_the_bound_is_twice_as_wide() -> None:
    several = [summary(0.05, one_m=0.05, one_error_m=0.02)]
    assert signs([place_claim(several)]) == "✗"
    assert signs([place_claim(several, 0.06)]) == "✓"


def test_claims_name_the_worst_line_and_the_worst_flight() -> None:
    a = summary(0.01, one_m=-0.02)._replace(line="a", apart_m=0.02)
    b = summary(-0.02, one_m=0.01)._replace(line="b", apart_m=0.04)
    for several in ([a, b], [b, a]):
        words = place_claim(several).measured
        assert words.startswith("mean place at most 2.0 ± 0.2 cm from the crossing")
        assert "(line b); of one flight at most 2.0 ± 0.6 cm" in words
        known = known_place_note(several)
        assert "at most 2.0 ± 0.6 cm away (line a" in known
        assert "4.0 cm apart" in known
    assert place_claim([]).measured == "no leg was flown"


def test_settling_is_within_five_seconds_or_what_is_asked() -> None:
    both = [flown(leg(), leg())]
    for settling_s, holds in ((5.0, True), (5.01, False)):
        assert settled_claim(both, [summary(settling_s=settling_s)], 2).holds is holds
    assert settled_claim(both, [summary(settling_s=6.0)], 2, 6.5).holds
    assert not settled_claim(both, [], 2).holds  # nothing was scored
    assert not settled_claim(both, [summary()], 1).holds
    words = settled_claim([*both, flown(leg(), ended="hit")], [summary(settling_s=2.5)], 2)
    assert words.measured.startswith("1 of 2 flights to the end")
    assert "after at most 2.5 s" in words.measured


# --- notes --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ratio", "much"), [(1.14, False), (1.16, True)])
def test_a_dispersion_follows_its_formula_within_fifteen_per_cent(ratio: float, much: bool) -> None:
    one = summary()._replace(dispersion_m=0.04 * ratio, dispersion_formula_m=0.04)
    other = summary()._replace(dispersion_m=0.02, dispersion_formula_m=0.04)
    words = dispersion_note({0.01: [other], 0.03: [one]})
    assert f"is 0.50 to {ratio:.2f} times what" in words
    assert f"is {ratio:.2f} times what" in dispersion_note({0.03: [one]})
    assert ("Most of all at 3 % of turbulence on line a" in words) is much
    assert "apart" not in words
    assert dispersion_note({0.0: [summary()._replace(dispersion_formula_m=0.0)]}) == ""


def test_the_largest_ratio_is_named_whatever_its_turbulence() -> None:
    much = summary()._replace(dispersion_m=0.08, dispersion_formula_m=0.04)
    less = summary()._replace(dispersion_m=0.05, dispersion_formula_m=0.04)
    assert "Most of all at 1 % of" in dispersion_note({0.01: [much], 0.03: [less]})
    assert "Most of all at 3 % of" in dispersion_note({0.01: [less], 0.03: [much]})


def test_the_note_says_on_which_side_of_the_crossing_it_is() -> None:
    much = summary()._replace(dispersion_m=0.06, own_miss_m=-0.07)
    assert "the mean place 7 cm below the crossing" in dispersion_note({0.01: [much]})
    above = much._replace(own_miss_m=0.07)
    assert "the mean place 7 cm above the crossing" in dispersion_note({0.01: [above]})
    assert "6.0 cm for 3.0," in dispersion_note({0.01: [above]})


@pytest.mark.parametrize(("fraction", "stalled"), [(0.0099, False), (0.0101, True)])
def test_a_stall_is_a_reason_from_one_per_cent_of_the_time_on(
    fraction: float, stalled: bool
) -> None:
    assert ("gusts took the wing beyond" in stall_words(fraction)) is stalled
    assert "1.0 % of the time" in stall_words(fraction)
    assert stall_words(fraction, stalls=False).startswith(" A point mass has no stall")


def test_what_sets_aircraft_apart_is_reported_of_calm_air_and_several_flights() -> None:
    calm = summary()._replace(dispersion_formula_m=0.0, apart_m=0.05, worst_glide_m=-0.004)
    other = calm._replace(line="b", apart_m=0.08, worst_glide_m=0.002)
    for several in ([calm, other], [other, calm]):
        words = apart_note([*several, summary()._replace(apart_m=0.9)])
        assert "differs by 8.0 cm (standard deviation, calm air, line b)" in words
        assert "0.4 cm from there at most" in words
    assert apart_note([calm._replace(flights=1)]) == ""
    assert apart_note([calm._replace(flights=2)]) != ""
    assert apart_note([summary()]) == ""


def test_the_cubic_puts_a_place_below_the_aircrafts_own() -> None:
    """Where it sinks more: by the difference of sinks over the slope of excess updraft."""
    at = prepared().lines["a"].crossing
    assert at is not None
    assert at.excess_slope_per_s < 0.0
    cubic = polar_sink(prepared().polar, at.wind_mps)
    own = flown_aircraft(prepared().airframe).glide_at(at.wind_mps).sink_mps
    expected = (cubic - own) / abs(at.excess_slope_per_s)
    assert polar_bias_m(prepared(), at) == pytest.approx(expected)
    assert abs(expected) > 1e-4
    assert f"by {100 * expected:+.1f} cm at a." in bias_note(prepared(), ["a"])
    nowhere = prepared()._replace(lines={"a": prepared().lines["a"]._replace(crossing=None)})
    assert "cm at a" not in bias_note(nowhere, ["a"])


def test_legs_on_a_line_are_found_by_their_number() -> None:
    several = [flown(leg("a", along_m=1.0), leg("b"), leg("a", along_m=2.0)), flown(leg("a"))]
    assert [each.along_m for each in leg_by_line(several, "a", 0)] == [1.0, 0.0]
    assert [each.along_m for each in leg_by_line(several, "a", 1)] == [2.0]
    assert leg_by_line(several, "a", 2) == []
    assert isnan(pooled_or_nan([]))
    assert pooled_or_nan([leg(dispersion_m=0.02)]) == pytest.approx(0.02)


# --- the experiments ----------------------------------------------------------------------------


def answer(job: ScenarioJob) -> FlownScenario:
    """A good flight on all its lines: each leg a centimetre up, its mean where [upright] is, on
    [leaning] a decimetre upstream."""
    legs = [
        leg(
            line,
            begin_s=30.0 * k,
            end_s=30.0 * k + 25.0,
            along_m=0.01,
            dispersion_m=0.01,
            scored_s=20.0,
            mean_x_m=1.0 - 0.1 * (line == "leaning"),
            predicted=(1.0, 1.5),
        )
        for k, line in enumerate(order(job))
    ]
    time = np.arange(0.0, 20.0, 0.5)
    path = {
        "time_s": time,
        "pitch_setpoint_rad": np.where(time < 1.9, np.nan, 0.1),
        **{
            name: 0.0 * time + value
            for name, value in (
                ("x_m", 1.0), ("z_m", 1.5), ("e_rho_m", 0.02), ("pitch_rad", 0.2),
                ("alpha_rad", 0.1), ("wind_mps", 8.0), ("airspeed_mps", 8.4),
            )
        },
    }  # fmt: skip
    return flight(*legs, seed=job.seed, path=path)


def order(job: ScenarioJob) -> list[str]:
    given = job.scenario
    return [given.first_line, *(c.line for c in given.changes if c.line is not None)]


@cache
def concluded(experiment: Any, quick: bool = False) -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(answer)
    return experiment(Context(flyer=flyer, quick=quick)), flyer.jobs


@pytest.mark.parametrize(
    ("experiment", "lines", "intensities"),
    [
        (static, "a", (0.0, 0.01, 0.03, 0.05)),
        (translate, "abc", (0.0, 0.01, 0.03)),
        (back, "cba", (0.0, 0.01, 0.03)),
        (rotate, ("upright", "leaning", "upright"), (0.0, 0.01, 0.03)),
    ],
)
def test_each_is_flown_in_calm_air_once_and_in_turbulence_with_every_seed(
    experiment: Any, lines: tuple[str, ...], intensities: tuple[float, ...]
) -> None:
    result, jobs = concluded(experiment)
    flights = [(j.scenario.turbulence.intensity, j.seed) for j in jobs if j.scenario.turbulence]
    assert flights == [
        (i, seed) for i in intensities for seed in ((1,) if i == 0.0 else range(1, 9))
    ]
    assert all(order(job) == list(lines) for job in jobs)
    rows = result.tables[0].rows
    assert [row[:2] for row in rows] == [
        ("calm" if i == 0.0 else f"{100 * i:g} %", line) for i in intensities for line in lines
    ]
    assert {len(row) for row in rows} == {len(result.tables[0].columns)}
    assert set(signs(result.claims)) == {"✓"}
    assert list(result.numbers["legs"]) == [str(i) for i in intensities]
    assert result.numbers["survived"]["0.01"] == [8, 8]
    assert result.numbers["ended"] == []
    assert result.numbers["judged_at_turbulence"] == 0.01
    assert [each.claim for each in result.changed] == [
        "it settles where the line meets the contour",
        "of dispersed aircraft: each flight settles where the files' own contour is",
    ]
    (quick,) = {j.scenario.turbulence for j in concluded(experiment, quick=True)[1]}
    assert quick is not None
    assert quick.intensity == 0.01


def test_the_lines_that_are_flown_are_reported_once_each() -> None:
    assert flown_lines(prepared("rotate").scenario) == ["upright", "leaning"]
    assert flown_lines(prepared("translate").scenario) == ["a", "b", "c"]
    numbers = concluded(rotate)[0].numbers["lines"]
    assert numbers["upright"]["lean_deg"] == pytest.approx(12.0)
    assert numbers["leaning"]["lean_deg"] == pytest.approx(35.0)
    line = prepared("rotate").lines["leaning"]
    assert line.crossing is not None
    rate = slide_at(prepared("rotate").polar, line.target, line.crossing).rate_per_s
    assert numbers["leaning"]["rate_per_s"] == pytest.approx(rate)
    assert numbers["leaning"]["x_m"] == line.target.x_m


def test_an_experiment_without_a_leg_too_few_does_not_agree() -> None:
    def short(job: ScenarioJob) -> FlownScenario:
        return flight(*answer(job).legs[:2], path=answer(job).path)

    assert signs(translate(Context(flyer=ScriptedFlyer(short))).claims) == "✗✓"
    assert len(rotate(Context(flyer=ScriptedFlyer(short))).claims) == 2  # it was not turned back


def test_a_quick_one_is_judged_by_twice_the_bound() -> None:
    def off(job: ScenarioJob) -> FlownScenario:
        legs = [leg(n, along_m=0.05, dispersion_m=0.0, scored_s=500.0) for n in order(job)]
        return flight(*legs, path=answer(job).path)

    assert signs(static(Context(flyer=ScriptedFlyer(off), quick=True)).claims) == "✓✓"
    assert signs(static(Context(flyer=ScriptedFlyer(off))).claims) == "✓✗"


def test_how_far_off_the_files_contour_is_from_dispersed_aircraft_is_reported_and_no_claim() -> (
    None
):
    flyer = ScriptedFlyer(answer)
    result = static(Context(flyer=flyer, dispersion=True))
    assert len(result.claims) == 2
    assert "with the files' own contour a flight settles at most" in result.why
    assert "the files' own contour" not in concluded(static)[0].why
    assert "fitted cubic polar" not in result.why
    assert len([job for job in flyer.jobs if job.dispersed]) == 32
    assert "fitted cubic polar" in concluded(static)[0].why


@pytest.mark.parametrize(
    ("there_m", "back_m", "holds"),
    [(-0.1, 0.049, True), (-0.1, -0.051, False), (0.1, 0.0, False), (0.0, 0.0, False)],
)
def test_turning_back_leaves_less_than_half_of_the_way(
    there_m: float, back_m: float, holds: bool
) -> None:
    def turned(job: ScenarioJob) -> FlownScenario:
        places = (1.0, 1.0 + there_m, 1.0 + back_m)
        legs = [
            leg(n, mean_x_m=x_m, mean_z_m=2.0 + 3.0 * (x_m - 1.0), dispersion_m=0.01)
            for n, x_m in zip(order(job), places, strict=True)
        ]
        return flight(*legs, path=answer(job).path)

    claim = rotate(Context(flyer=ScriptedFlyer(turned), quick=True)).claims[-1]
    assert claim.holds is holds
    assert f"moved it by {100 * there_m:+.1f} cm downstream and {300 * there_m:+.1f} cm up" in (
        claim.measured
    )
    assert f"left {100 * sqrt(10.0) * abs(back_m):.1f} cm" in claim.measured
    lines = prepared("rotate").lines
    leaning, upright = lines["leaning"].crossing, lines["upright"].crossing
    assert leaning is not None
    assert upright is not None
    assert f"(crossings: {100 * (leaning.x_m - upright.x_m):+.1f} and" in claim.measured


def test_the_figure_shows_what_was_active_in_centimetres_and_degrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(still_lines, "flight_figure", lambda *given: drawn.append(given))
    result = translate(Context(flyer=ScriptedFlyer(answer), figures=tmp_path))
    assert result.figures == ("translate.png",)
    ((path, _, lines, x, z, panels, title, spans),) = drawn
    assert path == tmp_path / "translate.png"
    assert [line.name for line in lines] == ["a", "b", "c"]
    assert title.endswith("turbulence 1 %")
    assert len(x) == len(z) == 36  # from two seconds on
    off, height, pitch, speed = panels
    np.testing.assert_allclose(off.traces[0].y, 2.0)
    np.testing.assert_allclose(height.traces[0].y, 1.5)
    assert [trace.label for trace in height.traces] == ["flown", "TGL ∩ ZEUC", None, None]
    assert height.traces[2].time_s.tolist() == [30.0, 55.0]
    assert height.traces[2].y.tolist() == [1.5, 1.5]
    np.testing.assert_allclose(pitch.traces[0].y, degrees(0.1))
    np.testing.assert_allclose(pitch.traces[1].y, degrees(0.2))
    np.testing.assert_allclose(speed.traces[0].y, 8.0)
    np.testing.assert_allclose(speed.traces[1].y, 8.4)
    assert spans.items == [(0.0, 25.0, "a"), (30.0, 55.0, "b"), (60.0, 85.0, "c")]


def test_a_summary_without_a_contour_of_its_own_is_off_for_certain() -> None:
    (found,) = summarise(prepared(), [flown(leg(own_predicted_along_m=nan))])
    assert isinstance(found, LegSummary)
    assert isnan(found.own_miss_m)
    assert signs([place_claim([found])]) == "✗"

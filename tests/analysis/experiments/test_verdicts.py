"""What an experiment concludes from numbers: the logic, apart from any flight."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from math import hypot, inf, nan, radians
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments import catalogue
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    Flyer,
    ScoredLeg,
    mean_of_flights,
    rms_error,
)
from tgl_soar.analysis.experiments.pages import (
    DISPERSED_WORDS,
    counted,
    page,
    pages,
    with_result,
)
from tgl_soar.analysis.experiments.paper.air_speed import (
    SpeedScore,
    growth,
    rings,
    score_speed,
    speed_claims,
    speed_why,
)
from tgl_soar.analysis.experiments.paper.changing_air import (
    Shift,
    WindShift,
    slope_claims,
    wind_claims,
    wind_why,
)
from tgl_soar.analysis.experiments.paper.field import (
    POLAR,
    RADIUS_M,
    WIND_MPS,
    claims_of,
    positions,
)
from tgl_soar.analysis.experiments.paper.gust_response import WindEffect, sensitivity_claims
from tgl_soar.analysis.experiments.paper.line_lean import (
    HELD_M,
    ONE_SET,
    SCHEDULED,
    LeanScore,
    along_words,
    downwind_words,
    lean_claims,
    lean_why,
    refusal,
)
from tgl_soar.analysis.experiments.paper.still_lines import (
    MISS_MOST_M,
    LegSummary,
    MissOfFlight,
    dispersion_note,
    known_place_claim,
    place_claim,
    settled_claim,
)
from tgl_soar.analysis.experiments.result import (
    DISPERSED_AIRCRAFT,
    POINT_MASS,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    all_of,
    as_json,
    as_markdown,
    decided,
    plain,
)
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.types import polar_sink

YES, NO = Claim("it does", True, "1 cm"), Claim("it does not", False, "2 cm")


def result(*claims: Claim) -> Result:
    table = Table("one", ("a", "b [m]"), (("x", "1"),))
    return Result(
        name="name",
        title="title",
        flown="flown.",
        claims=claims,
        why="because.",
        tables=(table,),
        numbers={"n": 1.0},
        figures=("f.png",),
    )


@pytest.mark.parametrize(
    ("claims", "verdict"),
    [((YES, YES), "agrees"), ((YES, NO), "agrees in part"), ((NO, NO), "differs")],
)
def test_the_verdict_follows_from_the_claims(claims: tuple[Claim, ...], verdict: str) -> None:
    assert result(*claims).verdict == verdict


def test_flights_that_ended_badly_are_folded_model_by_model() -> None:
    """The empty lines are what GitHub and Sphinx read a list within HTML by."""
    far = replace(result(YES), badly=("landing 1: far",))
    many = replace(result(NO), badly=("landing 2: far", "lull 3: hard"))
    both = replace(far, also={DISPERSED_AIRCRAFT: many})
    lines = as_markdown(both, "images").splitlines()
    ends = lines.index("</details>") + 1
    assert lines[ends - 6 : ends] == [
        "<details>",
        "<summary>Rigid body: 1 flight that did not end well</summary>",
        "",
        "- landing 1: far",
        "",
        "</details>",
    ]
    assert lines[ends:] == [
        "",
        "<details>",
        "<summary>Rigid body, dispersed: 2 flights that did not end well</summary>",
        "",
        "- landing 2: far",
        "- lull 3: hard",
        "",
        "</details>",
    ]
    assert lines[ends - 7] == ""
    assert "<details>" not in as_markdown(result(YES), "images")
    assert as_json(both)["also"][DISPERSED_AIRCRAFT]["badly"] == ["landing 2: far", "lull 3: hard"]


def test_a_result_tells_everything_in_json_and_markdown() -> None:
    reported = as_json(result(YES, NO))
    assert json.loads(json.dumps(reported)) == reported
    assert reported["versions"]["tgl_soar"]
    text = as_markdown(result(YES, NO), "images")
    for words in (
        "| a | b [m] |",
        "| x | 1 |",
        "images/f.png",
        "agrees in part",
        "✓",
        "✗",
        "because",
    ):
        assert words in text
    whole = page([result(YES, NO)], {})
    assert as_markdown(result(YES, NO), "images/experiments") in whole
    assert "| [`name`](#name) | title | agrees in part: 1 of 2 |" in whole
    assert "| `speed` | agrees in part: 1 of 2 | differs: 0 of 1 |" in page(
        [replace(result(NO), name="speed"), result(YES)], {}
    )
    assert "| once | today |" not in whole


def test_what_is_true_by_construction_is_marked_and_decides_nothing() -> None:
    given = Claim("an identity", True, "0", by_construction=True)
    assert result(NO, given).verdict == "differs"
    assert result(YES, given).verdict == "agrees"
    assert result(given).verdict == "by construction"
    assert counted(result(YES, NO, given)) == "agrees in part: 1 of 2, and 1 by construction"
    assert "- ✓ an identity (true by construction): 0." in as_markdown(result(given), "images")


def test_what_is_undecided_does_not_hold_and_is_marked() -> None:
    left_open = Claim("it may", False, "1 ± 2 cm", undecided=True)
    assert result(YES, left_open).verdict == "agrees in part"
    assert result(left_open).verdict == "undecided"
    assert result(NO, left_open).verdict == "differs"
    assert counted(result(YES, left_open)) == "agrees in part: 1 of 2, 1 undecided"
    assert "- ? undecided: it may: 1 ± 2 cm." in as_markdown(result(left_open), "images")
    with pytest.raises(ValueError, match="undecided does not hold"):
        Claim("it may", True, "", undecided=True)
    pair = replace(
        result(YES), also={DISPERSED_AIRCRAFT: result(replace(left_open, text=YES.text))}
    )
    assert "**Dispersion changes:** “it does” (✓ → ?)." in as_markdown(pair, "").splitlines()
    assert decided("x", None, "").undecided
    assert all_of([True, None]) is None
    assert all_of([None, False]) is False
    assert all_of([]) is False


@pytest.mark.parametrize(
    ("claims", "verdict"), [((YES,), "met"), ((YES, NO), "met in part"), ((NO,), "missed")]
)
def test_our_own_aims_stand_on_a_page_of_their_own(claims: tuple[Claim, ...], verdict: str) -> None:
    ours = replace(result(*claims), name="ours", own=True)
    assert ours.verdict == verdict
    written = pages([result(YES), ours], {})
    assert list(written) == ["experiments.md", "aims.md"]
    assert "`name`" in written["experiments.md"]
    assert "`ours`" not in written["experiments.md"]
    assert "`ours`" in written["aims.md"]
    assert "`name`" not in written["aims.md"]


def on_both(point: Result) -> Result:
    return replace(result(YES, NO), why="", also={POINT_MASS: point})


def test_both_models_stand_beside_each_other_in_every_table() -> None:
    point = replace(result(YES, YES), tables=(Table("one", ("a", "b [m]"), (("x", "7"),)),))
    text = as_markdown(on_both(point), "images")
    for row in (
        "| model | a | b [m] |",
        "| rigid body | x | 1 |",
        "| point mass | x | 7 |",
        "| claim | rigid body | point mass |",
        "| it does | ✓ 1 cm | ✓ 1 cm |",
        "| it does not | ✗ 2 cm | – |",
        "**Verdict: rigid body agrees in part, point mass agrees.**",
        "*Point mass*: because.",
    ):
        assert row in text.splitlines()
    assert "Rigid body*" not in text  # which has nothing to say beside its claims
    whole = page([on_both(point), replace(result(YES), name="alone")], {})
    assert "| [`name`](#name) | title | agrees in part: 1 of 2 | agrees: 2 of 2 |" in whole
    assert "| [`alone`](#alone) | title | agrees: 1 of 1 | – |" in whole
    assert as_json(on_both(point))["also"]["point mass"]["verdict"] == "agrees"


def test_a_table_with_measurements_in_its_head_stands_by_itself() -> None:
    other = replace(result(YES), tables=(Table("two", ("a", "b [m]"), (("x", "7"),)),))
    text = as_markdown(on_both(other), "images").splitlines()
    heads = [line for line in text if line.startswith(("**Rigid", "**Point", "| a |", "| x |"))]
    assert heads == [
        *("**Rigid body: one**", "| a | b [m] |", "| x | 1 |"),
        *("**Point mass: two**", "| a | b [m] |", "| x | 7 |"),
    ]


def test_a_section_with_dispersed_aircraft_says_what_they_are() -> None:
    begin = "<!-- name: begin; written by `tgl-soar experiment name --docs docs` -->"
    marks = f"{begin}<!-- name: end -->"
    alone, both = result(YES), replace(result(YES), also={DISPERSED_AIRCRAFT: result(YES)})
    assert DISPERSED_WORDS not in with_result(marks, alone)
    assert DISPERSED_WORDS in with_result(marks, both)


def test_what_both_models_say_alike_is_said_once() -> None:
    text = as_markdown(replace(result(YES), also={POINT_MASS: result(YES)}), "images")
    assert text.count("because.") == 1
    assert "Point mass*" not in text


def test_what_dispersion_changes_is_said_in_words() -> None:
    otherwise = replace(YES, holds=False, measured="9 cm")
    text = as_markdown(
        replace(result(YES, NO), also={DISPERSED_AIRCRAFT: result(otherwise, NO)}), ""
    )
    assert "**Dispersion changes:** “it does” (✓ → ✗)." in text.splitlines()
    assert "| it does | ✓ 1 cm | ✗ 9 cm |" in text.splitlines()
    text = as_markdown(replace(result(NO), also={DISPERSED_AIRCRAFT: result(YES, NO)}), "")
    assert "Dispersion changes none of these." in text.splitlines()
    text = as_markdown(replace(result(YES), also={DISPERSED_AIRCRAFT: result(YES, NO)}), "")
    asked = f"**Dispersion changes:** “{NO.text}”, asked of dispersed flights alone (✗)."
    assert asked in text.splitlines()
    assert "ispersion changes" not in as_markdown(on_both(result(NO)), "")


def test_an_experiment_is_flown_by_all_that_can_fly_it(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str | None, bool, bool]] = []

    def run(name: str, context: Context) -> Result:
        asked.append((name, context.model, context.dispersion, context.figures is not None))
        return result(YES)

    monkeypatch.setattr(catalogue, "run", run)
    context = Context(flyer=Flyer(), figures=Path())
    assert list(catalogue.run_whole("static", context).also) == [POINT_MASS, DISPERSED_AIRCRAFT]
    assert list(catalogue.run_whole("incidence", context).also) == [DISPERSED_AIRCRAFT]
    assert list(catalogue.run_whole("field", context).also) == []
    assert asked == [
        ("static", "rigid_body", False, True),
        ("static", "point_mass", False, False),
        ("static", "rigid_body", True, False),
        ("incidence", "rigid_body", False, True),
        ("incidence", "rigid_body", True, False),
        ("field", "rigid_body", False, True),
    ]


def test_tables_that_are_not_the_same_are_not_put_together() -> None:
    with pytest.raises(ValueError, match="zip"):
        as_markdown(on_both(replace(result(YES), tables=())), "images")


def test_a_changed_threshold_is_listed_with_its_reason() -> None:
    assert "was" not in page([result(YES)], {}).split("\n\n")[-2]
    changed = ChangedThreshold("it moves", "15 cm", "5 cm", "as far as it strays")
    reported = page([replace(result(YES), changed=(changed,))], {})
    assert "| `name` | it moves | 15 cm | 5 cm | as far as it strays |" in reported


def test_json_has_no_numbers_that_are_none() -> None:
    assert plain({"a": float("nan"), "b": (float("inf"), 1.0)}) == {"a": None, "b": [None, 1.0]}


def test_the_hill_has_its_three_places() -> None:
    """By construction of the parabola: 1.5 + 0.2 · 1² = 1.7 m/s at 8 and at 10 m/s."""
    places = positions()
    assert polar_sink(POLAR, 8.0) == pytest.approx(1.7)
    assert polar_sink(POLAR, 10.0) == pytest.approx(1.7)
    assert [round(p.updraft_mps, 2) for p in places] == [1.7, 1.53, 1.7]
    assert all(claim.holds for claim in claims_of(places))
    a, b, c = places
    assert not claims_of([a._replace(updraft_mps=1.8), b, c])[0].holds
    assert not claims_of([c, b, a])[2].holds
    for place in (b, c):  # their perpendiculars lean downwind; lines that lean upwind do as well
        assert place.lean_rad < 0.0
        upwind = TargetLine(place.x_m, place.z_m, eta_from_lean(radians(20.0)))
        assert stable_crossing(HillField(WIND_MPS, RADIUS_M), POLAR, upwind) is not None


def test_slope_needs_contour_and_aircraft_to_rise_alike() -> None:
    same = [slope_shift("a", 0.10, 0.0), slope_shift("b", 0.12, 0.01)]
    assert signs(slope_claims(same)) == "✓✓"
    assert signs(slope_claims([slope_shift("a", 0.02, -0.08), same[1]])) == "✓✗"
    # 1.5 cm off, known to 0.4 cm: 2.4 of these go beyond the 2 cm that are asked.
    assert signs(slope_claims([slope_shift("a", 0.10, 0.015), same[1]])) == "✓?"
    assert signs(slope_claims([same[0]._replace(error_m=0.05), same[1]])) == "✓?"


def slope_shift(line: str, flown_m: float, off_m: float) -> Shift:
    return Shift(
        line=line,
        flown_m=flown_m,
        predicted_m=0.1,
        up_m=flown_m,
        error_m=0.004,
        off_m=off_m,
        off_error_m=0.004,
        worst_off_m=2.0 * off_m,
        worst_glide_m=off_m,
    )


def signs(claims: Sequence[Claim]) -> str:
    return "".join("?" if c.undecided else "✓" if c.holds else "✗" for c in claims)


def leg(
    miss_m: float = 0.01,
    settling_s: float = 1.0,
    error_m: float = 0.002,
    one_m: float | None = None,
    one_error_m: float = 0.006,
) -> LegSummary:
    one = MissOfFlight(miss_m if one_m is None else one_m, one_error_m)
    return LegSummary(
        line="a",
        flights=8,
        settling_s=settling_s,
        rms_e_rho_m=0.005,
        peak_e_rho_m=0.02,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        miss_m=miss_m,
        miss_error_m=error_m,
        apart_m=0.09,
        own_miss_m=miss_m,
        own_error_m=error_m,
        worst_own=one,
        worst_file=one,
        worst_glide_m=0.001,
        known_to_m=one_error_m,
        dispersion_m=0.03,
        dispersion_formula_m=0.03,
        stalled_fraction=0.0,
        mean_x_m=0.0,
        mean_z_m=1.0,
    )


@pytest.mark.parametrize(
    ("legs", "sign"),
    [
        ((leg(0.01), leg(-0.02)), "✓"),
        ((leg(0.01), leg(MISS_MOST_M + 0.006)), "✗"),
        ((leg(0.01), leg(-MISS_MOST_M - 0.006)), "✗"),
        ((leg(0.01), leg(MISS_MOST_M - 0.004)), "?"),  # 2.4 errors of 2 mm go beyond
        ((leg(0.01, error_m=0.03),), "?"),  # the mean of flights that are far apart
        ((leg(0.0, one_m=0.09),), "✗"),  # each is 9 cm off, the mean of all is not
        ((leg(0.0, one_error_m=0.016),), "?"),  # one flight is not known to half the bound
        ((leg(0.01), leg(nan)), "✗"),  # the line meets no contour
        ((), "✗"),
    ],
)
def test_it_hovers_at_the_crossing_on_every_leg(legs: tuple[LegSummary, ...], sign: str) -> None:
    assert signs([place_claim(list(legs))]) == sign


def test_whoever_has_the_files_alone_is_told_how_far_off_each_aircraft_is() -> None:
    far = known_place_claim([leg(0.0, one_m=-0.157)])
    assert signs([far]) == "✗"
    assert "at most 15.7 ± 0.6 cm from it (line a)" in far.measured
    assert "9.0 cm apart" in far.measured
    assert signs([known_place_claim([leg(0.0)])]) == "✓"
    assert signs([known_place_claim([leg(0.0, one_error_m=0.02)])]) == "?"


def test_the_error_of_a_mean_is_that_of_the_flights_and_not_of_their_samples() -> None:
    """Two aircraft that each stay where they are, 18 cm apart: ± 9 cm, not nothing."""
    one, other = (
        replace(flight(1).legs[0], along_m=along, dispersion_m=1e-4) for along in (-0.09, 0.09)
    )
    mean = mean_of_flights(each.along_m for each in (one, other))
    assert mean.mean == pytest.approx(0.0)
    assert mean.error == pytest.approx(0.09)
    assert mean_of_flights([0.1]).error == inf
    assert rms_error([1.0, 1.0]) == 0.0
    assert rms_error([1.0]) == inf


def test_dispersion_that_is_not_the_formulas_is_not_laid_on_the_stall_where_none_stalled() -> None:
    much = leg()._replace(dispersion_m=0.06)
    assert "the stall is not the reason" in dispersion_note({0.01: [much]})
    stalled = much._replace(stalled_fraction=0.185)
    assert "beyond the stall's incidence 18.5 % of the time" in dispersion_note({0.05: [stalled]})
    assert "has no stall" in dispersion_note({0.05: [stalled]}, stalls=False)
    assert "stall" not in dispersion_note({0.01: [leg()]})
    calm = leg()._replace(dispersion_formula_m=0.0, apart_m=0.086)
    assert "differs by 8.6 cm (standard" in dispersion_note({0.0: [calm], 0.01: [leg()]})


def flight(legs: int, ended: str = "") -> FlownScenario:
    scored = ScoredLeg(
        line="a",
        target=TargetLine(0.0, 1.0, eta_from_lean(0.3)),
        begin_s=0.0,
        end_s=20.0,
        settling_s=1.0,
        rms_e_rho_m=0.005,
        peak_e_rho_m=0.02,
        mean_e_rho_m=0.001,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        mean_x_m=0.0,
        mean_z_m=1.0,
        along_m=0.0,
        dispersion_m=0.03,
        predicted=None,
        predicted_along_m=nan,
        scored_s=15.0,
    )
    return FlownScenario(seed=1, ended=ended, duration_s=20.0, legs=(scored,) * legs, path={})


@pytest.mark.parametrize(
    ("flights", "settling_s", "holds"),
    [
        ([flight(2), flight(2)], 4.9, True),
        ([flight(2), flight(2)], 5.1, False),  # to the line, too late
        ([flight(2), flight(2)], inf, False),  # never
        ([flight(2), flight(1)], 1.0, False),  # a line not reached
        ([flight(2), flight(2, "hit the board")], 1.0, False),
    ],
)
def test_settled_is_on_every_line_in_time_and_to_the_end(
    flights: list[FlownScenario], settling_s: float, holds: bool
) -> None:
    assert settled_claim(flights, [leg(), leg(settling_s=settling_s)], 2).holds is holds


def shift(line: str, flown_m: float, predicted_m: float | None = None, lost: int = 0) -> WindShift:
    predicted = flown_m if predicted_m is None else predicted_m
    return WindShift(
        line=line,
        speed_ratio=1.0,
        margin=0.0,
        margin_half_way=0.0,
        first_order_m=0.0,
        half_way_m=0.0,
        predicted_m=predicted,
        flown_m=flown_m,
        polar_error_m=0.0,
        lost=lost,
        dispersion_m=0.03,
        error_m=0.001,
        off_m=flown_m - predicted,
        off_error_m=0.001,
        worst_off_m=flown_m - predicted,
        worst_glide_m=flown_m - predicted,
    )


def test_wind_asks_for_a_rise_a_rest_and_a_fall() -> None:
    small = [shift("a", 0.05), shift("b", 0.03), shift("c", 0.0), shift("d", -0.01)]
    large = [shift("a", 0.05), shift("b", 0.05), shift("c", 0.0), shift("d", -0.03)]
    assert signs(wind_claims(small, large)) == "✓✓✓✓"
    sinking = [*large[:2], shift("c", -0.05), large[3]]
    assert signs(wind_claims(small, sinking)) == "✓✗✓✓"
    unresolved = [*small[:3], shift("d", -0.002)]  # within 2.4 standard errors of nothing
    assert signs(wind_claims(unresolved, large)) == "?✓✓✓"
    nearly = [*small[:2], shift("c", 0.013), small[3]]  # 1.4 cm are asked
    assert signs(wind_claims(nearly, large)) == "?✓✓✓"
    far = [shift("a", 0.063), *large[1:]]  # more than two standard deviations
    assert signs(wind_claims(small, far)) == "✓✓✓✗"
    assert signs(wind_claims(small, [shift("a", 0.059), *large[1:]])) == "✓✓✓?"
    lost = [shift("a", 0.05, lost=1), *large[1:]]
    assert signs(wind_claims(small, lost)) == "✓✗✗✗"
    assert "(1 flights lost)" in wind_claims(small, lost)[1].measured
    nowhere = [shift("a", 0.05, nan), *large[1:]]
    assert signs(wind_claims(small, nowhere)) == "✓✓✗✓"
    astray = [shift("a", 0.3, 0.1), *large[1:]]
    assert signs(wind_claims(small, astray)) == "✓✓✗✗"


def test_what_calm_air_leaves_is_of_both_steps_and_names_its_losses() -> None:
    full = [shift("a", 0.05)]
    calm = [*full, shift("a", 0.161, 0.056, lost=1)]
    assert "agree within 10.5 cm" in wind_why(full, calm, dispersed=True)
    assert "1 of the flights in calm air were lost" in wind_why(full, calm, dispersed=True)
    assert "lost" not in wind_why(full, full)


def gust_change(
    line: str, wind_mps: float, margin: float, at_once_m: float, in_the_end_m: float = 0.0
) -> WindEffect:
    return WindEffect(
        line=line,
        wind_mps=wind_mps,
        sink_mps=1.4,
        updraft_gain=0.15 + margin,
        sink_gain=0.15,
        at_once_m=at_once_m,
        highest_m=0.0,
        in_the_end_m=in_the_end_m,
        predicted_m=0.0,
    )


def test_gust_tells_the_slopes_from_what_happens_at_once() -> None:
    quasi = [gust_change("a", 8.5, 0.1, 0.02, 0.03), gust_change("c", 9.3, 0.0, 0.0)]
    quasi.append(gust_change("d", 9.6, -0.02, -0.01, -0.02))
    assert [c.holds for c in sensitivity_claims(quasi, 9.3)] == [True, True, True]
    assert [c.by_construction for c in sensitivity_claims(quasi, 9.3)] == [True, False, False]
    thrown = [c._replace(at_once_m=0.02) for c in quasi]
    assert [c.holds for c in sensitivity_claims(thrown, 9.3)] == [True, True, False]
    for k, end_m in ((0, -0.01), (1, 0.02), (2, 0.01)):
        astray = [c._replace(in_the_end_m=end_m) if i == k else c for i, c in enumerate(quasi)]
        assert [c.holds for c in sensitivity_claims(astray, 9.3)] == [True, False, True]
    lost = [quasi[0]._replace(lost=1), *quasi[1:]]
    assert [c.holds for c in sensitivity_claims(lost, 9.3)] == [True, False, True]


def lean_score(
    lean_deg: float, oscillation_m: float, from_line_m: float, survived: int = 8
) -> LeanScore:
    whole = survived == 8
    return LeanScore(
        lean_deg=lean_deg,
        off_perpendicular_deg=lean_deg - 44.0,
        flights=8,
        survived=survived,
        rms_e_rho_m=hypot(oscillation_m, from_line_m) if whole else inf,
        oscillation_m=oscillation_m if whole else inf,
        from_line_m=from_line_m if whole else inf,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        dispersion_m=0.05,
        apart_m=0.02,
        dispersion_formula_m=0.05,
        drift_m=0,
        rate_per_s=1,
        stalled_fraction=0,
        ended="",
        oscillation_error=0.03,
        from_line_error=0.03,
    )


def reported_of_leans(*scores: LeanScore) -> list[bool]:
    return [c.holds for c in lean_claims(list(scores), 44.0, "so")]


def test_lean_asks_for_the_least_at_the_perpendicular_and_more_far_from_it() -> None:
    downwind = lean_score(-10, 0.5, 0.1)
    upright, across = lean_score(10, 0.015, 0.002), lean_score(40, 0.010, 0.001)
    assert reported_of_leans(downwind, upright, across) == [True, True, True]
    # The least is elsewhere; or what is far off is no worse, within two standard errors.
    assert reported_of_leans(downwind, lean_score(10, 0.008, 0.0008), across) == [
        False,
        False,
        True,
    ]
    assert reported_of_leans(downwind, lean_score(10, 0.0105, 0.0018), across) == [
        False,
        True,
        True,
    ]
    # Nobody flew near the perpendicular, or it lost a flight.
    assert reported_of_leans(downwind, upright) == [False, False, True]
    lost = lean_score(40, 0.010, 0.001, survived=7)
    assert reported_of_leans(downwind, upright, lost) == [False, False, True]


def test_a_drift_that_is_known_to_a_quarter_decides_nothing_a_fifth_apart() -> None:
    """The rms of eight means: 0.09 against 0.11 cm is within its error, four times is not."""
    across, upright = lean_score(40, 0.010, 0.0009), lean_score(10, 0.015, 0.0011)
    coarse = [s._replace(from_line_error=0.25) for s in (across, upright)]
    claims = lean_claims(coarse, 44.0, "so")
    assert signs(claims) == "✓?✗"
    assert "known to a factor of 2.34" in claims[1].measured
    assert "on the steep side alone, as no lean beyond 74° was flown" in claims[1].measured
    far = [coarse[0], coarse[1]._replace(from_line_m=0.0040)]
    assert signs(lean_claims(far, 44.0, "so")) == "✓✓✗"
    flat = [*coarse, lean_score(75, 0.02, 0.01)]
    assert "steep side" not in lean_claims(flat, 44.0, "so")[1].measured


def test_a_dispersion_that_does_not_follow_its_formula_is_said_not_to() -> None:
    follows = lean_score(40, 0.010, 0.001)
    assert "follows its formula on the lines that were held, 1.00 to 1.00" in along_words([follows])
    apart = follows._replace(dispersion_m=0.13, stalled_fraction=0.04)
    words = along_words([follows, apart])
    assert "does not follow its formula on 1 of 2 lines" in words
    assert "2.60 times it" in words
    assert "stall's incidence 4.0 % of the time" in words
    assert "no lean was held" in along_words([])


def test_a_downwind_lean_is_held_or_lost() -> None:
    across = lean_score(40, 0.010, 0.001)
    for downwind, fails in (
        (lean_score(-10, HELD_M + 0.001, 0.0), True),
        (lean_score(-10, HELD_M - 0.001, 0.0), False),
        (lean_score(-10, 0.010, 0.0, survived=7), True),
    ):
        assert reported_of_leans(downwind, across)[2] is fails
    assert reported_of_leans(across)[2] is False


def test_leans_that_are_accepted_and_not_held_are_named() -> None:
    poor, good = lean_score(5, HELD_M + 0.002, 0.0), lean_score(40, 0.01, 0.001)
    named = lean_why({("with", SCHEDULED): [poor, good]}, 44.0, 0.1, 6.0)
    assert "not held: 5° (with accelerometers, 3.2 cm)" in named
    assert "Every lean flown" in lean_why({("with", SCHEDULED): [good]}, 44.0, 0.1, 6.0)


def test_a_downwind_lean_that_is_held_is_named_where_the_formula_speaks_against_it() -> None:
    held, lost, upwind = (
        lean_score(*of) for of in ((-5, 0.01, 0.0), (-10, 0.1, 0.0), (5, 0.01, 0))
    )
    named = downwind_words({("with", SCHEDULED): [held, upwind], ("with", ONE_SET): [held, lost]})
    assert named == (
        ", far enough out at -5° with accelerometers, -5° with accelerometers and one set of gains"
        " for the line to be held"
    )
    assert downwind_words({("with", SCHEDULED): [lost, upwind]}) == ""


def test_the_module_refuses_flat_lines_and_lines_that_lean_downwind() -> None:
    assert "60" in refusal(90.0)
    assert "TGL_LEAN_MIN" in refusal(-10.0)
    assert refusal(20.0) == ""


def speed_score(wind_mps: float, rms_m: float, survived: int = 8) -> SpeedScore:
    return SpeedScore(
        line="a",
        wind_mps=wind_mps,
        flights=8,
        survived=survived,
        rms_e_rho_m=rms_m if survived == 8 else inf,
        oscillation_m=rms_m if survived == 8 else inf,
        error=0.05,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        rms_pitch_rate_radps=0.1,
    )


def test_speed_asks_both_with_margin_and_without() -> None:
    falls, grows, same = (
        [speed_score(8.3, a), speed_score(9.3, b)]
        for a, b in ((0.02, 0.01), (0.02, 0.03), (0.02, 0.022))
    )
    quiet = [score._replace(oscillation_m=0.003) for score in falls]
    biased = [score._replace(rms_e_rho_m=0.02) for score in quiet]  # beside the line, and steady

    def reported(fixed: list[SpeedScore], calm: dict[float, list[SpeedScore]] | None = None) -> str:
        return signs(speed_claims({"without": fixed}, calm or {1.0: quiet}))

    assert reported(falls, {1.0: quiet, 2.5: grows}) == "✗✓"
    assert reported(falls, {1.0: biased, 2.5: grows}) == "✗✓"
    assert reported(grows) == "✓✗"
    assert reported(same) == "?✗"  # within 2.4 standard errors
    assert reported(grows, {2.5: grows, 4.0: falls}) == "✓✗"  # of all gains that ring
    words = speed_claims({}, {2.5: grows, 4.0: falls})[0].measured
    assert "at × 2.5, where it grows" in words
    assert "at × 4, where it falls" in words


def test_a_lost_flight_counts_at_its_place() -> None:
    lost = speed_score(7.6, 0.02, survived=7)
    held = speed_score(9.3, 0.03)
    assert not growth([lost, held]).shown  # the slowest is the worst, and is not left out
    assert growth([held, lost]).shown
    assert not growth([lost, lost]).shown
    assert rings([lost])
    middle = [held, lost, held]
    assert "1 at 7.60 m/s with × 3" in speed_why({"with": middle}, {"with": middle}, {3.0: middle})


def test_scores_of_a_place_are_of_all_its_flights() -> None:
    path = {"time_s": np.arange(0.0, 20.0, 0.02), "pitch_rad": np.zeros(1000)}
    lasted = replace(flight(1), path=path)
    assert score_speed([lasted, lasted], "a", 8.0).rms_e_rho_m == pytest.approx(0.005)
    assert score_speed([lasted], "a", 8.0).oscillation_m == pytest.approx(24e-6**0.5)
    assert score_speed([lasted, replace(lasted, ended="hit")], "a", 8.0).rms_e_rho_m == inf

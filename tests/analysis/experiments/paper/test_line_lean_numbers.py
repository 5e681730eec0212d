"""Lines that lean: which are flown, what a lean's figures come to of several flights, each claim
and note on both sides of its bound."""

from __future__ import annotations

from functools import cache
from math import exp, inf, isnan, nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from by_hand import ScriptedFlyer, flight, leg, signs
from test_line_lean import lean_score

from tgl_soar.air.zeuc import excess_gradient
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper.line_lean import (
    ONE_SET,
    SCHEDULED,
    LeanScore,
    _row,
    along_words,
    downwind_words,
    horizontal_line,
    lean,
    lean_claims,
    lean_why,
    score_lean,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import PreparedScenario, prepare, slide_at
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion
from tgl_soar.analysis.report import curves_figure as curves_figures
from tgl_soar.types import polar_slope

LEANS = (-20, -10, -5, 0, 5, 10, 15, 20, 30, 40, 50, 60)


@cache
def prepared() -> PreparedScenario:
    return prepare(Context(flyer=ScriptedFlyer(lambda _: None)).scenario("lean"))


# --- one lean -----------------------------------------------------------------------------------


def one(rms_m: float, mean_m: float, ended: str = "", **more: Any) -> FlownScenario:
    stall = prepared().airframe.model["stall_alpha_rad"]
    angles = np.array([stall + 0.01, stall - 0.01])
    figures = {"rms_e_rho_m": rms_m, "mean_e_rho_m": mean_m, **more}
    return flight(leg("b", **figures), leg("other"), ended=ended, path={"alpha_rad": angles})


def test_a_lean_is_scored_over_all_its_flights() -> None:
    flights = [
        one(0.05, 0.03, rms_y_m=0.1, rms_bank_rad=0.07, along_m=0.02, dispersion_m=0.03),
        one(0.05, -0.04, rms_y_m=0.7, rms_bank_rad=0.01, along_m=-0.04, dispersion_m=0.04),
    ]
    found = score_lean(prepared(), flights, 20, 44.0)
    assert (found.lean_deg, found.off_perpendicular_deg) == (20.0, -24.0)
    assert (found.flights, found.survived, found.ended) == (2, 2, "")
    assert found.rms_e_rho_m == pytest.approx(0.05)
    assert found.oscillation_m == pytest.approx(sqrt((16 + 9) / 2.0) / 100.0)
    assert found.from_line_m == pytest.approx(sqrt((9 + 16) / 2.0) / 100.0)
    assert found.rms_y_m == pytest.approx(0.5)
    assert found.rms_bank_rad == pytest.approx(0.05)
    assert found.drift_m == pytest.approx(-0.01)
    assert found.apart_m == pytest.approx(0.06 / sqrt(2.0))
    assert found.dispersion_m == pytest.approx(sqrt((9 + 16) / 2.0 + 9.0) / 100.0)
    assert found.stalled_fraction == 0.5
    # Squares of 16 and 9 are 12.5 ± 3.5; of the root half as much.
    assert found.oscillation_error == pytest.approx(0.5 * 3.5 / 12.5)
    assert found.from_line_error == pytest.approx(0.5 * 3.5 / 12.5)
    line = prepared().lines["b"]
    assert line.crossing is not None
    slide = slide_at(prepared().polar, line.target, line.crossing)
    assert found.rate_per_s == pytest.approx(slide.rate_per_s)
    air = prepared().site.air
    assert air is not None
    wind = prepared().field.reference_wind_mps
    formula = dryden_dispersion(slide, 0.02 * wind, air.turbulence.length_scale_m / wind)
    assert found.dispersion_formula_m == pytest.approx(formula)


def test_a_mean_beyond_the_rms_leaves_no_oscillation() -> None:
    assert score_lean(prepared(), [one(0.02, 0.03)] * 2, 20, 0.0).oscillation_m == 0.0


def test_a_lean_that_lost_one_has_no_rms_and_says_why() -> None:
    lost = one(0.05, 0.03, "hit the board at x 0.31, z 0.52 m")
    found = score_lean(prepared(), [one(0.02, 0.0), lost], 20, 0.0)
    assert (found.flights, found.survived, found.ended) == (2, 1, "hit the board")
    assert found.rms_e_rho_m == found.oscillation_m == found.from_line_m == inf
    assert found.rms_bank_rad == pytest.approx(0.02)
    assert found.drift_m == 0.0
    nobody = score_lean(prepared(), [lost, flight()], 20, 0.0)
    assert (nobody.survived, nobody.rms_e_rho_m) == (0, inf)
    for value in (nobody.rms_y_m, nobody.dispersion_m, nobody.drift_m, nobody.stalled_fraction):
        assert isnan(value)


def test_a_line_that_meets_no_contour_has_no_rate() -> None:
    lines = {"b": prepared().lines["b"]._replace(crossing=None)}
    found = score_lean(prepared()._replace(lines=lines), [one(0.02, 0.0)], 20, 0.0)
    assert isnan(found.rate_per_s)
    assert isnan(found.dispersion_formula_m)


def test_a_lean_is_reported_in_centimetres() -> None:
    s = lean_score(-10, 0.0123, 0.0045)._replace(
        rms_e_rho_m=0.0131, drift_m=-0.021, apart_m=0.034, dispersion_formula_m=0.056,
        rate_per_s=1.234, rms_y_m=nan,
    )  # fmt: skip
    assert _row(s) == (
        "-10", "-54", "8 of 8", "1.31", "1.23", "0.45", "–", "1.1", "5.0", "5.6", "3.4", "-2.1",
        "1.23",
    )  # fmt: skip
    assert _row(lean_score(20, 0.01, 0.01, survived=7))[2:6] == ("7 of 8", "lost", "lost", "lost")


# --- claims -------------------------------------------------------------------------------------

ACROSS, FAR = lean_score(44, 0.010, 0.001), lean_score(10, 0.020, 0.002)
DOWNWIND = lean_score(-10, 0.5, 0.1)


def oscillates(*several: LeanScore) -> str:
    return signs(lean_claims(list(several), 44.0, "so"))[0]


def of(score: LeanScore, value_m: float, error: float) -> LeanScore:
    return score._replace(oscillation_m=value_m, oscillation_error=error)


@pytest.mark.parametrize(("lean_deg", "sign"), [(34, "✓"), (33.9, "✗"), (54, "✓"), (54.1, "✗")])
def test_near_the_perpendicular_is_within_ten_degrees(lean_deg: float, sign: str) -> None:
    near = of(lean_score(lean_deg, 0.01, 0.001), 0.010, 0.03)
    assert oscillates(near, FAR) == sign


@pytest.mark.parametrize(
    ("lean_deg", "is_far"), [(14, True), (14.1, False), (74, True), (73.9, False)]
)
def test_far_from_it_is_from_thirty_degrees_on(lean_deg: float, is_far: bool) -> None:
    """A lean as good as the one across it counts where it is far."""
    same = lean_score(lean_deg, 0.010, 0.001)
    assert oscillates(ACROSS, FAR, same) == ("✗" if is_far else "✓")
    assert oscillates(ACROSS, same) == "✗"  # not more, or none far off


@pytest.mark.parametrize(
    ("far_m", "error", "sign"),
    [
        (0.0111, 0.0, "✓"),
        (0.0109, 0.0, "✗"),
        (0.0122, 0.05, "✓"),  # exp(2.4 · √2 · 0.05) is 1.185
        (0.0118, 0.05, "✗"),  # and less than 1.21: fine enough to tell
        (0.0131, 0.08, "?"),  # exp(2.4 · √2 · 0.08) is 1.312, and coarse
        (0.0132, 0.08, "✓"),
        (0.0078, 0.08, "?"),
        (0.0076, 0.08, "✗"),  # for certain less than near the perpendicular
    ],
)
def test_more_is_a_tenth_more_and_beyond_the_errors_of_both(
    far_m: float, error: float, sign: str
) -> None:
    assert exp(2.4 * sqrt(2.0) * 0.08) == pytest.approx(1.312, abs=1e-3)
    assert oscillates(of(ACROSS, 0.010, error), of(FAR, far_m, error)) == sign


@pytest.mark.parametrize(
    ("near_m", "error", "sign"),
    [
        (0.0109, 0.0, "✓"),
        (0.0111, 0.0, "✗"),
        (0.0109, 0.05, "✓"),
        (0.0115, 0.05, "✗"),
        (0.0109, 0.08, "?"),
    ],
)
def test_near_the_perpendicular_it_is_no_more_than_a_tenth_above_the_least(
    near_m: float, error: float, sign: str
) -> None:
    """The least lies between, at 20° off; what is far has ten times as much."""
    least = of(lean_score(24, 0.010, 0.001), 0.010, error)
    assert oscillates(of(ACROSS, near_m, error), least, of(FAR, 0.1, error)) == sign


def test_what_is_lost_is_more_than_all_that_is_not() -> None:
    lost_far, lost_near = (lean_score(d, 0.01, 0.001, survived=7) for d in (10, 44))
    assert oscillates(ACROSS, lost_far) == "✓"
    assert oscillates(lost_near, FAR) == "✗"
    assert oscillates(lost_near, lost_far) == "✗"
    words = lean_claims([ACROSS, lost_far], 44.0, "so")[0].measured
    assert "further from lost cm on, known to a factor of 1.00" in words


def test_claims_name_the_least_the_nearest_and_the_smallest_far_off() -> None:
    scores = [
        lean_score(10, 0.02, 0.004),
        lean_score(0, 0.03, 0.002),
        lean_score(40, 0.012, 0.001),
        lean_score(30, 0.0115, 0.0011),
    ]
    for several in (scores, scores[::-1]):
        first, second, _ = lean_claims(several, 44.0, "so")
        assert first.measured.startswith(
            "least 1.15 cm at 30°, 14° from the perpendicular (44°); 1.20 cm at 40°; 30° off and"
            " further from 2.00 cm on, known to a factor of 1.11; on the steep side alone, as no"
            " lean beyond 74° was flown"
        )
        assert "least 0.10 cm at 40°" in second.measured
        assert "further from 0.20 cm on" in second.measured
    assert "oscillates about the line (so)" in first.text
    assert "drifts from the line (so)" in second.text
    assert "known to" not in lean_claims([ACROSS], 44.0, "so")[0].measured


@pytest.mark.parametrize(("rms_m", "held"), [(0.030, True), (0.0301, False), (inf, False)])
def test_three_centimetres_is_held(rms_m: float, held: bool) -> None:
    one = DOWNWIND._replace(rms_e_rho_m=rms_m)
    assert one.held is held
    claim = lean_claims([one, DOWNWIND, ACROSS], 44.0, "so")[2]
    assert claim.holds is not held
    words = "1 of 2 such leans are held within 3 cm rms (-10°)" if held else "0 of 2 such leans"
    assert claim.measured.startswith(words)


def test_a_line_that_stands_upright_does_not_lean_downwind() -> None:
    upright = lean_score(0, 0.01, 0.0)
    lost = lean_score(-5, 0.01, 0.0, survived=6)
    claim = lean_claims([upright, lost, ACROSS], 44.0, "so")[2]
    assert claim.holds
    assert claim.measured == (
        "0 of 1 such leans are held within 3 cm rms; 2 of 8 flights were lost"
    )
    assert not lean_claims([upright, ACROSS], 44.0, "so")[2].holds  # none was flown


# --- words --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratio", "follows"), [(1.14, True), (1.16, False), (1 / 1.14, True), (1 / 1.16, False)]
)
def test_a_dispersion_follows_within_fifteen_per_cent_either_way(
    ratio: float, follows: bool
) -> None:
    s = lean_score(40, 0.01, 0.001)._replace(dispersion_m=0.05 * ratio)
    words = along_words([lean_score(20, 0.01, 0.0), s])
    assert ("follows its formula on the lines" in words) is follows
    assert ("on 1 of 2 lines" in words) is not follows
    if follows:
        assert f"{min(1.0, ratio):.2f} to {max(1.0, ratio):.2f} times it" in words


def test_the_lean_that_is_farthest_off_its_formula_is_found_by_its_logarithm() -> None:
    """A third is farther off than twice as much."""
    twice = lean_score(40, 0.01, 0.001)._replace(dispersion_m=0.10, stalled_fraction=0.5)
    third = lean_score(-5.4, 0.01, 0.001)._replace(dispersion_m=0.05 / 3.0, stalled_fraction=0.02)
    for several in ([twice, third], [third, twice]):
        words = along_words(several)
        assert "on 2 of 2 lines that were held (-5°, 40°): on that of -5° it is 0.33 times" in words
        assert "2.0 % of the time" in words
    unknown = lean_score(20, 0.01, 0.0)._replace(dispersion_m=nan)
    assert "no lean was held" in along_words([unknown])
    assert "no lean was held" in along_words([unknown._replace(dispersion_formula_m=0.0)])
    assert "no lean was held" in along_words(
        [lean_score(20, 0.01, 0.0)._replace(dispersion_formula_m=nan)]
    )


def test_the_reasons_name_what_is_held_and_what_is_accepted_and_not() -> None:
    """5 and 45 degrees are accepted by default; what one set of gains does not hold is no fault."""
    held = lean_score(20, 0.01, 0.001)
    for lean_deg, accepted in ((4, False), (5, True), (45, True), (46, False), (-10, False)):
        poor = lean_score(lean_deg, 0.04, 0.0)
        words = lean_why({("with", SCHEDULED): [held, poor]}, 44.0, 0.1, 6.0)
        assert (f"not held: {lean_deg}° (with accelerometers, 4.0 cm)" in words) is accepted
        assert ("Every lean flown" in words) is not accepted
    scores = {("with", SCHEDULED): [held], ("without", ONE_SET): [lean_score(20, 0.04, 0.0)]}
    words = lean_why(scores, 44.0, 0.1, 6.0)
    assert f"Held within 3 cm are with accelerometers and {SCHEDULED}: 20°; without" in words
    assert f"without accelerometers and {ONE_SET}: none." in words
    assert "Every lean flown" in words
    assert "the slide is stable, but at a rate of 6.0 1/s" in words
    assert "(here +0.100)" in words
    assert "not stable at all: at a rate of -1.0 1/s" in lean_why(scores, 44.0, 0.1, -1.0)
    assert "not stable at all" in lean_why(scores, 44.0, 0.1, 0.0)


def test_an_upright_line_that_is_held_is_not_downwind() -> None:
    assert downwind_words({("with", SCHEDULED): [lean_score(0, 0.01, 0.0)]}) == ""


def test_a_horizontal_line_slides_by_the_slope_of_the_polar_alone() -> None:
    """Its upper end upwind: t = (−1, 0), so that E falls by −dE/dx along it, and S′ is all that
    carries it."""
    at = prepared().lines["b"].crossing
    assert at is not None
    gx, _ = excess_gradient(prepared().field, prepared().polar, at.x_m, at.z_m)
    slope = polar_slope(prepared().polar, at.wind_mps)
    assert horizontal_line(prepared()) == pytest.approx(gx / slope)
    flat = prepared().polar._replace(c1=0.0, c2=0.0, c3=0.0)
    assert horizontal_line(prepared()._replace(polar=flat)) == inf


# --- the whole ----------------------------------------------------------------------------------


def flown(job: ScenarioJob) -> FlownScenario:
    """The flatter, the more it oscillates: half a millimetre a degree off 40, and as much again
    beyond; twice that without accelerometers; with one set of gains as it stands −20 is lost."""
    given = job.scenario
    lean_deg = given.lines["b"].lean_deg
    assert lean_deg is not None
    wave_m = 0.0005 * (10.0 + abs(lean_deg - 40.0)) * (1.0 if given.sensors.imu else 2.0)
    lost = lean_deg == -20.0 and "RHO_SPEED" in given.parameters and job.seed == 2
    return one_of(wave_m, "hit the board" if lost else "", job.seed)


def one_of(rms_m: float, ended: str, seed: int) -> FlownScenario:
    figures = {"rms_e_rho_m": rms_m, "mean_e_rho_m": 0.0, "dispersion_m": 0.04}
    return flight(leg("b", **figures), ended=ended, seed=seed)


@cache
def concluded(quick: bool = False) -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(flown)
    return lean(Context(flyer=flyer, quick=quick)), flyer.jobs


def test_every_lean_is_flown_with_each_sensor_and_with_gains_of_its_own_and_without() -> None:
    flights = []
    for job in concluded()[1]:
        given = job.scenario
        assert set(given.lines) == {"b"}
        assert given.parameters["TGL_LEAN_MIN"] == -60.0
        assert given.parameters.get("RHO_SPEED", 0.0) == 0.0
        one_set = "RHO_SPEED" in given.parameters
        flights.append((given.sensors.imu, given.lines["b"].lean_deg, one_set, job.seed))
    assert flights == [
        (imu, float(deg), one_set, seed)
        for imu in (False, True)
        for deg in LEANS
        for one_set in (False, True)
        for seed in range(1, 9)
    ]
    quick = concluded(quick=True)[1]
    assert {job.scenario.lines["b"].lean_deg for job in quick} == {-10.0, 20.0, 50.0}
    assert {job.seed for job in quick} == {1}


def test_each_table_has_a_row_for_each_lean() -> None:
    result = concluded()[0]
    assert [table.title for table in result.tables] == [
        f"{gains}, {imu} accelerometers"
        for imu in ("without", "with")
        for gains in (SCHEDULED, ONE_SET)
    ]
    for table in result.tables:
        assert [row[0] for row in table.rows] == [f"{deg:+d}" for deg in LEANS]
        assert {len(row) for row in table.rows} == {len(table.columns)}
    across = result.numbers["perpendicular_lean_deg"]
    assert 35.0 < across < 60.0
    assert result.tables[0].rows[0][1:4] == (f"{-20 - across:+.0f}", "8 of 8", "7.00")
    assert result.tables[1].rows[0][2:4] == ("7 of 8", "lost")
    assert result.tables[2].rows[9][3] == "0.50"


def test_claims_are_of_scheduled_gains_with_each_sensor() -> None:
    result = concluded()[0]
    assert len(result.claims) == 6
    assert "(without accelerometers)" in result.claims[0].text
    assert "(with accelerometers)" in result.claims[3].text
    assert result.claims[2].measured.endswith("0 of 24 flights were lost")  # none of these gains
    assert result.claims[3].measured.startswith("least 0.50 cm at 40°")
    at = prepared().lines["b"].crossing
    assert at is not None
    horizontal = result.numbers["horizontal"]
    assert horizontal["polar_slope"] == pytest.approx(polar_slope(prepared().polar, at.wind_mps))
    assert horizontal["rate_per_s"] == pytest.approx(horizontal_line(prepared()))
    assert "60" in horizontal["refused"]
    assert "at 2 % of turbulence" in result.flown
    assert "5° to 45°" in result.flown
    assert [each.claim for each in result.changed] == [
        "drift",
        "oscillation",
        "oscillation, drift: more, and about the least",
        "a line that leans downwind",
    ]
    assert result.seeds == tuple(range(1, 9))


def test_the_figure_leaves_out_leans_that_lost_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(curves_figures, "curves_figure", lambda *given, **_: drawn.append(given))

    def answer(job: ScenarioJob) -> FlownScenario:
        lost = job.scenario.lines["b"].lean_deg == -10.0 and "RHO_SPEED" in job.scenario.parameters
        return one_of(flown(job).legs[0].rms_e_rho_m, "hit the board" if lost else "", 1)

    result = lean(Context(flyer=ScriptedFlyer(answer), figures=tmp_path, quick=True))
    assert result.figures == ("lean.png",)
    ((path, panels, _),) = drawn
    assert path == tmp_path / "lean.png"
    about, drift, along = panels
    assert [curve.label for curve in about.series] == [table.title for table in result.tables]
    assert about.series[0].x == [-10.0, 20.0, 50.0]
    assert about.series[1].x == [20.0, 50.0]
    assert about.series[2].y == pytest.approx([3.0, 1.5, 1.0])
    assert drift.series[0].y == pytest.approx([0.0] * 3)
    assert along.series[0].y == pytest.approx([4.0] * 3)
    formula = along.series[-1]
    assert formula.label == "formula"
    scores = next(iter(result.numbers["leans"].values()))
    assert formula.y == pytest.approx([100.0 * s["dispersion_formula_m"] for s in scores])
    assert [mark.x for mark in about.marks] == [result.numbers["perpendicular_lean_deg"], 0.0]
    assert all(panel.y_log for panel in panels)

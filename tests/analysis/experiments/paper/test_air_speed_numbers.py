"""Faster and slower air: what is flown, what is read from paths and legs that are written by hand,
and each claim on both sides of its bound."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf, isnan, nan, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from by_hand import ScriptedFlyer, flight, leg, signs
from test_air_speed import speed_score

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper.air_speed import (
    FIXED,
    SCHEDULED,
    Growth,
    SpeedScore,
    growth,
    rings,
    score_speed,
    speed,
    speed_claims,
    speed_why,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.experiments.scenario import prepare
from tgl_soar.analysis.report import curves_figure as curves_figures

GAINS = ("RHO_P", "RHO_I", "RHO_D", "RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU")

# --- one place ----------------------------------------------------------------------------------


def turned(rate_radps: float, **figures: Any) -> FlownScenario:
    """Pitch goes up and down by steps of a tenth of a second at that rate, and wildly until the
    leg is scored, five seconds after its beginning at two."""
    time = np.arange(0.0, 22.001, 0.1)
    rates = np.where((time // 1.0) % 2 == 0, rate_radps, -rate_radps)
    rates[time < 6.95] = 9.0
    pitch = np.concatenate([[0.0], np.cumsum(0.1 * rates[:-1])])
    one = leg(begin_s=2.0, end_s=22.0, scored_s=15.0, **figures)
    return flight(one, path={"time_s": time, "pitch_rad": pitch})


def test_a_places_figures_are_the_roots_of_mean_squares_over_its_flights() -> None:
    flights = [
        turned(0.1, rms_e_rho_m=0.05, mean_e_rho_m=0.03, rms_y_m=0.3, rms_bank_rad=0.01),
        turned(0.2, rms_e_rho_m=0.05, mean_e_rho_m=-0.04, rms_y_m=0.4, rms_bank_rad=0.07),
    ]
    found = score_speed(flights, "a", 8.5)
    assert (found.line, found.wind_mps, found.flights, found.survived) == ("a", 8.5, 2, 2)
    assert found.rms_e_rho_m == pytest.approx(0.05)
    # About each flight's mean: 4 and 3 cm.
    assert found.oscillation_m == pytest.approx(sqrt((0.04**2 + 0.03**2) / 2.0))
    # 0.0016 and 0.0009: their mean 0.00125, its error 0.00035, of the root half of that.
    assert found.error == pytest.approx(0.5 * 0.00035 / 0.00125)
    assert found.rms_y_m == pytest.approx(sqrt(0.125))
    assert found.rms_bank_rad == pytest.approx(0.05)
    assert found.rms_pitch_rate_radps == pytest.approx(sqrt(0.025), rel=0.06)


def test_a_mean_beyond_the_rms_leaves_no_oscillation() -> None:
    """By rounding alone: nothing is negative under the root."""
    assert score_speed([turned(0.1, rms_e_rho_m=0.02, mean_e_rho_m=0.03)], "a", 8.0)[5] == 0.0


def test_a_place_that_lost_one_has_no_rms_but_a_bank() -> None:
    lost = replace(turned(0.1), ended="hit the board")
    for other in (lost, flight()):  # and one without a leg
        found = score_speed([turned(0.1), other], "a", 8.0)
        assert (found.flights, found.survived) == (2, 1)
        assert (found.rms_e_rho_m, found.oscillation_m, found.error) == (inf, inf, inf)
        assert found.rms_bank_rad == pytest.approx(0.02)
    nothing = score_speed([lost], "a", 8.0)
    assert isnan(nothing.rms_bank_rad)
    assert isnan(nothing.rms_pitch_rate_radps)


# --- growth -------------------------------------------------------------------------------------


def at(oscillation_m: float, error: float = 0.05) -> SpeedScore:
    return speed_score(8.0, oscillation_m)._replace(error=error)


def test_growth_is_from_the_first_place_to_the_last_with_both_errors() -> None:
    found = growth([at(0.02, 0.03), at(0.5, 9.0), at(0.03, 0.04)])
    assert found.ratio == pytest.approx(1.5)
    assert found.error == pytest.approx(1.5 * 0.05)


@pytest.mark.parametrize(
    ("slow_m", "fast_m", "ratio"), [(inf, 0.02, 0.0), (0.02, inf, inf), (inf, inf, nan)]
)
def test_losses_are_known_for_certain(slow_m: float, fast_m: float, ratio: float) -> None:
    found = growth([at(slow_m), at(fast_m)])
    assert found.ratio == ratio or (isnan(found.ratio) and isnan(ratio))
    assert found.error == 0.0
    assert found.shown is (ratio == inf)
    assert found.decided is (ratio == inf)


@pytest.mark.parametrize(
    ("ratio", "decided"),
    [(1.25, True), (1.23, None), (1.0, None), (0.77, None), (0.75, False)],
)
def test_growth_is_decided_beyond_two_and_four_tenths_of_its_errors(
    ratio: float, decided: bool | None
) -> None:
    """An error of 0.1 reaches 0.24 to either side."""
    assert Growth(ratio, 0.1).decided is decided
    assert Growth(ratio, 0.1).shown is (decided is True)


@pytest.mark.parametrize(("most_m", "does"), [(0.0099, False), (0.01, False), (0.0101, True)])
def test_a_loop_rings_beyond_a_centimetre_at_any_place(most_m: float, does: bool) -> None:
    assert rings([at(0.001), at(most_m), at(0.002)]) is does
    assert rings([at(nan)])
    assert rings([at(0.001), at(inf)])


def words(slow: SpeedScore, fast: SpeedScore) -> tuple[str, str]:
    """Of the gains in turbulence, and of gains that make it ring."""
    pair = [slow, fast]
    first, second = speed_claims({"with": pair}, {2.0: pair})
    return first.measured, second.measured


def test_words_say_what_is_known_of_a_growth() -> None:
    lost = speed_score(8.0, 0.02, survived=7)
    ratio, rising = words(at(0.02), at(0.03))
    assert ratio == "in turbulence, fastest over slowest place 1.50 ± 0.11"
    assert rising == "fastest over slowest place: 1.50 ± 0.11 at × 2, where it grows"
    assert words(at(0.02), at(0.01))[1].endswith("0.50 ± 0.04 at × 2, where it falls")
    assert words(at(0.02), at(0.021))[1].endswith("where it shows no trend")
    assert "of too few flights to know it" in words(at(0.02, inf), at(0.03))[0]
    assert words(lost, at(0.02))[1].endswith(
        "flights lost at the slowest place at × 2, where it falls"
    )
    assert words(at(0.02), lost)[1].endswith(
        "flights lost at the fastest place at × 2, where it grows"
    )
    assert words(lost, lost)[1].endswith(
        "flights lost at both ends at × 2, where it is not to be told"
    )
    assert words(at(0.001), at(0.002))[1] == "no gain tried made it ring"


def test_every_gain_that_rings_must_grow() -> None:
    grows, falls, quiet = [at(0.02), at(0.03)], [at(0.03), at(0.02)], [at(0.003), at(0.001)]
    open_one = [at(0.02), at(0.022)]
    for calm, sign in (
        ({1.0: quiet, 3.0: grows}, "✓"),
        ({1.0: quiet, 3.0: grows, 4.0: falls}, "✗"),
        ({3.0: grows, 4.0: open_one}, "?"),
        ({1.0: quiet}, "✗"),
    ):
        assert signs(speed_claims({}, calm)) == sign


def test_the_reasons_name_every_trend_and_every_loss_in_calm_air() -> None:
    grows, falls = [at(0.02), at(0.03)], [at(0.03), at(0.02)]
    text = speed_why({"with": grows}, {"with": falls}, {1.0: grows})
    assert (
        "with accelerometers the oscillation grows (1.50 ± 0.11), with the schedule it falls"
        in (text)
    )
    assert text.endswith("In calm air none was lost.")
    lost = speed_score(9.25, 0.02, survived=6)
    text = speed_why({"with": grows}, {"with": falls}, {3.0: [lost, lost], 1.0: grows})
    assert "In calm air were lost: 2 at 9.25 m/s with × 3; 2 at 9.25 m/s with × 3." in text


# --- the whole ----------------------------------------------------------------------------------


def flown(job: ScenarioJob) -> FlownScenario:
    """The farther down the alphabet, the more it oscillates: by centimetres; with accelerometers a
    half, in calm air a tenth of that times the gains' factor.  At [f] seed 8 is lost there."""
    given = job.scenario
    assert given.turbulence is not None
    more = 0.01 * (1 + "abcdef".index(given.first_line))
    if given.sensors.imu:
        more *= 0.5
    calm = given.turbulence.intensity == 0.0
    if calm:
        more *= 0.1 * given.parameters["RHO_P"] / prepare(base()).values["RHO_P"]
    one = leg(given.first_line, rms_e_rho_m=more, mean_e_rho_m=0.0, end_s=20.0, scored_s=15.0)
    time = np.arange(0.0, 20.0, 0.1)
    lost = calm and given.first_line == "f" and job.seed == 8
    return flight(
        one,
        seed=job.seed,
        ended="left the air" if lost else "",
        path={"time_s": time, "pitch_rad": 0.1 * time},
    )


@cache
def base() -> Any:
    return Context(flyer=ScriptedFlyer(flown)).scenario("speed")


@cache
def concluded(quick: bool = False) -> tuple[Result, list[ScenarioJob]]:
    flyer = ScriptedFlyer(flown)
    return speed(Context(flyer=flyer, quick=quick)), flyer.jobs


def test_every_place_is_flown_with_each_sensor_and_each_gain() -> None:
    usual = prepare(base()).values
    kinds: dict[tuple[bool, float, float, float], list[tuple[str, int]]] = {}
    for job in concluded()[1]:
        given = job.scenario
        assert given.turbulence is not None
        of = given.parameters
        raised = {name: of[name] / usual[name] for name in GAINS if name in of}
        factor = raised.get("RHO_P", 0.0)
        assert list(raised.values()) == pytest.approx([factor] * len(raised))
        assert len(raised) in (0, 6)
        assert (given.duration_s, given.turbulence.intensity) == (
            (20.0, 0.0) if raised else (30.0, 0.02)
        )
        key = (given.sensors.imu, of["RHO_SPEED"], round(factor, 3), given.duration_s)
        kinds.setdefault(key, []).append((given.first_line, job.seed))
    every = [(line, seed) for line in "abcdef" for seed in range(1, 9)]
    assert set(kinds) == {
        *((imu, gains, 0.0, 30.0) for imu in (False, True) for gains in (0.0, 8.5)),
        *((False, 0.0, factor, 20.0) for factor in (1.0, 2.0, 3.0, 4.0)),
    }
    assert all(sorted(flights) == every for flights in kinds.values())


def test_a_quick_one_flies_both_ends_and_two_gains() -> None:
    jobs = concluded(quick=True)[1]
    assert {job.scenario.first_line for job in jobs} == {"a", "f"}
    assert {job.seed for job in jobs} == {1}
    assert len(jobs) == 2 * (4 + 2)
    assert list(concluded(quick=True)[0].numbers["calm"]) == ["1.0", "3.0"]


def test_speeds_tables_have_a_row_for_each_place() -> None:
    turbulent, calm = concluded()[0].tables
    assert [row[:3] for row in turbulent.rows] == [
        (imu, kind, line)
        for imu in ("without", "with")
        for kind in (FIXED, SCHEDULED)
        for line in "abcdef"
    ]
    assert turbulent.rows[0][3] == "0.825"
    assert turbulent.rows[0][5:] == ("8 of 8", "1.00", "1.00", "10.0", "1.1", "0.0")
    assert turbulent.rows[17][6:8] == ("3.00", "3.00")
    assert [row[0] for row in calm.rows] == list("abcdef")
    assert calm.columns[2:] == ("× 1", "× 2", "× 3", "× 4")
    assert calm.rows[1][2:] == ("0.20", "0.40", "0.60", "0.80")
    assert calm.rows[5][2:] == ("1 of 8 lost",) * 4
    for table in (turbulent, calm):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    assert turbulent.title == "2 % of turbulence"


def test_speeds_claims_and_numbers_are_of_these_places() -> None:
    result = concluded()[0]
    assert signs(result.claims) == "✓✓✓"
    assert "6.00 ± 0.00" in result.claims[0].measured
    assert "(without accelerometers)" in result.claims[0].text
    assert "(with accelerometers)" in result.claims[1].text
    assert list(result.numbers["turbulence"]) == [
        f"{kind}, accelerometers {imu}"
        for kind in (FIXED, SCHEDULED)
        for imu in ("without", "with")
    ]
    assert list(result.numbers["calm"]) == ["1.0", "2.0", "3.0", "4.0"]
    assert [each.claim for each in result.changed] == [
        "oscillation grows downstream",
        "oscillation; where the loop rings",
        "places",
    ]
    assert "1 at" in result.why
    assert "with × 4" in result.why
    assert result.seeds == tuple(range(1, 9))


def test_the_figure_leaves_out_places_that_lost_one_and_is_in_centimetres(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(curves_figures, "curves_figure", lambda *given: drawn.append(given))
    result = speed(Context(flyer=ScriptedFlyer(flown), figures=tmp_path))
    assert result.figures == ("speed.png",)
    ((path, (turbulent, calm), _),) = drawn
    assert path == tmp_path / "speed.png"
    assert [curve.label for curve in turbulent.series] == [
        f"{kind}, {imu} accelerometers"
        for imu in ("without", "with")
        for kind in (FIXED, SCHEDULED)
    ]
    assert turbulent.series[0].y == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert turbulent.series[0].x == sorted(turbulent.series[0].x)
    assert [curve.label for curve in calm.series] == [f"outer gains × {f}" for f in (1, 2, 3, 4)]
    assert calm.series[1].y == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    assert turbulent.y_from_zero
    assert calm.y_log

"""What accelerometers are worth: which flights are asked for, each claim on both sides of its
bound, and the tables, of flights that are written by hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cache
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from by_hand import ScriptedFlyer, signs

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates import estimator as module
from tgl_soar.analysis.experiments.estimates.estimator import (
    PLAIN_FASTER,
    SAME_GAINS,
    _plan,
    _survival,
    estimator,
    least_margins,
    margin_words,
)
from tgl_soar.analysis.experiments.estimates.estimator_flights import (
    ASKED,
    IMU,
    LAB,
    PLAIN,
    EstimatorFlight,
    Ratios,
    Scored,
    WatchedFlight,
    gains_exchanged,
    paired_difference,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.report import curves_figure as curves_figures

TRACKED = "OptiTrack's attitude, {} ms late"
LATE = "accelerations, position {} ms late"


@pytest.fixture(autouse=True)
def margins_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the linear model takes a second for: it is less with other gains, and the line's loop is
    the worse one without accelerations, the elevator's with them."""

    def margins_with(case: Any, changes: Any) -> list[Any]:
        worse, better = (0.5, 0.9) if changes else (0.7, 0.8)
        worse += 0.01 * case.inertial
        elevator, line = (worse, better) if case.inertial else (better, worse)
        loops = {"elevator": elevator, "line": line}
        return [SimpleNamespace(**{k: SimpleNamespace(alpha=v) for k, v in loops.items()})]

    monkeypatch.setattr(module, "margins_with", margins_with)


# --- what is flown ------------------------------------------------------------------------------


def alike(flights: list[EstimatorFlight]) -> EstimatorFlight:
    """What they have in common, under the first line and seed."""
    (common,) = {flight._replace(line="a", seed=1) for flight in flights}
    return common


def usual(sensors: Any, **what: Any) -> EstimatorFlight:
    return EstimatorFlight(line="a", seed=1, sensors=sensors, **what)


def over(flights: list[EstimatorFlight], seeds: int, lines: str = "abc") -> bool:
    """Whether there is one of each line and seed."""
    each = Counter((flight.line, flight.seed) for flight in flights)
    return each == Counter((line, seed) for line in lines for seed in range(1, seeds + 1))


def test_flights_that_are_watched_last_twenty_seconds_with_what_is_asked_of_them() -> None:
    plan = _plan(quick=False)
    assert plan.lines == ("a", "b", "c")
    assert plan.seeds == tuple(range(1, 33))
    assert list(plan.watched) == list(ASKED)
    for name, flights in plan.watched.items():
        assert over(flights, 3)
        assert alike(flights) == usual(ASKED[name].sensors, duration_s=20.0)
    assert plan.through == usual(IMU, turbulence=0.01, duration_s=20.0, reception="with one gap")


@pytest.mark.parametrize(
    ("name", "seeds", "flight"),
    [
        ("accelerations, gaps", 32, usual(
            IMU, turbulence=0.01, duration_s=21.0, reception="with gaps")),
        ("plain, gaps", 8, usual(PLAIN, turbulence=0.01, duration_s=21.0, reception="with gaps")),
        ("laboratory's chain", 8, usual(
            PLAIN._replace(position=LAB), reception="the laboratory's")),
    ],
)  # fmt: skip
def test_flights_whose_fixes_are_corrupted(name: str, seeds: int, flight: EstimatorFlight) -> None:
    corrupted = _plan(quick=False).corrupted
    assert over(corrupted[name], seeds)
    assert alike(corrupted[name]) == flight
    assert len(corrupted) == 6


@pytest.mark.parametrize(
    ("name", "sensors", "delay_s"),
    [
        (TRACKED.format("15"), PLAIN, 0.015),
        (TRACKED.format("35"), PLAIN, 0.035),
        ("accelerations, " + TRACKED.format("15"), IMU, 0.015),
    ],
)
def test_flights_with_a_trackers_attitude(name: str, sensors: Any, delay_s: float) -> None:
    flights = _plan(quick=False).corrupted[name]
    assert over(flights, 8)
    flight = alike(flights)
    assert flight.tracked is not None
    assert flight.tracked.delay_s == delay_s
    assert flight._replace(tracked=None) == usual(sensors)


@pytest.mark.parametrize(
    ("name", "seeds", "flight"),
    [
        ("plain", 32, usual(PLAIN)),
        ("accelerations", 32, usual(IMU)),
        (SAME_GAINS, 32, usual(IMU, changes=gains_exchanged(True))),
        (PLAIN_FASTER, 32, usual(PLAIN, changes=gains_exchanged(False))),
        ("laboratory's fixes", 8, usual(PLAIN._replace(position=LAB))),
        ("laboratory's fixes, accelerations", 8, usual(IMU._replace(position=LAB))),
        *(
            (
                LATE.format(f"{1e3 * late_s:g}"),
                8,
                usual(IMU._replace(position=IMU.position._replace(delay_s=late_s))),
            )
            for late_s in (0.0, 0.04, 0.08, 0.12)
        ),
        *((f"plain, gains × {k:g}", 8, usual(PLAIN, scale=k)) for k in (0.5, 1.8)),
        *((f"accelerations, gains × {k:g}", 8, usual(IMU, scale=k)) for k in (0.5, 1.8)),
    ],
)
def test_flights_that_are_only_scored(name: str, seeds: int, flight: EstimatorFlight) -> None:
    scored = _plan(quick=False).scored
    assert over(scored[name], seeds)
    assert alike(scored[name]) == flight
    assert len(scored) == 16


def test_rough_flights_last_a_minute_at_the_slowest_place() -> None:
    for name, sensors in (("plain, rough", PLAIN), ("accelerations, rough", IMU)):
        flights = _plan(quick=False).scored[name]
        assert over(flights, 135, "a")
        assert alike(flights) == usual(sensors, turbulence=0.05, duration_s=60.0)


def test_a_quick_one_flies_one_seed_at_one_place() -> None:
    plan = _plan(quick=True)
    lists = [*plan.watched.values(), *plan.corrupted.values(), *plan.scored.values()]
    assert len(lists) == 24
    assert all(over(flights, 1, "a") for flights in lists)


# --- what becomes of them -----------------------------------------------------------------------


def scored(e_rho_m: float, activity_ps: float = 1.0, ended: str = "") -> Scored:
    return Scored(
        duration_s=30.0,
        ended=ended,
        e_rho_m2=e_rho_m**2,
        activity_2ps2=activity_ps**2,
        y_m2=0.12**2,
        bank_rad2=0.02**2,
    )


def watched_flight(
    flight: EstimatorFlight, error_m: float = 0.002, error_mps: float = 0.02
) -> WatchedFlight:
    """Height and climb so much too high, with accelerations; twice as much without."""
    time = np.arange(10.03, 20.0, 0.1)
    truth = np.column_stack([np.full((len(time), 6), 1.0) * [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
    read = {}
    for imu, times in ((True, 1.0), (False, 2.0)):
        errors = times * np.array([0.0, 0.0, error_m, 0.0, 0.0, error_mps])
        sigmas = np.tile([0.01, 0.1], (len(time), 1))
        read[imu] = np.column_stack([truth + errors, sigmas])
    return WatchedFlight(
        flight=flight, duration_s=20.0, ended="", time_s=time, truth=truth, read=read
    )


Answer = Callable[[EstimatorFlight], Any]


def good(flight: EstimatorFlight) -> Any:
    """Half the rms e_rho with accelerations, for 1.4 times the activity."""
    if flight.duration_s == 20.0:
        return watched_flight(flight)
    if flight.sensors.imu is not None:
        return scored(0.005, 1.4)
    return scored(0.010)


def concluded(answer: Answer, quick: bool = True) -> Result:
    return estimator(Context(flyer=ScriptedFlyer(answer), quick=quick))


def but(is_one: Callable[[EstimatorFlight], bool], other: Scored) -> Answer:
    """As the good ones, but for some."""
    return lambda flight: other if is_one(flight) else good(flight)


def is_usual(flight: EstimatorFlight) -> bool:
    """With accelerations and nothing else of its own."""
    return flight == usual(IMU)


@cache
def good_result() -> Result:
    return concluded(good, quick=False)


def test_what_is_half_as_wrong_agrees_in_everything() -> None:
    result = good_result()
    assert signs(result.claims) == "✓" * 10
    assert result.verdict == "agrees"
    assert result.claims[0].measured == "5.0 of 10.0 mm: 0.50"
    assert "96 flights each" in result.claims[0].text
    assert "135 pairs" in result.claims[3].text
    assert result.claims[3].measured.startswith("135 against 135; difference +0.00 %")
    assert result.claims[4].measured == "0 %; 0 of 96 flights lost"
    assert result.claims[5].measured == "0 of 96; without accelerations 0 of 24"
    assert result.claims[6].measured == "2.0 mm, 2.0 cm/s"
    assert result.claims[8].measured == "0 of 24 lost; rms e_rho 10.0 mm, 1.00 of the plain law's"
    assert result.seeds == tuple(range(1, 33))
    assert [each.claim for each in result.changed] == ["survivors at 5 %", "EST_FIX_SD"]


@pytest.mark.parametrize(
    ("claim", "is_one", "at_most", "more"),
    [
        (0, is_usual, scored(0.0059), scored(0.0061)),
        (1, is_usual, scored(0.005, 1.49), scored(0.005, 1.51)),
        (4, lambda f: f.sensors.position.delay_s == 0.12, scored(0.00595), scored(0.00605)),
        (4, lambda f: f.sensors.position.delay_s == 0.08, scored(0.00595), scored(0.00605)),
        (
            9,
            lambda f: f.tracked and f.tracked.delay_s == 0.015 and not f.sensors.imu,
            scored(0.0119),
            scored(0.0121),
        ),
    ],
)
def test_a_ratio_may_be_its_bound_and_no_more(
    claim: int, is_one: Callable[[EstimatorFlight], bool], at_most: Scored, more: Scored
) -> None:
    """Of 0.6 in e_rho, 1.5 in activity, 1.2 by latency and by a tracker's attitude."""
    assert concluded(but(is_one, at_most)).claims[claim].holds
    assert not concluded(but(is_one, more)).claims[claim].holds


def test_a_ratio_that_is_its_bound_is_met() -> None:
    """Figures whose quotients are the bounds to the last bit: 3 / 5, 3.6 / 3 and 6 / 5."""

    def answer(flight: EstimatorFlight) -> Any:
        if flight.duration_s == 20.0:
            return watched_flight(flight)
        if flight.sensors.imu is not None:
            late = flight.sensors.position.delay_s == 0.12
            return scored(3.6 if late else 3.0, 1.5)
        return scored(6.0 if flight.tracked else 5.0)

    assert signs(concluded(answer).claims) == "✓" * 10


@pytest.mark.parametrize(
    ("claim", "is_one"),
    [
        (0, lambda f: f == usual(PLAIN)),
        (2, lambda f: f.scale == 0.5 and f.sensors.imu is None),
        (2, lambda f: f.scale == 1.8 and f.sensors.imu is not None),
        (4, lambda f: f.sensors.position.delay_s == 0.08),
        (5, lambda f: f.reception == "with gaps" and f.sensors.imu is not None),
        (8, lambda f: f.reception == "the laboratory's"),
    ],
)
def test_a_loss_breaks_its_claim_and_no_other(
    claim: int, is_one: Callable[[EstimatorFlight], bool]
) -> None:
    def lost(flight: EstimatorFlight) -> Any:
        found = good(flight)
        return found._replace(ended="hit the board") if is_one(flight) else found

    claims = concluded(lost).claims
    assert [i for i, each in enumerate(claims) if not each.holds] == [claim]


def test_losses_of_the_first_claim_are_named() -> None:
    def lost(flight: EstimatorFlight) -> Any:
        found = good(flight)
        return found._replace(ended="hit the board") if flight == usual(PLAIN) else found

    assert concluded(lost).claims[0].measured == (
        "5.0 of 10.0 mm: 0.50; 0 of 1 lost, 1 of 1 without"
    )


def test_survivors_are_compared_pair_by_pair() -> None:
    """Of 10: six both, two plain alone, one with accelerations alone, one neither."""
    alive, dead = scored(0.01), scored(nan, ended="hit the board")
    plain = [alive] * 8 + [dead] * 2
    accelerations = [alive] * 6 + [dead] * 2 + [alive, dead]
    found = _survival(plain, accelerations)
    assert (found.pairs, found.plain, found.accelerations) == (10, 8, 7)
    assert found.difference == pytest.approx(-0.1)
    assert found.interval == paired_difference(6, 2, 1, 1)


@pytest.mark.parametrize(("inertial", "holds"), [(True, False), (False, True)])
def test_as_many_must_survive_with_accelerations(inertial: bool, holds: bool) -> None:
    def rough(flight: EstimatorFlight) -> bool:
        return flight.turbulence == 0.05 and (flight.sensors.imu is not None) is inertial

    result = concluded(but(rough, scored(nan, ended="hit the board")))
    assert result.claims[3].holds is holds
    sign = "-100.00 %" if inertial else "+100.00 %"
    assert f"difference {sign}" in result.claims[3].measured
    difference = -1.0 if inertial else 1.0
    assert result.numbers["survival"]["difference"] == difference


@pytest.mark.parametrize(
    ("error_m", "error_mps", "found"),
    [
        (0.0029, 0.029, (True, True)),
        (0.0031, 0.029, (False, True)),
        (0.0029, 0.031, (False, True)),
        (0.0149, 0.079, (False, True)),
        (0.0151, 0.079, (False, False)),
        (0.0149, 0.081, (False, False)),
    ],
)
def test_place_and_speed_are_both_asked_for(
    error_m: float, error_mps: float, found: tuple[bool, bool]
) -> None:
    def answer(flight: EstimatorFlight) -> Any:
        watched = flight.duration_s == 20.0
        return watched_flight(flight, error_m, error_mps) if watched else good(flight)

    claims = concluded(answer).claims
    assert (claims[6].holds, claims[7].holds) == found


def test_ratios_are_against_the_plain_law_in_the_same_air() -> None:
    """Seed by seed: in the second air both are twice as wrong, and only eight seeds are flown."""

    def answer(flight: EstimatorFlight) -> Any:
        found = good(flight)
        if isinstance(found, WatchedFlight):
            return found
        return found._replace(e_rho_m2=flight.seed * found.e_rho_m2)

    numbers = concluded(answer, quick=False).numbers["of plain"]
    assert numbers[LATE.format("80")]["e_rho"] == pytest.approx(0.5)
    assert numbers["laboratory's chain"]["e_rho"] == pytest.approx(1.0)
    assert numbers["plain"]["e_rho"] == pytest.approx(1.0)
    # Those in other air are held against nothing.
    apart = {"plain, rough", "accelerations, rough", "plain, gaps", "accelerations, gaps"}
    scores = concluded(answer).numbers["scores"]
    assert set(scores) - set(numbers) == apart


# --- tables and words ---------------------------------------------------------------------------


def test_the_tables_have_a_row_for_each_kind_of_flight_and_of_fixes() -> None:
    flown, estimates = good_result().tables
    rows = {row[0]: row[1:] for row in flown.rows}
    assert len(rows) == len(flown.rows) == 22
    assert rows["accelerations"] == ("3 %", "96", "0", "5.0", "0.50", "1.40", "12.0", "1.1")
    assert rows["plain, rough"] == ("5 %", "135", "0", "10.0", "", "", "12.0", "1.1")
    assert rows["plain, gaps"][0] == "1 %"
    first, second = ASKED
    assert estimates.rows == (
        (first, "yes", "2.0", "2.0", "0.01", "0.01"),
        (first, "no", "4.0", "4.0", "0.05", "0.05"),
        (second, "yes", "2.0", "2.0", "0.01", "0.01"),
        (second, "no", "4.0", "4.0", "0.05", "0.05"),
    )
    for table in (flown, estimates):
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_the_gain_is_split_into_sensor_and_gains() -> None:
    words = good_result().why
    assert "the sensor alone, with the plain law's gains, 0.50 of" in words
    assert "the gains alone, without the sensor, 1.00 of" in words
    assert "both 0.50 of the plain law's rms e_rho, for 1.40 of its elevator activity" in words


@pytest.mark.parametrize(
    ("both", "equal"), [(0.74, True), (0.66, True), (0.76, False), (0.64, False)]
)
def test_margins_are_equal_within_a_twentieth(both: float, equal: bool) -> None:
    least = {"plain": 0.70, "accelerations": both, SAME_GAINS: 0.8, PLAIN_FASTER: 0.3}
    words = margin_words(least, {"accelerations": Ratios(0.45, 1.4)})
    assert ("So at equal margin" in words) is equal
    assert ("nothing was flown" in words) is not equal
    assert "at 8.5 m/s, 15° and 7.5 ms" in words
    assert "the plain law 0.70, the sensor alone 0.80, the gains alone 0.30, both 0." in words


def test_the_least_margin_is_of_the_worse_loop_of_each_law() -> None:
    assert least_margins() == pytest.approx(
        {"plain": 0.7, "accelerations": 0.71, SAME_GAINS: 0.51, PLAIN_FASTER: 0.5}
    )


def test_a_gap_is_drawn_in_centimetres_within_two_sigmas(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(curves_figures, "curves_figure", lambda *given: drawn.append(given))

    result = estimator(Context(flyer=ScriptedFlyer(good), quick=True, figures=tmp_path))
    assert result.figures == ("estimator.png",)
    ((path, panels, title),) = drawn
    assert path == tmp_path / "estimator.png"
    assert title == "1.5 s without fixes at 1 % of turbulence"
    assert [panel.title for panel in panels] == [
        "with accelerations",
        "without",
        "with accelerations",
    ]
    assert [panel.y_label for panel in panels] == ["height [cm]", "height [cm]", "climb [m/s]"]
    for panel, read, sigma, truth in zip(
        panels, (300.2, 300.4, 6.02), (1.0, 1.0, 0.1), (300.0, 300.0, 6.0), strict=True
    ):
        high, low, estimate, true = panel.series
        assert estimate.y == pytest.approx([read] * len(estimate.x))
        assert high.y == pytest.approx([read + 2.0 * sigma] * len(high.x))
        assert low.y == pytest.approx([read - 2.0 * sigma] * len(low.x))
        assert true.y == pytest.approx([truth] * len(true.x))
        # From half a second before the last fix to 0.7 s after the next.
        assert (min(estimate.x), max(estimate.x)) == pytest.approx((13.53, 16.13))
        assert [mark.x for mark in panel.marks] == [14.0, 15.5]

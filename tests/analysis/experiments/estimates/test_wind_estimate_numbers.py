"""Wind and updraft as read on board: which estimators watch a flight, how errors are scored,
and each claim on both sides of its bound."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import hypot, isnan, nan, radians, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from by_hand import ScriptedFlyer, signs

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates import wind_estimate as module
from tgl_soar.analysis.experiments.estimates.wind_estimate import (
    CASES,
    WITH_PITOT,
    WITHOUT,
    ObservedFlight,
    WindFlight,
    WindScore,
    _place,
    honest_claim,
    look_on,
    plain_rms,
    score,
    timid_claim,
    wind_estimate,
    wrong_wing,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.report import curves_figure as curves_figures
from tgl_soar.estimation.wind import wind_step
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.types import NO_AERODYNAMICS, NO_AIRSPEED, NO_IMU, polar_sink

SHORT = WindFlight(lines=("b",), seed=1, leg_s=0.3, cases=tuple(CASES))


# --- estimators ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "imu", "pitot", "wrong"),
    [
        ("accelerometers, pitot", True, True, False),
        ("accelerometers", True, False, False),
        ("pitot", False, True, False),
        ("neither", False, False, False),
        ("accelerometers, pitot; wing wrong", True, True, True),
        ("accelerometers; wing wrong", True, False, True),
    ],
)
def test_an_estimator_has_the_sensors_and_the_wing_of_its_name(
    name: str, imu: bool, pitot: bool, wrong: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(CASES) == 6
    assert (WITH_PITOT, WITHOUT) == ("accelerometers, pitot", "accelerometers")
    given: list[Any] = []

    def step(params: Any, state: Any, vehicle: Any, inputs: Any, *rest: Any) -> Any:
        given.append((params.aerodynamics, inputs))
        return wind_step(params, state, vehicle, inputs, *rest)

    monkeypatch.setattr(module, "wind_step", step)
    look_on(SHORT._replace(cases=(name,)))
    known = _place()[0].aerodynamics()
    assert {wing for wing, _ in given} == {wrong_wing(known, 1) if wrong else known}
    assert any(inputs.imu != NO_IMU for _, inputs in given) is imu
    assert any(inputs.airspeed != NO_AIRSPEED for _, inputs in given) is pitot
    assert all(inputs.engage and inputs.autopilot.armed for _, inputs in given)


def test_the_pitch_is_wrong_by_half_a_degree_up_in_odd_seeds_and_down_in_even_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pitches: list[float] = []

    def step(params: Any, state: Any, vehicle: Any, *rest: Any) -> Any:
        pitches.append(vehicle.pitch_rad)
        return wind_step(params, state, vehicle, *rest)

    monkeypatch.setattr(module, "wind_step", step)
    for seed, tilt_rad in ((1, radians(0.5)), (2, -radians(0.5)), (7, radians(0.5))):
        flight = SHORT._replace(seed=seed, cases=(WITHOUT,))
        pitches.clear()
        look_on(flight)
        tilted = np.array(pitches)
        with monkeypatch.context() as right:
            right.setattr(module, "PITCH_ERROR_RAD", 0.0)
            pitches.clear()
            look_on(flight)
        # At the first tick nothing is known yet.
        np.testing.assert_allclose((tilted - np.array(pitches))[1:], tilt_rad, atol=1e-12)


def test_an_estimator_is_given_the_elevator_of_the_tick_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    elevators: list[float] = []
    ordered: list[float] = []

    class Loop(ClosedLoop):
        def tick(self) -> Any:
            output = super().tick()
            ordered.append(output.command.elevator if output.active else nan)
            return output

    def step(params: Any, state: Any, vehicle: Any, inputs: Any, *rest: Any) -> Any:
        elevators.append(rest[1])
        assert len(elevators) <= 20 or rest[0] > 0.0  # how well the velocity is known
        assert rest[2]
        return wind_step(params, state, vehicle, inputs, *rest)

    monkeypatch.setattr(module, "ClosedLoop", Loop)
    monkeypatch.setattr(module, "wind_step", step)
    look_on(SHORT._replace(cases=(WITHOUT,)))
    assert isnan(elevators[0])
    np.testing.assert_array_equal(elevators[1:], ordered[:-1])
    assert len(set(elevators[1:])) > 3


def test_the_line_is_changed_after_each_leg(monkeypatch: pytest.MonkeyPatch) -> None:
    changed: list[tuple[int, float]] = []
    ticks = 0

    class Loop(ClosedLoop):
        def tick(self) -> Any:
            nonlocal ticks
            ticks += 1
            return super().tick()

        def change(self, values: dict[str, float]) -> None:
            changed.append((ticks, values["TGL_X"]))
            super().change(values)

    monkeypatch.setattr(module, "ClosedLoop", Loop)
    flown = look_on(SHORT._replace(lines=("a", "b", "c"), cases=(WITHOUT,)))
    assert [after for after, _ in changed] == [60, 120]
    assert [x_m for _, x_m in changed] == pytest.approx([0.60, 1.05])
    assert ticks == len(flown.time_s) == 180
    assert flown.duration_s == pytest.approx(0.9)
    np.testing.assert_allclose(flown.time_s, 0.005 * np.arange(180))
    # It begins where the site has it start, whatever the line.
    assert flown.read[WITHOUT].shape == (180, 7)
    assert flown.truth.shape == (180, 5)


def test_a_flight_that_does_not_fly_a_second_after_its_begin_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "is_flying", lambda _: False)
    flight = SHORT._replace(leg_s=1.5, cases=(WITHOUT,))
    assert len(look_on(flight).time_s) == 202  # the first tick beyond 200
    assert len(look_on(flight._replace(leg_s=0.9)).time_s) == 180


def test_a_crash_is_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TURBULENCE", 1.0)
    monkeypatch.setattr(module, "is_flying", lambda _: True)
    flown = look_on(SHORT._replace(leg_s=9.0, cases=(WITHOUT,)))
    assert len(flown.time_s) < 1800
    assert flown.duration_s == pytest.approx(len(flown.time_s) / 200.0)


def test_excess_updraft_is_by_the_sink_at_the_horizontal_airspeed() -> None:
    """From airspeed and climb through the air, and for the climb what is read of it."""
    flown = look_on(SHORT._replace(lines=("c",), leg_s=2.5, cases=(WITHOUT,)))
    polar = _place()[0].aerodynamics().polar
    airspeed, _, wind, updraft, excess = flown.truth[20:].T
    sink = updraft - excess
    climb = flown.plain[20:] - sink
    flat = np.sqrt(airspeed**2 - (updraft - climb) ** 2)
    np.testing.assert_allclose(sink, [polar_sink(polar, float(u)) for u in flat], atol=0.03)
    assert np.max(np.abs(flat - wind)) > 0.3  # it moves over the ground
    assert np.max(np.abs(climb)) < 1.5


def test_a_wrong_wing_lifts_and_drags_by_its_factors() -> None:
    """CL0 and CL_alpha by the same; the drag of lift at the same lift by the drag's."""
    wing = NO_AERODYNAMICS._replace(CL0=0.3, CL_alpha=5.0, CD0=0.02, CD_lift=0.05)
    for seed in (1, 2):
        found = wrong_wing(wing, seed)
        lift, drag = found.CL_alpha / 5.0, found.CD0 / 0.02
        assert pytest.approx(lift) == found.CL0 / 0.3
        assert found.CD_lift * found.CL_alpha**2 == pytest.approx(0.05 * 25.0 * drag)
        assert 0.9 <= lift <= 1.1
        assert 0.8 <= drag <= 1.2
    assert wrong_wing(wing, 1) != wrong_wing(wing, 2)


# --- what is scored -----------------------------------------------------------------------------

TRUTH = (9.0, 0.1, 8.5, 1.4, 0.2)


def observed(
    flight: WindFlight,
    errors: dict[str, float],
    duration_s: float = 12.0,
    plain_mps: float = 0.25,
    sigma: float = 0.1,
) -> ObservedFlight:
    """All five wrong by `errors`, the updraft by the plain estimate by `plain_mps`; wild before
    five seconds."""
    time = np.arange(0.0, duration_s, 0.05)
    wild = np.where(time < 4.999, 9.0, 0.0)
    truth = np.tile(TRUTH, (len(time), 1))
    read = {
        case: np.column_stack([truth + (error + wild)[:, None], np.full((len(time), 2), sigma)])
        for case, error in ((case, errors.get(case, 0.1)) for case in flight.cases)
    }
    return ObservedFlight(
        flight=flight,
        duration_s=duration_s,
        time_s=time,
        x_m=0.1 * time,
        truth=truth,
        plain=truth[:, 3] + plain_mps + wild,
        read=read,
    )


FLIGHT = WindFlight(lines=("a",), seed=1, leg_s=12.0, cases=("pitot", "neither"))


def test_a_score_is_over_all_flights_from_five_seconds_on() -> None:
    flights = [observed(FLIGHT, {"pitot": 0.3}), observed(FLIGHT, {"pitot": -0.1}, sigma=0.2)]
    found = score(flights, "pitot")
    root = sqrt(0.05)
    assert found[:4] == pytest.approx((root,) * 4)
    assert found.alpha_deg == pytest.approx(np.degrees(root))
    assert found.wind_normalised == pytest.approx((9.0 + 0.25) / 2.0)
    assert found.updraft_normalised == pytest.approx((9.0 + 0.25) / 2.0)
    assert score(flights, "neither").wind_mps == pytest.approx(0.1)


def test_each_figure_of_a_score_is_of_its_own_column() -> None:
    one = observed(FLIGHT, {})
    for column, error in enumerate((0.1, 0.02, 0.3, 0.4, 0.5)):
        one.read["pitot"][100:, column] = TRUTH[column] + error
    one.read["pitot"][:, 5:] = (0.1, 0.2)
    found = score([one], "pitot")
    assert found.airspeed_mps == pytest.approx(0.1)
    assert found.alpha_deg == pytest.approx(np.degrees(0.02))
    assert (found.wind_mps, found.updraft_mps, found.excess_mps) == pytest.approx((0.3, 0.4, 0.5))
    assert (found.wind_normalised, found.updraft_normalised) == pytest.approx((9.0, 4.0))


def test_where_the_polar_ends_the_plain_estimate_has_no_error() -> None:
    flights = [observed(FLIGHT, {}, plain_mps=0.3), observed(FLIGHT, {}, plain_mps=-0.1)]
    assert plain_rms(flights) == pytest.approx(sqrt(0.05))
    flights[0].plain[150:] = nan
    left = len(flights[0].time_s) - 100
    assert plain_rms(flights) == pytest.approx(
        sqrt((50 * 0.09 + left * 0.01) / (50 + left)), rel=1e-6
    )


# --- what is claimed ----------------------------------------------------------------------------

Answer = Callable[[WindFlight], ObservedFlight]


def good(flight: WindFlight) -> ObservedFlight:
    return observed(flight, {}, flight.leg_s * len(flight.lines))


def concluded(answer: Answer, quick: bool = True) -> Result:
    return wind_estimate(Context(flyer=ScriptedFlyer(answer), quick=quick))


@cache
def whole() -> tuple[Result, list[WindFlight]]:
    flyer = ScriptedFlyer(good)
    return wind_estimate(Context(flyer=flyer)), flyer.jobs


def test_each_line_is_flown_with_each_seed_and_all_of_them_once_to_be_drawn() -> None:
    *flights, tour = whole()[1]
    assert [(f.lines, f.seed) for f in flights] == [((p,), s) for p in "abc" for s in range(1, 33)]
    assert {(f.leg_s, f.cases, f.dispersed) for f in flights} == {(12.0, tuple(CASES), False)}
    assert tour == WindFlight(
        lines=("a", "b", "c"), seed=1, leg_s=12.0, cases=(WITH_PITOT, WITHOUT)
    )
    apart = ScriptedFlyer(good)
    wind_estimate(Context(flyer=apart, quick=True, dispersion=True))
    assert [(f.lines, f.seed, f.dispersed) for f in apart.jobs[:3]] == [
        (("a",), 1, True),
        (("a",), 2, True),
        (("b",), 1, True),
    ]
    assert len(apart.jobs) == 7
    assert apart.jobs[-1].dispersed


def test_ten_centimetres_a_second_agree_in_everything() -> None:
    result = whole()[0]
    assert signs(result.claims) == "✓✓✓✓"
    assert result.claims[0].measured == "0.100 m/s"
    assert result.claims[1].measured == "0.100 of 0.250 m/s: 0.40"
    assert "ended within" not in result.flown
    assert result.seeds == tuple(range(1, 33))
    assert [each.claim for each in result.changed] == [
        "the wrong wing",
        "the standard deviations are honest",
    ]
    assert result.numbers["plain_mps"] == pytest.approx(0.25)
    assert list(result.numbers["cases"]) == list(CASES)


@pytest.mark.parametrize(
    ("claim", "case", "at_most_mps", "more_mps"),
    [(0, WITH_PITOT, 0.149, 0.151), (1, WITHOUT, 0.174, 0.176)],
)
def test_the_updraft_is_known_to_what_is_asked(
    claim: int, case: str, at_most_mps: float, more_mps: float
) -> None:
    """0.15 m/s with a pitot tube, without one 0.7 of 0.25 m/s; σ as large as the error."""

    def with_error(error_mps: float) -> Answer:
        return lambda flight: observed(flight, {case: error_mps}, 12.0, sigma=0.12)

    assert concluded(with_error(at_most_mps)).claims[claim].holds
    worse = concluded(with_error(more_mps)).claims
    assert [i for i, each in enumerate(worse[:2]) if not each.holds] == [claim]


def normalised(wind: float, updraft: float) -> WindScore:
    return WindScore(
        wind_mps=0.1,
        updraft_mps=0.1,
        excess_mps=0.1,
        airspeed_mps=0.1,
        alpha_deg=1.0,
        wind_normalised=wind,
        updraft_normalised=updraft,
    )


@pytest.mark.parametrize(
    ("value", "honest", "timid"),
    [
        (2.0, True, True),
        (2.01, False, True),
        (1.0 / 3.0, True, True),
        (0.33, True, False),
        (nan, False, False),
    ],
)
def test_a_squared_error_is_a_third_of_its_variance_to_twice_it(
    value: float, honest: bool, timid: bool
) -> None:
    for one in (normalised(value, 1.0), normalised(1.0, value)):
        scores = {**dict.fromkeys(CASES, normalised(1.0, 1.0)), "pitot": one}
        assert honest_claim(scores).holds is honest
        assert timid_claim(scores).holds is timid


def test_those_that_are_too_large_for_the_right_wing_are_counted() -> None:
    usual, timid = normalised(1.0, 1.0), normalised(0.2, 1.0)
    scores = {**dict.fromkeys(CASES, usual), "pitot": timid, "accelerometers; wing wrong": timid}
    assert "; 1 of the 2 that are have the wing" in timid_claim(scores).measured
    assert "updraft 1.00, 1.00" in timid_claim(scores).measured
    assert timid_claim(scores).measured.startswith("wind 1.00, 1.00, 0.20,")
    wrong = {**dict.fromkeys(CASES, usual), "accelerometers; wing wrong": timid}
    assert "that are have" not in timid_claim(wrong).measured


@pytest.mark.parametrize(("early", "is_reported"), [(9, True), (10, False)])
def test_where_more_than_a_tenth_ended_early_nothing_is_claimed(
    early: int, is_reported: bool
) -> None:
    """Of 96 flights; six seconds are not enough."""

    def answer(flight: WindFlight) -> ObservedFlight:
        is_early = flight.lines == ("b",) and flight.seed <= early
        return observed(flight, {WITH_PITOT: 50.0} if is_early else {}, 6.0 if is_early else 12.0)

    result = concluded(answer, quick=False)
    assert signs(result.claims) == ("✓✓✓✓" if is_reported else "✗✗✗✗")
    assert f" {early} ended within 6 s: no figure has them." in result.flown
    lasted = f"of 96 flights {96 - early} lasted for 6 s"
    assert (result.claims[0].measured == lasted) is not is_reported


def test_a_flight_of_more_than_six_seconds_is_scored() -> None:
    result = concluded(lambda flight: observed(flight, {WITH_PITOT: 0.3}, 6.01))
    assert not result.claims[0].holds
    assert result.claims[0].measured == "0.300 m/s"
    none = concluded(lambda flight: observed(flight, {}, 5.9))
    assert none.claims[0].measured == "of 6 flights none lasted for 6 s"


def test_the_tables_go_by_estimator_and_by_place() -> None:
    def answer(flight: WindFlight) -> ObservedFlight:
        worse = 0.2 if flight.lines == ("c",) else 0.1
        return observed(flight, {WITHOUT: worse}, 12.0, 2.0 * worse)

    cases, by_place = concluded(answer).tables
    assert [row[0] for row in cases.rows] == [*CASES, "plain"]
    figures = ("0.100", "0.100", "0.35", "0.100", "0.100", "5.73", "1.00", "1.00")
    assert cases.rows[0][1:] == figures
    assert cases.rows[-1][2:4] == ("0.283", "1.00")
    assert by_place.rows == (
        ("a", "0.100", "0.100", "0.200"),
        ("b", "0.100", "0.100", "0.200"),
        ("c", "0.100", "0.200", "0.400"),
    )
    for table in (cases, by_place):
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_the_flight_that_is_drawn_is_shown_in_time_and_across_the_plane(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(curves_figures, "curves_figure", lambda *given: drawn.append(given))
    result = wind_estimate(Context(flyer=ScriptedFlyer(good), quick=True, figures=tmp_path))
    assert result.figures == ("wind_estimate.png",)
    ((path, panels, _),) = drawn
    assert path == tmp_path / "wind_estimate.png"
    for panel, value, last in zip(panels, (1.4, 8.5, 1.4), (35.5, 35.5, 3.55), strict=True):
        assert [curve.label for curve in panel.series] == [WITHOUT, WITH_PITOT, "truth"]
        read, _, truth = panel.series
        assert truth.y == pytest.approx([value] * len(truth.y))
        assert read.y == pytest.approx([value + 0.1] * len(read.y))
        # From the 200th row on every tenth: of 36 s.
        assert len(read.x) == 52
        assert read.x[-1] == pytest.approx(last)
    assert hypot(panels[2].series[0].x[0], 0.0) == pytest.approx(1.0)

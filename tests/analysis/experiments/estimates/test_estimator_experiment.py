"""What accelerometers are worth, in small: one seed, and the arithmetic of the verdict."""

from __future__ import annotations

import json
from itertools import pairwise
from math import comb, isnan, nan
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.analysis.experiments.catalogue import run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates.estimator import (
    MARGIN,
    PLAIN_FASTER,
    SAME_GAINS,
    _plan,
    least_margins,
    margin_claim,
    margin_words,
    split_words,
    tracked_claim,
)
from tgl_soar.analysis.experiments.estimates.estimator_flights import (
    ASKED,
    CALM,
    CHAIN,
    GAP_EVERY_S,
    GAP_S,
    IMU,
    LAB,
    ONE_GAP_S,
    PLAIN,
    TRACKED_ATTITUDE,
    Differences,
    EstimatorFlight,
    EstimatorScore,
    Known,
    Ratios,
    Scored,
    WatchedFlight,
    _ticks,
    _values,
    _world,
    fly_scored,
    fly_scored_compiled,
    gains_exchanged,
    in_gap,
    known,
    paired_difference,
    paired_ratios,
    score,
    watch,
)
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.result import as_json
from tgl_soar.sim import compiled_flight
from tgl_soar.sim.flight import fly_ticks
from tgl_soar.sim.sensors import AUTOPILOT_POSITION, Sensors
from tgl_soar.types import NO_FIX, PositionFix

FLIGHT_S = 12.0


def test_accelerations_are_worth_more_than_a_third_of_e_rho() -> None:
    """0.45 over 96 flights; of one flight the ratio is known to a tenth or so."""
    plain, imu = (
        score([fly_scored(EstimatorFlight(line="b", seed=2, sensors=sensors, duration_s=FLIGHT_S))])
        for sensors in (PLAIN, IMU)
    )
    assert plain.lost == imu.lost == 0
    assert imu.e_rho_m <= 0.6 * plain.e_rho_m
    assert imu.activity_ps <= 1.7 * plain.activity_ps


@pytest.mark.parametrize("name", ASKED)
def test_place_and_speed_are_known_as_well_as_is_asked(name: str) -> None:
    asked = ASKED[name]
    watched = watch(EstimatorFlight(line="c", seed=3, sensors=asked.sensors, duration_s=FLIGHT_S))
    assert not watched.ended
    with_them, without = known([watched], True), known([watched], False)
    assert with_them.position_mm <= asked.position_mm
    assert with_them.velocity_mmps <= asked.velocity_mmps
    assert with_them.velocity_mmps < without.velocity_mmps


def test_gaps_are_flown_through() -> None:
    watched = watch(
        EstimatorFlight(
            line="a",
            seed=1,
            sensors=IMU,
            turbulence=CALM,
            duration_s=ONE_GAP_S + GAP_S,
            reception="with one gap",
        )
    )
    assert not watched.ended
    sigma = watched.read[True][:, 6]
    gap = watched.time_s > ONE_GAP_S + 0.1
    assert all(b > a for a, b in pairwise(sigma[gap]))
    assert np.max(np.abs(watched.read[True][gap, :3] - watched.truth[gap, :3])) < 0.1


def test_the_laboratorys_chain_flies() -> None:
    flown = fly_scored(
        EstimatorFlight(
            line="a",
            seed=1,
            sensors=Sensors(position=LAB),
            duration_s=FLIGHT_S,
            reception="the laboratory's",
        )
    )
    assert flown.ended == ""
    assert flown.e_rho_m2 < 0.05**2


def test_a_trackers_attitude_is_what_flies_and_is_as_late_as_it_is_given() -> None:
    late = TRACKED_ATTITUDE._replace(delay_s=0.035)
    flight = EstimatorFlight(line="b", seed=2, sensors=PLAIN, duration_s=4.0, tracked=late)
    ages = [tick.inputs.time_s - tick.inputs.attitude.time_s for tick in _ticks(flight)]
    assert max(ages[100:380]) <= 0.005 + 1e-9  # the autopilot's, until poses have come for 2 s
    assert 0.035 - 1e-9 <= min(ages[500:]) <= max(ages[500:]) < 0.05
    unlike = [
        [tick.inputs.attitude.qy for tick in _ticks(each)][-1]
        for each in (flight, flight._replace(tracked=None))
    ]
    assert unlike[0] != unlike[1]


@pytest.mark.parametrize(
    ("lost", "ratio", "holds"), [(0, 1.19, True), (0, 1.21, False), (1, 1.0, False)]
)
def test_a_trackers_attitude_may_cost_a_fifth_and_no_flight(
    lost: int, ratio: float, holds: bool
) -> None:
    name = "OptiTrack's attitude, 15 ms late"
    flown = EstimatorScore(
        flights=24, lost=lost, e_rho_m=0.014, activity_ps=1.0, y_m=0.1, bank_rad=0.1
    )
    assert tracked_claim({name: flown}, {name: Ratios(ratio, 1.0)}).holds is holds


def test_laws_are_compared_at_equal_margin_and_say_so() -> None:
    """The two that are shipped have the same; the stiffer gains alone have half of it."""
    least = least_margins()
    assert least["accelerations"] == pytest.approx(least["plain"], abs=0.05)
    assert least[PLAIN_FASTER] < 0.6 * least["plain"]
    of_plain = {"accelerations": Ratios(0.44, 1.4)}
    assert margin_words(least, of_plain).endswith("are worth what both are: 0.44.")
    apart = margin_words({**least, "accelerations": 0.5}, of_plain)
    assert apart.endswith("at equal margin nothing was flown.")
    assert "both 0.50" in apart


def test_gaps_come_every_so_often() -> None:
    ticks = [k * 0.005 for k in range(4200)]
    assert sum(in_gap("with gaps", t) for t in ticks) == 3 * round(GAP_S / 0.005)
    assert not any(in_gap("with gaps", t) for t in ticks if t < GAP_EVERY_S)
    assert sum(in_gap("with one gap", t) for t in ticks) == round(GAP_S / 0.005)
    assert not any(in_gap("all", t) or in_gap("the laboratory's", t) for t in ticks)


def test_differences_are_those_of_so_many_samples_and_late() -> None:
    """Of a steady acceleration they are the velocity in the middle of the samples."""
    differences = Differences()
    assert differences.take(NO_FIX, 0.0) == NO_FIX
    for k in range(1, 10):
        t = 0.1 * k
        fix = PositionFix(
            sequence=k,
            time_s=t,
            north_m=t * t,
            east_m=2.0 * t,
            down_m=0.0,
            velocity_north_mps=nan,
            velocity_east_mps=nan,
            velocity_down_mps=nan,
        )
        sent = differences.take(fix, t + 0.06)
        assert sent.time_s == pytest.approx(t + 0.06)
        assert differences.take(fix, t + 0.08) == sent
        if k < CHAIN:
            assert isnan(sent.velocity_north_mps)
        else:
            middle = t - 0.1 * (CHAIN - 1) / 2
            assert sent.velocity_north_mps == pytest.approx(2.0 * middle)
            assert sent.velocity_east_mps == pytest.approx(2.0)


def test_a_flight_that_ends_before_it_is_scored_is_counted_only_as_lost() -> None:
    flown = [
        Scored(
            duration_s=30.0, ended="", e_rho_m2=4.0, activity_2ps2=9.0, y_m2=0.25, bank_rad2=0.01
        ),
        Scored(duration_s=3.0, ended="hit the board", e_rho_m2=nan, activity_2ps2=nan),
    ]
    assert score(flown) == (2, 1, 2.0, 3.0, 0.5, 0.1)


def test_the_margin_is_shown_by_every_flight_or_not_at_all() -> None:
    whole = EstimatorScore(
        flights=24, lost=0, e_rho_m=0.01, activity_ps=1.0, y_m=0.1, bank_rad=0.02
    )
    names = [f"{law}, gains × {k:g}" for law in ("plain", "accelerations") for k in MARGIN]
    scores = dict.fromkeys(names, whole)
    assert margin_claim(scores).holds
    for name in names:
        assert not margin_claim({**scores, name: whole._replace(lost=1)}).holds


def test_sensor_and_gains_are_told_apart() -> None:
    """Each law with the other's gains, in the flights' own parameters."""
    for imu in (True, False):
        changes = dict(gains_exchanged(imu))
        values = _values(
            EstimatorFlight(line="a", seed=1, sensors=IMU, changes=tuple(changes.items()))
        )
        assert values["RHO_P_IMU"] == values["RHO_P"]
        assert values["ELE_D_IMU"] == values["ELE_D"]
        assert ("RHO_P_IMU" in changes) is imu
    ratios = {SAME_GAINS: Ratios(0.9, 0.8), PLAIN_FASTER: Ratios(0.7, 1.4)}
    words = split_words({**ratios, "accelerations": Ratios(0.45, 1.43)})
    assert "plain law's gains, 0.90" in words
    assert "both 0.45" in words


def test_nobody_tells_the_estimator_the_noise_of_the_fixes() -> None:
    noisy = Sensors(position=AUTOPILOT_POSITION._replace(noise_m=0.02))
    quiet = Sensors(position=AUTOPILOT_POSITION._replace(noise_m=0.0005))
    assert (
        len(
            {
                _values(EstimatorFlight(line="a", seed=1, sensors=s))["EST_FIX_SD"]
                for s in (noisy, quiet)
            }
        )
        == 1
    )


def test_a_dispersed_flight_is_of_another_aircraft_than_is_known_aboard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each seed its own, the same for plain and compiled flights."""
    pytest.importorskip("numba")
    monkeypatch.setattr(compiled_flight, "_kernel_for", lambda _: fly_ticks)
    filed = EstimatorFlight(line="b", seed=3, sensors=IMU, duration_s=8.5)
    flights = [filed._replace(dispersed=True, seed=seed) for seed in (3, 4)]
    models = [_world(each).model for each in (filed, *flights)]
    assert all(models.count(model) == 1 for model in models)
    assert len({_world(each).aerodynamics for each in (filed, *flights)}) == 1
    flown = [fly_scored(each) for each in (filed, *flights)]
    assert flown == [fly_scored_compiled(each) for each in (filed, *flights)]
    assert len({each.e_rho_m2 for each in flown}) == 3


def test_a_dispersed_estimate_is_of_dispersed_flights_alone() -> None:
    for apart in (False, True):
        plan = _plan(quick=True, dispersed=apart)
        lists = [*plan.watched.values(), *plan.corrupted.values(), *plan.scored.values()]
        assert {flight.dispersed for each in lists for flight in each} == {apart}
        assert plan.through.dispersed == apart


def test_ratios_are_of_pairs_in_the_same_air() -> None:
    lost = Scored(duration_s=3.0, ended="hit the board", e_rho_m2=nan, activity_2ps2=nan)
    flown = [
        Scored(duration_s=30.0, ended="", e_rho_m2=1.0, activity_2ps2=8.0),
        Scored(duration_s=30.0, ended="", e_rho_m2=8.0, activity_2ps2=4.0),
        lost,
    ]
    others = [
        Scored(duration_s=30.0, ended="", e_rho_m2=4.0, activity_2ps2=2.0),
        lost,
        Scored(duration_s=30.0, ended="", e_rho_m2=100.0, activity_2ps2=100.0),
    ]
    assert paired_ratios(flown, others) == (0.5, 2.0, 2)


def test_errors_are_lengths_and_held_against_their_sigmas() -> None:
    flight = EstimatorFlight(line="a", seed=1, sensors=IMU)
    truth = np.zeros((10, 6))
    read = np.tile([0.003, 0.0, 0.004, 0.0, 0.1, 0.0, 0.005, 0.1], (10, 1))
    found = known(
        [
            WatchedFlight(
                flight=flight,
                duration_s=1.0,
                ended="",
                time_s=np.zeros(10),
                truth=truth,
                read={True: read},
            )
        ],
        True,
    )
    assert found == pytest.approx(Known(5.0, 100.0, 1.0 / 3.0, 1.0 / 3.0))


def test_the_paired_interval_covers_the_truth_as_often_as_it_says() -> None:
    """By all outcomes of 25 pairs: the fraction of one kind of flight to survive differs from the
    other's by 0.1, of which the interval is right in 95 % and, being discrete, a little around."""
    n, p_first, p_second, p_neither = 25, 0.05, 0.15, 0.05
    p_both = 1.0 - p_first - p_second - p_neither
    covered = 0.0
    for first in range(n + 1):
        for second in range(n + 1 - first):
            for neither in range(n + 1 - first - second):
                both = n - first - second - neither
                low, high = paired_difference(both, first, second, neither)
                assert -1.0 <= low <= (second - first) / n <= high <= 1.0
                ways = comb(n, first) * comb(n - first, second) * comb(n - first - second, neither)
                chance = p_first**first * p_second**second * p_neither**neither * p_both**both
                covered += ways * chance * (low <= p_second - p_first <= high)
    assert 0.93 < covered < 0.985


def test_the_paired_interval_turns_with_the_pair() -> None:
    low, high = paired_difference(80, 5, 10, 5)
    assert paired_difference(80, 10, 5, 5) == pytest.approx((-high, -low))
    low, high = paired_difference(402, 0, 0, 0)  # nothing was lost: still not known exactly
    assert -0.02 < low < 0.0 < high < 0.02


@pytest.mark.long
def test_the_experiment_reports_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = "tgl_soar.analysis.experiments.estimates.estimator"
    for name, value in (("FLIGHT_S", 9.0), ("WATCHED_S", 9.0), ("ONE_GAP_S", 8.0)):
        monkeypatch.setattr(f"{here}.{name}", value)
    monkeypatch.setattr(f"{here}_flights.ONE_GAP_S", 8.0)
    result = run("estimator", Context(flyer=Flyer(), figures=tmp_path, quick=True))
    assert all(len(row) == len(t.columns) for t in result.tables for row in t.rows)
    (figure,) = result.figures
    assert (tmp_path / figure).read_bytes().startswith(b"\x89PNG")
    assert json.dumps(as_json(result))

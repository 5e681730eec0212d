"""Flights of scenarios: legs, scores, and the same in one process and in several."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import msgspec
import numpy as np
import pytest

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    Flyer,
    ScenarioJob,
    fly_job,
    fly_job_compiled,
    pooled_dispersion,
)
from tgl_soar.analysis.experiments.paper.still_lines import polar_bias_m
from tgl_soar.analysis.experiments.scenario import Scenario, load_scenario, prepare
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.config.airframe import ModelKind
from tgl_soar.config.files import shipped
from tgl_soar.sim.score import settling_time


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """Two lines, twelve seconds each."""
    whole = load_scenario(shipped("scenarios/translate.toml"))
    first = msgspec.structs.replace(whole.changes[0], time_s=12.0)
    return msgspec.structs.replace(whole, duration_s=24.0, changes=[first])


@pytest.fixture(scope="module")
def flown(scenario: Scenario) -> FlownScenario:
    return fly_job(ScenarioJob(scenario=scenario, seed=3))


def test_each_line_is_a_leg_that_ends_with_the_next(flown: FlownScenario) -> None:
    assert flown.survived
    a, b = flown.legs
    assert (a.line, b.line) == ("a", "b")
    assert a.end_s <= 12.0 < b.begin_s < 16.0
    assert b.end_s == pytest.approx(24.0, abs=0.01)


def test_a_leg_is_scored_on_its_own_line(flown: FlownScenario) -> None:
    for leg in flown.legs:
        assert leg.rms_e_rho_m < 0.02  # 1 % of turbulence
        assert leg.rms_e_rho_m <= leg.peak_e_rho_m < 0.1
        assert leg.predicted is not None
        assert abs(leg.miss_m) < 0.15  # a few seconds of a dispersion of 3 cm


def test_workers_give_the_same_flights_in_the_order_asked_for(scenario: Scenario) -> None:
    short = msgspec.structs.replace(scenario, duration_s=3.0, changes=[])
    jobs = [ScenarioJob(scenario=short, seed=seed) for seed in (5, 4)]
    counts: list[tuple[int, int]] = []
    pooled = Flyer(2, lambda reported: counts.append((reported.flown, reported.wanted))).fly(jobs)
    alone = Flyer().fly(jobs)
    assert [f.seed for f in pooled] == [5, 4]
    assert counts[-1] == (2, 2)
    for a, b in zip(pooled, alone, strict=True):
        assert np.array_equal(a.path["x_m"], b.path["x_m"])
    assert not np.array_equal(pooled[0].path["x_m"], pooled[1].path["x_m"])


def test_a_flight_that_ends_early_says_why(scenario: Scenario) -> None:
    """Upstream of the nozzle's lip is no place to fly."""
    start = msgspec.structs.replace(scenario.start, x_m=-0.9, z_m=0.4)
    crash = fly_job(ScenarioJob(scenario=msgspec.structs.replace(scenario, start=start), seed=1))
    assert not crash.survived
    assert crash.ended == "disengaged: outside the fence"
    assert crash.duration_s < 5.0
    assert crash.legs == ()


def test_settling_ends_with_the_first_quiet_two_seconds() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    e = np.where(time < 1.0, 0.2, 0.0)
    assert settling_time(time, e) == pytest.approx(1.0, abs=0.02)
    e[500] = 0.06  # a peak after settling is a peak
    assert settling_time(time, e) == pytest.approx(1.0, abs=0.02)
    assert settling_time(time, np.full(len(time), 0.2)) == inf


def test_pooled_dispersion_counts_the_spread_of_the_means(flown: FlownScenario) -> None:
    leg = flown.legs[0]
    apart = [
        replace(leg, along_m=0.1, dispersion_m=0.03),
        replace(leg, along_m=-0.1, dispersion_m=0.03),
    ]
    assert pooled_dispersion(apart) == pytest.approx((0.03**2 + 0.1**2) ** 0.5)


def test_a_drawn_aircraft_hovers_at_its_own_place_and_not_at_the_files(scenario: Scenario) -> None:
    """Seed 1 draws one that hovers 16 cm below the files' place; its own it misses by less than
    what a cubic leaves of it (2 cm), and by its own glides by 3 mm."""
    calm = with_turbulence(msgspec.structs.replace(scenario, duration_s=12.0, changes=[]), 0.0)
    (leg,) = fly_job(ScenarioJob(scenario=calm, seed=1, dispersed=True)).legs
    assert abs(leg.miss_m) > 0.1
    assert abs(leg.own_miss_m) < 0.02
    assert abs(leg.glide_miss_m) < 0.003
    (file,) = fly_job(ScenarioJob(scenario=calm, seed=1)).legs
    assert file.glide_miss_m == file.own_miss_m == file.miss_m
    apart = [
        leg,
        replace(leg, along_m=leg.along_m + 0.2, own_predicted_along_m=leg.own_along_m + 0.2),
    ]
    assert pooled_dispersion(apart) == pytest.approx(leg.dispersion_m)  # what flew is not in it


def test_an_aircraft_may_differ_from_its_file_which_the_module_goes_by(scenario: Scenario) -> None:
    airframe = prepare(scenario).airframe
    figures = (("model.CD0", 0.07), ("airframe.iyy_kgm2", 0.02))
    other = flown_airframe(airframe, figures)
    assert (other.model["CD0"], other.airframe.iyy_kgm2) == (0.07, 0.02)
    assert airframe.model["CD0"] != 0.07
    with pytest.raises(ValueError, match=r"model\.wings"):
        flown_airframe(airframe, (("model.wings", 1.0),))
    short = msgspec.structs.replace(scenario, duration_s=12.0, changes=[])
    as_filed, draggy = (
        fly_job(ScenarioJob(scenario=short, seed=1, aircraft=drawn)) for drawn in ((), figures)
    )
    assert as_filed.survived
    assert draggy.survived
    # A quarter more of CD0 is 0.2 m/s more sink, which the contour answers by some 20 cm.
    assert draggy.legs[0].mean_z_m < as_filed.legs[0].mean_z_m - 0.1


def test_a_flight_may_start_elsewhere(scenario: Scenario) -> None:
    short = msgspec.structs.replace(scenario, duration_s=0.1, changes=[])
    flown = fly_job(ScenarioJob(scenario=short, seed=1, start_xz_m=(0.7, 1.4)))
    assert flown.path["x_m"][0] == pytest.approx(0.7, abs=0.01)
    assert flown.path["z_m"][0] == pytest.approx(1.4, abs=0.01)


@pytest.mark.parametrize("model", ["rigid_body", "point_mass"])
def test_an_aircraft_settles_where_its_own_glides_put_it(model: ModelKind) -> None:
    """Off the fitted cubic's crossing, to opposite sides by the two models; sensors' noise is 2 mm
    and the mean of 15 s gives its place to less."""
    still = Context(Flyer(), model=model).scenario("static")
    calm = with_turbulence(msgspec.structs.replace(still, duration_s=21.0), 0.0)
    prepared = prepare(calm)
    at = prepared.lines["a"].crossing
    assert at is not None
    expected_m = polar_bias_m(prepared, at)
    assert (expected_m > 0.0) == (model == "rigid_body")
    (leg,) = fly_job(ScenarioJob(scenario=calm, seed=1)).legs
    assert leg.miss_m == pytest.approx(expected_m, abs=0.004)


@pytest.mark.long
def test_a_compiled_job_is_the_plain_flight(scenario: Scenario) -> None:
    """Rounding apart, which numba's fused sums change."""
    pytest.importorskip("numba")
    short = msgspec.structs.replace(scenario, duration_s=11.0, changes=[])
    job = ScenarioJob(scenario=short, seed=1, aircraft=(("model.CD0", 0.06),))
    plain, compiled = fly_job(job), fly_job_compiled(job)
    assert compiled.ended == plain.ended
    for name, column in plain.path.items():
        np.testing.assert_allclose(compiled.path[name], column, atol=1e-6, err_msg=name)

"""Aircraft unlike their file: drawn by the seed alone, within bounds, and unknown on board."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.air.gusts import BlendedField, ScaledField, Schedule
from tgl_soar.analysis.experiments import campaign, catalogue
from tgl_soar.analysis.experiments.campaign import FaultJob, FaultJobs, place, world_of
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer, ScenarioJob, fly_job
from tgl_soar.analysis.experiments.mismatch import (
    RANGES,
    Mismatch,
    drawn_mismatch,
    mismatched_field,
    mismatched_figures,
    mismatched_sensors,
    mismatched_site,
)
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.config.files import ConfigError
from tgl_soar.sim.aircraft import AircraftModel, aircraft_model
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors

NONE = Mismatch(
    *(0.0 if name.endswith(("_rad", "_s", "_m")) else 1.0 for name in Mismatch._fields)
)._replace(centre_of_gravity=0.0)


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "available", lambda: False)


def model_of(drawn: Mismatch) -> AircraftModel:
    airframe = place().airframe
    flown = flown_airframe(airframe, mismatched_figures(airframe, drawn))
    return aircraft_model(asdict(flown.airframe), flown.model)


def test_draws_fill_their_bounds_and_repeat_with_their_seed() -> None:
    draws = np.array([drawn_mismatch(seed) for seed in range(400)])
    low, high = np.array(RANGES).T
    assert np.all((draws >= low) & (draws <= high))
    # Of 400 even draws the least lies within 5 % of the bound but once in 10⁹.
    assert np.all(draws.min(axis=0) < low + 0.05 * (high - low))
    assert np.all(draws.max(axis=0) > high - 0.05 * (high - low))
    assert drawn_mismatch(7) == drawn_mismatch(7) != drawn_mismatch(8)


def test_no_mismatch_is_the_airframe_file() -> None:
    airframe = place().airframe
    assert model_of(NONE) == aircraft_model(asdict(airframe.airframe), airframe.model)
    imu = mismatched_sensors(Sensors(imu=MEMS_IMU, airspeed=PITOT), NONE)
    assert (imu.imu, imu.airspeed) == (MEMS_IMU, PITOT)


def test_a_centre_of_gravity_further_aft_is_less_stable() -> None:
    own, aft = model_of(NONE), model_of(NONE._replace(centre_of_gravity=0.02))
    assert aft.Cm_alpha == pytest.approx(own.Cm_alpha + 0.02 * own.CL_alpha)
    # The moment about a point further aft: lift acts ahead of it by so much more.
    assert aft.Cm0 == pytest.approx(own.Cm0 + 0.02 * own.CL0)


def test_the_air_is_another() -> None:
    _, site, _, field = place()
    flatter, steeper = (
        mismatched_field(field, site, NONE._replace(slope_rad=slope)) for slope in RANGES.slope_rad
    )
    assert isinstance(flatter, ScaledField)
    assert isinstance(flatter.field, BlendedField)
    at = (0.6, 0.0, 1.2, 0.0)
    assert flatter.wind_at(*at)[2] < field.wind_at(*at)[2] < steeper.wind_at(*at)[2]
    faster = mismatched_field(field, site, NONE._replace(wind=1.03))
    assert faster.wind_at(*at)[0] > 1.02 * field.wind_at(*at)[0]
    other = mismatched_site(site, NONE._replace(length=1.5))
    assert other.air is not None
    assert site.air is not None
    assert other.air.turbulence.length_scale_m == 1.5 * site.air.turbulence.length_scale_m


def test_a_wind_that_changes_is_that_over_another_board_too() -> None:
    """As the experiments `wind` and `gust` have it; one that is tilted in flight stays as it is."""
    _, site, _, field = place()
    changing = ScaledField(field, Schedule([0.0, 1.0], [1.0, 1.1]))
    at = (0.6, 0.0, 1.2)
    for time_s in (0.0, 1.0):
        flatter, steeper = (
            mismatched_field(changing, site, NONE._replace(slope_rad=slope)).wind_at(*at, time_s)
            for slope in RANGES.slope_rad
        )
        assert flatter[2] < changing.wind_at(*at, time_s)[2] < steeper[2]
    tilted = BlendedField(field, field, Schedule([0.0], [0.5]))
    other = mismatched_field(tilted, site, NONE._replace(slope_rad=RANGES.slope_rad[1]))
    assert other.wind_at(*at, 0.0) == tilted.wind_at(*at, 0.0)


def test_sensors_are_worse_never_better_aligned() -> None:
    every = Sensors(imu=MEMS_IMU, airspeed=PITOT)
    drawn = NONE._replace(force_bias=2.0, pressure_bias=3.0)
    worse = mismatched_sensors(every, drawn)
    assert worse.attitude.bias_rad == pytest.approx(0.035 / 3**0.5)
    assert worse.position.bias_m == pytest.approx(0.01 / 3**0.5)
    assert worse.imu is not None
    assert worse.airspeed is not None
    assert worse.imu.force_bias_mps2 == 2.0 * MEMS_IMU.force_bias_mps2
    assert worse.airspeed.pressure_bias_pa == 3.0 * PITOT.pressure_bias_pa


def test_the_module_is_given_the_file_and_another_aircraft_flies() -> None:
    own, other = (
        world_of(
            FaultJob(row="row", seed=3, turbulence=0.01, faults=(), dispersed=dispersed),
            Injection((), 3),
        )
        for dispersed in (False, True)
    )
    assert other.model != own.model
    assert other.aerodynamics == own.aerodynamics
    assert other.ground == own.ground
    assert {job.dispersed for job in FaultJobs(3, 1, 1, dispersed=True)} == {True}


def test_a_scenario_is_flown_by_another_aircraft() -> None:
    whole = Context(Flyer()).scenario("static")
    short = msgspec.structs.replace(whole, duration_s=2.0, changes=[])
    own, other, again = (
        fly_job(ScenarioJob(scenario=short, seed=2, dispersed=dispersed)).path["z_m"]
        for dispersed in (False, True, True)
    )
    assert np.array_equal(other, again)
    assert not np.array_equal(own, other)


def test_an_experiment_that_draws_its_own_is_refused() -> None:
    with pytest.raises(ConfigError, match="identification: --dispersion goes with places, static"):
        catalogue.run("identification", Context(Flyer(), dispersion=True))

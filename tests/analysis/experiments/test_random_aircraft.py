"""Aircraft unlike their file: drawn by the seed alone, within bounds, and unknown on board."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import degrees
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.air.gusts import BlendedField, ScaledField, Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.wind_record import RecordedField, WindRecord
from tgl_soar.analysis.campaigns import drawn_faults
from tgl_soar.analysis.campaigns.drawn_faults import FaultJob, FaultJobs, place, world_of
from tgl_soar.analysis.experiments import catalogue
from tgl_soar.analysis.experiments.aircraft import identification
from tgl_soar.analysis.experiments.aircraft.identification import GlideJob
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer, ScenarioJob, fly_job
from tgl_soar.analysis.experiments.lift import nowhere, search, survey, throttle
from tgl_soar.analysis.experiments.lift.nowhere import LineJob
from tgl_soar.analysis.experiments.lift.search import SearchJob
from tgl_soar.analysis.experiments.lift.survey import SurveyJob
from tgl_soar.analysis.experiments.lift.throttle import PoweredJob
from tgl_soar.analysis.experiments.outdoors import hour, outdoors, rangefinder, satellites
from tgl_soar.analysis.experiments.outdoors.hour import HourCase, HourJob
from tgl_soar.analysis.experiments.outdoors.outdoors import PassageJob
from tgl_soar.analysis.experiments.outdoors.rangefinder import RangeJob
from tgl_soar.analysis.experiments.outdoors.satellites import SatelliteJob
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.analysis.experiments.random_aircraft import (
    AS_FILED,
    RANGES,
    Mismatch,
    drawn_mismatch,
    flown_world,
    mismatched_field,
    mismatched_figures,
    mismatched_sensors,
    mismatched_site,
)
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.analysis.search import episode
from tgl_soar.config.files import ConfigError, load_airframe, load_site, shipped
from tgl_soar.sim.aircraft import AircraftModel, aircraft_model
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors
from tgl_soar.sim.world import World
from tgl_soar.types import polar_sink

NONE = AS_FILED


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn_faults, "available", lambda: False)


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


def test_the_bounds_are_those_that_the_page_of_theory_argues() -> None:
    page = (Path(__file__).parents[3] / "docs" / "theory.md").read_text(encoding="utf-8")
    section = page.partition("## What a controller does not know")[2]
    rows = [row.strip("| ").split(" | ") for row in section.splitlines() if row.startswith("| ")]
    listed = {row[0]: row[1] for row in rows if len(row) == 3}

    def fraction(low: float, high: float) -> str:
        return f"± {round(100.0 * (high - 1.0)):d} %" if low + high == pytest.approx(2.0) else ""

    def ratios(low: float, high: float) -> str:
        return f"× {low:g} to {high:g}"

    ranges, bias = RANGES, "bias of accelerometers; of the pitot tube"
    fractions = {
        "lift slope and lift at zero incidence": ranges.lift,
        "drag": ranges.drag,
        "inertia": ranges.inertia,
        "elevator's effect": ranges.pitch_effect,
        "ailerons' and rudder's effect": ranges.turn_effect,
        "mean wind": ranges.wind,
        "effect of the brake": ranges.brake,
    }
    for what, within in fractions.items():
        assert listed[what] == fraction(*within), what
    assert listed["servo's rate constant"] == ratios(*ranges.servo_lag)
    assert listed["length of the turbulence"] == ratios(*ranges.length)
    assert listed[bias] == f"{ratios(*ranges.force_bias)}; {ratios(*ranges.pressure_bias)}"
    for what, (low, high) in (
        ("angle of attack of the stall", ranges.stall_rad),
        ("slope of the board", ranges.slope_rad),
    ):
        assert low == -high
        assert listed[what] == f"± {round(degrees(high), 1):g}°"
    low, high = ranges.centre_of_gravity
    assert low == -high
    assert listed["centre of gravity"] == f"± {100.0 * high:g} % of the chord"
    low, high = ranges.edge_m
    assert low == -high
    assert listed["free edge of the jet"] == f"± {100.0 * high:g} cm"
    low, high = ranges.shear_per_m
    assert low == -high
    assert listed["shear of the jet"] == f"± {100.0 * high:g} % for each metre"
    low, high = ranges.hill_radius
    assert low == pytest.approx(2.0 - high)
    assert listed["radius of the flow over a hill"] == f"± {100.0 * (high - 1.0):.2g} %"
    assert ranges.hill_growth == (0.0, 1.0 / 7.0)
    assert listed["growth of a hill's wind with height, d ln U / d ln z"] == "0 to 1/7"
    assert listed["commands, beyond the known delay"] == f"up to {1000.0 * ranges.late_s[1]:g} ms"
    assert ranges.late_s[0] == 0.0


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
    at = (0.6, 0.0, 1.2, 0.0)
    assert flatter.wind_at(*at)[2] < field.wind_at(*at)[2] < steeper.wind_at(*at)[2]
    faster = mismatched_field(field, site, NONE._replace(wind=1.03))
    assert isinstance(faster, ScaledField)
    assert faster.wind_at(*at)[0] > 1.02 * field.wind_at(*at)[0]
    other = mismatched_site(site, NONE._replace(length=1.5))
    assert other.air is not None
    assert site.air is not None
    assert other.air.turbulence.length_scale_m == 1.5 * site.air.turbulence.length_scale_m


def test_a_jet_has_another_edge_and_shear() -> None:
    _, site, _, field = place()
    low, high = RANGES.edge_m
    assert low == -high
    lower, upper = (mismatched_field(field, site, NONE._replace(edge_m=e)) for e in (low, high))
    for x_m in (0.0, 1.0, 2.0):
        heights = np.linspace(2.0, 3.6, 801)
        speeds = [np.hypot(*each.wind(x_m, 0.0, heights)[::2]) for each in (lower, field, upper)]
        edges = [float(heights[np.argmax(speed < 0.5 * speed[0])]) for speed in speeds]
        # The free edge follows the nozzle's lip; further on by as much as the whole jet is larger.
        assert edges[1] - edges[0] == pytest.approx(high, abs=0.01), x_m
        assert edges[2] - edges[1] == pytest.approx(high, abs=0.01), x_m
    grown = mismatched_field(field, site, NONE._replace(shear_per_m=0.03))
    at = (0.6, 0.0)
    for z_m in (0.7, 1.425, 2.4):
        own, other = field.wind_at(*at, z_m, 0.0), grown.wind_at(*at, z_m, 0.0)
        assert other == pytest.approx([(1.0 + 0.03 * (z_m - 1.425)) * v for v in own], rel=1e-3)


def test_a_hill_has_the_flow_of_another_radius_and_of_a_wind_that_grows_with_height() -> None:
    site = load_site(shipped("sites/hill.toml"))
    field = HillField(7.0, 8.0)
    drawn = NONE._replace(hill_radius=1.02, hill_growth=0.1)
    at = (-6.2, 0.0, 14.2, 0.0)
    own = mismatched_field(field, site, drawn)
    assert own.wind_at(*at) == HillField(7.0, 8.16, 0.1).wind_at(*at)
    faster = mismatched_field(ScaledField(field, 0.9), site, drawn)
    assert faster.wind_at(*at) == pytest.approx([0.9 * each for each in own.wind_at(*at)])
    record = WindRecord(Schedule([0.0], [6.0]), Schedule([0.0], [0.3]))
    recorded = mismatched_field(RecordedField(field, record), site, drawn)
    assert recorded.wind_at(*at) == RecordedField(own, record).wind_at(*at)
    # The ground that may not be hit is the file's, and so is what the module is given.
    assert mismatched_site(site, drawn) == site
    for x_m, there in ((-8.01, True), (-7.99, False)):
        assert own.inside(x_m, 0.0, 0.0) == field.inside(x_m, 0.0, 0.0) == there


def test_a_jet_between_those_of_the_bounds_is_that_jet() -> None:
    """The blend against what is computed for the very slope and edge."""
    _, site, _, field = place()
    assert isinstance(field, SlopeJet)
    slope_rad, edge_m = 0.3 * RANGES.slope_rad[1], -0.4 * RANGES.edge_m[1]
    drawn = NONE._replace(slope_rad=slope_rad, edge_m=edge_m)
    blended = mismatched_field(field, site, drawn)
    own = SlopeJet(
        field.wind_mps,
        field.shape.slope_rad + slope_rad,
        nozzle_height_m=field.shape.nozzle_height_m + edge_m,
    )
    x, z = np.meshgrid(np.linspace(0.0, 2.0, 21), np.linspace(0.3, 2.6, 24), indexing="ij")
    above = z > 0.2 + x * np.tan(own.shape.slope_rad)
    blown, meant = (each.wind(x[above], 0.0, z[above]) for each in (blended, own))
    for got, computed in zip(blown, meant, strict=True):
        # A bend of the flow with the slope: of second order, a degree of slope is 0.017.
        assert np.abs(got - computed).max() < 0.001 * field.wind_mps


def test_a_board_that_is_tilted_in_flight_keeps_its_slopes() -> None:
    _, site, _, field = place()
    assert isinstance(field, SlopeJet)
    steeper = SlopeJet(field.wind_mps, field.shape.slope_rad + 0.03)
    tilted = BlendedField(field, steeper, Schedule([0.0, 1.0], [0.0, 1.0]))
    drawn = NONE._replace(slope_rad=0.01, edge_m=0.03)
    other = mismatched_field(tilted, site, drawn)
    own = drawn._replace(slope_rad=0.0)
    at = (1.0, 0.0, 2.3)
    for time_s, each in ((0.0, field), (1.0, steeper)):
        assert other.wind_at(*at, time_s) == mismatched_field(each, site, own).wind_at(*at, time_s)
        assert other.wind_at(*at, time_s) != each.wind_at(*at, time_s)


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


def test_what_an_experiment_draws_by_itself_is_not_drawn_again() -> None:
    _, site, _, field = place()
    drawn = drawn_mismatch(7, episode.ALREADY)
    assert drawn == drawn_mismatch(7)._replace(
        drag=1.0, wind=1.0, slope_rad=0.0, edge_m=0.0, shear_per_m=0.0
    )
    assert mismatched_field(field, site, drawn) is field


@pytest.mark.parametrize("name", catalogue.NOT_DISPERSED)
def test_who_is_not_dispersed_says_why(name: str) -> None:
    with pytest.raises(ConfigError, match=f"{name}: no --dispersion: (draws|flies nothing)"):
        catalogue.run(name, Context(Flyer(), dispersion=True))


class Asked(Exception):
    """An experiment has planned its first flights."""


class FirstJobs(Flyer):
    """Flies nothing."""

    def each(
        self,
        fly: Callable[[Any], Any],  # noqa: ARG002
        jobs: Iterable[Any],
        **_: bool,
    ) -> list[Any]:
        """Keeps the first list."""
        queue = list(jobs)
        if not queue:
            return []
        self.asked = queue
        raise Asked


@pytest.mark.parametrize("name", catalogue.DISPERSED)
@pytest.mark.parametrize("dispersion", [False, True])
def test_all_that_an_experiment_flies_is_dispersed_or_nothing_is(
    name: str, dispersion: bool
) -> None:
    flyer = FirstJobs()
    context = Context(flyer, quick=True, model="rigid_body", dispersion=dispersion)
    with pytest.raises(Asked):
        catalogue.run(name, context)
    assert {job.dispersed for job in flyer.asked} == {dispersion}


def worlds(module: Any, monkeypatch: pytest.MonkeyPatch, fly: Callable[[bool], Any]) -> list[World]:
    """Those of a flight by the files, and dispersed; neither is flown."""

    def made(*args: Any, **wanted: Any) -> World:
        found.append(flown_world(*args, **wanted))
        raise Asked

    found: list[World] = []
    monkeypatch.setattr(module, "flown_world", made)
    for dispersed in (False, True):
        with pytest.raises(Asked):
            fly(dispersed)
    return found


HILL, SEARCH = "wind on a hill is drawn by the flight", "and so are air and sink of a place"
FLOWN: dict[str, tuple[Any, Callable[[bool], Any], str]] = {
    "launch": (outdoors, lambda d: outdoors.launch(PassageJob(outdoors.LAUNCH, 3, d)), HILL),
    "landing": (outdoors, lambda d: outdoors.land(PassageJob(outdoors.LAND, 3, d)), HILL),
    "satellites": (
        satellites,
        lambda d: satellites.fly_satellites(SatelliteJob(satellites.RESET, 3, d)),
        HILL,
    ),
    "rangefinder": (
        rangefinder,
        lambda d: rangefinder.fly_range(RangeJob(rangefinder.RECEIVER, 3, d)),
        HILL,
    ),
    "hour": (hour, lambda d: hour.fly_hour(HourJob(HourCase(8.0), 3, 60.0, d)), HILL),
    "survey": (survey, lambda d: survey.fly_once(SurveyJob(0.01, 0.06, 3, d)), ""),
    "search": (
        episode,
        lambda d: search.fly_search(SearchJob("hill", 3, search.MAP, d)),
        SEARCH,
    ),
    "throttle": (
        episode,
        lambda d: throttle.fly_powered(PoweredJob("hill", 3, throttle.WITH, d)),
        SEARCH,
    ),
    "nowhere": (
        episode,
        lambda d: nowhere.fly_line(
            LineJob(kind="tunnel", seed=3001, settles=True, act=2, dispersed=d)
        ),
        SEARCH,
    ),
}


@pytest.mark.parametrize("name", FLOWN)
def test_the_truth_differs_and_what_the_module_is_given_does_not(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, fly, already = FLOWN[name]
    own, other = worlds(module, monkeypatch, fly)
    assert other.model != own.model
    assert other.parts.servo != own.parts.servo
    assert other.parts.turbulence.params != own.parts.turbulence.params
    assert other.sensors.attitude.bias_rad > own.sensors.attitude.bias_rad
    assert other.aerodynamics == own.aerodynamics
    assert other.ground == own.ground
    assert other.frame == own.frame
    at = own.start.x_m, 0.0, own.start.z_m, 0.0
    winds = own.field.reference_wind_mps, other.field.reference_wind_mps
    assert (winds[0] == winds[1]) == bool(already)
    assert (other.field.wind_at(*at) == own.field.wind_at(*at)) == (already == SEARCH)
    assert isinstance(own.model, AircraftModel)
    assert isinstance(other.model, AircraftModel)
    assert (other.model.CD0 == own.model.CD0) == (already == SEARCH)


def test_a_test_flight_is_held_against_the_aircraft_that_flew() -> None:
    own, other = (identification.flies(GlideJob(3, dispersed)) for dispersed in (False, True))
    model, known = identification.truth()
    assert (own.model, own.body) == (model, known)
    assert other.model.CD0 != model.CD0
    assert other.body.iyy_kgm2 != known.iyy_kgm2
    assert other.sensors.attitude.bias_rad > own.sensors.attitude.bias_rad


def test_what_can_be_soared_of_an_hour_is_by_the_polar_of_what_flies() -> None:
    values = shipped_hill().on_line("a").values
    own, other = (hour.hill_of(HourJob(HourCase(8.0), 3, 60.0, d), values) for d in (False, True))
    assert own.polar == shipped_hill().airframe.polar.as_polar()
    drag = drawn_mismatch(3).drag
    # All of the drag is drawn by one factor; 3 % is what a cubic and another trim differ by.
    assert polar_sink(other.polar, 9.3) == pytest.approx(
        drag * polar_sink(own.polar, 9.3), rel=0.03
    )
    assert (own.flow_radius, own.growth) == (1.0, 0.0)
    drawn = drawn_mismatch(3)
    assert (other.flow_radius, other.growth) == (drawn.hill_radius, drawn.hill_growth)


def test_the_contour_of_a_dispersed_survey_is_that_of_what_flew() -> None:
    """On it the air rises as fast as that aircraft sinks in its steady glide at that wind."""
    airframe, site = load_airframe(shipped(survey.AIRFRAME)), load_site(shipped(survey.SITE))
    seed = min(range(1, 40), key=lambda seed: drawn_mismatch(seed).drag)
    world = flown_world(airframe, site, seed, dispersed=True)
    model = world.model
    assert isinstance(model, AircraftModel)
    x, z = max(survey.contour_flown(world), key=len).T
    u, _, w = world.field.wind(x, 0.0 * x, z)
    glides = (u > 8.0) & (u < 10.5)
    sinks = np.array([model.glide_at(float(speed)).sink_mps for speed in u[glides]])
    # A cubic's misfit, and a grid of 2 cm; 10 % of drag are 0.06 m/s of sink.
    assert np.all(np.abs(w[glides] - sinks) < 0.03)
    assert np.count_nonzero(glides) > 20

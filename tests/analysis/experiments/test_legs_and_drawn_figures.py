"""How a flight's legs are scored, beside sums made here; where an aircraft's own place is; and
which figures of the aircraft, sensors and air each drawn number changes."""

from __future__ import annotations

from math import cos, isnan, nan, sin
from typing import Any

import msgspec
import numpy as np
import pytest

from tgl_soar.air.gusts import ScaledField
from tgl_soar.air.hill import HillField
from tgl_soar.analysis.experiments.flights import (
    Flyer,
    FlyerProgress,
    ScenarioJob,
    ScoredLeg,
    fly_job_compiled,
    own_cubic,
    own_glides,
    own_place,
    pooled_dispersion,
    scenario_world,
    score_legs,
)
from tgl_soar.analysis.experiments.random_aircraft import (
    AS_FILED,
    Mismatch,
    drawn_mismatch,
    mismatched_field,
    mismatched_figures,
    mismatched_sensors,
    mismatched_site,
)
from tgl_soar.analysis.experiments.scenario import PreparedScenario, load_scenario, prepare
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.aircraft import AircraftModel, glide_polar
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors
from tgl_soar.sim.world import flown_aircraft
from tgl_soar.types import polar_sink

TRANSLATE = load_scenario(shipped("scenarios/translate.toml"))
STEP_S = 0.02

# --- legs -----------------------------------------------------------------------------------------


def two_legs() -> PreparedScenario:
    """Line a for 12 s, then b until 24 s."""
    change = msgspec.structs.replace(TRANSLATE.changes[0], time_s=12.0)
    return prepare(
        msgspec.structs.replace(TRANSLATE, duration_s=24.0, changes=[change], unscored_s=[])
    )


def beside(prepared: PreparedScenario, along: Any, across: Any, **columns: Any) -> Trajectory:
    """A flight so far up each line from its point and across it; b is moved to within a second."""
    time = np.arange(0.0, 24.0, STEP_S)
    along, across = np.broadcast_to(along, time.shape), np.broadcast_to(across, time.shape)
    second = time >= 12.0
    x, z = np.zeros(len(time)), np.zeros(len(time))
    for name, rows in (("a", ~second), ("b", second)):
        target = prepared.lines[name].target
        c, s = cos(target.eta_rad), sin(target.eta_rad)
        x[rows] = target.x_m + c * along[rows] - s * across[rows]
        z[rows] = target.z_m + s * along[rows] + c * across[rows]
    made = {
        "time_s": time, "x_m": x, "z_m": z, "y_m": 0.1 * np.sin(time), "roll_rad": 0.02 + 0 * time,
        "target_changes": second.astype(float),
        "line_moving": (second & (time < 13.0)).astype(float),
    }  # fmt: skip
    made |= columns
    return Trajectory(made, "", len(time))


def test_a_leg_is_scored_from_five_seconds_after_its_line_stands_still() -> None:
    prepared = two_legs()
    time = np.arange(0.0, 24.0, STEP_S)
    wild = (time < 4.99) | ((time > 11.99) & (time < 17.99))
    alternate = np.where(np.arange(len(time)) % 2, 1.0, -1.0)
    across = np.where(wild, 0.8, 0.01 + 0.02 * alternate)
    along = np.where(wild, -3.0, 0.2 + 0.05 * alternate)
    first, second = score_legs(prepared, beside(prepared, along, across))
    assert (first.line, second.line) == ("a", "b")
    assert (first.begin_s, first.end_s) == pytest.approx((0.0, 11.98))
    assert (second.begin_s, second.end_s) == pytest.approx((13.0, 23.98))
    assert (first.scored_s, second.scored_s) == pytest.approx((6.98, 5.98))
    for leg in (first, second):
        assert leg.mean_e_rho_m == pytest.approx(0.01, abs=1e-3)
        assert leg.rms_e_rho_m == pytest.approx(np.sqrt(0.01**2 + 0.02**2), rel=0.02)
        assert leg.peak_e_rho_m == pytest.approx(0.03)
        assert leg.along_m == pytest.approx(0.2, abs=1e-3)
        assert leg.dispersion_m == pytest.approx(0.05, rel=1e-3)
        assert leg.rms_bank_rad == pytest.approx(0.02)
        target, crossing = prepared.lines[leg.line]
        assert leg.target == target
        c, s = cos(target.eta_rad), sin(target.eta_rad)
        assert leg.mean_x_m == pytest.approx(target.x_m + c * 0.2 - s * 0.01, abs=2e-3)
        assert leg.mean_z_m == pytest.approx(target.z_m + s * 0.2 + c * 0.01, abs=2e-3)
        assert crossing is not None
        assert leg.predicted == pytest.approx((crossing.x_m, crossing.z_m), abs=1e-6)
        ahead = c * (crossing.x_m - target.x_m) + s * (crossing.z_m - target.z_m)
        assert leg.predicted_along_m == pytest.approx(ahead, abs=1e-6)
        assert leg.miss_m == pytest.approx(leg.along_m - ahead, abs=1e-6)
    kept = time[(time >= 5.0) & (time < 12.0)]
    assert first.rms_y_m == pytest.approx(np.sqrt(np.mean((0.1 * np.sin(kept)) ** 2)), rel=1e-3)


def test_a_leg_of_less_than_two_seconds_to_score_is_none() -> None:
    prepared = two_legs()
    for stands_s, count in ((17.2, 1), (16.8, 2)):
        time = np.arange(0.0, 24.0, STEP_S)
        moving = ((time >= 12.0) & (time < stands_s)).astype(float)
        flown = beside(prepared, 0.0, 0.0, line_moving=moving)
        assert len(score_legs(prepared, flown)) == count
    hidden = beside(prepared, 0.0, 0.0, line_moving=np.ones(1200))
    assert score_legs(prepared, hidden) == ()


def test_what_is_not_to_be_scored_is_left_out() -> None:
    prepared = two_legs()
    time = np.arange(0.0, 24.0, STEP_S)
    off = np.where((time >= 7.0) & (time < 9.0), 1.0, 0.0)
    flown = beside(prepared, 0.0, off)
    assert score_legs(prepared, flown)[0].peak_e_rho_m == pytest.approx(1.0)
    scenario = msgspec.structs.replace(prepared.scenario, unscored_s=[(7.0, 9.0)])
    kept = score_legs(prepared._replace(scenario=scenario), flown)[0]
    assert kept.peak_e_rho_m == pytest.approx(0.0, abs=1e-9)
    assert kept.end_s == pytest.approx(11.98)


LEG = ScoredLeg(
    line="a", target=TargetLine(1.0, 10.0, 1.9), begin_s=0.0, end_s=20.0, settling_s=1.0,
    rms_e_rho_m=0.01, peak_e_rho_m=0.02, mean_e_rho_m=0.0, rms_y_m=0.1, rms_bank_rad=0.01,
    mean_x_m=0.0, mean_z_m=0.0, along_m=0.3, dispersion_m=0.03, predicted=(0.0, 0.0),
    predicted_along_m=0.1, scored_s=15.0,
)  # fmt: skip


def leg(**changes: Any) -> ScoredLeg:
    return ScoredLeg(**{**vars(LEG), **changes})


def test_a_miss_is_positive_up_and_to_ones_own_place_where_there_is_one() -> None:
    assert LEG.miss_m == LEG.own_miss_m == LEG.glide_miss_m == pytest.approx(0.2)
    assert LEG.own_along_m == 0.1
    own = leg(own_predicted_along_m=0.25)
    assert (own.own_along_m, own.own_miss_m, own.miss_m) == pytest.approx((0.25, 0.05, 0.2))
    assert own.glide_miss_m == own.own_miss_m
    glide = leg(own_predicted_along_m=0.25, own_glide_along_m=0.28)
    assert (glide.own_miss_m, glide.glide_miss_m) == pytest.approx((0.05, 0.02))


def test_a_pooled_spread_without_any_contour_is_about_the_place_along_the_line() -> None:
    apart = [leg(along_m=0.1), leg(along_m=0.5)]
    assert pooled_dispersion(apart) == pytest.approx(np.sqrt(0.03**2 + 0.2**2))
    lost = [leg(along_m=0.1, predicted_along_m=nan), leg(along_m=0.5)]
    assert pooled_dispersion(lost) == pytest.approx(np.sqrt(0.03**2 + 0.2**2))
    own = [leg(along_m=0.1, predicted_along_m=0.0), leg(along_m=0.5, predicted_along_m=0.4)]
    assert pooled_dispersion(own) == pytest.approx(0.03)


# --- one's own place ------------------------------------------------------------------------------


class Air:
    """Nine metres a second; what rises falls by 0.2 m/s a metre, and is 1 m/s at 10.5 m."""

    def __init__(self, slope: float = 0.2) -> None:
        self.slope = slope

    def wind(self, x: Any, _y: Any, z: Any, _time_s: float) -> Any:
        return 9.0 + 0.0 * z, 0.0 * z, 1.0 - self.slope * (z - 10.5) + 0.0 * x


GLIDES = (np.array([8.0, 9.0, 10.0]), np.array([0.8, 1.0, 1.4]))


def test_a_place_is_where_the_air_rises_as_fast_as_it_glides_down() -> None:
    place_m = 0.5 / sin(1.9)
    field: Any = Air()
    assert own_place(LEG, field, GLIDES) == pytest.approx(place_m, abs=1e-6)
    # On the line that it was in fact held on: 5 cm across, by which it is higher or lower.
    shifted = leg(mean_e_rho_m=0.05)
    higher_m = place_m - 0.05 * cos(1.9) / sin(1.9)
    assert own_place(shifted, field, GLIDES) == pytest.approx(higher_m, abs=1e-6)
    worse = (GLIDES[0], GLIDES[1] + 0.1)
    assert own_place(LEG, field, worse) == pytest.approx(place_m - 0.5 / sin(1.9), abs=1e-6)


def test_a_place_is_none_where_it_does_not_hold_is_far_or_has_no_glide() -> None:
    field: Any = Air()
    assert isnan(own_place(LEG, field=_air(-0.2), glides=GLIDES))  # it grows upwards
    assert isnan(own_place(leg(predicted_along_m=nan), field, GLIDES))
    for away_m, some in ((3.9, True), (4.1, False), (-3.9, True), (-4.1, False)):
        far = leg(predicted_along_m=0.5 / sin(1.9) + away_m)
        assert isnan(own_place(far, field, GLIDES)) is not some, away_m
    slow = (np.array([9.1, 10.0]), np.array([1.0, 1.4]))
    fast = (np.array([8.0, 8.9]), np.array([0.8, 1.0]))
    assert isnan(own_place(LEG, field, slow))
    assert isnan(own_place(LEG, field, fast))


def _air(slope: float) -> Any:
    return Air(slope)


def test_of_several_places_the_nearest_to_the_files_counts() -> None:
    class Waves:
        def wind(self, _x: Any, _y: Any, z: Any, _time_s: float) -> Any:
            return 9.0 + 0.0 * z, 0.0 * z, 1.0 - 0.3 * np.sin(np.pi * (z - 10.0))

    field: Any = Waves()  # falls through 1 m/s at 10, 12, 8 m …
    for near_m, wanted_m in ((0.3, 0.0), (1.8, 2.0), (-1.5, -2.0)):
        found = own_place(leg(predicted_along_m=near_m / sin(1.9)), field, GLIDES)
        assert found * sin(1.9) == pytest.approx(wanted_m, abs=1e-3)


def test_an_aircrafts_glides_begin_at_its_slowest_and_end_at_14_mps() -> None:
    model = flown_aircraft(load_airframe(shipped("airframes/eclipson_c.toml")))
    assert isinstance(model, AircraftModel)
    speeds, sinks = own_glides(model)
    cubic_speeds, cubic = own_cubic(model)
    slowest = model.highest_pitch_glide().horizontal_mps
    assert speeds[0] == cubic_speeds[0] == slowest
    assert np.diff(speeds) == pytest.approx(np.full(len(speeds) - 1, 0.1))
    assert 13.9 <= speeds[-1] < 14.0
    assert sinks[7] == pytest.approx(model.glide_at(float(speeds[7])).sink_mps)
    known = polar_sink(glide_polar(model), float(cubic_speeds[7]))
    assert cubic[7] == pytest.approx(known)


def test_a_start_elsewhere_is_the_worlds_and_faults_are_not_compiled() -> None:
    prepared = two_legs()
    job = ScenarioJob(scenario=prepared.scenario, seed=3)
    own, other = (
        scenario_world(each, prepared, None) for each in (job, job._replace(start_xz_m=(0.7, 1.4)))
    )
    assert prepared.site.start is not None
    assert own.start.x_m == prepared.site.start.x_m
    assert (other.start.x_m, other.start.z_m) == (0.7, 1.4)
    assert own.field is prepared.field
    faulty = msgspec.structs.replace(TRANSLATE, faults=["position.dropout start=3"])
    with pytest.raises(ValueError, match="faults are injected into plain flights only"):
        fly_job_compiled(ScenarioJob(scenario=faulty, seed=1))


# --- the flyer ------------------------------------------------------------------------------------


class Flown:
    def __init__(self, seconds: float) -> None:
        self.duration_s = seconds


def fly(seconds: float) -> Flown:
    return Flown(seconds)


def test_a_flyer_counts_over_all_its_lists() -> None:
    reports: list[FlyerProgress] = []
    flyer = Flyer(on_flight=reports.append)
    assert [each.duration_s for each in flyer.each(fly, [3.0, 4.0])] == [3.0, 4.0]
    assert (flyer.flown, flyer.wanted, flyer.simulated_s) == (2, 2, 7.0)
    flyer.each(fly, iter([5.0, 1.0, 2.0]))
    assert (flyer.flown, flyer.wanted, flyer.simulated_s) == (5, 5, 15.0)
    assert (reports[-1].flown, reports[-1].wanted) == (5, 5)
    first_of_second = next(each for each in reports if each.wanted == 5)
    assert first_of_second.flown in (2, 3)
    assert flyer.each(fly, []) == []


# --- what is drawn --------------------------------------------------------------------------------

PLANE = load_airframe(shipped("airframes/eclipson_c.toml"))
MODEL = PLANE.model


def changed(**drawn: float) -> dict[str, float]:
    """The figures that are not the file's, over these."""
    found = dict(mismatched_figures(PLANE, AS_FILED._replace(**drawn)))
    own = {f"model.{key}": value for key, value in MODEL.items()}
    own |= {
        f"airframe.{k}": getattr(PLANE.airframe, k) for k in ("ixx_kgm2", "iyy_kgm2", "izz_kgm2")
    }
    return {k: v / own[k] if own[k] else v for k, v in found.items() if v != own[k]}


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("lift", ("CL0", "CL_alpha")),
        ("drag", ("CD0", "CD_lift")),
        ("pitch_effect", ("CL_elevator", "Cm_elevator")),
        ("turn_effect", ("CY_rudder", "Cl_aileron", "Cn_aileron", "Cn_rudder")),
        ("servo_lag", ("servo_lag_radps",)),
        ("brake", ("CL_brake", "CD_brake", "Cm_brake")),
    ],
)
def test_each_factor_is_of_its_own_figures_alone(name: str, figures: tuple[str, ...]) -> None:
    found = changed(**{name: 1.1})
    wanted = {f"model.{key}" for key in figures if MODEL.get(key)}
    assert set(found) == wanted
    assert all(value == pytest.approx(1.1) for value in found.values())


def test_inertia_is_of_all_three_axes() -> None:
    found = changed(inertia=0.9)
    assert found == pytest.approx(
        {"airframe.ixx_kgm2": 0.9, "airframe.iyy_kgm2": 0.9, "airframe.izz_kgm2": 0.9}
    )


def test_stall_and_delay_are_added_to() -> None:
    found = dict(mismatched_figures(PLANE, AS_FILED._replace(stall_rad=-0.02, late_s=0.004)))
    assert found["model.stall_alpha_rad"] == pytest.approx(MODEL["stall_alpha_rad"] - 0.02)
    assert found["model.servo_delay_s"] == pytest.approx(MODEL["servo_delay_s"] + 0.004)


def test_a_centre_of_gravity_stays_ahead_of_the_neutral_point() -> None:
    lift = 1.1 * MODEL["CL_alpha"]
    for aft in (-0.02, 0.02):
        drawn = AS_FILED._replace(centre_of_gravity=aft, lift=1.1)
        found = dict(mismatched_figures(PLANE, drawn))
        assert found["model.Cm_alpha"] == pytest.approx(MODEL["Cm_alpha"] + aft * lift)
        assert found["model.Cm0"] == pytest.approx(MODEL["Cm0"] + aft * 1.1 * MODEL["CL0"])
    far = dict(mismatched_figures(PLANE, AS_FILED._replace(centre_of_gravity=0.5)))
    assert far["model.Cm_alpha"] == pytest.approx(0.5 * MODEL["Cm_alpha"]) != 0.0
    assert far["model.Cm_alpha"] < 0.0


def test_an_airframe_without_a_brake_has_none_that_is_drawn() -> None:
    bare = {key: value for key, value in MODEL.items() if "brake" not in key}
    found = dict(mismatched_figures(msgspec.structs.replace(PLANE, model=bare), AS_FILED))
    assert not any("brake" in name for name in found)


def test_what_a_flight_draws_is_its_seeds_but_what_is_drawn_already() -> None:
    assert drawn_mismatch(4, ("wind", "late_s")) == drawn_mismatch(4)._replace(wind=1.0, late_s=0.0)
    assert Mismatch(
        lift=1.0, drag=1.0, stall_rad=0.0, inertia=1.0, pitch_effect=1.0, turn_effect=1.0,
        centre_of_gravity=0.0, servo_lag=1.0, late_s=0.0, force_bias=1.0, pressure_bias=1.0,
        slope_rad=0.0, wind=1.0, length=1.0, brake=1.0, edge_m=0.0, shear_per_m=0.0,
        hill_radius=1.0, hill_growth=0.0,
    ) == AS_FILED  # fmt: skip


def test_sensors_that_are_not_there_stay_so_and_worse_ones_stay_worse() -> None:
    none = mismatched_sensors(Sensors(), AS_FILED)
    assert none.imu is None
    assert none.airspeed is None
    usual = Sensors(imu=MEMS_IMU, airspeed=PITOT)
    poor = usual._replace(
        position=usual.position._replace(bias_m=0.5),
        attitude=usual.attitude._replace(bias_rad=0.3),
    )
    kept = mismatched_sensors(poor, AS_FILED)
    assert (kept.position.bias_m, kept.attitude.bias_rad) == (0.5, 0.3)


def test_a_hills_air_has_no_board_and_no_edge() -> None:
    hill = load_site(shipped("sites/hill.toml"))
    field = HillField(7.0, 8.0)
    jet = AS_FILED._replace(slope_rad=0.01, edge_m=0.03, shear_per_m=0.02)
    assert mismatched_field(field, hill, jet) is field
    faster = mismatched_field(field, hill, jet._replace(wind=1.03))
    assert isinstance(faster, ScaledField)
    at = (-6.0, 0.0, 14.0, 0.0)
    assert faster.wind_at(*at) == pytest.approx([1.03 * each for each in field.wind_at(*at)])
    longer = mismatched_site(hill, AS_FILED._replace(length=1.4))
    assert longer.air is not None
    assert hill.air is not None
    own_m = hill.air.turbulence.length_scale_m
    assert longer.air.turbulence.length_scale_m == pytest.approx(1.4 * own_m)
    assert longer.air.turbulence.intensity == hill.air.turbulence.intensity

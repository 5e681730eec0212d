"""`identification`, `unseen` and `airframes`: what flies in each flight, and what is read of it."""

from __future__ import annotations

from math import degrees, inf, isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from tgl_soar.air.zeuc import ZeucError
from tgl_soar.analysis.experiments.aircraft import airframes as a
from tgl_soar.analysis.experiments.aircraft import identification as e
from tgl_soar.analysis.experiments.aircraft import unseen as u
from tgl_soar.analysis.experiments.aircraft.drawn_airframes import DrawnAirframe, drawn_airframe
from tgl_soar.analysis.experiments.aircraft.identification import GlideJob
from tgl_soar.analysis.experiments.aircraft.unseen import UnseenJob, UnseenRow
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.analysis.logs.gliding import MeanWind
from tgl_soar.analysis.tuning.flights import START_M, DrawnFlight
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.found_gains import INERTIAL, PLAIN, SETS
from tgl_soar.estimation.polar import fit_polar
from tgl_soar.sim.aircraft import lift_drag
from tgl_soar.sim.glide_test import WIND_MPS, wind_of
from tgl_soar.types import (
    AttitudeSample,
    GlidePolar,
    ImuSample,
    PositionFix,
    polar_sink,
)

SHIPPED = load_airframe(shipped("airframes/eclipson_c.toml"))

# --- the log of a glide ---------------------------------------------------------------------------


def tick(fix: int, attitude: int, imu: int, moved: int, t: float) -> Any:
    """Samples of these numbers, each a little different from the last of its kind."""
    inputs = SimpleNamespace(
        position=PositionFix(
            sequence=fix, time_s=t - 0.04, north_m=1.0 + fix, east_m=2.0 + fix, down_m=3.0 + fix,
            velocity_north_mps=4.0 + fix, velocity_east_mps=5.0 + fix,
            velocity_down_mps=6.0 + fix,
        ),
        attitude=AttitudeSample(
            sequence=attitude, time_s=t - 0.01, qw=1.0, qx=0.0, qy=0.0, qz=0.0,
            roll_rate_frd_radps=0.1, pitch_rate_frd_radps=0.2, yaw_rate_frd_radps=0.3,
        ),
        imu=ImuSample(
            sequence=imu, time_s=t, force_x_frd_mps2=0.5 + imu, force_y_frd_mps2=0.6,
            force_z_frd_mps2=0.7, roll_rate_frd_radps=0.8, pitch_rate_frd_radps=0.9,
            yaw_rate_frd_radps=1.0 + imu,
        ),
        surfaces=(moved, t - 0.02, 0.11 + moved, 0.12, 0.13, 0.14 + moved),
    )  # fmt: skip
    surfaces = inputs.surfaces

    class Surfaces(tuple[float, ...]):
        sequence = surfaces[0]

    inputs.surfaces = Surfaces(surfaces)
    return SimpleNamespace(inputs=inputs)


def test_a_log_has_every_sample_once_at_its_own_time() -> None:
    """None yet is numbered 0; the third tick brings nothing new of the position."""
    ticks = [tick(0, 1, 1, 0, 0.0), tick(1, 2, 2, 1, 0.1), tick(1, 3, 3, 1, 0.2),
             tick(2, 3, 4, 2, 0.3)]  # fmt: skip
    data = e.logged(ticks)
    assert data.position is not None
    assert data.position.time_s.tolist() == pytest.approx([0.06, 0.26])
    assert data.position["north_m"].tolist() == [2.0, 3.0]
    assert data.position["east_m"].tolist() == [3.0, 4.0]
    assert data.position["down_m"].tolist() == [4.0, 5.0]
    assert data.velocity is not None
    assert data.velocity.time_s.tolist() == data.position.time_s.tolist()
    assert data.velocity["north_mps"].tolist() == [5.0, 6.0]
    assert data.velocity["east_mps"].tolist() == [6.0, 7.0]
    assert data.velocity["down_mps"].tolist() == [7.0, 8.0]
    assert data.attitude is not None
    assert data.attitude.time_s.tolist() == pytest.approx([-0.01, 0.09, 0.19])
    for name in ("roll_rad", "pitch_rad", "yaw_rad"):
        assert data.attitude[name].tolist() == [0.0] * 3
    assert data.imu is not None
    assert data.imu["force_x_frd_mps2"].tolist() == [1.5, 2.5, 3.5, 4.5]
    assert data.imu["force_y_frd_mps2"].tolist() == [0.6] * 4
    assert data.imu["force_z_frd_mps2"].tolist() == [0.7] * 4
    assert data.imu["roll_rate_frd_radps"].tolist() == [0.8] * 4
    assert data.imu["pitch_rate_frd_radps"].tolist() == [0.9] * 4
    assert data.imu["yaw_rate_frd_radps"].tolist() == [2.0, 3.0, 4.0, 5.0]
    assert data.surfaces is not None
    assert data.surfaces["elevator"].tolist() == pytest.approx([1.11, 2.11])
    assert data.surfaces["aileron"].tolist() == [0.12] * 2
    assert data.surfaces["rudder"].tolist() == [0.13] * 2
    assert data.brake is not None
    assert data.brake["brake"].tolist() == pytest.approx([1.14, 2.14])
    assert data.brake.time_s.tolist() == pytest.approx([0.08, 0.28])


def test_a_servo_is_up_to_40_ms_late_by_the_flights_seed() -> None:
    delays = [e.delay_of(seed) for seed in range(200)]
    assert delays == [e.delay_of(seed) for seed in range(200)]
    assert 0.0 <= min(delays) < 0.001
    assert 0.039 < max(delays) <= 0.040


# --- the truth of a glide -------------------------------------------------------------------------


def test_the_true_short_period_is_that_of_the_models_own_moments() -> None:
    """M_alpha and the damping by the tables of the docs: two states' matrix, its determinant."""
    model, body = e.truth()
    v = 9.0
    alpha = model.glide_at(v).alpha_rad
    slope = (lift_drag(model, alpha + 0.01, 0.0)[0] - lift_drag(model, alpha - 0.01, 0.0)[0]) / 0.02
    q_s = 0.5 * body.air_density_kgpm3 * v**2 * body.wing_area_m2
    z_alpha = -q_s * slope / (body.mass_kg * v)
    m_alpha = q_s * body.chord_m * model.Cm_alpha / body.iyy_kgm2
    m_q = q_s * body.chord_m * model.Cm_q * body.chord_m / (2.0 * v) / body.iyy_kgm2
    poles = np.linalg.eigvals(np.array([[z_alpha, 1.0], [m_alpha, m_q]]))
    assert e.true_period(model, body, v) == pytest.approx(float(np.abs(poles[0])), rel=1e-3)


def test_the_elevators_true_effect_grows_with_the_square_of_speed() -> None:
    model, body = e.truth()
    slow, fast = (
        e.true_effect(model, body, cast("Any", SimpleNamespace(airspeed_mps=v)))
        for v in (8.0, 12.0)
    )
    moment = 0.5 * 1.225 * 64.0 * body.wing_area_m2 * body.chord_m * model.Cm_elevator
    assert body.air_density_kgpm3 == pytest.approx(1.225)
    assert slow == pytest.approx(moment / body.iyy_kgm2)
    assert fast == pytest.approx(2.25 * slow)


def estimate(value: float, half: float) -> Any:
    return SimpleNamespace(value=value, low=value - half, high=value + half)


class Found(SimpleNamespace):
    """What was identified."""

    def __getitem__(self, name: str) -> Any:
        assert name == "delay"
        return self.delay


def examined(
    monkeypatch: pytest.MonkeyPatch, by: float = 1.0, half: float = 0.1, sink: float = 1.0
) -> e.Examined:
    """Of a log whose numbers are all wrong by a factor, within a relative band; polars by
    another."""
    job = GlideJob(5)
    model, body = e.truth()
    speeds = np.linspace(7.8, 11.6, 30)
    sinks = [sink * model.glide_at(float(v)).sink_mps for v in speeds]
    polar = fit_polar(speeds.tolist(), sinks)
    period = e.true_period(model, body, 9.5)
    effect = e.true_effect(model, body, cast("Any", SimpleNamespace(airspeed_mps=9.5)))
    delay_s = e.delay_of(5)
    found = Found(
        airspeed_mps=9.5,
        frequency=estimate(by * period, half * period),
        effectiveness=estimate(by * effect, half * effect),
        delay=estimate(by * delay_s, half * delay_s),
        explained=0.97,
    )
    monkeypatch.setattr(e, "fitted", lambda _job: (polar, ([], []), None, 116.0))
    monkeypatch.setattr(e, "identify", lambda *_: found)
    return e.examine(job)


def test_errors_are_fractions_of_the_truth_and_a_delay_is_in_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = examined(monkeypatch)
    assert right.duration_s == 116.0
    assert right.sink_error < 0.02
    assert (right.period_error, right.effect_error) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert right.held == (True, True, True)
    assert right.explained == 0.97
    wrong = examined(monkeypatch, by=1.2, sink=1.3)
    assert (wrong.period_error, wrong.effect_error) == pytest.approx((0.2, 0.2))
    assert wrong.delay_error_s == pytest.approx(0.2 * e.delay_of(5))
    assert wrong.held == (False, False, False)
    assert wrong.sink_error == pytest.approx(0.3, abs=0.02)
    assert not any(wrong.sink_held)
    assert len(wrong.sink_held) == 8
    low = examined(monkeypatch, by=0.85, half=0.16, sink=0.7)
    assert low.period_error == pytest.approx(-0.15)
    assert low.held == (True, True, True)
    assert low.sink_error == pytest.approx(0.3, abs=0.02)
    assert examined(monkeypatch, by=0.85, half=0.14).held == (False, False, False)


def test_a_log_that_cannot_be_identified_misses_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(_job: GlideJob) -> Any:
        raise ValueError("no doublets")

    monkeypatch.setattr(e, "fitted", refuses)
    found = e.examine(GlideJob(5))
    assert found.duration_s == 0.0
    errors = (found.sink_error, found.period_error, found.effect_error, found.delay_error_s)
    assert errors == (inf,) * 4
    assert found.held == (False, False, False)
    assert found.sink_held == (False,) * 8
    assert isnan(found.explained)


def test_speeds_are_compared_from_8_2_to_11_each_0_4() -> None:
    assert pytest.approx([8.2, 8.6, 9.0, 9.4, 9.8, 10.2, 10.6, 11.0]) == e.CHECKED_MPS
    wide = GlidePolar(c0=0.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=7.0, speed_max_mps=12.0)
    assert e.checked_speeds(e.truth()[0], wide) == pytest.approx(e.CHECKED_MPS)


def test_a_glide_is_flown_with_its_own_delay_and_read_in_the_tests_wind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: dict[str, Any] = {}

    def fly(airframe: Any, **wanted: Any) -> list[Any]:
        asked.update(wanted, airframe=airframe)
        return ["a tick"]

    def logged(ticks: list[Any]) -> Any:
        asked["ticks"] = ticks
        return SimpleNamespace(duration_s=77.0)

    def glides(_flight: Any, wind: Any) -> Any:
        asked["wind"] = wind
        return [
            SimpleNamespace(speed_mps=v, sink_mps=polar_sink(SHIPPED.polar.as_polar(), v))
            for v in (8.0, 8.5, 9.0, 9.5, 10.0, 11.0)
        ]

    monkeypatch.setattr(e, "fly", fly)
    monkeypatch.setattr(e, "logged", logged)
    monkeypatch.setattr(e, "glides", glides)
    monkeypatch.setattr(e, "longitudinal", lambda _flight, wind: ("columns", wind))
    polar, (speeds, sinks), columns, duration_s = e.fitted(GlideJob(4))
    assert (asked["seed"], asked["servo_delay_s"]) == (4, e.delay_of(4))
    assert asked["ticks"] == ["a tick"]
    assert asked["wind"] == MeanWind(WIND_MPS, 0.0)
    assert cast("Any", columns) == ("columns", asked["wind"])
    assert (speeds[0], len(sinks), duration_s) == (8.0, 6, 77.0)
    assert polar_sink(polar.polar, 9.0) == pytest.approx(sinks[2], rel=1e-3)


# --- what flies the unseen aircraft ---------------------------------------------------------------

SCENARIO = load_scenario(shipped("scenarios/unseen.toml"))
ROW = UnseenRow(name="a row", lean_deg=15.0, turbulence=0.03)


def test_the_plain_pid_has_its_own_gains_and_nothing_that_ends_a_flight() -> None:
    """As they were sought for this aircraft; limits are as wide as their parameters go."""
    values = u.pilots_values(prepare(SCENARIO).values, u.PLAIN, 1.0)
    gains = {
        "RHO_SPEED": 0.0, "RHO_P": 0.71, "RHO_I": 0.21, "RHO_D": 0.246, "RHO_D_FILT": 30.0,
        "ELE_P": 7.25, "ELE_I": 4.35, "ELE_D": 0.70, "EST_IMU": 0.0,
    }  # fmt: skip
    wide = {
        "CLEAR_MIN": 0.0, "FENCE_X_MIN": -5000.0, "FENCE_X_MAX": 5000.0, "FENCE_Y_MAX": 5000.0,
        "FENCE_Z_MIN": -1000.0, "FENCE_Z_MAX": 5000.0, "FC_ACT": 0.0, "ALPHA_MAX": 45.0,
        "SPEED_MIN": 0.0, "SINK_MAX": 50.0, "CAPTURE_MAX": 10.0, "TILT_MAX": 80.0,
    }  # fmt: skip
    for name, value in {**gains, **wide}.items():
        assert values[name] == pytest.approx(value), name


@pytest.mark.parametrize("pilot", u.PILOTS)
def test_only_the_outer_gains_are_off_by_a_factor(pilot: str) -> None:
    values = prepare(SCENARIO).values
    one, more = (u.pilots_values(values, pilot, outer) for outer in (1.0, 1.8))
    differs = {each.name for each, value in more if value != one[each.name]}
    outer = {"RHO_P", "RHO_I", "RHO_D", "RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU"}
    assert differs == {name for name in outer if one[name] != 0.0}
    for name in differs:
        assert more[name] == pytest.approx(1.8 * one[name])
    assert one["EST_IMU"] == (1.0 if pilot == u.WITH else 0.0)


def flown_unseen(monkeypatch: pytest.MonkeyPatch, row: UnseenRow) -> tuple[Any, Any, Any]:
    """The aircraft that flies, the one that is known, and how it was flown."""
    flown: list[Any] = []
    worlds: list[Any] = []

    def flown_world(known: Any, _site: Any, seed: int, **wanted: Any) -> str:
        worlds.append((known, seed, wanted))
        return "world"

    monkeypatch.setattr(u, "flown_world", flown_world)
    monkeypatch.setattr(u, "fly_whole", lambda *what: flown.append(("whole", what)))
    monkeypatch.setattr(u, "fly_late", lambda *what: flown.append(("late", what)))
    u.fly_unseen(
        UnseenJob(scenario=SCENARIO, row=row, pilot=u.WITH, place="b", seed=7, dispersed=True)
    )
    ((known, seed, wanted),), (how,) = worlds, flown
    assert seed == 7
    assert wanted["dispersed"] is True
    return wanted["flies"], known, how


def test_what_the_file_does_not_know_is_in_the_aircraft_or_its_link(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flies, known, (how, what) = flown_unseen(monkeypatch, ROW)
    own = dict(known.model)
    assert flies.model == {**own, "servo_delay_s": pytest.approx(own["servo_delay_s"] + 0.005)}
    assert how == "whole"
    world, seed, values, duration_s = what
    assert (world, seed, duration_s) == ("world", 7, 30.0)
    assert values["EST_IMU"] == 1.0
    flies, known, (how, what) = flown_unseen(monkeypatch, ROW._replace(servo_s=0.08))
    assert flies.model["servo_lag_radps"] == pytest.approx(12.5)
    assert known.model["servo_lag_radps"] == own["servo_lag_radps"]
    assert known.model["servo_delay_s"] == own["servo_delay_s"]
    flies, known, (how, what) = flown_unseen(
        monkeypatch, ROW._replace(late_s=0.02, duration_s=9.0, outer=1.4)
    )
    assert flies.model == own
    assert how == "late"
    world, seed, more, late_s, duration_s = what
    assert late_s == pytest.approx(0.025)
    assert (seed, duration_s) == (7, 9.0)
    assert more["RHO_P_IMU"] == pytest.approx(1.4 * values["RHO_P_IMU"])


def test_a_row_has_its_lean_turbulence_place_and_site() -> None:
    job = UnseenJob(scenario=SCENARIO, row=ROW, pilot=u.WITH, place="c", seed=1)
    found = u.scenario_of(job)
    assert list(found.lines) == [found.first_line] == ["c"]
    assert found.lines["c"].lean_deg == 15.0
    assert found.lines["c"].speed_ratio == SCENARIO.lines["c"].speed_ratio
    assert found.turbulence is not None
    assert found.turbulence.intensity == 0.03
    assert found.site == SCENARIO.site
    other = u.scenario_of(job._replace(row=ROW._replace(site="faster.toml", speed_ratio=1.04)))
    assert Path(other.site or "").name == "faster.toml"
    assert Path(other.site or "").parent == Path(SCENARIO.site or "").parent
    assert other.lines["c"].speed_ratio == 1.04


def test_rows_grow_in_turbulence_lean_and_lateness() -> None:
    late = [row.late_s for row in u.ROWS if row.late_s]
    leans = [(row.lean_deg, row.turbulence) for row in u.ROWS]
    assert late == [0.010, 0.020, 0.030]
    assert [row.servo_s for row in u.ROWS if row.servo_s] == [0.080]
    assert [row.outer for row in u.ROWS if row.outer != 1.0] == [1.4, 1.8]
    assert [row.speed_ratio for row in u.ROWS if row.speed_ratio] == [1.04, 0.87]
    assert [(row.seeds, row.duration_s) for row in u.ROWS[:3]] == [(32, 60.0)] * 3
    assert {row.seeds for row in u.ROWS[3:6]} == {row.seeds for row in u.ROWS[12:]} == {8}
    assert {(row.seeds, row.duration_s) for row in u.ROWS[6:12]} == {(6, 30.0)}
    for row, (lean_deg, turbulence) in zip(u.ROWS, leans, strict=True):
        assert f"lean {lean_deg:.0f}°, {100 * turbulence:.0f} %" in row.name
    assert [row.places for row in u.ROWS[:12]] == [("a", "b", "c")] * 12


# --- from a log to the line -----------------------------------------------------------------------


def drawn() -> DrawnAirframe:
    return drawn_airframe(SHIPPED, (7, 3))


def test_errors_of_what_was_identified_are_at_one_speed() -> None:
    """The schedule's own figures hold at another speed where the polar is another: its square for
    the effect, itself for the short period."""
    true = drawn().airframe
    assert a.identified_errors(true, true) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    model = {**true.model, "Cm_elevator": 1.1 * true.model["Cm_elevator"]}
    stronger = msgspec.structs.replace(true, model=model)
    frequency, effect, sink = a.identified_errors(true, stronger)
    assert (frequency, sink) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert effect == pytest.approx(0.1)
    polar = msgspec.structs.replace(true.polar, c0=true.polar.c0 + 0.06)
    sinks = a.identified_errors(true, msgspec.structs.replace(true, polar=polar))[2]
    place = 0.94 * true.all_parameters()["DYN_BEST"]
    assert sinks == pytest.approx(0.06 / polar_sink(true.polar.as_polar(), place))


def test_the_day_to_soar_is_the_first_wind_with_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    plane = drawn().airframe
    best = plane.all_parameters()["DYN_BEST"]
    asked: list[tuple[float, float]] = []

    def finds(after: int) -> Any:
        def place(field: Any, _polar: Any, _bounds: Any, ratio: float) -> tuple[float, float]:
            asked.append((field.reference_wind_mps / best, ratio))
            if len(asked) <= after:
                raise ZeucError(f"no place, {len(asked)}")
            return 1.0, 2.0

        return place

    for after in range(4):
        asked.clear()
        monkeypatch.setattr(a, "place_at_speed_ratio", finds(after))
        day, at = a.site_for(plane)
        assert at == (1.0, 2.0)
        assert [wind for wind, _ in asked] == pytest.approx([0.76, 0.80, 0.84, 0.88][: after + 1])
        assert {ratio for _, ratio in asked} == {0.94}
        assert day.air is not None
        assert cast("Any", day.air).wind_mps == pytest.approx(best * asked[-1][0])
        assert day.contour is None
    asked.clear()
    monkeypatch.setattr(a, "place_at_speed_ratio", finds(9))
    with pytest.raises(ZeucError, match="no place, 4"):
        a.site_for(plane)


@pytest.mark.parametrize("kind", SETS)
def test_it_soars_at_15_degrees_beside_the_place_at_1_percent(
    kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made: list[tuple[Any, Any, dict[str, Any]]] = []
    flown: list[tuple[Any, ...]] = []

    def make_world(airframe: Any, site: Any, **wanted: Any) -> str:
        made.append((airframe, site, wanted))
        return "world"

    monkeypatch.setattr(a, "make_world", make_world)
    monkeypatch.setattr(a, "fly_late", lambda *what: flown.append(what))
    own = DrawnAirframe(SHIPPED, 0.012)
    text = a.USUAL.read_text(encoding="utf-8")
    a.soar(own, text, kind, 1003, tmp_path)
    ((airframe, site, wanted),), ((world, seed, values, link_s, duration_s),) = made, flown
    assert airframe == SHIPPED
    assert (wanted["seed"], wanted["turbulence"]) == (1003, 0.01)
    assert wanted["sensors"].imu is not None
    assert (world, seed, link_s, duration_s) == ("world", 1003, 0.012, 60.0)
    assert values["EST_IMU"] == (1.0 if kind == INERTIAL else 0.0)
    assert values["TGL_LEAN"] == 15.0
    place = a.site_for(SHIPPED)[1]
    assert (values["TGL_X"], values["TGL_Z"]) == pytest.approx(place)
    # It hovers where the line meets its own contour: for the shipped one at that very place.
    assert site.start.x_m - START_M == pytest.approx(place[0], abs=0.05)
    assert site.start.z_m == pytest.approx(place[1], abs=0.05)


FLIGHT = DrawnFlight(
    up=True, rms_e_rho_m=0.015, duration_s=60.0, ended="", rms_y_m=0.123, rms_bank_rad=0.05
)


def stepped(monkeypatch: pytest.MonkeyPatch, fails: str = "") -> tuple[a.BuiltAirframe, list[Any]]:
    """All steps but what they compute."""
    steps_given: list[Any] = []

    def step(name: str, gives: Any) -> Any:
        def does(*what: Any) -> Any:
            steps_given.append((name, what))
            if name == fails:
                raise ValueError("no")
            return gives

        return does

    alphas = SimpleNamespace(after={kind: SimpleNamespace(alpha=0.6) for kind in SETS})
    monkeypatch.setattr(a, "glide_log", step("glide", Path("log")))
    monkeypatch.setattr(a, "identified", step("identify", "text"))
    monkeypatch.setattr(a, "airframe_from", step("read", drawn().airframe))
    monkeypatch.setattr(a, "identified_errors", step("errors", (0.1, 0.2, 0.3)))
    monkeypatch.setattr(a, "tuned_for", step("tune", ("tuned", alphas)))
    monkeypatch.setattr(a, "soar", step("soar", FLIGHT))
    return a.build_and_soar(a.AirframeJob((7, 3))), steps_given


def test_each_step_is_given_what_the_last_one_gave(monkeypatch: pytest.MonkeyPatch) -> None:
    found, steps_given = stepped(monkeypatch)
    assert found.failed == ""
    assert (found.frequency_error, found.effect_error, found.sink_error) == (0.1, 0.2, 0.3)
    assert found.alpha == dict.fromkeys(SETS, 0.6)
    assert found.flights == dict.fromkeys(SETS, FLIGHT)
    assert found.duration_s == 120.0
    assert found.soars
    assert found.name == drawn().airframe.airframe.name
    steps = dict(steps_given)
    airframe, seed, _ = steps["glide"]
    assert (airframe, seed) == (drawn().airframe, 3)
    assert steps["identify"][2] == MeanWind(wind_of(drawn().airframe), 0.0)
    assert [what[2] for name, what in steps_given if name == "soar"] == list(SETS)
    own, text, _, seed, _ = steps["soar"]
    assert (text, seed) == ("tuned", 1003)
    # A link is whole ticks of 5 ms late, and at least one.
    assert own.link_s / 0.005 == pytest.approx(round(own.link_s / 0.005))
    assert abs(own.link_s - drawn().link_s) <= 0.0025 + 1e-9
    assert own.link_s >= 0.005


@pytest.mark.parametrize("step", ["glide", "identify", "tune", "soar"])
def test_what_fails_is_reported_with_its_step_and_what_came_before(
    step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, _ = stepped(monkeypatch, fails=step)
    assert found.failed == f"{step}: no"
    assert not found.soars
    known = step in ("tune", "soar")
    assert (found.frequency_error, found.effect_error) == ((0.1, 0.2) if known else (inf, inf))
    assert bool(found.alpha) == (step == "soar")
    assert found.duration_s == 0.0


def test_a_row_tells_fractions_margins_and_what_ended_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = stepped(monkeypatch)
    lost = FLIGHT._replace(up=False, ended="too low", rms_y_m=0.4)
    row = a._row(found._replace(flights={PLAIN: FLIGHT, INERTIAL: lost}))
    assert row == (
        found.name, "+10.0 %", "+20.0 %", "+30.0 %", "0.60", "0.60", "1.50", "1.50", "12, 40",
        f"{degrees(0.05):.1f}, {degrees(0.05):.1f}", "too low",
    )  # fmt: skip
    failed, _ = stepped(monkeypatch, fails="glide")
    assert a._row(failed)[1:] == (*("–",) * 9, "glide: no")
    assert a._row(found)[-1] == "–"


def test_all_must_soar_and_keep_their_margins(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = stepped(monkeypatch)
    for alpha, holds in ((0.5, True), (0.49, False)):
        claims = a._claims([found, found._replace(alpha={PLAIN: alpha, INERTIAL: 0.6})])
        assert claims[1].holds is holds
        assert claims[1].measured == f"{alpha:.2f} at least"
        assert claims[0].measured == "2 of 2"
    one = a._claims([found, found._replace(alpha={PLAIN: 0.6})])
    assert not one[1].holds
    assert [claim.holds for claim in a._claims([found, found._replace(failed="tune: no")])] == [
        False, True,
    ]  # fmt: skip
    assert not a._claims([found._replace(alpha={})])[1].holds


def test_a_search_for_gains_is_of_half_a_minute_and_quick_of_one_generation() -> None:
    assert a.EFFORT.generations == 12
    assert (a.EFFORT.aircraft, a.EFFORT.grid, a.EFFORT.judging_linear) == (2, 2, 8)
    assert (a.EFFORT.choosing, a.EFFORT.judging) == (0, 0)  # none is flown to choose
    quick = a.QUICK_EFFORT
    assert (quick.generations, quick.aircraft, quick.judging_linear) == (1, 1, 1)
    assert a.AirframeJob((1,)).effort == a.EFFORT

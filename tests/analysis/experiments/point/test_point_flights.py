"""`point`: its band, its paths, how flights are pooled and judged, flights with bad and good
brakes, and margins; each number from both sides."""

from __future__ import annotations

from math import cos, hypot, inf, isnan, nan, pi, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from tgl_soar.analysis.brake_loop import BrakeMargin
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.point import brake_faults as b
from tgl_soar.analysis.experiments.point import good_brakes as g
from tgl_soar.analysis.experiments.point import hold_point as e
from tgl_soar.analysis.experiments.point import point_margins as m
from tgl_soar.analysis.experiments.point.good_brakes import DispersedPoint
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.config.files import shipped
from tgl_soar.control.point_hold import ABOVE_BAND, BELOW_BAND, DEAD, HOLDS, UNEVEN
from tgl_soar.control.supervisor import FAILED, REASON_OFF_LINE, RELEASED, SOARING
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.estimation.aerodynamics import braked
from tgl_soar.types import polar_sink

TUNNEL, HILL = (load_scenario(shipped(f"scenarios/point{end}.toml")) for end in ("", "_hill"))

# --- the band -------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", [TUNNEL, HILL])
def test_at_each_end_of_the_band_the_air_rises_as_fast_as_that_brake_sinks(scenario: Any) -> None:
    prepared = prepare(scenario)
    x0, z0, eta = prepared.lines[scenario.first_line].target
    for brake, place in zip((1.0, 0.5, 0.0), e.band(prepared), strict=True):
        assert abs(place) < 3.0
        polar = braked(prepared.airframe.aerodynamics(), brake).polar
        over = []
        for up_m in (place, place + 0.005):  # the first from above, by steps of 5 mm
            u, _, w = prepared.field.wind_at(x0 + up_m * cos(eta), 0.0, z0 + up_m * sin(eta), 0.0)
            over.append(w - polar_sink(polar, u))
        assert over[0] >= 0.0 > over[1]


def test_without_lift_a_band_is_looked_for_three_metres_to_either_side() -> None:
    prepared = prepare(TUNNEL)
    still: Any = SimpleNamespace(wind_at=lambda *_: (9.0, 0.0, 0.0))
    rising: Any = SimpleNamespace(wind_at=lambda *_: (9.0, 0.0, 9.0))
    assert e.band(prepared._replace(field=still)) == pytest.approx((-3.0, -3.0, -3.0), abs=0.006)
    assert e.band(prepared._replace(field=rising)) == (3.0, 3.0, 3.0)


def test_a_scenario_holds_the_point_so_far_along_its_line() -> None:
    held = e.with_point(TUNNEL, -0.2)
    assert held.parameters == {**TUNNEL.parameters, "TGL_HOLD": 1.0, "TGL_ALONG": -0.2}
    values = prepare(held).values
    assert values["TGL_HOLD"] == 1.0
    assert values["TGL_ALONG"] == pytest.approx(-0.2)


# --- flights --------------------------------------------------------------------------------------

STEP_S = 0.1


def flight(ended: str = "", seconds: float = 30.0, **columns: Any) -> FlownScenario:
    time = np.arange(0.0, seconds, STEP_S)
    made = {
        "time_s": time, "x_m": 0.0 * time, "z_m": 0.0 * time, "e_rho_m": 0.0 * time,
        "point_off_m": np.full(len(time), nan), "brake": 0.5 + 0.0 * time,
        "point": np.full(len(time), float(HOLDS)), "wind_mps": 9.0 + 0.0 * time,
    }  # fmt: skip
    made |= {name: np.broadcast_to(np.asarray(c, float), time.shape) for name, c in columns.items()}
    return FlownScenario(seed=1, ended=ended, duration_s=seconds, legs=(), path=made)


def wave(size: float, seconds: float = 30.0) -> Any:
    """Up and down by so much, about nothing."""
    return size * np.where(np.arange(round(seconds / STEP_S)) % 2, 1.0, -1.0)


def test_without_a_point_a_flight_is_measured_about_its_own_mean_along_the_line() -> None:
    eta = 2.0
    far = flight(x_m=5.0 + cos(eta) * wave(0.03), z_m=2.0 + sin(eta) * wave(0.03),
                 e_rho_m=wave(0.02))  # fmt: skip
    assert e.along(far, eta) == pytest.approx(5.0 * cos(eta) + 2.0 * sin(eta) + wave(0.03))
    found = e.held([far], eta, 15.0)
    assert found.along_m == pytest.approx(0.03)
    assert found.across_m == pytest.approx(0.02)
    assert (found.flown, found.lasted, found.given_up) == (1, 1, 0)
    assert found.brake == pytest.approx(0.5)
    assert found.ended == 0.0


def test_with_a_point_it_is_measured_about_that_and_only_once_it_has_settled() -> None:
    time = np.arange(0.0, 30.0, STEP_S)
    off = np.where(time < 14.95, 9.0, 0.05)
    brake = np.where(time < 14.95, 0.3, np.where(time < 20.0, 1.0, np.where(time < 24.0, 0.0, 0.9)))
    one = flight(point_off_m=off, brake=brake, e_rho_m=np.where(time < 14.95, 7.0, 0.01))
    found = e.held([one], 2.0, 15.0)
    assert found.along_m == pytest.approx(0.05)
    assert found.across_m == pytest.approx(0.01)
    assert found.ended == pytest.approx((50 + 40) / 150)
    assert found.brake == pytest.approx((50 * 1.0 + 60 * 0.9) / 150)


def test_all_flights_count_as_far_as_they_flew() -> None:
    lost = flight("hit the board", 10.0, point=float(DEAD))
    two = [flight(point_off_m=0.03), flight("hit the board", 20.0, point_off_m=0.09, point=UNEVEN)]
    found = e.held([*two, lost], 2.0, 15.0)
    assert (found.flown, found.lasted, found.given_up) == (3, 1, 2)
    assert found.along_m == pytest.approx(np.sqrt((150 * 0.03**2 + 50 * 0.09**2) / 200))
    none = e.held([lost], 2.0, 15.0)
    for value in (none.along_m, none.across_m, none.brake, none.ended):
        assert isnan(value)


def test_the_farthest_is_of_all_flights_that_had_settled_to_either_side() -> None:
    time = np.arange(0.0, 30.0, STEP_S)
    one = flight(point_off_m=np.where(time < 14.95, 5.0, -0.004), e_rho_m=0.001)
    two = flight(point_off_m=0.003, e_rho_m=np.where(time > 29.0, -0.006, 0.0))
    assert e._peaks([one, two, flight("x", 9.0, point_off_m=8.0)]) == pytest.approx((0.004, 0.006))
    assert all(map(isnan, e._peaks([])))


@pytest.mark.parametrize("name", ["point_off_m", "e_rho_m"])
@pytest.mark.parametrize("first", [True, False])
def test_a_moment_off_the_line_leaves_no_farthest_and_no_claim(name: str, first: bool) -> None:
    time = np.arange(0.0, 30.0, STEP_S)
    good = flight(point_off_m=0.002)
    columns: dict[str, Any] = {"point_off_m": 0.3, name: np.where(time > 29.85, nan, 0.3)}
    away = flight(**columns)
    peaks = e._peaks([away, good] if first else [good, away])
    assert isnan(peaks[0] if name == "point_off_m" else peaks[1])
    assert not e._still_claim(peaks).holds
    assert not e._still_claim((0.001, nan)).holds


def test_a_flight_that_is_lost_is_not_still() -> None:
    assert e._still_claim((0.001, 0.001)).holds
    assert not e._still_claim((0.001, 0.001), 1).holds


def test_a_moment_off_the_line_leaves_the_rest_about_its_point() -> None:
    time = np.arange(0.0, 30.0, STEP_S)
    one = flight(x_m=0.3, point_off_m=np.where(time > 29.85, nan, 0.3))
    assert e.held([one], 0.0, 15.0).along_m == pytest.approx(0.3)


# --- paths ----------------------------------------------------------------------------------------


def test_a_circle_is_of_5_cm_from_its_lowest_place_flown_at_2_cm_per_second() -> None:
    path = np.array(e.circle())
    assert path[0] == pytest.approx((0.0, -0.05))
    assert np.hypot(*path.T) == pytest.approx(np.full(len(path), 0.05))
    way = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert way / 0.25 == pytest.approx(np.full(len(way), 0.02), rel=0.02)
    assert path[len(path) // 4] == pytest.approx((0.05, 0.0), abs=0.004)  # downstream first
    assert path[len(path) // 2] == pytest.approx((0.0, 0.05), abs=0.004)


def test_a_square_is_of_20_cm_from_its_lower_upstream_corner() -> None:
    path = np.array(e.square())
    way = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert way / 0.25 == pytest.approx(np.full(len(way), 0.02))
    assert len(path) == 161
    corners = [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1)]
    assert path[::40] == pytest.approx(np.array(corners))
    assert path[20] == pytest.approx((0.0, -0.1), abs=1e-9)


def test_a_path_begins_after_a_fifth_of_settling_and_goes_on_each_quarter_second() -> None:
    path = [(0.0, -0.05), (0.01, -0.04), (0.02, 0.0)]
    found = e.flying_path(TUNNEL, path, 15.0)
    assert [change.time_s for change in found.changes] == pytest.approx([3.0, 15.25, 15.5])
    line = prepare(TUNNEL).lines[TUNNEL.first_line].target
    for change, (x, z) in zip(found.changes, path, strict=True):
        assert change.parameters == pytest.approx({"TGL_X": line.x_m + x, "TGL_Z": line.z_m + z})
    assert found.duration_s == pytest.approx(15.0 + 0.75 + 2.0)


def test_an_error_is_to_the_nearest_place_of_the_path_while_it_is_flown() -> None:
    prepared = prepare(TUNNEL)
    x0, z0, eta = prepared.lines[TUNNEL.first_line].target
    path = [(0.01 * i, 0.0) for i in range(21)]  # 5.25 s
    time = np.arange(0.0, 30.0, STEP_S)
    flies = (time > 14.95) & (time < 20.26)
    z = z0 - 0.3 * sin(eta) + np.where(flies, np.where(time < 17.6, 0.03, 0.04), 5.0)
    x = x0 - 0.3 * cos(eta) + 0.1
    error = e.path_error(flight(x_m=x, z_m=z), prepared, path, -0.3, 15.0)
    near = np.count_nonzero(flies & (time < 17.6))
    far = np.count_nonzero(flies) - near
    assert error == pytest.approx(np.sqrt((near * 0.03**2 + far * 0.04**2) / (near + far)))
    assert isnan(e.path_error(flight(seconds=9.0), prepared, path, -0.3, 15.0))


def test_a_row_of_a_path_tells_how_much_of_it_was_within_the_band() -> None:
    time = np.arange(0.0, 30.0, STEP_S)
    point = np.where(time < 22.45, float(HOLDS), float(ABOVE_BAND))
    path = e.PathFlight(TUNNEL, [(0.0, 0.0), (0.01, 0.0)], 0.0, 15.0)
    key = ("tunnel", "a shape", 0.01)
    (row,) = e._shapes({key: path}, {key: [flight(point=point)]}).rows
    assert row[:2] == ("tunnel, a shape", "1")
    assert row[3:] == ("50", "flew to the end")
    (row,) = e._shapes({key: path}, {key: [flight("hit the board", 9.0)]}).rows
    assert row[3:] == ("0", "hit the board")


# --- claims ---------------------------------------------------------------------------------------

HELD = e.Held(along_m=0.1, across_m=0.01, flown=8, lasted=8, brake=0.5, ended=0.0, given_up=0)


def claims(line: dict[str, Any], point: dict[str, Any], gentle: dict[str, Any]) -> list[bool]:
    kept = {("line", i): HELD._replace(**line) for i in e.INTENSITIES}
    kept |= {("point", i): HELD._replace(**{"along_m": 0.04, **point}) for i in e.INTENSITIES}
    kept["point", 0.01] = HELD._replace(**{"along_m": 0.009, "across_m": 0.009, **gentle})
    return [claim.holds for claim in e._claims(kept)]


def test_each_limit_of_the_claims_from_both_sides() -> None:
    assert e.INTENSITIES == (0.01, 0.03, 0.05)
    assert claims({}, {}, {}) == [True] * 4
    assert claims({}, {"along_m": 0.0449}, {})[0]
    assert not claims({}, {"along_m": 0.0451}, {})[0]
    assert claims({}, {"across_m": 0.01099}, {})[1]
    assert not claims({}, {"across_m": 0.01101}, {})[1]
    assert claims({"lasted": 7}, {"lasted": 7}, {})[2]
    assert not claims({"lasted": 7}, {"lasted": 6}, {})[2]
    assert not claims({}, {}, {"lasted": 7})[2]
    for axis in ("along_m", "across_m"):
        assert claims({}, {}, {axis: 0.00999})[3]
        assert not claims({}, {}, {axis: 0.01001})[3]


def test_in_calm_air_five_millimetres_on_both_axes() -> None:
    assert e._still_claim((0.00499, 0.00499)).holds
    assert not e._still_claim((0.00501, 0.001)).holds
    assert not e._still_claim((0.001, 0.00501)).holds
    claim = e._still_claim((0.0012, 0.0034))
    assert "within 5 mm on both axes" in claim.text
    assert claim.measured == "1.2 mm along, 3.4 mm across at most"
    assert e._calm_table({"cameras": (0.0012, 0.0034)}).rows == (("cameras", "1.2", "3.4"),)


def test_a_good_brake_that_is_given_up_anywhere_fails_the_claim() -> None:
    kept = {("line", 0.01): HELD._replace(given_up=1), ("point", 0.01): HELD}
    assert e._taken_claim(kept, [POINT]).holds  # the line has no brake to give up
    assert e._taken_claim(kept, [POINT]).measured == (
        "0 of 8 flights, 0 of 1 with aircraft unlike their file"
    )
    assert not e._taken_claim({**kept, ("point", 0.03): HELD._replace(given_up=1)}, [POINT]).holds
    assert not e._taken_claim(kept, [POINT, POINT._replace(given_up=True)]).holds


def test_the_table_tells_centimetres_and_the_time_at_an_end() -> None:
    one = HELD._replace(along_m=0.0123, across_m=0.0045, lasted=7, brake=0.456, ended=0.25)
    rows = e._table({("line", 0.03): one, ("point", 0.05): one}).rows
    assert rows == (
        ("3", "line", "1.23", "0.45", "7 of 8", "0.46", "–"),
        ("5", "point", "1.23", "0.45", "7 of 8", "0.46", "25"),
    )


# --- bad brakes -----------------------------------------------------------------------------------


def test_a_fault_begins_while_the_brake_fades_in_or_later_and_stays() -> None:
    jobs = b.faulty_jobs([TUNNEL, HILL], 400, 7000)
    early: list[float] = []
    late: list[float] = []
    rolls: list[float] = []
    gusts: list[float] = []
    for i, job in enumerate(jobs):
        (text,) = job.scenario.faults
        kind, start, lasts, *more = text.split(" ")
        assert kind == ("brake.stuck", "brake.one_side")[i % 2]
        assert job.scenario.title == (TUNNEL, HILL)[i // 2 % 2].title
        (early, late)[i // 4 % 2].append(float(start.removeprefix("start=")))
        assert lasts == "for=1000"
        rolls += [float(each.removeprefix("roll=")) for each in more]
        assert job.scenario.turbulence is not None
        gusts.append(job.scenario.turbulence.intensity)
        assert job.seed == 7000 + i
        assert job.scenario.duration_s == 90.0
    assert 1.0 <= min(early) < 1.1
    assert 4.9 < max(early) <= 5.0
    assert 5.0 <= min(late) < 5.5
    assert 29.5 < max(late) <= 30.0
    assert len(rolls) == 200
    assert -0.3 <= min(rolls) < -0.29
    assert 0.29 < max(rolls) <= 0.3
    assert 0.01 <= min(gusts) < 0.0105
    assert 0.0295 < max(gusts) <= 0.03
    assert all(gust == round(gust, 4) for gust in gusts)


def faulty(monkeypatch: pytest.MonkeyPatch, script: Any) -> b.FaultyFlight:
    """A flight of scripted ticks: (standing, mode, crashed) by time; its fault begins at 3 s."""
    fault = "brake.stuck start=3 for=1000"
    scenario = msgspec.structs.replace(TUNNEL, faults=[fault], duration_s=20.0)

    class World:
        step_hz, ticks = 10, 0

        @property
        def time_s(self) -> float:
            return self.ticks / 10.0

        @property
        def crashed(self) -> str:
            return str(script(self.time_s)[2])

    world = World()

    def tick() -> Any:
        world.ticks += 1
        standing, mode, _ = script(world.time_s)
        return SimpleNamespace(
            point=SimpleNamespace(standing=standing), mode=mode, reason=REASON_OFF_LINE
        )

    monkeypatch.setattr(b, "available", lambda: False)
    monkeypatch.setattr(b, "scenario_world", lambda *_: world)
    monkeypatch.setattr(b, "ClosedLoop", lambda *_: SimpleNamespace(tick=tick))
    return b.fly_faulty(ScenarioJob(scenario=scenario, seed=5))


@pytest.mark.parametrize("standing", [DEAD, UNEVEN])
def test_a_fault_is_reported_when_the_point_is_first_given_up(
    standing: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = faulty(monkeypatch, lambda t: (standing if t >= 8.0 else HOLDS, SOARING, ""))
    assert found.reported_s == pytest.approx(5.0)
    assert (found.standing, found.lost, found.handed_over) == (standing, "", "")
    assert found.duration_s == pytest.approx(20.0)
    assert (found.place, found.kind, found.seed) == ("tunnel", "brake.stuck", 5)
    assert found.fault == "brake.stuck start=3 for=1000"
    assert TUNNEL.turbulence is not None
    assert found.turbulence == TUNNEL.turbulence.intensity
    again = faulty(monkeypatch, lambda t: (standing if 8.0 <= t < 9.0 else HOLDS, SOARING, ""))
    assert again.reported_s == pytest.approx(5.0)
    assert again.standing == HOLDS


def test_a_flight_ends_where_it_is_handed_over_or_hits_something(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for mode in (RELEASED, FAILED):
        over = faulty(monkeypatch, lambda t, mode=mode: (HOLDS, mode if t >= 6.0 else SOARING, ""))
        assert over.handed_over == REASON_TEXTS[REASON_OFF_LINE]
        assert over.duration_s == pytest.approx(6.0)
        assert over.lost == ""
    hit = faulty(monkeypatch, lambda t: (HOLDS, SOARING, "hit the board at x 1, z 2" * (t > 7.0)))
    assert (hit.lost, hit.handed_over) == ("hit the board", "")
    assert hit.duration_s == pytest.approx(7.1)
    assert isnan(hit.reported_s)


# --- good brakes ----------------------------------------------------------------------------------

POINT = DispersedPoint(
    place="tunnel", turbulence=0.01, held=0.8, outside=0.1, given_up=False, ended="",
    duration_s=90.0,
)  # fmt: skip


def test_good_brakes_fly_calm_1_and_3_percent_with_an_aircraft_for_each_seed() -> None:
    jobs = g.dispersed_jobs([TUNNEL, HILL], 3)
    assert len(jobs) == 2 * 3 * 3
    assert all(job.dispersed and job.scenario.duration_s == 90.0 for job in jobs)
    assert [job.seed for job in jobs[:3]] == [30_000, 30_001, 30_002]
    found = [cast("Any", job.scenario.turbulence).intensity for job in jobs[::3]]
    assert found == [0.0, 0.01, 0.03] * 2


def test_a_point_stands_within_the_band_outside_or_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    standing = [HOLDS] * 6 + [ABOVE_BAND] * 2 + [BELOW_BAND] * 1 + [DEAD] * 1
    for last, given_up in ((DEAD, True), (UNEVEN, True), (HOLDS, False)):
        point = np.array([*standing[:-1], last] * 30)
        monkeypatch.setattr(g, "fly_job_compiled", lambda _job, p=point: flight("x", 30.0, point=p))
        found = g.fly_dispersed(ScenarioJob(scenario=HILL, seed=1))
        assert found.held == pytest.approx(0.6 if given_up else 0.7)
        assert found.outside == pytest.approx(0.3)
        assert found.given_up is given_up
        assert (found.place, found.ended, found.duration_s) == ("hill", "x", 30.0)


def test_a_row_of_good_brakes_is_of_one_place_and_turbulence() -> None:
    flights = [
        POINT, POINT._replace(ended="x", given_up=True, held=0.4, outside=0.3),
        POINT._replace(turbulence=0.03), POINT._replace(place="hill"),
    ]  # fmt: skip
    assert g.good_brakes_table(flights).rows == (
        ("tunnel", "1", "1 of 2", "1", "60", "20"),
        ("tunnel", "3", "1 of 1", "0", "80", "10"),
        ("hill", "1", "1 of 1", "0", "80", "10"),
    )


# --- margins --------------------------------------------------------------------------------------

GOOD = BrakeMargin(alpha=0.6, crossover_radps=1.2, elevator_alpha=0.7, line_alpha=0.8)


def test_margins_are_looked_at_over_speeds_and_leans_now_and_17_ms_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def margin(laws: Any, condition: Any) -> BrakeMargin:
        asked.append((laws, condition))
        return GOOD._replace(alpha=0.6 - 0.01 * condition.lean_rad - condition.command_delay_s)

    monkeypatch.setattr(m, "brake_margin", margin)
    found = m.point_margins({"tunnel": prepare(TUNNEL)})
    assert [(each.place, each.speed_mps) for each in found] == [
        ("tunnel", 8.7), ("tunnel", 10.0), ("tunnel", 12.0),
    ]  # fmt: skip
    conditions = [condition for _, condition in asked]
    assert len(conditions) == 3 * 2 * 3
    leans = [round(c.lean_rad * 180.0 / pi) for c in conditions]
    assert leans == [10, 15, 25] * 6
    late = sorted({round(c.command_delay_s, 6) for c in conditions})
    assert late == [0.0075, 0.0245]
    assert all(c.sensors.imu is not None and c.sensors.airspeed is None for c in conditions)
    least = 0.6 - 0.01 * 25.0 * pi / 180.0
    assert found[0].margin.alpha == pytest.approx(least - 0.0075)
    assert found[0].later_alpha == pytest.approx(least - 0.0245)
    assert hypot(*conditions[0].gradient_per_s) > 0.0


def test_the_least_of_margins_and_the_fastest_crossover_count() -> None:
    other = BrakeMargin(alpha=0.5, crossover_radps=1.5, elevator_alpha=0.9, line_alpha=0.4)
    assert m._least([GOOD, other]) == BrakeMargin(
        alpha=0.5, crossover_radps=1.5, elevator_alpha=0.7, line_alpha=0.4
    )


def test_both_loops_and_the_later_brake_keep_one_half() -> None:
    point = m.PointMargin("tunnel", 8.7, GOOD, 0.55)
    assert m.margins_claim([point]).holds
    assert m.margins_claim([point]).measured == (
        "the brake's 0.55, the elevator's 0.70 (0.80 without the brake)"
    )
    for low in (
        point._replace(later_alpha=0.49),
        point._replace(margin=GOOD._replace(alpha=0.49)),
        point._replace(margin=GOOD._replace(elevator_alpha=0.49)),
    ):
        assert not m.margins_claim([point, low]).holds
    for kept in (point._replace(later_alpha=0.5), point._replace(later_alpha=inf)):
        assert m.margins_claim([point, kept]).holds
    # Without the brake the line's own margin is for others to judge.
    assert m.margins_claim([point._replace(margin=GOOD._replace(line_alpha=0.1))]).holds
    table = m.margins_table([point])
    assert table.rows == (("tunnel", "8.7", "0.60", "1.2", "0.55", "0.70", "0.80"),)
    assert table.columns[4] == "17 ms later"
    assert table.title == "Disk margins, the least of leans of 10° to 25°"


def test_line_point_and_square_are_drawn_into_one_file(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    path = tmp_path / "point.png"
    e._draw(path, [flight()], [flight()], flight(), -0.1, prepare(TUNNEL))
    assert path.read_bytes().startswith(b"\x89PNG")

"""The flights of `hour` and `beating`: aircraft, hill and parameters, and what is read off a path;
and what could be soared of an hour, beside sums made here."""

from __future__ import annotations

from dataclasses import replace
from math import cos, degrees, isnan, nan, pi, radians
from typing import Any

import numpy as np
import pytest

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.wind_record import RecordedField, SyntheticWind, WindRecord, synthetic_record
from tgl_soar.analysis.experiments.outdoors import beating, hour
from tgl_soar.analysis.experiments.outdoors.beating import (
    LULLS,
    OBLIQUE,
    BeatFlight,
    BeatJob,
    cases,
    fly_beating,
)
from tgl_soar.analysis.experiments.outdoors.hour import (
    BEATS,
    LINE,
    POWERED,
    WALK,
    FlownHour,
    HourCase,
    HourJob,
    field_of,
    fly_hour,
    hill_of,
    hour_flown,
    record_of,
)
from tgl_soar.analysis.experiments.outdoors.hour_bound import (
    SoaredHill,
    longest_s,
    sinks,
    soarable_fraction,
    soarable_winds,
    wind_across,
)
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.config.site import HillAir
from tgl_soar.control.envelope import Fence
from tgl_soar.control.supervisor import BEATING, BREAKING_OFF, LANDING, SOARING
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.sensors import MEMS_IMU
from tgl_soar.types import GlidePolar, polar_sink

PLAIN = shipped_hill().on_line("a")

# --- what flies -----------------------------------------------------------------------------------


def test_over_the_shipped_hill_all_is_as_shipped_but_for_leave_and_veer() -> None:
    flown = hour_flown(HourJob(HourCase(8.0, 9.0, 2), 1))
    assert flown.airframe == PLAIN.airframe
    assert flown.site == PLAIN.site
    differs = {each.name: value for each, value in flown.values if value != PLAIN.values[each.name]}
    assert differs == {"ESC_AUTO": 2.0, "VEER_MAX": 45.0}
    narrow = hour_flown(HourJob(HourCase(8.0), 1), veer_max_deg=25.0)
    assert (narrow.values["ESC_AUTO"], narrow.values["VEER_MAX"]) == (1.0, 25.0)


def test_the_large_hill_is_the_shipped_one_by_its_radius() -> None:
    by = 30.0 / 8.0
    flown = hour_flown(HourJob(HourCase(30.0), 1))
    values, plain = flown.values, PLAIN.values
    scaled = (
        *("FENCE_X_MIN", "FENCE_X_MAX", "FENCE_Y_MAX", "FENCE_Z_MAX", "ESC_X", "WPT_X"),
        *("TGL_X", "TGL_Z"),
    )
    for name in scaled:
        assert values[name] == pytest.approx(by * plain[name]), name
    assert plain["ESC_X"] != 0.0
    assert values["LND_X"] == -80.0  # fifty metres before its foot
    same = {each.name for each, value in values if value == plain[each.name]}
    changed = {*scaled, "LND_X", "ESC_AUTO", "VEER_MAX"} - {"FENCE_X_MAX"}
    assert {each.name for each, _ in values} - same <= changed
    air, ground, start = flown.site.air, flown.site.ground, flown.site.start
    assert isinstance(air, HillAir)
    assert (air.radius_m, air.wind_mps) == (30.0, PLAIN.air.wind_mps)
    assert ground is not None
    assert start is not None
    assert PLAIN.site.ground is not None
    for (x_m, z_m), (own_x_m, own_z_m) in zip(
        ground.profile, PLAIN.site.ground.profile, strict=True
    ):
        assert (x_m, z_m) == pytest.approx((by * own_x_m, by * own_z_m))
    assert (start.x_m, start.z_m) == pytest.approx((values["TGL_X"], values["TGL_Z"] - 0.5))


@pytest.mark.parametrize("who", [POWERED, WALK])
def test_a_propeller_may_be_used_for_ten_minutes(who: str) -> None:
    flown = hour_flown(HourJob(HourCase(8.0, 7.0, 0, who), 1))
    assert flown.airframe == shipped_hill("eclipson_c_propeller").airframe != PLAIN.airframe
    assert flown.values["THR_BUDGET"] == 600.0
    assert flown.values["ESC_AUTO"] == 0.0
    assert flown.values["BEAT_AUTO"] == PLAIN.values["BEAT_AUTO"]


@pytest.mark.parametrize("radius_m", [8.0, 30.0])
def test_who_may_beat_has_a_hundred_metres_to_either_side(radius_m: float) -> None:
    flown = hour_flown(HourJob(HourCase(radius_m, 7.0, 2, BEATS), 1))
    assert flown.airframe == PLAIN.airframe
    given = {name: flown.values[name] for name in ("BEAT_AUTO", "BEAT_WIDTH", "FENCE_Y_MAX")}
    assert given == {"BEAT_AUTO": 2.0, "BEAT_WIDTH": 100.0, "FENCE_Y_MAX": 150.0}
    assert flown.values["THR_BUDGET"] == PLAIN.values["THR_BUDGET"]


def test_a_record_is_of_the_cases_mean_and_the_seed() -> None:
    record = record_of(HourJob(HourCase(8.0, 9.0), 5))
    wanted = synthetic_record(SyntheticWind(mean_mps=9.0), 5)
    assert record.wind_mps.values == wanted.wind_mps.values
    assert record.veer_rad.values == wanted.veer_rad.values


def test_the_air_is_the_hills_in_the_records_wind() -> None:
    flown = hour_flown(HourJob(HourCase(30.0), 1))
    record = WindRecord(Schedule([0.0], [9.0]), Schedule([0.0], [0.0]))
    field = field_of(flown, record)
    assert isinstance(field, RecordedField)
    own = HillField(9.0, 30.0).wind_at(-20.0, 0.0, 50.0, 0.0)
    assert field.wind_at(-20.0, 0.0, 50.0, 3.0) == pytest.approx(own)


def test_a_world_has_gusts_of_3_percent_accelerometers_and_no_pitot() -> None:
    job = HourJob(HourCase(8.0), 1, 60.0)
    world = hour._world_of(job, hour_flown(job), record_of(job))
    assert world.sensors.imu == MEMS_IMU
    assert world.sensors.airspeed is None
    assert hour.INTENSITY == 0.03
    params = world.parts.turbulence.params
    half = shipped_turbulence(0.015)
    assert params.gain_long == pytest.approx(2.0 * half)


def shipped_turbulence(intensity: float) -> float:
    """Of such gusts over the shipped hill."""
    job = HourJob(HourCase(8.0), 1, 60.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hour, "INTENSITY", intensity)
        return hour._world_of(
            job, hour_flown(job), record_of(job)
        ).parts.turbulence.params.gain_long


def test_the_bounds_know_radius_fence_clearance_and_polar() -> None:
    job = HourJob(HourCase(30.0), 1)
    values = hour_flown(job).values
    hill = hill_of(job, values)
    assert hill.radius_m == 30.0
    assert (hill.fence.x_min_m, hill.fence.z_max_m) == pytest.approx((-90.0, 90.0))
    assert hill.clearance_m == values["CLEAR_MIN"] == 1.0
    assert hill.polar == PLAIN.airframe.polar.as_polar()


# --- what is read off a path ----------------------------------------------------------------------

STEP_S = 0.5
VALUES = {"LND_X": -28.0, "LND_Y": 2.0, "LND_Z": 0.4, "TGL_X": -6.2, "TGL_Z": 14.2}
FALLS = WindRecord(
    Schedule([0.0, 20.0, 40.0], [7.0, 7.0, 5.0]),
    Schedule([0.0, 10.0, 30.0, 60.0], [0.0, -0.3, 0.2, 0.9]),
)


def path(ended: str = "hit the ground at x -30.0, z 0.0 m", **columns: Any) -> Trajectory:
    """Sixty seconds: soaring for half of them, then breaking off, and landing in the last ten."""
    time = np.arange(0.0, 60.0, STEP_S)
    mode = np.where(time < 30.0, SOARING, np.where(time < 50.0, BREAKING_OFF, LANDING))
    made = {
        "time_s": time,
        "mode": mode.astype(float),
        "x_m": np.full(len(time), -31.0),
        "y_m": np.full(len(time), 1.5),
        "z_m": 15.2 - 0.25 * time,
        "height_left_m": 6.0 - 0.1 * time,
        "throttle": np.where(time < 4.0, 0.5, 0.0),
        "heading_rad": np.zeros(len(time)),
    }
    made |= {name: np.asarray(column, dtype=float) for name, column in columns.items()}
    return Trajectory(made, ended, len(time))


def hour_of(monkeypatch: pytest.MonkeyPatch, flown: Trajectory) -> FlownHour:
    hill = SoaredHill(radius_m=8.0, fence=FENCE, clearance_m=1.0, polar=POLAR)
    monkeypatch.setattr(hour, "path_of", lambda *_: (flown, VALUES))
    monkeypatch.setattr(hour, "record_of", lambda _job: FALLS)
    monkeypatch.setattr(hour, "hill_of", lambda *_: hill)
    return fly_hour(HourJob(HourCase(8.0), 3, 60.0))


FENCE = Fence(x_min_m=-24.0, x_max_m=0.0, y_max_m=16.0, z_min_m=0.5, z_max_m=24.0)
POLAR = PLAIN.airframe.polar.as_polar()


def test_a_flight_that_breaks_off_tells_when_how_high_and_in_which_wind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = hour_of(monkeypatch, path())
    assert found.ended == "hit the ground"
    assert found.duration_s == pytest.approx(59.5)
    assert found.soared_s == pytest.approx(30.0)
    assert found.left_m == pytest.approx(3.0)
    assert found.broke_at_m == pytest.approx(15.2 - 7.5 - 0.4)
    assert found.wind_mps == pytest.approx(6.0)  # of 30 s
    assert found.veer_deg == pytest.approx(degrees(0.3))  # to either side, until then
    assert (found.along_m, found.across_m) == pytest.approx((3.0, -0.5))
    assert found.sink_mps == pytest.approx(0.25)
    assert found.landing
    assert found.throttle_s == pytest.approx(2.0)
    assert (found.case, found.seed) == (HourCase(8.0), 3)
    across = wind_across(FALLS, 60.0)
    hill = SoaredHill(radius_m=8.0, fence=FENCE, clearance_m=1.0, polar=POLAR)
    assert found.possible_s == longest_s(hill, across, -6.2, 14.2)
    assert found.soarable == soarable_fraction(hill, across)


def test_a_flight_to_the_end_tells_of_its_weakest_wind(monkeypatch: pytest.MonkeyPatch) -> None:
    steady = path("", mode=np.full(120, SOARING))
    found = hour_of(monkeypatch, steady)
    assert found.ended == ""
    assert found.soared_s == found.duration_s == pytest.approx(59.5)
    assert isnan(found.left_m)
    assert isnan(found.broke_at_m)
    assert found.wind_mps == pytest.approx(5.0)
    assert not found.landing
    assert found.veer_deg == pytest.approx(degrees(FALLS.veer_rad.at(59.0)))
    hit = hour_of(monkeypatch, path("hit the hill at x 1, z 2 m"))
    assert (hit.ended, hit.landing) == ("hit the hill", False)
    assert not hour_of(monkeypatch, path(mode=np.full(120, BREAKING_OFF))).landing


def beat_of(monkeypatch: pytest.MonkeyPatch, flown: Trajectory) -> BeatFlight:
    monkeypatch.setattr(beating, "_path", lambda _job: (flown, VALUES))
    return fly_beating(
        BeatJob(kind=LULLS, case=HourCase(8.0, 7.0, 2, BEATS), seed=3, duration_s=60.0)
    )


def test_who_beats_tells_how_long_how_low_and_how_often_it_turned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = np.arange(0.0, 60.0, STEP_S)
    mode = np.where(time < 5.0, SOARING, np.where(time < 25.0, BEATING, BREAKING_OFF))
    mode = np.where(time >= 55.0, LANDING, mode)
    # A heading of 30 degrees to one side, then the other, every four seconds; a flicker of one
    # tick between two whole seconds is no turn.
    heading = np.where((time // 4.0) % 2.0 < 1.0, 0.5, -0.5)
    heading[17] *= -1.0
    flown = path(mode=mode, heading_rad=heading, z_m=20.0 - 0.3 * time)
    found = beat_of(monkeypatch, flown)
    assert found.aloft_s == pytest.approx(25.0)
    assert found.beating_s == pytest.approx(20.0)
    assert found.turns == 5  # at 8, 12, 16, 20 and 24 s
    assert found.least_m == pytest.approx(20.0 - 0.3 * 24.5)
    assert found.left_m == pytest.approx(3.5)
    assert (found.along_m, found.across_m) == pytest.approx((3.0, -0.5))
    assert found.sink_mps == pytest.approx(0.3)
    assert found.ended == "hit the ground"
    assert found.landing
    assert found.landed
    assert found.broke_off
    assert not found.lost
    assert (found.seed, found.kind) == (3, LULLS)
    assert found.duration_s == pytest.approx(59.5)


def test_who_does_not_beat_has_nothing_to_tell_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = beat_of(monkeypatch, path("", mode=np.full(120, SOARING)))
    assert (found.beating_s, found.turns) == (0.0, 0)
    assert isnan(found.least_m)
    assert isnan(found.left_m)
    assert not found.broke_off
    assert not found.landing
    assert found.aloft_s == pytest.approx(59.5)
    hill = beat_of(monkeypatch, path("hit the hill at x 1, z 2 m"))
    assert (hill.ended, hill.landing, hill.lost) == ("hit the hill", False, True)


def test_who_may_beat_flies_the_hours_winds_and_one_too_oblique() -> None:
    rows = cases()
    lulls = [(case, seconds) for kind, case, seconds in rows if kind == LULLS]
    assert lulls == [
        (HourCase(radius, mean, 2, who), 3600.0)
        for radius in (8.0, 30.0)
        for mean in (7.0, 9.0)
        for who in (LINE, BEATS)
    ]
    assert rows[8:] == tuple((OBLIQUE, HourCase(30.0, 8.0, 2, who), 600.0) for who in (LINE, BEATS))


def test_an_oblique_wind_begins_to_turn_within_half_a_minute_by_two_degrees_a_second() -> None:
    begins, turns = [], []
    for seed in range(200):
        job = BeatJob(kind=OBLIQUE, case=cases()[-1][1], seed=seed, duration_s=600.0)
        times, veers = beating.wind_of(job).veer_rad.times_s, beating.wind_of(job).veer_rad.values
        assert veers[:2] == pytest.approx((0.0, 0.0))
        begins.append(times[1])
        turns.append(abs(degrees(veers[2])))
        assert turns[-1] / (times[2] - times[1]) == pytest.approx(2.0)
    assert 10.0 <= min(begins) < 10.5
    assert 29.5 < max(begins) <= 30.0
    assert 45.0 <= min(turns) < 45.5
    assert 59.5 < max(turns) <= 60.0


def test_the_nose_may_follow_by_less_where_the_wind_is_too_oblique(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[HourJob, float]] = []

    def path_of(job: HourJob, _record: WindRecord, most_deg: float) -> Any:
        asked.append((job, most_deg))

    monkeypatch.setattr(beating, "path_of", path_of)
    for kind in (OBLIQUE, LULLS):
        beating._path(
            BeatJob(kind=kind, case=HourCase(8.0), seed=3, duration_s=9.0, dispersed=True)
        )
    job = HourJob(HourCase(8.0), 3, 9.0, dispersed=True)
    assert asked == [(job, 25.0), (job, 45.0)]


@pytest.mark.parametrize(("home", "landed", "holds"), [(20, 19, True), (20, 18, False)])
def test_95_of_100_that_break_off_must_touch_down_well(home: int, landed: int, holds: bool) -> None:
    good = BeatFlight(
        kind=LULLS, case=HourCase(30.0, 7.0, 2, BEATS), seed=1, duration_s=60.0, aloft_s=50.0,
        beating_s=9.0, turns=1, least_m=9.0, ended="hit the ground", left_m=1.0, along_m=0.0,
        across_m=0.0, sink_mps=0.5, landing=True,
    )  # fmt: skip
    far = replace(good, along_m=11.0)
    flown = [good] * landed + [far] * (home - landed)
    assert beating._claims(flown)[4].holds is holds
    hours = [
        FlownHour(
            case=HourCase(30.0),
            seed=1,
            duration_s=60.0,
            possible_s=60.0,
            soarable=1.0,
            soared_s=30.0,
            ended="hit the ground",
            left_m=1.0,
            broke_at_m=9.0,
            wind_mps=6.0,
            veer_deg=9.0,
            along_m=each.along_m,
            across_m=0.0,
            sink_mps=0.5,
            landing=True,
        )
        for each in flown
    ]
    assert hour._claims(hours)[2].holds is holds
    empty = beating._claims([])
    assert [claim.measured for claim in empty[2:]] == ["none flown", "none beat", "none broke off"]
    assert hour._claims([replace(hours[0], left_m=nan)])[2].measured == "none broke off"


# --- what could be soared -------------------------------------------------------------------------

FLAT = GlidePolar(c0=0.5, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=8.0, speed_max_mps=12.0)


def test_a_sink_is_the_polars() -> None:
    speeds = np.array([8.0, 9.5, 11.0])
    assert sinks(POLAR, speeds) == pytest.approx([polar_sink(POLAR, v) for v in speeds.tolist()])
    hill = SoaredHill(radius_m=8.0, fence=FENCE, clearance_m=1.0, polar=FLAT)
    assert hill.speeds_mps == (7.7, 13.0)  # as far as rollouts of the search take it


@pytest.mark.parametrize("sink_mps", [0.5, 3.0])
def test_some_place_is_soarable_where_the_flow_by_hand_says_so(sink_mps: float) -> None:
    """Every place of a fine grid, by the equations of the flow over a half cylinder.  A wing that
    sinks by little is soared wherever it can fly, one that sinks by much where the air rises."""
    hill = SoaredHill(radius_m=8.0, fence=FENCE, clearance_m=1.5, polar=FLAT._replace(c0=sink_mps))
    winds, possible = soarable_winds(hill, 9.0)
    assert winds[0] == 0.0
    assert np.diff(winds) == pytest.approx(np.full(len(winds) - 1, 0.05))
    assert winds[-1] >= 9.0
    x, z = np.meshgrid(np.linspace(-24.0, 0.0, 200), np.linspace(0.5, 24.0, 200))
    r = np.hypot(x, z)
    x, z, r = (part[r >= 9.5] for part in (x, z, r))
    u1, w1 = 1.0 - 64.0 * (x**2 - z**2) / r**4, -2.0 * 64.0 * x * z / r**4
    for wind, found in zip(winds[::3].tolist(), possible[::3].tolist(), strict=True):
        near = [
            bool(np.any((k * u1 >= 7.7) & (k * u1 <= 13.0) & (k * w1 >= sink_mps)))
            for k in (wind - 0.06, wind, wind + 0.06)
        ]
        if len(set(near)) == 1:
            assert found == near[0], wind
    assert possible.any()
    assert not possible.all()


def test_a_fraction_is_of_the_nearest_winds_in_the_table() -> None:
    hill = SoaredHill(radius_m=8.0, fence=FENCE, clearance_m=1.5, polar=FLAT)
    winds, possible = soarable_winds(hill, 9.0)
    least = float(winds[possible].min())
    given = np.array([least + 0.02, least - 0.02, least - 0.03, least + 0.03, 1.0, 9.0, 9.0, 9.0])
    assert soarable_fraction(hill, given) == pytest.approx(6.0 / 8.0)


def test_the_wind_across_is_that_of_each_second() -> None:
    record = WindRecord(Schedule([0.0, 10.0], [6.0, 8.0]), Schedule([0.0, 10.0], [0.0, pi / 3.0]))
    across = wind_across(record, 11.0)
    assert len(across) == 11
    assert across[5] == pytest.approx(7.0 * cos(radians(30.0)))
    assert across[10] == pytest.approx(4.0)


def test_a_path_without_lift_sinks_at_the_least_and_ends_at_the_fence() -> None:
    """0.5 m/s of sink at any speed: in a wind of 8 m/s far from the hill nothing rises."""
    far = SoaredHill(
        radius_m=1.0,
        fence=FENCE._replace(x_min_m=-400.0, x_max_m=-200.0),
        clearance_m=1.0,
        polar=FLAT,
    )
    seconds = longest_s(far, np.full(100, 8.0), -300.0, 10.2)
    # (10.2 - 0.5) / 0.5 steps can be taken, and the twentieth is below the fence.
    assert seconds == pytest.approx(19.0, abs=1.0)
    assert longest_s(far, np.full(10, 8.0), -300.0, 10.2) == 10.0
    # A wind of 19 m/s is flown in at 13 with 6 m/s over the ground, one of 19.5 not at all.
    assert longest_s(far, np.full(10, 18.9), -300.0, 10.2) == 10.0
    assert longest_s(far, np.full(10, 19.6), -300.0, 10.2) == 0.0
    # Against 1.8 m/s it is flown at 7.7 with 6 m/s upwind, and at 1.6 m/s not.
    assert longest_s(far, np.full(10, 1.8), -300.0, 10.2) == 10.0
    assert longest_s(far, np.full(10, 1.6), -300.0, 10.2) == 0.0


def test_a_path_is_blown_out_of_the_fence_by_a_wind_faster_than_it_flies() -> None:
    """16 m/s of wind and 13 of airspeed: 3 m/s backwards, 30 m to the fence."""
    far = SoaredHill(
        radius_m=1.0,
        fence=FENCE._replace(x_min_m=-400.0, x_max_m=-270.0),
        clearance_m=1.0,
        polar=FLAT,
    )
    assert longest_s(far, np.full(60, 16.0), -300.0, 24.0) == pytest.approx(10.0, abs=1.0)
    slow = SoaredHill(
        radius_m=1.0,
        fence=FENCE._replace(x_min_m=-330.0, x_max_m=-200.0),
        clearance_m=1.0,
        polar=FLAT,
    )
    # 4.7 m/s of wind and 7.7 of airspeed: 3 m/s forwards, 30 m to the fence.
    assert longest_s(slow, np.full(60, 4.72), -300.0, 24.0) == pytest.approx(10.0, abs=1.0)


def test_a_path_begins_where_it_is_asked_to() -> None:
    hill = SoaredHill(radius_m=8.0, fence=FENCE, clearance_m=1.0, polar=POLAR)
    assert longest_s(hill, np.full(5, 7.0), -6.2, 14.2) == 5.0
    assert longest_s(hill, np.full(20, 7.0), -0.2, 9.2) < 20.0  # over the crest nothing rises

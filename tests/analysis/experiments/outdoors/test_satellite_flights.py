"""The flights of `satellites`: what goes wrong in them, in which world, and what is looked at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, hypot, inf, isnan, nan, radians, sin
from random import Random

import pytest
from scripted import Moment, ScriptedLoop, air_of_seeds

from tgl_soar.analysis.experiments.outdoors import satellites as sat
from tgl_soar.analysis.experiments.outdoors.satellites import SatelliteJob, SinceFault
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.control.supervisor import (
    CAPTURING,
    FAILED,
    LANDING,
    REASON_POSITION_LOST,
    RELEASED,
    SOARING,
)
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.sim.faults import Fault, parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import AUTOPILOT_POSITION, DRIFTING_POSITION, MEMS_IMU, RTK_POSITION
from tgl_soar.types import Ground

SEEDS = range(200)


def faults_of(kind: str, seed: int) -> tuple[Fault, ...]:
    texts = sat._drawn_faults(SatelliteJob(kind, seed), Random(f"{kind} {seed}"))
    return tuple(map(parse_fault, texts))


# --- what goes wrong ------------------------------------------------------------------------------


def test_a_reset_is_five_metres_in_any_direction_and_up_to_two_in_height_for_good() -> None:
    every = [faults_of(sat.RESET, seed) for seed in SEEDS]
    turns, heights = [], []
    for (fault,) in every:
        assert fault.kind.name == "position.bias"
        assert hypot(fault["north"], fault["east"]) == pytest.approx(5.0, abs=0.002)
        assert fault["for"] == 1e5
        assert 15.0 <= fault.start_s <= 17.0
        heights.append(fault["down"])
        turns.append((fault["north"] > 0.0, fault["east"] > 0.0))
    assert len(set(turns)) == 4
    assert -2.0 <= min(heights) < -1.8
    assert 1.8 < max(heights) <= 2.0
    begins = [fault.start_s for (fault,) in every]
    assert min(begins) < 15.1
    assert max(begins) > 16.9


def test_a_turn_is_of_ten_degrees_to_either_side_and_of_the_heading_alone() -> None:
    every = [faults_of(sat.TURNED, seed) for seed in SEEDS]
    assert {fault["heading"] for (fault,) in every} == {-10.0, 10.0}
    for (fault,) in every:
        assert fault.kind.name == "attitude.bias"
        assert (fault["roll"], fault["pitch"]) == (0.0, 0.0)
        assert fault["for"] == 1e5
        assert 15.0 <= fault.start_s <= 17.0


@pytest.mark.parametrize(
    ("kind", "least_m", "most_m", "up_m"),
    [(sat.RECEIVER, 0.3, 2.0, 1.0), (sat.RTK, 0.05, 0.4, 0.4)],
)
def test_a_receiver_steps_three_times_and_falls_silent_twice(
    kind: str, least_m: float, most_m: float, up_m: float
) -> None:
    every = [faults_of(kind, seed) for seed in SEEDS]
    steps = [fault for faults in every for fault in faults[:3]]
    silent = [fault for faults in every for fault in faults[3:]]
    assert len(silent) == 2 * len(every)
    assert {fault.kind.name for fault in steps} == {"position.bias"}
    sizes = [hypot(fault["north"], fault["east"]) for fault in steps]
    assert least_m - 0.001 <= min(sizes) < least_m + 0.05 * (most_m - least_m)
    assert most_m - 0.05 * (most_m - least_m) < max(sizes) <= most_m + 0.001
    for name in ("north", "east"):
        assert {fault[name] > 0.0 for fault in steps} == {True, False}
    heights = [fault["down"] for fault in steps]
    assert -up_m <= min(heights) < -0.95 * up_m
    assert 0.95 * up_m < max(heights) <= up_m
    lasts = [fault["for"] for fault in steps]
    assert 5.0 <= min(lasts) < 5.5
    assert 19.5 < max(lasts) <= 20.0
    begins = [fault.start_s for fault in steps]
    assert 17.0 <= min(begins) < 19.0
    assert 148.0 < max(begins) <= 150.0  # each is over before the flight is

    assert {fault.kind.name for fault in silent} == {"position.reckoned"}
    for fault in silent:
        assert hypot(fault["north"], fault["east"]) == pytest.approx(0.03, abs=1e-4)
        assert fault["reported"] == 1e6  # never
    lasts = [fault["for"] for fault in silent]
    assert 1.0 <= min(lasts) < 1.2
    assert 5.8 < max(lasts) <= 6.0
    begins = [fault.start_s for fault in silent]
    assert 17.0 <= min(begins) < 19.0
    assert 158.0 < max(begins) <= 160.0


@pytest.mark.parametrize("kind", [sat.HOME, sat.HELD, sat.UNREPORTED])
def test_satellites_are_lost_for_15_s_and_it_is_reported_late_or_not(kind: str) -> None:
    every = [fault for seed in SEEDS for fault in faults_of(kind, seed)]
    assert len(every) == len(SEEDS)
    for fault in every:
        assert fault.kind.name == "position.reckoned"
        assert fault["for"] == 15.0
        assert hypot(fault["north"], fault["east"]) == pytest.approx(0.03, abs=1e-4)
        assert 15.0 <= fault.start_s <= 17.0
    assert len({fault["north"] > 0.0 for fault in every}) == 2
    reported_s = [fault["reported"] for fault in every]
    if kind == sat.UNREPORTED:
        assert set(reported_s) == {1e6}
    else:
        assert 5.0 <= min(reported_s) < 5.2
        assert 9.8 < max(reported_s) <= 10.0


def test_a_flight_lasts_until_its_fault_is_over_and_watched() -> None:
    assert sat._duration_s(sat.RECEIVER) == sat._duration_s(sat.RTK) == 180.0
    assert sat._duration_s(sat.RESET) == sat._duration_s(sat.TURNED) == 17.0 + 20.0
    assert sat._duration_s(sat.HELD) == sat._duration_s(sat.UNREPORTED) == 17.0 + 15.0 + 20.0
    assert sat._duration_s(sat.HOME) == 17.0 + 15.0 + 60.0


# --- the world ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", sat.KINDS)
def test_each_kind_has_its_receiver_and_its_leave_to_break_off(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sat, "available", lambda: False)
    world, values, frame = sat._world(SatelliteJob(kind, 3), Random("air 3"), 40.0)
    receiver = {sat.RECEIVER: DRIFTING_POSITION, sat.RTK: RTK_POSITION}.get(
        kind, AUTOPILOT_POSITION
    )
    assert world.sensors.position == receiver
    assert world.sensors.imu == MEMS_IMU
    assert world.sensors.airspeed is None
    assert values["ESC_AUTO"] == (1.0 if kind == sat.HOME else 0.0)
    plain = shipped_hill().on_line("a").values
    sigma_m = {sat.RECEIVER: 0.02, sat.RTK: 0.01}.get(kind, plain["EST_FIX_SD"])
    assert values["EST_FIX_SD"] == pytest.approx(sigma_m)
    assert (values["TGL_X"], values["TGL_Z"]) == pytest.approx((-6.2, 14.2))
    assert (world.state.x_m, world.state.z_m) == pytest.approx((-6.2, 13.7))
    assert frame == world.frame
    wind_mps = world.field.reference_wind_mps
    assert 6.9 <= wind_mps <= 7.4
    assert world.parts.turbulence.params.gain_long > 0.0


def test_wind_and_gusts_are_the_seeds_and_fill_their_ranges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    winds, gusts = air_of_seeds(
        monkeypatch,
        sat,
        lambda seed: sat._world(SatelliteJob(sat.RESET, seed), Random(f"air {seed}"), 40.0),
    )
    assert 6.9 <= min(winds) < 6.95
    assert 7.35 < max(winds) <= 7.4
    assert 0.0 < min(gusts) < 0.004
    assert 0.026 < max(gusts) <= 0.03


# --- what is looked at ----------------------------------------------------------------------------

LEAN_DEG = 15.0
ETA = radians(90.0 + LEAN_DEG)
VALUES = {
    "TGL_X": -6.0, "TGL_Z": 14.0, "TGL_LEAN": LEAN_DEG, "LND_X": -28.0, "LND_Y": 1.0, "LND_Z": 0.0,
}  # fmt: skip
FLAT = Ground(2, (-50.0, 50.0, *[50.0] * 6), (0.0,) * 8)


def beside(off_m: float, up_m: float = 0.0) -> Moment:
    """So far upstream of the line, and so far up it."""
    return Moment(
        x_m=-6.0 - sin(ETA) * off_m + cos(ETA) * up_m, z_m=14.0 + cos(ETA) * off_m + sin(ETA) * up_m
    )


def looked_at(
    monkeypatch: pytest.MonkeyPatch, kind: str, script: Callable[[float], Moment]
) -> tuple[SinceFault, ScriptedLoop]:
    loop = ScriptedLoop(script, VALUES, FLAT)
    monkeypatch.setattr(sat, "_world", lambda *_: (loop.world, loop.values, loop.world.frame))
    monkeypatch.setattr(sat, "_loop", lambda *_: loop)
    return sat._fly(SatelliteJob(kind, 1), ()), loop


def test_off_the_line_is_counted_from_the_fifteenth_second_to_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, loop = looked_at(monkeypatch, sat.RESET, lambda t: beside(0.01 * t, up_m=3.0))
    assert found.duration_s == pytest.approx(37.0)
    assert len(found.off_m) == 221  # ten a second, both ends
    assert found.off_m[0] == pytest.approx(0.15)
    assert found.off_m[-1] == pytest.approx(0.37)
    assert found.ended == ""
    assert found.captures == 0
    assert isnan(found.clearance_m)
    assert not found.landing
    assert loop.changes == []  # the line did not move
    assert all(loop.engaged)


def test_a_fix_is_wrong_by_what_it_lies_across_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Along the line it may be wrong by anything."""

    def script(_t: float) -> Moment:
        along, across = 2.0, 0.4
        return beside(0.1)._replace(
            fix_x_m=cos(ETA) * along - sin(ETA) * across,
            fix_z_m=sin(ETA) * along + cos(ETA) * across,
        )

    found, _ = looked_at(monkeypatch, sat.TURNED, script)
    assert found.fix_off_m == pytest.approx([0.4] * len(found.off_m))


def test_a_capture_counts_when_it_begins_and_after_the_fault_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    captured = ((3.0, 5.0), (14.5, 16.0), (20.0, 22.0), (30.0, 31.0))

    def script(t: float) -> Moment:
        capturing = any(begin <= t < end for begin, end in captured)
        return beside(0.0)._replace(mode=CAPTURING if capturing else SOARING)

    assert looked_at(monkeypatch, sat.RESET, script)[0].captures == 2


def test_a_flight_that_hits_the_ground_ends_where_it_was_a_tick_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def script(t: float) -> Moment:
        return Moment(
            x_m=-28.0 + 0.5 * (t - 19.9),
            y_m=1.4,
            z_m=0.2,
            vz_mps=-0.7,
            mode=LANDING,
            crashed="hit the ground at x -28.0, z 0.0 m" if t >= 20.0 else "",
        )

    found, _ = looked_at(monkeypatch, sat.HOME, script)
    assert found.ended == "hit the ground"
    assert found.duration_s == pytest.approx(20.0)
    assert found.touch == pytest.approx((0.0, 0.4, 0.7), abs=1e-6)
    assert found.landing
    assert len(found.off_m) == 50  # the tick of the end is not among them
    hill, _ = looked_at(
        monkeypatch, sat.HOME, lambda t: script(t)._replace(crashed="hit the hill" * (t > 20.0))
    )
    assert hill.ended == "hit the hill"
    assert not hill.landing  # on its way, and not on the ground
    soaring, _ = looked_at(monkeypatch, sat.HOME, lambda t: script(t)._replace(mode=SOARING))
    assert not soaring.landing


@pytest.mark.parametrize("mode", [RELEASED, FAILED])
def test_who_is_disengaged_tells_why_and_how_high(
    mode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def script(t: float) -> Moment:
        now = beside(0.0)._replace(z_m=30.0 - t)
        return now._replace(mode=mode, reason=REASON_POSITION_LOST) if t >= 18.0 else now

    found, _ = looked_at(monkeypatch, sat.HELD, script)
    assert found.ended == f"disengaged: {REASON_TEXTS[REASON_POSITION_LOST]}"
    assert found.clearance_m == pytest.approx(12.1)  # where it was before that tick
    assert found.duration_s == pytest.approx(18.0)


def test_the_operator_moves_the_line_by_what_a_drifting_fix_is_wrong_by_before_it_flies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That is not held against it: off the line and off the fix are counted beside it."""
    found, loop = looked_at(
        monkeypatch, sat.RECEIVER, lambda _t: beside(0.2)._replace(fix_x_m=0.8, fix_z_m=-1.5)
    )
    assert loop.engaged[:10] == [False] * 10
    assert all(loop.engaged[10:])
    ((time_s, moved),) = loop.changes
    assert time_s == pytest.approx(1.0)
    assert moved == pytest.approx({"TGL_X": -6.0 + 0.8, "TGL_Z": 14.0 - 1.5})
    assert found.off_m == pytest.approx([0.2] * len(found.off_m))
    assert found.fix_off_m == pytest.approx([0.0] * len(found.off_m), abs=1e-9)
    assert found.duration_s == pytest.approx(180.0)


def test_a_loop_shows_the_fix_that_the_module_was_given(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain, through what goes wrong: 5 m north of where it is."""
    monkeypatch.setattr(sat, "available", lambda: False)
    job = SatelliteJob(sat.RESET, 2)
    world, values, _ = sat._world(job, Random("air 2"), 1.0)
    fault = parse_fault("position.bias start=0 for=9 north=5 east=0 down=0")
    loop = sat._loop(world, values, Injection((fault,), 2))
    for _ in range(40):
        loop.tick()
    assert loop.given.north_m - world.position.north_m == pytest.approx(5.0, abs=0.1)
    assert loop.given.east_m == pytest.approx(world.position.east_m, abs=0.1)


# --- what is reported of one ----------------------------------------------------------------------

PLAIN = SinceFault(
    ended="",
    duration_s=37.0,
    captures=0,
    off_m=[0.1, -0.2, 0.05],
    fix_off_m=[0.0, 0.1, -0.6],
    clearance_m=nan,
    touch=(1.0, -2.0, 0.5),
    landing=False,
)


def judge(
    monkeypatch: pytest.MonkeyPatch, kind: str, flights: Sequence[SinceFault]
) -> sat.SatelliteFlight:
    """Of a flight, and for a reset of the same without."""
    asked: list[int] = []
    given = iter(flights)

    def fly(_job: SatelliteJob, faults: tuple[Fault, ...]) -> SinceFault:
        asked.append(len(faults))
        return next(given)

    monkeypatch.setattr(sat, "_fly", fly)
    found = sat.fly_satellites(SatelliteJob(kind, 4))
    pair = kind in (sat.RESET, sat.TURNED)
    assert asked == ([1, 0] if pair else [5 if kind in sat.DRIFTS else 1])
    return found


def test_a_reset_is_compared_instant_by_instant_with_the_same_flight_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    without = PLAIN._replace(off_m=[0.08, -0.15, 0.09, 9.0])
    found = judge(monkeypatch, sat.RESET, [PLAIN, without])
    assert found.apart_m == pytest.approx(0.05)
    for pair in (
        [PLAIN._replace(ended="hit the ground"), without],
        [PLAIN, without._replace(ended="hit the ground")],
    ):
        assert judge(monkeypatch, sat.TURNED, pair).apart_m == inf
    assert isnan(judge(monkeypatch, sat.HELD, [PLAIN]).apart_m)


def test_the_largest_is_reported_by_its_size_and_beside_the_fix_of_its_instant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = judge(monkeypatch, sat.RECEIVER, [PLAIN._replace(off_m=[0.1, -0.5, 0.2, 0.25])._replace(
        fix_off_m=[0.0, 0.1, -0.6, 0.25])])  # fmt: skip
    assert found.off_m == 0.5
    assert found.last_off_m == 0.25
    assert found.fix_off_m == 0.6
    assert found.beside_m == pytest.approx(0.4)
    assert found.beside_share == pytest.approx(0.25)
    assert found.within == pytest.approx(0.75)
    assert (found.along_m, found.across_m, found.sink_mps) == PLAIN.touch
    assert (found.duration_s, found.captures, found.landing) == (37.0, 0, False)
    assert (found.kind, found.seed, len(found.faults)) == (sat.RECEIVER, 4, 5)


def test_of_a_flight_that_ends_before_the_fault_nothing_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gone = PLAIN._replace(off_m=[], fix_off_m=[], ended="disengaged: x", clearance_m=2.0)
    found = judge(monkeypatch, sat.HELD, [gone])
    for value in (found.off_m, found.last_off_m, found.fix_off_m, found.beside_m):
        assert isnan(value)
    assert found.beside_share == 0.0
    assert found.within == 0.0
    assert found.clearance_m == 2.0
    assert found.disengaged
    assert found.gone
    assert not found.lost


def test_who_touches_down_well_while_landing_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    home = PLAIN._replace(ended="hit the ground", landing=True)
    assert judge(monkeypatch, sat.HOME, [home]).landed
    assert not judge(monkeypatch, sat.HOME, [home]).gone
    for lost in (
        home._replace(landing=False),
        home._replace(touch=(10.1, 0.0, 0.5)),
        home._replace(touch=(0.0, 5.1, 0.5)),
        home._replace(touch=(0.0, 0.0, 1.6)),
    ):
        found = judge(monkeypatch, sat.HOME, [lost])
        assert found.lost
        assert found.gone
        assert not found.landed

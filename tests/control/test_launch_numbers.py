"""A launch on both sides of each limit: the push, the hand, the speed, the height, the reach."""

from __future__ import annotations

from math import exp, inf, nan, sin
from typing import Any

import pytest
from samples import STILL

from tgl_soar.control import launch as x
from tgl_soar.control.launch import (
    NO_LAUNCH,
    LaunchParams,
    LaunchState,
    LaunchView,
    is_aloft,
    is_in_hand,
    is_in_no_hand,
    launch_step,
    starts_line,
)
from tgl_soar.control.target_line import LineLimits
from tgl_soar.types import NO_IMU

DT, G, NOW = 0.005, 9.80665, 50.0
PARAMS = LaunchParams(
    wanted=True, throw_mps=1.5, wait_s=10.0, pitch_rad=0.05, line=LineLimits(0.6, 1.5, 0.1)
)
LEVEL = STILL._replace(time_s=NOW, z_m=5.0, pitch_rad=0.05)


def view(push: float = 0.0, old_s: float = 0.0, **changes: Any) -> LaunchView:
    """A push beyond gravity is measured."""
    vehicle = LEVEL._replace(**changes.pop("vehicle", {}))
    force = push + G * sin(vehicle.pitch_rad)
    usual = LaunchView(
        vehicle=vehicle,
        imu=NO_IMU._replace(time_s=NOW - old_s, force_x_frd_mps2=force),
        position_ok=True,
        airspeed_mps=9.0,
        measured=True,
        speed_min_mps=6.0,
        clearance_m=2.0,
        clearance_min_m=1.5,
        to_go_m=5.0,
        off_m=0.0,
        off_max_m=1.5,
        line_rests=False,
    )
    return usual._replace(**changes)


def step(state: LaunchState, view_now: LaunchView) -> LaunchState:
    return launch_step(PARAMS, state, True, view_now, DT)


def at(standing: int, **changes: Any) -> LaunchState:
    usual = NO_LAUNCH._replace(
        standing=standing, since_s=NOW - 0.1, mark_s=NOW - 0.1, high_s=NOW - 0.1, low_m=1.0
    )
    return usual._replace(**changes)


def test_it_begins_in_the_hand_and_other_modes_forget_it() -> None:
    begun = step(NO_LAUNCH, view())
    assert begun == NO_LAUNCH._replace(standing=x.HELD, since_s=NOW, mark_s=NOW, imu_s=NOW)
    assert launch_step(PARAMS, at(x.GLIDING), False, view(), DT) == NO_LAUNCH
    for standing in (x.REACHED, x.NO_THROW, x.STEEP, x.SLOW, x.LOW, x.FAR):
        assert step(at(standing), view()) == at(standing)  # it is over


def pushed_mps(view_now: LaunchView, before_s: float = DT, push_mps: float = 0.0) -> float:
    """The push after a sample that comes so long after the one before it."""
    imu = view_now.imu._replace(sequence=7)
    held = at(x.HELD, push_mps=push_mps, imu_sequence=6, imu_s=imu.time_s - before_s)
    return step(held, view_now._replace(imu=imu)).push_mps


def test_a_push_adds_up_and_leaks() -> None:
    leaked = 0.8 * exp(-DT / x.PUSH_S)
    assert pushed_mps(view(push=4.0), push_mps=0.8) == pytest.approx(leaked + 4.0 * DT)
    old = view(push=4.0, old_s=1.01 * x.PUSH_AGE_S)
    assert pushed_mps(old, push_mps=0.8) == pytest.approx(leaked)
    assert pushed_mps(view(push=4.0, old_s=0.99 * x.PUSH_AGE_S)) == pytest.approx(4.0 * DT)


@pytest.mark.parametrize("push", [nan, inf, -inf])
def test_what_is_no_number_pushes_nothing(push: float) -> None:
    assert pushed_mps(view(push=push)) == 0.0


def test_a_sample_stands_for_the_time_since_the_one_before_it() -> None:
    assert pushed_mps(view(push=4.0), 0.02) == pytest.approx(4.0 * 0.02)
    assert pushed_mps(view(push=4.0), 0.3) == pytest.approx(4.0 * 0.055)  # of 18 Hz
    assert pushed_mps(view(push=4.0), -0.02) == 0.0
    again = view(push=4.0)
    held = at(x.HELD, imu_sequence=again.imu.sequence, imu_s=NOW - 0.02)
    assert step(held, again).push_mps == 0.0
    begun = step(NO_LAUNCH, view(push=4.0))
    assert (begun.imu_sequence, begun.imu_s) == (again.imu.sequence, NOW)


@pytest.mark.parametrize("axis", ["velocity_x_mps", "velocity_y_mps", "climb_mps"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_is_thrown_by_the_push_or_by_its_speed(axis: str, sign: float) -> None:
    for speed, thrown in ((1.49, False), (1.51, True)):
        view_now = view(vehicle={axis: sign * speed})
        assert (step(at(x.HELD), view_now).standing == x.THROWN) == thrown
        assert step(at(x.HELD), view_now._replace(position_ok=False)).standing == x.HELD
        pushed = step(at(x.HELD, push_mps=speed / exp(-DT / x.PUSH_S)), view())
        assert (pushed.standing == x.THROWN) == thrown


@pytest.mark.parametrize(("off", "steep"), [(0.59, False), (0.61, True), (-0.61, True)])
def test_thrown_34_degrees_off_the_launch_s_pitch_it_is_given_up(off: float, steep: bool) -> None:
    view_now = view(vehicle={"pitch_rad": 0.05 + off})
    found = step(at(x.HELD, push_mps=2.0), view_now)
    assert found.standing == (x.STEEP if steep else x.THROWN)
    assert (found.since_s, found.mark_s) == (NOW, NOW)


def test_nobody_throws_within_the_time_for_it() -> None:
    assert step(at(x.HELD, since_s=NOW - 9.99), view()).standing == x.HELD
    assert step(at(x.HELD, since_s=NOW - 10.01), view()).standing == x.NO_THROW


@pytest.mark.parametrize(
    ("clearance_m", "speed", "known", "no_hand"),
    [
        (3.9, 0.0, True, False),
        (4.1, 0.0, True, True),
        (inf, 0.0, True, False),  # no ground is known
        (2.0, 2.4, True, False),
        (2.0, 2.6, True, True),
        (9.0, 9.0, False, False),
    ],
)
def test_what_is_in_no_hand(clearance_m: float, speed: float, known: bool, no_hand: bool) -> None:
    vehicle = LEVEL._replace(velocity_x_mps=-speed)
    assert is_in_no_hand(vehicle, known, clearance_m) == no_hand
    if known and speed == 0.0:
        for mark_s, evident in ((0.99, False), (1.01, no_hand)):
            state = at(x.HELD, mark_s=NOW - mark_s)
            found = step(state, view(clearance_m=clearance_m))
            assert (found.standing == x.THROWN) == evident


def test_low_is_half_of_what_the_hand_had_or_the_least_clearance() -> None:
    assert step(at(x.HELD), view(clearance_m=2.0)).low_m == 1.0
    assert step(at(x.HELD), view(clearance_m=4.0)).low_m == 1.5
    assert step(at(x.HELD), view()).high_s == NOW


def test_the_climb_is_averaged_over_a_second() -> None:
    found = step(at(x.THROWN, climb_mps=1.0), view(vehicle={"climb_mps": -2.0}))
    assert found.climb_mps == pytest.approx(1.0 - 3.0 * DT / (1.0 + DT))


@pytest.mark.parametrize("standing", [x.THROWN, x.GLIDING])
@pytest.mark.parametrize(
    ("lasts_s", "clearance_m", "climb", "low"),
    [
        (0.51, 0.9, -0.5, True),
        (0.48, 0.9, -0.5, False),
        (0.51, 1.1, -0.5, False),
        (0.51, 0.9, 0.5, False),
    ],
)
def test_below_that_and_sinking_for_half_a_second_it_is_too_low(
    standing: int, lasts_s: float, clearance_m: float, climb: float, low: bool
) -> None:
    state = at(standing, high_s=NOW - lasts_s, climb_mps=climb)
    view_now = view(clearance_m=clearance_m, vehicle={"climb_mps": climb})
    assert (step(state, view_now).standing == x.LOW) == low


@pytest.mark.parametrize(
    ("airspeed", "measured", "lasts_s", "since_s", "standing"),
    [
        (9.0, True, x.SPEED_S + 0.01, 1.0, x.GLIDING),
        (9.0, True, x.SPEED_S - 0.01, 1.0, x.THROWN),
        (6.0 + x.FLIES_BY_MPS + 0.01, True, x.SPEED_S + 0.01, 1.0, x.GLIDING),
        (6.0 + x.FLIES_BY_MPS - 0.01, True, x.SPEED_S + 0.01, 1.0, x.THROWN),
        (9.0, False, x.SPEED_S + 0.01, x.UNKNOWN_SPEED_S + 0.01, x.GLIDING),
        (9.0, False, x.SPEED_S + 0.01, x.UNKNOWN_SPEED_S - 0.01, x.THROWN),
        (5.0, True, 0.1, 2.99, x.THROWN),
        (5.0, True, 0.1, 3.01, x.SLOW),  # three seconds of a dive of ten degrees win 5 m/s
    ],
)
def test_speed_must_last_and_come_in_time(
    airspeed: float, measured: bool, lasts_s: float, since_s: float, standing: int
) -> None:
    state = at(x.THROWN, mark_s=NOW - lasts_s, since_s=NOW - since_s)
    view_now = view(airspeed_mps=airspeed, measured=measured)
    assert step(state, view_now).standing == standing
    if standing == x.GLIDING:
        assert step(state, view_now._replace(position_ok=False)).standing == x.THROWN


@pytest.mark.parametrize(
    ("changes", "climb", "in_reach"),
    [
        ({}, 0.0, True),
        ({"off_m": 1.49}, 0.0, True),
        ({"off_m": -1.51}, 0.0, False),
        ({"off_m": nan}, 0.0, False),
        ({"clearance_m": 3.9}, -1.0, False),  # in three seconds 0.9 m, and 5 m are to go
        ({"clearance_m": 4.1}, -1.0, True),
        ({"clearance_m": 3.9, "to_go_m": -1.75}, -1.0, True),  # there within three seconds
        ({"clearance_m": 3.9, "to_go_m": -1.85}, -1.0, False),
    ],
)
def test_a_line_is_in_reach_while_height_and_distance_are(
    changes: dict[str, Any], climb: float, in_reach: bool
) -> None:
    for lasts_s in (0.49, 0.51):
        state = at(x.GLIDING, mark_s=NOW - lasts_s, climb_mps=climb)
        found = step(state, view(vehicle={"climb_mps": climb}, **changes))
        assert (found.standing == x.FAR) == (not in_reach and lasts_s > 0.5)
        if in_reach:
            assert found.mark_s == NOW


def test_the_way_to_the_line_has_a_minute() -> None:
    assert step(at(x.GLIDING, since_s=NOW - 59.9), view()).standing == x.GLIDING
    assert step(at(x.GLIDING, since_s=NOW - 60.1), view()).standing == x.FAR
    rests = view(line_rests=True)
    assert step(at(x.GLIDING), rests).standing == x.REACHED
    assert step(at(x.GLIDING), rests._replace(position_ok=False)).standing == x.GLIDING


def test_how_it_stands_is_what_is_logged() -> None:
    names = "IDLE HELD THROWN GLIDING REACHED NO_THROW STEEP SLOW LOW FAR"
    assert [getattr(x, name) for name in names.split()] == list(range(10))
    assert [n for n in range(10) if is_in_hand(at(n))] == [x.HELD]
    assert [n for n in range(10) if is_aloft(at(n))] == [2, 3, 4, 6, 7, 8, 9]
    assert starts_line(at(x.GLIDING, since_s=NOW), NOW)
    assert not starts_line(at(x.GLIDING, since_s=NOW - DT), NOW)
    assert not starts_line(at(x.THROWN, since_s=NOW), NOW)


def test_a_throw_is_measured_for_as_long_as_a_throw_lasts() -> None:
    """An arm pushes for 0.2 to 0.4 s, and the slowest stream that counts comes every 55 ms."""
    assert 0.4 <= x.PUSH_S < 2.0 * 0.4
    assert 3.0 * 0.055 < x.PUSH_AGE_S < 0.4
    assert 0.1 < x.SPEED_S < 0.4  # a gust of a metre at 6 m/s has passed
    assert 0.8 <= x.FLIES_BY_MPS < 1.5  # a throw of 8 m/s must do, at a SPEED_MIN of 6 and more
    assert 0.5 < x.UNKNOWN_SPEED_S < 1.0  # the wind's estimate follows, and GAIN_S is not over

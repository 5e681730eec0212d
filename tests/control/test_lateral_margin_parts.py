"""Roll and heading as they are judged: which gains, ways and delays of the laws a loop has, how
many integrals act, and how near a way between two frequencies comes."""

from __future__ import annotations

from math import atan, hypot

import pytest
from test_margin_equations import AIRFRAME, PITCH, SIDEWAYS, gains

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.lateral_margin import (
    ATTITUDE_AGE_S,
    Sideways,
    _integrals,
    _nearest,
    disk_margins,
    sideways_flown,
)
from tgl_soar.control.lateral_schedule import LateralSchedule
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.loop_margin import is_known
from tgl_soar.geometry import SoaringFrame

HERE = SoaringFrame(0.0, 0.0, 0.0, 0.0)


def laws(**changed: float) -> Laws:
    made = laws_from(ParameterSet().changed(changed), HERE)
    return made._replace(
        roll=gains(1.0, 0.4, 0.1, 60.0),
        heading=made.heading._replace(
            pid=gains(0.8, 0.0, 0.2, 40.0), waypoint_x_m=-6.0, distance_min_m=3.0
        ),
        sideways=gains(0.0, 0.02, 0.04, 9.0),
        target=made.target._replace(x_m=1.5),
        schedule=made.schedule._replace(drag=0.05, best_glide_mps=10.0),
        lateral_schedule=LateralSchedule(speed_mps=10.0, late_found_s=0.05, late_s=0.05),
    )


def flown(of: Laws, late_s: float = 0.08, speed: float = 10.0, inertial: bool = True) -> Sideways:
    return sideways_flown(of, AIRFRAME, late_s, speed, inertial)


# --- what a loop has ----------------------------------------------------------------------------


def test_a_loop_has_the_gains_the_way_and_the_delays_of_the_laws() -> None:
    loop = flown(laws())
    assert loop.airframe is AIRFRAME
    assert (loop.speed_mps, loop.inertial) == (10.0, True)
    assert loop.delay_s == pytest.approx(0.05)  # of 0.08 s the servo's lag is 0.03
    assert loop.way_m == pytest.approx(7.5)
    assert loop.roll == pytest.approx(laws().roll)  # where they were found, as they were found
    assert (loop.heading.kp, loop.heading.kd) == pytest.approx((0.8, 0.2))
    assert (loop.sideways.kd, loop.sideways.ki) == pytest.approx((0.04, 0.02))
    assert loop.leading_mps == pytest.approx(9.80665 * 0.04 * 7.5)  # less than the airspeed


def test_a_lag_that_is_more_than_all_that_is_late_leaves_no_delay() -> None:
    assert flown(laws(), late_s=0.02).delay_s == 0.0


def test_the_way_to_the_waypoint_has_a_least() -> None:
    near = laws()
    near = near._replace(target=near.target._replace(x_m=-4.0))
    assert flown(near).way_m == 3.0
    assert flown(near._replace(target=near.target._replace(x_m=-2.9))).way_m == pytest.approx(3.1)


@pytest.mark.parametrize("speed_mps", [8.0, 10.0, 13.0])
def test_a_glide_falls_by_its_drag(speed_mps: float) -> None:
    square = (speed_mps / 10.0) ** 2
    falls = flown(laws(), speed=speed_mps).falls_rad
    assert falls == pytest.approx(atan(0.05 * (square + 1.0 / square)))
    unknown = laws()
    unknown = unknown._replace(schedule=unknown.schedule._replace(drag=0.0))
    assert flown(unknown, speed=speed_mps).falls_rad == 0.0


def test_gains_fall_with_speed_and_with_attitudes_that_come_by_messages() -> None:
    """k_p goes with f / V; attitudes are 5 ms old there, no more than gains were found with."""
    assert ATTITUDE_AGE_S == 0.005
    loop, faster = flown(laws()), flown(laws(), speed=12.5)
    assert faster.roll.kp == pytest.approx(0.8 * loop.roll.kp)
    assert faster.heading.kd == pytest.approx(0.64 * loop.heading.kd)
    assert flown(laws(), inertial=False).roll == loop.roll
    late = laws()._replace(lateral_schedule=LateralSchedule(10.0, 0.05, 0.10))
    assert flown(late).roll.kp == pytest.approx(0.5 * loop.roll.kp)
    assert flown(late).sideways.kd == pytest.approx(0.5 * 0.04)
    assert flown(late).leading_mps == pytest.approx(0.5 * loop.leading_mps)


# --- its judgement ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one", "other", "distance"),
    [
        (1.0 + 1.0j, 1.0 - 1.0j, 1.0),  # past it, between both
        (3.0 + 4.0j, 3.0 + 8.0j, hypot(3.0, 8.0)),  # away from it
        (3.0 + 8.0j, 3.0 + 4.0j, 5.0),  # towards it
        (-2.0 + 0.0j, 0.0 + 2.0j, 2.0**0.5),
        (0.0 + 2.0j, -2.0 + 0.0j, 2.0**0.5),
        (2.0 + 1.0j, 2.0 + 1.0j, 5.0**0.5),  # it stands
        (-1.0 - 3.0j, 4.0 - 3.0j, 3.0),
    ],
)
def test_from_one_frequency_to_the_next_it_goes_straight(
    one: complex, other: complex, distance: float
) -> None:
    assert _nearest(one, other) == pytest.approx(distance)


NONE = gains(0.0, 0.0, 0.0, 50.0)
P, INT, D, PI = (gains(*each, 50.0) for each in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)))
ID = gains(0.0, 1.0, 1.0, 50.0)


@pytest.mark.parametrize(
    ("roll", "level", "heading", "count"),
    [
        (NONE, NONE, NONE, 0), (NONE, NONE, P, 1), (NONE, NONE, D, 0), (P, NONE, NONE, 0),
        (PI, NONE, NONE, 1), (INT, NONE, NONE, 1), (P, D, NONE, 1), (P, INT, NONE, 2),
        (PI, D, NONE, 2), (PI, ID, NONE, 3), (PI, ID, P, 3), (INT, INT, NONE, 3), (D, ID, NONE, 0),
        (D, ID, P, 1), (PI, NONE, P, 2), (NONE, ID, P, 1), (P, P, NONE, 0),
    ],
)  # fmt: skip
def test_an_integral_counts_where_it_moves_a_surface(
    roll: object, level: object, heading: object, count: int
) -> None:
    """Of the bank's error, of the sideways speed's, and y itself where the bank or the nose leads
    back to the middle."""
    loop = SIDEWAYS._replace(roll=roll, sideways=level, heading=heading)  # type: ignore[arg-type]
    assert _integrals(loop) == count


def test_without_any_gain_a_stable_airframe_has_all_of_its_margin_or_none() -> None:
    """S is 1: 1 / |S - 1/2| is 2; a spiral that grows by itself leaves nothing."""
    alone = SIDEWAYS._replace(roll=NONE, sideways=NONE, heading=NONE)
    damped = AIRFRAME._replace(roll_of_slip_per_s2=-60.0, roll_of_yaw_per_s=0.5)
    assert disk_margins(alone._replace(airframe=damped)) == pytest.approx((2.0, 2.0))
    grows = AIRFRAME._replace(roll_of_slip_per_s2=0.0, roll_of_yaw_per_s=9.0)
    assert disk_margins(alone._replace(airframe=grows)) == (0.0, 0.0)


# --- of pitch -----------------------------------------------------------------------------------


def test_an_airframe_is_known_when_all_that_turns_it_is() -> None:
    known = PITCH.airframe
    assert is_known(known)
    for name in ("speed_mps", "short_period_radps", "damping", "effect_radps2", "path_s"):
        assert not is_known(known._replace(**{name: 0.0}))
    for name in ("glide_ratio", "best_glide_mps"):
        assert is_known(known._replace(**{name: 1.0}))
        assert not is_known(known._replace(**{name: 0.99}))
    assert is_known(known._replace(late_s=0.0, lag_s=0.0))

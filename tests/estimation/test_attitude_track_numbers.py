"""Attitude carried on by rates, on each axis and on both sides of each limit."""

from __future__ import annotations

from math import inf, nan, pi
from typing import Any

import pytest
from samples import attitude_sample, imu_sample

from tgl_soar.estimation.attitude_track import (
    NO_ATTITUDE_TRACK,
    AttitudeTrack,
    is_rate,
    is_rotation,
    is_turn,
    rates_follow,
    turned_by,
    turned_to,
)
from tgl_soar.geometry import SoaringFrame, euler_rates, quaternion_from_euler
from tgl_soar.types import AttitudeSample, ImuSample

FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
RATES = ("roll_rate_frd_radps", "pitch_rate_frd_radps", "yaw_rate_frd_radps")
# Angles in which every axis weighs.
ROLL, PITCH, HEADING = 0.4, 0.25, -0.3


def sample(time_s: float, angles: tuple[float, ...], rates: tuple[float, ...]) -> AttitudeSample:
    return attitude_sample(1, time_s, quaternion_from_euler(*angles), rates)


def gyros(time_s: float, *rates: float) -> ImuSample:
    return imu_sample(1, time_s, (0.0, 0.0, -9.8), rates)


def track(time_s: float, **changes: Any) -> AttitudeTrack:
    usual = NO_ATTITUDE_TRACK._replace(
        time_s=time_s,
        roll_rad=ROLL,
        pitch_rad=PITCH,
        heading_rad=HEADING,
        roll_rate_radps=0.5,
        pitch_rate_radps=-0.7,
        heading_rate_radps=0.9,
    )
    return usual._replace(**changes)


@pytest.mark.parametrize(
    ("length", "is_one"), [(0.91, True), (1.09, True), (0.89, False), (1.11, False)]
)
def test_a_quaternion_is_of_nearly_unit_length(length: float, is_one: bool) -> None:
    w, x, y, z = (length * q for q in quaternion_from_euler(ROLL, PITCH, HEADING))
    assert (
        is_rotation(
            AttitudeSample(
                sequence=1,
                time_s=0.0,
                qw=w,
                qx=x,
                qy=y,
                qz=z,
                roll_rate_frd_radps=0.0,
                pitch_rate_frd_radps=0.0,
                yaw_rate_frd_radps=0.0,
            )
        )
        == is_one
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_gyro_measures_70_radps_at_most_on_each_axis(axis: int, sign: float) -> None:
    rates = [1.0, 2.0, 3.0]
    for size, measured in ((69.0, True), (71.0, False), (nan, False), (inf, False)):
        rates[axis] = sign * size
        assert is_rate(*rates) == measured


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("dt", [0.01, -0.01])
def test_how_far_it_may_turn_in_a_time(axis: int, dt: float) -> None:
    """0.64 rad, and 7 rad/s for as long."""
    for turned, may in ((0.64 + 0.07 - 0.01, True), (0.64 + 0.07 + 0.01, False)):
        for sign in (-1.0, 1.0):
            angles = [0.0, 0.0, 0.0]
            angles[axis] = sign * turned
            before = sample(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            after = sample(dt, tuple(angles), (0.0, 0.0, 0.0))
            assert is_turn(before, after, dt) == may
    assert is_turn(before, sample(0.4, (pi, 0.0, 0.0), (0.0, 0.0, 0.0)), 0.36)


@pytest.mark.parametrize("axis", RATES)
@pytest.mark.parametrize("dt", [0.02, -0.02])
def test_how_fast_its_rates_may_change(axis: str, dt: float) -> None:
    """By 1 rad/s, and 150 rad/s² for as long, either way."""
    before = sample(1.0, (0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
    for change, may in ((3.9, True), (4.1, False), (nan, True)):
        for sign in (-1.0, 1.0):
            after = sample(1.0 + dt, (0.0, 0.0, 0.0), (2.0, 2.0, 2.0))
            changed: dict[str, Any] = {axis: 2.0 + sign * change}
            after = after._replace(**changed)
            assert rates_follow(before, after) == may
    # They differ, and do not add up.
    fast = sample(1.0, (0.0, 0.0, 0.0), (9.0, 9.0, 9.0))
    assert rates_follow(fast, fast._replace(time_s=1.0))


def test_gyros_carry_it_on_with_the_mean_of_both_rates() -> None:
    h = 0.02
    before = track(
        1.0, before_s=0.9, before_roll_rad=0.1, before_pitch_rad=0.2, before_heading_rad=0.3
    )
    found = turned_by(before, gyros(1.0 + h, 1.0, -2.0, 0.4))
    rates = euler_rates(ROLL + 0.5 * h, PITCH - 0.7 * h, 1.0, -2.0, 0.4)
    assert found.time_s == 1.0 + h
    assert found[1:4] == pytest.approx(
        (
            ROLL + 0.5 * h * (0.5 + rates[0]),
            PITCH + 0.5 * h * (-0.7 + rates[1]),
            HEADING + 0.5 * h * (0.9 + rates[2]),
        )
    )
    assert found[4:7] == pytest.approx(rates)
    assert found.by_gyros
    assert found[8:] == before[8:]


@pytest.mark.parametrize(
    ("h", "carried"), [(0.0, True), (0.099, True), (0.101, False), (-0.001, False)]
)
def test_it_is_carried_on_no_further_than_a_tenth(h: float, carried: bool) -> None:
    before = track(1.0)
    assert (turned_by(before, gyros(1.0 + h, 1.0, 0.0, 0.0)) is not before) == carried
    assert turned_by(before, gyros(1.01, 71.0, 0.0, 0.0)) is before


def test_a_sample_with_rates_has_them_as_those_of_its_angles() -> None:
    frame = FRAME._replace(wind_from_rad=0.2)
    turned = sample(1.0, (ROLL, PITCH, HEADING + 0.2), (1.0, -2.0, 0.4))
    found = turned_to(frame, track(0.5), turned)
    assert found[1:4] == pytest.approx((ROLL, PITCH, HEADING))
    assert found[4:7] == pytest.approx(euler_rates(ROLL, PITCH, 1.0, -2.0, 0.4))
    assert not found.by_gyros
    # Nor does its length turn it.
    w, x, y, z = (1.05 * q for q in turned[2:6])
    long = turned._replace(qw=w, qx=x, qy=y, qz=z)
    assert turned_to(frame, track(0.5), long)[1:7] == pytest.approx(found[1:7])


NONE = (nan, nan, nan)


def after(dt: float) -> AttitudeTrack:
    """Without rates, an interval after a sample that differences are taken from."""
    before = track(
        *(1.0,), before_s=1.0, before_roll_rad=ROLL, before_pitch_rad=PITCH, before_heading_rad=3.0
    )
    angles = (ROLL + 0.02, PITCH - 0.03, -3.1)
    return turned_to(FRAME, before, sample(1.0 + dt, angles, NONE))


def test_without_rates_they_are_differences_the_short_way_round() -> None:
    found = after(0.05)
    assert found[4:7] == pytest.approx((0.4, -0.6, (2.0 * pi - 6.1) / 0.05))
    assert found[8:] == pytest.approx((1.05, ROLL + 0.02, PITCH - 0.03, -3.1))


@pytest.mark.parametrize(("dt", "rates"), [(0.0015, (0.5, -0.7, 0.9)), (0.101, (0.0, 0.0, 0.0))])
def test_over_too_short_a_time_the_rates_stay_and_over_too_long_a_one_there_are_none(
    dt: float, rates: tuple[float, ...]
) -> None:
    found = after(dt)
    assert found[4:7] == pytest.approx(rates)
    # What is too near is no sample to take differences from.
    assert found.before_s == (1.0 if dt < 0.002 else 1.0 + dt)
    assert after(0.0021)[4:7] != pytest.approx(rates)
    assert after(0.099)[4:7] != pytest.approx(rates)


@pytest.mark.parametrize("with_rates", [True, False])
def test_gyros_that_are_ahead_carry_a_sample_on_to_where_they_are(with_rates: bool) -> None:
    """By the mean of its rates and theirs, or by theirs alone."""
    by_gyros = track(1.0, by_gyros=True)
    rates = (1.0, -2.0, 0.4) if with_rates else NONE
    angles = (0.1, 0.2, 0.3)
    found = turned_to(FRAME, by_gyros, sample(0.96, angles, rates))
    theirs = (0.5, -0.7, 0.9)
    own = euler_rates(0.1, 0.2, *rates) if with_rates else theirs
    wanted = [angles[i] + 0.04 * 0.5 * (own[i] + theirs[i]) for i in range(3)]
    assert found[:4] == pytest.approx((1.0, *wanted))
    assert found[4:7] == theirs
    assert found.by_gyros


@pytest.mark.parametrize(
    ("time_s", "rates", "by_gyros", "theirs"),
    [
        (1.0, (1.0, 0.0, 0.0), True, True),
        (1.02, (1.0, 0.0, 0.0), False, False),  # newer than they are, with rates of its own
        (1.02, NONE, False, True),  # newer, without
        (0.89, (1.0, 0.0, 0.0), False, False),  # they are too far ahead
        (1.11, NONE, False, False),  # and too far behind
    ],
)
def test_whose_rates_hold(
    time_s: float, rates: tuple[float, ...], by_gyros: bool, theirs: bool
) -> None:
    found = turned_to(FRAME, track(1.0, by_gyros=True), sample(time_s, (0.0, 0.0, 0.0), rates))
    assert found.by_gyros == by_gyros
    assert (found[4:7] == (0.5, -0.7, 0.9)) == theirs
    assert found.time_s == max(time_s, 1.0) if by_gyros else found.time_s == time_s
    alone = turned_to(FRAME, track(1.0), sample(time_s, (0.0, 0.0, 0.0), rates))
    assert not alone.by_gyros

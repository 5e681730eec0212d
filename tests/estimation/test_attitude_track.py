"""From one attitude to the other: what an aircraft may have turned by in a time."""

from __future__ import annotations

from math import cos, isnan, nan, pi, sin

import pytest
from scipy.spatial.transform import Rotation

from tgl_soar.estimation.attitude_track import (
    NO_ATTITUDE_TRACK,
    TURN_RAD,
    TURN_RADPS,
    is_turn,
)
from tgl_soar.types import NO_ATTITUDE, AttitudeSample


def rolled(rad: float, length: float = 1.0) -> AttitudeSample:
    return NO_ATTITUDE._replace(
        qw=length * cos(0.5 * rad), qx=length * sin(0.5 * rad), qy=0.0, qz=0.0
    )


@pytest.mark.parametrize("length", [1.0, -1.0, 0.5, -2.0])
@pytest.mark.parametrize("interval_s", [0.0, 0.01, -0.01, 0.1])
def test_a_turn_is_the_same_with_every_sign_and_length_of_its_quaternions(
    interval_s: float, length: float
) -> None:
    """q and -q are one attitude, and a firmware may send either."""
    most = TURN_RAD + TURN_RADPS * abs(interval_s)
    assert is_turn(rolled(0.2), rolled(0.2 + 0.99 * most, length), interval_s)
    assert is_turn(rolled(0.2), rolled(0.2 - 0.99 * most, length), interval_s)
    assert not is_turn(rolled(0.2), rolled(0.2 + 1.01 * most, length), interval_s)
    assert not is_turn(rolled(0.2), rolled(0.2 - 1.01 * most, length), interval_s)


def test_after_long_enough_any_attitude_may_be() -> None:
    assert is_turn(rolled(0.0), rolled(pi), (pi - TURN_RAD) / TURN_RADPS + 1e-9)
    assert not is_turn(rolled(0.0), rolled(pi), 0.9 * (pi - TURN_RAD) / TURN_RADPS)


def test_what_is_not_known_is_no_turn_that_cannot_be() -> None:
    assert is_turn(rolled(0.0), rolled(0.0)._replace(qw=nan), 0.01)


def sampled(attitude: Rotation, length: float) -> AttitudeSample:
    x, y, z, w = (length * float(part) for part in attitude.as_quat())
    return NO_ATTITUDE._replace(qw=w, qx=x, qy=y, qz=z)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (0.5, 1.0), (1.0, -2.0), (3.0, 0.4)])
def test_a_turn_is_the_same_from_every_attitude(
    axis: tuple[float, float, float], lengths: tuple[float, float]
) -> None:
    """From one in which all four parts of the quaternion weigh, about each axis either way."""
    most = TURN_RAD + TURN_RADPS * 0.02
    before = Rotation.from_euler("ZYX", [2.1, -0.6, 0.9])
    for fraction, may in ((0.99, True), (1.01, False)):
        for sign in (1.0, -1.0):
            turn = Rotation.from_rotvec([sign * fraction * most * part for part in axis])
            one, other = sampled(before, lengths[0]), sampled(before * turn, lengths[1])
            assert is_turn(one, other, 0.02) == may
            assert is_turn(other, one, 0.02) == may


def test_before_the_first_sample_nothing_turns_and_no_angle_is_known() -> None:
    nothing = NO_ATTITUDE_TRACK
    rates = (nothing.roll_rate_radps, nothing.pitch_rate_radps, nothing.heading_rate_radps)
    assert rates == (0.0, 0.0, 0.0)
    assert not nothing.by_gyros
    assert all(isnan(number) for number in (*nothing[:4], *nothing[8:]))

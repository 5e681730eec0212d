"""From one attitude to the other: what an aircraft may have turned by in a time."""

from __future__ import annotations

from math import cos, nan, pi, sin

import pytest

from tgl_soar.estimation.attitude_track import TURN_RAD, TURN_RADPS, is_turn
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

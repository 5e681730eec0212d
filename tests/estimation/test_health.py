"""Ages and their limits."""

from __future__ import annotations

from math import inf, nan, nextafter

import pytest

from tgl_soar.estimation.health import HEARTBEAT_FUTURE_S, HealthLimits, judge
from tgl_soar.estimation.motion import FUTURE_S, initial_motion
from tgl_soar.types import AttitudeSample, AutopilotStatus, Health, Inputs, PositionFix

# Sums of these are exact in binary, so that a limit is met to the last bit.
LIMITS = HealthLimits(0.25, 0.125, 3.0)
NO_FIX = PositionFix(0, nan, nan, nan, nan, nan, nan, nan)
NO_SAMPLE = AttitudeSample(0, nan, nan, nan, nan, nan, nan, nan, nan)


def health(
    now: float, fix: float = nan, attitude: float = nan, heartbeat: float = nan, rejected: int = 0
) -> Health:
    motion = initial_motion()._replace(fix_time_s=fix, attitude_time_s=attitude, rejected=rejected)
    status = AutopilotStatus(heartbeat, True, True)
    return judge(LIMITS, motion, Inputs(now, NO_FIX, NO_SAMPLE, status, True))


def fresh(h: Health) -> tuple[bool, bool, bool]:
    return h.position_ok, h.attitude_ok, h.autopilot_ok


def test_what_never_came_is_infinitely_old() -> None:
    h = health(10.0)
    assert (h.position_age_s, h.attitude_age_s, h.heartbeat_age_s) == (inf, inf, inf)
    assert fresh(h) == (False, False, False)


def test_ages_are_since_each_was_true() -> None:
    h = health(10.0, 9.875, 9.9375, 8.0, 7)
    assert h == Health(0.125, 0.0625, 2.0, True, True, True, 7)


@pytest.mark.parametrize(
    ("limit", "field"),
    [(0.25, "position_ok"), (0.125, "attitude_ok"), (3.0, "autopilot_ok")],
)
def test_a_limit_itself_is_within(limit: float, field: str) -> None:
    then = 10.0 - limit
    assert getattr(health(10.0, then, then, then), field)
    later = nextafter(10.0, inf)
    assert not getattr(health(later, then, then, then), field)


def test_each_age_has_its_own_limit() -> None:
    h = health(10.0, 9.8, 9.8, 9.8)
    assert fresh(h) == (True, False, True)
    h = health(10.0, 9.0, 9.9, 9.0)
    assert fresh(h) == (False, True, True)
    h = health(10.0, 9.9, 9.9, 6.0)
    assert fresh(h) == (True, True, False)


def test_a_clock_mapped_a_little_early_is_no_fault() -> None:
    h = health(10.0, 10.0 + FUTURE_S, 10.0 + FUTURE_S, 10.0 + HEARTBEAT_FUTURE_S)
    assert fresh(h) == (True, True, True)


def test_a_clock_that_went_back_makes_nothing_fresh() -> None:
    # Nobody knows how old a sample is whose time is yet to come.
    h = health(10.0, 15.0, 15.0, 15.0)
    assert (h.position_age_s, h.attitude_age_s, h.heartbeat_age_s) == (inf, inf, inf)
    assert fresh(h) == (False, False, False)


@pytest.mark.parametrize("now", [nan, inf, -inf])
def test_a_tick_without_a_time_finds_nothing_fresh(now: float) -> None:
    h = health(now, 10.0, 10.0, 10.0)
    assert fresh(h) == (False, False, False)

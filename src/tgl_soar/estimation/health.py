"""Health: how old the inputs are, and whether they may be flown with."""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.types import Health, Inputs

from .motion import FUTURE_S, MotionState

INFINITE = float("inf")
HEARTBEAT_FUTURE_S = 1.0  # between two of them


class HealthLimits(NamedTuple):
    """Ages beyond which an input is no longer flown with."""

    position_age_max_s: float  # beyond: the line cannot be flown
    attitude_age_max_s: float
    heartbeat_age_max_s: float


def judge(limits: HealthLimits, motion: MotionState, inputs: Inputs) -> Health:
    """Ages at inputs.time_s, against their limits; what never came is infinitely old.

    So is what lies in the future: the clock has gone back, and nobody knows how old it is.
    A heartbeat is stamped when it arrives, which may be well after the tick's own time.
    """
    position_age = _age(inputs.time_s, motion.fix_time_s, FUTURE_S)
    attitude_age = _age(inputs.time_s, motion.attitude_time_s, FUTURE_S)
    heartbeat_age = _age(inputs.time_s, inputs.autopilot.time_s, HEARTBEAT_FUTURE_S)
    return Health(
        position_age,
        attitude_age,
        heartbeat_age,
        position_age <= limits.position_age_max_s,
        attitude_age <= limits.attitude_age_max_s,
        heartbeat_age <= limits.heartbeat_age_max_s,
        motion.rejected,
    )


def _age(now_s: float, then_s: float, future_s: float) -> float:
    # For samples the comparison is the estimator's own, so that what it takes is never refused
    # here; it is false for NaN: it never came.
    return now_s - then_s if then_s <= now_s + future_s else INFINITE

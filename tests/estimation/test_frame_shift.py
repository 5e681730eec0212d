"""A source of position that moves its own frame in flight: the estimate does not follow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import dist, nan

import pytest
from test_motion_filter import DT, FIX_TICKS, FRAME, GAINS, Vector, fix_at, tick

from tgl_soar.estimation.motion import motion_quality, motion_step, unshifted
from tgl_soar.estimation.motion_state import (
    NO_SHIFT,
    OUTLIERS_ACCEPTED,
    RECKONED_KEPT_S,
    FrameShift,
    MotionState,
    initial_motion,
)
from tgl_soar.estimation.position_fixes import GAP_S, REPEATED
from tgl_soar.types import MotionQuality, PositionFix, VehicleState

FOLLOWING = GAINS._replace(reset_max_m=10.0)
SPEED = (0.3, -0.1, 0.2)
MOVED_S = 2.0
RESET = (5.0, 0.0, -2.0)

Fixes = Callable[[int], PositionFix | None]


def place(time_s: float) -> Vector:
    return 1.0 + SPEED[0] * time_s, 2.0 + SPEED[1] * time_s, 3.0 + SPEED[2] * time_s


def moved(by: Vector, time_s: float) -> Vector:
    x, y, z = place(time_s)
    return x + by[0], y + by[1], z + by[2]


def flight(
    fixes: Fixes, until_s: float = 4.0, reset_max_m: float = 10.0
) -> Iterator[tuple[float, MotionState, VehicleState, MotionQuality]]:
    """Time, state, estimate and its quality of each tick; None: nothing new comes."""
    gains = FOLLOWING._replace(reset_max_m=reset_max_m)
    state, last = initial_motion(), fix_at(0, place(0.0), SPEED)
    for k in range(round(until_s / DT)):
        if k % FIX_TICKS == 0:
            last = fixes(k) or last
        before = state
        state, vehicle = motion_step(gains, FRAME, state, tick(k * DT, last))
        yield k * DT, state, vehicle, motion_quality(gains, before, state, k * DT)


def reset_at(
    moved_s: float, by: Vector = RESET, speed: Vector = SPEED
) -> Callable[[int], PositionFix]:
    def fixes(k: int) -> PositionFix:
        now_s = k * DT
        if now_s < moved_s:
            return fix_at(k, place(now_s), SPEED)
        return fix_at(k, moved(by, now_s), speed)

    return fixes


def off(vehicle: VehicleState, time_s: float) -> float:
    return dist((vehicle.x_m, vehicle.y_m, vehicle.z_m), place(time_s))


def last_of(fixes: Fixes, **options: float) -> tuple[float, MotionState, VehicleState, bool]:
    """And whether it jumped at any time since the frame was moved."""
    jumped = False
    for time_s, state, vehicle, quality in flight(fixes, **options):  # noqa: B007
        jumped |= quality.jumped and time_s >= MOVED_S
    return time_s, state, vehicle, jumped


def test_the_estimate_goes_on_as_if_nothing_had_been() -> None:
    for time_s, state, vehicle, quality in flight(reset_at(MOVED_S)):  # noqa: B007
        if time_s > 0.5:  # the filter has settled
            assert off(vehicle, time_s) < 1e-3
            assert not quality.jumped
    assert tuple(state.shift) == pytest.approx(RESET, abs=1e-3)
    assert (quality.shift_x_m, quality.shift_y_m, quality.shift_z_m) == tuple(state.shift)
    assert time_s - state.fix.time_s < FIX_TICKS * DT  # fixes are used again
    assert quality.position_sigma_m < 0.01  # and nothing is less certain than before


def test_it_is_seen_with_the_fifth_fix_and_not_before() -> None:
    detected_s = [
        time_s for time_s, state, _, _ in flight(reset_at(MOVED_S)) if state.shift != NO_SHIFT
    ]
    assert detected_s[0] == pytest.approx(MOVED_S + (OUTLIERS_ACCEPTED - 1) * FIX_TICKS * DT)


def test_moved_back_nothing_is_left_of_it() -> None:
    def there_and_back(k: int) -> PositionFix:
        return reset_at(MOVED_S)(k) if k * DT < MOVED_S + 1.0 else fix_at(k, place(k * DT), SPEED)

    time_s, state, vehicle, jumped = last_of(there_and_back)
    assert tuple(state.shift) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert off(vehicle, time_s) < 1e-3
    assert not jumped


def test_a_few_wild_fixes_move_no_frame() -> None:
    few = OUTLIERS_ACCEPTED - 1

    def wild(k: int) -> PositionFix:
        since = k - round(MOVED_S / DT)
        return reset_at(MOVED_S if since < few * FIX_TICKS else 99.0)(k)

    _, state, _, jumped = last_of(wild)
    assert state.shift == NO_SHIFT
    assert not jumped


def frozen_before(k: int) -> PositionFix:
    """The source repeats itself, and then says where the aircraft has come to meanwhile."""
    begun = round(MOVED_S / DT) - (REPEATED + 1) * FIX_TICKS
    if begun <= k < round(MOVED_S / DT):
        return fix_at(begun, place(begun * DT), SPEED)._replace(sequence=k + 1, time_s=k * DT)
    return reset_at(MOVED_S)(k)


def silent_before(k: int) -> PositionFix | None:
    return None if MOVED_S - GAP_S - 0.1 <= k * DT < MOVED_S else reset_at(MOVED_S)(k)


def reckoned_before(k: int, over_s: float = 0.5) -> PositionFix:
    """The source says that it dead reckons, until some time before it is corrected."""
    fix = reset_at(MOVED_S)(k)
    return fix._replace(reckoned=0.2 <= k * DT <= MOVED_S - over_s)


def reckoned_until_then(k: int) -> PositionFix:
    return reset_at(MOVED_S)(k)._replace(reckoned=0.2 <= k * DT <= MOVED_S + 0.2)


@pytest.mark.parametrize(
    ("fixes", "reset_max_m"),
    [
        (reset_at(MOVED_S), 5.0),  # of 5.4 m
        (reset_at(MOVED_S), 0.0),
        (reset_at(MOVED_S, speed=(3.0, 0.0, 0.0)), 10.0),
        (frozen_before, 10.0),
        (silent_before, 10.0),
        (reckoned_before, 10.0),
        (reckoned_until_then, 10.0),
    ],
    ids=[
        *("farther than allowed", "not allowed", "with another velocity", "frozen", "silent"),
        *("dead reckoned before", "dead reckoned until it was corrected"),
    ],
)
def test_where_the_aircraft_may_have_moved_itself_the_line_begins_again(
    fixes: Fixes, reset_max_m: float
) -> None:
    _, state, _, jumped = last_of(fixes, reset_max_m=reset_max_m)
    assert state.shift == NO_SHIFT
    assert jumped


def test_long_after_dead_reckoning_a_reset_moves_the_frame_again() -> None:
    def fixes(k: int) -> PositionFix:
        return reset_at(4.0)(k)._replace(reckoned=1.0 <= k * DT < 4.0 - RECKONED_KEPT_S - 0.1)

    states = [(time_s, state, quality) for time_s, state, _, quality in flight(fixes, 5.0)]
    for time_s, _, quality in states:
        since_s = time_s - 1.0
        reckons = 0.0 <= since_s < 3.0 - RECKONED_KEPT_S - 0.1 - DT
        if reckons and since_s > FIX_TICKS * DT:
            assert quality.reckoned_s == pytest.approx(since_s, abs=FIX_TICKS * DT)
    assert quality.reckoned_s == 0.0
    assert tuple(states[-1][1].shift) == pytest.approx(RESET, abs=1e-3)


def test_a_reset_soon_after_a_silence_is_followed_there_and_back() -> None:
    """The jump to the first fix after it does not show that the estimate leads away."""

    def fixes(k: int) -> PositionFix | None:
        now_s = k * DT
        if 2.0 < now_s < 7.0:
            return None
        reset = RESET if 8.0 < now_s < 11.0 else (0.0, 0.0, 0.0)
        return fix_at(k, moved(reset, now_s), SPEED)

    shifted, jumps = set(), 0
    for time_s, state, vehicle, quality in flight(fixes, until_s=12.0):
        if time_s > 8.5:
            shifted.add(round(state.shift.x_m, 1))
            jumps += quality.jumped
            assert off(vehicle, time_s) < 0.1
    assert shifted == {5.0, 0.0}
    assert jumps == 0


def test_stretches_of_dead_reckoning_close_to_each_other_are_one() -> None:
    def flickering(k: int) -> PositionFix:
        return fix_at(k, place(k * DT), SPEED)._replace(
            reckoned=k * DT >= 0.5 and k // 100 % 3 != 0
        )

    longest = max(quality.reckoned_s for _, _, _, quality in flight(flickering, 4.0))
    # Two thirds of the 3.5 s: what is measured between them is not dead reckoned.
    assert longest == pytest.approx(3.5 * 2.0 / 3.0, abs=0.4)


def test_resets_add_up_to_the_most_that_is_allowed() -> None:
    def twice(k: int) -> PositionFix:
        if k * DT < MOVED_S + 1.0:
            return reset_at(MOVED_S, by=(6.0, 0.0, 0.0))(k)
        return fix_at(k, moved((12.0, 0.0, 0.0), k * DT), SPEED)

    time_s, state, vehicle, jumped = last_of(twice)
    assert jumped
    assert state.shift.x_m == pytest.approx(6.0, abs=1e-3)
    assert off(vehicle, time_s) == pytest.approx(6.0, abs=1e-2)  # captured again from there


def test_a_source_without_velocities_is_followed_too() -> None:
    unknown = (nan, nan, nan)

    def fixes(k: int) -> PositionFix:
        by = RESET if k * DT >= MOVED_S else (0.0, 0.0, 0.0)
        return fix_at(k, moved(by, k * DT), unknown)

    time_s, state, vehicle, jumped = last_of(fixes)
    assert tuple(state.shift) == pytest.approx(RESET, abs=0.02)
    assert off(vehicle, time_s) < 0.02
    assert not jumped


def test_without_a_flight_the_source_s_own_frame_is_used_again() -> None:
    time_s, state, vehicle, _ = last_of(reset_at(MOVED_S))
    back = unshifted(state, time_s)
    assert back.shift == NO_SHIFT
    assert motion_quality(FOLLOWING, state, back, time_s).jumped
    _, own = motion_step(FOLLOWING, FRAME, back, tick(time_s, fix_at(0, place(0.0))))
    assert own.x_m - vehicle.x_m == pytest.approx(RESET[0], abs=1e-3)
    assert own.z_m - vehicle.z_m == pytest.approx(RESET[2], abs=1e-3)
    assert unshifted(initial_motion(), time_s).shift == FrameShift(0.0, 0.0, 0.0)

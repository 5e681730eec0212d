"""The supervisor's table, walked through in full, and its timers.

A mode's rows name some twenty conditions of the forty-seven; what the others are makes no
difference, and that is tested too.  So every set of those that a mode looks at is tried: up to
thirty-three million a mode, evaluated by numpy from the rows alone and compared with `next_mode`.
"""

from __future__ import annotations

import random
from functools import cache
from itertools import combinations
from math import inf, nan, nextafter
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tgl_soar.control import supervisor as s
from tgl_soar.control import supervisor_texts
from tgl_soar.control.supervisor import (
    TRANSITIONS,
    Decision,
    SupervisorState,
    Transition,
    initial_supervisor,
    is_flying,
    next_mode,
    supervise,
)

MODES = range(len(supervisor_texts.MODE_NAMES))
FLYING = (
    s.CAPTURING, s.SOARING, s.HOLDING, s.RECOVERING, s.SEARCHING, s.LAUNCHING, s.BREAKING_OFF,
    s.LANDING, s.BEATING,
)  # fmt: skip
GROUND = (s.BOOT, s.STANDBY, s.READY)
# Without these no mode may keep the surfaces for a single look.
VITAL = (
    s.FINITE | s.SANE | s.ATTITUDE_FRESH | s.ATTITUDE_AGREES | s.AUTOPILOT_ALIVE | s.NO_FAILSAFE
    | s.SAME_BOOT | s.STAYS_ARMED | s.SURFACES_OBEY | s.SURFACES_ANSWER | s.ENGAGE | s.UPRIGHT
    | s.UPWIND
)  # fmt: skip
ON_LINE = {
    s.CAPTURING, s.SOARING, s.SEARCHING, s.HOLDING, s.RECOVERING, s.RELEASED, s.STANDBY, s.FAILED,
    s.BREAKING_OFF, s.BEATING,
}  # fmt: skip
ALLOWED = {
    s.BOOT: {s.BOOT, s.STANDBY, s.RELEASED},
    s.STANDBY: {s.STANDBY, s.READY, s.RELEASED},
    s.READY: {s.READY, s.STANDBY, s.CAPTURING, s.LAUNCHING, s.RELEASED},
    s.CAPTURING: ON_LINE,
    s.SOARING: ON_LINE,
    s.SEARCHING: ON_LINE,
    s.HOLDING: {
        s.HOLDING, s.CAPTURING, s.RECOVERING, s.BREAKING_OFF, s.RELEASED, s.STANDBY, s.FAILED
    },
    s.RECOVERING: {
        s.RECOVERING, s.CAPTURING, s.BREAKING_OFF, s.RELEASED, s.STANDBY, s.FAILED
    },
    s.LAUNCHING: {
        s.LAUNCHING, s.CAPTURING, s.BREAKING_OFF, s.RELEASED, s.STANDBY, s.FAILED
    },
    s.BREAKING_OFF: {
        s.BREAKING_OFF, s.CAPTURING, s.LANDING, s.RELEASED, s.STANDBY, s.FAILED
    },
    s.LANDING: {s.LANDING, s.CAPTURING, s.RELEASED, s.STANDBY, s.FAILED},
    s.BEATING: {s.BEATING, s.CAPTURING, s.BREAKING_OFF, s.RELEASED, s.STANDBY, s.FAILED},
    s.RELEASED: {s.RELEASED, s.STANDBY, s.BOOT},
    s.FAILED: {s.FAILED},
}  # fmt: skip
Small = NDArray[np.int8]


class Walk(NamedTuple):
    """Everything that one mode can meet, and what the table makes of it; shape (n,) each.

    Row k holds a set of the conditions that the mode looks at: bit i of numbers[k] is bits[i].
    """

    bits: list[int]
    numbers: NDArray[np.int32]
    to: Small
    action: Small
    reason: Small

    def conditions(self, k: int) -> int:
        """Those of row k."""
        return sum(bit for i, bit in enumerate(self.bits) if int(self.numbers[k]) >> i & 1)

    def has(self, bits: int) -> NDArray[np.bool_]:
        if bits & ~sum(self.bits):
            return np.zeros(len(self.numbers), dtype=bool)
        held: NDArray[np.bool_] = self.numbers & self._own(bits) == self._own(bits)
        return held

    def lacks(self, bits: int) -> NDArray[np.bool_]:
        missing: NDArray[np.bool_] = self.numbers & self._own(bits) == 0
        return missing

    def _own(self, bits: int) -> np.int32:
        return np.int32(sum(1 << i for i, bit in enumerate(self.bits) if bits & bit))


def looked_at(mode: int) -> list[int]:
    """The single bits that any row of a mode names."""
    named = 0
    for row in TRANSITIONS:
        if row.source == mode:
            named |= row.all_of | row.none_of
    return [1 << i for i in range(s.CONDITIONS) if named >> i & 1]


@cache
def walk(mode: int) -> Walk:
    """Every set of the conditions that a mode looks at.

    In control no more than two of the vital ones fail at once: each of them ends the flight by a
    row of its own, above all others.
    """
    bits = looked_at(mode)
    numbers = np.arange(1 << len(bits), dtype=np.int32)
    if mode in FLYING:
        vital = [bit for bit in bits if bit & VITAL]
        bits = [bit for bit in bits if not bit & VITAL] + vital
        others = len(bits) - len(vital)
        each = [1 << k for k in range(len(vital))]
        failing = [sum(some) for n in range(3) for some in combinations(each, n)]
        held = np.array([(1 << len(vital)) - 1 - some for some in failing], dtype=np.int32)
        numbers = (held[:, None] << others | np.arange(1 << others, dtype=np.int32)).ravel()
    to = np.full(len(numbers), mode, dtype=np.int8)
    action, reason = np.zeros_like(to), np.zeros_like(to)
    everything = Walk(bits=bits, numbers=numbers, to=to, action=action, reason=reason)
    for row in reversed([row for row in TRANSITIONS if row.source == mode]):  # the first one wins
        fits = everything.has(row.all_of) & everything.lacks(row.none_of)
        to[fits], action[fits], reason[fits] = row.to, row.action, row.reason
    return everything


def test_conditions_are_separate_bits_with_words() -> None:
    order = list(vars(s))
    names = [n for n in order[order.index("ENGAGE") : order.index("CONDITIONS")] if n != "FOUND"]
    assert [getattr(s, name) for name in names] == [1 << i for i in range(s.CONDITIONS)]
    assert len(set(supervisor_texts.CONDITION_TEXTS)) == s.CONDITIONS
    assert s.FOUND + 1 == s.SAME_BOOT


@pytest.mark.parametrize("mode", MODES)
def test_the_walk_is_the_tables_own_and_complete(mode: int) -> None:
    """numpy's reading of the rows against next_mode, with all other bits at random."""
    everything = walk(mode)
    dice = random.Random(mode)
    mine = sum(looked_at(mode))
    for _ in range(3000):
        k = dice.randrange(len(everything.numbers))
        others = dice.getrandbits(s.CONDITIONS) & ~mine
        expected = Decision(
            int(everything.to[k]), int(everything.action[k]), int(everything.reason[k])
        )
        assert next_mode(mode, everything.conditions(k) | others) == expected


@pytest.mark.parametrize("mode", MODES)
def test_it_never_goes_where_it_may_not(mode: int) -> None:
    everything = walk(mode)
    assert set(np.unique(everything.to).tolist()) == ALLOWED[mode]
    stays = everything.to == mode
    assert np.array_equal(stays, everything.reason == s.REASON_NONE)
    assert np.all(everything.action[stays] == s.NOTHING)


@pytest.mark.parametrize("mode", FLYING)
def test_no_mode_keeps_the_surfaces_without_what_is_vital(mode: int) -> None:
    everything = walk(mode)
    flies = np.isin(everything.to, FLYING)
    assert np.all(everything.has(VITAL)[flies])
    assert np.any(flies)
    # And hands over whenever it ends: surfaces and setpoints both.
    assert np.all(everything.action[~flies] == s.HAND_OVER)


@pytest.mark.parametrize("mode", FLYING)
def test_a_fault_of_its_own_fails_whatever_else(mode: int) -> None:
    everything = walk(mode)
    own = ~everything.has(s.FINITE | s.SANE)
    assert np.array_equal(own, everything.to == s.FAILED)


def test_failed_and_only_failed_has_no_way_out() -> None:
    assert np.all(walk(s.FAILED).to == s.FAILED)
    for mode in MODES:
        if mode != s.FAILED:
            assert np.any(walk(mode).to != mode)


@pytest.mark.parametrize("mode", [s.CAPTURING, s.SOARING, s.SEARCHING])
def test_the_line_is_flown_only_near_it_and_inside_the_fence(mode: int) -> None:
    everything = walk(mode)
    flies = np.isin(everything.to, (s.CAPTURING, s.SOARING, s.SEARCHING))
    assert np.all(everything.has(s.NEAR_LINE | s.INSIDE_FENCE)[flies])
    # A stale position is flown on only until the mode has settled; trouble not at all.
    assert not np.any(flies & everything.lacks(s.POSITION_FRESH) & everything.has(s.SETTLED))
    for safe in (s.AIR_SAFE, s.HIGH_ENOUGH):
        assert not np.any(flies & everything.lacks(safe) & everything.has(s.TROUBLED))
    # Breaking off need not be near a line, nor anywhere else.
    wants = everything.has(s.BREAK_OFF | VITAL)
    assert np.all(everything.to[wants] == s.BREAKING_OFF)


@pytest.mark.parametrize("mode", MODES)
def test_it_takes_the_surfaces_only_from_ready_after_every_entry_check(mode: int) -> None:
    if is_flying(mode):
        return
    everything = walk(mode)
    takes = everything.action == s.TAKE
    assert np.array_equal(takes, np.isin(everything.to, FLYING))
    if mode != s.READY:
        assert not np.any(takes)
        return
    asked = everything.has(s.ENGAGE | s.ENTRY)
    assert np.array_equal(takes, asked)
    launches = everything.has(s.LAUNCH)[takes]
    assert np.array_equal(everything.to[takes] == s.LAUNCHING, launches)
    assert np.array_equal(everything.to[takes] == s.CAPTURING, ~launches)


def bits_of(mask: int) -> list[int]:
    return [1 << i for i in range(s.CONDITIONS) if mask >> i & 1]


@pytest.mark.parametrize("mode", GROUND)
def test_every_entry_check_refuses_in_its_own_words(mode: int) -> None:
    everything = walk(mode)
    refused = everything.to == s.RELEASED
    asked_in_vain = everything.has(s.ENGAGE) & ~everything.has(s.ENTRY)
    assert np.array_equal(refused, asked_in_vain)
    reasons = set()
    for check in bits_of(s.ENTRY):
        decision = next_mode(mode, (s.ENGAGE | s.ENTRY | s.STREAMS_ARRIVED) & ~check)
        assert (decision.mode, decision.action) == (s.RELEASED, s.HAND_OVER)
        reasons.add(decision.reason)
    assert len(reasons) == len(bits_of(s.ENTRY))


def test_ready_is_reported_when_engaging_would_be_granted_and_given_up_with_what_is_missing() -> (
    None
):
    everything = walk(s.STANDBY)
    assert np.array_equal(everything.to == s.READY, everything.has(s.ENTRY))
    everything = walk(s.READY)
    unasked = everything.lacks(s.ENGAGE)
    given_up = everything.to == s.STANDBY
    late = everything.lacks(s.STILL_READY) & ~everything.has(s.ENTRY)
    assert np.array_equal(given_up, unasked & late)
    for check in bits_of(s.ENTRY):
        refused = next_mode(s.READY, (s.ENGAGE | s.ENTRY) & ~check).reason
        assert next_mode(s.READY, s.ENTRY & ~check) == Decision(s.STANDBY, s.NOTHING, refused)


def test_boot_ends_when_every_stream_was_seen() -> None:
    everything = walk(s.BOOT)
    unasked = everything.lacks(s.ENGAGE)
    assert np.array_equal(
        everything.to[unasked] == s.STANDBY, everything.has(s.STREAMS_ARRIVED)[unasked]
    )


def test_released_ends_exactly_when_the_request_is_withdrawn() -> None:
    everything = walk(s.RELEASED)
    assert np.array_equal(everything.to == s.RELEASED, everything.has(s.ENGAGE))
    gone = everything.to != s.RELEASED
    assert np.all(everything.reason[gone] == s.REASON_WITHDRAWN)
    assert np.array_equal(everything.to[gone] == s.STANDBY, everything.has(s.STREAMS_ARRIVED)[gone])


def test_holding_ends() -> None:
    """The position is back, or was lost for too long, or holding has lasted long enough; or the
    aircraft stalls, is low, or is outside the fence by the estimate."""
    everything = walk(s.HOLDING)
    for ends in (
        everything.has(s.POSITION_FRESH),
        everything.lacks(s.POSITION_KEPT),
        everything.has(s.TIME_UP),
        everything.has(s.TROUBLED) & everything.lacks(s.AIR_SAFE),
        everything.has(s.TROUBLED) & everything.lacks(s.HIGH_ENOUGH),
        everything.lacks(s.INSIDE_FENCE),
    ):
        assert not np.any(everything.to[ends] == s.HOLDING)
    back = everything.to == s.CAPTURING
    # A short gap keeps the line; a long one resets it.
    assert np.array_equal(everything.action[back] == s.NEW_LINE, everything.has(s.LONG_GAP)[back])


def test_recovering_ends() -> None:
    """Well again with a position, or its time is up: nothing is recovered from for ever."""
    everything = walk(s.RECOVERING)
    recovered = everything.has(s.POSITION_FRESH | s.CLEARED | s.SETTLED)
    for ends in (everything.has(s.TIME_UP), recovered):
        assert not np.any(everything.to[ends] == s.RECOVERING)
    back = everything.to == s.CAPTURING
    assert np.all(everything.has(s.POSITION_FRESH | s.CLEARED | s.INSIDE_FENCE)[back])
    assert np.all(everything.action[back] == s.NEW_LINE)


@pytest.mark.parametrize("mode", [m for m in FLYING if m not in (s.BREAKING_OFF, s.LANDING)])
def test_no_mode_in_control_looks_away_from_the_fence(mode: int) -> None:
    """On the estimate, whether the position is fresh or lost: only a mode on the line that has
    just settled into holding leaves the fence to the next tick, and breaking off leaves it."""
    everything = walk(mode)
    flies = np.isin(everything.to, FLYING)
    out = flies & everything.lacks(s.INSIDE_FENCE)
    leaves = everything.has(s.BREAK_OFF) & (mode != s.LAUNCHING)
    if mode in (s.HOLDING, s.RECOVERING, s.LAUNCHING):
        assert not np.any(out & ~leaves)
    elif mode == s.BEATING:  # and away from the slope: downstream it is disengaged
        assert np.all(everything.to[out] == s.BREAKING_OFF)
    else:
        assert np.all(everything.to[out & ~leaves] == s.HOLDING)


@pytest.mark.parametrize("mode", [s.BREAKING_OFF, s.LANDING])
def test_the_way_home_is_given_up_for_the_line_inside_the_fence_alone(mode: int) -> None:
    everything = walk(mode)
    back = everything.to == s.CAPTURING
    expected = everything.has(VITAL | s.SOAR_ON | s.POSITION_FRESH | s.INSIDE_FENCE | s.SETTLED)
    expected &= everything.has(s.INSIDE_LEE | s.NOT_BLIND | s.HIGH_ENOUGH)
    assert np.array_equal(back, expected)
    assert np.all(everything.action[back] == s.NEW_LINE)


@pytest.mark.parametrize("mode", [s.BREAKING_OFF, s.LANDING])
def test_the_way_home_ends_over_the_slope_and_blind(mode: int) -> None:
    everything = walk(mode)
    flies = np.isin(everything.to, FLYING)
    for lost in (s.INSIDE_LEE, s.NOT_BLIND):
        assert np.any(everything.lacks(lost))
        assert not np.any(flies & everything.lacks(lost))


def test_a_launch_that_is_given_up_breaks_off_in_the_air_and_disengages_in_the_hand() -> None:
    everything = walk(s.LAUNCHING)
    thrown = everything.has(VITAL | s.INSIDE_FENCE | s.THROW_AWAITED | s.THROWN)
    assert set(np.unique(everything.to[thrown]).tolist()) == {
        s.LAUNCHING, s.CAPTURING, s.BREAKING_OFF
    }  # fmt: skip
    held = everything.has(VITAL) & everything.lacks(s.THROWN)
    for lost in (s.THROW_AWAITED, s.LAUNCH, s.POSITION_KEPT, s.INSIDE_FENCE):
        assert np.all(everything.to[held & everything.lacks(lost)] == s.RELEASED)


def test_an_operator_who_disengages_is_received_in_every_flying_mode() -> None:
    healthy = (1 << s.CONDITIONS) - 1 & ~s.LINE_MOVING & ~s.ENGAGE
    for mode in FLYING:
        assert next_mode(mode, healthy) == Decision(s.STANDBY, s.HAND_OVER, s.REASON_OPERATOR)


def test_a_fault_is_reported_even_where_the_operator_disengages_in_the_same_tick() -> None:
    # Worst first: the log must not say "operator disengaged" of a command that was no number.
    healthy = (1 << s.CONDITIONS) - 1 & ~s.LINE_MOVING & ~s.ENGAGE
    faults = (
        (s.FINITE, s.FAILED, s.REASON_NOT_FINITE),
        (s.SANE, s.FAILED, s.REASON_INSANE),
        (s.ATTITUDE_FRESH, s.RELEASED, s.REASON_ATTITUDE_LOST),
        (s.AUTOPILOT_ALIVE, s.RELEASED, s.REASON_AUTOPILOT_LOST),
        (s.SAME_BOOT, s.RELEASED, s.REASON_REBOOTED),
        (s.NO_FAILSAFE, s.RELEASED, s.REASON_FAILSAFE),
        (s.SURFACES_OBEY, s.RELEASED, s.REASON_MODE_TAKEN),
        (s.STAYS_ARMED, s.RELEASED, s.REASON_DISARMED),
    )
    for mode in FLYING:
        lost = 0
        for condition, to, reason in reversed(faults):  # and the worse the fault, the earlier
            lost |= condition
            assert next_mode(mode, healthy & ~lost) == Decision(to, s.HAND_OVER, reason)
        # What an operator may well disengage for is theirs to say.
        for condition in (s.UPRIGHT, s.POSITION_KEPT, s.NEAR_LINE, s.SURFACES_ANSWER):
            assert next_mode(mode, healthy & ~condition).reason == s.REASON_OPERATOR


def test_under_standing_conditions_it_comes_to_rest() -> None:
    """No cycling: from any mode, under any conditions that do not change, a few steps to rest."""
    dice = random.Random(4)
    for mode in MODES:
        everything = walk(mode)
        for _ in range(2000):
            now = everything.conditions(dice.randrange(len(everything.numbers)))
            now |= dice.getrandbits(s.CONDITIONS) & ~sum(looked_at(mode))
            now |= s.STREAMS_ARRIVED if now & s.ENTRY == s.ENTRY else 0
            path = [mode]
            while (after := next_mode(path[-1], now).mode) != path[-1]:
                path.append(after)
                if len(path) > 3 and path[-1] in path[:-1]:
                    # The only circle is one whose conditions contradict each other in time:
                    # trouble is over and yet there, or both off the line's target and on it.
                    assert now & s.TROUBLED or not now & s.POSITION_KEPT, (mode, path, bin(now))
                    break
            assert len(path) <= 7


# --- the table itself -----------------------------------------------------------------------

FAULT_ROWS = [
    (0, s.FINITE, s.FAILED, s.HAND_OVER, s.REASON_NOT_FINITE),
    (0, s.SANE, s.FAILED, s.HAND_OVER, s.REASON_INSANE),
    (0, s.ATTITUDE_FRESH, s.RELEASED, s.HAND_OVER, s.REASON_ATTITUDE_LOST),
    (0, s.AUTOPILOT_ALIVE, s.RELEASED, s.HAND_OVER, s.REASON_AUTOPILOT_LOST),
    (0, s.SAME_BOOT, s.RELEASED, s.HAND_OVER, s.REASON_REBOOTED),
    (0, s.NO_FAILSAFE, s.RELEASED, s.HAND_OVER, s.REASON_FAILSAFE),
    (0, s.SURFACES_OBEY, s.RELEASED, s.HAND_OVER, s.REASON_MODE_TAKEN),
    (0, s.STAYS_ARMED, s.RELEASED, s.HAND_OVER, s.REASON_DISARMED),
    (0, s.ENGAGE, s.STANDBY, s.HAND_OVER, s.REASON_OPERATOR),
    (0, s.ATTITUDE_AGREES, s.RELEASED, s.HAND_OVER, s.REASON_ATTITUDE_DISAGREES),
    (0, s.SURFACES_ANSWER, s.RELEASED, s.HAND_OVER, s.REASON_SURFACES_DEAD),
    (0, s.UPRIGHT, s.RELEASED, s.HAND_OVER, s.REASON_UPSET),
    (0, s.UPWIND, s.RELEASED, s.HAND_OVER, s.REASON_DOWNWIND),
]
BREAK_ROW = (s.BREAK_OFF, 0, s.BREAKING_OFF, s.NOTHING, s.REASON_BREAK)
RELEASES = (s.RELEASED, s.HAND_OVER)
HOME_ROWS = [
    (0, s.INSIDE_LEE, *RELEASES, s.REASON_FENCE),
    (0, s.NOT_BLIND, *RELEASES, s.REASON_POSITION_LOST),
    (
        s.SOAR_ON | s.POSITION_FRESH | s.INSIDE_FENCE | s.HIGH_ENOUGH | s.SETTLED,
        *(0, s.CAPTURING, s.NEW_LINE, s.REASON_SOAR_ON),
    ),
]
GIVEN_UP = (s.BREAKING_OFF, s.NOTHING)
ON_LINE_ROWS = [
    BREAK_ROW,
    (s.SETTLED, s.POSITION_FRESH, s.HOLDING, s.HOLD, s.REASON_POSITION_GAP),
    (0, s.INSIDE_FENCE, s.RELEASED, s.HAND_OVER, s.REASON_FENCE),
    (s.BEAT | s.SETTLED, 0, s.BEATING, s.NOTHING, s.REASON_BEAT),
    (s.BEAT, s.NEAR_LINE, s.BEATING, s.NOTHING, s.REASON_BEAT),
    (s.BEAT, s.SETTLES, s.BEATING, s.NOTHING, s.REASON_BEAT),
    (0, s.NEAR_LINE, s.RELEASED, s.HAND_OVER, s.REASON_OFF_LINE),
    (0, s.SETTLES, s.RELEASED, s.HAND_OVER, s.REASON_NOWHERE),
    (s.TROUBLED, s.AIR_SAFE, s.RECOVERING, s.GLIDE, s.REASON_STALL),
    (s.TROUBLED, s.HIGH_ENOUGH, s.RECOVERING, s.GLIDE, s.REASON_LOW),
]
BACK = s.REASON_POSITION_BACK
FLYING_ROWS = {
    s.CAPTURING: [
        *ON_LINE_ROWS,
        (s.SEARCH | s.SETTLED, 0, s.SEARCHING, s.NOTHING, s.REASON_SEARCH),
        (s.ON_LINE | s.SETTLED, s.LINE_MOVING, s.SOARING, s.NOTHING, s.REASON_ON_LINE),
    ],
    s.SOARING: [
        *ON_LINE_ROWS,
        (s.SEARCH | s.SETTLED, s.PLACE_FOUND, s.SEARCHING, s.NOTHING, s.REASON_SEARCH),
        (s.LINE_MOVING | s.SETTLED, s.SEARCH, s.CAPTURING, s.NOTHING, s.REASON_LINE_MOVED),
    ],
    s.HOLDING: [
        BREAK_ROW,
        (0, s.INSIDE_FENCE, s.RELEASED, s.HAND_OVER, s.REASON_FENCE),
        (0, s.POSITION_KEPT, s.RECOVERING, s.GLIDE, s.REASON_POSITION_LOST),
        (s.TROUBLED, s.AIR_SAFE, s.RECOVERING, s.GLIDE, s.REASON_STALL),
        (s.TROUBLED, s.HIGH_ENOUGH, s.RECOVERING, s.GLIDE, s.REASON_LOW),
        (s.POSITION_FRESH | s.LONG_GAP, 0, s.CAPTURING, s.NEW_LINE, BACK),
        (s.POSITION_FRESH, 0, s.CAPTURING, s.KEEP_LINE, BACK),
        (s.TIME_UP, 0, s.RECOVERING, s.GLIDE, s.REASON_POSITION_LOST),
    ],
    s.RECOVERING: [
        BREAK_ROW,
        (0, s.INSIDE_FENCE, s.RELEASED, s.HAND_OVER, s.REASON_FENCE),
        (0, s.POSITION_FRESH | s.HIGH_ENOUGH, s.RELEASED, s.HAND_OVER, s.REASON_LOW),
        (
            s.POSITION_FRESH | s.CLEARED | s.SETTLED,
            *(0, s.CAPTURING, s.NEW_LINE, s.REASON_RECOVERED),
        ),
        (s.TIME_UP, s.POSITION_FRESH, s.RELEASED, s.HAND_OVER, s.REASON_POSITION_LOST),
        (s.TIME_UP, s.HIGH_ENOUGH, s.RELEASED, s.HAND_OVER, s.REASON_LOW),
        (s.TIME_UP, s.AIR_SAFE, s.RELEASED, s.HAND_OVER, s.REASON_STALL),
        (s.TIME_UP, 0, s.RELEASED, s.HAND_OVER, s.REASON_NOT_RECOVERED),
    ],
    s.SEARCHING: [
        *(
            (*row[:4], s.REASON_NOT_FOUND) if row[4] == s.REASON_NOWHERE else row
            for row in ON_LINE_ROWS
        ),
        (0, s.SEARCH, s.CAPTURING, s.NOTHING, s.REASON_SEARCH_OVER),
        (
            s.PLACE_FOUND | s.ON_LINE | s.SETTLED,
            *(0, s.SOARING, s.NOTHING, s.REASON_PLACE_FOUND),
        ),
    ],
    s.LAUNCHING: [
        (0, s.INSIDE_FENCE, *RELEASES, s.REASON_FENCE),
        (0, s.THROW_AWAITED, *RELEASES, s.REASON_NO_THROW),
        (0, s.THROWN | s.LAUNCH, *RELEASES, s.REASON_LAUNCH_OFF),
        (0, s.THROWN | s.POSITION_KEPT, *RELEASES, s.REASON_POSITION_LOST),
        (s.THROWN | s.BREAK_OFF, 0, *GIVEN_UP, s.REASON_BREAK),
        (0, s.THROWN_LEVEL, *GIVEN_UP, s.REASON_STEEP),
        (0, s.SPEED_GAINED, *GIVEN_UP, s.REASON_NO_SPEED),
        (0, s.LAUNCH_HIGH, *GIVEN_UP, s.REASON_LAUNCH_LOW),
        (0, s.LINE_IN_REACH, *GIVEN_UP, s.REASON_FAR),
        (0, s.POSITION_KEPT, *GIVEN_UP, s.REASON_POSITION_LOST),
        (s.LINE_REACHED, 0, s.CAPTURING, s.KEEP_LINE, s.REASON_LINE_REACHED),
    ],
    s.BREAKING_OFF: [
        *HOME_ROWS,
        (s.ON_GROUND, 0, *RELEASES, s.REASON_LANDED),
        (s.AWAY | s.SETTLED, 0, s.LANDING, s.NOTHING, s.REASON_AWAY),
    ],
    s.LANDING: [*HOME_ROWS, (s.ON_GROUND, 0, *RELEASES, s.REASON_LANDED)],
    s.BEATING: [
        BREAK_ROW,
        (0, s.INSIDE_LEE, *RELEASES, s.REASON_FENCE),
        (0, s.NOT_BLIND, *RELEASES, s.REASON_POSITION_LOST),
        (0, s.INSIDE_FENCE, *GIVEN_UP, s.REASON_FENCE),
        (s.TROUBLED, s.HIGH_ENOUGH, *GIVEN_UP, s.REASON_LOW),
        (
            s.BEAT_OVER | s.SETTLED | s.POSITION_FRESH,
            *(s.BEAT, s.CAPTURING, s.NEW_LINE, s.REASON_STANDS),
        ),
    ],
}


@pytest.mark.parametrize("mode", FLYING)
def test_the_rows_in_control_are_these_and_no_others(mode: int) -> None:
    """Written out a second time: a row that is dropped, added or moved is meant."""
    rows = [tuple(row[1:]) for row in TRANSITIONS if row.source == mode]
    assert rows == [*FAULT_ROWS, *FLYING_ROWS[mode]]


def taken_with(on: int, off: int, above: list[Transition]) -> int | None:
    """Conditions with which none of some rows is taken, `on` and not `off` among them; None: there
    are none.  Of each row it tries every one of its conditions to be otherwise."""
    if on & off:
        return None
    if not above:
        return on
    row, *others = above
    if row.all_of & off or row.none_of & on:
        return taken_with(on, off, others)
    tries = [(on, off | bit) for bit in bits_of(row.all_of)]
    tries += [(on | bit, off) for bit in bits_of(row.none_of)]
    found = (taken_with(*each, others) for each in tries)
    return next((each for each in found if each is not None), None)


@pytest.mark.parametrize("number", range(len(TRANSITIONS)))
def test_every_row_is_taken_by_some_conditions(number: int) -> None:
    """No row stands in the shadow of those above it."""
    row = TRANSITIONS[number]
    above = [each for each in TRANSITIONS[:number] if each.source == row.source]
    conditions = taken_with(row.all_of, row.none_of, above)
    assert conditions is not None
    assert next_mode(row.source, conditions) == Decision(row.to, row.action, row.reason)
    # And one that another row hides is found out.
    assert taken_with(row.all_of, row.none_of, [*above, row._replace(all_of=0)]) is None


def test_every_reason_mode_and_action_has_its_own_words() -> None:
    reasons = {v: k for k, v in vars(s).items() if k.startswith("REASON_") and isinstance(v, int)}
    assert sorted(reasons) == list(range(len(supervisor_texts.REASON_TEXTS)))
    assert len(set(supervisor_texts.REASON_TEXTS)) == len(supervisor_texts.REASON_TEXTS)
    assert {row.reason for row in TRANSITIONS} == set(reasons) - {s.REASON_NONE}
    assert {row.action for row in TRANSITIONS} == set(range(len(s.ACTION_TEXTS)))
    for mode, name in enumerate(supervisor_texts.MODE_NAMES):
        assert getattr(s, name.upper().replace(" ", "_")) == mode
        assert is_flying(mode) == (mode in FLYING)
    assert {row.source for row in TRANSITIONS} | {row.to for row in TRANSITIONS} == set(MODES)


ASKED = (
    s.SEARCH | s.PLACE_FOUND | s.LAUNCH | s.THROWN | s.LINE_REACHED | s.BREAK_OFF | s.SOAR_ON
    | s.AWAY | s.ON_GROUND | s.BEAT | s.BEAT_OVER
)  # fmt: skip
WELL = s.FOUND & ~(s.LINE_MOVING | s.ON_LINE | ASKED)
HEALTHY = WELL | s.SAME_BOOT | s.STAYS_ARMED | s.SETTLED
SOUGHT = s.SEARCH | s.PLACE_FOUND


@pytest.mark.parametrize(
    ("mode", "lost", "gained", "after", "reason"),
    [
        (s.READY, 0, 0, s.CAPTURING, s.REASON_ENGAGED),
        (s.STANDBY, s.POSITION_FRESH, 0, s.RELEASED, s.REASON_POSITION_LOST),
        (s.CAPTURING, 0, 0, s.CAPTURING, s.REASON_NONE),
        (s.CAPTURING, 0, s.ON_LINE, s.SOARING, s.REASON_ON_LINE),
        (s.CAPTURING, 0, s.ON_LINE | s.LINE_MOVING, s.CAPTURING, s.REASON_NONE),
        (s.CAPTURING, s.NEAR_LINE, 0, s.RELEASED, s.REASON_OFF_LINE),
        (s.CAPTURING, s.AIR_SAFE, 0, s.CAPTURING, s.REASON_NONE),  # not for a moment
        (s.CAPTURING, s.AIR_SAFE, s.TROUBLED, s.RECOVERING, s.REASON_STALL),
        (s.SOARING, 0, 0, s.SOARING, s.REASON_NONE),  # one peak does not end it
        (s.SOARING, 0, s.LINE_MOVING, s.CAPTURING, s.REASON_LINE_MOVED),
        (s.SOARING, s.POSITION_FRESH, 0, s.HOLDING, s.REASON_POSITION_GAP),
        (s.SOARING, s.POSITION_FRESH | s.NEAR_LINE, 0, s.HOLDING, s.REASON_POSITION_GAP),
        (s.SOARING, s.NEAR_LINE, 0, s.RELEASED, s.REASON_OFF_LINE),
        (s.SOARING, s.INSIDE_FENCE, 0, s.RELEASED, s.REASON_FENCE),
        (s.CAPTURING, s.SETTLES, 0, s.RELEASED, s.REASON_NOWHERE),
        (s.SOARING, s.SETTLES, 0, s.RELEASED, s.REASON_NOWHERE),
        (s.SOARING, s.SETTLES | s.INSIDE_FENCE, 0, s.RELEASED, s.REASON_FENCE),
        # Released, and not into a recovering that comes back to the same line.
        (s.SOARING, s.SETTLES | s.AIR_SAFE, s.TROUBLED, s.RELEASED, s.REASON_NOWHERE),
        (s.HOLDING, s.SETTLES | s.POSITION_FRESH, 0, s.HOLDING, s.REASON_NONE),
        (s.RECOVERING, s.SETTLES, 0, s.RECOVERING, s.REASON_NONE),
        (s.SOARING, s.HIGH_ENOUGH, s.TROUBLED, s.RECOVERING, s.REASON_LOW),
        (s.SOARING, s.UPRIGHT, 0, s.RELEASED, s.REASON_UPSET),
        (s.SOARING, s.UPWIND, 0, s.RELEASED, s.REASON_DOWNWIND),
        (s.SOARING, s.SURFACES_OBEY, 0, s.RELEASED, s.REASON_MODE_TAKEN),
        (s.SOARING, s.SURFACES_ANSWER, 0, s.RELEASED, s.REASON_SURFACES_DEAD),
        (s.SOARING, s.AUTOPILOT_ALIVE, 0, s.RELEASED, s.REASON_AUTOPILOT_LOST),
        (s.SOARING, s.SAME_BOOT, 0, s.RELEASED, s.REASON_REBOOTED),
        (s.SOARING, s.ATTITUDE_FRESH, 0, s.RELEASED, s.REASON_ATTITUDE_LOST),
        (s.SOARING, s.FINITE | s.ATTITUDE_FRESH, 0, s.FAILED, s.REASON_NOT_FINITE),
        (s.HOLDING, s.POSITION_FRESH, 0, s.HOLDING, s.REASON_NONE),
        (s.HOLDING, 0, 0, s.CAPTURING, s.REASON_POSITION_BACK),
        (s.HOLDING, s.POSITION_FRESH | s.POSITION_KEPT, 0, s.RECOVERING, s.REASON_POSITION_LOST),
        (s.HOLDING, s.POSITION_FRESH, s.TIME_UP, s.RECOVERING, s.REASON_POSITION_LOST),
        (s.HOLDING, 0, s.TIME_UP, s.CAPTURING, s.REASON_POSITION_BACK),
        (s.HOLDING, s.POSITION_FRESH | s.AIR_SAFE, s.TROUBLED, s.RECOVERING, s.REASON_STALL),
        (s.HOLDING, s.POSITION_FRESH | s.HIGH_ENOUGH, s.TROUBLED, s.RECOVERING, s.REASON_LOW),
        (s.HOLDING, s.AIR_SAFE, s.TROUBLED, s.RECOVERING, s.REASON_STALL),
        (s.HOLDING, s.HIGH_ENOUGH, s.TROUBLED, s.RECOVERING, s.REASON_LOW),
        (s.HOLDING, s.POSITION_FRESH | s.HIGH_ENOUGH, 0, s.HOLDING, s.REASON_NONE),
        (s.HOLDING, s.POSITION_FRESH | s.INSIDE_FENCE, 0, s.RELEASED, s.REASON_FENCE),
        (s.HOLDING, s.POSITION_FRESH | s.UPWIND, 0, s.RELEASED, s.REASON_DOWNWIND),
        (s.RECOVERING, 0, 0, s.RECOVERING, s.REASON_NONE),
        (s.RECOVERING, 0, s.CLEARED, s.CAPTURING, s.REASON_RECOVERED),
        (s.RECOVERING, s.INSIDE_FENCE, 0, s.RELEASED, s.REASON_FENCE),
        (s.RECOVERING, s.POSITION_FRESH | s.INSIDE_FENCE, 0, s.RELEASED, s.REASON_FENCE),
        (s.RECOVERING, s.UPWIND, 0, s.RELEASED, s.REASON_DOWNWIND),
        (s.RECOVERING, s.POSITION_FRESH, s.TIME_UP, s.RELEASED, s.REASON_POSITION_LOST),
        (s.RECOVERING, s.HIGH_ENOUGH, s.TIME_UP, s.RELEASED, s.REASON_LOW),
        (s.RECOVERING, s.HIGH_ENOUGH, 0, s.RECOVERING, s.REASON_NONE),
        (s.RECOVERING, s.POSITION_FRESH, 0, s.RECOVERING, s.REASON_NONE),
        (s.RECOVERING, s.POSITION_FRESH | s.HIGH_ENOUGH, 0, s.RELEASED, s.REASON_LOW),
        (s.RECOVERING, s.AIR_SAFE, s.TIME_UP, s.RELEASED, s.REASON_STALL),
        (s.RECOVERING, 0, s.TIME_UP, s.RELEASED, s.REASON_NOT_RECOVERED),
        (s.CAPTURING, 0, s.SEARCH, s.SEARCHING, s.REASON_SEARCH),
        (s.CAPTURING, 0, s.SEARCH | s.ON_LINE, s.SEARCHING, s.REASON_SEARCH),
        (s.SEARCHING, 0, s.SEARCH, s.SEARCHING, s.REASON_NONE),
        (s.SEARCHING, 0, s.SEARCH | s.LINE_MOVING, s.SEARCHING, s.REASON_NONE),
        (s.SEARCHING, 0, s.SEARCH | s.ON_LINE, s.SEARCHING, s.REASON_NONE),
        (s.SEARCHING, 0, SOUGHT, s.SEARCHING, s.REASON_NONE),  # it says so, and is off the line
        (s.SEARCHING, 0, SOUGHT | s.ON_LINE, s.SOARING, s.REASON_PLACE_FOUND),
        (s.SEARCHING, 0, 0, s.CAPTURING, s.REASON_SEARCH_OVER),  # the operator takes the line
        (s.SEARCHING, s.SETTLES, s.SEARCH, s.RELEASED, s.REASON_NOT_FOUND),
        (s.SEARCHING, s.NEAR_LINE, s.SEARCH, s.RELEASED, s.REASON_OFF_LINE),
        (s.SEARCHING, s.POSITION_FRESH, s.SEARCH, s.HOLDING, s.REASON_POSITION_GAP),
        (s.SEARCHING, s.HIGH_ENOUGH, s.SEARCH | s.TROUBLED, s.RECOVERING, s.REASON_LOW),
        (s.SOARING, 0, SOUGHT, s.SOARING, s.REASON_NONE),
        (s.SOARING, 0, s.SEARCH, s.SEARCHING, s.REASON_SEARCH),  # the claim is withdrawn
        (s.SOARING, 0, s.SEARCH | s.LINE_MOVING, s.SEARCHING, s.REASON_SEARCH),
        (s.READY, 0, s.LAUNCH, s.LAUNCHING, s.REASON_LAUNCH),
        (s.LAUNCHING, 0, s.LAUNCH, s.LAUNCHING, s.REASON_NONE),
        (s.LAUNCHING, 0, 0, s.RELEASED, s.REASON_LAUNCH_OFF),
        (s.LAUNCHING, 0, s.LAUNCH | s.BREAK_OFF, s.LAUNCHING, s.REASON_NONE),  # in the hand
        (s.LAUNCHING, 0, s.THROWN | s.BREAK_OFF, s.BREAKING_OFF, s.REASON_BREAK),
        (s.LAUNCHING, 0, s.THROWN, s.LAUNCHING, s.REASON_NONE),
        (s.LAUNCHING, s.LINE_IN_REACH, s.THROWN, s.BREAKING_OFF, s.REASON_FAR),
        (s.LAUNCHING, 0, s.THROWN | s.LINE_REACHED, s.CAPTURING, s.REASON_LINE_REACHED),
        (s.SOARING, 0, s.BREAK_OFF, s.BREAKING_OFF, s.REASON_BREAK),
        (s.BREAKING_OFF, 0, 0, s.BREAKING_OFF, s.REASON_NONE),  # whatever becomes of its cause
        (s.BREAKING_OFF, 0, s.AWAY, s.LANDING, s.REASON_AWAY),
        (s.BREAKING_OFF, 0, s.AWAY | s.ON_GROUND, s.RELEASED, s.REASON_LANDED),
        (s.BREAKING_OFF, 0, s.SOAR_ON, s.CAPTURING, s.REASON_SOAR_ON),
        (s.LANDING, 0, s.SOAR_ON, s.CAPTURING, s.REASON_SOAR_ON),
        (s.LANDING, s.INSIDE_FENCE, s.SOAR_ON, s.LANDING, s.REASON_NONE),
        (s.LANDING, 0, s.ON_GROUND, s.RELEASED, s.REASON_LANDED),
        (s.LANDING, s.INSIDE_FENCE, 0, s.LANDING, s.REASON_NONE),  # upstream it is left on purpose
        (s.LANDING, s.INSIDE_LEE, s.SOAR_ON, s.RELEASED, s.REASON_FENCE),
        (s.BREAKING_OFF, s.POSITION_FRESH | s.POSITION_KEPT, 0, s.BREAKING_OFF, s.REASON_NONE),
        (s.BREAKING_OFF, s.NOT_BLIND, s.AWAY, s.RELEASED, s.REASON_POSITION_LOST),
        (s.SOARING, 0, s.BEAT, s.BEATING, s.REASON_BEAT),
        (s.SOARING, s.SETTLES, s.BEAT, s.BEATING, s.REASON_BEAT),  # in the place of disengaging
        (s.SOARING, s.INSIDE_FENCE, s.BEAT, s.RELEASED, s.REASON_FENCE),
        (s.SOARING, 0, s.BEAT | s.BREAK_OFF, s.BREAKING_OFF, s.REASON_BREAK),
        (s.BEATING, 0, 0, s.BEATING, s.REASON_NONE),
        (s.BEATING, s.NEAR_LINE | s.SETTLES, 0, s.BEATING, s.REASON_NONE),  # it flies no line
        (s.BEATING, 0, s.BREAK_OFF, s.BREAKING_OFF, s.REASON_BREAK),
        (s.BEATING, 0, s.BEAT_OVER, s.CAPTURING, s.REASON_STANDS),
        (s.BEATING, 0, s.BEAT_OVER | s.BEAT, s.BEATING, s.REASON_NONE),  # still asked for
        (s.BEATING, s.INSIDE_FENCE, s.BEAT_OVER, s.BREAKING_OFF, s.REASON_FENCE),
        (s.BEATING, s.HIGH_ENOUGH, 0, s.BEATING, s.REASON_NONE),
        (s.BEATING, s.HIGH_ENOUGH, s.TROUBLED, s.BREAKING_OFF, s.REASON_LOW),
        (s.BEATING, s.NOT_BLIND, 0, s.RELEASED, s.REASON_POSITION_LOST),
        (s.BEATING, s.INSIDE_FENCE | s.INSIDE_LEE, 0, s.RELEASED, s.REASON_FENCE),
        (s.BEATING, s.UPWIND, 0, s.RELEASED, s.REASON_DOWNWIND),
        (s.RELEASED, 0, 0, s.RELEASED, s.REASON_NONE),
        (s.RELEASED, s.ENGAGE, 0, s.STANDBY, s.REASON_WITHDRAWN),
        (s.FAILED, s.ENGAGE, 0, s.FAILED, s.REASON_NONE),
    ],
)
def test_what_an_operator_sees(mode: int, lost: int, gained: int, after: int, reason: int) -> None:
    decision = next_mode(mode, HEALTHY & ~lost | gained)
    assert (decision.mode, decision.reason) == (after, reason)


# --- timers ----------------------------------------------------------------------------------

DT = 0.005
HOLD_S = 1.5
RECOVER_S = 2.0


class Flown:
    """The supervisor at 200 Hz."""

    def __init__(self) -> None:
        self.state = initial_supervisor()
        self.now = 100.0
        self.changes: list[tuple[float, int, int]] = []

    def look(
        self, found: int, seconds: float = 0.0, *, boots: int = 0, armed: bool = True
    ) -> Flown:
        """One tick, or as many as fit."""
        for _ in range(max(1, round(seconds / DT))):
            self.now += DT
            before = self.state.mode
            self.state, decision = supervise(
                self.state, self.now, found, boots, armed, HOLD_S, RECOVER_S
            )
            assert decision.mode == self.state.mode
            if decision.mode != before:
                self.changes.append((self.now, decision.mode, decision.reason))
        return self

    def modes(self) -> list[int]:
        return [mode for _, mode, _ in self.changes]

    def lasted(self, mode: int) -> float:
        """How long the last stay in a mode took."""
        for k in reversed(range(len(self.changes) - 1)):
            if self.changes[k][1] == mode:
                return self.changes[k + 1][0] - self.changes[k][0]
        raise AssertionError(mode)


def soaring() -> Flown:
    flown = Flown().look(WELL & ~s.ENGAGE, 0.1).look(WELL | s.ON_LINE, 1.0)
    assert flown.modes() == [s.STANDBY, s.READY, s.CAPTURING, s.SOARING]
    flown.changes.clear()
    return flown


def found_with(seconds: float, found: int, **since: Any) -> int:
    """The conditions of a look so long after the times given, all from zero."""
    state = initial_supervisor()._replace(mode=s.FAILED, **since)
    return supervise(state, seconds, found, 0, False, HOLD_S, RECOVER_S)[0].conditions


@pytest.mark.parametrize(
    ("timer", "limit_s", "found", "bit", "at_limit"),
    [
        ("unready_s", s.READY_S, 0, s.STILL_READY, False),
        ("since_s", s.MINIMUM_S, 0, s.SETTLED, True),
        ("since_s", s.LONG_GAP_S, 0, s.LONG_GAP, True),
        ("since_s", RECOVER_S, 0, s.TIME_UP, True),
        ("trouble_s", s.TROUBLE_S, s.HIGH_ENOUGH, s.TROUBLED, True),
        ("trouble_s", s.TROUBLE_S, s.AIR_SAFE, s.TROUBLED, True),
        ("clear_s", s.CLEAR_S, s.AIR_SAFE | s.HIGH_ENOUGH | s.CLEAR, s.CLEARED, True),
    ],
)
def test_every_timer_on_its_boundary(
    timer: str, limit_s: float, found: int, bit: int, at_limit: bool
) -> None:
    def holds(seconds: float) -> bool:
        return bool(found_with(seconds, found, **{timer: 0.0}) & bit)

    assert holds(nextafter(limit_s, 0.0)) == (not at_limit)
    assert holds(limit_s) == at_limit
    assert holds(nextafter(limit_s, inf)) == (bit != s.STILL_READY)


def test_holding_and_recovering_have_a_limit_each() -> None:
    lost = WELL & ~s.POSITION_FRESH
    for mode, limit_s, after in (
        (s.HOLDING, HOLD_S, s.RECOVERING),
        (s.RECOVERING, RECOVER_S, s.RELEASED),
    ):
        state = initial_supervisor()._replace(mode=mode, since_s=0.0, armed=True)

        def at(seconds: float, state: SupervisorState = state) -> int:
            return supervise(state, seconds, lost, 0, True, HOLD_S, RECOVER_S)[1].mode

        assert at(nextafter(limit_s, 0.0)) == mode
        assert at(limit_s) == after


def test_what_must_last_lasts_so_long() -> None:
    """Written out a second time: docs/modes.md names these times to the operator."""
    assert (s.MINIMUM_S, s.READY_S, s.TROUBLE_S) == (0.2, 1.0, 0.1)
    assert (s.CLEAR_S, s.LONG_GAP_S) == (0.3, 0.3)


def test_before_the_first_tick_nothing_is_known() -> None:
    state = initial_supervisor()
    assert (state.mode, state.boots, state.armed) == (s.BOOT, 0, False)
    # Every timer starts with the first look, whatever the loop's clock says then.
    assert (state.since_s, state.unready_s, state.trouble_s, state.clear_s) == (inf,) * 4
    _, first = supervise(state, -1e9, s.STREAMS_ARRIVED, 0, False, HOLD_S, RECOVER_S)
    assert first.mode == s.STANDBY
    assert state.conditions == -1  # no conditions are these


def test_a_mode_that_begins_in_a_tick_without_a_time_begins_with_the_next() -> None:
    state = initial_supervisor()
    state, decision = supervise(state, nan, s.STREAMS_ARRIVED, 0, False, HOLD_S, RECOVER_S)
    assert decision.mode == s.STANDBY
    assert (state.since_s, state.conditions) == (inf, -1)
    for now, settled in ((5.0, False), (5.1, False), (5.0 + s.MINIMUM_S, True)):
        state, _ = supervise(state, now, s.STREAMS_ARRIVED, 0, False, HOLD_S, RECOVER_S)
        assert bool(state.conditions & s.SETTLED) == settled


def test_the_same_again_leaves_the_state_as_it_is() -> None:
    flown = soaring()
    before = flown.state
    flown.look(WELL | s.ON_LINE)
    assert flown.state is before
    flown.look(WELL | s.ON_LINE, armed=True)
    assert flown.state.armed


def test_it_waits_ready_and_engages_in_one_tick() -> None:
    flown = Flown().look(0, 1.0)
    assert flown.state.mode == s.BOOT
    flown.look(WELL & ~s.ENGAGE, 0.5)
    assert flown.modes() == [s.STANDBY, s.READY]
    flown.look(WELL)
    assert flown.state.mode == s.CAPTURING


def test_an_order_to_engage_in_the_very_first_tick_is_obeyed_three_ticks_later() -> None:
    assert Flown().look(WELL).look(WELL).look(WELL).modes() == [s.STANDBY, s.READY, s.CAPTURING]


def test_ready_outlasts_a_moment_without() -> None:
    flown = Flown().look(WELL & ~s.ENGAGE, 0.1)
    lost = WELL & ~s.ENGAGE & ~s.POSITION_FRESH
    flown.look(lost, s.READY_S - 2 * DT).look(WELL & ~s.ENGAGE).look(lost, s.READY_S - 2 * DT)
    assert flown.state.mode == s.READY
    flown.look(lost, 4 * DT)
    assert flown.changes[-1][1:] == (s.STANDBY, s.REASON_POSITION_LOST)


def test_trouble_must_last() -> None:
    flown = soaring()
    bad = WELL & ~s.AIR_SAFE & ~s.CLEAR
    flown.look(bad, s.TROUBLE_S - DT).look(WELL).look(bad, s.TROUBLE_S - DT).look(WELL)
    assert flown.state.mode == s.SOARING
    start = flown.now
    flown.look(bad, 0.2)
    assert flown.modes() == [s.RECOVERING]
    assert flown.changes[0][0] - start == pytest.approx(s.TROUBLE_S + DT, abs=DT)


def test_the_end_of_trouble_must_last_too() -> None:
    flown = soaring().look(WELL & ~s.AIR_SAFE & ~s.CLEAR, 0.2)
    flown.look(WELL, s.CLEAR_S - 2 * DT).look(WELL & ~s.CLEAR).look(WELL, s.CLEAR_S - 2 * DT)
    assert flown.state.mode == s.RECOVERING
    flown.look(WELL, 4 * DT)
    assert flown.changes[-1][1:] == (s.CAPTURING, s.REASON_RECOVERED)


def test_holding_ends_in_its_time_whatever_is_reported_of_the_position() -> None:
    """With fixes that come too seldom, or leave the position uncertain: kept, never fresh."""
    lost = WELL & ~s.POSITION_FRESH & ~s.CLEAR
    flown = soaring().look(lost, 5.0)
    assert [change[1:] for change in flown.changes] == [
        (s.HOLDING, s.REASON_POSITION_GAP),
        (s.RECOVERING, s.REASON_POSITION_LOST),
        (s.RELEASED, s.REASON_POSITION_LOST),
    ]
    assert flown.lasted(s.HOLDING) == pytest.approx(HOLD_S, abs=DT + 1e-9)
    assert flown.lasted(s.RECOVERING) == pytest.approx(RECOVER_S, abs=DT + 1e-9)


def test_recovering_ends_in_its_time_whatever_comes() -> None:
    flown = soaring().look(WELL & ~s.AIR_SAFE & ~s.CLEAR, 5.0)
    assert flown.modes() == [s.RECOVERING, s.RELEASED]
    assert flown.lasted(s.RECOVERING) == pytest.approx(RECOVER_S, abs=DT + 1e-9)


@pytest.mark.parametrize(
    ("gap_s", "action"), [(s.LONG_GAP_S - 0.05, s.KEEP_LINE), (s.LONG_GAP_S + 0.05, s.NEW_LINE)]
)
def test_a_short_gap_keeps_the_line(gap_s: float, action: int) -> None:
    flown = soaring().look(WELL & ~s.POSITION_FRESH, gap_s)
    assert flown.state.mode == s.HOLDING
    flown.now += DT
    _, decision = supervise(flown.state, flown.now, WELL, 0, True, HOLD_S, RECOVER_S)
    assert decision == Decision(s.CAPTURING, action, s.REASON_POSITION_BACK)


def test_a_restart_or_a_disarming_in_flight_disengages_and_stays_so() -> None:
    flown = soaring().look(WELL, boots=1)
    assert flown.changes[-1][1:] == (s.RELEASED, s.REASON_REBOOTED)
    flown.look(WELL, 10.0, boots=1)  # the request still stands
    assert flown.state.mode == s.RELEASED
    flown = soaring().look(WELL, armed=False)
    assert flown.changes[-1][1:] == (s.RELEASED, s.REASON_DISARMED)
    # After a new engagement the new boot counts.
    flown.look(WELL & ~s.ENGAGE, 0.1, boots=1).look(WELL, 0.5, boots=1)
    assert flown.state.mode == s.CAPTURING
    assert flown.state.boots == 1


def test_a_bench_that_never_was_armed_is_flown_until_it_is_disarmed() -> None:
    flown = Flown().look(WELL & ~s.ENGAGE, 0.1, armed=False).look(WELL, 0.5, armed=False)
    assert flown.state.mode == s.CAPTURING
    flown.look(WELL, 0.1, armed=True).look(WELL, armed=False)
    assert flown.changes[-1][1:] == (s.RELEASED, s.REASON_DISARMED)


@pytest.mark.parametrize("back", [0.5, 60.0, nan, inf])
def test_a_clock_that_goes_back_or_is_none_keeps_no_timer_from_running_out(back: float) -> None:
    flown = soaring().look(WELL & ~s.AIR_SAFE & ~s.CLEAR, 0.2)
    assert flown.state.mode == s.RECOVERING
    if back == back and back < inf:
        flown.now -= back
    else:
        flown.state, _ = supervise(flown.state, back, WELL & ~s.CLEAR, 0, True, HOLD_S, RECOVER_S)
    flown.look(WELL & ~s.AIR_SAFE & ~s.CLEAR, RECOVER_S + 2 * DT)
    assert flown.state.mode == s.RELEASED


@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.25, 1.0])
def test_a_clock_that_goes_back_while_nothing_else_changes(after_s: float) -> None:
    """Nothing but the time tells it: no condition begins or ends with the jump."""
    lost = WELL & ~s.POSITION_FRESH & ~s.POSITION_KEPT & ~s.CLEAR
    flown = soaring().look(lost, 2 * DT)
    assert flown.state.mode == s.RECOVERING
    flown.look(lost, after_s)
    flown.now -= 60.0
    flown.look(lost, RECOVER_S + 2 * DT)
    assert flown.changes[-1][1:] == (s.RELEASED, s.REASON_POSITION_LOST)


def test_each_timer_alone_is_set_back_with_the_clock() -> None:
    """With an entry check failing since long ago that no mode in control looks at."""
    unready = WELL & ~s.AIRSPEED_SANE
    lost = unready & ~s.POSITION_FRESH & ~s.POSITION_KEPT & ~s.CLEAR
    flown = soaring().look(unready, 10.0).look(lost, 0.1)
    assert flown.state.mode == s.RECOVERING
    flown.now -= 5.0
    flown.look(lost, RECOVER_S + 2 * DT)
    assert flown.state.mode == s.RELEASED

    flown = soaring().look(unready, 10.0).look(unready & ~s.AIR_SAFE, 0.5 * s.TROUBLE_S)
    assert flown.state.mode == s.SOARING
    flown.now -= 5.0
    flown.look(unready & ~s.AIR_SAFE, s.TROUBLE_S + 2 * DT)
    assert flown.state.mode == s.RECOVERING


def test_trouble_and_its_end_count_again_from_where_the_clock_went_back() -> None:
    bad = WELL & ~s.AIR_SAFE & ~s.CLEAR
    flown = soaring().look(WELL & ~s.POSITION_FRESH & ~s.POSITION_KEPT, 2 * DT)
    flown.look(bad, 0.5 * s.TROUBLE_S)
    flown.now -= 60.0
    flown.look(bad, s.TROUBLE_S + 2 * DT)
    assert flown.state.conditions & s.TROUBLED
    flown.look(WELL, 0.5 * s.CLEAR_S)
    flown.now -= 60.0
    flown.look(WELL, s.CLEAR_S + 2 * DT)
    assert flown.changes[-1][1:] == (s.CAPTURING, s.REASON_RECOVERED)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32), flips=st.integers(1, 24), engaged=st.booleans())
@example(seed=5151417, flips=12, engaged=True)  # a position that comes back in the next tick
def test_noise_cannot_make_it_chatter(seed: int, flips: int, engaged: bool) -> None:
    """Any conditions flicker at random, at any rate, from tick to tick: all but the request.

    What disengages ends it, so that is left out most of the time.  Of every two changes between
    modes that fly one has waited for MINIMUM_S or longer, or the cause has lasted for TROUBLE_S and
    its end for CLEAR_S: no more than 2 / 0.2 s changes in any second.
    """
    dice = random.Random(seed)
    flickers = 0
    for _ in range(flips):
        flickers |= 1 << dice.randrange(24)
    if dice.random() < 0.7:
        flickers &= ~(VITAL | s.NEAR_LINE | s.INSIDE_FENCE)
    flickers &= ~s.ENGAGE
    flown = Flown().look(WELL & ~s.ENGAGE, 0.05)
    steady = WELL if engaged else WELL & ~s.ENGAGE
    more = random.Random(seed + 1)
    searches = more.choice([0, s.SEARCH, SOUGHT])
    fraction = dice.choice([0.01, 0.1, 0.5, 0.9])
    noise = 0
    for _ in range(1200):
        if dice.random() < fraction:
            noise = dice.getrandbits(24) & flickers | more.getrandbits(27) & searches
        flown.look(steady ^ noise)
    times = [when for when, _, _ in flown.changes]
    most = max(sum(1 for t in times if start <= t < start + 1.0) for start in times)
    assert most <= 14, flown.changes  # ten, and the four of engaging


def test_a_state_from_nowhere_stays_where_it_is() -> None:
    """A number that is no mode has no rows: it takes nothing."""
    state = SupervisorState(
        mode=77,
        since_s=0.0,
        unready_s=inf,
        trouble_s=inf,
        clear_s=inf,
        boots=0,
        armed=False,
        conditions=-1,
    )
    state, decision = supervise(state, 1.0, WELL, 0, True, HOLD_S, RECOVER_S)
    assert decision == Decision(77, s.NOTHING, s.REASON_NONE)
    assert not is_flying(77)

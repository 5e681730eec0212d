"""The supervisor's table, walked through in full: 5 modes times 2048 sets of conditions."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tgl_soar.control import supervisor as s
from tgl_soar.control.supervisor import TRANSITIONS, is_flying, next_mode

MODES = range(len(s.MODE_NAMES))
FLYING = (s.CAPTURING, s.SOARING, s.HOLDING)
CONDITIONS = {
    name: value
    for name, value in vars(s).items()
    if name.isupper()
    and isinstance(value, int)
    and not name.startswith("REASON")
    and name not in ("ALL_CONDITIONS", "STANDBY", "CAPTURING", "SOARING", "HOLDING", "RELEASED")
}
# Without these no mode may keep the surfaces for a single look.
VITAL = s.FINITE | s.ATTITUDE_FRESH | s.AUTOPILOT_ALIVE | s.SURFACES_OBEY | s.ENGAGE | s.UPRIGHT
ENTRY = (
    s.ENGAGE | s.AUTOPILOT_ALIVE | s.ATTITUDE_FRESH | s.POSITION_FRESH | s.SURFACES_OBEY | s.UPRIGHT
)
ALLOWED = {
    s.STANDBY: {s.STANDBY, s.CAPTURING, s.RELEASED},
    s.CAPTURING: {s.CAPTURING, s.SOARING, s.HOLDING, s.RELEASED, s.STANDBY},
    s.SOARING: {s.SOARING, s.CAPTURING, s.HOLDING, s.RELEASED, s.STANDBY},
    s.HOLDING: {s.HOLDING, s.CAPTURING, s.RELEASED, s.STANDBY},
    s.RELEASED: {s.RELEASED, s.STANDBY},
}


def everything() -> Iterator[tuple[int, int, int, int]]:
    """(mode, conditions, next mode, reason) of every pair there is."""
    for mode in MODES:
        for conditions in range(s.ALL_CONDITIONS + 1):
            yield mode, conditions, *next_mode(mode, conditions)


def test_conditions_are_eleven_separate_bits() -> None:
    assert len(CONDITIONS) == 11
    assert sum(CONDITIONS.values()) == s.ALL_CONDITIONS
    assert all(value & (value - 1) == 0 for value in CONDITIONS.values())


def test_it_never_goes_where_it_may_not() -> None:
    for mode, conditions, after, reason in everything():
        assert after in ALLOWED[mode], (mode, bin(conditions))
        assert (reason == s.REASON_NONE) == (after == mode)


def test_no_mode_keeps_the_surfaces_without_what_is_vital() -> None:
    for mode, conditions, after, _ in everything():
        if mode in FLYING and conditions & VITAL != VITAL:
            assert not is_flying(after), (mode, bin(conditions))


def test_it_flies_the_line_only_with_a_fresh_position_near_it() -> None:
    for mode, conditions, after, _ in everything():
        if mode in FLYING and after in (s.CAPTURING, s.SOARING):
            assert conditions & s.POSITION_FRESH, (mode, bin(conditions))
            # From holding the line starts anew at the aircraft: it cannot be far.
            assert conditions & s.NEAR_LINE or mode == s.HOLDING, (mode, bin(conditions))


def test_it_takes_the_surfaces_only_after_every_entry_check() -> None:
    # FINITE speaks of the last command: before the first there is none.
    for mode, conditions, after, reason in everything():
        if not is_flying(mode) and is_flying(after):
            assert mode == s.STANDBY
            assert conditions & ENTRY == ENTRY, bin(conditions)
            assert (after, reason) == (s.CAPTURING, s.REASON_ENGAGED)
        if mode == s.STANDBY and conditions & ENTRY == ENTRY:
            assert after == s.CAPTURING


def test_a_refused_engagement_is_released_with_what_is_missing() -> None:
    missing = {
        s.REASON_AUTOPILOT_LOST: s.AUTOPILOT_ALIVE,
        s.REASON_ATTITUDE_LOST: s.ATTITUDE_FRESH,
        s.REASON_POSITION_LOST: s.POSITION_FRESH,
        s.REASON_MODE_TAKEN: s.SURFACES_OBEY,
        s.REASON_UPSET: s.UPRIGHT,
    }
    for mode, conditions, after, reason in everything():
        if mode == s.STANDBY and after == s.RELEASED:
            assert conditions & s.ENGAGE
            assert not conditions & missing[reason]


def test_standby_unasked_stays() -> None:
    for mode, conditions, after, _ in everything():
        if mode == s.STANDBY and not conditions & s.ENGAGE:
            assert after == s.STANDBY


def test_released_ends_exactly_when_the_wish_is_withdrawn() -> None:
    for mode, conditions, after, reason in everything():
        if mode == s.RELEASED:
            if conditions & s.ENGAGE:
                assert (after, reason) == (s.RELEASED, s.REASON_NONE)
            else:
                assert (after, reason) == (s.STANDBY, s.REASON_WITHDRAWN)


def test_holding_ends() -> None:
    """Either the position is back, or it was lost for too long: both end it, whatever else."""
    for mode, conditions, after, _ in everything():
        if mode == s.HOLDING and (
            conditions & s.POSITION_FRESH or not conditions & s.POSITION_KEPT
        ):
            assert after != s.HOLDING, bin(conditions)


def test_an_operator_who_lets_go_is_heard_in_every_flying_mode() -> None:
    for mode in FLYING:
        healthy = s.ALL_CONDITIONS & ~s.LINE_MOVING & ~s.ENGAGE
        assert next_mode(mode, healthy) == (s.STANDBY, s.REASON_OPERATOR)


def settle(mode: int, conditions: int) -> list[int]:
    """The modes gone through while the conditions stay as they are."""
    path = [mode]
    while (after := next_mode(path[-1], conditions)[0]) != path[-1] and len(path) < 9:
        path.append(after)
    return path


def test_a_fault_is_told_even_where_the_operator_lets_go_in_the_same_tick() -> None:
    # Worst first: the log shall not say "operator let go" of a command that was no number.
    healthy = s.ALL_CONDITIONS & ~s.LINE_MOVING & ~s.ENGAGE
    faults = (
        (s.FINITE, s.REASON_NOT_FINITE),
        (s.ATTITUDE_FRESH, s.REASON_ATTITUDE_LOST),
        (s.AUTOPILOT_ALIVE, s.REASON_AUTOPILOT_LOST),
        (s.SURFACES_OBEY, s.REASON_MODE_TAKEN),
    )
    for mode in FLYING:
        lost = 0
        for condition, reason in reversed(faults):  # and the worse the fault, the earlier
            lost |= condition
            assert next_mode(mode, healthy & ~lost) == (s.RELEASED, reason)
        # What an operator may well let go for is theirs to say.
        for condition in (s.UPRIGHT, s.POSITION_KEPT, s.NEAR_LINE):
            assert next_mode(mode, healthy & ~condition) == (s.STANDBY, s.REASON_OPERATOR)


def test_under_standing_conditions_it_comes_to_rest() -> None:
    """No cycling: at most holding or soaring, capturing, released, standby, one after another."""
    for mode in MODES:
        for conditions in range(s.ALL_CONDITIONS + 1):
            path = settle(mode, conditions)
            assert len(path) <= 4, (mode, bin(conditions), path)
            if not conditions & s.ENGAGE:
                assert path[-1] == s.STANDBY


# --- the table itself -----------------------------------------------------------------------


@pytest.mark.parametrize("number", range(len(TRANSITIONS)))
def test_every_row_is_taken_by_some_conditions(number: int) -> None:
    """No row stands in the shadow of those above it."""
    row = TRANSITIONS[number]
    above = [r for r in TRANSITIONS[:number] if r.source == row.source]
    for conditions in range(s.ALL_CONDITIONS + 1):
        fits = conditions & row.all_of == row.all_of and not conditions & row.none_of
        if fits and not any(
            conditions & r.all_of == r.all_of and not conditions & r.none_of for r in above
        ):
            assert next_mode(row.source, conditions) == (row.to, row.reason)
            return
    pytest.fail(f"row {number} can never be taken: {row}")


def test_every_reason_has_its_own_words_and_every_mode_its_name() -> None:
    reasons = {v: k for k, v in vars(s).items() if k.startswith("REASON_") and isinstance(v, int)}
    assert sorted(reasons) == list(range(len(s.REASON_TEXTS)))
    assert all(s.REASON_TEXTS[r] for r in reasons if r != s.REASON_NONE)
    assert len(set(s.REASON_TEXTS)) == len(s.REASON_TEXTS)
    used = {row.reason for row in TRANSITIONS}
    assert used == set(reasons) - {s.REASON_NONE}
    assert [s.MODE_NAMES[m] for m in (s.STANDBY, s.CAPTURING, s.SOARING, s.HOLDING)] == [
        "standby",
        "capturing",
        "soaring",
        "holding",
    ]
    assert s.MODE_NAMES[s.RELEASED] == "released"
    assert {row.source for row in TRANSITIONS} | {row.to for row in TRANSITIONS} == set(MODES)


HEALTHY = s.ALL_CONDITIONS & ~s.LINE_MOVING & ~s.ON_LINE


@pytest.mark.parametrize(
    ("mode", "lost", "gained", "after", "reason"),
    [
        (s.STANDBY, 0, 0, s.CAPTURING, s.REASON_ENGAGED),
        (s.STANDBY, s.POSITION_FRESH, 0, s.RELEASED, s.REASON_POSITION_LOST),
        (s.CAPTURING, 0, 0, s.CAPTURING, s.REASON_NONE),
        (s.CAPTURING, 0, s.ON_LINE, s.SOARING, s.REASON_ON_LINE),
        (s.CAPTURING, 0, s.ON_LINE | s.LINE_MOVING, s.CAPTURING, s.REASON_NONE),
        (s.CAPTURING, s.NEAR_LINE, 0, s.RELEASED, s.REASON_OFF_LINE),
        (s.SOARING, 0, 0, s.SOARING, s.REASON_NONE),  # one peak does not end it
        (s.SOARING, 0, s.LINE_MOVING, s.CAPTURING, s.REASON_LINE_MOVED),
        (s.SOARING, s.POSITION_FRESH, 0, s.HOLDING, s.REASON_POSITION_GAP),
        (s.SOARING, s.POSITION_FRESH | s.NEAR_LINE, 0, s.HOLDING, s.REASON_POSITION_GAP),
        (s.SOARING, s.NEAR_LINE, 0, s.RELEASED, s.REASON_OFF_LINE),
        (s.SOARING, s.UPRIGHT, 0, s.RELEASED, s.REASON_UPSET),
        (s.SOARING, s.SURFACES_OBEY, 0, s.RELEASED, s.REASON_MODE_TAKEN),
        (s.SOARING, s.AUTOPILOT_ALIVE, 0, s.RELEASED, s.REASON_AUTOPILOT_LOST),
        (s.SOARING, s.ATTITUDE_FRESH, 0, s.RELEASED, s.REASON_ATTITUDE_LOST),
        (s.SOARING, s.FINITE | s.ATTITUDE_FRESH, 0, s.RELEASED, s.REASON_NOT_FINITE),
        (s.HOLDING, s.POSITION_FRESH, 0, s.HOLDING, s.REASON_NONE),
        (s.HOLDING, 0, 0, s.CAPTURING, s.REASON_POSITION_BACK),
        (
            s.HOLDING,
            s.POSITION_FRESH | s.POSITION_KEPT,
            0,
            s.RELEASED,
            s.REASON_POSITION_LOST,
        ),
        (s.RELEASED, 0, 0, s.RELEASED, s.REASON_NONE),
        (s.RELEASED, s.ENGAGE, 0, s.STANDBY, s.REASON_WITHDRAWN),
    ],
)
def test_what_an_operator_sees(mode: int, lost: int, gained: int, after: int, reason: int) -> None:
    assert next_mode(mode, HEALTHY & ~lost | gained) == (after, reason)

"""The trial of a brake, half by half: when it begins and where, how long its halves are, what of
them counts, and what it finds."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, inf, isnan, nan

import pytest

from tgl_soar.control.brake_watch import (
    ACTS,
    DOES_NOT,
    NOT_TRIED,
    NOTHING,
    TrialState,
    trial_step,
    tried_brake,
)

DT_S = 0.015625  # 64 steps a second, without rounding
HALF_STEPS = 64
EXPECTED_MPS = 0.5
Speed = Callable[[bool, float], float]  # of whether it is the outer half, and the time into it


def step(
    state: TrialState,
    *,
    saturated: int = 1,
    ended: float = 1.0,
    held: bool = False,
    speed_mps: float = 0.0,
    dt_s: float = DT_S,
) -> TrialState:
    return trial_step(state, saturated, ended, held, speed_mps, EXPECTED_MPS, dt_s)


def begun(ended: float = 1.0) -> TrialState:
    state = step(NOT_TRIED._replace(pressed=1.0), ended=ended)
    assert state.on
    return state


def half(state: TrialState, speed: Speed, *, held: bool = False) -> TrialState:
    """Up to the end of this half."""
    was, n = state.out, 0
    while state.on and state.out == was:
        n += 1
        state = step(state, held=held, speed_mps=speed(was, n * DT_S))
        assert n <= 3 * HALF_STEPS
    return state


def to_and_fro(state: TrialState, q: float) -> TrialState:
    """Out and in again, with a speed that falls by q of what is expected when the brake is out."""

    def speed(out: bool, _time_s: float) -> float:
        return 1.0 - q * EXPECTED_MPS * out

    if isnan(state.inner_mps):
        state = half(state, speed)
    return half(half(state, speed), speed)


# --- its beginning --------------------------------------------------------------------------------


def test_a_brake_is_tried_after_fourteen_seconds_at_an_end() -> None:
    """Of a fraction that comes up by 1 - exp(-t / 10 s): three quarters after 13.9 s."""
    state, time_s = NOT_TRIED, 0.0
    while not state.on:
        state, time_s = step(state, dt_s=0.005), time_s + 0.005
        assert time_s < 20.0
        if not state.on:
            assert state.pressed == pytest.approx(1.0 - exp(-time_s / 10.0), abs=1e-3)
    assert time_s == pytest.approx(13.86, abs=0.02)
    assert (state.pressed, state.rest_s) == (0.0, 0.0)


def test_either_end_presses_and_the_middle_does_not() -> None:
    for end in (-1, 1):
        assert step(NOT_TRIED, saturated=end).pressed == step(NOT_TRIED).pressed > 0.0
    pressed = NOT_TRIED._replace(pressed=0.7)
    assert step(pressed, saturated=0).pressed == pytest.approx(0.7 * 10.0 / (10.0 + DT_S))


@pytest.mark.parametrize(
    ("ended", "low"),
    [(1.0, 0.6), (0.51, 0.6), (0.49, 0.3), (0.0, 0.3), (-0.49, 0.3), (-0.51, 0.0), (-1.0, 0.0)],
)
def test_it_moves_inwards_from_the_end_at_which_the_brake_stands(ended: float, low: float) -> None:
    state = begun(ended)
    assert state.low == pytest.approx(low)
    assert tried_brake(state) == pytest.approx(low)
    assert tried_brake(state._replace(out=True)) == pytest.approx(low + 0.4)


def test_while_it_rests_nothing_is_tried_and_what_was_found_stands() -> None:
    state = NOT_TRIED._replace(pressed=1.0, rest_s=2.5 * DT_S, found=ACTS)
    for left in (1.5, 0.5):
        state = step(state)
        assert (state.on, state.found) == (False, ACTS)
        assert state.rest_s == pytest.approx(left * DT_S)
    state = step(state)
    assert (state.on, state.found) == (True, NOTHING)
    idle = step(NOT_TRIED._replace(rest_s=0.5 * DT_S, found=ACTS))
    assert (idle.on, idle.rest_s, idle.found) == (False, 0.0, NOTHING)


# --- its halves -----------------------------------------------------------------------------------


def test_each_half_is_a_second() -> None:
    state = begun()
    assert not state.out
    sides = []
    for _ in range(4 * HALF_STEPS):
        state = step(state)
        sides.append(state.out)
    turns = [n for n in range(1, len(sides)) if sides[n] != sides[n - 1]]
    assert turns == [63, 127, 191, 255]


def test_of_a_half_what_comes_after_three_tenths_of_a_second_counts() -> None:
    def late(_out: bool, time_s: float) -> float:
        return 2.0 if time_s > 0.3 else 1000.0

    state = half(begun(), late)
    assert (state.inner_mps, state.out) == (2.0, True)
    assert isnan(state.outer_mps)
    state = half(state, lambda _out, time_s: 3.0 * time_s if time_s > 0.3 else -1000.0)
    # The mean of a ramp from 20 steps, 0.3125 s, to 1 s.
    assert state.outer_mps == pytest.approx(3.0 * 0.5 * (0.3125 + 1.0))
    assert (state.inner_mps, state.speed_sum_mps, state.ticks) == (2.0, 0.0, 0.0)


def test_a_half_of_one_long_step_has_that_step() -> None:
    state = step(begun(), speed_mps=4.0, dt_s=1.5)
    assert (state.inner_mps, state.out, state.time_s) == (4.0, True, 0.0)


def test_a_to_and_fro_compares_the_outer_half_with_both_beside_it() -> None:
    state = half(begun(), lambda *_: 1.0)
    state = half(state, lambda *_: 0.75)
    assert (state.trial_tries, state.tries) == (0.0, 0.0)
    state = half(state, lambda *_: 1.5)
    assert (state.trial_tries, state.tries) == (1.0, 1.0)
    q = (0.5 * (1.0 + 1.5) - 0.75) / EXPECTED_MPS
    assert (state.q_sum, state.q_2_sum) == (q, q * q)
    state = half(half(state, lambda *_: 1.0), lambda *_: 1.25)
    other = (0.5 * (1.5 + 1.25) - 1.0) / EXPECTED_MPS
    assert state.q_sum == pytest.approx(q + other)
    assert state.q_2_sum == pytest.approx(q * q + other * other)
    assert (state.trial_tries, state.tries, state.on) == (2.0, 2.0, True)


# --- what it finds --------------------------------------------------------------------------------


def found(qs: list[float], begin: TrialState | None = None) -> tuple[TrialState, int]:
    """With these, one after the other and again; after how many it is over."""
    state, count = begin or begun(), 0
    while state.on:
        state = to_and_fro(state, qs[count % len(qs)])
        count += 1
        assert count <= 20
    return state, count


@pytest.mark.parametrize(
    ("q", "what", "rest_s"), [(0.0, DOES_NOT, 0.0), (0.7, ACTS, 300.0), (1.0, ACTS, 300.0)]
)
def test_in_calm_air_six_times_are_enough(q: float, what: int, rest_s: float) -> None:
    state, count = found([q])
    assert (state.found, count, state.rest_s) == (what, 6, rest_s)
    assert (state.on, state.tries, state.q_sum, state.q_2_sum) == (False, 0.0, 0.0, 0.0)
    assert isnan(state.inner_mps)


def test_how_far_from_the_least_a_mean_must_be() -> None:
    """Three deviations of 0.1 / sqrt(6) each, where all are alike: 0.1225."""
    for q, what in ((0.275, DOES_NOT), (0.525, ACTS)):
        assert found([q])[0].found == what
    for q in (0.280, 0.520):
        assert found([q])[1] > 6


def test_a_trial_that_does_not_tell_ends_after_sixteen_and_counts_half_in_the_next() -> None:
    """Around 0.4 by half of it: never far from the least."""
    state, count = found([0.2, 0.6])
    assert (state.found, count, state.rest_s) == (NOTHING, 16, 20.0)
    assert state.tries == 8.0
    assert state.q_sum == pytest.approx(0.5 * 16 * 0.4)
    assert state.q_2_sum == pytest.approx(0.5 * 8 * (0.04 + 0.36))
    again = step(state._replace(pressed=1.0, rest_s=0.0))
    assert again.on
    over, count = found([0.2, 0.6], again)
    assert (count, over.tries) == (16, 12.0)


def test_a_deviation_is_that_of_what_was_seen() -> None:
    """0.2 to either side of a mean of 0.75: 3 s / sqrt(n) is 0.27 of six and below 0.35."""
    state, count = found([0.55, 0.95])
    assert (state.found, count) == (ACTS, 6)
    # 0.6 to either side: s is 0.657 of six, 0.62 of sixteen, whose three by 4 are 0.46.
    assert found([0.15, 1.35])[0].found == NOTHING


# --- what ends it ---------------------------------------------------------------------------------


def test_an_envelope_that_holds_the_brake_ends_it_after_the_first_part_of_a_half() -> None:
    state = begun()._replace(tries=4.0, q_sum=2.0, q_2_sum=1.5)
    for _ in range(20):  # 0.3125 s
        state = step(state, held=True)
        assert state.on
    state = step(state, held=True)
    assert (state.on, state.rest_s, state.found) == (False, 20.0, NOTHING)
    assert (state.tries, state.q_sum, state.q_2_sum) == (2.0, 1.0, 0.75)


@pytest.mark.parametrize("wrong", [nan, inf])
def test_speeds_that_are_no_numbers_end_it(wrong: float) -> None:
    state = half(half(begun(), lambda *_: 1.0), lambda *_: wrong)
    state = half(state, lambda *_: 1.0)
    assert (state.on, state.rest_s, state.tries) == (False, 20.0, 0.0)

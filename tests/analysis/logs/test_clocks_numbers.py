"""What is put right of a log's clock, and from what on: stamps that are nonsense, steps, leaps."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from tgl_soar.analysis.logs.clocks import Straightened
from tgl_soar.analysis.logs.ulog_reader import LEAP_S

BEGIN_S = 50.0


def one(times: list[float]) -> Straightened:
    return Straightened({"a": np.array(times)})


def even(n: int = 12, step_s: float = 0.1) -> list[float]:
    return [BEGIN_S + step_s * i for i in range(n)]


def test_even_stamps_are_measured_from_the_first_of_all_streams() -> None:
    straight = Straightened({"a": np.array([3.0, 4.0, 5.0]), "b": np.array([2.5, 4.5])})
    assert straight.start_s == 2.5
    assert straight.time_s["a"].tolist() == [0.5, 1.5, 2.5]
    assert straight.time_s["b"].tolist() == [0.0, 2.0]
    assert straight.lost == []


def test_nothing_has_no_time() -> None:
    assert Straightened({}).start_s == 0.0
    empty = one([])
    assert (empty.start_s, len(empty.time_s["a"]), empty.lost) == (0.0, 0, [])


@pytest.mark.parametrize("bad", [nan, inf, -1.0])
def test_a_stamp_that_is_no_time_is_left_out(bad: float) -> None:
    times = even()
    times[3] = bad
    straight = one(times)
    assert straight.rows["a"].tolist() == [0, 1, 2, *range(4, 12)]
    assert straight.lost == ["a: 1 of 12 samples with an impossible time"]


def test_zero_is_a_time() -> None:
    assert one([0.0, 0.1, 0.2]).lost == []


@pytest.mark.parametrize("away_s", [0.6, -0.6, 1e6, -1.5])
def test_a_stamp_that_stands_alone_between_neighbours_that_agree_is_left_out(
    away_s: float,
) -> None:
    times = even()
    times[5] += away_s + (0.1 if away_s > 0.0 else -0.1)
    straight = one(times)
    assert straight.rows["a"].tolist() == [0, 1, 2, 3, 4, *range(6, 12)]
    assert straight.time_s["a"][-1] == pytest.approx(1.1)
    assert straight.lost == ["a: 1 of 12 samples with an impossible time"]


@pytest.mark.parametrize("late_s", [0.3, -0.3])
def test_a_sample_that_comes_less_than_half_a_second_late_goes_to_its_place(
    late_s: float,
) -> None:
    times = even()
    times[5] += late_s + 0.01
    straight = one(times)
    order = sorted(range(12), key=lambda i: times[i])
    assert straight.rows["a"].tolist() == order
    assert straight.time_s["a"] == pytest.approx(np.sort(times) - BEGIN_S)
    assert straight.lost == []


@pytest.mark.parametrize(("at", "kept"), [(0, [*range(1, 12)]), (11, [*range(11)])])
def test_the_first_and_the_last_stamp_have_one_neighbour_to_agree_with(
    at: int, kept: list[int]
) -> None:
    times = [each + LEAP_S for each in even()]
    times[at] += (1.0 if at else -1.0) * (LEAP_S + 0.2)
    straight = one(times)
    assert straight.rows["a"].tolist() == kept
    assert straight.lost == ["a: 1 of 12 samples with an impossible time"]
    near = [each + LEAP_S for each in even()]
    near[at] += (1.0 if at else -1.0) * (LEAP_S - 0.2)
    assert one(near).lost == []


def test_two_stamps_cannot_say_which_of_them_is_wrong() -> None:
    straight = one([BEGIN_S, BEGIN_S + 2.0 * LEAP_S])
    assert straight.rows["a"].tolist() == [0, 1]


def test_a_sample_near_one_of_its_neighbours_does_not_stand_alone() -> None:
    """After a pause of two seconds the first two came in the wrong order."""
    straight = one([*even(3), BEGIN_S + 2.3, BEGIN_S + 2.2, BEGIN_S + 2.4])
    assert straight.rows["a"].tolist() == [0, 1, 2, 4, 3, 5]
    assert straight.lost == []


def test_stamps_that_are_all_far_apart_accuse_none() -> None:
    far = 2.0 * LEAP_S
    assert one([BEGIN_S + far * i for i in range(3)]).rows["a"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(("back_s", "is_step"), [(0.45, False), (0.7, True), (20.0, True)])
def test_a_clock_set_back_by_more_than_half_a_second_goes_on_at_its_pace(
    back_s: float, is_step: bool
) -> None:
    """A lasting step: the next sample comes `back_s` less a step before the last."""
    times = [each - (back_s if i >= 6 else 0.0) for i, each in enumerate(even())]
    straight = one(times)
    if is_step:
        assert straight.rows["a"].tolist() == [*range(12)]
        assert straight.time_s["a"] == pytest.approx(0.1 * np.arange(12))
        assert straight.lost[0].startswith(f"the clock ran back by {back_s:.3g} s")
    else:
        assert straight.time_s["a"] == pytest.approx(np.sort(times) - min(times))
        assert straight.lost == []


def test_a_stream_that_runs_back_on_its_own_is_named() -> None:
    dense = np.arange(0.0, 4.0, 0.01)
    own = np.array(even(10)) - BEGIN_S
    own[5:] -= 3.0
    straight = Straightened({"dense": dense + 10.0, "sparse": own + 14.0})
    assert straight.lost == ["sparse: its time ran back on its own 1 times"]
    assert straight.time_s["sparse"] == pytest.approx(np.arange(10) * 0.1 + 4.0)


@pytest.mark.parametrize(("gap_s", "leaps"), [(LEAP_S - 1.0, False), (LEAP_S + 1.0, True)])
def test_of_a_leap_of_all_streams_one_second_is_left(gap_s: float, leaps: bool) -> None:
    a = np.array([0.0, 1.0, 2.0, 2.0 + gap_s, 3.0 + gap_s, 4.0 + gap_s])
    b = np.array([0.5, 1.5, 2.5 + gap_s, 3.5 + gap_s])
    straight = Straightened({"a": a, "b": b})
    left_s = 1.0 if leaps else gap_s
    assert straight.time_s["a"] == pytest.approx([0.0, 1.0, 2.0, *(2.0 + left_s + np.arange(3.0))])
    assert straight.time_s["b"] == pytest.approx([0.5, 1.5, 2.5 + left_s, 3.5 + left_s])
    if leaps:
        (words,) = straight.lost
        assert words.startswith(f"{gap_s:.4g} s without a sample")
        assert words.endswith("1 s of it is left")
    else:
        assert straight.lost == []


def test_a_gap_of_one_stream_is_no_leap_where_another_goes_on() -> None:
    a = np.array([0.0, 1.0, 2.0, 2.0 + 1.5 * LEAP_S, 3.0 + 1.5 * LEAP_S, 4.0 + 1.5 * LEAP_S])
    b = np.arange(0.0, 4.0 + 1.5 * LEAP_S, 0.5 * LEAP_S)
    straight = Straightened({"a": a, "b": b})
    assert straight.lost == []
    assert straight.time_s["a"].tolist() == a.tolist()


def test_of_every_leap_a_second_is_left() -> None:
    far_s = LEAP_S + 5.0
    straight = one(
        [BEGIN_S, BEGIN_S + 1.0, BEGIN_S + far_s, BEGIN_S + far_s + 1.0]
        + [BEGIN_S + 2.0 * far_s + i for i in range(3)]
    )
    assert straight.time_s["a"] == pytest.approx(np.arange(7.0))
    assert len(straight.lost) == 2


def test_stamps_before_time_began_are_left_out_though_they_agree() -> None:
    straight = one([-2.0, -1.9, -1.8, 0.0, 0.1, 0.2])
    assert straight.rows["a"].tolist() == [3, 4, 5]
    assert straight.start_s == 0.0

"""Where a manoeuvre begins and ends, on made-up sticks and brakes: rest, several doublets, the
ends of a log."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.manoeuvres import LongitudinalLog, brakings, manoeuvres

N = 1000  # ten seconds
STEP_S = 0.01


def log(elevator: Any, **columns: Any) -> LongitudinalLog:
    n = len(elevator)
    given: dict[str, Any] = {
        "time_s": STEP_S * np.arange(float(n)),
        "elevator": elevator,
        "pitch_rad": np.full(n, -0.05),
        "pitch_rate_radps": np.zeros(n),
        "roll_rad": np.zeros(n),
        "airspeed_mps": np.full(n, 9.0),
        "path_angle_rad": np.full(n, -0.1),
    }
    return LongitudinalLog(**{**given, **columns})


def doublet(*begins: int, n: int = N, half: int = 20) -> Any:
    stick = np.zeros(n)
    for begin in begins:
        stick[begin : begin + half] = 0.1
        stick[begin + half : begin + 2 * half] = -0.1
    return stick


@pytest.mark.parametrize(("first", "begin"), [(0.021, 400), (-0.021, 400), (0.019, 405)])
def test_a_doublet_begins_where_the_stick_leaves_its_rest_by_a_quarter_of_the_least_step(
    first: float, begin: int
) -> None:
    """A twentieth of a second before it is moved, it has gone there already, or nearly."""
    stick = doublet(405)
    stick[400:405] = first
    (rows,) = manoeuvres(log(stick))
    assert rows == slice(begin - 10, 445 + 120)


@pytest.mark.parametrize(("last", "end"), [(0.021, 450), (0.019, 440)])
def test_a_doublet_ends_where_the_stick_is_back_within_as_much(last: float, end: int) -> None:
    stick = doublet(400)
    stick[440:450] = last
    (rows,) = manoeuvres(log(stick))
    assert rows == slice(390, end + 120)


@pytest.mark.parametrize(("first", "rows"), [(0.064, slice(690, 860)), (0.061, slice(730, N))])
def test_a_braking_begins_where_the_brake_leaves_its_rest_by_a_quarter_of_the_least_span(
    first: float, rows: slice
) -> None:
    """By less, it is out of rest and nothing begins, until it leaves its next rest: fully out."""
    brake = np.zeros(N)
    brake[700:705], brake[705:740] = first, 1.0
    moved = log(doublet(300), brake=brake)
    assert brakings(moved, manoeuvres(moved)) == [rows]


@pytest.mark.parametrize(("begin", "found"), [(879, 1), (880, 0)])
def test_a_doublet_begins_before_the_last_second_and_a_fifth_of_a_log(
    begin: int, found: int
) -> None:
    assert [rows.stop for rows in manoeuvres(log(doublet(begin)))] == [N] * found


@pytest.mark.parametrize(("n", "found"), [(150, 0), (151, 1)])
def test_the_shortest_log_holds_rest_one_step_and_what_comes_after(n: int, found: int) -> None:
    slices = manoeuvres(log(doublet(30, n=n, half=10)))
    assert slices == [slice(20, n)] * found


def test_a_doublet_in_the_first_tenth_of_a_second_after_rest_has_what_is_before_it() -> None:
    (rows,) = manoeuvres(log(doublet(30)))
    assert rows.start == 20


def test_without_any_row_of_the_airspeed_above_a_metre_a_second_nothing_flies() -> None:
    still = np.full(N, 9.0)
    still[470] = 1.0  # no more than that
    assert manoeuvres(log(doublet(400), airspeed_mps=still)) == []


# --- of several doublets --------------------------------------------------------------------------


def test_a_braking_within_any_of_several_doublets_is_left_out() -> None:
    """The first takes until sample 260, the second from 590 on until 760."""
    for begin, free in ((100, False), (350, True), (650, False), (780, True)):
        brake = np.zeros(N)
        brake[begin : begin + 20] = 1.0
        moved = log(doublet(100, 600), brake=brake)
        doublets = manoeuvres(moved)
        assert doublets == [slice(90, 260), slice(590, 760)]
        assert len(brakings(moved, doublets)) == free, begin


@pytest.mark.parametrize(("begin", "free"), [(270, True), (269, False), (449, True), (451, False)])
def test_a_braking_may_touch_a_doublet(begin: int, free: bool) -> None:
    """Those take until 260 and from 590 on; a braking from a tenth before to 1.2 s after it."""
    brake = np.zeros(N)
    brake[begin : begin + 20] = 1.0
    moved = log(doublet(100, 600), brake=brake)
    assert len(brakings(moved, manoeuvres(moved))) == free


def test_glides_are_taken_where_the_brake_is_elsewhere_than_in_every_doublet() -> None:
    """Doublets with it in and half out, then glides further out by a quarter, and by less."""
    for out, begins in ((0.74, []), (0.76, [1000])):
        brake = np.concatenate([np.zeros(300), np.full(300, np.nan), np.full(600, 0.5)])
        brake[800:1000] = np.nan
        brake[1000:] = out
        moved = log(doublet(100, 640, n=1201), brake=np.append(brake, out))
        doublets = manoeuvres(moved)
        assert doublets == [slice(90, 260), slice(630, 800)]
        assert [rows.start for rows in brakings(moved, doublets)] == begins


def test_a_glide_that_ends_with_the_log_is_left_out() -> None:
    """It needs one sample more than its own two hundred."""
    for n, begins in ((800, []), (801, [600])):
        brake = np.full(n, np.nan)
        brake[:300], brake[600:] = 0.0, 1.0
        moved = log(doublet(50, n=n), brake=brake)
        found = brakings(moved, manoeuvres(moved))
        assert [(rows.start, rows.stop) for rows in found] == [(b, b + 200) for b in begins]


@pytest.mark.parametrize(("glides", "every"), [(1, 1), (8, 1), (9, 2), (16, 2), (17, 3)])
def test_of_glides_as_many_are_passed_over_as_leave_eight(glides: int, every: int) -> None:
    n = 600 + 200 * glides + 1
    brake = np.full(n, np.nan)
    brake[:300], brake[600:] = 0.0, 1.0
    moved = log(doublet(50, n=n), brake=brake)
    found = brakings(moved, manoeuvres(moved))
    assert [rows.start for rows in found] == [*range(600, n - 200, 200 * every)]
    assert len(found) <= 8

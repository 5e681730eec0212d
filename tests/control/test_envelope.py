"""The last limiter: boundaries, and every place where a number may not be one."""

from __future__ import annotations

from itertools import product
from math import inf, isfinite, nan, nextafter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.envelope import (
    EnvelopeLimits,
    blocked_side,
    limit_one,
    limit_surfaces,
)
from tgl_soar.types import SurfaceCommand

LIMITS = EnvelopeLimits(0.8, 20.0)
DT = 0.005
MOST = 20.0 * DT
ZERO = SurfaceCommand(0.0, 0.0, 0.0)

anything = st.floats(allow_nan=True, allow_infinity=True)
commands = st.builds(SurfaceCommand, anything, anything, anything)
within = st.floats(-0.8, 0.8)
sent = st.builds(SurfaceCommand, within, within, within)


@given(last=commands, wanted=commands, dt=anything)
def test_nothing_ever_leaves_the_travel(
    last: SurfaceCommand, wanted: SurfaceCommand, dt: float
) -> None:
    limited = limit_surfaces(LIMITS, last, wanted, dt)
    assert all(-0.8 <= u <= 0.8 for u in limited.command)  # false for NaN too
    assert limited.finite == all(map(isfinite, wanted))


@given(last=sent, wanted=commands, dt=st.floats(-1.0, 1.0))
def test_nothing_moves_faster_than_its_rate(
    last: SurfaceCommand, wanted: SurfaceCommand, dt: float
) -> None:
    limited = limit_surfaces(LIMITS, last, wanted, dt)
    for before, after in zip(last, limited.command, strict=True):
        assert abs(after - before) <= max(0.0, 20.0 * dt) + 1e-12


@given(last=sent, wanted=sent)
def test_what_is_within_passes_unchanged(last: SurfaceCommand, wanted: SurfaceCommand) -> None:
    limited = limit_surfaces(LIMITS, last, wanted, 0.1)  # 2.0: from stop to stop in a tick
    assert limited.command == wanted
    assert limited.finite


@pytest.mark.parametrize("bad", [nan, inf, -inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_bad_number_holds_all_three_surfaces(place: int, bad: float) -> None:
    last = SurfaceCommand(0.1, -0.2, 0.3)
    numbers = [0.5, 0.5, 0.5]
    numbers[place] = bad
    limited = limit_surfaces(LIMITS, last, SurfaceCommand(*numbers), DT)
    assert limited.command == last
    assert not limited.finite


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_a_held_command_is_brought_within_a_travel_made_smaller(bad: float) -> None:
    # The first command after engagement is held against the trim, whatever the travel is.
    limited = limit_surfaces(LIMITS, SurfaceCommand(0.9, -0.9, 0.0), ZERO._replace(rudder=bad), DT)
    assert limited.command == SurfaceCommand(0.8, -0.8, 0.0)


def test_an_unknown_last_command_counts_as_neutral() -> None:
    limited = limit_surfaces(LIMITS, SurfaceCommand(nan, nan, nan), SurfaceCommand(1, -1, 0), DT)
    assert limited.command == SurfaceCommand(MOST, -MOST, 0.0)


# Every boundary with its two neighbours, in every pair.
EDGES = sorted(
    {
        value
        for edge in (-0.8, -MOST, 0.0, MOST, 0.8)
        for value in (nextafter(edge, -inf), edge, nextafter(edge, inf))
    }
    | {-inf, inf, -1.0, 1.0, 0.7, -0.7}
)


@pytest.mark.parametrize("last", [u for u in EDGES if abs(u) <= 0.8])
def test_one_surface_on_every_boundary(last: float) -> None:
    for wanted, change in product(EDGES, (0.0, MOST, nextafter(MOST, inf), 1.6, inf)):
        given_ = limit_one(0.8, change, last, wanted)
        low = max(-0.8, last - change)
        high = min(0.8, last + change)
        assert low <= given_ <= high
        # As near to what is wanted as the limits let it.
        if wanted < low:
            assert given_ == low
        elif wanted > high:
            assert given_ == high
        else:
            assert given_ == wanted


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_one_surface_with_no_number(bad: float) -> None:
    assert -0.8 <= limit_one(0.8, MOST, bad, 0.0) <= 0.8
    assert limit_one(0.8, MOST, 0.3, nan) == 0.3


@pytest.mark.parametrize(
    ("given_", "wanted", "side"),
    [
        (0.8, 0.8, 1),  # at the stop, with or without being asked for more
        (0.8, 2.0, 1),
        (0.3, 0.5, 1),  # rate limit: not as fast as asked
        (0.3, 0.3, 0),
        (0.0, 0.0, 0),
        (nextafter(0.8, 0), nextafter(0.8, 0), 0),
        (-0.3, -0.5, -1),
        (-0.8, -0.8, -1),
        (-0.8, -2.0, -1),
        (nextafter(-0.8, 0), nextafter(-0.8, 0), 0),
    ],
)
def test_the_blocked_side_is_told(given_: float, wanted: float, side: int) -> None:
    assert blocked_side(0.8, given_, wanted) == side


def test_each_surface_tells_its_own_side() -> None:
    limited = limit_surfaces(LIMITS, ZERO, SurfaceCommand(0.5, -0.5, 0.5), DT)
    assert (limited.elevator_blocked, limited.aileron_blocked) == (1, -1)
    limited = limit_surfaces(LIMITS, ZERO, SurfaceCommand(0.0, 0.05, 0.5), DT)
    assert (limited.elevator_blocked, limited.aileron_blocked) == (0, 0)

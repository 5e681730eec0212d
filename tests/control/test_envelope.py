"""The last limiter: boundaries, and every place where a number may not be one."""

from __future__ import annotations

from bisect import bisect_left
from itertools import product
from math import inf, isfinite, nan, nextafter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control import envelope
from tgl_soar.control.envelope import (
    CUT_MODE,
    CUT_NOSE_UP,
    CUT_NOT_FINITE,
    CUT_RATE,
    CUT_TRAVEL,
    MARGIN_FULL,
    OUT_ABOVE,
    OUT_BELOW,
    OUT_DOWNSTREAM,
    OUT_SIDE,
    OUT_UPSTREAM,
    PITCH_PER_BEHIND,
    PITCH_PER_SPEED,
    EnvelopeLimits,
    Fence,
    Limited,
    blocked_side,
    brake_limit,
    brake_room,
    clearance,
    elevator_limit,
    is_air_safe,
    is_clear,
    limit_one,
    outside,
    pitch_within,
    stall_margin,
    unlimited,
)
from tgl_soar.types import (
    GROUND_POINTS,
    INFINITE,
    NO_GROUND,
    Ground,
    SurfaceCommand,
    ground_stretch,
)

LIMITS = EnvelopeLimits(
    deflection_max=0.8,
    rate_max_per_s=20.0,
    alpha_max_rad=0.25,
    speed_min_mps=6.0,
    sink_max_mps=4.0,
    clearance_min_m=0.5,
    glide_pitch_rad=-0.0625,
    brake_throw=0.0,
    elevator_room=inf,
    elevator_per_radps=0.0,
)
DT = 0.005
MOST = 20.0 * DT
ZERO = SurfaceCommand(0.0, 0.0, 0.0)


def limit_surfaces(
    limits: EnvelopeLimits, last: SurfaceCommand, wanted: SurfaceCommand, dt_s: float
) -> Limited:
    """In flight, far from the stall."""
    return envelope.limit_surfaces(limits, last, wanted, limits.deflection_max, 1.0, True, dt_s)


anything = st.floats(allow_nan=True, allow_infinity=True)
commands = st.builds(SurfaceCommand, anything, anything, anything, anything)
within = st.floats(-0.8, 0.8)
sent = st.builds(SurfaceCommand, within, within, within, st.floats(0.0, 1.0))


@given(last=commands, wanted=commands, dt=anything)
def test_nothing_ever_leaves_the_travel(
    last: SurfaceCommand, wanted: SurfaceCommand, dt: float
) -> None:
    limited = limit_surfaces(LIMITS, last, wanted, dt)
    assert all(-0.8 <= u <= 0.8 for u in limited.command[:3])  # false for NaN too
    assert 0.0 <= limited.command.brake <= 1.0
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
def test_the_blocked_side_is_reported(given_: float, wanted: float, side: int) -> None:
    assert blocked_side(0.8, given_, wanted) == side


def test_each_surface_tells_its_own_side() -> None:
    limited = limit_surfaces(LIMITS, ZERO, SurfaceCommand(0.5, -0.5, 0.5), DT)
    assert (limited.elevator_blocked, limited.aileron_blocked) == (1, -1)
    limited = limit_surfaces(LIMITS, ZERO, SurfaceCommand(0.0, 0.05, 0.5), DT)
    assert (limited.elevator_blocked, limited.aileron_blocked) == (0, 0)


# --- what was cut -----------------------------------------------------------------------------


@given(last=sent, wanted=commands, dt=st.floats(0.0, 0.02), up=st.floats(-0.8, 0.8))
def test_what_was_cut_is_reported_and_nothing_else(
    last: SurfaceCommand, wanted: SurfaceCommand, dt: float, up: float
) -> None:
    limited = envelope.limit_surfaces(LIMITS, last, wanted, up, 1.0, True, dt)
    assert limited.finite == (limited.cut & CUT_NOT_FINITE == 0)
    if limited.command == wanted and wanted.elevator <= up:
        assert limited.cut == 0
    if limited.finite and limited.command != wanted:
        assert limited.cut
    if limited.cut & CUT_NOSE_UP:
        assert wanted.elevator > up or not limited.finite
    beyond = any(abs(u) > 0.8 for u in wanted[:3]) or not 0.0 <= wanted.brake <= 1.0
    assert bool(limited.cut & CUT_TRAVEL) <= beyond


@pytest.mark.parametrize("surface", SurfaceCommand._fields[:3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_travel_and_rate_are_reported_of_each_surface(surface: str, sign: float) -> None:
    def cut(last: float, wanted: float) -> int:
        before = SurfaceCommand(**{**ZERO._asdict(), surface: sign * last})
        command = SurfaceCommand(**{**ZERO._asdict(), surface: sign * wanted})
        return limit_surfaces(LIMITS, before, command, DT).cut

    assert cut(0.79, 0.8) == 0
    assert cut(0.79, nextafter(0.8, inf)) == CUT_TRAVEL
    assert cut(0.0, MOST) == 0
    assert cut(0.0, nextafter(MOST, inf)) == CUT_RATE
    assert cut(0.0, 0.9) == CUT_RATE | CUT_TRAVEL
    assert cut(0.75, 0.84) == CUT_TRAVEL


@pytest.mark.parametrize("other", SurfaceCommand._fields[:3])
@pytest.mark.parametrize("surface", SurfaceCommand._fields[:3])
def test_a_surface_on_its_boundary_is_not_blamed_for_another(surface: str, other: str) -> None:
    """One is too fast and the other as fast as it may be; one too far and the other at its stop."""
    if surface == other:
        return

    def command(one: float, two: float) -> SurfaceCommand:
        return SurfaceCommand(**{**ZERO._asdict(), surface: one, other: two})

    assert limit_surfaces(LIMITS, ZERO, command(2 * MOST, MOST), DT).cut == CUT_RATE
    assert limit_surfaces(LIMITS, ZERO, command(2 * MOST, 0.8), 0.04).cut == 0
    assert limit_surfaces(LIMITS, ZERO, command(0.9, 0.8), 1.0).cut == CUT_TRAVEL
    held = command(0.0, 0.8)  # at its stop while the other is too fast: no travel is cut
    assert limit_surfaces(LIMITS, held, command(2 * MOST, 0.8), DT).cut == CUT_RATE
    stopped = limit_surfaces(LIMITS, command(0.8, 0.0), command(0.9, MOST), DT)
    # 0.1 beyond the stop is as fast as it may be too.
    assert stopped.cut & CUT_TRAVEL
    near = command(0.75, 0.0)
    assert limit_surfaces(LIMITS, near, command(0.84, MOST), DT).cut == CUT_TRAVEL


def test_a_mode_that_does_not_fly_puts_nothing_out() -> None:
    limited = envelope.limit_surfaces(
        LIMITS, SurfaceCommand(0.5, 0.5, 0.5), SurfaceCommand(nan, 0.5, 0.5), 0.8, 1.0, False, DT
    )
    assert limited == Limited(
        command=ZERO,
        elevator_blocked=0,
        aileron_blocked=0,
        brake_blocked=0,
        brake_max=1.0,
        finite=True,
        cut=CUT_MODE,
    )


def test_a_command_of_which_nothing_is_cut_is_blocked_nowhere() -> None:
    command = SurfaceCommand(0.1, -0.2, 0.3, 0.4)
    assert unlimited(command) == Limited(
        command=command,
        elevator_blocked=0,
        aileron_blocked=0,
        brake_blocked=0,
        brake_max=1.0,
        finite=True,
        cut=0,
    )


def test_every_cut_has_its_word() -> None:
    bits = [v for k, v in vars(envelope).items() if k.startswith("CUT_") and isinstance(v, int)]
    assert sorted(bits) == [1 << i for i in range(len(envelope.CUT_TEXTS))]


# --- the stall ----------------------------------------------------------------------------------


def around(value: float) -> tuple[float, float, float]:
    return nextafter(value, -inf), value, nextafter(value, inf)


def test_the_margin_is_the_smaller_of_what_is_known() -> None:
    assert stall_margin(LIMITS, nan, nan) == inf
    assert stall_margin(LIMITS, 0.125, nan) == 0.125
    assert stall_margin(LIMITS, nan, 8.0) == 2.0 * PITCH_PER_SPEED
    assert stall_margin(LIMITS, 0.125, 8.0) == 2.0 * PITCH_PER_SPEED
    assert stall_margin(LIMITS, 0.25, 8.0) == 0.0
    assert stall_margin(LIMITS, 0.5, 100.0) == -0.25
    assert stall_margin(LIMITS, 0.0, 5.0) == -PITCH_PER_SPEED


@given(
    alpha=st.floats(-1.0, 1.0), speed=st.floats(0.0, 30.0), wanted=sent, last=sent, dt=st.just(1.0)
)
def test_at_the_limit_the_elevator_stands_no_further_up_than_its_trim(
    alpha: float, speed: float, wanted: SurfaceCommand, last: SurfaceCommand, dt: float
) -> None:
    margin = stall_margin(LIMITS, alpha, speed)
    trim = 0.1
    up = elevator_limit(LIMITS, trim, margin, 0.0)
    assert trim <= up <= 0.8
    given_ = envelope.limit_surfaces(LIMITS, last, wanted, up, 1.0, True, dt).command.elevator
    if alpha >= 0.25 or speed <= 6.0:
        assert given_ <= trim
    if margin >= MARGIN_FULL:
        assert given_ == wanted.elevator
    assert given_ <= wanted.elevator


ROOM = LIMITS._replace(elevator_room=0.25, elevator_per_radps=0.2)


@pytest.mark.parametrize(
    ("limits", "trim", "margin", "rate_radps", "most"),
    [
        (ROOM, 0.1, inf, 0.0, 0.35),  # far from the stall, or unknown: not all of it
        (ROOM, -0.2, inf, 0.0, 0.05),  # from the trim on
        (ROOM, 0.1, inf, 0.5, 0.45),  # a nose that comes up needs more for that alone
        (ROOM, 0.1, inf, -0.5, 0.35),  # one that falls needs as much as one at rest
        (ROOM, 0.1, inf, nan, 0.35),
        (ROOM, 0.7, inf, 0.0, 0.8),  # never beyond the travel
        (ROOM, 0.1, inf, 9.0, 0.8),
        (ROOM, 0.1, 0.5 * MARGIN_FULL, 0.0, 0.35),  # near the stall half of the travel is less, …
        (ROOM, 0.1, 0.25 * MARGIN_FULL, 0.0, 0.275),  # … or it is not
        (ROOM, 0.1, -1.0, 0.5, 0.1),  # beyond, nothing
        (LIMITS, 0.1, inf, 0.5, 0.8),  # of an unknown aircraft: all of it
    ],
)
def test_the_elevator_goes_no_further_than_what_holds_the_stall(
    limits: EnvelopeLimits, trim: float, margin: float, rate_radps: float, most: float
) -> None:
    assert elevator_limit(limits, trim, margin, rate_radps) == pytest.approx(most)


def test_the_elevators_limit_is_met_on_its_boundaries() -> None:
    below, full, above = around(MARGIN_FULL)
    assert elevator_limit(LIMITS, 0.1, below, 0.0) <= 0.8
    assert elevator_limit(LIMITS, 0.1, below, 0.0) == pytest.approx(0.8)
    assert elevator_limit(LIMITS, 0.1, full, 0.0) == 0.8
    assert elevator_limit(LIMITS, 0.1, above, 0.0) == 0.8
    trim = next(k / 1000 for k in range(-800, 800) if k / 1000 + (0.8 - k / 1000) != 0.8)
    assert elevator_limit(LIMITS, trim, full, 0.0) == 0.8  # with no rounding
    assert elevator_limit(LIMITS, 0.1, inf, 0.0) == 0.8
    assert elevator_limit(LIMITS, 0.1, 0.5 * MARGIN_FULL, 0.0) == pytest.approx(0.45)
    for margin in (0.0, nextafter(0.0, -inf), -1.0, -inf):
        assert elevator_limit(LIMITS, 0.1, margin, 0.0) == 0.1
    assert 0.1 < elevator_limit(LIMITS, 0.1, 1e-9, 0.0) < 0.11


def test_the_elevator_that_is_held_down_tells_the_loops_before_it() -> None:
    limited = envelope.limit_surfaces(
        LIMITS, ZERO, ZERO._replace(elevator=0.05), 0.02, 1.0, True, DT
    )
    assert limited.command.elevator == 0.02
    assert (limited.elevator_blocked, limited.cut) == (1, CUT_NOSE_UP)
    # At the limit without asking for more: it can go no further up either.
    limited = envelope.limit_surfaces(
        LIMITS, ZERO, ZERO._replace(elevator=0.02), 0.02, 1.0, True, DT
    )
    assert (limited.command.elevator, limited.elevator_blocked, limited.cut) == (0.02, 1, 0)
    # And down it goes as ever.
    limited = envelope.limit_surfaces(
        LIMITS, ZERO, ZERO._replace(elevator=-0.05), 0.02, 1.0, True, DT
    )
    assert (limited.command.elevator, limited.elevator_blocked) == (-0.05, 0)


STALL = -envelope.STALL_BEYOND


@pytest.mark.parametrize(
    ("margin", "climb", "safe"),
    [
        (inf, 0.0, True),
        (0.0, 0.0, True),
        (nextafter(STALL, inf), 0.0, True),
        (STALL, 0.0, True),
        (nextafter(STALL, -inf), 0.0, False),
        (inf, nextafter(-4.0, inf), True),
        (inf, -4.0, True),
        (inf, nextafter(-4.0, -inf), False),
        (nan, 0.0, False),
        (inf, nan, False),
    ],
)
def test_where_the_air_is_safe(margin: float, climb: float, safe: bool) -> None:
    assert is_air_safe(LIMITS, margin, climb) is safe


def test_the_margins_are_those_that_the_parameters_name() -> None:
    """ALPHA_MAX: kept from rising from 3 deg below on, recovered from 3 deg beyond; SPEED_MIN:
    1 m/s each; CLEAR_MIN: clear again at 1.3 times the least.  In numbers, not in names."""
    assert not is_air_safe(LIMITS, stall_margin(LIMITS, 0.25 + 0.0501, nan), 0.0)
    assert is_air_safe(LIMITS, stall_margin(LIMITS, 0.25 + 0.0499, nan), 0.0)
    assert not is_air_safe(LIMITS, stall_margin(LIMITS, nan, 4.99), 0.0)
    assert is_air_safe(LIMITS, stall_margin(LIMITS, nan, 5.01), 0.0)
    assert elevator_limit(LIMITS, 0.0, stall_margin(LIMITS, 0.25 - 0.0501, nan), 0.0) == 0.8
    assert elevator_limit(LIMITS, 0.0, stall_margin(LIMITS, 0.25 - 0.0499, nan), 0.0) < 0.8
    assert elevator_limit(LIMITS, 0.0, stall_margin(LIMITS, nan, 6.99), 0.0) < 0.8
    assert elevator_limit(LIMITS, 0.0, stall_margin(LIMITS, nan, 7.01), 0.0) == 0.8
    assert is_clear(LIMITS, 0.0, 0.0, 0.6501)
    assert not is_clear(LIMITS, 0.0, 0.0, 0.6499)


HIGH = 0.5 * envelope.CLEAR_FACTOR


@pytest.mark.parametrize(
    ("margin", "climb", "height", "clear"),
    [
        (0.0, -2.0, HIGH, True),
        (inf, 5.0, inf, True),
        (nextafter(0.0, -inf), 0.0, inf, False),
        (inf, nextafter(-2.0, -inf), inf, False),
        (inf, 0.0, nextafter(HIGH, -inf), False),
        (inf, 0.0, nan, False),
        (nan, 0.0, inf, False),
        (inf, nan, inf, False),
    ],
)
def test_where_it_is_clear_again(margin: float, climb: float, height: float, clear: bool) -> None:
    assert is_clear(LIMITS, margin, climb, height) is clear
    assert not clear or is_air_safe(LIMITS, margin, climb)


GLIDE = LIMITS.glide_pitch_rad
HOLDING = -0.125  # what holds the line in fast air, below the best glide's
DIVE = -0.25
LEAST = LIMITS.clearance_min_m


@pytest.mark.parametrize(
    ("setpoint", "margin", "given_"),
    [
        (0.1, inf, 0.1),
        (0.1, MARGIN_FULL, 0.1),  # far enough from the stall: the law may ask for more
        (0.125, 0.03125, 0.03125),
        (0.125, 0.0, 0.0),
        (0.125, -0.03125, -0.03125),
        (0.125, -0.125, GLIDE),  # but no further down than the glide
        (DIVE, 0.0, DIVE),  # nose-down is never held back by the stall
        (0.03125, 0.03125, 0.03125),
    ],
)
def test_the_pitch_that_may_be_flown_near_the_stall(
    setpoint: float, margin: float, given_: float
) -> None:
    assert pitch_within(LIMITS, setpoint, 0.0, margin, 0.0, inf, 0.0, 0.0) == given_


@pytest.mark.parametrize(
    ("setpoint", "margin", "climb", "height", "holding", "given_"),
    [
        # Near the ground and sinking so that the least clearance is near: not below the glide.
        (DIVE, inf, -0.5, 1.0, 0.0, DIVE),  # twice the least clearance is not near
        (DIVE, inf, -0.5, nextafter(1.0, 0.0), 0.0, GLIDE),
        (DIVE, inf, -0.25, 0.75, 0.0, DIVE),  # a second from the least clearance
        (DIVE, inf, nextafter(-0.25, -inf), 0.75, 0.0, GLIDE),
        (DIVE, inf, -0.25, -1.0, 0.0, GLIDE),
        (GLIDE, inf, -0.25, 0.0, 0.0, GLIDE),
        (0.0, inf, -0.25, 0.0, 0.0, 0.0),
        (DIVE, -0.125, -0.25, 0.0, 0.0, GLIDE),
        # Not sinking: what drifts onto the slope needs a lower nose, and nothing else helps it.
        (DIVE, inf, 0.0, 0.25, 0.0, DIVE),
        (DIVE, inf, 1.0, 0.25, 0.0, DIVE),
        # Where the line is held by a lower pitch than the glide's, it may be flown.
        (DIVE, inf, -0.5, 0.75, HOLDING, HOLDING),
        (HOLDING, inf, -0.5, 0.75, HOLDING, HOLDING),
        (DIVE, inf, -0.5, 0.75, nan, GLIDE),
        (DIVE, inf, nan, 0.75, 0.0, DIVE),
        # Sinking fast, wherever.
        (DIVE, inf, -4.0, inf, 0.0, DIVE),
        (DIVE, inf, nextafter(-4.0, -inf), inf, 0.0, GLIDE),
        (DIVE, inf, -4.5, inf, HOLDING, HOLDING),
    ],
)
def test_the_pitch_that_may_be_flown_low(
    setpoint: float, margin: float, climb: float, height: float, holding: float, given_: float
) -> None:
    assert LEAST == 0.5
    assert pitch_within(LIMITS, setpoint, 0.0, margin, climb, height, holding, 0.0) == given_


@pytest.mark.parametrize(
    ("setpoint", "climb", "height", "holding", "behind", "given_"),
    [
        (DIVE, -0.5, 0.75, 0.0, 0.03125, GLIDE - 0.0625),
        (DIVE, -0.5, 0.75, HOLDING, 0.03125, HOLDING - 0.0625),
        (GLIDE, -0.5, 0.75, 0.0, 0.03125, GLIDE),  # it is a limit, and asks for nothing
        (DIVE, -0.5, 0.75, 0.0, 1.0, DIVE),
        (DIVE, -4.5, inf, 0.0, 0.03125, GLIDE - 0.0625),
        (DIVE, -0.5, 0.75, 0.0, -0.25, GLIDE),  # in front of the line
        (DIVE, -0.5, 0.75, 0.0, nan, GLIDE),
    ],
)
def test_what_is_blown_behind_its_line_may_put_its_nose_further_down(
    setpoint: float, climb: float, height: float, holding: float, behind: float, given_: float
) -> None:
    """Stalled in the updraft close to the slope it sinks because its nose is too high."""
    assert PITCH_PER_BEHIND == 2.0
    assert pitch_within(LIMITS, setpoint, 0.0, inf, climb, height, holding, behind) == given_


def test_the_pitch_is_limited_from_where_the_nose_is() -> None:
    assert pitch_within(LIMITS, 0.5, 0.25, 0.03125, 0.0, inf, 0.0, 0.0) == 0.28125


# --- the place ----------------------------------------------------------------------------------

BOX = Fence(x_min_m=-4.0, x_max_m=8.0, y_max_m=2.0, z_min_m=0.5, z_max_m=16.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_no_number_is_outside(axis: int, bad: float) -> None:
    place = [0.0, 0.0, 1.0]
    place[axis] = bad
    assert outside(BOX, *place)


@pytest.mark.parametrize(
    ("axis", "edge", "inward", "bit"),
    [
        (0, -4.0, inf, OUT_UPSTREAM),
        (0, 8.0, -inf, OUT_DOWNSTREAM),
        (1, -2.0, inf, OUT_SIDE),
        (1, 2.0, -inf, OUT_SIDE),
        (2, 0.5, inf, OUT_BELOW),
        (2, 16.0, -inf, OUT_ABOVE),
    ],
)
def test_each_side_of_the_fence(axis: int, edge: float, inward: float, bit: int) -> None:
    def at(value: float) -> int:
        place = [0.0, 0.0, 1.0]
        place[axis] = value
        return outside(BOX, *place)

    assert at(edge) == 0
    assert at(nextafter(edge, inward)) == 0
    assert at(nextafter(edge, -inward)) == bit


def test_a_corner_is_reported_of_every_side() -> None:
    assert outside(BOX, -5.0, 3.0, 20.0) == OUT_UPSTREAM | OUT_SIDE | OUT_ABOVE
    assert outside(BOX, 9.0, -3.0, 0.0) == OUT_DOWNSTREAM | OUT_SIDE | OUT_BELOW


def ground(*points: tuple[float, float]) -> Ground:
    padded = [*points, *[points[-1]] * (GROUND_POINTS - len(points))]
    return Ground(len(points), tuple(p[0] for p in padded), tuple(p[1] for p in padded))


BOARD = ground((0.0, 0.0), (4.0, 3.0), (8.0, 3.0))  # 3-4-5, then level


@pytest.mark.parametrize(
    ("x", "z", "distance"),
    [
        (-9.0, 1.0, 1.0),
        (0.0, 1.0, 1.0),
        (2.0, 1.5, 0.0),
        (2.0, 2.75, 1.0),  # 1.25 above a slope of 3 in 4
        (4.0, 4.25, 1.0),  # the end of the slope still counts as slope
        (6.0, 4.0, 1.0),
        (8.0, 4.0, 1.0),
        (20.0, 2.0, -1.0),
        (2.0, 0.25, -1.0),
    ],
)
def test_clearance_is_the_distance_to_a_plane(x: float, z: float, distance: float) -> None:
    assert clearance(BOARD, x, z) == pytest.approx(distance, abs=1e-12)


def test_a_profile_goes_on_level_from_its_ends() -> None:
    ramp = ground((0.0, 1.0), (4.0, 4.0))
    assert clearance(ramp, -1.0, 2.25) == 1.25
    assert clearance(ramp, 0.0, 2.25) == 1.25
    assert clearance(ramp, nextafter(0.0, inf), 2.25) == pytest.approx(1.0)
    assert clearance(ramp, nextafter(4.0, 0.0), 5.25) == pytest.approx(1.0)
    assert clearance(ramp, 4.0, 5.25) == 1.25
    assert clearance(ramp, 9.0, 5.25) == 1.25
    assert clearance(ground((3.0, 2.0)), 3.0, 5.0) == 3.0  # one point: a height


def test_a_profile_may_have_as_many_points_as_there_is_room_for() -> None:
    stairs = ground(*((float(k), float(k % 2)) for k in range(GROUND_POINTS)))
    for k in range(GROUND_POINTS):
        assert clearance(stairs, k - 0.5, 0.5) in (
            pytest.approx(0.0, abs=1e-12), 0.5  # on the slope, or before the first point
        )  # fmt: skip
    assert clearance(stairs, 100.0, 2.0) == 1.0  # level beyond the last


@given(st.lists(st.floats(-50.0, 50.0), min_size=2, max_size=GROUND_POINTS, unique=True), st.data())
def test_a_stretch_of_the_profile_is_the_one_that_it_lies_on(
    places: list[float], data: st.DataObject
) -> None:
    places.sort()
    x = data.draw(st.floats(-60.0, 60.0) | st.sampled_from(places))
    stretch = ground_stretch(ground(*((place, 0.5 * place) for place in places)), x)
    i = len(places) if x >= places[-1] else bisect_left(places, x)
    ends = places[max(0, i - 1)], places[min(i, len(places) - 1)]
    assert (stretch.x_m, stretch.next_x_m) == ends
    assert (stretch.z_m, stretch.next_z_m) == (0.5 * ends[0], 0.5 * ends[1])


@pytest.mark.parametrize("k", range(GROUND_POINTS))
def test_a_point_belongs_to_the_stretch_that_ends_there(k: int) -> None:
    stairs = ground(*((float(n), float(n % 2)) for n in range(GROUND_POINTS)))
    at = ground_stretch(stairs, float(k))
    before = k - 1 if 0 < k < GROUND_POINTS - 1 else k  # level upstream, and from the last one on
    assert (at.x_m, at.next_x_m, at.z_m, at.next_z_m) == (before, k, before % 2, k % 2)
    beyond = ground_stretch(stairs, k + 0.5)
    assert (beyond.x_m, beyond.next_x_m) == (k, min(k + 1, GROUND_POINTS - 1))


def test_where_no_ground_is_known_nothing_is_low() -> None:
    assert clearance(NO_GROUND, 0.0, -1e9) == INFINITE


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_clearance_of_no_place_ends(bad: float) -> None:
    clearance(BOARD, bad, 1.0)  # returns at all
    assert not clearance(BOARD, 2.0, bad) >= 0.0 or bad == inf


@given(aileron=st.floats(-0.8, 0.8), brake=st.floats(0.0, 1.0), throw=st.floats(0.05, 1.0))
def test_two_ailerons_that_brake_leave_roll_all_of_its_travel(
    aileron: float, brake: float, throw: float
) -> None:
    limits = LIMITS._replace(brake_throw=throw)
    wanted = SurfaceCommand(0.0, aileron, 0.0, brake)
    given_ = envelope.limit_surfaces(limits, wanted, wanted, 0.8, 1.0, True, DT).command
    assert given_.aileron == aileron
    assert abs(given_.aileron) + throw * given_.brake <= 0.8 + 1e-12
    assert given_.brake == pytest.approx(min(brake, (0.8 - abs(aileron)) / throw))
    assert brake_room(LIMITS, aileron) == 1.0  # a surface of its own


def test_roll_takes_the_brakes_travel_at_once() -> None:
    limits = LIMITS._replace(brake_throw=0.8, rate_max_per_s=1.0)
    out = SurfaceCommand(0.0, 0.0, 0.0, 1.0)
    rolled = envelope.limit_surfaces(
        limits, out._replace(aileron=0.8), out._replace(aileron=0.8), 0.8, 1.0, True, DT
    )
    assert rolled.command.brake == 0.0
    assert rolled.brake_blocked == 1


def test_the_brake_is_retracted_near_the_stall_and_low() -> None:
    assert brake_limit(LIMITS, inf, 0.0, inf) == 1.0
    assert brake_limit(LIMITS, 0.5 * MARGIN_FULL, 0.0, inf) == pytest.approx(0.5)
    assert brake_limit(LIMITS, -0.1, 0.0, inf) == 0.0
    assert brake_limit(LIMITS, inf, -0.6, 0.9) == 0.0  # at its least clearance within a second
    assert brake_limit(LIMITS, inf, -4.1, inf) == 0.0


@pytest.mark.parametrize(
    ("wanted", "most", "blocked"), [(0.5, 1.0, 0), (1.2, 1.0, 1), (0.5, 0.3, 1), (-0.1, 1.0, -1)]
)
def test_a_brake_says_where_it_can_go_no_further(wanted: float, most: float, blocked: int) -> None:
    last = ZERO._replace(brake=min(most, max(0.0, wanted)))
    limited = envelope.limit_surfaces(
        LIMITS, last, ZERO._replace(brake=wanted), 0.8, most, True, DT
    )
    assert limited.brake_blocked == blocked

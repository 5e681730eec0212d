"""e_rho against a projection, and the line's motion against kinematics."""

from __future__ import annotations

from itertools import pairwise
from math import cos, hypot, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tgl_soar.control.target_line import (
    LineLimits,
    LineState,
    TargetLine,
    e_rho,
    eta_from_lean,
    line_at,
    line_step,
)

DT = 0.005
LIMITS = LineLimits(0.3, 0.5, radians(5.0))
UPRIGHT = 0.5 * pi

metres = st.floats(-100.0, 100.0)
inclinations = st.floats(radians(20.0), radians(160.0))
limits_of_any_kind = st.builds(
    LineLimits, st.floats(0.02, 1.0), st.floats(0.05, 5.0), st.floats(0.01, 0.5)
)


# --- e_rho ----------------------------------------------------------------------------------


@given(x0=metres, z0=metres, eta=inclinations, x=metres, z=metres)
def test_e_rho_is_the_distance_to_the_line(
    x0: float, z0: float, eta: float, x: float, z: float
) -> None:
    # The nearest point by least squares over the line's parameter: no normal vector in it.
    along = np.array([[cos(eta)], [sin(eta)]])
    offset = np.array([x - x0, z - z0])
    s, *_ = np.linalg.lstsq(along, offset, rcond=None)
    distance = float(np.linalg.norm(offset - along @ s))
    assert abs(e_rho(x0, z0, eta, x, z)) == pytest.approx(distance, abs=1e-9)


@given(x0=metres, z0=metres, eta=inclinations, s=metres, x=metres, z=metres)
def test_any_point_of_the_line_will_do(
    x0: float, z0: float, eta: float, s: float, x: float, z: float
) -> None:
    moved = e_rho(x0 + s * cos(eta), z0 + s * sin(eta), eta, x, z)
    assert moved == pytest.approx(e_rho(x0, z0, eta, x, z), abs=1e-9)


@given(x0=metres, z0=metres, eta=inclinations, upstream=st.floats(0.01, 100.0), dz=metres)
def test_e_rho_is_positive_upstream(
    x0: float, z0: float, eta: float, upstream: float, dz: float
) -> None:
    # Upstream of the line at the same height is where x is smaller than the line's.
    x_of_line = x0 + dz / np.tan(eta)
    assert e_rho(x0, z0, eta, x_of_line - upstream, z0 + dz) > 0.0
    assert e_rho(x0, z0, eta, x_of_line + upstream, z0 + dz) < 0.0


def test_e_rho_of_a_vertical_line_is_the_way_upstream() -> None:
    assert e_rho(1.0, 5.0, UPRIGHT, 0.75, 2.0) == pytest.approx(0.25)


def test_lean_is_positive_when_the_upper_end_leans_upwind() -> None:
    eta = eta_from_lean(radians(20.0))
    assert cos(eta) < 0.0 < sin(eta)  # going up the line is going upwind
    # A leaning line's upper end is upwind of its point: an aircraft straight above is downstream.
    assert e_rho(0.0, 0.0, eta, 0.0, 1.0) == pytest.approx(-sin(radians(20.0)))


# --- the moving line ------------------------------------------------------------------------


def error_of(state: LineState, x: float, z: float) -> float:
    return e_rho(state.x_m, state.z_m, state.eta_rad, x, z)


def test_a_line_that_starts_at_the_aircraft_is_no_error() -> None:
    target = TargetLine(3.0, 1.0, radians(110.0))
    start = line_at(target, 0.3, 1.4)
    assert error_of(start, 0.3, 1.4) == 0.0
    assert start == LineState(x_m=0.3, z_m=1.4, eta_rad=target.eta_rad, speed_mps=0.0, moving=True)


@pytest.mark.parametrize("distance_m", [0.01, 0.1, 0.5, 3.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_arrives_when_kinematics_says(distance_m: float, side: float) -> None:
    """Speeding up and braking at a, cruising at v: d / v + v / a, or 2 √(d / a) if it never
    cruises.  Two ticks for the first move and the last."""
    v, a, _ = LIMITS
    whole = distance_m >= v * v / a
    expected = distance_m / v + v / a if whole else 2.0 * sqrt(distance_m / a)
    target = TargetLine(-side * distance_m, 2.0, UPRIGHT)
    state, ticks, speeds = line_at(target, 0.0, 1.0), 0, [0.0]
    while (state.x_m, state.z_m) != (target.x_m, target.z_m):
        state = line_step(LIMITS, state, target, 0.0, 1.0, DT)
        ticks += 1
        assert ticks < 10_000
        assert (state.x_m - target.x_m) * side >= 0.0  # it never passes its target
        speeds.append(abs(state.speed_mps))
        assert state.moving
    assert ticks * DT == pytest.approx(expected, abs=2.0 * DT)
    assert not line_step(LIMITS, state, target, 0.0, 1.0, DT).moving
    # From where it brakes it brakes by a, neither harder nor softer, down to the last move.
    braking = [s - t for s, t in pairwise(speeds[:-1]) if t < s][1:]
    assert braking == pytest.approx([a * DT] * len(braking))
    assert len(braking) > 10
    assert (state.x_m, state.z_m, state.eta_rad) == target


@settings(deadline=None)
@given(
    limits=limits_of_any_kind,
    seconds=st.tuples(st.floats(-10, 10), st.floats(-10, 10)),
    eta=inclinations,
    fraction=st.floats(-1.0, 1.0),
    dts=st.lists(st.floats(0.0, 0.1), min_size=1, max_size=6),
    drift_m=st.floats(0.0, 0.5),
)
def test_a_moving_line_is_gentle_and_arrives(
    limits: LineLimits,
    seconds: tuple[float, float],
    eta: float,
    fraction: float,
    dts: list[float],
    drift_m: float,
) -> None:
    """Any limits, any jitter of the tick, the aircraft drifting: never faster than the limit, never
    a harder jerk than the limit, and exactly on the target in the end."""
    dts = [*dts, 0.1]  # some time must pass
    # As many seconds away as drawn, sliding and turning.
    x0 = limits.speed_mps * seconds[0]
    eta1 = max(0.3, min(pi - 0.3, eta + limits.turn_rate_radps * seconds[1]))
    target = TargetLine(x0, 1.0, eta1)
    state = LineState(
        x_m=0.0, z_m=1.0, eta_rad=eta, speed_mps=fraction * limits.speed_mps, moving=True
    )
    time = 0.0
    for k in range(10_000):
        dt = dts[k % len(dts)]
        time += dt
        x, z = drift_m * sin(2.0 * time), 1.0 + drift_m * cos(1.3 * time)
        before = error_of(state, x, z)
        new = line_step(limits, state, target, x, z, dt)
        # The last move ends at rest from at most 2 a dt: nowhere else more than a dt.
        if new.speed_mps != 0.0:
            change = abs(new.speed_mps - state.speed_mps)
            assert change <= limits.acceleration_mps2 * dt + 1e-12
        assert abs(new.speed_mps) <= limits.speed_mps + 1e-12
        turned = abs(new.eta_rad - state.eta_rad)
        assert turned <= limits.turn_rate_radps * dt + 1e-12
        # What moves at the aircraft: its sliding, and of turning only that a distance off the line
        # is measured square to another line, d (1 - cos).
        moved = abs(error_of(new, x, z) - before)
        assert moved <= limits.speed_mps * dt + abs(before) * (1.0 - cos(turned)) + 1e-9
        state = new
        if not state.moving:
            break
    assert (state.x_m, state.z_m, state.eta_rad) == target
    assert state.speed_mps == 0.0


def test_turning_makes_no_error_for_an_aircraft_on_the_line() -> None:
    # The operator's point is 3 m away: about that point the line would sweep by 3 m · 5°/s.
    x, z, eta = 0.0, 1.0, radians(110.0)
    state = line_at(TargetLine(0.0, 0.0, UPRIGHT), x, z)
    # A target through the aircraft: all that is left to do is to turn.
    target = TargetLine(x - 3.0 * cos(eta), z - 3.0 * sin(eta), eta)
    ticks = 0
    while state.eta_rad != target.eta_rad:
        state = line_step(LIMITS, state, target, x, z, DT)
        assert abs(error_of(state, x, z)) < 1e-12
        ticks += 1
        assert ticks < 10_000
    assert ticks * DT == pytest.approx(20.0 / 5.0, abs=2.0 * DT)


def test_a_target_reversed_in_mid_move_gives_no_jump() -> None:
    ahead, back = TargetLine(-2.0, 0.0, UPRIGHT), TargetLine(2.0, 0.0, UPRIGHT)
    state = line_at(ahead, 0.0, 1.0)
    for _ in range(400):  # 2 s: cruising at 0.3 m/s upstream
        state = line_step(LIMITS, state, ahead, 0.0, 1.0, DT)
    assert state.speed_mps == pytest.approx(0.3)
    position, furthest = state.x_m, state.x_m
    for _ in range(400):
        new = line_step(LIMITS, state, back, 0.0, 1.0, DT)
        assert abs(new.speed_mps - state.speed_mps) <= 0.5 * DT + 1e-12
        assert abs(new.x_m - state.x_m) <= 0.3 * DT + 1e-12
        state = new
        furthest = min(furthest, state.x_m)
    assert state.speed_mps == pytest.approx(-0.3)
    assert position - furthest == pytest.approx(0.3**2 / (2.0 * 0.5), rel=0.03)  # v² / 2a


@given(limits=limits_of_any_kind, eta=inclinations, speed=st.floats(-0.02, 0.02), z=metres)
def test_no_time_moves_nothing(limits: LineLimits, eta: float, speed: float, z: float) -> None:
    target = TargetLine(1.0, 2.0, radians(100.0))
    state = LineState(x_m=0.0, z_m=1.0, eta_rad=eta, speed_mps=speed, moving=True)
    new = line_step(limits, state, target, 0.3, z, 0.0)
    assert new.speed_mps == speed
    assert new.eta_rad == eta
    assert new.moving
    # Written by another of its points, the nearest to the aircraft, it is the same line.
    assert error_of(new, 0.0, 1.0) == pytest.approx(0.0, abs=1e-9)
    assert hypot(new.x_m - 0.3, new.z_m - z) == pytest.approx(
        abs(error_of(state, 0.3, z)), abs=1e-9
    )


def test_at_rest_on_its_target_it_says_so() -> None:
    target = TargetLine(1.0, 2.0, radians(100.0))
    state = LineState(
        x_m=target.x_m, z_m=target.z_m, eta_rad=target.eta_rad, speed_mps=0.0, moving=True
    )
    assert line_step(LIMITS, state, target, 5.0, 5.0, DT) == state._replace(moving=False)
    assert line_step(LIMITS, state, target, 5.0, 5.0, 0.0).moving is False


def test_a_coarse_tick_does_not_outrun_the_speed() -> None:
    # a dt = 0.5 m/s is far above the speed of 0.02 m/s: still no more than 2 mm in a tick.
    limits = LineLimits(0.02, 5.0, 0.1)
    target = TargetLine(-0.03, 0.0, UPRIGHT)
    state = line_at(target, 0.0, 1.0)
    moves: list[float] = []
    while state.moving and len(moves) < 100:
        new = line_step(limits, state, target, 0.0, 1.0, 0.1)
        moves.append(abs(new.x_m - state.x_m))
        state = new
    assert max(moves) <= 0.02 * 0.1 + 1e-12
    assert state.x_m == -0.03

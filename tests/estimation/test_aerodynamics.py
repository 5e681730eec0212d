"""Lift, drag and trim of an airframe, by the equations of `types.Aerodynamics` and by equilibria.

Derivatives are differences, and a steady glide is one in which the forces add up to nothing.
"""

from __future__ import annotations

from math import atan2, cos, hypot, inf, isfinite, isnan, log, nan, sin
from typing import Any

import pytest
from scipy.optimize import brentq

from tgl_soar.estimation.aerodynamics import (
    brake_sink,
    braked,
    elevator_of_rate,
    elevator_room,
    glide_alpha,
    glide_pitch,
    lift_drag,
    stall_speed,
    trim_alpha,
)
from tgl_soar.types import NO_AERODYNAMICS, Aerodynamics, GlidePolar, polar_sink

# A glider in all of whose numbers nothing cancels.
PLANE = Aerodynamics(
    mass_kg=0.75, wing_area_m2=0.18, gravity_mps2=9.81, air_density_kgpm3=1.2,
    CL0=0.3, CL_alpha=4.6, CL_elevator=0.25, stall_alpha_rad=0.22, stall_width_rad=0.02,
    CD0=0.04, CD_lift=0.07, CD_separated=0.9,
    chord_m=0.16, Cm0=0.05, Cm_alpha=-0.7, Cm_q=-9.0, Cm_elevator=0.6,
    CL_brake=-0.3, CD_brake=0.06, Cm_brake=0.04, brake_throw=0.0,
    propeller_thrust_n=0.0, propeller_speed_mps=0.0, propeller_lag_s=0.0,
    polar=GlidePolar(c0=2.1, c1=-0.41, c2=0.028, c3=0.0011, speed_min_mps=6.0, speed_max_mps=14.0),
)  # fmt: skip
SMALL = 1e-6
LEVELS = (-0.1, 0.05, 0.15, 0.21, 0.23, 0.3)  # through the stall


def coefficients(alpha_rad: float, elevator: float) -> tuple[float, float]:
    """(C_L, C_D), from the tuple's own equations."""
    a, w = PLANE, PLANE.stall_width_rad
    beyond = w * log(1.0 + 2.718281828459045 ** ((alpha_rad - a.stall_alpha_rad) / w))
    lift = a.CL0 + a.CL_alpha * (alpha_rad - beyond) + a.CL_elevator * elevator
    return lift, a.CD0 + a.CD_lift * lift**2 + a.CD_separated * sin(beyond)


@pytest.mark.parametrize("elevator", [0.0, 0.4])
@pytest.mark.parametrize("alpha_rad", LEVELS)
def test_lift_and_drag_are_those_of_the_equations(alpha_rad: float, elevator: float) -> None:
    lift, _, drag, _ = lift_drag(PLANE, alpha_rad, elevator)
    assert (lift, drag) == pytest.approx(coefficients(alpha_rad, elevator))


@pytest.mark.parametrize("alpha_rad", LEVELS)
def test_their_slopes_are_what_they_change_by(alpha_rad: float) -> None:
    _, lift_slope, _, drag_slope = lift_drag(PLANE, alpha_rad, 0.4)
    low, high = (coefficients(alpha_rad + sign * SMALL, 0.4) for sign in (-1.0, 1.0))
    by_differences = [(b - a) / (2.0 * SMALL) for a, b in zip(low, high, strict=True)]
    assert (lift_slope, drag_slope) == pytest.approx(by_differences, rel=1e-5, abs=1e-6)


def test_far_below_the_stall_lift_is_straight_and_far_beyond_it_flat() -> None:
    attached, stalled = lift_drag(PLANE, -0.3, 0.0), lift_drag(PLANE, 0.6, 0.0)
    assert attached[0] == pytest.approx(PLANE.CL0 - 0.3 * PLANE.CL_alpha)
    assert attached[1] == pytest.approx(PLANE.CL_alpha)
    assert stalled[0] == pytest.approx(PLANE.CL0 + PLANE.CL_alpha * PLANE.stall_alpha_rad)
    assert stalled[1] == pytest.approx(0.0, abs=1e-6)


def test_an_incidence_of_any_size_overflows_nothing() -> None:
    """It is bounded where hardly any lift is left to lose: thirty widths beyond the stall."""
    at_bound = lift_drag(PLANE, PLANE.stall_alpha_rad + 30.0 * PLANE.stall_width_rad, 0.0)
    assert at_bound[1] == pytest.approx(0.0, abs=1e-9)
    farther = lift_drag(PLANE, 1e4, 0.0)
    assert all(isfinite(number) for number in farther)
    assert farther[2] - PLANE.CD_lift * farther[0] ** 2 == pytest.approx(
        PLANE.CD0 + PLANE.CD_separated * sin(30.0 * PLANE.stall_width_rad)
    )


@pytest.mark.parametrize("elevator", [-0.3, 0.2])
@pytest.mark.parametrize("rate_radps", [0.0, 0.8, -0.5])
def test_at_the_trimmed_incidence_nothing_pitches_it(elevator: float, rate_radps: float) -> None:
    speed_mps = 9.0
    alpha = trim_alpha(PLANE, elevator, rate_radps, speed_mps)
    moment = PLANE.Cm0 + PLANE.Cm_alpha * alpha + PLANE.Cm_elevator * elevator
    moment += PLANE.Cm_q * PLANE.chord_m * rate_radps / (2.0 * speed_mps)
    assert moment == pytest.approx(0.0, abs=1e-12)


def test_a_brake_shifts_lift_drag_moment_and_polar_by_its_deflection() -> None:
    half = braked(PLANE, 0.5)
    added = (half.CL0 - PLANE.CL0, half.CD0 - PLANE.CD0, half.Cm0 - PLANE.Cm0)
    assert added == pytest.approx((-0.15, 0.03, 0.02))
    others = {"CL0", "CD0", "Cm0", "polar"}
    assert all(
        getattr(half, name) == getattr(PLANE, name) for name in PLANE._fields if name not in others
    )
    assert half.polar._replace(c3=PLANE.polar.c3) == PLANE.polar
    assert braked(PLANE, 0.0) is PLANE


@pytest.mark.parametrize("speed_mps", [7.0, 12.0])
@pytest.mark.parametrize("brake", [0.25, 1.0])
def test_a_brake_sinks_it_by_the_power_that_its_drag_takes(speed_mps: float, brake: float) -> None:
    """Drag times speed, by the weight."""
    drag_n = 0.5 * 1.2 * speed_mps**2 * 0.18 * PLANE.CD_brake * brake
    more = polar_sink(braked(PLANE, brake).polar, speed_mps) - polar_sink(PLANE.polar, speed_mps)
    weight_n = PLANE.mass_kg * PLANE.gravity_mps2
    assert more == pytest.approx(drag_n * speed_mps / weight_n)
    assert brake_sink(PLANE) * brake * speed_mps**3 == pytest.approx(more)


@pytest.mark.parametrize("speed_mps", [6.5, 9.0, 13.0])
def test_a_glide_s_pitch_is_that_at_which_lift_carries_the_weight(speed_mps: float) -> None:
    """Lift across the path is the weight's part there, with the elevator that trims: found by
    trying, on a lift curve without its stall."""
    sink = polar_sink(PLANE.polar, speed_mps)
    slope = atan2(sink, speed_mps)
    airspeed = hypot(speed_mps, sink)
    unstalled = PLANE._replace(stall_alpha_rad=9.0)

    def surplus_n(alpha: float) -> float:
        elevator = -(PLANE.Cm0 + PLANE.Cm_alpha * alpha) / PLANE.Cm_elevator
        lift = lift_drag(unstalled, alpha, elevator)[0] * 0.5 * 1.2 * airspeed**2 * 0.18
        return lift - PLANE.mass_kg * PLANE.gravity_mps2 * cos(slope)

    alpha = brentq(surplus_n, -0.5, 0.8, xtol=1e-13)
    assert glide_pitch(PLANE, speed_mps) == pytest.approx(alpha - slope)
    assert glide_alpha(PLANE, speed_mps) == pytest.approx(alpha)


def test_the_stall_s_speed_is_that_of_level_flight_with_the_most_lift_trimmed() -> None:
    speed_mps, alpha = stall_speed(PLANE), PLANE.stall_alpha_rad
    elevator = -(PLANE.Cm0 + PLANE.Cm_alpha * alpha) / PLANE.Cm_elevator
    attached = PLANE._replace(stall_alpha_rad=9.0)
    lift = lift_drag(attached, alpha, elevator)[0] * 0.5 * 1.2 * speed_mps**2 * 0.18
    assert lift == pytest.approx(PLANE.mass_kg * PLANE.gravity_mps2)
    assert isnan(stall_speed(NO_AERODYNAMICS))
    assert isnan(stall_speed(PLANE._replace(CL0=-9.0)))  # it never carries itself


def test_outside_its_polar_no_glide_is_known() -> None:
    for speed_mps in (5.9, 14.1, nan):
        assert isnan(glide_pitch(PLANE, speed_mps))
        assert isnan(glide_alpha(PLANE, speed_mps))
    for speed_mps in (6.1, 13.9):
        assert not isnan(glide_pitch(PLANE, speed_mps))


# --- how much elevator there is to be given -------------------------------------------------------

LARGEST = 0.24  # rad: beyond it the wing is stalled
BEYOND = 0.14  # 8 degrees, by which the file may err, and to turn a nose around


@pytest.mark.parametrize("trim", [-0.3, 0.0])
def test_the_elevator_has_room_until_its_moment_holds_more_than_the_stall(trim: float) -> None:
    held = trim + elevator_room(PLANE, LARGEST, trim)
    assert trim_alpha(PLANE, held, 0.0, 9.0) == pytest.approx(LARGEST + BEYOND)


def best_glide_alpha(plane: Aerodynamics) -> float:
    """Where the lift to drag is largest, sought on the lift curve below the stall."""
    slope = plane.CL_alpha

    def ratio(alpha: float) -> float:
        lift = plane.CL0 + slope * alpha
        return lift / (plane.CD0 + plane.CD_lift * lift * lift)

    return max((0.0001 * k for k in range(-1000, 5000)), key=ratio)


def test_a_trim_that_the_files_moments_do_not_explain_keeps_the_room_from_the_glide_on() -> None:
    """A linkage that stands off by a third: the glide takes that, and slow flight as much more."""
    trim = 0.35
    room = elevator_room(PLANE, LARGEST, trim)
    needed = brentq(
        lambda more: trim_alpha(PLANE, more, 0.0, 9.0) - trim_alpha(PLANE, 0.0, 0.0, 9.0)
        - (LARGEST + BEYOND - best_glide_alpha(PLANE)), -5.0, 5.0,
    )  # fmt: skip
    assert room == pytest.approx(needed, abs=1e-3)


def test_there_is_room_for_the_stall_whatever_drag_the_file_has() -> None:
    draggy = PLANE._replace(CD0=2.0)  # whose best glide would be far beyond the stall
    assert elevator_room(draggy, LARGEST, 5.0) == pytest.approx(BEYOND * 0.7 / 0.6)


@pytest.mark.parametrize(
    "unknown",
    [
        {"Cm_alpha": 0.0},
        {"Cm_alpha": nan},
        {"Cm_elevator": 0.0},
        {"Cm_elevator": nan},
        {"CL_alpha": 0.0},
        {"CD_lift": 0.0},
        {"CD0": -0.1},
        {"CD0": nan},
    ],
)
def test_nothing_is_kept_from_an_aircraft_that_nobody_knows(unknown: dict[str, Any]) -> None:
    assert elevator_room(PLANE._replace(**unknown), LARGEST, 0.0) == inf


@pytest.mark.parametrize("rate_radps", [0.2, 1.0])
def test_a_nose_that_turns_needs_what_its_damping_takes(rate_radps: float) -> None:
    more = elevator_of_rate(PLANE, 9.0) * rate_radps
    assert more > 0.0
    assert trim_alpha(PLANE, 0.1 + more, rate_radps, 9.0) == pytest.approx(
        trim_alpha(PLANE, 0.1, 0.0, 9.0)
    )


@pytest.mark.parametrize(
    ("plane", "airspeed_mps"),
    [
        (PLANE, 0.0),
        (PLANE, nan),
        (PLANE._replace(Cm_elevator=0.0), 9.0),
        (PLANE._replace(Cm_q=nan), 9.0),
        (PLANE._replace(Cm_q=1.0), 9.0),
    ],
)
def test_what_is_not_known_of_turning_adds_nothing(
    plane: Aerodynamics, airspeed_mps: float
) -> None:
    assert elevator_of_rate(plane, airspeed_mps) == 0.0

"""Whether a pitot tube reads right, by what the wing carries."""

from __future__ import annotations

from math import cos, inf, isnan, nan, sin, sqrt
from typing import Final, NamedTuple

import pytest

from tgl_soar.config.files import airframe_file, load_airframe
from tgl_soar.estimation.aerodynamics import lift_drag
from tgl_soar.estimation.pitot_watch import (
    ACCEPTED_S,
    APART_RAD,
    LASTS_S,
    NO_PITOT_WATCH,
    PitotMeans,
    PitotWatch,
    off_rad,
    pitot_step,
)
from tgl_soar.types import NAN, NO_ATTITUDE, NO_FIX, AirspeedSample, AutopilotStatus, Inputs
from tgl_soar.types import VehicleState as Vehicle

AERO: Final = load_airframe(airframe_file("eclipson_c")).aerodynamics()
DT_S = 0.005
SLOWEST_MPS = AERO.polar.speed_min_mps


class Flies(NamedTuple):
    """A steady flight, by the coefficients of the file."""

    speed_mps: float
    elevator: float
    force_x_mps2: float
    force_z_mps2: float


def flight(alpha_rad: float, load: float = 1.0) -> Flies:
    """At an angle of attack, where the wing carries `load` of the weight along the body's z."""
    elevator = -(AERO.Cm0 + AERO.Cm_alpha * alpha_rad) / AERO.Cm_elevator
    cl, _, cd, _ = lift_drag(AERO, alpha_rad, elevator)
    normal = cl * cos(alpha_rad) + cd * sin(alpha_rad)
    axial = cl * sin(alpha_rad) - cd * cos(alpha_rad)
    weight = AERO.mass_kg * AERO.gravity_mps2
    speed2 = 2.0 * load * weight / (AERO.air_density_kgpm3 * AERO.wing_area_m2 * normal)
    force_z = -load * AERO.gravity_mps2
    return Flies(sqrt(speed2), elevator, -force_z * axial / normal, force_z)


USUAL: Final = flight(0.11)


def means(flies: Flies, factor: float = 1.0) -> PitotMeans:
    """What is averaged where the tube reads `factor` of the truth."""
    return PitotMeans(
        speed2=(factor * flies.speed_mps) ** 2,
        force_x_mps2=flies.force_x_mps2,
        force_z_mps2=flies.force_z_mps2,
        elevator=flies.elevator,
        pitch_rate_radps=0.0,
    )


def vehicle(now_s: float) -> Vehicle:
    return Vehicle._make((now_s, *([0.0] * (len(Vehicle._fields) - 1))))


def watched(
    flies: Flies,
    factor: float,
    seconds: float,
    state: PitotWatch = NO_PITOT_WATCH,
    late_s: float = 0.0,
    elevator: float | None = None,
) -> tuple[PitotWatch, float]:
    """The watch after so long, and since when the tube counts as lying; inf: it does not."""
    since_s = inf
    for i in range(round(seconds / DT_S)):
        now = i * DT_S
        inputs = Inputs(
            time_s=now,
            position=NO_FIX,
            attitude=NO_ATTITUDE,
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=True,
            airspeed=AirspeedSample(i + 1, now - late_s, factor * flies.speed_mps),
        )
        state = pitot_step(
            AERO,
            0.0,
            state,
            vehicle(now),
            inputs,
            force_mps2=(flies.force_x_mps2, flies.force_z_mps2),
            elevator=flies.elevator if elevator is None else elevator,
            dt_s=DT_S,
        )
        if state.lies:
            since_s = min(since_s, now)
    return state, since_s


@pytest.mark.parametrize("alpha_rad", [0.02, 0.06, 0.11, 0.16])
@pytest.mark.parametrize("load", [0.7, 1.0, 1.5])
def test_an_honest_tube_is_not_off(alpha_rad: float, load: float) -> None:
    # The wing's force along z has a part of the drag in it, C_D sin α, which the watch leaves out.
    assert abs(off_rad(AERO, means(flight(alpha_rad, load)))) < 0.1 * APART_RAD


@pytest.mark.parametrize("factor", [0.88, 1.25])
def test_a_tube_that_errs_by_less_than_files_do_is_accepted(factor: float) -> None:
    _, since_s = watched(USUAL, factor, 10.0)
    assert since_s == inf


@pytest.mark.parametrize("factor", [0.0, 0.4, 0.8, 1.5, 3.0])
def test_a_tube_that_the_wing_contradicts_is_not(factor: float) -> None:
    _, since_s = watched(USUAL, factor, 3.0)
    assert LASTS_S - 2.0 * DT_S <= since_s < 2.0 * LASTS_S  # the first sample is the first mean


@pytest.mark.parametrize("factor", [0.0, 9.0, 16.0, 1e6])
def test_one_sample_says_nothing(factor: float) -> None:
    """At ten samples a second it stands for a tenth: a raindrop, or a frame that is broken."""
    state, since_s = watched(USUAL, 1.0, 2.0)
    for reads, seconds in ((factor, 0.1), (1.0, 3.0)):
        state, since_s = watched(USUAL, reads, seconds, state)
        assert since_s == inf
        assert not state.lies


def test_a_tube_that_reads_far_too_fast_is_found_out() -> None:
    state, _ = watched(USUAL, 1.0, 2.0)
    assert watched(USUAL, 9.0, 3.0, state)[0].lies


def test_slower_air_is_distinguished_from_ice() -> None:
    # As slow as it glides at all, the tube is right, and so are lift, trim and force.
    slow = flight(AERO.stall_alpha_rad - AERO.stall_width_rad)
    assert slow.speed_mps < 1.05 * SLOWEST_MPS
    _, since_s = watched(slow, 1.0, 5.0)
    assert since_s == inf


def test_nothing_is_concluded_of_a_stalled_wing() -> None:
    # With all of the elevator up the trim is beyond the stall: the lift curve says nothing there.
    assert isnan(off_rad(AERO, means(USUAL._replace(elevator=1.0), 0.5)))


@pytest.mark.parametrize("elevator_error", [-0.08, 0.08])
def test_one_of_two_that_is_wrong_convicts_nobody(elevator_error: float) -> None:
    # A centre of gravity 4 % of the chord from where the file has it: trim 0.04 rad off and more.
    wrong = USUAL._replace(elevator=USUAL.elevator + elevator_error)
    shift = AERO.Cm_elevator * elevator_error / AERO.Cm_alpha
    assert abs(shift) > 0.035
    assert abs(off_rad(AERO, means(wrong, 0.9))) < APART_RAD
    assert abs(off_rad(AERO, means(wrong, 1.1))) < APART_RAD


def test_it_is_accepted_again_when_it_has_agreed_for_long() -> None:
    lying, _ = watched(USUAL, 0.5, 3.0)
    assert lying.lies
    thawed, _ = watched(USUAL, 1.0, ACCEPTED_S, lying)
    assert thawed.lies  # the means have had to come back first
    thawed, _ = watched(USUAL, 1.0, 3.0, thawed)
    assert not thawed.lies


def test_what_is_not_known_changes_nothing() -> None:
    assert watched(USUAL, 0.5, 3.0, elevator=nan) == (NO_PITOT_WATCH, inf)
    assert watched(USUAL._replace(force_z_mps2=NAN), 0.5, 3.0) == (NO_PITOT_WATCH, inf)
    assert watched(USUAL, 0.5, 3.0, late_s=1.0) == (NO_PITOT_WATCH, inf)
    assert isnan(off_rad(AERO, means(USUAL._replace(force_z_mps2=1.0))))

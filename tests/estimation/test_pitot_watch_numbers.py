"""The watch on the airspeed tube in numbers: what is averaged and for how long, how far the wing is
from it by the page's three angles, and each of its limits from both sides."""

from __future__ import annotations

from math import isnan, nan
from typing import Any

import pytest
from samples import STILL

from tgl_soar.estimation.pitot_watch import (
    NO_PITOT_WATCH,
    PitotMeans,
    PitotWatch,
    off_rad,
    pitot_step,
)
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_ATTITUDE,
    NO_FIX,
    AirspeedSample,
    AutopilotStatus,
    GlidePolar,
    Inputs,
)

AERO = NO_AERODYNAMICS._replace(
    mass_kg=0.8, wing_area_m2=0.2, gravity_mps2=10.0, air_density_kgpm3=1.2,
    CL0=0.3, CL_alpha=5.0, CL_elevator=0.4, stall_alpha_rad=0.25, stall_width_rad=0.01,
    CD0=0.04, CD_lift=0.05, CD_separated=1.0, chord_m=0.2, Cm0=0.05, Cm_alpha=-0.5, Cm_q=-10.0,
    Cm_elevator=0.3,
    polar=GlidePolar(c0=0.5, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=7.0, speed_max_mps=14.0),
)  # fmt: skip
# By the tail alone: a tenth of a radian, with the elevator in the middle.
ALPHA = 0.1
LIFT = 0.3 + 5.0 * ALPHA
DRAG = 0.04 + 0.05 * LIFT**2
SPEED2 = 2.0 * 0.8 * 10.0 / (1.2 * 0.2 * LIFT)  # of one weight
MEANS = PitotMeans(
    speed2=SPEED2, force_x_mps2=10.0 * (ALPHA - DRAG / LIFT), force_z_mps2=-10.0, elevator=0.0,
    pitch_rate_radps=0.0,
)  # fmt: skip


def with_lift_angle(off: float, means: PitotMeans = MEANS) -> PitotMeans:
    """The tube reads so that lift alone says an angle that much larger."""
    return means._replace(speed2=2.0 * 0.8 * 10.0 / (1.2 * 0.2 * (LIFT + 5.0 * off)))


# --- how far off --------------------------------------------------------------------------------


@pytest.mark.parametrize("off", [-0.08, -0.01, 0.0, 0.02, 0.09])
def test_it_is_off_by_what_lift_says_beyond_trim_and_force(off: float) -> None:
    assert off_rad(AERO, with_lift_angle(off)) == pytest.approx(off, abs=1e-6)


@pytest.mark.parametrize(
    ("force_off", "found"), [(0.03, (0.0, 0.02, -0.03)), (-0.03, (0.02, 0.05, 0.0))]
)
def test_it_is_off_from_the_nearer_of_the_two(
    force_off: float, found: tuple[float, float, float]
) -> None:
    """Between both it agrees: lift says 0.02, 0.05 and -0.03 more than the trim."""
    means = MEANS._replace(force_x_mps2=10.0 * (ALPHA + force_off - DRAG / LIFT))
    says = [off_rad(AERO, with_lift_angle(off, means)) for off in (0.02, 0.05, -0.03)]
    assert says == pytest.approx(list(found), abs=1e-6)


def test_the_elevator_and_a_nose_that_swings_trim_another_angle() -> None:
    """0.1 of it turn the angle by 0.06 rad, and lift by themselves; 0.2 rad/s by Cm_q q c / 2V."""
    means = MEANS._replace(elevator=0.1)
    alpha = (0.05 + 0.3 * 0.1) / 0.5
    lift = 0.3 + 5.0 * alpha + 0.4 * 0.1
    speed2 = 2.0 * 0.8 * 10.0 / (1.2 * 0.2 * lift)
    force_x = 10.0 * (alpha - (0.04 + 0.05 * lift**2) / lift)
    assert off_rad(AERO, means._replace(speed2=speed2, force_x_mps2=force_x)) == pytest.approx(
        0.0, abs=1e-6
    )
    turning = MEANS._replace(pitch_rate_radps=0.2, force_x_mps2=-100.0)  # force is the least
    damped = -10.0 * 0.2 * 0.2 / (2.0 * SPEED2**0.5) / 0.5
    for off in (0.0, 0.05):
        # At another speed the rate's part is another one.
        found = off_rad(AERO, with_lift_angle(off, turning))
        speed = with_lift_angle(off, turning).speed2 ** 0.5
        alpha = ALPHA + damped * SPEED2**0.5 / speed
        assert found == pytest.approx(max(0.0, ALPHA + off - alpha), abs=1e-6)


def test_a_rate_s_part_is_that_of_a_flight_even_where_the_tube_reads_nothing() -> None:
    """No slower than the polar begins: 7 m/s."""
    turning = MEANS._replace(pitch_rate_radps=0.2, force_x_mps2=-100.0, speed2=4.0)
    alpha = ALPHA - 10.0 * 0.2 * 0.2 / (2.0 * 7.0) / 0.5
    by_lift = (2.0 * 0.8 * 10.0 / (1.2 * 0.2 * 4.0) - 0.3) / 5.0
    assert off_rad(AERO, turning) == pytest.approx(by_lift - alpha, abs=1e-6)


def test_a_tube_that_reads_nothing_counts_as_one_of_a_metre_a_second() -> None:
    by_lift = (2.0 * 0.8 * 10.0 / (1.2 * 0.2) - 0.3) / 5.0
    for speed2 in (0.0, 0.5, 1.0):
        found = off_rad(AERO, MEANS._replace(speed2=speed2))
        assert found == pytest.approx(by_lift - ALPHA, abs=1e-6)


@pytest.mark.parametrize(
    ("carried", "known"), [(2.9, False), (3.1, True), (-10.0, False), (nan, False)]
)
def test_a_wing_that_carries_three_tenths_of_the_weight_says_something(
    carried: float, known: bool
) -> None:
    assert isnan(off_rad(AERO, MEANS._replace(force_z_mps2=-carried))) is not known


@pytest.mark.parametrize(("elevator", "known"), [(0.24, True), (0.26, False), (-0.5, False)])
def test_beyond_the_stall_and_without_lift_nothing_is_known(elevator: float, known: bool) -> None:
    """The stall is at 0.25 rad: 0.25 of the elevator.  Half of it down leaves no lift."""
    assert isnan(off_rad(AERO, MEANS._replace(elevator=elevator))) is not known


# --- what is averaged ---------------------------------------------------------------------------


def step(
    state: PitotWatch = NO_PITOT_WATCH,
    *,
    speed_mps: float = SPEED2**0.5,
    late_s: float = 0.0,
    sequence: int = 1,
    force: tuple[float, float] = (MEANS.force_x_mps2, -10.0),
    push: float = 0.0,
    elevator: float = 0.0,
    rate: float = 0.0,
    dt_s: float = 0.01,
    aero: Any = AERO,
) -> PitotWatch:
    now = 100.0
    inputs = Inputs(
        time_s=now,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
        engage=True,
        airspeed=AirspeedSample(sequence, now - late_s, speed_mps),
    )
    vehicle = STILL._replace(time_s=now, pitch_rate_radps=rate)
    return pitot_step(
        aero, push, state, vehicle, inputs, force_mps2=force, elevator=elevator, dt_s=dt_s
    )


def test_the_first_sample_is_the_mean() -> None:
    means = step(speed_mps=9.0, force=(1.5, -8.0), push=0.4, elevator=0.1, rate=0.2).means
    assert means == pytest.approx((81.0, 1.1, -8.0, 0.1, 0.2))


def test_each_is_averaged_over_a_second() -> None:
    before = MEANS._replace(
        speed2=80.0, force_x_mps2=1.0, force_z_mps2=-9.0, elevator=0.05, pitch_rate_radps=0.1
    )
    state = step()._replace(means=before)
    means = step(state, speed_mps=10.0, force=(2.0, -11.0), elevator=0.25, rate=-0.1).means
    assert means == pytest.approx((80.2, 1.01, -9.02, 0.052, 0.098))
    whole = step(state, speed_mps=10.0, force=(2.0, -11.0), elevator=0.25, rate=-0.1, dt_s=3.0)
    assert whole.means == pytest.approx((100.0, 2.0, -11.0, 0.25, -0.1))


@pytest.mark.parametrize(("speed2", "taken"), [(319.0, 319.0), (321.0, 320.0), (1e9, 320.0)])
def test_one_sample_counts_for_four_times_the_mean_at_most(speed2: float, taken: float) -> None:
    state = step()._replace(means=MEANS._replace(speed2=80.0))
    found = step(state, speed_mps=speed2**0.5).means.speed2
    assert found == pytest.approx(80.0 + 0.01 * (taken - 80.0))


def test_a_tube_that_read_nothing_may_read_again() -> None:
    """Four times the square of a metre a second."""
    state = step()._replace(means=MEANS._replace(speed2=0.0))
    assert step(state, speed_mps=9.0).means.speed2 == pytest.approx(0.01 * 4.0)


# --- what is concluded --------------------------------------------------------------------------


def off_by(off: float, **remembered: Any) -> PitotWatch:
    """After a step in which the means are off by so much, and stay there."""
    means = with_lift_angle(off)
    state = NO_PITOT_WATCH._replace(means=means, **remembered)
    return step(state, speed_mps=means.speed2**0.5)


@pytest.mark.parametrize(("off", "apart"), [(0.061, True), (0.059, False), (-0.061, True),
                                            (-0.059, False)])  # fmt: skip
def test_six_hundredths_of_a_radian_contradict_it(off: float, apart: bool) -> None:
    assert off_by(off, apart_s=0.2).apart_s == pytest.approx(0.21 if apart else 0.0)


@pytest.mark.parametrize(("off", "agrees"), [(0.029, True), (0.031, False), (-0.029, True),
                                             (-0.031, False)])  # fmt: skip
def test_half_of_it_is_agreement(off: float, agrees: bool) -> None:
    assert off_by(off, agrees_s=0.2).agrees_s == pytest.approx(0.21 if agrees else 0.0)


@pytest.mark.parametrize(("apart_s", "lies"), [(0.485, False), (0.495, True)])
def test_half_a_second_of_contradiction_is_a_lie(apart_s: float, lies: bool) -> None:
    assert off_by(0.08, apart_s=apart_s).lies is lies


@pytest.mark.parametrize(("agrees_s", "lies"), [(4.985, True), (4.995, False)])
def test_after_five_seconds_of_agreement_it_is_accepted_again(agrees_s: float, lies: bool) -> None:
    assert off_by(0.0, agrees_s=agrees_s, lies=True).lies is lies
    assert not off_by(0.0, agrees_s=agrees_s).lies


def test_where_nothing_is_known_neither_goes_on() -> None:
    state = NO_PITOT_WATCH._replace(means=MEANS, apart_s=0.3, agrees_s=2.0)
    unknown = step(state, force=(0.0, 100.0), dt_s=1.0)
    assert (unknown.apart_s, unknown.agrees_s, unknown.lies) == (0.0, 2.0, False)


@pytest.mark.parametrize(
    "changed",
    [
        {"sequence": 0}, {"late_s": 0.501}, {"late_s": -0.001}, {"speed_mps": nan},
        {"force": (nan, -10.0)}, {"force": (0.0, nan)}, {"push": nan}, {"elevator": nan},
        {"rate": nan}, {"dt_s": 0.0}, {"dt_s": -0.01}, {"aero": AERO._replace(Cm_alpha=0.0)},
        {"aero": AERO._replace(CL_alpha=0.0)}, {"aero": NO_AERODYNAMICS},
    ],
    ids=str,
)  # fmt: skip
def test_what_is_not_known_leaves_the_watch_as_it_was(changed: dict[str, Any]) -> None:
    state = NO_PITOT_WATCH._replace(means=MEANS, apart_s=0.3)
    assert step(state, **changed) == state
    assert step(state, late_s=0.499) != state
    assert step(state, late_s=0.0) != state

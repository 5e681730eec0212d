"""From setpoints to deflections: whose loops move which surface, what trims them, what they are
given of stops, and which gains they fly with."""

from __future__ import annotations

from math import inf, isnan, nan, pi
from typing import Any

import pytest
from samples import STILL, surfaces_sample

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.envelope import CUT_MODE, Limited, unlimited
from tgl_soar.control.heading import HeadingGains
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.pid import PidGains, PidState
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.surface_loops import (
    NO_TERMS,
    LoopsState,
    SurfaceGains,
    SurfaceTerms,
    bank_step,
    line_gains,
    loops_begun,
    scheduled_gains,
    surface_gains,
    surfaces_step,
)
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    NO_SURFACES,
    OURS,
    THEIRS,
    THEIRS_WITH_RUDDER,
    Setpoints,
    SurfaceCommand,
)

DT_S = 0.01
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
TRIM = SurfaceCommand(0.05, -0.03, 0.02, 0.0)


def gains(kp: float, kd: float = 0.0, ki: float = 0.0) -> PidGains:
    return PidGains(
        kp=kp,
        ki=ki,
        kd=kd,
        rate_filter_radps=100.0,
        integral_max=1.0,
        output_min=-1.0,
        output_max=1.0,
    )


GAINS = SurfaceGains(
    gains(2.0, ki=1.0), gains(1.5, ki=1.0), HeadingGains(gains(0.5), 0.0, 1.0, 1.0), 0.0
)


def laws(changed: dict[str, float], loops: int = OURS) -> Laws:
    """Surfaces that may go anywhere at once."""
    made = laws_from(ParameterSet().changed(changed), FRAME, loops=loops)
    wide = made.envelope._replace(deflection_max=1.0, rate_max_per_s=1e3, elevator_room=inf)
    return made._replace(envelope=wide, trim=TRIM)


def begun(**changed: Any) -> LoopsState:
    state = loops_begun(unlimited(SurfaceCommand(0.0, 0.0, 0.0)), STILL)
    return state._replace(**changed)


def flies(
    loops: int = OURS, state: LoopsState | None = None, flown: SurfaceGains = GAINS, **changed: Any
) -> tuple[LoopsState, SurfaceTerms]:
    """One step, with what is usual unless a test says otherwise."""
    usual: dict[str, Any] = {
        "vehicle": STILL,
        "setpoints": Setpoints(0.1, 0.2, 0.3),
        "brake": 0.0,
        "brake_max": 1.0,
        "braked": BrakeEffect(0.0, 0.0),
        "stall_rad": inf,
        "surfaces": NO_SURFACES,
        "flies": True,
        "dt_s": DT_S,
    }
    return surfaces_step(
        laws({}, loops), flown, begun() if state is None else state, **{**usual, **changed}
    )


def limited_by(**changed: Any) -> Limited:
    return flies(**changed)[0].limited


def test_a_mode_that_does_not_fly_moves_nothing_whatever_the_laws_want() -> None:
    limited = limited_by(flies=False, brake=0.4)
    assert limited.command == SurfaceCommand(0.0, 0.0, 0.0, 0.0)
    assert limited.cut == CUT_MODE


# --- ours ---------------------------------------------------------------------------------------


def test_each_surface_is_its_trim_and_its_gain_times_its_own_error() -> None:
    command = limited_by(brake=0.4).command
    # Each integral has one step of its error, too.
    assert command.elevator == pytest.approx(0.05 + 2.0 * 0.1, abs=0.0011)
    assert command.aileron == pytest.approx(-0.03 + 1.5 * 0.2, abs=0.0021)
    assert command.rudder == pytest.approx(0.02 + 0.5 * 0.3)
    assert command.brake == 0.4
    at = STILL._replace(pitch_rad=0.1, roll_rad=0.2, heading_rad=0.3)
    assert limited_by(vehicle=at).command == pytest.approx(TRIM)


def test_a_rate_damps_its_own_surface_alone() -> None:
    damped = SurfaceGains(
        gains(0.0, 0.1), gains(0.0, 0.2), GAINS.heading._replace(pid=gains(0.0, 0.3)), 0.0
    )
    for name, surface, kd in (
        ("pitch_rate_radps", "elevator", 0.1), ("roll_rate_radps", "aileron", 0.2),
        ("heading_rate_radps", "rudder", 0.3),
    ):  # fmt: skip
        vehicle = STILL._replace(**{name: 0.4})
        # Begun at that rate, the derivative makes no step of it.
        state = loops_begun(unlimited(SurfaceCommand(0.0, 0.0, 0.0)), vehicle)
        command = limited_by(state=state, vehicle=vehicle, flown=damped).command
        expected = TRIM._replace(**{surface: getattr(TRIM, surface) - 0.4 * kd})
        assert command == pytest.approx(expected)


def test_what_a_brake_does_to_the_trim_is_added_to_the_elevator() -> None:
    plain = limited_by().command
    braked = limited_by(braked=BrakeEffect(0.5, -0.07)).command
    assert braked == pytest.approx(plain._replace(elevator=plain.elevator - 0.07))


def test_the_brake_goes_no_further_than_it_may() -> None:
    limited = limited_by(brake=0.8, brake_max=0.3)
    assert limited.command.brake == pytest.approx(0.3)
    assert limited.brake_max == pytest.approx(0.3)


def test_near_the_stall_the_elevator_goes_no_further_up_than_its_trim() -> None:
    assert limited_by(stall_rad=0.0).command.elevator == pytest.approx(0.05)
    limited = limited_by(stall_rad=0.0, braked=BrakeEffect(0.0, 0.04))
    assert limited.command.elevator == pytest.approx(0.09)
    assert limited.elevator_blocked == 1


@pytest.mark.parametrize("blocked", [-1, 0, 1])
def test_a_surface_at_its_stop_winds_up_nothing_that_presses_against_it(blocked: int) -> None:
    state = begun()
    elevator = state._replace(limited=state.limited._replace(elevator_blocked=blocked))
    aileron = state._replace(limited=state.limited._replace(aileron_blocked=blocked))
    for stopped, name, rest in ((elevator, "pitch", "roll"), (aileron, "roll", "pitch")):
        after, _ = flies(state=stopped)
        assert (getattr(after, name).integral > 0.0) is (blocked != 1)
        assert getattr(after, rest).integral > 0.0


def test_the_setpoint_is_remembered_and_the_next_ones_rate_moves_the_elevator() -> None:
    follows = SurfaceGains(gains(0.0, 0.1), gains(0.0), GAINS.heading, 0.5)
    state, terms = flies(flown=follows)
    assert (state.pitch_setpoint_rad, terms.elevator.d) == (0.1, 0.0)
    _, terms = flies(flown=follows, state=state, setpoints=Setpoints(0.102, 0.0, 0.0))
    rate, blend = 0.5 * 0.002 / DT_S, 100.0 * DT_S / (1.0 + 100.0 * DT_S)
    assert terms.elevator.d == pytest.approx(0.1 * rate * blend)


def test_a_setpoint_that_is_no_number_leaves_the_surfaces_where_they_were() -> None:
    state = begun()
    last = SurfaceCommand(0.1, -0.1, 0.05, 0.2)
    limited = limited_by(
        state=state._replace(limited=unlimited(last)), setpoints=Setpoints(nan, 0.0, 0.0)
    )
    assert limited.command == last
    assert not limited.finite


def test_loops_begin_with_nothing_learnt_at_the_present_rates() -> None:
    vehicle = STILL._replace(pitch_rate_radps=0.1, roll_rate_radps=0.2, heading_rate_radps=0.3)
    limited = unlimited(TRIM)
    state = loops_begun(limited, vehicle)
    assert state[:3] == (PidState(0.0, -0.1), PidState(0.0, -0.2), PidState(0.0, -0.3))
    assert state.limited is limited
    assert isnan(state.pitch_setpoint_rad)


# --- a firmware's -------------------------------------------------------------------------------


@pytest.mark.parametrize("loops", [THEIRS, THEIRS_WITH_RUDDER])
def test_a_firmware_s_surfaces_are_not_known_and_our_loops_rest(loops: int) -> None:
    state, terms = flies(loops=loops, brake=0.5)
    command = state.limited.command
    assert isnan(command.elevator)
    assert isnan(command.aileron)
    assert command.brake == 0.0
    assert (state.pitch, state.roll) == (begun().pitch, begun().roll)
    assert isnan(state.pitch_setpoint_rad)
    assert terms[:2] == (NO_TERMS, NO_TERMS)
    assert all(isnan(each) for each in NO_TERMS[:5])
    assert NO_TERMS.saturated == 0
    if loops == THEIRS:
        assert isnan(command.rudder)
    else:
        assert command.rudder == pytest.approx(0.02 + 0.5 * 0.3)
    limited = state.limited
    assert (limited.aileron_blocked, limited.brake_blocked, limited.brake_max) == (0, 0, 1.0)
    assert (limited.finite, limited.cut) == (True, 0)


def test_a_rudder_of_ours_that_is_cut_is_reported() -> None:
    limited = limited_by(loops=THEIRS_WITH_RUDDER, setpoints=Setpoints(0.0, 0.0, nan))
    assert not limited.finite
    assert limited.cut != 0


@pytest.mark.parametrize(
    ("elevator", "blocked"),
    [(0.981, 1), (0.979, 0), (0.0, 0), (nan, 0), (-0.979, 0), (-0.981, -1), (1.0, 1), (-1.0, -1)],
)
def test_an_elevator_that_is_read_back_at_its_end_can_go_no_further(
    elevator: float, blocked: int
) -> None:
    for loops in (THEIRS, THEIRS_WITH_RUDDER):
        sample = surfaces_sample(1, 0.0, (elevator, 0.0, 0.0))
        assert limited_by(loops=loops, surfaces=sample).elevator_blocked == blocked
    # Ours is where we command it.
    assert limited_by(surfaces=surfaces_sample(1, 0.0, (1.0, 0.0, 0.0))).elevator_blocked == 0


# --- the gains ----------------------------------------------------------------------------------


PARAMETERS = {
    "ELE_P": 4.0, "ELE_I": 1.0, "ELE_D": 0.2, "ELE_P_IMU": 8.0, "ELE_I_IMU": 2.0, "ELE_D_IMU": 0.4,
    "ELE_DSP_IMU": 0.6, "RHO_P": 0.2, "RHO_D": 0.1, "RHO_P_IMU": 0.6, "RHO_D_IMU": 0.3,
}  # fmt: skip


@pytest.mark.parametrize("weight", [0.0, 0.25, 1.0])
def test_gains_go_from_those_without_accelerometers_to_those_with(weight: float) -> None:
    """Without a speed of the finding they are flown as they stand."""
    known = laws({**PARAMETERS, "RHO_SPEED": 0.0, "LAT_SPEED": 0.0})
    found = surface_gains(known, weight, 9.0, 0.0)
    assert found.pitch.kp == pytest.approx(4.0 + weight * 4.0)
    assert found.pitch.kd == pytest.approx(0.2 + weight * 0.2)
    assert found.setpoint_weight == pytest.approx(0.6 * weight)
    assert (found.roll, found.heading) == (known.roll, known.heading)
    line = line_gains(known, weight, 9.0, 0.0, 0.5 * pi + 0.2)
    assert line.pid.kp == pytest.approx(0.2 + weight * 0.4)
    assert line.pid.kd == pytest.approx(0.1 + weight * 0.2)
    shown = scheduled_gains(known, 9.0, line.pid, found)
    assert shown == (
        9.0, line.pid.kp, line.pid.ki, line.pid.kd, found.pitch.kp, found.pitch.ki, found.pitch.kd,
        found.roll.kp, found.roll.kd, found.heading.pid.kd,
    )  # fmt: skip


def test_old_attitudes_and_speed_take_gain_from_every_loop() -> None:
    known = laws(PARAMETERS)
    assert known.schedule.speed_mps > 1.0
    fresh = surface_gains(known, 1.0, 9.0, 0.0)
    for other in (surface_gains(known, 1.0, 9.0, 0.2), surface_gains(known, 1.0, 12.0, 0.0)):
        assert other.pitch.kp < 0.95 * fresh.pitch.kp
    eta = 0.5 * pi + 0.26
    line, old = (line_gains(known, 1.0, 9.0, age_s, eta).pid for age_s in (0.0, 0.2))
    assert old.kp < 0.95 * line.kp
    known = known._replace(
        lateral_schedule=known.lateral_schedule._replace(
            speed_mps=9.0, late_found_s=0.05, late_s=0.05
        )
    )
    fresh = surface_gains(known, 1.0, 9.0, 0.0)
    for other in (surface_gains(known, 1.0, 9.0, 0.2), surface_gains(known, 1.0, 12.0, 0.0)):
        assert other.roll.kp < 0.95 * fresh.roll.kp
        assert other.heading.pid.kp < 0.95 * fresh.heading.pid.kp


def test_a_bank_is_by_the_course_s_sideways_speed_less_the_aircraft_s() -> None:
    level = gains(0.0, 0.1)
    known = laws({"RHO_SPEED": 0.0})._replace(
        sideways=level, heading=HeadingGains(gains(0.5), -8.0, 2.0, 1.0)
    )
    known = known._replace(
        lateral_schedule=known.lateral_schedule._replace(
            speed_mps=0.0, late_found_s=0.1, late_s=0.1
        )
    )
    vehicle = STILL._replace(x_m=2.0, velocity_y_mps=0.3)
    _, terms = bank_step(known, PidState(0.0, 0.0), vehicle, 0.5, 9.0, 0.0, 0, DT_S)
    # g kv R is 9.8 m/s at 10 m from the waypoint: the airspeed is less.
    error = 9.0 * 0.479425539 - 0.3
    blend = 100.0 * DT_S / (1.0 + 100.0 * DT_S)
    assert terms.d == pytest.approx(0.1 * error * blend, rel=1e-6)
    near = vehicle._replace(x_m=-6.0)
    _, terms = bank_step(known, PidState(0.0, 0.0), near, 0.5, 9.0, 0.0, 0, DT_S)
    error = 9.80665 * 0.1 * 2.0 * 0.479425539 - 0.3
    assert terms.d == pytest.approx(0.1 * error * blend, rel=1e-6)

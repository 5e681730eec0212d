"""Airspeed held by pitch: its loop on a point mass, what it may ask for, and a stall found out."""

from __future__ import annotations

from math import exp, isnan, nan, radians, sin

import pytest
from samples import STILL

from tgl_soar.control.airspeed_error import NO_AIRSPEED_ERROR
from tgl_soar.control.airspeed_hold import (
    NO_GLIDE,
    STALL_RAD,
    GlidePitches,
    GlideState,
    glide_pitch_held,
    hold_step,
    incidence_step,
    speed_pitch,
    speed_setpoint,
    stall_step,
)
from tgl_soar.types import GRAVITY_MPS2, NO_AIR

DT = 0.005
V_MPS = 8.5
ALPHA_RAD = 0.12  # of the shipped aircraft at that airspeed
GLIDE_RAD = -0.05
UNKNOWN_RAD = -0.07  # where the airframe's is not known
PITCHES = GlidePitches(
    wanted_rad=GLIDE_RAD, slowest_rad=-0.02, fastest_rad=-0.25, most_alpha_rad=nan
)
NO_PITCHES = GlidePitches(nan, nan, nan, nan)
GLIDING = NO_GLIDE._replace(speed_mps=V_MPS)
SINK_MPS = 1.0  # of the slowest glide


def held(state: GlideState, airspeed_mps: float, dt_s: float = DT, **changes: bool) -> GlideState:
    """One tick with the setpoint as it is."""
    flares = changes.get("flares", False)
    return hold_step(state, state.speed_mps, state.speed_mps, flares, airspeed_mps, dt_s)


def pitch_of(state: GlideState, airspeed_mps: float, *, measured: bool = True) -> float:
    return speed_pitch(state, PITCHES, UNKNOWN_RAD, airspeed_mps, measured)


def test_before_a_glide_nothing_is_asked_for_learnt_or_amiss() -> None:
    assert isnan(NO_GLIDE.speed_mps)
    assert isnan(NO_GLIDE.sink_mps)
    assert isnan(NO_GLIDE.trim_alpha_rad)
    nothing = (
        *(NO_GLIDE.integral_rad, NO_GLIDE.weave_rad, NO_GLIDE.stalling_s, NO_GLIDE.recovers_s),
        *(NO_GLIDE.flares, NO_GLIDE.stalled, NO_GLIDE.from_high),
    )
    assert not any(nothing)
    assert NO_GLIDE.goes_right
    assert NO_GLIDE.airspeed_error == NO_AIRSPEED_ERROR


# --- the loop -----------------------------------------------------------------------------------


def flown(seconds: float, *, slow_mps: float, wrong_rad: float, learns: bool) -> list[float]:
    """Airspeed less its setpoint, of a point mass that follows its pitch [m/s].

    Faster by v at the same pitch it has less incidence, 2 alpha v / V, and so climbs by as much:
    v' = -g (pitch's error + 2 alpha v / V).
    """
    state, error, found = GLIDING, -slow_mps, []
    for _ in range(round(seconds / DT)):
        state = held(state, V_MPS + error)
        if not learns:
            state = state._replace(integral_rad=0.0)
        path = pitch_of(state, V_MPS + error) - GLIDE_RAD + wrong_rad
        error -= GRAVITY_MPS2 * (path + 2.0 * ALPHA_RAD * error / V_MPS) * DT
        found.append(error)
    return found


def test_an_airspeed_that_is_off_is_back_in_a_second_and_a_half() -> None:
    """By the time constant; held pitch alone would take 3.6 s."""
    errors = flown(5.0, slow_mps=1.0, wrong_rad=0.0, learns=False)
    back_s = next(i for i, error in enumerate(errors) if abs(error) < exp(-1.0)) * DT
    assert back_s == pytest.approx(1.5, abs=0.25)
    assert all(error <= 0.0 for error in errors)


def test_a_glide_s_pitch_that_is_wrong_is_made_good_in_some_seconds_without_ringing() -> None:
    """Two degrees would cost half a metre per second for ever.

    What the pitch is wrong by, w, makes -g w t exp(-t / T), where the loop is damped by 1, with
    T = (g KI)^-1/2: no less than 2 s, as KP leaves that, and no more than the 4 s that it may take.
    """
    wrong_rad = radians(2.0)
    plain = flown(15.0, slow_mps=0.0, wrong_rad=wrong_rad, learns=False)
    made_good = flown(15.0, slow_mps=0.0, wrong_rad=wrong_rad, learns=True)
    most = max(abs(error) for error in made_good)
    assert abs(plain[-1]) > 0.4
    assert most < 0.8 * abs(plain[-1])
    at_its_worst_s = made_good.index(min(made_good)) * DT
    assert 2.0 < at_its_worst_s < 4.0
    assert abs(made_good[-1]) < 0.1 * abs(plain[-1])
    assert max(made_good) < 0.01 * most  # damped: it swings back by next to nothing


def test_too_fast_raises_the_nose_by_what_the_law_says() -> None:
    """theta_glide + 0.05 rad for each m/s + what was integrated."""
    learnt = GLIDING._replace(integral_rad=0.013)
    assert pitch_of(learnt, V_MPS) == pytest.approx(GLIDE_RAD + 0.013)
    assert pitch_of(learnt, V_MPS + 0.5) == pytest.approx(GLIDE_RAD + 0.013 + 0.025)
    assert pitch_of(learnt, V_MPS - 0.5) == pytest.approx(GLIDE_RAD + 0.013 - 0.025)
    assert pitch_of(learnt, nan) == pytest.approx(GLIDE_RAD + 0.013)  # what is not known is not off


def test_what_is_learnt_grows_by_the_error_and_the_time() -> None:
    one = held(GLIDING, V_MPS + 1.0, dt_s=0.1).integral_rad
    assert one > 0.0
    assert held(GLIDING, V_MPS + 1.0, dt_s=0.2).integral_rad == pytest.approx(2.0 * one)
    assert held(GLIDING, V_MPS - 3.0, dt_s=0.1).integral_rad == pytest.approx(-3.0 * one)
    on = held(GLIDING._replace(integral_rad=0.02), V_MPS + 1.0, dt_s=0.1).integral_rad
    assert on == pytest.approx(0.02 + one)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_more_than_six_degrees_are_learnt(sign: float) -> None:
    """0.1 rad: more than an airframe's numbers are wrong by."""
    state = GLIDING
    for _ in range(round(60.0 / DT)):
        state = held(state, V_MPS + 5.0 * sign)
    assert state.integral_rad == pytest.approx(0.1 * sign)


@pytest.mark.parametrize(
    ("state", "airspeed_mps", "flares"),
    [
        (GLIDING, nan, False),
        (GLIDING, V_MPS + 1.0, True),
        (GLIDING._replace(recovers_s=0.1), V_MPS + 1.0, False),
    ],
)
def test_nothing_is_learnt_unknown_in_a_flare_or_out_of_a_stall(
    state: GlideState, airspeed_mps: float, flares: bool
) -> None:
    state = state._replace(integral_rad=0.02)
    after = held(state, airspeed_mps, flares=flares)
    assert after.integral_rad == 0.02
    assert after.flares == flares
    assert held(state._replace(recovers_s=0.0), V_MPS + 1.0).integral_rad > 0.02


# --- its setpoint -------------------------------------------------------------------------------


@pytest.mark.parametrize(("wanted_mps", "sign"), [(20.0, 1.0), (2.0, -1.0)])
def test_the_setpoint_changes_as_fast_as_nine_degrees_of_path_make_it(
    wanted_mps: float, sign: float
) -> None:
    moved = hold_step(GLIDING, V_MPS, wanted_mps, False, V_MPS, 0.2).speed_mps - V_MPS
    assert moved / 0.2 == pytest.approx(sign * GRAVITY_MPS2 * sin(radians(9.0)), rel=0.03)


def test_the_setpoint_stops_at_what_is_wanted() -> None:
    assert hold_step(GLIDING, V_MPS, V_MPS + 0.01, False, V_MPS, 0.2).speed_mps == V_MPS + 0.01
    assert hold_step(GLIDING, V_MPS, V_MPS - 0.01, False, V_MPS, 0.2).speed_mps == pytest.approx(
        V_MPS - 0.01
    )


@pytest.mark.parametrize(
    ("airspeed_mps", "low_high", "begins_mps"),
    [
        (8.0, (7.0, 11.0), 8.0),
        (5.0, (7.0, 11.0), 7.0),
        (13.0, (7.0, 11.0), 11.0),
        (nan, (7.0, 11.0), 9.0),  # what is wanted
        (8.0, (7.0, 7.0), 9.0),  # there is no range
        (8.0, (7.0, nan), 9.0),
    ],
)
def test_a_glide_begins_with_the_airspeed_that_it_has_within_the_range(
    airspeed_mps: float, low_high: tuple[float, float], begins_mps: float
) -> None:
    assert speed_setpoint(NO_GLIDE, airspeed_mps, *low_high, 9.0) == begins_mps


def test_a_glide_goes_on_from_its_own_setpoint() -> None:
    assert speed_setpoint(GLIDING, 5.0, 9.0, 11.0, 10.0) == V_MPS


# --- how far the nose comes up ------------------------------------------------------------------


def test_an_airspeed_that_is_not_measured_raises_no_nose_above_the_slowest_glide_s() -> None:
    """Unknown drag looks like speed; to slow down for it is how a stall begins."""
    fast_mps = V_MPS + 3.0
    assert pitch_of(GLIDING, fast_mps) == pytest.approx(GLIDE_RAD + 0.15)
    assert pitch_of(GLIDING, fast_mps, measured=False) == PITCHES.slowest_rad
    assert pitch_of(GLIDING, V_MPS - 1.0, measured=False) == pytest.approx(GLIDE_RAD - 0.05)
    unknown = speed_pitch(GLIDING, NO_PITCHES, UNKNOWN_RAD, fast_mps, False)
    assert unknown == pytest.approx(UNKNOWN_RAD + 0.15)


def test_the_elevator_takes_the_nose_down_by_what_it_holds_beyond_the_slowest_approach() -> None:
    pitches = PITCHES._replace(most_alpha_rad=0.15)
    plain = speed_pitch(GLIDING, pitches, UNKNOWN_RAD, V_MPS, False)
    for held_rad, lower_rad in ((0.14, 0.0), (0.15, 0.0), (0.18, 0.03), (0.25, 0.1), (nan, 0.0)):
        state = GLIDING._replace(trim_alpha_rad=held_rad)
        found = speed_pitch(state, pitches, UNKNOWN_RAD, V_MPS, False)
        assert found == pytest.approx(plain - lower_rad)
        # Of a measured airspeed, or an airframe whose incidence nobody knows, nothing is taken.
        assert speed_pitch(state, pitches, UNKNOWN_RAD, V_MPS, True) == GLIDE_RAD
        assert pitch_of(state, V_MPS, measured=False) == plain
        # Nor is it put up out of a stall.
        stalled = state._replace(recovers_s=1.0)
        assert speed_pitch(stalled, pitches, UNKNOWN_RAD, V_MPS, False) == PITCHES.fastest_rad


def test_what_the_elevator_holds_is_averaged_over_half_a_second() -> None:
    """From the estimate's on, so that one deflection in a gust is not taken for all of it."""
    air = NO_AIR._replace(alpha_rad=0.10, trim_alpha_rad=0.20)
    state = GLIDING
    for _ in range(round(0.5 / DT)):
        state = incidence_step(state, air, DT)
    assert state.trim_alpha_rad == pytest.approx(0.20 - 0.10 * exp(-1.0))
    unknown = incidence_step(state, NO_AIR, DT)
    assert isnan(unknown.trim_alpha_rad)
    again = incidence_step(unknown, air, DT)
    assert again.trim_alpha_rad == pytest.approx(0.10 + 0.10 * (1.0 - exp(-DT / 0.5)))


def test_where_the_airframe_is_not_known_another_pitch_is_held() -> None:
    state = GLIDING._replace(integral_rad=0.01)
    assert glide_pitch_held(state, NO_PITCHES, UNKNOWN_RAD) == pytest.approx(UNKNOWN_RAD + 0.01)
    assert glide_pitch_held(state, PITCHES, UNKNOWN_RAD) == pytest.approx(GLIDE_RAD + 0.01)


def test_out_of_a_stall_the_nose_is_at_the_fastest_glide_s_or_below() -> None:
    stalled = GLIDING._replace(recovers_s=0.01)
    assert pitch_of(stalled, V_MPS) == PITCHES.fastest_rad
    slow_mps = V_MPS - 6.0
    assert pitch_of(stalled, slow_mps) == pytest.approx(GLIDE_RAD - 0.3)
    assert speed_pitch(stalled, NO_PITCHES, UNKNOWN_RAD, V_MPS + 1.0, True) == UNKNOWN_RAD


# --- a stall ------------------------------------------------------------------------------------


def looked(
    state: GlideState,
    sink_mps: float,
    seconds: float = DT,
    *,
    glide_sink_mps: float = SINK_MPS,
    position_ok: bool = True,
    nose_held: bool = True,
) -> GlideState:
    vehicle = STILL._replace(climb_mps=-sink_mps)
    for _ in range(round(seconds / DT)):
        state = stall_step(state, glide_sink_mps, position_ok, nose_held, vehicle, DT)
    return state


def test_the_sink_is_averaged_over_three_seconds_from_the_first_on() -> None:
    """An eddy of some metres is over in a second."""
    state = looked(GLIDING, 0.0, nose_held=False)
    assert state.sink_mps == 0.0
    assert looked(state, 2.0, nose_held=False).sink_mps == pytest.approx(2.0 * DT / 3.0, rel=0.01)
    state = looked(state, 2.0, 3.0, nose_held=False)
    assert state.sink_mps == pytest.approx(2.0 * (1.0 - exp(-1.0)), rel=1e-6)
    assert looked(GLIDING, 1.7).sink_mps == 1.7


@pytest.mark.parametrize(("seconds", "stalls"), [(0.48, False), (0.52, True)])
def test_a_nose_held_down_while_it_falls_is_a_stall_after_half_a_second(
    seconds: float, stalls: bool
) -> None:
    state = looked(GLIDING, 3.0, seconds)
    assert state.stalled == stalls
    assert (state.recovers_s > 0.0) == stalls
    if not stalls:
        assert state.stalling_s == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("sink_mps", "falls"), [(SINK_MPS + 0.45, False), (SINK_MPS + 0.55, True), (nan, True)]
)
def test_who_sinks_by_half_a_metre_per_second_more_than_any_glide_falls(
    sink_mps: float, falls: bool
) -> None:
    assert looked(GLIDING, sink_mps, 1.0).stalled == falls


def test_the_nose_alone_tells_where_no_sink_is_known() -> None:
    assert looked(GLIDING, 0.0, 1.0, position_ok=False).stalled
    assert looked(GLIDING, 0.0, 1.0, glide_sink_mps=nan).stalled
    assert not looked(GLIDING, 9.0, 1.0, nose_held=False).stalled
    assert not looked(GLIDING, 9.0, 1.0, position_ok=False, nose_held=False).stalled


def test_a_flare_is_no_stall() -> None:
    assert not looked(GLIDING._replace(flares=True), 3.0, 2.0).stalled


def test_gusts_that_take_the_elevator_to_its_end_now_and_then_are_no_stall() -> None:
    """What looks like one counts, what does not counts back, and never below nothing."""
    state = GLIDING
    for _ in range(10):
        state = looked(looked(state, 3.0, 0.3), 3.0, 0.3, nose_held=False)
        assert state.stalling_s == pytest.approx(0.0, abs=1e-9)
    assert not state.stalled
    assert looked(looked(state, 3.0, 0.3), 3.0, 0.1, nose_held=False).stalling_s == pytest.approx(
        0.2
    )


def test_out_of_a_stall_the_nose_stays_down_for_a_second_and_a_half() -> None:
    """From 6 m/s at 1.5 m/s² and more it flies again, at 7.6 m/s, by then or little later."""
    state = looked(GLIDING, 3.0, 0.51)
    assert state.stalled
    assert state.stalling_s == pytest.approx(0.0, abs=DT + 1e-9)
    began_s = state.recovers_s
    assert began_s == pytest.approx(1.5, abs=0.02)
    down = looked(state, 3.0, 1.4)
    assert down.recovers_s == pytest.approx(began_s - 1.4)
    assert down.stalling_s == 0.0  # meanwhile no other one begins
    up = looked(down, 3.0, 0.2, nose_held=False)
    assert up.recovers_s == 0.0
    assert up.stalled  # on this glide it has
    again = looked(up, 3.0, 0.52)
    assert again.recovers_s > 1.4


def test_a_nose_that_is_two_degrees_below_its_setpoint_is_held() -> None:
    """Twice the degree by which a loop that follows is off."""
    assert radians(1.9) < STALL_RAD < radians(2.1)

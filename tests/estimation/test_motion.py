"""The estimator on flights that are known, with samples as bad as they come."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from math import cos, dist, inf, isnan, nan, pi, radians, remainder, sin
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from samples import attitude_sample, position_fix
from scipy.spatial.transform import Rotation

from tgl_soar.estimation.attitude_track import PREDICT_MAX_S
from tgl_soar.estimation.motion import motion_quality, motion_step
from tgl_soar.estimation.motion_state import (
    FUTURE_S,
    OUTLIERS_ACCEPTED,
    MotionGains,
    MotionState,
    initial_motion,
)
from tgl_soar.geometry import (
    SoaringFrame,
    ned_from_soaring,
    ned_vector_from_soaring,
    quaternion_from_euler,
)
from tgl_soar.types import AttitudeSample, AutopilotStatus, Inputs, PositionFix, VehicleState

FRAME = SoaringFrame(3.0, -4.0, 5.0, radians(240.0))
GAINS = MotionGains(
    fix_sd_m=0.003,
    velocity_sd_mps=0.05,
    force_sd_mps2=0.2,
    bias_sd_mps2=0.15,
    unknown_sd_mps2=3.0,
    fix_delay_s=0.0,
    fix_gate_m=0.5,
    reset_max_m=0.0,
    use_imu=True,
)
DT = 0.005
NO_FIX = PositionFix(
    sequence=0,
    time_s=nan,
    north_m=nan,
    east_m=nan,
    down_m=nan,
    velocity_north_mps=nan,
    velocity_east_mps=nan,
    velocity_down_mps=nan,
)
NO_SAMPLE = AttitudeSample(
    sequence=0,
    time_s=nan,
    qw=nan,
    qx=nan,
    qy=nan,
    qz=nan,
    roll_rate_frd_radps=nan,
    pitch_rate_frd_radps=nan,
    yaw_rate_frd_radps=nan,
)
SILENT = AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False)
LEVEL = (1.0, 0.0, 0.0, 0.0)

Vector = tuple[float, float, float]
Path = Callable[[float], Vector]


def tick(now: float, fix: PositionFix = NO_FIX, sample: AttitudeSample = NO_SAMPLE) -> Inputs:
    return Inputs(time_s=now, position=fix, attitude=sample, autopilot=SILENT, engage=False)


def fix_at(
    sequence: int, stamp: float, where: Vector, velocity: Vector = (nan, nan, nan)
) -> PositionFix:
    """A fix of a position and a velocity in the soaring frame."""
    ned = ned_from_soaring(FRAME, *where)
    return position_fix(sequence, stamp, ned, ned_vector_from_soaring(FRAME, *velocity))


def position(v: VehicleState) -> Vector:
    return v.x_m, v.y_m, v.z_m


def velocity(v: VehicleState) -> Vector:
    return v.velocity_x_mps, v.velocity_y_mps, v.climb_mps


def flight(
    path: Path,
    speed: Path | None,
    gains: MotionGains = GAINS,
    every: int = 5,
    delay: int = 0,
    reported: bool = True,
    ticks: int = 800,
) -> Iterator[tuple[float, VehicleState]]:
    """(time, estimate) of a flight: a fix every `every` ticks, arriving `delay` ticks late, with
    the time when it was true, or (not reported) with that of its arrival."""
    state, fix = initial_motion(), NO_FIX
    for k in range(ticks):
        if (k - delay) % every == 0 and k >= delay:
            true = (k - delay) * DT
            stamp = true if reported else k * DT
            fix = fix_at(k + 1, stamp, path(true), speed(true) if speed else (nan, nan, nan))
        state, vehicle = motion_step(gains, FRAME, state, tick(k * DT, fix))
        yield k * DT, vehicle


STRAIGHT: Vector = (0.4, -0.2, 0.3)


def straight(t: float) -> Vector:
    return 1.0 + 0.4 * t, 2.0 - 0.2 * t, 3.0 + 0.3 * t


def straight_speed(_: float) -> Vector:
    return STRAIGHT


# --- fixes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 8, 30])
@pytest.mark.parametrize("speed", [straight_speed, None])
def test_a_straight_flight_is_tracked_without_bias(delay: int, speed: Path | None) -> None:
    # Constant velocity is the estimator's own model, so nothing is left once it has settled: 2 s
    # are 50 time constants.  Before the first fix there is nothing to say.
    for t, vehicle in flight(straight, speed, delay=delay):
        if t < delay * DT:
            assert isnan(vehicle.x_m)
        elif speed is not None or t > 2.0:
            assert dist(position(vehicle), straight(t)) < 1e-9
            assert dist(velocity(vehicle), STRAIGHT) < 1e-8


@pytest.mark.parametrize("speed", [straight_speed, None])
def test_a_delay_that_no_stamp_tells_is_taken_off(speed: Path | None) -> None:
    # 16 ticks late and stamped at arrival: uncorrected it is behind by v · 80 ms for good.
    corrected = GAINS._replace(fix_delay_s=16 * DT)
    *_, (t, blind) = flight(straight, speed, delay=16, reported=False)
    *_, (t, seeing) = flight(straight, speed, corrected, delay=16, reported=False)
    lag = dist(STRAIGHT, (0.0, 0.0, 0.0)) * 0.08
    assert dist(position(blind), straight(t)) == pytest.approx(lag, rel=1e-6)
    assert dist(position(seeing), straight(t)) < 1e-9


def test_an_oscillation_along_the_line_is_followed() -> None:
    # 10 cm at 0.5 Hz, fixes at 40 Hz, 40 ms late.  With exact velocities the error is the
    # acceleration 1 m/s² over the age of the velocity, 65 ms, and 1 or 2 fixes' more, halved.
    w = 2.0 * pi * 0.5

    def path(t: float) -> Vector:
        return 0.1 * sin(w * t), 0.0, 1.0

    def speed(t: float) -> Vector:
        return 0.1 * w * cos(w * t), 0.0, 0.0

    worst = max(dist(position(v), path(t)) for t, v in flight(path, speed, delay=8) if t > 1.0)
    age = 0.065 + 0.025
    assert worst < 0.5 * 0.1 * w * w * age * age


LAST = 10.0 + 39 * DT
NOW = 10.0 + 40 * DT
LAST_FIX = fix_at(40, LAST, straight(LAST), STRAIGHT)
LAST_SAMPLE = attitude_sample(40, LAST, LEVEL)


def settled() -> MotionState:
    """A state in mid flight, after the tick at LAST; what came last stays in the inputs."""
    state = initial_motion()
    for k in range(1, 41):
        t = 10.0 + (k - 1) * DT
        fix, sample = (
            fix_at(k, t, straight(t), STRAIGHT),
            LAST_SAMPLE._replace(sequence=k, time_s=t),
        )
        state, _ = motion_step(GAINS, FRAME, state, tick(t, fix, sample))
    return state


def mid(now: float, fix: PositionFix = LAST_FIX, sample: AttitudeSample = LAST_SAMPLE) -> Inputs:
    return tick(now, fix, sample)


def without_count(state: MotionState) -> str:
    """In words: NaN, nothing is known, is not equal to itself."""
    return repr(
        state._replace(
            rejected=0,
            fix=state.fix._replace(sequence=0),
            attitude=state.attitude._replace(sequence=0),
        )
    )


def test_the_same_sample_twice_is_no_news() -> None:
    state = settled()
    fix = fix_at(99, NOW, straight(NOW), STRAIGHT)
    sample = attitude_sample(99, NOW, LEVEL, (0.1, 0.2, 0.3))
    once, _ = motion_step(GAINS, FRAME, state, mid(NOW, fix, sample))
    twice, _ = motion_step(GAINS, FRAME, once, mid(NOW + DT, fix, sample))
    assert repr(twice) == repr(once)


@pytest.mark.parametrize(
    "bad",
    [
        {"north_m": nan},
        {"east_m": inf},
        {"down_m": -inf},
        {"time_s": nan},
        {"time_s": inf},
        {"time_s": -inf},
        {"time_s": LAST},  # the time of the last one: a duplicate with a new number
        {"time_s": LAST - DT},  # out of order
        {"time_s": NOW + FUTURE_S + 1e-6},
    ],
)
def test_a_bad_fix_is_refused_and_counted(bad: dict[str, Any]) -> None:
    state = settled()
    fix = fix_at(99, NOW, (500.0, 500.0, 500.0), STRAIGHT)._replace(**bad)
    after, vehicle = motion_step(GAINS, FRAME, state, mid(NOW, fix))
    assert after.rejected == state.rejected + 1
    assert without_count(after) == without_count(state)
    assert dist(position(vehicle), straight(NOW)) < 1e-9
    # Once: it is not counted again in the next tick.
    again, _ = motion_step(GAINS, FRAME, after, mid(NOW + DT, fix))
    assert repr(again) == repr(after)


@pytest.mark.parametrize("sigma", [1e3, 1e160, inf])
def test_a_fix_that_is_uncertain_beyond_measure_is_refused(sigma: float) -> None:
    """Its square is no number any more: accepted once, it would be the end of the estimate."""
    state = settled()
    fix = fix_at(99, NOW, straight(NOW), STRAIGHT)._replace(sigma_m=sigma)
    after, _ = motion_step(GAINS, FRAME, state, mid(NOW, fix))
    assert after.rejected == state.rejected + 1
    assert without_count(after) == without_count(state)
    taken, _ = motion_step(GAINS, FRAME, state, mid(NOW, fix._replace(sigma_m=999.0)))
    assert taken.fix.time_s == NOW


@pytest.mark.parametrize("speed", [26.0, 500.0, 1e200])
def test_a_place_that_is_accepted_does_not_vouch_for_its_velocity(speed: float) -> None:
    state = settled()
    for k in range(OUTLIERS_ACCEPTED):
        t = NOW + 0.02 * k
        fix = off(fix_at(99 + k, t, (1.0, 2.0, 3.0), (speed, 0.0, 0.0)), 6.0)
        state, vehicle = motion_step(GAINS, FRAME, state, mid(t, fix))
    assert position(vehicle) == pytest.approx((1.0, 2.0, -3.0))
    assert velocity(vehicle) == pytest.approx((0.0, 0.0, 0.0))
    assert motion_quality(GAINS, state, state, t).velocity_sigma_mps == pytest.approx(2.0)


def test_before_the_first_fix_nothing_is_reported_as_certain() -> None:
    state = initial_motion()
    for inputs in (tick(1.0), tick(1.005, NO_FIX, LAST_SAMPLE)):
        before = state
        state, _ = motion_step(GAINS, FRAME, state, inputs)
        quality = motion_quality(GAINS, before, state, inputs.time_s)
        sigmas = (quality.position_sigma_m, quality.velocity_sigma_mps, quality.bias_sigma_mps2)
        assert all(isnan(sigma) for sigma in sigmas)


def test_a_fix_from_a_little_ahead_is_taken() -> None:
    # The mapping of clocks is not exact.
    state = settled()
    ahead = NOW + 0.9 * FUTURE_S
    after, vehicle = motion_step(
        GAINS, FRAME, state, mid(NOW, fix_at(99, ahead, straight(ahead), STRAIGHT))
    )
    assert after.rejected == state.rejected
    assert dist(position(vehicle), straight(NOW)) < 1e-9


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("bad", [nan, inf])
def test_half_a_velocity_is_none(place: int, bad: float) -> None:
    state = settled()
    numbers = [100.0, 100.0, 100.0]
    numbers[place] = bad
    fix = position_fix(
        99, NOW, ned_from_soaring(FRAME, *straight(NOW)), (numbers[0], numbers[1], numbers[2])
    )
    after, vehicle = motion_step(GAINS, FRAME, state, mid(NOW, fix))
    assert after.rejected == state.rejected
    assert after.fix.time_s == NOW
    assert dist(velocity(vehicle), STRAIGHT) < 1e-6


@pytest.mark.parametrize("velocity_known", [True, False])
def test_after_a_long_gap_the_fix_is_accepted(velocity_known: bool) -> None:
    # Accelerations are not measured: after a second the place is known to 0.8 m.
    state = settled()
    later = LAST + 1.0
    speed = (0.1, 0.0, 0.0) if velocity_known else (nan, nan, nan)
    fix = fix_at(99, later, (7.0, 8.0, 9.0), speed)
    after, vehicle = motion_step(GAINS, FRAME, state, mid(later, fix))
    assert position(vehicle) == pytest.approx((7.0, 8.0, 9.0))
    expected = (0.1, 0.0, 0.0) if velocity_known else (0.0, 0.0, 0.0)
    assert velocity(vehicle) == pytest.approx(expected)
    assert motion_quality(GAINS, state, after, later).jumped


def test_in_a_gap_it_goes_on_as_it_was() -> None:
    state = settled()
    for k in range(100):
        t = NOW + k * DT
        state, vehicle = motion_step(GAINS, FRAME, state, mid(t))
        assert dist(position(vehicle), straight(t)) < 1e-9


def test_a_clock_that_goes_back_resets_it() -> None:
    """What is known is of the future: new samples would be refused as late for all of the jump."""
    state = settled()
    fix = fix_at(99, 3.0, (7.0, 8.0, 9.0), (0.1, 0.0, 0.0))
    sample = attitude_sample(99, 3.0, quaternion_from_euler(0.1, 0.2, 0.3), (nan, nan, nan))
    after, vehicle = motion_step(GAINS, FRAME, state, mid(3.0, fix, sample))
    assert after.rejected == state.rejected
    assert position(vehicle) == pytest.approx((7.0, 8.0, 9.0))
    assert velocity(vehicle) == pytest.approx((0.1, 0.0, 0.0))
    assert (vehicle.roll_rad, vehicle.pitch_rad) == pytest.approx((0.1, 0.2))
    assert vehicle.pitch_rate_radps == 0.0


def test_one_sample_lost_in_five_costs_nothing_on_a_straight_flight() -> None:
    state, fix = initial_motion(), NO_FIX
    for k in range(400):
        if k % 5 != 3:
            fix = fix_at(k + 1, k * DT, straight(k * DT), STRAIGHT)
        state, vehicle = motion_step(GAINS, FRAME, state, tick(k * DT, fix))
        assert dist(position(vehicle), straight(k * DT)) < 1e-9
    assert state.rejected == 0


# --- attitude -------------------------------------------------------------------------------


@given(
    roll=st.floats(-3.0, 3.0),
    pitch=st.floats(-1.5, 1.5),
    yaw=st.floats(-3.1, 3.1),
    length=st.floats(0.91, 1.09),
)
def test_attitude_is_scipys(roll: float, pitch: float, yaw: float, length: float) -> None:
    x, y, z, w = (float(v) for v in Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat())
    numbers = (length * w, length * x, length * y, length * z)
    sample = attitude_sample(1, 0.0, numbers)
    _, vehicle = motion_step(GAINS, FRAME, initial_motion(), tick(0.0, NO_FIX, sample))
    assert vehicle.pitch_rad == pytest.approx(pitch, abs=1e-6)
    assert remainder(vehicle.roll_rad - roll, 2 * pi) == pytest.approx(0.0, abs=1e-6)
    heading = yaw - FRAME.wind_from_rad
    assert remainder(vehicle.heading_rad - heading, 2 * pi) == pytest.approx(0.0, abs=1e-6)


def test_heading_is_nought_where_the_wind_comes_from() -> None:
    q = quaternion_from_euler(0.0, 0.0, FRAME.wind_from_rad)
    sample = attitude_sample(1, 0.0, q)
    _, vehicle = motion_step(GAINS, FRAME, initial_motion(), tick(0.0, NO_FIX, sample))
    assert vehicle.heading_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "bad",
    [
        {"qw": nan},
        {"qx": inf},
        {"qw": 0.0},  # all zero
        {"qw": 0.89},
        {"qw": 1.11},
        {"time_s": nan},
        {"time_s": inf},
        {"time_s": LAST},
        {"time_s": LAST - DT},
        {"time_s": NOW + FUTURE_S + 1e-6},
    ],
)
def test_a_bad_attitude_is_refused_and_counted(bad: dict[str, Any]) -> None:
    state = settled()
    sample = attitude_sample(99, NOW, LEVEL, (9.0, 9.0, 9.0))._replace(**bad)
    after, vehicle = motion_step(GAINS, FRAME, state, mid(NOW, LAST_FIX, sample))
    assert after.rejected == state.rejected + 1
    assert without_count(after) == without_count(state)
    assert vehicle.roll_rate_radps == 0.0
    again, _ = motion_step(GAINS, FRAME, after, mid(NOW + DT, LAST_FIX, sample))
    assert repr(again) == repr(after)


def turning(t: float) -> Vector:
    """Roll, pitch, yaw of a gentle turn, yaw through ±180 degrees of the soaring frame."""
    return 0.3 + 0.2 * t, 0.1 - 0.3 * t, FRAME.wind_from_rad + pi - 0.1 + 0.5 * t


@pytest.mark.parametrize("gyros", [True, False])
def test_rates_are_those_of_the_angles_with_and_without_gyros(gyros: bool) -> None:
    state = initial_motion()
    for k in range(100):
        t = k * DT
        roll, pitch, yaw = turning(t)
        p = q = r = nan
        if gyros:  # body rates of these Euler rates, from a finite rotation
            before, after = (
                Rotation.from_euler("ZYX", turning(t + s)[::-1]) for s in (-1e-5, 1e-5)
            )
            p, q, r = (float(v) for v in (before.inv() * after).as_rotvec() / 2e-5)
        sample = attitude_sample(k + 1, t, quaternion_from_euler(roll, pitch, yaw), (p, q, r))
        state, vehicle = motion_step(GAINS, FRAME, state, mid(t, LAST_FIX, sample))
        if k > 0 or gyros:
            rates = (vehicle.roll_rate_radps, vehicle.pitch_rate_radps, vehicle.heading_rate_radps)
            assert rates == pytest.approx((0.2, -0.3, 0.5), abs=1e-6)
        else:
            assert vehicle.roll_rate_radps == 0.0  # unknown from one sample


def test_differences_over_a_gap_are_no_rates() -> None:
    state = settled()
    later = LAST + PREDICT_MAX_S + 0.01
    q = quaternion_from_euler(0.5, 0.0, 0.0)
    sample = attitude_sample(99, later, q, (nan, nan, nan))
    _, vehicle = motion_step(GAINS, FRAME, state, mid(later, LAST_FIX, sample))
    assert vehicle.roll_rate_radps == 0.0


@pytest.mark.parametrize("apart_s", [1e-6, 1e-4])
def test_samples_microseconds_apart_make_no_rate(apart_s: float) -> None:
    """Each sample comes twice, over two links, their angles 0.1 degrees apart: over a microsecond
    that would be 1745 rad/s.  The rate is that from one pair to the next, 20 ms on."""
    state, jitter = initial_motion(), radians(0.1)
    for k in range(40):
        pair, second = divmod(k, 2)
        t = 0.02 * pair + second * apart_s
        roll, pitch, yaw = turning(t)
        q = quaternion_from_euler(roll + second * jitter, pitch - second * jitter, yaw)
        sample = attitude_sample(k + 1, t, q, (nan, nan, nan))
        state, v = motion_step(GAINS, FRAME, state, mid(t, LAST_FIX, sample))
        if pair > 0:
            rates = (v.roll_rate_radps, v.pitch_rate_radps, v.heading_rate_radps)
            assert rates == pytest.approx((0.2, -0.3, 0.5), abs=1e-6)


def test_attitude_is_carried_on_with_its_rates_but_not_for_long() -> None:
    q = quaternion_from_euler(0.0, 0.0, FRAME.wind_from_rad)  # level: Euler rates are the gyros'
    sample = attitude_sample(1, 7.0, q, (0.3, 0.4, -0.5))
    state, _ = motion_step(GAINS, FRAME, initial_motion(), tick(7.0, NO_FIX, sample))
    for age, carried in ((0.0, 0.0), (0.02, 0.02), (PREDICT_MAX_S, PREDICT_MAX_S), (5.0, 0.1)):
        _, v = motion_step(GAINS, FRAME, state, tick(7.0 + age, NO_FIX, sample))
        angles = (v.roll_rad, v.pitch_rad, v.heading_rad)
        assert angles == pytest.approx((0.3 * carried, 0.4 * carried, -0.5 * carried), abs=1e-9)
        rates = (v.roll_rate_radps, v.pitch_rate_radps, v.heading_rate_radps)
        assert rates == pytest.approx((0.3, 0.4, -0.5))


@pytest.mark.parametrize("place", [0, 1, 2])
def test_half_a_gyro_is_none(place: int) -> None:
    # Nothing turns: by the angles' differences all rates are zero, whatever two gyros report.
    state = settled()
    numbers = [9.0, 9.0, 9.0]
    numbers[place] = nan
    sample = attitude_sample(99, NOW, LEVEL, numbers)
    after, v = motion_step(GAINS, FRAME, state, mid(NOW, LAST_FIX, sample))
    assert after.rejected == state.rejected
    assert (v.roll_rate_radps, v.pitch_rate_radps, v.heading_rate_radps) == (0.0, 0.0, 0.0)


# --- the site -------------------------------------------------------------------------------


@given(
    turn=st.floats(-6.0, 6.0),
    origin=st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50)),
    wobble=st.floats(-0.5, 0.5),
)
def test_a_site_turned_and_moved_gives_the_same_state(
    turn: float, origin: Vector, wobble: float
) -> None:
    """The whole world, wind and all, turned about the vertical and moved: the laws see nothing."""

    def fly(frame: SoaringFrame) -> VehicleState:
        state = initial_motion()
        for k in range(12):
            t = k * DT
            ned = ned_from_soaring(frame, 1.0 + 0.4 * t, wobble * t, 2.0 - 0.3 * t)
            speed = ned_vector_from_soaring(frame, 0.4, wobble, -0.3)
            yaw = frame.wind_from_rad + 0.2 + wobble * t
            q = quaternion_from_euler(0.1 + wobble * t, -0.2, yaw)
            sample = attitude_sample(k + 1, t, q, (0.1, wobble, -0.2))
            fix = position_fix(k + 1, t, ned, speed)
            state, vehicle = motion_step(GAINS, frame, state, tick(t, fix, sample))
        return vehicle

    here = fly(SoaringFrame(0.0, 0.0, 0.0, 0.0))
    there = fly(SoaringFrame(*origin, turn))
    assert there == pytest.approx(here, abs=1e-9)


# --- outliers -------------------------------------------------------------------------------


def off(fix: PositionFix, metres: float) -> PositionFix:
    return fix._replace(down_m=fix.down_m + metres)


@pytest.mark.parametrize("metres", [1.0, 3.0, -50.0])
def test_one_fix_far_from_the_prediction_changes_nothing(metres: float) -> None:
    state = settled()
    fix = off(fix_at(99, NOW, straight(NOW), STRAIGHT), metres)
    after, vehicle = motion_step(GAINS, FRAME, state, mid(NOW, fix))
    assert after.rejected == state.rejected + 1
    assert dist(position(vehicle), straight(NOW)) < 1e-6
    later = NOW + 0.02
    good = fix_at(100, later, straight(later), STRAIGHT)
    again, vehicle = motion_step(GAINS, FRAME, after, mid(later, good))
    assert again.outliers.in_a_row == 0
    assert dist(position(vehicle), straight(later)) < 1e-6


def test_every_twentieth_fix_wrong_costs_nothing() -> None:
    rng = random.Random(5)
    state = settled()
    for k in range(200):
        t = NOW + 0.02 * k
        fix = fix_at(100 + k, t, straight(t), STRAIGHT)
        if k % 20 == 7:
            fix = off(fix, rng.uniform(0.8, 5.0))
        state, vehicle = motion_step(GAINS, FRAME, state, mid(t, fix))
        assert dist(position(vehicle), straight(t)) < 1e-6
    assert state.rejected == 10


def test_a_place_that_enough_fixes_agree_on_is_accepted() -> None:
    """The source has moved its origin: what it says is where the aircraft is, from now on."""
    state = settled()
    for k in range(OUTLIERS_ACCEPTED):
        t = NOW + 0.02 * k
        state, vehicle = motion_step(
            GAINS, FRAME, state, mid(t, off(fix_at(99 + k, t, straight(t), STRAIGHT), 4.0))
        )
    assert position(vehicle)[2] == pytest.approx(straight(t)[2] - 4.0, abs=1e-6)
    assert velocity(vehicle) == pytest.approx(STRAIGHT, abs=1e-9)
    assert state.outliers.in_a_row == 0


def test_one_outlier_that_comes_over_several_links_is_one() -> None:
    """The same message under new numbers does not agree with itself."""
    state = settled()
    for k in range(2 * OUTLIERS_ACCEPTED):
        fix = off(fix_at(99 + k, NOW, straight(NOW), STRAIGHT), 4.0)
        state, vehicle = motion_step(GAINS, FRAME, state, mid(NOW + k * DT, fix))
        assert dist(position(vehicle), straight(NOW + k * DT)) < 1e-6
    assert state.outliers.in_a_row == 1
    assert state.rejected == 2 * OUTLIERS_ACCEPTED


def test_outliers_that_do_not_agree_are_never_accepted() -> None:
    """Markers taken for others, here and there by turns."""
    state = settled()
    for k in range(20):
        t = NOW + 0.02 * k
        fix = off(fix_at(99 + k, t, straight(t), STRAIGHT), 4.0 if k % 2 else -4.0)
        state, vehicle = motion_step(GAINS, FRAME, state, mid(t, fix))
    assert dist(position(vehicle), straight(t)) < 1e-6
    assert state.rejected == 20


# --- attitudes that turn further than an aircraft does -----------------------------------------


class Turns:
    """A level aircraft at rest, and what the estimator makes of the attitudes reported of it."""

    def __init__(self) -> None:
        self.state = initial_motion()
        self.k = 0
        self.vehicle = self.tell(0.0)

    def tell(self, roll_deg: float, rate: float = 0.0, later_s: float = DT) -> VehicleState:
        self.k += 1
        now = self.state.attitude.refused.time_s if self.state.attitude.refused_in_a_row else nan
        last = self.state.attitude.time_s if isnan(now) else now
        stamp = later_s if isnan(last) else last + later_s
        q = quaternion_from_euler(radians(roll_deg), 0.0, FRAME.wind_from_rad)
        sample = attitude_sample(self.k, stamp, q, (rate, 0.0, 0.0))
        self.state, self.vehicle = motion_step(
            GAINS, FRAME, self.state, tick(stamp, NO_FIX, sample)
        )
        return self.vehicle


def test_one_attitude_turned_too_far_changes_nothing() -> None:
    turns = Turns()
    assert turns.tell(60.0).roll_rad == 0.0
    assert turns.state.rejected == 1
    assert turns.tell(1.0).roll_rad == pytest.approx(radians(1.0))
    assert turns.state.attitude.refused_in_a_row == 0


def test_attitudes_that_agree_are_accepted_the_fifth_time() -> None:
    turns = Turns()
    assert [turns.tell(60.0).roll_rad for _ in range(4)] == [0.0] * 4
    assert turns.tell(60.0).roll_rad == pytest.approx(radians(60.0))
    assert turns.vehicle.roll_rate_radps == 0.0  # nothing flew there
    assert turns.state.rejected == 4


def test_attitudes_that_contradict_each_other_are_never_accepted() -> None:
    turns = Turns()
    for _ in range(100):
        assert turns.tell(60.0).roll_rad == 0.0
        assert turns.tell(-60.0).roll_rad == 0.0
    assert turns.state.attitude.time_s == pytest.approx(DT)  # as old as the last accepted


def test_the_same_attitude_again_is_no_second_witness() -> None:
    turns = Turns()
    for _ in range(20):
        turns.tell(60.0, later_s=0.0 if turns.state.attitude.refused_in_a_row else DT)
    assert turns.vehicle.roll_rad == 0.0


@pytest.mark.parametrize(("gap_s", "roll_deg", "used"), [
    (DT, 36.0, True), (DT, 40.0, False),  # 36.7 and 2.0 degrees
    (0.1, 75.0, True), (0.1, 80.0, False),  # and 40.1
    (0.4, 180.0, True),  # after so long anything may be
])  # fmt: skip
def test_how_far_it_may_have_turned_grows_with_the_gap(
    gap_s: float, roll_deg: float, used: bool
) -> None:
    after = Turns().tell(roll_deg, later_s=gap_s).roll_rad
    assert abs(after) == pytest.approx(radians(roll_deg) if used else 0.0)


def test_a_rate_that_no_aircraft_has_a_tick_later_is_not_used_until_it_is_reported_again() -> None:
    turns = Turns()
    assert turns.tell(0.0, 1.7).roll_rate_radps == 1.7  # 1 and 150 times 5 ms
    turns = Turns()
    assert turns.tell(0.0, 1.8).roll_rate_radps == 0.0
    assert turns.tell(0.0, 1.8).roll_rate_radps == 1.8
    assert turns.tell(0.0, 0.0).roll_rate_radps == 0.0


@pytest.mark.parametrize("rate", [70.1, -1e3, 1e300, inf, -inf])
def test_a_rate_that_no_gyro_measures_is_none_however_often_it_is_reported(rate: float) -> None:
    turns = Turns()
    for _ in range(10):
        assert turns.tell(0.0, rate).roll_rate_radps == 0.0
    assert turns.state.rejected == 0  # its attitude is as good as any

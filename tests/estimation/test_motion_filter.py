"""The estimator against a filter that replays its history, and against its own word."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import pairwise
from math import cos, isfinite, nan, radians, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from samples import attitude_sample, imu_sample, position_fix
from scipy.stats import chi2

from tgl_soar.estimation.motion import (
    IMU_SILENT_S,
    IMU_STEADY_S,
    motion_quality,
    motion_step,
)
from tgl_soar.estimation.motion_state import (
    BIAS_S,
    OUTLIERS_ACCEPTED,
    MotionGains,
    MotionState,
    initial_motion,
)
from tgl_soar.estimation.position_fixes import OFFSET_M
from tgl_soar.geometry import (
    SoaringFrame,
    ned_from_soaring,
    ned_vector_from_soaring,
    quaternion_from_euler,
    soaring_from_ned,
)
from tgl_soar.types import (
    GRAVITY_MPS2,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    MotionQuality,
    PositionFix,
    VehicleState,
)

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
FIX_TICKS = 4
CV_DENSITY = 2.0 * 3.0 * 3.0 * 0.1  # what EST_CV_SD stands for
SILENT = AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False)
UPWIND = quaternion_from_euler(0.0, 0.0, FRAME.wind_from_rad)

Vector = tuple[float, float, float]
Floats = NDArray[np.float64]


def force(acceleration: Vector) -> Vector:
    """What accelerometers of a level aircraft that faces upwind feel, FRD."""
    ax, ay, az = acceleration
    return -ax, ay, -az - GRAVITY_MPS2


def level(k: int) -> AttitudeSample:
    return attitude_sample(k + 1, k * DT, UPWIND)


def accelerations(k: int, acceleration: Vector) -> ImuSample:
    return imu_sample(k + 1, k * DT, force(acceleration))


def fix_at(k: int, where: Vector, speed: Vector = (nan, nan, nan), source: int = 0) -> PositionFix:
    """A fix of tick k, soaring frame."""
    return position_fix(
        k + 1,
        k * DT,
        ned_from_soaring(FRAME, *where),
        ned_vector_from_soaring(FRAME, *speed),
        source,
    )


def tick(
    now: float, fix: PositionFix, imu: ImuSample = NO_IMU, sample: AttitudeSample = NO_ATTITUDE
) -> Inputs:
    return Inputs(
        time_s=now,
        position=fix,
        attitude=sample,
        autopilot=SILENT,
        engage=False,
        imu=imu,
        airspeed=NO_AIRSPEED,
        surfaces=NO_SURFACES,
    )


class Tick(NamedTuple):
    """One tick of a flight along the soaring frame's axes."""

    truth: Floats  # (2, 3): position, velocity
    vehicle: VehicleState
    state: MotionState
    quality: MotionQuality


class Noise(NamedTuple):
    """Standard deviations of the samples."""

    fix: float
    speed: float | None  # None: fixes have no velocity
    force: float
    bias: float


def flight(
    seed: int,
    noise: Noise,
    gains: MotionGains = GAINS,
    ticks: int = 400,
    delay: int = 8,
    imu: bool = True,
    silent: range = range(0),
    deaf: range = range(0),
    density: float = 0.0,
) -> Iterator[Tick]:
    """A flight with smooth accelerations, or white ones of a density [m²/s³].

    silent: ticks without fixes; deaf: without accelerations.  Where the estimator knows none,
    a deaf flight has white ones of EST_CV_SD, else none.
    """
    dice = random.Random(seed)
    phases = [dice.uniform(0.0, 6.28) for _ in range(3)]
    bias = [dice.gauss(0.0, noise.bias) for _ in range(3)]
    p = np.zeros(3)
    v = np.array([dice.gauss(0.0, 0.3) for _ in range(3)])
    a = np.zeros(3)
    history: list[tuple[Floats, Floats]] = []
    state, fix, last_imu, last_attitude = initial_motion(), NO_FIX, NO_IMU, NO_ATTITUDE
    for k in range(ticks):
        if k:
            was = a
            if deaf:
                density = CV_DENSITY if k in deaf or not state.inertial else 0.0
            if density:
                # White acceleration over a tick: velocity and position are a joint Gaussian.
                step = sqrt(density * DT)
                one = np.array([dice.gauss(0.0, step) for _ in range(3)])
                two = np.array([dice.gauss(0.0, step) for _ in range(3)])
                p = p + v * DT + DT * (0.5 * one + two / sqrt(12.0))
                v = v + one
            else:
                if not deaf:
                    a = np.array([2.0 * sin(3.0 * k * DT + f) for f in phases])
                p = p + v * DT + (2.0 * was + a) * DT * DT / 6.0
                v = v + 0.5 * (was + a) * DT
        history.append((p, v))
        if imu and k not in deaf:
            walk = noise.bias * sqrt(DT / BIAS_S)
            bias = [b + dice.gauss(0.0, walk) for b in bias]
            measured = [a[i] + bias[i] + dice.gauss(0.0, noise.force) for i in range(3)]
            last_imu, last_attitude = (
                accelerations(k, (measured[0], measured[1], measured[2])),
                level(k),
            )
        then = k - delay
        if then >= 0 and then % FIX_TICKS == 0 and k not in silent:
            at, speed = history[then]
            where = [at[i] + dice.gauss(0.0, noise.fix) for i in range(3)]
            reported = [nan] * 3
            if noise.speed is not None:
                reported = [speed[i] + dice.gauss(0.0, noise.speed) for i in range(3)]
            fix = fix_at(
                then, (where[0], where[1], where[2]), (reported[0], reported[1], reported[2])
            )
        before = state
        state, vehicle = motion_step(
            gains, FRAME, state, tick(k * DT, fix, last_imu, last_attitude)
        )
        quality = motion_quality(gains, before, state, k * DT)
        yield Tick(np.array([p, v]), vehicle, state, quality)


def error(now: Tick) -> Floats:
    """(2, 3): position and velocity, estimate less truth."""
    v = now.vehicle
    estimate = [[v.x_m, v.y_m, v.z_m], [v.velocity_x_mps, v.velocity_y_mps, v.climb_mps]]
    return np.array(estimate) - now.truth


# --- against a filter that replays --------------------------------------------------------------


def replayed(
    fixes: list[PositionFix], samples: list[ImuSample], now: float
) -> tuple[Floats, Floats]:
    """(mean (3, 3), covariance (3, 3)) of position, velocity, bias at a time: the textbook's way.

    From the first fix on, all that is known so far is taken in again in the order in which it
    was true, accelerations from sample to sample, each fix at its own time.
    """
    g = GAINS
    density, bias_density = g.force_sd_mps2**2 * DT, g.bias_sd_mps2**2 / BIAS_S

    def soaring(fix: PositionFix) -> Floats:
        return np.array(soaring_from_ned(FRAME, fix.north_m, fix.east_m, fix.down_m))

    def measured(sample: ImuSample) -> Floats:
        fx, fy, fz = sample[2:5]
        return np.array([-fx, fy, -fz - GRAVITY_MPS2])

    mean = np.zeros((3, 3))
    mean[0] = soaring(fixes[0])
    covariance = np.diag([g.fix_sd_m**2, 4.0, g.bias_sd_mps2**2])
    time = fixes[0].time_s
    pending = list(fixes[1:])
    times = [s.time_s for s in samples]
    for n in range(round((now - time) / DT)):
        here = round(time / DT)
        a, b = measured(samples[here]), measured(samples[here + 1])
        assert abs(times[here] - time) < 1e-9
        f = np.array([[1.0, DT, -DT * DT / 2.0], [0.0, 1.0, -DT], [0.0, 0.0, 1.0]])
        mean = f @ mean
        mean[0] += (2.0 * a + b) * DT * DT / 6.0
        mean[1] += (a + b) * DT / 2.0
        h = DT
        q = density * np.array([[h**3 / 3, h**2 / 2, 0.0], [h**2 / 2, h, 0.0], [0.0, 0.0, 0.0]])
        q += bias_density * np.array(
            [
                [h**5 / 20, h**4 / 8, -(h**3) / 6],
                [h**4 / 8, h**3 / 3, -(h**2) / 2],
                [-(h**3) / 6, -(h**2) / 2, h],
            ]
        )
        covariance = f @ covariance @ f.T + q
        time = fixes[0].time_s + (n + 1) * DT
        if pending and abs(pending[0].time_s - time) < 1e-9:
            gain = covariance[:, 0] / (covariance[0, 0] + g.fix_sd_m**2)
            mean = mean + np.outer(gain, soaring(pending.pop(0)) - mean[0])
            covariance = covariance - np.outer(gain, covariance[0])
    return mean, covariance


def test_it_is_the_filter_that_goes_back_and_takes_everything_in_again() -> None:
    """Fixes 40 ms late, in noise: the same numbers as the replay, to what a cubic between nodes
    smooths of the accelerometers' noise, 0.2 m/s² · 5 ms · 64 ms / 8 and its square root of 13."""
    dice = random.Random(3)
    state, fix = initial_motion(), NO_FIX
    fixes: list[PositionFix] = []
    samples: list[ImuSample] = []
    path = [(0.5 * cos(2.0 * k * DT), 0.1 * k * DT, 1.0) for k in range(240)]
    for k in range(240):
        t = k * DT
        measured = (-2.0 * cos(2.0 * t) + 0.1, -0.05, 0.2)
        noisy = (measured[0] + dice.gauss(0, 0.2), measured[1] + dice.gauss(0, 0.2), measured[2])
        samples.append(accelerations(k, noisy))
        if k >= 40 and k % FIX_TICKS == 0:
            x, y, z = path[k - 8]
            fix = fix_at(k - 8, (x + dice.gauss(0, 0.003), y + dice.gauss(0, 0.003), z))
            fixes.append(fix)
        state, v = motion_step(GAINS, FRAME, state, tick(t, fix, samples[-1], level(k)))
        if k in (40, 60, 133, 239):
            mean, covariance = replayed(fixes, samples, t)
            quality = motion_quality(GAINS, state, state, t)
            assert (v.x_m, v.y_m, v.z_m) == pytest.approx(mean[0], abs=3e-5)
            speed = (v.velocity_x_mps, v.velocity_y_mps, v.climb_mps)
            assert speed == pytest.approx(mean[1], abs=1e-3)
            bias = (quality.bias_x_mps2, quality.bias_y_mps2, quality.bias_z_mps2)
            assert bias == pytest.approx(mean[2], abs=1e-3)
            sigmas = (
                quality.position_sigma_m,
                quality.velocity_sigma_mps,
                quality.bias_sigma_mps2,
            )
            assert sigmas == pytest.approx(np.sqrt(np.diag(covariance)), rel=0.01)


# --- its own word ---------------------------------------------------------------------------


def within(values: list[float], freedom: int, chance: float = 1e-3) -> bool:
    """Whether a mean of sums of squares is that of chi-square; where it is, this often it fails."""
    tails = 0.5 * chance, 1.0 - 0.5 * chance
    low, high = (float(chi2.ppf(q, freedom * len(values))) for q in tails)
    return bool(low <= sum(values) <= high)


RUNS = 120  # a mean of so many is known to 7.5 %
GAPS = 30
CHECKS = 12  # three in each of four cases: one in a thousand for all of them together


@pytest.mark.parametrize("speed", [None, 0.05])
@pytest.mark.parametrize("imu", [True, False])
def test_innovations_and_errors_are_as_large_as_it_says(imu: bool, speed: float | None) -> None:
    """NIS of one fix and NEES of one instant of each flight: those of one flight are related.

    With accelerations: noise and bias as declared.  Without: white acceleration of the density
    that EST_CV_SD stands for.
    """
    noise = Noise(0.003, speed, 0.2, 0.15)
    density = 0.0 if imu else CV_DENSITY
    nis, position_nees, velocity_nees = [], [], []
    for seed in range(RUNS):
        *_, last = flight(seed, noise, ticks=201, imu=imu, density=density)
        quality, e = last.quality, error(last)
        assert quality.inertial == imu
        nis.append(quality.nis)
        position_nees.append(float(np.sum(e[0] ** 2)) / quality.position_sigma_m**2)
        velocity_nees.append(float(np.sum(e[1] ** 2)) / quality.velocity_sigma_mps**2)
    assert within(nis, 3, 1e-3 / CHECKS)
    assert within(position_nees, 3, 1e-3 / CHECKS)
    assert within(velocity_nees, 3, 1e-3 / CHECKS)


@pytest.mark.parametrize(
    ("deaf", "silent"),
    [
        (range(130, 150), range(120, 209)),  # back inside a gap of fixes
        (range(160, 180), range(0)),
        (range(150, 169), range(168, 186)),
    ],
)
def test_accelerations_that_come_and_go_are_counted_on_where_they_were(
    deaf: range, silent: range
) -> None:
    """The uncertainty of the time without them stays when they come back."""
    noise = Noise(0.003, None, 0.2, 0.15)
    nis, gap_nees, velocity_nees = [], [], []
    for seed in range(RUNS):
        flown = list(flight(seed, noise, ticks=212, silent=silent, deaf=deaf))
        before, after = flown[207], flown[208 + 2 * (len(silent) > 50)]
        assert before.quality.inertial
        gap_nees.append(float(np.sum(error(before)[0] ** 2)) / before.quality.position_sigma_m**2)
        velocity_nees.append(
            float(np.sum(error(before)[1] ** 2)) / before.quality.velocity_sigma_mps**2
        )
        nis.append(after.quality.nis)
    assert within(nis, 3)
    assert within(gap_nees, 3)
    assert within(velocity_nees, 3)


@pytest.mark.parametrize("hz", [22.0, 18.0, 16.0, 15.0, 12.0])
def test_slow_accelerations_are_counted_on_or_not_but_not_by_turns(hz: float) -> None:
    state, fix, sample = initial_motion(), NO_FIX, NO_IMU
    changes, counted, known = 0, -1, False
    for k in range(1000):
        t = k * DT
        where = (0.4 * sin(3.0 * t), 0.0, 1.0)
        if int(t * hz) != counted:
            counted = int(t * hz)
            sample = accelerations(k, (-3.6 * sin(3.0 * t), 0.0, 0.0))
        if k % FIX_TICKS == 0:
            fix = fix_at(k, where)
        state, v = motion_step(GAINS, FRAME, state, tick(t, fix, sample, level(k)))
        changes += state.inertial != known
        known = state.inertial
        if k > 200:
            quality = motion_quality(GAINS, state, state, t)
            assert abs(v.x_m - where[0]) < 3.0 * quality.position_sigma_m + 0.002
    assert changes <= 1


@pytest.mark.parametrize("delay", [90, 110, 130, 180])
def test_a_fix_of_a_time_that_the_track_has_forgotten_is_refused(delay: int) -> None:
    """0.45 s are remembered; fixes that are later are counted, and not used."""
    flown = list(flight(7, Noise(0.003, None, 0.2, 0.0), ticks=1200, delay=delay))
    for now in flown[delay + 60 :]:
        sigma = now.quality.position_sigma_m
        assert not sigma <= 0.1 or float(np.max(np.abs(error(now)[0]))) < 6.0 * sigma
    sigma, rejected = flown[-1].quality.position_sigma_m, flown[-1].state.rejected
    if delay == 90:
        assert sigma < 0.02
        assert rejected == 0
    else:
        assert not sigma <= 1.0
        assert rejected > 200


@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize("back", [13, 20, 30, 60])
def test_a_clock_that_goes_back_a_little_leaves_no_old_errors_behind(imu: bool, back: int) -> None:
    """Fixes 60 ms late, 5 m away from where the track began: lost until the next, and no jump."""
    state, fix, sample = initial_motion(), NO_FIX, NO_IMU
    where = (5.0, 0.0, 1.0)
    for k in range(600):
        now = k if k < 400 else k - back
        if k % FIX_TICKS == 0:
            fix = fix_at(now - 12, where)._replace(sequence=k + 1)
        if imu:
            sample = accelerations(now, (0.0, 0.0, 0.0))._replace(sequence=k + 1)
        attitude = level(now)._replace(sequence=k + 1)
        before = state
        state, v = motion_step(GAINS, FRAME, state, tick(now * DT, fix, sample, attitude))
        quality = motion_quality(GAINS, before, state, now * DT)
        assert not quality.jumped
        if k > 20:
            assert abs(v.x_m - 5.0) < 1e-6 or not isfinite(v.x_m)
    assert isfinite(v.x_m)
    assert quality.position_sigma_m < 0.03


def test_a_bias_is_found_and_its_uncertainty_shrinks() -> None:
    noise = Noise(0.001, None, 0.02, 0.0)
    gains = GAINS._replace(fix_sd_m=0.001, force_sd_mps2=0.02)
    flown = list(flight(1, noise, gains, ticks=2000))
    assert abs(flown[-1].quality.bias_x_mps2) < 4.0 * flown[-1].quality.bias_sigma_mps2
    assert flown[-1].quality.bias_sigma_mps2 < 0.25 * gains.bias_sd_mps2


def test_a_gap_is_flown_through_and_the_uncertainty_grows_with_the_error() -> None:
    """1.5 s without fixes: still known to centimetres, and no better than it says."""
    ratios, worst = [], 0.0
    for seed in range(GAPS):
        flown = list(flight(seed, Noise(0.003, None, 0.2, 0.15), ticks=701, silent=range(400, 700)))
        sigmas = [now.quality.position_sigma_m for now in flown[409:700]]
        assert all(b > a for a, b in pairwise(sigmas))
        e = error(flown[699])[0]
        worst = max(worst, float(np.max(np.abs(e))))
        ratios.append(float(np.sum(e**2)) / sigmas[-1] ** 2)
    assert worst < 0.25
    assert within(ratios, 3)


# --- what comes and goes ------------------------------------------------------------------------


def test_accelerations_that_fall_silent_are_done_without_and_come_back() -> None:
    state, fix, sample = initial_motion(), NO_FIX, NO_IMU
    inertial = []
    for k in range(600):
        t = k * DT
        where, speed = (0.3 * sin(t), 0.0, 1.0), (0.3 * cos(t), 0.0, 0.0)
        if not 200 <= k < 400:
            sample = accelerations(k, (-0.3 * sin(t), 0.0, 0.0))
        if k % FIX_TICKS == 0:
            fix = fix_at(k, where, speed)
        state, v = motion_step(GAINS, FRAME, state, tick(t, fix, sample, level(k)))
        inertial.append(state.inertial)
        if k > 100:
            assert abs(v.x_m - where[0]) < 0.002
            assert abs(v.velocity_x_mps - speed[0]) < 0.03
    gone = 200 + round(IMU_SILENT_S / DT)
    assert inertial[100:200] == [True] * 100
    assert inertial[gone:400] == [False] * (400 - gone)
    back = 400 + round(IMU_STEADY_S / DT)
    assert inertial[400:back] == [False] * (back - 400)
    assert inertial[back + 1 :] == [True] * (599 - back)


@pytest.mark.parametrize("imu", [True, False])
def test_another_source_is_no_step(imu: bool) -> None:
    """5 cm apart: position and velocity go on as they were, and slide over, less certain."""
    state, fix, before = initial_motion(), NO_FIX, None
    for k in range(6000):
        shift = 0.05 if k >= 400 else 0.0
        if k % FIX_TICKS == 0:
            fix = fix_at(k, (1.0, 2.0, 3.0 + shift), source=2 if k >= 400 else 1)
        sample = accelerations(k, (0.0, 0.0, 0.0)) if imu else NO_IMU
        state, v = motion_step(GAINS, FRAME, state, tick(k * DT, fix, sample, level(k)))
        if k > 200 and before is not None:
            assert abs(v.z_m - before) < 3e-4
            assert abs(v.climb_mps) < 0.01
            if k >= 400:
                reported = motion_quality(GAINS, state, state, k * DT).position_sigma_m
                assert reported >= 0.999 * (3.05 - v.z_m) - 1e-4
        before = v.z_m
    assert v.z_m == pytest.approx(3.05, abs=1e-3)
    assert state.offset.z_m == pytest.approx(0.0, abs=1e-3)


def test_of_a_new_source_s_difference_its_origin_has_what_the_filter_is_confident_of() -> None:
    """The offset's fraction is OFFSET_M² / (OFFSET_M² + S), S the innovation's variance: all but
    all of it while fixes come, less after a gap in which the estimate may have drifted."""
    gains = GAINS._replace(unknown_sd_mps2=10.0)
    fractions = []
    for k in (400, 440):  # 4 and 44 ticks after the last fix
        state = initial_motion()
        for old in range(0, 400, FIX_TICKS):
            fix = fix_at(old, (1.0, 2.0, 3.0), source=1)
            state, _ = motion_step(gains, FRAME, state, tick(old * DT, fix))
        fix = fix_at(k, (1.1, 1.9, 3.2), source=2)
        state, _ = motion_step(gains, FRAME, state, tick(k * DT, fix))
        left = state.innovation
        variance = (left.x_m**2 + left.y_m**2 + left.z_m**2) / left.nis
        fraction = OFFSET_M**2 / (OFFSET_M**2 + variance)
        for taken, kept in zip(state.offset, left[:3], strict=True):
            assert taken / (taken + kept) == pytest.approx(fraction)
        fractions.append(fraction)
    assert fractions[0] > 0.99
    assert fractions[1] < 0.8


@pytest.mark.parametrize("away", [1.2, 2.4, 9.0])
def test_a_source_far_from_the_first_is_refused_like_any_outlier(away: float) -> None:
    state, jumped = initial_motion(), []
    for k in range(0, 600, FIX_TICKS):
        fix = fix_at(k, (1.0 + (away if k >= 400 else 0.0), 2.0, 3.0), source=int(k >= 400))
        before = state
        state, v = motion_step(GAINS, FRAME, state, tick(k * DT, fix))
        quality = motion_quality(GAINS, before, state, k * DT)
        jumped.append(quality.jumped)
        assert not (quality.fix_used and quality.fix_refused)
    first = 400 // FIX_TICKS + OUTLIERS_ACCEPTED - 1
    assert jumped.index(True) == first
    assert v.x_m == pytest.approx(1.0 + away, abs=0.01)


@pytest.mark.parametrize("wild_mps", [2.0, 50.0])
def test_a_velocity_that_cannot_be_is_left_out_and_its_place_taken(wild_mps: float) -> None:
    """Beyond GATE_MPS, with 5 cm/s of noise, off the estimate; and one that no aircraft flies."""
    state = initial_motion()
    for k in range(0, 400, FIX_TICKS):
        wild = (wild_mps, 0.0, 0.0) if k == 300 else (0.0, 0.0, 0.0)
        state, v = motion_step(GAINS, FRAME, state, tick(k * DT, fix_at(k, (1.0, 2.0, 3.0), wild)))
        assert abs(v.velocity_x_mps) < 1e-6
        assert state.fix.time_s == k * DT


def test_a_source_of_larger_sigma_weighs_less() -> None:
    confident, uncertain = (
        motion_step(
            GAINS,
            FRAME,
            motion_step(GAINS, FRAME, initial_motion(), tick(0.0, fix_at(0, (0.0, 0.0, 0.0))))[0],
            tick(0.02, fix_at(4, (0.1, 0.0, 0.0))._replace(sigma_m=sigma)),
        )[1].x_m
        for sigma in (nan, 5.0)
    )
    assert abs(uncertain) < 0.1 * confident


# --- time and nonsense ----------------------------------------------------------------------


BAD_IMU = [
    {"force_x_frd_mps2": nan},
    {"force_z_frd_mps2": 1e300},
    {"time_s": nan},
    {"time_s": 1e9},
    {"time_s": 0.4},  # the one before again
    {"time_s": 0.3},  # out of order
]


@pytest.mark.parametrize("bad", BAD_IMU)
def test_a_bad_acceleration_is_refused_and_counted(bad: dict[str, Any]) -> None:
    state, fix = initial_motion(), fix_at(0, (1.0, 2.0, 3.0))
    for k in range(81):
        sample = accelerations(k, (0.0, 0.0, 0.0))
        state, _ = motion_step(GAINS, FRAME, state, tick(k * DT, fix, sample, level(k)))
    corrupted = accelerations(81, (100.0, 0.0, 0.0))._replace(**bad)
    after, v = motion_step(GAINS, FRAME, state, tick(81 * DT, fix, corrupted, level(81)))
    assert after.rejected == state.rejected + 1
    assert after.track == state.track
    assert abs(v.velocity_x_mps) < 1e-9


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_whatever_comes_the_estimate_stays_a_number(data: st.DataObject) -> None:
    """Samples with any numbers and stamps, after a first good fix and attitude."""
    number = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-20.0, 20.0)
    stamp = st.floats(-0.5, 1.5) | st.sampled_from([nan, 0.0, 1e-6, 2e-6, 1e9])
    state, _ = motion_step(
        GAINS, FRAME, initial_motion(), tick(0.0, fix_at(0, (0.0, 0.0, 0.0)), NO_IMU, level(0))
    )
    now = 0.0
    for k in range(1, 12):
        now += data.draw(st.sampled_from([0.0, 0.005, 0.1]))
        numbers = [data.draw(number) for _ in range(12)]
        rates = [data.draw(st.floats(-9.0, 9.0)) for _ in range(3)]
        inputs = tick(
            now,
            position_fix(
                k + 1,
                data.draw(stamp),
                (numbers[0], numbers[1], numbers[2]),
                (numbers[3], numbers[4], numbers[5]),
                k % 3,
            ),
            ImuSample(
                sequence=k,
                time_s=data.draw(stamp),
                force_x_frd_mps2=numbers[6],
                force_y_frd_mps2=numbers[7],
                force_z_frd_mps2=numbers[8],
                roll_rate_frd_radps=numbers[9],
                pitch_rate_frd_radps=numbers[10],
                yaw_rate_frd_radps=numbers[11],
            ),
            attitude_sample(k + 1, data.draw(stamp), UPWIND, (rates[0], rates[1], rates[2])),
        )
        state, v = motion_step(GAINS, FRAME, state, inputs)
        assert all(isfinite(number) for number in v[1:7])

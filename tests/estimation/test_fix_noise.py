"""Fixes that scatter more than they say and are no outliers, and those that only seem to."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from math import inf, radians, sqrt
from statistics import fmean

import pytest
from samples import attitude_sample, imu_sample, position_fix

from tgl_soar.estimation.motion import motion_quality, motion_step
from tgl_soar.estimation.motion_state import (
    NO_NOISE,
    NO_SHIFT,
    MotionGains,
    MotionState,
    initial_motion,
)
from tgl_soar.estimation.position_fixes import NOISE_KEPT
from tgl_soar.geometry import (
    SoaringFrame,
    ned_from_soaring,
    ned_vector_from_soaring,
    quaternion_from_euler,
)
from tgl_soar.types import (
    GRAVITY_MPS2,
    NAN,
    NO_AIRSPEED,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    AutopilotStatus,
    Inputs,
    MotionQuality,
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
    reset_max_m=10.0,
    use_imu=True,
)
DT = 0.005
FIX_TICKS = 4
BEGINS_S = 2.0
SILENT = AutopilotStatus(time_s=NAN, accepts_surfaces=False, armed=False)
AT = (0.4, -0.1, 1.3)  # where the aircraft hangs, soaring frame
NONE = (NAN, NAN, NAN)
STILL = (0.0, 0.0, 0.0)

Triple = tuple[float, float, float]
Errors = Callable[[int, random.Random], Triple]  # of the fix of a tick
Flown = tuple[float, MotionState, VehicleState, MotionQuality]


def flight(
    errors: Errors,
    seed: int = 0,
    imu: bool = True,
    speed: Triple = NONE,
    end_s: float = 5.0,
    every: int = FIX_TICKS,
    tilted_rad: float = 0.0,
) -> Iterator[Flown]:
    """Tick by tick: an aircraft that hangs still, and an accelerometer with noise.

    tilted_rad: by which its attitude is wrong in the end, a second after fixes began to be.
    """
    noise, state = random.Random(seed), initial_motion()
    velocity = ned_vector_from_soaring(FRAME, *speed)
    fix, force = NO_FIX, NO_IMU
    for k in range(1, round(end_s / DT)):
        now = k * DT
        if k % every == 0:
            x, y, z = (at + off for at, off in zip(AT, errors(k, noise), strict=True))
            fix = position_fix(k, now, ned_from_soaring(FRAME, x, y, z), velocity)
        if imu:
            fx, fy, fz = (noise.gauss(0.0, GAINS.force_sd_mps2) for _ in range(3))
            force = imu_sample(k, now, (fx, fy, fz - GRAVITY_MPS2))
        pitch_rad = tilted_rad if now > BEGINS_S + 1.0 else 0.0
        turned = quaternion_from_euler(0.0, pitch_rad, FRAME.wind_from_rad)
        inputs = Inputs(
            time_s=now,
            position=fix,
            attitude=attitude_sample(k, now, turned),
            autopilot=SILENT,
            engage=False,
            imu=force,
            airspeed=NO_AIRSPEED,
            surfaces=NO_SURFACES,
        )
        before = state
        state, vehicle = motion_step(GAINS, FRAME, state, inputs)
        yield now, state, vehicle, motion_quality(GAINS, before, state, now)


def scatter(sd_m: float) -> Errors:
    """Noise of this size from `BEGINS_S` on, and what the filter assumes before."""

    def errors(k: int, noise: random.Random) -> Triple:
        sd = sd_m if k * DT >= BEGINS_S else GAINS.fix_sd_m
        return noise.gauss(0.0, sd), noise.gauss(0.0, sd), noise.gauss(0.0, sd)

    return errors


def off_m(vehicle: VehicleState) -> float:
    x, y, z = vehicle.x_m - AT[0], vehicle.y_m - AT[1], vehicle.z_m - AT[2]
    return sqrt(x * x + y * y + z * z)


@pytest.mark.parametrize(
    ("sd_m", "imu"),
    [(0.03, True), (0.1, True), (0.3, True), (0.03, False), (0.1, False), (0.2, False)],
)
def test_noise_that_is_reported_as_good_moves_the_estimate_little(sd_m: float, imu: bool) -> None:
    """By less than half of its size; without accelerometers by less than it; and it says so."""
    squares, normalized = [], []
    for seed in range(8):
        for now, _, vehicle, quality in flight(scatter(sd_m), seed, imu):
            if now > BEGINS_S:
                assert not quality.jumped
                squares.append(off_m(vehicle) ** 2)
                normalized.append(squares[-1] / quality.position_sigma_m**2 / 3.0)
    assert sqrt(fmean(squares)) < (0.5 * sd_m if imu else 1.4 * sd_m)  # of three axes
    assert 0.5 < fmean(normalized) < 2.5  # 1: the variance is just right


@pytest.mark.parametrize("speed", [(0.3, 0.0, 0.0), (0.0, -0.6, 0.0)])
def test_a_wrong_velocity_does_not_lead_where_positions_scatter(speed: Triple) -> None:
    for seed in range(4):
        for now, state, vehicle, _ in flight(scatter(0.1), seed, speed=speed):
            if now > BEGINS_S:
                assert off_m(vehicle) < 0.15
                assert state.shift == NO_SHIFT


@pytest.mark.parametrize(("sd_m", "speed"), [(0.1, STILL), (0.2, STILL), (0.3, STILL), (0.3, NONE)])
def test_no_frame_has_moved_where_fixes_scatter_and_attitudes_go_wrong(
    sd_m: float, speed: Triple
) -> None:
    """Of what scatters fixes count little, so that accelerations, wrong by g sin 5°, lead."""
    for seed in range(8):
        for _, state, _, _ in flight(
            scatter(sd_m), seed, speed=speed, end_s=8.0, tilted_rad=radians(5.0)
        ):
            assert state.shift == NO_SHIFT


@pytest.mark.parametrize(
    ("wild_m", "ticks", "tilted_deg"),
    [(0.4, 40, 0.0), (0.45, 20, 15.0), (0.45, 10, 15.0)],
)
def test_no_frame_has_moved_where_a_wild_fix_led_the_estimate_away(
    wild_m: float, ticks: int, tilted_deg: float
) -> None:
    """At 5 to 20 Hz it is taken in whole, and those that follow count little for seconds."""
    wild = round((BEGINS_S + 1.0) / DT)

    def once(k: int, noise: random.Random) -> Triple:
        x, y, z = scatter(GAINS.fix_sd_m)(k, noise)
        return (x + wild_m if k == wild else x), y, z

    for seed in range(3):
        for now, state, _, _ in flight(
            once, seed, end_s=10.0, every=ticks, tilted_rad=radians(tilted_deg)
        ):
            if now > BEGINS_S:
                assert state.shift == NO_SHIFT


@pytest.mark.parametrize("wild_m", [0.024, 0.06, 0.3])
def test_a_frame_moves_a_moment_after_a_fix_that_chance_made(wild_m: float) -> None:
    """One alone, and a glitch which the next two show as well."""
    wild = round(BEGINS_S / DT)
    moved = wild + 5 * FIX_TICKS

    def errors(k: int, noise: random.Random) -> Triple:
        return 5.0 if k >= moved else 0.0, noise.gauss(0.0, 1e-4), wild_m if k == wild else 0.0

    detected = False
    for now, state, vehicle, quality in flight(errors):
        detected = detected or state.noise.variance_m2 > GAINS.fix_sd_m**2
        if now > BEGINS_S:
            assert not quality.jumped
            assert off_m(vehicle) < 0.03
    assert detected
    assert state.shift.x_m == pytest.approx(5.0, abs=0.03)


@pytest.mark.parametrize("size_m", [0.3, 0.45, 0.49, 0.51, 0.55, 0.6, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_a_step_about_the_gate_is_followed_or_moves_the_frame(size_m: float, seed: int) -> None:
    """Without a jump, which ends a flight on the line for a moment: it is no noise."""

    def errors(k: int, noise: random.Random) -> Triple:
        x, y, z = scatter(GAINS.fix_sd_m)(k, noise)
        return x + size_m if k * DT >= BEGINS_S else x, y, z

    for now, state, vehicle, quality in flight(errors, seed):  # noqa: B007
        assert not (quality.jumped and now > 1.0)
    by_m = size_m - state.shift.x_m
    assert abs(vehicle.x_m - AT[0] - by_m) < 0.03


@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize("speed", [NONE, (0.0, 0.0, 0.0)])
def test_of_honest_fixes_none_is_seen_to_scatter(imu: bool, speed: Triple) -> None:
    for seed in range(4):
        for _, state, _, _ in flight(scatter(GAINS.fix_sd_m), seed, imu, speed, end_s=10.0):
            assert state.noise.variance_m2 == 0.0


@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize("by", [(0.45, 0.0, 0.0), (0.0, 0.2, 0.0), (0.1, -0.1, 0.3)])
def test_what_has_moved_once_is_followed(imu: bool, by: Triple) -> None:
    """By as much as is no outlier.  Not at once: the next fix may deny it."""

    def moved(k: int, _: random.Random) -> Triple:
        return by if k * DT >= BEGINS_S else (0.0, 0.0, 0.0)

    size = sqrt(sum(part * part for part in by))
    for now, _, vehicle, _ in flight(moved, imu=imu):
        left = sqrt((vehicle.x_m - AT[0] - by[0]) ** 2 + (vehicle.y_m - AT[1] - by[1]) ** 2)
        if now == pytest.approx(BEGINS_S + FIX_TICKS * DT):
            assert left + abs(vehicle.z_m - AT[2] - by[2]) > 0.8 * size
        if now > BEGINS_S + 1.2:
            assert left + abs(vehicle.z_m - AT[2] - by[2]) < 0.1 * size


def test_one_wild_fix_below_the_gate_moves_nothing() -> None:
    wild = round(BEGINS_S / DT)

    def once(k: int, _: random.Random) -> Triple:
        return (0.45, 0.0, 0.0) if k == wild else (0.0, 0.0, 0.0)

    assert max(off_m(vehicle) for now, _, vehicle, _ in flight(once) if now >= BEGINS_S) < 0.01


def test_a_velocity_that_is_wrong_all_along_is_no_noise() -> None:
    """The places are as good as ever, and the estimate stays with them."""
    flown = list(flight(scatter(GAINS.fix_sd_m), speed=(0.8, 0.0, 0.0)))
    assert max(state.noise.variance_m2 for now, state, _, _ in flown if now > 1.0) == 0.0
    assert max(off_m(vehicle) for now, _, vehicle, _ in flown if now > 1.0) < 0.05


def test_noise_that_has_ended_is_forgotten() -> None:
    def over(k: int, noise: random.Random) -> Triple:
        return scatter(0.1 if k * DT < BEGINS_S + 1.0 else GAINS.fix_sd_m)(k, noise)

    variances = {now: state.noise.variance_m2 for now, state, _, _ in flight(over)}
    after = [value for now, value in variances.items() if now > BEGINS_S + 1.0]
    assert max(value for now, value in variances.items() if BEGINS_S < now < BEGINS_S + 1.0) > 0.01
    assert after[40 * FIX_TICKS] < GAINS.fix_sd_m**2  # it does not count any more
    assert after[-1] == pytest.approx(NOISE_KEPT * after[-1 - FIX_TICKS])


@pytest.mark.parametrize(("thrown_mps2", "lasts_s"), [(40.0, 0.15), (60.0, 0.12), (20.0, 0.3)])
@pytest.mark.parametrize("ticks", [10, 20])
def test_a_throw_is_no_noise_however_seldom_fixes_come(
    thrown_mps2: float, lasts_s: float, ticks: int
) -> None:
    """At 20 and 10 Hz, without accelerometers: it is followed, and no frame has moved."""

    def thrown(k: int, _: random.Random) -> Triple:
        since_s = max(0.0, k * DT - BEGINS_S)
        faster_s = min(since_s, lasts_s)
        on_m = thrown_mps2 * lasts_s * (since_s - faster_s)
        return -0.5 * thrown_mps2 * faster_s * faster_s - on_m, 0.0, 0.0

    for now, state, vehicle, _ in flight(thrown, imu=False, end_s=4.0, every=ticks):
        x_m, _, _ = thrown(round(now / DT), random.Random(0))
        if round(now / DT) % ticks == 0:
            assert abs(vehicle.x_m - AT[0] - x_m) < 0.6
        assert state.shift == NO_SHIFT


def test_where_the_estimate_begins_again_nothing_is_known_of_the_noise() -> None:
    wide = scatter(0.1)
    for now, state, _, _ in flight(
        lambda k, noise: (20.0 + wide(k, noise)[0], 0.0, 0.0) if k * DT > 4.0 else wide(k, noise)
    ):
        if now > 4.0 and state.fix.time_s > 4.0:
            assert state.noise == NO_NOISE
            return
    pytest.fail(f"never in {inf} s")

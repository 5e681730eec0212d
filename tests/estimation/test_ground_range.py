"""A rangefinder: the height that it measures, what it bounds and corrects, and what it may not."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, inf, isfinite, isnan, nan, radians, sin
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.estimation import ground_range
from tgl_soar.estimation.ground_range import (
    NO_GROUND_RANGE,
    NO_RANGE_STATE,
    PROOF_BAND_M,
    PROOF_M,
    RANGE_BOUNDS,
    RANGE_CORRECTS,
    RANGE_FAR_OFF,
    RANGE_FROZEN,
    RANGE_INVALID,
    RANGE_NOTHING,
    RANGE_TILTED,
    RANGE_UNUSED,
    RANGE_USED,
    GroundRange,
    RangeGains,
    RangeState,
    ground_height,
    range_step,
)
from tgl_soar.types import NO_GROUND, Ground, RangeSample, VehicleState

CORRECTS = RangeGains(RANGE_CORRECTS, 3.0)
BOUNDS = RangeGains(RANGE_BOUNDS, 3.0)
RATE_HZ = 20.0
LEVEL = Ground(2, (-100.0, 100.0, *(100.0,) * 6), (2.0, 2.0, *(2.0,) * 6))
SLOPE = Ground(2, (-100.0, 100.0, *(100.0,) * 6), (-100.0, 100.0, *(100.0,) * 6))
HEIGHT_M = 10.0


def vehicle(time_s: float, **fields: float) -> VehicleState:
    still = dict.fromkeys(VehicleState._fields, 0.0)
    return VehicleState(**(still | {"time_s": time_s, "z_m": 12.0} | fields))


class Sensor:
    """A rangefinder over LEVEL, and a position that is wrong by `bias_m`."""

    def __init__(self, gains: RangeGains = CORRECTS, ground: Ground = LEVEL) -> None:
        self.gains, self.ground = gains, ground
        self.state: RangeState = NO_RANGE_STATE
        self.found: GroundRange = NO_GROUND_RANGE
        self.sequence, self.time_s = 0, 0.0
        self.noise = Random(1)

    def fly(
        self,
        seconds: float,
        *,
        bias_m: Callable[[float], float] = lambda _: 0.0,
        reading: Callable[[float, float], float] = lambda _, true_m: true_m,
        height_m: Callable[[float], float] = lambda _: HEIGHT_M,
        flying: bool = True,
        certain: bool = True,
        jumped: bool = False,
        **fields: float,
    ) -> Sensor:
        """Samples for so long; each function takes the time since this call [s]."""
        for k in range(round(seconds * RATE_HZ)):
            self.time_s += 1.0 / RATE_HZ
            since_s = k / RATE_HZ
            true_m = height_m(since_s) + self.noise.gauss(0.0, 0.01)
            self.sequence += 1
            sample = RangeSample(self.sequence, self.time_s, reading(since_s, true_m))
            z = 2.0 + height_m(since_s) + bias_m(since_s)
            at = vehicle(self.time_s, z_m=z, **fields)
            self.state, self.found = range_step(
                self.gains, self.ground, self.state, sample, at, certain, jumped, flying
            )
        return self


def after_three(
    gains: RangeGains,
    ground: Ground,
    at: VehicleState,
    range_m: float,
    ages_s: tuple[float, float, float] = (0.02, 0.01, 0.0),
) -> tuple[RangeState, GroundRange]:
    """The same reading in three ticks of 1 ms, the last of them `at`: no bound before that."""
    state, found = NO_RANGE_STATE, NO_GROUND_RANGE
    for k, age_s in enumerate(ages_s):
        assert isnan(found.bound_m)
        now = at.time_s - 0.001 * (len(ages_s) - 1 - k)
        sample = RangeSample(k + 1, now - age_s, range_m)
        tick = at._replace(time_s=now)
        state, found = range_step(gains, ground, state, sample, tick, True, False, True)
    return state, found


# --- what it measures ---------------------------------------------------------------------------


@pytest.mark.parametrize("pitch_deg", [-15.0, 0.0, 10.0])
@pytest.mark.parametrize("roll_deg", [-20.0, 0.0, 15.0])
@pytest.mark.parametrize("heading_deg", [-60.0, 0.0, 40.0])
@pytest.mark.parametrize("ground", [LEVEL, SLOPE])
def test_the_beam_meets_the_ground_where_its_geometry_says(
    roll_deg: float, pitch_deg: float, heading_deg: float, ground: Ground
) -> None:
    """Against the body's axis as a vector: where the beam's end lies on the profile, the position
    is right and nothing differs."""
    roll, pitch, heading = (radians(a) for a in (roll_deg, pitch_deg, heading_deg))
    # The third row of FRD in (upwind, right, down), from the angles one after the other.
    upwind = cos(roll) * sin(pitch) * cos(heading) + sin(roll) * sin(heading)
    down = cos(roll) * cos(pitch)
    x, z = 5.0, 20.0
    slope, level = (1.0, 0.0) if ground is SLOPE else (0.0, 2.0)
    range_m = (z - level - slope * x) / (down - slope * upwind)
    assert ground_height(ground, x - range_m * upwind) == pytest.approx(z - range_m * down)
    at = vehicle(1.0, x_m=x, z_m=z, roll_rad=roll, pitch_rad=pitch, heading_rad=heading)
    state, found = after_three(CORRECTS, ground, at, range_m)
    assert state.standing == RANGE_USED
    assert found.bound_m == pytest.approx(0.0, abs=1e-9)


def test_a_sample_is_carried_on_with_the_climb_until_the_tick() -> None:
    """The oldest of three, 0.1 s old."""
    _, found = after_three(
        BOUNDS, LEVEL, vehicle(1.0, climb_mps=-2.0), 10.0, ages_s=(0.1, 0.1, 0.1)
    )
    assert found.bound_m == pytest.approx(-0.2)


# --- the bound and the correction -----------------------------------------------------------------


def test_ground_that_is_nearer_is_a_bound_within_three_samples() -> None:
    """The position is 2 m too high: so much nearer is the ground, and nothing is corrected."""
    sensor = Sensor(BOUNDS).fly(3.0 / RATE_HZ, bias_m=lambda _: 2.0)
    assert sensor.found.bound_m == pytest.approx(-2.0, abs=0.05)
    assert sensor.found.correction_m == 0.0


@pytest.mark.parametrize("short", [1, 2])
def test_one_or_two_short_readings_bring_no_ground_near(short: int) -> None:
    """Dust and insects; a third is one too many to be nothing."""
    sensor = Sensor(BOUNDS).fly(1.0)
    sensor.fly(short / RATE_HZ, reading=lambda _, true_m: true_m - 2.5)
    assert sensor.state.standing == RANGE_USED
    assert sensor.found.bound_m == pytest.approx(0.0, abs=0.05)
    sensor.fly((3 - short) / RATE_HZ, reading=lambda _, true_m: true_m - 2.5)
    assert sensor.found.bound_m == pytest.approx(-2.5, abs=0.05)


@pytest.mark.parametrize("ground", [LEVEL, NO_GROUND])
@pytest.mark.parametrize("short", [1, 2])
def test_nor_do_they_after_a_gap(short: int, ground: Ground) -> None:
    """There is no bound before the third, and what follows is not judged by them."""
    sensor = Sensor(BOUNDS, ground).fly(1.0)
    before = sensor.found.bound_m
    sensor.time_s += 0.6
    for k in range(4):
        dust = (lambda _, true_m: true_m - 5.5) if k < short else (lambda _, true_m: true_m)
        sensor.fly(1.0 / RATE_HZ, reading=dust)
        assert isnan(sensor.found.bound_m) if k < 2 else sensor.found.bound_m > before - 0.1
        assert sensor.state.standing == RANGE_USED


@pytest.mark.parametrize("use", [RANGE_BOUNDS, RANGE_UNUSED])
def test_asked_for_in_flight_it_corrects_no_faster_than_a_line_slides(use: int) -> None:
    """Nor does a correction go faster that nothing asks for any more."""

    def bias_m(_: float) -> float:
        return 2.5

    sensor = Sensor(RangeGains(use, 3.0)).fly(20.0, bias_m=bias_m)
    assert sensor.found.correction_m == 0.0
    for gains, after in ((CORRECTS, -2.5), (RangeGains(use, 3.0), 0.0)):
        sensor.gains = gains
        for _ in range(round(20.0 * RATE_HZ)):
            before = sensor.found.correction_m
            sensor.fly(1.0 / RATE_HZ, bias_m=bias_m)
            assert abs(sensor.found.correction_m - before) <= 0.3 / RATE_HZ + 1e-9
        assert sensor.found.correction_m == pytest.approx(after, abs=0.05)


def test_on_the_ground_a_correction_ends_with_its_use() -> None:
    sensor = Sensor().fly(1.0, bias_m=lambda _: 2.5, flying=False)
    sensor.gains = RangeGains(RANGE_UNUSED, 3.0)
    sensor.fly(1.0 / RATE_HZ, bias_m=lambda _: 2.5, flying=False)
    assert (sensor.state, sensor.found) == (NO_RANGE_STATE, NO_GROUND_RANGE)


@pytest.mark.parametrize("bias_m", [-4.0, 2.0, 4.0])
def test_before_a_flight_the_height_is_right_at_once(bias_m: float) -> None:
    """A receiver that is wrong by two of its standard deviations.  A ground that is farther than
    the position says is followed by one gate only."""
    sensor = Sensor().fly(0.5, bias_m=lambda _: bias_m, flying=False)
    assert sensor.found.correction_m == pytest.approx(min(-bias_m, CORRECTS.gate_m), abs=0.05)


def test_in_flight_a_drift_is_followed_no_faster_than_a_line_slides() -> None:
    sensor = Sensor().fly(1.0, flying=False)
    before = sensor.found.correction_m
    sensor.fly(2.0, bias_m=lambda _: 1.5)
    assert abs(sensor.found.correction_m - before) <= 2.0 * 0.3 + 1e-9
    sensor.fly(20.0, bias_m=lambda _: 1.5)
    assert sensor.found.correction_m == pytest.approx(-1.5, abs=0.05)


def test_a_gauss_markov_drift_is_left_with_what_was_argued() -> None:
    """1 m with 300 s, within the limits: 0.08 m by the lag of 2 s."""
    random = Random(3)
    fraction = 1.0 / RATE_HZ / 300.0
    drift, errors = 0.0, []
    sensor = Sensor().fly(1.0, flying=False)
    for _ in range(round(1200.0 * RATE_HZ)):
        drift += -fraction * drift + (2.0 * fraction) ** 0.5 * random.gauss(0.0, 1.0)
        held = drift
        sensor.fly(1.0 / RATE_HZ, bias_m=lambda _, held=held: held)  # type: ignore[misc]
        errors.append(drift + sensor.found.correction_m)
    rms = (sum(e * e for e in errors) / len(errors)) ** 0.5
    assert rms == pytest.approx((2.0 / 302.0) ** 0.5, rel=0.25)


def test_over_a_slope_a_part_is_left_to_the_place() -> None:
    """A slope of 1, and the position 1 m too far downstream: it looks 1 m too low over the ground,
    of which four fifths count as height."""
    sensor = Sensor(ground=SLOPE)
    for _ in range(round(2.0 * RATE_HZ)):
        sensor.sequence += 1
        sensor.time_s += 1.0 / RATE_HZ
        sample = RangeSample(sensor.sequence, sensor.time_s, 9.0 + 0.001 * (sensor.sequence % 7))
        sensor.state, sensor.found = range_step(
            sensor.gains,
            SLOPE,
            sensor.state,
            sample,
            vehicle(sensor.time_s, x_m=1.0, z_m=9.0),
            True,
            False,
            False,
        )
    assert sensor.found.correction_m == pytest.approx(0.8, abs=0.02)
    assert sensor.found.bound_m == pytest.approx(1.0, abs=0.02)


def test_where_the_ground_is_not_known_it_only_bounds() -> None:
    sensor = Sensor(ground=NO_GROUND).fly(2.0, height_m=lambda _: 8.0)
    assert sensor.found.correction_m == 0.0
    assert 10.0 + sensor.found.bound_m == pytest.approx(8.0, abs=0.05)  # of z = 10 m


def test_without_a_certain_position_it_bounds_and_corrects_nothing() -> None:
    sensor = Sensor().fly(1.0, flying=False)
    before = sensor.found.correction_m
    sensor.fly(3.0, bias_m=lambda _: 1.0, certain=False)
    assert sensor.found.correction_m == before
    assert sensor.found.bound_m == pytest.approx(-1.0, abs=0.05)


def test_in_a_drop_out_the_correction_stays_and_the_bound_ends() -> None:
    sensor = Sensor().fly(1.0, bias_m=lambda _: 1.0, flying=False)
    held = sensor.found.correction_m
    sensor.fly(30.0, bias_m=lambda _: 1.0, reading=lambda _t, _r: nan)
    assert sensor.state.standing == RANGE_NOTHING
    assert sensor.found.correction_m == held
    assert isnan(sensor.found.bound_m)
    assert not sensor.found.refused


def test_one_short_reading_corrects_nothing() -> None:
    sensor = Sensor().fly(3.0)
    before = sensor.found.correction_m
    sensor.fly(1.0 / RATE_HZ, reading=lambda _, true_m: true_m - 2.5)
    assert sensor.found.correction_m == pytest.approx(before, abs=0.002)


@pytest.mark.parametrize("bias_m", [-8.0, 8.0])
def test_a_position_that_is_off_by_more_than_a_receiver_is_corrects_nothing(bias_m: float) -> None:
    """Another ground, or another origin: to be looked at before a flight, not to be flown with."""
    sensor = Sensor().fly(2.0, bias_m=lambda _: bias_m, flying=False)
    assert sensor.state.standing == RANGE_FAR_OFF
    assert sensor.found.refused
    assert sensor.found.correction_m == 0.0


@pytest.mark.parametrize("flying", [False, True])
def test_what_was_known_is_kept_in_a_flight_alone(flying: bool) -> None:
    """Carried about without a distance to the ground, the position's error is unknown."""
    sensor = Sensor().fly(1.0, bias_m=lambda _: 1.0, flying=False)
    held = sensor.found.correction_m
    last = RangeSample(sensor.sequence, sensor.time_s, HEIGHT_M)
    at = vehicle(sensor.time_s + 1.0)
    _, found = range_step(CORRECTS, LEVEL, sensor.state, last, at, True, False, flying)
    assert found.correction_m == (held if flying else 0.0)
    assert not found.refused


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize("reading_m", [0.3, 1.0, 5.5, 14.5, 30.0, 39.9])
def test_what_steps_in_flight_without_the_position_is_not_used(reading_m: float) -> None:
    """A tether, a wheel, dust on the window; and the far end that some sensors show instead of
    nothing."""
    sensor = Sensor().fly(1.0)
    sensor.fly(30.0, reading=lambda _t, _r: reading_m + sensor.noise.gauss(0.0, 0.02))
    assert sensor.state.standing == RANGE_FAR_OFF
    assert abs(sensor.found.correction_m) < 0.05
    assert isnan(sensor.found.bound_m)
    assert sensor.found.refused
    sensor.fly(1.0)
    assert sensor.state.standing == RANGE_USED
    assert not sensor.found.refused


def test_a_frozen_one_is_found_before_it_has_moved_anything_far() -> None:
    """The aircraft sinks by 0.3 m/s under a sensor that says that it does not."""
    sensor = Sensor().fly(1.0)
    sensor.fly(5.0, reading=lambda _t, _r: HEIGHT_M, height_m=lambda t: HEIGHT_M - 0.3 * t)
    assert sensor.state.standing == RANGE_FROZEN
    assert abs(sensor.found.correction_m) <= 0.1
    assert isnan(sensor.found.bound_m)


@pytest.mark.parametrize(("sunk_m", "standing"), [(0.07, RANGE_USED), (0.13, RANGE_FROZEN)])
def test_the_same_reading_again_is_frozen_from_a_tenth_of_a_metre_on(
    sunk_m: float, standing: int
) -> None:
    sensor = Sensor().fly(1.0)
    sensor.fly(1.0, reading=lambda _t, _r: HEIGHT_M, height_m=lambda t: HEIGHT_M - sunk_m * t)
    sensor.fly(0.5, reading=lambda _t, _r: HEIGHT_M, height_m=lambda _: HEIGHT_M - sunk_m)
    assert sensor.state.standing == standing


def test_refusing_is_reported_after_a_second() -> None:
    sensor = Sensor().fly(1.0)
    sensor.fly(0.9, reading=lambda _t, _r: 0.3)
    assert not sensor.found.refused
    sensor.fly(0.2, reading=lambda _t, _r: 0.3)
    assert sensor.found.refused


@pytest.mark.parametrize("angle", ["roll", "pitch"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_tilted_one_is_not_looked_at_and_that_is_no_fault(angle: str, sign: float) -> None:
    roll, pitch = (sign * 0.5, 0.0) if angle == "roll" else (0.0, sign * 0.5)
    sensor = Sensor().fly(2.0, roll_rad=roll, pitch_rad=pitch)
    assert sensor.state.standing == RANGE_TILTED
    assert not sensor.found.refused
    assert isnan(sensor.found.bound_m)


@pytest.mark.parametrize(("height_m", "used"), [(2.5, False), (3.5, True)])
def test_over_unknown_ground_a_first_reading_in_flight_is_not_short(
    height_m: float, used: bool
) -> None:
    sensor = Sensor(ground=NO_GROUND).fly(2.0, height_m=lambda _: height_m)
    assert (sensor.state.standing == RANGE_USED) == used


def test_unknown_ground_that_comes_nearer_is_followed_down_to_it() -> None:
    sensor = Sensor(ground=NO_GROUND).fly(10.0, height_m=lambda t: 10.5 - t)
    assert sensor.state.standing == RANGE_USED
    assert 2.0 + 0.55 + sensor.found.bound_m == pytest.approx(0.55, abs=0.05)


# --- what was refused, and is right after all -----------------------------------------------------


def swaying(since_s: float) -> float:
    """A height that goes through 1.2 m in 4 s, as one on a line in gusts does."""
    return HEIGHT_M + 0.6 * sin(radians(45.0 * since_s))


def nothing(_since_s: float, _true_m: float) -> float:
    return nan


def test_after_minutes_out_of_reach_a_height_that_has_drifted_is_not_held_against_it() -> None:
    """One standard deviation to the one side before, and two to the other after it: the ground is
    nearer by a metre more than the gate than the position says, and 5 m from where it was."""
    sensor = Sensor().fly(1.0, bias_m=lambda _: -1.0, flying=False)
    sensor.fly(180.0, reading=nothing)
    sensor.fly(0.5, bias_m=lambda _: 4.0)
    assert sensor.state.standing == RANGE_USED
    assert sensor.found.bound_m == pytest.approx(-4.0, abs=0.1)
    sensor.fly(30.0, bias_m=lambda _: 4.0)
    assert sensor.found.correction_m == pytest.approx(-4.0, abs=0.1)


@pytest.mark.parametrize("off_m", [-6.5, 3.5])
def test_after_a_gap_it_is_still_judged_by_what_a_receiver_may_be_off_by(off_m: float) -> None:
    """Twice the gate nearer, once farther, and no more."""
    sensor = Sensor().fly(1.0).fly(180.0, reading=nothing)
    sensor.fly(10.0, bias_m=lambda _: -off_m)
    assert sensor.state.standing == RANGE_FAR_OFF
    assert isnan(sensor.found.bound_m)


def test_a_far_end_that_some_show_instead_of_nothing_is_such_a_gap_too() -> None:
    sensor = Sensor().fly(1.0, bias_m=lambda _: -1.0, flying=False)
    sensor.fly(180.0, reading=lambda _t, _r: 40.0 + sensor.noise.gauss(0.0, 0.02))
    sensor.fly(0.5, bias_m=lambda _: 2.5)
    assert sensor.found.bound_m == pytest.approx(-2.5, abs=0.1)


def test_the_edge_of_an_unknown_plateau_refuses_for_no_longer_than_a_gap() -> None:
    """Out over it the ground is 12 m lower at once, which is a step without the position's."""
    sensor = Sensor(ground=NO_GROUND).fly(2.0, height_m=lambda _: 8.0)
    sensor.fly(1.0, height_m=lambda _: 20.0, bias_m=lambda _: -12.0)
    assert sensor.state.standing == RANGE_USED
    assert not sensor.found.refused
    assert 10.0 + sensor.found.bound_m == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize("ground", [LEVEL, NO_GROUND])
def test_nearer_ground_that_stays_while_the_aircraft_moves_is_a_bound_and_no_more(
    ground: Ground,
) -> None:
    """Ground 7.8 m nearer, 2.2 m below, over none that is known; 4.5 m nearer over a known one.
    The proof takes 2 s, and until the height has gone through 1 m: here 4 s at the most."""
    nearer_m = 4.5 if ground.points else 7.8

    def over(since_s: float) -> float:
        return swaying(since_s) - nearer_m

    sensor = Sensor(ground=ground).fly(1.0, height_m=swaying)
    began = sensor.found.correction_m
    sensor.fly(1.9, bias_m=lambda _: nearer_m, height_m=over)
    assert sensor.state.standing == RANGE_FAR_OFF
    sensor.fly(6.0, bias_m=lambda _: nearer_m, height_m=over)
    assert sensor.state.standing == RANGE_USED
    before_m = 0.0 if ground.points else 2.0  # a position over 0 where no ground is known
    assert sensor.found.bound_m == pytest.approx(-nearer_m - before_m, abs=0.1)
    assert sensor.found.correction_m == began


def test_what_passes_below_is_over_before_it_is_proven() -> None:
    """A tree of 10 m at 7 m/s, while a gust lifts and drops the aircraft by more than PROOF_M."""
    sensor = Sensor().fly(1.0)
    sensor.fly(10.0 / 7.0, bias_m=lambda _: 4.5, height_m=lambda t: HEIGHT_M + sin(5.0 * t))
    assert sensor.state.proof_high_m - sensor.state.proof_low_m > PROOF_M
    assert sensor.state.standing == RANGE_FAR_OFF


def test_from_within_the_gate_on_it_corrects_again() -> None:
    sensor = Sensor().fly(1.0, flying=False)
    sensor.fly(8.0, bias_m=lambda _: 4.5, height_m=swaying)
    assert sensor.state.standing == RANGE_USED
    assert not sensor.state.corrects
    sensor.fly(15.0, bias_m=lambda t: 4.5 - 0.1 * t, height_m=swaying)
    assert sensor.found.correction_m == pytest.approx(0.0, abs=0.05)
    sensor.fly(30.0, bias_m=lambda _: 2.5, height_m=swaying)
    assert sensor.found.correction_m == pytest.approx(-2.5, abs=0.05)


@pytest.mark.parametrize("ground", [LEVEL, NO_GROUND])
@pytest.mark.parametrize("reading_m", [0.3, 2.5, 5.5])
@pytest.mark.parametrize("noise_m", [0.0, 0.004, 0.03])
def test_what_is_stuck_is_not_proven_however_the_aircraft_moves(
    ground: Ground, reading_m: float, noise_m: float
) -> None:
    """A wheel, a tether, dirt on the window, frozen or noisy, for a minute: over a known ground
    refused in every tick; over none what is nearer than the gate."""
    sensor = Sensor(ground=ground).fly(1.0, height_m=swaying)
    if not ground.points:
        reading_m = min(reading_m, 2.5)
    for _ in range(60):
        sensor.fly(
            1.0,
            reading=lambda _t, _r: max(0.1, reading_m + sensor.noise.gauss(0.0, noise_m)),
            height_m=lambda _: swaying(sensor.time_s),
        )
        assert sensor.state.standing in (RANGE_FAR_OFF, RANGE_FROZEN)
        assert isnan(sensor.found.bound_m)
    assert sensor.found.refused


def test_a_number_that_is_stuck_but_for_its_last_digit_is_no_silence() -> None:
    """Frozen between two changes by a centimetre, it would else be judged as after a gap."""
    sensor = Sensor().fly(1.0, height_m=swaying)
    for k in range(60):
        sensor.fly(
            1.0,
            reading=lambda _t, _r, k=k: 5.5 + 0.01 * (k % 2),  # type: ignore[misc]
            height_m=lambda _: swaying(sensor.time_s),
        )
        assert isnan(sensor.found.bound_m)


def test_over_a_known_ground_nothing_proves_itself_beyond_the_gates() -> None:
    """Farther than the gate, nearer than two: a position or a sensor that is off by so much is for
    the operator."""
    for nearer_m in (-3.5, 6.5):
        sensor = Sensor().fly(1.0, height_m=swaying)
        sensor.fly(20.0, bias_m=lambda _, off=nearer_m: off, height_m=swaying)  # type: ignore[misc]
        assert sensor.state.standing == RANGE_FAR_OFF


def test_the_band_is_too_narrow_for_what_is_stuck() -> None:
    """Through its own breadth and six standard deviations of a laser's noise, 3 cm."""
    assert PROOF_M > 2.0 * PROOF_BAND_M + 6.0 * 0.03


@pytest.mark.parametrize(
    ("off_m", "known", "since_s", "high_m", "proven"),
    [
        (-4.0, True, 2.01, 10.01, True), (-4.0, True, 1.99, 10.01, False),
        (-4.0, True, 2.01, 9.99, False), (-5.9, True, 2.01, 10.01, True),
        (-6.1, True, 2.01, 10.01, False), (0.1, True, 2.01, 10.01, False),
        (-6.1, False, 2.01, 10.01, True), (0.1, False, 2.01, 10.01, True),
    ],
)  # fmt: skip
def test_a_difference_is_proven_after_two_seconds_and_a_metre_of_height(
    off_m: float, known: bool, since_s: float, high_m: float, proven: bool
) -> None:
    """And over a known ground within two gates of 3 m, nearer."""
    state = NO_RANGE_STATE._replace(
        measured_s=50.0, proof_s=50.0 - since_s, proof_low_m=9.0, proof_high_m=high_m
    )
    assert ground_range._is_proven(3.0, known, state, off_m) is proven


@pytest.mark.parametrize(("off_m", "stays"), [(4.29, True), (3.71, True), (4.31, False),
                                              (3.69, False)])  # fmt: skip
def test_a_proof_goes_on_within_three_tenths_of_a_metre(off_m: float, stays: bool) -> None:
    before = NO_RANGE_STATE._replace(
        measured_s=49.9, proof_s=48.0, proof_off_m=4.0, proof_low_m=9.0, proof_high_m=10.0
    )
    for height_m, low_m, high_m in ((8.5, 8.5, 10.0), (9.5, 9.0, 10.0), (10.5, 9.0, 10.5)):
        after = ground_range._with_proof(before, 50.0, off_m, height_m)
        kept = (48.0, 4.0, low_m, high_m) if stays else (50.0, off_m, height_m, height_m)
        found = (after.proof_s, after.proof_off_m, after.proof_low_m, after.proof_high_m)
        assert found == kept
        # After a gap of half a second it begins again.
        for gap_s, goes_on in ((0.49, stays), (0.51, False)):
            late = before._replace(measured_s=50.0 - gap_s)
            again = ground_range._with_proof(late, 50.0, off_m, height_m)
            assert (again.proof_s, again.measured_s) == (48.0 if goes_on else 50.0, 50.0)


def test_a_jump_of_the_position_begins_again() -> None:
    sensor = Sensor().fly(1.0, bias_m=lambda _: 1.0, flying=False)
    sensor.fly(0.1, bias_m=lambda _: 2.0, jumped=True)
    assert sensor.found.correction_m == 0.0
    assert not sensor.state.known
    sensor.fly(20.0, bias_m=lambda _: 2.0)
    assert sensor.found.correction_m == pytest.approx(-2.0, abs=0.05)


def test_a_clock_that_goes_back_begins_it_again() -> None:
    """The last sample used is of the future: all that come would be refused as late."""
    sensor = Sensor().fly(2.0, bias_m=lambda _: 1.0, flying=False)
    sensor.time_s -= 60.0
    sensor.fly(1.0, bias_m=lambda _: 2.0, flying=False)
    assert sensor.found.standing == RANGE_USED
    assert sensor.found.correction_m == pytest.approx(-2.0, abs=0.05)


def test_it_never_corrects_by_more_than_its_limits() -> None:
    """However slowly a sensor or a receiver goes wrong: two gates nearer, one farther."""
    nearer = Sensor().fly(300.0, bias_m=lambda t: 0.05 * t)
    assert nearer.found.correction_m == pytest.approx(-2.0 * CORRECTS.gate_m, abs=0.2)
    farther = Sensor().fly(300.0, bias_m=lambda t: -0.05 * t)
    assert farther.found.correction_m <= CORRECTS.gate_m


def test_unused_it_says_nothing() -> None:
    sensor = Sensor(RangeGains(RANGE_UNUSED, 3.0)).fly(1.0, bias_m=lambda _: 2.0)
    assert sensor.found == NO_GROUND_RANGE
    assert sensor.state == NO_RANGE_STATE


anything = st.floats(allow_nan=True, allow_infinity=True)
usual = st.floats(-100.0, 100.0)


@given(
    steps=st.lists(
        st.tuples(
            st.integers(0, 4),
            st.one_of(anything, st.floats(-1.0, 1.0)),
            st.one_of(anything, st.floats(0.0, 60.0)),
            st.tuples(*(st.one_of(usual, anything) for _ in range(4))),
            st.booleans(),
            st.booleans(),
            st.booleans(),
        ),
        max_size=12,
    ),
    use=st.integers(0, 2),
    ground=st.sampled_from([LEVEL, SLOPE, NO_GROUND]),
)
def test_whatever_comes_the_correction_is_a_number_within_its_limits(
    steps: list[tuple[int, float, float, tuple[float, float, float, float], bool, bool, bool]],
    use: int,
    ground: Ground,
) -> None:
    gains, state, now = RangeGains(use, 3.0), NO_RANGE_STATE, 0.0
    for sequence, age, reading, (x, z, roll, pitch), certain, jumped, flying in steps:
        now += 0.02
        at = vehicle(now, x_m=x, z_m=z, roll_rad=roll, pitch_rad=pitch, climb_mps=x)
        # A vehicle's angles are finite where anything is known of them: sines of inf raise.
        if not (isfinite(roll) and isfinite(pitch)):
            at = at._replace(roll_rad=nan, pitch_rad=nan)
        sample = RangeSample(sequence, now - age, reading)
        state, found = range_step(gains, ground, state, sample, at, certain, jumped, flying)
        assert isfinite(found.correction_m)
        assert -2.0 * gains.gate_m <= found.correction_m <= gains.gate_m
        assert isnan(found.bound_m) or abs(found.bound_m) < inf


def test_stamps_that_go_back_or_lie_ahead_are_refused() -> None:
    for time_s in (0.5, 1.0, 2.0):
        sensor = Sensor().fly(1.0)
        sample = RangeSample(99, time_s, HEIGHT_M)
        at = vehicle(sensor.time_s + 0.05)
        state, _ = range_step(CORRECTS, LEVEL, sensor.state, sample, at, True, False, True)
        assert state.standing == RANGE_INVALID

"""One fix and an estimate: accepted, refused or reset, against matrices and at each limit."""

from __future__ import annotations

from math import exp, inf, isnan, nan, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from samples import position_fix

from tgl_soar.estimation.fix_filter import Covariance, Errors
from tgl_soar.estimation.inertial_track import Node, new_track
from tgl_soar.estimation.motion_state import (
    NO_NOISE,
    NO_OFFSET,
    NO_OUTLIERS,
    FixNoise,
    FrameShift,
    LastFix,
    MotionGains,
    MotionState,
    Offset,
    Outliers,
    Reckoning,
    initial_motion,
)
from tgl_soar.estimation.position_fixes import NOISE_KEPT, take_fix
from tgl_soar.geometry import SoaringFrame, ned_from_soaring, ned_vector_from_soaring
from tgl_soar.types import STEPPED_SOURCE, PositionFix

FRAME = SoaringFrame(3.0, -4.0, 5.0, 2.0)
GAINS = MotionGains(
    fix_sd_m=0.01,
    velocity_sd_mps=0.05,
    force_sd_mps2=0.2,
    bias_sd_mps2=0.15,
    unknown_sd_mps2=3.0,
    fix_delay_s=0.0,
    fix_gate_m=0.5,
    reset_max_m=10.0,
    use_imu=True,
)
DENSITY = 2.0 * 3.0**2 * 0.1  # of an acceleration that is not measured
LAST_S = 1.0  # of the fix before
TRACK_V = (0.3, -0.2, 0.1)
ERRORS = Errors(
    time_s=LAST_S,
    x_m=0.4,
    y_m=-0.5,
    z_m=0.6,
    velocity_x_mps=-0.7,
    velocity_y_mps=0.8,
    climb_mps=0.9,
    bias_x_mps2=0.05,
    bias_y_mps2=-0.06,
    bias_z_mps2=0.07,
    covariance=Covariance(pp=4e-4, pv=3e-4, pb=-1e-5, vv=0.02, vb=-2e-4, bb=0.02),
)
NO_SPEED = (nan, nan, nan)
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, -0.48, 0.64))

Triple = tuple[float, float, float]
Floats = NDArray[np.float64]


def known(**changes: Any) -> MotionState:
    """An estimate with a fix at 1 s; its track goes straight on."""
    vx, vy, vz = TRACK_V
    state = initial_motion()._replace(
        track=new_track(0.0)._replace(velocity_x_mps=vx, velocity_y_mps=vy, climb_mps=vz),
        errors=ERRORS,
        fix=LastFix(sequence=1, time_s=LAST_S, source=4, sum=17.0, repeated=0),
        rejected=3,
    )
    return state._replace(**changes)


def uncertain(pp: float) -> MotionState:
    return known(errors=ERRORS._replace(covariance=ERRORS.covariance._replace(pp=pp)))


def place(errors: Errors, time_s: float) -> tuple[Floats, Floats]:
    """Position and velocity of an estimate of `known` at a time."""
    v = np.array(TRACK_V) + np.array(errors[4:7])
    at = np.array(errors[1:4]) + np.array(TRACK_V) * time_s
    return at + np.array(errors[4:7]) * (time_s - errors.time_s), v


def fix(
    time_s: float, where: Floats | Triple, speed: Floats | Triple = NO_SPEED, **changes: Any
) -> PositionFix:
    return position_fix(
        2,
        time_s,
        ned_from_soaring(FRAME, float(where[0]), float(where[1]), float(where[2])),
        ned_vector_from_soaring(FRAME, float(speed[0]), float(speed[1]), float(speed[2])),
        source=4,
    )._replace(**changes)


def off(
    state: MotionState, time_s: float, by: Floats | Triple, speed: Triple | None = None, **rest: Any
) -> PositionFix:
    """A fix so far from an estimate's place, with a velocity so far from its own."""
    where, v = place(state.errors, time_s)
    velocity = NO_SPEED if speed is None else v + np.array(speed)
    return fix(time_s, where + np.array(by), velocity, **rest)


def take(
    state: MotionState, new: PositionFix, gains: MotionGains = GAINS, now_s: float | None = None
) -> MotionState:
    now = new.time_s if now_s is None else now_s
    return take_fix(gains, FRAME, state, new, now)


def times(axis: Triple, size: float) -> Triple:
    return axis[0] * size, axis[1] * size, axis[2] * size


def matrix(c: Covariance) -> Floats:
    return np.array([[c.pp, c.pv, c.pb], [c.pv, c.vv, c.vb], [c.pb, c.vb, c.bb]])


def moments(p: Floats) -> list[float]:
    return [p[0, 0], p[0, 1], p[0, 2], p[1, 1], p[1, 2], p[2, 2]]


# --- the filter ---------------------------------------------------------------------------------


@pytest.mark.parametrize("inertial", [False, True])
@pytest.mark.parametrize("speed", [None, (0.05, -0.04, 0.03)])
def test_a_fix_is_taken_as_kalmans_equations_say(inertial: bool, speed: Triple | None) -> None:
    """F P Fᵀ + Q and two updates, by matrices of one axis: the axes are measured alike."""
    t = 0.2
    state = known(inertial=inertial)
    b = float(inertial)
    f = np.array([[1.0, t, -b * t * t / 2.0], [0.0, 1.0, -b * t], [0.0, 0.0, 1.0]])
    q = (0.2**2 * 0.005 if inertial else DENSITY) * np.array(
        [[t**3 / 3.0, t**2 / 2.0, 0.0], [t**2 / 2.0, t, 0.0], [0.0, 0.0, 0.0]]
    )
    g = np.array([t * t / 2.0, t, -1.0]) * b  # and the bias's own noise, by quadrature
    for s in np.linspace(0.0, t, 2001):
        g = np.array([-(s**2) / 2.0, -s, 1.0])
        q = q + b * 0.15**2 / 300.0 * np.outer(g, g) * t / 2001.0
    mean = f @ np.array([ERRORS[1:4], ERRORS[4:7], ERRORS[7:10]])
    p = f @ matrix(ERRORS.covariance) @ f.T + q
    track = np.array(TRACK_V)
    by = np.array([0.11, -0.12, 0.13])
    where = track * (LAST_S + t) + mean[0] + by
    v = track + mean[1]
    new = fix(LAST_S + t, where, NO_SPEED if speed is None else v + np.array(speed), sigma_m=0.02)
    scatter = p[0, 0] + 0.02**2
    gain = p[:, 0] / scatter
    mean, p = mean + np.outer(gain, by), p - np.outer(gain, p[0])
    if speed is not None:
        r = v + np.array(speed) - track - mean[1]
        gain = p[:, 1] / (p[1, 1] + 0.05**2)
        mean, p = mean + np.outer(gain, r), p - np.outer(gain, p[1])

    found = take(state, new)
    errors = found.errors
    assert errors.time_s == LAST_S + t
    assert errors[1:4] == pytest.approx(mean[0])
    assert errors[4:7] == pytest.approx(mean[1])
    assert errors[7:10] == pytest.approx(mean[2])
    assert errors.covariance == pytest.approx(moments(p), rel=1e-5)
    assert found.innovation[:3] == pytest.approx(by)
    assert found.innovation.nis == pytest.approx(by @ by / scatter, rel=1e-6)
    assert (found.fix.sequence, found.fix.time_s, found.fix.source) == (2, LAST_S + t, 4)
    assert (found.rejected, found.offset, found.outliers) == (3, NO_OFFSET, NO_OUTLIERS)
    assert isnan(found.jump_s)
    assert found.track == state.track


def test_a_sources_delay_is_taken_off_its_stamps() -> None:
    late = take(known(), off(known(), 1.2, (0.0, 0.0, 0.0)), GAINS._replace(fix_delay_s=0.15))
    assert late.errors.time_s == pytest.approx(1.05)
    assert late.fix.time_s == pytest.approx(1.05)
    # It says where the aircraft is going to be then: the innovation is that of 0.15 s.
    assert late.innovation[:3] == pytest.approx(0.15 * place(ERRORS, 1.0)[1])


@pytest.mark.parametrize(
    ("reported", "used"), [(nan, 0.01), (0.005, 0.01), (0.03, 0.03), (999.0, 999.0)]
)
def test_the_larger_of_the_reported_and_the_known_uncertainty_is_used(
    reported: float, used: float
) -> None:
    found = take(initial_motion(), fix(1.0, (1.0, 2.0, 3.0), sigma_m=reported))
    assert found.errors.covariance.pp == pytest.approx(used**2)


def test_what_a_frame_has_moved_by_is_taken_off() -> None:
    shift = FrameShift(1.0, -2.0, 3.0)
    found = take(known(shift=shift), off(known(), 1.1, (1.0, -2.0, 3.0)))
    assert found.innovation[:3] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert found.shift == shift


# --- what is refused as it is -------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {"north_m": nan},
        {"east_m": inf},
        {"down_m": nan},
        {"down_m": -inf},
        {"sigma_m": 1001.0},
        {"sigma_m": inf},
        {"time_s": LAST_S},  # not later
        {"time_s": 0.9},
        {"time_s": 1.16},  # of the future, at 1.1 s
    ],
)
def test_a_fix_that_is_no_number_or_not_in_order_is_counted_and_no_more(
    changes: dict[str, Any],
) -> None:
    state = known()
    found = take(state, off(state, 1.1, (0.0, 0.0, 0.0))._replace(**changes), now_s=1.1)
    assert found == state._replace(fix=state.fix._replace(sequence=2), rejected=4)


def test_a_stamp_may_be_five_hundredths_ahead() -> None:
    found = take(known(), off(known(), 1.149, (0.0, 0.0, 0.0)), now_s=1.1)
    assert found.errors.time_s == 1.149


@pytest.mark.parametrize(("time_s", "used"), [(1.19, False), (1.21, True)])
def test_of_a_time_that_the_track_has_forgotten_nothing_is_used(time_s: float, used: bool) -> None:
    track = known().track
    nodes: Any = tuple(Node._make((1.2 + 0.01 * i, *track[1:7])) for i in range(8))
    found = take(
        known(track=track._replace(nodes=nodes)), off(known(), time_s, (0.0, 0.0, 0.0)), now_s=1.3
    )
    assert (found.rejected == 3) == used


# --- the first ----------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", AXES)
def test_the_first_fix_is_where_the_aircraft_is(axis: Triple) -> None:
    """With its velocity up to 25 m/s; else at rest, give or take 2 m/s."""
    state = known()._replace(errors=initial_motion().errors, offset=Offset(1.0, 2.0, 3.0))
    where = np.array([7.0, 8.0, 9.0])
    for size, has in ((24.9, True), (-24.9, True), (25.1, False), (-25.1, False)):
        found = take(state, fix(1.5, where, times(axis, size)))
        errors = found.errors
        assert errors.time_s == 1.5
        assert np.array(errors[1:4]) + 1.5 * np.array(TRACK_V) == pytest.approx(where)
        v = np.array(times(axis, size)) if has else np.zeros(3)
        assert np.array(errors[4:7]) + np.array(TRACK_V) == pytest.approx(v)
        wanted = (0.01**2, 0.0, 0.0, 0.05**2 if has else 2.0**2, 0.0, 0.15**2)
        assert errors.covariance == pytest.approx(wanted)
        assert (found.offset, found.outliers, found.rejected) == (NO_OFFSET, NO_OUTLIERS, 3)
        assert found.fix.time_s == 1.5
        assert isnan(found.jump_s)


def test_of_the_past_the_bias_is_kept() -> None:
    lost = uncertain(1.0)
    found = take(lost, fix(1.1, (5.0, 5.0, 5.0)))
    assert found.errors[7:10] == ERRORS[7:10]
    assert found.errors.covariance.bb == ERRORS.covariance.bb
    none = ERRORS._replace(covariance=Covariance(pp=1.0, pv=0.0, pb=0.0, vv=1.0, vb=0.0, bb=0.0))
    unknown = take(known(errors=none), fix(1.1, (5.0, 5.0, 5.0)))
    assert unknown.errors.covariance.bb == pytest.approx(0.15**2)


@pytest.mark.parametrize(("sigma_m", "lost_pp"), [(0.01, 0.5**2 + 9e-4), (0.5, 0.25 + 9.0 * 0.25)])
def test_an_estimate_that_is_lost_is_reset_by_a_fix(sigma_m: float, lost_pp: float) -> None:
    """Beyond half a metre, and three standard deviations of the fix."""
    for factor, is_lost in ((0.99, False), (1.01, True)):
        state = uncertain(factor * lost_pp)
        found = take(state, off(state, LAST_S + 1e-6, (0.1, 0.1, 0.1), sigma_m=sigma_m), now_s=1.01)
        assert (found.jump_s == 1.01) == is_lost
        assert (found.errors.covariance.pv == 0.0) == is_lost
        assert isnan(found.innovation.x_m) == is_lost


# --- noise --------------------------------------------------------------------------------------

STEP = np.array([0.02, -0.01, 0.03])  # of the fix before, more than was estimated
LEFT = np.array([-0.01, 0.02, 0.005])  # of the same, when it had been taken in
NOISE = FixNoise(
    variance_m2=0.09,
    x_m=LEFT[0],
    y_m=LEFT[1],
    z_m=LEFT[2],
    step_x_m=STEP[0],
    step_y_m=STEP[1],
    step_z_m=STEP[2],
    step_m2=1e-4,
    step_s=0.01,
    turns=4,
)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("before_m2", "step_m2"), [(0.0, 1e-4), (0.09, 4e-4)])
def test_a_turn_beyond_five_sigmas_of_three_fixes_is_noise(
    axis: Triple, before_m2: float, step_m2: float
) -> None:
    time_s = LAST_S + 1e-4
    state = known(noise=NOISE._replace(variance_m2=before_m2, step_m2=step_m2))
    reach_m = 5.0 * sqrt(4e-4 + step_m2 + 6.0 * 0.01**2)
    for factor, is_detected in ((0.98, False), (1.02, True), (-0.98, False), (-1.02, True)):
        turn = np.array(times(axis, factor * reach_m))
        by = LEFT + STEP + turn
        found = take(state, off(state, time_s, by))
        # Of the first the others were as good as reported; else three are as bad.
        scatter_m2 = (factor * reach_m) ** 2 / (18.0 if before_m2 else 3.0) if is_detected else 0.0
        variance_m2 = max(NOISE_KEPT * before_m2, scatter_m2)
        assert found.noise.variance_m2 == pytest.approx(variance_m2)
        assert found.noise[4:7] == pytest.approx(STEP + turn)
        assert found.noise.step_m2 == pytest.approx(4e-4, rel=1e-3)
        assert found.noise.step_s == pytest.approx(1e-4)
        used_m2 = max(0.01**2, variance_m2)
        left = by * used_m2 / (4e-4 + used_m2)
        assert found.noise[1:4] == pytest.approx(left, rel=1e-3)
        pp = 4e-4 * used_m2 / (4e-4 + used_m2)
        assert found.errors.covariance.pp == pytest.approx(pp, rel=1e-3)
        assert found.innovation.nis == pytest.approx(by @ by / 5e-4, rel=1e-3)  # as the fix says


def test_noise_is_of_one_source_and_outliers_say_nothing_of_it() -> None:
    other = take(known(noise=NOISE), off(known(), 1.1, (0.1, 0.0, 0.0), source=5))
    assert (other.noise.variance_m2, other.noise[4:9]) == (0.0, (0.0, 0.0, 0.0, 0.0, 0.0))
    assert other.noise.turns == 0
    assert take(known(noise=NOISE), off(known(), 1.1, (3.0, 0.0, 0.0))).noise == NOISE
    quiet = NOISE._replace(variance_m2=0.0, turns=0)
    moved = known(noise=quiet, outliers=outliers(4, 1.05))
    shifted = take(moved, off(known(), 1.1, (2.0, 0.0, 0.0)))
    assert shifted.shift.x_m == pytest.approx(2.0)
    assert shifted.noise == NO_NOISE


@pytest.mark.parametrize(("inertial", "worst_mps2"), [(True, 15.0), (False, 60.0)])
@pytest.mark.parametrize(("step_s", "before_s"), [(0.1, 0.02), (0.02, 0.1)])
def test_what_an_acceleration_may_have_made_is_no_noise(
    inertial: bool, worst_mps2: float, step_s: float, before_s: float
) -> None:
    """Over the longer of two steps: 0.15 m with accelerometers, 0.6 m without."""
    covariance = Covariance(pp=1e-6, pv=0.0, pb=0.0, vv=1e-6, vb=0.0, bb=1e-6)
    gains = GAINS._replace(fix_gate_m=2.0, unknown_sd_mps2=0.01, force_sd_mps2=0.01)
    for factor, is_detected in ((0.98, False), (1.02, True)):
        state = known(
            inertial=inertial,
            errors=ERRORS._replace(
                covariance=covariance, bias_x_mps2=0.0, bias_y_mps2=0.0, bias_z_mps2=0.0
            ),
            noise=NO_NOISE._replace(step_s=before_s),
        )
        time_s = LAST_S + step_s
        by = (0.0, factor * worst_mps2 * 0.01, 0.0)
        found = take(state, off(state, time_s, by), gains)
        assert found.rejected == 3
        assert (found.noise.variance_m2 > 0.0) == is_detected


def test_what_says_the_same_again_says_nothing_of_noise() -> None:
    state = known(noise=NOISE)
    new = off(state, 1.1, (0.2, 0.0, 0.0))
    again = take(state._replace(fix=state.fix._replace(sum=sum_of(new))), new)
    assert again.fix.repeated == 1
    assert again.noise == NOISE._replace(variance_m2=NOISE_KEPT * NOISE.variance_m2)
    assert take(state, new).noise.step_s == pytest.approx(0.1)


def sum_of(new: PositionFix) -> float:
    return take(known(), new).fix.sum


def test_noise_widens_the_gate_by_half_of_it_at_most() -> None:
    for variance_m2, reach_m in ((0.04, 5.0 * sqrt(5e-4 + 0.04)), (9.0, 5.0 * sqrt(5e-4 + 0.0625))):
        for factor, is_out in ((0.98, False), (1.02, True)):
            state = known(noise=NOISE._replace(variance_m2=variance_m2))
            found = take(state, off(state, LAST_S + 1e-4, (factor * reach_m, 0.0, 0.0)))
            assert (found.rejected == 4) == is_out


def test_where_fixes_scatter_no_frame_is_taken_for_moved() -> None:
    noise = NOISE._replace(variance_m2=4e-4)
    state = known(noise=noise, outliers=outliers(4, 1.05))
    found = take(state, off(state, 1.1, (2.0, 0.0, 0.0)))
    assert found.shift == known().shift
    assert found.jump_s == 1.1
    # A single one hinders nothing.
    found = take(state._replace(noise=noise._replace(turns=3)), off(state, 1.1, (2, 0, 0)))
    assert found.shift.x_m == pytest.approx(2.0)
    assert isnan(found.jump_s)


@pytest.mark.parametrize("axis", AXES)
def test_turns_are_counted_while_the_noise_counts(axis: Triple) -> None:
    """Until its variance is no more than a fix's own."""
    turn_m = 5.0 * sqrt(4e-4 + 1e-4 + 6.0 * 0.01**2)
    counts_m2, over_m2 = 1.02 * 0.01**2, 0.98 * 0.01**2
    for before_m2, before, factor, turns in (
        (over_m2, 0, 1.02, 1),  # the first
        (over_m2, 0, 0.98, 0),  # none
        (counts_m2, 1, 1.02, 2),
        (counts_m2 / NOISE_KEPT, 2, 0.98, 2),
        (over_m2 / NOISE_KEPT, 2, 0.98, 0),  # it has faded
    ):
        state = known(noise=NOISE._replace(variance_m2=before_m2, turns=before))
        by = LEFT + STEP + np.array(times(axis, factor * turn_m))
        assert take(state, off(state, LAST_S + 1e-4, by)).noise.turns == turns


@pytest.mark.parametrize(("factor", "turns"), [(1.02, 4), (0.98, 0)])
def test_what_says_the_same_again_lets_noise_fade(factor: float, turns: int) -> None:
    state = known(noise=NOISE._replace(variance_m2=factor * 0.01**2 / NOISE_KEPT))
    new = off(state, 1.1, (0.2, 0.0, 0.0))
    again = take(state._replace(fix=state.fix._replace(sum=sum_of(new))), new)
    assert again.noise.turns == turns


def test_the_velocity_of_what_scatters_counts_as_much_less() -> None:
    """By matrices: both variances are as many times more."""
    state = known(noise=NOISE._replace(x_m=0.1, y_m=0.0, z_m=0.0, step_x_m=0.0))
    new = off(state, LAST_S + 1e-4, (0.1, 0.0, 0.0), (0.2, 0.0, 0.0))
    scatter_m2 = NOISE_KEPT * 0.09
    p = matrix(ERRORS.covariance)
    p = p - np.outer(p[:, 0], p[0]) / (p[0, 0] + scatter_m2)
    p = p - np.outer(p[:, 1], p[1]) / (p[1, 1] + 0.05**2 * scatter_m2 / 0.01**2)
    assert take(state, new).errors.covariance == pytest.approx(moments(p), rel=2e-2)


# --- outliers -----------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("sigma_m", "reach_m"), [(0.01, 0.5), (0.2, 5.0 * sqrt(0.2**2 + 4e-4))])
def test_an_outlier_is_beyond_gate_and_five_sigmas(
    axis: Triple, sigma_m: float, reach_m: float
) -> None:
    state = known()
    time_s = LAST_S + 1e-4
    for factor, is_out in ((0.98, False), (1.02, True), (-0.98, False), (-1.02, True)):
        by = times(axis, factor * reach_m)
        found = take(state, off(state, time_s, by, sigma_m=sigma_m, source=4))
        assert found.innovation[:3] == pytest.approx(by)
        scatter = 4e-4 + sigma_m**2
        assert found.innovation.nis == pytest.approx((factor * reach_m) ** 2 / scatter, rel=1e-3)
        assert (found.rejected == 4) == is_out
        assert (found.errors == state.errors) == is_out
        if not is_out:
            assert found.outliers == NO_OUTLIERS
            continue
        assert found.outliers[:3] == (1, time_s, False)
        assert found.outliers[3:6] == pytest.approx(by)
        # What was used last stays what it was, and the look at this one is kept.
        assert found.fix == LastFix(
            sequence=2, time_s=LAST_S, source=4, sum=found.fix.sum, repeated=0
        )


def test_an_outlier_of_another_source_leaves_the_first_one_in_use() -> None:
    found = take(known(), off(known(), 1.1, (2.0, 0.0, 0.0), source=5))
    assert found.fix.source == 4
    assert found.rejected == 4


def outliers(count: int, last_s: float, **changes: Any) -> Outliers:
    """So many of 2 m upstream of where the estimate is, without a gap before them."""
    usual = NO_OUTLIERS._replace(in_a_row=count, time_s=last_s, x_m=2.0, y_m=0.0, z_m=0.0)
    last = usual._replace(**changes)
    first = {"first_x_m": last.x_m, "first_y_m": last.y_m, "first_z_m": last.z_m}
    return last._replace(**({"first_s": last_s - 0.04} | first | changes))


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("wait_s", [0.1, 0.3])
def test_outliers_agree_within_the_gate_and_5_mps_since_the_last(
    axis: Triple, wait_s: float
) -> None:
    near_m = 0.5 + 5.0 * wait_s
    for factor, agrees in ((0.98, True), (1.02, False), (-0.98, True), (-1.02, False)):
        apart = times(axis, factor * near_m)
        state = known(outliers=outliers(2, 1.1, x_m=20.0, y_m=20.0, z_m=20.0))
        by = np.array([20.0, 20.0, 20.0]) + apart
        found = take(state, off(state, 1.1 + wait_s, by))
        assert found.outliers.in_a_row == (3 if agrees else 1)
        assert found.outliers.time_s == 1.1 + wait_s
        assert found.outliers[3:6] == pytest.approx(by)


def test_an_outlier_that_comes_again_over_another_link_counts_once() -> None:
    for before in (1, 2):
        state = known(outliers=outliers(before, 1.1))
        for time_s, more in ((1.1, 0), (1.05, 0), (1.11, 1)):
            found = take(state, off(state, time_s, (2.0, 0.0, 0.0)))
            assert found.outliers.in_a_row == before + more
            assert found.rejected == 4
    # Of none before there is no time to compare with.
    none = known(outliers=outliers(0, 9.0))
    assert take(none, off(none, 1.1, (2.0, 0.0, 0.0))).outliers.in_a_row == 1


@pytest.mark.parametrize(
    ("before", "gap"),
    [
        ({"time_s": 0.61}, False),
        ({"time_s": 0.59}, True),
        ({"time_s": nan}, True),
        ({"repeated": 1, "sum": 0.0}, False),
    ],
)
def test_half_a_second_without_a_fix_is_a_gap(before: dict[str, Any], gap: bool) -> None:
    state = known()
    state = state._replace(fix=state.fix._replace(**before))
    assert take(state, off(state, 1.1, (2.0, 0.0, 0.0))).outliers.gap == gap


@pytest.mark.parametrize(("repeated", "gap"), [(2, False), (3, True)])
def test_a_source_that_repeated_itself_three_times_was_a_gap(repeated: int, gap: bool) -> None:
    state = known()
    state = state._replace(fix=state.fix._replace(repeated=repeated))
    assert take(state, off(state, 1.1, (2.0, 0.0, 0.0))).outliers.gap == gap


@pytest.mark.parametrize(("since_s", "gap"), [(1.99, True), (2.01, False), (nan, False)])
def test_for_two_seconds_after_dead_reckoning_it_is_a_gap(since_s: float, gap: bool) -> None:
    state = known(reckoning=Reckoning(0.0, 1.1 - since_s, False))
    assert take(state, off(state, 1.1, (2.0, 0.0, 0.0))).outliers.gap == gap


def test_a_gap_before_the_first_outlier_is_one_for_those_that_agree_with_it() -> None:
    state = known(outliers=outliers(2, 1.09, gap=True))
    assert take(state, off(state, 1.1, (2.0, 0.0, 0.0))).outliers.gap
    assert not take(state, off(state, 1.1, (0.0, 0.0, 5.0))).outliers.gap  # another first one
    # And none before it is none, though there be no fix by then.
    state = known(outliers=outliers(2, 1.09))
    state = state._replace(fix=state.fix._replace(time_s=0.1))
    assert not take(state, off(state, 1.1, (2.0, 0.0, 0.0))).outliers.gap


# --- the fifth ----------------------------------------------------------------------------------


def fifth(
    by: Triple = (2.0, 0.5, -0.5),
    speed: Triple | None = (0.0, 0.0, 0.0),
    gains: MotionGains = GAINS,
    **before: Any,
) -> MotionState:
    """After a fifth outlier that agrees with four."""
    x, y, z = by
    state = known(outliers=outliers(4, 1.09, x_m=x, y_m=y, z_m=z))
    state = state._replace(**before)
    return take(state, off(state, 1.1, by, speed), gains, now_s=1.12)


def test_four_are_refused() -> None:
    state = known(outliers=outliers(3, 1.09))
    assert take(state, off(state, 1.1, (2.0, 0.0, 0.0))).rejected == 4


def test_the_estimate_goes_on_where_the_source_has_moved() -> None:
    by = (2.0, 0.5, -0.5)
    found = fifth(by)
    assert found.shift == pytest.approx(by)
    where, v = place(ERRORS, 1.1)
    assert place(found.errors, 1.1)[0] == pytest.approx(where)
    assert place(found.errors, 1.1)[1] == pytest.approx(v)
    assert found.innovation[:3] == pytest.approx(by)
    assert (found.rejected, found.outliers, found.fix.time_s) == (3, NO_OUTLIERS, 1.1)
    assert isnan(found.jump_s)
    assert found.errors.covariance.pp < ERRORS.covariance.pp  # and it is a fix


def test_where_the_aircraft_may_have_moved_the_estimate_begins_again() -> None:
    by = (2.0, 0.5, -0.5)
    found = fifth(by, gains=GAINS._replace(reset_max_m=0.0))
    assert found.jump_s == 1.12
    assert found.shift == FrameShift(0.0, 0.0, 0.0)
    assert place(found.errors, 1.1)[0] == pytest.approx(place(ERRORS, 1.1)[0] + by)
    assert found.innovation[:3] == pytest.approx(by)
    assert (found.rejected, found.outliers) == (3, NO_OUTLIERS)
    gap = outliers(4, 1.09, x_m=2.0, y_m=0.5, z_m=-0.5, gap=True)
    assert fifth(by, outliers=gap).jump_s == 1.12


def test_for_two_seconds_after_an_estimate_went_astray_no_frame_is_taken_for_moved() -> None:
    """fifth: at 1.12 s.  A jump after silence, or of what is switched off, is none."""
    assert fifth(astray_s=1.12 - 2.02, jump_s=1.1).shift.x_m == pytest.approx(2.0)
    found = fifth(astray_s=1.12 - 1.98)
    assert found.shift == FrameShift(0.0, 0.0, 0.0)
    assert (found.jump_s, found.astray_s) == (1.12, 1.12)


@pytest.mark.parametrize("axis", AXES)
def test_of_what_noise_leaves_no_frame_is_moved_by_an_estimate_that_goes_away(axis: Triple) -> None:
    """From the first outlier to the fifth by more than 0.3 m/s, and than two fixes scatter."""
    by = np.array((2.0, 0.5, -0.5))
    reach_m = 0.3 * 0.05 + 5.0 * sqrt(2.0) * 0.01
    for counts_m2, factor, moved in (
        (1.02 * 0.01**2, 0.98, True),
        (1.02 * 0.01**2, 1.02, False),
        (0.98 * 0.01**2, 1.02, True),  # fixes have held it
    ):
        x, y, z = by - np.array(times(axis, factor * reach_m))
        first = {"first_s": 1.05, "first_x_m": x, "first_y_m": y, "first_z_m": z}
        state = known(
            outliers=outliers(4, 1.09, x_m=2.0, y_m=0.5, z_m=-0.5, **first),
            noise=NOISE._replace(variance_m2=counts_m2, turns=0),
        )
        found = take(state, off(state, 1.1, by))
        assert (found.shift.x_m > 1.0) == moved
        assert isnan(found.jump_s) == isnan(found.astray_s) == moved


def test_the_first_of_outliers_is_remembered_until_another_does_not_agree() -> None:
    state = known(outliers=outliers(2, 1.09, first_x_m=1.9, first_y_m=0.1, first_z_m=-0.1))
    found = take(state, off(state, 1.1, (2.0, 0.0, 0.0))).outliers
    assert found[6:] == pytest.approx((1.05, 1.9, 0.1, -0.1))
    found = take(state, off(state, 1.1, (0.1, 0.2, 5.0))).outliers
    assert found[6:] == pytest.approx((1.1, 0.1, 0.2, 5.0))


@pytest.mark.parametrize("axis", AXES)
def test_a_frame_moves_so_far_in_all(axis: Triple) -> None:
    """Each axis counts: what was and what is new."""
    before = FrameShift(*times(axis, 3.0))
    for size, moves in ((0.98, True), (1.02, False), (-0.98, True)):
        by = times(axis, size * 4.0)
        state = known(outliers=outliers(4, 1.09, x_m=by[0], y_m=by[1], z_m=by[2]), shift=before)
        where = np.array(by) + np.array(before)
        new = off(state, 1.1, where, (0.0, 0.0, 0.0))
        found = take(state, new, GAINS._replace(reset_max_m=7.0))
        assert isnan(found.jump_s) == moves
        wanted = np.array(before) + np.array(by) * moves
        assert np.array(found.shift) == pytest.approx(wanted)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("vv", "gate_mps"), [(1e-6, 1.0), (0.25, 5.0 * sqrt(0.25 + 0.05**2))])
def test_a_moved_frame_has_the_estimated_velocity(axis: Triple, vv: float, gate_mps: float) -> None:
    covariance = ERRORS.covariance._replace(vv=vv, pv=0.0, vb=0.0)
    certain = GAINS._replace(unknown_sd_mps2=1e-9)
    for factor, moves in ((0.99, True), (1.01, False), (-0.99, True), (-1.01, False)):
        errors = ERRORS._replace(covariance=covariance)
        found = fifth(speed=times(axis, factor * gate_mps), gains=certain, errors=errors)
        assert isnan(found.jump_s) == moves
    assert isnan(fifth(speed=None, gains=certain).jump_s)  # a fix without one contradicts nothing


# --- velocities ---------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("vv", "gate_mps"), [(1e-6, 1.0), (0.25, 5.0 * sqrt(0.25 + 0.05**2))])
def test_a_velocity_too_far_off_is_left_out_and_the_place_is_taken(
    axis: Triple, vv: float, gate_mps: float
) -> None:
    covariance = ERRORS.covariance._replace(vv=vv, pv=0.0, vb=0.0)
    state = known(errors=ERRORS._replace(covariance=covariance))
    certain = GAINS._replace(unknown_sd_mps2=1e-9)
    alone = take(state, off(state, LAST_S + 1e-6, (0.01, 0.0, 0.0)), certain)
    for factor, used in ((0.99, True), (1.01, False), (-0.99, True), (-1.01, False)):
        new = off(state, LAST_S + 1e-6, (0.01, 0.0, 0.0), times(axis, factor * gate_mps))
        found = take(state, new, certain)
        assert found.rejected == 3
        assert (found.errors == alone.errors) != used


# --- origins of other sources -------------------------------------------------------------------


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("pp", [1e-4, 0.04])
def test_a_new_source_s_difference_is_its_offset_as_far_as_the_filter_is_certain(
    axis: Triple, pp: float
) -> None:
    """Of two Gaussians, origins' and the filter's own, each has its part of the variance."""
    state = uncertain(pp)._replace(offset=Offset(0.5, 0.5, 0.5))  # of the source before
    by = np.array(times(axis, 0.4))
    found = take(state, off(state, LAST_S + 1e-6, by, source=5))
    scatter = pp + 0.01**2
    origins = np.linalg.solve(np.eye(3) * (0.3**2 + scatter), 0.3**2 * by)
    assert np.array(found.offset) == pytest.approx(origins, rel=1e-4)
    assert np.array(found.innovation[:3]) == pytest.approx(by - origins, rel=1e-3)
    left = float(np.linalg.norm(by - origins))
    assert found.innovation.nis == pytest.approx(left**2 / scatter, rel=1e-3)
    assert found.fix.source == 5
    assert found.rejected == 3


@pytest.mark.parametrize(("size", "used"), [(0.89, True), (0.91, False)])
def test_origins_are_nine_tenths_apart_at_most(size: float, used: bool) -> None:
    for axis in AXES:
        found = take(known(), off(known(), 1.1, times(axis, size), source=5))
        assert (found.rejected == 3) == used
        assert (found.fix.source == 5) == used
        assert (found.offset != NO_OFFSET) == used
    assert take(known(), off(known(), 1.1, (0.89, 0.0, 0.0), source=4)).rejected == 4


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(
    ("size_m", "left"),
    [
        (0.10, exp(-0.1 / 5.0)),  # as a fraction of what is there, in 5 s
        (0.40, 1.0 - 0.05 * 0.1 / 0.40),  # and no faster than 5 cm/s
        (1.1e-4, exp(-0.1 / 5.0)),
        (0.9e-4, 0.0),  # of so little nothing is left
    ],
)
def test_an_offset_is_removed_slowly_and_the_place_slides_over(
    axis: Triple, size_m: float, left: float
) -> None:
    offset = np.array(times(axis, size_m))
    state = known(offset=Offset(*times(axis, size_m)))
    found = take(state, off(state, 1.1, offset))
    assert np.array(found.innovation[:3]) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.array(found.offset) == pytest.approx(left * offset)
    where, v = place(ERRORS, 1.1)
    slid, same = place(found.errors, 1.1)
    assert slid == pytest.approx(where + (1.0 - left) * offset)
    assert same == pytest.approx(v)


def test_the_same_numbers_again_are_counted() -> None:
    state = known()
    one = off(state, 1.1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for changes, repeated in (
        ({}, 1),
        ({"sequence": 9, "source": 4}, 1),
        ({"north_m": one.north_m + 0.01}, 0),
        ({"east_m": one.east_m + 0.01}, 0),
        ({"down_m": one.down_m + 0.01}, 0),
        ({"velocity_north_mps": one.velocity_north_mps + 0.01}, 0),
        ({"velocity_east_mps": one.velocity_east_mps + 0.01}, 0),
        ({"velocity_down_mps": one.velocity_down_mps + 0.01}, 0),
    ):
        first = take(state, one)
        assert first.fix.repeated == 0
        again = take(first, one._replace(time_s=1.2, **changes))
        assert again.fix.repeated == repeated
        third = take(again, one._replace(time_s=1.3, **changes))
        assert third.fix.repeated == repeated + 1
    # Without velocities their places show it.
    still = off(state, 1.1, (0.0, 0.0, 0.0))
    assert take(take(state, still), still._replace(time_s=1.2)).fix.repeated == 1


def test_who_moves_does_not_take_in_the_same_numbers_again() -> None:
    """The estimate goes on as if none had come, and the last fix is as old as it is."""
    state = known()
    one = off(state, 1.1, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))
    first = take_fix(GAINS, FRAME, state, one, 1.1, moves=True)
    assert first == take(state, one)
    for k in (1, 2, 3):
        again = one._replace(sequence=2 + k, time_s=1.1 + 0.1 * k)
        found = take_fix(GAINS, FRAME, first, again, again.time_s, moves=True)
        fix_now = first.fix._replace(sequence=2 + k, repeated=k)
        assert found == first._replace(fix=fix_now)
        first = found
    other = off(state, 1.5, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))
    taken = take_fix(GAINS, FRAME, first, other, 1.5, moves=True)
    assert taken.fix.time_s == 1.5
    assert taken.fix.repeated == 0
    assert taken.errors.time_s == 1.5


def test_of_a_source_with_steps_the_same_numbers_again_are_taken_in() -> None:
    """A hover repeats them, and without them the estimate would know less and less."""
    state = known()
    one = off(state, 1.1, (0.01, 0.0, 0.0), (0.0, 0.0, 0.0))._replace(source=STEPPED_SOURCE)
    state = state._replace(fix=state.fix._replace(source=STEPPED_SOURCE))
    first = take_fix(GAINS, FRAME, state, one, 1.1, moves=True)
    again = one._replace(sequence=3, time_s=1.2)
    found = take_fix(GAINS, FRAME, first, again, 1.2, moves=True)
    assert found == take(first, again)
    assert found.fix.repeated == 1
    assert found.errors.time_s == found.fix.time_s == 1.2


@pytest.mark.parametrize("seed", range(5))
def test_no_steps_of_a_centimetre_cancel(seed: int) -> None:
    """One north and one back east are no repetition, in places or velocities."""
    rng = np.random.default_rng(seed)
    names = [f"{axis}_m" for axis in ("north", "east", "down")]
    names += [f"velocity_{axis}_mps" for axis in ("north", "east", "down")]
    pairs = [np.eye(6, dtype=int)[i] - np.eye(6, dtype=int)[j] for i in range(6) for j in range(6)]
    for change in [*pairs, *rng.integers(-2, 3, (160, 6))]:
        steps = rng.integers(-40, 40, 6)
        other = steps + change
        fixes = []
        for k, each in enumerate((steps, other)):
            numbers: dict[str, Any] = dict(zip(names, (0.01 * each).tolist(), strict=True))
            fixes.append(fix(1.1 + 0.1 * k, (0.0, 0.0, 0.0))._replace(**numbers))
        found = take(take(known(), fixes[0]), fixes[1])
        assert (found.fix.repeated > 0) == bool((steps == other).all())


def test_places_that_move_are_no_repetition_whatever_their_velocities_are() -> None:
    """What moves north as fast as the velocity falls would cancel, were they subtracted."""
    one = fix(1.1, place(ERRORS, 1.1)[0], (1.0, 1.0, 1.0))
    for axis in ("north", "east", "down"):
        place_of, speed_of = f"{axis}_m", f"velocity_{axis}_mps"
        changes: dict[str, Any] = {
            place_of: getattr(one, place_of) + 0.125,
            speed_of: getattr(one, speed_of) + 0.125,
        }
        found = take(take(known(), one), one._replace(time_s=1.2, **changes))
        assert found.fix.repeated == 0


@pytest.mark.parametrize(
    ("before", "reckoned", "after"),
    [
        # The first of a stretch, and the next.
        (Reckoning(nan, nan, False), True, Reckoning(1.1, 1.1, True)),
        (Reckoning(0.2, 1.0, True), True, Reckoning(0.2, 1.1, True)),
        # One that is measured ends it; what is known of it is kept.
        (Reckoning(0.2, 1.0, True), False, Reckoning(0.2, 1.0, False)),
        (Reckoning(0.2, 1.0, False), False, Reckoning(0.2, 1.0, False)),
        # Soon after that it goes on, without what was measured in between.
        (Reckoning(-3.0, -0.8, False), True, Reckoning(-1.1, 1.1, True)),
        (Reckoning(-3.0, -1.0, False), True, Reckoning(1.1, 1.1, True)),
        # And after a silence, or a clock that has gone back, it is another one.
        (Reckoning(-3.0, -0.8, True), True, Reckoning(-3.0, 1.1, True)),
        (Reckoning(-3.0, -1.0, True), True, Reckoning(1.1, 1.1, True)),
        (Reckoning(0.2, 1.2, True), True, Reckoning(1.1, 1.1, True)),
    ],
)
def test_stretches_of_dead_reckoning(before: Reckoning, reckoned: bool, after: Reckoning) -> None:
    state = known(reckoning=before)
    found = take(state, off(state, 1.1, (0.0, 0.0, 0.0), reckoned=reckoned))
    assert found.reckoning[:2] == pytest.approx(after[:2], nan_ok=True)
    assert found.reckoning.now == after.now

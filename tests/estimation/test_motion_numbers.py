"""One tick of the estimator of motion: which samples count, how long, and what is reported."""

from __future__ import annotations

from math import inf, isnan, nan
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from samples import attitude_sample, imu_sample
from scipy.spatial.transform import Rotation
from test_position_fixes import ERRORS, FRAME, GAINS, TRACK_V, fix, known, place

from tgl_soar.estimation.attitude_track import NO_ATTITUDE_TRACK
from tgl_soar.estimation.fix_filter import Covariance
from tgl_soar.estimation.inertial_track import new_track
from tgl_soar.estimation.motion import (
    is_imu_valid,
    motion_quality,
    motion_step,
    unshifted,
)
from tgl_soar.estimation.motion_state import (
    FrameShift,
    Innovation,
    LastAttitude,
    LastImu,
    MotionGains,
    MotionState,
    Offset,
    Reckoning,
    covariance_at,
    initial_motion,
)
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.types import (
    GRAVITY_MPS2,
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    MotionQuality,
    PositionFix,
    VehicleState,
)

Triple = tuple[float, float, float]
Floats = NDArray[np.float64]
SILENT = AutopilotStatus(time_s=nan, accepts_surfaces=False, armed=False)
ANGLES = (0.3, -0.2, 0.5)
NOW_S = 1.2


def attitude(time_s: float, angles: Triple = ANGLES, sequence: int = 2) -> AttitudeSample:
    """Angles in the soaring frame, at rest."""
    roll, pitch, heading = angles
    q = quaternion_from_euler(roll, pitch, FRAME.wind_from_rad + heading)
    return attitude_sample(sequence, time_s, q)


def imu(time_s: float, force: Triple = (0.1, 0.2, -9.8), sequence: int = 2) -> ImuSample:
    return imu_sample(sequence, time_s, force, (nan, nan, nan))


def inputs(
    now_s: float = NOW_S,
    *,
    position: PositionFix = NO_FIX,
    attitude: AttitudeSample = NO_ATTITUDE,
    imu: ImuSample = NO_IMU,
) -> Inputs:
    return Inputs(
        time_s=now_s,
        position=position,
        attitude=attitude,
        autopilot=SILENT,
        engage=False,
        imu=imu,
    )


def flown(**changes: Any) -> MotionState:
    """`known`, with an attitude, where nothing is new."""
    state = known()
    track = NO_ATTITUDE_TRACK._replace(
        time_s=1.19, roll_rad=ANGLES[0], pitch_rad=ANGLES[1], heading_rad=ANGLES[2],
        roll_rate_radps=0.0, pitch_rate_radps=0.0, heading_rate_radps=0.0,
    )  # fmt: skip
    usual: dict[str, Any] = {
        "attitude_track": track,
        "fix": state.fix._replace(sequence=0),
        "track": state.track._replace(time_s=1.19),
    }
    return state._replace(**(usual | changes))


def tick(
    state: MotionState, now_s: float = NOW_S, gains: MotionGains = GAINS, **new: Any
) -> tuple[MotionState, VehicleState]:
    return motion_step(gains, FRAME, state, inputs(now_s, **new))


# --- accelerations ------------------------------------------------------------------------------


def steady(**changes: Any) -> MotionState:
    """Accelerations are in use, the last one 5 ms ago."""
    usual: dict[str, Any] = {
        "inertial": True,
        "switched_s": 0.5,
        "imu": LastImu(1, 1.195, 0.5, 0.005),
    }
    return flown(**(usual | changes))


@pytest.mark.parametrize("angles", [ANGLES, (-0.7, 0.4, -1.1), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("force", [(1.0, 2.0, -3.0), (-4.0, 0.5, -9.0)])
def test_a_force_is_turned_and_gravity_taken_off_as_scipy_does(
    angles: Triple, force: Triple
) -> None:
    """FRD to an upwind-right-down frame; downstream is against upwind, and up against down."""
    roll, pitch, heading = angles
    turned = Rotation.from_euler("ZYX", (heading, pitch, roll)).apply(force)
    wanted = (-turned[0], turned[1], -turned[2] - GRAVITY_MPS2)
    track = flown().attitude_track._replace(
        time_s=1.19, roll_rad=roll, pitch_rad=pitch, heading_rad=heading
    )
    state, _ = tick(steady(attitude_track=track), imu=imu(1.198, force))
    assert state.track[7:10] == pytest.approx(wanted)
    assert state.track.time_s == 1.198
    # Of an attitude that turns, that of the sample's own time counts.
    turning = track._replace(
        roll_rad=roll - 0.008 * 2.0, roll_rate_radps=2.0,
        pitch_rad=pitch + 0.008 * 3.0, pitch_rate_radps=-3.0,
        heading_rad=heading - 0.008 * 4.0, heading_rate_radps=4.0,
    )  # fmt: skip
    state, _ = tick(steady(attitude_track=turning), imu=imu(1.198, force))
    assert state.track[7:10] == pytest.approx(wanted)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("value", "is_force"),
    [(199.0, True), (-199.0, True), (201.0, False), (-201.0, False), (nan, False), (inf, False)],
)
def test_of_twenty_g_nothing_soars(axis: int, value: float, is_force: bool) -> None:
    force = [0.1, 0.2, -9.8]
    force[axis] = value
    before = steady()
    state, _ = tick(before, imu=imu(1.198, (force[0], force[1], force[2])))
    assert state.rejected == (3 if is_force else 4)
    assert state.imu.sequence == 2
    assert (state.imu.time_s == 1.198) == is_force
    if not is_force:
        assert state.imu == before.imu._replace(sequence=2)


@pytest.mark.parametrize(
    ("time_s", "taken"), [(1.195, False), (1.1951, True), (1.249, True), (1.251, False)]
)
def test_an_acceleration_is_later_than_the_last_and_not_of_the_future(
    time_s: float, taken: bool
) -> None:
    state, _ = tick(steady(), imu=imu(time_s))
    assert (state.rejected == 3) == taken


@pytest.mark.parametrize(("interval_s", "counts"), [(0.054, True), (0.056, False)])
def test_accelerations_are_counted_on_where_they_come_often_enough(
    interval_s: float, counts: bool
) -> None:
    before = steady(imu=LastImu(1, 1.198 - interval_s, 0.5, 0.005))
    state, _ = tick(before, imu=imu(1.198))
    assert state.imu.since_s == (0.5 if counts else 1.198)
    average = 0.005 + 0.02 * (interval_s - 0.005) if counts else 0.005
    assert state.imu.interval_s == pytest.approx(average)


@pytest.mark.parametrize(("since_s", "begins"), [(0.099, False), (0.101, True)])
def test_they_are_used_once_they_have_come_for_a_tenth(since_s: float, begins: bool) -> None:
    before = flown(imu=LastImu(1, 1.195, 1.198 - since_s, 0.005))
    state, _ = tick(before, imu=imu(1.198))
    assert state.inertial == begins
    assert state.imu == pytest.approx((2, 1.198, 1.198 - since_s, 0.005 - 0.02 * 0.002))
    if begins:
        # Until then it has gone straight on, and from then on they move it.
        assert state.track[1:4] == pytest.approx([v * 0.008 for v in TRACK_V])
        assert state.track[4:7] == pytest.approx(TRACK_V)
        assert state.switched_s == 1.198
        assert not isnan(state.track.ax_mps2)


@pytest.mark.parametrize("use", [True, False])
@pytest.mark.parametrize(("age_s", "kept"), [(0.079, True), (0.081, False)])
def test_they_are_done_without_once_the_last_is_eight_hundredths_old(
    age_s: float, kept: bool, use: bool
) -> None:
    track = known().track._replace(time_s=NOW_S - age_s, ax_mps2=1.0)
    before = steady(track=track, imu=LastImu(1, NOW_S - age_s, 0.5, 0.005))
    state, _ = tick(before, gains=GAINS._replace(use_imu=use))
    assert state.inertial == (kept and use)
    if not state.inertial:
        assert state.track.time_s == NOW_S
        assert state.track[7:10] == (0.0, 0.0, 0.0)
        assert state.switched_s == NOW_S - age_s


@pytest.mark.parametrize(
    ("time_s", "turned_s", "counts"),
    [
        (1.121, 1.12, True),
        (1.119, 1.12, False),  # 0.081 s old
        (1.198, 1.099, True),
        (1.198, 1.097, False),  # the attitude is more than a tenth older
    ],
)
def test_an_acceleration_counts_while_it_and_the_attitude_are_of_now(
    time_s: float, turned_s: float, counts: bool
) -> None:
    track = flown().attitude_track._replace(time_s=turned_s)
    before = steady(
        attitude_track=track,
        imu=LastImu(1, time_s - 0.005, 0.5, 0.005),
        track=known().track._replace(time_s=time_s - 0.005),
    )
    state, _ = tick(before, imu=imu(time_s))
    assert state.imu.since_s == (0.5 if counts else time_s)
    assert (state.track.ax_mps2 != 0.0) == counts


@pytest.mark.parametrize(
    ("before_s", "after_s", "valid"),
    [
        (1.19, 1.19, False),
        (1.19, 1.121, True),
        (1.11, 1.119, False),
        (nan, 1.15, True),
        (1.1, nan, False),
    ],
)
def test_accelerations_of_this_tick_are_new_and_of_now(
    before_s: float, after_s: float, valid: bool
) -> None:
    before = flown(imu=LastImu(1, before_s, 0.5, 0.005))
    after = flown(imu=LastImu(2, after_s, 0.5, 0.005))
    assert is_imu_valid(before, after, NOW_S) == valid


# --- the errors when they come and go -----------------------------------------------------------


@pytest.mark.parametrize("begins", [True, False])
def test_uncertainty_grows_by_the_model_that_holds_on_each_side(begins: bool) -> None:
    """From the fix at 1 s to the change, and on from there: by matrices, in steps."""
    before = flown(imu=LastImu(1, 1.195, 0.9, 0.005))
    if begins:
        state, vehicle = tick(before, imu=imu(1.198))
    else:
        state, vehicle = tick(steady(track=known().track._replace(time_s=1.1)))
    changed_s = 1.198 if begins else 1.1
    assert (state.inertial, state.switched_s) == (begins, changed_s)
    p = np.array(
        [
            [ERRORS.covariance.pp, ERRORS.covariance.pv, ERRORS.covariance.pb],
            [ERRORS.covariance.pv, ERRORS.covariance.vv, ERRORS.covariance.vb],
            [ERRORS.covariance.pb, ERRORS.covariance.vb, ERRORS.covariance.bb],
        ]
    )
    mean = np.array([ERRORS[1:4], ERRORS[4:7], ERRORS[7:10]])
    for t, inertial in ((changed_s - 1.0, not begins), (1.3 - changed_s, begins)):
        b = float(inertial)
        f = np.array([[1.0, t, -b * t * t / 2.0], [0.0, 1.0, -b * t], [0.0, 0.0, 1.0]])
        density = 0.2**2 * state.imu.interval_s if inertial else 2.0 * 3.0**2 * 0.1
        q = density * np.array([[t**3 / 3, t**2 / 2, 0], [t**2 / 2, t, 0], [0, 0, 0]])
        s = (np.arange(4000) + 0.5) / 4000 * t
        g = np.array([-(s**2) / 2.0, -s, np.ones_like(s)])
        q = q + b * 0.15**2 / 300.0 * (g @ g.T) * t / 4000
        p, mean = f @ p @ f.T + q, f @ mean
    found = covariance_at(GAINS, state, 1.3)
    wanted = [p[0, 0], p[0, 1], p[0, 2], p[1, 1], p[1, 2], p[2, 2]]
    assert found == pytest.approx(wanted, rel=1e-5)
    _, later = motion_step(GAINS, FRAME, state._replace(track=new_track(1.3)), inputs(1.3))
    assert (later.x_m, later.y_m, later.z_m) == pytest.approx(mean[0])
    assert (later.velocity_x_mps, later.velocity_y_mps, later.climb_mps) == pytest.approx(mean[1])
    assert vehicle.time_s == NOW_S


# --- attitudes ----------------------------------------------------------------------------------


def with_attitude(state: MotionState, **changes: Any) -> MotionState:
    latest = LastAttitude(
        sequence=1, time_s=1.19, used=attitude(1.19, sequence=1),
        refused=NO_ATTITUDE, refused_in_a_row=0,
    )  # fmt: skip
    return state._replace(attitude=latest._replace(**changes))


FAR = (0.3, -0.2, 0.5 + 2.0)


def test_the_fifth_attitude_that_agrees_is_where_it_has_turned_to() -> None:
    state = with_attitude(flown())
    for i in range(1, 5):
        state, vehicle = tick(state, 1.2 + 0.01 * i, attitude=attitude(1.2 + 0.01 * i, FAR, 1 + i))
        assert (state.attitude.refused_in_a_row, state.attitude.time_s) == (i, 1.19)
        assert state.rejected == 3 + i
        assert vehicle.heading_rad == pytest.approx(0.5)
    state, vehicle = tick(state, 1.25, attitude=attitude(1.25, FAR, 6))
    assert (state.attitude.refused_in_a_row, state.attitude.time_s) == (0, 1.25)
    assert state.rejected == 7
    assert vehicle.heading_rad == pytest.approx(2.5)
    assert state.attitude.refused == NO_ATTITUDE


def test_attitudes_that_do_not_agree_are_counted_from_one() -> None:
    refused = attitude(1.195, (0.3, -0.2, -2.0))
    state = with_attitude(flown(), refused=refused, refused_in_a_row=3)
    state, _ = tick(state, attitude=attitude(1.2, FAR, 5))
    assert state.attitude.refused_in_a_row == 1
    assert state.attitude.refused.time_s == 1.2
    again, _ = tick(state, 1.21, attitude=attitude(1.2, FAR, 6))  # over another link
    assert again.attitude.refused_in_a_row == 1
    assert again.attitude.sequence == 6
    assert again.rejected == 5


def test_what_is_no_rotation_or_not_later_is_refused() -> None:
    state = with_attitude(flown())
    for bad in (
        attitude(1.2)._replace(qw=nan),
        attitude(1.19),
        attitude(1.26),
        attitude(1.2)._replace(qw=2.0, qx=0.0, qy=0.0, qz=0.0),
    ):
        after, _ = tick(state, attitude=bad)
        assert after.rejected == 4
        assert after.attitude == state.attitude._replace(sequence=2)
        assert after.attitude_track == state.attitude_track
    after, _ = tick(state, attitude=attitude(1.249))
    assert (after.rejected, after.attitude.time_s) == (3, 1.249)


@pytest.mark.parametrize(
    ("ahead_s", "turned"), [(-0.02, 0.0), (0.05, 0.05), (0.1, 0.1), (0.3, 0.1)]
)
def test_an_attitude_is_carried_on_for_a_tenth(ahead_s: float, turned: float) -> None:
    track = flown().attitude_track._replace(
        time_s=NOW_S - ahead_s, roll_rate_radps=0.5, pitch_rate_radps=-0.7, heading_rate_radps=0.9
    )
    _, vehicle = tick(flown(attitude_track=track))
    assert (vehicle.roll_rad, vehicle.pitch_rad, vehicle.heading_rad) == pytest.approx(
        (0.3 + 0.5 * turned, -0.2 - 0.7 * turned, 0.5 + 0.9 * turned)
    )
    assert vehicle[10:13] == (0.5, -0.7, 0.9)


# --- another clock ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("what", "time_s", "resets"),
    [
        *(("track", 1.249, False), ("track", 1.251, True), ("track", nan, True)),
        *(("errors", 1.249, False), ("errors", 1.251, True)),
        *(("attitude", 1.249, False), ("attitude", 1.251, True)),
    ],
)
def test_what_lies_in_the_future_is_of_another_clock(
    what: str, time_s: float, resets: bool
) -> None:
    state = flown(shift=FrameShift(1.0, 2.0, 3.0), jump_s=1.1, reckoning=Reckoning(0.1, 1.1, True))
    part = getattr(state, what)._replace(time_s=time_s)
    changes: dict[str, Any] = {what: part}
    after, vehicle = tick(state._replace(**changes))
    assert isnan(after.errors.time_s) == resets
    assert isnan(vehicle.x_m) == resets
    if resets:
        # The bias is the sensor's, and stays; nothing else does.
        assert after.errors[7:10] == ERRORS[7:10]
        assert after.errors.covariance.bb == ERRORS.covariance.bb
        assert isnan(after.errors.covariance.pp)
        assert (after.track.time_s, after.inertial) == (NOW_S, False)
        assert isnan(after.switched_s)
        assert isnan(after.imu.time_s)
        assert isnan(after.imu.since_s)
        assert isnan(after.fix.time_s)
        assert isnan(after.jump_s)
        assert after.shift == FrameShift(0.0, 0.0, 0.0)
        assert not after.reckoning.now
        assert isnan(after.reckoning.last_s)
        assert (after.fix.source, after.rejected) == (4, 3)


# --- what is reported ---------------------------------------------------------------------------


def quality(
    after: MotionState, before: MotionState | None = None, time_s: float = NOW_S
) -> MotionQuality:
    return motion_quality(GAINS, before or flown(), after, time_s)


def test_what_is_uncertain_is_the_filter_and_the_offset_of_the_source() -> None:
    after = flown(
        offset=Offset(0.3, -0.4, 1.2),
        shift=FrameShift(1.0, 2.0, 3.0),
        innovation=Innovation(0.1, 0.2, 0.3, 4.0),
    )
    found_quality = quality(after)
    pp, _, _, vv, _, bb = covariance_at(GAINS, after, NOW_S)
    assert found_quality.position_sigma_m == pytest.approx((pp + 1.3**2) ** 0.5)
    assert found_quality.velocity_sigma_mps == pytest.approx(vv**0.5)
    assert found_quality.bias_sigma_mps2 == pytest.approx(bb**0.5)
    assert found_quality[:4] == (0.1, 0.2, 0.3, 4.0)
    assert (found_quality.offset_x_m, found_quality.offset_y_m, found_quality.offset_z_m) == (
        0.3,
        -0.4,
        1.2,
    )
    assert (found_quality.shift_x_m, found_quality.shift_y_m, found_quality.shift_z_m) == (
        1.0,
        2.0,
        3.0,
    )
    assert (
        found_quality.bias_x_mps2,
        found_quality.bias_y_mps2,
        found_quality.bias_z_mps2,
    ) == ERRORS[7:10]
    assert (found_quality.source, found_quality.inertial) == (4, False)
    none = quality(initial_motion())
    assert isnan(none.position_sigma_m)
    rounded = ERRORS._replace(
        time_s=NOW_S, covariance=Covariance(pp=0.0, pv=0.0, pb=0.0, vv=-1e-18, vb=0.0, bb=-1e-18)
    )
    found = quality(flown(errors=rounded))
    assert (found.velocity_sigma_mps, found.bias_sigma_mps2) == (0.0, 0.0)


def test_a_fix_was_used_refused_or_not_looked_at() -> None:
    before = flown()
    used = before._replace(fix=before.fix._replace(sequence=5, time_s=1.1))
    refused = before._replace(fix=before.fix._replace(sequence=5))
    unknown = before._replace(fix=before.fix._replace(sequence=5, time_s=nan))
    for after, expected in (
        *((before, (False, False)), (used, (True, False)), (refused, (False, True))),
        (unknown, (False, True)),
    ):
        found = quality(after, before)
        assert (found.fix_used, found.fix_refused) == expected


@pytest.mark.parametrize(
    ("ago_s", "jumped"), [(0.0, True), (0.399, True), (0.401, False), (nan, False)]
)
def test_a_jump_is_reported_for_four_tenths(ago_s: float, jumped: bool) -> None:
    assert quality(flown(jump_s=NOW_S - ago_s)).jumped == jumped


def test_dead_reckoning_is_reported_since_it_began() -> None:
    assert quality(flown(reckoning=Reckoning(0.5, 1.1, True))).reckoned_s == pytest.approx(0.7)
    assert quality(flown(reckoning=Reckoning(0.5, 1.1, False))).reckoned_s == 0.0
    assert quality(flown(reckoning=Reckoning(1.3, 1.3, True))).reckoned_s == 0.0


@pytest.mark.interpreted
@pytest.mark.parametrize(
    "shift", [(1.0, 0.0, 0.0), (0.0, -2.0, 0.0), (0.0, 0.0, 3.0), (1.0, -2.0, 3.0)]
)
def test_in_the_source_s_own_frame_the_place_is_as_the_source_says(shift: Triple) -> None:
    state = flown(shift=FrameShift(*shift))
    back = unshifted(state, 1.3)
    assert back.shift == FrameShift(0.0, 0.0, 0.0)
    assert back.jump_s == 1.3
    assert place(back.errors, 1.2)[0] == pytest.approx(place(ERRORS, 1.2)[0] + np.array(shift))
    assert back.errors[4:] == state.errors[4:]
    assert unshifted(flown(), 1.3) == flown()


def test_a_fix_is_looked_at_once() -> None:
    state = known()
    new = fix(1.1, place(ERRORS, 1.1)[0])
    first, vehicle = motion_step(GAINS, FRAME, state, inputs(1.15, position=new))
    assert first.fix.time_s == 1.1
    again, _ = motion_step(GAINS, FRAME, first, inputs(1.16, position=new))
    assert again.fix == first.fix
    assert again.errors == first.errors
    where, v = place(first.errors, 1.15)
    assert (vehicle.x_m, vehicle.y_m, vehicle.z_m) == pytest.approx(where)
    assert (vehicle.velocity_x_mps, vehicle.velocity_y_mps, vehicle.climb_mps) == pytest.approx(v)

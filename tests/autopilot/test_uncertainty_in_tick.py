"""A tick and the estimator's uncertainty: which positions it flies with, what is measured.

An aircraft held still and level shows all of it: where it is and what its accelerometers read
is known, and nothing has to be flown.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

import pytest

from tgl_soar.autopilot import (
    AutopilotState,
    Output,
    fault_text,
    initial_state,
    step,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.conditions import UNCERTAINTY_MAX
from tgl_soar.control.laws import laws_from
from tgl_soar.estimation.health import FROZEN, RECKONED
from tgl_soar.estimation.motion import IMU_SILENT_S, JUMP_S
from tgl_soar.estimation.motion_state import OUTLIERS_ACCEPTED
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    GRAVITY_MPS2,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    PositionFix,
)

DT = 0.005
FIX_TICKS = 4
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
VALUES = ParameterSet().changed(
    {
        "EST_FIX_SD": 0.003, "EST_ACC_SD": 0.2, "EST_ACC_BIAS_SD": 0.15, "EST_DELAY": 0.0,
        "EST_SD_MAX": 0.1, "AGE_POS_HOLD": 0.25, "AGE_POS_MAX": 2.0, "AGE_FROZEN": 1.0,
    }
)  # fmt: skip


def held(n: int) -> Inputs:
    """The inputs of tick n from an aircraft that is held by hand and reports no motion."""
    now = n * DT
    fixed = n - n % FIX_TICKS
    return Inputs(
        time_s=now,
        position=PositionFix(
            sequence=fixed + 1,
            time_s=fixed * DT,
            north_m=1.0,
            east_m=2.0,
            down_m=-3.0,
            velocity_north_mps=0.0,
            velocity_east_mps=0.0,
            velocity_down_mps=0.0,
        ),
        attitude=AttitudeSample(
            sequence=n + 1,
            time_s=now,
            qw=1.0,
            qx=0.0,
            qy=0.0,
            qz=0.0,
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        ),
        autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
        engage=False,
        imu=ImuSample(
            sequence=n + 1,
            time_s=now,
            force_x_frd_mps2=0.0,
            force_y_frd_mps2=0.0,
            force_z_frd_mps2=-GRAVITY_MPS2,
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        ),
    )


def ticks(
    received: Iterator[Inputs], values: ParameterSet = VALUES, state: AutopilotState | None = None
) -> Iterator[tuple[AutopilotState, Output]]:
    laws = laws_from(values, FRAME)
    state = initial_state() if state is None else state
    for inputs in received:
        state, output = step(laws, state, inputs)
        yield state, output


def after(count: int) -> AutopilotState:
    """Held for so many ticks."""
    *_, (state, _) = ticks(held(n) for n in range(count))
    return state


# --- positions ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("fraction", "ok"), [(0.99, True), (1.01, False)])
def test_a_young_fix_of_too_much_uncertainty_is_no_position(fraction: float, ok: bool) -> None:
    inputs = held(0)
    sigma = fraction * UNCERTAINTY_MAX * VALUES["EST_SD_MAX"]
    uncertain = inputs._replace(position=inputs.position._replace(sigma_m=sigma))
    ((_, output),) = ticks(iter([uncertain]))
    assert output.health.position_age_s == 0.0
    assert output.quality.position_sigma_m == pytest.approx(sigma)
    assert output.health.position_ok == ok


def test_a_position_of_unknown_uncertainty_is_none() -> None:
    """No sample leads there: should arithmetic ever, a sigma that is no number is not small."""
    state = after(100)
    errors = state.memory.motion.errors
    unknown = errors._replace(covariance=errors.covariance._replace(pp=nan))
    corrupted = state._replace(
        memory=state.memory._replace(motion=state.memory.motion._replace(errors=unknown))
    )
    without_fix = held(100)._replace(position=held(99).position)
    for start, ok in ((state, True), (corrupted, False)):
        ((_, output),) = ticks(iter([without_fix]), state=start)
        assert output.health.position_age_s < VALUES["AGE_POS_HOLD"]
        assert output.health.position_ok == ok


@pytest.mark.parametrize("sd_max_m", [0.01, 0.03, 0.1, 10.0])
@pytest.mark.parametrize("imu", [True, False])
def test_without_fixes_the_position_is_kept_for_as_long_as_it_is_known(
    sd_max_m: float, imu: bool
) -> None:
    """With accelerations until it is too uncertain or AGE_POS_MAX old; without, AGE_POS_HOLD."""
    values = VALUES.changed({"EST_SD_MAX": sd_max_m, "EST_IMU": float(imu)})
    last = held(200).position
    received = (held(n)._replace(position=last) if n > 200 else held(n) for n in range(700))
    kept = []
    for n, (_, output) in enumerate(ticks(received, values)):
        sigma, age = output.quality.position_sigma_m, output.health.position_age_s
        assert output.quality.inertial == (imu and n > 25) or n <= 25
        young = age <= 0.25 and sigma <= 3.0 * sd_max_m
        carried = imu and n > 25 and age <= 2.0 and sigma <= sd_max_m
        if n > 25:
            assert output.health.position_ok == (young or carried)
        if n > 200:
            kept.append(output.health.position_ok)
    ends = kept.index(False) * DT
    assert not any(kept[round(ends / DT) :])
    if not imu:
        assert ends <= 0.25 + 2.0 * DT
    elif sd_max_m >= 0.1:
        assert ends > 0.8  # what accelerometers are there for
    if imu and sd_max_m == 10.0:
        assert ends == pytest.approx(2.0, abs=2.0 * DT)


def test_a_frozen_position_is_not_carried_on_by_accelerations() -> None:
    """Without control the estimator takes the same place and speed again and again, confident in
    it."""

    def frozen() -> Iterator[Inputs]:
        for n in range(400):
            inputs = held(n)
            yield inputs._replace(position=inputs.position._replace(velocity_north_mps=0.1))

    outputs = [output for _, output in ticks(frozen())]
    assert outputs[150].health.position_ok
    for output in outputs[210:]:
        assert output.health.faults & FROZEN
        assert output.quality.inertial
        assert output.quality.position_sigma_m < VALUES["EST_SD_MAX"]
        assert not output.health.position_ok


def test_a_position_that_has_jumped_is_none_for_a_while() -> None:
    """So that the line is reset at the aircraft and the step does not reach the laws."""

    def jumping() -> Iterator[Inputs]:
        for n in range(400):
            inputs = held(n)
            moved = inputs.position._replace(north_m=1.0 if n < 200 else 4.0)
            yield inputs._replace(position=moved)

    oks = [output.health.position_ok for _, output in ticks(jumping())]
    jump = 200 + FIX_TICKS * (OUTLIERS_ACCEPTED - 1)
    assert all(oks[:jump])
    assert not any(oks[jump : jump + round(JUMP_S / DT) - 1])
    assert all(oks[jump + round(JUMP_S / DT) + 1 :])


def reckoned(since: int, until: int, value: float) -> list[Output]:
    """Of positions that are dead reckoned between two ticks, with this AGE_POS_DR."""
    received = (
        held(n)._replace(position=held(n).position._replace(reckoned=since <= n - n % 4 < until))
        for n in range(1000)
    )
    return [output for _, output in ticks(received, VALUES.changed({"AGE_POS_DR": value}))]


@pytest.mark.parametrize("longest_s", [0.0, 1.0, 60.0])
def test_a_dead_reckoned_position_is_flown_with_for_so_long_and_then_at_once_when_it_is_measured(
    longest_s: float,
) -> None:
    outputs = reckoned(200, 800, longest_s)
    for n, output in enumerate(outputs):
        for_s = (n - 200) * DT
        if n > 25:
            assert output.health.position_ok == (not (200 < n < 800 and for_s > longest_s + 1e-9))
        assert bool(output.health.faults & RECKONED) == (200 <= n < 800)
        if 200 <= n < 800:
            assert output.quality.reckoned_s == pytest.approx(for_s)
            assert "position only dead reckoned" in fault_text(output.health.faults)


# --- what is measured ---------------------------------------------------------------------------


SPIKE = 400.0  # m/s², beyond what an aircraft can feel
NOW = 100 * DT


@pytest.mark.parametrize(
    ("sample", "measured"),
    [
        (held(100).imu, True),
        (held(99).imu, False),  # the last one again
        (held(99).imu._replace(sequence=101), False),  # again, as if it were a new one
        (held(100).imu._replace(force_z_frd_mps2=SPIKE), False),
        (held(100).imu._replace(force_y_frd_mps2=nan), False),
        (held(100).imu._replace(time_s=nan), False),
    ],
)
def test_the_wind_is_measured_in_what_the_estimator_has_taken(
    sample: ImuSample, measured: bool
) -> None:
    ((state, _),) = ticks(iter([held(100)._replace(imu=sample)]), state=after(100))
    assert state.memory.wind.imu_time_s == (NOW if measured else NOW - DT)


@pytest.mark.parametrize(("fraction", "measured"), [(0.99, True), (1.01, False)])
def test_accelerations_of_long_ago_are_not_used(fraction: float, measured: bool) -> None:
    late = held(150).imu._replace(time_s=150 * DT - fraction * IMU_SILENT_S)
    deaf = (held(n)._replace(imu=held(99).imu) for n in range(100, 150))
    *_, (state, _) = ticks(deaf, state=after(100))
    ((received, _),) = ticks(iter([held(150)._replace(imu=late)]), state=state)
    assert received.memory.motion.imu.time_s == late.time_s  # taken, and known to be old
    assert (received.memory.wind.imu_time_s == 150 * DT) == measured


def test_after_a_clock_that_went_back_nothing_is_measured_until_there_is_something_new() -> None:
    back = held(20)._replace(imu=held(99).imu)
    ((state, _),) = ticks(iter([back]), state=after(100))
    assert state.memory.wind.imu_time_s == 99 * DT

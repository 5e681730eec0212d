"""From the hand to the line: what a launch observes, and what it is given up for."""

from __future__ import annotations

from math import inf, nan, radians, sin
from typing import Any

import pytest
from samples import STILL

from tgl_soar.control import launch
from tgl_soar.control.launch import NO_LAUNCH, LaunchParams, LaunchState, LaunchView, launch_step
from tgl_soar.control.target_line import LineLimits
from tgl_soar.types import NO_IMU

DT = 0.005
PARAMS = LaunchParams(
    wanted=True, throw_mps=1.5, wait_s=10.0, pitch_rad=0.05, line=LineLimits(0.6, 1.5, 0.1)
)


def view(time_s: float, **changes: Any) -> LaunchView:
    """Nothing moves; `push`: the specific force along x beyond gravity; `old_s`: how old
    that is."""
    push, pitch = changes.pop("push", 0.0), changes.pop("pitch_rad", 0.05)
    speed, climb = changes.pop("upwind_mps", 0.0), changes.pop("climb_mps", 0.0)
    vehicle = STILL._replace(
        time_s=time_s, z_m=5.0, velocity_x_mps=-speed, climb_mps=climb, pitch_rad=pitch
    )
    detected_s = time_s - changes.pop("old_s", 0.0)
    imu = NO_IMU._replace(
        sequence=round(detected_s / DT),
        time_s=detected_s,
        force_x_frd_mps2=push + 9.80665 * sin(pitch),
    )
    usual = LaunchView(
        vehicle=vehicle,
        imu=imu,
        position_ok=True,
        airspeed_mps=9.0,
        measured=True,
        speed_min_mps=6.0,
        clearance_m=2.0,
        clearance_min_m=1.0,
        to_go_m=5.0,
        off_m=0.0,
        off_max_m=1.5,
        line_rests=False,
    )
    return usual._replace(**changes)


class Launched:
    """A launch tick by tick."""

    def __init__(self) -> None:
        self.state: LaunchState = NO_LAUNCH
        self.now = 50.0

    def look(self, seconds: float = 0.0, **changes: Any) -> Launched:
        for _ in range(max(1, round(seconds / DT))):
            self.now += DT
            self.state = launch_step(PARAMS, self.state, True, view(self.now, **changes), DT)
        return self

    @property
    def standing(self) -> int:
        return self.state.standing


def thrown() -> Launched:
    return Launched().look(1.0).look(0.2, push=15.0)


def gliding() -> Launched:
    return thrown().look(1.0)


def test_it_waits_in_the_hand_and_says_when_nobody_throws() -> None:
    launched = Launched().look()
    assert launched.standing == launch.HELD
    assert launched.look(PARAMS.wait_s - 0.1).standing == launch.HELD
    assert launched.look(0.2).standing == launch.NO_THROW
    assert not launch.is_aloft(launched.state)


@pytest.mark.parametrize("pitch_deg", [-20.0, 0.0, 20.0])
def test_the_accelerometers_see_a_throw_and_not_the_weight(pitch_deg: float) -> None:
    held = Launched().look(2.0, pitch_rad=radians(pitch_deg))
    assert held.standing == launch.HELD
    assert held.look(0.09, push=15.0, pitch_rad=radians(pitch_deg)).standing == launch.HELD
    assert held.look(0.05, push=15.0, pitch_rad=radians(pitch_deg)).standing == launch.THROWN


def test_shaking_and_carrying_are_no_throw() -> None:
    launched = Launched().look()
    for k in range(40):
        launched.look(0.1, push=12.0 if k % 2 else -12.0)
    assert launched.standing == launch.HELD
    assert launched.look(1.0, upwind_mps=1.4).standing == launch.HELD


def test_a_jolt_before_a_silence_is_no_push_that_lasts() -> None:
    """The last sample stands until another one comes: counted on it would be a throw in 0.6 s."""
    launched = Launched().look()
    for k in range(400):
        launched.look(push=4.0, old_s=k * DT)
    assert launched.standing == launch.HELD
    assert launched.state.push_mps < 0.1  # and what it was has faded


def test_a_jolt_counts_for_the_time_of_its_sample_alone() -> None:
    """Of a stream of 50 Hz 40 m/s² are 0.8 m/s, however long nothing comes after them; one that
    comes after a silence stands for no longer than a sample of the slowest stream."""
    launched = Launched().look()
    for k in range(100):
        launched.look(old_s=(k % 4) * DT)
    for k in range(40):
        launched.look(push=40.0, old_s=k * DT)
    assert launched.standing == launch.HELD
    launched = Launched().look()
    launched.look(0.15, old_s=0.15).look(push=20.0)
    assert launched.state.push_mps == pytest.approx(20.0 * launch.SAMPLE_S)


def test_what_flies_evidently_is_in_no_hand() -> None:
    high = Launched().look(0.9, clearance_m=4.5)
    assert high.standing == launch.HELD
    assert high.look(0.3, clearance_m=4.5).standing == launch.THROWN
    # LNC_SPEED may be far above any walking speed.
    params = PARAMS._replace(throw_mps=10.0)
    state, standings = NO_LAUNCH, []
    for k in range(300):
        state = launch_step(params, state, True, view(50.0 + k * DT, upwind_mps=3.0), DT)
        standings.append(state.standing)
    assert standings[190] == launch.HELD
    assert standings[210] == launch.THROWN
    # What is not known is no evidence.
    assert Launched().look(5.0, clearance_m=inf).standing == launch.HELD
    assert Launched().look(5.0, clearance_m=9.0, position_ok=False).standing == launch.HELD


def test_velocity_sees_what_is_only_released_and_no_imu_is_needed() -> None:
    assert Launched().look().look(push=nan, upwind_mps=1.6).standing == launch.THROWN
    held = Launched().look().look(0.5, push=nan, upwind_mps=1.6, position_ok=False)
    assert held.standing == launch.HELD


@pytest.mark.parametrize(
    ("pitch", "standing"), [(0.6, launch.THROWN), (0.7, launch.STEEP), (-0.6, launch.STEEP)]
)
def test_too_steep_a_throw_is_given_up(pitch: float, standing: int) -> None:
    assert Launched().look().look(upwind_mps=2.0, pitch_rad=pitch).standing == standing


def test_speed_must_last_before_a_line_is_flown() -> None:
    slow = thrown().look(1.0, airspeed_mps=6.9)
    assert slow.standing == launch.THROWN
    slow.look(0.1, airspeed_mps=7.1).look(airspeed_mps=6.9).look(0.15, airspeed_mps=7.1)
    assert slow.standing == launch.THROWN
    assert slow.look(0.1, airspeed_mps=7.1).standing == launch.GLIDING


def test_without_a_pitot_tube_the_first_moments_count_for_nothing() -> None:
    assert thrown().look(0.5, measured=False).standing == launch.THROWN
    assert thrown().look(0.9, measured=False).standing == launch.GLIDING
    assert thrown().look(0.9, measured=False, airspeed_mps=nan).standing == launch.GLIDING


def test_no_speed_in_time_is_given_up() -> None:
    assert thrown().look(launch.GAIN_S + 0.1, airspeed_mps=6.0).standing == launch.SLOW


def test_low_is_below_what_the_hand_had_and_only_while_it_sinks() -> None:
    assert thrown().look(2.0, clearance_m=0.9, climb_mps=0.1).standing == launch.GLIDING
    sinking = thrown().look(0.4, clearance_m=0.9, climb_mps=-0.5)
    assert sinking.standing != launch.LOW
    assert sinking.look(0.2, clearance_m=0.9, climb_mps=-0.5).standing == launch.LOW
    # Thrown from 1.2 m, where 1 m is the least: 0.6 m count.
    low = Launched().look(1.0, clearance_m=1.2).look(0.2, clearance_m=1.2, push=15.0)
    assert low.look(0.9, clearance_m=0.7, climb_mps=-0.02).standing == launch.GLIDING
    assert low.look(0.6, clearance_m=0.5, climb_mps=-0.5).standing == launch.LOW


def test_a_line_is_out_of_reach_where_the_height_does_not_last() -> None:
    far = gliding().look(3.0, climb_mps=-0.2)
    assert far.standing == launch.GLIDING  # 2.0 − 3 s × 0.2 m/s is above the least
    assert gliding().look(3.0, climb_mps=-0.5).standing == launch.FAR
    near = gliding().look(3.0, climb_mps=-0.5, to_go_m=1.0)
    assert near.standing == launch.GLIDING  # it is there first
    assert gliding().look(3.0, climb_mps=-0.5, clearance_m=inf).standing == launch.GLIDING


def test_a_line_that_is_left_behind_is_out_of_reach() -> None:
    assert gliding().look(0.4, off_m=1.6).standing == launch.GLIDING
    assert gliding().look(0.6, off_m=1.6).standing == launch.FAR
    assert gliding().look(0.6, off_m=nan).standing == launch.FAR


def test_it_is_captured_where_the_line_rests() -> None:
    assert gliding().look(line_rests=True, position_ok=False).standing == launch.GLIDING
    reached = gliding().look(line_rests=True)
    assert reached.standing == launch.REACHED
    assert reached.look(5.0, climb_mps=-3.0).standing == launch.REACHED


def test_another_mode_forgets_it() -> None:
    state = launch_step(PARAMS, gliding().state, False, view(60.0), DT)
    assert state == NO_LAUNCH

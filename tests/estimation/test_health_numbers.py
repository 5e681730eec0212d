"""What is watched of a stream, on both sides of each limit: a little less is flown with, a little
more is a fault, and averages are those that are stated."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, inf, isnan, nan, radians, sin
from typing import Any

import pytest
from samples import attitude_sample, imu_sample, surfaces_sample

from tgl_soar.estimation import health as h
from tgl_soar.estimation.health import (
    ATTITUDE_SHIFT,
    HealthLimits,
    HealthState,
    health_step,
    initial_health,
)
from tgl_soar.estimation.motion_state import LastAttitude, LastFix, MotionState, initial_motion
from tgl_soar.types import (
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    AirspeedSample,
    AutopilotStatus,
    Health,
    Inputs,
    PositionFix,
    SurfaceCommand,
)

LIMITS = HealthLimits(
    position_age_max_s=0.25,
    attitude_age_max_s=0.125,
    heartbeat_age_max_s=3.0,
    frozen_s=0.5,
    surface_error_max=0.25,
)
G = 9.81
NEUTRAL = SurfaceCommand(0.0, 0.0, 0.0)
NOTHING = Inputs(
    time_s=0.0,
    position=NO_FIX,
    attitude=NO_ATTITUDE,
    autopilot=AutopilotStatus(time_s=0.0, accepts_surfaces=True, armed=True),
    engage=True,
)


@dataclass
class Watched:
    """Samples one by one, at the times that are given."""

    state: HealthState = field(default_factory=initial_health)
    number: int = 0
    flying: bool = False
    command: SurfaceCommand = NEUTRAL
    last: Inputs = NOTHING

    def _look(self, now_s: float, dt_s: float = 0.0, **changes: Any) -> Health:
        status = self.last.autopilot._replace(time_s=now_s)
        self.last = self.last._replace(time_s=now_s, autopilot=status, **changes)
        self.state, found = health_step(
            *(LIMITS, self.state, _used(now_s), self.last, self.flying, self.flying),
            *(self.command, dt_s),
        )
        return found

    def fix(self, time_s: float, now_s: float | None = None, **changes: Any) -> Health:
        """A position, still moving north at 1 m/s by default."""
        self.number += 1
        usual = PositionFix(
            sequence=self.number,
            time_s=time_s,
            north_m=time_s,
            east_m=0.0,
            down_m=-2.0,
            velocity_north_mps=1.0,
            velocity_east_mps=0.0,
            velocity_down_mps=0.0,
        )
        return self._look(time_s if now_s is None else now_s, position=usual._replace(**changes))

    def attitude(self, time_s: float, pitch_rad: float, **changes: Any) -> Health:
        self.number += 1
        q = (cos(0.5 * pitch_rad), 0.0, sin(0.5 * pitch_rad), 0.0)
        usual = attitude_sample(self.number, time_s, q, (0.0, 0.1, 0.0))
        return self._look(time_s, attitude=usual._replace(**changes))

    def with_force(self, time_s: float, force: tuple[float, float, float]) -> Health:
        self.number += 1
        return self._look(time_s, imu=imu_sample(self.number, time_s, force))

    def with_surfaces(self, time_s: float, dt_s: float, *surfaces: float) -> Health:
        self.number += 1
        return self._look(time_s, dt_s, surfaces=surfaces_sample(self.number, time_s, surfaces))


def _used(now_s: float) -> MotionState:
    """An estimator that is up to date: ages are not what is looked at here."""
    return initial_motion()._replace(
        fix=LastFix(sequence=1, time_s=now_s, source=0, sum=nan, repeated=0),
        attitude=LastAttitude(
            sequence=1, time_s=now_s, used=NO_ATTITUDE, refused=NO_ATTITUDE, refused_in_a_row=0
        ),
    )


def test_intervals_and_jitter_are_averaged_over_thirty_two() -> None:
    watched = Watched()
    watched.fix(1.0)
    found = watched.fix(1.04)
    assert found.position_interval_s == pytest.approx(0.04)
    assert found.position_jitter_s == 0.0
    found = watched.fix(1.12)  # off by 0.04
    assert found.position_interval_s == pytest.approx(0.04 + 0.04 / 32.0)
    assert found.position_jitter_s == pytest.approx(0.04 / 32.0)
    off = 0.02 - found.position_interval_s
    after = watched.fix(1.14)
    assert after.position_interval_s == pytest.approx(found.position_interval_s + off / 32.0)
    assert after.position_jitter_s == pytest.approx(
        found.position_jitter_s + (abs(off) - found.position_jitter_s) / 32.0
    )


@pytest.mark.parametrize(
    ("usual_s", "now_s", "is_gap"),
    [
        (0.02, 0.069, False),
        (0.02, 0.071, True),  # three and a half times as long
        (0.004, 0.049, False),  # of a fast stream 50 ms are no gap
        (0.004, 0.051, True),
    ],
)
def test_a_gap_is_longer_than_usual_and_long(usual_s: float, now_s: float, is_gap: bool) -> None:
    watched = Watched()
    watched.fix(1.0)
    watched.fix(1.0 + usual_s)
    found = watched.fix(1.0 + usual_s + now_s)
    assert (found.faults & h.GAP != 0, found.gaps) == (is_gap, int(is_gap))


@pytest.mark.parametrize("axis", ["north_m", "east_m", "down_m"])
@pytest.mark.parametrize(("off_m", "jumps"), [(1.55, False), (1.65, True)])
def test_a_jump_is_a_metre_and_what_thirty_metres_a_second_make(
    axis: str, off_m: float, jumps: bool
) -> None:
    """1.6 m in 20 ms."""
    before = {"north_m": 0.0, "east_m": 0.0, "down_m": 0.0}
    for sign in (-1.0, 1.0):
        watched = Watched()
        watched.fix(1.0, **before)
        found = watched.fix(1.02, **(before | {axis: sign * off_m}))
        assert (found.faults & h.JUMP != 0) == jumps
        # Of another source the place may be any.
        watched = Watched()
        watched.fix(1.0, **before)
        assert watched.fix(1.02, source=2, **(before | {axis: sign * off_m})).faults == 0


@pytest.mark.parametrize(
    ("square", "wrong"), [(1.039, False), (1.041, True), (0.961, False), (0.959, True)]
)
def test_a_quaternion_s_norm_is_one_within_two_hundredths(square: float, wrong: bool) -> None:
    found = Watched().attitude(1.0, 0.0, qw=square**0.5)
    assert (found.faults & h.WRONG << ATTITUDE_SHIFT != 0) == wrong


@pytest.mark.parametrize("axis", ["velocity_north_mps", "velocity_east_mps", "velocity_down_mps"])
def test_a_velocity_of_another_frame_is_reported_when_its_mean_over_two_seconds_is_2_mps_off(
    axis: str,
) -> None:
    """4 m/s off are 2 m/s of a mean over 2 s after ln 2 of that: 1.39 s."""
    watched, time_s = Watched(), 1.0
    usual = {"velocity_north_mps": 1.0, "velocity_east_mps": 0.0, "velocity_down_mps": 0.0}
    wrong = usual | {axis: usual[axis] + 4.0}
    while not watched.fix(time_s, **wrong).faults & h.WRONG:
        time_s += 0.02
    assert time_s - 1.0 == pytest.approx(1.386, abs=0.05)


@pytest.mark.parametrize(("after_s", "is_reported"), [(0.99, True), (1.01, False)])
def test_a_fault_is_reported_for_a_second(after_s: float, is_reported: bool) -> None:
    watched = Watched()
    watched.fix(1.0)
    watched.fix(1.02, north_m=nan)
    for k in range(1, 200):
        if 0.005 * k >= after_s:
            break
        watched.fix(1.02 + 0.005 * k)
    found = watched.fix(1.02 + after_s)
    assert (found.faults & h.NOT_FINITE != 0) == is_reported
    watched.attitude(3.0, 0.0)
    watched.attitude(3.02, 0.001, qw=nan)
    found = watched._look(3.02 + after_s)
    assert (found.faults & h.NOT_FINITE << ATTITUDE_SHIFT != 0) == is_reported


@pytest.mark.parametrize(("lasts_s", "frozen"), [(0.49, False), (0.52, True)])
def test_what_is_the_same_for_longer_than_the_limit_is_frozen_and_as_old(
    lasts_s: float, frozen: bool
) -> None:
    watched = Watched()
    watched.fix(1.0, north_m=5.0)
    found = watched.fix(1.0 + lasts_s, north_m=5.0)
    assert (found.faults & h.FROZEN != 0) == frozen
    assert found.position_age_s == pytest.approx(lasts_s if frozen else 0.0)
    watched = Watched(flying=True)
    watched.attitude(1.0, 0.1)
    found = watched.attitude(1.0 + lasts_s, 0.1)
    assert (found.faults & h.FROZEN << ATTITUDE_SHIFT != 0) == frozen
    assert found.attitude_age_s == pytest.approx(lasts_s if frozen else 0.0)


@pytest.mark.parametrize("axis", ["north_m", "east_m", "down_m", "velocity_down_mps"])
def test_one_number_that_changes_is_enough_to_be_no_repetition(axis: str) -> None:
    watched = Watched()
    before = {"north_m": 5.0, "east_m": 1.0, "down_m": -2.0, "velocity_down_mps": 0.3}
    watched.fix(1.0, **before)
    found = watched.fix(1.6, **(before | {axis: before[axis] + 1e-3}))
    assert found.faults & h.FROZEN == 0


def test_a_source_that_stands_still_on_the_ground_says_so_by_all_its_velocities() -> None:
    for velocity, rests in ((0.0, True), (0.1, False)):
        for axis in ("velocity_north_mps", "velocity_east_mps", "velocity_down_mps"):
            still = {"velocity_north_mps": 0.0, "velocity_east_mps": 0.0, "velocity_down_mps": 0.0}
            still |= {"north_m": 5.0, axis: velocity}
            watched = Watched()
            watched.fix(1.0, **still)
            found = watched.fix(1.6, **still)
            assert (found.faults & h.FROZEN == 0) == rests, (axis, velocity)
    for turning, rests in ((0.0, True), (0.1, False)):
        for axis in ("roll_rate_frd_radps", "pitch_rate_frd_radps", "yaw_rate_frd_radps"):
            rates = {"roll_rate_frd_radps": 0.0, "pitch_rate_frd_radps": 0.0}
            rates |= {"yaw_rate_frd_radps": 0.0, axis: turning}
            watched = Watched()
            watched.attitude(1.0, 0.1, **rates)
            found = watched.attitude(1.6, 0.1, **rates)
            assert (found.faults & h.FROZEN << ATTITUDE_SHIFT == 0) == rests, (axis, turning)


def tilted(pitch_deg: float) -> tuple[float, float, float]:
    """The specific force of level flight with the nose so high."""
    return G * sin(radians(pitch_deg)), 0.0, -G * cos(radians(pitch_deg))


@pytest.mark.parametrize(("off", "disagrees"), [(0.39, False), (0.42, True)])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_forces_that_are_off_by_four_tenths_of_g_on_average_disagree(
    off: float, disagrees: bool, axis: int
) -> None:
    """A mean over 2 s is within 1 % after ten."""
    watched = Watched()
    watched.attitude(0.98, 0.0)
    force = [0.0, 0.0, -G]
    force[axis] += off * G
    found = watched.with_force(1.0, (force[0], force[1], force[2]))
    for k in range(500):
        found = watched.with_force(1.02 + 0.021 * k, (force[0], force[1], force[2]))
    assert (found.faults & h.DISAGREES != 0) == disagrees
    assert watched.state.tilt[1 + axis] == pytest.approx(off, rel=0.01)


def test_the_mean_of_forces_is_taken_over_two_seconds_fifty_times_a_second() -> None:
    watched = Watched()
    watched.attitude(0.98, 0.3)
    watched.with_force(1.0, tilted(0.0))
    assert watched.state.tilt[1:] == (0.0, 0.0, 0.0)
    watched.with_force(1.019, (9.0, 9.0, 9.0))  # too soon
    assert watched.state.tilt.time_s == 1.0
    watched.with_force(1.04, tilted(0.0))
    # The nose is 0.3 rad up: level flight would feel sin and cos of it.
    assert watched.state.tilt.x == pytest.approx(0.02 * -sin(0.3), rel=1e-6)
    assert watched.state.tilt.z == pytest.approx(0.02 * (cos(0.3) - 1.0), rel=1e-6)
    watched.with_force(2.06, tilted(0.0))  # after a silence of more than a second it begins again
    assert watched.state.tilt[1:] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("silent_s", [0.02, 0.1, 0.8])
@pytest.mark.parametrize("force", [(390.0, 390.0, 390.0), (0.0, 0.0, -390.0), (-50.0, 0.0, -G)])
def test_no_single_sample_says_that_they_disagree(
    force: tuple[float, float, float], silent_s: float
) -> None:
    watched = Watched()
    watched.attitude(0.98, 0.0)
    for k in range(100):
        watched.with_force(1.0 + 0.02 * k, tilted(0.0))
    found = watched.with_force(2.98 + silent_s, force)
    assert not found.faults & h.DISAGREES
    assert sum(off * off for off in watched.state.tilt[1:]) < 0.14**2  # a third of the limit


def test_a_throw_by_hand_is_no_wrong_attitude() -> None:
    """From standing to 10 m/s in a fifth of a second: 5 g along the nose."""
    watched, found = Watched(), None
    watched.attitude(0.98, 0.0)
    for k in range(100):
        watched.with_force(1.0 + 0.02 * k, tilted(0.0))
    for k in range(10):
        found = watched.with_force(3.0 + 0.02 * k, (50.0, 0.0, -G))
        assert not found.faults & h.DISAGREES


@pytest.mark.parametrize(("axis", "turned"), [(0, 1.0), (2, -1.0)])
def test_an_attitude_that_is_far_off_is_reported_within_two_seconds(
    axis: int, turned: float
) -> None:
    """Nose down, or on its back, while it says level: 1 and 2 g off."""
    watched, time_s = Watched(), 1.0
    watched.attitude(0.98, 0.0)
    force = [0.0, 0.0, 0.0]
    force[axis] = -turned * G
    while not watched.with_force(time_s, (force[0], force[1], force[2])).faults & h.DISAGREES:
        time_s += 0.021
        assert time_s < 3.0


@pytest.mark.parametrize("norm", [30.0, 1e9, 0.0])
def test_what_is_no_rotation_is_no_attitude_to_compare_with(norm: float) -> None:
    watched = Watched()
    watched.attitude(0.98, 0.0)
    for k in range(100):
        watched.with_force(1.0 + 0.02 * k, tilted(0.0))
    watched.attitude(2.99, 0.0, qw=norm, qx=norm, qy=norm)
    found = watched.with_force(3.0, tilted(0.0))
    assert not found.faults & h.DISAGREES
    assert watched.state.tilt == (3.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("silent_s", [0.02, 0.9])
@pytest.mark.parametrize("velocity", [1e30, -1e30, 100.0])
def test_one_absurd_velocity_is_no_other_frame(velocity: float, silent_s: float) -> None:
    watched = Watched()
    watched.fix(1.0)
    assert not watched.fix(1.0 + silent_s, velocity_north_mps=velocity).faults & h.WRONG
    assert not watched.fix(1.02 + silent_s).faults & h.WRONG


@pytest.mark.parametrize("unit", [100.0, 1e9])
def test_velocities_in_another_unit_are_reported(unit: float) -> None:
    watched, found = Watched(), None
    for k in range(100):
        found = watched.fix(1.0 + 0.02 * k, velocity_north_mps=unit)
    assert found is not None
    assert found.faults & h.WRONG


def test_accelerations_of_more_than_a_second_ago_say_nothing() -> None:
    watched = Watched()
    watched.attitude(0.98, 0.0)
    for k in range(300):
        watched.with_force(1.0 + 0.02 * k, tilted(60.0))
    last = 1.0 + 0.02 * 299
    assert watched._look(last + 0.99).faults & h.DISAGREES
    assert not watched._look(last + 1.01).faults & h.DISAGREES


@pytest.mark.parametrize(
    ("age_s", "airspeed", "fault"),
    [(2.9, 8.0, False), (3.1, 8.0, True), (0.0, 79.0, False), (0.0, 81.0, True), (0.0, -0.1, True)],
)
def test_an_airspeed_is_of_the_last_three_seconds_and_of_an_aircraft(
    age_s: float, airspeed: float, fault: bool
) -> None:
    found = Watched()._look(10.0, airspeed=AirspeedSample(1, 10.0 - age_s, airspeed))
    assert (found.faults & h.AIRSPEED != 0) == fault


@pytest.mark.parametrize("which", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_surface_that_does_not_follow_is_dead_after_half_a_second(
    which: int, sign: float
) -> None:
    """The band about the command shrinks by a whole deflection each second."""
    watched, dt = Watched(flying=True), 0.02
    stuck = [0.0, 0.0, 0.0]
    stuck[which] = sign * 0.5
    found = watched.with_surfaces(1.0, dt, *stuck)
    dead_s = 0.0
    for k in range(1, 200):
        found = watched.with_surfaces(1.0 + dt * k, dt, *stuck)
        if found.surfaces_answer == 0:
            dead_s = dt * k
            break
    # From ±1 to within 0.25 of 0.5 it takes 0.75 s to shrink to a band of 0.25; then half a second.
    assert dead_s == pytest.approx(0.75 + 0.5, abs=0.05)
    assert found.faults & h.SURFACES
    followed = watched.with_surfaces(10.0, dt, 0.0, 0.0, 0.0)
    assert (followed.surfaces_answer, followed.faults & h.SURFACES) == (1, 0)


def test_a_brake_is_dead_after_three_tenths() -> None:
    watched, dt = Watched(flying=True, command=SurfaceCommand(0.0, 0.0, 0.0, 0.0)), 0.02
    dead_s = 0.0
    for k in range(200):
        found = watched.with_surfaces(1.0 + dt * k, dt, 0.0, 0.0, 0.0, 0.9)
        if found.faults & h.BRAKE:
            dead_s = dt * k
            break
    assert dead_s == pytest.approx(1.0 - 0.65 + 0.3, abs=0.05)


def test_what_was_read_back_a_second_ago_says_nothing() -> None:
    watched = Watched(flying=True)
    watched.with_surfaces(1.0, 0.02, 0.0, 0.0, 0.0)
    assert watched._look(1.99, 0.02).surfaces_answer == 1
    assert watched._look(2.02, 0.02).surfaces_answer == -1
    watched.flying = False
    assert watched._look(2.03, 0.02).surfaces_answer == -1
    assert watched.state.surfaces.sequence == 0


@pytest.mark.parametrize(("lasts_s", "old"), [(0.45, False), (0.55, True)])
def test_an_attitude_that_jumps_for_longer_than_a_frozen_one_may_last_is_old(
    lasts_s: float, old: bool
) -> None:
    watched, time_s = Watched(flying=True), 1.0
    watched.attitude(time_s, 0.0)
    found, side = watched.attitude(time_s + 0.01, 2.5), 2.5
    while time_s + 0.05 <= 1.01 + lasts_s:
        time_s += 0.05
        side = 2.5 - side
        found = watched.attitude(time_s, side)
    assert (found.attitude_age_s > 0.3) == old


def test_nothing_has_come_at_first() -> None:
    state = initial_health()
    for stream in (state.position, state.attitude):
        assert (stream.sequence, stream.source, stream.gaps, stream.faults) == (0, 0, 0, 0)
        assert (stream.jitter_s, stream.fault_s) == (0.0, -inf)
        assert all(isnan(x) for x in (stream.time_s, stream.interval_s, stream.a, stream.b))
        assert all(isnan(x) for x in (stream.c, stream.d, stream.changed_s))
        assert isnan(stream.jumps_s)
        assert isnan(stream.jump_s)
    assert state.frame == (0.0, 0.0, 0.0)
    assert state.tilt[1:] == (0.0, 0.0, 0.0)
    bands = state.surfaces
    assert (bands.sequence, bands.dead_s, bands.brake_dead_s) == (0, inf, inf)
    assert {bands.elevator, bands.aileron, bands.rudder, bands.brake} == {(-1.0, 1.0)}
    assert (NO_IMU.sequence, NO_SURFACES.sequence) == (0, 0)

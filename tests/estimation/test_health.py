"""Ages and their limits, and what is watched of every stream."""

from __future__ import annotations

from math import cos, inf, nan, nextafter, radians, sin
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import attitude_sample, surfaces_sample

from tgl_soar.estimation import health as h
from tgl_soar.estimation.health import (
    ATTITUDE_SHIFT,
    FAULT_TEXTS,
    HealthLimits,
    HealthState,
    fault_words,
    health_step,
    initial_health,
)
from tgl_soar.estimation.motion_state import (
    LastAttitude,
    LastFix,
    MotionState,
    initial_motion,
)
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.types import (
    NO_ATTITUDE,
    NO_FIX,
    AirspeedSample,
    AttitudeSample,
    AutopilotStatus,
    Health,
    ImuSample,
    Inputs,
    PositionFix,
    SurfaceCommand,
    SurfacesSample,
)

# Sums of these are exact in binary, so that a limit is met to the last bit.
LIMITS = HealthLimits(
    position_age_max_s=0.25,
    attitude_age_max_s=0.125,
    heartbeat_age_max_s=3.0,
    frozen_s=1.0,
    surface_error_max=0.25,
)
NEUTRAL = SurfaceCommand(0.0, 0.0, 0.0)
DT = 1.0 / 128.0


def received_at(fix_s: float, attitude_s: float) -> MotionState:
    """An estimator that has used samples of these times."""
    return initial_motion()._replace(
        fix=LastFix(sequence=1, time_s=fix_s, source=0, sum=nan, repeated=0),
        attitude=LastAttitude(
            sequence=1, time_s=attitude_s, used=NO_ATTITUDE, refused=NO_ATTITUDE, refused_in_a_row=0
        ),
    )


def health(
    now: float, fix: float = nan, attitude: float = nan, heartbeat: float = nan, rejected: int = 0
) -> Health:
    motion = received_at(fix, attitude)._replace(rejected=rejected)
    status = AutopilotStatus(time_s=heartbeat, accepts_surfaces=True, armed=True)
    inputs = Inputs(
        time_s=now, position=NO_FIX, attitude=NO_ATTITUDE, autopilot=status, engage=True
    )
    return health_step(LIMITS, initial_health(), motion, inputs, False, False, NEUTRAL, 0.0)[1]


def fresh(found: Health) -> tuple[bool, bool, bool]:
    return found.position_ok, found.attitude_ok, found.autopilot_ok


def test_what_never_came_is_infinitely_old() -> None:
    found = health(10.0)
    assert (found.position_age_s, found.attitude_age_s, found.heartbeat_age_s) == (inf, inf, inf)
    assert fresh(found) == (False, False, False)


def test_ages_are_since_each_was_true() -> None:
    found = health(10.0, 9.875, 9.9375, 8.0, 7)
    assert found[:7] == (0.125, 0.0625, 2.0, True, True, True, 7)


@pytest.mark.parametrize(
    ("limit", "field"),
    [(0.25, "position_ok"), (0.125, "attitude_ok"), (3.0, "autopilot_ok")],
)
def test_a_limit_itself_is_within(limit: float, field: str) -> None:
    then = 10.0 - limit
    assert getattr(health(10.0, then, then, then), field)
    later = nextafter(10.0, inf)
    assert not getattr(health(later, then, then, then), field)


def test_each_age_has_its_own_limit() -> None:
    assert fresh(health(10.0, 9.8, 9.8, 9.8)) == (True, False, True)
    assert fresh(health(10.0, 9.0, 9.9, 9.0)) == (False, True, True)
    assert fresh(health(10.0, 9.9, 9.9, 6.0)) == (True, True, False)


def test_a_clock_mapped_a_little_early_is_no_fault() -> None:
    found = health(10.0, 10.0 + 0.05, 10.0 + 0.05, 10.0 + 1.0)
    assert fresh(found) == (True, True, True)


def test_a_clock_that_went_back_makes_nothing_fresh() -> None:
    # The age of a sample whose time is yet to come is unknown.
    found = health(10.0, 15.0, 15.0, 15.0)
    assert (found.position_age_s, found.attitude_age_s, found.heartbeat_age_s) == (inf, inf, inf)
    assert fresh(found) == (False, False, False)


@pytest.mark.parametrize("now", [nan, inf, -inf])
def test_a_tick_without_a_time_finds_nothing_fresh(now: float) -> None:
    assert fresh(health(now, 10.0, 10.0, 10.0)) == (False, False, False)


# --- streams ------------------------------------------------------------------------------------


class Watch:
    """An aircraft that drifts downstream at 0.5 m/s, nods slowly, and reports it at 128 Hz."""

    def __init__(self) -> None:
        self.state: HealthState = initial_health()
        self.k = 0
        self.health: Health = health(0.0)
        self.reported = 0  # every fault so far
        self.flying = False
        self.command = NEUTRAL

    def run(self, ticks: int, **changes: Any) -> Watch:
        """changes: parts of the inputs by name, each a function of (inputs, tick)."""
        for _ in range(ticks):
            self.k += 1
            now = self.k * DT
            q = quaternion_from_euler(0.0, 0.1 * sin(now), 0.0)
            inputs = Inputs(
                time_s=now,
                position=PositionFix(
                    sequence=self.k,
                    time_s=now,
                    north_m=1.0,
                    east_m=0.5 * now,
                    down_m=-2.0,
                    velocity_north_mps=0.0,
                    velocity_east_mps=0.5,
                    velocity_down_mps=0.0,
                ),
                attitude=attitude_sample(self.k, now, q, (0.0, 0.1 * cos(now), 0.0)),
                autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
                engage=True,
            )
            for name, change in changes.items():
                inputs = inputs._replace(**{name: change(inputs, self.k)})
            motion = received_at(now, now)
            self.state, self.health = health_step(
                LIMITS, self.state, motion, inputs, self.flying, self.flying, self.command, DT
            )
            self.reported |= self.health.faults
        return self


def test_a_good_stream_has_its_rate_and_no_fault() -> None:
    watch = Watch().run(640)
    assert watch.reported == 0
    assert watch.health.position_interval_s == pytest.approx(DT)
    assert watch.health.attitude_interval_s == pytest.approx(DT)
    assert watch.health.position_jitter_s == pytest.approx(0.0, abs=1e-9)
    assert (watch.health.gaps, watch.health.surfaces_answer) == (0, -1)


def test_a_slower_stream_that_jitters_is_measured() -> None:
    """Fixes at 16 Hz, each stamp off by 8 ms to either side in turn."""

    def slow(inputs: Inputs, k: int) -> PositionFix:
        n = (k + 7) // 8
        late = 0.008 * (-1) ** n
        return inputs.position._replace(sequence=n, time_s=n * 8 * DT + late)

    watch = Watch().run(2560, position=slow)
    assert watch.health.position_interval_s == pytest.approx(8 * DT, rel=0.05)
    assert watch.health.position_jitter_s == pytest.approx(0.016, rel=0.1)
    assert watch.health.gaps == 0


def position(**numbers: float) -> Any:
    return lambda inputs, _: inputs.position._replace(**numbers)


def attitude(**numbers: float) -> Any:
    return lambda inputs, _: inputs.attitude._replace(**numbers)


@pytest.mark.parametrize(
    ("what", "fault"),
    [
        ({"position": position(north_m=nan)}, h.NOT_FINITE),
        ({"position": position(east_m=inf)}, h.NOT_FINITE),
        ({"position": position(time_s=nan)}, h.NOT_FINITE),
        ({"position": position(time_s=0.5)}, h.BACKWARDS),
        ({"position": position(down_m=-5.0)}, h.JUMP),
        ({"attitude": attitude(qw=nan)}, h.NOT_FINITE << ATTITUDE_SHIFT),
        ({"attitude": attitude(qw=inf)}, h.NOT_FINITE << ATTITUDE_SHIFT),
        ({"attitude": attitude(time_s=0.5)}, h.BACKWARDS << ATTITUDE_SHIFT),
        ({"attitude": attitude(qw=0.9)}, h.WRONG << ATTITUDE_SHIFT),
        ({"attitude": attitude(qw=1.05)}, h.WRONG << ATTITUDE_SHIFT),
        ({"attitude": attitude(qw=0.0, qx=1.0, qy=0.0, qz=0.0)}, h.JUMP << ATTITUDE_SHIFT),
        ({"autopilot": lambda i, _: i.autopilot._replace(failsafe=True)}, h.FAILSAFE),
        ({"autopilot": lambda i, _: i.autopilot._replace(armed=False)}, h.DISARMED),
    ],
)
def test_one_bad_sample_is_reported_for_a_second(what: dict[str, Any], fault: int) -> None:
    watch = Watch().run(256).run(1, **what)
    assert watch.health.faults == fault
    watch.run(100)
    if fault < h.DISAGREES:  # of a stream
        assert watch.health.faults & fault
    watch.run(256)
    assert watch.health.faults == 0


def test_a_quaternion_and_its_negative_are_the_same_attitude() -> None:
    def flipped(inputs: Inputs, k: int) -> AttitudeSample:
        q = inputs.attitude
        s = (-1.0) ** k
        return q._replace(qw=s * q.qw, qx=s * q.qx, qy=s * q.qy, qz=s * q.qz)

    assert Watch().run(256, attitude=flipped).reported == 0


def test_a_gap_is_reported_and_counted() -> None:
    watch = Watch().run(256)
    last = watch.k
    watch.run(20, position=lambda i, _: i.position._replace(sequence=last, time_s=last * DT))
    assert watch.reported == 0  # nothing new has come, so nothing is known of it yet
    watch.run(1)
    assert (watch.health.faults, watch.health.gaps) == (h.GAP, 1)


def test_another_source_may_be_elsewhere() -> None:
    watch = Watch().run(256)
    watch.run(256, position=lambda i, _: i.position._replace(source=5, north_m=50.0))
    assert watch.reported == 0


def test_a_frozen_position_is_as_old_as_its_last_change() -> None:
    watch = Watch().run(256)
    still = {"position": position(north_m=1.5, east_m=1.0, down_m=-2.0, velocity_east_mps=0.5)}
    watch.run(1, **still)
    began = watch.k * DT
    watch.run(128, **still)
    assert watch.health.position_ok
    assert not watch.reported & h.FROZEN
    watch.run(1, **still)
    assert watch.health.faults & h.FROZEN
    assert watch.health.position_age_s == watch.k * DT - began
    assert not watch.health.position_ok
    watch.run(2)
    assert watch.health.position_ok
    assert not watch.health.faults & h.FROZEN


def test_a_frozen_position_whose_stamps_go_back_is_found_out_as_soon() -> None:
    """Its last change lies in what is now the future: it counts from where the stamps went on."""
    still: dict[str, Any] = {
        "north_m": 1.5, "east_m": 1.0, "down_m": -2.0, "velocity_east_mps": 0.5,
    }  # fmt: skip
    watch = Watch().run(896).run(64, position=position(**still))
    assert not watch.reported & h.FROZEN

    def behind(inputs: Inputs, _: int) -> PositionFix:
        return inputs.position._replace(**still, time_s=inputs.time_s - 5.0)

    watch.run(129, position=behind)  # the limit itself, one second
    assert not watch.health.faults & h.FROZEN
    watch.run(1, position=behind)
    assert watch.health.faults & h.FROZEN


@pytest.mark.parametrize("velocity", [0.0, nan])
def test_a_position_that_says_that_it_stands_still_may(velocity: float) -> None:
    """With velocities of zero; or without any, of an aircraft that does not turn either."""
    still = {
        "position": position(
            east_m=0.0,
            velocity_north_mps=velocity,
            velocity_east_mps=velocity,
            velocity_down_mps=velocity,
        ),
        "attitude": attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0, pitch_rate_frd_radps=0.0),
    }
    watch = Watch().run(512, **still)
    assert watch.reported == 0
    assert watch.health.position_ok
    assert watch.health.attitude_ok


@pytest.mark.parametrize("velocity", [0.0, nan])
def test_in_flight_nothing_stands_still(velocity: float) -> None:
    """What says so, with velocities or rates of exactly zero, is frozen like any other."""
    no_velocity = {
        "velocity_north_mps": velocity,
        "velocity_east_mps": velocity,
        "velocity_down_mps": velocity,
    }
    watch = Watch()
    watch.flying = True
    watch.run(256, position=position(east_m=0.0, **no_velocity))
    assert watch.health.faults == h.FROZEN
    assert not watch.health.position_ok
    watch.run(256, attitude=attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0, pitch_rate_frd_radps=0.0))
    assert watch.health.faults == h.FROZEN << ATTITUDE_SHIFT
    assert not watch.health.attitude_ok


def test_what_stood_still_on_the_ground_may_begin_to_move_in_flight() -> None:
    still = {"attitude": attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0, pitch_rate_frd_radps=0.0)}
    watch = Watch().run(512, **still)
    watch.flying = True
    watch.run(127, **still)
    assert watch.health.attitude_ok
    watch.run(2, **still)
    assert not watch.health.attitude_ok


def from_side_to_side(every: int) -> Any:
    """Rolled by 60 degrees in one sample of so many."""
    q = quaternion_from_euler(radians(60.0), 0.0, 0.0)

    def sample(inputs: Inputs, k: int) -> AttitudeSample:
        a = inputs.attitude
        return a._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3]) if k % every == 0 else a

    return sample


@pytest.mark.parametrize("every", [2, 100])  # and 0.8 s
def test_an_attitude_that_goes_on_jumping_is_as_old_as_its_first_jump(every: int) -> None:
    watch = Watch().run(every + 120, attitude=from_side_to_side(every))
    assert watch.reported & h.JUMP << ATTITUDE_SHIFT
    assert watch.health.attitude_ok  # not for a second yet
    watch.run(150, attitude=from_side_to_side(every))
    assert not watch.health.attitude_ok
    first_s = every * DT
    assert watch.health.attitude_age_s == watch.k * DT - first_s
    watch.run(128 + 100)
    assert watch.health.attitude_ok


@pytest.mark.parametrize("every", [140, 400])  # 1.1 and 3.1 s
def test_an_attitude_that_jumps_now_and_then_is_used_between(every: int) -> None:
    watch = Watch()
    for _ in range(1000):
        watch.run(1, attitude=from_side_to_side(every))
        assert watch.health.attitude_ok
    assert watch.reported & h.JUMP << ATTITUDE_SHIFT


def test_motion_capture_that_repeats_itself_is_frozen() -> None:
    lost = {
        "position": position(east_m=0.0, velocity_north_mps=nan, velocity_east_mps=nan),
    }
    assert Watch().run(256, **lost).health.faults == h.FROZEN


def test_a_frozen_attitude_is_as_old_as_its_last_change() -> None:
    stuck = {"attitude": attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0, pitch_rate_frd_radps=0.1)}
    watch = Watch().run(256, **stuck)
    assert watch.health.faults == h.FROZEN << ATTITUDE_SHIFT
    assert not watch.health.attitude_ok


def test_positions_and_velocities_in_different_frames_are_reported() -> None:
    """The aircraft flies east at 4 m/s and the velocity is reported in another frame: north."""

    def flies(inputs: Inputs, k: int) -> PositionFix:
        return inputs.position._replace(
            east_m=4.0 * k * DT, velocity_north_mps=4.0, velocity_east_mps=0.0
        )

    watch = Watch().run(512, position=flies)
    assert watch.health.faults & h.WRONG
    assert h.INSANE & h.WRONG
    assert (
        watch.health.position_ok
    )  # it is not engaged with; in flight it does not disengage for it


def imu(tilt_deg: float) -> Any:
    """Accelerometers at rest; the attitude says level, they say pitched up by so much."""

    def sample(inputs: Inputs, k: int) -> ImuSample:
        t = radians(tilt_deg)
        return ImuSample(
            sequence=k,
            time_s=inputs.time_s,
            force_x_frd_mps2=9.81 * sin(t),
            force_y_frd_mps2=0.0,
            force_z_frd_mps2=-9.81 * cos(t),
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        )

    return sample


@pytest.mark.parametrize(("tilt_deg", "agrees"), [(0.0, True), (15.0, True), (35.0, False)])
def test_attitude_and_accelerometers(tilt_deg: float, agrees: bool) -> None:
    level = attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0)
    watch = Watch().run(1280, imu=imu(tilt_deg), attitude=level)
    assert (watch.health.faults & h.DISAGREES == 0) == agrees
    # Accelerations that have stopped say nothing.
    last = ImuSample(
        sequence=watch.k,
        time_s=watch.k * DT,
        force_x_frd_mps2=0.0,
        force_y_frd_mps2=0.0,
        force_z_frd_mps2=9.81,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    )
    watch.run(256, imu=lambda _i, _k: last)
    assert watch.health.faults & h.DISAGREES == 0


@pytest.mark.parametrize(("before_deg", "after_deg"), [(0.0, 35.0), (35.0, 0.0)])
def test_after_a_clock_that_went_back_they_are_compared_again(
    before_deg: float, after_deg: float
) -> None:
    level = attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0)
    watch = Watch().run(1280, imu=imu(before_deg), attitude=level)
    assert (watch.health.faults & h.DISAGREES == 0) == (before_deg == 0.0)
    watch.k = 0
    watch.run(1000, imu=imu(after_deg), attitude=level)
    assert (watch.health.faults & h.DISAGREES == 0) == (after_deg == 0.0)


def test_a_sample_out_of_order_does_not_begin_the_comparison_again() -> None:
    """Every tenth is 0.1 s old."""

    def late(inputs: Inputs, k: int) -> Any:
        sample = imu(35.0)(inputs, k)
        return sample._replace(time_s=sample.time_s - (0.1 if k % 10 == 0 else 0.0))

    level = attitude(qw=1.0, qx=0.0, qy=0.0, qz=0.0)
    assert Watch().run(1280, imu=late, attitude=level).health.faults & h.DISAGREES


@pytest.mark.parametrize(("bank_deg", "agrees"), [(20.0, True), (25.0, False)])
def test_a_turn_that_lasts_is_no_wrong_attitude_up_to_twenty_degrees(
    bank_deg: float, agrees: bool
) -> None:
    """Coordinated: the force is along the body's z axis, by one over the cosine of the bank.  What
    a turn with more looks like is what BANK_MAX and SIDE_BANK warn of."""
    t = radians(bank_deg)

    def turning(inputs: Inputs, k: int) -> Any:
        return imu(0.0)(inputs, k)._replace(force_z_frd_mps2=-9.81 / cos(t))

    banked = attitude(qw=cos(t / 2.0), qx=sin(t / 2.0), qy=0.0, qz=0.0)
    watch = Watch().run(2560, imu=turning, attitude=banked)
    assert (watch.health.faults & h.DISAGREES == 0) == agrees


def test_a_rotation_reported_the_other_way_round_is_detected() -> None:
    """The conjugate quaternion: what was pitched up by 20 degrees is pitched down."""
    q = quaternion_from_euler(0.0, radians(-20.0), 0.0)
    wrong = attitude(qw=q[0], qx=q[1], qy=q[2], qz=q[3])
    watch = Watch().run(1280, imu=imu(20.0), attitude=wrong)
    assert watch.health.faults & h.DISAGREES


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_accelerations_that_are_no_numbers_reset_it(bad: float) -> None:
    watch = Watch().run(256, imu=imu(0.0))

    def broken(inputs: Inputs, k: int) -> ImuSample:
        return ImuSample(
            sequence=k,
            time_s=inputs.time_s,
            force_x_frd_mps2=bad,
            force_y_frd_mps2=0.0,
            force_z_frd_mps2=-9.81,
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        )

    watch.run(64, imu=broken).run(640, imu=imu(0.0))
    assert watch.reported == 0


@pytest.mark.parametrize(
    ("airspeed", "fault"),
    [(0.0, 0), (8.5, 0), (80.0, 0), (80.1, h.AIRSPEED), (-0.1, h.AIRSPEED), (nan, h.AIRSPEED)],
)
def test_airspeed_makes_sense(airspeed: float, fault: int) -> None:
    watch = Watch().run(10, airspeed=lambda i, k: AirspeedSample(k, i.time_s, airspeed))
    assert watch.health.faults == fault


def test_an_airspeed_that_stops_is_reported() -> None:
    watch = Watch().run(10, airspeed=lambda _i, _k: AirspeedSample(1, 0.0, 8.5))
    assert watch.health.faults == 0
    watch.run(400, airspeed=lambda _i, _k: AirspeedSample(1, 0.0, 8.5))
    assert watch.health.faults == h.AIRSPEED


# --- surfaces -----------------------------------------------------------------------------------


class Servo:
    """Reads back what was commanded some ticks ago, every so many ticks."""

    def __init__(self, watch: Watch, delay: int, every: int, follows: bool = True) -> None:
        self.watch, self.delay, self.every, self.follows = watch, delay, every, follows
        self.history = [NEUTRAL] * (delay + 1)
        self.sample = SurfacesSample(sequence=0, time_s=nan, elevator=nan, aileron=nan, rudder=nan)

    def __call__(self, inputs: Inputs, k: int) -> SurfacesSample:
        self.history.append(self.watch.command)
        if k % self.every == 0:
            measured = self.history[-1 - self.delay] if self.follows else NEUTRAL
            self.sample = surfaces_sample(k, inputs.time_s, measured)
        return self.sample


@pytest.mark.parametrize("every", [1, 13, 64])  # 128, 10, and 2 Hz
@pytest.mark.parametrize("delay", [1, 20])
@pytest.mark.parametrize("follows", [True, False])
def test_surfaces_that_follow_and_surfaces_that_do_not(
    every: int, delay: int, follows: bool
) -> None:
    """An elevator that swings by 0.6 at 0.5 Hz, then stands at 0.6: reported 8 or 160 ms late."""
    watch = Watch()
    watch.flying = True
    servo = Servo(watch, delay, every, follows)
    answers = set()
    for k in range(1024):
        swing = 0.6 * sin(0.5 * 2 * 3.14159 * k * DT) if k < 512 else 0.6
        watch.command = SurfaceCommand(swing, 0.0, -swing)
        watch.run(1, surfaces=servo)
        answers.add(watch.health.surfaces_answer)
    assert answers <= {1, -1} if follows else 0 in answers
    assert bool(watch.health.faults & h.SURFACES) == (not follows)
    assert watch.health.surfaces_answer == int(follows)


@pytest.mark.parametrize(
    ("field", "off"), [(f, s) for f in ("elevator", "aileron", "rudder") for s in (1.0, -1.0)]
)
def test_the_tolerance_is_met_on_its_boundary(field: str, off: float) -> None:
    """Of each surface, to either side, once the band has closed."""

    def answer(error: float) -> int:
        watch = Watch()
        watch.flying = True
        watch.run(
            384,
            surfaces=lambda i, k: SurfacesSample(
                sequence=k, time_s=i.time_s, elevator=0.0, aileron=0.0, rudder=0.0
            )._replace(**cast("Any", {field: off * error})),
        )
        return watch.health.surfaces_answer

    assert answer(0.25) == 1
    assert answer(nextafter(0.25, inf)) == 0


def test_nobody_knows_of_surfaces_on_the_ground_or_in_silence() -> None:
    def against(inputs: Inputs, k: int) -> SurfacesSample:
        return SurfacesSample(
            sequence=k, time_s=inputs.time_s, elevator=1.0, aileron=-1.0, rudder=1.0
        )

    watch = Watch().run(512, surfaces=against)
    assert watch.health.surfaces_answer == -1
    watch.flying = True
    watch.run(512, surfaces=against)
    assert watch.health.surfaces_answer == 0
    last = watch.k
    watch.run(
        200,
        surfaces=lambda _i, _k: SurfacesSample(
            sequence=last, time_s=last * DT, elevator=1.0, aileron=-1.0, rudder=1.0
        ),
    )
    assert watch.health.surfaces_answer == -1
    watch.flying = False
    watch.run(1, surfaces=against)
    watch.flying = True
    watch.run(1, surfaces=against)
    assert watch.health.surfaces_answer == 1  # it starts again


def test_surfaces_that_are_not_known_are_no_fault() -> None:
    watch = Watch()
    watch.flying = True
    watch.run(
        512,
        surfaces=lambda i, k: SurfacesSample(
            sequence=k, time_s=i.time_s, elevator=nan, aileron=nan, rudder=nan
        ),
    )
    assert watch.health.surfaces_answer == 1
    assert watch.reported == 0


def test_a_brake_is_dead_when_samples_go_on_saying_so_and_not_by_one_before_a_silence() -> None:
    def sample(sequence: int, time_s: float, brake: float) -> SurfacesSample:
        return SurfacesSample(
            sequence=sequence, time_s=time_s, elevator=0.0, aileron=0.0, rudder=0.0, brake=brake
        )

    def out(brake: float) -> Any:
        return lambda i, k: sample(k, i.time_s, brake)

    watch = Watch()
    watch.flying = True
    watch.run(128, surfaces=out(0.0)).run(1, surfaces=out(1.0))
    odd = watch.k
    watch.run(128, surfaces=lambda _i, _k: sample(odd, odd * DT, 1.0))
    assert watch.reported == 0
    watch.run(1, surfaces=out(0.0))
    watch.run(round(0.9 * 0.3 / DT), surfaces=out(1.0)).run(1, surfaces=out(0.0))
    assert watch.reported == 0
    watch.run(round(1.1 * 0.3 / DT) + 1, surfaces=out(1.0))
    assert watch.reported == h.BRAKE


def test_surfaces_are_dead_when_samples_go_on_saying_so_and_not_by_one_before_a_silence() -> None:
    def sample(sequence: int, time_s: float, elevator: float) -> SurfacesSample:
        return SurfacesSample(
            sequence=sequence, time_s=time_s, elevator=elevator, aileron=0.0, rudder=0.0
        )

    watch = Watch()
    watch.flying = True
    watch.run(256, surfaces=lambda i, k: sample(k, i.time_s, 0.0))
    watch.run(1, surfaces=lambda i, k: sample(k, i.time_s, 1.0))
    odd = watch.k
    watch.run(round(0.9 * 1.0 / DT), surfaces=lambda _i, _k: sample(odd, odd * DT, 1.0))
    assert watch.reported == 0
    assert watch.health.surfaces_answer == 1
    watch.run(1, surfaces=lambda i, k: sample(k, i.time_s, 1.0))
    assert watch.health.surfaces_answer == 0


# --- words --------------------------------------------------------------------------------------


def test_every_fault_has_its_words() -> None:
    streams = (h.GAP, h.FROZEN, h.JUMP, h.NOT_FINITE, h.BACKWARDS, h.WRONG)
    bits = [
        *streams,
        *(bit << ATTITUDE_SHIFT for bit in streams),
        *(h.DISAGREES, h.AIRSPEED, h.SURFACES, h.FAILSAFE, h.DISARMED, h.BRAKE, h.RECKONED),
        h.RANGE,
    ]
    assert bits == [1 << i for i in range(len(FAULT_TEXTS))]
    assert fault_words(0) == ""
    assert fault_words(h.FROZEN | h.FAILSAFE) == "position frozen, autopilot in failsafe"


anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-2.0, 2.0),
    st.sampled_from([nan, inf, -inf, 1e308, -1e308, 5e-324]),
)
numbers = st.integers(0, 5)


@settings(deadline=None, max_examples=150)
@given(data=st.data())
def test_no_inputs_raise(data: st.DataObject) -> None:
    def draw(*kinds: Any) -> list[Any]:
        return [data.draw(kind) for kind in kinds]

    state = initial_health()
    for _ in range(4):
        inputs = Inputs(
            time_s=data.draw(anything),
            position=PositionFix._make((*draw(numbers, *[anything] * 7), 0, nan, False)),
            attitude=AttitudeSample._make(draw(numbers, *[anything] * 8)),
            autopilot=AutopilotStatus(
                time_s=data.draw(anything), accepts_surfaces=True, armed=True
            ),
            engage=True,
            imu=ImuSample._make(draw(numbers, *[anything] * 7)),
            airspeed=AirspeedSample(*draw(numbers, anything, anything)),
            surfaces=SurfacesSample._make(draw(numbers, *[anything] * 5)),
        )
        command = SurfaceCommand(*draw(anything, anything, anything))
        state, found = health_step(
            LIMITS,
            state,
            initial_motion(),
            inputs,
            data.draw(st.booleans()),
            data.draw(st.booleans()),
            command,
            DT,
        )
        assert 0 <= found.faults < 1 << len(FAULT_TEXTS)
        assert found.surfaces_answer in (-1, 0, 1)


@pytest.mark.parametrize(
    ("sample", "off"),
    [(0.75, 0.25), (0.5, 0.0), (0.0, 0.0), (-0.25, 0.0), (-0.75, 0.5), (nan, 0.0)],
)
def test_a_surface_is_off_by_what_it_is_beyond_the_commands_of_late(
    sample: float, off: float
) -> None:
    assert h._outside(h.BandState(-0.25, 0.5), sample) == off

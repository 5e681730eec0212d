"""The schedule: what it keeps, which way it goes, and that it takes any number without a step."""

from __future__ import annotations

from math import cos, inf, isfinite, nan, pi, radians, sin

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import dynamics_of, laws_from
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import (
    AGE_DOWN_S,
    AGE_FOUND_S,
    AGE_UP_S,
    FIX_AGE_S,
    HOLD_S,
    LAG_LEFT_S,
    LAG_TURNS_S,
    SPEED_S,
    Dynamics,
    GainSchedule,
    age_step,
    lean_of_glide,
    pitch_gains,
    schedule_at_age,
    schedule_of,
    soaring_gains,
    speed_step,
    speed_within,
)
from tgl_soar.control.soaring import SoaringGains
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import GRAVITY_MPS2

PID = PidGains(
    kp=0.95,
    ki=0.11,
    kd=0.5,
    rate_filter_radps=88.0,
    integral_max=0.14,
    output_min=-0.21,
    output_max=0.1,
)
GAINS = SoaringGains(PID, 2.1)
SPEED = 8.5
LEAN = radians(15.0)
FOUND_ON = Dynamics(
    speed_mps=SPEED,
    short_period_radps=11.5,
    damping=0.75,
    effect_radps2=31.0,
    late_s=0.026,
    lag_s=0.0185,
    glide_ratio=6.45,
    best_glide_mps=9.25,
    path_s=0.0,
)
AS_FOUND = schedule_of(SPEED, LEAN, FOUND_ON, FOUND_ON)


def soaring(
    lean_deg: float, speed: float = SPEED, schedule: GainSchedule = AS_FOUND, imu: float = 1.0
) -> PidGains:
    return soaring_gains(GAINS, schedule, imu, speed, eta_from_lean(radians(lean_deg))).pid


def on(**changes: float) -> GainSchedule:
    return schedule_of(SPEED, LEAN, FOUND_ON, FOUND_ON._replace(**changes))


def rise(lean_deg: float, speed: float) -> float:
    return speed * sin(radians(lean_deg) - lean_of_glide(AS_FOUND, speed))


def drift(lean_deg: float) -> float:
    return GRAVITY_MPS2 * cos(radians(lean_deg))


def test_where_the_rise_is_that_of_the_finding_the_gains_are_as_found() -> None:
    """On the airframe of the finding, at a lean that is the glide's own more than that."""
    lean = 15.0 + lean_of_glide(AS_FOUND, SPEED) * 180.0 / pi
    found = soaring(lean)
    assert found.kd == pytest.approx(PID.kd, rel=0.01)
    assert found.kp == pytest.approx(PID.kp, rel=0.02)  # g cos l differs by 1.4 degrees
    assert found.ki / found.kp == pytest.approx(PID.ki / PID.kp)
    assert pitch_gains(PID, AS_FOUND, SPEED) == pytest.approx(PID)


def test_without_a_speed_gains_are_flown_as_they_stand() -> None:
    """The plain PID of the paper, on every line, airframe and link."""
    plain = schedule_of(0.0, LEAN, FOUND_ON, FOUND_ON._replace(late_s=0.1, effect_radps2=90.0))
    for lean in (5.0, 45.0):
        assert soaring_gains(GAINS, plain, 0.0, 12.0, eta_from_lean(radians(lean))) is GAINS
    assert pitch_gains(PID, plain, 12.0) is PID


@given(st.floats(17.0, 60.0), st.floats(7.6, 14.0))
def test_beyond_the_crossover_the_gain_falls_as_far_as_it_did(lean: float, speed: float) -> None:
    if rise(lean, speed) >= SPEED * sin(LEAN):
        kept = PID.kd * SPEED * sin(LEAN)
        assert soaring(lean, speed).kd * rise(lean, speed) == pytest.approx(kept)


@given(st.floats(32.0, 60.0))
def test_the_loop_crosses_over_where_it_did_on_lines_that_lean_further(lean: float) -> None:
    pid = soaring(lean)
    wanted = PID.kp * SPEED * sin(LEAN) + PID.kd * drift(15.0)
    assert pid.kp * rise(lean, SPEED) + pid.kd * drift(lean) == pytest.approx(wanted)


def test_a_line_that_leans_by_less_than_the_glide_asks_for_less() -> None:
    """At 14 m/s pitching up first raises the aircraft the wrong way on a line leaning 5 degrees."""
    assert rise(5.0, 14.0) < 0.0 < rise(15.0, 14.0)
    steep, flat = soaring(15.0, 14.0), soaring(5.0, 14.0)
    assert flat.kd < 0.5 * steep.kd
    assert flat.kp < 0.2 * steep.kp


def lateness_of(late_s: float, lag_s: float) -> float:
    """T of an elevator, of which the lag is a part."""
    return late_s - 0.5 * lag_s + HOLD_S


T_0 = lateness_of(0.026, 0.0185)
# Twice as late, by delay alone.
TWICE_S = 0.026 + T_0


def test_a_late_elevator_is_flown_with_less_and_an_early_one_with_no_more() -> None:
    late = on(late_s=TWICE_S)
    slower = pitch_gains(PID, late, SPEED)
    assert slower.kp == pytest.approx(0.5**0.95 * PID.kp)
    assert slower.kd == pytest.approx(0.5**0.65 * PID.kd)
    assert soaring(15.0, schedule=late).kd < 0.75 * soaring(15.0).kd
    # Fixes are old already: there the same delay costs less.
    assert soaring(15.0, schedule=late, imu=0.0).kd > 1.05 * soaring(15.0, schedule=late).kd
    assert on(late_s=0.0)._replace(late_s=AS_FOUND.late_s) == AS_FOUND


def test_a_lag_delays_the_loop_by_half_of_a_delay() -> None:
    """Servos of 18.5 and 38.5 ms: 20 ms of lag more are 10 ms of delay."""
    slow = on(late_s=0.046, lag_s=0.0385)
    assert slow.late_s == pytest.approx(T_0 + 0.010)
    delayed = on(late_s=0.036)
    assert slow == pytest.approx(delayed)
    assert on(late_s=0.010, lag_s=0.5).late_s == pytest.approx(lateness_of(0.010, 0.010))


def test_an_elevator_of_more_effect_is_moved_less() -> None:
    strong = pitch_gains(PID, on(effect_radps2=62.0), SPEED)
    assert strong.kp == pytest.approx(0.5 * PID.kp)
    assert strong.kd == pytest.approx(0.5 * PID.kd)


def test_an_airframe_with_less_damping_of_its_own_is_flown_with_less_stiffness() -> None:
    soft = on(short_period_radps=6.6)
    loop = pitch_gains(PID, soft, SPEED)
    assert loop.kd == pytest.approx(PID.kd * (6.6 / 11.5) ** 0.35)
    assert loop.kp == pytest.approx(PID.kp * (6.6 / 11.5) ** 1.8)
    assert soaring(15.0, schedule=soft).kp < 0.9 * soaring(15.0).kp


def test_the_line_sees_less_of_a_slow_pitch_loop_than_that_loop() -> None:
    """The airframe of half the period, and an elevator that is twice as late."""
    soft, late = on(short_period_radps=6.6), on(late_s=TWICE_S)
    for schedule in (soft, late):
        slower = schedule.stiffness
        assert slower < min(schedule.bandwidth_imu, schedule.bandwidth) < 1.0
    assert soft.bandwidth_imu == pytest.approx((6.6 / 11.5) ** 0.2)
    assert late.bandwidth_imu == pytest.approx(0.5**0.7)


def test_the_airframe_may_be_known_at_another_speed() -> None:
    """The effect grows with V², the short period with V."""
    faster = on(speed_mps=17.0, effect_radps2=4.0 * 31.0, short_period_radps=23.0)
    assert faster == pytest.approx(AS_FOUND)


def test_an_unknown_airframe_is_taken_to_be_that_of_the_finding() -> None:
    unknown = Dynamics._make((0.0,) * 9)._replace(late_s=0.026, lag_s=0.0185)
    schedule = schedule_of(SPEED, LEAN, FOUND_ON, unknown)
    assert (schedule.stiffness, schedule.damping, schedule.bandwidth_imu) == (1.0, 1.0, 1.0)
    assert soaring(15.0, schedule=schedule).kd == pytest.approx(PID.kd)


def test_the_gains_of_pitch_fall_with_speed() -> None:
    """By less than the effect grows, V²: the airframe's own damping grows, too."""
    fast = pitch_gains(PID, AS_FOUND, 2.0 * SPEED)
    assert fast.kp == pytest.approx(PID.kp * 2.0 ** (1.2 - 2.0))
    assert fast.kd == pytest.approx(PID.kd * 2.0 ** (0.8 - 2.0))
    assert pitch_gains(PID, AS_FOUND, nan) == pytest.approx(PID)


def test_an_airspeed_is_averaged_and_kept_where_it_is_not_known() -> None:
    assert speed_step(nan, 9.0, 0.005) == 9.0
    assert speed_step(9.0, nan, 0.005) == 9.0
    speed = 8.0
    for _ in range(round(SPEED_S / 0.005)):
        speed = speed_step(speed, 9.0, 0.005)
    assert speed == pytest.approx(8.63, abs=0.01)  # 1 - 1/e of the way
    assert speed_within(AS_FOUND, nan) == SPEED
    assert speed_within(AS_FOUND, 100.0) == 2.5 * SPEED
    assert speed_within(AS_FOUND, 0.0) == 0.6 * SPEED


def test_half_a_tick_of_a_slow_loop_delays_as_a_late_command_does() -> None:
    """A command holds for a whole tick, and the gains were found at 200 Hz."""
    known = {"DYN_SPEED": 9.25, "DYN_FREQ": 11.5, "DYN_DAMP": 0.75, "DYN_EFFECT": 31.0}
    values = ParameterSet().changed({**known, "CMD_DELAY": 0.02, "LAT_LATE": 0.03})
    later = values.changed({"CMD_DELAY": 0.0225})
    slow, usual, fast = (values.changed({"LOOP_RATE": hz}) for hz in (100.0, 200.0, 250.0))
    assert dynamics_of(slow).late_s == pytest.approx(dynamics_of(later).late_s)
    assert dynamics_of(slow).lag_s == dynamics_of(usual).lag_s
    here = SoaringFrame(0.0, 0.0, 0.0, 0.0)
    slow_laws, later_laws, usual_laws = (laws_from(v, here) for v in (slow, later, usual))
    assert slow_laws.schedule == pytest.approx(later_laws.schedule)
    assert slow_laws.schedule.damping < usual_laws.schedule.damping
    assert slow_laws.lateral_schedule == pytest.approx(later_laws.lateral_schedule)
    assert laws_from(fast, here).schedule == usual_laws.schedule  # nothing is flown faster for it


@pytest.mark.parametrize("speed_mps", [0.0, 0.5])
def test_without_a_schedule_the_airspeed_is_what_it_is(speed_mps: float) -> None:
    """The bank's law and the brake take it from here, and want no 0."""
    stands = schedule_of(speed_mps, LEAN, FOUND_ON, FOUND_ON)
    assert speed_within(stands, 9.0) == 9.0
    assert speed_within(stands, nan) == FOUND_ON.best_glide_mps
    unknown = FOUND_ON._replace(glide_ratio=0.0, best_glide_mps=0.0)
    assert speed_within(schedule_of(speed_mps, LEAN, FOUND_ON, unknown), nan) > 0.0


# The aircraft of the finding with the lag of its path, and one that is soft and late.
KNOWN = on(path_s=0.16)
SOFT = on(path_s=0.2, short_period_radps=6.6, late_s=0.05, lag_s=0.03)


def crossover(pid: PidGains, lean: float, speed: float) -> float:
    return pid.kp * rise(lean, speed) + pid.kd * drift(lean)


WANTED = PID.kp * SPEED * sin(LEAN) + PID.kd * GRAVITY_MPS2 * cos(LEAN)  # as found


def path_lag(schedule: GainSchedule, speed: float) -> float:
    return schedule.path_s * SPEED / speed


def other_lag(schedule: GainSchedule, speed: float, imu: float) -> float:
    """Of the pitch loop, of the elevator, and of fixes."""
    own: float = schedule.pitch_lag_s * (SPEED / speed) ** 0.4
    return own + schedule.late_s + (1.0 - imu) * FIX_AGE_S


@given(st.floats(5.0, 59.0), st.floats(7.0, 12.0), st.sampled_from([0.0, 1.0]))
def test_what_lead_leaves_of_the_lag_has_a_limit(lean: float, speed: float, imu: float) -> None:
    for schedule in (KNOWN, SOFT):
        pid = soaring(lean, speed, schedule, imu)
        lag = path_lag(schedule, speed) + other_lag(schedule, speed, imu)
        left = lag * crossover(pid, lean, speed) - pid.kd * rise(lean, speed)
        assert left / WANTED <= LAG_LEFT_S + (1.0 - imu) * FIX_AGE_S + 1e-9


@given(st.floats(10.0, 59.0), st.floats(7.0, 12.0))
def test_by_fixes_what_lag_turns_at_the_crossover_has_a_limit(lean: float, speed: float) -> None:
    schedule = SOFT._replace(path_s=0.1)
    pid = soaring(lean, speed, schedule, 0.0)
    faster = pid.kd * rise(lean, speed) / path_lag(schedule, speed) + crossover(pid, lean, speed)
    assert faster / WANTED * other_lag(schedule, speed, 0.0) <= LAG_TURNS_S + 1e-9


@given(st.floats(5.0, 59.0), st.floats(1.1, 4.0))
def test_gains_that_are_raised_yield_by_no_more(lean: float, factor: float) -> None:
    raised = GAINS._replace(pid=PID._replace(kp=factor * PID.kp, kd=factor * PID.kd))
    eta = eta_from_lean(radians(lean))
    kept = [
        soaring_gains(gains, SOFT, 0.0, SPEED, eta).pid.kd
        / soaring_gains(gains, SOFT._replace(path_s=0.0), 0.0, SPEED, eta).pid.kd
        for gains in (GAINS, raised)
    ]
    if rise(lean, SPEED) > 0.0:
        assert kept[1] == pytest.approx(kept[0], rel=0.2)


def test_the_line_of_the_finding_yields_nothing_and_a_flat_or_soft_one_does() -> None:
    for lean in (15.0, 20.0, 23.0, 30.0):
        known, plain = soaring(lean, schedule=KNOWN), soaring(lean)
        assert known.kd == pytest.approx(plain.kd, rel=0.02)
        assert known.kp == pytest.approx(plain.kp, rel=0.02)
    assert soaring(5.0, schedule=KNOWN).kd < 0.95 * soaring(5.0).kd
    unknown = SOFT._replace(path_s=0.0)
    for lean in (5.0, 45.0):
        yielding, firm = soaring(lean, schedule=SOFT), soaring(lean, schedule=unknown)
        assert yielding.kd < firm.kd
        assert yielding.kp / firm.kp == pytest.approx((yielding.kd / firm.kd) ** 2)
        assert yielding.ki / yielding.kp == pytest.approx(firm.ki / firm.kp)


def test_a_quick_path_costs_gain_by_fixes_alone() -> None:
    """There the pitch loop has less rate gain to bear a loop that crosses over late."""
    quick = SOFT._replace(path_s=0.1)
    firm = SOFT._replace(path_s=0.0)
    by_fixes, measured = (
        soaring(30.0, schedule=quick, imu=imu).kd / soaring(30.0, schedule=firm, imu=imu).kd
        for imu in (0.0, 1.0)
    )
    assert by_fixes < 0.9
    assert measured > 0.99


def test_the_lag_of_the_path_is_that_of_the_speed_of_the_finding() -> None:
    """It falls with speed; known at twice the speed of the finding, it is twice as long there."""
    assert on(path_s=0.08, speed_mps=2.0 * SPEED).path_s == pytest.approx(0.16)
    assert schedule_at_age(KNOWN, 0.1).path_s == KNOWN.path_s


@given(st.floats(-20.0, 59.0), st.floats(6.0, 20.0), st.floats(0.0, 0.1))
@example(16.0, 19.0, 0.0625)
def test_gains_change_by_no_step(lean: float, speed: float, turned: float) -> None:
    """A tenth of a degree is a tick at 20 deg/s, four times TGL_ROT_SLEW's usual 5: 2 %, in the
    fastest air 4."""
    for schedule in (AS_FOUND, KNOWN, SOFT):
        no_step(schedule, lean, speed, turned)


def no_step(schedule: GainSchedule, lean: float, speed: float, turned: float) -> None:
    before = soaring(lean, speed, schedule)
    after = soaring(lean + turned, speed + 0.1 * turned, schedule)
    for one, other in ((before.kp, after.kp), (before.kd, after.kd), (before.ki, after.ki)):
        assert abs(other - one) <= 0.5 * turned * max(one, other) + 1e-9


@given(
    st.floats(),
    st.floats(),
    st.floats(0.0, 5.0),
    st.floats(0.0, 0.5),
    st.floats(0.0, 60.0),
    st.floats(0.0, 500.0),
    st.floats(0.0, 80.0),
    st.floats(0.0, 5.0),
)
def test_whatever_comes_the_gains_are_finite_and_act_the_right_way(
    eta: float,
    speed: float,
    kp: float,
    late: float,
    period: float,
    effect: float,
    ratio: float,
    path: float,
) -> None:
    schedule = on(
        late_s=late,
        short_period_radps=period,
        effect_radps2=effect,
        glide_ratio=ratio,
        path_s=path,
    )
    gains = GAINS._replace(pid=PID._replace(kp=kp))
    pid = soaring_gains(gains, schedule, 0.5, speed, eta).pid
    inner = pitch_gains(PID, schedule, speed)
    for gain in (pid.kp, pid.ki, pid.kd, inner.kp, inner.ki, inner.kd):
        assert isfinite(gain)
        assert gain >= 0.0
    assert pid[3:] == PID[3:]
    assert isfinite(speed_within(schedule, inf))


def test_old_attitudes_slow_the_loop_as_a_late_elevator_does_and_more() -> None:
    """An age of twice what the elevator is late, and an elevator that is three times as late."""
    old = schedule_at_age(AS_FOUND, AGE_FOUND_S + 2.0 * T_0)
    late = on(late_s=0.026 + 2.0 * T_0)
    assert old[4:6] == pytest.approx(late[4:6])
    for field in ("stiffness", "damping", "bandwidth_imu"):
        slowed = getattr(old, field)
        assert slowed == pytest.approx(getattr(AS_FOUND, field) / 3.0)
        assert slowed < getattr(late, field)
    assert old.bandwidth < late.bandwidth
    assert schedule_at_age(AS_FOUND, AGE_FOUND_S) is AS_FOUND


def test_an_early_elevator_pays_for_old_attitudes_first() -> None:
    """No gain was added for it, so that none is lost until both are later than as found."""
    early = on(late_s=0.006)
    assert schedule_at_age(early, AGE_FOUND_S + 0.012) == pytest.approx(early)
    assert schedule_at_age(early, AGE_FOUND_S + 0.03).stiffness < early.stiffness


def test_the_age_is_averaged_so_that_a_hiccup_hardly_counts() -> None:
    age, dt = 0.005, 0.005
    for tick in range(10):  # 50 ms without an attitude
        age = age_step(age, 0.005 + tick * dt, 0.2, True, dt)
    assert schedule_at_age(AS_FOUND, age).stiffness > 0.94 * AS_FOUND.stiffness
    for _ in range(round(3.0 * AGE_UP_S / dt)):
        age = age_step(age, 0.1, 0.2, True, dt)
    assert age == pytest.approx(0.1, rel=0.06)
    for _ in range(round(AGE_DOWN_S / dt)):
        age = age_step(age, 0.0, 0.2, True, dt)
    assert age == pytest.approx(0.0368, abs=0.003)
    assert age_step(0.02, nan, 0.2, True, dt) == 0.02
    assert age_step(0.02, inf, 0.2, True, dt) == 0.02


def test_a_silence_before_a_flight_does_not_lower_its_gains() -> None:
    """A minute without attitudes, then a second with them: the flight begins with its gains."""
    age, dt = 0.005, 0.005
    for tick in range(12_000):
        age = age_step(age, tick * dt, 0.2, False, dt)
    assert age == pytest.approx(0.2)
    for _ in range(round(1.0 / dt)):
        age = age_step(age, 0.005, 0.2, False, dt)
    assert age < 0.0075 + 0.01
    assert schedule_at_age(AS_FOUND, age).stiffness > 0.8 * AS_FOUND.stiffness
    for _ in range(round(1.0 / dt)):
        age = age_step(age, 0.005, 0.2, False, dt)
    assert schedule_at_age(AS_FOUND, age) == AS_FOUND

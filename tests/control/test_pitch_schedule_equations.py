"""The schedule's gains are those of its page's equations, on other aircraft, speeds and lines.

Written from the page in its own words and order (lateness, damping, crossover, lead, what lag
leaves), so that a power or a bound of one of them that is another one shows.
"""

from __future__ import annotations

from math import atan, cos, pi, radians, sin

import pytest

from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import (
    Dynamics,
    GainSchedule,
    age_step,
    lateness,
    pitch_gains,
    schedule_at_age,
    schedule_of,
    soaring_gains,
    speed_step,
)
from tgl_soar.control.soaring import SoaringGains

G = 9.80665
FOUND_ON = Dynamics(
    speed_mps=9.0,
    short_period_radps=9.5,
    damping=0.7,
    effect_radps2=75.0,
    late_s=0.06,
    lag_s=0.04,
    glide_ratio=8.0,
    best_glide_mps=9.2,
    path_s=0.11,
)
SOFT = Dynamics(
    speed_mps=11.0,
    short_period_radps=7.0,
    damping=0.45,
    effect_radps2=50.0,
    late_s=0.11,
    lag_s=0.07,
    glide_ratio=11.0,
    best_glide_mps=10.0,
    path_s=0.2,
)
QUICK = FOUND_ON._replace(late_s=0.04, lag_s=0.02, damping=0.9, effect_radps2=120.0, path_s=0.06)
SPEED, LEAN = 9.0, radians(11.0)
PID = PidGains(
    kp=0.2,
    ki=0.03,
    kd=0.12,
    rate_filter_radps=20.0,
    integral_max=0.1,
    output_min=-0.4,
    output_max=0.5,
)
SOARING = SoaringGains(PID, 1.5)


def late(a: Dynamics) -> float:
    """T: a lag counts half, and a command holds for a whole tick of 5 ms."""
    return (a.late_s - a.lag_s) + 0.0025 + a.lag_s / 2.0


def f_and_d(a: Dynamics) -> tuple[float, float]:
    """Lateness, and damping at the speed of the other one."""
    f = min(1.0, late(FOUND_ON) / late(a))
    same_speed = FOUND_ON.damping * FOUND_ON.short_period_radps * a.speed_mps / FOUND_ON.speed_mps
    return f, max(0.2, min(1.2, a.damping * a.short_period_radps / same_speed))


def effect(a: Dynamics, speed_mps: float) -> float:
    """M grows with V²."""
    return a.effect_radps2 * (speed_mps / a.speed_mps) ** 2


@pytest.mark.parametrize("airframe", [FOUND_ON, SOFT, QUICK])
@pytest.mark.parametrize("speed", [6.5, 9.0, 14.0])
def test_pitch_to_elevator(airframe: Dynamics, speed: float) -> None:
    schedule = schedule_of(SPEED, LEAN, FOUND_ON, airframe)
    f, d = f_and_d(airframe)
    v = speed / SPEED
    there, found = effect(airframe, speed), effect(FOUND_ON, SPEED)
    gains = pitch_gains(PID, schedule, speed)
    assert there * gains.kd == pytest.approx(found * PID.kd * f**0.65 * d**0.35 * v**0.8)
    assert there * gains.kp == pytest.approx(found * PID.kp * f**0.95 * d**1.8 * v**1.2)
    assert gains.ki / gains.kp == pytest.approx(PID.ki / PID.kp)
    assert gains[3:] == PID[3:]


def e(q: float) -> float:
    return float((1.0 + max(0.0, q) ** 16) ** (-1.0 / 16.0))


def by_the_page(airframe: Dynamics, speed: float, lean: float, imu: float) -> PidGains:
    f, d = f_and_d(airframe)
    v = speed / SPEED
    r2 = (speed / airframe.best_glide_mps) ** 2
    falls = atan((r2 + 1.0 / r2) / (2.0 * airframe.glide_ratio))
    turns = atan(1.0 / (r2 * airframe.glide_ratio))
    b, drift = speed * sin(lean - falls + turns), G * cos(lean)
    b0, drift0 = SPEED * sin(LEAN), G * cos(LEAN)
    u = max(0.0, min(1.0, b / b0))
    # Bandwidth: with accelerometers, and what old fixes leave.
    swift, slow = f**0.7 * d**0.2, f**0.8 * d**0.45
    by_fixes = (0.05 + 0.05) / (0.05 / slow + 0.05)
    bandwidth = imu * swift + (1.0 - imu) * by_fixes
    w_c0 = PID.kp * b0 + PID.kd * drift0
    w_c = w_c0 * bandwidth * (1.0 + u * (v**0.35 - 1.0))
    lead = PID.kd * cos(LEAN) / cos(lean)
    if b > 0.0:
        lead = min(lead, PID.kd * b0 / b)
    kd = bandwidth**0.75 * (0.7 + 0.3 * u) * lead
    if b <= 0.0:
        kd /= 1.0 + 3.0 * kd * abs(b)
    h0, h = PID.kd * b0, kd * b
    zeta2 = w_c0**2 / (4.0 * (1.0 + h0) * PID.kp * drift0)
    zeta2 = u * zeta2 + (1.0 - u)
    left = max(0.05 * w_c, w_c - kd * drift)
    w = kd * drift + u * left
    kp = w**2 / (4.0 * zeta2 * (1.0 + h) * drift)
    if b > 0.0:
        kp = min(kp, left / b)
    # What lag leaves.
    age = 0.05 * (1.0 - imu)
    path = max(0.01, airframe.path_s * airframe.speed_mps / SPEED / v)
    pitch_lag = 0.05 * f ** (0.65 - 0.95) * d ** (0.35 - 1.8) * v ** (0.8 - 1.2)
    delay = pitch_lag + late(airframe) + age
    crossover = kp * b + kd * drift
    x = ((path + delay) * crossover - kd * b) / (w_c0 * (0.085 + age))
    y = (kd * b / path + crossover) * delay / (w_c0 * 0.3)
    by_y = imu + (1.0 - imu) * e(y)
    kp, kd = kp * e(x) ** 2 * by_y, kd * e(x) * by_y
    return PID._replace(kp=kp, ki=PID.ki * bandwidth * kp / PID.kp, kd=kd)


@pytest.mark.parametrize("airframe", [FOUND_ON, SOFT, QUICK])
@pytest.mark.parametrize("speed", [7.0, 9.0, 13.0])
@pytest.mark.parametrize("lean_deg", [0.5, 5.0, 15.0, 30.0, 50.0])
@pytest.mark.parametrize("imu", [0.0, 0.4, 1.0])
def test_line_to_pitch(airframe: Dynamics, speed: float, lean_deg: float, imu: float) -> None:
    schedule = schedule_of(SPEED, LEAN, FOUND_ON, airframe)
    lean = radians(lean_deg)
    found = soaring_gains(SOARING, schedule, imu, speed, pi / 2.0 + lean)
    wanted = by_the_page(airframe, speed, lean, imu)
    assert tuple(found.pid) == pytest.approx(tuple(wanted))
    assert found.slew_radps == SOARING.slew_radps


def test_lateness_and_what_is_taken_of_it() -> None:
    assert lateness(FOUND_ON) == pytest.approx(0.0425)
    assert lateness(FOUND_ON._replace(lag_s=1.0)) == pytest.approx(0.0325)  # a lag is part of it


@pytest.mark.parametrize("age_s", [0.0, 0.0075, 0.03])
@pytest.mark.parametrize("airframe", [SOFT, QUICK])
def test_old_attitudes_delay_the_loop_as_a_late_elevator_does(
    age_s: float, airframe: Dynamics
) -> None:
    """T + a in the place of T beyond 7.5 ms; of fixes the pitch loop's part alone."""
    before = schedule_of(SPEED, LEAN, FOUND_ON, airframe)
    found = schedule_at_age(before, age_s)
    t0, t = late(FOUND_ON), late(airframe)
    less = max(t0, t) / max(t0, t + max(0.0, age_s - 0.0075))
    for name in ("stiffness", "damping", "bandwidth_imu"):
        assert getattr(found, name) == pytest.approx(less * getattr(before, name)), name
    slow = 0.05 / (0.1 / before.bandwidth - 0.05)  # p, from F
    assert found.bandwidth == pytest.approx(0.1 / (0.05 / (slow * less) + 0.05))
    same = ("speed_mps", "late_found_s", "late_s", "lean_rad", "drag", "best_glide_mps", "path_s")
    assert all(getattr(found, name) == getattr(before, name) for name in same)
    assert found.pitch_lag_s == before.pitch_lag_s


def test_age_and_speed_are_averaged_over_as_long_as_is_said() -> None:
    """63 % after the time: up in 0.3 s, down in 2 s, a speed in 2 s."""
    age, speed = 0.0, 8.0
    for _ in range(60):
        age = age_step(age, 0.02, 0.2, True, 0.005)
    assert age == pytest.approx(0.02 * 0.632, rel=0.02)
    for _ in range(400):
        age, speed = age_step(age, 0.0, 0.2, True, 0.005), speed_step(speed, 10.0, 0.005)
    assert age == pytest.approx(0.02 * 0.632 * 0.368, rel=0.02)
    assert speed == pytest.approx(8.0 + 2.0 * 0.632, rel=0.005)


def test_of_an_airframe_that_is_not_known_no_more_is_taken_than_is() -> None:
    unknown = Dynamics._make((0.0,) * 9)._replace(late_s=0.06, lag_s=0.04)
    schedule = schedule_of(SPEED, LEAN, FOUND_ON, unknown)
    wanted = GainSchedule(
        speed_mps=SPEED,
        late_found_s=late(FOUND_ON),
        late_s=late(FOUND_ON),
        lean_rad=LEAN,
        drag=0.0,
        best_glide_mps=1.0,
        stiffness=1.0,
        damping=1.0,
        bandwidth=1.0,
        bandwidth_imu=1.0,
        pitch_lag_s=0.05,
        path_s=0.0,
    )
    assert tuple(schedule) == pytest.approx(tuple(wanted))
    found = soaring_gains(SOARING, schedule, 0.5, SPEED, pi / 2.0 + LEAN)
    assert found.pid[:3] == pytest.approx(PID[:3])  # where it was found, as it was found

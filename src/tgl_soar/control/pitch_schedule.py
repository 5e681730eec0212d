"""The gains of pitch, from those found on one aircraft at one speed, lean and latency.

What was found is kept where it matters to the loop; what changes is the aircraft, its speed V, the
line's lean and the lateness T of the elevator.  Index 0: as found.  No number is tuned to an
aircraft; the powers were found on the linear model of 36 drawn aircraft (short periods of 6 to 15
rad/s, servos of 15 to 80 ms, delays of 5 to 40 ms, leans of 5 to 45 degrees, 0.85 to 1.5 of the
best glide's speed) and tested on others: docs/margins.md.

**Pitch to elevator.**  The loop of the pitch rate crosses over at M kd, M the pitch acceleration of
a full deflection; lateness allows a crossover that falls with T.  How stiff the loop can be depends
on the damping 2 ζ ω that the airframe brings with it.  With v = V / V_0,

    T = delay + half a tick + the servo's time constant / 2
    f = min(1, T_0 / T)         d = ζ ω / (ζ ω)_0, within 0.2 and 1.2, at one speed
    M kd = (M kd)_0 f^0.65 d^0.35 v^0.8       M kp = (M kp)_0 f^0.95 d^1.8 v^1.2

A servo's lag counts half: it turns the phase of slow signals as a delay of its length does, but
lets less of the fast ones through.

**Line to pitch.**  With l the lean, the flight path falls by D/L, and pitch moves e_rho by rising
across it and by drifting back; the drag that comes with lift turns the rise by dD/dL:

    e_rho / theta = -(g cos l + b s) / s²         b = V sin(l - D/L + dD/dL)
    D/L = (r² + 1/r²) / 2E,  dD/dL = 1 / (r² E),  r = V / V*       E best glide ratio, at V*

On a line that leans by less than D/L - dD/dL, b is negative: pitching up moves e_rho the wrong way
first, and the gains fall with it.  To the highest order of each frequency the loop has

    w_c = kp b + kd g cos l       its crossover: the loop is w_c / s there
    h   = kd b                    its gain beyond the crossover, down to which it falls
    2 ζ = w_c / sqrt((1 + h) kp g cos l)                its damping

What the pitch loop and old fixes leave of bandwidth is F = (t + A) / (t / p + A), t its lag and A
the age of fixes; with accelerometers A is 0, and F = p.  Of its own

    p = f^0.7 d^0.2         without accelerometers, where fixes are late already, f^0.8 d^0.45

With u = b / b_0 held within 0 and 1,

    w_c = w_c0 F (1 + u (v^0.35 - 1))
    kd  = F^0.75 (0.7 + 0.3 u) min(h_0 / b, kd_0 cos l_0 / cos l)    the second also where b <= 0,
                                                          there by 1 / (1 + 3 kd |b|) less
    kp  = min((w_c - kd g cos l) / b, w² / (4 ζ² (1 + h) g cos l)),  w = kd g cos l + u (w_c - …)

ζ² going from ζ_0² at u = 1 to 1 at u = 0, where nothing but kd damps.  ki keeps its ratio to kp,
less by F.  All is continuous in lean and speed; integrals are in the unit of the output whatever
the gain, so that no command steps.

**What lag leaves.**  The path follows pitch by the path's lag P = m V / L_alpha, and pitch follows
its setpoint by D = t_p + T, t_p the pitch loop's own, kd / kp of it; without accelerometers by A
more.  With w_c = kp b + kd g cos l of the gains above and h = kd b, slow signals see

    (1 + h - (P + D) w_c) s² + w_c s + kp g cos l        lag takes of the inertia what lead gives
    x = ((P + D) w_c - h) / (w_c0 X)        X = 0.085 s, without accelerometers A more
    y = (h / P + w_c) D / (w_c0 Y)          Y = 0.3 s: what D turns at the crossover

w_c alone is too much on a line that leans little (nothing leads) and on one that leans by more than
35 degrees (g cos l is small, kp b large); without accelerometers, where the pitch loop has less
rate gain to bear it, a short P lets h cross over late.  There all yields, and nowhere else:

    kd by e(x) e(y)     kp by e(x)² e(y)     e(q) = (1 + q^16)^-1/16, q not below 0
                                        with accelerometers e(y) = 1

Of w_c0, so that gains which an operator raises are raised on every line alike, and judged by their
margin (`loop_margin`).  An aircraft whose P is not known is flown without yielding.

Attitudes that are old by a on average, from AGE_FOUND_S on, delay the loop as the elevator does:
T + a - AGE_FOUND_S in the place of T, and all gains by all of it: they turn the velocity, too.
"""

from __future__ import annotations

from math import atan, cos, pi, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.control.pid import PidGains
from tgl_soar.control.soaring import SoaringGains
from tgl_soar.types import GRAVITY_MPS2, NAN, isfinite

SPEED_MIN_MPS: Final = 1.0  # nothing that soars was found to fly slower
EFFECT_MIN_RADPS2: Final = 1.0  # less moves nothing
LEAN_MAX_RAD: Final = pi / 3.0  # of a line that can be set
SPEED_S: Final = 2.0  # over which the airspeed is averaged: slower than the loop (1 rad/s and up)
# Beyond these fractions of the speed of the finding nothing was tested.
SLOWEST: Final = 0.6
FASTEST: Final = 2.5
DAMPING_MIN: Final = 0.2  # of d; 0.5 is the least that was tested
DAMPING_MAX: Final = 1.2
LAG_FRACTION: Final = 0.5  # of T: how much of a delay a lag is
# Of lateness f, of damping d, and of speed v: in the stiffness M kp of the pitch loop, in its rate
# gain M kd, in the line's crossover.
STIFF_LATE: Final = 0.95
STIFF_DAMPED: Final = 1.8
STIFF_SPEED: Final = 1.2
RATE_LATE: Final = 0.65
RATE_DAMPED: Final = 0.35
RATE_SPEED: Final = 0.8
SWIFT_LATE: Final = 0.7
SWIFT_DAMPED: Final = 0.2
SWIFT_LATE_FIXES: Final = 0.8  # without accelerometers
SWIFT_DAMPED_FIXES: Final = 0.45
SWIFT_SPEED: Final = 0.35
LEAD_POWER: Final = 0.75
LEAST_LEAD: Final = 0.7
WRONG_WAY: Final = 3.0
PITCH_LAG_S: Final = 0.05  # t: the pitch loop's own, kd / kp of it
FIX_AGE_S: Final = 0.05  # A: 40 ms of delay, and half the time between fixes at 50 Hz
# X and Y.  Of 200 drawn aircraft at 5 to 45 degrees those with a margin below 0.5 had x of 1.04 and
# more with accelerometers, and y of 1.04 and more in 19 of 20 cases without; the shipped one has at
# most 0.76 and 0.98 at 15 to 45 degrees.
LAG_LEFT_S: Final = 0.085
LAG_TURNS_S: Final = 0.3
PATH_MIN_S: Final = 0.01  # nothing that soars answers sooner
HOLD_S: Final = 0.0025  # half a tick: a command holds for a whole one
# Attitudes no older than this are what gains were found with: 5 ms late, half a tick of 200 Hz.
AGE_FOUND_S: Final = 0.0075
AGE_UP_S: Final = 0.3  # over which their age is averaged: one hiccup of 50 ms adds 4 ms
AGE_DOWN_S: Final = 2.0


class Dynamics(NamedTuple):
    """What the schedule knows of an airframe in pitch; 0: not known."""

    speed_mps: float  # at which the next three hold
    short_period_radps: float
    damping: float
    effect_radps2: float  # pitch acceleration of a full deflection
    late_s: float  # servo, and the command's way to it
    lag_s: float  # of that, the servo's time constant
    glide_ratio: float
    best_glide_mps: float
    path_s: float  # P, at speed_mps


class GainSchedule(NamedTuple):
    """What is flown where, from `schedule_of`."""

    speed_mps: float  # of the finding; below SPEED_MIN_MPS: gains are flown as they stand
    late_found_s: float  # T_0
    late_s: float  # T, likewise
    lean_rad: float  # of the finding, beyond the glide's own
    drag: float  # 1 / 2E; 0: unknown
    best_glide_mps: float
    stiffness: float  # factor of the pitch loop's kp and ki, at the speed of the finding
    damping: float  # of its kd
    bandwidth: float  # f, without accelerometers
    bandwidth_imu: float
    pitch_lag_s: float  # t_p, at the speed of the finding
    path_s: float  # P, likewise; 0: not known, nothing yields


class ScheduledGains(NamedTuple):
    """The gains that a tick flew with; NaN: none."""

    airspeed_mps: float  # that they are for
    rho_p: float  # rad/m
    rho_i: float  # rad/(m s)
    rho_d: float  # rad s/m
    ele_p: float  # 1/rad
    ele_i: float  # 1/(rad s)
    ele_d: float  # s/rad
    ail_p: float  # 1/rad
    ail_d: float  # s/rad
    rud_d: float  # s/rad


NO_GAINS: Final = ScheduledGains(
    airspeed_mps=NAN,
    rho_p=NAN,
    rho_i=NAN,
    rho_d=NAN,
    ele_p=NAN,
    ele_i=NAN,
    ele_d=NAN,
    ail_p=NAN,
    ail_d=NAN,
    rud_d=NAN,
)


def schedule_of(
    speed_mps: float, lean_rad: float, found_on: Dynamics, airframe: Dynamics
) -> GainSchedule:
    """The schedule of gains that were found on one airframe, for another one."""
    late = min(1.0, lateness(found_on) / lateness(airframe))
    effect, damped, path_s = 1.0, 1.0, 0.0
    known = airframe.speed_mps >= SPEED_MIN_MPS and found_on.speed_mps >= SPEED_MIN_MPS
    # M grows with V², the short period with V, the path's lag falls with it.
    ratio = airframe.speed_mps / found_on.speed_mps if known else 1.0
    if known:
        path_s = airframe.path_s * ratio
    if known and airframe.effect_radps2 >= EFFECT_MIN_RADPS2:
        effect = found_on.effect_radps2 * ratio * ratio / airframe.effect_radps2
        before = found_on.damping * found_on.short_period_radps * ratio
        if airframe.damping * airframe.short_period_radps > 0.0:
            damped = airframe.damping * airframe.short_period_radps / before
            damped = max(DAMPING_MIN, min(DAMPING_MAX, damped))
    swift = late**SWIFT_LATE * damped**SWIFT_DAMPED
    swift_fixes = late**SWIFT_LATE_FIXES * damped**SWIFT_DAMPED_FIXES
    glides = airframe.glide_ratio >= 1.0 and airframe.best_glide_mps >= SPEED_MIN_MPS
    return GainSchedule(
        speed_mps=speed_mps,
        late_found_s=lateness(found_on),
        late_s=lateness(airframe),
        lean_rad=lean_rad,
        drag=0.5 / airframe.glide_ratio if glides else 0.0,
        best_glide_mps=airframe.best_glide_mps if glides else 1.0,
        stiffness=effect * late**STIFF_LATE * damped**STIFF_DAMPED,
        damping=effect * late**RATE_LATE * damped**RATE_DAMPED,
        bandwidth=(PITCH_LAG_S + FIX_AGE_S) / (PITCH_LAG_S / swift_fixes + FIX_AGE_S),
        bandwidth_imu=swift,
        pitch_lag_s=PITCH_LAG_S
        * late ** (RATE_LATE - STIFF_LATE)
        * damped ** (RATE_DAMPED - STIFF_DAMPED),
        path_s=path_s,
    )


def lateness(airframe: Dynamics) -> float:
    """T: what delays the loop as a pure delay of that length would."""
    lag_s = min(airframe.lag_s, airframe.late_s)  # a lag is part of what is late
    return airframe.late_s - (1.0 - LAG_FRACTION) * lag_s + HOLD_S


def age_step(before_s: float, age_s: float, most_s: float, flying: bool, dt_s: float) -> float:
    """The averaged age of attitudes a tick later; NaN or infinite: not known, it stays.

    most_s: what is older is not flown with, and counts as no more.  Out of control the average
    forgets as soon as it learns, so that a silence does not lower the gains of a flight after it.
    """
    if not (isfinite(age_s) and age_s >= 0.0):
        return before_s
    age_s = min(age_s, most_s)
    time_s = AGE_UP_S if age_s > before_s or not flying else AGE_DOWN_S
    return before_s + dt_s / (time_s + dt_s) * (age_s - before_s)


def slowed(late_found_s: float, late_s: float, age_s: float) -> float:
    """By what old attitudes slow the loop further: T + age in the place of T, in `f`."""
    older = max(0.0, age_s - AGE_FOUND_S)
    return max(late_found_s, late_s) / max(late_found_s, late_s + older)


def schedule_at_age(schedule: GainSchedule, age_s: float) -> GainSchedule:
    """The schedule where attitudes are that old on average: they delay the loop as a late elevator
    does, and are known to."""
    if age_s <= AGE_FOUND_S or not schedule.speed_mps >= SPEED_MIN_MPS:
        return schedule
    slower = slowed(schedule.late_found_s, schedule.late_s, age_s)
    lag = (PITCH_LAG_S + FIX_AGE_S) / schedule.bandwidth - FIX_AGE_S
    return GainSchedule(
        speed_mps=schedule.speed_mps,
        late_found_s=schedule.late_found_s,
        late_s=schedule.late_s,
        lean_rad=schedule.lean_rad,
        drag=schedule.drag,
        best_glide_mps=schedule.best_glide_mps,
        stiffness=schedule.stiffness * slower,
        damping=schedule.damping * slower,
        bandwidth=(PITCH_LAG_S + FIX_AGE_S) / (lag / slower + FIX_AGE_S),
        bandwidth_imu=schedule.bandwidth_imu * slower,
        pitch_lag_s=schedule.pitch_lag_s,
        path_s=schedule.path_s,
    )


def speed_step(before_mps: float, airspeed_mps: float, dt_s: float) -> float:
    """The averaged airspeed a tick later; NaN: not known, then it stays as it is."""
    if not isfinite(before_mps):
        return airspeed_mps
    if not isfinite(airspeed_mps):
        return before_mps
    return before_mps + dt_s / (SPEED_S + dt_s) * (airspeed_mps - before_mps)


def speed_within(schedule: GainSchedule, airspeed_mps: float) -> float:
    """The airspeed that gains are for: that of the finding where it is not known.

    Without a schedule there is no finding, and what needs an airspeed takes it as it is, or that of
    the best glide: 1 m/s where nobody knows that either.
    """
    if not schedule.speed_mps >= SPEED_MIN_MPS:
        return airspeed_mps if isfinite(airspeed_mps) else schedule.best_glide_mps
    if not isfinite(airspeed_mps):
        return schedule.speed_mps
    return max(SLOWEST * schedule.speed_mps, min(FASTEST * schedule.speed_mps, airspeed_mps))


def pitch_gains(gains: PidGains, schedule: GainSchedule, airspeed_mps: float) -> PidGains:
    """The pitch loop's gains at an airspeed."""
    if not schedule.speed_mps >= SPEED_MIN_MPS:
        return gains
    slower = schedule.speed_mps / speed_within(schedule, airspeed_mps)  # M grows with V²
    stiffness = schedule.stiffness * slower ** (2.0 - STIFF_SPEED)
    damping = schedule.damping * slower ** (2.0 - RATE_SPEED)
    return PidGains(
        kp=gains.kp * stiffness,
        ki=gains.ki * stiffness,
        kd=gains.kd * damping,
        rate_filter_radps=gains.rate_filter_radps,
        integral_max=gains.integral_max,
        output_min=gains.output_min,
        output_max=gains.output_max,
    )


def soaring_gains(
    gains: SoaringGains,
    schedule: GainSchedule,
    imu_weight: float,
    airspeed_mps: float,
    eta_rad: float,
) -> SoaringGains:
    """The soaring law's gains at an airspeed, for a line of this inclination.

    imu_weight: of the gains with accelerations in `gains`, 0 … 1.
    """
    if not schedule.speed_mps >= SPEED_MIN_MPS:
        return gains
    pid = gains.pid
    speed = speed_within(schedule, airspeed_mps)
    lean = 0.0  # of NaN, too
    if eta_rad > 0.5 * pi:
        lean = min(LEAN_MAX_RAD, eta_rad - 0.5 * pi)
    drift_found = GRAVITY_MPS2 * cos(schedule.lean_rad)
    rise_found = schedule.speed_mps * sin(schedule.lean_rad)
    drift = GRAVITY_MPS2 * cos(lean)
    rise = speed * sin(lean - lean_of_glide(schedule, speed))
    u = max(0.0, min(1.0, rise / rise_found))
    bandwidth = schedule.bandwidth + imu_weight * (schedule.bandwidth_imu - schedule.bandwidth)

    wanted = pid.kp * rise_found + pid.kd * drift_found
    faster = (speed / schedule.speed_mps) ** SWIFT_SPEED
    crossover = wanted * bandwidth * (1.0 + u * (faster - 1.0))
    lead = drift_found / drift
    if rise > 0.0:
        lead = min(lead, rise_found / rise)
    kd = pid.kd * lead * bandwidth**LEAD_POWER * (LEAST_LEAD + (1.0 - LEAST_LEAD) * u)
    if rise < 0.0:
        kd = kd / (1.0 - WRONG_WAY * kd * rise)
    beyond = 1.0 + kd * rise  # more than 2/3: kd |b| < 1/3 where b < 0
    stiff_found = 4.0 * (1.0 + pid.kd * rise_found) * drift_found * pid.kp
    damping2 = 1.0
    if stiff_found > 0.0:
        damping2 = 1.0 + u * (wanted * wanted / stiff_found - 1.0)
    # Where kd alone crosses over later than wanted, there is nothing left for kp but a trace.
    left = max(0.05 * crossover, crossover - kd * drift)
    reached = kd * drift + u * left
    kp = reached * reached / (4.0 * damping2 * beyond * drift) if damping2 > 0.0 else pid.kp
    if rise > 0.0:
        kp = min(kp, left / rise)
    kept, lead_kept = _yields(schedule, imu_weight, speed, wanted, (drift, rise), (kp, kd))
    kp, kd = kp * kept, kd * lead_kept
    ki = pid.ki * bandwidth * kp / pid.kp if pid.kp > 0.0 else pid.ki * bandwidth * kept
    return SoaringGains(
        PidGains(
            kp=kp,
            ki=ki,
            kd=kd,
            rate_filter_radps=pid.rate_filter_radps,
            integral_max=pid.integral_max,
            output_min=pid.output_min,
            output_max=pid.output_max,
        ),
        gains.slew_radps,
    )


def _yields(
    schedule: GainSchedule,
    imu_weight: float,
    speed_mps: float,
    wanted_radps: float,
    moves: tuple[float, float],
    gains: tuple[float, float],
) -> tuple[float, float]:
    """What is kept of kp and kd where lag takes the margin.

    wanted_radps: w_c0; moves: g cos l [m/s²] and b [m/s]; gains: kp [rad/m] and kd [rad s/m].
    """
    if not (schedule.path_s > 0.0 and wanted_radps > 0.0):
        return 1.0, 1.0
    (drift, rise), (kp, kd) = moves, gains
    slower = schedule.speed_mps / speed_mps
    path_s = max(PATH_MIN_S, schedule.path_s * slower)
    age_s = (1.0 - imu_weight) * FIX_AGE_S
    late_s = schedule.pitch_lag_s * slower ** (STIFF_SPEED - RATE_SPEED) + schedule.late_s + age_s
    crossover = (kp * rise + kd * drift) / wanted_radps
    lead_s = kd * rise / wanted_radps
    left = _kept(((path_s + late_s) * crossover - lead_s) / (LAG_LEFT_S + age_s))
    turned = _kept((lead_s / path_s + crossover) * late_s / LAG_TURNS_S)
    turned = turned + imu_weight * (1.0 - turned)
    return left * left * turned, left * turned


def _kept(taken: float) -> float:
    """(1 + q^16)^-1/16: 0.99 at 0.9, and 1 / q far beyond 1."""
    if taken <= 0.0:
        return 1.0
    square = taken * taken
    fourth = square * square
    eighth = fourth * fourth
    return 1.0 / sqrt(sqrt(sqrt(sqrt(1.0 + eighth * eighth))))


def lean_of_glide(schedule: GainSchedule, airspeed_mps: float) -> float:
    """Of a line on which pitch moves e_rho by drifting alone [rad]: D/L - dD/dL."""
    ratio = airspeed_mps / schedule.best_glide_mps
    square = ratio * ratio
    return atan(schedule.drag * (square + 1.0 / square)) - atan(2.0 * schedule.drag / square)

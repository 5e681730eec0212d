"""The disk margins of roll and heading, from the airframe's lateral dynamics alone.

What `analysis/lateral_model.py` makes of the whole simulation by differences, here by the textbook
(Etkin and Reid, Dynamics of Flight, chapter 6), in the frequency domain.  About a glide at the
airspeed V, with v the sideways speed, p the bank, h the heading, R the way to the waypoint, V_l the
airspeed by which the heading leads (`control.heading`), a the incidence, g_d the path's fall and
t = a - g_d the nose above the horizon:

    slip = v / V - h + a p      roll rate = s p - t s h      yaw rate = s h      y = v / s

    s v       = g p + (Y_slip - g sin g_d) slip + Y_δ rudder
    s roll    = -L_p roll + L_r yaw + L_slip slip + L_δ aileron
    s yaw     = -N_r yaw + N_p roll + N_slip slip + N_δ rudder + N_a aileron

    aileron = -A ((k_p + k_i / s) (p + (kv + ki / s) (1 + V_l / (R s)) v) + k_d s p)
    rudder  = -A (r_p (h + v / (R s)) + r_d s h)                   A: lag and delay of the surfaces

These are three equations for v, p and h, a matrix M.  With D its determinant as flown, D_r with the
aileron's loop open and D_a with the rudder's, one open and the other closed,

    S at the aileron = D_r / D      S at the rudder = D_a / D      alpha = min 1 / |S - 1/2|

A nose that swings rolls the wing by its yaw rate (L_r) and by its slip (L_slip), and this roll yaws
it back (N_p): to the slow side of the roll mode, 1 / L_p, damping of

    N_p L_r / L_p  beside  N_r                      a fifth to a third of it on the shipped aircraft

and with the slip's part more.  It counts where a slow servo on a late link has taken the rudder's;
a rule without it refuses one in fifty of such aircraft wrongly, and warns of one in three.

From one frequency to the next 1 / (S - 1/2) is taken to go straight, as it does beside a root near
the axis, where it is as s less the root: a resonance between two frequencies is not missed.

D begins as s^-k, one for each integral, and ends as s^5: where all roots decay it turns forward by
5 + k quarters, and each one that grows takes half a turn of it (Mikhailov).

Beside the linear model alpha is within 0.1 at the speeds of `loop_margin.SPEEDS`
(tests/control/test_lateral_margin.py, docs/margins.md); at 14 m/s it was 0.10 off once.
The surfaces answer as the elevator does.  What the airframe's file does not tell is 0.
"""

from __future__ import annotations

from cmath import exp, phase
from math import atan, pi, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.config.lateral_dynamics import LateralDynamics
from tgl_soar.control.heading import leading_speed
from tgl_soar.control.lateral_schedule import (
    heading_gains,
    lateral_bandwidth,
    roll_gains,
    sideways_gains,
)
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import FIX_AGE_S, HOLD_S, GainSchedule
from tgl_soar.types import GRAVITY_MPS2

ATTITUDE_AGE_S: Final = 0.005  # without accelerometers' stream; carried on by the rate


# j omega, from where every integral shows to 150 rad/s; the first of them hold no margin.
_SLOW: Final = 9
_SWEEP: Final = (
    *(0.005j * 1.5**i for i in range(_SLOW)),
    *(0.2j * 1.2**i for i in range(38)),
)
_TINY: Final = 1e-9
# Of the turns [rad]: a growing root takes pi; one that decays more slowly than the sweep begins,
# or faster than it ends, pi / 2 at most.
_TURNS_SHORT: Final = 0.75 * pi


class Sideways(NamedTuple):
    """The loops of roll and heading at one speed, with the gains there."""

    airframe: LateralDynamics
    delay_s: float  # of the command's way, and of the servo beyond its lag
    speed_mps: float
    falls_rad: float  # the glide's path
    inertial: bool  # accelerations are in use
    roll: PidGains
    heading: PidGains
    sideways: PidGains
    way_m: float  # R
    leading_mps: float  # V_l


# An entry of M: its parts by 1, s and s².  A row: those of v, p and h.
_Entry = tuple[float, float, float]
_Row = tuple[_Entry, _Entry, _Entry]
_Rows = tuple[_Row, _Row, _Row]


def sideways_flown(
    laws: Laws, airframe: LateralDynamics, late_s: float, speed_mps: float, inertial: bool
) -> Sideways:
    """The loops with the gains that the schedule gives there.  late_s: of servo and command."""
    schedule = laws.lateral_schedule
    age_s = 0.0 if inertial else ATTITUDE_AGE_S
    f = lateral_bandwidth(schedule, age_s)
    level = sideways_gains(laws.sideways, schedule, f)
    way_m = max(laws.heading.distance_min_m, laws.target.x_m - laws.heading.waypoint_x_m)
    return Sideways(
        airframe=airframe,
        delay_s=max(0.0, late_s - airframe.lag_s),
        speed_mps=speed_mps,
        falls_rad=_falls(laws.schedule, speed_mps),
        inertial=inertial,
        roll=roll_gains(laws.roll, schedule, f, speed_mps),
        heading=heading_gains(laws.heading, schedule, f, speed_mps).pid,
        sideways=level,
        way_m=way_m,
        leading_mps=leading_speed(laws.heading, level.kd, laws.target.x_m, speed_mps),
    )


def _falls(schedule: GainSchedule, speed_mps: float) -> float:
    """The angle of the glide's path; 0 where the glide is not known."""
    square = (speed_mps / schedule.best_glide_mps) ** 2
    return atan(schedule.drag * (square + 1.0 / square))


def disk_margins(loop: Sideways) -> tuple[float, float]:
    """alpha at aileron and rudder; 0: unstable."""
    rows, gains = _rows(loop), _gains(loop)
    turned, before = 0.0, complex(1.0)
    aileron = rudder = 2.0  # far above all, S is 1
    at_aileron = at_rudder = complex(2.0)  # 1 / (S - 1/2)
    for k, s in enumerate(_SWEEP):
        flown, without_aileron, without_rudder = _determinants(rows, _fed_back(gains, s), s)
        if not flown:  # on the very edge
            return 0.0, 0.0
        turned += phase(flown / before) if k > 0 else 0.0
        before = flown
        if k >= _SLOW:
            half = 0.5 * flown
            was_at_aileron, at_aileron = at_aileron, flown / ((without_aileron - half) or _TINY)
            was_at_rudder, at_rudder = at_rudder, flown / ((without_rudder - half) or _TINY)
            if k > _SLOW:
                aileron = min(aileron, _nearest(was_at_aileron, at_aileron))
                rudder = min(rudder, _nearest(was_at_rudder, at_rudder))
    forward = 0.5 * pi * (5 + _integrals(loop))
    if turned < forward - _TURNS_SHORT:
        return 0.0, 0.0
    return aileron, rudder


def _nearest(one: complex, other: complex) -> float:
    """The distance of 0 from the straight way between two numbers, or from its end."""
    way = other - one
    square = way.real * way.real + way.imag * way.imag
    along = -(one.real * way.real + one.imag * way.imag)
    if 0.0 < along < square:
        return abs(one.real * way.imag - one.imag * way.real) / sqrt(square)
    return abs(other)


def _integrals(loop: Sideways) -> int:
    """How many of them act: of the bank's error, of the sideways speed's, and y itself."""
    roll, level = loop.roll, loop.sideways
    holds = roll.kp > 0.0 or roll.ki > 0.0
    leads = holds and (level.kd > 0.0 or level.ki > 0.0)
    return (roll.ki > 0.0) + (leads and level.ki > 0.0) + (leads or loop.heading.kp > 0.0)


def _rows(loop: Sideways) -> _Rows:
    """M without feedback, so combined that the aileron acts in the second row alone and the rudder
    in the third: of the yaw's N_a / L_δ of the roll's are taken, of the first Y_δ / N_δ of that."""
    known, speed = loop.airframe, loop.speed_mps
    faster = speed / known.speed_mps
    square = faster * faster
    incidence = known.rigging_rad + known.lift_rad / square
    nose = incidence - loop.falls_rad if known.lift_rad > 0.0 else 0.0
    side = known.side_of_slip_mps2 * square - GRAVITY_MPS2 * sin(loop.falls_rad)
    damped, crossed = known.roll_damping_per_s * faster, known.roll_of_yaw_per_s * faster
    slipped = known.roll_of_slip_per_s2 * square
    roll = (
        (-slipped / speed, 0.0, 0.0),
        (-slipped * incidence, damped, 1.0),
        (slipped, -damped * nose - crossed, -nose),
    )
    stiff, swung = known.yaw_stiffness_per_s2 * square, known.yaw_of_roll_per_s * faster
    yaw = (
        (-stiff / speed, 0.0, 0.0),
        (-stiff * incidence, -swung, 0.0),
        (stiff, known.yaw_damping_per_s * faster + swung * nose, 1.0),
    )
    sideways = (
        (-side / speed, 1.0, 0.0),
        (-GRAVITY_MPS2 - side * incidence, 0.0, 0.0),
        (side, 0.0, 0.0),
    )
    yaw = _less(yaw, known.yaw_of_aileron_radps2 / known.roll_effect_radps2, roll)
    sideways = _less(sideways, known.side_of_rudder_mps2 / known.yaw_effect_radps2, yaw)
    return sideways, roll, yaw


def _less(row: _Row, factor: float, other: _Row) -> _Row:
    (v, p, h), (ov, op, oh) = row, other
    return (
        (v[0] - factor * ov[0], v[1] - factor * ov[1], v[2] - factor * ov[2]),
        (p[0] - factor * op[0], p[1] - factor * op[1], p[2] - factor * op[2]),
        (h[0] - factor * oh[0], h[1] - factor * oh[1], h[2] - factor * oh[2]),
    )


class _Gains(NamedTuple):
    """What `_fed_back` takes, those of the surfaces times their effects."""

    delay_s: float
    lag_s: float
    late_s: float  # attitudes, carried on by their rates
    old_s: float  # fixes
    k_p: float
    k_i: float
    k_d: float
    k_filter_radps: float
    r_p: float
    r_d: float
    r_filter_radps: float
    level_d: float
    level_i: float
    level_filter_radps: float
    leads_per_s: float  # V_l / R
    nears_per_m: float  # 1 / R


def _gains(loop: Sideways) -> _Gains:
    known, roll, nose, level = loop.airframe, loop.roll, loop.heading, loop.sideways
    square = (loop.speed_mps / known.speed_mps) ** 2
    aileron, rudder = known.roll_effect_radps2 * square, known.yaw_effect_radps2 * square
    return _Gains(
        delay_s=loop.delay_s + HOLD_S,
        lag_s=known.lag_s,
        late_s=0.0 if loop.inertial else ATTITUDE_AGE_S,
        old_s=0.0 if loop.inertial else FIX_AGE_S,
        k_p=aileron * roll.kp,
        k_i=aileron * roll.ki,
        k_d=aileron * roll.kd,
        k_filter_radps=roll.rate_filter_radps,
        r_p=rudder * nose.kp,
        r_d=rudder * nose.kd,
        r_filter_radps=nose.rate_filter_radps,
        level_d=level.kd,
        level_i=level.ki,
        level_filter_radps=level.rate_filter_radps,
        leads_per_s=loop.leading_mps / loop.way_m,
        nears_per_m=1.0 / loop.way_m,
    )


def _fed_back(gains: _Gains, s: complex) -> tuple[complex, complex, complex, complex]:
    """What the aileron's loop adds of v and p, and the rudder's of v and h."""
    (
        delay_s, lag_s, late_s, old_s, k_p, k_i, k_d, k_filter, r_p, r_d, r_filter,
        level_d, level_i, level_filter, leads, nears,
    ) = gains  # fmt: skip
    surface = old = exp(-s * delay_s) / (1.0 + s * lag_s)
    delayed, ahead = surface, complex(1.0)
    if late_s > 0.0:
        old = surface * exp(-s * old_s)
        delayed, ahead = surface * exp(-s * late_s), 1.0 + s * late_s
    error = k_p + k_i / s
    held = level_d / (1.0 + s / level_filter) + level_i / s
    return (
        old * error * held * (1.0 + leads / s),
        delayed * (error * ahead + k_d * s / (1.0 + s / k_filter)),
        old * r_p * nears / s,
        delayed * (r_p * ahead + r_d * s / (1.0 + s / r_filter)),
    )


def _determinants(
    rows: _Rows, fed_back: tuple[complex, complex, complex, complex], s: complex
) -> tuple[complex, complex, complex]:
    """D, that with the aileron's loop open, and that with the rudder's."""
    (
        ((v0, v1, _), (p0, p1, p2), (h0, h1, h2)),
        ((b1, _, _), (q0, q1, q2), (i0, i1, i2)),
        ((c1, _, _), (r0, r1, r2), (j0, j1, j2)),
    ) = rows
    roll_v, roll_p, yaw_v, yaw_h = fed_back
    square = (s * s).real
    a1, a2, a3 = v0 + v1 * s, p0 + p2 * square + p1 * s, h0 + h2 * square + h1 * s
    b2, b3 = q0 + q2 * square + q1 * s, i0 + i2 * square + i1 * s
    c2, c3 = r0 + r2 * square + r1 * s, j0 + j2 * square + j1 * s
    # The cross product of the first two rows without the aileron's loop, and with it.
    x, y, z = a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1
    flown_x, flown_y, flown_z = x - a3 * roll_p, y + a3 * roll_v, z + a1 * roll_p - a2 * roll_v
    open_rudder = flown_x * c1 + flown_y * c2 + flown_z * c3
    return (
        open_rudder + flown_x * yaw_v + flown_z * yaw_h,
        x * (c1 + yaw_v) + y * c2 + z * (c3 + yaw_h),
        open_rudder,
    )

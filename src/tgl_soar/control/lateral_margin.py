"""The disk margins of roll and heading, from the airframe's lateral dynamics alone.

What `analysis/lateral_model.py` makes of the whole simulation by differences, here by the textbook,
in the frequency domain.  With p the bank, v_y the sideways speed, R the way to the waypoint, V_l
the airspeed by which the heading leads (`control.heading`):

    p = L_δ / (s (s + L_p)) aileron            v_y = g p / s
    bank setpoint = (kv + ki / s) (-V_l y / R - v_y)
    heading = N_δ / (s² + N_r s + N_β) rudder  the waypoint is too slow to count

Neither motion moves the other here, and no sideslip rolls the wing.  Beside a margin of 0.5 that
raised gains of roll and heading leave it is within 0.2 of the linear model's, with a raised gain of
the bank up to 0.3 more (tests/control/test_lateral_margin.py).  The surfaces answer as the elevator
does.

With a slow servo on a late link heading is better than this has it.  A nose that swings rolls the
wing by its yaw rate (C_lr), and that roll yaws it back (C_np): damping that is not here, and counts
where lag has taken the rudder's.  Of 40 aircraft that this doubts at 40 ms the linear model has
0.55 and more (docs/margins.md); without C_lr both agree within 0.2
(tests/analysis/test_lateral_model.py).

    alpha = min 1 / |S - 1/2|,     S = 1 / (1 + L)       0 where 1 + L turns the wrong way round 0

The rudder's L ends as it begins; of the aileron's each integral adds a quarter of a turn forward.
An unstable loop turns back once, or more.
"""

from __future__ import annotations

from cmath import exp, phase
from collections.abc import Callable
from math import pi
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
from tgl_soar.control.schedule import FIX_AGE_S, GRAVITY_MPS2, HOLD_S

ATTITUDE_AGE_S: Final = 0.005  # without accelerometers' stream; carried on by the rate


# From where every integral shows, to 150 rad/s; what is slower than the second holds no margin.
_RADPS: Final = tuple(0.005 * 1.115**i for i in range(95))
_SLOWEST_RADPS: Final = 0.2


class Sideways(NamedTuple):
    """The loops of roll and heading at one speed, with the gains there."""

    airframe: LateralDynamics
    delay_s: float  # of the command's way, and of the servo beyond its lag
    speed_mps: float
    inertial: bool  # accelerations are in use
    roll: PidGains
    heading: PidGains
    sideways: PidGains
    way_m: float  # R
    leading_mps: float  # V_l


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
        inertial=inertial,
        roll=roll_gains(laws.roll, schedule, f, speed_mps),
        heading=heading_gains(laws.heading, schedule, f, speed_mps).pid,
        sideways=level,
        way_m=way_m,
        leading_mps=leading_speed(laws.heading, level.kd, laws.target.x_m, speed_mps),
    )


def at_aileron(loop: Sideways, radps: float) -> complex:
    """The open loop there, negative feedback."""
    s = 1j * radps
    known, faster = loop.airframe, loop.speed_mps / loop.airframe.speed_mps
    bank = known.roll_effect_radps2 * faster**2 / (s * (s + known.roll_damping_per_s * faster))
    late = 0.0 if loop.inertial else ATTITUDE_AGE_S
    old = exp(-s * (0.0 if loop.inertial else FIX_AGE_S))
    level, roll = loop.sideways, loop.roll
    held = level.kd / (1.0 + s / level.rate_filter_radps) + level.ki / s
    wanted = held * old * (1.0 + loop.leading_mps / (loop.way_m * s)) * GRAVITY_MPS2 / s
    seen = exp(-s * late)
    error = (roll.kp + roll.ki / s) * (wanted + (1.0 + s * late) * seen)
    rate = roll.kd * s / (1.0 + s / roll.rate_filter_radps) * seen
    return _surface(loop, s) * (error + rate) * bank


def at_rudder(loop: Sideways, radps: float) -> complex:
    """The open loop there, negative feedback."""
    s = 1j * radps
    known, faster = loop.airframe, loop.speed_mps / loop.airframe.speed_mps
    square = faster * faster
    turn = s * s + known.yaw_damping_per_s * faster * s + known.yaw_stiffness_per_s2 * square
    late = 0.0 if loop.inertial else ATTITUDE_AGE_S
    pid = loop.heading
    error = pid.kp * (1.0 + s * late) + pid.kd * s / (1.0 + s / pid.rate_filter_radps)
    return _surface(loop, s) * error * exp(-s * late) * known.yaw_effect_radps2 * square / turn


def disk_margins(loop: Sideways) -> tuple[float, float]:
    """alpha at aileron and rudder; 0: unstable."""
    level, roll = loop.sideways, loop.roll
    integrals = 1 + (roll.ki > 0.0) + 2 * (level.kd > 0.0) + (level.ki > 0.0)
    return _alpha(at_aileron, loop, 0.5 * pi * integrals), _alpha(at_rudder, loop, 0.0)


def _alpha(opened: Callable[[Sideways, float], complex], loop: Sideways, forward: float) -> float:
    """forward: the turns [rad] of a stable loop."""
    least, turned, before = 2.0, 0.0, complex(1.0)
    for k, radps in enumerate(_RADPS):
        back = 1.0 + opened(loop, radps)
        if k > 0:
            turned += phase(back / before)
        before = back
        if radps >= _SLOWEST_RADPS:
            least = min(least, 1.0 / max(1e-9, abs(1.0 / back - 0.5)))
    return least if turned > forward - pi else 0.0


def _surface(loop: Sideways, s: complex) -> complex:
    return exp(-s * (loop.delay_s + HOLD_S)) / (1.0 + s * loop.airframe.lag_s)

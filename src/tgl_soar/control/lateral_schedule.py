"""The gains of roll, heading and bank at another airspeed and latency than they were found for.

A surface's effect grows with V², the damping of roll and yaw with V.  What is kept is the crossover
of roll and of the yaw rate, which is what the delays allow.  With v = V_0 / V, index 0: as found,
and T from a tick to the surface:

    f = min(1, T_0 / T)                                 later surfaces, older attitudes: more slowly
    AIL_P, AIL_I, AIL_D  ~  v f, v f², v² f             ω = L_δ kp / L_p = L_δ kd  ~  f
    RUD_P, RUD_D         ~  v f, v² f                   N_δ RUD_D  ~  f
    SIDE_P, SIDE_I       ~  f, f²                       as the bank, six times slower than roll

All is continuous in V, which is averaged as for pitch; integrals are in the unit of the output, so
that no command steps.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.control.heading import HeadingGains
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import FASTEST, HOLD_S, SLOWEST, SPEED_MIN_MPS, slowed
from tgl_soar.types import isfinite

LATE_MIN: Final = 0.2  # of f: five times as late is no link to fly by


class LateralSchedule(NamedTuple):
    """What is flown where, from `lateral_schedule_of`."""

    speed_mps: float  # of the finding; below SPEED_MIN_MPS: gains are flown as they stand
    late_found_s: float  # T_0, half a tick with it; 0: T
    late_s: float  # T, likewise


def lateral_schedule_of(speed_mps: float, late_found_s: float, late_s: float) -> LateralSchedule:
    """For gains found at an airspeed, with surfaces that late, on an airframe whose are `late_s`
    late (servo, and the command's way to it).  late_found_s of 0: as late as these."""
    found_s = late_found_s if late_found_s > 0.0 else late_s
    return LateralSchedule(speed_mps, found_s + HOLD_S, late_s + HOLD_S)


def lateral_bandwidth(schedule: LateralSchedule, age_s: float) -> float:
    """f, where attitudes are that old on average."""
    found_s, late_s = schedule.late_found_s, schedule.late_s
    f = min(1.0, found_s / late_s) * slowed(found_s, late_s, age_s)
    return max(LATE_MIN, f)


def lateral_speed(schedule: LateralSchedule, airspeed_mps: float) -> float:
    """The airspeed that gains are for: that of the finding where it is not known."""
    if not isfinite(airspeed_mps):
        return schedule.speed_mps
    return max(SLOWEST * schedule.speed_mps, min(FASTEST * schedule.speed_mps, airspeed_mps))


def roll_gains(
    gains: PidGains, schedule: LateralSchedule, f: float, airspeed_mps: float
) -> PidGains:
    """The roll loop's gains at an airspeed; f: from `lateral_bandwidth`."""
    if not schedule.speed_mps >= SPEED_MIN_MPS:
        return gains
    v = schedule.speed_mps / lateral_speed(schedule, airspeed_mps)
    return _scaled(gains, v * f, v * f * f, v * v * f)


def heading_gains(
    gains: HeadingGains, schedule: LateralSchedule, f: float, airspeed_mps: float
) -> HeadingGains:
    """The heading loop's gains at an airspeed; the setpoint's are as they were."""
    if not schedule.speed_mps >= SPEED_MIN_MPS:
        return gains
    v = schedule.speed_mps / lateral_speed(schedule, airspeed_mps)
    return HeadingGains(
        _scaled(gains.pid, v * f, 0.0, v * v * f),
        gains.waypoint_x_m,
        gains.distance_min_m,
        gains.heading_max_rad,
    )


def sideways_gains(gains: PidGains, schedule: LateralSchedule, f: float) -> PidGains:
    """The bank's gains: of the sideways speed, so that they know no airspeed."""
    if not schedule.speed_mps >= SPEED_MIN_MPS:
        return gains
    return _scaled(gains, f, f * f, f)


def _scaled(gains: PidGains, p: float, i: float, d: float) -> PidGains:
    return PidGains(
        kp=gains.kp * p,
        ki=gains.ki * i,
        kd=gains.kd * d,
        rate_filter_radps=gains.rate_filter_radps,
        integral_max=gains.integral_max,
        output_min=gains.output_min,
        output_max=gains.output_max,
    )

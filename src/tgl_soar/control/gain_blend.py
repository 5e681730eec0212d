"""Two sets of gains: one for flight with accelerations, one for flight without.

    k = k_plain + s (k_imu - k_plain),   0 <= s <= 1

With accelerations the estimated velocity is early and quiet, and the loops can be twice as stiff;
the same gains on a velocity made of late fixes have no margin.  The weight s follows what the
estimator says that it has, slowly up, and down before a track without accelerations is wrong.

No command steps when s does: integrals are in the unit of the output whatever the gain, and P
and D change no faster than s.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.control.pid import PidGains
from tgl_soar.control.soaring import SoaringGains

UP_PER_S: Final = 2.0
DOWN_PER_S: Final = 10.0


def weight_step(weight: float, inertial: bool, dt_s: float) -> float:
    """The weight s a tick later; inertial: accelerations are in use."""
    if inertial:
        return min(1.0, weight + UP_PER_S * dt_s)
    return max(0.0, weight - DOWN_PER_S * dt_s)


def pid_between(plain: PidGains, imu: PidGains, weight: float) -> PidGains:
    """The gains at a weight; limits are those of both."""
    if weight <= 0.0:
        return plain
    if weight >= 1.0:
        return imu
    return PidGains(
        kp=plain.kp + weight * (imu.kp - plain.kp),
        ki=plain.ki + weight * (imu.ki - plain.ki),
        kd=plain.kd + weight * (imu.kd - plain.kd),
        rate_filter_radps=plain.rate_filter_radps
        + weight * (imu.rate_filter_radps - plain.rate_filter_radps),
        integral_max=plain.integral_max,
        output_min=plain.output_min,
        output_max=plain.output_max,
    )


def soaring_between(plain: SoaringGains, imu: SoaringGains, weight: float) -> SoaringGains:
    """The soaring law's gains at a weight; the slew rate is that of both."""
    if weight <= 0.0:
        return plain
    if weight >= 1.0:
        return imu
    return SoaringGains(pid_between(plain.pid, imu.pid, weight), plain.slew_radps)

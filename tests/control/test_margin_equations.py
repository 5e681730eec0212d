"""The margins on board are those of the equations that their pages state: solved here as matrices
by numpy, at ten times as many frequencies, with airframes in which every term weighs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.config.lateral_dynamics import LateralDynamics
from tgl_soar.control.lateral_margin import Sideways, disk_margins
from tgl_soar.control.loop_margin import Flown, disk_margin
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import Dynamics

G = 9.80665
HALF_A_TICK_S = 0.0025  # a command holds for a whole one of 5 ms
ATTITUDES_LATE_S = 0.005  # half of 10 ms between two of 100 Hz
FIXES_LATE_S = 0.05  # 40 ms under way, and half of 20 ms between two of 50 Hz
Numbers = NDArray[np.floating[Any]]


def gains(kp: float, ki: float, kd: float, filter_radps: float) -> PidGains:
    return PidGains(
        kp=kp,
        ki=ki,
        kd=kd,
        rate_filter_radps=filter_radps,
        integral_max=1.0,
        output_min=-1.0,
        output_max=1.0,
    )


# Dihedral, a fin, adverse yaw, a side force, and all between them: none of it small.
AIRFRAME = LateralDynamics(
    speed_mps=10.0,
    roll_effect_radps2=60.0,
    roll_damping_per_s=9.0,
    yaw_effect_radps2=12.0,
    yaw_damping_per_s=2.0,
    yaw_stiffness_per_s2=20.0,
    lag_s=0.03,
    roll_of_slip_per_s2=-25.0,
    roll_of_yaw_per_s=3.0,
    yaw_of_roll_per_s=-1.0,
    yaw_of_aileron_radps2=-4.0,
    side_of_slip_mps2=-6.0,
    side_of_rudder_mps2=3.0,
    lift_rad=0.1,
    rigging_rad=0.04,
)
SIDEWAYS = Sideways(
    airframe=AIRFRAME,
    delay_s=0.02,
    speed_mps=8.5,
    falls_rad=0.12,
    inertial=True,
    roll=gains(0.9, 0.3, 0.06, 60.0),
    heading=gains(0.9, 0.0, 0.1, 40.0),
    sideways=gains(0.0, 0.018, 0.036, 9.0),
    way_m=6.0,
    leading_mps=7.0,
)


def sideways_by_matrices(loop: Sideways) -> tuple[float, float]:
    """alpha at aileron and rudder: unknowns v, p, h and both surfaces."""
    known, speed = loop.airframe, loop.speed_mps
    faster = speed / known.speed_mps
    a = known.rigging_rad + known.lift_rad / faster**2
    t = a - loop.falls_rad

    def sensitivity(s: complex) -> tuple[complex, complex]:
        v, p, h = np.eye(3)
        slip = v / speed - h + a * p
        roll, yaw = s * (p - t * h), s * h
        side = known.side_of_slip_mps2 * faster**2 - G * np.sin(loop.falls_rad)
        free = np.array(
            (
                s * v - G * p - side * slip,
                s * roll
                + known.roll_damping_per_s * faster * roll
                - known.roll_of_yaw_per_s * faster * yaw
                - known.roll_of_slip_per_s2 * faster**2 * slip,
                s * yaw
                + known.yaw_damping_per_s * faster * yaw
                - known.yaw_of_roll_per_s * faster * roll
                - known.yaw_stiffness_per_s2 * faster**2 * slip,
            )
        )
        per_aileron = np.array((0.0, known.roll_effect_radps2, known.yaw_of_aileron_radps2))
        per_rudder = np.array((known.side_of_rudder_mps2, 0.0, known.yaw_effect_radps2))
        per_aileron, per_rudder = per_aileron * faster**2, per_rudder * faster**2
        # What the surfaces are commanded, as rows of what is measured.
        old = late = ahead = 1.0 + 0j
        if not loop.inertial:
            old, late = np.exp(-s * FIXES_LATE_S), np.exp(-s * ATTITUDES_LATE_S)
            ahead = 1.0 + s * ATTITUDES_LATE_S
        law, level, nose = loop.roll, loop.sideways, loop.heading
        bank = level.kd / (1.0 + s / level.rate_filter_radps) + level.ki / s
        leads = 1.0 + loop.leading_mps / loop.way_m / s
        aileron = -(law.kp + law.ki / s) * (late * ahead * p + old * bank * leads * v)
        aileron = aileron - late * law.kd * s / (1.0 + s / law.rate_filter_radps) * p
        rudder = -nose.kp * (late * ahead * h + old / (loop.way_m * s) * v)
        rudder = rudder - late * nose.kd * s / (1.0 + s / nose.rate_filter_radps) * h
        surface = np.exp(-s * (loop.delay_s + HALF_A_TICK_S)) / (1.0 + s * known.lag_s)
        by_aileron = np.outer(per_aileron, surface * aileron)
        by_rudder = np.outer(per_rudder, surface * rudder)
        flown = np.linalg.det(free - by_aileron - by_rudder)
        return (
            complex(np.linalg.det(free - by_rudder) / flown),
            complex(np.linalg.det(free - by_aileron) / flown),
        )

    return nearest([sensitivity(1j * w) for w in np.geomspace(0.5, 60.0, 300)])


def nearest(found: list[tuple[complex, complex]]) -> tuple[float, float]:
    at_one, at_other = (np.array(each) for each in zip(*found, strict=True))
    return (
        float(np.min(1.0 / np.abs(at_one - 0.5))),
        float(np.min(1.0 / np.abs(at_other - 0.5))),
    )


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize("speed_mps", [8.5, 13.0])
@pytest.mark.parametrize("without", ["", "rigging_rad", "yaw_of_aileron_radps2"])
def test_roll_and_heading(inertial: bool, speed_mps: float, without: str) -> None:
    """Between its frequencies, a fifth apart, the rule goes straight: 2 % is what that costs."""
    airframe = AIRFRAME._replace(**{without: 0.0}) if without else AIRFRAME
    loop = SIDEWAYS._replace(airframe=airframe, inertial=inertial, speed_mps=speed_mps)
    equations = sideways_by_matrices(loop)
    assert min(equations) > 0.3  # stable, and far enough from the edge to compare
    assert disk_margins(loop) == pytest.approx(equations, rel=0.02)


PITCH = Flown(
    airframe=Dynamics(
        speed_mps=10.0,
        short_period_radps=9.0,
        damping=0.6,
        effect_radps2=70.0,
        late_s=0.07,
        lag_s=0.04,
        glide_ratio=9.0,
        best_glide_mps=9.5,
        path_s=1.1,
    ),
    lag_s=0.04,
    delay_s=0.03,
    speed_mps=9.0,
    lean_rad=0.4,
    inertial=True,
    lift_mps2=-4.0,
    soaring=gains(0.08, 0.02, 0.06, 20.0),
    pitch=gains(0.8, 0.6, 0.08, 60.0),
    setpoint_weight=0.0,
)


def pitch_by_matrices(loop: Flown, radps: Numbers) -> float:
    """alpha of the worse of both breaks, at the elevator and at e_rho: unknowns v, g, t."""
    known, v = loop.airframe, loop.speed_mps
    ratio = v / known.speed_mps
    square = (v / known.best_glide_mps) ** 2
    falls = np.arctan((square + 1.0 / square) / (2.0 * known.glide_ratio))
    lift = v * ratio / known.path_s
    drag = lift / (known.glide_ratio * square)
    omega = known.short_period_radps * ratio
    damped = lift / v - 2.0 * known.damping * omega
    stiff = -(omega**2) - damped * lift / v
    effect = known.effect_radps2 * ratio**2
    lifted = loop.lift_mps2 * ratio**2

    def sensitivity(s: complex) -> tuple[complex, complex]:
        free = np.array(
            (
                (s + 2.0 * G * np.sin(falls) / v, G * np.cos(falls) - drag, drag),
                (-2.0 * G * np.cos(falls) / v, v * s + lift + G * np.sin(falls), -lift),
                (0.0, stiff, s * s - damped * s - stiff),
            )
        )
        speed, path, pitch = np.linalg.solve(
            free, np.array((-lifted / (known.glide_ratio * square), lifted, effect + 0j))
        )
        lean = loop.lean_rad - falls
        rate = np.cos(lean) * speed - v * np.sin(lean) * path
        surface = np.exp(-s * (loop.delay_s + HALF_A_TICK_S)) / (1.0 + s * loop.lag_s)
        old = late = 0.0
        if not loop.inertial:
            old, late = FIXES_LATE_S, ATTITUDES_LATE_S
        outer, inner = loop.soaring, loop.pitch
        asked = np.exp(-s * old) * (
            (outer.kp + outer.ki / s) * (1.0 + s * old) * rate / s
            + outer.kd / (1.0 + s / outer.rate_filter_radps) * rate
        )
        damps = inner.kd * s / (1.0 + s / inner.rate_filter_radps)
        holds = (inner.kp + inner.ki / s) * (1.0 + s * late) + damps
        held = surface * holds * np.exp(-s * late) * pitch
        # By ticks of T, z = exp(s T): (z − 1) / T is z times the difference over the tick before.
        z, tick = np.exp(s * 2.0 * HALF_A_TICK_S), 2.0 * HALF_A_TICK_S
        rate, w = (z - 1.0) / tick, inner.rate_filter_radps
        follows = inner.kd * rate / z * w * z / (w * z + rate)
        line = -surface * (inner.kp + inner.ki / s + loop.setpoint_weight * follows) * asked
        return complex(1.0 / (1.0 + held + line)), complex((1.0 + held) / (1.0 + held + line))

    return min(nearest([sensitivity(1j * w) for w in radps]))


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize("speed_mps", [8.0, 9.5, 12.0])
@pytest.mark.parametrize("lean_rad", [0.1, 0.4, 0.8])
@pytest.mark.parametrize("weight", [0.0, 0.7])
def test_pitch_and_the_line(
    inertial: bool, speed_mps: float, lean_rad: float, weight: float
) -> None:
    """On the frequencies of the rule the same; 2 % is what lies between them at the most."""
    loop = PITCH._replace(
        inertial=inertial, speed_mps=speed_mps, lean_rad=lean_rad, setpoint_weight=weight
    )
    theirs = 0.25 * 1.115 ** np.arange(60)
    equations = pitch_by_matrices(loop, theirs)
    assert equations > 0.4
    assert disk_margin(loop) == pytest.approx(equations, rel=1e-9)
    finer = pitch_by_matrices(loop, 0.25 * 1.02 ** np.arange(330))
    assert disk_margin(loop) == pytest.approx(finer, rel=0.02)

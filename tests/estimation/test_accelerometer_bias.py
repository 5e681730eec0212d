"""The accelerometers' bias is what is constant, and nothing that is flown."""

from __future__ import annotations

from math import cos, inf, isnan, pi, radians, sin

import numpy as np
import pytest

from tgl_soar.estimation.accelerometer_bias import ForceAverages, averaged, begun, unbiased
from tgl_soar.estimation.body_axes import BodyMotion, body_axes, body_motion
from tgl_soar.geometry import quaternion_from_euler, rotated
from tgl_soar.types import NAN, NO_IMU, VehicleState

G = 9.80665
DT = 0.005
BIAS_X, BIAS_Z = 0.11, -0.23


def flown(t: float, swing_rad: float, bank_rad: float, sideways_mps: float) -> VehicleState:
    """A weave: heading, bank and velocity to and fro within 4 s, at some climb and pitch."""
    w = 2.0 * pi / 4.0
    s, c = sin(w * t), cos(w * t)
    return VehicleState(
        time_s=t,
        x_m=0.0,
        y_m=0.0,
        z_m=0.0,
        velocity_x_mps=-1.0 + 0.8 * sin(2.0 * w * t),
        velocity_y_mps=sideways_mps * s,
        climb_mps=-0.8 + 0.3 * c,
        roll_rad=bank_rad * c,
        pitch_rad=-0.03 + 0.02 * s,
        heading_rad=swing_rad * s,
        roll_rate_radps=-bank_rad * w * s,
        pitch_rate_radps=0.02 * w * c,
        heading_rate_radps=swing_rad * w * c,
    )


def measured(t: float, **weave: float) -> tuple[float, float]:
    """What accelerometers without a bias feel, x and z, by differences of the velocity and by the
    rotation as a quaternion: no formula of the estimator's."""
    h = 1e-5
    after, before, now = flown(t + h, **weave), flown(t - h, **weave), flown(t, **weave)
    acceleration = (
        -(after.velocity_x_mps - before.velocity_x_mps) / (2.0 * h),
        (after.velocity_y_mps - before.velocity_y_mps) / (2.0 * h),
        -(after.climb_mps - before.climb_mps) / (2.0 * h) - G,
    )
    q = quaternion_from_euler(now.roll_rad, now.pitch_rad, now.heading_rad)
    back = (q[0], -q[1], -q[2], -q[3])
    x, _, z = rotated(back, acceleration)
    return x, z


@pytest.mark.parametrize(
    "weave",
    [
        {"swing_rad": 0.0, "bank_rad": 0.0, "sideways_mps": 0.0},
        {"swing_rad": radians(35.0), "bank_rad": radians(14.0), "sideways_mps": 4.0},
        {"swing_rad": radians(52.0), "bank_rad": radians(-20.0), "sideways_mps": 6.0},
    ],
)
def test_however_it_weaves_only_the_bias_is_taken_out(weave: dict[str, float]) -> None:
    average = begun(body_motion(body_axes(flown(0.0, **weave)), flown(0.0, **weave)))
    errors = []
    for n in range(1, round(8.0 * 5.0 / DT)):
        vehicle = flown(n * DT, **weave)
        x, z = measured(n * DT, **weave)
        imu = NO_IMU._replace(force_x_frd_mps2=x + BIAS_X, force_z_frd_mps2=z + BIAS_Z)
        frame = body_axes(vehicle)
        motion = body_motion(frame, vehicle)
        average = averaged(average, frame, motion, imu, G, DT)
        fx, fz = unbiased(average, motion, imu)
        if n * DT > 6.0 * 5.0:
            errors.append((fx - x, fz - z))
    assert np.max(np.abs(errors)) < 0.01


def test_without_rates_it_is_taken_not_to_turn_and_without_attitude_nothing_is_known() -> None:
    weave = {"swing_rad": 0.6, "bank_rad": 0.2, "sideways_mps": 4.0}
    vehicle = flown(0.3, **weave)
    still = vehicle._replace(heading_rate_radps=NAN)
    moved = body_motion(body_axes(still), still)
    assert (moved.turning_x_mps2, moved.turning_z_mps2) == (0.0, 0.0)
    assert body_motion(body_axes(vehicle), vehicle).turning_x_mps2 != 0.0
    blind = vehicle._replace(roll_rad=inf)
    assert isnan(body_motion(body_axes(blind), blind).forward_mps)


def test_forces_that_come_seldom_are_averaged_over_the_same_time() -> None:
    motion = BodyMotion(forward_mps=0.0, down_mps=0.0, turning_x_mps2=0.0, turning_z_mps2=0.0)
    level = body_axes(flown(0.0, swing_rad=0.0, bank_rad=0.0, sideways_mps=0.0))
    level = level._replace(x_d=0.0, z_d=0.0)
    found = []
    for since in (0.005, 0.02):
        average = ForceAverages(forward_mps=0.0, down_mps=0.0, force_x_mps2=0.0, force_z_mps2=0.0)
        imu = NO_IMU._replace(force_x_frd_mps2=1.0, force_z_frd_mps2=0.0)
        for _ in range(round(5.0 / since)):
            average = averaged(average, level, motion, imu, G, since)
        found.append(average.force_x_mps2)
    assert found == pytest.approx([1.0 - 1.0 / np.e] * 2, abs=2e-3)

"""The wind's filter against the same filter in matrices: seven states, two of them estimated.

Its page states the measurements and says that constant errors are considered (Schmidt).  Here the
whole covariance is one matrix, each measurement is differentiated numerically, and the gain moves
the wind alone; what the filter writes out element by element must be the same.
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.aerodynamics import lift_drag
from tgl_soar.estimation.wind import (
    WindParams,
    WindPosterior,
    WindState,
    initial_wind,
    wind_step,
)
from tgl_soar.types import (
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    AirspeedSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    VehicleState,
    polar_sink,
)

Numbers = NDArray[np.floating[Any]]
AERO = load_airframe(shipped("airframes/eclipson_c.toml")).aerodynamics()
G = AERO.gravity_mps2
ALIGNMENT = radians(0.6)
PARAMS = WindParams(AERO, 0.7, ALIGNMENT)
DT, NOW = 0.02, 10.0
VELOCITY_SD = 0.03
# How far lift, drag, the pitot and the trim of an airframe file are trusted.
LIFT, DRAG = 0.04 * G, 0.10 * G / 6.0
PITOT, TRIM = 0.15, 0.02
VEHICLE = VehicleState(
    time_s=NOW,
    x_m=0.0,
    y_m=0.0,
    z_m=20.0,
    velocity_x_mps=0.4,
    velocity_y_mps=-0.6,
    climb_mps=0.3,
    roll_rad=0.2,
    pitch_rad=0.03,
    heading_rad=-0.15,
    roll_rate_radps=0.1,
    pitch_rate_radps=-0.3,
    heading_rate_radps=0.2,
)
WIND, UPDRAFT, N_ERR, A_ERR, P_ERR, T_ERR, PITCH = range(7)


def prior() -> Numbers:
    """Of the constant errors: the axial one holds what a tilted accelerometer measures of g."""
    p = np.diag(
        [0.0, 0.0, LIFT**2, DRAG**2 + (G * ALIGNMENT) ** 2, PITOT**2, TRIM**2, ALIGNMENT**2]
    )
    p[A_ERR, PITCH] = p[PITCH, A_ERR] = G * ALIGNMENT**2
    return p


def known() -> tuple[Numbers, Numbers]:
    """A mean, and a covariance in which everything is correlated as far as it may be."""
    p = prior()
    p[:2, :2] = [[0.30, 0.05], [0.05, 0.16]]
    correlations = np.array([[0.10, -0.20, 0.15, 0.05, 0.12], [-0.08, 0.11, 0.03, 0.17, -0.14]])
    p[:2, 2:] = correlations * np.sqrt(np.outer(np.diag(p)[:2], np.diag(p)[2:]))
    p[2:, :2] = p[:2, 2:].T
    return np.array([8.9, 1.4, 0.0, 0.0, 0.0, 0.0, 0.0]), p


def posterior(mean: Numbers, p: Numbers) -> WindPosterior:
    own = p[0, 0], p[0, 1], p[1, 1]
    crossed = [p[i, j] for j in range(2, 7) for i in range(2)]
    return WindPosterior._make((mean[0], mean[1], *own, *crossed))


def axes() -> Numbers:
    """R: the body's axes in upwind NED, from yaw, pitch and roll one after the other."""
    r, p, h = VEHICLE.roll_rad, VEHICLE.pitch_rad, VEHICLE.heading_rad
    yaw = np.array([[cos(h), -sin(h), 0], [sin(h), cos(h), 0], [0, 0, 1]])
    pitch = np.array([[cos(p), 0, sin(p)], [0, 1, 0], [-sin(p), 0, cos(p)]])
    roll = np.array([[1, 0, 0], [0, cos(r), -sin(r)], [0, sin(r), cos(r)]])
    return np.asarray(yaw @ pitch @ roll)


def air(mean: Numbers) -> tuple[float, float]:
    """(u, w): the flow along the body's x and z axes."""
    v = VEHICLE
    flow = axes().T @ np.array(
        [mean[0] - v.velocity_x_mps, v.velocity_y_mps, mean[1] - v.climb_mps]
    )
    return float(flow[0]), float(flow[2])


K = 0.5 * AERO.air_density_kgpm3 * AERO.wing_area_m2 / AERO.mass_kg


def normal_of(mean: Numbers, elevator: float) -> float:
    u, w = air(mean)
    cl, _, cd, _ = lift_drag(AERO, atan2(w, u), elevator)
    return K * hypot(u, w) * (cl * u + cd * w)


def axial_of(mean: Numbers, elevator: float) -> float:
    u, w = air(mean)
    cl, _, cd, _ = lift_drag(AERO, atan2(w, u), elevator)
    return K * hypot(u, w) * (cl * w - cd * u)


def alpha_of(mean: Numbers) -> float:
    u, w = air(mean)
    return atan2(w, u)


def slopes(of: Callable[[Numbers], float], mean: Numbers, error: int) -> Numbers:
    """A measurement's row: by the wind, by differences, and by its own constant error."""
    row = np.zeros(7)
    for i in (WIND, UPDRAFT):
        step = np.zeros(7)
        step[i] = 1e-5
        row[i] = (of(mean + step) - of(mean - step)) / 2e-5
    row[error] = 1.0
    return row


def corrected(
    mean: Numbers, p: Numbers, row: Numbers, innovation: float, noise: float
) -> tuple[Numbers, Numbers]:
    """Schmidt's: the gain of what is considered is zero."""
    variance = row @ p @ row + noise
    gain = p @ row / variance
    gain[2:] = 0.0
    keep = np.eye(7) - np.outer(gain, row)
    return mean + gain * innovation, keep @ p @ keep.T + noise * np.outer(gain, gain)


def reference(
    force: tuple[float, float] | None, pitot: float | None, elevator: float | None, dt_s: float
) -> tuple[Numbers, Numbers]:
    """What a tick makes of the mean and covariance of `known`."""
    mean, p = known()
    p[:2, :2] += 2.0 * PARAMS.change**2 * dt_s * np.eye(2)
    deflection = elevator or 0.0
    x_noise = z_noise = 0.25
    if force is None:  # steady flight, give or take, for a tenth of a second
        down = axes().T @ np.array([0.0, 0.0, -G])
        force = float(down[0]), float(down[2])
        x_noise, z_noise = (sd * sqrt(2.0 * 0.1 / dt_s) for sd in (0.25, 1.3))
    _, cl_alpha, _, _ = lift_drag(AERO, alpha_of(mean), deflection)
    rough = (3.0 * (1.0 - cl_alpha / AERO.CL_alpha)) ** 2
    there = mean.copy()
    row = slopes(lambda m: normal_of(m, deflection), there, N_ERR)
    off = -force[1] - normal_of(there, deflection)
    mean, p = corrected(mean, p, row, off, z_noise**2 + rough)
    row = slopes(lambda m: axial_of(m, deflection), there, A_ERR)
    moved = float(row[:2] @ (mean - there)[:2])
    off = force[0] - axial_of(there, deflection) - moved
    mean, p = corrected(mean, p, row, off, x_noise**2 + rough)
    if elevator is not None:
        damped = AERO.Cm_q * AERO.chord_m * VEHICLE.pitch_rate_radps / (2.0 * hypot(*air(mean)))
        trim = -(AERO.Cm0 + AERO.Cm_elevator * elevator + damped) / AERO.Cm_alpha
        row = slopes(alpha_of, mean, T_ERR)
        mean, p = corrected(mean, p, row, trim - alpha_of(mean), 0.05**2 * 2.0 * 0.1 / dt_s)
    if pitot is not None:
        row = slopes(lambda m: air(m)[0], mean, P_ERR)
        mean, p = corrected(mean, p, row, pitot - air(mean)[0], 0.2**2)
    return mean, p


def inputs(force: tuple[float, float] | None, pitot: float | None) -> Inputs:
    imu, airspeed = NO_IMU, NO_AIRSPEED
    if force is not None:
        imu = ImuSample(
            sequence=1,
            time_s=NOW,
            force_x_frd_mps2=force[0],
            force_y_frd_mps2=0.3,
            force_z_frd_mps2=force[1],
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        )
    if pitot is not None:
        airspeed = AirspeedSample(1, NOW, pitot)
    return Inputs(
        time_s=NOW,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=AutopilotStatus(time_s=NOW, accepts_surfaces=True, armed=True),
        engage=True,
        imu=imu,
        airspeed=airspeed,
        surfaces=NO_SURFACES,
    )


def at_rest(force: tuple[float, float] | None) -> WindState:
    """What is known a tick before, with averages in which the force is no bias."""
    mean, p = known()
    v = VEHICLE
    over_ground = axes().T @ np.array([-v.velocity_x_mps, v.velocity_y_mps, -v.climb_mps])
    state = initial_wind()._replace(time_s=NOW - DT, posterior=posterior(mean, p))
    average = state.average._replace(
        forward_mps=float(over_ground[0]), down_mps=float(over_ground[2])
    )
    # One sample blends dt / 5 s of it into the averages; they are put so that none is left.
    if force is not None:
        r, q, h = v.roll_rate_radps, v.pitch_rate_radps, v.heading_rate_radps
        sr, cr, sp, cp = sin(v.roll_rad), cos(v.roll_rad), sin(v.pitch_rad), cos(v.pitch_rad)
        rates = np.array([r - h * sp, q * cr + h * cp * sr, h * cp * cr - q * sr])
        turning = np.cross(rates, over_ground)
        down = axes().T @ np.array([0.0, 0.0, G])
        measured_x, measured_z = force[0] + down[0] - turning[0], force[1] + down[2] - turning[2]
        blend = DT / 5.0
        average = average._replace(
            force_x_mps2=float(-blend * measured_x / (1.0 - blend)),
            force_z_mps2=float(-blend * measured_z / (1.0 - blend)),
        )
    return state._replace(average=average)


FORCE = (0.15, -9.9)


@pytest.mark.parametrize("force", [None, FORCE, (0.6, -11.0)])
@pytest.mark.parametrize("pitot", [None, 9.2])
@pytest.mark.parametrize("elevator", [None, 0.05])
def test_every_number_is_that_of_the_matrices(
    force: tuple[float, float] | None, pitot: float | None, elevator: float | None
) -> None:
    deflection = float("nan") if elevator is None else elevator
    state, estimate = wind_step(
        PARAMS, at_rest(force), VEHICLE, inputs(force, pitot), VELOCITY_SD, deflection, True
    )
    mean, p = reference(force, pitot, elevator, DT)
    assert state.refused == 0
    assert tuple(state.posterior) == pytest.approx(tuple(posterior(mean, p)), rel=1e-6, abs=1e-9)
    u, w = air(mean)
    assert estimate.airspeed_mps == pytest.approx(hypot(u, w))
    assert estimate.alpha_rad == pytest.approx(atan2(w, u))
    damped = AERO.Cm_q * AERO.chord_m * VEHICLE.pitch_rate_radps / (2.0 * hypot(u, w))
    held = -(AERO.Cm0 + AERO.Cm_elevator * deflection + damped) / AERO.Cm_alpha
    assert estimate.trim_alpha_rad == pytest.approx(held, nan_ok=True)
    flat = hypot(mean[0] - VEHICLE.velocity_x_mps, VEHICLE.velocity_y_mps)
    assert estimate.excess_mps == pytest.approx(mean[1] - polar_sink(AERO.polar, flat))
    assert estimate.measured == (pitot is not None)
    # The wind is v and R(θ + δ) (u, w): by δ the flow turns about the wings.
    down = mean[1] - VEHICLE.climb_mps
    turned = np.zeros((2, 7))
    turned[0, :2], turned[1, :2] = (1.0, 0.0), (0.0, 1.0)
    turned[0, PITCH], turned[1, PITCH] = -down, flat
    spread = turned @ p @ turned.T + VELOCITY_SD**2 * np.eye(2)
    assert estimate.wind_sigma_mps == pytest.approx(sqrt(spread[0, 0]))
    assert estimate.updraft_sigma_mps == pytest.approx(sqrt(spread[1, 1]))


def test_a_propeller_s_pull_is_no_force_of_the_air_s() -> None:
    """It is taken off the axial force: as if that had been measured without it."""
    pushed = PARAMS._replace(push_mps2=0.4)
    args = VEHICLE, VELOCITY_SD, 0.05, True
    state, _ = wind_step(pushed, at_rest(FORCE), args[0], inputs(FORCE, None), *args[1:])
    mean, p = reference((FORCE[0] - 0.4, FORCE[1]), None, 0.05, DT)
    assert tuple(state.posterior) == pytest.approx(tuple(posterior(mean, p)), rel=1e-6, abs=1e-9)


def test_what_no_flight_explains_is_refused_and_counted() -> None:
    """Beyond five standard deviations: 40 m/s of a pitot, ten g of the wing, of which both axes."""
    state, _ = wind_step(
        PARAMS, at_rest(FORCE), VEHICLE, inputs(FORCE, 40.0), VELOCITY_SD, 0.05, True
    )
    mean, p = reference(FORCE, None, 0.05, DT)
    assert state.refused == 1
    assert tuple(state.posterior) == pytest.approx(tuple(posterior(mean, p)), rel=1e-6, abs=1e-9)
    hit = (50.0, -100.0)
    state, _ = wind_step(PARAMS, at_rest(hit), VEHICLE, inputs(hit, None), VELOCITY_SD, 0.05, True)
    assert state.refused == 2


def test_at_first_a_glide_a_little_faster_than_the_slowest_is_thought_likely() -> None:
    """Nothing is measured in the first tick: the wind is as unknown as 4 m/s, on both axes."""
    still = inputs(None, None)._replace(imu=NO_IMU)
    state, _ = wind_step(PARAMS, initial_wind(), VEHICLE, still, VELOCITY_SD, float("nan"), False)
    speed = 1.15 * AERO.polar.speed_min_mps
    found = state.posterior
    assert found.wind_mps == pytest.approx(VEHICLE.velocity_x_mps + speed)
    assert found.updraft_mps == pytest.approx(VEHICLE.climb_mps + polar_sink(AERO.polar, speed))
    assert found[2:5] == (16.0, 0.0, 16.0)
    assert found[5:] == (0.0,) * 10

"""One reading of the forecast's two filters, against the same in matrices.

The page states what is carried on and how uncertain it becomes; what is written out there element
by element is here F P Fᵀ + Q and a gain, and the chances are those of normal numbers.
"""

from __future__ import annotations

from math import cos, erfc, isnan, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.control import forecast as f
from tgl_soar.control.envelope import Fence
from tgl_soar.control.forecast import (
    ForecastParams,
    ForecastState,
    GustReadings,
    LiftReadings,
    WindReadings,
    forecast_step,
    initial_forecast,
)
from tgl_soar.control.line_room import line_room
from tgl_soar.types import (
    GRAVITY_MPS2,
    NO_AIR,
    AirEstimate,
    GlidePolar,
    Ground,
    VehicleState,
    polar_sink,
)

Numbers = NDArray[np.floating[Any]]
POLAR = GlidePolar(c0=5.14, c1=-0.96, c2=0.06, c3=0.0, speed_min_mps=7.0, speed_max_mps=13.0)
CLEAR_M = 0.4
PARAMS = ForecastParams(
    act=f.DISENGAGE,
    time_s=1.0,
    chance=0.05,
    clearance_min_m=CLEAR_M,
    speed_min_mps=6.0,
    polar=POLAR,
    pushed_mps=0.07,
)
WIDE = Fence(x_min_m=-50.0, x_max_m=50.0, y_max_m=5.0, z_min_m=-50.0, z_max_m=30.0)
LEVEL = Ground(1, (0.0,) * 8, (0.0,) * 8)
ETA = radians(108.0)
DT, NOW, BEGUN = 0.1, 20.0, 18.0
VELOCITY_SD = 0.03
VEHICLE = VehicleState(
    time_s=NOW,
    x_m=0.15,
    y_m=0.0,
    z_m=6.0,
    velocity_x_mps=0.3,
    velocity_y_mps=0.0,
    climb_mps=-0.4,
    roll_rad=0.0,
    pitch_rad=0.0,
    heading_rad=0.0,
    roll_rate_radps=0.0,
    pitch_rate_radps=0.0,
    heading_rate_radps=0.0,
)
AIR = NO_AIR._replace(
    airspeed_mps=8.4,
    wind_mps=8.7,
    updraft_mps=1.2,
    wind_sigma_mps=0.2,
    updraft_sigma_mps=0.1,
)
STATE = ForecastState(
    begun_s=BEGUN,
    time_s=NOW - DT,
    x_m=0.11,
    z_m=6.06,
    held=0,
    lift=LiftReadings(
        h_m=5.75,
        a_mps=-0.15,
        b_per_s=-0.2,
        p_hh=4e-4,
        p_ha=3e-4,
        p_hb=-1e-4,
        p_aa=0.02,
        p_ab=-0.004,
        p_bb=0.03,
    ),
    wind=WindReadings(u_mps=8.5, g_per_s=0.1, p_uu=0.05, p_ug=0.01, p_gg=0.2),
    gusts=GustReadings(0.02, 0.015),
    foreseen=f.NO_FORECAST,
)
ALONG_X, ALONG_Z = cos(ETA), sin(ETA)
# Down the line to the least clearance, within 3 mm, and on to the ground.
ROOM = line_room(CLEAR_M, WIDE, LEVEL, VEHICLE.x_m, VEHICLE.z_m, ETA)
DOWN_M, DEPTH_M = ROOM.down_m, ROOM.depth_m


def read(state: ForecastState = STATE, vehicle: VehicleState = VEHICLE) -> ForecastState:
    return forecast_step(PARAMS, WIDE, LEVEL, state, vehicle, AIR, VELOCITY_SD, ETA, moving=False)


def sink(speed_mps: float) -> float:
    return polar_sink(POLAR, speed_mps)


def moved() -> tuple[float, float]:
    """Up the line, and across it."""
    dx, dz = VEHICLE.x_m - STATE.x_m, VEHICLE.z_m - STATE.z_m
    return dx * ALONG_X + dz * ALONG_Z, dz * ALONG_X - dx * ALONG_Z


def corrected(mean: Numbers, p: Numbers, off: float, noise: float) -> tuple[Numbers, Numbers]:
    """By a measurement of the first state."""
    gain = p[:, 0] / (p[0, 0] + noise)
    return mean + gain * off, p - np.outer(gain, p[0])


def lift_by_matrices() -> tuple[Numbers, Numbers]:
    """(h, a, b) and their covariance."""
    lift, (ds, dn) = STATE.lift, moved()
    p = np.array(
        [
            [lift.p_hh, lift.p_ha, lift.p_hb],
            [lift.p_ha, lift.p_aa, lift.p_ab],
            [lift.p_hb, lift.p_ab, lift.p_bb],
        ]
    )
    wind, vx = STATE.wind.u_mps, VEHICLE.velocity_x_mps
    speed = AIR.wind_mps - vx
    per_depth = sink(wind) / DEPTH_M  # S / depth
    # First in time, then along the line.
    later = np.array([[1.0, DT, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    along = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, ds], [0.0, 0.0, 1.0]])
    mean = along @ (later @ np.array([lift.h_m, lift.a_mps, lift.b_per_s]))
    mean[0] += (sink(wind) - sink(wind - vx) + PARAMS.pushed_mps) * DT
    p = along @ later @ p @ later.T @ along.T
    p[0, 0] += 2.0 * STATE.gusts.variance_m2ps2 * (DEPTH_M / speed) * DT
    p[1, 1] += per_depth**2 * DEPTH_M * abs(dn) + (0.03 * sink(wind)) ** 2 * DT
    # b decays over a way of depth, towards what is expected of it.
    keeps = 1.0 - abs(ds) / DEPTH_M
    expected, spread = -0.7 * per_depth, (0.7 * per_depth) ** 2
    fades = np.diag([1.0, 1.0, keeps])
    mean[2] = expected + keeps * (mean[2] - expected)
    p = fades @ p @ fades
    p[2, 2] += (1.0 - keeps**2) * spread
    trades_s = speed / GRAVITY_MPS2
    noise = 0.01**2 + (trades_s * VELOCITY_SD) ** 2
    return corrected(mean, p, VEHICLE.z_m - trades_s * vx - mean[0], noise)


def wind_by_matrices() -> tuple[Numbers, Numbers]:
    """(u, du/ds) and their covariance."""
    wind, (ds, dn) = STATE.wind, moved()
    p = np.array([[wind.p_uu, wind.p_ug], [wind.p_ug, wind.p_gg]])
    along = np.array([[1.0, ds], [0.0, 1.0]])
    mean = along @ np.array([wind.u_mps, wind.g_per_s])
    expected = (0.5 * AIR.wind_mps / DEPTH_M) ** 2
    p = along @ p @ along.T
    p[0, 0] += expected * DEPTH_M * abs(dn) + (0.03 * wind.u_mps) ** 2 * DT
    keeps = 1.0 - abs(ds) / DEPTH_M
    mean[1] *= keeps
    fades = np.diag([1.0, keeps])
    p = fades @ p @ fades
    p[1, 1] += (1.0 - keeps**2) * expected
    # Gusts are others after depth / V: so many readings are of the same one.
    speed = AIR.wind_mps - VEHICLE.velocity_x_mps
    alike = 2.0 * DEPTH_M / speed / DT
    return corrected(mean, p, AIR.wind_mps - mean[0], STATE.gusts.variance_m2ps2 * alike)


def test_the_lift_is_that_of_the_matrices() -> None:
    mean, p = lift_by_matrices()
    found = read().lift
    assert found[:3] == pytest.approx(tuple(mean), rel=1e-9)
    upper = [p[i, j] for i in range(3) for j in range(i, 3)]
    assert found[3:] == pytest.approx(tuple(upper), rel=1e-9)


def test_the_wind_is_that_of_the_matrices() -> None:
    mean, p = wind_by_matrices()
    found = read().wind
    assert found[:2] == pytest.approx(tuple(mean), rel=1e-9)
    assert found[2:] == pytest.approx((p[0, 0], p[0, 1], p[1, 1]), rel=1e-9)


@pytest.mark.parametrize("age_s", [0.2, 1.4, 10.0])
def test_gusts_are_averaged_over_what_there_is_of_three_seconds(age_s: float) -> None:
    """The first guess weighs as much as half a second of readings."""
    state = STATE._replace(begun_s=NOW - DT - age_s)
    blend = DT / min(3.0, 0.5 + age_s + DT)
    gusts, found = STATE.gusts, read(state).gusts
    a_mps = lift_by_matrices()[0][1]
    gust = AIR.updraft_mps - sink(AIR.wind_mps) - a_mps - gusts.offset_mps
    assert found.offset_mps == pytest.approx(gusts.offset_mps + blend * gust)
    variance = (1.0 - blend) * gusts.variance_m2ps2 + blend * gust**2
    assert found.variance_m2ps2 == pytest.approx(variance)


def test_the_first_reading_takes_updraft_and_sink_for_alike() -> None:
    first = read(initial_forecast())
    speed = AIR.wind_mps - VEHICLE.velocity_x_mps
    trades_s = speed / GRAVITY_MPS2
    s = sink(AIR.wind_mps)
    gust = 0.03 * AIR.wind_mps
    lift, wind = first.lift, first.wind
    assert lift.h_m == pytest.approx(VEHICLE.z_m - trades_s * VEHICLE.velocity_x_mps)
    assert lift.a_mps == pytest.approx(AIR.updraft_mps - s)
    assert lift.b_per_s == pytest.approx(-0.7 * s / DEPTH_M)
    assert lift.p_hh == pytest.approx(0.01**2 + (trades_s * VELOCITY_SD) ** 2)
    assert lift.p_aa == pytest.approx(s**2)
    assert lift.p_bb == pytest.approx((0.7 * s / DEPTH_M) ** 2)
    assert (lift.p_ha, lift.p_hb, lift.p_ab) == (0.0, 0.0, 0.0)
    assert wind == pytest.approx(
        (AIR.wind_mps, 0.0, gust**2, 0.0, (0.5 * AIR.wind_mps / DEPTH_M) ** 2)
    )
    assert first.gusts == pytest.approx((0.0, gust**2))
    assert (first.begun_s, first.time_s, first.held) == (NOW, NOW, 0)
    assert first.foreseen.standing == f.UNKNOWN
    assert isnan(first.foreseen.chance)


def test_a_velocity_of_any_manoeuvre_is_not_taken_to_be_as_bad_on_a_line() -> None:
    """Held by a line it lags by 0.2 s of g times 0.025 rad: 0.05 m/s."""
    far = forecast_step(
        PARAMS, WIDE, LEVEL, initial_forecast(), VEHICLE, AIR, 0.6, ETA, moving=False
    )
    trades_s = (AIR.wind_mps - VEHICLE.velocity_x_mps) / GRAVITY_MPS2
    assert far.lift.p_hh == pytest.approx(0.01**2 + (trades_s * 0.05) ** 2)


def negative(mean: float, variance: float) -> float:
    """P(x < 0)"""
    return 0.5 * erfc(mean / sqrt(2.0 * variance))


@pytest.mark.parametrize("variance", [0.0, -1e-18])
def test_what_is_known_exactly_is_negative_for_certain_or_not_at_all(variance: float) -> None:
    """By rounding, or as there is no noise, a variance may be zero or less."""
    assert [f._below(mean, variance) for mean in (-0.1, 0.0, 0.1)] == [1.0, 0.0, 0.0]


def test_place_time_and_chance_follow_from_the_readings() -> None:
    state = read()
    found, (_, a, b, _, _, _, *p) = state.foreseen, state.lift
    u = state.wind.u_mps
    slope = (sink(u + 1e-5) - sink(u - 1e-5)) / 2e-5
    c = ALONG_Z - slope * ALONG_X
    # What it has of speed up the line is used up before E alone moves it: (V/g) cos(eta) s''.
    slide = VEHICLE.velocity_x_mps * ALONG_X + VEHICLE.climb_mps * ALONG_Z
    inertia_s = -ALONG_X * (AIR.wind_mps - VEHICLE.velocity_x_mps) / (GRAVITY_MPS2 * c)
    coast = inertia_s * (slide - a / c)
    assert coast < 0.0
    down = DOWN_M + coast
    up = (WIDE.z_max_m - VEHICLE.z_m) / ALONG_Z - coast
    curve = 2.0 * (0.7 * sink(u)) ** 2 / DEPTH_M**3

    def best(side: float, way: float) -> float:
        chances = [negative(side * a, p[0])]
        for k in range(6):
            d = side * way / 2.0**k
            variance = p[0] + 2.0 * p[1] * d + p[2] * d**2 + curve * abs(d) ** 3 / 3.0
            chances.append(negative(side * (a + b * d), variance))
        return max(chances)

    sinks = negative(a, p[0])
    chance = sinks * best(-1.0, down) + (1.0 - sinks) * best(1.0, up)
    assert found.chance == pytest.approx(chance, rel=1e-9)
    assert (found.excess_mps, found.slope_per_s) == (a, b)
    goes = -a / b  # here E vanishes on the way down
    assert -down < goes < 0.0
    assert found.x_m == pytest.approx(VEHICLE.x_m + (coast + goes) * ALONG_X)
    assert found.z_m == pytest.approx(VEHICLE.z_m + (coast + goes) * ALONG_Z)
    assert found.ahead_s == pytest.approx(-3.0 * c / b)
    variance = p[0] + 2.0 * p[1] * goes + p[2] * goes**2
    assert found.sigma_m == pytest.approx(sqrt(variance) / max(abs(b), sqrt(p[2])))
    assert found.standing == f.SETTLES


@pytest.mark.parametrize(
    ("wind_mps", "sigma_mps", "standing"),
    [
        (6.5, 0.1, f.TOO_SLOW),  # the polar ends at 7 m/s
        (6.7, 0.5, f.SETTLES),  # one chance in four that it is fast enough
        (14.2, 0.1, f.TOO_FAST),
        (13.3, 0.5, f.SETTLES),
    ],
)
def test_the_wind_at_the_place_is_judged_with_its_own_uncertainty(
    wind_mps: float, sigma_mps: float, standing: int
) -> None:
    wind = WindReadings(u_mps=wind_mps, g_per_s=0.0, p_uu=1e-4, p_ug=0.0, p_gg=1e-4)
    state = STATE._replace(wind=wind, held=f.HOLDS, gusts=GustReadings(0.0, 1e6))
    air: AirEstimate = AIR._replace(wind_mps=wind_mps, wind_sigma_mps=sigma_mps)
    found = forecast_step(PARAMS, WIDE, LEVEL, state, VEHICLE, air, VELOCITY_SD, ETA, moving=False)
    assert found.foreseen.standing == standing


@pytest.mark.parametrize("seconds", [0.0, 0.05, 0.099])
def test_between_two_readings_all_is_as_it_was(seconds: float) -> None:
    vehicle = VEHICLE._replace(time_s=STATE.time_s + seconds)
    assert read(STATE, vehicle) is STATE

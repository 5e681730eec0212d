"""The line of a rollout moves as the flown one does; air and steps are those of the page."""

from __future__ import annotations

from math import cos, inf, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import brentq

from tgl_soar.control.search.ahead import (
    Ahead,
    Floor,
    LineWay,
    Mesh,
    Within,
    ahead_step,
    air_at,
    line_speed,
)
from tgl_soar.estimation.lift_map.extended_polar import sink
from tgl_soar.types import GRAVITY_MPS2, GlidePolar

ETA = radians(105.0)
SPEED_MPS, ACCELERATION_MPS2, DT_S = 0.5, 0.4, 0.1
WITHIN = Within(
    x_min_m=-inf,
    x_max_m=inf,
    z_min_m=-inf,
    z_max_m=inf,
    clearance_m=0.0,
    speed_min_mps=0.0,
    speed_max_mps=inf,
    slide_mps=SPEED_MPS,
    acceleration_mps2=ACCELERATION_MPS2,
)


@pytest.mark.parametrize("upstream_m", [-3.0, -0.1, 0.1, 3.0])
@pytest.mark.parametrize("along_m", [-2.0, 0.0, 5.0])
def test_how_fast_it_goes_is_of_the_way_across_it_alone(upstream_m: float, along_m: float) -> None:
    """Where on its line the target is named makes no difference."""
    x, z = 1.5, 10.0
    way = LineWay(
        x_m=x - upstream_m * sin(ETA) + along_m * cos(ETA),
        z_m=z + upstream_m * cos(ETA) + along_m * sin(ETA),
        sine=sin(ETA),
        cosine=cos(ETA),
        sine_now=sin(ETA),
        cosine_now=cos(ETA),
    )
    fastest = min(SPEED_MPS, sqrt(2.0 * ACCELERATION_MPS2 * abs(upstream_m)))
    wanted = np.copysign(fastest, upstream_m)
    assert line_speed(WITHIN, way, x, z, wanted, DT_S) == pytest.approx(wanted)
    begun = line_speed(WITHIN, way, x, z, 0.0, DT_S)
    assert begun == pytest.approx(np.copysign(ACCELERATION_MPS2 * DT_S, upstream_m))
    # One that goes the other way is slowed down first.
    turned = line_speed(WITHIN, way, x, z, -wanted, DT_S)
    assert turned == pytest.approx(-wanted + np.copysign(ACCELERATION_MPS2 * DT_S, upstream_m))


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("away_m", "speed_mps"), [(0.02, 0.2 * 0.632455532), (0.003, 0.03)])
def test_near_its_place_it_goes_no_faster_than_it_can_stop_or_arrive(
    away_m: float, speed_mps: float, side: float
) -> None:
    """√(2 a d), and within this step no farther than it has to go."""
    way = LineWay(x_m=0.0, z_m=0.0, sine=1.0, cosine=0.0, sine_now=1.0, cosine_now=0.0)
    found = line_speed(WITHIN, way, side * away_m, 3.0, side * speed_mps, DT_S)
    assert abs(found) == pytest.approx(min(sqrt(2.0 * 0.4 * away_m), away_m / DT_S), rel=1e-6)


# --- the air ------------------------------------------------------------------------------------

FLOOR = Floor(corner_x_m=np.zeros(0), height_m=np.zeros(1), slope=np.zeros(1), steepness=np.ones(1))
X, Z = np.linspace(-4.0, 6.0, 6), np.linspace(1.0, 9.0, 5)
MESH = Mesh(x_min_m=-4.0, z_min_m=1.0, x_per_m=0.5, z_per_m=0.5, nx=6, nz=5, floor=FLOOR)
RNG = np.random.default_rng(4)
WINDS, UPDRAFTS = RNG.normal(9.0, 1.0, (2, 6, 5)), RNG.normal(1.0, 1.0, (2, 6, 5))


def test_the_air_of_a_grid_is_scipys_and_beyond_it_the_edge_s() -> None:
    """Of each of two fields, which lie one behind the other."""
    x = np.concatenate([RNG.uniform(-4.0, 6.0, 40), [-4.0, 6.0, -9.0, 9.0, 0.0, 0.0, -9.0, 9.0]])
    z = np.concatenate([RNG.uniform(1.0, 9.0, 40), [1.0, 9.0, 5.0, 5.0, -3.0, 30.0, -3.0, 30.0]])
    places = np.stack([np.clip(x, -4.0, 6.0), np.clip(z, 1.0, 9.0)], axis=-1)
    for k in range(2):
        u, w = air_at(MESH, WINDS.ravel(), UPDRAFTS.ravel(), 30 * k, x, z)
        assert u == pytest.approx(RegularGridInterpolator((X, Z), WINDS[k])(places), abs=1e-5)
        assert w == pytest.approx(RegularGridInterpolator((X, Z), UPDRAFTS[k])(places), abs=1e-5)


# --- a step -------------------------------------------------------------------------------------

POLAR = GlidePolar(c0=2.0, c1=-0.35, c2=0.03, c3=0.0, speed_min_mps=4.0, speed_max_mps=20.0)
STILL = Ahead(x_m=0.5, z_m=4.0, climb_mps=0.2, speed_mps=0.1, margin_m=inf, aside_mps=inf)


def stepped(
    now: Ahead = STILL,
    eta: float = ETA,
    scale: float = 1.1,
    change: float = 1.0,
    dt_s: float = DT_S,
    **within: Any,
) -> Ahead:
    way = LineWay(
        x_m=-3.0, z_m=10.0, sine=sin(ETA), cosine=cos(ETA), sine_now=sin(eta), cosine_now=cos(eta)
    )
    return ahead_step(
        *(MESH, WINDS.ravel(), UPDRAFTS.ravel(), 0, POLAR, scale),
        *(WITHIN._replace(**within), way, now, change, dt_s),
    )


@pytest.mark.parametrize("eta_deg", [95.0, 105.0, 125.0])
@pytest.mark.parametrize("climb_mps", [-0.6, 0.4])
@pytest.mark.parametrize(("scale", "change"), [(0.9, 1.0), (1.1, 1.0), (1.0, 0.93)])
def test_a_step_solves_the_page_s_equations_implicitly(
    eta_deg: float, climb_mps: float, scale: float, change: float
) -> None:
    """n · (ẋ, ż) = v, and ż = w − (1 + p) S(V) + (V/g) ẍ with ẍ from climb and line."""
    eta = radians(eta_deg)
    now = STILL._replace(climb_mps=climb_mps)
    found = stepped(now, eta, scale, change)
    s, c, v = sin(eta), cos(eta), float(found.speed_mps)
    assert v == pytest.approx(0.1 + ACCELERATION_MPS2 * DT_S)
    place = [(now.x_m, now.z_m)]
    u = change * float(RegularGridInterpolator((X, Z), WINDS[0])(place)[0])
    w = change * float(RegularGridInterpolator((X, Z), UPDRAFTS[0])(place)[0])
    airspeed = u - (climb_mps * c - v) / s

    def off(climb: float) -> float:
        forward = ((climb - climb_mps) / DT_S * c - (v - 0.1) / DT_S) / s
        return w - scale * float(sink(POLAR, airspeed)) + airspeed / GRAVITY_MPS2 * forward - climb

    climb = brentq(off, -20.0, 20.0)
    assert found.climb_mps == pytest.approx(climb)
    vx, vz = (found.x_m - now.x_m) / DT_S, (found.z_m - now.z_m) / DT_S
    assert vz == pytest.approx(climb)
    assert -s * vx + c * vz == pytest.approx(v)


def test_an_upright_line_has_a_short_lag_and_no_air_is_slower_than_1_mps() -> None:
    """Two hundredths of a second: of a step of a tenth five sixths are gone."""
    upright = STILL._replace(speed_mps=0.5)
    way = LineWay(x_m=-9.0, z_m=4.0, sine=1.0, cosine=0.0, sine_now=1.0, cosine_now=0.0)
    for wind, airspeed in ((9.0, 9.5), (0.1, 1.0), (-3.0, 1.0)):
        found = ahead_step(
            *(MESH, np.full(30, wind), np.zeros(30), 0, POLAR, 1.0, WITHIN, way, upright, 1.0, DT_S)
        )
        goal = -float(sink(POLAR, airspeed))
        assert found.climb_mps == pytest.approx((0.2 + 5.0 * goal) / 6.0)


@pytest.mark.parametrize(
    ("side", "size"),
    [("x_min_m", -1.0), ("x_max_m", 1.0), ("z_min_m", -1.0), ("z_max_m", 1.0)],
)
def test_the_margin_is_to_the_nearest_side_of_the_fence(side: str, size: float) -> None:
    free = stepped()
    place = free.x_m if side.startswith("x") else free.z_m
    for away_m in (0.7, -0.2):
        limits: dict[str, Any] = {side: place + size * away_m}
        assert stepped(**limits).margin_m == pytest.approx(away_m)


def test_the_margin_is_to_the_ground_beyond_its_clearance_too() -> None:
    found = stepped(clearance_m=3.0)
    assert found.margin_m == pytest.approx(found.z_m - 3.0)
    assert stepped(clearance_m=3.0, z_max_m=4.1).margin_m < 0.2


def test_aside_is_to_the_nearer_end_of_the_airspeeds() -> None:
    slow = stepped(speed_min_mps=0.0, speed_max_mps=100.0)
    airspeed = float(slow.aside_mps)
    assert 7.0 < airspeed < 12.0
    assert stepped(speed_min_mps=7.0, speed_max_mps=100.0).aside_mps == pytest.approx(
        airspeed - 7.0
    )
    assert stepped(speed_min_mps=0.0, speed_max_mps=12.0).aside_mps == pytest.approx(
        12.0 - airspeed
    )

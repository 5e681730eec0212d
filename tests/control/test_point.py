"""Where a point on the line may go: within the fence, and clear of the ground."""

from __future__ import annotations

from math import cos, pi, radians, sin

import pytest

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.envelope import CLEAR_FACTOR, clearance
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.point import _is_free
from tgl_soar.control.point_hold import NO_POINT, BrakeState

UP = pi / 2.0
CLEAR_M = 0.5


@pytest.fixture(scope="module")
def laws() -> Laws:
    path, site_path = shipped("airframes/eclipson_c_spoilers.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(path), load_site(site_path)
    values = load_parameters(airframe, path, site, site_path)
    values = values.changed({"TGL_HOLD": 1.0, "CLEAR_MIN": CLEAR_M})
    return laws_from(values, site.frame(), ground=site.known_ground())


def at(x_m: float, z_m: float) -> BrakeState:
    return NO_POINT._replace(x_m=x_m, z_m=z_m)


def test_without_a_point_there_is_nowhere_to_go(laws: Laws) -> None:
    none = laws._replace(brake=laws.brake._replace(wanted=False))
    assert _is_free(laws, at(0.6, 1.6), UP, 0.1)
    assert not _is_free(none, at(0.6, 1.6), UP, 0.1)
    assert not _is_free(laws, NO_POINT, UP, 0.1)


def test_it_stays_within_the_fence(laws: Laws) -> None:
    top = laws.fence.z_max_m
    assert _is_free(laws, at(0.6, top - 0.2), UP, 0.19)
    assert not _is_free(laws, at(0.6, top - 0.2), UP, 0.21)
    downstream = laws.fence.x_max_m
    assert _is_free(laws, at(downstream - 0.2, 1.8), 0.0, 0.19)
    assert not _is_free(laws, at(downstream - 0.2, 1.8), 0.0, 0.21)


def test_it_stays_as_clear_of_the_ground_as_one_that_is_clear_again(laws: Laws) -> None:
    state, eta_rad = at(0.6, 1.6), radians(110.0)
    free = [i for i in range(90) if _is_free(laws, state, eta_rad, -0.01 * i)]
    assert free == list(range(len(free)))  # all the way there, and nothing beyond
    further_m = -0.01 * free[-1]
    x, z = 0.6 + further_m * cos(eta_rad), 1.6 + further_m * sin(eta_rad)
    assert clearance(laws.ground, x, z) == pytest.approx(CLEAR_FACTOR * CLEAR_M, abs=0.01)

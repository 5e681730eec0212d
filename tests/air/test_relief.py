"""The finite width of the jet: what must vanish, what must be conserved, what must shrink."""

from __future__ import annotations

from math import pi, radians, tan

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.freestream import FreeJetMap, solve_free_jet
from tgl_soar.air.relief import Relief, relieve, relieved_velocity

SLOPE = radians(23.0)


@pytest.fixture(scope="module")
def net() -> FreeJetMap:
    return FreeJetMap(solve_free_jet(SLOPE, 2.85, 2.45, 0.5), 5.0, 7.0)


@pytest.fixture(scope="module")
def square(net: FreeJetMap) -> Relief:
    return relieve(net, 2.85)


def _wind(
    net: FreeJetMap, relief: Relief | None, x: FloatArray, z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return relieved_velocity(net, relief, net.locate(x, z))


def test_an_infinitely_wide_jet_is_two_dimensional(net: FreeJetMap) -> None:
    wide = relieve(net, 500.0)
    # The correction falls with (length / width)²; the jet is some 3 m long and high.
    assert np.abs(wide.potential).max() < (3.0 / 500.0) ** 2 * 30.0
    assert abs(wide.slowing) < 1e-4


def test_nozzle_keeps_its_flow(net: FreeJetMap, square: Relief) -> None:
    z = np.linspace(0.01, 2.84, 300)
    u, _ = _wind(net, square, np.full_like(z, -4.0), z)
    # Blockage dies out as exp(−π x / H): 2 % of itself at 3.5 m ahead of the lip.
    assert np.trapezoid(u, z) / (z[-1] - z[0]) == pytest.approx(net.jet.nozzle_speed, rel=3e-3)


def test_air_leaves_sideways_in_front_of_the_board(net: FreeJetMap, square: Relief) -> None:
    x, z = np.meshgrid(np.linspace(0.2, 2.0, 10), np.linspace(1.2, 2.2, 6), indexing="ij")
    h = 0.01
    u_x = (_wind(net, square, x + h, z)[0] - _wind(net, square, x - h, z)[0]) / (2 * h)
    w_z = (_wind(net, square, x, z + h)[1] - _wind(net, square, x, z - h)[1]) / (2 * h)
    sideways = -(u_x + w_z)
    assert (sideways > 0.0).all()
    plain_x = (_wind(net, None, x + h, z)[0] - _wind(net, None, x - h, z)[0]) / (2 * h)
    plain_z = (_wind(net, None, x, z + h)[1] - _wind(net, None, x, z - h)[1]) / (2 * h)
    assert np.abs(plain_x + plain_z).max() < 1e-4  # second differences, and none of it real


def test_nothing_goes_through_board_and_floor(net: FreeJetMap, square: Relief) -> None:
    x = np.linspace(0.3, 2.0, 20)
    u, w = _wind(net, square, x, x * tan(SLOPE) + 1e-3)
    # A millimetre off the board, normal speed grows by speed over the distance to an edge.
    assert w == pytest.approx(u * tan(SLOPE), abs=0.01)
    _, w = _wind(net, square, np.linspace(-3.0, -0.3, 20), np.full(20, 1e-3))
    assert w == pytest.approx(0.0, abs=0.01)


def test_a_narrower_jet_lifts_less_high_above_the_board(net: FreeJetMap) -> None:
    place = np.array([1.2]), np.array([1.2 * tan(SLOPE) + 1.5])
    lifts = [
        float(_wind(net, relieve(net, width), *place)[1][0]) for width in (2.0, 2.85, 4.0, 8.0)
    ]
    assert lifts == sorted(lifts)
    assert lifts[-1] < float(_wind(net, None, *place)[1][0])


def test_relief_grows_away_from_the_board(net: FreeJetMap, square: Relief) -> None:
    """The board holds the flow to its slope; what is further away has room to give."""
    x = 0.9
    z = x * tan(SLOPE) + np.array([0.1, 0.5, 1.0, 1.5])
    kept = _wind(net, square, np.full(4, x), z)[1] / _wind(net, None, np.full(4, x), z)[1]
    assert (np.diff(kept) < 0.0).all()
    # Through the first mode alone, by exp(−π z / B) = 0.19 at 1.5 m; a lip and a tip hold some.
    assert 0.19 < kept[-1] < 0.75 < kept[0]


def test_upper_surface_keeps_its_pressure(net: FreeJetMap, square: Relief) -> None:
    """To first order the speed there is 1 − ε; the rest is what linearising costs."""
    chi = np.linspace(np.log(net.jet.lip) + 0.3, np.log(net.jet.tip) + 0.5, 40)
    u, w = relieved_velocity(net, square, chi + 1j * pi * (1.0 - 1e-6))
    assert np.hypot(u, w) == pytest.approx(1.0 - square.slowing, abs=0.02)

"""The exact jet over a board, against what mechanics demands of any such flow."""

from __future__ import annotations

from math import cos, log, pi, radians, sin, tan

import numpy as np
import pytest

from tgl_soar.air.freestream import FreeJetMap, advance, slowness, solve_free_jet

HEIGHT, BOARD, AHEAD = 2.85, 2.45, 0.5
CASES = [(15.0, 1.0), (21.3, 1.0), (35.0, 1.0), (23.0, 1.15)]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]:g}deg-k{case[1]:g}")
def net(request: pytest.FixtureRequest) -> FreeJetMap:
    slope_deg, ratio = request.param
    jet = solve_free_jet(radians(slope_deg), HEIGHT, BOARD, AHEAD, ratio)
    return FreeJetMap(jet, upstream_m=6.0, downstream_m=8.0)


def test_walls_and_edges_lie_where_they_should(net: FreeJetMap) -> None:
    jet, along = net.jet, net.chi[:, 0].real
    bottom, top = net.place[:, 0], net.place[:, -1]
    floor = bottom[along < -0.05]
    board = bottom[(along > 0.05) & (along < log(jet.tip) - 0.05)]
    roof = top[along < log(jet.lip) - 0.05]
    # The outermost lines stand 1e-5 of the flow inside: with the corners, under a millimetre.
    assert np.abs(floor.imag).max() < 1e-3
    assert np.abs(board.imag - board.real * tan(jet.slope_rad)).max() < 1e-3
    assert np.abs(roof.imag - HEIGHT).max() < 1e-3
    assert abs(np.interp(log(jet.lip), along, top.real) + AHEAD) < 2e-3
    tip = np.interp(log(jet.tip), along, bottom.real)
    assert tip == pytest.approx(BOARD * cos(jet.slope_rad), abs=2e-3)


def test_free_streamlines_have_the_speed_of_their_pressure(net: FreeJetMap) -> None:
    jet = net.jet
    past = 0.05  # just behind an edge the speed turns within the line's offset
    ahead = np.linspace(past, 6.0, 50).astype(np.complex128)
    upper = slowness(jet, ahead + complex(log(jet.lip), pi * (1 - 1e-9)))
    lower = slowness(jet, ahead + complex(log(jet.tip), pi * 1e-9))
    assert 1.0 / np.abs(upper) == pytest.approx(1.0, abs=1e-5)
    assert 1.0 / np.abs(lower) == pytest.approx(np.exp(jet.log_wake_speed), abs=1e-5)


def test_every_section_carries_the_flow(net: FreeJetMap) -> None:
    for x in (-2.0, -0.5, 0.3, 1.0, 2.0):
        low = np.interp(x, net.place[:, 0].real, net.place[:, 0].imag)
        high = np.interp(x, net.place[:, -1].real, net.place[:, -1].imag)
        z = np.linspace(low + 1e-4, high - 1e-4, 2001)
        u = (1.0 / slowness(net.jet, net.locate(np.full_like(z, x), z))).real
        flow = np.trapezoid(u, z)
        # Trapezoids across the corner at the lip and past the stagnation point at the foot.
        assert flow == pytest.approx(net.jet.flow_m2ps, rel=2e-3)


@pytest.mark.parametrize("slope_deg", [15.0, 23.0, 35.0])
def test_force_on_the_board_is_the_momentum_it_takes(slope_deg: float) -> None:
    """Horizontal momentum: inflow and its pressure = board's push + outflow (density 1)."""
    slope = radians(slope_deg)
    jet = solve_free_jet(slope, HEIGHT, BOARD, AHEAD)
    # On the board t runs from 1 to b; ds = dφ / q and pressure over the room's = (1 − q²) / 2.
    fraction = 0.5 * (np.polynomial.legendre.leggauss(200)[0] + 1.0)
    weight = 0.5 * np.polynomial.legendre.leggauss(200)[1]
    chi = (log(jet.tip) * fraction**2).astype(np.complex128)
    slow = np.abs(slowness(jet, chi + 1e-12j))
    length = slow * jet.flow_m2ps / pi * log(jet.tip) * 2.0 * fraction * weight
    assert length.sum() == pytest.approx(BOARD, rel=1e-4)
    push = float(np.sum(length * 0.5 * (1.0 - 1.0 / slow**2)))
    far = 1.0 / slowness(jet, np.array([25.0 + 0.5j * pi]))[0]
    exit_angle = -np.angle(far)
    inflow = (jet.nozzle_speed**2 + 0.5 * (1.0 - jet.nozzle_speed**2)) * HEIGHT
    assert inflow - push * sin(slope) == pytest.approx(jet.flow_m2ps * cos(exit_angle), rel=1e-4)
    assert 0.0 < exit_angle < slope


def test_places_are_found_back() -> None:
    jet = solve_free_jet(radians(23.0), HEIGHT, BOARD, AHEAD)
    net = FreeJetMap(jet, 6.0, 8.0)
    chi = np.array([-2.0 + 1.0j, 0.4 + 0.3j, 1.5 + 2.8j, 3.0 + 0.1j])
    place = net.place_at(chi)
    assert net.locate(place.real, place.imag) == pytest.approx(chi, abs=1e-8)


def test_integration_does_not_depend_on_the_path() -> None:
    jet = solve_free_jet(radians(23.0), HEIGHT, BOARD, AHEAD)
    a, b, corner = np.array([0.5 + 0.5j]), np.array([0.9 + 0.9j]), np.array([0.9 + 0.5j])
    bent = advance(jet, a, corner) + advance(jet, corner, b)
    assert advance(jet, a, b)[0] == pytest.approx(bent[0], abs=1e-9)


def test_suction_in_the_wake_bends_the_jet_down_and_speeds_its_lower_edge() -> None:
    plain = solve_free_jet(radians(21.3), HEIGHT, BOARD, AHEAD)
    drawn = solve_free_jet(radians(21.3), HEIGHT, BOARD, AHEAD, 1.15)
    chi = np.array([log(plain.tip) + 3.0 + 0.5j * pi])
    assert np.angle(slowness(drawn, chi))[0] < np.angle(slowness(plain, chi))[0] - radians(5.0)
    assert drawn.nozzle_speed > plain.nozzle_speed

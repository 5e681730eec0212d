"""The equations in the docstring of `relief`, each with fields that solve it exactly."""

from __future__ import annotations

from math import log, pi, radians

import numpy as np
import pytest

from tgl_soar.air import relief
from tgl_soar.air.field import FloatArray
from tgl_soar.air.freestream import FreeJetMap, slowness, solve_free_jet
from tgl_soar.air.relief import (
    Relief,
    _edge_strength,
    _graded,
    _laplace,
    _strip,
    relieve,
    relieved_velocity,
)

AHEAD, HEIGHT, WIDTH = 0.5, 2.85, 2.85
UNEVEN = np.array([0.0, 0.1, 0.25, 0.45, 0.8, 1.0, 1.3])
ACROSS = np.array([0.0, 0.2, 0.3, 0.7, 1.1])


@pytest.fixture(scope="module")
def net() -> FreeJetMap:
    return FreeJetMap(solve_free_jet(radians(23.0), HEIGHT, 2.45, AHEAD), 5.0, 7.0)


@pytest.fixture(scope="module")
def square(net: FreeJetMap) -> Relief:
    return relieve(net, WIDTH)


def cells(lines: FloatArray) -> FloatArray:
    """Width around each line, half-way to its neighbours."""
    edges = np.concatenate([[lines[0]], 0.5 * (lines[1:] + lines[:-1]), [lines[-1]]])
    return np.diff(edges)


def applied(values: FloatArray) -> FloatArray:
    result: FloatArray = (_laplace(UNEVEN, ACROSS) @ values.ravel()).reshape(values.shape)
    return result


# --- Laplace's equation --------------------------------------------------------------------------


def test_what_is_the_same_everywhere_flows_nowhere() -> None:
    assert applied(np.ones((7, 5))) == pytest.approx(0.0, abs=1e-12)


def test_a_slope_flows_in_at_one_border_and_out_at_the_other() -> None:
    """Through each border node goes the slope times the width around it."""
    along = applied(UNEVEN[:, None] * np.ones(5))
    assert along[1:-1] == pytest.approx(0.0, abs=1e-12)
    assert along[0] == pytest.approx(-cells(ACROSS))
    assert along[-1] == pytest.approx(cells(ACROSS))
    across = applied(np.ones(7)[:, None] * ACROSS)
    assert across[:, 1:-1] == pytest.approx(0.0, abs=1e-12)
    assert across[:, 0] == pytest.approx(-cells(UNEVEN))
    assert across[:, -1] == pytest.approx(cells(UNEVEN))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_parabola_bends_by_two_everywhere_on_any_mesh(axis: int) -> None:
    values = (UNEVEN[:, None] ** 2 * np.ones(5)) if axis == 0 else np.ones((7, 1)) * ACROSS**2
    area = cells(UNEVEN)[:, None] * cells(ACROSS)
    inner = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
    assert applied(values)[inner] == pytest.approx(-2.0 * area[inner])


def test_nothing_is_lost_between_neighbours() -> None:
    matrix = _laplace(UNEVEN, ACROSS)
    assert abs(matrix - matrix.T).max() == 0.0
    assert abs(matrix.sum(axis=0)).max() == pytest.approx(0.0, abs=1e-12)


# --- the mesh ------------------------------------------------------------------------------------


def test_lines_go_through_the_corners_and_are_dense_near_them() -> None:
    low, high, corners = -5.0, 4.0, [-1.3, 0.0, 1.2]
    lines = _graded(low, high, corners)
    assert (lines[0], lines[-1]) == (low, high)
    assert (np.diff(lines) > 0.0).all()
    for corner in corners:
        assert np.abs(lines - corner).min() < 1e-12
    step, middle = np.diff(lines), 0.5 * (lines[1:] + lines[:-1])
    away = np.min([np.abs(middle - corner) for corner in corners], axis=0)
    # A hundredth at a corner, 0.15 more for each unit away, 0.12 at most; whole cells are less.
    wanted = np.minimum(0.12, 0.01 + 0.15 * away)
    assert (step < 1.1 * wanted).all()
    assert (step > 0.8 * wanted).all()


def test_a_short_piece_has_two_cells() -> None:
    assert len(_graded(0.0, 0.004, [0.0])) == 3


# --- the strip -----------------------------------------------------------------------------------


def test_edges_are_where_the_free_streamlines_begin(net: FreeJetMap) -> None:
    strip = _strip(net)
    assert strip.along[strip.lip] == pytest.approx(log(net.jet.lip))
    assert strip.along[strip.tip] == pytest.approx(log(net.jet.tip))
    assert (strip.along[0], strip.along[-1]) == (net.chi[0, 0].real, net.chi[-1, 0].real)
    assert (strip.across[0], strip.across[-1]) == (0.0, pi)
    assert strip.flow_per_chi == pytest.approx(net.jet.flow_m2ps / pi)


def test_weights_are_the_area_of_the_jet_past_the_lip(net: FreeJetMap) -> None:
    """By the shoelace formula, of the outermost lines and the last section of the net."""
    lower, upper = net.place[:, 0], net.place[:, -1]
    border = np.concatenate([lower, net.place[-1], upper[::-1], net.place[0][::-1]])
    whole = 0.5 * float(np.sum(border.real * np.roll(border.imag, -1)
                               - np.roll(border.real, -1) * border.imag))  # fmt: skip
    nozzle = HEIGHT * (-AHEAD - float(net.place[0].real.mean()))
    total = float(_strip(net).weight.sum())
    assert total == pytest.approx(abs(whole) - nozzle, rel=0.01)


def test_the_sides_are_held_to_straight_flow_from_the_lip_on(net: FreeJetMap) -> None:
    """S = (1 − ε)(x + d) − (φ − φ at the lip's plane, as high): nothing before it."""
    strip = _strip(net)
    place = net.place_at(strip.along[:, None] + 1j * np.clip(strip.across, *net.BAND)[None, :])
    past = place.real + AHEAD
    assert (strip.side[past < 0.0] == 0.0).all()
    assert (strip.side_slowing[past < 0.0] == 0.0).all()
    assert strip.side_slowing[past > 0.0] == pytest.approx(-past[past > 0.0])
    # φ is the way along a level line, ∫ u dx: from the lip's plane to some places of one height.
    for height in (1.2, 2.0):
        for x in (0.2, 1.0):
            way = np.linspace(-AHEAD, x, 400)
            u = (1.0 / slowness(net.jet, net.locate(way, np.full_like(way, height)))).real
            phi = float(np.trapezoid(u, way))
            chi = complex(net.locate(np.array([x]), np.array([height]))[0])
            row = [float(np.interp(chi.imag, strip.across, line)) for line in strip.side]
            side = float(np.interp(chi.real, strip.along, row))
            assert side == pytest.approx((x + AHEAD) - phi, abs=0.01)


# --- the answer ----------------------------------------------------------------------------------


def test_no_speed_is_infinite_at_lip_and_tip(net: FreeJetMap, square: Relief) -> None:
    strip = _strip(net)
    for line, edge in ((square.potential[:, -1], strip.lip), (square.potential[:, 0], strip.tip)):
        assert _edge_strength(square.chi_along, line, edge) == pytest.approx(0.0, abs=1e-9)


def test_on_the_free_surfaces_the_potential_is_that_of_the_slower_speed(
    net: FreeJetMap, square: Relief
) -> None:
    """h = −ε (φ − φ at the lip), and C − ε (φ − φ at the tip); six modes make 1 to 0.5 %."""
    strip = _strip(net)
    upper, lower = square.potential[strip.lip :, -1], square.potential[strip.tip :, 0]
    phi = strip.flow_per_chi * strip.along
    assert upper == pytest.approx(-square.slowing * (phi[strip.lip :] - phi[strip.lip]), rel=0.01)
    assert lower == pytest.approx(
        square.jump - square.slowing * (phi[strip.tip :] - phi[strip.tip]), rel=0.01
    )
    assert square.slowing > 0.0  # of the jet that escapes
    assert np.array_equal(square.chi_along, strip.along)
    assert np.array_equal(square.chi_across, strip.across)


def test_one_mode_solves_its_equation(net: FreeJetMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """h_xx + h_zz = k² (h − c S) with k = π / B and c = 4 / π; the last mode counts half."""
    monkeypatch.setattr(relief, "MODES", 1)
    one, strip = relieve(net, WIDTH), _strip(net)
    mode = 2.0 * one.potential
    side = strip.side + one.slowing * strip.side_slowing
    pull = (pi / WIDTH) ** 2 * strip.weight * (mode - 4.0 / pi * side)
    left = (_laplace(strip.along, strip.across) @ mode.ravel()).reshape(mode.shape) + pull
    left[strip.lip :, -1] = 0.0  # held
    left[strip.tip :, 0] = 0.0
    assert np.abs(left).max() < 1e-9
    assert np.abs(pull).max() > 1e-4


def test_modes_alternate_with_falling_weights(
    net: FreeJetMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the upper surface: 4/π (1 − 1/3 + … ) of −ε φ, the last half."""
    strip = _strip(net)
    phi = strip.flow_per_chi * (strip.along[strip.lip :] - strip.along[strip.lip])
    for modes, total in ((1, 0.5), (2, 1.0 - 0.5 / 3.0), (3, 1.0 - 1.0 / 3.0 + 0.5 / 5.0)):
        monkeypatch.setattr(relief, "MODES", modes)
        found = relieve(net, WIDTH)
        expected = -found.slowing * 4.0 / pi * total * phi
        assert found.potential[strip.lip :, -1] == pytest.approx(expected)


@pytest.mark.parametrize("strength", [0.0, 0.7, -1.3])
def test_the_strength_of_an_edge_is_the_factor_of_the_root(strength: float) -> None:
    along = np.linspace(-2.0, 0.5, 500)
    edge = 400
    r = np.maximum(0.0, along[edge] - along)
    line = 4.0 + strength * np.sqrt(r) + 3.0 * r - 5.0 * r**1.5
    assert _edge_strength(along, line, edge) == pytest.approx(strength, abs=1e-9)
    # What lies nearer than a fiftieth, further than 0.3, or behind does not count.
    spoilt = np.where((r < 0.02) | (r > 0.3), 99.0, line)
    spoilt[edge] = line[edge]
    assert _edge_strength(along, spoilt, edge) == pytest.approx(strength, abs=1e-9)
    for at in (0.022, 0.29):
        touched = line.copy()
        touched[int(np.argmin(np.abs(r - at) + 9.0 * (r == 0.0)))] += 1.0
        assert abs(_edge_strength(along, touched, edge) - strength) > 1e-3


# --- velocities ----------------------------------------------------------------------------------

CHI = np.array([[-1.0 + 0.5j, 0.3 + 1.0j], [0.8 + 2.0j, 1.5 + 0.7j]])


def made(net: FreeJetMap, along: float, across: float) -> Relief:
    """h = along φ + across ψ."""
    lines, levels = np.linspace(-3.0, 3.0, 12), np.linspace(0.0, pi, 9)
    unit = net.jet.flow_m2ps / pi
    return Relief(
        chi_along=lines,
        chi_across=levels,
        potential=unit * (along * lines[:, None] + across * levels[None, :]),
        slowing=0.0,
        jump=0.0,
    )


def test_a_correction_by_the_potential_itself_speeds_the_flow_up(net: FreeJetMap) -> None:
    u, w = relieved_velocity(net, None, CHI)
    faster = relieved_velocity(net, made(net, 0.1, 0.0), CHI)
    assert faster[0] == pytest.approx(1.1 * u)
    assert faster[1] == pytest.approx(1.1 * w)


def test_a_correction_by_the_stream_function_is_across_the_flow(net: FreeJetMap) -> None:
    """∇ψ = (−w, u), as u = ∂ψ/∂z and w = −∂ψ/∂x."""
    u, w = relieved_velocity(net, None, CHI)
    turned = relieved_velocity(net, made(net, 0.0, 0.2), CHI)
    assert turned[0] == pytest.approx(u - 0.2 * w)
    assert turned[1] == pytest.approx(w + 0.2 * u)
    assert (w > 0.0).any()

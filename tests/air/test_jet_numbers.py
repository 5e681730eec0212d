"""The board in its jet: mixing edges and solid nodes alone, and the limits of what it describes."""

from __future__ import annotations

from math import cos, inf, nan, pi, radians, sqrt, tan

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.freestream import ComplexArray
from tgl_soar.air.grid import bake
from tgl_soar.air.jet import JetShape, SlopeJet, _check, _mix, _slipping, _streamline, unit_jet

SLOPE = radians(23.0)
HEIGHT, BOARD, AHEAD = 2.85, 2.45, 0.5
USUAL = JetShape(slope_rad=SLOPE)


@pytest.fixture(scope="module")
def field() -> SlopeJet:
    return SlopeJet(9.0, SLOPE)


# --- the limits ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"slope_rad": radians(14.99)}, "15 to 35 degrees"),
        ({"slope_rad": radians(35.01)}, "15 to 35 degrees"),
        ({"slope_rad": nan}, "15 to 35 degrees"),
        ({"wake_speed_ratio": 0.999}, "wake_speed_ratio 0.999"),
        ({"wake_speed_ratio": 1.501}, "wake_speed_ratio 1.501"),
        ({"jet_width_m": 1.42}, r"at least half the nozzle height \(1\.425 m\)"),
        *(
            ({name: value}, f"{name} {value} m: must be positive")
            for name in ("board_length_m", "nozzle_height_m", "lip_ahead_m")
            for value in (0.0, -1.0, inf, nan)
        ),
    ],
)
def test_a_shape_beyond_its_limits_is_refused(change: dict[str, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        _check(USUAL._replace(**change))


@pytest.mark.parametrize(
    "change",
    [
        {"slope_rad": radians(15.0)},
        {"slope_rad": radians(35.0)},
        {"wake_speed_ratio": 1.0},
        {"wake_speed_ratio": 1.5},
        {"jet_width_m": 1.425},
        {"jet_width_m": inf},
    ],
)
def test_a_shape_at_its_limits_is_one(change: dict[str, float]) -> None:
    _check(USUAL._replace(**change))


@pytest.mark.parametrize(
    ("wind", "allowed"), [(4.99, False), (5, True), (15, True), (15.01, False)]
)
def test_a_wind_is_that_of_a_tunnel(wind: float, allowed: bool, field: SlopeJet) -> None:
    if allowed:
        assert SlopeJet(wind, SLOPE).reference_wind_mps == wind
    else:
        with pytest.raises(ValueError, match="5 to 15 m/s"):
            SlopeJet(wind, SLOPE)
    assert field.reference_wind_mps == 9.0


def test_what_is_left_out_is_the_usual_tunnel() -> None:
    """A square nozzle, with the board half a metre past its lip and a vented wake."""
    assert USUAL[1:] == (BOARD, HEIGHT, HEIGHT, AHEAD, 1.0)
    assert SlopeJet(9.0, SLOPE).shape == USUAL


# --- where it is known ---------------------------------------------------------------------------


def test_the_grid_has_the_cells_and_the_reach_that_it_says(field: SlopeJet) -> None:
    table = field.jet.table
    cell = HEIGHT / 114.0
    assert cell == pytest.approx(0.025)
    assert (table.dx_m, table.dz_m) == pytest.approx((cell, cell))
    assert table.x0_m == pytest.approx(-(AHEAD + 0.5 * HEIGHT), abs=0.51 * cell)
    x_end = table.x0_m + (table.nx - 1) * cell
    assert x_end == pytest.approx(BOARD * cos(SLOPE) + 0.9 * HEIGHT, abs=0.51 * cell)
    assert table.z0_m == 0.0
    assert (table.nz - 1) * cell == pytest.approx(1.9 * HEIGHT, abs=0.51 * cell)


def test_inside_is_air_of_the_grid_within_the_width(field: SlopeJet) -> None:
    table, tip = field.jet.table, BOARD * cos(SLOPE)
    x_end = table.x0_m + (table.nx - 1) * table.dx_m
    z_end = (table.nz - 1) * table.dz_m
    off = 1e-6
    for place, inside in (
        ((table.x0_m + off, 0.0, 1.0), True),
        ((table.x0_m - off, 0.0, 1.0), False),
        ((x_end - off, 0.0, 1.0), True),
        ((x_end + off, 0.0, 1.0), False),
        ((-1.0, 0.0, 0.0), True),
        ((-1.0, 0.0, -off), False),
        ((1.0, 0.0, z_end - off), True),
        ((1.0, 0.0, z_end + off), False),
        ((1.0, 0.5 * HEIGHT, 1.0), True),
        ((1.0, 0.5 * HEIGHT + off, 1.0), False),
        ((1.0, -0.5 * HEIGHT - off, 1.0), False),
        ((tip, 0.0, tip * tan(SLOPE) + off), True),
        ((tip, 0.0, tip * tan(SLOPE) - off), False),
        ((tip + off, 0.0, 0.0), True),
        ((off, 0.0, 0.0), False),
    ):
        assert field.inside(*place) is inside, place


@pytest.mark.parametrize(("x", "height"), [(-1.0, 0.0), (0.0, 0.0), (1.0, tan(SLOPE)), (2.3, 0.0)])
def test_the_solid_is_the_board_and_the_floor(field: SlopeJet, x: float, height: float) -> None:
    assert field.board_height_m(x) == pytest.approx(height)
    for z, moves in ((height + 0.1, True), (height - 0.1, False)):
        u, v, w = field.wind_at(x, 0.0, z, 0.0)
        assert (u != 0.0) is moves
        assert [float(part) for part in field.wind(x, 0.0, z)] == pytest.approx((u, v, w))


def test_another_wind_at_the_nodes_takes_the_place_of_the_jets(field: SlopeJet) -> None:
    table = unit_jet(USUAL)
    uniform = np.tile([1.0, -0.25], (table.nx, table.nz, 1))
    other = field.with_unit_wind(uniform)
    assert other.wind_at(0.5, 0.0, 2.0, 0.0) == pytest.approx((9.0, 0.0, -2.25))
    assert other.wind_at(1.0, 0.0, 0.1, 0.0) == (0.0, 0.0, 0.0)  # the board stays
    assert field.wind_at(0.5, 0.0, 2.0, 0.0)[2] > 0.0


# --- solid nodes ---------------------------------------------------------------------------------


def test_nodes_just_below_the_surface_have_the_speed_above_and_deeper_ones_none() -> None:
    board = np.zeros((6, 8), dtype=bool)
    board[:, :4] = True  # four rows of nodes are solid
    speed = np.arange(48.0).reshape(6, 8)
    slipping = _slipping(speed, board)
    assert np.array_equal(slipping[:, 4:], speed[:, 4:])
    assert np.array_equal(slipping[:, 3], speed[:, 4])  # one cell deep
    assert (slipping[:, :3] == 0.0).all()


def test_a_node_behind_a_corner_takes_the_diagonal_neighbour() -> None:
    board = np.ones((4, 4), dtype=bool)
    board[0, 0] = False
    speed = np.full((4, 4), 3.0)
    distance = np.hypot.outer(np.arange(4.0), np.arange(4.0))
    assert np.array_equal(_slipping(speed, board) != 0.0, distance < 2.0)


# --- free edges ----------------------------------------------------------------------------------


def test_a_streamline_of_a_uniform_wind_is_straight_and_of_steps_of_a_cell() -> None:
    wind = bake(0.0, 0.0, 0.1, np.full((31, 31), 3.0), np.full((31, 31), 4.0))
    places = _streamline(wind, complex(0.2, 0.5), 1.0)
    assert np.abs(np.diff(places)) == pytest.approx(0.1)
    assert np.angle(np.diff(places)) == pytest.approx(np.arctan2(4.0, 3.0))
    assert places[0] == complex(0.2, 0.5)
    assert 1.0 <= places[-1].real < 1.0 + 0.1


def test_a_streamline_of_a_vortex_stays_on_its_circle() -> None:
    """By the middle of each step: of the third order, 0.05³ / 24 of the way each."""
    x = np.linspace(-2.0, 2.0, 81)
    xx, zz = np.meshgrid(x, x, indexing="ij")
    places = _streamline(bake(-2.0, -2.0, 0.05, zz, -xx), complex(-1.0, 0.05), 0.9)
    assert np.abs(places) == pytest.approx(abs(places[0]), abs=2e-3)
    assert len(places) > 2.0 / 0.05  # over the top, and not through the middle


def line(start: complex = 0j, turn: complex = 1.0 + 0j) -> ComplexArray:
    """Three metres long, level unless it is turned."""
    return (start + turn * np.linspace(0.0, 3.0, 301)).astype(np.complex128)


def section(inward: float, *, speed: float = 2.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n inwards, u, w) a metre past the beginning of a level edge, of air that moves on both
    sides."""
    edge = line()
    z = np.linspace(-0.6, 0.6, 2401)[None, :]
    x = np.full_like(z, 1.0)
    u, w = np.full_like(z, speed), np.zeros_like(z)
    mixed = _mix(u, w, x, z, edge, inward)
    return inward * z[0], mixed[0][0], mixed[1][0]


@pytest.mark.parametrize("inward", [1.0, -1.0])
def test_mixing_keeps_the_momentum_and_draws_air_in(inward: float) -> None:
    n, u, w = section(inward)
    fraction = u / 2.0
    assert fraction[n > 0.4] == pytest.approx(1.0, abs=1e-6)
    assert fraction[n < -0.4] == pytest.approx(0.0, abs=1e-6)
    order = np.argsort(n)
    kept = np.trapezoid((fraction**2 - (n > 0.0))[order], n[order])
    assert kept == pytest.approx(0.0, abs=5e-4)
    # What flows more than before along the edge has come in through it: m / σ of its length.
    gained = np.trapezoid((fraction - (n > 0.0))[order], n[order])
    shift = 1.0 / sqrt(2.0 * pi)
    assert gained == pytest.approx(shift / 11.0, rel=0.01)
    assert inward * w[n < -0.4] / 2.0 == pytest.approx(shift / 11.0, rel=1e-6)
    assert w[n > 0.4] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("inward", [1.0, -1.0])
def test_the_edge_spreads_in_proportion_to_its_length(inward: float) -> None:
    edge = line()
    z = np.linspace(-1.0, 1.0, 4001)
    widths = []
    for x in (0.5, 1.0, 2.0):
        u, _ = _mix(np.ones((1, 4001)), np.zeros((1, 4001)), np.full((1, 4001), x), z[None, :],
                    edge, inward)  # fmt: skip
        inside = (u[0] > 0.1) & (u[0] < 0.9)
        widths.append(float(np.ptp(z[inside])))
    assert widths[1] == pytest.approx(2.0 * widths[0], rel=0.01)
    assert widths[2] == pytest.approx(2.0 * widths[1], rel=0.01)


def test_ahead_of_its_beginning_an_edge_mixes_nothing_but_behind_the_board_all_is_past_it() -> None:
    edge = line(0.5j)
    x, z = np.array([[-0.3, -0.3, 0.1]]), np.array([[0.2, 0.8, 0.1]])
    u, w = np.ones((1, 3)), np.zeros((1, 3))
    above = _mix(u, w, x, z, edge, 1.0)
    assert above[0][0, :2] == pytest.approx(1.0)
    assert above[1][0, :2] == pytest.approx(0.0)
    assert above[0][0, 2] < 0.01  # 0.4 m under the tip
    below = _mix(u, w, x, z, edge, -1.0)
    assert below[0][0] == pytest.approx(1.0, abs=1e-6)


def test_an_edge_that_rises_draws_air_in_across_itself() -> None:
    turn = np.exp(0.4j)
    edge = line(turn=turn)
    outside = (1.0 + 0.5j) * turn  # half a metre to its left, a metre on its way
    u, w = np.array([[turn.real]]), np.array([[turn.imag]])
    mixed = _mix(u, w, np.array([[outside.real]]), np.array([[outside.imag]]), edge, -1.0)
    drawn = (mixed[0][0, 0] + 1j * mixed[1][0, 0]) / turn
    assert drawn.imag == pytest.approx(-1.0 / sqrt(2.0 * pi) / 11.0, rel=1e-3)
    assert drawn.real == pytest.approx(0.0, abs=1e-4)

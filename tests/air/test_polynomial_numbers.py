"""Polynomials number by number: coefficients and powers, floors, fits and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan

import numpy as np
import pytest
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.air.polynomial import (
    Floor,
    Polynomial,
    PolynomialError,
    PolynomialField,
    coefficient_count,
    fit_polynomial,
    floor_height_m,
    in_box,
    lowest_floor,
    polynomial_wind,
)

# x from 2 to 8, z from -1 to 3.
BOX = Polynomial(
    centre_x_m=5.0,
    centre_z_m=1.0,
    half_x_m=3.0,
    half_z_m=2.0,
    degree=2,
    u_mps=[0.0] * 6,
    w_mps=[0.0] * 6,
)
POWERS = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (2, 0)]  # of ξ and ζ, in their order


@pytest.mark.parametrize("k", range(6))
def test_a_coefficient_is_that_of_one_power(k: int) -> None:
    one = [float(n == k) for n in range(6)]
    i, j = POWERS[k]
    field = PolynomialField(
        BOX._replace(u_mps=one, w_mps=[-2.0 * a for a in one]), reference_wind_mps=8.0
    )
    for x, z in ((5.0, 1.0), (6.5, 2.0), (2.0, 3.0), (7.1, -0.3)):
        power = ((x - 5.0) / 3.0) ** i * ((z - 1.0) / 2.0) ** j
        assert polynomial_wind(field.polynomial, x, z) == pytest.approx((power, -2.0 * power))
        assert field.wind_at(x, 0.0, z, 0.0) == pytest.approx((power, 0.0, -2.0 * power))
        assert [float(p) for p in field.wind(x, 0.0, z)] == pytest.approx((power, 0, -2.0 * power))


@pytest.mark.parametrize(
    ("beyond", "edge"),
    [((1.0, 1.0), (2.0, 1.0)), ((9.0, 0.0), (8.0, 0.0)), ((5.0, 9.0), (5.0, 3.0)),
     ((5.0, -9.0), (5.0, -1.0)), ((99.0, 99.0), (8.0, 3.0))],
)  # fmt: skip
def test_beyond_each_edge_is_what_the_edge_has(
    beyond: tuple[float, float], edge: tuple[float, float]
) -> None:
    every = [0.3, -0.2, 0.5, 1.1, 0.7, -0.4]
    field = PolynomialField(BOX._replace(u_mps=every, w_mps=every), reference_wind_mps=8.0)
    assert field.wind_at(beyond[0], 0.0, beyond[1], 0.0) == field.wind_at(
        edge[0], 0.0, edge[1], 0.0
    )
    assert not field.inside(beyond[0], 0.0, beyond[1])
    assert field.inside(edge[0], 0.0, edge[1])
    many = field.wind([beyond[0], edge[0]], 0.0, [beyond[1], edge[1]])
    assert all(part[0] == part[1] for part in many)


def test_a_box_has_its_edges() -> None:
    for x, z in ((2.0, 1.0), (8.0, 1.0), (5.0, -1.0), (5.0, 3.0)):
        assert in_box(BOX, x, z)
        assert not in_box(BOX, 5.0 + 1.001 * (x - 5.0), 1.0 + 1.001 * (z - 1.0))


def test_powers_of_two_variables_are_counted() -> None:
    for degree in range(6):
        powers = [(i, j) for i in range(9) for j in range(9) if i + j <= degree]
        assert coefficient_count(degree) == len(powers)


# --- floors --------------------------------------------------------------------------------------

HILL: Floor = ((0.0, 1.0), (2.0, 3.0), (3.0, -1.0))


@pytest.mark.parametrize(
    ("x", "height"),
    [(-5.0, 1.0), (0.0, 1.0), (0.5, 1.5), (2.0, 3.0), (2.25, 2.0), (3.0, -1.0), (9.0, -1.0)],
)
def test_a_floor_goes_straight_from_corner_to_corner_and_level_beyond(
    x: float, height: float
) -> None:
    xs, zs = [corner[0] for corner in HILL], [corner[1] for corner in HILL]
    assert floor_height_m(xs, zs, x) == pytest.approx(height)
    field = PolynomialField(
        BOX._replace(centre_x_m=2.0, half_x_m=9.0, half_z_m=9.0), reference_wind_mps=8.0, floor=HILL
    )
    assert field.inside(x, 0.0, height + 1e-6)
    assert not field.inside(x, 0.0, height - 1e-6)


def test_without_corners_there_is_no_floor() -> None:
    assert floor_height_m([], [], 0.0) == -inf


class Known:
    """Wind of 8 m/s, and updraft that grows with height and time; known where it is asked."""

    reference_wind_mps = 8.0

    def __init__(self, known: Callable[[float, float], bool] = lambda _x, _z: True) -> None:
        self._known = known

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y, z = broadcast(x_m, y_m, z_m)
        return 8.0 + 0.0 * x, 0.0 * y, 0.5 * z + 2.0 * time_s

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        u, v, w = self.wind(x_m, y_m, z_m, time_s)
        return float(u), float(v), float(w)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        return y_m == 0.0 and self._known(x_m, z_m)


def test_the_lowest_floor_is_under_the_topmost_air_that_has_no_gap() -> None:
    """Over a hill; with a gap at 1.5 m in one column, and with no air at all in another."""

    def known(x: float, z: float) -> bool:
        if x == 2.0:
            return False
        return z >= 0.5 * x - 1e-9 and (x, z) != (1.0, 1.5) and z < 2.4

    floor = lowest_floor(Known(known), (0.0, 3.0, 0.0, 3.0), 0.5)
    assert floor == (
        (0.0, 0.0), (0.5, 0.5), (1.0, 2.0), (1.5, 1.0), (2.5, 1.5), (3.0, 1.5)
    )  # fmt: skip
    with pytest.raises(PolynomialError, match="nowhere known"):
        lowest_floor(Known(lambda _x, _z: False), (0.0, 3.0, 0.0, 3.0), 0.5)


def test_columns_and_heights_are_five_centimetres_apart_by_default() -> None:
    floor = lowest_floor(Known(lambda _x, z: z > 0.12), (0.0, 1.0, 0.0, 0.3))
    assert np.diff([x for x, _ in floor]) == pytest.approx(0.05)
    assert [z for _, z in floor] == pytest.approx([0.15] * 21)
    coarse = lowest_floor(Known(), (0.0, 1.0, 0.0, 1.0), 5.0)  # both ends at least
    assert coarse == ((0.0, 0.0), (1.0, 0.0))
    above = lowest_floor(Known(lambda _x, z: z > 0.4), (0.0, 1.0, 0.0, 1.0), 5.0)  # and no more
    assert above == ((0.0, 1.0), (1.0, 1.0))


# --- fits ----------------------------------------------------------------------------------------


def test_a_fit_takes_places_that_are_air_and_above_the_floor_on_a_grid_of_the_step() -> None:
    region = (0.0, 2.0, 0.0, 1.0)
    for step, across, up in ((0.05, 41, 21), (0.1, 21, 11), (0.25, 9, 5)):
        _, misfit = fit_polynomial(Known(), region, 1, step_m=step)
        assert misfit.places == across * up
    assert fit_polynomial(Known(), region, 1)[1].places == 41 * 21
    _, above = fit_polynomial(Known(), region, 1, step_m=0.25, floor=((0.0, 0.5), (2.0, 0.5)))
    assert above.places == 9 * 3  # the floor itself is one
    _, half = fit_polynomial(Known(lambda x, _z: x <= 1.0), region, 1, step_m=0.25)
    assert half.places == 5 * 5


def test_a_fit_is_made_at_a_time_of_which_zero_is_usual() -> None:
    region = (-1.0, 3.0, 0.0, 2.0)
    for time_s in (0.0, 1.5):
        field, misfit = fit_polynomial(Known(), region, 2, time_s=time_s)
        assert field.wind_at(1.0, 0.0, 1.5, 99.0) == pytest.approx((8.0, 0, 0.75 + 2.0 * time_s))
        assert field.misfit is misfit
        box = field.polynomial
        assert (box.centre_x_m, box.half_x_m, box.centre_z_m, box.half_z_m) == (1.0, 2.0, 1.0, 1.0)
    default, _ = fit_polynomial(Known(), region, 2)
    assert default.wind_at(1.0, 0.0, 1.5, 0.0)[2] == pytest.approx(0.75)


@pytest.mark.parametrize(("step_m", "enough"), [(0.1, True), (0.12, False)])
def test_a_fit_needs_four_places_for_each_coefficient(step_m: float, enough: bool) -> None:
    """Three coefficients and a strip of one cell: twice so many places as across, of 12."""
    region = (0.0, 0.5, 0.0, 0.01)
    if enough:
        assert fit_polynomial(Known(), region, 1, step_m=step_m)[1].places == 12
    else:
        with pytest.raises(PolynomialError, match="degree 1: 3 coefficients for 10 places"):
            fit_polynomial(Known(), region, 1, step_m=step_m)


@pytest.mark.parametrize(("degree", "allowed"), [(0, False), (1, True), (12, True), (13, False)])
def test_a_degree_is_1_to_12(degree: int, allowed: bool) -> None:
    region = (0.0, 2.0, 0.0, 2.0)
    if allowed:
        assert fit_polynomial(Known(), region, degree, step_m=0.1)[0].polynomial.degree == degree
    else:
        with pytest.raises(PolynomialError, match=f"degree {degree}: must be 1 to 12"):
            fit_polynomial(Known(), region, degree)


@pytest.mark.parametrize(
    "region",
    [(1.0, 1.0, 0.0, 1.0), (0.0, 1.0, 1.0, 1.0), (0.0, 1.0, 2.0, 1.0), (0.0, inf, 0.0, 1.0),
     (0.0, 1.0, -inf, 1.0)],
)  # fmt: skip
def test_a_region_must_grow_both_ways(region: tuple[float, float, float, float]) -> None:
    with pytest.raises(PolynomialError, match=r"region .* growing"):
        fit_polynomial(Known(), region, 1)


@pytest.mark.parametrize("step_m", [0.0, -0.1, inf, nan])
def test_a_step_must_be_positive(step_m: float) -> None:
    with pytest.raises(PolynomialError, match=f"step {step_m} m: must be positive"):
        fit_polynomial(Known(), (0.0, 1.0, 0.0, 1.0), 1, step_m=step_m)


@pytest.mark.parametrize("wind_mps", [0.0, -8.0, inf, nan])
def test_a_reference_wind_must_be_positive(wind_mps: float) -> None:
    with pytest.raises(PolynomialError, match="reference wind"):
        PolynomialField(BOX, reference_wind_mps=wind_mps)


class Slanting(Known):
    """A wind that grows to the right: in the middle it is 8 m/s."""

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        u, v, w = super().wind(x_m, y_m, z_m, time_s)
        return u + 3.0 * broadcast(x_m, y_m, z_m)[1], v, w


def test_a_fit_is_of_the_plane_in_the_middle() -> None:
    field, _ = fit_polynomial(Slanting(), (0.0, 1.0, 0.0, 1.0), 1)
    assert field.wind_at(0.5, 7.0, 0.5, 0.0) == pytest.approx((8.0, 0.0, 0.25))


class Kinked(Known):
    """An updraft of |x|, which no straight line follows: half of it is left."""

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        u, v, _ = super().wind(x_m, y_m, z_m, time_s)
        x, _, _ = broadcast(x_m, y_m, z_m)
        return u + np.abs(x), v, 2.0 * np.abs(x)


def test_the_misfit_of_a_kink_is_known() -> None:
    """|x| over −1 … 1 by its mean 0.5: 1/√12 is left in the mean square, 0.5 at the most."""
    _, misfit = fit_polynomial(Kinked(), (-1.0, 1.0, 0.0, 1.0), 1, step_m=0.02)
    rms = 12.0**-0.5
    assert misfit.places == 101 * 51
    root, most = (misfit.u_rms_mps, misfit.w_rms_mps), (misfit.u_most_mps, misfit.w_most_mps)
    assert root == pytest.approx((rms, 2.0 * rms), rel=0.03)  # a hundredth is at the ends
    assert most == pytest.approx((0.5, 1.0), rel=0.02)

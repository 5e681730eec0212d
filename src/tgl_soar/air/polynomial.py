"""Wind as a polynomial of position, as the paper writes it: u = f(x, z), w = g(x, z).

    f = Σ a_ij ξ^i ζ^j,   i + j ≤ degree,   ξ = (x − x_c) / h_x,   ζ = (z − z_c) / h_z

ξ and ζ run from −1 to 1 over the region that the polynomial was fitted to, so that its powers stay
apart in 64-bit floats.  Outside that region a polynomial of any degree says nothing: there the
field is not `inside`, and what it answers is its value at the nearest place of the region's box.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, WindField, broadcast

DEGREE_MAX: Final = 12  # beyond it the sums of powers lose more than the fit gains
PLACES_PER_COEFFICIENT: Final = 4  # of a fit: with fewer it follows them instead of the wind

Floor = tuple[tuple[float, float], ...]  # corners x, z [m]
Region = tuple[float, float, float, float]  # x from, x to, z from, z to [m]


class PolynomialError(ValueError):
    """A polynomial cannot be fitted; the message says why."""


class Polynomial(NamedTuple):
    """Two polynomials of one degree over a box."""

    centre_x_m: float
    centre_z_m: float
    half_x_m: float
    half_z_m: float
    degree: int
    # Coefficients a_ij, for each i from 0 those of j from 0 to degree − i: a sequence for plain
    # floats, a numpy array for numba.
    u_mps: Sequence[float] | FloatArray
    w_mps: Sequence[float] | FloatArray


class Misfit(NamedTuple):
    """How far a fit is from the field that it was fitted to, over its places."""

    places: int
    u_rms_mps: float
    w_rms_mps: float
    u_most_mps: float
    w_most_mps: float


def polynomial_wind(polynomial: Polynomial, x_m: float, z_m: float) -> tuple[float, float]:
    """(u, w) [m/s] at one place; beyond the box those of its nearest edge."""
    xi = (x_m - polynomial.centre_x_m) / polynomial.half_x_m
    zeta = (z_m - polynomial.centre_z_m) / polynomial.half_z_m
    xi, zeta = min(1.0, max(-1.0, xi)), min(1.0, max(-1.0, zeta))
    degree = polynomial.degree
    end = coefficient_count(degree)
    u, w = 0.0, 0.0
    for i in range(degree, -1, -1):  # Horner's rule, twice
        first = end - (degree - i + 1)
        row_u, row_w = 0.0, 0.0
        for k in range(end - 1, first - 1, -1):
            row_u = row_u * zeta + polynomial.u_mps[k]
            row_w = row_w * zeta + polynomial.w_mps[k]
        u, w = u * xi + row_u, w * xi + row_w
        end = first
    return u, w


def coefficient_count(degree: int) -> int:
    """Of a polynomial in two variables."""
    return (degree + 1) * (degree + 2) // 2


def floor_height_m(
    floor_x_m: Sequence[float] | FloatArray, floor_z_m: Sequence[float] | FloatArray, x_m: float
) -> float:
    """Height [m] of a floor of corners, level beyond its ends; −inf without any."""
    count = len(floor_x_m)
    if count == 0:
        return -inf
    if x_m <= floor_x_m[0]:
        return float(floor_z_m[0])
    for i in range(1, count):
        if x_m <= floor_x_m[i]:
            along = (x_m - floor_x_m[i - 1]) / (floor_x_m[i] - floor_x_m[i - 1])
            return float(floor_z_m[i - 1] + along * (floor_z_m[i] - floor_z_m[i - 1]))
    return float(floor_z_m[count - 1])


def in_box(polynomial: Polynomial, x_m: float, z_m: float) -> bool:
    """Whether a place lies in the box that the polynomial was fitted to."""
    return (
        abs(x_m - polynomial.centre_x_m) <= polynomial.half_x_m
        and abs(z_m - polynomial.centre_z_m) <= polynomial.half_z_m
    )


class PolynomialField:
    """A steady wind field of two polynomials, above a floor.

    polynomial: of u and w; the wind across is zero.  floor: corners (x, z) [m] of the ground from
    upstream to downstream, level beyond its ends; empty: the box's lower edge.  misfit: how far it
    is from the field that it was fitted to; None: it was fitted to none.
    """

    def __init__(
        self,
        polynomial: Polynomial,
        *,
        reference_wind_mps: float,
        floor: Floor = (),
        misfit: Misfit | None = None,
    ) -> None:
        if not (isfinite(reference_wind_mps) and reference_wind_mps > 0.0):
            raise PolynomialError(f"reference wind {reference_wind_mps} m/s must be positive")
        self.polynomial, self.floor, self.misfit = polynomial, floor, misfit
        self._plain = polynomial._replace(
            u_mps=np.asarray(polynomial.u_mps).tolist(), w_mps=np.asarray(polynomial.w_mps).tolist()
        )
        self._floor_x_m, self._floor_z_m = [x for x, _ in floor], [z for _, z in floor]
        self._reference_mps = float(reference_wind_mps)

    @property
    def reference_wind_mps(self) -> float:
        """The wind that names the field [m/s]."""
        return self._reference_mps

    def wind_at(
        self,
        x_m: float,
        y_m: float,  # noqa: ARG002 - the same at every y
        z_m: float,
        time_s: float,  # noqa: ARG002 - steady
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place."""
        u, w = polynomial_wind(self._plain, x_m, z_m)
        return u, 0.0, w

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002 - steady
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        x, _, z = broadcast(x_m, y_m, z_m)
        powers = _powers(self.polynomial, x.ravel(), z.ravel())
        u = (powers @ self.polynomial.u_mps).reshape(x.shape)
        w = (powers @ self.polynomial.w_mps).reshape(x.shape)
        return u, np.zeros(x.shape), w

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """Within the box, and above the floor."""
        floor_m = floor_height_m(self._floor_x_m, self._floor_z_m, x_m)
        return in_box(self._plain, x_m, z_m) and z_m >= floor_m


def fit_polynomial(
    field: WindField,
    region: Region,
    degree: int,
    *,
    step_m: float = 0.05,
    floor: Floor = (),
    time_s: float = 0.0,
) -> tuple[PolynomialField, Misfit]:
    """The polynomial next to a field in the sense of least squares, and how far it is from it.

    region: the box that is fitted over, in the plane y = 0, at places `step_m` [m] apart at which
    the field is `inside` and above the floor.
    Errors: `PolynomialError` for a degree, a region or a step that gives no such fit.
    """
    if not 1 <= degree <= DEGREE_MAX:
        raise PolynomialError(f"degree {degree}: must be 1 to {DEGREE_MAX}")
    x_from, x_to, z_from, z_to = region
    if not (x_from < x_to and z_from < z_to and all(map(isfinite, region))):
        raise PolynomialError(f"region {region}: must be x from, x to, z from, z to, growing")
    if not (isfinite(step_m) and step_m > 0.0):
        raise PolynomialError(f"step {step_m} m: must be positive")
    empty = np.zeros(coefficient_count(degree))
    polynomial = Polynomial(
        centre_x_m=0.5 * (x_from + x_to),
        centre_z_m=0.5 * (z_from + z_to),
        half_x_m=0.5 * (x_to - x_from),
        half_z_m=0.5 * (z_to - z_from),
        degree=degree,
        u_mps=empty,
        w_mps=empty,
    )
    nodes = [
        (float(x), float(z))
        for x in np.linspace(x_from, x_to, 1 + max(1, round((x_to - x_from) / step_m)))
        for z in np.linspace(z_from, z_to, 1 + max(1, round((z_to - z_from) / step_m)))
    ]
    corners_x, corners_z = [x for x, _ in floor], [z for _, z in floor]
    places = np.array(
        [
            (x, z)
            for x, z in nodes
            if field.inside(x, 0.0, z) and z >= floor_height_m(corners_x, corners_z, x)
        ]
    ).reshape(-1, 2)
    if len(places) < PLACES_PER_COEFFICIENT * len(empty):
        raise PolynomialError(
            f"degree {degree}: {len(empty)} coefficients for {len(places)} places of the field;"
            f" at least {PLACES_PER_COEFFICIENT} each are needed: a smaller degree, a finer step"
        )
    x, z = places[:, 0], places[:, 1]
    u, _, w = field.wind(x, 0.0, z, time_s)
    powers = _powers(polynomial, x, z)
    coefficients, *_ = np.linalg.lstsq(powers, np.column_stack([u, w]), rcond=None)
    left = np.abs(powers @ coefficients - np.column_stack([u, w]))
    fitted = polynomial._replace(
        u_mps=np.ascontiguousarray(coefficients[:, 0]),
        w_mps=np.ascontiguousarray(coefficients[:, 1]),
    )
    rms = np.sqrt((left**2).mean(axis=0))
    misfit = Misfit(
        places=len(places),
        u_rms_mps=float(rms[0]),
        w_rms_mps=float(rms[1]),
        u_most_mps=float(left[:, 0].max()),
        w_most_mps=float(left[:, 1].max()),
    )
    field_of_it = PolynomialField(
        fitted, reference_wind_mps=field.reference_wind_mps, floor=floor, misfit=misfit
    )
    return field_of_it, misfit


def lowest_floor(field: WindField, region: Region, step_m: float = 0.05) -> Floor:
    """The floor above which a field is `inside` all the way up to its highest such place.

    For a field whose ground nobody gives; in columns and to heights `step_m` [m] apart.
    Errors: `PolynomialError` where the field is nowhere `inside` the region.
    """
    x_from, x_to, z_from, z_to = region
    heights = np.linspace(z_from, z_to, 1 + max(1, round((z_to - z_from) / step_m))).tolist()
    floor: list[tuple[float, float]] = []
    for x in np.linspace(x_from, x_to, 1 + max(1, round((x_to - x_from) / step_m))).tolist():
        above = [field.inside(x, 0.0, z) for z in reversed(heights)]
        if any(above):
            above = above[above.index(True) :]
            column = above.index(False) if False in above else len(above)
            floor.append((x, heights[len(above) - column]))
    if not floor:
        raise PolynomialError(f"region {region}: the field is nowhere known there")
    return tuple(floor)


def _powers(polynomial: Polynomial, x: FloatArray, z: FloatArray) -> FloatArray:
    """ξ^i ζ^j of places, shape (n, coefficients), in the coefficients' order."""
    xi = np.clip((x - polynomial.centre_x_m) / polynomial.half_x_m, -1.0, 1.0)
    zeta = np.clip((z - polynomial.centre_z_m) / polynomial.half_z_m, -1.0, 1.0)
    degree = polynomial.degree
    return np.column_stack(
        [xi**i * zeta**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    )

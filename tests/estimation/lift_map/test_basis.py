"""The map's functions: potential flow where they claim it, and what is known beforehand."""

from __future__ import annotations

from itertools import pairwise
from math import hypot

import numpy as np
import pytest

from tgl_soar.estimation.lift_map.basis import Box, FlowBasis, conditioned
from tgl_soar.types import GROUND_POINTS, NO_GROUND, Ground

BOX = Box(x_min_m=-24.0, x_max_m=0.0, z_min_m=0.5, z_max_m=24.0)


def ground(*points: tuple[float, float]) -> Ground:
    padded = [*points, *[points[-1]] * (GROUND_POINTS - len(points))]
    return Ground(len(points), tuple(x for x, _ in padded), tuple(z for _, z in padded))


RAMP = ground((-8.0, 0.0), (0.0, 6.0), (4.0, 6.0))


def test_poles_make_a_potential_flow() -> None:
    basis = FlowBasis(RAMP, BOX)
    h = 1e-4
    x, z = np.array([-12.0, -6.0, -2.0]), np.array([5.0, 8.0, 12.0])
    east, west = basis.features(x + h, z), basis.features(x - h, z)
    up, down = basis.features(x, z + h), basis.features(x, z - h)
    divergence = (east[0] - west[0] + up[1] - down[1]) / (2.0 * h)
    curl = (up[0] - down[0] - east[1] + west[1]) / (2.0 * h)
    poles = slice(3, 3 + 2 * basis.poles)
    assert np.abs(east[0][:, poles]).max() > 0.1  # they are not nothing
    assert np.abs(divergence[:, poles]).max() < 1e-6
    assert np.abs(curl[:, poles]).max() < 1e-6
    # The shear is none: its curl is its strength.
    assert curl[:, 2] == pytest.approx(1.0)


def test_poles_of_unit_variance_make_the_wind_that_is_said_of_them() -> None:
    """2.4 m/s at half of H over level ground, but for the row's ends."""
    basis = FlowBasis(NO_GROUND, BOX)
    middle_z = BOX.z_min_m + 0.5 * BOX.height_m
    u, _ = basis.features(-12.0, middle_z)
    sd = float(np.sqrt((u[0, 3 : 3 + 2 * basis.poles] ** 2).sum()))
    # The row is 38 m long, poles lie 2.4 m lower: 2 atan(19 / 14.1) / π of an endless row.
    expected = 2.4 * np.sqrt(11.75 / 14.1 * 2.0 * np.arctan(19.0 / 14.1) / np.pi)
    assert sd == pytest.approx(expected, rel=0.05)


def test_the_ground_is_a_streamline_beforehand() -> None:
    basis = FlowBasis(RAMP, BOX)
    tight = basis.prior(-10.0, 8.0, 9.0, True, 0.8)
    loose = basis.prior(-10.0, 8.0, 9.0, True, 50.0)
    line = basis.streamline
    assert line.x_m.max() <= 0.0  # nothing behind the crest
    ramp = (line.x_m > -6.0) & (line.x_m < -2.0)
    u, w = basis.features(line.x_m[ramp], line.z_m[ramp])
    rows = line.normal_x[ramp, None] * u + line.normal_z[ramp, None] * w
    through = rows @ tight.mean
    assert np.abs(through).max() < 0.8
    # 9 m/s straight on would go through a ramp of 37 degrees at 5 m/s.
    assert np.abs(rows @ loose.mean).min() > 2.0
    rises = basis.features(-4.0, 5.0)[1] @ tight.mean
    assert rises[0] > 2.0


def test_an_unknown_ground_is_no_streamline() -> None:
    basis = FlowBasis(NO_GROUND, BOX)
    assert [column.size for column in basis.streamline] == [0, 0, 0, 0]
    prior = basis.prior(-10.0, 8.0, 9.0, True, 0.8)
    _, w = basis.features(-10.0, 0.6)
    assert np.sqrt(w[0] @ prior.covariance @ w[0]) > 2.0


def test_the_first_wind_is_that_of_its_place() -> None:
    basis = FlowBasis(RAMP, BOX)
    prior = basis.prior(-3.0, 8.0, 10.0, True, 0.8)
    u, _ = basis.features(-3.0, 8.0)
    assert (u @ prior.mean)[0] == pytest.approx(10.0, abs=0.3)
    assert np.sqrt(u[0] @ prior.covariance @ u[0]) < 0.8


def test_a_long_box_has_no_more_poles_than_a_reading_can_pay_for() -> None:
    basis = FlowBasis(NO_GROUND, Box(-400.0, 0.0, 0.0, 20.0))
    assert basis.poles <= 45
    assert basis.count == basis.flow + 2 == basis.updraft_bias + 1


def test_conditioning_is_bayes() -> None:
    mean, covariance = conditioned(
        np.array([1.0, 0.0]),
        np.diag([4.0, 1.0]),
        np.array([[1.0, 0.0]]),
        np.array([2.0]),
        np.array([4.0]),
    )
    assert mean == pytest.approx([2.0, 0.0])
    assert np.diag(covariance) == pytest.approx([2.0, 1.0])


@pytest.mark.parametrize(
    "box",
    [
        Box(-1.0, float("nan"), 0.0, 1.0),
        Box(-1.0, 1.0, 0.0, float("inf")),
        Box(1.0, -1.0, 0.0, 1.0),
        Box(1.0, 1.0, 0.0, 1.0),
        Box(0.0, 1.0, 2.0, 1.0),
        Box(0.0, 1.0, 2.0, 2.0),
    ],
)
def test_a_box_that_is_none_is_refused(box: Box) -> None:
    with pytest.raises(ValueError, match="finite fence"):
        FlowBasis(RAMP, box)


def laid_out(basis: FlowBasis, box: Box, columns: int) -> tuple[list[complex], list[complex]]:
    """Where the poles of a level ground are, and the bumps' middles."""
    h = box.height_m
    length = box.x_max_m - box.x_min_m + 0.6 * h
    spacing = max(0.07 * h, length / 44.0)
    first = box.x_min_m - 0.3 * h + 0.5 * spacing
    z = box.z_min_m - spacing / 0.7
    count = int(np.ceil(length / spacing - 0.5))
    poles = [complex(first + i * spacing, z) for i in range(count)]
    across = np.linspace(box.x_min_m, box.x_max_m, columns)
    middle = 0.5 * (box.z_min_m + box.z_max_m)
    bumps = [complex(x, at) for x in across for at in (box.z_min_m, middle, box.z_max_m)]
    assert basis.spacing_m == pytest.approx(spacing)
    return poles, bumps


@pytest.mark.parametrize(
    ("box", "columns", "width_m"),
    [
        (Box(-10.0, 12.0, 1.0, 21.0), 4, 8.0),  # 0.4 H, where columns are nearer
        (Box(-10.0, 0.5, 1.0, 21.0), 2, 10.5),  # two at least
        (Box(-200.0, 0.0, 1.0, 21.0), 6, 40.0),  # and six at most
    ],
)
def test_the_basis_is_that_of_the_page_in_complex_numbers(
    box: Box, columns: int, width_m: float
) -> None:
    """f = u − i w of each weight at some places, one after the other."""
    basis = FlowBasis(NO_GROUND, box)
    h = box.height_m
    poles, bumps = laid_out(basis, box, columns)
    assert (basis.poles, basis.bumps) == (len(poles), len(bumps))
    n = 2.4 * np.sqrt(basis.spacing_m * 0.5 * h / np.pi)
    places = [complex(-3.0, 4.0), complex(-7.5, 13.0), complex(0.1, 20.0)]
    u, w = basis.features([p.real for p in places], [p.imag for p in places])
    for i, place in enumerate(places):
        bump = [np.exp(-(abs(place - b) ** 2) / (2.0 * width_m**2)) for b in bumps]
        f = [
            *(1.0, -1.0j, place.imag - 11.0),
            *(n / (place - pole) for pole in poles),
            *(1.0j * n / (place - pole) for pole in poles),
            *bump,
            *(-1.0j * b for b in bump),
            *(0.0, 0.0),
        ]
        assert len(f) == basis.count
        assert u[i] == pytest.approx(np.real(f))
        assert w[i] == pytest.approx(-np.imag(f))


def test_the_weights_of_the_basis_have_their_places() -> None:
    basis = FlowBasis(RAMP, BOX)
    assert basis.flow == 3 + 2 * basis.poles + 2 * basis.bumps
    assert (basis.sink_scale, basis.updraft_bias) == (basis.flow, basis.flow + 1)
    assert basis.count == basis.flow + 2


@pytest.mark.parametrize(("pitot", "bias_mps"), [(True, 0.06), (False, 0.18)])
@pytest.mark.parametrize("wind_mps", [9.0, 4.5])
def test_the_prior_is_the_table_of_deviations_after_two_kinds_of_measurement(
    pitot: bool, bias_mps: float, wind_mps: float
) -> None:
    """By information: the inverse of the covariance is what each measurement adds to it."""
    basis = FlowBasis(RAMP, BOX)
    scale = wind_mps / 9.0
    sd = [3.0 * scale, 0.3 * scale, 0.5 * scale / BOX.height_m]
    sd += [scale] * (2 * basis.poles) + [0.2 * scale] * (2 * basis.bumps) + [0.10, bias_mps]
    line = basis.streamline
    u, w = basis.features(line.x_m, line.z_m)
    through = [
        nx * a + nz * b for nx, nz, a, b in zip(line.normal_x, line.normal_z, u, w, strict=True)
    ]
    (here,), _ = basis.features(-3.0, 8.0)
    expected = np.zeros(basis.count)
    expected[0] = wind_mps
    information = np.diag(1.0 / np.square(sd))
    learnt = information @ expected
    for row in through:
        information = information + np.outer(row, row) / (0.8 * scale) ** 2
    information = information + np.outer(here, here) / (0.7 * scale) ** 2
    learnt = learnt + here * wind_mps / (0.7 * scale) ** 2
    prior = basis.prior(-3.0, 8.0, wind_mps, pitot, 0.8)
    covariance = np.linalg.inv(information)
    assert prior.covariance == pytest.approx(covariance, rel=1e-6, abs=1e-9 * scale**2)
    assert prior.mean == pytest.approx(covariance @ learnt, rel=1e-6, abs=1e-7)
    assert (prior.covariance == prior.covariance.T).all()


def walked(corners: list[tuple[float, float]], at: float) -> tuple[float, float, float, float]:
    """Place on a polygon after a way along it, and the normal there."""
    for (ax, az), (bx, bz) in pairwise(corners):
        length = hypot(bx - ax, bz - az)
        if at < length:
            tx, tz = (bx - ax) / length, (bz - az) / length
            return ax + at * tx, az + at * tz, -tz, tx
        at -= length
    raise AssertionError


def test_the_streamline_is_the_rounded_ground_a_little_above_it_up_to_the_crest() -> None:
    """Level from 0.3 H upstream of the box, up the ramp, and over its top for half a depth."""
    h = BOX.height_m
    low, high = -24.0 - 0.3 * h, 0.3 * h
    corners = [(low, 0.0), (-8.0, 0.0), (0.0, 6.0), (4.0, 6.0), (high, 6.0)]
    length = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(corners))
    basis = FlowBasis(RAMP, BOX)
    depth = basis.spacing_m / 0.7
    assert depth == pytest.approx(0.1 * h)  # of a box that is not long
    step = 0.5 * depth
    places = []
    at = 0.5 * step
    while at < length:
        places.append(walked(corners, at))
        at += step
    rounded = []
    for i in range(2, len(places) - 2):
        x, z, nx, nz = (sum(column) / 5.0 for column in zip(*places[i - 2 : i + 3], strict=True))
        size = hypot(nx, nz)
        if x <= 0.0:
            rounded.append(
                (x + 0.02 * h * nx / size, z + 0.02 * h * nz / size, nx / size, nz / size)
            )
    line = basis.streamline
    assert line.x_m.size == len(rounded) + 2  # and two at the upstream end, where it is level
    assert np.array(line).T[2:] == pytest.approx(np.array(rounded))
    assert np.array(line).T[:2] == pytest.approx(
        np.array([(low + (i + 0.5) * step, 0.02 * h, 0.0, 1.0) for i in range(2)])
    )
    # Poles lie a depth under the ground, along its normal.
    count = int(np.ceil(length / basis.spacing_m - 0.5))
    assert basis.poles == count
    u, w = basis.features(-5.0, 9.0)
    n = 2.4 * np.sqrt(basis.spacing_m * 0.5 * h / np.pi)
    for i in (0, 12, 20, count - 1):
        x, z, nx, nz = walked(corners, (i + 0.5) * basis.spacing_m)
        f = n / complex(-5.0 - x + depth * nx, 9.0 - z + depth * nz)
        assert u[0, 3 + i] == pytest.approx(f.real)
        assert w[0, 3 + i] == pytest.approx(-f.imag)


def test_a_level_ground_is_a_streamline_all_along_and_a_crest_is_its_first_point() -> None:
    h = BOX.height_m
    level = FlowBasis(ground((-8.0, 1.0), (-2.0, 1.0)), BOX).streamline
    assert level.x_m[0] == pytest.approx(-24.0 - 0.3 * h + 0.025 * h)
    assert level.x_m[-1] > 0.3 * h - 0.05 * h
    assert level.z_m == pytest.approx(1.0 + 0.02 * h)
    # Of a plateau, and of a hill with two tops that are as high, the upstream edge.
    for rest in (((4.0, 6.0),), ((4.0, 0.0), (6.0, 6.0))):
        hill = FlowBasis(ground((-20.0, 0.0), (-6.0, 6.0), *rest), BOX).streamline
        assert -6.0 - 0.05 * h < hill.x_m[-1] <= -6.0


def test_one_point_of_the_ground_says_that_it_is_level() -> None:
    line = FlowBasis(ground((3.0, 1.5)), BOX).streamline
    assert line.x_m.size > 10
    assert line.z_m == pytest.approx(1.5 + 0.02 * BOX.height_m)


def test_conditioning_adds_information_and_stays_symmetric() -> None:
    rng = np.random.default_rng(7)
    root, rows = rng.normal(size=(5, 5)), rng.normal(size=(3, 5))
    before, noise, mean = root @ root.T, np.array([0.3, 0.7, 1.1]), rng.normal(size=5)
    measured = rng.normal(size=3)
    after, covariance = conditioned(mean, before, rows, measured - rows @ mean, noise)
    information = np.linalg.inv(before) + rows.T @ np.diag(1.0 / noise) @ rows
    assert covariance == pytest.approx(np.linalg.inv(information))
    learnt = np.linalg.inv(before) @ mean + rows.T @ (measured / noise)
    assert after == pytest.approx(np.linalg.solve(information, learnt))
    assert (covariance == covariance.T).all()

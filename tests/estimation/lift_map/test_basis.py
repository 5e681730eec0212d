"""The map's functions: potential flow where they claim it, and what is known beforehand."""

from __future__ import annotations

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
    assert basis.streamline.x_m.size == 0
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
    "box", [Box(-1.0, float("nan"), 0.0, 1.0), Box(1.0, -1.0, 0.0, 1.0), Box(0.0, 1.0, 2.0, 2.0)]
)
def test_a_box_that_is_none_is_refused(box: Box) -> None:
    with pytest.raises(ValueError, match="finite fence"):
        FlowBasis(RAMP, box)

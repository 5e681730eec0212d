"""A jet between others: which corners are blended by how much, over which board, and how the wind
grows with height.  The corners here are uniform, so that a blend is a sum by hand."""

from __future__ import annotations

from collections.abc import Iterator
from math import radians, tan

import numpy as np
import pytest

from tgl_soar.air import jet as jet_module
from tgl_soar.air.grid import GridTable, bake
from tgl_soar.air.jet import JetShape, SlopeJet
from tgl_soar.analysis.experiments import random_jet
from tgl_soar.analysis.experiments.random_jet import JetRanges, altered_jet

SLOPE, WIND_MPS, HEIGHT_M = radians(22.0), 10.0, 2.85
RANGES = JetRanges(slope_rad=(radians(-2.0), radians(4.0)), edge_m=(-0.05, 0.15))
STEP_M = 0.25


def uniform(shape: JetShape) -> GridTable:
    """Wind that shows its shape: u of the slope in degrees, w of the nozzle's height."""
    u = np.full((21, 21), np.degrees(shape.slope_rad) / 10.0)
    return bake(-1.0, 0.0, STEP_M, u, np.full((21, 21), shape.nozzle_height_m))


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(jet_module, "unit_jet", uniform)
    monkeypatch.setattr(random_jet, "unit_jet", uniform)
    for cached in (random_jet._boarded, random_jet._corner):
        cached.cache_clear()
    yield
    for cached in (random_jet._boarded, random_jet._corner):
        cached.cache_clear()


def altered(slope_deg: float = 0.0, edge_m: float = 0.0, shear_per_m: float = 0.0) -> SlopeJet:
    return altered_jet(
        SlopeJet(WIND_MPS, SLOPE),
        RANGES,
        slope_rad=radians(slope_deg),
        edge_m=edge_m,
        shear_per_m=shear_per_m,
    )


def at(jet: SlopeJet, x_m: float = -0.5, z_m: float = 1.0) -> tuple[float, float]:
    u, v, w = jet.wind_at(x_m, 0.0, z_m, 0.0)
    assert v == 0.0
    return u, w


def test_what_is_not_altered_is_the_jet_itself() -> None:
    jet = altered()
    assert jet.shape == JetShape(slope_rad=SLOPE)
    assert at(jet) == pytest.approx((22.0, WIND_MPS * HEIGHT_M))


@pytest.mark.parametrize("slope_deg", [-2.0, -0.5, 1.0, 3.0, 4.0])
def test_a_slope_is_blended_between_the_ends_of_its_range_over_the_steeper_board(
    slope_deg: float,
) -> None:
    """Linear in the slope, as u is: it comes out as that of the slope itself."""
    jet = altered(slope_deg=slope_deg)
    assert at(jet) == pytest.approx((22.0 + slope_deg, WIND_MPS * HEIGHT_M))
    assert jet.shape.slope_rad == pytest.approx(radians(26.0))
    for off_m, is_air in ((0.01, True), (-0.01, False)):
        u, _ = at(jet, x_m=1.0, z_m=tan(radians(26.0)) + off_m)
        assert (u != 0.0) is is_air


@pytest.mark.parametrize("edge_m", [-0.05, -0.01, 0.08, 0.15])
def test_an_edge_is_that_of_another_nozzle_at_the_same_wind_over_the_same_board(
    edge_m: float,
) -> None:
    jet = altered(edge_m=edge_m)
    assert at(jet) == pytest.approx((22.0, WIND_MPS * (HEIGHT_M + edge_m)))
    assert jet.shape == JetShape(slope_rad=SLOPE)
    assert jet.wind_mps == WIND_MPS


def test_slope_and_edge_are_blended_together() -> None:
    """The weights of the four corners are products: each part comes out as it does alone."""
    assert at(altered(slope_deg=1.0, edge_m=0.08)) == pytest.approx(
        (23.0, WIND_MPS * (HEIGHT_M + 0.08))
    )


def test_a_corner_counts_by_both_of_its_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 1 degree in -2 to 4 the half, of 0.10 m in -0.05 to 0.15 three quarters."""
    high_deg, high_m = 26.0, HEIGHT_M + 0.15

    def one_corner(shape: JetShape) -> GridTable:
        steep = abs(np.degrees(shape.slope_rad) - high_deg) < 1e-6
        wide = abs(shape.nozzle_height_m - high_m) < 1e-6
        value = np.full((21, 21), float(steep and wide))
        return bake(-1.0, 0.0, STEP_M, value, 0.0 * value)

    monkeypatch.setattr(random_jet, "unit_jet", one_corner)
    assert at(altered(slope_deg=1.0, edge_m=0.10))[0] == pytest.approx(WIND_MPS * 0.5 * 0.75)
    assert at(altered(slope_deg=-2.0, edge_m=0.10))[0] == pytest.approx(0.0)


@pytest.mark.parametrize("shear_per_m", [-0.2, 0.1])
def test_the_wind_grows_with_height_about_the_middle_of_the_nozzle(shear_per_m: float) -> None:
    jet = altered(shear_per_m=shear_per_m)
    for z_m in (0.25, 1.0, 1.425, 2.5, 4.0):
        growth = 1.0 + shear_per_m * (z_m - 1.425)
        assert at(jet, z_m=z_m) == pytest.approx((22.0 * growth, WIND_MPS * HEIGHT_M * growth))


def test_a_corner_is_read_at_the_places_of_the_boards_grid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Grids of other cells and beginnings, of a wind that is its place: u = x, w = z."""

    def placed(shape: JetShape) -> GridTable:
        begin_m = -2.0 if abs(np.degrees(shape.slope_rad) - 26.0) < 1e-6 else -3.0
        x = begin_m + STEP_M * np.arange(31)
        z = STEP_M * np.arange(25)
        xx, zz = np.meshgrid(x, z, indexing="ij")
        return bake(begin_m, 0.0, STEP_M, xx, zz)

    monkeypatch.setattr(random_jet, "unit_jet", placed)
    monkeypatch.setattr(jet_module, "unit_jet", placed)
    jet = altered(slope_deg=1.0)
    for x_m, z_m in ((-1.5, 0.5), (-0.4, 3.1), (2.2, 2.0)):
        assert at(jet, x_m, z_m) == pytest.approx((WIND_MPS * x_m, WIND_MPS * z_m))


def test_a_range_that_leaves_the_jets_own_is_refused() -> None:
    steep = SlopeJet(WIND_MPS, radians(33.0))
    with pytest.raises(ValueError, match="15 to 35 degrees"):
        altered_jet(steep, RANGES, slope_rad=radians(1.0), edge_m=0.0, shear_per_m=0.0)

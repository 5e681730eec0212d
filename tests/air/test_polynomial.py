"""Wind as a polynomial of position: exact where the wind is one, and honest where it is not."""

from __future__ import annotations

from math import nan, radians

import numpy as np
import pytest
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.polynomial import (
    PolynomialError,
    PolynomialField,
    coefficient_count,
    fit_polynomial,
    polynomial_wind,
)

REGION = (-0.5, 2.2, 0.2, 2.6)
BOARD = ((-0.5, 0.0), (0.0, 0.0), (2.2, 2.2 * 0.4245))


class Cubic:
    """A field that is a polynomial of third degree, over level ground."""

    reference_wind_mps = 8.0

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002 - steady
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y, z = broadcast(x_m, y_m, z_m)
        return 8.0 + x - 0.5 * x * z * z, 0.0 * y, 1.0 + z - 0.2 * x**3

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        u, v, w = self.wind(x_m, y_m, z_m, time_s)
        return float(u), float(v), float(w)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        return z_m >= 0.0


def test_a_polynomial_is_found_again() -> None:
    fitted, misfit = fit_polynomial(Cubic(), REGION, 3)
    assert misfit.u_most_mps < 1e-12
    assert misfit.w_most_mps < 1e-12
    for x, z in ((0.3, 1.1), (-0.5, 2.6), (2.2, 0.2)):
        assert fitted.wind_at(x, 0.4, z, 5.0) == pytest.approx(Cubic().wind_at(x, 0.0, z, 0.0))
    assert fitted.reference_wind_mps == 8.0


def test_the_misfit_is_that_of_the_field_s_places() -> None:
    """A parabola cannot follow x z² and x³: what is left is what `Misfit` says, no more."""
    fitted, misfit = fit_polynomial(Cubic(), REGION, 2, step_m=0.1)
    x, z = np.meshgrid(np.linspace(-0.5, 2.2, 28), np.linspace(0.2, 2.6, 25))
    du = fitted.wind(x, 0.0, z)[0] - Cubic().wind(x, 0.0, z)[0]
    dw = fitted.wind(x, 0.0, z)[2] - Cubic().wind(x, 0.0, z)[2]
    assert misfit.places == x.size
    assert misfit.u_rms_mps == pytest.approx(np.sqrt((du**2).mean()))
    assert misfit.w_rms_mps == pytest.approx(np.sqrt((dw**2).mean()))
    assert (misfit.u_most_mps, misfit.w_most_mps) == pytest.approx((abs(du).max(), abs(dw).max()))
    assert misfit.u_rms_mps > 0.01


@pytest.mark.parametrize("degree", [1, 4, 7, 12])
def test_one_place_and_many_agree(degree: int) -> None:
    fitted, _ = fit_polynomial(SlopeJet(8.5, radians(23.0)), REGION, degree, floor=BOARD)
    x, z = np.array([0.1, 1.0, 1.9, 9.0]), np.array([0.7, 1.7, 2.4, -3.0])
    u, v, w = fitted.wind(x, 0.0, z)
    for k in range(4):
        assert fitted.wind_at(x[k], 0.0, z[k], 0.0) == pytest.approx((u[k], v[k], w[k]), abs=1e-9)


def test_more_degrees_follow_the_jet_more_closely() -> None:
    jet = SlopeJet(8.5, radians(23.0))
    misfits = [fit_polynomial(jet, REGION, n, floor=BOARD)[1].w_rms_mps for n in (2, 4, 6, 8)]
    assert misfits == sorted(misfits, reverse=True)
    assert misfits[-1] < 0.25 * misfits[0]


def test_under_the_floor_and_outside_the_box_is_no_air() -> None:
    field, _ = fit_polynomial(Cubic(), REGION, 2, floor=BOARD)
    assert field.inside(1.0, 0.0, 0.5)
    assert not field.inside(1.0, 0.0, 0.4)  # the board is at 0.4245
    assert not field.inside(2.3, 0.0, 2.0)
    assert not field.inside(1.0, 0.0, 2.7)
    assert not field.inside(-0.6, 0.0, 1.0)
    assert fit_polynomial(Cubic(), REGION, 2)[0].inside(1.0, 0.0, 0.4)


def test_beyond_the_box_the_wind_is_that_of_its_edge() -> None:
    field, _ = fit_polynomial(Cubic(), REGION, 3)
    assert field.wind_at(50.0, 0.0, 1.0, 0.0) == field.wind_at(2.2, 0.0, 1.0, 0.0)
    assert polynomial_wind(field.polynomial, 1.0, -50.0) == polynomial_wind(
        field.polynomial, 1.0, 0.2
    )


@pytest.mark.parametrize(
    ("region", "degree", "step_m", "why"),
    [
        (REGION, 0, 0.05, "degree 0: must be 1 to 12"),
        (REGION, 13, 0.05, "degree 13: must be 1 to 12"),
        ((2.2, -0.5, 0.2, 2.6), 3, 0.05, "growing"),
        ((-0.5, 2.2, nan, 2.6), 3, 0.05, "growing"),
        (REGION, 3, nan, "step nan m: must be positive"),
        (REGION, 12, 0.5, "91 coefficients for 36 places"),
        ((-0.5, 2.2, -2.6, -0.2), 3, 0.05, "10 coefficients for 0 places"),
    ],
)
def test_what_cannot_be_fitted_is_refused(
    region: tuple[float, float, float, float], degree: int, step_m: float, why: str
) -> None:
    with pytest.raises(PolynomialError, match=why):
        fit_polynomial(Cubic(), region, degree, step_m=step_m)


def test_a_reference_wind_must_be_positive() -> None:
    field, _ = fit_polynomial(Cubic(), REGION, 2)
    with pytest.raises(PolynomialError, match="reference wind"):
        PolynomialField(field.polynomial, reference_wind_mps=nan)


def test_a_polynomial_has_as_many_coefficients_as_it_has_powers() -> None:
    assert [coefficient_count(n) for n in (1, 2, 3)] == [3, 6, 10]

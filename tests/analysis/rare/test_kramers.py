"""How long a well holds by theory: rates by hand, and wells of air of a known potential."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, inf, nan, pi, radians, sin, sqrt

import pytest

from tgl_soar.analysis.rare.kramers import cliff_rate, diffusion_of, smooth_rate, well_exits
from tgl_soar.types import GlidePolar

WIND_MPS = 9.0
ETA = radians(75.0)
SIGMA_MPS, TAU_S = 0.3, 0.2
# Sinks 0.9 m/s at 9 m/s, 0.1 more for each m/s: S' is 0.1 everywhere.
POLAR = GlidePolar(c0=0.0, c1=0.1, c2=0.0, c3=0.0, speed_min_mps=6.0, speed_max_mps=14.0)
LEVERAGE = sin(ETA) - 0.1 * cos(ETA)
X0, Z0 = 2.0, 10.0


class Layered:
    """The same wind everywhere, and an updraft that depends on height alone."""

    reference_wind_mps = WIND_MPS

    def __init__(self, updraft: Callable[[float], float], top_m: float = inf) -> None:
        self._updraft = updraft
        self._top_m = top_m

    def wind_at(self, _x: float, _y: float, z: float, _t: float) -> tuple[float, float, float]:
        return WIND_MPS, 0.0, self._updraft(z - Z0)

    def inside(self, _x: float, _y: float, z: float) -> bool:
        return z <= self._top_m


def ends(
    updraft: Callable[[float], float],
    allowed: Callable[[float, float], bool] = lambda _x, _z: True,
    top_m: float = inf,
) -> list[tuple[float, float, float, bool]]:
    field = Layered(updraft, top_m)
    found = well_exits(field, POLAR, (X0, Z0), ETA, (SIGMA_MPS, TAU_S), allowed)  # type: ignore[arg-type]
    return [tuple(each) for each in found]  # type: ignore[misc]


def test_kramers_rate_by_hand() -> None:
    """sqrt(0.4 · 0.9) / 2π · e^(−2)."""
    assert smooth_rate(0.4, 0.9, 3.0, 1.5) == pytest.approx(0.6 / (2.0 * pi) * exp(-2.0))


def test_the_rate_over_a_cliff_by_hand() -> None:
    """0.4 sqrt(2 / π) e^(−2)."""
    assert cliff_rate(0.4, 3.0, 1.5) == pytest.approx(0.4 * sqrt(2.0 / pi) * exp(-2.0))


def test_turbulence_spreads_by_its_vertical_part_and_by_what_the_polar_makes_of_the_other() -> None:
    """Straight up c is 1; on a level line it is the polar's slope."""
    assert diffusion_of(0.0, 0.5 * pi, 0.5, 0.4) == pytest.approx(0.25 * 0.2)
    assert diffusion_of(-0.3, 0.5 * pi, 0.5, 0.4) == pytest.approx(0.25 * (0.2 + 0.09 * 0.4))
    assert diffusion_of(-0.3, 0.0, 0.5, 0.4) == pytest.approx(0.25 * (0.2 + 0.036) / 0.09)
    c = sin(ETA) - 0.1 * cos(ETA)
    assert diffusion_of(0.1, ETA, 0.5, 0.4) == pytest.approx(0.25 * (0.2 + 0.004) / c**2)


def test_a_parabola_cut_off_below_and_above_is_left_over_its_edges() -> None:
    """Excess −0.5 (z − z0): a rate of 0.5 sin η / c, and ½ λ s² to a limit at s."""
    low_m, high_m = Z0 - 1.0, Z0 + 2.0
    lower, upper = ends(lambda h: 0.9 - 0.5 * h, lambda _x, z: low_m < z < high_m)
    rate = 0.5 * sin(ETA) / LEVERAGE
    diffusion = diffusion_of(0.1, ETA, SIGMA_MPS, TAU_S)
    for (s, barrier, found, smooth), height in ((lower, -1.0), (upper, 2.0)):
        assert s == pytest.approx(height / sin(ETA), abs=0.011)
        assert barrier == pytest.approx(0.5 * rate * (height / sin(ETA)) ** 2, rel=0.03)
        assert found == pytest.approx(
            rate * sqrt(barrier / (pi * diffusion)) * exp(-barrier / diffusion), rel=1e-6, abs=0.0
        )
        assert not smooth


def test_a_rim_of_the_airs_own_is_smooth() -> None:
    """Excess −0.8 sin(2 h): zero again at h = ±π/2, as steep there as in the middle.

    The barrier is ∫ 0.8 sin(2 h) ds / c = 0.8 / (c sin η).
    """
    rate = 1.6 * sin(ETA) / LEVERAGE
    diffusion = diffusion_of(0.1, ETA, SIGMA_MPS, TAU_S)
    for (s, barrier, found, smooth), side in zip(
        ends(lambda h: 0.9 - 0.8 * sin(2.0 * h)), (-1.0, 1.0), strict=True
    ):
        assert s == pytest.approx(side * 0.5 * pi / sin(ETA), abs=0.011)
        assert barrier == pytest.approx(0.8 / (LEVERAGE * sin(ETA)), rel=0.01)
        assert smooth
        assert found == pytest.approx(
            rate / (2.0 * pi) * exp(-barrier / diffusion), rel=1e-3, abs=0.0
        )


def test_the_rims_own_steepness_counts() -> None:
    """Above, the excess comes back to zero four times as steeply as it left it."""

    def updraft(h: float) -> float:
        return 0.9 - 0.5 * h if h < 1.0 else 0.9 - 0.5 + 2.0 * (h - 1.0)

    lower, upper = ends(updraft, lambda _x, z: z > Z0 - 1.0)
    rate, rim = (slope * sin(ETA) / LEVERAGE for slope in (0.5, 2.0))
    diffusion = diffusion_of(0.1, ETA, SIGMA_MPS, TAU_S)
    s, barrier, found, smooth = upper
    assert s == pytest.approx(1.25 / sin(ETA), abs=0.011)
    assert smooth
    assert not lower[3]
    assert found == pytest.approx(
        sqrt(rate * rim) / (2.0 * pi) * exp(-barrier / diffusion), rel=1e-3, abs=0.0
    )


def test_the_end_of_the_field_and_of_the_polar_are_edges() -> None:
    """Above, the field ends; below, the air has no number, as where the polar has no sink."""
    lower, upper = ends(lambda h: 0.9 - 0.5 * h if h > -0.7 else nan, top_m=Z0 + 0.5)
    assert upper[0] == pytest.approx(0.5 / sin(ETA), abs=0.011)
    assert lower[0] == pytest.approx(-0.7 / sin(ETA), abs=0.011)
    assert (lower[3], upper[3]) == (False, False)
    diffusion = diffusion_of(0.1, ETA, SIGMA_MPS, TAU_S)
    rate = 0.5 * sin(ETA) / LEVERAGE
    for _, barrier, found, _ in (lower, upper):
        assert found == pytest.approx(cliff_rate(rate, barrier, diffusion), rel=1e-6, abs=0.0)


def test_what_may_be_flown_is_asked_along_the_line() -> None:
    asked: list[tuple[float, float]] = []

    def allowed(x: float, z: float) -> bool:
        asked.append((x, z))
        return abs(z - Z0) < 0.2

    ends(lambda h: 0.9 - 0.5 * h, allowed)
    for x, z in asked:
        assert (x - X0) * sin(ETA) == pytest.approx((z - Z0) * cos(ETA), abs=1e-9)
    assert min(z for _, z in asked) < Z0 < max(z for _, z in asked)


# --- air that changes along the line, and across it ----------------------------------------------


class Along:
    """Updraft and wind by the distance along a line, and a storm beside it.  At rest in time, and
    in its middle plane alone."""

    reference_wind_mps = WIND_MPS

    def __init__(self, excess: Callable[[float], float], wind_slope: float = 0.0) -> None:
        self._excess, self._wind_slope = excess, wind_slope

    def wind_at(self, x: float, y: float, z: float, t: float) -> tuple[float, float, float]:
        assert (y, t) == (0.0, 0.0)
        s = (x - X0) * cos(ETA) + (z - Z0) * sin(ETA)
        across = (z - Z0) * cos(ETA) - (x - X0) * sin(ETA)
        u = WIND_MPS + self._wind_slope * s
        return u, 0.0, 0.1 * u + self._excess(s) + 50.0 * across

    def inside(self, _x: float, y: float, _z: float) -> bool:
        assert y == 0.0
        return True


def ends_along(field: Along, reach_m: float = inf) -> list[tuple[float, float, float, bool]]:
    def allowed(x: float, _z: float) -> bool:
        return abs(x - X0) < reach_m * cos(ETA)

    found = well_exits(field, POLAR, (X0, Z0), ETA, (SIGMA_MPS, TAU_S), allowed)  # type: ignore[arg-type]
    return [tuple(each) for each in found]  # type: ignore[misc]


@pytest.mark.parametrize("wind_slope", [0.0, 0.4])
def test_the_air_is_that_of_the_lines_own_places(wind_slope: float) -> None:
    """What a faster wind sinks more is made up for: the excess alone counts, 0.5 a metre."""
    lower, upper = ends_along(Along(lambda s: -0.5 * s, wind_slope), reach_m=1.5)
    rate = 0.5 / LEVERAGE
    diffusion = diffusion_of(0.1, ETA, SIGMA_MPS, TAU_S)
    for (s, barrier, found, smooth), end in ((lower, -1.5), (upper, 1.5)):
        assert s == pytest.approx(end, abs=0.011)
        assert barrier == pytest.approx(0.5 * rate * s * s, rel=0.02)
        expected = rate * sqrt(barrier / (pi * diffusion)) * exp(-barrier / diffusion)
        assert found == pytest.approx(expected, rel=1e-6, abs=0.0)
        assert not smooth


@pytest.mark.parametrize(("known_m", "smooth"), [(1.005, False), (1.025, True)])
def test_a_rim_whose_far_side_is_not_known_is_an_edge(known_m: float, smooth: bool) -> None:
    """The air comes back to zero at 0.995 m: steeply, if it is known beyond."""

    def excess(s: float) -> float:
        if s > known_m:
            return nan
        return -0.5 * s if s < 0.9 else -0.45 + 0.45 * (s - 0.9) / 0.095

    _, (s, barrier, found, is_smooth) = ends_along(Along(excess), reach_m=3.0)
    assert s == pytest.approx(1.0)
    assert is_smooth == smooth
    rate, rim = 0.5 / LEVERAGE, 0.45 / 0.095 / LEVERAGE
    diffusion = diffusion_of(0.1, ETA, SIGMA_MPS, TAU_S)
    expected = (
        smooth_rate(rate, rim, barrier, diffusion)
        if smooth
        else cliff_rate(rate, barrier, diffusion)
    )
    assert found == pytest.approx(expected, rel=1e-6, abs=0.0)

"""The zero excess updraft contour, against hills and polars with a known answer."""

from __future__ import annotations

from math import atan, atan2, cos, hypot, isnan, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.air.hill import HillField, hill_wind
from tgl_soar.air.zeuc import (
    ZeucError,
    contour,
    core,
    crossings,
    excess_at,
    excess_gradient,
    excess_updraft,
    feasible_leans,
    wind_sensitivity,
)
from tgl_soar.types import GlidePolar, polar_sink, polar_slope

LEVEL = GlidePolar(
    c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=0.5, speed_max_mps=40.0
)  # sinks 1 m/s at any speed
POLAR = GlidePolar(
    c0=5.0068, c1=-0.93464, c2=0.059155, c3=0.0, speed_min_mps=7.4, speed_max_mps=14.0
)
HILL = HillField(9.0, 20.0)


class Dome:
    """u as asked, w = sink + 1 − (r / R)²: with a level polar, E = 0 on a circle of radius R."""

    reference_wind_mps = 9.0

    def __init__(
        self, radius_m: float, wall_x_m: float = -np.inf, oblique_rad: float = 0.0
    ) -> None:
        self.radius_m, self.wall_x_m = radius_m, wall_x_m
        self.u_mps, self.v_mps = 9.0 * cos(oblique_rad), -9.0 * sin(oblique_rad)

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        u, v, w = self.wind(x_m, y_m, z_m, time_s)
        return float(u), float(v), float(w)

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, _, z = broadcast(x_m, y_m, z_m)
        w = 2.0 - (x * x + z * z) / self.radius_m**2
        u, v = np.full(x.shape, self.u_mps), np.full(x.shape, self.v_mps)
        return u, v, np.where(x < self.wall_x_m, -5.0, w)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        return True


def test_contour_over_the_hill_is_the_analytic_one_to_a_millimetre() -> None:
    """Level polar: w = s gives r² = −U R² sin 2θ / s in closed form."""
    lines = contour(HILL, LEVEL, (-70.0, -1.0, 0.5, 70.0), 1.0)
    assert len(lines) == 1
    x, z = lines[0].T
    r, theta = np.hypot(x, z), np.arctan2(z, x)
    exact = np.sqrt(-9.0 * 400.0 * np.sin(2.0 * theta) / 1.0)
    assert np.abs(r - exact).max() < 1e-3
    # It reaches from where it leaves the hill's surface to where it meets it again.
    on_surface = 0.5 * (np.pi + np.arcsin(1.0 / 9.0))
    assert np.abs(theta - on_surface).min() < 0.08


def test_contour_with_a_real_polar_lies_on_zero_to_a_millimetre() -> None:
    for line in contour(HILL, POLAR, (-60.0, -1.0, 1.0, 60.0), 0.5):
        for x, z in line.tolist():
            gx, gz = excess_gradient(HILL, POLAR, x, z)
            if np.isfinite(gx) and np.isfinite(gz):
                assert abs(excess_at(HILL, POLAR, x, z)) / hypot(gx, gz) < 1e-3


@settings(max_examples=40, deadline=None)
@given(st.floats(-30.0, -16.0), st.floats(70.0, 120.0))
def test_crossing_of_a_line_is_the_analytic_one(x0: float, eta_deg: float) -> None:
    eta = radians(eta_deg)
    found = crossings(HILL, LEVEL, x0, 30.0, eta, 40.0)
    upper = [place for place in found if place.excess_slope_per_s < 0.0]
    assert len(upper) == 1
    place = upper[0]
    assert (place.x_m - x0) * sin(eta) == pytest.approx((place.z_m - 30.0) * cos(eta), abs=1e-5)
    r, theta = hypot(place.x_m, place.z_m), atan2(place.z_m, place.x_m)
    assert r == pytest.approx(sqrt(-3600.0 * sin(2.0 * theta)), abs=1e-3)
    assert (place.wind_mps, place.updraft_mps) == pytest.approx(
        hill_wind(HILL.hill, place.x_m, place.z_m)
    )
    gx, gz = excess_gradient(HILL, LEVEL, place.x_m, place.z_m)
    assert place.excess_slope_per_s == pytest.approx(gx * cos(eta) + gz * sin(eta), rel=1e-4)


def test_closed_contour_comes_back_as_one_closed_line() -> None:
    lines = contour(Dome(1.0), LEVEL, (-1.53, 1.51, -1.52, 1.55), 0.1)
    assert len(lines) == 1
    assert lines[0][0] == pytest.approx(lines[0][-1])
    assert np.hypot(*lines[0].T) == pytest.approx(1.0, abs=1e-5)
    length = np.hypot(*np.diff(lines[0], axis=0).T).sum()
    assert length == pytest.approx(2.0 * pi, rel=5e-3)  # a polygon of 60 sides


def test_a_jump_of_the_field_is_no_contour() -> None:
    wall = Dome(1.0, wall_x_m=0.0)
    for line in contour(wall, LEVEL, (-1.53, 1.51, -1.52, 1.55), 0.1):
        assert np.hypot(*line.T) == pytest.approx(1.0, abs=1e-5)
    assert crossings(wall, LEVEL, 0.0, 0.3, radians(179.0), 0.5) == []


def test_stable_places_are_those_to_which_sliding_returns() -> None:
    """ṡ sin η = w − sink(u − ṡ cos η): slide along a line from either side of each crossing."""
    eta = radians(105.0)
    places = crossings(HILL, POLAR, -24.0, 14.0, eta, 40.0)
    assert {place.stable for place in places} == {True, False} or places[0].stable
    for place in places:
        for start in (-0.2, 0.2):
            s = start
            for _ in range(400):
                u, _, w = HILL.wind_at(place.x_m + s * cos(eta), 0.0, place.z_m + s * sin(eta), 0.0)
                rate = 0.0
                for _ in range(20):
                    rate = (w - polar_sink(POLAR, u - rate * cos(eta))) / sin(eta)
                s += 0.05 * rate
                if abs(s) > 1.0:
                    break
            assert (abs(s) < abs(start)) == place.stable


def test_leans_just_inside_the_feasible_range_are_stable_and_just_outside_not() -> None:
    place = crossings(HILL, POLAR, -24.0, 30.0, radians(100.0), 40.0)[-1]
    low, high = feasible_leans(HILL, POLAR, place.x_m, place.z_m)
    assert low < radians(10.0) < high

    def stable(lean: float) -> bool:
        found = crossings(HILL, POLAR, place.x_m, place.z_m, lean + 0.5 * pi, 0.05)
        return bool(found) and found[0].stable

    step = radians(1.0)
    assert stable(low + step)
    assert stable(high - step)
    for lean in (low - step, high + step):
        assert not -0.5 * pi < lean < 0.5 * pi or not stable(lean)


# At 9 m/s it sinks by 1 m/s, as the level one does, and by half of what it flies faster.
STEEP = LEVEL._replace(c0=-3.5, c1=0.5)


@pytest.mark.parametrize(("eta_deg", "stable"), [(22.0, False), (25.0, True), (28.0, True)])
def test_in_an_oblique_wind_sliding_changes_the_airspeed_by_less(
    eta_deg: float, stable: bool
) -> None:
    """ṡ sin η = w − sink(√((u − ṡ cos η)² + v²)), solved beside the upper crossing.

    Only the wind's part along x, cos 30°, counts: returning ends at tan η = 0.5 cos 30°, 23.4°,
    and not at atan 0.5, 26.6°.
    """
    eta, askew = radians(eta_deg), Dome(1.0, oblique_rad=radians(30.0))
    place = crossings(askew, STEEP, 0.0, 0.0, eta, 1.5)[-1]
    assert (place.x_m, place.z_m) == pytest.approx((cos(eta), sin(eta)), abs=1e-5)
    for off_m in (-1e-3, 1e-3):
        x_m, z_m = (1.0 + off_m) * cos(eta), (1.0 + off_m) * sin(eta)
        u, v, w = askew.wind_at(x_m, 0.0, z_m, 0.0)

        def misses(rate: float, u: float = u, v: float = v, w: float = w) -> float:
            return rate * sin(eta) - w + polar_sink(STEEP, hypot(u - rate * cos(eta), v))

        assert (off_m * brentq(misses, -0.5, 0.5) < 0.0) == stable
    assert place.stable == stable


def test_in_an_oblique_wind_flatter_lines_are_feasible() -> None:
    """On the dome's top, where excess updraft falls straight up: as above."""
    low, high = feasible_leans(Dome(1.0, oblique_rad=radians(30.0)), STEEP, 0.0, 1.0)
    assert low + 0.5 * pi == pytest.approx(atan(0.5 * cos(radians(30.0))))
    assert high + 0.5 * pi == pytest.approx(pi)


def test_lower_branch_of_a_hill_has_no_stable_line_that_can_be_flown() -> None:
    """Near the hill's foot excess grows upwards: only a line that lies on its back is stable."""
    places = crossings(HILL, LEVEL, -40.0, 15.0, 0.5 * pi, 15.0)
    lower = min(places, key=lambda place: place.z_m)
    assert lower.excess_slope_per_s > 0.0
    assert not lower.stable
    low, high = feasible_leans(HILL, LEVEL, lower.x_m, lower.z_m)
    assert radians(45.0) < low < high
    flat = crossings(HILL, LEVEL, lower.x_m, lower.z_m, 0.5 * pi + 0.5 * (low + high), 1.0)
    assert [place.stable for place in flat] == [True]


@pytest.mark.parametrize(("x0", "answer"), [(-36.0, "rise"), (-15.0, "fall")])
def test_wind_sensitivity_is_what_the_contour_does(x0: float, answer: str) -> None:
    eta = radians(100.0)
    place = crossings(HILL, POLAR, x0, 30.0, eta, 40.0)[-1]
    reported = wind_sensitivity(HILL, POLAR, place, eta)
    heights = [
        crossings(HillField(wind, 20.0), POLAR, place.x_m, place.z_m, eta, 1.0)[-1].z_m
        for wind in (8.995, 9.005)
    ]
    moved = (heights[1] - heights[0]) / sin(eta) / 0.01
    assert reported.along_m_per_mps == pytest.approx(moved, rel=1e-3)  # second order in 0.005 m/s
    assert reported.answer == answer
    u = place.wind_mps
    assert reported.margin == pytest.approx(polar_sink(POLAR, u) / u - polar_slope(POLAR, u))


def test_wind_does_not_move_the_place_at_best_glide() -> None:
    """Best glide of the polar is √(c0 / c2); updraft proportional to wind then keeps pace."""
    best = sqrt(POLAR.c0 / POLAR.c2)
    eta = radians(100.0)
    line = contour(HILL, POLAR, (-45.0, -1.0, 5.0, 60.0), 0.5)[0]
    u = HILL.wind(line[:, 0], 0.0, line[:, 1])[0]
    x, z = line[int(np.argmin(np.abs(u - best)))].tolist()
    place = min(crossings(HILL, POLAR, x, z, eta, 1.0), key=lambda c: abs(c.z_m - z))
    reported = wind_sensitivity(HILL, POLAR, place, eta)
    assert abs(reported.margin) < 0.01
    moved = crossings(HillField(9.1, 20.0), POLAR, x, z, eta, 2.0)[-1].z_m - place.z_m
    assert abs(moved) < 0.02  # of a contour some 30 m high, for 1 % of wind


def test_core_over_the_hill_is_on_its_flank() -> None:
    """Level polar: most updraft at the surface where θ = 135°, w = U."""
    best = core(HILL, LEVEL, (-40.0, -1.0, 1.0, 40.0), 0.5)
    assert (best.x_m, best.z_m) == pytest.approx((-20.0 * sqrt(0.5), 20.0 * sqrt(0.5)), abs=0.2)
    assert best.excess_mps == pytest.approx(9.0 - 1.0, abs=0.15)


def test_undefined_outside_the_polar_and_the_field() -> None:
    narrow = POLAR._replace(speed_max_mps=9.0)
    values = excess_updraft(HILL, narrow, [-30.0, 0.0, -5.0], [20.0, 21.0, 5.0])
    assert np.isfinite(values[0])
    assert np.isnan(values[1:]).all()  # too fast on top; in the hill
    assert np.isnan(excess_at(HILL, narrow, 0.0, 21.0))
    assert excess_at(HILL, narrow, -30.0, 20.0) == pytest.approx(values[0])


def test_a_wind_from_behind_is_no_airspeed() -> None:
    """An aircraft at rest in it would fly backwards: no place of the contour, however it lifts."""
    behind = Dome(1.0, oblique_rad=pi)
    assert isnan(excess_at(behind, LEVEL, 0.3, 0.2))
    assert np.isnan(excess_updraft(behind, LEVEL, 0.3, 0.2))
    assert crossings(behind, LEVEL, 0.0, 0.0, radians(80.0), 1.5) == []


@pytest.mark.parametrize(
    ("field", "polar", "help_"),
    [
        (HillField(3.0, 20.0), LEVEL._replace(c0=4.0), "steepen the slope"),
        (HillField(30.0, 20.0), POLAR, "within the glide polar's range"),
        (HILL, LEVEL._replace(c0=-30.0), "widen the bounds"),
    ],
)
def test_no_contour_says_why_and_what_would_help(
    field: HillField, polar: GlidePolar, help_: str
) -> None:
    with pytest.raises(ZeucError, match=help_) as reported:
        contour(field, polar, (-28.0, -20.0, 20.0, 30.0), 0.5)
    assert "m/s" in str(reported.value)


@pytest.mark.parametrize("eta", [0.0, pi, -1.0, float("nan")])
def test_refuses_a_line_without_an_upper_end(eta: float) -> None:
    with pytest.raises(ValueError, match="eta"):
        crossings(HILL, POLAR, -24.0, 20.0, eta, 5.0)


def test_refuses_bounds_and_steps_that_are_none() -> None:
    with pytest.raises(ValueError, match="bounds in x"):
        contour(HILL, LEVEL, (-1.0, -5.0, 0.0, 1.0), 0.1)
    with pytest.raises(ValueError, match="step"):
        contour(HILL, LEVEL, (-5.0, -1.0, 0.0, 1.0), 0.0)
    with pytest.raises(ValueError, match="reach"):
        crossings(HILL, POLAR, -24.0, 20.0, 1.6, 0.0)


def test_a_line_along_the_contour_has_no_sensitivity_to_give() -> None:
    place = crossings(Dome(1.0), LEVEL, 1.0, 0.0, radians(170.0), 0.5)[0]
    assert (place.x_m, place.z_m) == pytest.approx((1.0, 0.0), abs=1e-5)
    beside = place._replace(x_m=1.0, z_m=0.0)
    with pytest.raises(ZeucError, match="along the contour"):
        wind_sensitivity(Dome(1.0), LEVEL, beside, 0.5 * pi)

"""The contour in made-up fields whose excess updraft is a formula: what is where, and what is not.

With a polar that sinks by 1 m/s at any speed, excess updraft is whatever the field's updraft is
beyond 1 m/s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, cos, hypot, isnan, pi, radians, sin

import numpy as np
import pytest
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.air.zeuc import (
    Crossing,
    ZeucError,
    contour,
    core,
    crossings,
    excess_at,
    excess_gradient,
    excess_updraft,
    feasible_leans,
    slope_along,
    stable_crossing,
    wind_sensitivity,
)
from tgl_soar.types import GlidePolar, polar_sink

LEVEL = GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=20.0)
CUBIC = GlidePolar(c0=9.0, c1=-2.0, c2=0.12, c3=0.004, speed_min_mps=7.0, speed_max_mps=14.0)
UP = 0.5 * pi
Formula = Callable[[FloatArray, FloatArray, FloatArray, float], FloatArray]


@dataclass
class Made:
    """A uniform horizontal wind, and an excess updraft of x, y, z and time."""

    excess: Formula
    u_mps: float = 10.0
    v_mps: float = 0.0
    reach_m: float = 1e3  # how far from the middle there is air
    sink_mps: float = 1.0
    factor: float = 1.0  # of the wind, in all its parts
    reference_wind_mps: float = 10.0

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y, z = broadcast(x_m, y_m, z_m)
        w = self.sink_mps + self.excess(x, y, z, time_s)
        u, v = np.full_like(x, self.u_mps), np.full_like(x, self.v_mps)
        return self.factor * u, self.factor * v, self.factor * w

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        u, v, w = self.wind(x_m, y_m, z_m, time_s)
        return float(u), float(v), float(w)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        return max(abs(x_m), abs(y_m), abs(z_m)) <= self.reach_m


def plane(dx: float, dz: float, **keys: float) -> Made:
    """Excess that grows by so much a metre [m/s per m]."""
    return Made(lambda x, _y, z, _t: dx * x + dz * z, **keys)


# What falls with height, and comes up with y and with time.
LATER = Made(lambda _x, y, z, t: y + 2.0 * t - z)


# --- excess updraft ------------------------------------------------------------------------------


def test_excess_is_the_updraft_less_the_polars_sink_at_the_horizontal_wind() -> None:
    field = Made(lambda x, _y, z, _t: 0.1 * x + 0.2 * z, u_mps=6.0, v_mps=-8.0)
    # 10 m/s of wind: 9 − 20 + 12 + 4 = 5 m/s of sink.
    expected = 1.0 + 0.1 * 2.0 + 0.2 * 3.0 - 5.0
    assert excess_at(field, CUBIC, 2.0, 3.0) == pytest.approx(expected)
    assert float(excess_updraft(field, CUBIC, 2.0, 3.0)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("u_mps", "defined"), [(4.9, False), (5.1, True), (19.9, True), (20.1, False), (-10.0, False)]
)
def test_excess_is_defined_between_the_polars_speeds(u_mps: float, defined: bool) -> None:
    field = plane(0.0, 0.0, u_mps=u_mps)
    assert isnan(excess_at(field, LEVEL, 0.0, 0.0)) != defined
    assert np.isnan(excess_updraft(field, LEVEL, 0.0, 0.0)) != defined


def test_the_slope_along_the_line_is_that_of_the_polar_by_the_winds_fraction() -> None:
    """By small differences of sink(√(u² + v²)) in u alone."""
    h = 1e-5
    for u, v in ((10.0, 0.0), (8.0, 6.0), (8.0, -6.0), (0.5, 10.0)):
        expected = polar_sink(CUBIC, hypot(u + h, v)) - polar_sink(CUBIC, hypot(u - h, v))
        assert slope_along(CUBIC, u, v) == pytest.approx(expected / (2.0 * h), rel=1e-6)
    assert isnan(slope_along(CUBIC, 0.0, 8.0))
    assert isnan(slope_along(CUBIC, -8.0, 6.0))


@pytest.mark.parametrize(("inwards_m", "known"), [(0.019, False), (0.021, True)])
def test_a_gradient_needs_two_centimetres_of_air_to_each_side(
    inwards_m: float, known: bool
) -> None:
    field = plane(3.0, -4.0, reach_m=2.0)
    x, _ = excess_gradient(field, LEVEL, 2.0 - inwards_m, 0.0)
    _, z = excess_gradient(field, LEVEL, 0.0, -2.0 + inwards_m)
    assert (not isnan(x), not isnan(z)) == (known, known)
    if known:
        assert (x, z) == pytest.approx((3.0, -4.0))


def test_each_of_them_is_asked_for_a_slice_and_a_time_of_which_zero_is_usual() -> None:
    """Here excess is zero at the height y + 2 t."""
    for where, height in (((), 0.0), ((1.5,), 1.5), ((0.0, 0.25), 0.5), ((1.5, 0.25), 2.0)):
        assert excess_at(LATER, LEVEL, 0.0, 0.0, *where) == pytest.approx(height)
        assert float(excess_updraft(LATER, LEVEL, 0.0, 0.0, *where)) == pytest.approx(height)
        (crossing,) = crossings(LATER, LEVEL, 0.0, 0.0, UP, 5.0, *where)
        assert crossing.z_m == pytest.approx(height, abs=1e-6)
        (line,) = contour(LATER, LEVEL, (-1.0, 1.0, -3.03, 3.0), 0.5, *where)
        assert line[:, 1] == pytest.approx(height, abs=1e-6)
        best = core(LATER, LEVEL, (-1.0, 1.0, -3.0, 3.0), 0.5, *where)
        assert best.excess_mps == pytest.approx(3.0 + height)
    bent = Made(lambda x, y, z, t: (y + t) * x - z)
    assert excess_gradient(bent, LEVEL, 0.0, 0.0) == pytest.approx((0.0, -1.0))
    assert excess_gradient(bent, LEVEL, 0.0, 0.0, 2.0, 1.0) == pytest.approx((3.0, -1.0))
    low, high = feasible_leans(bent, LEVEL, 0.0, 0.0, 0.0, 0.0)
    assert (low, high) == pytest.approx((-UP, UP))
    tilted = feasible_leans(bent, LEVEL, 0.0, 0.0, 2.0, 1.0)
    assert feasible_leans(bent, LEVEL, 0.0, 0.0) == (low, high)
    # −∇E points to (−3, 1): along t within 90° of it, and upwards.
    assert tilted == pytest.approx((atan(3.0) - UP, UP))
    at = Crossing(
        x_m=0.0, z_m=0.0, wind_mps=10.0, updraft_mps=1.0, excess_slope_per_s=-1.0, stable=True
    )
    # Of 10 m/s of wind and 1 m/s of sink: a tenth of a metre per m/s over the slope along it.
    for where, slope in (((), -1.0), ((2.0, 1.0), 3.0 * cos(1.3) - sin(1.3))):
        eta = UP if not where else 1.3
        shift = wind_sensitivity(bent, LEVEL, at, eta, *where).along_m_per_mps
        assert shift == pytest.approx(-0.1 / slope)


# --- lines ---------------------------------------------------------------------------------------


def waves(**keys: float) -> Made:
    """Zero at every half metre of height; falling through it at whole ones."""
    return Made(lambda _x, _y, z, _t: -np.sin(2.0 * pi * z), **keys)


def test_crossings_come_from_below_to_above_within_reach_and_every_other_is_stable() -> None:
    found = crossings(waves(), LEVEL, 3.0, 0.1, UP, 1.3)
    assert [c.z_m for c in found] == pytest.approx([-1.0, -0.5, 0.0, 0.5, 1.0], abs=1e-6)
    assert [c.x_m for c in found] == pytest.approx([3.0] * 5)
    assert [c.stable for c in found] == [True, False, True, False, True]
    slopes = [c.excess_slope_per_s for c in found]
    # Over two centimetres a sine of 2π per metre is straight to 3 in a thousand.
    assert slopes == pytest.approx([-2 * pi, 2 * pi, -2 * pi, 2 * pi, -2 * pi], rel=3e-3)
    assert {c.wind_mps for c in found} == {10.0}
    assert [c.updraft_mps for c in found] == pytest.approx([1.0] * 5, abs=1e-5)


def test_crossings_a_few_centimetres_apart_are_told_apart() -> None:
    field = Made(lambda _x, _y, z, _t: (z - 0.502) * (z - 0.531))
    found = crossings(field, LEVEL, 0.0, 0.0, UP, 1.0)
    assert [c.z_m for c in found] == pytest.approx([0.502, 0.531], abs=1e-6)


def test_crossings_are_looked_for_every_centimetre() -> None:
    """Two that are 15 mm apart, with one of the centimetres between them."""
    field = Made(lambda _x, _y, z, _t: (z - 0.502) * (z - 0.517))
    found = crossings(field, LEVEL, 0.0, 0.0, UP, 1.0)
    assert [c.z_m for c in found] == pytest.approx([0.502, 0.517], abs=1e-6)


@pytest.mark.parametrize(("above_mps", "below_mps"), [(-1.0, 1.0), (-3.0, 1.0), (-1.0, 3.0)])
def test_a_jump_of_the_field_is_no_crossing(above_mps: float, below_mps: float) -> None:
    """However it lies about zero: halves that are alike, too."""
    jump = Made(lambda _x, _y, z, _t: np.where(z > 0.013, above_mps, below_mps))
    assert crossings(jump, LEVEL, 0.0, 0.0, UP, 2.0) == []
    steep = Made(lambda _x, _y, z, _t: np.clip(-1e3 * (z - 0.013), -1.0, 1.0))
    (crossing,) = crossings(steep, LEVEL, 0.0, 0.0, UP, 2.0)
    assert crossing.z_m == pytest.approx(0.013, abs=1e-5)


def test_an_exact_zero_between_two_nodes_is_found_where_it_is() -> None:
    path = np.linspace(-0.5, 0.5, 101)
    middle = 0.5 * (float(path[30]) + float(path[31]))
    for sign in (-1.0, 1.0):
        field = Made(lambda _x, _y, z, _t, sign=sign: sign * (z - middle))  # type: ignore[misc]
        assert excess_at(field, LEVEL, 0.0, middle) == 0.0
        (crossing,) = crossings(field, LEVEL, 0.0, 0.0, UP, 0.5)
        assert crossing.z_m == pytest.approx(middle, abs=1e-6)


def test_an_exact_zero_on_a_node_is_found_once() -> None:
    (crossing,) = crossings(plane(0.0, -1.0), LEVEL, 0.0, 0.0, UP, 0.5)
    assert crossing.z_m == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("height_mps", "found"), [(0.0, 1), (5.0, 0)])
def test_where_excess_jumps_there_is_no_crossing(height_mps: float, found: int) -> None:
    field = Made(lambda _x, _y, z, _t: -(z - 0.123) - height_mps * np.sign(z - 0.123))
    assert len(crossings(field, LEVEL, 0.0, 0.0, UP, 1.0)) == found


def test_a_small_jump_between_nodes_is_none_either() -> None:
    """Over one centimetre a slope of 1 per s makes 0.01 m/s; here a tenth of it jumps, and more."""

    def broken(jump: float) -> Made:
        return Made(lambda _x, _y, z, _t: 0.123 - z - 0.5 * jump * np.sign(z - 0.123))

    for jump, found in ((0.0005, 1), (0.002, 0)):
        assert len(crossings(broken(jump), LEVEL, 0.0, 0.0, UP, 1.0)) == found, jump


def test_where_excess_only_touches_zero_nothing_is_stable() -> None:
    """Between growing and falling: a metre further up or down the aircraft sinks away."""
    (crossing,) = crossings(Made(lambda _x, _y, z, _t: -z * z), LEVEL, 0.0, 0.0, UP, 0.5)
    assert (crossing.z_m, crossing.excess_slope_per_s) == (0.0, 0.0)
    assert not crossing.stable


def test_a_hole_between_two_nodes_is_no_crossing() -> None:
    field = Made(lambda _x, _y, z, _t: np.where(np.abs(z - 0.125) < 1e-3, np.nan, 0.125 - z))
    assert crossings(field, LEVEL, 0.0, 0.0, UP, 1.0) == []


def test_a_place_is_stable_where_excess_falls_and_airspeed_answers() -> None:
    """Flat lines: sliding down them changes the airspeed, and with it the sink, by more."""
    slope = slope_along(CUBIC, 12.0, 0.0)
    assert slope > 0.5
    sink = polar_sink(CUBIC, 12.0)
    field = plane(-1.0, -1.0, u_mps=12.0, sink_mps=sink)
    limit = atan(slope)
    for off, stable in ((-0.02, False), (0.02, True)):
        (crossing,) = crossings(field, CUBIC, 0.0, 0.0, limit + off, 1.0)
        assert crossing.stable is stable
    (rising,) = crossings(plane(1.0, 1.0, u_mps=12.0, sink_mps=sink), CUBIC, 0.0, 0.0, UP, 1.0)
    assert not rising.stable


def test_the_stable_crossing_nearest_to_the_lines_point_is_taken() -> None:
    for z0, expected in ((0.3, 0.0), (0.6, 1.0), (-0.4, 0.0)):
        found = stable_crossing(waves(), LEVEL, (0.0, z0, UP))
        assert found is not None
        assert found.z_m == pytest.approx(expected, abs=1e-6)
    leaning = stable_crossing(plane(1.0, 0.0), LEVEL, (1.0, 0.0, radians(135.0)))
    assert leaning is not None
    assert (leaning.x_m, leaning.z_m) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert stable_crossing(plane(0.0, 1.0), LEVEL, (0.0, 0.0, UP)) is None


@pytest.mark.parametrize(("away_m", "found"), [(3.98, True), (4.02, False)])
def test_a_line_reaches_four_metres_by_default(away_m: float, found: bool) -> None:
    field = plane(0.0, -1.0)
    for side in (-1.0, 1.0):
        line = (0.0, side * away_m, UP)
        assert (stable_crossing(field, LEVEL, line) is not None) is found
        assert stable_crossing(field, LEVEL, line, reach_m=5.0) is not None
    now, later = (stable_crossing(LATER, LEVEL, (0.0, 0.0, UP), *time) for time in ((), (1.0,)))
    assert now is not None
    assert later is not None
    assert (now.z_m, later.z_m) == pytest.approx((0.0, 2.0), abs=1e-6)
    assert stable_crossing(LATER, LEVEL, (0.0, 0.0, UP), 2.1) is None


@pytest.mark.parametrize("reach", [0.0, -1.0, float("inf"), float("nan")])
def test_a_reach_that_is_none_is_refused(reach: float) -> None:
    with pytest.raises(ValueError, match=r"reach .* must be positive"):
        crossings(waves(), LEVEL, 0.0, 0.0, UP, reach)


def test_even_a_short_line_is_searched() -> None:
    found = crossings(plane(0.0, -1.0), LEVEL, 0.0, 0.001, UP, 0.002)
    assert [c.z_m for c in found] == pytest.approx([0.0], abs=1e-6)


# --- contours ------------------------------------------------------------------------------------


@pytest.mark.parametrize("excess", [0.03, -0.03])
@pytest.mark.parametrize(("x0", "z0"), [(0.0, 0.0), (5.0, 2.0)])
def test_at_a_saddle_the_branches_stay_apart(excess: float, x0: float, z0: float) -> None:
    """x z = −c: two hyperbolas, in the quadrants where x z has the sign of −c, none crosses 0."""
    field = Made(lambda x, _y, z, _t: (x - x0) * (z - z0) + excess)
    bounds = (x0 - 2.1, x0 + 2.1, z0 - 2.1, z0 + 2.1)
    lines = contour(field, LEVEL, bounds, 0.6)  # a cell around the middle
    assert len(lines) == 2
    for line in lines:
        x, z = line[:, 0] - x0, line[:, 1] - z0
        assert x * z == pytest.approx(-excess, abs=1e-5)
        assert len(set(np.sign(x).tolist())) == 1
    assert {np.sign(line[0, 0] - x0) for line in lines} == {1.0, -1.0}


def discs(x: FloatArray, _y: FloatArray, z: FloatArray, _t: float) -> FloatArray:
    """Above zero within 1 m of (0, 0), and within 0.5 m of (3, 0)."""
    large = 1.0 - np.hypot(x, z)
    small = 0.5 - np.hypot(x - 3.0, z)
    return np.maximum(large, small)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_longest_contour_comes_first(side: float) -> None:
    field = Made(lambda x, y, z, t: discs(side * x, y, z, t))
    low, high = sorted((-1.52 * side, 4.01 * side))
    lines = contour(field, LEVEL, (low, high, -1.53, 1.51), 0.1)
    assert [round(float(line[:, 0].mean())) for line in lines] == [0, 3 * side]
    for line, radius in zip(lines, (1.0, 0.5), strict=True):
        length = float(np.hypot(*np.diff(line, axis=0).T).sum())
        assert length == pytest.approx(2.0 * pi * radius, rel=0.02)
        assert line[0] == pytest.approx(line[-1])


def test_a_contour_through_nodes_is_one_line_without_repeats() -> None:
    (line,) = contour(plane(0.0, 1.0), LEVEL, (-1.0, 1.0, -1.0, 1.0), 0.5)
    assert line[:, 1] == pytest.approx(0.0, abs=1e-6)
    assert sorted(line[:, 0].tolist()) == pytest.approx([-1.0, -0.5, 0.0, 0.5, 1.0])


def test_a_contour_ends_where_the_air_does() -> None:
    """Within 2.2 m of the middle; the last cell that is air on all corners ends at 2 m."""
    (line,) = contour(plane(0.0, 1.0, reach_m=2.2), LEVEL, (-3.0, 3.0, -1.03, 1.0), 0.5)
    assert (line[:, 0].min(), line[:, 0].max()) == (-2.0, 2.0)


def test_a_vertical_contour_is_found_as_a_level_one_is() -> None:
    (line,) = contour(plane(1.0, 0.0), LEVEL, (-1.03, 1.0, -1.0, 1.0), 0.5)
    assert line[:, 0] == pytest.approx(0.0, abs=1e-6)
    assert sorted(line[:, 1].tolist()) == pytest.approx([-1.0, -0.5, 0.0, 0.5, 1.0])


@pytest.mark.parametrize(
    ("bounds", "step", "says"),
    [
        ((1.0, 1.0, 0.0, 1.0), 0.1, "bounds in x: 1.0 … 1.0 m must increase"),
        ((0.0, 1.0, 2.0, 1.0), 0.1, "bounds in z: 2.0 … 1.0 m must increase"),
        ((float("nan"), 1.0, 0.0, 1.0), 0.1, "bounds in x"),
        ((0.0, float("inf"), 0.0, 1.0), 0.1, "bounds in x"),
        ((0.0, 1.0, 0.0, 1.0), -0.1, "step -0.1 m: must be positive"),
        ((0.0, 1.0, 0.0, 1.0), 0.0, "step 0.0 m: must be positive"),
        ((0.0, 2.0, 0.0, 1.0), 1.1, "at most the span in z"),
        ((0.0, 1.0, 0.0, 1.0), float("nan"), "step nan m"),
    ],
)
def test_bounds_must_span_a_step(
    bounds: tuple[float, float, float, float], step: float, says: str
) -> None:
    for search in (contour, core):
        with pytest.raises(ValueError, match=says):
            search(plane(0.0, 1.0), LEVEL, bounds, step)


def test_a_step_may_be_the_whole_span() -> None:
    (line,) = contour(plane(0.0, 1.0), LEVEL, (0.0, 1.0, -0.4, 0.6), 1.0)
    assert line[:, 1] == pytest.approx(0.0, abs=1e-6)


def test_where_there_is_no_contour_the_numbers_say_why() -> None:
    bounds = (1.0, 2.0, 3.0, 5.0)
    with pytest.raises(ZeucError) as caught:
        contour(plane(0.0, 0.0, u_mps=30.0), LEVEL, bounds, 0.5)
    words = str(caught.value)
    assert "x 1.00 … 2.00 m, z 3.00 … 5.00 m" in words
    assert "wind (30.00 … 30.00 m/s) is nowhere within" in words
    assert "(5.00 … 20.00 m/s)" in words
    # 9 − 2 V + 0.12 V² + 0.004 V³ is least where −2 + 0.24 V + 0.012 V² = 0: at 6.3 m/s, below
    # the polar's 7 m/s.
    weak = Made(lambda x, _y, _z, _t: -3.0 - 0.5 * x, v_mps=0.0)
    with pytest.raises(ZeucError) as caught:
        contour(weak, CUBIC, bounds, 0.5)
    words = str(caught.value)
    assert "least sink 2.25 m/s (at 7.00 m/s)" in words
    assert "greatest updraft -2.50 m/s" in words  # at x = 1
    assert "excess updraft -8.00 … -7.50 m/s; steepen the slope" in words
    with pytest.raises(ZeucError, match="updraft exceeds sink everywhere"):
        contour(plane(0.0, 1.0), LEVEL, bounds, 0.5)
    best = LEVEL._replace(c0=6.0, c1=-1.0, c2=0.05)  # 1 m/s at 10 m/s
    with pytest.raises(ZeucError, match=r"least sink 1\.00 m/s \(at (9\.9|10\.0)\d m/s\)"):
        contour(plane(0.0, 1.0), best, bounds, 0.5)


def test_an_undefined_place_takes_no_part_in_what_is_reported() -> None:
    half = Made(lambda x, _y, _z, _t: np.where(x > 0.5, 9.0, -2.0), reach_m=0.5)
    with pytest.raises(ZeucError, match=r"greatest updraft -1\.00 m/s .* -2\.00 … -2\.00 m/s"):
        contour(half, LEVEL, (-0.5, 1.0, 0.0, 0.5), 0.25)


# --- leans ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction_deg", range(10, 370, 30))
def test_feasible_leans_are_all_those_and_only_those_that_are_stable(direction_deg: int) -> None:
    """Tried lean by lean: excess falls up the line, and sin η > S′ cos η."""
    dx, dz = cos(radians(direction_deg)), sin(radians(direction_deg))
    sink = polar_sink(CUBIC, 12.0)
    field = plane(dx, dz, u_mps=12.0, sink_mps=sink)
    slope = slope_along(CUBIC, 12.0, 0.0)
    leans = np.radians(np.arange(-89.75, 90.0, 0.5))
    eta = leans + UP
    stable = (dx * np.cos(eta) + dz * np.sin(eta) < 0.0) & (np.sin(eta) > slope * np.cos(eta))
    if not stable.any():
        with pytest.raises(ZeucError, match=r"no line is stable at x 0\.000 m, z 0\.000 m"):
            feasible_leans(field, CUBIC, 0.0, 0.0)
        return
    low, high = feasible_leans(field, CUBIC, 0.0, 0.0)
    assert [low < lean < high for lean in leans.tolist()] == stable.tolist()


def test_leans_of_a_place_without_air_beside_it_are_refused() -> None:
    for field in (plane(1.0, 1.0, reach_m=0.0), plane(1.0, 1.0, u_mps=-10.0)):
        with pytest.raises(ZeucError, match=r"undefined at x 0\.000 m, z 0\.000 m \(wind 10\.00"):
            feasible_leans(field, LEVEL, 0.0, 0.0)


# --- what a stronger wind does -------------------------------------------------------------------


@pytest.mark.parametrize("u_mps", [7.5, 9.0, 13.0])
@pytest.mark.parametrize("eta_deg", [80.0, 110.0])
def test_a_stronger_wind_moves_the_place_as_the_contour_moves(u_mps: float, eta_deg: float) -> None:
    """The same field with a thousandth more of all of it, and where its crossing has gone."""
    eta, sink = radians(eta_deg), polar_sink(CUBIC, u_mps)
    field = plane(-0.3, -0.8, u_mps=u_mps, sink_mps=sink)
    (here,) = crossings(field, CUBIC, 0.0, 0.0, eta, 3.0)
    found = wind_sensitivity(field, CUBIC, here, eta)
    places = []
    for factor in (0.9999, 1.0001):
        field.factor = factor
        (there,) = crossings(field, CUBIC, 0.0, 0.0, eta, 3.0)
        places.append(there.z_m / sin(eta))
    per_mps = (places[1] - places[0]) / (0.0002 * field.reference_wind_mps)
    assert found.along_m_per_mps == pytest.approx(per_mps, rel=2e-2)  # of places to a micrometre
    assert found.answer == ("rise" if per_mps > 0.01 else "fall" if per_mps < -0.01 else "stay")
    assert (found.margin > 0.0) == (per_mps > 0.0)


@pytest.mark.parametrize(("per_s", "answer"), [(9.0, "rise"), (11.0, "stay")])
def test_a_centimetre_for_a_metre_per_second_is_no_move(per_s: float, answer: str) -> None:
    """Of 10 m/s of wind and 1 m/s of sink: a tenth of a metre per m/s over the slope."""
    field = plane(0.0, -per_s)
    (here,) = crossings(field, LEVEL, 0.0, 0.0, UP, 1.0)
    found = wind_sensitivity(field, LEVEL, here, UP)
    assert found.along_m_per_mps == pytest.approx(0.1 / per_s)
    assert found.answer == answer


@pytest.mark.parametrize("u_mps", [4.0, 21.0])
def test_in_a_wind_beyond_the_polar_there_is_no_answer(u_mps: float) -> None:
    beside = Crossing(
        x_m=0.0, z_m=0.0, wind_mps=u_mps, updraft_mps=1.0, excess_slope_per_s=-1.0, stable=True
    )
    with pytest.raises(ZeucError, match=r"no slope along the line \(0\.0° lean\)"):
        wind_sensitivity(plane(0.0, -1.0), LEVEL, beside, UP)


# --- the core ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "z"), [(0.137, 2.468), (-0.731, 1.111), (0.02, 3.99)])
def test_the_core_is_found_to_millimetres_between_the_nodes(x: float, z: float) -> None:
    field = Made(lambda px, _y, pz, _t: 2.0 - (px - x) ** 2 - 3.0 * (pz - z) ** 2)
    best = core(field, LEVEL, (-1.0, 1.0, 0.0, 4.0), 0.5)
    assert (best.x_m, best.z_m) == pytest.approx((x, z), abs=2e-3)
    assert best.excess_mps == pytest.approx(2.0, abs=2e-5)
    assert (best.wind_mps, best.updraft_mps) == pytest.approx((10.0, 3.0), abs=2e-5)


@pytest.mark.parametrize("off", [0.0, 0.0004, 0.0008, 0.0012, 0.0016, 0.002, 0.0024, 0.0028])
def test_a_core_is_no_millimetre_off(off: float) -> None:
    field = Made(lambda x, _y, z, _t: 2.0 - (x - 0.25 - off) ** 2 - (z - 2.25 + off) ** 2)
    best = core(field, LEVEL, (-1.0, 1.0, 0.0, 4.0), 0.5)
    assert abs(best.x_m - 0.25 - off) < 1e-3
    assert abs(best.z_m - 2.25 + off) < 1e-3


def test_where_all_of_the_air_is_alike_a_core_is_anywhere() -> None:
    best = core(plane(0.0, 0.0), LEVEL, (-1.0, 1.0, 0.0, 1.0), 0.5)
    assert (best.excess_mps, best.updraft_mps, best.wind_mps) == (0.0, 1.0, 10.0)


def test_the_wind_of_a_core_and_of_a_crossing_is_the_whole_horizontal_one() -> None:
    field = Made(lambda _x, _y, pz, _t: 1.0 - pz, u_mps=6.0, v_mps=8.0)
    assert core(field, LEVEL, (-1.0, 1.0, 0.0, 4.0), 0.5).wind_mps == pytest.approx(10.0)
    (met,) = crossings(field, LEVEL, 0.0, 0.0, UP, 4.0)
    assert met.wind_mps == pytest.approx(10.0)


@pytest.mark.parametrize(("dx", "dz"), [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_a_core_at_the_border_stays_within_it(dx: float, dz: float) -> None:
    best = core(plane(dx, dz), LEVEL, (-1.0, 2.0, -3.0, 4.0), 0.5)
    if dx:
        assert best.x_m == (2.0 if dx > 0.0 else -1.0)
    else:
        assert best.z_m == (4.0 if dz > 0.0 else -3.0)


def test_where_excess_is_nowhere_defined_there_is_no_core() -> None:
    with pytest.raises(ZeucError, match="nowhere within the glide polar's range"):
        core(plane(1.0, 0.0, u_mps=40.0), LEVEL, (-1.0, 1.0, -1.0, 1.0), 0.5)

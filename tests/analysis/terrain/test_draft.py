"""A drafted site on ground that is a formula: wind, crest, fence, lines and landing place, each by
how it is described, and what ground and wind must not lack."""

from __future__ import annotations

from functools import lru_cache
from math import atan, cos, degrees, radians, sin
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from tgl_soar.air.wind_record import oblique_field
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.terrain.draft import (
    DraftError,
    Request,
    SiteDraft,
    _crest,
    _landing,
    _wind_from,
    draft,
    heights_m,
)
from tgl_soar.config.site import GroundProfile, SiteOrigin
from tgl_soar.control.envelope import clearance
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import GlidePolar, polar_sink

# Sinks 1.3 m/s at least, at 8 m/s, and glides 1 in 6.4 at best.
POLAR = GlidePolar(c0=3.22, c1=-0.48, c2=0.03, c3=0.0, speed_min_mps=6.0, speed_max_mps=14.0)
REQUEST = Request(
    ridge_deg=0.0,
    wind_from_deg=None,
    wind_mps=9.0,
    reach_m=200.0,
    half_width_m=40.0,
    clearance_m=5.0,
    ceiling_m=60.0,
)
REACH_LOOKED_M = 50.0  # a quarter of the reach

Floats = NDArray[np.float64]


class Ground:
    """Heights that depend on the distance to one side [m], here to the east unless it is turned."""

    def __init__(self, height: Any, up_deg: float = 90.0) -> None:
        self.elevation = SimpleNamespace(spacing_m=10.0)
        self._height, self._up_rad = height, radians(up_deg)

    def up_m(self, north_m: ArrayLike, east_m: ArrayLike) -> Floats:
        north, east = np.asarray(north_m, dtype=float), np.asarray(east_m, dtype=float)
        return np.asarray(self._height(cos(self._up_rad) * north + sin(self._up_rad) * east))


def bank(s: Floats) -> Floats:
    """A slope of 50 m down to the west, steepest 20 m west of the home."""
    return np.asarray(25.0 * (np.tanh((s + 20.0) / 25.0) - np.tanh(0.8)))


def tent(top_m: float, slope: float = 0.4) -> Any:
    """Falls alike to both sides of a ridge."""
    return lambda s: -slope * np.abs(s - top_m)


def ground(height: Any = bank, up_deg: float = 90.0) -> Any:
    return Ground(height, up_deg)


@lru_cache(maxsize=4)
def drafted(**changes: Any) -> SiteDraft:
    return draft(ground(), REQUEST._replace(**changes), POLAR)


# --- the wind -----------------------------------------------------------------------------------


@pytest.mark.parametrize("up_deg", [0.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("turned_deg", [0.0, 180.0])
def test_the_wind_blows_straight_at_the_side_to_which_the_ground_falls(
    up_deg: float, turned_deg: float
) -> None:
    """Whichever end of the ridge its direction is given from."""
    asked = REQUEST._replace(ridge_deg=up_deg + 90.0 + turned_deg)
    wind = _wind_from(ground(up_deg=up_deg), asked)
    assert wind == pytest.approx((up_deg + 180.0) % 360.0)


@pytest.mark.parametrize(("slope", "known"), [(0.049, False), (0.051, True)])
def test_ground_that_falls_alike_to_both_sides_needs_the_winds_direction(
    slope: float, known: bool
) -> None:
    """Alike: to a twentieth of the distance that is looked at, of the means to either side.

    Evenly sampled up to it, the mean of a slope is that of 21 fortieths of it; two sides differ by
    twice as much.
    """
    steep = slope * 40.0 / 42.0
    sides = ground(lambda s: steep * s)
    if known:
        assert _wind_from(sides, REQUEST) == 270.0
    else:
        with pytest.raises(DraftError, match=r"\+1\.2 and -1\.2 m\): say by --wind-from"):
            _wind_from(sides, REQUEST)


@pytest.mark.parametrize(
    ("wind_deg", "found"),
    [(270.0, 270.0), (-90.0, 270.0), (314.0, 314.0), (226.0, 226.0), (45.0, 45.0), (134.9, 134.9)],
)
def test_a_wind_that_is_given_is_taken_up_to_45_degrees_off(wind_deg: float, found: float) -> None:
    assert _wind_from(ground(), REQUEST._replace(wind_from_deg=wind_deg)) == pytest.approx(found)


@pytest.mark.parametrize(("wind_deg", "off"), [(316.0, 46), (0.0, 90), (136.0, 46), (223.0, 47)])
def test_a_wind_along_the_ridge_is_refused(wind_deg: float, off: int) -> None:
    words = rf"wind from {wind_deg:g}° blows along the ridge \(0°\), {off}° off straight at it: 45°"
    with pytest.raises(DraftError, match=words):
        _wind_from(ground(), REQUEST._replace(wind_from_deg=wind_deg))


# --- the crest ----------------------------------------------------------------------------------


def place(wind_deg: float = 270.0) -> SiteOrigin:
    return SiteOrigin(name="", wind_from_deg=wind_deg, ridge_deg=0.0)


@pytest.mark.parametrize("top_m", [-31.0, 0.0, 12.5, 49.0])
def test_the_frame_stands_on_the_crest_and_looks_at_the_wind(top_m: float) -> None:
    frame, steepest = _crest(ground(tent(top_m)), place(), 200.0, POLAR)
    assert frame.wind_from_rad == pytest.approx(radians(270.0))
    # Looked for in steps of two metres and a half.
    assert (frame.origin_north_m, frame.origin_east_m) == pytest.approx((0.0, top_m), abs=1.3)
    assert frame.origin_down_m == pytest.approx(0.0, abs=0.6)
    assert steepest == pytest.approx(degrees(atan(0.4)), abs=0.01)


def test_a_crest_further_away_is_not_found() -> None:
    frame, _ = _crest(ground(tent(80.0)), place(), 200.0, POLAR)
    assert frame.origin_east_m == pytest.approx(REACH_LOOKED_M)
    assert frame.origin_down_m == pytest.approx(0.4 * 30.0)


def test_a_slope_flatter_than_the_best_glide_carries_nobody() -> None:
    """1 in 6.4 here; of a wind 40 degrees off the slope's normal only the part across counts."""
    speed = np.linspace(6.0, 14.0, 2001)
    least = float(np.min([polar_sink(POLAR, v) / v for v in speed.tolist()]))
    for wind_deg, factor in ((270.0, 1.0), (310.0, 1.0 / cos(radians(40.0)))):
        _crest(ground(tent(0.0, 1.02 * factor * least)), place(wind_deg), 200.0, POLAR)
        with pytest.raises(DraftError, match=r"no slope within 200 m that faces a wind from") as e:
            _crest(ground(tent(0.0, 0.98 * factor * least)), place(wind_deg), 200.0, POLAR)
        angles = [degrees(atan(f * factor * least)) for f in (0.98, 1.0)]
        assert f"steepest is {angles[0]:.1f}°" in str(e.value)
        assert f"carries this airframe from {angles[1]:.1f}° on" in str(e.value)


def test_a_step_between_two_posts_is_no_slope() -> None:
    """A metre within two, over two posts of ten metres: 1 in 20 is flatter than the glide."""
    with pytest.raises(DraftError, match="no slope"):
        _crest(ground(lambda s: np.clip(0.5 * (s + 60.0), -1.0, 0.0)), place(), 200.0, POLAR)


def test_heights_are_those_of_the_frame() -> None:
    """Facing west at 10 m east and 3 m up: x to the east, y to the north."""
    frame = SoaringFrame(5.0, 10.0, -3.0, radians(270.0))
    slanted = Ground(lambda s: 0.5 * s)
    both: Any = SimpleNamespace(up_m=lambda n, e: slanted.up_m(n, e) + 0.1 * n)
    found = heights_m(both, frame, np.array([0.0, 4.0, 0.0]), np.array([0.0, 0.0, 20.0]))
    assert found == pytest.approx([5.0 + 0.5 - 3.0, 7.0 + 0.5 - 3.0, 5.0 + 2.5 - 3.0])


# --- the whole draft ----------------------------------------------------------------------------


def test_the_profile_goes_across_the_ridge_as_far_as_is_asked() -> None:
    found = drafted()
    assert found.x_m[[0, -1]].tolist() == [-200.0, 200.0]
    assert np.diff(found.x_m) == pytest.approx(np.full(len(found.x_m) - 1, 5.0))
    top = found.frame.origin_east_m
    assert found.z_m == pytest.approx(bank(found.x_m + top) + found.frame.origin_down_m)
    assert (found.wind_from_deg, found.oblique_deg, found.wind_mps) == (270.0, 0.0, 9.0)
    assert (found.half_width_m, found.clearance_m, found.ridge_deg) == (40.0, 5.0, 0.0)


def test_the_fence_holds_the_lift_in_front_of_the_crest() -> None:
    found = drafted()
    x_min, x_max, z_min, z_max = found.bounds
    assert x_max == 0.0
    assert x_min == np.floor(x_min) >= -200.0
    assert z_max <= REQUEST.ceiling_m
    inside = (found.x_m >= x_min) & (found.x_m <= 0.0)
    lowest = found.z_m[inside].min()
    assert z_min == pytest.approx(lowest + 2.5, abs=0.051)
    # Beside its upwind end nothing carries: within a step of the search some does.
    least = min(polar_sink(POLAR, v) for v in np.linspace(6.0, 14.0, 801).tolist())
    up = np.linspace(0.0, REQUEST.ceiling_m, 25)
    _, _, w = found.field.wind(np.full_like(up, x_min + 6.0), 0.0, up)
    assert w.max() > least
    _, _, w = found.field.wind(np.full_like(up, x_min - 1.0), 0.0, up)
    assert np.nanmax(w) < 1.1 * least


def test_the_ceiling_is_the_lifts_where_that_is_lower() -> None:
    """In a weak wind it ends below; it is rounded up to whole metres."""
    weak = drafted(wind_mps=6.5, ceiling_m=300.0)
    assert 40.0 < weak.bounds[3] < 300.0
    assert weak.bounds[3] == np.ceil(weak.bounds[3])
    across = np.linspace(weak.bounds[0], 0.0, 81)
    _, _, w = weak.field.wind(across, 0.0, np.full(81, weak.bounds[3]))
    assert np.nanmax(w) < 1.3  # the least sink
    _, _, w = weak.field.wind(across, 0.0, np.full(81, weak.bounds[3] - 14.0))
    assert np.nanmax(w) > 1.3


def test_the_ground_of_the_site_file_is_nowhere_below_the_ground_within_the_fence() -> None:
    found = drafted()
    x_min = found.bounds[0]
    points = np.array(found.ground.points)
    near = (found.x_m >= x_min) & (found.x_m <= -0.25 * x_min)
    over = np.interp(found.x_m[near], *points.T) - found.z_m[near]
    assert over.min() >= -1e-9
    assert over.max() == pytest.approx(found.ground.above_m, abs=0.02)
    assert points[0, 0] == pytest.approx(x_min, abs=5.0)
    assert points[-1, 0] == pytest.approx(-0.25 * x_min, abs=5.0)


def test_of_ground_that_differs_along_the_ridge_the_highest_counts() -> None:
    """Ten metres higher 40 m to the north, which the fence still allows."""

    class Rising(Ground):
        def up_m(self, north_m: ArrayLike, east_m: ArrayLike) -> Floats:
            return super().up_m(north_m, east_m) + np.maximum(0.0, np.asarray(north_m) / 4.0)

    asked = REQUEST._replace(wind_from_deg=270.0)
    higher: Any = Rising(bank)
    found, even = draft(higher, asked, POLAR), drafted()
    raised = np.interp(-60.0, *np.array(found.ground.points).T)
    assert raised - np.interp(-60.0, *np.array(even.ground.points).T) == pytest.approx(
        10.0, abs=1.5
    )
    assert found.z_m == pytest.approx(even.z_m)  # the profile itself is that of the middle


def test_the_field_covers_the_fence_with_room_for_an_overshoot() -> None:
    found = drafted()
    x_min, x_max, z_min, z_max = found.bounds
    pad = 0.15 * max(x_max - x_min, z_max - z_min)
    for x, z in ((x_min - 0.9 * pad, 30.0), (0.9 * pad, 30.0), (-50.0, z_max + 0.9 * pad)):
        assert np.isfinite(found.field.wind_at(x, 0.0, z, 0.0)[2])
    for x, z in ((x_min - 1.2 * pad, 30.0), (1.2 * pad, 30.0), (-50.0, z_max + 1.2 * pad)):
        assert not found.field.inside(x, 0.0, z)
    assert found.field.reference_wind_mps == 9.0
    top = float(np.interp(-40.0, found.x_m, found.z_m))
    assert found.field.inside(-40.0, 0.0, top + 2.0)
    assert not found.field.inside(-40.0, 0.0, top - 3.0)
    # Far above the crest the wind blows over it, faster than far away.
    assert found.field.wind_at(0.0, 0.0, 50.0, 0.0)[0] > 9.0


def test_lines_are_where_the_aircraft_settles_off_the_ground_and_off_the_fences_edges() -> None:
    found = drafted()
    x_min, x_max, z_min, z_max = found.bounds
    assert list(found.lines) == ["a", "b", "c"]
    assert found.lines["a"][0] < found.lines["b"][0] < found.lines["c"][0]
    known = GroundProfile(profile=found.ground.points).as_ground()
    air = oblique_field(found.field, 0.0)
    for x, z in found.lines.values():
        assert x_min + 0.05 * (x_max - x_min) <= x <= x_max - 0.05 * (x_max - x_min)
        assert z_min <= z <= z_max - 0.05 * (z_max - z_min)
        assert clearance(known, x, z) >= 1.5 * 5.0 - 0.1
        u, _, w = air.wind_at(x, 0.0, z, 0.0)
        assert w == pytest.approx(polar_sink(POLAR, u), abs=0.05)
        assert stable_crossing(air, POLAR, (x, z, radians(105.0)), reach_m=2.0) is not None


def test_lines_keep_one_and_a_half_times_the_least_clearance_from_the_ground() -> None:
    """The contour comes nearer than that: of its lower end nothing is taken then."""
    near, far = drafted(), drafted(clearance_m=33.0)
    for found, least in ((near, 30.0), (far, 49.5)):
        known = GroundProfile(profile=found.ground.points).as_ground()
        lowest = min(clearance(known, x, z) for x, z in found.lines.values())
        assert lowest >= least
    known = GroundProfile(profile=near.ground.points).as_ground()
    assert min(clearance(known, x, z) for x, z in near.lines.values()) < 49.5


def test_an_oblique_wind_carries_by_its_part_across_the_ridge() -> None:
    found = drafted(wind_from_deg=300.0)
    assert found.wind_from_deg == 300.0
    assert found.oblique_deg == pytest.approx(30.0)
    assert found.frame == drafted().frame
    straight = drafted()
    assert found.bounds[0] > straight.bounds[0]  # there is less lift
    assert found.field.reference_wind_mps == 9.0


def test_a_wind_too_weak_for_the_least_sink_is_refused() -> None:
    with pytest.raises(
        DraftError, match=r"wind of 0\.5 m/s: no updraft of 1\.30 m/s, the least sink"
    ):
        drafted(wind_mps=0.5)


def test_a_ceiling_below_the_contour_is_refused() -> None:
    with pytest.raises(DraftError, match=r"ceiling"):
        drafted(ceiling_m=3.0)


# --- the landing place --------------------------------------------------------------------------


def terraced(foot_m: float, slope: float = 0.0) -> Any:
    """Level to 20 m before the crest, then 1 in 2 down to a foot, from there on as given."""
    return lambda s: np.where(
        s < foot_m, 0.5 * (foot_m + 20.0) + slope * (s - foot_m), np.minimum(0.0, 0.5 * (s + 20.0))
    )


def landing(height: Any, reach_m: float = 200.0) -> tuple[float, float] | None:
    x = np.arange(-reach_m, reach_m + 1.0, 2.0)
    frame = SoaringFrame(0.0, 0.0, 0.0, radians(270.0))
    return _landing(ground(height), frame, x, np.asarray(height(x)))


def test_the_nearest_level_place_of_forty_metres_below_the_slopes_middle_is_to_land() -> None:
    """Twenty metres beyond the foot, but for a metre of rise, which is a twentieth."""
    assert landing(terraced(-100.0)) == pytest.approx((-118.0, -40.0))


@pytest.mark.parametrize(("slope", "level"), [(0.049, True), (0.051, False)])
def test_level_is_a_twentieth(slope: float, level: bool) -> None:
    found = landing(terraced(-100.0, slope))
    assert (found is not None) == level


def test_it_must_be_level_along_the_ridge_too() -> None:
    height = terraced(-100.0)

    class Rising(Ground):
        def up_m(self, north_m: ArrayLike, east_m: ArrayLike) -> Floats:
            return super().up_m(north_m, east_m) + 0.06 * np.asarray(north_m)

    x = np.arange(-200.0, 201.0, 2.0)
    rising: Any = Rising(height)
    frame = SoaringFrame(0.0, 0.0, 0.0, radians(270.0))
    assert _landing(rising, frame, x, np.asarray(height(x))) is None


def test_a_shelf_of_thirty_metres_is_too_short_to_land_on() -> None:
    def shelf(s: Floats) -> Floats:
        return np.where(s < -130.0, 0.5 * (s + 130.0) - 40.0, terraced(-100.0)(s))

    assert landing(shelf, 180.0) is None


def test_a_profile_that_ends_before_the_level_place_has_none() -> None:
    """It is 118 m before the crest, and twenty more belong to it."""
    assert landing(terraced(-100.0), 136.0) is None
    assert landing(terraced(-100.0), 138.0) is not None


def test_what_lies_above_the_slopes_middle_or_behind_the_crest_is_no_place_to_land() -> None:
    """A terrace at 5 m below the crest, where the slope goes down to 60."""
    assert (
        landing(
            lambda s: np.where(
                s < -60.0, 0.5 * (s + 60.0) - 5.0, np.minimum(0.0, -5.0 * (s < -5.0))
            )
        )
        is None
    )
    assert landing(lambda s: np.where(s > 0.0, -50.0, 0.5 * s)) is None

"""Random places to search in: each number that is drawn lies in its range, and air, ground, fence
and start belong together."""

from __future__ import annotations

from functools import lru_cache
from math import cos, radians, sin, tan
from typing import Any

import numpy as np
import pytest

from tgl_soar.air.jet import SlopeJet
from tgl_soar.analysis.search.places import (
    KINDS,
    SearchPlace,
    _air,
    _launched,
    ellipse_wind,
    place,
)
from tgl_soar.control.envelope import clearance

SEEDS = range(40)
BOARD_M = 2.45


@lru_cache(maxsize=1)
def hills() -> list[SearchPlace]:
    return [place("hill", seed) for seed in SEEDS]


def shape(hill: SearchPlace) -> tuple[float, float, float]:
    """Half its width, its height and the wind."""
    air: Any = hill.site.air
    return air.radius_m, (hill.box.z_max_m - 5.0) / 3.0, air.wind_mps


def shear(there: SearchPlace) -> float:
    _, _, words = there.words.partition("sheared by ")
    return float(words or 0.0)


def test_the_kinds_are_tunnels_and_hills() -> None:
    assert KINDS == ("tunnel", "hill")
    assert {there.kind for there in hills()} == {"hill"}
    assert [there.seed for there in hills()] == list(SEEDS)


# --- hills --------------------------------------------------------------------------------------


def test_hills_are_of_every_size_in_the_range() -> None:
    shapes = np.array([shape(hill) for hill in hills()])
    half, height, wind = shapes.T
    assert 5.0 <= half.min() < 9.0 < 36.0 < half.max() <= 40.0
    assert 0.12 <= (height / half).min() < 0.25 < 0.85 < (height / half).max() <= 1.0
    assert 7.0 <= wind.min() < 7.6 < 10.4 < wind.max() <= 11.0
    gusts = [hill.site.air.turbulence.intensity for hill in hills()]  # type: ignore[union-attr]
    assert 0.01 <= min(gusts) < 0.015 < 0.045 < max(gusts) <= 0.05
    sinks = [hill.sink_factor for hill in hills()]
    assert 0.9 <= min(sinks) < 0.93 < 1.07 < max(sinks) <= 1.1


def test_the_fence_of_a_hill_lets_three_of_its_heights_be_flown_over_before_it() -> None:
    for hill in hills():
        half, height, _ = shape(hill)
        assert hill.box.x_min_m == pytest.approx(-(half + 2.0 * height + 3.0))
        assert (hill.box.x_max_m, hill.box.z_min_m) == (0.0, 0.5)
        start = hill.site.start
        assert start is not None
        assert hill.site.parameters == {
            "WPT_X": hill.box.x_min_m - 20.0,
            "CLEAR_MIN": 1.0,
            "FENCE_Y_MAX": 16.0,
            "TGL_SLEW": 0.75,
            "FENCE_X_MIN": hill.box.x_min_m,
            "FENCE_X_MAX": 0.0,
            "FENCE_Z_MIN": 0.5,
            "FENCE_Z_MAX": hill.box.z_max_m,
            "TGL_X": start.x_m,
            "TGL_Z": start.z_m,
        }


def test_the_ground_of_a_hill_is_its_ellipse_at_eight_angles() -> None:
    for hill in hills()[:5]:
        half, height, _ = shape(hill)
        ground: Any = hill.site.ground
        x, z = np.array(ground.profile).T
        assert np.arctan2(z / height, x / half) == pytest.approx(
            np.pi * np.arange(7.0, -1.0, -1) / 7
        )
        assert np.hypot(x / half, z / height) == pytest.approx(np.ones(8))
        assert hill.ground.points == 8


def test_a_hills_start_is_in_front_of_its_top_and_above_it() -> None:
    for hill in hills():
        half, height, _ = shape(hill)
        start = hill.site.start
        assert start is not None
        assert -(half + height) <= start.x_m <= -0.15 * half
        floor = height * max(0.0, 1.0 - (start.x_m / half) ** 2) ** 0.5
        assert floor + 3.0 <= start.z_m <= floor + 5.0 + height
        assert start.y_m == 0.0
        assert clearance(hill.ground, start.x_m, start.z_m) > 1.0


def test_the_air_of_a_hill_is_that_of_the_ellipse_times_its_shear() -> None:
    """u and w grow by the shear over the fence's height, about the middle of what is flown in."""
    for hill in hills()[:12]:
        half, height, wind = shape(hill)
        steady: Any = hill.field.field  # type: ignore[attr-defined]
        box = hill.box
        for z in (0.4 * box.z_max_m, 0.95 * box.z_max_m):
            x = 0.9 * box.x_min_m
            u, w = ellipse_wind(wind, half, height, np.array([x]), np.array([z]))
            factor = 1.0 + shear(hill) * (z - 0.5 * box.z_max_m) / (box.z_max_m - box.z_min_m)
            got = steady.wind_at(x, 0.0, z, 0.0)
            # A grid of 120 cells, and a shear that is known to a hundredth.
            assert got[0] == pytest.approx(factor * u[0], rel=0.01)
            assert got[2] == pytest.approx(factor * w[0], abs=0.02 * wind)


def test_the_air_of_a_hill_is_known_three_tenths_of_the_fences_height_beyond_it() -> None:
    for hill in hills()[:5]:
        box = hill.box
        pad = 0.3 * (box.z_max_m - box.z_min_m)
        assert hill.field.inside(box.x_min_m - 0.95 * pad, 0.0, box.z_max_m)
        assert hill.field.inside(box.x_min_m, 0.0, box.z_max_m + 0.95 * pad)
        assert not hill.field.inside(-0.3 * shape(hill)[0], 0.0, 0.5 * shape(hill)[1])  # in it


def test_a_third_of_the_places_is_sheared_and_half_of_the_winds_change() -> None:
    sheared = [shear(hill) for hill in hills() if shear(hill)]
    assert 7 <= len(sheared) <= 20
    assert all(0.1 <= each <= 0.35 for each in sheared)
    changes = [hill.change for hill in hills() if hill.change != 1.0]
    assert 12 <= len(changes) <= 28
    assert min(changes) < 0.95 < 1.1 < max(changes)


def test_the_words_say_what_was_drawn() -> None:
    for hill in hills():
        half, height, wind = shape(hill)
        gusts = 100.0 * hill.site.air.turbulence.intensity  # type: ignore[union-attr]
        words = f"{wind:.1f} m/s, {2.0 * half:.0f} m wide, {height:.1f} m high, gusts {gusts:.0f} %"
        if hill.change != 1.0:
            words += f", wind × {hill.change:.2f}"
        if shear(hill):
            words += f", sheared by {shear(hill):.2f}"
        assert hill.words == words
        assert hill.duration_s == 90.0
        assert not hill.dispersed


# --- how the wind changes -----------------------------------------------------------------------


def test_a_wind_changes_in_the_first_six_tenths_of_an_episode() -> None:
    """It begins after 0.1 to 0.35 of it, and takes 0.1 to 0.25."""
    begins, takes = [], []
    for seed in range(200):
        wind, gusts, factor, last = _air(np.random.default_rng((seed, False)), 40.0)
        assert 7.0 <= wind <= 11.0
        assert 0.01 <= gusts <= 0.05
        assert (factor.at(0.0), factor.at(1e3)) == (1.0, last)
        begin, end = factor.times_s[1], factor.times_s[2]
        begins.append(begin / 40.0)
        takes.append((end - begin) / 40.0)
        assert factor.at(begin) == 1.0
        assert factor.at(0.5 * (begin + end)) == pytest.approx(0.5 * (1.0 + last))
    assert 0.1 <= min(begins) < 0.12 < 0.33 < max(begins) <= 0.35
    assert 0.1 <= min(takes) < 0.12 < 0.23 < max(takes) <= 0.25


@pytest.mark.parametrize(
    ("wind_mps", "flies"), [(7.7, False), (7.9, True), (11.4, True), (11.6, False)]
)
def test_a_start_is_drawn_until_the_wind_there_carries(wind_mps: float, flies: bool) -> None:
    """Two hundred times more at most."""

    class Even:
        def wind_at(self, x: float, _y: float, _z: float, _t: float) -> tuple[float, float, float]:
            return (wind_mps if x == 0.0 else 9.0 if x == 3.0 else 0.0), 0.0, 0.0

    drawn = iter([(float(n), 1.0) for n in range(500)])
    field: Any = Even()
    assert _launched(field, lambda: next(drawn)) == ((0.0, 1.0) if flies else (3.0, 1.0))

    class Still(Even):
        def wind_at(self, x: float, _y: float, _z: float, _t: float) -> tuple[float, float, float]:
            return 0.0, 0.0, x

    drawn, field = iter([(float(n), 1.0) for n in range(500)]), Still()
    assert _launched(field, lambda: next(drawn)) == (200.0, 1.0)


# --- tunnels ------------------------------------------------------------------------------------


@lru_cache(maxsize=4)
def tunnel(seed: int) -> SearchPlace:
    return place("tunnel", seed)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_tunnels_fence_ground_and_start_go_with_its_board(seed: int) -> None:
    there = tunnel(seed)
    air: Any = there.site.air
    slope = radians(air.slope_deg)
    tip_x, tip_z = BOARD_M * cos(slope), BOARD_M * sin(slope)
    box = there.box
    assert 18 <= air.slope_deg <= 28
    assert (*box,) == pytest.approx((-0.5, tip_x - 0.05, 0.15, 2.85))
    ground: Any = there.site.ground
    assert np.array(ground.profile) == pytest.approx(
        np.array([[-2.0, 0.0], [0.0, 0.0], [tip_x, tip_z]])
    )
    start: Any = there.site.start
    assert -0.3 <= start.x_m <= 1.9
    assert max(0.0, start.x_m * tan(slope)) + 0.5 <= start.z_m <= 2.55
    assert there.site.parameters == pytest.approx(
        {
            "WPT_X": -5.5,
            "CLEAR_MIN": 0.3,
            "FENCE_Y_MAX": 1.3,
            "FENCE_X_MIN": -0.5,
            "FENCE_X_MAX": tip_x - 0.05,
            "FENCE_Z_MIN": 0.15,
            "FENCE_Z_MAX": 2.85,
            "TGL_X": start.x_m,
            "TGL_Z": start.z_m,
        }
    )
    assert (there.kind, there.seed, there.duration_s) == ("tunnel", seed, 40.0)
    assert 0.9 <= there.sink_factor <= 1.1
    gusts = 100.0 * air.turbulence.intensity
    assert there.words.startswith(
        f"{air.wind_mps:.1f} m/s, {air.slope_deg:.0f}°, gusts {gusts:.0f} %"
    )
    wind = there.field.wind_at(start.x_m, 0.0, start.z_m, 0.0)[0]
    assert 7.8 <= wind <= 11.5
    assert there.field.wind_at(start.x_m, 0.0, start.z_m, 40.0)[0] == pytest.approx(
        there.change * wind
    )


def test_a_sheared_tunnel_is_the_jet_times_its_shear() -> None:
    """Seed 2 is sheared; seed 1 is the jet itself."""
    there, plain = tunnel(2), tunnel(1)
    assert shear(there) > 0.0
    assert shear(plain) == 0.0
    for each in (there, plain):
        air: Any = each.site.air
        jet = SlopeJet(air.wind_mps, radians(air.slope_deg))
        for x, z in ((0.4, 0.8), (0.4, 2.2), (1.4, 1.6), (-0.4, 1.5)):
            factor = 1.0 + shear(each) * (z - 1.5) / 2.7
            u, _, w = jet.wind_at(x, 0.0, z, 0.0)
            got = each.field.wind_at(x, 0.0, z, 0.0)
            assert got[0] == pytest.approx(factor * u, rel=0.01)
            assert got[2] == pytest.approx(factor * w, abs=0.05)
        tip = BOARD_M * cos(radians(air.slope_deg))
        assert not each.field.inside(0.5 * tip, 0.0, 0.4 * tip * tan(radians(air.slope_deg)))
        assert each.field.inside(0.5 * tip, 0.0, 0.65 * tip * tan(radians(air.slope_deg)))

"""A drafted site on the map and in its plane: each thing is drawn where it lies."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, radians, sin, tan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tgl_soar.air.grid import GridField
from tgl_soar.analysis.report import terrain_figure
from tgl_soar.analysis.report.figure_style import PALETTE
from tgl_soar.analysis.terrain.draft import SiteDraft
from tgl_soar.analysis.terrain.profile import ReducedProfile
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import GlidePolar

POLAR = GlidePolar(c0=3.22, c1=-0.48, c2=0.03, c3=0.0, speed_min_mps=6.0, speed_max_mps=14.0)
X_M = np.linspace(-200.0, 200.0, 81)
LINES = {"a": (-40.0, 30.0), "b": (-30.0, 35.0), "c": (-20.0, 40.0)}
ORIGIN = (12.0, -7.0)  # north, east of home
REACH_M = 1.3 * 100.0  # of the fence, which reaches further upwind than to its sides


def site(**changes: Any) -> SiteDraft:
    """Facing 250 degrees, along a ridge that runs to 340, with a wind from 20 degrees further."""
    x, z = np.linspace(-120.0, 20.0, 29), np.linspace(-50.0, 80.0, 27)
    xx, zz = np.meshgrid(x, z, indexing="ij")
    u, w = np.full_like(xx, 9.0), 1.3 + 0.02 * (35.0 - zz) * np.ones_like(xx)
    home = SimpleNamespace(altitude_m=500.0)
    terrain: Any = SimpleNamespace(up_m=lambda north, east: 0.3 * east + 0.0 * north, home=home)
    made = SiteDraft(
        terrain=terrain,
        frame=SoaringFrame(*ORIGIN, -3.0, radians(250.0)),
        ridge_deg=340.0,
        wind_from_deg=270.0,
        oblique_deg=20.0,
        wind_mps=9.0,
        x_m=X_M,
        z_m=np.minimum(0.0, 0.3 * X_M),
        ground=ReducedProfile([(-100.0, -30.0), (0.0, 0.0), (25.0, 0.0)], 0.0),
        steepest_deg=17.0,
        field=GridField(x, None, z, u, None, w, reference_wind_mps=9.0),
        bounds=(-100.0, 0.0, -25.0, 60.0),
        half_width_m=40.0,
        clearance_m=5.0,
        lines=LINES,
        contour=[],
        landing=(-150.0, -45.0),
    )
    return made._replace(**changes)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Figures instead of files."""
    figures: list[Any] = []
    monkeypatch.setattr(terrain_figure, "save", lambda _plt, figure, _path: figures.append(figure))
    yield figures
    import matplotlib.pyplot as plt

    plt.close("all")


def on_map(x: float, y: float) -> tuple[float, float]:
    """East and north of a place: upwind is 250 degrees, to the right 340."""
    ahead, right = radians(250.0), radians(340.0)
    return (
        ORIGIN[1] - x * sin(ahead) + y * sin(right),
        ORIGIN[0] - x * cos(ahead) + y * cos(right),
    )


def curves(axes: Any) -> dict[str, Any]:
    """Lines by their labels, as corners."""
    return {line.get_label(): line.get_xydata() for line in axes.lines}


def drawn_map(kept: list[Any], **changes: Any) -> Any:
    terrain_figure.map_figure(Path("map.svg"), site(**changes), "a slope")
    return kept[-1].axes[0]


def test_profile_ridge_fence_and_places_lie_on_the_map_where_they_are(kept: list[Any]) -> None:
    found = curves(drawn_map(kept))
    ends = [on_map(-REACH_M, 0.0), on_map(REACH_M, 0.0)]
    assert found["profile, across the ridge"] == pytest.approx(np.array(ends))
    # The ridge runs to 340 degrees: to the right of an aircraft that faces the wind.
    along = [on_map(0.0, -REACH_M), on_map(0.0, REACH_M)]
    assert found["ridge"] == pytest.approx(np.array(along))
    corners = [(-100.0, -40.0), (0.0, -40.0), (0.0, 40.0), (-100.0, 40.0), (-100.0, -40.0)]
    assert found["fence"] == pytest.approx(np.array([on_map(*corner) for corner in corners]))
    assert found["home"].tolist() == [[0.0, 0.0]]
    assert found["origin, on the crest"].tolist() == [[ORIGIN[1], ORIGIN[0]]]
    assert found["level, to land"] == pytest.approx(np.array([on_map(-150.0, 0.0)]))
    for name, (x, _) in LINES.items():
        assert found[f"line {name}"] == pytest.approx(np.array([on_map(x, 0.0)]))


def test_a_site_without_a_landing_place_shows_none(kept: list[Any]) -> None:
    assert "level, to land" not in curves(drawn_map(kept, landing=None))


@pytest.mark.parametrize("oblique_deg", [-45.0, -10.0, 0.0, 20.0, 45.0])
def test_the_winds_arrow_lies_on_the_map_and_on_no_place_of_the_profile(
    kept: list[Any], oblique_deg: float
) -> None:
    axes = drawn_map(kept, oblique_deg=oblique_deg)
    (arrow,) = (text for text in axes.texts if getattr(text, "arrow_patch", None))
    ahead, right = radians(250.0), radians(340.0)
    for east, north in (arrow.xy, arrow.xyann):
        assert abs(east - ORIGIN[1]) < REACH_M
        assert abs(north - ORIGIN[0]) < REACH_M
        off = (east - ORIGIN[1]) * sin(right) + (north - ORIGIN[0]) * cos(right)
        assert abs(off) > 0.3 * REACH_M
        upwind = (east - ORIGIN[1]) * sin(ahead) + (north - ORIGIN[0]) * cos(ahead)
        assert upwind > 0.5 * REACH_M


def test_the_wind_blows_from_its_direction(kept: list[Any]) -> None:
    """A quarter of what is shown downstream; 20 degrees to the right of straight."""
    axes = drawn_map(kept)
    (arrow,) = (text for text in axes.texts if getattr(text, "arrow_patch", None))
    beside = tan(radians(20.0))
    tail = on_map(-0.825 * REACH_M, (-0.5 + 0.125 * beside) * REACH_M)
    head = on_map(-0.575 * REACH_M, (-0.5 - 0.125 * beside) * REACH_M)
    assert arrow.xy == pytest.approx(head)
    assert arrow.xyann == pytest.approx(tail)
    # From 270 degrees: it goes east.
    assert (head[0] - tail[0], head[1] - tail[1]) == pytest.approx(
        (0.25 * REACH_M / cos(radians(20.0)), 0.0), abs=1e-9
    )
    words = [text.get_text() for legend in kept[-1].legends for text in legend.get_texts()]
    assert "wind from 270°" in words
    assert len(words) == 10


def test_the_map_is_centred_on_the_crest_and_as_wide_as_the_fence_needs(kept: list[Any]) -> None:
    for changes, reach in (
        ({}, REACH_M),
        ({"half_width_m": 140.0}, 1.3 * 140.0),
        ({"half_width_m": 180.0}, 200.0),  # no further than the profile is known
    ):
        axes = drawn_map(kept, **changes)
        assert axes.get_xlim() == pytest.approx((ORIGIN[1] - reach, ORIGIN[1] + reach))
        assert axes.get_ylim() == pytest.approx((ORIGIN[0] - reach, ORIGIN[0] + reach))
        (image,) = axes.images
        assert image.get_extent() == pytest.approx([*axes.get_xlim(), *axes.get_ylim()])
        assert image.origin == "lower"
    assert axes.get_title() == "a slope"
    assert axes.get_aspect() == 1.0


def test_contour_lines_are_heights_above_the_sea(kept: list[Any]) -> None:
    """Three tenths of the way east over 500 m, from north to south."""
    axes = drawn_map(kept)
    (levels,) = (each for each in axes.collections if hasattr(each, "levels"))
    low, high = 500.0 + 0.3 * np.array(axes.get_xlim())
    assert low - 10.0 <= min(levels.levels) < max(levels.levels) <= high + 10.0
    for level, path in zip(levels.levels, levels.get_paths(), strict=True):
        if len(path.vertices):
            assert path.vertices[:, 0] == pytest.approx(
                np.full(len(path.vertices), (level - 500.0) / 0.3), abs=1e-6
            )


def drawn_plane(kept: list[Any], **changes: Any) -> Any:
    terrain_figure.plane_figure(Path("plane.svg"), site(**changes), POLAR, "a slope")
    return kept[-1].axes[0]


def test_the_plane_shows_fence_ground_lines_and_the_guess(kept: list[Any]) -> None:
    axes = drawn_plane(kept)
    found = curves(axes)
    box = [(-100.0, -25.0), (0.0, -25.0), (0.0, 60.0), (-100.0, 60.0), (-100.0, -25.0)]
    assert found["fence"].tolist() == [list(corner) for corner in box]
    given = found["[ground], highest of the strip"]
    assert given.tolist() == [[-100.0, -30.0], [0.0, 0.0], [25.0, 0.0]]
    assert "contour, A GUESS by potential flow" in found
    assert axes.get_title() == "a slope, wind 9 m/s"
    # A tenth of the longer side around it.
    assert axes.get_xlim() == pytest.approx((-110.0, 10.0))
    assert axes.get_ylim() == pytest.approx((-35.0, 70.0))
    for i, (name, (x, z)) in enumerate(LINES.items()):
        line = found[f"TGL {name}"]
        assert line.mean(axis=0) == pytest.approx([x, z])
        way = line[1] - line[0]
        assert np.hypot(*way) == pytest.approx(2.0 * 0.2 * 85.0)
        assert way / np.hypot(*way) == pytest.approx([-sin(radians(15.0)), cos(radians(15.0))])
        (drawn,) = (each for each in axes.lines if each.get_label() == f"TGL {name}")
        assert drawn.get_color() == PALETTE[i]
    dots = [line.get_xydata()[0].tolist() for line in axes.lines if line.get_marker() == "o"]
    assert dots == [list(place) for place in LINES.values()]


def test_where_the_wind_is_outside_the_polar_the_plane_is_hatched(kept: list[Any]) -> None:
    """Plain grey looks like an excess of 0.  Here the wind is 10 m/s, and above z = 40 only 8."""
    x, z = np.linspace(-120.0, 20.0, 29), np.linspace(-50.0, 80.0, 27)
    u = np.where(np.meshgrid(x, z, indexing="ij")[1] > 40.0, 8.0, 10.0)
    field = GridField(x, None, z, u, None, np.full_like(u, 1.3), reference_wind_mps=10.0)
    for slowest, is_hatched in ((7.9, False), (9.0, True)):
        polar = POLAR._replace(speed_min_mps=slowest)
        still = site(field=field, oblique_deg=0.0)
        terrain_figure.plane_figure(Path("plane.svg"), still, polar, "a slope")
        axes = kept[-1].axes[0]
        words = [text.get_text() for legend in kept[-1].legends for text in legend.get_texts()]
        assert ("outside polar or field" in words) == is_hatched
        hatched = [each for each in axes.collections if any(getattr(each, "hatches", [None]))]
        assert len(hatched) == is_hatched
        for each in hatched:
            (path,) = each.get_paths()
            assert path.contains_point((-60.0, 55.0))
            assert not path.contains_point((-60.0, 25.0))


def test_the_ground_in_the_plane_goes_on_beyond_the_fence_and_down_out_of_the_picture(
    kept: list[Any],
) -> None:
    axes = drawn_plane(kept)
    (outline,) = (patch.get_xy() for patch in axes.patches)
    # Two tenths of the longer side beyond the fence, where the profile has a post; deeper by one.
    assert (outline[:, 0].min(), outline[:, 0].max()) == (-120.0, 20.0)
    assert outline[:, 1].min() == pytest.approx(0.3 * -120.0 - 10.0)
    inner = outline[1:-2]
    assert inner[:, 1] == pytest.approx(np.minimum(0.0, 0.3 * inner[:, 0]))

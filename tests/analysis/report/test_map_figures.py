"""Maps of the air: which contours, lines, places and shades are drawn where, and what their words
say."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest
from hill_drawn import (
    BOARD,
    BOUNDS,
    HEAVY,
    HILL,
    PATH,
    POLAR,
    STEP_M,
    STRONGER,
    empty_axes,
    keeping,
    labelled,
    words,
)

pytest.importorskip("matplotlib")

from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import contour, excess_at, excess_updraft
from tgl_soar.analysis.report import field_figure, positions_figure, zeuc_figure
from tgl_soar.analysis.report.field_figure import DrawnPlace
from tgl_soar.analysis.report.figure_style import PALETTE
from tgl_soar.analysis.report.positions_figure import MarkedPlace
from tgl_soar.analysis.report.zeuc_figure import DrawnLine, draw_excess_map, draw_line


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Figures instead of files."""
    yield from keeping(monkeypatch, field_figure, positions_figure, zeuc_figure)


@pytest.fixture
def axes() -> Iterator[Any]:
    yield from empty_axes()


# --- excess updraft -----------------------------------------------------------------------------


def test_the_contour_of_a_map_is_where_updraft_equals_sink(axes: Any) -> None:
    draw_excess_map(axes, HILL, POLAR, BOUNDS)
    parts = [p for p in contour(HILL, POLAR, BOUNDS, STEP_M) if len(p) > 2]
    assert [line.get_xydata().tolist() for line in axes.lines] == [p.tolist() for p in parts]
    x, z = parts[0][len(parts[0]) // 2].tolist()
    assert excess_at(HILL, POLAR, x, z) == pytest.approx(0.0, abs=0.01)
    first, *others = axes.lines
    assert first.get_label() == "ZEUC: updraft = sink"
    assert all(line.get_label().startswith("_") for line in others)
    assert first.get_color() == "black"
    assert axes.get_xlim() == (-60.0, 0.0)
    assert axes.get_ylim() == (1.0, 50.0)
    assert axes.get_aspect() == 1.0
    assert axes.get_xlabel().startswith("x, downstream [m]")
    assert axes.get_ylabel() == "height z [m]"
    assert not axes.patches


def test_a_style_of_the_contours_own_takes_the_place_of_the_usual_one(axes: Any) -> None:
    style = {"label": "later", "color": "red"}
    draw_excess_map(axes, HILL, POLAR, BOUNDS, BOARD, contour_style=style)
    assert labelled(axes, "later")[0].get_color() == "red"
    (ground,) = axes.patches
    assert ground.get_xy()[:3].tolist() == [[*corner] for corner in BOARD]
    assert style == {"label": "later", "color": "red"}


def shades(axes: Any, **changes: Any) -> Any:
    return draw_excess_map(axes, HILL, POLAR, BOUNDS, **changes).levels


def test_shades_are_a_quarter_of_a_metre_a_second_apart_about_nothing(axes: Any) -> None:
    levels = shades(axes, limit_mps=2.0)
    assert levels == pytest.approx(np.arange(-2.0, 2.01, 0.25))
    x, z = np.linspace(-60.0, 0.0, 240), np.linspace(1.0, 50.0, 180)
    values = excess_updraft(HILL, POLAR, *np.meshgrid(x, z))
    most = round(float(np.percentile(np.abs(values[np.isfinite(values)]), 97.0)))
    assert most > 1
    assert shades(axes)[[0, -1]].tolist() == [-most, most]


def test_shades_go_to_one_metre_a_second_at_least(axes: Any) -> None:
    """Near the contour, where hardly any excess is left, and where none is known."""
    x, z = contour(HILL, POLAR, BOUNDS, STEP_M)[0][5].tolist()
    near = (x - 0.1, x + 0.1, z - 0.1, z + 0.1)
    levels = draw_excess_map(axes, HILL, POLAR, near).levels
    assert levels == pytest.approx(np.arange(-1.0, 1.01, 0.25))


def test_a_map_without_a_contour_has_none(axes: Any) -> None:
    draw_excess_map(axes, HILL, HEAVY, BOUNDS)
    assert not axes.lines
    assert axes.collections


def test_a_line_goes_through_its_point_by_its_angle_and_its_stable_crossings_are_filled(
    axes: Any,
) -> None:
    eta = 2.0
    line = DrawnLine(
        name="a", x0_m=-30.0, z0_m=20.0, eta_rad=eta,
        crossings=[(-31.0, 22.0, True), (-28.0, 16.0, False)],
    )  # fmt: skip
    draw_line(axes, line, "red", 8.0, "TGL a")
    drawn, stable, other = axes.lines
    ends = [(-30.0 + s * cos(eta), 20.0 + s * sin(eta)) for s in (-8.0, 8.0)]
    assert drawn.get_xydata().tolist() == [pytest.approx([*end]) for end in ends]
    assert (drawn.get_label(), drawn.get_color()) == ("TGL a", "red")
    assert stable.get_xydata().tolist() == [[-31.0, 22.0]]
    assert other.get_xydata().tolist() == [[-28.0, 16.0]]
    assert (stable.get_markerfacecolor(), stable.get_markeredgecolor()) == ("red", "black")
    assert (other.get_markerfacecolor(), other.get_markeredgecolor()) == ("white", "red")
    assert stable.get_marker() == other.get_marker() == "o"


def test_a_map_of_lines_names_them_each_in_its_colour(kept: list[Any]) -> None:
    lines = [
        DrawnLine(name=f"{n}", x0_m=-30.0, z0_m=20.0, eta_rad=2.0, crossings=[]) for n in range(7)
    ]
    zeuc_figure.zeuc_figure(PATH, HILL, POLAR, BOUNDS, lines, (-15.0, 18.0), "a hill", BOARD)
    axes = kept[0].axes[0]
    colours = [labelled(axes, f"TGL {n}")[0].get_color() for n in range(7)]
    assert colours == [*PALETTE, PALETTE[0]]
    for n in range(7):  # far beyond the map
        (x, z), (x1, z1) = labelled(axes, f"TGL {n}")[0].get_xydata()
        assert np.hypot(x1 - x, z1 - z) == pytest.approx(2.0 * 2.0 * 60.0)
    assert labelled(axes, "core")[0].get_xydata().tolist() == [[-15.0, 18.0]]
    assert axes.get_title() == "a hill"
    (legend,) = kept[0].legends
    labels = ["ZEUC: updraft = sink", *(f"TGL {n}" for n in range(7)), "core"]
    assert words(legend) == [*labels, "TGL ∩ ZEUC, stable", "outside polar or field"]
    assert kept[0].axes[1].get_ylabel() == "excess updraft w − sink(u) [m/s]"
    high = (-5.0, 0.0, 1.0, 50.0)
    zeuc_figure.zeuc_figure(PATH, HILL, HEAVY, high, lines[:1], None, "none")
    axes = kept[1].axes[0]
    (x, z), (x1, z1) = labelled(axes, "TGL 0")[0].get_xydata()
    assert np.hypot(x1 - x, z1 - z) == pytest.approx(2.0 * 2.0 * 49.0)
    assert not labelled(axes, "core")


# --- wind and updraft ---------------------------------------------------------------------------


def test_wind_and_updraft_have_shades_of_their_own(kept: list[Any]) -> None:
    """Of updraft alike to both sides of nothing; of either all but the last hundredth."""
    places = [DrawnPlace("[a]", -30.7, 30.7), DrawnPlace("[b]", -15.8, 35.9)]
    field_figure.field_figure(PATH, HILL, POLAR, BOUNDS, BOARD, places, "a hill")
    left, right, *bars = kept[0].axes
    x, z = np.linspace(-60.0, 0.0, 200), np.linspace(1.0, 50.0, 160)
    u, w = field_figure.speeds(HILL, *np.meshgrid(x, z), 0.0)
    least, most = np.percentile(u[np.isfinite(u)], [1.0, 99.0])
    assert left.collections[0].levels[[0, -1]] == pytest.approx([least, most])
    ends = np.percentile(w[np.isfinite(w)], [1.0, 99.0])
    reach = np.abs(ends).max()
    assert right.collections[0].levels[[0, -1]] == pytest.approx([-reach, reach])
    names = ["wind downstream u [m/s]", "updraft w [m/s]"]
    assert [bar.get_ylabel() for bar in bars] == names
    for axes in (left, right):
        circles = [line for line in axes.lines if line.get_marker() == "o"]
        assert [c.get_xydata().tolist() for c in circles] == [[[-30.7, 30.7]], [[-15.8, 35.9]]]
        assert [c.get_markerfacecolor() for c in circles] == [*PALETTE[:2]]
        assert axes.get_xlim() == (-60.0, 0.0)
        assert axes.get_ylim() == (1.0, 50.0)
        assert axes.get_aspect() == 1.0
        assert axes.patches[0].get_xy()[:3].tolist() == [[*corner] for corner in BOARD]
        curves = [line for line in axes.lines if len(line.get_xdata()) > 2]
        parts = [p for p in contour(HILL, POLAR, BOUNDS, STEP_M) if len(p) > 2]
        assert [c.get_xydata().tolist() for c in curves] == [p.tolist() for p in parts]
    assert left.get_ylabel() == "height z [m]"
    assert kept[0].get_suptitle() == "a hill"
    assert words(kept[0].legends[0]) == ["[a]", "[b]", "ZEUC"]


def test_air_that_is_alike_everywhere_is_drawn_too(kept: list[Any]) -> None:
    class Even(HillField):
        def wind(self, x: Any, y: Any, z: Any, time_s: float = 0.0) -> Any:  # noqa: ARG002
            return np.full(np.shape(x), 5.0), np.zeros(np.shape(x)), np.zeros(np.shape(x))

    even: Any = Even(8.0, 20.0)
    field_figure.field_figure(PATH, even, POLAR, BOUNDS, None, [], "even")
    left, right = kept[0].axes[:2]
    assert left.collections[0].levels[0] == 5.0
    assert np.ptp(left.collections[0].levels) == pytest.approx(1e-6)
    assert not left.patches
    assert [line for line in right.lines if len(line.get_xdata()) > 2] == []


def test_only_air_that_stands_in_both_directions_is_none() -> None:
    class Parts:
        def wind(self, _x: Any, _y: Any, _z: Any, _t: float) -> Any:
            zero = np.zeros(4)
            return np.array([0.0, 3.0, 0.0, 2.0]), zero, np.array([0.0, 0.0, -1.0, 0.5])

    parts: Any = Parts()
    u, w = field_figure.speeds(parts, np.zeros(4), np.zeros(4), 0.0)
    assert np.isnan([u[0], w[0]]).all()
    assert u[1:].tolist() == [3.0, 0.0, 2.0]
    assert w[1:].tolist() == [0.0, -1.0, 0.5]


# --- places on the contour ----------------------------------------------------------------------


def test_places_stand_on_the_map_with_their_lines_and_on_the_polar(kept: list[Any]) -> None:
    lean = 0.3
    places = [
        MarkedPlace(name="1", x_m=-30.0, z_m=30.0, wind_mps=7.5, updraft_mps=1.9, lean_rad=lean),
        MarkedPlace(name="2", x_m=-20.0, z_m=35.0, wind_mps=8.5, updraft_mps=1.7, lean_rad=-1.0),
    ]
    positions_figure.positions_figure(PATH, HILL, STRONGER, POLAR, BOUNDS, 20.0, places, "8.5 m/s")
    left, right = kept[0].axes[:2]
    circles = [line for line in left.lines if line.get_marker() == "o"]
    assert [c.get_xydata().tolist() for c in circles] == [[[-30.0, 30.0]], [[-20.0, 35.0]]]
    assert [c.get_markerfacecolor() for c in circles] == [*PALETTE[:2]]
    lines = [line for line in left.lines if len(line.get_xdata()) == 2]
    for line, place in zip(lines, places, strict=True):
        (x, z), (x1, z1) = line.get_xydata()
        # Leaning forward, which is upwind, and as far below the place as above it.
        assert (0.5 * (x + x1), 0.5 * (z + z1)) == pytest.approx((place.x_m, place.z_m))
        assert np.arctan2(x - x1, z1 - z) == pytest.approx(place.lean_rad)
    on_polar = [line for line in right.lines if line.get_marker() == "o"]
    assert [c.get_xydata().tolist() for c in on_polar] == [[[7.5, 1.9]], [[8.5, 1.7]]]
    assert [c.get_markerfacecolor() for c in on_polar] == [*PALETTE[:2]]
    (level,) = (line for line in right.lines if line.get_linestyle() == ":")
    assert level.get_ydata() == pytest.approx([1.9, 1.9])
    assert {t.get_text() for t in left.texts} == {"[1]", "[2]"}
    assert {t.get_text() for t in right.texts} == {"[1] 1.90 m/s", "[2] 1.70 m/s"}


def test_the_contour_of_the_stronger_wind_is_dashed_and_named_once(kept: list[Any]) -> None:
    place = MarkedPlace(name="1", x_m=-30.0, z_m=30.0, wind_mps=7.5, updraft_mps=1.9, lean_rad=0.3)
    positions_figure.positions_figure(PATH, HILL, STRONGER, POLAR, BOUNDS, 20.0, [place], "8.5 m/s")
    left = kept[0].axes[0]
    dashed = [line for line in left.lines if line.get_linestyle() == "--"]
    parts = [p for p in contour(STRONGER, POLAR, BOUNDS, STEP_M) if len(p) > 2]
    assert [line.get_xydata().tolist() for line in dashed] == [p.tolist() for p in parts]
    assert words(left.get_legend()) == ["ZEUC: updraft = sink", "8.5 m/s"]
    # The hill is half a circle.
    (ground,) = left.patches
    corners = ground.get_xy()
    assert np.hypot(*corners.T) == pytest.approx(np.full(len(corners), 20.0))
    assert corners[[0, 45, 90]].ravel() == pytest.approx(
        [20.0, 0.0, 20.0 * cos(pi / 2), 20.0, -20.0, 0.0], abs=1e-9
    )
    assert kept[0].axes[2].get_ylabel() == "excess updraft w − sink(u) [m/s]"

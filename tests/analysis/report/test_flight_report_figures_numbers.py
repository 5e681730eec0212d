"""The numbers in a report's figures: steps of grey, room, windows, loud modes."""

from __future__ import annotations

from math import cos, hypot, nan, sin
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from test_flight_report_figures import (
    ALL,
    closed,  # noqa: F401 - a fixture
    drawn_plane,
    flight,
    history,
    leg,
    of,
    path,
)

from tgl_soar.analysis.report.flight_report_figures import (
    Curve,
    Surroundings,
    TimePanel,
    health_panels,
    history_figure,
    largest,
    lateral_panels,
    longitudinal_panels,
    places_figure,
)


class Sheared:
    """Updraft that grows with height from nothing to `most` within the window of a figure."""

    def __init__(self, most: float, z_m: tuple[float, float], known: bool = True) -> None:
        self.most, self.z_m, self.known = most, z_m, known

    def wind(self, x: Any, _y: Any, z: Any) -> Any:
        low, high = self.z_m
        w = self.most * (z - low) / (high - low)
        return 8.0 + 0.0 * x, 0.0 * x, w if self.known else nan * w

    def inside(self, _x: float, _y: float, _z: float) -> bool:
        return True


# A path of a square metre: the window around it is found by the figure itself.
SQUARE = flight(path=path(0.1 * np.cos(ALL), 0.1 * np.sin(ALL)))


@pytest.fixture(scope="module")
def window() -> tuple[float, float]:
    low, high = drawn_plane(SQUARE).axes[0].get_ylim()
    return float(low), float(high)


@pytest.mark.parametrize(
    ("most", "step"),
    [
        (0.98, 0.05),
        (1.98, 0.1),
        (3.9, 0.2),
        (4.9, 0.25),
        (9.8, 0.5),
        (19.0, 1.0),
        (39.0, 2.0),
        (98.0, 5.0),
        (140.0, 5.0),  # there is no greater one
    ],
)
def test_twenty_greys_at_most_have_the_least_round_step(
    most: float, step: float, window: tuple[float, float]
) -> None:
    """Their range is that of all but one per cent at either end."""
    field: Any = Sheared(most / 0.98, window)
    axes = drawn_plane(SQUARE, known=Surroundings(field=field)).axes[0]
    shades = next(each for each in axes.collections if hasattr(each, "levels"))
    assert np.diff(shades.levels) == pytest.approx(step)
    assert shades.levels[0] == 0.0
    high = 0.99 * most / 0.98
    assert high <= shades.levels[-1] < high + 1.001 * step
    assert shades.cmap(1.0)[0] > 0.4  # colours are visible on the darkest
    assert shades.get_rasterized()


def test_air_of_which_nothing_is_known_is_not_shaded(window: tuple[float, float]) -> None:
    field: Any = Sheared(1.0, window, known=False)
    figure = drawn_plane(SQUARE, known=Surroundings(field=field))
    assert [bar.get_ylabel() for bar in figure.axes[1:]] == ["time [s]"]


def test_a_line_goes_through_the_whole_plane_from_wherever_its_foot_is() -> None:
    """Twice the diagonal to either side."""
    wide = flight(path=path(np.linspace(-80.0, 0.0, len(ALL)), 30.0))
    axes = drawn_plane(wide, leg(crossing=None)).axes[0]
    x, z = axes.lines[0].get_data()
    diagonal = hypot(np.diff(axes.get_xlim())[0], np.diff(axes.get_ylim())[0])
    for i in (0, 1):
        assert hypot(x[i] + 30.0, z[i] - 30.0) == pytest.approx(2.0 * diagonal)


def test_a_dense_path_is_pixels_in_the_vector_figure() -> None:
    axes = drawn_plane(flight(path=path())).axes[0]
    assert all(each.get_rasterized() for each in axes.collections)
    short = places_figure(plt, flight(path=path()), [leg()], Surroundings()).axes[0]
    assert not short.lines[1].get_rasterized()
    time = np.linspace(0.0, 100.0, 12_000)
    dense = flight(path=of({"x_m": -30.0, "y_m": 0.0, "z_m": 30.0}, time))
    assert places_figure(plt, dense, [leg()], Surroundings()).axes[0].lines[1].get_rasterized()


@pytest.mark.parametrize(("farthest", "shown"), [(0.5, 0.53), (1.6, 1.6 * 0.4)])
def test_the_whole_path_of_a_leg_is_in_its_window_unless_it_comes_from_afar(
    farthest: float, shown: float
) -> None:
    """Most of it within 0.4 m; window and path, half their width [m]."""
    x = np.where((ALL > 12.0) & (ALL < 14.0), farthest, 0.4)
    held = leg(crossing=None, mean=(-30.0, 30.0))
    axes = places_figure(plt, flight(path=path(-30.0 + x, 30.0)), [held], Surroundings()).axes[0]
    half = max(1.6 * 0.4, shown)
    assert axes.get_xlim() == pytest.approx((-30.0 - half, -30.0 + half))


def test_of_an_age_the_largest_in_each_whole_second_is_drawn() -> None:
    """A heartbeat each second, its age sampled every 0.07 s: a level line, and not a beating."""
    time = 5.0 + np.arange(0.0, 9.6, 0.07)
    age = time % 1.0
    middles, values = largest(time, age, 1.0)
    assert middles == pytest.approx(5.5 + np.arange(9.0))
    assert values == pytest.approx(np.full(9, 0.965), abs=0.036)
    flown = flight((5.0, "soaring"), ages=of({"heartbeat_age_s": age}, time), end_s=14.6)
    curve = history_figure(plt, flown, [], health_panels(flown)).axes[-1].lines[0]
    assert np.ptp(curve.get_ydata()) < 0.071
    gap = np.where(time < 8.0, np.nan, age)
    assert largest(time, gap, 1.0)[0][0] > 8.0
    assert len(largest(time, np.full(len(time), np.nan), 1.0)[0]) == len(time)
    assert [v.tolist() for v in largest(time[:3], age[:3], 1.0)] == [[5.5], [age[2]]]


def test_a_line_whose_foot_is_far_off_is_drawn_where_the_leg_was_held() -> None:
    x0, z0, eta = leg().line
    far = leg(line=(x0 - 40.0 * cos(eta), z0 - 40.0 * sin(eta), eta), crossing=None)
    axes = places_figure(plt, flight(path=path()), [far], Surroundings()).axes[0]
    ends = axes.lines[0].get_xydata()
    assert 0.5 * (ends[0] + ends[1]) == pytest.approx([x0, z0])
    assert axes.get_aspect() == 1.0


def test_what_is_one_for_every_tick_is_a_band_and_all_else_a_curve() -> None:
    ages = dict.fromkeys(("position_age_s", "attitude_age_s", "heartbeat_age_s"), 0.1)
    angles = dict.fromkeys(("roll_rad", "pitch_rad", "yaw_rad", "heading_rad"), 0.1)
    full = flight(ages=of({**ages}), attitude=of({**angles}), setpoints=of({**angles}))
    bands = [c.band for panel in health_panels(full) for c in panel.curves]
    assert bands == [True, True, False]  # a heartbeat is seldom: the oldest of each second
    panels = [*longitudinal_panels(full), *lateral_panels(full)]
    curves = [c for panel in panels for c in panel.curves]
    assert [c.band for c in curves] == [False] * 4
    setpoints = [c for c in curves if c.label == "setpoint"]
    assert len({c.colour for c in setpoints}) == 1
    assert {c.colour for c in setpoints}.isdisjoint(c.colour for c in curves if c.label == "flown")


@pytest.mark.parametrize("name", ["holding", "recovering", "released", "failed"])
def test_no_failure_is_too_short_to_be_named(name: str) -> None:
    modes = ((0.0, "soaring"), (50.0, name), (50.1, "soaring"))
    legend = history(flight(*modes))[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [name]


@pytest.mark.parametrize("label", [None, "wave"])
def test_a_legend_has_room_above_the_curve(label: str | None) -> None:
    """Three tenths of the height that the axes have without one."""
    curve = Curve(of({"v": np.sin(ALL)}), "v", label=label)
    figure = history_figure(plt, flight((0.0, "soaring")), [], [TimePanel("v", [curve])])
    axes = figure.axes[1]
    low, high = axes.get_ylim()
    height = high - low if label is None else (high - low) / 1.3
    margin = 0.05 * 2.0  # matplotlib's own, of the data
    assert height == pytest.approx(2.0 + 2.0 * margin, rel=1e-2)
    assert low == pytest.approx(-1.0 - margin, rel=1e-2)

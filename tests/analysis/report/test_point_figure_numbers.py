"""The figure of a held point, number by number: which rows count, what is shaded, from where to
where time goes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import matplotlib.pyplot as plt

from tgl_soar.analysis.logs.flight_data import FlightData, Series
from tgl_soar.analysis.report import point_figure as module
from tgl_soar.analysis.report.flight_report_figures import BLUE
from tgl_soar.analysis.report.point_figure import (
    CLOUD_POINTS,
    held_rows,
    point_figure,
    point_words,
)
from tgl_soar.control.point_hold import HOLDS, POINT_TEXTS, acts


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    plt.close("all")


def point(standing: Any, off_m: Any = None, brake: Any = None, step_s: float = 1.0) -> Series:
    count = len(standing)
    columns = {
        "standing": np.asarray(standing, dtype=float),
        "off_m": np.zeros(count) if off_m is None else np.asarray(off_m, dtype=float),
        "brake": np.full(count, 0.5) if brake is None else np.asarray(brake, dtype=float),
    }
    return Series(np.array([step_s * n for n in range(count)]), columns, "")


def flight(held: Series, **more: Any) -> FlightData:
    return FlightData("log", "a log", point=held, **more)


def test_ten_seconds_of_holding_are_left_out_and_again_after_each_rest() -> None:
    standing = [HOLDS] * 15 + [0] + [HOLDS] * 13
    rows = np.flatnonzero(held_rows(point(standing)))
    assert rows.tolist() == [10, 11, 12, 13, 14, 26, 27, 28]
    off = np.zeros(29)
    off[12] = np.nan  # from there on it settles again
    assert np.flatnonzero(held_rows(point(standing, off))).tolist() == [10, 11, 26, 27, 28]
    unknown = [np.nan if n == 5 else s for n, s in enumerate(standing)]
    assert np.flatnonzero(held_rows(point(unknown))).tolist() == [26, 27, 28]


@pytest.mark.parametrize("standing", range(len(POINT_TEXTS)))
def test_only_where_the_law_acts_a_point_is_held(standing: int) -> None:
    found = held_rows(point([standing] * 12))
    assert found.tolist() == ([0.0] * 10 + [1.0] * 2 if acts(standing) else [0.0] * 12)


def test_the_caption_is_of_the_rows_that_count() -> None:
    off = [9.0] * 10 + [0.03, -0.04, 0.0, 0.05]
    brake = [0.0] * 10 + [0.0, 1.0, 0.5, 0.3]
    words = point_words(flight(point([HOLDS] * 14, off, brake)))
    rms_mm = 1000.0 * np.sqrt(np.mean(np.square([0.03, 0.04, 0.0, 0.05])))
    assert f"Held, but for the first 10 s: {rms_mm:.0f} mm rms along the line" in words
    assert "brake 0.45 on average, at an end of its travel 50 % of the time." in words
    short = point_words(flight(point([HOLDS] * 10)))
    assert short.endswith("No point was held for more than 10 s.")
    assert "Held, but for" not in point_words(FlightData("", ""))
    assert "No point was held" not in point_words(FlightData("", ""))


def test_brake_and_distance_are_drawn_over_the_time_in_which_a_point_was_asked_for() -> None:
    standing = [0.0] * 5 + [HOLDS] * 21 + [0.0] * 5
    held = point(standing, 0.01 * np.arange(31.0), np.linspace(0.0, 1.0, 31))
    _, brake, off = point_figure(plt, flight(held)).axes
    assert brake.lines[0].get_xydata() == pytest.approx(np.stack([held.time_s, held["brake"]], 1))
    assert [[*line.get_ydata()] for line in brake.lines[1:]] == [[0.0, 0.0], [1.0, 1.0]]
    assert off.lines[0].get_ydata() == pytest.approx(np.arange(31.0))  # in centimetres
    assert [*off.lines[1].get_ydata()] == [0.0, 0.0]
    assert off.get_xlim() == pytest.approx((5.0 - 0.9, 25.0 + 0.9))  # 2 % of 20 s and a half
    assert brake.get_ylim() == pytest.approx((-0.08, 1.08))
    assert brake.get_shared_x_axes().joined(brake, off)
    labels = (off.get_xlabel(), off.get_ylabel(), brake.get_ylabel())
    assert labels == ("time [s]", "along [cm]", "brake")


def test_the_cloud_is_along_over_across_in_centimetres() -> None:
    held = point([HOLDS] * 13, 0.01 * np.arange(13.0))
    tracking = Series(held.time_s, {"e_rho_m": -0.02 * np.arange(13.0)}, "")
    cloud = point_figure(plt, flight(held, tracking=tracking)).axes[0]
    across, along, dots, middle = cloud.lines
    assert [*across.get_ydata(), *along.get_xdata()] == [0.0] * 4
    assert dots.get_xydata() == pytest.approx(
        np.array([[-20.0, 10.0], [-22.0, 11.0], [-24.0, 12.0]])
    )
    assert middle.get_xydata().tolist() == [[0.0, 0.0]]
    assert dots.get_color() == BLUE
    labels = (cloud.get_xlabel(), cloud.get_ylabel(), cloud.get_title())
    assert labels == ("across the line [cm]", "along the line [cm]", "About the point")
    blind = point_figure(plt, flight(held)).axes[0]
    assert blind.lines[2].get_xdata().tolist() == [0.0] * 3
    empty = point_figure(plt, flight(point([HOLDS] * 5))).axes[0]
    assert len(empty.lines) == 2


def test_a_cloud_has_some_thousand_dots() -> None:
    count = round(2.5 * CLOUD_POINTS)
    held = point([HOLDS] * count, step_s=10.0)
    dots = point_figure(plt, flight(held)).axes[0].lines[2]
    assert len(dots.get_xdata()) == -(-(count - 1) // 2)
    assert CLOUD_POINTS == 4000


def shaded(standing: Any) -> list[tuple[float, float]]:
    axes: Any = plt.figure().subplots()
    module._shade(axes, point(standing))
    return [(p.get_x(), p.get_x() + p.get_width()) for p in axes.patches]


def test_what_is_neither_rest_nor_the_line_alone_is_shaded_from_change_to_change() -> None:
    assert shaded([0.0, 0.0, 3.0, 3.0, 4.0, 1.0, 1.0, 2.0]) == [(2.0, 4.0), (4.0, 5.0), (7.0, 7.0)]
    assert shaded([np.nan, 2.0, 2.0, np.nan]) == [(1.0, 3.0)]
    last = len(POINT_TEXTS) - 1
    assert shaded([float(last), float(last)]) == [(0.0, 1.0)]
    assert shaded([last + 1.0, last + 1.0]) == []  # of a later version


def test_only_a_point_that_was_asked_for_is_drawn() -> None:
    assert point_figure(plt, flight(point([0.0, np.nan, 0.0]))) is None
    assert point_figure(plt, flight(point([0.0, 1.0, 0.0]))) is not None

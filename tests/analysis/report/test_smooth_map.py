"""Maps whose edge is that of what they show."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData, Series
from tgl_soar.analysis.report.flight_report_figures import health_panels, history_figure
from tgl_soar.analysis.report.smooth_map import beyond_the_edge, draw_smooth_map, known_fraction

mpl.use("Agg")
import matplotlib.pyplot as plt

X, Z = np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, 31)


def below(x: Any, z: Any) -> Any:
    """An edge that runs slightly upwards: at the nodes it is a staircase."""
    return z < 0.5 + 0.1 * x


def test_the_edge_of_a_map_is_where_it_is_and_no_staircase() -> None:
    xx, zz = np.meshgrid(X, Z)
    figure, axes = plt.subplots()
    draw_smooth_map(axes, X, Z, np.where(below(xx, zz), zz, np.nan), below, levels=5)
    cover: Any = axes.collections[-1].get_paths()[0].vertices
    inner = (cover[:, 0] > 0.03) & (cover[:, 0] < 0.97) & (cover[:, 1] < 0.9)
    away = cover[inner, 1] - (0.5 + 0.1 * cover[inner, 0])
    assert inner.sum() > 30
    # A staircase is off by up to half a cell (17 mm); the fractions are counted in eighths.
    assert np.abs(away).max() < (Z[1] - Z[0]) / 8
    plt.close(figure)


def test_the_shading_reaches_the_ground() -> None:
    xx, zz = np.meshgrid(X, Z)
    ground = [(-0.2, -0.08), (1.2, 0.48), (1.2, -0.5), (-0.2, -0.5)]

    def known(x: Any, z: Any) -> Any:
        """Nothing right above it."""
        return z > 0.4 * x + 0.01

    figure, axes = plt.subplots()
    draw_smooth_map(axes, X, Z, np.where(known(xx, zz), zz, np.nan), known, ground, levels=5)
    assert len(axes.collections) == 1  # nothing is covered
    plt.close(figure)


def test_unknown_values_are_the_nearest_known_ones() -> None:
    values = np.array([[1.0, np.nan, np.nan, 4.0]])
    assert beyond_the_edge(values).tolist() == [[1.0, 1.0, 4.0, 4.0]]
    assert np.isnan(beyond_the_edge(np.full((2, 2), np.nan))).all()


def test_a_node_far_from_the_edge_is_not_asked_again() -> None:
    nodes = below(*np.meshgrid(X, Z))
    asked: list[int] = []

    def known(x: Any, z: Any) -> Any:
        asked.append(x.size)
        return below(x, z)

    fraction = known_fraction(known, X, Z, nodes)
    assert sum(asked) < 0.2 * 64 * nodes.size
    assert fraction[0].tolist() == pytest.approx(np.ones(41))


def test_an_age_between_two_samples_is_a_line_and_a_band() -> None:
    """Drawn from sample to sample it would be one solid bar."""
    time = np.arange(0.0, 60.0, 0.005)
    age = np.tile([0.040, 0.045, 0.050, 0.055], len(time) // 4)
    ages = Series(time, {"position_age_s": age, "attitude_age_s": 0 * age}, "")
    flight = FlightData("", "", ages=ages)
    figure = history_figure(plt, flight, [], health_panels(flight))
    line: Any = figure.axes[0].lines[0]
    assert len(line.get_xdata()) <= 241
    assert np.ptp(line.get_ydata()[1:-1]) < 5.0  # of 15 ms
    low, high = figure.axes[0].collections[0].get_datalim(figure.axes[0].transData).intervaly
    assert (low, high) == pytest.approx((40.0, 55.0), abs=0.1)
    plt.close(figure)

"""The report's figure of a point that was held, and what it says."""

from __future__ import annotations

from pathlib import Path

import flown
import matplotlib.pyplot as plt
import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData, Series
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.analysis.report.point_figure import SETTLED_S, held_rows, point_figure, point_words
from tgl_soar.control.point_hold import DEAD, HOLDS, LINE_ONLY


def held(off_m: float = 0.02, end: int = HOLDS) -> FlightData:
    """10 s of the line alone, 40 s of a point, 10 s of what comes then."""
    time = np.arange(0.0, 60.0, 0.1)
    standing = np.where(time < 10.0, LINE_ONLY, np.where(time < 50.0, HOLDS, end)).astype(float)
    off = np.where(standing == HOLDS, off_m * np.sign(np.sin(7.0 * time) + 1e-9), np.nan)
    brake = np.where(standing == HOLDS, np.where(np.arange(len(time)) % 4 == 0, 1.0, 0.4), 0.0)
    return FlightData(
        name="made up",
        kind="test",
        point=Series(time, {"standing": standing, "off_m": off, "brake": brake}, "tick"),
        tracking=Series(time, {"e_rho_m": 0.001 * np.cos(time)}, "tick"),
    )


def test_rows_count_from_some_seconds_after_it_was_asked_for() -> None:
    flight = held(end=DEAD)
    assert flight.point is not None
    rows = flight.point.time_s[held_rows(flight.point) > 0.0]
    assert (rows[0], rows[-1]) == pytest.approx((10.0 + SETTLED_S, 49.9))


def test_the_caption_says_how_well_it_was_held() -> None:
    words = point_words(held(0.02))
    assert "20 mm rms along the line" in words
    assert "brake 0.55 on average, at an end of its travel 25 % of the time" in words


def test_the_cloud_is_about_the_point_and_the_fault_is_shaded() -> None:
    figure = point_figure(plt, held(end=DEAD))
    cloud, brake, off = figure.axes
    dots = cloud.lines[2]
    assert np.abs(dots.get_ydata()).max() == pytest.approx(2.0)
    assert np.abs(dots.get_xdata()).max() <= 0.1
    (shaded,) = brake.patches
    assert shaded.get_x() == pytest.approx(50.0)
    assert len(off.patches) == 1
    plt.close(figure)


def test_a_flight_that_asked_for_no_point_has_none(tmp_path: Path) -> None:
    flight = read_flight(flown.our_log(tmp_path))
    assert flight.point is not None  # its log has the columns
    assert point_figure(plt, flight) is None
    assert point_figure(plt, FlightData(name="", kind="")) is None

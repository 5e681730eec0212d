"""Figures: they exist, they are no blank sheets, and what they lack is named."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tgl_soar.air.hill import HillField
from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, Mark, Note, curves_figure
from tgl_soar.analysis.report.field_figure import DrawnPlace, field_figure, speeds
from tgl_soar.analysis.report.flight_figure import HistoryPanel, MapAir, Spans, Trace, flight_figure
from tgl_soar.analysis.report.polar_figure import polar_figure
from tgl_soar.analysis.report.zeuc_figure import DrawnLine, zeuc_figure
from tgl_soar.estimation.polar import fit_polar
from tgl_soar.types import GlidePolar, polar_sink

POLAR = GlidePolar(c0=17.7, c1=-3.6, c2=0.2, c3=0.0, speed_min_mps=6.8, speed_max_mps=11.5)
HILL = HillField(8.0, 20.0)
BOUNDS = (-60.0, 0.0, 1.0, 50.0)


def inked(path: Path) -> float:
    """Fraction of pixels that are not the most common colour."""
    pixels = np.asarray(Image.open(path).convert("L"))
    return 1.0 - float(np.bincount(pixels.ravel()).max()) / pixels.size


def test_the_contour_map_is_drawn_as_png_and_svg(tmp_path: Path) -> None:
    line = DrawnLine(
        name="a",
        x0_m=-30.7,
        z0_m=30.7,
        eta_rad=2.0,
        crossings=[(-30.7, 30.7, True), (-28.0, 20.0, False)],
    )
    for name in ("map.png", "map.svg"):
        zeuc_figure(tmp_path / name, HILL, POLAR, BOUNDS, [line], (-15.0, 18.0), "a hill")
    assert inked(tmp_path / "map.png") > 0.3
    assert (
        "a hill" in (tmp_path / "map.svg").read_text()
        or (tmp_path / "map.svg").stat().st_size > 20_000
    )


def test_a_map_without_a_contour_is_still_a_map(tmp_path: Path) -> None:
    heavy = POLAR._replace(c0=POLAR.c0 + 8.0)
    zeuc_figure(tmp_path / "none.png", HILL, heavy, BOUNDS, [], None, "sinks everywhere")
    assert inked(tmp_path / "none.png") > 0.2


def test_the_same_figure_is_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one.png", "two.png"):
        polar_figure(tmp_path / name, POLAR, "a polar")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_a_fit_is_drawn_with_its_residuals(tmp_path: Path) -> None:
    speeds = np.linspace(7.0, 11.0, 9).tolist()
    sinks = [polar_sink(POLAR, u) + 0.02 * (-1) ** i for i, u in enumerate(speeds)]
    polar_figure(tmp_path / "fit.png", POLAR, "a fit", fit_polar(speeds, sinks), speeds, sinks)
    assert inked(tmp_path / "fit.png") > 0.03


def test_a_flight_is_drawn_beside_its_histories(tmp_path: Path) -> None:
    time = np.linspace(0.0, 10.0, 200)
    flight_figure(
        tmp_path / "flight.png",
        MapAir(HILL, POLAR, BOUNDS, None, later_s=5.0),
        [DrawnLine(name="a", x0_m=-30.7, z0_m=30.7, eta_rad=2.0, crossings=[])],
        -30.0 + np.sin(time),
        30.0 + np.cos(time),
        [HistoryPanel("z [m]", [Trace(time, 30.0 + np.cos(time), "flown")])],
        "a flight",
        Spans([(2.0, 8.0, "a")]),
    )
    assert inked(tmp_path / "flight.png") > 0.2


def test_wind_and_updraft_are_drawn_side_by_side_without_their_walls(tmp_path: Path) -> None:
    x, z = np.array([0.0, -40.0]), np.array([5.0, 30.0])  # in the hill, and in the air
    u, w = speeds(HILL, x, z, 0.0)
    assert np.isnan([u[0], w[0]]).all()
    assert (u[1], w[1]) == pytest.approx(tuple(float(v) for v in HILL.wind(-40.0, 0.0, 30.0)[::2]))
    places = [DrawnPlace("[a]", -30.7, 30.7), DrawnPlace("[b]", -15.8, 35.9)]
    ground = [(-20.0, 0.0), (0.0, 20.0), (0.0, 0.0)]
    field_figure(tmp_path / "field.png", HILL, POLAR, BOUNDS, ground, places, "a hill")
    assert inked(tmp_path / "field.png") > 0.3


def test_curves_take_logarithms_marks_and_notes(tmp_path: Path) -> None:
    series = [DrawnCurve([0.0, 1.0], [0.1, 10.0], "one", "black")]
    panels = [
        CurvePanel(
            title="left",
            x_label="x [m]",
            y_label="y [m]",
            series=series,
            notes=[Note(0.5, 1.0, "here")],
            marks=[Mark(0.2, "mark")],
        ),
        CurvePanel("right", "x [m]", "y [m]", series, y_log=True),
    ]
    curves_figure(tmp_path / "curves.png", panels, "curves")
    assert inked(tmp_path / "curves.png") > 0.01


def test_without_matplotlib_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "matplotlib":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"tgl_soar\[figures\]"):
        polar_figure(tmp_path / "polar.png", POLAR, "a polar")
    assert not (tmp_path / "polar.png").exists()

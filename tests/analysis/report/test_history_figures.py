"""Polars, curves, flights and timelines: which numbers are drawn where, and what their words
say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hill_drawn import (
    BOARD,
    BOUNDS,
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
from tgl_soar.air.zeuc import contour
from tgl_soar.analysis.report import curves_figure, flight_figure, polar_figure, timeline_figure
from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, Mark, Note
from tgl_soar.analysis.report.figure_style import GROUND, MODE_COLOURS, PALETTE
from tgl_soar.analysis.report.flight_figure import HistoryPanel, MapAir, Spans, Trace
from tgl_soar.analysis.report.legs import HOLDING_LINE
from tgl_soar.analysis.report.timeline_figure import Timeline
from tgl_soar.analysis.report.zeuc_figure import DrawnLine
from tgl_soar.estimation.polar import best_glide_speed, fit_polar, sink_band
from tgl_soar.types import polar_sink


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Figures instead of files."""
    yield from keeping(monkeypatch, curves_figure, flight_figure, polar_figure, timeline_figure)


@pytest.fixture
def axes() -> Iterator[Any]:
    yield from empty_axes()


# --- polars -------------------------------------------------------------------------------------


def test_a_polar_has_sink_downwards_and_the_tangent_of_its_best_glide(axes: Any) -> None:
    polar_figure.draw_polar(axes, POLAR)
    curve, tangent, mark = axes.lines
    speed = np.linspace(6.8, 11.5, 200)
    assert curve.get_xdata() == pytest.approx(speed)
    assert curve.get_ydata() == pytest.approx([polar_sink(POLAR, u) for u in speed.tolist()])
    best = best_glide_speed(POLAR)
    sink = polar_sink(POLAR, best)
    assert mark.get_xydata().tolist() == [[best, sink]]
    assert tangent.get_ydata() == pytest.approx(sink / best * np.asarray(tangent.get_xdata()))
    assert tangent.get_label() == f"best glide, 1 : {best / sink:.1f}"
    low, high = axes.get_ylim()
    assert low > high
    assert axes.get_xlabel() == "horizontal airspeed u [m/s]"
    assert axes.get_ylabel() == "sink [m/s]"
    assert not axes.collections


def test_a_polar_without_a_tangent_is_its_curve_alone(axes: Any) -> None:
    polar_figure.draw_polar(axes, POLAR, tangent=False)
    assert [line.get_label() for line in axes.lines] == ["glide polar"]


def test_a_fit_has_its_band_its_glides_and_its_residuals_in_centimetres(kept: list[Any]) -> None:
    speeds = np.linspace(7.0, 11.0, 9).tolist()
    sinks = [polar_sink(POLAR, u) + 0.02 * (-1) ** i for i, u in enumerate(speeds)]
    fit = fit_polar(speeds, sinks)
    beside = POLAR._replace(c0=POLAR.c0 + 0.1, speed_min_mps=7.5, speed_max_mps=9.5)
    polar_figure.polar_figure(PATH, POLAR, "a fit", fit, speeds, sinks, beside)
    upper, lower = kept[0].axes
    (band,) = upper.collections
    corners = np.concatenate([path.vertices for path in band.get_paths()])
    for speed in np.linspace(6.8, 11.5, 200)[[60, 150]].tolist():
        found = corners[np.isclose(corners[:, 0], speed), 1]
        assert (found.min(), found.max()) == pytest.approx(sink_band(fit, speed))
    (glides,) = labelled(upper, "glides")
    assert glides.get_xydata().tolist() == [[*pair] for pair in zip(speeds, sinks, strict=True)]
    (other,) = labelled(upper, "compared with")
    assert (other.get_xdata()[0], other.get_xdata()[-1]) == (7.5, 9.5)
    assert other.get_ydata()[0] == pytest.approx(polar_sink(beside, 7.5))
    zero, residuals = lower.lines
    assert [*zero.get_ydata()] == [0.0, 0.0]
    assert residuals.get_xdata().tolist() == speeds
    assert residuals.get_ydata() == pytest.approx(100.0 * np.array(fit.residuals_mps))
    assert lower.get_ylabel() == "residual [cm/s]"
    assert lower.get_xlabel() == "horizontal airspeed u [m/s]"
    assert upper.get_xlabel() == ""
    assert upper.get_title() == "a fit"
    polar_figure.polar_figure(PATH, POLAR, "no fit")
    assert len(kept[1].axes) == 1
    assert words(kept[1].axes[0].get_legend())[0] == "glide polar"
    polar_figure.polar_figure(PATH, POLAR, "alone", fit, speeds, sinks)
    assert not labelled(kept[2].axes[0], "compared with")


# --- curves -------------------------------------------------------------------------------------


def curves(**changes: Any) -> CurvePanel:
    drawn = DrawnCurve([0.0, 1.0], [0.5, 20.0], "one", "red")
    return CurvePanel(
        **{"title": "t", "x_label": "x", "y_label": "y", "series": [drawn], **changes}
    )


def test_marks_and_notes_stand_where_they_are_put(kept: list[Any]) -> None:
    panel = curves(marks=[Mark(0.25, "here")], notes=[Note(0.5, 2.0, "there", "blue")])
    curves_figure.curves_figure(PATH, [panel], "")
    (axes,) = kept[0].axes
    curve, mark = axes.lines
    assert curve.get_xydata().tolist() == [[0.0, 0.5], [1.0, 20.0]]
    assert (curve.get_color(), curve.get_label()) == ("red", "one")
    assert [*mark.get_xdata()] == [0.25, 0.25]
    by_text = {text.get_text(): text for text in axes.texts}
    assert by_text["here"].xy[0] == 0.25
    assert by_text["there"].xy == (0.5, 2.0)
    assert by_text["there"].get_color() == "blue"
    assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == ("t", "x", "y")
    assert kept[0].get_suptitle() == ""
    assert words(axes.get_legend()) == ["one"]


def test_an_axis_begins_at_zero_or_is_logarithmic_where_that_is_asked_for(kept: list[Any]) -> None:
    panels = [curves(), curves(y_from_zero=True), curves(y_log=True)]
    curves_figure.curves_figure(PATH, panels, "three")
    plain, zero, log = kept[0].axes
    assert plain.get_ylim()[0] != 0.0
    assert zero.get_ylim()[0] == 0.0
    assert [a.get_yscale() for a in (plain, zero, log)] == ["linear", "linear", "log"]
    assert kept[0].get_suptitle() == "three"


def test_ticks_of_a_logarithmic_axis_are_plain_numbers(kept: list[Any]) -> None:
    """Each power of ten, and between them 2 and 5."""
    curves_figure.curves_figure(PATH, [curves(y_log=True)], "")
    axis = kept[0].axes[0].yaxis
    assert [axis.get_major_formatter()(y, 0) for y in (0.01, 1.0, 100.0)] == ["0.01", "1", "100"]
    minor = {y: axis.get_minor_formatter()(y, 0) for y in (0.2, 0.3, 0.5, 2.0, 4.0, 50.0, 90.0)}
    assert minor == {0.2: "0.2", 0.3: "", 0.5: "0.5", 2.0: "2", 4.0: "", 50.0: "50", 90.0: ""}


def test_curves_without_names_have_no_legend(kept: list[Any]) -> None:
    nameless = DrawnCurve([0.0, 1.0], [0.5, 20.0], None, "red", style="--", marker="s")
    curves_figure.curves_figure(PATH, [curves(series=[nameless])], "")
    (axes,) = kept[0].axes
    assert axes.get_legend() is None
    assert (axes.lines[0].get_linestyle(), axes.lines[0].get_marker()) == ("--", "s")


# --- flights ------------------------------------------------------------------------------------


def test_a_flight_has_its_path_its_lines_and_its_histories(kept: list[Any]) -> None:
    time = np.linspace(0.0, 10.0, 20)
    x, z = -30.0 + np.sin(time), 30.0 + np.cos(time)
    line = DrawnLine(name="a", x0_m=-30.7, z0_m=30.7, eta_rad=2.0, crossings=[])
    panels = [
        HistoryPanel("z [m]", [Trace(time, z, "flown"), Trace(time, z + 1.0)], (0.0, 60.0)),
        HistoryPanel("x [m]", [Trace(time, x, colour="red", style="--")]),
    ]
    spans = Spans([(2.0, 8.0, "a"), (8.0, 9.0, "b")])
    flight_figure.flight_figure(
        PATH, MapAir(HILL, POLAR, BOUNDS, BOARD), [line], x, z, panels, "a flight", spans
    )
    (figure,) = kept
    plane, upper, lower = (axes for axes in figure.axes if axes.get_ylabel())
    assert labelled(plane, "flown path")[0].get_xydata() == pytest.approx(np.stack([x, z], axis=1))
    assert labelled(plane, "start")[0].get_xydata().tolist() == [[x[0], z[0]]]
    (a, b), (a1, b1) = labelled(plane, "TGL a")[0].get_xydata()
    assert np.hypot(a1 - a, b1 - b) == pytest.approx(16.0)
    assert labelled(plane, "TGL a")[0].get_color() == PALETTE[0]
    assert not labelled(plane, "ZEUC, later")
    assert [axes.get_ylabel() for axes in (upper, lower)] == ["z [m]", "x [m]"]
    assert upper.lines[0].get_xydata() == pytest.approx(np.stack([time, z], axis=1))
    assert lower.lines[0].get_xydata() == pytest.approx(np.stack([time, x], axis=1))
    assert (lower.lines[0].get_color(), lower.lines[0].get_linestyle()) == ("red", "--")
    assert upper.get_ylim() == (0.0, 60.0)
    assert words(upper.get_legend()) == ["flown"]
    assert lower.get_legend() is None
    assert (upper.get_xlabel(), lower.get_xlabel()) == ("", "time [s]")
    # Both panels are shaded, and the words stand above the first, in the middle of their spans.
    assert [(t.get_text(), t.get_position()[0]) for t in upper.texts] == [("a", 5.0), ("b", 8.5)]
    assert not lower.texts
    for panel in (upper, lower):
        shaded = [
            patch.get_extents().transformed(panel.transData.inverted()) for patch in panel.patches
        ]
        assert [(box.x0, box.x1) for box in shaded] == [
            pytest.approx((2.0, 8.0)), pytest.approx((8.0, 9.0)),
        ]  # fmt: skip
    assert upper.get_shared_x_axes().joined(upper, lower)
    assert figure.get_suptitle() == "a flight"


def test_a_flight_that_was_not_flown_has_no_path_and_later_air_a_dashed_contour(
    kept: list[Any],
) -> None:
    class Rising(HillField):
        """The wind grows."""

        def wind(self, x: Any, y: Any, z: Any, time_s: float = 0.0) -> Any:
            return (STRONGER if time_s > 4.0 else HILL).wind(x, y, z)

    rising = Rising(8.0, 20.0)
    air = MapAir(rising, POLAR, BOUNDS, None, later_s=5.0, later_label="in 5 s")
    none = np.array([])
    flight_figure.flight_figure(PATH, air, [], none, none, [HistoryPanel("z [m]", [])], "later")
    plane = kept[0].axes[0]
    assert not labelled(plane, "flown path")
    dashed = [line for line in plane.lines if line.get_linestyle() == "--"]
    now, later = (
        [p.tolist() for p in contour(rising, POLAR, BOUNDS, STEP_M, time_s=t) if len(p) > 2]
        for t in (0.0, 5.0)
    )
    assert [line.get_xydata().tolist() for line in dashed] == later != now
    assert dashed[0].get_label() == "in 5 s"
    assert all(line.get_label().startswith("_") for line in dashed[1:])


def timeline(modes: list[str], title: str = "t") -> Timeline:
    time_s = np.arange(float(len(modes))) + 12.0
    return Timeline(
        title=title,
        fault=(13.0, 14.0),
        time_s=time_s,
        mode=modes,
        e_rho_m=0.01 * time_s,
        age_s=2.0 * time_s,
        commanded=3.0 * time_s,
        surface=4.0 * time_s,
    )


def spans(panel: Any) -> list[tuple[float, float, str]]:
    from matplotlib.colors import to_hex

    boxes = [p for p in panel.patches if p.get_fill()]
    return [
        (p.get_x(), p.get_x() + p.get_width(), to_hex(p.get_facecolor()).upper()) for p in boxes
    ]


def test_a_timeline_has_distance_age_and_elevator_over_time(kept: list[Any]) -> None:
    flights = [timeline(["soaring"] * 4, "one"), timeline(["failed"] * 4, "two")]
    timeline_figure.draw_timelines(PATH, flights)
    (figure,) = kept
    grid = np.array(figure.axes).reshape(3, 2)
    time_s = [12.0, 13.0, 14.0, 15.0]
    for column, title in zip(grid.T, ("one", "two"), strict=True):
        distance, age, elevator = column
        assert distance.lines[0].get_xydata().tolist() == [[t, pytest.approx(t)] for t in time_s]
        assert age.lines[0].get_xydata().tolist() == [[t, 2.0 * t] for t in time_s]
        surface, command = elevator.lines
        assert surface.get_xydata().tolist() == [[t, 4.0 * t] for t in time_s]
        assert command.get_xydata().tolist() == [[t, 3.0 * t] for t in time_s]
        assert [surface.get_label(), command.get_label()] == ["surface", "command of the module"]
        assert surface.get_color() != command.get_color()
        assert distance.get_title() == title
        assert elevator.get_xlabel() == "time [s]"
        assert elevator.get_xlim() == (12.0, 15.0)
        for panel in column:  # the fault is hatched
            (fault,) = (p for p in panel.patches if not p.get_fill())
            assert (fault.get_x(), fault.get_width()) == (13.0, 1.0)
            assert fault.get_hatch()
    labels = ["e_rho [cm]", "age of the position [s]", "elevator [-]"]
    assert [axes.get_ylabel() for axes in grid[:, 0]] == labels
    assert words(grid[2, 1].get_legend()) == ["surface", "command of the module"]


def test_modes_are_shaded_from_change_to_change_and_those_that_were_are_named(
    kept: list[Any],
) -> None:
    modes = ["soaring", "soaring", "boot", "holding", "holding", "released"]
    timeline_figure.draw_timelines(PATH, [timeline(modes), timeline(["capturing"] * 6)])
    (figure,) = kept
    grid = np.array(figure.axes).reshape(3, 2)
    for panel in grid[:, 0]:
        assert spans(panel) == [
            (12.0, 13.0, MODE_COLOURS["soaring"]),
            (15.0, 16.0, MODE_COLOURS["holding"]),
            (17.0, 17.0, MODE_COLOURS["released"]),
        ]
    assert spans(grid[0, 1]) == [(12.0, 17.0, MODE_COLOURS["capturing"])]
    (legend,) = figure.legends
    assert words(legend) == ["capturing", "soaring", "holding", "released"]


def test_every_mode_in_which_a_line_is_held_is_shaded_and_named(kept: list[Any]) -> None:
    """And those in which a flight ends."""
    modes = [*HOLDING_LINE, "released", "failed"]
    timeline_figure.draw_timelines(PATH, [timeline(modes)])
    shaded = spans(kept[0].axes[0])
    assert [begin for begin, *_ in shaded] == [12.0 + n for n in range(len(modes))]
    assert len({colour for *_, colour in shaded}) == len(modes)
    (legend,) = kept[0].legends
    assert words(legend) == modes


def test_a_mode_of_the_first_sample_alone_ends_there(kept: list[Any]) -> None:
    timeline_figure.draw_timelines(PATH, [timeline(["capturing", "soaring", "soaring"])])
    assert spans(kept[0].axes[0]) == [
        (12.0, 12.0, MODE_COLOURS["capturing"]),
        (13.0, 14.0, MODE_COLOURS["soaring"]),
    ]


def test_one_timeline_alone_is_drawn_too(kept: list[Any]) -> None:
    timeline_figure.draw_timelines(PATH, [timeline(["soaring"] * 3)])
    assert len(kept[0].axes) == 3
    assert GROUND not in {colour for *_, colour in spans(kept[0].axes[0])}

"""What stands in a report's figures, number by number: which column, in which unit, and where."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import cos, hypot, nan, pi, radians, sin
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_hex

from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import Crossing
from tgl_soar.analysis.logs.flight_data import Event, FlightData, LoggedMode, Series
from tgl_soar.analysis.report.figure_style import MODE_COLOURS, PALETTE
from tgl_soar.analysis.report.flight_report_figures import (
    BANDS,
    PATH_POINTS,
    Curve,
    Surroundings,
    TimePanel,
    flown_path,
    health_panels,
    history_figure,
    lateral_panels,
    longitudinal_panels,
    mode_spans,
    places_figure,
    plane_figure,
    span_of,
    thinned,
)
from tgl_soar.analysis.report.legs import ReportLeg
from tgl_soar.analysis.report.spectra import Spectrum
from tgl_soar.analysis.report.spectra_figure import spectra_figure
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.sim.score import LegScore
from tgl_soar.types import GlidePolar

POLAR = GlidePolar(c0=17.7, c1=-3.6, c2=0.2, c3=0.0, speed_min_mps=6.8, speed_max_mps=11.5)
HILL = HillField(8.0, 20.0)
LEAN_RAD = radians(15.0)
PLACE = (-30.0, 31.0)
ALL = np.arange(0.0, 100.0, 0.5)


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    plt.close("all")


def of(columns: dict[str, Any], time_s: Any = ALL) -> Series:
    times = np.asarray(time_s, dtype=float)
    return Series(times, {n: np.full(len(times), 1.0) * v for n, v in columns.items()}, "told")


def flight(*modes: tuple[float, str], end_s: float = 100.0, **parts: Any) -> FlightData:
    """One that lasts so long, with these modes."""
    last = Event(end_s, "message", "end")
    changes = tuple(LoggedMode(time_s, name) for time_s, name in modes)
    return FlightData("log", "kind", **({"modes": changes, "events": (last,)} | parts))


def only(series: str, column: str, values: Any) -> FlightData:
    parts: dict[str, Any] = {series: of({column: values})}
    return flight(**parts)


def path(x_m: Any = -30.0, z_m: Any = 30.0) -> Series:
    return of({"x_m": x_m, "y_m": 0.0, "z_m": z_m})


def leg(begin_s: float = 10.0, end_s: float = 40.0, **parts: Any) -> ReportLeg:
    mean = parts.pop("mean", (-30.0, 30.0))
    score = LegScore(
        name="a",
        settling_s=1.0,
        rms_e_rho_m=0.02,
        peak_e_rho_m=0.05,
        mean_x_m=mean[0],
        mean_z_m=mean[1],
        dispersion_m=0.1,
        crossing_m=nan,
    )
    crossing = Crossing(
        x_m=PLACE[0],
        z_m=PLACE[1],
        wind_mps=9.0,
        updraft_mps=1.0,
        excess_slope_per_s=-0.1,
        stable=True,
    )
    made = ReportLeg(
        name="a",
        line=(-30.0, 30.0, 0.5 * pi + LEAN_RAD),
        begin_s=begin_s,
        end_s=end_s,
        score=score,
        crossing=crossing,
        crossing_sigma_m=0.01,
    )
    return replace(made, **parts)


# --- which part of a flight ------------------------------------------------------------------


def test_a_flight_is_drawn_from_a_little_before_the_module_flew_to_a_little_after() -> None:
    """Three per cent of the time flown, and half a second."""
    flown = flight((0.0, "standby"), (20.0, "soaring"), (60.0, "holding"), (70.0, "released"))
    assert span_of(flown) == pytest.approx((20.0 - 2.0, 70.0 + 2.0))
    again = flight((0.0, "soaring"), (20.0, "standby"), (98.0, "soaring"), (99.5, "standby"))
    assert span_of(again) == (0.0, 100.0)  # not beyond the log
    assert span_of(flight((0.0, "standby"))) == (0.0, 100.0)
    empty = span_of(flight(end_s=0.0))
    assert empty[0] == 0.0 < empty[1] < 0.01


def test_a_mode_lasts_until_the_next_and_the_last_until_the_end() -> None:
    modes = [LoggedMode(1.0, "ready"), LoggedMode(3.0, "soaring")]
    assert mode_spans(modes, 9.0) == [(1.0, 3.0, "ready"), (3.0, 9.0, "soaring")]


def test_a_short_curve_stays_whole_and_of_a_long_one_each_part_keeps_its_extremes() -> None:
    time = np.arange(20.0)
    wave = np.where(time % 2.0 == 0.0, time, -time)
    assert thinned(time, wave, 10)[1] is wave
    kept, values = thinned(np.arange(21.0), np.arange(21.0) ** 2, 10)
    assert len(kept) == 20  # the first and the last of each part
    assert (kept[0], kept[-1]) == (0.0, 20.0)
    assert values == pytest.approx(kept**2)
    unknown = thinned(np.arange(100.0), np.full(100, nan), 10)[1]
    assert len(unknown) == 10
    assert np.isnan(unknown).all()


def test_the_path_is_what_is_known_of_it_while_the_module_flies() -> None:
    x = np.where((ALL > 30.0) & (ALL < 40.0), nan, ALL)
    z = np.where(ALL > 60.0, nan, 5.0)
    found = flown_path(flight((0.0, "standby"), (20.0, "soaring"), path=path(x, z)))
    assert found is not None
    begin = 20.0 - (0.03 * 80.0 + 0.5)
    expected = ALL[(begin <= ALL) & (ALL <= 60.0) & ~((ALL > 30.0) & (ALL < 40.0))]
    assert found.time_s.tolist() == expected.tolist()
    assert found["x_m"].tolist() == expected.tolist()
    two = np.where(ALL < 0.75, 1.0, nan)
    assert flown_path(flight(path=path(two))) is not None
    assert flown_path(flight(path=path(np.where(ALL < 0.25, 1.0, nan)))) is None
    assert flown_path(flight(path=path(two, np.where(ALL < 0.25, nan, 1.0)))) is None
    assert flown_path(flight()) is None


# --- the vertical plane ----------------------------------------------------------------------


def drawn_plane(flown: FlightData, *legs: ReportLeg, known: Surroundings | None = None) -> Any:
    figure = plane_figure(plt, flown, legs, known or Surroundings())
    assert figure is not None
    return figure


def test_the_plane_is_as_wide_as_path_places_and_lines_with_air_around() -> None:
    """Bounds by hand: 20 m wide and 5 m high, so the margin is 7 m."""
    x = np.linspace(-40.0, -20.0, len(ALL))
    flown = flight(path=path(x, np.linspace(25.0, 30.0, len(ALL))))
    (axes, bar) = drawn_plane(flown, leg(crossing=None)).axes
    margin = 0.35 * 20.0
    assert axes.get_ylim() == pytest.approx((25.0 - 1.3 * margin, 30.0 + margin))
    assert axes.get_xlim() == pytest.approx((-40.0 - 1.4 * margin, -20.0 + 1.4 * margin))
    assert bar.get_ylabel() == "time [s]"
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "x, downstream [m]    wind →",
        "height z [m]",
    )
    assert axes.get_aspect() == 1.0
    wider = drawn_plane(flown, leg(crossing=None, line=(-60.0, 0.0, 0.5 * pi))).axes[0]
    assert wider.get_xlim() == pytest.approx((-60.0 - 1.4 * 14.0, -20.0 + 1.4 * 14.0))
    crossing = leg().crossing
    assert crossing is not None
    higher = drawn_plane(flown, leg(crossing=crossing._replace(z_m=55.0))).axes[0]
    assert higher.get_ylim() == pytest.approx((25.0 - 1.3 * 10.5, 55.0 + 10.5))
    height = 55.0 - 25.0 + 2.3 * 10.5
    assert higher.get_xlim() == pytest.approx((-30.0 - 0.8 * height, -30.0 + 0.8 * height))


def test_a_flight_on_the_spot_has_a_plane_of_a_metre() -> None:
    axes = drawn_plane(flight(path=path())).axes[0]
    margin = 0.35 * 0.6
    assert axes.get_ylim() == pytest.approx((30.0 - 1.3 * margin, 30.0 + margin))
    assert axes.get_xlim() == pytest.approx((-30.0 - 0.3 - 1.4 * margin, -30.0 + 0.594))


def test_the_path_is_coloured_by_its_time_from_its_start() -> None:
    x, z = -30.0 + 0.1 * ALL, 30.0 + 0.2 * ALL
    axes = drawn_plane(flight(path=path(x, z))).axes[0]
    halo, coloured = axes.collections
    assert coloured.get_array().tolist() == ALL[:-1].tolist()
    segments = coloured.get_segments()
    assert len(segments) == len(halo.get_segments()) == len(ALL) - 1
    assert segments[3] == pytest.approx(np.stack([x[3:5], z[3:5]], axis=1))
    (start,) = [line for line in axes.lines if line.get_label() == "start"]
    assert (start.get_xdata()[0], start.get_ydata()[0]) == (x[0], z[0])


def test_a_long_path_is_drawn_with_some_ten_thousand_points() -> None:
    n = 2 * PATH_POINTS + 1
    time = np.linspace(0.0, 100.0, n)
    long = of({"x_m": time, "y_m": 0.0, "z_m": 0.0}, time)
    coloured = drawn_plane(flight(path=long)).axes[0].collections[-1]
    assert len(coloured.get_segments()) == PATH_POINTS
    assert coloured.get_segments()[1][:, 0] == pytest.approx(time[[2, 4]])


def test_each_line_leans_as_it_does_and_is_drawn_once_with_its_place() -> None:
    other = leg(name="b", line=(-28.0, 30.0, 0.5 * pi), crossing=None)
    figure = drawn_plane(flight(path=path()), leg(), leg(50.0, 90.0), other)
    axes = figure.axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    assert {name for name in lines if not name.startswith("_")} == {"TGL a", "TGL b", "start"}
    for name, foot, lean in (("TGL a", -30.0, LEAN_RAD), ("TGL b", -28.0, 0.0)):
        x, z = lines[name].get_xdata(), lines[name].get_ydata()
        assert (np.mean(x), np.mean(z)) == pytest.approx((foot, 30.0))
        assert z[1] > z[0]
        assert (x[1] - x[0]) / (z[1] - z[0]) == pytest.approx(-np.tan(lean))  # leans upwind
        low, high = axes.get_ylim()
        assert z[0] < low < high < z[1]
    circles = [line for line in axes.lines if line.get_marker() == "o"]
    assert [(c.get_xdata()[0], c.get_ydata()[0]) for c in circles] == [PLACE]
    assert lines["TGL a"].get_color() == PALETTE[0]
    assert lines["TGL b"].get_color() == PALETTE[2]  # of the third leg


def test_of_many_lines_six_are_named_and_twelve_drawn() -> None:
    legs = [leg(name=str(i), line=(-30.0 + i, 30.0, 0.5 * pi), crossing=None) for i in range(14)]
    axes = drawn_plane(flight(path=path()), *legs).axes[0]
    names = [line.get_label() for line in axes.lines]
    assert [name for name in names if name.startswith("TGL")] == [f"TGL {i}" for i in range(6)]
    assert len(axes.lines) == 12 + 1  # and the start
    assert axes.lines[7].get_color() == PALETTE[1]  # the colours begin again after six


def test_the_air_is_shaded_by_round_steps_and_the_ground_lies_in_it() -> None:
    x = np.linspace(-40.0, -25.0, len(ALL))
    ground = [(-20.0, 0.0), (0.0, 20.0), (20.0, 0.0)]
    known = Surroundings(field=HILL, polar=POLAR, ground=ground)
    figure = drawn_plane(flight(path=path(x, 30.0 + 0.2 * (x + 40.0))), known=known)
    axes, time, updraft = figure.axes
    assert (time.get_ylabel(), updraft.get_xlabel()) == ("time [s]", "updraft [m/s]")
    assert axes.patches[0].get_xy()[:3].tolist() == [[*corner] for corner in ground]
    contours = [line for line in axes.lines if line.get_label().startswith("ZEUC")]
    assert len(contours) == 1
    (low_x, high_x), (low_z, high_z) = axes.get_xlim(), axes.get_ylim()
    for px, pz in contours[0].get_xydata():
        assert low_x <= px <= high_x
        assert low_z <= pz <= high_z
        wind, _, up = HILL.wind(px, 0.0, pz)
        assert up == pytest.approx(POLAR.c0 + POLAR.c1 * wind + POLAR.c2 * wind**2, abs=0.02)
    shades = next(each for each in axes.collections if hasattr(each, "levels"))
    steps = np.diff(shades.levels)
    assert steps == pytest.approx([steps[0]] * len(steps))
    assert 10 <= len(shades.levels) <= 24
    grid = np.meshgrid(np.linspace(low_x, high_x, 80), np.linspace(low_z, high_z, 80))
    inside = np.vectorize(HILL.inside)(grid[0], 0.0, grid[1])
    w = HILL.wind(grid[0], np.zeros_like(grid[0]), grid[1])[2][inside]
    assert shades.levels[0] <= 0.0
    assert shades.levels[-1] == pytest.approx(np.percentile(w, 99.0), abs=1.2 * steps[0])
    assert len(updraft.get_xticks()) <= 17
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["ZEUC: updraft = sink", "start"]


@pytest.mark.parametrize("known", [Surroundings(), Surroundings(polar=POLAR)])
def test_unknown_air_is_not_shaded(known: Surroundings) -> None:
    assert len(drawn_plane(flight(path=path()), known=known).axes) == 2


def test_without_a_polar_the_air_has_no_contour() -> None:
    figure = drawn_plane(flight(path=path()), known=Surroundings(field=HILL))
    assert [line.get_label() for line in figure.axes[0].lines] == ["start"]


# --- places ----------------------------------------------------------------------------------


def test_each_leg_is_shown_from_near_with_mean_and_place() -> None:
    """Half of the window: 1.6 times what 80 % of the path stay within, and the place in it."""
    mean = (-30.3, 30.0)
    middle = (-30.15, 30.5)
    away = np.where((ALL >= 10.0) & (ALL <= 40.0), np.linspace(0.0, 5.0, len(ALL)), 50.0)
    flown = flight(path=path(middle[0] + away, middle[1]))
    figure = places_figure(plt, flown, [leg(mean=mean)], Surroundings())
    (axes,) = figure.axes
    held = away[(ALL >= 10.0) & (ALL <= 40.0)]
    half = 1.6 * np.percentile(held, 80.0)
    assert axes.get_xlim() == pytest.approx((middle[0] - half, middle[0] + half))
    assert axes.get_ylim() == pytest.approx((middle[1] - half, middle[1] + half))
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    assert list(lines) == ["TGL", "path", "mean, last 8 s", "TGL ∩ ZEUC"]
    assert lines["mean, last 8 s"].tolist() == [[*mean]]
    assert lines["TGL ∩ ZEUC"].tolist() == [[*PLACE]]
    assert lines["path"][:, 0] == pytest.approx(middle[0] + held)
    ends = lines["TGL"]
    direction = (ends[1] - ends[0]) / hypot(*(ends[1] - ends[0]))
    eta = 0.5 * pi + LEAN_RAD
    assert direction == pytest.approx([cos(eta), sin(eta)])
    for x, z in ends:
        assert -(x + 30.0) * sin(eta) + (z - 30.0) * cos(eta) == pytest.approx(0.0, abs=1e-9)
        assert hypot(x - middle[0], z - middle[1]) > 1.5 * half  # it leaves the window
    foot = 0.5 * (ends[0] + ends[1])
    assert hypot(foot[0] - middle[0], foot[1] - middle[1]) < half
    assert axes.get_title() == "TGL a, 10 – 40 s"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x, downstream [m]", "height z [m]")


@pytest.mark.parametrize(
    ("mean", "crossing", "half"),
    [
        ((-30.0, 30.0), None, 0.03),  # held perfectly: three centimetres
        ((-30.0, 30.0), PLACE, 1.6 * 0.5),  # the path is half a metre from the middle
        (None, PLACE, 2.2 * 0.5),  # mean and place half a metre from the middle, the path in it
    ],
)
def test_the_window_of_a_leg_holds_what_is_to_be_seen(
    mean: tuple[float, float] | None, crossing: Any, half: float
) -> None:
    shown = leg(mean=mean or (-30.0, 30.0))
    if crossing is None:
        shown = replace(shown, crossing=None)
    elif mean is not None:
        shown = leg(mean=PLACE)
        half = 1.6
    middle_z = 30.5 if mean is None else 30.0
    axes = places_figure(plt, flight(path=path(-30.0, middle_z)), [shown], Surroundings()).axes[0]
    assert np.diff(axes.get_xlim()) == pytest.approx([2.0 * half])
    assert np.diff(axes.get_ylim()) == pytest.approx([2.0 * half])


@pytest.mark.parametrize(("n", "rows", "columns"), [(1, 1, 1), (3, 1, 3), (4, 2, 3), (9, 2, 3)])
def test_six_legs_at_most_stand_in_rows_of_three(n: int, rows: int, columns: int) -> None:
    legs = [leg(name=str(i), crossing=None) for i in range(n)]
    figure = places_figure(plt, flight(path=path()), legs, Surroundings())
    assert len(figure.axes) == rows * columns
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title()[:5] for axes in shown] == [f"TGL {i}" for i in range(min(n, 6))]
    for i, axes in enumerate(shown):
        assert bool(axes.get_ylabel()) == (i % columns == 0)
        assert bool(axes.get_xlabel()) == (i // columns == rows - 1)
        assert axes.lines[1].get_color() == PALETTE[i % len(PALETTE)]


def test_without_path_or_leg_there_are_no_places() -> None:
    assert places_figure(plt, flight(path=path()), [], Surroundings()) is None
    assert places_figure(plt, flight(), [leg()], Surroundings()) is None
    assert plane_figure(plt, flight(), [leg()], Surroundings()) is None


# --- in time ---------------------------------------------------------------------------------

DEGREE = radians(1.0)
Panels = Callable[[FlightData], list[TimePanel]]
# Series, column, panel, name in it; and a value in SI with the number that is to be drawn.
COLUMNS = [
    (longitudinal_panels, "tracking", "e_rho_m", "e_rho [cm]", None, 0.03, 3.0),
    (longitudinal_panels, "setpoints", "pitch_rad", "pitch [°]", "setpoint", DEGREE, 1.0),
    (longitudinal_panels, "attitude", "pitch_rad", "pitch [°]", "flown", DEGREE, 1.0),
    (longitudinal_panels, "surfaces", "elevator", "elevator [–]", None, 0.4, 0.4),
    (longitudinal_panels, "air", "updraft_mps", "updraft [m/s]", None, 0.8, 0.8),
    (longitudinal_panels, "air", "wind_mps", "speed [m/s]", "wind, estimated", 8.0, 8.0),
    (longitudinal_panels, "airspeed", "airspeed_mps", "speed [m/s]", "airspeed", 9.0, 9.0),
    (lateral_panels, "path", "y_m", "y [m]", None, 0.7, 0.7),
    (lateral_panels, "attitude", "roll_rad", "roll [°]", None, -DEGREE, -1.0),
    (lateral_panels, "setpoints", "heading_rad", "heading [°]", "setpoint", DEGREE, 1.0),
    (lateral_panels, "heading", "heading_rad", "heading [°]", "flown", DEGREE, 1.0),
    (lateral_panels, "surfaces", "aileron", "aileron [–]", None, 0.4, 0.4),
    (lateral_panels, "surfaces", "rudder", "rudder [–]", None, 0.4, 0.4),
    (health_panels, "ages", "position_age_s", "age [ms]", "position", 0.02, 20.0),
    (health_panels, "ages", "attitude_age_s", "age [ms]", "attitude", 0.02, 20.0),
    (health_panels, "ages", "heartbeat_age_s", "heartbeat [s]", None, 0.6, 0.6),
]


@pytest.mark.parametrize(("panels", "series", "column", "label", "name", "value", "shown"), COLUMNS)
def test_each_column_is_drawn_in_the_unit_of_its_panel(
    panels: Panels,
    series: str,
    column: str,
    label: str,
    name: str | None,
    value: float,
    shown: float,
) -> None:
    flown = only(series, column, value)
    (panel,) = [panel for panel in panels(flown) if panel.curves]
    assert panel.label == label
    (curve,) = panel.curves
    assert curve.label == name
    figure = history_figure(plt, flown, [], [panel])
    axes = figure.axes[-1]
    assert axes.get_ylabel() == label
    assert axes.lines[0].get_ydata() == pytest.approx(shown)
    assert bool(axes.get_legend()) is (name is not None)
    unknown = only(series, column, nan)
    assert not any(panel.curves for panel in panels(unknown))
    partly = only(series, column, np.where(ALL > 5.0, value, nan))
    assert any(panel.curves for panel in panels(partly))


def test_the_panels_stand_in_their_order_and_zero_is_drawn_where_it_means_something() -> None:
    def rows(panels: list[TimePanel]) -> list[tuple[str, bool]]:
        return [(panel.label, panel.zero) for panel in panels]

    empty = flight()
    assert rows(longitudinal_panels(empty)) == [
        ("e_rho [cm]", True),
        ("pitch [°]", False),
        ("elevator [–]", True),
        ("updraft [m/s]", True),
        ("speed [m/s]", False),
    ]
    assert rows(lateral_panels(empty)) == [
        ("y [m]", True),
        ("roll [°]", True),
        ("heading [°]", False),
        ("aileron [–]", True),
        ("rudder [–]", True),
    ]
    assert rows(health_panels(empty)) == [("age [ms]", False), ("heartbeat [s]", True)]
    assert history_figure(plt, empty, [], longitudinal_panels(empty)) is None


def history(flown: FlightData, *legs: ReportLeg, **options: Any) -> list[Any]:
    curve = Curve(of({"v": np.sin(ALL)}), "v", **options)
    panels = [TimePanel("v", [curve], zero=True), TimePanel("none", [])]
    figure = history_figure(plt, flown, legs, panels)
    return list(figure.axes)


def test_zero_is_a_line_and_a_curve_begins_and_ends_with_the_figure() -> None:
    flown = flight((0.0, "standby"), (20.0, "soaring"), (70.0, "standby"))
    _, axes = history(flown)
    curve, zero = axes.lines
    assert curve.get_xdata().tolist() == ALL[(ALL >= 18.0) & (ALL <= 72.0)].tolist()
    assert list(zero.get_ydata()) == [0.0, 0.0]
    assert axes.get_xlim() == pytest.approx((18.0, 72.0))
    assert axes.get_xlabel() == "time [s]"


def test_legs_are_shaded_while_they_last_and_named_in_their_middle() -> None:
    flown = flight((0.0, "soaring"))
    band, axes = history(flown, leg(), leg(50.0, 90.0, name="b"))
    spans = [(p.get_x(), p.get_width()) for p in axes.patches]
    assert spans == [(10.0, 30.0), (50.0, 40.0)]
    assert [(t.get_text(), *t.get_position()) for t in axes.texts] == [
        ("a", 25.0, 1.0),
        ("b", 70.0, 1.0),
    ]
    assert [t.get_text() for t in band.texts] == ["soaring"]
    many = [leg(float(i), i + 1.0, name=str(i)) for i in range(30)]
    assert len(history(flown, *many)[1].texts) == 24


def test_without_modes_or_events_there_is_no_band() -> None:
    plain = flight(events=(), path=path())
    assert len(history(plain)) == 1
    assert len(history(replace(plain, events=(Event(1.0, "a", "b"),)))) == 2
    assert len(history(replace(plain, autopilot_modes=(LoggedMode(0.0, "FBWA"),)))) == 2


def test_modes_are_bands_of_their_colours_with_names_where_there_is_room() -> None:
    modes = ((0.0, "soaring"), (50.0, "capturing"), (55.0, "released"), (55.1, "soaring"))
    band = history(flight(*modes))[0]
    shown = [(p.get_x(), p.get_width(), to_hex(p.get_facecolor())) for p in band.patches]
    expected = [(0.0, 50.0, "soaring"), (50.0, 5.0, "capturing")]
    expected += [(55.0, 0.1, "released"), (55.1, 44.9, "soaring")]
    for found, (begin, length, name) in zip(shown, expected, strict=True):
        assert found[:2] == pytest.approx((begin, length))
        assert found[2] == MODE_COLOURS[name].lower()
    texts = [(t.get_text(), t.get_position()[0]) for t in band.texts]
    assert [name for name, _ in texts] == ["soaring", "soaring"]
    assert [x for _, x in texts] == pytest.approx([25.0, 77.55])
    # Too short for their names: in the legend, and the failure however short it is.
    assert [t.get_text() for t in band.get_legend().get_texts()] == ["capturing", "released"]


@pytest.mark.parametrize(
    ("seconds", "name", "legend"),
    [(0.1, "capturing", False), (0.3, "capturing", True), (0.1, "failed", True)],
)
def test_a_moment_is_named_if_it_is_loud(seconds: float, name: str, legend: bool) -> None:
    """Two thousandths of the time are too short to be visible."""
    modes = ((0.0, "soaring"), (50.0, name), (50.0 + seconds, "soaring"))
    assert (history(flight(*modes))[0].get_legend() is not None) is legend


@pytest.mark.parametrize(("seconds", "inside"), [(8.7, False), (9.1, True)])
def test_a_name_stands_in_its_band_where_it_fits(seconds: float, inside: bool) -> None:
    """Seven letters of a hundredth of the width each, with space around: nine per cent."""
    modes = ((0.0, "soaring"), (40.0, "holding"), (40.0 + seconds, "soaring"))
    band = history(flight(*modes))[0]
    assert ("holding" in [t.get_text() for t in band.texts]) is inside


def test_every_mode_has_a_colour_of_its_own() -> None:
    assert tuple(MODE_COLOURS) == MODE_NAMES
    assert len(set(MODE_COLOURS.values())) == len(MODE_COLOURS)


def test_dark_bands_have_white_names() -> None:
    names = ("soaring", "released", "recovering", "failed", "standby", "holding", "capturing")
    modes = [(14.0 * i, name) for i, name in enumerate(names)]
    band = history(flight(*modes))[0]
    white = {t.get_text() for t in band.texts if t.get_color() == "white"}
    assert white == {"released", "soaring", "recovering", "failed"}


def test_the_autopilots_modes_stand_in_where_the_modules_are_not_reported() -> None:
    others = (LoggedMode(0.0, "FBWA"), LoggedMode(50.0, ""))
    band = history(flight(autopilot_modes=others))[0]
    assert next(t.get_text() for t in band.texts) == "FBWA"
    ours = flight((0.0, "soaring"), autopilot_modes=others)
    assert [t.get_text() for t in history(ours)[0].texts] == ["soaring"]


def test_events_are_ticks_at_their_times_within_the_figure() -> None:
    events = tuple(Event(t, "message", "m") for t in (1.0, 30.0, 50.0, 100.0))
    flown = flight((0.0, "standby"), (20.0, "soaring"), (70.0, "standby"), events=events)
    band = history(flown)[0]
    (ticks,) = band.collections
    assert [segment[0][0] for segment in ticks.get_segments()] == [30.0, 50.0]
    assert all(segment[:, 1].tolist() == [0.68, 1.0] for segment in ticks.get_segments())
    assert [t.get_text() for t in band.get_yticklabels()] == ["mode", "events"]
    assert len(history(flight((0.0, "soaring"), events=(), path=path()))[0].collections) == 0


def test_what_swings_is_its_mean_with_a_band_from_its_lowest_to_its_highest() -> None:
    """A sawtooth of ten samples in each of the parts of the time."""
    end_s = float(BANDS)
    time = np.arange(0.0, end_s, 0.1) + 0.05
    teeth = np.tile(np.arange(10.0), BANDS)
    teeth[5::10] = nan
    known = np.array([0, 1, 2, 3, 4, 6, 7, 8, 9])
    ages = of({"v": teeth}, time)
    flown = flight((0.0, "standby"), end_s=end_s)
    curve = Curve(ages, "v", 2.0, label="teeth", band=True)
    axes = history_figure(plt, flown, [], [TimePanel("v", [curve])]).axes[1]
    (line,) = axes.lines
    assert len(line.get_xdata()) == BANDS
    assert line.get_ydata() == pytest.approx(2.0 * known.mean())
    middle = 0.05 + 0.1 * known.mean()
    assert line.get_xdata() == pytest.approx(np.arange(BANDS) + middle)
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == (0.0, 18.0)


# --- in frequency ----------------------------------------------------------------------------


def spectrum(top: float = 4.0, low: float = 1.0) -> Spectrum:
    frequency = np.array([0.125, 0.25, 0.5])
    density = np.array([low, top, low])
    return Spectrum(frequency_hz=frequency, density=density, peak_hz=0.25, rms=0.1, seconds=60.0)


def test_both_spectra_are_drawn_with_unit_and_peak() -> None:
    left, right = spectra_figure(plt, spectrum(), spectrum(8.0)).axes
    for axes, title, unit, top in (
        (left, "e_rho", "m²/Hz", 4.0),
        (right, "updraft, estimated on board", "(m/s)²/Hz", 8.0),
    ):
        assert axes.get_title() == title
        assert axes.get_ylabel() == f"density [{unit}]"
        assert axes.get_xlabel() == "frequency [Hz]"
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        curve, peak = axes.lines
        assert curve.get_xydata().tolist() == [[0.125, 1.0], [0.25, top], [0.5, 1.0]]
        assert list(peak.get_xdata()) == [0.25, 0.25]
        assert axes.texts[0].get_text() == "most power around 0.25 Hz"
        assert axes.get_ylim() == pytest.approx((1.0, 3.0 * top))
        # Decimals for frequencies, powers of ten for all densities.
        assert [axes.xaxis.get_major_formatter()(x, 0) for x in (0.1, 100.0)] == ["0.1", "100"]
        labels = [axes.yaxis.get_major_formatter()(y, 0) for y in (0.1, 1e-3, 1.0, 1e-10, 0.2)]
        assert labels == ["10⁻¹", "10⁻³", "10⁰", "10⁻¹⁰", "0.2"]


def test_one_spectrum_is_drawn_alone_and_none_not_at_all() -> None:
    assert [a.get_title() for a in spectra_figure(plt, None, spectrum()).axes] == [
        "updraft, estimated on board"
    ]
    assert [a.get_title() for a in spectra_figure(plt, spectrum(), None).axes] == ["e_rho"]
    assert spectra_figure(plt, None, None) is None


def test_a_spectrum_shows_seven_decades_at_most() -> None:
    axes = spectra_figure(plt, spectrum(4.0, 1e-12), None).axes[0]
    assert axes.get_ylim() == pytest.approx((4e-7, 12.0))

"""The figures of a flight's report, drawn from its log.

Each takes what it needs and returns None where the log has nothing to draw.  Curves are thinned
to what a page can show, keeping every peak; what is dense (the map, the path) is drawn as
pixels inside the vector figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, degrees, hypot, sin
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Bounds, ZeucError, contour
from tgl_soar.analysis.logs.flight_data import FlightData, LoggedMode, Series
from tgl_soar.analysis.report.figure_style import (
    DARK_MODES,
    GROUND,
    MODE_COLOURS,
    PALETTE,
)
from tgl_soar.analysis.report.legs import FLYING, Line, ReportLeg
from tgl_soar.analysis.report.smooth_map import draw_smooth_map
from tgl_soar.types import GlidePolar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
Outline = list[tuple[float, float]]
Span = tuple[float, float]

WIDTH_IN: Final = 7.4
INK: Final = "#1f2429"
BLUE: Final = "#0072B2"
RED: Final = "#D55E00"
PALE: Final = "#8a949e"
UPDRAFT_STEPS: Final = (0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0)  # between two greys [m/s]
POINTS: Final = 1400  # of a curve: about one for every other pixel of a page
HEARTBEATS_S: Final = 1.0  # between two: sampled often, their age is a beating of two rates
BANDS: Final = 240  # parts of the time, each a mean: a line that eyes can follow
PATH_POINTS: Final = 12_000
WHOLE: Final = 2.5  # times what most of a leg needs: so much wider shows all of it
LOUD_MODES: Final = ("holding", "recovering", "released", "failed")  # named however short


@dataclass(frozen=True)
class Surroundings:
    """What is known of a flight beside its log."""

    site: str = ""
    airframe: str = ""
    lines: Mapping[str, Line] = field(default_factory=dict)
    field: WindField | None = None
    polar: GlidePolar | None = None
    ground: Outline | None = None


def span_of(flight: FlightData) -> Span:
    """What of a flight is drawn: from before the module took the surfaces to after the end."""
    flown = [
        (begin, end)
        for begin, end, name in mode_spans(flight.modes, flight.duration_s)
        if name in FLYING
    ]
    if not flown:
        return 0.0, max(flight.duration_s, 1e-3)
    margin = 0.03 * (flown[-1][1] - flown[0][0]) + 0.5
    return max(0.0, flown[0][0] - margin), min(flight.duration_s, flown[-1][1] + margin)


def mode_spans(modes: Sequence[LoggedMode], end_s: float) -> list[tuple[float, float, str]]:
    """From when to when each mode lasted."""
    following = zip(modes, [*modes[1:], LoggedMode(end_s, "")], strict=False)
    return [(mode.time_s, after.time_s, mode.name) for mode, after in following]


def thinned(time_s: Floats, values: Floats, points: int = POINTS) -> tuple[Floats, Floats]:
    """A curve with its lowest and highest sample in each of so many bins; gaps stay gaps."""
    if len(time_s) <= 2 * points:
        return time_s, values
    rows = np.linspace(0, len(time_s), points + 1).astype(int)
    kept = []
    for a, b in zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True):
        part = values[a:b]
        if np.isfinite(part).any():
            kept += sorted({a + int(np.nanargmin(part)), a + int(np.nanargmax(part))})
        else:
            kept.append(a)
    return time_s[kept], values[kept]


# --- the vertical plane ---------------------------------------------------------------------


def plane_figure(
    plt: Any, flight: FlightData, legs: Sequence[ReportLeg], known: Surroundings
) -> Any:
    """Updraft and contour, where the air is known; lines; the path coloured by time."""
    path = flown_path(flight)
    if path is None:
        return None
    bounds = _bounds(path, legs)
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 5.0), layout="constrained")
    shades = _map(axes, known, bounds)
    _lines(axes, legs, bounds)
    coloured = _coloured_path(axes, path)
    axes.plot(path["x_m"][0], path["z_m"][0], "^", color=INK, ms=6, zorder=9, label="start")
    figure.colorbar(coloured, ax=axes, label="time [s]", shrink=0.72, pad=0.015, aspect=28)
    if shades is not None:
        figure.colorbar(
            shades,
            ax=axes,
            label="updraft [m/s]",
            location="bottom",
            shrink=0.6,
            aspect=42,
            ticks=shades.levels[:: max(1, len(shades.levels) // 8)],
        )
    axes.set(xlim=bounds[:2], ylim=bounds[2:])
    _plane_axes(axes)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=min(5, len(labels)), frameon=False
    )
    return figure


def places_figure(
    plt: Any, flight: FlightData, legs: Sequence[ReportLeg], known: Surroundings
) -> Any:
    """Each leg from near: its line, its place on the contour, and the path held there."""
    path = flown_path(flight)
    if path is None or not legs:
        return None
    shown = legs[:6]
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(WIDTH_IN, 2.75 * rows + 0.25), layout="constrained", squeeze=False
    )
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    for i, (leg, axes) in enumerate(zip(shown, grid.flat, strict=False)):
        _place(axes, path.within(leg.begin_s, leg.end_s), leg, known, _colour(i))
        if i % columns == 0:
            axes.set_ylabel("height z [m]")
        if i // columns == rows - 1:
            axes.set_xlabel("x, downstream [m]")
    handles, labels = grid.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def flown_path(flight: FlightData) -> Series | None:
    """The path in the vertical plane while the figures look, without what is no number."""
    if flight.path is None:
        return None
    path = flight.path.within(*span_of(flight))
    known = np.isfinite(path["x_m"]) & np.isfinite(path["z_m"])
    if np.count_nonzero(known) < 2:
        return None
    columns = {name: values[known] for name, values in path.columns.items()}
    return Series(path.time_s[known], columns, path.source)


def _bounds(path: Series, legs: Sequence[ReportLeg]) -> Bounds:
    """The path and the legs' places with some air around, in the shape of the page."""
    places = [leg.place for leg in legs if leg.place is not None]
    x = np.concatenate([path["x_m"], [p[0] for p in places], [leg.line[0] for leg in legs]])
    z = np.concatenate([path["z_m"], [p[1] for p in places]])
    width = max(0.6, float(np.ptp(x)))
    height = max(0.5, float(np.ptp(z)))
    margin = 0.35 * max(width, height)
    low, high = float(np.min(z)) - 1.3 * margin, float(np.max(z)) + margin
    middle = 0.5 * (float(np.min(x)) + float(np.max(x)))
    half = max(0.5 * width + 1.4 * margin, 0.8 * (high - low))
    return middle - half, middle + half, low, high


def _map(axes: Axes, known: Surroundings, bounds: Bounds) -> Any:
    """Updraft in grey and the contour in black; None where the air is not known."""
    if known.ground:
        axes.fill(*zip(*known.ground, strict=True), color=GROUND, zorder=4, lw=2.0)
    field = known.field
    if field is None:
        return None
    across, up = np.linspace(*bounds[:2], 360), np.linspace(*bounds[2:], 260)
    x, z = np.meshgrid(across, up)
    _, _, updraft = field.wind(x, np.zeros_like(x), z)
    is_inside = np.vectorize(field.inside, otypes=[bool])
    inside = is_inside(x, 0.0, z)
    if not np.isfinite(updraft[inside]).any():
        return None
    low, high = (float(np.nanpercentile(updraft[inside], q)) for q in (1.0, 99.0))
    updraft = np.where(inside, updraft, np.nan)
    step = next(s for s in UPDRAFT_STEPS if high - low <= 20.0 * s or s == UPDRAFT_STEPS[-1])
    levels = np.arange(np.floor(min(0.0, low) / step), np.ceil(high / step) + 1.0) * step
    shades = draw_smooth_map(
        axes, across, up, updraft, lambda x, z: is_inside(x, 0.0, z), known.ground,
        levels=levels, cmap=_greys(), extend="both",
    )  # fmt: skip
    shades.set_rasterized(True)
    _contour(axes, known, bounds, "ZEUC: updraft = sink")
    return shades


def _greys() -> Any:
    """Greys on which every colour can be seen."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["Greys"](np.linspace(0.0, 0.58, 256)))


def _contour(axes: Axes, known: Surroundings, bounds: Bounds, label: str | None) -> None:
    if known.field is None or known.polar is None:
        return
    step = (bounds[1] - bounds[0]) / 120.0
    try:
        parts = contour(known.field, known.polar, bounds, step)
    except (ZeucError, ValueError):
        return
    for part in parts:
        if len(part) > 2:
            axes.plot(part[:, 0], part[:, 1], color="black", lw=1.7, ls="--", zorder=5, label=label)
            label = None


def _lines(axes: Axes, legs: Sequence[ReportLeg], bounds: Bounds) -> None:
    """Each line once, however often it was flown; open circles where it meets the contour."""
    reach = 2.0 * hypot(bounds[1] - bounds[0], bounds[3] - bounds[2])
    drawn: dict[Line, None] = {}
    for i, leg in enumerate(legs):
        if leg.line in drawn or len(drawn) >= 12:
            continue
        drawn[leg.line] = None
        x0, z0, eta = leg.line
        ends = np.array([-reach, reach])
        axes.plot(
            x0 + ends * cos(eta),
            z0 + ends * sin(eta),
            color=_colour(i),
            lw=1.3,
            zorder=6,
            label=f"TGL {leg.name}" if len(drawn) <= 6 else None,
        )
        if leg.place is not None:
            axes.plot(*leg.place, "o", ms=9, mfc="none", mec=_colour(i), mew=1.8, zorder=8)


def _coloured_path(axes: Axes, path: Series) -> Any:
    from matplotlib.collections import LineCollection

    step = max(1, len(path) // PATH_POINTS)
    points = np.stack([path["x_m"][::step], path["z_m"][::step]], axis=1)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    halo = LineCollection(list(segments), colors="white", linewidths=2.8, zorder=6.5)
    lines = LineCollection(list(segments), cmap="plasma", linewidths=1.3, zorder=7)
    lines.set_array(path.time_s[::step][:-1])
    for collection in (halo, lines):
        collection.set_rasterized(True)
        axes.add_collection(collection)
    return lines


def _place(axes: Axes, held: Series, leg: ReportLeg, known: Surroundings, colour: str) -> None:
    x0, z0, eta = leg.line
    mean = leg.score.mean_x_m, leg.score.mean_z_m
    middle = (
        mean
        if leg.place is None
        else tuple(0.5 * (a + b) for a, b in zip(mean, leg.place, strict=True))
    )
    spread = float(np.percentile(np.hypot(held["x_m"] - middle[0], held["z_m"] - middle[1]), 80.0))
    half = max(0.03, 1.6 * spread, 2.2 * hypot(middle[0] - mean[0], middle[1] - mean[1]))
    aside = [np.abs(held[n] - m) for n, m in zip(("x_m", "z_m"), middle, strict=True)]
    whole = 1.06 * float(np.max(aside))  # of a way from afar the beginning is left out
    half = max(half, whole) if whole <= WHOLE * half else half
    bounds = (middle[0] - half, middle[0] + half, middle[1] - half, middle[1] + half)
    ends = np.array([-4.0 * half, 4.0 * half])
    s = (middle[0] - x0) * cos(eta) + (middle[1] - z0) * sin(eta)
    axes.plot(
        x0 + (s + ends) * cos(eta), z0 + (s + ends) * sin(eta), color=INK, lw=1.1, label="TGL"
    )
    _contour(axes, known, bounds, "ZEUC")
    axes.plot(
        held["x_m"], held["z_m"], color=colour, lw=0.8, alpha=0.75, zorder=6, label="path",
        rasterized=len(held) > 3000,
    )  # fmt: skip
    axes.plot(*mean, "P", ms=8, mfc="white", mec=INK, mew=1.1, zorder=8, label="mean, last 8 s")
    if leg.place is not None:
        axes.plot(
            *leg.place, "o", ms=10, mfc="none", mec=INK, mew=1.4, zorder=8, label="TGL ∩ ZEUC"
        )
    axes.set(xlim=bounds[:2], ylim=bounds[2:])
    axes.set_title(f"TGL {leg.name}, {leg.begin_s:.0f} – {leg.end_s:.0f} s", color=INK)
    axes.set_aspect("equal")
    axes.locator_params(nbins=4)


def _plane_axes(axes: Axes) -> None:
    axes.set(xlabel="x, downstream [m]    wind →", ylabel="height z [m]")
    axes.set_aspect("equal")
    axes.grid(False)


def _colour(i: int) -> str:
    return PALETTE[i % len(PALETTE)]


# --- in time --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Curve:
    """One column of one series, in the panel's unit."""

    series: Series
    column: str
    scale: float = 1.0
    label: str | None = None
    colour: str = INK
    width: float = 0.9
    band: bool = False  # it swings from sample to sample: its mean, and how far it swings
    each_s: float = 0.0  # an age that grows: the largest in each of so many seconds


@dataclass(frozen=True)
class TimePanel:
    """One time history."""

    label: str  # with its unit
    curves: Sequence[Curve]
    zero: bool = False


def history_figure(
    plt: Any, flight: FlightData, legs: Sequence[ReportLeg], panels: Sequence[TimePanel]
) -> Any:
    """The panels that have a curve above each other, modes and events on top, on one time axis."""
    panels = [panel for panel in panels if panel.curves]
    if not panels:
        return None
    begin, end = span_of(flight)
    banded = bool(flight.modes or flight.autopilot_modes or flight.events)
    heights = ([0.42] if banded else []) + [1.0] * len(panels)
    figure, grid = plt.subplots(
        len(heights),
        1,
        sharex=True,
        squeeze=False,
        figsize=(WIDTH_IN, 1.22 * sum(heights) + 0.5),
        height_ratios=heights,
        layout="constrained",
    )
    rows = list(grid[:, 0])
    if banded:
        _mode_band(rows.pop(0), flight, (begin, end))
    for axes, panel in zip(rows, panels, strict=True):
        for leg in legs:
            axes.axvspan(leg.begin_s, leg.end_s, color="0.955", lw=0, zorder=0)
        _curves(axes, panel, (begin, end))
    for leg in legs[:24]:
        rows[0].text(
            0.5 * (leg.begin_s + leg.end_s),
            1.0,
            leg.name,
            transform=rows[0].get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontsize=8,
            fontweight="bold",
            color=INK,
        )
    rows[-1].set_xlabel("time [s]")
    rows[-1].set_xlim(begin, end)
    figure.align_ylabels()
    return figure


def _curves(axes: Axes, panel: TimePanel, span: Span) -> None:
    for curve in panel.curves:
        part = curve.series.within(*span)
        if curve.band:
            _band(axes, curve, part, span)
            continue
        time, values = part.time_s, part[curve.column] * curve.scale
        if curve.each_s:
            time, values = largest(time, values, curve.each_s)
        time, values = thinned(time, values)
        axes.plot(time, values, color=curve.colour, lw=curve.width, label=curve.label)
    if panel.zero:
        axes.axhline(0.0, color="0.6", lw=0.6, zorder=1)
    axes.set_ylabel(panel.label)
    axes.locator_params(axis="y", nbins=4)
    if any(curve.label for curve in panel.curves):
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.3 * (high - low))  # room for the legend
        axes.legend(
            loc="upper right",
            ncols=len(panel.curves),
            frameon=False,
            borderpad=0.1,
            handlelength=1.4,
            columnspacing=1.2,
        )


def largest(time_s: Floats, values: Floats, each_s: float) -> tuple[Floats, Floats]:
    """The largest value in each of so many seconds, and the middle of these.

    The last ones count only if they are whole, or the only ones: an age that has just begun to
    grow would be a fall.
    """
    known = np.isfinite(values)
    if not known.any():
        return time_s, values
    time_s, values = time_s[known], values[known]
    parts = ((time_s - time_s[0]) / each_s).astype(int)
    cuts = np.flatnonzero(np.diff(parts)) + 1
    groups = np.split(values, cuts)
    count = len(groups) if len(groups) == 1 else len(groups) - 1
    middles = time_s[0] + (parts[np.array([0, *cuts])] + 0.5) * each_s
    return middles[:count], np.array([group.max() for group in groups[:count]])


def _band(axes: Axes, curve: Curve, part: Series, span: Span) -> None:
    """The mean in each of `BANDS` parts of the time, and from the lowest to the highest."""
    values = part[curve.column] * curve.scale
    known = np.isfinite(values)
    bins = ((part.time_s[known] - span[0]) / (span[1] - span[0]) * BANDS).astype(int)
    cuts = np.flatnonzero(np.diff(bins)) + 1
    groups = [group for group in np.split(values[known], cuts) if len(group)]
    times = [group.mean() for group in np.split(part.time_s[known], cuts) if len(group)]
    low, middle, high = ([f(group) for group in groups] for f in (np.min, np.mean, np.max))
    axes.fill_between(times, low, high, color=curve.colour, alpha=0.22, lw=0)
    axes.plot(times, middle, color=curve.colour, lw=1.2, label=curve.label)


def _mode_band(axes: Axes, flight: FlightData, span: Span) -> None:
    """Modes as a band of colour with their names, events as ticks above it."""
    from matplotlib.patches import Patch

    modes = flight.modes or flight.autopilot_modes
    unnamed: dict[str, None] = {}
    for begin, end, name in mode_spans(modes, flight.duration_s):
        a, b = max(begin, span[0]), min(end, span[1])
        if a >= b:
            continue
        axes.axvspan(a, b, ymin=0.0, ymax=0.6, color=_mode_colour(name), lw=0)
        if b - a > (0.011 * len(name) + 0.012) * (span[1] - span[0]):
            axes.text(
                0.5 * (a + b),
                0.29,
                name,
                ha="center",
                va="center",
                fontsize=7.5,
                color="white" if name in DARK_MODES else INK,
                transform=axes.get_xaxis_transform(),
                clip_on=True,
            )
        elif b - a > 0.002 * (span[1] - span[0]) or name in LOUD_MODES:
            unnamed[name] = None
    names = [name for name in unnamed if name]
    if names:
        axes.legend(
            handles=[Patch(color=_mode_colour(name), label=name) for name in names],
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncols=len(names),
            frameon=False,
            borderpad=0.0,
            handlelength=1.0,
            fontsize=7.5,
        )
    times = [e.time_s for e in flight.events if span[0] <= e.time_s <= span[1]]
    if times:
        axes.vlines(
            times, 0.68, 1.0, color=RED, lw=0.9, transform=axes.get_xaxis_transform(), alpha=0.8
        )
    axes.set(yticks=[0.29, 0.84], ylim=(0.0, 1.0))
    axes.set_yticklabels(["mode", "events"], fontsize=7.5)
    axes.tick_params(left=False, bottom=False)
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)


def _mode_colour(name: str) -> str:
    return MODE_COLOURS.get(name, "#c4d9e8")  # of the autopilot


def longitudinal_panels(flight: FlightData) -> list[TimePanel]:
    """What holds the line: e_rho, pitch, elevator, and what the air did."""
    deg = degrees(1.0)
    return [
        TimePanel("e_rho [cm]", _curve(flight.tracking, "e_rho_m", 100.0), zero=True),
        TimePanel(
            "pitch [°]",
            [
                *_curve(flight.setpoints, "pitch_rad", deg, "setpoint", RED, width=0.8),
                *_curve(flight.attitude, "pitch_rad", deg, "flown", BLUE),
            ],
        ),
        TimePanel("elevator [–]", _curve(flight.surfaces, "elevator"), zero=True),
        TimePanel("updraft [m/s]", _curve(flight.air, "updraft_mps", colour=BLUE), zero=True),
        TimePanel(
            "speed [m/s]",
            [
                *_curve(flight.air, "wind_mps", 1.0, "wind, estimated", PALE),
                *_curve(flight.airspeed, "airspeed_mps", 1.0, "airspeed", INK),
            ],
        ),
    ]


def lateral_panels(flight: FlightData) -> list[TimePanel]:
    """What keeps the wings level and the nose upwind."""
    deg = degrees(1.0)
    return [
        TimePanel("y [m]", _curve(flight.path, "y_m"), zero=True),
        TimePanel("roll [°]", _curve(flight.attitude, "roll_rad", deg), zero=True),
        TimePanel(
            "heading [°]",
            [
                *_curve(flight.setpoints, "heading_rad", deg, "setpoint", RED, width=0.8),
                *_curve(flight.heading, "heading_rad", deg, "flown", BLUE),
            ],
        ),
        TimePanel("aileron [–]", _curve(flight.surfaces, "aileron"), zero=True),
        TimePanel("rudder [–]", _curve(flight.surfaces, "rudder"), zero=True),
    ]


def health_panels(flight: FlightData) -> list[TimePanel]:
    """How old the inputs were."""
    ages = flight.ages
    return [
        TimePanel(
            "age [ms]",
            [
                *_curve(ages, "position_age_s", 1000.0, "position", BLUE, band=True),
                *_curve(ages, "attitude_age_s", 1000.0, "attitude", RED, band=True),
            ],
        ),
        TimePanel("heartbeat [s]", _curve(ages, "heartbeat_age_s", each_s=HEARTBEATS_S), zero=True),
    ]


def _curve(
    series: Series | None,
    column: str,
    scale: float = 1.0,
    label: str | None = None,
    colour: str = INK,
    width: float = 0.9,
    band: bool = False,
    each_s: float = 0.0,
) -> list[Curve]:
    """The curve, where there is a number in it."""
    if series is None or column not in series.columns or not np.isfinite(series[column]).any():
        return []
    look: dict[str, Any] = {"colour": colour, "width": width, "band": band, "each_s": each_s}
    return [Curve(series, column, scale, label, **look)]

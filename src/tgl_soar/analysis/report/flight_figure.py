"""A flight: the plane that it was flown in, and what happened in time."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Bounds, contour
from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save
from tgl_soar.analysis.report.zeuc_figure import DrawnLine, Outline, draw_excess_map, draw_line
from tgl_soar.types import GlidePolar

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One curve of one panel; y in the panel's unit."""

    time_s: Floats
    y: Floats
    label: str | None = None
    colour: str = "0.2"
    style: str = "-"
    width: float = 1.0


@dataclass(frozen=True)
class HistoryPanel:
    """One time history."""

    label: str  # with its unit
    traces: list[Trace]
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class MapAir:
    """The air of the map, at up to two times: the second contour is dashed."""

    field: WindField
    polar: GlidePolar
    bounds: Bounds
    ground: Outline | None
    time_s: float = 0.0
    later_s: float | None = None
    later_label: str = "ZEUC, later"


@dataclass(frozen=True)
class Spans:
    """Stretches of time that are shaded, with a word for each."""

    items: list[tuple[float, float, str]] = field(default_factory=list)


def flight_figure(
    path: Path,
    air: MapAir,
    lines: list[DrawnLine],
    flown_x_m: Floats,
    flown_z_m: Floats,
    panels: list[HistoryPanel],
    title: str,
    spans: Spans | None = None,
) -> None:
    """Write map (left) and time histories (right) to `path`.

    flown_x_m, flown_z_m: the path, shape (n,); empty: none is drawn.
    Errors: ImportError naming the extra where matplotlib is missing.
    """
    with drawing() as plt:
        figure = plt.figure(figsize=(11.0, 5.4), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.05])
        axes = left.subplots()
        shades = draw_excess_map(
            axes, air.field, air.polar, air.bounds, air.ground, time_s=air.time_s
        )
        if air.later_s is not None:
            _later_contour(axes, air)
        left.colorbar(
            shades,
            ax=axes,
            label="excess updraft [m/s]",
            orientation="horizontal",
            shrink=0.85,
            pad=0.02,
        )
        for i, line in enumerate(lines):
            draw_line(axes, line, PALETTE[i % len(PALETTE)], 8.0, f"TGL {line.name}")
        if len(flown_x_m):
            axes.plot(flown_x_m, flown_z_m, color="white", lw=2.4, zorder=5)
            axes.plot(flown_x_m, flown_z_m, color="0.15", lw=0.9, zorder=6, label="flown path")
            axes.plot(flown_x_m[0], flown_z_m[0], "k^", ms=6, zorder=8, label="start")
        left.legend(
            *axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
        )
        _time_histories(right, panels, spans or Spans())
        figure.suptitle(title, fontsize=11)
        save(plt, figure, path)


def _later_contour(axes: Any, air: MapAir) -> None:
    assert air.later_s is not None
    width = air.bounds[1] - air.bounds[0]
    label: str | None = air.later_label
    for part in contour(air.field, air.polar, air.bounds, width / 120.0, time_s=air.later_s):
        if len(part) > 2:
            axes.plot(part[:, 0], part[:, 1], color="black", lw=1.4, ls="--", zorder=3, label=label)
            label = None


def _time_histories(figure: Any, panels: list[HistoryPanel], spans: Spans) -> None:
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)
    for i, (panel, (axes,)) in enumerate(zip(panels, rows, strict=True)):
        for begin, end, word in spans.items:
            axes.axvspan(begin, end, color="0.93", lw=0, zorder=0)
            if i == 0:
                axes.text(
                    0.5 * (begin + end),
                    1.02,
                    word,
                    transform=axes.get_xaxis_transform(),
                    ha="center",
                    va="bottom",
                    fontsize=8,
                )
        for trace in panel.traces:
            axes.plot(
                trace.time_s,
                trace.y,
                trace.style,
                color=trace.colour,
                lw=trace.width,
                label=trace.label,
            )
        axes.set_ylabel(panel.label)
        if panel.limits is not None:
            axes.set_ylim(*panel.limits)
        if any(trace.label for trace in panel.traces):
            axes.legend(loc="best", framealpha=0.9)
    rows[-1][0].set_xlabel("time [s]")

"""Curves and points in one or several panels beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from tgl_soar.analysis.report.figure_style import drawing, save


@dataclass(frozen=True)
class DrawnCurve:
    """One curve or set of points; x and y in the panel's units, of one length."""

    x: Sequence[float]
    y: Sequence[float]
    label: str | None
    colour: str
    style: str = "-"
    marker: str = ""
    width: float = 1.6


@dataclass(frozen=True)
class Note:
    """A word at a place of a panel."""

    x: float
    y: float
    text: str
    colour: str = "black"


@dataclass(frozen=True)
class Mark:
    """An upright line with a word."""

    x: float
    text: str


@dataclass(frozen=True)
class CurvePanel:
    """One pair of axes."""

    title: str
    x_label: str
    y_label: str
    series: list[DrawnCurve]
    notes: list[Note] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    y_from_zero: bool = False
    y_log: bool = False
    legend: Literal["best", "upper left", "center right", "lower left"] = "best"


def curves_figure(
    path: Path, panels: list[CurvePanel], title: str, *, one_legend: bool = False
) -> None:
    """Write the panels to `path`.

    one_legend: below all panels, for what is alike in them, where it hides no curve.
    Errors: ImportError naming the extra where matplotlib is missing.
    """
    with drawing() as plt:
        figure, rows = plt.subplots(
            1,
            len(panels),
            figsize=(10.4 if len(panels) < 3 else 12.6, 4.2),
            layout="constrained",
            squeeze=False,
        )
        for panel, axes in zip(panels, rows[0], strict=True):
            for s in panel.series:
                axes.plot(
                    s.x,
                    s.y,
                    s.style,
                    marker=s.marker,
                    ms=5.5,
                    color=s.colour,
                    lw=s.width,
                    label=s.label,
                )
            if panel.y_from_zero:
                axes.set_ylim(bottom=0.0)
            if panel.y_log:
                axes.set_yscale("log")
                axes.yaxis.set_major_formatter(lambda y, _: f"{y:g}")
                axes.yaxis.set_minor_formatter(lambda y, _: f"{y:g}" if f"{y:e}"[0] in "25" else "")
            for mark in panel.marks:
                axes.axvline(mark.x, color="0.45", lw=0.9, ls=":")
                axes.annotate(
                    mark.text,
                    (mark.x, 0.02),
                    xycoords=axes.get_xaxis_transform(),
                    xytext=(3, 0),
                    textcoords="offset points",
                    rotation=90,
                    ha="left",
                    va="bottom",
                    fontsize=7.5,
                    color="0.3",
                    bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.6},
                )
            for note in panel.notes:
                axes.annotate(
                    note.text,
                    (note.x, note.y),
                    xytext=(6, 6),
                    textcoords="offset points",
                    color=note.colour,
                    fontsize=8,
                )
            axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
            if any(s.label for s in panel.series) and not one_legend:
                axes.legend(loc=panel.legend, framealpha=0.9)
        if one_legend:
            drawn = [axes.get_legend_handles_labels() for axes in rows[0]]
            by_label = {label: line for pair in drawn for line, label in zip(*pair, strict=True)}
            figure.legend(
                by_label.values(), by_label, loc="outside lower center", ncols=len(by_label)
            )
        if title:
            figure.suptitle(title, fontsize=11)
        save(plt, figure, path)

"""The map of excess updraft: contour, core, target gradient lines and where they cross."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Bounds, ZeucError, contour, excess_updraft
from tgl_soar.analysis.report.figure_style import GROUND, PALETTE, drawing, save
from tgl_soar.analysis.report.smooth_map import draw_smooth_map
from tgl_soar.types import GlidePolar

Floats = NDArray[np.float64]
Outline = list[tuple[float, float]]
LEVEL_MPS = 0.25  # between two shades
HATCH = "////"
UNDEFINED = "outside polar or field"


@dataclass(frozen=True)
class DrawnLine:
    """A target gradient line, and the places where it meets the contour."""

    name: str
    x0_m: float
    z0_m: float
    eta_rad: float
    crossings: list[tuple[float, float, bool]]  # x, z, whether it is stable


def draw_excess_map(
    axes: Any,
    field: WindField,
    polar: GlidePolar,
    bounds: Bounds,
    ground: Outline | None = None,
    *,
    time_s: float = 0.0,
    limit_mps: float | None = None,
    contour_style: dict[str, Any] | None = None,
) -> Any:
    """Shade excess updraft, draw its zero contour and the ground; returns the shading.

    Plain grey is where excess updraft is not defined: outside the polar's range or the field.
    """
    x = np.linspace(bounds[0], bounds[1], 240)
    z = np.linspace(bounds[2], bounds[3], 180)
    xx, zz = np.meshgrid(x, z)
    values = excess_updraft(field, polar, xx, zz, time_s=time_s)
    known = values[np.isfinite(values)]
    if limit_mps is None:
        limit_mps = float(np.percentile(np.abs(known), 97.0)) if known.size else 1.0
        limit_mps = max(1.0, round(limit_mps))
    levels = np.linspace(-limit_mps, limit_mps, 2 * round(limit_mps / LEVEL_MPS) + 1)
    axes.set_facecolor("0.93")
    shades = draw_smooth_map(
        axes, x, z, values,
        lambda x, z: np.isfinite(excess_updraft(field, polar, x, z, time_s=time_s)), ground, "0.93",
        levels=levels, cmap="PuOr_r", extend="both", alpha=0.85,
    )  # fmt: skip
    axes.grid(False)
    style = {"color": "black", "lw": 1.8, "zorder": 3, **(contour_style or {})}
    label = style.pop("label", "ZEUC: updraft = sink")
    try:
        parts = contour(field, polar, bounds, (bounds[1] - bounds[0]) / 120.0, time_s=time_s)
    except ZeucError:
        parts = []
    for part in parts:
        if len(part) > 2:
            axes.plot(part[:, 0], part[:, 1], label=label, **style)
            label = None
    if ground:
        axes.fill(*zip(*ground, strict=True), color=GROUND, zorder=4)
    axes.set(xlim=bounds[:2], ylim=bounds[2:], xlabel="x, downstream [m]    wind →")
    axes.set_ylabel("height z [m]")
    axes.set_aspect("equal")
    return shades


def draw_undefined(axes: Any, field: WindField, polar: GlidePolar, bounds: Bounds) -> list[Any]:
    """Hatch where excess updraft is not defined: plain grey looks like an excess of 0.

    Returns what the legend shows of it: nothing where it is defined everywhere.
    """
    from matplotlib.patches import Patch

    x, z = np.linspace(bounds[0], bounds[1], 240), np.linspace(bounds[2], bounds[3], 180)
    unknown = ~np.isfinite(excess_updraft(field, polar, *np.meshgrid(x, z)))
    if not unknown.any():
        return []
    hatched = axes.contourf(
        x, z, unknown.astype(float), levels=[0.5, 1.5], colors="none", hatches=[HATCH], zorder=2
    )
    hatched.set(edgecolor="0.6", linewidth=0.0)
    return [Patch(facecolor="0.93", edgecolor="0.6", lw=0.6, hatch=HATCH, label=UNDEFINED)]


def draw_line(axes: Any, line: DrawnLine, colour: str, reach_m: float, label: str | None) -> None:
    """A line through its point, filled circles at its stable crossings, open at the others."""
    reach = np.array([-reach_m, reach_m])
    axes.plot(
        line.x0_m + reach * cos(line.eta_rad),
        line.z0_m + reach * sin(line.eta_rad),
        color=colour,
        lw=1.4,
        zorder=5,
        label=label,
    )
    for x, z, stable in line.crossings:
        axes.plot(
            x,
            z,
            "o",
            ms=8,
            mfc=colour if stable else "white",
            mec="black" if stable else colour,
            mew=1.0 if stable else 1.6,
            zorder=7,
        )


def zeuc_figure(
    path: Path,
    field: WindField,
    polar: GlidePolar,
    bounds: Bounds,
    lines: list[DrawnLine],
    core: tuple[float, float] | None,
    title: str,
    ground: Outline | None = None,
) -> None:
    """Write the map to `path` (PNG or SVG by its ending).

    Errors: ImportError naming the extra where matplotlib is missing.
    """
    with drawing() as plt:
        figure, axes = plt.subplots(figsize=(8.0, 6.0), layout="constrained")
        shades = draw_excess_map(axes, field, polar, bounds, ground)
        figure.colorbar(shades, ax=axes, label="excess updraft w − sink(u) [m/s]", shrink=0.8)
        reach = 2.0 * max(bounds[1] - bounds[0], bounds[3] - bounds[2])
        for i, line in enumerate(lines):
            draw_line(axes, line, PALETTE[i % len(PALETTE)], reach, f"TGL {line.name}")
        if core is not None:
            axes.plot(*core, "*", ms=13, mfc="white", mec="black", zorder=7, label="core")
        axes.plot([], [], "o", ms=7, mfc="0.4", mec="black", label="TGL ∩ ZEUC, stable")
        axes.fill([], [], color="0.93", ec="0.6", lw=0.6, label=UNDEFINED)
        axes.set_title(title)
        figure.legend(
            *axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
        )
        save(plt, figure, path)

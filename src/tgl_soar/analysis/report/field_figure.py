"""Wind and updraft of a field, side by side, with its contour and places on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Bounds, ZeucError, contour
from tgl_soar.analysis.report.figure_style import GROUND, PALETTE, drawing, save
from tgl_soar.analysis.report.smooth_map import draw_smooth_map
from tgl_soar.analysis.report.zeuc_figure import Floats, Outline
from tgl_soar.types import GlidePolar

SHADES = 24


@dataclass(frozen=True)
class DrawnPlace:
    """A place with its name."""

    name: str
    x_m: float
    z_m: float


def field_figure(
    path: Path,
    field: WindField,
    polar: GlidePolar,
    bounds: Bounds,
    ground: Outline | None,
    places: list[DrawnPlace],
    title: str,
    time_s: float = 0.0,
) -> None:
    """Write u (wind downstream) and w (updraft) of the plane y = 0 to `path`.

    Errors: ImportError naming the extra where matplotlib is missing.
    """

    def known_at(x: Floats, z: Floats) -> NDArray[np.bool_]:
        return np.isfinite(speeds(field, x, z, time_s)[0])

    x, z = np.linspace(*bounds[:2], 200), np.linspace(*bounds[2:], 160)
    u, w = speeds(field, *np.meshgrid(x, z), time_s)
    try:
        parts = contour(field, polar, bounds, (bounds[1] - bounds[0]) / 120.0, time_s=time_s)
    except ZeucError:
        parts = []
    with drawing() as plt:
        figure, both = plt.subplots(
            1, 2, figsize=(11.0, 4.8), layout="constrained", sharex=True, sharey=True
        )
        names = ("wind downstream u [m/s]", "updraft w [m/s]")
        for axes, values, name, colours in zip(
            both, (u, w), names, ("viridis", "PuOr_r"), strict=True
        ):
            known = values[np.isfinite(values)]
            least, most = np.percentile(known, [1.0, 99.0]) if known.size else (0.0, 1.0)
            if colours == "PuOr_r":
                most = float(np.max(np.abs([least, most])))
                least = -most
            shades = draw_smooth_map(
                axes, x, z, values, known_at, ground, "0.93", cmap=colours,
                levels=np.linspace(least, max(most, least + 1e-6), SHADES),
                extend="both",
            )  # fmt: skip
            figure.colorbar(shades, ax=axes, label=name, shrink=0.8, format="%.1f")
            axes.set_facecolor("0.93")
            axes.grid(False)
            for part in parts:
                if len(part) > 2:
                    axes.plot(part[:, 0], part[:, 1], "k-", lw=1.4, zorder=3)
            if ground:
                axes.fill(*zip(*ground, strict=True), color=GROUND, zorder=4)
            for place, colour in zip(places, PALETTE, strict=False):
                axes.plot(
                    place.x_m, place.z_m, "o", ms=8, mfc=colour, mec="black", zorder=6,
                    label=place.name,
                )  # fmt: skip
            axes.set(xlim=bounds[:2], ylim=bounds[2:], xlabel="x, downstream [m]    wind →")
            axes.set_aspect("equal")
        both[0].set_ylabel("height z [m]")
        both[0].plot([], [], "k-", lw=1.4, label="ZEUC")
        figure.suptitle(title)
        handles = both[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=4, frameon=False)
        save(plt, figure, path)


def speeds(field: WindField, x: Floats, z: Floats, time_s: float) -> tuple[Floats, Floats]:
    """u and w [m/s], shapes as given; NaN where there is no air, be it a wall or beyond a grid."""
    u, _, w = field.wind(x, 0.0, z, time_s)
    still = (u == 0.0) & (w == 0.0)
    return np.where(still, np.nan, u), np.where(still, np.nan, w)

"""Places on a contour beside the polar that puts them there."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Bounds, contour
from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save
from tgl_soar.analysis.report.polar_figure import draw_polar
from tgl_soar.analysis.report.zeuc_figure import draw_excess_map
from tgl_soar.types import GlidePolar


@dataclass(frozen=True)
class MarkedPlace:
    """A place, the wind and updraft there, and the lean of the line through it."""

    name: str
    x_m: float
    z_m: float
    wind_mps: float
    updraft_mps: float
    lean_rad: float


def positions_figure(
    path: Path,
    field: WindField,
    stronger: WindField,
    polar: GlidePolar,
    bounds: Bounds,
    radius_m: float,
    places: list[MarkedPlace],
    stronger_label: str,
) -> None:
    """Write map and polar to `path`; the contour of the stronger wind is dashed.

    Errors: ImportError naming the extra where matplotlib is missing.
    """
    angles = [pi * i / 90 for i in range(91)]
    ground = [(radius_m * cos(a), radius_m * sin(a)) for a in angles]
    with drawing() as plt:
        figure, (left, right) = plt.subplots(
            1, 2, figsize=(10.5, 4.6), layout="constrained", width_ratios=[1.25, 1.0]
        )
        shades = draw_excess_map(left, field, polar, bounds, ground)
        figure.colorbar(shades, ax=left, label="excess updraft w − sink(u) [m/s]", shrink=0.85)
        label: str | None = stronger_label
        for part in contour(stronger, polar, bounds, (bounds[1] - bounds[0]) / 120.0):
            if len(part) > 2:
                left.plot(part[:, 0], part[:, 1], "k--", lw=1.2, label=label)
                label = None
        draw_polar(right, polar)
        reach = 0.16 * (bounds[3] - bounds[2])
        for place, colour in zip(places, PALETTE, strict=False):
            dx, dz = -reach * sin(place.lean_rad), reach * cos(place.lean_rad)
            left.plot(
                [place.x_m - dx, place.x_m + dx],
                [place.z_m - dz, place.z_m + dz],
                color=colour,
                lw=1.6,
            )
            left.plot(place.x_m, place.z_m, "o", ms=8, mfc=colour, mec="black", zorder=6)
            left.annotate(
                f"[{place.name}]",
                (place.x_m, place.z_m),
                xytext=(-4, 13) if dx < 0.5 * reach else (9, -15),
                textcoords="offset points",
                fontweight="bold",
            )
            right.plot(
                place.wind_mps, place.updraft_mps, "o", ms=8, mfc=colour, mec="black", zorder=6
            )
            right.annotate(
                f"[{place.name}] {place.updraft_mps:.2f} m/s",
                (place.wind_mps, place.updraft_mps),
                xytext=(8, 8),
                textcoords="offset points",
            )
        right.axhline(places[0].updraft_mps, color="0.5", lw=0.9, ls=":")
        left.legend(loc="upper left", framealpha=0.92)
        right.legend(loc="lower left", framealpha=0.92)
        left.set_title("hill of potential flow")
        right.set_title("illustrative polar")
        save(plt, figure, path)

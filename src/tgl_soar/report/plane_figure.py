"""The vertical plane: updraft, ZEUC, target gradient lines and the flown path."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import contour
from tgl_soar.types import GlidePolar

Floats = NDArray[np.float64]

# A palette that is told apart by the colour-blind and in grey print.
LEG_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00")


@dataclass(frozen=True)
class DrawnLeg:
    """One leg: its line, where it should end up, and the path flown on it."""

    name: str
    x0_m: float
    z0_m: float
    eta_rad: float
    crossing: tuple[float, float] | None
    x_m: Floats  # path, shape (n,)
    z_m: Floats


def draw_plane(
    path: Path,
    field: WindField,
    polar: GlidePolar,
    legs: list[DrawnLeg],
    flown_x_m: Floats,
    flown_z_m: Floats,
    title: str,
    ground: list[tuple[float, float]] | None = None,
) -> None:
    """Write the figure to `path` (PNG or SVG by its ending).

    flown_x_m, flown_z_m: the whole path, shape (n,); ground: corners of the board or hill to
    fill, in order.  Errors: ImportError naming the extra where matplotlib is missing.
    """
    try:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError:
        raise ImportError("figures need matplotlib: pip install 'tgl_soar[figures]'") from None

    every_x = np.concatenate([flown_x_m, [leg.x0_m for leg in legs]])
    every_z = np.concatenate([flown_z_m, [leg.z0_m for leg in legs]])
    wide = max(1.0, 0.35 * float(np.ptp(every_x)))
    x_range = float(np.min(every_x)) - wide, float(np.max(every_x)) + wide
    high = max(0.6, 0.5 * float(np.ptp(every_z)))
    z_range = float(np.min(every_z)) - high, float(np.max(every_z)) + high

    x, z = np.meshgrid(np.linspace(*x_range, 220), np.linspace(*z_range, 160))
    _, _, updraft = field.wind(x, np.zeros_like(x), z)
    described = np.vectorize(field.inside, otypes=[bool])(x, 0.0, z)
    updraft = np.where(described, updraft, np.nan)

    figure, axes = plt.subplots(figsize=(9.0, 6.2), layout="constrained")
    shades = axes.contourf(x, z, updraft, levels=16, cmap="Greys", alpha=0.75)
    figure.colorbar(shades, ax=axes, label="updraft [m/s]", shrink=0.85)
    if ground:
        axes.fill(*zip(*ground, strict=True), color="#5b4636", zorder=3)

    bounds = (x_range[0], x_range[1], z_range[0], z_range[1])
    for i, part in enumerate(contour(field, polar, bounds, 0.05)):
        axes.plot(
            part[:, 0], part[:, 1], "k--", lw=1.6, label="ZEUC: updraft = sink" if i == 0 else None
        )
    axes.plot(flown_x_m, flown_z_m, color="white", lw=2.6, zorder=4)
    axes.plot(flown_x_m, flown_z_m, color="0.25", lw=0.8, zorder=5, label="flown path")
    for i, leg in enumerate(legs):
        colour = LEG_COLOURS[i % len(LEG_COLOURS)]
        reach = np.array([-4.0, 4.0])
        axes.plot(
            leg.x0_m + reach * cos(leg.eta_rad),
            leg.z0_m + reach * sin(leg.eta_rad),
            color=colour,
            lw=1.4,
            label=f"TGL {leg.name}",
        )
        axes.plot(leg.x_m, leg.z_m, color=colour, lw=2.2, zorder=6)
        if leg.crossing is not None:
            axes.plot(*leg.crossing, "o", ms=9, mfc="none", mec=colour, mew=1.8, zorder=7)
    if len(flown_x_m):
        axes.plot(flown_x_m[0], flown_z_m[0], "k^", ms=7, zorder=8, label="start")
    axes.set(
        xlim=x_range,
        ylim=z_range,
        xlabel="x, downstream [m]        wind →",
        ylabel="height z [m]",
        title=title,
    )
    axes.set_aspect("equal")
    axes.legend(loc="best", fontsize=8, framealpha=0.9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    plt.close(figure)

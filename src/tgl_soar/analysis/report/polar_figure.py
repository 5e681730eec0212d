"""The glide polar: sink over horizontal airspeed, with its glides and its confidence band."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save
from tgl_soar.estimation.polar import PolarFit, best_glide_speed, sink_band
from tgl_soar.types import GlidePolar, polar_sink


def draw_polar(
    axes: Any,
    polar: GlidePolar,
    *,
    tangent: bool = True,
    band: Callable[[float], tuple[float, float]] | None = None,
) -> None:
    """Draw the polar, sink downwards, and the tangent from the origin that marks best glide."""
    speed = np.linspace(polar.speed_min_mps, polar.speed_max_mps, 200)
    sink = np.array([polar_sink(polar, float(u)) for u in speed])
    if band is not None:
        low, high = np.array([band(float(u)) for u in speed]).T
        axes.fill_between(
            speed, low, high, color=PALETTE[1], alpha=0.2, lw=0, label="95 % confidence"
        )
    axes.plot(speed, sink, color=PALETTE[1], lw=2.0, label="glide polar")
    best = best_glide_speed(polar)
    if tangent and isfinite(best):
        ratio = polar_sink(polar, best) / best
        axes.plot(
            speed,
            ratio * speed,
            color="0.35",
            lw=1.0,
            ls="--",
            label=f"best glide, 1 : {1 / ratio:.1f}",
        )
        axes.plot(best, polar_sink(polar, best), "D", ms=6, color="0.25", zorder=5)
    axes.invert_yaxis()
    axes.set(xlabel="horizontal airspeed u [m/s]", ylabel="sink [m/s]")


def polar_figure(
    path: Path,
    polar: GlidePolar,
    title: str,
    fit: PolarFit | None = None,
    speed_mps: Sequence[float] = (),
    sink_mps: Sequence[float] = (),
    beside: GlidePolar | None = None,
) -> None:
    """Write the polar to `path`; with a fit, its glides, band and residuals as well.

    `beside`: another polar to compare it with.

    Errors: ImportError naming the extra where matplotlib is missing.
    """
    with drawing() as plt:
        if fit is None:
            figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
            draw_polar(axes, polar)
        else:
            figure, (axes, lower) = plt.subplots(
                2,
                1,
                figsize=(6.4, 5.6),
                layout="constrained",
                sharex=True,
                gridspec_kw={"height_ratios": [3, 1]},
            )
            draw_polar(axes, polar, band=lambda u: sink_band(fit, u))
            axes.plot(speed_mps, sink_mps, "o", ms=4.5, color=PALETTE[0], label="glides")
            if beside is not None:
                u = np.linspace(beside.speed_min_mps, beside.speed_max_mps, 200)
                sink = [polar_sink(beside, float(each)) for each in u]
                axes.plot(u, sink, ":", lw=1.8, color="0.2", label="compared with")
            axes.set_xlabel("")
            lower.axhline(0.0, color="0.4", lw=0.8)
            lower.plot(
                speed_mps, 100.0 * np.array(fit.residuals_mps), "o", ms=4.5, color=PALETTE[0]
            )
            lower.set(xlabel="horizontal airspeed u [m/s]", ylabel="residual [cm/s]")
        axes.set_title(title)
        axes.legend(loc="lower left")
        save(plt, figure, path)

"""The figure of an identification: every manoeuvre as it was flown and as the model flies it."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from tgl_soar.analysis.identification import Fit, Identified
from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

MOST = 12  # manoeuvres shown


def identification_figure(path: Path, found: Identified, title: str) -> None:
    """Pitch rate measured and modelled, with the elevator below.

    Errors: ImportError without matplotlib, ValueError for an ending that it cannot write.
    """
    fits = found.fits[:MOST]
    columns = min(4, len(fits))
    rows = ceil(len(fits) / columns)
    with drawing() as plt:
        figure, axes = plt.subplots(
            rows,
            columns,
            figsize=(2.5 * columns + 0.6, 1.9 * rows + 0.8),
            sharey=True,
            squeeze=False,
            layout="constrained",
        )
        for axis in axes.flat[len(fits) :]:
            axis.set_visible(False)
        for i, (axis, fit) in enumerate(zip(axes.flat, fits, strict=False)):
            _draw(axis, fit)
            if i % columns == 0:
                axis.set_ylabel("pitch rate [°/s]")
            if i >= len(fits) - columns:
                axis.set_xlabel("time [s]")
        figure.suptitle(
            f"{title}: short period {found.frequency.value:.1f} rad/s, damping"
            f" {found.damping.value:.2f} at {found.airspeed_mps:.1f} m/s\n"
            "grey: measured; colour: the model; thin black: elevator, below",
            fontsize=9.0,
        )
        save(plt, figure, path)


def _draw(axis: Any, fit: Fit) -> None:
    t = fit.time_s - fit.time_s[0]
    colour = PALETTE[1] if fit.fitted else PALETTE[0]
    axis.plot(t, np.degrees(fit.pitch_rate_radps), color="0.65", lw=1.6)
    axis.plot(t, np.degrees(fit.model_pitch_rate_radps), color=colour, lw=1.2)
    elevator = axis.twinx()
    elevator.step(t, fit.elevator - fit.elevator[0], color="0.1", lw=0.7, where="post")
    elevator.set_ylim(-0.5, 3.0)
    elevator.axis("off")
    words = "fitted" if fit.fitted else "held out"
    axis.set_title(f"at {fit.time_s[0]:.0f} s, {words}", fontsize=8.0, color=colour)

"""What happened in time, flight beside flight: modes, distance to the line, elevator."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.report.figure_style import MODE_COLOURS, PALETTE, drawing, save

Floats = NDArray[np.float64]

ON_THE_GROUND = ("boot", "standby", "ready")
SHADES = {mode: c for mode, c in MODE_COLOURS.items() if mode not in ON_THE_GROUND}


@dataclass(frozen=True)
class Timeline:
    """One flight; columns of shape (n,)."""

    title: str
    fault: tuple[float, float]  # from, to [s]
    time_s: Floats
    mode: list[str]
    e_rho_m: Floats  # true
    age_s: Floats  # of the position; NaN where none was ever there
    commanded: Floats  # elevator; NaN where none is sent
    surface: Floats  # where the elevator stands


def draw_timelines(path: Path, timelines: list[Timeline]) -> None:
    """Write them side by side.  Errors: ImportError naming the extra without matplotlib."""
    with drawing() as plt:
        figure, axes = plt.subplots(
            3, len(timelines), figsize=(9.5, 5.0), sharex="col", sharey="row", squeeze=False,
            layout="constrained",
        )  # fmt: skip
        for column, flight in zip(axes.T, timelines, strict=True):
            distance, age, elevator = column
            for panel in column:
                _shade_modes(panel, flight)
                panel.axvspan(*flight.fault, fill=False, hatch="//", linewidth=0, alpha=0.25)
            distance.plot(flight.time_s, 100.0 * flight.e_rho_m, color="0.2", linewidth=1.0)
            age.plot(flight.time_s, flight.age_s, color="0.2", linewidth=1.0)
            elevator.plot(flight.time_s, flight.surface, color=PALETTE[1], label="surface")
            elevator.plot(
                flight.time_s, flight.commanded, color=PALETTE[0], linewidth=1.0,
                linestyle="--", label="command of the module",
            )  # fmt: skip
            distance.set_title(flight.title)
            elevator.set_xlabel("time [s]")
            elevator.set_xlim(flight.time_s[0], flight.time_s[-1])
        axes[0, 0].set_ylabel("e_rho [cm]")
        axes[1, 0].set_ylabel("age of the position [s]")
        axes[2, 0].set_ylabel("elevator [-]")
        axes[2, -1].legend(loc="lower right")
        modes = [mode for mode in SHADES if any(mode in f.mode for f in timelines)]
        patches = [plt.Rectangle((0, 0), 1, 1, color=SHADES[m], alpha=0.25) for m in modes]
        figure.legend(patches, modes, loc="outside lower center", ncols=len(modes))
        save(plt, figure, path)


def _shade_modes(panel: object, flight: Timeline) -> None:
    changes = [i for i in range(1, len(flight.mode)) if flight.mode[i] != flight.mode[i - 1]]
    for begin, end in pairwise([0, *changes, len(flight.mode)]):
        colour = SHADES.get(flight.mode[begin])
        if colour is not None:
            panel.axvspan(  # type: ignore[attr-defined]
                flight.time_s[begin], flight.time_s[end - 1], color=colour, alpha=0.2, linewidth=0
            )

"""What was commanded, and what a replay would have commanded, on one time axis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

_PANELS: Final = (
    ("setpoints_pitch_rad", "pitch setpoint [deg]", 180.0 / np.pi),
    ("command_elevator", "elevator [-]", 1.0),
    ("command_aileron", "aileron [-]", 1.0),
    ("command_rudder", "rudder [-]", 1.0),
)


def replay_figure(
    path: Path,
    time_s: NDArray[Any],
    logged: Mapping[str, NDArray[Any]],
    replayed: Mapping[str, NDArray[Any]],
    title: str,
) -> None:
    """Write the figure; arrays of shape (n,).

    Errors: ImportError naming the extra where matplotlib is missing; OSError.
    """
    shown = [panel for panel in _PANELS if panel[0] in logged]
    with drawing() as plt:
        figure, axes = plt.subplots(
            len(shown), 1, figsize=(9.0, 1.9 * len(shown)), sharex=True, layout="constrained"
        )
        for (name, label, scale), panel in zip(shown, np.atleast_1d(axes), strict=True):
            panel.plot(time_s, scale * logged[name], color=PALETTE[1], lw=1.3, label="logged")
            panel.plot(time_s, scale * replayed[name], color=PALETTE[0], lw=1.0, label="replayed")
            panel.set_ylabel(label)
        first = np.atleast_1d(axes)[0]
        figure.legend(
            *first.get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False
        )
        np.atleast_1d(axes)[-1].set_xlabel("time [s]")
        figure.suptitle(title, fontsize=10)
        save(plt, figure, path)

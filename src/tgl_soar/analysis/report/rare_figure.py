"""The ladder of a splitting run, and how the last seconds of what was lost look."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Final

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.rare.soaring_process import SHOWN
from tgl_soar.analysis.rare.splitting import Rung
from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

_PANELS: Final = (
    ("z_m", "height [m]"),
    ("airspeed_mps", "airspeed [m/s]"),
    ("e_rho_m", "e_rho [m]"),
)
_DRAWN: Final = 40  # losses: more hide one another


def rare_figure(
    path: Path, ladders: Sequence[Sequence[Rung]], causes: Sequence[str], last: Sequence[FloatArray]
) -> None:
    """Write the figure; last: rows of `SHOWN` for every loss, of which some are drawn.

    Errors: ImportError naming the extra where matplotlib is missing; OSError.
    """
    with drawing() as plt:
        figure, axes = plt.subplots(2, 2, figsize=(9.0, 6.0), layout="constrained")
        ladder_axes, *panels = axes.ravel()
        for rungs in ladders:
            fraction, fractions, levels = 1.0, [1.0], [1.0]
            for rung in rungs:
                fraction *= rung.passed / rung.tried
                fractions.append(fraction if fraction else float("nan"))
                levels.append(rung.level)
            ladder_axes.semilogy(levels, fractions, "o-", color=PALETTE[1], lw=0.8, ms=3.0)
        ladder_axes.yaxis.set_major_formatter(lambda fraction, _: f"{fraction:g}")
        ladder_axes.invert_xaxis()
        ladder_axes.set_xlabel("margin; 0 is lost")
        ladder_axes.set_ylabel("probability to come so far")
        lost = list(zip(causes, last, strict=True))
        lost = lost[:: max(1, ceil(len(lost) / _DRAWN))]  # of all ladders
        colours = dict(zip(dict.fromkeys(cause for cause, _ in lost), PALETTE * 9, strict=False))
        for axis, (name, label) in zip(panels, _PANELS, strict=True):
            for cause, rows in lost:
                time = rows[:, SHOWN.index("time_s")]
                axis.plot(time - time[-1], rows[:, SHOWN.index(name)], color=colours[cause], lw=0.6)
            axis.set_ylabel(label)
            axis.set_xlabel("time to the loss [s]")
        for cause, colour in colours.items():
            panels[0].plot([], [], color=colour, label=cause)
        if colours:
            figure.legend(loc="outside lower center", ncols=2)
        save(plt, figure, path)

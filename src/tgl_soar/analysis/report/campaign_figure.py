"""Flights of a campaign in groups: what became of them as shares, or how their numbers spread."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

if TYPE_CHECKING:
    from tgl_soar.analysis.campaigns.report import Report, TwoCampaigns


def campaign_figure(path: Path, report: Report) -> None:
    """Write the figure.  Errors: ImportError naming the extra where matplotlib is missing;
    OSError."""
    with drawing() as plt:
        height = 1.2 + 0.26 * len(report.groups)
        figure, axes = plt.subplots(figsize=(8.0, height), layout="constrained")
        if report.is_counted:
            _draw_fractions(axes, report)
        else:
            _draw_spreads(axes, report)
        names = [f"{group.name} ({group.flights:,})" for group in report.groups]
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        save(plt, figure, path)


def two_campaigns_figure(path: Path, two: TwoCampaigns, names: tuple[str, str]) -> None:
    """Write the figure: a share and its interval for each, group under group.  Errors: as above."""
    with drawing() as plt:
        height = 1.2 + 0.22 * len(two.rows)
        figure, axes = plt.subplots(figsize=(9.0, height), layout="constrained")
        for i, (name, colour) in enumerate(zip(names, PALETTE, strict=False)):
            places = [place + (i - 0.5) * 0.3 for place in range(len(two.rows))]
            fractions = [row.fractions[i] for row in two.rows]
            for place, fraction in zip(places, fractions, strict=True):
                low, high = fraction.interval
                axes.plot((100.0 * low, 100.0 * high), (place, place), color=colour, lw=1.5)
            middles = [100.0 * fraction.counted / fraction.of for fraction in fractions]
            axes.plot(middles, places, "os"[i], color=colour, ms=4.0, ls="none", label=name)
        rows = [
            f"{row.name} ({row.fractions[0].of:,}; {row.fractions[1].of:,})" for row in two.rows
        ]
        axes.set_yticks(range(len(rows)), rows, fontsize="small")
        axes.set_ylim(len(two.rows) - 0.5, -0.5)
        axes.set_xlim(-1.0, 101.0)
        axes.set_xlabel(f"{two.of} {two.counted} [%], 95 % intervals")
        figure.legend(loc="outside upper right", ncols=2)
        save(plt, figure, path)


def _draw_fractions(axes: Any, report: Report) -> None:
    left = [0.0] * len(report.groups)
    for i, name in enumerate(report.classes):
        widths = [100.0 * group.classes[name] / group.flights for group in report.groups]
        colour = PALETTE[(i + 2) % len(PALETTE)]
        hatch = "//" if i >= len(PALETTE) else None
        axes.barh(range(len(widths)), widths, left=left, label=name, color=colour, hatch=hatch)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel(f"{report.of}: share of the flights [%]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.6 / len(left) - 0.08), ncols=4)


def _draw_spreads(axes: Any, report: Report) -> None:
    for i, group in enumerate(report.groups):
        low, middle, high = group.spread().quantiles
        axes.plot((low, high), (i, i), color=PALETTE[1], lw=3.0, solid_capstyle="butt")
        axes.plot(middle, i, "o", color=PALETTE[0], ms=4.0)
    axes.set_xlabel(f"{report.of}: from 5 to 95 % of the flights, and half of them")

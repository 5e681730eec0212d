"""Launches and landings drawn over the ground, from the side and from above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from tgl_soar.analysis.report.figure_style import drawing, save
from tgl_soar.config.site import Site

DRAWN = 12  # paths of each kind: more hide each other


class Path3(Protocol):
    """A flight that can be drawn."""

    @property
    def path(self) -> tuple[tuple[float, float, float], ...]:
        """x, y, z [m], soaring frame."""

    @property
    def broke_off(self) -> bool:
        """Whether it came home."""


def passage_figure(path: Path, site: Site, by_kind: Mapping[str, Sequence[Path3]]) -> None:
    """Write it.  Errors: ImportError naming the extra where matplotlib is missing."""
    ground = [] if site.ground is None else site.ground.profile
    strip = site.landing
    with drawing() as plt:
        figure, axes = plt.subplots(
            2, 2, figsize=(10.5, 6.4), layout="constrained", height_ratios=[1.3, 1.0]
        )
        shown = {
            "launches": [f for f in by_kind.get("launch", ()) if not f.broke_off],
            "break-offs": list(by_kind.get("landing", ())),
        }
        for column, (title, flights) in enumerate(shown.items()):
            side, above = axes[0][column], axes[1][column]
            for flight in flights[:DRAWN]:
                xs, ys, zs = zip(*flight.path, strict=True)
                side.plot(xs, zs, lw=0.8, alpha=0.8)
                above.plot(xs, ys, lw=0.8, alpha=0.8)
            side.set_title(f"{title}, {min(DRAWN, len(flights))} of {len(flights)}")
            side.fill_between(
                [-45.0, *(x for x, _ in ground), 12.0], [0.0, *(z for _, z in ground), 0.0], -1.0,
                color="0.8",
            )  # fmt: skip
            for axis, label in ((side, "height z [m]"), (above, "to the right y [m]")):
                axis.set_xlim(-42.0 if column else -20.0, 6.0)
                axis.set_aspect("equal", adjustable="datalim" if axis is above else "box")
                axis.set_xlabel("downstream x [m]")
                axis.set_ylabel(label)
            side.set_ylim(-1.0, 18.0)
            if strip is not None and column:
                near, far = strip.x_m + 0.5 * strip.length_m, strip.x_m - 0.5 * strip.length_m
                side.plot([far, near], [strip.z_m] * 2, "k", lw=3.0)
                above.plot(
                    [far, near, near, far, far],
                    [strip.y_m + d for d in (-5.0, -5.0, 5.0, 5.0, -5.0)],
                    "k",
                    lw=1.2,
                )
        save(plt, figure, path)

"""A search with its map under it, and the searches that failed."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any, Final

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.report.smooth_map import beyond_the_edge
from tgl_soar.analysis.search.episode import Episode
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.analysis.search.searchers import Snapshot
from tgl_soar.estimation.lift_map.extended_polar import sink
from tgl_soar.types import GlidePolar

LEVELS: Final = np.linspace(-3.0, 3.0, 13)
PATH: Final = "magenta"
PANELS: Final = 24  # failures drawn at most


def true_excess(
    place: SearchPlace, polar: GlidePolar, x_m: FloatArray, z_m: FloatArray, time_s: float
) -> FloatArray:
    """E [m/s] on a grid (nx, nz), of the true field and the true polar; NaN in the ground."""
    x, z = np.meshgrid(x_m, z_m, indexing="ij")
    u, _, w = place.field.wind(x, 0.0, z, time_s)
    excess: FloatArray = w - place.sink_factor * sink(polar, u)
    floor = _floor(place, x_m)
    return np.where(z > floor[:, None], excess, np.nan)


def search_figure(
    path: Path,
    episode: Episode,
    snapshots: list[Snapshot],
    polar: GlidePolar,
    x_m: FloatArray,
    z_m: FloatArray,
) -> None:
    """Frames side by side: the map's excess, what it claims of its error, and its error."""
    import matplotlib.pyplot as plt

    place = episode.place
    columns = len(snapshots)
    figure, axes = plt.subplots(
        3, columns, figsize=(3.4 * columns, 9.0), sharex=True, sharey=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    floor = _floor(place, x_m)
    ground = z_m[None, :] <= floor[:, None]
    images: list[Any] = [None, None, None]
    for k, snapshot in enumerate(snapshots):
        truth = true_excess(place, polar, x_m, z_m, snapshot.time_s)
        estimated = np.where(ground, np.nan, snapshot.excess_mps)
        sd = np.where(ground, np.nan, snapshot.excess_sd_mps)
        shown = (
            (estimated, "coolwarm", LEVELS),
            (sd, "viridis", np.linspace(0.0, 1.5, 11)),
            (np.abs(estimated - truth), "viridis", np.linspace(0.0, 1.5, 11)),
        )
        for row, (values, colours, levels) in enumerate(shown):
            axis = axes[row][k]
            shaded = np.where(ground, beyond_the_edge(values), values)  # the ground covers it
            images[row] = axis.contourf(x_m, z_m, shaded.T, levels, cmap=colours, extend="both")
            axis.contour(x_m, z_m, truth.T, [0.0], colors="black", linewidths=1.4)
            axis.contour(
                x_m, z_m, estimated.T, [0.0], colors="black", linewidths=1.0, linestyles="dashed"
            )
            _ground(axis, place, x_m, z_m)
            flown = episode.path["time_s"] <= snapshot.time_s
            axis.plot(
                episode.path["x_m"][flown], episode.path["z_m"][flown], color=PATH, lw=1.2, zorder=4
            )
            axis.set_aspect("equal")
            axis.set_ylim(z_m[0], z_m[-1])
        axes[0][k].set_title(f"after {snapshot.time_s:.1f} s", fontsize=9)
        axes[2][k].set_xlabel("x [m], downstream")
    for row, words in enumerate(("excess E [m/s]", "claimed σ of E [m/s]", "error of E [m/s]")):
        axes[row][0].set_ylabel("z [m]")
        figure.colorbar(images[row], ax=axes[row].tolist(), label=words, shrink=0.8)
    figure.suptitle(place.words, fontsize=10)
    _legend(figure, "E = 0, true", "E = 0, as mapped")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def failures_figure(path: Path, failed: list[tuple[Episode, str]], polar: GlidePolar) -> None:
    """Searches that failed: the true air at the end, the path, and why."""
    import matplotlib.pyplot as plt

    shown = failed[:PANELS]
    columns = min(6, max(1, len(shown)))
    rows = -(-len(shown) // columns) or 1
    figure, axes = plt.subplots(
        rows, columns, figsize=(3.0 * columns, 2.8 * rows), squeeze=False, layout="constrained"
    )
    for axis in axes.ravel():
        axis.set_visible(False)
    for axis, (episode, why) in zip(axes.ravel(), shown, strict=False):
        axis.set_visible(True)
        place = episode.place
        box = place.box
        x, z = np.linspace(box.x_min_m, box.x_max_m, 80), np.linspace(box.z_min_m, box.z_max_m, 80)
        truth = true_excess(place, polar, x, z, episode.flown_s)
        ground = z[None, :] <= _floor(place, x)[:, None]
        shaded = np.where(ground, beyond_the_edge(truth), truth)
        axis.contourf(x, z, shaded.T, LEVELS, cmap="coolwarm", extend="both")
        axis.contour(x, z, truth.T, [0.0], colors="black", linewidths=1.2)
        _ground(axis, place, x, z)
        flown = episode.path
        axis.plot(flown["x_m"], flown["z_m"], color=PATH, lw=1.2, zorder=4)
        axis.plot(flown["x_m"][0], flown["z_m"][0], "o", color=PATH, ms=4, zorder=4)
        words = fill(f"{place.kind} {place.seed}: {place.words}", 52) + "\n" + fill(why, 52)
        axis.set_title(words, fontsize=6)
        axis.set_ylim(z[0], z[-1])
        axis.tick_params(labelsize=6)
    _legend(figure, "E = 0, true")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _legend(figure: Any, *zeros: str) -> None:
    """The path's colour, and lines of E = 0: the first drawn through, the second dashed."""
    from matplotlib.lines import Line2D

    styles = zip(zeros, ("-", "--"), strict=False)
    lines = [Line2D([], [], color="black", ls=style, label=name) for name, style in styles]
    lines.insert(0, Line2D([], [], color=PATH, label="path"))
    figure.legend(handles=lines, loc="outside lower center", ncols=3, frameon=False, fontsize=9)


def _ground(axis: Any, place: SearchPlace, x_m: FloatArray, z_m: FloatArray) -> None:
    """The ground with the corners of its profile, over the colours, which end in steps."""
    corners = np.asarray(place.ground.x_m[: place.ground.points])
    x = np.union1d(x_m, corners[(corners > x_m[0]) & (corners < x_m[-1])])
    axis.fill_between(x, z_m[0], _floor(place, x), color="0.6", lw=0.0, zorder=3)


def _floor(place: SearchPlace, x_m: FloatArray) -> FloatArray:
    n = place.ground.points
    return np.interp(x_m, place.ground.x_m[:n], place.ground.z_m[:n])

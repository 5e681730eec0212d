"""A point of the line that was held: the cloud of places about it, and what the brake did."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from tgl_soar.analysis.logs.flight_data import FlightData, Floats, Series
from tgl_soar.analysis.report.flight_report_figures import BLUE, INK, RED, WIDTH_IN, thinned
from tgl_soar.control.point_hold import POINT_TEXTS, acts

CLOUD_POINTS: Final = 4000
SETTLED_S: Final = 10.0  # of holding left out of the numbers: it fades in, and the point moves
_TONES: Final = ("0.93", "#dbe9f4", "#fbe3d6", "#fbe3d6", "0.85", "#f3c6c6", "#f3c6c6")
_TRIES_TONE: Final = "#efe6f2"


def held_rows(point: Series) -> Floats:
    """Of a flight's rows, 1 where a point is held and has been for some seconds."""
    held = np.array([acts(int(s)) if np.isfinite(s) else False for s in point["standing"]])
    held &= np.isfinite(point["off_m"])
    begun = np.full(len(point), np.inf)
    since = np.inf
    for i, (time_s, is_held) in enumerate(zip(point.time_s.tolist(), held.tolist(), strict=True)):
        since = min(since, time_s) if is_held else np.inf
        begun[i] = since
    settled: Floats = (held & (point.time_s - begun >= SETTLED_S)).astype(float)
    return settled


def point_words(flight: FlightData) -> str:
    """The figure's caption."""
    words = (
        "Left: where the aircraft was about the point that it held, along the line and across it."
        " Right: the brake as it was commanded, and the distance along the line; shaded orange"
        " where the point lay outside the band that the brake can hold, violet where it was tried"
        " or gave way, red where the law had returned to the line alone."
    )
    point = flight.point
    if point is None:
        return words
    rows = held_rows(point) > 0.0
    if not rows.any():
        return f"{words} No point was held for more than {SETTLED_S:g} s."
    off, brake = point["off_m"][rows], point["brake"][rows]
    ends = float(np.mean((brake <= 0.0) | (brake >= 1.0)))
    return (
        f"{words} Held, but for the first {SETTLED_S:g} s: {1000 * _rms(off):.0f} mm rms along the"
        f" line, brake {np.nanmean(brake):.2f} on average, at an end of its travel"
        f" {100 * ends:.0f} % of the time."
    )


def point_figure(plt: Any, flight: FlightData) -> Any:
    """The cloud, the brake over time, the distance over time; None where no point was asked for."""
    point = flight.point
    if point is None or not np.any(np.nan_to_num(point["standing"]) > 0.0):
        return None
    figure = plt.figure(figsize=(WIDTH_IN, 3.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.7))
    cloud = figure.add_subplot(grid[:, 0])
    brake = figure.add_subplot(grid[0, 1])
    off = figure.add_subplot(grid[1, 1], sharex=brake)
    _cloud(cloud, flight, point)
    for axes in (brake, off):
        _shade(axes, point)
    brake.plot(*thinned(point.time_s, point["brake"]), color=BLUE, lw=0.8)
    for end in (0.0, 1.0):
        brake.axhline(end, color="0.5", lw=0.7)
    brake.set(ylabel="brake", ylim=(-0.08, 1.08))
    brake.tick_params(labelbottom=False)
    off.plot(*thinned(point.time_s, 100.0 * point["off_m"]), color=INK, lw=0.8)
    off.axhline(0.0, color="0.5", lw=0.7)
    off.set(xlabel="time [s]", ylabel="along [cm]", xlim=_span(point))
    return figure


def _cloud(axes: Any, flight: FlightData, point: Series) -> None:
    rows = np.flatnonzero(held_rows(point) > 0.0)
    axes.set(xlabel="across the line [cm]", ylabel="along the line [cm]", title="About the point")
    axes.axhline(0.0, color="0.8", lw=0.7, zorder=1)
    axes.axvline(0.0, color="0.8", lw=0.7, zorder=1)
    axes.set_aspect("equal", adjustable="datalim")
    if not len(rows):
        return
    rows = rows[:: max(1, len(rows) // CLOUD_POINTS)]
    along = 100.0 * point["off_m"][rows]
    across = np.zeros_like(along)
    if flight.tracking is not None:
        across = 100.0 * flight.tracking.at("e_rho_m", point.time_s[rows])
    axes.plot(across, along, ".", ms=1.6, color=BLUE, alpha=0.35, rasterized=True, zorder=2)
    axes.plot([0.0], [0.0], "+", color=RED, ms=9, zorder=3)


def _shade(axes: Any, point: Series) -> None:
    """How the point stood."""
    standing = np.nan_to_num(point["standing"]).astype(int)
    cuts = np.flatnonzero(np.diff(standing)) + 1
    begins, ends = [0, *cuts.tolist()], [*cuts.tolist(), len(standing) - 1]
    for begin, end in zip(begins, ends, strict=True):
        number = int(standing[begin])
        tone = _TONES[number] if number < len(_TONES) else _TRIES_TONE
        if 1 < number < len(POINT_TEXTS):
            axes.axvspan(point.time_s[begin], point.time_s[end], color=tone, lw=0, zorder=0)


def _span(point: Series) -> tuple[float, float]:
    """From where a point was asked for first to where it was last."""
    times = point.time_s[np.nan_to_num(point["standing"]) > 0.0]
    margin = 0.02 * float(times[-1] - times[0]) + 0.5
    return float(times[0]) - margin, float(times[-1]) + margin


def _rms(values: Sequence[float] | Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

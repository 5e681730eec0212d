"""The open loop as multisines show it: Bode and Nyquist, with the discs of 95 %."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np

from tgl_soar.analysis.loop_response import (
    TONES_RADPS,
    LoopResponse,
    interpolated,
    open_loop_discs,
)
from tgl_soar.analysis.report.figure_style import PALETTE
from tgl_soar.analysis.report.flight_report_figures import WIDTH_IN

_FARTHEST = 3.0  # of the Nyquist plane from its middle: what matters is about -1


def loop_words(loops: Sequence[LoopResponse]) -> str:
    """The figure's caption."""
    words = [
        "Measured by multisines on the pitch setpoint; the bars and discs hold the loop with 95 %"
        " confidence, the lines are interpolated."
    ]
    for loop in loops:
        gain, phase, alpha = loop.margins
        found = [
            f"{name} {value:.2g} ({low:.2g} to {high:.2g}){unit}"
            for name, unit, (value, low, high) in (
                ("gain margin", " dB", gain),
                ("phase margin", "°", phase),
                ("disk margin", "", alpha),
            )
            if isfinite(value)
        ]
        reported = ", ".join(found) or "no margin lies between the tones"
        words.append(f"Broken at the {loop.at}, {loop.periods} periods of 5 s: {reported}.")
    return " ".join(words)


def loop_figure(plt: Any, loops: Sequence[LoopResponse]) -> Any:
    """Gain and phase over frequency, and the Nyquist plane; None without a loop."""
    if not loops:
        return None
    figure = plt.figure(figsize=(WIDTH_IN, 3.8), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.0))
    gain, phase = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    plane = figure.add_subplot(grid[:, 1])
    for loop, colour in zip(loops, PALETTE, strict=False):
        _draw(gain, phase, plane, loop, colour)
    gain.axhline(0.0, color="0.4", lw=0.8)
    phase.axhline(-180.0, color="0.4", lw=0.8)
    for axes in (gain, phase):
        axes.set_xscale("log")
        axes.set_xticks(TONES_RADPS, [f"{radps:.3g}" for radps in TONES_RADPS])
        axes.minorticks_off()
    gain.set(ylabel="gain [dB]", title="Open loop")
    phase.set(xlabel="frequency [rad/s]", ylabel="phase [°]")
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    plane.plot(np.cos(turn), np.sin(turn), color="0.6", lw=0.7)
    plane.plot([-1.0], [0.0], "+", color="black", ms=9)
    plane.set(xlabel="real", ylabel="imaginary", title="Nyquist")
    plane.set_aspect("equal")
    plane.set_xlim(-_FARTHEST, 0.5 * _FARTHEST)
    plane.set_ylim(-_FARTHEST, 0.5 * _FARTHEST)
    plane.legend(loc="upper left")
    return figure


def _draw(gain: Any, phase: Any, plane: Any, loop: LoopResponse, colour: str) -> None:
    radps, between = interpolated(loop.open_loop)
    centres, radii = open_loop_discs(loop)
    angle = np.degrees(np.unwrap(np.angle(between)))
    angle -= 360.0 * round((angle[0] + 150.0) / 360.0)  # the loop begins near -150
    at_tones = np.interp(TONES_RADPS, radps, angle)
    size = np.abs(loop.open_loop)
    relative = np.clip(np.nan_to_num(radii / size, nan=1.0), 0.0, 0.9)
    gain.plot(radps, 20.0 * np.log10(np.abs(between)), color=colour, lw=1.0)
    down, up = -20.0 * np.log10(1.0 - relative), 20.0 * np.log10(1.0 + relative)
    style = {"fmt": "o", "ms": 3, "color": colour, "capsize": 2, "lw": 0.8}
    gain.errorbar(TONES_RADPS, 20.0 * np.log10(size), yerr=[down, up], **style)
    phase.plot(radps, angle, color=colour, lw=1.0)
    phase.errorbar(TONES_RADPS, at_tones, yerr=np.degrees(np.arcsin(relative)), **style)
    plane.plot(between.real, between.imag, color=colour, lw=1.0, label=loop.at)
    for tone, centre, radius in zip(loop.open_loop, centres, radii, strict=True):
        plane.plot([tone.real], [tone.imag], "o", ms=3, color=colour)
        if isfinite(radius):
            turn = np.linspace(0.0, 2.0 * np.pi, 61)
            edge = centre + radius * np.exp(1j * turn)
            plane.plot(edge.real, edge.imag, color=colour, lw=0.6, alpha=0.6)

"""The power spectra of a flight."""

from __future__ import annotations

from typing import Any

import numpy as np

from tgl_soar.analysis.report.figure_style import power_of_ten
from tgl_soar.analysis.report.flight_report_figures import BLUE, RED, WIDTH_IN
from tgl_soar.analysis.report.spectra import Spectrum


def spectra_figure(plt: Any, tracking: Spectrum | None, updraft: Spectrum | None) -> Any:
    """The power spectral densities of e_rho and of the updraft as estimated on board."""
    drawn = [
        (spectrum, title, unit, colour)
        for spectrum, title, unit, colour in (
            (tracking, "e_rho", "m²/Hz", BLUE),
            (updraft, "updraft, estimated on board", "(m/s)²/Hz", RED),
        )
        if spectrum is not None
    ]
    if not drawn:
        return None
    figure, grid = plt.subplots(
        1, len(drawn), figsize=(WIDTH_IN, 2.9), layout="constrained", squeeze=False
    )
    for axes, (spectrum, title, unit, colour) in zip(grid[0], drawn, strict=True):
        axes.loglog(spectrum.frequency_hz, spectrum.density, color=colour, lw=1.1)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_formatter(power_of_ten)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_formatter("")
        axes.axvline(spectrum.peak_hz, color="0.55", lw=0.8, ls=":")
        axes.annotate(
            f"most power around {spectrum.peak_hz:.2g} Hz",
            (spectrum.peak_hz, 0.03),
            xycoords=axes.get_xaxis_transform(),
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=7.5,
            color="0.35",
        )
        top = float(np.max(spectrum.density))
        axes.set_ylim(max(float(np.min(spectrum.density)), 1e-7 * top), 3.0 * top)
        axes.set(xlabel="frequency [Hz]", ylabel=f"density [{unit}]", title=title)
        axes.grid(which="both", alpha=0.25, lw=0.4)
    return figure

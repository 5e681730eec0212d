"""The page of a flight: one HTML file that needs nothing else, and its figures beside it.

PAGE.html            text, tables, and the figures as vectors in it
PAGE-figures/*.svg   each figure for a paper
PAGE-figures/*.png   the same as pixels
PAGE-figures/numbers.json   what the tables say
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from io import BytesIO, StringIO
from math import degrees, isfinite, pi
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

import tgl_soar
from tgl_soar.analysis.logs.flight_data import FlightData, on_line, placed
from tgl_soar.analysis.loop_response import TONES_RADPS, LoopResponse, loop_responses
from tgl_soar.analysis.report.figure_style import drawing
from tgl_soar.analysis.report.flight_report_figures import (
    Surroundings,
    health_panels,
    history_figure,
    lateral_panels,
    longitudinal_panels,
    mode_spans,
    places_figure,
    plane_figure,
    span_of,
)
from tgl_soar.analysis.report.legs import FLYING, ReportLeg, legs_of
from tgl_soar.analysis.report.loop_figure import loop_figure, loop_words
from tgl_soar.analysis.report.page_style import STYLE
from tgl_soar.analysis.report.point_figure import point_figure, point_words
from tgl_soar.analysis.report.spectra import SEGMENT_S, Spectrum, spectrum_of
from tgl_soar.analysis.report.spectra_figure import spectra_figure
from tgl_soar.analysis.report.streams import Stream, streams_of
from tgl_soar.analysis.report.survey_figure import survey_figure, survey_words
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.score import SETTLE_S, SETTLED_FOR_S, SETTLED_M, TAIL_S

EVENTS_SHOWN: Final = 400
PARAMETERS_SHOWN: Final = 2000
_PRINT_DPI: Final = 160
_RASTER_DPI: Final = 170

_IDS: Final = re.compile(r'(\bid="|"#|\(#)([^")]+)')

Progress = Callable[[str], None]
_Draw = Callable[[Any], Any]


class Analysis(NamedTuple):
    """What is reported of a flight, in numbers."""

    flight: FlightData
    legs: list[ReportLeg]
    tracking: Spectrum | None
    updraft: Spectrum | None
    loops: list[LoopResponse]  # as multisines show it
    streams: list[Stream]
    known: Surroundings
    missing: tuple[str, ...]


def analysed(flight: FlightData, known: Surroundings, frame: SoaringFrame | None) -> Analysis:
    """The numbers of a flight.

    frame: the site's, in which paths of logs are laid that hold positions in local NED alone.
    """
    if frame is not None:
        flight = placed(flight, frame)
    missing = list(flight.missing)
    if flight.path is None and flight.position is not None:
        reason = "no site is named" if frame is None else "its positions are in no known frame"
        missing.append(f"{reason}: the path cannot be laid into the vertical plane")
    flight = on_line(flight)
    if flight.tracking is not None:
        missing = [text for text in missing if "e_rho" not in text]
    if known.field is None:
        missing.append("the air is not known: no updraft, no contour, no distance from it")
    elif known.polar is None:
        missing.append("no airframe is named: without its glide polar there is no contour")
    air = None
    if known.field is not None and known.polar is not None:
        air = known.field, known.polar
    legs = legs_of(flight, known.lines, air)
    if flight.line is not None and not legs:
        missing.append("the line never stood still while the module flew: there is no leg")
    spans = [(leg.begin_s + SETTLE_S, leg.end_s) for leg in legs] or [(0.0, flight.duration_s)]
    return Analysis(
        flight=flight,
        legs=legs,
        tracking=spectrum_of(flight.tracking, "e_rho_m", spans),
        updraft=spectrum_of(flight.air, "updraft_mps", [span_of(flight)]),
        loops=[] if flight.excitation is None else loop_responses(flight.excitation),
        streams=streams_of(flight),
        known=known,
        missing=tuple(missing),
    )


def write_page(page: Path, analysis: Analysis, progress: Progress) -> list[Path]:
    """Write page, figures and numbers; all paths that were written, the page first.

    progress is given what comes next.  Errors: ImportError without matplotlib, OSError.
    """
    folder = page.parent / f"{page.stem}-figures"
    folder.mkdir(parents=True, exist_ok=True)
    drawn: list[tuple[str, str, str]] = []
    files = [page]
    with drawing() as plt:
        for name, title, words, draw in _wanted(analysis):
            progress(title)
            figure = draw(plt)
            if figure is None:
                continue
            vector, png = _saved(plt, figure)
            files += [folder / f"{name}.svg", folder / f"{name}.png"]
            files[-2].write_text(vector, encoding="utf-8")
            files[-1].write_bytes(png)
            drawn.append((name, title, _figure(name, title, words, vector)))
    progress("The page")
    numbers = folder / "numbers.json"
    numbers.write_text(json.dumps(_numbers(analysis), indent=1) + "\n", encoding="utf-8")
    page.write_text(page_text(analysis, {name: html for name, _, html in drawn}), encoding="utf-8")
    return [*files, numbers]


def _wanted(analysis: Analysis) -> list[tuple[str, str, str, _Draw]]:
    """Every figure: its name, title and caption, and what draws it."""
    flight, legs, known = analysis.flight, analysis.legs, analysis.known
    return [
        (
            "plane",
            "The vertical plane",
            _plane_words(analysis),
            lambda plt: plane_figure(plt, flight, legs, known),
        ),
        (
            "places",
            "Held on each line",
            "Each leg from near. The cross is the mean position over its last"
            f" {TAIL_S:g} s; the circle, where there is one, the place where line and contour"
            " meet. Along the line the aircraft drifts with the turbulence: no still line"
            " prevents that.",
            lambda plt: places_figure(plt, flight, legs, known),
        ),
        (
            "point",
            "Holding a point of the line",
            point_words(flight),
            lambda plt: point_figure(plt, flight),
        ),
        (
            "survey",
            "The contour surveyed",
            survey_words(flight),
            lambda plt: survey_figure(plt, flight),
        ),
        (
            "longitudinal",
            "Holding the line",
            "Distance from the line, pitch and its setpoint, elevator; updraft and wind as they"
            " are estimated on board, and airspeed. Shaded: the line stands still. Red ticks:"
            " events.",
            lambda plt: history_figure(plt, flight, legs, longitudinal_panels(flight)),
        ),
        (
            "lateral",
            "Wings and heading",
            "Sideways position, roll, heading from straight upwind and its setpoint, aileron"
            " and rudder.",
            lambda plt: history_figure(plt, flight, legs, lateral_panels(flight)),
        ),
        (
            "spectra",
            "In frequency",
            _spectra_words(analysis),
            lambda plt: spectra_figure(plt, analysis.tracking, analysis.updraft),
        ),
        (
            "loop",
            "The open loop",
            loop_words(analysis.loops),
            lambda plt: loop_figure(plt, analysis.loops),
        ),
        (
            "health",
            "How old the inputs were",
            "Age of what each tick was flown with: the mean, and shaded from the youngest to"
            " the oldest. Between two samples an input ages by the time between them. Of the"
            " autopilot's heartbeat, which comes about once a second: the greatest age in each"
            " second.",
            lambda plt: history_figure(plt, flight, legs, health_panels(flight)),
        ),
    ]


def _saved(plt: Any, figure: Any) -> tuple[str, bytes]:
    vector, png = StringIO(), BytesIO()
    figure.savefig(vector, format="svg", dpi=_RASTER_DPI, metadata={"Date": None})
    figure.set_layout_engine("none")  # it is laid out by now
    figure.savefig(png, format="png", dpi=_PRINT_DPI)
    plt.close(figure)
    return vector.getvalue(), png.getvalue()


def _figure(name: str, title: str, words: str, vector: str) -> str:
    """A figure of the page: the vector itself, as wide as the page lets it be."""
    svg = vector[vector.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, count=1, flags=re.DOTALL)
    opening = svg[: svg.index(">") + 1]
    box = re.search(r'viewBox="[^"]*"', opening)
    assert box is not None  # matplotlib always writes one
    # Ids are the figure's own on a page of several.
    body = _IDS.sub(lambda found: f"{found[1]}{name}-{found[2]}", svg[len(opening) :])
    return (
        f'<figure id="{name}"><h2>{escape(title)}</h2><div class="wide">'
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        f' role="img" aria-label="{escape(title)}. {escape(words)}" {box[0]}>{body}</div>'
        f"<figcaption>{escape(words)}</figcaption></figure>"
    )


def _plane_words(analysis: Analysis) -> str:
    words = "The flown path, coloured by time"
    if any(leg for leg in analysis.legs):
        words += ", and the target gradient lines (TGL) it was held to"
    if analysis.known.field is not None:
        words += ". Grey is the updraft of the site's model of the air"
        if analysis.known.polar is not None:
            words += (
                "; dashed the contour on which it equals the aircraft's sink (ZEUC). Circles mark"
                " where a line meets it stably: there the aircraft should hover"
            )
    return words + "."


def _spectra_words(analysis: Analysis) -> str:
    words = f"Power spectral densities (Welch, {SEGMENT_S:g} s, Hann)."
    if analysis.tracking is not None:
        words += (
            f" e_rho over {analysis.tracking.seconds:.0f} s on the lines,"
            f" {100 * analysis.tracking.rms:.2f} cm rms."
        )
    if analysis.updraft is not None:
        words += f" Updraft over {analysis.updraft.seconds:.0f} s."
    if analysis.tracking is None and analysis.updraft is None:
        return words
    return words + (
        " Dotted: where density times frequency is largest, so that most of the power lies around"
        " it; the curve itself may be higher elsewhere."
    )


# --- numbers --------------------------------------------------------------------------------


def _numbers(analysis: Analysis) -> dict[str, Any]:
    flight = analysis.flight
    return {
        "log": flight.name,
        "kind": flight.kind,
        "duration_s": flight.duration_s,
        "modes_s": _mode_seconds(flight),
        "legs": [
            {
                "name": leg.name,
                "line": {"x_m": leg.line[0], "z_m": leg.line[1], "lean_deg": _lean(leg)},
                "begin_s": leg.begin_s,
                "end_s": leg.end_s,
                "settling_s": _number(leg.score.settling_s),
                "rms_e_rho_m": leg.score.rms_e_rho_m,
                "peak_e_rho_m": leg.score.peak_e_rho_m,
                "dispersion_m": leg.score.dispersion_m,
                "mean_m": [leg.score.mean_x_m, leg.score.mean_z_m],
                "crossing_m": leg.place,
                "distance_m": _number(leg.score.crossing_m),
                "distance_sigma_m": _number(leg.crossing_sigma_m),
            }
            for leg in analysis.legs
        ],
        "e_rho_peak_hz": None if analysis.tracking is None else analysis.tracking.peak_hz,
        "loops": [_loop(loop) for loop in analysis.loops],
        "streams": {
            s.name: {"samples": s.samples, "rate_hz": s.rate_hz, "longest_gap_s": s.longest_s}
            for s in analysis.streams
        },
        "loss": {name: list(counts) for name, counts in flight.loss.items()},
        "missing": analysis.missing,
        "lost": flight.lost,
        "tgl_soar": tgl_soar.__version__,
    }


def _loop(loop: LoopResponse) -> dict[str, Any]:
    return {
        "at": loop.at,
        "periods": loop.periods,
        "tones_radps": TONES_RADPS.tolist(),
        "gain": np.abs(loop.open_loop).tolist(),
        "phase_rad": np.angle(loop.open_loop).tolist(),
        "coherence": loop.coherence.tolist(),
        "margins": {
            name: [_number(value) for value in bounded]
            for name, bounded in loop.margins._asdict().items()
        },
    }


def _number(value: float) -> float | None:
    return value if isfinite(value) else None


def _lean(leg: ReportLeg) -> float:
    return degrees(leg.line[2] - 0.5 * pi)


def _mode_seconds(flight: FlightData) -> dict[str, float]:
    spent: dict[str, float] = {}
    for begin, end, name in mode_spans(flight.modes, flight.duration_s):
        spent[name] = spent.get(name, 0.0) + end - begin
    return spent


# --- the page -------------------------------------------------------------------------------


def page_text(analysis: Analysis, figures: dict[str, str]) -> str:
    flight = analysis.flight
    legs = _legs_table(analysis.legs)
    parts = [
        _head(analysis),
        _notes(analysis),
        figures.get("plane", ""),
        legs,
        figures.get("places", ""),
        figures.get("point", ""),
        figures.get("survey", ""),
        figures.get("longitudinal", ""),
        figures.get("lateral", ""),
        figures.get("spectra", ""),
        figures.get("loop", ""),
        _health(analysis, figures.get("health", "")),
        _events(flight),
        _parameters(flight),
        f"<footer>Written by tgl_soar {escape(tgl_soar.__version__)},"
        f" <code>tgl-soar report {escape(flight.name)}</code>.</footer>",
    ]
    title = f"Flight {escape(flight.name)}"
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )


def _head(analysis: Analysis) -> str:
    flight, known, legs = analysis.flight, analysis.known, analysis.legs
    where = ", ".join(escape(word) for word in (known.site, known.airframe) if word)
    started = flight.metadata.get("started", "")
    metadata = " · ".join(
        escape(word)
        for word in (flight.kind, started.replace("T", " ").replace("Z", " UTC"))
        if word
    )
    spent = _mode_seconds(flight)
    flown = sum(seconds for name, seconds in spent.items() if name in FLYING)
    tiles = [(_minutes(flight.duration_s), "logged")]
    if flight.modes:
        tiles.append((_minutes(flown), "flown by the module"))
    if legs:
        settled = sum(leg.score.settled for leg in legs)
        tiles.append((f"{settled} of {len(legs)}", "legs held"))
        lengths = np.array([leg.end_s - leg.begin_s for leg in legs])
        squares = np.array([leg.score.rms_e_rho_m**2 for leg in legs])
        rms = float(np.sqrt(np.average(squares, weights=lengths)))
        tiles.append((f"{100 * rms:.2f} cm", "rms e_rho on the lines"))
    cells = "".join(f"<div><b>{value}</b><span>{word}</span></div>" for value, word in tiles)
    return (
        f"<header><p class=kind>{metadata}</p><h1>{escape(flight.name)}</h1>"
        f"<p>{where}</p><div class=tiles>{cells}</div></header>"
    )


def _minutes(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _notes(analysis: Analysis) -> str:
    parts = ""
    for kind, title, texts in (
        ("lost", "Lost", analysis.flight.lost),
        ("missing", "Not in this report", analysis.missing),
    ):
        if texts:
            items = "".join(f"<li>{escape(text)}</li>" for text in texts)
            parts += f'<aside class="{kind}"><h2>{title}</h2><ul>{items}</ul></aside>'
    return parts


def _legs_table(legs: Sequence[ReportLeg]) -> str:
    if not legs:
        return ""
    rows = []
    for leg in legs:
        score = leg.score
        distance = "–"
        if isfinite(score.crossing_m):
            distance = f"{100 * score.crossing_m:.1f} ± {100 * leg.crossing_sigma_m:.1f}"
        rows.append(
            (
                leg.name,
                f"{leg.begin_s:.1f} – {leg.end_s:.1f}",
                f"{leg.line[0]:.2f}, {leg.line[1]:.2f}",
                f"{_lean(leg):.1f}",
                f"{score.settling_s:.1f}" if score.settled else "not held",
                f"{100 * score.rms_e_rho_m:.2f}",
                f"{100 * score.peak_e_rho_m:.1f}",
                f"{100 * score.dispersion_m:.1f}",
                f"{score.mean_x_m:.3f}, {score.mean_z_m:.3f}",
                distance,
            )
        )
    head = (
        *("leg", "time [s]", "line x, z [m]", "lean [°]", "settled after [s]"),
        *("rms e_rho [cm]", "peak e_rho [cm]", "dispersion [cm]", "mean x, z [m]"),
        "to TGL ∩ ZEUC [cm]",
    )
    words = (
        "From the path as the aircraft itself has estimated it."
        f" Settled: the first {SETTLED_FOR_S:g} s within {100 * SETTLED_M:g} cm of the line, from"
        f" its stop on. Rms and peak leave out the first {SETTLE_S:g} s. Dispersion is the standard"
        f" deviation along the line, mean the mean position, both over the last {TAIL_S:g} s. The"
        " distance from the predicted place carries one standard error of that mean, from the"
        " path's own correlation; errors of the position's source, of the field and of the polar"
        " are not in it."
    )
    return f"<section><h2>Leg by leg</h2>{_table(head, rows)}<p class=small>{words}</p></section>"


def _health(analysis: Analysis, figure: str) -> str:
    flight = analysis.flight
    rows = [
        (
            s.name,
            f"{s.samples}",
            f"{s.rate_hz:.1f}",
            f"{1000 * s.usual_s:.1f}",
            f"{1000 * s.late_s:.1f}",
            f"{1000 * s.longest_s:.0f}",
            f"{s.longest_at_s:.1f}",
            f"{s.gaps}",
        )
        for s in analysis.streams[:40]
    ]
    table = ""
    if rows:
        head = (
            *("stream", "samples", "rate [Hz]", "usual step [ms]", "99 % within [ms]"),
            *("longest gap [ms]", "at [s]", "gaps"),
        )
        table = f"<section><h2>Streams</h2>{_table(head, rows)}</section>"
    lost = ""
    if flight.loss:
        links = [
            (name, f"{came}", f"{gone}", f"{100 * gone / max(1, came + gone):.2f}")
            for name, (came, gone) in flight.loss.items()
        ]
        senders = ("sender", "frames", "lost", "lost [%]")
        lost = f"<section><h2>Link</h2>{_table(senders, links)}</section>"
    return figure + table + lost


def _events(flight: FlightData) -> str:
    if not flight.events and not flight.autopilot_modes:
        return ""
    every = [
        *((e.time_s, e.kind, e.text) for e in flight.events),
        *((m.time_s, "autopilot", m.name) for m in flight.autopilot_modes),
    ]
    every.sort()
    rows = [(f"{t:.2f}", kind, text) for t, kind, text in every[:EVENTS_SHOWN]]
    more = len(every) - len(rows)
    rest = f"<p class=small>and {more} more</p>" if more else ""
    table = _table(("time [s]", "what", "words"), rows, wordy=True)
    return f"<section><h2>Events</h2>{table}{rest}</section>"


def _parameters(flight: FlightData) -> str:
    if not flight.parameters:
        return ""
    pairs = sorted(flight.parameters.items())[:PARAMETERS_SHOWN]
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{value:.6g}</dd></div>" for name, value in pairs
    )
    return (
        f"<details><summary>{len(flight.parameters)} parameters at the beginning</summary>"
        f"<dl>{items}</dl></details>"
    )


def _table(head: Iterable[str], rows: Iterable[Sequence[str]], *, wordy: bool = False) -> str:
    """A table whose first column names its rows."""
    tops = "".join(f"<th scope=col>{escape(word)}</th>" for word in head)
    body = "".join(
        f"<tr><th scope=row>{escape(first)}</th>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows
    )
    kind = ' class="words"' if wordy else ""
    return (
        f'<div class="wide"><table{kind}><thead><tr>{tops}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )

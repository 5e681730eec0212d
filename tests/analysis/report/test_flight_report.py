"""The report of a flight: its legs against the truth, its spectra, and what stands on the page."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from math import pi, radians, sqrt
from pathlib import Path
from typing import Any

import flown
import matplotlib.pyplot as plt
import numpy as np
import pytest

from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.logs.flight_data import Event, FlightData, LoggedMode, Series
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.analysis.report.flight_page import Analysis, analysed, write_page
from tgl_soar.analysis.report.flight_report_figures import (
    Surroundings,
    history_figure,
    lateral_panels,
    longitudinal_panels,
    plane_figure,
    thinned,
)
from tgl_soar.analysis.report.legs import legs_of, mean_sigma, stands
from tgl_soar.analysis.report.spectra import spectrum_of
from tgl_soar.analysis.report.streams import streams_of
from tgl_soar.config.files import load_airframe, load_site
from tgl_soar.sim.score import score_leg
from tgl_soar.sim.world import build_field, ground_outline

LEAN_RAD = radians(15.0)
FIGURES = {"plane", "places", "longitudinal", "lateral", "spectra", "health"}


@pytest.fixture(scope="module")
def known() -> Surroundings:
    airframe, site = load_airframe(flown.AIRFRAME), load_site(flown.SITE)
    assert site.air is not None
    lines = {name: (line.x_m, line.z_m, 0.5 * pi + LEAN_RAD) for name, line in site.lines.items()}
    return Surroundings(
        site=site.site.name,
        airframe=airframe.airframe.name,
        lines=lines,
        field=build_field(site.air),
        polar=airframe.polar.as_polar(),
        ground=ground_outline(site.air),
    )


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> FlightData:
    return read_flight(flown.our_log(tmp_path_factory.mktemp("logs")))


@pytest.fixture(scope="module")
def analysis(flight: FlightData, known: Surroundings) -> Analysis:
    return analysed(flight, known, load_site(flown.SITE).frame())


def quietly(_words: str) -> None:
    return None


# --- legs -------------------------------------------------------------------------------------


def test_the_legs_are_those_of_the_truth(analysis: Analysis, known: Surroundings) -> None:
    """What the log says of each leg, against the score of the true path in the same time."""
    assert [leg.name for leg in analysis.legs] == ["a", "b"]
    time = np.array([tick.truth.time_s for tick in flown.flight()])
    x = np.array([tick.truth.x_m for tick in flown.flight()])
    z = np.array([tick.truth.z_m for tick in flown.flight()])
    begins = time[0] + float(analysis.flight.duration_s - (time[-1] - time[0]))
    assert abs(begins) < 0.02
    for leg in analysis.legs:
        assert known.field is not None
        assert known.polar is not None
        assert leg.crossing == stable_crossing(known.field, known.polar, leg.line)
        rows = (time >= leg.begin_s) & (time <= leg.end_s)
        truth = score_leg(leg.name, leg.line, leg.place, time[rows], x[rows], z[rows])
        # The estimator adds its error to the flight's: half a centimetre at this noise.
        assert leg.score.rms_e_rho_m == pytest.approx(truth.rms_e_rho_m, abs=0.005)
        assert leg.score.peak_e_rho_m == pytest.approx(truth.peak_e_rho_m, abs=0.015)
        assert leg.score.dispersion_m == pytest.approx(truth.dispersion_m, abs=0.01)
        assert leg.score.mean_x_m == pytest.approx(truth.mean_x_m, abs=0.01)
        assert leg.score.mean_z_m == pytest.approx(truth.mean_z_m, abs=0.01)
        assert leg.score.crossing_m == pytest.approx(truth.crossing_m, abs=0.01)
        assert leg.score.settled == truth.settled
        assert 0.0 < leg.crossing_sigma_m < 0.1


def standing(moving: list[float], x: list[float], modes: list[str]) -> FlightData:
    """A flight reported once a second."""
    time = np.arange(float(len(x)))
    line = Series(
        time,
        {
            "x_m": np.array(x),
            "z_m": np.ones(len(x)),
            "eta_rad": np.full(len(x), 1.8),
            "moving": np.array(moving),
        },
        "",
    )
    path = Series(time, {"x_m": np.array(x), "y_m": 0 * time, "z_m": np.ones(len(x))}, "")
    changes = tuple(LoggedMode(float(i), name) for i, name in enumerate(modes))
    return FlightData("", "", path=path, line=line, modes=changes)


def test_a_leg_is_a_stand_of_the_line_in_flight() -> None:
    n = 12
    modes = ["standby"] * 2 + ["soaring"] * 9 + ["released"]
    moving = [0.0] * 6 + [1.0] + [0.0] * 5
    x = [0.0] * 6 + [0.5] + [1.0] * 5
    found = stands(standing(moving, x, modes[:n]))
    assert [(begin, end, line[0]) for begin, end, line in found] == [
        (2.0, 5.0, 0.0),
        (7.0, 10.0, 1.0),
    ]


def test_a_leg_has_the_name_of_the_line_that_it_was_flown_on_and_no_other() -> None:
    """A parameter is a float of 32 bits, 1e-7 of itself off; whoever moves a line by hand drags it
    by centimetres, or turns it by a degree, and it is another then."""
    flight = standing([0.0] * 6, [0.6 + 6e-8] * 6, ["soaring"] * 6)
    at = (0.6, 1.0, 1.8)
    for line, name in (
        (at, "b"),
        ((0.62, 1.0, 1.8), "1"),
        ((0.6, 0.98, 1.8), "1"),
        ((0.6, 1.0, 1.8 + radians(1.0)), "1"),
    ):
        (leg,) = legs_of(flight, {"b": line}, None)
        assert leg.name == name


def test_a_line_that_jumps_or_is_not_known_parts_legs() -> None:
    x = [0.0] * 4 + [1.0] * 4 + [float("nan")] * 3 + [1.0] * 4
    found = stands(standing([0.0] * len(x), x, ["soaring"] * len(x)))
    assert [(begin, end) for begin, end, _ in found] == [(0.0, 3.0), (4.0, 7.0), (11.0, 14.0)]


def test_a_flight_without_a_line_has_no_legs() -> None:
    assert legs_of(FlightData("", ""), {}, None) == []


def test_the_error_of_a_mean_knows_how_long_a_signal_remembers() -> None:
    """A first-order process of time constant tau: variance of the mean 2 sigma² tau / T."""
    random = np.random.default_rng(5)
    step, tau, seconds = 0.02, 0.4, 400.0
    n = round(seconds / step)
    keep = np.exp(-step / tau)
    noise = random.standard_normal(n) * sqrt(1.0 - keep**2)
    values = np.zeros(n)
    for i in range(1, n):
        values[i] = keep * values[i - 1] + noise[i]
    time = np.linspace(0.0, seconds, n)
    sigmas = [mean_sigma(time[k : k + 2000], values[k : k + 2000]) for k in range(0, n, 2000)]
    assert np.mean(sigmas) == pytest.approx(sqrt(2.0 * tau / 40.0), rel=0.25)
    assert mean_sigma(time, np.ones(n)) == 0.0
    assert np.isnan(mean_sigma(time[:5], values[:5]))


# --- spectra and streams ----------------------------------------------------------------------


def test_a_swing_stands_in_the_spectrum_with_its_frequency_and_rms() -> None:
    time = np.arange(0.0, 60.0, 0.02)
    swing = Series(time, {"e": 0.03 * np.sin(2.0 * pi * 0.5 * time)}, "")
    spectrum = spectrum_of(swing, "e", [(0.0, 60.0)])
    assert spectrum is not None
    assert spectrum.peak_hz == pytest.approx(0.5)
    assert spectrum.rms == pytest.approx(0.03 / sqrt(2.0), rel=0.02)
    assert spectrum.seconds == pytest.approx(60.0, abs=0.1)


def test_the_peak_is_where_most_power_per_octave_is() -> None:
    """A slow drift has more power in each hertz than a swing that is nearly as large; but an octave
    at 2 Hz is eight times as wide as one at 0.25 Hz, and the swing is what the loop does."""
    time = np.arange(0.0, 80.0, 0.02)
    drift, swing = np.sin(2.0 * pi * 0.25 * time), 0.8 * np.sin(2.0 * pi * 2.0 * time)
    both = spectrum_of(Series(time, {"e": drift + swing}, ""), "e", [(0.0, 80.0)])
    assert both is not None
    assert both.frequency_hz[np.argmax(both.density)] == pytest.approx(0.25)
    assert both.peak_hz == pytest.approx(2.0)


def test_what_lies_between_the_spans_is_not_in_the_spectrum() -> None:
    time = np.arange(0.0, 60.0, 0.02)
    loud = np.where((time > 20.0) & (time < 40.0), 10.0 * np.sin(2.0 * pi * 3.0 * time), 0.0)
    swing = Series(time, {"e": loud + 0.1 * np.sin(2.0 * pi * 0.5 * time)}, "")
    spectrum = spectrum_of(swing, "e", [(0.0, 19.9), (40.1, 60.0)])
    assert spectrum is not None
    assert spectrum.peak_hz == pytest.approx(0.5)
    assert spectrum_of(swing, "e", [(0.0, 3.0)]) is None  # shorter than a segment
    assert spectrum_of(None, "e", [(0.0, 60.0)]) is None


def test_gaps_of_a_stream_are_found() -> None:
    time = np.concatenate([np.arange(0.0, 5.0, 0.02), np.arange(5.5, 10.0, 0.02)])
    (stream,) = streams_of(FlightData("", "", streams={"position": time, "once": time[:1]}))
    assert stream.name == "position"
    assert stream.usual_s == pytest.approx(0.02)
    assert stream.longest_s == pytest.approx(0.52)
    assert stream.longest_at_s == pytest.approx(4.98)
    assert stream.gaps == 1


# --- figures ----------------------------------------------------------------------------------


def test_a_thinned_curve_keeps_every_peak_and_gap() -> None:
    time = np.arange(0.0, 1000.0, 0.01)
    values = np.sin(time)
    values[12_345], values[54_321] = 9.0, -9.0
    values[70_000:71_000] = np.nan
    thin_time, thin = thinned(time, values, 500)
    assert len(thin) <= 1000
    assert np.nanmax(thin) == 9.0
    assert np.nanmin(thin) == -9.0
    assert np.isnan(thin).any()
    assert np.all(np.diff(thin_time) > 0.0)


def test_the_plane_shows_path_lines_contour_and_places(
    analysis: Analysis, known: Surroundings
) -> None:
    figure = plane_figure(plt, analysis.flight, analysis.legs, known)
    axes = figure.axes[0]
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["ZEUC: updraft = sink", "TGL a", "TGL b", "start"]
    bars = [a.get_ylabel() or a.get_xlabel() for a in figure.axes[1:]]
    assert sorted(bars) == ["time [s]", "updraft [m/s]"]
    circles = [line for line in axes.lines if line.get_marker() == "o"]
    assert [(c.get_xdata()[0], c.get_ydata()[0]) for c in circles] == [
        leg.place for leg in analysis.legs
    ]
    plt.close(figure)


def test_the_histories_share_one_time_axis_and_carry_modes_and_events(analysis: Analysis) -> None:
    for panels in (longitudinal_panels(analysis.flight), lateral_panels(analysis.flight)):
        figure = history_figure(plt, analysis.flight, analysis.legs, panels)
        limits = {axes.get_xlim() for axes in figure.axes}
        assert len(limits) == 1
        words = {text.get_text() for text in figure.axes[0].texts}
        words |= {text.get_text() for text in figure.axes[0].get_legend().get_texts()}
        assert {"capturing", "soaring"} <= words
        plt.close(figure)
    labels = [panel.label for panel in longitudinal_panels(analysis.flight) if panel.curves]
    assert labels[:3] == ["e_rho [cm]", "pitch [°]", "elevator [–]"]


# --- the page ---------------------------------------------------------------------------------


class Page(HTMLParser):
    """What a page holds, and what it would load from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.figures: list[str] = []
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.cells: list[str] = []
        self.described = 0
        self._cell = False
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        if tag == "figure":
            self.figures.append(found["id"])
        if tag == "svg":
            self.described += found.get("role") == "img" and bool(found.get("aria-label"))
        if "id" in found:
            self.ids.append(found["id"])
        self._cell = tag in ("td", "th")
        if tag in ("script", "link", "iframe", "object", "embed", "base"):
            self.loads.append(tag)
        for name in ("src", "href", "xlink:href", "srcset", "action"):
            if name in found and not found[name].startswith(("#", "data:")):
                self.loads.append(found[name])

    def handle_endtag(self, _tag: str) -> None:
        self._cell = False

    def handle_data(self, data: str) -> None:
        if self._cell:
            self.cells.append(data)


def written(folder: Path, analysis: Analysis) -> tuple[Page, str, dict[str, Any]]:
    files = write_page(folder / "page.html", analysis, quietly)
    assert all(file.stat().st_size > 200 for file in files)
    text = files[0].read_text(encoding="utf-8")
    numbers = json.loads((folder / "page-figures" / "numbers.json").read_text())
    return Page(text), text, numbers


def test_the_page_needs_nothing_else(tmp_path: Path, analysis: Analysis) -> None:
    page, text, numbers = written(tmp_path, analysis)
    assert page.loads == []
    assert not re.search(r"@import|url\((?!#)", text)
    assert len(page.ids) == len(set(page.ids))  # of six figures, each with its own
    assert set(page.figures) == FIGURES
    assert page.described == len(page.figures)
    assert text.startswith("<!DOCTYPE html>")
    assert '<html lang="en">' in text
    references = set(re.findall(r'(?:href="|url\()#([^")]+)', text))
    assert references <= set(page.ids)
    for leg, reported in zip(analysis.legs, numbers["legs"], strict=True):
        assert reported["rms_e_rho_m"] == leg.score.rms_e_rho_m
        assert f"{100 * leg.score.rms_e_rho_m:.2f}" in page.cells
        distance = f"{100 * leg.score.crossing_m:.1f} ± {100 * leg.crossing_sigma_m:.1f}"
        assert distance in page.cells
    for name in FIGURES:
        for ending in ("svg", "png"):
            assert (tmp_path / "page-figures" / f"{name}.{ending}").is_file()


def test_without_a_field_there_is_no_contour_and_the_page_says_so(
    tmp_path: Path, flight: FlightData
) -> None:
    _, text, numbers = written(tmp_path, analysed(flight, Surroundings(), None))
    assert "the air is not known" in text
    assert [leg["distance_m"] for leg in numbers["legs"]] == [None, None]
    assert [leg["name"] for leg in numbers["legs"]] == ["1", "2"]


def test_another_autopilots_flight_has_no_line_and_the_page_says_so(
    tmp_path: Path, known: Surroundings
) -> None:
    flight = read_flight(flown.px4_log(tmp_path))
    page, text, numbers = written(tmp_path, analysed(flight, known, load_site(flown.SITE).frame()))
    assert set(page.figures) == {"plane", "longitudinal", "lateral"}
    assert "no target gradient line" in text
    assert numbers["legs"] == []
    nowhere, text, _ = written(tmp_path, analysed(flight, Surroundings(), None))
    assert set(nowhere.figures) == {"longitudinal", "lateral"}
    assert "no site is named" in text


def test_attitude_alone_is_a_page_too(tmp_path: Path) -> None:
    others = [name for name in flown.PX4 if name != "vehicle_attitude"]
    flight = read_flight(flown.px4_log(tmp_path, leave_out=others))
    page, text, _ = written(tmp_path, analysed(flight, Surroundings(), None))
    assert set(page.figures) == {"longitudinal", "lateral"}
    assert "no position" in text


def test_a_log_with_nothing_to_draw_is_a_page_too(tmp_path: Path) -> None:
    page, _, numbers = written(tmp_path, analysed(FlightData("x", "y"), Surroundings(), None))
    assert page.figures == []
    assert numbers["duration_s"] == 0.0


def test_words_of_a_log_are_text_and_not_markup(tmp_path: Path) -> None:
    hostile = "<script>alert(1)</script>"
    bad = FlightData(
        hostile, hostile, events=(Event(1.0, hostile, hostile),), parameters={hostile: 1.0}
    )
    page, text, _ = written(tmp_path, analysed(bad, Surroundings(site=hostile), None))
    assert page.loads == []
    assert "<script" not in text

"""What a flight's page says: its head, its tables, what is missing, in which order, and what is
kept as numbers beside it."""

from __future__ import annotations

import json
import re
from math import inf, nan, pi, radians, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tgl_soar
from tgl_soar.air.zeuc import Crossing
from tgl_soar.analysis.logs.flight_data import Event, FlightData, LoggedMode, series
from tgl_soar.analysis.loop_response import TONES_RADPS, Bounded, FlownMargins, LoopResponse
from tgl_soar.analysis.report import flight_page as module
from tgl_soar.analysis.report.flight_page import Analysis, analysed, page_text, write_page
from tgl_soar.analysis.report.flight_report_figures import Surroundings
from tgl_soar.analysis.report.legs import ReportLeg
from tgl_soar.analysis.report.spectra import Spectrum
from tgl_soar.analysis.report.streams import Stream
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.score import SETTLE_S, LegScore

FIELD: Any = object()  # it is asked for nothing here
POLAR: Any = object()


def leg(**changes: Any) -> ReportLeg:
    name = changes.pop("name", "b")
    scored: dict[str, Any] = {
        "name": name, "settling_s": 4.25, "rms_e_rho_m": 0.0123, "peak_e_rho_m": 0.0456,
        "mean_x_m": 1.2345, "mean_z_m": 2.3456, "dispersion_m": 0.0789, "crossing_m": 0.0321,
    }  # fmt: skip
    scored |= {key: changes.pop(key) for key in [*changes] if key in scored}
    placed: dict[str, Any] = {
        "name": name, "line": (0.625, 1.875, 0.5 * pi + radians(15.0)), "begin_s": 10.0,
        "end_s": 40.0, "score": LegScore(**scored), "crossing_sigma_m": 0.0043,
        "crossing": Crossing(
            x_m=1.5, z_m=2.5, wind_mps=8.0, updraft_mps=0.6, excess_slope_per_s=-0.4, stable=True
        ),
    }  # fmt: skip
    return ReportLeg(**{**placed, **changes})


def lasting(seconds: float, **more: Any) -> FlightData:
    """A flight of so many seconds."""
    airspeed = series([0.0, seconds], "", airspeed_mps=[9.0, 9.0])
    return FlightData("x", "y", airspeed=airspeed, **more)


def analysis(flight: FlightData | None = None, **more: Any) -> Analysis:
    parts: dict[str, Any] = {
        "flight": flight or FlightData("my.ulg", "a log"), "legs": [], "tracking": None,
        "updraft": None, "loops": [], "streams": [], "known": Surroundings(), "missing": (),
    }  # fmt: skip
    return Analysis(**{**parts, **more})


def rows(html: str) -> list[list[str]]:
    found = re.findall(r"<tr>(.*?)</tr>", html)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in found]


def tiles(made: Analysis) -> list[tuple[str, str]]:
    head = page_text(made, {}).partition("</header>")[0]
    return re.findall(r"<div><b>(.*?)</b><span>(.*?)</span></div>", head)


# --- what is missing ----------------------------------------------------------------------------

TIME_S = np.arange(0.0, 10.0, 0.1)
NO_AIR = "the air is not known: no updraft, no contour, no distance from it"
NO_POLAR = "no airframe is named: without its glide polar there is no contour"
NO_LEG = "the line never stood still while the module flew: there is no leg"


def held(**more: Any) -> FlightData:
    """A line that moves all the time."""
    ones = np.ones(len(TIME_S))
    line = series(TIME_S, "", x_m=ones, z_m=ones, eta_rad=1.8 * ones, moving=ones)
    return FlightData("log", "a log", line=line, **more)


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (Surroundings(), NO_AIR),
        (Surroundings(polar=POLAR), NO_AIR),
        (Surroundings(field=FIELD), NO_POLAR),
        (Surroundings(field=FIELD, polar=POLAR), ""),
    ],
)
def test_a_page_without_air_or_polar_says_what_it_lacks(known: Surroundings, words: str) -> None:
    missing = analysed(FlightData("", ""), known, None).missing
    assert [text for text in missing if text in (NO_AIR, NO_POLAR)] == [words] * bool(words)


def test_only_a_flight_with_a_line_lacks_legs() -> None:
    assert NO_LEG in analysed(held(), Surroundings(), None).missing
    assert NO_LEG not in analysed(FlightData("", ""), Surroundings(), None).missing


def test_positions_in_local_ned_need_a_site() -> None:
    zeros = np.zeros(len(TIME_S))
    position = series(TIME_S, "", north_m=zeros, east_m=zeros, down_m=zeros)
    flight = FlightData("log", "a log", position=position, missing=("no e_rho", "no brake"))
    words = "no site is named: the path cannot be laid into the vertical plane"
    alone = analysed(flight, Surroundings(), None)
    assert words in alone.missing
    assert alone.flight.path is None
    placed = analysed(flight, Surroundings(), SoaringFrame(0.0, 0.0, 0.0, 0.0))
    assert words not in placed.missing
    assert placed.flight.path is not None
    # e_rho is still unknown: there is no line.
    assert {"no e_rho", "no brake"} <= {*placed.missing}


def test_a_flight_without_positions_lacks_no_site() -> None:
    zeros = np.zeros(len(TIME_S))
    path = series(TIME_S, "", x_m=zeros, y_m=zeros, z_m=zeros)
    position = series(TIME_S, "", north_m=zeros, east_m=zeros, down_m=zeros)
    for flight in (FlightData("", ""), FlightData("", "", path=path, position=position)):
        missing = analysed(flight, Surroundings(), None).missing
        assert not any("the path cannot be laid" in text for text in missing)


def test_spectra_are_of_the_legs_behind_their_settling_or_of_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(module, "spectrum_of", lambda *given: asked.append(given[1:]))
    flight = lasting(60.0)
    monkeypatch.setattr(module, "legs_of", lambda *_: [leg(), leg(begin_s=45.0, end_s=55.0)])
    assert len(analysed(flight, Surroundings(), None).legs) == 2
    settled = [(10.0 + SETTLE_S, 40.0), (45.0 + SETTLE_S, 55.0)]
    assert asked == [("e_rho_m", settled), ("updraft_mps", [(0.0, 60.0)])]
    asked.clear()
    monkeypatch.setattr(module, "legs_of", lambda *_: [])
    analysed(flight, Surroundings(), None)
    assert asked == [("e_rho_m", [(0.0, 60.0)]), ("updraft_mps", [(0.0, 60.0)])]


def test_a_contour_needs_both_air_and_polar(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def legs(_flight: Any, lines: Any, air: Any) -> Any:
        asked.append((lines, air))
        return []

    monkeypatch.setattr(module, "legs_of", legs)
    line = {"b": (1.0, 2.0, 1.8)}
    for known in (
        Surroundings(field=FIELD, polar=POLAR, lines=line), Surroundings(field=FIELD),
        Surroundings(polar=POLAR),
    ):  # fmt: skip
        analysed(FlightData("", ""), known, None)
    assert asked == [(line, (FIELD, POLAR)), ({}, None), ({}, None)]


def test_e_rho_that_follows_from_path_and_line_is_not_missing() -> None:
    zeros = np.zeros(len(TIME_S))
    path = series(TIME_S, "", x_m=zeros, y_m=zeros, z_m=zeros)
    found = analysed(held(path=path, missing=("no e_rho", "no brake")), Surroundings(), None)
    assert found.flight.tracking is not None
    assert "no e_rho" not in found.missing
    assert "no brake" in found.missing


# --- head ---------------------------------------------------------------------------------------


def test_the_head_says_log_kind_beginning_and_where() -> None:
    flight = FlightData("my.ulg", "a log", metadata={"started": "2026-05-01T10:20:30Z"})
    known = Surroundings(site="tunnel", airframe="eclipson_c")
    text = page_text(analysis(flight, known=known), {})
    assert "<p class=kind>a log · 2026-05-01 10:20:30 UTC</p><h1>my.ulg</h1>" in text
    assert "<p>tunnel, eclipson_c</p>" in text
    assert "<title>Flight my.ulg</title>" in text
    assert f"Written by tgl_soar {tgl_soar.__version__}," in text
    assert "<code>tgl-soar report my.ulg</code>" in text


def test_of_a_bare_log_only_its_length_is_reported() -> None:
    flight = lasting(59.6)
    assert tiles(analysis(flight)) == [("1 min 00 s", "logged")]
    assert "<p class=kind>y</p><h1>x</h1><p></p>" in page_text(analysis(flight), {})
    assert tiles(analysis(lasting(59.4))) == [("59 s", "logged")]
    assert tiles(analysis(lasting(125.0))) == [("2 min 05 s", "logged")]


def test_only_modes_in_which_the_module_steers_are_flown_by_it() -> None:
    modes = [(0.0, "standby"), (10.0, "capturing"), (15.0, "soaring"), (40.0, "released")]
    modes += [(50.0, "soaring"), (55.0, "standby")]
    flight = lasting(60.0, modes=tuple(LoggedMode(*m) for m in modes))
    assert tiles(analysis(flight)) == [("1 min 00 s", "logged"), ("35 s", "flown by the module")]
    spent = json.loads(json.dumps(module._numbers(analysis(flight))))["modes_s"]
    assert spent == {"standby": 15.0, "capturing": 5.0, "soaring": 30.0, "released": 10.0}


def test_the_rms_of_several_legs_is_of_all_their_seconds() -> None:
    """Ten seconds at 1 cm and thirty at 3 cm: the root of (10 + 30 * 9) / 40 cm²."""
    legs = [leg(begin_s=5.0, end_s=15.0, rms_e_rho_m=0.01), leg(rms_e_rho_m=0.03)]
    found = tiles(analysis(legs=[*legs, leg(begin_s=0.0, end_s=0.0, settling_s=inf)]))
    assert found[1:] == [
        ("2 of 3", "legs held"),
        (f"{sqrt(280.0 / 40.0):.2f} cm", "rms e_rho on the lines"),
    ]


# --- tables -------------------------------------------------------------------------------------


def test_each_leg_has_its_row_in_centimetres_and_degrees() -> None:
    legs = [leg(), leg(name="2", rms_e_rho_m=0.2, crossing_m=nan, crossing_sigma_m=nan)]
    head, first, second = rows(page_text(analysis(legs=legs), {}))
    assert dict(zip(head, first, strict=True)) == {
        "leg": "b", "time [s]": "10.0 – 40.0", "line x, z [m]": "0.62, 1.88", "lean [°]": "15.0",
        "settled after [s]": "4.2", "rms e_rho [cm]": "1.23", "peak e_rho [cm]": "4.6",
        "dispersion [cm]": "7.9", "mean x, z [m]": "1.234, 2.346",
        "to TGL ∩ ZEUC [cm]": "3.2 ± 0.4",
    }  # fmt: skip
    assert second[0] == "2"
    assert second[4] == "not held"  # it came to the line and left it
    assert second[-1] == "–"


def test_streams_are_reported_in_milliseconds_and_forty_at_most() -> None:
    stream = Stream(
        name="position", samples=500, rate_hz=49.96, usual_s=0.02, late_s=0.0251, longest_s=0.52,
        longest_at_s=4.98, gaps=3,
    )  # fmt: skip
    head, first, *more = rows(page_text(analysis(streams=[stream] * 41), {}))
    assert len(more) == 39
    assert dict(zip(head, first, strict=True)) == {
        "stream": "position", "samples": "500", "rate [Hz]": "50.0", "usual step [ms]": "20.0",
        "99 % within [ms]": "25.1", "longest gap [ms]": "520", "at [s]": "5.0", "gaps": "3",
    }  # fmt: skip


def test_lost_frames_are_a_fraction_of_all_that_were_sent() -> None:
    flight = FlightData("x", "y", loss={"1/1": (75, 25), "9/9": (0, 0)})
    found = rows(page_text(analysis(flight), {}))
    assert found == [
        ["sender", "frames", "lost", "lost [%]"],
        ["1/1", "75", "25", "25.00"],
        ["9/9", "0", "0", "0.00"],
    ]
    assert rows(page_text(analysis(), {})) == []


def test_events_and_the_autopilots_modes_stand_in_their_order_four_hundred_at_most() -> None:
    events = tuple(Event(float(n), "message", f"e{n}") for n in range(399))
    modes: tuple[LoggedMode, ...] = (LoggedMode(0.5, "FBWA"),)
    text = page_text(analysis(FlightData("x", "y", events=events, autopilot_modes=modes)), {})
    found = rows(text)
    assert found[:4] == [
        ["time [s]", "what", "words"],
        ["0.00", "message", "e0"],
        ["0.50", "autopilot", "FBWA"],
        ["1.00", "message", "e1"],
    ]
    assert len(found) == 401
    assert "more</p>" not in text
    modes = (*modes, LoggedMode(0.75, "AUTO"), LoggedMode(0.8, "RTL"))
    text = page_text(analysis(FlightData("x", "y", events=events, autopilot_modes=modes)), {})
    assert len(rows(text)) == 401
    assert "<p class=small>and 2 more</p>" in text
    alone = page_text(analysis(FlightData("x", "y", autopilot_modes=modes[:1])), {})
    assert rows(alone)[1:] == [["0.50", "autopilot", "FBWA"]]
    assert "Events" not in page_text(analysis(), {})


def test_parameters_are_sorted_and_two_thousand_at_most() -> None:
    values = {f"P{n:04d}": 0.5 * n for n in range(2001)}
    text = page_text(analysis(FlightData("x", "y", parameters=values)), {})
    pairs = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", text)
    assert len(pairs) == 2000
    assert pairs[3] == ("P0003", "1.5")
    assert "<summary>2001 parameters at the beginning</summary>" in text
    backwards = dict(reversed(values.items()))
    assert page_text(analysis(FlightData("x", "y", parameters=backwards)), {}) == text
    assert "<details>" not in page_text(analysis(), {})


def test_what_was_lost_and_what_is_missing_are_listed_apart() -> None:
    text = page_text(analysis(FlightData("x", "y", lost=("a row",)), missing=("air", "line")), {})
    lost, missing = re.findall(r"<aside.*?</aside>", text)
    assert 'class="lost"' in lost
    assert re.findall("<li>(.*?)</li>", lost) == ["a row"]
    assert "Not in this report" in missing
    assert re.findall("<li>(.*?)</li>", missing) == ["air", "line"]
    assert "<aside" not in page_text(analysis(), {})


def test_figures_stand_in_their_places_between_the_tables() -> None:
    names = [
        "plane", "places", "point", "survey", "longitudinal", "lateral", "spectra", "loop", "health"
    ]  # fmt: skip
    events = (Event(1.0, "message", "hello"),)
    made = analysis(FlightData("x", "y", events=events), legs=[leg()], missing=("air",))
    text = page_text(made, {name: f"[{name}]" for name in names})
    order = ["<header>", "<aside", "[plane]", "Leg by leg", *(f"[{name}]" for name in names[1:])]
    places = [text.index(word) for word in [*order, "Events", "<footer>"]]
    assert places == sorted(places)


def test_every_figure_that_is_drawn_is_on_the_page() -> None:
    made = analysis()
    drawn = [name for name, *_ in module._wanted(made)]
    assert len(drawn) == len(set(drawn)) >= 9
    text = page_text(made, {name: f"[{name}]" for name in drawn})
    assert [name for name in drawn if text.count(f"[{name}]") != 1] == []


def test_the_first_cell_of_a_row_names_it_and_words_have_a_table_of_their_own() -> None:
    html = module._table(("a", "b"), [("<x>", "1")], wordy=True)
    assert html == (
        '<div class="wide"><table class="words"><thead><tr><th scope=col>a</th>'
        "<th scope=col>b</th></tr></thead><tbody><tr><th scope=row>&lt;x&gt;</th><td>1</td></tr>"
        "</tbody></table></div>"
    )
    assert "<table><thead>" in module._table(("a",), [])
    assert '<table class="words">' in module._events(
        FlightData("x", "y", events=(Event(1.0, "message", "hello"),))
    )
    assert "<table>" in module._legs_table([leg()])


# --- captions -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("legs", "known", "parts"),
    [
        ([], Surroundings(), (False, False, False)),
        ([leg()], Surroundings(), (True, False, False)),
        ([], Surroundings(field=FIELD), (False, True, False)),
        ([leg()], Surroundings(field=FIELD, polar=POLAR), (True, True, True)),
        ([], Surroundings(polar=POLAR), (False, False, False)),
    ],
)
def test_the_planes_caption_tells_what_is_drawn(
    legs: Any, known: Surroundings, parts: tuple[bool, ...]
) -> None:
    words = module._plane_words(analysis(legs=legs, known=known))
    parts_named = ("target gradient lines", "Grey is the updraft", "dashed the contour")
    assert tuple(each in words for each in parts_named) == parts
    assert words.endswith(".")


def test_the_spectras_caption_tells_seconds_and_rms() -> None:
    one = Spectrum(
        frequency_hz=np.ones(2), density=np.ones(2), peak_hz=0.5, rms=0.0234, seconds=61.4
    )
    start = "Power spectral densities (Welch, 8 s, Hann)."
    assert module._spectra_words(analysis()) == start
    both = module._spectra_words(analysis(tracking=one, updraft=one._replace(seconds=80.0)))
    words = f"{start} e_rho over 61 s on the lines, 2.34 cm rms. Updraft over 80 s. Dotted: where "
    assert both.startswith(words)


# --- numbers ------------------------------------------------------------------------------------


def test_numbers_are_those_of_the_flight_and_none_where_there_is_none() -> None:
    tones = len(TONES_RADPS)
    loop = LoopResponse(
        at="elevator",
        sensitivity=np.full(tones, 1.0 / (1.0 + 2.0j)),
        variance=np.ones(tones),
        coherence=np.full(tones, 0.75),
        periods=7,
        margins=FlownMargins(
            Bounded(6.0, 5.0, 7.0), Bounded(nan, nan, nan), Bounded(0.7, 0.6, 0.8)
        ),
    )
    stream = Stream(
        name="position", samples=500, rate_hz=50.0, usual_s=0.02, late_s=0.03, longest_s=0.5,
        longest_at_s=4.0, gaps=3,
    )  # fmt: skip
    flight = lasting(12.5, loss={"1/1": (75, 25)}, lost=("a row",))
    bare = leg(settling_s=inf, crossing=None, crossing_m=nan, crossing_sigma_m=nan)
    found = module._numbers(
        analysis(flight, legs=[leg(), bare], loops=[loop], streams=[stream], missing=("air",))
    )
    found = json.loads(json.dumps(found))
    first, second = found.pop("legs")
    assert first["line"] == {"x_m": 0.625, "z_m": 1.875, "lean_deg": pytest.approx(15.0)}
    assert (first["name"], first["begin_s"], first["end_s"]) == ("b", 10.0, 40.0)
    assert (first["settling_s"], first["rms_e_rho_m"], first["peak_e_rho_m"]) == (
        4.25, 0.0123, 0.0456,
    )  # fmt: skip
    assert (first["dispersion_m"], first["mean_m"]) == (0.0789, [1.2345, 2.3456])
    assert (first["crossing_m"], first["distance_m"]) == ([1.5, 2.5], 0.0321)
    assert first["distance_sigma_m"] == 0.0043
    assert [second[n] for n in ("settling_s", "crossing_m", "distance_m", "distance_sigma_m")] == [
        None, None, None, None,
    ]  # fmt: skip
    (measured,) = found.pop("loops")
    assert measured["gain"] == pytest.approx([2.0] * tones)
    assert measured["phase_rad"] == pytest.approx([0.5 * pi] * tones)
    assert measured["coherence"] == [0.75] * tones
    assert measured["tones_radps"] == pytest.approx(TONES_RADPS.tolist())
    assert (measured["at"], measured["periods"]) == ("elevator", 7)
    assert measured["margins"] == {
        "gain_db": [6.0, 5.0, 7.0], "phase_deg": [None] * 3, "alpha": [0.7, 0.6, 0.8],
    }  # fmt: skip
    assert found == {
        "log": "x", "kind": "y", "duration_s": 12.5, "modes_s": {}, "e_rho_peak_hz": None,
        "streams": {"position": {"samples": 500, "rate_hz": 50.0, "longest_gap_s": 0.5}},
        "loss": {"1/1": [75, 25]}, "missing": ["air"], "lost": ["a row"],
        "tgl_soar": tgl_soar.__version__,
    }  # fmt: skip
    peak = Spectrum(frequency_hz=np.ones(2), density=np.ones(2), peak_hz=0.5, rms=0.1, seconds=60.0)
    assert module._numbers(analysis(tracking=peak))["e_rho_peak_hz"] == 0.5


# --- files --------------------------------------------------------------------------------------


def test_page_figures_and_numbers_are_written_where_they_are_said_to_be(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    time_s = np.linspace(0.0, 10.0, 200)
    attitude = series(
        time_s, "", roll_rad=0.1 * time_s, pitch_rad=0.2 * time_s, yaw_rad=0.0 * time_s
    )
    flight = FlightData("my <log>", "a log", attitude=attitude)
    steps: list[str] = []
    page = tmp_path / "new" / "one.html"
    files = write_page(page, analysis(flight), steps.append)
    folder = tmp_path / "new" / "one-figures"
    names = ["longitudinal", "lateral"]
    drawn = [folder / f"{name}.{end}" for name in names for end in ("svg", "png")]
    assert files == [page, *drawn, folder / "numbers.json"]
    assert sorted(folder.iterdir()) == sorted(files[1:])
    assert steps[0] == "The vertical plane"
    assert steps[-1] == "The page"
    for vector, pixels in zip(drawn[::2], drawn[1::2], strict=True):
        assert vector.read_text(encoding="utf-8").rstrip().endswith("</svg>")
        assert pixels.read_bytes()[:4] == b"\x89PNG"
    assert json.loads(files[-1].read_text(encoding="utf-8"))["log"] == "my <log>"
    text = page.read_text(encoding="utf-8")
    assert re.findall(r'<figure id="(.*?)">', text) == names


SVG = (
    '<?xml version="1.0"?>\n<!DOCTYPE svg>\n<svg width="5pt" viewBox="0 0 5 4" version="1.1">'
    '<metadata>\n<x id="m"/>\n</metadata><g id="axes"><use xlink:href="#mark"/>'
    '<path clip-path="url(#clip)"/></g><metadata>kept</metadata></svg>\n'
)


def test_a_figure_of_the_page_has_ids_of_its_own_and_no_metadata() -> None:
    html = module._figure("plane", "A & B", "words <x>", SVG)
    assert html == (
        '<figure id="plane"><h2>A &amp; B</h2><div class="wide">'
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        ' role="img" aria-label="A &amp; B. words &lt;x&gt;" viewBox="0 0 5 4">'
        '<g id="plane-axes"><use xlink:href="#plane-mark"/><path clip-path="url(#plane-clip)"/>'
        "</g><metadata>kept</metadata></svg>\n</div>"
        "<figcaption>words &lt;x&gt;</figcaption></figure>"
    )

"""What is said under the table of a flight: start-up warnings, legs that were over too early, what
a search has found, and what was reported of a fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tgl_soar.air.zeuc import Crossing
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.sim.operator import FlownLeg, LastTelemetry, PlannedLeg
from tgl_soar.sim.score import LegScore
from tgl_soar.sim.sitl_notes import (
    broken_off_words,
    fault_words,
    place_words,
    search_words,
    start_words,
)
from tgl_soar.sim.sitl_options import SitlOptions

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/hill.toml")


def options(**changes: Any) -> SitlOptions:
    return SitlOptions(airframe=AIRFRAME, site=SITE, out=Path("out"), **changes)


def test_the_warnings_of_the_start_are_said_and_no_more() -> None:
    lines = [
        "tgl_soar: no line is checked: the site's contour is of 'A'",
        "tgl_soar: code: interpreted",
        "tgl_soar: parameters changed over the air are not stored: no --state",
        "tgl_soar: listening on udp:127.0.0.1:1 as 1:191",
        "tgl_soar: OptiTrack: Motive speaks NatNet 4.1",
        "tgl_soar: [model] has no CD0",
        "tgl_soar: standby: position, attitude and autopilot are there",
        "tgl_soar: too slow",
    ]
    assert list(start_words(lines)) == [
        "the module: no line is checked: the site's contour is of 'A'",
        "the module: [model] has no CD0",
    ]


# --- a leg that was over too early ----------------------------------------------------------------


def said(
    away_m: float, dispersion_m: float = 0.02, *, flown: dict[str, Any], **changes: Any
) -> Any:
    _, site, values = load_flight(AIRFRAME, SITE)
    score = LegScore(
        name="b",
        settling_s=0.0,
        rms_e_rho_m=0.0,
        peak_e_rho_m=0.0,
        mean_x_m=0.0,
        mean_z_m=0.0,
        dispersion_m=dispersion_m,
        crossing_m=away_m,
    )
    crossing = Crossing(
        x_m=0.0, z_m=0.0, wind_mps=8.0, updraft_mps=0.7, excess_slope_per_s=-0.1, stable=True
    )
    leg = FlownLeg(PlannedLeg("b", {}, 16.0), 0.0, **flown)
    return list(
        place_words(
            options(**changes),
            site,
            values,
            [leg],
            [score],
            [crossing if away_m == away_m else None],
        )
    )


@pytest.mark.parametrize(
    ("away_m", "dispersion_m", "is_far"),
    [(11.8, 0.5, True), (0.31, 0.05, True), (0.29, 0.05, False), (0.7, 0.24, False)],
)
def test_who_is_far_from_its_place_needs_a_longer_stay(
    away_m: float, dispersion_m: float, is_far: bool
) -> None:
    """Far is more than 0.3 m, and than three dispersions."""
    words = said(away_m, dispersion_m, flown={})
    far = [f"b: still {away_m:.1f} m from its place: give a longer --stay"]
    assert words == (far if is_far else [])


@pytest.mark.parametrize(
    ("flown", "changes"),
    [
        ({"broken_off": True}, {}),
        ({"by_hand": True}, {}),
        ({}, {"settings": (("TGL_HOLD", 1.0),)}),
        ({}, {"receiver": "satellites"}),
    ],
)
def test_no_longer_stay_would_bring_these_to_their_place(
    flown: dict[str, Any], changes: dict[str, Any]
) -> None:
    """Satellites drift by a metre, and by two in height."""
    assert said(5.0, flown=flown, **changes) == []
    assert (said(7.1, flown=flown, **changes) != []) == (changes == {"receiver": "satellites"})


def test_where_there_is_no_place_the_dash_of_the_table_is_explained() -> None:
    (words,) = said(float("nan"), flown={})
    assert words.startswith("b: –: within 4 m of this line's point the simulated wind has no place")


# --- a search, and faults -------------------------------------------------------------------------


def test_a_leg_that_was_broken_off_is_said_with_the_module_s_reason() -> None:
    leg = PlannedLeg("a", {}, 60.0)
    stood = FlownLeg(leg, 2.0, stopped_s=4.0, ended_s=16.34, broken_off=True)
    early = FlownLeg(leg, 2.0, ended_s=16.34, broken_off=True)
    telemetry = LastTelemetry()
    assert list(broken_off_words([stood], telemetry)) == ["a: broken off after 12.3 s of 60 s"]
    telemetry.reported = [(16.0, "breaking off: launch given up: too low"), (17.0, "landing: away")]
    assert list(broken_off_words([early, FlownLeg(leg, 2.0)], telemetry)) == [
        "a: broken off before its line stood: launch given up: too low"
    ]


def test_what_a_search_has_found_is_said() -> None:
    found = {"TGL_X": 0.612, "TGL_Z": 1.5, "TGL_LEAN": 15.0}
    search = PlannedLeg("search", {}, 16.0, searches=True)
    legs = [
        FlownLeg(search, 2.0, stopped_s=25.04, found=found),
        FlownLeg(search, 2.0),
        FlownLeg(PlannedLeg("a", {}, 16.0), 2.0, stopped_s=25.0, found=found),
    ]
    assert list(search_words(legs)) == [
        "search: a place claimed after 23.0 s, at x 0.61 m, z 1.50 m"
    ]


def test_a_line_that_moves_meanwhile_is_not_taken_for_an_answer_to_a_fault() -> None:
    telemetry = LastTelemetry(time_s=60.0)
    telemetry.reported = [
        (19.0, "capturing: line moves"), (21.0, "soaring: on the line"),
        (22.0, "capturing: line moves"), (22.1, "holding: gap"), (24.0, "soaring: on the line"),
    ]  # fmt: skip
    (words,) = fault_words(options(faults=("position.dropout start=20 for=1",)), telemetry)
    assert words.endswith(
        ": the module reported holding: gap (22.1 s); soaring: on the line (24.0 s)"
    )
    telemetry.reported = telemetry.reported[:3]
    (words,) = fault_words(options(faults=("position.dropout start=20 for=1",)), telemetry)
    assert words.endswith(": the module reported nothing")


def test_each_fault_is_said_with_what_the_module_reported() -> None:
    telemetry = LastTelemetry(time_s=60.0)
    telemetry.reported = [
        (19.9, "before"), (20.3, "holding: gap"), (26.4, "capturing: back"), (26.6, "after"),
    ]  # fmt: skip
    faults = (
        "position.dropout start=20 for=1.5",
        "airspeed.dropout start=30",
        "position.dropout start=61",
    )
    told = list(fault_words(options(faults=faults), telemetry))
    assert told[0] == (
        "fault position.dropout start=20 for=1.5: the module reported holding: gap (20.3 s);"
        " capturing: back (26.4 s)"
    )
    assert told[1].endswith(": the module reported nothing")
    assert told[2].endswith(": not injected: the flight was over at 60.0 s")

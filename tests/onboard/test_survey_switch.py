"""SRV_START over the air: when a survey may begin, what it does to the line, how it ends."""

from __future__ import annotations

import re
from math import inf, radians, tan

import pytest
from test_module import Flight, setup, texts
from test_search_switch import AERODYNAMICS, ReportedSearch

from tgl_soar.autopilot import Output
from tgl_soar.control.forecast import SETTLES
from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.control.survey import SurveyLook
from tgl_soar.onboard import survey_switch
from tgl_soar.onboard.setup import ModuleSetup

FENCE = {"FENCE_X_MIN": -2.0, "FENCE_X_MAX": 2.0, "FENCE_Z_MIN": -5.0, "FENCE_Z_MAX": 5.0}
LOOK_OF = survey_switch.look_of


def good_look(output: Output) -> SurveyLook:
    """The aircraft in air that is good for it: the bench's has none."""
    look = LOOK_OF(output)
    forecast = look.forecast._replace(standing=SETTLES, chance=0.9, slope_per_s=-4.0)
    return look._replace(airspeed_mps=9.0, stall_rad=inf, forecast=forecast)


@pytest.fixture(autouse=True)
def good_air(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(survey_switch, "look_of", good_look)


def equipped(**changes: float) -> ModuleSetup:
    plain = setup()
    usual = {**FENCE, "FC_ACT": 1.0, "CLEAR_MIN": 0.3, "SRV_SPEED": 0.2}
    values = plain.parameters.changed({**usual, **changes})
    return plain._replace(parameters=values, aerodynamics=AERODYNAMICS)


class Carried(Flight):
    """An aircraft that is where its line crosses the height 0."""

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            output = self.onboard.output
            if output is not None and output.active:
                line = output.line
                self.north_m = -(line.x_m + line.z_m * tan(radians(15.0)))
            super().run(0.02)


def soaring(search: ReportedSearch | None = None, **changes: float) -> Carried:
    flight = Carried(flown=equipped(**changes), search=search)
    flight.engaged()
    flight.run(3.0)
    assert flight.mode_now == SOARING
    return flight


def value(flight: Flight, name: str) -> float:
    return flight.onboard.settings.values[name]


def words(flight: Flight) -> list[str]:
    return [text for text in texts(flight.outbound()) if "survey" in text]


def test_it_slides_there_and_back_and_says_so() -> None:
    flight = soaring()
    flight.set("SRV_START", 1.0)
    shown: list[tuple[float, float]] = []
    for _ in range(60):
        flight.run(1.0)
        assert flight.onboard.output is not None
        shown.append((value(flight, "SRV_START"), flight.onboard.output.line.x_m))
        if shown[-1][0] == 0.0:
            break
    order = list(dict.fromkeys(standing for standing, _ in shown))
    assert order == [1.0, 2.0, 3.0, 0.0]
    assert max(x for _, x in shown) == pytest.approx(1.0, abs=0.2)
    assert min(x for _, x in shown) == pytest.approx(-1.0, abs=0.2)
    assert (value(flight, "TGL_X"), value(flight, "TGL_Z")) == (0.0, 0.0)
    reported = words(flight)
    assert reported[0] == "survey: downstream at 0.2 m/s"
    assert [text.split(":")[1].split(" from")[0] for text in reported if " from " in text] == [
        " upstream",
        " home",
    ]
    assert "the fence" in "".join(reported)
    assert reported[-1] == "survey: done"
    flight.run(2.0)
    assert flight.mode_now == SOARING


def test_its_line_is_slow_and_in_the_parameters_that_all_see() -> None:
    flight = soaring(SRV_SPEED=0.1)
    flight.outbound()
    flight.set("SRV_START", 1.0)
    flight.run(8.0)
    before = flight.onboard.output
    flight.run(2.0)
    after = flight.onboard.output
    assert before is not None
    assert after is not None
    assert abs(after.line.x_m - before.line.x_m) == pytest.approx(0.2, abs=0.03)
    messages = flight.outbound()
    shown = {m.param_id for m in messages if m.get_type() == "PARAM_VALUE"}
    assert {"TGL_X", "TGL_Z"} <= shown
    assert flight.mode_now == SOARING
    assert "line moves" not in "".join(texts(messages))


def test_a_line_that_an_operator_sends_away_from_a_survey_is_captured_again() -> None:
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(8.0)
    flight.set("TGL_X", 0.2)
    flight.run(0.3)
    assert flight.mode_now == CAPTURING


@pytest.mark.parametrize("name", ["TGL_X", "TGL_SLEW"])
def test_an_operator_takes_the_line_back_at_any_moment(name: str) -> None:
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(8.0)
    wanted = {"TGL_X": -0.2, "TGL_SLEW": 0.25}[name]
    flight.set(name, wanted)
    flight.run(0.5)
    assert value(flight, "SRV_START") == 0.0
    assert value(flight, name) == pytest.approx(wanted)
    assert re.search(f"survey ended(:| by) {name}", "".join(words(flight)))


def test_where_nobody_says_where_the_line_is_to_be_it_stays() -> None:
    """The target of a slide is ahead of the line; at another speed it would go on to there."""
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(8.0)
    output = flight.onboard.output
    assert output is not None
    assert abs(value(flight, "TGL_X") - output.line.x_m) > 0.1
    flight.set("TGL_SLEW", 0.25)
    flight.run(0.1)
    assert value(flight, "TGL_X") == pytest.approx(output.line.x_m, abs=0.02)
    assert "survey ended by TGL_SLEW: the line stays" in "".join(words(flight))


def test_the_operators_0_stops_the_line_where_it_is() -> None:
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(8.0)
    output = flight.onboard.output
    assert output is not None
    assert output.line.moving
    flight.set("SRV_START", 0.0)
    flight.run(0.05)
    assert value(flight, "TGL_X") == pytest.approx(output.line.x_m, abs=0.02)
    flight.run(3.0)
    assert flight.mode_now == SOARING
    assert "survey ended by the operator; the line stays" in "".join(words(flight))


def test_a_search_that_begins_ends_it() -> None:
    search = ReportedSearch()
    search.requests(0.0)
    flight = soaring(search)
    flight.set("SRV_START", 1.0)
    flight.run(6.0)
    flight.set("SRCH_START", 1.0)
    flight.run(0.1)
    assert value(flight, "SRV_START") == 0.0
    assert "survey ended: a search has begun" in "".join(words(flight))


def test_it_is_over_with_the_flight() -> None:
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(6.0)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.2)
    assert value(flight, "SRV_START") == 0.0
    assert "survey ended: it does not soar any more" in "".join(words(flight))


@pytest.mark.parametrize(
    ("changes", "number", "why"),
    [
        ({}, 2.0, "set 1 to survey"),
        ({"FC_ACT": 0.0}, 1.0, "the forecast is off"),
        ({"FENCE_X_MIN": -5000.0}, 1.0, "FENCE_X_MIN"),
        ({"TGL_HOLD": 1.0}, 1.0, "TGL_HOLD"),
        ({"CLEAR_MIN": 0.0}, 1.0, "CLEAR_MIN"),
    ],
)
def test_what_cannot_be_surveyed_is_refused(
    changes: dict[str, float], number: float, why: str
) -> None:
    flight = soaring(None, **changes)
    flight.outbound()
    flight.set("SRV_START", number)
    flight.run(0.1)
    assert value(flight, "SRV_START") == 0.0
    assert why in "".join(texts(flight.outbound()))


@pytest.mark.parametrize(
    ("name", "without", "why"),
    [
        ("FENCE_X_MIN", -5000.0, "the fence is open: set FENCE_X_MIN"),
        ("FC_ACT", 0.0, "the forecast is off"),
        ("CLEAR_MIN", 0.0, "CLEAR_MIN is 0"),
    ],
)
def test_a_guard_that_is_taken_away_under_way_ends_it_there(
    name: str, without: float, why: str
) -> None:
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(8.0)
    flight.outbound()
    flight.set(name, without)
    flight.run(0.5)
    output = flight.onboard.output
    assert output is not None
    assert value(flight, name) == pytest.approx(without)
    assert value(flight, "SRV_START") == 0.0
    assert value(flight, "TGL_X") == pytest.approx(output.line.x_m, abs=0.12)
    reported = "".join(texts(flight.outbound()))  # in parts of 50 characters
    assert f"survey ended: {why}" in reported
    assert "the line stays" in reported
    flight.run(3.0)
    assert flight.mode_now == SOARING


def test_it_begins_only_on_a_line_that_stands_still() -> None:
    flight = Carried(flown=equipped())
    flight.run(1.0)
    for engage in (True, False):  # on the ground, and on the way to the line
        flight.outbound()
        flight.set("SRV_START", 1.0)
        flight.run(0.05)
        assert value(flight, "SRV_START") == 0.0
        assert "it does not soar on a line that stands still" in "".join(texts(flight.outbound()))
        if engage:
            flight.engaged()


def test_without_a_polar_it_is_refused_and_a_second_one_is() -> None:
    flight = Carried(flown=setup()._replace(parameters=equipped().parameters))
    flight.engaged().run(3.0)
    flight.set("SRV_START", 1.0)
    flight.run(0.05)
    assert "[polar]" in "".join(texts(flight.outbound()))
    flight = soaring()
    flight.set("SRV_START", 1.0)
    flight.run(1.0)
    flight.set("SRV_START", 1.0)
    flight.run(0.05)
    assert "a survey is under way" in "".join(texts(flight.outbound()))
    assert value(flight, "SRV_START") == 1.0

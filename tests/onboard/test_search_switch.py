"""SRCH_START over the air: what the search is given, what its answers do, and how it ends."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import threading
import time
from math import degrees, nan, pi, radians, tan
from typing import Any

import numpy as np
import pytest
from test_module import Flight, setup, texts

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.control.forecast import TOO_LOW as SINKS
from tgl_soar.control.laws import laws_from
from tgl_soar.control.search.glimpse import (
    GIVEN_UP,
    LOOK_S,
    LOOKING,
    NO_REASON,
    SOARING,
    TOO_LOW,
    Glimpse,
    LineRequest,
    SearchTask,
    task_of,
)
from tgl_soar.control.search.lift_search import Seeker
from tgl_soar.control.search.rollout import Fields, Grid, Rollouts
from tgl_soar.control.supervisor import (
    BREAKING_OFF,
    CAPTURING,
    HOLDING,
    LANDING,
    LAUNCHING,
    RECOVERING,
    SEARCHING,
    goes_home,
    is_flying,
)
from tgl_soar.control.supervisor import SOARING as SOARS
from tgl_soar.control.target_line import LineTracking, TargetLine, eta_from_lean
from tgl_soar.onboard.search_process import LARGEST_BYTES, SearchBeside, SearchHere, serve
from tgl_soar.onboard.search_switch import LATE_S
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.types import NO_GROUND, VehicleState

FENCE = {"FENCE_X_MIN": -5.0, "FENCE_X_MAX": 5.0, "FENCE_Z_MIN": -5.0, "FENCE_Z_MAX": 5.0}
ETA = eta_from_lean(radians(15.0))
AERODYNAMICS = load_airframe(shipped("airframes/eclipson_c.toml")).aerodynamics()


class ReportedSearch:
    """A search that answers each glimpse once, with what a test sets."""

    def __init__(self) -> None:
        self.tasks: list[SearchTask] = []
        self.glimpses: list[Glimpse | None] = []
        self.answer: LineRequest | None = None  # to what is asked; None: it is silent
        self.late = 0  # glimpses that it has not got to yet
        self.has_room = True  # for what it is given
        self.failure = ""
        self._answers: list[LineRequest] = []  # that were not received yet

    def begin(self, task: SearchTask) -> bool:
        if self.has_room:
            self.tasks.append(task)
        return self.has_room

    def send(self, glimpse: Glimpse | None) -> bool:
        if not self.has_room:
            return False
        self.glimpses.append(glimpse)
        asked = self.glimpses[-1 - self.late] if len(self.glimpses) > self.late else None
        if asked is not None and asked.seeks:
            self.answers(asked)
        return True

    def answers(self, glimpse: Glimpse) -> None:
        if self.answer is not None:
            answer = self.answer._replace(time_s=glimpse.now.time_s, search=glimpse.search)
            self._answers.append(answer)

    def receive(self) -> LineRequest | None:
        newest = self._answers[-1] if self._answers else None
        self._answers.clear()
        return newest

    def requests(self, x_m: float, lean_deg: float = 15.0, status: int = LOOKING) -> None:
        self.answer = LineRequest(
            target=TargetLine(x_m, 0.0, eta_from_lean(radians(lean_deg))),
            status=status,
            reason=NO_REASON,
            place_x_m=nan,
            place_z_m=nan,
            over_ground_m=4.2,
        )


def equipped(**changes: float) -> ModuleSetup:
    plain = setup()
    values = plain.parameters.changed({**FENCE, "FC_ACT": 0.0, "CLEAR_MIN": 0.5, **changes})
    return plain._replace(parameters=values, aerodynamics=AERODYNAMICS)


def searching(**changes: float) -> tuple[Flight, ReportedSearch]:
    """Engaged with a search that requests the line to stay."""
    search = ReportedSearch()
    flight = Flight(flown=equipped(**changes), search=search)
    search.requests(0.0)
    flight.run(1.0)
    flight.set("SRCH_START", 1.0)
    flight.engaged().run(0.5)
    assert flight.mode_now == SEARCHING
    return flight, search


def value(flight: Flight, name: str) -> float:
    return flight.onboard.settings.values[name]


def words(flight: Flight) -> list[str]:
    return [text for text in texts(flight.outbound()) if "search" in text]


def test_the_module_flies_the_line_that_the_search_wants_and_soars_where_it_says_so() -> None:
    flight, search = searching()
    assert "searching: searches for a place to soar" in words(flight)
    search.requests(0.1, lean_deg=20.0)
    flight.run(0.25)
    shown = {m.param_id: m.param_value for m in flight.outbound("PARAM_VALUE")}
    assert shown["TGL_X"] == pytest.approx(0.1)
    assert shown["TGL_LEAN"] == pytest.approx(20.0)
    assert value(flight, "TGL_X") == pytest.approx(0.1)
    line = flight.onboard.output.line  # type: ignore[union-attr]
    assert line.moving
    assert line.x_m < 0.02  # it slides there, at TGL_SLEW
    search.requests(0.0, status=SOARING)
    flight.run(9.0)
    assert flight.mode_now == SOARS
    assert value(flight, "SRCH_START") == 2.0
    # The claim is withdrawn, and so is the mode.
    search.requests(0.0)
    flight.run(0.3)
    assert flight.mode_now == SEARCHING
    assert value(flight, "SRCH_START") == 1.0


def test_the_search_knows_whether_there_is_power_left() -> None:
    """And a propeller alone is none, without a budget."""
    propelled = AERODYNAMICS._replace(propeller_thrust_n=6.0, propeller_speed_mps=20.0)
    for budget_s, carried in ((20.0, {True}), (0.0, {False})):
        search = ReportedSearch()
        flown = equipped()._replace(aerodynamics=propelled)
        values = flown.parameters.changed({"THR_BUDGET": budget_s})
        flight = Flight(flown=flown._replace(parameters=values), search=search)
        search.requests(0.0)
        flight.run(1.0)
        flight.set("SRCH_START", 1.0)
        flight.engaged().run(2.0)
        found = {each.carried for each in search.glimpses[-3:] if each is not None}
        assert found == carried


def test_it_never_soars_while_the_search_does_not_say_so() -> None:
    flight, _ = searching()
    flight.run(6.0)  # on its line, at rest: soaring without a search
    assert flight.mode_now == SEARCHING


def test_what_the_search_is_reported() -> None:
    flight, search = searching()
    task = task_of(flight.onboard.settings.laws)
    steepest = 0.5 * pi + radians(45.0)
    task = task._replace(eta_min_rad=0.5 * pi + radians(5.0), eta_max_rad=steepest)
    assert search.tasks == [task]
    before = len(search.glimpses)
    flight.run(4.0)
    reported = [g for g in search.glimpses[before:] if g is not None]
    assert len(reported) == pytest.approx(4.0 / LOOK_S, abs=1)
    assert all(g.seeks and not g.refused for g in reported)
    steps = [g.now.time_s - g.before.time_s for g in reported]
    assert steps == pytest.approx([LOOK_S] * len(reported), abs=0.006)
    assert [g.before for g in reported[1:]] == [g.now for g in reported[:-1]]
    flight.set("TGL_SLEW", 0.2)  # an operator's: it ends the search, and the task is another one
    flight.run(0.5)
    assert search.tasks[-1].line.speed_mps == pytest.approx(0.2)
    last = search.glimpses[-1]
    assert last is not None
    assert not last.seeks
    flight.set("TGL_LEAN_MAX", 20.0)
    flight.run(0.5)
    assert search.tasks[-1].eta_max_rad == pytest.approx(0.5 * pi + radians(20.0))


def test_it_does_not_learn_the_air_from_a_hand() -> None:
    """What hangs in a hand neither climbs nor sinks: taken for air, that is a place to soar."""
    search = ReportedSearch()
    flight = Flight(flown=equipped(LNC_START=1.0), search=search)
    flight.run(1.0)
    flight.set("SRCH_START", 1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(LATE_S + 1.0)
    assert flight.mode_now == LAUNCHING
    assert not [glimpse for glimpse in search.glimpses if glimpse is not None]
    assert value(flight, "SRCH_START") == 1.0  # no search was asked, and none is late


@pytest.mark.parametrize("name", ["TGL_X", "TGL_LEAN", "TGL_SLEW"])
def test_an_operator_takes_the_line_back_at_any_moment(name: str) -> None:
    flight, search = searching()
    search.requests(0.3)
    flight.run(0.25)
    wanted = {"TGL_X": -0.2, "TGL_LEAN": 12.0, "TGL_SLEW": 0.25}[name]
    flight.set(name, wanted)
    search.requests(-0.4)
    flight.run(0.3)
    assert value(flight, "SRCH_START") == 0.0
    assert value(flight, name) == pytest.approx(wanted)
    assert "search ended: the line was set by hand" in words(flight)
    flight.run(1.0)
    assert flight.mode_now == CAPTURING
    assert value(flight, "TGL_X") != pytest.approx(-0.4)


def test_the_operators_0_ends_it() -> None:
    flight, search = searching()
    flight.set("SRCH_START", 0.0)
    search.requests(0.4)
    flight.run(0.3)
    assert flight.mode_now == CAPTURING
    assert value(flight, "TGL_X") == pytest.approx(0.0, abs=0.01)


def test_given_up_it_hands_over_with_the_reason_and_the_height() -> None:
    flight, search = searching()
    assert search.answer is not None
    search.answer = search.answer._replace(status=GIVEN_UP, reason=TOO_LOW)
    flight.run(0.3)
    reported = texts(flight.outbound())
    whole = "".join(reported)  # a long text comes in pieces
    assert "height for landing is running out" in whole
    assert "4.2 m over the ground" in whole
    assert "released: no place to soar is found" in reported
    flight.run(0.5)
    assert value(flight, "SRCH_START") == value(flight, "OP_ENGAGE") == 0.0
    assert search.glimpses[-1] is None  # the flight is over
    assert not is_flying(flight.mode_now)


def test_a_line_outside_the_fence_is_not_flown_and_the_search_is_reported() -> None:
    flight, search = searching()
    x_m = value(flight, "TGL_X")
    search.requests(7.0)
    flight.run(0.25)
    assert value(flight, "TGL_X") == x_m
    flight.run(0.3)
    last = [g for g in search.glimpses if g is not None]
    assert any(g.refused for g in last)
    search.requests(0.0, lean_deg=50.0)  # beyond TGL_LEAN_MAX
    flight.run(0.25)
    assert value(flight, "TGL_LEAN") == 15.0
    assert flight.mode_now == SEARCHING


def test_the_point_of_the_line_is_where_the_aircraft_is_to_settle() -> None:
    """A point beyond the fence is one of a line that is not: another of its points will do."""
    flight, search = searching()
    search.requests(7.0)
    assert search.answer is not None
    far = search.answer.target._replace(z_m=-7.0 / tan(radians(15.0)))
    search.answer = search.answer._replace(target=far, place_x_m=-0.5, place_z_m=2.0)
    flight.run(0.25)
    x_m, z_m = value(flight, "TGL_X"), value(flight, "TGL_Z")
    assert z_m == pytest.approx(2.0, abs=0.02)
    assert degrees(ETA - 0.5 * pi) == pytest.approx(value(flight, "TGL_LEAN"))
    assert x_m == pytest.approx(-2.0 * 0.26795, abs=0.02)  # on the line through the origin


def test_a_search_that_dies_or_is_late_ends_and_the_line_goes_on() -> None:
    flight, search = searching()
    search.requests(0.6)
    flight.run(0.3)
    search.answer, search.failure = None, "its process has died"
    flight.run(0.1)
    assert "search ended: its process has died" in words(flight)
    assert flight.mode_now == CAPTURING
    onboard = flight.onboard
    assert onboard.output is not None
    assert onboard.output.line.x_m < 0.2
    flight.run(4.0)  # to where it was sent last, at TGL_SLEW
    assert onboard.output.line.x_m == pytest.approx(0.6)
    assert value(flight, "TGL_X") == pytest.approx(0.6)
    flight.set("SRCH_START", 1.0)
    flight.run(0.1)
    assert "its process has died" in "".join(texts(flight.outbound()))
    assert value(flight, "SRCH_START") == 0.0

    flight, search = searching()
    search.answer = None
    flight.run(LATE_S - 0.2)
    assert flight.mode_now == SEARCHING
    flight.run(0.4)
    assert f"search ended: no answer for {LATE_S:g} s" in words(flight)
    assert flight.mode_now in (CAPTURING, SOARS)


def ticks(flight: Flight, mode: int, seconds: float) -> None:
    """Ticks of the switches in a mode, on simulated time, with what the last tick had."""
    onboard = flight.onboard
    output = onboard.output
    assert output is not None
    for _ in range(round(seconds / 0.005)):
        time_s = output.time_s + 0.005
        vehicle = output.vehicle._replace(time_s=time_s)
        output = output._replace(time_s=time_s, mode=mode, vehicle=vehicle)
        onboard.output = output
        onboard._switches.tick(output)


def asked_last(search: ReportedSearch) -> Glimpse:
    return [glimpse for glimpse in search.glimpses if glimpse is not None][-1]


def test_what_an_ended_flight_had_asked_does_not_end_the_next() -> None:
    flight, search = searching()
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.1)
    assert not is_flying(flight.mode_now)
    kept = search.answer
    assert kept is not None
    search.answer = kept._replace(status=GIVEN_UP, reason=TOO_LOW)
    search.answers(asked_last(search))  # late by milliseconds
    search.answer = kept
    flight.set("SRCH_START", 1.0)
    flight.engaged().run(1.0)
    assert flight.mode_now == SEARCHING


@pytest.mark.parametrize("status", [SOARING, GIVEN_UP])
def test_what_an_ended_search_had_asked_is_not_obeyed_by_the_next(status: int) -> None:
    flight, search = searching()
    flight.set("SRCH_START", 0.0)
    search.requests(0.9, status=status)
    search.answers(asked_last(search))  # it was under way
    search.requests(0.0)
    flight.run(0.01)
    flight.set("SRCH_START", 1.0)
    flight.run(0.01)
    assert value(flight, "TGL_X") == pytest.approx(0.0, abs=1e-6)
    flight.run(1.0)
    assert value(flight, "SRCH_START") == 1.0
    assert flight.mode_now == SEARCHING


def test_late_is_who_answers_old_glimpses_however_often() -> None:
    """A process that falls ever further behind answers five times a second."""
    flight, search = searching()
    flight.outbound()
    for late in range(1, round(LATE_S / LOOK_S) + 2):
        search.late = late
        flight.run(LOOK_S)
        if late < round(LATE_S / LOOK_S) - 1:
            assert flight.mode_now == SEARCHING
            flight.run(LOOK_S)
    assert f"search ended: no answer for {LATE_S:g} s" in words(flight)
    assert value(flight, "SRCH_START") == 0.0


def test_what_found_no_room_is_sent_again() -> None:
    """The task, the word that a line was refused, and that the flight is over."""
    search = ReportedSearch()
    flight = Flight(flown=equipped(), search=search)
    search.requests(0.0)
    search.has_room = False
    flight.run(1.0)
    flight.set("SRCH_START", 1.0)
    flight.engaged().run(1.0)
    assert not search.glimpses
    search.has_room = True
    flight.run(0.5)
    assert len(search.tasks) == 1
    assert search.glimpses
    search.requests(7.0)
    flight.run(LOOK_S)
    search.has_room = False
    flight.run(2.0 * LOOK_S)
    assert not any(glimpse.refused for glimpse in search.glimpses if glimpse is not None)
    search.has_room = True
    flight.run(LOOK_S + 0.01)
    assert any(glimpse.refused for glimpse in search.glimpses if glimpse is not None)
    search.has_room = False
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.5)
    assert search.glimpses[-1] is not None
    search.has_room = True
    flight.run(0.5)
    assert search.glimpses[-1] is None
    assert search.glimpses.count(None) == 1


@pytest.mark.parametrize("mode", [HOLDING, RECOVERING])
def test_nobody_is_late_who_was_not_asked(mode: int) -> None:
    flight, search = searching()
    flight.outbound()
    search.answer = None
    before = len(search.glimpses)
    ticks(flight, mode, LATE_S + 1.0)
    assert len(search.glimpses) == before
    search.requests(0.4)
    search.answers(asked_last(search))  # of so long ago it is not obeyed
    search.answer = None
    ticks(flight, mode, 0.01)
    assert value(flight, "TGL_X") == pytest.approx(0.0, abs=1e-6)
    ticks(flight, SEARCHING, LATE_S - 0.5)  # it may take as long as ever
    assert value(flight, "SRCH_START") == 1.0
    ticks(flight, SEARCHING, 1.0)
    assert value(flight, "SRCH_START") == 0.0


@pytest.mark.parametrize("mode", [BREAKING_OFF, LANDING])
def test_on_the_way_home_there_is_no_search(mode: int) -> None:
    flight, search = searching()
    flight.outbound()
    before, x_m = len(search.glimpses), value(flight, "TGL_X")
    search.requests(0.4)
    ticks(flight, mode, LATE_S + 1.0)
    assert len(search.glimpses) == before
    assert value(flight, "TGL_X") == x_m
    assert value(flight, "SRCH_START") == 0.0
    flight.set("SRCH_START", 1.0)  # it is refused with the reason
    assert value(flight, "SRCH_START") == 0.0
    flight.run(0.05)
    reported = texts(flight.outbound())
    assert "search ended: it goes home" in reported
    assert "ESC_START" in "".join(reported)


def test_no_search_begins_by_itself_on_the_way_home() -> None:
    flight = Flight(flown=equipped(FC_ACT=4.0), search=ReportedSearch())
    flight.engaged().run(0.5)
    output = flight.onboard.output
    assert output is not None
    lost = output._replace(forecast=output.forecast._replace(standing=SINKS))
    flight.onboard._switches.tick(lost._replace(mode=BREAKING_OFF))
    assert value(flight, "SRCH_START") == 0.0


def test_who_soars_on_from_the_way_home_is_not_released_by_a_search_that_had_given_up() -> None:
    flight, search = searching()
    flight.set("ESC_START", 1.0)
    assert search.answer is not None
    search.answer = search.answer._replace(status=GIVEN_UP, reason=TOO_LOW)
    flight.onboard.settings.assign("SRCH_START", 3.0)  # in the tick in which it breaks off
    flight.run(0.5)
    assert goes_home(flight.mode_now)
    assert value(flight, "SRCH_START") == 0.0
    flight.set("ESC_START", 2.0)
    flight.run(1.0)
    assert flight.mode_now == CAPTURING
    search.requests(0.0)
    flight.set("SRCH_START", 1.0)  # and another one begins
    flight.run(0.5)
    assert flight.mode_now == SEARCHING


@pytest.mark.parametrize(
    ("flown", "search", "why"),
    [
        (equipped(), None, "no search in this process"),
        (equipped(FENCE_Z_MAX=5000.0), ReportedSearch(), "FENCE_Z_MAX"),
        (equipped(CLEAR_MIN=0.0), ReportedSearch(), "CLEAR_MIN is 0"),
        (setup()._replace(parameters=equipped().parameters), ReportedSearch(), "[polar]"),
    ],
)
def test_what_cannot_be_searched_is_refused(
    flown: ModuleSetup, search: ReportedSearch | None, why: str
) -> None:
    flight = Flight(flown=flown, search=search)
    flight.run(1.0)
    flight.outbound()
    flight.set("SRCH_START", 1.0)
    flight.run(0.1)
    assert value(flight, "SRCH_START") == 0.0
    assert why in "".join(texts(flight.outbound()))


@pytest.mark.parametrize(
    ("name", "number", "why"),
    [("CLEAR_MIN", 0.0, "CLEAR_MIN is 0"), ("FENCE_Z_MAX", 5000.0, "the fence is open")],
)
def test_a_search_ends_where_a_guard_is_taken_away(name: str, number: float, why: str) -> None:
    flight, _ = searching()
    flight.outbound()
    flight.set(name, number)
    flight.run(0.05)
    assert value(flight, "SRCH_START") == 0.0
    assert f"search ended: {why}" in "".join(texts(flight.outbound()))


@pytest.mark.parametrize("number", [2.0, 3.0, 4.0])
def test_what_only_the_module_shows_is_not_set(number: float) -> None:
    flight, _ = searching()
    flight.outbound()
    flight.set("SRCH_START", number)
    flight.run(0.05)
    assert value(flight, "SRCH_START") == 1.0
    assert "set 1 to search" in "".join(texts(flight.outbound()))


def test_where_no_place_is_foreseen_it_searches_by_itself_once() -> None:
    search = ReportedSearch()
    flight = Flight(flown=equipped(FC_ACT=4.0), search=search)
    flight.engaged().run(0.5)
    onboard = flight.onboard
    output = onboard.output
    assert output is not None
    assert value(flight, "SRCH_START") == 0.0
    lost = output._replace(forecast=output.forecast._replace(standing=SINKS))
    onboard._switches.tick(lost)
    assert value(flight, "SRCH_START") == 1.0
    search.requests(0.0)
    flight.run(0.5)
    assert flight.mode_now == SEARCHING
    flight.set("TGL_X", 0.1)
    flight.run(0.1)
    onboard._switches.tick(lost)
    assert value(flight, "SRCH_START") == 4.0  # the value of the one that took it back stays
    flight.run(0.1)
    assert "FC_ACT 4 acts as 2: its search is over" in texts(flight.outbound())
    assert flight.mode_now in (CAPTURING, SOARS)


@pytest.mark.parametrize(
    ("changes", "search", "why"),
    [
        ({"FENCE_Z_MAX": 5000.0}, ReportedSearch(), "the fence is open: set FENCE_Z_MAX"),
        ({"CLEAR_MIN": 0.0}, ReportedSearch(), "CLEAR_MIN is 0"),
        ({}, None, "there is no search in this process"),
    ],
)
def test_where_no_search_can_begin_fc_act_4_is_reported_to_act_as_2(
    changes: dict[str, float], search: ReportedSearch | None, why: str
) -> None:
    flight = Flight(flown=equipped(**changes), search=search)
    flight.run(1.0)
    flight.outbound()
    words = f"FC_ACT 4 acts as 2: {why}"
    flight.set("FC_ACT", 4.0)
    flight.run(0.1)
    assert words in "".join(texts(flight.outbound()))
    flight.engaged().run(0.1)
    assert words in "".join(texts(flight.outbound()))
    assert value(flight, "SRCH_START") == 4.0
    flight.run(1.0)
    assert flight.mode_now == SOARS  # and it is no search
    flight.set("FC_ACT", 2.0)
    flight.run(0.1)
    assert value(flight, "SRCH_START") == 0.0
    flight.set("FC_ACT", 4.0)
    flight.run(0.1)
    assert value(flight, "SRCH_START") == 4.0
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.1)
    assert value(flight, "SRCH_START") == 0.0


def test_a_process_that_dies_leaves_fc_act_4_with_the_guard_of_2() -> None:
    search = ReportedSearch()
    flight = Flight(flown=equipped(FC_ACT=4.0), search=search)
    flight.engaged().run(0.5)
    assert value(flight, "SRCH_START") == 0.0
    search.failure = "its process has died"
    flight.run(0.1)
    assert value(flight, "SRCH_START") == 4.0
    assert "FC_ACT 4 acts as 2: its process has died" in texts(flight.outbound())


# --- beside the tick --------------------------------------------------------------------------


def glimpse_at(time_s: float, x_m: float, z_m: float, climb_mps: float) -> Glimpse:
    now = VehicleState(
        time_s=time_s,
        x_m=x_m,
        y_m=0.0,
        z_m=z_m,
        velocity_x_mps=0.0,
        velocity_y_mps=0.0,
        climb_mps=climb_mps,
        roll_rad=0.0,
        pitch_rad=0.0,
        heading_rad=0.0,
        roll_rate_radps=0.0,
        pitch_rate_radps=0.0,
        heading_rate_radps=0.0,
    )
    before = now._replace(time_s=time_s - LOOK_S, z_m=z_m - climb_mps * LOOK_S)
    line = LineTracking(
        x_m=x_m, z_m=z_m, eta_rad=ETA, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0
    )
    return Glimpse(
        before=before,
        now=now,
        line=line,
        wind_mps=8.6,
        updraft_mps=1.2,
        pitot=True,
        seeks=True,
        refused=None,
    )


def tunnel_task() -> SearchTask:
    airframe, site = "airframes/eclipson_c.toml", "sites/tunnel.toml"
    known, place = load_airframe(shipped(airframe)), load_site(shipped(site))
    values = equipped().parameters.changed(
        {"FENCE_X_MIN": -0.5, "FENCE_X_MAX": 2.25, "FENCE_Z_MIN": 0.15, "FENCE_Z_MAX": 2.85}
    )
    laws = laws_from(values, place.frame(), known.aerodynamics(), place.known_ground())
    return task_of(laws)


def wait_for(search: SearchBeside) -> LineRequest | None:
    until = time.monotonic() + 60.0  # a busy machine starts slowly
    while time.monotonic() < until and not search.failure:
        if (answer := search.receive()) is not None:
            return answer
        time.sleep(0.01)
    return None


def test_the_process_answers_what_the_same_search_answers_here_and_may_die() -> None:
    here, beside = SearchHere(), SearchBeside()
    try:
        for search in (here, beside):
            search.begin(tunnel_task())
        for k in range(4):
            glimpse = glimpse_at(10.0 + LOOK_S * k, 0.6, 1.5 - 0.02 * k, -0.1)
            here.send(glimpse)
            beside.send(glimpse)
            expected = here.receive()
            answer = wait_for(beside)
            assert answer is not None
            assert expected is not None
            assert answer.target == pytest.approx(expected.target)
            assert (answer.status, answer.reason) == (expected.status, expected.reason)
        os.kill(beside.pid, signal.SIGKILL)
        assert wait_for(beside) is None
        assert beside.failure == "its process has died"
        beside.send(glimpse_at(11.0, 0.6, 1.5, 0.0))  # and that does no harm
    finally:
        beside.close()


def test_a_process_that_is_behind_listens_to_all_and_answers_the_newest() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    glimpses = [glimpse_at(10.0 + LOOK_S * k, 0.6, 1.5 - 0.02 * k, -0.1) for k in range(8)]
    here = SearchHere()
    with ours, theirs:
        ours.send(pickle.dumps(tunnel_task()))
        here.begin(tunnel_task())
        for glimpse in glimpses:
            ours.send(pickle.dumps(glimpse._replace(search=3)))
            here.send(glimpse)
        process = threading.Thread(target=serve, args=(theirs,))
        process.start()
        answer = pickle.loads(ours.recv(LARGEST_BYTES))
        ours.shutdown(socket.SHUT_WR)
        process.join()
        theirs.close()
        assert ours.recv(LARGEST_BYTES) == b""  # and it was the only one
    assert (answer.time_s, answer.search) == (glimpses[-1].now.time_s, 3)
    expected = here.receive()
    assert expected is not None
    assert answer.over_ground_m == pytest.approx(expected.over_ground_m)


def test_another_search_begins_from_the_start() -> None:
    """Also without a message between the two that no line is wanted."""
    here = SearchHere()
    here.begin(tunnel_task())
    for k in range(20):  # it falls to the floor
        here.send(glimpse_at(10.0 + LOOK_S * k, 0.6, 1.5 - 0.06 * k, -0.3)._replace(search=1))
        answer = here.receive()
        assert answer is not None
    assert answer is not None
    assert answer.status == GIVEN_UP
    assert answer.search == 1
    here.send(glimpse_at(20.0, 0.6, 1.5, 0.0)._replace(search=3))
    answer = here.receive()
    assert answer is not None
    assert (answer.status, answer.search) == (LOOKING, 3)


def soars_steep_or_aside(_: Grid, fields: Fields, *rest: Any) -> Rollouts:
    """In place of the map's: lines of 25 degrees soar best, one beside the aircraft, too."""
    now, lines = rest[2], rest[3]
    steep = abs(lines.eta_rad - radians(115.0)) < 1e-6
    aside = (abs(lines.eta_rad - ETA) < 1e-6) & (abs(lines.x_m - now.x_m - 0.24 * 2.7) < 0.01)
    rows = (len(fields.sink_scale), 1)
    return Rollouts(
        failed_s=np.tile(np.where(steep | aside, np.inf, 6.0), rows),
        climb_mps=np.tile(np.where(steep | aside, 0.0, -1.0), rows),
        x_m=np.tile(np.full(len(steep), now.x_m), rows),
        z_m=np.tile(np.full(len(steep), 1.5), rows),
        margin_m=np.tile(np.where(steep, 3.0, 0.3), rows),
        speed_margin_mps=np.tile(np.full(len(steep), 1.5), rows),
    )


@pytest.mark.parametrize("lean_max_deg", [45.0, 20.0])
def test_a_line_that_is_refused_is_not_asked_for_again(lean_max_deg: float) -> None:
    """Refused by the loop's margin, which the search does not know; or the parameters do not allow
    it, and it is not asked for at all."""
    seeker = Seeker()
    seeker.begin(tunnel_task()._replace(eta_max_rad=0.5 * pi + radians(lean_max_deg)))
    first = glimpse_at(10.0, 0.6, 1.5, -0.3)
    seeker.take(first._replace(seeks=False))
    assert seeker.search is not None
    seeker.search.roll = soars_steep_or_aside
    asked: list[TargetLine] = []
    for k in range(1, 6):
        glimpse = glimpse_at(10.0 + LOOK_S * k, 0.6, 1.5 - 0.06 * k, -0.3)
        answer = seeker.take(
            glimpse._replace(line=first.line, refused=asked[-1] if asked else None)
        )
        assert answer is not None
        if answer.target.eta_rad != ETA:
            asked.append(answer.target)
        elif answer.target.x_m != first.line.x_m:
            break
    assert answer is not None
    assert answer.target.x_m == pytest.approx(0.6 + 0.24 * 2.7, abs=0.02)
    assert len(asked) == (1 if lean_max_deg > 25.0 else 0)


def test_a_process_that_hangs_keeps_nobody_waiting() -> None:
    beside = SearchBeside()
    try:
        beside.begin(tunnel_task())
        beside.send(glimpse_at(10.0, 0.6, 1.5, 0.0))
        assert wait_for(beside) is not None
        os.kill(beside.pid, signal.SIGSTOP)
        begun = time.monotonic()
        for k in range(2000):
            beside.send(glimpse_at(10.0 + k, 0.6, 1.5, 0.0))
            beside.receive()
        assert beside.dropped > 0
        assert time.monotonic() - begun < 5.0
    finally:
        os.kill(beside.pid, signal.SIGKILL)
        beside.close()


def test_ground_that_is_not_known_is_the_fence() -> None:
    task = tunnel_task()._replace(ground=NO_GROUND)
    here = SearchHere()
    here.begin(task)
    here.send(glimpse_at(10.0, 0.6, 1.5, 0.0))
    answer = here.receive()
    assert answer is not None
    assert answer.over_ground_m == pytest.approx(1.35)

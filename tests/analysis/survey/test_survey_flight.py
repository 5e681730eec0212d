"""One survey's flight of made-up parts: when it begins, what it looks at, how its line moves and
how it ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.survey import survey_flight as module
from tgl_soar.analysis.survey.survey_flight import BEGIN_S, LOOKED, SurveyFlight, fly_survey
from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.control.survey import (
    DONE,
    DOWNSTREAM,
    HOMEWARD,
    LOOK_S,
    STOPPED,
    SURVEY_TEXTS,
    UPSTREAM,
)
from tgl_soar.sim.flight import FLIES

HZ = 200.0
EVERY = round(LOOK_S * HZ)


class Values:
    """Parameters, with all that was ever put into them."""

    def __init__(self, *changes: Any) -> None:
        self.changes = changes

    def changed(self, change: Any) -> Values:
        return Values(*self.changes, change)


class Flights:
    """What happens: the standing after each look of the survey, and what it moves."""

    def __init__(
        self, standings: list[int], moves: int = 0, modes: Any = None, ends_at: int = 10**9
    ) -> None:
        self.standings, self.moves = standings, moves
        self.modes = modes or (lambda _now_s: SOARING)
        self.ends_at = ends_at
        self.flown: list[Any] = []
        self.looks = self.ticks = 0
        self.begun_at: list[float] = []
        self.ticks_given: list[Any] = []

    def fly_on(self, parts: Any, laws: Any, flight: Any, to: int, changes: int, rows: Any) -> Any:
        assert (parts, len(rows)) == ("parts", self.ticks)
        self.flown.append((laws, flight.steps, to, changes))
        return self.flight(to)

    def flight(self, steps: int) -> Any:
        truth = SimpleNamespace(x_m=100.0 + steps, z_m=200.0 + steps)
        world = SimpleNamespace(samples=f"samples {steps}", aircraft=truth)
        standing = FLIES if steps < self.ends_at else FLIES + 1
        return SimpleNamespace(
            steps=steps, standing=standing, world=world, autopilot=f"autopilot {steps}"
        )

    def look(self, now_s: float) -> Any:
        line = SimpleNamespace(x_m=1.0, z_m=2.0)
        return SimpleNamespace(time_s=now_s, x_m=3.0 * now_s, z_m=4.0 * now_s, line=line)

    def step(self, laws: Any, autopilot: Any, inputs: Any) -> Any:
        self.ticks_given.append((laws, autopilot, inputs))
        now_s = inputs[0]
        return None, SimpleNamespace(mode=self.modes(now_s), look=self.look(now_s))

    def survey_begun(self, look: Any) -> Any:
        self.begun_at.append(look.time_s)
        start = SimpleNamespace(eta_rad=1.8)
        return SimpleNamespace(standing=DOWNSTREAM, reason=0, start=start)

    def survey_moved(self, task: Any, state: Any, look: Any, move: Any) -> Any:
        assert task.startswith("task of laws")
        for n in range(self.moves):
            assert move(f"target {look.time_s:g} {n}")
        assert not move("beyond")
        standing = self.standings[min(self.looks, len(self.standings) - 1)]
        self.looks += 1
        return SimpleNamespace(standing=standing, reason=2, start=state.start)


def survey(
    monkeypatch: pytest.MonkeyPatch, made: Flights, longest_s: float = 60.0, cut: bool = False
) -> SurveyFlight:
    made.ticks = round(longest_s * HZ)
    bounds = SimpleNamespace()

    def moved(values: Values, given: Any, target: Any) -> Values | None:
        assert given is bounds
        return None if target == "beyond" else values.changed(target)

    def line_bounds(contour: Any, ground: Any) -> Any:
        assert (contour, ground) == ((), "ground")
        return bounds

    began: list[Any] = []

    def begun(prepared: Any, seed: int) -> Any:
        began.append((prepared, seed))
        return "parts", made.flight(0)

    monkeypatch.setattr(module, "prepare", lambda world, seconds: ("prepared", world, seconds))
    monkeypatch.setattr(module, "begun", begun)
    monkeypatch.setattr(
        module, "laws_from", lambda values, *where: f"laws {len(values.changes)} {where}"
    )
    monkeypatch.setattr(module, "fly_on", made.fly_on)
    monkeypatch.setattr(
        module, "inputs_at", lambda now_s, samples, engage: (now_s, samples, engage)
    )
    monkeypatch.setattr(module, "autopilot_step", made.step)
    monkeypatch.setattr(module, "look_of", lambda output: output.look)
    monkeypatch.setattr(module, "survey_begun", made.survey_begun)
    monkeypatch.setattr(module, "survey_moved", made.survey_moved)
    monkeypatch.setattr(module, "survey_task", lambda laws: f"task of {laws}")
    monkeypatch.setattr(module, "moved", moved)
    monkeypatch.setattr(module, "LineBounds", line_bounds)
    monkeypatch.setattr(module, "is_cut_short", lambda _state: cut)
    monkeypatch.setattr(
        module, "why_ended",
        lambda _world, flight: "" if flight.standing == FLIES else "hit the board",
    )  # fmt: skip
    world: Any = SimpleNamespace(
        step_hz=HZ, ground="ground", frame="frame", aerodynamics="aerodynamics"
    )
    values: Any = Values()
    found = fly_survey(world, values, 61, longest_s)
    assert began == [(("prepared", world, longest_s), 61)]
    return found


def test_a_survey_begins_when_it_soars_and_has_found_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not before twelve seconds, and not while it still captures the line."""
    made = Flights([DOWNSTREAM])
    survey(monkeypatch, made, longest_s=14.0)
    assert made.begun_at == [pytest.approx(12.0)]
    assert BEGIN_S == 12.0
    late = Flights([DOWNSTREAM], modes=lambda now_s: SOARING if now_s > 13.01 else CAPTURING)
    survey(monkeypatch, late, longest_s=16.0)
    assert late.begun_at == [pytest.approx(13.0 + LOOK_S)]
    none = Flights([DOWNSTREAM])
    found = survey(monkeypatch, none, longest_s=11.0)
    assert none.begun_at == []
    assert not found.done
    assert (found.turns, found.cut_short, found.lasted_s) == ((), "", 0.0)
    assert np.isnan([found.begun_s, found.eta_rad]).all()
    assert [len(column) for column in found.looks.values()] == [0] * len(LOOKED)


def test_between_two_looks_the_tick_flies_alone_to_the_last_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = Flights([DOWNSTREAM])
    longest_s = 5.0 * LOOK_S + 0.4 * LOOK_S
    survey(monkeypatch, made, longest_s=longest_s)
    assert [(begin, end) for _, begin, end, _ in made.flown] == [
        *((n * EVERY, (n + 1) * EVERY) for n in range(5)),
        (5 * EVERY, round(longest_s * HZ)),
    ]
    laws, autopilot, inputs = made.ticks_given[2]
    assert laws == "laws 0 ('frame', 'aerodynamics', 'ground')"
    assert autopilot == f"autopilot {3 * EVERY}"
    assert inputs == (pytest.approx(3 * LOOK_S), f"samples {3 * EVERY}", True)


def test_each_look_is_kept_with_the_standing_that_it_was_flown_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = Flights([DOWNSTREAM, UPSTREAM, HOMEWARD, DONE])
    found = survey(monkeypatch, made)
    times = BEGIN_S + LOOK_S * np.arange(1, 5)
    assert tuple(found.looks) == LOOKED
    assert found.looks["time_s"] == pytest.approx(times)
    assert found.looks["x_m"] == pytest.approx(3.0 * times)
    assert found.looks["z_m"] == pytest.approx(4.0 * times)
    assert found.looks["line_x_m"].tolist() == [1.0] * 4
    assert found.looks["line_z_m"].tolist() == [2.0] * 4
    assert found.looks["standing"].tolist() == [DOWNSTREAM, DOWNSTREAM, UPSTREAM, HOMEWARD]
    assert found.looks["true_x_m"] == pytest.approx(100.0 + HZ * times)
    assert found.looks["true_z_m"] == pytest.approx(200.0 + HZ * times)
    assert found.begun_s == pytest.approx(times[0])
    assert found.lasted_s == pytest.approx(3.0 * LOOK_S)
    assert found.eta_rad == 1.8
    assert found.done
    assert found.turns == (SURVEY_TEXTS[2],) * 2  # the last turn is its end
    assert (found.cut_short, found.ended) == ("", "")
    assert made.flown[-1][2] == pytest.approx(HZ * times[-1])  # and no further


def test_every_change_of_parameters_is_passed_to_the_flight_and_flown_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One when the survey begins, and one for each place that its line is put at; a place that is
    refused changes nothing."""
    made = Flights([DOWNSTREAM, DOWNSTREAM, DONE], moves=2)
    survey(monkeypatch, made)
    at_begin = round(BEGIN_S / LOOK_S)
    assert [changes for *_, changes in made.flown] == [0] * at_begin + [1, 3, 5]
    counts = [int(laws.split()[1]) for laws, *_ in made.flown]
    assert counts == [0] * at_begin + [1, 3, 5]


def test_a_survey_that_is_stopped_or_cut_short_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped = survey(monkeypatch, Flights([DOWNSTREAM, STOPPED]))
    assert (stopped.done, stopped.cut_short) == (False, SURVEY_TEXTS[2])
    assert stopped.turns == ()
    assert len(stopped.looks["time_s"]) == 2
    short = survey(monkeypatch, Flights([UPSTREAM, DONE]), cut=True)
    assert (short.done, short.cut_short) == (True, SURVEY_TEXTS[2])


def test_a_flight_that_ends_ends_its_survey(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Flights([DOWNSTREAM], ends_at=round((BEGIN_S + 3 * LOOK_S) * HZ))
    found = survey(monkeypatch, made)
    assert found.ended == "hit the board"
    assert not found.done
    assert len(found.looks["time_s"]) == 3
    assert found.lasted_s == pytest.approx(2.0 * LOOK_S)

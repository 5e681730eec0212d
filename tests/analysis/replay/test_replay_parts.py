"""The parts of a replay one by one: where it is cut, from which state each tick is flown, which
parameters stand when, and what counts as a difference."""

from __future__ import annotations

import os
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgl_soar import __version__
from tgl_soar.analysis.logs.ulog_reader import FlightLog, ParameterChange
from tgl_soar.analysis.replay import logged as module
from tgl_soar.analysis.replay.logged import (
    LONG,
    NEVER_DEAD,
    STRETCH,
    Replay,
    ReplayDifference,
    ReplayError,
    _Cut,
    read_by_laws,
    replay,
)
from tgl_soar.autopilot import initial_state
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.onboard.flightlog.topics import TOPICS, record_size, rows_type

OURS = {"sys_name": "tgl_soar", "ver_sw": __version__}
BEGIN: Any = initial_state()


def log(topics: Any = (), **more: Any) -> FlightLog:
    parts: dict[str, Any] = {"topics": dict(topics), "parameters": {}, "info": OURS, **more}
    return FlightLog(path=Path("my.ulg"), **parts)


def flight(count: int = 10, cuts: Any = (), **more: Any) -> Any:
    parts = {
        "ticks": np.arange(100, 100 + count), "stamps": np.arange(count).astype(np.uint64),
        "inputs": [], "cuts": dict(cuts), "changed": False, "kernel": None, **more,
    }  # fmt: skip
    return module._Flight(**parts)


# --- what differs -------------------------------------------------------------------------------


def test_a_difference_has_its_ticks_its_largest_and_when() -> None:
    time_s = np.array([0.0, 1.0, 2.0, 3.0])
    then = {"time_s": time_s, "a": np.array([1.0, 2.0, 3.0, 4.0]), "b": np.zeros(4)}
    again = {**then, "a": np.array([1.0, 2.5, 3.0, 3.75]), "b": np.array([0.0, 0.0, 7.0, 0.0])}
    assert module._differences(then, again) == [
        ReplayDifference("b", 1, 7.0, 2.0),
        ReplayDifference("a", 2, 0.5, 1.0),
    ]
    assert module._differences(then, then) == []


def test_any_nan_is_as_good_as_another_and_none_is_a_number() -> None:
    other = np.frombuffer(np.uint64(0x7FF8_0000_0000_0001).tobytes(), np.float64)[0]
    time_s = np.array([0.0, 1.0])
    one = {"time_s": time_s, "a": np.array([nan, 1.0])}
    assert one["a"].tobytes() != np.array([other, 1.0]).tobytes()
    assert module._differences(one, {"time_s": time_s, "a": np.array([other, 1.0])}) == []
    assert module._differences(one, {"time_s": time_s, "a": np.array([2.0, nan])}) == [
        ReplayDifference("a", 2, inf, 0.0)
    ]
    both = {"time_s": time_s, "a": np.array([inf, 0.0])}
    assert module._differences(both, {"time_s": time_s, "a": np.array([inf, -0.0])}) == []


def test_whole_numbers_are_compared_as_numbers() -> None:
    time_s = np.array([0.0, 1.0])
    one = {"time_s": time_s, "n": np.array([3, 250], np.uint8)}
    (found,) = module._differences(one, {"time_s": time_s, "n": np.array([3, 5], np.uint8)})
    assert found == ReplayDifference("n", 1, 245.0, 1.0)


def test_states_are_the_same_with_nan_in_the_same_places() -> None:
    for a, b, same in (
        ((1.0, (2.0, nan)), (1.0, (2.0, nan)), True),
        ((1.0, (2.0, nan)), (1.0, (nan, 2.0)), False),
        ((1.0, 2.0), (1.0, 2.5), False),
        ((1.0, 2.0), (1.0, 2.0, 3.0), False),
        ((1, True), (1, False), False),
        (nan, nan, True),
        (nan, 1.0, False),
    ):
        assert module._same(a, b) is same, (a, b)


def test_a_replay_knows_how_many_times_faster_than_the_flight_it_was() -> None:
    made = Replay(
        time_s=np.array([5.0, 6.0, 8.0]), logged={}, replayed={}, differences=[], left_out=0,
        took_s=0.5, changed=False,
    )  # fmt: skip
    assert made.duration_s == 3.0
    assert made.speed == 6.0
    assert made.notes == []


# --- stretches ----------------------------------------------------------------------------------


def test_a_log_is_parted_at_logged_states_evenly() -> None:
    """Three stretches of 2100 ticks each: at the first states behind 2100 and 4200."""
    count = 3 * 2100
    cuts = {at: _Cut(state=BEGIN) for at in (0, 1900, 2150, 2300, 4100, 4205)}
    cuts[2120] = _Cut(gap=True)  # no state
    parted = flight(count, cuts)
    assert module._edges(parted, 3) == [0, 2150, 4205, count]
    assert module._edges(parted, 2) == [0, 4100, count]
    assert module._edges(parted, 1) == [0, count]
    assert module._edges(parted, 8) == [0, 2150, 4205, count]  # shorter is not worth a process
    assert module._edges(parted._replace(changed=True), 3) == [0, count]
    late = flight(count, {0: _Cut(state=BEGIN), 2150: _Cut(state=BEGIN)})
    assert module._edges(late, 3) == [0, 2150, count]


@pytest.mark.parametrize(("count", "edges"), [(2 * STRETCH - 1, 2), (2 * STRETCH, 3)])
def test_a_stretch_is_two_thousand_ticks_at_least(count: int, edges: int) -> None:
    cuts = {at: _Cut(state=BEGIN) for at in range(0, count, 10)}
    assert len(module._edges(flight(count, cuts), 4)) == edges
    assert STRETCH == 2000


def test_only_a_flight_in_several_stretches_goes_to_other_processes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(module, "_fly", lambda _flight, begin, end: (begin, end))
    monkeypatch.setattr(module, "LocalProcesses", lambda count: f"{count} processes")

    def fly_all(function: Any, jobs: Any, executor: Any) -> Any:
        asked.append(executor)
        return [function(job) for job in jobs]

    monkeypatch.setattr(module, "fly_all", fly_all)
    edges = [0, 4, 10]
    monkeypatch.setattr(
        module, "_edges", lambda _flight, workers: edges if workers == 2 else [0, 10]
    )
    found: Any = module._fly_all(flight(), 2)
    assert found == [(0, 4), (4, 10)]
    assert asked == ["2 processes"]
    alone: Any = module._fly_all(flight(), 1)
    assert alone == [(0, 10)]
    kernel: Any = module._fly_all(flight(kernel=lambda *_: None), 2)
    assert kernel == [(0, 10)]
    assert len(asked) == 1


# --- from which state ---------------------------------------------------------------------------

FIRST, SECOND = BEGIN, (1.0, 2.0)


@pytest.mark.parametrize(
    ("cut", "before", "changed", "taken", "torn"),
    [
        (_Cut(), FIRST, False, FIRST, []),
        (_Cut(gap=True), FIRST, False, None, []),
        (_Cut(gap=True, state=SECOND), FIRST, False, SECOND, []),  # type: ignore[arg-type]
        (_Cut(state=SECOND), None, False, SECOND, []),  # type: ignore[arg-type]
        (_Cut(state=SECOND, reset=True), FIRST, False, SECOND, []),  # type: ignore[arg-type]
        (_Cut(state=SECOND, reset=True), FIRST, True, SECOND, []),  # type: ignore[arg-type]
        (_Cut(state=SECOND), FIRST, False, SECOND, [102]),  # type: ignore[arg-type]
        (_Cut(state=SECOND), FIRST, True, FIRST, []),  # type: ignore[arg-type]
        (_Cut(state=FIRST), FIRST, False, FIRST, []),
    ],
)
def test_a_tick_is_flown_from_the_state_before_it_or_from_the_logged_one(
    cut: _Cut, before: Any, changed: bool, taken: Any, torn: list[int]
) -> None:
    found: list[int] = []
    given = module._taken_up(flight(changed=changed), 3, cut, before, found)
    assert given is taken
    assert found == torn  # the tick after which the state is another


def flown(monkeypatch: pytest.MonkeyPatch, flight: Any, begin: int, end: int) -> Any:
    """(what came of it, [(laws, state, from, to, place in the rows)])."""
    calls: list[Any] = []

    def stretch(_flight: Any, laws: Any, state: Any, here: int, to: int, rows: Any, at: int) -> Any:
        calls.append((laws, state, here, to, at // record_size("tick")))
        assert len(rows) == record_size("tick") * (end - begin)
        assert at % record_size("tick") == 0
        return f"after {to}"

    monkeypatch.setattr(module, "_stretch", stretch)
    return module._fly(flight, begin, end), calls


def test_between_two_cuts_the_laws_and_the_state_run_on(monkeypatch: pytest.MonkeyPatch) -> None:
    cuts: dict[int, Any] = {
        0: _Cut(state="begin", laws="first"),  # type: ignore[arg-type]
        3: _Cut(laws="second"),  # type: ignore[arg-type]
        5: _Cut(gap=True),
        7: _Cut(state="again"),  # type: ignore[arg-type]
    }
    found, calls = flown(monkeypatch, flight(10, cuts), 0, 10)
    assert calls == [
        ("first", "begin", 0, 3, 0),
        ("second", "after 3", 3, 5, 3),
        ("second", "again", 7, 10, 7),
    ]
    assert found.known == [(0, 3), (3, 5), (7, 10)]  # behind the gap nothing is known
    assert found.torn == []


def test_a_stretch_begins_under_the_laws_that_stood_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And ends in the state that the next one has, or that is reported."""
    cuts: dict[int, Any] = {
        0: _Cut(state="begin", laws="first"),  # type: ignore[arg-type]
        2: _Cut(laws="second"),  # type: ignore[arg-type]
        4: _Cut(state="there"),  # type: ignore[arg-type]
        6: _Cut(laws="third"),  # type: ignore[arg-type]
        8: _Cut(state="after 8"),  # type: ignore[arg-type]
    }
    found, calls = flown(monkeypatch, flight(10, cuts), 4, 8)
    assert calls == [("second", "there", 4, 6, 0), ("third", "after 6", 6, 8, 2)]
    assert found.torn == []
    cuts[8] = _Cut(state="other")  # type: ignore[arg-type]
    found, _ = flown(monkeypatch, flight(10, cuts), 4, 8)
    assert found.torn == [107]
    found, _ = flown(monkeypatch, flight(8, cuts), 4, 8)  # the log's end
    assert found.torn == []


# --- parameters ---------------------------------------------------------------------------------


def change(tick: int, name: str, value: float) -> ParameterChange:
    return ParameterChange(tick=tick, time_s=0.0, name=name, value=value)


def parameters(made: FlightLog, stands: Any = (), changes: Any = ()) -> Any:
    notes: list[str] = []
    found = module._parameters(made, dict(stands), dict(changes), notes)
    return found, notes


def test_what_is_changed_stands_over_the_airframes_and_that_over_the_logs() -> None:
    made = log(parameters={"RHO_P": 0.1, "RHO_D": 0.1, "ELE_P": 0.1, "GONE": 1.0, "ALSO": 2.0})
    ((tick, values),), notes = parameters(made, {"RHO_D": 0.2, "ELE_P": 0.2}, {"ELE_P": 0.3})
    assert tick == -1
    names = ("RHO_P", "RHO_D", "ELE_P")
    assert [values[name] for name in names] == pytest.approx([0.1, 0.2, 0.3])
    assert notes == ["unknown by now, passed over: ALSO, GONE"]
    assert parameters(log())[1] == []


def test_changes_of_one_tick_act_together_in_the_order_of_the_ticks() -> None:
    changes = [change(9, "RHO_P", 0.9), change(4, "RHO_D", 0.4), change(4, "RHO_P", 0.5)]
    changes += [change(9, "GONE", 1.0), change(5, "ELE_P", 0.7)]
    found, notes = parameters(log(changes=changes), changes={"ELE_P": 0.3})
    assert [tick for tick, _ in found] == [-1, 4, 9]  # that of what is changed is passed over
    assert [v["RHO_P"] for _, v in found[1:]] == pytest.approx([0.5, 0.9])
    assert [v["RHO_D"] for _, v in found[1:]] == pytest.approx([0.4, 0.4])
    assert [v["ELE_P"] for _, v in found] == pytest.approx([0.3] * 3)
    assert notes == []


def test_a_change_that_is_refused_by_now_is_passed_over_and_reported() -> None:
    low = PARAMETERS[INDEX["RHO_P"]].minimum - 1.0
    changes = [change(4, "RHO_P", low), change(6, "RHO_D", 0.4)]
    found, notes = parameters(log(changes=changes))
    assert [tick for tick, _ in found] == [-1, 6]
    assert len(notes) == 1
    assert notes[0].startswith("after tick 4: ")
    assert notes[0].endswith(": passed over")
    assert "RHO_P" in notes[0]


def test_only_what_a_law_reads_may_be_changed() -> None:
    with pytest.raises(ParameterError, match="no such parameter; see `tgl-soar params`"):
        parameters(log(), changes={"RHO_Q": 1.0})
    unread = next(p for p in PARAMETERS if p.name not in read_by_laws())
    with pytest.raises(ParameterError, match="no law reads it"):
        parameters(log(), changes={unread.name: unread.default})
    assert {"RHO_P", "ELE_P", "TGL_X"} <= read_by_laws()
    assert len(read_by_laws()) < len(PARAMETERS)


# --- what a log must have -----------------------------------------------------------------------


def test_a_log_without_ticks_or_of_others_is_refused() -> None:
    tick = {"tick": np.array([1]), "time_s": np.array([0.0]), "engage": np.array([0])}
    assert module._ticks_of(log({"tick": tick})) is not None
    with pytest.raises(ReplayError, match=r"my\.ulg: not a log of tgl_soar"):
        module._ticks_of(log({"tick": tick}, info={"sys_name": "PX4"}))
    nothing: Any = {"tick": {**tick, "tick": np.array([])}}
    none: list[Any] = [{}, {"tick": {}}, nothing]
    for topics in none:
        with pytest.raises(ReplayError, match=r"my\.ulg: no tick in it"):
            module._ticks_of(log(topics))
    for name in ("time_s", "engage"):
        other = {key: value for key, value in tick.items() if key != name}
        with pytest.raises(ReplayError, match=f"another layout: no {name} in its ticks"):
            module._ticks_of(log({"tick": other}))


def test_a_topic_has_all_its_columns_or_no_row() -> None:
    module._check_layout("state", {})
    with pytest.raises(ReplayError, match=r"another layout: no .* in state"):
        module._check_layout("state", {"tick": np.array([1])})
    notes: list[str] = []
    assert module._states(log({"state": {"tick": np.array([1])}}), notes) == []
    assert len(notes) == 1
    assert notes[0].endswith("in state: its states are not used")
    whole = {leaf.name: np.zeros(1) for leaf in TOPICS["state"].leaves}
    module._check_layout("state", whole)
    assert module._states(log(), notes) == []
    assert len(notes) == 1


@pytest.mark.parametrize("name", ["airframe", "site"])
def test_a_log_without_its_files_cannot_be_replayed(name: str) -> None:
    texts = {each: "" for each in ("airframe", "site") if each != name}
    with pytest.raises(ReplayError, match=rf"my\.ulg: it does not hold the {name} file"):
        module._configuration(log(texts=texts), None, [])


# --- where it is cut ----------------------------------------------------------------------------


def prepared(
    monkeypatch: pytest.MonkeyPatch, numbers: Any, states: Any = (), values: Any = ((-1, "v"),),
    **info: Any,
) -> tuple[Any, list[str]]:  # fmt: skip
    monkeypatch.setattr(module, "_states", lambda *_: list(states))
    monkeypatch.setattr(module, "_configuration", lambda *_: ("setup", {}))
    monkeypatch.setattr(module, "_parameters", lambda *_: list(values))
    monkeypatch.setattr(module, "laws_of", lambda setup, values: f"laws of {setup}, {values}")
    monkeypatch.setattr(module, "_columns", lambda *_: ["columns"])
    notes: list[str] = []
    tick = {"tick": np.array(numbers, np.uint32), "timestamp": np.array(numbers)}
    made = log({"tick": tick}, info={**OURS, **info})
    found = module._prepare(made, tick, {}, None, False, notes, None)
    return found, notes


def test_missing_ticks_are_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = prepared(monkeypatch, [5, 6, 9, 10, 12], [(4, False, "begin")])
    assert {at for at, cut in found.cuts.items() if cut.gap} == {2, 4}
    assert found.ticks.tolist() == [5, 6, 9, 10, 12]
    assert found.inputs == ["columns"]


def test_a_state_belongs_to_the_tick_behind_it_unless_that_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    states = [
        (4, False, "begin"),
        (6, True, "a"),
        (8, False, "b"),
        (10, False, "c"),
        (12, True, "d"),
    ]
    found, notes = prepared(monkeypatch, [5, 6, 9, 10, 12], states)
    assert found.cuts[0] == _Cut(state="begin", laws="laws of setup, v")  # type: ignore[arg-type]
    assert found.cuts[2] == _Cut(state="b", gap=True)  # type: ignore[arg-type]
    assert found.cuts[4] == _Cut(gap=True)  # 11 is missing
    assert notes == []
    begun = [(4, False, "begin"), (5, True, "a"), (5, False, "b")]
    found, _ = prepared(monkeypatch, [5, 6], begun)
    assert found.cuts[1] == _Cut(state="b", reset=True)  # type: ignore[arg-type]


def test_parameters_act_from_the_tick_behind_their_change_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    values = [(-1, "v"), (5, "w"), (7, "x"), (12, "y")]
    found, _ = prepared(monkeypatch, [5, 6, 9, 10, 12], [(4, False, "begin")], values)
    laws = {at: cut.laws for at, cut in found.cuts.items() if cut.laws}
    assert laws == {n: f"laws of setup, {v}" for n, v in ((0, "v"), (1, "w"), (2, "x"))}


@pytest.mark.parametrize(
    ("numbers", "states", "is_reported"),
    [
        ([1, 2, 3], [], True),
        ([1, 2, 3], [(2, False, "a")], True),  # a module's first tick
        ([5, 6, 7], [], True),  # nothing better is known
        ([5, 6, 7], [(6, False, "a")], False),  # from there on
        ([5, 6, 7], [(4, False, "a")], False),
    ],
)
def test_without_a_state_it_is_flown_from_a_modules_first_tick_on(
    monkeypatch: pytest.MonkeyPatch, numbers: list[int], states: Any, is_reported: bool
) -> None:
    found, notes = prepared(monkeypatch, numbers, states)
    words = ["no state at the beginning: from a module's first tick on"]
    assert notes == (words if is_reported else [])
    assert (found.cuts[0].state == initial_state()) == is_reported


def test_another_version_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    _, notes = prepared(monkeypatch, [5], [(4, False, "a")], ver_sw="0.0.1")
    assert notes == [f"flown with version 0.0.1, replayed with {__version__}"]


# --- the whole ----------------------------------------------------------------------------------


def whole(
    monkeypatch: pytest.MonkeyPatch, count: int = 6, known: Any = ((0, 6),), torn: Any = (),
    surfaces: bool = False, ready: bool = True, processors: int | None = 5, **options: Any,
) -> tuple[Replay, list[Any]]:  # fmt: skip
    """A replay of made-up ticks, the second half of which has another mode than the log."""
    names = [each.name for each in TOPICS["tick"].fields]
    rows = np.zeros(count, np.dtype(rows_type("tick")))
    tick = {name: np.zeros(count, rows.dtype[name]) for name in names if name != "command_rudder"}
    tick["tick"] = rows["tick"] = np.arange(count)
    tick["time_s"] = rows["time_s"] = 0.5 * np.arange(count)
    tick["mode"] = np.where(np.arange(count) < count // 2, 0, 3).astype(rows.dtype["mode"])
    topics: dict[str, Any] = {"tick": tick}
    if surfaces:
        topics["surfaces"] = {"tick": np.array([1])}
    asked: list[Any] = []

    def prepare(*given: Any) -> Any:
        asked.append(given)
        return given[-1]

    def fly_all(kernel: Any, workers: int) -> Any:
        asked.append((kernel, workers))
        return [module._LoggedTicks(rows.tobytes(), list(known), list(torn))]

    monkeypatch.setattr(module, "_prepare", prepare)
    monkeypatch.setattr(module, "_load", lambda _flight: 0.0)
    monkeypatch.setattr(module, "_fly_all", fly_all)
    monkeypatch.setattr(module, "is_ready", lambda: ready)
    monkeypatch.setattr(module, "compiled_ticks", lambda: "kernel")
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    return replay(log(topics), **options), asked


def test_only_ticks_that_could_be_flown_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = whole(monkeypatch, known=((0, 1), (2, 4)))
    assert found.time_s.tolist() == [0.0, 1.0, 1.5]
    assert found.left_out == 3
    assert found.logged["mode"].tolist() == [0, 0, 3]
    assert found.replayed["mode"].tolist() == [0, 0, 0]
    assert found.differences == [ReplayDifference("mode", 1, 3.0, 1.5)]
    assert not found.changed


def test_columns_that_the_log_lacks_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = whole(monkeypatch)
    assert found.notes == ["not in the log, so not compared: command_rudder"]
    assert "command_rudder" not in found.logged


def test_a_state_that_is_not_the_logged_one_is_reported_unless_something_was_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, _ = whole(monkeypatch, torn=(7, 9))
    assert "the state after tick 7 is not the logged one (2 of them)" in found.notes
    found, _ = whole(monkeypatch, torn=(7, 9), changes={"RHO_P": 0.9})
    assert found.changed
    assert not any("state after tick" in note for note in found.notes)


@pytest.mark.parametrize("options", [{"changes": {"RHO_P": 0.9}}, {"airframe": "x.toml"}])
def test_surfaces_that_obeyed_the_log_are_not_held_against_other_commands(
    monkeypatch: pytest.MonkeyPatch, options: Any
) -> None:
    words = "the surfaces obeyed the logged commands, and are not held against these"
    given = dict(options.get("changes", {}))
    found, asked = whole(monkeypatch, surfaces=True, **options)
    assert asked[0][2] == {**NEVER_DEAD, **given}
    assert asked[0][4] is True
    assert words in found.notes
    found, asked = whole(monkeypatch, surfaces=False, **options)
    assert asked[0][2] == given
    assert words not in found.notes
    found, asked = whole(monkeypatch, surfaces=True)
    assert asked[0][2] == {}
    assert asked[0][4] is False
    assert {"SURF_TOL": PARAMETERS[INDEX["SURF_TOL"]].maximum} == NEVER_DEAD


def test_as_many_processes_as_processors_unless_others_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert whole(monkeypatch)[1][1] == (None, 5)
    assert whole(monkeypatch, workers=2)[1][1] == (None, 2)
    assert whole(monkeypatch, processors=None)[1][1] == (None, 1)


@pytest.mark.parametrize(
    ("count", "ready", "compile", "compiled"),
    [
        (LONG - 1, True, None, False),
        (LONG, True, None, True),
        (LONG, False, None, False),
        (6, False, True, True),
        (LONG, True, False, False),
    ],
)
def test_long_logs_are_flown_by_a_kernel_that_is_there(
    monkeypatch: pytest.MonkeyPatch, count: int, ready: bool, compile: bool | None, compiled: bool
) -> None:
    """And where anything differs then, by the plain laws, whose result counts."""
    assert LONG == 20_000
    _, asked = whole(monkeypatch, count, known=((0, count),), ready=ready, compile=compile)
    kernels = [each[0] for each in asked if len(each) == 2]
    assert kernels == (["kernel", None] if compiled else [None])
    _, asked = whole(monkeypatch, count, known=((0, count // 2),), ready=ready, compile=compile)
    kernels = [each[0] for each in asked if len(each) == 2]
    assert kernels == (["kernel"] if compiled else [None])


def test_the_airframes_parameters_that_are_others_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    logged, other = ParameterSet(), ParameterSet().changed({"RHO_P": 0.9, "RHO_D": 0.3})
    monkeypatch.setattr(module, "site_from", lambda text, name: (text, name))
    monkeypatch.setattr(module, "airframe_from", lambda text, name: (text, name))
    monkeypatch.setattr(module, "load_airframe", lambda path: f"airframe of {path}")
    monkeypatch.setattr(module, "setup_from", lambda *given: given)

    def values(airframe: Any, path: Any, site: Any, _where: Any) -> ParameterSet:
        assert site == ("s", "site in my.ulg")
        if airframe == ("a", "airframe in my.ulg"):
            assert path == "airframe in my.ulg"
            return logged
        assert (airframe, path) == ("airframe of new.toml", "new.toml")
        return other

    monkeypatch.setattr(module, "load_parameters", values)
    made, notes = log(texts={"airframe": "a", "site": "s"}), list[str]()
    setup: Any
    setup, stands = module._configuration(made, None, notes)
    assert (setup[0], setup[2], stands, notes) == (("a", "airframe in my.ulg"), logged, {}, [])
    setup, stands = module._configuration(made, "new.toml", notes)
    assert (setup[0], setup[2]) == ("airframe of new.toml", other)
    assert stands == {"RHO_P": other["RHO_P"], "RHO_D": other["RHO_D"]}
    assert notes == ["of new.toml: 2 parameters are others"]


def test_a_kernel_is_loaded_with_laws_and_a_state_before_the_clock_runs() -> None:
    calls: list[Any] = []

    def kernel(*given: Any) -> Any:
        calls.append([given[0], given[1], given[2].shape[0], given[3].shape[0]])

    cuts: dict[int, Any] = {
        0: SimpleNamespace(laws=None, state="s"),
        3: SimpleNamespace(laws="l", state=None),
    }
    assert module._load(flight(cuts=cuts, kernel=kernel)) >= 0.0
    assert calls == [["l", "s", 0, 0]]
    module._load(flight(cuts={0: cuts[0]}, kernel=kernel))
    module._load(flight(cuts={3: cuts[3]}, kernel=kernel))
    module._load(flight(cuts=cuts))
    assert len(calls) == 1

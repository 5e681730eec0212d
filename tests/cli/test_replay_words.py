"""`tgl-soar replay` of made-up results: its tables, changes, exit codes, refusals."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from tgl_soar.analysis.replay.logged import Replay
from tgl_soar.analysis.replay.many import ReplayedLog
from tgl_soar.cli import replay as module
from tgl_soar.cli.app import app
from tgl_soar.cli.batch_options import ALL, changes_of
from tgl_soar.cli.replay import _compare, _from_wire, _list_differences, _show_all, _unit

NAN = float("nan")


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "console", Console(width=200))


def cells(output: str) -> list[list[str]]:
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    return [row for row in rows if row]


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["replay", *map(str, words)], env={"COLUMNS": "200"})
    return done.exit_code, done.output


def difference(name: str, ticks: int = 3, largest: float = 0.01234, time_s: float = 1.5) -> Any:
    return SimpleNamespace(name=name, ticks=ticks, largest=largest, time_s=time_s)


def result(**more: Any) -> Replay:
    fields: dict[str, Any] = {
        "time_s": np.arange(5.0), "logged": {}, "replayed": {}, "differences": [], "left_out": 0,
        "took_s": 0.5, "changed": False, "notes": [], **more,
    }  # fmt: skip
    return Replay(**fields)


# --- changes -----------------------------------------------------------------------------------


def test_changes_are_names_and_numbers() -> None:
    assert changes_of(["rho_p=0.8", " RHO_D = 0.25"]) == {"RHO_P": 0.8, "RHO_D": 0.25}
    assert changes_of([]) == {}


@pytest.mark.parametrize("text", ["RHO_P", "RHO_P=", "RHO_P=x"])
def test_what_is_no_change_is_refused(text: str) -> None:
    code, output = run("x.ulg", "--param", text)
    assert code == 2
    assert f"--param {text}: must be NAME=VALUE, as RHO_P=0.8" in output


@pytest.mark.parametrize(("words", "reported"), [
    (("a.ulg", "--resume"), "--resume goes with --out"),
    (("a.ulg", "--restart"), "--restart goes with --out"),
    (
        ("a.ulg", "--scheduler", "tcp://127.0.0.1:1"),
        "--scheduler goes with several logs, or with --out",
    ),
    (
        ("a.ulg", "b.ulg", "--site", "tunnel"),
        "one log at a time with --site: 2 are named; the newest is b.ulg",
    ),
    (
        ("a.ulg", "b.ulg", "--figure", "x.png"),
        "one log at a time with --figure: 2 are named; the newest is b.ulg",
    ),
    (
        ("a.ulg", "b.ulg", "--compile"),
        "one log at a time with --compile: 2 are named; the newest is b.ulg",
    ),
    (("a.ulg", "--out", "x", "--compile"), "--compile goes with one log, and without --out"),
    (("a.ulg", "--site", "tunnel"), "--site is only for a .tlog"),
    (("none.ulg",), "none.ulg"),
])  # fmt: skip
def test_what_does_not_go_together_is_refused(words: tuple[str, ...], reported: str) -> None:
    code, output = run(*words)
    assert (code, reported in output) == (2, True), output


def test_several_are_replayed_by_whom_the_options_name(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, str | None]] = []
    monkeypatch.setattr(
        module, "executor_of", lambda workers, scheduler: asked.append((workers, scheduler))
    )
    monkeypatch.setattr(module, "replay_many", lambda *_: [])
    for words in ((), ("--workers", "3"), ("--scheduler", "tcp://there:1")):
        assert run("a.ulg", "b.ulg", *words)[0] == 0
    assert asked == [(ALL, None), (3, None), (ALL, "tcp://there:1")]


# --- one log -----------------------------------------------------------------------------------


@pytest.fixture
def replayed(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A log that is made up, and what was asked of its replay."""
    made = SimpleNamespace(asked=[], losses=[], result=result())

    def replay_log(_log: Any, **asked: Any) -> Replay:
        made.asked.append(asked)
        found: Replay = made.result
        return found

    monkeypatch.setattr(module, "read", lambda _path: SimpleNamespace(losses=made.losses))
    monkeypatch.setattr(module, "replay_log", replay_log)
    return made


def test_the_same_in_every_bit_is_reported_and_no_failure(replayed: Any) -> None:
    code, output = run("a.ulg")
    assert code == 0
    # Four seconds of ticks in half a second.
    assert "5 ticks in 0.50 s, 8 × real time\n" in output
    assert "every command is the same, bit for bit" in output
    assert replayed.asked == [{"changes": {}, "airframe": None, "workers": None, "compile": None}]
    run("a.ulg", "--workers", "3", "--compile", "--param", "RHO_P=0.8", "--airframe", "eclipson_c")
    asked = replayed.asked[1]
    assert (asked["workers"], asked["compile"], asked["changes"]) == (3, True, {"RHO_P": 0.8})
    assert asked["airframe"].name == "eclipson_c.toml"


@pytest.mark.parametrize(("differs", "changed", "losses", "code"), [
    (False, False, [], 0), (True, False, [], 1), (True, True, [], 0), (False, False, ["x"], 1),
    (True, True, ["x"], 1),
])  # fmt: skip
def test_the_exit_code_is_one_where_commands_differ_or_data_is_lost(
    differs: bool, changed: bool, losses: list[str], code: int, replayed: Any
) -> None:
    differences = [difference("command_elevator")] if differs else []
    replayed.result = result(differences=differences, changed=changed)
    replayed.losses = losses
    assert run("a.ulg")[0] == code


def test_what_was_left_out_and_noted_is_reported(replayed: Any) -> None:
    replayed.result = result(left_out=7, notes=["a note [of brackets]"])
    _, output = run("a.ulg")
    assert "8 × real time; 7 left out, the state before them is lost" in output
    assert "a note [of brackets]" in output


def test_a_change_that_nothing_used_is_reported(replayed: Any) -> None:
    replayed.result = result(changed=True)
    assert "no command differs: no tick of this flight used the changed values" in run("a.ulg")[1]
    replayed.result = result(changed=True, differences=[difference("command_elevator")])
    assert "no command differs" not in run("a.ulg")[1]


def test_twelve_differences_are_listed_and_the_others_counted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    named = [difference("command_elevator"), difference("setpoints_pitch_rad", 4, 0.5, 2.25)]
    many = [difference(f"field_{i}") for i in range(12)]
    _list_differences(result(differences=[*named, *many]))
    output = capsys.readouterr().out
    rows = cells(output)
    assert rows[0] == ["command_elevator", "3", rows[0][2], "1.500 s"]
    assert rows[0][2].startswith("0.0123")
    assert rows[1] == ["setpoints_pitch_rad", "4", f"0.5 {_unit('setpoints_pitch_rad')}", "2.250 s"]
    assert len(rows) == 12
    assert "and 2 more fields" in output
    _list_differences(result(differences=many))
    assert "more fields" not in capsys.readouterr().out
    assert _unit("setpoints_pitch_rad") == "rad"
    assert _unit("no_such") == ""


def test_commands_are_compared_where_both_were_flown(capsys: pytest.CaptureFixture[str]) -> None:
    active = np.array([True, True, False, True])
    logged = {
        "active": active,
        "setpoints_pitch_rad": np.array([3.0, 4.0, 0.0, NAN]),
        "command_elevator": np.array([0.3, 0.4, 9.0, NAN]),
        "command_rudder": np.array([NAN] * 4),
    }
    again = {
        "active": active,
        "setpoints_pitch_rad": np.array([0.0, 0.0, 0.0, 1.0]),
        "command_elevator": np.array([0.3, 0.0, 0.0, 0.5]),
        "command_rudder": np.array([0.1] * 4),
    }
    _compare(result(logged=logged, replayed=again, differences=[difference("command_elevator")]))
    output = capsys.readouterr().out
    rows = {row[0].split(" ")[0]: row[1:] for row in cells(output)}
    # rms of 3, 4, 0 is 5 / sqrt 3; of 0.3, 0.4 it is 0.5 / sqrt 2.
    assert rows["setpoints_pitch_rad"] == ["2.887", "0", "2.887", "0", "–"]
    assert rows["command_elevator"] == ["0.3536", "0.2121", "0.2828", "0.01234", "1.500 s"]
    assert rows["command_rudder"] == ["–"] * 5
    assert "command_aileron" not in rows
    assert "the aircraft does not answer to the change" in output


# --- several -----------------------------------------------------------------------------------


def replayed_log(**more: Any) -> ReplayedLog:
    fields: dict[str, Any] = {
        "log": "a.ulg", "ticks": 50, "duration_s": 1.25, "differing": (), "left_out": 0,
        "losses": 0, "error": "", **more,
    }  # fmt: skip
    return ReplayedLog(**fields)


@pytest.mark.parametrize(("more", "changed", "code"), [
    ({}, False, 0), ({"error": "bad"}, False, 1), ({"losses": 1}, False, 1),
    ({"differing": ("a",)}, False, 1), ({"differing": ("a",)}, True, 0),
    ({"left_out": 3}, False, 0),
])  # fmt: skip
def test_one_bad_log_of_several_is_an_exit_code(
    more: dict[str, Any], changed: bool, code: int
) -> None:
    found = [replayed_log(), replayed_log(**more)]
    if code == 0:
        _show_all(found, changed)
    else:
        with pytest.raises(typer.Exit) as ended:
            _show_all(found, changed)
        assert ended.value.exit_code == code


def test_a_line_for_each_log(capsys: pytest.CaptureFixture[str]) -> None:
    _show_all(
        [
            replayed_log(left_out=2, losses=0),
            replayed_log(log="b.ulg", differing=("u", "v", "w")),
            replayed_log(log="c.ulg", differing=("u", "v", "w", "x"), duration_s=10.5),
        ],
        True,
    )
    output = capsys.readouterr().out
    assert cells(output) == [
        ["a.ulg", "50", "2", "0", "nothing"],
        ["b.ulg", "50", "0", "0", "u, v, w"],
        ["c.ulg", "50", "0", "0", "u, v, w …"],
    ]
    assert "3 logs, 13 s of flight" in output


# --- a recording of the wire -------------------------------------------------------------------


def wire(**more: Any) -> Any:
    def flight(reported: float, again: float) -> Any:
        return SimpleNamespace(reported=reported, replayed=again)

    fields: dict[str, Any] = {
        "outputs": [None] * 50, "seconds": 2.0, "took_s": 0.25, "notes": [], "missed": False,
        "losses": [], "compared": {
            "e_rho": [flight(0.3, 0.0), flight(0.0, 0.4), flight(NAN, 1.0)],
            "pitch_sp": [flight(5.0, 7.0)], "soar_mode": [flight(NAN, 4.0)],
        }, **more,
    }  # fmt: skip
    return SimpleNamespace(**fields)


def test_what_was_reported_is_compared_with_what_is_reported_now(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "replay_wire", lambda *_given: wire())
    _from_wire(Path("a.tlog"), Path("a"), Path("s"), {})
    output = capsys.readouterr().out
    assert "50 ticks in 0.25 s, 8.0 × the recording's time" in output
    rows = {row[0]: row[1:] for row in cells(output)}
    assert rows["e_rho"][:2] == ["m", "3"]
    assert rows["e_rho"][3] == "0.4"
    assert float(rows["e_rho"][2]) == pytest.approx((0.25 / 2) ** 0.5, abs=0.001)
    assert rows["pitch_sp"] == ["°", "1", "2", "2"]
    assert rows["soar_mode"] == ["", "1", "–", "–"]


@pytest.mark.parametrize(("more", "code"), [
    ({"missed": True}, 1), ({"losses": ["x"]}, 1), ({"outputs": []}, 2),
])  # fmt: skip
def test_a_recording_that_is_not_whole_is_an_exit_code(
    more: dict[str, Any], code: int, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(module, "replay_wire", lambda *_given: wire(**more))
    with pytest.raises(typer.Exit) as ended:
        _from_wire(Path("a.tlog"), Path("a"), Path("s"), {})
    assert ended.value.exit_code == code
    if code == 2:
        assert "a.tlog: no tick could be run" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["e_rho", "soar_x", "soar_z", "line_x", "line_z"])
def test_lengths_are_in_metres_and_angles_in_degrees(name: str) -> None:
    assert module._REPORTED_IN[name] == "m"
    assert module._REPORTED_IN["pitch_sp"] == module._REPORTED_IN["line_lean"] == "°"


@pytest.mark.parametrize(("changes", "airframe", "title"), [
    ({}, None, "a.ulg, replayed"), ({"RHO_P": 0.8}, None, "a.ulg, replayed with RHO_P = 0.8"),
    ({"RHO_P": 0.8}, Path("x/jet.toml"), "a.ulg, replayed with RHO_P = 0.8, jet.toml"),
])  # fmt: skip
def test_a_figure_says_what_was_replayed(
    changes: dict[str, float], airframe: Path | None, title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(
        "tgl_soar.analysis.report.replay_figure.replay_figure", lambda *given: drawn.append(given)
    )
    module._draw(Path("f.png"), result(), Path("logs/a.ulg"), changes, airframe)
    ((figure, *_, words),) = drawn
    assert (figure, words) == (Path("f.png"), title)

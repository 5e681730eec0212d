"""`tgl-soar surfaces` and `preflight` without a vehicle: what they ask, await, report."""

from __future__ import annotations

import signal
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from tgl_soar.cli import preflight, surfaces
from tgl_soar.cli.app import app
from tgl_soar.cli.surfaces import latency_words
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.link.autopilots.requirements import MUST, Finding, Requirement
from tgl_soar.link.checks.surface_check import NO_SPEED, SurfaceFinding
from tgl_soar.link.messages import ID_LOCAL_POSITION_NED, ID_SERVO_OUTPUT_RAW, Source
from tgl_soar.link.transports.base import LinkError
from tgl_soar.onboard.surface_control import RELEASE_FRAMES

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
PLANE = load_airframe(AIRFRAME)
NAN = float("nan")
Out = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (surfaces, preflight):
        monkeypatch.setattr(module, "console", Console(width=250))


def rows(output: str) -> list[list[str]]:
    found = [[cell.strip() for cell in line.split("│")[1:-1]] for line in output.splitlines()]
    return [row for row in found if row]


# --- the outputs -------------------------------------------------------------------------------


def finding(surface: str, *faults: str, trim_us: float = 1500.0) -> SurfaceFinding:
    return SurfaceFinding(
        surface=surface, faults=faults, trim_us=trim_us, low_us=1299.6, high_us=1700.4
    )


@pytest.mark.parametrize(("faults", "wrong", "code"), [
    ((), [], 0), (("moves the other way",), [], 1), ((), ["trailing edge up"], 1),
])  # fmt: skip
def test_a_fault_or_a_person_who_saw_one_is_an_exit_code(
    faults: tuple[str, ...], wrong: list[str], code: int, capsys: Out
) -> None:
    found = [finding("elevator"), finding("rudder", *faults, trim_us=NAN)]
    check: Any = SimpleNamespace(findings=lambda: found)
    assert surfaces._reported(check, wrong) == code
    out, err = capsys.readouterr()
    way = faults[0] if faults else "as in the file"
    assert rows(out) == [
        ["elevator", "1500 us", "1300 us", "1700 us", "as in the file"],
        ["rudder", "-", "1300 us", "1700 us", way],
    ]
    assert ("went the wrong way; it must be: trailing edge up" in err) == bool(wrong)
    assert ("change `reversed` of that surface" in err) == bool(wrong)


def test_a_latency_that_was_not_measured_is_reported() -> None:
    assert latency_words((NAN, NAN), PLANE) == (
        "CMD_DELAY 5 ms: not measured, no output was read back in time"
    ).replace("5 ms", f"{1e3 * own_delay_s():.3g} ms")


def own_delay_s() -> float:
    from tgl_soar.config.parameters import ParameterSet

    return float(ParameterSet().changed(PLANE.all_parameters())["CMD_DELAY"])


@pytest.mark.parametrize(("margins", "ending"), [
    ((0.7, 0.5), "it would leave a margin of 0.70 to 0.50"),
    ((0.6, 0.4), "of 0.60 to 0.40, of 0.5: if the link is that late at times, set CMD_DELAY"
                 " (command_delay_s of [dynamics]) to what it then is"),
    ((0.4, 0.3), "of 0.40 to 0.30, of 0.5: make the link faster, or set CMD_DELAY"
                 " (command_delay_s of [dynamics]) to what it is"),
    ((NAN, NAN), "; what it leaves of the loop's margin is not known of this airframe"),
])  # fmt: skip
def test_what_a_latency_leaves_of_the_margin(
    margins: tuple[float, float], ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float] = []
    left = iter(margins)

    def margin(_values: Any, late_s: float) -> float:
        asked.append(late_s)
        return next(left)

    monkeypatch.setattr(surfaces, "margin_when_late", margin)
    words = latency_words((0.0204, 0.0406), PLANE)
    assert words.startswith("from a command to the output read back: 20 to 41 ms, the way back")
    assert f"CMD_DELAY is {1e3 * own_delay_s():.3g} ms" in words
    assert words.endswith(ending)
    assert asked == [0.0204, 0.0406]


def test_outputs_are_asked_for_fifty_times_a_second_and_the_speed_ten() -> None:
    bench = surfaces._Bench(
        SimpleNamespace(), SimpleNamespace(autopilot=Source(1, 1))  # type: ignore[arg-type]
    )  # fmt: skip
    asked = [(each.params[0], each.params[1]) for each in bench._requests]
    assert asked == [(ID_SERVO_OUTPUT_RAW, 20_000.0), (ID_LOCAL_POSITION_NED, 100_000.0)]
    for each in bench._requests:
        assert (each.command, each.confirmation, each.params[2:]) == (511, 0, (0.0,) * 5)
        assert (each.target_system, each.target_component) == (1, 1)


def test_what_is_reported_of_the_latency_is_printed_with_its_brackets(
    monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    spoken = nullcontext(SimpleNamespace(command=lambda _message: None))
    bench = SimpleNamespace(wait_for_autopilot=lambda _timeout_s: None, go=lambda _look: [])
    monkeypatch.setattr(surfaces, "Conversation", lambda *_given: spoken)
    monkeypatch.setattr(surfaces, "_Bench", lambda *_given: bench)
    monkeypatch.setattr(surfaces, "latency_words", lambda *_given: "set it in [dynamics]")
    with pytest.raises(typer.Exit):
        surfaces.surfaces("udpout:127.0.0.1:9", AIRFRAME, yes=True)
    assert capsys.readouterr().out.endswith("set it in [dynamics]\n")


# --- the way through the check -----------------------------------------------------------------


class Checked:
    """A check of two stops, each held for two turns."""

    def __init__(self, refusals: list[str] | None = None) -> None:
        self.sights = ["up", ""]
        self.turns = 0
        self.taken: list[Any] = []
        self._refusals = list(refusals or [])

    @property
    def done(self) -> bool:
        return not self.sights

    @property
    def sight(self) -> str:
        return self.sights[0]

    def refusal(self, _now_s: float) -> str:
        return self._refusals.pop(0) if self._refusals else ""

    def step(self, _now_s: float) -> list[str]:
        return ["move"]

    def held(self, _now_s: float) -> bool:
        self.turns += 1
        return self.turns % 2 == 0

    def move_on(self) -> None:
        self.sights.pop(0)

    def take(self, message: Any, _now_s: float) -> None:
        self.taken.append(message)


class Spoken:
    """A conversation in which the autopilot says one thing each turn."""

    autopilot = Source(1, 1)

    def __init__(self) -> None:
        self.commanded: list[Any] = []
        self.outbound: list[Any] = []
        self.asked: list[Any] = []

    def turn(self, every_second: Any = ()) -> list[str]:
        self.asked.append(list(every_second))
        return ["received"]

    def command(self, message: Any) -> None:
        self.commanded.append(message)

    def say(self, message: Any) -> None:
        self.outbound.append(message)


@pytest.mark.parametrize(("answers", "wrong"), [
    ([True], []), ([False], ["up"]), ([None, None, True], []), ([None, False], ["up"]),
])  # fmt: skip
def test_a_stop_is_held_until_it_is_answered(answers: list[bool | None], wrong: list[str]) -> None:
    check, spoken, sights = Checked(), Spoken(), list[str]()
    left = iter(answers)

    def look(sight: str) -> bool | None:
        sights.append(sight)
        return next(left)

    bench = surfaces._Bench(check, spoken)  # type: ignore[arg-type]
    assert bench.go(look) == wrong
    assert sights == ["up"] * len(answers)
    assert check.done
    assert len(spoken.commanded) == 2 * len(answers) + 2  # a stop without a sight asks nothing
    assert set(check.taken) == {"received"}
    assert len(spoken.asked[0]) == 2


def test_what_may_not_be_moved_any_more_is_released() -> None:
    bench = surfaces._Bench(Checked(["", "it flies"]), Spoken())  # type: ignore[arg-type]
    with pytest.raises(surfaces._Refused, match="it flies; the surfaces are released"):
        bench.go(lambda _sight: True)


@pytest.mark.parametrize(("refusals", "turns", "words"), [
    ([], 0, ""), (["no heartbeat"] * 3, 3, ""), (["armed"], 0, "armed"),
    (["no heartbeat", "armed"], 1, "armed"), (["no heartbeat"] * 50, 5, "no heartbeat"),
    ([NO_SPEED], 1, ""), ([NO_SPEED] * 50, 5, "no speed of it was received"),
])  # fmt: skip
def test_an_autopilot_is_waited_for_until_it_has_said_what_it_does(
    refusals: list[str], turns: int, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoken = Spoken()
    monkeypatch.setattr(
        surfaces, "time", SimpleNamespace(monotonic=lambda: 2.0 * len(spoken.asked))
    )
    bench = surfaces._Bench(Checked(refusals), spoken)  # type: ignore[arg-type]
    if words:
        with pytest.raises(surfaces._Refused, match=words):
            bench.wait_for_autopilot(9.0)
    else:
        bench.wait_for_autopilot(9.0)
    assert len(spoken.asked) == turns


# --- a person ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("typed", "answer"), [
    ("y\n", True), ("Yes \n", True), ("n\n", False), ("NO\n", False), ("maybe\n", None),
    ("\n", None),
])  # fmt: skip
def test_a_person_answers_yes_or_no(
    typed: str, answer: bool | None, monkeypatch: pytest.MonkeyPatch, capsys: Out
) -> None:
    asked = surfaces._Asked()
    ready: list[Any] = []
    monkeypatch.setattr(
        surfaces, "select", SimpleNamespace(select=lambda *_given: (list(ready), [], []))
    )
    monkeypatch.setattr(surfaces, "sys", SimpleNamespace(
        stdin=SimpleNamespace(readline=lambda: typed)))  # fmt: skip
    assert asked("edge up") is None
    assert asked("edge up") is None
    assert capsys.readouterr().out == "  edge up?  [y/n] "  # once
    ready.append("stdin")
    assert asked("edge up") is answer
    again = capsys.readouterr().out
    assert again == ("  y or n: edge up?  " if answer is None else "")
    ready.clear()
    asked("edge up")
    assert bool(capsys.readouterr().out) == (answer is not None)  # it is another stop


@pytest.mark.parametrize("fails", [False, True])
def test_nobody_there_is_no_answer(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def readline() -> str:
        if fails:
            raise OSError
        return ""

    monkeypatch.setattr(
        surfaces, "select", SimpleNamespace(select=lambda *_given: (["stdin"], [], []))
    )
    monkeypatch.setattr(surfaces, "sys", SimpleNamespace(stdin=SimpleNamespace(readline=readline)))
    with pytest.raises(surfaces._Refused, match="nobody answers: give --yes"):
        surfaces._Asked()("edge up")
    assert surfaces._nobody("edge up") is True


# --- the whole command -------------------------------------------------------------------------


class Opened(Spoken):
    """The conversation that the command opens."""

    last: Any = None

    def __init__(self, *_given: Any) -> None:
        super().__init__()
        Opened.last = self

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *_given: Any) -> None: ...


@pytest.mark.parametrize(("ends", "code", "words"), [
    (None, 0, "CMD_DELAY"), (surfaces._Refused("it flies"), 2, "error: it flies"),
    (surfaces._Ended(signal.SIGTERM), 143, "stopped; the surfaces are released"),
    (surfaces._Ended(signal.SIGINT), 130, "stopped; the surfaces are released"),
    (LinkError("no link"), 2, "error: no link"),
])  # fmt: skip
def test_however_it_ends_the_surfaces_are_released(
    ends: Exception | None, code: int, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def go(_bench: Any, look: Any) -> list[str]:
        assert look is surfaces._nobody
        if ends is not None:
            raise ends
        return []

    monkeypatch.setattr(surfaces, "Conversation", Opened)
    monkeypatch.setattr(surfaces._Bench, "wait_for_autopilot", lambda _bench, _timeout_s: None)
    monkeypatch.setattr(surfaces._Bench, "go", go)
    monkeypatch.setattr(surfaces, "_reported", lambda _check, _wrong: 0)
    before = signal.getsignal(signal.SIGTERM)
    options = ["--link", "udp:127.0.0.1:1", "--airframe", str(AIRFRAME), "--yes"]
    done = CliRunner().invoke(app, ["surfaces", *options], env={"COLUMNS": "250"})
    assert (done.exit_code, words in done.output) == (code, True), done.output
    frames = len(Opened.last.commanded)
    assert frames >= RELEASE_FRAMES
    assert frames % RELEASE_FRAMES == 0
    assert signal.getsignal(signal.SIGTERM) == before


# --- preflight ---------------------------------------------------------------------------------


def checked(**more: Any) -> Any:
    must = Requirement(names=("A_B",), relation="is", wanted=1.0, why="because")
    should = must._replace(names=("C_D",), level="should")
    ok = Finding(must, "A_B", 1.0)
    wrong, unwise = Finding(must, "A_B", 3.0), Finding(should, "C_D", None)
    fields: dict[str, Any] = {
        "findings": [ok, wrong, unwise], "wrong": [wrong, unwise], "refusal": "", "answers": True,
        **more,
    }  # fmt: skip
    route = SimpleNamespace(
        message="M", mode="mode", after_silence="it glides", takeover="a switch"
    )
    return SimpleNamespace(
        flavour=SimpleNamespace(route=route, name="Firmware"),
        findings=lambda: fields["findings"],
        wrong=lambda: fields["wrong"],
        refusal=lambda: fields["refusal"],
        answers=fields["answers"],
        ok=ok,
        unwise=unwise,
    )


def test_what_must_be_changed_is_listed_with_the_way(capsys: Out) -> None:
    part = preflight._reported(checked(), "", show_all=False)
    assert preflight._concluded([part]) == 1
    output = capsys.readouterr().out
    assert "Firmware by M in mode: 3 parameters, 1 as needed" in output
    assert rows(output) == [
        ["MUST", "3", "set A_B to 1", "because"],
        ["should", "no answer", "set C_D to 1", "because"],
    ]
    assert "not ready: change what is shown above in red" in output
    assert "when the module falls silent: it glides\nthe pilot takes over by: a switch\n" in output
    preflight._reported(checked(), "", show_all=True)
    assert rows(capsys.readouterr().out)[0] == ["ok", "1", "A_B", "because"]


def test_what_should_be_changed_is_ready_all_the_same(capsys: Out) -> None:
    made = checked()
    some = checked(findings=[made.ok, made.unwise], wrong=[made.unwise])
    assert preflight._concluded([preflight._reported(some, "", show_all=False)]) == 0
    assert "ready, but some parameters should be changed" in capsys.readouterr().out
    well = preflight._reported(checked(findings=[made.ok], wrong=[]), "", show_all=False)
    assert preflight._concluded([well]) == 0
    output = capsys.readouterr().out
    assert "ready\n" in output
    assert "but" not in output
    assert rows(output) == []


@pytest.mark.parametrize(("more", "too_slow", "words"), [
    ({"refusal": "it is refused"}, "", "it is refused"),
    ({}, "the line is slow", "the line is slow"),
])  # fmt: skip
def test_a_refusal_or_a_slow_line_is_not_ready(
    more: dict[str, Any], too_slow: str, words: str, capsys: Out
) -> None:
    made = checked()
    some = checked(findings=[made.ok], wrong=[], **more)
    part = preflight._reported(some, too_slow, show_all=False)
    assert preflight._concluded([part]) == 1
    output = capsys.readouterr().out
    assert words in output
    assert "not ready" in output


def test_a_firmware_without_parameters_is_reported(capsys: Out) -> None:
    part = preflight._reported(checked(findings=[], wrong=[]), "", show_all=True)
    assert (part.good, part.warnings) == (True, ("its set-up cannot be read over the link",))
    output = capsys.readouterr().out
    assert "its set-up cannot be read over the link: see docs/hardware.md" in output
    assert "ready" not in output
    preflight._reported(checked(answers=False), "", show_all=False)
    output = capsys.readouterr().out
    assert "no parameter was answered: does the link carry parameters?" in output
    assert "cannot be read" not in output


class Asked:
    """The autopilot's parameters as they answer: the heartbeat after some turns."""

    mismatch = ""

    def __init__(self, beats_at: int, done_at: int) -> None:
        self.taken = 0
        self._beats_at, self._done_at = beats_at, done_at

    def take(self, _message: Any) -> None:
        self.taken += 1

    @property
    def received(self) -> bool:
        return self.taken >= self._beats_at

    def poll(self, _now_s: float) -> list[str]:
        return ["request"]

    def done(self, _now_s: float) -> bool:
        return self.taken >= self._done_at


def read(check: Any, monkeypatch: pytest.MonkeyPatch, timeout_s: float = 10.0) -> Spoken:
    spoken = Spoken()
    clock = SimpleNamespace(monotonic=lambda: 100.0 + len(spoken.asked))
    monkeypatch.setattr(preflight, "time", clock)
    preflight._read(check, spoken, timeout_s)  # type: ignore[arg-type]
    return spoken


def test_parameters_are_asked_for_once_there_is_a_heartbeat(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert read(Asked(1, 1), monkeypatch).outbound == ["request"]
    assert len(read(Asked(5, 8), monkeypatch).outbound) == 4
    read(Asked(11, 11), monkeypatch)  # ten seconds are waited for it
    with pytest.raises(LinkError, match="no heartbeat of autopilot 1 within 10 s: check the link"):
        read(Asked(12, 12), monkeypatch)
    read(Asked(1, 50), monkeypatch)  # and as long as it takes for the rest
    other = Asked(1, 5)
    other.mismatch = "another firmware"
    with pytest.raises(LinkError, match="another firmware"):
        read(other, monkeypatch)


def test_a_level_of_a_row_is_must_where_nothing_is_said() -> None:
    assert Requirement(names=("A",), relation="is", wanted=1.0, why="why").level == MUST


def test_a_glides_brake_is_from_none_to_all(tmp_path: Path) -> None:
    for brake in ("-0.1", "1.1"):
        words = ["glide", f"--brake={brake}", "--out", str(tmp_path)]
        done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
        assert done.exit_code == 2
        assert f"--brake {brake}: each must be from 0 to 1" in done.output
    assert not list(tmp_path.iterdir())

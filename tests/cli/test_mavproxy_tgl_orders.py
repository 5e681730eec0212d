"""The command `tgl` of MAVProxy on made-up messages: what is received, sent, shown and refused."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli import mavproxy_tgl
from tgl_soar.cli.mavproxy_tgl import MavproxyStation, TglModule, init, status_lines
from tgl_soar.cli.page.settling_preview import GhostLine
from tgl_soar.cli.page.station import StationAnswer
from tgl_soar.config.files import shipped
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES
from tgl_soar.estimation.health import FAULT_TEXTS

LINE = {"TGL_X": 0.25, "TGL_Z": 1.25, "TGL_LEAN": 15.0}
SITE = shipped("sites/tunnel.toml")


class Master:
    """The link that MAVProxy sends on: notes what is sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[Any, ...]] = []
        self.mav = self
        self.srcSystem = 255

    def param_set_send(self, *fields: Any) -> None:
        self.sent.append(("set", *fields))

    def command_long_send(self, *fields: Any) -> None:
        self.sent.append(("command", *fields))

    def param_request_read_send(self, *fields: Any) -> None:
        self.sent.append(("read", *fields))

    def taken(self) -> list[tuple[Any, ...]]:
        found, self.sent = self.sent, []
        return found


def message(made: Any, system: int = 1, component: int = 191) -> Any:
    reader: Any = mavlink.MAVLink(None, 0, 0)
    return reader.decode(bytearray(made.pack(mavlink.MAVLink(None, system, component))))


def beat(start: int = 5, mode: int = 4) -> Any:
    return mavlink.MAVLink_heartbeat_message(18, 8, 0, start << 8 | mode, 4, 3)


def named(name: str, value: float) -> Any:
    return mavlink.MAVLink_named_value_float_message(0, name.encode(), value)


def value_of(name: str, value: float) -> Any:
    return mavlink.MAVLink_param_value_message(name.encode(), value, 9, 91, 0)


def station(target: int = 0) -> tuple[MavproxyStation, Master]:
    master = Master()
    return MavproxyStation(lambda: master, lambda: target), master


# --- the module as the links show it -----------------------------------------------------------


def test_only_the_modules_own_words_are_received() -> None:
    module, _ = station()
    module.take(message(named("e_rho", 0.5), component=1), 10.0)
    assert (module.values, module.system, module.silence_s(10.0)) == ({}, 0, inf)
    module.take(message(named("e_rho", 0.5), system=7), 10.0)
    assert (module.values, module.system, module.silence_s(12.5)) == ({"e_rho": 0.5}, 7, 2.5)
    of_one, _ = station(target=3)
    assert of_one.system == 3
    of_one.take(message(named("e_rho", 0.5), system=7), 10.0)
    assert of_one.values == {}
    of_one.take(message(named("e_rho", 0.5), system=3), 10.0)
    assert of_one.values == {"e_rho": 0.5}


def test_the_heartbeat_holds_the_mode_and_another_start_forgets_all() -> None:
    module, _ = station()
    module.take(message(beat(5, 11)), 10.0)
    assert module.values == {"soar_mode": 11.0}
    module.take(message(value_of("TGL_Z", 1.5)), 10.0)
    module.take(message(named("climb", 0.5)), 10.0)
    module.take(message(beat(5, 4)), 10.0)
    assert module.values == {"soar_mode": 4.0, "climb": 0.5}
    module.take(message(beat(6, 2)), 10.0)
    assert module.values == {"soar_mode": 2.0}
    assert module.parameters == {}


def test_names_of_telemetry_and_parameters_are_kept_and_others_are_not() -> None:
    module, _ = station()
    answers: list[StationAnswer] = []
    module.on_answer = answers.append
    for made in (named("soar_x", 1.0), named("wind", 8.0), named("other", 1.0),
                 value_of("NO_SUCH", 1.0), value_of("RHO_P", 0.5)):  # fmt: skip
        module.take(message(made), 10.0)
    assert module.values == {"soar_x": 1.0, "wind": 8.0}
    assert module.parameters == {"RHO_P": 0.5}
    assert answers == [StationAnswer(kind="value", name="RHO_P", value=0.5)]


@pytest.mark.parametrize(("system", "is_ours"), [(0, True), (255, True), (1, False), (254, False)])
def test_an_answer_to_another_station_is_not_ours(system: int, is_ours: bool) -> None:
    module, _ = station()
    answers: list[StationAnswer] = []
    module.on_answer = answers.append
    module.take(message(mavlink.MAVLink_command_ack_message(31010, 4, 0, 0, system, 0)), 10.0)
    module.take(message(mavlink.MAVLink_param_error_message(system, 190, b"RHO_P", -1, 3)), 10.0)
    ours = [
        StationAnswer(kind="ack", command=31010, result=4),
        StationAnswer(kind="error", name="RHO_P"),
    ]
    assert answers == (ours if is_ours else [])


def test_what_is_sent_is_for_the_module_of_the_system_that_was_received() -> None:
    module, master = station()
    module.take(message(beat(), system=7), 10.0)
    module.set("RHO_P", 0.5)
    module.command(31010, 2)
    assert master.taken() == [
        ("set", 7, 191, b"RHO_P", 0.5, 9),
        ("command", 7, 191, 31010, 2, *[0] * 7),
    ]


def test_what_of_the_line_is_not_known_is_asked_for_every_two_seconds() -> None:
    module, master = station()
    module.fetch(10.0)
    assert master.taken() == []  # no module is there
    module.take(message(beat()), 10.0)
    module.take(message(value_of("TGL_X", 0.5)), 10.0)
    module.fetch(10.0)
    names = (b"TGL_Z", b"TGL_LEAN", b"TGL_STAGE", b"TGL_PRESET")
    assert master.taken() == [("read", 1, 191, name, -1) for name in names]
    module.fetch(11.99)
    assert master.taken() == []
    module.fetch(12.0)
    assert len(master.taken()) == 4
    module.fetch(13.01)  # silent for over three seconds
    module.fetch(14.5)
    assert master.taken() == []
    module.take(message(beat()), 20.0)
    module.fetch(23.0)
    assert len(master.taken()) == 4


def test_another_component_is_another_module() -> None:
    module, _ = station()
    module.take(message(beat()), 10.0)
    module.take(message(value_of("TGL_X", 0.5)), 10.0)
    module.change_component(77)
    assert (module.component, module.values, module.parameters) == (77, {}, {})
    assert module.silence_s(10.0) == inf
    module.take(message(beat()), 10.0)
    assert module.values == {}
    module.take(message(beat(), component=77), 10.0)
    assert module.values == {"soar_mode": 4.0}


# --- the command -------------------------------------------------------------------------------


class Prompt:
    """The module as MAVProxy has it, on a clock that the test sets."""

    def __init__(self, target: int = 0) -> None:
        self.master = Master()
        self.now_s = 100.0
        self.commands: dict[str, Any] = {}
        self.public: dict[str, Any] = {}
        mpstate = SimpleNamespace(
            master=lambda: self.master,
            settings=SimpleNamespace(target_system=target),
            command_map=self.commands,
            completions={},
            public_modules=self.public,
        )
        self.module = init(mpstate)

    def receive(self, *made: Any) -> None:
        for each in made:
            self.module.mavlink_packet(message(each))

    def type(self, line: str) -> None:
        self.commands["tgl"][0](line.split())

    def known(self, **more: float) -> Prompt:
        values = {**LINE, "TGL_STAGE": 0.0, "TGL_PRESET": 0.0, **more}
        self.receive(beat(), *(value_of(name, value) for name, value in values.items()))
        return self

    def sets(self) -> list[tuple[str, float]]:
        return [(each[3].decode(), each[4]) for each in self.master.taken() if each[0] == "set"]

    def commanded(self) -> list[int]:
        return [each[3] for each in self.master.taken() if each[0] == "command"]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Prompt]:
    def made(target: int = 0) -> Prompt:
        prompt = Prompt(target)
        monkeypatch.setattr(mavproxy_tgl, "time", SimpleNamespace(monotonic=lambda: prompt.now_s))
        return prompt

    return made


Made = Callable[..., Prompt]
Out = pytest.CaptureFixture[str]


@pytest.mark.parametrize(("word", "number"), [("engage", 31010), ("release", 31011),
                                              ("abort", 31012)])  # fmt: skip
def test_a_switch_is_commanded_at_once_and_its_answer_is_reported(
    clock: Made, capsys: Out, word: str, number: int
) -> None:
    prompt = clock().known()
    prompt.type(word)
    assert prompt.commanded() == [number]
    prompt.receive(mavlink.MAVLink_command_ack_message(number, 0, 0, 0, 255, 0))
    assert capsys.readouterr().out == f"tgl: {word}: done\n"


def test_what_is_not_answered_is_repeated_by_idle_turns(clock: Made) -> None:
    prompt = clock().known()
    prompt.type("engage")
    assert prompt.commanded() == [31010]
    for now_s, count in ((100.4, 0), (100.5, 1), (101.0, 1)):
        prompt.now_s = now_s
        prompt.module.idle_task()
        assert len(prompt.commanded()) == count


@pytest.mark.parametrize("line", ["engage", "move 1 2", "lean 10", "preset 1"])
def test_without_a_module_nothing_is_sent_and_the_way_out_is_reported(
    clock: Made, capsys: Out, line: str
) -> None:
    prompt = clock()
    prompt.type(line)
    assert prompt.master.taken() == []
    assert capsys.readouterr().out == (
        "tgl: no module is known: component 191 was not received, and target_system is 0"
        " (set target_system N; tgl component N)\n"
    )


def test_a_line_that_is_not_known_yet_is_not_moved(clock: Made, capsys: Out) -> None:
    prompt = clock(target=1)
    prompt.type("move 1 2")
    assert "the module's line is not known yet: try again in a moment" in capsys.readouterr().out
    assert prompt.master.taken() == []


@pytest.mark.parametrize(("line", "changes"), [
    ("move 0.5 1.5", {"TGL_X": 0.5, "TGL_Z": 1.5}),
    ("move 0.5 1.5 20", {"TGL_X": 0.5, "TGL_Z": 1.5, "TGL_LEAN": 20.0}),
])  # fmt: skip
def test_a_move_is_staged(clock: Made, line: str, changes: dict[str, float]) -> None:
    prompt = clock().known()
    prompt.type(line)
    assert prompt.sets() == [("TGL_STAGE", 1.0)]
    prompt.receive(value_of("TGL_STAGE", 1.0))
    prompt.now_s += 0.1
    prompt.module.idle_task()
    assert dict(prompt.sets()) == changes


def test_a_lean_leaves_the_point(clock: Made) -> None:
    prompt = clock().known()
    prompt.type("lean 20")
    assert prompt.sets() == [("TGL_LEAN", 20.0)]


@pytest.mark.parametrize(("line", "words"), [
    ("move x 1", "TGL_X: 'x' is no number"), ("move 1 z", "TGL_Z: 'z' is no number"),
    ("lean up", "TGL_LEAN: 'up' is no number"), ("move 9999 1", "TGL_X = 9999: allowed"),
    ("move 1 9999", "TGL_Z = 9999: allowed"), ("lean 99", "TGL_LEAN = 99: allowed"),
    ("move 1 1 99", "TGL_LEAN = 99: allowed"), ("preset 0", "lines are counted from 1"),
    ("preset 100", "TGL_PRESET = 100: allowed"),
    ("preset b", "tgl preset b: no site file: tgl site FILE, or give a number"),
    ("component 0", "tgl component 0: must be 1 to 255"),
    ("component 256", "tgl component 256: must be 1 to 255"),
    ("component x", "tgl component x: must be 1 to 255"),
    ("site no-such.toml", "no-such.toml"), ("preset a b", "usage: tgl move"),
    ("site a b", "usage: tgl move"),
    ("component 1 2", "usage: tgl move"), ("status x", "usage: tgl move"), ("lean", "usage:"),
])  # fmt: skip
def test_what_is_wrong_is_reported_and_not_sent(
    clock: Made, capsys: Out, line: str, words: str
) -> None:
    prompt = clock().known()
    prompt.type(line)
    assert words in capsys.readouterr().out
    assert prompt.master.taken() == []


@pytest.mark.parametrize("number", [1, 191, 255])
def test_a_component_is_any_of_1_to_255(clock: Made, capsys: Out, number: int) -> None:
    prompt = clock()
    prompt.type(f"component {number}")
    assert prompt.module.station.component == number
    assert capsys.readouterr().out == ""


# --- lines of a site file ----------------------------------------------------------------------


def test_the_site_is_read_and_its_lines_are_numbered(
    clock: Made, capsys: Out, tmp_path: Path
) -> None:
    prompt = clock().known()
    prompt.type(f"site {SITE}")
    expected = "tgl: site open jet, board at 23 degrees: lines 1 a, 2 b, 3 c\n"
    assert capsys.readouterr().out == expected
    prompt.type("preset z")
    assert capsys.readouterr().out == "tgl: tgl preset z: the site's lines are a, b, c\n"
    prompt.type("preset b")
    assert prompt.sets() == [("TGL_PRESET", 2.0)]
    bare = tmp_path / "bare.toml"
    bare.write_text('[site]\nname = "bare"\nwind_from_deg = 0.0\n', encoding="utf-8")
    prompt.type(f"site {bare}")
    assert capsys.readouterr().out == "tgl: site bare: lines none\n"
    prompt.type("preset b")
    assert "the site's lines are none" in capsys.readouterr().out


@pytest.mark.parametrize("number", [1, 2, 99])
def test_a_preset_by_number_needs_no_site(clock: Made, number: int) -> None:
    prompt = clock().known()
    prompt.type(f"preset {number}")
    assert prompt.sets() == [("TGL_PRESET", float(number))]


B = (0.6, 1.6)  # line b of the tunnel, which has no lean of its own


@pytest.mark.parametrize(("x", "z", "preset", "warned"), [
    (*B, 2.0, False), (0.6005, 1.6, 2.0, False), (0.602, 1.6, 2.0, True), (0.6, 1.7, 2.0, True),
    (0.5, 1.6, 0.0, False),  # it was moved on already
])  # fmt: skip
def test_a_module_with_another_site_file_is_warned_of_once(
    clock: Made, capsys: Out, x: float, z: float, preset: float, warned: bool
) -> None:
    prompt = clock().known()
    prompt.type(f"site {SITE}")
    prompt.type("preset b")
    capsys.readouterr()
    prompt.module.idle_task()
    assert capsys.readouterr().out == ""  # not confirmed yet
    prompt.receive(value_of("TGL_PRESET", 2.0), value_of("TGL_X", x), value_of("TGL_Z", z))
    prompt.now_s += 0.1
    prompt.module.orders.step(prompt.now_s)
    prompt.receive(value_of("TGL_PRESET", preset))
    prompt.module.idle_task()
    output = capsys.readouterr().out
    assert "tgl: line b: confirmed\n" in output
    assert ("WARNING" in output) == warned
    if warned:
        assert f"the module's line is x {x:.2f} m, z {z:.2f} m, and not b of this site" in output
        assert "x 0.60 m, z 1.60 m: the module was started with another one" in output
    prompt.module.idle_task()
    assert capsys.readouterr().out == ""


def test_a_refused_preset_is_compared_with_nothing(clock: Made, capsys: Out) -> None:
    prompt = clock().known(TGL_PRESET=1.0)
    prompt.type(f"site {SITE}")
    prompt.type("preset b")
    prompt.receive(mavlink.MAVLink_param_error_message(255, 190, b"TGL_PRESET", -1, 3))
    prompt.module.idle_task()
    output = capsys.readouterr().out
    assert "line b: refused by the module" in output
    assert "WARNING" not in output


def test_the_command_goes_with_the_module(clock: Made) -> None:
    prompt = clock()
    assert "tgl" in prompt.commands
    prompt.module.unload()
    assert "tgl" not in prompt.commands
    assert isinstance(prompt.module, TglModule)
    # The messages of other vehicles come too: the module's system may be another than the pilot's.
    assert prompt.module.multi_vehicle
    assert prompt.public == {"tgl": prompt.module}


# --- what is shown -----------------------------------------------------------------------------


@pytest.mark.parametrize(("at_s", "words"), [
    (None, "SILENT: component 191 of system 0: was not received yet"),
    (103.0, None), (103.1, "SILENT: component 191 of system 1: 3 s ago"),
    (142.4, "SILENT: component 191 of system 1: 42 s ago"),
])  # fmt: skip
def test_a_module_that_is_silent_is_reported_first(
    clock: Made, capsys: Out, at_s: float | None, words: str | None
) -> None:
    prompt = clock()
    if at_s is not None:
        prompt.receive(beat())
        prompt.now_s = at_s
    prompt.type("status")
    first = capsys.readouterr().out.splitlines()[0]
    assert first == (f"tgl: {words}" if words else "tgl: soaring: e_rho not known")


def test_the_status_in_flight() -> None:
    values = {
        "soar_mode": 4.0,
        "e_rho": 0.031,
        "line_x": 0.2,
        "line_z": 1.15,
        "line_lean": 15.0,
        "soar_x": 0.25,
        "soar_z": 1.2,
        "airspeed": 8.5,
        "updraft": 0.75,
        "excess": -0.1,
        "entry": 2.0,  # what engaging lacks is no matter now
        "faults": 5.0,
    }
    assert status_lines(values, GhostLine(0.2, 1.15, 15.0)) == [
        "soaring: e_rho 0.03 m",
        "line set    x 0.20 m, z 1.15 m, lean 15.0 deg",
        "line flown  x 0.20 m, z 1.15 m, lean 15.00 deg",
        "aircraft    x 0.25 m, z 1.20 m",
        "air         airspeed 8.50 m/s, updraft 0.75 m/s, excess -0.10 m/s",
        f"faults: {FAULT_TEXTS[0]}, {FAULT_TEXTS[2]}",
    ]


def test_what_is_not_known_is_reported_as_such() -> None:
    unknown = "not known"
    assert status_lines({"e_rho": nan, "faults": nan}, None) == [
        f"mode not known: e_rho {unknown}",
        f"line flown  x {unknown}, z {unknown}, lean {unknown}",
        f"aircraft    x {unknown}, z {unknown}",
        f"air         airspeed {unknown}, updraft {unknown}, excess {unknown}",
    ]


@pytest.mark.parametrize(("number", "name"), [
    (-1.0, "mode not known"), (0.0, "boot"), (13.0, "beating"), (14.0, "mode not known"),
    (nan, "mode not known"),
])  # fmt: skip
def test_every_mode_has_its_name(number: float, name: str) -> None:
    assert status_lines({"soar_mode": number}, None)[0].startswith(f"{name}:")
    assert len(MODE_NAMES) == 14


@pytest.mark.parametrize(("entry", "words"), [
    (None, ["engaging lacks: not known"]), (0.0, ["engaging lacks: nothing"]),
    (-2.0, ["engaging lacks: nothing"]), (nan, ["engaging lacks: nothing"]),
    (2.0, ["engaging lacks: nothing"]),  # what the supervisor does not ask for at the entry
    (4.0, [f"engaging lacks: {CONDITION_TEXTS[2]}"]),
    (1.0, ["engaging lacks: nothing",
           "held back (abort, switch, line or set-up; tgl engage says which)"]),
    (float(4 + 16), [f"engaging lacks: {CONDITION_TEXTS[2]}, {CONDITION_TEXTS[4]}"]),
])  # fmt: skip
def test_on_the_ground_it_is_reported_what_engaging_lacks(
    entry: float | None, words: list[str]
) -> None:
    for mode in (0.0, 2.0, 8.0):
        values = {"soar_mode": mode} | ({} if entry is None else {"entry": entry})
        lines = status_lines(values, None)
        assert [each for each in lines if each.startswith(("engaging", "held"))] == words

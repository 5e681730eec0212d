"""Orders step by step on a station that a test answers for: what is sent when, and the reports."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tgl_soar.cli.page.orders import ABORT, ENGAGE, RELEASE, RESULTS, WAITING, Done, Orders
from tgl_soar.cli.page.settling_preview import GhostLine
from tgl_soar.cli.page.station import StationAnswer
from tgl_soar.config.line_changes import DROPPED, Answer, LineChanges
from tgl_soar.config.parameters import ParameterError, ParameterSet

LINE = {"TGL_X": 0.25, "TGL_Z": 1.25, "TGL_LEAN": 15.0}
THERE = GhostLine(0.5, 1.5, 15.0)


class NotedStation:
    """A station that notes what is sent, and whose module follows the test's script."""

    def __init__(self, **parameters: float) -> None:
        self.parameters: dict[str, float] = {**LINE, "TGL_STAGE": 0.0, **parameters}
        self.on_answer: Callable[[StationAnswer], None] = lambda _answer: None
        self.sets: list[tuple[str, float]] = []
        self.commands: list[tuple[int, int]] = []
        self.done: list[Done] = []
        self.orders = Orders(self, self.done.append)

    def set(self, name: str, value: float) -> None:
        self.sets.append((name, value))

    def command(self, number: int, confirmation: int) -> None:
        self.commands.append((number, confirmation))

    def echo(self, name: str, value: float) -> None:
        self.parameters[name] = value
        self.on_answer(StationAnswer(kind="value", name=name, value=value))

    def refuse(self, name: str) -> None:
        self.on_answer(StationAnswer(kind="error", name=name))

    def acknowledge(self, command: int, result: int) -> None:
        self.on_answer(StationAnswer(kind="ack", command=command, result=result))

    def taken(self) -> list[tuple[str, float]]:
        found, self.sets = self.sets, []
        return found

    @property
    def words(self) -> list[tuple[bool, str]]:
        return [(done.ok, done.text) for done in self.done]


# --- one parameter -----------------------------------------------------------------------------


def test_a_parameter_is_set_again_every_half_second_until_its_echo() -> None:
    station = NotedStation(RHO_P=0.5)
    station.orders.set("Anna", "RHO_P", 0.75)
    assert station.orders.is_busy
    times = []
    for tick in range(21):
        station.orders.step(100.0 + 0.05 * tick)
        times += [round(0.05 * tick, 2)] * len(station.taken())
    assert times == [0.0, 0.5, 1.0]
    station.echo("RHO_P", 0.75)
    station.orders.step(101.05)
    assert station.words == [(True, "RHO_P = 0.75: confirmed")]
    assert station.done[0].who == "Anna"
    assert not station.orders.is_busy
    assert station.taken() == []


def test_a_value_that_stands_already_is_sent_once_and_confirmed() -> None:
    station = NotedStation(RHO_P=0.75)
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.step(100.0)
    assert station.taken() == [("RHO_P", 0.75)]
    assert station.done == []
    station.orders.step(100.05)
    assert station.words == [(True, "RHO_P = 0.75: confirmed")]


def test_a_set_that_nobody_answers_is_given_up_after_five_seconds() -> None:
    station = NotedStation()
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.step(100.0)
    station.orders.step(105.0)
    assert station.done == []
    station.orders.step(105.01)
    assert station.words == [(False, "RHO_P = 0.75: not confirmed: the module does not answer")]


def test_a_value_as_it_goes_over_the_wire_is_what_is_waited_for() -> None:
    """0.1 is no number of single precision: the echo differs in its ninth digit."""
    station = NotedStation()
    station.orders.set("Anna", "RHO_P", 0.1)
    station.orders.step(100.0)
    ((_, value),) = station.taken()
    assert value == 0.100000001490116119384765625
    station.echo("RHO_P", value)
    station.orders.step(100.05)
    assert station.words[0][0]


def test_another_value_that_stands_for_over_six_tenths_of_a_second_is_a_refusal() -> None:
    station = NotedStation(RHO_P=0.5)
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.step(100.0)
    station.echo("RHO_P", 0.5)
    station.orders.step(100.6)
    assert station.done == []
    station.orders.step(100.61)
    assert station.words == [(False, "RHO_P = 0.75: refused: RHO_P stays 0.5")]


def test_a_late_echo_of_the_value_is_no_refusal() -> None:
    station = NotedStation(RHO_P=0.5)
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.step(100.0)
    station.echo("RHO_P", 0.5)
    station.echo("RHO_P", 0.75)
    station.orders.step(100.7)
    assert station.words == [(True, "RHO_P = 0.75: confirmed")]


def test_an_answer_before_anything_was_sent_or_of_another_name_says_nothing() -> None:
    station = NotedStation(RHO_P=0.5)
    station.refuse("RHO_P")  # nothing waits
    station.orders.set("Anna", "RHO_P", 0.75)
    station.refuse("RHO_P")  # not sent yet
    station.echo("RHO_P", 0.5)
    station.orders.step(100.0)
    station.refuse("RHO_D")
    station.orders.step(101.0)
    assert station.done == []
    station.refuse("RHO_P")
    assert station.words == [
        (False, "RHO_P = 0.75: refused by the module; its words are in the list of messages")
    ]


def test_one_change_after_the_other_and_32_wait_at_most() -> None:
    station = NotedStation()
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.set("Anna", "RHO_D", 0.25)
    station.orders.step(100.0)
    assert station.taken() == [("RHO_P", 0.75)]
    station.echo("RHO_P", 0.75)
    station.orders.step(100.05)
    station.orders.step(100.1)
    assert station.taken() == [("RHO_D", 0.25)]
    for _ in range(40):
        station.orders.set("Anna", "RHO_P", 0.5)
    refused = [text for ok, text in station.words if not ok]
    assert refused == ["RHO_P = 0.5: too much is waiting already"] * (40 - 31)
    assert WAITING == 32


# --- a line ------------------------------------------------------------------------------------


def test_the_line_is_known_with_all_its_numbers() -> None:
    station = NotedStation()
    assert station.orders.line() == (0.25, 1.25, 15.0)
    del station.parameters["TGL_LEAN"]
    assert station.orders.line() is None
    station.orders.move("Anna", THERE)
    assert station.words == [(False, "the module's parameters are not known yet: wait")]
    assert not station.orders.is_busy


def test_a_move_to_where_the_line_stands_is_nothing() -> None:
    station = NotedStation()
    station.orders.move("Anna", GhostLine(*LINE.values()))
    assert not station.orders.is_busy
    assert station.orders.undo_count == 0


def test_two_numbers_are_staged_and_moved_as_one() -> None:
    station = NotedStation()
    station.orders.move("Anna", THERE)
    station.orders.step(100.0)
    assert station.taken() == [("TGL_STAGE", 1.0)]
    station.echo("TGL_STAGE", 1.0)
    station.orders.step(100.05)
    assert sorted(station.taken()) == [("TGL_X", 0.5), ("TGL_Z", 1.5)]  # the lean stands already
    station.echo("TGL_X", 0.5)
    station.orders.step(100.1)
    assert station.taken() == []
    station.orders.step(100.56)
    assert station.taken() == [("TGL_Z", 1.5)]  # what was echoed is not sent again
    station.echo("TGL_Z", 1.5)
    station.orders.step(100.6)
    assert station.taken() == [("TGL_STAGE", 0.0)]
    station.echo("TGL_STAGE", 0.0)
    station.orders.step(100.65)
    assert station.words == [(True, "line to x 0.50 m, z 1.50 m, lean 15.0°: confirmed")]
    assert station.orders.undo_count == 1


def test_each_step_of_a_move_has_its_own_time() -> None:
    station = NotedStation()
    station.orders.move("Anna", THERE)
    station.orders.step(100.0)
    station.echo("TGL_STAGE", 1.0)
    station.orders.step(104.0)
    station.taken()
    station.orders.step(104.4)
    assert station.taken() == []
    station.orders.step(104.5)
    assert len(station.taken()) == 2


@pytest.mark.parametrize(("stage", "steps"), [(0.0, ["TGL_X"]), (2.0, ["TGL_STAGE"]),
                                              (1.0, ["TGL_STAGE"])])  # fmt: skip
def test_one_number_is_set_by_itself_unless_the_module_stages(
    stage: float, steps: list[str]
) -> None:
    station = NotedStation(TGL_STAGE=stage)
    station.orders.move("Anna", GhostLine(0.5, 1.25, 15.0))
    station.orders.step(100.0)
    assert [name for name, _ in station.taken()] == steps


class Module(NotedStation):
    """A station whose module answers at once, by the module's own code."""

    def __init__(self) -> None:
        super().__init__()
        self.changes = LineChanges()
        self.take(Answer(ParameterSet(), (*LINE, "TGL_STAGE", "TGL_PLACE")))

    def take(self, answer: Answer) -> None:
        self.values = answer.values
        for name in answer.reported:
            self.echo(name, self.changes.shown(self.values, name))

    def set(self, name: str, value: float) -> None:
        try:
            self.take(self.changes.set(self.values, name, value, flying=True))
        except ParameterError:
            self.refuse(name)


def test_after_a_staged_move_that_was_left_one_number_is_moved_all_the_same() -> None:
    module = Module()
    module.set("TGL_STAGE", 1.0)
    module.take(module.changes.leave(module.values))
    assert module.parameters["TGL_STAGE"] == DROPPED
    line = module.orders.line()
    assert line is not None
    module.orders.move("Anna", line._replace(z_m=line.z_m + 0.125))
    for tick in range(10):
        module.orders.step(100.0 + 0.1 * tick)
    assert [done.ok for done in module.done] == [True]
    assert module.values["TGL_Z"] == line.z_m + 0.125
    assert module.values["TGL_STAGE"] == 0.0


def test_a_refused_move_takes_back_what_undo_would_have_and_what_is_staged() -> None:
    station = NotedStation()
    station.orders.move("Anna", THERE)
    station.orders.step(100.0)
    station.echo("TGL_STAGE", 1.0)
    station.orders.step(100.05)
    station.taken()
    assert station.orders.undo_count == 1
    station.refuse("TGL_Z")
    assert station.taken() == [("TGL_STAGE", DROPPED)]
    assert station.orders.undo_count == 0
    assert not station.words[-1][0]


def test_a_refused_parameter_takes_no_undo_away_and_drops_nothing() -> None:
    station = NotedStation(RHO_P=0.5)
    station.orders.preset("Anna", 1, "a")
    station.orders.step(100.0)
    station.echo("TGL_PRESET", 1.0)
    station.orders.step(100.05)
    assert station.orders.undo_count == 1
    station.parameters["TGL_STAGE"] = 1.0  # another station's
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.step(100.1)
    station.taken()
    station.refuse("RHO_P")
    assert station.orders.undo_count == 1
    assert station.taken() == []


def test_a_line_that_waits_gives_way_to_a_newer_one_and_others_do_not() -> None:
    station = NotedStation()
    station.orders.move("Anna", THERE)
    station.orders.step(100.0)  # under way
    station.orders.set("Anna", "RHO_P", 0.75)
    station.orders.move("Anna", GhostLine(0.75, 1.5, 15.0))
    station.orders.move("Anna", GhostLine(1.0, 1.75, 15.0))
    waiting = [(change.words, change.is_line) for change in station.orders._waiting]
    assert waiting == [
        ("line to x 0.50 m, z 1.50 m, lean 15.0°", True),
        ("RHO_P = 0.75", False),
        ("line to x 1.00 m, z 1.75 m, lean 15.0°", True),
    ]


def test_a_preset_is_a_parameter_and_can_be_taken_back() -> None:
    station = NotedStation()
    station.orders.preset("Anna", 2, "b")
    station.orders.step(100.0)
    assert station.taken() == [("TGL_PRESET", 2.0)]
    station.echo("TGL_PRESET", 2.0)
    station.parameters.update(TGL_X=0.5, TGL_Z=1.5)
    station.orders.step(100.05)
    assert station.words == [(True, "line b: confirmed")]
    assert station.orders.undo_count == 1
    station.orders.undo("Anna")
    assert station.orders.undo_count == 0  # and the way back is no move to take back
    station.orders.step(100.1)
    station.echo("TGL_STAGE", 1.0)
    station.orders.step(100.15)
    assert sorted(station.taken())[-2:] == [("TGL_X", 0.25), ("TGL_Z", 1.25)]


@pytest.mark.parametrize("name", ["TGL_X", "TGL_Z", "TGL_LEAN", "TGL_PLACE", "TGL_PRESET"])
def test_a_parameter_that_moves_the_line_can_be_taken_back(name: str) -> None:
    station = NotedStation(TGL_PLACE=-1.0, TGL_PRESET=0.0)
    station.orders.set("Anna", name, station.parameters[name])  # moves nothing
    station.orders.step(100.0)
    station.orders.step(100.05)
    assert station.orders.undo_count == 0
    station.orders.set("Anna", name, 2.0)
    station.orders.step(100.1)
    station.echo(name, 2.0)
    station.parameters.update(TGL_X=2.0, TGL_Z=2.0)
    station.orders.step(100.15)
    assert station.words[-1] == (True, f"{name} = 2: confirmed")
    assert station.orders.undo_count == 1
    assert station.orders._undo[0] == tuple(LINE.values())
    station.orders.set("Anna", name, 3.0)
    station.orders.step(100.2)
    station.refuse(name)
    assert station.orders.undo_count == 1


def test_there_is_an_undo_for_each_place_of_the_line_and_fifty_at_most() -> None:
    station = NotedStation()
    station.orders.undo("Anna")
    assert station.words == [(False, "nothing to undo")]
    station.orders.preset("Anna", 1, "a")
    station.orders.preset("Anna", 2, "b")  # the line stands where it stood
    assert station.orders.undo_count == 1
    for i in range(60):
        station.parameters["TGL_X"] = float(i)
        station.orders.preset("Anna", 1, "a")
    assert station.orders.undo_count == 50
    assert station.orders._undo[-1].x_m == 59.0
    assert station.orders._undo[0].x_m == 10.0


# --- commands ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("result", "ok", "words"), [
    (0, True, "done"), (1, False, "refused for now"),
    (2, False, "denied: this station is none of the module's operators"),
    (3, False, "the module does not know this command"),
    (4, False, "the module disengaged before the line was reached"),
    (6, False, "disengaged before the line was reached"), (9, False, "result 9"),
])  # fmt: skip
def test_each_result_of_a_command_is_reported_in_words_and_ends_it(
    result: int, ok: bool, words: str
) -> None:
    station = NotedStation()
    station.orders.command("Anna", ENGAGE)
    station.orders.step(100.0)
    station.acknowledge(ENGAGE, result)
    assert station.words == [(ok, f"engage: {words}")]
    assert station.done[0].who == "Anna"
    station.acknowledge(ENGAGE, result)  # the repeated one's
    station.orders.step(101.0)
    assert len(station.done) == 1
    assert station.commands == [(ENGAGE, 0)]
    assert len(RESULTS) == 7


def test_an_engagement_in_progress_is_reported_once_and_waited_for_as_long_as_it_takes() -> None:
    station = NotedStation()
    station.orders.command("Anna", ENGAGE)
    station.orders.step(100.0)
    station.acknowledge(ENGAGE, 5)
    station.acknowledge(ENGAGE, 5)
    station.orders.step(160.0)
    assert station.words == [(True, "engage: engaging")]
    assert station.commands == [(ENGAGE, 0)]
    station.acknowledge(ENGAGE, 0)
    assert station.words[-1] == (True, "engage: done")


def test_a_command_is_given_up_after_five_seconds_and_not_before() -> None:
    station = NotedStation()
    station.orders.command("Anna", RELEASE)
    station.orders.step(100.0)
    station.orders.step(105.0)
    assert station.done == []
    station.orders.step(105.01)
    assert station.words == [(False, "release: the module does not answer")]
    station.orders.step(106.0)
    assert len(station.done) == 1


def test_an_answer_to_a_command_that_nobody_gave_is_none() -> None:
    station = NotedStation()
    station.acknowledge(ABORT, 0)
    assert station.done == []


@pytest.mark.parametrize("number", [ABORT, RELEASE])
def test_a_release_drops_what_waits_and_what_is_staged_once_it_is_staged(number: int) -> None:
    station = NotedStation()
    station.orders.move("Anna", THERE)
    station.orders.command("Anna", number)  # before anything of it was sent
    assert not station.orders.is_busy
    station.orders.move("Anna", THERE)
    station.orders.step(100.0)
    station.taken()
    station.orders.command("Anna", number)
    station.orders.step(100.05)
    assert station.taken() == [("TGL_STAGE", 2.0)]
    station.echo("TGL_STAGE", 2.0)
    station.orders.step(100.1)
    assert station.words[-1] == (True, "the staged move's end: confirmed")


def test_a_release_after_one_number_that_is_not_staged_stages_nothing() -> None:
    station = NotedStation()
    station.orders.move("Anna", GhostLine(0.5, 1.25, 15.0))
    station.orders.step(100.0)
    station.orders.command("Anna", RELEASE)
    assert not station.orders.is_busy


def test_an_engagement_leaves_what_waits() -> None:
    station = NotedStation()
    station.orders.move("Anna", THERE)
    station.orders.command("Anna", ENGAGE)
    assert station.orders.is_busy


def test_the_commands_are_mavlinks_three_for_users() -> None:
    assert (ENGAGE, RELEASE, ABORT) == (31010, 31011, 31012)

"""How the loop sleeps and for how long it stays awake, on a clock of our own."""

from __future__ import annotations

import select
from collections.abc import Callable
from random import Random
from typing import Any

import pytest
from module_process import arguments

from tgl_soar.onboard.pacing import AWAKE_MAX_S, Pacer, Waiter
from tgl_soar.onboard.process import main


def test_a_deadline_that_is_past_costs_no_sleep() -> None:
    assert Waiter(lambda: 7.0).wait([], 5.0, 5.0) == (7.0, [])


def test_what_is_left_is_computed_last() -> None:
    """Work since the last look at the clock must not be slept on top."""
    times = iter((100.0, 200.0))
    assert Waiter(lambda: next(times)).wait([], 99.0) == (200.0, [])


class Computer:
    """Whose sleeps end late, as long as its processor takes to wake."""

    LOOK_S = 3e-6

    def __init__(self, late_s: Callable[[], float]) -> None:
        self.now_s, self.asleep_s = 0.0, 0.0
        self._late_s = late_s

    def clock(self) -> float:
        return self.now_s

    def select(self, *given: Any) -> tuple[list[int], list[int], list[int]]:
        timeout_s = given[-1]
        self.asleep_s += timeout_s
        self.now_s += timeout_s + self._late_s() if timeout_s > 0.0 else self.LOOK_S
        return [], [], []


def test_it_wakes_as_much_earlier_as_it_wakes_late(monkeypatch: pytest.MonkeyPatch) -> None:
    random = Random(1)
    computer = Computer(lambda: random.uniform(40e-6, 90e-6))
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock)
    due_s = [0.005 * i for i in range(1, 1001)]
    late_s = sorted([waiter.wait([], due, due)[0] - due for due in due_s][100:])
    assert late_s[0] >= 0.0
    assert late_s[800] <= 2 * computer.LOOK_S  # nearly all are on time
    assert late_s[-1] <= 20e-6
    assert 75e-6 <= waiter.awake_s <= 90e-6
    assert computer.asleep_s >= 0.97 * computer.now_s


def test_however_late_it_does_not_stay_awake_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(lambda: 0.004)
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock)
    for _ in range(100):
        until_s = computer.now_s + 0.005
        waiter.wait([], until_s, until_s)
    assert waiter.awake_s <= AWAKE_MAX_S


def test_what_does_not_come_is_not_waited_for_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample that fails to come has its tick half a period later."""
    computer = Computer(lambda: 0.0)
    monkeypatch.setattr(select, "select", computer.select)
    now_s, ready = Waiter(computer.clock, 100e-6).wait([], 0.0075, 0.005)
    assert now_s == pytest.approx(0.0075)
    assert not ready
    assert computer.asleep_s == pytest.approx(0.0073, abs=10e-6)


def test_where_nothing_comes_any_more_it_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(lambda: 0.0)
    monkeypatch.setattr(select, "select", computer.select)
    waiter, asleep_s = Waiter(computer.clock, 200e-6), []
    for i in range(6):
        before_s = computer.asleep_s
        waiter.wait([], 0.01 * i + 0.0075, 0.01 * i + 0.005)
        computer.now_s = 0.01 * (i + 1)
        asleep_s.append(computer.asleep_s - before_s)
    assert asleep_s[1] == pytest.approx(0.0071, abs=10e-6)
    assert asleep_s[5] == pytest.approx(0.0073, abs=10e-6)  # awake before, not after


def test_given_how_long_it_stays_awake_no_longer_however_often_something_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    computer = Computer(lambda: 0.0)
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock, 0.002)
    for until_s in (0.0015, 0.0025, 0.003, 0.005):  # each but the last ends with something else
        waiter.wait([], until_s, 0.005)
    assert computer.asleep_s == pytest.approx(0.003, abs=20e-6)


def test_given_no_time_it_never_stays_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(lambda: 50e-6)
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock, 0.0)
    for i in range(1, 101):
        assert waiter.wait([], 0.005 * i, 0.005 * i)[0] == pytest.approx(0.005 * i + 50e-6)


def test_a_locked_loop_is_awake_for_its_sample_and_not_for_the_grace_after_it() -> None:
    pacer = Pacer(200.0, 0.0)
    for i in range(60):
        now_s = 0.005 * i
        pacer.sample(now_s, now_s, now_s)
        if pacer.due(now_s):
            pacer.tick(now_s)
    assert pacer.locked
    assert pacer.expected_s == pytest.approx(0.005 * 60)
    assert pacer.wake_s > pacer.expected_s


def test_time_before_the_loop_begins_is_no_delay_and_a_long_tick_is_counted() -> None:
    pacer = Pacer(200.0, 0.0)
    pacer.begin(3.0)
    assert not pacer.due(3.004)
    pacer.tick(3.005)
    pacer.done(3.005, 3.009)
    assert pacer.counters.skipped == pacer.counters.late == pacer.counters.over_run == 0
    pacer.tick(3.010)
    pacer.done(3.010, 3.0151)
    assert pacer.counters.over_run == 1


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--cpu", "4000", "4000: must be a processor of this computer: "),
        ("--cpu", "first", "first: must be a processor of this computer: "),
        ("--spin", "2001", "2001: must be 0 to 2000 microseconds"),
        ("--spin", "nan", "nan: must be 0 to 2000 microseconds"),
        ("--spin", "a bit", "a bit: must be 0 to 2000 microseconds"),
    ],
)
def test_what_cannot_be_asked_for_is_reported(
    option: str, value: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*arguments("udp:127.0.0.1:1"), option, value])
    assert words in capsys.readouterr().err

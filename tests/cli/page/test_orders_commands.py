"""Commands, frame by frame: when they are sent again, and when never any more."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tgl_soar.cli.page.orders import (
    ABORT,
    ENGAGE,
    GIVE_UP_S,
    RELEASE,
    RETRY_S,
    WORDS,
    Done,
    Orders,
)
from tgl_soar.cli.page.station import StationAnswer
from tgl_soar.link.messages import RESULT_ACCEPTED


class Silent:
    """A station on a link over which nothing comes back."""

    def __init__(self) -> None:
        self.parameters: dict[str, float] = {}
        self.on_answer: Callable[[StationAnswer], None] = lambda _answer: None
        self.sent: list[tuple[int, int]] = []  # commands, with their confirmations

    def set(self, name: str, value: float) -> None:
        raise AssertionError(f"{name} {value} was not asked for")

    def command(self, number: int, confirmation: int) -> None:
        self.sent.append((number, confirmation))


def carried_on(orders: Orders, from_s: float, until_s: float) -> None:
    for tick in range(round(20 * from_s), round(20 * until_s)):
        orders.step(0.05 * tick)


def test_a_command_is_sent_again_until_it_is_answered_or_given_up() -> None:
    station, done = Silent(), list[Done]()
    orders = Orders(station, done.append)
    orders.command("me", ENGAGE)
    carried_on(orders, 0.0, 2.0 * RETRY_S + 0.1)
    assert station.sent == [(ENGAGE, 0), (ENGAGE, 1), (ENGAGE, 2)]
    carried_on(orders, 2.0 * RETRY_S + 0.1, GIVE_UP_S + 2.0)
    assert [each.text for each in done] == ["engage: the module does not answer"]
    assert len(station.sent) == round(GIVE_UP_S / RETRY_S) + 1


@pytest.mark.parametrize("number", [ABORT, RELEASE])
def test_an_engagement_that_was_not_answered_is_not_asked_for_after_its_end(number: int) -> None:
    """The module takes a release for the end of an abort: the next engagement would be one
    that is not wanted any more."""
    station, done = Silent(), list[Done]()
    orders = Orders(station, done.append)
    orders.command("me", ENGAGE)
    carried_on(orders, 0.0, 1.0)
    orders.command("me", number)
    before = len(station.sent)
    carried_on(orders, 1.0, 1.2)
    station.on_answer(StationAnswer(kind="ack", command=number, result=RESULT_ACCEPTED))
    carried_on(orders, 1.2, GIVE_UP_S + 5.0)
    assert {command for command, _ in station.sent[before:]} == {number}
    assert [each.text for each in done] == [f"{WORDS[number]}: done"]

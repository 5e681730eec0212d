"""Texts in chunks, the budget's arithmetic, and the grid of each flow."""

from __future__ import annotations

from math import inf
from typing import Any

import pytest

from tgl_soar.link.messages import ID_HEARTBEAT, NamedValueFloat
from tgl_soar.link.telemetry import Budget, Flow, StatusTexts, Telemetry


@pytest.mark.parametrize(
    ("length", "chunks"),
    [
        (50, [50]),
        (51, [50, 1]),
        (100, [50, 50, 0]),  # a full chunk does not say that it is the last
        (120, [50, 50, 20]),
        (249, [50, 50, 50, 50, 49]),
        (250, [50] * 5),
        (700, [50] * 5),
    ],
)
def test_a_text_is_cut_into_chunks_of_fifty_and_five_at_the_most(
    length: int, chunks: list[int]
) -> None:
    text = "".join(chr(97 + i % 26) for i in range(length))
    found = StatusTexts().chunks(4, text)
    assert [len(each.text) for each in found] == chunks
    assert "".join(each.text for each in found) == text[:250]
    assert {each.severity for each in found} == {4}
    assert [each.chunk_seq for each in found] == list(range(len(chunks)))
    assert {each.id for each in found} == {0 if length <= 50 else 1}


def test_each_long_text_has_its_own_number_and_never_zero() -> None:
    texts = StatusTexts()
    numbers = [texts.chunks(4, "x" * 60)[0].id for _ in range(0x10000)]
    assert numbers[:3] == [1, 2, 3]
    assert numbers[-2:] == [0xFFFF, 1]


def test_a_budget_saves_up_a_fifth_of_a_second_and_owes_a_second_at_the_most() -> None:
    budget = Budget()
    assert not budget.fill(10.0, 1000.0)  # nothing is saved up before the first time
    assert budget.fill(10.001, 1000.0)
    assert budget.fill(20.0, 1000.0)  # 200 bytes, however long that was
    budget.spend(199, 1000.0)
    assert budget.fill(20.0, 1000.0)
    budget.spend(1, 1000.0)
    assert not budget.fill(20.0, 1000.0)
    for _ in range(10):
        budget.spend(400, 1000.0)
    assert not budget.fill(20.999, 1000.0)
    assert budget.fill(21.001, 1000.0)
    assert budget.spent_bytes == 200 + 4000
    # One frame that is larger than that is paid for in whole.
    slow = Budget()
    slow.fill(0.0, 100.0)
    slow.spend(280, 100.0)
    assert not slow.fill(2.79, 100.0)
    assert slow.fill(2.81, 100.0)
    # A clock that was changed owes nothing and has nothing.
    slow.rebase()
    assert not slow.fill(0.0, 100.0)
    assert slow.fill(0.001, 100.0)


def flow(items: int, interval_s: float, number: int = 251) -> Flow:
    return Flow(number, items, interval_s, lambda turn: NamedValueFloat(0, str(turn), 0.0))


def name(message: Any) -> str:
    return str(message.name)


def test_turns_follow_each_other_on_a_grid_and_a_long_pause_is_not_made_up_for() -> None:
    found = flow(4, 0.4)
    assert found.lateness(10.0) == 1e9  # at first it is as late as can be
    assert name(found.take(10.0)) == "0"
    assert found.lateness(10.09) == -1.0
    assert found.lateness(10.15) == pytest.approx(0.5)  # of its own 0.1 s
    assert name(found.take(10.15)) == "1"
    assert found.lateness(10.2) == pytest.approx(0.0, abs=1e-6)  # on the grid, not 0.1 s later
    assert name(found.take(10.59)) == "2"  # behind by less than four: the grid goes on
    assert found.lateness(10.59) == pytest.approx(2.9)
    assert name(found.take(10.81)) == "3"  # by more: it begins again
    assert found.lateness(10.9) == -1.0
    assert found.lateness(10.92) == pytest.approx(0.1)
    assert name(found.take(10.92)) == "0"
    found.take(11.1)
    found.rebase()
    assert name(found.take(3.0)) == "0"
    assert flow(1, inf).lateness(10.0) == -1.0


def test_who_is_most_behind_its_own_rate_goes_first() -> None:
    slow, fast = flow(1, 1.0, 1), flow(1, 0.1, 2)
    telemetry = Telemetry((slow, fast))
    telemetry.due(0.0, 1e6)
    for _ in range(2):
        telemetry.due(0.001, 1e6)
    assert telemetry.due(0.05, 1e6) is None
    assert telemetry.due(0.12, 1e6) is not None
    assert fast.lateness(0.12) == -1.0
    assert slow.lateness(0.12) == -1.0


def test_an_interval_may_be_set_from_fifty_hertz_down_or_to_never() -> None:
    fast, slow = flow(8, 0.2), flow(20, 1.0)
    telemetry = Telemetry((fast, slow, flow(1, inf, 99)))
    assert telemetry.interval_us(251) == 200_000
    assert telemetry.interval_us(99) == -1
    assert telemetry.interval_us(ID_HEARTBEAT) == 1_000_000
    assert telemetry.interval_us(7) == 0
    assert telemetry.set_interval(251, 20_000.0)
    assert fast.interval_s == pytest.approx(0.02)
    assert slow.interval_s == pytest.approx(0.1)
    for refused in (19_999.0, 1.0, -2.0):
        assert not telemetry.set_interval(251, refused)
    assert not telemetry.set_interval(7, 20_000.0)
    assert fast.interval_s == pytest.approx(0.02)
    assert telemetry.set_interval(251, -1.0)
    assert telemetry.interval_us(251) == -1
    assert telemetry.set_interval(251, 0.0)
    assert (fast.interval_s, slow.interval_s) == (0.2, 1.0)
    assert telemetry.set_interval(251, 1e12)
    assert telemetry.interval_us(251) == 2**31 - 1  # what the message can hold
    assert telemetry.once(7) is None
    assert name(telemetry.once(251)) == "0"

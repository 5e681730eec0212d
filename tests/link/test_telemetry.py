"""Numbers within a budget of bytes."""

from __future__ import annotations

import pytest

from tgl_soar.link.messages import NamedValueFloat
from tgl_soar.link.telemetry import BURST_S, Flow, Telemetry

TICK_S = 0.005
FRAME = 27  # bytes


def flow(name: str, items: int, interval_s: float, number: int = 251) -> Flow:
    return Flow(number, items, interval_s, lambda turn: NamedValueFloat(0, f"{name}{turn}", 0.0))


def sent(telemetry: Telemetry, seconds: float, bytes_per_s: float) -> dict[str, int]:
    counts: dict[str, int] = {}
    for i in range(round(seconds / TICK_S)):
        message = telemetry.due(i * TICK_S, bytes_per_s)
        if isinstance(message, NamedValueFloat):
            telemetry.budget.spend(FRAME, bytes_per_s)
            counts[message.name] = counts.get(message.name, 0) + 1
    return counts


def test_each_flow_has_its_rate_where_the_budget_allows() -> None:
    counts = sent(Telemetry((flow("a", 3, 0.2), flow("b", 2, 1.0))), 10.0, 5000.0)
    assert all(counts[f"a{i}"] == pytest.approx(50, abs=1) for i in range(3))
    assert all(counts[f"b{i}"] == pytest.approx(10, abs=1) for i in range(2))


@pytest.mark.parametrize("bytes_per_s", [100.0, 300.0, 1000.0])
def test_the_budget_is_kept_and_shared_in_proportion(bytes_per_s: float) -> None:
    telemetry = Telemetry((flow("a", 8, 0.02), flow("b", 4, 0.1)))
    counts = sent(telemetry, 60.0, bytes_per_s)
    spent = FRAME * sum(counts.values())
    assert spent <= bytes_per_s * (60.0 + BURST_S) + FRAME
    assert spent >= 0.95 * bytes_per_s * 60.0
    assert len(counts) == 12  # none starves
    a = sum(n for name, n in counts.items() if name[0] == "a")
    b = sum(n for name, n in counts.items() if name[0] == "b")
    assert a > b


def test_words_are_paid_for_by_the_numbers() -> None:
    telemetry = Telemetry((flow("a", 1, 0.02),))
    telemetry.due(0.0, 1000.0)
    telemetry.budget.spend(500, 1000.0)
    assert telemetry.due(0.4, 1000.0) is None
    assert telemetry.due(0.6, 1000.0) is not None


def test_a_pause_is_not_caught_up_with() -> None:
    telemetry = Telemetry((flow("a", 1, 0.2),))
    sent(telemetry, 1.0, 5000.0)
    late = [telemetry.due(100.0 + i * TICK_S, 5000.0) for i in range(200)]
    assert sum(message is not None for message in late) <= 6


def test_a_flow_without_a_rate_waits_to_be_asked() -> None:
    telemetry = Telemetry((flow("quiet", 1, float("inf"), 62),))
    assert sent(telemetry, 2.0, 5000.0) == {}
    assert telemetry.interval_us(62) == -1
    assert telemetry.once(62) is not None
    assert telemetry.set_interval(62, 100_000.0)
    assert sent(telemetry, 2.0, 5000.0) == {"quiet0": 20}
    assert telemetry.set_interval(62, 0.0)
    assert sent(telemetry, 2.0, 5000.0) == {}

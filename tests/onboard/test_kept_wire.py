"""What module, Pixhawk and operator send one another is what they sent (`kept_wire.py`)."""

from __future__ import annotations

import json
from typing import Any

import pytest
from kept_wire import FLIGHTS, KEPT, SAME

FOUND = json.loads(KEPT.read_text(encoding="utf-8"))


def differences(before: Any, now: Any, place: str = "") -> list[str]:
    """Where two of them are not the same, but for rounding."""
    if isinstance(before, dict) and isinstance(now, dict):
        names = sorted(before.keys() | now.keys())
        pairs = [(before.get(name), now.get(name), f"{place} {name}") for name in names]
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = [(a, b, f"{place} {i}") for i, (a, b) in enumerate(zip(before, now, strict=True))]
    elif isinstance(before, float) and isinstance(now, float):
        near = now == pytest.approx(before, rel=SAME, abs=1e-6)
        return [] if near else [f"{place}: {before:.7g} -> {now:.7g}"]
    else:
        return [] if before == now else [f"{place}: {before!r} -> {now!r}"]
    return [found for pair in pairs for found in differences(*pair)]


@pytest.mark.parametrize("name", FLIGHTS)
def test_what_is_sent_is_what_was_sent(name: str) -> None:
    other = differences(FOUND[name], json.loads(json.dumps(FLIGHTS[name]())))
    assert not other, "meant? python tests/onboard/kept_wire.py"


def test_all_are_kept_and_no_others() -> None:
    assert list(FOUND) == list(FLIGHTS)

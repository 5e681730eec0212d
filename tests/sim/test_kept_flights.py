"""Short flights are what they were; whoever changes them means to (`kept_flights.py`)."""

from __future__ import annotations

import json

import pytest
from kept_flights import FLIGHTS, KEPT, SAME, rounded

FOUND = json.loads(KEPT.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_is_what_it_was(name: str) -> None:
    flown, kept = rounded(FLIGHTS[name]()), FOUND[name]
    other = [
        f"{key} {kept.get(key, 0.0):.9g} -> {flown.get(key, 0.0):.9g}"
        for key in sorted(kept.keys() | flown.keys())
        if flown.get(key, 0.0) != pytest.approx(kept.get(key, 0.0), rel=SAME, abs=1e-9)
    ]
    assert not other, "meant? python tests/sim/kept_flights.py"


def test_all_are_kept_and_no_others() -> None:
    assert list(FOUND) == list(FLIGHTS)

"""What a margin shows of a loss, where that is known beforehand."""

from __future__ import annotations

from math import log
from types import SimpleNamespace
from typing import Any

import measure_margin
import numpy as np
import pytest
from measure_margin import MARGINS, Looks, flown, information, report

from tgl_soar.analysis.rare.soaring_process import SHOWN, Outlook
from tgl_soar.sim.flight import CRASHED, FLIES


def test_what_is_sorted_by_the_truth_tells_all_and_what_is_not_nothing() -> None:
    """One look in a hundred is before a loss: all of them are worth log 100 each, and what is
    then known of the others is -99 log(1 - 0.01) more."""
    lost = np.zeros(300_000)
    lost[::100] = 1.0
    everything = log(100.0) - 99.0 * log(0.99)
    # Classes by rank: one of them may have both kinds.
    assert 0.85 * everything < information(lost, 1.0 - lost) <= everything + 1e-9
    nothing = np.random.default_rng(1).standard_normal(len(lost))
    assert 0.0 < information(lost, nothing) < 0.02
    half = np.where(np.random.default_rng(2).random(len(lost)) < 0.5, 1.0 - lost, 1.0)
    assert information(lost, nothing) < information(lost, half) < information(lost, 1.0 - lost)


def test_each_margin_is_of_its_own_outlook() -> None:
    asked: list[Outlook] = []

    class Process:
        def margins(self, shown: Any, outlook: Outlook) -> Any:
            asked.append(outlook)
            return shown

    process: Any = Process()
    for name in list(MARGINS)[:-1]:
        MARGINS[name](process, np.zeros(1))
    assert asked == [
        Outlook(0.0, 0.0, 0.0, 0.0),
        Outlook(0.5, 0.0, 0.0, 0.0),
        Outlook(0.3, 0.0, 0.0, 0.0),
        Outlook(0.3, 0.14, 0.0, 0.0),
        Outlook(0.3, 0.14, 0.1, 0.9),
    ]


class Two:
    """Flights of 10 s, 20 looks a second: that of seed 1 ends at 8 s."""

    prepared = SimpleNamespace(world=SimpleNamespace(step_hz=200.0))

    def begun(self, seed: int) -> int:
        return seed

    def flown(self, _prepared: Any, state: int, seed: int) -> Any:
        assert state == seed
        steps = 1600 if seed == 1 else 2000
        shown = np.zeros((steps // 10, len(SHOWN)))
        shown[:, SHOWN.index("time_s")] = 0.05 * (1.0 + np.arange(len(shown))) - 0.005
        flight = SimpleNamespace(steps=steps, standing=CRASHED if seed == 1 else FLIES)
        return None, flight, shown


def test_looks_before_an_end_are_those_of_three_seconds_but_for_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    margins = {"time": lambda _process, shown: shown[:, 0]}
    monkeypatch.setattr(measure_margin, "MARGINS", margins)
    two: Any = Two()
    looks, ended = flown(two, [0, 1])
    assert ended == 1
    of_the_first = 160  # from 2 s on
    times = looks.margins["time"]
    assert len(times) == len(looks.lost) == of_the_first + 112  # to 0.4 s before its end
    assert not looks.lost[:of_the_first].any()
    before = times[looks.lost > 0.0]
    assert (before[0], before[-1]) == pytest.approx((5.045, 7.595))
    table = report(Looks(looks.lost, {"time": -times}))
    assert table.splitlines()[0] == "| a margin of | tells [nats] |"
    assert table.splitlines()[2].startswith("| time | ")

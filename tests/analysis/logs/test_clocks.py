"""A clock that is set back in flight: the stream that has the most samples says by how much."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tgl_soar.analysis.logs.clocks import Straightened
from tgl_soar.analysis.logs.ulog import Topics
from tgl_soar.analysis.logs.ulog_reader import FlightLog, ParameterChange, Words

SET_BACK_S = 3.0


@pytest.mark.parametrize("first", ["dense", "sparse"])
def test_streams_stay_together_where_the_clock_is_set_back(first: str) -> None:
    uneven = np.arange(0.35, 20.0, 1.0) + 0.2 * np.sin(np.arange(20.0))
    true = {"dense": np.arange(0.0, 20.0, 0.01), "sparse": uneven}
    names = sorted(true, key=lambda name: name != first)
    stamps = {n: 100.0 + true[n] - SET_BACK_S * (true[n] >= 10.0) for n in names}
    straight = Straightened(stamps)
    assert straight.start_s == pytest.approx(100.0)
    for name in names:
        assert straight.time_s[name] == pytest.approx(true[name], abs=1e-6)
        assert list(straight.rows[name]) == list(range(len(true[name])))
    (words,) = straight.lost
    assert words.startswith("the clock ran back by 3 s")


def test_what_else_the_clock_stamped_is_moved_by_the_leaps_that_are_cut_out() -> None:
    """Two leaps, of 490 s and of 90 s: a second of each is left."""
    ticks = np.concatenate([np.arange(a, a + 10.0, 0.1) for a in (100.0, 600.0, 700.0)])
    straight = Straightened({"tick": ticks})
    gap_s, again_s = 600.0 - 109.9, 700.0 - 609.9
    assert straight.moved(100.0) == 0.0
    assert straight.moved(105.0) == pytest.approx(5.0)
    assert straight.moved(605.0) == pytest.approx(505.0 - gap_s + 1.0)
    assert straight.moved(705.0) == pytest.approx(605.0 - gap_s - again_s + 2.0)
    assert straight.moved(300.0) == pytest.approx(9.9)  # within a leap: no later than what follows
    moved = [straight.moved(t) for t in ticks.tolist()]
    assert moved == pytest.approx(straight.time_s["tick"].tolist())


def test_a_ulogs_texts_and_changes_stand_beside_its_samples() -> None:
    ticks = np.concatenate([np.arange(100.0, 110.0, 0.1), np.arange(600.0, 610.0, 0.1)])
    topics = Topics(
        FlightLog(
            path=Path("x.ulg"),
            topics={"tick": {"timestamp": (1e6 * ticks).round().astype(np.uint64)}},
            parameters={"SRV_START": 0.0},
            changes=[ParameterChange(0, 605.0, "SRV_START", 1.0)],
            words=[Words(605.0, 6, "hello")],
        )
    )
    at = topics.time_s["tick"][150]
    assert [round(event.time_s - at, 6) for event in topics.events()] == [0.0, 0.0]

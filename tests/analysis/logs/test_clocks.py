"""A clock that is set back in flight: the stream that has the most samples says by how much."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.analysis.logs.clocks import Straightened

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

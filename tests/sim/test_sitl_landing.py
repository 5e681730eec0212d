"""Where and how hard a flight has touched down, and the words of it."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.sim.sitl_landing import Landing, touchdown

PLACE = {"LND_X": -28.0, "LND_Y": 1.0}


def truth(flying: list[int]) -> dict[str, np.ndarray]:
    rows = np.arange(float(len(flying)))
    return {
        "time_s": 0.02 * rows,
        "x_m": -30.0 - rows,
        "y_m": 0.5 * rows,
        "climb_mps": np.where(np.array(flying) > 0, -0.5 - 0.1 * rows, 0.0),
        "flying": np.array(flying, dtype=float),
    }


def test_it_is_the_last_step_to_the_ground_that_counts() -> None:
    """Held, flown, lost and carried back, flown again and landed."""
    found = touchdown(truth([0, 1, 0, 0, 1, 1, 0, 0]), PLACE)
    assert found.time_s == pytest.approx(0.12)
    assert found.along_m == -28.0 + 36.0
    assert found.across_m == 3.0 - 1.0
    assert found.sink_mps == pytest.approx(1.0)  # of the last step in the air
    assert found.is_well


@pytest.mark.parametrize("flying", [[1, 1, 1], [0, 0, 0], [1, 0, 1]])
def test_who_is_in_the_air_or_never_was_has_not_landed(flying: list[int]) -> None:
    found = touchdown(truth(flying), PLACE)
    assert not found.is_well
    assert found.fault().startswith("not landed: it was in the air when the module disengaged; ")


def test_the_words_of_a_landing() -> None:
    well = Landing(time_s=30.0, along_m=4.71, across_m=-0.42, sink_mps=0.66)
    assert well.words() == "landed 4.7 m beyond the place, 0.4 m across, sink 0.66 m/s"
    assert well.fault() == ""
    short = Landing(time_s=30.0, along_m=-10.1, across_m=0.0, sink_mps=0.66)
    assert short.fault() == (
        "landed 10.1 m short of the place, 0.0 m across, sink 0.66 m/s;"
        " 10 m along, 5 m across and 1.5 m/s of sink are allowed"
    )

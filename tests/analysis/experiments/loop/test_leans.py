"""Every lean that is accepted: which are flown, and how they are counted."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.experiments.flights import FlownScenario
from tgl_soar.analysis.experiments.loop.leans import (
    LeanCase,
    LeanCount,
    accepted_leans,
    counted,
    flown_places,
    lean_count_claims,
)
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.config.files import shipped
from tgl_soar.config.parameters import ParameterSet


def flight(e_rho_m: float, ended: str = "", until_s: float = 10.0) -> FlownScenario:
    """10 a second; e_rho is a metre while it settles."""
    time_s = np.arange(0.0, until_s, 0.1)
    path = {
        "time_s": time_s,
        "e_rho_m": np.where(time_s < 5.0, 1.0, e_rho_m),
        "y_m": np.full_like(time_s, 0.2),
    }
    return FlownScenario(seed=1, ended=ended, duration_s=until_s, legs=(), path=path)


def test_the_leans_are_those_that_a_station_may_set() -> None:
    values = ParameterSet()
    leans = accepted_leans()
    assert leans[0] == values["TGL_LEAN_MIN"]
    assert leans[-1] == values["TGL_LEAN_MAX"]
    assert set(np.diff(leans)) == {5.0}


def test_a_lost_flight_counts_with_what_it_flew() -> None:
    count = counted([flight(0.01), flight(0.03, "hit the board", until_s=7.5)])
    assert (count.flights, count.lost, count.ended) == (2, 1, "hit the board")
    assert count.rms_e_rho_m == pytest.approx(sqrt((50 * 0.01**2 + 25 * 0.03**2) / 75))
    assert count.rms_y_m == pytest.approx(0.2)


def test_every_place_is_flown_on_a_line_of_that_lean() -> None:
    scenario = load_scenario(shipped("scenarios/leans.toml"))
    for imu in ("with", "without"):
        places = flown_places(scenario, LeanCase(imu, 0.03, 45.0))
        assert [place.first_line for place in places] == ["a", "b", "c"]
        for place in places:
            prepared = prepare(place)
            assert prepared.values["TGL_LEAN"] == 45.0
            assert place.sensors.imu == (imu == "with")
            assert prepared.site.air is not None
            assert prepared.site.air.turbulence.intensity == 0.03


@pytest.mark.parametrize(
    ("turbulence", "changes", "fails"),
    [
        (0.01, {}, []),
        (0.01, {"lost": 1}, [0]),
        (0.01, {"rms_e_rho_m": 0.0151}, [1]),
        (0.03, {"lost": 0}, []),
        (0.03, {"lost": 1}, [2]),
        (0.03, {"rms_e_rho_m": 0.0151}, []),
    ],
)
def test_one_lean_decides(turbulence: float, changes: dict[str, Any], fails: list[int]) -> None:
    good = LeanCount(flights=96, lost=0, rms_e_rho_m=0.014, rms_y_m=0.1, ended="")
    counts = {LeanCase("with", t, deg): good for t in (0.01, 0.03) for deg in (5.0, 10.0, 45.0)}
    counts[LeanCase("with", turbulence, 45.0)] = good._replace(**changes)
    claims = lean_count_claims(counts)
    assert [i for i, claim in enumerate(claims) if not claim.holds] == fails
    if fails:
        assert "at 45°" in claims[fails[0]].measured

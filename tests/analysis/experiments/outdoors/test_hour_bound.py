"""The bound on what can be soared of an hour."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.analysis.experiments.outdoors.hour import HourCase, HourJob, hill_of, record_of
from tgl_soar.analysis.experiments.outdoors.hour_bound import (
    SoaredHill,
    _unit_flow,
    longest_s,
    soarable_fraction,
    soarable_winds,
    wind_across,
)
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill


@pytest.fixture(scope="module")
def hill() -> SoaredHill:
    return hill_of(HourJob(HourCase(8.0), 1), shipped_hill().on_line("a").values)


def test_there_are_places_between_two_winds_alone(hill: SoaredHill) -> None:
    winds, possible = soarable_winds(hill, 20.0)
    slowest, fastest = hill.speeds_mps
    assert not possible[winds < slowest / 2.0].any()  # nowhere is the air twice as fast
    least = winds[possible].min()
    assert slowest / 2.0 < least < 5.0
    assert possible[(winds >= least) & (winds < fastest)].all()


def test_the_fraction_is_that_of_the_time(hill: SoaredHill) -> None:
    winds = np.array([7.0] * 30 + [3.0] * 10)
    assert soarable_fraction(hill, winds) == pytest.approx(0.75)


def test_a_path_goes_on_in_a_steady_wind_and_falls_down_without(hill: SoaredHill) -> None:
    assert longest_s(hill, np.full(300, 7.0), -6.2, 14.2) == 300.0
    dies = np.array([7.0] * 100 + [1.0] * 200)
    assert 100.0 < longest_s(hill, dies, -6.2, 14.2) < 120.0
    assert longest_s(hill, np.full(300, 7.0), -23.0, 1.6) < 30.0  # no height, and no lift there


def test_the_wind_is_that_across_the_ridge() -> None:
    record = record_of(HourJob(HourCase(8.0), 1))
    winds = wind_across(record, 60.0)
    assert len(winds) == 60
    assert winds[7] == pytest.approx(record.wind_mps.at(7.0) * np.cos(record.veer_rad.at(7.0)))


def test_the_flow_is_that_which_blows_and_the_ground_the_hill_s() -> None:
    hill = hill_of(HourJob(HourCase(8.0), 1), shipped_hill().on_line("a").values)
    other = hill._replace(flow_radius=1.02, growth=0.1)
    x, z = np.array([-6.2, -9.5, -9.1, -8.9]), np.array([14.2, 0.6, 0.6, 0.6])
    u, w, allowed = _unit_flow(other, x, z)
    field = HillField(1.0, 8.0 * 1.02, 0.1)
    for n in range(4):
        assert (u[n], 0.0, w[n]) == pytest.approx(field.wind_at(float(x[n]), 0.0, float(z[n]), 0.0))
    # A metre from the hill of 8 m, whatever flows over it.
    assert allowed.tolist() == [True, True, True, False]

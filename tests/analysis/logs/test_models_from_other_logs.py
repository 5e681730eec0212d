"""One gliding flight in the logs of others: from each its polar, and the model that flew."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import flown
import numpy as np
import pytest

from tgl_soar.analysis.experiments.aircraft.identification import true_effect, true_period, truth
from tgl_soar.analysis.identification import identify
from tgl_soar.analysis.logs.flight_data import FlightData, steered
from tgl_soar.analysis.logs.gliding import MeanWind, glides, longitudinal
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.config.files import load_airframe
from tgl_soar.estimation.polar import fit_polar, sink_band
from tgl_soar.sim.aircraft import glide_at
from tgl_soar.sim.glide_test import WIND_MPS, fly
from tgl_soar.types import polar_sink

WRITERS: dict[str, Callable[..., Path]] = {
    "px4": flown.px4_log,
    "dataflash": flown.dataflash_log,
    "tlog": flown.tlog,
}
WIND = MeanWind(WIND_MPS, 0.0)
every_writer = pytest.mark.parametrize("writer", WRITERS)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FlightData]:
    """What each reports of it; the surfaces as often as the attitude."""
    folder, airframe = tmp_path_factory.mktemp("glides"), load_airframe(flown.AIRFRAME)
    ticks = tuple(fly(airframe, seed=2, speeds_mps=(9.2, 8.4, 7.9, 8.8, 9.8, 10.9), doublets=4))
    return {
        name: steered(read_flight(write(folder, ticks=ticks, moved_every=1)), airframe.surfaces)
        for name, write in WRITERS.items()
    }


@every_writer
def test_the_polar_is_that_of_the_model(logs: dict[str, FlightData], writer: str) -> None:
    found = glides(logs[writer], WIND)
    fit = fit_polar([g.speed_mps for g in found], [g.sink_mps for g in found])
    model, _ = truth()
    for u in np.arange(8.2, 10.9, 0.4):
        true = glide_at(model, u).sink_mps
        low, high = sink_band(fit, u)
        assert polar_sink(fit.polar, u) == pytest.approx(true, rel=0.05)
        assert low <= true <= high


@every_writer
def test_the_model_that_flew_is_found(logs: dict[str, FlightData], writer: str) -> None:
    model, body = truth()
    found = identify(longitudinal(logs[writer], WIND), body)
    period = true_period(model, body, found.airspeed_mps)
    assert found.frequency.value == pytest.approx(period, rel=0.1)
    assert found.effectiveness.value == pytest.approx(true_effect(model, body, found), rel=0.1)
    assert found["delay"].value == pytest.approx(0.0, abs=0.005)
    assert found.explained > 0.95


def test_rates_come_from_whatever_tells_them_oftenest(logs: dict[str, FlightData]) -> None:
    """A ground station's log without accelerometers still holds the rates of its attitudes."""
    flight = logs["tlog"]
    assert flight.imu is None
    assert flight.rates is not None
    columns = longitudinal(flight, WIND)
    expected = flight.rates.at("pitch_rate_frd_radps", columns.time_s)
    np.testing.assert_allclose(columns.pitch_rate_radps, expected, atol=1e-9)

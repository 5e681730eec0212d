"""The wind that an autopilot reports: from which message, in which frame, how long known."""

from __future__ import annotations

from math import inf, isnan, nan
from typing import Any

import pytest

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SensorMessages
from tgl_soar.link.autopilots.paparazzi import Paparazzi
from tgl_soar.link.autopilots.px4 import Px4
from tgl_soar.link.messages import Wind, WindCov
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.autopilot_wind import AutopilotWind
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters

FROM_NORTHWEST = Wind(direction=-45.0, speed=10.0)  # ArduPlane's is within ± 180


def cov(north: float, east: float) -> WindCov:
    return WindCov(
        time_usec=0, wind_x=north, wind_y=east, wind_z=3.0, horiz_accuracy=1.0, vert_accuracy=1.0
    )


def wind_of(sensors: SensorMessages = Px4.sensors) -> tuple[AutopilotWind, StreamRequests]:
    streams = StreamRequests(1)
    return AutopilotWind(sensors.wind, Ledger(SessionCounters(), [], streams)), streams


def test_px4_gives_the_components_of_the_moving_air() -> None:
    known, _ = wind_of()
    assert all(map(isnan, known.known(1.0)))
    known.take(cov(-2.0, 8.0), 1.0)
    assert known.known(1.0) == (-2.0, 8.0)


def test_arduplane_gives_the_side_that_it_blows_from() -> None:
    known, _ = wind_of()
    known.take(FROM_NORTHWEST, 1.0)
    assert known.known(1.0) == pytest.approx((-7.0711, 7.0711), abs=1e-4)  # to the southeast


@pytest.mark.parametrize(
    ("after_s", "is_known"), [(0.0, True), (2.9, True), (3.1, False), (-0.1, False), (nan, False)]
)
def test_it_is_known_for_three_seconds(after_s: float, is_known: bool) -> None:
    known, _ = wind_of()
    known.take(cov(1.0, 2.0), 100.0)
    assert isnan(known.known(100.0 + after_s)[0]) is not is_known


def test_of_before_a_restart_nothing_is_known() -> None:
    known, _ = wind_of()
    known.take(cov(1.0, 2.0), 100.0)
    known.restarted()
    assert all(map(isnan, known.known(100.0)))


@pytest.mark.parametrize(
    ("flavour", "number", "message"), [(Px4, 231, cov(0.0, 0.0)), (ArduPilot, 168, FROM_NORTHWEST)]
)
def test_it_is_requested_once_a_second_when_it_is_wanted(
    flavour: Any, number: int, message: Any
) -> None:
    known, streams = wind_of(flavour.sensors)
    assert streams.wanted(number) is None
    known.want()
    stream = streams.wanted(number)
    assert stream is not None
    assert stream.wanted_hz == 1.0
    known.take(message, 1.0)
    assert stream.count == 1


def test_of_a_firmware_without_it_nothing_is_requested() -> None:
    known, streams = wind_of(Paparazzi.sensors)
    known.want()
    assert streams.all_wanted() == []


@pytest.mark.parametrize(
    "message",
    [
        *(Wind(bad, 8.0) for bad in (nan, inf, -inf)),
        *(Wind(270.0, bad) for bad in (nan, inf, -3e38, 101.0)),
        *(cov(bad, 0.0) for bad in (nan, inf, 3e38)),
        cov(0.0, -101.0),
    ],
)
def test_a_wind_that_cannot_be_says_nothing(message: Any) -> None:
    known, _ = wind_of()
    known.take(message, 1.0)
    assert all(map(isnan, known.known(1.0)))
    known.take(cov(1.0, 2.0), 2.0)
    known.take(message, 2.5)
    assert known.known(4.9) == (1.0, 2.0)
    assert isnan(known.known(5.1)[0])  # nor does it make the last one new

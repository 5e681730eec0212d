"""A ground station falls silent: the module stays or disengages, as it was set to."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, texts

from tgl_soar.control.supervisor import CAPTURING, READY, SOARING, STANDBY

FLYING = (CAPTURING, SOARING)
LIMIT_S = 3.0


def beat(flight: Flight, *, seconds: float) -> None:
    """A station is there for so long, with a heartbeat a second."""
    for _ in range(round(seconds)):
        flight.receive(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), station=True)
        flight.run(1.0)


@pytest.fixture
def flight() -> Flight:
    flight = Flight()
    flight.set("OP_GCS_S", LIMIT_S)
    return flight


def engage(flight: Flight, loss: float) -> None:
    flight.set("OP_GCS_LOSS", loss)
    beat(flight, seconds=2.0)
    flight.set("OP_ENGAGE", 1.0)
    beat(flight, seconds=2 * LIMIT_S)
    assert flight.mode_now in FLYING
    flight.outbound()


def test_set_to_stay_it_says_so_once_and_flies_on(flight: Flight) -> None:
    engage(flight, 0.0)
    flight.run(3 * LIMIT_S)
    reported = texts(flight.outbound())
    # Not "on the line": it may be on its way home.
    assert [t for t in reported if "no ground station" in t] == [
        "no ground station for 3 s: flying on"
    ]
    assert flight.mode_now in FLYING
    beat(flight, seconds=2.0)
    assert texts(flight.outbound()).count("a ground station is there again") == 1


def test_set_to_disengage_it_does_when_the_time_is_over_and_not_before(flight: Flight) -> None:
    engage(flight, 1.0)
    flight.run(LIMIT_S - 1.1)  # the last heartbeat is a second old
    assert flight.mode_now in FLYING
    flight.run(0.3)
    assert flight.mode_now in (STANDBY, READY)
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert "disengaged: no ground station for 3 s" in texts(flight.outbound())


def test_without_a_station_it_cannot_be_engaged_then(flight: Flight) -> None:
    flight.set("OP_GCS_LOSS", 1.0)
    flight.run(1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert flight.mode_now == READY
    refusal = "".join(texts(flight.outbound()))
    assert "no ground station for 3 s, and OP_GCS_LOSS asks for one" in refusal
    beat(flight, seconds=1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert flight.mode_now == CAPTURING


def test_where_no_station_was_ever_there_nothing_is_reported(flight: Flight) -> None:
    """Engaged by the pilot's switch, say: no station is waited for."""
    flight.engaged()
    flight.outbound()
    flight.run(3 * LIMIT_S)
    assert flight.mode_now in FLYING
    assert not any("ground station" in text for text in texts(flight.outbound()))


def test_the_autopilots_own_heartbeat_is_no_stations(flight: Flight) -> None:
    engage(flight, 1.0)
    flight.heartbeat_hz = 5.0
    flight.run(LIMIT_S)
    assert flight.mode_now not in FLYING

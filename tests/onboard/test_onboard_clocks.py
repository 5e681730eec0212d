"""What clocks do to a flight: the whole module, whose time is an argument.

A host whose clock is slewed, an autopilot whose stamps jump, and a duplicate beside the true one.
"""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, texts

from tgl_soar.control.supervisor import CAPTURING, READY, SOARING, STANDBY

ENGAGED = (CAPTURING, SOARING)
SOON_S = 5.0  # engagement is possible again
LONG = pytest.mark.long


@pytest.fixture
def flight() -> Flight:
    """Engaged, with an autopilot that has been up for a quarter of an hour."""
    flown = Flight()
    flown.boot_s -= 900.0
    return flown.engaged()


def stamp_ms(flight: Flight, ahead_s: float) -> int:
    return round(1e3 * (flight.now_s - flight.boot_s + ahead_s))


def duplicate(flight: Flight, seconds: float, ahead_s: float) -> None:
    """A second autopilot with the same identity: upside down, and somewhere else."""
    for _ in range(round(seconds * 50)):
        flight.run(0.02)
        stamp = stamp_ms(flight, ahead_s)
        flight.receive(mavlink.MAVLink_attitude_quaternion_message(stamp, 0, 1, 0, 0, 0, 0, 0))
        flight.receive(mavlink.MAVLink_local_position_ned_message(stamp, 0.3, 0.0, 0.0, 0, 0, 0))


@pytest.mark.parametrize("ahead_s", [0.25, 0.6, 1.0, 400.0])
def test_one_stamp_ahead_is_flown_through(flight: Flight, ahead_s: float) -> None:
    """Of what is flown with, of what is not, and of what was never received before."""
    stamp = stamp_ms(flight, ahead_s)
    flight.receive(mavlink.MAVLink_attitude_quaternion_message(stamp, 1, 0, 0, 0, 0, 0, 0))
    flight.receive(mavlink.MAVLink_local_position_ned_message(stamp, 0, 0, 0, 0, 0, 0))
    flight.receive(mavlink.MAVLink_global_position_int_message(stamp, 0, 0, 0, 0, 0, 0, 0, 0))
    flight.receive(mavlink.MAVLink_scaled_imu2_message(stamp, 0, 0, -1000, 0, 0, 0, 0, 0, 0))
    flight.receive(mavlink.MAVLink_raw_imu_message(stamp * 1000, 0, 0, -1000, 0, 0, 0, 0, 0, 0))
    flight.run(3.0)
    assert flight.mode_now in ENGAGED
    assert flight.onboard.session.counters.reboots == 0


@pytest.mark.parametrize("ahead_s", [0.25, 0.6, 1.0, 400.0])
def test_one_stamp_ahead_blocks_no_engagement(ahead_s: float) -> None:
    """Not even the first that is received."""
    flight = Flight()
    stamp = stamp_ms(flight, ahead_s)
    flight.receive(mavlink.MAVLink_attitude_quaternion_message(stamp, 1, 0, 0, 0, 0, 0, 0))
    flight.receive(mavlink.MAVLink_local_position_ned_message(stamp, 0, 0, 0, 0, 0, 0))
    flight.run(SOON_S)
    assert flight.mode_now == READY


@pytest.mark.parametrize(
    ("over_s", "of_it_s"),
    [
        (10.0, 10.0),
        (600.0, 10.0),
        pytest.param(600.0, 60.0, marks=LONG),  # nothing changes after that
    ],
)
@pytest.mark.parametrize("slewed_s", [-0.3, 0.3])
def test_a_slewed_host_ends_no_flight(
    flight: Flight, slewed_s: float, over_s: float, of_it_s: float
) -> None:
    began_s, slewed = flight.now_s, 0.0
    while flight.now_s < began_s + of_it_s:
        flight.run(0.01)
        flight.boot_s += 0.01 * slewed_s / over_s
        slewed += 0.01
        assert flight.mode_now in ENGAGED
    flight.run(6.0)
    assert flight.mode_now in ENGAGED
    output = flight.onboard.output
    assert output is not None
    assert output.health.attitude_age_s < 0.01


JUMPS_S = (-1000.0, -300.0, -0.5, 0.5, 300.0)


@pytest.mark.parametrize(
    ("jump_s", "for_s"),
    [
        *((jump, 1.0) for jump in JUMPS_S),
        (-300.0, 10.0),
        (0.5, 10.0),
        *(pytest.param(jump, 10.0, marks=LONG) for jump in JUMPS_S if jump not in (-300.0, 0.5)),
    ],
)
def test_a_clock_that_jumps_disengages_and_is_forgotten(
    flight: Flight, jump_s: float, for_s: float
) -> None:
    flight.boot_s -= jump_s
    flight.boot_s = min(flight.boot_s, flight.now_s)  # no stamp is below zero
    flight.run(for_s)
    reported = texts(flight.outbound())
    ended = ("released: attitude lost", "released: autopilot has restarted")
    assert any(text in ended for text in reported)
    assert any("clock is another one" in text or "restarted" in text for text in reported)
    flight.boot_s = flight.now_s - 910.0  # the stamps are good again
    flight.run(SOON_S)
    assert flight.mode_now == READY
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert flight.mode_now in ENGAGED


@pytest.mark.parametrize("ahead_s", [-400.0, -20.0, 0.5, 400.0])
def test_a_duplicate_is_not_flown_with(flight: Flight, ahead_s: float) -> None:
    flight.outbound()
    duplicate(flight, 0.5, ahead_s)
    assert flight.mode_now in ENGAGED
    output = flight.onboard.output
    assert output is not None
    assert abs(output.vehicle.roll_rad) < 0.01
    duplicate(flight, 2.0, ahead_s)
    reported = texts(flight.outbound())
    assert any("another clock" in text for text in reported)
    assert any("two autopilots are 1:1" in text for text in reported)
    assert "released: attitude lost" in reported
    flight.set("OP_ENGAGE", 1.0)
    duplicate(flight, 1.0, ahead_s)
    assert flight.mode_now == STANDBY  # refused while it lasts
    flight.run(SOON_S)
    assert any("only one autopilot sends" in text for text in texts(flight.outbound()))
    assert flight.mode_now == READY
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert flight.mode_now in ENGAGED

"""The numbers `entry`, `stall` and `clearance`: what holds an engagement back, and what is near."""

from __future__ import annotations

from math import inf, isnan, nan, radians
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight

from tgl_soar.control.envelope import Margins
from tgl_soar.control.supervisor import POSITION_FRESH, READY, UPRIGHT
from tgl_soar.onboard.telemetry_values import HELD_BACK, SLOW, slow_value

RELEASE, ABORT = mavlink.MAV_CMD_USER_2, mavlink.MAV_CMD_USER_3


def reported(flight: Flight, name: str) -> float:
    """The last that came of a number within a second and a half."""
    flight.outbound()
    flight.run(1.5)
    values: list[float] = [m.value for m in flight.outbound("NAMED_VALUE_FLOAT") if m.name == name]
    return values[-1]


def command(flight: Flight, number: int) -> None:
    flight.receive(
        mavlink.MAVLink_command_long_message(1, 191, number, 0, 0, 0, 0, 0, 0, 0, 0), station=True
    )


def test_nothing_is_lacking_where_it_can_be_engaged() -> None:
    flight = Flight()
    flight.run(3.0)
    assert flight.mode_now == READY
    assert reported(flight, "entry") == 0.0


def test_what_is_lacking_is_named_by_its_own_bit() -> None:
    flight = Flight()
    flight.run(3.0)
    flight.quaternion = [0.6, 0.8, 0.0, 0.0]  # on its side
    assert int(reported(flight, "entry")) & UPRIGHT
    flight.quaternion = [1.0, 0.0, 0.0, 0.0]
    assert reported(flight, "entry") == 0.0
    flight.position_hz = 0.0
    assert int(reported(flight, "entry")) & POSITION_FRESH


def test_an_abort_is_shown_until_it_is_released() -> None:
    flight = Flight()
    flight.run(3.0)
    command(flight, ABORT)
    assert int(reported(flight, "entry")) == HELD_BACK
    command(flight, RELEASE)
    assert reported(flight, "entry") == 0.0


@pytest.mark.parametrize(
    ("name", "margins", "value"),
    [
        ("stall", Margins(radians(4.0), 1.5, 0), 4.0),
        ("stall", Margins(inf, 1.5, 0), nan),
        ("clearance", Margins(inf, 1.5, 0), 1.5),
        ("clearance", Margins(inf, inf, 0), nan),
    ],
)
def test_a_margin_that_is_not_known_is_not_a_number(
    name: str, margins: Margins, value: float
) -> None:
    flight = Flight()
    flight.run(1.0)
    output: Any = flight.onboard.output
    shown = slow_value(output._replace(margins=margins), 0.0, 0.0, 0, SLOW.index(name))
    assert shown == pytest.approx(value) or (isnan(shown) and isnan(value))

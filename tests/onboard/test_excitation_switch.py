"""EXC_START over the air: what is reported of the multisine, and that the switch goes back."""

from __future__ import annotations

from math import degrees

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, texts

from tgl_soar.control.excitation import RUNNING, WHOLE_S
from tgl_soar.control.supervisor import SOARING
from tgl_soar.onboard.telemetry_values import ARRAY


def soaring() -> Flight:
    flight = Flight()
    flight.base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    flight.engaged().run(4.0)
    assert flight.mode_now == SOARING
    flight.outbound()
    return flight


def start(flight: Flight) -> float:
    """EXC_START as it stands after the module has taken it."""
    flight.set("EXC_START", 1.0)
    flight.run(0.02)
    return flight.onboard.settings.values["EXC_START"]


def words(flight: Flight) -> list[str]:
    return [text for text in texts(flight.outbound()) if "multisine" in text]


def test_it_runs_to_its_end_and_the_switch_goes_back() -> None:
    flight = soaring()
    assert start(flight) == 1.0
    assert words(flight) == ["multisine: +-1 deg of pitch setpoint, 23 s"]
    flight.run(10.0)
    output = flight.onboard.output
    assert output is not None
    arrays = flight.outbound("DEBUG_FLOAT_ARRAY")
    shown = [dict(zip(ARRAY, array.data, strict=False)) for array in arrays]
    assert {array["exc_state"] for array in shown} == {RUNNING}
    assert 0.1 < max(abs(array["exc_pitch"]) for array in shown) <= 1.0
    assert abs(degrees(output.excitation.pitch_rad)) <= 1.0
    flight.run(WHOLE_S - 10.0)
    messages = flight.outbound()
    assert "multisine: done" in texts(messages)
    shown_back = [m for m in messages if m.get_type() == "PARAM_VALUE"]
    assert [(m.param_id, m.param_value) for m in shown_back] == [("EXC_START", 0.0)]
    assert start(flight) == 1.0  # and it can be asked for once more


def test_the_operators_0_ends_it_and_says_so() -> None:
    flight = soaring()
    start(flight)
    flight.run(5.0)
    words(flight)
    flight.set("EXC_START", 0.0)
    flight.run(0.02)
    assert words(flight) == ["multisine: stopped: by the operator"]
    output = flight.onboard.output
    assert output is not None
    assert output.excitation.pitch_rad == 0.0


def test_another_gain_ends_it_and_what_is_no_gain_does_not() -> None:
    """The periods before and after it would be of two loops."""
    flight = soaring()
    start(flight)
    flight.run(5.0)
    words(flight)
    flight.set("TGL_SLEW", 0.2)
    flight.run(0.1)
    assert words(flight) == []
    gain = flight.onboard.settings.values["RHO_P"]
    flight.set("RHO_P", 0.95 * gain)
    flight.run(0.02)
    assert words(flight) == [
        "multisine: another loop is to be measured now",
        "multisine: stopped: by the operator",
    ]
    assert flight.onboard.settings.values["EXC_START"] == 0.0
    assert start(flight) == 1.0  # of the new loop


def test_leaving_the_line_ends_it() -> None:
    """The module hands over: nothing of the multisine is left for the next engagement."""
    flight = soaring()
    start(flight)
    flight.run(5.0)
    words(flight)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.02)
    assert words(flight) == ["multisine: stopped: not soaring"]
    assert flight.onboard.settings.values["EXC_START"] == 0.0


@pytest.mark.parametrize("engaged", [False, True])
def test_it_is_refused_anywhere_but_on_the_line(engaged: bool) -> None:
    flight = Flight()
    flight.run(1.0)
    if engaged:
        flight.engaged()
    flight.outbound()
    assert start(flight) == 0.0
    assert words(flight) == ["multisine: refused: not soaring"]

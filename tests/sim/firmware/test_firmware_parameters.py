"""Parameters of a firmware that change in flight: its own types, both encodings, and what took."""

from __future__ import annotations

import struct
from typing import Any, Final

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots.base import BYTEWISE, CAST
from tgl_soar.sim.firmware.ardupilot import ArduPlanePhysics
from tgl_soar.sim.firmware.parameters import (
    AGAIN_S,
    GIVE_UP_S,
    ParameterChanges,
)
from tgl_soar.sim.firmware.px4 import Px4Physics
from tgl_soar.sim.simulation import TimedSetting

REAL32: Final = mavlink.MAV_PARAM_TYPE_REAL32
INT32: Final = mavlink.MAV_PARAM_TYPE_INT32
INT8: Final = mavlink.MAV_PARAM_TYPE_INT8
STEP_S: Final = 0.1
CODEC: Final = mavlink.MAVLink(None, 1, 1)


def travelled(message: Any) -> Any:
    """As it is after a journey over a link."""
    return mavlink.MAVLink(None).parse_buffer(bytearray(message.pack(CODEC)))[0]


class Px4:
    """As mavlink_parameters.cpp: the bytes of the value, and only in the parameter's own type."""

    codec = BYTEWISE

    def __init__(self, **kinds: int) -> None:
        self.kinds = kinds
        self.values = dict.fromkeys(kinds, 0.0)
        self.sets: list[Any] = []

    def answer(self, message: Any) -> Any | None:
        name = message.param_id
        if message.get_type() == "PARAM_SET":
            self.sets.append(message)
            if name not in self.kinds or message.param_type != self.kinds[name]:
                return None
            self.keep(name, message.param_value)
        if name not in self.kinds:
            return None
        return mavlink.MAVLink_param_value_message(
            name.encode(), self.sent(name), self.kinds[name], 1, 0
        )

    def keep(self, name: str, sent: float) -> None:
        layout = "<i" if self.kinds[name] == INT32 else "<f"
        (self.values[name],) = struct.unpack(layout, struct.pack("<f", sent))

    def sent(self, name: str) -> float:
        if self.kinds[name] != INT32:
            return self.values[name]
        return float(struct.unpack("<f", struct.pack("<i", int(self.values[name])))[0])


class ArduPlane(Px4):
    """The value as a float, whatever type is named."""

    codec = CAST

    def answer(self, message: Any) -> Any | None:
        if message.get_type() == "PARAM_SET":
            message.param_type = self.kinds.get(message.param_id, REAL32)
        return super().answer(message)

    def keep(self, name: str, sent: float) -> None:
        self.values[name] = sent if self.kinds[name] == REAL32 else float(int(sent))

    def sent(self, name: str) -> float:
        return self.values[name]


def flown(firmware: Px4, *settings: TimedSetting, seconds: float = 12.0) -> list[tuple[float, str]]:
    """What the bridge reports, and when [s]."""
    changes = ParameterChanges(settings, firmware.codec, 7)
    events = []
    for step in range(round(seconds / STEP_S)):
        now_s = step * STEP_S
        for message in changes.due(now_s):
            assert (message.target_system, message.target_component) == (7, 1)
            answer = firmware.answer(travelled(message))
            if answer is not None:
                changes.take(travelled(answer))
        events += [(round(now_s, 3), event) for event in changes.take_events()]
    return events


def test_each_firmware_has_its_own_encoding() -> None:
    assert Px4Physics.codec == BYTEWISE
    assert ArduPlanePhysics.codec == CAST


@pytest.mark.parametrize("number", [0.0, 1.0, -1.0, 7.0, 86400.0, 5_000_001.0, -(2.0**31)])
def test_px4_takes_a_whole_number_by_its_bytes_and_its_own_type(number: float) -> None:
    firmware = Px4(EKF2_GPS_CTRL=INT32)
    firmware.values["EKF2_GPS_CTRL"] = 3.0
    events = flown(firmware, TimedSetting("EKF2_GPS_CTRL", number, 2.0))
    assert firmware.values["EKF2_GPS_CTRL"] == number
    assert events == [
        (2.0, f"sets EKF2_GPS_CTRL = {number:g}"),
        (2.0, f"EKF2_GPS_CTRL is {number:g}"),
    ]
    assert [(message.param_type) for message in firmware.sets] == [INT32]


@pytest.mark.parametrize("kind", [INT8, INT32])
def test_arduplane_takes_a_whole_number_as_a_float(kind: int) -> None:
    firmware = ArduPlane(SIM_GPS_DISABLE=kind)
    events = flown(firmware, TimedSetting("SIM_GPS_DISABLE", 1.0, 2.0))
    assert firmware.values["SIM_GPS_DISABLE"] == 1.0
    assert [words for _, words in events] == ["sets SIM_GPS_DISABLE = 1", "SIM_GPS_DISABLE is 1"]
    assert [message.param_value for message in firmware.sets] == [1.0]


@pytest.mark.parametrize("make", [Px4, ArduPlane])
def test_a_number_that_is_not_whole_goes_as_it_is(make: type[Px4]) -> None:
    firmware = make(SIM_X=REAL32)
    events = flown(firmware, TimedSetting("SIM_X", 2.7e-5, 2.0))  # the link rounds it
    assert firmware.values["SIM_X"] == pytest.approx(2.7e-5)
    assert events[-1] == (2.0, "SIM_X is 2.7e-05")
    assert len(firmware.sets) == 1


def test_the_type_is_asked_for_until_it_is_known_and_once() -> None:
    changes = ParameterChanges((TimedSetting("SIM_X", 1.0, 9.0),), BYTEWISE, 7)
    asked = [changes.due(step * STEP_S) for step in range(30)]
    assert [i for i, each in enumerate(asked) if each] == [0, 10, 20]
    assert all(m.get_type() == "PARAM_REQUEST_READ" for each in asked for m in each)
    assert [(m.param_id, m.param_index) for m in asked[0]] == [("SIM_X", -1)]
    changes.take(travelled(mavlink.MAVLink_param_value_message(b"SIM_X", 0.0, REAL32, 1, 0)))
    assert [changes.due(3.0 + step * STEP_S) for step in range(50)] == [[]] * 50


def test_one_that_the_firmware_does_not_have_is_reported() -> None:
    firmware = Px4()
    events = flown(firmware, TimedSetting("SIM_GPS_DISABLE", 1.0, 2.0))
    assert firmware.sets == []
    assert events == [(7.1, "SIM_GPS_DISABLE is not set to 1: the firmware has no SIM_GPS_DISABLE")]


def test_a_firmware_that_boots_late_is_asked_all_the_same() -> None:
    """What was due while it booted is due from then on."""
    changes = ParameterChanges((TimedSetting("A", 1.0, 1.0),), BYTEWISE, 7)
    (asked,) = changes.due(10.0)
    assert (asked.get_type(), changes.take_events()) == ("PARAM_REQUEST_READ", [])
    changes.take(travelled(mavlink.MAVLink_param_value_message(b"A", 0.0, REAL32, 1, 0)))
    (sent,) = changes.due(10.5)
    assert (sent.get_type(), changes.take_events()) == ("PARAM_SET", ["sets A = 1"])
    assert changes.due(10.5 + STEP_S) == []
    assert changes.take_events() == []  # its answer is on the way
    changes.take(travelled(mavlink.MAVLink_param_value_message(b"A", 1.0, REAL32, 1, 0)))
    assert changes.take_events() == ["A is 1"]


def test_one_that_does_not_take_is_tried_again_and_reported() -> None:
    class Deaf(Px4):
        def keep(self, _name: str, _sent: float) -> None:
            pass

    firmware = Deaf(SIM_X=REAL32)
    events = flown(firmware, TimedSetting("SIM_X", 1.5, 2.0))
    assert events == [(2.0, "sets SIM_X = 1.5"), (7.1, "SIM_X did not take 1.5: it is 0")]
    assert len(firmware.sets) == round(GIVE_UP_S / AGAIN_S) + 1


def test_a_fraction_for_a_whole_number_is_not_sent() -> None:
    too_large = f"no whole number from {-(2**31)} to {2**31 - 1}"
    for number, why in ((2.5, "it is a whole number"), (3e9, too_large)):
        firmware = Px4(EKF2_GPS_CTRL=INT32)
        events = flown(firmware, TimedSetting("EKF2_GPS_CTRL", number, 2.0))
        assert events == [(2.0, f"EKF2_GPS_CTRL is not set to {number:g}: {why}")]
        assert firmware.sets == []


def test_what_a_firmware_rounds_did_not_take() -> None:
    events = flown(ArduPlane(FENCE_TYPE=INT8), TimedSetting("FENCE_TYPE", 2.5, 2.0))
    assert events[-1] == (7.1, "FENCE_TYPE did not take 2.5: it is 2")


def test_one_parameter_changes_twice_in_the_order_of_time() -> None:
    firmware = Px4(A=INT32, B=REAL32)
    events = flown(
        firmware,
        TimedSetting("A", 7.0, 4.0),
        TimedSetting("B", 0.5, 3.0),
        TimedSetting("A", 1.0, 2.0),
    )
    assert events == [
        *((2.0, "sets A = 1"), (2.0, "A is 1")),
        *((3.0, "sets B = 0.5"), (3.0, "B is 0.5")),
        *((4.0, "sets A = 7"), (4.0, "A is 7")),
    ]
    assert firmware.values == {"A": 7.0, "B": 0.5}


def test_the_next_value_does_not_wait_for_one_that_was_never_answered() -> None:
    class Forgetful(Px4):
        def answer(self, message: Any) -> Any | None:
            answer = super().answer(message)
            return None if len(self.sets) == 1 else answer

    firmware = Forgetful(A=INT32)
    events = flown(firmware, TimedSetting("A", 1.0, 2.0), TimedSetting("A", 0.0, 2.5))
    assert [words for _, words in events] == [
        *("sets A = 1", "A did not take 1: it is 0", "sets A = 0", "A is 0")
    ]
    assert events[-1][0] <= 2.6


def test_what_others_ask_for_is_not_ours() -> None:
    changes = ParameterChanges((TimedSetting("A", 1.0, 2.0),), BYTEWISE, 7)
    changes.take(travelled(mavlink.MAVLink_param_value_message(b"B", 1.0, REAL32, 1, 0)))
    changes.take(travelled(mavlink.MAVLink_param_value_message(b"A", 1.0, REAL32, 1, 0)))
    assert changes.take_events() == []  # as it was before: it is set all the same
    assert [m.get_type() for m in changes.due(2.0)] == ["PARAM_SET"]

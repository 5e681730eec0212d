"""Parameters of a firmware that are set in flight, as a ground station sets them.

    bridge → firmware   PARAM_REQUEST_READ once it has booted: which type the parameter has
    firmware → bridge   PARAM_VALUE
    bridge → firmware   PARAM_SET when it is due, in that type
    firmware → bridge   PARAM_VALUE: whether it took

A whole number goes in the firmware's own encoding: PX4 sends and takes its bytes, and ignores what
is sent in another type without a word; ArduPlane sends and takes its value as a float.  Neither
answers a question after a parameter that it does not have.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.parameters import as_wire_value
from tgl_soar.link.autopilots.base import ParameterCodec
from tgl_soar.sim.simulation import TimedSetting

AGAIN_S: Final = 1.0  # between two questions, or two sets, that nothing answers
GIVE_UP_S: Final = 5.0  # after a change is due, and was asked for or sent first
NEVER: Final = float("-inf")


class ParameterChanges:
    """All that are to change in one flight, from message to message."""

    def __init__(
        self, settings: Iterable[TimedSetting], codec: ParameterCodec, system: int
    ) -> None:
        """`system`: the firmware's id."""
        self._left = sorted(settings, key=lambda setting: setting.at_s)
        self._codec = codec
        self._target = (system, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._newest: dict[str, tuple[float, int]] = {}  # of each that it has: as sent, its type
        # Of the first of each that is left: when it was asked for or sent first, and last.
        self._first_asked_s: dict[str, float] = {}
        self._asked_s: dict[str, float] = {}
        self._first_sent_s: dict[str, float] = {}
        self._sent_s: dict[str, float] = {}
        self._events: list[str] = []

    def take(self, message: Any) -> None:
        """A PARAM_VALUE of the firmware."""
        name = message.param_id
        setting = self._first(name)
        if setting is None:
            return
        self._newest[name] = message.param_value, message.param_type
        if name in self._sent_s and self._value(name) == self._wanted(setting):
            self._end(setting, f"{name} is {setting.value:g}")

    def due(self, now_s: float) -> list[Any]:
        """What is to be sent at a time [s] to a firmware that has booted."""
        out: list[Any] = []
        for name in dict.fromkeys(setting.name for setting in self._left):
            if name in self._newest:
                out += self._set(name, now_s)
            else:
                out += self._ask(name, now_s)
        return out

    def take_events(self) -> list[str]:
        """What became of them, each once."""
        events, self._events = self._events, []
        return events

    def _ask(self, name: str, now_s: float) -> list[Any]:
        """Which type it has."""
        first, began_s = self._first(name), self._first_asked_s.setdefault(name, now_s)
        if first is not None and now_s - max(first.at_s, began_s) > GIVE_UP_S:
            self._end(first, f"{name} is not set to {first.value:g}: the firmware has no {name}")
            return []
        if now_s - self._asked_s.get(name, NEVER) < AGAIN_S:
            return []
        self._asked_s[name] = now_s
        return [mavlink.MAVLink_param_request_read_message(*self._target, name.encode(), -1)]

    def _set(self, name: str, now_s: float) -> list[Any]:
        due = [each for each in self._left if each.name == name and each.at_s <= now_s]
        if not due:
            return []
        setting, sent_s = due[0], self._sent_s.get(name, NEVER)
        began_s = self._first_sent_s.get(name, now_s)
        if name in self._sent_s and (len(due) > 1 or now_s - began_s > GIVE_UP_S):
            is_now = f"it is {self._value(name):g}"
            self._end(setting, f"{name} did not take {setting.value:g}: {is_now}")
            return []
        if now_s - sent_s < AGAIN_S:
            return []
        try:
            _, kind = self._newest[name]
            sent = self._codec.wire(setting.value, kind)
        except ValueError as error:
            self._end(setting, f"{name} is not set to {setting.value:g}: {error}")
            return []
        if name not in self._sent_s:
            self._events.append(f"sets {name} = {setting.value:g}")
        self._first_sent_s.setdefault(name, now_s)
        self._sent_s[name] = now_s
        return [mavlink.MAVLink_param_set_message(*self._target, name.encode(), sent, kind)]

    def _value(self, name: str) -> float:
        return self._codec.number(*self._newest[name])

    def _wanted(self, setting: TimedSetting) -> float:
        """What it is once it took: a journey by the link may have rounded it."""
        _, kind = self._newest[setting.name]
        return self._codec.number(as_wire_value(self._codec.wire(setting.value, kind)), kind)

    def _first(self, name: str) -> TimedSetting | None:
        return next((setting for setting in self._left if setting.name == name), None)

    def _end(self, setting: TimedSetting, words: str) -> None:
        self._left.remove(setting)
        for times_s in (self._first_sent_s, self._sent_s, self._first_asked_s):
            times_s.pop(setting.name, None)
        self._events.append(words)

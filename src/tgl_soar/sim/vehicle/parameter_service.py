"""MAVLink's parameter protocol, as ArduPlane serves its own parameters by it.

A changed value is broadcast on every link, a value that cannot be is answered with the unchanged
one, and a name that it does not have meets silence.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.routing import RoutedFrame
from tgl_soar.sim.vehicle.firmware_parameters import FirmwareParameters
from tgl_soar.sim.vehicle.vehicle_links import VehicleLink, VehicleLinks

_PARAMETERS_PER_STEP: Final = 2  # of a list, so that it does not delay the sensors
_NO_INDEX: Final = 65535  # of a parameter that was asked for by name


class ParameterService:
    """Answers what arrives, and sends the lists that were asked for."""

    def __init__(self, parameters: FirmwareParameters, links: VehicleLinks) -> None:
        self._parameters = parameters
        self._links = links

    def take_set(self, link: VehicleLink, frame: RoutedFrame) -> None:
        """PARAM_SET."""
        name = str(frame.message.param_id)
        if name not in self._parameters:
            return  # as the firmware: silence
        if self._parameters.set(name, float(frame.message.param_value)):
            for each in self._links:
                each.codec.srcSystem = int(self._parameters["SYSID_THISMAV"])
                each.post(self._value(name))
        else:
            link.post(self._value(name))  # unchanged

    def take_read(self, link: VehicleLink, frame: RoutedFrame) -> None:
        """PARAM_REQUEST_READ, by index or by name."""
        names = self._parameters.names
        index = int(frame.message.param_index)
        name = str(frame.message.param_id)
        if 0 <= index < len(names):
            link.post(self._value(names[index], index))
        elif name in self._parameters:
            link.post(self._value(name))

    def take_list(self, link: VehicleLink, _frame: RoutedFrame) -> None:
        """PARAM_REQUEST_LIST."""
        link.parameters_to_send = deque(range(len(self._parameters.names)))

    def step(self, link: VehicleLink) -> None:
        """The next few of a list."""
        for _ in range(min(_PARAMETERS_PER_STEP, len(link.parameters_to_send))):
            index = link.parameters_to_send.popleft()
            link.post(self._value(self._parameters.names[index], index))

    def _value(self, name: str, index: int = _NO_INDEX) -> Any:
        """`index`: in a list, or where it was asked for by index."""
        return mavlink.MAVLink_param_value_message(
            name.encode("ascii"),
            self._parameters[name],
            self._parameters.wire_type(name),
            len(self._parameters.names),
            index,
        )

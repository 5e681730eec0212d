"""The autopilot's own parameters, with their ranges."""

from __future__ import annotations

from math import isfinite
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Surfaces

OVERRIDES_NEVER_EXPIRE: Final = -1.0


class FirmwareParameters:
    """A few ArduPlane parameters, those that have an effect here; each (value, low, high).

    They are set as the module requires them of an ArduPlane: RC_OVERRIDE_TIME is 0.5 s where the
    firmware's default is 3 s, which would lose the aircraft; with it the module engages only if
    forced.
    """

    def __init__(self, surfaces: Surfaces, values: dict[str, float] | None = None) -> None:
        self._table: dict[str, tuple[float, float, float]] = {
            "SYSID_THISMAV": (1.0, 1.0, 255.0),
            "SYSID_MYGCS": (255.0, 1.0, 255.0),
            "SCHED_LOOP_RATE": (400.0, 50.0, 400.0),
            "RC_OVERRIDE_TIME": (0.5, OVERRIDES_NEVER_EXPIRE, 120.0),
            "VISO_TYPE": (0.0, 0.0, 1.0),
            "VISO_DELAY_MS": (10.0, 0.0, 250.0),
        }
        # The pulse widths of the airframe file are those of the override, so the firmware's
        # calibration of stick and servo are the same and a channel passes through unchanged.
        for surface in sorted(surfaces.driven(), key=lambda s: s.channel):
            for prefix in ("RC", "SERVO"):
                name = f"{prefix}{surface.channel}"
                self._table[f"{name}_MIN"] = (float(surface.pwm_min), 800.0, 2200.0)
                self._table[f"{name}_TRIM"] = (float(surface.pwm_trim), 800.0, 2200.0)
                self._table[f"{name}_MAX"] = (float(surface.pwm_max), 800.0, 2200.0)
                self._table[f"{name}_REVERSED"] = (0.0, 0.0, 1.0)
        if (motor := surfaces.throttle) is not None:
            for prefix in ("RC", "SERVO"):
                name = f"{prefix}{motor.channel}"
                self._table[f"{name}_MIN"] = (float(motor.pwm_min), 800.0, 2200.0)
                self._table[f"{name}_MAX"] = (float(motor.pwm_max), 800.0, 2200.0)
        self.names = tuple(self._table)
        for name, value in (values or {}).items():
            if not self.set(name, value):
                raise ValueError(
                    f"autopilot parameter {name} = {value}: no such parameter or out of range;"
                    f" there are {', '.join(self.names)}"
                )

    def __getitem__(self, name: str) -> float:
        return self._table[name][0]

    def __contains__(self, name: str) -> bool:
        return name in self._table

    def set(self, name: str, value: float) -> bool:
        """Set a value; False where the name is unknown or the value cannot be."""
        if name not in self._table or not isfinite(value):
            return False
        before, low, high = self._table[name]
        if not low <= value <= high:
            return False
        self._table[name] = (value, low, high)
        prefix = name.rpartition("_")[0]
        if f"{prefix}_TRIM" in self._table and not self._ordered(prefix):
            self._table[name] = (before, low, high)
            return False
        return True

    def wire_type(self, name: str) -> int:
        """MAV_PARAM_TYPE of a parameter; the value is sent as a float all the same."""
        if name == "RC_OVERRIDE_TIME":
            return int(mavlink.MAV_PARAM_TYPE_REAL32)
        if name == "VISO_TYPE" or name.endswith("_REVERSED"):
            return int(mavlink.MAV_PARAM_TYPE_INT8)
        return int(mavlink.MAV_PARAM_TYPE_INT16)

    def calibration(self, prefix: str) -> tuple[float, float, float, bool]:
        """Minimum, trim, maximum and reversal of "RC1", "SERVO1", …"""
        return (
            self[f"{prefix}_MIN"],
            self[f"{prefix}_TRIM"],
            self[f"{prefix}_MAX"],
            self[f"{prefix}_REVERSED"] != 0.0,
        )

    def _ordered(self, prefix: str) -> bool:
        low, trim, high, _ = self.calibration(prefix)
        return low < trim < high

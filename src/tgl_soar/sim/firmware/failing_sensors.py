"""Sensors of a firmware that fail: what stands between what they read and what the firmware gets.

    FirmwareSensors.read ──Readings──► FailingSensors.of ──Readings──► the firmware

PX4 takes all readings from us.  What its own MAV_CMD_INJECT_FAILURE does to a sensor, withhold or
repeat our messages where they arrive, is the same; that knows neither a receiver without a fix nor
an error that is small.  ArduPlane's simulator makes its sensors itself, and has parameters for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from tgl_soar.config.site import HomePosition
from tgl_soar.sim.faults import FIRMWARE_SENSORS, Fault
from tgl_soar.sim.firmware.sensors import (
    GpsPlace,
    Readings,
    height_of_pressure_m,
    pressure_pa,
)
from tgl_soar.sim.sensor_messages import geodetic
from tgl_soar.sim.sensors import Triple

GAUSS_PER_MILLIGAUSS: Final = 1e-3
STANDS: Final = (0.0, 0.0, 0.0)


class FailingSensors:
    """The faults of one flight's sensors."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self.faults = tuple(fault for fault in faults if fault.kind.name in FIRMWARE_SENSORS)
        self._fixed: GpsPlace | None = None  # the last fix

    def of(self, readings: Readings) -> Readings:
        """What arrives of the readings of a step."""
        lost = False
        for fault in self.faults:
            if fault.acts(readings.time_s):
                lost |= fault.kind.name == "satellites.lost"
                readings = _failed(readings, fault)
        if readings.gps is None:
            return readings
        if not lost:
            self._fixed = readings.gps
            return readings
        last = self._fixed or readings.gps
        return readings._replace(gps=last._replace(velocity_ned_mps=STANDS), gps_fixed=False)


def _failed(readings: Readings, fault: Fault) -> Readings:
    """Readings with one fault."""
    name = fault.kind.name
    if name == "satellites.silent":
        return readings._replace(gps=None)
    if name == "satellites.bias" and readings.gps is not None:
        latitude_deg, longitude_deg, altitude_m, velocity = readings.gps
        place = HomePosition(latitude_deg, longitude_deg, altitude_m)
        return readings._replace(gps=GpsPlace(*geodetic(place, *fault.offsets), velocity))
    if name == "barometer.silent":
        return readings._replace(pressure_pa=None)
    if name == "barometer.drift" and readings.pressure_pa is not None:
        drift_m = fault["by"] * (readings.time_s - fault.start_s)
        height_m = height_of_pressure_m(readings.pressure_pa) + drift_m
        return readings._replace(pressure_pa=pressure_pa(height_m), height_m=height_m)
    if name == "compass.silent":
        return readings._replace(magnetic_frd_gauss=None)
    if name == "compass.bias" and readings.magnetic_frd_gauss is not None:
        gauss = _added(readings.magnetic_frd_gauss, fault, GAUSS_PER_MILLIGAUSS)
        return readings._replace(magnetic_frd_gauss=gauss)
    if name == "accelerometer.bias":
        return readings._replace(force_frd_mps2=_added(readings.force_frd_mps2, fault, 1.0))
    return readings


def _added(vector: Triple, fault: Fault, unit: float) -> Triple:
    x, y, z = fault.offsets
    return vector[0] + unit * x, vector[1] + unit * y, vector[2] + unit * z

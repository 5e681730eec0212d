"""A compiled flight that somebody in plain Python looks at now and then, and may give other laws.

What flies lies in cells between two looks, so that nothing of it is handed over and taken back.
"""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.air.field import FloatArray
from tgl_soar.control.laws import Laws
from tgl_soar.control.target_line import LineTracking
from tgl_soar.sim.aircraft import AircraftState
from tgl_soar.sim.flight import Flight, fly_to_look
from tgl_soar.sim.world_step import Cell, Parts
from tgl_soar.types import VehicleState


class Looked(NamedTuple):
    """How a flight stands, and what the module would report at this instant."""

    steps: int
    standing: int  # FLIES, CRASHED or HANDED_OVER
    reason: int  # of the last tick
    aircraft: AircraftState  # the truth
    active: bool
    forecast: int  # how it stands, as control.forecast numbers it
    vehicle: VehicleState
    line: LineTracking
    pushed_mps: float  # the climb that a propeller gives


def fly_to_look_in_cells(
    parts_cell: Cell,
    laws_cell: Cell,
    flight_cell: Cell,
    until_step: int,
    target_changes: int,
    rows: FloatArray,
) -> Looked:
    """`fly_to_look`, compiled, for a caller in plain Python."""
    parts: Parts = parts_cell.value
    laws: Laws = laws_cell.value
    flight: Flight = flight_cell.value
    flight, output = fly_to_look(parts, laws, flight, until_step, target_changes, rows)
    flight_cell.value = flight
    return Looked(
        steps=flight.steps,
        standing=flight.standing,
        reason=flight.reason,
        aircraft=flight.world.aircraft,
        active=output.active,
        forecast=output.forecast.standing,
        vehicle=output.vehicle,
        line=output.line,
        pushed_mps=output.throttle.climb_mps,
    )

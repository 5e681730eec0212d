"""Aircraft in a field that is asked at every step, without a world around them."""

from __future__ import annotations

from collections.abc import Callable

from tgl_soar.sim.aircraft import AircraftModel, AircraftState, Wind, place_ahead, step
from tgl_soar.types import SurfaceCommand

WindAt = Callable[[float, float, float, float], Wind]  # of x, y, z [m] and time [s]


def step_in_field(
    model: AircraftModel,
    state: AircraftState,
    surfaces: SurfaceCommand,
    wind_at: WindAt,
    time_s: float,
    dt_s: float,
) -> AircraftState:
    """`step` with both winds asked of a field, `wind_at(x, y, z, time) -> (u, v, w)`."""
    x, y, z = place_ahead(state, dt_s)
    return step(
        model,
        state,
        surfaces,
        wind_at(state.x_m, state.y_m, state.z_m, time_s),
        wind_at(x, y, z, time_s + dt_s),
        dt_s,
    )

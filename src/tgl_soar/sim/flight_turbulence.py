"""The turbulence of one flight: its coefficients, its white noise, how it stands at the start."""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.air.gusts import (
    DRYDEN_STILL,
    NO_ROLL_GUST,
    DrydenParams,
    DrydenState,
    dryden_params,
    roll_gust_params,
)
from tgl_soar.sim.white_noise import NO_ROWS, roll_gusts_as_needed, turbulence_as_needed
from tgl_soar.sim.world_step import FlownTurbulence


class FlightTurbulence(NamedTuple):
    """What blows, and what it is at the start."""

    turbulence: FlownTurbulence
    eddies: DrydenState
    roll_gust_radps: float


CALM: Final = FlightTurbulence(
    FlownTurbulence(
        blows=False,
        params=DrydenParams(1.0, 0.0, 0.0, 0.0),
        white=NO_ROWS,
        rolls=NO_ROLL_GUST,
        rolling=NO_ROWS,
    ),
    DRYDEN_STILL,
    0.0,
)


def flight_turbulence(
    intensity: float,
    wind_mps: float,
    scale_m: float,
    span_m: float | None,
    dt_s: float,
    seed: int,
) -> FlightTurbulence:
    """Drawn as it is needed, by a seed.

    intensity: Dryden's, as a fraction of the reference wind; 0: it is calm.  span_m: of the
    aircraft that it rolls; None: it does not.  Errors: as `dryden_params` and `roll_gust_params`.
    """
    if not intensity > 0.0:
        return CALM
    params = dryden_params(intensity, wind_mps, scale_m, dt_s)
    eddies, white = turbulence_as_needed(params, seed)
    rolls = NO_ROLL_GUST
    if span_m is not None:
        rolls = roll_gust_params(intensity, wind_mps, scale_m, span_m, dt_s)
    roll_gust, rolling = roll_gusts_as_needed(rolls, seed)
    blown = FlownTurbulence(blows=True, params=params, white=white, rolls=rolls, rolling=rolling)
    return FlightTurbulence(blown, eddies, roll_gust)

"""The airspeed's error, by turning: what straight flight cannot tell.

Without a pitot tube the airspeed follows from lift and attitude.  An attitude that reads the nose
too low by two degrees makes it 1 to 2.5 m/s too high, and nothing in straight flight contradicts:
lift, sink and the polar fit the wrong speed in another wind.  A nose that turns does contradict:

    v_y = c + (V + d) s,    s = L sin psi          L: a first order of NOSE_S
    hence  v_y − L (V sin psi) = c + d s           a straight line over s, of slope d

v_y  m/s  velocity over the ground along the soaring frame's y
psi  rad  heading of the nose, from straight upwind, positive to the right
V    m/s  the airspeed's estimate
d    m/s  its error: the true one less the estimate
c    m/s  the wind across, and whatever else does not turn with the nose

L is how the path follows the nose: the wing banks, the fin takes out the sideslip.

c and d are the least squares of all ticks, those of FADE_S ago weighted by 1 / e, beside what was
expected of d before: none, with a standard deviation of SPREAD_MPS.  Gusts across of GUST_MPS last
for GUST_S, so that a tick of dt counts as dt / (2 GUST_S) of an independent measurement.  With
sums of the weights w, w s, w s², w y, w s y, y being the left side,

    sigma² = 1 / (A + 1 / SPREAD²)        A = W_ss − W_s² / W
    d      = sigma² (W_sy − W_s W_y / W)

A nose that does not turn has no A, and d stays none.
"""

from __future__ import annotations

from math import exp, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.types import NAN, AirEstimate, VehicleState, isfinite

NOSE_S: Final = 0.6  # as flown weaves have it: 0.57 without accelerometers, 0.7 with
FADE_S: Final = 10.0  # a weave there and back; the error changes with the incidence
SPREAD_MPS: Final = 1.5  # 2 degrees of attitude and 10 % of lift
GUST_MPS: Final = 0.3  # 4 % of 7 m/s
GUST_S: Final = 0.6  # eddies of 5 m at 9 m/s
APART_MPS: Final = 30.0  # at most, of v_y: no wind across in which anything of this size flies
ERROR_MPS: Final = 2.0 * SPREAD_MPS  # at most: the rest is no misread attitude


class AirspeedErrorState(NamedTuple):
    """What is remembered of the turns so far."""

    nose: float  # s; NaN: none yet
    sideways_mps: float  # L (V sin psi)
    weight: float  # W, in s²/m², as the others are
    by_nose: float  # W_s
    by_nose2: float  # W_ss
    by_speed: float  # W_y
    by_both: float  # W_sy


NO_AIRSPEED_ERROR: Final = AirspeedErrorState(
    nose=NAN,
    sideways_mps=NAN,
    weight=0.0,
    by_nose=0.0,
    by_nose2=0.0,
    by_speed=0.0,
    by_both=0.0,
)


def airspeed_error_step(
    state: AirspeedErrorState, vehicle: VehicleState, airspeed_mps: float, dt_s: float
) -> AirspeedErrorState:
    """One tick.  airspeed_mps: as estimated; where anything is not known the state stays."""
    known = vehicle.heading_rad + vehicle.velocity_y_mps + airspeed_mps
    if not (isfinite(known) and dt_s > 0.0):
        return state
    nose = sin(vehicle.heading_rad)
    sideways = airspeed_mps * nose
    if isfinite(state.nose):  # not the first
        follows = 1.0 - exp(-dt_s / NOSE_S)
        nose = state.nose + follows * (nose - state.nose)
        sideways = state.sideways_mps + follows * (sideways - state.sideways_mps)
    keeps = exp(-dt_s / FADE_S)
    counts = dt_s / (2.0 * GUST_S * GUST_MPS * GUST_MPS)
    unlike = vehicle.velocity_y_mps - sideways
    if not abs(unlike) < APART_MPS:
        return state
    return AirspeedErrorState(
        nose=nose,
        sideways_mps=sideways,
        weight=keeps * state.weight + counts,
        by_nose=keeps * state.by_nose + counts * nose,
        by_nose2=keeps * state.by_nose2 + counts * nose * nose,
        by_speed=keeps * state.by_speed + counts * unlike,
        by_both=keeps * state.by_both + counts * nose * unlike,
    )


def error_variance(state: AirspeedErrorState) -> float:
    """sigma² [m²/s²] of d."""
    information = 0.0
    if state.weight > 0.0:
        information = max(0.0, state.by_nose2 - state.by_nose * state.by_nose / state.weight)
    return 1.0 / (information + 1.0 / (SPREAD_MPS * SPREAD_MPS))


def airspeed_error(state: AirspeedErrorState) -> float:
    """d [m/s]: the true airspeed less the estimate."""
    if not state.weight > 0.0:
        return 0.0
    slope = state.by_both - state.by_nose * state.by_speed / state.weight
    return max(-ERROR_MPS, min(ERROR_MPS, error_variance(state) * slope))


def error_sigma(state: AirspeedErrorState) -> float:
    """sigma [m/s] of d."""
    return sqrt(error_variance(state))


def airspeed_sigma(state: AirspeedErrorState, air: AirEstimate) -> float:
    """Standard deviation [m/s] of the airspeed; 0: it is measured, which turns tell nothing of."""
    return 0.0 if air.measured else error_sigma(state)


def corrected_air(state: AirspeedErrorState, air: AirEstimate) -> AirEstimate:
    """The air with an airspeed that is no faster than turns have shown, and a wind less by as much:
    the ground velocity is measured."""
    if air.measured:
        return air
    error = min(0.0, airspeed_error(state))
    return air._replace(airspeed_mps=air.airspeed_mps + error, wind_mps=air.wind_mps + error)

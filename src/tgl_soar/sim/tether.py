"""A tether from the aircraft to a fixed point: a force while it is taut, and nothing else.

    r = x − anchor      s = |r| − length      a = −(k s + c ds/dt) r / |r| / m,   s > 0 and a pull

k      N/m     stiffness of the whole line        c    N s/m    what the line takes of a stretching
s      m       how far it is stretched            m    kg       the aircraft

It holds at the centre of gravity, so that it turns nothing, and it can only pull.  The line has no
weight and no drag of its own: what it drags is part of the airframe's own (see CD0 of the shipped
airframe).  The damping is half of what would keep the stretched line from swinging.
"""

from __future__ import annotations

from math import sqrt
from typing import Final, NamedTuple

from tgl_soar.geometry import in_body_axes
from tgl_soar.sim.aircraft import AircraftState

_DAMPING: Final = 0.5  # of the critical: a braided line, whose fibres rub


class TetherParams(NamedTuple):
    """A tether of one aircraft, soaring frame."""

    is_there: bool
    anchor_x_m: float
    anchor_y_m: float
    anchor_z_m: float
    length_m: float
    stiffness_per_s2: float  # k / m
    damping_per_s: float  # c / m


NO_TETHER: Final = TetherParams(
    is_there=False,
    anchor_x_m=0.0,
    anchor_y_m=0.0,
    anchor_z_m=0.0,
    length_m=0.0,
    stiffness_per_s2=0.0,
    damping_per_s=0.0,
)
NO_PULL: Final = (0.0, 0.0, 0.0)


def tether_params(
    anchor_m: tuple[float, float, float], length_m: float, stiffness_npm: float, mass_kg: float
) -> TetherParams:
    """A tether of an aircraft of some mass."""
    stiffness = stiffness_npm / mass_kg
    return TetherParams(
        is_there=True,
        anchor_x_m=anchor_m[0],
        anchor_y_m=anchor_m[1],
        anchor_z_m=anchor_m[2],
        length_m=length_m,
        stiffness_per_s2=stiffness,
        damping_per_s=2.0 * _DAMPING * sqrt(stiffness),
    )


def tether_pull(tether: TetherParams, state: AircraftState) -> tuple[float, float, float]:
    """What the tether accelerates the aircraft by [m/s², soaring frame]; zero while it is slack."""
    if not tether.is_there:
        return NO_PULL
    x = state.x_m - tether.anchor_x_m
    y = state.y_m - tether.anchor_y_m
    z = state.z_m - tether.anchor_z_m
    distance = sqrt(x * x + y * y + z * z)
    stretched = distance - tether.length_m
    if not stretched > 0.0:
        return NO_PULL
    outward = (
        x * state.velocity_x_mps + y * state.velocity_y_mps + z * state.velocity_z_mps
    ) / distance
    pull = tether.stiffness_per_s2 * stretched + tether.damping_per_s * outward
    per_metre = -max(0.0, pull) / distance
    return x * per_metre, y * per_metre, z * per_metre


def pulled(
    state: AircraftState, pull_mps2: tuple[float, float, float], dt_s: float
) -> AircraftState:
    """The aircraft after it has been pulled for `dt_s` [s]."""
    return state._replace(
        velocity_x_mps=state.velocity_x_mps + pull_mps2[0] * dt_s,
        velocity_y_mps=state.velocity_y_mps + pull_mps2[1] * dt_s,
        velocity_z_mps=state.velocity_z_mps + pull_mps2[2] * dt_s,
    )


def pull_frd(
    state: AircraftState, pull_mps2: tuple[float, float, float]
) -> tuple[float, float, float]:
    """A pull [m/s², soaring frame] along the body's axes, as accelerometers feel it."""
    return in_body_axes(
        state.qw, state.qx, state.qy, state.qz, -pull_mps2[0], pull_mps2[1], -pull_mps2[2]
    )

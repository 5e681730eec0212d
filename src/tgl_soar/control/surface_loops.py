"""From the setpoints to surface deflections within the envelope.

Where the firmware's own loops hold pitch and bank, ours rest, and what is known of the surfaces
that it moves is what it reports of them.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.envelope import Limited, elevator_limit, limit_surfaces
from tgl_soar.control.heading import HeadingGains, heading_step
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidGains, PidState, PidTerms
from tgl_soar.types import (
    NAN,
    OURS,
    THEIRS,
    Setpoints,
    SurfaceCommand,
    SurfacesSample,
    VehicleState,
)

TRAVEL_END: Final = 0.98  # of travel: a surface read back from here on can go no further
NO_TERMS: Final = PidTerms(output=NAN, p=NAN, i=NAN, d=NAN, feedforward=NAN, saturated=0)


class LoopsState(NamedTuple):
    """What the loops of the surfaces remember, and the last command."""

    pitch: PidState
    roll: PidState
    heading: PidState
    limited: Limited


class SurfaceGains(NamedTuple):
    """The gains that the loops fly with, as they are scheduled."""

    pitch: PidGains
    roll: PidGains
    heading: HeadingGains


class SurfaceTerms(NamedTuple):
    """What each surface's deflection is made of."""

    elevator: PidTerms
    aileron: PidTerms
    rudder: PidTerms


def surfaces_step(
    laws: Laws,
    gains: SurfaceGains,
    state: LoopsState,
    vehicle: VehicleState,
    setpoints: Setpoints,
    stall_rad: float,
    surfaces: SurfacesSample,
    dt_s: float,
) -> tuple[LoopsState, SurfaceTerms]:
    """One step.

    stall_rad: the margin of the angle of attack; surfaces: as they are read back.
    """
    trim = laws.trim
    pitch, roll = state.pitch, state.roll
    elevator_terms = aileron_terms = NO_TERMS
    if laws.loops == OURS:
        pitch, elevator_terms = attitude_step(
            gains.pitch,
            state.pitch,
            setpoints.pitch_rad,
            vehicle.pitch_rad,
            vehicle.pitch_rate_radps,
            trim.elevator,
            dt_s,
            state.limited.elevator_blocked,
        )
        roll, aileron_terms = attitude_step(
            gains.roll,
            state.roll,
            setpoints.roll_rad,
            vehicle.roll_rad,
            vehicle.roll_rate_radps,
            trim.aileron,
            dt_s,
            state.limited.aileron_blocked,
        )
    heading, rudder_terms = heading_step(
        gains.heading,
        state.heading,
        setpoints.heading_rad,
        vehicle.heading_rad,
        vehicle.heading_rate_radps,
        trim.rudder,
        dt_s,
    )
    wanted = SurfaceCommand(elevator_terms.output, aileron_terms.output, rudder_terms.output)
    if laws.loops != OURS:
        wanted = SurfaceCommand(trim.elevator, trim.aileron, rudder_terms.output)
    limited = limit_surfaces(
        laws.envelope,
        state.limited.command,
        wanted,
        elevator_limit(laws.envelope, trim.elevator, stall_rad),
        True,
        dt_s,
    )
    if laws.loops != OURS:
        limited = _left_to_firmware(limited, laws.loops, surfaces)
    loops = LoopsState(pitch, roll, heading, limited)
    return loops, SurfaceTerms(elevator_terms, aileron_terms, rudder_terms)


def _left_to_firmware(limited: Limited, loops: int, surfaces: SurfacesSample) -> Limited:
    """What is known of surfaces that the firmware's own loops move: where it says that they are.

    Without them the pitch is taken to follow its setpoint.
    """
    blocked = 0
    if surfaces.elevator >= TRAVEL_END:  # false for NaN
        blocked = 1
    elif surfaces.elevator <= -TRAVEL_END:
        blocked = -1
    rudder = limited.command.rudder if loops != THEIRS else NAN
    return Limited(
        command=SurfaceCommand(NAN, NAN, rudder),
        elevator_blocked=blocked,
        aileron_blocked=0,
        finite=limited.finite,
        cut=limited.cut,
    )

"""Airspeed by pitch, for a glide that follows no line: the way home, and beating along the ridge.

    theta_sp = theta_glide(V_sp) + KP (V − V_sp) + KI ∫ (V − V_sp) dt

Held pitch alone brings V to its place in 3.6 s (a rate of 2 g alpha / V); KP makes 1.5 s of that,
KI a wrong theta_glide good in 4 s, damped by 0.8.  An airspeed that no pitot tube measures may
lower the nose by this and not raise it above theta_glide of the slowest V: drag that nobody knows
of looks like speed, in a weave and near the stall, and to slow down for it is how a stall begins,
while a pitch is certain to some tenths of a degree and keeps V by itself.

**The elevator tells the incidence** that no airspeed does.  A wing that carries less than its file
says, and an attitude that reads too low, let the aircraft slow down unseen; what it takes to hold
the nose up they do not change.  Where V is not measured the nose goes down by as much as the
elevator holds more than the slowest approach's angle of attack, averaged over INCIDENCE_S:

    theta_sp −= max(0, alpha_t − alpha_max)        alpha_t: `aerodynamics.trim_alpha`

alpha_max: of the slowest approach, 3 degrees below the shipped wing's stall, or more by as much as
the moments of the file read too high at the trim of the elevator.  A centre of gravity that is off
by 2 % of the chord makes 1.8 degrees of alpha_t.

**A stall** that came all the same is detected by the elevator: as far up as it may go while the
nose stays below its setpoint and the aircraft sinks faster than any glide at the slowest V.  Then
the nose goes down to the pitch of the fastest glide for RECOVER_S, where no wing stays stalled.
"""

from __future__ import annotations

from math import exp
from typing import Final, NamedTuple

from tgl_soar.control.airspeed_error import NO_AIRSPEED_ERROR, AirspeedErrorState
from tgl_soar.types import NAN, AirEstimate, VehicleState

KP: Final = 0.05  # rad for each m/s
KI: Final = 0.015  # rad for each m
INTEGRAL_MAX_RAD: Final = 0.1
GAIN_MPS2: Final = 1.5  # of the speed's setpoint: 0.15 g, 9 degrees of path
AVERAGE_S: Final = 3.0  # of the sink: an eddy of some metres is over in a second, a turn in two
# A stall. Gusts of 10 % take the elevator to its end for some tenths of a second, and the nose
# comes up then; a loop that follows its setpoint is off it by a degree. Twice that, for as long as
# the pitch takes to follow (ELE_P, 0.2 s) and as much again.
STALL_S: Final = 0.5
STALL_RAD: Final = 0.035
STALL_SINK_MPS: Final = 0.5  # more than the glide: sink that a gust makes is half of it
# From a stall at 6 m/s, sinking by 4: it falls on at 1.5 m/s^2 or more for each second that the
# nose is down, and flies again from 7.6 m/s on.
RECOVER_S: Final = 1.5
INCIDENCE_S: Final = 0.5  # the short period, and gusts of some metres, are over in that


class GlideState(NamedTuple):
    """What a glide without a line remembers."""

    speed_mps: float  # its setpoint; NaN: it does not glide
    integral_rad: float
    flares: bool  # it is near the ground
    weave_rad: float  # heading from the wind, to the right; 0: it flies straight
    goes_right: bool  # from side to side
    sink_mps: float  # over the ground, averaged; NaN: not yet
    trim_alpha_rad: float  # that the elevator holds, averaged; NaN: not known
    stalling_s: float  # for so long it has looked like a stall
    recovers_s: float  # so long the nose stays down
    stalled: bool  # it has, on this glide
    airspeed_error: AirspeedErrorState  # as turns have shown it, where it is not measured
    from_high: bool  # it has come from more than HIGH_M over the landing's straight rest


class GlidePitches(NamedTuple):
    """theta_glide at three airspeeds, and the largest angle of attack; NaN: not known."""

    wanted_rad: float  # of the setpoint's
    slowest_rad: float
    fastest_rad: float
    most_alpha_rad: float  # that the elevator may hold where no airspeed is measured


class GlideSetpoints(NamedTuple):
    """What a glide without a line asks of the attitude loops."""

    pitch_rad: float
    heading_rad: float  # from straight upwind of the frame
    sideways_mps: float  # over the ground, to the right; NaN: wings level
    steeper: float  # by so much of itself the largest bank may be more


NO_GLIDE: Final = GlideState(
    speed_mps=NAN,
    integral_rad=0.0,
    flares=False,
    weave_rad=0.0,
    goes_right=True,
    sink_mps=NAN,
    trim_alpha_rad=NAN,
    stalling_s=0.0,
    recovers_s=0.0,
    stalled=False,
    airspeed_error=NO_AIRSPEED_ERROR,
    from_high=False,
)


def speed_setpoint(
    state: GlideState, airspeed_mps: float, low_mps: float, high_mps: float, wanted_mps: float
) -> float:
    """The airspeed asked for [m/s]; a glide that begins goes on from the airspeed that it has."""
    speed = state.speed_mps
    if speed != speed:
        speed = airspeed_mps if airspeed_mps == airspeed_mps else wanted_mps
        return max(low_mps, min(high_mps, speed)) if high_mps > low_mps else wanted_mps
    return speed


def hold_step(
    state: GlideState,
    speed_mps: float,
    wanted_mps: float,
    flares: bool,
    airspeed_mps: float,
    dt_s: float,
) -> GlideState:
    """One tick: the setpoint goes from a speed towards what is wanted, and V is brought to it."""
    most = GAIN_MPS2 * dt_s
    speed = speed_mps + max(-most, min(most, wanted_mps - speed_mps))
    error, integral = airspeed_mps - speed, state.integral_rad
    if error == error and not flares and state.recovers_s <= 0.0:
        integral = max(-INTEGRAL_MAX_RAD, min(INTEGRAL_MAX_RAD, integral + KI * error * dt_s))
    return state._replace(speed_mps=speed, integral_rad=integral, flares=flares)


def glide_pitch_held(state: GlideState, pitches: GlidePitches, unknown_rad: float) -> float:
    """theta_glide of the setpoint with what was learnt; unknown_rad: where it is not known."""
    known = pitches.wanted_rad == pitches.wanted_rad  # not NaN
    return (pitches.wanted_rad if known else unknown_rad) + state.integral_rad


def speed_pitch(
    state: GlideState,
    pitches: GlidePitches,
    unknown_rad: float,
    airspeed_mps: float,
    measured: bool,
) -> float:
    """theta_sp [rad]."""
    pitch = glide_pitch_held(state, pitches, unknown_rad)
    if airspeed_mps == airspeed_mps:
        pitch += KP * (airspeed_mps - state.speed_mps)
    if not measured and pitch > pitches.slowest_rad:  # false for NaN
        pitch = pitches.slowest_rad
    if not measured and state.trim_alpha_rad > pitches.most_alpha_rad:  # false for NaN
        pitch -= state.trim_alpha_rad - pitches.most_alpha_rad
    if state.recovers_s > 0.0:
        fastest = pitches.fastest_rad
        pitch = min(pitch, fastest if fastest == fastest else unknown_rad)
    return pitch


def incidence_step(state: GlideState, air: AirEstimate, dt_s: float) -> GlideState:
    """The angle of attack that the elevator holds, averaged, from the estimate's on; where it is
    not known it is forgotten."""
    held = state.trim_alpha_rad if state.trim_alpha_rad == state.trim_alpha_rad else air.alpha_rad
    held += (1.0 - exp(-dt_s / INCIDENCE_S)) * (air.trim_alpha_rad - held)
    return state._replace(trim_alpha_rad=held)


def stall_step(
    state: GlideState,
    glide_sink_mps: float,
    position_ok: bool,
    nose_held: bool,
    vehicle: VehicleState,
    dt_s: float,
) -> GlideState:
    """How it sinks, and whether that is a stall; a flare is none.

    glide_sink_mps: of the slowest V.  nose_held: it stays below its setpoint with all of the
    elevator that there is.  Where the sink is not known, or no glide's, the nose alone tells.
    """
    now = -vehicle.climb_mps
    sinks = state.sink_mps
    sinks = sinks + (1.0 - exp(-dt_s / AVERAGE_S)) * (now - sinks) if sinks == sinks else now
    falls = not position_ok or not now <= glide_sink_mps + STALL_SINK_MPS  # true for NaN
    looks = nose_held and falls and state.recovers_s <= 0.0 and not state.flares
    stalling_s = max(0.0, state.stalling_s + (dt_s if looks else -dt_s))
    recovers_s = max(0.0, state.recovers_s - dt_s)
    stalled = state.stalled
    if stalling_s >= STALL_S:
        stalling_s, recovers_s, stalled = 0.0, RECOVER_S, True
    return state._replace(
        sink_mps=sinks, stalling_s=stalling_s, recovers_s=recovers_s, stalled=stalled
    )

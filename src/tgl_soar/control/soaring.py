"""Soaring: e_rho to the pitch setpoint (eq. 15).

    theta_sp = theta_0 + kp e_rho + ki ∫ e_rho dt + kd de_rho/dt

Upstream of the line (e_rho > 0) the nose goes up, the aircraft slows and drifts back.
de_rho/dt is the aircraft's velocity across the line less the line's own.  The setpoint is
limited in value, because below the trim pitch's maximum holding a pitch runs away into the
stall, and in rate.

theta_0 is a constant, or moves towards the pitch of a steady glide at the local wind's speed,
slowly (first order, `trim_s`), so that nothing steps; gusts of updraft w' beyond the slow one
may be met by the incidence that they make:

    d theta_0/dt = (trim + fraction (theta_glide − trim) − theta_0) / trim_s
    theta_gust   = −gust_fraction w' / V
"""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.control.pid import PidGains, PidState, PidTerms, pid_reset, pid_step
from tgl_soar.types import NAN, isfinite


class SoaringGains(NamedTuple):
    """Parameters of the law; the loop's output is a pitch in rad, its error in m."""

    pid: PidGains
    slew_radps: float


class SoaringState(NamedTuple):
    """What the law remembers."""

    pid: PidState
    pitch_setpoint_rad: float
    slewing: int  # +1 or -1 while rate limit or envelope hold the setpoint back, else 0


class TrimGains(NamedTuple):
    """What theta_0 is made of."""

    trim_pitch_rad: float
    fraction: float  # of the glide's pitch in it, 0 … 1
    trim_s: float  # time in which theta_0 follows
    gust_fraction: float  # of a gust's incidence that is taken out, 0 … 1


class TrimState(NamedTuple):
    """What slowly changes."""

    pitch_rad: float  # theta_0; NaN: not begun
    updraft_mps: float  # the slow updraft; NaN: not known yet


def trim_step(
    gains: TrimGains,
    state: TrimState,
    glide_pitch_rad: float,
    updraft_mps: float,
    airspeed_mps: float,
    dt_s: float,
) -> tuple[TrimState, float]:
    """One step; also theta_gust.  What is NaN is not known: theta_0 stays, and no gust is met."""
    blend = dt_s / (gains.trim_s + dt_s)
    wanted = gains.trim_pitch_rad
    if gains.fraction > 0.0:
        wanted += gains.fraction * (glide_pitch_rad - gains.trim_pitch_rad)
    pitch = state.pitch_rad
    if not isfinite(pitch):
        pitch = wanted if isfinite(wanted) else gains.trim_pitch_rad
    elif isfinite(wanted):
        pitch += blend * (wanted - pitch)
    if not (isfinite(updraft_mps) and airspeed_mps > 1.0):
        return TrimState(pitch, NAN), 0.0
    slow = updraft_mps
    if isfinite(state.updraft_mps):
        slow = state.updraft_mps + blend * (updraft_mps - state.updraft_mps)
    return TrimState(pitch, slow), -gains.gust_fraction * (updraft_mps - slow) / airspeed_mps


def soaring_step(
    gains: SoaringGains,
    state: SoaringState,
    trim_pitch_rad: float,
    e_rho_m: float,
    e_rho_rate_mps: float,
    dt_s: float,
    blocked: int,
) -> tuple[SoaringState, PidTerms]:
    """One step.

    trim_pitch_rad: theta_0; blocked: +1 if the aircraft cannot pitch further up now, -1 down,
    else 0.
    """
    held = blocked if blocked != 0 else state.slewing
    pid, terms = pid_step(gains.pid, state.pid, e_rho_m, e_rho_rate_mps, trim_pitch_rad, dt_s, held)
    return _slewed(gains, pid, state.pitch_setpoint_rad, terms.output, dt_s), terms


def holding_step(
    gains: SoaringGains, state: SoaringState, trim_pitch_rad: float, dt_s: float
) -> tuple[SoaringState, PidTerms]:
    """One step without a position: towards the pitch that holds the line when undisturbed."""
    integral = state.pid.integral
    pitch = trim_pitch_rad + integral
    pitch = max(gains.pid.output_min, min(gains.pid.output_max, pitch))
    terms = PidTerms(
        output=pitch, p=0.0, i=integral, d=0.0, feedforward=trim_pitch_rad, saturated=0
    )
    return _slewed(gains, PidState(integral, 0.0), state.pitch_setpoint_rad, pitch, dt_s), terms


def gliding_step(
    gains: SoaringGains, state: SoaringState, pitch_rad: float, dt_s: float
) -> tuple[SoaringState, PidTerms]:
    """One step while recovering: towards a given pitch, with what the integral has learnt kept."""
    integral = state.pid.integral
    pitch = max(gains.pid.output_min, min(gains.pid.output_max, pitch_rad))
    terms = PidTerms(output=pitch, p=0.0, i=0.0, d=0.0, feedforward=pitch, saturated=0)
    return _slewed(gains, PidState(integral, 0.0), state.pitch_setpoint_rad, pitch, dt_s), terms


def _slewed(
    gains: SoaringGains, pid: PidState, setpoint_rad: float, wanted_rad: float, dt_s: float
) -> SoaringState:
    """The setpoint moved towards the wanted pitch, no faster than its slew rate."""
    most = gains.slew_radps * dt_s
    change = wanted_rad - setpoint_rad
    slewing = 0
    if change > most:
        change, slewing = most, 1
    elif change < -most:
        change, slewing = -most, -1
    return SoaringState(pid, setpoint_rad + change, slewing)


def soaring_reset(
    gains: SoaringGains, trim_pitch_rad: float, e_rho_rate_mps: float, pitch_rad: float
) -> SoaringState:
    """The state in which the setpoint starts at the pitch that is flown now, within limits.

    That pitch is also the best guess of the one that will hold the line.
    """
    pitch = max(gains.pid.output_min, min(gains.pid.output_max, pitch_rad))
    return SoaringState(pid_reset(gains.pid, e_rho_rate_mps, trim_pitch_rad, pitch), pitch, 0)

"""A multisine on the pitch setpoint, by which the loop shows its margins in flight.

    theta_sp' = theta_sp + A w(t) / peak * sum_k cos(2 pi n_k (t - LEAD_S) / WINDOW_S + phi_k)

theta_sp   the soaring law's setpoint, before the injection [rad]
A          the largest value of what is added, EXC_AMP [rad]
n_k        whole periods of a tone in the window: each tone is one line of its spectrum, and none
           leaks into another's (2.5 to 18.8 rad/s)
w          0 to 1 in LEAD_S, 1 in the window, back to 0 in TAIL_S, as half a cosine each

Every n_k is a multiple of PERIODS: the window holds PERIODS whole periods of the sum, which differ
by turbulence and noise alone, so that a measurement tells its own uncertainty.

The phases are those of the least peak that a search from sixty random beginnings found: a crest
factor of 1.71.  Schroeder's phases, made for tones side by side, leave 3.09 with tones as far apart
as these, which is half the amplitude of each tone at the same peak.

It runs once for each time that the operator asks, and only while nothing hinders it
(`conditions.excitation_hindrance`); what hinders it ends it in that tick.  The envelope limits the
sum as it limits the setpoint alone.
"""

from __future__ import annotations

from math import cos, pi
from typing import Final, NamedTuple

from tgl_soar.types import NAN

TONES: Final = (8, 12, 20, 28, 40, 60)  # periods in the window
PHASES_RAD: Final[tuple[float, ...]] = (4.762, 5.539, 2.515, 2.368, 3.878, 5.403)
PERIODS: Final = 4  # of the sum in the window
PEAK: Final = 2.96  # of the sum of cosines, rounded up
LEAD_S: Final = 2.0  # the loop settles: ten times the short period's 1 / (zeta omega)
WINDOW_S: Final = 20.0
TAIL_S: Final = 1.0
WHOLE_S: Final = LEAD_S + WINDOW_S + TAIL_S
# A limit of rate that holds for a tick or two delays by as much, as noise makes it do now and then;
# over one radian of the fastest tone it is no small part of the loop any more.
LIMITED_S: Final = 0.05

# How it stands: two of rest, then why it ended or did not begin.
IDLE: Final = 0
RUNNING: Final = 1
DONE: Final = 2
WITHDRAWN: Final = 3
NOT_SOARING: Final = 4
LINE_MOVES: Final = 5
OFF_LINE: Final = 6
BANKED: Final = 7
FAULTY: Final = 8
NEAR_STALL: Final = 9
TOO_LOW: Final = 10
GAINS_CHANGE: Final = 11
LIMITED: Final = 12
CLOCK: Final = 13
EXCITATION_TEXTS: Final = (
    "",
    "",
    "done",
    "by the operator",
    "not soaring",
    "the line moves",
    "too far from the line",
    "too much bank",
    "something has a fault",
    "too near the stall",
    "too low or sinking",
    "accelerations come or go",
    "setpoint or elevator limited",
    "the clock went back",
)


class Excitation(NamedTuple):
    """What the operator asks for."""

    amplitude_rad: float
    wanted: bool


class ExcitationState(NamedTuple):
    """How it stands, and what is added in this tick."""

    begun_s: float  # NaN: it does not run
    amplitude_rad: float  # as it was when it began
    standing: int
    pitch_rad: float  # added to the pitch setpoint; 0 unless it runs
    limited_s: float  # for how long a limit has acted without a break


def at_rest(standing: int) -> ExcitationState:
    """It does not run."""
    return ExcitationState(
        begun_s=NAN, amplitude_rad=0.0, standing=standing, pitch_rad=0.0, limited_s=0.0
    )


def excitation_step(
    requested: Excitation, state: ExcitationState, now_s: float, dt_s: float, hindrance: int
) -> ExcitationState:
    """One step.

    hindrance: what is against it now; IDLE: nothing.  LIMITED counts only once it has lasted.
    Once ended it rests until the operator has withdrawn the request.
    """
    if not requested.wanted:
        return at_rest(WITHDRAWN if state.standing == RUNNING else IDLE)
    limited_s = state.limited_s + dt_s if hindrance == LIMITED else 0.0
    if hindrance == LIMITED and limited_s <= LIMITED_S:
        hindrance = IDLE
    if state.standing == IDLE or state.standing == WITHDRAWN:
        if hindrance != IDLE:
            return at_rest(hindrance)
        return ExcitationState(
            begun_s=now_s,
            amplitude_rad=requested.amplitude_rad,
            standing=RUNNING,
            pitch_rad=0.0,
            limited_s=limited_s,
        )
    if state.standing != RUNNING:
        return state
    elapsed_s = now_s - state.begun_s
    if hindrance == IDLE and not elapsed_s >= 0.0:  # so, NaN ends it as well
        hindrance = CLOCK
    if hindrance != IDLE:
        return at_rest(hindrance)
    if elapsed_s >= WHOLE_S:
        return at_rest(DONE)
    added_rad = state.amplitude_rad * faded(elapsed_s) * multisine(elapsed_s - LEAD_S)
    return state._replace(pitch_rad=added_rad, limited_s=limited_s)


def multisine(time_s: float) -> float:
    """The sum of the tones, -1 … 1, at a time from the window's beginning."""
    turn = 2.0 * pi * time_s / WINDOW_S
    total = 0.0
    for i in range(len(TONES)):
        total += cos(turn * TONES[i] + PHASES_RAD[i])
    return total / PEAK


def faded(elapsed_s: float) -> float:
    """w, 0 … 1, at a time from the beginning of it all."""
    if elapsed_s < LEAD_S:
        return 0.5 - 0.5 * cos(pi * elapsed_s / LEAD_S)
    left_s = WHOLE_S - elapsed_s
    if left_s < TAIL_S:
        return 0.5 - 0.5 * cos(pi * left_s / TAIL_S)
    return 1.0

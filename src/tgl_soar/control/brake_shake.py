"""Whether the brake acts, by shaking it: where accelerations are known and the brake takes lift.

What the law asks for by itself does not tell, for it answers the motion.  A shake of its own that
it does not answer does: A sin φ of SHAKE_HZ is added to the brake, the law goes on beneath it, and
in blocks of BLOCK_S, of whole periods, brake b and vertical acceleration a are multiplied by
sin φ and cos φ and averaged:

    B = 2 <b (sin φ + i cos φ)>,    Y = 2 <(a - <a>) (sin φ + i cos φ)> / (k V² C_Lb GAIN)
    r = Σ Y / Σ B                            k = ρ S / 2 m
    s² = Σ |Y - r B|² / 2 |Σ B|²             its variance, in every direction
    q = |r| cos(arg r + ψ)                   1: it acts; 0: it does not

ψ is the lag of servo, link and lift: where r points, within LAG_LEAST_RAD and LAG_MOST_RAD.  Sums
of B and Y, and not of their products, because the law's own part of B is correlated with the gusts
in Y, and the shake is not.  Where the brake meets an end, or the envelope holds it, B says how much
of the shake is left.

The pitch setpoint and the trim of the elevator do without the shake: else they would
move the aircraft at its frequency where the brake does not.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.control.brake_watch import ACTS, DOES_NOT, NOTHING
from tgl_soar.types import isfinite

# As fast as a servo of some 50 rad/s follows: the gusts' power falls from V / L on, some 2 Hz in
# the tunnel.  Faster, 20 ms of a link cost more than is won.  It moves the aircraft by 0.5 mm.
SHAKE_HZ: Final = 4.0
SHAKEN: Final = 0.2  # A, of the travel
BLOCK_S: Final = 1.0
TICKS_MIN: Final = 32.0  # in a block: eight for each period
# A servo of 54 rad/s leaves 0.91 of 4 Hz, the lift's fade (6 rad/s) 0.97; it turns by 25 degrees,
# less 13 of the lift's, and by 1.4 for each ms of the link and of the accelerations, of which there
# are 0 to 45 within the window.  ArduPlane has some 50: a command is 30 ms on its way to the servo,
# and its accelerations, filtered at 20 Hz and streamed at 90, are known over 20 ms late.  What lies
# beyond the window by δ costs a brake that is well 1 - cos δ of its q: 0.02 there, and it would
# be taken for a jammed one some 40 ms later.
GAIN: Final = 0.88
LAG_LEAST_RAD: Final = 0.2
LAG_MOST_RAD: Final = 1.3
LEAST: Final = 0.4  # as of the other trial: half of what the worst known of C_Lb and lag leave
# A law at an end for a third of the time, or one that swings between both, as with a brake that
# has jammed in gusts; without gusts, or at 1 %, one that is well does not come to it.
PRESSED_S: Final = 10.0
PRESSED: Final = 0.3
# It is looked at after every block from SHAKES_FEWEST on, some five times before a chance would
# have become another: 3.5 of its deviations, of which each is known within a fifth by then.
SHAKES_FEWEST: Final = 16.0
SHAKES_MOST: Final = 150.0
SIGMAS: Final = 3.5
SIGMA_MIN: Final = 0.02  # of q: what is not white
REST_S: Final = 20.0
LIFT_MIN: Final = 0.05  # |C_Lb| that can be measured: 0.1 m/s² of A


class ShakeState(NamedTuple):
    """What is shaken, and what came of it."""

    pressed: float  # share of the time that the law asks for an end of the travel
    rest_s: float  # it is not shaken for as long
    on: bool  # it is shaken now
    shaken: float  # of the brake that is wanted, the shake's part
    climb_mps: float  # in the tick before; NaN: none
    time_s: float  # into this block
    ticks: float  # in this block
    sines: float  # of this block: sum of sin φ
    cosines: float  # sum of cos φ
    rise: float  # sum of a
    rise_sin: float  # sum of a sin φ
    rise_cos: float  # sum of a cos φ
    brake_sin: float  # sum of b sin φ
    brake_cos: float  # sum of b cos φ
    blocks: float  # that count
    b_re: float  # Σ B, real
    b_im: float  # Σ B, imaginary
    y_re: float  # Σ Y, real
    y_im: float  # Σ Y, imaginary
    b_2: float  # Σ |B|²
    y_2: float  # Σ |Y|²
    yb_re: float  # Σ Y B*, real
    yb_im: float  # Σ Y B*, imaginary
    q: float  # the last that was judged; NaN: none
    sigma: float  # of it
    found: int  # NOTHING, ACTS or DOES_NOT


NOT_SHAKEN: Final = ShakeState(
    pressed=0.0,
    rest_s=0.0,
    on=False,
    shaken=0.0,
    climb_mps=float("nan"),
    time_s=0.0,
    ticks=0.0,
    sines=0.0,
    cosines=0.0,
    rise=0.0,
    rise_sin=0.0,
    rise_cos=0.0,
    brake_sin=0.0,
    brake_cos=0.0,
    blocks=0.0,
    b_re=0.0,
    b_im=0.0,
    y_re=0.0,
    y_im=0.0,
    b_2=0.0,
    y_2=0.0,
    yb_re=0.0,
    yb_im=0.0,
    q=float("nan"),
    sigma=float("nan"),
    found=NOTHING,
)


def shake_step(
    state: ShakeState,
    saturated: int,
    asked: float,
    brake: float,
    climb_mps: float,
    lifts_mps2: float,
    dt_s: float,
) -> ShakeState:
    """One step.

    saturated: at which end of the brake's travel the law is, -1, 0 or +1; asked: the brake that
    it asks for; brake: as it was commanded last; lifts_mps2: acceleration of all of it, up.
    """
    if not dt_s * abs(lifts_mps2) > 0.0:  # a repeated or a backward time, or no air over the brake
        return state
    pressed = state.pressed + (abs(saturated) - state.pressed) * dt_s / (PRESSED_S + dt_s)
    if not state.on:
        rest_s = max(0.0, state.rest_s - dt_s)
        on = rest_s <= 0.0 and pressed >= PRESSED
        found = NOTHING if on else state.found  # that it acted once is no answer to this
        return state._replace(
            pressed=pressed, rest_s=rest_s, on=on, climb_mps=climb_mps, found=found
        )
    phase = 2.0 * pi * SHAKE_HZ * state.time_s
    s, c = sin(phase), cos(phase)
    rise = (climb_mps - state.climb_mps) / (dt_s * lifts_mps2 * GAIN)
    if not isfinite(rise):
        return _over(state, NOTHING)._replace(pressed=pressed)
    shaken = max(0.0, min(1.0, asked + SHAKEN * s)) - asked
    state = state._replace(
        pressed=pressed,
        shaken=shaken,
        climb_mps=climb_mps,
        time_s=state.time_s + dt_s,
        ticks=state.ticks + 1.0,
        sines=state.sines + s,
        cosines=state.cosines + c,
        rise=state.rise + rise,
        rise_sin=state.rise_sin + rise * s,
        rise_cos=state.rise_cos + rise * c,
        brake_sin=state.brake_sin + brake * s,
        brake_cos=state.brake_cos + brake * c,
    )
    return state if state.time_s < BLOCK_S - 0.5 * dt_s else _judged(_block_taken(state))


def _block_taken(state: ShakeState) -> ShakeState:
    """Into the sums, unless it had too few ticks."""
    n = state.ticks
    if n >= TICKS_MIN:
        mean = state.rise / n
        b_re, b_im = 2.0 * state.brake_sin / n, 2.0 * state.brake_cos / n
        y_re = 2.0 * (state.rise_sin - mean * state.sines) / n
        y_im = 2.0 * (state.rise_cos - mean * state.cosines) / n
        state = state._replace(
            blocks=state.blocks + 1.0,
            b_re=state.b_re + b_re,
            b_im=state.b_im + b_im,
            y_re=state.y_re + y_re,
            y_im=state.y_im + y_im,
            b_2=state.b_2 + b_re * b_re + b_im * b_im,
            y_2=state.y_2 + y_re * y_re + y_im * y_im,
            yb_re=state.yb_re + y_re * b_re + y_im * b_im,
            yb_im=state.yb_im + y_im * b_re - y_re * b_im,
        )
    return state._replace(
        time_s=0.0,
        ticks=0.0,
        sines=0.0,
        cosines=0.0,
        rise=0.0,
        rise_sin=0.0,
        rise_cos=0.0,
        brake_sin=0.0,
        brake_cos=0.0,
    )


def _judged(state: ShakeState) -> ShakeState:
    """After one more block."""
    size_2 = state.b_re * state.b_re + state.b_im * state.b_im
    if state.blocks < SHAKES_FEWEST or not size_2 > 0.0:
        return state
    r_re = (state.y_re * state.b_re + state.y_im * state.b_im) / size_2
    r_im = (state.y_im * state.b_re - state.y_re * state.b_im) / size_2
    left = state.y_2 - 2.0 * (r_re * state.yb_re + r_im * state.yb_im)
    left += (r_re * r_re + r_im * r_im) * state.b_2
    sigma = max(SIGMA_MIN, sqrt(max(0.0, 0.5 * left / size_2)))
    lag = max(LAG_LEAST_RAD, min(LAG_MOST_RAD, atan2(-r_im, r_re)))
    q = r_re * cos(lag) - r_im * sin(lag)
    state = state._replace(q=q, sigma=sigma)
    if abs(q - LEAST) >= SIGMAS * sigma:
        return _over(state, ACTS if q > LEAST else DOES_NOT)
    return _over(state, NOTHING) if state.blocks >= SHAKES_MOST else state


def _over(state: ShakeState, found: int) -> ShakeState:
    """It rests; what was found stays until it is shaken again."""
    return NOT_SHAKEN._replace(rest_s=REST_S, q=state.q, sigma=state.sigma, found=found)

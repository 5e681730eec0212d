"""The second axis: the place along the line, held by the brake.

Pitch holds e_rho.  Along the line the aircraft slides to where updraft equals sink, and drifts
with every gust.  A brake (both ailerons together, a flap, a spoiler) adds drag and so changes the
sink: S(u) becomes S(u, b), the contour becomes a band, and any point of the band can be held.

    e_s = t · (p - P)                        along the line, up positive; P the point
    v_sp = v_P - clip(k_s e_s)               the speed along the line that leads back to it
    σ = σ_0 + D (K (v_s - v_sp) + ∫ K_i (v_s - v_sp) dt)         sink that is added [m/s]
    b = σ / S_b,   S_b = V³ ρ S C_Db / 2 m g                      within 0 and 1
    D = sin eta - S′ cos eta                 sink by speed along the line: climbing means drifting

Rising too fast asks for more brake.  σ_0, a share of S_b, is the bias that lets it act both ways.
S_b is known from the airframe, so the gains hold at every airspeed: with the lift's answer to
incidence, g C_Lα / (C_L V) = λ, of 6 rad/s for small aircraft, the speed along the line follows as
a first-order lag of rate λ (1 + K), and the place as one of k_s K / (1 + K).

**Decoupling.**  The brake takes lift and turns the glide down.  Incidence and pitch that give the
lift back and follow the new glide, and the elevator that trims both, are known beforehand:

    Δα = -b C_Lb / C_Lα       Δθ = Δα - b S_b / V       Δδe = -(b C_mb + C_mα Δα) / C_mδe

so the outer loop sees nothing of it but what the lags leave.

**Limits.**  The point that is flown follows the operator's at limited speed.  The integral stops
at the end of the brake's travel.  Where the brake stands there for long, the point lies outside
the band: that is reported, and the aircraft rests at the band's edge, which is stable by the
line alone.  Whatever makes the law end, or not begin, fades the brake out.

**Giving way.**  The point is an order, and stays (TGL_HOLD 1) unless the operator lets it give way
(2).  Then, once a trial has shown that the brake acts (`brake_watch`, `brake_shake`), the point
slides along the line, a third as fast as the law moves, until the mean b of the brake is its bias
again:

    d/dt (along) = c clip(2 (mean b - bias))         stops at |mean b - bias| <= MIDDLE

Along the line, and not across it: a line that is stable has less lift further up, so that the sign
is known, and which side of the line has more lift is not.  It stays inside the fence and clear of
the ground.  It does not go back by itself; the next order of the operator is flown as it is given.
"""

from __future__ import annotations

from math import cos, hypot, sin
from typing import Final, NamedTuple

from tgl_soar.control.brake_shake import (
    LIFT_MIN,
    NOT_SHAKEN,
    SHAKEN,
    ShakeState,
    shake_step,
)
from tgl_soar.control.brake_watch import (
    ACTS,
    DOES_NOT,
    NOT_TRIED,
    NOT_WATCHED,
    TRIED,
    EvenState,
    TrialState,
    even_step,
    pulls,
    trial_step,
    tried_brake,
)
from tgl_soar.control.pid import PidGains, PidState, pid_step
from tgl_soar.control.target_line import TargetLine
from tgl_soar.types import Aerodynamics, VehicleState, isfinite, polar_slope

# In and out of a flight: over 2 s, slower than the short period, the line's loop and its own.
FADE_PER_S: Final = 0.5
# The share of the time at an end of its travel is averaged over some time constants of the place,
# so that gusts do not count.  Four fifths leave it nothing to act with; at a half it acts again.
OUTSIDE_S: Final = 3.0
OUTSIDE: Final = 0.8
INSIDE: Final = 0.5
BRAKE_MIN_SINK_MPS: Final = 0.02  # that all of it must add: less holds nothing
HELD: Final = 0.05  # further from where it is wanted the brake is held by something else
FOLLOWS: Final = 0.005  # nearer than this it is where it is wanted: a fortieth of the shake
# As near as this to an end of its travel the law stands at it: the integral stops before its sum
# has passed the end, by a step of its own or by what the proportional part makes of a gust.
AT_END: Final = 0.02
GIVE_WAY: Final = 1.0 / 3.0  # of the speed at which the point moves
MIDDLE: Final = 0.1  # of the travel: as near to its bias a mean of some seconds in gusts stays

# How it stands.
LINE_ONLY: Final = 0
HOLDS: Final = 1
ABOVE_BAND: Final = 2  # the point: there the aircraft sinks, with the brake retracted
BELOW_BAND: Final = 3  # there it rises, with all of the brake
NO_BRAKE: Final = 4
DEAD: Final = 5
UNEVEN: Final = 6
TRIES: Final = 7
GIVES_WAY: Final = 8
RESTS: Final = 9  # asked for, but no line is flown, or the brake still fades in
POINT_TEXTS: Final = (
    "the line alone",
    "held",
    "above the band: brake retracted",
    "below the band: all of the brake is out",
    "no brake by this route: line alone",
    "brake does not answer: line alone",
    "brake pulls to one side: line alone",
    "at an end of the brake: trying it",
    "gives way along the line",
    "not held yet",
)


class BrakeGains(NamedTuple):
    """Parameters of the law, and what the airframe makes of the brake."""

    wanted: bool
    gives_way: bool  # where the brake stands at an end of its travel for long
    available: bool  # there is a brake, and the route commands it
    along_m: float  # of the point from the target line's own, up along it
    kp_per_s: float  # k_s
    speed_max_mps: float  # along the line, of v_sp and of the point that is flown
    kv: float  # K
    ki_per_s: float  # K_i
    bias: float  # of S_b
    sink: float  # S_b = this V³ [s²/m²]
    lift_rad: float  # Δα of all of it
    elevator: float  # Δδe of all of it


class BrakeState(NamedTuple):
    """What the law remembers."""

    standing: int
    x_m: float  # the point that is flown, soaring frame; NaN: none yet
    z_m: float
    off_m: float  # e_s; NaN: no point is held
    pid: PidState
    weight: float  # of the law in the command, 0 … 1
    brake: float  # wanted, 0 … 1
    ended: float  # share of the time at the end of its travel, less that retracted: -1 … 1
    mean: float  # of the brake that the law asks for
    given_way_m: float  # by the point, up along the line
    ordered_x_m: float  # the point as it was ordered last, soaring frame; NaN: none yet
    ordered_z_m: float
    even: EvenState
    trial: TrialState
    shake: ShakeState


class Around(NamedTuple):
    """What the law is given beside the place of the aircraft."""

    on_the_line: bool  # the module flies a line now
    answers: bool  # what is read back goes where it is commanded
    blocked: int  # +1 if the brake can go no further out, -1 in
    room: float  # the furthest that it may go, 0 … 1
    brake: float  # as it was commanded last
    aileron: float  # the same
    inertial: bool  # the motion is estimated with accelerations
    up_free: bool  # the point may go further up along the line
    down_free: bool


class PointReport(NamedTuple):
    """What is reported of it."""

    standing: int
    off_m: float  # of the aircraft from the point, up along the line; NaN: no point is held


class BrakeEffect(NamedTuple):
    """What a brake changes, and what undoes it."""

    pitch_rad: float  # to the setpoint
    elevator: float  # to its trim


NO_POINT: Final = BrakeState(
    standing=LINE_ONLY,
    x_m=float("nan"),
    z_m=float("nan"),
    off_m=float("nan"),
    pid=PidState(0.0, 0.0),
    weight=0.0,
    brake=0.0,
    ended=0.0,
    mean=0.0,
    given_way_m=0.0,
    ordered_x_m=float("nan"),
    ordered_z_m=float("nan"),
    even=NOT_WATCHED,
    trial=NOT_TRIED,
    shake=NOT_SHAKEN,
)


def brake_effect(gains: BrakeGains, brake: float, airspeed_mps: float) -> BrakeEffect:
    """Of a brake as it is commanded, 0 … 1, at an airspeed [m/s]; nothing without one."""
    if brake == 0.0 or not gains.available:
        return BrakeEffect(0.0, 0.0)
    turned = gains.sink * airspeed_mps * airspeed_mps
    return BrakeEffect(brake * (gains.lift_rad - turned), brake * gains.elevator)


def brake_step(
    gains: BrakeGains,
    aerodynamics: Aerodynamics,
    state: BrakeState,
    target: TargetLine,
    eta_rad: float,
    vehicle: VehicleState,
    airspeed_mps: float,
    around: Around,
    dt_s: float,
) -> BrakeState:
    """One step.  target: the line as it is wanted; eta_rad: the inclination as it is flown."""
    most = gains.sink * airspeed_mps * airspeed_mps * airspeed_mps
    standing = _begun(gains, state, around, most)
    fade = FADE_PER_S * dt_s
    along_x, along_z = cos(eta_rad), sin(eta_rad)
    off_now = along_x * vehicle.x_m + along_z * vehicle.z_m
    speed = along_x * vehicle.velocity_x_mps + along_z * vehicle.climb_mps
    if not (acts(standing) and around.on_the_line and isfinite(off_now + speed)):
        weight = max(0.0, state.weight - fade)
        # Towards nothing from where it was: no law acts any more.
        brake = state.brake * weight / state.weight if state.weight > 0.0 else 0.0
        standing = RESTS if acts(standing) else standing
        return NO_POINT._replace(standing=standing, weight=weight, brake=brake)

    state = _way_given(gains, state, target, around, dt_s)
    x, z, moved_x, moved_z = _point_step(gains, state, target, vehicle, dt_s)
    off = off_now - along_x * x - along_z * z
    moves = (along_x * moved_x + along_z * moved_z) / dt_s if dt_s > 0.0 else 0.0
    back = max(-gains.speed_max_mps, min(gains.speed_max_mps, -gains.kp_per_s * off))
    slope = polar_slope(aerodynamics.polar, airspeed_mps)
    sinks = along_z - slope * along_x if isfinite(slope) else along_z
    law = _law(gains, most)
    error = sinks * (speed - moves - back)
    pid, terms = pid_step(law, state.pid, error, 0.0, gains.bias * most, dt_s, around.blocked)
    gain = dt_s / (OUTSIDE_S + dt_s)
    asked = terms.output / most
    end = _end(error, asked, around.room)
    ended = state.ended + (end - state.ended) * gain
    mean = state.mean + (asked - state.mean) * gain
    weight = min(1.0, state.weight + fade)
    even, trial, shake = state.even, state.trial, state.shake
    if weight == 1.0 and abs(around.brake - state.brake) < FOLLOWS:
        # Not where roll takes of its travel: there it follows the aileron.  And the roll loop does
        # not follow a shake as it follows the law.
        even = even_step(even, around.brake - shake.shaken, around.aileron, dt_s)
    if weight == 1.0 and around.inertial and abs(aerodynamics.CL_brake) >= LIFT_MIN:
        lifts = _lift(aerodynamics, airspeed_mps)
        if shake.on and abs(ended) > INSIDE:  # so far in that it can go both ways
            asked = max(SHAKEN, min(1.0 - SHAKEN, asked))
        shake = shake_step(shake, end, asked, around.brake, vehicle.climb_mps, lifts, dt_s)
        trial = NOT_TRIED
    elif weight == 1.0:
        shake = NOT_SHAKEN
        held = abs(around.brake - state.brake) > HELD
        expected = TRIED * most / sinks if sinks > 0.0 else float("nan")
        trial = trial_step(trial, end, ended, held, speed, expected, dt_s)
    if trial.on:  # meanwhile the law rests
        pid, ended, mean, asked = state.pid, state.ended, state.mean, tried_brake(trial)
    return BrakeState(
        standing=_stands(gains, standing, trial, shake, ended, mean, around)
        if weight == 1.0
        else RESTS,
        x_m=x,
        z_m=z,
        off_m=off,
        pid=pid,
        weight=weight,
        brake=weight * (asked + shake.shaken),
        ended=ended,
        mean=mean,
        given_way_m=state.given_way_m,
        ordered_x_m=state.ordered_x_m,
        ordered_z_m=state.ordered_z_m,
        even=even,
        trial=trial,
        shake=shake,
    )


def _law(gains: BrakeGains, most_mps: float) -> PidGains:
    """From speed along the line to sink, of which all of the brake adds that much."""
    return PidGains(
        kp=gains.kv,
        ki=gains.ki_per_s,
        kd=0.0,
        rate_filter_radps=0.0,
        integral_max=most_mps,
        output_min=0.0,
        output_max=most_mps,
    )


def _end(error_mps: float, asked: float, room: float) -> int:
    """At which end of what the brake may do the law stands, and would go on: -1, 0 or +1.  One that
    has not come there yet, for it goes only so fast, is at none."""
    if error_mps > 0.0 and asked >= room - AT_END:
        return 1
    return -1 if error_mps < 0.0 and asked <= AT_END else 0


def _lift(aerodynamics: Aerodynamics, airspeed_mps: float) -> float:
    """The acceleration [m/s²], up, that all of the brake makes before incidence follows."""
    pressure = 0.5 * aerodynamics.air_density_kgpm3 * airspeed_mps * airspeed_mps
    return pressure * aerodynamics.wing_area_m2 * aerodynamics.CL_brake / aerodynamics.mass_kg


def acts(standing: int) -> bool:
    """Whether a point is held, or as near to it as the brake can."""
    return HOLDS <= standing <= BELOW_BAND or standing in (TRIES, GIVES_WAY)


def set_aside(gains: BrakeGains, state: BrakeState) -> BrakeState:
    """Before another flight: of what was remembered only that a brake is bad is left, until the
    point is asked for no more.  It does not mend itself while the pilot flies."""
    if gains.wanted and state.standing in (DEAD, UNEVEN):
        return NO_POINT._replace(standing=state.standing)
    return NO_POINT


def _begun(gains: BrakeGains, state: BrakeState, around: Around, most_mps: float) -> int:
    """How it stands before a step.  An end for a fault lasts until the operator asks again."""
    if not gains.wanted:
        return LINE_ONLY
    if state.standing in (DEAD, UNEVEN):
        return state.standing
    if not gains.available:
        return NO_BRAKE
    if not around.answers or DOES_NOT in (state.trial.found, state.shake.found):
        return DEAD
    if not most_mps >= BRAKE_MIN_SINK_MPS:
        return NO_BRAKE
    if pulls(state.even):
        return UNEVEN
    return HOLDS if state.standing in (LINE_ONLY, NO_BRAKE, RESTS) else state.standing


def _stands(
    gains: BrakeGains,
    before: int,
    trial: TrialState,
    shake: ShakeState,
    ended: float,
    mean: float,
    around: Around,
) -> int:
    """How a point that is held stands after a step."""
    if trial.on:
        return TRIES
    if gains.gives_way and ACTS in (trial.found, shake.found):
        goes_on = before == GIVES_WAY and abs(mean - gains.bias) > MIDDLE
        free = around.up_free if mean > gains.bias else around.down_free
        if free and (goes_on or abs(ended) >= OUTSIDE):
            return GIVES_WAY
    if ended >= OUTSIDE:
        return BELOW_BAND
    if ended <= -OUTSIDE:
        return ABOVE_BAND
    return HOLDS if abs(ended) <= INSIDE or before >= TRIES else before


def _way_given(
    gains: BrakeGains, state: BrakeState, target: TargetLine, around: Around, dt_s: float
) -> BrakeState:
    """How far the point has given way; another order is flown as it is given."""
    x = target.x_m + gains.along_m * cos(target.eta_rad)
    z = target.z_m + gains.along_m * sin(target.eta_rad)
    if x != state.ordered_x_m or z != state.ordered_z_m:  # true for NaN: none yet
        return state._replace(given_way_m=0.0, ordered_x_m=x, ordered_z_m=z)
    if not gains.gives_way:
        return state._replace(given_way_m=0.0)
    if state.standing != GIVES_WAY:
        return state
    rate = GIVE_WAY * max(-1.0, min(1.0, 2.0 * (state.mean - gains.bias)))
    if not (around.up_free if rate > 0.0 else around.down_free):
        return state
    return state._replace(given_way_m=state.given_way_m + rate * gains.speed_max_mps * dt_s)


def _point_step(
    gains: BrakeGains, state: BrakeState, target: TargetLine, vehicle: VehicleState, dt_s: float
) -> tuple[float, float, float, float]:
    """The point (x, z) [m] that is flown, and its way in this step: it starts at the aircraft, and
    follows the operator's, less what it has given way, at limited speed."""
    x, z = state.x_m, state.z_m
    if not isfinite(x + z):
        x, z = vehicle.x_m, vehicle.z_m
    to_x = state.ordered_x_m + state.given_way_m * cos(target.eta_rad) - x
    to_z = state.ordered_z_m + state.given_way_m * sin(target.eta_rad) - z
    distance = hypot(to_x, to_z)
    most_m = gains.speed_max_mps * dt_s
    fraction = most_m / distance if distance > most_m else 1.0
    return x + fraction * to_x, z + fraction * to_z, fraction * to_x, fraction * to_z

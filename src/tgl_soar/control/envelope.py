"""The envelope: the last limiter before the surfaces, independent of the laws.

    |u| <= deflection_max,   |u - u_last| <= rate_max dt,   nothing unless the mode flies

A command that is not finite never passes: it is reported to the caller, who disengages.

A brake stays within 0 and what is left for it.  Where both ailerons are the brake, roll comes
first: the brake has what the aileron leaves of their throw, at once, whatever its own rate.  Near
the stall and low and sinking it is retracted, as it takes lift and height:

    brake <= min(1, (deflection_max - |aileron|) / throw) min(1, margin / MARGIN_FULL)

Against the stall, with the angle of attack alpha and the airspeed V where they are known:

    margin = min(alpha_max - alpha, (V - V_min) PITCH_PER_SPEED)
    pitch setpoint <= pitch + margin, or the best glide's, whichever is higher
    elevator <= trim + (SURF_MAX - trim) margin / MARGIN_FULL     between trim and travel

so that at the limit the elevator stands no further up than its trim.  What is not known does
not limit.  Whatever is known of the air, the travel ends where the elevator would hold, at the
nose's present rate q > 0, 8 degrees more than alpha_max (`estimation.aerodynamics`):

    travel = trim + room + q per_rate

An aircraft that has stalled, and falls away from its line, asks for all of the elevator.  It must
not get it: what has just regained its flow would be pulled into the next stall.

Sinking fast, or so that the least clearance is reached within LOW_AHEAD_S, the pitch
setpoint is below neither that of the best glide nor the one that holds the line undisturbed,
whichever is lower: there is nothing to be won by diving.  In fast air, or with a biased attitude,
the second is the lower one, and an aircraft that could not fly it would drift onto the slope; and
what drifts there without sinking is brought away from it by a lower nose, and by nothing else.
Nor is there another way back for what has been blown behind the line that it soared on, sinking or
not: in the updraft close to the slope a wing at the glide's pitch may be stalled, and then it sinks
because its nose is too high.  So the limit gives way by PITCH_PER_BEHIND for each metre behind.

The place is held against a box (the fence) and against the ground: a few points (x, z) of its
profile in the soaring frame, extruded along y.  Over a plane the clearance is the distance to
it, over anything else it lies between that to the tangent below and the height above it:

    clearance = (z - z_ground(x)) cos(slope there)
"""

from __future__ import annotations

from math import sqrt
from typing import Final, NamedTuple

from tgl_soar.types import INFINITE, Ground, SurfaceCommand, ground_stretch, isfinite

PITCH_PER_SPEED: Final = 0.05  # rad for each m/s: a glider that slows down gains alpha so
MARGIN_FULL: Final = 0.05  # rad; from here on it takes nothing of the elevator
STALL_BEYOND: Final = 0.05  # rad (or 1 m/s) beyond the limit: it does not hold, a stall
LOW_FACTOR: Final = 2.0  # of the least clearance: further up nothing is low
# 6 degrees, from a deep stall to an attached flow, where gusts seldom put an aircraft: 5 cm behind.
PITCH_PER_BEHIND: Final = 2.0  # rad for each metre
LOW_AHEAD_S: Final = 1.0  # a change of pitch turns the flight path in about V / g, 0.9 s at 8.5 m/s
CLEAR_FACTOR: Final = 1.3  # of the least clearance: clear of the ground again

# Half a second from closed to open: as fast as small motors spin up, and no jerk of the pitch.
THROTTLE_PER_S: Final = 2.0

# What was cut.
CUT_TRAVEL: Final = 1
CUT_RATE: Final = 2
CUT_NOT_FINITE: Final = 4
CUT_MODE: Final = 8
CUT_NOSE_UP: Final = 16
CUT_NOSE_DOWN: Final = 32
CUT_TEXTS: Final = (
    "travel",
    "rate",
    "not finite",
    "mode",
    "nose-up, near the stall",
    "nose-down, sinking near the ground or fast",
)

# Where a place is outside.
OUT_UPSTREAM: Final = 1
OUT_DOWNSTREAM: Final = 2
OUT_SIDE: Final = 4
OUT_BELOW: Final = 8
OUT_ABOVE: Final = 16


class EnvelopeLimits(NamedTuple):
    """What a surface may be commanded, and what the aircraft may do."""

    deflection_max: float  # of full travel
    rate_max_per_s: float  # full travels a second
    alpha_max_rad: float
    speed_min_mps: float
    sink_max_mps: float
    clearance_min_m: float
    glide_pitch_rad: float
    brake_throw: float  # of each aileron's that all of the brake takes; 0: a surface of its own
    elevator_room: float  # above its trim; inf: not known
    elevator_per_radps: float  # more, for a nose that comes up


class Fence(NamedTuple):
    """The box that the aircraft must stay in, soaring frame."""

    x_min_m: float
    x_max_m: float
    y_max_m: float  # to either side
    z_min_m: float
    z_max_m: float


class Margins(NamedTuple):
    """How far the aircraft is from its limits."""

    stall_rad: float  # of the angle of attack; inf: not known
    clearance_m: float  # over the ground; inf: not known
    outside: int  # of the fence, bits OUT_…


class Limited(NamedTuple):
    """The command that may be sent, and what was cut."""

    command: SurfaceCommand
    elevator_blocked: int  # +1: can deflect no further up, -1: no further down, else 0
    aileron_blocked: int
    brake_blocked: int
    brake_max: float  # the furthest that the brake might go, 0 … 1
    finite: bool
    cut: int  # bits CUT_…


def stall_margin(limits: EnvelopeLimits, alpha_rad: float, airspeed_mps: float) -> float:
    """How far the nose may come up [rad]; negative beyond the limit, inf where nothing is known."""
    margin = INFINITE
    if alpha_rad == alpha_rad:
        margin = limits.alpha_max_rad - alpha_rad
    if airspeed_mps == airspeed_mps:
        margin = min(margin, (airspeed_mps - limits.speed_min_mps) * PITCH_PER_SPEED)
    return margin


def is_air_safe(limits: EnvelopeLimits, margin_rad: float, climb_mps: float) -> bool:
    """Whether the aircraft flies: it does not stall, nor sink as if it did."""
    return margin_rad >= -STALL_BEYOND and climb_mps >= -limits.sink_max_mps


def is_clear(
    limits: EnvelopeLimits, margin_rad: float, climb_mps: float, clearance_m: float
) -> bool:
    """Whether stall and ground are far enough to end a recovery."""
    return (
        margin_rad >= 0.0
        and climb_mps >= -0.5 * limits.sink_max_mps
        and clearance_m >= CLEAR_FACTOR * limits.clearance_min_m
    )


def pitch_within(
    limits: EnvelopeLimits,
    setpoint_rad: float,
    pitch_rad: float,
    margin_rad: float,
    climb_mps: float,
    clearance_m: float,
    holding_rad: float,
    behind_m: float,
) -> float:
    """The pitch setpoint that may be flown.

    holding_rad: the pitch that holds the line undisturbed, as it was learnt; NaN: not known.
    behind_m: how far the aircraft is downstream of the line that it soars on, else 0.
    Neither limit goes beyond the best glide: a wrong margin must not push the nose down for good.
    """
    if climb_mps < -limits.sink_max_mps or is_low(limits, climb_mps, clearance_m):
        floor = min(limits.glide_pitch_rad, holding_rad)
        setpoint_rad = max(setpoint_rad, floor - PITCH_PER_BEHIND * max(0.0, behind_m))
    if margin_rad < MARGIN_FULL:
        setpoint_rad = min(setpoint_rad, max(limits.glide_pitch_rad, pitch_rad + margin_rad))
    return setpoint_rad


def is_low(limits: EnvelopeLimits, climb_mps: float, clearance_m: float) -> bool:
    """Whether the aircraft is near the ground and sinks towards it."""
    least = limits.clearance_min_m
    return (
        clearance_m < LOW_FACTOR * least
        and climb_mps < 0.0
        and clearance_m + climb_mps * LOW_AHEAD_S < least
    )


def elevator_limit(
    limits: EnvelopeLimits, trim: float, margin_rad: float, pitch_rate_radps: float
) -> float:
    """The furthest that the elevator may go up."""
    turning = limits.elevator_per_radps * max(0.0, pitch_rate_radps)  # in this order: 0 for NaN
    most = min(limits.deflection_max, trim + limits.elevator_room + turning)
    if margin_rad >= MARGIN_FULL:
        return most
    fraction = max(0.0, margin_rad / MARGIN_FULL)
    return min(most, trim + (limits.deflection_max - trim) * fraction)


def limit_surfaces(
    limits: EnvelopeLimits,
    last: SurfaceCommand,
    wanted: SurfaceCommand,
    elevator_max: float,
    brake_max: float,
    flying: bool,
    dt_s: float,
) -> Limited:
    """The wanted command within travel, rate, elevator_max and brake_max; the last one, within
    travel, where it is not finite; neutral unless the mode flies.  A dt_s that is
    negative or NaN counts as zero."""
    if not flying:
        return Limited(
            command=SurfaceCommand(0.0, 0.0, 0.0, 0.0),
            elevator_blocked=0,
            aileron_blocked=0,
            brake_blocked=0,
            brake_max=1.0,
            finite=True,
            cut=CUT_MODE,
        )
    cut = 0
    finite = isfinite(wanted.elevator) and isfinite(wanted.aileron) and isfinite(wanted.rudder)
    finite = finite and isfinite(wanted.brake)
    if not finite:
        wanted = last
        cut = CUT_NOT_FINITE
    up = wanted.elevator
    if elevator_max < limits.deflection_max and up > elevator_max:
        up = elevator_max
        cut |= CUT_NOSE_UP
    most = max(0.0, limits.rate_max_per_s * dt_s)  # in this order: 0 for NaN
    elevator = limit_one(limits.deflection_max, most, last.elevator, up)
    aileron = limit_one(limits.deflection_max, most, last.aileron, wanted.aileron)
    rudder = limit_one(limits.deflection_max, most, last.rudder, wanted.rudder)
    brake = limit_one(1.0, most, last.brake, wanted.brake)
    brake_max = min(brake_max, brake_room(limits, aileron))
    brake = max(0.0, min(brake_max, brake))
    if elevator != up or aileron != wanted.aileron or rudder != wanted.rudder:
        travel = limits.deflection_max
        if max(abs(up), abs(wanted.aileron), abs(wanted.rudder)) > travel:
            cut |= CUT_TRAVEL
        if (
            abs(up - last.elevator) > most
            or abs(wanted.aileron - last.aileron) > most
            or abs(wanted.rudder - last.rudder) > most
        ):
            cut |= CUT_RATE
    if brake != wanted.brake:
        cut |= CUT_RATE if abs(wanted.brake - last.brake) > most else CUT_TRAVEL
    return Limited(
        command=SurfaceCommand(elevator, aileron, rudder, brake),
        elevator_blocked=1
        if elevator >= elevator_max
        else blocked_side(limits.deflection_max, elevator, wanted.elevator),
        aileron_blocked=blocked_side(limits.deflection_max, aileron, wanted.aileron),
        brake_blocked=brake_blocked(brake, wanted.brake, brake_max),
        brake_max=max(0.0, min(1.0, brake_max)),
        finite=finite,
        cut=cut,
    )


def unlimited(command: SurfaceCommand) -> Limited:
    """A command of which nothing was cut."""
    return Limited(
        command=command,
        elevator_blocked=0,
        aileron_blocked=0,
        brake_blocked=0,
        brake_max=1.0,
        finite=True,
        cut=0,
    )


def brake_limit(
    limits: EnvelopeLimits, margin_rad: float, climb_mps: float, clearance_m: float
) -> float:
    """The furthest that the brake may go out, the ailerons apart."""
    if is_low(limits, climb_mps, clearance_m) or climb_mps < -limits.sink_max_mps:
        return 0.0
    return max(0.0, min(1.0, margin_rad / MARGIN_FULL))


def brake_room(limits: EnvelopeLimits, aileron: float) -> float:
    """What an aileron's deflection leaves for the brake, 0 … 1: roll comes first."""
    if limits.brake_throw <= 0.0:
        return 1.0
    return max(0.0, min(1.0, (limits.deflection_max - abs(aileron)) / limits.brake_throw))


def limit_throttle(last: float, wanted: float, most: float, dt_s: float) -> float:
    """The throttle that may be sent: within 0 and `most`, opened no faster than THROTTLE_PER_S and
    closed at once where that is asked for; 0 for what is not a number."""
    if not (isfinite(wanted) and isfinite(last) and isfinite(most)):
        return 0.0
    opened = last + max(0.0, THROTTLE_PER_S * dt_s)  # in this order: 0 for NaN
    return max(0.0, min(wanted, opened, most, 1.0))


def brake_blocked(given: float, wanted: float, furthest: float) -> int:
    """+1 or -1 where the brake can go no further out or in, or not as fast as asked; else 0."""
    if given < wanted or given >= furthest:
        return 1
    if given > wanted or given <= 0.0:
        return -1
    return 0


def limit_one(deflection_max: float, change_max: float, last: float, wanted: float) -> float:
    """One deflection within its travel and, where travel allows, its change from the last."""
    # NaN would pass the limits below, as full deflection or full rate.
    if last != last:
        last = 0.0
    if wanted != wanted:
        wanted = last
    within_rate = max(last - change_max, min(last + change_max, wanted))
    return max(-deflection_max, min(deflection_max, within_rate))


def blocked_side(deflection_max: float, given: float, wanted: float) -> int:
    """+1 or -1 where a surface can go no further that way, or not as fast as asked; else 0."""
    if given >= deflection_max or given < wanted:
        return 1
    if given <= -deflection_max or given > wanted:
        return -1
    return 0


def outside(fence: Fence, x_m: float, y_m: float, z_m: float) -> int:
    """Where a place is outside, as bits; 0: inside.  NaN is outside."""
    out = 0
    if not x_m >= fence.x_min_m:
        out |= OUT_UPSTREAM
    if not x_m <= fence.x_max_m:
        out |= OUT_DOWNSTREAM
    if not abs(y_m) <= fence.y_max_m:
        out |= OUT_SIDE
    if not z_m >= fence.z_min_m:
        out |= OUT_BELOW
    if not z_m <= fence.z_max_m:
        out |= OUT_ABOVE
    return out


def clearance(ground: Ground, x_m: float, z_m: float) -> float:
    """Distance [m] to the ground below, as above; inf where it is not known."""
    if ground.points == 0:
        return INFINITE
    stretch = ground_stretch(ground, x_m)
    length = stretch.next_x_m - stretch.x_m
    if not length > 0.0:
        return z_m - stretch.z_m
    rise = stretch.next_z_m - stretch.z_m
    height = z_m - stretch.z_m - rise * (x_m - stretch.x_m) / length
    return height * length / sqrt(length * length + rise * rise)

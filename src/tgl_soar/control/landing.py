"""Home: the height that a landing needs, the glide there, and the flare.

The landing place is a point (x, y, z) with a bearing beta from straight upwind, positive to the
right.  Along the approach and across it, to the right,

    a = (−cos beta, sin beta)      r = (sin beta, cos beta)

At an airspeed V in a wind of u downstream and c to the right the ground is covered along a at

    v(V) = sqrt(V² − (u sin beta + c cos beta)²) − (u cos beta − c sin beta)

and a place D ahead is reached with the height to spare

    left(V) = z + V0² / 2g − max(V² / 2g, Vf² / 2g + D S(V) / v(V))      S: the glide polar

with heights over the place and Vf the best glide's speed, at which it flares.  Speed gives its
height back before that, but must be paid first: that is the other term.  **The escape condition**
is that some V of the polar has left(V) >= spare, in u + 2 sigma and c, and with no lift on the way:
the moment before it ends is the last one to break off.  On the way home c is left out: while the
nose goes from side to side its estimate is not good enough, and who trusted it came down farther
from the place (docs/outdoors.md).

**The approach** is flown at the slowest V that still reaches the place, in the wind that is met:
height that gets short becomes speed, and where the wind falls towards the ground it slows down
again.  The flare, quasi-steady from the height S FLARE_S on, takes (1 + KF) / KF ln(1 + KF) FLARE_S
where a glide would take FLARE_S, and what it covers meanwhile counts: it aims by FLOAT_S v(Vf)
short of the place.

**Too much height** is lost by time alone: a glide sinks by S whatever way its nose points, and more
speed loses it sooner but advances by more for each metre lost.  So where even the slowest V has
height left over it weaves, down to FINAL_M: from side to side, b to either side of the approach,
the nose off the wind by chi on the straight legs and turning through the wind between them, so
that m(chi) of V is kept upwind on average (`control.weaving`).

chi is the least that keeps no more than it may:

    V m(chi) = u + v_d        v_d = D' s / h'     with D', h' as far as to the straight rest

and s its sink over the ground, averaged: where rising air slows that, it has more time.  v_d is of
now and here: a wind that is wrong, or drag that nobody knows, changes D' / h', and chi follows.
Beyond the straight rest's beginning v_d is negative, and the weave comes back as slowly.  With all
of WEAVE_RAD and WEAVE_M 0.29 of V would be kept if the nose followed at once; as it follows, some
0.65, so that it stands still in 5.5 m/s of wind.  In less what is too high flies over the place: to
turn the nose farther, towards the slope, is the only other way, and is not done: it stays within 90
degrees of the approach.

b is no more than there is height to come back from: WEAVE_WIDER h', WEAVE_M and the fence at most
(up to FAST_M FAST_WIDER h', where it began low, and at the speed of an airspeed that is not
measured: what has come from HIGH_M turns at its widest until the end, and could not come back).

The straight rest is as short as turning straight allows, for nothing corrects it but more speed:
chi is no more than omega takes back until then.  It is flown at the best glide's speed at least,
which the flare lives on: a weave takes speed that is not measured, and nobody knows of it; and at
REFERENCE of the stall's, where that is faster and V is not measured.  Where
the air carries it, so that it sinks by less than a quarter of S, no weave brings it down: it goes
on upstream by v_d >= OUT_MPS, and comes back where it sinks again.

How V is held is said in `control.airspeed_hold`.

**What is not measured may be wrong**: without a pitot tube V is what turns have shown it to be
(`control.airspeed_error`), with a standard deviation sigma, and the wind is as much less as V is.
Then the slowest V is the best glide's, and as long as sigma is more than LOOK_MPS it looks: its
nose goes LOOK_RAD to either side at least, as wide as a weave, down to LOOK_ABOVE_M over the
straight rest.  In slow turns it goes on upwind: with a sigma of STEEP_MPS or less it may bank by
STEEPER more than SIDE_BANK from STEEP_ABOVE_M over that on, by all of it STEEP_WITHIN_M higher up.

**A stall** that came all the same ends the weave, and it flies no slower than the best glide.

**The flare** holds the sink that dies out with the height h,

    sink_sp = max(SINK_MPS, h / FLARE_S)
    theta_sp = theta_glide(V) + KF (sink − sink_sp) / V
    hence, quasi-steady,  sink = (S + KF sink_sp) / (1 + KF)

**Sideways** the aircraft returns to the approach in CROSS_S, no faster than CROSS_MPS.
"""

from __future__ import annotations

from math import asin, atan2, cos, log, pi, radians, sin
from typing import Final, NamedTuple

from tgl_soar.control.airspeed_error import airspeed_error_step, airspeed_sigma, corrected_air
from tgl_soar.control.airspeed_hold import (
    GlidePitches,
    GlideSetpoints,
    GlideState,
    glide_pitch_held,
    hold_step,
    incidence_step,
    speed_pitch,
    speed_setpoint,
    stall_step,
)
from tgl_soar.control.weaving import WEAVE_MIN_RAD, WEAVE_RADPS, weave_angle
from tgl_soar.control.wind_triangle import cross_wind, ground_speed
from tgl_soar.types import (
    GRAVITY_MPS2,
    INFINITE,
    NAN,
    AirEstimate,
    GlidePolar,
    VehicleState,
    polar_sink,
)

SPEEDS: Final = 9  # of the polar that are tried
ADVANCE_MPS: Final = 0.5  # over the ground, at least: what advances less arrives nowhere
SLOW_BY_MPS: Final = 1.0  # above SPEED_MIN: all of the elevator is left
POLAR_BY_MPS: Final = 0.8  # above the polar's slow end: a gust of 10 %
# At the best glide's sink of 1.4 m/s: CROSS_S to come back, and a second for the heading that
# follows, the speed and the flare's beginning.
FINAL_M: Final = 4.5
STRAIGHT_BY_M: Final = 1.0  # below it the nose is to be upwind
WEAVE_RAD: Final = 1.5  # from the wind, at most: cos 86 degrees, next to nothing of the speed
WEAVE_LAG_S: Final = 1.4  # the nose and the path follow their setpoint by so much later
TURNS_BY_MPS: Final = 0.6  # slower than wanted by more than that it does not turn
# Off the approach, at most.  Narrower it turns too often, and in each turn it looks upwind and goes
# on: within 6 m to either side it keeps 0.87 of V.
WEAVE_M: Final = 30.0
# From a side it comes back at V sin chi, 5 m/s, while it sinks by 1.3 m/s: 4 m for each metre, less
# what the turn takes.  CROSS_S takes up what is left in the straight rest.
WEAVE_WIDER: Final = 2.3
# Near the ground at the best glide's speed, which advances by 0.8 m/s more: too narrow it spends
# the time that it has on turns.  The straight rest takes up 9 m.
FAST_WIDER: Final = 3.5
FAST_M: Final = 14.0  # no farther: from higher up WEAVE_WIDER allows more
FAST_LAG_S: Final = 1.3
# From there on there is room for two ways from side to side: 28 m at 5 m/s, sinking by 1.4 m/s, and
# a turn.
HIGH_M: Final = 12.0
BACK_MPS: Final = 2.0  # downwind, at most, of one that is beyond the straight rest's beginning
# A look: 0.43 of V across, enough to tell V to LOOK_MPS in 7 s, for a tenth of V upwind.
LOOK_MPS: Final = 0.5  # of sigma: the best glide is 0.8 m/s above the slowest approach
LOOK_RAD: Final = 0.45
LOOK_ABOVE_M: Final = 2.0  # 1.4 s to turn back in
# Of the stall's speed, as landings are flown (14 CFR 23.73, 1996): the flare takes a tenth of it,
# and a wing that carries a tenth less than its file says stalls at 1.05 of it.
REFERENCE: Final = 1.3
# 15 degrees in place of 10: the wing carries 1.035 of the weight, and its stall comes 1 % faster.
# At 20 degrees it turns so well that the weave drifts back into the lift, and stays there.
STEEPER: Final = 0.5
STEEP_MPS: Final = 1.0  # of sigma: the best glide is 1.5 m/s faster than a stall
STEEP_MAX_RAD: Final = radians(20.0)  # of a bank that is made steeper: 1.03 of the stall's speed
STEEP_FRACTION: Final = 0.5  # of TILT_MAX, likewise: gusts and overshoots have the other half
STEEP_ABOVE_M: Final = 1.0  # over the straight rest: 0.7 s to take back 5 degrees in
STEEP_WITHIN_M: Final = 2.0
OUT_MPS: Final = 1.0  # upstream, at least, of one that the air carries
CARRIED: Final = 0.25  # of the polar's sink: sinking by less the air carries it
FLARE_S: Final = 1.0
FLARE_MIN_M: Final = 0.5
SINK_MPS: Final = 0.4
KF: Final = 3.0
FLOAT_S: Final = FLARE_S * ((1.0 + KF) / KF * log(1.0 + KF) - 1.0)  # beyond the glide's end
CROSS_S: Final = 2.0
CROSS_MPS: Final = 3.0
# From upwind, and what 32 bits of degrees lose: further off the nose leaves what it may turn to.
BEARING_MAX_RAD: Final = pi / 3.0 + 1e-4
DEEP_M: Final = 50.0  # missing, at most: else one wrong reading would rule the average

# What is asked of a break-off.
STAY: Final = 0
BREAK: Final = 1
SOAR_ON: Final = 2


class LandingPlace(NamedTuple):
    """Where to land, soaring frame."""

    x_m: float
    y_m: float
    z_m: float
    bearing_rad: float  # of the approach, from straight upwind, positive to the right
    length_m: float  # of the strip about the point; 0: no place is known


class LandingParams(NamedTuple):
    """Parameters of the way home."""

    place: LandingPlace
    escape_rad: float  # bearing of the way out, as that of the approach
    away_x_m: float  # upstream of this the slope is left behind
    spare_m: float  # of height, when it breaks off at the latest
    asked: int  # STAY, BREAK or SOAR_ON
    auto: bool  # it breaks off by itself when the height is gone
    waits: bool  # but not for a wind that has risen since it soars: until it falls
    clearance_m: float  # soaring, and then too when it is nearer to the ground than this
    polar: GlidePolar
    best_glide_mps: float
    stall_mps: float  # by the file, in level flight; NaN: not known
    speed_min_mps: float
    heading_max_rad: float
    sigmas: float  # of the wind, against which the way home is reckoned
    wind_fraction: float  # of the wind that is met, on the way home
    glide_pitch_rad: float  # where the airframe's is not known
    side_max_m: float  # of the fence: no weave is meant to go farther to either side
    tilt_max_rad: float  # beyond it the envelope hands over


def along(place: LandingPlace, x_m: float, y_m: float) -> float:
    """How far ahead [m] the place is, along its bearing; negative behind."""
    b = place.bearing_rad
    return cos(b) * (x_m - place.x_m) + sin(b) * (place.y_m - y_m)


def across(place: LandingPlace, x_m: float, y_m: float) -> float:
    """How far [m] to the right of the approach a point lies."""
    b = place.bearing_rad
    return sin(b) * (x_m - place.x_m) + cos(b) * (y_m - place.y_m)


def slowest(params: LandingParams) -> float:
    """The slowest airspeed of an approach [m/s]."""
    return max(params.polar.speed_min_mps + POLAR_BY_MPS, params.speed_min_mps + SLOW_BY_MPS)


def slowest_known(params: LandingParams, measured: bool) -> float:
    """The same, which an airspeed that nobody measures keeps at the best glide's."""
    return slowest(params) if measured else max(slowest(params), params.best_glide_mps)


def final_speed(params: LandingParams, measured: bool) -> float:
    """The airspeed of the straight rest [m/s], at least: the flare lives on it."""
    reference = 0.0 if measured else REFERENCE * params.stall_mps
    return reference if reference > params.best_glide_mps else params.best_glide_mps


def height_left(
    params: LandingParams,
    distance_m: float,
    height_m: float,
    airspeed_mps: float,
    speed_mps: float,
    wind_mps: float,
    cross_wind_mps: float,
) -> float:
    """left(V) [m]; −inf where the place is not reached at all."""
    v = ground_speed(speed_mps, wind_mps, cross_wind_mps, params.place.bearing_rad)
    energy_m = height_m + speed_height(airspeed_mps)
    if distance_m <= 0.0:
        return energy_m - speed_height(params.best_glide_mps)
    if not v >= ADVANCE_MPS:
        return -INFINITE
    sinks_m = distance_m * polar_sink(params.polar, speed_mps) / v
    return energy_m - max(speed_height(speed_mps), speed_height(params.best_glide_mps) + sinks_m)


def speed_height(speed_mps: float) -> float:
    """The height [m] that a speed is worth."""
    return speed_mps * speed_mps / (2.0 * GRAVITY_MPS2)


def escape_height(params: LandingParams, vehicle: VehicleState, air: AirEstimate) -> float:
    """The height [m] to spare, less what is to be spared, at the best V; NaN: not known."""
    place = params.place
    distance = along(place, vehicle.x_m, vehicle.y_m)
    height = vehicle.z_m - place.z_m
    wind = params.wind_fraction * air.wind_mps + params.sigmas * air.wind_sigma_mps
    cross = params.wind_fraction * cross_wind(air)
    if not (place.length_m > 0.0 and distance + height + wind + air.airspeed_mps < INFINITE):
        return NAN
    low, high = slowest(params), params.polar.speed_max_mps
    best = -INFINITE
    for k in range(SPEEDS):
        speed = min(high, low + (high - low) * k / (SPEEDS - 1))  # no polar beyond, by rounding
        left = height_left(params, distance, height, air.airspeed_mps, speed, wind, cross)
        best = max(best, left)
    return max(-DEEP_M, best - params.spare_m) if high > low else NAN


def float_length(params: LandingParams, wind_mps: float) -> float:
    """How much farther than a glide a flare goes [m]; 0 where it gets nowhere against the wind."""
    v = ground_speed(params.best_glide_mps, wind_mps, 0.0, params.place.bearing_rad)
    return FLOAT_S * v if v > 0.0 else 0.0  # false for NaN


def approach_speed(
    params: LandingParams, low_mps: float, vehicle: VehicleState, air: AirEstimate
) -> float:
    """The slowest V [m/s] from low_mps on that reaches the place, or comes nearest to it."""
    low, high = low_mps, params.polar.speed_max_mps
    distance = along(params.place, vehicle.x_m, vehicle.y_m)
    height = vehicle.z_m - params.place.z_m
    if not (
        high > low
        and params.place.length_m > 0.0
        and distance + height + air.wind_mps + air.airspeed_mps < INFINITE
    ):
        return params.best_glide_mps
    wind = air.wind_mps
    distance -= float_length(params, wind)
    best, best_speed, before = -INFINITE, low, -INFINITE
    step = (high - low) / (SPEEDS - 1)
    for k in range(SPEEDS):
        speed = min(high, low + step * k)
        left = height_left(params, distance, height, air.airspeed_mps, speed, wind, 0.0)
        if left >= 0.0:
            if k > 0 and before > -INFINITE:
                speed -= step * left / (left - before)
            return speed
        if left > best:
            best, best_speed = left, speed
        before = left
    return best_speed


def weave(
    params: LandingParams,
    goes_right: bool,
    speed_mps: float,
    sinks_mps: float,
    vehicle: VehicleState,
    air: AirEstimate,
    fast: bool,
) -> float:
    """The heading from the wind that uses up the height left over at a speed; 0: none is.

    sinks_mps: how it sinks over the ground, averaged; NaN: not known.  fast: see `half_width`.
    """
    place, wind = params.place, air.wind_mps
    height = vehicle.z_m - place.z_m - FINAL_M
    final_mps = ground_speed(params.best_glide_mps, wind, 0.0, place.bearing_rad)
    final_sink = polar_sink(params.polar, params.best_glide_mps)
    sink = polar_sink(params.polar, speed_mps)
    if not final_sink > 0.0:  # no polar is known there
        return 0.0
    distance = along(place, vehicle.x_m, vehicle.y_m) - float_length(params, wind)
    distance -= FINAL_M * final_mps / final_sink
    if not (height > 0.0 and sink > 0.0 and distance < INFINITE):
        return 0.0
    sinks = max(CARRIED * sink, min(sink, sinks_mps)) if sinks_mps == sinks_mps else sink
    advance = max(-BACK_MPS, distance * sinks / height)
    if sinks_mps < CARRIED * sink:  # false for NaN
        advance = max(advance, OUT_MPS)
    straight_s = (height + STRAIGHT_BY_M) / sink  # until it is to look upwind again
    most = max(0.0, min(WEAVE_RAD, WEAVE_RADPS * straight_s, to_abeam(place, goes_right, air)))
    width = half_width(params, height, fast)
    angle = weave_angle((wind + advance) / speed_mps, width, speed_mps, most)
    if angle < WEAVE_MIN_RAD:
        return 0.0
    return angle if goes_right else -angle


def to_abeam(place: LandingPlace, goes_right: bool, air: AirEstimate) -> float:
    """How far off straight upwind [rad] the nose may go: to abeam of the approach, else it looks at
    the slope; and on the side from which the wind comes no farther off that."""
    side = 1.0 if goes_right else -1.0
    veer = atan2(-cross_wind(air), air.wind_mps) if air.wind_mps > 0.0 else 0.0
    return pi / 2.0 + side * place.bearing_rad - max(0.0, side * veer)


def half_width(params: LandingParams, over_m: float, fast: bool) -> float:
    """b [m], at a height over the straight rest's beginning; fast: all of it is flown at the best
    glide's speed, as the airspeed is not measured and it began low."""
    wide_m = WEAVE_WIDER * over_m
    if fast:
        wide_m = max(wide_m, min(FAST_M, FAST_WIDER * over_m))
    return max(0.0, min(WEAVE_M, params.side_max_m, wide_m))


def glide_step(
    params: LandingParams,
    state: GlideState,
    outward: bool,
    position_ok: bool,
    vehicle: VehicleState,
    air: AirEstimate,
    clearance_m: float,
    nose_held: bool,
    dt_s: float,
) -> tuple[GlideState, float]:
    """One tick of the glide; also the airspeed that its trim is for.

    outward: away from the slope yet, else on the approach.  clearance_m: inf where the ground is
    not known.  nose_held: it stays below its setpoint with all of the elevator that there is.
    """
    known = position_ok and params.place.length_m > 0.0
    airspeed_error = state.airspeed_error
    if position_ok and not air.measured:
        airspeed_error = airspeed_error_step(airspeed_error, vehicle, air.airspeed_mps, dt_s)
    air = corrected_air(airspeed_error, air)
    low, high = slowest_known(params, air.measured), params.polar.speed_max_mps
    wanted = approach_speed(params, low, vehicle, air) if known else params.best_glide_mps
    sink_mps = polar_sink(params.polar, slowest(params))
    state = stall_step(state, sink_mps, position_ok, nose_held, vehicle, dt_s)
    state = incidence_step(state, air, dt_s)
    if state.stalled:
        wanted = max(wanted, params.best_glide_mps)
    speed = speed_setpoint(state, air.airspeed_mps, low, high, wanted)
    over_m = vehicle.z_m - params.place.z_m - FINAL_M
    from_high = state.from_high or (known and over_m > HIGH_M)
    fast = not air.measured and not from_high
    weaves, goes_right = 0.0, _goes_right(params, state, speed, over_m, fast, vehicle)
    if known and not outward and over_m <= 0.0:
        wanted = max(wanted, min(high, final_speed(params, air.measured)))
    elif known and not outward:
        if wanted <= low:
            weaves = weave(params, goes_right, low, state.sink_mps, vehicle, air, fast)
        looks = over_m > LOOK_ABOVE_M and airspeed_sigma(airspeed_error, air) > LOOK_MPS
        if looks:
            most = max(abs(weaves), min(LOOK_RAD, to_abeam(params.place, goes_right, air)))
            weaves = most if goes_right else -most
    # From the best glide's speed there is more to be lost.
    turns_by = TURNS_BY_MPS if air.measured else 2.0 * TURNS_BY_MPS
    if state.stalled or not air.airspeed_mps >= low - turns_by:  # NaN: not known
        weaves = 0.0
    turn = WEAVE_RADPS * dt_s
    weaves = state.weave_rad + max(-turn, min(turn, weaves - state.weave_rad))
    if outward and air.wind_mps == air.wind_mps:  # out of the lift first
        wanted = max(wanted, min(high, air.wind_mps + 4.0 * ADVANCE_MPS))
    flares = position_ok and flare_height(params, vehicle, clearance_m) <= max(
        FLARE_MIN_M, -vehicle.climb_mps * FLARE_S
    )
    state = hold_step(state, speed, wanted, flares, air.airspeed_mps, dt_s)._replace(
        weave_rad=weaves,
        goes_right=goes_right,
        airspeed_error=airspeed_error,
        from_high=from_high,
    )
    speed = air.airspeed_mps
    return state, speed if flares and speed == speed else state.speed_mps


def _goes_right(
    params: LandingParams,
    state: GlideState,
    speed_mps: float,
    over_m: float,
    fast: bool,
    vehicle: VehicleState,
) -> bool:
    """Whether a weave goes on to the right, or turns there."""
    # How far off the aircraft will be when it has turned into the wind: V ∫ sin psi dt.
    turning_m = speed_mps * (1.0 - cos(state.weave_rad)) / WEAVE_RADPS
    off = across(params.place, vehicle.x_m, vehicle.y_m)
    off += turning_m if state.weave_rad > 0.0 else -turning_m
    off += (FAST_LAG_S if fast else WEAVE_LAG_S) * speed_mps * sin(state.weave_rad)
    most = half_width(params, over_m, fast)
    return off < most if state.goes_right else off < -most


def flare_height(params: LandingParams, vehicle: VehicleState, clearance_m: float) -> float:
    """Over the ground, else over the landing place [m]; inf: not known."""
    if clearance_m < INFINITE:
        return clearance_m
    return vehicle.z_m - params.place.z_m if params.place.length_m > 0.0 else INFINITE


def glide_setpoints(
    params: LandingParams,
    state: GlideState,
    outward: bool,
    position_ok: bool,
    pitches: GlidePitches,
    vehicle: VehicleState,
    air: AirEstimate,
    clearance_m: float,
) -> GlideSetpoints:
    """What follows of it."""
    air = corrected_air(state.airspeed_error, air)
    speed = air.airspeed_mps if air.airspeed_mps > 1.0 else max(1.0, params.best_glide_mps)
    if state.flares:
        height = flare_height(params, vehicle, clearance_m)
        sink_wanted = max(SINK_MPS, height / FLARE_S)
        pitch = glide_pitch_held(state, pitches, params.glide_pitch_rad)
        pitch += KF * (-vehicle.climb_mps - sink_wanted) / speed
    else:
        pitch = speed_pitch(state, pitches, params.glide_pitch_rad, air.airspeed_mps, air.measured)
    if not (position_ok and params.place.length_m > 0.0):
        return GlideSetpoints(pitch, 0.0, 0.0, 0.0)
    if state.weave_rad != 0.0:
        steeper = _steeper(params, state, vehicle, air)
        return GlideSetpoints(pitch, state.weave_rad, speed * sin(state.weave_rad), steeper)
    bearing = params.escape_rad if outward else params.place.bearing_rad
    wind = air.wind_mps if air.wind_mps == air.wind_mps else 0.0
    forward = ground_speed(speed, wind, 0.0, bearing)
    forward = forward if forward >= ADVANCE_MPS else ADVANCE_MPS
    sideways = forward * sin(bearing)
    if not outward:
        back = -across(params.place, vehicle.x_m, vehicle.y_m) / CROSS_S
        sideways += max(-CROSS_MPS, min(CROSS_MPS, back)) * cos(bearing)
    drift = cross_wind(air)
    heading = asin(max(-1.0, min(1.0, (sideways - drift) / max(speed, 1.0))))
    most = params.heading_max_rad
    return GlideSetpoints(pitch, max(-most, min(most, heading)), sideways, 0.0)


def _steeper(
    params: LandingParams, state: GlideState, vehicle: VehicleState, air: AirEstimate
) -> float:
    """By how much of itself the largest bank of a weave may be more: 0 … STEEPER."""
    if air.measured or state.stalled or airspeed_sigma(state.airspeed_error, air) > STEEP_MPS:
        return 0.0
    over_m = vehicle.z_m - params.place.z_m - FINAL_M - STEEP_ABOVE_M
    return STEEPER * max(0.0, min(1.0, over_m / STEEP_WITHIN_M))


def steeper_bank(params: LandingParams, bank_rad: float, steeper: float) -> float:
    """The largest bank [rad], made steeper within these bounds, where it is not more already."""
    most = min(STEEP_MAX_RAD, STEEP_FRACTION * params.tilt_max_rad)
    return max(bank_rad, min(most, bank_rad * (1.0 + steeper)))

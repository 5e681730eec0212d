"""Where on its line the aircraft will stop, and when; or that it will stop nowhere it may be.

A line holds the aircraft across itself and leaves it free along itself.  There it slides to where
its excess updraft vanishes, and where none of the line has such a place it slides into the ground
or out of the fence, holding the line all the way.  With s up the line from the aircraft,

    c s' = E(s) + (V/g) cos(eta) s''     c = sin(eta) − S'(u) cos(eta)
    E(s) = w − S(u)                      excess updraft of an aircraft at rest over the ground

w, u   m/s  updraft and horizontal wind there      S   m/s  sink in still air, S' its slope
eta    rad  the line's inclination                 V   m/s  airspeed

E is read from the flight itself, by the variometer: what a glider climbs with, less what it
trades for speed over the ground.  With v the velocity downstream, the energy of the unsteady glide

    z' = w − S(V) + (V/g) v'         gives         h' = E + S(u) − S(V),   h = z − (V/g) v

Of an aircraft with a propeller, what that climbs with (T V / m g) is taken off h' first.

h needs no model of sink but its slope, and no calibrated updraft: an aircraft that stands still
has E = 0, however wrong either is.  A Kalman filter, every PERIOD_S, holds h, a = E at the
aircraft, and b = dE/ds; the wind u and its slope have a filter of their own:

    dh = (a + S(u) − S(V)) dt + gusts      2 v (depth / V) dt: v is the variance of the updraft's
                                           gusts, as they are measured
    da = b ds + across the line + in time  (S²/depth) |dn|, (CHANGE S)² dt
    db = towards −SLOPE S/depth over a way of depth, SLOPE_SD S/depth about it

depth is the distance down the line to the ground, the one length that a flight knows of its air.
Where air flows over a slope its updraft is made at the ground and fades above it (a harmonic
function is largest on the edge of the air): over depth it changes by about as much as there is,
which is about S where an aircraft is soared.  So E falls up the line by the order of S/depth, its
slope is another one a depth away, and an eddy is as large as depth.  Upstream of a slope, where the
ground is level, this is too hopeful: there the measured slope, and in the end the time that is
left, decide.

What may come: E at d from here is a + b d, as uncertain as both are and as b may change on the
way.  A stop on the way down has E > 0 below it, one on the way up has E < 0 above it:

    chance = the largest, over the way to the limit, of P(E(d) is on that side)

for the way down and the way up, weighted by the chances of a < 0 and a > 0.  The way down ends
where the clearance does, or the fence; the way up at the fence.  There is nowhere to settle

    where the chance of it is below FC_CHANCE, on a line that stands still, or
    where it sinks, the limit is less than FC_TIME away, and the chance is below SOON_CHANCE

in HOLDS readings one after the other; and where the wind at the place where it would stop is, as
surely, too slow or too fast for the polar, or slower than SPEED_MIN.

Pure: numbers in, numbers out.  What is done about it is decided in `conditions`: a `Forecast` says
where, when and which limit.
"""

from __future__ import annotations

from math import cos, erf, log, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.control.envelope import LOW_AHEAD_S, Fence
from tgl_soar.control.line_room import DEPTH_MAX_M, LineRoom, line_room
from tgl_soar.types import (
    GRAVITY_MPS2,
    INFINITE,
    NAN,
    AirEstimate,
    GlidePolar,
    Ground,
    VehicleState,
    isfinite,
    polar_sink,
    polar_slope,
)

# A slide takes half a second or more for its 63 % (1 / λ), and a gust of a metre as long to pass.
PERIOD_S: Final = 0.1
LEAST_MPS: Final = 1e-3  # of airspeed: nothing flies so slowly, and it is divided by
GAP_S: Final = 0.5  # without readings: what was known of place and slope is of somewhere else
# Before anything is foreseen E has been read over as long as the slide's inertia lasts, twice:
# V sin(lean) / (g c) is 0.25 s at 8.5 m/s and a lean of 15 deg.
WINDOW_S: Final = 0.5
HOLDS: Final = 2  # readings in a row: one may be a spike
# Near the limit two to one against it is enough: what is lost by a wrong forecast is one flight,
# what is lost by waiting is the reserve above CLEAR_MIN, and below that the module recovers.
SOON_CHANCE: Final = 1.0 / 3.0
# E's slope along a line, times depth / S: 1 where updraft fades as 1 / height, less where wind is
# faster above and sink with it; and it may well be none at all, or twice that.
SLOPE: Final = 0.7
SLOPE_SD: Final = 0.7
WIND_SLOPE_SD: Final = 0.5  # of the wind's, times depth / u: the ground stops less than half of it
# A wind that rises or falls by a fifth in ten seconds changes updraft, and so E, by 2 % of S each
# second: the same after two seconds as a random walk of 3 % per root second.
CHANGE: Final = 0.03
GUST_INTENSITY: Final = 0.03  # of the wind, until gusts were measured
GUST_S: Final = 3.0  # over so long their variance is averaged, in the end
GUST_FIRST_S: Final = (
    0.5  # of readings outweigh that first guess: three eddies of a metre and a half
)
HEIGHT_SD_M: Final = 0.01  # of h, beside what the velocity's uncertainty makes of it
# At most: without accelerometers an estimate allows for any manoeuvre. Held by a line an aircraft
# accelerates by g times its pitch's error, 0.025 rad, for the 0.2 s by which such a velocity lags.
VELOCITY_SD_MAX_MPS: Final = 0.05
PLACES: Final = 6  # where E is looked at: at the limit, half-way there, half of that …
STOPPED: Final = 3.0  # time constants 1 / λ after which the aircraft counts as stopped: 95 %

# What is done about it: FC_ACT.
OFF: Final = 0
REPORT: Final = 1
DISENGAGE: Final = 2
DISENGAGE_EARLY: Final = 3
SEARCH_FIRST: Final = 4  # for a place elsewhere, and disengage where there is none

# How it stands.
UNKNOWN: Final = 0  # not held by a line, or not for WINDOW_S yet, or nothing is known of the air
SETTLES: Final = 1
TOO_LOW: Final = 2
OUTSIDE: Final = 3
TOO_SLOW: Final = 4
TOO_FAST: Final = 5
FORECAST_TEXTS: Final = (
    "",
    "settles on the line",
    "sinks below CLEAR_MIN",
    "leaves the fence",
    "wind too slow to stop in",
    "wind too fast to stop in",
)


class ForecastParams(NamedTuple):
    """What the forecast goes by."""

    act: int  # OFF … SEARCH_FIRST
    time_s: float  # FC_TIME
    chance: float  # FC_CHANCE
    clearance_min_m: float
    speed_min_mps: float
    polar: GlidePolar
    pushed_mps: float = 0.0  # climb that a propeller adds now: no lift of the air's


class Forecast(NamedTuple):
    """Where the aircraft will stop on its line, as far as it can be foreseen."""

    standing: int  # 0 not known, 1 settles, 2 … why there is nowhere to settle
    x_m: float  # the place where it stops, else where it passes the limit; NaN: not known
    z_m: float  # height of that place
    sigma_m: float  # standard deviation of that place, along the line
    ahead_s: float  # until it is there; inf: never
    chance: float  # that there is a place to stop within the limits, 0 … 1
    excess_mps: float  # updraft less sink, at rest, gusts averaged out
    slope_per_s: float  # its slope up the line


class LiftReadings(NamedTuple):
    """h, a and b at the last reading, and their covariance."""

    h_m: float  # z − (V/g) v
    a_mps: float  # E at the aircraft
    b_per_s: float  # dE/ds
    p_hh: float  # variance of h, in m²
    p_ha: float  # covariance of h and a, in m²/s
    p_hb: float  # covariance of h and b, in m/s
    p_aa: float  # variance of a, in m²/s²
    p_ab: float  # covariance of a and b, in m/s²
    p_bb: float  # variance of b, in 1/s²


class WindReadings(NamedTuple):
    """The wind along the line at the last reading, and its covariance."""

    u_mps: float  # gusts averaged out
    g_per_s: float  # du/ds
    p_uu: float  # variance of u, in m²/s²
    p_ug: float  # covariance of u and g, in m/s²
    p_gg: float  # variance of g, in 1/s²


class GustReadings(NamedTuple):
    """What the wind estimate differs by from a."""

    offset_mps: float  # on average: the bias of estimate and polar
    variance_m2ps2: float  # about that: the updraft's gusts


class ForecastState(NamedTuple):
    """What the forecast remembers from one tick to the next."""

    begun_s: float  # of the first reading; NaN: none
    time_s: float  # of the last reading
    x_m: float  # where that was, downstream
    z_m: float  # where that was, height
    held: int  # readings in a row with nowhere to settle
    lift: LiftReadings
    wind: WindReadings
    gusts: GustReadings
    foreseen: Forecast


NO_FORECAST: Final = Forecast(
    standing=UNKNOWN,
    x_m=NAN,
    z_m=NAN,
    sigma_m=NAN,
    ahead_s=NAN,
    chance=NAN,
    excess_mps=NAN,
    slope_per_s=NAN,
)
_NO_LIFT: Final = LiftReadings(
    h_m=NAN,
    a_mps=NAN,
    b_per_s=NAN,
    p_hh=NAN,
    p_ha=NAN,
    p_hb=NAN,
    p_aa=NAN,
    p_ab=NAN,
    p_bb=NAN,
)
_NO_WIND: Final = WindReadings(u_mps=NAN, g_per_s=NAN, p_uu=NAN, p_ug=NAN, p_gg=NAN)


class _Sight(NamedTuple):
    """What one reading sees."""

    vehicle: VehicleState
    air: AirEstimate
    velocity_sigma_mps: float
    eta_rad: float
    depth_m: float


def initial_forecast() -> ForecastState:
    """Nothing was read yet."""
    return ForecastState(
        begun_s=NAN,
        time_s=NAN,
        x_m=NAN,
        z_m=NAN,
        held=0,
        lift=_NO_LIFT,
        wind=_NO_WIND,
        gusts=GustReadings(NAN, NAN),
        foreseen=NO_FORECAST,
    )


def forecast_step(
    params: ForecastParams,
    fence: Fence,
    ground: Ground,
    state: ForecastState,
    vehicle: VehicleState,
    air: AirEstimate,
    velocity_sigma_mps: float,
    eta_rad: float,
    moving: bool,
) -> ForecastState:
    """One tick on a line of inclination eta_rad; a reading where one is due.

    velocity_sigma_mps: of the vehicle's velocity, on each axis.  moving: the line is on its way.
    Where vehicle, air or polar are not known nothing is read, and after GAP_S of that the forecast
    begins again.
    """
    if params.act == OFF:
        return initial_forecast()
    now = vehicle.time_s
    passed = now - state.time_s
    if 0.0 <= passed < PERIOD_S - 1e-6:
        return _as_it_moves(params, state) if moving else state
    vx, climb = vehicle.velocity_x_mps, vehicle.climb_mps
    known = isfinite(vehicle.x_m + vehicle.z_m + vx + climb + eta_rad + params.polar.c0)
    known = known and isfinite(air.wind_mps + air.updraft_mps + air.wind_sigma_mps)
    if not (known and isfinite(velocity_sigma_mps) and air.wind_mps - vx > LEAST_MPS):
        return state if 0.0 <= passed < GAP_S else initial_forecast()
    limits = line_room(params.clearance_min_m, fence, ground, vehicle.x_m, vehicle.z_m, eta_rad)
    sight = _Sight(
        vehicle=vehicle,
        air=air,
        velocity_sigma_mps=velocity_sigma_mps,
        eta_rad=eta_rad,
        depth_m=limits.depth_m,
    )
    begun, held, forecast = now, 0, NO_FORECAST
    if 0.0 <= passed < GAP_S:
        begun = state.begun_s
        lift = _lift_read(params.polar, params.pushed_mps, state, sight, passed)
        wind = _wind_read(state, sight, passed)
        gusts = _gusts_read(params.polar, state, lift.a_mps, air, passed)
    else:  # NaN: the first
        lift, wind, gusts = _first(params.polar, sight)
    if now - begun >= WINDOW_S - 1e-6:
        forecast = _foreseen(params, lift, wind, limits, sight, moving)
    if nowhere(forecast):
        held = state.held + 1
        if held < HOLDS:
            forecast = forecast._replace(standing=SETTLES)
    return ForecastState(
        begun_s=begun,
        time_s=now,
        x_m=vehicle.x_m,
        z_m=vehicle.z_m,
        held=held,
        lift=lift,
        wind=wind,
        gusts=gusts,
        foreseen=forecast,
    )


def _as_it_moves(params: ForecastParams, state: ForecastState) -> ForecastState:
    """What was read of a line that stood still, as soon as it moves: then only the time that is
    left counts, and who moves it away from where there is no place is not to be stopped for it."""
    read = state.foreseen
    soon = read.excess_mps < 0.0 and read.ahead_s < params.time_s and read.chance < SOON_CHANCE
    if not nowhere(read) or soon:
        return state
    return state._replace(held=0, foreseen=read._replace(standing=SETTLES))


def nowhere(forecast: Forecast) -> bool:
    """Whether it is foreseen that there is no place to settle."""
    return forecast.standing > SETTLES


def is_the_last_moment(params: ForecastParams, forecast: Forecast) -> bool:
    """Whether there is most probably no place to settle, and no time left to see.

    An aircraft that soars has been where it settles: in gusts of 5 % it slides as if the lift had
    gone, and mostly comes back.  So it is waited for as long as that costs nothing, which is until
    a change of pitch could not turn the flight path before the limit any more.
    """
    return forecast.ahead_s <= LOW_AHEAD_S and forecast.chance < params.chance


def forecast_words(forecast: Forecast) -> str:
    """Why there is no place to settle, in words; "" where one is foreseen or nothing is."""
    if forecast.standing <= SETTLES:
        return ""
    words = FORECAST_TEXTS[forecast.standing]
    return f"{words} in {forecast.ahead_s:.1f} s" if isfinite(forecast.ahead_s) else words


def _sink(polar: GlidePolar, speed_mps: float) -> float:
    """Sink [m/s]; beyond the polar's range that at its end."""
    return polar_sink(polar, max(polar.speed_min_mps, min(polar.speed_max_mps, speed_mps)))


def _first(polar: GlidePolar, sight: _Sight) -> tuple[LiftReadings, WindReadings, GustReadings]:
    """The first reading.

    An aircraft that is released here was held until now, and its estimates include the hand: of a
    no more is taken for known than that updrafts and sinks of aircraft that soar are alike.
    """
    air, vx = sight.air, sight.vehicle.velocity_x_mps
    sink = _sink(polar, air.wind_mps)
    gust = GUST_INTENSITY * air.wind_mps
    slope, wind_slope = sink / sight.depth_m, WIND_SLOPE_SD * air.wind_mps / sight.depth_m
    turns_s = (air.wind_mps - vx) / GRAVITY_MPS2
    noise = turns_s * min(VELOCITY_SD_MAX_MPS, sight.velocity_sigma_mps)
    lift = LiftReadings(
        h_m=sight.vehicle.z_m - turns_s * vx,
        a_mps=air.updraft_mps - sink,
        b_per_s=-SLOPE * slope,
        p_hh=HEIGHT_SD_M * HEIGHT_SD_M + noise * noise,
        p_ha=0.0,
        p_hb=0.0,
        p_aa=sink * sink,
        p_ab=0.0,
        p_bb=SLOPE_SD * SLOPE_SD * slope * slope,
    )
    wind = WindReadings(
        u_mps=air.wind_mps,
        g_per_s=0.0,
        p_uu=gust * gust,
        p_ug=0.0,
        p_gg=wind_slope * wind_slope,
    )
    return lift, wind, GustReadings(0.0, gust * gust)


def _moved(state: ForecastState, sight: _Sight) -> tuple[float, float]:
    """How far the aircraft has come since the last reading, up the line and across it [m]."""
    dx, dz = sight.vehicle.x_m - state.x_m, sight.vehicle.z_m - state.z_m
    c, s = cos(sight.eta_rad), sin(sight.eta_rad)
    return dx * c + dz * s, dz * c - dx * s


def _lift_read(
    polar: GlidePolar, pushed_mps: float, state: ForecastState, sight: _Sight, dt_s: float
) -> LiftReadings:
    """h, a and b carried on from the last reading, and corrected by this one's h."""
    h, a, b, hh, ha, hb, aa, ab, bb = state.lift
    vx, u, depth_m = sight.vehicle.velocity_x_mps, state.wind.u_mps, sight.depth_m
    ds, dn = _moved(state, sight)
    sink = _sink(polar, u)
    slope, change = sink / depth_m, CHANGE * sink
    speed = sight.air.wind_mps - vx
    # F = [1 dt 0; 0 1 ds; 0 0 1], then b fades towards what it is expected to be
    h += (a + sink - _sink(polar, u - vx) + pushed_mps) * dt_s
    a += b * ds
    on_ha, on_hb = ha + dt_s * aa, hb + dt_s * ab
    hh += dt_s * (ha + on_ha) + 2.0 * state.gusts.variance_m2ps2 * depth_m / speed * dt_s
    ha, hb = on_ha + ds * on_hb, on_hb
    aa += ds * (2.0 * ab + ds * bb) + slope * slope * depth_m * abs(dn) + change * change * dt_s
    ab += ds * bb
    keeps = 1.0 - min(1.0, abs(ds) / depth_m)
    b = -SLOPE * slope + keeps * (b + SLOPE * slope)
    hb, ab = keeps * hb, keeps * ab
    bb = keeps * keeps * bb + (1.0 - keeps * keeps) * SLOPE_SD * SLOPE_SD * slope * slope

    turns_s = speed / GRAVITY_MPS2
    noise = turns_s * min(VELOCITY_SD_MAX_MPS, sight.velocity_sigma_mps)
    innovation = sight.vehicle.z_m - turns_s * vx - h
    variance = hh + HEIGHT_SD_M * HEIGHT_SD_M + noise * noise
    k_h, k_a, k_b = hh / variance, ha / variance, hb / variance
    return LiftReadings(
        h_m=h + k_h * innovation,
        a_mps=a + k_a * innovation,
        b_per_s=b + k_b * innovation,
        p_hh=hh - k_h * hh,
        p_ha=ha - k_h * ha,
        p_hb=hb - k_h * hb,
        p_aa=aa - k_a * ha,
        p_ab=ab - k_a * hb,
        p_bb=bb - k_b * hb,
    )


def _wind_read(state: ForecastState, sight: _Sight, dt_s: float) -> WindReadings:
    """The wind along the line; its gusts are new ones after depth / V."""
    u, slope, uu, us, ss = state.wind
    ds, dn = _moved(state, sight)
    wind_mps, depth_m = sight.air.wind_mps, sight.depth_m
    expected, change = WIND_SLOPE_SD * wind_mps / depth_m, CHANGE * u
    u += slope * ds
    uu += ds * (2.0 * us + ds * ss)
    uu += expected * expected * depth_m * abs(dn) + change * change * dt_s
    us += ds * ss
    keeps = 1.0 - min(1.0, abs(ds) / depth_m)
    slope, us = keeps * slope, keeps * us
    ss = keeps * keeps * ss + (1.0 - keeps * keeps) * expected * expected

    speed = wind_mps - sight.vehicle.velocity_x_mps
    alike = max(1.0, 2.0 * depth_m / (speed * dt_s))  # readings of the same gust
    variance = uu + state.gusts.variance_m2ps2 * alike
    miss = wind_mps - u
    k_u, k_s = uu / variance, us / variance
    return WindReadings(
        u_mps=u + k_u * miss,
        g_per_s=slope + k_s * miss,
        p_uu=uu - k_u * uu,
        p_ug=us - k_u * us,
        p_gg=ss - k_s * us,
    )


def _gusts_read(
    polar: GlidePolar, state: ForecastState, a_mps: float, air: AirEstimate, dt_s: float
) -> GustReadings:
    """How much the wind estimate's excess updraft varies about a."""
    gusts, age_s = state.gusts, state.time_s - state.begun_s
    blend = min(1.0, dt_s / min(GUST_S, GUST_FIRST_S + age_s + dt_s))
    gust = air.updraft_mps - _sink(polar, air.wind_mps) - a_mps - gusts.offset_mps
    return GustReadings(
        gusts.offset_mps + blend * gust,
        gusts.variance_m2ps2 + blend * (gust * gust - gusts.variance_m2ps2),
    )


def _below(mean: float, variance: float) -> float:
    """The chance that a normal number is negative."""
    if not variance > 0.0:
        return 1.0 if mean < 0.0 else 0.0
    return 0.5 - 0.5 * erf(mean / sqrt(2.0 * variance))


def _stops(lift: LiftReadings, way_m: float, side: float, curve: float) -> float:
    """The chance that E has changed its sign within a way: down the line, side −1, to more than
    nothing, up the line, side +1, to less.  curve: what b's variance grows by with each metre."""
    best = _below(side * lift.a_mps, lift.p_aa)
    d = side * min(way_m, DEPTH_MAX_M)
    for _ in range(PLACES):
        mean = lift.a_mps + lift.b_per_s * d
        variance = lift.p_aa + d * (2.0 * lift.p_ab + d * lift.p_bb)
        variance += curve * abs(d) * d * d / 3.0
        best = max(best, _below(side * mean, variance))
        d *= 0.5
    return best


def _foreseen(
    params: ForecastParams,
    lift: LiftReadings,
    wind: WindReadings,
    limits: LineRoom,
    sight: _Sight,
    moving: bool,
) -> Forecast:
    """What follows from the readings."""
    polar, vehicle = params.polar, sight.vehicle
    along_x, along_z = cos(sight.eta_rad), sin(sight.eta_rad)
    u = max(polar.speed_min_mps, min(polar.speed_max_mps, wind.u_mps))
    sink, c = polar_sink(polar, u), max(0.3, along_z - polar_slope(polar, u) * along_x)
    a, b = lift.a_mps, lift.b_per_s
    slide = vehicle.velocity_x_mps * along_x + vehicle.climb_mps * along_z
    inertia_s = -along_x * (sight.air.wind_mps - vehicle.velocity_x_mps) / (GRAVITY_MPS2 * c)
    coast = max(0.0, inertia_s) * (slide - a / c)  # up the line, before E alone moves it
    down, up = max(0.0, limits.down_m + coast), max(0.0, limits.up_m - coast)

    curve = 2.0 * SLOPE_SD * SLOPE_SD * sink * sink / (sight.depth_m**3)
    sinks = _below(a, lift.p_aa)
    chance = sinks * _stops(lift, down, -1.0, curve)
    chance += (1.0 - sinks) * _stops(lift, up, 1.0, curve)
    goes, ahead_s, stops = stop_on_way(a, b, c, down, up)
    variance = lift.p_aa + goes * (2.0 * lift.p_ab + goes * lift.p_bb)
    sigma_m = sqrt(max(0.0, variance)) / max(abs(b), sqrt(lift.p_bb))

    standing = SETTLES
    soon = a < 0.0 and not stops and ahead_s < params.time_s and chance < SOON_CHANCE
    if soon or (chance < params.chance and not moving):
        standing = TOO_LOW if a < 0.0 and not limits.down_is_fence else OUTSIDE
    elif not moving:
        there = wind.u_mps + wind.g_per_s * goes
        spread = wind.p_uu + goes * (2.0 * wind.p_ug + goes * wind.p_gg)
        spread += sight.air.wind_sigma_mps * sight.air.wind_sigma_mps
        slowest = max(polar.speed_min_mps, params.speed_min_mps)
        if _below(slowest - there, spread) < params.chance:
            standing = TOO_SLOW
        elif _below(there - polar.speed_max_mps, spread) < params.chance:
            standing = TOO_FAST
    return Forecast(
        standing=standing,
        x_m=vehicle.x_m + (coast + goes) * along_x,
        z_m=vehicle.z_m + (coast + goes) * along_z,
        sigma_m=sigma_m,
        ahead_s=ahead_s,
        chance=chance,
        excess_mps=a,
        slope_per_s=b,
    )


def stop_on_way(
    a: float, b: float, c: float, down_m: float, up_m: float
) -> tuple[float, float, bool]:
    """How far up the line an aircraft goes, the time until it is there, and whether it stops there.

    c s' = a + b s from s = 0: it stops at −a / b where b < 0 and that is within the limits, after
    STOPPED / λ, λ = −b / c; else it is at the limit d after (c / b) ln(1 + b d / a).
    """
    way = -down_m if a < 0.0 else up_m
    if b < 0.0 and abs(a / b) < abs(way):
        return -a / b, -STOPPED * c / b, True
    if way == 0.0:
        return 0.0, 0.0, False
    if a == 0.0:
        return 0.0, INFINITE, False
    grown = b * way / a
    if grown <= -1.0:
        return way, INFINITE, False
    if abs(grown) < 1e-6:
        return way, c * way / a, False
    return way, c / b * log(1.0 + grown), False

"""The paper's aircraft: a point mass with the drag of its polar, without moments of inertia.

The paper's equations, corrected (docs/theory.md, "Misprints"), in a steady glide at airspeed V,
with the path's angle γ below the horizon, incidence α and thrust T along the nose:

    m g cos γ = L + T sin α                              (1)   L = ½ ρ V² S C_L                  (3)
    m g sin γ = D − T cos α                              (2)   C_L ≈ 2 m g / (ρ V² S)            (4)
    D = ½ ρ V² S (a0 + a1 C_L + a2 C_L²)                 (5)
    γ ≈ ½ ρ V² S (a0 + a1 C_L + a2 C_L²) / (m g) − T / (m g)                                     (6)
    x' = w_x − V cos γ     z' = w_z − V sin γ            (7, 8; facing upwind, w the wind)

These hold for glides that are steady, and answer no change of pitch.  What closes them is ours:
the forces of (1) and (2) need not balance, and what is left of them moves the mass,

    V' = −g sin γₚ + (T cos α − D) / m − (the wind's change along the path)
    V γₚ' = −g cos γₚ + (L + T sin α) / m − (the wind's change across it),   γₚ = −γ of the path

which is m dv/dt = F + m g for the velocity over the ground v = wind + (V, γₚ), in three
dimensions: v is the state, and no derivative of the wind is ever needed.  Lift follows the
incidence, side force the sideslip and the rudder:

    C_L = C_L0 + C_Lα sin α + C_Lδe δe        C_Y = C_Yβ sin β + C_Yδr δr
    C_D = a0 + a1 C_L + a2 C_L² + C_Dβ sin² β

A point has no moment of inertia, so the air's moments balance at once and leave attitudes that
follow the surfaces by first-order lags.  Of the rigid body's moments (`sim.aircraft`) each axis
keeps its own stiffness, damping and surface:

    q = (V / ℓ_θ) (sin α_c − sin α),    sin α_c = −(C_m0 + C_mδe δe) / C_mα
    r = (V / ℓ_ψ) (sin β − sin β_c),    sin β_c = −C_nδr δr / C_nβ
    p' = (V / ℓ_φ) (V k δa + p_g − p),  k = −2 C_lδa / (b C_lp)

so that pitch goes to α_c above the flow's direction, heading to β_c beside it, and the bank's rate
to that of the ailerons.  A lag is a length, flown in its time.  An axis that would swing (I its
inertia, K its stiffness, both of V² Q) has that of its frequency, one that would creep that of its
damping over its stiffness, and the bank, which nothing holds, that of its inertia over its damping:

    ℓ_θ = max(c C_mq / 2 C_mα, √(2 I_yy / (ρ S c |C_mα|)))
    ℓ_ψ = max(b |C_nr| / 2 C_nβ, √(2 I_zz / (ρ S b C_nβ)))        ℓ_φ = 4 I_xx / (ρ S b² |C_lp|)

a0, a1 and a2 follow from the airframe's polar by least squares in sink: its cubic is no (5), and
`polar_misfit` is how far the model's own glides are from it.

Not shown: the stall (lift grows with incidence without end), the short period and the Dutch roll
(a lag cannot swing), and what couples the axes: dihedral, adverse yaw, banking in gusts.

Source: the paper's equations (1)–(8); the moments' coefficients as in `sim.aircraft`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, isfinite, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.sim.aircraft import (
    RATE_LIMIT_RADPS,
    SLOWEST_MPS,
    AircraftState,
    Glide,
    Quaternion,
    Triple,
    Wind,
    air_velocity_frd,
    aircraft_model,
)
from tgl_soar.types import GlidePolar, SurfaceCommand, polar_sink

# Of the polar, evenly spaced: a cubic and a parabola differ by a curve with three bends at most.
_SPEEDS: Final = 81
_FASTEST_MPS: Final = 1e3
# Where glides are looked for: from an incidence far beyond any polar's to almost no lift.
_STEEPEST_SIN_ALPHA: Final = 0.9
_SEARCH_SIN_ALPHA: Final = 0.01
_LEAST_LIFT: Final = 0.1
THRUST: Final = "thrust_n"  # the key of `[model]` that the rigid body does not know


class PointMass(NamedTuple):
    """Everything the equations above take."""

    mass_kg: float
    wing_area_m2: float
    span_m: float
    gravity_mps2: float
    air_density_kgpm3: float
    thrust_n: float
    a0: float
    a1: float
    a2: float
    CD_beta: float
    CL0: float
    CL_alpha: float  # per rad
    CL_elevator: float  # per half-throw, as all derivatives by a deflection
    CY_beta: float
    CY_rudder: float
    sin_alpha_neutral: float  # sin α_c with the elevator in the middle
    sin_alpha_elevator: float  # what a half-throw adds
    sin_beta_rudder: float  # sin β_c of a half-throw
    CL_brake: float  # of all of the brake; all three are 0 without one
    CD_brake: float
    sin_alpha_brake: float  # what it adds to sin α_c
    roll_aileron_radpm: float  # k
    pitch_lag_m: float  # ℓ
    roll_lag_m: float
    heading_lag_m: float
    slowest_mps: float  # horizontal; where the polar begins

    # What the world asks of any aircraft (`sim.flown_aircraft`):

    def step(
        self,
        state: AircraftState,
        surfaces: SurfaceCommand,
        wind_here: Wind,
        wind_ahead: Wind,
        roll_gust_here_radps: float,  # noqa: ARG002 - the rate's lag is stepped implicitly
        roll_gust_ahead_radps: float,
        dt_s: float,
    ) -> AircraftState:
        """The aircraft `dt_s` [s] later."""
        gust = roll_gust_ahead_radps
        return point_mass_step(self, state, surfaces, wind_here, wind_ahead, dt_s, gust)

    def spun(
        self,
        throttle: float,  # noqa: ARG002 - its thrust is constant
        wanted: float,  # noqa: ARG002
        dt_s: float,  # noqa: ARG002
    ) -> float:
        """No throttle moves it."""
        return 0.0

    def specific_force_frd(self, state: AircraftState, wind: Wind) -> tuple[float, float, float]:
        """What an accelerometer feels [m/s², FRD]."""
        ub, vb, wb = air_velocity_frd(state, wind)
        own = _braked(self, state.brake)
        fx, fy, fz, _, _, _ = _in_the_air(own, ub, vb, wb, state.elevator, state.rudder)
        return fx, fy, fz

    def highest_pitch_glide(self) -> Glide:
        """The slowest glide of the polar: without a stall pitch only grows as speed falls."""
        return point_mass_glide_at(self, self.slowest_mps)

    def glide_at(self, horizontal_mps: float) -> Glide:
        """The steady glide at a horizontal airspeed [m/s].  Errors: ValueError."""
        return point_mass_glide_at(self, horizontal_mps)


class PolarMisfit(NamedTuple):
    """How far a point mass's steady glides are from the polar that it was fitted to."""

    rms_mps: float  # of sink, over the polar's range
    most_mps: float


# --- one step -----------------------------------------------------------------------------


def _in_the_air(
    model: PointMass, ub: float, vb: float, wb: float, elevator: float, rudder: float
) -> tuple[float, float, float, float, float, float]:
    """Specific force [m/s², FRD], pitch and yaw rate [rad/s] and airspeed [m/s]."""
    plane2 = ub * ub + wb * wb
    speed = sqrt(plane2 + vb * vb)
    plane = sqrt(plane2)
    inverse_plane = 1.0 / plane if plane > SLOWEST_MPS else 1.0 / SLOWEST_MPS
    inverse_speed = 1.0 / speed if speed > SLOWEST_MPS else 1.0 / SLOWEST_MPS
    sin_alpha = wb * inverse_plane
    cos_alpha = ub * inverse_plane
    sin_beta = vb * inverse_speed
    cos_beta = plane * inverse_speed

    cl = model.CL0 + model.CL_alpha * sin_alpha + model.CL_elevator * elevator
    cd = model.a0 + (model.a1 + model.a2 * cl) * cl + model.CD_beta * sin_beta * sin_beta  # (5)
    cy = model.CY_beta * sin_beta + model.CY_rudder * rudder
    per_mass = 0.5 * model.air_density_kgpm3 * speed * speed * model.wing_area_m2 / model.mass_kg
    lift, drag, side = per_mass * cl, per_mass * cd, per_mass * cy  # (3)
    drag_plane = drag * cos_beta + side * sin_beta
    limit = RATE_LIMIT_RADPS
    trimmed = model.sin_alpha_neutral + model.sin_alpha_elevator * elevator
    q = speed / model.pitch_lag_m * (trimmed - sin_alpha)
    r = speed / model.heading_lag_m * (sin_beta - model.sin_beta_rudder * rudder)
    return (
        lift * sin_alpha - drag_plane * cos_alpha + model.thrust_n / model.mass_kg,
        side * cos_beta - drag * sin_beta,
        -lift * cos_alpha - drag_plane * sin_alpha,
        min(limit, max(-limit, q)),
        min(limit, max(-limit, r)),
        speed,
    )


def _braked(model: PointMass, brake: float) -> PointMass:
    """The aircraft as it is with its brake at a deflection, 0 … 1."""
    if brake == 0.0:
        return model
    return model._replace(
        CL0=model.CL0 + model.CL_brake * brake,
        a0=model.a0 + model.CD_brake * brake,
        sin_alpha_neutral=model.sin_alpha_neutral + model.sin_alpha_brake * brake,
    )


def _moved(
    model: PointMass,
    velocity: Triple,
    attitude: Quaternion,
    elevator: float,
    rudder: float,
    wind: Wind,
) -> tuple[float, float, float, float, float, float]:
    """Acceleration over the ground [m/s², soaring], pitch and yaw rate [rad/s], airspeed [m/s]."""
    (vx, vy, vz), (qw, qx, qy, qz) = velocity, attitude
    # rotation FRD -> upwind NED; dividing by |q|² keeps it orthogonal between two stages
    k = 2.0 / (qw * qw + qx * qx + qy * qy + qz * qz)
    kx, ky, kz = k * qx, k * qy, k * qz
    wx, wy, wz = qw * kx, qw * ky, qw * kz
    xx, xy, xz = qx * kx, qx * ky, qx * kz
    yy, yz, zz = qy * ky, qy * kz, qz * kz
    r11, r12, r13 = 1.0 - yy - zz, xy - wz, xz + wy
    r21, r22, r23 = xy + wz, 1.0 - xx - zz, yz - wx
    r31, r32, r33 = xz - wy, yz + wx, 1.0 - xx - yy
    wind_x, wind_y, wind_z = wind
    north, east, down = wind_x - vx, vy - wind_y, wind_z - vz  # N' = −x, E' = y, D' = −z
    fx, fy, fz, q, r, speed = _in_the_air(
        model,
        r11 * north + r21 * east + r31 * down,
        r12 * north + r22 * east + r32 * down,
        r13 * north + r23 * east + r33 * down,
        elevator,
        rudder,
    )
    return (
        -(r11 * fx + r12 * fy + r13 * fz),
        r21 * fx + r22 * fy + r23 * fz,
        -(r31 * fx + r32 * fy + r33 * fz) - model.gravity_mps2,
        q,
        r,
        speed,
    )


def point_mass_step(
    model: PointMass,
    state: AircraftState,
    surfaces: SurfaceCommand,
    wind_here: Wind,
    wind_ahead: Wind,
    dt_s: float,
    roll_gust_radps: float = 0.0,
) -> AircraftState:
    """The aircraft `dt_s` [s] later, by Heun's method with the two winds of `aircraft.step`.

    The bank's rate, whose lag is the shortest, is stepped implicitly: no airspeed makes it swing.
    The rates of the state are those at the end of the step.
    """
    x, y, z, vx, vy, vz, qw, qx, qy, qz, p, _, _, elevator, _, rudder, brake, _ = state
    elevator_end, aileron_end, rudder_end, brake_end = surfaces
    half = 0.5 * dt_s

    own = _braked(model, brake)
    ax, ay, az, q, r, speed = _moved(
        own, (vx, vy, vz), (qw, qx, qy, qz), elevator, rudder, wind_here
    )
    lags = speed * dt_s / model.roll_lag_m
    limit = RATE_LIMIT_RADPS
    turned = speed * model.roll_aileron_radpm * aileron_end + roll_gust_radps
    p2 = (p + lags * turned) / (1.0 + lags)
    p2 = min(limit, max(-limit, p2))
    dqw = -qx * p - qy * q - qz * r  # twice dq/dt
    dqx = qw * p + qy * r - qz * q
    dqy = qw * q + qz * p - qx * r
    dqz = qw * r + qx * q - qy * p

    vx2, vy2, vz2 = vx + dt_s * ax, vy + dt_s * ay, vz + dt_s * az
    qw2, qx2, qy2, qz2 = qw + half * dqw, qx + half * dqx, qy + half * dqy, qz + half * dqz
    own = _braked(model, brake_end)
    ax2, ay2, az2, q2, r2, _ = _moved(
        own, (vx2, vy2, vz2), (qw2, qx2, qy2, qz2), elevator_end, rudder_end, wind_ahead
    )
    quarter = 0.5 * half
    qw += quarter * (dqw - qx2 * p2 - qy2 * q2 - qz2 * r2)
    qx += quarter * (dqx + qw2 * p2 + qy2 * r2 - qz2 * q2)
    qy += quarter * (dqy + qw2 * q2 + qz2 * p2 - qx2 * r2)
    qz += quarter * (dqz + qw2 * r2 + qx2 * q2 - qy2 * p2)
    unit = 1.0 / sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    return AircraftState(
        x_m=x + half * (vx + vx2),  # (7)
        y_m=y + half * (vy + vy2),
        z_m=z + half * (vz + vz2),  # (8)
        velocity_x_mps=vx + half * (ax + ax2),
        velocity_y_mps=vy + half * (ay + ay2),
        velocity_z_mps=vz + half * (az + az2),
        qw=qw * unit,
        qx=qx * unit,
        qy=qy * unit,
        qz=qz * unit,
        roll_rate_frd_radps=p2,
        pitch_rate_frd_radps=q2,
        yaw_rate_frd_radps=r2,
        elevator=elevator_end,
        aileron=aileron_end,
        rudder=rudder_end,
        brake=brake_end,
        throttle=0.0,
    )


# --- steady glides --------------------------------------------------------------------------


def point_mass_glide(model: PointMass, sin_alpha: float) -> Glide:
    """The wings-level glide in still air at an incidence, by (1), (2), (3) and (5).

    With X = ½ ρ V² S the squares of (1) and (2) add up to a quadratic in X,
    X² (C_L² + C_D²) + 2 X T (C_L sin α − C_D cos α) + T² = (m g)².
    Errors: ValueError where the wing gives no upward lift, or the thrust carries the aircraft.
    """
    elevator = (sin_alpha - model.sin_alpha_neutral) / model.sin_alpha_elevator
    cl = model.CL0 + model.CL_alpha * sin_alpha + model.CL_elevator * elevator
    cd = model.a0 + (model.a1 + model.a2 * cl) * cl
    weight, thrust = model.mass_kg * model.gravity_mps2, model.thrust_n
    if not (cl > 0.0 and thrust < weight):
        raise ValueError(f"no steady glide: C_L is {cl:.3f}, thrust {thrust:g} N of {weight:.2f} N")
    cos_alpha = sqrt(1.0 - sin_alpha * sin_alpha)
    square = cl * cl + cd * cd
    middle = thrust * (cl * sin_alpha - cd * cos_alpha) / square
    pressure_area = sqrt(middle * middle + (weight * weight - thrust * thrust) / square) - middle
    speed = sqrt(2.0 * pressure_area / (model.air_density_kgpm3 * model.wing_area_m2))
    gamma = atan2(pressure_area * cd - thrust * cos_alpha, pressure_area * cl + thrust * sin_alpha)
    alpha = atan2(sin_alpha, cos_alpha)
    return Glide(
        alpha_rad=alpha,
        pitch_rad=alpha - gamma,
        elevator=elevator,
        airspeed_mps=speed,
        horizontal_mps=speed * cos(gamma),
        sink_mps=speed * sin(gamma),
        lift_coefficient=cl,
        drag_coefficient=cd,
    )


def point_mass_glide_at(model: PointMass, horizontal_mps: float) -> Glide:
    """The steady glide at a horizontal airspeed [m/s], from the polar's slowest to diving.

    Errors: ValueError for a speed that no such glide has.
    """
    if not model.slowest_mps <= horizontal_mps < _FASTEST_MPS:
        raise ValueError(
            f"no steady glide at {horizontal_mps} m/s: the polar begins at"
            f" {model.slowest_mps:g} m/s"
        )
    slow = fast = _STEEPEST_SIN_ALPHA
    while point_mass_glide(model, fast).horizontal_mps < horizontal_mps:
        slow = fast
        fast -= _SEARCH_SIN_ALPHA
        # Faster still a glide becomes a dive, and its horizontal speed falls again.
        if point_mass_glide(model, fast).lift_coefficient < _LEAST_LIFT:
            raise ValueError(f"no steady glide at {horizontal_mps} m/s: too fast for this model")
    for _ in range(60):  # bisection: horizontal speed falls as incidence grows
        middle = 0.5 * (slow + fast)
        if point_mass_glide(model, middle).horizontal_mps > horizontal_mps:
            fast = middle
        else:
            slow = middle
    return point_mass_glide(model, 0.5 * (slow + fast))


def polar_misfit(model: PointMass, polar: GlidePolar) -> PolarMisfit:
    """The sink of a model's glides without thrust against a polar's, over the polar's range."""
    gliding = model._replace(thrust_n=0.0)
    speeds = _polar_speeds(polar).tolist()
    left = np.array(
        [point_mass_glide_at(gliding, u).sink_mps - polar_sink(polar, u) for u in speeds]
    )
    return PolarMisfit(float(np.sqrt((left**2).mean())), float(np.abs(left).max()))


# --- from an airframe file ------------------------------------------------------------------


def point_mass(
    airframe: Mapping[str, object], model: Mapping[str, float], polar: GlidePolar
) -> PointMass:
    """The point mass of an airframe file: `[airframe]`, `[model]` and `[polar]`.

    `thrust_n` of `[model]` is the engine's; 0 where it is not given.
    Errors: ValueError naming a key that is missing, unknown, not finite or of a wrong sign.
    """
    thrust = float(model.get(THRUST, 0.0))
    if not (isfinite(thrust) and thrust >= 0.0):
        raise ValueError(f"model.{THRUST} = {thrust}: must be 0 or above")
    body = aircraft_model(airframe, {key: value for key, value in model.items() if key != THRUST})
    if body.propeller_thrust_n > 0.0:
        raise ValueError(
            f"model.propeller_thrust_n = {body.propeller_thrust_n:g}: a throttle moves the rigid"
            f" body only; a point mass has {THRUST}, which is constant"
        )
    if not body.Cn_beta > 0.0:
        raise ValueError(f"model.Cn_beta = {body.Cn_beta}: must be above 0 for a point mass")
    a0, a1, a2 = _drag_of(
        body.mass_kg * body.gravity_mps2, body.air_density_kgpm3, body.wing_area_m2, polar
    )
    pressure = 0.5 * body.air_density_kgpm3 * body.wing_area_m2  # of V²
    return PointMass(
        mass_kg=body.mass_kg,
        wing_area_m2=body.wing_area_m2,
        span_m=body.span_m,
        gravity_mps2=body.gravity_mps2,
        air_density_kgpm3=body.air_density_kgpm3,
        thrust_n=thrust,
        a0=a0,
        a1=a1,
        a2=a2,
        CD_beta=body.CD_beta,
        CL0=body.CL0,
        CL_alpha=body.CL_alpha,
        CL_elevator=body.CL_elevator,
        CY_beta=body.CY_beta,
        CY_rudder=body.CY_rudder,
        sin_alpha_neutral=-body.Cm0 / body.Cm_alpha,
        sin_alpha_elevator=-body.Cm_elevator / body.Cm_alpha,
        sin_beta_rudder=-body.Cn_rudder / body.Cn_beta,
        CL_brake=body.CL_brake,
        CD_brake=body.CD_brake,
        sin_alpha_brake=-body.Cm_brake / body.Cm_alpha,
        roll_aileron_radpm=-2.0 * body.Cl_aileron / (body.span_m * body.Cl_p),
        pitch_lag_m=max(
            0.5 * body.chord_m * body.Cm_q / body.Cm_alpha,
            sqrt(body.iyy_kgm2 / (pressure * body.chord_m * -body.Cm_alpha)),
        ),
        roll_lag_m=2.0 * body.ixx_kgm2 / (pressure * body.span_m * body.span_m * -body.Cl_p),
        heading_lag_m=max(
            -0.5 * body.span_m * body.Cn_r / body.Cn_beta,
            sqrt(body.izz_kgm2 / (pressure * body.span_m * body.Cn_beta)),
        ),
        slowest_mps=polar.speed_min_mps,
    )


def _drag_of(
    weight_n: float, density_kgpm3: float, area_m2: float, polar: GlidePolar
) -> tuple[float, float, float]:
    """a0, a1, a2 of (5) by least squares in sink over the polar's range.  Errors: ValueError."""
    horizontal = _polar_speeds(polar)
    sink = np.array([polar_sink(polar, u) for u in horizontal.tolist()])
    speed = np.hypot(horizontal, sink)
    per_weight = 2.0 * weight_n / (density_kgpm3 * area_m2 * speed**2)
    cl, cd = per_weight * horizontal / speed, per_weight * sink / speed  # (1) and (2)
    per_drag = speed / cl  # sink by C_D at one C_L
    powers = np.stack([np.ones_like(cl), cl, cl**2], axis=1)
    found, *_ = np.linalg.lstsq(powers * per_drag[:, np.newaxis], cd * per_drag, rcond=None)
    a0, a1, a2 = (float(a) for a in found)
    if not (a2 > 0.0 and a1 * a1 < 4.0 * a0 * a2):
        raise ValueError(
            f"polar: its drag, {a0:.4f} {a1:+.4f} C_L {a2:+.4f} C_L², is not above 0 at every C_L;"
            " fit the polar again over a wider range of speeds, or fly the rigid body"
        )
    return a0, a1, a2


def _polar_speeds(polar: GlidePolar) -> FloatArray:
    return np.linspace(polar.speed_min_mps, polar.speed_max_mps, _SPEEDS)

"""The aircraft: a rigid body in wind, with lift, drag and side force from the air it meets.

    m dv/dt = R F(v_air, ω, δ) + m g            v_air = Rᵀ (v − wind(position, time))
    I dω/dt = M(v_air, ω, δ) − ω × I ω          dq/dt = ½ q ⊗ ω            dx/dt = v

v      m/s    velocity over the ground             wind   m/s    of the air at the aircraft
R, q   –      FRD → upwind NED (N' = −x, E' = y, D' = −z of the soaring frame)
ω      rad/s  body rates (p, q, r), FRD            δ      –      deflections, −1 … 1
F, M   N, Nm  air's force and moment, FRD          I      kg m²  diag(Ixx, Iyy, Izz)

With v_air = (u_b, v_b, w_b), V its length, Q = ½ ρ V², α = atan2(w_b, u_b) and
β = asin(v_b / V), the force stands in the wind axes: drag against v_air, lift across it in the
plane of symmetry, side force across both.  Lift and side force do no work.

    C_L = (C_L0 + C_Lb δb + C_Lα (α − s₊ + s₋)) g(α) + C_Lδe δe
    C_D = C_D0 + C_Db δb + C_DL C_L² + C_Dsep sin(s₊ + s₋) + C_Dβ sin² β
    C_Y = C_Yβ sin β + C_Yδr δr
    s₊  = w ln(1 + exp((α − α₊) / w)),    s₋ = w ln(1 + exp((α₋ − α) / w))
    g   = cos² α (3 − 2 cos α) in front of the wing, 0 behind it

s₊ is how far the incidence is beyond the stall: lift stops growing there, within about ±2 w,
and the pressure drag of separated flow begins, C_Dsep being that of the wing held square to
the stream.  g is 1 − O(α⁴) in flight and takes the lift away as the wing turns across the
stream.  Moments:

    M_x = Q S b (C_lβ sin β + (b / 2V)(C_lp p + C_lr r) + C_lδa δa)
    M_y = Q S c (C_m0 + C_mb δb + C_mα sin α + (c / 2V) C_mq q + C_mδe δe)
    M_z = Q S b (C_nβ sin β + (b / 2V)(C_np p + C_nr r) + C_nδr δr + C_nδa δa)

Sines stand for the angles so that a tumbling aircraft still meets bounded moments. A gust that
turns the air with the rate p_g about the body's x axis (`air.gusts`) is what the air meets of p: p
− p_g stands for p in both. A propeller adds to F along x (`sim.propeller`). Not modelled: other
gradients of the wind over the aircraft, downwash lag (its damping is in C_mq), ground effect, Ixz,
slipstream. Textbook: Etkin and Reid, Dynamics of Flight, chapters 4–6; every number's origin stands
in the airframe file.

Time stepping is Heun's method. Its second stage lies at x + v dt, which is known beforehand: the
wind there is an argument, so a step calls nothing back, takes any wind, and numba compiles it. At 5
ms, after 4 s of waggling all surfaces with the servos at their limits, it is 4 mm of 5 m, 3 mm/s
and 0.5 mrad from the exact flight: the error of servos that answer 0.1 ms later. Runge–Kutta of
fourth order costs twice the time and is no better unless surfaces and wind are given between the
ends of the step too; the coefficients are not known to a thousandth.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, exp, log1p, sin, sqrt
from typing import NamedTuple

from tgl_soar.config.airframe import (
    NEGATIVE_KEYS,
    OF_THE_BRAKE,
    OF_THE_PROPELLER,
    POSITIVE_KEYS,
)
from tgl_soar.estimation.polar import PolarFit, fit_polar
from tgl_soar.geometry import in_body_axes, quaternion_from_euler
from tgl_soar.sim.propeller import spun, thrust
from tgl_soar.types import GlidePolar, SurfaceCommand

Wind = tuple[float, float, float]  # (u, v, w) [m/s], soaring frame
Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # (w, x, y, z), FRD to upwind NED

# No airframe of this size survives a faster turn; the limit keeps a tumbling one finite.
RATE_LIMIT_RADPS = 100.0
# Below this the directions of lift and drag are taken as if the air moved this fast.
SLOWEST_MPS = 1e-6
# The fastest glide of a model's polar, unless asked otherwise.
FASTEST_GLIDE_MPS = 12.0


class AircraftModel(NamedTuple):
    """Everything the equations above take, in their order of use."""

    mass_kg: float
    wing_area_m2: float
    span_m: float
    chord_m: float
    ixx_kgm2: float
    iyy_kgm2: float
    izz_kgm2: float
    gravity_mps2: float
    air_density_kgpm3: float
    CL0: float
    CL_alpha: float  # per rad, as all derivatives by an angle
    CL_elevator: float  # per half-throw, as all derivatives by a deflection
    stall_alpha_rad: float
    stall_alpha_negative_rad: float
    stall_width_rad: float
    CD0: float
    CD_lift: float
    CD_separated: float
    CD_beta: float
    CY_beta: float
    CY_rudder: float
    Cl_beta: float
    Cl_p: float  # rates are made dimensionless by span (or chord) / 2V
    Cl_r: float
    Cl_aileron: float
    Cm0: float
    Cm_alpha: float
    Cm_q: float
    Cm_elevator: float
    Cn_beta: float
    Cn_p: float
    Cn_r: float
    Cn_rudder: float
    Cn_aileron: float
    CL_brake: float  # of all of the brake; all three are 0 without one
    CD_brake: float
    Cm_brake: float
    propeller_thrust_n: float  # `sim.propeller`; all three are 0 without one
    propeller_speed_mps: float
    propeller_lag_s: float

    # What the world asks of any aircraft (`sim.flown_aircraft`):

    def step(
        self,
        state: AircraftState,
        surfaces: SurfaceCommand,
        wind_here: Wind,
        wind_ahead: Wind,
        roll_gust_here_radps: float,
        roll_gust_ahead_radps: float,
        dt_s: float,
    ) -> AircraftState:
        """The aircraft `dt_s` [s] later."""
        here, ahead = roll_gust_here_radps, roll_gust_ahead_radps
        return step(self, state, surfaces, wind_here, wind_ahead, dt_s, here, ahead)

    def spun(self, throttle: float, wanted: float, dt_s: float) -> float:
        """The throttle that the propeller turns at, `dt_s` [s] later, when another is commanded."""
        return spun(self, throttle, wanted, dt_s)

    def specific_force_frd(self, state: AircraftState, wind: Wind) -> tuple[float, float, float]:
        """What an accelerometer at the centre of gravity feels [m/s², FRD]."""
        return specific_force_frd(self, state, wind)

    def highest_pitch_glide(self) -> Glide:
        """The steady glide with the highest pitch."""
        return highest_pitch_glide(self)

    def glide_at(self, horizontal_mps: float) -> Glide:
        """The steady glide at a horizontal airspeed [m/s].  Errors: ValueError."""
        return glide_at(self, horizontal_mps)


class AircraftState(NamedTuple):
    """The aircraft at one instant."""

    x_m: float  # soaring frame
    y_m: float
    z_m: float
    velocity_x_mps: float  # over the ground, soaring frame
    velocity_y_mps: float
    velocity_z_mps: float
    qw: float  # FRD to upwind NED
    qx: float
    qy: float
    qz: float
    roll_rate_frd_radps: float
    pitch_rate_frd_radps: float
    yaw_rate_frd_radps: float
    elevator: float  # deflections, -1 … 1
    aileron: float
    rudder: float
    brake: float = 0.0  # 0 … 1
    throttle: float = 0.0  # that the propeller turns at, 0 … 1


class AirData(NamedTuple):
    """The air as the aircraft meets it."""

    airspeed_mps: float
    alpha_rad: float
    beta_rad: float


class Glide(NamedTuple):
    """One steady wings-level glide in still air."""

    alpha_rad: float
    pitch_rad: float
    elevator: float
    airspeed_mps: float
    horizontal_mps: float
    sink_mps: float  # positive down
    lift_coefficient: float
    drag_coefficient: float


_METADATA = ("mass_kg", "wing_area_m2", "span_m", "chord_m", "ixx_kgm2", "iyy_kgm2", "izz_kgm2")
_POSITIVE = (*_METADATA, "air_density_kgpm3", "CL_alpha", *POSITIVE_KEYS)
_MAY_BE_MISSING = (*OF_THE_BRAKE, *OF_THE_PROPELLER)


def aircraft_model(airframe: Mapping[str, object], model: Mapping[str, float]) -> AircraftModel:
    """The model of an airframe file: bench figures of `[airframe]`, the rest of `[model]`.

    Keys of `[model]` that begin with `servo_` belong to `tgl_soar.sim.servos`.
    Errors: ValueError naming a key that is missing, unknown, not finite or of a wrong sign.
    """
    known = [name for name in AircraftModel._fields if name not in _METADATA]
    for key in model:
        if key not in known and not key.startswith("servo_"):
            raise ValueError(f"model.{key}: unknown; known are {', '.join(known)}")
    values = []
    for name in AircraftModel._fields:
        table, where = (airframe, "airframe") if name in _METADATA else (model, "model")
        value = table.get(name, 0.0 if name in _MAY_BE_MISSING else None)
        if value is None:
            raise ValueError(f"{where}.{name}: missing; a number is needed")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{where}.{name} = {value}: a number is needed")
        number = float(value)
        if not abs(number) < 1e6:
            raise ValueError(f"{where}.{name} = {value}: must be finite, and below 1e6 in size")
        if (name in _POSITIVE and number <= 0.0) or (name in NEGATIVE_KEYS and number >= 0.0):
            sign = "positive" if name in _POSITIVE else "negative"
            raise ValueError(f"{where}.{name} = {value}: must be {sign}")
        values.append(number)
    return AircraftModel._make(values)


def braked(model: AircraftModel, brake: float) -> AircraftModel:
    """The aircraft as it is with its brake at a deflection, 0 … 1."""
    if brake == 0.0:
        return model
    return model._replace(
        CL0=model.CL0 + model.CL_brake * brake,
        CD0=model.CD0 + model.CD_brake * brake,
        Cm0=model.Cm0 + model.Cm_brake * brake,
    )


# --- the air's loads ----------------------------------------------------------------------


def lift_drag(model: AircraftModel, alpha_rad: float, elevator: float) -> tuple[float, float]:
    """(C_L, C_D) without sideslip at an angle of attack [rad] and an elevator deflection."""
    width = model.stall_width_rad
    above = width * log1p(exp((alpha_rad - model.stall_alpha_rad) / width))
    below = width * log1p(exp((model.stall_alpha_negative_rad - alpha_rad) / width))
    c = cos(alpha_rad)
    shape = c * c * (3.0 - 2.0 * c) if c > 0.0 else 0.0
    cl = (
        model.CL0 + model.CL_alpha * (alpha_rad - above + below)
    ) * shape + model.CL_elevator * elevator
    cd = model.CD0 + model.CD_lift * cl * cl + model.CD_separated * sin(above + below)
    return cl, cd


def _air_loads(
    model: AircraftModel, air: Triple, rates: Triple, surfaces: Triple, roll_gust: float
) -> tuple[float, float, float, float, float, float]:
    """Specific force [m/s²] and angular acceleration [rad/s²] in FRD, from the air alone.

    air: (u_b, v_b, w_b) [m/s] through it; rates: (p, q, r) [rad/s]; both FRD.
    """
    (ub, vb, wb), (p, q, r), (elevator, aileron, rudder) = air, rates, surfaces
    (
        mass, area, span, chord, ixx, iyy, izz, _, density,
        cl0, cl_alpha, cl_elevator, stall, stall_negative, width,
        cd0, cd_lift, cd_separated, cd_beta, cy_beta, cy_rudder,
        croll_beta, croll_p, croll_r, croll_aileron,
        cm0, cm_alpha, cm_q, cm_elevator,
        cn_beta, cn_p, cn_r, cn_rudder, cn_aileron, _, _, _, _, _, _,
    ) = model  # fmt: skip
    plane2 = ub * ub + wb * wb
    speed = sqrt(plane2 + vb * vb)
    plane = sqrt(plane2)
    inverse_plane = 1.0 / plane if plane > SLOWEST_MPS else 1.0 / SLOWEST_MPS
    inverse_speed = 1.0 / speed if speed > SLOWEST_MPS else 1.0 / SLOWEST_MPS
    sin_alpha = wb * inverse_plane
    cos_alpha = ub * inverse_plane
    sin_beta = vb * inverse_speed
    cos_beta = plane * inverse_speed

    # lift_drag, written out: this is the innermost loop of every simulation
    alpha = atan2(wb, ub)
    above = width * log1p(exp((alpha - stall) / width))
    below = width * log1p(exp((stall_negative - alpha) / width))
    shape = cos_alpha * cos_alpha * (3.0 - 2.0 * cos_alpha) if cos_alpha > 0.0 else 0.0
    cl = (cl0 + cl_alpha * (alpha - above + below)) * shape + cl_elevator * elevator
    cd = cd0 + cd_lift * cl * cl + cd_separated * sin(above + below) + cd_beta * sin_beta * sin_beta
    cy = cy_beta * sin_beta + cy_rudder * rudder

    half_rho_v = 0.5 * density * speed
    pressure_area = half_rho_v * speed * area  # Q S
    per_mass = pressure_area / mass
    lift = per_mass * cl
    drag = per_mass * cd
    side = per_mass * cy
    drag_plane = (drag * cos_beta + side * sin_beta) if speed > 0.0 else 0.0
    fx = lift * sin_alpha - drag_plane * cos_alpha
    fy = side * cos_beta - drag * sin_beta
    fz = -lift * cos_alpha - drag_plane * sin_alpha

    through_air = p - roll_gust
    span_moment = pressure_area * span
    span_damping = 0.5 * half_rho_v * area * span * span  # Q S b · b / 2V
    roll_moment = span_moment * (croll_beta * sin_beta + croll_aileron * aileron) + span_damping * (
        croll_p * through_air + croll_r * r
    )
    pitch_moment = (
        pressure_area * chord * (cm0 + cm_alpha * sin_alpha + cm_elevator * elevator)
        + 0.5 * half_rho_v * area * chord * chord * cm_q * q
    )
    yaw_moment = span_moment * (
        cn_beta * sin_beta + cn_rudder * rudder + cn_aileron * aileron
    ) + span_damping * (cn_p * through_air + cn_r * r)
    return (
        fx,
        fy,
        fz,
        (roll_moment + (iyy - izz) * q * r) / ixx,
        (pitch_moment + (izz - ixx) * r * p) / iyy,
        (yaw_moment + (ixx - iyy) * p * q) / izz,
    )


def _accelerations(
    model: AircraftModel,
    velocity: Triple,
    attitude: Quaternion,
    rates: Triple,
    surfaces: Triple,
    throttle: float,
    wind: Wind,
    roll_gust: float,
) -> tuple[float, float, float, float, float, float]:
    """Acceleration over the ground [m/s², soaring] and of the body rates [rad/s², FRD]."""
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
    forward = r11 * north + r21 * east + r31 * down
    right, below = r12 * north + r22 * east + r32 * down, r13 * north + r23 * east + r33 * down
    fx, fy, fz, p_dot, q_dot, r_dot = _air_loads(
        model, (forward, right, below), rates, surfaces, roll_gust
    )
    if throttle > 0.0:
        fx += thrust(model, throttle, forward) / model.mass_kg
    return (
        -(r11 * fx + r12 * fy + r13 * fz),
        r21 * fx + r22 * fy + r23 * fz,
        -(r31 * fx + r32 * fy + r33 * fz) - model.gravity_mps2,
        p_dot,
        q_dot,
        r_dot,
    )


# --- one step -----------------------------------------------------------------------------


def place_ahead(state: AircraftState, dt_s: float) -> tuple[float, float, float]:
    """Where `step` needs its second wind: the position (x, y, z) [m] at x + v dt."""
    return (
        state.x_m + state.velocity_x_mps * dt_s,
        state.y_m + state.velocity_y_mps * dt_s,
        state.z_m + state.velocity_z_mps * dt_s,
    )


def step(
    model: AircraftModel,
    state: AircraftState,
    surfaces: SurfaceCommand,
    wind_here: Wind,
    wind_ahead: Wind,
    dt_s: float,
    roll_gust_here_radps: float = 0.0,
    roll_gust_ahead_radps: float = 0.0,
) -> AircraftState:
    """The aircraft `dt_s` [s] later, by Heun's method.

    `surfaces` are the deflections at the end of the step (what the servos have reached; the
    state holds those at its start).  `wind_here` is the wind (u, v, w) [m/s] at the state's
    place and time, `wind_ahead` that at `place_ahead`, one step later; the roll gusts [rad/s] are
    those of the same times.
    """
    x, y, z, vx, vy, vz, qw, qx, qy, qz, p, q, r, elevator, aileron, rudder, brake, throttle = state
    elevator_end, aileron_end, rudder_end, brake_end = surfaces
    half = 0.5 * dt_s

    ax, ay, az, p_dot, q_dot, r_dot = _accelerations(
        braked(model, brake), (vx, vy, vz), (qw, qx, qy, qz), (p, q, r),
        (elevator, aileron, rudder), throttle, wind_here, roll_gust_here_radps,
    )  # fmt: skip
    dqw = -qx * p - qy * q - qz * r  # twice dq/dt
    dqx = qw * p + qy * r - qz * q
    dqy = qw * q + qz * p - qx * r
    dqz = qw * r + qx * q - qy * p

    vx2, vy2, vz2 = vx + dt_s * ax, vy + dt_s * ay, vz + dt_s * az
    qw2, qx2, qy2, qz2 = qw + half * dqw, qx + half * dqx, qy + half * dqy, qz + half * dqz
    p2, q2, r2 = p + dt_s * p_dot, q + dt_s * q_dot, r + dt_s * r_dot
    ax2, ay2, az2, p_dot2, q_dot2, r_dot2 = _accelerations(
        braked(model, brake_end), (vx2, vy2, vz2), (qw2, qx2, qy2, qz2), (p2, q2, r2),
        (elevator_end, aileron_end, rudder_end), throttle, wind_ahead, roll_gust_ahead_radps,
    )  # fmt: skip
    quarter = 0.5 * half
    qw += quarter * (dqw - qx2 * p2 - qy2 * q2 - qz2 * r2)
    qx += quarter * (dqx + qw2 * p2 + qy2 * r2 - qz2 * q2)
    qy += quarter * (dqy + qw2 * q2 + qz2 * p2 - qx2 * r2)
    qz += quarter * (dqz + qw2 * r2 + qx2 * q2 - qy2 * p2)
    unit = 1.0 / sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    p += half * (p_dot + p_dot2)
    q += half * (q_dot + q_dot2)
    r += half * (r_dot + r_dot2)
    limit = RATE_LIMIT_RADPS
    return AircraftState(
        x_m=x + half * (vx + vx2),
        y_m=y + half * (vy + vy2),
        z_m=z + half * (vz + vz2),
        velocity_x_mps=vx + half * (ax + ax2),
        velocity_y_mps=vy + half * (ay + ay2),
        velocity_z_mps=vz + half * (az + az2),
        qw=qw * unit,
        qx=qx * unit,
        qy=qy * unit,
        qz=qz * unit,
        roll_rate_frd_radps=min(limit, max(-limit, p)),
        pitch_rate_frd_radps=min(limit, max(-limit, q)),
        yaw_rate_frd_radps=min(limit, max(-limit, r)),
        elevator=elevator_end,
        aileron=aileron_end,
        rudder=rudder_end,
        brake=brake_end,
        throttle=throttle,
    )


# --- what can be measured on board ----------------------------------------------------------


def air_velocity_frd(state: AircraftState, wind: Wind) -> tuple[float, float, float]:
    """Velocity through the air (u_b, v_b, w_b) [m/s, FRD] in a wind (u, v, w) [m/s]."""
    return in_body_axes(
        state.qw,
        state.qx,
        state.qy,
        state.qz,
        wind[0] - state.velocity_x_mps,  # N' = −x
        state.velocity_y_mps - wind[1],
        wind[2] - state.velocity_z_mps,  # D' = −z
    )


def air_data(state: AircraftState, wind: Wind) -> AirData:
    """Airspeed [m/s], angle of attack and sideslip [rad] in a wind (u, v, w) [m/s]."""
    ub, vb, wb = air_velocity_frd(state, wind)
    plane = sqrt(ub * ub + wb * wb)
    return AirData(sqrt(plane * plane + vb * vb), atan2(wb, ub), atan2(vb, plane))


def specific_force_frd(
    model: AircraftModel, state: AircraftState, wind: Wind
) -> tuple[float, float, float]:
    """What an accelerometer at the centre of gravity feels [m/s², FRD]: no gravity in it."""
    air = air_velocity_frd(state, wind)
    rates = state.roll_rate_frd_radps, state.pitch_rate_frd_radps, state.yaw_rate_frd_radps
    surfaces = state.elevator, state.aileron, state.rudder
    fx, fy, fz, _, _, _ = _air_loads(braked(model, state.brake), air, rates, surfaces, 0.0)
    if state.throttle > 0.0:
        fx += thrust(model, state.throttle, air[0]) / model.mass_kg
    return fx, fy, fz


# --- steady glides --------------------------------------------------------------------------


def steady_glide(model: AircraftModel, alpha_rad: float) -> Glide:
    """The wings-level glide in still air at an angle of attack [rad].

    The elevator makes the pitching moment vanish; force balance along and across the path
    gives tan γ = C_D / C_L and ½ ρ V² S √(C_L² + C_D²) = m g; pitch = α − γ.
    Errors: ValueError where the wing gives no upward lift.
    """
    elevator = -(model.Cm0 + model.Cm_alpha * sin(alpha_rad)) / model.Cm_elevator
    cl, cd = lift_drag(model, alpha_rad, elevator)
    if not cl > 0.0:
        raise ValueError(f"no steady glide at alpha {alpha_rad:.3f} rad: C_L is {cl:.3f}")
    total = sqrt(cl * cl + cd * cd)
    weight = model.mass_kg * model.gravity_mps2
    speed = sqrt(2.0 * weight / (model.air_density_kgpm3 * model.wing_area_m2 * total))
    return Glide(
        alpha_rad=alpha_rad,
        pitch_rad=alpha_rad - atan2(cd, cl),
        elevator=elevator,
        airspeed_mps=speed,
        horizontal_mps=speed * cl / total,
        sink_mps=speed * cd / total,
        lift_coefficient=cl,
        drag_coefficient=cd,
    )


def highest_pitch_glide(model: AircraftModel) -> Glide:
    """The steady glide with the highest pitch: no trim holds a higher one, slower or faster."""
    low, high = 0.0, 2.0 * model.stall_alpha_rad
    ratio = 0.5 * (sqrt(5.0) - 1.0)  # golden section: pitch has one maximum around the stall
    while high - low > 1e-6:
        left, right = high - ratio * (high - low), low + ratio * (high - low)
        if steady_glide(model, left).pitch_rad < steady_glide(model, right).pitch_rad:
            low = left
        else:
            high = right
    return steady_glide(model, 0.5 * (low + high))


def glide_at(model: AircraftModel, horizontal_mps: float) -> Glide:
    """The steady glide at a horizontal airspeed [m/s], from the highest pitch down to diving.

    Errors: ValueError for a speed that no such glide has.
    """
    slowest = highest_pitch_glide(model)
    if not slowest.horizontal_mps <= horizontal_mps < 1e3:
        raise ValueError(
            f"no steady glide at {horizontal_mps} m/s: the slowest before the stall has"
            f" {slowest.horizontal_mps:.2f} m/s"
        )
    slow = slowest.alpha_rad
    fast = slow
    while steady_glide(model, fast).horizontal_mps < horizontal_mps:
        slow = fast
        fast -= 0.01
        if lift_drag(model, fast - 0.01, 0.0)[0] < 0.02:
            raise ValueError(f"no steady glide at {horizontal_mps} m/s: too fast for this model")
    for _ in range(60):  # bisection: horizontal speed falls as alpha grows
        middle = 0.5 * (slow + fast)
        if steady_glide(model, middle).horizontal_mps > horizontal_mps:
            fast = middle
        else:
            slow = middle
    return steady_glide(model, 0.5 * (slow + fast))


def glide_polar(model: AircraftModel, speed_max_mps: float = FASTEST_GLIDE_MPS) -> GlidePolar:
    """The third-order polar of the model's own steady glides, as `glide_polar_fit` makes it."""
    return glide_polar_fit(model, speed_max_mps).polar


def glide_polar_fit(model: AircraftModel, speed_max_mps: float = FASTEST_GLIDE_MPS) -> PolarFit:
    """The paper's fit over the model's steady glides at evenly spaced horizontal airspeeds.

    From 1.02 times the speed of the highest trim pitch (slower, a held pitch runs away), to
    0.1 m/s, up to `speed_max_mps`.  The residuals are those of a cubic for this model.
    Errors: ValueError for a model without such glides.
    """
    slowest = round(10.2 * highest_pitch_glide(model).horizontal_mps) / 10.0
    speeds = [slowest + (speed_max_mps - slowest) * i / 40 for i in range(41)]
    sinks = [glide_at(model, speed).sink_mps for speed in speeds]
    return fit_polar(speeds, sinks, to_the_slowest=True)


def gliding_state(
    glide: Glide, wind: Wind, x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.0
) -> AircraftState:
    """A state in that glide, facing straight upwind at a place [m] in a wind (u, v, w) [m/s]."""
    qw, qx, qy, qz = quaternion_from_euler(0.0, glide.pitch_rad, 0.0)
    return AircraftState(
        x_m=x_m, y_m=y_m, z_m=z_m,
        velocity_x_mps=wind[0] - glide.horizontal_mps, velocity_y_mps=wind[1],
        velocity_z_mps=wind[2] - glide.sink_mps,
        qw=qw, qx=qx, qy=qy, qz=qz,
        roll_rate_frd_radps=0.0, pitch_rate_frd_radps=0.0, yaw_rate_frd_radps=0.0,
        elevator=glide.elevator, aileron=0.0, rudder=0.0, brake=0.0, throttle=0.0,
    )  # fmt: skip

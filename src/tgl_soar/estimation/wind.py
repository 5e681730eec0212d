"""The air at the aircraft: airspeed, angle of attack, wind and updraft.

An accelerometer at the centre of gravity measures the air's force, which depends on the velocity
through the air alone: (u, w) along the body's x and z axes, V² = u² + w², alpha = atan2(w, u),
k = ρ S / 2m,

    normal   −f_z = k V (C_L u + C_D w)          mostly V² and alpha, by the lift curve
    axial     f_x = k V (C_L w − C_D u)          mostly alpha − atan(C_D / C_L)
    pitot     u
    trim      alpha = −(C_m0 + C_me δe + C_mq c q / 2V) / C_ma

The wind is what is added to that to give the velocity over the ground: in upwind NED, R the
rotation from FRD, v the velocity over the ground and W the wind, both in the soaring frame,

    (u, ·, w) = Rᵀ (W_x − v_x,  v_y,  W_z − v_z)          v_y through the air

A Kalman filter estimates W = (W_x, W_z), a random walk: dW² = 2 q² dt.  Each measurement corrects
it where there is a new sample, so that every sensor may be missing or late:

    without a pitot the two forces alone give u and w, but near the stall the force's direction
    hardly changes with alpha, and the elevator that holds it there is more certain;
    beyond the stall the force is rough, and weighs as much as the flow is attached;
    without accelerometers, or where theirs come too late, the force is that of steady flight,
    −Rᵀ g, give or take what turbulence of a few per cent does (UNSTEADY_…).

Constant errors cannot be observed; they are considered (Schmidt's filter): the covariance of W's
error with each is carried along, so that no sensor weighs more than its bias allows.

    b_n   of the normal force      the lift curve
    b_a   of the axial force       the drag, and g δ
    b_p   of the pitot
    b_t   of the trim: where the centre of gravity lies
    δ     of the pitch             the attitude's alignment: Ŵ = v + R(θ + δ) (u, w)

What a propeller pulls with, as far as it is known, is taken off the axial force.

The accelerometers' own bias is removed beforehand, by the attitude
(`estimation.accelerometer_bias`).  What is left is the attitude's error, g δ, along x: alpha from
the force's direction is as much too high as the pitch, and their difference, which gives the
updraft, is hardly affected.

Excess updraft: the updraft less the sink of the glide polar at the horizontal airspeed.
"""

from __future__ import annotations

from math import atan2, sqrt
from typing import Final, NamedTuple

from tgl_soar.estimation.accelerometer_bias import ForceAverages, averaged, begun, unbiased
from tgl_soar.estimation.aerodynamics import lift_drag, trim_alpha
from tgl_soar.estimation.body_axes import BodyAxes, body_axes, body_motion, through_air
from tgl_soar.estimation.pitot_watch import PITOT_AGE_MAX_S
from tgl_soar.types import (
    NAN,
    NO_AIR,
    Aerodynamics,
    AirEstimate,
    Inputs,
    VehicleState,
    isfinite,
    polar_sink,
)

# How far the numbers of an airframe file are trusted.
LIFT_ERROR: Final = 0.04  # of the lift at an angle of attack
DRAG_ERROR: Final = 0.10
GLIDE_RATIO: Final = 6.0  # drag is weight over this
PITOT_BIAS_MPS: Final = 0.15
TRIM_ERROR_RAD: Final = 0.02
# White noise of single samples, with what is not simultaneous in it.
FORCE_NOISE_MPS2: Final = 0.25
STALL_NOISE_MPS2: Final = 3.0  # of the force on a wing that is wholly stalled
PITOT_NOISE_MPS: Final = 0.20
TRIM_NOISE_RAD: Final = 0.05  # what the pitch acceleration makes of it, for TRIM_S
TRIM_S: Final = 0.1
# Without accelerometers: how far from steady flight is, and for how long.
UNSTEADY_X_MPS2: Final = 0.25
UNSTEADY_Z_MPS2: Final = 1.3
UNSTEADY_S: Final = 0.1
FORCE_AGE_MAX_S: Final = 0.1
FIRST_GUESS_MPS: Final = 4.0
GATE: Final = 5.0  # standard deviations beyond which a measurement is refused
RESTART_S: Final = 1.0  # after a gap of this length nothing is known any more
# Beyond these the model is not valid.
ALPHA_MAX_RAD: Final = 0.6
SLOWEST: Final = 0.4  # of the polar's slowest
FASTEST: Final = 2.0  # of the polar's fastest
SLOWEST_MPS: Final = 0.5


class WindParams(NamedTuple):
    """Parameters of the estimator."""

    aerodynamics: Aerodynamics
    change: float  # q: process noise of the wind at the aircraft [m/s per root second]
    alignment_rad: float  # standard deviation of δ
    push_mps2: float = 0.0  # of a propeller along x: no force of the air's on the airframe


class WindPosterior(NamedTuple):
    """W, the covariance of what is not known of it, and that with each constant error."""

    wind_mps: float  # W_x: horizontal wind, positive downstream
    updraft_mps: float  # W_z: vertical wind, positive up
    p_xx: float  # variance of W_x, in m²/s²
    p_xz: float  # covariance of W_x and W_z
    p_zz: float  # variance of W_z
    normal_x: float  # covariance of W_x with b_n, in m²/s³
    normal_z: float  # covariance of W_z with b_n
    axial_x: float  # covariance of W_x with b_a
    axial_z: float  # covariance of W_z with b_a
    pitot_x: float  # covariance of W_x with b_p, in m²/s²
    pitot_z: float  # covariance of W_z with b_p
    trim_x: float  # covariance of W_x with b_t, in rad m/s
    trim_z: float  # covariance of W_z with b_t
    pitch_x: float  # covariance of W_x with δ, in rad m/s
    pitch_z: float  # covariance of W_z with δ


# The same while measurements correct them, several times a tick: plain tuples of floats, which
# native code and numba keep in registers, where a named tuple would be an object of fifteen others.
WindMean = tuple[float, float]  # W_x, W_z
WindCovariance = tuple[float, float, float]  # p_xx, p_xz, p_zz
# With b_n, b_a, b_p, b_t and δ: each of W_x and of W_z.
WindErrors = tuple[float, float, float, float, float, float, float, float, float, float]
Numbers = tuple[WindMean, WindCovariance, WindErrors]


class WindState(NamedTuple):
    """What the estimator remembers."""

    time_s: float  # NaN: nothing is known yet
    posterior: WindPosterior
    average: ForceAverages
    imu_sequence: int  # of the last sample looked at
    imu_time_s: float  # of the tick that used the last sample; NaN: none yet
    airspeed_sequence: int  # of the last sample looked at
    airspeed_time_s: float  # of the tick that used the last sample; NaN: none yet
    refused: int  # measurements that no flight explains, so far


def initial_wind() -> WindState:
    """Nothing is known yet."""
    return WindState(
        time_s=NAN,
        posterior=WindPosterior(
            wind_mps=NAN,
            updraft_mps=NAN,
            p_xx=NAN,
            p_xz=NAN,
            p_zz=NAN,
            normal_x=0.0,
            normal_z=0.0,
            axial_x=0.0,
            axial_z=0.0,
            pitot_x=0.0,
            pitot_z=0.0,
            trim_x=0.0,
            trim_z=0.0,
            pitch_x=0.0,
            pitch_z=0.0,
        ),
        average=ForceAverages(forward_mps=0.0, down_mps=0.0, force_x_mps2=0.0, force_z_mps2=0.0),
        imu_sequence=0,
        imu_time_s=NAN,
        airspeed_sequence=0,
        airspeed_time_s=NAN,
        refused=0,
    )


def wind_step(
    params: WindParams,
    state: WindState,
    vehicle: VehicleState,
    inputs: Inputs,
    velocity_sigma_mps: float,
    elevator: float,
    imu_valid: bool,
) -> tuple[WindState, AirEstimate]:
    """Take in what is new and give the air at inputs.time_s.

    velocity_sigma_mps: of the vehicle's velocity, on each axis.  elevator: its deflection,
    -1 … 1; NaN: not known.  imu_valid: new accelerations are of now and may be used; a spike
    stays in the averages for BIAS_S.
    """
    aero, imu, pitot, now = params.aerodynamics, inputs.imu, inputs.airspeed, inputs.time_s
    frame = body_axes(vehicle)
    motion = body_motion(frame, vehicle)
    usable = isfinite(
        aero.mass_kg
        + (frame.x_n + frame.velocity_x_mps + frame.velocity_y_mps + frame.climb_mps)
        + velocity_sigma_mps
    )
    dt = now - state.time_s
    known, average = state.posterior, state.average
    if not 0.0 <= dt < RESTART_S:  # NaN: nothing is known yet
        known, dt = _first_guess(aero, frame), 0.0
        average = begun(motion)
    posterior = _propagated(known, 2.0 * params.change * params.change * dt)
    refused, imu_time, pitot_time = state.refused, state.imu_time_s, state.airspeed_time_s

    gravity = aero.gravity_mps2
    forces = 0
    fx, fz, noise_x, noise_z = 0.0, 0.0, FORCE_NOISE_MPS2, FORCE_NOISE_MPS2
    is_new_force = imu_valid and imu.sequence != state.imu_sequence
    if is_new_force and isfinite(imu.force_x_frd_mps2) and isfinite(imu.force_z_frd_mps2):
        average = averaged(average, frame, motion, imu, gravity, _since(imu_time, now, dt))
        fx, fz = unbiased(average, motion, imu)
        imu_time = now
        forces = 2
    elif dt > 0.0 and not now - imu_time <= FORCE_AGE_MAX_S:
        fx, fz, noise_x, noise_z = _steady_force(frame, gravity, dt)
        forces = 2
    if usable and forces > 0:
        posterior, accepted = _take_forces(
            aero,
            posterior,
            frame,
            params.alignment_rad,
            (fx - params.push_mps2, fz),
            (noise_x, noise_z),
            elevator if isfinite(elevator) else 0.0,
        )
        refused += forces - accepted

    if usable and dt > 0.0 and isfinite(elevator):
        posterior = _take_trim(aero, posterior, frame, vehicle.pitch_rate_radps, elevator, dt)

    new = pitot.sequence != state.airspeed_sequence and now - pitot.time_s <= PITOT_AGE_MAX_S
    if usable and new and isfinite(pitot.airspeed_mps):
        posterior, taken = _take_pitot(posterior, frame, pitot.airspeed_mps)
        if taken:
            pitot_time = now
        else:
            refused += 1

    known, air = _named(posterior), NO_AIR
    if usable:
        measured = now - pitot_time <= PITOT_AGE_MAX_S
        air = _estimate(params, known, frame, velocity_sigma_mps, measured)
    return WindState(
        time_s=now if isfinite(air.airspeed_mps) else NAN,
        posterior=known,
        average=average,
        imu_sequence=imu.sequence,
        imu_time_s=imu_time,
        airspeed_sequence=pitot.sequence,
        airspeed_time_s=pitot_time,
        refused=refused,
    ), _with_trim(aero, air, elevator, vehicle.pitch_rate_radps)


def _since(imu_time_s: float, now_s: float, dt_s: float) -> float:
    """How long the last force was ago: forces may come less often than ticks."""
    since = now_s - imu_time_s  # NaN: there was none
    return since if 0.0 < dt_s <= since < RESTART_S else dt_s


def _first_guess(aero: Aerodynamics, frame: BodyAxes) -> WindPosterior:
    """The wind in which the aircraft would glide a little faster than its slowest."""
    speed = min(1.15 * aero.polar.speed_min_mps, aero.polar.speed_max_mps)
    unknown = FIRST_GUESS_MPS * FIRST_GUESS_MPS
    return WindPosterior(
        wind_mps=frame.velocity_x_mps + speed,
        updraft_mps=frame.climb_mps + polar_sink(aero.polar, speed),
        p_xx=unknown,
        p_xz=0.0,
        p_zz=unknown,
        normal_x=0.0,
        normal_z=0.0,
        axial_x=0.0,
        axial_z=0.0,
        pitot_x=0.0,
        pitot_z=0.0,
        trim_x=0.0,
        trim_z=0.0,
        pitch_x=0.0,
        pitch_z=0.0,
    )


def _propagated(posterior: WindPosterior, variance: float) -> Numbers:
    """The wind is another one by now."""
    wind, updraft, p_xx, p_xz, p_zz, n_x, n_z, a_x, a_z, p_x, p_z, t_x, t_z, d_x, d_z = posterior
    return (
        (wind, updraft),
        (p_xx + variance, p_xz, p_zz + variance),
        (n_x, n_z, a_x, a_z, p_x, p_z, t_x, t_z, d_x, d_z),
    )


def _named(numbers: Numbers) -> WindPosterior:
    (wind, updraft), (p_xx, p_xz, p_zz), considered = numbers
    n_x, n_z, a_x, a_z, p_x, p_z, t_x, t_z, d_x, d_z = considered
    return WindPosterior(
        wind_mps=wind,
        updraft_mps=updraft,
        p_xx=p_xx,
        p_xz=p_xz,
        p_zz=p_zz,
        normal_x=n_x,
        normal_z=n_z,
        axial_x=a_x,
        axial_z=a_z,
        pitot_x=p_x,
        pitot_z=p_z,
        trim_x=t_x,
        trim_z=t_z,
        pitch_x=d_x,
        pitch_z=d_z,
    )


def _steady_force(
    frame: BodyAxes, gravity_mps2: float, dt_s: float
) -> tuple[float, float, float, float]:
    """The specific force of steady flight, x and z, and the noise of taking it for the real one."""
    samples = sqrt(2.0 * UNSTEADY_S / dt_s)  # that are as good as one
    return (
        -gravity_mps2 * frame.x_d,
        -gravity_mps2 * frame.z_d,
        UNSTEADY_X_MPS2 * samples,
        UNSTEADY_Z_MPS2 * samples,
    )


def _take_forces(
    aero: Aerodynamics,
    posterior: Numbers,
    frame: BodyAxes,
    alignment_rad: float,
    force_mps2: tuple[float, float],
    noise_mps2: tuple[float, float],
    elevator: float,
) -> tuple[Numbers, int]:
    """Normal and axial force, and how many of them were accepted."""
    force_x_mps2, force_z_mps2 = force_mps2
    noise_x_mps2, noise_z_mps2 = noise_mps2
    (wind, updraft), _, _ = posterior
    u, w = through_air(frame, wind, updraft)
    speed = sqrt(u * u + w * w)
    if not speed > SLOWEST_MPS:
        return posterior, 0
    cl, cl_alpha, cd, cd_alpha = lift_drag(aero, atan2(w, u), elevator)
    separated = STALL_NOISE_MPS2 * (1.0 - cl_alpha / aero.CL_alpha)
    rough = separated * separated
    k = 0.5 * aero.air_density_kgpm3 * aero.wing_area_m2 / aero.mass_kg
    kv = k * speed
    ku, kw = k * u / speed, k * w / speed

    across = cl * u + cd * w
    turn = k * (cl_alpha * u + cd_alpha * w) / speed
    by_u = ku * across + kv * cl - turn * w  # of the normal force, by u and w
    by_w = kw * across + kv * cd + turn * u
    h_x = by_u * frame.x_n + by_w * frame.z_n
    h_z = by_u * frame.x_d + by_w * frame.z_d
    error = LIFT_ERROR * aero.gravity_mps2
    normal, normal_taken = _corrected(
        posterior,
        h_x,
        h_z,
        -force_z_mps2 - kv * across,
        noise_z_mps2 * noise_z_mps2 + rough,
        normal=error * error,
    )

    along = cl * w - cd * u
    turn = k * (cl_alpha * w - cd_alpha * u) / speed
    by_u = ku * along - kv * cd - turn * w  # of the axial force
    by_w = kw * along + kv * cl + turn * u
    h_x = by_u * frame.x_n + by_w * frame.z_n
    h_z = by_u * frame.x_d + by_w * frame.z_d
    # Linear about the same place: what the normal force has moved since is part of the forecast.
    (wind_now, updraft_now), _, _ = normal
    moved = h_x * (wind_now - wind) + h_z * (updraft_now - updraft)
    error = DRAG_ERROR * aero.gravity_mps2 / GLIDE_RATIO
    tilted = aero.gravity_mps2 * alignment_rad * alignment_rad
    axial, axial_taken = _corrected(
        normal,
        h_x,
        h_z,
        force_x_mps2 - kv * along - moved,
        noise_x_mps2 * noise_x_mps2 + rough,
        axial=error * error + aero.gravity_mps2 * tilted,
        pitch=tilted,
    )
    return axial, int(normal_taken) + int(axial_taken)


def _take_trim(
    aero: Aerodynamics,
    posterior: Numbers,
    frame: BodyAxes,
    pitch_rate_radps: float,
    elevator: float,
    dt_s: float,
) -> Numbers:
    (wind, updraft), _, _ = posterior
    u, w = through_air(frame, wind, updraft)
    speed2 = u * u + w * w
    if not speed2 > SLOWEST_MPS * SLOWEST_MPS:
        return posterior
    alpha = trim_alpha(aero, elevator, pitch_rate_radps, sqrt(speed2))
    by_u, by_w = -w / speed2, u / speed2
    corrected, _ = _corrected(
        posterior,
        by_u * frame.x_n + by_w * frame.z_n,
        by_u * frame.x_d + by_w * frame.z_d,
        alpha - atan2(w, u),
        TRIM_NOISE_RAD * TRIM_NOISE_RAD * 2.0 * TRIM_S / dt_s,
        trim=TRIM_ERROR_RAD * TRIM_ERROR_RAD,
    )
    return corrected


def _take_pitot(posterior: Numbers, frame: BodyAxes, airspeed_mps: float) -> tuple[Numbers, bool]:
    (wind, updraft), _, _ = posterior
    u, _ = through_air(frame, wind, updraft)
    white, bias = PITOT_NOISE_MPS * PITOT_NOISE_MPS, PITOT_BIAS_MPS * PITOT_BIAS_MPS
    return _corrected(posterior, frame.x_n, frame.x_d, airspeed_mps - u, white, pitot=bias)


def _corrected(
    posterior: Numbers,
    h_x: float,
    h_z: float,
    innovation: float,
    noise: float,
    normal: float = 0.0,
    axial: float = 0.0,
    pitot: float = 0.0,
    trim: float = 0.0,
    pitch: float = 0.0,
) -> tuple[Numbers, bool]:
    """One measurement z = h · W + bias + noise; also whether it was accepted.

    noise: variance of the white noise; normal … trim: that of its own bias in its own
    place, 0 in the others; pitch: covariance of its bias with that of the pitch.
    """
    (wind, updraft), (p_xx, p_xz, p_zz), considered = posterior
    n_x, n_z, a_x, a_z, p_x, p_z, t_x, t_z, d_x, d_z = considered
    if axial > 0.0:
        own_x, own_z = a_x, a_z
    elif normal > 0.0:
        own_x, own_z = n_x, n_z
    elif trim > 0.0:
        own_x, own_z = t_x, t_z
    else:
        own_x, own_z = p_x, p_z
    to_x = p_xx * h_x + p_xz * h_z + own_x
    to_z = p_xz * h_x + p_zz * h_z + own_z
    variance = (
        h_x * to_x + h_z * to_z + h_x * own_x + h_z * own_z + noise + normal + axial + pitot + trim
    )
    if not innovation * innovation <= GATE * GATE * variance:
        return posterior, False
    k_x, k_z = to_x / variance, to_z / variance
    r_n = h_x * n_x + h_z * n_z + normal
    r_a = h_x * a_x + h_z * a_z + axial
    r_p = h_x * p_x + h_z * p_z + pitot
    r_t = h_x * t_x + h_z * t_z + trim
    r_d = h_x * d_x + h_z * d_z + pitch
    corrected = (
        (wind + k_x * innovation, updraft + k_z * innovation),
        (p_xx - k_x * to_x, p_xz - k_x * to_z, p_zz - k_z * to_z),
        (
            n_x - k_x * r_n,
            n_z - k_z * r_n,
            a_x - k_x * r_a,
            a_z - k_z * r_a,
            p_x - k_x * r_p,
            p_z - k_z * r_p,
            t_x - k_x * r_t,
            t_z - k_z * r_t,
            d_x - k_x * r_d,
            d_z - k_z * r_d,
        ),
    )
    return corrected, True


def _estimate(
    params: WindParams,
    posterior: WindPosterior,
    frame: BodyAxes,
    velocity_sigma_mps: float,
    measured: bool,
) -> AirEstimate:
    """The estimate, if an aircraft can fly so."""
    polar = params.aerodynamics.polar
    u, w = through_air(frame, posterior.wind_mps, posterior.updraft_mps)
    speed, alpha = sqrt(u * u + w * w), atan2(w, u)
    flies = (
        SLOWEST * polar.speed_min_mps < speed < FASTEST * polar.speed_max_mps
        and abs(alpha) < ALPHA_MAX_RAD
    )
    if not flies:
        return NO_AIR
    down = posterior.updraft_mps - frame.climb_mps
    north, east = posterior.wind_mps - frame.velocity_x_mps, frame.velocity_y_mps
    flat = sqrt(north * north + east * east)
    # The pitch's error turns (u, w) on its way to the wind: by δ flat upward, δ down upwind;
    # the ground velocity's own is the wind's.
    ground = velocity_sigma_mps * velocity_sigma_mps
    delta = params.alignment_rad * params.alignment_rad
    x2 = posterior.p_xx + ground + down * down * delta - 2.0 * down * posterior.pitch_x
    z2 = posterior.p_zz + ground + flat * flat * delta + 2.0 * flat * posterior.pitch_z
    return AirEstimate(
        airspeed_mps=speed,
        alpha_rad=alpha,
        wind_mps=posterior.wind_mps,
        updraft_mps=posterior.updraft_mps,
        excess_mps=posterior.updraft_mps - polar_sink(polar, flat),
        wind_sigma_mps=sqrt(max(0.0, x2)),
        updraft_sigma_mps=sqrt(max(0.0, z2)),
        measured=measured,
        cross_wind_mps=0.0,
        trim_alpha_rad=NAN,
    )


def _with_trim(
    aero: Aerodynamics, air: AirEstimate, elevator: float, pitch_rate_radps: float
) -> AirEstimate:
    """The same with the angle of attack that the elevator holds."""
    if not air.airspeed_mps > 0.0:  # NaN: not known
        return air
    held = trim_alpha(aero, elevator, pitch_rate_radps, air.airspeed_mps)
    return air._replace(trim_alpha_rad=held)

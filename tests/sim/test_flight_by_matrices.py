"""Rigid body and point mass against their pages' equations, computed with vectors and rotation
matrices: forces, moments, lags, and whole steps of Heun's method, at random states of random
aircraft whose every coefficient acts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import asdict
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.aircraft import (
    AircraftModel,
    AircraftState,
    air_data,
    air_velocity_frd,
    aircraft_model,
    lift_drag,
    place_ahead,
    specific_force_frd,
    step,
)
from tgl_soar.sim.point_mass import PointMass, point_mass
from tgl_soar.types import SurfaceCommand

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
TABLE = asdict(AIRFRAME.airframe)
Vector = NDArray[np.float64]
DT_S = 0.01
# Of the soaring frame to upwind NED and back: N' = -x, E' = y, D' = -z.
TURN = np.diag([-1.0, 1.0, -1.0])


def rigid(seed: int) -> AircraftModel:
    """The shipped aircraft with every coefficient another, and with brake and motor."""
    random = np.random.default_rng(seed)
    model = aircraft_model(TABLE, AIRFRAME.model)._replace(
        CL_brake=-0.3,
        CD_brake=0.08,
        Cm_brake=0.04,
        propeller_thrust_n=4.0,
        propeller_speed_mps=18.0,
        propeller_lag_s=0.1,
    )
    return AircraftModel._make(value * random.uniform(0.67, 1.5) for value in model)


def point(seed: int) -> PointMass:
    random = np.random.default_rng(seed)
    values = {**AIRFRAME.model, "thrust_n": 1.3}
    model = point_mass(TABLE, values, AIRFRAME.polar.as_polar())._replace(
        CL_brake=-0.3, CD_brake=0.08, sin_alpha_brake=0.07
    )
    return PointMass._make(value * random.uniform(0.67, 1.5) for value in model)


def random_state(seed: int, *, wild: bool = False) -> AircraftState:
    """wild: any attitude, and the air from any side."""
    random = np.random.default_rng(1000 + seed)
    size = np.pi if wild else 0.3
    qx, qy, qz, qw = Rotation.from_rotvec(random.uniform(-size, size, 3)).as_quat()
    p, q, r = random.uniform(-2.0, 2.0, 3)
    x, y, z = random.uniform(-20.0, 20.0, 3)
    vx, vy, vz = random.uniform(-9.0, 9.0, 3) if wild else random.uniform(-2.0, 2.0, 3)
    elevator, aileron, rudder = random.uniform(-1.0, 1.0, 3)
    return AircraftState(
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        velocity_z_mps=vz,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        roll_rate_frd_radps=p,
        pitch_rate_frd_radps=q,
        yaw_rate_frd_radps=r,
        elevator=elevator,
        aileron=aileron,
        rudder=rudder,
        brake=random.uniform(0.1, 1.0),
        throttle=random.uniform(0.1, 1.0),
    )


def winds(seed: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    random = np.random.default_rng(2000 + seed)
    here = random.uniform((7.0, -2.0, -2.0), (11.0, 2.0, 2.0))
    ahead = here + random.uniform(-1.0, 1.0, 3)
    first: Any = tuple(float(each) for each in here)
    second: Any = tuple(float(each) for each in ahead)
    return first, second


def rotation(q: Vector) -> Vector:
    """FRD to upwind NED of a quaternion (w, x, y, z), whatever its length."""
    matrix: Vector = Rotation.from_quat(np.roll(q, -1)).as_matrix()
    return matrix


def through_the_air(q: Vector, velocity: Vector, wind: Any) -> Vector:
    """FRD, in m/s."""
    air: Vector = rotation(q).T @ TURN @ (velocity - np.asarray(wind))
    return air


def wind_axes(air: Vector) -> tuple[Vector, Vector, Vector, float, float]:
    """Unit vectors along the air's way, across it (upwards and to the right), and sin and cos of
    its incidence in the plane of symmetry."""
    along = air / np.linalg.norm(air)
    sin_a, _, cos_a = np.array([air[2], 0.0, air[0]]) / np.hypot(air[0], air[2])
    up = np.array([sin_a, 0.0, -cos_a])
    return along, up, np.cross(-up, along), sin_a, cos_a


# --- the rigid body -------------------------------------------------------------------------------


def rigid_coefficients(m: AircraftModel, alpha: float, elevator: float) -> tuple[float, float]:
    w = m.stall_width_rad
    above = w * np.logaddexp(0.0, (alpha - m.stall_alpha_rad) / w)
    below = w * np.logaddexp(0.0, (m.stall_alpha_negative_rad - alpha) / w)
    g = np.cos(alpha) ** 2 * (3.0 - 2.0 * np.cos(alpha)) if abs(alpha) < 0.5 * np.pi else 0.0
    cl = (m.CL0 + m.CL_alpha * (alpha - above + below)) * g + m.CL_elevator * elevator
    return cl, m.CD0 + m.CD_lift * cl**2 + m.CD_separated * np.sin(above + below)


def rigid_loads(
    m: AircraftModel, air: Vector, omega: Vector, surfaces: Vector, throttle: float, gust: float
) -> tuple[Vector, Vector]:
    """Specific force and angular acceleration, FRD, by the page's equations."""
    elevator, aileron, rudder, brake = surfaces
    m = m._replace(
        CL0=m.CL0 + brake * m.CL_brake,
        CD0=m.CD0 + brake * m.CD_brake,
        Cm0=m.Cm0 + brake * m.Cm_brake,
    )
    along, up, right, sin_a, _ = wind_axes(air)
    speed = float(np.linalg.norm(air))
    sin_b = air[1] / speed
    cl, cd = rigid_coefficients(m, float(np.arctan2(air[2], air[0])), elevator)
    cd += m.CD_beta * sin_b**2
    cy = m.CY_beta * sin_b + m.CY_rudder * rudder
    qs = 0.5 * m.air_density_kgpm3 * speed**2 * m.wing_area_m2
    force = qs * (cl * up - cd * along + cy * right)
    fraction = min(1.0, max(0.0, 1.0 - air[0] / m.propeller_speed_mps))
    force[0] += throttle * m.propeller_thrust_n * fraction
    b, c = m.span_m, m.chord_m
    p, q, r = (omega - [gust, 0.0, 0.0]) / (2.0 * speed) * [b, c, b]
    moment = qs * np.array(
        [
            b * (m.Cl_beta * sin_b + m.Cl_p * p + m.Cl_r * r + m.Cl_aileron * aileron),
            c * (m.Cm0 + m.Cm_alpha * sin_a + m.Cm_q * q + m.Cm_elevator * elevator),
            b
            * (
                m.Cn_beta * sin_b
                + m.Cn_p * p
                + m.Cn_r * r
                + m.Cn_rudder * rudder
                + m.Cn_aileron * aileron
            ),
        ]
    )
    inertia = np.diag([m.ixx_kgm2, m.iyy_kgm2, m.izz_kgm2])
    turning = np.linalg.inv(inertia) @ (moment - np.cross(omega, inertia @ omega))
    return force / m.mass_kg, turning


def quaternion_rate(q: Vector, omega: Vector) -> Vector:
    """½ q ⊗ (0, ω), by the scalar and the vector part."""
    w, v = q[0], q[1:]
    return 0.5 * np.concatenate([[-v @ omega], w * omega + np.cross(v, omega)])


def rigid_rates(
    m: AircraftModel, state: Vector, surfaces: Vector, throttle: float, wind: Any, gust: float
) -> Vector:
    velocity, q, omega = state[3:6], state[6:10], state[10:13]
    force, turning = rigid_loads(
        m, through_the_air(q, velocity, wind), omega, surfaces, throttle, gust
    )
    over_ground = TURN @ rotation(q) @ force - [0.0, 0.0, m.gravity_mps2]
    return np.concatenate([velocity, over_ground, quaternion_rate(q, omega), turning])


def heun(rates: Callable[[Vector, bool], Vector], state: Vector) -> Vector:
    """rates: of a state, at the beginning or at the end of the step."""
    first = rates(state, False)
    second = rates(state + DT_S * first, True)
    after = state + 0.5 * DT_S * (first + second)
    after[6:10] /= np.linalg.norm(after[6:10])
    return after


@pytest.mark.parametrize("seed", range(12))
def test_a_rigid_bodys_step_is_heuns_of_its_pages_equations(seed: int) -> None:
    model, state, (here, ahead) = rigid(seed), random_state(seed, wild=seed > 7), winds(seed)
    end = SurfaceCommand(0.3, -0.2, 0.1, 0.5)
    gusts = 0.4, -0.3
    after = step(model, state, end, here, ahead, DT_S, *gusts)

    def rates(at: Vector, is_end: bool) -> Vector:
        surfaces = np.array(end if is_end else state[13:17])
        wind, gust = (ahead, gusts[1]) if is_end else (here, gusts[0])
        return rigid_rates(model, at, surfaces, state.throttle, wind, gust)

    expected = heun(rates, np.array(state[:13]))
    assert np.array(after[:13]) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert after[13:] == (*end, state.throttle)
    assert model.step(state, end, here, ahead, *gusts, DT_S) == after


def test_a_step_without_gusts_is_one_of_no_gusts() -> None:
    model, state, (here, ahead) = rigid(1), random_state(1), winds(1)
    end = SurfaceCommand(0.3, -0.2, 0.1, 0.5)
    assert step(model, state, end, here, ahead, DT_S) == step(
        model, state, end, here, ahead, DT_S, 0.0, 0.0
    )


@pytest.mark.parametrize("seed", range(8))
def test_an_accelerometer_on_a_rigid_body_feels_the_airs_force_and_the_thrust(seed: int) -> None:
    model, state, (wind, _) = rigid(seed), random_state(seed, wild=seed > 3), winds(seed)
    air = through_the_air(np.array(state[6:10]), np.array(state[3:6]), wind)
    omega, surfaces = np.array(state[10:13]), np.array(state[13:17])
    expected, _ = rigid_loads(model, air, omega, surfaces, state.throttle, 0.0)
    assert specific_force_frd(model, state, wind) == pytest.approx(tuple(expected))
    assert model.specific_force_frd(state, wind) == pytest.approx(tuple(expected))
    off = state._replace(throttle=0.0)
    expected, _ = rigid_loads(model, air, omega, surfaces, 0.0, 0.0)
    assert specific_force_frd(model, off, wind) == pytest.approx(tuple(expected))


@pytest.mark.parametrize("seed", range(4))
def test_the_air_is_met_as_the_matrices_turn_it(seed: int) -> None:
    state, (wind, _) = random_state(seed, wild=True), winds(seed)
    air = through_the_air(np.array(state[6:10]), np.array(state[3:6]), wind)
    assert air_velocity_frd(state, wind) == pytest.approx(tuple(air))
    data = air_data(state, wind)
    assert data.airspeed_mps == pytest.approx(np.linalg.norm(air))
    assert np.sin(data.beta_rad) == pytest.approx(air[1] / np.linalg.norm(air))
    assert np.tan(data.alpha_rad) == pytest.approx(air[2] / air[0])
    assert np.cos(data.alpha_rad) * air[0] > 0.0


@pytest.mark.parametrize("alpha", [-3.0, -1.7, -0.6, -0.21, -0.1, 0.0, 0.1, 0.21, 0.6, 1.7, 3.0])
def test_lift_and_drag_bend_at_the_stall_and_vanish_behind_the_wing(alpha: float) -> None:
    model = rigid(3)
    for elevator in (0.0, -0.7):
        expected = rigid_coefficients(model, alpha, elevator)
        assert lift_drag(model, alpha, elevator) == pytest.approx(expected)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_no_rate_is_above_a_hundred_radians_a_second(sign: float) -> None:
    state = random_state(2)._replace(
        roll_rate_frd_radps=sign * 150.0,
        pitch_rate_frd_radps=sign * 151.0,
        yaw_rate_frd_radps=sign * 152.0,
    )
    empty = rigid(2)._replace(air_density_kgpm3=0.0, ixx_kgm2=1.0, iyy_kgm2=1.0, izz_kgm2=1.0)
    still = (0.0, 0.0, 0.0)
    after = step(empty, state, SurfaceCommand(0.0, 0.0, 0.0), still, still, DT_S)
    assert after[10:13] == (sign * 100.0,) * 3


def test_the_second_wind_is_asked_for_where_the_velocity_leads_in_a_step() -> None:
    state = random_state(4)
    expected = np.array(state[:3]) + 0.25 * np.array(state[3:6])
    assert place_ahead(state, 0.25) == pytest.approx(tuple(expected))


# --- the point mass -------------------------------------------------------------------------------


def point_in_air(m: PointMass, air: Vector, surfaces: Vector) -> tuple[Vector, float, float, float]:
    """Specific force in FRD, pitch and yaw rate, airspeed, by the page's equations."""
    elevator, _, rudder, brake = surfaces
    along, up, right, sin_a, _ = wind_axes(air)
    speed = float(np.linalg.norm(air))
    sin_b = air[1] / speed
    cl = m.CL0 + brake * m.CL_brake + m.CL_alpha * sin_a + m.CL_elevator * elevator
    cd = m.a0 + brake * m.CD_brake + m.a1 * cl + m.a2 * cl**2 + m.CD_beta * sin_b**2
    cy = m.CY_beta * sin_b + m.CY_rudder * rudder
    pressure_area = 0.5 * m.air_density_kgpm3 * speed**2 * m.wing_area_m2
    force = pressure_area * (cl * up - cd * along + cy * right) + [m.thrust_n, 0.0, 0.0]
    trimmed = m.sin_alpha_neutral + m.sin_alpha_elevator * elevator + m.sin_alpha_brake * brake
    pitch_rate = speed / m.pitch_lag_m * (trimmed - sin_a)
    yaw_rate = speed / m.heading_lag_m * (sin_b - m.sin_beta_rudder * rudder)
    return force / m.mass_kg, pitch_rate, yaw_rate, speed


@pytest.mark.parametrize("seed", range(8))
def test_a_point_masss_step_is_heuns_of_its_pages_equations(seed: int) -> None:
    """The bank's rate is stepped implicitly: p₂ (1 + V dt / ℓ) = p + V dt / ℓ (V k δa + p_g)."""
    model, state, (here, ahead) = point(seed), random_state(seed), winds(seed)
    end, gust = SurfaceCommand(0.3, -0.2, 0.1, 0.5), -0.3
    after = model.step(state, end, here, ahead, 99.0, gust, DT_S)

    begin = np.array(state[13:17])
    start = np.array(state[:10])
    first_air = through_the_air(start[6:10], start[3:6], here)
    speed = float(np.linalg.norm(first_air))
    lags = speed * DT_S / model.roll_lag_m
    asked = speed * model.roll_aileron_radpm * end.aileron + gust
    p2 = (state.roll_rate_frd_radps + lags * asked) / (1.0 + lags)
    last: list[float] = []

    def rates(at: Vector, is_end: bool) -> Vector:
        surfaces = np.array(end) if is_end else begin
        air = through_the_air(at[6:10], at[3:6], ahead if is_end else here)
        force, q, r, _ = point_in_air(model, air, surfaces)
        omega = np.array([p2 if is_end else state.roll_rate_frd_radps, q, r])
        last[:] = list(omega)
        over_ground = TURN @ rotation(at[6:10]) @ force - [0.0, 0.0, model.gravity_mps2]
        return np.concatenate([at[3:6], over_ground, quaternion_rate(at[6:10], omega)])

    expected = heun(rates, start)
    assert np.array(after[:10]) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert after[10:13] == pytest.approx(tuple(last))
    assert after[13:] == (*end, 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_an_accelerometer_on_a_point_mass_feels_the_airs_force_and_the_thrust(seed: int) -> None:
    model, state, (wind, _) = point(seed), random_state(seed, wild=True), winds(seed)
    air = through_the_air(np.array(state[6:10]), np.array(state[3:6]), wind)
    expected, *_ = point_in_air(model, air, np.array(state[13:17]))
    assert model.specific_force_frd(state, wind) == pytest.approx(tuple(expected))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_point_mass_turns_no_faster_than_a_hundred_radians_a_second(sign: float) -> None:
    model = point(1)._replace(pitch_lag_m=1e-3, heading_lag_m=1e-3, roll_lag_m=1e-3)
    state = random_state(1)._replace(elevator=0.0, rudder=0.0, brake=0.0)
    fast = (60.0, 0.0, 0.0)
    end = SurfaceCommand(sign, sign, sign)
    model = model._replace(sin_beta_rudder=-5.0, sin_alpha_elevator=5.0, roll_aileron_radpm=9.0)
    after = model.step(state, end, fast, fast, 0.0, 0.0, DT_S)
    assert after[10:13] == (sign * 100.0,) * 3


def test_no_throttle_moves_a_point_mass() -> None:
    assert point(1).spun(0.5, 1.0, 0.01) == 0.0


# --- its coefficients, glides and polar -----------------------------------------------------------

POLAR = AIRFRAME.polar.as_polar()


def test_a_point_mass_is_made_of_the_files_coefficients() -> None:
    """Each axis's stiffness, damping and surface, by the page's formulas."""
    changed = {**AIRFRAME.model, "CL_brake": -0.3, "CD_brake": 0.08, "Cm_brake": 0.04}
    m = point_mass(TABLE, changed, POLAR)
    f, t = {key: float(value) for key, value in changed.items()}, TABLE
    b, c, rho, s = t["span_m"], t["chord_m"], f["air_density_kgpm3"], t["wing_area_m2"]
    assert m[:5] == (t["mass_kg"], s, b, f["gravity_mps2"], rho)
    assert m.thrust_n == 0.0
    same = ("CD_beta", "CL0", "CL_alpha", "CL_elevator", "CY_beta", "CY_rudder")
    for name in (*same, "CL_brake", "CD_brake"):
        assert getattr(m, name) == f[name]
    assert m.sin_alpha_neutral == pytest.approx(0.0746 / 0.56)
    assert m.sin_alpha_elevator == pytest.approx(0.273 / 0.56)
    assert m.sin_alpha_brake == pytest.approx(0.04 / 0.56)
    assert m.sin_beta_rudder == pytest.approx(-0.0479 / 0.08)
    assert m.roll_aileron_radpm == pytest.approx(2.0 * 0.0994 / (b * 0.45))
    creeps = c * 10.1 / (2.0 * 0.56)
    swings = np.sqrt(2.0 * 0.0115 / (rho * s * c * 0.56))
    assert m.pitch_lag_m == pytest.approx(max(creeps, swings))
    creeps = b * 0.09 / (2.0 * 0.08)
    swings = np.sqrt(2.0 * 0.0233 / (rho * s * b * 0.08))
    assert m.heading_lag_m == pytest.approx(max(creeps, swings))
    assert m.roll_lag_m == pytest.approx(4.0 * 0.0130 / (rho * s * b**2 * 0.45))
    assert m.slowest_mps == POLAR.speed_min_mps


def test_the_other_of_two_lags_acts_where_it_is_longer() -> None:
    """A tail without damping swings in pitch, a fin with much of it creeps."""
    m = point_mass(TABLE, {**AIRFRAME.model, "Cm_q": -0.1, "Cn_r": -9.0}, POLAR)
    area = 1.225 * 0.180
    assert m.pitch_lag_m == pytest.approx(np.sqrt(2.0 * 0.0115 / (area * 0.164 * 0.56)))
    assert m.heading_lag_m == pytest.approx(1.10 * 9.0 / (2.0 * 0.08))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"thrust_n": -0.1}, r"model\.thrust_n = -0\.1: must be 0 or above"),
        ({"thrust_n": float("inf")}, r"model\.thrust_n = inf: must be 0 or above"),
        ({"Cn_beta": 0.0}, r"model\.Cn_beta = 0\.0: must be above 0 for a point mass"),
        (
            {"propeller_thrust_n": 4.0, "propeller_speed_mps": 18.0},
            r"model\.propeller_thrust_n = 4: a throttle moves the rigid body only",
        ),
    ],
)
def test_what_makes_no_point_mass_is_named(changes: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        point_mass(TABLE, {**AIRFRAME.model, **changes}, POLAR)


@pytest.mark.parametrize("thrust_n", [0.0, 1.5])
@pytest.mark.parametrize("horizontal_mps", [7.6, 8.0, 9.5, 12.0])
def test_a_point_masss_glide_balances_weight_air_and_thrust(
    thrust_n: float, horizontal_mps: float
) -> None:
    """By (1) and (2); nothing is left over along the path or across it."""
    m = point_mass(TABLE, {**AIRFRAME.model, "thrust_n": thrust_n}, POLAR)
    glide = m.glide_at(horizontal_mps)
    v, alpha = glide.airspeed_mps, glide.alpha_rad
    gamma = alpha - glide.pitch_rad
    assert glide.horizontal_mps == pytest.approx(horizontal_mps)
    assert glide.horizontal_mps == pytest.approx(v * np.cos(gamma))
    assert glide.sink_mps == pytest.approx(v * np.sin(gamma))
    cl = m.CL0 + m.CL_alpha * np.sin(alpha) + m.CL_elevator * glide.elevator
    cd = m.a0 + m.a1 * cl + m.a2 * cl**2
    assert glide.lift_coefficient == pytest.approx(cl)
    assert glide.drag_coefficient == pytest.approx(cd)
    air = 0.5 * m.air_density_kgpm3 * v**2 * m.wing_area_m2
    weight = m.mass_kg * m.gravity_mps2
    assert weight * np.cos(gamma) == pytest.approx(air * cl + thrust_n * np.sin(alpha))
    assert weight * np.sin(gamma) == pytest.approx(air * cd - thrust_n * np.cos(alpha), abs=1e-9)
    trimmed = m.sin_alpha_neutral + m.sin_alpha_elevator * glide.elevator
    assert np.sin(alpha) == pytest.approx(trimmed)


def test_the_slowest_glide_is_where_the_polar_begins() -> None:
    m = point_mass(TABLE, AIRFRAME.model, POLAR)
    assert m.highest_pitch_glide() == m.glide_at(POLAR.speed_min_mps)
    for speed in (POLAR.speed_min_mps - 0.01, 1000.0, float("nan")):
        with pytest.raises(ValueError, match=r"no steady glide at .*: the polar begins at 7\.6"):
            m.glide_at(speed)
    with pytest.raises(ValueError, match="too fast for this model"):
        m.glide_at(999.0)


def test_an_aircraft_that_its_engine_carries_does_not_glide() -> None:
    m = point_mass(TABLE, {**AIRFRAME.model, "thrust_n": 6.86}, POLAR)
    with pytest.raises(ValueError, match=r"no steady glide: C_L is .*, thrust 6\.86 N of 6\.85 N"):
        m.glide_at(9.0)

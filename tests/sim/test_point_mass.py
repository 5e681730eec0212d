"""The point mass: its own equations, its polar, and the rigid body that it stands beside."""

from __future__ import annotations

from math import cos, hypot, isfinite, pi, radians, sin
from random import Random

import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.polynomial import fit_polynomial
from tgl_soar.config.airframe import ModelKind
from tgl_soar.config.files import (
    ConfigError,
    airframe_from,
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.sim.aircraft import (
    AircraftModel,
    AircraftState,
    Wind,
    aircraft_model,
    gliding_state,
    place_ahead,
)
from tgl_soar.sim.closed_loop import fly
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import fly_compiled, prepare
from tgl_soar.sim.flown_aircraft import FlownAircraft
from tgl_soar.sim.point_mass import PointMass, point_mass, point_mass_glide_at, polar_misfit
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import SurfaceCommand, polar_sink

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
AIRFRAME_TABLE, POLAR = asdict(AIRFRAME.airframe), AIRFRAME.polar.as_polar()
MODEL = point_mass(AIRFRAME_TABLE, AIRFRAME.model, POLAR)
RIGID: AircraftModel = aircraft_model(AIRFRAME_TABLE, AIRFRAME.model)
STILL: Wind = (0.0, 0.0, 0.0)
DT_S = 0.005


def flown(
    model: FlownAircraft,
    state: AircraftState,
    surfaces: SurfaceCommand,
    seconds: float,
    wind: Wind = STILL,
    dt_s: float = DT_S,
) -> AircraftState:
    for _ in range(round(seconds / dt_s)):
        state = model.step(state, surfaces, wind, wind, 0.0, 0.0, dt_s)
    return state


def speed(state: AircraftState) -> float:
    """Of a state in still air."""
    return hypot(state.velocity_x_mps, state.velocity_y_mps, state.velocity_z_mps)


def pitch(state: AircraftState) -> float:
    """Of a state with level wings that faces upwind."""
    return 2.0 * float(np.arctan2(state.qy, state.qw))


# --- its equations --------------------------------------------------------------------------


def test_without_drag_and_lag_energy_is_kept() -> None:
    """Lift and side force stand across the path: in a steady wind they do no work."""
    free = MODEL._replace(a0=0.0, a1=0.0, a2=0.0, CD_beta=0.0, pitch_lag_m=0.3, heading_lag_m=0.3)
    wind: Wind = (4.0, 1.0, 0.5)
    glide = point_mass_glide_at(MODEL, 9.0)
    state = gliding_state(glide, wind)

    def energy(state: AircraftState) -> float:
        through = (
            state.velocity_x_mps - wind[0],
            state.velocity_y_mps - wind[1],
            state.velocity_z_mps - wind[2],
        )
        height = state.z_m - wind[2] * seconds  # in a frame that drifts with the air
        return 0.5 * hypot(*through) ** 2 + MODEL.gravity_mps2 * height

    seconds = 0.0
    before = energy(state)
    for i in range(4000):
        seconds = (i + 1) * 0.0005
        surfaces = SurfaceCommand(
            glide.elevator + 0.1 * sin(6.0 * seconds), 0.2 * cos(3.0 * seconds), 0.3
        )
        state = free.step(state, surfaces, wind, wind, 0.0, 0.0, 0.0005)
    # it has done something: a bank, a sideslip, and speed that is not the glide's
    assert state.qx**2 + state.qz**2 > 0.01
    assert energy(state) == pytest.approx(before, rel=1e-6)  # of Heun's third order at 0.5 ms


def test_speed_and_path_obey_their_equations() -> None:
    """V' and γₚ' of the module's page, thrust and a wind that changes along the path included."""
    model = MODEL._replace(thrust_n=1.3)
    state = gliding_state(point_mass_glide_at(MODEL, 9.0), STILL)._replace(
        velocity_z_mps=0.7, elevator=0.05
    )
    dt = 1e-5
    change = (3.0, 0.0, -2.0)  # of the wind [m/s²]
    ahead: Wind = (change[0] * dt, 0.0, change[2] * dt)
    later = model.step(state, SurfaceCommand(0.05, 0.0, 0.0), STILL, ahead, 0.0, 0.0, dt)

    v = speed(state)
    gamma = float(np.arctan2(state.velocity_z_mps, -state.velocity_x_mps))
    alpha = pitch(state) - gamma
    cl = model.CL0 + model.CL_alpha * sin(alpha) + model.CL_elevator * 0.05
    cd = model.a0 + model.a1 * cl + model.a2 * cl * cl
    q_area = 0.5 * model.air_density_kgpm3 * v * v * model.wing_area_m2
    g, m, thrust = model.gravity_mps2, model.mass_kg, model.thrust_n
    along = -change[0] * cos(gamma) + change[2] * sin(gamma)
    across = change[0] * sin(gamma) + change[2] * cos(gamma)
    v_dot = -g * sin(gamma) + (thrust * cos(alpha) - q_area * cd) / m - along
    gamma_dot = (-g * cos(gamma) + (thrust * sin(alpha) + q_area * cl) / m - across) / v

    vx, vz = -(later.velocity_x_mps - ahead[0]), later.velocity_z_mps - ahead[2]
    assert (hypot(vx, vz) - v) / dt == pytest.approx(v_dot, abs=2e-3)
    assert (float(np.arctan2(vz, vx)) - gamma) / dt == pytest.approx(gamma_dot, abs=2e-3)


def test_pitch_and_heading_follow_their_surfaces_by_first_order_lags() -> None:
    """Where the path is held straight (no lift, no side force), 63 % is there after one lag."""
    straight = MODEL._replace(
        CL0=0.0, CL_alpha=0.0, CL_elevator=0.0, CY_beta=0.0, CY_rudder=0.0,
        a0=0.0, a1=0.0, a2=0.0, CD_beta=0.0, gravity_mps2=0.0,
    )  # fmt: skip
    v = 9.0
    level = AircraftState(
        x_m=0.0, y_m=0.0, z_m=0.0, velocity_x_mps=-v, velocity_y_mps=0.0, velocity_z_mps=0.0,
        qw=1.0, qx=0.0, qy=0.0, qz=0.0, roll_rate_frd_radps=0.0, pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0, elevator=0.0, aileron=0.0, rudder=0.0,
    )  # fmt: skip
    neutral = straight._replace(sin_alpha_neutral=0.0)
    up = SurfaceCommand(0.05, 0.0, 0.0)
    lag_s = neutral.pitch_lag_m / v
    after = flown(neutral, level._replace(elevator=0.05), up, lag_s, dt_s=lag_s / 400.0)
    assert sin(pitch(after)) == pytest.approx(0.05 * MODEL.sin_alpha_elevator * 0.632, rel=0.002)

    right = SurfaceCommand(0.0, 0.0, 0.05)
    lag_s = neutral.heading_lag_m / v
    after = flown(neutral, level._replace(rudder=0.05), right, lag_s, dt_s=lag_s / 400.0)
    heading = 2.0 * float(np.arctan2(after.qz, after.qw))
    assert heading == pytest.approx(-0.05 * MODEL.sin_beta_rudder * 0.632, rel=0.002)

    roll = SurfaceCommand(0.0, 0.1, 0.0)
    lag_s = neutral.roll_lag_m / v
    after = flown(neutral, level, roll, lag_s, dt_s=lag_s / 400.0)
    assert after.roll_rate_frd_radps == pytest.approx(
        0.1 * v * MODEL.roll_aileron_radpm * 0.632, rel=0.002
    )


def test_the_lags_are_those_of_the_rigid_body_s_moments() -> None:
    """At its page's own figures: a short period that creeps, a weathercock that would swing."""
    v, rho, b, c = 8.5, 1.225, 1.10, 0.164
    pressure = 0.5 * rho * v * v * 0.180
    stiffness, damping = pressure * c * 0.56, pressure * c * c / (2.0 * v) * 10.1
    assert damping / stiffness > (0.0115 / stiffness) ** 0.5
    assert MODEL.pitch_lag_m / v == pytest.approx(damping / stiffness)
    stiffness = pressure * b * 0.08
    assert MODEL.heading_lag_m / v == pytest.approx((0.0233 / stiffness) ** 0.5)
    assert MODEL.roll_lag_m / v == pytest.approx(0.0130 / (pressure * b * b / (2 * v) * 0.45))


# --- its polar ------------------------------------------------------------------------------


@pytest.mark.parametrize("horizontal_mps", [7.7, 8.5, 9.2, 10.5, 11.9])
def test_a_steady_glide_gives_back_the_polar(horizontal_mps: float) -> None:
    """Flown for 20 s from its trim; (5) is no cubic: within the misfit that is reported."""
    misfit = polar_misfit(MODEL, POLAR)
    # A cubic over 4.4 m/s against a parabola of C_L: 2 % of the least sink, 1.35 m/s.
    assert misfit.rms_mps < misfit.most_mps < 0.03
    glide = MODEL.glide_at(horizontal_mps)
    assert glide.horizontal_mps == pytest.approx(horizontal_mps)
    assert glide.sink_mps == pytest.approx(
        polar_sink(POLAR, horizontal_mps), abs=1.001 * misfit.most_mps
    )
    start = gliding_state(glide, STILL)
    end = flown(MODEL, start, SurfaceCommand(glide.elevator, 0.0, 0.0), 20.0)
    assert -end.velocity_x_mps == pytest.approx(horizontal_mps, abs=1e-3)
    assert -end.velocity_z_mps == pytest.approx(glide.sink_mps, abs=1e-3)
    assert pitch(end) == pytest.approx(glide.pitch_rad, abs=1e-4)


def test_thrust_carries_its_part() -> None:
    """(6): the path is steeper by T / m g without it, to the second order of small angles."""
    driven = MODEL._replace(thrust_n=0.5)
    weight = MODEL.mass_kg * MODEL.gravity_mps2
    without, with_it = MODEL.glide_at(9.0), driven.glide_at(9.0)
    angles = [glide.sink_mps / glide.airspeed_mps for glide in (without, with_it)]
    assert angles[0] - angles[1] == pytest.approx(0.5 / weight, rel=0.02)
    start = gliding_state(with_it, STILL)
    end = flown(driven, start, SurfaceCommand(with_it.elevator, 0.0, 0.0), 20.0)
    assert -end.velocity_z_mps == pytest.approx(with_it.sink_mps, abs=1e-3)


def test_slow_manoeuvres_are_those_of_the_rigid_body() -> None:
    """An elevator that moves over 2 s, ten times the lag, sets off the phugoid of both.

    The point mass's path may differ by what its polar does (2.7 cm/s) and by what a lag of 0.17 s
    does in a phugoid of 3.9 s: a phase of 0.27 rad of the speed's swing, at most.
    """
    found = []
    for model in (MODEL, RIGID):
        glide = model.glide_at(9.0)
        state = gliding_state(glide, STILL)
        speeds = []
        for i in range(1600):
            ramp = 0.04 * min(1.0, i * DT_S / 2.0)
            surfaces = SurfaceCommand(glide.elevator + ramp, 0.0, 0.0)
            state = model.step(state, surfaces, STILL, STILL, 0.0, 0.0, DT_S)
            speeds.append(speed(state))
        found.append(np.array(speeds))
    mass, rigid = found
    swing = np.ptp(rigid)
    assert swing > 0.3
    assert np.max(np.abs(mass - rigid)) < 0.27 * swing
    assert mass[-1] == pytest.approx(rigid[-1], abs=0.1)


# --- in any air -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_hostile_wind_leaves_numbers(seed: int) -> None:
    """Gusts of 60 m/s from any side at every step, and surfaces at their stops."""
    draw = Random(seed)
    state = gliding_state(MODEL.glide_at(9.0), STILL)
    for _ in range(4000):
        wind: Wind = (draw.uniform(-60, 60), draw.uniform(-60, 60), draw.uniform(-60, 60))
        surfaces = SurfaceCommand(*(draw.choice((-1.0, 1.0)) for _ in range(3)))
        place_ahead(state, DT_S)
        state = MODEL.step(state, surfaces, wind, wind, 0.0, 0.0, DT_S)
        assert all(map(isfinite, state))
    assert state.qw**2 + state.qx**2 + state.qy**2 + state.qz**2 == pytest.approx(1.0)
    assert all(map(isfinite, MODEL.specific_force_frd(state, STILL)))


def test_an_accelerometer_feels_lift_alone_in_a_steady_glide() -> None:
    """It measures what holds the aircraft up: gravity's size, upwards."""
    glide = MODEL.glide_at(9.0)
    fx, fy, fz = MODEL.specific_force_frd(gliding_state(glide, STILL), STILL)
    assert (fx, fy, fz) == pytest.approx(
        (MODEL.gravity_mps2 * sin(glide.pitch_rad), 0.0, -MODEL.gravity_mps2 * cos(glide.pitch_rad))
    )


# --- by name --------------------------------------------------------------------------------


def with_kind(kind: str) -> str:
    return AIRFRAME_PATH.read_text().replace("[model]", f"[model]\nkind = {kind}", 1)


def test_the_airframe_file_names_it() -> None:
    assert AIRFRAME.model_kind == "rigid_body"
    assert isinstance(make_world(AIRFRAME, SITE).model, AircraftModel)
    named = airframe_from(with_kind('"point_mass"'), "mine.toml")
    assert named.model == AIRFRAME.model
    assert make_world(named, SITE).model == MODEL
    assert isinstance(make_world(named.flown_as("rigid_body"), SITE).model, AircraftModel)
    assert isinstance(make_world(AIRFRAME.flown_as("point_mass"), SITE).model, PointMass)


@pytest.mark.parametrize("kind", ['"glider"', "3", '["rigid_body"]'])
def test_another_name_is_refused_with_those_that_there_are(kind: str) -> None:
    with pytest.raises(ConfigError) as refused:
        airframe_from(with_kind(kind), "mine.toml")
    for word in ("mine.toml: model.kind = ", '"rigid_body" or "point_mass"'):
        assert word in str(refused.value)


def test_only_a_point_mass_has_an_engine() -> None:
    driven = {**AIRFRAME.model, "thrust_n": 1.5}
    assert point_mass(AIRFRAME_TABLE, driven, POLAR).thrust_n == 1.5
    with pytest.raises(ValueError, match=r"model\.thrust_n: unknown"):
        aircraft_model(AIRFRAME_TABLE, driven)
    with pytest.raises(ValueError, match=r"model\.thrust_n = -1\.0: must be 0 or above"):
        point_mass(AIRFRAME_TABLE, {**AIRFRAME.model, "thrust_n": -1.0}, POLAR)


def test_figures_that_make_no_point_mass_are_refused() -> None:
    with pytest.raises(ValueError, match=r"model\.Cn_beta = -0\.1: must be above 0"):
        point_mass(AIRFRAME_TABLE, {**AIRFRAME.model, "Cn_beta": -0.1}, POLAR)
    with pytest.raises(ValueError, match="polar: its drag"):
        point_mass(AIRFRAME_TABLE, AIRFRAME.model, POLAR._replace(c0=3.0, c1=-0.2, c2=0.0, c3=0.0))
    with pytest.raises(ValueError, match=r"the polar begins at 7\.6 m/s"):
        MODEL.glide_at(7.0)
    with pytest.raises(ValueError, match="too fast"):
        MODEL.glide_at(60.0)


# --- in the closed loop -----------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["rigid_body", "point_mass"])
def test_a_leg_settles_on_either_model(kind: ModelKind) -> None:
    """In the polynomial wind of the shipped site: within 5 cm of the line, by two seconds."""
    path = shipped("sites/tunnel_polynomial.toml")
    site = load_site(path)
    assert site.air is not None
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, site, path)
    values = values.changed(line_parameters(site.lines["b"]))
    world = make_world(AIRFRAME.flown_as(kind), site, seed=2, turbulence=0.01, folder=path.parent)
    flight = fly(world, values, [], 12.0)
    assert flight.ended == ""
    late = flight["time_s"] > 6.0
    assert np.max(np.abs(flight["e_rho_m"][late])) < 0.05
    assert np.ptp(flight["z_m"]) > 0.1  # it came from elsewhere
    assert np.max(np.abs(flight["roll_rad"])) < radians(30.0) < pi


ROUNDED = ("forecast_chance", "heading_rad")  # by a few of the last bit


@pytest.mark.xdist_group("kernels")
@pytest.mark.skipif(not available(), reason="numba is not installed")
def test_compiled_it_flies_the_same_to_the_bit() -> None:
    """The point mass in a polynomial wind: neither calls a function that rounds otherwise.  But for
    two columns, which nothing that flies follows here: numba's own erf rounds its last bit so, and
    on some processors the heading that is written into a row."""
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
    jet = SlopeJet(8.5, radians(23.0))
    board = ((-0.5, 0.0), (0.0, 0.0), (2.2, 2.2 * 0.4245))
    field, _ = fit_polynomial(jet, (-0.5, 2.2, 0.2, 2.6), 8, floor=board)
    airframe = AIRFRAME.flown_as("point_mass")
    world, other = (
        make_world(airframe, SITE, seed=s, turbulence=0.01, field=field) for s in (3, 4)
    )
    fast = fly_compiled(prepare(other, 5.0), 3, values, [])
    plain = fly(world, values, [], 5.0)
    assert plain.ended == fast.ended == ""
    for name, column in plain.columns.items():
        if name in ROUNDED:
            np.testing.assert_allclose(fast[name], column, rtol=1e-15, err_msg=name)
        else:
            np.testing.assert_array_equal(fast[name], column, err_msg=name)


@pytest.mark.xdist_group("kernels")
@pytest.mark.skipif(not available(), reason="numba is not installed")
def test_compiled_it_leaves_the_polynomial_s_air_as_plain() -> None:
    """Over the upper edge of the box, or into the board: the same crash at the same step."""
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
    field, _ = fit_polynomial(
        build_field(SITE.air) if SITE.air is not None else SlopeJet(8.5, 0.4),
        (-0.5, 2.2, 0.2, 1.35), 6, floor=((0.0, 0.0), (2.2, 0.93)),
    )  # fmt: skip
    airframe = AIRFRAME.flown_as("point_mass")
    values = values.changed({"TGL_Z": 1.6, "TGL_X": 0.6})
    world, other = (
        make_world(airframe, SITE, seed=s, turbulence=0.01, field=field) for s in (3, 4)
    )
    fast = fly_compiled(prepare(other, 5.0), 3, values, [])
    plain = fly(world, values, [], 5.0)
    assert plain.ended.startswith("left the air that the field describes")
    assert fast.ended == plain.ended
    assert fast.ticks == plain.ticks

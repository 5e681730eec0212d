"""The aircraft: conservation laws, its glides, its figures, its integrator, its extremes."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import atan2, cos, hypot, isfinite, nan, pi, sin, sqrt
from types import FunctionType
from typing import Any

import numpy as np
import pytest
from field_step import step_in_field
from msgspec.structs import asdict
from numpy.typing import NDArray

from tgl_soar.config.airframe import MODEL_KEYS
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.polar import fit_polar
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim import sensor_sampling, sensors, servos
from tgl_soar.sim.aircraft import (
    RATE_LIMIT_RADPS,
    AircraftModel,
    AircraftState,
    Wind,
    air_data,
    air_velocity_frd,
    aircraft_model,
    glide_at,
    glide_polar_fit,
    gliding_state,
    highest_pitch_glide,
    lift_drag,
    place_ahead,
    specific_force_frd,
    steady_glide,
    step,
)
from tgl_soar.sim.compiled import compiled
from tgl_soar.sim.point_mass import THRUST
from tgl_soar.types import NO_FIX, SurfaceCommand, polar_sink

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
AIRFRAME_TABLE = asdict(AIRFRAME.airframe)
MODEL = aircraft_model(AIRFRAME_TABLE, AIRFRAME.model)
NO_DRAG = MODEL._replace(CD0=0.0, CD_lift=0.0, CD_separated=0.0, CD_beta=0.0)
NO_AIR = MODEL._replace(air_density_kgpm3=0.0)
STILL = (0.0, 0.0, 0.0)
DT_S = 0.005


def _hold(state: AircraftState) -> SurfaceCommand:
    return SurfaceCommand(state.elevator, state.aileron, state.rudder)


def _energy(model: AircraftModel, s: AircraftState) -> float:
    """Kinetic (over the ground) and potential energy [J]."""
    speed2 = s.velocity_x_mps**2 + s.velocity_y_mps**2 + s.velocity_z_mps**2
    return model.mass_kg * (0.5 * speed2 + model.gravity_mps2 * s.z_m)


# --- conservation ---------------------------------------------------------------------------


def _aerobatics(time_s: float) -> SurfaceCommand:
    return SurfaceCommand(0.3 * sin(2.0 * time_s), 0.4 * sin(3.0 * time_s), 0.5 * cos(time_s))


def _energy_drift(dt_s: float) -> float:
    """Largest change of energy over 5 s of aerobatics without drag, as a part of ½ m V²."""
    state = gliding_state(glide_at(MODEL, 11.0), STILL)
    first = _energy(NO_DRAG, state)
    worst = 0.0
    for k in range(round(5.0 / dt_s)):
        state = step(NO_DRAG, state, _aerobatics((k + 1) * dt_s), STILL, STILL, dt_s)
        worst = max(worst, abs(_energy(NO_DRAG, state) - first))
    return worst / first


def test_energy_is_conserved_without_drag_in_still_air() -> None:
    # Lift and side force do no work, so what changes is the integrator's: where the velocity
    # turns at Ω, Heun's method changes its square by (Ω dt)⁴ / 4 of itself in a step. Turning at
    # 5 rad/s for 5 s, the hardest that happens here: 1e-4, and it goes away as dt³.
    drift = _energy_drift(DT_S)
    assert drift < 1e-4
    assert 6.0 < drift / _energy_drift(DT_S / 2.0) < 10.0


def test_without_air_it_flies_a_parabola_and_keeps_its_spin() -> None:
    start = gliding_state(glide_at(MODEL, 10.0), STILL)._replace(
        roll_rate_frd_radps=3.0, pitch_rate_frd_radps=-2.0, yaw_rate_frd_radps=1.0
    )

    def spin(s: AircraftState) -> tuple[float, float]:
        """Rotational energy [J] and angular momentum [N m s]."""
        moments = (
            MODEL.ixx_kgm2 * s.roll_rate_frd_radps,
            MODEL.iyy_kgm2 * s.pitch_rate_frd_radps,
            MODEL.izz_kgm2 * s.yaw_rate_frd_radps,
        )
        energy = 0.5 * sum(m * w for m, w in zip(moments, s[10:13], strict=True))
        return energy, sqrt(sum(m * m for m in moments))

    state, seconds = start, 2.0
    for _ in range(round(seconds / DT_S)):
        state = step(NO_AIR, state, _hold(state), STILL, STILL, DT_S)
    # Heun's method is exact for a parabola
    assert state.x_m == pytest.approx(start.velocity_x_mps * seconds, abs=1e-9)
    assert state.z_m == pytest.approx(
        start.velocity_z_mps * seconds - 0.5 * MODEL.gravity_mps2 * seconds**2, abs=1e-9
    )
    assert spin(state) == pytest.approx(spin(start), rel=1e-3)
    assert state.roll_rate_frd_radps != pytest.approx(3.0, abs=0.1)  # the axes couple


@pytest.mark.parametrize("wind", [(8.55, 0.0, 1.35), (-3.0, 2.0, -1.0)])
def test_a_uniform_wind_only_carries_the_aircraft_along(wind: Wind) -> None:
    glide = glide_at(MODEL, 9.0)
    still, blown = gliding_state(glide, STILL), gliding_state(glide, wind)
    for k in range(400):
        surfaces = _aerobatics(k * DT_S)
        still = step(MODEL, still, surfaces, STILL, STILL, DT_S)
        blown = step(MODEL, blown, surfaces, wind, wind, DT_S)
    moved = [still[i] + wind[i] * 400 * DT_S for i in range(3)]
    assert list(blown[:3]) == pytest.approx(moved, abs=1e-8)
    assert list(blown[6:13]) == pytest.approx(list(still[6:13]), abs=1e-9)


def test_left_and_right_are_alike() -> None:
    right = left = gliding_state(glide_at(MODEL, 9.0), STILL)
    for k in range(400):
        e, a, r, _ = _aerobatics(k * DT_S)
        right = step(MODEL, right, SurfaceCommand(e, a, r), (8.0, 1.0, 0.5), (8.0, 1.0, 0.5), DT_S)
        left = step(
            MODEL, left, SurfaceCommand(e, -a, -r), (8.0, -1.0, 0.5), (8.0, -1.0, 0.5), DT_S
        )
    mirror = (1, -1, 1, 1, -1, 1, 1, -1, 1, -1, -1, 1, -1, 1, -1, -1, 1, 1)
    assert abs(right.y_m) > 0.1
    assert list(left) == pytest.approx([m * v for m, v in zip(mirror, right, strict=True)])


# --- glides ---------------------------------------------------------------------------------


@pytest.mark.parametrize("speed_mps", [7.8, 8.2, 8.6, 9.1, 10.0, 11.5])
def test_a_steady_glide_stays_one(speed_mps: float) -> None:
    glide = glide_at(MODEL, speed_mps)
    assert glide.horizontal_mps == pytest.approx(speed_mps, abs=1e-9)
    state = gliding_state(glide, STILL)
    for _ in range(200):
        state = step(MODEL, state, _hold(state), STILL, STILL, DT_S)
    assert state.velocity_x_mps == pytest.approx(-speed_mps, abs=1e-9)
    assert state.velocity_z_mps == pytest.approx(-glide.sink_mps, abs=1e-9)
    assert state.z_m == pytest.approx(-glide.sink_mps, abs=1e-9)


@pytest.mark.parametrize("speed_mps", [7.9, 8.5, 9.2, 10.5, 11.8])
def test_gliding_hands_off_gives_the_polar_back(speed_mps: float) -> None:
    # Released 0.5 m/s too fast; the phugoid (ζω = 0.13 rad/s) has died to 0.4 % after 45 s.
    glide = glide_at(MODEL, speed_mps)
    state = gliding_state(glide, (-0.5, 0.0, 0.0))
    heights, places = [], []
    for k in range(round(65.0 / DT_S)):
        state = step(MODEL, state, _hold(state), STILL, STILL, DT_S)
        if k * DT_S >= 45.0:
            heights.append(state.z_m)
            places.append(state.x_m)
    seconds = DT_S * (len(heights) - 1)
    speed = (places[0] - places[-1]) / seconds
    sink = (heights[0] - heights[-1]) / seconds
    assert speed == pytest.approx(speed_mps, abs=0.01)
    assert sink == pytest.approx(glide.sink_mps, abs=0.005)
    # the polar of the airframe file is a cubic: it is off by its own residual
    assert sink == pytest.approx(polar_sink(AIRFRAME.polar.as_polar(), speed), abs=0.035)


def test_the_airframe_file_holds_the_fit_of_its_own_model() -> None:
    fit = glide_polar_fit(MODEL)
    polar = AIRFRAME.polar.as_polar()
    assert (polar.speed_min_mps, polar.speed_max_mps) == (
        fit.polar.speed_min_mps,
        fit.polar.speed_max_mps,
    )
    for speed in np.linspace(polar.speed_min_mps, polar.speed_max_mps, 45):
        # eight digits of each coefficient: c3 is good to 5e-11, times 12³
        assert polar_sink(polar, float(speed)) == pytest.approx(
            polar_sink(fit.polar, float(speed)), abs=1e-6
        )
    # "residual 0.008 m/s, at most 0.032 m/s at the slow end", as the file says
    assert fit.residual_rms_mps == pytest.approx(0.008, abs=0.0005)
    assert fit.residual_max_mps == pytest.approx(0.032, abs=0.0005)
    assert abs(fit.residuals_mps[0]) == fit.residual_max_mps
    assert fit.residuals_mps[0] > 0.0  # the stall begins there: the model sinks more


def test_a_wing_whose_least_sink_is_at_its_slowest_glide_has_a_polar() -> None:
    """So much drag without lift, and so little by lift, that faster is never less."""
    steep = MODEL._replace(CD0=0.16, CD_lift=0.02)
    fit = glide_polar_fit(steep)
    assert fit.min_sink_speed_mps == fit.polar.speed_min_mps
    assert fit.min_sink_mps == polar_sink(fit.polar, fit.min_sink_speed_mps)
    speeds = np.linspace(fit.min_sink_speed_mps, 12.0, 20).tolist()
    sinks = [glide_at(steep, speed).sink_mps for speed in speeds]
    with pytest.raises(ValueError, match="add slower glides"):  # of a table it is unknown
        fit_polar(speeds, sinks)


def test_speeds_without_a_glide_are_refused() -> None:
    for speed in (5.0, 7.3, 200.0, nan, -9.0):
        with pytest.raises(ValueError, match="no steady glide"):
            glide_at(MODEL, speed)
    with pytest.raises(ValueError, match="no steady glide"):
        steady_glide(MODEL, -0.2)


# --- the airframe file's figures -------------------------------------------------------------


def _pressure(model: AircraftModel, speed_mps: float) -> float:
    """Q S [N] at an airspeed [m/s]."""
    return 0.5 * model.air_density_kgpm3 * speed_mps**2 * model.wing_area_m2


def test_sink_best_glide_and_slowest_trim_are_as_set() -> None:
    assert glide_at(MODEL, 8.55).sink_mps == pytest.approx(1.35, abs=0.005)
    ratio = {u / 100: u / 100 / glide_at(MODEL, u / 100).sink_mps for u in range(780, 1200, 2)}
    best = max(ratio, key=lambda u: ratio[u])
    assert best == pytest.approx(9.2, abs=0.05)
    assert 5.0 < ratio[best] < 7.0
    assert highest_pitch_glide(MODEL).airspeed_mps == pytest.approx(7.6, abs=0.02)
    least = min(ratio, key=lambda u: glide_at(MODEL, u).sink_mps)
    assert 7.8 < least < 8.2  # slower than the places where the paper soars


def test_the_highest_pitch_is_one() -> None:
    top = highest_pitch_glide(MODEL)
    for alpha in (0.12, 0.16, 0.19, 0.22, 0.26):
        assert steady_glide(MODEL, alpha).pitch_rad < top.pitch_rad


def test_the_neutral_elevator_trims_near_8_7() -> None:
    alpha = atan2(MODEL.Cm0, sqrt(MODEL.Cm_alpha**2 - MODEL.Cm0**2))  # sin α = −Cm0 / Cm_alpha
    glide = steady_glide(MODEL, alpha)
    assert glide.elevator == pytest.approx(0.0, abs=1e-12)
    assert glide.airspeed_mps == pytest.approx(8.7, abs=0.01)


@pytest.mark.parametrize("speed_mps", [8.5, 12.0])
def test_control_effectiveness_is_the_published_one(speed_mps: float) -> None:
    # 31, 67, 18 rad/s² at 8.5 m/s and full throw, growing with V²
    start = gliding_state(steady_glide(MODEL, 0.1), STILL)
    scale = speed_mps / hypot(start.velocity_x_mps, start.velocity_z_mps)
    start = start._replace(
        velocity_x_mps=start.velocity_x_mps * scale, velocity_z_mps=start.velocity_z_mps * scale
    )
    growth = (speed_mps / 8.5) ** 2
    dt = 1e-6
    for axis, expected in ((0, 31.0), (1, 67.0), (2, 18.0)):
        rates = []
        for throw in (0.5, -0.5):
            deflected = start._replace(elevator=0.0, aileron=0.0, rudder=0.0)
            deflected = deflected._replace(**{("elevator", "aileron", "rudder")[axis]: throw})
            end = step(MODEL, deflected, _hold(deflected), STILL, STILL, dt)
            rates.append((end.pitch_rate_frd_radps, end.roll_rate_frd_radps, end[12])[axis])
        assert (rates[0] - rates[1]) / dt == pytest.approx(expected * growth, rel=0.005)


def _modes(speed_mps: float) -> list[complex]:
    """Natural modes [rad/s] of a trimmed glide, from the eigenvalues of one step."""
    start = gliding_state(glide_at(MODEL, speed_mps), STILL)
    dt = 1e-3
    columns = []
    for i in range(3, 13):  # places do not matter in still air

        def moved(by: float, i: int = i) -> NDArray[np.float64]:
            values = list(start)
            values[i] += by
            state = AircraftState._make(values)
            return np.array(step(MODEL, state, _hold(state), STILL, STILL, dt)[3:13])

        columns.append((moved(1e-6) - moved(-1e-6)) / 2e-6)
    growth = np.linalg.eigvals(np.array(columns).T)
    return [complex(np.log(g) / dt) for g in growth if abs(g) > 0.5]


@pytest.mark.parametrize("speed_mps", [8.0, 8.5, 9.0])
def test_the_short_period_is_as_set(speed_mps: float) -> None:
    # the fastest oscillation; the roll mode is faster, but does not oscillate
    short = max((m for m in _modes(speed_mps) if m.imag > 0.1), key=abs)
    assert 9.0 < abs(short) < 15.0
    assert 0.7 < -short.real / abs(short) < 0.8


def test_every_mode_but_the_spiral_dies_away() -> None:
    growing = [m for m in _modes(8.5) if m.real > 0.02]
    assert len(growing) == 1  # a light aircraft's spiral: doubles in seconds, wings held level
    assert abs(growing[0]) < 0.3


def test_derived_coefficients_follow_from_their_formulas() -> None:
    m = MODEL
    assert m.CL_elevator == pytest.approx(-m.Cm_elevator * m.chord_m / 0.50, abs=0.001)
    assert m.CY_rudder == pytest.approx(-m.Cn_rudder * m.span_m / 0.50, abs=0.001)
    load = _pressure(m, 8.5)
    assert load * m.chord_m / m.iyy_kgm2 == pytest.approx(113.6, abs=0.1)
    assert load * m.span_m / m.ixx_kgm2 == pytest.approx(674.0, abs=1.0)
    assert load * m.span_m / m.izz_kgm2 == pytest.approx(376.0, abs=1.0)
    aspect = m.span_m**2 / m.wing_area_m2
    assert 1.0 / (pi * aspect * 0.8) == pytest.approx(0.059, abs=0.001)  # induced part of CD_lift
    assert -m.Cm_alpha / m.CL_alpha == pytest.approx(0.12, abs=0.005)  # static margin


def test_the_stall_is_mild() -> None:
    angles = [0.005 * i for i in range(90)]  # to 0.45 rad
    lift = [lift_drag(MODEL, a, 0.0)[0] for a in angles]
    drag = [lift_drag(MODEL, a, 0.0)[1] for a in angles]
    top = max(lift)
    assert 0.2 < angles[lift.index(top)] < 0.35
    assert min(c for a, c in zip(angles, lift, strict=True) if a > 0.25) > 0.93 * top  # no break
    slopes = [(b - a) / 0.005 for a, b in pairwise(lift)]
    for a, slope in zip(angles, slopes, strict=False):
        if a < 0.14:
            assert slope == pytest.approx(MODEL.CL_alpha, rel=0.06)  # attached
    changes = [abs(b - a) for a, b in pairwise(slopes)]
    assert max(changes) < 0.1 * MODEL.CL_alpha  # smooth
    # separated flow: all of the force square to the wing, as from a plate, within a third
    cl, cd = lift_drag(MODEL, 0.45, 0.0)
    assert cd / cl == pytest.approx(0.48, rel=0.33)
    assert all(b > a for a, b in pairwise(drag[30:]))


# --- signs ----------------------------------------------------------------------------------


def test_signs_of_controls_and_of_stability() -> None:
    trim = gliding_state(glide_at(MODEL, 8.6), STILL)

    def after(state: AircraftState, wind: Wind, surfaces: SurfaceCommand) -> AircraftState:
        for _ in range(10):
            state = step(MODEL, state, surfaces, wind, wind, DT_S)
        return state

    e = trim.elevator
    assert after(trim, STILL, SurfaceCommand(e + 0.2, 0.0, 0.0)).pitch_rate_frd_radps > 0.1
    assert after(trim, STILL, SurfaceCommand(e, 0.2, 0.0)).roll_rate_frd_radps > 0.1
    assert after(trim, STILL, SurfaceCommand(e, 0.0, 0.2)).yaw_rate_frd_radps > 0.05
    hands_off = SurfaceCommand(e, 0.0, 0.0)
    lifted = after(trim, (0.0, 0.0, 0.5), hands_off)
    assert lifted.velocity_z_mps > trim.velocity_z_mps  # an updraft lifts at once
    assert lifted.pitch_rate_frd_radps < -0.01  # and the tail brings the nose down to it
    from_right = after(trim, (0.0, -1.0, 0.0), hands_off)
    assert from_right.yaw_rate_frd_radps > 0.01  # the fin turns the nose into the wind
    assert from_right.roll_rate_frd_radps < -0.01  # dihedral rolls away from it
    assert from_right.velocity_y_mps < 0.0  # and it is carried along
    braked = after(trim, (1.0, 0.0, 0.0), hands_off)
    assert braked.velocity_x_mps > trim.velocity_x_mps  # a head wind carries it downstream


def test_turning_right_goes_right() -> None:
    state = gliding_state(glide_at(MODEL, 9.0), STILL)
    for k in range(200):
        aileron = 0.3 if k < 40 else 0.0
        state = step(MODEL, state, SurfaceCommand(0.05, aileron, 0.0), STILL, STILL, DT_S)
    roll, _, heading = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
    assert roll > 0.2
    assert heading > 0.1
    assert state.y_m > 0.1
    assert state.velocity_y_mps > 0.5


# --- what is measured on board ---------------------------------------------------------------


def test_air_data_of_a_glide() -> None:
    glide = glide_at(MODEL, 8.55)
    wind = (8.55, 0.3, 1.2)
    data = air_data(gliding_state(glide, wind), wind)
    assert data.airspeed_mps == pytest.approx(glide.airspeed_mps)
    assert data.alpha_rad == pytest.approx(glide.alpha_rad)
    assert data.beta_rad == pytest.approx(0.0, abs=1e-12)
    # 1 m/s more from the right is sideslip to the right
    slipping = air_data(gliding_state(glide, wind), (8.55, -0.7, 1.2))
    assert slipping.beta_rad == pytest.approx(atan2(1.0, glide.airspeed_mps))


def test_an_accelerometer_feels_one_g_in_a_glide() -> None:
    glide = glide_at(MODEL, 8.55)
    force = specific_force_frd(MODEL, gliding_state(glide, STILL), STILL)
    assert force == pytest.approx(
        (
            MODEL.gravity_mps2 * sin(glide.pitch_rad),
            0.0,
            -MODEL.gravity_mps2 * cos(glide.pitch_rad),
        )
    )


def test_specific_force_is_acceleration_less_gravity() -> None:
    q = quaternion_from_euler(0.4, -0.3, 0.7)
    state = gliding_state(glide_at(MODEL, 9.0), STILL)._replace(
        qw=q[0], qx=q[1], qy=q[2], qz=q[3], roll_rate_frd_radps=1.0, aileron=0.3, rudder=-0.2
    )
    wind = (0.5, -0.3, 0.4)
    dt = 1e-6
    end = step(MODEL, state, _hold(state), wind, wind, dt)
    acceleration = [(end[i] - state[i]) / dt for i in (3, 4, 5)]
    acceleration[2] += MODEL.gravity_mps2
    # seen from the body: the same rotation that turns the velocity over the ground
    measured = air_velocity_frd(
        state._replace(
            velocity_x_mps=acceleration[0],
            velocity_y_mps=acceleration[1],
            velocity_z_mps=acceleration[2],
        ),
        STILL,
    )
    assert specific_force_frd(MODEL, state, wind) == pytest.approx(measured, abs=1e-4)


# --- the integrator --------------------------------------------------------------------------


def _smooth_air(x_m: float, y_m: float, z_m: float, time_s: float) -> Wind:
    return (
        8.6 + 0.3 * sin(1.3 * x_m) + 0.4 * z_m + 0.1 * sin(6.0 * time_s),
        0.2 * sin(2.0 * y_m + time_s),
        1.35 - 0.3 * z_m - 0.2 * x_m + 0.1 * cos(5.0 * time_s),
    )


def _flown(dt_s: float, seconds: float = 2.0) -> NDArray[np.float64]:
    glide = glide_at(MODEL, 8.5)
    state = gliding_state(glide, _smooth_air(0.0, 0.0, 0.0, 0.0))
    for k in range(round(seconds / dt_s)):
        t = (k + 1) * dt_s
        surfaces = SurfaceCommand(
            glide.elevator + 0.15 * sin(7.0 * t), 0.3 * sin(5.0 * t), 0.3 * sin(4.0 * t)
        )
        state = step_in_field(MODEL, state, surfaces, _smooth_air, k * dt_s, dt_s)
    return np.array(state[:13])


def test_the_integrator_is_of_second_order() -> None:
    fine = _flown(0.00025)
    errors = [float(np.max(np.abs(_flown(dt) - fine))) for dt in (0.01, 0.005, 0.0025)]
    for coarse, half in pairwise(errors):
        assert 1.8 < np.log2(coarse / half) < 2.2
    # At 5 ms, after 2 s of waggling all surfaces through changing air: 1 mm and 1 mrad/s, of a
    # metre and a radian a second. Servos that answered 0.1 ms later would do as much.
    assert errors[1] < 2e-3


def test_the_second_wind_is_asked_where_the_second_stage_lies() -> None:
    asked: list[tuple[float, float, float, float]] = []

    def wind_at(x: float, y: float, z: float, t: float) -> Wind:
        asked.append((x, y, z, t))
        return 8.0, 0.0, 1.0

    state = gliding_state(glide_at(MODEL, 9.0), (8.0, 0.5, 1.0), 1.0, 2.0, 3.0)
    step_in_field(MODEL, state, _hold(state), wind_at, 7.0, DT_S)
    assert asked == [(1.0, 2.0, 3.0, 7.0), (*place_ahead(state, DT_S), 7.0 + DT_S)]
    assert place_ahead(state, DT_S) == pytest.approx(
        (1.0 - 1.0 * DT_S, 2.0 + 0.5 * DT_S, 3.0 + state.velocity_z_mps * DT_S)
    )


def test_surfaces_at_both_ends_of_the_step_count() -> None:
    # half of the moment at the start, half at the end: a pulse that ends in the step counts half
    state = gliding_state(glide_at(MODEL, 9.0), STILL)
    dt = 1e-5
    hold = step(MODEL, state, _hold(state), STILL, STILL, dt).pitch_rate_frd_radps
    ends = state._replace(elevator=state.elevator + 0.4)
    begins = SurfaceCommand(state.elevator + 0.4, 0.0, 0.0)
    first = step(MODEL, ends, _hold(state), STILL, STILL, dt).pitch_rate_frd_radps - hold
    second = step(MODEL, state, begins, STILL, STILL, dt).pitch_rate_frd_radps - hold
    assert first > 0.0
    assert first == pytest.approx(second, rel=1e-3)


# --- extremes -------------------------------------------------------------------------------


def moving(q: Sequence[float], **changes: float) -> AircraftState:
    """In an attitude; what is not given is zero."""
    attitude = dict(zip(("qw", "qx", "qy", "qz"), q, strict=True))
    still = dict.fromkeys(AircraftState._fields, 0.0)
    return AircraftState(**(still | attitude | changes))


def test_it_stays_finite_whatever_happens_to_it() -> None:
    draw = random.Random(1)
    for case in range(150):
        q = [draw.gauss(0.0, 1.0) for _ in range(4)]
        unit = sqrt(sum(v * v for v in q))
        fast = 100.0 if case % 3 else 10.0
        state = AircraftState._make(
            (
                *(draw.uniform(-5.0, 5.0) for _ in range(3)),
                *(draw.uniform(-fast, fast) for _ in range(3)),
                *(v / unit for v in q),
                *(draw.uniform(-30.0, 30.0) for _ in range(3)),
                *(draw.uniform(-1.0, 1.0) for _ in range(3)),
                *(0.0, 0.0),
            )
        )
        surfaces = SurfaceCommand(*(draw.choice((-1.0, 0.0, 1.0)) for _ in range(3)))
        for _ in range(4):
            wind = (draw.uniform(-20.0, 20.0), 0.0, 0.0)
            for _ in range(50):
                state = step(MODEL, state, surfaces, wind, wind, DT_S)
        assert all(isfinite(v) for v in state)
        assert sum(v * v for v in state[6:10]) == pytest.approx(1.0, abs=1e-12)
        assert all(abs(v) <= RATE_LIMIT_RADPS for v in state[10:13])


@pytest.mark.parametrize("pitch_rad", [-pi / 2.0, -0.5, 0.0, 1.0, pi / 2.0, pi])
@pytest.mark.parametrize("roll_rad", [0.0, pi / 2.0, pi])
def test_it_starts_from_rest_in_any_attitude(pitch_rad: float, roll_rad: float) -> None:
    q = quaternion_from_euler(roll_rad, pitch_rad, 0.0)
    state = moving(q)
    assert specific_force_frd(MODEL, state, STILL) == (0.0, 0.0, 0.0)
    for _ in range(2000):  # 10 s: it falls, turns its nose down and flies
        state = step(MODEL, state, _hold(state), STILL, STILL, DT_S)
    assert all(isfinite(v) for v in state)
    assert state.z_m < -5.0
    terminal = sqrt(2.0 * MODEL.mass_kg * MODEL.gravity_mps2
                    / (MODEL.air_density_kgpm3 * MODEL.wing_area_m2 * MODEL.CD0))  # fmt: skip
    assert air_data(state, STILL).airspeed_mps < terminal * 1.05


def test_drag_is_never_negative() -> None:
    for i in range(-314, 315):
        for elevator in (-1.0, 0.0, 1.0):
            assert lift_drag(MODEL, 0.01 * i, elevator)[1] > 0.0
    # and the force takes energy from the aircraft in any attitude
    draw = random.Random(2)
    for _ in range(2000):
        angles = [draw.uniform(-pi, pi) for _ in range(3)]
        q = quaternion_from_euler(angles[0], angles[1], angles[2])
        state = moving(q, velocity_x_mps=-9.0, velocity_z_mps=-1.0)
        air = air_velocity_frd(state, STILL)
        force = specific_force_frd(MODEL, state, STILL)
        assert sum(a * f for a, f in zip(air, force, strict=True)) < 0.0


def test_it_glides_on_its_side_as_the_lift_law_says() -> None:
    # lift_drag gives the forces in step: no second law hides in the innermost loop
    for alpha in (-0.5, -0.1, 0.1, 0.22, 0.6, 1.4, 2.5):
        q = quaternion_from_euler(0.0, alpha, 0.0)
        state = moving(q, velocity_x_mps=-9.0, elevator=0.2)
        cl, cd = lift_drag(MODEL, alpha, 0.2)
        fx, _, fz = specific_force_frd(MODEL, state, STILL)
        per_mass = _pressure(MODEL, 9.0) / MODEL.mass_kg
        assert fx == pytest.approx(per_mass * (cl * sin(alpha) - cd * cos(alpha)), abs=1e-9)
        assert fz == pytest.approx(per_mass * (-cl * cos(alpha) - cd * sin(alpha)), abs=1e-9)


# --- the airframe file -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("CD0", -0.1),
        ("CL_alpha", 0.0),
        ("Cm_alpha", 0.5),
        ("Cl_p", 0.0),
        ("stall_width_rad", 0.0),
        ("Cn_beta", nan),
        ("Cn_beta", 1e9),
    ],
)
def test_bad_coefficients_are_named(key: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"model\.{key} = "):
        aircraft_model(AIRFRAME_TABLE, {**AIRFRAME.model, key: value})


def test_missing_and_unknown_keys_are_named() -> None:
    with pytest.raises(ValueError, match=r"model\.Cm_q: missing"):
        aircraft_model(AIRFRAME_TABLE, {k: v for k, v in AIRFRAME.model.items() if k != "Cm_q"})
    with pytest.raises(ValueError, match=r"model\.Cm_gamma: unknown"):
        aircraft_model(AIRFRAME_TABLE, {**AIRFRAME.model, "Cm_gamma": 1.0})
    with pytest.raises(ValueError, match=r"airframe\.mass_kg = -1"):
        aircraft_model({**AIRFRAME_TABLE, "mass_kg": -1}, AIRFRAME.model)
    with pytest.raises(ValueError, match=r"airframe\.mass_kg = True"):
        aircraft_model({**AIRFRAME_TABLE, "mass_kg": True}, AIRFRAME.model)


def test_a_file_may_have_what_the_models_take_and_nothing_else() -> None:
    body = [name for name in AircraftModel._fields if name not in AIRFRAME_TABLE]
    servo = {f"servo_{name}" for name in servos.ServoParams._fields}
    assert set(MODEL_KEYS) == {*body, *servo, THRUST}


# --- numba takes it as it stands --------------------------------------------------------------


def _compiled(function: FunctionType, done: dict[FunctionType, Any]) -> Any:
    """The function and every function of ours that it calls, compiled by numba."""
    import numba

    if function not in done:
        names = dict(function.__globals__)
        for name in function.__code__.co_names:
            callee = names.get(name)
            if isinstance(callee, FunctionType) and callee.__module__.startswith("tgl_soar"):
                names[name] = _compiled(callee, done)
        done[function] = numba.njit(
            FunctionType(function.__code__, names, function.__name__, function.__defaults__)
        )
    return done[function]


def _compile(function: Callable[..., Any]) -> Any:
    assert isinstance(function, FunctionType)
    return _compiled(function, {})


@pytest.mark.xdist_group("kernels")
def test_compiled_it_flies_the_same_flight() -> None:
    pytest.importorskip("numba")
    compiled(servos.servo_step)  # numba gets `_replace` with it
    fast_step, fast_air = _compile(step_in_field), _compile(_smooth_air)
    fast_servo = _compile(servos.servo_step)
    servo = servos.servo_params(AIRFRAME.model)._replace(delay_s=0.013)
    glide = glide_at(MODEL, 8.5)
    plain = fast = gliding_state(glide, _smooth_air(0.0, 0.0, 0.0, 0.0))
    moved = fast_moved = servos.servo_start(servo, DT_S, glide.elevator)
    for k in range(400):
        command = glide.elevator + 0.2 * sin(0.03 * k)
        moved = servos.servo_step(servo, moved, command, DT_S)
        fast_moved = fast_servo(servo, fast_moved, command, DT_S)
        plain = step_in_field(
            MODEL, plain, SurfaceCommand(moved.deflection, 0.01, 0.02), _smooth_air, k * DT_S, DT_S
        )
        fast = fast_step(
            MODEL, fast, SurfaceCommand(fast_moved[0], 0.01, 0.02), fast_air, k * DT_S, DT_S
        )
    assert list(fast) == pytest.approx(list(plain), abs=1e-9)  # its exp may differ in the last bit
    assert all(type(v) is float for v in plain)


@pytest.mark.xdist_group("kernels")
def test_compiled_sensors_measure_the_same() -> None:
    pytest.importorskip("numba")
    from tgl_soar.geometry import SoaringFrame

    frame = SoaringFrame(1.0, 2.0, 3.0, 0.5)
    wind = (8.5, 0.2, 1.3)
    state = gliding_state(glide_at(MODEL, 9.0), wind)
    error = (0.01, -0.02, 0.03)
    for measure, arguments in (
        (sensors.measure_position, (frame, state, 4, 0.2, error, error)),
        (sensors.measure_attitude, (frame, state, 4, 0.2, error, error)),
        (sensors.measure_imu, (MODEL, state, wind, False, 4, 0.2, error, error)),
        (sensors.measure_airspeed, (MODEL, state, wind, 4, 0.2, 0.5)),
    ):
        # Not `_compile`: these call methods of the model.
        assert list(compiled(measure)(*arguments)) == pytest.approx(
            list(measure(*arguments)), abs=1e-12, nan_ok=True
        )
    timing = sensors.sensor_timing("position", 50.0, 0.04, 200.0)
    line = [NO_FIX._replace(sequence=n) for n in range(3)]
    fast_delivered = _compile(sensor_sampling.delivered)
    for n in range(20):
        expected = sensor_sampling.delivered(timing, line, n).sequence
        assert fast_delivered(timing, tuple(line), n).sequence == expected


def test_a_wing_in_air_that_rolls_as_it_does_is_not_damped() -> None:
    """p - p_g is what the air meets: at p = p_g the wing stays as it is without either."""
    still = gliding_state(glide_at(MODEL, 9.0), STILL)
    rolling = still._replace(roll_rate_frd_radps=0.5)

    def gained(state: AircraftState, roll_gust: float) -> float:
        after = step(MODEL, state, _hold(state), STILL, STILL, 1e-4, roll_gust, roll_gust)
        return (after.roll_rate_frd_radps - state.roll_rate_frd_radps) / 1e-4

    damping = gained(rolling, 0.0)
    assert damping < -5.0  # about 20 / s at this speed
    assert gained(rolling, 0.5) == pytest.approx(0.0, abs=0.02)
    assert gained(still, 0.5) == pytest.approx(-damping, rel=0.02)
    assert gained(still, -0.5) == pytest.approx(damping, rel=0.02)

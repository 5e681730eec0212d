"""What an airframe file may say of its aircraft, key by key, and the ends of what is searched for
in its glides and its polar."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, nan, sin

import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.aircraft import (
    FASTEST_GLIDE_MPS,
    RATE_LIMIT_RADPS,
    SLOWEST_MPS,
    AircraftModel,
    AircraftState,
    aircraft_model,
    glide_at,
    glide_polar,
    glide_polar_fit,
    gliding_state,
    highest_pitch_glide,
    lift_drag,
    steady_glide,
)
from tgl_soar.sim.point_mass import PointMass, point_mass, polar_misfit
from tgl_soar.sim.servos import ServoParams, servo_params
from tgl_soar.types import polar_sink

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
TABLE, FIGURES = asdict(AIRFRAME.airframe), AIRFRAME.model
MODEL = aircraft_model(TABLE, FIGURES)
POLAR = AIRFRAME.polar.as_polar()
BENCH = ["mass_kg", "wing_area_m2", "span_m", "chord_m", "ixx_kgm2", "iyy_kgm2", "izz_kgm2"]
ABOVE_0 = [
    *BENCH,
    *("gravity_mps2", "air_density_kgpm3", "CL_alpha", "stall_alpha_rad", "stall_width_rad"),
    *("CD0", "Cm_elevator", "Cl_aileron", "Cn_rudder"),
]
BELOW_0 = ["stall_alpha_negative_rad", "Cl_p", "Cm_alpha", "Cm_q", "Cn_r"]
OPTIONAL = [
    *("CL_brake", "CD_brake", "Cm_brake"),
    *("propeller_thrust_n", "propeller_speed_mps", "propeller_lag_s"),
]


def made_with(name: str, value: object) -> AircraftModel:
    if name in BENCH:
        return aircraft_model({**TABLE, name: value}, FIGURES)
    return aircraft_model(TABLE, {**FIGURES, name: value})  # type: ignore[dict-item]


def where(name: str) -> str:
    return f"{'airframe' if name in BENCH else 'model'}.{name}"


@pytest.mark.parametrize("name", AircraftModel._fields)
def test_a_figure_has_a_sign_that_it_must_have_or_any(name: str) -> None:
    for sign, word, must in ((-1.0, "positive", ABOVE_0), (1.0, "negative", BELOW_0)):
        for value in (sign * 0.5, 0.0):
            if name in must:
                words = f"{where(name)} = {value}: must be {word}"
                with pytest.raises(ValueError, match=words):
                    made_with(name, value)
            elif name not in (*ABOVE_0, *BELOW_0):
                assert getattr(made_with(name, value), name) == value
    good = -0.5 if name in BELOW_0 else 0.5
    assert getattr(made_with(name, good), name) == good


@pytest.mark.parametrize("name", ["mass_kg", "CL0", "CL_brake"])
def test_a_figure_is_a_number_of_a_size_that_there_is(name: str) -> None:
    assert getattr(made_with(name, 999_999), name) == 999_999.0
    for bad in (1e6, inf, nan, -1e6):
        with pytest.raises(ValueError, match=f"{where(name)} = .*: must be finite, and below 1e6"):
            made_with(name, bad)
    for word in ("1", True):
        with pytest.raises(ValueError, match=f"{where(name)} = {word}: a number is needed"):
            made_with(name, word)


@pytest.mark.parametrize("name", AircraftModel._fields)
def test_only_brake_and_propeller_may_be_missing(name: str) -> None:
    table = {key: value for key, value in TABLE.items() if key != name}
    figures = {key: value for key, value in FIGURES.items() if key != name}
    if name in OPTIONAL:
        assert getattr(aircraft_model(table, figures), name) == 0.0
    else:
        with pytest.raises(ValueError, match=f"{where(name)}: missing; a number"):
            aircraft_model(table, figures)


def test_an_unknown_key_is_named_and_a_servos_is_passed_over() -> None:
    with pytest.raises(ValueError, match=r"model\.CL_alfa: unknown; known are gravity_mps2, air_"):
        aircraft_model(TABLE, {**FIGURES, "CL_alfa": 1.0})
    with pytest.raises(ValueError, match=r"model\.mass_kg: unknown"):
        aircraft_model(TABLE, {**FIGURES, "mass_kg": 1.0})
    assert aircraft_model(TABLE, {**FIGURES, "servo_anything": 1.0}) == MODEL


# --- servos ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [
        ("servo_lag_radps", 1.0, 1e4),
        ("servo_rate_per_s", 0.01, 1e4),
        ("servo_travel", 0.01, 1.0),
        ("servo_delay_s", 0.0, 1.0),
    ],
)
def test_a_servos_figure_is_in_its_range_to_both_ends(key: str, low: float, high: float) -> None:
    place = ("servo_lag_radps", "servo_rate_per_s", "servo_travel", "servo_delay_s").index(key)
    for good in (low, high):
        assert servo_params({**FIGURES, key: good})[place] == good
    words = rf"model\.{key} = .*: must be from {low:g} to {high:g}".replace("+", r"\+")
    for bad in (low - 0.001, high * 1.001, nan, inf):
        with pytest.raises(ValueError, match=words):
            servo_params({**FIGURES, key: bad})
    missing = {name: value for name, value in FIGURES.items() if name != key}
    with pytest.raises(ValueError, match=rf"model\.{key}: missing; a number from {low:g} to"):
        servo_params(missing)


def test_the_shipped_servos_are_those_of_the_file() -> None:
    assert servo_params(FIGURES) == ServoParams(54.0, 9.0, 1.0, 0.0)


# --- glides ---------------------------------------------------------------------------------------


def test_limits_that_hold_for_all_aircraft() -> None:
    assert (RATE_LIMIT_RADPS, SLOWEST_MPS, FASTEST_GLIDE_MPS) == (100.0, 1e-6, 12.0)


@pytest.mark.parametrize("alpha", [0.03, 0.1, 0.18])
def test_a_steady_glide_balances_weight_moment_and_air(alpha: float) -> None:
    glide = steady_glide(MODEL, alpha)
    assert MODEL.Cm0 + MODEL.Cm_alpha * sin(alpha) + MODEL.Cm_elevator * glide.elevator == (
        pytest.approx(0.0, abs=1e-12)
    )
    cl, cd = lift_drag(MODEL, alpha, glide.elevator)
    assert (glide.lift_coefficient, glide.drag_coefficient) == (cl, cd)
    gamma = atan2(cd, cl)
    air = 0.5 * 1.225 * glide.airspeed_mps**2 * 0.180 * hypot(cl, cd)
    assert air == pytest.approx(0.699 * 9.80665)
    assert glide.alpha_rad == alpha
    assert glide.pitch_rad == pytest.approx(alpha - gamma)
    assert glide.horizontal_mps == pytest.approx(glide.airspeed_mps * cos(gamma))
    assert glide.sink_mps == pytest.approx(glide.airspeed_mps * sin(gamma))


def test_a_wing_that_gives_no_upward_lift_does_not_glide() -> None:
    with pytest.raises(ValueError, match=r"no steady glide at alpha -0\.200 rad: C_L is -"):
        steady_glide(MODEL, -0.2)


def test_no_glide_has_a_higher_pitch_than_the_highest() -> None:
    highest = highest_pitch_glide(MODEL)
    pitches = [steady_glide(MODEL, alpha).pitch_rad for alpha in np.linspace(0.02, 0.4, 400)]
    assert highest.pitch_rad >= max(pitches) - 1e-9
    assert highest.pitch_rad == pytest.approx(max(pitches), abs=1e-5)
    assert MODEL.highest_pitch_glide() == highest


def test_a_glide_is_found_at_every_speed_from_the_slowest_on() -> None:
    slowest = highest_pitch_glide(MODEL).horizontal_mps
    for speed in (slowest, slowest + 0.01, 9.0, 12.0, 14.0):
        assert glide_at(MODEL, speed).horizontal_mps == pytest.approx(speed, abs=1e-5)
    assert MODEL.glide_at(9.0) == glide_at(MODEL, 9.0)
    for speed in (slowest - 0.01, 1000.0, nan):
        with pytest.raises(ValueError, match=f"the slowest before the stall has {slowest:.2f} m/s"):
            glide_at(MODEL, speed)
    with pytest.raises(ValueError, match="too fast for this model"):
        glide_at(MODEL, 999.0)


def test_the_polar_is_fitted_from_just_above_the_slowest_to_12_metres_a_second() -> None:
    slowest = highest_pitch_glide(MODEL).horizontal_mps
    fit = glide_polar_fit(MODEL)
    assert fit.polar == glide_polar(MODEL)
    assert fit.polar.speed_min_mps == pytest.approx(round(1.02 * slowest, 1))
    assert fit.polar.speed_max_mps == 12.0
    other = glide_polar(MODEL, 10.0)
    assert other.speed_max_mps == 10.0
    speeds = np.linspace(fit.polar.speed_min_mps, 12.0, 41)
    off = [polar_sink(fit.polar, float(u)) - glide_at(MODEL, float(u)).sink_mps for u in speeds]
    assert np.sqrt(np.mean(np.square(off))) < 0.01


def test_a_gliding_state_goes_through_the_air_as_the_glide_does() -> None:
    glide = glide_at(MODEL, 9.0)
    state = gliding_state(glide, (8.0, 0.5, 1.0), 1.0, 2.0, 3.0)
    assert state[:3] == (1.0, 2.0, 3.0)
    assert state[3:6] == pytest.approx((-1.0, 0.5, 1.0 - glide.sink_mps))
    pitch = 0.5 * glide.pitch_rad
    assert state[6:10] == pytest.approx((cos(pitch), 0.0, sin(pitch), 0.0))
    assert state[10:] == (0.0, 0.0, 0.0, glide.elevator, 0.0, 0.0, 0.0, 0.0)
    assert gliding_state(glide, (8.0, 0.5, 1.0))[:3] == (0.0, 0.0, 0.0)
    assert AircraftState._field_defaults == {"brake": 0.0, "throttle": 0.0}


# --- the point mass's polar -----------------------------------------------------------------------


def test_the_drag_is_the_weighted_parabola_over_81_speeds_of_the_polar() -> None:
    """By `polyfit`, whose weights are what a C_D means in sink: V / C_L."""
    m = point_mass(TABLE, FIGURES, POLAR)
    horizontal = np.linspace(POLAR.speed_min_mps, POLAR.speed_max_mps, 81)
    sink = np.polyval([POLAR.c3, POLAR.c2, POLAR.c1, POLAR.c0], horizontal)
    speed = np.sqrt(horizontal**2 + sink**2)
    weight = 0.699 * 9.80665
    total = weight / (0.5 * 1.225 * 0.180 * speed**2)
    cl, cd = total * horizontal / speed, total * sink / speed
    a2, a1, a0 = np.polyfit(cl, cd, 2, w=speed / cl)
    assert (m.a0, m.a1, m.a2) == pytest.approx((a0, a1, a2), rel=1e-6)


def misfit_of(m: PointMass) -> tuple[float, float]:
    speeds = np.linspace(POLAR.speed_min_mps, POLAR.speed_max_mps, 81).tolist()
    off = [m.glide_at(u).sink_mps - polar_sink(POLAR, u) for u in speeds]
    return float(np.linalg.norm(off) / 9.0), max(map(abs, off))


def test_the_misfit_is_that_of_the_models_own_glides_without_thrust() -> None:
    m = point_mass(TABLE, FIGURES, POLAR)
    assert tuple(polar_misfit(m, POLAR)) == pytest.approx(misfit_of(m))
    driven = m._replace(thrust_n=1.0)
    assert polar_misfit(driven, POLAR) == polar_misfit(m, POLAR)
    worse = m._replace(a0=m.a0 + 0.01)
    assert tuple(polar_misfit(worse, POLAR)) == pytest.approx(misfit_of(worse))


def test_a_polar_whose_drag_would_vanish_somewhere_is_refused() -> None:
    """A sink that falls all the way: a parabola that bends down, or one with roots."""
    falling = POLAR._replace(c0=3.0, c1=-0.2, c2=0.0, c3=0.0)
    with pytest.raises(ValueError, match="is not above 0 at every C_L; fit the polar again over a"):
        point_mass(TABLE, FIGURES, falling)

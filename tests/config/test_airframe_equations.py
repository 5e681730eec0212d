"""What follows from an airframe file, computed again from the equations in the docstrings.

The made-up aircraft has round figures: 2 kg, 0.5 m², 2 m of span, 0.25 m of chord, in air of
1.2 kg/m³ and a gravity of 10 m/s².
"""

from __future__ import annotations

from math import atan, degrees, pi, radians, sqrt
from typing import Any

import msgspec
import pytest

from tgl_soar.config.airframe import OF_THE_BRAKE, OF_THE_PROPELLER, Airframe
from tgl_soar.config.dynamics import MeasuredDynamics, dynamics_parameters
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.glide_limits import pitch_limits, slowest_airspeed
from tgl_soar.config.lateral_dynamics import UNKNOWN
from tgl_soar.config.lateral_gains import lateral_dynamics, lateral_gains
from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.config.stall_limit import stall_limit
from tgl_soar.types import NO_AERODYNAMICS, GlidePolar

M, S, B, C, RHO, G = 2.0, 0.5, 2.0, 0.25, 1.2, 10.0
BENCH = {"mass_kg": M, "wing_area_m2": S, "chord_m": C, "iyy_kgm2": 0.05}
PITCH = {
    "air_density_kgpm3": RHO, "gravity_mps2": G, "CL_alpha": 5.0, "CL_elevator": -0.125,
    "Cm_alpha": -0.5, "Cm_q": -8.0, "Cm_elevator": 0.4,
}  # fmt: skip
GLIDE = {"CD0": 0.04, "CD_lift": 0.09}
POLAR = GlidePolar(c0=2.5, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=8.0, speed_max_mps=16.0)
BRIDGE = ("bridge", None)


def derived(
    given: dict[str, Any] | None = None,
    model: dict[str, float] | None = None,
    polar: GlidePolar = POLAR,
    route: tuple[str, str | None] = BRIDGE,
) -> dict[str, float]:
    measured = MeasuredDynamics(**(given or {}))
    return dynamics_parameters(measured, BENCH, {} if model is None else model, polar, route)


# --- pitch -------------------------------------------------------------------------------------


def test_the_short_period_is_that_of_the_textbook() -> None:
    v = 10.0
    q = 0.5 * RHO * v**2
    lift = q * S * 5.0 / (M * v)
    moment = q * S * C * -0.5 / 0.05
    damping = q * S * C**2 * -8.0 / (2.0 * v * 0.05)
    found = derived({"speed_mps": v}, PITCH)
    omega = sqrt(-moment - damping * lift)
    assert found["DYN_SPEED"] == v
    assert found["DYN_FREQ"] == pytest.approx(omega)
    assert found["DYN_DAMP"] == pytest.approx((lift - damping) / (2.0 * omega))
    assert found["DYN_EFFECT"] == pytest.approx(q * S * C * 0.4 / 0.05)
    assert found["DYN_PATH"] == pytest.approx(1.0 / lift)
    assert found["DYN_LIFT"] == pytest.approx(q * S * -0.125 / M)


def test_of_air_that_is_not_named_it_is_that_at_the_sea() -> None:
    without = {key: value for key, value in PITCH.items() if key != "air_density_kgpm3"}
    usual = {**PITCH, "air_density_kgpm3": 1.225}
    given = {"speed_mps": 10.0}
    assert derived(given, without) == derived(given, usual)
    assert derived({}, {**without, **GLIDE}) == derived({}, {**usual, **GLIDE})
    heavy = {key: value for key, value in {**PITCH, **GLIDE}.items() if key != "gravity_mps2"}
    best = derived({}, heavy)["DYN_BEST"]
    assert best == pytest.approx(derived({}, {**PITCH, **GLIDE})["DYN_BEST"] * sqrt(0.980665))


@pytest.mark.parametrize("missing", ["CL_alpha", "Cm_alpha", "Cm_q", "Cm_elevator"])
def test_without_one_of_its_figures_there_is_no_short_period(missing: str) -> None:
    model = {key: value for key, value in PITCH.items() if key != missing}
    found = derived({"speed_mps": 10.0}, model)
    assert set(found) == {"DYN_SPEED", "DYN_BEST", "DYN_GLIDE"}


def test_an_aircraft_that_does_not_swing_back_has_no_frequency() -> None:
    found = derived({"speed_mps": 10.0}, {**PITCH, "Cm_alpha": 5.0})
    assert "DYN_FREQ" not in found
    assert "DYN_DAMP" not in found
    assert "DYN_EFFECT" in found
    undamped = derived({"speed_mps": 10.0}, {**PITCH, "Cm_q": 40.0, "Cm_alpha": -50.0})
    assert "DYN_DAMP" not in undamped


@pytest.mark.parametrize(("lift", "known"), [(26.6, True), (26.7, False), (-26.6, True),
                                             (-26.7, False), (0.0, True)])  # fmt: skip
def test_an_elevator_lifts_no_more_than_200_metres_a_second_squared(
    lift: float, known: bool
) -> None:
    """Q S / m is 15 m/s² at 10 m/s: a coefficient of 13.33 would lift 200 m/s²."""
    assert ("DYN_LIFT" in derived({"speed_mps": 10.0}, {**PITCH, "CL_elevator": lift / 2.0})) == (
        known
    )


def test_the_best_glide_is_where_both_drags_are_equal() -> None:
    found = derived({}, GLIDE | {"air_density_kgpm3": RHO, "gravity_mps2": G})
    lift = sqrt(0.04 / 0.09)
    assert found["DYN_BEST"] == pytest.approx(sqrt(2.0 * M * G / (RHO * S * lift)))
    assert found["DYN_GLIDE"] == pytest.approx(lift / (0.04 + 0.09 * lift**2))
    assert found["DYN_SPEED"] == found["DYN_BEST"]


@pytest.mark.parametrize("model", [{"CD0": 0.04}, {"CD_lift": 0.09}, {},
                                   {"CD0": 0.0, "CD_lift": 0.09}])  # fmt: skip
def test_without_both_drags_the_polar_tells_the_best_glide(model: dict[str, float]) -> None:
    """Sink 2 + (u - 10)² / 8 m/s: u / sink is greatest where u² = 116."""
    polar = POLAR._replace(c0=2.0 + 100.0 / 8.0, c1=-20.0 / 8.0, c2=1.0 / 8.0)
    found = derived({}, model, polar)
    best = sqrt(116.0)
    assert found["DYN_BEST"] == pytest.approx(best, abs=0.05)
    assert found["DYN_GLIDE"] == pytest.approx(best / (2.0 + (best - 10.0) ** 2 / 8.0), rel=1e-4)
    level = derived({}, model, POLAR)
    assert (level["DYN_BEST"], level["DYN_GLIDE"]) == (16.0, 16.0 / 2.5)
    steep = derived({}, model, POLAR._replace(c3=0.01))
    assert steep["DYN_BEST"] == 8.0
    assert steep["DYN_GLIDE"] == pytest.approx(8.0 / (2.5 + 5.12))
    gaining = derived({}, model, POLAR._replace(c0=-1.0))
    assert gaining["DYN_GLIDE"] == pytest.approx(16.0 / 0.001)


def test_a_servos_lag_and_delay() -> None:
    lagging = derived({}, {"servo_lag_radps": 40.0, "servo_delay_s": 0.01})
    assert lagging["DYN_LAG"] == 0.025
    assert lagging["DYN_SERVO"] == pytest.approx(0.035)
    assert derived({}, {"servo_lag_radps": 40.0})["DYN_SERVO"] == 0.025
    measured = derived({"servo_s": 0.05}, {"servo_lag_radps": 40.0})
    assert (measured["DYN_LAG"], measured["DYN_SERVO"]) == (0.025, 0.05)
    apart = derived({"servo_s": 0.05, "servo_lag_s": 0.03})
    assert (apart["DYN_LAG"], apart["DYN_SERVO"]) == (0.03, 0.05)
    assert "DYN_LAG" not in derived()


@pytest.mark.parametrize(("key", "name"), [
    ("speed_mps", "DYN_SPEED"), ("short_period_radps", "DYN_FREQ"), ("damping", "DYN_DAMP"),
    ("elevator_effect_radps2", "DYN_EFFECT"), ("elevator_lift_mps2", "DYN_LIFT"),
    ("servo_s", "DYN_SERVO"), ("servo_lag_s", "DYN_LAG"),
    ("path_s", "DYN_PATH"), ("glide_ratio", "DYN_GLIDE"), ("best_glide_mps", "DYN_BEST"),
    ("command_delay_s", "CMD_DELAY"),
])  # fmt: skip
def test_what_was_measured_stands_as_it_is(key: str, name: str) -> None:
    measured = {key: 0.625}
    assert derived(measured, {**PITCH, **GLIDE})[name] == 0.625
    assert MeasuredDynamics(**measured).keys() == {name: key}
    assert getattr(MeasuredDynamics(), key) is None


@pytest.mark.parametrize(("firmware", "route", "delay"), [
    ("ardupilot", None, 0.0245), ("ardupilot", "override", 0.0245),
    ("ardupilot", "attitude", 0.0145), ("px4", None, None), ("bridge", None, None),
])  # fmt: skip
def test_a_delay_that_nobody_measured_is_its_firmwares(
    firmware: str, route: str | None, delay: float | None
) -> None:
    assert derived(route=(firmware, route)).get("CMD_DELAY") == delay


# --- glide, stall ------------------------------------------------------------------------------

TRIMMED = {"CL0": 0.25, "CL_alpha": 5.0, **GLIDE}


def test_pitches_are_counted_from_a_glide_a_little_slower_than_the_best() -> None:
    lift = sqrt(0.04 / 0.09) / 0.94**2
    alpha = (lift - 0.25) / 5.0
    trim = degrees(alpha) - degrees(atan((0.04 + 0.09 * lift**2) / lift))
    found = pitch_limits(TRIMMED, {}, 1.3)
    assert found == pytest.approx(
        {
            "PITCH_TRIM": trim,
            "PITCH_MIN": trim - 10.5,
            "PITCH_MAX": trim + 7.5,
            "REC_PITCH": trim - 2.5,
        },
        abs=0.0501,
    )
    assert all(round(value, 1) == value for value in found.values())


@pytest.mark.parametrize("fastest", [0.0, 1.0, 1.5, 1.7, 1.9, 4.0])
def test_the_nose_may_go_as_far_down_as_the_fastest_wind_of_the_polar_asks_for(
    fastest: float,
) -> None:
    """And 3.5 degrees below, for gusts in it; not beyond 18, within the least TILT_MAX."""
    lift = sqrt(0.04 / 0.09) / max(0.94, fastest) ** 2
    hovers = degrees((lift - 0.25) / 5.0) - degrees(atan((0.04 + 0.09 * lift**2) / lift))
    found = pitch_limits(TRIMMED, {}, fastest)
    below_trim = found["PITCH_TRIM"] - 10.5
    assert found["PITCH_MIN"] == pytest.approx(
        min(below_trim, max(-18.0, hovers - 3.5)), abs=0.1001
    )
    assert (found["PITCH_MIN"] < below_trim - 1.0) == (fastest > 1.6)
    others = {k: v for k, v in found.items() if k != "PITCH_MIN"}
    assert others == {k: v for k, v in pitch_limits(TRIMMED, {}, 1.0).items() if k != "PITCH_MIN"}


@pytest.mark.parametrize("missing", ["CL0", "CL_alpha", "CD0", "CD_lift"])
def test_without_lift_or_drag_no_pitch_is_known(missing: str) -> None:
    assert pitch_limits({k: v for k, v in TRIMMED.items() if k != missing}, {}, 1.5) == {}
    if missing != "CL0":
        assert pitch_limits({**TRIMMED, missing: 0.0}, {}, 1.5) == {}
        assert pitch_limits({**TRIMMED, missing: -0.1}, {}, 1.5) == {}


@pytest.mark.parametrize("given", ["PITCH_TRIM", "PITCH_MIN", "PITCH_MAX", "REC_PITCH"])
def test_one_pitch_of_the_file_is_all_of_its_own(given: str) -> None:
    assert pitch_limits(TRIMMED, {given: 0.0}, 1.5) == {}
    assert pitch_limits(TRIMMED, {"RHO_P": 0.0}, 1.5)


def test_a_pitch_stays_in_its_range() -> None:
    for cambered in (-20.0, 20.0):
        for name, value in pitch_limits({**TRIMMED, "CL0": cambered}, {}, 1.5).items():
            allowed = PARAMETERS[INDEX[name]]
            assert value == (allowed.maximum if cambered < 0.0 else allowed.minimum)


@pytest.mark.parametrize(("slowest", "least"), [(10.0, 7.9), (7.6, 6.0)])
def test_the_slowest_airspeed_is_79_hundredths_of_the_slowest_glide(
    slowest: float, least: float
) -> None:
    assert slowest_airspeed(slowest) == {"SPEED_MIN": pytest.approx(least, abs=0.0501)}


def test_the_largest_angle_of_attack_is_that_of_the_stall_and_its_width() -> None:
    found = stall_limit({"stall_alpha_rad": radians(11.0), "stall_width_rad": radians(1.24)})
    assert found == {"ALPHA_MAX": 12.2}
    assert stall_limit({"stall_alpha_rad": 0.2}) == {}
    assert stall_limit({"stall_width_rad": 0.2}) == {}


# --- roll and yaw ------------------------------------------------------------------------------

LATERAL = {
    "gravity_mps2": G, "air_density_kgpm3": RHO, "servo_lag_radps": 50.0, "servo_delay_s": 0.01,
    "Cl_p": -0.5, "Cl_aileron": 0.125, "Cn_beta": 0.1, "Cn_r": -0.2, "Cn_rudder": 0.05,
    "Cl_beta": -0.07, "Cl_r": 0.15, "Cn_p": -0.06, "Cn_aileron": -0.01, "CY_beta": -0.3,
    "CY_rudder": -0.11, "CL_alpha": 5.0, "CL0": 0.3,
}  # fmt: skip
IX, IZ = 0.08, 0.16
V = 1.15 * 8.0
QS = 0.5 * RHO * V**2 * S


def airframe(model: dict[str, float]) -> Airframe:
    table = {
        "airframe": {**BENCH, "name": "made up", "span_m": B, "ixx_kgm2": IX, "izz_kgm2": IZ},
        "autopilot": {"firmware": "bridge"},
        "surfaces": {"elevator": {"channel": 2}, "aileron": {"channel": 1},
                     "rudder": {"channel": 4}},
        "polar": POLAR._asdict(),
        "model": model,
    }  # fmt: skip
    return msgspec.convert(table, Airframe)


def test_derivatives_of_roll_yaw_and_side_are_those_of_the_docstring() -> None:
    found = lateral_dynamics(airframe(LATERAL))
    half = B / (2.0 * V)
    assert found._asdict() == pytest.approx(
        {
            "speed_mps": V,
            "roll_effect_radps2": QS * B * 0.125 / IX,
            "roll_damping_per_s": QS * B * 0.5 * half / IX,
            "yaw_effect_radps2": QS * B * 0.05 / IZ,
            "yaw_damping_per_s": QS * B * 0.2 * half / IZ,
            "yaw_stiffness_per_s2": QS * B * 0.1 / IZ,
            "lag_s": 0.02,
            "roll_of_slip_per_s2": QS * B * -0.07 / IX,
            "roll_of_yaw_per_s": QS * B * 0.15 * half / IX,
            "yaw_of_roll_per_s": QS * B * -0.06 * half / IZ,
            "yaw_of_aileron_radps2": QS * B * -0.01 / IZ,
            "side_of_slip_mps2": QS * -0.3 / M,
            "side_of_rudder_mps2": QS * -0.11 / M,
            "lift_rad": M * G / (QS * 5.0),
            "rigging_rad": -0.3 / 5.0,
        }
    )


def test_a_model_without_lift_at_no_incidence_has_no_rigging() -> None:
    found = lateral_dynamics(airframe({key: LATERAL[key] for key in LATERAL if key != "CL0"}))
    assert found.rigging_rad == 0.0
    assert found.lift_rad == pytest.approx(M * G / (QS * 5.0))


def test_what_a_model_does_not_name_of_the_cross_derivatives_is_nothing() -> None:
    needed = ("gravity_mps2", "air_density_kgpm3", "servo_lag_radps", "servo_delay_s", "Cl_p",
              "Cl_aileron", "Cn_beta", "Cn_r", "Cn_rudder")  # fmt: skip
    found = lateral_dynamics(airframe({key: LATERAL[key] for key in needed}))
    assert found.speed_mps == pytest.approx(V)
    assert found[7:] == (0.0,) * 8
    for key in needed:
        assert lateral_dynamics(airframe({k: LATERAL[k] for k in needed if k != key})) == UNKNOWN


def test_a_servo_without_a_delay_has_gains() -> None:
    assert lateral_gains(airframe({**LATERAL, "servo_delay_s": 0.0}))


def expected_gains(model: dict[str, float]) -> dict[str, float]:
    late = 1.0 / model["servo_lag_radps"] + model["servo_delay_s"] + 0.040
    omega = (pi / 6.0) / late
    half = B / (2.0 * V)
    roll_effect = QS * B * model["Cl_aileron"] / IX
    roll_damping = -QS * B * model["Cl_p"] * half / IX
    yaw_effect = QS * B * model["Cn_rudder"] / IZ
    yaw_damping = -QS * B * model["Cn_r"] * half / IZ
    stiffness = QS * B * max(0.0, model["Cn_beta"]) / IZ
    rud_p = 0.7 * max(0.0, model["Cn_beta"]) / model["Cn_rudder"]
    damping = 2.0 * 0.7 * sqrt(stiffness + yaw_effect * rud_p) - yaw_damping
    return {
        "AIL_P": omega * roll_damping / roll_effect,
        "AIL_I": omega * roll_damping / roll_effect * omega / 15.0,
        "AIL_D": omega / roll_effect,
        "RUD_P": rud_p,
        "RUD_D": min(damping, 0.3 / late) / yaw_effect,
        "SIDE_P": omega / (6.0 * model["gravity_mps2"]),
        "SIDE_I": omega / (6.0 * model["gravity_mps2"]) / 8.0,
        "LAT_SPEED": V,
        "LAT_LATE": late,
    }


@pytest.mark.parametrize("changed", [
    {}, {"Cn_beta": 0.3}, {"Cn_beta": 0.05, "Cn_r": -0.05}, {"servo_lag_radps": 25.0},
    {"Cl_aileron": 0.25}, {"Cn_beta": 0.005, "Cn_r": -0.02, "Cn_rudder": 0.02},
])  # fmt: skip
def test_gains_are_those_of_the_docstring(changed: dict[str, float]) -> None:
    model = {**LATERAL, **changed}
    found = lateral_gains(airframe(model))
    assert found == pytest.approx(expected_gains(model), rel=1e-6)


def test_both_limits_of_the_rudders_rate_gain_are_met() -> None:
    """The cases above have some of each: the damping that is wanted, and what the delays leave."""
    late = 0.02 + 0.01 + 0.04
    for model, is_delays in ((LATERAL, False), ({**LATERAL, "Cn_beta": 0.3}, True)):
        gain = lateral_gains(airframe(model))["RUD_D"]
        assert (gain == pytest.approx(0.3 / late / (QS * B * 0.05 / IZ))) == is_delays


# --- lift and drag as the module has them ------------------------------------------------------


def test_a_file_lacks_what_lift_and_drag_need() -> None:
    assert airframe({}).model_lacks() == ()
    assert airframe({}).aerodynamics() == NO_AERODYNAMICS
    assert "CL_alpha" in airframe({"CL0": 0.2}).model_lacks()
    assert "CL0" not in airframe({"CL0": 0.2}).model_lacks()
    assert airframe({"CL0": 0.2}).aerodynamics() == NO_AERODYNAMICS


def test_what_no_surface_or_motor_moves_does_nothing() -> None:
    """Coefficients of a brake and of a propeller may stand in [model] without either."""
    shipped_model = load_airframe(shipped("airframes/eclipson_c.toml")).model
    unmoved = dict.fromkeys((*OF_THE_BRAKE, *OF_THE_PROPELLER), 2.0)
    known = airframe({**shipped_model, **unmoved}).aerodynamics()
    assert known != NO_AERODYNAMICS
    assert {name: getattr(known, name) for name in OF_THE_PROPELLER} == dict.fromkeys(
        OF_THE_PROPELLER, 0.0
    )
    without = airframe(dict(shipped_model)).aerodynamics()
    assert known == without

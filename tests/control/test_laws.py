"""Each parameter reaches its own place in the laws, in SI units, and moves nothing else there.

What is expected is the value that the operator has set, converted by the unit that its declaration
states: degrees to radians, hertz to rad/s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, inf, isnan, pi, radians, sin
from operator import attrgetter

import pytest

from tgl_soar.config.files import airframe_file, load_airframe
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterSet
from tgl_soar.control import landing, laws
from tgl_soar.control.laws import Laws, dynamics_of, fence_of, late_by_s, laws_from
from tgl_soar.estimation.aerodynamics import elevator_of_rate, elevator_room, stall_speed
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_GROUND,
    OURS,
    THEIRS,
    THEIRS_WITH_RUDDER,
    Aerodynamics,
)

FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)  # the wind comes from the north: bearings are from upwind
PLAIN = ParameterSet()

# Where a parameter alone stands.
PLACES = {
    "TGL_X": "target.x_m",
    "TGL_Z": "target.z_m",
    "TGL_ACCEL": "line.acceleration_mps2",
    "TGL_SLEW": "line.speed_mps",
    "TGL_ALONG": "brake.along_m",
    "TGL_CAPTURE": "guards.capture_distance_m",
    "RHO_I_MAX": "soaring.pid.integral_max",
    "PITCH_MIN": "soaring.pid.output_min",
    "PITCH_MAX": "soaring.pid.output_max",
    "PITCH_SLEW": "soaring.slew_radps",
    "RHO_P_IMU": "soaring_imu.pid.kp",
    "RHO_I_IMU": "soaring_imu.pid.ki",
    "RHO_D_IMU": "soaring_imu.pid.kd",
    "RHO_DF_IMU": "soaring_imu.pid.rate_filter_radps",
    "ELE_P_IMU": "pitch_imu.kp",
    "ELE_I_IMU": "pitch_imu.ki",
    "ELE_D_IMU": "pitch_imu.kd",
    "ELE_DSP_IMU": "setpoint_weight",
    "ELE_TRIM": "trim.elevator",
    "AIL_P": "roll.kp",
    "AIL_I": "roll.ki",
    "AIL_D": "roll.kd",
    "AIL_D_FILT": "roll.rate_filter_radps",
    "AIL_TRIM": "trim.aileron",
    "RUD_P": "heading.pid.kp",
    "RUD_D": "heading.pid.kd",
    "RUD_D_FILT": "heading.pid.rate_filter_radps",
    "RUD_TRIM": "trim.rudder",
    "LAT_SPEED": "lateral_schedule.speed_mps",
    "WPT_X": "heading.waypoint_x_m",
    "WPT_R_MIN": "heading.distance_min_m",
    "VEER_T": "cross_wind.time_s",
    "BANK_P": "bank.bank_per_heading",
    "BANK_MAX": "bank.bank_max_rad",
    "SIDE_P": "sideways.kd",
    "SIDE_I": "sideways.ki",
    "SURF_RATE": "envelope.rate_max_per_s",
    "SURF_TOL": "health.surface_error_max",
    "ALPHA_MAX": "envelope.alpha_max_rad",
    "SINK_MAX": "envelope.sink_max_mps",
    "FENCE_X_MIN": "fence.x_min_m",
    "FENCE_X_MAX": "fence.x_max_m",
    "FENCE_Z_MIN": "fence.z_min_m",
    "EST_FIX_SD": "motion.fix_sd_m",
    "EST_VEL_SD": "motion.velocity_sd_mps",
    "EST_ACC_SD": "motion.force_sd_mps2",
    "EST_ACC_BIAS_SD": "motion.bias_sd_mps2",
    "EST_CV_SD": "motion.unknown_sd_mps2",
    "EST_DELAY": "motion.fix_delay_s",
    "EST_GATE": "motion.fix_gate_m",
    "EST_RESET_MAX": "motion.reset_max_m",
    "EST_SD_MAX": "guards.position_sd_max_m",
    "RNG_USE": "rangefinder.use",
    "RNG_GATE": "rangefinder.gate_m",
    "WIND_CHANGE": "wind.change",
    "WIND_ALIGN": "wind.alignment_rad",
    "PITCH_TRIM": "pitch_trim.trim_pitch_rad",
    "WIND_TRIM": "pitch_trim.fraction",
    "WIND_TRIM_T": "pitch_trim.trim_s",
    "WIND_FF": "pitch_trim.gust_fraction",
    "AGE_POS_HOLD": "health.position_age_max_s",
    "AGE_POS_MAX": "guards.position_age_max_s",
    "AGE_POS_DR": "guards.reckoned_max_s",
    "AGE_FROZEN": "health.frozen_s",
    "AGE_ATT_MAX": "health.attitude_age_max_s",
    "AGE_AP_MAX": "health.heartbeat_age_max_s",
    "REC_TIME": "guards.recover_s",
    "CAPTURE_MAX": "guards.e_rho_max_m",
    "FC_ACT": "forecast.act",
    "FC_TIME": "forecast.time_s",
    "FC_CHANCE": "forecast.chance",
    "BRK_P": "brake.kp_per_s",
    "BRK_V": "brake.kv",
    "BRK_I": "brake.ki_per_s",
    "BRK_SPEED": "brake.speed_max_mps",
    "BRK_BIAS": "brake.bias",
    "EXC_AMP": "excitation.amplitude_rad",
    "THR_MAX": "throttle.most",
    "SRCH_START": "search",
    "SRV_REACH": "survey_reach_m",
    "LNC_SPEED": "launch.throw_mps",
    "LNC_WAIT": "launch.wait_s",
    "LNC_PITCH": "launch.pitch_rad",
    "LNC_SLEW": "launch.line.speed_mps",
    "LNC_ACCEL": "launch.line.acceleration_mps2",
    "ESC_START": "landing.asked",
    "ESC_CLEAR": "landing.clearance_m",
    "ESC_SPARE": "landing.spare_m",
    "ESC_SIGMA": "landing.sigmas",
    "ESC_WIND": "landing.wind_fraction",
    "ESC_X": "landing.away_x_m",
    "BEAT_WIDTH": "beat.half_width_m",
    "DYN_BEST": "landing.best_glide_mps",
    "LND_X": "landing.place.x_m",
    "LND_Y": "landing.place.y_m",
    "LND_Z": "landing.place.z_m",
    "LND_LEN": "landing.place.length_m",
}
# These stand in several.
SHARED = {
    "RHO_P": ("soaring.pid.kp", "soaring_imu.pid.kp"),
    "RHO_I": ("soaring.pid.ki", "soaring_imu.pid.ki"),
    "RHO_D": ("soaring.pid.kd", "soaring_imu.pid.kd"),
    "RHO_D_FILT": ("soaring.pid.rate_filter_radps", "soaring_imu.pid.rate_filter_radps"),
    "ELE_P": ("pitch.kp", "pitch_imu.kp"),
    "ELE_I": ("pitch.ki", "pitch_imu.ki"),
    "ELE_D": ("pitch.kd", "pitch_imu.kd"),
    "ELE_D_FILT": ("pitch.rate_filter_radps", "pitch_imu.rate_filter_radps"),
    "TGL_ROT_SLEW": ("line.turn_rate_radps", "launch.line.turn_rate_radps"),
    "SIDE_BANK": ("sideways.output_max",),
    "SURF_MAX": (
        *("envelope.deflection_max", "heading.pid.output_max"),
        *(f"{name}.integral_max" for name in ("pitch", "pitch_imu", "roll")),
        *(f"{name}.output_max" for name in ("pitch", "pitch_imu", "roll")),
    ),
    "SPEED_MIN": ("envelope.speed_min_mps", "forecast.speed_min_mps", "landing.speed_min_mps"),
    "CLEAR_MIN": ("envelope.clearance_min_m", "forecast.clearance_min_m"),
    "REC_PITCH": ("envelope.glide_pitch_rad", "landing.glide_pitch_rad"),
    "TILT_MAX": ("guards.tilt_max_rad", "landing.tilt_max_rad"),
    "PSI_MAX": ("heading.heading_max_rad", "landing.heading_max_rad"),
    "VEER_MAX": ("cross_wind.veer_max_rad", "beat.veer_max_rad"),
    "FENCE_Y_MAX": ("fence.y_max_m", "landing.side_max_m"),
    "FENCE_Z_MAX": ("fence.z_max_m", "beat.top_z_m"),
}
ALL = {name: (place,) for name, place in PLACES.items()} | SHARED
BY_UNIT = {"deg": radians(1.0), "deg/s": radians(1.0), "Hz": 2.0 * pi}


def laws_of(
    changes: Mapping[str, float], aero: Aerodynamics = NO_AERODYNAMICS, loops: int = OURS
) -> Laws:
    return laws_from(PLAIN.changed(changes), FRAME, aero, loops=loops)


def laws_with(**changes: float) -> Laws:
    return laws_of(changes)


def another(name: str) -> float:
    """A value that may be given and is not the default's, nor a special one."""
    parameter = PARAMETERS[INDEX[name]]
    if parameter.integer:
        return parameter.minimum + 1.0 if parameter.default != parameter.minimum + 1.0 else 2.0
    aside = 0.2 * abs(parameter.default) + 0.01
    near = min(parameter.maximum, parameter.default + aside)
    if near == parameter.default:  # at the upper end of its range
        near -= 0.1 * (parameter.maximum - parameter.minimum)
    return near


@pytest.mark.parametrize("name", ALL)
def test_a_parameter_stands_in_its_places_in_si_units(name: str) -> None:
    value = another(name)
    assert value != PLAIN[name]
    changed = laws_with(**{name: value})
    for place in ALL[name]:
        expected = value * BY_UNIT.get(PARAMETERS[INDEX[name]].unit, 1.0)
        assert attrgetter(place)(changed) == pytest.approx(expected, rel=1e-6), place


@pytest.mark.parametrize("name", ALL)
def test_a_parameter_moves_no_other_one_s_place(name: str) -> None:
    before, after = laws_with(), laws_with(**{name: another(name)})
    own = {*ALL[name], *FOLLOWS.get(name, ())}
    others = {place for places in ALL.values() for place in places} - own
    moved = {
        place
        for place in others
        if attrgetter(place)(before) != attrgetter(place)(after)
        and not isnan(attrgetter(place)(before))
    }
    assert moved == set()


# By the parameters' own texts: the best glide's airspeed, where it is not known.
FOLLOWS = {"SPEED_MIN": ("landing.best_glide_mps",)}


def test_the_places_are_all_that_a_law_has_but_for_what_is_reckoned() -> None:
    """A new field of the laws that a parameter fills belongs in the lists above."""
    groups = ("motion", "health", "guards", "envelope", "fence", "pitch_trim", "bank")
    listed = {place for places in ALL.values() for place in places}
    fields = {
        f"{group}.{field}" for group in groups for field in getattr(laws_with(), group)._fields
    }
    # One says whether there is an IMU at all, the others are the airframe's.
    of_the_airframe = {f"envelope.{n}" for n in ("brake_throw", *ELEVATORS)}
    assert fields - listed == {"motion.use_imu", *of_the_airframe}


ELEVATORS = ("elevator_room", "elevator_per_radps")


def test_how_far_the_elevator_may_go_follows_from_the_airframe_its_trim_and_the_stall() -> None:
    airframe = load_airframe(airframe_file("eclipson_c"))
    aero, own = airframe.aerodynamics(), airframe.all_parameters()
    names = {name: own[name] for name in ("ALPHA_MAX", "DYN_BEST")}
    for changes in (names, names | {"ALPHA_MAX": 9.0}, names | {"ELE_TRIM": -0.4}):
        found, trim = laws_of(changes, aero).envelope, changes.get("ELE_TRIM", 0.0)
        alpha = radians(changes["ALPHA_MAX"])
        assert found.elevator_room == pytest.approx(elevator_room(aero, alpha, trim), rel=1e-5)
    assert laws_of(names, aero).envelope.elevator_per_radps == pytest.approx(
        elevator_of_rate(aero, own["DYN_BEST"]), rel=1e-5
    )
    assert laws_with().envelope.elevator_room == inf  # of an unknown aircraft


def test_the_speed_at_which_it_stalls_follows_from_the_airframe() -> None:
    aero = load_airframe(airframe_file("eclipson_c")).aerodynamics()
    assert laws_of({}, aero).landing.stall_mps == stall_speed(aero)
    assert 7.0 < stall_speed(aero) < aero.polar.speed_min_mps
    assert isnan(laws_with().landing.stall_mps)  # of an unknown aircraft


# --- travels ------------------------------------------------------------------------------------


def test_every_surface_may_go_as_far_one_way_as_the_other() -> None:
    found = laws_with(SURF_MAX=0.6, SIDE_BANK=8.0)
    for gains in (found.pitch, found.pitch_imu, found.roll, found.heading.pid):
        assert (gains.output_min, gains.output_max) == pytest.approx((-0.6, 0.6))
    bank = radians(8.0)
    assert (found.sideways.output_min, found.sideways.output_max) == pytest.approx((-bank, bank))


def test_the_heading_s_loop_has_no_integral() -> None:
    pid = laws_with().heading.pid
    assert (pid.ki, pid.integral_max) == (0.0, 0.0)


def test_half_of_the_bank_may_be_of_the_integral() -> None:
    """docs/parameters.md, SIDE_BANK; the error itself is the integral's, its rate P's."""
    sideways = laws_with(SIDE_BANK=9.0).sideways
    assert sideways.integral_max == pytest.approx(radians(4.5))
    assert sideways.kp == 0.0


def test_the_sideways_speed_is_filtered_ten_times_as_fast_as_its_loop() -> None:
    """That loop's crossover is g SIDE_P, 1.5 rad/s; at 1.8 to 2.2 rad/s the filter costs 6 degrees
    or little more."""
    crossover = 9.81 * PLAIN["SIDE_P"]
    filtered = laws_with().sideways.rate_filter_radps
    assert 10.0 * crossover <= filtered <= 15.0 * crossover


def test_surfaces_begin_at_their_trims_and_the_brake_retracted() -> None:
    trim = laws_with(ELE_TRIM=0.1, AIL_TRIM=-0.2, RUD_TRIM=0.3).trim
    assert trim == pytest.approx((0.1, -0.2, 0.3, 0.0))


# --- the line -----------------------------------------------------------------------------------


@pytest.mark.parametrize("lean_deg", [-20.0, 0.0, 15.0])
def test_a_line_that_leans_is_so_far_from_the_vertical(lean_deg: float) -> None:
    """Upward along it, and downstream below: a positive lean goes upstream with the height."""
    changes = {"TGL_LEAN": lean_deg, "TGL_LEAN_MIN": -30.0}
    eta = laws_with(**changes).target.eta_rad
    up = (-sin(radians(lean_deg)), cos(radians(lean_deg)))
    assert (cos(eta), sin(eta)) == pytest.approx(up)


def test_a_survey_moves_the_line_no_faster_than_it_is_to() -> None:
    slow = {"TGL_SLEW": 0.3, "SRV_SPEED": 0.1}
    for changes, speed_mps in (
        ({**slow, "SRV_START": 0.0}, 0.3),
        ({**slow, "SRV_START": 1.0}, 0.1),
        ({**slow, "SRV_START": 2.0}, 0.1),
        ({"TGL_SLEW": 0.05, "SRV_SPEED": 0.1, "SRV_START": 1.0}, 0.05),
    ):
        assert laws_of(changes).line.speed_mps == pytest.approx(speed_mps)


# --- what accelerations and a firmware's loops change -------------------------------------------


@pytest.mark.parametrize(("loops", "own"), [(OURS, True), (THEIRS_WITH_RUDDER, False), (THEIRS, 0)])
def test_a_firmware_s_loops_are_flown_without_the_gains_of_accelerations(
    loops: int, own: bool
) -> None:
    found = laws_of({"RHO_P_IMU": 0.9}, loops=loops)
    assert found.loops == loops
    assert (found.soaring_imu != found.soaring) == own


def test_without_gains_of_their_own_those_with_accelerations_are_the_plain_ones() -> None:
    found = laws_with()
    assert found.soaring_imu == found.soaring
    assert found.pitch_imu == found.pitch


def test_the_loop_of_pitch_has_no_filter_of_its_own_with_accelerations() -> None:
    found = laws_with(ELE_P_IMU=3.0, RHO_DF_IMU=9.0)
    assert found.pitch_imu.rate_filter_radps == found.pitch.rate_filter_radps


@pytest.mark.parametrize(
    ("name", "place"), [("ESC_AUTO", "landing.waits"), ("BEAT_AUTO", "beat.aside")]
)
def test_the_second_kind_is_more_than_the_first(name: str, place: str) -> None:
    auto = place.partition(".")[0] + ".auto"
    found = [laws_with(**{name: value}) for value in (0.0, 1.0, 2.0)]
    assert [attrgetter(auto)(each) for each in found] == [False, True, True]
    assert [attrgetter(place)(each) for each in found] == [False, False, True]


def test_only_the_second_way_to_hold_a_point_gives_way() -> None:
    for value, gives_way in ((0.0, False), (1.0, False), (2.0, True)):
        assert laws_with(TGL_HOLD=value).brake.gives_way is gives_way


SWITCHES: dict[str, Callable[[Laws], bool]] = {
    "EXC_START": lambda found: found.excitation.wanted,
    "ESC_AUTO": lambda found: found.landing.auto,
    "BEAT_START": lambda found: found.beat.asked,
    "LNC_START": lambda found: found.launch.wanted,
    "SRV_START": lambda found: found.surveys,
    "EST_IMU": lambda found: found.motion.use_imu,
    "TGL_HOLD": lambda found: found.brake.wanted,
}


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_turns_its_own_law_alone(name: str) -> None:
    for value in (0.0, 1.0):
        found = laws_with(**{name: value})
        assert {each: SWITCHES[each](found) for each in SWITCHES} == {
            each: (value if each == name else PLAIN[each]) != 0.0 for each in SWITCHES
        }


def test_how_the_search_stands_keeps_its_numbers() -> None:
    """SRCH_START is shown to operators and kept in logs (docs/search.md)."""
    names = ("OFF", "LOOKS", "SOARS", "GIVEN_UP", "NONE")
    assert [getattr(laws, f"SEARCH_{name}") for name in names] == list(range(len(names)))


# --- the way home -------------------------------------------------------------------------------


def bearings(wind_from_deg: float, **changes: float) -> landing.LandingParams:
    frame = SoaringFrame(0.0, 0.0, 0.0, radians(wind_from_deg))
    return laws_from(PLAIN.changed({"LND_LEN": 20.0, **changes}), frame).landing


def test_bearings_are_counted_from_upwind_the_short_way_round() -> None:
    """From north on the compass; a wind from 350 degrees, a runway of 10: twenty to the right."""
    home = bearings(350.0, LND_BEAR=10.0, ESC_BEAR=-30.0)
    assert home.place.bearing_rad == pytest.approx(radians(20.0), abs=1e-6)
    assert home.escape_rad == pytest.approx(radians(-20.0), abs=1e-6)


@pytest.mark.parametrize(
    ("approach_deg", "escape_deg", "known"),
    [
        (60.0, 60.0, True),
        (-60.0, -60.0, True),
        (60.1, 0.0, False),
        (-60.1, 0.0, False),
        (0.0, 60.1, False),
        (0.0, -60.1, False),
    ],
)
def test_bearings_of_more_than_60_degrees_from_upwind_leave_no_place_known(
    approach_deg: float, escape_deg: float, known: bool
) -> None:
    home = bearings(0.0, LND_BEAR=approach_deg, ESC_BEAR=escape_deg)
    assert home.place.length_m == (20.0 if known else 0.0)


def test_the_best_glide_that_is_not_known_is_a_little_faster_than_the_least_speed() -> None:
    """1 m/s, from which on all of the elevator may be used: 0.05 rad at 0.05 rad for each m/s."""
    assert laws_with(SPEED_MIN=5.0).landing.best_glide_mps == pytest.approx(6.0)
    assert laws_with(SPEED_MIN=5.0, DYN_BEST=9.0).landing.best_glide_mps == pytest.approx(9.0)


@pytest.mark.parametrize(("width_m", "half_m"), [(20.0, 20.0), (39.0, 39.0), (45.0, 40.0)])
def test_it_turns_at_eight_tenths_of_the_fence_at_the_latest(width_m: float, half_m: float) -> None:
    """docs/parameters.md, BEAT_WIDTH."""
    found = laws_with(FENCE_Y_MAX=50.0, BEAT_WIDTH=width_m)
    assert found.beat.half_width_m == pytest.approx(half_m)


def test_the_fence_has_the_sides_that_are_given() -> None:
    sides = {"X_MIN": -11.0, "X_MAX": 12.0, "Y_MAX": 13.0, "Z_MIN": -4.0, "Z_MAX": 15.0}
    values = PLAIN.changed({f"FENCE_{name}": value for name, value in sides.items()})
    assert fence_of(values)._asdict() == {f"{k.lower()}_m": v for k, v in sides.items()}


# --- what the schedules are given ---------------------------------------------------------------


@pytest.mark.parametrize(("rate_hz", "longer_s"), [(250.0, 0.0), (200.0, 0.0), (100.0, 0.0025)])
def test_a_slower_loop_is_later_by_half_of_what_its_tick_is_longer_than_5_ms(
    rate_hz: float, longer_s: float
) -> None:
    values = PLAIN.changed({"DYN_SERVO": 0.03, "CMD_DELAY": 0.01, "LOOP_RATE": rate_hz})
    assert late_by_s(values) == pytest.approx(0.04 + longer_s)


def test_the_airframe_is_reported_as_its_parameters_have_it() -> None:
    names = {
        "DYN_SPEED": "speed_mps",
        "DYN_FREQ": "short_period_radps",
        "DYN_DAMP": "damping",
        "DYN_EFFECT": "effect_radps2",
        "DYN_GLIDE": "glide_ratio",
        "DYN_BEST": "best_glide_mps",
        "DYN_PATH": "path_s",
    }
    given = {name: 1.5 + 0.01 * i for i, name in enumerate(names)}
    found = dynamics_of(PLAIN.changed(given))
    assert {name: getattr(found, field) for name, field in names.items()} == pytest.approx(given)


@pytest.mark.parametrize(("lag_s", "counted_s"), [(0.01, 0.01), (0.02, 0.02), (0.05, 0.02)])
def test_a_servo_lags_by_no_more_than_it_is_late(lag_s: float, counted_s: float) -> None:
    values = PLAIN.changed({"DYN_SERVO": 0.02, "DYN_LAG": lag_s})
    assert dynamics_of(values).lag_s == pytest.approx(counted_s)


FOUND = {
    "RHO_SPEED": 8.0, "RHO_LEAN": 20.0, "ELE_FREQ": 10.0, "ELE_DAMP": 0.7, "ELE_EFFECT": 30.0,
    "ELE_LATE": 0.03, "ELE_LAG": 0.02,
}  # fmt: skip
SAME = {
    "DYN_SPEED": 8.0, "DYN_FREQ": 10.0, "DYN_DAMP": 0.7, "DYN_EFFECT": 30.0, "DYN_SERVO": 0.03,
    "DYN_LAG": 0.02, "CMD_DELAY": 0.0,
}  # fmt: skip


def test_gains_are_flown_as_they_stand_on_the_airframe_that_they_were_found_on() -> None:
    found = laws_with(**FOUND, **SAME).schedule
    assert (found.speed_mps, found.lean_rad) == pytest.approx((8.0, radians(20.0)))
    assert found.late_s == pytest.approx(found.late_found_s)
    factors = (found.stiffness, found.damping, found.bandwidth, found.bandwidth_imu)
    assert factors == pytest.approx((1.0,) * len(factors))


@pytest.mark.parametrize(
    ("name", "value"),
    [("DYN_EFFECT", 60.0), ("DYN_SERVO", 0.06), ("DYN_DAMP", 0.5), ("DYN_FREQ", 8.0)],
)
def test_another_airframe_is_flown_with_other_gains(name: str, value: float) -> None:
    """Twice the effect with half the gains; a later servo or less damping with less than before."""
    found = laws_with(**FOUND, **{**SAME, name: value}).schedule
    assert found.stiffness < 0.9
    if name == "DYN_EFFECT":
        assert found.stiffness == pytest.approx(0.5)


def test_surfaces_that_are_later_than_found_slow_roll_and_heading() -> None:
    late = {"DYN_SERVO": 0.03, "CMD_DELAY": 0.01}
    found = laws_with(**late, LAT_LATE=0.02).lateral_schedule
    assert found.late_s - found.late_found_s == pytest.approx(0.04 - 0.02)
    unknown = laws_with(**late, LAT_LATE=0.0).lateral_schedule
    assert unknown.late_found_s == pytest.approx(unknown.late_s)


# --- what the airframe gives --------------------------------------------------------------------

PLANE = NO_AERODYNAMICS._replace(
    mass_kg=0.8, gravity_mps2=9.8, air_density_kgpm3=1.2, wing_area_m2=0.2, CL_alpha=4.0,
    Cm_alpha=-0.6, Cm_elevator=0.5, CL_brake=-0.2, CD_brake=0.05, Cm_brake=0.05, brake_throw=0.4,
    propeller_thrust_n=4.0, propeller_speed_mps=18.0, propeller_lag_s=0.1,
)  # fmt: skip


def test_the_airframe_s_numbers_go_where_the_air_is_read_and_home_is_sought() -> None:
    polar = PLANE.polar._replace(c0=1.0, speed_min_mps=6.0)
    ground = NO_GROUND._replace()
    found = laws_from(PLAIN, FRAME, PLANE._replace(polar=polar), ground)
    assert found.frame is FRAME
    assert found.ground is ground
    assert found.wind.aerodynamics.mass_kg == PLANE.mass_kg
    assert found.forecast.polar is polar
    assert found.landing.polar is polar
    assert found.envelope.brake_throw == PLANE.brake_throw


def test_the_brake_is_balanced_by_incidence_and_elevator() -> None:
    """All of it takes lift, which a larger incidence restores, and its moment and that of the
    incidence are the elevator's."""
    brake = laws_of({}, PLANE).brake
    assert brake.available
    assert PLANE.CL_alpha * brake.lift_rad + PLANE.CL_brake == pytest.approx(0.0)
    moment = PLANE.Cm_brake + PLANE.Cm_alpha * brake.lift_rad + PLANE.Cm_elevator * brake.elevator
    assert moment == pytest.approx(0.0, abs=1e-12)
    assert brake.lift_rad > 0.0
    # Its drag at 10 m/s, by the weight, is what it adds to the glide's slope.
    speed = 10.0
    drag_n = 0.5 * 1.2 * speed**2 * 0.2 * PLANE.CD_brake
    assert brake.sink * speed**3 == pytest.approx(speed * drag_n / (0.8 * 9.8))


@pytest.mark.parametrize(
    ("aero", "loops"),
    [(PLANE, THEIRS), (PLANE, THEIRS_WITH_RUDDER), (PLANE._replace(CD_brake=0.0), OURS)],
)
def test_there_is_no_brake_without_drag_or_without_our_loops(
    aero: Aerodynamics, loops: int
) -> None:
    brake = laws_of({}, aero, loops).brake
    assert not brake.available
    assert (brake.sink, brake.lift_rad, brake.elevator) == (0.0, 0.0, 0.0)


def test_a_propeller_has_its_budget_and_its_thrust_by_the_mass() -> None:
    throttle = laws_of({"THR_BUDGET": 30.0, "THR_MAX": 0.8}, PLANE).throttle
    weak = laws_of({"THR_BUDGET": 30.0}, PLANE._replace(propeller_thrust_n=0.4)).throttle
    assert (weak.budget_s, weak.thrust_mps2) == pytest.approx((30.0, 0.5))
    assert throttle._asdict() == pytest.approx(
        {"budget_s": 30.0, "most": 0.8, "thrust_mps2": 4.0 / 0.8, "speed_mps": 18.0, "lag_s": 0.1}
    )


@pytest.mark.parametrize(
    ("aero", "loops"),
    [(PLANE, THEIRS), (PLANE, THEIRS_WITH_RUDDER), (PLANE._replace(propeller_thrust_n=0.0), OURS)],
)
def test_there_is_no_budget_where_nothing_would_turn(aero: Aerodynamics, loops: int) -> None:
    throttle = laws_of({"THR_BUDGET": 30.0}, aero, loops).throttle
    assert (throttle.budget_s, throttle.thrust_mps2) == (0.0, 0.0)

"""Tables of airframe and site files: what a key is where it is left out, and its range.

Each bound is tried on both sides, by the number as a person writes it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import inf, pi
from typing import Any

import msgspec
import pytest

from tgl_soar.config import airframe as of_airframe
from tgl_soar.config import site as of_site
from tgl_soar.config.dynamics import MeasuredDynamics
from tgl_soar.types import GROUND_POINTS

LARGEST = 1e6
JET = {"kind": "jet", "wind_mps": 8.5, "slope_deg": 23.0}
HILL = {"kind": "hill", "wind_mps": 7.0, "radius_m": 8.0}
GRID = {"kind": "grid", "file": "f.csv", "wind_mps": 7.0}
POLYNOMIAL = {"kind": "polynomial", "of": JET, "degree": 3, "x_m": [0.0, 1.0], "z_m": [0.0, 1.0]}
STRIP = {"x_m": 0, "z_m": 0, "bearing_deg": 270, "length_m": 20, "away_x_m": -10}
MOCAP = {"server": "discover", "body": 1}
BENCH = {
    "name": "test", "mass_kg": 0.7, "wing_area_m2": 0.18, "span_m": 1.1, "chord_m": 0.16,
    "ixx_kgm2": 0.01, "iyy_kgm2": 0.01, "izz_kgm2": 0.02,
}  # fmt: skip
POLAR = {"c0": 9, "c1": -2, "c2": 0.12, "c3": 0, "speed_min_mps": 7.5, "speed_max_mps": 12}

# Of each table: the least that it takes.
LEAST: dict[type[Any], dict[str, Any]] = {
    of_site.Line: {"x_m": 0, "z_m": 0},
    of_site.SiteOrigin: {"name": "here"},
    of_site.TurbulenceSettings: {},
    of_site.JetAir: JET,
    of_site.HillAir: HILL,
    of_site.GridLayout: {},
    of_site.GridAir: GRID,
    of_site.PolynomialAir: POLYNOMIAL,
    of_site.Start: {"x_m": 0, "z_m": 0},
    of_site.LandingStrip: STRIP,
    of_site.Tether: {"x_m": 0, "z_m": 0, "length_m": 10},
    of_site.HomePosition: {"latitude_deg": 0, "longitude_deg": 0, "altitude_m": 0},
    of_site.Sender: {"system": 1, "component": 1},
    of_site.PositionSettings: {},
    of_site.Forward: {},
    of_site.Mocap: MOCAP,
    of_airframe.Surface: {"channel": 1},
    of_airframe.Throttle: {"channel": 1},
    of_airframe.Mixing: {"brake_throw": 0.5},
    of_airframe.AutopilotLink: {"firmware": "bridge"},
    of_airframe.AirframeMetadata: BENCH,
    of_airframe.Polar: POLAR,
    MeasuredDynamics: {},
}

DEFAULTS: dict[type[Any], dict[str, Any]] = {
    of_site.Line: {"lean_deg": None},
    of_site.SiteOrigin: {
        "origin_north_m": 0.0, "origin_east_m": 0.0, "origin_down_m": 0.0, "wind_from_deg": 0.0,
        "ridge_deg": None,
    },
    of_site.TurbulenceSettings: {"intensity": 0.0, "length_scale_m": 1.5, "roll_gusts": True},
    of_site.HillAir: {"record": None},
    of_site.GridLayout: {
        "x": "x", "z": "z", "u": "u", "w": "w", "y": None, "v": None, "x_sign": 1, "u_sign": 1,
        "y_sign": 1, "v_sign": 1, "origin_x_m": 0.0, "origin_y_m": 0.0, "origin_z_m": 0.0,
        "metres_per_length": 1.0, "mps_per_speed": 1.0,
    },
    of_site.GridAir: {"zero_cells": "refuse", "mesh_step_m": None, "record": None},
    of_site.PolynomialAir: {"step_m": 0.05},
    of_site.Start: {"y_m": 0.0},
    of_site.LandingStrip: {"y_m": 0.0, "escape_deg": None},
    of_site.Tether: {"y_m": 0.0, "stiffness_npm": 140.0},
    of_site.PositionSettings: {
        "sources": ["local_position", "odometry"], "silence_s": 0.15, "return_s": 2.0,
        "home": None, "vision_from": [],
    },
    of_site.Forward: {
        "message": "vision_position_estimate", "rate_hz": 40.0, "sigma_m": None, "sigma_deg": 1.0,
    },
    of_site.Mocap: {
        "stream": "multicast", "interface": "", "group": "239.255.42.99", "command_port": 1510,
        "data_port": 1511, "up": "y", "yaw_deg": 0.0, "offset_m": (0.0, 0.0, 0.0),
        "noise_m": 0.001, "max_error_m": 0.02, "max_speed_mps": 25.0, "max_age_s": 0.3,
        "max_rate_hz": 200.0, "attitude": False,
    },
    of_airframe.Surface: {
        "pwm_min": 1100, "pwm_trim": 1500, "pwm_max": 1900, "reversed": False,
    },
    of_airframe.Throttle: {"pwm_min": 1000, "pwm_max": 2000},
    of_airframe.Mixing: {"brake": "up"},
    of_airframe.AutopilotLink: {
        "route": None, "system_id": 1, "component_id": 191, "override_system_id": 255,
        "operators": frozenset((245, 250, 251, 252, 253, 254, 255)), "imu": "usual",
        "rangefinder": False,
    },
}  # fmt: skip

# Of each key: least and most that it takes.  A key of which only more than nothing is taken has
# a least number that is tiny.
TINY = 1e-12
FINITE, POSITIVE, MEASURED = (-LARGEST, LARGEST), (TINY, LARGEST), (1e-9, LARGEST)
RANGES: dict[type[Any], dict[str, tuple[float, float]]] = {
    of_site.Line: {"x_m": FINITE, "z_m": FINITE, "lean_deg": (-60, 60)},
    of_site.SiteOrigin: {
        "origin_north_m": FINITE, "origin_east_m": FINITE, "origin_down_m": FINITE,
        "wind_from_deg": (-360, 360), "ridge_deg": (-360, 360),
    },
    of_site.TurbulenceSettings: {"intensity": (0, 0.5), "length_scale_m": POSITIVE},
    of_site.JetAir: {"wind_mps": (5, 15), "slope_deg": (15, 35)},
    of_site.HillAir: {"wind_mps": (1, 30), "radius_m": POSITIVE},
    of_site.GridLayout: {
        "origin_x_m": FINITE, "origin_y_m": FINITE, "origin_z_m": FINITE,
        "metres_per_length": POSITIVE, "mps_per_speed": POSITIVE,
    },
    of_site.GridAir: {"wind_mps": POSITIVE, "mesh_step_m": POSITIVE},
    of_site.PolynomialAir: {"degree": (1, 12), "step_m": (0.001, 1000)},
    of_site.Start: {"x_m": FINITE, "y_m": FINITE, "z_m": FINITE},
    of_site.LandingStrip: {
        "x_m": FINITE, "y_m": FINITE, "z_m": FINITE, "bearing_deg": (-360, 360),
        "length_m": (TINY, 500), "away_x_m": FINITE, "escape_deg": (-360, 360),
    },
    of_site.Tether: {
        "x_m": FINITE, "y_m": FINITE, "z_m": FINITE, "length_m": (TINY, 1000),
        "stiffness_npm": (1, 1000),
    },
    of_site.HomePosition: {
        "latitude_deg": (-90, 90), "longitude_deg": (-180, 180), "altitude_m": (-500, 9000),
    },
    of_site.Sender: {"system": (1, 255), "component": (1, 255)},
    of_site.PositionSettings: {"silence_s": (0.02, 2), "return_s": (0, 60)},
    of_site.Forward: {"rate_hz": (5, 100), "sigma_m": (1e-4, 10), "sigma_deg": (0.01, 45)},
    of_site.Mocap: {
        "body": (0, 2**31 - 1), "command_port": (1, 65535), "data_port": (1, 65535),
        "yaw_deg": (-360, 360), "noise_m": (1e-5, 1), "max_error_m": (TINY, 1),
        "max_speed_mps": (1, 100), "max_age_s": (0.01, 1), "max_rate_hz": (10, 1000),
    },
    of_airframe.Surface: {"channel": (1, 18), "pwm_min": (800, 1499), "pwm_max": (1501, 2200),
                          "pwm_trim": (1101, 1899)},
    of_airframe.Throttle: {"channel": (1, 18), "pwm_min": (800, 1999), "pwm_max": (1001, 2200)},
    of_airframe.Mixing: {"brake_throw": (0.05, 1.0)},
    of_airframe.AutopilotLink: {
        "system_id": (1, 255), "component_id": (2, 255), "override_system_id": (1, 255),
    },
    of_airframe.AirframeMetadata: {
        "mass_kg": (0.02, 100), "wing_area_m2": (0.001, 50), "span_m": (0.1, 20),
        "chord_m": (0.01, 5), "ixx_kgm2": (1e-6, 1e4), "iyy_kgm2": (1e-6, 1e4),
        "izz_kgm2": (1e-6, 1e4),
    },
    of_airframe.Polar: {
        "speed_min_mps": (1e-9, 11.999999), "speed_max_mps": (7.500001, LARGEST),
    },
}  # fmt: skip
KEYS = [(kind, key) for kind, keys in RANGES.items() for key in keys]


def made(kind: type[Any], changed: Mapping[str, Any]) -> Any:
    return msgspec.convert({**LEAST[kind], **changed}, kind)


@pytest.mark.parametrize("kind", LEAST, ids=lambda kind: kind.__name__)
def test_the_least_of_a_table_is_taken_and_nothing_unknown(kind: type[Any]) -> None:
    made(kind, {})
    with pytest.raises(msgspec.ValidationError, match="unknown field `no_such`"):
        made(kind, {"no_such": 1})
    for key, value in DEFAULTS.get(kind, {}).items():
        assert getattr(made(kind, {}), key) == value, key


@pytest.mark.parametrize(("kind", "key"), KEYS, ids=lambda each: getattr(each, "__name__", each))
def test_a_number_is_taken_from_its_least_to_its_most_and_no_other(
    kind: type[Any], key: str
) -> None:
    low, high = RANGES[kind][key]
    whole = isinstance(low, int) and isinstance(high, int) and key in (
        *("degree", "system", "component", "body", "command_port", "data_port", "channel"),
        *("pwm_min", "pwm_trim", "pwm_max", "system_id", "component_id", "override_system_id"),
    )  # fmt: skip
    for value in (low, high):
        assert getattr(made(kind, {key: value}), key) == value
    below: float = 0.0 if low == TINY else low - 1 if whole else low - 1e-6 * max(1.0, abs(low))
    above = high + 1 if whole else high + 1e-6 * max(1.0, abs(high))
    if low == 1e-9:
        below = 0.9e-9
    for value in (below, above, -inf, inf):
        with pytest.raises((msgspec.ValidationError, ValueError)):
            made(kind, {key: value})


@pytest.mark.parametrize("key", ["c0", "c1", "c2", "c3"])
@pytest.mark.parametrize("at_mps", [7.5, 12.0])
def test_a_polar_sinks_at_every_speed_that_it_has(key: str, at_mps: float) -> None:
    """One that climbs at its least or its fastest speed has an updraft of its own everywhere."""
    power = int(key[1])
    sink = sum(POLAR[f"c{k}"] * at_mps**k for k in range(4))
    level = POLAR[key] - sink / at_mps**power
    with pytest.raises((msgspec.ValidationError, ValueError), match="c0, c1, c2, c3: a sink of -"):
        made(of_airframe.Polar, {key: level - 1e-9})
    flat = {"c0": 1.0, "c1": 0.0, "c2": 0.0, "c3": 0.0}
    assert made(of_airframe.Polar, {**flat, key: 1.0}).as_polar()[power] == 1.0
    for number in (-inf, inf):
        with pytest.raises((msgspec.ValidationError, ValueError)):
            made(of_airframe.Polar, {key: number})


def test_a_polar_that_climbs_between_its_ends_is_refused_and_says_where() -> None:
    between = {"c0": 9.5, "c1": -2.0, "c2": 0.1}  # 0.1 (v - 10)² - 0.5
    with pytest.raises((msgspec.ValidationError, ValueError), match=r"of -0\.5 m/s at 10 m/s"):
        made(of_airframe.Polar, {**between, "speed_min_mps": 7.0, "speed_max_mps": 13.0})


def test_a_turbulent_air_is_calm_where_nothing_is_said() -> None:
    calm = of_site.TurbulenceSettings()
    for kind in (of_site.JetAir, of_site.HillAir, of_site.GridAir, of_site.PolynomialAir):
        assert made(kind, {}).turbulence == calm
    assert made(of_site.GridAir, {}).layout == of_site.GridLayout()


@pytest.mark.parametrize("name", ["x_m", "z_m"])
@pytest.mark.parametrize("ends", [[1.0, 1.0], [1.0, 0.5]])
def test_the_box_of_a_polynomial_grows(name: str, ends: list[float]) -> None:
    with pytest.raises((msgspec.ValidationError, ValueError), match=f"{name} = .*growing"):
        made(of_site.PolynomialAir, {name: ends})


def test_a_polynomial_follows_a_calm_and_steady_air() -> None:
    turbulent = {**JET, "turbulence": {"intensity": 0.1}}
    with pytest.raises((msgspec.ValidationError, ValueError), match=r"of\.turbulence"):
        made(of_site.PolynomialAir, {"of": turbulent})
    for air in ({**HILL, "record": "w.csv"}, {**GRID, "record": "w.csv"}):
        with pytest.raises((msgspec.ValidationError, ValueError), match=r"of\.record"):
            made(of_site.PolynomialAir, {"of": air})
    assert made(of_site.PolynomialAir, {"of": HILL}).wind_mps == 7.0
    assert made(of_site.PolynomialAir, {}).wind_mps == 8.5


@pytest.mark.parametrize("count", [1, GROUND_POINTS])
def test_a_ground_has_one_to_eight_points_that_grow_in_x(count: int) -> None:
    points = [[float(i), 10.0 + i] for i in range(count)]
    ground = msgspec.convert({"profile": points}, of_site.GroundProfile).as_ground()
    assert ground.points == count
    xs = [float(min(i, count - 1)) for i in range(GROUND_POINTS)]
    assert ground.x_m == tuple(xs)
    assert ground.z_m == tuple(10.0 + x for x in xs)
    for wrong in ([], [[float(i), 0.0] for i in range(GROUND_POINTS + 1)], [[0.0, 0.0]] * 2,
                  [[1.0, 0.0], [0.0, 0.0]]):  # fmt: skip
        with pytest.raises((msgspec.ValidationError, ValueError)):
            msgspec.convert({"profile": wrong}, of_site.GroundProfile)


@pytest.mark.parametrize(("count", "good"), [(0, False), (1, False), (2, True)])
def test_a_part_of_a_contour_has_two_points(count: int, good: bool) -> None:
    table = {"airframe": "a", "parts": [[[0.0, 0.0]] * count]}
    if good:
        msgspec.convert(table, of_site.KnownContour)
    else:
        with pytest.raises((msgspec.ValidationError, ValueError), match="two points or more"):
            msgspec.convert(table, of_site.KnownContour)


# --- where the site looks to -------------------------------------------------------------------


@pytest.mark.parametrize(("wind", "ridge", "facing", "oblique"), [
    (270.0, None, 270.0, 0.0), (270.0, 0.0, 270.0, 0.0), (270.0, 180.0, 270.0, 0.0),
    (310.0, 0.0, 270.0, 40.0), (230.0, 0.0, 270.0, -40.0), (90.0, 0.0, 90.0, 0.0),
    (10.0, 300.0, 30.0, -20.0), (350.0, 90.0, 0.0, -10.0), (-90.0, 0.0, 270.0, 0.0),
])  # fmt: skip
def test_a_ridge_is_faced_straight_and_the_wind_comes_from_beside(
    wind: float, ridge: float | None, facing: float, oblique: float
) -> None:
    origin = made(of_site.SiteOrigin, {"wind_from_deg": wind, "ridge_deg": ridge})
    assert origin.facing_deg() == pytest.approx(facing)
    assert origin.oblique_deg() == pytest.approx(oblique)


def site(**tables: Any) -> of_site.Site:
    return msgspec.convert({"site": {"name": "here", "wind_from_deg": 270.0}, **tables},
                           of_site.Site)  # fmt: skip


@pytest.mark.parametrize(("wind", "good"), [(225.0, True), (224.9, False), (315.0, True),
                                            (315.1, False)])  # fmt: skip
def test_a_wind_along_the_ridge_is_refused(wind: float, good: bool) -> None:
    table = {"name": "here", "wind_from_deg": wind, "ridge_deg": 0.0}
    if good:
        site(site=table)
        site(site=table, air=HILL)
    else:
        with pytest.raises((msgspec.ValidationError, ValueError), match="at most 45 deg"):
            site(site=table)


@pytest.mark.parametrize("air", [JET, POLYNOMIAL])
def test_a_jet_has_no_ridge(air: dict[str, Any]) -> None:
    site(air=air)
    table = {"name": "here", "wind_from_deg": 270.0, "ridge_deg": 0.0}
    with pytest.raises((msgspec.ValidationError, ValueError), match="a jet has no ridge"):
        site(site=table, air=air)


@pytest.mark.parametrize("key", ["bearing_deg", "escape_deg"])
@pytest.mark.parametrize(("bearing", "good"), [
    (270.0, True), (210.0, True), (209.9, False), (330.0, True), (330.1, False), (-30.0, True),
])  # fmt: skip
def test_one_lands_and_escapes_upwind(key: str, bearing: float, good: bool) -> None:
    if good:
        site(landing={**STRIP, key: bearing})
    else:
        with pytest.raises((msgspec.ValidationError, ValueError), match=key):
            site(landing={**STRIP, key: bearing})


@pytest.mark.parametrize(("length", "good"), [(3.0, True), (2.99, False)])
def test_a_tether_reaches_the_start(length: float, good: bool) -> None:
    """1, 2 and 2 m apart: 3 m."""
    tables = {"start": {"x_m": 1.0, "z_m": 2.0, "y_m": 2.0},
              "tether": {"x_m": 0.0, "z_m": 0.0, "length_m": length}}  # fmt: skip
    if good:
        site(**tables)
        return
    with pytest.raises((msgspec.ValidationError, ValueError), match=r"must reach .*3\.00 m"):
        site(**tables)


def test_where_a_strip_gives_no_way_of_escape_it_is_the_approach() -> None:
    strip = made(of_site.LandingStrip, {"y_m": 3.0, "x_m": 1.0, "z_m": 2.0})
    assert strip.parameters() == {
        "LND_X": 1.0, "LND_Y": 3.0, "LND_Z": 2.0, "LND_BEAR": 270.0, "LND_LEN": 20.0,
        "ESC_BEAR": 270.0, "ESC_X": -10.0,
    }  # fmt: skip
    away = made(of_site.LandingStrip, {"escape_deg": 250.0})
    assert away.parameters()["ESC_BEAR"] == 250.0
    assert away.keys()["ESC_BEAR"] == "escape_deg"


def test_a_halls_axes_are_in_radians_and_local_ned() -> None:
    hall = made(of_site.Mocap, {"yaw_deg": 90.0, "offset_m": [1, 2, 3], "up": "z"}).hall()
    assert hall.yaw_rad == pytest.approx(pi / 2.0)
    assert (hall.origin_north_m, hall.origin_east_m, hall.origin_down_m) == (1.0, 2.0, 3.0)
    assert hall.z_up
    assert not made(of_site.Mocap, {}).hall().z_up


@pytest.mark.parametrize(("key", "value", "good"), [
    ("group", "224.0.0.0", True), ("group", "239.255.255.255", True), ("group", "223.0.0.1", False),
    ("group", "240.0.0.0", False), ("group", "hall", False), ("interface", "10.0.0.2", True),
    ("interface", "hall", False), ("server", "", False), ("body", "", False), ("body", "b", True),
])  # fmt: skip
def test_addresses_of_a_hall(key: str, value: str, good: bool) -> None:
    if good:
        made(of_site.Mocap, {key: value})
    else:
        with pytest.raises((msgspec.ValidationError, ValueError), match=key):
            made(of_site.Mocap, {key: value})


# --- the airframe ------------------------------------------------------------------------------


def airframe(**tables: Any) -> of_airframe.Airframe:
    least = {
        "airframe": BENCH, "autopilot": {"firmware": "bridge"}, "polar": POLAR,
        "surfaces": {"elevator": {"channel": 2}, "aileron": {"channel": 1},
                     "rudder": {"channel": 4}},
    }  # fmt: skip
    return msgspec.convert({**least, **tables}, of_airframe.Airframe)


@pytest.mark.parametrize(("ends", "good"), [
    ((1100, 1101, 1102), True), ((1100, 1100, 1200), False), ((1100, 1200, 1200), False),
])  # fmt: skip
def test_pulses_grow_from_end_to_end(ends: tuple[int, int, int], good: bool) -> None:
    table = dict(zip(("pwm_min", "pwm_trim", "pwm_max"), ends, strict=True))
    if good:
        made(of_airframe.Surface, table)
    else:
        with pytest.raises((msgspec.ValidationError, ValueError), match="must hold"):
            made(of_airframe.Surface, table)


@pytest.mark.parametrize("key", ["gravity_mps2", "CD0", "Cl_aileron", "Cm_elevator", "Cn_rudder",
                                 "stall_alpha_rad", "stall_width_rad"])  # fmt: skip
@pytest.mark.parametrize(("value", "good"), [(1e-3, True), (0.0, False), (-1.0, False)])
def test_what_of_the_model_is_divided_by_is_above_zero(key: str, value: float, good: bool) -> None:
    if good:
        airframe(model={key: value})
    else:
        with pytest.raises((msgspec.ValidationError, ValueError), match=f"{key} = .*above 0"):
            airframe(model={key: value})


@pytest.mark.parametrize("key", ["stall_alpha_negative_rad", "Cm_alpha", "Cm_q", "Cl_p", "Cn_r"])
@pytest.mark.parametrize(("value", "good"), [(-1e-3, True), (0.0, False), (0.56, False)])
def test_what_turns_an_aircraft_over_is_below_zero(key: str, value: float, good: bool) -> None:
    if good:
        assert airframe(model={key: value}).model[key] == value
    else:
        with pytest.raises(msgspec.ValidationError, match=rf"model\.{key} = {value:g}: .*below 0"):
            airframe(model={key: value})


@pytest.mark.parametrize(("key", "low", "high"), [
    ("air_density_kgpm3", 0.3, 1.6), ("servo_lag_radps", 3.4, 1e4), ("CD0", 1e-6, 0.5),
    ("servo_delay_s", 0.0, 0.3),
])  # fmt: skip
def test_what_has_units_has_a_range(key: str, low: float, high: float) -> None:
    for value in (low, high):
        assert airframe(model={key: value}).model == {key: value}
    for value in (low - 1e-6, 1.001 * high):
        with pytest.raises(msgspec.ValidationError, match=rf"model\.{key} = .*: must be "):
            airframe(model={key: value})


def test_a_servo_s_delay_and_lag_are_not_too_much_together() -> None:
    airframe(model={"servo_delay_s": 0.1, "servo_lag_radps": 5.0001})
    with pytest.raises(
        msgspec.ValidationError,
        match=re.escape(
            "model.servo_delay_s = 0.11: must be up to 0.3 s, together with 1 / servo_lag_radps"
            " = 0.2 s"
        ),
    ):
        airframe(model={"servo_delay_s": 0.11, "servo_lag_radps": 5.0})


@pytest.mark.parametrize("slope", [0.5, 0.8, 5.5, 8.0])
def test_lift_s_slope_is_per_radian(slope: float) -> None:
    assert airframe(model={"CL_alpha": slope}).model == {"CL_alpha": slope}


@pytest.mark.parametrize("slope", [-4.6, 0.0, 0.08, 0.11, 0.499, 8.01, 260.0])
def test_another_slope_of_lift_is_refused(slope: float) -> None:
    with pytest.raises(
        msgspec.ValidationError,
        match=rf"model\.CL_alpha = {slope:g}: must be from 0\.5 to 8 \(per radian\)",
    ):
        airframe(model={"CL_alpha": slope})


@pytest.mark.parametrize("key", ["stall_alpha_rad", "stall_width_rad"])
@pytest.mark.parametrize(("value", "good"), [(0.8, True), (0.801, False), (12.0, False)])
def test_a_stall_is_in_radians(key: str, value: float, good: bool) -> None:
    if good:
        assert airframe(model={key: value}).model[key] == value
    else:
        with pytest.raises(msgspec.ValidationError, match=rf"model\.{key} = .*above 0, up to 0\.8"):
            airframe(model={key: value})


@pytest.mark.parametrize(
    ("key", "low", "high", "by"),
    [  # a rectangle of 1.1 m by 0.16 m; 0.7 kg at 2 % and at all of 1.1 m
        ("wing_area_m2", 0.0704, 0.352, "by span_m = 1.1 and chord_m = 0.16"),
        ("ixx_kgm2", 3.388e-4, 0.847, "by mass_kg = 0.7 and span_m = 1.1"),
        ("iyy_kgm2", 3.388e-4, 0.847, "by mass_kg = 0.7 and span_m = 1.1"),
        ("izz_kgm2", 3.388e-4, 0.847, "by mass_kg = 0.7 and span_m = 1.1"),
    ],
)
def test_figures_of_one_aircraft_go_together(key: str, low: float, high: float, by: str) -> None:
    """Each by itself is one that some aircraft has; in square centimetres or g cm² it is not."""
    for value in (1.001 * low, 0.999 * high):
        assert getattr(airframe(airframe={**BENCH, key: value}).airframe, key) == value
    for value in (0.999 * low, 1.001 * high):
        words = rf"airframe\.{key} = .*: must be from .* to .*, {by}"
        with pytest.raises(msgspec.ValidationError, match=words):
            airframe(airframe={**BENCH, key: value})


@pytest.mark.parametrize(("key", "low", "high"), [
    ("propeller_thrust_n", 0.0, 1e4), ("propeller_speed_mps", 1.0, 200.0),
    ("propeller_lag_s", 0.0, 2.0),
])  # fmt: skip
def test_a_propellers_figures_have_their_ranges(key: str, low: float, high: float) -> None:
    both = {"propeller_thrust_n": 5.0, "propeller_speed_mps": 20.0}
    for value in (low, high):
        assert airframe(model={**both, key: value}).model[key] == value
    for value in (low - 1e-3, high + 1e-3):
        with pytest.raises((msgspec.ValidationError, ValueError), match=f"{key} = .*must be from"):
            airframe(model={**both, key: value})


@pytest.mark.parametrize(("given", "missing"), [
    ("propeller_thrust_n", "propeller_speed_mps"), ("propeller_speed_mps", "propeller_thrust_n"),
])  # fmt: skip
def test_half_a_propeller_is_refused(given: str, missing: str) -> None:
    with pytest.raises(
        (msgspec.ValidationError, ValueError), match=f"{missing}: missing, where {given} is given"
    ):
        airframe(model={given: 5.0})
    airframe(model={"propeller_lag_s": 0.1})


@pytest.mark.parametrize(("firmware", "route", "holds"), [
    ("px4", None, True), ("px4", "attitude", True), ("px4", "manual_control", False),
    ("ardupilot", None, False), ("ardupilot", "attitude", True), ("bridge", None, False),
])  # fmt: skip
def test_whose_loops_hold_the_attitude(firmware: str, route: str | None, holds: bool) -> None:
    link = made(of_airframe.AutopilotLink, {"firmware": firmware, "route": route})
    assert link.holds_attitude == holds


LEFT, RIGHT = {"channel": 5}, {"channel": 6}
THREE = {"elevator": {"channel": 2}, "rudder": {"channel": 4}}
ONE = {**THREE, "aileron": {"channel": 1}}
TWO = {**THREE, "aileron_left": LEFT, "aileron_right": RIGHT, "mixing": {"brake_throw": 0.5}}


@pytest.mark.parametrize(("table", "words"), [
    ({**THREE, "aileron_left": LEFT}, "aileron_right is missing"),
    ({**THREE, "aileron_right": RIGHT}, "aileron_left is missing"),
    (THREE, "give either aileron"), ({**TWO, "aileron": {"channel": 1}}, "give either aileron"),
    ({**ONE, "mixing": {"brake_throw": 0.5}}, "mixing belongs to"),
    ({name: value for name, value in TWO.items() if name != "mixing"}, "mixing belongs to"),
    ({**ONE, "flap": LEFT, "spoiler": RIGHT}, "one brake only"),
    ({**TWO, "flap": {"channel": 7}}, "one brake only"),
    ({**ONE, "flap": {"channel": 2}}, "two surfaces share a channel"),
    ({**ONE, "throttle": {"channel": 4}}, "throttle shares channel 4"),
])  # fmt: skip
def test_surfaces_that_cannot_be_are_refused(table: dict[str, Any], words: str) -> None:
    with pytest.raises((msgspec.ValidationError, ValueError), match=words):
        msgspec.convert(table, of_airframe.Surfaces)


@pytest.mark.parametrize(("table", "channels", "brake", "throw"), [
    (ONE, {1, 2, 4}, None, 0.0), (TWO, {2, 4, 5, 6}, 6, 0.5),
    ({**TWO, "mixing": {"brake_throw": 0.5, "brake": "down"}}, {2, 4, 5, 6}, 6, -0.5),
    ({**ONE, "flap": LEFT}, {1, 2, 4, 5}, 5, 0.0),
    ({**ONE, "spoiler": RIGHT}, {1, 2, 4, 6}, 6, 0.0),
    ({**ONE, "throttle": {"channel": 3}}, {1, 2, 3, 4}, None, 0.0),
])  # fmt: skip
def test_surfaces_that_can_be(
    table: dict[str, Any], channels: set[int], brake: int | None, throw: float
) -> None:
    found = msgspec.convert(table, of_airframe.Surfaces)
    assert found.channels() == channels
    assert (None if found.brake is None else found.brake.channel) == brake
    assert found.brake_throw == throw
    assert [each.channel for each in found.driven()][:3] == [2, found.aileron.channel, 4]
    assert len(found.driven()) == 3 + (brake is not None)


def test_every_key_of_the_model_is_known_and_no_other() -> None:
    for key in of_airframe.MODEL_KEYS:
        if not key.startswith("propeller_"):
            value = -0.5 if key in of_airframe.NEGATIVE_KEYS else 0.5
            value = {"servo_lag_radps": 50.0, "servo_delay_s": 0.05}.get(key, value)
            assert airframe(model={key: value}).model == {key: value}
    with pytest.raises((msgspec.ValidationError, ValueError), match=r"model\.CL_beta: unknown key"):
        airframe(model={"CL_beta": 0.5})
    assert len(of_airframe.MODEL_KEYS) == 38
    assert of_airframe.MODEL_OPTIONS == {"rigid-body": "rigid_body", "point-mass": "point_mass"}
    assert airframe().model_kind == "rigid_body"
    assert airframe().flown_as("point_mass").model_kind == "point_mass"
    assert airframe().flown_as(None).model_kind == "rigid_body"

"""The world's solids and fields by a site's air, the report on a lost aircraft, where and how it
is released, and what the truth of an instant is."""

from __future__ import annotations

from math import asin, atan2, cos, hypot, inf, nan, radians, sin, tan
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.polynomial import PolynomialField
from tgl_soar.config.files import ConfigError, load_airframe, load_site, shipped
from tgl_soar.config.site import GridAir, HillAir, JetAir, Start, Tether
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.aircraft import air_data
from tgl_soar.sim.glide_test import EvenAir
from tgl_soar.sim.point_mass import PointMass
from tgl_soar.sim.tether import NO_TETHER
from tgl_soar.sim.world import (
    Truth,
    World,
    _within,
    build_field,
    ground_outline,
    make_world,
    polar_misfit_text,
    wind_misfit_text,
)
from tgl_soar.types import SurfaceCommand

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
TUNNEL = load_site(shipped("sites/tunnel.toml"))
HILL = load_site(shipped("sites/hill.toml"))
POLYNOMIAL_PATH = shipped("sites/tunnel_polynomial.toml")
STILL = SurfaceCommand(0.0, 0.0, 0.0)


def jet() -> JetAir:
    assert isinstance(TUNNEL.air, JetAir)
    return TUNNEL.air


def hill() -> HillAir:
    assert isinstance(HILL.air, HillAir)
    return HILL.air


# --- solids ---------------------------------------------------------------------------------------


def test_the_board_is_a_wedge_of_its_length_and_slope() -> None:
    """2.45 m at 23 degrees: the site file's profile has 2.255 and 0.957 for its end."""
    outline = ground_outline(jet())
    assert outline is not None
    assert outline[0] == (0.0, 0.0)
    assert outline[1] == pytest.approx((2.255, 0.957), abs=0.001)
    assert outline[1][1] == pytest.approx(outline[1][0] * tan(radians(23.0)))
    assert outline[2] == pytest.approx((2.255, 0.0), abs=0.001)
    assert len(outline) == 3


def test_the_hill_is_half_a_circle_of_its_radius() -> None:
    outline = ground_outline(hill())
    assert outline is not None
    assert len(outline) == 91
    assert all(hypot(*corner) == pytest.approx(hill().radius_m) for corner in outline)
    assert outline[0] == (hill().radius_m, 0.0)
    assert outline[45] == pytest.approx((0.0, hill().radius_m))
    assert outline[90] == pytest.approx((-hill().radius_m, 0.0))


def test_the_ground_of_a_polynomial_is_that_of_the_air_it_follows() -> None:
    site = load_site(POLYNOMIAL_PATH)
    assert site.air is not None
    assert ground_outline(site.air) == ground_outline(jet())


@pytest.mark.parametrize(
    ("x", "z", "inside"),
    [(1.0, 0.2, True), (1.0, 0.9, False), (-0.1, 0.1, False), (2.3, 0.1, False), (2.2, 0.8, True)],
)
def test_a_place_is_inside_a_polygon_or_not(x: float, z: float, inside: bool) -> None:
    outline = ground_outline(jet())
    assert outline is not None
    assert _within(outline, x, z) == inside
    assert _within(list(reversed(outline)), x, z) == inside
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert [_within(square, x, 0.5) for x in (-0.1, 0.5, 1.1)] == [False, True, False]
    assert [_within(square, 0.5, z) for z in (-0.1, 0.5, 1.1)] == [False, True, False]


def world(site: Any = TUNNEL, **options: Any) -> World:
    return make_world(AIRFRAME, site, **{"turbulence": 0.0, **options})


@pytest.mark.parametrize(
    ("site", "place", "why"),
    [
        (TUNNEL, (1.0, 0.0, 0.2), "hit the board at x 1.00, y 0.00, z 0.20 m"),
        (TUNNEL, (-0.3, 0.0, -0.01), "hit the ground at x -0.30, y 0.00, z -0.01 m"),
        (TUNNEL, (0.6, 1.43, 1.2), "left the air sideways at x 0.60, y 1.43, z 1.20 m"),
        (TUNNEL, (0.6, -1.43, 1.2), "left the air sideways at x 0.60, y -1.43, z 1.20 m"),
        (TUNNEL, (9.0, 1.42, 1.2), "left the air that the field describes at x 9.00, y 1.42, z"),
        (HILL, (0.0, 0.0, 1.0), "hit the hill at x 0.00, y 0.00, z 1.00 m"),
        (HILL, (-50.0, 0.0, -0.1), "hit the ground at x -50.00"),
        (HILL, (0.0, 501.0, 30.0), "left the air sideways at x 0.00, y 501.00, z 30.00 m"),
        (HILL, (0.0, 499.0, 30.0), "left the air that the field describes"),
        (TUNNEL, (nan, 0.0, 1.0), "the simulation lost the aircraft: its place is not a number"),
        (TUNNEL, (0.0, inf, 1.0), "the simulation lost the aircraft: its place is not a number"),
        (TUNNEL, (0.0, 0.0, nan), "the simulation lost the aircraft: its place is not a number"),
    ],
)
def test_a_lost_aircraft_is_reported_by_place_and_cause(
    site: Any, place: tuple[float, float, float], why: str
) -> None:
    made = world(site)
    x, y, z = place
    assert made.why_lost(made.state._replace(x_m=x, y_m=y, z_m=z)).startswith(why)


def test_an_aircraft_that_has_crashed_stays_until_it_is_put_back() -> None:
    made = world()
    made.state = made.state._replace(x_m=1.0, z_m=0.2)
    made.step(STILL)
    assert made.crashed.startswith("hit the board")
    lies = made.state[:3]
    why = made.crashed
    for _ in range(5):
        made.step(STILL)
    assert made.state[:3] == lies
    assert made.crashed == why
    made.relaunch()
    assert TUNNEL.start is not None
    assert made.crashed == ""
    assert made.state[:3] == (TUNNEL.start.x_m, TUNNEL.start.y_m, TUNNEL.start.z_m)
    assert made.steps == 6
    fresh = world()
    assert made.state == fresh.state
    assert made.wind == fresh.wind
    made.step(STILL)
    assert made.crashed == ""


# --- release --------------------------------------------------------------------------------------


def test_it_is_released_at_rest_with_the_trim_of_the_winds_speed() -> None:
    made = world()
    u, _, w = made.field.wind_at(0.6, 0.0, 1.2, 0.0)
    assert made.trim.horizontal_mps == pytest.approx(max(u, 7.4), abs=0.3)
    assert made.state[3:6] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    pitch = asin(2.0 * made.state.qw * made.state.qy)
    stall = made.model.highest_pitch_glide().alpha_rad
    assert pitch == pytest.approx(min(made.trim.pitch_rad, stall - atan2(w, u)))
    assert made.trim_pitch_rad == made.trim.pitch_rad
    assert made.truth.elevator == pytest.approx(made.trim.elevator)
    assert (made.steps, made.time_s, made.held, made.crashed) == (0, 0.0, False, "")


def test_in_little_wind_it_has_the_slowest_trim() -> None:
    made = world(field=EvenAir(4.0))
    assert made.trim == made.model.highest_pitch_glide()


def test_where_an_updraft_would_stall_it_the_nose_is_lower() -> None:
    made = world(HILL)
    u, _, w = made.wind
    alpha = asin(2.0 * made.state.qw * made.state.qy) + atan2(w, u)
    assert alpha <= made.model.highest_pitch_glide().alpha_rad + 1e-9


@pytest.mark.parametrize("place", [(1.0, 0.2), (9.0, 1.2)])
def test_a_start_in_the_ground_or_outside_the_air_is_refused(place: tuple[float, float]) -> None:
    site = replace(TUNNEL, start=Start(*place))
    with pytest.raises(
        ConfigError,
        match=rf"start at x {place[0]:g}, y 0, z {place[1]:g} m: the wind field does not reach",
    ):
        world(site)


@pytest.mark.parametrize("table", ["air", "start"])
def test_a_site_without_air_or_start_is_refused(table: str) -> None:
    missing: dict[str, Any] = {table: None}
    with pytest.raises(ConfigError, match=rf"site open jet.*: no \[{table}\] table"):
        world(replace(TUNNEL, **missing))


def test_the_wind_may_be_another_than_the_sites_and_turbulence_too() -> None:
    other = EvenAir(6.0)
    assert make_world(AIRFRAME, TUNNEL, field=other).field is other
    calm, rough = world(), world(turbulence=0.05)
    for _ in range(50):
        calm.step(STILL)
        rough.step(STILL)
    assert calm.now.gust_mps == (0.0, 0.0, 0.0)
    assert any(rough.now.gust_mps)


def test_a_tether_is_the_sites_own() -> None:
    assert world().parts.tether == NO_TETHER
    tether = Tether(x_m=0.1, y_m=0.2, z_m=0.3, length_m=2.0, stiffness_npm=69.9)
    made = world(replace(TUNNEL, tether=tether)).parts.tether
    assert made.is_there
    assert (made.anchor_x_m, made.anchor_y_m, made.anchor_z_m) == (0.1, 0.2, 0.3)
    assert made.length_m == 2.0
    assert made.stiffness_per_s2 == pytest.approx(100.0)
    assert made.damping_per_s == pytest.approx(10.0)  # half of the critical, 2 √k/m


def test_samples_are_polled_once() -> None:
    made = world()
    polled = []
    for _ in range(20):
        made.step(STILL)
        polled.append((made.poll_attitude() is not None, made.poll_position() is not None))
        assert made.poll_attitude() is None
        assert made.poll_position() is None
    assert sum(attitude for attitude, _ in polled) == 20
    assert sum(position for _, position in polled) in (3, 4)


def test_the_truth_is_of_this_instant() -> None:
    made = world()
    q = quaternion_from_euler(0.1, -0.2, 0.3)
    made.state = made.state._replace(
        y_m=0.1, velocity_x_mps=0.5, velocity_y_mps=-0.25, velocity_z_mps=0.75,
        qw=q[0], qx=q[1], qy=q[2], qz=q[3], aileron=0.4, rudder=-0.5, brake=0.6,
    )  # fmt: skip
    truth, state = made.truth, made.state
    assert Truth._fields.index("brake") == 18
    assert truth[:7] == (0.0, 0.6, 0.1, 1.2, 0.5, -0.25, 0.75)
    assert truth[7:10] == pytest.approx((0.1, -0.2, 0.3))
    assert truth[10:13] == made.wind
    air = air_data(state, made.wind)
    assert (truth.airspeed_mps, truth.alpha_rad) == (air.airspeed_mps, air.alpha_rad)
    assert made.airspeed_mps == air.airspeed_mps
    assert truth[15:] == (state.elevator, 0.4, -0.5, 0.6)


# --- fields ---------------------------------------------------------------------------------------


def test_the_kind_of_air_is_the_kind_of_field() -> None:
    assert isinstance(build_field(jet()), SlopeJet)
    assert isinstance(build_field(hill(), HILL_FOLDER), HillField)
    assert build_field(jet()).reference_wind_mps == jet().wind_mps


HILL_FOLDER = shipped("sites/hill.toml").parent


def test_a_polynomial_says_how_far_it_is_from_the_air_it_follows() -> None:
    site = load_site(POLYNOMIAL_PATH)
    assert site.air is not None
    field = build_field(site.air, POLYNOMIAL_PATH.parent)
    assert isinstance(field, PolynomialField)
    text = wind_misfit_text(field)
    misfit = field.misfit
    assert misfit is not None
    assert text.startswith(f"wind: a polynomial of degree {field.polynomial.degree}, fitted at ")
    assert f"off by {misfit.u_rms_mps:.3f} m/s rms along the wind" in text
    assert wind_misfit_text(build_field(jet())) == ""


def test_a_point_mass_says_how_far_it_is_from_the_polar() -> None:
    assert polar_misfit_text(AIRFRAME) == ""
    text = polar_misfit_text(AIRFRAME.flown_as("point_mass"))
    assert text.startswith("point mass: its sink is off the airframe's polar by 0.0")
    assert isinstance(world_of_point_mass().model, PointMass)


def world_of_point_mass() -> World:
    return make_world(AIRFRAME.flown_as("point_mass"), TUNNEL)


def test_a_file_of_air_that_is_not_there_is_named(tmp_path: Path) -> None:
    air = GridAir(file="nowhere.csv", wind_mps=8.0)
    with pytest.raises(ConfigError, match=r"air\.file: .*nowhere\.csv"):
        build_field(air, tmp_path)


def test_an_oblique_wind_is_slower_across_the_ridge_by_its_cosine() -> None:
    straight = build_field(hill(), HILL_FOLDER)
    oblique = build_field(hill(), HILL_FOLDER, radians(30.0))
    place = (-20.0, 0.0, 15.0, 0.0)
    u, _, w = straight.wind_at(*place)
    across = oblique.wind_at(*place)
    assert across[0] == pytest.approx(u * cos(radians(30.0)))
    assert across[2] == pytest.approx(w * cos(radians(30.0)))
    assert abs(across[1]) == pytest.approx(hill().wind_mps * sin(radians(30.0)))

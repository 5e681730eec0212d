"""The text of a drafted site file: every number where it belongs, and the report on the place."""

from __future__ import annotations

import tomllib
from math import cos, radians, sin
from typing import Any

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.terrain.draft import SiteDraft
from tgl_soar.analysis.terrain.elevation import Elevation, LocalTerrain
from tgl_soar.analysis.terrain.profile import ReducedProfile
from tgl_soar.analysis.terrain.site_text import landing_place, site_text
from tgl_soar.config.files import site_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.tangent_plane import Home, TangentPlane

HOME = Home(46.5, 7.25, 812.344)


def nowhere(latitude: FloatArray, longitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    return latitude, longitude


def draft(**changes: Any) -> SiteDraft:
    elevation = Elevation("models/N46E007.hgt", np.zeros((2, 2)), nowhere, 30.0, "")
    made: dict[str, Any] = {
        "terrain": LocalTerrain(elevation, HOME),
        "frame": SoaringFrame(12.344, -6.786, -20.504, radians(250.0)),
        "ridge_deg": 155.0,
        "wind_from_deg": 250.04,
        "oblique_deg": 0.0,
        "wind_mps": 8.5,
        "x_m": np.array([-90.0, 0.0, 40.0]),
        "z_m": np.array([-30.0, 0.0, -2.0]),
        "ground": ReducedProfile([(-90.0, -30.0), (-0.5, 0.25), (40.0, -1.98)], 1.21),
        "steepest_deg": 31.4,
        "field": None,
        "bounds": (-80.0, 0.0, -25.0, 60.0),
        "half_width_m": 45.0,
        "clearance_m": 7.5,
        "lines": {"a": (-30.5, 12.25), "b": (-26.5, 15.25), "c": (-22.5, 18.25)},
        "contour": [],
        "landing": (-70.0, -28.0),
    }
    return SiteDraft(**{**made, **changes})


def table(**changes: Any) -> dict[str, Any]:
    return tomllib.loads(site_text(draft(**changes), "my hill"))


def test_the_frame_the_place_and_the_air_are_those_of_the_draft() -> None:
    found = table()
    assert found["site"] == {
        "name": "my hill",
        "origin_north_m": 12.34,
        "origin_east_m": -6.79,
        "origin_down_m": -20.5,
        "wind_from_deg": 250.0,
        "ridge_deg": 155.0,
    }
    home = {"latitude_deg": 46.5, "longitude_deg": 7.25, "altitude_m": 812.34}
    assert found["position"] == {"sources": ["global_position"], "home": home}
    air = {"kind": "grid", "file": "air.npz", "wind_mps": 8.5, "zero_cells": "solid"}
    assert found["air"] == air


def test_it_is_a_site_file() -> None:
    site = site_from(site_text(draft(oblique_deg=5.0), "my hill"), "drafted")
    assert list(site.lines) == ["a", "b", "c"]


@pytest.mark.parametrize("name", ['a "quoted" hill', "back\\slash", "Rücken"])
def test_any_name_can_be_read_back(name: str) -> None:
    assert tomllib.loads(site_text(draft(), name))["site"]["name"] == name


def test_the_flight_starts_at_the_first_line_and_the_ground_is_the_reduced_one() -> None:
    found = table()
    assert found["start"] == {"x_m": -30.5, "z_m": 12.25}
    assert found["ground"]["profile"] == [[-90.0, -30.0], [-0.5, 0.25], [40.0, -1.98]]
    assert found["lines"] == {
        "a": {"x_m": -30.5, "z_m": 12.25},
        "b": {"x_m": -26.5, "z_m": 15.25},
        "c": {"x_m": -22.5, "z_m": 18.25},
    }


def test_the_parameters_are_the_first_line_and_the_fence() -> None:
    assert table()["parameters"] == {
        "TGL_X": -30.5,
        "TGL_Z": 12.25,
        "TGL_LEAN": 15.0,
        "TGL_STEP_MAX": 10.0,  # as far as the outer lines are apart
        "WPT_X": pytest.approx(-133.3),
        "CLEAR_MIN": 7.5,
        "FENCE_X_MIN": -80.0,
        "FENCE_X_MAX": 0.0,
        "FENCE_Y_MAX": 45.0,
        "FENCE_Z_MIN": -25.0,
        "FENCE_Z_MAX": 60.0,
    }


@pytest.mark.parametrize(("apart_m", "step_m"), [(0.3, 2.0), (2.0, 2.0), (2.1, 3.0), (7.01, 8.0)])
def test_a_step_of_the_line_reaches_from_one_to_the_other_in_whole_metres(
    apart_m: float, step_m: float
) -> None:
    lines = {"a": (-30.0, 12.0), "b": (-30.0, 12.0 + apart_m)}
    assert table(lines=lines)["parameters"]["TGL_STEP_MAX"] == step_m


@pytest.mark.parametrize(("x_min_m", "waypoint_m"), [(-1150.0, -1916.7), (-1300.0, -2000.0)])
def test_the_waypoint_lies_beyond_the_fence_and_within_its_own_bound(
    x_min_m: float, waypoint_m: float
) -> None:
    found = table(bounds=(x_min_m, 0.0, -25.0, 60.0))
    assert found["parameters"]["WPT_X"] == pytest.approx(waypoint_m)


@pytest.mark.parametrize("oblique_deg", [0.0, 0.04, -0.04])
def test_a_wind_straight_at_the_ridge_needs_no_veer(oblique_deg: float) -> None:
    assert "VEER_MAX" not in site_text(draft(oblique_deg=oblique_deg), "")


@pytest.mark.parametrize(
    ("oblique_deg", "most_deg", "words"),
    [
        (0.06, 21.0, "from 0 degrees to the right of straight at the ridge"),
        (12.4, 33.0, "from 12 degrees to the right of straight at the ridge"),
        (-25.0, 45.0, "from 25 degrees to the left of straight at the ridge"),
        (44.0, 60.0, "from 44 degrees to the right of straight at the ridge"),
    ],
)
def test_an_oblique_wind_may_veer_by_twenty_degrees_more_and_by_sixty_at_most(
    oblique_deg: float, most_deg: float, words: str
) -> None:
    text = site_text(draft(oblique_deg=oblique_deg), "")
    assert tomllib.loads(text)["parameters"]["VEER_MAX"] == most_deg
    assert words in text
    assert f"and {most_deg - abs(oblique_deg):.0f} degrees further as it turns" in text


def test_the_model_its_errors_and_the_slope_are_reported() -> None:
    text = site_text(draft(), "")
    assert "by `tgl-soar site init` from N46E007.hgt.\n" in text
    assert "at most 1.3 m above it" in text  # 1.21, rounded up
    assert "# slope is 31 degrees at its steepest.\n" in text


def test_the_landing_place_is_reported_where_it_lies_on_the_earth() -> None:
    """By the tangent plane: x is downstream, so 70 m towards the wind from the crest."""
    place = landing_place(draft())
    assert place is not None
    heading = radians(250.0)
    north, east = 12.344 + 70.0 * cos(heading), -6.786 + 70.0 * sin(heading)
    got = TangentPlane(HOME).ned_m(*place, HOME.altitude_m)
    assert got[:2] == pytest.approx((north, east), abs=0.02)
    text = site_text(draft(), "")
    assert f"x = -70 m, z = -28 m,\n# at {place[0]:.5f}, {place[1]:.5f}.\n" in text


def test_where_no_place_to_land_was_found_it_is_reported() -> None:
    assert landing_place(draft(landing=None)) is None
    assert "# No level place before the slope was found" in site_text(draft(landing=None), "")

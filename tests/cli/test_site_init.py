"""`tgl-soar site init`: a model of a half-cylinder's ridge becomes a site that can be flown."""

from __future__ import annotations

from math import cos, hypot, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import excess_at, excess_gradient
from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, load_parameters, load_site, preset_lines, shipped
from tgl_soar.config.site import GridAir, Site
from tgl_soar.control.envelope import clearance
from tgl_soar.control.line_bounds import LineBounds, open_sides
from tgl_soar.link.tangent_plane import Home, TangentPlane
from tgl_soar.sim.world import build_field, site_field

Floats = NDArray[np.float64]

PLANE = shipped("airframes/eclipson_c.toml")
BASE_M = 500.0


def ridge_m(distance_m: Floats, radius_m: float) -> Floats:
    """The height of a half-cylinder on a plain."""
    squared: Floats = np.maximum(0.0, radius_m**2 - distance_m**2)
    return BASE_M + np.sqrt(squared)


@pytest.fixture(scope="module")
def hgt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """1" of a ridge of 300 m along 7.5° E, in whole metres as SRTM has them."""
    posts = 3601
    east = (np.arange(posts) / (posts - 1) - 0.5) * TangentPlane(Home(46.5, 7.5, 0.0)).ned_m(
        46.5, 8.5, 0.0
    )[1]
    heights = np.round(ridge_m(east, 300.0)).astype(">i2")
    path = tmp_path_factory.mktemp("dem") / "N46E007.hgt"
    path.write_bytes(np.broadcast_to(heights, (posts, posts)).tobytes())
    return path


def run(folder: Path, dem: Path, **options: Any) -> Any:
    given = {"lat": 46.5, "lon": 7.4995, "ridge": 0, "wind-from": 270, **options}
    words = [f"--{name}={value}" for name, value in given.items() if value is not None]
    return CliRunner().invoke(app, ["site", "init", str(folder), "--dem", str(dem), *words])


HIGH: dict[str, Any] = {"reach": 1200, "ceiling": 400}


def off_exact_m(site: Site, radius_m: float) -> list[float]:
    """How far each point of the file's contour lies from the exact solution's, to first order."""
    polar = load_airframe(PLANE).polar.as_polar()
    assert isinstance(site.air, GridAir)
    exact = HillField(site.air.wind_mps, radius_m)
    found = []
    for part in site.contour_for("Eclipson Model C"):
        for x, z in part:
            excess = excess_at(exact, polar, x, z + radius_m)  # its axis lies below the crest
            slope = hypot(*excess_gradient(exact, polar, x, z + radius_m))
            if np.isfinite(slope):  # not where the exact wind is just below the polar's range
                found.append(abs(excess) / slope)
    return found


def assert_it_can_be_flown(path: Path) -> Site:
    """What `run` and `preflight` ask of a site."""
    plane, site = load_airframe(PLANE), load_site(path)
    values = load_parameters(plane, PLANE, site, path)
    bounds = LineBounds(site.contour_for(plane.airframe.name), site.known_ground())
    assert bounds.fault(values) == ""
    assert bounds.preset_faults(values, preset_lines(site, values)) == []
    assert open_sides(values) == ""
    assert len(site.lines) == 3
    return site


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, hgt: Path) -> Path:
    """The site file of that ridge."""
    folder = tmp_path_factory.mktemp("made") / "site"
    result = run(folder, hgt, **HIGH)
    assert result.exit_code == 0, result.output
    return folder / "site.toml"


def test_a_ridge_in_hgt(made: Path) -> None:
    assert sorted(p.name for p in made.parent.iterdir()) == [
        "air.npz", "map.png", "plane.png", "site.toml",
    ]  # fmt: skip
    site = assert_it_can_be_flown(made)
    assert site.position.home is not None
    # On the crest, to half a post and the plateau of what rounds to the same metre: 300 m minus
    # 0.5 m is 17 m to either side.
    assert abs(site.site.origin_east_m - 38.0) < 17.0 + 15.0
    # The shape of the ridge is known to half a post of 30 m, the flow over it to 2 % of the wind,
    # which is what the contour's excess updraft changes by in 20 m.
    off = off_exact_m(site, 300.0)
    assert len(off) > 20
    assert max(off) < 15.0 + 20.0
    assert float(np.median(off)) < 15.0
    text = made.read_text(encoding="utf-8")
    assert "A GUESS" in text
    assert str(made.parent.parent) not in text, "the file moves with its folder"


def test_the_ground_is_nowhere_below_the_model(made: Path) -> None:
    site = load_site(made)
    ground = site.known_ground()
    x = np.linspace(-500.0, 0.0, 101)
    crest_m = BASE_M + 300.0
    east = site.site.origin_east_m - 38.4 + x  # of the cylinder's axis, 38.4 m from the home
    for place, height in zip(x, ridge_m(east, 300.0) - crest_m, strict=True):
        # A chord of the posts' own lies below the circle by 30² / 8 R / cos³; and half a metre of
        # rounding: at 60° it is 3.5 m.
        if abs(height) < 260.0:
            assert clearance(ground, float(place), float(height)) <= 3.5


def test_its_air_is_flown_by_the_simulation(made: Path) -> None:
    site = load_site(made)
    assert site.air is not None
    assert site.start is not None
    field = build_field(site.air, made.parent)
    polar = load_airframe(PLANE).polar.as_polar()
    for line in site.lines.values():
        # Placed on the contour between points 4 m apart that bend by the radius of the hill.
        assert abs(excess_at(field, polar, line.x_m, line.z_m)) < 0.02
    assert not field.inside(0.0, 0.0, -20.0), "the crest is solid"


def test_a_ridge_in_a_projected_geotiff_and_wind_across_it(tmp_path: Path) -> None:
    """5 m in UTM, a ridge of 60 m along 30°, its western slope chosen by where the place lies."""
    rasterio = pytest.importorskip("rasterio", reason="the extra `terrain` is not installed")
    warp, transform = (
        pytest.importorskip("rasterio.warp"),
        pytest.importorskip("rasterio.transform"),
    )
    (x,), (y,) = warp.transform("EPSG:4326", "EPSG:32632", [7.5], [46.5])
    side, step = 400, 5.0
    span = (np.arange(side) + 0.5 - 0.5 * side) * step
    xx, yy = np.meshgrid(x + span, y - span)
    lon, lat = warp.transform("EPSG:32632", "EPSG:4326", xx.ravel(), yy.ravel())
    plane = TangentPlane(Home(46.5, 7.5, BASE_M))
    ned = np.array([plane.ned_m(a, b, BASE_M) for a, b in zip(lat, lon, strict=True)])
    across = ned[:, 1] * cos(radians(30.0)) - ned[:, 0] * sin(radians(30.0))
    heights = ridge_m(across, 60.0).reshape(side, side).astype("f4")
    dem = tmp_path / "ridge.tif"
    with rasterio.open(
        dem, "w", driver="GTiff", height=side, width=side, count=1, dtype="float32",
        crs="EPSG:32632", compress="deflate", predictor=3,
        transform=transform.from_origin(x - 0.5 * side * step, y + 0.5 * side * step, step, step),
    ) as raster:  # fmt: skip
        raster.write(heights, 1)
    # 40 m west-north-west of the axis.
    place = {"lat": 46.5 + 20.0 / 111170.0, "lon": 7.5 - 34.6 / 76700.0}
    common = {**place, "ridge": 30, "wind-from": None, "reach": 300, "half-width": 30}
    result = run(tmp_path / "site", dem, clearance=3, **common)
    assert result.exit_code == 0, result.output
    site = assert_it_can_be_flown(tmp_path / "site" / "site.toml")
    assert site.site.wind_from_deg == pytest.approx(300.0)
    # The crest lies 40 m down the wind from the place: to half a sample.
    assert site.site.origin_north_m == pytest.approx(-20.0, abs=3.0)
    assert site.site.origin_east_m == pytest.approx(34.6, abs=3.0)
    # Half a post of 5 m, and 2 % of the wind, which here are 4 m.
    off = off_exact_m(site, 60.0)
    assert len(off) > 20
    assert max(off) < 2.5 + 4.0


def test_a_wind_that_comes_askew_leaves_the_frame_across_the_ridge(
    tmp_path: Path, hgt: Path, made: Path
) -> None:
    result = run(tmp_path / "site", hgt, **{**HIGH, "wind-from": 300, "wind": 9})
    assert result.exit_code == 0, result.output
    path = tmp_path / "site" / "site.toml"
    site, straight = assert_it_can_be_flown(path), load_site(made)
    assert (site.site.wind_from_deg, site.site.ridge_deg) == (300.0, 0.0)
    assert site.site.facing_deg() == straight.site.facing_deg() == 270.0
    assert site.site.origin_east_m == straight.site.origin_east_m
    assert load_parameters(load_airframe(PLANE), PLANE, site, path)["VEER_MAX"] == 50.0
    polar = load_airframe(PLANE).polar.as_polar()
    field = site_field(site, path.parent)
    along = {round(field.wind_at(line.x_m, 0.0, line.z_m, 0.0)[1], 6)
             for line in site.lines.values()}  # fmt: skip
    assert along == {-4.5}, "half of the wind, from the right"
    for line in site.lines.values():
        assert abs(excess_at(field, polar, line.x_m, line.z_m)) < 0.02
    # Less of an oblique wind is lifted, so that its contour ends lower.
    result = run(tmp_path / "other", hgt, **{**HIGH, "wind": 9})
    assert result.exit_code == 0, result.output
    other = load_site(tmp_path / "other" / "site.toml")
    top, lower = (
        max(z for part in each.contour_for("Eclipson Model C") for _, z in part)
        for each in (other, site)
    )
    assert lower < top


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lat": 47.2}, "47.20000, 7.49950 lies outside: it holds latitude 46 to 47"),
        ({"lon": 7.999}, "lies outside"),
        ({"lon": 7.2}, "no slope within 800 m that faces a wind from 270°: the steepest is 0.0°"),
        ({"wind-from": 10}, "wind from 10° blows along the ridge (0°), 80° off straight at it"),
        ({"wind-from": None, "lon": 7.5}, "say by --wind-from which slope is meant"),
        ({"reach": 1200, "ceiling": 20}, "no contour below the ceiling"),
        ({"wind": 1}, "a stronger wind (--wind)"),
        ({"wind": 30}, "does this airframe settle on a line that leans by 15°"),
        ({"lat": "nan"}, "nan is no number"),
    ],
)
def test_what_cannot_be_is_refused_in_words(
    tmp_path: Path, hgt: Path, options: dict[str, Any], words: str
) -> None:
    result = run(tmp_path / "site", hgt, **options)
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())
    assert not (tmp_path / "site").exists(), "nothing is left behind"


def test_voids_are_refused(tmp_path: Path, hgt: Path) -> None:
    posts = np.fromfile(hgt, dtype=">i2").reshape(3601, 3601)
    posts[1800, 1790] = -32768
    holed = tmp_path / "N46E007.hgt"
    holed.write_bytes(posts.tobytes())
    result = run(tmp_path / "site", holed)
    assert result.exit_code == 2
    assert "a void" in result.output
    assert "gdal_fillnodata" in result.output


def test_what_is_there_is_replaced_on_request_only(tmp_path: Path, hgt: Path) -> None:
    (tmp_path / "site.toml").write_text("mine", encoding="utf-8")
    result = run(tmp_path, hgt, **HIGH)
    assert result.exit_code == 2
    assert "has site.toml already: --force replaces" in " ".join(result.output.split())
    assert (tmp_path / "site.toml").read_text(encoding="utf-8") == "mine"
    words = ["site", "init", str(tmp_path), "--dem", str(hgt), "--lat=46.5", "--lon=7.4995",
             "--ridge=0", "--wind-from=270", "--reach=1200", "--ceiling=400",
             "--force"]  # fmt: skip
    assert CliRunner().invoke(app, words).exit_code == 0
    load_site(tmp_path / "site.toml")

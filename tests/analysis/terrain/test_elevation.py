"""Heights from .hgt and GeoTIFF: at the posts, between them, voids, edges, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.analysis.terrain.elevation import ElevationError, LocalTerrain, local_terrain
from tgl_soar.link.tangent_plane import Home, TangentPlane

POSTS = 1201  # a side: 3"


def plane_m(latitude: NDArray[np.float64], longitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """A tilted plane in whole metres at every post: bilinear between posts is exact."""
    return 100.0 + (latitude + 34.0) * 1200.0 + (longitude + 71.0) * 2400.0


@pytest.fixture
def tile(tmp_path: Path) -> Path:
    """34° S, 71° W: south and west, so that a sign that is wrong shows."""
    latitude = -33.0 - np.arange(POSTS) / 1200.0
    longitude = -71.0 + np.arange(POSTS) / 1200.0
    heights = np.round(plane_m(latitude[:, None], longitude[None, :]))
    heights[600, 700] = -32768
    path = tmp_path / "S34W071.hgt"
    path.write_bytes(heights.astype(">i2").tobytes())
    return path


def test_heights_lie_where_the_tile_has_them(tile: Path) -> None:
    terrain = local_terrain(tile, -33.2, -70.3, 500.0)
    assert terrain.home.altitude_m == pytest.approx(100.0 + 0.8 * 1200.0 + 0.7 * 2400.0, abs=1e-6)
    latitude, longitude = np.array([-33.21234, -33.0, -34.0]), np.array([-70.31234, -71.0, -70.0])
    found = terrain.elevation.height_m(latitude, longitude)
    np.testing.assert_allclose(found, plane_m(latitude, longitude), atol=1e-6)


def test_a_void_is_refused_and_its_neighbours_are_not(tile: Path) -> None:
    latitude, longitude = -33.0 - 600 / 1200.0, -71.0 + 700 / 1200.0
    elevation = local_terrain(tile, -33.2, -70.3, 500.0).elevation
    with pytest.raises(ElevationError, match=r"S34W071.hgt: no height at -33.50000, .*fill it"):
        elevation.height_m(latitude, longitude + 0.5 / 1200.0)
    elevation.height_m(latitude, longitude + 1.01 / 1200.0)


def test_outside_the_tile_is_refused(tile: Path) -> None:
    with pytest.raises(ElevationError, match=r"-32.99.* outside: it holds latitude -34 to -33"):
        local_terrain(tile, -32.99, -70.3, 500.0)
    with pytest.raises(ElevationError, match="lies outside"):
        local_terrain(tile, -33.001, -70.3, 500.0).up_m([0.0, 500.0], 0.0)


def test_local_heights_agree_with_the_tangent_plane(tile: Path) -> None:
    terrain = local_terrain(tile, -33.2, -70.3, 3000.0)
    north, east = np.array([2900.0, -2900.0, 1200.0]), np.array([2900.0, 1500.0, -2900.0])
    exact = TangentPlane(terrain.home)
    places = zip(*terrain.place(north, east), terrain.up_m(north, east), strict=True)
    for n, e, (latitude, longitude, up) in zip(north, east, places, strict=True):
        height = float(terrain.elevation.height_m(latitude, longitude))
        got = exact.ned_m(float(latitude), float(longitude), height)
        # 4 km off the third order is 4 km (4 km / R)² = 2 mm, times what the latitude multiplies
        # it by; ground that lies higher than the home widens the distance by up / R.
        assert got == pytest.approx((n, e, -up), abs=0.02 + 4100.0 * abs(up) / 6.37e6)


@pytest.mark.parametrize(
    ("name", "size", "words"),
    [
        ("hill.hgt", 2 * POSTS * POSTS, "its name must begin with its south-western corner"),
        ("N46E007.hgt", 2 * POSTS * POSTS - 2, "1201 x 1201 or"),
        ("N46E007.asc", 10, "format '.asc' is not known; one of .hgt"),
    ],
)
def test_files_that_are_no_model(tmp_path: Path, name: str, size: int, words: str) -> None:
    (tmp_path / name).write_bytes(bytes(size))
    with pytest.raises(ElevationError, match=words):
        local_terrain(tmp_path / name, 46.5, 7.5, 500.0)


def test_places_that_are_none(tile: Path) -> None:
    with pytest.raises(ElevationError, match="latitude must be within"):
        local_terrain(tile, 97.0, 7.5, 500.0)
    with pytest.raises(ElevationError, match="3000 m at most"):
        local_terrain(tile, -33.2, -70.3, 30000.0)
    with pytest.raises(ElevationError, match="no such file"):
        local_terrain(tile.with_name("S35W071.hgt"), -33.2, -70.3, 500.0)


# --- GeoTIFF ----------------------------------------------------------------------------------


def geotiff(path: Path, heights: NDArray[np.float32], **profile: object) -> Path:
    """Deflated with the predictor of floating-point numbers, as Copernicus' tiles are."""
    rasterio = pytest.importorskip("rasterio", reason="the extra `terrain` is not installed")
    rows, columns = heights.shape
    usual = {"crs": "EPSG:4326", "nodata": -9999.0, "compress": "deflate", "predictor": 3}
    with rasterio.open(
        path, "w", driver="GTiff", height=rows, width=columns, count=1, dtype="float32",
        **{**usual, **profile},
    ) as raster:  # fmt: skip
        raster.write(heights, 1)
    return path


def _origin(west: float, north: float, step: float) -> object:
    transform = pytest.importorskip("rasterio.transform")
    return transform.from_origin(west, north, step, step)


def test_a_geotiff_has_its_heights_in_the_middle_of_its_pixels(tmp_path: Path) -> None:
    step = 1.0 / 3600.0
    latitude = 46.6 - (np.arange(400) + 0.5) * step
    longitude = 7.5 + (np.arange(300) + 0.5) * step
    heights = (300.0 + 3e3 * (latitude[:, None] - 46.5) + 5e3 * (longitude - 7.5)).astype("f4")
    heights[200, 100] = -9999.0
    path = geotiff(tmp_path / "dem.tif", heights, transform=_origin(7.5, 46.6, step))
    # The part that is read begins in the middle of the file.
    terrain = local_terrain(path, 46.53, 7.55, 800.0)
    places = np.array([46.53, 46.531234]), np.array([7.55, 7.5512345])
    exact = 300.0 + 3e3 * (places[0] - 46.5) + 5e3 * (places[1] - 7.5)
    # Single precision of some 600 m.
    np.testing.assert_allclose(terrain.elevation.height_m(*places), exact, atol=1e-3)
    assert terrain.elevation.spacing_m == pytest.approx(30.9, rel=0.01)  # the coarser, to the north
    with pytest.raises(ElevationError, match="a void"):
        local_terrain(path, float(latitude[200]), float(longitude[100]), 500.0)
    with pytest.raises(ElevationError, match=r"outside: it holds latitude 46.4889 to 46.6000"):
        local_terrain(path, 45.0, 7.55, 500.0)


@pytest.mark.parametrize("void", [-9999.0, -32768.0, 3.4e38])
def test_a_void_by_another_name_is_refused_where_the_file_has_none_for_it(
    tmp_path: Path, void: float
) -> None:
    heights = np.full((20, 20), 500.0, dtype=np.float32)
    heights[10, 10] = void
    transform = _origin(7.0, 47.0, 0.01)
    path = geotiff(tmp_path / "model.tif", heights, nodata=None, transform=transform)
    found = local_terrain(path, 46.925, 7.025, 1000.0)
    assert found.home.altitude_m == 500.0
    with pytest.raises(ElevationError, match="a void"):
        local_terrain(path, 46.897, 7.104, 1000.0)


def test_a_geotiff_must_say_where_it_lies_and_be_in_metres(tmp_path: Path) -> None:
    heights = np.full((50, 50), 300.0, dtype="f4")
    bare = geotiff(tmp_path / "bare.tif", heights, crs=None, transform=_origin(7.5, 46.5, 0.001))
    with pytest.raises(ElevationError, match="does not say its projection"):
        local_terrain(bare, 46.48, 7.52, 500.0)
    feet = geotiff(tmp_path / "feet.tif", heights, transform=_origin(7.5, 46.5, 0.001))
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(feet, "r+") as raster:
        raster.units = ["ft"]
    with pytest.raises(ElevationError, match="heights in 'ft': they must be in metres"):
        local_terrain(feet, 46.48, 7.52, 500.0)
    torn = tmp_path / "torn.tif"
    torn.write_bytes(b"II*\0 and no more")
    with pytest.raises(ElevationError, match="cannot be read"):
        local_terrain(torn, 46.48, 7.52, 500.0)


def test_a_projected_geotiff(tmp_path: Path) -> None:
    """UTM, whose grid is turned against north here by 1.1°."""
    warp = pytest.importorskip("rasterio.warp")
    (x,), (y,) = warp.transform("EPSG:4326", "EPSG:32632", [7.5], [46.5])
    side, step = 400, 5.0
    transform = _origin(x - 0.5 * side * step, y + 0.5 * side * step, step)
    xs = x + (np.arange(side) + 0.5 - 0.5 * side) * step
    ys = y - (np.arange(side) + 0.5 - 0.5 * side) * step
    xx, yy = np.meshgrid(xs, ys)
    lon, _ = warp.transform("EPSG:32632", "EPSG:4326", xx.ravel(), yy.ravel())
    east = (np.array(lon) - 7.5) * np.radians(1.0) * np.cos(np.radians(46.5)) * 6.3894e6
    heights = (200.0 + 0.1 * east).reshape(side, side).astype("f4")
    path = geotiff(tmp_path / "utm.tif", heights, crs="EPSG:32632", transform=transform)
    terrain = local_terrain(path, 46.5, 7.5, 600.0)
    # 600 m to true north are level, though 11 m to the side in the grid: 1.1 m of height.
    up = terrain.up_m([600.0, 0.0, -600.0], [0.0, 500.0, 0.0])
    np.testing.assert_allclose(up, [0.0, 50.0, 0.0], atol=0.1)
    assert isinstance(terrain, LocalTerrain)
    assert terrain.home == Home(46.5, 7.5, terrain.home.altitude_m)

"""Heights from a grid in numbers: weights between posts, edges, voids, and what a file may say of
its place, its extent and its units."""

from __future__ import annotations

from math import cos, degrees, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.terrain.elevation import (
    Elevation,
    ElevationError,
    LocalTerrain,
    local_terrain,
)
from tgl_soar.link.tangent_plane import Home

GRID = np.array([[10.0, 20.0, 40.0], [50.0, 90.0, 170.0]])


def as_given(latitude: FloatArray, longitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows and columns are asked for by their numbers."""
    return latitude, longitude


def grid(heights: Any = GRID) -> Elevation:
    return Elevation("my.hgt", np.asarray(heights, dtype=float), as_given, 30.0, "all there is")


# --- between posts --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "column", "height_m"),
    [
        (0.0, 0.0, 10.0),
        (0.0, 2.0, 40.0),
        (1.0, 0.0, 50.0),
        (1.0, 2.0, 170.0),
        (0.0, 0.25, 12.5),
        (0.25, 0.0, 20.0),
        (1.0, 1.5, 130.0),
        (0.5, 1.5, 0.5 * (30.0 + 130.0)),
        (0.25, 0.5, 0.75 * 15.0 + 0.25 * 70.0),
    ],
)
def test_heights_are_bilinear(row: float, column: float, height_m: float) -> None:
    assert float(grid().height_m(row, column)) == pytest.approx(height_m)


@pytest.mark.parametrize(
    ("row", "column"), [(-1e-3, 1.0), (1.001, 1.0), (0.5, -1e-3), (0.5, 2.001), (np.nan, 1.0)]
)
def test_beyond_each_edge_it_is_refused_with_the_place_and_what_helps(
    row: float, column: float
) -> None:
    with pytest.raises(ElevationError, match="lies outside: it holds all there is") as error:
        grid().height_m([0.5, row], [1.0, column])
    assert str(error.value).startswith(f"my.hgt: {row:.5f}, {column:.5f} lies")
    assert "gdalbuildvrt" in str(error.value)


def test_on_the_edge_but_for_rounding_the_edges_height_counts() -> None:
    found = grid().height_m([-1e-7, 1.0 + 1e-7], [-1e-7, 2.0 + 1e-7])
    assert found.tolist() == [10.0, 170.0]


@pytest.mark.parametrize(
    ("height_m", "void"),
    [(-500.0, False), (-501.0, True), (9000.0, False), (9001.0, True), (np.nan, True)],
)
def test_what_no_ground_on_earth_has_is_a_void(height_m: float, void: bool) -> None:
    heights = GRID.copy()
    heights[0, 0] = height_m
    places: Any = ([0.0, 0.5, 0.5], [0.0, 0.5, 1.5])
    if not void:
        assert float(grid(heights).height_m(0.0, 0.0)) == height_m
    else:
        words = "no height at 0.00000, 0.00000: a void, and 2 of the 3 places that are needed"
        with pytest.raises(ElevationError, match=words):
            grid(heights).height_m(*places)
    assert float(grid(heights).height_m(0.5, 1.5)) == pytest.approx(80.0)


# --- about a home -------------------------------------------------------------------------------


def test_the_home_lies_on_the_ground_and_its_plane_leaves_the_earth() -> None:
    """By a sphere that touches the ellipsoid there: a drop of d² / 2 R on either axis."""
    flat = Elevation("f", np.full((2, 2), 700.0), lambda a, b: (0.0 * a, 0.0 * b), 30.0, "")
    terrain = LocalTerrain(flat, Home(0.0, 0.0, 700.0))
    meridian_m, across_m = 6335439.3 + 700.0, 6378137.0 + 700.0  # at the equator
    assert terrain.up_m(0.0, 0.0) == pytest.approx(0.0)
    assert terrain.up_m(2000.0, 0.0) == pytest.approx(-0.5 * 2000.0**2 / meridian_m)
    assert terrain.up_m(0.0, -3000.0) == pytest.approx(-0.5 * 3000.0**2 / across_m)
    assert terrain.up_m(0.0, 0.0).shape == ()
    low = LocalTerrain(flat, Home(0.0, 0.0, 650.0))
    assert low.up_m(0.0, 0.0) == pytest.approx(50.0)


def test_a_metre_is_as_many_degrees_as_on_the_ellipsoid() -> None:
    """At 60 degrees north: radii of 6 383 453 m along the meridian, 6 394 209 m across."""
    terrain = LocalTerrain(grid(), Home(60.0, 10.0, 0.0))
    north, _ = terrain.place(1000.0, 0.0)
    assert north - 60.0 == pytest.approx(degrees(1000.0 / 6383453.9), rel=1e-6)
    south, east = terrain.place(0.0, 1000.0)
    assert east - 10.0 == pytest.approx(degrees(1000.0 / (6394209.2 * 0.5)), rel=1e-6)
    # A straight way to the east leaves the parallel, towards the equator.
    bend_m = 1000.0**2 * 3.0**0.5 / (2.0 * 6394209.2)
    assert 60.0 - south == pytest.approx(degrees(bend_m / 6383453.9), rel=1e-3)


# --- .hgt ---------------------------------------------------------------------------------------

SIDE = 1201


def tile(folder: Path, name: str, extra: int = 0) -> Path:
    """100 m in the south-west, 1200 m more to the north, 2400 to the east."""
    north, east = np.arange(SIDE)[::-1, None], np.arange(SIDE)[None, :]
    path = folder / name
    path.write_bytes((100 + north + 2 * east).astype(">i2").tobytes() + bytes(extra))
    return path


@pytest.mark.parametrize(
    ("name", "south", "west"),
    [("N46E007.hgt", 46, 7), ("s34w071.HGT", -34, -71), ("N00W001.hgt", 0, -1)],
)
def test_a_tile_lies_where_its_name_says(tmp_path: Path, name: str, south: int, west: int) -> None:
    found = local_terrain(tile(tmp_path, name), south + 0.5, west + 0.25, 100.0)
    assert found.home[:2] == (south + 0.5, west + 0.25)
    assert found.home.altitude_m == pytest.approx(100.0 + 600.0 + 600.0)
    assert found.elevation.name == str(tmp_path / name)
    assert found.elevation.spacing_m == pytest.approx(2.0 * pi * 6378137.0 / 360.0 / 1200.0)
    with pytest.raises(ElevationError) as error:
        local_terrain(tmp_path / name, south + 1.5, west + 0.25, 100.0)
    words = f"it holds latitude {south} to {south + 1}, longitude {west} to {west + 1}. Take"
    assert words in str(error.value)


@pytest.mark.parametrize("extra", [1, 2])
def test_a_tile_has_two_bytes_a_post_and_no_more(tmp_path: Path, extra: int) -> None:
    size = 2 * SIDE * SIDE + extra
    with pytest.raises(ElevationError, match=f"{size} bytes: must be 2 bytes for each of 1201"):
        local_terrain(tile(tmp_path, "N46E007.hgt", extra), 46.5, 7.5, 100.0)


@pytest.mark.parametrize(
    ("latitude", "longitude", "reach_m", "words"),
    [
        (85.0, 7.5, 100.0, "85, 7.5: latitude must be within"),
        (-85.0, 7.5, 100.0, "-85, 7.5: latitude must be within"),
        (46.5, 180.1, 100.0, "longitude within"),
        (46.5, -180.1, 100.0, "longitude within"),
        (np.nan, 7.5, 100.0, "latitude must be within"),
        (46.5, 7.5, 0.0, "reach 0 m: must be above 0 and 3000 m at most"),
        (46.5, 7.5, -1.0, "reach -1 m"),
        (46.5, 7.5, 3000.1, "reach 3000.1 m"),
        # These are places, but for the file.
        (84.9, 7.5, 100.0, "no such file"),
        (-84.9, 180.0, 3000.0, "no such file"),
        (46.5, -180.0, 0.1, "no such file"),
    ],
)
def test_a_place_and_a_reach_have_bounds(
    tmp_path: Path, latitude: float, longitude: float, reach_m: float, words: str
) -> None:
    with pytest.raises(ElevationError, match=words):
        local_terrain(tmp_path / "none.hgt", latitude, longitude, reach_m)


# --- GeoTIFF ------------------------------------------------------------------------------------


def written(path: Path, heights: NDArray[Any], transform: Any, **changes: Any) -> Path:
    """Units, scales and offsets are those that other tools left in it."""
    rasterio = pytest.importorskip("rasterio", reason="the extra `terrain` is not installed")
    rows, columns = heights.shape
    with rasterio.open(
        path, "w", driver="GTiff", height=rows, width=columns, count=1,
        dtype=str(heights.dtype), crs="EPSG:4326", nodata=-9999.0, transform=transform,
    ) as raster:  # fmt: skip
        raster.write(heights, 1)
        for name, value in changes.items():
            setattr(raster, name, (value,))
    return path


def from_origin(west: float, north: float, east_deg: float, north_deg: float) -> Any:
    transform = pytest.importorskip("rasterio.transform")
    return transform.from_origin(west, north, east_deg, north_deg)


def level(path: Path, height: float = 300.0, **changes: Any) -> Path:
    heights = np.full((50, 50), height, dtype=np.float32)
    return written(path, heights, from_origin(7.5, 46.5, 0.001, 0.001), **changes)


def test_scaled_heights_are_put_back(tmp_path: Path) -> None:
    path = level(tmp_path / "scaled.tif", scales=0.5, offsets=100.0)
    assert local_terrain(path, 46.48, 7.52, 500.0).home.altitude_m == 250.0


@pytest.mark.parametrize("unit", ["m", "metre", "Meter", "metres", "METERS"])
def test_metres_have_many_names(tmp_path: Path, unit: str) -> None:
    path = level(tmp_path / "model.TIFF", units=unit)
    assert local_terrain(path, 46.48, 7.52, 500.0).home.altitude_m == 300.0


@pytest.mark.parametrize(
    ("east_deg", "north_deg", "spacing_m"),
    [(0.001, 0.0004, 0.001 * 111320.0 * 0.6884), (0.0004, 0.001, 0.001 * 111160.0)],
)
def test_the_spacing_is_that_of_the_coarser_axis(
    tmp_path: Path, east_deg: float, north_deg: float, spacing_m: float
) -> None:
    heights = np.full((200, 200), 300.0, dtype=np.float32)
    origin = from_origin(7.5, 46.5 + 100 * north_deg, east_deg, north_deg)
    path = written(tmp_path / "model.tif", heights, origin)
    found = local_terrain(path, 46.5, 7.5 + 100 * east_deg, 500.0)
    assert found.elevation.spacing_m == pytest.approx(spacing_m, rel=3e-3)


def turned(folder: Path) -> tuple[Path, float, float]:
    """A raster turned by 30 degrees, whose heights are a plane: its file, and its middle."""
    affine = pytest.importorskip("rasterio.transform").Affine
    step, n = 0.0002, 160
    c, s = step * cos(radians(30.0)), step * sin(radians(30.0))
    columns, rows = np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5)
    west, north = 7.5, 46.5
    longitude, latitude = west + c * columns - s * rows, north - s * columns - c * rows
    heights = plane_m(latitude, longitude).astype(np.float32)
    transform = affine(c, -s, west, -s, -c, north)
    path = written(folder / "turned.tif", heights, transform)
    return path, float(latitude[80, 80]), float(longitude[80, 80])


def plane_m(latitude: Any, longitude: Any) -> Any:
    return 300.0 + 5e3 * (latitude - 46.48) + 3e3 * (longitude - 7.5)


def test_a_raster_that_is_turned_against_north_is_read_all_around_the_place(
    tmp_path: Path,
) -> None:
    """To the corners of what is asked for, of a part of the file."""
    path, latitude, longitude = turned(tmp_path)
    found = local_terrain(path, latitude, longitude, 600.0)
    sides = np.linspace(-600.0, 600.0, 13)
    north, east = np.meshgrid(sides, sides)
    places = found.place(north, east)
    assert found.elevation.height_m(*places) == pytest.approx(plane_m(*places), abs=2e-3)
    with pytest.raises(ElevationError, match="lies outside"):
        found.up_m(1500.0, 1500.0)  # in the file, but not read: large models do not fit in memory


def test_a_place_at_the_edge_of_a_raster_has_what_the_file_has(tmp_path: Path) -> None:
    """Fifty pixels of a thousandth of a degree from 7.5 east and 46.5 north on."""
    path = level(tmp_path / "model.tif")
    for latitude, longitude in ((46.499, 7.501), (46.451, 7.549)):
        assert local_terrain(path, latitude, longitude, 3000.0).home.altitude_m == 300.0


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(46.6, 7.52), (46.4, 7.52), (46.48, 7.4), (46.48, 7.7)]
)
def test_a_place_to_any_side_of_a_raster_is_outside_of_it(
    tmp_path: Path, latitude: float, longitude: float
) -> None:
    words = (
        rf"{latitude:.5f}, {longitude:.5f} lies outside: it holds latitude 46\.4500 to 46\.5000,"
        r" longitude 7\.5000 to 7\.5500"
    )
    with pytest.raises(ElevationError, match=words):
        local_terrain(level(tmp_path / "model.tif"), latitude, longitude, 500.0)

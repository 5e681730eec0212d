"""Heights of the ground from a digital elevation model that the user has.

    .hgt              SRTM's: big-endian int16 in metres, N46E007.hgt is the degree north and east
                      of 46° N, 7° E; 1201 or 3601 posts a side, the first row its northern edge,
                      -32768 a void
    .tif .tiff .vrt   GeoTIFF in any projection, and mosaics of them: rasterio (the extra terrain)

Between posts heights are bilinear.  Where one of the four is a void there is no height.

Local NED about a home, to the second order in distance over the earth's radius, which within 3 km
is 1 cm (M, N: radii of curvature of the WGS 84 ellipsoid along the meridian and across, and the
home's height):

    φ = φ0 + n / M − e² tan φ0 / (2 M N)        λ = λ0 + e / (N cos φ0) (1 + n tan φ0 / M)
    up = h − h0 − (n² / M + e² / N) / 2

Heights are above mean sea level, as the home's is; the geoid is as good as flat within kilometres.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from math import cos, radians, sin, sqrt, tan
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.link.tangent_plane import ECCENTRICITY2, EQUATOR_M, Home

FARTHEST_M: Final = 3000.0  # from the home, at which the plane above is good to 1 cm

LOWEST_M, HIGHEST_M = -500.0, 9000.0  # of any ground on the earth; what is beyond is a void
_SIDES: Final = (1201, 3601)
_VOID: Final = -32768

# Row and column of places, as fractions, from latitudes and longitudes [deg].
_ToGrid = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


class ElevationError(ValueError):
    """A model that gives no height here; the message names file, place, and what helps."""


class Elevation:
    """Heights on a grid.

    heights_m: rows and columns, NaN where there is a void; to_grid: fractional row and column
    of latitudes and longitudes; spacing_m: between posts; held: what the file covers, in words.
    """

    def __init__(
        self, name: str, heights_m: FloatArray, to_grid: _ToGrid, spacing_m: float, held: str
    ) -> None:
        self.name, self.spacing_m = name, spacing_m
        # -9999, -32768, 1e38: what a void is called where the file does not say what it is called.
        ground = (heights_m >= LOWEST_M) & (heights_m <= HIGHEST_M)
        self._heights = np.where(ground, heights_m, np.nan)
        self._to_grid, self._held = to_grid, held

    def height_m(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
        """Heights above mean sea level [m].  Errors: `ElevationError`."""
        latitude, longitude, _ = broadcast(latitude_deg, longitude_deg, 0.0)
        row, column = self._to_grid(latitude, longitude)
        rows, columns = self._heights.shape
        slack = 1e-6  # of a post's distance: a place on the very edge
        out = ~((row >= -slack) & (row <= rows - 1 + slack))
        out |= ~((column >= -slack) & (column <= columns - 1 + slack))
        if out.any():
            raise ElevationError(
                f"{self.name}: {_first(latitude, longitude, out)} lies outside: it holds"
                f" {self._held}. Take the tile that holds all of the place, or join tiles"
                " (gdalbuildvrt joined.vrt A.tif B.tif) and name that file"
            )
        row, column = np.clip(row, 0.0, rows - 1.0), np.clip(column, 0.0, columns - 1.0)
        i = np.minimum(row.astype(np.intp), rows - 2)
        k = np.minimum(column.astype(np.intp), columns - 2)
        a, b, grid = row - i, column - k, self._heights
        height: FloatArray = (1.0 - a) * ((1.0 - b) * grid[i, k] + b * grid[i, k + 1]) + a * (
            (1.0 - b) * grid[i + 1, k] + b * grid[i + 1, k + 1]
        )
        void = ~np.isfinite(height)
        if void.any():
            raise ElevationError(
                f"{self.name}: no height at {_first(latitude, longitude, void)}: a void, and"
                f" {int(void.sum())} of the {void.size} places that are needed lie in voids. Take"
                " another model, or fill it (gdal_fillnodata)"
            )
        return height


class LocalTerrain(NamedTuple):
    """A model about a home: the origin of local NED, on the ground there."""

    elevation: Elevation
    home: Home

    def up_m(self, north_m: ArrayLike, east_m: ArrayLike) -> FloatArray:
        """Heights of the ground over the home's horizontal plane [m].  Errors: `ElevationError`."""
        north, east, _ = broadcast(north_m, east_m, 0.0)
        meridian_m, across_m = _radii(self.home)
        drop = 0.5 * (north * north / meridian_m + east * east / across_m)
        height = self.elevation.height_m(*self.place(north, east))
        return height - self.home.altitude_m - drop

    def place(self, north_m: ArrayLike, east_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Latitudes and longitudes [deg]."""
        north, east, _ = broadcast(north_m, east_m, 0.0)
        meridian_m, across_m = _radii(self.home)
        phi = radians(self.home.latitude_deg)
        d_phi = north / meridian_m - east * east * tan(phi) / (2.0 * meridian_m * across_m)
        d_lambda = east / (across_m * cos(phi)) * (1.0 + north * tan(phi) / meridian_m)
        return (
            self.home.latitude_deg + np.degrees(d_phi),
            self.home.longitude_deg + np.degrees(d_lambda),
        )


def _radii(home: Home) -> tuple[float, float]:
    """Radii of curvature [m] along the meridian and across it, at the home's height."""
    bracket = 1.0 - ECCENTRICITY2 * sin(radians(home.latitude_deg)) ** 2
    meridian_m = EQUATOR_M * (1.0 - ECCENTRICITY2) / bracket**1.5
    across_m = EQUATOR_M / sqrt(bracket)
    return meridian_m + home.altitude_m, across_m + home.altitude_m


def local_terrain(
    path: Path, latitude_deg: float, longitude_deg: float, reach_m: float
) -> LocalTerrain:
    """A model's surroundings of a place, with the ground there as home.

    reach_m: how far heights will be asked for, to north, south, east and west.
    Errors: `ElevationError`; ImportError naming the extra.
    """
    if not (abs(latitude_deg) < 85.0 and abs(longitude_deg) <= 180.0):
        raise ElevationError(
            f"{latitude_deg:g}, {longitude_deg:g}: latitude must be within ± 85°, longitude"
            " within ± 180°"
        )
    if not 0.0 < reach_m <= FARTHEST_M:
        raise ElevationError(f"reach {reach_m:g} m: must be above 0 and {FARTHEST_M:g} m at most")
    if not path.is_file():
        raise ElevationError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix == ".hgt":
        elevation = _read_hgt(path)
    elif suffix in (".tif", ".tiff", ".vrt"):
        elevation = _read_raster(path, latitude_deg, longitude_deg, reach_m)
    else:
        raise ElevationError(f"{path}: format {suffix!r} is not known; one of .hgt .tif .tiff .vrt")
    altitude_m = float(elevation.height_m(latitude_deg, longitude_deg))
    return LocalTerrain(elevation, Home(latitude_deg, longitude_deg, altitude_m))


def _read_hgt(path: Path) -> Elevation:
    named = re.match(r"([NS])(\d\d)([EW])(\d\d\d)", path.name.upper())
    if named is None:
        raise ElevationError(
            f"{path}: its name must begin with its south-western corner, as in N46E007.hgt: the"
            " file itself does not say where it lies"
        )
    south = int(named[2]) * (1 if named[1] == "N" else -1)
    west = int(named[4]) * (1 if named[3] == "E" else -1)
    posts = np.fromfile(path, dtype=">i2")
    side = next((n for n in _SIDES if n * n == posts.size and path.stat().st_size == 2 * n * n), 0)
    if not side:
        raise ElevationError(
            f"{path}: {path.stat().st_size} bytes: must be 2 bytes for each of 1201 x 1201 or"
            " 3601 x 3601 posts; is it compressed, or cut off?"
        )
    heights = posts.reshape(side, side).astype(np.float64)
    heights[heights == _VOID] = np.nan

    def to_grid(latitude: FloatArray, longitude: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (south + 1 - latitude) * (side - 1), (longitude - west) * (side - 1)

    spacing_m = radians(1.0 / (side - 1)) * EQUATOR_M
    held = f"latitude {south} to {south + 1}, longitude {west} to {west + 1}"
    return Elevation(str(path), heights, to_grid, spacing_m, held)


def _read_raster(path: Path, latitude: float, longitude: float, reach_m: float) -> Elevation:
    """The part of a raster that is needed: national models are larger than memory."""
    rasterio, warp, windows = _rasterio()
    try:
        with rasterio.open(path) as raster:
            if raster.crs is None:
                raise ElevationError(f"{path}: does not say its projection: gdal_edit.py -a_srs …")
            unit = (raster.units[0] or "m").lower()
            if unit not in ("m", "metre", "meter", "metres", "meters"):
                raise ElevationError(f"{path}: heights in {unit!r}: they must be in metres")
            crs, inverse = raster.crs, ~raster.transform

            def pixels(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
                xs, ys = warp.transform("EPSG:4326", crs, lon.ravel(), lat.ravel())
                a, b, c, d, e, f = inverse[:6]
                column = a * np.array(xs) + b * np.array(ys) + c
                row = d * np.array(xs) + e * np.array(ys) + f
                return row.reshape(lat.shape) - 0.5, column.reshape(lat.shape) - 0.5

            around = LocalTerrain(Elevation("", np.zeros((2, 2)), pixels, 0.0, ""),
                                  Home(latitude, longitude, 0.0))  # fmt: skip
            sides = np.linspace(-reach_m, reach_m, 9)
            row, column = pixels(*around.place(*np.meshgrid(sides, sides)))
            # A step of 10 m to the east and to the north, in pixels.
            steps = pixels(*around.place(np.array([0.0, 0.0, 10.0]), np.array([0.0, 10.0, 0.0])))
            per_pixel = [10.0 / float(np.hypot(*(p[k] - p[0] for p in steps))) for k in (1, 2)]
            top, left = (max(0, int(np.floor(p.min())) - 1) for p in (row, column))
            bottom = min(raster.height, int(np.ceil(row.max())) + 2)
            right = min(raster.width, int(np.ceil(column.max())) + 2)
            west, south, east, north = warp.transform_bounds(crs, "EPSG:4326", *raster.bounds)
            held = f"latitude {south:.4f} to {north:.4f}, longitude {west:.4f} to {east:.4f}"
            if bottom - top < 2 or right - left < 2:
                raise ElevationError(
                    f"{path}: {latitude:.5f}, {longitude:.5f} lies outside: it holds {held}. Take"
                    " the tile that holds the place"
                )
            window = windows.Window(left, top, right - left, bottom - top)
            band = raster.read(1, window=window, masked=True).astype(np.float64)
            heights = np.asarray(band.filled(np.nan) * raster.scales[0] + raster.offsets[0])
    except rasterio.errors.RasterioError as error:
        raise ElevationError(f"{path}: cannot be read: {error}") from None

    def to_grid(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
        row, column = pixels(lat, lon)
        return row - top, column - left

    return Elevation(str(path), heights, to_grid, max(per_pixel), held)


def _rasterio() -> tuple[Any, Any, Any]:
    try:
        import rasterio
        import rasterio.warp
        import rasterio.windows
    except ImportError:
        raise ImportError("GeoTIFF needs rasterio: pip install 'tgl_soar[terrain]'") from None
    return rasterio, rasterio.warp, rasterio.windows


def _first(latitude: FloatArray, longitude: FloatArray, which: Any) -> str:
    return f"{latitude[which].flat[0]:.5f}, {longitude[which].flat[0]:.5f}"

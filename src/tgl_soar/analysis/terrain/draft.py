"""A first idea of a site: the slope that faces the wind, where to fly before it, and where not.

The soaring frame is put on the crest: x downstream and across the ridge, z up from there.  Its
vertical plane at y = 0 is the profile that the wind is worked out over; [ground] is the highest of
the strip to either side of it that the fence allows.

The part of the wind that blows across the ridge is potential flow over that profile (`air.panels`);
the part along the ridge is left as it is.  No friction, no wake, no valley wind: it is a guess to
begin from, and says so wherever it is written.

At the ground such a flow follows the slope, so w / u is the slope there: a slope flatter than the
best glide of the airframe carries nobody, and is called none.
"""

from __future__ import annotations

from itertools import pairwise
from math import ceil, cos, degrees, floor, hypot, inf, radians
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray, WindField
from tgl_soar.air.grid import GridField
from tgl_soar.air.panels import PanelField
from tgl_soar.air.wind_record import oblique_field
from tgl_soar.air.zeuc import Bounds, ZeucError, contour, stable_crossing
from tgl_soar.analysis.terrain.elevation import LocalTerrain
from tgl_soar.analysis.terrain.profile import ReducedProfile, reduced
from tgl_soar.config.site import OBLIQUE_DEG, GroundProfile, SiteOrigin
from tgl_soar.control.envelope import clearance
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.estimation.lift_map.extended_polar import sink
from tgl_soar.geometry import SoaringFrame, ned_from_soaring, wrap_angle
from tgl_soar.types import GlidePolar

LEAN_DEG: Final = 15.0  # the default of TGL_LEAN
CREST_FRACTION: Final = 0.25  # of the reach: so far from the given place the crest is looked for
SAMPLES: Final = 200  # of a profile, at most: the panels' matrix and the reduction grow with them
STRIPS: Final = 9  # of the ground across the fence
CELLS: Final = 140  # of the written wind along x, at most
LANDING_SLOPE: Final = 0.05  # along and across: a glide of 1 in 5 sees it as level
LANDING_LENGTH_M: Final = 40.0  # twice what a small glider runs out in


class DraftError(ValueError):
    """No site can be made of this; the message says what the ground or the wind lacks."""


class Request(NamedTuple):
    """What is asked for."""

    ridge_deg: float  # direction along which the ridge runs, clockwise from north
    wind_from_deg: float | None  # None: straight at the slope
    wind_mps: float
    reach_m: float  # of the profile, to either side of the crest
    half_width_m: float  # of the fence, along the ridge
    clearance_m: float  # CLEAR_MIN
    ceiling_m: float  # over the crest


class SiteDraft(NamedTuple):
    """What a site file is written from; heights and places in the soaring frame."""

    terrain: LocalTerrain
    frame: SoaringFrame
    ridge_deg: float
    wind_from_deg: float
    oblique_deg: float  # to the right of straight at the ridge
    wind_mps: float
    x_m: FloatArray  # the profile at y = 0
    z_m: FloatArray
    ground: ReducedProfile
    steepest_deg: float  # slope that faces the wind
    field: GridField  # potential flow, as it is written beside the site file
    bounds: Bounds  # of the fence in the vertical plane
    half_width_m: float
    clearance_m: float
    lines: dict[str, tuple[float, float]]
    contour: list[FloatArray]
    landing: tuple[float, float] | None  # x, z


def draft(terrain: LocalTerrain, request: Request, polar: GlidePolar) -> SiteDraft:
    """A site before the slope at the terrain's home.

    Errors: `DraftError`; `ElevationError` where heights are missing.
    """
    wind_from = _wind_from(terrain, request)
    place = SiteOrigin(name="", wind_from_deg=wind_from, ridge_deg=request.ridge_deg)
    oblique = radians(place.oblique_deg())
    frame, steepest = _crest(terrain, place, request.reach_m, polar)
    spacing = max(0.5 * terrain.elevation.spacing_m, 2.0 * request.reach_m / SAMPLES)
    half = max(10, round(request.reach_m / spacing))
    x = np.linspace(-request.reach_m, request.reach_m, 2 * half + 1)
    strips = np.linspace(-request.half_width_m, request.half_width_m, STRIPS)
    heights = heights_m(terrain, frame, *np.meshgrid(x, strips, indexing="ij"))
    z = heights[:, STRIPS // 2]
    flow = PanelField(x, z, request.wind_mps)
    bounds = _fence(flow, oblique, polar, request, x, z)
    near = (x >= bounds[0] - spacing) & (x <= bounds[1] + 0.25 * (bounds[1] - bounds[0]))
    ground = reduced(x[near], heights[near].max(axis=1))
    field = _written_field(flow, bounds, spacing)
    found, lines = _lines(oblique_field(field, oblique), polar, bounds, ground, request)
    return SiteDraft(
        terrain=terrain,
        frame=frame,
        ridge_deg=request.ridge_deg,
        wind_from_deg=wind_from,
        oblique_deg=place.oblique_deg(),
        wind_mps=request.wind_mps,
        x_m=x,
        z_m=z,
        ground=ground,
        steepest_deg=steepest,
        field=field,
        bounds=bounds,
        half_width_m=request.half_width_m,
        clearance_m=request.clearance_m,
        lines=lines,
        contour=found,
        landing=_landing(terrain, frame, x, z),
    )


def heights_m(
    terrain: LocalTerrain, frame: SoaringFrame, x_m: FloatArray, y_m: FloatArray
) -> FloatArray:
    """Heights z [m] of the ground in the soaring frame.  Errors: `ElevationError`."""
    c, s = np.cos(frame.wind_from_rad), np.sin(frame.wind_from_rad)
    north = frame.origin_north_m - c * x_m - s * y_m
    east = frame.origin_east_m - s * x_m + c * y_m
    return terrain.up_m(north, east) + frame.origin_down_m


def best_glide_slope(polar: GlidePolar) -> float:
    """The least sink for each metre forward [-]: of air at rest, the flattest glide."""
    speed = np.linspace(polar.speed_min_mps, polar.speed_max_mps, 201)
    return float((sink(polar, speed) / speed).min())


def _wind_from(terrain: LocalTerrain, request: Request) -> float:
    """Where the wind comes from [deg].  Errors: `DraftError`."""
    normals = (request.ridge_deg + 90.0, request.ridge_deg - 90.0)
    if request.wind_from_deg is not None:
        wind = request.wind_from_deg
        off = min(abs(degrees(wrap_angle(radians(wind - n)))) for n in normals)
        if off > OBLIQUE_DEG:
            raise DraftError(
                f"wind from {wind:g}° blows along the ridge ({request.ridge_deg:g}°), {off:.0f}°"
                f" off straight at it: {OBLIQUE_DEG:.0f}° at most. Check --ridge, which is the"
                " direction that the ridge runs in, or wait for another wind"
            )
        return wind % 360.0
    # The slope faces the side to which the ground falls more, near the given place.
    away = np.linspace(0.0, CREST_FRACTION * request.reach_m, 21)[1:]
    means = []
    for normal in normals:
        n, e = np.cos(radians(normal)), np.sin(radians(normal))
        means.append(float(terrain.up_m(n * away, e * away).mean()))
    if abs(means[0] - means[1]) < LANDING_SLOPE * float(away[-1]):
        raise DraftError(
            f"the ground falls by as much on either side of the ridge ({means[0]:+.1f} and"
            f" {means[1]:+.1f} m): say by --wind-from which slope is meant"
        )
    return float(normals[0] if means[0] < means[1] else normals[1]) % 360.0


def _crest(
    terrain: LocalTerrain, place: SiteOrigin, reach_m: float, polar: GlidePolar
) -> tuple[SoaringFrame, float]:
    """The frame on the crest near the home, and the steepest slope before it [deg]."""
    home = SoaringFrame(0.0, 0.0, 0.0, radians(place.facing_deg()))
    look = CREST_FRACTION * reach_m
    step = min(0.5 * terrain.elevation.spacing_m, look / 20.0)
    x = np.linspace(-look, look, 2 * ceil(look / step) + 1)
    top = int(np.argmax(heights_m(terrain, home, x, np.zeros_like(x))))
    frame = home._replace(
        origin_north_m=ned_from_soaring(home, float(x[top]), 0.0, 0.0)[0],
        origin_east_m=ned_from_soaring(home, float(x[top]), 0.0, 0.0)[1],
    )
    x = np.linspace(-reach_m, 0.0, ceil(reach_m / step) + 1)
    z = heights_m(terrain, frame, x, np.zeros_like(x))
    # Over two posts of the model: one step of a metre between neighbours is no slope.
    apart = max(1, round(2.0 * terrain.elevation.spacing_m / (x[1] - x[0])))
    steepest = float((z[apart:] - z[:-apart]).max()) / (apart * float(x[1] - x[0]))
    # Of an oblique wind only the part across the ridge follows the slope.
    least = best_glide_slope(polar) / cos(radians(place.oblique_deg()))
    if steepest < least:
        raise DraftError(
            f"no slope within {reach_m:g} m that faces a wind from {place.wind_from_deg:.0f}°: the"
            f" steepest is {degrees(np.arctan(max(0.0, steepest))):.1f}°, and air that follows it"
            f" carries this airframe from {degrees(np.arctan(least)):.1f}° on (its best glide)"
        )
    return frame._replace(origin_down_m=-float(z[-1])), degrees(np.arctan(steepest))


def _fence(
    flow: PanelField,
    oblique_rad: float,
    polar: GlidePolar,
    request: Request,
    x: FloatArray,
    z: FloatArray,
) -> Bounds:
    """Where there is lift enough for the least sink, up to the crest and the ceiling."""
    speed = np.linspace(polar.speed_min_mps, polar.speed_max_mps, 201)
    least = float(sink(polar, speed).min())
    across = np.linspace(x[0], 0.0, 81)
    up = np.linspace(float(z[x <= 0.0].min()), request.ceiling_m, 61)
    xx, zz = np.meshgrid(across, up, indexing="ij")
    _, _, w = oblique_field(flow, oblique_rad).wind(xx, 0.0, zz)
    lift = (w >= least) & (zz - flow.ground_m(xx) >= request.clearance_m)
    if not lift.any():
        raise DraftError(
            f"wind of {request.wind_mps:g} m/s: no updraft of {least:.2f} m/s, the least sink,"
            f" {request.clearance_m:g} m or more over this ground and below {request.ceiling_m:g} m"
            " over the crest: a stronger wind (--wind), another place"
        )
    x_min = floor(float(xx[lift].min()) - (across[1] - across[0]))
    z_max = min(request.ceiling_m, ceil(float(zz[lift].max()) + (up[1] - up[0])))
    lowest = float(z[(x >= x_min) & (x <= 0.0)].min())
    # Half of CLEAR_MIN above the lowest ground: recovering has had its half.
    return float(max(x_min, x[0])), 0.0, round(lowest + 0.5 * request.clearance_m, 1), z_max


def _written_field(flow: PanelField, bounds: Bounds, spacing_m: float) -> GridField:
    """The flow on a grid: of the fence and as much around it as an overshoot needs."""
    wide, high = bounds[1] - bounds[0], bounds[3] - bounds[2]
    pad = 0.15 * max(wide, high)
    step = max((wide + 2.0 * pad) / CELLS, 0.1 * spacing_m)
    x = np.arange(max(bounds[0] - pad, flow.x_m[0]), min(bounds[1] + pad, flow.x_m[-1]), step)
    z = np.arange(bounds[2] - pad, bounds[3] + pad, step)
    xx, zz = np.meshgrid(x, z, indexing="ij")
    u, _, w = flow.wind(xx, 0.0, zz)
    solid = zz < flow.ground_m(xx)
    return GridField(
        x, None, z, u, None, w, reference_wind_mps=flow.reference_wind_mps, solid=solid
    )


def _lines(
    field: WindField, polar: GlidePolar, bounds: Bounds, ground: ReducedProfile, request: Request
) -> tuple[list[FloatArray], dict[str, tuple[float, float]]]:
    """The contour within the fence, and three lines on it; a is the one farthest upwind."""
    step = (bounds[1] - bounds[0]) / 160.0
    try:
        parts = contour(field, polar, bounds, step)
    except ZeucError as error:
        raise DraftError(
            f"no contour below the ceiling: another wind (--wind), or ceiling (--ceiling); {error}"
        ) from None
    known = GroundProfile(profile=ground.points).as_ground()
    eta = eta_from_lean(radians(LEAN_DEG))
    # Room for an overshoot.
    room_x, room_z = 0.05 * (bounds[1] - bounds[0]), 0.05 * (bounds[3] - bounds[2])
    runs: list[list[tuple[float, float]]] = [[]]
    for part in parts:
        runs.append([])
        for x, z in part.tolist():
            if (
                bounds[0] + room_x <= x <= bounds[1] - room_x
                and bounds[2] <= z <= bounds[3] - room_z
                and clearance(known, x, z) >= 1.5 * request.clearance_m
                and stable_crossing(field, polar, (x, z, eta), reach_m=2.0) is not None
            ):
                runs[-1].append((x, z))
            elif runs[-1]:
                runs.append([])
    best = max(runs, key=_length)
    if len(best) < 2:
        raise DraftError(
            f"wind of {request.wind_mps:g} m/s: nowhere within the fence, below"
            f" {request.ceiling_m:g} m over the crest and 1.5 x {request.clearance_m:g} m off the"
            f" ground, does this airframe settle on a line that leans by {LEAN_DEG:g}°: another"
            " wind (--wind), a higher ceiling (--ceiling)"
        )
    return parts, _along(best, 2.0 * request.clearance_m)


def _length(run: list[tuple[float, float]]) -> float:
    return sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(run))


def _along(run: list[tuple[float, float]], most_m: float) -> dict[str, tuple[float, float]]:
    """Three lines about the middle of a run: a quarter of it apart, and no more than that.

    a lies the farthest upwind.
    """
    x, z = np.array(run if run[0][0] <= run[-1][0] else run[::-1]).T
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    apart = min(0.25 * float(along[-1]), most_m)
    places = {n: 0.5 * along[-1] + k * apart for n, k in (("a", -1), ("b", 0), ("c", 1))}
    return {
        n: (round(float(np.interp(s, along, x)), 2), round(float(np.interp(s, along, z)), 2))
        for n, s in places.items()
    }


def _landing(
    terrain: LocalTerrain, frame: SoaringFrame, x: FloatArray, z: FloatArray
) -> tuple[float, float] | None:
    """The nearest level place below the middle of the slope; None: the profile has none."""
    half = 0.5 * LANDING_LENGTH_M
    low = 0.5 * float(z[x <= 0.0].min())
    around = np.array([-half, 0.0, half])
    for at in np.flatnonzero((x < 0.0) & (z <= low) & (x - half >= x[0]))[::-1]:
        place = float(x[at])
        along = heights_m(terrain, frame, place + around, np.zeros(3))
        across = heights_m(terrain, frame, np.full(3, place), around)
        rises = np.abs(np.concatenate([np.diff(along), np.diff(across)]))
        if rises.max() <= LANDING_SLOPE * half:
            return place, float(z[at])
    return None


def farthest(lines: dict[str, tuple[float, float]]) -> float:
    """The greatest distance [m] between two lines' points."""
    points = list(lines.values())
    return max((hypot(a[0] - b[0], a[1] - b[1]) for a in points for b in points), default=inf)

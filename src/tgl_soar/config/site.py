"""The site file: where it flies.

The soaring frame, the sources of position, the lines, what is known of ground and contour, and the
air that the simulation blows.
"""

from __future__ import annotations

import ipaddress
import itertools
from math import dist, radians
from pathlib import Path
from typing import Annotated, Final, Literal

from msgspec import Meta, field

from tgl_soar.config.line_changes import Contour
from tgl_soar.config.strict import Finite, Positive, Strict, SystemId
from tgl_soar.geometry import HallFrame, SoaringFrame
from tgl_soar.types import GROUND_POINTS, NO_GROUND, Ground

UPWIND_DEG: Final = 60.0  # as `control.landing` limits it
# Of the wind to the ridge's normal.  Beyond it hardly any of the wind is lifted, and one beats
# along the ridge instead, which is no hovering.
OBLIQUE_DEG: Final = 45.0


class Line(Strict, frozen=True):
    """A named target gradient line."""

    x_m: Finite
    z_m: Finite
    lean_deg: Annotated[float, Meta(ge=-60, le=60)] | None = None  # default: TGL_LEAN


class KnownContour(Strict, frozen=True):
    """Where excess updraft is zero, computed beforehand by `tgl-soar site contour`."""

    airframe: str  # name of the airframe whose polar it was computed with
    parts: list[list[tuple[Finite, Finite]]]  # x, z [m]; rising air is on the left

    def __post_init__(self) -> None:
        if any(len(part) < 2 for part in self.parts):
            raise ValueError("each of parts needs two points or more")


class GroundProfile(Strict, frozen=True):
    """The ground or the board in the vertical plane: what the aircraft keeps away from."""

    profile: Annotated[list[tuple[Finite, Finite]], Meta(min_length=1, max_length=GROUND_POINTS)]

    def __post_init__(self) -> None:
        if any(a[0] >= b[0] for a, b in itertools.pairwise(self.profile)):
            raise ValueError("profile must grow in x from point to point")

    def as_ground(self) -> Ground:
        """As the envelope takes it."""
        points = [*self.profile, *[self.profile[-1]] * (GROUND_POINTS - len(self.profile))]
        a, b, c, d, e, f, g, h = (x for x, _ in points)
        i, j, k, m, n, o, p, q = (z for _, z in points)
        return Ground(len(self.profile), (a, b, c, d, e, f, g, h), (i, j, k, m, n, o, p, q))


class SiteOrigin(Strict, frozen=True):
    """Where the soaring frame stands in local NED."""

    name: str
    origin_north_m: Finite = 0.0
    origin_east_m: Finite = 0.0
    origin_down_m: Finite = 0.0
    wind_from_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    # The direction that the ridge runs in: the frame, and with it the line's plane, then stands
    # across the ridge, and the wind comes from beside its axis.  None: it stands across the wind.
    ridge_deg: Annotated[float, Meta(ge=-360, le=360)] | None = None

    def facing_deg(self) -> float:
        """Where the soaring frame looks to, from north: into the wind or straight off the ridge."""
        if self.ridge_deg is None:
            return self.wind_from_deg
        normal = self.ridge_deg + 90.0
        ahead = abs(_off_deg(self.wind_from_deg, normal)) <= 90.0
        return (normal if ahead else normal + 180.0) % 360.0

    def oblique_deg(self) -> float:
        """How far to the right of there the wind comes from; zero without a ridge."""
        return _off_deg(self.wind_from_deg, self.facing_deg())


def _off_deg(direction_deg: float, from_deg: float) -> float:
    return (direction_deg - from_deg + 180.0) % 360.0 - 180.0


class TurbulenceSettings(Strict, frozen=True):
    """Dryden turbulence on top of the mean field."""

    intensity: Annotated[float, Meta(ge=0, le=0.5)] = 0.0  # of the reference wind
    length_scale_m: Positive = 1.5
    roll_gusts: bool = True  # it rolls the aircraft too, as MIL-F-8785C has it


class JetAir(Strict, frozen=True, tag_field="kind", tag="jet"):
    """A sloped board in an open wind-tunnel jet."""

    wind_mps: Annotated[float, Meta(ge=5, le=15)]
    slope_deg: Annotated[float, Meta(ge=15, le=35)]
    turbulence: TurbulenceSettings = TurbulenceSettings()


class HillAir(Strict, frozen=True, tag_field="kind", tag="hill"):
    """Potential flow over a half-cylinder whose axis lies at the frame's origin."""

    wind_mps: Annotated[float, Meta(ge=1, le=30)]
    radius_m: Positive
    record: str | None = None  # a wind record (docs/sites.md) beside the site file; None: steady
    turbulence: TurbulenceSettings = TurbulenceSettings()


Sign = Literal[-1, 1]


class GridLayout(Strict, frozen=True):
    """What the columns or variables of a file are called, their signs, origin and units."""

    x: str = "x"
    z: str = "z"
    u: str = "u"
    w: str = "w"
    y: str | None = None  # None: a two-dimensional field
    v: str | None = None  # None: no cross wind
    x_sign: Sign = 1
    u_sign: Sign = 1
    y_sign: Sign = 1
    v_sign: Sign = 1
    origin_x_m: Finite = 0.0  # where the soaring frame's origin lies in the file's axes
    origin_y_m: Finite = 0.0
    origin_z_m: Finite = 0.0
    metres_per_length: Positive = 1.0
    mps_per_speed: Positive = 1.0


class GridAir(Strict, frozen=True, tag_field="kind", tag="grid"):
    """A field read from a file, named from the folder of the site file."""

    file: str
    wind_mps: Positive  # reference wind: turbulence is a fraction of it
    layout: GridLayout = GridLayout()
    zero_cells: Literal["refuse", "solid", "air"] = "refuse"  # nodes with exactly no wind
    mesh_step_m: Positive | None = None  # VTK and OpenFOAM: spacing at which they are sampled
    record: str | None = None  # a wind record beside the site file; None: steady
    turbulence: TurbulenceSettings = TurbulenceSettings()


class PolynomialAir(Strict, frozen=True, tag_field="kind", tag="polynomial"):
    """Wind as a polynomial of position, fitted to another air over a box of the vertical plane."""

    of: JetAir | HillAir | GridAir
    degree: Annotated[int, Meta(ge=1, le=12)]
    x_m: tuple[Finite, Finite]  # the box: from, to
    z_m: tuple[Finite, Finite]
    step_m: Annotated[float, Meta(ge=0.001, le=1000)] = 0.05  # between the places of the fit
    turbulence: TurbulenceSettings = TurbulenceSettings()

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("z_m", self.z_m)):
            if not low < high:
                raise ValueError(f"{name} = [{low:g}, {high:g}]: must be from, to, growing")
        if self.of.turbulence != TurbulenceSettings():
            raise ValueError("of.turbulence: the polynomial is of calm air; give it to [air]")
        if not isinstance(self.of, JetAir) and self.of.record is not None:
            raise ValueError("of.record: a polynomial is of a steady wind; leave it out")

    @property
    def wind_mps(self) -> float:
        """The reference wind of the air that is followed."""
        return self.of.wind_mps


def air_files(air: JetAir | HillAir | GridAir | PolynomialAir, folder: Path) -> list[Path]:
    """The files that an air names, from the folder of the site file."""
    if isinstance(air, PolynomialAir):
        return air_files(air.of, folder)
    names = [getattr(air, key, None) for key in ("file", "record")]
    return [folder / name for name in names if name is not None]


class Start(Strict, frozen=True):
    """Where the simulated aircraft is released, at rest over the ground."""

    x_m: Finite
    z_m: Finite
    y_m: Finite = 0.0


class LandingStrip(Strict, frozen=True):
    """Where to land, and how to get away from the slope."""

    x_m: Finite  # where to touch down, soaring frame
    z_m: Finite
    bearing_deg: Annotated[float, Meta(ge=-360, le=360)]  # of the approach, from north
    length_m: Annotated[float, Meta(gt=0, le=500)]  # of the strip about that point
    away_x_m: Finite  # upstream of this the slope is left behind
    y_m: Finite = 0.0
    escape_deg: Annotated[float, Meta(ge=-360, le=360)] | None = None  # None: as the approach

    def parameters(self) -> dict[str, float]:
        """As the module takes it."""
        return {name: getattr(self, key) for name, key in self.keys().items()}

    def keys(self) -> dict[str, str]:
        """Of each of these, the key that gives it."""
        return {
            "LND_X": "x_m",
            "LND_Y": "y_m",
            "LND_Z": "z_m",
            "LND_BEAR": "bearing_deg",
            "LND_LEN": "length_m",
            "ESC_BEAR": "bearing_deg" if self.escape_deg is None else "escape_deg",
            "ESC_X": "away_x_m",
        }


class Tether(Strict, frozen=True):
    """A line from a fixed point to the simulated aircraft, which pulls while it is taut."""

    x_m: Finite  # the point, soaring frame
    z_m: Finite
    length_m: Annotated[float, Meta(gt=0, le=1000)]
    y_m: Finite = 0.0
    # A metre of elastic in it: 5 cm for the weight of a small aircraft. A step of 5 ms can follow
    # up to 1000 N/m with half a kilogram.
    stiffness_npm: Annotated[float, Meta(ge=1, le=1000)] = 140.0


class HomePosition(Strict, frozen=True):
    """Where the origin of local NED lies on the earth."""

    latitude_deg: Annotated[float, Meta(ge=-90, le=90)]
    longitude_deg: Annotated[float, Meta(ge=-180, le=180)]
    altitude_m: Annotated[float, Meta(ge=-500, le=9000)]  # above mean sea level


class Sender(Strict, frozen=True):
    """A MAVLink system and component."""

    system: SystemId
    component: SystemId


class PositionSettings(Strict, frozen=True):
    """Where the position comes from."""

    # As `link.sources` names them, the most trusted first.
    sources: list[Literal["local_position", "odometry", "global_position", "vision", "mocap"]] = (
        field(default_factory=lambda: ["local_position", "odometry"])
    )
    silence_s: Annotated[float, Meta(ge=0.02, le=2)] = 0.15  # then another source takes over
    return_s: Annotated[float, Meta(ge=0, le=60)] = 2.0  # steady for so long before taken back
    home: HomePosition | None = None  # for global_position
    # Whose VISION_POSITION_ESTIMATE is accepted.
    vision_from: list[Sender] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.sources or len(set(self.sources)) != len(self.sources):
            raise ValueError("sources: name one or more, each once")
        if "global_position" in self.sources and self.home is None:
            raise ValueError(
                'sources = ["global_position", ...]: needs home = { latitude_deg, longitude_deg,'
                " altitude_m }, the origin of local NED"
            )
        if "vision" in self.sources and not self.vision_from:
            raise ValueError(
                'sources = ["vision", ...]: needs vision_from = [{ system, component }], whose'
                " positions are accepted"
            )


class Forward(Strict, frozen=True):
    """Telling the autopilot the position that a tracker has measured."""

    message: Literal["vision_position_estimate", "odometry"] = "vision_position_estimate"
    rate_hz: Annotated[float, Meta(ge=5, le=100)] = 40.0  # EKF2 and EKF3 want 30 to 50
    # Standard deviations; of the position where the source does not tell its own.
    sigma_m: Annotated[float, Meta(ge=1e-4, le=10)] | None = None
    sigma_deg: Annotated[float, Meta(ge=0.01, le=45)] = 1.0


Port = Annotated[int, Meta(ge=1, le=65535)]


class Mocap(Strict, frozen=True):
    """OptiTrack: where Motive streams, what of it is flown with, and how the hall's axes lie."""

    server: Annotated[str, Meta(min_length=1)]  # address or name, or "discover"
    # Its name in Motive, or its streaming id.
    body: Annotated[str, Meta(min_length=1)] | Annotated[int, Meta(ge=0, le=2**31 - 1)]
    stream: Literal["multicast", "unicast"] = "multicast"  # as Motive's streaming pane says
    interface: str = ""  # own address on the network of the cameras; "": the system chooses
    group: str = "239.255.42.99"
    command_port: Port = 1510
    data_port: Port = 1511
    up: Literal["y", "z"] = "y"
    yaw_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0  # the hall's x axis, from north to east
    offset_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)  # the hall's origin in local NED
    noise_m: Annotated[float, Meta(ge=1e-5, le=1)] = 0.001  # standard deviation, at least
    max_error_m: Annotated[float, Meta(gt=0, le=1)] = 0.02  # mean marker error
    max_speed_mps: Annotated[float, Meta(ge=1, le=100)] = 25.0  # what is faster is a jump
    max_age_s: Annotated[float, Meta(ge=0.01, le=1)] = 0.3
    max_rate_hz: Annotated[float, Meta(ge=10, le=1000)] = 200.0
    attitude: bool = False  # flown with too, in place of the autopilot's

    def __post_init__(self) -> None:
        if not _is_address(self.group) or not ipaddress.IPv4Address(self.group).is_multicast:
            raise ValueError(
                f"group {self.group!r}: must be a multicast address, 224.0.0.0 to 239.255.255.255"
            )
        if self.interface and not _is_address(self.interface):
            raise ValueError(
                f"interface {self.interface!r}: must be an IPv4 address of this computer"
            )

    def hall(self) -> HallFrame:
        """Where the hall's axes stand in local NED."""
        north, east, down = self.offset_m
        return HallFrame(
            z_up=self.up == "z",
            yaw_rad=radians(self.yaw_deg),
            origin_north_m=north,
            origin_east_m=east,
            origin_down_m=down,
        )


def _is_address(text: str) -> bool:
    try:
        ipaddress.IPv4Address(text)
    except ValueError:
        return False
    return True


class Site(Strict, frozen=True):
    """One site file."""

    site: SiteOrigin
    position: PositionSettings = PositionSettings()
    forward: Forward | None = None  # None: nothing is forwarded to the autopilot
    mocap: Mocap | None = None
    lines: dict[str, Line] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    air: JetAir | HillAir | GridAir | PolynomialAir | None = None
    start: Start | None = None
    tether: Tether | None = None
    contour: KnownContour | None = None
    ground: GroundProfile | None = None
    landing: LandingStrip | None = None

    def __post_init__(self) -> None:
        if ("mocap" in self.position.sources) != (self.mocap is not None):
            raise ValueError(
                "position.sources names mocap where there is a [mocap] table, and only there"
            )
        self._check_ridge()
        if self.landing is not None:
            self._check_bearings(self.landing)
        start, tether = self.start, self.tether
        if start is not None and tether is not None:
            apart_m = dist((start.x_m, start.y_m, start.z_m), (tether.x_m, tether.y_m, tether.z_m))
            if apart_m > tether.length_m:
                raise ValueError(
                    f"tether.length_m = {tether.length_m:g}: must reach [start], {apart_m:.2f} m"
                    " away from its fixed point"
                )

    def _check_ridge(self) -> None:
        ridge, oblique = self.site.ridge_deg, abs(self.site.oblique_deg())
        air = self.air.of if isinstance(self.air, PolynomialAir) else self.air
        if ridge is not None and isinstance(air, JetAir):
            raise ValueError(f"site.ridge_deg = {ridge:g}: a jet has no ridge; leave it out")
        if oblique > OBLIQUE_DEG:
            raise ValueError(
                f"site.ridge_deg = {ridge:g}: the wind from {self.site.wind_from_deg:g} deg blows"
                f" along it, {oblique:g} deg off straight at it; at most {OBLIQUE_DEG:g} deg"
            )

    def _check_bearings(self, landing: LandingStrip) -> None:
        for name in ("bearing_deg", "escape_deg"):
            bearing = getattr(landing, name)
            if bearing is None:
                continue
            off_deg = abs(_off_deg(bearing, self.site.facing_deg()))
            if off_deg > UPWIND_DEG:
                wind, of = (
                    ("the wind", "wind_from_deg")
                    if self.site.ridge_deg is None
                    else ("straight off the ridge", f"{self.site.facing_deg():g} deg")
                )
                raise ValueError(
                    f"landing.{name} = {bearing:g}: {off_deg:g} deg from {wind}; it must be"
                    f" within {UPWIND_DEG:g} deg of {of}, for nothing else is reached"
                    " without a propeller"
                )

    def frame(self) -> SoaringFrame:
        """The soaring frame of this site."""
        place = self.site
        return SoaringFrame(
            place.origin_north_m,
            place.origin_east_m,
            place.origin_down_m,
            radians(place.facing_deg()),
        )

    def known_ground(self) -> Ground:
        """The ground as the envelope takes it; empty if the file does not give it."""
        return NO_GROUND if self.ground is None else self.ground.as_ground()

    def contour_for(self, airframe: str) -> Contour:
        """The contour as `line_changes` takes it; empty if none is known for this airframe."""
        if self.contour is None or self.contour.airframe != airframe:
            return ()
        return tuple(tuple(part) for part in self.contour.parts)

    def contour_words(self, airframe: str) -> str:
        """Why no line is checked against the contour, and the way out; "": it is, or there is none
        that was meant to be."""
        if self.contour is None or self.contour.airframe == airframe:
            return ""
        return (
            f"no line is checked: the site's contour is of {self.contour.airframe!r}, the airframe"
            f" is {airframe!r}: put what `tgl-soar site contour` prints for it into the site file,"
            " in place of [contour]"
        )

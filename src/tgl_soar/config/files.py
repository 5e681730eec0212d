"""Airframe and site files: strict TOML to validated objects.

An airframe file says what flies: its autopilot, which channel moves which surface and which
way, its gains, its glide polar, and the coefficients that the simulation needs.  A site file
says where: the soaring frame, the lines, and the air that the simulation blows.  Both may
carry `[parameters]`, by the very names of `tgl_soar.config.parameters`: defaults, then airframe,
then site.

Everything unknown, missing or out of range is a `ConfigError` naming file, key, value and
what is allowed.
"""

from __future__ import annotations

import ipaddress
import itertools
import re
import tomllib
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct, inspect

from tgl_soar.config.line_changes import Contour, PresetLine, Presets, with_changes
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.geometry import HallFrame, SoaringFrame
from tgl_soar.types import (
    GROUND_POINTS,
    NO_AERODYNAMICS,
    NO_GROUND,
    Aerodynamics,
    GlidePolar,
    Ground,
)


class ConfigError(ValueError):
    """A configuration file that cannot be used; the message names file, key and way out."""


Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
SystemId = Annotated[int, Meta(ge=1, le=255)]
Pwm = Annotated[int, Meta(ge=800, le=2200)]
Channel = Annotated[int, Meta(ge=1, le=18)]


class Strict(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a configuration file: what it does not know, it refuses."""


class Surface(Strict, frozen=True):
    """How one normalised deflection becomes a channel's pulse width."""

    channel: Channel
    pwm_min: Pwm = 1100  # at deflection -1 (+1 where reversed)
    pwm_trim: Pwm = 1500
    pwm_max: Pwm = 1900
    reversed: bool = False

    def __post_init__(self) -> None:
        if not self.pwm_min < self.pwm_trim < self.pwm_max:
            raise ValueError(
                f"pwm_min {self.pwm_min} < pwm_trim {self.pwm_trim} < pwm_max {self.pwm_max}"
                " must hold"
            )


class Surfaces(Strict, frozen=True):
    """The three surfaces of the aircraft."""

    elevator: Surface
    aileron: Surface
    rudder: Surface

    def __post_init__(self) -> None:
        channels = [s.channel for s in (self.elevator, self.aileron, self.rudder)]
        if len(set(channels)) != len(channels):
            raise ValueError(f"two surfaces share a channel: {channels}")


# Who is an operator unless the airframe file says otherwise: the ids that ground stations use
# (MAVSDK's 245, and 255 of QGroundControl, Mission Planner and MAVProxy) with a few beside it.
OPERATORS: Final = frozenset((245, *range(250, 256)))


class AutopilotLink(Strict, frozen=True):
    """The autopilot that moves the surfaces, and the identities used towards it."""

    firmware: Literal["ardupilot", "px4", "paparazzi", "bridge"]
    route: str | None = None  # by which it is commanded; None: the firmware's usual one
    system_id: SystemId = 1
    component_id: Annotated[int, Meta(ge=2, le=255)] = 191  # 1 is the autopilot itself
    override_system_id: SystemId = 255  # what the firmware's SYSID_MYGCS names
    operators: frozenset[SystemId] = OPERATORS  # who may set parameters and command
    # The message that brings accelerations; "usual" is what the firmware does best.
    imu: Literal["usual", "raw_imu", "scaled_imu", "highres_imu", "none"] = "usual"


class AirframeMetadata(Strict, frozen=True):
    """What can be read off the bench."""

    name: str
    mass_kg: Positive
    wing_area_m2: Positive
    span_m: Positive
    chord_m: Positive
    ixx_kgm2: Positive
    iyy_kgm2: Positive
    izz_kgm2: Positive


class Polar(Strict, frozen=True):
    """The glide polar, as in `types.GlidePolar`."""

    c0: Finite
    c1: Finite
    c2: Finite
    c3: Finite
    speed_min_mps: Positive
    speed_max_mps: Positive

    def __post_init__(self) -> None:
        if not self.speed_min_mps < self.speed_max_mps:
            raise ValueError("speed_min_mps must be below speed_max_mps")

    def as_polar(self) -> GlidePolar:
        """The polar that the laws and the contour take."""
        return GlidePolar(
            c0=self.c0,
            c1=self.c1,
            c2=self.c2,
            c3=self.c3,
            speed_min_mps=self.speed_min_mps,
            speed_max_mps=self.speed_max_mps,
        )


class Airframe(Strict, frozen=True):
    """One airframe file."""

    airframe: AirframeMetadata
    autopilot: AutopilotLink
    surfaces: Surfaces
    polar: Polar
    parameters: dict[str, float] = {}
    model: dict[str, Finite] = {}  # the simulation's; checked by tgl_soar.sim.aircraft

    def __post_init__(self) -> None:
        for key in _POSITIVE:
            if not self.model.get(key, 1.0) > 0.0:
                raise ValueError(f"model.{key} = {self.model[key]:g}: must be above 0")

    def aerodynamics(self) -> Aerodynamics:
        """Lift and drag as the flying module knows them; `NO_AERODYNAMICS` without a model."""
        model, facts = self.model, self.airframe
        if not all(key in model for key in _AERODYNAMIC):
            return NO_AERODYNAMICS
        known = {**{key: getattr(facts, key) for key in _ON_THE_BENCH}, **model}
        figures = (known[name] for name in Aerodynamics._fields if name != "polar")
        return Aerodynamics._make((*figures, self.polar.as_polar()))


_ON_THE_BENCH: Final = ("mass_kg", "wing_area_m2", "chord_m")
_AERODYNAMIC: Final = tuple(
    name for name in Aerodynamics._fields if name != "polar" and name not in _ON_THE_BENCH
)
_POSITIVE: Final = (
    "gravity_mps2",
    "air_density_kgpm3",
    "CL_alpha",
    "stall_alpha_rad",
    "stall_width_rad",
    "CD0",
)


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


class Place(Strict, frozen=True):
    """Where the soaring frame stands in local NED."""

    name: str
    origin_north_m: Finite = 0.0
    origin_east_m: Finite = 0.0
    origin_down_m: Finite = 0.0
    wind_from_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0


class Turbulence(Strict, frozen=True):
    """Dryden turbulence on top of the mean field."""

    intensity: Annotated[float, Meta(ge=0, le=0.5)] = 0.0  # of the reference wind
    length_scale_m: Positive = 1.5


class JetAir(Strict, frozen=True, tag_field="kind", tag="jet"):
    """A sloped board in an open wind-tunnel jet."""

    wind_mps: Annotated[float, Meta(ge=5, le=15)]
    slope_deg: Annotated[float, Meta(ge=15, le=35)]
    turbulence: Turbulence = Turbulence()


class HillAir(Strict, frozen=True, tag_field="kind", tag="hill"):
    """Potential flow over a half-cylinder whose axis lies at the frame's origin."""

    wind_mps: Annotated[float, Meta(ge=1, le=30)]
    radius_m: Positive
    turbulence: Turbulence = Turbulence()


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
    turbulence: Turbulence = Turbulence()


class Start(Strict, frozen=True):
    """Where the simulated aircraft is let go, at rest over the ground."""

    x_m: Finite
    z_m: Finite
    y_m: Finite = 0.0


class HomePosition(Strict, frozen=True):
    """Where the origin of local NED lies on the earth."""

    latitude_deg: Annotated[float, Meta(ge=-90, le=90)]
    longitude_deg: Annotated[float, Meta(ge=-180, le=180)]
    altitude_m: Annotated[float, Meta(ge=-500, le=9000)]  # above mean sea level


class Sender(Strict, frozen=True):
    """A MAVLink system and component."""

    system: SystemId
    component: SystemId


class Position(Strict, frozen=True):
    """Where the position comes from."""

    # As `link.sources` names them, the most trusted first.
    sources: list[Literal["local_position", "odometry", "global_position", "vision", "mocap"]] = (
        msgspec.field(default_factory=lambda: ["local_position", "odometry"])
    )
    silence_s: Annotated[float, Meta(ge=0.02, le=2)] = 0.15  # then another source takes over
    return_s: Annotated[float, Meta(ge=0, le=60)] = 2.0  # steady for so long before taken back
    home: HomePosition | None = None  # for global_position
    vision_from: list[Sender] = []  # whose VISION_POSITION_ESTIMATE is believed

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
                " positions are believed"
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
        return HallFrame(self.up == "z", radians(self.yaw_deg), *self.offset_m)


def _is_address(text: str) -> bool:
    try:
        ipaddress.IPv4Address(text)
    except ValueError:
        return False
    return True


class Site(Strict, frozen=True):
    """One site file."""

    site: Place
    position: Position = Position()
    forward: Forward | None = None  # None: the autopilot is told nothing
    mocap: Mocap | None = None
    lines: dict[str, Line] = {}
    parameters: dict[str, float] = {}
    air: JetAir | HillAir | GridAir | None = None
    start: Start | None = None
    contour: KnownContour | None = None
    ground: GroundProfile | None = None

    def __post_init__(self) -> None:
        if ("mocap" in self.position.sources) != (self.mocap is not None):
            raise ValueError(
                "position.sources names mocap where there is a [mocap] table, and only there"
            )

    def frame(self) -> SoaringFrame:
        """The soaring frame of this site."""
        place = self.site
        return SoaringFrame(
            place.origin_north_m,
            place.origin_east_m,
            place.origin_down_m,
            radians(place.wind_from_deg),
        )

    def known_ground(self) -> Ground:
        """The ground as the envelope takes it; empty if the file does not give it."""
        return NO_GROUND if self.ground is None else self.ground.as_ground()

    def contour_for(self, airframe: str) -> Contour:
        """The contour as `line_changes` takes it; empty if none is known for this airframe."""
        if self.contour is None or self.contour.airframe != airframe:
            return ()
        return tuple(tuple(part) for part in self.contour.parts)


_File = TypeVar("_File", bound=Struct)


def shipped(name: str) -> Path:
    """A file of `config/`: of the source tree, or of the installed package."""
    installed = Path(__file__).parents[1] / "_config"
    folder = installed if installed.is_dir() else Path(__file__).parents[3] / "config"
    return folder / name


def manual() -> Path:
    """The folder of the manual's pages: of the source tree, or of the installed package."""
    installed = Path(__file__).parents[1] / "docs"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "docs"


_AIRFRAMES: Final = "airframes"
_SITES: Final = "sites"


def airframe_file(given: str | Path) -> Path:
    """The airframe file that an option means: a file or, where there is none, a shipped name."""
    return _meant(given, _AIRFRAMES)


def site_file(given: str | Path) -> Path:
    """The site file that an option means: a file or, where there is none, a shipped name."""
    return _meant(given, _SITES)


def shipped_names(folder: str) -> tuple[str, ...]:
    """What may stand for a file of a folder of `config/`."""
    return tuple(sorted(path.stem for path in shipped(folder).glob("*.toml")))


def _meant(given: str | Path, folder: str) -> Path:
    """A file comes first; what is neither file nor name is left for the loader to refuse."""
    if str(given) in shipped_names(folder) and not Path(given).is_file():
        return shipped(folder) / f"{given}.toml"
    return Path(given)


def load_airframe(path: str | Path) -> Airframe:
    """Read an airframe file.  Errors: `ConfigError`."""
    airframe = load_file(path, Airframe, _AIRFRAMES)
    _check_parameters(path, ParameterSet(), airframe.parameters)
    return airframe


def load_site(path: str | Path) -> Site:
    """Read a site file.  Errors: `ConfigError`."""
    return load_file(path, Site, _SITES)


def load_parameters(
    airframe: Airframe, airframe_path: str | Path, site: Site, site_path: str | Path
) -> ParameterSet:
    """Defaults, then the airframe's values, then the site's.  Errors: `ConfigError`."""
    values = _check_parameters(airframe_path, ParameterSet(), airframe.parameters)
    _check_switch(airframe_path, values, airframe)
    values = _check_parameters(site_path, values, site.parameters, preset_lines(site, values))
    _check_switch(site_path, values, airframe)
    for name, line in site.lines.items():
        try:
            values.changed(line_parameters(line))
        except ParameterError as error:
            key = f"lines.{name}.{_LINE_KEYS[error.name]}"
            raise ConfigError(f"{site_path}: {key} = {error.value}: {error.reason}") from None
    return values


def preset_lines(site: Site, values: ParameterSet) -> Presets:
    """The site's lines for TGL_PRESET; one without a lean of its own has that of the files."""
    lean = site.parameters.get("TGL_LEAN", values["TGL_LEAN"])
    return tuple(
        PresetLine(name, line.x_m, line.z_m, lean if line.lean_deg is None else line.lean_deg)
        for name, line in site.lines.items()
    )


def switch_refusal(channel: float, surface_channels: frozenset[int]) -> str:
    """Why a channel cannot be the pilot's switch; "" if it can."""
    if channel not in surface_channels:
        return ""
    # Plain letters: it is also sent as a STATUSTEXT.
    taken = ", ".join(map(str, sorted(surface_channels)))
    return f"this channel moves a surface: 1 to 18 but none of {taken}; 0: no switch"


def _check_switch(path: str | Path, values: ParameterSet, airframe: Airframe) -> None:
    surfaces = airframe.surfaces
    driven = frozenset(s.channel for s in (surfaces.elevator, surfaces.aileron, surfaces.rudder))
    if refusal := switch_refusal(values["OP_RC_CHAN"], driven):
        channel = values["OP_RC_CHAN"]
        raise ConfigError(f"{path}: parameters.OP_RC_CHAN = {channel:g}: {refusal}")


_LINE_KEYS: Final = {"TGL_X": "x_m", "TGL_Z": "z_m", "TGL_LEAN": "lean_deg"}


def line_parameters(line: Line) -> dict[str, float]:
    """The parameters that put the target gradient line on a named line."""
    changes = {"TGL_X": line.x_m, "TGL_Z": line.z_m}
    if line.lean_deg is not None:
        changes["TGL_LEAN"] = line.lean_deg
    return changes


def _check_parameters(
    path: str | Path, values: ParameterSet, changes: Mapping[str, float], presets: Presets = ()
) -> ParameterSet:
    try:
        for name, value in changes.items():
            if name in INDEX and not PARAMETERS[INDEX[name]].in_files:
                raise ParameterError(name, value, _OVER_THE_AIR)
        result = with_changes(values, changes, presets)
        wanted = changes.get("TGL_PRESET", result["TGL_PRESET"])
        if result["TGL_PRESET"] != wanted:
            raise ParameterError("TGL_PRESET", f"{wanted:g}", _TWO_LINES)
    except ParameterError as error:
        raise ConfigError(f"{path}: parameters.{error}") from None
    return result


_OVER_THE_AIR: Final = "not from a file: it is the operator's, over the air; remove it here"
_TWO_LINES: Final = "TGL_X or TGL_Z beside it put the line elsewhere: give one or the other"


def load_file(path: str | Path, kind: type[_File], folder: str = "") -> _File:
    """Read a TOML file of one kind.  Errors: `ConfigError`.

    folder: of `config/`, whose names might have been meant where there is no such file.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        why = error.strerror or str(error)
        if folder and isinstance(error, FileNotFoundError):
            why += f"; known by name: {', '.join(shipped_names(folder))}"
        raise ConfigError(f"{path}: cannot be read: {why}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text: {error.reason}") from None
    return _converted(text, path, kind)


def site_from(text: str, name: str) -> Site:
    """A site file's text, as a log holds it; name: what errors call it.  Errors: `ConfigError`."""
    return _converted(text, name, Site)


def airframe_from(text: str, name: str) -> Airframe:
    """An airframe file's text, likewise.  Errors: `ConfigError`."""
    airframe = _converted(text, name, Airframe)
    _check_parameters(name, ParameterSet(), airframe.parameters)
    return airframe


def _converted(text: str, path: str | Path, kind: type[_File]) -> _File:
    table = _table(text, path)
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {_plainly(str(error), table, kind)}") from None


def _table(text: str, path: str | Path) -> dict[str, Any]:
    try:
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError:
            raise
        except ValueError:  # a number of more digits than Python reads: no value may be so large
            return tomllib.loads(_TOO_LONG.sub(_BEYOND_ALL, text))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None


_TOO_LONG: Final = re.compile(r"\b\d(?:_?\d){999,}\b")
_BEYOND_ALL: Final = "9" * 1001  # of no allowed range, so that the usual error names key and range


# --- what is wrong, in the file's own words -------------------------------------------------
# msgspec says "Object contains unknown field `f` - at `$.a.b`" or "Expected `int` <= 18 - at
# `$.a.b.c`"; an operator wants the key as written, the value, and all that is allowed there.

_FIELD: Final = re.compile(r"Object (missing required|contains unknown) field `(.*)`")
_STEP: Final = re.compile(r"\.([^.\[]+)|\[([^\]]+)\]")

_Keys = list[str | int]


def _plainly(message: str, table: dict[str, Any], kind: type[Struct]) -> str:
    """The key, its value, and what is allowed there."""
    what, _, where = message.partition(" - at `$")
    keys = _keys_of(message, where, table, kind)
    expected = _type_at(keys, table, kind)
    if field := _FIELD.fullmatch(what):
        keys.append(field[2])
        if field[1] == "contains unknown":
            return f"{_path(keys)}: unknown key; known here: {_known(expected)}"
        return f"{_path(keys)}: missing; must be {_allowed(_type_at(keys, table, kind))}"
    if not (what.startswith(("Expected", "Invalid")) or what == "Number out of range"):
        return f"{_path(keys)}: {what}" if keys else what  # one of our own checks
    value = _value_at(keys, table)
    if keys[:-1] == ["parameters"] and what.startswith("Expected"):
        try:
            ParameterSet().changed({str(keys[1]): value})
        except ParameterError as error:
            return f"parameters.{error}"
    return f"{_path(keys)} = {_shown(value)}: must be {_allowed(expected)}"


def _path(keys: _Keys) -> str:
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys).lstrip(".")


def _keys_of(message: str, where: str, table: dict[str, Any], kind: type[Struct]) -> _Keys:
    """The path to what is wrong.  For a freely chosen name msgspec writes [...]: that name is
    the first whose entry alone is refused with the same message."""
    keys: _Keys = []
    for name, bracket in _STEP.findall(where):
        if name:
            keys.append(name.removesuffix("`"))
        elif bracket != "...":
            keys.append(int(bracket))
        else:
            for free, entry in _value_at(keys, table).items():
                try:
                    msgspec.convert(_replaced(table, keys, {free: entry}), kind)
                except msgspec.ValidationError as error:
                    if str(error) == message:
                        keys.append(free)
                        break
    return keys


def _value_at(keys: _Keys, table: Any) -> Any:
    for key in keys:
        table = table[key]
    return table


def _replaced(table: Any, keys: _Keys, value: object) -> Any:
    """A copy of the table with the value at the path."""
    if not keys:
        return value
    copy = table.copy()
    copy[keys[0]] = _replaced(table[keys[0]], keys[1:], value)
    return copy


def _type_at(keys: _Keys, table: dict[str, Any], kind: type[Struct]) -> inspect.Type:
    """What msgspec expects at a path, whether or not there is a value."""
    value: Any = table
    expected = _chosen(inspect.type_info(kind), value)
    for key in keys:
        structs = _structs(expected)
        match expected:
            case inspect.DictType():
                expected = expected.value_type
            case inspect.ListType() | inspect.VarTupleType() | inspect.FrozenSetType():
                expected = expected.item_type
            case inspect.TupleType() if isinstance(key, int):
                expected = expected.item_types[key]
            case inspect.StructType() if key != expected.tag_field:
                expected = next(f.type for f in expected.fields if f.encode_name == key)
            case _:  # the tag of a union that fits none of its structs
                return inspect.LiteralType(values=tuple(t.tag for t in structs))
        value = value.get(key) if isinstance(value, dict) else value[key]
        expected = _chosen(expected, value)
    return expected


def _chosen(expected: inspect.Type, value: Any) -> inspect.Type:
    """Of a choice, the struct that the value's tag names, or what is not None: a choice yet
    where it is one of plain types."""
    structs = _structs(expected)
    for struct in structs:
        tagged = struct.tag_field is not None and isinstance(value, dict)
        if tagged and value.get(struct.tag_field) == struct.tag:
            return struct
    if isinstance(expected, inspect.UnionType) and len(structs) <= 1:
        types = [t for t in expected.types if not isinstance(t, inspect.NoneType)]
        return types[0] if len(types) == 1 else expected
    return expected


def _structs(expected: inspect.Type) -> tuple[inspect.StructType, ...]:
    types = expected.types if isinstance(expected, inspect.UnionType) else (expected,)
    return tuple(t for t in types if isinstance(t, inspect.StructType))


def _known(expected: inspect.Type) -> str:
    """The keys of a table."""
    if not isinstance(expected, inspect.StructType):
        return "any"
    tag = (expected.tag_field,) if expected.tag_field else ()
    return ", ".join((*tag, *(f.encode_name for f in expected.fields)))


def _allowed(expected: inspect.Type) -> str:
    """What may stand there."""
    match expected:
        case inspect.FloatType():
            return "a number" + _range(expected)
        case inspect.IntType():
            return "a whole number" + _range(expected)
        case inspect.BoolType():
            return "true or false"
        case inspect.StrType():
            return "text in quotes"
        case inspect.LiteralType():
            return " or ".join(f'"{v}"' for v in expected.values)
        case inspect.StructType():
            return f"a table with {_known(expected)}"
        case inspect.ListType() | inspect.VarTupleType() | inspect.FrozenSetType():
            return f"an array, each {_allowed(expected.item_type)}"
        case inspect.TupleType():
            return f"an array of {', '.join(map(_allowed, expected.item_types))}"
        case inspect.UnionType() if not _structs(expected):
            types = (t for t in expected.types if not isinstance(t, inspect.NoneType))
            return " or ".join(map(_allowed, types))
        case _:
            return "a table"


def _range(number: inspect.FloatType | inspect.IntType) -> str:
    form = "d" if isinstance(number, inspect.IntType) else "g"
    low = f" from {number.ge:{form}}" if number.ge is not None else ""
    if number.gt is not None:
        low = f" above {number.gt:{form}} and up"
    return f"{low} to {number.le:{form}}" if number.le is not None else low


_LONGEST_SHOWN: Final = 10**1000


def _shown(value: object) -> str:
    """A value as TOML writes it, no longer than a line bears."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            text = f'"{value}"'
        case dict():
            return "a table"
        case list():
            return "an array"
        case int() if abs(value) >= _LONGEST_SHOWN:
            return "a number of more than 1000 digits"  # Python may refuse to write it out
        case _:
            text = str(value)
    return text if len(text) <= 40 else text[:37] + "..."

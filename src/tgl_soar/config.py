"""Airframe and site files: strict TOML to validated objects.

An airframe file says what flies: its autopilot, which channel moves which surface and which
way, its gains, its glide polar, and the coefficients that the simulation needs.  A site file
says where: the soaring frame, the lines, and the air that the simulation blows.  Both may
carry `[parameters]`, by the very names of `tgl_soar.parameters`: defaults, then airframe,
then site.

Everything unknown, missing or out of range is a `ConfigError` naming file, key, value and
what is allowed.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct

from tgl_soar.geometry import SoaringFrame
from tgl_soar.parameters import ParameterError, ParameterSet
from tgl_soar.types import GlidePolar


class ConfigError(ValueError):
    """A configuration file that cannot be used; the message names file, key and way out."""


Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
SystemId = Annotated[int, Meta(ge=1, le=255)]
Pwm = Annotated[int, Meta(ge=800, le=2200)]
Channel = Annotated[int, Meta(ge=1, le=18)]


class _Strict(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class Surface(_Strict, frozen=True):
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


class Surfaces(_Strict, frozen=True):
    """The three surfaces of the aircraft."""

    elevator: Surface
    aileron: Surface
    rudder: Surface

    def __post_init__(self) -> None:
        channels = [s.channel for s in (self.elevator, self.aileron, self.rudder)]
        if len(set(channels)) != len(channels):
            raise ValueError(f"two surfaces share a channel: {channels}")


class AutopilotLink(_Strict, frozen=True):
    """The autopilot that moves the surfaces, and the identities used towards it."""

    firmware: Literal["ardupilot", "bridge"]
    system_id: SystemId = 1
    component_id: Annotated[int, Meta(ge=1, le=255)] = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
    override_system_id: SystemId = 255  # what the firmware's SYSID_MYGCS names


class AirframeFacts(_Strict, frozen=True):
    """What can be read off the bench."""

    name: str
    mass_kg: Positive
    wing_area_m2: Positive
    span_m: Positive
    chord_m: Positive
    ixx_kgm2: Positive
    iyy_kgm2: Positive
    izz_kgm2: Positive


class Polar(_Strict, frozen=True):
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
            self.c0, self.c1, self.c2, self.c3, self.speed_min_mps, self.speed_max_mps
        )


class Airframe(_Strict, frozen=True):
    """One airframe file."""

    airframe: AirframeFacts
    autopilot: AutopilotLink
    surfaces: Surfaces
    polar: Polar
    parameters: dict[str, float] = {}
    model: dict[str, float] = {}  # the simulation's; checked by tgl_soar.sim.aircraft


class Line(_Strict, frozen=True):
    """A named target gradient line."""

    x_m: Finite
    z_m: Finite
    lean_deg: Annotated[float, Meta(ge=-60, le=60)] | None = None  # default: TGL_LEAN


class Place(_Strict, frozen=True):
    """Where the soaring frame stands in local NED."""

    name: str
    origin_north_m: Finite = 0.0
    origin_east_m: Finite = 0.0
    origin_down_m: Finite = 0.0
    wind_from_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0


class Turbulence(_Strict, frozen=True):
    """Dryden turbulence on top of the mean field."""

    intensity: Annotated[float, Meta(ge=0, le=0.5)] = 0.0  # of the reference wind
    length_scale_m: Positive = 1.5


class JetAir(_Strict, frozen=True, tag_field="kind", tag="jet"):
    """A sloped board in an open wind-tunnel jet."""

    wind_mps: Annotated[float, Meta(ge=5, le=15)]
    slope_deg: Annotated[float, Meta(ge=15, le=35)]
    turbulence: Turbulence = Turbulence()


class HillAir(_Strict, frozen=True, tag_field="kind", tag="hill"):
    """Potential flow over a half-cylinder whose axis lies at the frame's origin."""

    wind_mps: Annotated[float, Meta(ge=1, le=30)]
    radius_m: Positive
    turbulence: Turbulence = Turbulence()


class GridAir(_Strict, frozen=True, tag_field="kind", tag="grid"):
    """A field read from a file beside the site file."""

    file: str
    wind_mps: Positive  # reference wind: turbulence is a fraction of it
    turbulence: Turbulence = Turbulence()


class Start(_Strict, frozen=True):
    """Where the simulated aircraft is let go, at rest over the ground."""

    x_m: Finite
    z_m: Finite
    y_m: Finite = 0.0


class Site(_Strict, frozen=True):
    """One site file."""

    site: Place
    lines: dict[str, Line] = {}
    parameters: dict[str, float] = {}
    air: JetAir | HillAir | GridAir | None = None
    start: Start | None = None

    def frame(self) -> SoaringFrame:
        """The soaring frame of this site."""
        place = self.site
        return SoaringFrame(
            place.origin_north_m,
            place.origin_east_m,
            place.origin_down_m,
            radians(place.wind_from_deg),
        )


_File = TypeVar("_File", Airframe, Site)


def shipped(name: str) -> Path:
    """A file of `config/`: of the source tree, or of the installed package."""
    installed = Path(__file__).parent / "_config"
    folder = installed if installed.is_dir() else Path(__file__).parents[2] / "config"
    return folder / name


def load_airframe(path: str | Path) -> Airframe:
    """Read an airframe file.  Errors: `ConfigError`."""
    airframe = _load(path, Airframe)
    _check_parameters(path, ParameterSet(), airframe.parameters)
    return airframe


def load_site(path: str | Path) -> Site:
    """Read a site file.  Errors: `ConfigError`."""
    return _load(path, Site)


def load_parameters(
    airframe: Airframe, airframe_path: str | Path, site: Site, site_path: str | Path
) -> ParameterSet:
    """Defaults, then the airframe's values, then the site's.  Errors: `ConfigError`."""
    values = _check_parameters(airframe_path, ParameterSet(), airframe.parameters)
    values = _check_parameters(site_path, values, site.parameters)
    for name, line in site.lines.items():
        try:
            values.changed(line_parameters(line))
        except ParameterError as error:
            raise ConfigError(f"{site_path}: lines.{name}: {error}") from None
    return values


def line_parameters(line: Line) -> dict[str, float]:
    """The parameters that put the target gradient line on a named line."""
    changes = {"TGL_X": line.x_m, "TGL_Z": line.z_m}
    if line.lean_deg is not None:
        changes["TGL_LEAN"] = line.lean_deg
    return changes


def _check_parameters(
    path: str | Path, values: ParameterSet, changes: Mapping[str, float]
) -> ParameterSet:
    try:
        return values.changed(changes)
    except ParameterError as error:
        raise ConfigError(f"{path}: parameters.{error}") from None


def _load(path: str | Path, kind: type[_File]) -> _File:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text: {error.reason}") from None
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {_plainly(str(error), table)}") from None


def _plainly(message: str, table: object) -> str:
    """msgspec's message with the key first, and the value that stands there."""
    what, separator, where = message.partition(" - at `$")
    if not separator:
        return message
    key = where.rstrip("`").lstrip(".")
    value = table
    for part in key.replace("[...]", "").split("."):
        value = value.get(part, "") if isinstance(value, dict) else ""
    shown = "" if isinstance(value, dict) or value == "" else f" = {value!r}"
    return f"{key}{shown}: {what}"

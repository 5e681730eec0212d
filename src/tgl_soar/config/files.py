"""Reading of airframe and site files: strict TOML to validated objects.

An airframe file says what flies (`config.airframe`), a site file says where (`config.site`).  Both
may carry `[parameters]`, by the very names of `tgl_soar.config.parameters`: defaults, then
airframe, then site.

Everything unknown, missing or out of range is a `ConfigError` naming file, key, value and
what is allowed.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
from msgspec import Struct, inspect

from tgl_soar.config.airframe import (
    MODEL_KIND_FIELD,
    MODEL_KINDS,
    SIMULATED_KEYS,
    Airframe,
)
from tgl_soar.config.flown_gains import gains_words as gains_words  # of what is read here
from tgl_soar.config.flown_gains import with_own_gains
from tgl_soar.config.lateral_gains import airframe_parameters
from tgl_soar.config.line_changes import PresetLine, Presets, with_changes
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.config.site import Line, Site
from tgl_soar.types import Aerodynamics


class ConfigError(ValueError):
    """A configuration file that cannot be used; the message names file, key and way out."""


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
    _checked_airframe(path, airframe)
    return airframe


def check_simulated(path: str | Path, airframe: Airframe) -> None:
    """Whether an airframe file has all that the simulation and its linear model take; path: of it.
    Errors: `ConfigError`."""
    missing = [key for key in SIMULATED_KEYS if key not in airframe.model]
    if not airframe.model:
        raise ConfigError(f"{path}: [model]: missing, and nothing is simulated without: {_KEYS_OF}")
    if missing:
        names = ", ".join(f"model.{key}" for key in missing)
        raise ConfigError(f"{path}: {names}: missing, and nothing is simulated without: {_KEYS_OF}")


_KEYS_OF: Final = "`tgl-soar docs files` lists its keys"


def load_site(path: str | Path) -> Site:
    """Read a site file.  Errors: `ConfigError`."""
    return load_file(path, Site, _SITES)


def load_parameters(
    airframe: Airframe, airframe_path: str | Path, site: Site, site_path: str | Path
) -> ParameterSet:
    """Defaults, then the airframe's values, then the site's; and gains of pitch for this airframe
    where neither has any of its own (`control.pitch_design`).  Errors: `ConfigError`."""
    values = _checked_airframe(airframe_path, airframe)
    _check_against_airframe(airframe_path, values, airframe)
    values = _checked_site(site_path, site, values)
    _check_against_airframe(site_path, values, airframe)
    _check_veer(site_path, values, site)
    for name, line in site.lines.items():
        try:
            values.changed(line_parameters(line))
        except ParameterError as error:
            key = f"lines.{name}.{_LINE_KEYS[error.name]}"
            raise ConfigError(f"{site_path}: {key} = {error.value}: {error.reason}") from None
    return with_own_gains(values, airframe.autopilot)


def load_flight(
    airframe_path: str | Path, site_path: str | Path
) -> tuple[Airframe, Site, ParameterSet]:
    """Both files, and the parameters with which a flight by them begins.  Errors: `ConfigError`."""
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    return airframe, site, load_parameters(airframe, airframe_path, site, site_path)


def preset_lines(site: Site, values: ParameterSet) -> Presets:
    """The site's lines for TGL_PRESET; one without a lean of its own has that of the files."""
    lean = site.parameters.get("TGL_LEAN", values["TGL_LEAN"])
    return tuple(
        PresetLine(name, line.x_m, line.z_m, lean if line.lean_deg is None else line.lean_deg)
        for name, line in site.lines.items()
    )


def airframe_refusal(
    values: ParameterSet, driven: frozenset[int], aerodynamics: Aerodynamics
) -> str:
    """Which value the airframe has no room for, "NAME = value: why"; "" if none."""
    for name in ("OP_RC_CHAN", "THR_BUDGET"):
        if refusal := value_refusal(name, values[name], driven, aerodynamics):
            return f"{name} = {values[name]:g}: {refusal}"
    return ""


def value_refusal(
    name: str, value: float, driven: frozenset[int], aerodynamics: Aerodynamics
) -> str:
    """Why the airframe has no room for a parameter's value; "" if it has, or has no say in it."""
    match name:
        case "OP_RC_CHAN":
            return _switch_refusal(value, driven)
        case "THR_BUDGET":
            return _budget_refusal(value, aerodynamics)
        case _:
            return ""


def _switch_refusal(channel: float, surface_channels: frozenset[int]) -> str:
    if channel not in surface_channels:
        return ""
    # Plain letters: it is also sent as a STATUSTEXT.
    taken = ", ".join(map(str, sorted(surface_channels)))
    return f"this channel moves a surface: 1 to 18 but none of {taken}; 0: no switch"


def _budget_refusal(budget_s: float, aerodynamics: Aerodynamics) -> str:
    if not budget_s > 0.0 or aerodynamics.propeller_thrust_n > 0.0:
        return ""
    # Plain letters: it is also sent as a STATUSTEXT.
    return (
        "no propeller: the airframe file needs [surfaces.throttle] and propeller_thrust_n; 0: none"
    )


def _check_against_airframe(path: str | Path, values: ParameterSet, airframe: Airframe) -> None:
    known, channels = airframe.aerodynamics(), airframe.surfaces.channels()
    if refusal := airframe_refusal(values, channels, known):
        raise ConfigError(f"{path}: parameters.{refusal}")


def _check_veer(path: str | Path, values: ParameterSet, site: Site) -> None:
    oblique_deg, most_deg = site.site.oblique_deg(), values["VEER_MAX"]
    if abs(oblique_deg) > most_deg:
        side = "right" if oblique_deg > 0.0 else "left"
        raise ConfigError(
            f"{path}: parameters.VEER_MAX = {most_deg:g}: with site.ridge_deg ="
            f" {site.site.ridge_deg:g} the wind comes from {abs(oblique_deg):g} deg to the {side}"
            " of straight at the ridge, and the nose must be allowed to follow it: at least as"
            " much, and room for it to turn"
        )


_LINE_KEYS: Final = {"TGL_X": "x_m", "TGL_Z": "z_m", "TGL_LEAN": "lean_deg"}


def line_parameters(line: Line) -> dict[str, float]:
    """The parameters that put the target gradient line on a named line."""
    changes = {"TGL_X": line.x_m, "TGL_Z": line.z_m}
    if line.lean_deg is not None:
        changes["TGL_LEAN"] = line.lean_deg
    return changes


def _checked_airframe(path: str | Path, airframe: Airframe) -> ParameterSet:
    """The defaults with all that an airframe file gives.  Errors: `ConfigError`."""
    try:
        given = airframe_parameters(airframe)
    except ArithmeticError:
        reason = "a number is too small or too large for gains to be computed from it"
        raise ConfigError(f"{path}: [airframe], [model] or [polar]: {reason}") from None
    measured = {name: f"dynamics.{key}" for name, key in airframe.dynamics.keys().items()}
    origins = {
        name: measured.get(name, _FOLLOWS) for name in given if name not in airframe.parameters
    }
    return _check_parameters(path, ParameterSet(), given, origins)


def _checked_site(path: str | Path, site: Site, values: ParameterSet) -> ParameterSet:
    """Values with all that a site file gives.  Errors: `ConfigError`."""
    given, origins = site.parameters, dict[str, str]()
    if site.landing is not None:
        keys = site.landing.keys()
        origins = {name: f"landing.{key}" for name, key in keys.items() if name not in given}
        given = {**site.landing.parameters(), **given}
    return _check_parameters(path, values, given, origins, preset_lines(site, values))


_FOLLOWS: Final = ""  # the origin of what no key of the file gives


def _refusal(error: ParameterError, origins: Mapping[str, str]) -> str:
    """By the key that the file has, or by what the value follows from."""
    key = origins.get(error.name)
    if key is None:
        return f"parameters.{error}"
    if key == _FOLLOWS:
        tables = "[airframe], [model] and [polar]"
        return f"{error.name}, which follows from {tables}: {error.value}: {error.reason}"
    return f"{key} = {error.value}: {error.reason}"


def _check_parameters(
    path: str | Path,
    values: ParameterSet,
    changes: Mapping[str, float],
    origins: Mapping[str, str],
    presets: Presets = (),
) -> ParameterSet:
    """Values with changes.  `origins`: what the file calls those that are not in `[parameters]`."""
    try:
        for name, value in changes.items():
            if name in INDEX and not PARAMETERS[INDEX[name]].in_files:
                raise ParameterError(name, value, _OVER_THE_AIR)
        result = with_changes(values, changes, presets)
        wanted = changes.get("TGL_PRESET", result["TGL_PRESET"])
        if result["TGL_PRESET"] != wanted:
            raise ParameterError("TGL_PRESET", f"{wanted:g}", _TWO_LINES)
    except ParameterError as error:
        raise ConfigError(f"{path}: {_refusal(error, origins)}") from None
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
    return file_from(text, path, kind)


def site_from(text: str, name: str) -> Site:
    """A site file's text, as a log holds it; name: what errors call it.  Errors: `ConfigError`."""
    return file_from(text, name, Site)


def airframe_from(text: str, name: str) -> Airframe:
    """An airframe file's text, likewise.  Errors: `ConfigError`."""
    airframe = file_from(text, name, Airframe)
    _checked_airframe(name, airframe)
    return airframe


def file_from(text: str, path: str | Path, kind: type[_File]) -> _File:
    """A file's text; path: what errors call it.  Errors: `ConfigError`."""
    table = _table(text.removeprefix("\ufeff"), path)  # the mark that some editors begin with
    if issubclass(kind, Airframe):
        table = _with_model_kind(table, path)
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {_plainly(str(error), table, kind)}") from None


def _with_model_kind(table: dict[str, Any], path: str | Path) -> dict[str, Any]:
    """An airframe file's table with `kind` taken out of the numbers of [model]."""
    model = table.get("model")
    if not isinstance(model, dict) or "kind" not in model:
        return table
    kind = model["kind"]
    if kind not in MODEL_KINDS:
        allowed = " or ".join(map(_shown, MODEL_KINDS))
        raise ConfigError(f"{path}: model.kind = {_shown(kind)}: must be {allowed}")
    numbers = {key: value for key, value in model.items() if key != "kind"}
    return {**table, "model": numbers, MODEL_KIND_FIELD: kind}


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


_TOO_LONG: Final = re.compile(r"\b\d(?:_?\d){999,}")  # whatever stands behind it
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
    expected = _chosen(_type_info(kind), value)
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


@cache
def _type_info(kind: type[Struct]) -> inspect.Type:
    """What msgspec expects of a file: it builds the whole tree at each call, for milliseconds."""
    return inspect.type_info(kind)


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
    names = [field.encode_name for field in expected.fields]
    return ", ".join((*tag, *(n for n in names if n != MODEL_KIND_FIELD)))


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

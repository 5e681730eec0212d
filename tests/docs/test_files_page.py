"""docs/files.md lists every table and key of the airframe file and the site file, with what is
allowed and what holds where the file does not give it, as the structs declare them."""

from __future__ import annotations

import re
from math import cos, radians, sin
from pathlib import Path

import msgspec
import pytest
from msgspec import inspect

from tgl_soar.config import airframe, lateral_gains, site
from tgl_soar.config.airframe import MODEL_KEYS, Airframe
from tgl_soar.config.dynamics import MeasuredDynamics
from tgl_soar.config.strict import Strict
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.geometry import SoaringFrame, soaring_from_ned

PAGE = Path(__file__).parents[2] / "docs/files.md"
HEAD = "| key | allowed | default | meaning |"
Row = tuple[str, str, str]  # key, allowed, default

STRUCTS: dict[str, type[Strict]] = {
    "airframe": airframe.AirframeMetadata,
    "autopilot": airframe.AutopilotLink,
    "surfaces": airframe.Surfaces,
    "Each surface": airframe.Surface,
    "mixing": airframe.Mixing,
    "throttle": airframe.Throttle,
    "polar": airframe.Polar,
    "dynamics": MeasuredDynamics,
    "site": site.SiteOrigin,
    "position": site.PositionSettings,
    "home": site.HomePosition,
    "forward": site.Forward,
    "mocap": site.Mocap,
    "lines": site.Line,
    "ground, contour": site.GroundProfile,
    "ground, contour, 2": site.KnownContour,
    "landing": site.LandingStrip,
    "jet": site.JetAir,
    "hill": site.HillAir,
    "grid": site.GridAir,
    "layout": site.GridLayout,
    "polynomial": site.PolynomialAir,
    "turbulence": site.TurbulenceSettings,
    "start": site.Start,
    "tether": site.Tether,
}


def tables() -> dict[str, list[Row]]:
    """The tables of keys by the name before them: in backticks or brackets, or the headline's."""
    found: dict[str, list[Row]] = {}
    name, rows = "", None
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("### "):
            name = line[4:]
        elif heading := re.match(r'(?:`kind = "|`\[|`)(\w+)(?:"`|\]`|`)[:,]', line):
            name = heading[1]
        elif line.startswith("Each surface"):
            name = "Each surface"
        if line == HEAD:
            rows = found.setdefault(name if name not in found else f"{name}, 2", [])
        elif line.startswith("| `") and rows is not None:
            key, allowed, default, _ = (
                cell.strip() for cell in re.split(r" \|(?= |$)", line[1:], maxsplit=3)
            )
            rows.append((key.strip("`"), allowed, default))
        elif not line.startswith("|"):
            rows = None
    return found


def number(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")


def span(declared: inspect.FloatType | inspect.IntType) -> str:
    least = declared.ge if declared.ge is not None else declared.gt
    most = declared.le
    assert least is not None
    assert most is not None
    if most == 1e6:
        return "" if least < 0.0 else "above 0"
    if declared.gt is not None:
        return f"above {number(least)}, up to {number(most)}"
    whole = "whole, " if isinstance(declared, inspect.IntType) else ""
    return f"{whole}{number(least)} … {number(most)}"


def allowed(declared: inspect.Type) -> str | None:
    """How the page writes what a key may be; None: in its own words."""
    match declared:
        case inspect.Metadata(type=inner):
            return allowed(inner)
        case inspect.UnionType(types=types):
            parts = [allowed(each) for each in types if not isinstance(each, inspect.NoneType)]
            return None if None in parts else ", or ".join(sorted({*map(str, parts)}))
        case inspect.FloatType() | inspect.IntType():
            return span(declared)
        case inspect.BoolType():
            return "`true`, `false`"
        case inspect.StrType():
            return "text"
        case inspect.LiteralType(values=values):
            return ", ".join(f"`{value}`" for value in values)
    return None


def default(field: inspect.Field) -> str | None:
    """How the page writes a default; None: in its own words."""
    match field.default:
        case _ if field.required:
            return "needed"
        case None | "":
            return ""
        case bool(value):
            return f"`{str(value).lower()}`"
        case int(value) | float(value):
            return number(value)
        case str(value):
            return f"`{value}`"
    return None


@pytest.mark.parametrize("name", STRUCTS)
def test_every_key_is_listed_as_it_is_declared(name: str) -> None:
    rows = {key: (range_words, otherwise) for key, range_words, otherwise in tables()[name]}
    info = inspect.type_info(STRUCTS[name])
    assert isinstance(info, inspect.StructType)
    fields = {field.encode_name: field for field in info.fields}
    assert [*rows] == [*dict.fromkeys(rows)]
    assert rows.keys() == fields.keys()
    for key, (range_words, otherwise) in rows.items():
        expected = allowed(fields[key].type), default(fields[key])
        assert (key, range_words) == (key, range_words if expected[0] is None else expected[0])
        if (name, key) != ("surfaces", "aileron"):
            assert (key, otherwise) == (key, otherwise if expected[1] is None else expected[1])


def test_the_keys_of_the_model_are_those_that_are_known() -> None:
    keys = [key for key, _, _ in tables()["model"]]
    assert sorted(keys) == sorted(["kind", *MODEL_KEYS])
    marked = re.findall(r"^\| `(\w+)` \|.*\| ● ", PAGE.read_text(encoding="utf-8"), re.M)
    assert marked == [*airframe._AERODYNAMIC]
    sideways = re.findall(r"^\| `(\w+)` \|.*\| ○ ", PAGE.read_text(encoding="utf-8"), re.M)
    assert {*sideways} == {*lateral_gains._NEEDED} - {*marked}
    positive = [
        key for key, range_words, _ in tables()["model"] if range_words.startswith("above 0")
    ]
    assert positive == [*airframe.POSITIVE_KEYS]
    range_words = {key: range_words for key, range_words, _ in tables()["model"]}
    assert [key for key in range_words if range_words[key] == "below 0"] == [
        *airframe.NEGATIVE_KEYS
    ]
    stall = f"above 0, up to {number(airframe.STALL_MAX_RAD)}"
    assert [key for key in range_words if range_words[key] == stall] == [*airframe._BELOW_STALL_MAX]
    for key, low, high in (("CL_alpha", *airframe._LIFT_SLOPE), *airframe._RANGES):
        words = "above 0, up to" if key in airframe.POSITIVE_KEYS else f"{number(low)} …"
        assert range_words[key] == f"{words} {number(high)}"


def test_every_table_of_a_file_has_a_section() -> None:
    heads = set(re.findall(r"^### (.*)$", PAGE.read_text(encoding="utf-8"), re.M))
    listed = {name for head in heads for name in head.split(", ")}
    fields = {
        field.encode_name
        for kind in (Airframe, site.Site)
        for field in msgspec.structs.fields(kind)
    }
    assert listed == fields - {airframe.MODEL_KIND_FIELD}
    assert {*tables()} == {*STRUCTS, "model"}


def test_the_signs_of_y_and_of_the_lean_are_those_that_are_flown() -> None:
    """Wind from north: right of an aircraft that faces it is east."""
    assert soaring_from_ned(SoaringFrame(0.0, 0.0, 0.0, 0.0), 0.0, 1.0, 0.0)[1] == 1.0
    text = PAGE.read_text(encoding="utf-8")
    assert "y to the right of an aircraft that faces upwind" in text
    eta = eta_from_lean(radians(15.0))  # from the downstream axis: up the line is upwind
    assert cos(eta) < 0.0 < sin(eta)
    assert "| `lean_deg` | -60 … 60 | | upwind from upright; without it `TGL_LEAN` |" in text

"""Lines that the module would refuse are refused by `tgl-soar sitl` before anything starts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.cli.sitl_lines import refused_line
from tgl_soar.config.files import shipped
from tgl_soar.sim.sitl_options import SitlOptions

AIRFRAME, HILL = shipped("airframes/eclipson_c.toml"), shipped("sites/hill.toml")
B = "b = { x_m = -4.8, z_m = 13.6 }"
LOW = "lines.b: TGL_Z = -30: the line's point is outside the fence (FENCE_Z_MIN is 0.5 m)"


def site_with(folder: Path, b: str) -> Path:
    """The shipped hill with another line b."""
    text = HILL.read_text(encoding="utf-8")
    assert text.count(B) == 1
    path = folder / "site.toml"
    path.write_text(text.replace(B, b), encoding="utf-8")
    return path


def refused(site: Path, **changes: Any) -> str:
    return refused_line(SitlOptions(airframe=AIRFRAME, site=site, out=Path("out"), **changes))


@pytest.mark.parametrize("name", ["tunnel", "tunnel_mocap", "tunnel_polynomial", "hill"])
def test_the_lines_of_the_shipped_sites_are_taken(name: str) -> None:
    assert refused(shipped(f"sites/{name}.toml")) == ""


@pytest.mark.parametrize("legs", [("b",), ("a", "b"), ()])
@pytest.mark.parametrize(
    ("b", "why"),
    [
        ("b = { x_m = -4.8, z_m = -30.0 }", LOW),
        ("b = { x_m = 4.8, z_m = 13.6 }", "lines.b: TGL_X = 4.8: the line's point is outside the"),
        ("b = { x_m = -4.8, z_m = 7.0 }", "lines.b: TGL_Z = 7: the line's point is 0.59 m from"),
        (
            "b = { x_m = -11.0, z_m = 13.6 }",
            "lines.b: TGL_X = -11: the line does not cross the known",
        ),
    ],
)
def test_a_line_that_the_module_would_refuse_is_named_with_file_and_reason(
    tmp_path: Path, b: str, why: str, legs: tuple[str, ...]
) -> None:
    site = site_with(tmp_path, b)
    words = refused(site, legs=legs)
    assert words.startswith(f"{site}: lines.b: ")
    assert why in words
    assert "OP_FORCE" not in words
    assert refused(site, legs=("a", "c")) == ""


def test_where_the_files_own_line_is_no_good_the_line_to_engage_on_is_checked_too(
    tmp_path: Path,
) -> None:
    """The module would only warn of a step from one that is no good to another."""
    site = site_with(tmp_path, "b = { x_m = -4.8, z_m = -30.0 }")
    text = site.read_text(encoding="utf-8").replace("TGL_Z = 14.2", "TGL_Z = 30.0")
    site.write_text(text, encoding="utf-8")
    assert "the line's point is outside the fence" in refused(site, legs=("b",))
    assert refused(site, legs=("b",), settings=(("OP_FORCE", 1.0),)) == ""
    assert refused(site, legs=("a",)) == ""


def test_a_step_that_is_too_long_in_flight_is_refused_unless_nobody_knows_where_from() -> None:
    short = (("TGL_STEP_MAX", 1.0),)
    assert "lines.c: TGL_X = -3.6: 2.60 m from where" in refused(
        HILL, legs=("a", "c"), settings=short
    )
    assert refused(HILL, legs=("a",), settings=short) == ""
    assert refused(HILL, legs=("a", "c"), settings=short, search=True) == ""


def test_no_margin_is_judged_where_a_firmware_holds_the_attitude() -> None:
    swings = (("RHO_P", 2.0),)
    assert refused(HILL, legs=("a", "b"), settings=swings) != ""
    by_px4: dict[str, Any] = {"autopilot": "px4", "route": "attitude"}
    assert refused(HILL, legs=("a", "b"), settings=swings, **by_px4) == ""


def test_nothing_is_started_for_a_line_that_is_refused(tmp_path: Path) -> None:
    site, out = site_with(tmp_path, "b = { x_m = -4.8, z_m = -30.0 }"), tmp_path / "out"
    done = CliRunner().invoke(app, ["sitl", "--site", str(site), "--out", str(out)])
    assert done.exit_code == 2
    assert done.output.splitlines() == [
        f"error: {site}: {LOW}; change this line, or choose others by --legs"
    ]
    assert not out.exists()

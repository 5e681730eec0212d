"""The contour in a site file: read, made by `tgl-soar site contour`, true where it is shipped."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.air.zeuc import excess_at
from tgl_soar.cli.app import app
from tgl_soar.config.files import (
    ConfigError,
    load_airframe,
    load_parameters,
    load_site,
    preset_lines,
    shipped,
)
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.sim.world import build_field

AIRFRAME = shipped("airframes/eclipson_c.toml")
NAME = "Eclipson Model C"
SITES = [shipped("sites/tunnel.toml"), shipped("sites/hill.toml")]


def site_file(folder: Path, text: str) -> Path:
    path = folder / "site.toml"
    path.write_text(f'[site]\nname = "s"\n{text}', encoding="utf-8")
    return path


def test_a_contour_is_known_for_the_airframe_it_was_computed_with(tmp_path: Path) -> None:
    text = '[contour]\nairframe = "one"\nparts = [[[1, 2], [3, 4.5]], [[0, 0], [1, 1], [2, 0]]]'
    site = load_site(site_file(tmp_path, text))
    assert site.contour_for("one") == (
        ((1.0, 2.0), (3.0, 4.5)),
        ((0.0, 0.0), (1.0, 1.0), (2.0, 0.0)),
    )
    assert site.contour_for("another") == ()
    assert site.contour_words("one") == ""
    words = site.contour_words("another")
    assert "the site's contour is of 'one', the airframe is 'another'" in words
    assert "`tgl-soar site contour`" in words
    assert load_site(site_file(tmp_path, "")).contour_words("one") == ""
    assert load_site(site_file(tmp_path, "")).contour_for("one") == ()


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("parts = []", "contour.airframe: missing"),
        ('airframe = "a"\nparts = [[[1, 2]]]', "each of parts needs two points"),
        ('airframe = "a"\nparts = [[[1, 2], [3]]]', "contour.parts[0][1]"),
        ('airframe = "a"\nparts = [[[1, 2], [3, nan]]]', "contour.parts[0][1][1] = nan"),
        ('airframe = "a"\nparts = [[[1, 2], [3, "x"]]]', 'contour.parts[0][1][1] = "x"'),
        ('airframe = "a"\nparts = []\nwind = 3', "contour.wind: unknown key"),
    ],
)
def test_a_bad_contour_is_named(tmp_path: Path, text: str, reported: str) -> None:
    path = site_file(tmp_path, f"[contour]\n{text}\n")
    with pytest.raises(ConfigError) as caught:
        load_site(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reported in str(caught.value)


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_the_shipped_contours_are_where_updraft_equals_sink(path: Path) -> None:
    """To 2 cm/s, which is what 5 mm beside the contour make; and no line of the site is refused."""
    airframe, site = load_airframe(AIRFRAME), load_site(path)
    assert site.air is not None
    field, polar = build_field(site.air, path.parent), airframe.polar.as_polar()
    contour = site.contour_for(NAME)
    ends = {point for part in contour for point in (part[0], part[-1])}
    inner = [point for part in contour for point in part if point not in ends]
    assert len(inner) > 10
    for x, z in inner:
        assert abs(excess_at(field, polar, x, z)) < 0.02
    values = load_parameters(airframe, AIRFRAME, site, path)
    presets = preset_lines(site, values)
    assert LineBounds(contour).preset_faults(values, presets) == []
    # Rising air is below the contour, so that the same contour the other way round is refused.
    turned = tuple(part[::-1] for part in contour)
    faults = LineBounds(turned).preset_faults(values, presets)
    assert len(faults) == len(presets)
    assert all("grows up the line" in fault for fault in faults)


def test_the_command_writes_what_the_loader_reads(tmp_path: Path) -> None:
    out = tmp_path / "contour.toml"
    command = ["site", "contour", "--site", str(SITES[1]), "--airframe", str(AIRFRAME)]
    ran = CliRunner().invoke(app, [*command, "--out", str(out)])
    assert ran.exit_code == 0, ran.output
    shipped_contour = load_site(SITES[1]).contour_for(NAME)
    made = load_site(site_file(tmp_path, out.read_text())).contour_for(NAME)
    assert len(made) == len(shipped_contour)
    assert made[0][0] == pytest.approx(shipped_contour[0][0], abs=0.01)
    refused = CliRunner().invoke(app, [*command, "--bounds", "1,2,3"])
    assert refused.exit_code == 2


# --- what a site file may say of parameters ---------------------------------------------------


def loaded(folder: Path, parameters: str) -> object:
    lines = "[lines]\na = { x_m = 1, z_m = 2 }\nb = { x_m = 3, z_m = 4, lean_deg = 25 }\n"
    path = site_file(folder, f"{lines}[parameters]\n{parameters}\n")
    values = load_parameters(load_airframe(AIRFRAME), AIRFRAME, load_site(path), path)
    return values["TGL_PRESET"], values["TGL_X"], values["TGL_Z"], values["TGL_LEAN"]


def test_a_site_may_begin_on_one_of_its_lines(tmp_path: Path) -> None:
    assert loaded(tmp_path, "TGL_PRESET = 2") == (2.0, 3.0, 4.0, 25.0)
    assert loaded(tmp_path, "TGL_PRESET = 1") == (1.0, 1.0, 2.0, 15.0)
    # TGL_LEAN is that of the lines that have none of their own.
    assert loaded(tmp_path, "TGL_PRESET = 1\nTGL_LEAN = 20") == (1.0, 1.0, 2.0, 20.0)
    assert loaded(tmp_path, "TGL_PRESET = 2\nTGL_LEAN = 20") == (2.0, 3.0, 4.0, 25.0)


@pytest.mark.parametrize(
    ("parameters", "reported"),
    [
        ("OP_ENGAGE = 1", "parameters.OP_ENGAGE = 1.0: not from a file"),
        ("OP_ENGAGE = 0", "parameters.OP_ENGAGE = 0.0: not from a file"),
        ("TGL_STAGE = 1", "parameters.TGL_STAGE = 1.0: not from a file"),
        ("TGL_PRESET = 3", "parameters.TGL_PRESET = 3: no such line: the site's lines are 1 a, 2"),
        ("TGL_PRESET = 1\nTGL_X = 7", "TGL_X or TGL_Z beside it"),
        ("TGL_PRESET = 1.5", "whole numbers only"),
    ],
)
def test_what_no_file_may_say(tmp_path: Path, parameters: str, reported: str) -> None:
    with pytest.raises(ConfigError) as caught:
        loaded(tmp_path, parameters)
    assert reported in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path))


def test_an_airframe_cannot_engage_either(tmp_path: Path) -> None:
    path = tmp_path / "airframe.toml"
    text = AIRFRAME.read_text(encoding="utf-8")
    path.write_text(text.replace("[parameters]", "[parameters]\nOP_ENGAGE = 1"), encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"airframe\.toml: parameters\.OP_ENGAGE = 1\.0: not from"
    ):
        load_airframe(path)

"""The site file's [landing]."""

from __future__ import annotations

from pathlib import Path

import pytest

from tgl_soar.config.files import (
    ConfigError,
    airframe_file,
    load_airframe,
    load_parameters,
    load_site,
    site_file,
)

AIRFRAME = airframe_file("eclipson_c")
STRIP = """
[landing]
x_m = -27.0
y_m = 2.0
z_m = 0.5
bearing_deg = 290.0
length_m = 20.0
away_x_m = -12.0
"""


def site_with(tmp_path: Path, strip: str) -> Path:
    before, _, after = site_file("hill").read_text(encoding="utf-8").partition("[landing]")
    path = tmp_path / "site.toml"
    path.write_text(before + strip + "\n#" + after.partition("\n\n")[2], encoding="utf-8")
    return path


def test_it_becomes_the_parameters_that_the_operator_sees(tmp_path: Path) -> None:
    path = site_with(tmp_path, STRIP)
    values = load_parameters(load_airframe(AIRFRAME), AIRFRAME, load_site(path), path)
    names = ("LND_X", "LND_Y", "LND_Z", "LND_BEAR", "LND_LEN", "ESC_BEAR", "ESC_X")
    assert [values[name] for name in names] == [-27.0, 2.0, 0.5, 290.0, 20.0, 290.0, -12.0]
    path = site_with(tmp_path, STRIP + "escape_deg = 260.0\n")
    values = load_parameters(load_airframe(AIRFRAME), AIRFRAME, load_site(path), path)
    assert (values["LND_BEAR"], values["ESC_BEAR"]) == (290.0, 260.0)


def test_a_place_downwind_is_refused_in_words(tmp_path: Path) -> None:
    for key, line in (
        ("bearing_deg", STRIP.replace("290.0", "90.0")),
        ("escape_deg", STRIP + "escape_deg = 340.0\n"),
    ):
        with pytest.raises(ConfigError, match=f"landing.{key}.*from the wind"):
            load_site(site_with(tmp_path, line))


def test_without_one_no_landing_place_is_known() -> None:
    path = site_file("tunnel")
    values = load_parameters(load_airframe(AIRFRAME), AIRFRAME, load_site(path), path)
    assert values["LND_LEN"] == 0.0


@pytest.mark.parametrize(("wind_deg", "bearing_deg"), [(350.0, 10.0), (10.0, -10.0), (-5.0, 355.0)])
def test_a_bearing_on_the_other_side_of_north_is_near_the_wind(
    tmp_path: Path, wind_deg: float, bearing_deg: float
) -> None:
    path = site_with(tmp_path, STRIP.replace("290.0", f"{bearing_deg}"))
    text = path.read_text(encoding="utf-8")
    assert "wind_from_deg = 270.0" in text
    path.write_text(text.replace("wind_from_deg = 270.0", f"wind_from_deg = {wind_deg}"))
    landing = load_site(path).landing
    assert landing is not None
    assert landing.bearing_deg == bearing_deg

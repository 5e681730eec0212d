"""The site file's `ridge_deg`: the frame stands across the ridge, and the wind comes askew."""

from __future__ import annotations

from math import atan2, degrees
from pathlib import Path

import pytest

from tgl_soar.air.wind_record import RecordedField
from tgl_soar.config.files import (
    ConfigError,
    airframe_file,
    load_airframe,
    load_parameters,
    load_site,
    site_file,
)
from tgl_soar.config.site import SiteOrigin
from tgl_soar.geometry import ned_vector_from_soaring
from tgl_soar.sim.world import site_field

AIRFRAME = airframe_file("eclipson_c")
HILL = site_file("hill").read_text(encoding="utf-8")
WIND = "wind_from_deg = 270.0\n"


def hill(folder: Path, lines: str, parameters: str = "", text: str = HILL) -> Path:
    """The shipped hill (wind from 270°) with other lines in [site], and more of [parameters]."""
    assert WIND in text
    text = text.replace(WIND, lines).replace("[parameters]\n", f"[parameters]\n{parameters}")
    path = folder / "site.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("wind_from_deg", "ridge_deg", "facing_deg", "oblique_deg"),
    [
        (290.0, 20.0, 290.0, 0.0),
        (300.0, 20.0, 290.0, 10.0),  # clockwise of straight at the ridge: from the right
        (300.0, 200.0, 290.0, 10.0),  # a ridge runs both ways
        (300.0, -160.0, 290.0, 10.0),
        (-60.0, 20.0, 290.0, 10.0),
        (100.0, 20.0, 110.0, -10.0),  # the other slope, from the left
        (350.0, 100.0, 10.0, -20.0),
        (300.0, None, 300.0, 0.0),
    ],
)
def test_the_frame_looks_straight_off_the_ridge_on_the_side_of_the_wind(
    wind_from_deg: float, ridge_deg: float | None, facing_deg: float, oblique_deg: float
) -> None:
    place = SiteOrigin(name="", wind_from_deg=wind_from_deg, ridge_deg=ridge_deg)
    assert (place.facing_deg() - facing_deg) % 360.0 == pytest.approx(0.0, abs=1e-9)
    assert place.oblique_deg() == pytest.approx(oblique_deg)


@pytest.mark.parametrize("wind_from_deg", [250.0, 285.0])
def test_the_wind_far_away_comes_from_where_the_file_says(
    tmp_path: Path, wind_from_deg: float
) -> None:
    path = hill(tmp_path, f"wind_from_deg = {wind_from_deg}\nridge_deg = 0.0\n", "VEER_MAX = 40\n")
    site = load_site(path)
    assert degrees(site.frame().wind_from_rad) == pytest.approx(270.0)
    field = site_field(site, tmp_path)
    u, v, w = field.wind_at(-2000.0, 0.0, 1.0, 0.0)  # 250 radii upwind of the hill
    north, east, down = ned_vector_from_soaring(site.frame(), u, v, w)
    assert degrees(atan2(-east, -north)) % 360.0 == pytest.approx(wind_from_deg, abs=0.01)
    assert (north**2 + east**2) ** 0.5 == pytest.approx(7.0, rel=1e-3)
    assert down == pytest.approx(0.0, abs=0.01)


def test_only_what_blows_across_the_ridge_is_lifted(tmp_path: Path) -> None:
    straight = site_field(load_site(hill(tmp_path, WIND)), tmp_path)
    lines = "wind_from_deg = 300.0\nridge_deg = 0.0\n"
    askew = site_field(load_site(hill(tmp_path, lines)), tmp_path)
    for x_m, z_m in ((-6.2, 14.2), (-3.6, 12.6), (-12.0, 6.0)):
        u, _, w = straight.wind_at(x_m, 0.0, z_m, 0.0)
        across, along, up = askew.wind_at(x_m, 0.0, z_m, 0.0)
        assert (across, up) == pytest.approx((0.75**0.5 * u, 0.75**0.5 * w))
        assert abs(along) == pytest.approx(3.5)


def test_a_record_turns_from_there(tmp_path: Path) -> None:
    (tmp_path / "hour.csv").write_text("time_s,wind_mps,veer_deg\n0,7,0\n100,7,10\n")
    text = HILL.replace("radius_m = 8.0\n", 'radius_m = 8.0\nrecord = "hour.csv"\n')
    lines = "wind_from_deg = 290.0\nridge_deg = 0.0\n"
    field = site_field(load_site(hill(tmp_path, lines, text=text)), tmp_path)
    assert isinstance(field, RecordedField)
    for time_s, veer_deg in ((0.0, 20.0), (50.0, 25.0), (100.0, 30.0)):
        u, v, _ = field.wind_at(-2000.0, 0.0, 1.0, time_s)
        assert degrees(atan2(-v, u)) == pytest.approx(veer_deg, abs=0.01)


@pytest.mark.parametrize(
    ("site", "lines", "words"),
    [
        (
            "hill",
            "wind_from_deg = 330.0\nridge_deg = 0.0\n",
            "site.ridge_deg = 0: the wind from 330 deg blows along it, 60 deg off straight at it;"
            " at most 45 deg",
        ),
        ("hill", WIND + "ridge_deg = 400.0\n", "site.ridge_deg = 400"),
        ("hill", WIND + "ridge_deg = nan\n", "site.ridge_deg"),
        ("tunnel", WIND + "ridge_deg = 0.0\n", "site.ridge_deg = 0: a jet has no ridge"),
        ("tunnel_polynomial", WIND + "ridge_deg = 0.0\n", "a jet has no ridge"),
    ],
)
def test_what_is_no_slope_to_stand_before_is_refused(
    tmp_path: Path, site: str, lines: str, words: str
) -> None:
    text = site_file(site).read_text(encoding="utf-8")
    wind = next(line for line in text.splitlines(True) if line.startswith("wind_from_deg"))
    path = hill(tmp_path, lines, text=text.replace(wind, WIND))
    with pytest.raises(ConfigError) as refused:
        load_site(path)
    assert str(path) in str(refused.value)
    assert words in str(refused.value)


def test_the_way_home_is_limited_from_straight_off_the_ridge(tmp_path: Path) -> None:
    """`control.landing` counts its sixty degrees in the frame: 85° off the wind may be flown."""
    lines = "wind_from_deg = 295.0\nridge_deg = 0.0\n"
    load_site(hill(tmp_path, lines, text=HILL.replace("bearing_deg = 270", "bearing_deg = 211")))
    text = HILL.replace("bearing_deg = 270", "bearing_deg = 209")  # 61° off
    with pytest.raises(ConfigError, match=r"landing\.bearing_deg = 209.*270 deg"):
        load_site(hill(tmp_path, lines, text=text))


@pytest.mark.parametrize(("wind_from_deg", "side"), [(290.0, "right"), (250.0, "left")])
def test_the_nose_must_be_allowed_to_follow_the_wind(
    tmp_path: Path, wind_from_deg: float, side: str
) -> None:
    airframe = load_airframe(AIRFRAME)
    lines = f"wind_from_deg = {wind_from_deg}\nridge_deg = 180.0\n"
    path = hill(tmp_path, lines, "VEER_MAX = 19.0\n")
    with pytest.raises(ConfigError) as refused:
        load_parameters(airframe, AIRFRAME, load_site(path), path)
    words = str(refused.value)
    assert words.startswith(f"{path}: parameters.VEER_MAX = 19: ")
    assert f"20 deg to the {side} of straight at the ridge" in words
    path = hill(tmp_path, lines, "VEER_MAX = 20.0\n")
    assert load_parameters(airframe, AIRFRAME, load_site(path), path)["VEER_MAX"] == 20.0

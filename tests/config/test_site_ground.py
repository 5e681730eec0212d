"""The ground of a site file: a few points, and every way to write them wrong."""

from __future__ import annotations

from math import cos, radians, sin
from pathlib import Path

import pytest

from tgl_soar.config.files import ConfigError, load_site, shipped
from tgl_soar.config.site import HillAir, JetAir
from tgl_soar.control.envelope import clearance
from tgl_soar.sim.world import ground_outline
from tgl_soar.types import NO_GROUND

SITE = '[site]\nname = "test"\n[ground]\nprofile = {profile}\n'


def site(tmp_path: Path, profile: str) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(SITE.format(profile=profile), encoding="utf-8")
    return path


def test_the_ground_is_read(tmp_path: Path) -> None:
    ground = load_site(site(tmp_path, "[[-1, 2], [3, 5.0]]")).known_ground()
    assert ground.points == 2
    assert clearance(ground, -5.0, 3.0) == 1.0
    assert clearance(ground, 1.0, 4.75) == pytest.approx(1.0)  # 3-4-5
    assert clearance(ground, 50.0, 7.0) == 2.0


def test_as_many_points_as_there_is_room_for(tmp_path: Path) -> None:
    many = "[" + ", ".join(f"[{k}, {k}]" for k in range(8)) + "]"
    assert load_site(site(tmp_path, many)).known_ground().x_m == tuple(map(float, range(8)))


def test_a_site_without_one_has_no_ground(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    path.write_text('[site]\nname = "test"\n', encoding="utf-8")
    assert load_site(path).known_ground() == NO_GROUND


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        ("[]", "ground.profile"),
        ("[" + ", ".join(f"[{k}, 0]" for k in range(9)) + "]", "ground.profile"),
        ("[[0, 0], [0, 1]]", "profile must grow in x from point to point"),
        ("[[1, 0], [0, 1]]", "profile must grow in x from point to point"),
        ("[[0, nan]]", "ground.profile"),
        ("[[0]]", "ground.profile"),
        ('"flat"', "ground.profile"),
    ],
)
def test_a_ground_that_is_none_is_named(tmp_path: Path, profile: str, words: str) -> None:
    with pytest.raises(ConfigError, match=r"site\.toml: .*ground") as error:
        load_site(site(tmp_path, profile))
    assert words in str(error.value)


@pytest.mark.parametrize("name", ["tunnel", "hill"])
def test_the_shipped_ground_is_that_of_the_air(name: str) -> None:
    """Of the board to a centimetre; of the half-cylinder, whose profile is a polygon, to 0.3 m."""
    shipped_site = load_site(shipped(f"sites/{name}.toml"))
    ground, air = shipped_site.known_ground(), shipped_site.air
    if isinstance(air, JetAir):
        slope = radians(air.slope_deg)
        places = [(s * cos(slope), s * sin(slope)) for s in (0.0, 0.5, 1.2, 2.44)]
        assert ground_outline(air) is not None
        tolerance = 0.01
    else:
        assert isinstance(air, HillAir)
        angles = [radians(d) for d in (10, 40, 90, 140, 170)]
        places = [(air.radius_m * cos(a), air.radius_m * sin(a)) for a in angles]
        tolerance = 0.3
    for x, z in places:
        assert clearance(ground, x, z) == pytest.approx(0.0, abs=tolerance)
    # And every line of the site is well clear of it.
    least = shipped_site.parameters["CLEAR_MIN"]
    for line in shipped_site.lines.values():
        assert clearance(ground, line.x_m, line.z_m) > 3.0 * least

"""`tgl-soar site contour`, by geometry: which points stay, which way round a part runs."""

from __future__ import annotations

import tomllib
from itertools import pairwise
from math import hypot, pi, sin
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from tgl_soar.air.zeuc import excess_at
from tgl_soar.cli import site as module
from tgl_soar.cli.app import app
from tgl_soar.cli.site import (
    LONGEST_FRACTION,
    TOLERANCE_M,
    _bounds,
    _from_segment,
    _length,
    _rising_on_the_left,
    _thinned,
    _wrapped,
    contour_table,
    contour_toml,
)
from tgl_soar.config.files import ConfigError, load_airframe, load_site, shipped
from tgl_soar.sim.world import site_field
from tgl_soar.types import GlidePolar

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
SINK = GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=15.0)


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["site", *map(str, words)], env={"COLUMNS": "300"})
    return done.exit_code, done.output


# --- geometry ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("point", "distance"), [
    ((2.0, 3.0), 3.0), ((-3.0, -4.0), 5.0), ((7.0, 4.0), 5.0), ((4.0, 0.0), 0.0), ((0.0, 1.0), 1.0),
    ((1.0, -2.0), 2.0),
])  # fmt: skip
def test_a_distance_from_a_piece_is_to_its_nearest_point(
    point: tuple[float, float], distance: float
) -> None:
    assert _from_segment(point, (0.0, 0.0), (4.0, 0.0)) == pytest.approx(distance)
    turned = (point[1], point[0])
    assert _from_segment(turned, (0.0, 0.0), (0.0, 4.0)) == pytest.approx(distance)
    away = (point[0] + 1.0, point[1] + 2.0)
    assert _from_segment(away, (5.0, 2.0), (1.0, 2.0)) == pytest.approx(distance)


def test_a_piece_without_length_is_a_point() -> None:
    assert _from_segment((4.0, 5.0), (1.0, 1.0), (1.0, 1.0)) == 5.0


def test_a_length_is_the_sum_of_its_pieces() -> None:
    assert _length([(0.0, 0.0), (3.0, 4.0), (3.0, 6.0)]) == 7.0
    assert _length([(1.0, 1.0)]) == 0.0


def test_what_lies_on_a_straight_line_is_left_out() -> None:
    straight = [(0.1 * i, 0.2 * i) for i in range(50)]
    assert _thinned(straight, 0.001) == [straight[0], straight[-1]]
    corner = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 2.0)]
    assert _thinned(corner, 0.001) == [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)]
    two = [(0.0, 0.0), (1.0, 1.0)]
    assert _thinned(two, 0.001) == two


@pytest.mark.parametrize(("high", "kept"), [(0.0101, 3), (0.0099, 2)])
def test_a_point_stays_where_it_lies_farther_off_than_the_tolerance(high: float, kept: int) -> None:
    assert len(_thinned([(0.0, 0.0), (1.0, high), (2.0, 0.0)], 0.01)) == kept


@pytest.mark.parametrize("tolerance_m", [0.001, 0.01, 0.1])
def test_no_point_that_is_left_out_is_farther_off(tolerance_m: float) -> None:
    wave = [(0.05 * i, sin(0.05 * i * pi / 2.0)) for i in range(81)]
    kept = _thinned(wave, tolerance_m)
    assert kept[0] == wave[0]
    assert kept[-1] == wave[-1]
    assert kept == sorted(kept)
    assert 3 < len(kept) < len(wave)
    for point in wave:
        pieces = pairwise(kept)
        assert min(_from_segment(point, a, b) for a, b in pieces) <= tolerance_m


class Layers:
    """An updraft of z - 1 m/s in 8 m/s of wind: it rises above z = 2 m by more than a sink of 1."""

    reference_wind_mps = 8.0

    def __init__(self, sign: float = 1.0) -> None:
        self._sign = sign

    def inside(self, _x: float, _y: float, _z: float) -> bool:
        return True

    def wind_at(self, _x: float, _y: float, z: float, _t: float) -> tuple[float, float, float]:
        return 8.0, 0.0, 1.0 + self._sign * (z - 2.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("turned", [False, True])
def test_rising_air_is_on_the_left(sign: float, turned: bool) -> None:
    """On the left of a part that runs downstream is what lies above it."""
    downstream = [(0.0, 2.0), (1.0, 2.0), (1.0, 2.0), (3.0, 2.0)]
    given = downstream[::-1] if turned else downstream
    field: Any = Layers(sign)
    found = _rising_on_the_left(field, SINK, given)
    assert found == (downstream if sign > 0.0 else downstream[::-1])


def test_six_points_are_on_a_line() -> None:
    assert _wrapped([str(i) for i in range(13)]) == [
        *("    0, 1, 2, 3, 4, 5,", "    6, 7, 8, 9, 10, 11,", "    12,"),
    ]
    assert _wrapped([str(i) for i in range(6)]) == ["    0, 1, 2, 3, 4, 5,"]


def test_the_table_is_toml_in_millimetres() -> None:
    bend = [(0.12345, 1.0), (1.0, 2.0006), (3.0, 1.0)]
    text = contour_table("# why", 'a "b"', [bend, [(0.0, 0.0), (1.0, 0.001), (2.0, 0.0)]])
    assert text.startswith("# why\n[contour]\n")
    assert text.endswith("]\n")
    found = tomllib.loads(text)["contour"]
    assert found == {
        "airframe": 'a "b"',
        "parts": [[[0.123, 1.0], [1.0, 2.001], [3.0, 1.0]], [[0.0, 0.0], [2.0, 0.0]]],
    }
    assert TOLERANCE_M == 0.005
    fine = contour_table("#", "a", [[(0.0, 0.0), (1.0, 0.001), (2.0, 0.0)]], 0.0005)
    assert len(tomllib.loads(fine)["contour"]["parts"][0]) == 3


@pytest.mark.parametrize(("text", "good"), [("1,2,3,4", True), ("-1.5,2,0,4.25", True),
                                            ("1,2,3", False), ("1,2,3,4,5", False),
                                            ("1,2,3,x", False)])  # fmt: skip
def test_bounds_are_four_numbers(text: str, good: bool) -> None:
    if good:
        assert list(_bounds(text)) == [float(part) for part in text.split(",")]
    else:
        with pytest.raises(ConfigError, match="needs 4 numbers with commas"):
            _bounds(text)


# --- into a file -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["tunnel", "hill"])
def test_into_a_site_file_it_takes_the_place_of_the_old_one(name: str, tmp_path: Path) -> None:
    """A file with two [contour] tables is no TOML."""
    site = tmp_path / "site.toml"
    text = shipped(f"sites/{name}.toml").read_text(encoding="utf-8")
    site.write_text(text, encoding="utf-8")
    plane = tmp_path / "own.toml"
    plane.write_text(AIRFRAME.read_text(encoding="utf-8").replace("Eclipson Model C", "mine"))
    words = ("contour", "--site", site, "--airframe", plane)
    assert run(*words, "--into", site) == (0, f"contour in {site}, for mine\n")
    before, after = load_site(shipped(f"sites/{name}.toml")), load_site(site)
    assert after.contour is not None
    assert after.contour.airframe == "mine"
    assert msgspec.structs.replace(after, contour=before.contour) == before
    assert tomllib.loads(run(*words)[1])["contour"]["airframe"] == "mine"


def test_into_and_out_exclude_each_other_and_what_is_no_site_file_is_named(tmp_path: Path) -> None:
    out, site = tmp_path / "out", tmp_path / "none.toml"
    code, output = run("contour", "--out", out, "--into", site)
    assert (code, "--out and --into: give one or the other" in output) == (2, True)
    code, output = run("contour", "--into", site)
    assert (code, f"{site}: cannot be read" in output) == (2, True)
    assert not out.exists()


# --- of a site ---------------------------------------------------------------------------------


def test_the_tunnels_contour_is_where_updraft_is_sink_and_rises_on_the_left() -> None:
    airframe, place = load_airframe(AIRFRAME), load_site(SITE)
    text = contour_toml(airframe, place, SITE.parent, (-1.2, 2.4, 0.05, 3.3))
    assert "`tgl-soar site contour` for a\n# wind of 8.5 m/s" in text
    found = tomllib.loads(text)["contour"]
    assert found["airframe"] == "Eclipson Model C"
    field, polar = site_field(place, SITE.parent), airframe.polar.as_polar()
    for part in found["parts"]:
        for x, z in part[1:-1]:
            assert abs(excess_at(field, polar, x, z)) < 0.05
        rises = falls = 0
        for (xa, za), (xb, zb) in pairwise(part):
            length = hypot(xb - xa, zb - za)
            x = 0.5 * (xa + xb) - 0.05 * (zb - za) / length
            z = 0.5 * (za + zb) + 0.05 * (xb - xa) / length
            excess = excess_at(field, polar, x, z)
            rises, falls = rises + (excess > 0.0), falls + (excess < 0.0)
        assert rises > falls
    # The file has it already.
    known = place.contour_for(airframe.airframe.name)
    assert [len(part) for part in found["parts"]] == [len(part) for part in known]
    for a, b in zip(found["parts"][0], known[0], strict=True):
        assert a == pytest.approx(b, abs=0.011)


def test_parts_that_are_short_beside_the_longest_are_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    long = [(0.0, 0.0), (20.0, 0.0)]
    kept, noise = [(0.0, 2.0), (1.0, 2.0)], [(0.0, 3.0), (0.99, 3.0)]
    monkeypatch.setattr(module, "contour", lambda *_given: [noise, long, kept])
    monkeypatch.setattr(module, "_rising_on_the_left", lambda _field, _polar, part: part)
    text = contour_toml(load_airframe(AIRFRAME), load_site(SITE), SITE.parent, (0, 1, 0, 1))
    parts = tomllib.loads(text)["contour"]["parts"]
    assert [part[0][1] for part in parts] == [0.0, 2.0]
    assert LONGEST_FRACTION == 0.05


def test_it_is_printed_or_written_and_where_it_goes_is_reported(tmp_path: Path) -> None:
    area = ("--bounds", "0,1,1,2.2")
    code, printed = run("contour", *area)
    assert code == 0
    assert tomllib.loads(printed)["contour"]["airframe"] == "Eclipson Model C"
    out = tmp_path / "contour.toml"
    code, output = run("contour", *area, "--out", out)
    assert code == 0
    assert out.read_text(encoding="utf-8") == printed
    assert output == f"contour in {out}: put it into {SITE}, or let --into do it\n"
    code, output = run("contour", *area, "--out", tmp_path / "no" / "such.toml")
    assert (code, "such.toml: cannot be written: No such file or directory" in output) == (2, True)


@pytest.mark.parametrize("option", ["--site", "--airframe"])
def test_no_file_that_it_is_computed_from_is_written(option: str, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    kept = {"--site": SITE, "--airframe": AIRFRAME}[option].read_text(encoding="utf-8")
    own.write_text(kept, encoding="utf-8")
    out = tmp_path / "." / "own.toml"
    code, output = run("contour", "--bounds", "0,1,1,2.2", option, own, "--out", out)
    assert (code, "that is a file that it is computed from" in output) == (2, True)
    assert own.read_text(encoding="utf-8") == kept


def test_a_site_without_air_has_none(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    path.write_text('[site]\nname = "bare"\nwind_from_deg = 0.0\n', encoding="utf-8")
    code, output = run("contour", "--site", path, "--bounds", "0,1,0,1")
    assert (code, "site bare: no [air] table, so there is no wind to map" in output) == (2, True)
    code, output = run("misfit", "--site", path)
    assert (code, 'only the wind of kind = "polynomial" is fitted to another' in output) == (
        2,
        True,
    )
    assert run("misfit")[0] == 2


def test_a_polynomial_wind_tells_its_misfit(tmp_path: Path) -> None:
    text = SITE.read_text(encoding="utf-8").replace(
        '[air]\nkind = "jet"\nwind_mps = 8.5\nslope_deg = 23.0\n',
        '[air]\nkind = "polynomial"\ndegree = 3\nx_m = [0.0, 1.5]\nz_m = [1.0, 2.0]\n'
        '[air.of]\nkind = "jet"\nwind_mps = 8.5\nslope_deg = 23.0\n',
    )
    path = tmp_path / "site.toml"
    path.write_text(text, encoding="utf-8")
    code, output = run("misfit", "--site", path)
    assert code == 0, output
    assert "m/s" in output


def test_a_wind_record_says_its_length_mean_and_ends(tmp_path: Path) -> None:
    path = tmp_path / "wind.csv"
    code, output = run(
        "wind", path, "--hours", "0.05", "--mean", "9", "--veer", "0", "--lulls", "0"
    )
    assert code == 0, output
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()
            if line[:1].isdigit()]  # fmt: skip
    speeds = [float(row[1]) for row in rows]
    assert float(rows[-1][0]) - float(rows[0][0]) == pytest.approx(180.0, abs=2.0)
    assert output == (
        f"{path}: 0.05 h, {sum(speeds) / len(speeds):.1f} m/s in the mean, from"
        f" {min(speeds):.1f} to {max(speeds):.1f}\n"
    )

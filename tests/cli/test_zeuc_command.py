"""`tgl-soar zeuc`: its lines, its crossings and its file, against the air that is mapped."""

from __future__ import annotations

import json
from math import degrees, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from tgl_soar.air.zeuc import ZeucError, excess_at
from tgl_soar.cli import zeuc as module
from tgl_soar.cli.app import app
from tgl_soar.cli.zeuc import _crossings, _lines, _numbers, _row, _written
from tgl_soar.config.files import ConfigError, load_airframe, load_flight, load_site, shipped
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.world import site_field
from tgl_soar.types import GlidePolar

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")


def run(folder: Path, *arguments: object, code: int = 0) -> tuple[dict[str, Any], str]:
    out = folder / "map.svg"
    words = ["zeuc", "--out", str(out), *map(str, arguments)]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == code, done.output
    data = folder / "map.json"
    return json.loads(data.read_text(encoding="utf-8")) if data.exists() else {}, done.output


@pytest.fixture(scope="module")
def tunnel(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str]:
    return run(tmp_path_factory.mktemp("zeuc"))


def test_the_lines_of_the_site_cross_the_contour_of_its_air(
    tunnel: tuple[dict[str, Any], str],
) -> None:
    found, _ = tunnel
    assert found["site"] == "open jet, board at 23 degrees"
    assert found["airframe"] == "Eclipson Model C"
    assert list(found["lines"]) == ["a", "b", "c"]
    assert found["bounds_m"] == [-1.2, 2.4, 0.05, 3.3]
    place = load_site(SITE)
    field, polar = site_field(place, SITE.parent), load_airframe(AIRFRAME).polar.as_polar()
    for line in found["lines"].values():
        assert line["lean_deg"] == pytest.approx(15.0)
        crossings = line["crossings"]
        assert any(c["stable"] for c in crossings)
        assert [c["z_m"] for c in crossings] == sorted(c["z_m"] for c in crossings)
        for c in crossings:
            assert excess_at(field, polar, c["x_m"], c["z_m"]) == pytest.approx(0.0, abs=0.01)
            # The point lies on the line, which leans upwind by its angle.
            away = (c["x_m"] - line["x_m"]) + (c["z_m"] - line["z_m"]) * tan(radians(15.0))
            assert away == pytest.approx(0.0, abs=1e-6)
            assert c["stable"] == (c["excess_slope_per_s"] < 0.0)
    core = found["core"]
    at_core = excess_at(field, polar, core["x_m"], core["z_m"])
    assert at_core == pytest.approx(core["excess_mps"], abs=1e-3)
    for step in (-0.05, 0.05):
        # NaN: in the board.
        assert not excess_at(field, polar, core["x_m"] + step, core["z_m"]) > at_core + 1e-3
    assert min(len(part) for part in found["contour_m"]) > 2


def test_what_is_printed_is_what_is_in_the_file(tunnel: tuple[dict[str, Any], str]) -> None:
    found, output = tunnel
    core = found["core"]
    words = " ".join(output.split())
    assert (
        f"core at x {core['x_m']:.2f}, z {core['z_m']:.2f} m: excess updraft"
        f" {core['excess_mps']:.2f} m/s (updraft {core['updraft_mps']:.2f} m/s in a wind of"
        f" {core['wind_mps']:.2f} m/s)"
    ) in words
    for line in found["lines"].values():
        for c in line["crossings"]:
            assert f"{c['x_m']:.3f}" in output
            assert f"{c['z_m']:.3f}" in output


def test_lines_and_leans_of_the_options(tmp_path: Path) -> None:
    _, place, values = load_flight(AIRFRAME, SITE)
    own = _lines(["0.5,1.5,10", "1,2,-5"], None, place, values)
    assert list(own) == ["1", "2"]
    assert (own["1"].x_m, own["1"].z_m) == (0.5, 1.5)
    assert degrees(own["1"].eta_rad) == pytest.approx(100.0)
    assert degrees(own["2"].eta_rad) == pytest.approx(85.0)
    leaning = _lines(None, 20.0, place, values)
    assert list(leaning) == ["a", "b", "c"]
    assert {round(degrees(each.eta_rad), 9) for each in leaning.values()} == {110.0}
    assert (leaning["b"].x_m, leaning["b"].z_m) == (0.6, 1.6)
    assert degrees(_lines(["0,1,10"], 0.0, place, values)["1"].eta_rad) == pytest.approx(90.0)
    text = SITE.read_text(encoding="utf-8").replace(
        "a = { x_m = 0.20, z_m = 1.15 }", "a = { x_m = 0.20, z_m = 1.15, lean_deg = 5.0 }"
    )
    (tmp_path / "site.toml").write_text(text, encoding="utf-8")
    named = _lines(None, None, load_site(tmp_path / "site.toml"), values)
    assert degrees(named["a"].eta_rad) == pytest.approx(95.0)
    assert degrees(named["b"].eta_rad) == pytest.approx(105.0)


@pytest.mark.parametrize(("text", "count", "good"), [
    ("1,2,3", 3, True), ("1,2", 3, False), ("1,2,3,4", 3, False), ("1,x,3", 3, False),
    ("-1.5,2,3,4", 4, True), ("", 4, False),
])  # fmt: skip
def test_numbers_with_commas_are_counted(text: str, count: int, good: bool) -> None:
    if good:
        assert _numbers(text, count, "--line") == [float(part) for part in text.split(",")]
    else:
        with pytest.raises(ConfigError, match=f"--line {text!r}: needs {count} numbers with com"):
            _numbers(text, count, "--line")


@pytest.mark.parametrize(("arguments", "words"), [
    (("--line", "1,2"), "--line '1,2': needs 3 numbers"),
    (("--bounds", "1,2,3"), "--bounds '1,2,3': needs 4 numbers"),
])  # fmt: skip
def test_what_is_no_line_or_no_bounds_is_refused(
    arguments: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    found, output = run(tmp_path, *arguments, code=2)
    assert words in output
    assert found == {}


def test_a_site_without_air_has_no_map(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    site.write_text('[site]\nname = "bare"\nwind_from_deg = 0.0\n', encoding="utf-8")
    _, output = run(tmp_path, "--site", site, code=2)
    assert f"{site}: no [air] table, so there is no wind to map" in output


def test_a_line_that_meets_nothing_is_reported(tmp_path: Path) -> None:
    found, output = run(tmp_path, "--line", "-60,1,15", "--bounds=-0.5,2.3,0.2,2.9")
    assert found["lines"]["1"]["crossings"] == []
    assert "meets no contour" in output
    assert found["bounds_m"] == [-0.5, 2.3, 0.2, 2.9]


# --- crossings ---------------------------------------------------------------------------------


class Level:
    """A wind of 8 m/s everywhere, with an updraft of 1 m/s at z = 2 m, that falls by 0.5 /s up."""

    reference_wind_mps = 8.0

    def inside(self, _x: float, _y: float, _z: float) -> bool:
        return True

    def wind_at(self, _x: float, _y: float, z: float, _t: float) -> tuple[float, float, float]:
        return 8.0, 0.0, 1.0 - 0.5 * (z - 2.0)

    def wind(self, x: Any, _y: Any, z: Any, _t: float = 0.0) -> Any:
        z_m = np.asarray(z, dtype=float) + 0.0 * np.asarray(x)
        return 8.0 + 0.0 * z_m, 0.0 * z_m, 1.0 - 0.5 * (z_m - 2.0)


SINK = GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=15.0)


def test_a_crossing_in_air_in_layers_is_known_by_hand() -> None:
    (found,) = _crossings(Level(), SINK, TargetLine(0.0, 1.0, radians(90.0)))
    assert (found["x_m"], found["z_m"]) == pytest.approx((0.0, 2.0), abs=1e-6)
    assert found["excess_slope_per_s"] == pytest.approx(-0.5, rel=1e-3)
    assert found["stable"]
    assert found["perpendicular_lean_deg"] == pytest.approx(0.0, abs=1e-6)
    low, high = found["leans_deg"]
    assert low < 0.0 < high
    assert abs(low) > 10.0
    assert high > 10.0


def test_what_has_no_leans_and_no_sensitivity_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_given: Any) -> Any:
        raise ZeucError("none")

    monkeypatch.setattr(module, "feasible_leans", none)
    monkeypatch.setattr(module, "wind_sensitivity", none)
    (found,) = _crossings(Level(), SINK, TargetLine(0.0, 1.0, radians(90.0)))
    assert (found["leans_deg"], found["sensitivity"]) == (None, None)
    assert _row(found)[-2:] == ["–", "–"]


def test_a_row_of_the_table() -> None:
    crossing = {
        "x_m": 0.12345, "z_m": 1.5, "wind_mps": 8.456, "updraft_mps": 1.234,
        "excess_slope_per_s": -0.456, "stable": True, "leans_deg": (-12.4, 40.2),
        "sensitivity": {"along_m_per_mps": 0.123},
    }  # fmt: skip
    assert _row(crossing) == [
        *("0.123", "1.500", "8.46", "1.23", "-0.46", "yes", "-12° … 40°", "+12.3 cm")
    ]
    assert "no" in _row({**crossing, "stable": False})[5]


def test_the_numbers_are_written_beside_the_figure_into_a_new_folder(tmp_path: Path) -> None:
    path = _written(tmp_path / "new" / "folder" / "map.png", {"x": 1.25})
    assert path == tmp_path / "new" / "folder" / "map.json"
    assert json.loads(path.read_text(encoding="utf-8")) == {"x": 1.25}
    assert _written(tmp_path / "new" / "folder" / "map.png", {"x": 1.0}) == path  # once more

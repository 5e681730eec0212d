"""Scenario files: what is refused and how, and where lines and air come from."""

from __future__ import annotations

from math import cos, degrees, radians, sin
from pathlib import Path

import pytest

from tgl_soar.air.zeuc import excess_at
from tgl_soar.analysis.experiments.scenario import (
    load_scenario,
    perpendicular_lean,
    prepare,
    slide_at,
)
from tgl_soar.config.files import ConfigError, shipped
from tgl_soar.estimation.polar import best_glide_speed

SHIPPED = sorted(path.name for path in shipped("scenarios").glob("*.toml"))

GOOD = """
title = "a test"
site = "sites/tunnel.toml"
duration_s = 20.0
first_line = "a"
changes = [{ time_s = 10.0, line = "b" }]

[lines]
a = { speed_ratio = 0.92, lean_deg = 20.0 }
b = { pivot = "a", below_m = 0.4, lean_deg = 30.0 }
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_scenario_loads_and_places_its_lines(name: str) -> None:
    prepared = prepare(load_scenario(shipped(f"scenarios/{name}")))
    for line, (target, crossing) in prepared.lines.items():
        assert crossing is not None, line
        assert crossing.stable
        assert slide_at(prepared.polar, target, crossing).rate_per_s > 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("duration_s = 20.0", "duration_s = -1.0", ["duration_s", "-1.0", "above 0"]),
        ("duration_s = 20.0", 'duration_s = "long"', ["duration_s", "long", "number"]),
        ("duration_s = 20.0", "duration_s = 20.0\nlength = 3", ["length"]),
        ('first_line = "a"', 'first_line = "z"', ["'z'", "a, b"]),
        ('line = "b"', 'line = "q"', ["'q'", "a, b"]),
        ("time_s = 10.0", "time_s = 30.0", ["30", "20"]),
        ("sites/tunnel.toml", "sites/nowhere.toml", ["site", "nowhere.toml"]),
        ('site = "sites/tunnel.toml"', "", ["either a site or an [air]"]),
        ("speed_ratio = 0.92", "speed_ratio = 1.9", ["lines.a", "speed_ratio", "best glide"]),
        ("speed_ratio = 0.92,", "speed_ratio = 0.92, x_m = 1.0,", ["only one"]),
        ('pivot = "a"', 'pivot = "b"', ["lines.b", "pivot"]),
        ("lean_deg = 20.0", "lean_deg = 2.0", ["lines.a", "TGL_LEAN", "TGL_LEAN_MIN"]),
        ("lean_deg = 30.0", "lean_deg = 55.0", ["10 s", "TGL_LEAN_MAX"]),
        ("first_line", "seeds = []\nfirst_line", ["seeds"]),
        (
            "[lines]",
            "[wind]\ntimes_s = [3.0, 2.0]\nmps = [8.0, 9.0]\n[lines]",
            ["wind", "must increase"],
        ),
        ("[lines]", "[slope]\ntimes_s = [3.0]\ndeg = [50.0]\n[lines]", ["slope", "deg", "35"]),
        ("[lines]", "[parameters]\nRHO_Q = 1.0\n[lines]", ["parameters", "RHO_Q", "no such"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, words: list[str]) -> None:
    assert old in GOOD
    path = write(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    for word in words:
        assert word in message


def test_a_line_stands_where_its_speed_ratio_says(tmp_path: Path) -> None:
    prepared = prepare(load_scenario(write(tmp_path, GOOD)))
    target, at = prepared.lines["a"]
    assert at is not None
    # Interpolated between contour vertices 2 cm apart; the wind changes by 1 m/s over a metre.
    ratio = at.wind_mps / best_glide_speed(prepared.polar)
    assert ratio == pytest.approx(0.92, abs=2e-3)
    assert abs(excess_at(prepared.field, prepared.polar, at.x_m, at.z_m)) < 1e-4
    assert degrees(target.eta_rad) == pytest.approx(110.0)


def test_a_pivoted_line_turns_about_a_point_below_the_other(tmp_path: Path) -> None:
    prepared = prepare(load_scenario(write(tmp_path, GOOD)))
    a, b = prepared.lines["a"], prepared.lines["b"]
    assert a.crossing is not None
    below = complex(a.crossing.x_m - b.target.x_m, a.crossing.z_m - b.target.z_m)
    assert abs(below) == pytest.approx(0.4, abs=1e-9)
    assert below.imag > 0.0


def test_the_start_lies_downstream_of_the_first_crossing(tmp_path: Path) -> None:
    prepared = prepare(load_scenario(write(tmp_path, GOOD)))
    at, start = prepared.lines["a"].crossing, prepared.site.start
    assert at is not None
    assert start is not None
    assert start.x_m - at.x_m == pytest.approx(0.3)
    assert start.z_m == at.z_m


def test_wind_and_slope_change_on_schedule(tmp_path: Path) -> None:
    text = GOOD.replace(
        "[lines]",
        "[wind]\ntimes_s = [5.0, 6.0]\nmps = [8.5, 10.2]\n"
        "[slope]\ntimes_s = [8.0, 9.0]\ndeg = [23.0, 25.0]\n[lines]",
    )
    field = prepare(load_scenario(write(tmp_path, text))).field
    place = (0.5, 0.0, 1.5)
    before, windy, steep = (field.wind_at(*place, t) for t in (0.0, 7.0, 10.0))
    assert windy[0] == pytest.approx(1.2 * before[0])
    assert windy[2] == pytest.approx(1.2 * before[2])
    assert steep[2] > 1.02 * windy[2]  # two degrees more of 23 are 9 % more updraft, at most


def test_an_inline_hill_needs_no_site(tmp_path: Path) -> None:
    text = GOOD.replace('site = "sites/tunnel.toml"\n', "").replace(
        "[lines]", '[air]\nkind = "hill"\nwind_mps = 8.0\nradius_m = 20.0\n[lines]'
    )
    prepared = prepare(load_scenario(write(tmp_path, text)))
    assert prepared.field.reference_wind_mps == 8.0
    assert prepared.lines["a"].crossing is not None


def test_the_perpendicular_goes_straight_down_the_excess() -> None:
    prepared = prepare(load_scenario(shipped("scenarios/static.toml")))
    at = prepared.lines["a"].crossing
    assert at is not None
    lean = perpendicular_lean(prepared.field, prepared.polar, at.x_m, at.z_m)
    step = 0.05

    def fall(turned_rad: float) -> float:
        x, z = at.x_m - step * sin(lean + turned_rad), at.z_m + step * cos(lean + turned_rad)
        return -excess_at(prepared.field, prepared.polar, x, z)

    assert fall(0.0) > max(fall(radians(20.0)), fall(radians(-20.0))) > 0.0

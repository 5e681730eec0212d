"""Three places on a hill: each of them by the formulas of potential flow and of the parabola."""

from __future__ import annotations

from functools import cache
from math import atan2, cos, degrees, hypot, sin, sqrt
from pathlib import Path
from typing import Any

import pytest
from by_hand import ScriptedFlyer, signs

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.paper.field import (
    BOUNDS,
    POLAR,
    HillPosition,
    claims_of,
    positions,
    run,
)
from tgl_soar.analysis.experiments.result import Result
from tgl_soar.analysis.report import positions_figure as positions_figures

BEST_MPS = sqrt(9.0**2 + 1.5 / 0.2)


@cache
def places() -> list[HillPosition]:
    return positions()


@cache
def result() -> Result:
    return run(Context(flyer=ScriptedFlyer(lambda _: None)))


def hill(x_m: float, z_m: float, wind_mps: float) -> tuple[float, float]:
    """Wind over a half cylinder of 20 m: w − i u of U (1 − R²/ζ²)."""
    flow = wind_mps * (1.0 - 20.0**2 / complex(x_m, z_m) ** 2)
    return flow.real, -flow.imag


def sink(u_mps: float) -> float:
    return 1.5 + 0.2 * (u_mps - 9.0) ** 2


def excess(x_m: float, z_m: float, wind_mps: float = 8.0) -> float:
    u, w = hill(x_m, z_m, wind_mps)
    return w - sink(u)


def test_the_polar_is_the_parabola_of_the_page() -> None:
    for u in (6.8, 8.0, 9.0, 11.5):
        assert POLAR.c0 + POLAR.c1 * u + POLAR.c2 * u**2 == pytest.approx(sink(u))
    assert POLAR.c3 == 0.0
    assert (POLAR.speed_min_mps, POLAR.speed_max_mps) == (6.8, 11.5)
    assert BOUNDS == (-60.0, 0.0, 1.0, 50.0)


def test_each_place_is_on_the_contour_at_its_speed() -> None:
    assert [place.name for place in places()] == ["a", "b", "c"]
    for place, speed_mps in zip(places(), (8.0, BEST_MPS, 10.0), strict=True):
        u, w = hill(place.x_m, place.z_m, 8.0)
        assert place.wind_mps == pytest.approx(u, rel=1e-6)
        assert u == pytest.approx(speed_mps, rel=2e-3)
        assert place.updraft_mps == pytest.approx(w, rel=1e-6)
        assert w == pytest.approx(sink(u), abs=1e-3)
        assert place.x_m < 0.0
        assert place.stable


def test_each_line_is_perpendicular_to_the_contour_and_its_place_moves_along_it() -> None:
    """The line goes down the gradient of excess updraft; where it meets the contour in five per
    cent more wind is sought by halving."""
    for place in places():
        h = 1e-4
        gx = (excess(place.x_m + h, place.z_m) - excess(place.x_m - h, place.z_m)) / (2.0 * h)
        gz = (excess(place.x_m, place.z_m + h) - excess(place.x_m, place.z_m - h)) / (2.0 * h)
        assert place.lean_rad == pytest.approx(atan2(gx, -gz), abs=1e-3)
        up = -gx / hypot(gx, gz), -gz / hypot(gx, gz)
        low, high = -5.0, 5.0
        for _ in range(50):
            s = 0.5 * (low + high)
            rises = excess(place.x_m + s * up[0], place.z_m + s * up[1], 8.4) > 0.0
            low, high = (s, high) if rises else (low, s)
        assert place.shift_m == pytest.approx(low, abs=0.01)
        u, w = hill(place.x_m, place.z_m, 8.0)
        margin = w / u - 0.4 * (u - 9.0)
        assert place.sensitivity.margin == pytest.approx(margin, abs=1e-3)
        per_mps = u * margin / 8.0 / hypot(gx, gz)
        assert place.sensitivity.along_m_per_mps == pytest.approx(per_mps, abs=0.02)


def test_the_same_sink_is_asked_of_a_and_c_within_five_millimetres_a_second() -> None:
    a, b, c = places()

    def first(a: HillPosition, c: HillPosition) -> str:
        return signs(claims_of([a, b, c]))[0]

    for off, sign in ((0.0045, "✓"), (0.0055, "✗"), (-0.0045, "✓"), (-0.0055, "✗")):
        assert first(a._replace(updraft_mps=1.7 + off), c) == sign
        assert first(a, c._replace(updraft_mps=1.7 + off)) == sign
    assert first(a._replace(wind_mps=c.wind_mps), c) == "✗"


def test_each_place_must_be_stable() -> None:
    for k in range(3):
        several = [p._replace(stable=i != k) for i, p in enumerate(places())]
        assert signs(claims_of(several)) == "✓✗✓"


@pytest.mark.parametrize(
    ("k", "what", "value", "sign"),
    [
        (0, "along_m_per_mps", 0.0, "✗"),
        (0, "along_m_per_mps", 0.01, "✓"),
        (2, "along_m_per_mps", 0.0, "✗"),
        (2, "along_m_per_mps", -0.01, "✓"),
        (1, "margin", 0.0019, "✓"),
        (1, "margin", 0.0021, "✗"),
        (1, "margin", -0.0019, "✓"),
        (1, "margin", -0.0021, "✗"),
    ],
)
def test_signs_are_by_construction_and_best_glide_stays(
    k: int, what: str, value: Any, sign: str
) -> None:
    several = list(places())
    sensitivity = several[k].sensitivity._replace(**{what: value})
    several[k] = several[k]._replace(sensitivity=sensitivity)
    claims = claims_of(several)
    assert signs(claims)[2] == sign
    assert [claim.by_construction for claim in claims] == [False, False, True]


def test_the_table_has_a_row_for_each_place() -> None:
    (table,) = result().tables
    assert [row[0] for row in table.rows] == ["[a]", "[b]", "[c]"]
    for row, place in zip(table.rows, places(), strict=True):
        assert row[5] == f"{0.4 * (place.wind_mps - 9.0):+.3f}"
        assert row[7] == f"{degrees(place.lean_rad):.0f}"
        assert row[9] == f"{place.shift_m:+.2f}"
        assert len(row) == len(table.columns)
    assert table.columns[-1] == "shift in 5 % more wind [m]"
    assert "5 % more wind move it" in result().why
    assert result().figures == ()
    assert result().numbers["best_glide_mps"] == pytest.approx(BEST_MPS, abs=1e-3)
    assert result().numbers["sink_at_best_glide_mps"] == pytest.approx(sink(BEST_MPS), abs=1e-3)
    assert [p["name"] for p in result().numbers["places"]] == ["a", "b", "c"]
    assert result().numbers["places"][0]["sensitivity"]["margin"] > 0.0


def test_the_map_is_of_the_hill_in_its_wind_and_in_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(positions_figures, "positions_figure", lambda *given: drawn.append(given))
    figures = run(Context(flyer=ScriptedFlyer(lambda _: None), figures=tmp_path)).figures
    assert figures == ("field.png",)
    ((path, field, stronger, _, bounds, radius_m, marked, label),) = drawn
    assert path == tmp_path / "field.png"
    assert field.wind_at(-20.0, 0.0, 20.0, 0.0)[0] == pytest.approx(hill(-20.0, 20.0, 8.0)[0])
    assert stronger.wind_at(-20.0, 0.0, 20.0, 0.0)[0] == pytest.approx(hill(-20.0, 20.0, 8.4)[0])
    assert (bounds, radius_m, label) == (BOUNDS, 20.0, "ZEUC in 5 % more wind")
    assert [place.name for place in marked] == ["a", "b", "c"]
    assert cos(marked[0].lean_rad) > abs(sin(marked[0].lean_rad)) * 0.1

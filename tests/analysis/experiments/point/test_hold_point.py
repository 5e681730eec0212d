"""The experiment `point`: its band, its paths, and how it judges flights."""

from __future__ import annotations

from math import nan, pi

import numpy as np
import pytest

from tgl_soar.analysis.experiments.flights import FlownScenario
from tgl_soar.analysis.experiments.point.hold_point import (
    RADIUS_M,
    SIDE_M,
    _claims,
    band,
    circle,
    flying_path,
    held,
    path_error,
    square,
    with_point,
)
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.config.files import shipped

TUNNEL, HILL = (load_scenario(shipped(f"scenarios/point{end}.toml")) for end in ("", "_hill"))


def flight(off_m: float, e_rho_m: float, ended: str = "", held_: bool = True) -> FlownScenario:
    time = np.arange(0.0, 30.0, 0.02)
    sign = np.where(np.arange(len(time)) % 2, 1.0, -1.0)
    path = {
        "time_s": time,
        "x_m": 0.0 * time,
        "z_m": off_m * sign,
        "e_rho_m": e_rho_m * sign,
        "point_off_m": off_m * sign if held_ else nan * time,
        "brake": 0.5 + 0.0 * time,
        "point": (1.0 if held_ else 0.0) + 0.0 * time,
    }
    return FlownScenario(seed=1, ended=ended, duration_s=30.0, legs=(), path=path)


@pytest.mark.parametrize(("scenario", "width"), [(TUNNEL, 0.33), (HILL, 1.6)])
def test_the_band_is_as_wide_as_the_brakes_sink_over_the_slope_of_the_lift(
    scenario: object, width: float
) -> None:
    low, middle, high = band(prepare(scenario))  # type: ignore[arg-type]
    assert low < middle < high
    assert high - low == pytest.approx(width, rel=0.1)


def test_flights_are_pooled_about_the_point_or_their_own_mean() -> None:
    point = held([flight(0.02, 0.01), flight(0.04, 0.01, "hit the board")], 0.5 * pi, 5.0)
    assert point.along_m == pytest.approx(np.sqrt(0.5 * (0.02**2 + 0.04**2)))
    assert (point.flown, point.lasted) == (2, 1)
    line = held([flight(0.02, 0.01, held_=False)], 0.5 * pi, 5.0)
    assert line.along_m == pytest.approx(0.02)
    assert line.across_m == pytest.approx(0.01)


@pytest.mark.parametrize(("drift", "holds"), [(0.44, True), (0.46, False)])
def test_a_claim_is_judged_by_its_own_number(drift: float, holds: bool) -> None:
    line = held([flight(0.1, 0.01, held_=False)], 0.5 * pi, 5.0)
    point = held([flight(drift * 0.1, 0.0105)], 0.5 * pi, 5.0)
    kept = {(k, i): h for k, h in (("line", line), ("point", point)) for i in (0.01, 0.03, 0.05)}
    first, across, lasting, gentle = _claims(kept)
    assert first.holds == holds
    assert across.holds
    assert lasting.holds
    assert not gentle.holds


def test_paths_close_and_are_as_large_as_they_say() -> None:
    for path, size in ((circle(), 2.0 * RADIUS_M), (square(), SIDE_M)):
        places = np.array(path)
        assert path[0] == pytest.approx(path[-1])
        assert np.ptp(places, axis=0) == pytest.approx([size, size], rel=0.01)
        assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.006


def test_a_path_is_flown_about_the_point_that_is_held() -> None:
    scenario = flying_path(with_point(TUNNEL, -0.1), square(), 15.0)
    prepared = prepare(scenario)
    target = prepared.lines["b"].target
    assert prepared.values["TGL_HOLD"] == 1.0
    first = prepared.changes[0].parameters
    assert (first["TGL_X"] - target.x_m, first["TGL_Z"] - target.z_m) == pytest.approx(square()[0])
    on = flight(0.0, 0.0)
    on.path["x_m"] = np.full_like(on.path["x_m"], target.x_m - 0.1 * np.cos(target.eta_rad))
    on.path["z_m"] = np.full_like(on.path["z_m"], target.z_m - 0.1 * np.sin(target.eta_rad))
    # In the middle of the square: half a side from it.
    error = path_error(on, prepared, square(), -0.1, 15.0)
    assert error == pytest.approx(0.5 * SIDE_M, rel=0.01)

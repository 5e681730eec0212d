"""What the figures of a search are drawn from: the true excess at a place, glimpses from a log with
their times and units, and the times of the frames."""

from __future__ import annotations

from dataclasses import replace
from math import isnan
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from test_map_from_log import SITE, hovering, task

from tgl_soar.air.field import WindField
from tgl_soar.analysis.logs.flight_data import FlightData, Series
from tgl_soar.analysis.search import map_from_log as e
from tgl_soar.analysis.search.figures import true_excess
from tgl_soar.analysis.search.places import SearchPlace, place
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.site import Site
from tgl_soar.control.target_line import LineTracking
from tgl_soar.sim.world import build_field

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()


# --- the true excess ------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "seed", "late_s"), [("tunnel", 1, 40.0), ("hill", 4, 0.0)])
def test_the_true_excess_is_the_air_of_that_time_less_the_true_aircrafts_sink(
    kind: Any, seed: int, late_s: float
) -> None:
    there = place(kind, seed)
    box = there.box
    x = np.linspace(box.x_min_m, box.x_max_m, 7)
    z = np.linspace(box.z_min_m, box.z_max_m, 9)
    found = true_excess(there, POLAR, x, z, late_s)
    assert found.shape == (7, 9)
    known = 0
    for i, j in np.argwhere(np.isfinite(found)).tolist():
        u, _, w = there.field.wind_at(float(x[i]), 0.0, float(z[j]), late_s)
        if not POLAR.speed_min_mps < u < POLAR.speed_max_mps:
            continue
        known += 1
        sinks = np.polyval([POLAR.c3, POLAR.c2, POLAR.c1, POLAR.c0], u)
        assert found[i, j] == pytest.approx(w - there.sink_factor * sinks)
    assert known > 10


def test_there_is_no_excess_in_the_ground() -> None:
    """Over a board from the origin; of the eight points of a ground three are set."""
    there = place("tunnel", 1)
    ground: Any = there.site.ground
    (_, (x0, z0), (x1, z1)) = ground.profile
    x = np.array([-0.4, 0.5 * (x0 + x1)])
    middle = 0.5 * (z0 + z1)
    z = np.array([-0.01, 0.01, middle - 0.01, middle + 0.01])
    found = true_excess(there, POLAR, x, z, 0.0)
    assert np.isnan(found).tolist() == [[True, False, False, False], [True, True, True, False]]


# --- glimpses of a log ----------------------------------------------------------------------------


def moving() -> FlightData:
    """Two seconds of a flight whose place, speed and line change."""
    time = np.arange(0.0, 2.0, 0.005)

    def series(**columns: np.ndarray) -> Series:
        return Series(time, columns, "test")

    return FlightData(
        name="test",
        kind="test",
        path=series(x_m=0.5 - 0.1 * time, y_m=0.02 * time, z_m=1.3 + 0.2 * time),
        motion=series(
            velocity_x_mps=-0.1 + 0.0 * time, velocity_y_mps=0.02 + 0.0 * time, climb_mps=0.2 * time
        ),
        air=series(wind_mps=8.0 + time, updraft_mps=1.0 + 0.5 * time),
        line=series(
            x_m=np.where(time < 1.0, 0.2, 0.3),
            z_m=np.where(time < 1.0, 1.3, 1.4),
            eta_rad=np.where(time < 1.0, 1.8, 1.9),
            moving=np.where(time < 1.0, 0.0, 1.0),
        ),
    )


def test_a_glimpse_is_of_the_logs_place_and_speed_at_rest_in_attitude() -> None:
    found = e.glimpses_of(moving(), 0.4, 1.5)
    assert len(found) == 5  # from 0.4 s on, each 0.2 s: the first only begins an interval
    glimpse = found[0]
    assert (glimpse.before.time_s, glimpse.now.time_s) == pytest.approx((0.4, 0.6))
    now = glimpse.now
    assert (now.x_m, now.y_m, now.z_m) == pytest.approx((0.44, 0.012, 1.42))
    speeds = (now.velocity_x_mps, now.velocity_y_mps, now.climb_mps)
    assert speeds == pytest.approx((-0.1, 0.02, 0.12))
    assert [
        value for name, value in now._asdict().items() if name.endswith(("_rad", "_radps"))
    ] == [0.0] * 6
    assert glimpse.wind_mps == pytest.approx(8.5, abs=0.01)
    assert glimpse.updraft_mps == pytest.approx(1.25, abs=0.01)
    assert glimpse.pitot
    assert not glimpse.seeks
    assert not glimpse.refused


def test_the_line_of_a_glimpse_is_the_last_that_was_logged() -> None:
    found = {round(g.now.time_s, 3): g.line for g in e.glimpses_of(moving(), 0.4, 1.5)}
    assert found[0.8] == LineTracking(
        x_m=0.2, z_m=1.3, eta_rad=1.8, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0
    )
    assert found[1.2] == LineTracking(
        x_m=0.3, z_m=1.4, eta_rad=1.9, moving=True, e_rho_m=0.0, e_rho_rate_mps=0.0
    )


def test_where_no_air_was_logged_its_wind_is_unknown() -> None:
    flight = moving()
    air = cast("Series", flight.air)
    early = air.time_s < 0.9
    columns = {name: column[early] for name, column in air.columns.items()}
    flight = replace(flight, air=Series(air.time_s[early], columns, "test"))
    found = e.glimpses_of(flight, 0.4, 1.5)
    assert [isnan(g.wind_mps) for g in found] == [False, False, False, True, True]
    assert found[2].wind_mps == pytest.approx(8.85, abs=0.01)
    assert found[-1].updraft_mps == 0.0


@pytest.mark.parametrize("part", ["path", "motion", "air", "line"])
def test_a_log_that_lacks_a_part_has_no_glimpse(part: str) -> None:
    flight, without = moving(), cast("dict[str, Any]", {part: None})
    assert e.glimpses_of(flight, 0.4, 1.5)
    assert e.glimpses_of(replace(flight, **without), 0.4, 1.5) == []


# --- frames ---------------------------------------------------------------------------------------


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What figures are made of."""
    given: list[tuple[Any, ...]] = []
    monkeypatch.setattr(e, "search_figure", lambda *parts: given.append(parts))
    return given


def site_and_field() -> tuple[Site, WindField]:
    site = load_site(SITE)
    assert site.air is not None
    return site, build_field(site.air, SITE.parent)


def test_frames_are_of_0_6_and_2_and_5_and_10_seconds_after_the_first_reading(
    drawn: list[tuple[Any, ...]], tmp_path: Path
) -> None:
    site, field = site_and_field()
    glimpses = e.glimpses_of(hovering(6.5), 0.0, 6.5)
    assert e.map_figure(tmp_path / "a.png", glimpses, task(), site, field)
    ((path, episode, snapshots, polar, x_m, z_m),) = drawn
    assert path == tmp_path / "a.png"
    assert [each.time_s for each in snapshots] == pytest.approx([0.8, 2.2, 5.2])  # from 0.2 s on
    assert polar == task().polar
    there: SearchPlace = episode.place
    assert there.field is field
    assert (there.sink_factor, there.change, there.words) == (1.0, 1.0, site.site.name)
    assert there.kind == "tunnel"
    assert there.duration_s == pytest.approx(6.4)
    assert (there.ground, there.site) == (task().ground, site)
    fence = task().fence
    assert (*there.box,) == (fence.x_min_m, fence.x_max_m, fence.z_min_m, fence.z_max_m)
    assert (x_m[0], x_m[-1]) == pytest.approx((fence.x_min_m, fence.x_max_m))
    assert (z_m[0], z_m[-1]) == pytest.approx((fence.z_min_m, fence.z_max_m))
    path_flown = episode.path
    assert path_flown["time_s"] == pytest.approx(0.2 * np.arange(1, 33))
    assert path_flown["x_m"] == pytest.approx(np.full(32, 0.2))
    assert path_flown["z_m"] == pytest.approx(np.full(32, 1.3))
    assert (episode.flown_s, episode.ended, episode.given_up) == (pytest.approx(6.4), "", "")


def test_a_flight_that_ends_before_the_first_frame_is_not_drawn(
    drawn: list[tuple[Any, ...]], tmp_path: Path
) -> None:
    site, field = site_and_field()
    for seconds, some in ((0.7, False), (0.9, True)):
        glimpses = e.glimpses_of(hovering(seconds), 0.0, seconds)
        assert e.map_figure(tmp_path / "a.png", glimpses, task(), site, field) is some
        assert len(drawn) == some

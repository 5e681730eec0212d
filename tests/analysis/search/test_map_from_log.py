"""The map of a flight, made again from its log."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData, Series
from tgl_soar.analysis.search.map_from_log import FRAMES_S, glimpses_of, map_figure
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.search.glimpse import LOOK_S, SearchTask, task_of
from tgl_soar.onboard.setup import laws_of, setup_from
from tgl_soar.sim.world import build_field

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel_search.toml")


def hovering(seconds: float) -> FlightData:
    """At one place, in a wind that grows by 0.1 m/s each second."""
    time = np.arange(0.0, seconds, 0.005)
    one = np.ones_like(time)

    def series(**columns: np.ndarray) -> Series:
        return Series(time, columns, "test")

    return FlightData(
        name="test",
        kind="test",
        path=series(x_m=0.2 * one, y_m=0.0 * one, z_m=1.3 * one),
        motion=series(velocity_x_mps=0.0 * one, velocity_y_mps=0.0 * one, climb_mps=0.0 * one),
        air=series(wind_mps=8.0 + 0.1 * time, updraft_mps=1.2 * one),
        line=series(x_m=0.2 * one, z_m=1.3 * one, eta_rad=1.8 * one, moving=0.0 * one),
    )


def task() -> SearchTask:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    setup = setup_from(airframe, site, load_parameters(airframe, AIRFRAME, site, SITE))
    return task_of(laws_of(setup, setup.parameters))


def test_a_glimpse_is_of_the_time_since_the_one_before() -> None:
    found = glimpses_of(hovering(3.0), 1.0, 2.5)
    assert len(found) == 7
    assert [g.now.time_s for g in found[:2]] == pytest.approx([1.2, 1.4])
    assert all(a.now == b.before for a, b in pairwise(found))
    assert found[0].wind_mps == pytest.approx(8.0 + 0.1 * (1.2 - 0.5 * LOOK_S))
    assert found[0].line.eta_rad == 1.8
    assert not found[0].line.moving


def test_a_log_that_lacks_the_air_has_no_map(tmp_path: Path) -> None:
    flight = FlightData(name="test", kind="test", path=hovering(1.0).path)
    assert glimpses_of(flight, 0.0, 1.0) == []
    site = load_site(SITE)
    assert site.air is not None
    picture = tmp_path / "search.png"
    assert not map_figure(picture, [], task(), site, build_field(site.air, SITE.parent))
    assert not picture.exists()


def test_the_frames_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    site = load_site(SITE)
    assert site.air is not None
    glimpses = glimpses_of(hovering(FRAMES_S[1] + 1.0), 0.0, FRAMES_S[1] + 1.0)
    picture = tmp_path / "search.png"
    assert map_figure(picture, glimpses, task(), site, build_field(site.air, SITE.parent))
    assert picture.stat().st_size > 10_000

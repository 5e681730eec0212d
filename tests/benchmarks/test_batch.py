"""Batches: a seed is a flight, whatever flies beside it and however many at once."""

from __future__ import annotations

from dataclasses import astuple, replace
from functools import lru_cache

import numpy as np
import pytest
from benchmarks.batch import FlightScore, Plan, fly_batch

from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.sim.closed_loop import Change
from tgl_soar.sim.compiled import available
from tgl_soar.sim.sensors import MEMS_IMU, Sensors
from tgl_soar.sim.world import build_field

COMPILED = pytest.param(
    True, marks=pytest.mark.skipif(not available(), reason="numba is not installed")
)


@lru_cache(maxsize=1)
def plan() -> Plan:
    """Onto line a, and at 5 s on to line b, in 3 % turbulence."""
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    assert site.air is not None
    values = load_parameters(airframe, airframe_path, site, site_path)
    values = values.changed(line_parameters(site.lines["a"]))
    changes = (Change(5.0, line_parameters(site.lines["b"])),)
    return Plan(
        airframe,
        site,
        values,
        changes=changes,
        duration_s=10.0,
        turbulence=0.03,
        field=build_field(site.air),
    )


@pytest.mark.parametrize("compile", [False, COMPILED])
def test_one_worker_and_two_give_the_same_scores(compile: bool) -> None:
    seeds = list(range(5))
    one = fly_batch(plan(), seeds, workers=1, compile=compile)
    two = fly_batch(plan(), seeds, workers=2, compile=compile)
    assert one == two
    assert [score.seed for score in one] == seeds


@pytest.mark.parametrize("compile", [False, COMPILED])
def test_a_seed_is_a_flight_of_its_own(compile: bool) -> None:
    """Neither the other seeds nor their order matter, and different seeds differ."""
    forth = fly_batch(plan(), [3, 1, 3], workers=1, compile=compile)
    back = fly_batch(plan(), [1], workers=1, compile=compile)
    assert forth[0] == forth[2]
    assert forth[1] == back[0]
    assert forth[0].legs != forth[1].legs


@lru_cache(maxsize=1)
def plain() -> list[FlightScore]:
    return fly_batch(plan(), [1, 2], workers=1)


@pytest.mark.skipif(not available(), reason="numba is not installed")
def test_compiled_scores_are_the_plain_ones() -> None:
    for ours, theirs in zip(
        fly_batch(plan(), [1, 2], workers=1, compile=True), plain(), strict=True
    ):
        assert (ours.seed, ours.ended, ours.flown_s) == (theirs.seed, theirs.ended, theirs.flown_s)
        for leg, expected in zip(ours.legs, theirs.legs, strict=True):
            assert leg.name == expected.name
            np.testing.assert_allclose(astuple(leg)[1:], astuple(expected)[1:], rtol=0.0, atol=1e-6)


@pytest.mark.skipif(not available(), reason="numba is not installed")
def test_accelerations_that_come_and_go_lose_no_flight() -> None:
    """32 seeds in 3 % turbulence: from one set of gains to the other and back, and for good."""
    received = [Change(t, {"EST_IMU": i % 2}) for i, t in enumerate((4.0, 6.0, 6.4, 6.5, 7.0))]
    shaken = replace(plan(), changes=received, duration_s=12.0, sensors=Sensors(imu=MEMS_IMU))
    scores = fly_batch(shaken, range(32), workers=1, compile=True)
    assert [score.ended for score in scores] == [""] * 32


def test_a_leg_is_what_follows_a_change() -> None:
    flight = plain()[0]
    assert flight.ended == ""
    assert flight.flown_s == pytest.approx(10.0 - 1.0 / 200.0)
    assert [leg.name for leg in flight.legs] == ["0", "1"]
    (_, z_a, _, _), (_, z_b, _, _) = (
        (leg.mean_x_m, leg.mean_z_m, leg.dispersion_m, leg.crossing_m) for leg in flight.legs
    )
    assert 0.1 < z_b - z_a < 0.5  # line b stands 0.3 m higher


def test_nothing_to_fly_and_nobody_to_fly_it() -> None:
    assert fly_batch(plan(), []) == []
    with pytest.raises(ValueError, match="workers 0"):
        fly_batch(plan(), [1], workers=0)

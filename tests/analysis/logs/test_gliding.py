"""Out of a log: speed through the air, steady glides, columns on one grid."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import FlightData, Series, series
from tgl_soar.analysis.logs.gliding import (
    STILL,
    MeanWind,
    glides,
    longitudinal,
    on_grid,
    through_air,
)
from tgl_soar.analysis.manoeuvres import STEP_S

T = np.arange(0.0, 12.0, 0.02)
TWO = np.where(T < 6.0, 1.0, 0.0)  # two glides


def flight(north_mps: float = 9.0, east_mps: float = 0.0) -> FlightData:
    still = np.zeros_like(T)
    return FlightData(
        "made up",
        "numbers",
        attitude=series(T, "a", roll_rad=still, pitch_rad=0.02 * TWO - 0.05, yaw_rad=still),
        velocity=series(
            T, "v", north_mps=still + north_mps + TWO, east_mps=still + east_mps,
            down_mps=1.5 + 0.2 * TWO,
        ),
        surfaces=series(T, "s", elevator=0.1 * TWO, aileron=still, rudder=still),
    )  # fmt: skip


def test_speed_through_the_air_is_that_over_the_ground_less_the_wind() -> None:
    met = through_air(flight(1.0, 3.0), MeanWind(8.0, 0.0), T[-10:])
    assert met.horizontal_mps == pytest.approx(np.hypot(9.0, 3.0))
    assert met.climb_mps == pytest.approx(-1.5)
    assert "less a wind of 8 m/s" in met.how
    met = through_air(flight(1.0, 3.0), MeanWind(5.0, pi / 2.0), T[-10:])  # an east wind
    assert met.horizontal_mps == pytest.approx(np.hypot(1.0, 8.0))
    assert "still air" in through_air(flight(), STILL, T).how


def test_a_pitot_tube_needs_no_wind() -> None:
    flown = replace(flight(1.0), airspeed=series(T, "pitot", airspeed_mps=np.full_like(T, 10.0)))
    met = through_air(flown, STILL, T[-10:])
    assert met.horizontal_mps == pytest.approx(np.sqrt(100.0 - 1.5**2))
    brief = replace(flown, airspeed=series(T[:50], "pitot", airspeed_mps=np.full(50, 10.0)))
    assert through_air(brief, STILL, T[-10:]).horizontal_mps == pytest.approx(1.0)


def test_stretches_of_one_glide_are_one() -> None:
    first, second = glides(flight())
    assert (first.speed_mps, first.sink_mps) == pytest.approx((10.0, 1.7))
    assert (second.speed_mps, second.sink_mps) == pytest.approx((9.0, 1.5))
    assert first.duration_s == pytest.approx(6.0, abs=0.2)


def test_banked_and_climbing_flight_is_no_glide() -> None:
    attitude = flight().attitude
    assert attitude is not None
    banked = Series(
        T, {**attitude.columns, "roll_rad": np.where(TWO > 0.5, 0.5, 0.0)}, attitude.source
    )
    (only,) = glides(replace(flight(), attitude=banked))
    assert only.speed_mps == pytest.approx(9.0)
    up = flight()
    assert up.velocity is not None
    rising = {**up.velocity.columns, "down_mps": np.full_like(T, -0.5)}
    with pytest.raises(ValueError, match="none of them sinks"):
        glides(replace(up, velocity=Series(T, rising, "v")))


def without(name: str) -> FlightData:
    changes: dict[str, Any] = {name: None}
    return replace(flight(), **changes)


@pytest.mark.parametrize("name", ["attitude", "velocity"])
def test_what_a_log_lacks_is_reported(name: str) -> None:
    with pytest.raises(ValueError, match="the log holds no"):
        glides(without(name))
    with pytest.raises(ValueError, match="the log holds no"):
        longitudinal(replace(flight(), surfaces=None))


def test_nothing_is_interpolated_over_a_gap() -> None:
    samples = series(np.array([0.0, 0.1, 1.0, 1.1]), "x", y=np.array([0.0, 1.0, 10.0, 11.0]))
    assert samples is not None
    got = on_grid(samples, "y", np.array([-0.1, 0.0, 0.05, 0.5, 1.05, 1.1, 1.2]))
    assert got == pytest.approx([np.nan, 0.0, 0.5, np.nan, 10.5, 11.0, np.nan], nan_ok=True)


def test_a_read_back_change_is_taken_to_have_come_half_a_sample_earlier() -> None:
    columns = longitudinal(flight())
    assert columns.elevator_step_s == pytest.approx(0.02)
    fell = columns.time_s[np.flatnonzero(columns.elevator < 0.05)[0]]
    assert fell == pytest.approx(6.0 - 0.01, abs=STEP_S)
    assert columns.lift_force_mps2 is None


def test_without_gyros_the_pitch_rate_is_a_difference() -> None:
    flown = flight()
    assert flown.attitude is not None
    turning = {**flown.attitude.columns, "pitch_rad": 0.1 * T - 0.5}
    columns = longitudinal(replace(flown, attitude=Series(T, turning, "a")))
    assert columns.pitch_rate_radps[5:-5] == pytest.approx(0.1)


def test_a_deflection_is_not_known_over_a_gap_of_its_samples() -> None:
    """What was commanded last says nothing about seconds that were not logged."""
    kept = (T < 3.0 - 1e-9) | (T > 6.0 - 1e-9)
    none = np.zeros(int(kept.sum()))
    sparse = series(
        T[kept], "s", elevator=np.where(T[kept] < 3.0, 0.1, -0.3), aileron=none, rudder=none
    )
    columns = longitudinal(replace(flight(), surfaces=sparse))
    at = columns.time_s
    assert columns.elevator[(at > 0.1) & (at < 2.9)] == pytest.approx(0.1)
    assert np.isnan(columns.elevator[(at > 3.0) & (at < 5.98)]).all()
    assert columns.elevator[(at > 6.01) & (at < 11.9)] == pytest.approx(-0.3)


def test_samples_that_always_come_seldom_hold_until_the_next() -> None:
    rows = np.arange(0.0, 12.0, 0.5)
    none = np.zeros_like(rows)
    seldom = series(rows, "s", elevator=none + 0.2, aileron=none, rudder=none)
    columns = longitudinal(replace(flight(), surfaces=seldom))
    inside = (columns.time_s > 0.1) & (columns.time_s < 11.0)
    assert columns.elevator[inside] == pytest.approx(0.2)

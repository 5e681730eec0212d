"""A record of wind, a synthetic one, and the air that it makes over a ridge."""

from __future__ import annotations

import tracemalloc
from math import cos, degrees, isclose, radians, sin, tan
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.wind_record import (
    VEER_MAX_DEG,
    RecordedField,
    SyntheticWind,
    WindRecord,
    WindRecordError,
    across_spectrum,
    along_spectrum,
    friction_speed,
    read_wind_record,
    synthetic_record,
    write_wind_record,
)
from tgl_soar.sim.compiled_air import known_air

HILL = HillField(7.0, 8.0)
PLACE = (-5.0, 0.0, 13.0)
CALM = SyntheticWind(lulls_per_hour=0.0, veer_rad=0.0)


def steady(wind_mps: float, veer_deg: float) -> RecordedField:
    return RecordedField(
        HILL, WindRecord(Schedule([0.0], [wind_mps]), Schedule([0.0], [radians(veer_deg)]))
    )


def test_in_the_fields_own_wind_it_is_the_field() -> None:
    assert steady(7.0, 0.0).wind_at(*PLACE, 3.0) == HILL.wind_at(*PLACE, 3.0)


def test_only_the_wind_across_the_ridge_is_lifted() -> None:
    u0, _, w0 = HILL.wind_at(*PLACE, 0.0)
    u, v, w = steady(14.0, 30.0).wind_at(*PLACE, 0.0)
    assert (u, w) == pytest.approx((2.0 * cos(radians(30.0)) * u0, 2.0 * cos(radians(30.0)) * w0))
    # It has turned clockwise: to an aircraft that faces upwind it comes from the right now.
    assert v == pytest.approx(-14.0 * sin(radians(30.0)))


def test_far_from_the_ridge_speed_and_direction_are_the_records() -> None:
    u, v, w = steady(9.0, -25.0).wind_at(-4000.0, 0.0, 4000.0, 0.0)
    assert np.hypot(u, v) == pytest.approx(9.0, rel=1e-3)
    assert v / u == pytest.approx(tan(radians(25.0)), rel=1e-3)
    assert abs(w) < 1e-3


def test_many_places_are_as_one() -> None:
    field = steady(8.0, 40.0)
    xs = np.array([-8.0, -5.0, -2.0])
    many = np.array(field.wind(xs, 0.0, 13.0, 1.0)).T
    assert many == pytest.approx(np.array([field.wind_at(x, 0.0, 13.0, 1.0) for x in xs]))


def test_compiled_flights_know_it() -> None:
    record = synthetic_record(SyntheticWind(duration_s=60.0), 3)
    field, times = RecordedField(HILL, record), np.arange(0.0, 60.0, 0.5)
    air = known_air(field, times)
    for n in (0, 17, 119):
        assert air.wind_at(n, *PLACE) == pytest.approx(field.wind_at(*PLACE, times[n]), abs=1e-12)


# --- a synthetic one --------------------------------------------------------------------------


def test_the_fluctuation_is_that_of_the_spectra() -> None:
    """Of an hour a wave of every frequency: the variance is the integral, to the last wave."""
    frequencies = np.arange(1, 181) / CALM.duration_s
    along = np.sum(along_spectrum(CALM, frequencies)) / CALM.duration_s
    across = np.sum(across_spectrum(CALM, frequencies)) / CALM.duration_s
    record = synthetic_record(CALM, 1)
    speeds = np.array(record.wind_mps.values[:-1])
    sideways = CALM.mean_mps * np.tan(np.array(record.veer_rad.values[:-1]))
    assert np.var(speeds) == pytest.approx(along, rel=1e-6)
    assert np.var(sideways) == pytest.approx(across, rel=1e-6)
    assert np.mean(speeds) == pytest.approx(CALM.mean_mps, abs=1e-6)


def test_the_spectra_fall_as_kaimal_s_do() -> None:
    """In the inertial range f S / u*² is 105 / 33^(5/3) n^(-2/3); across it is a third more."""
    f = np.array([50.0])
    n = f * CALM.height_m / CALM.mean_mps
    along = f * along_spectrum(CALM, f) / friction_speed(CALM) ** 2
    across = f * across_spectrum(CALM, f) / friction_speed(CALM) ** 2
    assert along[0] == pytest.approx(105.0 / 33.0 ** (5 / 3) * n[0] ** (-2 / 3), rel=2e-3)
    assert across[0] / along[0] == pytest.approx(4.0 / 3.0, rel=0.05)


def test_lulls_and_veer_are_as_deep_and_wide_as_asked() -> None:
    still = CALM._replace(lulls_per_hour=6.0, lull_depth=(0.25, 0.25), veer_rad=radians(30.0))
    with_lulls, without = synthetic_record(still, 5), synthetic_record(CALM, 5)
    missing = np.array(without.wind_mps.values) - np.array(with_lulls.wind_mps.values)
    assert missing.max() == pytest.approx(0.25 * CALM.mean_mps)
    assert missing.min() > -1e-9
    slow = np.array(with_lulls.veer_rad.values) - np.array(without.veer_rad.values)
    assert degrees(np.abs(slow).max()) > 15.0


def test_a_long_record_needs_no_memory_for_all_of_its_waves_at_once() -> None:
    """`site wind --hours 24` took three gigabytes; here a quarter of it, whose waves are 93 MB."""
    tracemalloc.start()
    try:
        synthetic_record(SyntheticWind(duration_s=6 * 3600.0, lulls_per_hour=0.0), seed=1)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 120e6  # two arrays of 4096 rows: 71 MB


def test_one_seed_one_wind() -> None:
    first, again, other = (synthetic_record(SyntheticWind(), seed) for seed in (1, 1, 2))
    assert first.wind_mps.values == again.wind_mps.values
    assert first.wind_mps.values != other.wind_mps.values


# --- files ------------------------------------------------------------------------------------


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    record, file = synthetic_record(SyntheticWind(duration_s=120.0), 4), tmp_path / "wind.csv"
    write_wind_record(file, record)
    again = read_wind_record(file)
    assert again.wind_mps.times_s == record.wind_mps.times_s
    assert again.wind_mps.values == pytest.approx(record.wind_mps.values, abs=5.1e-4)
    assert again.veer_rad.values == pytest.approx(record.veer_rad.values, abs=radians(0.0051))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no rows"),
        ("time_s,wind_mps\n0,8\n", "no column veer_deg"),
        ("time_s,wind_mps,veer_deg\n0,8,0\n1,fast,0\n", "line 3: wind_mps = 'fast': no number"),
        ("time_s,wind_mps,veer_deg\n0,nan,0\n", "line 2: wind_mps = nan: must be from 0 to 60"),
        ("time_s,wind_mps,veer_deg\n0,8,120\n", "veer_deg = 120: must be from -85 to 85"),
        ("time_s,wind_mps,veer_deg\n0,8,0\n0,8,0\n", "time_s: schedule: times"),
        ("time_s,wind_mps,veer_deg\n0,8\n", "line 2: veer_deg = None: no number"),
    ],
)
def test_a_bad_file_is_refused_with_line_column_and_range(
    text: str, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "wind.csv"
    file.write_text(text)
    with pytest.raises(WindRecordError) as error:
        read_wind_record(file)
    assert words in str(error.value)
    assert str(file) in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(WindRecordError, match=r"nowhere\.csv"):
        read_wind_record(tmp_path / "nowhere.csv")


def test_veer_never_turns_the_wind_round() -> None:
    wild = SyntheticWind(mean_mps=2.0, height_m=100.0, roughness_m=1.0, veer_rad=radians(80.0))
    veers = np.array(synthetic_record(wild, 1).veer_rad.values)
    assert degrees(np.abs(veers).max()) < VEER_MAX_DEG or isclose(
        degrees(np.abs(veers).max()), VEER_MAX_DEG
    )

"""A wind record's numbers: its waves, its lulls, its slow veer, and the bounds of what is read."""

from __future__ import annotations

from math import cos, hypot, nan, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridField
from tgl_soar.air.gusts import Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.wind_record import (
    RecordedField,
    SyntheticWind,
    WindRecord,
    WindRecordError,
    across_spectrum,
    along_spectrum,
    friction_speed,
    oblique_field,
    read_wind_record,
    synthetic_record,
    turned,
    write_wind_record,
)

HEAD = "time_s,wind_mps,veer_deg\n"
# Ten waves and no more, so that a record is quick; without lulls and slow veer unless asked.
FEW = SyntheticWind(duration_s=1000.0, fastest_hz=0.01, row_s=1.0, lulls_per_hour=0.0, veer_rad=0.0)


def speeds(wind: SyntheticWind, seed: int = 1) -> FloatArray:
    return np.array(synthetic_record(wind, seed).wind_mps.values)


def veers(wind: SyntheticWind, seed: int = 1) -> FloatArray:
    return np.array(synthetic_record(wind, seed).veer_rad.values)


def missing(wind: SyntheticWind, seed: int) -> FloatArray:
    """The fraction of the mean wind that lulls take away."""
    without = speeds(wind._replace(lulls_per_hour=0.0), seed)
    return (without - speeds(wind, seed)) / wind.mean_mps


def waves_of(values: FloatArray) -> FloatArray:
    """Amplitudes of the multiples of a record's own frequency: 0, 1, 2, …"""
    found: FloatArray = 2.0 * np.abs(np.fft.rfft(values[:-1])) / (len(values) - 1)
    return found


# --- a synthetic one --------------------------------------------------------------------------


def test_a_synthetic_wind_is_of_a_fresh_breeze_over_short_grass_for_an_hour() -> None:
    wind = SyntheticWind()
    assert (wind.duration_s, wind.row_s, wind.fastest_hz) == (3600.0, 2.0, 0.05)
    assert (wind.mean_mps, wind.height_m, wind.roughness_m) == (8.0, 10.0, 0.03)
    assert (wind.lulls_per_hour, wind.lull_ramp_s) == (4.0, 20.0)
    assert (wind.lull_depth, wind.lull_s) == ((0.1, 0.3), (30.0, 120.0))
    assert wind.veer_rad == pytest.approx(20.0 * pi / 180.0)
    assert wind.veer_period_s == 1800.0


@pytest.mark.parametrize(("duration_s", "row_s"), [(10.0, 2.0), (10.0, 0.25), (30.0, 3.0)])
def test_rows_go_from_zero_to_the_end(duration_s: float, row_s: float) -> None:
    wind = FEW._replace(duration_s=duration_s, row_s=row_s, fastest_hz=0.2)
    record = synthetic_record(wind, 1)
    count = round(duration_s / row_s) + 1
    assert record.wind_mps.times_s == pytest.approx([row_s * n for n in range(count)])
    assert record.veer_rad.times_s == record.wind_mps.times_s


def test_friction_speed_and_spectra_are_as_worked_out_by_hand() -> None:
    wind = SyntheticWind()
    assert friction_speed(wind) == pytest.approx(0.550856, rel=1e-5)  # 3.2 / ln(333.33)
    u2 = 0.550856**2
    # Where 33 n is 1, f = 8 / (10 * 33) Hz: f S = u*² (105 / 33) / 2^(5/3).
    f = np.array([8.0 / 330.0])
    assert f * along_spectrum(wind, f) == pytest.approx(u2 * 3.181818 / 3.174802, rel=1e-5)
    f = np.array([8.0 / 95.0])
    assert f * across_spectrum(wind, f) == pytest.approx(u2 * 1.789474 / 3.174802, rel=1e-5)
    # Of the slowest changes S is u*² 105 z / U and u*² 17 z / U.
    f = np.array([1e-9])
    assert along_spectrum(wind, f) == pytest.approx(u2 * 131.25, rel=1e-5)
    assert across_spectrum(wind, f) == pytest.approx(u2 * 21.25, rel=1e-5)


def test_each_wave_has_the_amplitude_of_its_spectrum() -> None:
    frequencies = np.arange(1.0, 11.0) / 1000.0
    along = np.sqrt(2.0 * along_spectrum(FEW, frequencies) / 1000.0)
    across = np.sqrt(2.0 * across_spectrum(FEW, frequencies) / 1000.0)
    assert waves_of(speeds(FEW))[1:11] == pytest.approx(along)
    sideways = FEW.mean_mps * np.tan(veers(FEW))
    assert waves_of(sideways)[1:11] == pytest.approx(across)


@pytest.mark.parametrize(("asked", "last"), [(10.3, 10), (10.7, 11)])
def test_the_fastest_wave_is_the_multiple_nearest_to_what_is_asked(asked: float, last: int) -> None:
    found = waves_of(speeds(FEW._replace(fastest_hz=asked / 1000.0)))
    assert found[last] > 0.01
    assert found[last + 1 :] == pytest.approx(0.0, abs=1e-9)


def test_waves_begin_at_any_phase() -> None:
    """Of 720 waves each twelfth of a turn has its part, 60 ± 7."""
    wind = FEW._replace(duration_s=14400.0, fastest_hz=0.05, row_s=8.0)
    for values in (speeds(wind), np.tan(veers(wind))):
        phases = np.angle(np.fft.rfft(values[:-1]))[1:721]
        counts, _ = np.histogram(phases, bins=12, range=(-pi, pi))
        assert counts.min() > 60 - 4 * 7
        assert counts.max() < 60 + 4 * 7


def test_a_record_of_more_rows_than_are_worked_out_at_once_is_of_the_same_waves() -> None:
    coarse, fine = FEW._replace(row_s=0.5), FEW._replace(row_s=0.1)  # 2001 and 10001 rows
    assert speeds(fine)[::5] == pytest.approx(speeds(coarse), abs=1e-9)
    assert veers(fine)[::5] == pytest.approx(veers(coarse), abs=1e-9)


def test_speed_is_never_negative_nor_beyond_what_a_record_holds() -> None:
    still = speeds(FEW._replace(mean_mps=2.0, lulls_per_hour=60.0, lull_depth=(1.0, 1.0)))
    assert still.min() == 0.0
    storm = speeds(FEW._replace(mean_mps=59.5))
    assert storm.max() == 60.0
    assert 50.0 < storm.min() < 59.0


@pytest.mark.parametrize("seed", range(1, 5))
def test_the_slow_veer_is_a_sine_of_the_angle_and_period_that_are_asked(seed: int) -> None:
    wind = FEW._replace(veer_rad=radians(15.0), veer_period_s=400.0)
    slow = veers(wind, seed) - veers(FEW, seed)
    angle = 2.0 * pi * np.arange(1001.0) / 400.0
    waves = np.column_stack([np.sin(angle), np.cos(angle)])
    (a, b), *_ = np.linalg.lstsq(waves, slow, rcond=None)
    assert slow == pytest.approx(waves @ (a, b), abs=1e-9)
    assert hypot(a, b) == pytest.approx(radians(15.0))


def test_the_slow_veer_begins_anywhere() -> None:
    wind = FEW._replace(duration_s=100.0, row_s=10.0, veer_period_s=400.0, veer_rad=0.1)
    quarters = set()
    for seed in range(40):
        slow = veers(wind, seed) - veers(wind._replace(veer_rad=0.0), seed)
        quarters.add((slow[0] > 0.0, slow[-1] > 0.0))  # the sine, and the cosine
    assert len(quarters) == 4


# --- lulls ------------------------------------------------------------------------------------

LULL = FEW._replace(
    lulls_per_hour=3.6, lull_depth=(0.2, 0.2), lull_s=(50.0, 50.0), lull_ramp_s=25.0
)


def one_lull() -> tuple[FloatArray, FloatArray]:
    """Times and fractions of the first record with one lull that is whole."""
    for seed in range(100):
        fraction = missing(LULL, seed)
        on = np.flatnonzero(fraction > 1e-9)
        if len(on) and fraction[0] < 1e-9 > fraction[-1] and on[-1] - on[0] < 110:
            return np.arange(1001.0), fraction
    raise AssertionError("none of a hundred records has one lull")


def test_a_lull_comes_stays_and_goes_as_long_as_is_asked() -> None:
    times, fraction = one_lull()
    on = times[fraction > 1e-9]
    assert on[-1] - on[0] == pytest.approx(25.0 + 50.0 + 25.0, abs=2.0)
    deep = times[fraction > 0.2 - 1e-9]
    assert deep[-1] - deep[0] == pytest.approx(50.0, abs=2.0)
    assert fraction.max() == pytest.approx(0.2)
    assert fraction.sum() == pytest.approx(0.2 * (50.0 + 25.0), rel=1e-6)
    slopes = np.diff(fraction)
    assert (slopes.max(), slopes.min()) == pytest.approx((0.2 / 25.0, -0.2 / 25.0))


def test_there_are_as_many_lulls_as_an_hour_is_to_have() -> None:
    """240 in two hours, each two seconds and a half long: 8 % of the time, less what overlaps."""
    wind = FEW._replace(
        duration_s=7200.0, fastest_hz=0.001, row_s=0.5, lulls_per_hour=120.0,
        lull_depth=(0.5, 0.5), lull_s=(2.0, 2.0), lull_ramp_s=0.25,
    )  # fmt: skip
    fraction = missing(wind, 1) > 1e-9
    begun = int(np.sum(fraction[1:] & ~fraction[:-1]))
    assert 240 - 4 * 16 < begun < 240 + 3 * 16


def test_depths_and_lengths_are_drawn_evenly_between_their_bounds() -> None:
    wind = FEW._replace(
        duration_s=20000.0, fastest_hz=0.0005, row_s=1.0, lulls_per_hour=18.0, lull_ramp_s=1.0,
        lull_depth=(0.1, 0.3), lull_s=(20.0, 60.0),
    )  # fmt: skip
    fraction = missing(wind, 2)
    edges = np.flatnonzero(np.diff((fraction > 1e-9).astype(int)))
    runs = [
        fraction[a + 1 : b + 1]
        for a, b in zip(edges[:-1:2], edges[1::2], strict=False)
        if fraction[0] < 1e-9
    ]
    alone = [run for run in runs if np.sum(run > run.max() - 1e-9) > len(run) - 4]
    depths, lengths = [run.max() for run in alone], [len(run) for run in alone]
    assert len(alone) > 30
    assert 0.1 <= min(depths) < 0.13 < 0.27 < max(depths) <= 0.3
    assert 20 <= min(lengths) < 30 < 50 < max(lengths) <= 63


def test_the_deepest_of_lulls_that_are_on_counts() -> None:
    fraction = missing(FEW._replace(lulls_per_hour=300.0, lull_depth=(0.1, 0.3)), 1)
    assert fraction.max() <= 0.3 + 1e-12  # eighty of them in a quarter of an hour add up to more
    assert fraction.min() >= -1e-12


def test_lulls_begin_within_the_first_second_too() -> None:
    wind = FEW._replace(
        duration_s=1.0, fastest_hz=1.0, row_s=0.01, lulls_per_hour=36000.0, lull_ramp_s=0.01
    )
    assert missing(wind, 1)[:60].max() > 0.1  # ten begin in this second


# --- a record turned --------------------------------------------------------------------------

RECORD = WindRecord(
    Schedule([0.0, 10.0, 20.0], [4.0, 8.0, 6.0]),
    Schedule([0.0, 10.0, 20.0], [radians(-80.0), 0.0, radians(70.0)]),
)


@pytest.mark.parametrize(
    ("by_deg", "veers_deg"),
    [(0.0, (-80.0, 0.0, 70.0)), (10.0, (-70.0, 10.0, 80.0)), (30.0, (-50.0, 30.0, 85.0)),
     (-10.0, (-85.0, -10.0, 60.0))],
)  # fmt: skip
def test_a_wind_is_turned_as_far_as_a_record_may(
    by_deg: float, veers_deg: tuple[float, ...]
) -> None:
    found = turned(RECORD, radians(by_deg))
    assert found.veer_rad.values == pytest.approx([radians(veer) for veer in veers_deg])
    assert found.veer_rad.times_s == (0.0, 10.0, 20.0)
    assert found.wind_mps is RECORD.wind_mps


# --- the air it makes -------------------------------------------------------------------------

X, Z = np.array([-10.0, 0.0, 10.0]), np.array([0.0, 5.0, 10.0])
# A field of 5 m/s that has a wind of its own along the ridge, half and a fifth of that across.
CROSSED = GridField(
    X, None, Z, np.full((3, 3), 5.0), np.full((3, 3), 2.5), np.full((3, 3), 1.0),
    reference_wind_mps=5.0,
)  # fmt: skip


def test_the_fields_own_wind_along_the_ridge_grows_with_the_record() -> None:
    veer = radians(30.0)
    field = RecordedField(CROSSED, WindRecord(Schedule([0.0], [15.0]), Schedule([0.0], [veer])))
    factor = 3.0 * cos(veer)
    expected = (factor * 5.0, factor * 2.5 - 15.0 * sin(veer), factor * 1.0)
    assert field.wind_at(1.0, 0.0, 2.0, 0.0) == pytest.approx(expected)
    many = np.array(field.wind([1.0, 2.0], 0.0, 2.0))
    assert many == pytest.approx(np.array([expected, expected]).T)
    assert field.reference_wind_mps == 5.0


def test_without_a_time_it_is_the_records_beginning() -> None:
    field = RecordedField(CROSSED, RECORD)
    first = [float(part) for part in field.wind(1.0, 0.0, 2.0)]
    assert first == pytest.approx(field.wind_at(1.0, 0.0, 2.0, 0.0))
    assert field.answer_at(0.0) == pytest.approx(
        (0.8 * cos(radians(80.0)), 4.0 * sin(radians(80.0)))
    )
    assert field.answer_at(5.0) == pytest.approx(
        (1.2 * cos(radians(40.0)), 6.0 * sin(radians(40.0)))
    )


def test_it_is_inside_where_the_field_is() -> None:
    field = RecordedField(CROSSED, RECORD)
    assert field.inside(-9.0, 3.0, 1.0)
    assert not field.inside(-11.0, 3.0, 1.0)
    assert not field.inside(-9.0, 3.0, 11.0)


HILL = HillField(7.0, 8.0)


def test_an_oblique_wind_is_a_record_that_does_not_change() -> None:
    assert oblique_field(HILL, 0.0) is HILL
    for oblique in (radians(25.0), radians(-85.0), radians(85.0)):
        field = oblique_field(HILL, oblique)
        u0, _, w0 = HILL.wind_at(-9.0, 0.0, 9.0, 0.0)
        expected = (u0 * cos(oblique), -7.0 * sin(oblique), w0 * cos(oblique))
        assert field.wind_at(-9.0, 0.0, 9.0, 17.0) == pytest.approx(expected)
        assert field.reference_wind_mps == 7.0


@pytest.mark.parametrize("oblique_deg", [85.1, -86.0, nan])
def test_a_wind_from_behind_is_refused(oblique_deg: float) -> None:
    with pytest.raises(ValueError, match=rf"a veer of {oblique_deg:g} deg: at most 85"):
        oblique_field(HILL, radians(oblique_deg))


# --- files ------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", ["0,0,0", "0,60,85", "0,0.5,-85", "1e9,8,0"])
def test_a_row_at_its_bounds_is_read(tmp_path: Path, row: str) -> None:
    file = tmp_path / "wind.csv"
    file.write_text(HEAD + row + "\n")
    record, (time, wind, veer) = read_wind_record(file), map(float, row.split(","))
    assert (record.wind_mps.times_s, record.wind_mps.values) == ((time,), (wind,))
    assert record.veer_rad.values == pytest.approx((radians(veer),))


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("-0.1,8,0", "line 3: time_s = -0.1: must be from 0 to inf"),
        ("inf,8,0", "line 3: time_s = inf: must be from 0 to inf"),
        ("1,60.1,0", "line 3: wind_mps = 60.1: must be from 0 to 60"),
        ("1,-0.1,0", "line 3: wind_mps = -0.1: must be from 0 to 60"),
        ("1,8,85.1", "line 3: veer_deg = 85.1: must be from -85 to 85"),
        ("1,8,-85.1", "line 3: veer_deg = -85.1: must be from -85 to 85"),
        ("1,8,west", "line 3: veer_deg = 'west': no number"),
    ],
)
def test_a_row_beyond_its_bounds_is_refused(tmp_path: Path, row: str, words: str) -> None:
    file = tmp_path / "wind.csv"
    file.write_text(f"{HEAD}0,8,0\n{row}\n")
    with pytest.raises(WindRecordError) as error:
        read_wind_record(file)
    assert str(error.value) == f"{file}: {words}"


def test_all_columns_that_are_missing_are_named(tmp_path: Path) -> None:
    file = tmp_path / "wind.csv"
    file.write_text("time_s,speed\n0,8\n")
    with pytest.raises(WindRecordError, match=r"no column wind_mps, veer_deg$"):
        read_wind_record(file)
    file.write_text(HEAD)
    with pytest.raises(WindRecordError, match="no rows; it needs the columns time_s, wind_mps, v"):
        read_wind_record(file)
    file.write_bytes(b"\xff\xfe\xff")
    with pytest.raises(WindRecordError, match=r"wind\.csv: "):
        read_wind_record(file)


def test_a_record_is_written_to_the_millimetre_and_the_hundredth_of_a_degree(
    tmp_path: Path,
) -> None:
    file = tmp_path / "wind.csv"
    record = WindRecord(
        Schedule([0.0, 2.5], [7.12345, 60.0]), Schedule([0.0, 2.5], [radians(-12.3456), 0.0])
    )
    write_wind_record(file, record)
    assert file.read_text() == HEAD + "0,7.123,-12.35\n2.5,60.000,0.00\n"


def test_rows_of_a_long_record_stay_apart(tmp_path: Path) -> None:
    """Twelve days of half seconds: a time has more digits than six."""
    file = tmp_path / "wind.csv"
    times = [0.0, 999_999.5, 1_000_000.0, 1_000_000.5]
    flat = Schedule(times, [8.0] * 4), Schedule(times, [0.0] * 4)
    write_wind_record(file, WindRecord(*flat))
    assert list(read_wind_record(file).wind_mps.times_s) == times

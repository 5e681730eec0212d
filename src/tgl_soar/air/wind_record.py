"""A wind that turns, dies and comes again: a mast's record over time, and the air it makes.

A record is a table of speed and veer.  Veer is how far the wind's direction has turned clockwise,
seen from above, from the site's `wind_from_deg`.  Over a straight ridge along y the component
across it flows as the site's field does, and the component along it is not changed:

    (u, v, w) = (k u₀ cos ψ, −k U₀ sin ψ + k v₀ cos ψ, k w₀ cos ψ)        k = U(t) / U₀

u₀, v₀, w₀  m/s  the field in its own wind U₀, which blows straight at the ridge
U(t), ψ(t)  m/s, rad  the record's speed and veer

This holds for an inviscid flow and as long as the ridge is much longer than high.  Beyond 90° the
wind comes from behind, where a real flow separates: a record ends before.

`synthetic_record` makes one by the spectra of the surface layer (Kaimal, Wyngaard, Izumi and Coté,
Q. J. R. Meteorol. Soc. 98, 1972) below the frequency at which a site's turbulence takes over,

    f S_u = u*² 105 n / (1 + 33 n)^(5/3)     f S_v = u*² 17 n / (1 + 9.5 n)^(5/3)     n = f z / U
    u* = 0.4 U / ln(z / z₀)

with lulls and a slow veer over it.  Surface-layer spectra know neither: how often, how deep and how
long is chosen here, as `SyntheticWind` says, and not measured.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from math import cos, degrees, inf, isfinite, log, pi, radians, sin
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, WindField
from tgl_soar.air.gusts import Schedule

COLUMNS: Final = ("time_s", "wind_mps", "veer_deg")
VEER_MAX_DEG: Final = 85.0  # hardly any wind is left across the ridge
WIND_MAX_MPS: Final = 60.0
VON_KARMAN: Final = 0.4
_BLOCK: Final = 4096  # rows worked out at once: of a day 140 MB, and three gigabytes in one piece
_STREAM: Final = 0x3A57  # of random numbers, beside those of turbulence and sensors


class WindRecordError(ValueError):
    """A wind record that cannot be used; the message names file, row, column and range."""


class WindRecord(NamedTuple):
    """Speed and veer over time, straight lines between the rows, constant before and after."""

    wind_mps: Schedule
    veer_rad: Schedule


class SyntheticWind(NamedTuple):
    """What a synthetic record is made of."""

    duration_s: float = 3600.0
    mean_mps: float = 8.0
    height_m: float = 10.0  # z: above the ground, of the mast and about that of the aircraft
    roughness_m: float = 0.03  # z₀: short grass
    fastest_hz: float = 0.05  # faster changes are the site's turbulence
    row_s: float = 2.0
    lulls_per_hour: float = 4.0
    lull_depth: tuple[float, float] = (0.1, 0.3)  # of the mean, evenly drawn
    lull_s: tuple[float, float] = (30.0, 120.0)  # how long it stays, evenly drawn
    lull_ramp_s: float = 20.0  # how long it takes to come, and to go
    veer_rad: float = radians(20.0)  # most of the slow veer, to either side
    veer_period_s: float = 1800.0  # there and back


def read_wind_record(path: Path) -> WindRecord:
    """The record in a CSV file with the columns `COLUMNS`.  Errors: `WindRecordError`."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise WindRecordError(f"{path}: {error}") from None
    if not rows:
        raise WindRecordError(f"{path}: no rows; it needs the columns {', '.join(COLUMNS)}")
    if missing := [name for name in COLUMNS if name not in rows[0]]:
        raise WindRecordError(f"{path}: no column {', '.join(missing)}")
    times, winds, veers = (
        [_number(path, i, row, name, allowed) for i, row in enumerate(rows, 2)]
        for name, allowed in zip(
            COLUMNS,
            ((0.0, inf), (0.0, WIND_MAX_MPS), (-VEER_MAX_DEG, VEER_MAX_DEG)),
            strict=True,
        )
    )
    try:
        return WindRecord(Schedule(times, winds), Schedule(times, [radians(v) for v in veers]))
    except ValueError as error:
        raise WindRecordError(f"{path}: time_s: {error}") from None


def _number(
    path: Path, line: int, row: dict[str, str], name: str, allowed: tuple[float, float]
) -> float:
    try:
        value = float(row[name])
    except (TypeError, ValueError):
        raise WindRecordError(f"{path}: line {line}: {name} = {row[name]!r}: no number") from None
    low, high = allowed
    if not (isfinite(value) and low <= value <= high):
        raise WindRecordError(
            f"{path}: line {line}: {name} = {value:g}: must be from {low:g} to {high:g}"
        )
    return value


def write_wind_record(path: Path, record: WindRecord) -> None:
    """As `read_wind_record` reads it, to a millimetre a second and a hundredth of a degree."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for time_s, wind, veer in zip(
            record.wind_mps.times_s, record.wind_mps.values, record.veer_rad.values, strict=True
        ):
            writer.writerow((f"{time_s:.10g}", f"{wind:.3f}", f"{degrees(veer):.2f}"))


# --- a synthetic one --------------------------------------------------------------------------


def synthetic_record(wind: SyntheticWind, seed: int) -> WindRecord:
    """A record by the spectra above, with lulls and a slow veer; the same for the same seed."""
    random = np.random.default_rng([_STREAM, seed])
    times = np.arange(0.0, wind.duration_s + 0.5 * wind.row_s, wind.row_s)
    along = _fluctuation(times, wind, along_spectrum, random)
    across = _fluctuation(times, wind, across_spectrum, random)
    phase = random.uniform(0.0, 2.0 * pi)
    slow = wind.veer_rad * np.sin(2.0 * pi * times / wind.veer_period_s + phase)
    speed = wind.mean_mps * (1.0 - _lulls(times, wind, random)) + along
    most = radians(VEER_MAX_DEG)
    veer = np.clip(slow + np.arctan2(across, wind.mean_mps), -most, most)
    return WindRecord(
        Schedule(times.tolist(), np.clip(speed, 0.0, WIND_MAX_MPS).tolist()),
        Schedule(times.tolist(), veer.tolist()),
    )


def friction_speed(wind: SyntheticWind) -> float:
    """u* [m/s] of the logarithmic profile."""
    return VON_KARMAN * wind.mean_mps / log(wind.height_m / wind.roughness_m)


def along_spectrum(wind: SyntheticWind, frequency_hz: FloatArray) -> FloatArray:
    """S_u [m²/s² / Hz], one-sided."""
    n = frequency_hz * wind.height_m / wind.mean_mps
    scaled: FloatArray = 105.0 * n / (1.0 + 33.0 * n) ** (5.0 / 3.0)
    return friction_speed(wind) ** 2 * scaled / frequency_hz


def across_spectrum(wind: SyntheticWind, frequency_hz: FloatArray) -> FloatArray:
    """S_v [m²/s² / Hz], one-sided."""
    n = frequency_hz * wind.height_m / wind.mean_mps
    scaled: FloatArray = 17.0 * n / (1.0 + 9.5 * n) ** (5.0 / 3.0)
    return friction_speed(wind) ** 2 * scaled / frequency_hz


def _fluctuation(
    times_s: FloatArray,
    wind: SyntheticWind,
    spectrum: Callable[[SyntheticWind, FloatArray], FloatArray],
    random: np.random.Generator,
) -> FloatArray:
    """A sum of waves of random phase, one for each multiple of the record's own frequency."""
    step_hz = 1.0 / wind.duration_s
    frequencies = step_hz * np.arange(1.0, wind.fastest_hz / step_hz + 0.5)
    amplitudes = np.sqrt(2.0 * spectrum(wind, frequencies) * step_hz)
    phases = random.uniform(0.0, 2.0 * pi, len(frequencies))
    found = np.empty(len(times_s))
    for begin in range(0, len(times_s), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        waves = np.cos(2.0 * pi * np.outer(times_s[part], frequencies) + phases)
        found[part] = waves @ amplitudes
    return found


def _lulls(times_s: FloatArray, wind: SyntheticWind, random: np.random.Generator) -> FloatArray:
    """The share of the wind that is missing: the deepest lull of those that are on."""
    missing = np.zeros(len(times_s))
    for _ in range(random.poisson(wind.lulls_per_hour * wind.duration_s / 3600.0)):
        begin = random.uniform(0.0, wind.duration_s)
        stays, depth = random.uniform(*wind.lull_s), random.uniform(*wind.lull_depth)
        ramp = wind.lull_ramp_s
        corners = (begin, begin + ramp, begin + ramp + stays, begin + 2.0 * ramp + stays)
        missing = np.maximum(missing, np.interp(times_s, corners, (0.0, depth, depth, 0.0)))
    return missing


def turned(record: WindRecord, veer_rad: float) -> WindRecord:
    """The record of a wind that has turned by so much more, as far as a record may."""
    most = radians(VEER_MAX_DEG)
    veers = [max(-most, min(most, veer + veer_rad)) for veer in record.veer_rad.values]
    return record._replace(veer_rad=Schedule(list(record.veer_rad.times_s), veers))


# --- the air it makes -------------------------------------------------------------------------


class RecordedField:
    """A site's field in the wind of a record."""

    def __init__(self, field: WindField, record: WindRecord) -> None:
        """`field`: of a straight ridge along y, steady."""
        self.field, self.record = field, record

    @property
    def reference_wind_mps(self) -> float:
        """The field's own: turbulence is a fraction of it [m/s]."""
        return self.field.reference_wind_mps

    def answer_at(self, time_s: float) -> tuple[float, float]:
        """(factor on the field, wind along the ridge [m/s]) at a time."""
        speed, veer = self.record.wind_mps.at(time_s), self.record.veer_rad.at(time_s)
        return speed / self.field.reference_wind_mps * cos(veer), -speed * sin(veer)

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place and time."""
        u, v, w = self.field.wind_at(x_m, y_m, z_m, time_s)
        factor, along = self.answer_at(time_s)
        return factor * u, factor * v + along, factor * w

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        u, v, w = self.field.wind(x_m, y_m, z_m, time_s)
        factor, along = self.answer_at(time_s)
        return factor * u, factor * v + along, factor * w

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Inside the field that the wind blows over."""
        return self.field.inside(x_m, y_m, z_m)


def oblique_field(field: WindField, oblique_rad: float) -> WindField:
    """A steady field in its wind from so far to the right of straight at the ridge.

    Errors: ValueError beyond what a record may hold.
    """
    if not abs(oblique_rad) <= radians(VEER_MAX_DEG):
        raise ValueError(f"a veer of {degrees(oblique_rad):g} deg: at most {VEER_MAX_DEG:g}")
    if oblique_rad == 0.0:
        return field
    speed, veer = Schedule([0.0], [field.reference_wind_mps]), Schedule([0.0], [oblique_rad])
    return RecordedField(field, WindRecord(speed, veer))

"""The legs of a flight: each stand of the line, and how well it was held there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, hypot, nan, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Crossing, stable_crossing
from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.control.supervisor import is_flying
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.sim.score import TAIL_S, LegScore, score_leg
from tgl_soar.types import GlidePolar

Floats = NDArray[np.float64]
Line = tuple[float, float, float]  # x0 [m], z0 [m], eta [rad]

LEAST_S = 2.0  # a shorter stand of the line is no leg: nothing can settle on it
SAME_LINE_M = 0.005
SAME_LINE_RAD = 0.01
MOVED = 1e-4  # m or rad from one sample to the next: the line moves
# Modes in which the module steers; and of these those in which a line that stands is to be held:
# not where it is thrown, looks elsewhere, or flies no line.
FLYING: Final = tuple(name for mode, name in enumerate(MODE_NAMES) if is_flying(mode))
HOLDING_LINE: Final = ("capturing", "soaring", "holding", "recovering")


@dataclass(frozen=True)
class ReportLeg:
    """One stand of the line."""

    name: str
    line: Line
    begin_s: float  # when the line stood still
    end_s: float
    score: LegScore
    crossing: Crossing | None  # of the line and the contour, where the air is known
    crossing_sigma_m: float  # standard error of the distance from it: the flight's dispersion alone

    @property
    def place(self) -> tuple[float, float] | None:
        """Where the aircraft should hover (x, z) [m]."""
        return None if self.crossing is None else (self.crossing.x_m, self.crossing.z_m)


def legs_of(
    flight: FlightData,
    named: Mapping[str, Line],
    air: tuple[WindField, GlidePolar] | None,
) -> list[ReportLeg]:
    """The legs in their order; named: lines of the site, whose names the legs then have."""
    if flight.path is None or flight.line is None:
        return []
    legs: list[ReportLeg] = []
    for begin, end, line in stands(flight):
        part = flight.path.within(begin, end)
        known = np.isfinite(part["x_m"]) & np.isfinite(part["z_m"])
        if np.count_nonzero(known) < 2:
            continue
        time, x, z = part.time_s[known], part["x_m"][known], part["z_m"][known]
        crossing = None if air is None else stable_crossing(*air, line)
        name = _name(line, named) or str(len(legs) + 1)
        place = None if crossing is None else (crossing.x_m, crossing.z_m)
        score = score_leg(name, line, place, time, x, z)
        sigma = nan if place is None else _distance_sigma(line, place, time, x, z)
        legs.append(
            ReportLeg(
                name=name,
                line=line,
                begin_s=float(time[0]),
                end_s=float(time[-1]),
                score=score,
                crossing=crossing,
                crossing_sigma_m=sigma,
            )
        )
    return legs


def stands(flight: FlightData) -> list[tuple[float, float, Line]]:
    """From when to when the line stood still while the module held it there, and where."""
    line = flight.line
    if line is None:
        return []
    places = np.stack([line["x_m"], line["z_m"], line["eta_rad"]])
    still = (line["moving"] == 0.0) & holding_line_at(flight, line.time_s)
    still &= np.isfinite(places).all(axis=0)
    moved = np.any(np.abs(np.diff(places, axis=1)) > MOVED, axis=0)
    breaks = np.flatnonzero(moved | (np.diff(still) != 0)) + 1
    found = []
    for rows in np.split(np.arange(len(line)), breaks):
        begin, end = line.time_s[rows[0]], line.time_s[rows[-1]]
        if still[rows[0]] and end - begin >= LEAST_S:
            x, z, eta = places[:, rows[-1]]
            found.append((float(begin), float(end), (float(x), float(z), float(eta))))
    return found


def holding_line_at(flight: FlightData, time_s: Floats) -> NDArray[np.bool_]:
    """When the module held the aircraft on a line; all along where the log tells no mode of it."""
    if not flight.modes:
        return np.ones(len(time_s), dtype=bool)
    begins = np.array([change.time_s for change in flight.modes])
    holds = np.array([False, *(change.name in HOLDING_LINE for change in flight.modes)])
    return holds[np.searchsorted(begins, time_s, side="right")]


def _name(line: Line, named: Mapping[str, Line]) -> str:
    """Of the site's line that this one lies on; "" if there is none."""
    for name, (x, z, eta) in named.items():
        aside = hypot(line[0] - x, line[1] - z)
        if aside <= SAME_LINE_M and abs(line[2] - eta) <= SAME_LINE_RAD:
            return name
    return ""


def _distance_sigma(
    line: Line, place: tuple[float, float], time_s: Floats, x_m: Floats, z_m: Floats
) -> float:
    """Standard error of the distance between the mean position of a leg's tail and a place.

    From the scatter across and along the line, each with as many independent samples as its
    own correlation leaves: what the flight's finite length does, and nothing else.
    """
    tail = time_s >= time_s[-1] - TAIL_S
    t, x, z = time_s[tail], x_m[tail], z_m[tail]
    c, s = cos(line[2]), sin(line[2])
    along = mean_sigma(t, c * (x - line[0]) + s * (z - line[1]))
    across = mean_sigma(t, c * (z - line[1]) - s * (x - line[0]))
    dx, dz = float(np.mean(x)) - place[0], float(np.mean(z)) - place[1]
    distance = hypot(dx, dz)
    if distance <= hypot(along, across):  # too near to have a direction
        return hypot(along, across)
    return hypot(along * (c * dx + s * dz) / distance, across * (c * dz - s * dx) / distance)


def mean_sigma(time_s: Floats, values: Floats) -> float:
    """Standard error of the mean of a correlated signal, shape (n,); NaN from fewer than 8.

    s √(2 τ / T), τ the integral of the autocorrelation up to its first zero.  A signal that does
    not lose its memory within the time has one independent sample.
    """
    n = len(values)
    if n < 8 or time_s[-1] <= time_s[0]:
        return nan
    deviation = values - np.mean(values)
    variance = float(np.mean(deviation**2))
    if variance == 0.0:
        return 0.0
    spectrum = np.fft.rfft(deviation, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n] / (variance * n)
    negative = np.flatnonzero(correlation <= 0.0)
    until = int(negative[0]) if negative.size else n
    samples = 2.0 * float(np.sum(correlation[:until])) - 1.0  # that say the same as one
    return float(np.sqrt(variance * min(1.0, max(1.0, samples) / n)))

"""The air as it is measured in flight: the lift map, made here on the ground from telemetry.

The module sends where it is, how it moves, and its estimates of wind and updraft
(`ARRAY` of `onboard.telemetry_values`).  While it is engaged each two of these that follow one
another are a reading of `estimation.lift_map`, the one that the search for lift uses.  Held in a
hand an aircraft measures the hand, so that nothing is read before.

The map is asked for its prediction a row of the grid at a time, so that no turn of the server waits
for the whole of it.  A place is drawn where the map can tell one to soar at from one without any
updraft: there E = −S, here E = 0, and both are two standard deviations of E apart.  The standard
deviation is the one that the map claims, where it may be trusted: within NEAR of the way that was
flown its errors are 0.30 m/s in random tunnels and 0.17 m/s over random hills (docs/search.md),
half of S and less; farther away they are as large as S, whatever it claims.

Readings 0.5 s apart count as those 0.2 s apart that the map's noise was argued for: it claims to
know less than it does, never more.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.config.line_changes import SIDES
from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.control.search.rollout import floor_at
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.extended_polar import sink
from tgl_soar.estimation.lift_map.lift_map import LiftMap, Reading
from tgl_soar.types import GRAVITY_MPS2, GlidePolar, Ground

CELLS: Final = 40  # nodes of the grid, along its longer side
FEWEST: Final = 16  # along the other, of a fence that is long and low
GAP_S: Final = 1.2  # two samples of 2 Hz, one of them lost
# No glider is soared in a wind of half of this; what is faster is no measurement.
FASTEST_MPS: Final = 100.0
NEAR: Final = 0.3  # of H, the height of the fence, from where the aircraft was
KNOWN: Final = 0.5  # of the sink there: E's standard deviation at most

Floats = NDArray[np.float64]
Segment = tuple[tuple[float, float], tuple[float, float]]


class AirSample(NamedTuple):
    """What telemetry reports at one instant, soaring frame; NaN: not known."""

    time_s: float
    x_m: float
    z_m: float
    velocity_x_mps: float  # over the ground, downstream
    wind_mps: float
    updraft_mps: float
    pushed_mps: float = 0.0  # climb that a propeller gives: no lift


def box_of(parameters: Mapping[str, float], view: list[float]) -> Box:
    """The fence, on each side where it is set; else the part of the plane that is drawn."""
    sides = []
    for name, drawn in zip(SIDES, view, strict=True):
        value = parameters[name]
        is_set = isfinite(value) and value != PARAMETERS[INDEX[name]].default
        sides.append(value if is_set else drawn)
    return Box._make(sides)


class MeasuredAir:
    """The map of one flight, and the drawing of it."""

    def __init__(self, ground: Ground, polar: GlidePolar, view: list[float]) -> None:
        """view: x from, x to, z from, z to [m] of what is drawn."""
        self._ground, self._polar, self._view = ground, polar, view
        self._begin(Box._make(view))

    def _begin(self, box: Box) -> None:
        self._box = box
        self._x = _axis(box.x_min_m, box.x_max_m, box)
        self._z = _axis(box.z_min_m, box.z_max_m, box)
        self._map: LiftMap | None = None
        self._before: AirSample | None = None
        self._read_s = float("nan")
        self._is_near = np.zeros((len(self._z), len(self._x)), dtype=bool)  # nodes to a reading
        self._rows: list[tuple[Floats, Floats]] = []  # updraft and E of the rows that are ready
        self._drawn = 0  # readings behind the drawing
        self.drawing: dict[str, Any] | None = None  # as JSON; None: nothing was measured yet

    def begin_again(self) -> None:
        """Forget the flight."""
        self._begin(self._box)

    def bound(self, parameters: Mapping[str, float]) -> None:
        """The fence as the module echoes it; another one than before begins the map again."""
        if not all(name in parameters for name in SIDES):
            return
        box = box_of(parameters, self._view)
        if box != self._box and box.x_min_m < box.x_max_m and box.z_min_m < box.z_max_m:
            self._begin(box)

    @property
    def readings(self) -> int:
        """How many the map holds."""
        return 0 if self._map is None else self._map.readings

    def take(self, sample: AirSample, *, flying: bool) -> None:
        """A sample; together with the one before it is a reading."""
        before, self._before = self._before, sample
        if not flying or not self._is_measurement(sample):
            self._before = None
            return
        if before is None:
            return
        dt_s = sample.time_s - before.time_s
        if not 0.0 < dt_s <= GAP_S:
            return
        wind_mps = 0.5 * (before.wind_mps + sample.wind_mps)
        airspeed_mps = wind_mps - 0.5 * (before.velocity_x_mps + sample.velocity_x_mps)
        change_mps2 = (sample.velocity_x_mps - before.velocity_x_mps) / dt_s
        pushed_mps = 0.5 * (before.pushed_mps + sample.pushed_mps)
        climb_mps = (sample.z_m - before.z_m) / dt_s - pushed_mps
        since_s = sample.time_s - self._read_s
        reading = Reading(
            x_m=0.5 * (before.x_m + sample.x_m),
            z_m=0.5 * (before.z_m + sample.z_m),
            wind_mps=wind_mps,
            updraft_mps=0.5 * (before.updraft_mps + sample.updraft_mps),
            airspeed_mps=airspeed_mps,
            energy_mps=climb_mps - airspeed_mps / GRAVITY_MPS2 * change_mps2,
            since_s=since_s if since_s > 0.0 else dt_s,
        )
        self._read_s = sample.time_s
        try:
            if self._map is None:
                # Whether there is a pitot is not sent: the wider of both biases.
                self._map = LiftMap(self._ground, self._box, self._polar, reading, pitot=False)
            self._map.take(reading)
            away = np.hypot(self._x - reading.x_m, (self._z - reading.z_m)[:, None])
            self._is_near |= away <= NEAR * self._box.height_m
        except np.linalg.LinAlgError:  # what no aircraft measures
            self.begin_again()

    def _is_measurement(self, sample: AirSample) -> bool:
        box = self._box
        return (
            all(map(isfinite, sample))
            and box.x_min_m <= sample.x_m <= box.x_max_m
            and box.z_min_m <= sample.z_m <= box.z_max_m
            and 0.0 < sample.wind_mps < FASTEST_MPS
            and abs(sample.updraft_mps) < FASTEST_MPS
            and abs(sample.velocity_x_mps) < FASTEST_MPS
            and abs(sample.pushed_mps) < FASTEST_MPS
        )

    def draw_on(self) -> None:
        """The next row of the drawing; nothing where there is nothing new to draw."""
        if self._map is None or (not self._rows and self._map.readings == self._drawn):
            return
        j = len(self._rows)
        z_m = np.full(self._x.shape, self._z[j])
        found = self._map.at(self._x, z_m)
        limit = KNOWN * sink(self._polar, found.wind_mps)
        known = (found.excess_sd_mps <= limit) & self._is_near[j]
        over_m = z_m - floor_at(self._ground, self._x, -np.inf)
        # The ground is drawn over the map: a node below its edge keeps that from being jagged.
        updraft = np.where(known & (over_m > -self._step_z), found.updraft_mps, np.nan)
        self._rows.append((updraft, np.where(known & (over_m > 0.0), found.excess_mps, np.nan)))
        if len(self._rows) < len(self._z):
            return
        updraft, excess = (np.array(rows) for rows in zip(*self._rows, strict=True))
        self._rows = []
        self._drawn = self._map.readings
        self.drawing = {
            "x": float(self._x[0]),
            "z": float(self._z[0]),
            "step": float(self._x[1] - self._x[0]),
            "step_z": self._step_z,
            "cells": [[round(100.0 * w) if isfinite(w) else None for w in row] for row in updraft],
            "contour": [
                [[round(value, 3) for value in point] for point in segment]
                for segment in zero_segments(self._x, self._z, excess)
            ],
            "readings": self._drawn,
            "loose": round(self._map.loose, 2),
        }

    def draw_whole(self) -> None:
        """All of it at once, for a recording."""
        self.draw_on()
        while self._rows:
            self.draw_on()

    @property
    def _step_z(self) -> float:
        return float(self._z[1] - self._z[0])


def _axis(low_m: float, high_m: float, box: Box) -> Floats:
    """Nodes of the grid along one side of the box."""
    longer_m = max(box.x_max_m - box.x_min_m, box.z_max_m - box.z_min_m)
    return np.linspace(low_m, high_m, max(FEWEST, round(CELLS * (high_m - low_m) / longer_m)))


def zero_segments(x_m: Floats, z_m: Floats, values: Floats) -> list[Segment]:
    """Where values (rows by z, columns by x), linear between nodes, are zero: pieces, in no order.

    A cell with a node that is not known (NaN) has none.
    """
    segments: list[Segment] = []
    positive = values > 0.0
    known = np.isfinite(values)
    whole = known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]
    count = (
        positive[:-1, :-1].astype(int) + positive[:-1, 1:] + positive[1:, :-1] + positive[1:, 1:]
    )
    for j, i in np.argwhere(whole & (count > 0) & (count < 4)).tolist():
        corners = ((j, i), (j, i + 1), (j + 1, i + 1), (j + 1, i))
        cuts: list[tuple[float, float]] = []
        for (ja, ia), (jb, ib) in zip(corners, (*corners[1:], corners[0]), strict=True):
            a, b = float(values[ja, ia]), float(values[jb, ib])
            if (a > 0.0) != (b > 0.0):
                t = a / (a - b)
                cuts.append(
                    (
                        float(x_m[ia] + t * (x_m[ib] - x_m[ia])),
                        float(z_m[ja] + t * (z_m[jb] - z_m[ja])),
                    )
                )
        # Of a saddle's four cuts those that follow one another are joined: one of two ways.
        segments += [(cuts[k], cuts[k + 1]) for k in range(0, len(cuts), 2)]
    return segments

"""`lift_map`: how far the map can be trusted, by the distance from what was flown.

Glides of a held line through the random places of `analysis.search.places`, without the loop's
own motion (`control.search.rollout`'s equations), with readings every 0.2 s, gusts, a polar and an
updraft that are off.  Three maps of each: as it flies, without the ground's profile, and with a
profile that is 20 % too low.  Aimed at are the prototype's error, and a normalised error of 1:
χ² of one degree of freedom; up to 2 the claimed standard deviation is 0.7 of what it should be.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.places import PUBLISHED, Kind, SearchPlace, place
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.extended_polar import sink
from tgl_soar.estimation.lift_map.lift_map import LiftMap, Reading
from tgl_soar.types import NO_GROUND, GlidePolar, Ground

PLACES: Final[dict[Kind, int]] = {"tunnel": 20, "hill": 40}
AFTER_S: Final[dict[Kind, float]] = {"tunnel": 1.0, "hill": 4.0}
RINGS: Final = ((0.0, 0.1), (0.1, 0.3), (0.3, 0.7))  # of H, from the path
PROTOTYPE: Final[dict[Kind, tuple[float, ...]]] = {
    "tunnel": (0.14, 0.27, 0.50),
    "hill": (0.14, 0.23, 0.26),
}
HONEST: Final = 2.0  # χ² at most
EVERY_S: Final = 0.2
BIAS_MPS: Final = 0.06
STEEPNESS: Final = 0.27  # of a line of 15° lean: metres upstream for a metre up
LOW: Final = 0.8  # of the ground's height: what a wrong profile knows of it
MAPS: Final = ("as it flies", "without the ground", "with the ground 20 % too low")


class Ring(NamedTuple):
    """Errors at some distance: of all places, squares and normalised squares."""

    squares: list[float]
    normalised: list[float]


def run(context: Context) -> Result:
    """Glide, predict, compare.  Nothing is flown."""
    polar = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
    tables, claims = [], []
    numbers: dict[str, Any] = {}
    kinds: tuple[Kind, ...] = ("tunnel", "hill")
    for kind in kinds:
        count = 3 if context.quick else PLACES[kind]
        there = [place(kind, seed) for seed in range(PUBLISHED, PUBLISHED + count)]
        found = {
            name: rings_of(there, polar, _grounds(there, name), AFTER_S[kind]) for name in MAPS
        }
        tables.append(_table(kind, found))
        ours = found[MAPS[0]]
        for k, (low, high) in enumerate(RINGS):
            error, chi2 = rms(ours[k].squares), float(np.mean(ours[k].normalised))
            claims.append(
                Claim(
                    f"{kind}: rms error at {low:g}–{high:g} H no more than the prototype's"
                    f" {PROTOTYPE[kind][k]:.2f} m/s",
                    error <= PROTOTYPE[kind][k],
                    f"{error:.2f} m/s",
                )
            )
            claims.append(
                Claim(
                    f"{kind}: χ² at {low:g}–{high:g} H at most {HONEST:g}",
                    chi2 <= HONEST,
                    f"{chi2:.2f}",
                )
            )
        numbers[kind] = {
            name: [(rms(r.squares), float(np.mean(r.normalised))) for r in rings]
            for name, rings in found.items()
        }
    return Result(
        name="lift_map",
        title="how far the lift map can be trusted",
        flown=(
            "Glides of 1 s through random tunnels and of 4 s over random hills, a third of them in"
            " a shear that is no potential flow, with gusts of 1–5 %, a polar off by up to 10 % and"
            f" an updraft off by up to {BIAS_MPS:g} m/s."
        ),
        claims=tuple(claims),
        why="",
        tables=tuple(tables),
        numbers=numbers,
        seeds=tuple(range(PUBLISHED, PUBLISHED + max(PLACES.values()))),
    )


def _grounds(there: list[SearchPlace], name: str) -> list[Ground]:
    """What each map knows of the ground."""
    if name == MAPS[1]:
        return [NO_GROUND] * len(there)
    known = [each.ground for each in there]
    if name == MAPS[0]:
        return known
    return [each._replace(z_m=tuple(LOW * z for z in each.z_m)) for each in known]


def rings_of(
    there: list[SearchPlace], polar: GlidePolar, grounds: list[Ground], after_s: float
) -> list[Ring]:
    """Errors of excess updraft by distance from the path."""
    rings = [Ring([], []) for _ in RINGS]
    for each, ground in zip(there, grounds, strict=True):
        lift, path = glide(each, polar, ground, after_s)
        x, z, truth = _nodes(each, polar)
        away = np.min([np.hypot(x - a, z - b) for a, b in path], axis=0) / each.box.height_m
        estimated = lift.at(x, z)
        off = estimated.excess_mps - truth
        for ring, (low, high) in zip(rings, RINGS, strict=True):
            here = (away >= low) & (away < high)
            if here.any():
                ring.squares.append(float(np.mean(off[here] ** 2)))
                ring.normalised.append(
                    float(np.mean((off[here] / estimated.excess_sd_mps[here]) ** 2))
                )
    return rings


def glide(
    there: SearchPlace, polar: GlidePolar, ground: Ground, duration_s: float
) -> tuple[LiftMap, list[tuple[float, float]]]:
    """The map after a glide down or up a line that stands still, and its path."""
    rng = np.random.default_rng((there.seed, 11))
    start, air = there.site.start, there.site.air
    assert start is not None
    assert air is not None
    gusts = air.turbulence.intensity * there.field.reference_wind_mps / sqrt(2.0)
    bias = float(rng.uniform(-BIAS_MPS, BIAS_MPS))
    x, z = start.x_m, start.z_m
    lift: LiftMap | None = None
    path = []
    for k in range(round(duration_s / EVERY_S) + 1):
        path.append((x, z))
        u, _, w = there.field.wind_at(x, 0.0, z, k * EVERY_S)
        gust_u, gust_w = rng.normal(0.0, gusts, 2).tolist()
        falls = there.sink_factor * float(sink(polar, u))
        climb = w - falls
        # The mean of white gusts over a reading moves the aircraft little in one of them.
        reading = Reading(
            x_m=x,
            z_m=z,
            wind_mps=u + gust_u,
            updraft_mps=w + gust_w + bias,
            airspeed_mps=u + gust_u + STEEPNESS * climb,
            energy_mps=w + gust_w - there.sink_factor * float(sink(polar, u + STEEPNESS * climb)),
            since_s=EVERY_S,
        )
        if lift is None:
            lift = LiftMap(ground, there.box, polar, reading, pitot=True)
        lift.take(reading)
        x, z = x - STEEPNESS * climb * EVERY_S, z + climb * EVERY_S
    assert lift is not None
    return lift, path


def _nodes(there: SearchPlace, polar: GlidePolar) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of the box above the ground, and the true excess updraft there [m/s]."""
    box: Box = there.box
    x, z = (
        part.ravel()
        for part in np.meshgrid(
            np.linspace(box.x_min_m, box.x_max_m, 30), np.linspace(box.z_min_m, box.z_max_m, 30)
        )
    )
    n = there.ground.points
    floor = np.interp(x, there.ground.x_m[:n], there.ground.z_m[:n])
    air = z > floor + 0.06 * box.height_m
    x, z = x[air], z[air]
    u, _, w = there.field.wind(x, 0.0, z, 0.0)
    return x, z, w - there.sink_factor * sink(polar, u)


def rms(squares: list[float]) -> float:
    """Root of the mean of mean squares."""
    return float(np.sqrt(np.mean(squares)))


def _table(kind: str, found: dict[str, list[Ring]]) -> Table:
    rows = [
        (
            name,
            " / ".join(f"{rms(ring.squares):.2f}" for ring in rings),
            " / ".join(f"{np.mean(ring.normalised):.2f}" for ring in rings),
            " / ".join(f"{np.median(ring.normalised):.2f}" for ring in rings),
        )
        for name, rings in found.items()
    ]
    return Table(
        f"{kind}: predicted excess updraft, at < 0.1 / 0.1–0.3 / 0.3–0.7 H from the path",
        ("map", "rms error [m/s]", "χ², mean over places", "χ², median"),
        tuple(rows),
    )

"""The lift map of a flight that was flown, made again from its log: how it grew, in frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.search.episode import Episode
from tgl_soar.analysis.search.figures import search_figure
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.analysis.search.searchers import MapSearch
from tgl_soar.config.site import Site
from tgl_soar.control.search.glimpse import LOOK_S, Glimpse, SearchTask
from tgl_soar.control.search.lift_search import guards_of, sighting_of
from tgl_soar.control.target_line import LineTracking
from tgl_soar.types import VehicleState

FRAMES_S: Final = (0.6, 2.0, 5.0, 10.0)  # after the first reading


def glimpses_of(flight: FlightData, begin_s: float, end_s: float) -> list[Glimpse]:
    """What was reported to the search in flight, from its log; nothing where it lacks a part."""
    path, motion, air, line = flight.path, flight.motion, flight.air, flight.line
    if path is None or motion is None or air is None or line is None:
        return []
    found: list[Glimpse] = []
    before: VehicleState | None = None
    for time_s in np.arange(begin_s, end_s, LOOK_S).tolist():
        place = {name: float(path.at(name, time_s)) for name in ("x_m", "y_m", "z_m")}
        speeds = ("velocity_x_mps", "velocity_y_mps", "climb_mps")
        moved = {name: float(motion.at(name, time_s)) for name in speeds}
        angles = ("roll", "pitch", "heading")
        still = {f"{name}_rad": 0.0 for name in angles}
        still |= {f"{name}_rate_radps": 0.0 for name in angles}
        now = VehicleState(time_s=time_s, **place, **moved, **still)
        if before is not None:
            since = air.within(before.time_s, time_s)
            flown = {name: float(line.last_at(name, time_s)) for name in line.columns}
            found.append(
                Glimpse(
                    before=before,
                    now=now,
                    line=LineTracking(
                        x_m=flown["x_m"],
                        z_m=flown["z_m"],
                        eta_rad=flown["eta_rad"],
                        moving=flown["moving"] > 0.0,
                        e_rho_m=0.0,
                        e_rho_rate_mps=0.0,
                    ),
                    wind_mps=float(np.mean(since["wind_mps"])) if len(since) else float("nan"),
                    updraft_mps=float(np.mean(since["updraft_mps"])) if len(since) else 0.0,
                    pitot=True,
                    seeks=False,
                    refused=None,
                )
            )
        before = now
    return found


def map_figure(
    path: Path,
    glimpses: Sequence[Glimpse],
    task: SearchTask,
    site: Site,
    field: WindField,
) -> bool:
    """Frames of the map under the flight, beside the true field; whether there was one to draw."""
    guards, polar = guards_of(task), task.polar
    looks = [look for g in glimpses if (look := sighting_of(guards, g)) is not None]
    if not looks:
        return False
    begin_s = looks[0].time_s
    search = MapSearch(polar, tuple(begin_s + t for t in FRAMES_S))
    for look in looks:
        search.watch(look)
    if not search.snapshots:
        return False
    times = np.array([look.time_s for look in looks])
    duration_s = float(times[-1])
    place = SearchPlace(
        kind="tunnel",
        seed=0,
        site=site,
        field=field,
        ground=guards.ground,
        box=guards.box,
        duration_s=duration_s,
        sink_factor=1.0,
        change=1.0,
        words=site.site.name,
    )
    rows = {
        "time_s": times,
        "x_m": np.array([look.moving.x_m for look in looks]),
        "z_m": np.array([look.moving.z_m for look in looks]),
    }
    episode = Episode(
        place=place, searcher="map", ended="", given_up="", flown_s=duration_s, path=rows
    )
    grid = search.grid
    search_figure(path, episode, search.snapshots, polar, grid.x_m, grid.z_m)
    return True

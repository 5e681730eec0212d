#!/usr/bin/env python3
"""Searches for lift through a real firmware, over the hill: the table of docs/search.md.

    python tools/measure_search.py ardupilot override --firmware .../bin/arduplane
    python tools/measure_search.py builtin
    python tools/measure_search.py ardupilot override --firmware ... --budgets 0 25

From each of `STARTS` and with each seed the aircraft is released, the module is told to search
(SRCH_START) and to fly on for `STAY_S` after it has found a place.  Position by the firmware's own
estimator and satellites, 1 % turbulence.  By the truth:

    soared        flew to the end, and does not sink there (`analysis.search.scoring`)
    settled       from when on it neither climbs nor sinks for 5 s, since the search began
    found         when the module says that it soars, likewise
    height lost   from there to the lowest place
    false claim   it said so at the end, and did not

With `--budgets` an aircraft that has a propeller flies, each with such a THR_BUDGET, from
`POWERED_START` in `POWERED_WIND_MPS`: there the lift of no line near it carries the aircraft.

    throttle      the seconds of full throttle that the propeller got
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Final, NamedTuple

from tgl_soar.analysis.search.scoring import SINKS_MPS, mean_climb, settling_s
from tgl_soar.config.files import shipped
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

# x, z [m]: behind the contour, above it, in the lift below it.  The wind is 8.3 to 8.9 m/s at each:
# where it is 7 the aircraft could not stand, whatever it looks for.
STARTS: Final = ((-3.0, 14.5), (-4.5, 16.5), (-6.0, 11.0))
# Ten metres upstream of the nearest place, in a wind that it could stand in.
POWERED_START: Final = (-21.0, 8.0)
POWERED_WIND_MPS: Final = 9.5
SEEDS: Final = (1, 2, 3)
STAY_S: Final = 30.0
WATCH_S: Final = 2.0  # where it gives up
TURBULENCE: Final = 0.01
END_S: Final = 10.0  # over which the last climb is averaged


COLUMNS: Final = (
    *("start", "budget", "seed", "soared", "settled", "found", "height lost", "false claim"),
    "throttle",
)


class Search(NamedTuple):
    """One of the table."""

    start: tuple[float, float]
    seed: int
    budget_s: float | None = None  # of an aircraft with a propeller


def searches(budgets_s: list[float], seeds: list[int]) -> list[Search]:
    """All of them."""
    if budgets_s:
        return [Search(POWERED_START, seed, each) for each in budgets_s for seed in seeds]
    return [Search(start, seed) for start in STARTS for seed in seeds]


def site_text(hill: str, search: Search) -> str:
    """The shipped hill with that start; with a budget in its wind, which has no contour."""
    text = started_at(hill, *search.start)
    if search.budget_s is None:
        return text
    return blown_at(text, POWERED_WIND_MPS)


def blown_at(text: str, wind_mps: float) -> str:
    """A site file in another wind, and without the contour, which is of its own."""
    text = re.sub(r"(?ms)^# Where excess updraft is zero.*", "", text)
    return re.sub(r"(?m)^wind_mps = .*$", f"wind_mps = {wind_mps}", text, count=1)


def started_at(text: str, x_m: float, z_m: float) -> str:
    """A site file with another start."""
    for axis, value in (("x", x_m), ("z", z_m)):
        text = re.sub(rf"(?m)(?<=^\[start\]\n)((?:.*\n)*?){axis}_m = .*$",
                      rf"\g<1>{axis}_m = {value}", text, count=1)  # fmt: skip
    return text


def options(arguments: argparse.Namespace, search: Search, folder: Path) -> SitlOptions:
    """One search."""
    folder.mkdir(parents=True, exist_ok=True)
    site = folder / "start.toml"
    site.write_text(site_text(shipped("sites/hill.toml").read_text(), search))
    powered = search.budget_s is not None
    return SitlOptions(
        airframe=shipped(f"airframes/eclipson_c{'_propeller' if powered else ''}.toml"),
        site=site,
        out=folder,
        stay_s=STAY_S,
        settings=(("THR_BUDGET", search.budget_s),) if search.budget_s is not None else (),
        seed=search.seed,
        turbulence=TURBULENCE,
        autopilot=arguments.autopilot,
        firmware=arguments.firmware,
        route=arguments.route,
        search=True,
        watch_s=WATCH_S,
    )


def row(flown: SitlOptions) -> str:
    """Of the table.  Errors: `SitlError`."""
    flight = fly(flown, lambda _: None)
    truth = flight.truth
    words = re.findall(r"released: (.*)", (flown.out / "module.log").read_text(errors="replace"))
    if not flight.flown:  # it was over before there was a line
        return f"| no | – | no: {words[-1:] or ['never']} | – | no | – |"
    leg = flight.flown[0]
    end_s = leg.ended_s
    begun_s = truth["time_s"][truth["flying"] > 0.0][0]  # it is held until it is commanded
    rows = (truth["time_s"] >= begun_s) & (truth["time_s"] <= end_s)
    time_s, z_m = truth["time_s"][rows], truth["z_m"][rows]
    claims = bool(leg.found) and end_s - leg.stopped_s >= STAY_S - 0.5
    on = bool(truth["flying"][rows].all()) and mean_climb(time_s, z_m, END_S) > SINKS_MPS
    claimed = f"{leg.stopped_s - begun_s:.1f} s" if claims else f"no: {words[-1:] or ['never']}"
    throttle_s = float(truth["throttle"][rows].sum() * (truth["time_s"][1] - truth["time_s"][0]))
    return (
        f"| {'yes' if claims and on else 'no'} | {settling_s(time_s, z_m):.1f} s | {claimed}"
        f" | {z_m[0] - z_m.min():.2f} m | {'yes' if claims and not on else 'no'}"
        f" | {throttle_s:.1f} s |"
    )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("autopilot", choices=("builtin", "ardupilot", "px4"))
    parser.add_argument("route", nargs="?", help="the usual one where not given")
    parser.add_argument("--firmware", type=Path, metavar="PATH", help="its program")
    parser.add_argument("--out", type=Path, default=Path("out/searches"), help="folder")
    parser.add_argument("--budgets", type=float, nargs="+", default=[], metavar="S")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    arguments = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |")
    print("|" + "---|" * len(COLUMNS))
    for search in searches(arguments.budgets, arguments.seeds):
        x_m, z_m = search.start
        budget = "–" if search.budget_s is None else f"{search.budget_s:g} s"
        name = f"{arguments.autopilot}-{arguments.route}-{x_m:g}-{z_m:g}-{budget}-{search.seed}"
        try:
            found = row(options(arguments, search, arguments.out / name.replace(" ", "")))
        except SitlError as error:
            found = f"| not flown: {str(error).splitlines()[0]} | | | | | |"
        print(f"| {x_m:g}, {z_m:g} | {budget} | {search.seed} {found}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

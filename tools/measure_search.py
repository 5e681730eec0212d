#!/usr/bin/env python3
"""Searches for lift through a real firmware, over the hill: the table of docs/search.md.

    python tools/measure_search.py ardupilot override --firmware .../bin/arduplane
    python tools/measure_search.py builtin

From each of `STARTS` and with each seed the aircraft is released, the module is told to search
(SRCH_START) and to fly on for `STAY_S` after it has found a place.  Position by the firmware's own
estimator and satellites, 1 % turbulence.  By the truth:

    soared        flew to the end, and does not sink there (`analysis.search.scoring`)
    settled       from when on it neither climbs nor sinks for 5 s, since the search began
    found         when the module says that it soars, likewise
    height lost   from there to the lowest place
    false claim   it said so at the end, and did not
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Final

from tgl_soar.analysis.search.scoring import SINKS_MPS, mean_climb, settling_s
from tgl_soar.config.files import shipped
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

# x, z [m]: behind the contour, above it, in the lift below it.  The wind is 8.3 to 8.9 m/s at each:
# where it is 7 the aircraft could not stand, whatever it looks for.
STARTS: Final = ((-3.0, 14.5), (-4.5, 16.5), (-6.0, 11.0))
SEEDS: Final = (1, 2, 3)
STAY_S: Final = 30.0
WATCH_S: Final = 2.0  # where it gives up
TURBULENCE: Final = 0.01
END_S: Final = 10.0  # over which the last climb is averaged


def started_at(text: str, x_m: float, z_m: float) -> str:
    """A site file with another start."""
    for axis, value in (("x", x_m), ("z", z_m)):
        text = re.sub(rf"(?m)(?<=^\[start\]\n)((?:.*\n)*?){axis}_m = .*$",
                      rf"\g<1>{axis}_m = {value}", text, count=1)  # fmt: skip
    return text


def options(
    arguments: argparse.Namespace, start: tuple[float, float], seed: int, folder: Path
) -> SitlOptions:
    """One search."""
    folder.mkdir(parents=True, exist_ok=True)
    site = folder / "start.toml"
    site.write_text(started_at(shipped("sites/hill.toml").read_text(), *start))
    return SitlOptions(
        airframe=shipped("airframes/eclipson_c.toml"),
        site=site,
        out=folder,
        stay_s=STAY_S,
        seed=seed,
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
    leg, truth = flight.flown[0], flight.truth
    end_s = leg.ended_s
    begun_s = truth["time_s"][truth["flying"] > 0.0][0]  # it is held until it is commanded
    rows = (truth["time_s"] >= begun_s) & (truth["time_s"] <= end_s)
    time_s, z_m = truth["time_s"][rows], truth["z_m"][rows]
    claims = bool(leg.found) and end_s - leg.stopped_s >= STAY_S - 0.5
    on = bool(truth["flying"][rows].all()) and mean_climb(time_s, z_m, END_S) > SINKS_MPS
    words = re.findall(r"released: (.*)", (flown.out / "module.log").read_text(errors="replace"))
    claimed = f"{leg.stopped_s - begun_s:.1f} s" if claims else f"no: {words[-1:] or ['never']}"
    return (
        f"| {'yes' if claims and on else 'no'} | {settling_s(time_s, z_m):.1f} s | {claimed}"
        f" | {z_m[0] - z_m.min():.2f} m | {'yes' if claims and not on else 'no'} |"
    )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("autopilot", choices=("builtin", "ardupilot", "px4"))
    parser.add_argument("route", nargs="?", help="the usual one where not given")
    parser.add_argument("--firmware", type=Path, metavar="PATH", help="its program")
    parser.add_argument("--out", type=Path, default=Path("out/searches"), help="folder")
    arguments = parser.parse_args()
    print("| start | seed | soared | settled | found | height lost | false claim |")
    print("|---|---|---|---|---|---|---|")
    for start in STARTS:
        for seed in SEEDS:
            name = f"{arguments.autopilot}-{arguments.route}-{start[0]:g}-{start[1]:g}-{seed}"
            try:
                found = row(options(arguments, start, seed, arguments.out / name))
            except SitlError as error:
                found = f"| not flown: {str(error).splitlines()[0]} | | | | |"
            print(f"| {start[0]:g}, {start[1]:g} | {seed} {found}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

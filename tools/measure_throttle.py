#!/usr/bin/env python3
"""A propeller within its budget, between real processes and through a real ArduPlane.

    python tools/measure_throttle.py
    python tools/measure_throttle.py --autopilot ardupilot --firmware .../bin/arduplane

Upstream of the shipped hill, in a wind fast enough to hover in, on a line without a place to
settle: at rest the aircraft sinks all the way down the line.  Without a budget the flight ends;
with one the module opens the throttle while it must, until the budget is used up.  A row of the
table in docs/search.md, from when the line stood, or was lost, by the simulation's truth but for
what the module says:

    budget     THR_BUDGET
    flown      for so long, of `STAY_S`
    heights    the least and the largest
    e_rho      rms
    moved      integral of the throttle that the propeller got, by the firmware's own output
    used       the same as the module counts it
    end        the last mode, and why it disengaged
"""

from __future__ import annotations

import argparse
import re
import sys
from math import nan, radians
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from measure_beating import parsed
from measure_search import POWERED_START, POWERED_WIND_MPS, blown_at, started_at
from numpy.typing import NDArray

from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.config.files import shipped
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

Floats = NDArray[np.float64]
WIND_MPS: Final = POWERED_WIND_MPS
PLACE: Final = POWERED_START  # x, z of start and line [m]
LEAN_DEG: Final = 15.0  # of the site's file
STAY_S: Final = 60.0
WATCH_S: Final = 5.0  # where it disengages by itself
INTENSITY: Final = 0.01
BUDGETS_S: Final = (0.0, 5.0, 30.0)
SEEDS: Final = (1, 2, 3)
AUTOPILOTS: Final = ("builtin", "ardupilot")  # whose routes carry a throttle
COLUMNS: Final = (
    *("budget [s]", "seed", "flown [s]", "heights [m]", "e_rho [cm]", "moved [s]", "used [s]"),
    "end",
)


class Pushed(NamedTuple):
    """What a flight came to."""

    flown_s: float
    heights_m: tuple[float, float]
    e_rho_m: float
    moved_s: float
    used_s: float


def site_text(hill: str) -> str:
    """The shipped hill, with the place of `PLACE` in the wind of `WIND_MPS`, and no contour."""
    text = blown_at(started_at(hill, *PLACE), WIND_MPS)
    for axis, value in zip("xz", PLACE, strict=True):
        text = re.sub(rf"(?m)^TGL_{axis.upper()} = .*$", f"TGL_{axis.upper()} = {value}", text)
    line = "a = {{ x_m = {}, z_m = {} }}".format(*PLACE)
    return re.sub(r"(?ms)^\[lines\]\n.*?\n\n", f"[lines]\n{line}\n\n", text)


def outcome(truth: dict[str, Floats], used_s: float) -> Pushed:
    """Of a flight, from its truth; used_s: as the module counts."""
    flies = (truth["flying"] > 0.0) & (truth["overridden"] > 0.0)
    if not flies.any():
        return Pushed(flown_s=0.0, heights_m=(nan, nan), e_rho_m=nan, moved_s=0.0, used_s=used_s)
    times = truth["time_s"]
    step_s = float(times[1] - times[0])
    eta = eta_from_lean(radians(LEAN_DEG))
    x, z = truth["x_m"][flies], truth["z_m"][flies]
    off = [e_rho(*PLACE, eta, *at) for at in zip(x, z, strict=True)]
    return Pushed(
        flown_s=float(flies.sum() * step_s),
        heights_m=(float(z.min()), float(z.max())),
        e_rho_m=float(np.sqrt(np.mean(np.square(off)))),
        moved_s=float(truth["throttle"][flies].sum() * step_s),
        used_s=used_s,
    )


def used_by(folder: Path) -> float:
    """What the module has counted of its budget, by its newest log; NaN: it left none."""
    logs = sorted(folder.glob("logs/*/*.ulg"))
    return float(read_log(logs[-1]).topics["tick"]["throttle_used_s"].max()) if logs else nan


def end_of(log: str) -> str:
    """The module's last words on its mode."""
    found = re.findall(r"(?:capturing|soaring|released|recovering|holding): .*", log)
    return str(found[-1]) if found else "–"


def flown(given: argparse.Namespace, folder: Path, budget_s: float, seed: int) -> str:
    """A row.  Errors: `SitlError`."""
    folder.mkdir(parents=True, exist_ok=True)
    site = folder / "upstream.toml"
    site.write_text(site_text(shipped("sites/hill.toml").read_text(encoding="utf-8")))
    settings = (("THR_BUDGET", budget_s),)
    flight = fly(
        SitlOptions(
            airframe=shipped("airframes/eclipson_c_propeller.toml"),
            site=site,
            out=folder,
            legs=("a",),
            stay_s=STAY_S,
            settings=settings,
            seed=seed,
            turbulence=INTENSITY,
            autopilot=given.autopilot,
            firmware=given.firmware,
            route=given.route,
            watch_s=WATCH_S,
        ),
        lambda _: None,
    )
    found = outcome(flight.truth, used_by(folder))
    low, high = found.heights_m
    end = end_of((folder / "module.log").read_text(errors="replace"))
    return (
        f"{found.flown_s:.0f} | {low:.1f}, {high:.1f} | {100 * found.e_rho_m:.1f}"
        f" | {found.moved_s:.2f} | {found.used_s:.2f} | {end}"
    )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--budgets", type=float, nargs="+", default=BUDGETS_S, metavar="S")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--out", type=Path, default=Path("out/throttle"), help="folder")
    given = parsed(parser, AUTOPILOTS)
    print(f"| {' | '.join(COLUMNS)} |")
    print("|" + "--:|" * (len(COLUMNS) - 1) + "---|")
    for budget_s in given.budgets:
        for seed in given.seeds:
            folder = given.out / f"{given.autopilot}-{budget_s:g}-{seed}"
            try:
                row = flown(given, folder, budget_s, seed)
            except SitlError as error:
                row = f"{' | '.join(' ' * 5)} | not flown: {str(error).splitlines()[0]}"
            print(f"| {budget_s:g} | {seed} | {row} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

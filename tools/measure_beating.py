#!/usr/bin/env python3
"""Beating along the ridge between real processes, and through a real ArduPlane or PX4.

    python tools/measure_beating.py
    python tools/measure_beating.py --autopilot ardupilot --firmware .../bin/arduplane
    python tools/measure_beating.py --autopilot ardupilot --firmware PATH --route attitude
    python tools/measure_beating.py --autopilot px4 --firmware .../bin/px4 --route manual_control

The larger hill of `tgl-soar experiment beating`, its fence and its line, in a wind that is fast
enough to stand in until `FALLS_S`, too slow for `SLOW_S`, and fast enough again.  The slow part has
the fluctuations of a synthetic record (`air.wind_record`) of the flight's seed, and there are gusts
of 3 %.  `tgl-soar sitl` flies it, by the module as a process, so that a seed is the same wind
whoever the autopilot is.  A row of the table in docs/outdoors.md:

    began      after the wind had begun to fall; "–": never
    beating    for so long in all
    turns      from one side of the wind to the other
    height     over the foot while it beat: least, median, most
    aside      from the frame's middle while it beat, at most
    off        the line's plane while it beat: the most upstream, the most downstream
    again      stood again so long after the wind was back; "–": never
    end        the last mode, and why it disengaged
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from collections.abc import Iterable
from math import isfinite, nan, radians, tan
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.wind_record import (
    SyntheticWind,
    WindRecord,
    synthetic_record,
    write_wind_record,
)
from tgl_soar.analysis.experiments.outdoors.hour import (
    BEATS,
    INTENSITY,
    HourCase,
    HourJob,
    hour_flown,
)
from tgl_soar.analysis.experiments.outdoors.shipped_hill import AIRFRAME, shipped_hill
from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.config.files import airframe_file, load_flight
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import HillAir, Site
from tgl_soar.control.supervisor import BEATING, SOARING
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

Floats = NDArray[np.float64]
HILL_M: Final = 30.0
STANDS_MPS: Final = 7.5
SLOW_MPS: Final = 5.0  # on average
FALLS_S: Final = 60.0  # ArduPlane has aligned by then, and the module stands
SLOW_S: Final = 240.0  # with both ramps
RAMP_S: Final = 10.0
AFTER_S: Final = 60.0  # once the wind is back
ENDS_S: Final = FALLS_S + SLOW_S + AFTER_S
AUTO: Final = 2  # ESC_AUTO, as the experiment has it
RECORD: Final = "wind.csv"
WATCH_S: Final = 5.0  # where it disengages by itself
STOOD_S: Final = {"builtin": 4.0, "ardupilot": 26.0, "px4": 10.0}  # when its line stands, about
NO_PITOT: Final = {
    "builtin": (),
    "ardupilot": ("ARSPD_TYPE=0",),
    "px4": ("FW_USE_AIRSPD=0", "SYS_HAS_NUM_ASPD=0"),  # else it does not arm
}
SEEDS: Final = (1, 2, 3)
NEVER: Final = "–"
COLUMNS: Final = (
    *("seed", "began [s]", "beating [s]", "turns", "height [m]", "aside [m]", "off [m]"),
    *("again [s]", "end"),
)
# Of the site's file: [landing] has the others, and they may stand in one place alone.
LANDING: Final = ("LND_X", "ESC_X")


class Beaten(NamedTuple):
    """What a flight came to."""

    began_s: float  # after the wind had begun to fall; NaN: never
    beating_s: float
    turns: int
    heights_m: tuple[float, float, float]  # while it beat
    aside_m: float
    off_m: tuple[float, float]  # off the plane: the most upstream, the most downstream
    again_s: float  # stood again so long after the wind was back; NaN: never
    end: str


def wind_of(seed: int) -> WindRecord:
    """Fast enough to stand in, too slow, and fast enough again."""
    slow = synthetic_record(
        SyntheticWind(duration_s=SLOW_S, mean_mps=SLOW_MPS, lulls_per_hour=0.0), seed
    )
    begins = FALLS_S + RAMP_S
    ends = FALLS_S + SLOW_S
    rows = [(0.0, STANDS_MPS, 0.0), (FALLS_S, STANDS_MPS, 0.0)]
    rows += [
        (time_s, slow.wind_mps.at(time_s), slow.veer_rad.at(time_s))
        for time_s in np.arange(begins, ends - RAMP_S, 2.0).tolist()
    ]
    rows += [(ends, STANDS_MPS, 0.0)]
    times, winds, veers = zip(*rows, strict=True)
    return WindRecord(Schedule(times, winds), Schedule(times, veers))


def site_text(site: Site, values: ParameterSet, shipped: ParameterSet, record: str) -> str:
    """The larger hill as a site file, in the wind of a record."""
    air, start, strip, ground = site.air, site.start, site.landing, site.ground
    assert isinstance(air, HillAir)
    assert start is not None
    assert strip is not None
    assert ground is not None
    profile = ", ".join(f"[{x:.3f}, {z:.3f}]" for x, z in ground.profile)
    settings = [
        f"{name} = {values[name]:.6g}"
        for name in (parameter.name for parameter, _ in values)
        if name not in LANDING and (name in site.parameters or values[name] != shipped[name])
    ]
    return "\n".join(
        (
            "[site]",
            f'name = "half-cylinder hill of {air.radius_m:g} m"',
            f"wind_from_deg = {site.site.wind_from_deg:g}",
            "[air]",
            'kind = "hill"',
            f"wind_mps = {air.wind_mps:g}",
            f"radius_m = {air.radius_m:g}",
            f'record = "{record}"',
            "[start]",
            f"x_m = {start.x_m:.3f}",
            f"z_m = {start.z_m:.3f}",
            "[ground]",
            f"profile = [{profile}]",
            "[lines]",
            f"a = {{ x_m = {values['TGL_X']:.6g}, z_m = {values['TGL_Z']:.6g} }}",
            "[landing]",
            f"x_m = {values['LND_X']:.6g}",
            f"z_m = {strip.z_m:g}",
            f"bearing_deg = {strip.bearing_deg:g}",
            f"length_m = {strip.length_m:g}",
            f"away_x_m = {values['ESC_X']:.6g}",
            "[parameters]",
            *settings,
            "",
        )
    )


def site_of(folder: Path, seed: int) -> Path:
    """Site and wind of a flight, written to a folder."""
    larger = hour_flown(HourJob(HourCase(HILL_M, STANDS_MPS, AUTO, BEATS), seed))
    values = larger.values.changed({"BEAT_AUTO": 1.0})
    folder.mkdir(parents=True, exist_ok=True)
    write_wind_record(folder / RECORD, wind_of(seed))
    path = folder / "beating.toml"
    path.write_text(site_text(larger.site, values, shipped_hill().values, RECORD))
    return path


def outcome(truth: dict[str, Floats], modes: Floats, values: ParameterSet) -> Beaten:
    """Of a flight, from its truth and the module's mode at each row of it."""
    times, beats = truth["time_s"], modes == BEATING
    stands = times[(modes == SOARING) & (times >= FALLS_S + SLOW_S)]
    x, y, z, heading = (truth[n][beats] for n in ("x_m", "y_m", "z_m", "heading_rad"))
    leans = (z - values["TGL_Z"]) / tan(eta_from_lean(radians(values["TGL_LEAN"])))
    off = x - values["TGL_X"] - leans
    some = bool(beats.any())
    # Once a second: a nose that comes through the wind for good is one turn, and not its wiggles.
    seconds = np.sign(heading[:: round(1.0 / (times[1] - times[0]))])
    low, middle, high = np.percentile(z, (0, 50, 100)) if some else (nan, nan, nan)
    return Beaten(
        began_s=float(times[beats][0]) - FALLS_S if some else nan,
        beating_s=float(beats.sum() * (times[1] - times[0])),
        turns=int(np.count_nonzero(np.diff(seconds))),
        heights_m=(float(low), float(middle), float(high)),
        aside_m=float(np.abs(y).max()) if some else nan,
        off_m=(float(off.min()), float(off.max())) if some else (nan, nan),
        again_s=float(stands[0]) - FALLS_S - SLOW_S if stands.size and some else nan,
        end=MODE_NAMES[int(modes[-1])],
    )


def modes_of(folder: Path, times: Floats) -> Floats:
    """The module's mode at each of these times, by the log of its flight in a folder.

    In lockstep its clock is the vehicle's, and so is the truth's.  Errors: `SitlError`.
    """
    parts = [read_log(path).topics["tick"] for path in sorted(folder.glob("logs/*/*.ulg"))]
    if not parts:
        raise SitlError(f"{folder}: the module has left no log")
    ticks = np.concatenate([part["timestamp"] for part in parts]) * 1e-6
    mode = np.concatenate([part["mode"] for part in parts]).astype(float)
    order = np.argsort(ticks, kind="stable")
    rows = np.searchsorted(ticks[order], times, side="right") - 1
    modes: Floats = mode[order][np.maximum(rows, 0)]
    return modes


class Flown(NamedTuple):
    """By whom, and with what."""

    autopilot: str
    firmware: Path | None
    route: str | None
    pitot: bool


def flown(how: Flown, folder: Path, seed: int) -> Beaten:
    """Fly one.  Errors: `SitlError`."""
    shutil.rmtree(folder / "logs", ignore_errors=True)
    site = site_of(folder, seed)
    flight = fly(
        SitlOptions(
            airframe=airframe_file(AIRFRAME),
            site=site,
            out=folder,
            legs=("a",),
            stay_s=ENDS_S - STOOD_S[how.autopilot],
            seed=seed,
            turbulence=INTENSITY,
            pitot=how.pitot,
            autopilot=how.autopilot,
            firmware=how.firmware,
            route=how.route,
            autopilot_parameters=() if how.pitot else NO_PITOT[how.autopilot],
            watch_s=WATCH_S,
        ),
        lambda _: None,
    )
    _, _, values = load_flight(airframe_file(AIRFRAME), site)
    modes = modes_of(folder, flight.truth["time_s"])
    found = outcome(flight.truth, modes, values)
    released = re.findall(r"released: (.*)", (folder / "module.log").read_text(errors="replace"))
    return found._replace(end=released[-1]) if released else found


def words(found: Beaten) -> str:
    """Of the table."""

    def written(value: float) -> str:
        return f"{value:.0f}" if isfinite(value) else NEVER

    return " | ".join(
        (
            written(found.began_s),
            f"{found.beating_s:.0f}",
            f"{found.turns}",
            ", ".join(written(each) for each in found.heights_m),
            written(found.aside_m),
            ", ".join(written(each) for each in found.off_m),
            written(found.again_s),
            found.end,
        )
    )


def parsed(parser: argparse.ArgumentParser, autopilots: Iterable[str]) -> argparse.Namespace:
    """The command line of a tool whose flights one of these autopilots flies."""
    parser.add_argument("--autopilot", choices=tuple(autopilots), default="builtin")
    parser.add_argument("--firmware", type=Path, metavar="PATH", help="its program")
    parser.add_argument("--route", help="of commands (default: the usual one)")
    arguments = parser.parse_args()
    if (arguments.autopilot == "builtin") != (arguments.firmware is None):
        parser.error("--firmware names the program of a real --autopilot, and of that alone")
    return arguments


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--no-pitot", action="store_true", help="the aircraft has no tube")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--out", type=Path, default=Path("out/beating"), help="folder")
    arguments = parsed(parser, STOOD_S)
    how = Flown(arguments.autopilot, arguments.firmware, arguments.route, not arguments.no_pitot)
    print(f"| {' | '.join(COLUMNS)} |")
    print("|" + "--:|" * (len(COLUMNS) - 1) + "---|")
    for seed in arguments.seeds:
        tube = "pitot" if how.pitot else "none"
        folder = arguments.out / f"{how.autopilot}-{how.route or 'usual'}-{tube}-{seed}"
        try:
            row = words(flown(how, folder, seed))
        except SitlError as error:
            row = f"{' | '.join(' ' * 7)} | not flown: {str(error).splitlines()[0]}"
        print(f"| {seed} | {row} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

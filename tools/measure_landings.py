#!/usr/bin/env python3
"""Break-offs to a landing through a real firmware, by our approach and by its own landings.

    python tools/measure_landings.py
    python tools/measure_landings.py --autopilot px4 --firmware .../bin/px4
    python tools/measure_landings.py --autopilot px4 --firmware PATH --route manual_control --by 1

The shipped hill in its 7 m/s with gusts of 3 %, with a pitot tube but for `--no-pitot`.  The
aircraft stands on line a for `STAYS_S`, then the operator breaks off (`ESC_START`), with `LND_BY`
as `--by` names it: 0, the module's own approach; 1, the landing of the firmware's mission; 2, its
return.  The mission has home and the touch-down at the site's landing place, and its approach
begins at the edge of the lift; `--without` leaves the landing out, so that a return is no
mission's.  `MADE_FIT` is what an operator sets of the firmware for that; `--set` has more, or
other numbers.  A row of the table
in docs/outdoors.md:

    taken      by the firmware's own mode, so long after breaking off; "–": never
    from       x, z there
    down       touched, or hit, something so long after breaking off; "–": not within `WATCH_S`
    at         x, z there
    along      beyond the landing place, upwind of it
    across     to its side
    sink       in the last instant of flight
    said       what the module told of the hand-over, and why it disengaged
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from math import isfinite, nan
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from measure_beating import NO_PITOT, modes_of, parsed
from numpy.typing import NDArray

from tgl_soar.config.files import airframe_file, load_flight, site_file
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.supervisor import BREAKING_OFF
from tgl_soar.link.messages import COMMAND_DO_LAND_START, COMMAND_NAV_LAND
from tgl_soar.onboard.firmware_landing import LANDING_MODES
from tgl_soar.sim.firmware.mission import HEADING
from tgl_soar.sim.firmware.sensors import SOMEWHERE
from tgl_soar.sim.sensor_messages import geodetic
from tgl_soar.sim.sitl import fly
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

Floats = NDArray[np.float64]
AIRFRAME: Final = "eclipson_c"
SITE: Final = "hill"
INTENSITY: Final = 0.03
STAYS_S: Final = 4.0
WATCH_S: Final = 30.0  # once the module has disengaged
SEEDS: Final = (1, 2, 3)
NEVER: Final = "–"
COLUMNS: Final = (
    *("LND_BY", "seed", "taken [s]", "from x, z [m]", "down [s]", "at x, z [m]"),
    *("along [m]", "across [m]", "sink [m/s]", "said"),
)
# Pitch is for the airspeed alone, as there is no throttle; the ground is known without a
# rangefinder; and the mission's slope is accepted.
MADE_FIT: Final = {
    "builtin": (),
    "ardupilot": (
        *("RTL_AUTOLAND=2", "TECS_SPDWEIGHT=2", "TECS_LAND_ARSPD=10"),
        *("LAND_FLARE_ALT=1", "LAND_FLARE_SEC=1", "WP_RADIUS=3"),
    ),
    "px4": (
        *("FW_T_SPDWEIGHT=2", "FW_LND_AIRSPD=9", "FW_LND_USETER=0", "FW_LND_ANG=35"),
        *("FW_LND_FLALT=1", "RTL_RETURN_ALT=5", "RTL_DESCEND_ALT=5", "RTL_LOITER_RAD=25"),
    ),
}
WAYPOINT: Final = 16  # MAV_CMD
GLOBAL, NO_PLACE = 0, 2  # MAV_FRAME; PX4 refuses a command that has none with a place
APPROACH: Final = (14.0, 9.0)  # of its begin from the touch-down: downwind, and up


class Landed(NamedTuple):
    """What a flight came to."""

    taken_s: float  # by the firmware, after breaking off; NaN: never
    taken_at: tuple[float, float]  # x, z
    down_s: float  # after breaking off; NaN: never
    down_at: tuple[float, float]
    along_m: float
    across_m: float
    sink_mps: float


def mission_text(values: ParameterSet, *, lands: bool = True) -> str:
    """The firmware's mission: home, and a landing at the landing place, if it lands."""
    land_x = values["LND_X"]
    rows = [
        (GLOBAL, WAYPOINT, land_x, 0.0),
        (NO_PLACE, COMMAND_DO_LAND_START, land_x, 0.0),
        (GLOBAL, WAYPOINT, land_x + APPROACH[0], APPROACH[1]),
        (GLOBAL, COMMAND_NAV_LAND, land_x, 0.0),
    ]
    if not lands:
        rows = [rows[0], rows[2]]
    lines = [HEADING]
    for number, (frame, command, x_m, z_m) in enumerate(rows):
        latitude, longitude, height = geodetic(SOMEWHERE, 0.0, x_m, -z_m)  # wind from the west
        place = f"{latitude:.8f}\t{longitude:.8f}\t{height:.2f}"
        lines.append(f"{number}\t0\t{frame}\t{command}\t0\t0\t0\t0\t{place}\t1")
    return "\n".join(lines)


def outcome(
    truth: dict[str, Floats], modes: Floats, theirs: int | None, values: ParameterSet
) -> Landed:
    """Of a flight, from its truth and the module's mode at each row; theirs: custom_mode."""
    times = truth["time_s"]
    begun = np.flatnonzero(modes == BREAKING_OFF)
    since = begun[0] if begun.size else times.size - 1
    taken = np.flatnonzero((truth["mode"] == theirs) & (np.arange(times.size) > since))
    lies = np.flatnonzero((truth["flying"] == 0.0) & (np.arange(times.size) > since))

    def at(rows: NDArray[np.int64], before: int = 0) -> tuple[float, float, float, float, float]:
        if not rows.size:
            return nan, nan, nan, nan, nan
        row = rows[0] - before
        x, y, z, climb = (float(truth[n][row]) for n in ("x_m", "y_m", "z_m", "climb_mps"))
        return float(times[row] - times[since]), x, y, z, climb

    taken_s, taken_x, _, taken_z, _ = at(taken)
    down_s, x, y, z, climb = at(lies, before=1)
    return Landed(
        taken_s=taken_s,
        taken_at=(taken_x, taken_z),
        down_s=down_s,
        down_at=(x, z),
        along_m=values["LND_X"] - x,
        across_m=y,
        sink_mps=-climb,
    )


def reported(log: str) -> str:
    """What the module reported of the hand-over and of its end."""
    found = re.findall(r"(?:tgl_soar: )?(the autopilot (?:lands|is in|does not land).*)", log)
    found += re.findall(r"(LND_BY \d: .*|its (?:home|mission).*: we land)", log)
    found += re.findall(r"released: (.*)", log)[-1:]
    return "; ".join(found) or NEVER


class Flown(NamedTuple):
    """By whom, and with what."""

    autopilot: str
    firmware: Path | None
    route: str | None
    settings: tuple[str, ...]  # of the firmware, NAME=NUMBER
    lands: bool = True  # its mission has a landing
    pitot: bool = True  # the aircraft has a tube


def flown(how: Flown, folder: Path, by: int, seed: int) -> tuple[Landed, str]:
    """Fly one; also what was said.  Errors: `SitlError`."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    _, _, values = load_flight(airframe_file(AIRFRAME), site_file(SITE))
    mission = folder / "mission.txt"
    mission.write_text(mission_text(values, lands=how.lands))
    real = how.autopilot != "builtin"
    flight = fly(
        SitlOptions(
            airframe=airframe_file(AIRFRAME),
            site=site_file(SITE),
            out=folder,
            legs=("a",),
            stay_s=STAYS_S,
            settings=(("LND_BY", float(by)),),
            seed=seed,
            turbulence=INTENSITY,
            autopilot=how.autopilot,
            firmware=how.firmware,
            route=how.route,
            pitot=how.pitot,
            autopilot_parameters=(
                *MADE_FIT[how.autopilot],
                *(() if how.pitot else NO_PITOT[how.autopilot]),
                *how.settings,
            ),
            mission=mission if real else None,
            goes_home=True,
            watch_s=WATCH_S if by else 2.0,
        ),
        lambda _: None,
    )
    modes = modes_of(folder, flight.truth["time_s"])
    theirs = LANDING_MODES.get(how.autopilot, {}).get(by)
    log = (folder / "module.log").read_text(errors="replace")
    return outcome(flight.truth, modes, theirs, values), reported(log)


def words(found: Landed) -> str:
    """Of the table."""

    def written(*numbers: float, digits: int = 1) -> str:
        if not all(isfinite(number) for number in numbers):
            return NEVER
        return ", ".join(f"{number:.{digits}f}" for number in numbers)

    return " | ".join(
        (
            written(found.taken_s),
            written(*found.taken_at),
            written(found.down_s),
            written(*found.down_at),
            written(found.along_m),
            written(found.across_m),
            written(found.sink_mps, digits=2),
        )
    )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--by", type=int, nargs="+", default=None, help="LND_BY (default: all)")
    parser.add_argument(
        "--set", nargs="+", default=(), metavar="NAME=NUMBER", help="of the firmware's parameters"
    )
    parser.add_argument("--without", action="store_true", help="a landing in its mission")
    parser.add_argument("--no-pitot", action="store_true", help="the aircraft has no tube")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--out", type=Path, default=Path("out/landings"), help="folder")
    arguments = parsed(parser, MADE_FIT)
    how = Flown(
        autopilot=arguments.autopilot,
        firmware=arguments.firmware,
        route=arguments.route,
        settings=tuple(arguments.set),
        lands=not arguments.without,
        pitot=not arguments.no_pitot,
    )
    print(f"| {' | '.join(COLUMNS)} |")
    print("|" + "--:|" * (len(COLUMNS) - 1) + "---|")
    for by in arguments.by or (0, *LANDING_MODES.get(how.autopilot, {})):
        for seed in arguments.seeds:
            mission = "" if how.lands else "-without"
            tube = "" if how.pitot else "-none"
            name = f"{how.autopilot}-{how.route or 'usual'}-{by}{mission}{tube}-{seed}"
            folder = arguments.out / name
            try:
                landed, reported = flown(how, folder, by, seed)
                row = f"{words(landed)} | {reported}"
            except SitlError as error:
                row = f"{' | '.join(' ' * 7)} | not flown: {str(error).splitlines()[0]}"
            print(f"| {by} | {seed} | {row} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

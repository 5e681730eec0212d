#!/usr/bin/env python3
"""The hour of `tgl-soar experiment hour`, flown by a real ArduPlane in a mode of its own.

    python tools/measure_hour.py --firmware .../bin/arduplane
    python tools/measure_hour.py --firmware PATH --minutes 60 --seeds 9201

The same winds over the same hills, and the same aircraft with its propeller.  ArduPlane has no mode
that stays where lift carries an aircraft; the one that stays at all is LOITER: about the place of
the line, at its height, or upwind of it (`--upwind`), where the hill makes no sink.  Nobody bounds
its throttle.  The aircraft is held in the wind until the firmware is armed and in that mode.  A row
of the table in docs/outdoors.md:

    aloft       until it hits something, or to the end
    throttle    of full throttle, on average and in all
    height      over the place of the line: least, median, most
    away        from there, horizontally, at most
"""

from __future__ import annotations

import argparse
import sys
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.analysis.experiments.outdoors.hour import (
    FIRST_SEED,
    INTENSITY,
    POWERED,
    RADII_M,
    HourCase,
    HourJob,
    field_of,
    hour_flown,
    record_of,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.sim.channels import NEUTRAL
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.sim.firmware.ardupilot import STEP_HZ, ArduPlane, start
from tgl_soar.sim.firmware.mission import MissionItem, set_home
from tgl_soar.sim.firmware.relay import Relay
from tgl_soar.sim.firmware.sensors import SOMEWHERE, FirmwareSensors, firmware_sensors
from tgl_soar.sim.firmware.simulation import Sticks, arm
from tgl_soar.sim.world import World, make_world
from tgl_soar.types import SurfaceCommand

LOITER: Final = 12  # custom_mode
# A circle of half the larger hill's height, and thrice the smallest that this aircraft turns in; a
# receiver on and sticks centred, so that nothing but the mode flies.
PARAMETERS: Final = {
    "AIRSPEED_CRUISE": 11.0,  # faster than the wind, or it drifts away
    "WP_LOITER_RAD": 25.0,
    "ROLL_LIMIT_DEG": 45.0,
    "THR_MAX": 100.0,
    "TRIM_THROTTLE": 40.0,
    "THR_SLEWRATE": 100.0,
}
# Home is where it is armed, unless it is set; and within 10 m of its height ArduPlane takes the
# aircraft for one that has not taken off, and lets the throttle stay closed.
FOOT: Final = MissionItem(
    frame=0,
    command=0,
    parameters=(0.0, 0.0, 0.0, 0.0),
    latitude_deg=SOMEWHERE.latitude_deg,
    longitude_deg=SOMEWHERE.longitude_deg,
    height_m=SOMEWHERE.altitude_m,
)
WINDS_MPS: Final = (7.0, 9.0)
UPWIND_M: Final = (0.0, 40.0)
SEEDS: Final = (FIRST_SEED, FIRST_SEED + 1, FIRST_SEED + 2)
PATIENCE_S: Final = 120.0  # simulated: until it is armed and in the mode


class Hour(NamedTuple):
    """What a flight came to."""

    aloft_s: float
    ended: str
    throttle_s: float
    heights_m: tuple[float, float, float]  # over the line's place
    away_m: float


class Firmware:
    """ArduPlane in lockstep with a world."""

    def __init__(self, world: World, plane: ArduPlane, relay: Relay, seed: int) -> None:
        self.world, self.plane, self.relay = world, plane, relay
        self.sensors = FirmwareSensors(world, None, seed)
        self.surfaces: SurfaceCommand = NEUTRAL

    def step(self) -> None:
        """One step of both."""
        world, relay = self.world, self.relay
        world.throttle = self.plane.throttle
        world.step(self.surfaces)
        self.surfaces = self.plane.exchange(self.sensors.read(), Sticks(NEUTRAL))
        relay.step(world.time_s)
        if world.steps % STEP_HZ == 0:
            relay.greet()

    def begin(self) -> None:
        """Arm it, held as it is, and ask for the mode.  Errors: `FirmwareError`."""
        world, relay = self.world, self.relay
        while world.time_s < PATIENCE_S:
            self.step()
            if relay.armed and relay.custom_mode == LOITER:
                return
            if world.steps % STEP_HZ or not relay.ready:
                continue
            if not relay.armed:
                relay.command(arm(1))
                continue
            relay.command(set_home(1, FOOT))
            relay.command(self.plane.ask_for_mode(1, LOITER))
        raise FirmwareError(f"ArduPlane is not armed and loitering after {PATIENCE_S:g} s")


def fly_hour(
    binary: Path, folder: Path, case: HourCase, seed: int, minutes: float, upwind_m: float
) -> Hour:
    """One flight.  Errors: `FirmwareError`, OSError."""
    job = HourJob(case, seed)
    flown = hour_flown(job)
    at = flown.site.start
    assert at is not None
    begins = msgspec.structs.replace(at, x_m=at.x_m - upwind_m)
    flown = flown._replace(site=msgspec.structs.replace(flown.site, start=begins))
    world = make_world(
        flown.airframe,
        flown.site,
        seed=seed,
        turbulence=INTENSITY,
        step_hz=STEP_HZ,
        field=field_of(flown, record_of(job)),
        sensors=firmware_sensors(STEP_HZ),
    )
    world.held = True
    plane, relay = start(binary, folder, flown.airframe, flown.site, PARAMETERS)
    try:
        firmware = Firmware(world, plane, relay, seed)
        firmware.begin()
        world.held = False
        return _watched(firmware, flown.values, 60.0 * minutes)
    finally:
        plane.close()
        relay.close()


def _watched(firmware: Firmware, values: ParameterSet, seconds: float) -> Hour:
    """Fly on; values: of the line."""
    world, begins = firmware.world, firmware.world.steps
    ends = begins + round(seconds * STEP_HZ)
    rows = []
    while world.steps < ends and not world.crashed:
        firmware.step()
        truth = world.truth
        rows.append((truth.x_m, truth.y_m, truth.z_m, firmware.plane.throttle))
    x, y, z, throttle = np.array(rows).T
    low, middle, high = np.percentile(z - values["TGL_Z"], [0, 50, 100])
    return Hour(
        aloft_s=(world.steps - begins) / STEP_HZ,
        ended=world.crashed.partition(" at x")[0],
        throttle_s=float(throttle.sum()) / STEP_HZ,
        heights_m=(float(low), float(middle), float(high)),
        away_m=float(np.hypot(x - values["TGL_X"], y).max()),
    )


def _words(found: Hour) -> str:
    heights = ", ".join(f"{each:.1f}" for each in found.heights_m)
    return (
        f"{found.aloft_s / 60.0:.1f} | {100.0 * found.throttle_s / found.aloft_s:.0f}"
        f" | {found.throttle_s:.0f} | {heights} | {found.away_m:.0f}"
        f" | {found.ended or 'to the end'}"
    )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--firmware", type=Path, required=True, metavar="PATH", help="arduplane")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each hour")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--upwind", type=float, nargs="+", default=UPWIND_M, metavar="M")
    parser.add_argument("--out", type=Path, default=Path("out/hours"), help="folder")
    arguments = parser.parse_args()
    names = (
        *("hill [m]", "upwind [m]", "wind [m/s]", "seed", "aloft [min]", "throttle [%]", "[s]"),
        *("height [m]", "away [m]", "ended"),
    )
    print(f"| {' | '.join(names)} |")
    print("|" + "--:|" * 7 + "---|--:|---|")
    for radius, upwind, mean, seed in product(
        RADII_M, arguments.upwind, WINDS_MPS, arguments.seeds
    ):
        case = HourCase(radius, mean, 0, POWERED)
        folder = arguments.out / f"{radius:g}-{upwind:g}-{mean:g}-{seed}"
        try:
            words = _words(
                fly_hour(arguments.firmware, folder, case, seed, arguments.minutes, upwind)
            )
        except FirmwareError as error:
            words = f"not flown: {error} | | | | |"
        print(f"| {radius:g} | {upwind:g} | {mean:g} | {seed} | {words} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

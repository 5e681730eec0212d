#!/usr/bin/env python3
"""How late and how faithful an autopilot is: the numbers of docs/autopilots.md.

    python tools/measure_autopilot.py latency ardupilot override --firmware .../bin/arduplane
    python tools/measure_autopilot.py silence out/sitl
    python tools/measure_autopilot.py along out/sitl out/other --point -0.12
    python tools/measure_autopilot.py shakes out/sitl out/other

`latency`: the aircraft is held over the hill, the autopilot runs in lockstep at the pace of the
clock, and a companion that thinks in no time steps elevator or bank to and fro.

    sensor to companion   ATTITUDE_QUATERNION: the step at which it arrives, less its own stamp
    command to servo      the step at which the output moves, less that at which the command came

Both are simulated time, whole steps of the firmware.  What the module itself takes is in
docs/performance.md.

`silence`: what became of a flight of `tgl-soar sitl --kill-module`, from its folder.

`along`: how far it drifted along the last line and across it, in the last minute, of flights of
`tgl-soar sitl` together; about the mean of each, or about a point held by TGL_ALONG.

`shakes`: what shakes of the brake found (`control.brake_shake`) in flights of `tgl-soar sitl`, from
the states that their logs keep: the last of each shake, up to `STATE_TICKS` before it was over.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from math import atan2, cos, degrees, hypot, sin, sqrt
from pathlib import Path
from statistics import mean, median
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.analysis.report.figure_style import drawing, save
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.link.autopilots import flavour
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import (
    AUTOPILOT_INVALID,
    STATE_ACTIVE,
    TYPE_ONBOARD_CONTROLLER,
    Heartbeat,
    Source,
)
from tgl_soar.onboard.setup import surface_channels
from tgl_soar.sim.firmware.sensors import Readings
from tgl_soar.sim.firmware.simulation import FirmwareSimulation, Sticks
from tgl_soar.sim.firmware.starts import STARTS
from tgl_soar.sim.simulation import Options, Simulation
from tgl_soar.types import NO_SETPOINTS, OURS, SurfaceCommand

LINK: Final = 1
COMMAND_HZ: Final = 100
STEPS_TRIED: Final = 60
SWING: Final = 0.2  # of the elevator
SWING_RAD: Final = 0.15  # of the bank
MOVED: Final = 0.05  # of full travel: above what noise and loops of its own do in a step or two
BOOT_S: Final = 60.0
# Integrators of an aircraft that is held would run full, and its outputs stand at the end.
BENCH: Final = {
    "px4": {"COM_RC_IN_MODE": 6.0, "FW_RR_I": 0.0},
    "ardupilot": {"RLL_RATE_I": 0.0},
}
HOLD_S: Final = 0.3  # and as much again at most between two swings
COMMANDED_S: Final = 0.1  # so long after a command the bridge's log still says so
MINUTE_S: Final = 60.0
END: Final = 0.02  # so near an end of the brake's travel it is at it
LOST_S: Final = 0.25  # an output that has not moved by then has not followed


class Reported:
    """A firmware's simulator interface, with what the servos were commanded last."""

    def __init__(self, physics: Any) -> None:
        self._physics = physics
        self.servos = SurfaceCommand(0.0, 0.0, 0.0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._physics, name)

    def exchange(self, readings: Readings, sticks: Sticks) -> SurfaceCommand:
        """One step."""
        self.servos = self._physics.exchange(readings, sticks)
        return self.servos


class Latencies(NamedTuple):
    """All that were measured [s]."""

    ages_s: list[float]
    to_servo_s: list[float]
    lost: int  # swings that no output followed


def latency(firmware: str, route: str | None, program: Path | None, folder: Path) -> Latencies:
    """Hold the aircraft, swing the command, look at the servos."""
    plane = load_airframe(shipped("airframes/eclipson_c.toml"))
    path = shipped("sites/hill.toml")
    site = load_site(path)
    way = flavour(firmware, route, surface_channels(plane), 1)
    options = Options(truth=False, parameters=())
    simulation: Any
    if firmware == "bridge":
        simulation = Simulation(plane, site, options, path.parent)

        def servos() -> SurfaceCommand:
            return simulation.pixhawk.surfaces  # type: ignore[no-any-return]

    else:
        if program is None:
            raise SystemExit(f"{firmware}: give its program with --firmware")
        made, relay = STARTS[firmware](program, folder, plane, site, BENCH[firmware])
        reported = Reported(made)
        simulation = FirmwareSimulation(plane, site, options, path.parent, reported, relay)

        def servos() -> SurfaceCommand:
            return reported.servos

    simulation.add_link(LINK, ground=False)
    try:
        return _swing(simulation, way, servos)
    finally:
        simulation.close()


def _swing(simulation: Any, way: Any, servos: Callable[[], SurfaceCommand]) -> Latencies:
    ours = way.route.loops == OURS

    def output() -> float:
        return servos().elevator if ours else servos().aileron

    system = 255 if way.route.as_operator else 1
    own, commanding = Encoder(Source(1, 191)), Encoder(Source(system, 191))
    listening: Any = mavlink.MAVLink(None)
    listening.robust_parsing = True
    rng = random.Random(1)
    ages: list[float] = []
    delays: list[float] = []
    step_hz = simulation.pixhawk.step_hz
    every = step_hz // COMMAND_HZ
    side, swung_at, next_at, lost, steps = 1.0, -1, 0, 0, 0
    before, armed, custom_mode = 0.0, False, -1
    began_s: float | None = None
    deadline = time.monotonic()
    while len(delays) + lost < STEPS_TRIED:
        steps += 1
        deadline = max(deadline + 1.0 / step_hz, time.monotonic() - 0.1)
        time.sleep(max(0.0, deadline - time.monotonic()))
        simulation.world.held = True
        simulation.step()
        now_s = simulation.time_s
        for _, data in simulation.take_datagrams([LINK]):
            for message in listening.parse_buffer(bytearray(data)) or ():
                if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
                    armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED != 0
                    custom_mode = message.custom_mode
                elif message.get_type() == "ATTITUDE_QUATERNION" and began_s is not None:
                    ages.append(now_s - 1e-3 * message.time_boot_ms)
        if steps % step_hz == 0:
            beat = Heartbeat(
                type=TYPE_ONBOARD_CONTROLLER,
                autopilot=AUTOPILOT_INVALID,
                base_mode=0,
                custom_mode=0,
                system_status=STATE_ACTIVE,
            )
            simulation.receive(LINK, own.encode(beat))
            simulation.pixhawk.set_pace(LINK)
            mode = way.route.mode_to_enter
            if armed and mode is not None and custom_mode != mode:
                simulation.receive(LINK, own.encode(way.ask_for_mode(mode)))
            elif armed and began_s is None:
                began_s = now_s + 2.0
                next_at = steps + 2 * step_hz
            if began_s is None and now_s > BOOT_S:
                raise SystemExit(f"not armed in its mode within {BOOT_S:g} s")
        if swung_at >= 0:
            late_s = (steps - swung_at) / step_hz
            if abs(output() - before) > MOVED:
                delays.append(late_s)
                swung_at = -1
            elif late_s > LOST_S:
                lost += 1
                swung_at = -1
        swings = began_s is not None and swung_at < 0 and steps >= next_at
        if swings:
            side, swung_at, before = -side, steps, output()
            next_at = steps + round((HOLD_S + HOLD_S * rng.random()) * step_hz)
        if swings or steps % every == 0:
            surfaces = SurfaceCommand(side * SWING if ours else 0.0, 0.0, 0.0)
            asked = NO_SETPOINTS._replace(roll_rad=side * SWING_RAD, pitch_rad=0.0)
            for command in way.commands(surfaces, asked):
                simulation.receive(LINK, commanding.encode(command))
    return Latencies(ages, delays, lost)


def silence(folder: Path) -> dict[str, float | str]:
    """What happened after the module was killed, of a flight of `tgl-soar sitl`."""
    summary = json.loads((folder / "summary.json").read_text())
    killed_s = summary["killed_s"]
    if killed_s is None:
        raise SystemExit(f"{folder}: fly it with --kill-module")
    with (folder / "truth.csv").open(newline="") as file:
        rows = [{n: float(v) for n, v in row.items()} for row in csv.DictReader(file)]
    after = [row for row in rows if row["time_s"] >= killed_s]
    first = after[0]
    silent_s = killed_s
    if (folder / "companion.tlog").exists():  # with a firmware the bridge sees the commands
        commanded = [row["time_s"] for row in after if row["overridden"]]
        silent_s = max(killed_s, commanded[-1] - COMMANDED_S)
    silent = [row for row in after if row["time_s"] >= silent_s + 0.15]  # servos have arrived
    at_rest = silent[0]

    def since(is_so: Callable[[dict[str, float]], bool]) -> float:
        return next((row["time_s"] - silent_s for row in silent if is_so(row)), float("nan"))

    flown = [row for row in after if row["flying"]]
    return {
        "surfaces stood for [s]": since(
            lambda row: any(
                abs(row[name] - at_rest[name]) > 0.01 for name in ("elevator", "aileron", "rudder")
            )
        ),
        "mode before": first["mode"],
        "mode changed after [s]": since(lambda row: row["mode"] != first["mode"]),
        "mode after": after[-1]["mode"],
        "largest bank [deg]": max(abs(degrees(row["roll_rad"])) for row in flown),
        "largest way from there [m]": max(
            hypot(row["x_m"] - first["x_m"], row["y_m"] - first["y_m"], row["z_m"] - first["z_m"])
            for row in flown
        ),
        "flown on for [s]": flown[-1]["time_s"] - killed_s,
        "watched for [s]": after[-1]["time_s"] - killed_s,
    }


class Drift(NamedTuple):
    """The last `MINUTE_S` of flights, by the truth [m]."""

    along: list[float]  # off the mean of each, or off the point
    across: list[float]  # e_rho
    brake: list[float]


def drift(folders: list[Path], point_m: float | None) -> Drift:
    """Of the last line of each."""
    found = Drift([], [], [])
    for folder in folders:
        summary = json.loads((folder / "summary.json").read_text())["legs"][-1]
        x0, z0, eta = summary["line"]
        ended_s = summary["stood_s"][1]
        with (folder / "truth.csv").open(newline="") as file:
            rows = [{n: float(v) for n, v in row.items()} for row in csv.DictReader(file)]
        kept = [row for row in rows if ended_s - MINUTE_S <= row["time_s"] <= ended_s]
        if not all(row["overridden"] for row in kept):
            raise SystemExit(f"{folder}: the module has not flown the last {MINUTE_S:g} s of it")
        ways = [
            (cos(eta) * (row["x_m"] - x0) + sin(eta) * (row["z_m"] - z0),
             cos(eta) * (row["z_m"] - z0) - sin(eta) * (row["x_m"] - x0))
            for row in kept
        ]  # fmt: skip
        middle = mean(way for way, _ in ways) if point_m is None else point_m
        found.along.extend(way - middle for way, _ in ways)
        found.across.extend(e for _, e in ways)
        found.brake.extend(row["brake"] for row in kept)
    return found


def along(found: Drift) -> dict[str, float | str]:
    """In numbers."""
    at_an_end = sum(not END <= b <= 1.0 - END for b in found.brake) / len(found.brake)
    return {
        "along, rms [cm]": 1e2 * sqrt(mean(way**2 for way in found.along)),
        "along, at most [cm]": 1e2 * max(abs(way) for way in found.along),
        "e_rho, rms [cm]": 1e2 * sqrt(mean(e**2 for e in found.across)),
        "brake, mean": mean(found.brake),
        "at an end of it [%]": 1e2 * at_an_end,
    }


class Shake(NamedTuple):
    """One shake of a brake, or several together: the sums of `control.brake_shake`."""

    blocks: float
    y: complex
    b: complex
    y_2: float  # Σ |Y|²
    b_2: float  # Σ |B|²
    yb: complex  # Σ Y B*

    def words(self) -> str:
        """Gain and lag, with what is not certain of them."""
        r = self.y / self.b
        left = self.y_2 - 2.0 * (r.conjugate() * self.yb).real + abs(r) ** 2 * self.b_2
        sigma = sqrt(max(0.0, left) / (2.0 * abs(self.b) ** 2))
        lag = atan2(-r.imag, r.real)
        return (
            f"{self.blocks:4.0f} s, gain {abs(r):.2f} ± {sigma:.2f}, lag {lag:.2f} rad"
            f" ± {sigma / abs(r):.2f}"
        )


def shakes(folder: Path) -> tuple[list[Shake], list[str]]:
    """Those of a flight, and what the module has said of its point."""
    (path,) = folder.glob("logs/*/*.ulg")
    log = read_log(path)
    rows = log.topics["state"]

    def column(name: str) -> Any:
        return rows[f"brake_shake_{name}"]

    def pair(name: str, i: int) -> complex:
        return complex(column(f"{name}_re")[i], column(f"{name}_im")[i])

    blocks = [*column("blocks"), 0.0]
    found = [
        Shake(
            blocks=blocks[i],
            y=pair("y", i),
            b=pair("b", i),
            y_2=column("y_2")[i],
            b_2=column("b_2")[i],
            yb=pair("yb", i),
        )
        for i in range(len(blocks) - 1)
        if blocks[i] > blocks[i + 1]
    ]
    return found, [f"{words.time_s:.1f} s: {words.text}" for words in log.words
                   if words.text.startswith("point: ")]  # fmt: skip


def together(found: list[Shake]) -> Shake:
    """As one."""
    blocks, y, b, y_2, b_2, yb = (sum(column) for column in zip(*found, strict=True))
    return Shake(blocks=blocks, y=y, b=b, y_2=y_2, b_2=b_2, yb=yb)


def tell_shakes(folders: list[Path]) -> None:
    """Of all flights, and of all together."""
    every: list[Shake] = []
    for folder in folders:
        found, words = shakes(folder)
        every += found
        print(f"{folder}: {'; '.join(words)}")
        for shake in found:
            print(f"    {shake.words()}")
    if every:
        print(f"together: {together(every).words()}")


def clouds(path: Path, panels: dict[str, Drift]) -> None:
    """Positions of flights beside those of others, along and across the line."""
    with drawing() as plt:
        figure, axes = plt.subplots(
            1, len(panels), figsize=(5.0, 5.5), sharex=True, sharey=True, layout="constrained"
        )
        for axis, (title, found) in zip(axes, panels.items(), strict=True):
            ways, across = ([1e2 * v for v in values] for values in found[:2])
            axis.plot(across, ways, ".", markersize=1.0, alpha=0.3)
            axis.set_title(f"{title}: {along(found)['along, rms [cm]']:.1f} cm rms along")
            axis.set_xlabel("e_rho [cm]")
            axis.set_aspect("equal")
        axes[0].set_ylabel("along the line [cm]")
        save(plt, figure, path)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    what = parser.add_subparsers(dest="what", required=True)
    one = what.add_parser("latency", help="sensor to companion, command to servo")
    one.add_argument("autopilot", choices=("ardupilot", "px4", "bridge"))
    one.add_argument("route", nargs="?", help="the usual one where not given")
    one.add_argument("--firmware", type=Path, metavar="PATH", help="its program")
    other = what.add_parser("silence", help="after the module was killed")
    other.add_argument("folder", type=Path, help="of tgl-soar sitl --kill-module")
    last = what.add_parser("along", help="drift along the line")
    last.add_argument("folders", type=Path, nargs="+", help="of tgl-soar sitl")
    last.add_argument("--point", type=float, metavar="M", help="TGL_ALONG that was held")
    last.add_argument("--beside", type=Path, action="append", help="flights on the line alone")
    last.add_argument("--picture", type=Path, help="of both: positions along and across")
    shaken = what.add_parser("shakes", help="what shakes of the brake found")
    shaken.add_argument("folders", type=Path, nargs="+", help="of tgl-soar sitl")
    arguments = parser.parse_args()
    if arguments.what == "shakes":
        tell_shakes(arguments.folders)
        return 0
    if arguments.what != "latency":
        flown = (
            silence(arguments.folder)
            if arguments.what == "silence"
            else along(drift(arguments.folders, arguments.point))
        )
        if arguments.what == "along" and arguments.picture is not None:
            beside = drift(arguments.beside, None)
            held = drift(arguments.folders, arguments.point)
            clouds(arguments.picture, {"the line alone": beside, "a point held": held})
        for name, value in flown.items():
            print(f"{name:28} {value:.2f}" if isinstance(value, float) else f"{name:28} {value}")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        found = latency(
            arguments.autopilot, arguments.route, arguments.firmware, Path(folder) / "firmware"
        )
    for name, values in (("sensor to companion", found.ages_s), ("to servo", found.to_servo_s)):
        if values:
            print(
                f"{name:20} median {1e3 * median(values):.1f} ms, mean {1e3 * mean(values):.1f},"
                f" largest {1e3 * max(values):.1f}, {len(values)} of them"
            )
    print(f"not followed {found.lost} times")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The paper's flight between real processes over real sockets: `tgl-soar sitl`.

Three take part, each with its own socket on the loopback interface:

    bridge     a process: the Pixhawk and the world         tools/sitl_bridge.py
    module     a process: what flies                        tgl-soar run
    operator   this process: a ground station that engages and moves the line a → b → c

In lockstep (the default) the bridge waits for both others at every step, so that the flight
runs as fast as the machine allows and the same seed gives the same flight.  In real time it
waits for nobody, and other ground stations may take part at 127.0.0.1:14550; where a busy machine
has interrupted the flight the operator engages anew, a few times, and says so.
"""

from __future__ import annotations

import csv
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import inf, isfinite, radians
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.zeuc import Crossing, stable_crossing
from tgl_soar.config.files import line_parameters, load_airframe, load_parameters, load_site
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Position, Site
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.sim.bridge.slowness import TOO_SLOW
from tgl_soar.sim.child_process import with_parent
from tgl_soar.sim.firmware.sensors import SOMEWHERE
from tgl_soar.sim.operator import Flown, Leg, Operator, OperatorError
from tgl_soar.sim.score import LegScore, score_leg
from tgl_soar.sim.world import build_field

Floats = NDArray[np.float64]
LOGS_MB = 500.0  # of all flights in a folder
START_S = 120.0  # for the first datagram: on a busy machine air and module take their time
SILENCE_S = 20.0  # without a datagram for so long the bridge is taken for dead
AGAIN = 3  # engagements anew in real time
OVERRIDE_TIME_S = 0.5  # as docs and README ask of a real autopilot: 3 s would lose the aircraft


class SitlError(RuntimeError):
    """The flight could not be flown; the message says why and what to do."""


@dataclass(frozen=True)
class SitlOptions:
    """What to fly."""

    airframe: Path
    site: Path
    out: Path
    legs: tuple[str, ...] = ()  # names of the site's lines; none: all, in order
    stay_s: float = 16.0
    seed: int = 1
    turbulence: float | None = None  # fraction of the reference wind; None: the site's
    realtime: bool = False
    faults: tuple[str, ...] = ()  # as they are written (`sim.faults`)
    mocap: bool = False  # the position comes as NatNet, from a stand-in for Motive
    mocap_options: tuple[str, ...] = ()  # more of the bridge's, such as --mocap-version=4.2
    autopilot: str = "builtin"  # or a real firmware, by the bridge's name for it
    firmware: Path | None = None  # its program
    route: str | None = None  # by which the module commands it; None: the firmware's usual one
    autopilot_parameters: tuple[str, ...] = ()  # NAME=NUMBER
    kill_s: float | None = None  # the module is killed so long after its line first stood
    # Real time alone is open to others, on the ports that the firmwares' simulators have.
    gcs: str = "127.0.0.1:14550"
    gcs_local: str = "127.0.0.1:18570"  # the bridge's own port towards it
    companion: str = "127.0.0.1:14540"


@dataclass(frozen=True)
class Flight:
    """What was flown, and how well."""

    flown: list[Flown]
    scores: list[LegScore]
    crossings: list[Crossing | None]
    lines: list[tuple[float, float, float]]
    truth: dict[str, Floats]  # columns of the bridge's log
    wall_s: float
    killed_s: float | None = None  # when the module was killed, on the autopilot's clock
    notes: tuple[str, ...] = ()  # how the machine has interrupted it


def plan(site: Site, values: ParameterSet, options: SitlOptions) -> list[Leg]:
    """The legs by name, from the site's lines.  Errors: `SitlError`."""
    names = options.legs or tuple(site.lines)
    if not names:
        raise SitlError(f"{options.site}: no [lines.NAME] tables, so there is nowhere to fly")
    unknown = [name for name in names if name not in site.lines]
    if unknown:
        raise SitlError(
            f"{options.site}: no line named {unknown[0]!r}; it has {', '.join(site.lines)}"
        )
    return [
        Leg(
            name,
            {"TGL_LEAN": values["TGL_LEAN"], **line_parameters(site.lines[name])},
            options.stay_s,
        )
        for name in names
    ]


def fly(options: SitlOptions, progress: Callable[[Operator], None]) -> Flight:
    """Fly the plan; `progress` is called a few times a second.

    Errors: `SitlError`, `tgl_soar.config.files.ConfigError`.
    """
    airframe = load_airframe(options.airframe)
    site = load_site(options.site)
    values = load_parameters(airframe, options.airframe, site, options.site)
    if site.air is None:
        raise SitlError(f"{options.site}: no [air] table, so there is no wind to fly in")
    legs = plan(site, values, options)
    if options.mocap and site.mocap is None:
        raise SitlError(f"{options.site}: no [mocap] table, as sites/tunnel_mocap.toml has it")
    truth_file = options.out / "truth.csv"
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        truth_file.unlink(missing_ok=True)
    except OSError as error:
        raise SitlError(
            f"--out {options.out}: cannot be written: {error.strerror}; name another folder"
        ) from None

    if options.autopilot != "builtin":
        options = replace(options, airframe=_airframe_for(options), site=_site_for(options, site))
    begun = time.monotonic()
    ground_station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ground_station.bind(("127.0.0.1", 0))
    own_address = f"127.0.0.1:{ground_station.getsockname()[1]}"
    operator = Operator(
        legs,
        airframe.autopilot.system_id,
        airframe.autopilot.component_id,
        when_armed=options.autopilot != "builtin",
        again=AGAIN if options.realtime and not options.faults and options.kill_s is None else 0,
    )
    processes = _Processes(options.out)
    try:
        companion = options.companion if options.realtime else _free_address()
        mocap = _free_address() if options.mocap else ""
        bridge_command = _bridge_command(options, truth_file, own_address, companion, mocap)
        processes.start("bridge", bridge_command)
        processes.start("module", _module_command(options, companion, mocap))
        killed_s = _operate(operator, ground_station, processes, progress, options.kill_s)
    except OperatorError as error:
        hint = busy_hint(os.getloadavg()[0], os.cpu_count() or 1) if options.realtime else ""
        raise SitlError(f"{error}{hint}\n{processes.last_words()}") from None
    finally:
        processes.stop()
        ground_station.close()
    truth = _read_truth(truth_file)
    field = build_field(site.air, options.site.parent)
    lines = [
        (
            leg.parameters["TGL_X"],
            leg.parameters["TGL_Z"],
            eta_from_lean(radians(leg.parameters["TGL_LEAN"])),
        )
        for leg in legs
    ]
    polar = airframe.polar.as_polar()
    met = [stable_crossing(field, polar, line) for line in lines]
    scores = []
    for flown, line, crossing in zip(operator.flown, lines, met, strict=True):
        rows = (truth["time_s"] >= flown.stopped_s) & (truth["time_s"] <= flown.ended_s)
        scores.append(
            score_leg(
                flown.leg.name,
                line,
                _place(crossing),
                truth["time_s"][rows],
                truth["x_m"][rows],
                truth["z_m"][rows],
            )
        )
    wall_s = time.monotonic() - begun
    notes = [f"engaged anew after a hiccup of this machine: {w}" for w in operator.hiccups]
    notes += processes.said("bridge", TOO_SLOW)
    flight = Flight(operator.flown, scores, met, lines, truth, wall_s, killed_s, tuple(notes))
    _write_summary(options, flight)
    return flight


def passed(flight: Flight) -> bool:
    """Whether every leg settled that nobody else has moved."""
    return all(
        score.settled or flown.by_hand
        for score, flown in zip(flight.scores, flight.flown, strict=True)
    )


def busy_hint(load: float, processors: int) -> str:
    """What a flight by the clock that failed may have failed of."""
    busy = f", whose load is {load:.1f} on {processors} processors," if load > processors else ""
    return (
        f"\n  this machine{busy} may be too busy for real time: close other programs, or fly in"
        " lockstep, without --realtime"
    )


def _free_address() -> str:
    """A UDP port on the loopback interface that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def _airframe_for(options: SitlOptions) -> Path:
    """The airframe file as it is flown with a real firmware, in the folder of the flight."""
    text = options.airframe.read_text()
    lines = [f'firmware = "{options.autopilot}"']
    if options.route is not None:
        lines.append(f'route = "{options.route}"')
    changed, count = re.subn(r"(?m)^firmware *=.*$", "\n".join(lines), text)
    if count != 1:
        raise SitlError(f"{options.airframe}: no line firmware = … in [autopilot] to replace")
    path = options.out / options.airframe.name
    path.write_text(changed)
    return path


def _site_for(options: SitlOptions, site: Site) -> Path:
    """The site file as it is flown with a real firmware, in the folder of the flight.

    Where a tracker measures the position it tells it to the firmware as well.  Where satellites
    do, the site needs a place on earth: a firmware's local NED begins wherever it was started.
    """
    if site.mocap is not None and site.forward is None:
        added = "[forward]\n"
    elif site.mocap is None and site.position == Position():
        place = f"{{ latitude_deg = {SOMEWHERE.latitude_deg}, longitude_deg ="
        place += f" {SOMEWHERE.longitude_deg}, altitude_m = {SOMEWHERE.altitude_m} }}"
        added = f'[position]\nsources = ["global_position"]\nhome = {place}\n'
    else:
        return options.site
    path = options.out / options.site.name
    path.write_text(f"{options.site.read_text()}\n{added}")
    return path


def _bridge_command(
    options: SitlOptions, truth_file: Path, operator: str, companion: str, mocap: str
) -> list[str]:
    command = [
        *(sys.executable, "-m", "tgl_soar.sim.bridge"),
        *("--airframe", str(options.airframe), "--site", str(options.site)),
        *("--companion", companion, "--gcs", operator),
        *("--seed", str(options.seed), "--log", str(truth_file)),
        *("--speed", "realtime" if options.realtime else "lockstep"),
    ]
    if options.autopilot == "builtin":
        command += ["--autopilot-parameter", f"RC_OVERRIDE_TIME={OVERRIDE_TIME_S:g}"]
    else:
        command += ["--autopilot", options.autopilot, "--firmware", str(options.firmware)]
        command += ["--firmware-folder", str(options.out / "firmware")]
        command += ["--record", str(options.out / "companion.tlog")]
    for setting in options.autopilot_parameters:
        command += ["--autopilot-parameter", setting]
    for fault in options.faults:
        command += ["--fault", fault]
    if options.turbulence is not None:
        command += ["--turbulence", str(options.turbulence)]
    if mocap:
        command += ["--mocap", "natnet", "--mocap-local", mocap, *options.mocap_options]
    if options.realtime:
        command += ["--gcs", options.gcs, "--gcs-local", options.gcs_local]
        command += ["--companion-local", "127.0.0.1:0"]
    else:
        anywhere = "127.0.0.1:0"
        command += ["--lockstep-gcs", "--gcs-local", anywhere, "--companion-local", anywhere]
    return command


def _module_command(options: SitlOptions, companion: str, mocap: str) -> list[str]:
    command = [
        *(sys.executable, "-m", "tgl_soar.cli", "run"),
        *("--airframe", str(options.airframe), "--site", str(options.site)),
        *("--link", f"udp:{companion}", "--state", "none"),
        *("--log", str(options.out / "logs"), "--log-max", f"{LOGS_MB:g}"),
    ]
    if mocap:
        command += ["--mocap-server", mocap]
    return command if options.realtime else [*command, "--lockstep"]


def _operate(
    operator: Operator,
    ground_station: socket.socket,
    processes: _Processes,
    progress: Callable[[Operator], None],
    kill_s: float | None,
) -> float | None:
    """Carry datagrams between the operator and the bridge until the plan is flown; when the
    module was killed."""
    bridge: tuple[str, int] | None = None
    killed_s: float | None = None
    heard = shown = time.monotonic()
    while not operator.done:
        ready, _, _ = select.select([ground_station], [], [], 0.2)
        now = time.monotonic()
        if ready:
            data, sender = ground_station.recvfrom(65535)
            if bridge in (None, sender) and operator.receive(data):
                bridge, heard = sender, now
        patience_s = START_S if bridge is None else SILENCE_S
        if now - heard > patience_s:
            hint = busy_hint(os.getloadavg()[0], os.cpu_count() or 1)
            raise SitlError(
                f"nothing heard from the bridge for {patience_s:g} s{hint}\n"
                f"{processes.last_words()}"
            )
        processes.check()
        stood_s = operator.flown[0].stopped_s if operator.flown else inf
        if kill_s is not None and killed_s is None and operator.seen.time_s - stood_s >= kill_s:
            processes.kill("module")
            killed_s = operator.seen.time_s
        # Once there is simulated time the operator acts on what comes and at no other moment, so
        # that a lockstep flight repeats exactly.
        simulated = operator.seen.time_s
        if ready or not isfinite(simulated):
            for datagram in operator.step(simulated if isfinite(simulated) else now):
                if bridge is not None:
                    ground_station.sendto(datagram, bridge)
        if now - shown > 0.1:
            shown = now
            progress(operator)
    progress(operator)
    return killed_s


class _Processes:
    """The processes of a flight, each with its output in a file of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, command: list[str]) -> None:
        with self._log(name).open("wb") as log:
            self._running[name] = subprocess.Popen(
                with_parent(command),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def check(self) -> None:
        """Errors: `SitlError` with its last words if one has ended."""
        for name, process in self._running.items():
            code = process.poll()
            if code is not None:
                raise SitlError(f"the {name} ended with exit code {code}\n{self.last_words()}")

    def kill(self, name: str) -> None:
        """By SIGKILL, and expect it no more."""
        process = self._running.pop(name)
        process.kill()
        process.wait()

    def last_words(self) -> str:
        """The last lines that each has printed."""
        words = []
        for name in self._running:
            lines = self._log(name).read_text(errors="replace").splitlines()[-6:]
            words += [f"  {name}: {line}" for line in lines]
        return "\n".join(words)

    def said(self, name: str, words: str) -> list[str]:
        """The lines of one that hold these words."""
        lines = self._log(name).read_text(errors="replace").splitlines()
        return [line for line in lines if words in line]

    def stop(self) -> None:
        """Ask all to end, the module first; kill what does not."""
        for process in reversed(self._running.values()):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(5.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"


def _read_truth(path: Path) -> dict[str, Floats]:
    """The columns of the bridge's log."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    if len(rows) < 3:
        raise SitlError(f"{path}: the bridge logged no flight")
    table = np.array([[float(value) for value in row] for row in rows[1:]])
    return {name: table[:, i] for i, name in enumerate(rows[0])}


def _place(crossing: Crossing | None) -> tuple[float, float] | None:
    return None if crossing is None else (crossing.x_m, crossing.z_m)


def _write_summary(options: SitlOptions, flight: Flight) -> None:
    summary = {
        "seed": options.seed,
        "turbulence": options.turbulence,
        "site": options.site.name,
        "airframe": options.airframe.name,
        "passed": passed(flight),
        "killed_s": flight.killed_s,
        "legs": [
            {**asdict(score), "predicted": _place(crossing), "by_hand": flown.by_hand}
            for score, crossing, flown in zip(
                flight.scores, flight.crossings, flight.flown, strict=True
            )
        ],
    }
    (options.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")

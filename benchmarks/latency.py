"""From a sample to the surfaces: the whole module beside the least that answers.

A vehicle in C (`c/vehicle.c`) sends accelerations and an attitude 200 times a second, and now
and then a position and its servos, to three programs in turn: to the module as it flies (guard,
log, stored parameters, telemetry, engaged), to a minimal responder in C, and to one of a few
lines with pymavlink's `mavutil`.  Each has a third of every period for itself; all three meet
the same weather.  Timed is from before the datagram is sent to when the surfaces are there.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from tgl_soar.config.files import shipped

from . import c_reference
from .c_reference import PRIORITY, NoCompilerError
from .processes import child_of, cpu_s, end, is_native
from .result import ALLOWED, INTERPRETED, NO_AIM, Result, percentile

SECONDS = 25
ENGAGE_AFTER_S = 3
SETTLED_S = 8  # from then on it counts
RATE_HZ = 200
VEHICLE_PRIORITY = PRIORITY + 10
AGE_ALLOWED_MS = 1.0
CPU_ALLOWED = 8.0  # % of one core
PART_NS = 1_000_000_000 // RATE_HZ // 3  # of the period; an answer that misses it counts as this
IN_C = "a minimal responder in C"
IN_MAVUTIL = "a minimal responder with mavutil"
SHARES = (("p50", 0.5, 2.3), ("p99", 0.99, 2.5), ("p99.9", 0.999, 2.5))


class Measured(NamedTuple):
    """Nanoseconds of every answer, and what the flying process took of one core."""

    module_ns: list[int]
    c_ns: list[int]
    mavutil_ns: list[int]
    cpu_percent: float


def sensor_to_surface(seconds: int = SECONDS) -> Iterator[Result]:
    """Over UDP, and over a pseudo-terminal as over a serial line."""
    for kind, name in (("udp", "UDP"), ("pty", "pseudo-terminal")):
        try:
            measured = measure(kind, seconds)
        except NoCompilerError as error:
            print(error)
            return
        for share_name, share, aim in SHARES:
            yield _delay(name, measured.module_ns, measured.c_ns, IN_C, share_name, share, aim)
        yield _delay(name, measured.module_ns, measured.mavutil_ns, IN_MAVUTIL)
        yield Result(
            what=f"answers that miss their third of the period, {name}",
            value=sum(ns >= PART_NS for ns in measured.module_ns),
            reference=sum(ns >= PART_NS for ns in measured.c_ns),
            unit=f"of {len(measured.c_ns)}",
            reference_what=IN_C,
        )
        yield Result(
            what=f"age of the sample at the surface, {name}, p50",
            value=percentile(measured.module_ns, 0.5) / 1e6,
            reference=AGE_ALLOWED_MS,
            unit="ms",
            reference_what=ALLOWED,
            aim=1.0,
        )
        yield _processor(name, measured, CPU_ALLOWED, ALLOWED, 1.0)
        if is_native() and kind == "udp":
            power_saving = measure(kind, seconds, "--power-saving")
            yield _delay(f"{name}, --power-saving", power_saving.module_ns, power_saving.c_ns, IN_C)
            yield _processor(f"{name}, --power-saving", power_saving, CPU_ALLOWED, ALLOWED, 1.0)
            source = measure(kind, seconds, "--interpreted")
            yield _delay(name, measured.module_ns, source.module_ns, INTERPRETED)
            yield _processor(name, measured, source.cpu_percent, INTERPRETED)


def _delay(
    name: str,
    ours_ns: list[int],
    theirs_ns: list[int],
    whose: str,
    share_name: str = "p50",
    share: float = 0.5,
    aim: float = NO_AIM,
) -> Result:
    """From a sample to the surfaces, beside somebody else."""
    return Result(
        what=f"sensor to surface, {name}, {share_name}",
        value=percentile(ours_ns, share) / 1e3,
        reference=percentile(theirs_ns, share) / 1e3,
        unit="µs",
        reference_what=whose,
        aim=aim,
    )


def _processor(
    name: str, measured: Measured, beside: float, whose: str, aim: float = NO_AIM
) -> Result:
    """What the flying process takes of a core."""
    return Result(
        what=f"the flying process, {name}",
        value=measured.cpu_percent,
        reference=beside,
        unit="% of a core",
        reference_what=whose,
        aim=aim,
    )


BENCHMARKS = (sensor_to_surface,)


def measure(kind: str, seconds: int, *options: str) -> Measured:
    """Fly the three against one vehicle.  `options`: more of the module's."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="tgl_soar_bench_")))
        if kind == "udp":
            ends = [f"udp:{_free_port()}" for _ in range(3)]
        else:
            ends = [f"pty:{folder / f'line{i}'}" for i in range(3)]
        vehicle = subprocess.Popen(
            [
                *(c_reference.program("vehicle"), str(seconds), str(ENGAGE_AFTER_S)),
                *(str(VEHICLE_PRIORITY), *ends),
            ],
            stdout=subprocess.PIPE,
        )
        stack.callback(end, vehicle, signal.SIGKILL)
        assert vehicle.stdout is not None
        if vehicle.stdout.readline() != b"ready\n":
            raise RuntimeError("the vehicle of the benchmark does not start")
        commands = _commands(kind, ends, folder)
        commands[0] += options
        running = [subprocess.Popen(c, stderr=subprocess.DEVNULL) for c in commands]
        for process in running:
            stack.callback(end, process, signal.SIGTERM)
        time.sleep(SETTLED_S)
        child = child_of(running[0].pid)
        before_s, began_s = cpu_s(child), time.monotonic()
        time.sleep(seconds - SETTLED_S - 1)
        cpu_percent = 100.0 * (cpu_s(child) - before_s) / (time.monotonic() - began_s)
        took = array("q", vehicle.communicate()[0])
    took = took[3 * RATE_HZ * SETTLED_S :]
    of_each = [[ns if ns > 0 else PART_NS for ns in took[i::3]] for i in range(3)]
    if percentile(of_each[0], 0.5) == PART_NS:
        raise RuntimeError("the module did not fly")
    return Measured(of_each[0], of_each[1], of_each[2], cpu_percent)


def _commands(kind: str, ends: list[str], folder: Path) -> list[list[str]]:
    """The module, the C responder, mavutil's."""
    names = [end.partition(":")[2] for end in ends]
    if kind == "pty":
        names = [Path(name).read_text() for name in names]
        links = f"serial:{names[0]}:921600", names[1], names[2]
    else:
        links = f"udpout:127.0.0.1:{names[0]}", ends[1], f"udpout:127.0.0.1:{names[2]}"
    module, in_c, mavutil = links
    return [
        [
            *(sys.executable, "-m", "tgl_soar.cli", "run", "--link", module),
            *("--airframe", str(shipped("airframes/eclipson_c.toml"))),
            *("--site", str(shipped("sites/tunnel.toml"))),
            *("--state", str(folder / "state")),
        ],
        [c_reference.program("responder"), in_c, str(PRIORITY)],
        [sys.executable, "-m", "benchmarks.mavutil_responder", mavutil, str(PRIORITY)],
    ]


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])

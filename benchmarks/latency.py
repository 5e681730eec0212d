"""From a sample to the surfaces: the whole module beside the least that answers.

A vehicle in C (`c/vehicle.c`) sends accelerations and an attitude 200 times a second, and now
and then a position and its servos, to several programs in turn: to the module as it flies (guard,
log, stored parameters, telemetry, engaged), to a minimal responder in C that sleeps until a sample
comes, to the same one that waits awake for 200 µs before and after it is expected, as the module
does, and to one of a few lines with pymavlink's `mavutil`.  Each has a part of every period for
itself; all meet the same weather.  Timed is from before the datagram is sent to when the vehicle
has the surfaces, its own wake-up included, however late they come.

Samples arrive regularly, and with jitter: up to 0.2 and 0.6 ms to either side, and on time or a
step of 2.5 ms late with equal chances, the most that the steps of ArduPlane's main loop at 400 Hz
can do to a stream of 200 Hz.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from tgl_soar.config.files import shipped

from . import c_reference
from .c_reference import PRIORITY, NoCompilerError
from .hanging import site_to_hang_in
from .lengths import length, may_be_reported
from .page import AWAKE
from .processes import child_of, cpu_s, end, is_native
from .result import ALLOWED, INTERPRETED, NO_AIM, Result, percentile

ENGAGE_AFTER_S = 3
SETTLED_S = 8  # from then on it counts
SECONDS = 150  # that count: 30,000 samples
BESIDE_S = 60  # of other options and arrivals
RATE_HZ = 200
VEHICLE_PRIORITY = PRIORITY + 10
AGE_ALLOWED_MS = 1.0
CPU_ALLOWED = 8.0  # % of one core
PERIOD_NS = 1_000_000_000 // RATE_HZ
AWAKE_NS = 200_000  # as long as the module may: `pacing.AWAKE_MAX_S`
ASLEEP = "a minimal responder in C that sleeps"
IN_MAVUTIL = "a minimal responder with mavutil"
FRACTIONS = (("p50", 0.5, 2.3), ("p99", 0.99, 2.5), ("p99.9", 0.999, 2.5))
# Late answers, as the slowest may be slower; of a core, as the usual answer may.
LATE_AIM, CORE_AIM = 2.5, 2.3
REGULAR = "0"
ARRIVALS = (  # of `c/vehicle.c`
    ("samples ± 0.2 ms", "200000"),
    ("samples ± 0.6 ms", "600000"),
    ("samples in steps of 2.5 ms as ArduPlane's", "loop:2500000"),
)


class Measured(NamedTuple):
    """Nanoseconds of every answer, and what processes took of one core."""

    module_ns: list[int]
    asleep_ns: list[int]
    awake_ns: list[int]
    mavutil_ns: list[int]
    cpu_percent: float  # the flying process
    awake_cpu_percent: float


def sensor_to_surface() -> Iterator[Result]:
    """Over UDP, and over a pseudo-terminal as over a serial line."""
    try:
        udp = measure("udp", length(SECONDS))
    except NoCompilerError as error:
        print(error)
        return
    yield from _beside_all("UDP", udp)
    if is_native():
        # Neither of the two waits awake: the like of it is C that sleeps.
        saving = measure("udp", length(BESIDE_S), "--power-saving")
        name = "UDP, --power-saving"
        yield from _beside(name, saving.module_ns, saving.asleep_ns, ASLEEP)
        yield _processor(name, saving, CPU_ALLOWED, ALLOWED, 1.0)
        source = measure("udp", length(BESIDE_S), "--interpreted")
        yield _delay("UDP", udp.module_ns, source.module_ns, INTERPRETED)
        yield _processor("UDP", udp, source.cpu_percent, INTERPRETED)
    for name, arrivals in ARRIVALS:
        jittered = measure("udp", length(BESIDE_S), arrivals=arrivals)
        yield from _beside(f"UDP, {name}", jittered.module_ns, jittered.awake_ns, AWAKE)
        yield from _beside(f"UDP, {name}", jittered.module_ns, jittered.asleep_ns, ASLEEP)
        yield _processor(f"UDP, {name}", jittered, CPU_ALLOWED, ALLOWED, 1.0)
    yield from _beside_all("pseudo-terminal", measure("pty", length(SECONDS)))


def _beside_all(name: str, measured: Measured) -> Iterator[Result]:
    """Regular samples: beside every other responder."""
    yield from _beside(name, measured.module_ns, measured.awake_ns, AWAKE)
    yield from _beside(name, measured.module_ns, measured.asleep_ns, ASLEEP)
    yield _delay(name, measured.module_ns, measured.mavutil_ns, IN_MAVUTIL)
    yield Result(
        what=f"answers later than a whole period, {name}",
        value=sum(ns > PERIOD_NS for ns in measured.module_ns),
        reference=sum(ns > PERIOD_NS for ns in measured.awake_ns),
        unit=f"of {len(measured.awake_ns)}",
        reference_what=AWAKE,
        aim=LATE_AIM,
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
    yield _processor(name, measured, measured.awake_cpu_percent, AWAKE, CORE_AIM)


def _beside(
    name: str, ours_ns: Sequence[int], theirs_ns: Sequence[int], whose: str
) -> Iterator[Result]:
    """Every percentile of which there are samples enough."""
    for fraction_name, fraction, aim in FRACTIONS:
        if may_be_reported(fraction, len(ours_ns)):
            yield _delay(name, ours_ns, theirs_ns, whose, fraction_name, fraction, aim)


def _delay(
    name: str,
    ours_ns: Sequence[int],
    theirs_ns: Sequence[int],
    whose: str,
    fraction_name: str = "p50",
    fraction: float = 0.5,
    aim: float = NO_AIM,
) -> Result:
    """From a sample to the surfaces, beside somebody else."""
    return Result(
        what=f"sensor to surface, {name}, {fraction_name}",
        value=percentile(ours_ns, fraction) / 1e3,
        reference=percentile(theirs_ns, fraction) / 1e3,
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


def measure(kind: str, seconds: int, *options: str, arrivals: str = REGULAR) -> Measured:
    """Fly all of them against one vehicle.  `options`: more of the module's.

    With jitter mavutil's is left out: with three of them the pieces of two periods never meet.
    """
    programs = 4 if arrivals == REGULAR else 3
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="tgl_soar_bench_")))
        if kind == "udp":
            ends = [f"udp:{_free_port()}" for _ in range(programs)]
        else:
            ends = [f"pty:{folder / f'line{i}'}" for i in range(programs)]
        vehicle = subprocess.Popen(
            [
                *(c_reference.program("vehicle"), str(SETTLED_S + seconds), str(ENGAGE_AFTER_S)),
                *(str(VEHICLE_PRIORITY), arrivals, *ends),
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
        watched, began_s = (child_of(running[0].pid), running[2].pid), time.monotonic()
        before_s = [cpu_s(pid) for pid in watched]
        time.sleep(seconds - 1)
        cpu_percent = [
            100.0 * (cpu_s(pid) - before) / (time.monotonic() - began_s)
            for pid, before in zip(watched, before_s, strict=True)
        ]
        took = array("q", vehicle.communicate()[0])
    of_each = _answers(took, programs)
    if percentile(of_each[0], 0.5) >= PERIOD_NS:
        raise RuntimeError("the module did not fly")
    return Measured(
        module_ns=of_each[0],
        asleep_ns=of_each[1],
        awake_ns=of_each[2],
        mavutil_ns=of_each[3] if programs > 3 else [],
        cpu_percent=cpu_percent[0],
        awake_cpu_percent=cpu_percent[1],
    )


def _answers(took: Sequence[int], programs: int) -> list[list[int]]:
    """ns of every settled answer of each; what was never answered counts as the whole run."""
    ticks = len(took) // programs
    never_ns = ticks * PERIOD_NS
    begin = RATE_HZ * SETTLED_S
    return [
        [ns if ns >= 0 else never_ns for ns in took[i * ticks + begin : (i + 1) * ticks]]
        for i in range(programs)
    ]


def _commands(kind: str, ends: list[str], folder: Path) -> list[list[str]]:
    """The module, the C responder asleep and awake, mavutil's if there is a fourth end."""
    names = [end.partition(":")[2] for end in ends]
    if kind == "pty":
        names = [Path(name).read_text() for name in names]
        module, *others = f"serial:{names[0]}:921600", *names[1:]
    else:
        module, *others = f"udpout:127.0.0.1:{names[0]}", *ends[1:3]
        others += [f"udpout:127.0.0.1:{name}" for name in names[3:]]
    responder = c_reference.program("responder")
    commands = [
        [
            *(sys.executable, "-m", "tgl_soar.cli", "run", "--link", module),
            *("--airframe", str(shipped("airframes/eclipson_c.toml"))),
            *("--site", str(site_to_hang_in(folder))),
            *("--state", str(folder / "state")),
        ],
        [responder, others[0], str(PRIORITY), "0"],
        [responder, others[1], str(PRIORITY), str(AWAKE_NS)],
    ]
    for mavutil in others[2:]:
        commands += [[sys.executable, "-m", "benchmarks.mavutil_responder", mavutil, str(PRIORITY)]]
    return commands


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])

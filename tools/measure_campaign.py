"""How fast campaigns fly, by whom, and what a million flights would take: docs/campaigns.md.

    python tools/measure_campaign.py --docs docs

The same flights (30 s of the whole closed loop, every sensor aboard, 2 % of turbulence) are flown
by this process, by local processes, by dask workers in one group of processes, and by dask workers
in two groups with an address each, as two machines would be.  Rounds go through all of them in
turn, so that what else the computer does meets each alike; its load stands beside each figure, and
so does what all processes together take of a processor, which depends less on that.
Then one campaign is flown into its folder, and the parent's memory is looked at.  Before all that
the first flight of a process is timed where nobody has compiled, and then where somebody has: of a
process of its own, and of a worker of dask.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import psutil

from tgl_soar.analysis.campaigns.drawn_faults import EVERY_SENSOR, SENSORS, place
from tgl_soar.analysis.experiments.pages import between
from tgl_soar.analysis.experiments.staleness_probes import stamped
from tgl_soar.sim.campaign.cluster import ClusterError, DaskCluster
from tgl_soar.sim.campaign.executors import Executor, local
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.folder import CampaignFolder
from tgl_soar.sim.campaign.journal import InMemory
from tgl_soar.sim.campaign.run import Progress, run
from tgl_soar.sim.compiled_flight import Prepared, fly_compiled, prepare
from tgl_soar.sim.world import make_world

DURATION_S: Final = 30.0
TURBULENCE: Final = 0.02
MILLION: Final = 1_000_000
CORES: Final = 16
HERE: Final = Path(__file__).resolve().parent
SCHEDULER: Final = "from distributed.cli.dask_scheduler import main; main()"
WORKER: Final = "from distributed.cli.dask_worker import main; main()"
FIRST: Final = "from measure_campaign import PlainJob, fly_plain; fly_plain(PlainJob(0))"
GROUPS: Final = {"dask, 1 worker": (1,), "dask, 2 workers": (2,), "dask, 2 machines": (1, 1)}
BEGIN: Final = "<!-- speed: begin; written by `python tools/measure_campaign.py --docs docs` -->"
END: Final = "<!-- speed: end -->"


class PlainJob(NamedTuple):
    """One flight without a fault."""

    seed: int


class PlainFlight(NamedTuple):
    """What became of it."""

    seed: int
    ended: str  # "": it flew to its end
    flown_s: float


@lru_cache(maxsize=1)
def _prepared() -> Prepared:
    airframe, site, _, field = place()
    world = make_world(
        airframe, site, turbulence=TURBULENCE, field=field, sensors=SENSORS[EVERY_SENSOR]
    )
    return prepare(world, DURATION_S)


def fly_plain(job: PlainJob) -> PlainFlight:
    """Fly one."""
    flown = fly_compiled(_prepared(), job.seed, place().values, ())
    return PlainFlight(job.seed, flown.ended, flown.ticks / 200.0)


class Timed(NamedTuple):
    """One executor in one round."""

    name: str
    workers: int
    flights: int
    seconds: float
    processor_s: float  # of all processes: who asks, schedulers and nannies too
    load: float  # of the computer, before

    @property
    def per_s(self) -> float:
        """Flights a second."""
        return self.flights / self.seconds

    @property
    def processor_ms(self) -> float:
        """Time of a processor for a flight [ms]."""
        return 1000.0 * self.processor_s / self.flights


class FirstFlights(NamedTuple):
    """How long a process takes to its first flight's end, what it imports included."""

    cold_s: float  # nobody has compiled this source
    warm_s: float  # somebody has
    worker_s: float  # a worker of dask, which flies for the first time


class Look(NamedTuple):
    """At a campaign while it is flown."""

    flown: int
    seconds: float
    resident_mib: float  # of the parent


def timed(name: str, executor: Executor, task: int, known: list[PlainFlight]) -> Timed:
    """One task for each worker, after a flight by each that loads what has been compiled.

    known: what others flew of the same seeds, which is extended.  Errors: ValueError where a
    flight is another one than theirs.
    """
    warm = [PlainJob(i) for i in range(2 * executor.workers)]
    run(fly_plain, warm, executor, InMemory(len(warm)), size=1)
    jobs = [PlainJob(i) for i in range(task * executor.workers)]
    load, taken_s, begun = os.getloadavg()[0], processor_s(), time.monotonic()
    kept = InMemory(len(jobs))
    run(fly_plain, jobs, executor, kept, size=task)
    seconds, processors_s = time.monotonic() - begun, processor_s() - taken_s
    flown = kept.results()
    for before, now in zip(known, flown, strict=False):
        if before != now:
            raise ValueError(f"{name} flies seed {now.seed} otherwise: {now}, not {before}")
    known += flown[len(known) :]
    return Timed(
        name=name,
        workers=executor.workers,
        flights=len(jobs),
        seconds=seconds,
        processor_s=processors_s,
        load=load,
    )


def processor_s() -> float:
    """Time of processors [s] that this process and all that it has started have taken so far."""
    here = psutil.Process()
    # User's and system's, and the same of those that have ended.
    return sum(sum(each.cpu_times()[:4]) for each in (here, *here.children(recursive=True)))


def first_flights(folder: Path) -> FirstFlights:
    """Of processes that share a folder of compiled kernels, which is empty at first."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": _path()}
    (folder / "cache").mkdir()
    taken: list[float] = []
    for _ in range(2):
        begun = time.monotonic()
        subprocess.run([sys.executable, "-c", FIRST], env=environment, cwd=folder, check=True)
        taken.append(time.monotonic() - begun)
    with cluster((1,), folder, environment) as worker:
        begun = time.monotonic()
        run(fly_plain, [PlainJob(0)], worker, InMemory(1), size=1)
        taken.append(time.monotonic() - begun)
    return FirstFlights(*taken)


def _path() -> str:
    """Where workers find this file."""
    return os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])


@contextmanager
def cluster(
    groups: Sequence[int], folder: Path, environment: Mapping[str, str] = os.environ
) -> Iterator[DaskCluster]:
    """A scheduler, and for each group a process group of so many workers at its own address."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    environment = {**environment, "PYTHONPATH": _path()}
    commands = [["-c", SCHEDULER, "--port", str(port), "--host", "127.0.0.1", "--no-dashboard"]]
    for n, workers in enumerate(groups):
        words = ["-c", WORKER, address, "--nthreads", "1", "--nworkers", str(workers)]
        words += ["--host", f"127.0.0.{n + 1}", "--no-dashboard"]
        commands.append([*words, "--local-directory", str(folder / f"machine{n}")])
    running = [
        subprocess.Popen(
            [sys.executable, *words],
            cwd=folder,
            env=environment,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        for words in commands
    ]
    try:
        yield _joined(address, sum(groups))
    finally:
        for process in reversed(running):
            os.killpg(process.pid, signal.SIGTERM)
        for process in running:
            process.wait(30.0)


def _joined(address: str, workers: int) -> DaskCluster:
    """As soon as so many workers are there."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        try:
            found = DaskCluster(address)
            if found.workers == workers:
                return found
        except ClusterError:
            pass
        time.sleep(0.5)
    raise SystemExit(f"{address}: {workers} workers did not come")


def rounds(count: int, task: int, folder: Path) -> list[Timed]:
    """All executors in turn, so many times."""
    found: list[Timed] = []
    known: list[PlainFlight] = []
    for _ in range(count):
        for name, workers in (("in line", 0), ("local, 1 worker", 1), ("local, 2 workers", 2)):
            found.append(timed(name, local(workers), task, known))
            print(found[-1], f"{found[-1].per_s:.1f}/s", flush=True)
        for name, groups in GROUPS.items():
            with cluster(groups, folder) as workers_of_dask:
                found.append(timed(name, workers_of_dask, task, known))
            print(found[-1], f"{found[-1].per_s:.1f}/s", flush=True)
    return found


def resident_mib() -> float:
    """Memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def long_campaign(out: Path, flights: int, workers: int, resume: bool) -> list[Look]:
    """One campaign in its folder; what the parent weighs meanwhile."""
    jobs = [PlainJob(i) for i in range(flights)]
    parameters = {"duration_s": DURATION_S, "turbulence": TURBULENCE}
    campaign = Campaign(
        name="plain", fly=fly_plain, jobs=jobs, parameters=parameters, seeds=(0, flights - 1)
    )
    looks: list[Look] = []
    begun = time.monotonic()

    def look(progress: Progress) -> None:
        looks.append(Look(progress.flown, time.monotonic() - begun, resident_mib()))

    with CampaignFolder(out, campaign, resume=resume, restart=not resume) as folder:
        folder.fly(local(workers), look, first_here=True)
        folder.finish()
    return looks


def medians(found: Sequence[Timed], of: str = "per_s") -> dict[str, float]:
    """Flights a second, or another property, of each executor."""
    names = dict.fromkeys(each.name for each in found)
    return {n: statistics.median(getattr(t, of) for t in found if t.name == n) for n in names}


def report(
    found: Sequence[Timed], looks: Sequence[Look], task: int, first: FirstFlights | None = None
) -> str:
    """For docs/campaigns.md."""
    rates, processor = medians(found), medians(found, "processor_ms")
    lines = [
        "| who flies | flights a second | × real time | beside as many local processes | of a"
        " processor, for a flight [ms] | beside as many local processes | load before |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, rate in rates.items():
        faster = dearer = ""
        if name.startswith("dask"):
            like = "local, 1 worker" if "1 worker" in name else "local, 2 workers"
            faster = f"{100.0 * (rate / rates[like] - 1.0):+.1f} %"
            dearer = f"{100.0 * (processor[name] / processor[like] - 1.0):+.1f} %"
        loads = [t.load for t in found if t.name == name]
        lines.append(
            f"| {name} | {rate:.1f} | {rate * DURATION_S:,.0f} | {faster}"
            f" | {processor[name]:.1f} | {dearer} | {min(loads):.1f} … {max(loads):.1f} |"
        )
    one, two = rates["local, 1 worker"], rates["local, 2 workers"]
    count = sum(t.name == "in line" for t in found)
    hours = MILLION / (CORES * 0.5 * two) / 3600.0
    lines += [
        "",
        f"Medians of {count} rounds, {task:,} flights a task and one task a worker. Two local"
        f" workers fly {two / one:.2f} times as fast as one. 10⁶ flights would take {hours:.2f} h"
        f" on {CORES} cores, each as fast as one of these two.",
    ]
    if looks:
        early, last = looks[min(len(looks) - 1, 1)], looks[-1]
        rate = last.flown / last.seconds
        lines += [
            "",
            f"Of one campaign {last.flown:,} flights were flown in {last.seconds:,.0f} s:"
            f" {rate:.1f} a second. The parent held {early.resident_mib:.1f} MiB after"
            f" {early.flown:,} of them and {last.resident_mib:.1f} MiB after the last.",
        ]
    if first:
        lines += [
            "",
            f"A process has flown its first flight after {first.cold_s:.0f} s where nobody has"
            f" compiled this source, and after {first.warm_s:.1f} s where somebody has; a new"
            f" worker of dask after {first.worker_s:.1f} s.",
        ]
    return "\n".join(lines) + "\n"


def draw(path: Path, found: Sequence[Timed], looks: Sequence[Look]) -> None:
    """Flights a second against workers, and the parent's memory."""
    from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

    rates = medians(found)
    curves = {
        "local processes": ("local, 1 worker", "local, 2 workers"),
        "dask, one group": ("dask, 1 worker", "dask, 2 workers"),
        "dask, two machines": ("dask, 1 worker", "dask, 2 machines"),
    }
    with drawing() as plt:
        figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
        for (label, names), colour in zip(curves.items(), PALETTE, strict=False):
            left.plot((1, 2), [rates[n] for n in names], "o-", color=colour, label=label)
        one = rates["local, 1 worker"]
        left.plot((1, 2), (one, 2.0 * one), "--", color="grey", lw=0.8, label="twice one")
        left.set_xticks((1, 2))
        left.set_xlabel("workers")
        left.set_ylabel("flights of 30 s a second")
        left.set_ylim(bottom=0.0)
        left.legend()
        right.plot([x.flown for x in looks], [x.resident_mib for x in looks], color=PALETTE[1])
        right.set_xlabel("flights kept")
        right.set_ylabel("memory of the parent [MiB]")
        right.set_ylim(0.0, 1.2 * max((x.resident_mib for x in looks), default=1.0))
        save(plt, figure, path)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--task", type=int, default=1000, help="flights a task")
    parser.add_argument("--flights", type=int, default=50_000, help="of the one campaign")
    parser.add_argument("--workers", type=int, default=2, help="of the one campaign")
    parser.add_argument(
        "--first",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="compile once more, to time it",
    )
    parser.add_argument("--resume", action="store_true", help="the one campaign")
    parser.add_argument("--out", type=Path, default=Path("out/speed"))
    parser.add_argument("--docs", type=Path, help="write campaigns.md's table and figure here")
    args = parser.parse_args(arguments)
    fly_plain(PlainJob(0))  # compiles
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "speed.json"
    with tempfile.TemporaryDirectory() as folder:
        first = first_flights(Path(folder)) if args.first else None
        found = rounds(args.rounds, args.task, Path(folder))
    looks = (
        long_campaign(args.out / "campaign", args.flights, args.workers, args.resume)
        if args.flights
        else []
    )
    content: dict[str, Any] = {
        "rounds": [t._asdict() for t in found],
        "looks": [look._asdict() for look in looks],
        "first": first._asdict() if first else None,
    }
    kept.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    written = report(found, looks, args.task, first)
    print(written)
    if args.docs is not None:
        page = args.docs / "campaigns.md"
        section = stamped(page.name, "speed", written)
        try:
            text = between(page.read_text(encoding="utf-8"), BEGIN, END, section)
        except ValueError as error:
            raise SystemExit(f"{page}: {error}") from None
        page.write_text(text, encoding="utf-8")
        draw(args.docs / "images" / "campaign-speed.png", found, looks)


if __name__ == "__main__":
    import measure_campaign  # by its name, so that workers find what flies

    measure_campaign.main()

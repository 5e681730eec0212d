"""A real scheduler and real workers on this machine, each killed while they fly."""

from __future__ import annotations

import os
import platform
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cheap_flights import cheap_campaign, cheap_jobs, fly_cheaply

from tgl_soar.analysis.tuning.progress_file import ProgressFile
from tgl_soar.analysis.tuning.tune import QUICK, Task, digest, tune
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.sim.campaign import cluster
from tgl_soar.sim.campaign.cluster import ClusterError, DaskCluster
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.sim.campaign.folder import ROWS, CampaignFolder
from tgl_soar.sim.campaign.provenance import libraries
from tgl_soar.sim.campaign.run import Progress, fly_all

distributed = pytest.importorskip("distributed")

HERE = Path(__file__).parent
SCHEDULER = "from distributed.cli.dask_scheduler import main; main()"
WORKER = "from distributed.cli.dask_worker import main; main()"


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


class Machines:
    """A scheduler and workers, each in a group of processes of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str) -> None:
        common = ["--host", "127.0.0.1", "--no-dashboard"]
        words = ["-c", SCHEDULER, "--port", str(self.port), *common]
        if name != "scheduler":
            words = ["-c", WORKER, self.address, "--nthreads", "1", "--no-nanny", *common]
            words += ["--local-directory", str(self.folder / name)]
        path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
        self.running[name] = subprocess.Popen(
            [sys.executable, *words],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": path},
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def kill(self, name: str) -> None:
        os.killpg(self.running[name].pid, signal.SIGKILL)
        self.running.pop(name).wait()


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    made = Machines(tmp_path)
    try:
        for name in ("scheduler", "one", "two"):
            made.start(name)
        yield made
    finally:
        for name in list(made.running):
            made.kill(name)


def joined(machines: Machines, workers: int) -> DaskCluster:
    """As soon as so many workers are there."""
    deadline = time.monotonic() + 60.0
    while True:
        try:
            found = DaskCluster(machines.address)
            if found.workers == workers:
                return found
        except ClusterError:
            pass
        assert time.monotonic() < deadline
        time.sleep(0.2)


def test_workers_and_scheduler_die_and_the_table_is_the_same(
    machines: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    executor = joined(machines, 2)
    assert executor.description == f"dask at {machines.address}, 2 workers"
    events = [(20, "worker"), (60, "scheduler")]

    def on_progress(progress: Progress) -> None:
        if events and progress.flown >= events[0][0]:
            _, what = events.pop(0)
            if what == "worker":
                machines.kill("one")
                machines.start("three")
            else:
                for name in list(machines.running):
                    machines.kill(name)
                for name in ("scheduler", "four", "five"):
                    machines.start(name)

    tables = []
    for name, flies in (("dask", executor), ("line", InLine())):
        campaign = cheap_campaign(120, nap_s=0.02)  # which is a column of the table
        with CampaignFolder(tmp_path / name, campaign) as folder:
            folder.fly(flies, on_progress, size=5)
            assert folder.finish()
        assert not events
        tables.append((tmp_path / name / ROWS).read_bytes())
    assert tables[0] == tables[1]

    jobs = cheap_jobs(4)
    with pytest.raises(ArithmeticError, match="seed 3"):
        fly_all(fly_cheaply, [jobs[3]._replace(raises=True)], executor)
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "source_digest", lambda: "another")
        with pytest.raises(ClusterError, match=r"a worker has another source .* than who asks"):
            fly_all(fly_cheaply, jobs[:2], executor)
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "libraries", lambda: {**libraries(), "numpy": "0.1"})
        with pytest.raises(ClusterError, match=r"a worker flies with numpy \S+ and not 0\.1"):
            fly_all(fly_cheaply, jobs[:2], executor)


def test_where_nobody_answers_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "ANSWER_S", 1.0)
    with pytest.raises(ClusterError, match="no scheduler answers"):
        DaskCluster(f"tcp://127.0.0.1:{free_port()}")


def test_gains_are_the_same_whoever_evaluates(machines: Machines, tmp_path: Path) -> None:
    """A worker on another computer finds the places of the search by itself."""
    pytest.importorskip("cma")
    airframe, site = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    plane, _, values = load_flight(airframe, site)
    task = Task(airframe=plane, site_path=site, values=values, lean_deg=15.0, effort=QUICK)
    found = [
        tune(task, ProgressFile(tmp_path / name, digest(task)), lambda *_: None, executor)
        for name, executor in (("line", InLine()), ("dask", joined(machines, 2)))
    ]
    assert found[0] == found[1]
    assert found[0].parameters
    assert ProgressFile(tmp_path / "dask", digest(task)).runs[-1]["by"].startswith("dask at")


FAULTS = """
import os, resource, sys
import numpy as np
from tgl_soar.sim.campaign.cluster import keep_memory

if sys.argv[1] == "kept" and not keep_memory():
    raise SystemExit("no mallopt")
np.ones(400_000)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.ones(400_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def page_faults(how: str) -> int:
    """Of twenty arrays of 3.2 MB, one after the other, in a process as dask's nanny starts it."""
    found = subprocess.run(
        [sys.executable, "-c", FAULTS, how],
        env={**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"},
        capture_output=True,
        text=True,
        check=True,
    )
    return int(found.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="mallopt is glibc's")
def test_a_worker_keeps_the_memory_of_a_flight_for_the_next() -> None:
    assert page_faults("as started") > 20 * 400  # asked of the system again each time
    assert page_faults("kept") < 400


def looked_at() -> tuple[bool, bool]:
    """In a worker: whether dask looks at its threads before and while flights are flown."""
    worker = distributed.get_worker()
    looks = worker.periodic_callbacks["profile"]
    before = looks.is_running()
    with cluster.not_profiled():
        deadline = time.monotonic() + 5.0
        while looks.is_running() and time.monotonic() < deadline:
            time.sleep(0.01)
        return before, looks.is_running()


def test_while_flights_are_flown_dask_looks_at_no_thread() -> None:
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as machine,
        distributed.Client(machine, set_as_default=False) as client,
    ):
        for _ in range(2):  # it is begun again after the first
            assert client.submit(looked_at, pure=False).result(30.0) == (True, False)
    with cluster.not_profiled():  # in no worker
        pass

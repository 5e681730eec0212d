"""What the operator's page costs a flight beside it: nothing that can be measured.

One flight of the simulated tunnel in real time, bridge and module as `tgl-soar sitl` starts them.
Three turns follow one another, `ROUNDS` times, so that whatever else the machine does meets all
alike: nobody watches, one page does, or ten do of which one takes nothing.  The server is started
before a turn and ended after it, and none of that is counted.

The flying process is asked for the processor time it took, and its log for the time between two
ticks.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.config.files import shipped
from tgl_soar.sim.child_process import with_parent
from tgl_soar.sim.sitl_options import SitlOptions
from tgl_soar.sim.sitl_processes import (
    SitlProcesses,
    bridge_command,
    free_address,
    module_command,
    page_command,
    prepared,
)

from .processes import child_of, cpu_s, end
from .result import ALLOWED, Result, percentile

ROUNDS: Final = 3
TURN_S: Final = 12.0
SETTLED_S: Final = 3.0  # after a server has begun to serve
PAGES: Final = 10
SERVER_ALLOWED: Final = 15.0  # % of a core
WITHOUT: Final = "nobody watches, the same flight"
PATIENCE_S: Final = 60.0
NOISE: Final = 1.1  # between two turns without a page, on a quiet machine
TURNS: Final = (0, 1, PAGES)  # pages


class Turns:
    """What was measured, by the number of pages."""

    def __init__(self) -> None:
        self.flying: dict[int, list[float]] = {count: [] for count in TURNS}  # % of a core
        self.server: dict[int, list[float]] = {count: [] for count in TURNS}
        self.frame_s: dict[int, list[float]] = {count: [] for count in TURNS}  # between two
        self.spans: dict[int, list[tuple[float, float]]] = {count: [] for count in TURNS}


@contextmanager
def served(options: SitlOptions, station: str) -> Iterator[tuple[int, str]]:
    """The page's server: its process, and the address of its socket with the token."""
    command = with_parent(page_command(options, station, 0))
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        words = ""
        while (found := re.search(r"http://(127\.0\.0\.1:\d+)/#token=([\w-]+)", words)) is None:
            line = process.stdout.readline()
            if not line:
                raise RuntimeError(f"the page does not begin: {words}")
            words += line.strip()
        yield process.pid, f"{found[1]} {found[2]}"
    finally:
        end(process, signal.SIGKILL)


def opened(address: str) -> Any:
    """A page without a browser, its hello sent."""
    from websockets.sync.client import connect

    place = address.split()[0]
    connection = connect(f"ws://{place}/live", ping_interval=None, close_timeout=0.0, max_queue=4)
    socket = connection.__enter__()
    ask(socket, address, "hello")
    return socket


def ask(socket: Any, address: str, what: str) -> None:
    """A request."""
    socket.send(json.dumps({"do": what, "token": address.split()[1]}))


def engage(address: str) -> None:
    """Engage, and wait until the aircraft soars.  Errors: TimeoutError."""
    with opened(address) as socket:
        now: dict[str, float] = {}
        asked_s, ends_s = 0.0, time.monotonic() + PATIENCE_S
        while now.get("soar_mode") != 4.0:
            frame = json.loads(socket.recv(timeout=ends_s - time.monotonic()))
            now.update(frame.get("now", {}))
            if now.get("soar_mode") == 2.0 and time.monotonic() > asked_s + 2.0:
                ask(socket, address, "engage")
                asked_s = time.monotonic()


def intervals_s(socket: Any, seconds: float) -> list[float]:
    """Between the frames that a page takes."""
    ends_s, found = time.monotonic() + seconds, []
    before_s = float("nan")
    while (left_s := ends_s - time.monotonic()) > 0.0:
        try:
            socket.recv(timeout=left_s)
        except TimeoutError:
            break
        now_s = time.monotonic()
        if before_s == before_s:
            found.append(now_s - before_s)
        before_s = now_s
    return found


def turn(count: int, options: SitlOptions, station: str, flying: int, turns: Turns) -> None:
    """Some seconds with so many pages; of ten one takes nothing."""
    with ExitStack() as stack:
        server, pages = 0, []
        if count:
            server, address = stack.enter_context(served(options, station))
            pages = [stack.enter_context(opened(address)) for _ in range(count)]
        time.sleep(SETTLED_S)
        readers = pages[1:] if count > 1 else pages
        began_s, used_s = time.monotonic(), cpu_s(flying)
        served_s = cpu_s(server) if server else 0.0
        if readers:
            with ThreadPoolExecutor(len(readers)) as pool:
                for found in pool.map(lambda page: intervals_s(page, TURN_S), readers):
                    turns.frame_s[count].append(max(percentile(found, 0.99), 0.0))
        else:
            time.sleep(TURN_S)
        passed_s = time.monotonic() - began_s
        turns.flying[count].append(100.0 * (cpu_s(flying) - used_s) / passed_s)
        if server:
            turns.server[count].append(100.0 * (cpu_s(server) - served_s) / passed_s)
        turns.spans[count].append((began_s, began_s + passed_s))


def fly(folder: Path) -> tuple[Turns, np.ndarray]:
    """All turns of one flight, and the times of its ticks."""
    options = SitlOptions(
        airframe=shipped("airframes/eclipson_c.toml"),
        site=shipped("sites/tunnel.toml"),
        out=folder,
        turbulence=0.01,
        realtime=True,
        gcs=free_address(),
        gcs_local="127.0.0.1:0",
        companion=free_address(),
    )
    truth, station = prepared(options), free_address()
    processes, turns = SitlProcesses(folder), Turns()
    try:
        processes.start("bridge", bridge_command(options, truth, station, options.companion, ""))
        processes.start("module", module_command(options, options.companion, ""))
        with served(options, station) as (_, address):
            engage(address)
        flying = child_of(processes.pid("module"))
        for _ in range(ROUNDS):
            for count in TURNS:
                turn(count, options, station, flying, turns)
                processes.check()
    finally:
        processes.stop()
    (log,) = (folder / "logs").rglob("*.ulg")
    ticks = read_log(log).topics["tick"]["timestamp"] * 1e-6
    return turns, np.asarray(ticks, dtype=float)


def tick_intervals_ms(ticks_s: np.ndarray, spans: list[tuple[float, float]]) -> list[float]:
    """Between two ticks, in some spans of the machine's clock."""
    found: list[float] = []
    for begin_s, end_s in spans:
        found += (1e3 * np.diff(ticks_s[(ticks_s > begin_s) & (ticks_s < end_s)])).tolist()
    return found


def beside_the_page() -> Iterator[Result]:
    """The flight with and without pages, and the pages themselves."""
    with TemporaryDirectory(prefix="tgl_soar_bench_") as folder:
        turns, ticks_s = fly(Path(folder))
    alone = tick_intervals_ms(ticks_s, turns.spans[0])
    for count, words in ((1, "one page"), (PAGES, "ten pages, one stalled")):
        yield Result(
            what=f"the flying process, {words}",
            value=percentile(turns.flying[count], 0.5),
            reference=percentile(turns.flying[0], 0.5),
            unit="% of a core",
            reference_what=WITHOUT,
            aim=NOISE,
        )
        yield Result(
            what=f"between two ticks, {words}, p99",
            value=percentile(tick_intervals_ms(ticks_s, turns.spans[count]), 0.99),
            reference=percentile(alone, 0.99),
            unit="ms",
            reference_what=WITHOUT,
            aim=NOISE,
        )
        yield Result(
            what=f"the page's server, {words}",
            value=percentile(turns.server[count], 0.5),
            reference=SERVER_ALLOWED,
            unit="% of a core",
            reference_what=ALLOWED,
            aim=1.0,
        )
    yield Result(
        what="between two frames, the slowest of nine beside a stalled page, p99",
        value=1e3 * max(turns.frame_s[PAGES]),
        reference=1e3 * max(turns.frame_s[1]),
        unit="ms",
        reference_what="one page alone",
        aim=NOISE,
    )


BENCHMARKS = (beside_the_page,)

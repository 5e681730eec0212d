"""`python -m benchmarks`: run the benchmarks, print one table, keep the results.

--json FILE      where the results are kept, with machine, versions and date
--page FILE      replace the table in a page, as docs/performance.md
--only NAME      some groups only (repeat it)
--long           also ten minutes of wake-ups beside two busy cores
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from . import (
    closed_loop,
    codec,
    hostile,
    latency,
    log,
    natnet,
    parameters,
    parts,
    release,
    report,
    start,
    tick,
    waking,
)
from .page import Group, replace_table, write_json
from .result import NO_AIM, Result

Benchmark = Callable[[], Iterator[Result]]


def _each(*benchmarks: Callable[[], Result]) -> Benchmark:
    return lambda: (benchmark() for benchmark in benchmarks)


def _all(*benchmarks: Benchmark) -> Benchmark:
    return lambda: (result for benchmark in benchmarks for result in benchmark())


GROUPS: dict[str, tuple[str, Benchmark]] = {
    "waking": ("On time", _all(*waking.BENCHMARKS)),
    "latency": ("From a sample to the surfaces", _all(*latency.BENCHMARKS)),
    "codec": ("A frame", _all(*codec.BENCHMARKS)),
    "parts": ("A tick, by part", _all(*parts.BENCHMARKS)),
    "tick": ("The laws", _each(*tick.BENCHMARKS)),
    "start": ("The flying process", _all(*start.BENCHMARKS)),
    "log": ("The flight log", _all(*log.BENCHMARKS)),
    "release": ("Letting go", _all(*release.BENCHMARKS)),
    "others": (
        "What else flies",
        _all(_each(*parameters.BENCHMARKS, *hostile.BENCHMARKS), *natnet.BENCHMARKS),
    ),
    "simulation": ("Simulation", _all(*closed_loop.BENCHMARKS)),
    "report": ("Reports", _all(*report.BENCHMARKS)),
}


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="benchmarks", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--json", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--page", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--only", action="append", choices=GROUPS, help=argparse.SUPPRESS)
    parser.add_argument("--long", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    chosen = {name: GROUPS[name] for name in options.only or GROUPS}
    if options.long:
        chosen["long"] = "Ten minutes on time", waking.long_run
    groups, failed = [], False
    for title, benchmark in chosen.values():
        begun = time.monotonic()
        results: list[Result] = []
        groups.append(Group(title, results))
        try:
            results.extend(benchmark())
        except Exception:  # the others are still worth their time
            traceback.print_exc()
            failed = True
        print(f"{title}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    _show(groups)
    if options.json:
        write_json(options.json, groups)
    if options.page:
        replace_table(options.page, groups)
    return int(failed)


def _show(groups: list[Group]) -> None:
    table = Table("what", "measured", "reference", "ratio", "aim")
    for group in groups:
        table.add_section()
        table.add_row(f"[bold]{group.title}")
        for result in group.results:
            style = "" if result.is_met else "bold"
            table.add_row(
                result.what,
                f"{result.value:.3g} {result.unit}",
                f"{result.reference:.3g} {result.unit}: {result.reference_what}",
                f"{result.ratio:.3g}",
                "" if result.aim == NO_AIM else f"{result.aim:.3g}",
                style=style,
            )
    Console().print(table)


if __name__ == "__main__":
    raise SystemExit(main())

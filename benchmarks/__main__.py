"""`python -m benchmarks [--json FILE]`: run every benchmark and print one table."""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from . import closed_loop, hostile, log, natnet, parameters, release, report, tick
from .result import Result


def _results() -> Iterator[Result]:
    for benchmark in (*tick.BENCHMARKS, *parameters.BENCHMARKS, *hostile.BENCHMARKS):
        yield benchmark()
    for benchmark_of_many in (
        *closed_loop.BENCHMARKS,
        *natnet.BENCHMARKS,
        *release.BENCHMARKS,
        *report.BENCHMARKS,
        *log.BENCHMARKS,
    ):
        yield from benchmark_of_many()


def main() -> int:
    parser = argparse.ArgumentParser(prog="benchmarks", description=__doc__)
    parser.add_argument("--json", type=Path, help="also write the results here")
    options = parser.parse_args()
    table = Table("what", "measured", "reference", "ratio")
    results = []
    for result in _results():
        results.append(result._asdict())
        table.add_row(
            result.what,
            f"{result.value:.3g} {result.unit}",
            f"{result.reference:.3g} {result.unit}: {result.reference_what}",
            f"{result.value / result.reference:.2f}",
        )
    Console().print(table)
    if options.json:
        machine = {"python": sys.version.split()[0], "machine": platform.machine()}
        options.json.write_text(json.dumps({"machine": machine, "results": results}, indent=2))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

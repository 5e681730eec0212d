"""`python -m benchmarks`: run the benchmarks, print one table, keep the results.

What flies is measured as native code, made first where it is not there yet; simulation, log and
report as the source stands.

--json FILE      where the results are kept, with machine, versions and date
--page FILE      replace the table in a page, as docs/performance.md
--readme FILE    with --page: replace the list of missed aims in the README
--only NAME      some groups only (repeat it)
--long           also ten minutes of wake-ups beside two busy cores
--interpreted    what flies as the source stands, too
--quick          a tenth of the time where seconds count, for a first look: nothing for a page
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tgl_soar.onboard import native

from .lengths import be_quick
from .page import Group, replace_missed, replace_table, write_json
from .processes import by_the_source
from .result import NO_AIM, Result
from .shown import shown

# Title, and the modules whose BENCHMARKS belong to it.
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "waking": ("On time", ("waking",)),
    "latency": ("From a sample to the surfaces", ("latency",)),
    "codec": ("A frame", ("codec",)),
    "parts": ("A tick, by part", ("parts",)),
    "tick": ("The laws", ("tick",)),
    "start": ("The flying process", ("start",)),
    "log": ("The flight log", ("log",)),
    "release": ("Disengaging", ("release",)),
    "others": ("What else flies", ("parameters", "hostile", "natnet")),
    "simulation": ("Simulation", ("closed_loop",)),
    "operators_page": ("The operator's page, beside a flight", ("operators_page",)),
    "search": ("The search for lift", ("search",)),
    "report": ("Reports", ("report",)),
}
INTERPRETED = ("log", "simulation", "search", "report")  # numba and replays take the source


def _results(modules: tuple[str, ...]) -> Iterator[Result]:
    for name in modules:
        for benchmark in import_module(f".{name}", __package__).BENCHMARKS:
            found = benchmark()
            yield from (found,) if isinstance(found, Result) else found


def _is_native() -> bool:
    """Whether native code flies from here on; it is made where it can be."""
    # In another process: here nothing of what flies may be loaded before.
    subprocess.run([sys.executable, "-m", "tgl_soar.cli", "compile"], stdout=sys.stderr)
    is_native = native.use()
    print(f"what flies: {native.words()}", file=sys.stderr, flush=True)
    return is_native


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="benchmarks", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--json", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--page", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--readme", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--only", action="append", choices=GROUPS, help=argparse.SUPPRESS)
    parser.add_argument("--long", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--interpreted", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--quick", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.quick:
        if options.page:
            parser.error("--page: with --quick the samples are too few for a page")
        be_quick()
    is_native = not options.interpreted and _is_native()
    chosen = {name: GROUPS[name] for name in options.only or GROUPS}
    if options.long:
        chosen["long"] = "Ten minutes on time", ("long_run",)
    groups, failed = [], False
    for name, (title, modules) in chosen.items():
        begun = time.monotonic()
        results: list[Result] = []
        groups.append(Group(title, results))
        try:
            if is_native and name in INTERPRETED:
                results.extend(by_the_source(name))
            else:
                results.extend(_results(modules))
        except Exception:  # the others are still worth their time
            traceback.print_exc()
            failed = True
        print(f"{title}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    _show(groups)
    if options.json:
        write_json(options.json, groups)
    if options.page:
        replace_table(options.page, groups)
        if options.readme:
            replace_missed(options.readme, options.page.read_text(encoding="utf-8"))
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
                f"{shown(result.value)} {result.unit}",
                f"{shown(result.reference)} {result.unit}: {result.reference_what}",
                shown(result.ratio),
                "" if result.aim == NO_AIM else shown(result.aim),
                style=style,
            )
    Console().print(table)


if __name__ == "__main__":
    raise SystemExit(main())

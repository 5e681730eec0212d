"""Change the source in small ways, one at a time, and see whether the tests notice.

    python tools/mutate.py --reach --sample 500 --page docs/mutants.md      over all of src
    python tools/mutate.py src/tgl_soar/control/envelope.py         every change of one file
    python tools/mutate.py src/tgl_soar/control --sample 100 --seed 7
    python tools/mutate.py --named                                  those that people made

`tools/mutations.py` lists the kinds of change.  Each is made in a copy of the project, where the
tests that reach the file are run, those that mirror it first, until one fails or the mutant's
processor time is used up.  With `--reach` it is known which tests execute the line, and these are
run before others, the quickest first (`tools/mutation_reach.py`).  A mutant that cannot be
imported, and one that never ends, count as noticed.  A test that fails in the unchanged copy as
well notices nothing: it is left out.  Tests that need real time or compile kernels are left out
too, for the first would fail on a busy machine and the others take minutes each.

Mutants that no test notices are listed with file and line, and written into a page beside the
reason for each, which people write there and a new run keeps.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from mutant_trials import Mutant, Workshop, copied
from mutants_page import page_of
from mutation_reach import FOLDER, Reach, record
from mutations import mutations
from named_mutants import NAMED, SOURCE, mutation_of

ROOT: Final = Path(__file__).parents[1]


def all_mutants(root: Path, places: list[Path]) -> list[Mutant]:
    """Every change of the files in some places (files or folders, relative to the root)."""
    return [
        Mutant(file.relative_to(root), change)
        for place in places
        for file in (sorted((root / place).rglob("*.py")) or [root / place])
        for change in mutations(file.read_text(encoding="utf-8"))
    ]


def named_mutants(root: Path) -> list[Mutant]:
    """Those that people made.  Errors: ValueError where the source has moved on."""
    return [
        Mutant(
            SOURCE / named.file,
            mutation_of(named, (root / SOURCE / named.file).read_text(encoding="utf-8")),
        )
        for named in NAMED
    ]


def recorded(root: Path, jobs: int, *, again: bool) -> Reach:
    """What executes what; it is recorded where it never was.  Errors: CalledProcessError."""
    if again or not (root / FOLDER / "known.json").exists():
        began_s = time.monotonic()
        print("recording which tests execute which lines", flush=True)
        record(root, jobs)
        print(f"recorded in {(time.monotonic() - began_s) / 60.0:.0f} min", flush=True)
    return Reach(root, root / FOLDER)


def main(arguments: list[str], root: Path = ROOT) -> int:
    """0 if every mutant, or at least the share that is asked for, is noticed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("places", nargs="*", type=Path, default=[Path("src")])
    parser.add_argument("--sample", type=int, help="how many, drawn at random (all of them)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (%(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="at a time (%(default)s)")
    parser.add_argument("--least", type=float, default=100.0, help="per cent to be noticed")
    parser.add_argument("--page", type=Path, help="where the page is written")
    parser.add_argument(
        "--named", action="store_true", help="those that people made, and no others"
    )
    parser.add_argument(
        "--reach",
        action="store_true",
        help="try the tests that execute a line, which a run of `make test` records first unless"
        " it was recorded before (in .cache/mutants; --reach-again: once more)",
    )
    parser.add_argument("--reach-again", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    mutants = named_mutants(root) if options.named else all_mutants(root, options.places)
    total = len(mutants)
    if options.sample is not None and options.sample < total:
        mutants = random.Random(options.seed).sample(mutants, options.sample)
    # What is compiled of the unchanged source is shared with the tests.
    os.environ.setdefault("XDG_CACHE_HOME", str(root / ".cache"))
    began_s = time.monotonic()
    reach = None
    if options.reach or options.reach_again:
        reach = recorded(root, options.jobs, again=options.reach_again)
    with tempfile.TemporaryDirectory(prefix="mutants-", ignore_cleanup_errors=True) as place:
        folders = [copied(root, Path(place, str(i))) for i in range(options.jobs)]
        workshop = Workshop(root, folders, lambda line: print(line, flush=True), reach=reach)
        with suppress(KeyboardInterrupt):  # what is known by then is worth a page
            workshop.try_all(mutants)
    verdicts = workshop.verdicts
    noticed = sum(verdict.noticed for verdict in verdicts.values())
    fraction = 100.0 * noticed / max(len(verdicts), 1)
    took_min = (time.monotonic() - began_s) / 60.0
    print(f"{noticed} of {len(verdicts)} mutants noticed ({fraction:.1f} %), in {took_min:.0f} min")
    if options.page:
        before = options.page.read_text(encoding="utf-8") if options.page.exists() else ""
        page = page_of(verdicts, total, options.seed, root, before)
        options.page.write_text(page, encoding="utf-8")
    return int(fraction < options.least)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

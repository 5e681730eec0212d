"""The page of mutants that no test notices, with the reasons that people have written into it, and
what they have written behind it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

from mutant_trials import BUDGET_S, Mutant, Verdict
from mutations import LEFT_OUT

NOT_LOOKED_AT: Final = "not looked at yet"
WRITTEN: Final = "\n## Larger samples\n"  # from here on people write
_TEXT: Final = """\
# Mutants

This page shows developers how well the tests detect faults. A mutant is a small change of the
source, such as an inverted comparison, a doubled number or a missing row of a table
(`tools/mutations.py` lists the kinds). `make mutate` makes this page from 500 changes; the run
shown here tried {tried}, drawn with seed {seed} from all {total} that are possible. The tests
notice {noticed} ({fraction:.1f} %).

Tests that need real time or compile kernels are left out; the others have {budget_s:.0f} s of
processor time for each change. The reasons in the table of those that are not noticed, and all that
stands behind it, are written by hand, and a new run keeps them.

Some tests compare with reference results
([CONTRIBUTING.md](../CONTRIBUTING.md#tests-by-layer)): short flights and their messages, the
experiments' plans, figures and claims (of flown and of made-up flights), what commands print, and
defaults. They notice that something has changed, not that it is wrong. Mutants that people wrote,
of what matters most, are tried by `python tools/mutate.py --named`.

Some kinds of change are not tried, as nobody who uses the program could tell:

{left_out}

| folder or file | changes | noticed |
|---|---|---|
{doors}

## Not noticed

| place | change | line | why |
|---|---|---|---|
{rows}
"""


def reasons_of(page: str) -> dict[tuple[str, str, str], str]:
    """(file, change, line as it stood) → why, of a page."""
    found = {}
    for line in page.splitlines():
        cells = line.replace("\\|", "\0").strip("| ").split(" | ")
        if line.startswith("| `") and len(cells) == 4:
            place, change, code, why = (cell.replace("\0", "|") for cell in cells)
            found[place.strip("`").rpartition(":")[0], change, code] = why
    return found


def page_of(verdicts: dict[Mutant, Verdict], total: int, seed: int, root: Path, before: str) -> str:
    """The page, with the reasons of the page before for what still goes unnoticed, and with what
    people have written behind them."""
    before, heading, written = before.partition(WRITTEN)
    reasons = reasons_of(before)
    tried, noticed = Counter[str](), Counter[str]()
    rows = []
    for mutant, verdict in sorted(verdicts.items()):
        door = mutant.path.parts[min(2, len(mutant.path.parts) - 1)]
        tried[door] += 1
        noticed[door] += verdict.noticed
        if not verdict.noticed:
            source = (root / mutant.path).read_text(encoding="utf-8").splitlines()
            code = _quoted(source[mutant.change.line - 1].strip())
            change = _quoted(mutant.change.words)
            why = reasons.get((str(mutant.path), change, code), NOT_LOOKED_AT)
            rows.append(_row(f"`{mutant.path}:{mutant.change.line}`", change, code, why))
    page = _TEXT.format(
        tried=len(verdicts),
        seed=seed,
        total=total,
        noticed=noticed.total(),
        fraction=100.0 * noticed.total() / max(len(verdicts), 1),
        budget_s=BUDGET_S,
        left_out=";\n".join(f"- {each}" for each in LEFT_OUT) + ".",
        doors="\n".join(_row(door, str(tried[door]), str(noticed[door])) for door in sorted(tried)),
        rows="\n".join(rows),
    )
    return f"{page}{heading}{written}"


def _quoted(code: str) -> str:
    return f"`{code.replace('`', chr(39))}`"


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

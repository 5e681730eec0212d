"""The results as a table of a page, and as JSON."""

from __future__ import annotations

import datetime
import json
import os
import platform
import sys
from collections.abc import Sequence
from importlib import metadata
from math import isfinite
from pathlib import Path
from typing import Final, NamedTuple

from tgl_soar.analysis.experiments.staleness import probe, sealed

from .result import NO_AIM, Result
from .shown import number, shown

BEGIN: Final = "<!-- results: made by `make bench`, do not edit -->"
END: Final = "<!-- end of results -->"
MISSED_BEGIN: Final = "<!-- aims that are missed: made by `make bench`, do not edit -->"
MISSED_END: Final = "<!-- end of missed aims -->"
MISSED: Final = ", **missed**"
# What the README says of every table, missed or met: how fast an answer is, and what flies.
AWAKE: Final = "a minimal responder in C that waits awake"
HEADLINES: Final = (
    ("sensor to surface, UDP, p50", AWAKE),
    ("sensor to surface, UDP, p99", AWAKE),
    ("the flying process, UDP", AWAKE),
    ("a second of the closed loop, all compiled", "what is allowed"),
    ("a second of the point mass, 200 steps a second", "what is allowed"),
    ("a second of the point mass, 100 steps a second", "what is allowed"),
)
PACKAGES: Final = ("tgl_soar", "mypy", "pymavlink", "fastcrc", "numba", "jsbsim")


class Group(NamedTuple):
    """Results that belong together."""

    title: str
    results: Sequence[Result]


def machine() -> dict[str, str | int]:
    """Where and with what it was measured."""
    found: dict[str, str | int] = {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "architecture": platform.machine(),
        "kernel": f"{platform.system()} {platform.release()}",
        "python": sys.version.split()[0],
    }
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    return names[0] if names else platform.processor()


def write_json(path: Path, groups: Sequence[Group]) -> None:
    """All of it, for whoever compares machines."""
    path.parent.mkdir(parents=True, exist_ok=True)
    results = [
        {"group": group.title, **result._asdict()}
        | {"ratio": _or_none(result.ratio), "aim": _or_none(result.aim)}
        for group in groups
        for result in group.results
    ]
    content = {"machine": machine(), "results": results}
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def read_json(path: Path) -> list[Result]:
    """The results that were written."""
    kept = json.loads(path.read_text(encoding="utf-8"))["results"]
    return [
        Result(
            what=row["what"],
            value=row["value"],
            reference=row["reference"],
            unit=row["unit"],
            reference_what=row["reference_what"],
            aim=NO_AIM if row["aim"] is None else row["aim"],
        )
        for row in kept
    ]


def _or_none(value: float) -> float | None:
    """JSON knows no infinity."""
    return value if isfinite(value) else None


def markdown(groups: Sequence[Group]) -> str:
    """One table for each group, and what it was measured on."""
    where = machine()
    lines = [
        f"{where['date']}; {where['processor']}, {where['cores']} cores, {where['kernel']};"
        f" Python {where['python']},"
        + ",".join(f" {name} {where[name]}" for name in PACKAGES)
        + "."
    ]
    for group in groups:
        if not group.results:
            continue
        lines += [
            "",
            f"### {group.title}",
            "",
            "| | measured | beside | | ratio | aim |",
            "|---|---:|---:|---|---:|---|",
        ]
        for r in group.results:
            aim = "" if r.aim == NO_AIM else f"≤ {shown(r.aim)}{'' if r.is_met else MISSED}"
            lines.append(
                f"| {r.what} | {shown(r.value)} {r.unit} | {shown(r.reference)} {r.unit}"
                f" | {r.reference_what} | {shown(r.ratio)} | {aim} |"
            )
    return "\n".join(lines)


class _Aim(NamedTuple):
    """A row of a page's table that has an aim."""

    group: str
    what: str
    measured: str
    beside: str
    ratio: str
    aim: str
    is_missed: bool

    @property
    def times_over(self) -> float:
        """The ratio, as a multiple of the largest that is wanted."""
        return number(self.ratio) / number(self.aim.removeprefix("≤ "))


def _aims(page: str) -> list[_Aim]:
    """All rows with an aim, in the order of the page."""
    found: list[_Aim] = []
    group = ""
    for line in page.partition(END)[0].splitlines():
        if line.startswith("### "):
            group = line.removeprefix("### ")
        cells = line.strip("| ").split(" | ")
        if line.startswith("| ") and len(cells) == 6 and cells[5].startswith("≤"):
            what, measured, _reference, beside, ratio, aim = cells
            is_missed = aim.endswith(MISSED)
            found.append(
                _Aim(
                    group=group,
                    what=what,
                    measured=measured,
                    beside=beside,
                    ratio=ratio,
                    aim=aim.removesuffix(MISSED),
                    is_missed=is_missed,
                )
            )
    return found


def missed(page: str) -> str:
    """How many aims a page's table says are missed, and by how much, as a section of the README:
    a row for each group with an aim that is missed, with what misses it most; then `HEADLINES`."""
    aims = _aims(page)
    count = sum(aim.is_missed for aim in aims)
    page_link = "[the timings](docs/performance.md)"
    sentence = f"{count} of the {len(aims)} aims of {page_link} are missed"
    if not count:
        return f"{sentence}."
    lines = [
        f"{sentence}, each of them marked there:",
        "",
        "| part | missed | most, and what was wanted |",
    ]
    lines.append("|---|--:|---|")
    for group in dict.fromkeys(aim.group for aim in aims if aim.is_missed):
        of_these = [aim for aim in aims if aim.group == group]
        worst = max((aim for aim in of_these if aim.is_missed), key=lambda aim: aim.times_over)
        fraction = f"{sum(aim.is_missed for aim in of_these)} of {len(of_these)}"
        lines.append(
            f"| {group} | {fraction} | {worst.what}: {worst.ratio} × {worst.beside} ({worst.aim}) |"
        )
    return "\n".join([*lines, *_headlines(aims)])


def _headlines(aims: Sequence[_Aim]) -> list[str]:
    """A row for each of `HEADLINES` that is among the aims."""
    found = {(aim.what, aim.beside): aim for aim in aims}
    rows = [
        f"| {aim.what} | {aim.measured} | {aim.ratio} × {aim.beside}"
        f" | {aim.aim}{MISSED if aim.is_missed else ''} |"
        for key in HEADLINES
        if (aim := found.get(key)) is not None
    ]
    if not rows:
        return []
    return ["", "| missed or met | measured | beside | wanted |", "|---|--:|---|---|", *rows]


def replace_table(path: Path, groups: Sequence[Group]) -> None:
    """Between the two marks of a page, with the probes of the laws that were timed and a sum.

    Errors: ValueError where it has none.
    """
    _replace(path, (BEGIN, END), sealed(f"{markdown(groups)}\n", probe()).rstrip())


def replace_missed(readme: Path, page: str) -> None:
    """The same in the README, of a page's missed aims."""
    _replace(readme, (MISSED_BEGIN, MISSED_END), missed(page))


def _replace(path: Path, marks: tuple[str, str], made: str) -> None:
    text = path.read_text(encoding="utf-8")
    before, begin, rest = text.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not begin or not end:
        raise ValueError(f"{path}: no {marks[0]!r} and {marks[1]!r} to put the results between")
    path.write_text(f"{before}{begin}\n\n{made}\n\n{end}{after}", encoding="utf-8")

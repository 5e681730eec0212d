"""What an experiment says: claims held against measurements, tables, numbers, figures."""

from __future__ import annotations

import platform
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

import tgl_soar

Verdict = Literal[
    "agrees", "agrees in part", "differs", "by construction", "met", "met in part", "missed"
]


@dataclass(frozen=True)
class Claim:
    """One thing that the paper explains or that this project aims at, and whether it holds."""

    text: str
    holds: bool
    measured: str
    by_construction: bool = False  # an identity of model or air: it holds whatever is measured


@dataclass(frozen=True)
class ChangedThreshold:
    """A number that a claim is judged by, and was judged by differently before."""

    claim: str
    was: str
    now: str
    why: str


@dataclass(frozen=True)
class Table:
    """Rows of words and numbers, ready to print."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Result:
    """One experiment."""

    name: str
    title: str
    flown: str  # what was done, in a sentence or two
    claims: tuple[Claim, ...]
    why: str  # where simulation and explanation part, and why; "" where they do not
    tables: tuple[Table, ...]
    numbers: dict[str, Any]
    figures: tuple[str, ...] = ()  # file names
    scenarios: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()
    changed: tuple[ChangedThreshold, ...] = ()
    own: bool = False  # holds this project's aims, not claims of the paper
    point_mass: Result | None = None  # the same flown by the paper's own model
    seconds: float = field(default=0.0, compare=False)  # wall clock

    @property
    def verdict(self) -> Verdict:
        """All claims hold, some, or none; what is true by construction decides nothing."""
        held = [claim.holds for claim in self.judged]
        if not held:
            return "by construction"
        if all(held):
            return "met" if self.own else "agrees"
        if any(held):
            return "met in part" if self.own else "agrees in part"
        return "missed" if self.own else "differs"

    @property
    def judged(self) -> tuple[Claim, ...]:
        """The claims that could have turned out otherwise."""
        return tuple(claim for claim in self.claims if not claim.by_construction)


def by_model(result: Result) -> dict[str, Result]:
    """What each model flew, by the model's name."""
    point = result.point_mass
    return {"rigid body": result} if point is None else {"rigid body": result, "point mass": point}


def tables_of(result: Result) -> tuple[Table, ...]:
    """The tables; where both models flew, each row begins with its model.

    Errors: ValueError for models whose tables are not the same.
    """
    if result.point_mass is None:
        return result.tables
    flown = by_model(result)

    def together(title: str, several: tuple[Table, ...]) -> Table:
        rows = ((name, *row) for name, one in zip(flown, several, strict=True) for row in one.rows)
        return Table(title, ("model", *several[0].columns), tuple(rows))

    same = zip(*(each.tables for each in flown.values()), strict=True)
    return tuple(together(several[0].title, several) for several in same)


def versions() -> dict[str, str]:
    """What the numbers were made with."""
    return {
        "tgl_soar": tgl_soar.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
    }


def as_json(result: Result) -> dict[str, Any]:
    """Everything about a result, for a JSON file."""
    return {
        "name": result.name,
        "title": result.title,
        "flown": result.flown,
        "verdict": result.verdict,
        "own": result.own,
        "claims": [
            {
                "text": c.text,
                "holds": c.holds,
                "measured": c.measured,
                "by_construction": c.by_construction,
            }
            for c in result.claims
        ],
        "why": result.why,
        "numbers": plain(result.numbers),
        "point_mass": result.point_mass and as_json(result.point_mass),
        "scenarios": list(result.scenarios),
        "seeds": list(result.seeds),
        "versions": versions(),
    }


def plain(value: Any) -> Any:
    """Numbers of numpy as Python's, NaN and infinities as null: what JSON can hold."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        number = float(value)
        return round(number, 6) if np.isfinite(number) else None
    return value


def as_markdown(result: Result, images: str) -> str:
    """The experiment's section of docs/experiments.md; images: the folder, as the page sees it."""
    lines = [f"## `{result.name}`: {result.title}", "", result.flown, ""]
    for table in tables_of(result):
        if table.title:
            lines += [f"**{table.title}**", ""]
        lines += _table(table)
        lines.append("")
    for figure in result.figures:
        lines += [f"![{result.title}]({images}/{figure})", ""]
    lines += _judged(result)
    lines += _reasons(result)
    if result.scenarios:
        seeds = ", ".join(str(seed) for seed in result.seeds)
        files = ", ".join(f"`config/scenarios/{name}.toml`" for name in result.scenarios)
        lines += ["", f"Scenario: {files}. Seeds: {seeds}."]
    return "\n".join(lines) + "\n"


def _table(table: Table) -> list[str]:
    return [
        "| " + " | ".join(table.columns) + " |",
        "|" + "---|" * len(table.columns),
        *("| " + " | ".join(row) + " |" for row in table.rows),
    ]


def _judged(result: Result) -> list[str]:
    """Verdict and claims: a list for one model, a table with a column each for both."""
    flown = by_model(result)
    if len(flown) == 1:
        lines = [f"**Verdict: {result.verdict}.**", ""]
        return lines + [f"- {_mark(c)} {_text(c)}: {c.measured}." for c in result.claims]
    texts = list(dict.fromkeys(_text(c) for each in flown.values() for c in each.claims))
    found = [{_text(c): f"{_mark(c)} {c.measured}" for c in each.claims} for each in flown.values()]
    verdicts = ", ".join(f"{name} {each.verdict}" for name, each in flown.items())
    rows = tuple((text, *(claims.get(text, "–") for claims in found)) for text in texts)
    return [f"**Verdict: {verdicts}.**", "", *_table(Table("", ("claim", *flown), rows))]


def _mark(claim: Claim) -> str:
    return "✓" if claim.holds else "✗"


def _text(claim: Claim) -> str:
    return f"{claim.text} (true by construction)" if claim.by_construction else claim.text


def _reasons(result: Result) -> list[str]:
    """What stands beside the claims; once where both models say the same."""
    reasons = {name: each.why for name, each in by_model(result).items()}
    if len(set(reasons.values())) == 1:
        return ["", result.why] if result.why else []
    return [
        line
        for name, why in reasons.items()
        for line in ("", f"*{name.capitalize()}*: {why}")
        if why
    ]

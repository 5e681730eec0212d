"""What an experiment says: claims held against measurements, tables, numbers, figures."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np

import tgl_soar

Verdict = Literal[
    "agrees",
    "agrees in part",
    "differs",
    "undecided",
    "by construction",
    "met",
    "met in part",
    "missed",
]

# Standard errors of a mean of eight flights beyond which its sign is known, and within which it is
# not: 95 % of Student's t with 7 degrees of freedom, 2.365.
RESOLVED: Final = 2.4
RIGID_BODY: Final = "rigid body"
POINT_MASS: Final = "point mass"
DISPERSED_AIRCRAFT: Final = "rigid body, dispersed"


@dataclass(frozen=True)
class Claim:
    """One thing that the paper explains or that this project aims at, and whether it holds."""

    text: str
    holds: bool
    measured: str
    by_construction: bool = False  # an identity of model or air: it holds whatever is measured
    undecided: bool = False  # what was measured is no finer than the bound; it does not hold then

    def __post_init__(self) -> None:
        if self.undecided and self.holds:
            raise ValueError(f"{self.text}: what is undecided does not hold")


def decided(
    text: str, holds: bool | None, measured: str, *, by_construction: bool = False
) -> Claim:
    """A claim; None: undecided."""
    return Claim(
        text=text,
        holds=holds is True,
        measured=measured,
        by_construction=by_construction,
        undecided=holds is None,
    )


def all_of(parts: Iterable[bool | None]) -> bool | None:
    """Whether all hold: one that does not decides; else one that is undecided does.  Of none:
    False."""
    found = list(parts)
    if not found or False in found:
        return False
    return None if None in found else True


def within(off: float, error: float, bound: float) -> bool | None:
    """Whether something lies within a bound; None where `RESOLVED` standard errors leave it open.

    False for NaN, which is of nothing measured.
    """
    if off != off:
        return False
    reach = RESOLVED * error
    if abs(off) + reach <= bound:
        return True
    return False if abs(off) - reach > bound else None


def above(value: float, error: float, bound: float = 0.0) -> bool | None:
    """Whether something is greater than a bound, as `within`."""
    if value != value:
        return False
    if abs(value - bound) <= RESOLVED * error:
        return None
    return value > bound


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
    badly: tuple[str, ...] = ()  # the flights that did not end as they should, in words
    # The same flown otherwise: by what flew it, `POINT_MASS`, `DISPERSED_AIRCRAFT`.
    also: Mapping[str, Result] = field(default_factory=dict)
    seconds: float = field(default=0.0, compare=False)  # wall clock

    @property
    def verdict(self) -> Verdict:
        """All claims hold, some, or none; what is true by construction decides nothing.

        None could be decided: so is the whole.
        """
        held = [claim.holds for claim in self.judged]
        if not held:
            return "by construction"
        if all(held):
            return "met" if self.own else "agrees"
        if any(held):
            return "met in part" if self.own else "agrees in part"
        if all(claim.undecided for claim in self.judged):
            return "undecided"
        return "missed" if self.own else "differs"

    @property
    def judged(self) -> tuple[Claim, ...]:
        """The claims that could have turned out otherwise."""
        return tuple(claim for claim in self.claims if not claim.by_construction)


def by_model(result: Result) -> dict[str, Result]:
    """What each model flew, by the model's name."""
    return {RIGID_BODY: result, **result.also}


def changed_by_dispersion(result: Result) -> list[tuple[Claim, Claim]]:
    """Claims that do not turn out alike of the aircraft of the airframe file and of dispersed
    ones: (of the file's, of dispersed)."""
    dispersed = result.also.get(DISPERSED_AIRCRAFT)
    if dispersed is None:
        return []
    there = {claim.text: claim for claim in dispersed.claims}
    pairs = [(claim, there[claim.text]) for claim in result.judged if claim.text in there]
    return [(here, other) for here, other in pairs if _sign(here) != _sign(other)]


def missed_by_dispersion(result: Result) -> list[Claim]:
    """Claims that are made of dispersed flights alone, and that they do not meet."""
    dispersed = result.also.get(DISPERSED_AIRCRAFT)
    if dispersed is None:
        return []
    here = {claim.text for claim in result.claims}
    return [each for each in dispersed.judged if each.text not in here and not each.holds]


def unasked_of_dispersed(result: Result) -> list[Claim]:
    """Claims that are made of the aircraft of the airframe file alone."""
    dispersed = result.also.get(DISPERSED_AIRCRAFT)
    if dispersed is None:
        return []
    there = {claim.text for claim in dispersed.claims}
    return [each for each in result.judged if each.text not in there]


def tables_of(result: Result) -> tuple[Table, ...]:
    """The tables; where several models flew, each row begins with its model, or, where what was
    measured is in title or columns, each model's table stands by itself.

    Errors: ValueError for models that have not as many tables.
    """
    flown = by_model(result)
    if len(flown) == 1:
        return result.tables

    def together(several: tuple[Table, ...]) -> list[Table]:
        first = several[0]
        named = list(zip(flown, several, strict=True))
        if any((one.title, one.columns) != (first.title, first.columns) for one in several):
            return [replace(one, title=f"{name.capitalize()}: {one.title}") for name, one in named]
        rows = tuple((name, *row) for name, one in named for row in one.rows)
        return [Table(first.title, ("model", *first.columns), rows)]

    same = zip(*(each.tables for each in flown.values()), strict=True)
    return tuple(table for several in same for table in together(several))


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
                "undecided": c.undecided,
            }
            for c in result.claims
        ],
        "why": result.why,
        "badly": list(result.badly),
        "numbers": plain(result.numbers),
        "also": {name: as_json(each) for name, each in result.also.items()},
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
    """Verdict and claims: a list for one model, a table with a column each for several."""
    flown = by_model(result)
    if len(flown) == 1:
        lines = [f"**Verdict: {result.verdict}.**", ""]
        return lines + [f"- {_mark(c)} {_text(c)}: {c.measured}." for c in result.claims]
    texts = list(dict.fromkeys(_text(c) for each in flown.values() for c in each.claims))
    found = [{_text(c): f"{_mark(c)} {c.measured}" for c in each.claims} for each in flown.values()]
    verdicts = ", ".join(f"{name} {each.verdict}" for name, each in flown.items())
    rows = tuple((text, *(claims.get(text, "–") for claims in found)) for text in texts)
    return [
        f"**Verdict: {verdicts}.**",
        "",
        *_table(Table("", ("claim", *flown), rows)),
        *_dispersed(result),
    ]


def _dispersed(result: Result) -> list[str]:
    """What dispersion changes, in words; nothing where it was not flown."""
    if DISPERSED_AIRCRAFT not in result.also:
        return []
    words = [
        f"“{here.text}” ({_sign(here)} → {_sign(there)})"
        for here, there in changed_by_dispersion(result)
    ]
    words += [
        f"“{claim.text}”, asked of dispersed flights alone ({_sign(claim)})"
        for claim in missed_by_dispersion(result)
    ]
    changes = f"**Dispersion changes:** {'; '.join(words)}."
    lines = ["", changes if words else "Dispersion changes none of these."]
    unasked = [f"“{claim.text}” ({_sign(claim)})" for claim in unasked_of_dispersed(result)]
    if unasked:
        lines += ["", f"**Not asked of dispersed flights:** {'; '.join(unasked)}."]
    return lines


def _sign(claim: Claim) -> str:
    if claim.undecided:
        return "?"
    return "✓" if claim.holds else "✗"


def _mark(claim: Claim) -> str:
    return f"{_sign(claim)} undecided:" if claim.undecided else _sign(claim)


def _text(claim: Claim) -> str:
    return f"{claim.text} (true by construction)" if claim.by_construction else claim.text


def _reasons(result: Result) -> list[str]:
    """What stands beside the claims, once where all models say the same, and each model's flights
    that did not end as they should."""
    flown = by_model(result)
    reasons = {name: each.why for name, each in flown.items()}
    if len(set(reasons.values())) == 1:
        lines = ["", result.why] if result.why else []
    else:
        lines = [
            line
            for name, why in reasons.items()
            for line in ("", f"*{name.capitalize()}*: {why}")
            if why
        ]
    for name, each in flown.items():
        lines += _folded(name, each.badly)
    return lines


def _folded(name: str, badly: Sequence[str]) -> list[str]:
    """A list that a reader opens: Markdown within HTML needs its empty lines."""
    if not badly:
        return []
    flights = "flight" if len(badly) == 1 else "flights"
    title = f"{name.capitalize()}: {len(badly)} {flights} that did not end well"
    head = ["", "<details>", f"<summary>{title}</summary>", ""]
    return [*head, *(f"- {each}" for each in badly), "", "</details>"]

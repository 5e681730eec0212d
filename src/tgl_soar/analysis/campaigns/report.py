"""Flights of any campaign, counted or averaged by any of their columns.

Read as a stream from `rows.parquet`: of a million flights only two columns are in memory.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from tgl_soar.analysis.campaigns.drawn_faults import wilson
from tgl_soar.sim.campaign.folder import ROWS
from tgl_soar.sim.campaign.rows import FLIGHT, read_columns, read_rows

GROUPS_MOST: Final = 200  # more are no groups
ALL: Final = "all"
# What is looked at where nobody says: what campaigns are about, by their own names for it.
USUAL_BY: Final = ("row", "kind", "place", "leg", "scenario_title")
USUAL_OF: Final = ("result", "ended", "up", "rms_e_rho_m", "alpha")


class Proportion(NamedTuple):
    """Flights of one class among those of a group; there is at least one."""

    counted: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """In which the true share lies, at 95 % (Wilson)."""
        return wilson(self.counted, self.of)


class TwoProportions(NamedTuple):
    """A group of two campaigns."""

    name: str
    fractions: tuple[Proportion, Proportion]

    @property
    def difference(self) -> tuple[float, float]:
        """In which the first share less the second lies, at 95 %.

        By the intervals of the two put together: method 10 of R. G. Newcombe, "Interval estimation
        for the difference between independent proportions", Statistics in Medicine 17 (1998),
        873-890.
        """
        (p, q) = (fraction.counted / fraction.of for fraction in self.fractions)
        (p_low, p_high), (q_low, q_high) = (fraction.interval for fraction in self.fractions)
        return p - q - hypot(p - p_low, q_high - q), p - q + hypot(p_high - p, q - q_low)

    @property
    def is_apart(self) -> bool:
        """They differ, at 95 %: of twenty groups that do not, one is told apart all the same."""
        low, high = self.difference
        return not low <= 0.0 <= high


class TwoCampaigns(NamedTuple):
    """Two campaigns, group by group."""

    by: str
    of: str
    counted: str  # the class whose shares they are
    # Of groups that both have; no sum, as each has its own number of each.
    rows: list[TwoProportions]
    alone: tuple[list[str], list[str]]  # groups that only one of them has


class ReportError(ValueError):
    """A table that cannot be reported so."""


class Spread(NamedTuple):
    """Numbers of a group."""

    flights: int
    unknown: int  # NaN, infinite or not there; in none of the others
    mean: float
    deviation: float
    quantiles: tuple[float, float, float]  # 5 %, half, 95 %


@dataclass
class FlightGroup:
    """Flights that have one value of a column in common."""

    name: str
    classes: Counter[str] = field(default_factory=Counter)  # of texts and of yes and no
    numbers: list[float] = field(default_factory=list)

    @property
    def flights(self) -> int:
        """How many there are."""
        return self.classes.total() or len(self.numbers)

    def spread(self) -> Spread:
        """Of its numbers; NaN where there are none."""
        whole = np.array(self.numbers)
        known = whole[np.isfinite(whole)]
        low, middle, high = (
            np.quantile(known, (0.05, 0.5, 0.95)).tolist() if known.size else (np.nan,) * 3
        )
        return Spread(
            flights=whole.size,
            unknown=whole.size - known.size,
            mean=float(np.mean(known)) if known.size else np.nan,
            deviation=float(np.std(known)) if known.size else np.nan,
            quantiles=(low, middle, high),
        )


@dataclass
class Report:
    """A table."""

    by: str  # a column; "": all together
    of: str
    groups: list[FlightGroup]  # in the order in which they first fly

    @property
    def is_counted(self) -> bool:
        """Classes are counted; else numbers are averaged."""
        return any(group.classes for group in self.groups)

    @property
    def classes(self) -> list[str]:
        """All that there are, the most frequent first."""
        found: Counter[str] = Counter()
        for group in self.groups:
            found += group.classes
        return [name for name, _ in found.most_common()]


def rows_file(path: Path) -> Path:
    """The table in a campaign's folder, or the file itself.  Errors: `ReportError`."""
    found = path / ROWS if path.is_dir() else path
    if not found.is_file():
        raise ReportError(f"{path}: no {ROWS} is there: name a campaign's folder, or the file")
    return found


def report(path: Path, by: str | None = None, of: str | None = None) -> Report:
    """Flights by one column ("": all together), counted or averaged by another; None: usual ones.

    Errors: `ReportError`, for a table without a flight too; ImportError without pyarrow.
    """
    file = rows_file(path)
    try:
        columns = read_columns(file)
    except ValueError as error:
        raise ReportError(f"{file}: no table of flights: {error}") from None
    of = _chosen(file, columns, of, USUAL_OF, "--of")
    by = _chosen(file, columns, by, USUAL_BY, "--by") if by is None or by else ""
    by = "" if by == of else by
    groups: dict[str, FlightGroup] = {}
    for row in read_rows(file, sorted({name for name in (by, of) if name})):
        name = _text(row[by]) if by else ALL
        if name not in groups:
            if len(groups) == GROUPS_MOST:
                raise ReportError(f"--by {by}: more than {GROUPS_MOST} groups")
            groups[name] = FlightGroup(name)
        value = row[of]
        if columns[of] in ("int64", "double"):
            groups[name].numbers.append(np.nan if value is None else float(value))
        else:
            groups[name].classes[_text(value)] += 1
    if not groups:
        raise ReportError(f"{path}: a campaign of no flights: name one in which some were flown")
    return Report(by, of, list(groups.values()))


def beside(first: Report, second: Report, counted: str | None = None) -> TwoCampaigns:
    """The shares of one class in both; None: of the first's most frequent one.

    Errors: `ReportError` for numbers, which have no classes, for a class that neither has, and
    where no group is in both.
    """
    if not first.is_counted or not second.is_counted:
        raise ReportError(f"--of {first.of}: numbers, and two campaigns are compared by classes")
    there = list(dict.fromkeys([*first.classes, *second.classes]))
    counted = there[0] if counted is None else counted
    if counted not in there:
        raise ReportError(f"--class {counted}: {first.of} is one of {', '.join(there)}")
    groups = [{group.name: group.classes for group in found.groups} for found in (first, second)]
    names = [name for name in groups[0] if name in groups[1]]
    if not names:
        raise ReportError(f"--by {first.by}: the two campaigns have no group in common")
    rows = []
    for name in names:
        one, other = (Proportion(each[name][counted], each[name].total()) for each in groups)
        rows.append(TwoProportions(name, (one, other)))
    alone = ([n for n in groups[0] if n not in groups[1]], [n for n in groups[1] if n not in names])
    return TwoCampaigns(by=first.by, of=first.of, counted=counted, rows=rows, alone=alone)


def _chosen(
    file: Path, columns: dict[str, str], asked: str | None, usual: tuple[str, ...], option: str
) -> str:
    plain = [name for name, kind in columns.items() if _is_plain(kind) and name != FLIGHT]
    if asked is not None:
        if asked not in plain:
            raise ReportError(f"{option} {asked}: no column of {file}; it has {', '.join(plain)}")
        return asked
    for name in usual:
        if name in plain:
            return name
    if option == "--by":
        return ""
    if not plain:
        raise ReportError(f"{file}: no column of numbers or texts")
    return plain[0]


def _is_plain(kind: str) -> bool:
    return kind in ("int64", "double", "string", "bool")


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "–" if value is None or value == "" else str(value)

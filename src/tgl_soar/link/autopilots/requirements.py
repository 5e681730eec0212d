"""What a firmware's parameters must be, and whether they are.

The rows stand in each firmware's file (`need(…)`).  They are data: `tgl-soar preflight` and the
module read the vehicle's values and hold them against these.  The tables of docs/hardware.md say
the same; they are written by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Final, NamedTuple

Answers = Mapping[str, float]  # parameter's name: value; what did not answer is not in it

MUST: Final = "must"  # else the module does not fly, or not safely
SHOULD: Final = "should"  # it flies, but worse

_TOLERANCE: Final = 1e-5  # parameters are sent as 32-bit floats


class Needs(NamedTuple):
    """What the module asks of a firmware, beyond the surfaces' channels."""

    override_system: int
    loop_rate_hz: float
    external_pose: bool  # positions are forwarded to it (`[forward]` of the site)
    gps: bool  # its position comes from satellites
    lands: bool = False  # it is asked for the landing of its mission (LND_BY 1)


class Requirement(NamedTuple):
    """One row: a parameter, and what it must be."""

    names: tuple[str, ...]  # that one, or what other releases call it
    relation: str  # a key of RELATIONS
    wanted: float
    why: str
    level: str = MUST
    missing_ok: bool = False  # releases without it need nothing


def need(
    names: str, relation: str, wanted: float, why: str, level: str = MUST, *, old: bool = True
) -> Requirement:
    """names: by spaces; old: there are releases without it, which need nothing."""
    return Requirement(
        names=tuple(names.split()),
        relation=relation,
        wanted=wanted,
        why=why,
        level=level,
        missing_ok=old,
    )


def _close(a: float, b: float) -> bool:
    return abs(a - b) <= _TOLERANCE * max(1.0, abs(b))


RELATIONS: Final[dict[str, Callable[[float, float], bool]]] = {
    "is": _close,
    "is not": lambda value, wanted: not _close(value, wanted),
    "at most": lambda value, wanted: value <= wanted or _close(value, wanted),
    "at least": lambda value, wanted: value >= wanted or _close(value, wanted),
    "has bit": lambda value, wanted: int(value) >> int(wanted) & 1 == 1,
    "lacks bit": lambda value, wanted: int(value) >> int(wanted) & 1 == 0,
}


class Finding(NamedTuple):
    """How one row came out."""

    requirement: Requirement
    name: str  # by which it answered, or the first
    value: float | None  # None: no answer

    @property
    def ok(self) -> bool:
        """Whether it is as wanted."""
        row = self.requirement
        if self.value is None:
            return row.missing_ok
        if not isfinite(self.value):  # whatever sends that: no parameter is so set up
            return False
        return RELATIONS[row.relation](self.value, row.wanted)


def compare(requirements: tuple[Requirement, ...], answers: Answers) -> list[Finding]:
    """Every row with what the vehicle has."""
    findings = []
    for row in requirements:
        name = next((n for n in row.names if n in answers), row.names[0])
        findings.append(Finding(row, name, answers.get(name)))
    return findings


def remedy(finding: Finding) -> str:
    """What to set a parameter to, in words."""
    row = finding.requirement
    name, wanted = finding.name, f"{row.wanted:g}"
    if row.relation == "has bit":
        return f"set bit {wanted} of {name}" + _with_bit(finding, on=True)
    if row.relation == "lacks bit":
        return f"clear bit {wanted} of {name}" + _with_bit(finding, on=False)
    words = {"is": "", "is not": "anything but ", "at most": "at most ", "at least": "at least "}
    return f"set {name} to {words[row.relation]}{wanted}"


def _with_bit(finding: Finding, *, on: bool) -> str:
    if finding.value is None or not isfinite(finding.value):
        return ""
    bit, value = 1 << int(finding.requirement.wanted), int(finding.value)
    return f" (to {value | bit if on else value & ~bit})"

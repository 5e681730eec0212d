"""docs/safety.md: what it names is there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

from tgl_soar.analysis.campaigns.drawn_faults import DISPERSED_MARKS, MARKS
from tgl_soar.config.parameters import INDEX

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")


def test_every_test_that_the_page_names_exists() -> None:
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert len(named) > 30
    assert named - PROOFS.keys() == set()


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(test_\w+)`", PAGE))))
def test_a_test_that_the_page_names_asserts_and_is_not_skipped(name: str) -> None:
    assert not PROOFS[name].skipped
    assert re.search(r"assert|raises|wait|until", PROOFS[name].asserted) or name in BY_ITSELF


def test_words_that_are_only_called_or_commented_prove_nothing() -> None:
    text = """
@pytest.mark.skip
def test_it():
    release()  # RELEASED
    words = "released"
    helper()
def helper():
    assert mode == HOLDING
"""
    functions = {n.name: n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef)}
    assert [*_asserted(functions["test_it"], functions)] == ["assert mode == HOLDING"]


def test_every_hazard_names_a_test() -> None:
    hazards = PAGE.partition("## Hazards")[2].partition("\n## ")[0]
    rows = [line for line in hazards.splitlines() if line.startswith("| ")]
    rows = [row for row in rows if "what goes wrong" not in row]
    assert len(rows) > 20
    assert [row for row in rows if "`test_" not in row] == []


WAITS = re.compile(r"wait|until|shown")  # functions that fail after a time


class Proof(NamedTuple):
    """What a test asserts: its own assertions and those of the functions of its file that it
    calls, what it waits for or expects to be raised, and the parameters that these go by."""

    asserted: str
    source: str  # its own, in small letters
    skipped: bool


def _asserted(
    node: ast.AST, functions: Mapping[str, ast.AST], visited: frozenset[str] = frozenset()
) -> Iterator[str]:
    for each in ast.walk(node):
        if isinstance(each, ast.Assert):
            yield ast.unparse(each)
        elif isinstance(each, ast.withitem) and "raises" in (text := ast.unparse(each)):
            yield text
        elif isinstance(each, ast.Call):
            name = ast.unparse(each.func)
            if WAITS.search(name):
                yield ast.unparse(each)
            if name in functions and name not in visited and len(visited) < 3:
                yield from _asserted(functions[name], functions, visited | {name})


def proofs() -> dict[str, Proof]:
    """Of every test by its name, of all files together."""
    found: dict[str, Proof] = {}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        functions = {n.name: n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
        for name, node in functions.items():
            if not name.startswith("test_"):
                continue
            decorators = [ast.unparse(each) for each in node.decorator_list]
            before = found.get(name, Proof("", "", skipped=False))
            found[name] = Proof(
                asserted="\n".join([before.asserted, *_asserted(node, functions), *decorators]),
                source=before.source + ast.unparse(node).lower(),
                skipped=before.skipped
                or any(re.search(r"mark\.(skip|xfail)\b", each) for each in decorators)
                or any(
                    re.fullmatch(r"pytest\.(skip|xfail)\(.*\)", ast.unparse(each), re.DOTALL)
                    for each in node.body
                ),
            )
    return found


# What a row says happens, and what one of its tests must assert to have looked at that: in the
# words of what it looks at.
LOOKED_AT = {
    r"\breleased\b": (
        r"RELEASED|released|disengaged|is_flying|is_engaged|\[0\] \*|\bREADY\b|NOWHERE"
        r"|everything\.to|everything\.lacks|overrid|shown_s"
    ),
    r"engaging is refused|^refused (with|and)": (
        r"REJECTED|REFUS|RELEASED|DENIED|Error|refus|is_engaged"
    ),
    r"\breported\b": r"texts|words|reported|outbound|told|said|notices|console|SEVERITY_",
    r"\brecovering\b": r"RECOVERING|recovering",
    r"^holding|: holding": r"HOLDING|holding",
    r"\bstarted again\b": r"restarted",
    r"^limited": r"limited\.command",
    r"\bcounted\b": r"counters|refused|left_out",
    r"treated as silence|used once|counts as a gap|(outlier|that frame) is refused": (
        r"\.changes\(\)|mode_now in ENGAGED|reboots == 0"
    ),
    r"tube is not used": r"not ticks\[-1\]\.output\.air\.measured",
    r"rate is not used": r"roll_rate_radps == 0\.0",
    r"counts as clearance": r"found\.clearance_m ==",
    r"kept from rising": r"stall_margin|trim",
    r"pitch setpoint stays": r"pitch_within|pitch_setpoint",
    r"\bbreaks off\b": r"BREAK_OFF|BREAKING_OFF",
    r"line is not flown": r"'TGL_X'\) == x_m",
    r"no end on the ground": r"not is_on_ground",
    r"is 0 again after": r"\['LNC_START'\] == 0\.0",
    r"brake is retracted": r"command\.brake == 0\.0",
    r"^the same$|line alone is held": r"state\.brake == 0\.0",
    r"refused, in words": r"words|match=",
    r"closed at once": r"fraction, .*== \(0\.0",
    r"count as little as they scatter": r"position_sigma_m|variance_m2",
    r"as for these": r"surfaces\.elevator == .*command\.elevator",
    r"engages nothing": r"== NOTHING",
    r"no mode is requested": r"len\(flight\.asked\) == asked",
    r"refused for 4 s": r"mode_now == READY",
    r"pilot's sticks fly": r"== MANUAL",
    r"commands are left out": r"left_out ==",
    r"^dropped": r"not \w+\.is_flown_after",
    r"nothing is set": r"data=st\.binary|not fired\.changed",
    r"read after the tick": r"most_tries <=",
    r"begun between two ticks": r"counters\.ticks >",
    r"laws change once a tick": r"laws_changed - changed <=",
    r"free again": r"listener\.peer ==",
    r"is ignored": r"<= ignored\(",
    r"no console text": r"not in came",
    r"enough time to release": r"TimeoutStopSec.*>=",
    r"never the surfaces": r"surface_frames - surfaces == ticked",
    r"^nothing$": r"mode_now in",
    r"raises no fault": r"not found\.faults & h\.DISAGREES|not state\.lies",
    r"its own gains": r"schedule_at_age\(.*\) == AS_FOUND",
    r"go by the commands": r"stopped\.air == without\.air",
    r"way out counts": r"RELEASE in found",
}
PROOFS = proofs()
# A target of the fuzzer raises by itself what it finds.
BY_ITSELF = {"test_no_bytes_do_harm"}


def rows_of_hazards() -> list[list[str]]:
    hazards = PAGE.partition("## Hazards")[2].partition("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in hazards.splitlines() if line.startswith("| ")]
    return [row for row in rows if row[0] != "what goes wrong"]


@pytest.mark.parametrize("row", rows_of_hazards(), ids=lambda row: row[0][:40])
def test_one_test_of_a_row_looks_at_what_the_row_says_happens(row: list[str]) -> None:
    _, _, happens, proved = row
    together = "\n".join(PROOFS[name].asserted for name in re.findall(r"`(test_\w+)`", proved))
    looked_for = {words: at for words, at in LOOKED_AT.items() if re.search(words, happens)}
    assert looked_for, f"LOOKED_AT knows nothing of {happens!r}"
    for words, looks_at in looked_for.items():
        assert re.search(looks_at, together), f"{words!r} of {happens!r}"


# Words of a row that are of any hazard.
COMMON = {"after", "autopilot", "before", "other", "their", "there", "where", "which", "while"}
# What the tests of a row call it, where they have no word of it.
CALLED = {
    "the service manager ends it, or the computer runs short of memory": "oompolicy",
    "the watchdog is killed": "orphan",
    "the computer loses power": "kill_9",
}


@pytest.mark.parametrize("row", rows_of_hazards(), ids=lambda row: row[0][:40])
def test_one_test_of_a_row_is_about_what_goes_wrong(row: list[str]) -> None:
    """By the beginnings of the row's words, anywhere in the test."""
    words = {word[:5] for word in re.findall(r"[a-z_]{4,}", row[0].lower()) if word not in COMMON}
    words = {CALLED[row[0]]} if row[0] in CALLED else words
    tests = re.findall(r"`(test_\w+)`", row[3])
    assert any(word in PROOFS[name].source for name in tests for word in words), (words, tests)


@pytest.mark.parametrize("words", LOOKED_AT)
def test_nothing_is_looked_for_that_no_row_says(words: str) -> None:
    assert any(re.search(words, row[2]) for row in rows_of_hazards())


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([A-Z]+_[A-Z_]+)`", PAGE))))
def test_every_parameter_that_the_page_names_is_one(name: str) -> None:
    of_others = {"RC_OVERRIDE_TIME", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "CLOCK_MONOTONIC_RAW"}
    of_others |= {"EKF_STATUS_REPORT", "ESTIMATOR_STATUS"}
    assert name in INDEX or name in of_others


def test_its_figure_and_the_place_for_its_table_are_there() -> None:
    for image in re.findall(r"!\[.*?\]\((.*?)\)", PAGE):
        assert (ROOT / "docs" / image).stat().st_size < 300_000
    assert [PAGE.count(mark) for mark in (*MARKS, *DISPERSED_MARKS)] == [1, 1, 1, 1]

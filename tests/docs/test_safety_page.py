"""docs/safety.md: what it names is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tgl_soar.analysis.experiments.campaign import BEGIN, END
from tgl_soar.config.parameters import INDEX

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")


def test_every_test_that_the_page_names_exists() -> None:
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert len(named) > 30
    assert named - SOURCES.keys() == set()


def test_every_hazard_names_a_test() -> None:
    hazards = PAGE.partition("## Hazards")[2].partition("\n## ")[0]
    rows = [line for line in hazards.splitlines() if line.startswith("| ")]
    rows = [row for row in rows if "what goes wrong" not in row]
    assert len(rows) > 20
    assert [row for row in rows if "`test_" not in row] == []


def sources_of_tests() -> dict[str, str]:
    """The text of every test, with its parameters and the functions of its file that it calls."""
    found: dict[str, str] = {}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines()
        functions = {}
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                begin = min([node.lineno, *(each.lineno for each in node.decorator_list)])
                functions[node.name] = "\n".join(lines[begin - 1 : node.end_lineno])
        for name, body in functions.items():
            if name.startswith("test_"):
                called = [functions[f] for f in re.findall(r"\b(\w+)\(", body) if f in functions]
                found[name] = "\n".join([found.get(name, ""), body, *called])
    return found


# What a row says happens, and what one of its tests must have in it to have looked at that.
LOOKED_AT = {
    r"\breleased\b": (
        r"RELEASED|released|let go|is_flying|is_engaged|\[0\] \*|\bREADY\b|NOWHERE"
        r"|everything\.to|overrid|shown_s"
    ),
    r"engaging is refused|^refused (with|and)": (
        r"REJECTED|REFUS|RELEASED|DENIED|Error|refus|is_engaged"
    ),
    r"\breported\b": r"texts|words|told|said|notices|console",
    r"\brecovering\b": r"RECOVERING|recovering",
    r"^holding|: holding": r"HOLDING|holding",
    r"\bstarted again\b": r"restarted",
    r"^limited": r"limit_surfaces",
    r"\bcounted\b": r"counters|refused|left_out",
}
SOURCES = sources_of_tests()


def rows_of_hazards() -> list[list[str]]:
    hazards = PAGE.partition("## Hazards")[2].partition("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in hazards.splitlines() if line.startswith("| ")]
    return [row for row in rows if row[0] != "what goes wrong"]


@pytest.mark.parametrize("row", rows_of_hazards(), ids=lambda row: row[0][:40])
def test_one_test_of_a_row_looks_at_what_the_row_says_happens(row: list[str]) -> None:
    _, _, happens, proved = row
    together = "\n".join(SOURCES.get(name, "") for name in re.findall(r"`(test_\w+)`", proved))
    for said, looks_at in LOOKED_AT.items():
        if re.search(said, happens):
            assert re.search(looks_at, together), f"{said!r} of {happens!r}"


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([A-Z]+_[A-Z_]+)`", PAGE))))
def test_every_parameter_that_the_page_names_is_one(name: str) -> None:
    of_others = {"RC_OVERRIDE_TIME", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "CLOCK_MONOTONIC_RAW"}
    of_others |= {"EKF_STATUS_REPORT", "ESTIMATOR_STATUS"}
    assert name in INDEX or name in of_others


def test_its_figure_and_the_place_for_its_table_are_there() -> None:
    for image in re.findall(r"!\[.*?\]\((.*?)\)", PAGE):
        assert (ROOT / "docs" / image).stat().st_size < 300_000
    assert PAGE.count(BEGIN) == PAGE.count(END) == 1

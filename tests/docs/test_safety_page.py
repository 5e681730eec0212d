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


def names_of_tests() -> set[str]:
    names: set[str] = set()
    for file in (ROOT / "tests").rglob("test_*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        names |= {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    return names


def test_every_test_that_the_page_names_exists() -> None:
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert len(named) > 30
    assert named - names_of_tests() == set()


def test_every_hazard_names_a_test() -> None:
    hazards = PAGE.partition("## Hazards")[2].partition("\n## ")[0]
    rows = [line for line in hazards.splitlines() if line.startswith("| ")]
    rows = [row for row in rows if "what goes wrong" not in row]
    assert len(rows) > 20
    assert [row for row in rows if "`test_" not in row] == []


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([A-Z]+_[A-Z_]+)`", PAGE))))
def test_every_parameter_that_the_page_names_is_one(name: str) -> None:
    of_others = {"RC_OVERRIDE_TIME", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "CLOCK_MONOTONIC_RAW"}
    assert name in INDEX or name in of_others


def test_its_figure_and_the_place_for_its_table_are_there() -> None:
    for image in re.findall(r"!\[.*?\]\((.*?)\)", PAGE):
        assert (ROOT / "docs" / image).stat().st_size < 300_000
    assert PAGE.count(BEGIN) == PAGE.count(END) == 1

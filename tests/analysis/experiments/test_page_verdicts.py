"""Every experiment, flown whole: its verdict is the one that its page gives.

The flights of all of them take some minutes where nothing else is computed.  A page that says of
itself that it is older than the laws is not held to anything.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tgl_soar.analysis.experiments import staleness
from tgl_soar.analysis.experiments.catalogue import TOGETHER, run_whole
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.pages import AIMS, PAPER, counted

DOCS = Path(__file__).parents[3] / "docs"
AT_ONCE = ("field",)  # nothing is flown
NAMES = {name: page for page, key in ((PAPER, "paper"), (AIMS, "aims")) for name in TOGETHER[key]}


def reported(text: str, name: str) -> list[str]:
    """The verdicts of an experiment in a page's first table: of the aircraft, of other models."""
    (row,) = [line for line in text.splitlines() if line.startswith(f"| [`{name}`](#{name}) | ")]
    return row.strip("| ").split(" | ")[2:]


def models(text: str) -> list[str]:
    """The other models in a page's first table."""
    (head,) = [line for line in text.splitlines() if line.startswith("| experiment | what | ")]
    return re.findall(r"\| of the ([^|]+?) (?=\|)", head)


@pytest.mark.parametrize(
    "name",
    [name if name in AT_ONCE else pytest.param(name, marks=pytest.mark.long) for name in NAMES],
)
def test_the_verdict_is_the_pages(name: str) -> None:
    text = (DOCS / NAMES[name]).read_text(encoding="utf-8")
    if staleness.OLDER in text:
        pytest.skip(f"docs/{NAMES[name]} says that it is older")
    flown = run_whole(name, Context(flyer=Flyer()))
    verdicts = {"": counted(flown)} | {way: counted(each) for way, each in flown.also.items()}
    stand = dict(zip(["", *models(text)], reported(text, name), strict=True))
    assert {way: words for way, words in stand.items() if words != "–"} == verdicts


def test_a_verdict_is_read_where_it_stands() -> None:
    text = (
        "| experiment | what | verdict | of the point mass | of the rigid body, dispersed |\n"
        "| [`a`](#a) | what | agrees: 2 of 2 | differs: 0 of 2 |\n| [`b`](#b) | x | met: 1 of 1 |"
    )
    assert reported(text, "a") == ["agrees: 2 of 2", "differs: 0 of 2"]
    assert reported(text, "b") == ["met: 1 of 1"]
    assert models(text) == ["point mass", "rigid body, dispersed"]

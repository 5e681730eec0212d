"""The papers of the project name the version that the package has, and each other rightly."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import tgl_soar
from tgl_soar.cli.app import app
from tgl_soar.config.parameters import INDEX

ROOT = Path(tgl_soar.__file__).parents[2]
KINDS = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")  # Keep a Changelog's


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_version_is_written_once_and_cited() -> None:
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    assert "version" in project["dynamic"]
    assert "version" not in project
    (cited,) = re.findall(r"^version: (.+)$", text_of("CITATION.cff"), flags=re.MULTILINE)
    assert cited == tgl_soar.__version__


def test_the_changelog_has_this_version_and_what_is_to_come() -> None:
    headings = re.findall(r"^## (.+)$", text_of("CHANGELOG.md"), flags=re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert headings[1].split()[0] == tgl_soar.__version__


def test_every_page_says_at_its_beginning_what_it_is_for() -> None:
    """Those of decisions all have the same headings, and say it in their index."""
    pages = sorted((ROOT / "docs").glob("*.md"))
    assert len(pages) > 20
    begun = {page.name: page.read_text(encoding="utf-8").partition("\n## ")[0] for page in pages}
    assert [name for name, text in begun.items() if "This page " not in text] == []


# Messages, and parameters of the firmwares.
THEIR_NAMES = frozenset(
    {
        *("RC_OVERRIDE_TIME", "MAV_STATE", "EKF_STATUS_REPORT", "ESTIMATOR_STATUS"),
        *("RTL_AUTOLAND", "COM_LOW_BAT_ACT", "COM_RCL_EXCEPT", "GF_ACTION"),
    }
)


def test_what_is_to_come_is_sorted_and_names_what_there_is() -> None:
    _, _, rest = text_of("CHANGELOG.md").partition("\n## Unreleased\n")
    text = rest.partition("\n## ")[0]
    kinds = re.findall(r"(?m)^### (.+)$", text)
    assert kinds == [kind for kind in KINDS if kind in kinds]
    assert re.findall(r"(?m)^[^-# \n].*$", text) == [], "one line (or entry) each, under its kind"
    commands = {c.name for c in app.registered_commands} | {g.name for g in app.registered_groups}
    assert set(re.findall(r"`tgl-soar (\w+)", text)) <= commands
    parameters = set(re.findall(r"`([A-Z]+_[A-Z_]*[A-Z])`", text))
    assert "TGL_STEP_MAX" in parameters
    assert parameters - THEIR_NAMES <= set(INDEX)


def test_types_may_be_used_by_others() -> None:
    assert (ROOT / "src/tgl_soar/py.typed").is_file()

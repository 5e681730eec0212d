"""The papers of the project name the version that the package has, and each other rightly."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import tgl_soar

ROOT = Path(tgl_soar.__file__).parents[2]


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


def test_types_may_be_used_by_others() -> None:
    assert (ROOT / "src/tgl_soar/py.typed").is_file()

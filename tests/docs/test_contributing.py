"""CONTRIBUTING.md: the files, names and commands that it sends people to are there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tgl_soar.cli.app import app
from tgl_soar.config.parameters import INDEX

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TASKS = ("A parameter", "A sensor", "A source of position", "A MAVLink message", "A firmware",
         "An experiment", "A column of the log", "A limit in the supervisor's table",
         "A control surface")  # fmt: skip


def files_in(text: str) -> set[str]:
    return set(re.findall(r"(?<![\w/])((?:src|tests|config|docs|tools)/[\w/]*(?:\.\w+)?)", text))


def test_every_file_that_the_page_names_is_there() -> None:
    missing = [name for name in sorted(files_in(PAGE)) if not (ROOT / name).exists()]
    assert not missing, "moved: correct CONTRIBUTING.md"


@pytest.mark.parametrize("task", TASKS)
def test_each_task_names_source_tests_and_page(task: str) -> None:
    _, found, rest = PAGE.partition(f"\n### {task}\n")
    assert found
    files = files_in(re.split(r"(?m)^##", rest)[0])
    assert {"src", "tests", "docs"} <= {name.partition("/")[0] for name in files}


def test_every_folder_of_tests_has_its_layer() -> None:
    layers = PAGE.partition("## Tests by layer")[2].partition("\n## ")[0]
    there = {
        p.name for p in (ROOT / "tests").iterdir() if p.is_dir() and any(p.glob("**/test_*.py"))
    }
    named = set(re.findall(r"`tests/(\w+)/`", layers))
    assert named == there - {"benchmarks"}  # `make bench` says what it is


def test_every_name_in_the_source_that_the_page_names_is_there() -> None:
    names: set[str] = set()
    for file in (ROOT / "src").rglob("*.py"):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                names.add(node.target.id)
    spans = set(re.findall(r"`(_?[A-Z]\w+|\w+_\w+)`", PAGE))
    ours = {s for s in spans if not s.startswith(("_m", "_rad", "_s", "position_ned"))}
    assert len(ours) > 8
    assert ours <= names | set(INDEX)


def test_every_command_that_the_page_prints_is_there() -> None:
    printed = re.findall(r"`make .*?`|^    make .*$", PAGE, re.MULTILINE)
    targets = set(re.findall(r"make (\w+)", " ".join(printed)))
    assert targets
    assert {t for t in targets if not re.search(rf"(?m)^{t}:", MAKEFILE)} == set()
    known = {c.name for c in app.registered_commands} | {g.name for g in app.registered_groups}
    assert set(re.findall(r"tgl-soar (\w+)", PAGE)) <= known

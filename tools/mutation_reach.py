"""Which tests execute a line of the source, and how long each takes: recorded, not supposed.

`record` runs the tests of `make test` once, in the state in which they judge mutants, and lets
`coverage` note by which test each line is executed, and how much processor time each test takes.
That costs about three times as much as the tests alone.  What it finds lies in `.cache/mutants/`
and is never committed.  A file of source or tests that has changed since is as good as never
recorded: only the order in which tests are tried depends on it, and a line within a function of a
recorded file that no test executed is left to the tests that are not recorded.  Lines of a module
itself, its constants and tables, are executed by all that imports it: a recording says nothing of
them.

This module is pytest's plugin for that run, too.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections.abc import Generator
from hashlib import sha256
from math import inf
from pathlib import Path
from typing import Any, Final

import pytest

LEFT_OUT: Final = ("real time",)  # groups of tests/conftest.py
HIDDEN: Final = "numba"
FOLDER: Final = Path(".cache", "mutants")
_RECORDING: Final = "MUTATION_REACH"
# xdist begins with what has the most cases by default, as in the Makefile.
_WORKERS: Final = ("--dist", "loadgroup", "--no-loadscope-reorder")


class Reach:
    """What a recording holds of a project."""

    def __init__(self, root: Path, folder: Path) -> None:
        """Errors: FileNotFoundError where nothing was recorded."""
        from coverage import CoverageData

        self._root = root
        known = json.loads((folder / "known.json").read_text(encoding="utf-8"))
        self._digests: dict[str, str] = known["digests"]
        self.seconds: dict[str, float] = known["seconds"]  # of each test that was run
        self._tests: dict[str, list[str]] = {}  # of each file that was run
        for test in self.seconds:
            self._tests.setdefault(test.partition("::")[0], []).append(test)
        self._data = CoverageData(str(folder / "lines"))
        self._data.read()

    def knows(self, path: Path) -> bool:
        """Whether a file (relative to the root) is as it was recorded."""
        return self._digests.get(str(path)) == _digest(self._root / path)

    def records(self, file: str) -> bool:
        """Whether tests of a file were run, and are as they were."""
        return file in self._tests and self.knows(Path(file))

    def whole_s(self, file: str) -> float:
        """How long all tests of a file take [s]; inf where they were not run, or have changed."""
        if not self.records(file):
            return inf
        return sum(self.seconds[test] for test in self._tests[file])

    def tests_at(self, path: Path, lines: frozenset[int]) -> dict[str, dict[str, float]]:
        """Files with the tests of theirs that execute any of these lines, and how long each takes
        [s]; all tests of a file where a line is executed by what several may share."""
        by_line = self._data.contexts_by_lineno(str(self._root / path))
        found: dict[str, dict[str, float]] = {}
        for name in {name for line in lines for name in by_line.get(line, ())}:
            head, _, phase = name.rpartition("|")
            file = head.partition("::")[0]
            if self.records(file):
                tests = self._tests[file] if phase == "setup" else (plain(head),)
                found.setdefault(file, {}).update((t, self.seconds.get(t, 0.0)) for t in tests)
        return found


def lines_of(source: str, line: int) -> frozenset[int]:
    """What has to be executed for a change of a line to act: of a line in a function its statement,
    of another nothing but the import.  Errors: SyntaxError where it cannot be parsed."""
    holding = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or node.lineno)
    ]
    functions = [
        node for node in holding if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    if not functions or any(line < node.body[0].lineno for node in functions):
        return frozenset()
    inner = max(holding, key=lambda node: (node.lineno, node.col_offset))
    body: list[ast.stmt] = getattr(inner, "body", [])  # of an if, a loop: it is not the line's
    last = body[0].lineno - 1 if body else inner.end_lineno or line
    return frozenset(range(inner.lineno, max(last, line) + 1))


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else ""


# --- recording ------------------------------------------------------------------------------------


def record(root: Path, jobs: int, tests: tuple[str, ...] = ()) -> Path:
    """Run tests, those of `make test` unless others are named; the folder of what is found.

    Errors: CalledProcessError where they could not be run; tests may fail.
    """
    folder = root / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    source = str(root / "src")
    environment = {
        **os.environ,
        _RECORDING: str(folder / "seconds.json"),
        "COVERAGE_FILE": str(folder / "lines"),
        "PYTHONPATH": os.pathsep.join((source, str(Path(__file__).parent))),
    }
    command = [sys.executable, "-m", "pytest", "-q", "-p", Path(__file__).stem]
    command += [f"--cov={source}", "--cov-context=test", "--cov-report=", "--cov-config=/dev/null"]
    command += ["-m", "not long and not later", "-n", str(jobs), *_WORKERS, *tests]
    done = subprocess.run(command, cwd=root, env=environment, stdout=subprocess.DEVNULL)
    if done.returncode not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        raise subprocess.CalledProcessError(done.returncode, command)
    seconds = json.loads((folder / "seconds.json").read_text(encoding="utf-8"))
    files = [*(root / "src").rglob("*.py"), *(root / "tests").rglob("*.py")]
    digests = {str(file.relative_to(root)): _digest(file) for file in files}
    known = json.dumps({"digests": digests, "seconds": seconds})
    (folder / "known.json").write_text(known, encoding="utf-8")
    return folder


class _ProcessorTime:
    """Gives every phase of a test the processor time that it took, its processes' included, as its
    duration: a mutant's tests share such time, and a busy computer makes no test slow."""

    def __init__(self) -> None:
        self._begun_s = 0.0

    def pytest_runtest_logstart(self) -> None:
        """Before its first phase."""
        self._begun_s = used_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """After each phase."""
        report = yield
        now_s = used_s()
        report.duration, self._begun_s = now_s - self._begun_s, now_s
        return report


def used_s() -> float:
    """Processor time of this process and of those that it has waited for."""
    return sum(os.times()[:4])


class _Recorder:
    """Notes how long each test takes that passes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seconds: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """What it is set up with counts, too: whoever runs it alone needs it."""
        test = plain(report.nodeid)
        if report.failed:
            self._seconds.pop(test, None)
        elif report.when == "setup" or test in self._seconds:
            self._seconds[test] = self._seconds.get(test, 0.0) + report.duration

    def pytest_sessionfinish(self) -> None:
        """Writes them down."""
        self._path.write_text(json.dumps(self._seconds), encoding="utf-8")


def plain(test: str) -> str:
    """A test's name without the group that xdist writes behind it."""
    name, at, group = test.rpartition("@")
    return name if at and "]" not in group else test


def pytest_configure(config: pytest.Config) -> None:
    """As mutants are judged: without what is hidden; the first process writes."""
    path = os.environ.get(_RECORDING)
    if path is None:
        return
    sys.modules[HIDDEN] = None  # type: ignore[assignment]
    config.pluginmanager.register(_ProcessorTime())
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(_Recorder(Path(path)))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Without the tests that judge no mutant."""
    if _RECORDING not in os.environ:
        return
    out: list[Any] = [item for item in items if left_out(item)]
    items[:] = [item for item in items if not left_out(item)]
    config.hook.pytest_deselected(items=out)


def left_out(item: pytest.Item) -> bool:
    """Whether a test is of a group that needs the clock on the wall."""
    groups = [mark.args[0] for mark in item.iter_markers("xdist_group")]
    return any(group in LEFT_OUT for group in groups)

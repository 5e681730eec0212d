"""Tries mutants: each in a process and a copy of the project of its own, until a test fails.

The copies are whole, so that processes that tests start fly the mutant too.  A mutant that cannot
be imported, and one that never ends, count as noticed.  A test that fails in the unchanged copy as
well notices nothing: it is left out from then on.

A mutant's tests share its processor time.  So for half of it those that are known to take long
wait, whatever their file, as one file of long tests would leave nothing to the others; one of which
that is only found is cut short.  And numba is hidden: tests that compile kernels, which takes
minutes for each mutant, skip themselves, and the others of their files run.
"""

from __future__ import annotations

import json
import os
import re
import resource
import runpy
import shutil
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

import pytest
from mutation_reach import HIDDEN, Reach, left_out, lines_of, used_s
from mutations import Mutation, changed
from tests_reaching import Imports, mirrors, names_at

BUDGET_S: Final = 30.0  # processor time for a mutant's tests, its processes' included
PROGRESS: Final = 10  # mutants from one line of progress to the next
LOOPING_S: Final = 60.0  # processor time beyond it: no test takes as much
HANGING_S: Final = 300.0  # on the clock, for a mutant that waits forever
SLOW_S: Final = 1.0  # a test that takes longer waits for those that take less
QUICK_S: Final = 2.0  # all tests of a file together, and fifteen such files have their turn
CUT_S: Final = 3.0  # processor time at which one is cut short while others wait for it
# Loaded once, before a process is split off for each mutant: what the tests load but for us.
AHEAD: Final = (
    *("numpy", "scipy.optimize", "scipy.signal", "scipy.spatial", "hypothesis", "typer.testing"),
    *("pymavlink.dialects.v20.ardupilotmega", "pymavlink.mavutil", "msgspec", "rich.console"),
)
_ANSWER: Final = ".mutant-answer"
_SLOW: Final = ".mutant-slow"


class Mutant(NamedTuple):
    """One change of one file (relative to the project)."""

    path: Path
    change: Mutation


class Tried(NamedTuple):
    """A file of tests to be run."""

    file: str
    only: frozenset[str] = frozenset()  # these of its tests; empty: all
    but: frozenset[str] = frozenset()  # without these


class Verdict(NamedTuple):
    """Whether a test failed with the mutant, and which (none: it hung, or the process died)."""

    noticed: bool
    by: str


# --- in the process of one mutant ----------------------------------------------------------------


class _Watch:
    """Stops at the first failure or when the time is used up, and knows which it was."""

    def __init__(self, broken: frozenset[str], slow: Mapping[str, float], stem: str) -> None:
        self.failed = ""
        self.is_over = False
        self.slow = dict(slow)  # tests, and how long they take [s]
        self.tried = Tried("")
        self.until_s = 0.0  # processor time
        self.is_slow_turn = False  # those that are known to take long, or the others
        self._waiting = set(slow)  # for the slow turn: known ones, and those cut short
        self._stem = stem
        self._broken = broken

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """Tests that may judge a mutant."""
        kept: list[pytest.Item] = []
        others: list[pytest.Item] = []
        for item in items:
            is_out = item.nodeid in self._broken or left_out(item)
            is_out |= item.nodeid in self.tried.but
            is_out |= bool(self.tried.only) and item.nodeid not in self.tried.only
            is_out |= self.is_slow_turn == (item.nodeid not in self._waiting)
            (others if is_out else kept).append(item)
        items[:] = sorted(kept, key=self._turn)
        config.hook.pytest_deselected(items=others)

    def _turn(self, item: pytest.Item) -> tuple[bool, float]:
        """Those named after the file that was changed come first, what takes long last."""
        is_named = re.search(rf"(?<![a-z]){self._stem}(?![a-z])", item.name) is not None
        return not is_named, self.slow.get(item.nodeid, 0.0)

    def has_slow(self, file: str) -> bool:
        """Whether any test of a file is known to take long."""
        return any(test.partition("::")[0] == file for test in self._waiting)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Cuts a test short that takes long while others wait."""

        def cut(_number: int, _frame: object) -> None:
            self._waiting.add(item.nodeid)
            self.slow.setdefault(item.nodeid, CUT_S)
            pytest.skip("it takes long: others first")

        signal.signal(signal.SIGPROF, cut)
        signal.setitimer(signal.ITIMER_PROF, 0.0 if self.is_slow_turn else CUT_S)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """What a test that was cut short leaves, such as a fixture that misses something, says
        nothing."""
        report = yield
        if report.failed and item.nodeid in self._waiting and not self.is_slow_turn:
            report.outcome, report.longrepr = "skipped", (str(item.path), 0, "it was cut short")
        return report

    def pytest_runtest_logfinish(self) -> None:
        """Ends the run once the time is used up."""
        self.is_over = used_s() > self.until_s
        if self.is_over and not self.failed:
            pytest.exit("the mutant's time is used up", returncode=0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Remembers the first failure, and what takes long."""
        if report.failed and not self.failed:
            self.failed = report.nodeid
        elif report.passed and report.duration > SLOW_S:
            self.slow.setdefault(report.nodeid, report.duration)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """A file of tests that cannot be imported is a failure too."""
        if report.failed and not self.failed:
            self.failed = report.nodeid


def _judge(
    tests: list[Tried],
    budget_s: float,
    broken: frozenset[str],
    slow: Mapping[str, float],
    stem: str,
) -> str:
    """Run tests here, one file after the other: the first that fails, or none."""
    source = str(Path("src").absolute())
    sys.path.insert(0, source)
    os.environ["PYTHONPATH"] = source
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    sys.modules[HIDDEN] = None  # type: ignore[assignment]  # whoever looks for it finds none
    watch = _Watch(broken, slow, stem)
    began_s = used_s()
    sound = [test for test in tests if test.file not in broken]
    halfway = _run(watch, sound, began_s + 0.5 * budget_s, is_slow_turn=False)
    if watch.failed:
        return watch.failed
    long = [test for test in sound if watch.has_slow(test.file)]
    _run(watch, long, began_s + budget_s, is_slow_turn=True)
    if not watch.failed and not watch.is_over:
        _run(watch, sound[halfway:], began_s + budget_s, is_slow_turn=False)
    return watch.failed


def _run(watch: _Watch, tests: Sequence[Tried], until_s: float, *, is_slow_turn: bool) -> int:
    """Run tests until one fails or until that processor time; how many files were run whole."""
    watch.until_s, watch.is_slow_turn, watch.is_over = until_s, is_slow_turn, False
    for count, test in enumerate(tests):
        watch.tried = test
        options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly"]
        code = pytest.main([*options, test.file], plugins=[watch])
        known = (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
        Path(_SLOW).write_text(json.dumps(watch.slow), encoding="utf-8")
        if watch.failed or code not in known:
            watch.failed = watch.failed or test.file
            return count
        if watch.is_over:
            return count
    return len(tests)


def started(
    folder: Path,
    tests: list[Tried],
    budget_s: float = BUDGET_S,
    broken: frozenset[str] = frozenset(),
    slow: Mapping[str, float] = MappingProxyType({}),
    stem: str = "no file",
) -> int:
    """A process of its own that runs tests in a copy of the project; `finished` knows the rest.

    slow: tests that are known to take long, and how long [s].  stem: of the file that is changed.
    """
    for name in (_ANSWER, _SLOW):
        (folder / name).unlink(missing_ok=True)
    child = os.fork()
    if child == 0:
        try:
            os.setsid()
            most_s = int(budget_s + LOOPING_S)
            resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s))
            quiet = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(quiet, stream)
            os.chdir(folder)
            failed = _judge(tests, budget_s, broken, slow, stem)
            (folder / _ANSWER).write_text(failed, encoding="utf-8")
        finally:
            os._exit(0)
    return child


def finished(child: int, folder: Path) -> Verdict:
    """What a process that has ended found out; what it left running is ended too."""
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    try:
        failed = (folder / _ANSWER).read_text(encoding="utf-8")
    except FileNotFoundError:
        return Verdict(True, "")  # it hung, or it died
    return Verdict(bool(failed), failed)


def found_slow(folder: Path) -> dict[str, float]:
    """Tests that a process found to take long, with what others reported to it."""
    try:
        found: dict[str, float] = json.loads((folder / _SLOW).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):  # it ended early
        return {}
    return found


# --- copies of the project ------------------------------------------------------------------------


def copied(root: Path, folder: Path) -> Path:
    """The project's files as they are now, in another folder."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name)
    # A changed source must never be taken for the old one, though its time be the same.
    compiling = [*("-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "src")]
    subprocess.run([sys.executable, *compiling], cwd=folder, check=True)
    return folder


class Workshop:
    """Copies of the project in which mutants are tried, as many at a time as there are copies."""

    def __init__(
        self,
        root: Path,
        folders: list[Path],
        report: Callable[[str], None],
        budget_s: float = BUDGET_S,
        reach: Reach | None = None,
    ) -> None:
        for name in AHEAD:
            with suppress(ImportError):
                import_module(name)
        self._root = root
        self._imports = Imports(root)
        self._free = folders
        self._budget_s = budget_s
        self._report = report
        self._reach = reach
        self._running: dict[int, tuple[Path, Mutant, float]] = {}  # with the time of its end
        self._sound: set[str] = set()
        self._broken: set[str] = set()
        self._last = not_quick(root)
        self._slow: dict[str, float] = {}
        if reach is not None:
            self._slow = {test: s for test, s in reach.seconds.items() if s > SLOW_S}
        self.verdicts: dict[Mutant, Verdict] = {}

    def try_all(self, mutants: list[Mutant]) -> None:
        """Verdicts on all of them; those that nothing notices are reported as they come."""
        waiting = deque(mutants)
        try:
            while waiting or self._running:
                while waiting and self._free:
                    self._start(waiting.popleft())
                if again := self._end(self._next_ended()):
                    waiting.appendleft(again)
        finally:  # interrupted, perhaps
            for child in self._running:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)

    def _next_ended(self) -> int:
        """The next process that ends, or that is ended as its time on the clock is over."""
        while True:
            for child, (_folder, _mutant, until_s) in self._running.items():
                if time.monotonic() > until_s:
                    os.killpg(child, signal.SIGKILL)
                if os.waitpid(child, os.WNOHANG)[0]:
                    return child
            time.sleep(0.02)

    def _start(self, mutant: Mutant) -> None:
        folder = self._free.pop()
        source = (self._root / mutant.path).read_text(encoding="utf-8")
        (folder / mutant.path).write_text(changed(source, mutant.change), encoding="utf-8")
        tests = self._tests_of(mutant, source)
        broken, stem = frozenset(self._broken), mutant.path.stem
        child = started(folder, tests, self._budget_s, broken, self._slow, stem)
        self._running[child] = folder, mutant, time.monotonic() + HANGING_S

    def _tests_of(self, mutant: Mutant, source: str) -> list[Tried]:
        """What is run, in that order: by what was recorded, where the file is as it was then."""
        names = names_at(source, mutant.change.line)
        order = self._imports.tests_of(mutant.path, names)
        lines = lines_of(source, mutant.change.line)
        if self._reach is None or not self._reach.knows(mutant.path):
            # Those that are not quick would use all of the time up.
            return [Tried(file) for file in sorted(map(str, order), key=self._last.__contains__)]
        if lines:
            return in_order(self._reach, mutant.path, lines, order, self._last)
        return quick_first(self._reach, mutant.path, order)

    def _end(self, child: int) -> Mutant | None:
        """Takes the verdict; the mutant, if it is to be tried again."""
        folder, mutant, _until_s = self._running.pop(child)
        verdict = finished(child, folder)
        if verdict.by or not verdict.noticed:  # of one that hung nothing is known
            self._slow |= found_slow(folder)
        shutil.copy2(self._root / mutant.path, folder / mutant.path)
        sound = not verdict.by or self._is_sound(verdict.by, folder)
        self._free.append(folder)
        if not sound:
            return mutant
        self.verdicts[mutant] = verdict
        if not verdict.noticed:
            self._report(described(mutant, self._root))
        if len(self.verdicts) % PROGRESS == 0:
            noticed = sum(each.noticed for each in self.verdicts.values())
            self._report(f"{noticed} of {len(self.verdicts)} so far")
        return None

    def _is_sound(self, test: str, folder: Path) -> bool:
        """Whether a test passes in the unchanged copy."""
        if test not in self._sound | self._broken:
            file = test.partition("::")[0]
            child = started(folder, [Tried(file, frozenset({test} - {file}))])
            os.waitpid(child, 0)
            kind = self._broken if finished(child, folder).noticed else self._sound
            kind.add(test)
            if kind is self._broken:
                self._report(f"{test} fails in the unchanged source: left out")
        return test in self._sound


def not_quick(root: Path) -> frozenset[str]:
    """Files of tests that `make test` leaves out, as tests/slow_tests.py of a project has them."""
    listed = root / "tests/slow_tests.py"
    files = runpy.run_path(str(listed))["PART_OF"] if listed.is_file() else ()
    return frozenset(f"tests/{file}" for file in files)


def in_order(
    reach: Reach,
    path: Path,
    lines: frozenset[int],
    order: Sequence[Path],
    last: frozenset[str] = frozenset(),
) -> list[Tried]:
    """Tests that execute lines of a function, by file: first the quick files that mirror it, then
    by the time that those of a file take, then files that are not recorded, those that mirror it
    before others, then those that are not quick.  At last the other tests of these files, as
    something may be computed once for several.

    order: all files of tests that reach the file by imports, the nearest first.  last: those that
    are not quick.
    """
    at = reach.tests_at(path, lines)
    unknown = [file for file in map(str, order) if not reach.records(file)]

    def turn(file: str) -> tuple[bool, bool, bool, bool, float]:
        seconds = sum(at.get(file, {}).values())
        its_own, is_quick = mirrors(Path(file).stem, path.stem), file not in last
        first = its_own and is_quick
        return not (its_own or is_quick), not first, file not in at, not its_own, seconds

    return [
        *(
            Tried(file, only=frozenset(at.get(file, ())))
            for file in sorted((*at, *unknown), key=turn)
        ),
        *(Tried(file, but=frozenset(at[file])) for file in sorted(at, key=turn)),
    ]


def quick_first(reach: Reach, path: Path, order: Sequence[Path]) -> list[Tried]:
    """Tests of a line that is executed where its module is imported: first the files that mirror
    it, then those that take little, then the others.

    order: as for `in_order`, which it is within each of these.
    """

    def turn(file: str) -> int:
        if mirrors(Path(file).stem, path.stem):
            return 0
        return 1 if reach.whole_s(file) <= QUICK_S else 2

    return [Tried(file) for file in sorted(map(str, order), key=turn)]


def described(mutant: Mutant, root: Path) -> str:
    """File, line, change, and the line as it stands."""
    line = (root / mutant.path).read_text(encoding="utf-8").splitlines()[mutant.change.line - 1]
    return f"{mutant.path}:{mutant.change.line}: {mutant.change.words}    [{line.strip()}]"

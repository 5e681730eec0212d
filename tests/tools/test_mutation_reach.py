"""What is recorded of tests and lines, and in which order tests are tried by it."""

from __future__ import annotations

import subprocess
import sys
from math import inf
from pathlib import Path

import pytest
from mutant_trials import Tried, in_order, not_quick, quick_first
from mutation_reach import FOLDER, Reach, lines_of, plain, record

SOURCE = """\
MOST = 4.0


class Box:
    wide: float = 2.0

    def holds(self, x):
        if x > self.wide:
            return False
        return x < MOST


def doubled(x: float, by: float = 2.0):
    return (
        x
        * by
    )
"""
TEST_OF_BOX = """\
import subprocess
import sys
import time
import pytest
from tgl_soar.box import Box

BUSY = "import time\\nwhile time.process_time() < 0.4: pass"

@pytest.fixture(scope="module")
def held():
    return Box().holds(1.0)

def test_first(held):
    subprocess.run([sys.executable, "-c", BUSY], check=True)

def test_second(held):
    assert held

def test_wide():
    assert not Box().holds(3.0)

def test_nothing():
    time.sleep(0.4)
"""
TEST_OF_DOUBLED = """\
import pytest
from tgl_soar.box import doubled, Box

@pytest.mark.parametrize("x", [1.0, 2.0])
def test_doubled(x):
    assert doubled(x) == 2.0 * x

def test_box():
    assert Box().holds(0.5)

@pytest.mark.xdist_group("real time")
def test_of_real_time():
    assert doubled(1.0) == 2.0
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package of one module, with what was recorded of its tests."""
    root = tmp_path_factory.mktemp("project")
    for name, text in {
        "src/tgl_soar/__init__.py": "",
        "src/tgl_soar/box.py": SOURCE,
        "tests/test_box.py": TEST_OF_BOX,
        "tests/test_doubled.py": TEST_OF_DOUBLED,
        "pyproject.toml": "[tool.pytest.ini_options]\ntestpaths = ['tests']\n"
        "markers = ['long', 'later']\n",
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    record(root, 1)
    return root


BOX, OF_BOX, OF_DOUBLED = Path("src/tgl_soar/box.py"), "tests/test_box.py", "tests/test_doubled.py"
DOUBLED = {f"{OF_DOUBLED}::test_doubled[{x}]" for x in ("1.0", "2.0")}


@pytest.fixture
def reach(project: Path) -> Reach:
    return Reach(project, project / FOLDER)


def test_a_line_is_executed_by_the_tests_that_execute_it(reach: Reach) -> None:
    assert reach.knows(BOX)
    doubled = reach.tests_at(BOX, frozenset((14, 15, 16)))
    assert {file: set(tests) for file, tests in doubled.items()} == {OF_DOUBLED: DOUBLED}
    wide = reach.tests_at(BOX, frozenset((9,)))
    assert {file: set(tests) for file, tests in wide.items()} == {OF_BOX: {f"{OF_BOX}::test_wide"}}
    # What a fixture executes that several tests share is any test's of that file.
    held = reach.tests_at(BOX, frozenset((10,)))
    assert len(held[OF_BOX]) == 4
    assert set(held[OF_DOUBLED]) == {f"{OF_DOUBLED}::test_box"}
    # Processor time counts, of processes that a test starts too, and no waiting.
    assert held[OF_BOX][f"{OF_BOX}::test_first"] >= 0.35  # counted in hundredths
    assert held[OF_BOX][f"{OF_BOX}::test_nothing"] < 0.3
    assert not any("real_time" in test for test in reach.seconds)


def test_what_acts_with_a_line_is_its_statement() -> None:
    assert lines_of(SOURCE, 15) == frozenset((14, 15, 16, 17))
    assert lines_of(SOURCE, 8) == frozenset((8,))  # an if is not what it guards
    assert lines_of(SOURCE, 9) == frozenset((9,))
    for of_the_module in (1, 2, 5, 13):  # a constant, nothing, a field, a default
        assert lines_of(SOURCE, of_the_module) == frozenset()


def test_those_that_execute_a_line_come_first(reach: Reach) -> None:
    order = [Path("tests/test_new.py"), Path(OF_DOUBLED), Path(OF_BOX)]
    inside = in_order(reach, BOX, lines_of(SOURCE, 15), order)
    assert inside == [
        Tried(OF_DOUBLED, only=frozenset(DOUBLED)),
        Tried("tests/test_new.py"),  # nothing is known of it
        Tried(OF_DOUBLED, but=frozenset(DOUBLED)),
    ]


def test_files_that_mirror_the_module_come_first_and_those_that_are_not_quick_last(
    reach: Reach,
) -> None:
    numbers, another = f"tests/test_{BOX.stem}_numbers.py", f"tests/test_{BOX.stem}es.py"
    slow = f"tests/test_{BOX.stem}_flights.py"
    order = [Path(file) for file in (another, OF_DOUBLED, slow, numbers)]
    line, late = lines_of(SOURCE, 15), frozenset((OF_DOUBLED, slow))
    tried = in_order(reach, BOX, line, order, late)
    assert [test.file for test in tried] == [numbers, slow, another, OF_DOUBLED, OF_DOUBLED]
    # One that mirrors it waits for the quick ones that are known to execute the line.
    tried = in_order(reach, BOX, line, order, frozenset((slow,)))
    assert [test.file for test in tried] == [numbers, OF_DOUBLED, slow, another, OF_DOUBLED]


def test_a_constant_is_tried_by_its_own_tests_then_by_those_that_take_little(reach: Reach) -> None:
    assert reach.whole_s(OF_DOUBLED) < 0.3
    assert reach.whole_s(OF_BOX) == sum(
        seconds for test, seconds in reach.seconds.items() if test.startswith(OF_BOX)
    )
    assert reach.whole_s("tests/test_new.py") == inf
    order = [Path(file) for file in ("tests/test_new.py", OF_DOUBLED, OF_BOX)]
    tried = quick_first(reach, BOX, order)
    assert tried == [Tried(OF_BOX), Tried(OF_DOUBLED), Tried("tests/test_new.py")]
    reach.seconds[f"{OF_DOUBLED}::test_box"] = 2.5
    tried = quick_first(reach, BOX, order)
    assert tried == [Tried(OF_BOX), Tried("tests/test_new.py"), Tried(OF_DOUBLED)]


def test_the_files_that_are_not_quick_are_those_of_the_project(project: Path) -> None:
    root = Path(__file__).parents[2]
    last = not_quick(root)
    assert "tests/analysis/rare/test_splitting.py" in last
    assert all((root / file).is_file() for file in last)
    assert not_quick(project) == frozenset()


def test_what_has_changed_since_is_not_known(project: Path, reach: Reach) -> None:
    test = project / OF_DOUBLED
    test.write_text(TEST_OF_DOUBLED + "\n", encoding="utf-8")
    assert not reach.records(OF_DOUBLED)
    assert reach.records(OF_BOX)
    assert OF_DOUBLED not in reach.tests_at(BOX, frozenset((15,)))
    test.write_text(TEST_OF_DOUBLED, encoding="utf-8")
    assert reach.records(OF_DOUBLED)


def test_the_groups_of_xdist_are_no_part_of_a_test() -> None:
    assert plain("tests/a.py::b@real time") == "tests/a.py::b"
    assert plain("tests/a.py::b[x@y]@air/a.py") == "tests/a.py::b[x@y]"
    assert plain("tests/a.py::b[x@y]") == "tests/a.py::b[x@y]"
    assert plain("tests/a.py::b") == "tests/a.py::b"


def test_mutants_are_tried_by_what_is_recorded(project: Path) -> None:
    code = "import sys; from pathlib import Path; from mutate import main; "
    code += "sys.exit(main(sys.argv[1:], Path.cwd()))"
    run = subprocess.run(
        [sys.executable, "-c", code, "--reach", "--sample", "4", "--least", "25"],
        cwd=project,
        env={"PYTHONPATH": str(Path(__file__).parents[2] / "tools"), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.stderr == ""
    assert run.returncode == 0, run.stdout
    assert "recording" not in run.stdout  # it was recorded before
    assert "of 4 mutants noticed" in run.stdout

"""The tool that tries mutants: the tests it runs, what it calls noticed, and its page."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import mutant_trials
import pytest
from mutant_trials import Mutant, Tried, Verdict, described, finished, found_slow, started
from mutants_page import NOT_LOOKED_AT, WRITTEN, page_of, reasons_of
from mutate import all_mutants, named_mutants
from mutations import LEFT_OUT, Mutation, changed
from named_mutants import Named, mutation_of
from tests_reaching import Imports, names_at

ROOT = Path(__file__).parents[2]

LAW = """\
LIMITS = ("low", "high")
MOST = 4.0


def limited(x: float, most: float = MOST) -> float:
    return min(x, most) * 3.0
"""
# It does not test the factor: one change goes unnoticed.
TEST_OF_LAW = """\
import pytest
from tgl_soar.law import LIMITS, limited


def test_it():
    assert LIMITS == ("low", "high")
    assert limited(8.0) / limited(1.0) == 4.0 and limited(1.0) > 1.5


@pytest.mark.xdist_group("real time")
def test_of_real_time():
    assert limited(1.0) == 3.0
"""
TEST_OF_ANOTHER = "import tgl_soar.law\n\n\ndef test_it():\n    assert not tgl_soar.law.LIMITS\n"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package of one law, with a test that looks and one that always fails."""
    root = tmp_path_factory.mktemp("project")
    for name, text in {
        "src/tgl_soar/__init__.py": "",
        "src/tgl_soar/law.py": LAW,
        "tests/test_law.py": TEST_OF_LAW,
        "tests/test_another.py": TEST_OF_ANOTHER,
        "pyproject.toml": "[tool.pytest.ini_options]\ntestpaths = ['tests']\n",
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    return root


def mutate(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The tool at work on another project."""
    code = "import sys; from pathlib import Path; from mutate import main; "
    code += "sys.exit(main(sys.argv[1:], Path.cwd()))"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=project,
        env={**os.environ, "PYTHONPATH": str(ROOT / "tools")},
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_what_goes_unnoticed_is_listed(project: Path) -> None:
    page = project / "page.md"
    run = mutate(project, "--sample", "9", "--least", "84", "--page", str(page))
    assert run.stderr == ""
    assert run.returncode == 1
    lines = run.stdout.splitlines()
    # The test that always fails notices nothing; that of real time is not asked.
    assert "tests/test_another.py::test_it fails in the unchanged source: left out" in lines
    assert [line for line in lines if line.startswith("src")] == [
        "src/tgl_soar/law.py:6: 3.0  ->  6.0    [return min(x, most) * 3.0]",
    ]
    assert lines[-1].startswith("5 of 6 mutants noticed (83.3 %)")
    row = "| `src/tgl_soar/law.py:6` | `3.0  ->  6.0` | `return min(x, most) * 3.0` | {} |\n"
    assert row.format(NOT_LOOKED_AT) in page.read_text()
    assert "| law.py | 6 | 5 |" in page.read_text()
    assert (project / "src/tgl_soar/law.py").read_text() == LAW


def test_those_that_people_made_are_changes_of_the_source_as_it_is() -> None:
    for mutant in named_mutants(ROOT):
        source = (ROOT / mutant.path).read_text(encoding="utf-8")
        assert ast.dump(ast.parse(changed(source, mutant.change))) != ast.dump(ast.parse(source))
        assert (
            changed(source, mutant.change).splitlines()[: mutant.change.line - 1]
            == (source.splitlines()[: mutant.change.line - 1])
        )
    named = Named("a.py", "    b\n    c\n", "", "b and c are left out")
    assert mutation_of(named, "a\n    b\n    c\n").line == 2
    for source in ("a\n", 2 * named.old):
        with pytest.raises(ValueError, match=r"a\.py: \d times '    b"):
            mutation_of(named, source)


def test_a_process_that_gives_no_answer_has_noticed(tmp_path: Path) -> None:
    """It hung and was ended, or the mutant took it down."""
    with subprocess.Popen(["true"], start_new_session=True) as process:
        process.wait()
    assert finished(process.pid, tmp_path) == Verdict(True, "")
    (tmp_path / ".mutant-answer").write_text("")
    assert finished(process.pid, tmp_path) == Verdict(False, "")
    (tmp_path / ".mutant-answer").write_text("tests/a.py::b")
    assert finished(process.pid, tmp_path) == Verdict(True, "tests/a.py::b")


def test_tests_of_a_file_come_nearest_first() -> None:
    imports = Imports(ROOT)
    tests = [str(path) for path in imports.tests_of(Path("src/tgl_soar/control/supervisor.py"))]
    assert tests[:2] == ["tests/control/test_supervisor.py", "tests/sim/test_kept_flights.py"]
    assert "tests/autopilot/test_autopilot.py" in tests  # the autopilot imports it
    assert tests.index("tests/autopilot/test_autopilot.py") < tests.index("tests/cli/test_init.py")
    assert "tests/air/test_hill.py" not in tests  # no way leads there
    orders = imports.tests_of(Path("src/tgl_soar/cli/page/orders.py"))
    first = sorted(str(path) for path in orders[:2])
    assert first == ["tests/cli/page/test_orders.py", "tests/cli/page/test_orders_commands.py"]
    at_the_root = imports.tests_of(Path("src/tgl_soar/autopilot.py"))
    assert at_the_root[0] == Path("tests/autopilot/test_autopilot.py")
    spectra = imports.tests_of(Path("src/tgl_soar/analysis/report/spectra.py"))
    assert Path("tests/sim/test_kept_flights.py") not in spectra
    # Through a helper of tests, and through a package's front door.
    helped = imports.tests_of(Path("src/tgl_soar/onboard/flightlog/writer.py"))
    assert Path("tests/analysis/replay/test_replay.py") in helped


def test_a_module_whose_name_is_put_together_is_imported_all_the_same() -> None:
    """As commands are: their defaults and what they print are tested through the table of them."""
    reached = Imports(ROOT).tests_of(Path("src/tgl_soar/cli/site.py"))
    assert {Path("tests/cli/test_defaults.py"), Path("tests/cli/test_printed.py")} <= {*reached}


def test_a_line_is_known_by_its_names_and_by_what_uses_it() -> None:
    source = """\
LEAST = 3
MOST = LEAST + 1


class Box:
    wide: int = 2

    def __init__(self):
        self.n = MOST

    def holds(self, n):
        return n < self.wide


def _checked(n):
    return Box().holds(n)


def run(n):
    return _checked(n)
"""
    assert names_at(source, 1) == ["LEAST", "MOST", "Box", "_checked", "run"]
    assert names_at(source, 6) == ["wide", "Box", "_checked", "run"]
    assert names_at(source, 9) == ["Box", "_checked", "run"]
    assert names_at(source, 12) == ["holds", "Box", "_checked", "run"]
    assert names_at(source, 20) == ["run"]
    assert names_at(source, 3) == []


def test_a_test_file_that_speaks_of_it_is_nearer(project: Path) -> None:
    """`far` is three imports away and names the constant; `near` is two and names its user."""
    for name, text in {
        "src/tgl_soar/middle.py": "import tgl_soar.law\n",
        "src/tgl_soar/outer.py": "import tgl_soar.middle\n",
        "tests/test_far.py": "import tgl_soar.outer\nMOST = 4.0\n",
        "tests/test_near.py": "import tgl_soar.middle\nlimited = 3\n",
        "tests/test_other.py": "import tgl_soar.middle\n",
    }.items():
        (project / name).write_text(text, encoding="utf-8")
    law = Path("src/tgl_soar/law.py")
    imports = Imports(project)

    def order_of(*names: str) -> list[str]:
        stems = [path.stem for path in imports.tests_of(law, names)]
        assert stems[0] == "test_law"
        return [stem for stem in stems if stem in ("test_far", "test_near", "test_other")]

    assert order_of() == ["test_other", "test_near", "test_far"]
    assert order_of("LIMITS", "limited") == ["test_near", "test_other", "test_far"]
    assert order_of("MOST", "limited") == ["test_far", "test_near", "test_other"]


def test_flights_come_after_what_is_nearest_and_before_the_rest(project: Path) -> None:
    (project / "tests/sim").mkdir()
    for name, text in {
        "src/tgl_soar/flown.py": "import tgl_soar.law\n",
        "tests/sim/test_kept_flights.py": "import tgl_soar.flown\n",
        "tests/test_nearest.py": "import tgl_soar.law\nMOST = 4.0\n",
        "tests/test_further.py": "import tgl_soar.law\n",
    }.items():
        (project / name).write_text(text, encoding="utf-8")
    order = [path.stem for path in Imports(project).tests_of(Path("src/tgl_soar/law.py"), ["MOST"])]
    those = ("test_law", "test_nearest", "test_kept_flights", "test_further")
    assert [stem for stem in order if stem in those] == list(those)


def test_what_takes_long_comes_last_and_nothing_is_compiled(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "test_it.py").write_text("""\
import time
from importlib.util import find_spec

def test_slow():
    time.sleep(1.1)

def test_of_numba():
    assert find_spec("numba") is None

def test_that_fails():
    assert not find_spec("json")
""")
    slow: dict[str, float] = {}
    for found in ({"test_it.py::test_slow"}, set()):  # then it is known, and never begun
        child = started(tmp_path, [Tried("test_it.py")], slow=slow)
        os.waitpid(child, 0)
        assert finished(child, tmp_path).by == "test_it.py::test_that_fails"
        assert found_slow(tmp_path).keys() - slow.keys() == found
        slow = found_slow(tmp_path)
        assert slow["test_it.py::test_slow"] == pytest.approx(1.1, abs=1.0)


def test_a_file_of_long_tests_leaves_time_to_the_others(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "test_that_takes_long.py").write_text("""\
import time

def test_long():
    until = time.process_time() + 2.0
    while time.process_time() < until:
        pass

def test_of_this_file_too():
    pass
""")
    (tmp_path / "test_that_takes_none.py").write_text("def test_that_fails(): assert False\n")
    tests = [Tried("test_that_takes_long.py"), Tried("test_that_takes_none.py")]
    noticed = []
    for slow in ({}, {"test_that_takes_long.py::test_long": 2.0}):
        child = started(tmp_path, tests, budget_s=1.5, slow=slow)
        os.waitpid(child, 0)
        noticed.append(finished(child, tmp_path).by)
    assert noticed == ["", "test_that_takes_none.py::test_that_fails"]


def test_a_test_of_which_it_is_only_found_is_cut_short_and_has_its_turn_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Burns a second where half of three is to be had, before the others and in its own turn."""
    monkeypatch.setattr(mutant_trials, "CUT_S", 0.2)
    (tmp_path / "src").mkdir()
    long = tmp_path / "test_that_takes_long.py"
    body = """\
import time
import pytest

@pytest.fixture
def whole():
    ended = []
    yield ended
    assert ended

def test_long(whole):
    until = time.process_time() + 1.0
    while time.process_time() < until:
        pass
    whole.append(True)
    assert {0}
"""
    tests = [Tried("test_that_takes_long.py"), Tried("test_that_takes_none.py")]
    for long_holds, other_holds, by in (
        (True, False, "test_that_takes_none.py::test_it"),
        (False, True, "test_that_takes_long.py::test_long"),
        (True, True, ""),
    ):
        long.write_text(body.format(long_holds))
        (tmp_path / "test_that_takes_none.py").write_text(f"def test_it(): assert {other_holds}\n")
        child = started(tmp_path, tests, budget_s=3.0)
        os.waitpid(child, 0)
        assert finished(child, tmp_path).by == by
        assert found_slow(tmp_path) == {"test_that_takes_long.py::test_long": 0.2}


def test_what_takes_long_is_tried_before_the_time_is_over(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    body = "def test_{0}():\n    until = time.process_time() + 0.4\n"
    body += "    while time.process_time() < until:\n        pass\n    {1}\n\n"
    (tmp_path / "test_that_takes_long.py").write_text(
        "import time\n\n" + body.format("long", "assert False")
    )
    (tmp_path / "test_twenty_tries.py").write_text(
        "import time\n\n" + "".join(body.format(n, "pass") for n in range(20))
    )
    tests = [Tried("test_twenty_tries.py"), Tried("test_that_takes_long.py")]
    for slow, by in (
        ({}, ""),
        ({"test_that_takes_long.py::test_long": 0.4}, "test_that_takes_long.py::test_long"),
    ):
        child = started(tmp_path, tests, budget_s=4.0, slow=slow)
        os.waitpid(child, 0)
        assert finished(child, tmp_path).by == by


def test_what_is_named_after_the_changed_file_comes_first(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "test_it.py").write_text("""\
import pytest

@pytest.mark.parametrize("n", [1, 2, 3], ids=["slow-wind", "winding", "x-wind"])
def test_it(n):
    assert n == 1
""")
    for stem, first in (("winding", "winding"), ("wind", "x-wind"), ("law", "winding")):
        child = started(tmp_path, [Tried("test_it.py")], stem=stem)
        os.waitpid(child, 0)
        assert finished(child, tmp_path).by == f"test_it.py::test_it[{first}]"


def test_the_places_are_files_and_folders(project: Path) -> None:
    of_file = all_mutants(project, [Path("src/tgl_soar/law.py")])
    of_both = all_mutants(project, [Path("src"), Path("tests/test_law.py")])
    assert {mutant.path.name for mutant in of_file} == {"law.py"}
    assert {mutant.path.name for mutant in of_both} == {"law.py", "test_law.py"}
    assert set(of_file) < set(of_both)


def test_a_page_counts_by_folder_and_keeps_its_reasons(project: Path) -> None:
    change = Mutation(line=2, start=0, end=0, text="", words="a | b  ->  a & b")
    mutants = [Mutant(Path("src/tgl_soar/law.py"), change._replace(line=n)) for n in (1, 2)]
    verdicts = dict(zip(mutants, (Verdict(True, "t"), Verdict(False, "")), strict=True))
    page = page_of(verdicts, 77, 5, project, "")
    assert "tried 2, drawn with seed 5 from all 77 that" in " ".join(page.split())
    assert "notice 1 (50.0 %)" in " ".join(page.split())
    assert "| law.py | 2 | 1 |" in page
    assert all(f"- {kind}" in page for kind in LEFT_OUT)
    key = ("src/tgl_soar/law.py", "`a | b  ->  a & b`", "`MOST = 4.0`")
    assert reasons_of(page) == {key: NOT_LOOKED_AT}
    # A reason is written; the line moves, and the reason goes along.
    explained = page.replace(NOT_LOOKED_AT, "x \\| y is z").replace("law.py:2`", "law.py:7`")
    assert reasons_of(page_of(verdicts, 77, 5, project, explained)) == {key: "x | y is z"}
    behind = f"{WRITTEN}\nMade by hand:\n\n| of | noticed |\n|---|---|\n| `law.py` | 3 |\n"
    again = page_of(verdicts, 77, 5, project, explained + behind)
    assert again.endswith(behind)
    assert page_of(verdicts, 77, 5, project, again) == again
    assert described(mutants[1], project).endswith("law.py:2: a | b  ->  a & b    [MOST = 4.0]")

"""The tests of a module are where the module is: `tests/` has the folders of `src/tgl_soar/`."""

from __future__ import annotations

from pathlib import Path

import drawn
import pytest
from conftest import ONE_WORKER
from slow_tests import PARTS
from tests_reaching import KEPT

import tgl_soar

SOURCE = Path(tgl_soar.__file__).parent
TESTS = Path(__file__).parent

# Folders of tests that are no folder of the source, and whose tests they hold.
OTHERS = {
    "autopilot": "of `autopilot.py`: one module, and a tick that everything takes part in",
    "benchmarks": "of `benchmarks/`",
    "docs": "of the pages",
    "fuzz": "of everything that reads, whatever part it belongs to",
    "peers": "with other people's programs",
    "tools": "of `tools/`",
}
# Folders of the source whose tests are elsewhere, and where: none.
ELSEWHERE: dict[str, str] = {}


def folders(root: Path, pattern: str) -> set[str]:
    """Folders below the root that have such files, by their paths below it."""
    found = {file.parent.relative_to(root).as_posix() for file in root.rglob(pattern)}
    return {name for name in found if name != "."}


def out_of_place(source: Path, tests: Path, others: set[str], elsewhere: set[str]) -> list[str]:
    """Folders of tests that mirror nothing, folders of the source that have none, and exceptions
    that are none any more."""
    modules = folders(source, "[!_]*.py")
    there, tested = folders(tests, "*.py"), folders(tests, "test_*.py")
    return sorted(
        [
            *(f"tests/{name}: no such folder in the source" for name in there - modules - others),
            *(f"{name}: it has no folder of tests" for name in modules - tested - elsewhere),
            *(f"tests/{name}: no exception" for name in others - (there - modules)),
            *(f"{name}: no exception" for name in elsewhere - (modules - tested)),
        ]
    )


def test_the_tests_of_a_module_are_in_the_folder_of_its_name() -> None:
    assert out_of_place(SOURCE, TESTS, {*OTHERS}, {*ELSEWHERE}) == []


@pytest.mark.parametrize(
    ("file", "wrong"),
    [
        ("tests/link/test_session.py", []),
        ("tests/link/natnet/test_clock.py", ["tests/link/natnet: no such folder in the source"]),
        ("tests/lnk/helper.py", ["tests/lnk: no such folder in the source"]),
        ("source/link/checks/surface.py", ["link/checks: it has no folder of tests"]),
        ("source/link/checks/__init__.py", []),
        ("source/peers/mavsdk.py", ["tests/peers: no exception"]),
        ("tests/sim/test_world.py", ["sim: no exception"]),
    ],
)
def test_a_folder_out_of_place_is_found(tmp_path: Path, file: str, wrong: list[str]) -> None:
    sources = ("source/link/session.py", "source/sim/world.py", "source/types.py")
    tests = ("tests/link/test_decoder.py", "tests/peers/test_mavsdk.py", "tests/conftest.py")
    for name in (*sources, *tests, file):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert out_of_place(tmp_path / "source", tmp_path / "tests", {"peers"}, {"sim"}) == wrong


def test_an_exception_for_what_is_not_there_is_found(tmp_path: Path) -> None:
    found = out_of_place(tmp_path / "source", tmp_path / "tests", {"peers"}, {"sim"})
    assert found == ["sim: no exception", "tests/peers: no exception"]


def test_no_two_files_have_one_name() -> None:
    """Tests import one another's helpers by their bare names."""
    names = [file.name for file in TESTS.rglob("*.py")]
    assert sorted({name for name in names if names.count(name) > 1}) == []


@pytest.mark.parametrize(
    ("table", "files"),
    [
        ("tests/slow_tests.py", [file for files in PARTS.values() for file in files]),
        ("tests/conftest.py", [file for files in ONE_WORKER.values() for file in files]),
        ("tests/analysis/drawn.py", [f"analysis/{file}" for file in drawn.FILES]),
        ("tools/tests_reaching.py", [path.relative_to("tests").as_posix() for path in KEPT]),
    ],
)
def test_every_file_of_a_table_is_there(table: str, files: list[str]) -> None:
    missing = [file for file in files if not (TESTS / file).is_file()]
    assert files
    assert missing == [], f"moved: correct {table}"

"""docs/architecture.md is held against the source: doors, imports, modes, numbers and names."""

from __future__ import annotations

import ast
import inspect
import re
from functools import cache
from pathlib import Path

from test_architecture import DOORS, FLIES, TABLE, permitted

from tgl_soar.control.supervisor import TRANSITIONS
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.onboard import native, realtime, watchdog
from tgl_soar.onboard.surface_control import RELEASE_FRAMES
from tgl_soar.sim.world_step import world_step

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "tgl_soar"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    """What stands under a heading, up to the next one of any level."""
    _, found, rest = PAGE.partition(f"# {heading}\n")
    assert found, f"no heading {heading!r}"
    return re.split(r"(?m)^#+ ", rest)[0]


def diagram(heading: str) -> str:
    (only,) = re.findall(r"(?ms)^```mermaid\n(.*?)^```$", section(heading))
    return str(only)


def first_cells(heading: str) -> list[tuple[str, str]]:
    """The first two cells of every row of a section's only table."""
    rows = re.findall(r"(?m)^\| (.*?) \|(.*)\|$", section(heading))
    return [(name.strip("`"), rest) for name, rest in rows if name.startswith("`")]


def test_the_parts_stand_on_the_page_those_that_fly_first() -> None:
    named = [re.sub(r"(\.py|/)$", "", name) for name, _ in first_cells("The thirteen parts")]
    assert len(named) == len(DOORS) == 13
    assert set(named) == DOORS
    assert set(named[: len(FLIES)]) == FLIES


def test_the_rows_of_imports_are_those_that_are_asserted() -> None:
    stated = {
        room: set(re.findall(r"`([\w.]+)`", rest))
        for room, rest in first_cells("Who may import whom")
    }
    assert stated == TABLE


# config.files, with whose gains are flown: above the laws, which seek gains for what it reads.
FILES = "files"


def box(unit: str) -> str:
    is_files = unit in ("config.files", "config.flown_gains")
    return FILES if is_files else unit.split(".")[0]


def test_the_arrows_of_imports_lead_where_the_rows_lead() -> None:
    arrows = re.findall(r"(\w+) --> (\w+)", diagram("Who may import whom"))
    drawn: dict[str, set[str]] = {door: set() for door in (*DOORS, FILES)}
    for door, below in arrows:
        drawn[door].add(below)

    def reached(door: str) -> set[str]:
        return set().union(*({below} | reached(below) for below in drawn[door]))

    for door in drawn:
        units = [unit for unit in TABLE if box(unit) == door]
        allowed = {box(below) for unit in units for below in permitted(unit)}
        assert drawn[door] <= allowed, door
        assert reached(door) | {door} >= allowed, f"{door}: an arrow is missing"


def test_the_modes_change_as_in_the_supervisors_table() -> None:
    states = diagram("The modes").replace("breaking_off", "breaking off")
    drawn = re.findall(r"(?m)^    ([\w ]+) --> ([\w ]+):", states)
    rows = {(MODE_NAMES[row.source], MODE_NAMES[row.to]) for row in TRANSITIONS}
    assert len(drawn) == len(set(drawn))
    assert set(drawn) == rows
    assert f"[*] --> {MODE_NAMES[0]}" in diagram("The modes")


def test_every_mode_has_its_branch_in_the_tick() -> None:
    branches = re.findall(r'decide -- "(.*?)"', diagram("One tick"))
    assert sorted(", ".join(branches).split(", ")) == sorted(MODE_NAMES)


def test_a_step_of_the_world_is_drawn_in_the_order_of_its_calls() -> None:
    drawn = diagram("One step of the world")
    boxes = dict(re.findall(r'(?m)^    (\w+)\["(.*?)"\]', drawn))
    (chain,) = re.findall(r"(?m)^    (\w+(?: --> \w+)+)$", drawn)
    called = [re.search(r"(\w+)\(\)", boxes[name]) for name in chain.split(" --> ")[1:]]
    source = inspect.getsource(world_step)
    found = [re.search(rf"\b{call[1]}\(", source) for call in called if call is not None]
    places = [call.start() for call in found if call is not None]
    assert len(places) == 7
    assert places == sorted(places)


def test_the_numbers_are_those_of_the_code() -> None:
    text = re.sub(r"\s+", " ", section("What happens on a fault"))
    assert f"sends the release {RELEASE_FRAMES} times" in text
    assert f"looks every {watchdog.LOOK_S:g} s" in text
    assert f"for {watchdog.HANGS_FLYING_S:g} s while engaged ({watchdog.HANGS_S:g} s" in text
    assert f"{watchdog.RESTARTS} times within {watchdog.RESTARTS_S:g} s" in text
    assert f"SCHED_FIFO {realtime.PRIORITY}" in section("Processes and links")


def test_the_compilers_take_what_the_page_says() -> None:
    assert (SOURCE / "sim" / "compiled.py").is_file()
    assert "tgl_soar.autopilot" in native.MODULES


@cache
def names() -> tuple[frozenset[str], frozenset[str]]:
    """(every class, function, method, module and constant; every `Class.method`)."""
    plain, dotted = set(), set()
    for file in SOURCE.rglob("*.py"):
        plain.add(file.stem)
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                plain.add(node.name)
                dotted.add(f"{file.stem}.{node.name}")
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                plain.add(node.target.id)
            elif isinstance(node, ast.ClassDef):
                plain.add(node.name)
                for part in node.body:
                    if isinstance(part, ast.FunctionDef):
                        dotted.add(f"{node.name}.{part.name}")
                    elif isinstance(part, ast.AnnAssign):
                        dotted.add(f"{node.name}.{ast.unparse(part.target)}")
    return frozenset(plain), frozenset(dotted)


def test_every_function_that_the_page_names_is_there() -> None:
    plain, dotted = names()
    called = set(re.findall(r"([A-Za-z_][\w.]*)\(", PAGE))
    assert len(called) > 20
    missing = {name for name in called if name not in (dotted if "." in name else plain)}
    assert not missing, "moved or renamed: correct docs/architecture.md"


def test_every_class_and_constant_that_the_page_names_is_there() -> None:
    plain, _ = names()
    classes = set(re.findall(r"`((?:[A-Z][a-z]+)+)`", PAGE))
    assert len(classes) >= 3
    assert classes <= plain
    assert {"TRANSITIONS", "TRIES"} <= plain


def test_the_classes_of_the_diagrams_are_in_the_files_beside_them() -> None:
    table = PAGE.partition("| class | what it is | file |")[2].partition("\n\n")[0]
    rows = [line.split("|")[1:4] for line in table.splitlines() if line.startswith("| `")]
    assert len(rows) >= 10
    for classes, _, files in rows:
        source = "".join((SOURCE / name).read_text() for name in re.findall(r"`(.*?)`", files))
        for name in re.findall(r"`(.*?)`", classes):
            assert re.search(rf"(?m)^class {name}\b", source), name


def test_every_file_that_the_page_names_is_there() -> None:
    text = re.sub(r"\]\(.*?\)", "]", PAGE)  # links have a test of their own
    named = set(re.findall(r"\b((?:\w+/)+(?:\w+\.py)?)", text))
    assert {"control/supervisor.py", "tools/sitl_bridge.py"} <= named
    missing = [n for n in sorted(named) if not ((SOURCE / n).exists() or (ROOT / n).exists())]
    assert not missing

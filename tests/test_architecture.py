"""Which room may import which, read from the source.

The table goes downward only.  A module may import what is in its row and everything below
that; a new file in a folder falls under the folder's row by itself, a new folder needs one.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import tgl_soar
from tgl_soar.cli.commands import COMMANDS

SOURCE = Path(tgl_soar.__file__).parent
PACKAGE = "tgl_soar"

# A row names a room: a door of the package, or what is behind one.  A module falls under the
# longest name that it begins with.  Direct permissions; what these may import is permitted too.
TABLE: dict[str, set[str]] = {
    "types": set(),
    "geometry": {"types"},
    "config.parameter_rules": set(),
    "config.parameters": {"types", "config.parameter_rules"},
    "config.line_changes": {"config.parameters"},
    "config.lateral_dynamics": set(),
    "config": {"config.line_changes", "config.lateral_dynamics", "geometry"},
    "control": {"config.line_changes", "geometry"},
    "estimation": {"config.parameters", "geometry"},
    "control.laws": {"control", "estimation"},  # it holds the parameters of both
    "control.conditions": {"control.laws"},
    "control.search": {"control.laws"},
    "control.survey": {"control.laws"},
    "control.lateral_margin": {"control.laws", "config.lateral_dynamics"},
    "control.loop_margin": {"control.lateral_margin"},
    "control.found_gains": {"control.loop_margin"},
    "control.pitch_design": {"control.found_gains"},
    "config.flown_gains": {"config", "control.pitch_design"},  # it seeks gains for an airframe
    "config.files": {"config.flown_gains"},
    "control.line_bounds": {"control.loop_margin"},
    "control.envelope_margins": {"control.laws"},
    "control.surface_loops": {"control.laws"},
    "control.point": {"control.laws"},
    "control.estimates": {"control.conditions", "control.envelope_margins", "control.point"},
    "control.launch_landing": {"control.estimates", "control.surface_loops"},
    "control.power": {"control.launch_landing"},
    "autopilot": {"control.launch_landing", "control.power"},
    "link": {"config", "geometry"},
    "onboard.native": set(),
    "onboard.pacing": set(),
    "onboard.realtime": set(),
    "onboard.standard_streams": set(),
    "onboard.watchdog": {"onboard.realtime"},
    "onboard.flightlog": {"autopilot", "onboard.realtime"},
    "onboard": {
        "autopilot",
        "control.line_bounds",
        "control.search",
        "control.survey",
        "link",
        "config.files",
        "onboard.flightlog",
        "onboard.native",
        "onboard.pacing",
        "onboard.standard_streams",
        "onboard.watchdog",
    },
    "air": {"geometry"},
    "sim.campaign": {"config"},  # many flights, whatever a flight is
    "sim.lines_ahead": {"air", "control.search"},  # rollouts, compiled for experiments
    "sim": {"autopilot", "air", "link", "config.files", "onboard.realtime", "sim.campaign"},
    "analysis": {"sim", "sim.lines_ahead", "onboard", "air"},
    "gym": {"analysis"},
    "cli": {"analysis", "onboard", "sim"},
}

# The simulated Pixhawk uses pymavlink, so that our codec is never tested only against itself.
PARTS: dict[tuple[str, str], set[str]] = {("sim", "link"): {"tgl_soar.link.autopilots"}}

DOORS = {
    "types", "geometry", "autopilot", "config", "control", "estimation", "link", "onboard",
    "air", "sim", "analysis", "cli", "gym",
}  # fmt: skip
FLIES = {"types", "geometry", "autopilot", "config", "control", "estimation", "link", "onboard"}
STAYS_ON_THE_GROUND = DOORS - FLIES

# A law knows no clock, no file and no wire.
PURE = {
    "types", "geometry", "config.parameters", "config.parameter_rules", "config.line_changes",
    "config.lateral_dynamics",
    "control", "control.laws",
    "control.conditions", "control.envelope_margins", "control.point", "control.estimates",
    "control.surface_loops", "control.launch_landing", "control.power",
    "control.lateral_margin", "control.loop_margin", "control.line_bounds", "control.search",
    "control.survey", "control.found_gains", "control.pitch_design",
    "estimation", "autopilot",
}  # fmt: skip
IMPURE = {
    "asyncio", "io", "logging", "multiprocessing", "os", "pathlib", "select", "serial", "signal",
    "socket", "subprocess", "threading", "time",
}  # fmt: skip


def unit_of(below: list[str]) -> str:
    """The row of a module, given its name below the package; empty: there is none."""
    for length in range(len(below), 0, -1):
        if (name := ".".join(below[:length])) in TABLE:
            return name
    return ""


def permitted(unit: str) -> set[str]:
    """A unit's row, and the rows below."""
    found = {unit}
    waiting = list(TABLE[unit])
    while waiting:
        below = waiting.pop()
        if below not in found:
            found.add(below)
            waiting.extend(TABLE[below])
    return found


def module_name(source: Path, file: Path) -> str:
    parts = [PACKAGE, *file.relative_to(source).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def tree_of(text: str) -> ast.Module:
    """Each file is asked for half a dozen times."""
    return ast.parse(text)


def imports_of(source: Path, file: Path) -> Iterator[tuple[int, str]]:
    """(line, full module name) of every import in a file, also those inside functions."""
    package = module_name(source, file).split(".")
    if file.name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(tree_of(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for name in node.names:
                yield node.lineno, name.name
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            for name in node.names:
                full = f"{origin}.{name.name}"
                place = source.joinpath(*full.split(".")[1:])
                is_module = place.is_dir() or place.with_suffix(".py").is_file()
                ours = origin.split(".")[0] == PACKAGE
                yield node.lineno, full if ours and is_module else origin
        elif isinstance(node, ast.Call) and node.args:
            called = ast.unparse(node.func).split(".")[-1]
            target = node.args[0]
            if called in ("import_module", "__import__") and isinstance(target, ast.Constant):
                yield node.lineno, str(target.value)


def violations(source: Path) -> list[str]:
    """Every import that the table does not permit, with its place."""
    found = []
    for file in sorted(source.rglob("*.py")):
        name = module_name(source, file)
        below = name.split(".")[1:]
        unit = unit_of(below)
        if below and not unit:
            found.append(f"{name}: {below[0]} has no row in the table of {Path(__file__).name}")
            continue
        for line, imported in imports_of(source, file):
            where = f"{name}, line {line}: imports {imported}"
            root, *rest = imported.split(".")
            if root != PACKAGE:
                if unit in PURE and root in IMPURE:
                    found.append(f"{where}: a law knows no clock, no file and no wire")
            elif rest and not unit:
                found.append(f"{where}: the package itself imports nothing of ours")
            elif rest:
                parts = PARTS.get((unit, unit_of(rest)))
                if unit_of(rest) not in permitted(unit):
                    found.append(f"{where}: {unit} may import {sorted(permitted(unit))}")
                elif parts and not any(f"{imported}.".startswith(f"{p}.") for p in parts):
                    found.append(f"{where}: {unit} may import {sorted(parts)} of it")
    return found


def circles(source: Path) -> list[list[str]]:
    """Every set of modules that import each other round in a circle, however far."""
    graph: dict[str, set[str]] = {}
    for file in source.rglob("*.py"):
        name = module_name(source, file)
        graph[name] = {i for _, i in imports_of(source, file) if i.startswith(f"{PACKAGE}.")}
    reached = {name: _reached_from(name, graph) for name in graph}
    groups = {
        frozenset({name, *(n for n in reached[name] if name in reached.get(n, ()))})
        for name in graph
        if name in reached[name]
    }
    return sorted(sorted(group) for group in groups)


def _reached_from(name: str, graph: dict[str, set[str]]) -> set[str]:
    found: set[str] = set()
    waiting = list(graph[name])
    while waiting:
        if (below := waiting.pop()) not in found:
            found.add(below)
            waiting.extend(graph.get(below, ()))
    return found


def class_names(source: Path) -> dict[str, list[str]]:
    """Where each class name stands."""
    found: dict[str, list[str]] = {}
    for file in sorted(source.rglob("*.py")):
        for node in ast.walk(tree_of(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                where = f"{file.relative_to(source)}:{node.lineno}"
                found.setdefault(node.name, []).append(where)
    return found


def test_a_class_name_stands_for_one_thing() -> None:
    found = {name: places for name, places in class_names(SOURCE).items() if len(places) > 1}
    assert found == {}


def test_a_class_name_that_stands_twice_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("class Leg:\n    class Row: ...\n", encoding="utf-8")
    (tmp_path / "b.py").write_text("class Row: ...\n", encoding="utf-8")
    assert class_names(tmp_path) == {"Leg": ["a.py:1"], "Row": ["a.py:2", "b.py:1"]}


# How long something may be in lines, so that it is read in one sitting.
MODULE_LINES = 600
CLASS_LINES = 300
FUNCTION_LINES = 80
# What is longer, how long it may be, and why.
LONGER: dict[str, tuple[int, str]] = {
    "config/parameters.py": (1078, "a table: one declaration a parameter, and it grows with them"),
}


def lengths(source: Path) -> Iterator[tuple[str, int, int]]:
    """(name, lines, how many it may have) of every module, class and function."""
    for file in sorted(source.rglob("*.py")):
        name, text = str(file.relative_to(source)), file.read_text(encoding="utf-8")
        yield name, len(text.splitlines()), MODULE_LINES
        for node in ast.walk(tree_of(text)):
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                most = CLASS_LINES if isinstance(node, ast.ClassDef) else FUNCTION_LINES
                yield f"{name} {node.name}", lines, most


def too_long(source: Path, longer: dict[str, tuple[int, str]]) -> list[str]:
    """What is longer than it may be."""
    return [
        f"{name}: {lines} lines, at most {allowed}: divide it"
        for name, lines, most in lengths(source)
        if lines > (allowed := longer.get(name, (most, ""))[0])
    ]


def test_everything_is_short_enough_to_read() -> None:
    assert too_long(SOURCE, LONGER) == []


def test_no_exception_outlives_its_reason() -> None:
    found = {name: (lines, most) for name, lines, most in lengths(SOURCE)}
    short = [name for name in LONGER if name not in found or found[name][0] <= found[name][1]]
    assert short == [], "not longer than others any more: take them off the list"
    assert all(len(reason) > 20 for _, reason in LONGER.values())


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("x = 1\n" * 600, []),
        ("x = 1\n" * 601, ["a.py"]),
        ("def f():\n" + "    x = 1\n" * 80, ["a.py f"]),
        ("async def f():\n" + "    x = 1\n" * 80, ["a.py f"]),
        ("def f():\n" + "    x = 1\n" * 79, []),
        ("class C:\n" + "    x = 1\n" * 300, ["a.py C"]),
        ("class C:\n" + "    x = 1\n" * 299, []),
        ("class C:\n    def m(self):\n" + "        x = 1\n" * 80, ["a.py m"]),
    ],
)
def test_what_is_too_long_is_found(tmp_path: Path, code: str, found: list[str]) -> None:
    (tmp_path / "a.py").write_text(code, encoding="utf-8")
    assert [line.split(":")[0] for line in too_long(tmp_path, {})] == found


# Rooms of more modules than that say in their `__init__` what each of them is for.
MANY = 6
LISTED = re.compile(r"^(?:  )?([a-z_][\w/, ]*?)  +\S", re.MULTILINE)


def unlisted(source: Path, commands: set[str]) -> list[str]:
    """Modules that the list of their room leaves out, and rooms and modules on it that are not
    there.  A figure and a command are found by their names."""
    found = []
    for room in sorted(path.parent for path in source.rglob("__init__.py")):
        inside = {f.stem for f in room.glob("*.py")} | {f.parent.name for f in room.glob("*/*.py")}
        inside -= {"__init__", "__main__"}
        text = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8")))
        listing = (text or "").partition("\n\n")[2]
        if room == source or not (listing or len(inside) > MANY):
            continue
        by_name = {name for name in inside if name.endswith("_figure")}
        by_name |= commands if room == source / "cli" else set()
        missing = inside - by_name - set(re.findall(r"\w+", listing))
        named = [name for names in LISTED.findall(listing) for name in names.split(",")]
        named += re.findall(r";  (\w+)/?:", listing)
        strange = {name.strip(" /") for name in named} - inside - {"__main__", "static"}
        where = room.relative_to(source).as_posix()
        found += [f"{where}: {name} is not on its list" for name in sorted(missing)]
        found += [f"{where}: there is no {name}" for name in sorted(strange)]
    return found


def test_a_room_of_many_says_where_each_thing_is() -> None:
    commands = {place.partition(":")[0] for place in COMMANDS.values()}
    assert unlisted(SOURCE, commands) == []


@pytest.mark.parametrize(
    ("listing", "found"),
    [
        ("Room.", ["room: a is not on its list", "room: b is not on its list"]),
        ("Room.\n\n  a, b      two of them\n", []),
        ("Room.\n\n  a         one;  b: another\n", []),
        ("Room.\n\n  a         one of them\n", ["room: b is not on its list"]),
        ("Room.\n\n  a, b      two\n  c/        gone\n", ["room: there is no c"]),
        ("Room.\n\n  a, b      two;  c: gone\n", ["room: there is no c"]),
    ],
)
def test_what_a_list_leaves_out_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listing: str, found: list[str]
) -> None:
    monkeypatch.setitem(globals(), "MANY", 1)
    (tmp_path / "room").mkdir()
    for name in ("a.py", "b.py", "draws_figure.py"):
        (tmp_path / "room" / name).touch()
    (tmp_path / "room" / "__init__.py").write_text(f'"""{listing}"""\n', encoding="utf-8")
    assert unlisted(tmp_path, set()) == found


def test_imports_go_downward_only() -> None:
    assert violations(SOURCE) == []


def test_the_package_has_thirteen_doors() -> None:
    """Twelve rooms, one for each question of a newcomer, and the gym: no room, but a name
    that other people's programs import.  It is one file, and nothing of ours imports it."""
    found = {p.stem for p in SOURCE.iterdir() if p.suffix == ".py" or (p / "__init__.py").is_file()}
    assert found - {"__init__"} == DOORS
    assert len(DOORS) == 13
    assert (SOURCE / "gym.py").is_file()
    users = [name for name, row in TABLE.items() if "gym" in row]
    assert users == []


def test_modules_import_each_other_in_no_circle() -> None:
    assert circles(SOURCE) == []


def test_the_table_keeps_the_ground_out_of_the_air() -> None:
    assert {unit.split(".")[0] for unit in TABLE} == DOORS
    for unit in TABLE:
        if unit.split(".")[0] in FLIES:
            assert not {p.split(".")[0] for p in permitted(unit)} & STAYS_ON_THE_GROUND, unit
    for unit in ("control", "estimation", "autopilot"):
        assert permitted(unit) <= {*PURE}, unit


def test_no_row_leads_back_to_itself() -> None:
    for unit, row in TABLE.items():
        assert all(unit not in permitted(below) for below in row), unit


# --- the checker checked --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("control/pid.py", "from tgl_soar.link.session import Session"),
        ("control/pid.py", "import tgl_soar.sim.world as w"),
        ("control/pid.py", "from ..sim import world"),
        ("control/pid.py", "from .. import link"),
        ("control/deep/er.py", "from ...air.hill import HillField"),
        ("control/pid.py", "from tgl_soar import link"),
        ("control/pid.py", "def f():\n    from tgl_soar.link import session"),
        ("control/pid.py", "if TYPE_CHECKING:\n    from tgl_soar.analysis.report import x"),
        ("control/pid.py", "import importlib\nimportlib.import_module('tgl_soar.sim.world')"),
        ("control/pid.py", "import time"),
        ("estimation/motion.py", "from time import monotonic"),
        ("estimation/motion.py", "import os.path"),
        ("estimation/motion.py", "import threading, math"),
        ("autopilot.py", "import socket"),
        ("autopilot.py", "from .link import decoder"),
        ("onboard/module.py", "from tgl_soar.air.hill import HillField"),
        ("link/decoder.py", "from tgl_soar.autopilot import step"),
        ("types.py", "from .geometry import wrap_angle"),
        ("sim/vehicle/pixhawk.py", "from tgl_soar.link.encoder import Encoder"),
        ("sim/vehicle/pixhawk.py", "from tgl_soar.link import decoder"),
        ("sim/vehicle/pixhawk.py", "from tgl_soar.analysis.report.figure_style import save"),
        ("unheard_of/x.py", "import math"),
        ("__init__.py", "from .types import Inputs"),
    ],
)
def test_a_planted_violation_is_found(tmp_path: Path, file: str, text: str) -> None:
    source = tmp_path / PACKAGE
    for folder in ("control", "estimation", "link/autopilots", "sim", "air", "analysis"):
        (source / folder).mkdir(parents=True)
    (source / "link" / "decoder.py").touch()
    path = source / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    (only,) = violations(source)
    assert only.startswith(module_name(source, path))


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("control/pid.py", "from math import pi\nfrom ..types import NAN\nfrom .other import x"),
        (
            "onboard/module.py",
            "import time\nfrom tgl_soar import autopilot\nfrom ..link import decoder",
        ),
        (
            "sim/vehicle/pixhawk.py",
            "from tgl_soar.link.autopilots.base import Flavour\nimport time",
        ),
        ("sim/vehicle/pixhawk.py", "from tgl_soar.link.autopilots import base"),
        (
            "cli/run.py",
            "import tgl_soar.sim.world, tgl_soar.analysis.report.legs, tgl_soar.onboard.process",
        ),
        ("analysis/experiments/result.py", "import tgl_soar\nprint(tgl_soar.__version__)"),
    ],
)
def test_what_is_permitted_passes(tmp_path: Path, file: str, text: str) -> None:
    source = tmp_path / PACKAGE
    (source / "link" / "autopilots").mkdir(parents=True)
    path = source / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    assert violations(source) == []


# --- what is really loaded ------------------------------------------------------------------


def test_the_tick_loads_no_heavy_package() -> None:
    """Start-up on a companion computer: a restart in flight must not wait for arrays or figures."""
    code = "import sys, tgl_soar.autopilot; print(*sorted(sys.modules))"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    loaded = {name.split(".")[0] for name in run.stdout.split()}
    assert "tgl_soar" in loaded
    heavy = {"numpy", "scipy", "pymavlink", "matplotlib", "rich", "typer", "msgspec", "serial"}
    assert not loaded & heavy
    ours = {name for name in run.stdout.split() if name.startswith("tgl_soar.")}
    units = {name.split(".")[1] for name in ours}
    assert units == {"autopilot", "config", "control", "estimation", "geometry", "types"}
    declared = {"tgl_soar.config.parameters", "tgl_soar.config.parameter_rules"}
    assert {name for name in ours if ".config." in name} == declared

"""Named tuples of more than four fields are built by keyword.

Two floats that have changed places pass every type check and most tests; two names do not.  Where
native code is made, keywords stand in the order of the fields, so that the compiler's copy of the
source can drop them (`cli.direct_tuples`).  A call with a starred argument is left alone: the
iterable that it spreads has an order of its own.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import tgl_soar
from tgl_soar.onboard import native

ROOT = Path(tgl_soar.__file__).parents[2]
AT_MOST_BY_PLACE = 4
DATA_CLASSES = {"Result"}  # of an experiment: ten fields, some of them empty
ROWS_OF_TABLES = {"Transition"}  # read as columns, and every row of it is tested by itself
FOLDERS = {"src": ROOT / "src", "tests": ROOT / "tests", "tools": ROOT / "tools"}
Fields = dict[str, tuple[str, ...]]  # of each named tuple, by the name that it has somewhere


def declared(tree: ast.Module) -> Fields:
    """The named tuples that a module declares, and `DATA_CLASSES`."""
    return {
        kind.name: tuple(
            ast.unparse(line.target) for line in kind.body if isinstance(line, ast.AnnAssign)
        )
        for kind in ast.walk(tree)
        if isinstance(kind, ast.ClassDef)
        and (kind.name in DATA_CLASSES or "NamedTuple" in map(ast.unparse, kind.bases))
    }


def known(tree: ast.Module, modules: dict[str, Fields]) -> Fields:
    """The named tuples that a module can name: its own, imported ones, those of its imports."""
    found = dict(declared(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            origin = modules.get(node.module or "", {})
            for name in node.names:
                here = name.asname or name.name
                if name.name in origin:
                    found[here] = origin[name.name]
                inner = modules.get(f"{node.module}.{name.name}", {})
                found |= {f"{here}.{kind}": fields for kind, fields in inner.items()}
    return found


def calls(tree: ast.Module, kinds: Fields) -> Iterator[tuple[ast.Call, tuple[str, ...]]]:
    """Every call that builds a named tuple of many fields, but for those that spread something."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            fields = kinds.get(ast.unparse(node.func), ())
            spread = any(isinstance(argument, ast.Starred) for argument in node.args)
            row = ast.unparse(node.func) in ROWS_OF_TABLES
            if len(fields) > AT_MOST_BY_PLACE and not spread and not row:
                yield node, fields


def by_place(tree: ast.Module, kinds: Fields) -> list[int]:
    """The lines of calls that give a field by its place."""
    return [call.lineno for call, _ in calls(tree, kinds) if call.args]


def out_of_order(tree: ast.Module, kinds: Fields) -> list[int]:
    """The lines of calls that name all fields, but not in the order of their declaration."""
    return [
        call.lineno
        for call, fields in calls(tree, kinds)
        if len(call.keywords) == len(fields) and [k.arg for k in call.keywords] != list(fields)
    ]


def module_of(file: Path) -> str:
    """Its full name, or that by which tests and tools import it."""
    if not file.is_relative_to(FOLDERS["src"]):
        return file.stem
    parts = file.relative_to(FOLDERS["src"]).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.fixture(scope="module")
def trees() -> dict[Path, ast.Module]:
    folders = [*FOLDERS.values(), ROOT / "benchmarks"]
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    return {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}


@pytest.fixture(scope="module")
def modules(trees: dict[Path, ast.Module]) -> dict[str, Fields]:
    found = {module_of(file): declared(tree) for file, tree in trees.items()}
    return {module_of(file): known(tree, found) for file, tree in trees.items()}


def test_no_field_of_many_is_given_by_its_place(
    trees: dict[Path, ast.Module], modules: dict[str, Fields]
) -> None:
    wrong = [
        f"{file.relative_to(ROOT)}:{line}"
        for file, tree in trees.items()
        for line in by_place(tree, known(tree, modules))
    ]
    assert wrong == []


def test_what_is_compiled_names_fields_in_their_order(
    trees: dict[Path, ast.Module], modules: dict[str, Fields]
) -> None:
    wrong = [
        f"{file.relative_to(ROOT)}:{line}"
        for file, tree in trees.items()
        if module_of(file) in native.MODULES
        for line in out_of_order(tree, known(tree, modules))
    ]
    assert wrong == []


# --- the checker checked --------------------------------------------------------------------

KINDS = "class Five(NamedTuple):\n    a: int\n    b: int\n    c: int\n    d: int\n    e: int = 0\n"


@pytest.mark.parametrize(
    ("call", "placed", "disordered"),
    [
        ("Five(1, 2, 3, 4, 5)", True, False),
        ("Five(1, b=2, c=3, d=4)", True, False),
        ("Five(a=1, b=2, c=3, d=4)", False, False),
        ("Five(a=1, c=3, b=2, d=4, e=5)", False, True),
        ("Five(*range(5))", False, False),
        ("kinds.Five(1, 2, 3, 4)", True, False),
    ],
)
def test_a_planted_call_is_found(call: str, placed: bool, disordered: bool) -> None:
    origin = {"some.kinds": declared(ast.parse(KINDS))}
    tree = ast.parse(f"from some import kinds\nfrom some.kinds import Five\n{call}\n")
    here = known(tree, origin)
    assert (by_place(tree, here) == [3]) is placed
    assert (out_of_order(tree, here) == [3]) is disordered

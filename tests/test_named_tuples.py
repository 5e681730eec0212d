"""Named tuples of more than four fields are built by keyword; of a dataclass, whose many fields
mostly have defaults, no more than the first four are given by their place; and no call of any
function in the source gives nine or more by place.

Two floats that have changed places pass every type check and most tests; two names do not.  Where
native code is made, keywords stand in the order of the fields, so that the compiler's copy of the
source can drop them (`cli.direct_tuples`).

A starred argument gives fields by their places too, and hides how many.  What has all fields
in their order, such as a row of a file, becomes a named tuple by `_make`; no more than four of its
elements stand there one by one.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import tgl_soar
from tgl_soar.onboard import native

ROOT = Path(tgl_soar.__file__).parents[2]
AT_MOST_BY_PLACE = 4
AS_NAMED_TUPLES = {"Result"}  # of an experiment: a dataclass of ten fields, some of them empty
ROWS_OF_TABLES = {"Transition"}  # read as columns, and every row of it is tested by itself
MOST_BY_PLACE = 8  # of any call in the source
# Calls that take any number of things one after the other, which have no names.
ANY_NUMBER = {
    "add_row": "the cells of a printed table, under its headings",
    "Table": "the headings",
    "pack": "numbers of a format of `struct`, which stands beside them",
    "_write_attitude": "the same, of a format that is compiled beforehand",
    "_write_body": "the same",
}
FOLDERS = {"src": ROOT / "src", "tests": ROOT / "tests", "tools": ROOT / "tools"}
BENCHMARKS = ROOT / "benchmarks"
Fields = dict[str, tuple[str, ...]]  # of each class, by the name that it has somewhere
Declared = Callable[["Module"], Fields]


class Module(NamedTuple):
    """What counts of a module here, gathered in one walk through its tree."""

    classes: list[ast.ClassDef]
    imports: list[ast.ImportFrom]
    calls: list[tuple[str, ast.Call]]  # named by what is called


def parsed(text: str) -> Module:
    """Errors: SyntaxError."""
    module = Module([], [], [])
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef):
            module.classes.append(node)
        elif isinstance(node, ast.ImportFrom):
            module.imports.append(node)
        elif isinstance(node, ast.Call):
            module.calls.append((name_of(node.func), node))
    return module


def name_of(called: ast.expr) -> str:
    """Of a class, or of one in an imported module; empty for what is no name."""
    if isinstance(called, ast.Attribute):
        owner = name_of(called.value)
        return f"{owner}.{called.attr}" if owner else ""
    return called.id if isinstance(called, ast.Name) else ""


def named_tuples(module: Module) -> Fields:
    """The named tuples that a module declares, and `AS_NAMED_TUPLES`."""
    return {
        kind.name: fields_of(kind)
        for kind in module.classes
        if kind.name in AS_NAMED_TUPLES or "NamedTuple" in map(ast.unparse, kind.bases)
    }


def dataclasses(module: Module) -> Fields:
    """The dataclasses that a module declares."""
    return {
        kind.name: fields_of(kind)
        for kind in module.classes
        if any(ast.unparse(each).startswith("dataclass") for each in kind.decorator_list)
    }


def fields_of(kind: ast.ClassDef) -> tuple[str, ...]:
    """In their order."""
    return tuple(ast.unparse(line.target) for line in kind.body if isinstance(line, ast.AnnAssign))


def known(module: Module, modules: dict[str, Fields], declared: Declared) -> Fields:
    """The classes that a module can name: its own, imported ones, those of its imports."""
    found = dict(declared(module))
    for node in module.imports:
        # `benchmarks` alone imports by where it is.
        package = "benchmarks" if node.level > 0 else ""
        origin_name = ".".join(filter(None, (package, node.module)))
        origin = modules.get(origin_name, {})
        for name in node.names:
            here = name.asname or name.name
            if name.name in origin:
                found[here] = origin[name.name]
            inner = modules.get(f"{origin_name}.{name.name}", {})
            found |= {f"{here}.{kind}": fields for kind, fields in inner.items()}
    return found


def calls(module: Module, kinds: Fields) -> Iterator[tuple[ast.Call, tuple[str, ...]]]:
    """Every call that builds a named tuple of many fields, but for rows of tables."""
    for name, call in module.calls:
        fields = kinds.get(name, ())
        if len(fields) > AT_MOST_BY_PLACE and name not in ROWS_OF_TABLES:
            yield call, fields


def by_place(module: Module, kinds: Fields) -> list[int]:
    """The lines of calls that give a field by its place."""
    placed = [call.lineno for call, _ in calls(module, kinds) if call.args]
    made = [
        call.lineno
        for name, call in module.calls
        if len(kinds.get(name.removesuffix("._make"), ())) > AT_MOST_BY_PLACE
        and name.endswith("._make")
        and one_by_one(call.args[0]) > AT_MOST_BY_PLACE
    ]
    return sorted(placed + made)


def one_by_one(values: ast.expr) -> int:
    """How many elements of a tuple or list stand there, and are not spread from something else."""
    if isinstance(values, ast.Starred):
        return one_by_one(values.value)
    if not isinstance(values, ast.Tuple | ast.List):
        return 0
    inner = (each if isinstance(each, ast.Starred) else None for each in values.elts)
    return sum(1 if each is None else one_by_one(each) for each in inner)


def too_many_by_place(module: Module, kinds: Fields) -> list[int]:
    """The lines of calls that give more of a class's fields by place than one can tell apart."""
    return [
        call.lineno
        for name, call in module.calls
        if len(kinds.get(name, ())) > AT_MOST_BY_PLACE
        and (len(call.args) > AT_MOST_BY_PLACE or spreads(call))
    ]


def spreads(call: ast.Call) -> bool:
    """Whether an argument stands for any number of them."""
    return any(isinstance(argument, ast.Starred) for argument in call.args)


def many_by_place(module: Module) -> list[tuple[int, str]]:
    """The lines of calls that give more by place than one can count, and what is called."""
    found = []
    for name, call in module.calls:
        spread = [a for a in call.args if isinstance(a, ast.Starred) and not one_by_one(a)]
        if one_by_one(ast.Tuple(elts=call.args)) + len(spread) > MOST_BY_PLACE:
            found.append((call.lineno, name))
    return found


def out_of_order(module: Module, kinds: Fields) -> list[int]:
    """The lines of calls that name all fields, but not in the order of their declaration."""
    return [
        call.lineno
        for call, fields in calls(module, kinds)
        if len(call.keywords) == len(fields) and [k.arg for k in call.keywords] != list(fields)
    ]


def module_of(file: Path) -> str:
    """Its full name, or that by which tests and tools import it."""
    if file.is_relative_to(BENCHMARKS):
        return f"benchmarks.{file.stem}"
    if not file.is_relative_to(FOLDERS["src"]):
        return file.stem
    parts = file.relative_to(FOLDERS["src"]).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.fixture(scope="module")
def files() -> dict[Path, Module]:
    folders = [*FOLDERS.values(), BENCHMARKS]
    return {
        file: parsed(file.read_text(encoding="utf-8"))
        for folder in folders
        for file in sorted(folder.rglob("*.py"))
    }


def everywhere(files: dict[Path, Module], declared: Declared) -> dict[Path, Fields]:
    """What each file can name, also where it comes by way of another module."""
    own = {module_of(file): declared(module) for file, module in files.items()}
    found = {module_of(file): known(module, own, declared) for file, module in files.items()}
    return {file: known(module, found, declared) for file, module in files.items()}


@pytest.fixture(scope="module")
def kinds(files: dict[Path, Module]) -> dict[Path, Fields]:
    return everywhere(files, named_tuples)


def test_no_field_of_many_is_given_by_its_place(
    files: dict[Path, Module], kinds: dict[Path, Fields]
) -> None:
    wrong = [
        f"{file.relative_to(ROOT)}:{line}"
        for file, module in files.items()
        for line in by_place(module, kinds[file])
    ]
    assert wrong == []


def test_no_more_than_the_first_fields_of_a_dataclass_are_given_by_their_place(
    files: dict[Path, Module],
) -> None:
    kinds = everywhere(files, dataclasses)
    wrong = [
        f"{file.relative_to(ROOT)}:{line}"
        for file, module in files.items()
        for line in too_many_by_place(module, kinds[file])
    ]
    assert wrong == []


def test_no_call_gives_more_by_place_than_one_can_count(files: dict[Path, Module]) -> None:
    source = {f: module for f, module in files.items() if f.is_relative_to(FOLDERS["src"])}
    found = [
        (f"{file.relative_to(ROOT)}:{line}", name.split(".")[-1])
        for file, module in source.items()
        for line, name in many_by_place(module)
    ]
    assert [where for where, name in found if name not in ANY_NUMBER] == []
    assert set(ANY_NUMBER) == {name for _, name in found}, "what is not called so any more"


def test_what_is_compiled_names_fields_in_their_order(
    files: dict[Path, Module], kinds: dict[Path, Fields]
) -> None:
    wrong = [
        f"{file.relative_to(ROOT)}:{line}"
        for file, module in files.items()
        if module_of(file) in native.MODULES
        for line in out_of_order(module, kinds[file])
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
        ("Five(*range(5))", True, False),
        ("Five(1, *range(3))", True, False),
        ("Five(*range(4), e=5)", True, False),
        ("Five._make(range(5))", False, False),
        ("Five._make((1, *range(4)))", False, False),
        ("Five._make((1, 2, 3, 4, 5))", True, False),
        ("Five._make([1, 2, *(3, 4, 5)])", True, False),
        ("kinds.Five._make((1, 2, 3, 4, 5))", True, False),
        ("kinds.Five(1, 2, 3, 4)", True, False),
    ],
)
def test_a_planted_call_is_found(call: str, placed: bool, disordered: bool) -> None:
    origin = {"some.kinds": named_tuples(parsed(KINDS))}
    module = parsed(f"from some import kinds\nfrom some.kinds import Five\n{call}\n")
    here = known(module, origin, named_tuples)
    assert (by_place(module, here) == [3]) is placed
    assert (out_of_order(module, here) == [3]) is disordered


@pytest.mark.parametrize(
    "line", ["from .kinds import Five", "from benchmarks.kinds import Five", "from . import kinds"]
)
def test_a_planted_call_of_what_benchmarks_declare_is_found(line: str) -> None:
    name = "kinds.Five" if line.endswith("kinds") else "Five"
    origin = {"benchmarks.kinds": named_tuples(parsed(KINDS))}
    module = parsed(f"{line}\n{name}(1, 2, 3, 4, 5)\n")
    assert by_place(module, known(module, origin, named_tuples)) == [2]


@pytest.mark.parametrize("decorator", ["dataclass", "dataclass(frozen=True)"])
@pytest.mark.parametrize(
    ("call", "wrong"),
    [
        ("Five(1, 2, 3, 4, 5)", True),
        ("Five(1, 2, 3, 4, e=5)", False),
        ("Five(*range(5))", True),
        ("Five(*range(4), e=5)", True),
        ("kinds.Five(1, 2, 3, 4, 5)", True),
    ],
)
def test_a_planted_call_of_a_dataclass_is_found(decorator: str, call: str, wrong: bool) -> None:
    kinds = parsed(f"@{decorator}\n{KINDS.replace('(NamedTuple)', '')}")
    origin = {"some.kinds": dataclasses(kinds)}
    module = parsed(f"from some import kinds\nfrom some.kinds import Five\n{call}\n")
    assert (too_many_by_place(module, known(module, origin, dataclasses)) == [3]) is wrong


@pytest.mark.parametrize(
    ("call", "many"),
    [
        ("f(1, 2, 3, 4, 5, 6, 7, 8)", False),
        ("f(1, 2, 3, 4, 5, 6, 7, 8, a=9)", False),
        ("f(1, 2, 3, 4, 5, 6, 7, 8, 9)", True),
        ("f()(1, 2, 3, 4, 5, 6, 7, 8, 9)", True),
        ("x.f(1, 2, *(3, 4, 5), 6, 7, 8, 9)", True),
        ("f(1, *x, 2)", False),
        ("f((1, 2, 3), (4, 5, 6), (7, 8, 9))", False),
        ("f(1, 2, 3, 4, 5, 6, 7, 8, *x)", True),
    ],
)
def test_a_planted_call_of_many_by_place_is_found(call: str, many: bool) -> None:
    assert bool(many_by_place(parsed(call))) is many


# What holds a sample of the tick, wherever it is called so.
SAMPLES = {"fix", "sample", "imu", "attitude", "body", "reported", "own", "position", "given"}


def numbered(text: str) -> list[str]:
    """The samples of which a part is taken by numbers."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Slice):
            of = node.value
            name = of.id if isinstance(of, ast.Name) else getattr(of, "attr", "")
            begins = node.slice.lower  # all but the first of a list is no field
            if name in SAMPLES and isinstance(begins, ast.Constant) and begins.value != 1:
                found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return found


def test_no_part_of_a_sample_is_taken_by_numbers() -> None:
    """A field put in between would shift all that follows."""
    assert numbered("x = fix[2:5]\ny = world.attitude[6:]\nz = rows[2:5]\nw = fix[n:]") == [
        "line 1: fix[2:5]",
        "line 2: world.attitude[6:]",
    ]
    parsers = {"hot_frames.py", "layout.py", "dataflash.py"}  # of bytes
    source = Path(tgl_soar.__file__).parent
    files = [file for file in source.rglob("*.py") if file.name not in parsers]
    assert {str(file): found for file in files if (found := numbered(file.read_text()))} == {}

"""Named tuples made of their fields at once, in the copy of the source that is compiled.

To a C compiler `Kind(a, b=b)` is a call of a Python function that counts its arguments, looks up
those with a name and hands them on.  Where all fields are given, in their order, there is nothing
to count or to look up:

    Kind(a, b=b)   →   cast(Kind, make(Kind, a, b))

is the same tuple in a fifth of the time, by the few lines of C beside this file, and a tick makes
some forty of them.  Nobody would want to read it, so that the source stays as it is.  Lines keep
their numbers, for what goes wrong in them.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

IN_C: Final = "direct_tuples.c"
Kinds = Mapping[str, Sequence[str]]  # named tuples, and the fields of each

_IMPORTS: Final = (
    b"; from typing import Any as _direct_Any, Final as _direct_Final, cast as _direct_cast"
    b"; from tgl_soar_tuples import make; _direct_make: _direct_Final[_direct_Any] = make"
)


def fields_of(source: str) -> dict[str, dict[str, str]]:
    """The fields of each named tuple that a module declares, and their types in its own words."""
    return {
        kind.name: {
            ast.unparse(field.target): ast.unparse(field.annotation)
            for field in kind.body
            if isinstance(field, ast.AnnAssign)
        }
        for kind in ast.parse(source).body
        if isinstance(kind, ast.ClassDef)
        and any(ast.unparse(base) == "NamedTuple" for base in kind.bases)
    }


def kinds_of(source: str) -> Kinds:
    """The named tuples that a module declares."""
    return {name: tuple(fields) for name, fields in fields_of(source).items()}


def direct(module: str, source: str, declared: Mapping[str, Kinds]) -> str:
    """The source of a module that makes its tuples at once, line by line where it was.

    declared: the kinds of each module that it may import them from, and its own.
    """
    tree = ast.parse(source)
    lines = [line.encode() for line in source.split("\n")]  # the parser counts bytes
    known: dict[str, Sequence[str]] = {}
    places: dict[str, int] = {}  # the line behind which a kind is known
    for node in tree.body:
        end = node.end_lineno or 0
        if isinstance(node, ast.ImportFrom):
            kinds = declared.get(_imported(module, node), {})
            here = {a.asname or a.name: kinds[a.name] for a in node.names if a.name in kinds}
            places |= dict.fromkeys(here, end - 1)
        elif isinstance(node, ast.ClassDef) and not lines[end]:
            # It ends with an indented line: what is said of it stands in the empty one below.
            here = {n: names for n, names in declared[module].items() if n == node.name}
            places |= dict.fromkeys(here, end)
        else:
            continue
        known |= here

    calls = list(_calls(tree, known))
    edits = [edit for call in calls for edit in _edits(lines, call)]
    for row, start, stop, text in sorted(edits, reverse=True):
        lines[row] = lines[row][:start] + text + lines[row][stop:]
    for name in sorted({ast.unparse(call.func) for call in calls}):
        row = places[name]
        separator = b"; " if lines[row] else b""
        lines[row] += separator + f"_direct_{name}: _direct_Final[_direct_Any] = {name}".encode()
    if calls:
        first = next(n for n in tree.body if isinstance(n, ast.ImportFrom))  # of __future__
        lines[(first.end_lineno or 0) - 1] += _IMPORTS
    return b"\n".join(lines).decode()


def _imported(module: str, node: ast.ImportFrom) -> str:
    """The full name of the module that is imported from."""
    package = module.split(".")[: -node.level] if node.level else []
    return ".".join([*package, *filter(None, [node.module])])


def _calls(tree: ast.Module, known: Kinds) -> Iterator[ast.Call]:
    """Calls that make a tuple, in functions: what runs once at the import may stay as it is."""
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
    inside = {n: None for f in functions for statement in f.body for n in ast.walk(statement)}
    for node in inside:  # each once, also in a function within a function
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and len(fields := known.get(node.func.id, ())) > 1
            and gives_all_in_order(node, fields)
        ):
            yield node


def gives_all_in_order(call: ast.Call, fields: Sequence[str]) -> bool:
    """Whether a call names every field in the order of its declaration, or gives it by place."""
    if any(isinstance(argument, ast.Starred) for argument in call.args):
        return False
    given = [*fields[: len(call.args)], *(keyword.arg for keyword in call.keywords)]
    return given == list(fields)


def _edits(lines: list[bytes], call: ast.Call) -> Iterator[tuple[int, int, int, bytes]]:
    """What to write over both ends of a call: row, from and to which column, text."""
    name = ast.unparse(call.func)
    row, start = call.lineno - 1, call.col_offset
    made = f"_direct_cast({name}, _direct_make(_direct_{name}, ".encode()
    yield row, start, lines[row].index(b"(", start) + 1, made
    for keyword in call.keywords:  # its value stays where it is
        row, start = keyword.lineno - 1, keyword.col_offset
        yield row, start, lines[row].index(b"=", start) + 1, b""
    row, stop = (call.end_lineno or 0) - 1, call.end_col_offset or 0
    yield row, stop - 1, stop, b"))"

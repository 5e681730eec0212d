"""What mypyc gets wrong, or takes otherwise than Python does, is not in what is compiled.

Each was found by a flight; mypyc 2.4 compiles all of them without a word.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from importlib import import_module
from keyword import iskeyword
from math import nan, sqrt
from typing import Any, Final

import pytest

from tgl_soar.onboard import native


def pitfalls(text: str, values: Mapping[str, Any]) -> Iterator[str]:
    """Of a module's source, and of what its names come to."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Slice):
            parts = (node.slice.lower, node.slice.upper)
            if any(isinstance(p, ast.Call) for part in parts if part for p in ast.walk(part)):
                yield f"{node.lineno}: a call in a slice may be made twice"
        elif isinstance(node, ast.Lambda) and node.args.defaults:
            yield f"{node.lineno}: defaults of a lambda are taken once, for all that it makes"
        elif isinstance(node, ast.Attribute) and _is_c_keyword(node.attr):
            yield f"{node.lineno}: {node.attr} is no name in C"
    for node in tree.body:
        if (
            isinstance(node, ast.AnnAssign)
            and ast.unparse(node.annotation).startswith("Final")
            and "..." not in ast.unparse(node.annotation)
            and _is_tuple_of_floats(values[ast.unparse(node.target)])
        ):
            yield f"{node.lineno}: a constant tuple of floats alone counts as not set"


def _is_c_keyword(name: str) -> bool:
    return name in {"_thread", "_Bool", "_Generic"} or (iskeyword(name) and name != "None")


def _is_tuple_of_floats(value: object) -> bool:
    return type(value) is tuple and value != () and all(type(each) is float for each in value)


def test_no_pitfall_is_in_what_is_compiled() -> None:
    found = [
        f"{name}, line {pitfall}"
        for name in native.MODULES
        for pitfall in pitfalls(
            native.file_of(name).read_text(encoding="utf-8"), vars(import_module(name))
        )
    ]
    assert found == []


def values_of(text: str) -> dict[str, Any]:
    values: dict[str, Any] = {"Final": Final, "Triple": tuple, "NAN": nan, "sqrt": sqrt}
    exec(text, values)
    return values


@pytest.mark.parametrize(
    "text",
    [
        "def f(d, w):\n    return d[w(d) :]",
        "def f(x):\n    return lambda x=x: x",
        "class C:\n    def f(self):\n        self._thread = 1",
        "RATES: Final = (1.0, 2.0)",
        "ROOTS: Final = (sqrt(2.0), sqrt(3.0))",
        "NO: Final = (NAN, -1.0)",
        "NO: Final[Triple] = (NAN, *(0.0,) * 2)",
    ],
)
def test_a_planted_pitfall_is_found(text: str) -> None:
    assert len(list(pitfalls(text, values_of(text)))) == 1


def test_what_only_looks_like_a_pitfall_passes() -> None:
    text = (
        "RATES: Final[tuple[float, ...]] = (1.0, 2.0)\nBOTH: Final = (1, 2.0)\n"
        "ONE: Final = sqrt(2.0)\nNONE: Final = ()\n"
        "def f(d, n):\n    return d[n + 1 :], lambda: n, d[len]"
    )
    assert list(pitfalls(text, values_of(text))) == []

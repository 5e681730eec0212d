"""Change a module in every small way, one at a time, and see whether its tests notice.

    python tools/mutate.py src/tgl_soar/control/envelope.py tests/control/test_envelope.py

A mutant has one comparison loosened, tightened or turned round, one sign or operation of
arithmetic or of bits exchanged, one `and` for `or`, one `not` dropped, one number or truth
changed, or one `min` for `max`.  Tests run in a fork of this process with the mutant in the
module's place, until the first that fails; one that takes too long counts as noticed.  Mutants
that no test notices are listed, with the share of those that are noticed.
"""

from __future__ import annotations

import ast
import copy
import importlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

TIMEOUT_S: Final = 120
_COMPARES: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
}
_OPERATIONS: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
}


def replacements(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """What a node may be changed to, and the words for it."""
    match node:
        case ast.Compare(ops=ops):
            for i, op in enumerate(ops):
                for other in _COMPARES.get(type(op), ()):
                    changed = copy.deepcopy(node)
                    changed.ops[i] = other()
                    yield changed, f"{ast.unparse(node)}  ->  {ast.unparse(changed)}"
        case ast.BinOp(op=op) if type(op) in _OPERATIONS:
            changed_binary = copy.deepcopy(node)
            changed_binary.op = _OPERATIONS[type(op)]()
            yield changed_binary, f"{ast.unparse(node)}  ->  {ast.unparse(changed_binary)}"
        case ast.AugAssign(op=op) if type(op) in _OPERATIONS:
            changed_assign = copy.deepcopy(node)
            changed_assign.op = _OPERATIONS[type(op)]()
            yield changed_assign, f"{ast.unparse(node)}  ->  {ast.unparse(changed_assign)}"
        case ast.BoolOp(op=op):
            changed_bool = copy.deepcopy(node)
            changed_bool.op = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield changed_bool, f"{ast.unparse(node)}  ->  {ast.unparse(changed_bool)}"
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand, f"{ast.unparse(node)}  ->  {ast.unparse(operand)}"
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value), f"{value}  ->  {not value}"
        case ast.Constant(value=int(value) | float(value)):
            yield ast.Constant(value + 2), f"{value}  ->  {value + 2}"
        case ast.Call(func=ast.Name(id="min" | "max" as name)):
            changed_call = copy.deepcopy(node)
            changed_call.func = ast.Name("max" if name == "min" else "min", ast.Load())
            yield changed_call, f"{ast.unparse(node)}  ->  {ast.unparse(changed_call)}"


def mutants(source: str) -> Iterator[tuple[ast.Module, int, str]]:
    """(changed module, line, words) of every mutant.  Only functions' bodies are changed."""
    tree = ast.parse(source)
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    for function in functions:
        for statement in function.body:
            for node in ast.walk(statement):
                for new, words in replacements(node):
                    yield _with(tree, node, new), getattr(node, "lineno", 0), words


class _Replace(ast.NodeTransformer):
    """Puts one node in the place of another, found by its identity."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        """The new node for the old one; every other as it is."""
        if node is self._old:
            return ast.copy_location(self._new, node)
        return self.generic_visit(node)


def _with(tree: ast.Module, old: ast.AST, new: ast.AST) -> ast.Module:
    """A copy of the module with one node replaced."""
    copied = copy.deepcopy(tree, {id(old): old})  # the copy holds the very node
    _Replace(old, new).visit(copied)
    return ast.fix_missing_locations(copied)


def is_noticed(mutant: ast.Module, name: str, path: Path, tests: list[str]) -> bool:
    """Whether a test fails with the mutant in the module's place."""
    child = os.fork()
    if child == 0:
        signal.alarm(TIMEOUT_S)
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        try:
            module = importlib.import_module(name)
            exec(compile(mutant, str(path), "exec"), vars(module))
            code = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests]))
        except BaseException:  # it cannot even be imported: noticed
            code = 1
        os._exit(0 if code == 0 else 1)
    return os.waitpid(child, 0)[1] != 0


def main(arguments: list[str]) -> int:
    """0 if every mutant is noticed."""
    if len(arguments) < 2:
        print(__doc__)
        return 2
    path, tests = Path(arguments[0]), arguments[1:]
    parts = path.with_suffix("").parts
    name = ".".join(parts[parts.index("tgl_soar") :])
    source = path.read_text(encoding="utf-8")
    if is_noticed(ast.parse(source), name, path, tests):
        print(f"{path}: its tests fail as it stands")
        return 2
    count, missed = 0, 0
    for mutant, line, words in mutants(source):
        count += 1
        if not is_noticed(mutant, name, path, tests):
            missed += 1
            print(f"{path}:{line}: {words}", flush=True)
    print(f"{path}: {count - missed} of {count} mutants noticed")
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

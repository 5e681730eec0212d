"""The small changes that a source can have, each as a piece of text in the place of another.

A change is one of these:

- a comparison loosened, tightened or turned round, a condition or a truth turned round;
- one operation of arithmetic, of bits or of logic exchanged for another, a sign or `not` dropped;
- a number changed: a float doubled (zero becomes one), an integer raised by one.  Constants,
  defaults of arguments and of dataclasses' and named tuples' fields are numbers like the rest;
- `min` for `max`, `any` for `all`, `sin` for `cos`, `floor` for `ceil`, `abs` dropped;
- a call that is made for what it does left out;
- outside functions: one row of a tuple, list, set or dictionary left out.

Annotations, decorators, error messages and strings stay as they are.  All else of the source keeps
its place, so that a line's number means the same in the changed source, up to a table's row.

Some changes are not tried, as whoever uses the program cannot tell them from the source as it was,
whatever the tests (`LEFT_OUT` says it for the page):

- `<` for `<=` and the like, where neither side is a count, zero, or the bound of what may be given:
  two measured numbers are equal with probability zero, and a tick's time meets a limit to the last
  bit by chance.  Turned round (`<` for `>=`) every comparison is;
- how a picture is drawn: `STYLES`, such as the width of a line or the size of a type;
- what guards a sum, a comparison or a minimum against rounding: numbers of 1e-6 and less there (a
  factor of 1e-6 or 1e-7 is a unit, and is changed);
- which sign terms have in a sum of which is only asked whether it is a number (`isfinite(a + b)`);
- which seed a generator is given;
- `strict` of `zip`, an assertion that no input can fail.
"""

from __future__ import annotations

import ast
import copy
import re
from collections.abc import Iterator
from typing import Final, NamedTuple


class Mutation(NamedTuple):
    """Bytes `start` to `end` of a source become `text`."""

    line: int
    start: int
    end: int
    text: str
    words: str  # what was and what is, on one line


_COMPARES: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_BOUNDARIES: Final = frozenset(
    ((ast.Lt, ast.LtE), (ast.LtE, ast.Lt), (ast.Gt, ast.GtE), (ast.GtE, ast.Gt))
)
_OPERATIONS: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_PAIRS: Final = (("min", "max"), ("any", "all"), ("sin", "cos"), ("floor", "ceil"))
_OPPOSITES: Final = {**dict(_PAIRS), **{other: name for name, other in _PAIRS}}
# What a subscript of these holds is a type.
_GENERIC: Final = frozenset(
    ("Annotated", "Callable", "Final", "Literal", "dict", "frozenset", "list", "set", "tuple")
)
# What a change of which is not tried, in a page's words; the module's page has the reasons.
LEFT_OUT: Final = (
    "the very boundary of a comparison (`<` for `<=`) where neither side is a count, zero or the "
    "bound of what may be given: two measured numbers are never equal (the comparison turned round "
    "is tried everywhere)",
    "how a picture is drawn: widths of lines, sizes of type and the like",
    "numbers of 1e-6 and less that guard a sum, a comparison or a minimum against rounding",
    "the sign of a term in a sum of which is only asked whether it is a number",
    "the seed that a generator is given, and `strict` of `zip`",
)
STYLES: Final = frozenset((
    *("alpha", "aspect", "capsize", "columnspacing", "dash_capstyle", "dpi", "fontsize"),
    *("frameon", "hspace"),
    *("handlelength", "labelpad", "labelsize", "labelspacing", "linewidth", "linewidths", "lw"),
    *("markeredgewidth", "markersize", "mew", "ms", "rotation", "wspace", "zorder"),
))  # fmt: skip
# What these are given is style, too: of a picture's size whatever it is computed of.
_STYLING: Final = frozenset(("grid", "margins", "set_visible", "tick_params"))
_SIZE: Final = "figsize"
_GENERATORS: Final = frozenset(("Random", "default_rng"))
_ROUNDING: Final = 1e-6
# A name that is or ends so counts, numbers things, or is what somebody gives or may give: the
# bound of a range is given more often than any other number.
_COUNTING: Final = re.compile(
    "^([ijkmn]|at|end|high|low|value|values)$|(^|_)(begin|boots|column|count|counts|head|index|"
    "kind|maximum|minimum|misses|needed|number|offset|place|repeats|row|rows|sequence|size|"
    "standing|step|steps|stop|ticks|tries|version|windows|words)$"
)
# What these give is counted.
_COUNTS: Final = frozenset(("count", "count_nonzero", "index", "int", "len", "ord", "qsize", "sum"))
# A constant that ends so is measured.
_UNIT: Final = re.compile("_(M|S|MS|US|HZ|RAD|DEG|MPS|MPS2|RADPS|FACTOR|FRACTION|SD)$")
# Names that only tools read.
_NOT_CODE: Final = frozenset(("__all__", "__slots__", "__match_args__"))
_WORDS: Final = 100  # characters of a side of a change that are shown


def mutations(source: str) -> list[Mutation]:
    """Every change of a source, in the order of its lines.

    Errors: SyntaxError where it cannot be parsed.
    """
    starts = [0]
    for each in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(each))
    found = []
    for node, new, line, words in _changes(ast.parse(source), in_function=False):
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        found.append(Mutation(line=line, start=start, end=end, text=_text(new), words=words))
    return found


def changed(source: str, mutation: Mutation) -> str:
    """The source with one change made."""
    whole = source.encode()
    return (whole[: mutation.start] + mutation.text.encode() + whole[mutation.end :]).decode()


_Placed = ast.expr | ast.stmt
_Change = tuple[_Placed, ast.AST, int, str]


def _text(new: ast.AST) -> str:
    plain = (ast.Constant, ast.Name, ast.Attribute, ast.Call, ast.stmt)
    displays = (ast.Tuple, ast.List, ast.Set, ast.Dict)  # with brackets of their own
    text = ast.unparse(new)
    return text if isinstance(new, (*plain, *displays)) else f"({text})"


def _short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= _WORDS else text[: _WORDS - 1] + "…"


def _changes(node: ast.AST, in_function: bool) -> Iterator[_Change]:
    """(what stands there, what is put there, line, words) in a node and all below it."""
    if isinstance(node, _Placed):
        for new in _replacements(node):
            yield node, new, node.lineno, f"{_short(node)}  ->  {_short(new)}"
        if not in_function:
            for new, row in _shortened(node):
                yield node, new, row.lineno, f"left out: {_short(row)}"
    match node:  # a condition of comparisons is turned round by these
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test) if (
            isinstance(test, ast.Name | ast.Attribute | ast.Call)
            and ast.unparse(test) != "TYPE_CHECKING"
        ):
            other = ast.UnaryOp(ast.Not(), test)
            yield test, other, test.lineno, f"{_short(test)}  ->  {_short(other)}"
    for child in _code_below(node):
        inside = in_function or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        yield from _changes(child, inside and not _is_default(node, child))


def _is_default(node: ast.AST, child: ast.AST) -> bool:
    """Defaults of arguments are evaluated outside the function."""
    return isinstance(node, ast.FunctionDef) and child is node.args


def _code_below(node: ast.AST) -> Iterator[ast.AST]:
    """The children that are code: no annotation, decorator, docstring, message or type."""
    match node:
        case ast.AnnAssign(value=value):
            if value is not None:
                yield value
        case ast.Assign(targets=[ast.Name(id=name)]) if name in _NOT_CODE:
            pass
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            yield node.args
            yield from node.body
        case ast.ClassDef():
            yield from node.body
        case ast.arguments():
            yield from node.defaults
            yield from (default for default in node.kw_defaults if default is not None)
        case ast.If(test=ast.Name(id="TYPE_CHECKING")):
            pass
        case ast.If(test=ast.Compare(left=ast.Name(id="__name__"))):
            pass
        case ast.Subscript(value=ast.Name(id=name)) if name in _GENERIC:
            pass
        case ast.JoinedStr() | ast.Raise():
            pass
        case ast.Call():
            yield node.func
            only_finite = ast.unparse(node.func).rpartition(".")[2] == "isfinite"
            for each in node.args:
                if only_finite:
                    yield from _terms(each)
                elif not _is_unobservable(node, each):
                    yield each
            yield from (
                each for each in node.keywords if not _is_unobservable(node, each.value, each.arg)
            )
        case ast.BinOp(op=ast.Add() | ast.Sub()) | ast.Compare():
            yield from (each for each in ast.iter_child_nodes(node) if not _is_rounding(each))
        case _:
            yield from ast.iter_child_nodes(node)


def _terms(node: ast.expr) -> Iterator[ast.expr]:
    """Of a sum and its sums."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub(), right):
            yield from _terms(left)
            yield from _terms(right)
        case _:
            yield node


def _is_unobservable(call: ast.Call, value: ast.expr, keyword: str | None = None) -> bool:
    """Whether no user can tell what a call is given from another number or truth."""
    plain = all(isinstance(each, ast.Constant | ast.Tuple | ast.Load) for each in ast.walk(value))
    name = ast.unparse(call.func).rpartition(".")[2]
    unobservable = keyword in STYLES or keyword == "seed" or name in _GENERATORS or name in _STYLING
    return (plain and unobservable) or (
        keyword == _SIZE
        or (name == "zip" and keyword == "strict")
        or (name in ("min", "max", "minimum", "maximum") and _is_rounding(value))
    )


def _is_rounding(node: ast.AST) -> bool:
    """Whether it is a number that only keeps rounding from deciding."""
    match node:
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _is_rounding(operand)
        case ast.Constant(value=float(value)):
            return 0.0 < value <= _ROUNDING
    return False


def _counts(node: ast.expr) -> bool:
    """Whether it may be the same as another to the last bit: a count, a number of something, zero,
    a bound, or a constant of which nothing says that it is measured."""
    match node:
        case ast.Constant(value=value):
            return isinstance(value, int) or value == 0.0
        case ast.UnaryOp(operand=operand):
            return _counts(operand)
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)):
            return name in _COUNTS
        case ast.Name(id=name) | ast.Attribute(attr=name):
            is_measured = not name.isupper() or _UNIT.search(name) is not None
            return not is_measured or _COUNTING.search(name) is not None
        case ast.BinOp(op=ast.Add() | ast.Sub() | ast.FloorDiv() | ast.Mod()):
            return _counts(node.left) and _counts(node.right)
    return False


def _replacements(node: _Placed) -> Iterator[ast.AST]:
    """What a node may be changed to."""
    match node:
        case ast.Compare(ops=ops):
            sides = [node.left, *node.comparators]
            for i, op in enumerate(ops):
                counted = _counts(sides[i]) or _counts(sides[i + 1])
                for other in _COMPARES[type(op)]:
                    if counted or (type(op), other) not in _BOUNDARIES:
                        compare = copy.deepcopy(node)
                        compare.ops[i] = other()
                        yield compare
        case ast.BinOp(op=ast.Add() | ast.Sub()) if _is_rounding(node.left) or _is_rounding(
            node.right
        ):
            pass
        case ast.BinOp(op=op) if type(op) in _OPERATIONS:
            yield ast.BinOp(node.left, _OPERATIONS[type(op)](), node.right)
        case ast.AugAssign(op=op) if type(op) in _OPERATIONS:
            yield ast.AugAssign(node.target, _OPERATIONS[type(op)](), node.value)
        case ast.BoolOp(op=op):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Constant(value=value):
            yield from (ast.Constant(other) for other in _other_values(value))
        case ast.Call(func=function):
            yield from _other_calls(node, function)
        case ast.Expr(value=ast.Call()):
            yield ast.Pass()


def _other_values(value: object) -> Iterator[bool | int | float]:
    match value:
        case bool():
            yield not value
        case int():
            yield value + 1
        case float():
            yield 2.0 * value or 1.0


def _other_calls(node: ast.Call, function: ast.expr) -> Iterator[ast.AST]:
    match function:
        case ast.Name(id=name) if name in _OPPOSITES:
            yield ast.Call(ast.Name(_OPPOSITES[name]), node.args, node.keywords)
        case ast.Attribute(value=ast.Name(id="math" | "np") as module, attr=name) if (
            name in _OPPOSITES
        ):
            opposite = ast.Attribute(module, _OPPOSITES[name])
            yield ast.Call(opposite, node.args, node.keywords)
        case ast.Name(id="abs"):
            yield node.args[0]


def _shortened(node: _Placed) -> Iterator[tuple[ast.expr, ast.expr]]:
    """(the table without a row, that row) for each row of a table of two or more."""
    match node:
        case ast.Tuple(ctx=ast.Load()) | ast.List(ctx=ast.Load()) | ast.Set():
            for i, row in enumerate(node.elts):
                if len(node.elts) > 1:
                    table = copy.copy(node)
                    table.elts = node.elts[:i] + node.elts[i + 1 :]
                    yield table, row
        case ast.Dict():
            for i, key in enumerate(node.keys):
                if len(node.keys) > 1:
                    keys = node.keys[:i] + node.keys[i + 1 :]
                    yield ast.Dict(keys, node.values[:i] + node.values[i + 1 :]), key or node

"""The small changes of a source: each kind is made, each is one change, and nothing else is."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from mutations import changed, mutations

ROOT = Path(__file__).parents[2]


def made(source: str) -> list[str]:
    """The changed sources, which are all others than the source and than each other."""
    found = [changed(source, each) for each in mutations(source)]
    trees = {ast.dump(ast.parse(text)) for text in found}
    assert len(trees) == len(found)
    assert ast.dump(ast.parse(source)) not in trees
    return found


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = n < b", ["x = (n <= b)", "x = (n >= b)"]),
        ("x = a is None", ["x = (a is not None)"]),
        ("x = a not in b", ["x = (a in b)"]),
        ("x = a - b", ["x = (a + b)"]),
        ("x *= a", ["x /= a"]),
        ("x = a and b", ["x = (a or b)"]),
        ("x = not a", ["x = a"]),
        ("x = -a", ["x = a"]),
        ("x = min(a, b)", ["x = max(a, b)"]),
        ("x = math.sin(a)", ["x = math.cos(a)"]),
        ("x = abs(a)", ["x = a"]),
        ("if a:\n    x()", ["if (not a):\n    x()", "if a:\n    pass"]),
        ("x = a if b() else c", ["x = a if (not b()) else c"]),
        # Numbers, wherever they stand.
        ("STALL_BEYOND: Final = 0.5", ["STALL_BEYOND: Final = 1.0"]),
        ("LAST: Final[tuple[int, ...]] = NONE", []),
        ("def f(a: float = 0.0, *, b: int = 3): ...", [
            "def f(a: float = 1.0, *, b: int = 3): ...",
            "def f(a: float = 0.0, *, b: int = 4): ...",
        ]),
        ("class A(NamedTuple):\n    wide: bool = True", [
            "class A(NamedTuple):\n    wide: bool = False",
        ]),
        ("class A:\n    def f(self):\n        return 2", [
            "class A:\n    def f(self):\n        return 3",
        ]),
        # Tables.
        ("ROWS = (a, (b, c))", ["ROWS = ((b, c),)", "ROWS = (a,)", "ROWS = (a, (c,))",
                                "ROWS = (a, (b,))"]),
        ("ROWS = {'a': x, 'b': y}", ["ROWS = {'b': y}", "ROWS = {'a': x}"]),
        ("ROWS = [a]", []),
        ("def f():\n    return a, b", []),
        # What is not behaviour.
        ("@d(frozen=True)\ndef f(a: Literal[1]) -> Literal[2]:\n    '''3'''", []),
        ("raise E('at most', 3)", []),
        ("if TYPE_CHECKING:\n    x = 3", []),
        ("if __name__ == '__main__':\n    f(3)", []),
        ("__all__ = ['a', 'b']", []),
        ("x = f'{a:3.1f} {a + 1}'", []),
        # Boundaries where equality can be: counts, zero, bounds, constants that are not measured.
        ("x = a_m < b_m", ["x = (a_m >= b_m)"]),
        ("x = now_s - since_s >= HOLD_S", ["x = (now_s + since_s) >= HOLD_S",
                                           "x = (now_s - since_s < HOLD_S)"]),
        ("x = len(a) > MOST", ["x = (len(a) >= MOST)", "x = (len(a) <= MOST)"]),
        ("x = a_m <= 0.0", ["x = (a_m < 0.0)", "x = (a_m > 0.0)", "x = a_m <= 1.0"]),
        ("x = low <= a_m < most_m", ["x = (low < a_m < most_m)", "x = (low > a_m < most_m)",
                                     "x = (low <= a_m >= most_m)"]),
        ("x = a < SLOTS", ["x = (a <= SLOTS)", "x = (a >= SLOTS)"]),
        # What cannot be told from the source as it was.
        ("axes.plot(2 * b, lw=0.8, alpha=0.5, ls=3)", [
            "axes.plot((2 / b), lw=0.8, alpha=0.5, ls=3)",
            "axes.plot(3 * b, lw=0.8, alpha=0.5, ls=3)",
            "axes.plot(2 * b, lw=0.8, alpha=0.5, ls=4)",
            "pass",
        ]),
        ("x = f(lw=2.0 * a)", ["x = f(lw=(2.0 / a))", "x = f(lw=4.0 * a)"]),
        ("x = f(figsize=(9.0, 2 * a), frameon=False)", []),
        ("x = axes.grid(False)", []),
        ("x = axes.plot(False)", ["x = axes.plot(True)"]),
        ("def g(): f(size=(9.0, a))", ["def g(): f(size=(18.0, a))", "def g(): pass"]),
        ("x = np.random.default_rng(7)", []),
        ("x = Random(seed)", []),
        ("x = fly(seed=7)", []),
        ("x = zip(a, b, strict=True)", []),
        ("x = sorted(a, strict=True)", ["x = sorted(a, strict=False)"]),
        ("x = max(a, 1e-9)", ["x = min(a, 1e-09)"]),
        ("x = tip - 1e-9", []),
        ("x = a_m < -1e-9", ["x = (a_m >= -1e-09)"]),
        ("x = isfinite(a + 2 * b - c)", ["x = isfinite(a + (2 / b) - c)",
                                         "x = isfinite(a + 3 * b - c)"]),
        ("x = 1e-6 * us", ["x = (1e-06 / us)", "x = 2e-06 * us"]),
    ],
)  # fmt: skip
def test_each_kind_of_change(source: str, expected: list[str]) -> None:
    assert sorted(made(source)) == sorted(expected)


def test_a_change_keeps_its_place_and_all_around_it() -> None:
    source = "# °\nLEAST = 3  # the paper's\n\n\ndef f(a):\n    return '°', a > 2  # and this\n"
    assert [(each.line, each.words) for each in mutations(source)] == [
        (2, "3  ->  4"),
        (6, "a > 2  ->  a >= 2"),
        (6, "a > 2  ->  a <= 2"),
        (6, "2  ->  3"),
    ]
    assert changed(source, mutations(source)[1]).splitlines()[5] == (
        "    return '°', (a >= 2)  # and this"
    )


def test_a_row_that_is_left_out_is_named_with_its_line() -> None:
    source = "ROWS = (\n    Row('a', b),\n    Row('c', d),\n)\n"
    rows = [each for each in mutations(source) if each.words.startswith("left out")]
    assert [(each.line, each.words) for each in rows] == [
        (2, "left out: Row('a', b)"),
        (3, "left out: Row('c', d)"),
    ]
    assert changed(source, rows[0]) == "ROWS = (Row('c', d),)\n"


@pytest.mark.parametrize(
    "name", ["control/supervisor.py", "config/parameters.py", "cli/commands.py"]
)
def test_every_change_of_a_file_is_a_program(name: str) -> None:
    source = (ROOT / "src/tgl_soar" / name).read_text(encoding="utf-8")
    before = ast.dump(ast.parse(source))
    for each in mutations(source)[::7]:
        assert ast.dump(ast.parse(changed(source, each))) != before, each

"""What is compiled makes its tuples at once, and the same ones, line by line where it was."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.cli.direct_tuples import direct, kinds_of
from tgl_soar.onboard import native

KINDS = '''"""Kinds."""
from __future__ import annotations
from typing import NamedTuple


class Inner(NamedTuple):
    """In bytes α is two characters, and a column counts bytes."""

    low: float
    high: float = 2.0


class Outer(NamedTuple):
    name: str
    inner: Inner


class Plain:
    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high


AT_IMPORT = Inner(1.0, 2.0)


def made(x: float) -> Outer:
    return Outer("α", Inner(x, x + 1.0))  # α


def spread(
    x: float,
) -> Outer:
    return Outer(
        "β",
        Inner(
            x,
            max(x, 0.0),
        ),
    )


def by_name(x: float) -> tuple[Inner, Outer]:
    return Inner(x, high=-x), Outer(
        name="δ=",
        inner=Inner(
            low=(
                x
            ),
            high=max(x, 0.0) + (x == 1.0),
        ),
    )


def left_as_they_are(x: float) -> tuple[Inner, Inner, Inner, float]:
    pair = (x, x)
    return Inner(x), Inner(*pair), Inner(high=x, low=x), Plain(x, x).low


def nested(x: float) -> Inner:
    def within() -> Inner:
        return Inner(x, Inner(x, x).high)

    return within()
'''
USER = """from __future__ import annotations
from .kinds import (
    Inner as In,
    Outer,
)


def used(x: float) -> Outer:
    return Outer("γ", In(x, 0.0))
"""


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the place of what is written in C."""
    monkeypatch.setitem(
        sys.modules,
        "tgl_soar_tuples",
        SimpleNamespace(make=lambda kind, *values: tuple.__new__(kind, values)),
    )


def run(source: str, **known: Any) -> dict[str, Any]:
    space: dict[str, Any] = {"__name__": "some.kinds", **known}
    exec(compile(source, "kinds.py", "exec"), space)
    return space


@pytest.mark.usefixtures("in_python")
def test_the_same_tuples_are_made_on_the_same_lines() -> None:
    declared = {"some.kinds": kinds_of(KINDS)}
    assert declared["some.kinds"] == {"Inner": ("low", "high"), "Outer": ("name", "inner")}
    found = direct("some.kinds", KINDS, declared)
    assert found.count("_direct_make(_direct_") == 9
    assert found.count("\n") == KINDS.count("\n")
    before, after = run(KINDS), run(found)
    for name in ("made", "spread", "by_name", "left_as_they_are", "nested"):
        assert repr(after[name](0.5)) == repr(before[name](0.5))
        old, new = before[name].__code__, after[name].__code__
        assert new.co_firstlineno == old.co_firstlineno
    assert type(after["made"](0.5)) is after["Outer"]
    assert type(after["made"](0.5).inner) is after["Inner"]


def test_kinds_of_other_modules_are_known_by_the_names_they_have_here() -> None:
    found = direct("some.user", USER, {"some.kinds": kinds_of(KINDS), "some.user": {}})
    assert "_direct_In: _direct_Final[_direct_Any] = In" in found
    assert found.count("_direct_make(_direct_") == 2
    assert found.count("\n") == USER.count("\n")


def test_a_module_that_makes_no_tuples_stays_as_it_is() -> None:
    source = "from __future__ import annotations\n\nX = 1\n"
    assert direct("some.plain", source, {"some.plain": {}}) == source


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """Of all that is compiled, and of what declares tuples for it."""
    names = (*native.MODULES, "tgl_soar.types", "tgl_soar.link.messages")
    return {name: native.file_of(name).read_text(encoding="utf-8") for name in names}


@pytest.fixture(scope="module")
def declared(sources: dict[str, str]) -> dict[str, Any]:
    return {module: kinds_of(source) for module, source in sources.items()}


@pytest.mark.parametrize("name", native.MODULES)
def test_all_that_is_compiled_can_be_made_direct(
    name: str, sources: dict[str, str], declared: dict[str, Any]
) -> None:
    found = direct(name, sources[name], declared)
    compile(found, name, "exec")
    assert found.count("\n") == sources[name].count("\n")


def test_most_of_what_a_tick_makes_is_made_direct(
    sources: dict[str, str], declared: dict[str, Any]
) -> None:
    names = [name for name in native.MODULES if "control" in name or "estimation" in name]
    made = sum(direct(n, sources[n], declared).count("_direct_make(_direct_") for n in names)
    assert made > 60

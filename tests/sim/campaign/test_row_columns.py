"""Which columns a type of results has, what each holds, and what it reads of a result: no table is
written for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Optional

import msgspec
import pytest

from tgl_soar.sim.campaign import rows
from tgl_soar.sim.campaign.rows import FLIGHT, GROUP, Column, columns_of


class Inner(NamedTuple):
    """Somewhere."""

    x: float
    y: int | None


class Plain(msgspec.Struct):
    """A structure."""

    inner: Inner
    words: str = ""


@dataclass(frozen=True)
class Everything:
    """Fields of every kind."""

    whole: int
    flag: bool
    number: float | None
    old: Optional[str]  # noqa: UP045 - as older code writes it
    either: int | str
    number_kind: Literal[1, 2]
    only: Literal["one"]
    plain: Plain | None
    several: list[float]
    maybe: tuple[int | None, ...]
    mixed: tuple[int, float]
    places: list[Inner] | None
    tables: dict[str, float]
    anything: Any
    nothing: tuple[()]


def column(name: str) -> Column:
    (found,) = [each for each in columns_of(Everything) if each.name == name]
    return found


RESULT = Everything(
    whole=3,
    flag=True,
    number=None,
    old="x",
    either=1,
    number_kind=2,
    only="one",
    plain=Plain(Inner(0.5, 7), "words"),
    several=[1.0, 2.0],
    maybe=(1, None),
    mixed=(1, 2.0),
    places=[Inner(1.5, None), Inner(2.5, 8)],
    tables={},
    anything=None,
    nothing=(),
)
WITHOUT = Everything(
    whole=3,
    flag=True,
    number=None,
    old=None,
    either="",
    number_kind=1,
    only="one",
    plain=None,
    several=[],
    maybe=(),
    mixed=(1, 2.0),
    places=None,
    tables={},
    anything=None,
    nothing=(),
)


def test_a_group_has_so_many_rows_and_flights_are_numbered() -> None:
    assert (GROUP, FLIGHT) == (8192, "flight")
    assert rows.MISSING == "Parquet needs pyarrow: pip install 'tgl_soar[parquet]'"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("whole", int),
        ("flag", bool),
        ("number", float),
        ("old", str),
        ("number_kind", int),
        ("only", str),
    ],
)
def test_a_plain_field_is_a_column_of_its_type_whether_it_may_be_missing_or_not(
    name: str, kind: type
) -> None:
    assert column(name).kind is kind
    assert column(name).read(RESULT) == getattr(RESULT, name)
    assert column(name).read(WITHOUT) == getattr(WITHOUT, name)


@pytest.mark.parametrize("name", ["either", "mixed", "tables", "anything", "nothing"])
def test_what_has_no_one_type_is_no_column(name: str) -> None:
    assert name not in [each.name for each in columns_of(Everything)]


def test_a_field_of_fields_is_columns_of_both_names() -> None:
    names = [each.name for each in columns_of(Everything) if each.name.startswith("plain")]
    assert names == ["plain_inner_x", "plain_inner_y", "plain_words"]
    assert [column(name).kind for name in names] == [float, int, str]
    assert [column(name).read(RESULT) for name in names] == [0.5, 7, "words"]
    assert [column(name).read(WITHOUT) for name in names] == [None, None, None]


@pytest.mark.parametrize(("name", "kind"), [("several", float), ("maybe", int)])
def test_several_of_one_type_are_a_list(name: str, kind: type) -> None:
    assert tuple(column(name).kind) == (kind, True)
    assert column(name).read(RESULT) == list(getattr(RESULT, name))
    assert column(name).read(WITHOUT) == []


def test_several_of_a_kind_with_fields_are_a_list_of_structures() -> None:
    places = column("places")
    assert [(each.name, each.kind) for each in places.kind.of] == [("x", float), ("y", int)]
    assert places.kind.many
    assert places.read(RESULT) == [{"x": 1.5, "y": None}, {"x": 2.5, "y": 8}]
    assert places.read(WITHOUT) is None


@pytest.mark.parametrize("kind", [int, str, tuple, list, dict, None, "Inner", list[int]])
def test_what_has_no_fields_has_no_columns(kind: Any) -> None:
    assert columns_of(kind) == []


def test_a_structure_of_msgspec_has_columns_too() -> None:
    assert [each.name for each in columns_of(Plain)] == ["inner_x", "inner_y", "words"]
    assert [each.read(Plain(Inner(1.0, 2), "w")) for each in columns_of(Plain)] == [1.0, 2, "w"]


def test_whether_there_is_pyarrow_is_looked_up(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(rows, "find_spec", lambda name: asked.append(name))
    assert not rows.available()
    monkeypatch.setattr(rows, "find_spec", lambda _name: object())
    assert rows.available()
    assert asked == ["pyarrow"]

"""The loop over a log's ticks, uncompiled, and where its kernel is kept; nothing is compiled."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.replay import compiled_ticks as module
from tgl_soar.analysis.replay.compiled_ticks import (
    INPUT_LEAVES,
    OUTPUT_LEAVES,
    folder,
    is_ready,
    plain_ticks,
)
from tgl_soar.autopilot import Output
from tgl_soar.onboard.flightlog.topics import flattener, rebuilt
from tgl_soar.types import Inputs


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """Where a kernel is kept is asked once in a process."""
    folder.cache_clear()
    module.compiled_ticks.cache_clear()
    yield
    folder.cache_clear()
    module.compiled_ticks.cache_clear()


def row(leaves: Any, first: float) -> list[float]:
    """A number of its own for each leaf; truths are one or zero."""
    return [float(k % 2) if leaf.kind is bool else first + k for k, leaf in enumerate(leaves)]


def test_each_row_is_one_tick_in_turn() -> None:
    """Leaves in their places both ways, laws always the same, the state handed on."""
    passed: list[Any] = []
    given = np.array([row(INPUT_LEAVES, 1000.0), row(INPUT_LEAVES, 5000.0)])
    made = [row(OUTPUT_LEAVES, 300.0), row(OUTPUT_LEAVES, 700.0)]

    def tick(laws: Any, state: Any, inputs: Inputs) -> Any:
        passed.append((laws, state, inputs))
        return state + 1, rebuilt(Output, iter(made[len(passed) - 1]))

    taken = np.full((2, len(OUTPUT_LEAVES)), -1.0)
    ticks: Any = plain_ticks(tick)
    assert ticks("laws", 40, given, taken) == 42
    assert taken.tolist() == made
    assert [each[:2] for each in passed] == [("laws", 40), ("laws", 41)]
    for (_, _, inputs), numbers in zip(passed, given.tolist(), strict=True):
        assert isinstance(inputs, Inputs)
        leaves = flattener(INPUT_LEAVES)(inputs)
        assert [float(leaf) for leaf in leaves] == numbers
        whole = [
            type(leaf) for leaf, of in zip(leaves, INPUT_LEAVES, strict=True) if of.kind is int
        ]
        assert set(whole) == {int}


def test_without_a_row_nothing_is_flown() -> None:
    def tick(*_: Any) -> Any:
        raise AssertionError

    none = np.empty((0, len(INPUT_LEAVES))), np.empty((0, len(OUTPUT_LEAVES)))
    ticks: Any = plain_ticks(tick)
    assert ticks("laws", "state", *none) == "state"


def test_any_number_but_zero_is_a_truth() -> None:
    numbers = row(INPUT_LEAVES, 0.0)
    at = next(k for k, leaf in enumerate(INPUT_LEAVES) if leaf.kind is bool)
    truths: list[bool] = []

    def tick(_laws: Any, state: Any, inputs: Inputs) -> Any:
        truths.append(flattener(INPUT_LEAVES)(inputs)[at])
        return state, rebuilt(Output, iter(row(OUTPUT_LEAVES, 0.0)))

    given = np.array([numbers] * 3)
    given[:, at] = 0.0, 1.0, 2.0
    ticks: Any = plain_ticks(tick)
    ticks(None, None, given, np.empty((3, len(OUTPUT_LEAVES))))
    assert truths == [False, True, True]


# --- where a kernel is kept -----------------------------------------------------------------------


def test_it_is_kept_in_the_cache_folder_or_the_homes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "version", lambda name: {"numba": "1.2"}[name])
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    kept = folder()
    assert kept.parent == tmp_path / "cache" / "tgl_soar"
    assert len(kept.name) == 16
    assert int(kept.name, 16) >= 0
    assert folder() is kept
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    folder.cache_clear()
    assert folder() == tmp_path / "home" / ".cache" / "tgl_soar" / kept.name
    # Another numba, and another source, have another folder.
    monkeypatch.setattr(module, "version", lambda _: "1.3")
    folder.cache_clear()
    assert folder().name != kept.name


@pytest.mark.parametrize("left_out", ["tgl_soar.types", "topics", "itself"])
def test_the_source_of_every_module_below_it_counts(
    left_out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The laws' modules, the log's rows and this module itself: of each other bytes."""
    monkeypatch.setattr(module, "version", lambda _: "1.2")
    monkeypatch.setattr(module, "MODULES", ("tgl_soar.types",))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before = folder()
    names = {"topics": "tgl_soar.onboard.flightlog.topics", "itself": module.__name__}
    changed = names.get(left_out, left_out)
    other = tmp_path / "other.py"
    other.write_text("another = 1\n", encoding="utf-8")

    def find(name: str) -> Any:
        return SimpleNamespace(origin=str(other)) if name == changed else find_spec(name)

    monkeypatch.setattr(module, "find_spec", find)
    folder.cache_clear()
    assert folder() != before


@pytest.mark.parametrize(
    ("numba", "kernel", "ready"),
    [(True, "deep/ticks.nbi", True), (True, "ticks.nbc", False), (False, "ticks.nbi", False)],
)
def test_it_is_ready_where_numba_and_a_kernel_are(
    numba: bool, kernel: str, ready: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "available", lambda: numba)
    monkeypatch.setattr(module, "folder", lambda: tmp_path)
    (tmp_path / kernel).parent.mkdir(exist_ok=True)
    (tmp_path / kernel).touch()
    assert is_ready() is ready


@pytest.mark.parametrize("error", [OSError("no"), RuntimeError("no home")])
def test_without_a_place_to_keep_it_it_is_never_ready(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nowhere() -> Path:
        raise error

    monkeypatch.setattr(module, "available", lambda: True)
    monkeypatch.setattr(module, "folder", nowhere)
    assert is_ready() is False


def made(monkeypatch: pytest.MonkeyPatch, kept: Any) -> tuple[list[Any], str]:
    """(options of each compiling and the cache folder then, the cache folder afterwards), with a
    compiler that hands back what it is given."""
    asked: list[Any] = []
    settings = SimpleNamespace(CACHE_DIR="as before")

    def njit(**options: bool) -> Any:
        asked.append((options, settings.CACHE_DIR))
        return lambda function: function

    numba, core = ModuleType("numba"), ModuleType("numba.core")
    vars(numba).update(njit=njit, core=core)
    vars(core).update(config=settings)
    for name, each in (("numba", numba), ("numba.core", core)):
        monkeypatch.setitem(sys.modules, name, each)
    monkeypatch.setattr(module, "compiled", lambda function: function)
    monkeypatch.setattr(module, "folder", kept)
    assert callable(module.compiled_ticks())
    return asked, settings.CACHE_DIR


def test_it_is_compiled_into_its_folder_and_numba_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, after = made(monkeypatch, lambda: tmp_path)
    assert asked == [({"cache": True, "nogil": True}, str(tmp_path))]
    assert after == "as before"


def test_without_a_place_to_keep_it_it_is_compiled_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nowhere() -> Path:
        raise RuntimeError("no home")

    asked, after = made(monkeypatch, nowhere)
    assert asked == [({"nogil": True}, "as before")]
    assert after == "as before"

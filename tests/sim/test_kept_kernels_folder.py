"""Where compiled kernels are kept: the folder's place and name, and which old folders go."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tgl_soar.sim import kernel_cache

MODULES = ("tgl_soar.sim.propeller", "tgl_soar.sim.servos")


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(kernel_cache, "version", lambda name: f"{name} 0.1")
    kernel_cache.folder.cache_clear()
    yield tmp_path / "cache/tgl_soar/kernels"
    kernel_cache.folder.cache_clear()


def kept(base: Path, name: str, size: int, time_s: float) -> Path:
    made = base / name / "sim"
    made.mkdir(parents=True)
    (made / "kernel").write_bytes(bytes(size))
    os.utime(base / name, (time_s, time_s))
    return base / name


def names(base: Path) -> set[str]:
    return {path.name for path in base.iterdir()}


def test_sixteen_sources_of_a_gibibyte_in_all_are_kept() -> None:
    assert (kernel_cache.KEPT, kernel_cache.KEPT_BYTES) == (16, 1_073_741_824)


def test_the_folder_is_made_below_the_cache_and_named_by_the_source(base: Path) -> None:
    made = kernel_cache.folder(MODULES)
    assert made.is_dir()
    assert made.parent == base
    assert made.name == kernel_cache.source_key(MODULES)
    assert len(made.name) == 16
    assert set(made.name) <= set("0123456789abcdef")


def test_without_a_place_for_caches_it_is_in_the_home_folder(
    tmp_path: Path, base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    made = kernel_cache.folder(MODULES)
    assert made.parent == tmp_path / "home/.cache/tgl_soar/kernels"
    assert not base.exists()


@pytest.mark.usefixtures("base")
def test_a_folder_that_is_used_again_is_the_newest() -> None:
    made = kernel_cache.folder(MODULES)
    os.utime(made, (1.0, 1.0))
    kernel_cache.folder.cache_clear()
    assert kernel_cache.folder(MODULES) == made
    assert made.stat().st_mtime > 1e9


@pytest.mark.usefixtures("base")
def test_the_name_changes_with_the_versions_of_python_and_numba(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    key = kernel_cache.source_key(MODULES)
    assert kernel_cache.source_key(reversed(MODULES)) == key
    monkeypatch.setattr(sys, "version", "0.0")
    other = kernel_cache.source_key(MODULES)
    monkeypatch.setattr(kernel_cache, "version", lambda name: f"{name} 0.2")
    assert len({key, other, kernel_cache.source_key(MODULES)}) == 3


def write(root: Path, **sources: str) -> None:
    for name, text in sources.items():
        (root / f"house/{name}.py").write_text(text)


def test_a_source_is_a_module_with_all_that_it_imports_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By either way of importing; not what lies beside it, nor what others have installed."""
    monkeypatch.setattr(kernel_cache, "_ROOT", tmp_path)
    (tmp_path / "house").mkdir()
    write(
        tmp_path,
        __init__="",
        top="import math\nfrom house.middle import X\nfrom house import side\n",
        middle="import house.bottom, house.cellar\n",
        side="from . import stranger\n",
        bottom="import house.top\n",
        cellar="",
        stranger="",
    )
    found = kernel_cache._sources(["house.top"])
    assert set(found) == {
        "house",
        *(f"house.{name}" for name in ("top", "middle", "side", "bottom", "cellar")),
    }
    assert found["house.bottom"] == b"import house.top\n"


def test_the_oldest_go_when_there_are_too_many(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "KEPT", 3)
    for age in range(5):
        kept(base, f"age{age}", 1, 1000.0 - age)
    kernel_cache._delete_old(base)
    assert names(base) == {"age0", "age1", "age2"}
    kernel_cache._delete_old(base)
    assert names(base) == {"age0", "age1", "age2"}


def test_those_go_that_would_take_more_of_the_disk_than_they_may(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes = [4000, 4000, 4000]
    folders = [kept(base, f"age{age}", size, 1000.0 - age) for age, size in enumerate(sizes)]
    two = sum(file.stat().st_size for folder in folders[:2] for file in folder.rglob("*"))
    monkeypatch.setattr(kernel_cache, "KEPT_BYTES", two)
    kernel_cache._delete_old(base)
    assert names(base) == {"age0", "age1"}
    monkeypatch.setattr(kernel_cache, "KEPT_BYTES", two - 1)
    kernel_cache._delete_old(base)
    assert names(base) == {"age0"}
    monkeypatch.setattr(kernel_cache, "KEPT_BYTES", 0)
    kernel_cache._delete_old(base)
    assert names(base) == {"age0"}  # the newest is used now


def test_a_folder_that_is_gone_meanwhile_is_no_error(tmp_path: Path) -> None:
    kernel_cache._delete_old(tmp_path / "gone")

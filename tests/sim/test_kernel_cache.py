"""What is compiled is kept on disk, and never taken for another source."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest

from tgl_soar.geometry import SoaringFrame, ned_from_soaring, ned_vector_from_soaring
from tgl_soar.sim import kernel_cache
from tgl_soar.sim.compiled import MODULES, _kernels, available, compiled
from tgl_soar.sim.kernel_cache import KEPT, source_key

needs_numba = pytest.mark.skipif(not available(), reason="numba is not installed")

# What it gives, how often it was found on disk and how often not, and whether a cell's type is
# known again, as it must be there.
CALLS = """
import pickle
from numba import typeof
from tgl_soar.geometry import wrap_angle
from tgl_soar.sim.compiled import cell, compiled
wrap = compiled(wrap_angle)
print(wrap(7.0) == wrap_angle(7.0))
print(sum(wrap.stats.cache_hits.values()), sum(wrap.stats.cache_misses.values()))
print(pickle.loads(pickle.dumps(typeof(cell(1.0)))) == typeof(cell(1.0)))
"""


@needs_numba
def test_a_second_process_finds_what_the_first_has_compiled(tmp_path: Path) -> None:
    words = [
        subprocess.run(
            [sys.executable, "-c", CALLS],
            env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        for _ in range(2)
    ]
    assert words == [["True", "0", "1", "True"], ["True", "1", "0", "True"]]


@needs_numba
def test_another_source_has_another_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a module that is only imported by the one that is compiled, and by way of a third."""
    monkeypatch.setattr(kernel_cache, "_ROOT", tmp_path)
    package = tmp_path / "house"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "top.py").write_text("from house.middle import X\nfrom house import side\n")
    (package / "middle.py").write_text("import house.bottom\nX = 1\n")
    for name in ("side", "bottom", "stranger"):
        (package / f"{name}.py").write_text("Y = 1\n")
    keys = [source_key(["house.top"])]
    for name in ("top", "middle", "side", "bottom"):
        with (package / f"{name}.py").open("a") as file:
            file.write("Z = 2\n")
        keys.append(source_key(["house.top"]))
    assert len(set(keys)) == 5
    (package / "stranger.py").write_text("Y = 2\n")
    assert source_key(["house.top"]) == keys[-1]


def kept_beside(monkeypatch: pytest.MonkeyPatch, cache: Path, sizes: list[int]) -> list[int]:
    """Which of some old sources stay, the youngest first, when a new one is used."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    base = cache / "tgl_soar/kernels"
    for age, size in enumerate(sizes):
        (base / f"{age}/sim").mkdir(parents=True)
        (base / f"{age}/sim/kernel").write_bytes(bytes(size))
        os.utime(base / f"{age}", (1e9 - age, 1e9 - age))
    kernel_cache.folder.cache_clear()
    try:
        now = kernel_cache.folder(MODULES).name
    finally:
        kernel_cache.folder.cache_clear()
    left = {path.name for path in base.iterdir()}
    assert now in left
    return sorted(int(name) for name in left - {now})


@needs_numba
def test_the_sources_used_last_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert kept_beside(monkeypatch, tmp_path, [1] * (KEPT + 2)) == [*range(KEPT - 1)]


@needs_numba
def test_they_take_no_more_of_the_disk_than_they_may(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_cache, "KEPT_BYTES", 300_000)  # folders count, too
    assert kept_beside(monkeypatch, tmp_path, [100_000, 100_000, 100_000, 1]) == [0, 1]


@needs_numba
def test_what_is_used_stays_whatever_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_cache, "KEPT_BYTES", 0)
    assert kept_beside(monkeypatch, tmp_path, [1]) == []


@needs_numba
def test_what_is_inlined_becomes_no_machine_code_of_its_own() -> None:
    from numba import typeof

    from tgl_soar.sim.inlined_functions import InnerLibrary

    place = SoaringFrame(1.0, 2.0, -3.0, 0.4), 5.0, 6.0, 7.0
    assert compiled(ned_from_soaring)(*place) == ned_from_soaring(*place)
    called: Any = ned_vector_from_soaring
    kernel, kind_of = _kernels()[called], cast(Any, typeof)
    kernel.compile(tuple(kind_of(argument) for argument in place))
    (inner,) = kernel.overloads.values()
    assert isinstance(inner.library, InnerLibrary)
    assert not inner.library.get_pointer_to_function(inner.fndesc.llvm_func_name)


def one_more(number: int) -> int:
    return number + 1


@needs_numba
def test_without_a_place_it_is_compiled_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    (tmp_path / "file").write_text("no folder")
    kernel_cache.folder.cache_clear()
    try:
        assert kernel_cache.kept(one_more, MODULES)(2) == 3
    finally:
        kernel_cache.folder.cache_clear()

"""A jet that was worked out once is read, and never for another one."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from tgl_soar.air import kept_jets
from tgl_soar.air.grid import GridTable
from tgl_soar.air.kept_jets import KEPT, kept

SHAPE, OTHER = (0.4, 2.45), (0.4, 2.46)
TABLE = GridTable(
    x0_m=-1.1, dx_m=0.025, nx=2, z0_m=0.0, dz_m=0.1, nz=1, values=[0.1, -0.2, 1.0 / 3.0, 0.0]
)


class Maker:
    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> GridTable:
        self.made += 1
        return TABLE


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "tgl_soar/jets"


def test_it_is_made_once_and_read_to_the_last_bit(folder: Path) -> None:
    make = Maker()
    for _ in range(3):
        table = kept(SHAPE, make)
        assert table == TABLE
        assert isinstance(table.nx, int)
        assert type(table.values) is list
    assert make.made == 1
    assert len(list(folder.iterdir())) == 1


def test_another_shape_and_another_source_are_made(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make = Maker()
    kept(SHAPE, make)
    kept(OTHER, make)
    assert make.made == 2
    source = tmp_path / "air"
    shutil.copytree(kept_jets._SOURCE, source)
    monkeypatch.setattr(kept_jets, "_SOURCE", source)
    kept(SHAPE, make)
    assert make.made == 2  # the same source, wherever it lies
    (source / "relief.py").write_text("")
    kept_jets._key.cache_clear()
    kept(SHAPE, make)
    assert make.made == 3
    assert len(list(folder.iterdir())) == 3


def test_what_is_not_whole_is_made_and_put_right(folder: Path) -> None:
    make = Maker()
    kept(SHAPE, make)
    (path,) = folder.iterdir()
    for harm in (path.read_bytes()[:-9], b"", b"no array"):
        path.write_bytes(harm)
        assert kept(SHAPE, make) == TABLE
        assert kept(SHAPE, make) == TABLE
    assert make.made == 4


def test_without_a_place_it_is_made_each_time(folder: Path) -> None:
    folder.parent.write_text("no folder")
    make = Maker()
    assert kept(SHAPE, make) == kept(SHAPE, make) == TABLE
    assert make.made == 2


def test_those_not_used_for_longest_are_deleted(folder: Path) -> None:
    assert KEPT == 16  # of a megabyte each: what a user's cache may take
    folder.mkdir(parents=True)
    for age in range(KEPT + 2):
        (folder / f"{age}").touch()
        os.utime(folder / f"{age}", (1e9 - age, 1e9 - age))
    kept(SHAPE, Maker())
    (new,) = {path for path in folder.iterdir() if path.stat().st_size}
    assert {path.name for path in folder.iterdir()} == {new.name, *map(str, range(KEPT - 1))}
    os.utime(new, (1.0, 1.0))
    kept(SHAPE, Maker())  # it is used: now it is the last to go
    kept(OTHER, Maker())
    assert new.exists()
    assert not (folder / f"{KEPT - 2}").exists()

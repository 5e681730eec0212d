"""`tgl-soar site init`: what is asked of the draft, its report, and what is refused; the
draft itself is made up."""

from __future__ import annotations

import errno
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.terrain.draft import DraftError, Request
from tgl_soar.cli import site_init as e
from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, shipped

PLACE: dict[str, Any] = {"lat": 46.5, "lon": 7.4995, "ridge": 30}
SLOWEST_MPS = load_airframe(shipped("airframes/eclipson_c.toml")).polar.speed_min_mps


class Made(SimpleNamespace):
    """What was drafted."""


def made(**changes: Any) -> Made:
    given: dict[str, Any] = {
        "steepest_deg": 31.4,
        "wind_from_deg": -70.0,
        "field": SimpleNamespace(reference_wind_mps=8.25),
        "ground": SimpleNamespace(points=[(0.0, 0.0)] * 7, above_m=1.26),
    }
    return Made(**{**given, **changes})


def run(
    monkeypatch: pytest.MonkeyPatch, folder: Path, landing: Any = (46.50123, 7.49876), **given: Any
) -> tuple[Any, dict[str, Any]]:
    """The command and what it asked for."""
    asked: dict[str, Any] = {}

    def local_terrain(dem: Path, lat: float, lon: float, reach_m: float) -> str:
        asked["terrain"] = (dem, lat, lon, reach_m)
        return "terrain"

    def draft(terrain: str, request: Request, polar: Any) -> Made:
        asked["draft"] = (terrain, request, polar)
        return made()

    def write(where: Path, _made: Made, name: str, plane: Any, file: Path) -> list[Path]:
        asked["write"] = (where, name, plane, file)
        return [where / "site.toml", where / "air.npz"]

    for name, fake in (("local_terrain", local_terrain), ("draft", draft), ("_write", write)):
        if not given.pop(f"real_{name}", False):
            monkeypatch.setattr(e, name, given.pop(name, fake))
    monkeypatch.setattr(e, "landing_place", lambda _made: landing)
    flags = ["--force"] if given.pop("force", False) else []
    words = [f"--{name.replace('_', '-')}={value}" for name, value in {**PLACE, **given}.items()]
    done = CliRunner().invoke(
        app, ["site", "init", str(folder), "--dem", "there/N46E007.hgt", *words, *flags]
    )
    return done, asked


def test_a_draft_is_requested_in_the_polars_slowest_wind_unless_given(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    done, asked = run(monkeypatch, tmp_path / "new")
    assert done.exit_code == 0, done.output
    terrain, request, polar = asked["draft"]
    assert terrain == "terrain"
    assert request == Request(
        ridge_deg=30.0,
        wind_from_deg=None,
        wind_mps=SLOWEST_MPS,
        reach_m=800.0,
        half_width_m=50.0,
        clearance_m=10.0,
        ceiling_m=120.0,
    )
    assert polar.speed_min_mps == SLOWEST_MPS
    # A crest a quarter of the reach away, and half a fence's width.
    assert asked["terrain"] == (Path("there/N46E007.hgt"), 46.5, 7.4995, 1050.0)
    where, name, plane, file = asked["write"]
    assert (where, name) == (tmp_path / "new", "N46E007 46.5000 7.4995")
    assert plane == load_airframe(shipped("airframes/eclipson_c.toml"))
    assert file == shipped("airframes/eclipson_c.toml")


def test_each_option_is_its_own_number(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    done, asked = run(
        monkeypatch,
        tmp_path,
        wind_from=250,
        wind=9.5,
        reach=400,
        half_width=20,
        clearance=4,
        ceiling=60,
        name="my hill",
        airframe=shipped("airframes/eclipson_c_propeller.toml"),
    )
    assert done.exit_code == 0, done.output
    assert asked["draft"][1] == Request(
        ridge_deg=30.0,
        wind_from_deg=250.0,
        wind_mps=9.5,
        reach_m=400.0,
        half_width_m=20.0,
        clearance_m=4.0,
        ceiling_m=60.0,
    )
    assert asked["terrain"][3] == 520.0
    assert asked["write"][1] == "my hill"
    assert asked["write"][3] == shipped("airframes/eclipson_c_propeller.toml")


def test_what_was_found_is_reported_and_what_is_guessed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    done, _ = run(monkeypatch, tmp_path)
    assert done.stdout.splitlines() == [
        str(tmp_path / "site.toml"),
        str(tmp_path / "air.npz"),
        "a slope of 31° at its steepest, in a wind of 8.25 m/s from 290°; [ground] in 7 points, at"
        " most 1.3 m above the model's",
        "level before the slope: 46.50123, 7.49876; inspect it on the spot",
        "wind and contour are guessed by potential flow: correct them from flights",
    ]
    done, _ = run(monkeypatch, tmp_path, landing=None)
    assert "no level place to land before the slope" in done.stdout
    assert "inspect" not in done.stdout


@pytest.mark.parametrize("name", ["site.toml", "air.npz", "map.png", "plane.png"])
def test_no_file_is_replaced_unless_it_is_asked_for(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / name).touch()
    done, asked = run(monkeypatch, tmp_path)
    assert done.exit_code == 2
    assert f"error: {tmp_path}: has {name} already: --force replaces them" in done.stderr
    assert asked == {}
    assert run(monkeypatch, tmp_path, force=True)[0].exit_code == 0


def test_all_files_that_are_there_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("plane.png", "site.toml"):
        (tmp_path / name).touch()
    assert "has site.toml, plane.png already" in run(monkeypatch, tmp_path)[0].stderr


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (PermissionError(errno.EACCES, "Permission denied", "there/x.hgt"),
         "there/x.hgt: Permission denied"),
        (OSError(errno.ENOSPC, "No space left on device"), "{folder}: No space left on device"),
        (OSError("no words"), "{folder}: no words"),
        (DraftError("no slope there"), "no slope there"),
        (ImportError("no rasterio"), "no rasterio"),
    ],
)  # fmt: skip
def test_what_goes_wrong_is_reported_with_its_file_and_nothing_else(
    error: Exception, says: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fails(*_: object) -> None:
        raise error

    done, _ = run(monkeypatch, tmp_path / "new", draft=fails)
    assert done.exit_code == 2
    assert done.stderr.strip() == f"error: {says.format(folder=tmp_path / 'new')}"
    assert done.stdout == ""


def test_a_folder_that_cannot_be_made_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    done, _ = run(monkeypatch, tmp_path / "file" / "new", real__write=True)
    assert done.exit_code == 2
    assert done.stderr.strip() == f"error: {tmp_path / 'file' / 'new'}: Not a directory"


def test_a_folder_that_was_new_goes_when_its_files_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def full(_path: Path, _field: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(e, "write_npz", full)
    for folder, stays in ((tmp_path / "new", False), (tmp_path, True)):
        done, _ = run(monkeypatch, folder, real__write=True)
        assert done.exit_code == 2
        assert folder.exists() is stays
    assert list(tmp_path.iterdir()) == []

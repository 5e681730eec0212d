"""The LOG of commands: one file, or a folder for its newest log; the airframe that a log holds."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.app import app
from tgl_soar.cli.log_argument import airframe_of, newest_log
from tgl_soar.config.files import load_airframe, shipped

SPOILERS = shipped("airframes/eclipson_c_spoilers.toml")


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "400"})
    return done.exit_code, done.output


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """The logs of three flights, none of which can be read; the last has two parts."""
    for day, names in (
        ("2026-11-20", ["08_00_00_flight001", "09_00_00_flight002"]),
        ("2026-11-21", ["07_00_00_flight003", "07_00_00_flight003_part2"]),
    ):
        (tmp_path / day).mkdir()
        for name in names:
            (tmp_path / day / f"{name}.ulg").touch()
            (tmp_path / day / f"{name}.tlog").touch()
    return tmp_path


COMMANDS = [
    ("identify",), ("report",), ("log", "info"), ("log", "margins"), ("log", "export"),
    ("replay",), ("polar", "fit"),
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_is_its_newest_log(command: tuple[str, ...], logs: Path) -> None:
    code, output = run(*command, logs)
    newest = logs / "2026-11-21" / "07_00_00_flight003.ulg"
    assert code == 2
    assert f"the newest log in {logs} is {newest}" in output
    assert f"{newest}: empty: " in output


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_without_a_log_is_refused(command: tuple[str, ...], tmp_path: Path) -> None:
    code, output = run(*command, tmp_path)
    assert code == 2
    assert f"{tmp_path}: no flight log is in this folder; name a .ulg" in output


@pytest.mark.parametrize(
    ("command", "why"),
    [
        *((command, "") for command in COMMANDS[:5]),
        (("replay", "--figure", "x.png"), " with --figure"),
    ],
)
def test_of_several_logs_the_newest_is_named(
    command: tuple[str, ...], why: str, logs: Path
) -> None:
    """As a shell makes them of `*/*.ulg`."""
    paths = sorted(logs.rglob("*.ulg"))[:3]
    for i, path in enumerate(paths):
        os.utime(path, (2000.0 + i % 2, 2000.0 + i % 2))
    code, output = run(*command, *paths)
    assert code == 2
    assert f"one log at a time{why}: 3 are named; the newest is {paths[1]}\n" in output


def test_the_newest_log_is_the_first_part_of_the_last_flight_of_a_day_or_of_all(
    logs: Path,
) -> None:
    assert newest_log(logs) == logs / "2026-11-21" / "07_00_00_flight003.ulg"
    assert newest_log(logs / "2026-11-20") == logs / "2026-11-20" / "09_00_00_flight002.ulg"
    assert newest_log(logs / "none") is None


def test_the_airframe_is_the_one_that_is_named_else_the_one_that_the_log_holds() -> None:
    text = SPOILERS.read_text(encoding="utf-8")
    log = Path("a.ulg")
    held = FlightData("a", "ULog", files={"airframe": text})
    spoilers = load_airframe(SPOILERS)
    assert airframe_of(held, None, log) == (spoilers, text, "a.ulg, airframe file")
    other = shipped("airframes/eclipson_c.toml")
    plain = other.read_text(encoding="utf-8")
    assert airframe_of(held, other, log) == (load_airframe(other), plain, str(other))
    with pytest.raises(LogError, match=r"a\.ulg: holds no airframe file: name one with --airframe"):
        airframe_of(FlightData("a", "ULog"), None, log)

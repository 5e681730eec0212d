"""Bad logs, as a user meets them: what could be read is used, losses are reported, no more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import flown
import pytest
from typer.testing import CliRunner

from tgl_soar.cli.app import app

COMMANDS: dict[str, tuple[str, ...]] = {
    "replay": ("replay", "{log}"),
    "report": ("report", "{log}", "-o", "{out}"),
    "polar": ("polar", "fit", "{log}"),
    "identify": ("identify", "{log}"),
    "info": ("log", "info", "{log}"),
    "csv": ("log", "export", "{log}", "--to", "csv", "--out", "{out}/csv"),
    "netcdf": ("log", "export", "{log}", "--to", "netcdf", "--out", "{out}/x.nc"),
    "mcap": ("log", "export", "{log}", "--to", "mcap", "--out", "{out}/x.mcap"),
}
PICTURE = b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20
LAYOUT = b"char[1] ver_log"


def run(command: str, log: Path, out: Path) -> tuple[int, str]:
    """Exit code and words; a traceback is no word."""
    result = CliRunner().invoke(app, [a.format(log=log, out=out) for a in COMMANDS[command]])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output.replace("\n", " ")


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return flown.our_log(tmp_path_factory.mktemp("ours")).read_bytes()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty"),
        (bytes(4000), "only zeros|not a ULog"),
        (PICTURE, "no log that is known|not a ULog"),
    ],
)
def test_of_what_is_no_log_nothing_is_made(
    tmp_path: Path, command: str, data: bytes, words: str
) -> None:
    log, out = tmp_path / "flight.ulg", tmp_path / "out"
    log.write_bytes(data)
    code, output = run(command, log, out)
    assert code == 2
    assert "flight.ulg: " in output
    assert any(word in output for word in words.split("|"))
    assert not out.exists()


def _cut(ours: bytes) -> bytes:
    return ours[: int(0.1 * len(ours)) + 5]


def _newer(ours: bytes) -> bytes:
    return ours[:7] + b"\x09" + ours[8:]


def _other_layout(ours: bytes) -> bytes:
    return ours.replace(LAYOUT + b"2", LAYOUT + b"9")


@pytest.mark.parametrize(
    ("command", "bad", "words"),
    [
        (command, bad, words)
        for command in COMMANDS
        for bad, words in ((_cut, "cut off"), (_newer, "version 9"), (_other_layout, "layout 9"))
        if command != "report" or bad is _cut  # the page of a whole flight takes its time
    ],
)
def test_what_is_lost_of_ours_is_reported_and_the_rest_is_used(
    ours: bytes, tmp_path: Path, command: str, bad: Callable[[bytes], bytes], words: str
) -> None:
    log = tmp_path / "flight.ulg"
    log.write_bytes(bad(ours))
    code, output = run(command, log, tmp_path)
    # It holds no glide and no step of the elevator: there is nothing to fit.
    assert code == (2 if command in ("polar", "identify") else 1), output
    assert words in output
    made = {
        "replay": "ticks in",
        "report": "flight.html",
        "info": " MB, ",
        "csv": "tick.csv",
        "netcdf": "x.nc",
        "mcap": "x.mcap",
    }
    assert made.get(command, "flight.ulg: ") in output.replace(" ", "") + output


@pytest.mark.parametrize("command", ["polar", "identify", "info", "csv", "netcdf", "mcap"])
@pytest.mark.parametrize("jump_s", [-3, 7200])
def test_a_clock_that_jumps_is_reported(tmp_path: Path, command: str, jump_s: int) -> None:
    log = flown.px4_log(tmp_path, jump_us=jump_s * 1_000_000)
    code, output = run(command, log, tmp_path)
    assert code == (2 if command in ("polar", "identify") else 1), output
    assert "7200 s without a" in output if jump_s > 0 else "the clock" in output


@pytest.mark.parametrize("write", [flown.px4_log, flown.dataflash_log])
def test_the_log_of_another_autopilot_does_not_replay(
    tmp_path: Path, write: Callable[..., Path]
) -> None:
    code, output = run("replay", write(tmp_path), tmp_path)
    assert code == 2
    assert "not a log of tgl_soar" in output or "not a ULog" in output


def test_bytes_of_a_wire_that_are_no_frame_are_reported_and_the_rest_flies(tmp_path: Path) -> None:
    wire = flown.tlog(tmp_path)
    wire.write_bytes(wire.read_bytes()[: wire.stat().st_size // 10])
    code, output = run("replay", wire, tmp_path)
    assert code == 1
    assert "bytes are no frame" in output
    assert "ticks in" in output

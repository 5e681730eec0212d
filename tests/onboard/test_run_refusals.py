"""What the flying process refuses, and what it warns of, before it flies."""

import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from module_process import AIRFRAME, SITE, arguments

from tgl_soar.link.messages import Source
from tgl_soar.onboard import process
from tgl_soar.onboard.command_line import options_of
from tgl_soar.onboard.process import (
    EXIT_CANNOT_START,
    EXIT_LINK_NOT_READY,
    EXIT_NO_AUTOPILOT,
    main,
)


def test_a_port_in_use_is_reported_without_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        link = f"udp:127.0.0.1:{other.getsockname()[1]}"
        assert main(arguments(link, "--no-watchdog")) == EXIT_LINK_NOT_READY
    assert "is in use" in capsys.readouterr().err


def test_a_missing_file_is_reported_without_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["--airframe", "none.toml", "--site", str(SITE), "--link", "udp:127.0.0.1:1"]
    assert main(command) == EXIT_CANNOT_START
    assert "none.toml" in capsys.readouterr().err


def test_a_key_that_others_can_read_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o644)
    assert (
        main(arguments("udp:127.0.0.1:1", "--no-watchdog", "--signing-key", str(key)))
        == EXIT_CANNOT_START
    )
    assert "others may read" in capsys.readouterr().err


def test_a_key_file_that_no_system_can_look_at_is_reported_without_a_traceback(
    capsys: pytest.CaptureFixture[str],
) -> None:
    key = "k" * 300  # no name of a file is so long
    signing = ("--signing-key", key, "--allow-setup-signing")
    assert main(arguments("udp:127.0.0.1:1", "--no-watchdog", *signing)) == EXIT_CANNOT_START
    assert f"{key}: cannot be read: File name too long" in capsys.readouterr().err


@pytest.mark.parametrize("lacks", ["", "stall_alpha_rad"])
def test_a_model_in_part_is_reported_as_then_nothing_is_foreseen(
    lacks: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    airframe = tmp_path / "airframe.toml"
    lines = AIRFRAME.read_text().splitlines(keepends=True)
    airframe.write_text("".join(x for x in lines if not (lacks and x.startswith(f"{lacks} "))))
    files = ["--airframe", str(airframe), "--site", str(SITE), "--state", "none", "--no-watchdog"]
    ends = ["--link", "udpout:127.0.0.1:9", "--lockstep", "--timeout", "0.1"]
    assert main([*files, *ends]) == EXIT_NO_AUTOPILOT
    words = f"[model] has no {lacks}: so the air is not estimated, and nothing is foreseen"
    assert (words in capfd.readouterr().err) == bool(lacks)


@pytest.mark.parametrize("given", ["nan", "-1", "0", "inf", "-inf", "1e9", "soon", ""])
def test_a_timeout_that_is_none_is_refused_with_what_is_allowed(
    given: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        options_of(arguments("udp:127.0.0.1:1", f"--timeout={given}"))
    assert ended.value.code == EXIT_CANNOT_START
    assert f"{given}: must be a number of seconds above 0, 86400 at most" in capsys.readouterr().err


@pytest.mark.parametrize("log", ["none", "logs"])
def test_files_whose_names_are_no_utf8_are_flown(
    log: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "d\udcfcnn"  # as Python reads an umlaut of Latin-1
    folder.mkdir()
    airframe = folder / "a\udcfc.toml"
    airframe.write_bytes(AIRFRAME.read_bytes())
    files = ["--airframe", str(airframe), "--site", str(SITE), "--state", str(folder)]
    where = log if log == "none" else str(folder / log)
    ends = ["--log", where, "--lockstep", "--timeout", "0.5"]
    assert main([*files, "--link", "udpout:127.0.0.1:9", *ends]) == EXIT_NO_AUTOPILOT
    assert "d?nn/a?-tunnel" in capfd.readouterr().err


@pytest.mark.parametrize("signs", [False, True])
def test_a_link_that_others_reach_is_warned_of_unless_it_is_signed(
    signs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever reaches an open link could fly the aircraft; a loopback's is out of reach."""
    names = ("udp:0.0.0.0:14550", "udp:127.0.0.1:14551")
    opened: Any = SimpleNamespace(
        transports=[SimpleNamespace(name=name) for name in names],
        setup=SimpleNamespace(own=Source(1, 191)),
    )
    words: list[str] = []
    monkeypatch.setattr(process, "say", words.append)
    process._tell_start(opened, signs=signs)
    assert words[0] == "listening on udp:0.0.0.0:14550, udp:127.0.0.1:14551 as 1:191"
    warned = [line.split()[1] for line in words[1:] if line.startswith("WARNING")]
    assert warned == ([] if signs else ["udp:0.0.0.0:14550"])

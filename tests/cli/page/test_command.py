"""`tgl-soar page`: what it refuses, what it says, and what of it a wheel carries."""

from __future__ import annotations

import builtins
import socket
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import pytest
from installed_wheel import Installed
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.cli.page.command import _announce, _check_token

STATIC = Path(__file__).parents[3] / "src/tgl_soar/cli/page/static"


def printed(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["page", *arguments], env={"COLUMNS": "300"})
    return done.exit_code, done.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "give --link"),
        (("--link", "udp:127.0.0.1:14550", "--log", "x.ulg"), "one of them"),
        (("--link", "udp:127.0.0.1:14550", "--token", "short"), "give 16 or more"),
        (("--link", "udp:127.0.0.1:14550", "--token", "x" * 129), "give 128 or fewer"),
        (("--link", "udp:127.0.0.1:14550", "--token", "two words are none"), "without a space"),
        (("--link", "udp:127.0.0.1:14550", "--token", "sixteen-letters-ä"), "of ASCII"),
        (("--link", "udp:127.0.0.1:14550", "--token", "sixteen-letters\n-"), "of ASCII"),
    ],
)
def test_what_cannot_be_is_refused_with_the_way_out(arguments: tuple[str, ...], words: str) -> None:
    code, text = printed(*arguments)
    assert code == 2
    assert words in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--link", "pigeon:1"), "unknown kind 'pigeon'"),
        (("--log", "no-such.ulg"), "no-such.ulg: cannot be read"),
        (("--link", "udpout:127.0.0.1:9", "--signing-key", "none.key"), "none.key: cannot be read"),
    ],
)
def test_a_bad_link_log_or_key_is_named(arguments: tuple[str, ...], words: str) -> None:
    pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
    pytest.importorskip("starlette", reason="the extra `page` is not installed")
    code, text = printed(*arguments)
    assert code == 2
    assert words in text


@pytest.mark.parametrize("token", ["Zk+3q/aa%41&b=c#d?", "x" * 128, "-_a-usual-one._~"])
def test_the_address_carries_the_token_as_a_browser_reads_it(
    token: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        _announce(listener, token, "127.0.0.1")
    _, _, behind = capsys.readouterr().out.strip().partition("#")
    assert parse_qs(behind) == {"token": [token]}
    _check_token(token)  # and it is taken


def test_a_port_that_is_taken_is_named() -> None:
    pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
    pytest.importorskip("starlette", reason="the extra `page` is not installed")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        code, text = printed("--link", "udpout:127.0.0.1:9", "--port", port)
    assert code == 2
    assert f"--port {port}: cannot be served at" in text


def test_it_serves_at_the_port_that_it_says_until_it_is_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ctrl-C is no error, and the port is free again then."""
    uvicorn = pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
    pytest.importorskip("starlette", reason="the extra `page` is not installed")
    served: list[tuple[socket.socket, int]] = []

    class Stopped:
        def __init__(self, config: object) -> None:
            assert isinstance(config, uvicorn.Config)

        def run(self, sockets: list[socket.socket]) -> None:
            (listener,) = sockets
            served.append((listener, listener.getsockname()[1]))
            raise KeyboardInterrupt

    monkeypatch.setattr(uvicorn, "Server", Stopped)
    code, text = printed("--link", "udpout:127.0.0.1:9", "--port", "0")
    assert code == 0, text
    ((listener, port),) = served
    assert f":{port}/" in text
    assert listener.fileno() == -1


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    there = builtins.__import__

    def missing(name: str, *given: Any, **named: Any) -> Any:
        if name.partition(".")[0] == "uvicorn":
            raise ImportError("No module named 'uvicorn'", name="uvicorn")
        return there(name, *given, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    code, text = printed("--link", "udpout:127.0.0.1:9")
    assert code == 2
    assert "pip install 'tgl_soar[page]'" in text
    assert "uvicorn is missing" in text


def test_the_wheel_has_all_that_the_browser_loads(installed: Installed) -> None:
    with zipfile.ZipFile(installed.wheel) as wheel:
        inside = {Path(name).name for name in wheel.namelist() if "/cli/page/static/" in name}
    assert inside == {path.name for path in STATIC.iterdir()}

"""Ctrl-C while a command's libraries load ends it with a word, as it does later."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tgl_soar.cli import __main__ as cli

ROOT = Path(__file__).parents[2]
# A library that is interrupted as it loads, and makes something else of a KeyboardInterrupt.
SLOW = """\
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
except BaseException:
    raise ImportError("no such library")
"""


@pytest.fixture(autouse=True)
def as_it_was() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("words", "library", "code", "error"),
    [
        (["-m", "tgl_soar.cli", "margins"], "typer", 130, "error: stopped\n"),
        (["-m", "tgl_soar.cli", "run", "--help"], "msgspec", 0, ""),
        ([str(ROOT / "tools/sitl_bridge.py"), "--help"], "numpy", 130, "error: stopped\n"),
    ],
)
def test_an_interrupted_import_is_no_traceback(
    tmp_path: Path, words: list[str], library: str, code: int, error: str
) -> None:
    (tmp_path / f"{library}.py").write_text(SLOW)
    path = os.pathsep.join([str(tmp_path), *sys.path])
    ran = subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (ran.returncode, ran.stderr, ran.stdout) == (code, error, "")


@pytest.mark.parametrize(
    ("words", "code", "error"), [(["run"], 0, ""), (["margins"], 130, "error: stopped\n")]
)
def test_an_interrupt_before_it_is_taken_is_no_traceback(
    words: list[str],
    code: int,
    error: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Such as while gains are sought, before a flight has begun."""

    def interrupted() -> None:
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_loaded_command", lambda: interrupted)
    monkeypatch.setattr(sys, "argv", ["tgl-soar", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == code
    assert capsys.readouterr().err == error


def test_real_errors_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ImportError("no such library")

    monkeypatch.setattr(cli, "_loaded_command", broken)
    monkeypatch.setattr(sys, "argv", ["tgl-soar", "margins"])
    with pytest.raises(ImportError):
        cli.main()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_signal_that_is_handled_elsewhere_is_left() -> None:
    """Ignored by nohup, or taken by a program that calls main; a thread may change nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cli.begin_loading()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    cli.loaded()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    signal.signal(signal.SIGINT, signal.default_int_handler)
    beside = threading.Thread(target=cli.begin_loading)
    beside.start()
    beside.join()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    cli.begin_loading()
    assert signal.getsignal(signal.SIGINT) is cli.stop_at_once
    cli.loaded()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

"""`tgl-soar identify`: what it says where its file cannot be written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import typer

from tgl_soar.cli import identify as module
from tgl_soar.config.files import load_airframe, shipped

AIRFRAME = shipped("airframes/eclipson_c.toml")
TEXT = AIRFRAME.read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def same(monkeypatch: pytest.MonkeyPatch) -> None:
    """A text of the file that needs no flight: that of the shipped one."""
    monkeypatch.setattr(module, "with_identified", lambda text, *_: text)


def test_a_file_that_cannot_be_written_ends_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An earlier file is not taken for what was identified now."""
    out = tmp_path / "none" / "new.toml"
    found: Any = None
    with pytest.raises(typer.Exit) as ended:
        module._write(out, TEXT, "old.toml", found, found)
    assert ended.value.exit_code == 2
    printed, errors = capsys.readouterr()
    assert printed == ""
    output = " ".join(errors.split())
    assert "new.toml: cannot be written: No such file or directory" in output


def test_a_file_that_is_written_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new.toml"
    found: Any = None
    module._write(out, TEXT, "old.toml", found, found)
    assert load_airframe(out) == load_airframe(AIRFRAME)
    output = " ".join(capsys.readouterr().out.split())
    assert "compare it with old.toml before you fly with it" in output

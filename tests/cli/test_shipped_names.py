"""`--site hill`, `--airframe eclipson_c`: what is shipped is known by name, files first."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.files import (
    ConfigError,
    airframe_file,
    load_airframe,
    load_site,
    shipped,
    shipped_names,
    site_file,
)
from tgl_soar.onboard import process
from tgl_soar.sim.bridge import command_line


def test_what_is_shipped_is_known_by_name() -> None:
    names = ("hill", "tunnel", "tunnel_mocap", "tunnel_polynomial", "tunnel_search")
    assert shipped_names("sites") == names
    assert site_file("hill") == shipped("sites/hill.toml")
    assert load_site(site_file("hill")).site.name == "half-cylinder hill of 8 m"
    assert load_airframe(airframe_file("eclipson_c")).airframe.name == "Eclipson Model C"


def test_a_file_comes_before_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tunnel").mkdir()  # a folder is no file
    shutil.copy(shipped("sites/tunnel.toml"), tmp_path / "hill")
    assert site_file("hill") == Path("hill")
    assert site_file("tunnel") == shipped("sites/tunnel.toml")


@pytest.mark.parametrize("given", ["hill.toml", "sites/hill", "../sites/hill", "eclipson_c", ""])
def test_nothing_else_is_guessed(given: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    assert site_file(given) == Path(given)


def test_a_name_that_is_neither_is_answered_by_the_names(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"hil.*by name: hill, tunnel, tunnel_mocap, tunnel_polynomial, tunnel_search$",
    ):
        load_site(site_file(tmp_path / "hil"))
    known = r"known by name: eclipson_c, eclipson_c_propeller, eclipson_c_spoilers$"
    with pytest.raises(ConfigError, match=known):
        load_airframe(airframe_file(tmp_path / "x.toml"))


def _options(of: Any, name: str) -> Iterator[Any]:
    """Every option of a command that takes an airframe or a site file."""
    for word, each in getattr(of, "commands", {}).items():
        yield from _options(each, f"{name} {word}".strip())
    for parameter in of.params:
        # `init` takes a name alone: it copies what is shipped.
        if parameter.name in ("airframe", "site") and name != "init":
            yield pytest.param(of, parameter, id=f"{name} {parameter.name}")


@pytest.mark.parametrize(("command", "parameter"), list(_options(typer.main.get_command(app), "")))
def test_every_command_knows_them(command: Any, parameter: Any) -> None:
    names = {"airframe": ("eclipson_c", airframe_file), "site": ("hill", site_file)}
    name, meant = names[parameter.name]
    assert parameter.process_value(typer.Context(command), name) == meant(name)
    assert parameter.metavar == "FILE"


def test_run_and_bridge_know_them(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--airframe", "eclipson_c", "--site", "hill"]
    parsed = command_line.parsed(given)
    assert (parsed.airframe, parsed.site) == (airframe_file("eclipson_c"), site_file("hill"))
    assert process.main([*given, "--link", "no:link", "--no-watchdog"]) == process.EXIT_CANNOT_START
    reported = capsys.readouterr().err
    assert "no:link" in reported  # the files were read
    assert "known by name" not in reported


def test_a_command_tells_the_names() -> None:
    reported = CliRunner().invoke(
        app, ["params", "show", "--airframe", "eclipson_c", "--site", "nowhere"]
    )
    assert reported.exit_code == 2
    assert "nowhere: cannot be read" in reported.output
    assert "known by name: hill, tunnel" in reported.output

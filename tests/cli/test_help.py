"""The words of every command, as a terminal shows them."""

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

import pytest
import typer
from rich.markup import render
from typer.testing import CliRunner

from tgl_soar import __version__
from tgl_soar.cli.app import app
from tgl_soar.cli.console import hint, say


def commands(of: Any, name: str) -> Iterator[tuple[str, Any]]:
    yield name, of
    for word, each in getattr(of, "commands", {}).items():
        yield from commands(each, f"{name} {word}".strip())


ALL = dict(commands(typer.main.get_command(app), ""))


@pytest.mark.parametrize("name", ALL)
def test_brackets_in_help_are_no_markup(name: str) -> None:
    """`[mocap]` and `[m]` are words of ours; rich takes what is not escaped for a style."""
    command = ALL[name]
    options = [getattr(each, "help", None) for each in command.params]
    for text in (command.help, *options):
        if text:
            assert render(text).plain.count("[") == text.count("["), text


@pytest.mark.parametrize("name", [name for name in ALL if name != "run"])  # which has its own
def test_h_helps(name: str) -> None:
    done = CliRunner().invoke(app, [*name.split(), "-h"])
    assert done.exit_code == 0
    assert "--help" in done.output


def test_the_version_is_reported() -> None:
    done = CliRunner().invoke(app, ["--version"])
    assert (done.exit_code, done.output) == (0, f"tgl-soar {__version__}\n")


def numbers(of: typer.Typer, name: str = "") -> Iterator[tuple[str, str]]:
    """Every command, and an option of it that is a number."""
    for each in of.registered_commands:
        assert each.callback is not None
        word = each.name or each.callback.__name__
        for option, kind in get_type_hints(each.callback).items():
            if float in (kind, *get_args(kind)):
                yield f"{name} {word}".strip(), "--" + option.replace("_", "-")
    for group in of.registered_groups:
        assert group.typer_instance is not None
        yield from numbers(group.typer_instance, f"{name} {group.name}".strip())


@pytest.mark.parametrize("number", ["nan", "inf", "-inf"])
@pytest.mark.parametrize(("name", "option"), list(numbers(app)))
def test_no_option_takes_what_is_no_number(name: str, option: str, number: str) -> None:
    needed = ["x" if each.param_type_name == "argument" else f"{each.opts[0]}=x"
              for each in ALL[name].params if each.required]  # fmt: skip
    words = [*name.split(), f"{option}={number}", *needed]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == 2
    assert f"Invalid value for '{option}'" in done.output


@pytest.mark.parametrize("words", [
    "surfaces --link udp:127.0.0.1:1", "preflight --link udp:127.0.0.1:1 --airframe x",
    "params show", "params diff", "params export x.parm", "params import x.parm", "params reset",
])  # fmt: skip
def test_what_meets_an_aircraft_takes_no_file_for_granted(words: str) -> None:
    done = CliRunner().invoke(app, words.split(), env={"COLUMNS": "200"})
    assert done.exit_code == 2
    assert "Missing option '--" in done.output


@pytest.mark.parametrize(("words", "reported"), [
    ("--autopilot px4", "name it by --px4"),
    ("--autopilot ardupilot", "name it by --ardupilot"),
    ("--route attitude", "--autopilot px4 or --autopilot ardupilot"),
    ("--gcs-local 127.0.0.1:0", "add --realtime"),
    ("--autopilot px4 --px4 /bin/true --receiver rtk", "a real firmware has its own"),
    ("--px4 /bin/true", "flown with --autopilot px4 only"),
    ("--mocap-option version=4.2", "add --mocap natnet"),
])  # fmt: skip
def test_no_option_of_sitl_is_dropped_silently(words: str, reported: str) -> None:
    cleared = {"TGL_SOAR_PX4": "", "TGL_SOAR_ARDUPLANE": ""}
    done = CliRunner().invoke(app, ["sitl", *words.split()], env=cleared)
    assert done.exit_code == 2
    assert reported in done.output


def test_what_is_reported_keeps_its_brackets_and_its_paths(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = "no figure: pip install 'tgl_soar[figures]' " + "/long" * 60
    for speak in (say, hint):
        speak(text)
    out, err = capsys.readouterr()
    assert (out, err) == (f"{text}\n", f"{text}\n")


@pytest.mark.parametrize("words", [["--help"], ["params"], ["run", "--help"], ["modes"]])
def test_a_reader_who_leaves_is_no_matter(words: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "tgl_soar.cli", *words],
        stdout=writing, stderr=subprocess.PIPE, timeout=60, check=False,
    )  # fmt: skip
    os.close(writing)
    assert done.stderr == b""

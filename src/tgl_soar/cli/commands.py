"""Where each command of `tgl-soar` stands: one is loaded when it is asked for.

All of them together load every library of the project, which takes over a second before the first
word of help; most need a quarter of that.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Annotated, Final

import typer

from tgl_soar import __version__
from tgl_soar.cli.console import Commands

# The function, or the group of commands, by the command's name; in the order of the help.
COMMANDS: Final = {
    "init": "init:init",
    "docs": "docs:docs",
    "align": "align:align",
    "report": "report:report",
    "survey": "survey:survey",
    "sitl": "sitl:sitl",
    "page": "page.command:page",
    "glide": "glide:glide",
    "identify": "identify:identify_command",
    "margins": "margins:margins",
    "tune": "tune:tune_command",
    "surfaces": "surfaces:surfaces",
    "preflight": "preflight:preflight",
    "zeuc": "zeuc:zeuc",
    "log": "log:log_app",
    "mocap": "mocap:mocap_app",
    "compile": "compile:compile_command",
    "modes": "modes:modes",
    "replay": "replay:replay",
    "params": "params:params_app",
    "polar": "polar:polar_app",
    "site": "site_init:site_app",  # with what stands beside it
    "experiment": "experiment:experiment",
    "campaign": "campaign:campaign_app",
}


def asked(words: list[str]) -> Commands:
    """The command line for what was typed: with the command that it begins with, or else with all
    of them, among which help lists and a slip of the keys finds the one that was meant."""
    return commands(words[:1] if words and words[0] in COMMANDS else COMMANDS)


def commands(names: Iterable[str]) -> Commands:
    """The command line with `run` and these commands."""
    app = Commands(
        help=main.__doc__,
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(main)
    app.command(
        "run",
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )(run)
    for name in names:
        module, _, attribute = COMMANDS[name].partition(":")
        found = getattr(import_module(f"tgl_soar.cli.{module}"), attribute)
        if isinstance(found, typer.Typer):
            app.add_typer(found, name=name)
        else:
            app.command(name)(found)
    return app


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"tgl-soar {__version__}")
        raise typer.Exit


def main(
    version: Annotated[  # its callback prints it
        bool,
        typer.Option("--version", help="Print the version.", callback=_version, is_eager=True),
    ] = False,
) -> None:
    """An autopilot module that soars a slope on a target gradient line, over MAVLink."""


def run() -> None:
    """Fly: read position and attitude, command the surfaces. See `tgl-soar run --help`."""
    raise AssertionError("tgl_soar.cli hands this on before it gets here")

"""The words of every command, as a terminal shows them."""

from collections.abc import Iterator
from typing import Any

import pytest
import typer
from rich.markup import render

from tgl_soar.commands import app


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

"""A command loads what it needs itself, and no other command's libraries."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import pytest

from tgl_soar.cli import commands
from tgl_soar.cli.commands import COMMANDS, asked

ALL = [f"tgl_soar.cli.{place.partition(':')[0]}" for place in COMMANDS.values()]


@pytest.mark.parametrize(
    ("words", "modules"),
    [
        (["page", "--help"], ["tgl_soar.cli.page.command"]),
        (["params", "show"], ["tgl_soar.cli.params"]),
        (["--help"], ALL),
        (["--version", "params"], ALL),
        (["parms"], ALL),  # the answer names the one that was meant
        ([], ALL),
    ],
)
def test_the_command_that_is_asked_for_is_loaded(
    words: list[str], modules: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []

    def noted(name: str) -> ModuleType:
        loaded.append(name)
        return import_module(name)

    monkeypatch.setattr(commands, "import_module", noted)
    app = asked(words)
    assert loaded == modules
    assert len(app.registered_commands) + len(app.registered_groups) == 1 + len(modules)

"""The whole command line of `tgl-soar`, with every command loaded."""

from __future__ import annotations

from typing import Final

from tgl_soar.cli.commands import COMMANDS, commands

app: Final = commands(COMMANDS)

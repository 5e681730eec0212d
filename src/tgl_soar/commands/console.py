"""Where the commands print, and how they fail."""

from __future__ import annotations

from typing import NoReturn

import typer
from rich.console import Console

from tgl_soar.config import shipped

console = Console()
errors = Console(stderr=True)

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
SITE_MOCAP = shipped("sites/tunnel_mocap.toml")


def fail(message: object, code: int = 2) -> NoReturn:
    """Print an error, which names the way out, and end with a non-zero code."""
    errors.print(f"error: {message}", style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)

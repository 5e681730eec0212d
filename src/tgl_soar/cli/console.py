"""Where the commands print, and how they fail."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from math import isfinite
from typing import Any, Final, NoReturn

import typer
from rich.console import Console
from rich.table import Table
from typer.core import TyperCommand
from typer.models import CommandFunctionType

from tgl_soar.config.airframe import MODEL_OPTIONS, ModelKind
from tgl_soar.config.files import airframe_file, shipped, site_file

console = Console()
errors = Console(stderr=True)

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
SITE_MOCAP = shipped("sites/tunnel_mocap.toml")
SITE_SEARCH = shipped("sites/tunnel_search.toml")

# Of an option that takes such a file, or the name of one that is shipped.
AIRFRAME_FILE: Final[dict[str, Any]] = {"parser": airframe_file, "metavar": "FILE"}
SITE_FILE: Final[dict[str, Any]] = {"parser": site_file, "metavar": "FILE"}


class FlightModel(StrEnum):
    """What the simulation flies, as `config.airframe.MODEL_OPTIONS` has it."""

    RIGID_BODY = "rigid-body"
    POINT_MASS = "point-mass"

    @property
    def kind(self) -> ModelKind:
        """As the airframe file has it."""
        return MODEL_OPTIONS[self.value]


MODEL_HELP: Final = "Six degrees of freedom, or the paper's point mass; the airframe file's."


class FiniteCommand(TyperCommand):
    """A command whose numbers are numbers: nan and inf pass every range of an option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the options in.  Errors: `typer.BadParameter`."""
        rest = super().parse_args(ctx, args)
        parameters: list[Any] = list(self.params)  # of a type that is typer's own affair
        for parameter in parameters:
            value = ctx.params.get(parameter.name)
            for number in value if isinstance(value, list | tuple) else (value,):
                if isinstance(number, float) and not isfinite(number):
                    raise typer.BadParameter(f"{number} is no number to work with", ctx, parameter)
        return rest


class Commands(typer.Typer):
    """Commands that take finite numbers only."""

    def command(
        self, name: str | None = None, **options: Any
    ) -> Callable[[CommandFunctionType], CommandFunctionType]:
        """As typer's own."""
        return super().command(name, **{"cls": FiniteCommand, **options})


PIPED_WIDTH: Final = 240  # columns: in a file no name has to be cut


def show(table: Table) -> None:
    """Print a table; where nobody's terminal is asked for its width no cell is cut."""
    if console.is_terminal:
        console.print(table)
    else:
        Console(file=console.file, width=max(console.width, PIPED_WIDTH)).print(table)


def say(message: object) -> None:
    """Print a sentence as it is: no markup in it, and its paths in one piece."""
    console.print(str(message), markup=False, highlight=False, soft_wrap=True)


def hint(message: object) -> None:
    """Print likewise, beside what is asked for."""
    errors.print(str(message), markup=False, highlight=False, soft_wrap=True)


def fail(message: object, code: int = 2) -> NoReturn:
    """Print an error, which names the way out, and end with a non-zero code."""
    errors.print(f"error: {message}", style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)

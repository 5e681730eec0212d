"""`tgl-soar params`: the reference of parameters."""

from __future__ import annotations

from rich.table import Table

from tgl_soar.parameters import PARAMETERS

from .console import console


def params() -> None:
    """List every parameter with its unit, range, default and meaning."""
    table = Table("name", "unit", "from", "to", "default", "meaning", box=None)
    for p in PARAMETERS:
        table.add_row(
            p.name, p.unit, f"{p.minimum:g}", f"{p.maximum:g}", f"{p.default:g}", p.meaning
        )
    console.print(table)

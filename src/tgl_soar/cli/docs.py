"""`tgl-soar docs`: where the manual lies, in a clone as in an installed package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tgl_soar.cli.console import console, fail
from tgl_soar.config.files import manual


def docs(
    page: Annotated[
        str | None,
        typer.Argument(metavar="PAGE", help="Page to print: hardware, logs, …"),
    ] = None,
) -> None:
    """List the pages of the manual and where they are, or print one."""
    pages = {path.stem: path for path in sorted(manual().glob("*.md"))}
    if page is not None:
        path = pages.get(page.removesuffix(".md"))
        if path is None:
            fail(f"no page {page}: there are {', '.join(pages)}")
        console.print(
            path.read_text(encoding="utf-8"),
            highlight=False, markup=False, soft_wrap=True, end="",
        )  # fmt: skip
        return
    for path in pages.values():
        console.print(f"{path}  {_title(path)}", highlight=False, markup=False, soft_wrap=True)


def _title(path: Path) -> str:
    with path.open(encoding="utf-8") as file:
        return file.readline().lstrip("# ").rstrip()

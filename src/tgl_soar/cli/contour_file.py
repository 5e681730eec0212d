"""The `[contour]` table of a site file, put in the place of the old one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import msgspec

from tgl_soar.config.files import ConfigError, load_site, site_from
from tgl_soar.config.parameter_store import write_state

_TABLE: Final = re.compile(r"(?m)^\[{1,2}[A-Za-z]")


def write_contour(path: Path, table: str) -> None:
    """Put a `[contour]` table in the place of a site file's, or at its end; all else stays.

    Errors: `ConfigError` for a file that is none, or in which more than the contour would change;
    OSError.
    """
    before = load_site(path)
    old = path.read_text(encoding="utf-8")
    new = with_contour(old, table)
    after = site_from(new, str(path))
    if msgspec.structs.replace(after, contour=None) != msgspec.structs.replace(
        before, contour=None
    ):
        raise ConfigError(f"{path}: [contour] cannot be replaced alone: put the table in by hand")
    write_state(path.resolve(), new.encode(), None)  # of a link, what it points to


def with_contour(text: str, table: str) -> str:
    """A site file's text with another `[contour]` table; comments before it go with the old one."""
    found = re.search(r"(?m)^\[contour\]", text)
    if found is None:
        return f"{text.rstrip()}\n\n{table}"
    following = _TABLE.search(text, found.end())
    end = len(text) if following is None else following.start()
    ahead = text[: found.start()].split("\n")[:-1]
    while ahead and ahead[-1].startswith("#"):
        ahead.pop()
    # What is written over the next table is that one's.
    body = text[found.start() : end].rstrip("\n").split("\n")
    own = len(body)
    while own and (not body[own - 1].strip() or body[own - 1].startswith("#")):
        own -= 1
    rest = "\n".join(body[own:]).strip("\n")
    tail = "\n".join(part for part in (rest, text[end:]) if part)
    return "\n".join([*ahead, table.rstrip("\n")]) + (f"\n\n{tail}" if tail else "\n")

"""The systemd unit for one folder, made of the shipped one, so that both confine alike."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from tgl_soar.config.files import shipped

_HEAD: Final = """\
# The module as a service of this computer, made by `tgl-soar init`.
#
#   sudo install -m 644 tgl-soar.service /etc/systemd/system/
#   sudo systemctl daemon-reload && sudo systemctl enable --now tgl-soar
#   journalctl -fu tgl-soar

"""
# What `ProtectHome=` and `PrivateTmp=` of the unit hide from the service.
_HOMES: Final = (Path("/home"), Path("/root"), Path("/run/user"))
_TEMPORARY: Final = (Path("/tmp"), Path("/var/tmp"))


def unit(command: Sequence[str], needed: Iterable[Path]) -> str:
    """The unit that starts a command.

    needed: what the service must be able to read.  Where that lies in somebody's home, it runs as
    that user, who alone may read there, and sees homes read-only.
    """
    text = shipped("systemd/tgl-soar.service").read_text(encoding="utf-8")
    text = _HEAD + text[text.index("[Unit]") :]
    text = _replaced(text, r"(?m)^# FLIGHT=.*\nEnvironmentFile=.*\n", "")
    text = _replaced(text, r"(?m)^ExecStart=.*$", f"ExecStart={' '.join(map(quoted, command))}")
    owner = _owner(needed)
    if owner:
        text = _replaced(text, r"(?m)^DynamicUser=yes$", f"User={owner}")
        text = _replaced(text, r"(?m)^ProtectHome=yes$", "ProtectHome=read-only")
    return text


def hidden(needed: Iterable[Path]) -> list[Path]:
    """Which of these the service cannot read, whatever its unit says."""
    return [path for path in needed if _below(path, _TEMPORARY) or _below(path, [Path("/root")])]


def quoted(word: str) -> str:
    """A word of a command line of systemd, which expands % and $ as well."""
    word = word.replace("%", "%%").replace("$", "$$")
    if re.fullmatch(r"[\w@%$+=:,./-]+", word):
        return word
    escaped = word.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _owner(needed: Iterable[Path]) -> str:
    """Whose home it is; empty where no home is needed, or root's, which no service should be."""
    for path in needed:
        if _below(path, _HOMES):
            there = next(each for each in (path, *path.parents) if each.exists())
            if there.owner() != "root":
                return there.owner()
    return ""


def _below(path: Path, roots: Iterable[Path]) -> bool:
    return any(path.is_relative_to(root) for root in roots)


def _replaced(text: str, pattern: str, new: str) -> str:
    changed, count = re.subn(pattern, lambda _found: new, text)
    if count != 1:
        raise ValueError(f"tgl-soar.service: {pattern} stands there {count} times, not once")
    return changed

"""What every command does without options: the defaults and bounds of all options.

    python tests/cli/defaults.py        records them again

`defaults.json` holds those of the last time: a default is a promise, to scripts and to people.
Whoever changes one on purpose records them again, and names it in CHANGELOG.md.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import typer

from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.session import SessionOptions
from tgl_soar.onboard.command_line import options_of
from tgl_soar.onboard.realtime import RealtimeOptions
from tgl_soar.sim.bridge.command_line import parsed

KEPT: Final = Path(__file__).with_name("defaults.json")
_FILES: Final = str(shipped("sites").parent)
_FACTS: Final = (
    *("opts", "secondary_opts", "default", "min", "max", "required", "is_flag", "multiple"),
    *("envvar", "hidden"),
)
FILES: Final = ("--airframe", "eclipson_c", "--site", "tunnel")


def options() -> dict[str, str]:
    """Of every command: each option with its default, its bounds and what else it may be."""
    found = {}
    for name, command in _commands(typer.main.get_command(app), ""):
        for each in command.params:
            facts = {fact: getattr(each, fact, None) for fact in _FACTS}
            kept = {fact: value for fact, value in facts.items() if value not in (None, [])}
            found[f"{name}: {each.name}"] = _plain(kept)
    return found


def without_choices() -> dict[str, str]:
    """The options of the module and of the bridge with the shortest command lines."""
    return {
        "module": _plain(options_of([*FILES, "--link", "udp:127.0.0.1:14550"])),
        "bridge": _plain(parsed(list(FILES))),
        "bridge with NatNet": _plain(parsed([*FILES, "--mocap", "natnet"])),
        **{
            kind.__name__: _plain(kind._field_defaults)
            for kind in (OptitrackSettings, RealtimeOptions, SessionOptions)
        },
    }


def now() -> dict[str, str]:
    """All of them."""
    return options() | without_choices()


def _commands(of: Any, name: str) -> Iterator[tuple[str, Any]]:
    yield name, of
    for word, each in getattr(of, "commands", {}).items():
        yield from _commands(each, f"{name} {word}".strip())


def _plain(value: object) -> str:
    """Its words, without where this project and its objects lie."""
    text = re.sub(r" at 0x\w+", "", repr(value))
    return text.replace(_FILES, "").replace(str(Path.home()), "~")


if __name__ == "__main__":
    KEPT.write_text(json.dumps(now(), indent=0) + "\n", encoding="utf-8")
    print(f"{KEPT}: {len(now())}")

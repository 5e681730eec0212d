"""Where results come from, as a file beside them: of a campaign's flights, of a tuning, of logs
that were replayed.

One format for all, JSON: `Manifest`.  What is kept of a run that was stopped is kept under a key of
all that it depends on (`key_of`), so that results of another source, of other options or of other
libraries are never mixed in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from tgl_soar import __version__
from tgl_soar.config.parameter_store import write_state
from tgl_soar.sim.campaign.encoding import digest
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.provenance import commit, host_metadata, libraries, source_digest


class Manifest(msgspec.Struct, forbid_unknown_fields=True):
    """Where flights come from."""

    name: str
    version: str
    commit: str  # "": no working copy
    source: str  # digest of the program and of the files that it ships
    flight: str  # the function that flies one
    flights: int
    parameters: dict[str, Any]  # all that the jobs depend on
    parameters_digest: str
    seeds: list[int]  # least and greatest; []: jobs have none
    complete: bool = False
    runs: list[dict[str, Any]] = []  # one or more: when, by whom, on what computer


def manifest_of(
    name: str,
    fly: Callable[..., Any],
    flights: int,
    parameters: Mapping[str, Any],
    seeds: tuple[int, int] | None,
) -> Manifest:
    """Of what this process is about to fly."""
    asked = dict(parameters)
    return Manifest(
        name=name,
        version=__version__,
        commit=commit(),
        source=source_digest(),
        flight=f"{fly.__module__}.{fly.__qualname__}",
        flights=flights,
        parameters=asked,
        parameters_digest=digest((flights, asked)),
        seeds=list(seeds or ()),
    )


def key_of(manifest: Manifest) -> str:
    """Of all that the results depend on: the source, what is asked, and the libraries that round.
    The commit is not in it: a page that is written between two runs changes no flight."""
    whole = (manifest.source, manifest.flight, manifest.parameters_digest, libraries())
    return digest(whole)[:32]


def table_metadata(manifest: Manifest) -> dict[str, str]:
    """What a table of flights carries: what does not depend on who flew it, nor when."""
    stable = msgspec.structs.replace(manifest, runs=[], complete=True)
    return {"tgl_soar": msgspec.json.encode(stable).decode()}


def run_by(description: str, before: int) -> dict[str, Any]:
    """A run that begins: by whom, on what computer, and how much was there before it."""
    return {"begun": now(), "by": description, "from": before, **host_metadata()}


def now() -> str:
    """For a run's beginning and its end."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def read_manifest(path: Path) -> Manifest | None:
    """None: there is none.  Errors: `JournalError` for a damaged one."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Manifest)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        raise JournalError(f"{path}: no manifest of a campaign: {error}") from None


def write_manifest(path: Path, manifest: Manifest) -> None:
    """The whole file or none of it.  Errors: OSError."""
    write_state(path, msgspec.json.format(msgspec.json.encode(manifest)), None)

"""What a search has found so far, on disk: it goes on where it was killed.

One JSON file, replaced as a whole after each step (a generation, or a few flights): a kill loses
at most the step that was under way.  The file holds what each step found, and not the searcher's
memory: a search that asks the same questions in the same order is given the old answers at once,
and so goes on exactly as if it had never been stopped.  Beside the answers stands who has sought
them, for the manifest of what comes of it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from tgl_soar.config.parameter_store import write_state
from tgl_soar.sim.campaign.manifest import run_by


class ProgressError(ValueError):
    """A progress file that cannot be used."""


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    task: str  # a digest of all that the answers depend on
    answers: dict[str, Any] = {}
    runs: list[dict[str, Any]] = []  # as a manifest has them


class ProgressFile:
    """The answers of one task, by the name of the question."""

    def __init__(self, path: Path, task: str) -> None:
        """Errors: `ProgressError` for a file that is damaged, or of another task."""
        self.path = path
        self._content = _Content(task)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            return
        except OSError as error:
            raise ProgressError(f"{path}: cannot be read: {error.strerror}") from None
        try:
            found = msgspec.json.decode(data, type=_Content)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise ProgressError(f"{path}: no progress file: {error}; delete it") from None
        if found.task != task:
            raise ProgressError(
                f"{path}: belongs to other files or options, or to another version of this program"
                " or of its libraries: run with those, or with --restart to begin again"
            )
        self._content = found

    @property
    def runs(self) -> list[dict[str, Any]]:
        """Those that found what is there, the one under way last."""
        return self._content.runs

    def begin(self, by: str) -> None:
        """A run begins; it is kept with the first answer that it finds."""
        self._content.runs.append(run_by(by, len(self._content.answers)))

    def answer(self, question: str, find: Callable[[], Any]) -> Any:
        """The answer that is there, or a new one, kept before it is returned.  Errors: OSError."""
        if question not in self._content.answers:
            # As it would be read back: the same whether it was found now or before.
            found = msgspec.json.decode(msgspec.json.encode(find()))
            self._content.answers[question] = found
            write_state(self.path, msgspec.json.encode(self._content), None)
        return self._content.answers[question]

    def delete(self) -> None:
        """It is done."""
        self.path.unlink(missing_ok=True)

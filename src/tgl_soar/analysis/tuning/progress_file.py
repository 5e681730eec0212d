"""What a search has found so far, on disk: it goes on where it was killed.

One JSON file, replaced as a whole after each step (a generation, or a few flights): a kill loses
at most the step that was under way.  The file holds what each step found, and not the searcher's
memory: a search that asks the same questions in the same order is given the old answers at once,
and so goes on exactly as if it had never been stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from tgl_soar.config.parameter_store import write_state


class ProgressError(ValueError):
    """A progress file that cannot be used."""


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    task: str  # a digest of all that the answers depend on
    answers: dict[str, Any] = {}


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
                f"{path}: belongs to other files or options: run with those,"
                " or with --restart to begin again"
            )
        self._content = found

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

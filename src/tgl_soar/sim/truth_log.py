"""What really happened, as a table: one row every few steps, to CSV or to `.npz`."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

import numpy as np


class TruthLogError(RuntimeError):
    """A log that cannot be written on, as on a full disk; the message names file and reason."""


class TruthLog:
    """A table of numbers with named columns.

    A file that ends in `.npz` is written when the log is closed, one array for each column;
    any other is CSV, written as the flight goes on.  Errors: OSError where the file cannot be
    begun, `TruthLogError` where it cannot be gone on with; then it is closed.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.path = path
        self.columns = tuple(columns)
        self.rows = 0
        self._numbers = array("d")
        self._file: TextIO | None = None
        self._is_given_up = False
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".npz":
            path.touch()  # so that a file that cannot be written is found out now
        else:
            self._file = path.open("w", encoding="utf-8", newline="\n")
            self._file.write(",".join(self.columns) + "\n")

    def add(self, row: Sequence[float]) -> None:
        """One row, a number for each column."""
        self.rows += 1
        if self._file is None:
            self._numbers.extend(row)
        else:
            try:
                self._file.write(",".join(f"{number:.9g}" for number in row) + "\n")
            except OSError as error:
                raise self._given_up(error) from None

    def close(self) -> None:
        """Write what is still to be written."""
        try:
            self._close()
        except OSError as error:
            raise self._given_up(error) from None

    def _given_up(self, error: OSError) -> TruthLogError:
        file, self._file = self._file, None
        self._is_given_up = True
        if file is not None:
            with suppress(OSError):  # what is in its buffer finds no room either
                file.close()
        return TruthLogError(f"{self.path}: cannot be written: {error.strerror}")

    def _close(self) -> None:
        if self._is_given_up:
            return
        if self._file is not None:
            self._file.close()
            self._file = None
        elif self.path.suffix == ".npz":
            table = np.asarray(self._numbers).reshape(self.rows, len(self.columns))
            columns: dict[str, Any] = {name: table[:, i] for i, name in enumerate(self.columns)}
            np.savez_compressed(self.path, **columns)

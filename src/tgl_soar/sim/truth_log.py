"""What really happened, as a table: one row every few steps, to CSV or to `.npz`."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np


class TruthLog:
    """A table of numbers with named columns.

    A file that ends in `.npz` is written when the log is closed, one array for each column;
    any other is CSV, written as the flight goes on.  Errors: OSError where the file cannot be
    written.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.path = path
        self.columns = tuple(columns)
        self.rows = 0
        self._numbers = array("d")
        self._file: TextIO | None = None
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
            self._file.write(",".join(f"{number:.9g}" for number in row) + "\n")

    def close(self) -> None:
        """Write what is still to be written."""
        if self._file is not None:
            self._file.close()
            self._file = None
        elif self.path.suffix == ".npz":
            table = np.asarray(self._numbers).reshape(self.rows, len(self.columns))
            columns: dict[str, Any] = {name: table[:, i] for i, name in enumerate(self.columns)}
            np.savez_compressed(self.path, **columns)

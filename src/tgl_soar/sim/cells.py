"""Cells: what compiled functions read and write in place.  It needs numba.

Kernels that are kept on disk know a type by its module and its name: it has both.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.experimental import structref


@structref.register
class CellType(types.StructRef):
    """The type of a cell, as numba sees it."""


class NumbaCell(structref.StructRefProxy):
    """One field, `value`."""

    def __new__(cls, value: object) -> Any:
        return structref.StructRefProxy.__new__(cls, value)  # type: ignore[no-untyped-call]


structref.define_proxy(NumbaCell, CellType, ["value"])  # type: ignore[no-untyped-call]

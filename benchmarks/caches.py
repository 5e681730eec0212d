"""The processor's caches, emptied of what is to be measured cold."""

from __future__ import annotations

from typing import Final

_BYTES: Final = 64 << 20  # more than a core's caches hold, and most of what cores share
_ones, _twos = bytearray(b"\1") * _BYTES, bytearray(b"\2") * _BYTES


def empty() -> None:
    """Nothing that was used before is in a core's own caches any more."""
    _ones[:] = _twos

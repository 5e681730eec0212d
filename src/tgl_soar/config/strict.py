"""What the tables of a configuration file are made of: strict structs, and numbers with a range."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
# Of an aircraft: smaller ones are mistakes, and what is computed from them no number any more.
Measured = Annotated[float, Meta(ge=1e-9, le=1e6)]
SystemId = Annotated[int, Meta(ge=1, le=255)]


class Strict(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a configuration file: what it does not know, it refuses."""

"""What a benchmark reports."""

from __future__ import annotations

from typing import NamedTuple


class Result(NamedTuple):
    """One figure beside its reference, both measured in the same run, in the same unit."""

    what: str
    value: float
    reference: float
    unit: str
    reference_what: str

"""What a benchmark reports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

NO_AIM: Final = float("inf")
ALLOWED: Final = "what is allowed"
INTERPRETED: Final = "the same, interpreted"


class Result(NamedTuple):
    """One figure beside its reference, both measured in the same run, in the same unit."""

    what: str
    value: float
    reference: float
    unit: str
    reference_what: str
    aim: float = NO_AIM  # the largest ratio of the two that is wanted

    @property
    def ratio(self) -> float:
        """Of the figure to its reference; of none to none 1."""
        if self.reference == 0.0:
            return 1.0 if self.value == 0.0 else float("inf")
        return self.value / self.reference

    @property
    def is_met(self) -> bool:
        """Whether the aim is reached."""
        return self.ratio <= self.aim


def percentile(values: Sequence[float], fraction: float) -> float:
    """The value that so large a share of all lies below."""
    return sorted(values)[int(fraction * (len(values) - 1))]

"""How long is measured: as the page has it, or a tenth of it for a first look.

What takes seconds to measure asks here, so that `--quick` reaches the processes of their own too.
"""

from __future__ import annotations

import os
from typing import Final

_QUICK: Final = "TGL_SOAR_BENCH_QUICK"  # in the environment, which processes of ours inherit
_SHORTER: Final = 10
P999_SAMPLES: Final = 30_000  # at least thirty lie beyond


def be_quick() -> None:
    """From here on, and in every process that is started from here on."""
    os.environ[_QUICK] = "1"


def is_quick() -> bool:
    """Whether this is only a first look, and nothing for a page."""
    return _QUICK in os.environ


def length(full: int) -> int:
    """So many seconds or rounds of it."""
    return max(1, full // _SHORTER) if is_quick() else full


def may_be_reported(fraction: float, samples: int) -> bool:
    """Whether so many samples say anything about so far a percentile."""
    return fraction < 0.999 or samples >= P999_SAMPLES

"""Which rate is asked for after one that was refused."""

from __future__ import annotations

from itertools import pairwise

from tgl_soar.link.stream_requests import LOWER_RATES_HZ


def test_the_next_lower_rate_is_no_less_than_two_fifths() -> None:
    """An autopilot that would give 10 Hz of 20 is not left with 5."""
    assert all(0.4 <= lower / higher < 1.0 for higher, lower in pairwise(LOWER_RATES_HZ))
    assert (LOWER_RATES_HZ[0], LOWER_RATES_HZ[-1]) == (160.0, 1.0)

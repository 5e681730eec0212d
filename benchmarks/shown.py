"""A figure as it stands in a table: three digits, and never an exponent."""

from __future__ import annotations


def shown(value: float) -> str:
    """1,090 for 1089.6; 0.00376 for 0.003764."""
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.0f}" if abs(rounded) >= 1000.0 else f"{value:.3g}"


def number(text: str) -> float:
    """What `shown` has made text of, to three digits."""
    return float(text.replace(",", ""))

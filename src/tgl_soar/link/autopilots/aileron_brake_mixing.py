"""Two ailerons that are the brake as well: roll moves them apart, the brake moves both one way.

    left = aileron − throw brake          right = aileron + throw brake

Each servo's positive deflection rolls right, so the left one's is down and the right one's up;
a positive throw brakes with both up.  Within the travel roll comes first: `control.envelope` gives
the brake what the aileron leaves, and here it gives way as well.
"""

from __future__ import annotations


def mixed(aileron: float, brake: float, throw: float) -> tuple[float, float]:
    """Deflections (left, right), -1 … 1, of an aileron, -1 … 1, and a brake, 0 … 1."""
    aileron = max(-1.0, min(1.0, aileron))
    room = 1.0 - abs(aileron)
    apart = max(-room, min(room, throw * brake))
    return aileron - apart, aileron + apart


def unmixed(left: float, right: float, throw: float) -> tuple[float, float]:
    """(aileron, brake) of two servos; NaN of either is NaN of both."""
    return 0.5 * (left + right), 0.5 * (right - left) / throw

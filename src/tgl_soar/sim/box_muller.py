"""Gaussian numbers from uniform ones, in pairs, as the standard library makes them.

Compiled, they are its own to the bit: both call the C library's functions in the same order.
"""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt

from tgl_soar.air.field import FloatArray


def box_muller(uniform: FloatArray, numbers: FloatArray) -> None:
    """Fill `numbers`, shape (2 n,), of unit variance, from `uniform` in [0, 1), shape (n, 2)."""
    for i in range(len(uniform)):
        angle = uniform[i, 0] * (2.0 * pi)
        radius = sqrt(-2.0 * log(1.0 - uniform[i, 1]))
        numbers[2 * i] = cos(angle) * radius
        numbers[2 * i + 1] = sin(angle) * radius

"""The initial states, before anything has come: no number of them claims more than that.

A state begins with what is not known (NaN), with nothing (0), with never (an infinity), or with
what is no number of anything (-1); and nothing is so yet.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from inspect import signature
from math import isinf
from pkgutil import walk_packages
from typing import Any

import numpy as np
import pytest

from tgl_soar import autopilot, control, estimation, types

# Where a state begins with something, and why.
MEANT: dict[str, float] = {
    "BandState.low": -1.0,  # a surface may be anywhere
    "BandState.high": 1.0,
    "GlideState.goes_right": True,  # a weave has to begin somewhere
    "LastImu.interval_s": 0.005,  # of accelerations that come with every tick
    "Limited.brake_max": 1.0,  # nothing limits it
    "Limited.finite": True,  # no command was otherwise
    "RangeState.corrects": True,  # until the ground is found to be otherwise
}


def beginnings() -> Iterator[tuple[str, Any]]:
    """Everything that is called nothing, not, none or initial in what flies."""
    names = [autopilot.__name__, types.__name__]
    for package in (control, estimation):
        names += [m.name for m in walk_packages(package.__path__, f"{package.__name__}.")]
    for module in map(import_module, names):
        for name, value in sorted(vars(module).items()):
            where = f"{module.__name__.removeprefix('tgl_soar.')}.{name}"
            if name.lstrip("_").startswith(("NO_", "NOT_")) and hasattr(value, "_fields"):
                yield where, value
            elif (
                name.startswith("initial_")
                and value.__module__ == module.__name__
                and not signature(value).parameters
            ):
                yield where, value  # made in the test


BEGINNINGS = dict(beginnings())


def leaves(value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    if hasattr(value, "_fields"):
        for name, each in zip(value._fields, value, strict=True):
            yield from leaves(each, f"{type(value).__name__}.{name}")
    elif isinstance(value, tuple):
        for each in value:
            yield from leaves(each, where)
    else:
        yield where, value


def says_nothing(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.size == 0
    if value is None or value == "":
        return True
    return bool(value != value or value in (0, -1) or isinf(value))


def test_they_are_found() -> None:
    assert len(BEGINNINGS) > 40
    assert {"estimation.wind.initial_wind", "types.NO_FIX"} <= set(BEGINNINGS)


@pytest.mark.parametrize("name", sorted(BEGINNINGS))
def test_nothing_is_known_at_first(name: str) -> None:
    begins = BEGINNINGS[name]
    for where, value in leaves(begins() if callable(begins) else begins):
        if where in MEANT:
            assert value == MEANT[where], where
        else:
            assert says_nothing(value), where

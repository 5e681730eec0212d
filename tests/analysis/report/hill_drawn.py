"""A hill and a polar for figures, and what is read off the figures that are made of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.types import GlidePolar

POLAR = GlidePolar(c0=17.7, c1=-3.6, c2=0.2, c3=0.0, speed_min_mps=6.8, speed_max_mps=11.5)
HEAVY = POLAR._replace(c0=POLAR.c0 + 8.0)  # sinks everywhere
HILL, STRONGER = HillField(8.0, 20.0), HillField(8.5, 20.0)
BOUNDS = (-60.0, 0.0, 1.0, 50.0)
STEP_M = 60.0 / 120.0  # of the contour
PATH = Path("figure.png")
BOARD = [(-20.0, 0.0), (0.0, 20.0), (0.0, 0.0)]


def keeping(monkeypatch: pytest.MonkeyPatch, *modules: Any) -> Iterator[list[Any]]:
    """The figures that modules make, in place of files, until they are closed."""
    import matplotlib.pyplot as plt

    figures: list[Any] = []
    for module in modules:
        monkeypatch.setattr(module, "save", lambda _plt, figure, _path: figures.append(figure))
    yield figures
    plt.close("all")


def empty_axes() -> Iterator[Any]:
    """Axes of a figure that is closed afterwards."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots()
    yield axes
    plt.close(figure)


def words(legend: Any) -> list[str]:
    return [text.get_text() for text in legend.get_texts()]


def labelled(axes: Any, label: str) -> list[Any]:
    return [line for line in axes.lines if line.get_label() == label]

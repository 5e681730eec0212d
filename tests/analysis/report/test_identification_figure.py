"""The figure of an identification: which manoeuvre stands where, and what is drawn of it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tgl_soar.analysis.identification import Fit
from tgl_soar.analysis.report import identification_figure as module
from tgl_soar.analysis.report.figure_style import PALETTE


def fit(begin_s: float = 20.0, fitted: bool = True) -> Fit:
    time_s = np.array([begin_s + 0.1 * n for n in range(4)])
    return Fit(
        time_s=time_s,
        elevator=np.array([0.1, 0.3, 0.3, 0.1]),
        pitch_rate_radps=np.array([0.0, 0.1, -0.2, 0.3]),
        model_pitch_rate_radps=np.array([0.0, 0.2, -0.1, 0.4]),
        fitted=fitted,
    )


def drawn(monkeypatch: pytest.MonkeyPatch, fits: list[Fit]) -> Any:
    """The figure, closed when the next one is drawn."""
    figures: list[Any] = []
    monkeypatch.setattr(module, "save", lambda _plt, figure, _path: figures.append(figure))
    found: Any = SimpleNamespace(
        fits=tuple(fits), frequency=SimpleNamespace(value=8.25), damping=SimpleNamespace(value=0.7),
        airspeed_mps=9.04,
    )  # fmt: skip
    module.identification_figure(Path("figure.png"), found, "my.ulg")
    import matplotlib.pyplot as plt

    plt.close("all")
    return figures[0]


def panels(figure: Any) -> list[Any]:
    """The visible axes, without those of the elevator."""
    grid = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    return [axes for axes in grid if axes.get_visible() and axes.get_title()]


def test_rates_are_drawn_in_degrees_from_the_manoeuvres_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    figure = drawn(monkeypatch, [fit(20.4)])
    (panel,) = panels(figure)
    measured, modelled = panel.lines
    for line in (measured, modelled):
        assert line.get_xdata() == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert measured.get_ydata() == pytest.approx(np.degrees([0.0, 0.1, -0.2, 0.3]))
    assert modelled.get_ydata() == pytest.approx(np.degrees([0.0, 0.2, -0.1, 0.4]))
    assert panel.get_title() == "at 20 s, fitted"
    assert panel.get_ylabel() == "pitch rate [°/s]"
    assert panel.get_xlabel() == "time [s]"


def test_the_elevator_stands_below_from_where_it_stood(monkeypatch: pytest.MonkeyPatch) -> None:
    """Held from sample to sample; the axis leaves most of its height to the rates above."""
    figure = drawn(monkeypatch, [fit()])
    (elevator,) = (axes for axes in figure.axes if not axes.axison)
    (line,) = elevator.lines
    assert line.get_ydata() == pytest.approx([0.0, 0.2, 0.2, 0.0])
    assert line.get_xdata() == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert line.get_drawstyle() == "steps-post"
    low, high = elevator.get_ylim()
    assert low <= -0.5
    assert 2.5 <= high <= 4.0


def test_those_that_were_held_out_are_marked_by_word_and_colour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, other = panels(drawn(monkeypatch, [fit(1.0), fit(5.6, fitted=False)]))
    assert [one.get_title(), other.get_title()] == ["at 1 s, fitted", "at 6 s, held out"]
    assert one.lines[1].get_color() == PALETTE[1]
    assert other.lines[1].get_color() == PALETTE[0]
    assert one.lines[0].get_color() == other.lines[0].get_color() not in PALETTE


@pytest.mark.parametrize(
    ("count", "shown", "columns", "rows"),
    [(1, 1, 1, 1), (3, 3, 3, 1), (4, 4, 4, 1), (5, 5, 4, 2), (12, 12, 4, 3), (14, 12, 4, 3)],
)
def test_they_stand_four_in_a_row_and_twelve_at_most(
    monkeypatch: pytest.MonkeyPatch, count: int, shown: int, columns: int, rows: int
) -> None:
    figure = drawn(monkeypatch, [fit(float(n)) for n in range(count)])
    found = panels(figure)
    assert [axes.get_title() for axes in found] == [f"at {n} s, fitted" for n in range(shown)]
    places = [axes.get_subplotspec() for axes in found]
    assert {place.get_gridspec().get_geometry() for place in places} == {(rows, columns)}
    assert [place.num1 for place in places] == list(range(shown))
    # Labels stand at the left, and below the last of each column.
    assert [bool(axes.get_ylabel()) for axes in found] == [n % columns == 0 for n in range(shown)]
    assert [bool(axes.get_xlabel()) for axes in found] == [
        n >= shown - columns for n in range(shown)
    ]


def test_the_title_says_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    words = drawn(monkeypatch, [fit()]).get_suptitle()
    assert words.startswith("my.ulg: short period 8.2 rad/s, damping 0.70 at 9.0 m/s\n")

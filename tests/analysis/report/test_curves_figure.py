"""Curves in panels beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("matplotlib", reason="the extra `figures` is not installed")

from tgl_soar.analysis.report import curves_figure as drawing
from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, curves_figure


def labels_of(legend: Any) -> list[str]:
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("one_legend", [False, True])
def test_what_is_alike_in_all_panels_is_reported_once_below(
    one_legend: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    figures: list[Any] = []
    monkeypatch.setattr(drawing, "save", lambda _plt, figure, _path: figures.append(figure))
    left = [DrawnCurve([0, 1], [1, 2], "with", "C0"), DrawnCurve([0, 1], [2, 1], "without", "C1")]
    right = [*left, DrawnCurve([0, 1], [3, 1], "formula", "C2")]
    panels = [CurvePanel("left", "x", "y", left), CurvePanel("right", "x", "y", right)]
    curves_figure(tmp_path / "curves.png", panels, "both", one_legend=one_legend)
    (figure,) = figures
    within = [labels_of(axes.get_legend()) for axes in figure.axes]
    below = [labels_of(legend) for legend in figure.legends]
    if one_legend:
        assert within == [[], []]
        assert below == [["with", "without", "formula"]]
    else:
        assert within == [["with", "without"], ["with", "without", "formula"]]
        assert below == []


@pytest.mark.parametrize(
    ("named", "shown"),
    [((None, None), []), (("with", None), ["with"]), ((None, "without"), ["without"])],
)
def test_a_panel_has_a_legend_where_any_of_its_curves_has_a_name(
    named: tuple[str | None, str | None],
    shown: list[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    figures: list[Any] = []
    monkeypatch.setattr(drawing, "save", lambda _plt, figure, _path: figures.append(figure))
    curves = [DrawnCurve([0, 1], [1, 2], name, "C0") for name in named]
    curves_figure(tmp_path / "curves.png", [CurvePanel("one", "x", "y", curves)], "")
    (axes,) = figures[0].axes
    assert labels_of(axes.get_legend()) == shown

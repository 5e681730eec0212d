"""Figures of searches: which of the map, of its claim and of its error is drawn where, how much of
the path, and which failures in how many panels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="the extra `figures` is not installed")

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tgl_soar.analysis.search.episode import Episode
from tgl_soar.analysis.search.figures import PANELS, failures_figure, search_figure
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.analysis.search.searchers import Snapshot
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.types import GlidePolar, Ground

X, Z = np.linspace(0.0, 4.0, 5), np.linspace(0.0, 3.0, 4)
# A ramp that rises from 0 to 1 m over 4 m, and is level before and behind it.
RAMP = Ground(2, (0.0, 4.0, *[4.0] * 6), (0.0, *[1.0] * 7))
POLAR = GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=15.0)


class RisingWithTime:
    """Updraft that is the time [m/s], everywhere."""

    reference_wind_mps = 8.0

    def wind(self, x_m: Any, _y_m: Any, _z_m: Any, time_s: float = 0.0) -> Any:
        ones = np.ones_like(x_m)
        return 8.0 * ones, 0.0 * ones, time_s * ones


def episode(seed: int = 7, flown_s: float = 2.0) -> Episode:
    time = np.arange(0.0, 5.0)
    there = SearchPlace(
        kind="tunnel",
        seed=seed,
        site=None,  # type: ignore[arg-type]
        field=RisingWithTime(),  # type: ignore[arg-type]
        ground=RAMP,
        box=Box(0.0, 4.0, 0.0, 3.0),
        duration_s=5.0,
        sink_factor=2.0,
        change=1.0,
        words=f"the place of seed {seed}",
    )
    path = {"time_s": time, "x_m": 4.0 - time, "z_m": 1.5 + 0.25 * time}
    return Episode(place=there, searcher="map", ended="", given_up="", flown_s=flown_s, path=path)


class Drawn:
    """What is given to the axes that draw."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.figures: list[tuple[Any, Path]] = []
        self.filled: dict[Any, tuple[Any, ...]] = {}
        self.lines: dict[Any, list[tuple[Any, ...]]] = {}
        filled, lines = Axes.contourf, Axes.contour

        def contourf(axes: Any, *given: Any, **words: Any) -> Any:
            self.filled[axes] = given
            return filled(axes, *given, **words)

        def contour(axes: Any, *given: Any, **words: Any) -> Any:
            self.lines.setdefault(axes, []).append(given)
            return lines(axes, *given, **words)

        patch.setattr(Axes, "contourf", contourf)
        patch.setattr(Axes, "contour", contour)
        patch.setattr(
            Figure, "savefig", lambda figure, path, **_: self.figures.append((figure, path))
        )


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Drawn:
    return Drawn(monkeypatch)


def ground_of(axes: Any) -> list[tuple[float, float]]:
    """Corners of what covers the colours."""
    (ground,) = [each for each in axes.collections if each.get_zorder() == 3]
    return [(float(x), float(z)) for x, z in ground.get_paths()[0].vertices]


def snapshot(time_s: float, excess_mps: float, sd_mps: float) -> Snapshot:
    """The same everywhere, but that the left edge is 0.5 m/s less: a contour crosses."""
    ones = np.ones((len(X), len(Z)))
    ones[0] = 0.5
    return Snapshot(time_s, np.zeros(1), sd_mps * ones, excess_mps * ones)


def plane(values: Any) -> np.ndarray[Any, Any]:
    return np.asarray(np.ma.filled(np.ma.masked_invalid(values), np.nan))


def test_a_column_is_a_time_with_the_excess_its_claim_and_its_error(drawn: Drawn) -> None:
    """Air that rises by 1 and 3 m/s, of which twice the sink is taken; above the ramp alone."""
    snapshots = [snapshot(1.0, 0.5, 0.2), snapshot(3.0, 2.0, 0.4)]
    search_figure(Path("a.png"), episode(), snapshots, POLAR, X, Z)
    ((figure, path),) = drawn.figures
    assert path == Path("a.png")
    assert figure.get_suptitle() == "the place of seed 7"
    axes = np.array(figure.axes[:6]).reshape(3, 2)
    below = Z[:, None] <= 0.25 * X[None, :]
    for k, (time_s, mapped, sd) in enumerate(((1.0, 0.5, 0.2), (3.0, 2.0, 0.4))):
        truth = time_s - 2.0 * 1.0
        expected = [mapped, sd, abs(mapped - truth)]
        for row in range(3):
            x, z, values, levels = drawn.filled[axes[row, k]]
            assert (x, z) == (pytest.approx(X), pytest.approx(Z))
            values = plane(values)
            assert np.isfinite(values).all()  # the ground is drawn over it, not left out in steps
            assert values[~below & (X > 0.0)[None, :]] == pytest.approx(expected[row])
            assert (levels[0], levels[-1]) == ((-3.0, 3.0), (0.0, 1.5), (0.0, 1.5))[row]
            (_, _, true_line, zero), (_, _, own_line, own_zero) = drawn.lines[axes[row, k]]
            assert (zero, own_zero) == ([0.0], [0.0])
            assert plane(true_line)[~below] == pytest.approx(truth)
            assert plane(own_line)[~below & (X > 0.0)[None, :]] == pytest.approx(mapped)
            (flown,) = axes[row, k].lines
            count = round(time_s) + 1  # up to that time, and with it
            assert flown.get_xdata() == pytest.approx(4.0 - np.arange(count))
            assert flown.get_ydata() == pytest.approx(1.5 + 0.25 * np.arange(count))
            assert axes[row, k].get_ylim() == (0.0, 3.0)
        assert axes[0, k].get_title() == f"after {time_s:.1f} s"
        assert axes[2, k].get_xlabel() == "x [m], downstream"
        assert axes[0, k].get_xlabel() == ""
    assert [axes[row, 0].get_ylabel() for row in range(3)] == ["z [m]"] * 3
    (legend,) = figure.legends
    words = {line.get_label(): line.get_color() for line in legend.get_lines()}
    assert words == {"path": "magenta", "E = 0, true": "black", "E = 0, as mapped": "black"}
    bars = [bar.get_ylabel() for bar in figure.axes[6:]]
    assert bars == ["excess E [m/s]", "claimed σ of E [m/s]", "error of E [m/s]"]


@pytest.mark.parametrize(
    ("count", "rows", "columns"),
    [(0, 1, 1), (1, 1, 1), (5, 1, 5), (6, 1, 6), (7, 2, 6), (13, 3, 6), (24, 4, 6), (25, 4, 6)],
)
def test_failures_have_six_panels_a_row_and_twenty_four_in_all(
    count: int, rows: int, columns: int, drawn: Drawn
) -> None:
    assert PANELS == 24
    failed = [(episode(seed), "never above the sink") for seed in range(count)]
    failures_figure(Path("b.png"), failed, POLAR)
    ((figure, path),) = drawn.figures
    assert path == Path("b.png")
    assert len(figure.axes) == rows * columns
    assert figure.axes[0].get_gridspec().get_geometry() == (rows, columns)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == min(count, 24)
    titles = [f"tunnel {seed}: the place of seed {seed}" for seed in range(min(count, 24))]
    assert [axes.get_title().splitlines()[0] for axes in shown] == titles


def test_a_failure_is_drawn_in_the_air_at_its_end_with_its_path_and_why(drawn: Drawn) -> None:
    why = "it was given up: " + "no place in the box would carry it " * 3
    failures_figure(Path("b.png"), [(episode(flown_s=4.5), why)], POLAR)
    ((figure, _),) = drawn.figures
    (axes,) = figure.axes
    x, z, values, levels = drawn.filled[axes]
    assert (x[0], x[-1], z[0], z[-1]) == (0.0, 4.0, 0.0, 3.0)
    assert (levels[0], levels[-1], len(levels)) == (-3.0, 3.0, 13)
    values, below = plane(values), z[:, None] <= 0.25 * x[None, :]
    assert np.isfinite(values).all()
    assert values[~below] == pytest.approx(4.5 - 2.0)
    ((_, _, line, zero),) = drawn.lines[axes]
    assert {(0.0, 0.0), (4.0, 1.0)} <= {*ground_of(axes)}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["path", "E = 0, true"]
    assert (zero, plane(line)[-1, 0]) == ([0.0], pytest.approx(2.5))
    path, start = axes.lines
    assert path.get_xdata().tolist() == [4.0, 3.0, 2.0, 1.0, 0.0]
    assert path.get_ydata().tolist() == [1.5, 1.75, 2.0, 2.25, 2.5]
    assert start.get_xydata().tolist() == [[4.0, 1.5]]
    assert axes.get_ylim() == (0.0, 3.0)
    place_words, *lines = axes.get_title().splitlines()
    assert place_words == "tunnel 7: the place of seed 7"
    assert " ".join(lines) == why.strip()
    assert max(map(len, lines)) <= 52 < len(why)


def test_the_ground_has_the_corners_of_its_profile_wherever_the_grid_has_its_nodes(
    drawn: Drawn,
) -> None:
    peak = Ground(3, (0.0, 1.5, 4.0, *[4.0] * 5), (0.0, 0.9, *[0.1] * 6))
    there = episode()
    there = replace(there, place=there.place._replace(ground=peak))
    search_figure(Path("a.png"), there, [snapshot(1.0, 0.5, 0.2)], POLAR, X, Z)
    figure = drawn.figures[0][0]
    assert all((1.5, 0.9) in ground_of(axes) for axes in figure.axes[:3])

"""A smooth map's nodes and cells one by one: which are known, which are asked again and where, and
what lies near the ground."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from tgl_soar.analysis.report import smooth_map as module
from tgl_soar.analysis.report.smooth_map import (
    FINER,
    _is_in,
    beyond_the_edge,
    draw_smooth_map,
    known_fraction,
)

mpl.use("Agg")
import matplotlib.pyplot as plt

X, Z = np.linspace(2.0, 3.0, 11), np.linspace(-1.0, 1.0, 11)  # cells of 0.1 by 0.2
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def fraction_of(known: Any) -> Any:
    return known_fraction(known, X, Z, known(*np.meshgrid(X, Z)))


def test_an_upright_edge_leaves_the_part_of_each_cell_that_it_cuts_off() -> None:
    """At 2.53: the node at 2.5 has a cell from 2.45 to 2.55, known to 0.08 of it, by eighths."""
    found = fraction_of(lambda x, _z: x < 2.53)
    places = 2.45 + (np.arange(FINER) + 0.5) * 0.1 / FINER
    known = np.count_nonzero(places < 2.53) / FINER
    assert 0.5 < known < 1.0
    assert found == pytest.approx(np.tile([1.0] * 5 + [known] + [0.0] * 5, (11, 1)))


def test_a_level_edge_does_so_too() -> None:
    found = fraction_of(lambda _x, z: z > 0.23)  # the node at 0.2 has a cell from 0.1 to 0.3
    places = 0.1 + (np.arange(FINER) + 0.5) * 0.2 / FINER
    known = np.count_nonzero(places > 0.23) / FINER
    column = [0.0] * 6 + [known] + [1.0] * 4
    assert found == pytest.approx(np.tile(np.array(column)[:, None], (1, 11)))


def test_only_nodes_with_a_neighbour_of_another_kind_are_asked_again() -> None:
    """One unknown node: itself and the eight about it, in eight by eight places each, which lie
    within half a cell of it and within the map."""
    nodes = np.ones((11, 11), dtype=bool)
    nodes[3, 4] = False
    asked: list[Any] = []

    def known(x: Any, z: Any) -> Any:
        asked.append((x, z))
        return np.zeros(x.shape, dtype=bool)

    found = known_fraction(known, X, Z, nodes)
    expected = np.ones((11, 11))
    expected[2:5, 3:6] = 0.0
    assert found.tolist() == expected.tolist()
    ((x, z),) = asked
    assert x.shape == z.shape == (9, FINER * FINER)
    about = (np.arange(FINER) - 3.5) / FINER
    assert np.unique(x[0]) == pytest.approx(X[3] + 0.1 * about)
    assert np.unique(z[0]) == pytest.approx(Z[2] + 0.2 * about)
    assert len({*zip(x[0].tolist(), z[0].tolist(), strict=True)}) == FINER * FINER


def test_no_place_beyond_the_map_is_asked_for() -> None:
    asked: list[Any] = []

    def known(x: Any, z: Any) -> Any:
        asked.append((x.min(), x.max(), z.min(), z.max()))
        return x > 0.0

    for row, column in ((0, 0), (10, 10), (0, 10), (10, 0)):
        nodes = np.ones((11, 11), dtype=bool)
        nodes[row, column] = False
        known_fraction(known, X, Z, nodes)
    for x_min, x_max, z_min, z_max in asked:
        assert 2.0 <= x_min < x_max <= 3.0
        assert -1.0 <= z_min < z_max <= 1.0


def test_where_all_or_nothing_is_known_nobody_is_asked() -> None:
    def never(_x: Any, _z: Any) -> Any:
        raise AssertionError

    for value in (0.0, 1.0):
        found = known_fraction(never, X, Z, np.full((11, 11), bool(value)))
        assert found.tolist() == [[value] * 11] * 11


def test_values_that_are_all_known_stay_as_they_are() -> None:
    values = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert beyond_the_edge(values) is values
    values[0, 1] = np.inf
    assert beyond_the_edge(values).tolist() in ([[1.0, 1.0], [3.0, 4.0]], [[1.0, 4.0], [3.0, 4.0]])


def test_a_place_is_in_an_outline_or_not() -> None:
    x, z = np.array([[0.5, 1.5], [0.5, -0.1]]), np.array([[0.5, 0.5], [1.5, 0.5]])
    assert _is_in(SQUARE, x, z).tolist() == [[True, False], [False, False]]
    nothing: list[tuple[float, float]] = []
    for outline in (None, nothing):
        assert _is_in(outline, x, z).tolist() == [[False, False], [False, False]]


def shaded(monkeypatch: pytest.MonkeyPatch, known: Any, ground: Any) -> Any:
    """What of the map counts as shaded."""
    asked: list[Any] = []

    def fraction(is_shaded: Any, *_: Any) -> Any:
        asked.append(is_shaded)
        return np.ones((11, 11))

    monkeypatch.setattr(module, "known_fraction", fraction)
    figure, axes = plt.subplots()
    draw_smooth_map(axes, X, Z, np.meshgrid(X, Z)[1], known, ground)
    plt.close(figure)
    (is_shaded,) = asked
    return lambda x, z: bool(is_shaded(np.array([x]), np.array([z]))[0])


def test_what_lies_within_a_cell_over_the_ground_is_shaded_if_the_air_above_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The ground ends at z = 0; cells are 0.2 high.  Left of 2.5 air is known from 0.25 on, right
    of it from 0.65 on."""
    ground = [(1.0, 0.0), (4.0, 0.0), (4.0, -5.0), (1.0, -5.0)]

    def known(x: Any, z: Any) -> Any:
        return z > np.where(x < 2.5, 0.25, 0.65)

    is_shaded = shaded(monkeypatch, known, ground)
    assert is_shaded(2.2, -0.5)  # in the ground
    assert is_shaded(2.2, 0.3)  # known
    assert is_shaded(2.2, 0.19)  # near, and known two cells above
    assert not is_shaded(2.2, 0.21)  # neither known nor within a cell
    assert not is_shaded(2.8, 0.19)  # near, and not known two cells above
    assert is_shaded(2.8, 0.66)
    alone = shaded(monkeypatch, known, None)
    assert not alone(2.2, -0.5)
    assert not alone(2.2, 0.19)


@pytest.mark.parametrize(("known", "covered"), [(0.49, True), (0.5, False), (1.0, False)])
def test_what_is_less_than_half_known_is_covered(
    monkeypatch: pytest.MonkeyPatch, known: float, covered: bool
) -> None:
    """Up to where the fraction is a half, in the background's colour, over the shading."""
    fraction = np.ones((11, 11))
    fraction[:, 0] = known
    monkeypatch.setattr(module, "known_fraction", lambda *_: fraction)
    figure, axes = plt.subplots()
    values = np.meshgrid(X, Z)[1]
    shades = draw_smooth_map(axes, X, Z, values, lambda x, _z: x > 0.0, background="red")
    assert axes.collections[0] is shades
    assert len(axes.collections) == 1 + covered
    if covered:
        cover: Any = axes.collections[1]
        assert cover.get_facecolor()[0].tolist() == [1.0, 0.0, 0.0, 1.0]
        assert cover.levels.tolist() == [-1.0, 0.5]
        right = max(path.vertices[:, 0].max() for path in cover.get_paths())
        assert right == pytest.approx(2.0 + 0.1 * 0.01 / 0.51)
        assert cover.get_zorder() > shades.get_zorder()
    plt.close(figure)

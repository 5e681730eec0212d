"""Is a wind grid air: the bounds of its speeds, of its mass, and the evening out of its axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tgl_soar.air import grid_checks
from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridError
from tgl_soar.air.grid_checks import check_mass, check_speeds, even_out

FILE = Path("wind.csv")
# Twenty nodes in three dimensions; all of them are air.
SHAPE = (5, 2, 2)
AIR = np.ones(SHAPE, dtype=bool)


def speeds(u: float, v: float, w: float) -> list[FloatArray]:
    return [np.full(SHAPE, part) for part in (u, v, w)]


# --- speeds -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wind", [(74.9, 0.0, 0.0), (60.0, 44.0, 0.0), (0.21, 0.0, 0.0), (0.13, 0.12, 0.11)]
)
def test_speeds_of_a_wind_are_taken(wind: tuple[float, float, float]) -> None:
    check_speeds(FILE, speeds(*wind), AIR)


@pytest.mark.parametrize(
    ("wind", "words"),
    [
        ((75.1, 0.0, 0.0), "the greatest wind speed is 75.1 m/s, above 75: another unit"),
        ((60.0, 46.0, 0.0), "the greatest wind speed is 75.6 m/s, above 75"),
        ((60.0, 0.0, 46.0), "the greatest wind speed is 75.6 m/s, above 75"),
        ((0.19, 0.0, 0.0), "the greatest wind speed is 0.19 m/s, below 0.2: another"),
    ],
)
def test_speeds_that_no_wind_has_are_refused(wind: tuple[float, float, float], words: str) -> None:
    with pytest.raises(GridError, match=f"^wind.csv: {words}.*mps_per_speed"):
        check_speeds(FILE, speeds(*wind), AIR)


def test_the_fastest_place_of_all_decides() -> None:
    wind = speeds(5.0, 0.0, 0.0)
    wind[2][3, 1, 0] = 80.0
    with pytest.raises(GridError, match=r"is 80\.16 m/s"):
        check_speeds(FILE, wind, AIR)
    air = AIR.copy()
    air[3, 1, 0] = False  # what is no air is not judged
    check_speeds(FILE, wind, air)


def test_air_that_goes_up_faster_than_along_is_swapped() -> None:
    check_speeds(FILE, speeds(5.0, 0.0, -4.9), AIR)
    for w in (5.1, -5.1):
        with pytest.raises(GridError, match=r"\(mean 5.1 m/s\) than along \(5 m/s\).*swapped"):
            check_speeds(FILE, speeds(5.0, 0.0, w), AIR)
    # Their means count without their signs.
    wind = speeds(5.0, 0.0, 6.0)
    wind[2][::2] = -6.0
    with pytest.raises(GridError, match=r"\(mean 6 m/s\)"):
        check_speeds(FILE, wind, AIR)


def test_a_wind_from_downstream_is_refused() -> None:
    for u in (-5.0, -0.5):
        with pytest.raises(GridError, match=f"the mean of u is {u:g} m/s, against .x"):
            check_speeds(FILE, speeds(u, 3.0, 0.0), AIR)
    wind = speeds(0.5, 3.0, 0.0)
    check_speeds(FILE, wind, AIR)
    wind[0][0] = -2.0  # on the mean it blows nowhere: (-2 + 4 * 0.5) / 5
    with pytest.raises(GridError, match="the mean of u is 0 m/s"):
        check_speeds(FILE, wind, AIR)


# --- mass -------------------------------------------------------------------------------------


def plane(n: int = 9) -> tuple[list[FloatArray], list[FloatArray]]:
    """A stagnation flow on n times n nodes: u = 9 + x, w = -z has no sources."""
    x, z = 0.5 * np.arange(float(n)), 0.3 * np.arange(float(n))
    xx, zz = np.meshgrid(x, z, indexing="ij")
    return [x, z], [9.0 + xx, -zz]


def block() -> tuple[list[FloatArray], list[FloatArray]]:
    """u = 9 + x, v = 2 y, w = -3 z on a block of 6, 7 and 8 nodes."""
    axes = [0.5 * np.arange(6.0), 0.4 * np.arange(7.0), 0.3 * np.arange(8.0)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    return axes, [9.0 + x, 2.0 * y, -3.0 * z]


def judge(axes: list[FloatArray], wind: list[FloatArray]) -> None:
    check_mass(FILE, axes, wind, np.ones(wind[0].shape, dtype=bool))


def test_air_without_sources_is_taken() -> None:
    judge(*plane())
    judge(*block())


def test_a_turned_axis_is_found() -> None:
    axes, (u, w) = plane()
    with pytest.raises(GridError, match=r"median .div. 2 1/s.*x turned round \(set x_sign or u"):
        judge(axes, [u, -w])
    axes, (u, v, w) = block()
    with pytest.raises(GridError, match=r"but would be with y turned round \(set y_sign or v"):
        judge(axes, [u, -v, w])
    # Of u against v and w all axes but x are right.
    with pytest.raises(GridError, match=r"but would be with x turned round \(set x_sign"):
        judge(axes, [18.0 - u, v, w])
    _, straight = block()
    straight[2] = -straight[0] + 9.0  # nothing turned round would mend it
    judge(axes, [straight[0], straight[0], straight[2]])


def test_swapped_nodes_are_found_where_the_grid_is_square() -> None:
    axes, (u, w) = plane()
    with pytest.raises(GridError, match="with the axes x and z of the nodes swapped"):
        judge([axes[0], axes[0]], [(9.0 + 3.0 * u * w).T, (w * w * -1.5).T])


def test_swapped_nodes_of_a_block_are_found_too() -> None:
    """Of u = 9 + x + z, w = x - z with the first and the last axis of the nodes exchanged."""
    axes = [np.arange(6.0), np.arange(5.0), np.arange(6.0)]
    x, _, z = np.meshgrid(*axes, indexing="ij")
    judge(axes, [9.0 + x + z, 0.0 * x, x - z])
    with pytest.raises(GridError, match=r"median .div. 2 1/s.*axes x and z of the nodes swapped"):
        judge(axes, [9.0 + z + x, 0.0 * x, z - x])
    # A block of another length in x has its nodes as they are, and no such way out.
    axes = [np.arange(7.0), np.arange(5.0), np.arange(6.0)]
    x, _, z = np.meshgrid(*axes, indexing="ij")
    with pytest.raises(GridError, match=r"with x turned round \(set x_sign or u_sign\); where"):
        judge(axes, [9.0 + z + x, 0.0 * x, z - x])


def test_few_nodes_are_not_judged() -> None:
    axes, (u, w) = plane(4)
    judge(axes, [u, -w])
    axes, (u, w) = plane(5)
    with pytest.raises(GridError, match="mass is not conserved"):
        judge(axes, [u, -w])


def test_less_sources_than_half_of_what_changes_along_are_taken() -> None:
    """Of u = 9 + x, w = -k z the sources are 1 - k; along x alone they are 1."""
    axes, (u, w) = plane()
    axes[1], u, w = axes[1][:7], u[:, :7], w[:, :7]  # not square: its axes cannot be swapped
    for k in (0.55, 1.45):
        judge(axes, [u, k * w])
    # Sources of 1.3, and of 0.7 with an axis turned round, which is more than half of it.
    judge(axes, [u, -0.3 * w])
    with pytest.raises(GridError, match=r"median .div. 1.4 1/s"):
        judge(axes, [u, -0.4 * w])  # 1.4, and 0.6 turned round


def test_an_axis_of_a_block_is_turned_where_less_than_half_of_its_sources_would_be_left() -> None:
    axes, (u, v, w) = block()
    # 1 + 0.2 is left at 0.8 with either turned round: more than half.
    judge(axes, [u, 0.1 * v, 0.0 * w])
    # 1 + 0.75 + 0.25 is 2, and 0.5 with y turned round; nothing with x turned round.
    with pytest.raises(GridError, match=r"x turned round \(.*\) or with y turned round \(set y_"):
        judge(axes, [u, 0.375 * v, -0.25 / 3.0 * w])


def test_of_a_block_with_few_sources_an_axis_that_would_leave_fewer_is_not_turned() -> None:
    """1 + 0.15 - 0.75 is 0.4 of what changes along x; with y turned round it is 0.1."""
    axes, (u, v, w) = block()
    judge(axes, [u, 0.075 * v, 0.25 * w])


def test_what_is_as_bad_turned_round_is_taken() -> None:
    """Many sources that nothing mends: u = 9 + x and no w."""
    axes, (u, w) = plane()
    judge([axes[0], axes[1][:7]], [u[:, :7], 0.0 * w[:, :7]])


@pytest.mark.parametrize("solid", [1, 2, 3, 4])
def test_only_nodes_with_air_all_round_are_judged(solid: int) -> None:
    """Of six rows one is solid; the values inside it are no wind."""
    axes, (u, w) = plane()
    axes, u, w = [axes[0][:6], axes[1][:7]], u[:6, :7].copy(), w[:6, :7]
    air = np.ones(u.shape, dtype=bool)
    air[solid] = False
    u[solid] = 1e6
    check_mass(FILE, axes, [u, w], air)
    with pytest.raises(GridError, match=r"median .div. 2 1/s"):
        check_mass(FILE, axes, [u, -w], air)
    # Where no place has air all round nothing is judged.
    air[::2] = False
    check_mass(FILE, axes, [u, -w], air)


def test_edges_are_not_judged() -> None:
    """A wind that goes up and down from node to node shows in one-sided differences alone,
    which the edges have: 18 of these 30 nodes."""
    axes = [np.arange(5.0), np.arange(6.0)]
    i, k = np.meshgrid(*axes, indexing="ij")
    u, w = 9.0 + i + 3.0 * (-1.0) ** i, k + 3.0 * (-1.0) ** k
    judge(axes, [u, -k + 3.0 * (-1.0) ** k])
    with pytest.raises(GridError, match=r"median .div. 2 1/s.*x turned round"):
        judge(axes, [u, w])
    # Where one row or column beside an edge is all that is left, it is judged alone.
    for axis, solid in ((0, 1), (0, 3), (1, 2), (1, 3)):
        air = np.ones(u.shape, dtype=bool)
        air[(solid, slice(None)) if axis == 0 else (slice(None), solid)] = False
        with pytest.raises(GridError, match=r"median .div. 2 1/s.*x turned round"):
            check_mass(FILE, axes, [u, w], air)


# --- evening out ------------------------------------------------------------------------------


def evened(
    axis: list[float], values: list[float], solid: list[bool] | None = None
) -> tuple[list[float], FloatArray, list[bool]]:
    """Along x, with two even places of z."""
    nodes = np.array(values)[:, None] * np.array([1.0, 2.0])
    is_solid = np.array(solid or [False] * len(axis))[:, None] & np.array([True, True])
    axes, (u,), marked = even_out(
        FILE, ["x", "z"], [np.array(axis), np.array([0.0, 1.0])], [nodes], is_solid
    )
    assert axes[1].tolist() == [0.0, 1.0]
    assert u[:, 1] == pytest.approx(2.0 * u[:, 0])
    return axes[0].tolist(), u[:, 0], marked[:, 0].tolist()


def test_an_uneven_axis_gets_its_least_spacing_and_straight_lines() -> None:
    axis, u, _ = evened([0.0, 1.0, 4.0, 6.0], [5.0, 7.0, 1.0, 9.0])
    assert axis == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert u == pytest.approx([5.0, 7.0, 5.0, 3.0, 1.0, 5.0, 9.0])


def test_an_uneven_axis_may_begin_anywhere_and_have_any_spacing() -> None:
    axis, u, _ = evened([10.0, 10.5, 12.0, 13.0], [4.0, 1.0, 7.0, 5.0])
    assert axis == pytest.approx([10.0, 10.5, 11.0, 11.5, 12.0, 12.5, 13.0])
    assert u == pytest.approx([4.0, 1.0, 3.0, 5.0, 7.0, 6.0, 5.0])
    even, _, _ = evened([20.0, 21.0, 22.0, 23.0], [0.0] * 4)
    assert even == [20.0, 21.0, 22.0, 23.0]


def test_an_axis_that_is_even_to_a_thousandth_stays_as_it_is() -> None:
    for off, count in ((0.9e-3, 4), (1.5e-3, 4)):
        axis, u, _ = evened([0.0, 1.0 + off, 2.0, 3.0], [0.0, 1.0, 2.0, 3.0])
        assert len(axis) == count
        even = off > 1e-3
        assert axis[1] == pytest.approx(1.0 if even else 1.0 + off, abs=1e-9)
        assert u[1] == pytest.approx(1.0 / (1.0 + off) if even else 1.0, abs=1e-9)


@pytest.mark.parametrize("step", [0.1, 10.0])
def test_what_is_even_is_so_by_its_own_step(step: float) -> None:
    for off, stays in ((0.9e-3, True), (1.5e-3, False)):
        given = [0.0, step * (1.0 + off), 2.0 * step, 3.0 * step]
        axis, _, _ = evened(given, [0.0] * 4)
        assert (axis == given) is stays


def test_between_air_and_solid_is_solid() -> None:
    _, _, marked = evened([0.0, 1.0, 4.0, 6.0], [0.0] * 4, [True, False, False, True])
    assert marked == [True, False, False, False, False, True, True]
    _, _, marked = evened([0.0, 1.0, 4.0, 6.0], [0.0] * 4, [False, False, True, False])
    assert marked == [False, False, True, True, True, True, False]


def test_what_was_given_is_not_changed() -> None:
    given = [np.array([0.0, 1.0, 3.0]), np.array([0.0, 1.0])]
    even_out(FILE, ["x", "z"], given, [np.zeros((3, 2))], np.zeros((3, 2), dtype=bool))
    assert given[0].tolist() == [0.0, 1.0, 3.0]


def test_too_many_even_places_are_refused_with_their_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert grid_checks.MOST_NODES == 20_000_000
    monkeypatch.setattr(grid_checks, "MOST_NODES", 14)
    evened([0.0, 1.0, 4.0, 6.0], [0.0] * 4)  # seven places, fourteen nodes
    monkeypatch.setattr(grid_checks, "MOST_NODES", 13)
    with pytest.raises(
        GridError,
        match=r"axis x is uneven \(spacing 1 … 3 m\) and would take 7 even places, 14 nodes.*is 13",
    ):
        evened([0.0, 1.0, 4.0, 6.0], [0.0] * 4)

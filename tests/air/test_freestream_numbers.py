"""The exact jet: how far its net reaches, how finely, and the message where there is none."""

from __future__ import annotations

from functools import cache
from math import cos, log, pi, radians

import numpy as np
import pytest

from tgl_soar.air.freestream import (
    FreeJet,
    FreeJetMap,
    advance,
    slowness,
    solve_free_jet,
)

HEIGHT, BOARD, AHEAD = 2.85, 2.45, 0.5
SLOPE = radians(23.0)
UPSTREAM, DOWNSTREAM = 6.0, 8.0
# Without a board the jet runs straight on, everywhere at the speed of its edge.
STRAIGHT = FreeJet(
    slope_rad=0.0,
    nozzle_height_m=2.0,
    board_length_m=1.0,
    lip_ahead_m=0.5,
    log_wake_speed=0.0,
    lip=0.4,
    tip=9.0,
    nozzle_speed=1.0,
)


@cache
def solved(ratio: float = 1.0) -> FreeJet:
    return solve_free_jet(SLOPE, HEIGHT, BOARD, AHEAD, ratio)


@pytest.fixture(scope="module", params=[1.0, 1.3], ids=lambda k: f"k{k:g}")
def net(request: pytest.FixtureRequest) -> FreeJetMap:
    return FreeJetMap(solved(request.param), UPSTREAM, DOWNSTREAM)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_jet_of_another_size_is_the_same_jet(scale: float) -> None:
    jet = solve_free_jet(SLOPE, HEIGHT, BOARD, AHEAD)  # vented by default
    assert jet == solved()
    other = solve_free_jet(SLOPE, scale * HEIGHT, scale * BOARD, scale * AHEAD)
    assert (other.lip, other.tip, other.nozzle_speed) == pytest.approx(
        (jet.lip, jet.tip, jet.nozzle_speed), rel=1e-8
    )
    assert other.flow_m2ps == pytest.approx(scale * jet.flow_m2ps)
    assert jet.flow_m2ps == pytest.approx(HEIGHT * jet.nozzle_speed)


def test_what_was_asked_for_is_kept() -> None:
    jet = solved(1.3)
    assert jet[:4] == (SLOPE, HEIGHT, BOARD, AHEAD)
    assert jet.log_wake_speed == pytest.approx(log(1.3))
    assert solved().log_wake_speed == 0.0  # vented


def test_where_there_is_no_such_flow_its_numbers_are_named() -> None:
    with pytest.raises(
        ValueError, match=r"no free-streamline flow for slope 0\.4014 rad"
    ) as caught:
        solve_free_jet(SLOPE, HEIGHT, 1e-9, AHEAD, 1.3)
    words = str(caught.value)
    assert "nozzle 2.85 m" in words
    assert "board 1e-09 m" in words
    assert "lip 0.5 m ahead" in words
    assert "ratio 1.3" in words


# --- velocities and ways -------------------------------------------------------------------------


def test_without_a_board_every_step_is_a_step_along_the_floor() -> None:
    chi = np.array([-2.0 + 0.5j, 0.0 + 1.0j, 3.0 + 3.0j])
    assert slowness(STRAIGHT, chi) == pytest.approx(1.0)
    way = advance(STRAIGHT, chi, chi + (0.75 - 0.25j))
    assert way == pytest.approx((0.75 - 0.25j) * 2.0 / pi)


def test_a_way_and_the_way_back_are_nothing() -> None:
    jet = solved()
    start, end = np.array([0.2 + 0.7j]), np.array([0.9 + 1.4j])
    assert advance(jet, start, end) == pytest.approx(-advance(jet, end, start))
    middle = np.array([0.55 + 1.05j])
    halves = advance(jet, start, middle) + advance(jet, middle, end)
    assert advance(jet, start, end) == pytest.approx(halves, abs=1e-10)


def test_a_short_way_is_slowness_times_the_step_of_the_potential() -> None:
    jet = solved()
    chi, step = np.array([0.4 + 1.0j]), 1e-4 + 2e-4j
    expected = slowness(jet, chi + 0.5 * step) * step * jet.flow_m2ps / pi
    assert advance(jet, chi, chi + step) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("ratio", [1.0, 1.3])
def test_speeds_are_the_nozzles_far_up_and_follow_the_board_along_it(ratio: float) -> None:
    jet = solved(ratio)
    far = 1.0 / slowness(jet, np.array([-12.0 + 1.0j]))[0]
    assert far == pytest.approx(jet.nozzle_speed, abs=1e-4)
    on_board = np.array([fraction * log(jet.tip) + 1e-9j for fraction in (0.3, 0.6, 0.9)])
    directions = np.angle(slowness(jet, on_board))
    assert directions == pytest.approx(SLOPE, abs=1e-6)
    on_floor = np.array([-3.0 + 1e-9j, -0.5 + 1e-9j])
    assert np.angle(slowness(jet, on_floor)) == pytest.approx(0.0, abs=1e-6)


# --- the net -------------------------------------------------------------------------------------


def test_the_net_reaches_as_far_as_it_is_asked_to(net: FreeJetMap) -> None:
    """Upstream to within the blockage's fraction, downstream past it and not beyond a half more."""
    x = net.place.real
    assert x[0] == pytest.approx(-UPSTREAM, rel=0.15)
    assert x[-1].min() > DOWNSTREAM * cos(SLOPE)
    assert x[-1].max() < 1.6 * DOWNSTREAM


def test_lines_are_dense_at_the_walls_and_the_outermost_leave_a_hundred_thousandth(
    net: FreeJetMap,
) -> None:
    fraction = net.chi[0].imag / pi  # of the flow, below the line
    assert (fraction[0], 1.0 - fraction[-1]) == pytest.approx((1e-5, 1e-5))
    assert (np.diff(fraction) > 0.0).all()
    assert fraction + fraction[::-1] == pytest.approx(1.0)
    # As seen from above on a half circle: lines a fixed angle apart.
    angles = np.arccos(1.0 - 2.0 * fraction[1:-1])
    assert np.diff(angles) == pytest.approx(pi / (len(fraction) - 1), rel=1e-6)
    steps = np.diff(net.chi[:, 0].real)
    assert steps == pytest.approx(steps[0])
    # Half a hundredth of the flow in each direction, so that Newton starts nearly right.
    assert max(steps[0], np.diff(net.chi[0].imag).max()) < 0.03 * pi


def test_the_foot_is_where_the_straight_parts_of_the_lowest_line_meet(net: FreeJetMap) -> None:
    lowest, along = net.place[:, 0], net.chi[:, 0].real
    on_board = lowest[(along > 0.2) & (along < log(net.jet.tip) - 0.2)]
    slope, height = np.polyfit(on_board.real, on_board.imag, 1)
    assert slope == pytest.approx(np.tan(SLOPE), abs=2e-3)
    assert height == pytest.approx(0.0, abs=1e-3)
    assert lowest[0].imag == pytest.approx(0.0, abs=1e-12)


def test_neighbours_in_the_net_are_a_way_apart(net: FreeJetMap) -> None:
    inner = (slice(100, 400), slice(10, 50))
    chi, place = net.chi[inner], net.place[inner]
    assert place[1:] - place[:-1] == pytest.approx(advance(net.jet, chi[:-1], chi[1:]), abs=1e-7)
    across = advance(net.jet, chi[:, :-1], chi[:, 1:])
    assert place[:, 1:] - place[:, :-1] == pytest.approx(across, abs=1e-7)


def test_every_place_of_the_net_is_found_back(net: FreeJetMap) -> None:
    chi = net.chi[5:-5:37, 3:-3:9] + (0.4 * 0.02 + 0.3j * 0.02)
    place = net.place_at(chi)
    assert net.locate(place.real, place.imag) == pytest.approx(chi, abs=1e-7)
    nodes = net.place[50:-50:80, 5:-5:11]
    assert net.place_at(net.chi[50:-50:80, 5:-5:11]) == pytest.approx(nodes, abs=1e-12)


def test_the_corners_of_the_net_are_places_too(net: FreeJetMap) -> None:
    corners = np.ix_([0, -1], [0, -1])
    assert net.place_at(net.chi[corners]) == pytest.approx(net.place[corners], abs=1e-9)
    beyond = net.chi[-1, 30] + 0.01
    assert net.place_at(np.array([beyond]))[0] == pytest.approx(
        net.place[-1, 30] + advance(net.jet, net.chi[-1:, 30], np.array([beyond]))[0]
    )


def test_beside_the_jet_its_nearest_edge_answers(net: FreeJetMap) -> None:
    x = np.array([1.0, -2.0, 1.0])
    z = np.array([9.0, 9.0, -4.0])
    found = net.locate(x, z)
    assert found.imag == pytest.approx([pi, pi, 0.0], abs=1e-4)
    for chi, target in zip(found, x + 1j * z, strict=True):
        edge = net.place[:, -1] if chi.imag > 1.0 else net.place[:, 0]
        least = np.abs(edge - target).min()
        assert abs(net.place_at(np.array([chi]))[0] - target) == pytest.approx(least)


def test_any_shape_of_places_is_answered_in_its_own(net: FreeJetMap) -> None:
    x, z = np.full((2, 3), 0.5), np.array([[0.5, 0.8, 1.0], [1.5, 2.0, 2.4]])
    found = net.locate(x, z)
    assert found.shape == (2, 3)
    assert net.place_at(found) == pytest.approx(x + 1j * z, abs=1e-7)


def test_in_a_straight_jet_the_net_is_a_grid_of_rectangles() -> None:
    """Two metres high, at the speed 1: the potential is the way, and its fraction the height."""
    almost = STRAIGHT._replace(slope_rad=1e-9)
    net = FreeJetMap(almost, 3.0, 5.0)
    x, z = net.place.real, net.place.imag
    assert np.ptp(x[0]) == pytest.approx(0.0, abs=1e-6)
    assert z[7] == pytest.approx(2.0 * net.chi[7].imag / pi, abs=1e-4)
    assert x[-1, 0] - x[0, 0] == pytest.approx(3.0 + 1.2 * 5.0)  # a fifth more downstream
    drawn = FreeJetMap(almost._replace(log_wake_speed=0.0, nozzle_speed=0.5), 3.0, 5.0)
    reach = drawn.chi[[0, -1], 0].real * drawn.jet.flow_m2ps / pi
    assert reach == pytest.approx([-1.5, 6.0])  # φ: the nozzle's slower way, and the free one


@pytest.mark.parametrize(("ratio", "faster"), [(1.5, 1.5), (0.8, 1.0)])
def test_a_faster_lower_edge_takes_more_of_the_potential_as_far_down(
    ratio: float, faster: float
) -> None:
    """φ grows by the speed of the faster edge for each metre, and nowhere by less than 1."""
    jet = STRAIGHT._replace(slope_rad=1e-9, log_wake_speed=log(ratio))
    net = FreeJetMap(jet, 3.0, 5.0)
    reach = net.chi[[0, -1], 0].real * jet.flow_m2ps / pi
    assert reach == pytest.approx([-3.0, 1.2 * 5.0 * faster])


@pytest.mark.parametrize("ratio", [1.0, 1.3])
def test_at_the_lip_the_edge_leaves_the_roof_without_a_bend(ratio: float) -> None:
    jet = solved(ratio)
    past = np.array([log(jet.lip) + 1e-6 + (pi - 1e-9) * 1j])
    assert np.angle(slowness(jet, past))[0] == pytest.approx(0.0, abs=2e-3)
    behind = np.array([log(jet.tip) + 1e-6 + 1e-9j])  # the lower edge goes on along the board
    assert np.angle(slowness(jet, behind))[0] == pytest.approx(SLOPE, abs=3e-3)

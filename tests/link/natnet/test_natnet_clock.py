"""The motion-capture server's clock: what one wrong stamp does, and for how long."""

from __future__ import annotations

import pytest

from tgl_soar.link.clock import AHEAD_S, WINDOW_S
from tgl_soar.link.natnet.clock import DRIFT, ServerClock

DELAY_S = 0.001  # on the way, either way
BEGAN_S = 3600.0  # the server's clock, when ours began


class Server:
    """Frames at 100 Hz and, where it answers, an echo a second."""

    def __init__(self, *, echoes: bool) -> None:
        self.clock = ServerClock()
        self.now_s = 100.0
        self.refused = 0
        self._echoes = echoes

    @property
    def error_s(self) -> float:
        return self.clock.offset_s + BEGAN_S

    def stamped(self, ahead_s: float = 0.0) -> bool:
        return self.clock.stamped(self.now_s - DELAY_S + BEGAN_S + ahead_s, self.now_s)

    def run(self, for_s: float, ahead_s: float = 0.0) -> None:
        for i in range(round(for_s * 100)):
            self.now_s += 0.01
            self.refused += not self.stamped(ahead_s)
            if self._echoes and i % 100 == 50:
                stamp_s = self.now_s - DELAY_S + BEGAN_S + ahead_s
                self.refused += not self.clock.echoed(stamp_s, self.now_s - 2 * DELAY_S, self.now_s)


@pytest.mark.parametrize("echoes", [False, True])
@pytest.mark.parametrize("ahead_s", [0.25, 0.6, 0.99, 400.0])
def test_one_stamp_ahead_says_nothing(ahead_s: float, echoes: bool) -> None:
    server = Server(echoes=echoes)
    server.run(2.0)
    assert not server.stamped(ahead_s)
    server.run(1.0)
    assert abs(server.error_s) <= DELAY_S + 1e-6
    assert server.refused == server.clock.restarts == 0


@pytest.mark.parametrize("echoes", [False, True])
@pytest.mark.parametrize("ahead_s", [0.25, 0.6, 0.99, 400.0])
def test_not_even_as_the_first_for_longer_than_the_window(ahead_s: float, echoes: bool) -> None:
    server = Server(echoes=echoes)
    server.stamped(ahead_s)
    server.run(WINDOW_S + 2.0)
    assert abs(server.error_s) <= DELAY_S + 1e-6
    server.refused = 0
    server.run(5.0)
    assert server.refused == 0


def test_without_echoes_a_stamp_that_is_little_ahead_is_forgotten_with_the_window() -> None:
    server = Server(echoes=False)
    server.run(2.0)
    assert server.stamped(0.9 * AHEAD_S)
    assert server.error_s == pytest.approx(DELAY_S - 0.9 * AHEAD_S)
    server.run(WINDOW_S + 0.1)
    assert server.error_s == pytest.approx(DELAY_S)


@pytest.mark.parametrize("jump_s", [-30.0, -2.0, 0.5, 30.0])
def test_a_clock_that_jumps_is_another_one_and_so_is_the_one_it_jumps_back_to(
    jump_s: float,
) -> None:
    server = Server(echoes=True)
    server.run(3.0)
    server.run(3.0, jump_s)
    assert server.error_s == pytest.approx(-jump_s, abs=2 * DELAY_S)
    # Back by less than a second looks like a network that is slow, until the window is over.
    server.run(WINDOW_S + 2.0)
    assert abs(server.error_s) <= 2 * DELAY_S
    assert server.clock.restarts >= 1
    server.refused = 0
    server.run(10.0)
    assert server.refused == 0


@pytest.mark.parametrize("ppm", [-100.0, 100.0])
def test_quartzes_that_run_apart_are_followed(ppm: float) -> None:
    server = Server(echoes=True)
    ahead_s = 0.0
    for _ in range(120):
        server.run(1.0, ahead_s)
        assert abs(server.error_s + ahead_s) <= 2 * DELAY_S
        ahead_s += ppm * 1e-6
    assert server.refused == server.clock.restarts == 0


def test_without_echoes_the_bounds_go_apart_as_two_quartzes_may() -> None:
    """An echo bounds the offset to both sides; what it says is worth less by DRIFT a second."""
    server = Server(echoes=True)
    server.run(3.0)
    known_s = server.clock.uncertainty_s
    assert known_s <= DELAY_S + DRIFT  # the last echo is half a second old
    server._echoes = False
    server.run(20.0)
    grown_s = server.clock.uncertainty_s - known_s
    # Half of it, as it is half of the bounds' distance.
    assert grown_s == pytest.approx(0.5 * DRIFT * 20.0, rel=0.01)


@pytest.mark.parametrize("echoes", [False, True])
def test_frames_that_were_held_up_and_come_at_once_are_no_other_clock(echoes: bool) -> None:
    """Three frames of a hundredth of a second, late by more than a second, within a millisecond:
    their stamps fit each other and nothing else.  A clock that is another one goes on."""
    server = Server(echoes=echoes)
    server.run(3.0)
    stamp_s = server.now_s - 1.5 + BEGAN_S
    for i in range(4):
        assert not server.clock.stamped(stamp_s + 0.005 * i, server.now_s + 2e-4 * i)
    assert server.clock.restarts == 0
    assert abs(server.error_s) <= DELAY_S + 1e-6
    server.run(1.0)
    assert server.refused == 0

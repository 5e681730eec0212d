"""Which process has priority over which, and what ends the process: in the system's numbers."""

from __future__ import annotations

import gc
import os
import signal
from typing import Any

import pytest

from tgl_soar.onboard import realtime, watchdog
from tgl_soar.onboard.realtime import PRIORITY


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """(policy, priority) of every request."""
    requests: list[tuple[int, int]] = []

    def set_scheduler(_pid: int, policy: int, parameters: Any) -> None:
        requests.append((policy, parameters.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", set_scheduler)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr(gc, "disable", lambda: None)
    return requests


def test_the_watchdog_runs_before_the_loop_and_a_simulated_world_after_it(
    asked: list[tuple[int, int]],
) -> None:
    realtime.raise_priority()
    assert realtime.accompany()
    assert asked == [(os.SCHED_FIFO, PRIORITY + 1), (os.SCHED_FIFO, PRIORITY - 1)]
    # Interrupts' threads run at 50, and the page says what the service must be allowed.
    assert PRIORITY - 1 > 50
    assert PRIORITY + 1 == 61


def test_without_the_right_to_it_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    assert not realtime.accompany()


def test_every_signal_that_ends_a_program_in_order_is_one() -> None:
    """Of a service manager, of Ctrl-C and Ctrl-\\, and of a terminal that is closed."""
    ends = {signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGHUP}
    assert set(watchdog.ENDS) == ends


def test_a_hanging_loop_is_ended_before_the_surfaces_are_lost_for_long() -> None:
    """In flight within the half second of a firmware's own time-out, on the ground not while a
    slow computer starts; a look takes no tenth of it."""
    assert 0.2 <= watchdog.HANGS_FLYING_S <= 0.5
    assert 5.0 <= watchdog.HANGS_S <= 15.0
    assert watchdog.LOOK_S <= 0.1 * watchdog.HANGS_FLYING_S
    assert watchdog.PATIENCE_S < watchdog.ENDING_S < 10.0  # a service manager waits for ten
    assert watchdog.RESTARTS * watchdog.RESTART_DELAY_S < watchdog.RESTARTS_S
    assert watchdog.RESTART_DELAY_S < watchdog.HANGS_FLYING_S

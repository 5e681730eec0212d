"""When there is a tick: by this computer's clock, or by a simulated vehicle's stamps."""

from __future__ import annotations

from math import inf

import pytest

from tgl_soar.link.messages import Timesync
from tgl_soar.onboard.clocking import NO_TICK, RESTART, TICK, Clocking

RATE_HZ = 200.0
PERIOD_S = 1.0 / RATE_HZ
BEGAN_S = 50.0
SENT_S = 0.0004  # of a step of the vehicle, from its attitude to its TIMESYNC


def clocking(*, lockstep: bool = False) -> Clocking:
    return Clocking(RATE_HZ, BEGAN_S, lockstep=lockstep)


def asked(stamp_s: float) -> Timesync:
    """A question, whose answer tells the simulator that the step is done."""
    return Timesync(tc1=0, ts1=round(stamp_s * 1e9))


class Stepped:
    """A vehicle in lockstep whose attitudes have come to a time."""

    def __init__(self, steps: int = 3) -> None:
        self.clocking = clocking(lockstep=True)
        self.stamp_s = 10.0
        for _ in range(steps):
            self.step()

    def step(self, *, attitude: bool = True, reboots: int = 0) -> bool:
        """One; whether its TIMESYNC makes up for a tick."""
        self.stamp_s += PERIOD_S
        if attitude:
            self.clocking.attitude(self.stamp_s, reboots)
        return self.clocking.timesync(asked(self.stamp_s + SENT_S), RATE_HZ)


# --- by this computer's clock ---------------------------------------------------------------------


def test_a_free_loop_ticks_a_period_after_its_beginning_and_not_before() -> None:
    free = clocking()
    almost_s, then_s = BEGAN_S + 0.9 * PERIOD_S, BEGAN_S + 1.1 * PERIOD_S
    assert (free.due(almost_s), free.overdue(almost_s)) == (False, False)
    assert (free.due(then_s), free.overdue(then_s)) == (True, True)
    assert free.wake_s(almost_s) == pytest.approx(BEGAN_S + PERIOD_S)
    assert free.now_s(almost_s) == almost_s


def locked() -> Clocking:
    """A loop that follows the attitudes of an autopilot."""
    loop = clocking()
    for k in range(1, 60):
        now_s = BEGAN_S + k * PERIOD_S
        loop.pacer.sample(now_s, now_s, now_s)
        loop.pacer.tick(now_s)
    assert loop.pacer.locked
    return loop


def test_a_sample_makes_a_tick_due_that_could_wait_yet() -> None:
    loop = locked()
    now_s = BEGAN_S + 60 * PERIOD_S - 0.0001
    assert not loop.due(now_s)
    loop.pacer.sample(now_s, now_s, now_s)
    assert loop.due(now_s)
    assert not loop.overdue(now_s)  # what has come with it may be read first


def test_a_locked_loop_that_is_on_time_warms_up() -> None:
    loop = locked()
    assert BEGAN_S + 59 * PERIOD_S < loop.warm_up_s < BEGAN_S + 60 * PERIOD_S
    loop.load_shedding.value = 1.0
    assert loop.warm_up_s == inf  # there is no time for it


# --- in lockstep ----------------------------------------------------------------------------------


def test_in_lockstep_no_clock_of_ours_makes_a_tick_or_warms_up() -> None:
    stepped = locked()
    stepped.lockstep = True
    late_s = BEGAN_S + 100.0
    assert not stepped.due(late_s)
    assert not stepped.overdue(late_s)
    assert stepped.warm_up_s == inf


def test_in_lockstep_the_process_looks_around_a_few_times_a_second() -> None:
    """For whether it is to stop, and for other senders."""
    wake_s = clocking(lockstep=True).wake_s(BEGAN_S)
    assert 0.01 < wake_s - BEGAN_S < 0.1
    assert wake_s - BEGAN_S == pytest.approx(0.05)


def test_time_is_ours_until_the_vehicle_has_come_and_the_vehicles_from_then_on() -> None:
    stepped = clocking(lockstep=True)
    assert not stepped.by_vehicle
    assert stepped.now_s(BEGAN_S) == BEGAN_S
    assert stepped.attitude(3.0, 0) == RESTART
    assert stepped.by_vehicle
    assert stepped.now_s(BEGAN_S) == 3.0


def test_each_new_attitude_is_a_tick_at_its_own_stamp() -> None:
    stepped = Stepped().clocking
    at_s = stepped.stepped_s
    for stamp_s, kind in (
        (at_s + PERIOD_S, TICK),
        (at_s + PERIOD_S, NO_TICK),  # twice
        (at_s, NO_TICK),  # late
        (at_s + 2 * PERIOD_S, TICK),
    ):
        assert stepped.attitude(stamp_s, 0) == kind
    assert stepped.stepped_s == at_s + 2 * PERIOD_S
    assert len({TICK, NO_TICK, RESTART}) == 3


def test_a_vehicle_that_has_begun_again_takes_its_time_with_it() -> None:
    stepped = Stepped().clocking
    assert stepped.attitude(0.5, 1) == RESTART
    assert stepped.stepped_s == 0.5
    assert stepped.attitude(0.5 + PERIOD_S, 1) == TICK
    assert stepped.attitude(0.5, 1) == NO_TICK


def test_a_step_with_an_attitude_needs_no_other_tick() -> None:
    stepped = Stepped()
    for _ in range(5):
        assert not stepped.step()


def test_a_tick_whose_attitude_is_missing_is_made_up_for_at_its_time() -> None:
    """Not in its own step, in which it may come yet, but in the next one; at that one's time."""
    stepped = Stepped()
    began_s = stepped.clocking.stepped_s
    made = [stepped.step(attitude=False) for _ in range(4)]
    assert made == [False, True, False, True]
    assert stepped.clocking.stepped_s == pytest.approx(began_s + 4 * PERIOD_S, abs=1e-8)
    assert not stepped.step()  # attitudes are back
    assert stepped.clocking.stepped_s == pytest.approx(began_s + 5 * PERIOD_S)


@pytest.mark.parametrize(("periods", "is_missing"), [(1.4, False), (1.6, True), (3.1, True)])
def test_so_long_an_attitude_may_be_late(periods: float, is_missing: bool) -> None:
    stepped = Stepped()
    at_s = stepped.clocking.stepped_s + periods * PERIOD_S
    assert stepped.clocking.timesync(asked(at_s + SENT_S), RATE_HZ) is is_missing


def test_an_answer_of_the_vehicle_ends_no_step() -> None:
    stepped = Stepped()
    late_s = stepped.stamp_s + 1.0
    answer = Timesync(tc1=1, ts1=round(late_s * 1e9))
    assert not stepped.clocking.timesync(answer, RATE_HZ)
    assert stepped.clocking.timesync(asked(late_s), RATE_HZ)


def test_before_an_attitude_was_followed_by_a_timesync_nothing_is_made_up_for() -> None:
    """How far their stamps are apart is not known."""
    stepped = clocking(lockstep=True)
    assert not stepped.timesync(asked(100.0), RATE_HZ)
    assert not stepped.timesync(asked(200.0), RATE_HZ)
    assert not stepped.by_vehicle

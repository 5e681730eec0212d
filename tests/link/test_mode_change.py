"""Into the mode that obeys and out of it, and that the pilot's choice ends it."""

from itertools import pairwise

import pytest

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.autopilots.base import Flavour, SurfaceChannel, SurfaceChannels
from tgl_soar.link.messages import CommandLong
from tgl_soar.link.mode_change import ANSWER_S, PATIENCE_S, TRIES, ModeChange

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
GUIDED, FBWA, LOITER = 15, 5, 12
OFFBOARD, STABILIZED = 6 << 16, 7 << 16


def target(firmware: str, route: str | None = None) -> Flavour:
    return flavour(firmware, route, CHANNELS, 1)


def asked_mode(requests: tuple[object, ...]) -> float | None:
    if not requests:
        return None
    (request,) = requests
    assert isinstance(request, CommandLong)
    assert request.command == 176
    return request.params[1]


class Beats:
    """A mode change, and the heartbeats that it looks at; polled at 100 Hz."""

    def __init__(self, change: ModeChange, *, mode: int, obeying: int, every_s: float) -> None:
        self.change = change
        self.mode, self.obeying, self.every_s = mode, obeying, every_s
        self.now_s = self.received_s = 10.0
        self.shown = mode
        self.asked: list[tuple[float, float | None]] = []  # when, and for what

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now_s = round(self.now_s + 0.01, 6)
            if self.now_s - self.received_s >= self.every_s - 1e-9:
                self.received_s, self.shown = self.now_s, self.mode
            obeys = self.shown == self.obeying
            requests = self.change.poll(self.now_s, self.received_s, obeys, self.shown)
            if requests:
                self.asked.append((self.now_s, asked_mode(requests)))


def guided(every_s: float = 0.2) -> Beats:
    return Beats(
        ModeChange(target("ardupilot", "attitude")), mode=FBWA, obeying=GUIDED, every_s=every_s
    )


def test_the_mode_is_asked_for_after_a_heartbeat_and_once() -> None:
    beats = guided()
    beats.run(0.05)
    beats.change.enter(beats.now_s, beats.received_s, FBWA)
    beats.run(0.15)
    assert beats.asked == [(10.2, GUIDED)]
    assert beats.change.is_entering
    beats.mode = GUIDED
    beats.run(3.0)
    assert len(beats.asked) == 1
    assert not beats.change.is_changing
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(0.2)
    assert [mode for _, mode in beats.asked] == [GUIDED, FBWA]  # where it came from
    beats.mode = FBWA
    beats.run(3.0)
    assert len(beats.asked) == 2
    assert beats.change.failed == ""


@pytest.mark.parametrize("every_s", [0.2, 1.0])
def test_a_lost_request_is_repeated_after_a_heartbeat_that_answers_it(every_s: float) -> None:
    beats = guided(every_s)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(PATIENCE_S + 1.0)
    times = [time_s for time_s, _ in beats.asked]
    assert len(times) == TRIES
    assert all(later - earlier >= ANSWER_S for earlier, later in pairwise(times))
    beats_since = [(time_s - 10.0) / every_s for time_s in times]
    assert beats_since == pytest.approx([round(n) for n in beats_since])
    assert "does not enter GUIDED (asked 3 times)" in beats.change.failed
    assert not beats.change.is_changing


def test_without_heartbeats_nothing_is_asked_for() -> None:
    beats = guided(1e9)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(PATIENCE_S + 0.1)
    assert beats.asked == []
    assert "no heartbeat" in beats.change.failed


def back(beats: Beats, mode: int) -> bool:
    """A heartbeat after a silence; whether ours is to be left."""
    beats.mode = beats.shown = mode
    beats.received_s = beats.now_s
    return beats.change.comes_back(beats.received_s, mode == GUIDED, mode, False)


@pytest.mark.parametrize("silent_s", [PATIENCE_S + 0.1, 60.0])
def test_ours_is_left_after_a_silence_too(silent_s: float) -> None:
    """The link was lost while GUIDED was flown: nothing would control the aircraft."""
    beats = guided(1e9)
    beats.mode = beats.shown = GUIDED
    beats.change.enter(10.0, 10.0, 2)
    beats.change.poll(10.2, 10.2, True, GUIDED)
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(silent_s)
    assert beats.asked == []
    assert "does not leave GUIDED (no heartbeat shows it)" in beats.change.failed
    assert not beats.change.is_changing
    assert back(beats, GUIDED)
    assert not beats.change.comes_back(beats.received_s, True, GUIDED, False)  # reported once
    beats.change.leave(beats.now_s, float("-inf"))
    beats.run(0.1)
    assert [mode for _, mode in beats.asked] == [2]  # where it was found


def test_an_entry_that_nobody_saw_is_left_when_it_is_seen() -> None:
    beats = guided(0.2)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(0.3)
    beats.every_s = 1e9
    beats.run(PATIENCE_S)
    assert [mode for _, mode in beats.asked] == [GUIDED]
    assert "no heartbeat" in beats.change.failed
    assert back(beats, GUIDED)


@pytest.mark.parametrize("mode", [FBWA, LOITER])
def test_another_mode_after_a_silence_is_the_pilot_s(mode: int) -> None:
    beats = guided(1e9)
    beats.mode = beats.shown = GUIDED
    beats.change.leave(10.0, 10.0)
    beats.run(PATIENCE_S + 0.1)
    assert not back(beats, mode)
    assert not back(beats, GUIDED)  # what is chosen later is not ours
    refused = guided(0.2)
    refused.change.enter(10.0, 10.0, FBWA)
    refused.change.stop()
    assert not back(refused, GUIDED)


def test_an_entry_that_was_never_asked_for_is_not_left() -> None:
    beats = guided(1e9)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(PATIENCE_S + 0.1)
    assert not back(beats, GUIDED)


@pytest.mark.parametrize("when_s", [0.05, 0.3, 0.5, 0.9])
@pytest.mark.parametrize("every_s", [0.2, 1.0])
def test_the_pilot_s_choice_ends_the_asking(when_s: float, every_s: float) -> None:
    beats = guided(every_s)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(when_s)
    before = list(beats.asked)
    beats.mode = LOITER
    beats.run(PATIENCE_S + 1.0)
    assert beats.asked == before
    assert "pilot has chosen another mode" in beats.change.failed


@pytest.mark.parametrize("every_s", [0.2, 1.0])
def test_the_pilot_s_choice_is_not_overwritten_on_the_way_out(every_s: float) -> None:
    beats = guided(every_s)
    beats.mode = beats.shown = GUIDED
    beats.change.leave(10.0, 10.0)
    beats.mode = LOITER  # chosen since the last heartbeat
    beats.run(PATIENCE_S + 1.0)
    assert beats.asked == []
    assert beats.change.failed == ""


def test_an_entry_that_was_withdrawn_is_left_when_it_comes_late() -> None:
    beats = guided()
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(0.2)
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(0.2)  # a heartbeat that may have been sent before the request
    beats.mode = GUIDED
    beats.run(0.2)
    assert [mode for _, mode in beats.asked] == [GUIDED, FBWA]
    beats.mode = FBWA
    beats.run(3.0)
    assert len(beats.asked) == 2
    unasked = guided()
    unasked.change.enter(10.0, 10.0, FBWA)
    unasked.change.leave(10.1, 10.0)
    assert not unasked.change.is_changing


def test_the_last_word_leaves_our_mode_and_no_other() -> None:
    beats = guided()
    beats.change.enter(10.0, 10.0, FBWA)
    assert beats.change.parting(obeys=False) == ()  # nothing was asked for yet
    beats.run(0.2)
    assert asked_mode(beats.change.parting(obeys=False)) == FBWA  # it may be on its way
    beats.mode = GUIDED
    beats.run(0.2)
    assert asked_mode(beats.change.parting(obeys=True)) == FBWA
    assert beats.change.parting(obeys=False) == ()  # the pilot's


def test_the_mode_of_before_is_that_of_this_engagement() -> None:
    beats = guided()
    beats.change.enter(10.0, 10.0, 2)
    beats.mode = LOITER
    beats.run(1.0)
    beats.mode = beats.shown = GUIDED  # chosen by the pilot: nothing was entered
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(0.2)
    assert beats.asked[-1][1] == FBWA  # the route's own


def test_px4_s_modes_have_two_parts() -> None:
    change = ModeChange(target("px4"))
    change.enter(0.0, 0.0, 4 << 16 | 3 << 24)
    (request,) = change.poll(0.1, 0.1, False, 4 << 16 | 3 << 24)
    assert isinstance(request, CommandLong)
    assert request.params[:3] == (1.0, 6.0, 0.0)
    change.leave(1.0, 0.1)
    (back,) = change.poll(1.1, 1.1, True, OFFBOARD)
    assert isinstance(back, CommandLong)
    assert back.params[:3] == (1.0, 4.0, 3.0)


def test_a_mode_that_the_pilot_must_choose_is_never_asked_for() -> None:
    change = ModeChange(target("ardupilot"))
    change.enter(0.0, 0.0, FBWA)
    assert not change.is_entering
    assert change.poll(0.1, 0.1, False, FBWA) == ()
    assert change.parting() == ()


@pytest.mark.parametrize("first", [FBWA, LOITER])
@pytest.mark.parametrize("second", [FBWA, LOITER])
def test_ours_comes_back_behind_each_failsafe_s_own_mode_and_no_other(
    first: int, second: int
) -> None:
    change = guided().change
    now_s = 20.0
    for chosen in (first, second):
        change.give_way()
        for mode, failsafe, back in (
            (chosen, True, False),
            (chosen, True, False),
            (GUIDED, False, True),  # by itself, as its failsafe is over
            (GUIDED, False, False),  # reported once
        ):
            now_s += 1.0
            assert change.comes_back(now_s, mode == GUIDED, mode, failsafe) is back
    change.give_way()
    other = FBWA + LOITER - second
    for mode, failsafe in ((second, True), (other, True), (GUIDED, False)):  # a person has chosen
        now_s += 1.0
        assert not change.comes_back(now_s, mode == GUIDED, mode, failsafe)

"""The pilot's switch, state by state, and what stands in the way of an engagement."""

from __future__ import annotations

from itertools import count

import pytest

from tgl_soar.link.commands import ENGAGE, NOTHING, RELEASE
from tgl_soar.link.engagement import GONE_S, SILENCE_S, Engagement, PilotSwitch
from tgl_soar.link.messages import RcChannels

CHANNEL = 6
ON_US, OFF_US = 1700.0, 1300.0  # OP_RC_ON, OP_RC_OFF
LOW, MIDDLE, HIGH = 1000, 1500, 2000
RATE_HZ = 10.0  # at which RC_CHANNELS are asked for
PERIOD_S = 1.0 / RATE_HZ


class Pilot:
    """A transmitter whose channels come ten times a second."""

    def __init__(self, channel: int = CHANNEL) -> None:
        self.switch = PilotSwitch()
        self.channel = channel
        self.now_s = 100.0
        self._boot = count(5_000, 100)

    def moves(
        self,
        pulse_us: int,
        *,
        after_s: float = PERIOD_S,
        stamp_ms: int | None = None,
        chancount: int = 18,
        channels: int = 18,
    ) -> int:
        self.now_s += after_s
        pulses = [1234] * channels
        if 1 <= self.channel <= channels:
            pulses[self.channel - 1] = pulse_us
        stamp = next(self._boot) if stamp_ms is None else stamp_ms
        message = RcChannels(chancount, tuple(pulses), stamp)
        return self.switch.take(message, self.now_s, self.channel, ON_US, OFF_US)

    def missing(self, after_s: float = 0.0, channel: int | None = None) -> str:
        asked = self.channel if channel is None else channel
        return self.switch.missing(self.now_s + after_s, asked)


# --- three states --------------------------------------------------------------------------------


def test_the_way_up_from_low_engages_once_and_low_releases() -> None:
    pilot = Pilot()
    wanted = [pilot.moves(us) for us in (LOW, LOW, MIDDLE, HIGH, HIGH, MIDDLE, HIGH, LOW, HIGH)]
    assert wanted == [
        *(RELEASE, RELEASE, NOTHING, ENGAGE, NOTHING, NOTHING, NOTHING, RELEASE, ENGAGE),
    ]


@pytest.mark.parametrize(
    ("pulse_us", "wanted", "is_low"),
    [
        (1299, RELEASE, True),
        (1300, NOTHING, False),
        (1301, NOTHING, False),
        (1700, NOTHING, False),
        (1701, ENGAGE, False),
    ],
)
def test_both_thresholds_are_of_the_middle(pulse_us: int, wanted: int, is_low: bool) -> None:
    pilot = Pilot()
    pilot.moves(LOW)
    assert pilot.switch.is_low
    assert pilot.moves(pulse_us) == wanted
    assert pilot.switch.is_low == is_low


def test_a_switch_that_is_up_from_the_start_engages_nothing() -> None:
    pilot = Pilot()
    assert not pilot.switch.is_low
    assert [pilot.moves(us) for us in (HIGH, MIDDLE, HIGH)] == [NOTHING] * 3


@pytest.mark.parametrize(
    ("pulse_us", "is_pulse"),
    [(0, False), (699, False), (700, True), (2300, True), (2301, False), (65535, False)],
)
def test_what_is_no_pulse_moves_no_switch(pulse_us: int, is_pulse: bool) -> None:
    """65535: the channel is not there; 0 comes of receivers that are silent."""
    pilot = Pilot()
    pilot.moves(LOW)
    wanted = pilot.moves(pulse_us)
    if is_pulse:
        assert wanted == (RELEASE if pulse_us < OFF_US else ENGAGE)
    else:
        assert wanted == NOTHING
        assert pilot.switch.is_low  # as it was


def test_after_a_silence_only_a_low_that_comes_again_engages() -> None:
    assert pytest.approx(10 * PERIOD_S) == SILENCE_S  # ten messages in a row
    pilot = Pilot()
    pilot.moves(LOW)
    assert pilot.moves(HIGH, after_s=0.9) == ENGAGE
    pilot.moves(LOW)
    assert pilot.moves(HIGH, after_s=1.1) == NOTHING
    assert pilot.moves(HIGH) == NOTHING
    pilot.moves(LOW)
    assert pilot.moves(HIGH) == ENGAGE


def test_frames_without_pulses_are_a_silence_too() -> None:
    pilot = Pilot()
    pilot.moves(LOW)
    for _ in range(11):
        pilot.moves(65535)
    assert pilot.moves(HIGH) == NOTHING


def test_a_stream_that_was_turned_off_comes_back_before_the_flight_is_ended() -> None:
    """Its rate is checked every 2 s, and it is asked for again at once; to wait for a third would
    leave the pilot without a way to end the flight."""
    check_s = 2.0
    assert check_s + 2 * PERIOD_S < GONE_S < 2 * check_s


def test_the_silence_is_counted_from_the_last_pulse() -> None:
    pilot = Pilot()
    assert pilot.switch.silence_s(pilot.now_s) == float("inf")
    pilot.moves(MIDDLE)
    pilot.moves(65535)
    assert pilot.switch.silence_s(pilot.now_s) == pytest.approx(PERIOD_S)


@pytest.mark.parametrize("channel", [1, 16, 18])
def test_any_channel_of_those_that_come_can_be_the_switch(channel: int) -> None:
    pilot = Pilot(channel)
    assert [pilot.moves(us) for us in (LOW, HIGH)] == [RELEASE, ENGAGE]


@pytest.mark.parametrize("channel", [0, -1, 19])
def test_a_channel_that_there_is_not_is_no_switch(channel: int) -> None:
    pilot = Pilot(channel)
    assert [pilot.moves(us) for us in (LOW, HIGH)] == [NOTHING, NOTHING]


@pytest.mark.parametrize(
    ("chancount", "channels", "wanted"), [(6, 18, RELEASE), (5, 18, NOTHING), (18, 5, NOTHING)]
)
def test_a_message_has_as_many_channels_as_it_says_and_carries(
    chancount: int, channels: int, wanted: int
) -> None:
    assert Pilot().moves(LOW, chancount=chancount, channels=channels) == wanted


def test_another_channel_begins_with_nothing_known() -> None:
    pilot = Pilot()
    pilot.moves(LOW)
    pilot.channel = 7
    assert pilot.moves(HIGH) == NOTHING
    assert not pilot.switch.is_low
    pilot.moves(LOW)
    assert pilot.moves(HIGH) == ENGAGE


def test_a_reset_forgets_the_switch_s_state_and_when_it_came() -> None:
    pilot = Pilot()
    pilot.moves(LOW)
    pilot.switch.reset()
    assert not pilot.switch.is_low
    assert pilot.switch.silence_s(pilot.now_s) == float("inf")
    assert "no RC_CHANNELS are received" in pilot.missing()
    assert pilot.moves(HIGH) == NOTHING


# --- messages that come late ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before_ms", "stamp_ms", "counts"),
    [
        (50_000, 50_100, True),
        (50_000, 50_000, False),  # twice
        (50_000, 49_999, False),  # overtaken
        (50_000, 40_001, False),
        (50_000, 40_000, True),  # ten seconds: no link holds a frame for so long: a restart
        (50_000, 1_000, True),
        (2**32 - 50, 50, True),  # milliseconds in 32 bits begin again
        (50, 2**32 - 50, False),
        (0, 50_000, True),  # 0: not known
        (50_000, 0, True),
        (0, 0, True),
    ],
)
def test_an_earlier_message_does_not_undo_a_later_one(
    before_ms: int, stamp_ms: int, counts: bool
) -> None:
    pilot = Pilot()
    pilot.moves(MIDDLE, stamp_ms=before_ms)
    assert pilot.moves(LOW, stamp_ms=stamp_ms) == (RELEASE if counts else NOTHING)


def test_the_very_first_message_is_never_late() -> None:
    assert Pilot().moves(LOW, stamp_ms=1) == RELEASE


def test_a_late_message_is_no_measure_of_those_that_follow() -> None:
    pilot = Pilot()
    pilot.moves(LOW, stamp_ms=50_000)
    assert pilot.moves(HIGH, stamp_ms=49_900) == NOTHING
    assert pilot.moves(HIGH, stamp_ms=49_950) == NOTHING  # later than the late one
    assert pilot.moves(HIGH, stamp_ms=50_100) == ENGAGE


@pytest.mark.parametrize("ahead_ms", [400, 700, 2_000, 8_000, 12_000, 10**6])
def test_one_stamp_ahead_does_not_deafen_the_switch(ahead_ms: int) -> None:
    pilot = Pilot()
    for stamp_ms in range(50_000, 52_000, 100):
        pilot.moves(MIDDLE, stamp_ms=stamp_ms)
    pilot.moves(MIDDLE, stamp_ms=51_950 + ahead_ms, after_s=0.05)
    found = [pilot.moves(LOW, stamp_ms=stamp_ms) for stamp_ms in range(52_000, 52_700, 100)]
    assert RELEASE in found[: 6 if ahead_ms <= 500 else 1]


@pytest.mark.parametrize("apart_s", [0.1, 60.0])
def test_two_stamps_ahead_that_go_on_are_the_clock(apart_s: float) -> None:
    """A clock that was set; wrong stamps now and then are none."""
    pilot = Pilot()
    pilot.moves(MIDDLE, stamp_ms=50_000)
    pilot.moves(MIDDLE, stamp_ms=60_000)
    between = 50_000 + round(1e3 * (apart_s - 0.1)) + 100
    if apart_s > 1.0:
        pilot.moves(MIDDLE, stamp_ms=between, after_s=apart_s - 0.1)
    pilot.moves(MIDDLE, stamp_ms=60_000 + round(1e3 * apart_s))
    obeyed = pilot.moves(LOW, stamp_ms=60_000 + round(1e3 * apart_s) - 50)  # an earlier one
    assert obeyed == (NOTHING if apart_s < 1.0 else RELEASE)


def test_a_leap_that_the_time_explains_is_none() -> None:
    pilot = Pilot()
    pilot.moves(MIDDLE, stamp_ms=50_000)
    pilot.moves(MIDDLE, stamp_ms=55_000, after_s=5.0)
    assert pilot.moves(LOW, stamp_ms=54_900) == NOTHING
    pilot.switch.reset()  # by another clock the time between is unknown
    pilot.moves(MIDDLE, stamp_ms=70_000)
    assert pilot.moves(LOW, stamp_ms=69_900) == NOTHING


def test_a_late_message_ends_no_silence() -> None:
    pilot = Pilot()
    pilot.moves(LOW, stamp_ms=50_000)
    pilot.moves(LOW, stamp_ms=49_900)
    assert pilot.switch.silence_s(pilot.now_s) == pytest.approx(PERIOD_S)


# --- why it cannot be read -----------------------------------------------------------------------


def test_a_switch_that_was_read_within_a_second_is_there() -> None:
    pilot = Pilot()
    pilot.moves(MIDDLE)
    assert pilot.missing() == ""
    assert pilot.missing(0.95) == ""
    assert pilot.missing(1.05) == "no RC_CHANNELS are received (OP_RC_CHAN = 6)"


def test_a_pilot_without_a_switch_misses_none() -> None:
    assert PilotSwitch().missing(0.0, 0) == ""


def test_of_a_channel_that_was_not_looked_at_nothing_is_known() -> None:
    pilot = Pilot()
    assert pilot.missing() == "no RC_CHANNELS are received (OP_RC_CHAN = 6)"
    pilot.moves(MIDDLE)
    assert pilot.missing(channel=7) == "no RC_CHANNELS are received (OP_RC_CHAN = 7)"


def test_too_few_channels_are_counted() -> None:
    pilot = Pilot()
    pilot.moves(MIDDLE, chancount=5)
    assert pilot.missing() == "RC_CHANNELS have 5 channels (OP_RC_CHAN = 6)"
    assert pilot.missing(0.95) == "RC_CHANNELS have 5 channels (OP_RC_CHAN = 6)"
    assert "no RC_CHANNELS" in pilot.missing(1.05)
    pilot.moves(MIDDLE, chancount=6)
    assert pilot.missing() == ""


def test_a_channel_without_pulses_is_named_with_what_is_on_it() -> None:
    pilot = Pilot()
    pilot.moves(65535)
    assert pilot.missing() == "no pulses on its channel: 65535 us (OP_RC_CHAN = 6)"
    pilot.moves(0, chancount=6)  # its last channel
    assert pilot.missing() == "no pulses on its channel: 0 us (OP_RC_CHAN = 6)"


# --- what holds an engagement back ---------------------------------------------------------------


def test_an_abort_stands_until_an_operator_has_released() -> None:
    engagement = Engagement()
    assert engagement.held_back() == ""
    engagement.abort("255:190")
    words = "aborted by 255:190: release first (OP_ENGAGE 0 or MAV_CMD_USER_2)"
    assert engagement.held_back() == words
    engagement.clear()
    assert engagement.held_back() == ""


def test_a_switch_that_is_low_holds_back_and_an_abort_is_reported_before_it() -> None:
    pilot, engagement = Pilot(), Engagement()
    pilot.switch = engagement.switch
    pilot.moves(LOW)
    assert engagement.held_back() == "the pilot's switch is low (OP_RC_CHAN)"
    engagement.abort("1:191")
    assert engagement.held_back().startswith("aborted by 1:191")
    engagement.clear()
    pilot.moves(MIDDLE)
    assert engagement.held_back() == ""

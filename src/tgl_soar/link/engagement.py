"""What holds an engagement back: an abort that stands, and the pilot's own switch.

The switch is a channel of the pilot's transmitter, as RC_CHANNELS carries it:

    low    below OP_RC_OFF   the module disengages, and cannot be engaged
    middle                   nothing changes
    high   above OP_RC_ON    coming from low, the module engages

Only the way up from a low that was received engages: a switch that is up when the module starts, or
when RC_CHANNELS come back after a silence, does not.  Nor does an earlier message that comes behind
a later one, or twice: the pilot's way out would be undone by the way in before it.  A stamp that
leaps ahead of the time that has passed makes nothing late until a second one goes on from there.

A pilot who has a switch counts on it.  So it cannot be engaged while its channel is not received:
no RC_CHANNELS, too few channels in them, or no pulses on it.  In flight such a silence is reported
after `SILENCE_S`, ten messages in a row at the rate that is asked for, and ends the engagement
after `GONE_S`.  Until then a stream that was turned off comes back: its rate is checked every
2 s, and it is asked for again at once.  Not later, for all that time the pilot's own way to end the
flight does nothing.

Every other reason why an engagement is refused: `onboard.engage_switch`, and the supervisor's.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.clock import HELD_S
from tgl_soar.link.commands import ENGAGE, NOTHING, RELEASE
from tgl_soar.link.messages import RcChannels

SILENCE_S: Final = 1.0
GONE_S: Final = 3.0
PULSES_US: Final = range(700, 2301)  # anything else is no pulse width
HELD_MS: Final = round(1e3 * HELD_S)  # a stamp that is further back is that of a restart
LEAP_MS: Final = 500  # no delay of a message before it makes its stamp seem so far ahead
_STAMPS: Final = 2**32  # they begin again at zero


class PilotSwitch:
    """One channel of the pilot's."""

    def __init__(self) -> None:
        self._channel = 0
        self._count = 0  # of the channels that the last RC_CHANNELS had
        self._pulse_us = 0  # of ours in it
        self._received_s = float("-inf")  # when that came
        self._stamp_ms = 0  # of the newest
        self._stamp_s = float("-inf")  # when that came
        self._leap_ms, self._leap_s = 0, float("-inf")  # of one that leapt ahead
        self._low = False  # now
        self._primed = False  # a low was received, and no silence since
        self._pulse_s = float("-inf")  # a pulse

    @property
    def is_low(self) -> bool:
        """Whether the pilot held the module back when the channel was received last."""
        return self._low

    def reset(self) -> None:
        """The clock was changed, or there is no switch."""
        self._low = self._primed = False
        self._pulse_s = self._received_s = float("-inf")
        self._stamp_s = self._leap_s = float("-inf")

    def silence_s(self, now_s: float) -> float:
        """For how long no pulse was received."""
        return now_s - self._pulse_s

    def missing(self, now_s: float, channel: int) -> str:
        """Why the switch on a channel cannot be read; "" if it can, or if there is none (0)."""
        if channel == 0 or (channel == self._channel and self.silence_s(now_s) <= SILENCE_S):
            return ""
        if channel != self._channel or now_s - self._received_s > SILENCE_S:
            return f"no RC_CHANNELS are received (OP_RC_CHAN = {channel})"
        if channel > self._count:
            return f"RC_CHANNELS have {self._count} channels (OP_RC_CHAN = {channel})"
        return f"no pulses on its channel: {self._pulse_us} us (OP_RC_CHAN = {channel})"

    def take(
        self, message: RcChannels, now_s: float, channel: int, on_us: float, off_us: float
    ) -> int:
        """What the pilot wants by a new state of all channels: ENGAGE, RELEASE or NOTHING."""
        if channel != self._channel:
            self._channel = channel
            self.reset()
        if self._is_late(message.time_boot_ms, now_s):
            return NOTHING
        self._received_s, self._count = now_s, min(message.chancount, len(message.channels))
        if not 1 <= channel <= self._count:
            return NOTHING
        self._pulse_us = pulse_us = message.channels[channel - 1]
        if pulse_us not in PULSES_US:
            return NOTHING
        if now_s - self._pulse_s > SILENCE_S:
            self._primed = False
        self._pulse_s = now_s
        if pulse_us < off_us:
            self._low = self._primed = True
            return RELEASE
        self._low = False
        if pulse_us > on_us and self._primed:
            self._primed = False
            return ENGAGE
        return NOTHING

    def _is_late(self, stamp_ms: int, now_s: float) -> bool:
        """Whether a later message has come before, or the same."""
        if 0 not in (stamp_ms, self._stamp_ms):
            if (self._stamp_ms - stamp_ms) % _STAMPS < HELD_MS:
                return True
            if _ahead_ms(self._stamp_ms, stamp_ms, now_s - self._stamp_s) > LEAP_MS:
                since_s = now_s - self._leap_s
                goes_on = since_s <= SILENCE_S
                goes_on &= abs(_ahead_ms(self._leap_ms, stamp_ms, since_s)) <= LEAP_MS
                self._leap_ms, self._leap_s = stamp_ms, now_s
                if not goes_on:
                    return False
        self._stamp_ms, self._stamp_s = stamp_ms, now_s
        return False


def _ahead_ms(before_ms: int, stamp_ms: int, passed_s: float) -> float:
    """By how much a stamp is further on from another than the time that has passed."""
    on_ms = (stamp_ms - before_ms + _STAMPS // 2) % _STAMPS - _STAMPS // 2
    return on_ms - 1e3 * passed_s


class Engagement:
    """Whether the module may be engaged at all."""

    def __init__(self) -> None:
        self.switch = PilotSwitch()
        self._aborted_by = ""

    def abort(self, by: str) -> None:
        """No engagement until an operator has released."""
        self._aborted_by = by

    def clear(self) -> None:
        """An operator has released."""
        self._aborted_by = ""

    @property
    def is_aborted(self) -> bool:
        """Whether an abort stands that nobody has released."""
        return self._aborted_by != ""

    def held_back(self) -> str:
        """Why nobody can engage; "" if it is not held back."""
        if self._aborted_by:
            return f"aborted by {self._aborted_by}: release first (OP_ENGAGE 0 or MAV_CMD_USER_2)"
        if self.switch.is_low:
            return "the pilot's switch is low (OP_RC_CHAN)"
        return ""

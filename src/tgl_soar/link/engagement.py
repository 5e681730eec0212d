"""What holds an engagement back: an abort that stands, and the pilot's own switch.

The switch is a channel of the pilot's transmitter, as RC_CHANNELS carries it:

    low    below OP_RC_OFF   the module disengages, and cannot be engaged
    middle                   nothing changes
    high   above OP_RC_ON    coming from low, the module engages

Only the way up from a low that was received engages: a switch that is up when the module starts, or
when RC_CHANNELS come back after a silence, does not.  Nor does an earlier message that comes behind
a later one, or twice: the pilot's way out would be undone by the way in before it.

A pilot who has a switch counts on it.  So it cannot be engaged while its channel is not received:
no RC_CHANNELS, too few channels in them, or no pulses on it.  In flight such a silence is reported
after `SILENCE_S`, ten messages in a row at the rate that is asked for, and ends the engagement
after `GONE_S`.  Until then a stream that was turned off comes back: its rate is checked every
2 s, and it is asked for again at once.  Not later, for all that time the pilot's own way to end the
flight does nothing.
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
_STAMPS: Final = 2**32  # they begin again at zero


class PilotSwitch:
    """One channel of the pilot's."""

    def __init__(self) -> None:
        self._channel = 0
        self._count = 0  # of the channels that the last RC_CHANNELS had
        self._pulse_us = 0  # of ours in it
        self._received_s = float("-inf")  # when that came
        self._stamp_ms = 0  # of the newest
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
        if self._is_late(message.time_boot_ms):
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

    def _is_late(self, stamp_ms: int) -> bool:
        """Whether a later message has come before, or the same."""
        before_ms, self._stamp_ms = self._stamp_ms, stamp_ms
        if 0 in (stamp_ms, before_ms) or (before_ms - stamp_ms) % _STAMPS >= HELD_MS:
            return False
        self._stamp_ms = before_ms
        return True


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

    def held_back(self) -> str:
        """Why nobody can engage; "" if it is not held back."""
        if self._aborted_by:
            return f"aborted by {self._aborted_by}: release first (OP_ENGAGE 0 or MAV_CMD_USER_2)"
        if self.switch.is_low:
            return "the pilot's switch is low (OP_RC_CHAN)"
        return ""

"""What holds an engagement back: an abort that stands, and the pilot's own switch.

The switch is a channel of the pilot's transmitter, as RC_CHANNELS tells it:

    low    below OP_RC_OFF   the module lets go, and nobody can engage it
    middle                   nothing changes
    high   above OP_RC_ON    coming from low, the module engages

Only the way up from a low that was seen engages: a switch that is up when the module starts, or
when RC_CHANNELS come back after a silence, does not.  Silence itself changes nothing: the
streams of a radio have gaps, and the autopilot does what it does without its receiver.
"""

from __future__ import annotations

from typing import Final

from .commands import ENGAGE, NOTHING, RELEASE
from .messages import RcChannels

SILENCE_S: Final = 1.0
PULSES_US: Final = range(700, 2301)  # anything else is no pulse width


class PilotSwitch:
    """One channel of the pilot's."""

    def __init__(self) -> None:
        self._channel = 0
        self._low = False  # now
        self._primed = False  # a low was seen, and no silence since
        self._heard_s = float("-inf")

    @property
    def is_low(self) -> bool:
        """Whether the pilot holds the module back; a channel that fell silent is believed."""
        return self._low

    def forget(self) -> None:
        """The clock was changed, or there is no switch."""
        self._low = self._primed = False
        self._heard_s = float("-inf")

    def take(
        self, message: RcChannels, now_s: float, channel: int, on_us: float, off_us: float
    ) -> int:
        """What the pilot wants by a new state of all channels: ENGAGE, RELEASE or NOTHING."""
        if channel != self._channel:
            self._channel = channel
            self.forget()
        if not 1 <= channel <= len(message.channels):
            return NOTHING
        pulse_us = message.channels[channel - 1]
        if pulse_us not in PULSES_US:
            return NOTHING
        if now_s - self._heard_s > SILENCE_S:
            self._primed = False
        self._heard_s = now_s
        if pulse_us < off_us:
            self._low = self._primed = True
            return RELEASE
        self._low = False
        if pulse_us > on_us and self._primed:
            self._primed = False
            return ENGAGE
        return NOTHING


class Engagement:
    """Whether the module may be engaged at all."""

    def __init__(self) -> None:
        self.switch = PilotSwitch()
        self._aborted_by = ""

    def abort(self, by: str) -> None:
        """Nobody engages until somebody has released."""
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

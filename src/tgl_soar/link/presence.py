"""Our heartbeat, which carries the module's mode, and duplicates that send one in our name.

    custom_mode    bits 0 … 7: the mode; bits 8 … 31: a number drawn at every start
    system_status  what the mode means in MAVLink's own words

MAVLink's states are coarse: a station that shows only them distinguishes soaring (ACTIVE) from
holding, recovering and released (CRITICAL: no normal flight) and from failed (EMERGENCY); the mode
is exact.  It is sent once a second, and at once when the mode changes.

Two modules with one identity both obey the command that engages, and fight for the surfaces.
A heartbeat in our name with another number of its start is that of a duplicate; one with our own
is ours, sent back to us by a router, however late and over whatever link.  While a duplicate is
received none can be engaged.  Of two

    one engaged    that one stays: the other was started later, and cannot engage
    both engaged   both disengage, and the pilot has control: neither knows which of them the
                   operator has meant.  The first to receive it sends its own heartbeat once more
                   before it disengages; where that is lost the other one stays

A duplicate that no link leads to us is not noticed.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.messages import (
    AUTOPILOT_INVALID,
    MODE_FLAG_CUSTOM_MODE,
    STATE_ACTIVE,
    STATE_BOOT,
    STATE_CRITICAL,
    STATE_EMERGENCY,
    STATE_STANDBY,
    TYPE_ONBOARD_CONTROLLER,
    Heartbeat,
)
from tgl_soar.types import (
    BEATING,
    BOOT,
    BREAKING_OFF,
    CAPTURING,
    FAILED,
    HOLDING,
    LANDING,
    LAUNCHING,
    READY,
    RECOVERING,
    RELEASED,
    SEARCHING,
    SOARING,
    STANDBY,
)

MODE_BITS: Final = 8
ALONE_S: Final = 5.0  # so long after its last heartbeat a duplicate is gone; four may be lost
STATES: Final = {
    BOOT: STATE_BOOT,
    STANDBY: STATE_STANDBY,
    READY: STATE_STANDBY,
    CAPTURING: STATE_ACTIVE,
    SOARING: STATE_ACTIVE,
    HOLDING: STATE_CRITICAL,
    RECOVERING: STATE_CRITICAL,
    RELEASED: STATE_CRITICAL,
    FAILED: STATE_EMERGENCY,
    SEARCHING: STATE_ACTIVE,
    LAUNCHING: STATE_ACTIVE,
    BREAKING_OFF: STATE_CRITICAL,
    LANDING: STATE_CRITICAL,
    BEATING: STATE_ACTIVE,
}
# Of a duplicate: the modes in which it is in control.
ENGAGED: Final = frozenset(STATES) - {BOOT, STANDBY, READY, RELEASED, FAILED}


class Presence:
    """Our heartbeat, and the last one of a duplicate."""

    def __init__(self, start: int) -> None:
        """`start`: a number that no other start has drawn; its lower 24 bits count."""
        self.mode = BOOT
        self.duplicate_is_engaged = False  # as its last heartbeat says
        self._duplicate_s = float("-inf")  # when it was received last
        self._start = start % 2**24 or 1

    def heartbeat(self) -> Heartbeat:
        """Ours, as it is now."""
        return Heartbeat(
            type=TYPE_ONBOARD_CONTROLLER,
            autopilot=AUTOPILOT_INVALID,
            base_mode=MODE_FLAG_CUSTOM_MODE,
            custom_mode=self._start << MODE_BITS | self.mode,
            system_status=STATES[self.mode],
        )

    def take(self, beat: Heartbeat, now_s: float) -> bool:
        """A heartbeat in our name; whether it is a duplicate's."""
        start, mode = beat.custom_mode >> MODE_BITS, beat.custom_mode % 2**MODE_BITS
        if start == self._start:
            return False
        self._duplicate_s = now_s
        self.duplicate_is_engaged = mode in ENGAGED
        return True

    def is_alone(self, now_s: float) -> bool:
        """Whether no duplicate was received lately."""
        return not now_s - self._duplicate_s <= ALONE_S

    def rebase(self) -> None:
        """The clock is another one: what was received by the old one is discarded."""
        self._duplicate_s = float("-inf")

"""Our heartbeat, which tells the module's mode.

    custom_mode    bits 0 … 7: the mode; bits 8 … 31: a number drawn at every start
    system_status  what the mode means in MAVLink's own words

MAVLink's states are coarse: a station that shows only them tells soaring (ACTIVE) from holding,
recovering and released (CRITICAL: no normal flight) and from failed (EMERGENCY); the mode says
which.  It is sent once a second, and at once when the mode changes.
"""

from __future__ import annotations

from typing import Final

from .messages import (
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

MODE_BITS: Final = 8
# By the mode, as the supervisor numbers them; a test holds the two together.
STATES: Final = (
    STATE_BOOT,
    STATE_STANDBY,
    STATE_STANDBY,  # ready
    STATE_ACTIVE,  # capturing
    STATE_ACTIVE,  # soaring
    STATE_CRITICAL,  # holding
    STATE_CRITICAL,  # recovering
    STATE_CRITICAL,  # released
    STATE_EMERGENCY,  # failed
)


class Presence:
    """What all others know of us."""

    def __init__(self, start: int) -> None:
        """`start`: a number that no other start has drawn; its lower 24 bits count."""
        self.mode = 0
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

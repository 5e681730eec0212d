"""The mission of the autopilot, read as far as its landing needs it, the item that it flies, and
its home.

    ask        HOME_POSITION, by REQUEST_MESSAGE; without an answer it is not known
               MISSION_REQUEST_LIST  ->  MISSION_COUNT
               MISSION_REQUEST_INT k ->  MISSION_ITEM_INT k, one after the other
    the end    MISSION_ACK

A question that stays without an answer is repeated, `ASK_TIMES` in all.  Nothing is changed.
No socket and no clock here: messages and time are arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from tgl_soar.link.autopilot_setup_check import ASK_S, ASK_TIMES
from tgl_soar.link.messages import (
    COMMAND_DO_LAND_START,
    COMMAND_NAV_LAND,
    COMMAND_REQUEST_MESSAGE,
    COMPONENT_AUTOPILOT,
    ID_HOME_POSITION,
    CommandLong,
    HomeMessage,
    MissionAck,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    Outbound,
    Source,
)
from tgl_soar.types import NEVER_S

# A landing's own mission has some ten items; a survey that ends in one may have hundreds, and at
# 57600 baud each item and its request take 15 ms.
ITEMS_MAX: Final = 1000


class MissionLanding(NamedTuple):
    """One landing of a mission."""

    begins: int  # item of DO_LAND_START
    touches: int  # item of NAV_LAND
    latitude_deg: float
    longitude_deg: float


def landings_of(items: Sequence[MissionItemInt]) -> list[MissionLanding]:
    """All of a mission's: each beginning with the first touch-down after it."""
    found = []
    for item in items:
        if item.command != COMMAND_DO_LAND_START:
            continue
        for other in items[item.seq + 1 :]:
            if other.command == COMMAND_NAV_LAND:
                found.append(MissionLanding(item.seq, other.seq, other.x * 1e-7, other.y * 1e-7))
                break
    return found


class MissionReading:
    """Reads it when it is asked to."""

    def __init__(self, own: Source) -> None:
        self.items: list[MissionItemInt] = []
        self.is_known = False  # all items are there
        self.failed = ""  # why they are not
        self.current = -1  # item that is flown, by the newest MISSION_CURRENT; -1: none came
        self.current_count = 0  # of those
        self.home: HomeMessage | None = None  # the newest; None: none came
        self.restarts = 0  # so often what was asked for was asked for again
        self._own = own
        self._count = -1
        self._asks = False
        self._tries = 0
        self._asked_s = NEVER_S

    def begin(self) -> None:
        """Ask for it, all of it, whatever is known."""
        self.items = []
        self.is_known, self.failed = False, ""
        self._count, self._asks = -1, True
        self._tries, self._asked_s = 0, NEVER_S

    def restart(self) -> None:
        """The autopilot may be another one, or the clock is: what was asked for is asked again."""
        self.current, self.home = -1, None
        self.restarts += 1
        if self._asks or self.is_known or self.failed:
            self.begin()

    def take(self, message: MissionCount | MissionItemInt | MissionCurrent | HomeMessage) -> None:
        """Take in one message of the autopilot."""
        if isinstance(message, HomeMessage):
            self.home = message
            return
        if isinstance(message, MissionCurrent):
            self.current = message.seq
            self.current_count += 1
            return
        target = (message.target_system, message.target_component)
        if not self._asks or target != (self._own.system, self._own.component):
            return  # a ground station's
        if isinstance(message, MissionCount):
            if message.items > ITEMS_MAX:
                self._end(f"its mission has {message.items} items, at most {ITEMS_MAX} are read")
            elif self._count < 0:
                self._count = message.items
                self._answered()
        elif self._count >= 0 and message.seq == len(self.items):
            self.items.append(message)
            self._answered()

    def poll(self, now_s: float) -> list[Outbound]:
        """What is due."""
        if not self._asks:
            return []
        system = self._own.system
        if self._count == len(self.items):
            self.is_known = True
            self._end("")
            return [MissionAck(system, COMPONENT_AUTOPILOT, 0)]
        if now_s - self._asked_s < ASK_S:
            return []
        if self._tries >= ASK_TIMES:
            self._end("its mission cannot be read: no answer")
            return []
        self._tries += 1
        self._asked_s = now_s
        if self._count < 0:
            return [self._home_request(), MissionRequestList(system, COMPONENT_AUTOPILOT)]
        return [MissionRequestInt(system, COMPONENT_AUTOPILOT, len(self.items))]

    def _home_request(self) -> CommandLong:
        return CommandLong(
            target_system=self._own.system,
            target_component=COMPONENT_AUTOPILOT,
            command=COMMAND_REQUEST_MESSAGE,
            confirmation=0,
            params=(float(ID_HOME_POSITION), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        )

    def _answered(self) -> None:
        self._tries, self._asked_s = 0, NEVER_S

    def _end(self, failed: str) -> None:
        self._asks = False
        self.failed = failed

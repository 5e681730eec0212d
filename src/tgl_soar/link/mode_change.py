"""Into the mode in which a route's commands act, and back out of it.

Some firmwares obey only in a mode of their own (GUIDED, OFFBOARD), which the module asks for
when it is engaged and leaves when it lets go, for the one that it was found in.  Whether the
mode has changed is believed of the heartbeat alone: an acknowledgement may come before a
refusal.  A mode that is neither the old one nor ours is the pilot's: nothing more is asked.
"""

from __future__ import annotations

from typing import Final

from .autopilots.base import Flavour
from .messages import Said

ASK_S: Final = 0.25
PATIENCE_S: Final = 3.0  # heartbeats come once a second


class ModeChange:
    """What is asked of the autopilot's mode, and until when."""

    def __init__(self, flavour: Flavour) -> None:
        self.failed = ""  # why the last one did not come about
        self._flavour = flavour
        self._before = flavour.route.mode_to_leave
        self._wanted = -1
        self._to_enter = False
        self._until_s = float("-inf")
        self._due_s = float("-inf")

    @property
    def is_entering(self) -> bool:
        """Whether the mode that obeys has been asked for and has not come yet."""
        return self._wanted >= 0 and self._to_enter

    def enter(self, now_s: float, custom_mode: int) -> None:
        """Ask for the mode that obeys, from the one that is."""
        wanted = self._flavour.route.mode_to_enter
        if wanted is not None:
            self._before = custom_mode
            self._ask(wanted, now_s, to_enter=True)

    def leave(self, now_s: float) -> None:
        """Ask for the mode that was before."""
        if self._flavour.route.mode_to_enter is not None:
            self._ask(self._before, now_s, to_enter=False)
            self._before = self._flavour.route.mode_to_leave

    def parting(self) -> tuple[Said, ...]:
        """The same as a last word."""
        if self._flavour.route.mode_to_enter is None:
            return ()
        return (self._flavour.ask_for_mode(self._before),)

    def stop(self) -> None:
        """Ask for nothing any more."""
        self._wanted = -1

    def poll(self, now_s: float, obeys: bool, custom_mode: int) -> tuple[Said, ...]:
        """What is to be sent; `obeys`, `custom_mode`: of the latest heartbeat."""
        if self._wanted < 0:
            return ()
        if obeys == self._to_enter:
            self.stop()
            return ()
        mode = self._flavour.route.mode
        if self._to_enter and custom_mode != self._before:
            self.failed = "not engaged: the pilot has chosen another mode"
        elif now_s >= self._until_s and self._to_enter:
            self.failed = f"not engaged: the autopilot does not enter {mode}"
        elif now_s >= self._until_s:
            self.failed = f"the autopilot does not leave {mode}: take it out of it"
        else:
            if now_s < self._due_s:
                return ()
            self._due_s = now_s + ASK_S
            return (self._flavour.ask_for_mode(self._wanted),)
        self.stop()
        return ()

    def _ask(self, wanted: int, now_s: float, *, to_enter: bool) -> None:
        self.failed = ""
        self._wanted, self._to_enter = wanted, to_enter
        self._until_s, self._due_s = now_s + PATIENCE_S, now_s

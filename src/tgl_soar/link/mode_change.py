"""Into the mode in which a route's commands act, and back out of it.

Some firmwares obey only in a mode of their own (GUIDED, OFFBOARD), which the module asks for
when it is engaged and leaves when it disengages, for the one that it was found in.  The pilot
chooses modes too, and their word is final:

    ask      only right after a heartbeat that shows the mode to be left; never by a timer, which
             would overwrite what the pilot has chosen since the last heartbeat
    again    only after a heartbeat that can follow the last request, and still shows the
             same: `TRIES` times in all, for a request may be lost
    stop     at the first heartbeat that shows any other mode

A firmware changes the mode by itself, too, in a failsafe, and ArduPlane gives GUIDED back as soon
as its short one is over: to nobody, for the module has disengaged.  So a mode that comes back at
the end of a failsafe, from the one that the failsafe had put in its place, is left as well.  So is
ours where heartbeats were missing for so long that nobody knew whether it had been entered or left,
and the next one shows it.

What remains is a choice that crosses a request on its way: the link's latency, once.  Whether
the mode has changed is known by the heartbeat alone: an acknowledgement may be lost, and PX4
acknowledges before it refuses.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.messages import Outbound

# A heartbeat so long after a request was sent after it was received: a radio's round trip is up to
# 0.3 s, and a firmware takes a request up within 0.1 s.
ANSWER_S: Final = 0.5
TRIES: Final = 3  # one frame in ten lost: none of three arrives once in a thousand times
PATIENCE_S: Final = 5.0  # where heartbeats come once a second, three requests and their answers


class ModeChange:
    """What is asked of the autopilot's mode, and until when."""

    def __init__(self, flavour: Flavour) -> None:
        self.failed = ""  # why the last one did not come about
        self._flavour = flavour
        self._before = flavour.route.mode_to_leave
        self._wanted = -1
        self._to_enter = False
        self._until_s = float("-inf")
        self._looked_s = float("-inf")  # when the newest heartbeat came that was looked at
        self._asked_s = float("-inf")  # last
        self._entry_asked_s = float("-inf")  # of one that was withdrawn
        self._tries = 0
        self._given_way = False  # a failsafe has put another mode in the place of ours
        self._in_its_place = -1  # custom_mode of that; -1: no heartbeat looked at yet
        self.is_unseen = False  # ours may have been entered, or not left: no heartbeat has shown it

    @property
    def is_changing(self) -> bool:
        """Whether a mode is asked for, or about to be."""
        return self._wanted >= 0

    @property
    def is_entering(self) -> bool:
        """Whether the mode that obeys has been asked for and has not come yet."""
        return self._wanted >= 0 and self._to_enter

    def enter(self, now_s: float, heartbeat_s: float, custom_mode: int) -> None:
        """Ask for the mode that obeys, from the one that the last heartbeat has shown."""
        wanted = self._flavour.route.mode_to_enter
        if wanted is not None:
            self._before = custom_mode
            self._begin(wanted, now_s, heartbeat_s, to_enter=True)

    def leave(self, now_s: float, heartbeat_s: float, *, failsafe: bool = False) -> None:
        """Ask for the mode that was before; in a failsafe for the route's own, which flies without
        a pilot: their radio may be what has failed."""
        if self._flavour.route.mode_to_enter is None:
            return
        if failsafe:
            self._before = self._flavour.route.mode_to_leave
        if self.is_entering and self._tries == 0:
            self.stop()  # nothing was asked for yet
            return
        self._entry_asked_s = self._asked_s if self.is_entering else float("-inf")
        self._begin(self._before, now_s, heartbeat_s, to_enter=False)

    def parting(self, *, obeys: bool = True) -> tuple[Outbound, ...]:
        """The same as a last word, for there is no time to wait for a heartbeat.

        `obeys`: whether the latest one has shown our mode; any other is the pilot's.
        """
        on_its_way = self.is_entering and self._tries > 0
        if self._flavour.route.mode_to_enter is None or not (obeys or on_its_way):
            return ()
        return (self._flavour.ask_for_mode(self._before),)

    def stop(self) -> None:
        """Ask for nothing any more; the mode of before counts only while ours was entered."""
        self._wanted = -1
        self._before = self._flavour.route.mode_to_leave
        self._given_way = self.is_unseen = False

    def give_way(self) -> None:
        """A failsafe has put another mode in the place of ours, which may come back after it."""
        self.stop()
        self._given_way = self._flavour.route.mode_to_enter is not None
        self._in_its_place = -1

    def comes_back(self, heartbeat_s: float, obeys: bool, custom_mode: int, failsafe: bool) -> bool:
        """Whether our mode has come back from a failsafe, or out of a silence: then it is to be
        left."""
        if not (self._given_way or self.is_unseen) or heartbeat_s <= self._looked_s:
            return False
        self._looked_s = heartbeat_s
        if self.is_unseen:
            self.is_unseen = False
            return obeys
        if self._in_its_place < 0 and not obeys:
            self._in_its_place = custom_mode
        # Over without ours, or a mode chosen in it, be it ours: nothing is given back any more.
        self._given_way = not obeys and failsafe and custom_mode == self._in_its_place
        return obeys and not failsafe

    def poll(
        self, now_s: float, heartbeat_s: float, obeys: bool, custom_mode: int
    ) -> tuple[Outbound, ...]:
        """What is to be sent.

        `heartbeat_s`: when the latest heartbeat came; `obeys`, `custom_mode`: what it shows.
        """
        if self._wanted < 0:
            return ()
        if heartbeat_s > self._looked_s:
            self._looked_s = heartbeat_s
            return self._look(now_s, obeys, custom_mode)
        if now_s >= self._until_s:
            self._give_up("no heartbeat shows it", unseen=True)
        return ()

    def _look(self, now_s: float, obeys: bool, custom_mode: int) -> tuple[Outbound, ...]:
        """At a new heartbeat."""
        answered = self._looked_s - self._asked_s >= ANSWER_S
        if obeys and self._to_enter:
            self._wanted = -1
        elif not obeys and not self._to_enter:
            # A request to enter that was withdrawn may still be on its way.
            over = self._looked_s - self._entry_asked_s >= ANSWER_S
            if over or custom_mode != self._before:
                self.stop()
        elif self._to_enter and custom_mode != self._before:
            self.failed = "not engaged: the pilot has chosen another mode"
            self.stop()
        elif answered:
            if self._tries >= TRIES:
                self._give_up(f"asked {TRIES} times", unseen=False)
            else:
                self._tries += 1
                self._asked_s = now_s
                return (self._flavour.ask_for_mode(self._wanted),)
        return ()

    def _give_up(self, why: str, *, unseen: bool) -> None:
        mode, before = self._flavour.route.mode, self._before
        if self._to_enter:
            self.failed = f"not engaged: the autopilot does not enter {mode} ({why})"
            unseen = self._tries > 0  # a request may have come late
        else:
            self.failed = f"the autopilot does not leave {mode} ({why}): take it out of it"
        self.stop()
        self._before, self.is_unseen = before, unseen

    def _begin(self, wanted: int, now_s: float, heartbeat_s: float, *, to_enter: bool) -> None:
        self.failed = ""
        self._given_way = self.is_unseen = False
        self._wanted, self._to_enter = wanted, to_enter
        self._tries, self._asked_s = 0, float("-inf")
        self._looked_s = heartbeat_s
        self._until_s = now_s + PATIENCE_S

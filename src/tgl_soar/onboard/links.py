"""The module's links: added, greeted, read only so far between two ticks, and how much they lose.

Nothing is said on a link before our heartbeat has gone out on it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from tgl_soar.link.routing import Route, Send
from tgl_soar.link.session import Session
from tgl_soar.link.signing import Signing
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.flightlog.recorder import LinkReport, Recorder
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.pacing import TickCounters
from tgl_soar.onboard.setup import ModuleSetup, known_systems

LOSS_S: Final = 2.0  # over which the loss on the link is measured


class ModuleLinks:
    """The routes of one module; the first leads to the autopilot."""

    def __init__(
        self,
        setup: ModuleSetup,
        session: Session,
        signing: Signing,
        outbox: Outbox,
        recorder: Recorder,
        *,
        unsigned_autopilot: bool,
    ) -> None:
        """`unsigned_autopilot`: the autopilot itself need not sign on its own link."""
        self.loss = 0.0  # fraction of the autopilot's frames, of late
        self._setup = setup
        self._session = session
        self._signing = signing
        self._outbox = outbox
        self._recorder = recorder
        self._unsigned_autopilot = unsigned_autopilot
        self._loss_due_s = float("-inf")
        self._loss_counted = (0, 0)

    def add(
        self,
        send: Send,
        *,
        stream: bool,
        send_command: Send | None = None,
        clear_for_release: Callable[[], bool] | None = None,
    ) -> Route:
        """One more link.  `stream`: it may cut frames anywhere.  The rest: as of `Route`."""
        setup, number = self._setup, len(self._outbox.routes)
        excused = self._session.autopilot if number == 0 and self._unsigned_autopilot else None
        route = Route(
            number,
            setup.own,
            setup.override,
            send,
            self._signing,
            stream=stream,
            excused=excused,
            known=known_systems(setup),
            tap=partial(self._recorder.inbound, number),
            send_command=send_command,
            clear_for_release=clear_for_release,
        )
        self._outbox.routes.append(route)
        return route

    def may_read(self, link: int) -> bool:
        """Whether another link than the first may be read once more before the next tick."""
        return self._outbox.routes[link].may_read()

    def has_more_tries(self, link: int) -> bool:
        """Whether a link may be read at all before the next tick."""
        return self._outbox.routes[link].tries_left > 0

    def is_waiting(self, link: int) -> bool:
        """Whether `Onboard.event` is to be called once more, with no bytes: there was too much."""
        return self._outbox.routes[link].decoder.is_waiting

    def greet(self, route: Route) -> None:
        """Our heartbeat, before anything else is said on this link."""
        route.greeted = route.send(route.own.encode(self._session.heartbeat()))

    def show_presence(self, now_s: float) -> None:
        """Our heartbeat, where it is due."""
        due = self._session.heartbeat_if_due(now_s)
        for route in self._outbox.routes:
            if not route.greeted:
                self.greet(route)
            else:
                self._outbox.say_all(due, route)

    def refill(self) -> None:
        """A tick is over: every link may be read as far again."""
        for route in self._outbox.routes:
            route.refill()

    def restart(self, now_s: float) -> None:
        """The clock is another one from here on, and so are the numbers of our frames."""
        self._loss_due_s = now_s
        for route in self._outbox.routes:
            route.own.restart()
            route.override.restart()

    def measure_loss(self, now_s: float, ticks: TickCounters, counters: Counters) -> None:
        """How much of what the autopilot sent was lost of late; the log has it, too."""
        if now_s < self._loss_due_s:
            return
        self._loss_due_s = now_s + LOSS_S
        decoded = self._outbox.autopilot.decoder.counters
        watched, lost = self._loss_counted
        self._loss_counted = decoded.watched, decoded.lost
        came, missed = decoded.watched - watched, max(0, decoded.lost - lost)
        self.loss = missed / (came + missed) if came + missed else 0.0
        self._recorder.link(
            LinkReport(
                loss=self.loss,
                round_trip_s=self._session.round_trip_s,
                frames=decoded.frames,
                bad_checksums=decoded.bad_checksums,
                unsent=counters.unsent,
                late=ticks.late,
                skipped=ticks.skipped,
                over_run=ticks.over_run,
                worst_late_s=ticks.worst_late_s,
            )
        )

"""What goes out: frames on one link or on all of them, and words for the operator.

say         a message of ours, on one link or on all
tell        words, on all links, on the console and in the log
command     what a tick asks of the surfaces: it goes at once or is left out, as the next
            tick's is newer
hand_over   what releases the surfaces: it is never left out
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Outbound, Source
from tgl_soar.link.routing import Route
from tgl_soar.link.telemetry import StatusTexts, Telemetry
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.flightlog.recorder import Recorder


class Outbox:
    """The way out of everything, whichever part says it."""

    def __init__(
        self,
        counters: Counters,
        recorder: Recorder,
        telemetry: Telemetry,
        console: Callable[[str], None] | None,
    ) -> None:
        """`console`: where words go locally."""
        self.console = console or _nowhere
        self.texts = StatusTexts()
        self.routes: list[Route] = []  # the first leads to the autopilot
        self.telemetry_bytes_per_s = 0.0
        self._counters = counters
        self._recorder = recorder
        self._telemetry = telemetry

    @property
    def autopilot(self) -> Route:
        """The link to the autopilot."""
        return self.routes[0]

    # --- messages -----------------------------------------------------------------------------

    def say(self, message: Outbound, only: Route | None = None) -> int:
        """On one link, or on all; the bytes that one link carries."""
        size = 0
        for route in self.routes if only is None else (only,):
            size = max(size, self._send(route, route.own, message))
        return size

    def say_all(self, messages: Sequence[Outbound], only: Route | None = None) -> None:
        """Several of them, in their order."""
        for message in messages:
            self.say(message, only)

    def say_to(self, source: Source, message: Outbound) -> None:
        """On the links where a source was received."""
        for route in self.routes:
            if route.leads_to(source):
                self.say(message, route)

    # --- words and telemetry ------------------------------------------------------------------

    def tell(self, severity: int, text: str) -> None:
        """Words for the operator, over the link and on the console."""
        self.console(text)
        self._recorder.text(severity, text)
        self.say_words(severity, text)

    def tell_all(self, notices: list[tuple[int, str]]) -> None:
        """Words that a part has left, with their severities; it has none then."""
        for severity, text in notices:
            self.tell(severity, text)
        notices.clear()

    def say_words(self, severity: int, text: str, only: Route | None = None) -> None:
        """Words over the link alone."""
        for chunk in self.texts.chunks(severity, text):
            self._spend(self.say(chunk, only))

    def say_metered(self, message: Outbound, only: Route) -> int:
        """On one link, at the telemetry's expense; the bytes of it."""
        size = self.say(message, only)
        self._spend(size)
        return size

    def send_telemetry(self, now_s: float, *, sheds: bool) -> None:
        """The message that is due, unless there is no time for it."""
        message = self._telemetry.due(now_s, self.telemetry_bytes_per_s)
        if message is not None and sheds:
            self._counters.telemetry_shed += 1
        elif message is not None:
            self._spend(self.say(message))

    def _spend(self, size: int) -> None:
        self._telemetry.budget.spend(size, self.telemetry_bytes_per_s)

    # --- surfaces -----------------------------------------------------------------------------

    def command(self, messages: tuple[Outbound, ...]) -> None:
        """What a tick asks for, if it goes at once; else the next tick's is newer."""
        route = self.routes[0]
        for message in messages:
            frame = frame_of(message, route.override) if route.greeted else b""
            if frame is None:
                self._counters.unsendable += 1
            elif frame and route.send_command(frame):
                self._recorder.outbound(frame)
            elif frame:
                self._counters.unsent += 1
                self._counters.left_out += 1

    def hand_over(self, messages: tuple[Outbound, ...]) -> int:
        """What releases the surfaces; the bytes of it."""
        route = self.routes[0]
        return sum([self._send(route, route.override, message) for message in messages])

    def _send(self, route: Route, encoder: Encoder, message: Outbound) -> int:
        if not route.greeted:
            return 0
        frame = frame_of(message, encoder)
        if frame is None:
            self._counters.unsendable += 1
            return 0
        if frame:
            if not route.send(frame):
                self._counters.unsent += 1
            self._recorder.outbound(frame)
        return len(frame)


def frame_of(message: Outbound, encoder: Encoder) -> bytes | None:
    """A message as it goes out; None: a field does not fit its place."""
    try:
        return encoder.encode(message)
    except (struct.error, OverflowError, ValueError, TypeError):
        return None


def _nowhere(_text: str) -> None:
    """Words that nobody asked for."""

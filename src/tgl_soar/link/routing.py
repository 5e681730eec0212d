"""Links side by side: who sends where, and what was lost on the way.

The first link leads to the autopilot: its measurements are accepted there and nowhere else, and
the surfaces are commanded there and nowhere else.  A ground station may be on that link too, as
the autopilot routes between its own links, or on a link of its own.  An answer goes out where
the question came from; what concerns everybody goes out everywhere.  Nothing is passed on from
one link to another: that is a router's work.

What came over any but the first link is read little by little: of its `TRIES` (as the decoder
counts work) a link gets so many again with each tick, whatever it is sent.

A link uses MAVLink 1 as long as nothing but MAVLink 1 has come over it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final, TypeAlias

from tgl_soar.link.decoder import UNLIMITED, Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Received, Source
from tgl_soar.link.signing import Signing, source_of

MAX_SENDERS: Final = 32  # remembered on each link

# Interpreted, a try takes some 5 us, and so all of a tick's half a millisecond: a tenth of a
# period of 5 ms.  It is 6 messages of a station in datagrams of their own, 1200 a second: many
# times what a telemetry radio or a bridge of a tracking system brings.
TRIES: Final = 100
READ_TRIES: Final = 8  # to read once from a link: `transports.udp.STRANGERS` datagrams at most

Send: TypeAlias = Callable[[bytes], bool]


class Route:
    """One link: its decoder, its encoders, and whom it leads to."""

    def __init__(
        self,
        number: int,
        own: Source,
        override: Source,
        send: Send,
        signing: Signing,
        *,
        stream: bool,
        excused: Source | None = None,
        known: Collection[int] = (),
        tap: Callable[[bytes, bool], None] | None = None,
        send_command: Send | None = None,
        clear_for_release: Callable[[], bool] | None = None,
    ) -> None:
        """`stream`: the link may cut frames anywhere.  `excused`: who need not sign here.

        `tap`: is shown every frame that comes, and whether it is wanted: accepted, and of one of
        the `known` systems.  `send_command`, `clear_for_release`: as a transport has them; without
        them commands are sent as all else is.
        """
        self.number = number
        self.send = send
        self.send_command = send_command or send
        self.clear_for_release = clear_for_release or _nothing_waits
        self._known = frozenset(known)
        self._tap = tap
        show = None if tap is None else self._show
        self.tries_left = UNLIMITED if number == 0 else TRIES
        self.decoder = Decoder(stream=stream, accept=self._accept, tap=show)
        self.own = Encoder(own, signing, number)
        self.override = self.own if override == own else Encoder(override, signing, number)
        self._signing = signing
        self._excused = excused
        self._last_sender: Source | None = None  # last
        self.greeted = False  # our heartbeat has gone out
        self.asked = False  # a list of parameters, or some of them
        self._senders: dict[Source, None] = {}

    def _accept(self, frame: bytes) -> bool:
        signing = self._signing
        if signing.key is None:
            return True
        return signing.accepts(frame, excused=source_of(frame) == self._excused)

    def _show(self, frame: bytes, accepted: bool) -> None:
        """To the log."""
        assert self._tap is not None
        self._tap(frame, accepted and source_of(frame).system in self._known)

    def may_read(self) -> bool:
        """Whether to read once more before the next tick; it is counted."""
        if self.tries_left <= 0:
            return False
        self.tries_left -= READ_TRIES
        return True

    def take(self, data: bytes) -> list[Received]:
        """The messages of what came, or of what waits (then `data` is empty), as far as may be."""
        if self.number == 0:
            return self.decoder.feed(data)
        received = self.decoder.feed(data, self.tries_left)
        self.tries_left -= self.decoder.tries
        return received

    def refill(self) -> None:
        """A tick is over.  What was done too much is a debt."""
        if self.number != 0:
            self.tries_left = min(TRIES, self.tries_left + TRIES)

    def received(self, source: Source) -> None:
        """A frame of this sender has come on this link."""
        if source is self._last_sender:
            return
        self._last_sender = source
        if source in self._senders or not (source.system in self._known or not self._known):
            return
        if len(self._senders) >= MAX_SENDERS:  # one that still sends is remembered again
            del self._senders[next(iter(self._senders))]
        self._senders[source] = None

    def leads_to(self, source: Source) -> bool:
        """Whether a sender is reached by this link."""
        return source in self._senders

    def reset(self) -> None:
        """Another peer is at the far end, or the same one again."""
        self.decoder.reset()
        self.greeted = False
        self.asked = False
        self._last_sender = None
        self._senders.clear()

    def match_version(self) -> None:
        """Use the MAVLink version of the far end."""
        self.own.version1 = self.override.version1 = self.decoder.only_v1


def _nothing_waits() -> bool:
    return False

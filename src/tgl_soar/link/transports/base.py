"""What every kind of link is: the protocol, what it counts, its error."""

from __future__ import annotations

import errno
import socket
from dataclasses import dataclass
from typing import Final, Protocol

# Another program ends, a network or whoever knows its names comes up.
_PASSING: Final = (
    errno.EADDRINUSE, errno.EADDRNOTAVAIL, errno.ENODEV, errno.ENETDOWN, errno.ENETUNREACH,
    errno.EHOSTUNREACH, socket.EAI_AGAIN,
)  # fmt: skip
MAX_DATAGRAMS: Final = 64  # in one call: the tick must not wait for a flood


class LinkError(Exception):
    """A link that cannot be opened; the message names it and the way out."""


class LinkNotReadyError(LinkError):
    """One that may be opened later as it is: what it leads to is missing, busy or not up yet."""


def passes(error: Exception) -> bool:
    """Whether what keeps a socket from being opened may pass without a change of its name."""
    return getattr(error, "errno", None) in _PASSING


def not_opened(error: Exception, words: str) -> LinkError:
    """What is raised of a link's socket that cannot be opened."""
    return LinkNotReadyError(words) if passes(error) else LinkError(words)


@dataclass(slots=True)
class LinkCounters:
    """What a link carried."""

    bytes_in: int = 0
    bytes_out: int = 0
    dropped_out: int = 0  # frames that could not be sent
    left_out: int = 0  # of these, commands that would have come too late
    strangers: int = 0  # datagrams of somebody who is not the peer
    reconnects: int = 0


class Transport(Protocol):
    """A link."""

    name: str
    is_stream: bool  # frames may be cut anywhere
    counters: LinkCounters
    generation: int  # grows when another peer is at the far end, or the same one again

    def fileno(self) -> int:
        """To wait on; -1 while there is nothing to wait on."""
        ...

    def receive(self, now_s: float, most: int = MAX_DATAGRAMS) -> list[bytes]:
        """What was received: at most so many whole datagrams, or one read of a stream."""
        ...

    def hold(self, now_s: float) -> None:
        """A received frame was accepted: the peer at the far end keeps its place."""
        ...

    def send(self, data: bytes) -> bool:
        """Send one frame; False if it was not sent."""
        ...

    def send_command(self, data: bytes) -> bool:
        """Send one frame if that is possible at once; False if it is not."""
        ...

    def clear_for_release(self) -> bool:
        """Discard what would delay a release; whether a frame may have been cut."""
        ...

    def close(self) -> None:
        """Close it."""
        ...

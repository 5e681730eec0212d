"""The autopilot's links: what is queued on each, what is known of its other end, who is routed.

A link to a ground station streams slowly by itself; one to a companion is silent until asked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.routing import LinkId, RoutedFrame, Router

COMPONENT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1
_DATAGRAM_BYTES: Final = 1200


@dataclass
class MessageStream:
    """A message that goes out again and again."""

    interval_steps: int
    due_at: int  # the step from which it may go out
    sent_sequence: int = 0  # of the sample that went out last


@dataclass
class VehicleLink:
    """One link, with what waits on it."""

    codec: mavlink.MAVLink
    ground: bool
    streams: dict[int, MessageStream] = field(default_factory=dict)  # by message id
    parameters_to_send: deque[int] = field(default_factory=deque)  # of a list, by index
    outbox: list[bytes] = field(default_factory=list)
    timesync_answer_ns: int = 0  # ts1 of the latest answer to our TIMESYNC; 0: none
    heartbeats: int = 0  # received on it, of anybody

    def post(self, message: Any) -> None:
        """Queue a message of this autopilot."""
        self.outbox.append(message.pack(self.codec))
        self.codec.seq = (self.codec.seq + 1) % 256

    def clear(self) -> None:
        """Forget what was asked for and what is queued."""
        self.streams.clear()
        self.parameters_to_send.clear()
        self.outbox.clear()

    def take_datagrams(self) -> list[bytes]:
        """What is queued, as datagrams of whole frames; the queue is emptied."""
        datagrams: list[bytes] = []
        pending = b""
        for raw in self.outbox:
            if pending and len(pending) + len(raw) > _DATAGRAM_BYTES:
                datagrams.append(pending)
                pending = b""
            pending += raw
        if pending:
            datagrams.append(pending)
        self.outbox.clear()
        return datagrams


class VehicleLinks:
    """All links, by number, and the ways between them."""

    def __init__(self) -> None:
        self._links: dict[LinkId, VehicleLink] = {}
        self._router = Router()

    def __iter__(self) -> Iterator[VehicleLink]:
        return iter(self._links.values())

    def get(self, number: LinkId) -> VehicleLink | None:
        """The link of a number; None where there is none."""
        return self._links.get(number)

    def add(self, number: LinkId, system: int, *, ground: bool) -> VehicleLink:
        """A link on which this autopilot speaks as a system."""
        link = VehicleLink(mavlink.MAVLink(None, system, COMPONENT), ground)
        self._links[number] = link
        self._router.add(number)
        return link

    def remove(self, number: LinkId) -> None:
        """A link that is gone."""
        self._links.pop(number, None)
        self._router.forget(number)

    def restart(self) -> None:
        """The links stay; who is behind them, what they asked for and what is queued does not."""
        self._router = Router()
        for number, link in self._links.items():
            self._router.add(number)
            link.clear()

    def pass_on(self, number: LinkId, frame: RoutedFrame, own_system: int) -> bool:
        """Queue a frame on the links that it is meant for; whether it is for the autopilot."""
        onward, local = self._router.route(number, frame, own_system, COMPONENT)
        for other in onward:
            self._links[other].outbox.append(frame.raw)
        return local

    def routes_to(self, system: int, component: int) -> tuple[LinkId, ...]:
        """The links on which frames of an identity have arrived."""
        return self._router.routes_to(system, component)

    def broadcast(self, message: Any, *, ground_only: bool = False) -> None:
        """Queue a message of this autopilot on every link."""
        for link in self:
            if link.ground or not ground_only:
                link.post(message)

    def take_datagrams(self, links: Container[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What is queued on some links (or all); their queues are emptied."""
        return [
            (number, datagram)
            for number, link in self._links.items()
            if links is None or number in links
            for datagram in link.take_datagrams()
        ]

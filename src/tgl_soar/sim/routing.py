"""MAVLink frames in datagrams, and the way from link to link that an ArduPilot gives them.

An autopilot is also a router.  It learns on which link each (system, component) sends,
sends a targeted frame on to the links of its target, a broadcast to every other link, and
executes what is meant for itself.  One trap was measured on the real firmware and is kept: a
frame for this vehicle's system but for a component that it does not know yet is executed by the
autopilot itself.

Frames are sent on byte by byte as they came, so that sequence numbers and signatures stay
those of the sender.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

LinkId = int

MAX_ROUTES: Final = 64  # identities remembered; later ones are served but not routed to
_MARKER_V1: Final = 0xFE
_MARKER_V2: Final = 0xFD
_SIGNED: Final = 0x01
_SIGNATURE_BYTES: Final = 13
_MOST_FALSE_STARTS: Final = 32  # in one datagram: beyond it, it is not worth the time

# Between neighbours only: clocks and radio quality say nothing about a third party.
_NEVER_FORWARDED: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_RADIO,
        mavlink.MAVLINK_MSG_ID_RADIO_STATUS,
    }
)


class RoutedFrame(NamedTuple):
    """One whole frame with a good checksum."""

    raw: bytes
    message: Any  # pymavlink's message object
    system: int
    component: int


def split_frames(codec: mavlink.MAVLink, data: bytes) -> tuple[list[RoutedFrame], int]:
    """The good frames of one datagram, and how many bytes belonged to none.

    A frame never spans two datagrams.  Signatures are carried, not checked.
    """
    frames: list[RoutedFrame] = []
    lost = false_starts = 0
    at, end = 0, len(data)
    while at < end and false_starts < _MOST_FALSE_STARTS:
        length = _frame_length(data, at)
        frame = None
        if length and at + length <= end:
            frame = _decode(codec, data[at : at + length])
            false_starts += frame is None
        if frame is None:
            at += 1
            lost += 1
        else:
            frames.append(frame)
            at += length
    return frames, lost + end - at


def _frame_length(data: bytes, at: int) -> int:
    """Length of the frame of a known message that may begin at a byte; 0: none can."""
    marker = data[at]
    left = len(data) - at
    if marker == _MARKER_V2 and left >= 12:
        flags = data[at + 2]
        message_id = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
        if flags & ~_SIGNED or message_id not in mavlink.mavlink_map:
            return 0
        return 12 + data[at + 1] + (_SIGNATURE_BYTES if flags & _SIGNED else 0)
    if marker == _MARKER_V1 and left >= 8:
        return 8 + data[at + 1] if data[at + 5] in mavlink.mavlink_map else 0
    return 0


def _decode(codec: mavlink.MAVLink, raw: bytes) -> RoutedFrame | None:
    try:
        message = codec.decode(bytearray(raw))
    except Exception:  # whatever the bytes provoke in the decoder, they are no message
        return None
    return RoutedFrame(raw, message, message.get_srcSystem(), message.get_srcComponent())


class Router:
    """Who sends on which link."""

    def __init__(self) -> None:
        self.links: list[LinkId] = []
        self._routes: dict[tuple[int, int], list[LinkId]] = {}

    def add(self, link: LinkId) -> None:
        """A new link."""
        if link not in self.links:
            self.links.append(link)

    def forget(self, link: LinkId) -> None:
        """A link is gone, and every way that led over it."""
        if link in self.links:
            self.links.remove(link)
        for identity, links in list(self._routes.items()):
            if link in links:
                links.remove(link)
            if not links:
                del self._routes[identity]

    def routes_to(self, system: int, component: int) -> tuple[LinkId, ...]:
        """The links on which frames of an identity have arrived."""
        return tuple(self._routes.get((system, component), ()))

    def route(
        self, link: LinkId, frame: RoutedFrame, own_system: int, own_component: int
    ) -> tuple[list[LinkId], bool]:
        """Where a frame goes: the links to send it on to, and whether it is for us."""
        message = frame.message
        message_id = message.get_msgId()
        self._learn(link, frame.system, frame.component)
        if message_id in _NEVER_FORWARDED:
            return [], True
        if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            sources = self._routes.get((frame.system, frame.component), ())
            return [other for other in self.links if other != link and other not in sources], True

        to_system = int(getattr(message, "target_system", getattr(message, "target", 0)))
        to_component = int(getattr(message, "target_component", 0))
        if to_system == 0:
            return [other for other in self.links if other != link], True
        for_our_system = to_system == own_system
        if for_our_system and to_component == own_component:
            return [], True
        onward = self._links_towards(link, to_system, to_component, own_system)
        # Not found anywhere: the trap described above.
        return onward, for_our_system and (to_component == 0 or not onward)

    def _learn(self, link: LinkId, system: int, component: int) -> None:
        if system == 0:
            return
        links = self._routes.get((system, component))
        if links is None:
            if len(self._routes) < MAX_ROUTES:
                self._routes[system, component] = [link]
        elif link not in links:
            links.append(link)

    def _links_towards(
        self, link: LinkId, to_system: int, to_component: int, own_system: int
    ) -> list[LinkId]:
        onward: list[LinkId] = []
        for (system, component), links in self._routes.items():
            if system != to_system:
                continue
            # Another vehicle sorts out its components by itself.
            if to_component not in (0, component) and system == own_system:
                continue
            onward += [other for other in links if other != link and other not in onward]
        return onward

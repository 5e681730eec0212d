"""Links by their names.  Nothing here blocks, and nothing knows what the bytes mean.

    udp:HOST:PORT          listen there; the first sender of MAVLink is the peer
    udpout:HOST:PORT       send first
    tcp:HOST:PORT          connect
    serial:/dev/ttyX:BAUD  a serial line (serial:/dev/ttyX alone: 921600)

Each kind has its file in `transports/`.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable
from typing import Final

from tgl_soar.link.transports.addresses import host_and_port
from tgl_soar.link.transports.base import (
    MAX_DATAGRAMS,
    LinkCounters,
    LinkError,
    LinkNotReadyError,
    Transport,
)
from tgl_soar.link.transports.serial_line import SerialLink, device_and_baud
from tgl_soar.link.transports.tcp import TcpLink
from tgl_soar.link.transports.udp import UdpListener, UdpSpeaker

__all__ = (
    "FORMS",
    "MAX_DATAGRAMS",
    "LinkCounters",
    "LinkError",
    "LinkNotReadyError",
    "Transport",
    "UdpListener",
    "baud_of",
    "check_link",
    "is_open",
    "open_link",
)

FORMS: Final = "udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:/dev/ttyX:BAUD"


def open_link(text: str, is_frame: Callable[[bytes], bool], now_s: float = 0.0) -> Transport:
    """Open the link that a string names.

    `is_frame`: whether a datagram begins with a MAVLink frame.  Errors: `LinkError`, and of these
    `LinkNotReadyError` for what is no mistake in the string.
    """
    kind, _, rest = text.partition(":")
    if kind in ("udp", "udpin"):
        return UdpListener(text, *host_and_port(text, rest), is_frame)
    if kind == "udpout":
        return UdpSpeaker(text, *host_and_port(text, rest))
    if kind == "tcp":
        return TcpLink(text, *host_and_port(text, rest), now_s)
    if kind == "serial":
        return SerialLink(text, *device_and_baud(text, rest), now_s)
    raise LinkError(f"link {text!r}: unknown kind {kind!r}; give {FORMS}")


def check_link(text: str) -> None:
    """Whether a string has the form of a link; nothing is opened.  Errors: `LinkError`."""
    kind, _, rest = text.partition(":")
    if kind == "serial":
        device_and_baud(text, rest)
    elif kind in ("udp", "udpin", "udpout", "tcp"):
        host_and_port(text, rest)
    else:
        raise LinkError(f"link {text!r}: unknown kind {kind!r}; give {FORMS}")


def is_open(text: str) -> bool:
    """Whether others than this computer can reach a link of this form."""
    kind, _, rest = text.partition(":")
    if kind == "serial":
        return False
    host = rest.rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        found = {str(entry[4][0]) for entry in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return True
    return not all(ipaddress.ip_address(a.partition("%")[0]).is_loopback for a in found)


def baud_of(text: str) -> int | None:
    """The rate of a serial line of this form; None of another link.  Errors: `LinkError`."""
    kind, _, rest = text.partition(":")
    return device_and_baud(text, rest)[1] if kind == "serial" else None

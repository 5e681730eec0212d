"""What stands behind the kind in the name of a link: HOST:PORT."""

from __future__ import annotations

import socket

from tgl_soar.link.transports.base import LinkError, not_opened


def host_and_port(text: str, rest: str) -> tuple[str, int]:
    host, separator, port = rest.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not separator or not host or not port.isascii() or not port.isdigit():
        raise LinkError(f"link {text!r}: needs a host and a port, as in udp:127.0.0.1:14540")
    if not 1 <= int(port) <= 65535:
        raise LinkError(f"link {text!r}: port {port} is not in 1 to 65535")
    return host, int(port)


def resolved(text: str, host: str, port: int, kind: int) -> tuple[int, tuple[str, int]]:
    """(address family, address) of a host's name."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
    except (OSError, UnicodeError) as error:  # a label that is empty or too long is no name
        why = getattr(error, "strerror", None) or error
        words = f"link {text!r}: host {host!r} is not known: {why}"
        raise not_opened(error, words) from None
    return family, (str(address[0]), port)

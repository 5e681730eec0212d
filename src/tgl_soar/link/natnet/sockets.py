"""The sockets of a NatNet client: datagrams in and out.  Nothing here blocks.

A unicast server streams to the very port that it is asked from: one socket.  A multicast server
streams to a group, which is joined on the interface that leads to the cameras: a second one.
"""

from __future__ import annotations

import socket
from typing import Final

from tgl_soar.link.natnet.layout import MAX_DATAGRAM_BYTES
from tgl_soar.link.transports.base import passes

MAX_DATAGRAMS: Final = 16  # at once and of one socket: a flood must have an end
RECEIVE_BUFFER_BYTES: Final = 1 << 20
DISCOVERY: Final = "255.255.255.255"  # whom to ask who is there

Address = tuple[str, int]


class NatNetError(Exception):
    """A server or an interface that cannot be reached; the message names the key to change."""


class NatNetNotReadyError(NatNetError):
    """One that may be reached later with the same keys: its network is not up yet, or busy."""


class NatNetSockets:
    """One server's command port, and where it streams."""

    def __init__(
        self, server: str, command_port: int, *, interface: str = "", group: str = "", port: int = 0
    ) -> None:
        """`group` and `port`: of a multicast stream; "": unicast.  Errors: `NatNetError`."""
        self.unsent = 0
        self._server = server
        self._to = (resolved(server), command_port)
        self._interface = interface
        self._group, self._port = group, port
        self._commands = _bound(interface, 0, "mocap.interface")
        self._commands.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._stream: socket.socket | None = None
        if group:
            try:
                self._stream = self._joined(group, port)
            except NatNetError:
                self._commands.close()
                raise

    @property
    def server(self) -> str:
        """Its address; "": not known, whoever answers."""
        return "" if self._to[0] == DISCOVERY else self._to[0]

    def filenos(self) -> list[int]:
        """To wait on."""
        return [s.fileno() for s in (self._commands, self._stream) if s is not None]

    def receive(self, most: int = MAX_DATAGRAMS) -> list[tuple[bytes, Address]]:
        """The datagrams that have come, with their senders; at most so many of each socket."""
        received: list[tuple[bytes, Address]] = []
        for source in (self._commands, self._stream):
            for _ in range(most if source is not None else 0):
                try:
                    assert source is not None
                    data, sender = source.recvfrom(MAX_DATAGRAM_BYTES)
                except ConnectionRefusedError:
                    continue  # the answer to something sent before the server was there
                except OSError:
                    break
                received.append((data, (sender[0], sender[1])))
        return received

    def send(self, data: bytes) -> None:
        """To the server's command port; what cannot be sent is asked again anyway."""
        try:
            self._commands.sendto(data, self._to)
        except OSError:
            self.unsent += 1

    def follow(self, group: str, port: int) -> None:
        """Listen where a multicast server says that it streams; nothing changes if we do."""
        if self._stream is None or (group, port) == (self._group, self._port):
            return
        self._group, self._port = group, port
        try:
            stream = self._joined(group, port)
        except NatNetError:
            return  # the silence is reported
        self._stream.close()
        self._stream = stream

    def close(self) -> None:
        """Give all ports back."""
        self._commands.close()
        if self._stream is not None:
            self._stream.close()

    def _joined(self, group: str, port: int) -> socket.socket:
        # Bound to the group's own address, other groups' datagrams on this port stay away.
        stream = _bound(group, port, "mocap.group, mocap.data_port", shared=True)
        member = socket.inet_aton(group) + socket.inet_aton(self._interface or "0.0.0.0")
        try:
            stream.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            stream.close()
            where = f"interface {self._interface}" if self._interface else "any interface"
            words = (
                f"mocap.group {group} cannot be joined on {where}: {error.strerror};"
                " give mocap.interface the address that this computer has on the cameras' network"
            )
            raise _not_reached(error, words) from None
        return stream


def resolved(server: str) -> str:
    """The IPv4 address of a server's name.  Errors: `NatNetError`."""
    if server == "discover":
        return DISCOVERY
    try:
        return socket.gethostbyname(server)
    except (OSError, UnicodeError) as error:  # a label that is empty or too long is no name
        why = getattr(error, "strerror", None) or error
        words = f"mocap.server {server!r} is not known: {why}"
        raise _not_reached(error, words) from None


def _bound(host: str, port: int, keys: str, *, shared: bool = False) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    if shared:  # other programs on this computer may listen, too
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except (OSError, OverflowError) as error:
        made.close()
        words = f"{keys} {host or '0.0.0.0'}:{port}: cannot listen: {error}"
        raise _not_reached(error, words) from None
    return made


def _not_reached(error: Exception, words: str) -> NatNetError:
    return NatNetNotReadyError(words) if passes(error) else NatNetError(words)

"""The simulated Pixhawk's two UDP ports: one towards ground stations, one towards a companion.

As the firmwares' simulators do, each port sends to where a peer listens (14550, 14540) from a
port of its own (18570, 14580), and answers whoever speaks to that port first.  Every remote
address is one link of the autopilot.
"""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tgl_soar.sim.routing import LinkId

Address = tuple[str, int]

MAX_STRANGERS: Final = 16  # links made for those who speak first
_LARGEST: Final = 4096  # bytes of a datagram that are looked at: several frames at most
BURST: Final = 50  # datagrams taken from one port before time goes on


class PortError(RuntimeError):
    """A port that cannot be had; the message says which, and which option changes it."""


@dataclass
class Peer:
    """The other end of a link."""

    link: LinkId
    port: Port
    address: Address
    configured: bool
    datagrams: int = 0  # received from it


class Port:
    """One bound UDP socket."""

    def __init__(self, name: str, option: str, local: Address, *, ground: bool) -> None:
        self.name, self.option, self.ground = name, option, ground
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind(local)
        except (OSError, OverflowError) as error:
            self.socket.close()
            why = str(error)
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                why = "the port is in use: end the other process, or choose another port"
            raise PortError(f"{option} {local[0]}:{local[1]}: {why} with {option}") from None
        self.socket.setblocking(False)
        self.local: Address = self.socket.getsockname()


def resolved(option: str, address: Address) -> Address:
    """The address with a number in place of a name.  Errors: `PortError`."""
    try:
        return socket.gethostbyname(address[0]), address[1]
    except OSError as error:
        raise PortError(f"{option} {address[0]}:{address[1]}: {error.strerror}") from None


class Ports:
    """Both ports and all peers."""

    def __init__(self, ground: Port, companion: Port) -> None:
        self.ground, self.companion = ground, companion
        self.peers: dict[LinkId, Peer] = {}
        self._by_address: dict[tuple[Port, Address], Peer] = {}
        self._next_link = 1
        self._strangers = 0

    @property
    def strangers(self) -> int:
        """How many spoke first so far, those since forgotten included."""
        return self._strangers

    def add(self, port: Port, address: Address, *, configured: bool) -> Peer:
        """A peer, with a link of its own."""
        known = self._by_address.get((port, address))
        if known is not None:
            known.configured = known.configured or configured
            return known
        peer = Peer(self._next_link, port, address, configured)
        self._next_link += 1
        self._strangers += not configured
        self.peers[peer.link] = peer
        self._by_address[port, address] = peer
        return peer

    def surplus(self) -> Peer | None:
        """Of too many strangers the one that sent least (the oldest of several); forgotten."""
        strangers = [peer for peer in self.peers.values() if not peer.configured]
        if len(strangers) <= MAX_STRANGERS:
            return None
        least = min(strangers, key=lambda peer: peer.datagrams)
        del self.peers[least.link]
        del self._by_address[least.port, least.address]
        return least

    def send(self, link: LinkId, data: bytes) -> None:
        """Send a datagram; one that cannot be sent is lost, as on a radio."""
        peer = self.peers.get(link)
        if peer is None:
            return
        try:
            peer.port.socket.sendto(data, peer.address)
        except OSError:
            return

    def receive(self, port: Port) -> tuple[Peer, bytes, bool] | None:
        """The next datagram of a port with its sender, and whether the sender is new."""
        try:
            data, address = port.socket.recvfrom(_LARGEST)
        except OSError:
            # Nothing there, or the network's answer to something sent to nobody.
            return None
        peer = self._by_address.get((port, address))
        new = peer is None
        if peer is None:
            peer = self.add(port, address, configured=False)
        peer.datagrams += 1
        return peer, data, new

    def wait(self, seconds: float, *ports: Port) -> bool:
        """Wait until one of the ports has something; False: none had."""
        ready, _, _ = select.select([port.socket for port in ports], [], [], max(0.0, seconds))
        return bool(ready)

    def close(self) -> None:
        """Give both ports back."""
        self.ground.socket.close()
        self.companion.socket.close()


def open_ports(
    ground_local: Address,
    ground_peers: Sequence[Address],
    companion_local: Address,
    companion_peer: Address,
) -> Ports:
    """Both ports, with those who are known from the first.  Errors: `PortError`."""
    ground = Port("ground", "--gcs-local", ground_local, ground=True)
    try:
        companion = Port("companion", "--companion-local", companion_local, ground=False)
    except PortError:
        ground.socket.close()
        raise
    ports = Ports(ground, companion)
    try:
        _add_peer(ports, companion, "--companion", companion_peer)
        for address in ground_peers:
            _add_peer(ports, ground, "--gcs", address)
    except PortError:
        ports.close()
        raise
    return ports


def _add_peer(ports: Ports, port: Port, option: str, address: Address) -> None:
    host, number = resolved(option, address)
    if port.local[0].startswith("127.") and not host.startswith("127."):
        raise PortError(
            f"{option} {host}:{number} is another machine, and {port.option}"
            f" {port.local[0]}:{port.local[1]} serves this one only:"
            f" add {port.option} 0.0.0.0:{port.local[1]}"
        )
    ports.add(port, (host, number), configured=True)

"""OptiTrack as a site file names it: the sockets and the client of its `[mocap]` table.

Whoever reads it waits on `filenos`, hands `receive` on to the client and sends what that asks.
"""

from __future__ import annotations

from msgspec.structs import replace

from tgl_soar.config.files import ConfigError
from tgl_soar.config.site import Mocap, Site
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.server import MulticastStream
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.link.natnet.sockets import MAX_DATAGRAMS, Address, NatNetSockets
from tgl_soar.link.optitrack import Optitrack


class MocapFeed:
    """A client with its sockets."""

    def __init__(self, mocap: Mocap, *, lockstep: bool = False) -> None:
        """Errors: `NatNetError`."""
        unicast = mocap.stream == "unicast"
        group = "" if unicast else mocap.group
        self._unicast = unicast
        self._sockets = NatNetSockets(
            mocap.server,
            mocap.command_port,
            interface=mocap.interface,
            group=group,
            port=mocap.data_port,
        )
        self.client = Optitrack(
            OptitrackSettings(
                server=self._sockets.server,
                body=mocap.body,
                unicast=unicast,
                hall=mocap.hall(),
                noise_m=mocap.noise_m,
                max_error_m=mocap.max_error_m,
                max_speed_mps=mocap.max_speed_mps,
                max_age_s=mocap.max_age_s,
                max_rate_hz=mocap.max_rate_hz,
            ),
            lockstep=lockstep,
        )

    def filenos(self) -> list[int]:
        """To wait on."""
        return self._sockets.filenos()

    def receive(self, most: int = MAX_DATAGRAMS) -> list[tuple[bytes, Address]]:
        """The datagrams that have come, with their senders; at most so many of each socket."""
        return self._sockets.receive(most)

    def send(self, data: bytes) -> None:
        """A request of the client's."""
        self._sockets.send(data)

    def follow(self, stream: MulticastStream) -> None:
        """Listen where the server streams."""
        self._sockets.follow(stream.group, stream.port)

    def close(self) -> None:
        """Say goodbye to a server that streams to us alone, and give the ports back."""
        if self._unicast:
            self._sockets.send(layout.disconnect())
        self._sockets.close()


def server_address(option: str, server: str) -> tuple[str, int | None]:
    """HOST or HOST:PORT.  Errors: `ConfigError`."""
    host, colon, port = server.partition(":")
    if not host or (colon and not (port.isdecimal() and 1 <= int(port) <= 65535)):
        raise ConfigError(f"{option} {server!r}: write HOST or HOST:PORT")
    return host, int(port) if colon else None


def from_server(site: Site, server: str) -> Site:
    """The site with the poses of another server, HOST or HOST:PORT.  Errors: `ConfigError`."""
    host, port = server_address("--mocap-server", server)
    if site.mocap is None:
        raise ConfigError(f"--mocap-server: site {site.site.name} has no [mocap] table")
    command_port = port or site.mocap.command_port
    return replace(site, mocap=replace(site.mocap, server=host, command_port=command_port))

"""Datagrams on their way between the bridge's ports and what is simulated.

Faults of the radio link between autopilot and companion act here, in both directions; they leave
lockstep's questions and answers alone.  Poses of a motion capture are traffic as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.geometry import ned_from_soaring
from tgl_soar.sim.bridge.simulated import Simulated
from tgl_soar.sim.motive import MotiveServer
from tgl_soar.sim.ports import BURST, Peer, Port, Ports
from tgl_soar.sim.routing import LinkId
from tgl_soar.sim.sensors import measure_attitude

STRANGERS_NAMED: Final = 20  # on the console; the rest of a flood is not
TIMESYNC_ID: Final = mavlink.MAVLINK_MSG_ID_TIMESYNC.to_bytes(3, "little")


class Traffic:
    """Carries datagrams; every peer of the ports is a link of the simulation."""

    def __init__(self, simulation: Simulated, ports: Ports, motive: MotiveServer | None) -> None:
        self.simulation, self.ports, self.motive = simulation, ports, motive
        self.when_forgotten: Callable[[LinkId], None] = lambda _link: None
        self._outbound = simulation.injection.wire("down")  # to companions
        self._inbound = simulation.injection.wire("up")
        for peer in ports.peers.values():
            simulation.add_link(peer.link, ground=peer.port.ground)

    @property
    def is_disturbed(self) -> bool:
        """Whether faults act on what is sent to companions."""
        return self._outbound is not None

    def report(self, text: str) -> None:
        """Print something on the console, with the simulated time."""
        print(f"[{self.simulation.time_s:9.3f} s] {text}", flush=True)

    def is_companion(self, link: LinkId) -> bool:
        """Whether a link leads to a companion, and not to a ground station."""
        return not self.ports.peers[link].port.ground

    def wait(self, seconds: float) -> bool:
        """Wait until something arrives at any port; False: nothing did."""
        waited_for = [self.ports.ground, self.ports.companion]
        if self.motive is not None:
            waited_for.append(self.motive.port)
        return self.ports.wait(seconds, *waited_for)

    def serve(self) -> None:
        """Take what has arrived at all ports."""
        self.serve_mocap()
        self.drain(self.ports.companion)
        self.drain(self.ports.ground)

    def serve_mocap(self) -> None:
        """Answer the clients of the motion capture."""
        if self.motive is not None:
            self.motive.serve(self.simulation.time_s)

    def deliver(self) -> None:
        """Hand on what faults have delayed and is due now."""
        if self._inbound is not None:
            for link, data in self._inbound.arrived(self.simulation.time_s):
                self.simulation.receive(link, data)

    def expose(self) -> None:
        """The hall's cameras see the aircraft as it is now."""
        if self.motive is None:
            return
        world = self.simulation.world
        state, none = world.state, (0.0, 0.0, 0.0)
        place = ned_from_soaring(world.frame, state.x_m, state.y_m, state.z_m)
        q = measure_attitude(world.frame, state, 1, world.time_s, none, none)
        self.motive.step(world.steps, world.time_s, place, (q.qw, q.qx, q.qy, q.qz))

    def flush(self, links: Sequence[LinkId] | None = None, *, corrupted: bool = True) -> None:
        """Send what is due on some links, or on all; companions get it as faults leave it."""
        outbound, now = self._outbound, self.simulation.time_s
        for link, data in self.simulation.take_datagrams(links):
            if outbound is not None and corrupted and self.is_companion(link):
                outbound.send(now, (link, data))
            else:
                self.ports.send(link, data)
        if outbound is not None:
            for link, data in outbound.arrived(now):
                self.ports.send(link, data)

    def drain(self, port: Port) -> None:
        """Take what has arrived at a port, but no flood at once."""
        for _ in range(BURST):
            if not self.take_one(port):
                return

    def take_one(self, port: Port) -> bool:
        """Take the next datagram of a port; False: there is none."""
        received = self.ports.receive(port)
        if received is None:
            return False
        peer, data, new = received
        if new:
            self._welcome(peer)
        if self._inbound is None or port.ground or _answers_barrier(data):
            self.simulation.receive(peer.link, data)
        else:
            self._inbound.send(self.simulation.time_s, (peer.link, data))
            self.deliver()
        return True

    def _welcome(self, peer: Peer) -> None:
        """A link for somebody who sent first; of too many one is forgotten."""
        self.simulation.add_link(peer.link, ground=peer.port.ground)
        if self.ports.strangers <= STRANGERS_NAMED:
            self.report(f"{name_of(peer)} spoke first")
        surplus = self.ports.surplus()
        if surplus is not None:
            self.simulation.remove_link(surplus.link)
            self.when_forgotten(surplus.link)


def name_of(peer: Peer) -> str:
    """A peer, as the console calls it."""
    role = "ground station" if peer.port.ground else "companion"
    return f"the {role} at {peer.address[0]}:{peer.address[1]}"


def _answers_barrier(data: bytes) -> bool:
    """Whether a datagram is one TIMESYNC: faults leave lockstep alone."""
    return data[:1] == b"\xfd" and data[7:10] == TIMESYNC_ID

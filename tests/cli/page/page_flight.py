"""A simulated flight in lockstep and the page's server beside it, for the tests of this folder.

Simulated time goes on only as fast as this computer lets it, so that nothing of the flight depends
on how busy it is.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from free_ports import free_port

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim.simulation import Options, Simulation

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
COMPANION, GROUND = 1, 2
READY, SOARING, RELEASED = 2, 4, 7
SLICE_S = 0.02  # of simulated time, between two looks at the link
TOKEN = "a-token-for-the-tests"
PATIENCE_S = 90.0  # for what happens at once, were the machine not busy with other things


def frames_of(datagram: bytes) -> Iterator[bytes]:
    """The unsigned MAVLink 2 frames in it."""
    while datagram:
        size = 12 + datagram[1]
        yield datagram[:size]
        datagram = datagram[size:]


class Flown:
    """Simulation and module, stepped by hand; frames of the ground link come and go as bytes."""

    def __init__(self, plane: Path = AIRFRAME) -> None:
        airframe, site = load_airframe(plane), load_site(SITE)
        self.simulation = Simulation(airframe, site, Options(), SITE.parent)
        self.simulation.add_link(COMPANION, ground=False)
        self.simulation.add_link(GROUND, ground=True)
        self.simulation.pixhawk.set_pace(COMPANION)
        self._setup = setup_from(airframe, site, load_parameters(airframe, plane, site, SITE))
        self.onboard = Onboard(self._setup, self._send, 0.0, ModuleOptions(lockstep=True, start=1))
        self.altered: Callable[[bytes], bytes] = bytes  # what a bad link makes of a frame

    def _send(self, frame: bytes) -> bool:
        self.simulation.receive(COMPANION, frame)
        return True

    def restart_module(self) -> None:
        """As its watchdog does."""
        self.onboard = Onboard(self._setup, self._send, 0.0, ModuleOptions(lockstep=True, start=2))

    def run(self, seconds: float) -> list[bytes]:
        """What the ground is sent in the meantime."""
        simulation = self.simulation
        received: list[bytes] = []
        for _ in range(round(seconds * simulation.pixhawk.step_hz)):
            simulation.step()
            self.onboard.idle(simulation.time_s)
            for link, data in simulation.pixhawk.take_datagrams():
                if link == COMPANION:
                    self.onboard.event(bytes(data), simulation.time_s)
                else:
                    received.append(b"".join(map(self.altered, frames_of(bytes(data)))))
        return received

    def receive(self, data: bytes) -> None:
        """From the ground."""
        self.simulation.receive(GROUND, data)

    @property
    def mode(self) -> int:
        return -1 if self.onboard.output is None else self.onboard.output.mode

    @property
    def place(self) -> tuple[float, float]:
        truth = self.simulation.world.truth
        return truth.x_m, truth.z_m

    def value(self, name: str) -> float:
        return self.onboard.parameters.values[name]


class Flying:
    """A flight that goes on by itself, in a thread, on a UDP socket."""

    def __init__(self, plane: Path = AIRFRAME) -> None:
        self.flown = Flown(plane)
        self.lock = threading.Lock()
        self.is_cut = False  # the link: nothing comes and nothing goes
        self.received: list[bytes] = []  # from the ground, since it was looked at
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.page = ("127.0.0.1", 0)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)

    def start(self, page_port: int) -> None:
        self.page = ("127.0.0.1", page_port)
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join(PATIENCE_S)
        self._socket.close()

    def _fly(self) -> None:
        due_s = time.monotonic()
        while not self._ended.is_set():
            with self.lock:
                for data in self.flown.run(SLICE_S):
                    if not self.is_cut:
                        self._socket.sendto(data, self.page)
                self._listen()
            due_s = max(due_s + SLICE_S, time.monotonic() - SLICE_S)
            time.sleep(max(0.002, due_s - time.monotonic()))

    def _listen(self) -> None:
        while True:
            try:
                data = self._socket.recv(2048)
            except (BlockingIOError, ConnectionRefusedError):
                return
            if not self.is_cut:
                self.received.append(data)
                self.flown.receive(data)

    def until(self, condition: Callable[[Flown], Any], patience_s: float = PATIENCE_S) -> None:
        """Wait for something of the flight."""
        ends_s = time.monotonic() + patience_s
        while time.monotonic() < ends_s:
            with self.lock:
                if condition(self.flown):
                    return
            time.sleep(0.02)
        raise AssertionError("it did not come to that")


class Served:
    """The page's server, in a thread of this process."""

    def __init__(self, desk: Any, host: str = "127.0.0.1") -> None:
        import uvicorn

        from tgl_soar.cli.page.command import config_of
        from tgl_soar.cli.page.server import Access, app_of

        self.desk = desk
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._server = uvicorn.Server(config_of(app_of(desk, Access(TOKEN, host))))
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._listener]}, daemon=True
        )
        self._thread.start()
        ends_s = time.monotonic() + PATIENCE_S
        while not self._server.started:
            assert time.monotonic() < ends_s
            time.sleep(0.01)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/#token={TOKEN}"

    def end(self) -> None:
        self._server.should_exit = True
        self._thread.join(PATIENCE_S)
        self._listener.close()


def desk_on(port: int, system: int = 253, plane: Path = AIRFRAME) -> Any:
    """A desk that listens on a UDP port."""
    from tgl_soar.cli.page.command import live_desk

    airframe, site = load_airframe(plane), load_site(SITE)
    link = f"udp:127.0.0.1:{port}"
    return live_desk(airframe, plane, site, SITE, link, None, system)


@contextmanager
def page_on_a_flight(plane: Path = AIRFRAME) -> Iterator[tuple[Flying, Served]]:
    """Both, with the link between them."""
    port = free_port()
    flying, served = Flying(plane), Served(desk_on(port, plane=plane))
    flying.start(port)
    try:
        yield flying, served
    finally:
        served.end()
        flying.end()

"""What a bridge asks of the thing that it carries datagrams for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from tgl_soar.sim.injection import Injection
from tgl_soar.sim.routing import LinkId
from tgl_soar.sim.world import World


class SimulatedAutopilot(Protocol):
    """What speaks for the vehicle on its links."""

    @property
    def step_hz(self) -> int:
        """Steps per second."""
        ...

    def send(self, link: LinkId, message: Any) -> None:
        """Send a message on one link."""
        ...

    def announce(self) -> None:
        """Show on every link that the vehicle is there."""
        ...

    def set_pace(self, link: LinkId) -> None:
        """Lockstep: send the attitude of every step on a link, unasked."""
        ...

    def heartbeats(self, link: LinkId) -> int:
        """How many came over a link."""
        ...

    def timesync_answer_ns(self, link: LinkId) -> int:
        """The stamp of the last TIMESYNC answered on a link; 0: none."""
        ...


class Simulated(Protocol):
    """World and autopilot, one step at a time: `Simulation`, or a real firmware in its place."""

    injection: Injection
    world: World
    crashes: int

    @property
    def pixhawk(self) -> SimulatedAutopilot:
        """What speaks for the vehicle."""
        ...

    @property
    def booted(self) -> bool:
        """Whether it speaks yet."""
        ...

    @property
    def time_s(self) -> float:
        """Simulated time."""
        ...

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station or to a companion."""
        ...

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        ...

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link."""
        ...

    def take_datagrams(self, links: Sequence[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What goes out on some links, or on all."""
        ...

    def step(self) -> None:
        """One step of everything."""
        ...

    def pass_over(self, seconds: float) -> None:
        """So long no step was made; the clock of an autopilot does not stand still for that."""
        ...

    def take_events(self) -> list[str]:
        """What the console should report, each once."""
        ...

    def summary(self) -> str:
        """What became of a companion's commands."""
        ...

    def close(self) -> None:
        """It is over."""
        ...

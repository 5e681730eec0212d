"""The loop of the flying process: wait, take in what has come, tick, show that it goes round.

All that is done between two ticks is here or called from here; `process` opens the links before
it and hands the surfaces over after it.

The link to the autopilot goes first, and its tick with it; other links are read in the time that
is left, each only so far as `link.routing` lets it between two ticks.  What else they bring waits
in the kernel, wakes nobody, and is dropped there if it is too much.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Final

from tgl_soar.link.natnet.sockets import MAX_DATAGRAMS as MAX_POSES
from tgl_soar.link.transports.base import MAX_DATAGRAMS, Transport
from tgl_soar.link.transports.udp import UdpListener
from tgl_soar.onboard import pacing, realtime
from tgl_soar.onboard.mocap import MocapFeed
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.watchdog import ProcessHeartbeat

POSES_S: Final = 0.002  # a pose takes a tenth of it: more than come between two rounds
COMPLAIN_S: Final = 5.0  # between two lines on the console about an autopilot that is not there


def run(
    onboard: Onboard,
    transports: Sequence[Transport],
    stop: Callable[[], bool],
    say: Callable[[str], None],
    *,
    timeout_s: float | None = None,
    heartbeat: ProcessHeartbeat | None = None,
    mocap: MocapFeed | None = None,
    spin_s: float | None = None,
    power_saving: bool = False,
) -> bool:
    """Fly until told to stop; False: no autopilot answered within `timeout_s`.

    `transports`: the first leads to the autopilot.  `stop` is asked in every round.  `say`: for
    words on the console.  `spin_s`: as `pacing.Waiter` takes it.  `power_saving`:
    no tick is warmed up for.
    """
    clock = realtime.clock_s
    waiter = pacing.Waiter(clock, spin_s)
    now_s = began_s = clock()
    first, pacer = transports[0], onboard.pacer
    pacer.begin(now_s)
    watch = _Watch(began_s)
    links = Links(onboard, transports, clock, mocap, heartbeat)
    while not stop():
        warm_up_s = inf if power_saving else onboard.warm_up_s
        until_s = min(onboard.clocking.wake_s(now_s), warm_up_s)
        # Asked for in every round: a server may say that it streams elsewhere, by another socket.
        poses = mocap.filenos() if mocap is not None else []
        now_s, ready = waiter.wait([*poses, *links.filenos()], until_s, pacer.expected_s)
        if now_s >= warm_up_s and not ready:
            onboard.warm_up()
            pacer.warmed_up(warm_up_s, clock())
            continue
        if mocap is not None:
            take_poses(onboard, mocap, now_s, clock)
        links.read_autopilot(ready, now_s)
        if onboard.clocking.due(now_s):
            onboard.periodic(now_s)
            pacer.done(now_s, clock())
        else:
            onboard.idle(now_s)
        links.show_heartbeat()
        links.read_others(ready, now_s)
        if watch.is_silent(onboard.session.counters.heartbeats, now_s):
            say(_why_silent(onboard, first))
        if (
            timeout_s is not None
            and now_s - began_s > timeout_s
            and not onboard.session.has_heartbeat
        ):
            say(f"no autopilot on {first.name} within {timeout_s:g} s: giving up")
            return False
    return True


def take_poses(
    onboard: Onboard, mocap: MocapFeed, now_s: float, clock: Callable[[], float]
) -> None:
    """What a tracker has sent, for `POSES_S`: a crafted datagram of 12 kB takes milliseconds to be
    refused, and no tick waits for a row of them."""
    until_s = inf if onboard.clocking.lockstep else clock() + POSES_S
    for _ in range(MAX_POSES):
        received = mocap.receive(1)
        for data, sender in received:
            onboard.positions.pose(data, sender, now_s)
        if not received or clock() >= until_s:
            return


class Links:
    """The links of one flight, read in turn; the first leads to the autopilot."""

    def __init__(
        self,
        onboard: Onboard,
        transports: Sequence[Transport],
        clock: Callable[[], float],
        mocap: MocapFeed | None = None,
        heartbeat: ProcessHeartbeat | None = None,
    ) -> None:
        self._onboard = onboard
        self._clock = clock
        self._transports = transports
        self._mocap = mocap
        self._process_heartbeat = heartbeat
        self._generations = [transport.generation for transport in transports]

    def filenos(self) -> list[int]:
        """What to wait on: no link that has had its share of this tick."""
        return [
            transport.fileno() if link == 0 or self._onboard.links.has_more_tries(link) else -1
            for link, transport in enumerate(self._transports)
        ]

    def read_autopilot(self, ready: Sequence[int], now_s: float) -> None:
        """All that has come from the autopilot, and the ticks that cannot wait for its end."""
        onboard, clock = self._onboard, self._clock
        if not self._may_have_come(0, ready):
            return
        transport = self._transports[0]
        for data in self._received(0, now_s, MAX_DATAGRAMS):
            # In lockstep a pose is sent before the attitude of its step: so it is taken first.
            if self._mocap is not None:
                take_poses(onboard, self._mocap, now_s, clock)
            if onboard.event(data, now_s):
                transport.hold(now_s)
            if onboard.clocking.overdue(clock()):  # a flood must not hold up the tick
                onboard.periodic(clock())
                self.show_heartbeat()

    def read_others(self, ready: Sequence[int], now_s: float) -> None:
        """What has come from others, as far as there is time for it."""
        for link in range(1, len(self._transports)):
            if self._may_have_come(link, ready) or self._onboard.links.is_waiting(link):
                self._read_other(link, now_s)

    def show_heartbeat(self) -> None:
        """The loop has gone round once more."""
        if self._process_heartbeat is None:
            return
        onboard, first = self._onboard, self._transports[0]
        self._process_heartbeat.show(
            onboard.has_surfaces,
            version1=onboard.decoder.only_v1,
            peer=first.peer if isinstance(first, UdpListener) else None,
            timestamp=onboard.signing.timestamp,
            key=onboard.signing.key,
        )

    def _may_have_come(self, link: int, ready: Sequence[int]) -> bool:
        """A stream also writes what waits, and what cannot be waited for is looked at."""
        transport = self._transports[link]
        fd = transport.fileno()
        return fd < 0 or fd in ready or transport.is_stream

    def _read_other(self, link: int, now_s: float) -> None:
        onboard, transport = self._onboard, self._transports[link]
        while not onboard.clocking.overdue(self._clock()) and onboard.links.may_read(link):
            data = b""
            if not onboard.links.is_waiting(link):
                received = self._received(link, now_s, 1)
                if not received:
                    return
                data = received[0]
            if onboard.event(data, now_s, link):
                transport.hold(now_s)

    def _received(self, link: int, now_s: float, most: int) -> list[bytes]:
        transport = self._transports[link]
        received = transport.receive(now_s, most)
        if transport.generation != self._generations[link]:
            self._generations[link] = transport.generation
            self._onboard.relinked(link)
        return received


class _Watch:
    """Tells, every few seconds, that no heartbeat of the autopilot comes."""

    def __init__(self, now_s: float) -> None:
        self._heartbeats = 0
        self._complain_s = now_s + COMPLAIN_S

    def is_silent(self, heartbeats: int, now_s: float) -> bool:
        if heartbeats != self._heartbeats:
            self._heartbeats = heartbeats
            self._complain_s = now_s + COMPLAIN_S
        if now_s < self._complain_s:
            return False
        self._complain_s = now_s + COMPLAIN_S
        return True


def _why_silent(onboard: Onboard, transport: Transport) -> str:
    """What to look at when no autopilot answers."""
    system = onboard.session.autopilot.system
    wanted = f"no heartbeat of system {system}, component 1 on {transport.name}"
    if onboard.session.has_heartbeat:
        return f"{wanted} for {COMPLAIN_S:g} s: it has stopped, or the link is cut"
    others = sorted(onboard.session.senders)
    if others:
        names = ", ".join(f"{s.system}:{s.component}" for s in others)
        return f"{wanted}, only of {names}: check autopilot.system_id in the airframe file"
    counters = onboard.decoder.counters
    if transport.counters.bytes_in > 0 and counters.frames == 0:
        return (
            f"{wanted}: {transport.counters.bytes_in} bytes came, none of them MAVLink:"
            " check the baud rate and the port's protocol (SERIALn_PROTOCOL = 2)"
        )
    if transport.counters.strangers > 0:
        return f"{wanted}: what came there was not MAVLink, or not of one peer"
    return f"{wanted}: nothing came. Is the autopilot on, and does it send to this port or line?"

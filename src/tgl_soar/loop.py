"""The loop of the flying process: wait, take in what has come, tick, show that it goes round.

All that is done between two ticks is here or called from here; `process` opens the links before
it and lets go after it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Final

from tgl_soar import realtime
from tgl_soar.guard import LifeSign
from tgl_soar.link.transport import Transport, UdpListener
from tgl_soar.mocap import MocapFeed
from tgl_soar.onboard import Onboard

COMPLAIN_S: Final = 5.0  # between two lines on the console about an autopilot that is not there


def run(
    onboard: Onboard,
    transports: Sequence[Transport],
    stop: Callable[[], bool],
    say: Callable[[str], None],
    *,
    timeout_s: float | None = None,
    life: LifeSign | None = None,
    mocap: MocapFeed | None = None,
    spin_s: float | None = None,
    thrifty: bool = False,
) -> bool:
    """Fly until told to stop; False: no autopilot answered within `timeout_s`.

    `transports`: the first leads to the autopilot.  `stop` is asked in every round.  `say`: for
    words on the console.  `spin_s`: as `realtime.Waiter` takes it.  `thrifty`:
    no tick is rehearsed.
    """
    clock = realtime.clock_s
    waiter = realtime.Waiter(clock, spin_s)
    now_s = began_s = clock()
    first, pacer = transports[0], onboard.pacer
    pacer.begin(now_s)
    watch = _Watch(began_s)
    generations = [transport.generation for transport in transports]
    poses = mocap.filenos() if mocap is not None else []
    while not stop():
        fds = [transport.fileno() for transport in transports]
        rehearsal_s = inf if thrifty else onboard.rehearsal_s
        until_s = min(onboard.wake_s(now_s), rehearsal_s)
        now_s, ready = waiter.wait([*poses, *fds], until_s, pacer.expected_s)
        if now_s >= rehearsal_s and not ready:
            onboard.rehearse()
            pacer.rehearsed(rehearsal_s, clock())
            continue
        if mocap is not None:
            _take_poses(onboard, mocap, now_s)
        for link, transport in enumerate(transports):
            # A stream also writes what waits, and what cannot be waited for is looked at.
            if fds[link] >= 0 and fds[link] not in ready and not transport.is_stream:
                continue
            received = transport.receive(now_s)
            if transport.generation != generations[link]:
                generations[link] = transport.generation
                onboard.relinked(link)
            for data in received:
                # In lockstep a pose is sent before the attitude of its step: so it is taken first.
                if mocap is not None:
                    _take_poses(onboard, mocap, now_s)
                onboard.event(data, now_s, link)
                if onboard.overdue(clock()):  # a flood must not hold up the tick
                    onboard.periodic(clock())
        if onboard.due(now_s):
            onboard.periodic(now_s)
            pacer.done(now_s, clock())
        else:
            onboard.idle(now_s)
        if life is not None:
            _show_life(life, onboard, first)
        if watch.is_silent(onboard.session.counters.heartbeats, now_s):
            say(_why_silent(onboard, first))
        if timeout_s is not None and now_s - began_s > timeout_s and not onboard.session.is_heard:
            say(f"no autopilot on {first.name} within {timeout_s:g} s: giving up")
            return False
    return True


def _take_poses(onboard: Onboard, mocap: MocapFeed, now_s: float) -> None:
    for data, sender in mocap.receive():
        onboard.pose(data, sender, now_s)


def _show_life(life: LifeSign, onboard: Onboard, first: Transport) -> None:
    """The loop has gone round once more."""
    life.show(
        onboard.has_surfaces,
        version1=onboard.decoder.only_v1,
        peer=first.peer if isinstance(first, UdpListener) else None,
        timestamp=onboard.signing.timestamp,
    )


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
    if onboard.session.is_heard:
        return f"{wanted} for {COMPLAIN_S:g} s: it has stopped, or the link is cut"
    heard = sorted(onboard.session.heard)
    if heard:
        names = ", ".join(f"{s.system}:{s.component}" for s in heard)
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

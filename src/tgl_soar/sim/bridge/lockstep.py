"""Lockstep: who takes part, and the question after each step whether they are through with it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.bridge.options import Pace
from tgl_soar.sim.bridge.traffic import Traffic, name_of
from tgl_soar.sim.ports import Peer
from tgl_soar.sim.routing import LinkId

BARRIER_OFFSET_NS: Final = 1_000_000_000  # so that no barrier's stamp is zero
REPEAT_S: Final = 1.0  # a barrier's request is repeated, should a datagram have been lost
GREETING_S: Final = 0.2  # between two heartbeats while participants are waited for


class BridgeError(RuntimeError):
    """The bridge cannot run; the message says why and what to do."""


class _Missed(NamedTuple):
    """One that was given up."""

    datagrams: int  # from it until it was given up, or asked again
    answer_ns: int  # its last
    asked_s: float  # again, by the clock on the wall


class Lockstep:
    """The participants, and the barrier at which they meet."""

    def __init__(self, traffic: Traffic, pace: Pace, is_stopping: Callable[[], bool]) -> None:
        self._traffic = traffic
        self._ports = traffic.ports
        self._pixhawk = traffic.simulation.pixhawk
        self._pace = pace
        self._is_stopping = is_stopping
        self._waited_for: dict[LinkId, Peer] = {}
        self._missed: dict[LinkId, _Missed] = {}
        traffic.when_forgotten = self._forget

    @property
    def is_peer_missing(self) -> bool:
        """Whether a participant was given up and has not answered since."""
        return bool(self._missed)

    def meet_companions(self) -> None:
        """Wait until every companion is through with this step."""
        self._barrier([link for link in self._waited_for if self._traffic.is_companion(link)])

    def meet_stations(self) -> None:
        """Wait until every ground station is."""
        self._barrier([link for link in self._waited_for if not self._traffic.is_companion(link)])

    def gather(self) -> None:
        """Wait for the first heartbeat of all, then make sure that all have read their mail."""
        begun = reported = time.monotonic()
        greeted = float("-inf")
        while True:
            now = time.monotonic()
            if self._is_stopping():
                return
            self._traffic.serve()
            missing = self._missing()
            if not missing:
                break
            if now - greeted > GREETING_S:
                greeted = now
                self._pixhawk.announce()
            self._traffic.flush()
            if now - begun > self._pace.start_timeout_s:
                raise BridgeError(
                    f"no heartbeat from {' or '.join(missing)} within"
                    f" {self._pace.start_timeout_s:g} s: start it, or use --speed realtime"
                )
            if now - reported > 2.0:
                reported = now + 3600.0
                self._traffic.report(
                    f"waiting for the first heartbeat of {' and of '.join(missing)}"
                )
            self._ports.wait(0.05, self._ports.ground, self._ports.companion)
        for peer in self._ports.peers.values():
            takes_part = not peer.port.ground or self._pace.lockstep_ground
            if takes_part and self._pixhawk.heartbeats(peer.link):
                self._wait_for(peer)
        self._pixhawk.announce()
        self.meet_companions()
        self.meet_stations()

    def readmit(self) -> None:
        """Wait again for those who answer again, and for a companion that has taken over."""
        for peer in list(self._ports.peers.values()):
            successor = not peer.port.ground and self._pixhawk.heartbeats(peer.link) > 0
            if peer.link in self._missed:
                if self._has_answered(peer):
                    del self._missed[peer.link]
                    self._waited_for[peer.link] = peer
                    self._traffic.report(f"{name_of(peer)} is back")
            elif successor and peer.link not in self._waited_for:
                self._wait_for(peer)
                self._traffic.report(f"{name_of(peer)} takes part")
                for link in [m for m in self._missed if self._traffic.is_companion(m)]:
                    del self._missed[link]

    def _barrier(self, links: list[LinkId]) -> None:
        """Ask each whether it is through with this step, and take all that comes until then."""
        stamp = self._stamp()
        if self._traffic.is_disturbed:
            self._traffic.flush()  # so that the question below goes alone, past all faults
        for link in links:
            self._pixhawk.send(link, mavlink.MAVLink_timesync_message(0, stamp))
        if links:
            ground = self._ports.peers[links[0]].port.ground
            asked = [p.link for p in self._ports.peers.values() if p.port.ground == ground]
            self._traffic.flush(asked, corrupted=False)
        for link in links:
            self._await(link, stamp)

    def _await(self, link: LinkId, stamp: int) -> None:
        peer = self._ports.peers.get(link)
        if peer is None:
            return
        begun = repeated = time.monotonic()
        while self._pixhawk.timesync_answer_ns(link) != stamp and not self._is_stopping():
            if not self._traffic.take_one(peer.port):
                self._ports.wait(0.1, peer.port)
            # Also where something has come: others on this port may never be silent.
            now = time.monotonic()
            if now - begun > self._pace.patience_s:
                self._give_up(peer)
                return
            if now - repeated > REPEAT_S:
                repeated = now
                self._ask_again(link, stamp)

    def _ask_again(self, link: LinkId, stamp: int) -> None:
        self._pixhawk.send(link, mavlink.MAVLink_timesync_message(0, stamp))
        self._traffic.flush([link], corrupted=False)

    def _has_answered(self, peer: Peer) -> bool:
        """Whether one that was given up has answered since; who sends again is asked again."""
        link, missed = peer.link, self._missed[peer.link]
        if self._pixhawk.timesync_answer_ns(link) != missed.answer_ns:
            return True
        now = time.monotonic()
        if peer.datagrams > missed.datagrams and now - missed.asked_s > REPEAT_S:
            self._missed[link] = _Missed(peer.datagrams, missed.answer_ns, now)
            self._ask_again(link, self._stamp())
        return False

    def _stamp(self) -> int:
        """Of the questions that are asked after this step [ns]."""
        return BARRIER_OFFSET_NS + round(self._traffic.simulation.time_s * 1e9)

    def _give_up(self, peer: Peer) -> None:
        self._waited_for.pop(peer.link, None)
        answer_ns = self._pixhawk.timesync_answer_ns(peer.link)
        self._missed[peer.link] = _Missed(peer.datagrams, answer_ns, float("-inf"))
        self._traffic.report(
            f"{name_of(peer)} has not answered for {self._pace.patience_s:g} s:"
            " going on at natural pace without it"
        )

    def _forget(self, link: LinkId) -> None:
        self._waited_for.pop(link, None)
        self._missed.pop(link, None)

    def _wait_for(self, peer: Peer) -> None:
        self._waited_for[peer.link] = peer
        if not peer.port.ground:
            self._pixhawk.set_pace(peer.link)

    def _missing(self) -> list[str]:
        peers = self._ports.peers.values()
        missing = []
        motive = self._traffic.motive
        if motive is not None and not motive.motive.is_followed:
            missing.append("a NatNet client")
        if not any(not p.port.ground and self._pixhawk.heartbeats(p.link) for p in peers):
            configured = [p for p in peers if not p.port.ground and p.configured]
            missing += [name_of(peer) for peer in configured] or ["a companion"]
        if self._pace.lockstep_ground:
            missing += [
                name_of(peer)
                for peer in peers
                if peer.port.ground and peer.configured and not self._pixhawk.heartbeats(peer.link)
            ]
        return missing

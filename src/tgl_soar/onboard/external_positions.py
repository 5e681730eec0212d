"""Positions that do not come from the autopilot: asked for, accepted, forwarded to it."""

from __future__ import annotations

from tgl_soar.link.messages import Source
from tgl_soar.link.optitrack import MocapLink, Optitrack
from tgl_soar.link.session import Session
from tgl_soar.link.sources import MOCAP, VISION
from tgl_soar.link.tracked_attitude import TrackedAttitude
from tgl_soar.onboard.clocking import Clocking
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.setup import ModuleSetup, accepted_bridges, forwarding_of
from tgl_soar.types import AttitudeSample


class OutsidePositions:
    """A motion-capture hall's, a bridge's; and what is reported to the autopilot of them."""

    def __init__(
        self, setup: ModuleSetup, session: Session, clocking: Clocking, outbox: Outbox
    ) -> None:
        self.mocap: Optitrack | None = None
        self._mocap_link: MocapLink | None = None
        self.tracked = TrackedAttitude() if setup.tracked_attitude else None
        self._forwarding = forwarding_of(setup.forward)
        self._bridges = accepted_bridges(setup.position, setup.own)
        self._session = session
        self._clocking = clocking
        self._outbox = outbox

    def add_mocap(self, client: Optitrack, link: MocapLink) -> None:
        """Positions from a motion-capture hall, and how to ask its server."""
        self.mocap, self._mocap_link = client, link

    def pose(self, data: bytes, sender: tuple[str, int], now_s: float) -> None:
        """A datagram has come from a motion-capture server, or from somebody who plays it."""
        if self.mocap is None:
            return
        clocking = self._clocking
        now_s = clocking.now_s(now_s)
        fix = self.mocap.take(data, sender, now_s)
        if fix is not None and (clocking.by_vehicle or not clocking.lockstep):
            turned = self.mocap.attitude
            self._session.sources.take(MOCAP, fix, now_s, turned)
            if self.tracked is not None and turned is not None:
                self.tracked.take(turned, fix.time_s, self._session.attitude)

    def attitude(self, now_s: float) -> AttitudeSample:
        """What a tick is given: the autopilot's, or the tracker's where the site asks for it."""
        reported = self._session.attitude
        return reported if self.tracked is None else self.tracked.choose(now_s, reported)

    def vision(self, source: Source) -> None:
        """A bridge on the autopilot's own link speaks to it without us."""
        if self._forwarding is not None and source in self._bridges:
            self._forwarding.known.add(VISION)

    def ask(self, now_s: float) -> None:
        """What is to be asked of the motion-capture server."""
        mocap = self.mocap
        if mocap is None:
            return
        assert self._mocap_link is not None
        for request in mocap.poll(now_s):
            self._mocap_link.send(request)
        if mocap.stream is not None:
            self._mocap_link.follow(mocap.stream)
        self._outbox.tell_all(mocap.notices)

    def forward(self, now_s: float) -> None:
        """The pose of a tracker, to the autopilot alone; and whose attitude is used, if new."""
        if self.tracked is not None:
            self._outbox.tell_all(self.tracked.notices)
        forwarding = self._forwarding
        if forwarding is None:
            return
        pose = forwarding.poll(self._session.sources, now_s)
        if pose is not None:
            self._outbox.say(pose, self._outbox.autopilot)
        self._outbox.tell_all(forwarding.notices)

    def restart(self) -> None:
        """The clock is another one: what was timed by the old one is forgotten."""
        if self.mocap is not None:
            self.mocap.rebase()
        if self.tracked is not None:
            self.tracked.reset()
        if self._forwarding is not None:
            self._forwarding.rebase()

"""OptiTrack: position fixes from what Motive streams.  No sockets, no clock.

`take` gets every datagram with its sender and returns a fix or nothing; `poll` returns the
requests that are due to the server's command port (`natnet.server`).

A fix is a tracked pose of the site's rigid body, in local NED, at the middle of its exposure.
What is no measurement is counted and not used, and each kind is reported (`natnet.diagnostics`):

    foreign       of another server than ours
    truncated, oversized, malformed    cannot be read
    unready       before the handshake, or before it is known which id the body has
    odd           stamped by a clock that is not the server's as it is known
    out_of_order  not newer than the last
    stale         older than `max_age_s` when it came
    absent        the body is not in the frame
    untracked     the server does not vouch for the pose
    not_finite    no numbers
    frozen        bit for bit the last pose: cameras always have noise
    poor          markers too far from where they should be
    jumps         faster than flight (`natnet.track`), and settling until the new place holds
    thinned       more often than asked for
"""

from __future__ import annotations

from typing import Final, Protocol

from tgl_soar.link.messages import SEVERITY_WARNING
from tgl_soar.link.natnet import layout
from tgl_soar.link.natnet.clock import ServerClock
from tgl_soar.link.natnet.diagnostics import OptitrackCounters, OptitrackLedger, OutageNotices
from tgl_soar.link.natnet.frame_times import FrameTimes
from tgl_soar.link.natnet.layout import Malformed, RigidBody, ServerInfo
from tgl_soar.link.natnet.pose_filter import PoseFilter
from tgl_soar.link.natnet.server import Address, MulticastStream, NatNetServer
from tgl_soar.link.natnet.settings import OptitrackSettings
from tgl_soar.types import NAN, PositionFix, isfinite

SILENCE_S: Final = 1.0
START_S: Final = 3.0  # a server may be silent for so long at first, before it is reported
UNREADABLE: Final = 50  # frames in a row: the server must have become another one


class MocapLink(Protocol):
    """How requests reach the server."""

    def send(self, data: bytes) -> None:
        """To its command port."""
        ...

    def follow(self, stream: MulticastStream) -> None:
        """Listen where it streams."""
        ...


class Optitrack:
    """One server, one rigid body."""

    def __init__(self, settings: OptitrackSettings, *, lockstep: bool = False) -> None:
        self.counters = OptitrackCounters()
        self.age_s = NAN  # of the last frame when it came, from its exposure
        self._outage = OutageNotices()
        self.notices = self._outage.texts
        ledger = OptitrackLedger(self.counters, self._outage)
        self._server = NatNetServer(settings, ledger, lockstep=lockstep)
        self._times = FrameTimes(ledger, lockstep=lockstep)
        self._poses = PoseFilter(settings, ledger)
        self._settings = settings
        self._lockstep = lockstep
        self._received_s = NAN  # the last frame of our server
        self._sender: Address | None = None  # of the frames
        self._unreadable = 0
        self._flagged = False  # the last frame says that definitions have changed
        self._number = -1

    @property
    def clock(self) -> ServerClock:
        """The server's against ours."""
        return self._times.clock

    @property
    def info(self) -> ServerInfo | None:
        """Who the server is; None: not known."""
        return self._server.info

    @property
    def stream(self) -> MulticastStream | None:
        """Of a multicast server."""
        return self._server.stream

    @property
    def models(self) -> dict[str, int]:
        """Streaming ids by the names of bodies."""
        return self._server.models

    @property
    def pose(self) -> RigidBody | None:
        """The last one that was used, hall's axes."""
        return self._poses.pose

    @property
    def latency_s(self) -> float:
        """From the exposure to now, of the last fix."""
        return self._poses.latency_s

    @property
    def attitude(self) -> tuple[float, float, float, float] | None:
        """Of the pose that was used last, FRD to local NED."""
        return self._poses.attitude

    @property
    def version(self) -> layout.Version:
        """Of NatNet, as it is read."""
        return self._server.version

    @property
    def is_ready(self) -> bool:
        """Whether frames can be used: the server is known, and which body is ours."""
        return self._server.is_ready

    @property
    def uncertainty_s(self) -> float:
        """How wrong the times of fixes can be; infinite: not known."""
        return self._times.uncertainty_s

    def summary(self) -> str:
        """What came and how old it was, in words."""
        words = self.counters.summary() or "nothing came"
        if self.counters.fixes:
            words += f"; the last was {1e3 * self.latency_s:.1f} ms old"
        if self.counters.fixes and isfinite(self.uncertainty_s):
            words += f", give or take {1e3 * self.uncertainty_s:.2f} ms"
        return words

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        self._outage.rebase()
        self._server.rebase()
        self._received_s = NAN
        self.clock.reset()
        self._poses.reset()

    def poll(self, now_s: float) -> list[bytes]:
        """What is to be sent to the server now."""
        self._outage.now_s = now_s
        if not isfinite(self._received_s):
            self._received_s = now_s
        silence_s = now_s - self._received_s
        silent = silence_s > SILENCE_S
        if silent:
            self._report_silence(silence_s)
        return self._server.poll(now_s, silent=silent)

    def take(self, data: bytes, sender: Address, now_s: float) -> PositionFix | None:
        """Read one datagram that has come now.  Never raises."""
        self._outage.now_s = now_s
        counters = self.counters
        server = self._server
        if server.address and sender[0] != server.address:
            counters.foreign += 1
            text = f"{sender[0]} streams too: it is not listened to"
            self._outage.report("foreign", SEVERITY_WARNING, text)
            return None
        try:
            message = layout.message_of(data)
        except Malformed as error:
            counters.truncated += 1
            self._outage.report("truncated", SEVERITY_WARNING, f"a message is {error}")
            return None
        try:
            if message == layout.FRAME:
                return self._on_frame(data, sender, now_s)
            if message == layout.SERVER_INFO:
                self._on_server_info(layout.server_info_of(data), sender)
            elif server.info is not None and message == layout.MODELS:
                self._on_models(layout.models_of(data, server.version))
            elif server.info is not None and message == layout.ECHO_RESPONSE:
                self._times.on_echo(*layout.echo_of(data), now_s)
                self._check_restart()
            else:
                counters.unknown += 1
        except Malformed as error:
            self._on_unreadable(f"a message {message} cannot be read: {error}")
        return None

    def _on_unreadable(self, text: str) -> None:
        self.counters.malformed += 1
        self._outage.report("malformed", SEVERITY_WARNING, text)
        self._unreadable += 1
        if self._unreadable >= UNREADABLE:  # it may send another version by now
            self._unreadable = 0
            self._server.info = None

    def _on_server_info(self, info: ServerInfo, sender: Address) -> None:
        server = self._server
        if not server.is_new(info, sender):
            return
        if server.info is not None:
            self._times.reset()
            self._reset("it is another server now, or another version")
        self._times.set_clock_rate(info.clock_hz)
        self._received_s = NAN  # its stream may take a while to begin
        before = server.body_id
        server.accept(info, sender)
        if server.body_id != before:
            self._poses.reset()

    def _on_models(self, models: dict[str, int]) -> None:
        self._unreadable = 0
        before = self._server.body_id
        self._server.on_models(models)
        if self._server.body_id != before:
            self._poses.reset()

    def _on_frame(self, data: bytes, sender: Address, now_s: float) -> PositionFix | None:
        counters, server = self.counters, self._server
        counters.frames += 1
        if not self._is_our_stream(sender, now_s):
            return None
        if len(data) > layout.HEADER.size + layout.HEADER.unpack_from(data)[1]:
            counters.oversized += 1
            text = "a frame is longer than it says"
            self._outage.report("oversized", SEVERITY_WARNING, text)
            return None
        self._received_s = now_s
        if server.info is None or server.body_id is None:
            counters.unready += 1
            return None
        frame = layout.frame_of(data, server.version, server.body_id)
        self._unreadable = 0
        if frame.models_changed and not self._flagged:
            server.discard_models()
        self._flagged = frame.models_changed
        time_s = self._times.time_of(frame, now_s)
        if self.clock.restarts > 0:
            self._check_restart()
        if time_s is not None:
            if frame.number <= self._number:  # the server was restarted, or replays a take
                server.discard_models()
            self._number = frame.number
        if time_s is None or not server.is_ready:
            counters.unready += time_s is not None
            return None
        self.age_s = now_s - time_s
        if self.age_s > self._settings.max_age_s:
            counters.stale += 1
            text = f"a pose is {1e3 * self.age_s:.0f} ms old: not used"
            self._outage.report("stale", SEVERITY_WARNING, text)
            return None
        if frame.body is None:
            counters.absent += 1
            text = f"{self._settings.body!r} is not in the frames"
            self._outage.report("absent", SEVERITY_WARNING, text)
            server.refresh_models()
            return None
        jumps = counters.jumps
        fix = self._poses.fix_of(frame.body, time_s, now_s)
        if counters.jumps != jumps:
            server.refresh_models()
        return fix

    def _is_our_stream(self, sender: Address, now_s: float) -> bool:
        """One sender's frames are used; another's only when that has been silent."""
        if sender != self._sender:
            if self._sender is not None and now_s - self._received_s <= SILENCE_S:
                self.counters.foreign += 1
                text = f"two streams, from ports {self._sender[1]} and {sender[1]}: one is used"
                self._outage.report("foreign", SEVERITY_WARNING, text)
                return False
            self._sender = sender
        return True

    def _check_restart(self) -> None:
        """A server whose clock is another one may be another one in all else, too."""
        if self._times.has_restarted():
            self._server.reconnect()
            self._reset("the server has restarted, with another clock")

    def _reset(self, why: str) -> None:
        self.counters.restarts += 1
        self._outage.add(SEVERITY_WARNING, why)
        self._server.reset()
        self._number = -1
        self._sender = None
        self._poses.reset()

    def _report_silence(self, silence_s: float) -> None:
        if self.counters.frames > 0:
            text = f"no frame for {SILENCE_S:g} s: asking again"
            self._outage.report("silent", SEVERITY_WARNING, text)
        elif self._lockstep or silence_s <= START_S:
            return  # a simulation begins when all have come
        elif self.info is None:
            where = self._server.address or "anywhere"
            text = f"no answer from {where}: does Motive stream?"
            self._outage.report("nobody", SEVERITY_WARNING, text)
        else:
            text = "it answers, but no frame comes: see mocap.stream, group and interface"
            self._outage.report("frameless", SEVERITY_WARNING, text)

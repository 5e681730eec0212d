"""OptiTrack: position fixes from what Motive streams.  No sockets, no clock.

`take` is given every datagram with its sender and gives a fix or nothing; `poll` gives what is
to be sent to the server's command port: the question who is there, until somebody answers and
again whenever the stream is silent; the definitions of what is tracked; a sign of life, without
which a unicast server stops; and echoes, which tell its clock (`natnet.clock`).

A fix is a tracked pose of the site's rigid body, in local NED, at the middle of its exposure.
What is no measurement is counted and not used, and each kind is told in words, again only after
poses have been used in between, which is told too:

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

In lockstep the server's clock is the vehicle's and nothing is mapped.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, NamedTuple, Protocol

from tgl_soar.geometry import HallFrame, ned_attitude_from_hall, ned_from_hall
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet import layout, track
from tgl_soar.link.natnet.clock import ServerClock
from tgl_soar.link.natnet.layout import Frame, Malformed, RigidBody, ServerInfo
from tgl_soar.link.natnet.track import Track
from tgl_soar.types import NAN, PositionFix, isfinite

CONNECT_S: Final = 1.0
MODELS_S: Final = 0.5
KEEP_ALIVE_S: Final = 1.0
ECHO_S: Final = 1.0
FIRST_ECHOES: Final = 10  # so many soon after each other, to know the clock before flight
FIRST_ECHO_S: Final = 0.05
SILENCE_S: Final = 1.0
START_S: Final = 3.0  # a server may be silent for so long at first, before it is told
REARM_S: Final = 10.0  # between two words of a kind: what flickers must not fill the radio
UNREADABLE: Final = 50  # frames in a row: the server must have become another one

# Words of these mean that no pose is used: when one is again, that is told.
OUTAGES: Final = frozenset(
    ("silent", "nobody", "frameless", "odd", "stale", "absent", "untracked", "finite", "frozen",
     "jump", "poor")
)  # fmt: skip

Address = tuple[str, int]


class Settings(NamedTuple):
    """What of a stream is flown with; `[mocap]` of a site file."""

    server: str  # its address; "": whoever answers first
    body: str | int  # name or streaming id
    unicast: bool
    hall: HallFrame
    noise_m: float
    max_error_m: float
    max_speed_mps: float
    max_age_s: float
    max_rate_hz: float


class Stream(NamedTuple):
    """Where a multicast server says that it streams."""

    group: str
    port: int


class Link(Protocol):
    """How requests reach the server."""

    def send(self, data: bytes) -> None:
        """To its command port."""
        ...

    def follow(self, stream: Stream) -> None:
        """Listen where it streams."""
        ...


@dataclass(slots=True)
class Counters:
    """What came, and what of it was no measurement."""

    frames: int = 0
    fixes: int = 0
    foreign: int = 0
    truncated: int = 0
    oversized: int = 0
    malformed: int = 0
    unready: int = 0
    odd: int = 0
    out_of_order: int = 0
    stale: int = 0
    absent: int = 0
    untracked: int = 0
    not_finite: int = 0
    frozen: int = 0
    poor: int = 0
    jumps: int = 0
    settling: int = 0
    thinned: int = 0
    wrong_version: int = 0
    unknown: int = 0  # messages that mean nothing to us
    restarts: int = 0  # of the server

    def told(self) -> str:
        """All that is not zero, in words."""
        counted = ((f.name.replace("_", " "), getattr(self, f.name)) for f in fields(self))
        return ", ".join(f"{count} {name}" for name, count in counted if count)


class Optitrack:
    """One server, one rigid body."""

    def __init__(self, settings: Settings, *, lockstep: bool = False) -> None:
        self.counters = Counters()
        self.clock = ServerClock()
        self.info: ServerInfo | None = None
        self.stream: Stream | None = None  # of a multicast server
        self.models: dict[str, int] = {}
        self.pose: RigidBody | None = None  # the last one that was used, hall's axes
        self.latency_s = NAN  # from the exposure to now, of the last fix
        self.notices: list[tuple[int, str]] = []
        self._settings = settings
        self._lockstep = lockstep
        self.age_s = NAN  # of the last frame when it came, from its exposure
        self._told: dict[str, float] = {}  # when each kind was told last
        self._out = False  # told that no pose is used, and none was since
        self._back_s = float("-inf")  # when poses were used again
        self._last_used_s = NAN  # when the last fix came
        self._now_s = 0.0
        self._server = settings.server
        self._version = layout.NEWEST
        self._id: int | None = settings.body if isinstance(settings.body, int) else None
        self._heard_s = NAN  # the last frame of our server
        self._from: Address | None = None  # where frames come from
        self._unreadable = 0
        self._flagged = False
        self._refresh = False  # ask for the definitions again, and go on with those we have
        self._models_asked = 0
        self._clock_hz = 0
        self._first_ticks: int | None = None
        self._track = Track(settings.max_speed_mps)
        self._used_s = float("-inf")  # when the last fix was true
        self._newest_ticks = -1
        self._number = -1
        self._echoes = 0
        self.rebase()

    @property
    def turned(self) -> tuple[float, float, float, float] | None:
        """The attitude of the pose that was used last, FRD to local NED."""
        pose = self.pose
        if pose is None:
            return None
        return ned_attitude_from_hall(self._settings.hall, pose.qw, pose.qx, pose.qy, pose.qz)

    @property
    def version(self) -> layout.Version:
        """Of NatNet, as it is read."""
        return self._version

    @property
    def is_ready(self) -> bool:
        """Whether frames can be used: the server is known, and which body is ours."""
        return self.info is not None and self._id is not None

    def told(self) -> str:
        """What came and how old it was, in words."""
        words = self.counters.told() or "nothing came"
        if self.counters.fixes:
            words += f"; the last was {1e3 * self.latency_s:.1f} ms old"
        if self.counters.fixes and isfinite(self.uncertainty_s):
            words += f", give or take {1e3 * self.uncertainty_s:.2f} ms"
        return words

    @property
    def uncertainty_s(self) -> float:
        """How wrong the times of fixes can be; infinite: not known."""
        return 0.0 if self._lockstep else self.clock.uncertainty_s

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        never = float("-inf")
        self._told.clear()
        self._back_s, self._last_used_s = never, NAN
        self._connect_due_s = self._models_due_s = self._alive_due_s = self._echo_due_s = never
        self._heard_s = NAN
        self.clock.reset()
        self._forget_track()

    # --- asking -----------------------------------------------------------------------------

    def poll(self, now_s: float) -> list[bytes]:
        """What is to be sent to the server now."""
        self._now_s = now_s
        asked: list[bytes] = []
        if not isfinite(self._heard_s):
            self._heard_s = now_s
        silent = now_s - self._heard_s > SILENCE_S
        if silent:
            self._tell_silence(now_s - self._heard_s)
        if (self.info is None or silent) and now_s >= self._connect_due_s:
            self._connect_due_s = now_s + CONNECT_S
            asked.append(layout.connect_request())
        if self.info is None:
            return asked
        if (self._id is None or self._refresh) and now_s >= self._models_due_s:
            self._models_due_s = now_s + MODELS_S
            asked.append(layout.models_request(masked=self._models_asked % 2 == 1))
            self._models_asked += 1
        if self._settings.unicast and now_s >= self._alive_due_s:
            self._alive_due_s = now_s + KEEP_ALIVE_S
            asked.append(layout.keep_alive())
        if not self._lockstep and now_s >= self._echo_due_s:
            self._echo_due_s = now_s + (FIRST_ECHO_S if self._echoes < FIRST_ECHOES else ECHO_S)
            self._echoes += 1
            asked.append(layout.echo_request(max(1, round(now_s * 1e9))))
        return asked

    # --- what comes -------------------------------------------------------------------------

    def take(self, data: bytes, sender: Address, now_s: float) -> PositionFix | None:
        """Take in one datagram that has come now.  Never raises."""
        self._now_s = now_s
        counters = self.counters
        if self._server and sender[0] != self._server:
            counters.foreign += 1
            self._tell(
                "foreign", SEVERITY_WARNING, f"{sender[0]} streams too: it is not listened to"
            )
            return None
        try:
            message = layout.message_of(data)
        except Malformed as error:
            counters.truncated += 1
            self._tell("truncated", SEVERITY_WARNING, f"a message is {error}")
            return None
        try:
            if message == layout.FRAME:
                return self._take_frame(data, sender, now_s)
            if message == layout.SERVER_INFO:
                self._take_server(layout.server_info_of(data), sender)
            elif self.info is not None and message == layout.MODELS:
                self._take_models(layout.models_of(data, self._version))
            elif self.info is not None and message == layout.ECHO_RESPONSE:
                self._take_echo(*layout.echo_of(data), now_s)
            else:
                counters.unknown += 1
        except Malformed as error:
            self._cannot_read(f"a message {message} cannot be read: {error}")
        return None

    def _cannot_read(self, text: str) -> None:
        self.counters.malformed += 1
        self._tell("malformed", SEVERITY_WARNING, text)
        self._unreadable += 1
        if self._unreadable >= UNREADABLE:  # it may speak another version by now
            self._unreadable = 0
            self.info = None

    def _take_server(self, info: ServerInfo, sender: Address) -> None:
        version = info.version
        words = f"{info.name} at {sender[0]} speaks NatNet {version[0]}.{version[1]}"
        if not layout.OLDEST <= version < (layout.NEWEST[0] + 1, 0):
            self.counters.wrong_version += 1
            self._tell("version", SEVERITY_WARNING, f"{words}: 3.0 to 4.2 can be read")
            return
        if info == self.info:
            self._ask_again()  # it was silent: ids may be others
            return
        if self.info is not None:
            self._reset("it is another server now, or another version")
        if info.clock_hz != self._clock_hz:
            self._clock_hz, self._first_ticks = info.clock_hz, None
            self.clock.reset()
        self.info, self._version, self._server = info, version, sender[0]
        self._heard_s = NAN  # its stream may take a while to begin
        self._find_body()
        text = f"{words}, clock {info.clock_hz} Hz"
        if version > layout.NEWEST:
            text += ", read as 4.2"
        self.notices.append((SEVERITY_INFO, f"OptiTrack: {text}"))
        if info.is_multicast:
            self.stream = Stream(info.group, info.data_port)
        if info.is_multicast == self._settings.unicast:
            theirs = "multicast" if info.is_multicast else "unicast"
            self._tell("mode", SEVERITY_WARNING, f"it streams {theirs}, mocap.stream does not")

    def _take_models(self, models: dict[str, int]) -> None:
        self.models = models
        self._unreadable = 0
        self._refresh = False
        self._find_body()

    def _find_body(self) -> None:
        """The streaming id of our body: told by the site, or looked up by its name."""
        body = self._settings.body
        if isinstance(body, int):
            self._id = body
            return
        found = self.models.get(body)
        if found is None and self.models:
            names = ", ".join(sorted(self.models))[:120]
            self._tell("body", SEVERITY_WARNING, f"no rigid body {body!r}; there are {names}")
        if found != self._id:
            self._forget_track()
        self._id = found

    def _forget_body(self) -> None:
        """Which id is which body has changed: nothing is used until the server has told."""
        if not isinstance(self._settings.body, int):
            self._id = None
            self.models = {}
            self._models_due_s = float("-inf")

    def _ask_again(self) -> None:
        """The body's id may have changed."""
        self._refresh = not isinstance(self._settings.body, int)

    def _take_echo(self, stamp_ns: int, ticks: int, now_s: float) -> None:
        asked_s = stamp_ns * 1e-9
        if self._lockstep or not now_s - SILENCE_S <= asked_s <= now_s:
            self.counters.odd += 1
            return
        self.clock.echoed(self._seconds(ticks), asked_s, now_s)
        self._look_for_restart()

    # --- frames -----------------------------------------------------------------------------

    def _take_frame(self, data: bytes, sender: Address, now_s: float) -> PositionFix | None:
        counters = self.counters
        counters.frames += 1
        if not self._is_our_stream(sender, now_s):
            return None
        if len(data) > layout.HEADER.size + layout.HEADER.unpack_from(data)[1]:
            counters.oversized += 1
            self._tell("oversized", SEVERITY_WARNING, "a frame is longer than it says")
            return None
        self._heard_s = now_s
        if self.info is None or self._id is None:
            counters.unready += 1
            return None
        frame = layout.frame_of(data, self._version, self._id)
        self._unreadable = 0
        if frame.models_changed and not self._flagged:
            self._forget_body()
        self._flagged = frame.models_changed
        time_s = self._time_of(frame, now_s)
        if time_s is not None:
            if frame.number <= self._number:  # it counts anew: it was restarted, or plays a take
                self._forget_body()
            self._number = frame.number
        if time_s is None or not self.is_ready:
            counters.unready += time_s is not None
            return None
        self.age_s = now_s - time_s
        if now_s - time_s > self._settings.max_age_s:
            counters.stale += 1
            age_ms = 1e3 * (now_s - time_s)
            self._tell("stale", SEVERITY_WARNING, f"a pose is {age_ms:.0f} ms old: not used")
            return None
        if frame.body is None:
            counters.absent += 1
            self._tell("absent", SEVERITY_WARNING, f"{self._settings.body!r} is not in the frames")
            self._ask_again()
            return None
        return self._fix(frame.body, time_s, now_s)

    def _is_our_stream(self, sender: Address, now_s: float) -> bool:
        """One sender's frames are taken; another's only when that has fallen silent."""
        if sender != self._from:
            if self._from is not None and now_s - self._heard_s <= SILENCE_S:
                self.counters.foreign += 1
                text = f"two streams, from ports {self._from[1]} and {sender[1]}: one is used"
                self._tell("foreign", SEVERITY_WARNING, text)
                return False
            self._from = sender
        return True

    def _time_of(self, frame: Frame, now_s: float) -> float | None:
        """When the pose was true, on our clock; None: it is not new."""
        counters = self.counters
        sent = frame.sent_ticks or frame.exposed_ticks
        exposed = frame.exposed_ticks or sent
        if not frame.exposed_ticks:
            text = "frames have no mid-exposure time: they are taken for as old as the network is"
            self._tell("untimed", SEVERITY_WARNING, text)
        sent_s, exposed_s = self._seconds(sent), self._seconds(exposed)
        if not 0.0 <= sent_s - exposed_s <= SILENCE_S:
            counters.odd += 1
            self._tell(
                "odd", SEVERITY_WARNING, "a frame was sent before it was exposed, or long after"
            )
            return None
        if not self._is_stamped_well(sent_s, now_s):
            counters.odd += 1
            text = "the server's clock is another one: waiting until it is known"
            self._tell("odd", SEVERITY_WARNING, text)
            return None
        self._look_for_restart()
        if exposed <= self._newest_ticks:
            counters.out_of_order += 1
            self._tell("order", SEVERITY_INFO, "frames come out of order or twice")
            return None
        self._newest_ticks = exposed
        return exposed_s if self._lockstep else min(now_s, exposed_s + self.clock.offset_s)

    def _is_stamped_well(self, sent_s: float, now_s: float) -> bool:
        if self._lockstep:
            return abs(now_s - sent_s) <= SILENCE_S
        return self.clock.stamped(sent_s, now_s)

    def _seconds(self, ticks: int) -> float:
        """Of the server's clock, counted from the first that was seen: so they are exact."""
        if self._first_ticks is None:
            self._first_ticks = 0 if self._lockstep else ticks
        return (ticks - self._first_ticks) / self._clock_hz

    def _fix(self, body: RigidBody, time_s: float, now_s: float) -> PositionFix | None:
        counters, settings = self.counters, self._settings
        if not body.is_tracked:
            counters.untracked += 1
            self._tell("untracked", SEVERITY_INFO, f"{settings.body!r} is not tracked: not used")
            return None
        if not all(map(isfinite, body[1:9])):
            counters.not_finite += 1
            self._tell("finite", SEVERITY_WARNING, "a pose is not a number")
            return None
        if not self._follows(body, time_s):
            return None
        if body.error_m > settings.max_error_m:
            counters.poor += 1
            text = f"mean marker error {1e3 * body.error_m:.0f} mm: not used"
            self._tell("poor", SEVERITY_WARNING, text)
            return None
        # A frame that is early by half a frame's time is not left out.
        if time_s - self._used_s < 0.75 / settings.max_rate_hz:
            counters.thinned += 1
            return None
        counters.fixes += 1
        if self._out:
            self._tell_back()
        self._last_used_s = now_s
        self._used_s = time_s
        self.pose = body
        self.latency_s = now_s - time_s
        north, east, down = ned_from_hall(settings.hall, body.x_m, body.y_m, body.z_m)
        sigma_m = max(settings.noise_m, body.error_m)
        return PositionFix(
            sequence=0,
            time_s=time_s,
            north_m=north,
            east_m=east,
            down_m=down,
            velocity_north_mps=NAN,
            velocity_east_mps=NAN,
            velocity_down_mps=NAN,
            source=0,
            sigma_m=sigma_m,
        )

    def _follows(self, body: RigidBody, time_s: float) -> bool:
        """Whether flight can have led from the poses before to this one."""
        counters, name = self.counters, self._settings.body
        verdict = self._track.judge(body, time_s)
        if verdict == track.FROZEN:
            counters.frozen += 1
            text = f"the pose of {name!r} is frozen: bit for bit the last one"
            self._tell("frozen", SEVERITY_WARNING, text)
        elif verdict == track.JUMPED:
            counters.jumps += 1
            text = f"{name!r} has jumped by {self._track.jump_m:.2f} m: not used until it holds"
            self._tell("jump", SEVERITY_WARNING, text)
            self._ask_again()
        elif verdict == track.SETTLING:
            counters.settling += 1
        return verdict == track.GOOD

    # --- beginning anew -----------------------------------------------------------------------

    def _look_for_restart(self) -> None:
        """A server that counts from another beginning may be another one in all else, too."""
        if self.clock.restarts > 0:
            self.clock.restarts = 0
            self.info = None
            self._connect_due_s = float("-inf")
            self._reset("the server has restarted, with another clock")

    def _reset(self, why: str) -> None:
        self.counters.restarts += 1
        self.notices.append((SEVERITY_WARNING, f"OptiTrack: {why}"))
        self._forget_body()
        self._forget_stream()
        self._forget_track()

    def _forget_stream(self) -> None:
        self._newest_ticks = self._number = -1
        self._echoes = 0
        self._from = None

    def _forget_track(self) -> None:
        self._track.forget()
        self._used_s = float("-inf")

    def _tell_silence(self, silence_s: float) -> None:
        if self.counters.frames > 0:
            self._tell("silent", SEVERITY_WARNING, f"no frame for {SILENCE_S:g} s: asking again")
        elif self._lockstep or silence_s <= START_S:
            return  # a simulation begins when all have come
        elif self.info is None:
            where = self._server or "anywhere"
            self._tell("nobody", SEVERITY_WARNING, f"no answer from {where}: does Motive stream?")
        else:
            text = "it answers, but no frame comes: see mocap.stream, group and interface"
            self._tell("frameless", SEVERITY_WARNING, text)

    def _tell_back(self) -> None:
        """Poses are used again, and what goes wrong from now on is news."""
        gap_s = self._now_s - self._last_used_s
        words = f"stream is back after {gap_s:.1f} s" if isfinite(gap_s) else "stream is there"
        self._out, self._back_s = False, self._now_s
        self.notices.append((SEVERITY_INFO, f"OptiTrack: {words}"))

    def _tell(self, kind: str, severity: int, text: str) -> None:
        """Words for each kind once in an outage; the counters go on."""
        told_s = self._told.get(kind)
        if told_s is not None and not (self._back_s > told_s and self._now_s - told_s >= REARM_S):
            return
        self._told[kind] = self._now_s
        self._out = self._out or kind in OUTAGES
        self.notices.append((severity, f"OptiTrack: {text}"))

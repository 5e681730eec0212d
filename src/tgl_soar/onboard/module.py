"""The module as it flies: init, event, periodic and settings.

    init      identities, laws and session from an airframe, a site and parameters
    event     bytes have come: decode, take in measurements, answer the operator
    periodic  a tick is due: inputs -> autopilot.step -> surfaces, then whatever is slow
    settings  a parameter has changed: new laws before the next tick

`Onboard` has neither socket nor clock: bytes and time are arguments, frames go out through a
function.  `process` opens the links, `loop` waits, and calls.

Two ways to keep time.  On an aircraft the loop's clock is this computer's and `pacing.Pacer`
says when to tick.  In lockstep the loop's clock is the vehicle's: each new ATTITUDE_QUATERNION
is exactly one tick at its own time stamp, and as everything is handled in the order in which it
came, the answer to a TIMESYNC tells the simulator that all before it is done.  Before the first
attitude, which the simulator sends unasked, the autopilot gets nothing but heartbeats: whatever
was asked of it would come earlier or later as the machine is fast or slow.  Where attitudes fail
the stamps of the TIMESYNCs keep the clock going: silence must not stop time.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Final, NamedTuple

from tgl_soar import __version__, autopilot
from tgl_soar.config.files import switch_refusal
from tgl_soar.config.line_changes import OVERRIDE, LineChanges
from tgl_soar.config.parameter_store import ParameterStore
from tgl_soar.config.parameters import INDEX
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.supervisor import (
    BOOT,
    FAILED,
    HOLDING,
    READY,
    RECOVERING,
    RELEASED,
    SOARING,
    STANDBY,
    is_flying,
)
from tgl_soar.estimation.health import JUMP, WRONG
from tgl_soar.link import file_transfer
from tgl_soar.link.autopilots.base import is_finite
from tgl_soar.link.commands import ABORT, ENGAGE, NOTHING, RELEASE, CommandServer
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.engagement import GONE_S, SILENCE_S, Engagement
from tgl_soar.link.messages import (
    ID_RC_CHANNELS,
    SEVERITY_ERROR,
    SEVERITY_INFO,
    SEVERITY_NOTICE,
    SEVERITY_WARNING,
    AttitudeQuaternion,
    CommandInt,
    CommandLong,
    FileTransferProtocol,
    GlobalPositionInt,
    Heartbeat,
    HighresImu,
    LocalPositionNed,
    Odometry,
    Outbound,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    RawImu,
    RcChannels,
    Received,
    ScaledImu,
    ServoOutputRaw,
    SetupSigning,
    Source,
    SysStatus,
    Timesync,
    VfrHud,
    VisionPositionEstimate,
)
from tgl_soar.link.mode_change import ModeChange
from tgl_soar.link.optitrack import MocapLink, Optitrack
from tgl_soar.link.parameters import ParameterServer
from tgl_soar.link.pose_forwarding import PoseForwarding
from tgl_soar.link.routes import Route
from tgl_soar.link.signing import KEY_BYTES, Signing
from tgl_soar.link.sources import MOCAP, VISION
from tgl_soar.link.telemetry import StatusTexts, Telemetry
from tgl_soar.onboard import instruments, pacing
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER, LinkReport, Recorder
from tgl_soar.onboard.setup import (
    Setup,
    accepted_bridges,
    forwarding_of,
    known_systems,
    laws_of,
    session_of,
)
from tgl_soar.types import (
    OURS,
    THEIRS,
    Inputs,
    Setpoints,
    SurfaceCommand,
    isfinite,
)

LONGEST_FRAME: Final = 293  # bytes of a MAVLink 2 frame with a full payload and a signature
RELEASE_FRAMES: Final = 5  # a lost frame must not leave the aircraft to the overrides' time-out
RELEASE_INTERVAL_S: Final = 0.1
ENGAGED: Final = 2.0  # OP_ENGAGE of a module that has the surfaces
SHOW_ENGAGED_S: Final = 1.0
ABSENT_S: Final = 5.0  # a station that was silent for longer may have missed a change
REFUSALS_S: Final = 0.25  # between two words about commands that were refused
OVERLOAD_REPORT_S: Final = 10.0  # between two words about late ticks
IDENTITY_REMEDY: Final = "stop one, or give it another component_id in [autopilot]"
DUPLICATE_TOLD_S: Final = 10.0  # between two words about a module with our identity
LATE_REPORTED: Final = 10  # fewer are not worth a word
PILOT_SWITCH_HZ: Final = 10.0
LOSS_S: Final = 2.0  # over which the loss on the link is measured
COMPLAIN_S: Final = 5.0  # between two words about keys that were refused
KEPT_IS_DAMAGED: Final = "the signing timestamp that was kept is damaged: the clock is used instead"
MISSED_TICKS: Final = 1.5  # lockstep: so long without an attitude, its tick is missing
PIECE_BYTES: Final = 512  # more than a tick usually hears is not rehearsed
IDLE_S: Final = 0.05  # how often to look around while nothing sets the pace


class WarmUp(NamedTuple):
    """What a tick had, to go through it once more."""

    state: autopilot.AutopilotState
    inputs: Inputs
    piece: bytes  # what came before it


@dataclass(slots=True)
class Counters:
    """What the module did; the parts have counters of their own."""

    ticks: int = 0
    surface_frames: int = 0
    release_frames: int = 0
    unsent: int = 0  # frames that the link did not take
    left_out: int = 0  # of these, commands that would have come too late
    unsendable: int = 0  # messages that could not be packed: a mistake of ours
    laws_changed: int = 0
    telemetry_shed: int = 0  # messages that were due while ticks came late
    mode_changes: dict[int, int] = field(default_factory=dict)  # by the new mode


class Onboard:
    """The module without its sockets."""

    def __init__(
        self,
        setup: Setup,
        send: Callable[[bytes], bool],
        now_s: float,
        *,
        stream: bool = False,
        lockstep: bool = False,
        console: Callable[[str], None] | None = None,
        store: ParameterStore | None = None,
        first_words: Sequence[tuple[int, str]] = (),
        signing: Signing | None = None,
        unsigned_autopilot: bool = False,
        keep_key: Callable[[bytes], None] | None = None,
        recorder: Recorder = NO_RECORDER,
        start: int = 1,
        send_command: Callable[[bytes], bool] | None = None,
        clear_for_release: Callable[[], bool] | None = None,
    ) -> None:
        """`stream`: the link may cut frames anywhere.  `console`: where words go locally.
        `store`: keeps changed parameters.  `first_words`: told once the autopilot is heard.

        `signing`: without one nothing is signed.  `unsigned_autopilot`: the autopilot itself
        need not sign on its own link.  `keep_key`: keeps a key that came over the air, or raises
        OSError; without it none is taken.  `recorder`: is told all that a log holds.  `start`:
        tells this module from another one that was given the same identity by mistake.

        `send_command`, `clear_for_release`: as `Route` takes them, for the first link.
        """
        self.counters = Counters()
        self.texts = StatusTexts()
        line = LineChanges(setup.presets, LineBounds(setup.contour, setup.ground).fault)
        self.parameters = ParameterServer(setup.own, setup.parameters, self.texts, line)
        rate_hz = setup.parameters["LOOP_RATE"]
        self.session = session_of(setup, lockstep=lockstep, start=start)
        self.forwarding = forwarding_of(setup.forward)
        self.pacer = pacing.Pacer(rate_hz, now_s)
        self.load_shedding = pacing.LoadShedding()
        self.output: autopilot.Output | None = None  # of the last tick

        self._setup = setup
        route = setup.flavour.route
        self._loops, self._enters_mode = route.loops, route.mode_to_enter is not None
        self._recorder = recorder
        self._console = console or _nowhere
        self._store = store
        self._first_words = list(first_words)
        if fault := line.fault(setup.parameters):
            self._first_words.append((SEVERITY_WARNING, f"cannot be engaged: {fault}"))
        self.signing = signing or Signing(None, 0.0, 0.0)
        if self.signing.kept_is_damaged:
            self._first_words.append((SEVERITY_WARNING, KEPT_IS_DAMAGED))
        for _, text in self._first_words:
            self._console(text)
        self._unsigned_autopilot = unsigned_autopilot
        self._keep_key = keep_key
        self._keys_refused_s = float("-inf")
        self._lockstep = lockstep
        self._vehicle_clock = False  # lockstep, and the first attitude has come
        self._stepped_s = float("-inf")  # lockstep: the time of the last tick
        self._attitude_stepped = False  # since the last TIMESYNC
        self._timesync_ahead_s = float("nan")  # of its stamp, before an attitude's
        self._routes: list[Route] = []
        self._autopilot = self._routes[
            self.add_link(
                send,
                stream=stream,
                send_command=send_command,
                clear_for_release=clear_for_release,
            )
        ]
        self._autopilot.decoder.watch(self.session.autopilot)
        self._values = setup.parameters
        self._laws = laws_of(setup, setup.parameters)
        self._laws_stale = False
        self._op_engage = setup.parameters["OP_ENGAGE"]
        self._engage = self._op_engage >= 0.5
        self._telemetry_bytes_per_s = setup.parameters["TEL_BUDGET"]
        self._state = autopilot.initial_state()
        self._piece = b""  # that came last over the first link
        self._warm_up: WarmUp | None = None
        self._warming_up = Decoder(stream=False), Encoder(setup.override)  # nobody else's
        self._mode = BOOT
        recorder.parameters(self._values)
        recorder.reset(self._state)
        self._active = False
        self._mode_change = ModeChange(setup.flavour)
        self._releases = 0
        self._release_due_s = 0.0
        self._panel = instruments.Panel(setup.frame)
        self.telemetry = Telemetry(self._panel.flows())
        self.engagement = Engagement()
        major, minor, patch = (int(part) for part in __version__.split(".")[:3])
        self.commands = CommandServer(setup.own, self.telemetry, (major, minor, patch))
        self.mocap: Optitrack | None = None
        self._mocap_link: MocapLink | None = None
        self._loss = 0.0
        self._loss_due_s = float("-inf")
        self._loss_counted = (0, 0)
        self._engaged_s = now_s
        self._met: dict[tuple[int, Source], float] = {}  # when each station was heard last
        self._refused_s = float("-inf")
        self._switch_told = False  # that it is silent
        self._duplicate_told_s = float("-inf")
        self._overload_reported_s = float("-inf")
        self._late_reported = 0
        self._slow_link_told_s = float("-inf")
        self._left_out_told = 0
        self._reboots = 0
        self._want_pilot_switch()

    def add_link(
        self,
        send: Callable[[bytes], bool],
        *,
        stream: bool = False,
        send_command: Callable[[bytes], bool] | None = None,
        clear_for_release: Callable[[], bool] | None = None,
    ) -> int:
        """One more link; its number.  The first leads to the autopilot."""
        setup, number = self._setup, len(self._routes)
        excused = self.session.autopilot if number == 0 and self._unsigned_autopilot else None
        self._routes.append(
            Route(
                number,
                setup.own,
                setup.override,
                send,
                self.signing,
                stream=stream,
                excused=excused,
                known=known_systems(setup),
                tap=partial(self._recorder.heard, number),
                send_command=send_command,
                clear_for_release=clear_for_release,
            )
        )
        return number

    def add_mocap(self, client: Optitrack, link: MocapLink) -> None:
        """Positions from a motion-capture hall, and how to ask its server."""
        self.mocap, self._mocap_link = client, link

    @property
    def decoder(self) -> Decoder:
        """Of the link to the autopilot."""
        return self._autopilot.decoder

    @property
    def has_surfaces(self) -> bool:
        """Whether surfaces are commanded, or being given back."""
        return self._active or self._releases > 0

    def relinked(self, link: int = 0) -> None:
        """Somebody else, or the same one anew, is at the far end of a link."""
        self._routes[link].reset()

    # --- event --------------------------------------------------------------------------------

    def may_read(self, link: int) -> bool:
        """Whether another link than the first may be read once more before the next tick."""
        return self._routes[link].may_read()

    def has_more_tries(self, link: int) -> bool:
        """Whether a link may be read at all before the next tick."""
        return self._routes[link].tries_left > 0

    def is_waiting(self, link: int) -> bool:
        """Whether `event` is to be called once more, with no bytes: there was too much."""
        return self._routes[link].decoder.is_waiting

    def event(self, data: bytes, now_s: float, link: int = 0) -> bool:
        """Bytes have come from a link; whether there were messages that were accepted."""
        route = self._routes[link]
        if route is self._autopilot:
            self._piece = data if len(data) <= PIECE_BYTES else b""
        messages = route.take(data)
        for received in messages:
            route.received(received.source)
            route.match_version()
            if not route.greeted:
                self._greet(route)
            if type(received.message) in _STREAMED:
                self._measure(route, received, now_s)
            else:
                self._take(route, received, now_s)
        return len(messages) > 0

    def pose(self, data: bytes, sender: tuple[str, int], now_s: float) -> None:
        """A datagram has come from a motion-capture server, or from somebody who plays it."""
        if self.mocap is None:
            return
        now_s = self._clock(now_s)
        fix = self.mocap.take(data, sender, now_s)
        if fix is not None and (self._vehicle_clock or not self._lockstep):
            self.session.sources.take(MOCAP, fix, now_s, self.mocap.attitude)

    def _take(self, route: Route, received: Received, now_s: float) -> None:
        """Whatever does not come in a steady stream."""
        message = received.message
        session = self.session
        if isinstance(message, ParamSet | ParamRequestRead | ParamRequestList):
            self._answer(route, received, self._clock(now_s))
            return
        if isinstance(message, CommandLong | CommandInt):
            self._obey(route, received.source, message, self._clock(now_s))
            return
        if isinstance(message, FileTransferProtocol):
            self._refuse_files(route, received.source, message, self._clock(now_s))
            return
        if isinstance(message, SetupSigning):
            self._take_key(received.source, message, now_s)
            return
        if route is not self._autopilot and not isinstance(message, _FROM_ANYWHERE):
            return  # nobody else's measurements are flown with
        if isinstance(message, Heartbeat):
            if received.source == self._setup.own:
                self._meet_duplicate(message, self._clock(now_s))
                return
            self._meet(route, received.source, now_s)
        if isinstance(message, RcChannels):
            if received.source == session.autopilot:
                self._take_pilot_switch(message, self._clock(now_s))
            return
        if isinstance(message, VisionPositionEstimate) and route is self._autopilot:
            self._already_known(received.source)
        if self._vehicle_clock and received.source == session.autopilot:
            self._step_without_attitude(message)
        if route is self._autopilot or isinstance(message, Timesync | VisionPositionEstimate):
            self._say_all(session.handle(received, self._clock(now_s)), route)

    def _measure(self, route: Route, received: Received, now_s: float) -> None:
        """What the autopilot measures; nobody else's measurements are flown with."""
        if route is not self._autopilot:
            return
        session = self.session
        before = session.attitude
        session.handle(received, self._clock(now_s))
        attitude = session.attitude
        if attitude is before:
            return
        if not self._lockstep:
            self.pacer.sample(now_s, session.vehicle_time_s, attitude.time_s)
        elif isinstance(received.message, AttitudeQuaternion):
            self._step_with_vehicle()

    def _meet(self, route: Route, source: Source, now_s: float) -> None:
        """An operator's station that was away hears whether the module is engaged, and its mode."""
        if source.system not in self._setup.operators:
            return
        before = self._met.get((route.number, source), now_s)
        self._met[route.number, source] = now_s
        if now_s - before > ABSENT_S:
            self._say(self.parameters.value_message(INDEX["OP_ENGAGE"]), route)
            for chunk in self.texts.chunks(SEVERITY_INFO, autopilot.mode_name(self._mode)):
                self._spend(self._say(chunk, route))

    def _meet_duplicate(self, message: Heartbeat, now_s: float) -> None:
        """Another module with our identity: which of the two may be engaged (`presence`)."""
        presence = self.session.presence
        if not presence.take(message, now_s):
            return
        own = self._setup.own
        who = f"another module is system {own.system}, component {own.component}, too"
        if self._engage and (presence.duplicate_is_engaged or not self._active):
            both = " and engaged" if presence.duplicate_is_engaged else ""
            self._say(self.session.heartbeat())  # so that it hears of us before we are not engaged
            self.tell(SEVERITY_ERROR, f"disengaged: {who}{both}")
            self._disengage()
            self._tell_engagement(self._mode, ended=True)
        elif not 0.0 <= now_s - self._duplicate_told_s < DUPLICATE_TOLD_S:
            self._duplicate_told_s = now_s
            self.tell(SEVERITY_WARNING, f"{who}: {IDENTITY_REMEDY}")

    def _already_known(self, source: Source) -> None:
        """A bridge on the autopilot's own link speaks to it without us."""
        if self.forwarding is not None and source in accepted_bridges(
            self._setup.position, self._setup.own
        ):
            self.forwarding.known.add(VISION)

    def _answer(self, route: Route, received: Received, now_s: float) -> None:
        """Reading is answered where it was asked; a value that is set concerns every station."""
        server, setup = self.parameters, self._setup
        source, message = received
        if not isinstance(message, ParamSet):
            route.asked = True
            self._say_all(server.handle(source, message, now_s, flying=self._active), route)
            return
        engages = message.param_id == "OP_ENGAGE" and message.param_value >= 0.5
        refusal = self._forbidden(source) or (self._held_back(now_s) if engages else "")
        if engages and message.param_value == ENGAGED and not self._engage:
            refusal = refusal or "2 is what a module shows that has engaged: set 1"
        if message.param_id == "OP_RC_CHAN":
            refusal = refusal or switch_refusal(message.param_value, setup.surface_channels)
        if refusal:
            self._say_all(server.refuse(source, message, refusal, now_s))
            return
        refused = server.counters.refused
        said = server.handle(source, message, now_s, flying=self._active)
        accepted = bool(said) and server.counters.refused == refused
        if accepted and message.param_id == "OP_ENGAGE" and message.param_value == 0.0:
            self.engagement.clear()
        if server.values is not self._values:
            self._settings()
        self._say_all(said)

    # --- keys ---------------------------------------------------------------------------------

    def _take_key(self, source: Source, message: SetupSigning, now_s: float) -> None:
        """A key over the air: everybody who listens knows it from then on."""
        own = self._setup.own
        if message.target_system != own.system or message.target_component != own.component:
            return
        refusal = self._forbidden(source)
        if self._keep_key is None:
            refusal = "not over the air (--allow-setup-signing)"
        elif self._active:
            refusal = "not while flying"
        elif len(message.secret_key) != KEY_BYTES or not any(message.secret_key):
            refusal = "signing is not turned off over the air"
        elif not self.signing.may_begin_with(message.initial_timestamp):
            refusal = "initial_timestamp is years ahead: set the station's clock"
        if not refusal and self._keep_key is not None:
            try:
                self._keep_key(message.secret_key)
            except OSError as error:
                refusal = f"it cannot be kept: {error.strerror}"
        if not refusal:
            self.signing.replace_key(message.secret_key, message.initial_timestamp)
            self.tell(SEVERITY_WARNING, f"new signing key from system {source.system}")
        elif now_s - self._keys_refused_s > COMPLAIN_S:
            self._keys_refused_s = now_s
            self.tell(SEVERITY_WARNING, f"SETUP_SIGNING refused: {refusal}")

    # --- operators and the pilot --------------------------------------------------------------

    def _forbidden(self, source: Source) -> str:
        """Why a sender may neither set nor command; "" if it may."""
        if source.system in self._setup.operators:
            return ""
        return f"system {source.system} is not among autopilot.operators of the airframe file"

    def _held_back(self, now_s: float) -> str:
        """Why nobody can engage now; "" if it can be tried."""
        if self._mode == RELEASED:
            return "it has let go just now: try again"
        if self._mode == FAILED:
            return "it has failed: start it again"
        if not self._active and not self.session.presence.is_alone(now_s):
            return f"another module has our identity: {IDENTITY_REMEDY}"
        unheard = self.engagement.switch.missing(now_s, int(self._values["OP_RC_CHAN"]))
        if unheard:
            return f"the pilot's switch: {unheard}"
        return self.engagement.held_back() or self._unfit()

    def _unfit(self) -> str:
        """Why what stands is not to be flown with; "" once it flies, or by OP_FORCE."""
        values = self._values
        if self._engage or values["OP_FORCE"] != 0.0:
            return ""
        fault = self.parameters.line.fault(values) or self.session.inquiry.held_back()
        return f"{fault}; {OVERRIDE}" if fault else ""

    def _obey(
        self, route: Route, source: Source, message: CommandLong | CommandInt, now_s: float
    ) -> None:
        commands = self.commands
        if not commands.is_for_us(source, message):
            return
        held_back = self._held_back(now_s) if message.command == ENGAGE else ""
        answer = commands.handle(
            source, message, now_s, forbidden=self._forbidden(source), held_back=held_back
        )
        self._say_all(answer.outbound, route)
        if answer.reason and not 0.0 <= now_s - self._refused_s < REFUSALS_S:
            self._refused_s = now_s
            self.tell(SEVERITY_WARNING, f"command refused: {answer.reason}")
        if answer.wish != NOTHING:
            self._want(answer.wish, f"system {source.system}")

    def _refuse_files(
        self, route: Route, source: Source, message: FileTransferProtocol, now_s: float
    ) -> None:
        own = self._setup.own
        for_us = message.target_system in (0, own.system)
        if not for_us or message.target_component != own.component or source == own:
            return
        answer = file_transfer.refused(source, message)
        if answer is not None and self.commands.may_answer(now_s):
            self._say(answer, route)

    def _take_pilot_switch(self, message: RcChannels, now_s: float) -> None:
        values = self._values
        self.session.streams.received(ID_RC_CHANNELS)
        switch = self.engagement.switch
        was_low = switch.is_low
        wish = switch.take(
            message, now_s, int(values["OP_RC_CHAN"]), values["OP_RC_ON"], values["OP_RC_OFF"]
        )
        if wish == RELEASE and was_low and not self._engage:
            return  # a switch that stays low says nothing new
        if wish == ENGAGE and (held_back := self._held_back(now_s)):
            self.tell(SEVERITY_WARNING, f"the pilot's switch cannot engage: {held_back}")
        elif wish != NOTHING:
            self._want(wish, "the pilot's switch")

    def _watch_pilot_switch(self, now_s: float) -> None:
        """One that has fallen silent in flight: told, and after a while the engagement ends."""
        switch = self.engagement.switch
        unheard = switch.missing(now_s, int(self._values["OP_RC_CHAN"])) if self._engage else ""
        if unheard and switch.silence_s(now_s) > GONE_S:
            self.tell(SEVERITY_ERROR, f"disengaged: the pilot's switch is silent: {unheard}")
            self._disengage()
            self._tell_engagement(self._mode, ended=True)
        elif unheard and not self._switch_told:
            text = f"the pilot's switch is silent, disengaging in {GONE_S - SILENCE_S:g} s"
            self.tell(SEVERITY_WARNING, f"{text}: {unheard}")
        self._switch_told = unheard != ""

    def _want(self, wish: int, by: str) -> None:
        """Somebody who may has asked for it."""
        if wish == ABORT:
            self.engagement.abort(by)
            self.tell(SEVERITY_WARNING, f"aborted by {by}: no engagement until released")
        elif wish == RELEASE:
            self.engagement.clear()
        if wish == ENGAGE and self._engage:
            self._tell_engagement(self._mode)  # it flies already
        elif self._engage != (wish == ENGAGE):
            self._say_all(self.parameters.assign("OP_ENGAGE", float(wish == ENGAGE)))
            self._settings()
            self._console(f"{'engaged' if wish == ENGAGE else 'released'} by {by}")

    def _tell_engagement(self, mode: int, *, ended: bool = False) -> None:
        """Whoever has asked to engage hears how it goes.  `ended`: by the module itself."""
        for ack in self.commands.engagement(
            flying=is_flying(mode) and not ended,
            settled=mode == SOARING and not ended,
            withdrawn=mode in (BOOT, STANDBY, READY) and not ended,
        ):
            self._say_to(Source(ack.target_system, ack.target_component), ack)

    # --- settings -----------------------------------------------------------------------------

    def _settings(self) -> None:
        """The parameters have changed: the next tick flies with new laws."""
        engages = self.parameters.values["OP_ENGAGE"] >= 0.5 and not self._engage
        if engages and self.parameters.values["OP_FORCE"] != 0.0:  # it acts once
            self._say_all(self.parameters.assign("OP_FORCE", 0.0))
        values = self.parameters.values
        rate_hz = values["LOOP_RATE"]
        if rate_hz != self._values["LOOP_RATE"]:
            self.session.set_loop_rate(rate_hz)
            self.pacer.set_rate(rate_hz)
        self._values = values
        self._laws_stale = True
        self._op_engage = values["OP_ENGAGE"]
        self._engage = self._op_engage >= 0.5
        self._telemetry_bytes_per_s = values["TEL_BUDGET"]
        self._want_pilot_switch()

    def _renew_laws(self) -> None:
        """Before a tick, once for however many parameters were set since the last one."""
        self._laws_stale = False
        self._recorder.parameters(self._values)
        self._laws = laws_of(self._setup, self._values)
        self.counters.laws_changed += 1

    def _want_pilot_switch(self) -> None:
        """The stream of the pilot's channels, where one of them is a switch of ours."""
        if self._values["OP_RC_CHAN"] > 0.0:
            self.session.streams.want(ID_RC_CHANNELS, "RC_CHANNELS", PILOT_SWITCH_HZ, urgent=True)
        else:
            self.engagement.switch.reset()

    # --- periodic -----------------------------------------------------------------------------

    def due(self, now_s: float) -> bool:
        """Whether `periodic` is to be called."""
        return not self._lockstep and self.pacer.due(now_s)

    def overdue(self, now_s: float) -> bool:
        """Whether a tick can wait no longer, not even for what has come but was not read yet."""
        return not self._lockstep and now_s >= self.pacer.wake_s

    def wake_s(self, now_s: float) -> float:
        """When to look again if nothing arrives."""
        return now_s + IDLE_S if self._lockstep else self.pacer.wake_s

    @property
    def warm_up_s(self) -> float:
        """When to call `warm_up`; inf: not now."""
        if self._lockstep or self._warm_up is None or self.load_shedding.no_telemetry:
            return inf
        return self.pacer.warm_up_s

    def warm_up(self) -> None:
        """A tick once more, for nothing: the next one finds what it needs at hand.

        It is the last one with a new position, which has the most to do.  A tick of the laws is a
        function of its arguments; what it gives is thrown away.
        """
        if self._warm_up is None:
            return
        state, inputs, piece = self._warm_up
        decoder, encoder = self._warming_up
        decoder.feed(piece)
        _, output = autopilot.step(self._laws, state, inputs)
        if output.active and _is_finite_command(output, self._loops):
            for message in self._setup.flavour.commands(output.command, output.setpoints):
                _frame_of(message, encoder)

    def periodic(self, now_s: float) -> None:
        """One tick, then what is slow."""
        counters = self.pacer.counters
        late, skipped = counters.late, counters.skipped
        self._tick(self.pacer.tick(now_s))
        self.load_shedding.tick(counters, late, skipped)
        self._slow(now_s)
        self._report_overload(now_s)
        self._tell_slow_link(now_s)
        self._refill()

    def _refill(self) -> None:
        for route in self._routes:
            route.refill()

    def idle(self, now_s: float) -> None:
        """No tick was due.  Lockstep: nothing can come late, and other links are read on; before
        the first attitude we are here, and all else waits for its clock."""
        if self._lockstep:
            self._refill()
        if self._lockstep and not self._vehicle_clock:
            self._show_presence(now_s)
            if self.mocap is not None:
                self._ask_mocap(self.mocap, now_s)

    def _step_with_vehicle(self) -> None:
        """Lockstep: a tick at the vehicle's time."""
        now_s = self.session.vehicle_time_s
        if not self._vehicle_clock or self.session.counters.reboots != self._reboots:
            self._start_vehicle_clock(now_s)
        elif now_s <= self._stepped_s:
            return  # it comes late: time is further already
        self._attitude_stepped = True
        self._stepped_s = now_s
        self._tick(now_s)
        self._slow(now_s)

    def _step_without_attitude(self, message: object) -> None:
        """Lockstep: a TIMESYNC ends a step of the vehicle; a missing tick is made up for."""
        if not isinstance(message, Timesync) or message.tc1 != 0:
            return
        stamp_s = message.ts1 * 1e-9
        if self._attitude_stepped:
            self._attitude_stepped = False
            self._timesync_ahead_s = stamp_s - self._stepped_s
            return
        now_s = stamp_s - self._timesync_ahead_s
        if now_s - self._stepped_s >= MISSED_TICKS / self._values["LOOP_RATE"]:  # not for NaN
            self._stepped_s = now_s
            self._tick(now_s)
            self._slow(now_s)

    def _start_vehicle_clock(self, now_s: float) -> None:
        """From here on nothing depends on the wall clock, nor on what was before."""
        self._reboots = self.session.counters.reboots
        self._vehicle_clock = True
        self._stepped_s = now_s
        self.session.rebase(now_s)
        if self.mocap is not None:
            self.mocap.rebase()
        if self.forwarding is not None:
            self.forwarding.rebase()
        self.parameters.rebase()
        self.telemetry.rebase()
        self.commands.rebase()
        self.engagement.switch.reset()
        self._loss_due_s = self._engaged_s = now_s
        for route in self._routes:
            route.own.restart()
            route.override.restart()
        self._state = autopilot.initial_state()
        self._recorder.reset(self._state)
        if self._active:
            self._disengage()
        self._mode_change.stop()
        self._active = False
        self._releases = 0
        self._mode = self.session.presence.mode = BOOT

    def _tick(self, time_s: float) -> None:
        self.counters.ticks += 1
        if self._laws_stale:
            self._renew_laws()
        session, flavour = self.session, self._setup.flavour
        status = session.status
        if self._enters_mode and not self._active and not session.mismatch:
            self._enter_mode(time_s)
            status = status._replace(accepts_surfaces=True)  # it will, once it is asked
        inputs = Inputs(
            time_s=time_s,
            position=session.position,
            attitude=session.attitude,
            autopilot=status,
            engage=self._engage and not self._mode_change.is_changing,
            imu=session.imu,
            airspeed=session.airspeed,
            surfaces=session.surfaces,
        )
        warm_up_tick = self._warm_up
        if (
            warm_up_tick is None
            or inputs.position.sequence != warm_up_tick.inputs.position.sequence
        ):
            self._warm_up = WarmUp(self._state, inputs, self._piece)
        self._state, output = autopilot.step(self._laws, self._state, inputs)
        self.output = output
        if output.health.faults & (JUMP | WRONG):  # what else there is, the sources see themselves
            session.sources.distrust(time_s)
        if output.active and _is_finite_command(output, self._loops):
            self._command_surfaces(flavour.commands(output.command, output.setpoints))
            self.counters.surface_frames += 1
            self._releases = 0
        elif self._active and not output.active:
            self._releases = RELEASE_FRAMES
            self._release_due_s = time_s
            self._clear_for_release()
            if session.status.accepts_surfaces:
                self._mode_change.leave(time_s, session.status.time_s)
        if self._releases > 0 and time_s >= self._release_due_s:
            self._release_due_s = time_s + RELEASE_INTERVAL_S
            self._releases -= 1
            self._release()
        self._active = output.active
        if self.load_shedding.no_log:
            self._recorder.leave_out(time_s, self._state)
        else:
            self._recorder.tick(inputs, output, self._state)
        if output.mode != self._mode:
            self._mode_changed(output)

    def _enter_mode(self, time_s: float) -> None:
        """Engaged: the autopilot first has to come into the mode that obeys.

        Until then it hears what keeps the aircraft as it is: some firmwares enter only where
        setpoints stream already.
        """
        change, session = self._mode_change, self.session
        obeys, heard_s = session.status.accepts_surfaces, session.status.time_s
        if not self._engage and change.is_entering:
            change.leave(time_s, heard_s)  # it may have been asked for already
        asked = change.poll(time_s, heard_s, obeys, session.custom_mode)
        self._say_all(list(asked), self._autopilot)
        if change.failed:
            self.tell(SEVERITY_ERROR, change.failed)
            change.failed = ""
            if self._engage:
                self._disengage()
                self._tell_engagement(self._mode, ended=True)
        if self._engage and self._mode == READY and not obeys and not change.is_changing:
            change.enter(time_s, heard_s, session.custom_mode)
        if change.is_entering and self.output is not None:
            pitch_rad = self.output.vehicle.pitch_rad
            if isfinite(pitch_rad):
                level = Setpoints(pitch_rad, 0.0, 0.0)
                self._command_surfaces(self._setup.flavour.commands(SurfaceCommand(0, 0, 0), level))

    def _mode_changed(self, output: autopilot.Output) -> None:
        self._mode = self.session.presence.mode = output.mode
        self._say(self.session.heartbeat())
        changes = self.counters.mode_changes
        changes[output.mode] = changes.get(output.mode, 0) + 1
        severity = SEVERITY_INFO
        if output.mode in (HOLDING, RECOVERING):
            severity = SEVERITY_WARNING
        elif output.mode in (RELEASED, FAILED):
            severity = SEVERITY_ERROR
            if self._engage:
                self._disengage()
        reason = autopilot.reason_text(output.reason)
        name = autopilot.mode_name(output.mode)
        self.tell(severity, f"{name}: {reason}" if reason else name)
        if severity != SEVERITY_INFO and (words := autopilot.fault_text(output.health.faults)):
            self.tell(SEVERITY_WARNING, words)
        if not (self._engage and output.mode in (STANDBY, READY)):  # else it is on its way
            self._tell_engagement(output.mode)

    def _disengage(self) -> None:
        """The module let go by itself: the operator's switch goes back, for all to see."""
        self._say_all(self.parameters.assign("OP_ENGAGE", 0.0))
        self._settings()

    def _slow(self, now_s: float) -> None:
        """Whatever may wait until the surfaces have been sent."""
        session = self.session
        if self.signing.is_on:
            self.signing.advance(now_s)
        self._show_presence(now_s)
        self._say_all(session.poll(now_s), self._autopilot)
        if self.forwarding is not None:
            self._forward(self.forwarding, now_s)
        self._list_parameters(now_s)
        self._show_engaged(now_s)
        self._watch_pilot_switch(now_s)
        for ack in self.commands.poll(now_s):
            self._say_to(Source(ack.target_system, ack.target_component), ack)
        if self._store is not None:
            for text in self._store.poll(self._values, now_s):
                self.tell(SEVERITY_WARNING, text)
        for text in self._recorder.poll():
            self.tell(SEVERITY_WARNING, text)
        if self._first_words and session.has_heartbeat:
            for severity, text in self._first_words:
                self._say_words(severity, text)
            self._first_words.clear()
        if self.mocap is not None:
            self._ask_mocap(self.mocap, now_s)
        if session.notices:
            for severity, text in session.notices:
                self.tell(severity, text)
            session.notices.clear()
        if self.output is not None:
            self._measure_loss(now_s)
            self._panel.look(self.output, session.vehicle_time_s, self._loss, session.round_trip_s)
            message = self.telemetry.due(now_s, self._telemetry_bytes_per_s)
            if message is not None and self.load_shedding.no_telemetry:
                self.counters.telemetry_shed += 1
            elif message is not None:
                self._spend(self._say(message))

    def _ask_mocap(self, mocap: Optitrack, now_s: float) -> None:
        assert self._mocap_link is not None
        for request in mocap.poll(now_s):
            self._mocap_link.send(request)
        if mocap.stream is not None:
            self._mocap_link.follow(mocap.stream)
        for severity, text in mocap.notices:
            self.tell(severity, text)
        mocap.notices.clear()

    def _forward(self, forwarding: PoseForwarding, now_s: float) -> None:
        """The pose of a tracker, to the autopilot alone."""
        pose = forwarding.poll(self.session.sources, now_s)
        if pose is not None:
            self._say(pose, self._autopilot)
        for severity, text in forwarding.notices:
            self.tell(severity, text)
        forwarding.notices.clear()

    def _show_engaged(self, now_s: float) -> None:
        """OP_ENGAGE becomes what a file may hold and yet engage nothing; not before the station
        that has set 1 could see it confirmed."""
        if not self._active or self._op_engage != 1.0:
            self._engaged_s = now_s
        elif now_s - self._engaged_s >= SHOW_ENGAGED_S:
            self._say_all(self.parameters.assign("OP_ENGAGE", ENGAGED))
            self._settings()

    def _report_overload(self, now_s: float) -> None:
        """A computer that is too busy is told of, now and then."""
        late = self.pacer.counters.late + self.pacer.counters.skipped
        if (
            now_s < self._overload_reported_s + OVERLOAD_REPORT_S
            or not self.load_shedding.no_telemetry
        ):
            return
        if late - self._late_reported >= LATE_REPORTED:
            self._overload_reported_s = now_s
            self.tell(
                SEVERITY_WARNING, f"computer too busy: {late - self._late_reported} ticks late"
            )
            self._late_reported = late

    def _tell_slow_link(self, now_s: float) -> None:
        """A line that does not carry the commands is told of, now and then."""
        left_out = self.counters.left_out - self._left_out_told
        if now_s < self._slow_link_told_s + OVERLOAD_REPORT_S or left_out < LATE_REPORTED:
            return
        self._slow_link_told_s = now_s
        self._left_out_told = self.counters.left_out
        self.tell(
            SEVERITY_WARNING,
            f"link too slow: {left_out} commands left out; raise its baud rate or lower LOOP_RATE",
        )

    def _list_parameters(self, now_s: float) -> None:
        """Values go out where somebody has asked for any."""
        if not self.parameters.is_busy:
            for route in self._routes:
                route.asked = False
            return
        said = self.parameters.poll(now_s)
        for route in self._routes:
            if route.asked:
                self._say_all(said, route)
                route.asked = self.parameters.is_busy

    # --- telemetry ----------------------------------------------------------------------------

    def _measure_loss(self, now_s: float) -> None:
        """How much of what the autopilot sent was lost of late."""
        if now_s < self._loss_due_s:
            return
        self._loss_due_s = now_s + LOSS_S
        counters = self._autopilot.decoder.counters
        watched, lost = self._loss_counted
        self._loss_counted = counters.watched, counters.lost
        came, missed = counters.watched - watched, max(0, counters.lost - lost)
        self._loss = missed / (came + missed) if came + missed else 0.0
        ticks = self.pacer.counters
        self._recorder.link(
            LinkReport(
                loss=self._loss,
                round_trip_s=self.session.round_trip_s,
                frames=counters.frames,
                bad_checksums=counters.bad_checksums,
                unsent=self.counters.unsent,
                late=ticks.late,
                skipped=ticks.skipped,
                over_run=ticks.over_run,
                worst_late_s=ticks.worst_late_s,
            )
        )

    def _spend(self, size: int) -> None:
        self.telemetry.budget.spend(size, self._telemetry_bytes_per_s)

    # --- speaking -----------------------------------------------------------------------------

    def tell(self, severity: int, text: str) -> None:
        """Words for the operator, over the link and on the console."""
        self._console(text)
        self._recorder.text(severity, text)
        self._say_words(severity, text)

    def _say_words(self, severity: int, text: str) -> None:
        for chunk in self.texts.chunks(severity, text):
            self._spend(self._say(chunk))

    def stop(self) -> None:
        """The process ends: give the surfaces back, and say so."""
        parting = self._mode_change.parting(obeys=self.session.status.accepts_surfaces)
        if self._active or self._releases or self._mode_change.is_changing:
            self._clear_for_release()
            for _ in range(RELEASE_FRAMES):
                self._release()
                self._say_all(list(parting), self._autopilot)
        self._active = False
        self._releases = 0
        self.tell(SEVERITY_NOTICE, "tgl_soar stopped")
        if self._store is not None:
            for text in self._store.stop(self._values):
                self._console(text)

    def _show_presence(self, now_s: float) -> None:
        """Our heartbeat, where it is due."""
        due = self.session.heartbeat_if_due(now_s)
        for route in self._routes:
            if not route.greeted:
                self._greet(route)
            else:
                for heartbeat in due:
                    self._say(heartbeat, route)

    def _greet(self, route: Route) -> None:
        """Our heartbeat, before anything else is said on this link."""
        route.greeted = route.send(route.own.encode(self.session.heartbeat()))

    def _release(self) -> int:
        """Hand the surfaces over once; the bytes of it."""
        self.counters.release_frames += 1
        return self._say_surfaces(self._setup.flavour.release())

    def _clear_for_release(self) -> None:
        """What is still on its way is older.  A frame that was cut takes what comes behind it for
        its own end, up to its length: so releases go out at once until even the longest frame has
        ended, and one more after it."""
        if self._autopilot.clear_for_release():
            swallowed = 0
            while swallowed < LONGEST_FRAME:
                swallowed += self._release() or LONGEST_FRAME
            self._release()

    def _say_surfaces(self, messages: tuple[Outbound, ...]) -> int:
        route = self._autopilot
        return sum([self._send_frame(route, route.override, message) for message in messages])

    def _command_surfaces(self, messages: tuple[Outbound, ...]) -> None:
        """What a tick asks for, if it goes at once; else the next tick's is newer."""
        route = self._autopilot
        for message in messages:
            frame = _frame_of(message, route.override) if route.greeted else b""
            if frame is None:
                self.counters.unsendable += 1
            elif frame and route.send_command(frame):
                self._recorder.frame(frame)
            elif frame:
                self.counters.unsent += 1
                self.counters.left_out += 1

    def _say_all(self, messages: list[Outbound], route: Route | None = None) -> None:
        for message in messages:
            self._say(message, route)

    def _say_to(self, source: Source, message: Outbound) -> None:
        """On the links where somebody was heard."""
        for route in self._routes:
            if route.leads_to(source):
                self._say(message, route)

    def _say(self, message: Outbound, only: Route | None = None) -> int:
        """On one link, or on all; the bytes that one link carries."""
        size = 0
        for route in self._routes if only is None else (only,):
            size = max(size, self._send_frame(route, route.own, message))
        return size

    def _send_frame(self, route: Route, encoder: Encoder, message: Outbound) -> int:
        if not route.greeted:
            return 0
        frame = _frame_of(message, encoder)
        if frame is None:
            self.counters.unsendable += 1
            return 0
        if frame:
            if not route.send(frame):
                self.counters.unsent += 1
            self._recorder.frame(frame)
        return len(frame)

    def _clock(self, now_s: float) -> float:
        """The loop's time."""
        return self._stepped_s if self._vehicle_clock else now_s


# What brings measurements and nothing else: the session takes it and has no answer.
_STREAMED: Final = frozenset(
    (
        AttitudeQuaternion,
        RawImu,
        ScaledImu,
        HighresImu,
        LocalPositionNed,
        GlobalPositionInt,
        Odometry,
        ServoOutputRaw,
        VfrHud,
        SysStatus,
    )
)

# Whom the session looks at itself: a bridge whose positions are believed may sit on any link.
_FROM_ANYWHERE: Final = Timesync | Heartbeat | VisionPositionEstimate


def _nowhere(_text: str) -> None:
    """Words that nobody asked for."""


def _frame_of(message: Outbound, encoder: Encoder) -> bytes | None:
    """A message as it goes out; None: a field does not fit its place."""
    try:
        return encoder.encode(message)
    except (struct.error, OverflowError, ValueError, TypeError):
        return None


def _is_finite_command(output: autopilot.Output, loops: int) -> bool:
    """Whether all that a route says of a tick are numbers."""
    if loops == OURS:
        return is_finite(output.command)
    rudder_rad = output.command.rudder if loops != THEIRS else 0.0
    return isfinite(output.setpoints.pitch_rad + output.setpoints.roll_rad + rudder_rad)

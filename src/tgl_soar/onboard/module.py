"""The module as it flies: init, event, periodic and settings.

    init      identities, laws and session from an airframe, a site and parameters (`setup`)
    event     bytes have come: decode, take in measurements, answer the operator (`operators`)
    periodic  a tick is due (`clocking`): inputs -> autopilot.step -> surfaces, then what is slow
    settings  a parameter has changed: new laws before the next tick (`settings`)

`Onboard` has neither socket nor clock: bytes and time are arguments, frames go out through a
function.  `process` opens the links, `loop` waits, and calls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Final, NamedTuple

from tgl_soar import __version__, autopilot
from tgl_soar.config.parameter_store import ParameterStore
from tgl_soar.control.supervisor import (
    BOOT,
    FAILED,
    READY,
    RELEASED,
    STANDBY,
)
from tgl_soar.estimation.health import JUMP, WRONG
from tgl_soar.link.commands import CommandServer
from tgl_soar.link.engagement import Engagement
from tgl_soar.link.messages import (
    SEVERITY_NOTICE,
    AttitudeQuaternion,
    GlobalPositionInt,
    Heartbeat,
    HighresImu,
    LocalPositionNed,
    Odometry,
    RawImu,
    RcChannels,
    Received,
    ScaledImu,
    ServoOutputRaw,
    SetupSigning,
    SysStatus,
    Timesync,
    VfrHud,
    VisionPositionEstimate,
)
from tgl_soar.link.routing import Route
from tgl_soar.link.signing import Signing
from tgl_soar.link.telemetry import Telemetry
from tgl_soar.onboard.clocking import NO_TICK, RESTART, Clocking
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.engage_switch import EngageSwitch
from tgl_soar.onboard.external_positions import OutsidePositions
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER, Recorder
from tgl_soar.onboard.links import ModuleLinks
from tgl_soar.onboard.operators import Operators
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.reports import Reports, mode_words, start_faults
from tgl_soar.onboard.search_switch import SearchEngine
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup, session_of
from tgl_soar.onboard.surface_control import SurfaceControl
from tgl_soar.onboard.switches import Switches
from tgl_soar.onboard.telemetry_values import HELD_BACK, Panel
from tgl_soar.onboard.warm_up import WarmUps
from tgl_soar.types import NAN, Inputs

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

# The session looks at their sender itself: an accepted bridge may be on any link.
_FROM_ANYWHERE: Final = Timesync | Heartbeat | VisionPositionEstimate


def _nothing() -> None:
    """What is called before the first command, where nothing is to be done."""


class ModuleOptions(NamedTuple):
    """What the module has around it, beside its set-up."""

    # The link to the autopilot; the functions as `Route` takes them.
    stream: bool = False  # it may cut frames anywhere
    send_command: Callable[[bytes], bool] | None = None
    clear_for_release: Callable[[], bool] | None = None
    before_first: Callable[[], None] = _nothing  # called before a frame first takes the surfaces
    # Time, and who else is there.
    lockstep: bool = False
    start: int = 1  # tells it from another one that was given the same identity by mistake
    # Keys: without `signing` nothing is signed.
    signing: Signing | None = None
    unsigned_autopilot: bool = False  # the autopilot itself need not sign on its own link
    # Keeps a key that came over the air, or raises OSError; without it none is accepted.
    keep_key: Callable[[bytes], None] | None = None
    # What is reported, kept and looked for.
    console: Callable[[str], None] | None = None  # where words go locally
    first_words: Sequence[tuple[int, str]] = ()  # once the autopilot is received
    store: ParameterStore | None = None  # keeps changed parameters
    recorder: Recorder = NO_RECORDER  # is given all that a log holds
    search: SearchEngine | None = None  # looks for lift


ALONE: Final = ModuleOptions()


class Onboard:
    """The module without its sockets."""

    # --- init ---------------------------------------------------------------------------------

    def __init__(
        self,
        setup: ModuleSetup,
        send: Callable[[bytes], bool],
        now_s: float,
        options: ModuleOptions = ALONE,
    ) -> None:
        """`send`: over the link to the autopilot."""
        lockstep, recorder = options.lockstep, options.recorder
        self.setup, self._recorder, self.counters = setup, recorder, Counters()
        # What a tick goes on from, and the last one.
        self._state = autopilot.initial_state()
        self._inputs: Inputs | None = None
        self.output: autopilot.Output | None = None
        self._slow_s = now_s
        # The autopilot, and time.
        self.session = session_of(setup, lockstep=lockstep, start=options.start)
        self.signing = options.signing or Signing(None, 0.0, 0.0)
        self.clocking = Clocking(setup.parameters["LOOP_RATE"], now_s, lockstep=lockstep)
        self.pacer, self.load_shedding = self.clocking.pacer, self.clocking.load_shedding
        # What is sent, and over which links.
        panel = Panel(setup.frame, self._entry_lacks)
        self._telemetry = Telemetry(panel.flows())
        self.outbox = outbox = Outbox(self.counters, recorder, self._telemetry, options.console)
        unsigned = options.unsigned_autopilot
        self.links = ModuleLinks(
            setup, self.session, self.signing, outbox, recorder, unsigned_autopilot=unsigned
        )
        first = self.links.add(
            send,
            stream=options.stream,
            send_command=options.send_command,
            clear_for_release=options.clear_for_release,
        )
        self.decoder = first.decoder  # of the link to the autopilot
        self.decoder.watch(self.session.autopilot)
        self._serve(panel, options, now_s)

    def _serve(self, panel: Panel, options: ModuleOptions, now_s: float) -> None:
        """What is flown with, what moves the surfaces, and who may ask for what."""
        setup, session, outbox = self.setup, self.session, self.outbox
        recorder, counters, engagement = options.recorder, self.counters, Engagement()
        self.settings = settings = FlightSettings(
            setup, session, self.pacer, engagement, outbox, recorder, counters
        )
        self.parameters = settings.server
        recorder.reset(self._state)
        self._surfaces = surfaces = SurfaceControl(
            setup.flavour, outbox, counters, options.before_first
        )
        self.warm_ups = WarmUps(setup.flavour, setup.override)
        self.positions = OutsidePositions(setup, session, self.clocking, outbox)
        commands = CommandServer(setup.own, self._telemetry, _version())
        self.engage_switch = EngageSwitch(
            setup.own, settings, session, engagement, commands, surfaces, outbox, now_s
        )
        self._switches = Switches(setup, settings, session, outbox, options.search)
        self._operators = Operators(
            setup,
            settings,
            commands,
            engage_switch=self.engage_switch,
            switches=self._switches,
            surfaces=surfaces,
            outbox=outbox,
            signing=self.signing,
            keep_key=options.keep_key,
        )
        words = [*options.first_words, *start_faults(settings, self.signing)]
        self._reports = Reports(
            session, self.clocking, self.links, outbox, panel, recorder, options.store, words
        )

    def add_link(self, send: Callable[[bytes], bool], *, stream: bool = False) -> int:
        """One more link; its number.  The first leads to the autopilot."""
        return self.links.add(send, stream=stream).number

    @property
    def has_surfaces(self) -> bool:
        """Whether surfaces are commanded or being handed over, or their mode is being changed."""
        return self._surfaces.in_control

    def relinked(self, link: int = 0) -> None:
        """Somebody else, or the same one after a pause, is at the far end of a link."""
        self.outbox.routes[link].reset()

    # --- event --------------------------------------------------------------------------------

    def event(self, data: bytes, now_s: float, link: int = 0) -> bool:
        """Bytes have come from a link; whether there were messages that were accepted."""
        route = self.outbox.routes[link]
        if link == 0:
            self.warm_ups.received(data)
        messages = route.take(data)
        for received in messages:
            route.received(received.source)
            route.match_version()
            if not route.greeted:
                self.links.greet(route)
            if type(received.message) in _STREAMED:
                self._measure(route, received, now_s)
            else:
                self._take(route, received, now_s)
        return len(messages) > 0

    def _take(self, route: Route, received: Received, now_s: float) -> None:
        """Whatever does not come in a steady stream."""
        source, message = received
        session, clocking = self.session, self.clocking
        if isinstance(message, SetupSigning):
            self._operators.take_key(source, message, now_s)
            return
        if self._operators.take(route, received, clocking.now_s(now_s)):
            return
        if route.number != 0 and not isinstance(message, _FROM_ANYWHERE):
            return  # nobody else's measurements are flown with
        if isinstance(message, Heartbeat):
            if source == self.setup.own:
                self.engage_switch.meet_duplicate(message, clocking.now_s(now_s))
                return
            self._operators.meet(route, source, now_s)
        if isinstance(message, RcChannels):
            if source == session.autopilot:
                self.engage_switch.take_pilot_switch(message, clocking.now_s(now_s))
            return
        if isinstance(message, VisionPositionEstimate) and route.number == 0:
            self.positions.vision(source)
        if (
            clocking.by_vehicle
            and source == session.autopilot
            and isinstance(message, Timesync)
            and clocking.timesync(message, self.settings.values["LOOP_RATE"])
        ):
            self._tick_in_lockstep()  # in the place of one whose attitude is missing
        if route.number == 0 or isinstance(message, Timesync | VisionPositionEstimate):
            self.outbox.say_all(session.handle(received, clocking.now_s(now_s)), route)

    def _measure(self, route: Route, received: Received, now_s: float) -> None:
        """What the autopilot measures; nobody else's measurements are flown with."""
        if route.number != 0:
            return
        session, clocking = self.session, self.clocking
        before = session.attitude
        session.handle(received, clocking.now_s(now_s))
        is_new = session.attitude is not before
        if is_new and not clocking.lockstep:
            self.pacer.sample(now_s, session.vehicle_time_s, session.attitude.time_s)
        elif is_new and isinstance(received.message, AttitudeQuaternion):
            asked = clocking.attitude(session.vehicle_time_s, session.counters.reboots)
            if asked != NO_TICK:
                self._tick_in_lockstep(restarts=asked == RESTART)

    # --- periodic -----------------------------------------------------------------------------

    @property
    def warm_up_s(self) -> float:
        """When to call `warm_up`; inf: not now."""
        return inf if self.warm_ups.kept is None else self.clocking.warm_up_s

    def warm_up(self) -> None:
        """A tick once more, for nothing: the next one finds what it needs at hand."""
        self.warm_ups.run(self.settings.laws)

    def periodic(self, now_s: float) -> None:
        """One tick, then what is slow."""
        counters = self.pacer.counters
        late, skipped = counters.late, counters.skipped
        self.tick(self.pacer.tick(now_s))
        self.load_shedding.tick(counters, late, skipped)
        self._slow(now_s)
        self._reports.tell_load(now_s, self.counters.left_out)
        self.links.refill()

    def idle(self, now_s: float) -> None:
        """No tick was due.  Lockstep: nothing can come late, and other links are read on; before
        the first attitude we are here, and all else waits for its clock."""
        if not self.clocking.lockstep:
            return
        self.links.refill()
        if not self.clocking.by_vehicle:
            self.links.show_presence(now_s)
            self.positions.ask(now_s)

    def tick(self, time_s: float) -> None:
        """What has been measured becomes what the surfaces do."""
        self.counters.ticks += 1
        self.settings.renew_laws()
        session, surfaces, status = self.session, self._surfaces, self.session.status
        if surfaces.enters_mode and not surfaces.is_active and not session.mismatch:
            self._change_mode(time_s)
            status = status._replace(accepts_surfaces=True)  # it will, once it is asked
        inputs = Inputs(
            time_s=time_s,
            position=session.position,
            attitude=self.positions.attitude(time_s),
            autopilot=status,
            engage=self.settings.engage and not surfaces.mode_change.is_changing,
            imu=session.imu,
            airspeed=session.airspeed,
            surfaces=session.surfaces,
            rangefinder=session.rangefinder,
        )
        self.warm_ups.keep(self._state, inputs)
        self._state, output = autopilot.step(self.settings.laws, self._state, inputs)
        self._inputs, self.output = inputs, output
        if output.health.faults & (JUMP | WRONG):  # what else there is, the sources see themselves
            session.sources.distrust(time_s)
        surfaces.tick(output, time_s, session.status)
        if self.load_shedding.no_log:
            self._recorder.leave_out(time_s, self._state)
        else:
            self._recorder.tick(inputs, output, self._state)
        if output.mode != session.presence.mode:
            self._mode_changed(output, time_s)
        self._switches.tick(output)

    def _change_mode(self, time_s: float) -> None:
        """Engaged: the autopilot first has to come into the mode that obeys."""
        failure = self._surfaces.change_mode(
            time_s,
            self.session,
            engage=self.settings.engage,
            ready=self.session.presence.mode == READY,
            pitch_rad=NAN if self.output is None else self.output.vehicle.pitch_rad,
        )
        if failure:
            self.engage_switch.mode_change_failed(failure, time_s)

    def _mode_changed(self, output: autopilot.Output, time_s: float) -> None:
        if output.mode in (RELEASED, FAILED) and self.settings.engage:
            self.engage_switch.turn_back(time_s)
        self.session.presence.mode = output.mode
        self.outbox.say(self.session.heartbeat())
        self.counters.count_mode(output.mode)
        self.outbox.tell_all(mode_words(output))
        if not (self.settings.engage and output.mode in (STANDBY, READY)):  # else on its way
            self.engage_switch.report_progress()

    def _slow(self, now_s: float) -> None:
        """Whatever may wait until the surfaces have been sent."""
        session, outbox = self.session, self.outbox
        self._slow_s = now_s
        if self.signing.is_on:
            self.signing.advance(now_s)
        self.links.show_presence(now_s)
        outbox.say_all(session.poll(now_s), outbox.autopilot)
        self.positions.forward(now_s)
        self._operators.serve(now_s, sheds=self.load_shedding.no_telemetry)
        self.engage_switch.watch(now_s)
        self._operators.acknowledge(now_s)
        self._reports.tell_words(now_s, self.settings.values)
        self.positions.ask(now_s)
        outbox.tell_all(session.notices)
        if self.output is not None:
            self._reports.show(self.output, now_s, self.counters, self.settings.values)

    def _entry_lacks(self) -> int:
        """What engaging lacks now, as bits: the supervisor's conditions, and `HELD_BACK`."""
        inputs, output = self._inputs, self.output
        if inputs is None or output is None:
            return 0
        held_back = HELD_BACK if self.engage_switch.refusal(self._slow_s) else 0
        return held_back | autopilot.entry_lacks(self.settings.laws, self._state, inputs, output)

    # --- lockstep -----------------------------------------------------------------------------

    def _tick_in_lockstep(self, *, restarts: bool = False) -> None:
        """A tick at the vehicle's time.  `restarts`: that begins now, or has begun again."""
        now_s = self.clocking.stepped_s
        if restarts:
            self._restart(now_s)
        self.tick(now_s)
        self._slow(now_s)

    def _restart(self, now_s: float) -> None:
        """From here on nothing depends on the wall clock, nor on what was before."""
        self.session.rebase(now_s)
        self.positions.restart()
        self._telemetry.rebase()
        self._operators.restart(now_s)
        self.engage_switch.restart(now_s)
        self.links.restart(now_s)
        self._state = autopilot.initial_state()
        self._recorder.reset(self._state)
        if self._surfaces.is_active:
            self.settings.assign("OP_ENGAGE", 0.0)
        self._surfaces.restart()
        self.session.presence.mode = BOOT

    def stop(self) -> None:
        """The process ends: hand over, and say so."""
        self._surfaces.stop(obeys=self.session.status.accepts_surfaces)
        self.outbox.tell(SEVERITY_NOTICE, "tgl_soar stopped")


def _version() -> tuple[int, int, int]:
    major, minor, patch = (int(part) for part in __version__.split(".")[:3])
    return major, minor, patch

"""The module as it flies: init, event, periodic and settings, and the process around them.

    init      identities, laws and session from an airframe, a site and parameters
    event     bytes have come: decode, take in measurements, answer the operator
    periodic  a tick is due: inputs -> autopilot.step -> surfaces, then whatever is slow
    settings  a parameter has changed: new laws before the next tick

`Onboard` has neither socket nor clock: bytes and time are arguments, frames go out through a
function.  `run` is the process: it opens the link, waits, and calls.

Two ways to keep time.  On an aircraft the loop's clock is this computer's and `realtime.Pacer`
says when to tick.  In lockstep the loop's clock is the vehicle's: each new ATTITUDE_QUATERNION
is exactly one tick at its own time stamp, and as everything is handled in the order in which it
came, the answer to a TIMESYNC tells the simulator that all before it is done.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import degrees, isfinite
from pathlib import Path
from typing import Final, NamedTuple

from tgl_soar import autopilot, realtime
from tgl_soar.config import (
    Airframe,
    ConfigError,
    Site,
    Surface,
    load_airframe,
    load_parameters,
    load_site,
)
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import Flavour, SurfaceChannel, SurfaceChannels
from tgl_soar.link.autopilots.bridge import Bridge
from tgl_soar.link.codec import Decoder, Encoder, starts_with_frame
from tgl_soar.link.messages import (
    SEVERITY_ERROR,
    SEVERITY_INFO,
    SEVERITY_NOTICE,
    AttitudeQuaternion,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Received,
    Said,
    Source,
)
from tgl_soar.link.parameters import ParameterServer
from tgl_soar.link.session import Session
from tgl_soar.link.telemetry import NamedValues, StatusTexts
from tgl_soar.link.transport import FORMS, LinkError, Transport, open_link
from tgl_soar.parameters import ParameterSet
from tgl_soar.types import Inputs, SurfaceCommand

STANDBY: Final = 0  # modes as the supervisor numbers them; a test holds the two together
RELEASED: Final = 4
RELEASE_FRAMES: Final = 5  # a lost frame must not leave the aircraft to the overrides' time-out
RELEASE_INTERVAL_S: Final = 0.1
TELEMETRY_HZ: Final = 5.0
TELEMETRY_NAMES: Final = (
    "e_rho",
    "soar_x",
    "soar_z",
    "pitch_sp",
    "soar_mode",
    "line_x",
    "line_z",
    "line_lean",
)
COMPLAIN_S: Final = 5.0  # between two lines on the console about an autopilot that is not there
IDLE_S: Final = 0.05  # how often to look around while nothing sets the pace

EXIT_OK: Final = 0
EXIT_CANNOT_START: Final = 2
EXIT_NO_AUTOPILOT: Final = 3


class Setup(NamedTuple):
    """What the module needs to know of an airframe and a site."""

    own: Source
    override: Source  # the sender that the autopilot obeys
    flavour: Flavour
    frame: SoaringFrame
    parameters: ParameterSet


@dataclass(slots=True)
class Counters:
    """What the module did; the parts have counters of their own."""

    ticks: int = 0
    surface_frames: int = 0
    release_frames: int = 0
    unsent: int = 0  # frames that the link did not take
    unsendable: int = 0  # messages that could not be packed: a mistake of ours
    laws_changed: int = 0
    mode_changes: dict[int, int] = field(default_factory=dict)  # by the new mode


def setup_from(airframe: Airframe, site: Site, parameters: ParameterSet) -> Setup:
    """Configuration files' contents as the flying module takes them."""
    link = airframe.autopilot
    surfaces = airframe.surfaces
    channels = SurfaceChannels(
        _channel(surfaces.elevator), _channel(surfaces.aileron), _channel(surfaces.rudder)
    )
    if parameters["OP_ENGAGE"] != 0.0:  # a restarted module must never engage by itself
        parameters = parameters.changed({"OP_ENGAGE": 0.0})
    kind = Bridge if link.firmware == "bridge" else ArduPilot
    return Setup(
        Source(link.system_id, link.component_id),
        Source(link.override_system_id, link.component_id),
        kind(channels, link.system_id),
        site.frame(),
        parameters,
    )


def _channel(surface: Surface) -> SurfaceChannel:
    return SurfaceChannel(
        surface.channel, surface.pwm_min, surface.pwm_trim, surface.pwm_max, surface.reversed
    )


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
    ) -> None:
        """`stream`: the link may cut frames anywhere.  `console`: where words go locally."""
        self.counters = Counters()
        self.decoder = Decoder(stream=stream)
        self.texts = StatusTexts()
        self.parameters = ParameterServer(setup.own, setup.parameters, self.texts)
        rate_hz = setup.parameters["LOOP_RATE"]
        self.session = Session(
            setup.own,
            setup.flavour,
            rate_hz,
            override_system=setup.override.system,
            lockstep=lockstep,
        )
        self.pacer = realtime.Pacer(rate_hz, now_s)
        self.output: autopilot.Output | None = None  # of the last tick

        self._setup = setup
        self._send = send
        self._console = console or _nowhere
        self._own = Encoder(setup.own)
        self._override = Encoder(setup.override)
        self._lockstep = lockstep
        self._vehicle_clock = False  # lockstep, and the first attitude has come
        self._greeted = False  # our heartbeat has gone out on this link
        self._values = setup.parameters
        self._laws = autopilot.laws_from(setup.parameters, setup.frame)
        self._engage = setup.parameters["OP_ENGAGE"] >= 0.5
        self._state = autopilot.initial_state()
        self._mode = STANDBY
        self._active = False
        self._releases = 0
        self._release_due_s = 0.0
        self._telemetry = NamedValues(TELEMETRY_NAMES, TELEMETRY_HZ)
        self._reboots = 0

    def relinked(self) -> None:
        """Somebody else, or the same one anew, is at the far end of the link."""
        self.decoder.reset()
        self._greeted = False

    # --- event --------------------------------------------------------------------------------

    def event(self, data: bytes, now_s: float) -> None:
        """Bytes have come from the link."""
        for received in self.decoder.feed(data):
            if not self._greeted:
                self._greet()
            self._take(received, now_s)

    def _take(self, received: Received, now_s: float) -> None:
        message = received.message
        session = self.session
        if isinstance(message, ParamSet | ParamRequestRead | ParamRequestList):
            self._answer(received, self._clock(now_s))
            return
        sequence = session.attitude.sequence
        self._say_all(session.handle(received, self._clock(now_s)))
        if session.attitude.sequence == sequence:
            return
        if not self._lockstep:
            self.pacer.sample(now_s, session.vehicle_time_s, session.attitude.time_s)
        elif isinstance(message, AttitudeQuaternion):
            self._step_with_vehicle()

    def _answer(self, received: Received, now_s: float) -> None:
        server = self.parameters
        said = server.handle(received.source, received.message, now_s, flying=self._active)
        if server.values is not self._values:
            self._settings()
        self._say_all(said)

    # --- settings -----------------------------------------------------------------------------

    def _settings(self) -> None:
        """The parameters have changed: the next tick flies with new laws."""
        values = self.parameters.values
        rate_hz = values["LOOP_RATE"]
        if rate_hz != self._values["LOOP_RATE"]:
            self.session.set_loop_rate(rate_hz)
            self.pacer.set_rate(rate_hz)
        self._values = values
        self._laws = autopilot.laws_from(values, self._setup.frame)
        self._engage = values["OP_ENGAGE"] >= 0.5
        self.counters.laws_changed += 1

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

    def periodic(self, now_s: float) -> None:
        """One tick, then what is slow."""
        self._tick(self.pacer.tick(now_s))
        self._slow(now_s)

    def idle(self, now_s: float) -> None:
        """Lockstep before the first attitude: nothing but the wall clock moves yet."""
        if self._lockstep and not self._vehicle_clock:
            self._slow(now_s)

    def _step_with_vehicle(self) -> None:
        """Lockstep: a tick at the vehicle's time."""
        now_s = self.session.vehicle_time_s
        if not self._vehicle_clock or self.session.counters.reboots != self._reboots:
            self._start_vehicle_clock(now_s)
        self._tick(now_s)
        self._slow(now_s)

    def _start_vehicle_clock(self, now_s: float) -> None:
        """From here on nothing depends on the wall clock, nor on what was before."""
        self._reboots = self.session.counters.reboots
        self._vehicle_clock = True
        self.session.rebase(now_s)
        self.parameters.rebase()
        self._telemetry.rebase()
        self._own.restart()
        self._override.restart()
        self._state = autopilot.initial_state()
        if self._active:
            self._disengage()
        self._active = False
        self._releases = 0
        self._mode = STANDBY

    def _tick(self, time_s: float) -> None:
        self.counters.ticks += 1
        session = self.session
        inputs = Inputs(time_s, session.position, session.attitude, session.status, self._engage)
        self._state, output = autopilot.step(self._laws, self._state, inputs)
        self.output = output
        if output.active and _is_finite(output.command):
            self._say_surfaces(self._setup.flavour.surfaces(output.command))
            self.counters.surface_frames += 1
            self._releases = 0
        elif self._active and not output.active:
            self._releases = RELEASE_FRAMES
            self._release_due_s = time_s
        if self._releases > 0 and time_s >= self._release_due_s:
            self._release_due_s = time_s + RELEASE_INTERVAL_S
            self._releases -= 1
            self._release()
        self._active = output.active
        if output.mode != self._mode:
            self._mode_changed(output)

    def _mode_changed(self, output: autopilot.Output) -> None:
        self._mode = output.mode
        changes = self.counters.mode_changes
        changes[output.mode] = changes.get(output.mode, 0) + 1
        severity = SEVERITY_INFO
        if output.mode == RELEASED:
            severity = SEVERITY_ERROR
            if self._engage:
                self._disengage()
        reason = autopilot.reason_text(output.reason)
        name = autopilot.mode_name(output.mode)
        self.tell(severity, f"{name}: {reason}" if reason else name)

    def _disengage(self) -> None:
        """The module let go by itself: the operator's switch goes back, for all to see."""
        self._say_all(self.parameters.assign("OP_ENGAGE", 0.0))
        self._settings()

    def _slow(self, now_s: float) -> None:
        """Whatever may wait until the surfaces have been sent."""
        session = self.session
        said = session.poll(now_s)
        if not self._greeted:
            self._greet()
        else:
            self._say_all(said)
        self._say_all(self.parameters.poll(now_s))
        for severity, text in session.notices:
            self.tell(severity, text)
        session.notices.clear()
        if self.output is not None:
            turn = self._telemetry.due(now_s)
            if turn is not None:
                self._say(
                    self._telemetry.message(
                        turn, session.vehicle_time_s, _telemetry_value(self.output, turn)
                    )
                )

    # --- speaking -----------------------------------------------------------------------------

    def tell(self, severity: int, text: str) -> None:
        """Words for the operator, over the link and on the console."""
        self._console(text)
        for chunk in self.texts.chunks(severity, text):
            self._say(chunk)

    def stop(self) -> None:
        """The process ends: give the surfaces back, and say so."""
        if self._active or self._releases:
            for _ in range(RELEASE_FRAMES):
                self._release()
        self._active = False
        self._releases = 0
        self.tell(SEVERITY_NOTICE, "tgl_soar stopped")

    def _greet(self) -> None:
        """Our heartbeat, before anything else is said on this link."""
        self._greeted = self._send(self._own.encode(self.session.heartbeat()))

    def _release(self) -> None:
        self._say_surfaces(self._setup.flavour.release())
        self.counters.release_frames += 1

    def _say_surfaces(self, messages: tuple[Said, ...]) -> None:
        for message in messages:
            self._send_frame(self._override, message)

    def _say_all(self, messages: list[Said]) -> None:
        for message in messages:
            self._say(message)

    def _say(self, message: Said) -> None:
        self._send_frame(self._own, message)

    def _send_frame(self, encoder: Encoder, message: Said) -> None:
        if not self._greeted:
            return
        try:
            frame = encoder.encode(message)
        except (struct.error, OverflowError, ValueError, TypeError):
            self.counters.unsendable += 1
            return
        if not self._send(frame):
            self.counters.unsent += 1

    def _clock(self, now_s: float) -> float:
        """The loop's time."""
        return self.session.vehicle_time_s if self._vehicle_clock else now_s


def _nowhere(_text: str) -> None:
    """Words that nobody asked for."""


def _is_finite(command: SurfaceCommand) -> bool:
    return isfinite(command.elevator) and isfinite(command.aileron) and isfinite(command.rudder)


def _telemetry_value(output: autopilot.Output, turn: int) -> float:
    """The number of `TELEMETRY_NAMES[turn]`, in the units of the operator's parameters."""
    return (
        output.e_rho_m,
        output.vehicle.x_m,
        output.vehicle.z_m,
        degrees(output.setpoints.pitch_rad),
        float(output.mode),
        output.line_x_m,
        output.line_z_m,
        degrees(output.line_eta_rad) - 90.0,
    )[turn]


# --- the process ------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    """`tgl-soar run`: the command line of `run`."""
    parser = argparse.ArgumentParser(
        prog="tgl-soar run", description="Fly: the module beside the autopilot."
    )
    add = parser.add_argument
    add("--airframe", type=Path, required=True, help="airframe file, as config/airframes/*.toml")
    add("--site", type=Path, required=True, help="site file, as config/sites/*.toml")
    add("--link", required=True, help=FORMS)
    add("--lockstep", action="store_true", help="tick with the simulator's clock, not our own")
    add("--timeout", type=float, metavar="S", help="give up if no autopilot answers for so long")
    given = parser.parse_args(arguments)
    return run(
        given.airframe, given.site, given.link, lockstep=given.lockstep, timeout_s=given.timeout
    )


def run(
    airframe_path: str | Path,
    site_path: str | Path,
    link: str,
    *,
    lockstep: bool = False,
    timeout_s: float | None = None,
) -> int:
    """Fly until told to stop; the process's exit code.

    0: stopped by SIGINT or SIGTERM; 2: configuration or link cannot be used; 3: no autopilot
    answered within `timeout_s`, if that was given.
    """
    try:
        airframe = load_airframe(airframe_path)
        site = load_site(site_path)
        parameters = load_parameters(airframe, airframe_path, site, site_path)
        transport = open_link(link, starts_with_frame, time.monotonic())
    except (ConfigError, LinkError) as error:
        print(error, file=sys.stderr)
        return EXIT_CANNOT_START
    stopped = threading.Event()
    restore = _stop_on_signals(stopped)
    try:
        return _fly(
            setup_from(airframe, site, parameters),
            transport,
            stopped.is_set,
            lockstep=lockstep,
            timeout_s=timeout_s,
        )
    finally:
        restore()
        transport.close()


def _stop_on_signals(stopped: threading.Event) -> Callable[[], None]:
    """SIGINT and SIGTERM set the flag; the way back."""
    if threading.current_thread() is not threading.main_thread():
        return lambda: None
    signals = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: stopped.set()) for number in signals]

    def restore() -> None:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)

    return restore


def _fly(
    setup: Setup,
    transport: Transport,
    stop: Callable[[], bool],
    *,
    lockstep: bool = False,
    timeout_s: float | None = None,
) -> int:
    clock = time.monotonic
    began_s = clock()
    onboard = Onboard(
        setup,
        transport.send,
        began_s,
        stream=transport.is_stream,
        lockstep=lockstep,
        console=_print,
    )
    _print(f"listening on {transport.name} as {setup.own.system}:{setup.own.component}")
    for warning in realtime.prepare(real_time=not lockstep):
        _print(warning)
    watch = _Watch(began_s)
    generation = transport.generation
    now_s = clock()
    while not stop():
        realtime.wait(transport.fileno(), onboard.wake_s(now_s), now_s)
        now_s = clock()
        received = transport.receive(now_s)
        if transport.generation != generation:
            generation = transport.generation
            onboard.relinked()
        for data in received:
            onboard.event(data, now_s)
            if onboard.overdue(clock()):  # a flood must not hold up the tick
                onboard.periodic(clock())
        if onboard.due(now_s):
            onboard.periodic(now_s)
        else:
            onboard.idle(now_s)
        if watch.is_silent(onboard.session.counters.heartbeats, now_s):
            _print(_why_silent(onboard, transport))
        if timeout_s is not None and now_s - began_s > timeout_s and not onboard.session.is_heard:
            _print(f"no autopilot on {transport.name} within {timeout_s:g} s: giving up")
            return EXIT_NO_AUTOPILOT
    onboard.stop()
    ticks = onboard.pacer.counters
    if not lockstep:
        _print(f"{ticks.ticks} ticks, {ticks.late} late, {ticks.skipped} skipped")
    return EXIT_OK


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


def _print(text: str) -> None:
    """A line on standard error, or none if nobody reads it: the loop must not wait."""
    line = f"tgl_soar: {text}\n".encode()
    try:
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, line[: select.PIPE_BUF])
    except OSError:
        return

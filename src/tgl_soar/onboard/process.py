"""The process around the module: the command line of `run`, links, signals.

`onboard.Onboard` knows neither socket nor clock; here they are opened, `loop` waits for them and
reads them, and whatever ends the process gives the surfaces back first.
"""

from __future__ import annotations

import argparse
import os
import platform
import secrets
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from tgl_soar import __version__
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    ConfigError,
    airframe_file,
    load_airframe,
    load_parameters,
    load_site,
    site_file,
    switch_refusal,
)
from tgl_soar.config.parameter_store import Identity, ParameterStore, state_file, state_folder
from tgl_soar.config.site import Site
from tgl_soar.control.line_bounds import LineBounds, open_sides
from tgl_soar.control.supervisor import MODE_NAMES, REASON_TEXTS
from tgl_soar.link.keys import (
    UNSIGNED,
    Secret,
    SigningError,
    keep_timestamp,
    peers_of,
    save_key,
    signing_from,
)
from tgl_soar.link.messages import (
    COMPONENT_AUTOPILOT,
    SEVERITY_CRITICAL,
    SEVERITY_ERROR,
    SEVERITY_NOTICE,
    SEVERITY_WARNING,
    Heartbeat,
    Source,
)
from tgl_soar.link.mode_change import ModeChange
from tgl_soar.link.natnet.sockets import NatNetError
from tgl_soar.link.presence import Presence
from tgl_soar.link.routes import Route
from tgl_soar.link.signing import TICKS_PER_S, Signing
from tgl_soar.link.telemetry import StatusTexts
from tgl_soar.link.transport import FORMS, baud_of, is_open, open_link
from tgl_soar.link.transports.base import LinkError, Transport
from tgl_soar.link.transports.udp import UdpListener
from tgl_soar.onboard import line_load, loop, native, pacing, realtime, watchdog
from tgl_soar.onboard.flightlog.declaration import VERSION
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER
from tgl_soar.onboard.flightlog.writer import LARGEST_BYTES, FlightRecorder, LogMetadata
from tgl_soar.onboard.mocap import MocapFeed, from_server
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.setup import Setup, setup_from
from tgl_soar.onboard.surfaces import RELEASE_FRAMES

GIVE_BACK_INTERVAL_S: Final = 0.02  # between frames that give the surfaces back for a dead process

EXIT_OK: Final = 0
EXIT_ERROR: Final = 1
EXIT_CANNOT_START: Final = 2
EXIT_NO_AUTOPILOT: Final = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """`tgl-soar run`: the command line of `run`."""
    parser = argparse.ArgumentParser(
        prog="tgl-soar run",
        allow_abbrev=False,  # `cli` looks for one of them itself
        description="Fly: the module beside the autopilot.",
        epilog="Parameters: `tgl-soar params` lists them, docs/parameters.md tells all of them.",
    )
    add = parser.add_argument
    add(
        "--airframe",
        type=airframe_file,
        required=True,
        metavar="FILE",
        help="airframe file, or the name of one that is shipped: eclipson_c",
    )
    add(
        "--site",
        type=site_file,
        required=True,
        metavar="FILE",
        help="site file, or the name of one that is shipped: hill, tunnel",
    )
    add(
        "--link",
        required=True,
        action="append",
        help=f"{FORMS}; the first leads to the autopilot, repeat it for ground stations",
    )
    add("--lockstep", action="store_true", help="tick with the simulator's clock, not our own")
    add("--timeout", type=float, metavar="S", help="give up if no autopilot answers for so long")
    add("--signing-key", type=Path, metavar="FILE", help="sign, and refuse what is not signed")
    add(
        "--unsigned-autopilot",
        action="store_true",
        help="with a key: the autopilot itself need not sign on the first link",
    )
    add(
        "--allow-setup-signing",
        action="store_true",
        help="with a key file: take another key from an operator over the air, and keep it there",
    )
    add(
        "--state",
        metavar="FOLDER",
        help="where parameters changed over the air are stored; none: nowhere."
        " Default: tgl_soar in $XDG_STATE_HOME or in ~/.local/state",
    )
    add(
        "--log",
        metavar="FOLDER",
        help="where flight logs are kept; none: nowhere. Default: logs in the folder of --state",
    )
    add(
        "--log-max",
        type=_megabytes,
        default=LARGEST_BYTES,
        metavar="MB",
        help="of all logs in that folder together, 10 at least: the oldest are deleted."
        f" Default: {LARGEST_BYTES / 1e6:g}",
    )
    add(
        "--no-guard",
        action="store_true",
        help="no second process that gives the surfaces back when this one is killed or hangs"
        " (in lockstep there is none)",
    )
    add(
        "--cpu",
        type=_processor,
        metavar="N",
        help="fly on this processor alone (best one that is kept free: isolcpus=N)",
    )
    add(
        "--spin",
        type=_spin,
        metavar="US",
        help="do not sleep for so many microseconds before a tick is expected and, where its sample"
        " is late, after it; 0 to 2000."
        f" Default: as many as this computer takes to wake, at most {pacing.AWAKE_MAX_S * 1e6:g}",
    )
    add(
        "--power-saving",
        action="store_true",
        help="take less of the processor: sleep until it is time (unless --spin says otherwise)"
        " and go through no tick beforehand; surfaces move some tenths of a millisecond later",
    )
    add(
        "--mocap-server",
        default="",
        metavar="HOST[:PORT]",
        help="OptiTrack's server and command port, instead of [mocap] of the site file",
    )
    add(
        "--interpreted",
        action="store_true",
        help="fly the source as it stands, also where `tgl-soar compile` made native code of it",
    )
    given = parser.parse_args(arguments)
    if given.signing_key is None and (given.unsigned_autopilot or given.allow_setup_signing):
        parser.error("--unsigned-autopilot and --allow-setup-signing need --signing-key")
    return run(
        given.airframe,
        given.site,
        given.link,
        lockstep=given.lockstep,
        timeout_s=given.timeout,
        state=_folder(given.state),
        log=_log_folder(given.log, _folder(given.state)),
        log_bytes=given.log_max,
        secret=Secret(given.signing_key, given.unsigned_autopilot, given.allow_setup_signing),
        mocap_server=given.mocap_server,
        guarded=not given.no_guard and not given.lockstep,
        realtime_options=realtime.RealtimeOptions(
            given.cpu,
            0.0 if given.power_saving and given.spin is None else given.spin,
            given.power_saving,
        ),
    )


def _folder(state: str | None) -> Path | None:
    """Where the state is stored, if anywhere."""
    if state is None:
        return state_folder(os.environ)
    return None if state == "none" else Path(state)


def _log_folder(log: str | None, state: Path | None) -> Path | None:
    """Where flight logs are kept, if anywhere."""
    if log is None:
        return None if state is None else state / "logs"
    return None if log == "none" else Path(log)


def _megabytes(text: str) -> int:
    try:
        megabytes = float(text)
    except ValueError:
        megabytes = 0.0
    if not 10.0 <= megabytes <= 1e9:
        raise argparse.ArgumentTypeError(f"{text}: must be a number of megabytes, 10 or more")
    return int(megabytes * 1e6)


def _processor(text: str) -> int:
    there = realtime.processors()
    if not text.isascii() or not text.isdigit() or int(text) not in there:
        names = ", ".join(str(number) for number in sorted(there))
        raise argparse.ArgumentTypeError(f"{text}: must be a processor of this computer: {names}")
    return int(text)


def _spin(text: str) -> float:
    try:
        spin_s = float(text) * 1e-6
    except ValueError:
        spin_s = -1.0
    if not 0.0 <= spin_s <= realtime.SPIN_MAX_S:
        longest_us = realtime.SPIN_MAX_S * 1e6
        raise argparse.ArgumentTypeError(f"{text}: must be 0 to {longest_us:g} microseconds")
    return spin_s


class Plan(NamedTuple):
    """All that a flight is started from; nothing is open yet."""

    airframe: Airframe
    airframe_path: str | Path
    site: Site
    site_path: str | Path
    setup: Setup
    links: tuple[str, ...]  # the first leads to the autopilot
    lockstep: bool
    timeout_s: float | None
    state: Path | None
    secret: Secret
    log: Path | None
    log_bytes: int
    realtime_options: realtime.RealtimeOptions


def run(
    airframe_path: str | Path,
    site_path: str | Path,
    link: str | Sequence[str],
    *,
    lockstep: bool = False,
    timeout_s: float | None = None,
    state: Path | None = None,
    secret: Secret = UNSIGNED,
    mocap_server: str = "",
    guarded: bool = False,
    log: Path | None = None,
    log_bytes: int = LARGEST_BYTES,
    realtime_options: realtime.RealtimeOptions = realtime.RealtimeOptions(),  # noqa: B008
) -> int:
    """Fly until told to stop; the process's exit code.

    `link`: one or several, the first to the autopilot.  `guarded`: in a child process, watched.
    0: stopped by SIGINT, SIGTERM, SIGHUP or SIGQUIT; 2: configuration, key or link cannot be
    used; 3: no autopilot answered within `timeout_s`, if that was given; 4: guarded, and it keeps
    dying.
    """
    try:
        airframe = load_airframe(airframe_path)
        site = load_site(site_path)
        if mocap_server:
            site = from_server(site, mocap_server)
        parameters = load_parameters(airframe, airframe_path, site, site_path)
        setup = setup_from(airframe, site, parameters)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return EXIT_CANNOT_START
    if site.contour is not None and not setup.contour:
        _print(f"no line is checked: the site's contour is of {site.contour.airframe!r}")
    _print(f"code: {native.told()}")
    links = (link,) if isinstance(link, str) else tuple(link)
    plan = Plan(
        airframe=airframe,
        airframe_path=airframe_path,
        site=site,
        site_path=site_path,
        setup=setup,
        links=links,
        lockstep=lockstep,
        timeout_s=timeout_s,
        state=state,
        secret=secret,
        log=log,
        log_bytes=log_bytes,
        realtime_options=realtime_options,
    )
    if guarded:
        realtime.raise_priority()
        return watchdog.watch(partial(_run, plan), partial(_give_back, plan), _print)
    return _run(plan)


def _run(plan: Plan, heartbeat: watchdog.ProcessHeartbeat | None = None, became: str = "") -> int:
    """Open the links and fly.  `became`: what happened to the process that flew before."""
    transports: list[Transport] = []
    mocap: MocapFeed | None = None
    try:
        signing = signing_from(plan.secret, realtime.clock_s())
        store = _store(plan)
        setup, restored_words = _restored(plan.setup, store)
        for text in plan.links:
            transports.append(_open(plan, text, signing))  # noqa: PERF401 - closed on error
        if plan.site.mocap is not None:
            mocap = MocapFeed(plan.site.mocap, lockstep=plan.lockstep)
    except (ConfigError, LinkError, SigningError, NatNetError) as error:
        print(error, file=sys.stderr)
        for transport in transports:
            transport.close()
        # What has worked before may work again, as a line that was pulled for a moment: the guard
        # is to try.
        return EXIT_ERROR if became else EXIT_CANNOT_START
    stopped = threading.Event()
    restore = _stop_on_signals(stopped)
    with _lowered_priority(plan.realtime_options, plan.lockstep):
        end_keeping = keep_timestamp(signing, plan.secret.key_file, _print)
    words = [(SEVERITY_ERROR, f"restarted: the flying process {became}")] if became else []
    words += _too_slow(plan)
    try:
        return _fly(
            setup,
            transports,
            stopped.is_set,
            lockstep=plan.lockstep,
            timeout_s=plan.timeout_s,
            signing=signing,
            secret=plan.secret,
            store=store,
            heartbeat=heartbeat,
            first_words=[*words, *restored_words],
            recorder=_recorder(plan),
            mocap=mocap,
            realtime_options=plan.realtime_options,
        )
    finally:
        end_keeping()
        restore()
        for transport in transports:
            transport.close()
        if mocap is not None:
            mocap.close()


def _open(plan: Plan, text: str, signing: Signing) -> Transport:
    excused = Source(plan.setup.own.system, COMPONENT_AUTOPILOT)
    trusted = excused if text == plan.links[0] and plan.secret.unsigned_autopilot else None
    return open_link(text, peers_of(signing, trusted), realtime.clock_s())


def _too_slow(plan: Plan) -> list[tuple[int, str]]:
    """What is to be said of a serial line that does not carry the flight."""
    baud = baud_of(plan.links[0])
    if baud is None or plan.lockstep:
        return []
    load = line_load.load_of(plan.setup, signed=plan.secret.key_file is not None)
    refusal = load.refusal(baud)
    return [(SEVERITY_WARNING, refusal)] if refusal else []


def _give_back(plan: Plan, sign: watchdog.Sign, became: str) -> None:
    """The flying process is dead and its links are closed: let go in its stead."""
    setup = plan.setup
    try:
        # The key as the dead process had it: its file may be gone.  Beyond what it may have signed
        # since it showed itself, and within its block of stamps: its successor begins behind that.
        signing = Signing(sign.key, time.time(), realtime.clock_s())
        if sign.timestamp:
            signing.timestamp = sign.timestamp + TICKS_PER_S
        transport = _open(plan, plan.links[0], signing)
    except LinkError as error:
        _print(f"the guard cannot give the surfaces back: {error}")
        return
    if isinstance(transport, UdpListener) and sign.host:
        transport.peer = (sign.host, sign.port)
    unsigned = plan.secret.unsigned_autopilot
    excused = Source(setup.own.system, COMPONENT_AUTOPILOT) if unsigned else None
    route = Route(
        0,
        setup.own,
        setup.override,
        transport.send,
        signing,
        stream=transport.is_stream,
        excused=excused,
    )
    route.own.version1 = route.override.version1 = sign.version1
    releases = [(route.override, message) for message in setup.flavour.release()]
    words = StatusTexts().chunks(SEVERITY_CRITICAL, f"surfaces given back: module {became}")
    try:
        transport.clear_for_release()
        for _ in range(RELEASE_FRAMES):
            for encoder, message in releases:  # each anew: signed ones are taken only once
                transport.send(encoder.encode(message))
            time.sleep(GIVE_BACK_INTERVAL_S)
        for chunk in words:
            transport.send(route.own.encode(chunk))
        _leave_mode(setup, route, transport)
        transport.receive(realtime.clock_s())  # a serial line writes what is left
    finally:
        transport.close()


def _leave_mode(setup: Setup, route: Route, transport: Transport) -> None:
    """Out of the mode that the dead process has entered, unless the pilot has chosen another."""
    flavour = setup.flavour
    autopilot = Source(setup.own.system, COMPONENT_AUTOPILOT)
    change = ModeChange(flavour)
    change.leave(realtime.clock_s(), float("-inf"))
    if change.is_changing:  # this socket may be a new one: who hears nothing from it says nothing
        transport.send(route.own.encode(Presence(0).heartbeat()))
    heard_s, obeys, custom_mode = float("-inf"), False, -1
    while change.is_changing:
        now_s = realtime.clock_s()
        for data in transport.receive(now_s):
            for source, message in route.decoder.feed(data):
                if source == autopilot and isinstance(message, Heartbeat):
                    heard_s, custom_mode = now_s, message.custom_mode
                    obeys = not flavour.mismatch(message) and flavour.obeys(message)
        for asked in change.poll(now_s, heard_s, obeys, custom_mode):
            transport.send(route.own.encode(asked))
        time.sleep(GIVE_BACK_INTERVAL_S)
    if change.failed:
        for chunk in StatusTexts().chunks(SEVERITY_CRITICAL, change.failed):
            transport.send(route.own.encode(chunk))


def _store(plan: Plan) -> ParameterStore | None:
    """What keeps changed parameters, if they are to be kept."""
    if plan.state is None:
        _print("parameters changed over the air are not stored: no --state")
        return None
    own = plan.setup.own
    identity = Identity(plan.airframe.airframe.name, plan.site.site.name, own.system, own.component)
    path = state_file(plan.state, plan.airframe_path, plan.site_path)
    return ParameterStore(path, identity, plan.setup.parameters, plan.setup.presets)


def _recorder(plan: Plan) -> FlightRecorder | None:
    """What keeps the flight's log, if it is to be kept."""
    if plan.log is None:
        _print("no flight log is kept: no --log")
        return None
    words = {
        "sys_name": "tgl_soar",
        "ver_sw": __version__,
        "ver_log": str(VERSION),
        "ver_python": platform.python_version(),
        "code": native.told(),
        "started_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "airframe_file": str(plan.airframe_path),
        "site_file": str(plan.site_path),
        "links": " ".join(plan.links),
        "lockstep": str(plan.lockstep),
        "modes": ";".join(MODE_NAMES),
        "reasons": ";".join(REASON_TEXTS),
    }
    texts = {"airframe": _text_of(plan.airframe_path), "site": _text_of(plan.site_path)}
    return FlightRecorder(
        plan.log,
        LogMetadata(words, texts),
        0.0 if plan.lockstep else realtime.clock_s(),
        largest_bytes=plan.log_bytes,
        patient=plan.lockstep,
    )


def _text_of(path: str | Path) -> str:
    """A file that was good a moment ago."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _restored(setup: Setup, store: ParameterStore | None) -> tuple[Setup, list[tuple[int, str]]]:
    """With the values that were kept, and what is to be said of them.

    Errors: `ConfigError` for a pilot's switch that has become a surface's channel since.
    """
    if store is None:
        return setup, []
    found = store.restore()
    words = [(SEVERITY_ERROR, note) for note in found.notes]
    if found.kept:
        names = ", ".join(found.kept)
        words.append((SEVERITY_NOTICE, f"{len(found.kept)} stored parameters: {names}"))
    channel = found.values["OP_RC_CHAN"]
    if refusal := switch_refusal(channel, setup.surface_channels):
        raise ConfigError(
            f"{store.path}: OP_RC_CHAN = {channel:g}: {refusal}; set it with `tgl-soar params"
            " import`, or remove this file"
        )
    return setup._replace(parameters=found.values), words


def _words_of_place(setup: Setup) -> list[tuple[int, str]]:
    """What is to be said of the fence and of the site's own lines."""
    bounds = LineBounds(setup.contour, setup.ground)
    words = [open_sides(setup.parameters), *bounds.preset_faults(setup.parameters, setup.presets)]
    return [(SEVERITY_WARNING, text) for text in words if text]


def _stop_on_signals(stopped: threading.Event) -> Callable[[], None]:
    """SIGINT, SIGTERM, SIGQUIT and a lost terminal set the flag, what would stop the process does
    nothing; the way back."""
    if threading.current_thread() is not threading.main_thread():
        return lambda: None
    before = {number: signal.signal(number, lambda *_: stopped.set()) for number in watchdog.ENDS}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in watchdog.STOPS}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    return restore


def _fly(
    setup: Setup,
    transports: Sequence[Transport],
    stop: Callable[[], bool],
    *,
    lockstep: bool = False,
    timeout_s: float | None = None,
    signing: Signing | None = None,
    secret: Secret = UNSIGNED,
    store: ParameterStore | None = None,
    heartbeat: watchdog.ProcessHeartbeat | None = None,
    first_words: Sequence[tuple[int, str]] = (),
    recorder: FlightRecorder | None = None,
    mocap: MocapFeed | None = None,
    realtime_options: realtime.RealtimeOptions = realtime.RealtimeOptions(),  # noqa: B008
) -> int:
    began_s = realtime.clock_s()
    first, *others = transports
    key_file = secret.key_file
    onboard = Onboard(
        setup,
        first.send,
        began_s,
        stream=first.is_stream,
        lockstep=lockstep,
        console=_print,
        store=store,
        first_words=[*first_words, *_words_of_place(setup)],
        signing=signing,
        unsigned_autopilot=secret.unsigned_autopilot,
        keep_key=partial(save_key, key_file) if key_file and secret.allow_setup else None,
        recorder=recorder or NO_RECORDER,
        start=secrets.randbits(24),
        send_command=first.send_command,
        clear_for_release=first.clear_for_release,
    )
    for other in others:
        onboard.add_link(other.send, stream=other.is_stream)
    if mocap is not None:
        onboard.positions.add_mocap(mocap.client, mocap)
    names = ", ".join(transport.name for transport in transports)
    _print(f"listening on {names} as {setup.own.system}:{setup.own.component}")
    if not onboard.signing.is_on:
        for transport in transports:
            if is_open(transport.name):
                _print(
                    f"WARNING: {transport.name} is open to the network and unsigned: whoever"
                    " reaches it can fly this aircraft; give --signing-key, or listen on 127.0.0.1"
                )
    for warning in realtime.prepare(realtime_options, real_time=not lockstep):
        _print(warning)
    with _lowered_priority(realtime_options, lockstep):
        if store is not None:
            _print(f"parameters changed over the air are stored in {store.path}")
            store.start()
        if recorder is not None:
            recorder.start()
    try:
        spin_s = 0.0 if lockstep else realtime_options.spin_s
        in_order = loop.run(
            onboard,
            transports,
            stop,
            _print,
            timeout_s=timeout_s,
            heartbeat=heartbeat,
            mocap=mocap,
            spin_s=spin_s,
            power_saving=realtime_options.power_saving,
        )
    finally:  # whatever has happened, the pilot gets the surfaces
        onboard.stop()
        if heartbeat is not None:
            heartbeat.show(False)
        for text in (recorder or NO_RECORDER).stop():
            _print(text)
    if mocap is not None:
        _print(f"OptiTrack: {mocap.client.summary()}")
    ticks = onboard.pacer.counters
    if in_order and not lockstep:
        _print(
            f"{ticks.ticks} ticks, {ticks.late} late, {ticks.skipped} skipped,"
            f" {ticks.over_run} longer than a period"
        )
    return EXIT_OK if in_order else EXIT_NO_AUTOPILOT


def _lowered_priority(
    realtime_options: realtime.RealtimeOptions, lockstep: bool
) -> AbstractContextManager[None]:
    """For starting threads that must not come before the loop."""
    return nullcontext() if lockstep else realtime.lower_priority(realtime_options)


def _print(text: str) -> None:
    """A line on standard error, or none if nobody reads it: the loop must not wait."""
    line = f"tgl_soar: {text}\n".encode()
    try:
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, line[: select.PIPE_BUF])
    except OSError:
        return

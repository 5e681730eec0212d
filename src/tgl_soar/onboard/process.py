"""The process around the module: links, what is kept, signals.

`module.Onboard` knows neither socket nor clock; here they are opened, `loop` waits for them and
reads them, and whatever ends the process hands over first.
"""

from __future__ import annotations

import platform
import secrets
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from tgl_soar import __version__
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    ConfigError,
    airframe_refusal,
    gains_words,
    load_airframe,
    load_parameters,
    load_site,
)
from tgl_soar.config.parameter_store import Identity, ParameterStore, old_state_file, state_file
from tgl_soar.config.site import Site
from tgl_soar.control.line_bounds import open_sides
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_NOTICE, SEVERITY_WARNING
from tgl_soar.link.natnet.sockets import NatNetError, NatNetNotReadyError
from tgl_soar.link.open_link import baud_of, is_open
from tgl_soar.link.signing import Signing
from tgl_soar.link.signing_keys import SigningError, keep_timestamp, save_key, signing_from
from tgl_soar.link.transports.base import LinkError, LinkNotReadyError, Transport
from tgl_soar.onboard import link_load, loop, native, realtime, watchdog
from tgl_soar.onboard.command_line import RunOptions, options_of
from tgl_soar.onboard.console import say
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER
from tgl_soar.onboard.flightlog.topics import VERSION
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.onboard.mocap import MocapFeed, from_server
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.search_process import SearchBeside, SearchHere
from tgl_soar.onboard.setup import ModuleSetup, bounds_of, setup_from, with_values
from tgl_soar.onboard.watchdog_release import hand_over, open_for

EXIT_OK: Final = 0
EXIT_ERROR: Final = 1
EXIT_CANNOT_START: Final = 2
EXIT_NO_AUTOPILOT: Final = 3
EXIT_LINK_NOT_READY: Final = 5  # 4: `watchdog.EXIT_KEEPS_DYING`


def main(arguments: Sequence[str] | None = None) -> int:
    """`tgl-soar run`: the command line of `run`."""
    return run(options_of(arguments))


class RunPlan(NamedTuple):
    """All that a flight is started from; nothing is open yet."""

    options: RunOptions
    airframe: Airframe
    site: Site
    setup: ModuleSetup
    texts: Mapping[str, str]  # of both files, as they were read: "airframe", "site"


class Opened(NamedTuple):
    """What a flight has open."""

    setup: ModuleSetup  # with the parameters that were stored
    transports: Sequence[Transport]  # the first leads to the autopilot
    signing: Signing | None = None
    store: ParameterStore | None = None
    recorder: FlightRecorder | None = None
    mocap: MocapFeed | None = None
    search: SearchBeside | SearchHere | None = None
    first_words: Sequence[tuple[int, str]] = ()


def run(options: RunOptions) -> int:
    """Fly until told to stop; the process's exit code.

    0: stopped by SIGINT, SIGTERM, SIGHUP or SIGQUIT; 2: configuration, key or link cannot be
    used; 3: no autopilot answered within `timeout_s`, if that was given; 4: watched, and it keeps
    dying; 5: what a link leads to is missing or busy, and may not be for long.
    """
    try:
        airframe = load_airframe(options.airframe)
        site = load_site(options.site)
        if options.mocap_server:
            site = from_server(site, options.mocap_server)
        parameters = load_parameters(airframe, options.airframe, site, options.site)
        texts = {"airframe": _text_of(options.airframe), "site": _text_of(options.site)}
        setup = setup_from(airframe, site, parameters)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return EXIT_CANNOT_START
    if unchecked := site.contour_words(airframe.airframe.name):
        say(unchecked)
    say(f"code: {native.words()}")
    if whose := gains_words(airframe, site, parameters):
        say(whose)
    plan = RunPlan(options=options, airframe=airframe, site=site, setup=setup, texts=texts)
    if options.watched:
        realtime.raise_priority()
        return watchdog.watch(partial(_run, plan), partial(hand_over, setup, options), say)
    return _run(plan)


def _run(
    plan: RunPlan, heartbeat: watchdog.ProcessHeartbeat | None = None, became: str = ""
) -> int:
    """Open the links and fly.  `became`: what happened to the process that flew before."""
    options = plan.options
    transports: list[Transport] = []
    mocap: MocapFeed | None = None
    try:
        signing = signing_from(options.secret, realtime.clock_s())
        store = _store(plan)
        setup, restored_words = _restored(plan.setup, store)
        for text in options.links:
            transport = open_for(plan.setup, options, text, signing)
            transports.append(transport)
        if plan.site.mocap is not None:
            mocap = MocapFeed(plan.site.mocap, lockstep=options.lockstep)
    except (ConfigError, LinkError, SigningError, NatNetError) as error:
        print(error, file=sys.stderr)
        for transport in transports:
            transport.close()
        # A link that worked before may work again, such as a line pulled for a moment: the watchdog
        # tries again.
        if became:
            return EXIT_ERROR
        passes = isinstance(error, LinkNotReadyError | NatNetNotReadyError)
        return EXIT_LINK_NOT_READY if passes else EXIT_CANNOT_START
    stop = StopFlag()
    restore = _stop_on_signals(stop)
    with _lowered_priority(options):
        end_keeping = keep_timestamp(signing, options.secret.key_file, say)
    words = [(SEVERITY_ERROR, f"restarted: the flying process {became}")] if became else []
    words += _too_slow(setup, options)
    words += _unknown_air(plan)
    search = _search(options)
    opened = Opened(
        setup=setup,
        transports=transports,
        signing=signing,
        store=store,
        recorder=_recorder(plan),
        mocap=mocap,
        search=search,
        first_words=[*words, *restored_words],
    )
    try:
        return _fly(opened, options, stop.is_set, heartbeat)
    finally:
        end_keeping()
        restore()
        for transport in transports:
            transport.close()
        if mocap is not None:
            mocap.close()
        if search is not None:
            search.close()


def _search(options: RunOptions) -> SearchBeside | SearchHere | None:
    """Who searches for lift where that is asked for."""
    if options.lockstep:
        return SearchHere()
    try:
        with _lowered_priority(options):
            return SearchBeside()
    except OSError as error:
        say(f"no search for lift: {error.strerror}")
        return None


def _too_slow(setup: ModuleSetup, options: RunOptions) -> list[tuple[int, str]]:
    """What is to be said of a serial line that does not carry the flight, with the parameters that
    were stored."""
    baud = baud_of(options.links[0])
    if baud is None or options.lockstep:
        return []
    load = link_load.load_of(setup, signed=options.secret.key_file is not None)
    refusal = load.refusal(baud)
    return [(SEVERITY_WARNING, refusal)] if refusal else []


def _unknown_air(plan: RunPlan) -> list[tuple[int, str]]:
    """What is to be said of an airframe file that describes lift and drag in part."""
    if not (missing := plan.airframe.model_lacks()):
        return []
    what = "so the air is not estimated, and nothing is foreseen"
    return [(SEVERITY_WARNING, f"[model] has no {', '.join(missing)}: {what}")]


def _store(plan: RunPlan) -> ParameterStore | None:
    """What keeps changed parameters, if they are to be kept."""
    if plan.options.state is None:
        say("parameters changed over the air are not stored: no --state")
        return None
    own = plan.setup.own
    identity = Identity(plan.airframe.airframe.name, plan.site.site.name, own.system, own.component)
    files = plan.options.state, plan.options.airframe, plan.options.site
    path, old = state_file(*files, identity), old_state_file(*files)
    return ParameterStore(path, identity, plan.setup.parameters, plan.setup.presets, old)


def _recorder(plan: RunPlan) -> FlightRecorder | None:
    """What keeps the flight's log, if it is to be kept."""
    if plan.options.log is None:
        say("no flight log is kept: no --log")
        return None
    words = {
        "sys_name": "tgl_soar",
        "ver_sw": __version__,
        "ver_log": str(VERSION),
        "ver_python": platform.python_version(),
        "code": native.words(),
        "started_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "airframe_file": str(plan.options.airframe),
        "site_file": str(plan.options.site),
        "links": " ".join(plan.options.links),
        "lockstep": str(plan.options.lockstep),
        "modes": ";".join(MODE_NAMES),
        "reasons": ";".join(REASON_TEXTS),
    }
    return FlightRecorder(
        plan.options.log,
        LogMetadata(words, plan.texts),
        0.0 if plan.options.lockstep else realtime.clock_s(),
        largest_bytes=plan.options.log_bytes,
        patient=plan.options.lockstep,
    )


def _text_of(path: str | Path) -> str:
    """A file that was good a moment ago."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _restored(
    setup: ModuleSetup, store: ParameterStore | None
) -> tuple[ModuleSetup, list[tuple[int, str]]]:
    """With the values that were kept, and what is to be said of them.

    Errors: `ConfigError` for a pilot's switch that has become a surface's channel since, or the
    budget of a propeller that has gone.
    """
    if store is None:
        return setup, []
    found = store.restore()
    severity = SEVERITY_ERROR if found.damaged else SEVERITY_WARNING
    words = [(severity, note) for note in found.notes]
    if found.kept:
        names = ", ".join(found.kept)
        words.append((SEVERITY_NOTICE, f"{len(found.kept)} stored parameters: {names}"))
    if refusal := airframe_refusal(found.values, setup.surface_channels, setup.aerodynamics):
        raise ConfigError(
            f"{store.path}: {refusal}; set it with `tgl-soar params import`, or forget all that is"
            " stored with `tgl-soar params reset`"
        )
    return with_values(setup, found.values), words


def _words_of_place(setup: ModuleSetup) -> list[tuple[int, str]]:
    """What is to be said of the fence, of margins and of the site's own lines."""
    values, bounds = setup.parameters, bounds_of(setup, setup.contour)
    words = [
        open_sides(values),
        bounds.warning(values),
        *bounds.preset_faults(values, setup.presets),
    ]
    return [(SEVERITY_WARNING, text) for text in words if text]


class StopFlag:
    """Whether a signal has asked the process to end.

    A handler may be interrupted by the next signal's: Ctrl-C sends SIGINT to both processes, and
    the watchdog SIGTERM behind it.  So there is no lock in it, as `threading.Event` has one, that
    the second one would wait for while it keeps the first from giving it back.
    """

    def __init__(self) -> None:
        self._asked = False

    def ask(self, _number: int, _frame: object) -> None:
        """A signal's handler."""
        self._asked = True

    def is_set(self) -> bool:
        """Whether one has come."""
        return self._asked


def _stop_on_signals(stop: StopFlag) -> Callable[[], None]:
    """SIGINT, SIGTERM, SIGQUIT and a lost terminal set the flag; what would stop the process, or
    end it for no reason of ours, does nothing; the way back."""
    if threading.current_thread() is not threading.main_thread():
        return lambda: None
    before = {number: signal.signal(number, stop.ask) for number in watchdog.ENDS}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in watchdog.IGNORED}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    return restore


def _fly(
    opened: Opened,
    options: RunOptions,
    stop: Callable[[], bool],
    heartbeat: watchdog.ProcessHeartbeat | None = None,
) -> int:
    """Until told to stop; whatever ends it hands over first."""
    onboard = _module(opened, options, heartbeat)
    _tell_start(opened, signs=onboard.signing.is_on)
    recorder, mocap = opened.recorder, opened.mocap
    for warning in realtime.prepare(options.realtime, real_time=not options.lockstep):
        say(warning)
    with _lowered_priority(options):
        if opened.store is not None:
            if not opened.store.refused:  # it was reported where they were restored
                say(f"parameters changed over the air are stored in {opened.store.path}")
            opened.store.start()
        if recorder is not None:
            recorder.start()
    try:
        in_order = loop.run(
            onboard,
            opened.transports,
            stop,
            say,
            timeout_s=options.timeout_s,
            heartbeat=heartbeat,
            mocap=mocap,
            spin_s=0.0 if options.lockstep else options.realtime.spin_s,
            power_saving=options.realtime.power_saving,
        )
    finally:  # whatever has happened, the pilot gets the surfaces
        onboard.stop()
        if heartbeat is not None:  # before the disk is waited for: there is time for it now
            heartbeat.show(False)
        stored = opened.store.stop(onboard.settings.values) if opened.store is not None else []
        for text in (*stored, *(recorder or NO_RECORDER).stop()):
            say(text)
    if mocap is not None:
        say(f"OptiTrack: {mocap.client.summary()}")
    ticks = onboard.pacer.counters
    if in_order and not options.lockstep:
        say(
            f"{ticks.ticks} ticks, {ticks.late} late, {ticks.skipped} skipped,"
            f" {ticks.over_run} longer than a period"
        )
    return EXIT_OK if in_order else EXIT_NO_AUTOPILOT


def _module(
    opened: Opened, options: RunOptions, heartbeat: watchdog.ProcessHeartbeat | None
) -> Onboard:
    """The module on its links."""
    first, *others = opened.transports
    key_file, secret = options.secret.key_file, options.secret
    onboard = Onboard(
        opened.setup,
        first.send,
        realtime.clock_s(),
        ModuleOptions(
            stream=first.is_stream,
            send_command=first.send_command,
            clear_for_release=first.clear_for_release,
            before_first=heartbeat.take_surfaces if heartbeat is not None else lambda: None,
            lockstep=options.lockstep,
            start=secrets.randbits(24),
            signing=opened.signing,
            unsigned_autopilot=secret.unsigned_autopilot,
            keep_key=partial(save_key, key_file) if key_file and secret.allow_setup else None,
            console=say,
            first_words=[*opened.first_words, *_words_of_place(opened.setup)],
            store=opened.store,
            recorder=opened.recorder or NO_RECORDER,
            search=opened.search,
        ),
    )
    for other in others:
        onboard.add_link(other.send, stream=other.is_stream)
    if opened.mocap is not None:
        onboard.positions.add_mocap(opened.mocap.client, opened.mocap)
    return onboard


def _tell_start(opened: Opened, *, signs: bool) -> None:
    """Where it listens, as whom, and who can reach it there."""
    names = ", ".join(transport.name for transport in opened.transports)
    own = opened.setup.own
    say(f"listening on {names} as {own.system}:{own.component}")
    if signs:
        return
    for transport in opened.transports:
        if is_open(transport.name):
            say(
                f"WARNING: {transport.name} is open to the network and unsigned: anybody who"
                " reaches it can fly this aircraft; give --signing-key, or listen on 127.0.0.1"
            )


def _lowered_priority(options: RunOptions) -> AbstractContextManager[None]:
    """For starting threads that must not come before the loop."""
    return nullcontext() if options.lockstep else realtime.lower_priority(options.realtime)

"""The command line of `run`, and what it asks for: one object, handed on to whoever needs it."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from tgl_soar.config.files import airframe_file, site_file
from tgl_soar.config.parameter_store import state_folder
from tgl_soar.link.open_link import FORMS
from tgl_soar.link.signing_keys import UNSIGNED, Secret
from tgl_soar.onboard import pacing, realtime
from tgl_soar.onboard.flightlog.writer import LARGEST_BYTES

TIMEOUT_MAX_S: Final = 86400.0  # a day: whoever waits for longer waits for good


class RunOptions(NamedTuple):
    """What an operator asks of a flight."""

    airframe: str | Path  # the file
    site: str | Path  # the file
    links: tuple[str, ...]  # the first leads to the autopilot
    lockstep: bool = False
    timeout_s: float | None = None  # give up if no autopilot answers in this time; None: never
    secret: Secret = UNSIGNED
    state: Path | None = None  # the folder; None: nothing is stored
    log: Path | None = None  # the folder; None: no log is kept
    log_bytes: int = LARGEST_BYTES  # of all logs in it
    mocap_server: str = ""  # HOST[:PORT] instead of the site file's
    watched: bool = False  # in a child process, by its parent, the watchdog
    realtime: realtime.RealtimeOptions = realtime.RealtimeOptions()


def options_of(arguments: Sequence[str] | None = None) -> RunOptions:
    """What a command line asks for; ends the process where it cannot be understood."""
    parser = argparse.ArgumentParser(
        prog="tgl-soar run",
        allow_abbrev=False,  # `cli` looks for one of them itself
        description="Fly: the module beside the autopilot.",
        epilog="Parameters: listed by `tgl-soar params` and in docs/parameters.md.",
    )
    _add_flight(parser.add_argument)
    _add_computer(parser.add_argument)
    given = parser.parse_args(arguments)
    if given.signing_key is None and (given.unsigned_autopilot or given.allow_setup_signing):
        parser.error("--unsigned-autopilot and --allow-setup-signing need --signing-key")
    state = _folder(given.state)
    sleeps = given.power_saving and given.spin is None
    return RunOptions(
        airframe=given.airframe,
        site=given.site,
        links=tuple(given.link),
        lockstep=given.lockstep,
        timeout_s=given.timeout,
        secret=Secret(given.signing_key, given.unsigned_autopilot, given.allow_setup_signing),
        state=state,
        log=_log_folder(given.log, state),
        log_bytes=given.log_max,
        mocap_server=given.mocap_server,
        watched=not given.no_watchdog and not given.lockstep,
        realtime=realtime.RealtimeOptions(
            given.cpu, 0.0 if sleeps else given.spin, given.power_saving
        ),
    )


def _add_flight(add: Callable[..., Any]) -> None:
    """What is flown, over which links, and what is kept of it."""
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
    add(
        "--timeout",
        type=_timeout,
        metavar="S",
        help="give up if no autopilot answers in this time",
    )
    add(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="sign with this key, and refuse unsigned frames",
    )
    add(
        "--unsigned-autopilot",
        action="store_true",
        help="with a key: accept unsigned frames of the autopilot on the first link",
    )
    add(
        "--allow-setup-signing",
        action="store_true",
        help="with a key file: accept a new key from an operator over the air, and store it there",
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
        help="size of all logs in that folder, at least 10; beyond it the oldest are deleted."
        f" Default: {LARGEST_BYTES / 1e6:g}",
    )


def _add_computer(add: Callable[..., Any]) -> None:
    """What is asked of the computer, and of what stands beside it."""
    add(
        "--no-watchdog",
        action="store_true",
        help="no watchdog process that releases the surfaces if this one is killed or hangs"
        " (in lockstep there is none)",
    )
    add(
        "--cpu",
        type=_processor,
        metavar="N",
        help="fly on this processor only (best with isolcpus=N, which keeps it free)",
    )
    add(
        "--spin",
        type=_spin,
        metavar="US",
        help="stay awake for US microseconds before a tick is expected and, if its sample"
        " is late, after it; 0 to 2000."
        f" Default: the time this computer takes to wake, at most {pacing.AWAKE_MAX_S * 1e6:g}",
    )
    add(
        "--power-saving",
        action="store_true",
        help="use less processor time: sleep until the tick (unless --spin is given)"
        " and compute no warm-up tick; surfaces move some tenths of a millisecond later",
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
        help="fly the source, even if `tgl-soar compile` made native code of it",
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


def _timeout(text: str) -> float:
    try:
        timeout_s = float(text)
    except ValueError:
        timeout_s = -1.0
    if not 0.0 < timeout_s <= TIMEOUT_MAX_S:
        words = f"must be a number of seconds above 0, {TIMEOUT_MAX_S:g} at most"
        raise argparse.ArgumentTypeError(f"{text}: {words}; for no limit leave it out")
    return timeout_s


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

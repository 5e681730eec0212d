"""A second process that releases the surfaces when the flying one cannot.

A process that ends by SIGTERM or by an error hands over by itself (`process`).  One that is killed,
runs out of memory, crashes in a library or hangs does not: an autopilot then waits for its own
time-out, and 3 s without a hand on the elevator are too long.  So `run` flies in a child, and the
parent does nothing but watch it:

    the child has died, or its loop has stood still    kill it, release the surfaces, say so
    that was not asked for                             start it again; it never engages by itself
    SIGTERM, SIGINT, SIGHUP, SIGQUIT                   pass it on, wait, then as above: not for
                                                       long while the child has the surfaces;
                                                       then until its files are written
    SIGTSTP, SIGTTIN, SIGTTOU                          nothing: neither of the two may be stopped
    SIGUSR1, SIGALRM and their like                    nothing: they mean nothing here
    the parent itself has died                         the kernel ends the child by SIGTERM

A terminal sends such signals to both at once; SIGTSTP and its like (^Z, or words on a terminal that
is somebody else's now) would leave the surfaces commanded, with nobody to release them.

What the parent needs to know stands in a page of memory that both share: the signing key too, so
that it needs no file when it releases.  Under systemd the
parent is the service: it tells when the module is up, and feeds the watchdog only while the
child's loop goes round.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import socket
import struct
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Final, NamedTuple

from tgl_soar.onboard.realtime import clock_s

HANGS_FLYING_S: Final = 0.5  # the loop has not gone round for so long, with the surfaces
HANGS_S: Final = 10.0  # without them: starting takes its time
LOOK_S: Final = 0.05  # between two looks
PATIENCE_S: Final = 2.0  # for a child that was asked to end, and is in control yet
# For one that has given them back.  What it waits for then has limits of its own, 9 s in all: two
# writes of parameters, the flight log and the signing timestamp 2 s each, the search 1 s.
ENDING_S: Final = 9.5
RESTARTS: Final = 5  # within `RESTARTS_S`, then it is somebody else's turn
RESTARTS_S: Final = 60.0
RESTART_DELAY_S: Final = 0.2

EXIT_KEEPS_DYING: Final = 4

_PR_SET_PDEATHSIG: Final = 1
ENDS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT)
STOPS: Final = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
STRAYS: Final = (
    signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM, signal.SIGVTALRM, signal.SIGPROF,
    signal.SIGIO, signal.SIGPWR,
)  # fmt: skip
IGNORED: Final = (*STOPS, *STRAYS)
_WATCHED: Final = {signal.SIGCHLD, *ENDS}
_PAGE: Final = struct.Struct("<QQ??48sH32s")
_HAS_SURFACES: Final = struct.calcsize("<QQ")  # where that stands on the page
_NO_KEY: Final = bytes(32)
_PAGE_BYTES: Final = 4096


class Sign(NamedTuple):
    """What the child shows of itself."""

    rounds: int  # of its loop
    timestamp: int  # the latest it has signed with; 0: it does not sign
    has_surfaces: bool
    version1: bool  # MAVLink 1 is spoken on the first link
    host: str  # the peer of a link that listens; "": none yet
    port: int
    key: bytes | None = None  # that it signs with


class ProcessHeartbeat:
    """A page of memory that the child writes and the parent reads.

    A torn read is possible and harmless: every byte is that of this round or of the one before,
    and is looked at again, or belongs to a dead child.
    """

    def __init__(self) -> None:
        self._page = mmap.mmap(-1, _PAGE_BYTES)  # shared with processes forked later
        self._rounds = 0

    def show(
        self,
        has_surfaces: bool,
        *,
        version1: bool = False,
        peer: tuple[str, int] | None = None,
        timestamp: int = 0,
        key: bytes | None = None,
    ) -> None:
        """The loop has gone round once more."""
        self._rounds += 1
        host, port = peer or ("", 0)
        # Not by `pack_into`, which clears the page first: a child that is killed then would leave
        # one that says that it had no surfaces, and no peer to release them to.
        self._page[: _PAGE.size] = _PAGE.pack(
            self._rounds, timestamp, has_surfaces, version1, host.encode(), port, key or _NO_KEY
        )

    def take_surfaces(self) -> None:
        """The next frame will take the surfaces: whoever dies right behind it had them."""
        self._page[_HAS_SURFACES] = 1

    def read(self) -> Sign:
        """What was shown last."""
        rounds, timestamp, surfaces, version1, host, port, key = _PAGE.unpack_from(self._page, 0)
        return Sign(
            rounds=rounds,
            timestamp=timestamp,
            has_surfaces=surfaces,
            version1=version1,
            host=host.rstrip(b"\0").decode("ascii", "replace"),
            port=port,
            key=None if key == _NO_KEY else key,
        )

    def clear(self) -> None:
        """For the next child."""
        self._page[: _PAGE.size] = bytes(_PAGE.size)


Child = Callable[
    [ProcessHeartbeat, str], int
]  # (life sign, what became of the one before) -> exit code
Release = Callable[[Sign, str], None]  # release the surfaces, and say why


def watch(child: Child, release: Release, say: Callable[[str], None]) -> int:
    """Run `child` in a process of its own, until it ends by itself or is told to.

    Returns its exit code, or `EXIT_KEEPS_DYING`.  `release` must not raise.
    """
    heartbeat = ProcessHeartbeat()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _WATCHED)
    ignored = [signal.signal(number, signal.SIG_IGN) for number in IGNORED]  # the child's too
    deaths: list[float] = []
    became = ""
    try:
        while True:
            heartbeat.clear()
            code, became = _watch_one(_start(child, heartbeat, became), heartbeat)
            sign = heartbeat.read()
            if became:
                say(f"the flying process {became}")
            if sign.has_surfaces:  # also of one that ended, and failed to give them back
                release(sign, became or f"ended with exit code {code}")
                say("the watchdog released the surfaces")
            if code is not None:
                return code
            now_s = clock_s()
            deaths = [*(t for t in deaths if now_s - t < RESTARTS_S), now_s]
            if len(deaths) > RESTARTS:
                say(f"it has died {len(deaths)} times within {RESTARTS_S:g} s: giving up")
                return EXIT_KEEPS_DYING
            ended = signal.sigtimedwait(ENDS, RESTART_DELAY_S)
            if ended is not None:
                return 0
    finally:
        _tell_systemd("STOPPING=1")
        for number, handler in zip(IGNORED, ignored, strict=True):
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start(child: Child, heartbeat: ProcessHeartbeat, became: str) -> int:
    """Fork; the child never comes back from here."""
    parent = os.getpid()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid != 0:
        return pid
    code = 1
    try:
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _WATCHED)
        if os.getppid() == parent:  # else it has died just now
            code = child(heartbeat, became)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _watch_one(pid: int, heartbeat: ProcessHeartbeat) -> tuple[int | None, str]:
    """Until this child is gone: its exit code if that is the end of it all, and what became of it.

    "" became of a child that ended in order.
    """
    watchdog = _Watchdog()
    rounds, round_s = 0, clock_s()
    reported_s: float | None = None  # when it was asked to end
    while True:
        info = signal.sigtimedwait(_WATCHED, LOOK_S)
        now_s = clock_s()
        if info is not None and info.si_signo in ENDS:
            reported_s = reported_s or now_s
            os.kill(pid, signal.SIGTERM)
        gone, status = os.waitpid(pid, os.WNOHANG)
        if gone:
            return _end_of(status, reported=reported_s is not None)
        sign = heartbeat.read()
        if sign.rounds != rounds:
            rounds, round_s = sign.rounds, now_s
            watchdog.feed(now_s)
        still_s = now_s - round_s
        hangs = still_s > (HANGS_FLYING_S if sign.has_surfaces else HANGS_S)
        patience_s = PATIENCE_S if sign.has_surfaces else ENDING_S
        if hangs or (reported_s is not None and now_s - reported_s > patience_s):
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            why = f"stood still for {still_s:.1f} s" if hangs else "did not end when asked to"
            return (0 if reported_s is not None else None), f"{why} and was killed"


def _end_of(status: int, *, reported: bool) -> tuple[int | None, str]:
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        known = {int(each): each.name for each in signal.Signals}
        name = known.get(number, f"signal {number}")  # a real-time signal has no name
        return (0 if reported else None), f"was killed by {name}"
    code = os.WEXITSTATUS(status)
    if code == 1 and not reported:  # Python's own, after a traceback
        return None, "ended with an error"
    return code, ""


# --- systemd ----------------------------------------------------------------------------------


class _Watchdog:
    """Tells systemd that the module is up, and from then on that its loop goes round."""

    def __init__(self) -> None:
        interval = os.environ.get("WATCHDOG_USEC", "")
        self._interval_s = int(interval) * 1e-6 / 4 if interval.isdigit() else float("inf")
        self._due_s = float("-inf")

    def feed(self, now_s: float) -> None:
        """The loop has gone round."""
        if self._due_s == float("-inf"):
            _tell_systemd("READY=1")
            self._due_s = now_s
        if now_s >= self._due_s and self._interval_s != float("inf"):
            self._due_s = now_s + self._interval_s
            _tell_systemd("WATCHDOG=1")


def _tell_systemd(word: str) -> None:
    """sd_notify(3); without systemd nothing happens."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.setblocking(False)
        notify.sendto(word.encode(), address)

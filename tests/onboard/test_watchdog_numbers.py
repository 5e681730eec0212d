"""The watchdog's times, counts, codes and signals, where processes and the clock are made up.

`test_watchdog.py` has real processes; here only what the kernel does is replaced.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tgl_soar.onboard import watchdog
from tgl_soar.onboard.watchdog import ProcessHeartbeat, Sign

# The kernel's part is put in the place of the real one.
pytestmark = pytest.mark.interpreted

LOOK_S = 0.05  # how exactly the watchdog can tell a time
KILLED, ENDED = signal.SIGKILL, 0  # what waitpid(2) says of a process: a signal, or a code << 8


class Life(NamedTuple):
    """What one flying process does, in seconds since its start."""

    shows_until_s: float = 0.0  # its loop goes round
    has_surfaces: bool = False
    ends_s: float = 1e9
    status: int = ENDED
    releases_s: float = 1e9  # the surfaces
    obeys: bool = False  # it ends where it is asked to


class World:
    """Processes that live as scripted, and what the watchdog does to them."""

    def __init__(self, *lives: Life) -> None:
        self.now_s = 1000.0
        self.lives = list(lives)
        self.started: list[tuple[float, str]] = []  # when, and what became of the one before
        self.killed: list[tuple[float, int, int]] = []  # when, pid, signal
        self.asked: list[tuple[float, int]] = []  # signals that come to the watchdog: when, which
        self.waits: list[tuple[tuple[int, ...], float]] = []
        self.words: list[str] = []
        self.released: list[tuple[Sign, str]] = []
        self.at_start: Callable[[], None] = lambda: None
        self._page: ProcessHeartbeat
        self._life = Life()
        self._dead: int | None = None

    def start(self, _child: object, page: ProcessHeartbeat, became: str) -> int:
        assert page.read().rounds == 0  # nothing is left of the one before
        self.at_start()
        self._page, self._dead = page, None
        self._life = self.lives[min(len(self.started), len(self.lives) - 1)]
        self.started.append((self.now_s, became))
        return 100 + len(self.started)

    def wait(self, numbers: Any, timeout_s: float) -> Any:
        """sigtimedwait(2)."""
        self.waits.append((tuple(sorted(numbers)), timeout_s))
        self.now_s += timeout_s
        if self.asked and self.now_s >= self.asked[0][0] and self.asked[0][1] in numbers:
            return signal.struct_siginfo((self.asked.pop(0)[1], 0, 0, 0, 0, 0, 0))
        return None

    def kill(self, pid: int, number: int) -> None:
        assert pid == 100 + len(self.started)
        self.killed.append((self.now_s, pid, number))
        if number == signal.SIGKILL or self._life.obeys:
            self._dead = signal.SIGKILL if number == signal.SIGKILL else ENDED

    def waitpid(self, pid: int, how: int) -> tuple[int, int]:
        assert pid == 100 + len(self.started)
        age_s, life = self.now_s - self.started[-1][0], self._life
        if age_s <= life.shows_until_s:
            self._page.show(life.has_surfaces and age_s < life.releases_s)
        if self._dead is None and age_s >= life.ends_s:
            self._dead = life.status
        if self._dead is None:
            assert how == os.WNOHANG, "it would wait forever"
            return 0, 0
        return pid, self._dead

    def watch(self) -> int:
        def release(sign: Sign, why: str) -> None:
            self.released.append((sign, why))

        return watchdog.watch(lambda *_: 0, release, self.words.append)


@pytest.fixture
def live(monkeypatch: pytest.MonkeyPatch) -> Callable[..., World]:
    """A world with these lives, one after the other; the last one again and again."""

    def made(*lives: Life) -> World:
        world = World(*lives)
        monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
        monkeypatch.setattr(watchdog, "clock_s", lambda: world.now_s)
        monkeypatch.setattr(watchdog, "_start", world.start)
        monkeypatch.setattr(os, "kill", world.kill)
        monkeypatch.setattr(os, "waitpid", world.waitpid)
        monkeypatch.setattr(signal, "sigtimedwait", world.wait)
        return world

    return made


Live = Callable[..., World]
LASTS = Life(shows_until_s=3.0, ends_s=3.0)


# --- a loop that stands still ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("has_surfaces", "still_s", "words"),
    [
        (True, 0.5, "stood still for 0.5 s and was killed"),
        (False, 10.0, "stood still for 10.0 s and was killed"),
    ],
)
def test_a_loop_may_stand_still_for_so_long_and_is_killed_after_that(
    live: Live, has_surfaces: bool, still_s: float, words: str
) -> None:
    world = live(Life(shows_until_s=20.0, has_surfaces=has_surfaces), LASTS)
    assert world.watch() == 0
    ((at_s, pid, number),) = world.killed
    assert (pid, number) == (101, signal.SIGKILL)
    # It is noticed one look late that the last round was the last, and one late that it is long.
    assert still_s - LOOK_S <= at_s - 1020.0 <= still_s + 2 * LOOK_S
    assert world.words[0][:35] == f"the flying process {words}"[:35]
    assert bool(world.released) is has_surfaces
    assert world.started[1][1].endswith(" s and was killed")


def test_a_killed_process_s_surfaces_are_released_before_the_next_is_started(live: Live) -> None:
    world = live(Life(has_surfaces=True, ends_s=2.0, shows_until_s=2.0, status=KILLED), LASTS)
    starts: list[int] = []
    world.at_start = lambda: starts.append(len(world.released))
    assert world.watch() == 0
    assert starts == [0, 1]
    ((sign, why),) = world.released
    assert sign.has_surfaces
    assert sign.rounds > 30  # of what it showed last
    assert why == "was killed by SIGKILL"
    assert world.words == [
        "the flying process was killed by SIGKILL",
        "the watchdog released the surfaces",
    ]
    assert [became for _, became in world.started] == ["", "was killed by SIGKILL"]


def test_a_process_that_has_released_its_surfaces_needs_no_release(live: Live) -> None:
    world = live(Life(shows_until_s=2.0, has_surfaces=True, releases_s=1.0, ends_s=2.0))
    assert world.watch() == 0
    assert not world.released
    assert not world.words


def test_one_that_ended_in_order_with_surfaces_is_released_with_its_code(live: Live) -> None:
    world = live(Life(shows_until_s=2.0, has_surfaces=True, ends_s=2.0, status=3 << 8))
    assert world.watch() == 3
    assert [why for _, why in world.released] == ["ended with exit code 3"]
    assert world.words == ["the watchdog released the surfaces"]


# --- asked to end ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("has_surfaces", "patience_s"), [(True, 2.0), (False, 9.5)])
def test_who_does_not_end_when_asked_to_has_so_long(
    live: Live, has_surfaces: bool, patience_s: float
) -> None:
    world = live(Life(shows_until_s=100.0, has_surfaces=has_surfaces))
    world.asked = [(1010.0, signal.SIGINT), (1011.0, signal.SIGTERM)]  # once more: no longer
    assert world.watch() == 0
    passed, again, killed = world.killed
    assert [number for _, _, number in (passed, again)] == [signal.SIGTERM] * 2
    assert killed[2] == signal.SIGKILL
    assert passed[0] == pytest.approx(1010.0, abs=LOOK_S)
    assert patience_s - LOOK_S < killed[0] - passed[0] <= patience_s + 2 * LOOK_S
    assert world.words[0] == "the flying process did not end when asked to and was killed"
    assert [why for _, why in world.released] == (
        ["did not end when asked to and was killed"] if has_surfaces else []
    )
    assert len(world.started) == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT])
def test_what_asks_it_to_end_is_passed_on_as_sigterm_and_the_code_is_the_child_s(
    live: Live, number: int
) -> None:
    world = live(Life(shows_until_s=100.0, obeys=True))
    world.asked = [(1001.0, number)]
    assert world.watch() == 0
    assert [each[2] for each in world.killed] == [signal.SIGTERM]
    assert not world.words


def test_a_death_nearby_asks_nobody_to_end(live: Live) -> None:
    world = live(LASTS)
    world.asked = [(1001.0, signal.SIGCHLD)]
    assert world.watch() == 0
    assert not world.killed


# --- what a process ends by -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("status", "asked", "code", "became"),
    [
        (0, False, 0, ""),
        (0, True, 0, ""),
        (1 << 8, False, None, "ended with an error"),
        (1 << 8, True, 1, ""),
        (2 << 8, False, 2, ""),
        (signal.SIGSEGV, False, None, "was killed by SIGSEGV"),
        (signal.SIGSEGV, True, 0, "was killed by SIGSEGV"),
        (45, False, None, "was killed by signal 45"),
    ],
)
def test_whether_it_was_the_end_of_it_all(
    status: int, asked: bool, code: int | None, became: str
) -> None:
    assert watchdog._end_of(status, reported=asked) == (code, became)


# --- started again --------------------------------------------------------------------------------


def test_what_keeps_dying_is_started_five_times_again_and_then_given_up(live: Live) -> None:
    world = live(Life(ends_s=1.0, status=KILLED))
    assert world.watch() == 4
    assert len(world.started) == 1 + 5
    assert world.words[-1] == "it has died 6 times within 60 s: giving up"
    starts = [at_s for at_s, _ in world.started]
    assert [b - a for a, b in pairwise(starts)] == pytest.approx([1.0 + 0.2] * 5, abs=LOOK_S)


@pytest.mark.parametrize(("lasts_s", "is_given_up"), [(11.5, True), (12.0, False)])
def test_six_deaths_count_where_they_are_within_a_minute(
    live: Live, lasts_s: float, is_given_up: bool
) -> None:
    """Five times that, and the pauses of 0.2 s, are less than a minute, or more."""
    dying = Life(shows_until_s=lasts_s, ends_s=lasts_s, status=KILLED)
    world = live(*[dying] * 12, LASTS)
    assert world.watch() == (4 if is_given_up else 0)
    assert len(world.started) == (6 if is_given_up else 13)


def test_who_is_asked_to_end_between_two_lives_starts_no_other(live: Live) -> None:
    world = live(Life(ends_s=1.0, status=KILLED))
    world.asked = [(1001.1, signal.SIGTERM)]
    assert world.watch() == 0
    assert len(world.started) == 1
    assert world.waits[-1] == (
        tuple(sorted((signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT))),
        0.2,
    )
    assert set(world.waits[0][0]) == {*world.waits[-1][0], signal.SIGCHLD}


# --- signals --------------------------------------------------------------------------------------

NOTHING = (
    signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU, signal.SIGUSR1, signal.SIGUSR2,
    signal.SIGALRM, signal.SIGVTALRM, signal.SIGPROF, signal.SIGIO, signal.SIGPWR,
)  # fmt: skip
WAITED_FOR = {signal.SIGCHLD, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT}


def test_while_it_watches_signals_do_nothing_or_are_waited_for_and_afterwards_are_as_before(
    live: Live,
) -> None:
    world = live(LASTS)
    blocked: list[tuple[list[Any], set[signal.Signals]]] = []

    def look() -> None:
        handlers = [signal.getsignal(number) for number in NOTHING]
        blocked.append((handlers, signal.pthread_sigmask(signal.SIG_BLOCK, ())))  # type: ignore[arg-type]

    look()
    world.at_start = look
    world.watch()
    look()
    before, during, after = blocked
    assert before[0] != during[0]
    assert during[0] == [signal.SIG_IGN] * len(NOTHING)
    assert during[1] >= WAITED_FOR
    assert not before[1] & WAITED_FOR
    assert after == before


# --- the child ------------------------------------------------------------------------------------


class Exited(BaseException):
    """What ends the child's process, here its part of the test."""


class Fork:
    """fork(2) in the child."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, is_orphan: bool = False) -> None:
        self.asked: list[tuple[int, ...]] = []  # of the kernel
        self.unblocked: list[tuple[int, set[int]]] = []
        parent = os.getpid() + is_orphan
        monkeypatch.setattr(os, "fork", lambda: 0)
        monkeypatch.setattr(os, "getppid", lambda: parent)
        monkeypatch.setattr(os, "_exit", self._exit)
        monkeypatch.setattr(signal, "pthread_sigmask", self._mask)
        monkeypatch.setattr(ctypes, "CDLL", lambda _: self)

    def prctl(self, *arguments: int) -> int:
        self.asked.append(arguments)
        return 0

    def _exit(self, code: int) -> None:
        raise Exited(code)

    def _mask(self, how: int, numbers: set[int]) -> None:
        self.unblocked.append((how, set(numbers)))

    def code(self, child: watchdog.Child, became: str = "") -> int:
        with pytest.raises(Exited) as ended:
            watchdog._start(child, ProcessHeartbeat(), became)
        return int(ended.value.args[0])


def test_a_child_ends_with_its_code_and_is_ended_with_its_parent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fork = Fork(monkeypatch)
    ends: list[str] = []

    def child(_page: ProcessHeartbeat, became: str) -> int:
        ends.append(became)
        return 7

    assert fork.code(child, "was killed") == 7
    assert ends == ["was killed"]
    pr_set_pdeathsig = 1  # linux/prctl.h
    assert fork.asked == [(pr_set_pdeathsig, signal.SIGTERM)]
    assert fork.unblocked == [(signal.SIG_UNBLOCK, WAITED_FOR)]


@pytest.mark.parametrize(
    ("error", "code", "is_printed"),
    [(SystemExit(3), 3, False), (SystemExit("words"), 1, False), (ZeroDivisionError(), 1, True)],
)
def test_a_child_that_raises_ends_with_a_code_too(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
    is_printed: bool,
) -> None:
    def child(_page: ProcessHeartbeat, _became: str) -> int:
        raise error

    assert Fork(monkeypatch).code(child) == code
    assert ("ZeroDivisionError" in capsys.readouterr().err) is is_printed


def test_a_child_whose_parent_died_meanwhile_does_not_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    def child(_page: ProcessHeartbeat, _became: str) -> int:
        raise AssertionError("it flies")

    assert Fork(monkeypatch, is_orphan=True).code(child) == 1


# --- systemd --------------------------------------------------------------------------------------


def received(listening: socket.socket) -> list[str]:
    words = []
    listening.setblocking(False)
    while True:
        try:
            words.append(listening.recv(64).decode())
        except BlockingIOError:
            return words


@pytest.mark.parametrize("is_abstract", [False, True])
def test_systemd_is_notified_that_it_is_up_while_it_goes_round_and_that_it_ends(
    live: Live, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, is_abstract: bool
) -> None:
    """A name that begins with an at sign has no file: sd_notify(3)."""
    name = f"@tgl_soar-{os.getpid()}" if is_abstract else str(tmp_path / "notify")
    world = live(Life(shows_until_s=3.0, ends_s=7.0))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(name.replace("@", "\0"))
        monkeypatch.setenv("NOTIFY_SOCKET", name)
        monkeypatch.setenv("WATCHDOG_USEC", "4000000")
        world.watch()
        # Four times in its interval of 4 s, while the loop goes round: after 0, 1, 2 s.
        fed = ["WATCHDOG=1"] * 3
        assert received(listening) == ["READY=1", *fed, "STOPPING=1"]


def test_an_address_where_nobody_listens_and_none_at_all_hold_nothing_up(
    live: Live, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    world = live(LASTS)
    assert world.watch() == 0
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "nobody"))
    monkeypatch.setenv("WATCHDOG_USEC", "soon")
    assert live(LASTS).watch() == 0

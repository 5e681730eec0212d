"""Killed, hung, orphaned: the surfaces go back all the same, and nothing engages by itself."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from module_process import AIRFRAME, PATIENCE_S, SITE, Module
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_site
from tgl_soar.config.parameter_store import Identity, ParameterStore
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.signing import TICKS_PER_S
from tgl_soar.link.signing_keys import RESERVE_S, save_key
from tgl_soar.onboard import process, watchdog
from tgl_soar.onboard.command_line import RunOptions
from tgl_soar.onboard.process import EXIT_ERROR, EXIT_LINK_NOT_READY, EXIT_OK
from tgl_soar.onboard.setup import setup_from
from tgl_soar.onboard.surface_control import RELEASE_FRAMES
from tgl_soar.onboard.watchdog import (
    EXIT_KEEPS_DYING,
    HANGS_FLYING_S,
    IGNORED,
    Child,
    ProcessHeartbeat,
    Release,
    Sign,
)
from tgl_soar.onboard.watchdog_release import hand_over


@pytest.fixture
def module() -> Iterator[Module]:
    made = Module()
    assert made.receive().get_type() == "HEARTBEAT"
    yield made
    made.close()


def child_of(module: Module) -> int:
    """The process that flies."""
    pid = module.process.pid
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


def pump_until_released(module: Module) -> float:
    """When the first frame came that hands over control."""
    end = time.monotonic() + PATIENCE_S
    while not (module.overrides and module.overrides[-1][1] == 0):
        assert time.monotonic() < end, module.texts
        module.pump()
    return module.overrides[-1][0]


def pump_until_reported(module: Module, *words: str) -> str:
    """Until one of these is reported; the text that has it."""
    end = time.monotonic() + PATIENCE_S
    while not (reported := [text for text in module.texts if any(word in text for word in words)]):
        assert time.monotonic() < end, module.texts
        module.pump()
    return reported[0]


def test_a_killed_process_is_released_and_its_successor_waits_to_be_asked(module: Module) -> None:
    module.engage()
    first = child_of(module)
    os.kill(first, signal.SIGKILL)
    pump_until_released(module)
    pump_until_reported(module, "surfaces released: module was killed by SIGKILL"[:50])
    pump_until_reported(module, "restarted: the flying process was killed by SIGKIL")
    assert child_of(module) != first
    released = len(module.overrides)
    for _ in range(100):
        module.pump()
    assert {pulse for _, pulse in module.overrides[released:]} <= {0}  # it does not engage
    module.overrides.clear()
    module.engage()  # and does when it is asked
    assert module.overrides


def test_a_hanging_process_is_killed_and_released(module: Module) -> None:
    module.engage()
    os.kill(child_of(module), signal.SIGSTOP)
    pump_until_released(module)
    pump_until_reported(module, "restarted: the flying process stood still for")


def test_a_process_that_stands_still_while_it_does_not_fly_is_left_alone(module: Module) -> None:
    child = child_of(module)
    os.kill(child, signal.SIGSTOP)
    end = time.monotonic() + 1.0  # longer than would be allowed in flight
    while time.monotonic() < end:
        module.pump()
    os.kill(child, signal.SIGCONT)
    assert child_of(module) == child
    module.engage()


def test_an_orphan_disengages_and_ends(module: Module) -> None:
    module.engage()
    child = child_of(module)
    module.process.kill()
    pump_until_released(module)
    pump_until_reported(module, "tgl_soar stopped")
    end = time.monotonic() + PATIENCE_S
    while Path(f"/proc/{child}/stat").exists():
        state = Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[0]
        if state == "Z":  # whoever adopts orphans here takes its time to bury them
            break
        assert time.monotonic() < end


def ignored(pid: int) -> set[int]:
    """The signals that a process ignores."""
    status = Path(f"/proc/{pid}/status").read_text()
    (mask,) = re.findall(r"^SigIgn:\s*([0-9a-f]+)$", status, re.MULTILINE)
    return {number for number in range(1, 65) if int(mask, 16) >> (number - 1) & 1}


def test_neither_process_is_stopped_by_a_terminal_or_ended_by_a_stray_signal(
    module: Module,
) -> None:
    """An orphaned process group is not stopped by default: so it is asked of the kernel."""
    stops = {signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU}
    strays = {signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM}  # each ends a process by default
    for pid in (module.process.pid, child_of(module)):
        assert set(IGNORED) | stops | strays <= ignored(pid)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_to_both_at_once_gives_the_surfaces_back(module: Module, number: int) -> None:
    """As a terminal sends it: ^C, ^\\, or its end."""
    ended = _signalled(module, number)
    while "stood still" in ended:  # the machine has, for half a second: once more, with another
        again = Module()
        try:
            assert again.receive().get_type() == "HEARTBEAT"
            ended, module = _signalled(again, number), again
        finally:
            again.vehicle.close()
    assert "tgl_soar stopped" in ended
    assert module.process.wait(PATIENCE_S) == EXIT_OK


def _signalled(module: Module, number: int) -> str:
    """What is reported in the end where both processes get a signal while in control."""
    module.engage()
    for pid in (module.process.pid, child_of(module)):
        with suppress(ProcessLookupError):  # the first has passed it on, and the second has ended
            os.kill(pid, number)
    pump_until_released(module)
    return pump_until_reported(module, "tgl_soar stopped", "module stood still for")


@pytest.mark.parametrize("corrupt", [Path.unlink, lambda path: path.chmod(0o644)])
def test_the_guard_needs_no_key_file_to_give_the_surfaces_back(
    corrupt: Callable[[Path], None], tmp_path: Path
) -> None:
    key, key_file = bytes(range(1, 33)), tmp_path / "key"
    save_key(key_file, key)
    module = Module("--signing-key", str(key_file), signing_key=key)
    try:
        assert module.receive().get_type() == "HEARTBEAT"
        module.engage()
        corrupt(key_file)
        os.kill(child_of(module), signal.SIGKILL)
        pump_until_released(module)
        pump_until_reported(module, "surfaces released: module was killed by SIGKILL"[:50])
    finally:
        module.close()


@pytest.mark.parametrize(
    ("became", "code"), [("", EXIT_LINK_NOT_READY), ("was killed by SIGKILL", EXIT_ERROR)]
)
def test_a_link_that_worked_before_is_tried_again(
    became: str, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def watch(child: Child, _release: Release, _say: Callable[[str], None]) -> int:
        return child(ProcessHeartbeat(), became)

    monkeypatch.setattr("tgl_soar.onboard.watchdog.watch", watch)
    monkeypatch.setattr("tgl_soar.onboard.realtime.raise_priority", lambda: None)
    link = "serial:/dev/there_is_none:57600"
    assert (
        process.run(RunOptions(airframe=AIRFRAME, site=SITE, links=(link,), watched=True)) == code
    )
    assert "there_is_none" in capsys.readouterr().err


def test_what_keeps_dying_is_given_up(module: Module) -> None:
    killed: set[int] = set()
    end = time.monotonic() + 2 * PATIENCE_S
    while module.process.poll() is None:
        assert time.monotonic() < end
        try:
            child = child_of(module)
        except (ValueError, FileNotFoundError):
            continue  # between two of them
        if child not in killed:
            killed.add(child)
            os.kill(child, signal.SIGKILL)
        time.sleep(0.01)
    assert module.process.returncode == EXIT_KEEPS_DYING
    assert "giving up" in module.words()


WATCHED = """
import os, signal, time
from tgl_soar.onboard import watchdog

def dies(heartbeat, became):
    if became:
        return 0
    heartbeat.show(True)
    os.kill(os.getpid(), signal.SIGRTMIN + 1)
    time.sleep(60.0)

def fails(heartbeat, became):
    def raises(*_):
        raise OSError("on its way out")
    signal.signal(signal.SIGTERM, raises)
    heartbeat.show(True)
    os.kill(os.getppid(), signal.SIGTERM)
    time.sleep(60.0)

def lingers(heartbeat, became):
    asked = []
    signal.signal(signal.SIGTERM, lambda *_: asked.append(1))
    heartbeat.show(True)
    os.kill(os.getppid(), signal.SIGTERM)
    while not asked:
        heartbeat.show(True)
        time.sleep(0.01)
    heartbeat.show(False)
    time.sleep(watchdog.PATIENCE_S + 1.0)
    return 7

def clings(heartbeat, became):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    os.kill(os.getppid(), signal.SIGTERM)
    while True:
        heartbeat.show(True)
        time.sleep(0.01)

print(watchdog.watch({child}, lambda _sign, became: print("released:", became), print))
"""


# Each life begins a quarter of a minute after the one before, by the watchdog's clock.
SELDOM = """
import os, signal
from tgl_soar.onboard import watchdog

lives, start, clock_s = 0, watchdog._start, watchdog.clock_s

def counted(*given):
    global lives
    lives += 1
    return start(*given)

def dies(heartbeat, became):
    if lives <= watchdog.RESTARTS + 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return 0

watchdog._start, watchdog.clock_s = counted, lambda: clock_s() + 15.0 * lives
print(watchdog.watch(dies, lambda *_: None, print), lives)
"""


@pytest.mark.interpreted
def test_what_dies_now_and_then_is_started_again_however_often() -> None:
    """Four times in a minute, and seven in all: those of hours ago say nothing of now."""
    done = subprocess.run(
        [sys.executable, "-c", SELDOM],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1] == f"0 {watchdog.RESTARTS + 3}", done.stdout + done.stderr


def watched(child: str) -> list[str]:
    """What is printed around one of these, and the time that it takes in the end."""
    begun_s = time.monotonic()
    watching = subprocess.run(
        [sys.executable, "-c", WATCHED.replace("{child}", child)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert watching.returncode == 0, watching.stderr
    return [*watching.stdout.splitlines(), f"{time.monotonic() - begun_s:.3f}"]


@pytest.mark.parametrize(
    ("child", "became", "code"),
    [("dies", "was killed by signal", EXIT_OK), ("fails", "ended with exit code 1", EXIT_ERROR)],
)
def test_whatever_a_process_ends_by_its_surfaces_are_released(
    child: str, became: str, code: int
) -> None:
    """By a signal without a name; or by an error, when it was asked to end."""
    printed = watched(child)[:-1]
    assert f"released: {became}" in "\n".join(printed)
    assert printed[-1] == str(code)


def test_a_process_whose_surfaces_are_back_has_time_for_its_files() -> None:
    """On a card that takes longer than a pilot may wait for the surfaces."""
    assert watched("lingers")[:-1] == ["7"]


def test_a_process_that_keeps_the_surfaces_has_no_such_time() -> None:
    *words, took_s = watched("clings")
    killed = "did not end when asked to and was killed"
    released = "the watchdog released the surfaces"
    assert words == [f"the flying process {killed}", f"released: {killed}", released, "0"]
    assert float(took_s) > watchdog.PATIENCE_S


class Ending:
    """A module that ends, and its store: what is done, and whether the page says that there are
    surfaces."""

    signing = SimpleNamespace(is_on=True)
    pacer = SimpleNamespace(counters=None)
    settings = SimpleNamespace(values=ParameterSet())

    def __init__(self, heartbeat: ProcessHeartbeat) -> None:
        self.done: list[tuple[str, bool]] = []
        self._heartbeat = heartbeat

    def stop(self, *values: ParameterSet) -> list[str]:
        """Of both: the store's is given what to write."""
        self.done.append(("store" if values else "module", self._heartbeat.read().has_surfaces))
        return []


def test_the_page_says_that_the_surfaces_are_back_before_the_disk_is_waited_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    heartbeat = ProcessHeartbeat()
    heartbeat.show(True)
    ending = Ending(heartbeat)
    monkeypatch.setattr(process, "_module", lambda *_: ending)
    monkeypatch.setattr("tgl_soar.onboard.loop.run", lambda *_, **__: True)
    monkeypatch.setattr("tgl_soar.onboard.realtime.prepare", lambda *_, **__: [])
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    setup = setup_from(airframe, site, ParameterSet())
    store = ParameterStore(tmp_path / "f.params", Identity("a", "s"), ParameterSet())
    monkeypatch.setattr(store, "start", lambda: None)
    monkeypatch.setattr(store, "stop", ending.stop)
    opened = process.Opened(setup=setup, transports=(), store=store)
    options = RunOptions(airframe=AIRFRAME, site=SITE, links=(), lockstep=True)
    assert process._fly(opened, options, lambda: True, heartbeat) == EXIT_OK
    assert ending.done == [("module", True), ("store", False)]


def is_fed(systemd: socket.socket) -> bool:
    """Whether anything comes within the socket's time-out."""
    try:
        return bool(systemd.recv(64))
    except TimeoutError:
        return False


def test_systemd_is_notified_of_the_start_of_every_round_and_of_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "400000")
        module = Module()
        try:
            assert systemd.recv(64) == b"READY=1"
            assert [systemd.recv(64) for _ in range(3)] == [b"WATCHDOG=1"] * 3
            os.kill(child_of(module), signal.SIGSTOP)
            end = time.monotonic() + PATIENCE_S
            systemd.settimeout(0.5)
            while is_fed(systemd):  # what was on its way
                assert time.monotonic() < end
            os.kill(child_of(module), signal.SIGCONT)
            systemd.settimeout(PATIENCE_S)
            assert systemd.recv(64) == b"WATCHDOG=1"
            module.process.send_signal(signal.SIGTERM)
            while (word := systemd.recv(64)) == b"WATCHDOG=1":
                pass
            assert word == b"STOPPING=1"
            assert module.process.wait(PATIENCE_S) == EXIT_OK
        finally:
            module.close()


def test_systemd_is_notified_four_times_in_its_interval_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notified: list[str] = []
    monkeypatch.setattr(watchdog, "_tell_systemd", notified.append)
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    feeding = watchdog._Watchdog()
    times = []
    for tick in range(101):  # 50 a second, for two
        before = len(notified)
        feeding.feed(10.0 + 0.02 * tick)
        times += [0.02 * tick] * (len(notified) - before)
    assert notified == ["READY=1"] + ["WATCHDOG=1"] * 5
    assert times == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.5, 2.0], abs=0.021)
    monkeypatch.delenv("WATCHDOG_USEC")
    without = watchdog._Watchdog()
    for now_s in (0.0, 1.0, 100.0):
        without.feed(now_s)
    assert notified[6:] == ["READY=1"]


def test_at_no_moment_does_the_page_say_that_nothing_is_commanded() -> None:
    """Whenever it is killed, a process that commands the surfaces leaves a page that says so."""
    page = ProcessHeartbeat()
    page.show(True, peer=("192.168.1.17", 14550))
    pid = os.fork()
    if pid == 0:
        while True:
            page.show(True, peer=("192.168.1.17", 14550))
    signs: dict[int, Sign] = {}
    try:
        end = time.monotonic() + PATIENCE_S
        while len(signs) < 500:  # one in twenty was torn, where the page was cleared first
            assert time.monotonic() < end
            sign = page.read()
            signs[sign.rounds] = sign
            time.sleep(0.0001)
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    assert all(sign.has_surfaces and sign.host == "192.168.1.17" for sign in signs.values())


class Pilot:
    """An autopilot in one thread, on a route that enters a mode, and its pilot."""

    def __init__(self, mode: int) -> None:
        self.mode, self.asked = mode, list[int]()
        self.texts: list[str] = []
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        codec, address = mavlink.MAVLink(None, 1, 1), None
        while not self.ended.is_set():
            try:
                data, address = self.socket.recvfrom(2048)
                message = mavlink.MAVLink(None).decode(bytearray(data))
                if message.get_type() == "COMMAND_LONG" and message.command == 176:
                    self.asked.append(int(message.param2) << 16)
                    self.mode = self.asked[-1]
                elif message.get_type() == "STATUSTEXT":
                    self.texts.append(message.text)
            except TimeoutError:
                if address is not None:
                    beat = mavlink.MAVLink_heartbeat_message(1, 12, 209, self.mode, 4, 3)
                    self.socket.sendto(bytes(beat.pack(codec)), address)

    def close(self) -> None:
        self.ended.set()
        self.thread.join(2.0)
        self.socket.close()


OFFBOARD, STABILIZED, POSITION = 6 << 16, 7 << 16, 3 << 16


@pytest.mark.parametrize(
    ("mode", "asked"), [(OFFBOARD, [STABILIZED]), (POSITION, [])], ids=["ours", "the pilot's"]
)
def test_for_a_dead_process_only_our_own_mode_is_left(mode: int, asked: list[int]) -> None:
    pilot = Pilot(mode)
    airframe = load_airframe(AIRFRAME)
    link = msgspec.structs.replace(airframe.autopilot, firmware="px4", route="attitude")
    airframe = msgspec.structs.replace(airframe, autopilot=link)
    site = load_site(SITE)
    setup = setup_from(airframe, site, ParameterSet())
    link_to_pilot = f"udpout:127.0.0.1:{pilot.socket.getsockname()[1]}"
    options = RunOptions(airframe=AIRFRAME, site=SITE, links=(link_to_pilot,))
    sign = Sign(rounds=1, timestamp=0, has_surfaces=True, version1=False, host="", port=0, key=None)
    try:
        hand_over(setup, options, sign, "was killed")
    finally:
        pilot.close()
    assert pilot.asked == asked
    assert not any("does not leave" in text for text in pilot.texts)
    assert any("surfaces released" in text for text in pilot.texts)


def test_the_release_for_a_dead_process_is_signed_beyond_all_that_it_has_signed() -> None:
    """It was shown before the last frames, and a peer that has these takes an older stamp for a
    record: of a process that hung, those of half a second at 400 Hz, four a tick.  And it stays
    below what was reserved for it, where its successor begins."""
    key, shown = bytes(range(1, 33)), 40 * 366 * 86_400 * TICKS_PER_S
    setup = setup_from(load_airframe(AIRFRAME), load_site(SITE), ParameterSet())
    stamps = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pilot:
        pilot.bind(("127.0.0.1", 0))
        pilot.setblocking(False)
        link = f"udpout:127.0.0.1:{pilot.getsockname()[1]}"
        options = RunOptions(airframe=AIRFRAME, site=SITE, links=(link,))
        sign = Sign(
            rounds=1, timestamp=shown, has_surfaces=True, version1=False, host="", port=0, key=key
        )
        hand_over(setup, options, sign, "was killed")
        with suppress(BlockingIOError):
            while True:
                stamps.append(int.from_bytes(pilot.recv(1000)[-12:-6], "little"))
    assert len(stamps) >= RELEASE_FRAMES
    assert min(stamps) > shown + max(4 * 200, round(HANGS_FLYING_S * TICKS_PER_S))
    assert max(stamps) <= shown + round(RESERVE_S * TICKS_PER_S)


def test_the_release_for_a_dead_process_outlasts_the_frame_that_it_was_writing() -> None:
    """On a stream, all that follows a frame that was cut may be taken for its end."""
    airframe = load_airframe(AIRFRAME)
    setup = setup_from(airframe, load_site(SITE), ParameterSet())
    received = Decoder(stream=True)
    cut = mavlink.MAVLink_odometry_message(
        0, 1, 12, 1.0, 1.0, 1.0, [1.0, 0.5, 0.5, 0.5], *[1.0] * 6, [1.0] * 21, [1.0] * 21, 1, 3, 100
    )
    received.feed(bytes(cut.pack(mavlink.MAVLink(None, 1, 191)))[:20])
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        options = RunOptions(airframe=AIRFRAME, site=SITE, links=(link,))
        sign = Sign(
            rounds=1, timestamp=0, has_surfaces=True, version1=False, host="", port=0, key=None
        )
        hand_over(setup, options, sign, "was killed")
        with server.accept()[0] as peer:
            data = peer.recv(100_000)
    words = data.index(b"surfaces released")
    received.feed(data[:words])
    assert received.counters.frames >= RELEASE_FRAMES

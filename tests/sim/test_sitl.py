"""The flight between real processes over real sockets, as `make run` flies it."""

from __future__ import annotations

import csv
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from free_ports import free_port
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped
from tgl_soar.sim.injection import OVERRIDE_TIME_S
from tgl_soar.sim.operator import Operator
from tgl_soar.sim.sitl import fly, passed
from tgl_soar.sim.sitl_options import SitlError, SitlOptions

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
SITE_MOCAP = shipped("sites/tunnel_mocap.toml")
PATIENCE_S = 60.0  # for what happens at once, were the machine not busy with other things
MANUAL = 0  # ArduPlane's custom mode
STANDBY_MODE, READY, SOARING = 1.0, 2.0, 4.0  # the module's


def options(out: Path, **changes: Any) -> SitlOptions:
    return SitlOptions(**{"airframe": AIRFRAME, "site": SITE, "out": out, **changes})


def quietly(_operator: object) -> None:
    return None


@pytest.mark.long  # in process: test_closed_loop.py; the same legs: docs/test_readme.py
def test_three_legs_in_calm_air(tmp_path: Path) -> None:
    """The numbers that the issue of the first flight asks for, through every process."""
    flight = fly(options(tmp_path), quietly)
    assert passed(flight)
    assert [score.name for score in flight.scores] == ["a", "b", "c"]
    for score in flight.scores:
        assert score.settling_s <= 3.0
        assert score.crossing_m <= 0.05
    assert (tmp_path / "summary.json").exists()


def test_the_same_seed_flies_the_same_flight_bit_for_bit(tmp_path: Path) -> None:
    """Lockstep: three processes, no dependence on how fast any of them is."""
    logs = []
    for name in ("first", "second"):
        fly(options(tmp_path / name, legs=("a",), stay_s=3.0, turbulence=0.03), quietly)
        logs.append((tmp_path / name / "truth.csv").read_bytes())
    # Where the log ends is when the operator stops the bridge: that alone is not in lockstep.
    rows = [log.splitlines()[:-1] for log in logs]
    shorter = min(len(lines) for lines in rows)
    assert shorter > 250  # at 50 Hz: capture and 3 s on the line
    assert rows[0][:shorter] == rows[1][:shorter]


def test_a_flight_by_motion_capture_repeats_bit_for_bit(tmp_path: Path) -> None:
    """Two sockets more, with a clock that has to be mapped, frames lost and ids swapped."""
    mocap = ("--mocap-loss=0.1", "--mocap-jitter=0.02", "--mocap-fault=swap:4:5")
    logs = []
    for name in ("first", "second"):
        changes = {"site": SITE_MOCAP, "mocap": True, "mocap_options": mocap}
        flown = options(tmp_path / name, legs=("a",), stay_s=3.0, turbulence=0.01, **changes)
        assert passed(fly(flown, quietly))
        logs.append((tmp_path / name / "truth.csv").read_bytes())
        words = (tmp_path / name / "module.log").read_text()
        assert "speaks NatNet 4.1" in words
        assert " fixes" in words
    rows = [log.splitlines()[:-1] for log in logs]
    shorter = min(len(lines) for lines in rows)
    assert shorter > 250
    assert rows[0][:shorter] == rows[1][:shorter]


# --- by the clock --------------------------------------------------------------------------


def bridge_of(out: Path) -> int:
    """The process id of the bridge that logs there."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            with suppress(OSError):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if b"tgl_soar.sim.bridge" in words and str(out / "truth.csv").encode() in words:
                    return int(folder.name)
    raise AssertionError("no bridge")


def test_a_flight_by_the_clock_goes_on_after_the_machine_has_stood_still(tmp_path: Path) -> None:
    """The bridge gets no processor for 0.6 s: the module must disengage, and is engaged again."""
    stood: list[int] = []

    def once(operator: Operator) -> None:
        if not stood and operator.flown and operator.flown[0].stopped_s > 0.0:
            stood.append(bridge_of(tmp_path))
            os.kill(stood[0], signal.SIGSTOP)
            time.sleep(0.6)
            os.kill(stood[0], signal.SIGCONT)

    anywhere = f"127.0.0.1:{free_port()}"
    by_clock = {"realtime": True, "gcs": anywhere, "gcs_local": "127.0.0.1:0"}
    by_clock["companion"] = f"127.0.0.1:{free_port()}"
    flight = fly(options(tmp_path, legs=("a",), stay_s=8.0, **by_clock), once)
    assert stood
    assert any("engaged again after a hiccup of this machine" in note for note in flight.notes)
    assert any("too slow for real time" in note for note in flight.notes)
    assert flight.flown[0].ended_s - flight.flown[0].stopped_s >= 8.0


def test_a_port_that_is_taken_is_reported_with_the_option_that_there_is(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(SitlError, match="choose another port with --gcs-local"):
            fly(options(tmp_path, realtime=True, gcs_local=address), quietly)
    offered = CliRunner().invoke(app, ["sitl", "--help"], env={"COLUMNS": "200"}).output
    assert "--gcs-local" in offered


# --- the module is killed in flight --------------------------------------------------------


class Station:
    """A ground station with nothing but a socket."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.address = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.codec = mavlink.MAVLink(None, 254, 190)
        self.codec.robust_parsing = True
        self.peer: Any = None
        self.parameters: dict[str, float] = {}
        self.texts: list[str] = []
        self.mode = -1.0
        self.module_heartbeats = 0
        self.autopilot_custom_mode = -1

    def listen(self, until: Callable[[Station], bool], timeout_s: float) -> bool:
        """Take in what comes until a condition holds; False when it does not in time."""
        end = time.monotonic() + timeout_s
        while not until(self):
            if time.monotonic() > end:
                return False
            try:
                data, self.peer = self.socket.recvfrom(4096)
            except TimeoutError:
                continue
            for message in self.codec.parse_buffer(bytearray(data)) or ():
                self._take(message)
        return True

    def _take(self, message: Any) -> None:
        kind, component = message.get_type(), message.get_srcComponent()
        if kind == "PARAM_VALUE" and component == 191:
            self.parameters[message.param_id] = message.param_value
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "NAMED_VALUE_FLOAT" and message.name == "soar_mode":
            self.mode = message.value
        elif kind == "HEARTBEAT" and component == 191:
            self.module_heartbeats += 1
        elif kind == "HEARTBEAT" and component == 1:
            self.autopilot_custom_mode = message.custom_mode

    def set(self, name: str, value: float, timeout_s: float = PATIENCE_S) -> None:
        """PARAM_SET until its PARAM_VALUE answers."""
        self.parameters.pop(name, None)
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            frame = self.codec.param_set_encode(
                1, 191, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
            )
            self.socket.sendto(frame.pack(self.codec), self.peer)
            if self.listen(lambda s: name in s.parameters, 0.5):
                return
        raise AssertionError(f"{name} was not answered; texts: {self.texts[-4:]}")

    def soar(self) -> None:
        """MANUAL, engage, and wait for the line to be captured; again if the machine stalled."""
        for _ in range(3):
            manual = self.codec.command_long_encode(
                1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, MANUAL, 0, 0, 0, 0, 0
            )
            self.socket.sendto(manual.pack(self.codec), self.peer)
            self.autopilot_custom_mode = -1
            assert self.listen(lambda s: s.autopilot_custom_mode == MANUAL, PATIENCE_S)
            self.set("OP_ENGAGE", 1.0)
            if self.listen(lambda s: s.mode == SOARING, 20.0):
                return
        raise AssertionError(f"not soaring: {self.texts}")


@contextmanager
def process(command: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as file:
        running = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    try:
        yield running
    finally:
        if running.poll() is None:
            running.kill()
        running.wait()


def test_kill_9_in_flight_hands_back_and_a_restarted_module_engages_again(tmp_path: Path) -> None:
    """Real time, because what is tested is what happens when nothing waits."""
    station, truth = Station(), tmp_path / "truth.csv"
    companion = f"127.0.0.1:{free_port()}"
    files = ["--airframe", str(AIRFRAME), "--site", str(SITE)]
    bridge = [
        *(sys.executable, "-m", "tgl_soar.sim.bridge", *files, "--log", str(truth)),
        *("--gcs", station.address, "--companion", companion, "--speed", "realtime"),
        *("--gcs-local", "127.0.0.1:0", "--companion-local", "127.0.0.1:0"),
        *("--autopilot-parameter", f"RC_OVERRIDE_TIME={OVERRIDE_TIME_S}"),
    ]
    run = [sys.executable, "-m", "tgl_soar.cli", "run", *files]
    # Unguarded, as when the whole computer has died.
    module = [*run, "--link", f"udp:{companion}", "--state", "none", "--no-watchdog"]
    with process(bridge, tmp_path / "bridge.log") as world:
        with process(module, tmp_path / "module.log") as flying:
            assert station.listen(lambda s: s.module_heartbeats > 1, PATIENCE_S)
            station.soar()
            os.kill(flying.pid, signal.SIGKILL)
            flying.wait()
        station.module_heartbeats, station.mode = 0, -1.0
        # Until RC_OVERRIDE_TIME is over the last deflections stand; then the pilot's sticks have
        # the surfaces, in the same mode.
        with process(module, tmp_path / "module2.log"):
            assert station.listen(lambda s: s.module_heartbeats > 1, PATIENCE_S)
            # It waits to be asked.
            assert station.listen(lambda s: s.mode in (STANDBY_MODE, READY), PATIENCE_S)
            assert not station.listen(lambda s: s.mode not in (STANDBY_MODE, READY), 1.0)
            assert station.autopilot_custom_mode == MANUAL
            station.soar()
        world.terminate()
        world.wait(PATIENCE_S)
    with truth.open(newline="") as file:
        rows = list(csv.DictReader(file))
    overridden = [float(row["overridden"]) for row in rows]
    changes = [b for a, b in pairwise(overridden) if a != b]
    # Taken; timed out after the kill; taken again by the restarted module.  Whether the aircraft
    # is still in the air by then is a question of how long this machine takes to start a process.
    assert changes[:3] == [1.0, 0.0, 1.0]


def test_a_flight_whose_module_is_killed_goes_on_without_it(tmp_path: Path) -> None:
    """The time-out hands over control, and the flight reports when it was killed."""
    flight = fly(options(tmp_path, legs=("a",), stay_s=4.0, kill_s=1.0), quietly)
    assert flight.killed_s is not None
    assert 0.9 <= flight.killed_s - flight.flown[0].stopped_s <= 1.5
    after = flight.truth["time_s"] > flight.killed_s + OVERRIDE_TIME_S + 0.3
    before = flight.truth["time_s"] < flight.killed_s
    assert after.any()
    assert not flight.truth["overridden"][after].any()
    assert flight.truth["overridden"][before][-1]
    assert flight.truth["flying"][after].all()


def test_kill_9_of_the_operator_leaves_no_process_behind(tmp_path: Path) -> None:
    sitl = [sys.executable, "-m", "tgl_soar.cli", "sitl", "--out", str(tmp_path), "--stay", "600"]
    with process(sitl, tmp_path / "operator.log") as operator:
        children = Path(f"/proc/{operator.pid}/task/{operator.pid}/children")
        end = time.monotonic() + PATIENCE_S
        while len(pids := children.read_text().split()) < 2:
            assert time.monotonic() < end, (tmp_path / "operator.log").read_text()
            time.sleep(0.05)
        # What runs its own program has asked the kernel for that signal: that came before.
        while any(
            len(words) < 2 or b"-c" in words[1:3]  # nothing at all while its program is loaded
            for words in (Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0") for pid in pids)
        ):
            assert time.monotonic() < end
            time.sleep(0.05)
        operator.kill()
        operator.wait()
        end = time.monotonic() + PATIENCE_S
        while any(Path(f"/proc/{pid}").exists() for pid in pids):
            assert time.monotonic() < end, "bridge or module still runs"
            time.sleep(0.05)


@pytest.mark.long
def test_a_search_finds_a_place_from_where_no_line_holds_and_a_line_follows(tmp_path: Path) -> None:
    """Upstream of the board: a line through the start has no crossing (docs/search.md)."""
    changes = {"site": shipped("sites/tunnel_search.toml"), "search": True, "stay_s": 4.0}
    flight = fly(options(tmp_path, **changes), quietly)
    assert passed(flight)
    (score,), (crossing,) = flight.scores, flight.crossings
    assert crossing is not None
    assert score.crossing_m <= 0.10
    start = flight.truth["x_m"][0], flight.truth["z_m"][0]
    assert start == pytest.approx((-0.35, 1.70), abs=0.02)
    log = (tmp_path / "module.log").read_text()
    assert "searching: searches for a place to soar" in log
    assert "soaring: a place to soar is found" in log

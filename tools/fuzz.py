#!/usr/bin/env python3
"""Throw bytes at everything that reads them, guided by coverage where atheris is installed.

    python tools/fuzz.py mavlink --seconds 60
    python tools/fuzz.py list

A target takes any bytes and raises only where something is wrong: an error that a reader
declares is an answer.  `mavlink` and `messages` meet a module that soars, in a closed loop with a
simulated aircraft: it must go on soaring, on its line, with its parameters.  `natnet` meets a
tracker that knows its server and its body, and must know them again afterwards.  Without atheris
(pip install 'tgl_soar[fuzz]') the bytes are mutations of good examples, drawn by lot.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from math import inf, isfinite
from pathlib import Path
from random import Random
from typing import Any, Final
from zlib import crc32

import fuzz_logs
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def _watched() -> AbstractContextManager[Any]:
    """What atheris is to watch is imported within; nothing where it does not guide."""
    if __name__ != "__main__" or "--by-lot" in sys.argv:
        return nullcontext()
    try:
        import atheris
    except ImportError:
        return nullcontext()
    return atheris.instrument_imports(include=["tgl_soar"])  # type: ignore[no-any-return]


with _watched():
    from tgl_soar.analysis.experiments.campaign import place
    from tgl_soar.analysis.experiments.scenario import Scenario
    from tgl_soar.analysis.logs.flight_data import FlightData
    from tgl_soar.analysis.logs.reader import LogError, read_log
    from tgl_soar.analysis.logs.reading import read_flight
    from tgl_soar.analysis.report.flight_figures import Surroundings
    from tgl_soar.analysis.report.flight_page import analysed, page_text, write_page
    from tgl_soar.autopilot import mode_name
    from tgl_soar.config.airframe import Airframe
    from tgl_soar.config.files import ConfigError, load_airframe, load_file, load_site, shipped
    from tgl_soar.config.parameter_files import ParameterFileError, read_file
    from tgl_soar.config.parameter_store import Identity, StoreError, read_state, state_text
    from tgl_soar.config.parameters import ParameterSet
    from tgl_soar.config.site import Site
    from tgl_soar.geometry import HallFrame, SoaringFrame
    from tgl_soar.link.natnet.settings import OptitrackSettings
    from tgl_soar.link.optitrack import Optitrack
    from tgl_soar.onboard.module import Onboard
    from tgl_soar.onboard.setup import setup_from
    from tgl_soar.sim.channels import deflection_from_pwm, ordered
    from tgl_soar.sim.hostile import HEARD_NAMES, HostileFrames, hostile_message
    from tgl_soar.sim.natnet_frames import (
        CLOCK_HZ,
        VERSIONS,
        Scene,
        SimulatedBody,
        encode_frame,
        encode_models,
        encode_server_info,
    )
    from tgl_soar.sim.world import make_world
    from tgl_soar.types import PositionFix, SurfaceCommand

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
HILL: Final = SoaringFrame(0.0, 0.0, 0.0, 0.5)
IDENTITY: Final = Identity("airframe", "site", 1, 191)
PER_TICK: Final = 8  # inputs: 1600 a second at the loop's 200 Hz
ENGAGED_S: Final = 2.0  # held until then
SETTLED_S: Final = 8.0  # and on the line by then
# Still air: whatever moves the aircraft off the line by more is what the bytes did.
ON_LINE_M: Final = 0.10


class WrongError(AssertionError):
    """Bytes did what bytes must not do."""


class Flight:
    """One module that soars in still air, and that bytes come to, over and over."""

    def __init__(self) -> None:
        airframe, site, values, field = place()
        self._world = make_world(airframe, site, seed=1, turbulence=0.0, field=field)
        self._world.held = True
        self._surfaces = ordered(airframe.surfaces)
        self._command = SurfaceCommand(self._world.trim.elevator, 0.0, 0.0)
        self._vehicle, self._station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
        self._reader = mavlink.MAVLink(None)
        self._inputs: list[bytes] = []  # since the last tick
        self._known = 0, 0  # position, attitude that the module has heard
        self.onboard = Onboard(setup_from(airframe, site, values), self._sent, 0.0, lockstep=True)
        while self._world.time_s < ENGAGED_S:
            self._step()
        engage = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
        self._hear(engage, self._station)
        while self._world.time_s < SETTLED_S:
            self._step()
        self.expected: ParameterSet = self.onboard.parameters.values

    @property
    def mode(self) -> str:
        """What the module does."""
        output = self.onboard.output
        return "nothing" if output is None else mode_name(output.mode)

    def take(self, data: bytes) -> None:
        """Bytes, and behind every eighth a tick; it soars before and after."""
        self._inputs.append(data)
        self.onboard.event(data, self._world.time_s)
        if self.onboard.parameters.values != self.expected:
            raise WrongError(f"parameters were changed by {data!r}")
        if len(self._inputs) == PER_TICK:
            self._step()
            wrong = self._wrong()
            if wrong:
                raise WrongError(f"{wrong} by {self._inputs!r}")
            self._inputs.clear()

    def _wrong(self) -> str:
        """What of the flight is not as it was."""
        output = self.onboard.output
        if self.onboard.counters.unsendable:
            return "a message could not be sent"
        if self._world.crashed or self._world.held or self.mode != "soaring":
            return f"{self.mode} {self._world.crashed}"
        if output is None or not abs(output.line.e_rho_m) < ON_LINE_M:
            return "off the line"
        return ""

    def _step(self) -> None:
        """The aircraft flies on, and says what it measures; the module's tick is in that."""
        world = self._world
        world.step(self._command)
        if world.steps % world.step_hz == 1:
            self._hear(mavlink.MAVLink_heartbeat_message(1, 3, 209, 0, 4, 3), self._vehicle)
        position, attitude = self._known
        self._known = world.position.sequence, world.attitude.sequence
        if world.position.sequence != position:
            stamp_ms = round(world.position.time_s * 1e3)
            told = mavlink.MAVLink_local_position_ned_message(stamp_ms, *world.position[2:8])
            self._hear(told, self._vehicle)
        if world.attitude.sequence != attitude:
            stamp_ms = round(world.attitude.time_s * 1e3)
            told = mavlink.MAVLink_attitude_quaternion_message(stamp_ms, *world.attitude[2:9])
            self._hear(told, self._vehicle)

    def _hear(self, message: mavlink.MAVLink_message, sender: mavlink.MAVLink) -> None:
        frame = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        self.onboard.event(bytes(frame), self._world.time_s)

    def _sent(self, frame: bytes) -> bool:
        """The autopilot does as it is told."""
        number = mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE
        if frame[0] == 0xFD and int.from_bytes(frame[7:10], "little") == number:
            told = self._reader.decode(bytearray(frame))
            pulses = [getattr(told, f"chan{surface.channel}_raw") for surface in self._surfaces]
            pairs = zip(self._surfaces, pulses, strict=True)
            self._command = SurfaceCommand(*(deflection_from_pwm(*pair) for pair in pairs))
            self._world.held = 0 in pulses  # given back: somebody catches it
        return True


@cache
def _flight() -> Flight:
    return Flight()


def mavlink_bytes(data: bytes) -> None:
    """Bytes from the link to the autopilot, as they are, while it soars."""
    _flight().take(data)


def messages(data: bytes) -> None:
    """Whole messages of nobody, their numbers drawn from the bytes, while it soars."""
    random = Random(data)
    frames = HostileFrames(random.getrandbits(32))
    flight = _flight()
    for _ in range(1 + len(data) % 4):
        message = hostile_message(random, random.choice(HEARD_NAMES))
        flight.take(frames.packed(message, random.choice((2, 9, 60, 200)), 1))


SERVER: Final = "10.0.0.2", 1510


class Hall:
    """A tracker in flight and its server, that speaks one version."""

    def __init__(self, version: tuple[int, int]) -> None:
        hall = HallFrame(
            z_up=False, yaw_rad=0.6, origin_north_m=1.0, origin_east_m=-2.0, origin_down_m=0.25
        )
        settings = OptitrackSettings(
            server=SERVER[0],
            body="aircraft",
            unicast=True,
            hall=hall,
            noise_m=0.001,
            max_error_m=0.02,
            max_speed_mps=25.0,
            max_age_s=0.3,
            max_rate_hz=200.0,
        )
        self.tracker = Optitrack(settings, lockstep=True)
        self.version = version
        self.now_s, self._frames = 100.0, 0

    def ready(self) -> None:
        """Answer what it asks until it knows server and body, as a server does."""
        info = encode_server_info(self.version, data_port=1511, group="239.0.0.1", multicast=False)
        answers = {0: info, 4: encode_models(self.version, [self._body()])}
        for _ in range(4):  # who is there, what is there, and once more behind a restart
            for asked in self.tracker.poll(self.now_s):
                if asked[0] in answers:
                    self.tracker.take(answers[asked[0]], SERVER, self.now_s)
            if self.tracker.is_ready and self.tracker.info is not None:
                theirs = self.tracker.info.version == self.version
                if theirs and self.tracker.info.clock_hz == CLOCK_HZ:
                    return
                self.tracker.take(info, SERVER, self.now_s)  # it was told of another
            self.now_s += 1.1
        raise WrongError("the tracker does not come to know its server again")

    def frame(self) -> bytes:
        """What the server sends now."""
        self._frames += 1
        ticks = round(self.now_s * CLOCK_HZ)
        scene = Scene(self._frames, [self._body()], self.now_s, ticks - 30_000, ticks, ticks)
        return encode_frame(self.version, scene)

    def _body(self) -> SimulatedBody:
        sway = 0.001 * (self._frames % 7)  # cameras always have noise
        return SimulatedBody(
            name="aircraft",
            id=3,
            position_m=(1.0 + sway, 1.5, 0.2),
            quaternion=(0.0, 0.0, 0.0, 1.0),
        )


@cache
def _hall(version: tuple[int, int]) -> Hall:
    return Hall(version)


def natnet(data: bytes) -> None:
    """Datagrams of a tracker that is ready, whole ones and their bodies."""
    hall = _hall(VERSIONS[len(data) % len(VERSIONS)])
    framed = [n.to_bytes(2, "little") + len(data).to_bytes(2, "little") for n in (7, 1, 5, 14)]
    for nonsense in (data, *(head + data for head in framed)):
        hall.ready()
        hall.now_s += 0.01
        for datagram in (hall.frame(), nonsense):
            fix = hall.tracker.take(datagram, SERVER, hall.now_s)
            if fix is not None and not _is_a_measurement(fix, hall.now_s):
                raise WrongError(f"nonsense became a position: {datagram!r}")


def _is_a_measurement(fix: PositionFix, now_s: float) -> bool:
    numbers = fix.north_m, fix.east_m, fix.down_m, fix.sigma_m
    return all(map(isfinite, numbers)) and now_s - 0.3 <= fix.time_s <= now_s


def _read(data: bytes, read: Callable[[Path], object], *answers: type[Exception]) -> None:
    with tempfile.NamedTemporaryFile(suffix=".fuzz") as file:
        file.write(data)
        file.flush()
        try:
            read(Path(file.name))
        except answers:
            return


def config(data: bytes) -> None:
    """Airframe, site and scenario files."""
    for kind in (Airframe, Site, Scenario):
        _read(data, lambda path, kind=kind: load_file(path, kind), ConfigError)  # type: ignore[misc]
    _read(data, load_airframe, ConfigError)
    _read(data, load_site, ConfigError)


def parameters(data: bytes) -> None:
    """Parameter files of either format."""
    _read(data, read_file, ParameterFileError)


def state(data: bytes) -> None:
    """The file of parameters changed over the air: as it is, and with a right checksum."""
    for text in (data, _summed(data)):
        try:
            values, _ = read_state(text, IDENTITY, "state")
        except StoreError:
            continue
        if "OP_ENGAGE" in values:
            raise WrongError(f"a state file engages: {text!r}")


def _summed(data: bytes) -> bytes:
    """A state file with these rows."""
    empty = state_text(IDENTITY, {})
    text = empty[: empty.rindex(b"# checksum")] if b"# checksum" in empty else b""
    mark = empty[len(text) : -9]
    text += data + b"\n"
    return text + mark + f"{crc32(text):08x}\n".encode()


def flight_of(path: Path) -> FlightData:
    """The flight in a log: its times are times, in their order."""
    flight = read_flight(path)
    for name, series in flight.series().items():
        if not np.all(np.isfinite(series.time_s)) or np.any(np.diff(series.time_s) < 0.0):
            raise WrongError(f"the times of its {name} are none")
    if not 0.0 <= flight.duration_s < inf:
        raise WrongError(f"it lasts {flight.duration_s} s")
    return flight


def log(data: bytes) -> None:
    """ULogs, ours too, with the beginning of one, as they are and as a flight."""
    for text in (data, fuzz_logs.ULOG_BEGIN + data):
        _read(text, read_log, LogError)
        _read(text, flight_of, LogError)


def px4(data: bytes) -> None:
    """PX4's ULog, with the beginning of one, as a flight."""
    for text in (data, fuzz_logs.ULOG_BEGIN + data):
        _read(text, flight_of, LogError)


def dataflash(data: bytes) -> None:
    """ArduPilot's log, with the beginning of one, as a flight."""
    for text in (data, b"\xa3\x95" + data):
        _read(text, flight_of, LogError)


def tlog(data: bytes) -> None:
    """Telemetry logs: as they are, and as whole frames made of the bytes."""
    for text in (data, fuzz_logs.recorded(data)):
        _read(text, flight_of, LogError)


def report(data: bytes) -> None:
    """The page of any log, read by what it begins with; of one in 64 its figures, too."""
    _read(data, _page, LogError)


def _page(path: Path) -> None:
    flight = flight_of(path)
    analysis = analysed(flight, Surroundings(site="$site$", airframe="<airframe>"), HILL)
    if crc32(path.read_bytes()) % 64:
        page_text(analysis, {})
        return
    with tempfile.TemporaryDirectory() as folder:
        write_page(Path(folder) / "page.html", analysis, lambda _words: None)


TARGETS: Final[dict[str, Callable[[bytes], None]]] = {
    "mavlink": mavlink_bytes,
    "messages": messages,
    "natnet": natnet,
    "config": config,
    "parameters": parameters,
    "state": state,
    "log": log,
    "px4": px4,
    "dataflash": dataflash,
    "tlog": tlog,
    "report": report,
}


LOGS: Final[dict[str, Callable[[], list[bytes]]]] = {
    "log": lambda: [fuzz_logs.own_log(), fuzz_logs.px4_log()],
    "px4": lambda: [fuzz_logs.px4_log()],
    "dataflash": lambda: [fuzz_logs.dataflash_log()],
    "tlog": lambda: [fuzz_logs.tlog(), Random(1).randbytes(400)],
    "report": lambda: [
        fuzz_logs.own_log(), fuzz_logs.px4_log(), fuzz_logs.dataflash_log(), fuzz_logs.tlog()
    ],
}  # fmt: skip


def examples(target: str) -> list[bytes]:
    """Good input to begin from."""
    if target in ("mavlink", "messages"):
        frames = HostileFrames(1)
        return [frames.next() for _ in range(200)]
    if target == "config":
        scenarios = [path.read_bytes() for path in shipped("scenarios").glob("*.toml")]
        huge = b"[site]\nname = 'a'\norigin_north_m = " + b"9" * 5000
        return [AIRFRAME.read_bytes(), SITE.read_bytes(), huge, *scenarios]
    if target in ("parameters", "state"):
        return [
            b"# a comment\n1\t191\tTGL_X\t0.5\t9\nTGL_Z,1.5\n",
            b"1\t191\tOP_ENGAGE\t1\t9\n",
            b"TGL_LEAN 15\nRHO_P=1\n\xff\x00",
        ]
    if target in LOGS:
        return LOGS[target]()
    datagrams = [Hall(version).frame() for version in VERSIONS]
    return [bytes(80), *datagrams, *(datagram[4:] for datagram in datagrams)]


def mutated(random: Random, example: bytes) -> bytes:
    """An example with a few bytes turned, cut or put in."""
    data = bytearray(example)
    for _ in range(random.randint(1, 6)):
        at = random.randrange(len(data) + 1)
        way = random.randrange(4)
        if way == 0 and data:
            data[at % len(data)] = random.choice((0, 1, 0x7F, 0x80, 0xFF, random.randrange(256)))
        elif way == 1:
            data[at:at] = random.randbytes(random.randint(1, 8))
        elif way == 2:
            del data[at : at + random.randint(1, 16)]
        else:
            data[at:at] = data[: random.randrange(len(data) + 1)][:64]
    return bytes(data)


def by_lot(target: str, seconds: float, seed: int) -> int:
    """Mutations of examples for so long; how many."""
    random, known = Random(seed), examples(target)
    take, count = TARGETS[target], 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        take(mutated(random, random.choice(known)))
        count += 1
    return count


def guided(target: str, seconds: float, atheris: Any) -> None:
    """Guided by coverage; ends the process."""
    with tempfile.TemporaryDirectory() as corpus:
        for i, example in enumerate(examples(target)):
            (Path(corpus) / str(i)).write_bytes(example)
        options = [sys.argv[0], f"-max_total_time={seconds:.0f}", "-max_len=4096", corpus]
        atheris.Setup(options, TARGETS[target])
        atheris.Fuzz()


def main() -> int:
    """Fuzz one target."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("target", choices=(*TARGETS, "list"))
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--by-lot", action="store_true", help="not guided, even with atheris")
    options = parser.parse_args()
    if options.target == "list":
        for name, target in TARGETS.items():
            print(f"{name:<11} {target.__doc__}")
        return 0
    try:
        if options.by_lot:
            raise ImportError
        import atheris
    except ImportError:
        count = by_lot(options.target, options.seconds, options.seed)
        print(f"{options.target}: {count} inputs, nothing found")
        return 0
    guided(options.target, options.seconds, atheris)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

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
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from itertools import accumulate
from math import inf, isfinite
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple
from zlib import crc32

import fuzz_logs
import numpy as np
from fuzz_files import SMALL_FILES, without_words
from fuzz_mutations import mutated, mutated_parts, parts_of
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
    from tgl_soar.analysis.campaigns.drawn_faults import place
    from tgl_soar.analysis.experiments.scenario import Scenario
    from tgl_soar.analysis.logs.dataflash import MAGIC
    from tgl_soar.analysis.logs.flight_data import FlightData
    from tgl_soar.analysis.logs.open_log import flight_from, read_flight
    from tgl_soar.analysis.logs.ulog_reader import LogError
    from tgl_soar.analysis.report.flight_page import Analysis, analysed, page_text, write_page
    from tgl_soar.analysis.report.flight_report_figures import Surroundings
    from tgl_soar.autopilot import mode_name
    from tgl_soar.config.files import (
        ConfigError,
        airframe_from,
        file_from,
        load_airframe,
        load_site,
        shipped,
        site_from,
    )
    from tgl_soar.config.parameter_files import ParameterFileError, read_file, read_text
    from tgl_soar.config.parameter_store import Identity, StoreError, read_state, state_text
    from tgl_soar.config.parameters import ParameterSet
    from tgl_soar.geometry import HallFrame, SoaringFrame
    from tgl_soar.link.natnet.settings import OptitrackSettings
    from tgl_soar.link.optitrack import Optitrack
    from tgl_soar.onboard.module import ModuleOptions, Onboard
    from tgl_soar.onboard.setup import setup_from
    from tgl_soar.sim.channels import deflection_from_pwm
    from tgl_soar.sim.hostile import RECEIVED_NAMES, HostileFrames, hostile_message
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
SHORT: Final = 120  # bytes that are also made frames of
# One input has 12 kB at most.  Of a log 200 bytes are held for each of its bytes, or 2.4 MB; the
# allocator's own holes and numpy's buffers are a few times that.
MOST_BYTES: Final = 64 * 2**20


class WrongError(AssertionError):
    """Bytes did what bytes must not do."""


class Flight:
    """One module that soars in still air, and that bytes come to, over and over."""

    def __init__(self) -> None:
        airframe, site, values, field = place()
        self._world = make_world(airframe, site, seed=1, turbulence=0.0, field=field)
        self._world.held = True
        self._surfaces = airframe.surfaces.driven()
        self._command = SurfaceCommand(self._world.trim.elevator, 0.0, 0.0)
        self._vehicle, self._station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
        self._reader = mavlink.MAVLink(None)
        self._inputs: list[bytes] = []  # since the last tick
        self._known = 0, 0  # position, attitude that the module has received
        self.onboard = Onboard(
            setup_from(airframe, site, values), self._sent, 0.0, ModuleOptions(lockstep=True)
        )
        while self._world.time_s < ENGAGED_S:
            self._step()
        engage = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
        self._receive(engage, self._station)
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
            self._receive(mavlink.MAVLink_heartbeat_message(1, 3, 209, 0, 4, 3), self._vehicle)
        position, attitude = self._known
        self._known = world.position.sequence, world.attitude.sequence
        if world.position.sequence != position:
            stamp_ms = round(world.position.time_s * 1e3)
            reported = mavlink.MAVLink_local_position_ned_message(stamp_ms, *world.position[2:8])
            self._receive(reported, self._vehicle)
        if world.attitude.sequence != attitude:
            stamp_ms = round(world.attitude.time_s * 1e3)
            reported = mavlink.MAVLink_attitude_quaternion_message(stamp_ms, *world.attitude[2:9])
            self._receive(reported, self._vehicle)

    def _receive(self, message: mavlink.MAVLink_message, sender: mavlink.MAVLink) -> None:
        frame = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        self.onboard.event(bytes(frame), self._world.time_s)

    def _sent(self, frame: bytes) -> bool:
        """The autopilot does as it is commanded."""
        number = mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE
        if frame[0] == 0xFD and int.from_bytes(frame[7:10], "little") == number:
            reported = self._reader.decode(bytearray(frame))
            pulses = [getattr(reported, f"chan{surface.channel}_raw") for surface in self._surfaces]
            pairs = zip(self._surfaces, pulses, strict=True)
            self._command = SurfaceCommand(*(deflection_from_pwm(*pair) for pair in pairs))
            self._world.held = 0 in pulses  # given back: somebody catches it
        return True


@cache
def _flight() -> Flight:
    return Flight()


@cache
def _nobody() -> HostileFrames:
    return HostileFrames(1)


def mavlink_bytes(data: bytes) -> None:
    """Bytes from the link to the autopilot, as they are, while it soars."""
    _flight().take(data)


def messages(data: bytes) -> None:
    """A whole message of nobody, its numbers drawn from the bytes, while it soars."""
    random = Random(data)
    message = hostile_message(random, random.choice(RECEIVED_NAMES))
    _flight().take(_nobody().packed(message, random.choice((2, 9, 60, 200)), 1))


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
        self._models = encode_models(version, [self._body()])
        self._info = encode_server_info(version, data_port=1511, group="239.0.0.1", multicast=False)

    def ready(self) -> None:
        """Answer what it asks until it knows server and body, as a server does."""
        answers = {0: self._info, 4: self._models}
        for _ in range(4):  # who is there, what is there, and once more behind a restart
            for asked in self.tracker.poll(self.now_s):
                if asked[0] in answers:
                    self.tracker.take(answers[asked[0]], SERVER, self.now_s)
            if self.tracker.is_ready and self.tracker.info is not None:
                theirs = self.tracker.info.version == self.version
                if theirs and self.tracker.info.clock_hz == CLOCK_HZ:
                    return
                self.tracker.take(self._info, SERVER, self.now_s)  # another was reported
            self.now_s += 1.1
        raise WrongError("the tracker does not come to know its server again")

    def frame(self) -> bytes:
        """What the server sends now."""
        self._frames += 1
        ticks = round(self.now_s * CLOCK_HZ)
        scene = Scene(
            number=self._frames,
            bodies=[self._body()],
            time_s=self.now_s,
            exposed_ticks=ticks - 30_000,
            received_ticks=ticks,
            sent_ticks=ticks,
        )
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
    """Datagrams at a tracker that is ready: as they are, or with the head of a sort of them."""
    drawn = crc32(data)
    hall = _hall(VERSIONS[drawn % len(VERSIONS)])
    kind = (0, 7, 1, 5, 14)[(drawn >> 8) % 5]  # 0: as they are
    head = kind.to_bytes(2, "little") + len(data).to_bytes(2, "little") if kind else b""
    hall.ready()
    hall.now_s += 0.01
    for datagram in (hall.frame(), head + data):
        fix = hall.tracker.take(datagram, SERVER, hall.now_s)
        if fix is not None and not _is_a_measurement(fix, hall.now_s):
            raise WrongError(f"nonsense became a position: {datagram!r}")


def _is_a_measurement(fix: PositionFix, now_s: float) -> bool:
    numbers = fix.north_m, fix.east_m, fix.down_m, fix.sigma_m
    return all(map(isfinite, numbers)) and now_s - 0.3 <= fix.time_s <= now_s


def _answered(read: Callable[[], object], *answers: type[Exception]) -> None:
    """Read something; an error that the reader declares is an answer."""
    try:
        read()
    except answers:
        return


def _is_drawn(data: bytes) -> bool:
    """Of one input in 64, for what takes long beside the reading itself."""
    return crc32(data) % 64 == 0


def _from_file(data: bytes, read: Callable[[Path], object], *answers: type[Exception]) -> None:
    """Of one input in 64: from a file as well."""
    if _is_drawn(data):
        with tempfile.NamedTemporaryFile(suffix=".fuzz") as file:
            file.write(data)
            file.flush()
            _answered(lambda: read(Path(file.name)), *answers)


def _scenario_from(text: str, name: str) -> Scenario:
    return file_from(text, name, Scenario)


def config(data: bytes) -> None:
    """Airframe, site and scenario files."""
    text = data.decode("utf-8", "replace")
    for read in (airframe_from, site_from, _scenario_from):
        try:
            read(text, "fuzz")
        except ConfigError as error:
            if "not TOML" in str(error):  # it is none for the others either
                break
    for load in (load_airframe, load_site):
        _from_file(data, load, ConfigError)


def parameters(data: bytes) -> None:
    """Parameter files of either format."""
    text = data.decode("utf-8", "replace")
    _answered(lambda: read_text(text, "fuzz"), ParameterFileError)
    _from_file(data, read_file, ParameterFileError)


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


def flight_in(data: bytes) -> FlightData:
    """The flight in a log: its times are times, in their order."""
    flight = flight_from(data, Path("fuzz.log"))
    for name, series in flight.series().items():
        if not np.all(np.isfinite(series.time_s)) or np.any(np.diff(series.time_s) < 0.0):
            raise WrongError(f"the times of its {name} are none")
    if not 0.0 <= flight.duration_s < inf:
        raise WrongError(f"it lasts {flight.duration_s} s")
    return flight


def _log(data: bytes, beginning: bytes) -> None:
    """Bytes as they are, and with the beginning of a log where they have none."""
    if not data.startswith(beginning):
        _answered(lambda: flight_in(beginning + data), LogError)
    _answered(lambda: flight_in(data), LogError)
    _from_file(data, read_flight, LogError)


def log(data: bytes) -> None:
    """The module's ULog, with the beginning of one, as a flight."""
    _log(data, fuzz_logs.ULOG_BEGIN[:8])


def px4(data: bytes) -> None:
    """PX4's ULog, with the beginning of one, as a flight."""
    _log(data, fuzz_logs.ULOG_BEGIN[:8])


def dataflash(data: bytes) -> None:
    """ArduPilot's log, with the beginning of one, as a flight."""
    _log(data, MAGIC)


def tlog(data: bytes) -> None:
    """Telemetry logs: as they are, and the bytes as whole frames."""
    _log(data, b"")
    if len(data) <= SHORT:
        _answered(lambda: flight_in(fuzz_logs.recorded(data)), LogError)


def report(data: bytes) -> None:
    """The page of any log, without its figures: no markup of the log's is the page's."""
    _answered(lambda: _page(data), LogError)


def _page(data: bytes) -> Analysis:
    known = Surroundings(site="$site$", airframe=fuzz_logs.MARKUP)
    analysis = analysed(flight_in(data), known, HILL)
    if fuzz_logs.MARKUP in page_text(analysis, {}):
        raise WrongError("the page holds markup of the log's")
    return analysis


def figures(data: bytes) -> None:
    """The figures of any log and the page with them."""
    _answered(lambda: _drawn(data), LogError)


def _drawn(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        write_page(page, _page(data), lambda _words: None)
        if fuzz_logs.MARKUP in page.read_text(encoding="utf-8"):
            raise WrongError("a figure holds markup of the log's")


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
    "figures": figures,
}


_EVERY_LOG: Final = [*fuzz_logs.OWN, *fuzz_logs.PX4, *fuzz_logs.DATAFLASH, *fuzz_logs.TLOG]
LOGS: Final = {
    "log": fuzz_logs.OWN,
    "px4": fuzz_logs.PX4,
    "dataflash": fuzz_logs.DATAFLASH,
    "tlog": fuzz_logs.TLOG,
    "report": _EVERY_LOG,
    "figures": _EVERY_LOG,
}


def examples(target: str) -> list[bytes]:
    """Good input to begin from."""
    if target in ("mavlink", "messages"):
        frames = HostileFrames(1)
        return [frames.next() for _ in range(200)]
    if target == "config":
        scenarios = [path.read_bytes() for path in shipped("scenarios").glob("*.toml")]
        huge = b"[site]\nname = 'a'\norigin_north_m = " + b"9" * 5000
        whole = [AIRFRAME.read_bytes(), SITE.read_bytes(), huge, *scenarios]
        return [*whole, *map(without_words, whole), *SMALL_FILES]
    if target in ("parameters", "state"):
        return [
            b"# a comment\n1\t191\tTGL_X\t0.5\t9\nTGL_Z,1.5\n",
            b"1\t191\tOP_ENGAGE\t1\t9\n",
            b"TGL_LEAN 15\nRHO_P=1\n\xff\x00",
        ]
    if target in LOGS:
        return LOGS[target]
    datagrams = [Hall(version).frame() for version in VERSIONS]
    return [bytes(80), *datagrams, *(datagram[4:] for datagram in datagrams)]


def supply(target: str) -> Callable[[Random], bytes]:
    """What draws an input: a good example with its bytes changed, or its messages.

    Of logs and files short ones are drawn oftener, as they are read in less time.
    """
    known = examples(target)
    if target != "config" and target not in LOGS:
        return lambda random: mutated(random, random.choice(known))
    power = -1 if target == "config" else -2
    weights = list(accumulate(len(example) ** power for example in known))
    if target == "config":
        return lambda random: mutated(random, random.choices(known, cum_weights=weights)[0])
    taken_apart = [(example, *parts_of(example)) for example in known]

    def draw(random: Random) -> bytes:
        if target == "tlog" and random.getrandbits(2) == 0:
            return random.randbytes(random.randrange(SHORT))
        example, parts, seal = random.choices(taken_apart, cum_weights=weights)[0]
        if random.getrandbits(1):
            return mutated(random, example)
        return mutated_parts(random, parts, seal)

    return draw


class Tally(NamedTuple):
    """What a run by lot was."""

    inputs: int
    seconds: float  # of this thread's own time
    slowest_s: float  # of one input, likewise
    grown_bytes: int  # of address space, from the examples to the end


def by_lot(target: str, seconds: float, seed: int, count: int = sys.maxsize) -> Tally:
    """Mutations of examples for so long, or so many.

    Errors: what the target raises, with a note of the input; MemoryError where the process comes
    to hold more than `MOST_BYTES` beside what it held after the examples.
    """
    random, draw, take = Random(seed), supply(target), TARGETS[target]
    for example in examples(target):  # what is loaded once is no part of it
        take(example)
    held, done, slowest_s = _held_bytes(), 0, 0.0
    end, begin_s = time.monotonic() + seconds, time.thread_time()
    with _bound_to(held + MOST_BYTES):
        while done < count and time.monotonic() < end:
            data = draw(random)
            before_s = time.thread_time()
            try:
                take(data)
            except Exception as error:
                error.add_note(f"input {done} of seed {seed}: {data!r}")
                raise
            slowest_s = max(slowest_s, time.thread_time() - before_s)
            done += 1
    return Tally(done, time.thread_time() - begin_s, slowest_s, _held_bytes() - held)


def _held_bytes() -> int:
    """The process's address space."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


@contextmanager
def _bound_to(most_bytes: int) -> Iterator[None]:
    """Beyond so much address space a MemoryError."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


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
    parser.add_argument("--count", type=int, default=sys.maxsize, help="by lot: end after so many")
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
        done = by_lot(options.target, options.seconds, options.seed, options.count)
        print(
            f"{options.target}: {done.inputs:,} inputs of seed {options.seed}, nothing found;"
            f" {done.inputs / max(done.seconds, 1e-9):,.0f}/s, the slowest {done.slowest_s:.3f} s,"
            f" {done.grown_bytes / 2**20:.1f} MiB more memory"
        )
        return 0
    guided(options.target, options.seconds, atheris)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

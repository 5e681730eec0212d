#!/usr/bin/env python3
"""Throw bytes at everything that reads them, guided by coverage where atheris is installed.

    python tools/fuzz.py mavlink --seconds 60
    python tools/fuzz.py list

A target takes any bytes and raises only where something is wrong: an error that a reader
declares is an answer.  `mavlink` and `messages` go through the whole module in flight, and look
at the parameters and at who flies afterwards.  Without atheris (pip install 'tgl_soar[fuzz]')
the bytes are mutations of good examples, drawn by lot.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from pathlib import Path
from random import Random
from typing import Any, Final


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
    from tgl_soar.config import (
        Airframe,
        ConfigError,
        Site,
        load_airframe,
        load_file,
        load_parameters,
        load_site,
        shipped,
    )
    from tgl_soar.experiments.scenario import Scenario
    from tgl_soar.flightlog.reader import LogError, read_log
    from tgl_soar.geometry import HallFrame
    from tgl_soar.link.optitrack import Optitrack, Settings
    from tgl_soar.onboard import Onboard, setup_from
    from tgl_soar.parameter_files import ParameterFileError, read_file
    from tgl_soar.parameter_store import Identity, StoreError, read_state, state_text
    from tgl_soar.parameters import ParameterSet
    from tgl_soar.sim.hostile import HEARD_NAMES, HostileFrames, hostile_message

AIRFRAME, SITE = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
IDENTITY: Final = Identity("airframe", "site", 1, 191)


class WrongError(AssertionError):
    """Bytes did what bytes must not do."""


def _module() -> Onboard:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    return Onboard(setup_from(airframe, site, values), lambda _frame: True, 100.0)


class Flight:
    """One module that bytes come to, over and over."""

    def __init__(self) -> None:
        self.onboard = _module()
        self.now_s = 100.0
        self.expected: ParameterSet = self.onboard.parameters.values

    def take(self, data: bytes) -> None:
        """Bytes, then a tick."""
        onboard = self.onboard
        onboard.event(data, self.now_s)
        self.now_s += 0.005
        onboard.periodic(self.now_s)
        if onboard.parameters.values != self.expected:
            raise WrongError(f"parameters were changed by {data!r}")
        if onboard.has_surfaces or onboard.counters.unsendable:
            raise WrongError(f"surfaces or messages went wrong by {data!r}")


@cache
def _flight() -> Flight:
    return Flight()


def mavlink(data: bytes) -> None:
    """Bytes from the link to the autopilot, as they are."""
    _flight().take(data)


def messages(data: bytes) -> None:
    """Whole messages of nobody, their numbers drawn from the bytes."""
    random = Random(data)
    frames = HostileFrames(random.getrandbits(32))
    flight = _flight()
    for _ in range(1 + len(data) % 4):
        message = hostile_message(random, random.choice(HEARD_NAMES))
        flight.take(frames.packed(message, random.choice((2, 9, 60, 200)), 1))


@cache
def _tracker() -> Optitrack:
    hall = HallFrame(False, 0.6, 1.0, -2.0, 0.25)
    return Optitrack(Settings("10.0.0.2", "aircraft", True, hall, 0.001, 0.02, 25.0, 0.3, 200.0))


def natnet(data: bytes) -> None:
    """Datagrams of a tracker, whole ones and their bodies."""
    tracker = _tracker()
    for number in (1, 5, 7, 14):
        tracker.take(data, ("10.0.0.2", 1510), 100.0)
        framed = number.to_bytes(2, "little") + len(data).to_bytes(2, "little") + data
        if tracker.take(framed, ("10.0.0.2", 1510), 100.0) is not None:
            raise WrongError(f"nonsense became a position: {data!r}")
    tracker.poll(100.0)


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
    from zlib import crc32

    empty = state_text(IDENTITY, {})
    text = empty[: empty.rindex(b"# checksum")] if b"# checksum" in empty else b""
    mark = empty[len(text) : -9]
    text += data + b"\n"
    return text + mark + f"{crc32(text):08x}\n".encode()


def log(data: bytes) -> None:
    """Flight logs, with the beginning of one."""
    begin = b"ULog\x01\x12\x35\x01" + bytes(8)
    for text in (data, begin + data):
        _read(text, read_log, LogError)


TARGETS: Final[dict[str, Callable[[bytes], None]]] = {
    "mavlink": mavlink,
    "messages": messages,
    "natnet": natnet,
    "config": config,
    "parameters": parameters,
    "state": state,
    "log": log,
}


def examples(target: str) -> list[bytes]:
    """Good input to begin from."""
    if target in ("mavlink", "messages"):
        frames = HostileFrames(1)
        return [frames.next() for _ in range(200)]
    if target == "config":
        return [AIRFRAME.read_bytes(), SITE.read_bytes()] + [
            path.read_bytes() for path in shipped("scenarios").glob("*.toml")
        ]
    if target in ("parameters", "state"):
        return [
            b"# a comment\n1\t191\tTGL_X\t0.5\t9\nTGL_Z,1.5\n",
            b"1\t191\tOP_ENGAGE\t1\t9\n",
            b"TGL_LEAN 15\nRHO_P=1\n\xff\x00",
        ]
    if target == "log":
        return [b"F\x00\x05tick:", b"B\x28\x00" + bytes(40), b"I\x08\x00\x04char[1]x1"]
    return [bytes(80), b"\x05\x00\x10\x00" + bytes(16)]


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

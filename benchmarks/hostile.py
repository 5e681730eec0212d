"""A flight under hostile frames: how long a tick takes, and whether memory grows.

The module flies in lockstep with nobody but itself: two attitudes are due every hundredth of a
second, a position and now and then a heartbeat.  Quiet and under fire take turns, tick by tick,
so that whatever else the machine does meets both alike; under fire, hostile frames come between
every two ticks.  A tick counts by the processor's time that it takes, without that of other
programs that come in between: their slices would be the p99 of both; once alone, and once with the
handling of the frames that came before it, which the loop does before it can tick.

`python -m benchmarks.hostile --frames 1000000` says all of it; the suite of benchmarks takes fewer.
"""

from __future__ import annotations

import argparse
import gc
import tracemalloc
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from time import perf_counter, thread_time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.campaigns.long_flight import resident_kib
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim.hostile import HostileFrames

from .hanging import REPORTED
from .result import Result, percentile

FRAMES = 40_000
POOL = 5_000  # made before, so that making them is not measured
PER_TICK = 10
TICK_S = 0.005
ALLOWED_US = 0.1 * TICK_S * 1e6


@dataclass
class Fired:
    """What came of it."""

    quiet_us: array[float]  # of every tick
    fired_us: array[float]
    loaded_us: array[float]  # the same ticks with the handling of the frames before them
    frames: int = 0
    grown_bytes: int = 0  # of memory that Python knows of, from a tenth of the frames on
    grown_kib: int = 0  # of the process, likewise
    changed: bool = False  # a parameter, or who flies
    still_flying: bool = False
    refused: int = 0  # frames that were counted and not used


class Flown:
    """One module in flight, held where it is, and its autopilot."""

    def __init__(self) -> None:
        airframe_path, site_path = (
            shipped("airframes/eclipson_c.toml"),
            shipped("sites/tunnel.toml"),
        )
        airframe, site = load_airframe(airframe_path), load_site(site_path)
        values = load_parameters(airframe, airframe_path, site, site_path).changed(REPORTED)
        self.onboard = Onboard(setup_from(airframe, site, values), lambda _frame: True, 1000.0)
        self.now_s = 1000.0
        self._at = values["TGL_X"], values["TGL_Z"]
        self._vehicle, self._station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
        self._ticks = 0
        self.run(600)
        self._receive(
            mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9), self._station
        )
        self.run(600)

    @property
    def flies(self) -> bool:
        """Whether the module has the surfaces."""
        return self.onboard.output is not None and self.onboard.output.active

    @property
    def refused(self) -> int:
        """Frames that were counted as cut, unknown, undecodable, or a stranger's."""
        read, session = self.onboard.decoder.counters, self.onboard.session.counters
        return read.bad_checksums + read.unknown + read.undecodable + session.foreign

    def set_values(self) -> list[float]:
        """Every parameter but the switch, which shows how the flight stands."""
        values = self.onboard.parameters.values
        return [value for parameter, value in values if parameter.name != "OP_ENGAGE"]

    def _receive(self, message: object, sender: mavlink.MAVLink) -> None:
        frame = message.pack(sender)  # type: ignore[attr-defined]
        sender.seq = (sender.seq + 1) % 256
        self.onboard.event(bytes(frame), self.now_s)

    def run(self, ticks: int) -> None:
        """So many, quiet and not timed."""
        for _ in range(ticks):
            self.tick()

    def tick(self) -> float:
        """One tick with what the autopilot sends for it; the processor's time for it [µs]."""
        self.now_s += TICK_S
        stamp_ms = round((self.now_s - 1000.0) * 1e3)
        noise = 1e-6 * (stamp_ms % 7)  # nothing that is measured repeats itself
        x_m, z_m = self._at
        if self._ticks % 200 == 0:
            self._receive(mavlink.MAVLink_heartbeat_message(1, 3, 209, 0, 4, 3), self._vehicle)
        if self._ticks % 4 == 0:
            message = mavlink.MAVLink_local_position_ned_message(
                stamp_ms, -x_m, 0, -z_m + noise, 0, 0, 0
            )
            self._receive(message, self._vehicle)
        message = mavlink.MAVLink_attitude_quaternion_message(stamp_ms, 1, noise, 0, 0, 0, 0, 0)
        self._receive(message, self._vehicle)
        self._ticks += 1
        begun = thread_time()
        self.onboard.periodic(self.now_s)
        return (thread_time() - begun) * 1e6


def fire(frames: int, *, trace: bool = False) -> Fired:
    """Fly under so many hostile frames."""
    rounds = -(-frames // PER_TICK)
    room = bytes(8 * rounds)  # made before, so that it does not count as growth
    flown, fired = Flown(), Fired(array("d", room), array("d", room), array("d", room))
    pool = list(islice(HostileFrames(1), min(POOL, frames)))
    supply = cycle(pool)
    before = flown.set_values()
    base: tuple[int, int] | None = None
    if trace:
        tracemalloc.start()
    for i in range(rounds):
        fired.quiet_us[i] = flown.tick()
        volley = list(islice(supply, PER_TICK))
        begun = thread_time()
        for frame in volley:
            flown.onboard.event(frame, flown.now_s)
        handling_us = (thread_time() - begun) * 1e6
        fired.frames += PER_TICK
        fired.fired_us[i] = flown.tick()
        fired.loaded_us[i] = handling_us + fired.fired_us[i]
        if base is None and fired.frames >= frames // 10:
            gc.collect()
            base = tracemalloc.get_traced_memory()[0], resident_kib()
    assert base is not None
    gc.collect()
    fired.grown_kib = resident_kib() - base[1]
    if trace:
        fired.grown_bytes = tracemalloc.get_traced_memory()[0] - base[0]
        tracemalloc.stop()
    fired.changed = flown.set_values() != before
    fired.still_flying = flown.flies
    fired.refused = flown.refused
    return fired


def hostile_tick() -> Iterator[Result]:
    """The tick between hostile frames against quiet: with their handling, and alone."""
    fired = fire(FRAMES)
    for name, fraction in (("p50", 0.5), ("p99", 0.99)):
        yield Result(
            what=f"{PER_TICK} hostile frames and the tick after them, {name}",
            value=percentile(fired.loaded_us, fraction),
            reference=percentile(fired.quiet_us, fraction),
            unit="µs",
            reference_what="the tick when it is quiet",
        )
    yield Result(
        what=f"{PER_TICK} hostile frames and the tick after them, p99",
        value=percentile(fired.loaded_us, 0.99),
        reference=ALLOWED_US,
        unit="µs",
        reference_what="a tenth of the period",
        aim=1.0,
    )
    yield Result(
        what="tick p99 between hostile frames, without their handling",
        value=percentile(fired.fired_us, 0.99),
        reference=percentile(fired.quiet_us, 0.99),
        unit="µs",
        reference_what="between none",
    )


BENCHMARKS = (hostile_tick,)


def main() -> int:
    """Fire, and say what came of it; 1 if anything did."""
    parser = argparse.ArgumentParser(prog="benchmarks.hostile", description=fire.__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    frames = max(PER_TICK, parser.parse_args().frames)
    begun = perf_counter()
    fired = fire(frames)
    took_s = perf_counter() - begun
    traced = fire(max(PER_TICK, frames // 10), trace=True)
    quiet_us, between_us, with_us = (
        percentile(each, 0.99) for each in (fired.quiet_us, fired.fired_us, fired.loaded_us)
    )
    print(
        f"{fired.frames:,} hostile frames in {took_s:.0f} s: no exception;"
        f" a parameter changed: {fired.changed}; still flying: {fired.still_flying}\n"
        f"tick p99 {quiet_us:.0f} µs when it is quiet; between them {between_us:.0f} µs"
        f" ({between_us / quiet_us:.2f} times), with the handling of the {PER_TICK} before it"
        f" {with_us:.0f} µs ({with_us / quiet_us:.2f} times)\n"
        f"memory: {fired.grown_kib} KiB more of the process after the first tenth;"
        f" {traced.grown_bytes} bytes more in Python over {traced.frames:,} frames"
    )
    return int(fired.changed or not fired.still_flying)


if __name__ == "__main__":
    raise SystemExit(main())

"""One tick by its parts, in flight, with a log, and with everything that an autopilot sends.

The module flies without sockets, timed from the datagram to the end of all that it sets off.  The
parts are the module's own functions, called with what that flight has received, one after the other
beside it: native code cannot be looked into from outside.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter_ns
from typing import ParamSpec, TypeVar

from tgl_soar.autopilot import initial_state, step
from tgl_soar.control.envelope import elevator_limit, limit_surfaces
from tgl_soar.control.laws import laws_from
from tgl_soar.estimation.health import health_step
from tgl_soar.estimation.motion import motion_step
from tgl_soar.estimation.wind import wind_step
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.session import Session, SessionOptions
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.types import Inputs

from . import caches
from .lengths import length
from .module_flight import TICK_S, ModuleFlight
from .processes import by_the_source, is_native
from .result import INTERPRETED, Result, percentile

TICKS, SLEEPY_TICKS, COLD_TICKS = 4000, 1000, 1000
FLUSH_TICKS, FLUSH_S = 400, 0.02
PERIOD_US = TICK_S * 1e6
COLD_ALLOWED_US = 1000.0
P50_ALLOWED, P99_ALLOWED = 0.015, 0.03  # of the period
REST = "dispatch, and what may wait: telemetry, streams, parameters"

_Given = ParamSpec("_Given")
_Made = TypeVar("_Made")


def parts() -> Iterator[Result]:
    """The whole, the whole after a sleep, and the median of each part."""
    with ExitStack() as stack:
        gc.collect()
        gc.disable()  # as in flight
        stack.callback(gc.enable)
        flight = ModuleFlight(_recorder(stack)).engaged()
        whole = _whole(flight, TICKS)
        after_sleep = _whole(flight, SLEEPY_TICKS, lambda: time.sleep(TICK_S))
        cold = _whole(flight, length(COLD_TICKS), caches.empty)
        again, times = _times(ModuleFlight(_recorder(stack)).engaged(), _recorder(stack))
    for name, fraction, allowed in (("p50", 0.5, P50_ALLOWED), ("p99", 0.99, P99_ALLOWED)):
        yield Result(
            what=f"a tick, all of it, {name}",
            value=percentile(whole, fraction),
            reference=PERIOD_US * allowed,
            unit="µs",
            reference_what=f"{100 * allowed:g} % of the period",
            aim=1.0,
        )
    if is_native():
        interpreted = by_the_source("parts")[0]
        yield Result(
            what=interpreted.what,
            value=percentile(whole, 0.5),
            reference=interpreted.value,
            unit="µs",
            reference_what=INTERPRETED,
        )
    for how, times_us in (("after 5 ms of sleep", after_sleep), ("with empty caches", cold)):
        for name, fraction in (("p50", 0.5), ("p99", 0.99)):
            yield Result(
                what=f"a tick {how}, {name}",
                value=percentile(times_us, fraction),
                reference=percentile(whole, fraction),
                unit="µs",
                reference_what="one right after the other",
            )
        yield Result(
            what=f"a tick {how}, p99",
            value=percentile(times_us, 0.99),
            reference=COLD_ALLOWED_US,
            unit="µs",
            reference_what="the age that a sample may have at the surface",
            aim=1.0,
        )
    whole_us = percentile(again, 0.5)
    medians = {name: percentile(of_ticks, 0.5) for name, of_ticks in times.items()}
    inside = ("estimate: motion", "estimate: health", "estimate: wind", "limit")
    medians["decide and control"] -= sum(medians[name] for name in inside)
    medians[REST] = whole_us - sum(medians.values())
    for name, us in medians.items():
        yield Result(
            what=f"of a tick: {name}",
            value=us,
            reference=whole_us,
            unit="µs",
            reference_what="a tick, all of it, beside it",
        )


BENCHMARKS = (parts,)


def _recorder(stack: ExitStack) -> FlightRecorder:
    """A log in a folder that goes away."""
    folder = stack.enter_context(TemporaryDirectory(prefix="tgl_soar_bench_"))
    recorder = FlightRecorder(Path(folder), LogMetadata({"sys_name": "tgl_soar"}, {}), 0.0)
    recorder.start()
    stack.callback(recorder.stop)
    return recorder


def _whole(
    flight: ModuleFlight, ticks: int, before_each: Callable[[], None] | None = None
) -> list[float]:
    """µs from the datagram to the end of all that it sets off."""
    times = []
    for i in range(ticks):
        data = flight.piece()
        if before_each is not None:
            before_each()
        times.append(_tick(flight, data))
        _let_the_log_be_written(i)
    assert flight.onboard.output is not None
    assert flight.onboard.output.active, "the module did not fly"
    return times


def _tick(flight: ModuleFlight, data: bytes) -> float:
    onboard = flight.onboard
    begun = perf_counter_ns()
    onboard.event(data, flight.now_s)
    if onboard.clocking.due(flight.now_s):
        onboard.periodic(flight.now_s)
    return (perf_counter_ns() - begun) / 1e3


def _let_the_log_be_written(tick: int) -> None:
    if tick % FLUSH_TICKS == 0:
        time.sleep(FLUSH_S)


class _Clock:
    """µs of each call, by part; in one tick a part may have several."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {}
        self._ticks = 0

    def next_tick(self) -> None:
        self._ticks += 1

    def time(
        self, part: str, call: Callable[_Given, _Made], *given: _Given.args, **named: _Given.kwargs
    ) -> _Made:
        """What the call gives."""
        begun = perf_counter_ns()
        made = call(*given, **named)
        took = (perf_counter_ns() - begun) / 1e3
        of_part = self.times.setdefault(part, [])
        if len(of_part) < self._ticks:
            of_part.append(0.0)
        of_part[-1] += took
        return made


def _times(
    flight: ModuleFlight, recorder: FlightRecorder
) -> tuple[list[float], dict[str, list[float]]]:
    """µs of every tick, and of its parts: a module's, taken apart, that receives the same."""
    setup = flight.onboard.setup
    flavour, values = setup.flavour, setup.parameters
    decoder, encoder = Decoder(stream=False), Encoder(setup.override)
    session = Session(
        SessionOptions(own=setup.own, flavour=flavour, loop_rate_hz=values["LOOP_RATE"])
    )
    laws = laws_from(values, setup.frame, setup.aerodynamics, setup.ground)
    state = initial_state()
    recorder.parameters(values)
    clock, whole = _Clock(), []
    for i in range(TICKS):
        data = flight.piece()
        whole.append(_tick(flight, data))
        clock.next_tick()
        now_s = flight.now_s
        for received in clock.time("decode", decoder.feed, data):
            clock.time("clocks and sources", session.handle, received, now_s)
        inputs = Inputs(
            time_s=now_s,
            position=session.position,
            attitude=session.attitude,
            autopilot=session.status,
            engage=True,
            imu=session.imu,
            airspeed=session.airspeed,
            surfaces=session.surfaces,
        )
        motion, vehicle = clock.time(
            "estimate: motion", motion_step, laws.motion, laws.frame, state.memory.motion, inputs
        )
        clock.time(
            "estimate: health",
            health_step,
            laws.health,
            state.memory.health,
            motion,
            inputs,
            True,
            True,
            state.loops.limited.command,
            TICK_S,
        )
        clock.time(
            "estimate: wind",
            wind_step,
            laws.wind,
            state.memory.wind,
            vehicle,
            inputs,
            0.1,
            0.0,
            True,
        )
        state, output = clock.time("decide and control", step, laws, state, inputs)
        clock.time(
            "limit",
            limit_surfaces,
            laws.envelope,
            state.loops.limited.command,
            output.command,
            elevator_limit(laws.envelope, laws.trim.elevator, 0.1, 0.0),
            1.0,
            True,
            TICK_S,
        )
        for message in clock.time("encode", flavour.commands, output.command, output.setpoints):
            clock.time("encode", encoder.encode, message)
        clock.time("trace", recorder.tick, inputs, output, state)
        recorder.poll()
        _let_the_log_be_written(i)
    assert output.active, "the module taken apart did not fly"
    return whole, clock.times

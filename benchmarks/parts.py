"""One tick by its parts, in flight, with a log, and with everything that an autopilot sends.

The module flies without sockets; what it calls is wrapped in clocks.  The time of a part holds
that of the clocks inside it: about a twentieth of a microsecond each.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter_ns
from typing import Any
from unittest import mock

from tgl_soar import autopilot
from tgl_soar.flightlog.writer import Facts, FlightRecorder

from .module_flight import TICK_S, ModuleFlight
from .result import Result, percentile

TICKS, SLEEPY_TICKS = 4000, 1000
FLUSH_TICKS, FLUSH_S = 100, 0.01
PERIOD_US = TICK_S * 1e6
P50_ALLOWED, P99_ALLOWED = 0.015, 0.03  # of the period


def parts() -> Iterator[Result]:
    """The whole, the whole after a sleep, and the median of each part."""
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory(prefix="tgl_soar_bench_"))
        recorder = FlightRecorder(Path(folder), Facts({"sys_name": "tgl_soar"}, {}), 0.0)
        recorder.start()
        stack.callback(recorder.stop)
        flight = ModuleFlight(recorder).engaged()
        gc.collect()
        gc.disable()  # as in flight
        stack.callback(gc.enable)
        whole = _whole(flight, TICKS)
        after_sleep = _whole(flight, SLEEPY_TICKS, asleep_s=TICK_S)
        times = _times(flight, recorder)
    for name, share, allowed in (("p50", 0.5, P50_ALLOWED), ("p99", 0.99, P99_ALLOWED)):
        yield Result(
            f"a tick, all of it, {name}",
            percentile(whole, share),
            PERIOD_US * allowed,
            "µs",
            f"{100 * allowed:g} % of the period",
            1.0,
        )
    yield Result(
        "a tick after 5 ms of sleep, p50",
        percentile(after_sleep, 0.5),
        percentile(whole, 0.5),
        "µs",
        "one right after the other",
    )
    sum_us = sum(percentile(of_ticks, 0.5) for of_ticks in times.values())
    for name, of_ticks in times.items():
        yield Result(
            f"of a tick: {name}", percentile(of_ticks, 0.5), sum_us, "µs", "all parts, clocks too"
        )


BENCHMARKS = (parts,)


def _whole(flight: ModuleFlight, ticks: int, asleep_s: float = 0.0) -> list[float]:
    """µs from the datagram to the end of all that it sets off."""
    onboard, times = flight.onboard, []
    for i in range(ticks):
        data = flight.piece()
        if asleep_s > 0.0:
            time.sleep(asleep_s)
        begun = perf_counter_ns()
        onboard.event(data, flight.now_s)
        if onboard.due(flight.now_s):
            onboard.periodic(flight.now_s)
        times.append((perf_counter_ns() - begun) / 1e3)
        _let_the_log_be_written(i)
    assert onboard.output is not None
    assert onboard.output.active, "the module did not fly"
    return times


def _let_the_log_be_written(tick: int) -> None:
    if tick % FLUSH_TICKS == 0:
        time.sleep(FLUSH_S)


class _Clocks:
    """What was spent where, each nanosecond in one place only."""

    def __init__(self) -> None:
        self.spent_ns: dict[str, int] = {}
        self._within_ns = [0]  # for each call under way: what calls inside it have taken

    def around(self, part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The call, timed."""
        self.spent_ns[part] = 0
        within_ns = self._within_ns

        def timed(*arguments: Any, **named: Any) -> Any:
            begun = perf_counter_ns()
            within_ns.append(0)
            try:
                return call(*arguments, **named)
            finally:
                took = perf_counter_ns() - begun
                self.spent_ns[part] += took - within_ns.pop()
                within_ns[-1] += took

        return timed

    def read(self) -> dict[str, float]:
        """µs of each part since the last time."""
        spent = {part: ns / 1e3 for part, ns in self.spent_ns.items()}
        self.spent_ns = dict.fromkeys(self.spent_ns, 0)
        return spent


def _times(flight: ModuleFlight, recorder: FlightRecorder) -> dict[str, list[float]]:
    """µs of every tick, by part."""
    onboard, clocks = flight.onboard, _Clocks()
    route, flavour = onboard._autopilot, onboard._setup.flavour
    wrapped: tuple[tuple[object, str, str], ...] = (
        (route.decoder, "feed", "decode"),
        (onboard.session, "handle", "clocks and sources"),
        (autopilot, "motion_step", "estimate: motion"),
        (autopilot, "health_step", "estimate: health"),
        (autopilot, "wind_step", "estimate: wind"),
        (autopilot, "step", "decide and control"),
        (autopilot, "limit_surfaces", "limit"),
        (flavour, "commands", "encode"),
        (route.override, "encode", "encode"),
        (recorder, "tick", "trace"),
        (onboard, "_slow", "what may wait: telemetry, streams, parameters"),
        (onboard, "event", "dispatch"),
        (onboard, "periodic", "dispatch"),
    )
    times: dict[str, list[float]] = {}
    with ExitStack() as stack:
        for owner, name, part in wrapped:
            timed = clocks.around(part, getattr(owner, name))
            stack.enter_context(mock.patch.object(owner, name, timed))
        for i in range(TICKS):
            data = flight.piece()
            clocks.read()
            onboard.event(data, flight.now_s)
            if onboard.due(flight.now_s):
                onboard.periodic(flight.now_s)
            spent = clocks.read()
            for part, us in spent.items():
                times.setdefault(part, []).append(us)
            _let_the_log_be_written(i)
    return times

"""The parameter server from outside: how long a listing and a set take, and what a flood costs.

The module runs in this process, tick by tick at its own rate, fed by frames as a link brings
them; nothing waits on a socket, so that what is timed is the module.
"""

from __future__ import annotations

from statistics import median, quantiles
from time import perf_counter

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.parameters import PARAMETERS

from .module_flight import TICK_S, ModuleFlight
from .result import Result

TICKS = 3000
FLOOD_HZ = 2000.0


def listing() -> Result:
    """Flight time from PARAM_REQUEST_LIST to the last value."""
    flight = ModuleFlight().engaged()
    begun = flight.now_s
    flight.onboard.event(
        flight.ask(mavlink.MAVLink_param_request_list_message(1, 191)), flight.now_s
    )
    missing = set(range(len(PARAMETERS)))
    decoder = mavlink.MAVLink(None)
    while missing:
        flight.tick()
        for frame in flight.frames:
            message = decoder.decode(bytearray(frame))
            if message.get_type() == "PARAM_VALUE":
                missing.discard(message.param_index)
        flight.frames.clear()
        assert flight.now_s - begun < 60.0, missing
    return Result(
        what=f"listing of {len(PARAMETERS)} parameters",
        value=flight.now_s - begun,
        reference=2.0,
        unit="s",
        reference_what="allowed",
    )


def confirmed_set() -> Result:
    """From the arrival of a PARAM_SET to the frame that confirms it, the laws made again."""
    flight = ModuleFlight().engaged()
    times, parse = [], []
    decoder = mavlink.MAVLink(None)
    for i in range(600):
        value = 0.2 + 0.001 * (i % 100)
        frame = flight.ask(mavlink.MAVLink_param_set_message(1, 191, b"TGL_X", value, 9))
        flight.frames.clear()
        before = perf_counter()
        flight.onboard.event(frame, flight.now_s)
        after = perf_counter()
        decoder.decode(bytearray(frame))
        parse.append(perf_counter() - after)
        times.append(after - before)
        answer = mavlink.MAVLink(None).decode(bytearray(flight.frames[0]))
        assert (answer.get_type(), answer.param_id) == ("PARAM_VALUE", "TGL_X")
        flight.tick()
        # The line that is flown moves from the very next tick on.
        assert abs(flight.onboard.settings.laws.target.x_m - value) < 1e-6
    return Result(
        what="a set, to its confirmation",
        value=median(times) * 1e6,
        reference=median(parse) * 1e6,
        unit="µs",
        reference_what="pymavlink parses the PARAM_SET",
    )


def _ticks_under_flood() -> tuple[list[float], list[float]]:
    """Times of ticks, quiet and with requests between them, in turns of the same run."""
    flight = ModuleFlight().engaged()
    quiet: list[float] = []
    flooded: list[float] = []
    per_tick = round(FLOOD_HZ * TICK_S)
    for i in range(2 * TICKS):
        flood = i // 100 % 2 == 1
        if flood:
            for k in range(per_tick):
                index = (i * per_tick + k) % len(PARAMETERS)
                ask = mavlink.MAVLink_param_request_read_message(1, 191, b"", index)
                flight.onboard.event(flight.ask(ask), flight.now_s)
        (flooded if flood else quiet).append(flight.tick())
        flight.frames.clear()
    return quiet, flooded


def tick_under_flood() -> Result:
    """Median time of a tick with all that is slow, while 2,000 requests a second come in."""
    quiet, flooded = _ticks_under_flood()
    return Result(
        what="tick under 2,000 parameter requests/s, median",
        value=median(flooded) * 1e6,
        reference=median(quiet) * 1e6,
        unit="µs",
        reference_what="the same tick when it is quiet",
    )


def late_tick_under_flood() -> Result:
    """What nine of ten of the same ticks stay below."""
    quiet, flooded = _ticks_under_flood()
    return Result(
        what="tick under 2,000 parameter requests/s, 90 %",
        value=quantiles(flooded, n=10)[8] * 1e6,
        reference=quantiles(quiet, n=10)[8] * 1e6,
        unit="µs",
        reference_what="the same tick when it is quiet",
    )


BENCHMARKS = (listing, confirmed_set, tick_under_flood, late_tick_under_flood)

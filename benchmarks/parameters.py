"""The parameter server from outside: how long a listing and a set take, and what a flood costs.

The module runs in this process, tick by tick at its own rate, fed by frames as a link brings
them; nothing waits on a socket, so that what is timed is the module.
"""

from __future__ import annotations

from statistics import median, quantiles
from time import perf_counter

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard import Onboard, setup_from
from tgl_soar.parameters import PARAMETERS

from .result import Result

TICK_S = 0.005
TICKS = 3000
WARM_UP = 400
FLOOD_HZ = 2000.0


class _Flight:
    """The module in the air, and a vehicle and a station that talk to it."""

    def __init__(self) -> None:
        airframe_path, site_path = (
            shipped("airframes/eclipson_c.toml"),
            shipped("sites/tunnel.toml"),
        )
        airframe, site = load_airframe(airframe_path), load_site(site_path)
        values = load_parameters(airframe, airframe_path, site, site_path)
        self.frames: list[bytes] = []
        self.now_s = 100.0
        self.onboard = Onboard(setup_from(airframe, site, values), self._take, self.now_s)
        self._vehicle = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._ticks = 0

    def _take(self, frame: bytes) -> bool:
        self.frames.append(frame)
        return True

    def ask(self, message: mavlink.MAVLink_message) -> bytes:
        """A frame of the station's."""
        frame = bytes(message.pack(self._station))
        self._station.seq = (self._station.seq + 1) % 256
        return frame

    def tick(self) -> float:
        """What a vehicle says in one period, then the tick; the tick's time."""
        self._ticks += 1
        self.now_s += TICK_S
        stamp = round(self._ticks * TICK_S * 1e3)
        messages = [mavlink.MAVLink_attitude_quaternion_message(stamp, 1, 0, 0, 0, 0, 0, 0)]
        if self._ticks % 4 == 1:
            messages.append(
                mavlink.MAVLink_local_position_ned_message(stamp, 0.2, 0, -1.15, 0, 0, 0)
            )
        if self._ticks % 200 == 1:
            messages.append(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        for message in messages:
            self.onboard.event(bytes(message.pack(self._vehicle)), self.now_s)
        before = perf_counter()
        if self.onboard.due(self.now_s):
            self.onboard.periodic(self.now_s)
        return perf_counter() - before

    def engaged(self) -> _Flight:
        """In the air."""
        for _ in range(WARM_UP):
            self.tick()
        self.onboard.event(
            self.ask(mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)), self.now_s
        )
        for _ in range(WARM_UP):
            self.tick()
        assert self.onboard.output is not None
        assert self.onboard.output.active
        self.frames.clear()
        return self


def listing() -> Result:
    """Flight time from PARAM_REQUEST_LIST to the last value."""
    flight = _Flight().engaged()
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
        f"listing of {len(PARAMETERS)} parameters", flight.now_s - begun, 2.0, "s", "allowed"
    )


def confirmed_set() -> Result:
    """From the arrival of a PARAM_SET to the frame that confirms it, the laws made anew."""
    flight = _Flight().engaged()
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
        assert abs(flight.onboard._laws.target.x_m - value) < 1e-6
    return Result(
        "a set, to its confirmation",
        median(times) * 1e6,
        median(parse) * 1e6,
        "µs",
        "pymavlink parses the PARAM_SET",
    )


def _ticks_under_flood() -> tuple[list[float], list[float]]:
    """Times of ticks, quiet and with requests between them, in turns of the same run."""
    flight = _Flight().engaged()
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
        "tick under 2,000 parameter requests/s, median",
        median(flooded) * 1e6,
        median(quiet) * 1e6,
        "µs",
        "the same tick when it is quiet",
    )


def late_tick_under_flood() -> Result:
    """What nine of ten of the same ticks stay below."""
    quiet, flooded = _ticks_under_flood()
    return Result(
        "tick under 2,000 parameter requests/s, 90 %",
        quantiles(flooded, n=10)[8] * 1e6,
        quantiles(quiet, n=10)[8] * 1e6,
        "µs",
        "the same tick when it is quiet",
    )


BENCHMARKS = (listing, confirmed_set, tick_under_flood, late_tick_under_flood)

"""A day of the page without waiting for it: some telemetry over and over, time an argument.

The telemetry is a simulated flight's.  In front of it stands what a day has besides: a module that
answers what is set, texts, a restart every hour, and an operator who drags the line four times a
minute.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

from page_flight import AIRFRAME, SITE, TOKEN, Flown
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.page.broadcast import FRAMES_PER_S, STALLED_S
from tgl_soar.cli.page.browser_requests import Look, Move, SetParameter
from tgl_soar.cli.page.desk import Desk
from tgl_soar.cli.page.scene import place_of
from tgl_soar.cli.page.station import Station
from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.link.open_link import LinkCounters


class Memory(NamedTuple):
    """Of the server, after so many hours."""

    hours: float
    blocks: int
    resident_kb: int


FRAME_S: Final = 1.0 / FRAMES_PER_S
HOUR_S: Final = 3600.0
TEXT_S: Final = 2.0  # between two texts
MOVE_S: Final = 15.0
DRAG_S: Final = 1.0
PAGES: Final = 3  # one of which takes nothing
A, B = (0.20, 1.15), (0.60, 1.60)


def telemetry_of_flight(seconds: float) -> list[list[bytes]]:
    """What a ground station receives of a flight that is engaged, by frames of the page."""
    flown = Flown()
    flown.run(6.0)
    flown.onboard.settings.assign("OP_ENGAGE", 1.0)
    flown.run(6.0)
    # Heartbeats of the module are the day's own: they count its restarts.
    own = bytes((1, 191, *mavlink.MAVLINK_MSG_ID_HEARTBEAT.to_bytes(3, "little")))
    return [
        [data for data in flown.run(FRAME_S) if data[5:10] != own]
        for _ in range(round(seconds / FRAME_S))
    ]


class DayLink:
    """The far end of a link: that telemetry, and a module that accepts whatever is set."""

    name, is_stream, generation = "day", False, 0

    def __init__(self, telemetry: list[list[bytes]]) -> None:
        self.counters = LinkCounters()
        self._telemetry = telemetry
        self._codec: Any = mavlink.MAVLink(None, 1, 191)
        self._parser: Any = mavlink.MAVLink(None)
        site, airframe = load_site(SITE), load_airframe(AIRFRAME)
        values = load_parameters(airframe, AIRFRAME, site, SITE)
        self._values = {p.name: values[p.name] for p in PARAMETERS}
        self._next = 0
        self._waiting: list[bytes] = []

    def fileno(self) -> int:
        return -1

    def step(self, now_s: float) -> None:
        """The next frame's telemetry has come."""
        self._waiting += self._telemetry[self._next % len(self._telemetry)]
        frame, second = self._next, round(1.0 / FRAME_S)
        self._next += 1
        if frame % second == 0:
            self._say(
                mavlink.MAVLink_heartbeat_message(18, 8, 0, int(now_s / HOUR_S) << 8 | 4, 4, 3)
            )
        if frame % round(TEXT_S / FRAME_S) == 0:
            text = f"at {now_s:.0f} s: nothing out of the ordinary"
            self._say(mavlink.MAVLink_statustext_message(6, text.encode(), 0, 0))

    def receive(self, _now_s: float, _most: int = 0) -> list[bytes]:
        received, self._waiting = self._waiting, []
        return received

    def send(self, data: bytes) -> bool:
        for message in self._parser.parse_buffer(bytearray(data)) or ():
            kind = message.get_type()
            if kind == "PARAM_REQUEST_LIST":
                for name in self._values:
                    self._say_value(name)
            elif kind == "PARAM_SET":
                self._values[message.param_id] = message.param_value
                self._say_value(message.param_id)
            elif kind == "COMMAND_LONG":
                self._say(mavlink.MAVLink_command_ack_message(message.command, 0))
        return True

    send_command = send

    def hold(self, now_s: float) -> None: ...

    def clear_for_release(self) -> bool:
        return False

    def close(self) -> None: ...

    def _say_value(self, name: str) -> None:
        value = self._values[name]
        self._say(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 99, 0))

    def _say(self, message: Any) -> None:
        self._waiting.append(bytes(message.pack(self._codec)))
        self._codec.seq = (self._codec.seq + 1) % 256


class DayDesk(Desk):
    """A desk whose time goes on as fast as its pages take frames, from its hour 1."""

    def __init__(self, telemetry: list[list[bytes]]) -> None:
        airframe, site = load_airframe(AIRFRAME), load_site(SITE)
        values = load_parameters(airframe, AIRFRAME, site, SITE)
        self.day = DayLink(telemetry)
        station = Station(1, 191, 253, None, 1.8e9)
        super().__init__(place_of(airframe, site, values, SITE.parent), station, self.day, None)
        self.frame = 0
        self.until_h = 0.0  # it waits then
        self._at = A

    @property
    def hours(self) -> float:
        """That have gone by."""
        return self.frame * FRAME_S / HOUR_S

    async def work(self) -> None:
        """Every page has taken a frame before the next one."""
        while True:
            if self.hours < self.until_h and self.pages.viewers:
                self.step()
                while any(viewer.is_sending for viewer in self.pages.viewers.values()):
                    await asyncio.sleep(0.0)
                await asyncio.sleep(0.0)
            else:
                await asyncio.sleep(FRAME_S)

    def step(self) -> None:
        """One frame."""
        now_s = HOUR_S + self.frame * FRAME_S
        self.day.step(now_s)
        self._operate(now_s)
        self.turn(now_s)
        self.show(now_s)
        self.frame += 1

    def _operate(self, now_s: float) -> None:
        """The first page's operator takes the line, looks where it would settle, lets it go."""
        since_s = now_s % MOVE_S
        viewer = next(iter(self.pages.viewers.values()), None)
        if viewer is None or since_s > DRAG_S or not self.orders or self.orders.line() is None:
            return
        if since_s < FRAME_S:
            self._at = A if self._at == B else B
            gain = 0.5 + 0.001 * (now_s % 100.0)
            self.take(viewer, SetParameter(token=TOKEN, name="RHO_P", value=gain), now_s)
        x, z = self._at
        kind = Move if since_s > DRAG_S - 1.5 * FRAME_S else Look
        self.take(viewer, kind(token=TOKEN, x=x, z=z, lean=15.0), now_s)


async def days_pages(
    desk: DayDesk, measure: Callable[[float], None], at_hours: list[float]
) -> None:
    """A day at the desk with pages that need no browser, one of which takes nothing and comes
    back whenever it was closed.  measure: called at each of these hours."""
    taken = [0]

    async def take(frame: str) -> None:
        taken[0] += len(frame)

    async def take_nothing(_frame: str) -> None:
        await asyncio.Event().wait()

    for _ in range(PAGES - 1):
        desk.pages.add("", take)
    due = list(at_hours)
    while due:
        if desk.frame % round(1.5 * STALLED_S / FRAME_S) == 0:
            assert len(desk.pages.viewers) == PAGES - 1  # it was closed meanwhile
            desk.pages.add("stalled", take_nothing)
        desk.step()
        await asyncio.sleep(0.0)
        if desk.hours >= due[0]:
            measure(due.pop(0))
    assert taken[0] > 0
    for viewer in list(desk.pages.viewers.values()):
        desk.leave(viewer)


def resident_kb() -> int:
    """Of this process."""
    line = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if "VmRSS" in line
    )
    return int(line.split()[1])


def blocks() -> int:
    """Objects in use, counted exactly: what waits to be collected is not in use."""
    import gc

    gc.collect()
    return sys.getallocatedblocks()

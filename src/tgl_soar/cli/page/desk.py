"""The operator's desk: the station, what is asked of the module, and the pages that watch.

It owns the link and is worked by the server's event loop: bytes are read every `READ_S`, a frame
goes to all pages every 1 / `FRAMES_PER_S`.  A request is carried out when it comes, not at the next
of these.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import isfinite
from typing import Any, Final

import msgspec

from tgl_soar.cli.page.broadcast import FRAMES_PER_S, Broadcast, Viewer
from tgl_soar.cli.page.browser_requests import (
    Abort,
    Drop,
    Engage,
    Hold,
    Holder,
    Look,
    Move,
    Preset,
    Release,
    Request,
    SetParameter,
    Undo,
)
from tgl_soar.cli.page.measured_air import AirSample
from tgl_soar.cli.page.orders import ABORT, ENGAGE, RELEASE, Done, Orders
from tgl_soar.cli.page.scene import Place
from tgl_soar.cli.page.settling_preview import Foresight, Ghost, GhostLine, GhostStart
from tgl_soar.cli.page.station import ROW, Station, Text, number, without_others
from tgl_soar.config.parameters import INDEX, ParameterError, ParameterSet, checked_value
from tgl_soar.control.supervisor import is_flying
from tgl_soar.link.transports.base import Transport
from tgl_soar.onboard.telemetry_values import ARRAY

READ_S: Final = 0.01
READS: Final = 20  # datagrams and reads of a stream at once: a flood waits for the next turn
NOTICES: Final = 50
FOUND_LINE: Final = ("line_x", "line_z", "line_lean")
_MODE: Final = ARRAY.index("mode")
_AIR: Final = tuple(map(ARRAY.index, ("x", "z", "speed_x", "wind", "updraft", "pushed")))


class Desk:
    """One module, one link, and any number of pages."""

    def __init__(
        self,
        place: Place,
        station: Station | None,
        link: Transport | None,
        recording: bytes | None,
        *,
        maps: bool = True,
    ) -> None:
        """station, link: None, where a recording stands in the place of a flight.  maps: whether
        the air is measured from telemetry."""
        self.pages = Broadcast()
        self.station, self.recording = station, recording
        mode = "live" if recording is None else "recording"
        self.scene = msgspec.json.encode({**place.scene, "rows": ROW, "source": mode})
        self._presets = [preset["name"] for preset in place.scene["presets"]]
        self._foresight: Foresight = place.foresight
        self._file_values = place.values
        self.link = link
        self._holder = Holder()
        self._notices: deque[dict[str, Any]] = deque(maxlen=NOTICES)
        self._notice_number = 0
        self._ghost: Ghost | None = None
        self._values: tuple[dict[str, float], ParameterSet] = ({}, place.values)
        self._shown = {"rows": 0, "texts": 0, "notices": 0}
        self._received_wall_s = 0.0
        self._sent_wall_s = 0.0  # the last request's frames
        self.orders = None if station is None else Orders(station, self._notice)
        self._air = place.measured_air() if maps else None
        self._air_starts = 0  # of the module, when its map began
        if station is not None and self._air is not None:
            station.on_array = self._measure

    # --- the loop -------------------------------------------------------------------------------

    async def work(self) -> None:
        """As long as the server runs."""
        frame_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            self.turn(now_s)
            if now_s >= frame_s:
                frame_s = max(frame_s + 1.0 / FRAMES_PER_S, now_s)
                self.show(now_s)
            await asyncio.sleep(READ_S)

    def turn(self, now_s: float) -> None:
        """Read what has come, and send what is due."""
        if self.station is None or self.orders is None or self.link is None:
            return
        for _ in range(READS):
            received = self.link.receive(now_s)
            for data in received:
                shown = data if self.link.is_stream else without_others(data)
                if shown and self.station.receive(shown, now_s, time.time()):
                    self.link.hold(now_s)
                    self._received_wall_s = time.time()
            if not received:
                break
        self.station.step(now_s)
        self.orders.step(now_s)
        self._flush()

    def show(self, now_s: float) -> None:
        """A frame to all pages."""
        if self._air is not None:
            self._air.draw_on()
        for viewer in self.pages.show(
            self._state(now_s), self._news(), self._whole_of(now_s), now_s
        ):
            self.leave(viewer)

    def close(self) -> None:
        """The server ends."""
        if self.link is not None:
            self.link.close()

    def _measure(self, time_s: float, data: Sequence[float]) -> None:
        """A sample of the air has come."""
        assert self.station is not None
        assert self._air is not None
        if self.station.starts != self._air_starts:
            self._air_starts = self.station.starts
            self._air.begin_again()
        self._air.bound(self.station.parameters)
        mode = data[_MODE]
        sample = AirSample._make((time_s, *(data[i] for i in _AIR)))
        self._air.take(sample, flying=isfinite(mode) and is_flying(int(mode)))

    def _flush(self) -> None:
        assert self.station is not None
        assert self.link is not None
        for frame in self.station.take_datagrams():
            self.link.send(frame)

    # --- what pages ask -------------------------------------------------------------------------

    def take(self, viewer: Viewer, request: Request, now_s: float) -> None:
        """A request, whose token was right."""
        if self.orders is None or self.station is None:
            self._notice(Done(viewer.name, False, "this is a recording: nothing can be changed"))
            return
        if isinstance(request, Hold | Look | Move | Preset | Undo) and not self._may_hold(
            viewer, now_s
        ):
            return
        who = viewer.name
        if isinstance(request, Look):
            self._look(GhostLine(request.x, request.z, request.lean))
        elif isinstance(request, Drop):
            self._release(viewer)
        elif isinstance(request, Move):
            self.orders.move(who, GhostLine(request.x, request.z, request.lean))
            self._release(viewer)
        elif isinstance(request, Preset):
            self._preset(who, request.number)
            self._release(viewer)
        elif isinstance(request, Undo):
            self.orders.undo(who)
            self._release(viewer)
        elif isinstance(request, Engage | Release | Abort):
            commands = {Engage: ENGAGE, Release: RELEASE, Abort: ABORT}
            self.orders.command(who, commands[type(request)])
        elif isinstance(request, SetParameter):
            self._set(who, request)
        self.orders.step(now_s)
        self._flush()
        self._sent_wall_s = time.time()

    def leave(self, viewer: Viewer) -> None:
        """A page has gone; what it held in its hand stays where it was."""
        self.pages.remove(viewer)
        self._release(viewer)

    def _may_hold(self, viewer: Viewer, now_s: float) -> bool:
        if self._holder.take(viewer.number, viewer.name, now_s):
            return True
        text = f"the line is held by {self._holder.name(now_s)}"
        self._notice(Done(viewer.name, False, text))
        return False

    def _release(self, viewer: Viewer) -> None:
        if self._holder.drop(viewer.number):
            self._ghost = None

    def _look(self, wanted: GhostLine) -> None:
        assert self.station is not None
        now = self.station.now
        mode = now.get("soar_mode", -1.0)
        flying = isfinite(mode) and is_flying(int(mode))
        nan = float("nan")
        flown = GhostLine(*(now.get(name, nan) for name in FOUND_LINE))
        start = GhostStart(
            now.get("soar_x", nan),
            now.get("soar_z", nan),
            flown if flying and all(map(isfinite, flown)) else None,
        )
        self._ghost = self._foresight.ghost(self._parameters(), wanted, start, flying=flying)

    def _preset(self, who: str, wanted: int) -> None:
        assert self.orders is not None
        if wanted > len(self._presets):
            self._notice(Done(who, False, f"the site has no line {wanted}"))
        else:
            self.orders.preset(who, wanted, self._presets[wanted - 1])

    def _set(self, who: str, request: SetParameter) -> None:
        assert self.orders is not None
        if request.name not in INDEX:
            self._notice(Done(who, False, f"{request.name}: no such parameter"))
            return
        try:
            self.orders.set(who, request.name, checked_value(request.name, request.value))
        except ParameterError as error:
            self._notice(Done(who, False, str(error)))

    def _parameters(self) -> ParameterSet:
        """The module's values, as it echoes them; the files' where it has not yet."""
        assert self.station is not None
        echoed = self.station.parameters
        if echoed != self._values[0]:
            values = self._file_values
            with suppress(ParameterError):  # between two echoes of one change they may disagree
                values = values.changed(dict(echoed))
            self._values = (dict(echoed), values)
        return self._values[1]

    def _notice(self, done: Done) -> None:
        self._notice_number += 1
        self._notices.append(
            {"number": self._notice_number, "ok": done.ok, "text": done.text, "who": done.who}
        )

    # --- what pages are shown -------------------------------------------------------------------

    def _state(self, now_s: float) -> dict[str, Any]:
        """All that stands now."""
        state: dict[str, Any] = {
            "holder": self._holder.page(now_s),
            "holder_name": self._holder.name(now_s),
            "pages": len(self.pages.viewers),
        }
        station, orders = self.station, self.orders
        if station is None or orders is None:
            return state
        silence_s = station.silence_s(now_s)
        if not self._holder.page(now_s):
            self._ghost = None
        return {
            **state,
            "now": {name: number(value) for name, value in station.now.items()},
            "parameters": dict(station.parameters),
            "silence_s": round(silence_s, 1) if isfinite(silence_s) else None,
            "alive": station.is_alive(now_s),
            "starts": station.starts,
            "busy": orders.is_busy,
            "undo": orders.undo_count,
            "measured": None if self._air is None else self._air.drawing,
            "ghost": None if self._ghost is None else ghost_json(self._ghost),
            "received": round(self._received_wall_s, 3),
            "sent": round(self._sent_wall_s, 4),
        }

    def _news(self) -> dict[str, list[Any]]:
        """What has come to the lists since the last frame."""
        shown, station = self._shown, self.station
        notices = [n for n in self._notices if n["number"] > shown["notices"]]
        shown["notices"] = self._notice_number
        if station is None:
            return {"notices": notices}
        fresh = min(station.row_number - shown["rows"], len(station.rows))
        rows = list(station.rows)[len(station.rows) - fresh :]
        texts = [text_json(text) for text in station.texts if text.number > shown["texts"]]
        shown["rows"], shown["texts"] = station.row_number, station.text_number
        return {"rows": rows, "texts": texts, "notices": notices}

    def _whole_of(self, now_s: float) -> Callable[[], dict[str, Any]]:
        def whole() -> dict[str, Any]:
            lists: dict[str, Any] = {}  # a notice is for whoever sees it come
            if self.station is not None:
                lists["rows"] = list(self.station.rows)
                lists["texts"] = [text_json(text) for text in self.station.texts]
            return {**self._state(now_s), **lists}

        return whole


def ghost_json(ghost: Ghost) -> dict[str, Any]:
    """A ghost as a browser takes it."""
    return {
        "x": ghost.line.x_m,
        "z": ghost.line.z_m,
        "lean": ghost.line.lean_deg,
        "refusal": ghost.refusal,
        "warning": ghost.warning,
        "place": None if ghost.place is None else [round(v, 3) for v in ghost.place],
        "settles_s": None if ghost.settles_s is None else round(ghost.settles_s, 1),
        "words": ghost.words,
        "path": [[round(x, 3), round(z, 3)] for x, z in ghost.path],
    }


def text_json(text: Text) -> dict[str, Any]:
    """A text as a browser takes it."""
    return {
        "first": text.first,
        "time": round(text.wall_s, 1),
        "severity": text.severity,
        "source": text.source,
        "text": text.text,
    }

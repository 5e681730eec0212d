"""Short flights over the wire: the whole module, the simulated Pixhawk and an operator, frame by
frame on simulated time, and what each of them sent.

    python tests/onboard/kept_wire.py        flies them and records the numbers again

`kept_wire.json` holds, of each sender's messages by kind, how many there were and the mean of each
number in them, and every text.  Ground stations, autopilots and people depend on all of it.  It
says that something has changed, not what is right; whoever means it records it again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.onboard.module import Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.operator import Operator, PlannedLeg
from tgl_soar.sim.simulation import Options, Simulation

KEPT: Final = Path(__file__).with_name("kept_wire.json")
COMPANION, GROUND = 1, 2
DIGITS: Final = 7
SAME: Final = 1e-5  # a float32 of the wire has seven digits
# Of a message that has such a field each value of it is a kind of its own.
NAMES: Final = ("name", "param_id", "command")

Means = dict[str, dict[str, float]]


class Talk:
    """All that was sent, by sender and kind."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._sums: dict[str, dict[str, float]] = {}
        self._decoders: dict[int, mavlink.MAVLink] = {}

    def note(self, link: int, data: bytes) -> None:
        """One datagram."""
        decoder = self._decoders.setdefault(link, mavlink.MAVLink(None))
        for message in decoder.parse_buffer(bytearray(data)) or ():
            fields = message.to_dict()
            kind = fields.pop("mavpackettype")
            names = "".join(f" {fields.pop(name)}" for name in NAMES if name in fields)
            sender = message.get_srcComponent()
            sums = self._sums.setdefault(f"{link}, {sender}: {kind}{names}", {"count": 0.0})
            sums["count"] += 1.0
            for name, value in _numbers(fields):
                sums[name] = sums.get(name, 0.0) + value
            if kind == "STATUSTEXT":
                self.texts.append(f"{link}, {sender}: {message.text}")

    def means(self) -> Means:
        """Of every number; those that never were anything but 0 are left out."""
        return {
            kind: {
                name: _rounded(total if name == "count" else total / sums["count"])
                for name, total in sums.items()
                if total != 0.0
            }
            for kind, sums in sorted(self._sums.items())
        }


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _numbers(fields: dict[str, Any]) -> Iterator[tuple[str, float]]:
    for name, value in fields.items():
        several = value if isinstance(value, list) else [value]
        for i, each in enumerate(several):
            if isinstance(each, int | float):
                yield f"{name}{i or ''}", float(each) if isfinite(each) else -1.0


def flown(
    seconds: float,
    legs: tuple[str, ...],
    *,
    site: str = "tunnel",
    faults: tuple[str, ...] = (),
    **options: Any,
) -> dict[str, Any]:
    """Fly for so long [s]: an operator engages, and moves the line from leg to leg."""
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped(f"sites/{site}.toml")
    airframe, place = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, place, site_path)
    simulation = Simulation(
        airframe,
        place,
        Options(turbulence=0.02, faults=tuple(parse_faults(faults)), **options),
        site_path.parent,
    )
    simulation.add_link(COMPANION, ground=False)
    simulation.add_link(GROUND, ground=True)
    out: list[bytes] = []
    onboard = Onboard(setup_from(airframe, place, values), _into(out), 0.0)
    planned = [PlannedLeg(name, line_parameters(place.lines[name]), 1.0) for name in legs]
    link = airframe.autopilot
    operator = Operator(planned, link.system_id, link.component_id, watch_s=seconds)
    talk, events = Talk(), []
    for _ in range(round(seconds * 200)):
        simulation.step()
        now_s = simulation.time_s
        events += simulation.take_events()
        for to, data in simulation.take_datagrams():
            talk.note(to, data)
            if to == COMPANION:
                onboard.event(data, now_s)
            else:
                operator.receive(data)
        if onboard.clocking.due(now_s):
            onboard.periodic(now_s)
        sent = out[:]
        out.clear()
        for frame in sent:
            talk.note(-COMPANION, frame)
            simulation.receive(COMPANION, frame)
        for datagram in operator.step(now_s):
            talk.note(-GROUND, datagram)
            simulation.receive(GROUND, datagram)
    simulation.close()
    state = simulation.world.state
    return {
        "means": talk.means(),
        "texts": talk.texts,
        "events": events,
        "end": [_rounded(each) for each in (state.x_m, state.y_m, state.z_m)],
        "legs": [[each.leg.name, _rounded(each.asked_s)] for each in operator.flown],
    }


def _into(out: list[bytes]) -> Callable[[bytes], bool]:
    def send(frame: bytes) -> bool:
        out.append(bytes(frame))
        return True

    return send


FLIGHTS: Final[dict[str, Callable[[], dict[str, Any]]]] = {
    "a line to another": partial(flown, 8.0, ("a", "b")),
    "the hill with a rangefinder": partial(flown, 5.0, ("a",), site="hill", rangefinder=True),
    "an autopilot that restarts": partial(
        flown, 7.0, ("a",), faults=("autopilot.reboot start=4 for=1",)
    ),
}

if __name__ == "__main__":
    kept = {name: fly() for name, fly in FLIGHTS.items()}
    KEPT.write_text(json.dumps(kept, indent=0) + "\n", encoding="utf-8")
    print(f"{KEPT}: {', '.join(kept)}")

"""Short flights, and what the module made of them: the mean of every number of its output.

    python tests/sim/kept_flights.py        flies them and records the numbers again

`kept_flights.json` holds the numbers of the last time.  They say that something has changed, not
what is right: other tests know that.  Whoever changes a law, the model or the air on purpose flies
them again, and the change of this file shows in which flights it acts and on which numbers.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from math import inf, isfinite, radians
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from tgl_soar.config.airframe import ModelKind
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.site import Start, Tether
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.faults import CATALOGUE, Fault, parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import (
    AUTOPILOT_ATTITUDE,
    MEMS_IMU,
    MOTION_CAPTURE,
    PITOT,
    READ_BACK,
    USUAL_SENSORS,
    Sensors,
)
from tgl_soar.sim.throw import Throw, ThrownWorld
from tgl_soar.sim.world import World, build_field, make_world

KEPT: Final = Path(__file__).with_name("kept_flights.json")
DIGITS: Final = 9  # that are kept
# Processors round otherwise, in the last of 16 digits; a loop that is stable lets none of it grow.
SAME: Final = 1e-6

EVERY_SENSOR: Final = Sensors(
    position=MOTION_CAPTURE,
    attitude=AUTOPILOT_ATTITUDE,
    imu=MEMS_IMU._replace(delay_s=0.01),
    airspeed=PITOT,
    surfaces=READ_BACK,
)
# What has faults of its own; those of the links need datagrams, which are not flown here.
FAULTY: Final = (
    *("position", "attitude", "imu", "airspeed", "all"),
    *("elevator", "aileron", "rudder", "brake", "air"),
)
Changes = dict[float, dict[str, float]]  # parameters, by when they are set [s]


def _flown(
    seconds: float,
    changes: Changes,
    *,
    site: str = "tunnel",
    airframe: str = "eclipson_c",
    sensors: Sensors = USUAL_SENSORS,
    model: ModelKind = "rigid_body",
    line: str = "",
    faults: str = "",
    throw: Throw | None = None,
    tether_m: float = inf,
) -> dict[str, float]:
    """Fly for a time in 3 % of turbulence: the means.

    faults: of what, one kind after the other, a second each.
    """
    airframe_path, site_path = shipped(f"airframes/{airframe}.toml"), shipped(f"sites/{site}.toml")
    aircraft, place = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(aircraft, airframe_path, place, site_path)
    if line:
        values = values.changed(line_parameters(place.lines[line]))
    start = place.start
    assert start is not None
    if throw is not None:
        place = replace(place, start=Start(x_m=-4.5, z_m=8.4))  # five metres before the crest
        values = values.changed({"LNC_START": 1.0})
    if tether_m < inf:
        hook = Tether(x_m=start.x_m, z_m=start.z_m - 0.1, length_m=tether_m)
        place = replace(place, tether=hook)
    injection = Injection(_faults_of(faults), 3) if faults else None
    assert place.air is not None
    field = build_field(place.air, site_path.parent)
    world: World = make_world(
        aircraft.flown_as(model),
        place,
        seed=1,
        turbulence=0.03,
        field=field if injection is None else injection.field(field),
        sensors=sensors,
    )
    if throw is not None:
        world = ThrownWorld(world, throw)
    loop = ClosedLoop(world, values, injection)
    pending = dict(changes)
    means: dict[str, float] = {}
    count = round(seconds * world.step_hz)
    for _ in range(count):
        for due in [s for s in pending if s <= world.time_s]:
            loop.change(pending.pop(due))
        for name, value in _numbers(loop.tick()).items():
            means[name] = means.get(name, 0.0) + value / count
    state = world.state
    return means | {"x_m": state.x_m, "y_m": state.y_m, "z_m": state.z_m}


def _faults_of(what: str) -> list[Fault]:
    kinds = [kind for name, kind in CATALOGUE.items() if name.partition(".")[0] == what]
    found = []
    for i, kind in enumerate(kinds):
        lasts = " for=0.6" if any(number.name == "for" for number in kind.numbers) else ""
        found.append(parse_fault(f"{kind.name} start={2 + i}{lasts}"))
    return found


def _numbers(output: Any, name: str = "") -> dict[str, float]:
    """Every number of the module's output, and of the named tuples in it; what is not finite counts
    as 0."""
    found: dict[str, float] = {}
    for field, value in zip(output._fields, output, strict=True):
        if hasattr(value, "_fields"):
            found |= _numbers(value, f"{name}{field}.")
        elif isinstance(value, int | float):
            found[f"{name}{field}"] = float(value) if isfinite(value) else 0.0
    return found


BRAKED: Final[Changes] = {0.0: {"TGL_HOLD": 2.0, "TGL_ALONG": -0.1}}
THROW: Final = Throw(
    time_s=2.0, speed_mps=3.0, roll_rad=0.0, pitch_rad=radians(2.0), heading_rad=radians(-3.0)
)
FLIGHTS: Final[dict[str, Callable[[], dict[str, float]]]] = {
    "from a line to another": partial(
        _flown, 5.0, {2.0: {"TGL_Z": 1.5}}, line="a"
    ),
    "hill, every sensor": partial(_flown, 5.0, {}, site="hill", sensors=EVERY_SENSOR),
    "point mass in a polynomial": partial(
        _flown, 4.0, {}, site="tunnel_polynomial", model="point_mass", line="b"
    ),
    "a point on the line": partial(
        _flown, 12.0, BRAKED | {7.0: {"TGL_ALONG": 0.3}},
        airframe="eclipson_c_spoilers", sensors=EVERY_SENSOR,
    ),
    "a multisine": partial(
        _flown, 10.0, {6.0: {"EXC_START": 1.0}}, line="b", sensors=EVERY_SENSOR
    ),
    "home from the hill": partial(_flown, 40.0, {3.0: {"ESC_START": 1.0}}, site="hill"),
    "from the hand": partial(
        _flown, 12.0, {}, site="hill", sensors=EVERY_SENSOR, throw=THROW
    ),
    "at the end of a tether": partial(_flown, 3.0, {}, tether_m=0.2),
    **{
        f"faults of {what}": partial(
            _flown, 12.0 if what in FAULTY[:5] else 6.0, BRAKED if what == "brake" else {},
            line="b", faults=what,
            airframe="eclipson_c_spoilers", sensors=EVERY_SENSOR,
        )
        for what in FAULTY
    },
}  # fmt: skip


def rounded(means: dict[str, float]) -> dict[str, float]:
    """As they are kept: without what never was anything but 0."""
    return {
        name: float(f"{value:.{DIGITS}g}") for name, value in sorted(means.items()) if value != 0.0
    }


if __name__ == "__main__":
    kept = {name: rounded(fly()) for name, fly in FLIGHTS.items()}
    KEPT.write_text(json.dumps(kept, indent=0) + "\n", encoding="utf-8")
    print(f"{KEPT}: {', '.join(kept)}")

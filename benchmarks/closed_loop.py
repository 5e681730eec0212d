"""How fast the closed loop runs in process: law and world, no sockets.

Reference: real time.
"""

from __future__ import annotations

from time import perf_counter

from tgl_soar.config import load_airframe, load_parameters, load_site, shipped
from tgl_soar.sim.closed_loop import fly
from tgl_soar.sim.world import build_field, make_world

from .result import Result

FLIGHT_S = 60.0


def closed_loop() -> Result:
    """Simulated seconds per second, turbulence and every sensor on, one core."""
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    assert site.air is not None
    world = make_world(airframe, site, seed=1, turbulence=0.01, field=build_field(site.air))
    before = perf_counter()
    flight = fly(world, values, [], FLIGHT_S)
    elapsed = perf_counter() - before
    assert not flight.ended, flight.ended
    return Result("closed loop in process", FLIGHT_S / elapsed, 1.0, "s/s", "real time")


BENCHMARKS = (closed_loop,)

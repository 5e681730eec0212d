"""How fast flights are simulated: law and world in one process, no sockets.

Every row is in simulated seconds per second on one core, unless it says otherwise, with 1 %
turbulence and every sensor on.  References: real time; and JSBSim, which steps an aircraft
alone at the same rate, its own sailplane without a law, in a wind that is set once, so
that its steps are timed and not Python's way to its properties.  (The agreement of ours with it is
a test's business.)
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from time import perf_counter
from typing import Any

from msgspec.structs import asdict

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.sim.aircraft import aircraft_model, step
from tgl_soar.sim.closed_loop import fly
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import Prepared, fly_compiled, prepare
from tgl_soar.sim.sensors import USUAL_SENSORS
from tgl_soar.sim.world import build_field
from tgl_soar.types import SurfaceCommand

from .batch import Plan, fly_batch
from .result import ALLOWED, Result

FLIGHT_S = 30.0
ROUNDS = 3  # the quickest counts: what else the machine does can only slow it down
COMPILED_FLIGHTS = 50  # in a round
BATCH_FLIGHTS = 1000
LOOP_TIMES = 2000.0  # real time, on a core: what is asked of the whole closed loop
POINT_MASS_TIMES = 4000.0  # the same of the point mass
AIRFRAME = "airframes/eclipson_c.toml"
REAL_TIME = "real time"
NO_NUMBA = "numba is not installed: nothing is compiled"
NO_JSBSIM = "jsbsim is not installed: not measured beside it"


def flights() -> Iterator[Result]:
    """The closed loop, plain and compiled."""
    plain = _plain_speed()
    yield Result(
        what="closed loop, nothing compiled",
        value=plain,
        reference=1.0,
        unit="s/s",
        reference_what=REAL_TIME,
    )
    if not available():
        print(NO_NUMBA)
        return
    prepared = prepare(_plan().world(1), FLIGHT_S)
    values = _plan().values

    before = perf_counter()
    fly_compiled(prepared, 1, values, [])
    compile_s = perf_counter() - before

    def fly_many() -> str:
        return "".join(
            fly_compiled(prepared, seed, values, []).ended for seed in range(COMPILED_FLIGHTS)
        )

    everything = _speed(COMPILED_FLIGHTS, fly_many)
    yield Result(
        what="closed loop, all compiled",
        value=everything,
        reference=1.0,
        unit="s/s",
        reference_what=REAL_TIME,
    )
    yield _a_second("the closed loop, all compiled", everything, LOOP_TIMES)

    plain_flight_s = FLIGHT_S / plain
    yield Result(
        what="compiling",
        value=compile_s,
        reference=plain_flight_s,
        unit="s",
        reference_what=f"a plain flight of {FLIGHT_S:g} s",
    )

    yield from _point_mass(everything)

    cores = os.cpu_count() or 1
    before = perf_counter()
    scores = fly_batch(_plan(), range(BATCH_FLIGHTS), compile=True)
    elapsed = perf_counter() - before
    assert not any(score.ended for score in scores)
    yield Result(
        what=f"batch of {BATCH_FLIGHTS} flights of {FLIGHT_S:g} s with scores, {cores} cores",
        value=BATCH_FLIGHTS * FLIGHT_S / elapsed,
        reference=everything,
        unit="s/s",
        reference_what="all compiled on one core",
    )


def _point_mass(rigid_body: float) -> Iterator[Result]:
    """The point mass in the wind of a polynomial, with as many steps as the rigid body and half.

    Its longest lags are a dozen steps of 10 ms and more; the laws tick once a step.
    """
    site_path = shipped("sites/tunnel_polynomial.toml")
    site = load_site(site_path)
    assert site.air is not None
    values = load_parameters(_plan().airframe, shipped(AIRFRAME), site, site_path)
    for step_hz in (_plan().step_hz, _plan().step_hz // 2):
        plan = replace(
            _plan(),
            airframe=_plan().airframe.flown_as("point_mass"),
            site=site,
            values=values,
            step_hz=step_hz,
            field=build_field(site.air),
            # No sensor samples more often than the simulation steps.
            sensors=USUAL_SENSORS._replace(
                attitude=USUAL_SENSORS.attitude._replace(rate_hz=float(step_hz))
            ),
        )
        prepared = prepare(plan.world(1), FLIGHT_S)
        fly_compiled(prepared, 1, values, [])

        def fly_many(prepared: Prepared = prepared) -> str:
            return "".join(
                fly_compiled(prepared, seed, values, []).ended for seed in range(COMPILED_FLIGHTS)
            )

        speed = _speed(COMPILED_FLIGHTS, fly_many)
        what = f"point mass in a polynomial wind, all compiled, {step_hz} steps a second"
        yield Result(
            what=what,
            value=speed,
            reference=1.0,
            unit="s/s",
            reference_what=REAL_TIME,
        )
        yield Result(
            what=what,
            value=speed,
            reference=rigid_body,
            unit="s/s",
            reference_what="the rigid body in the jet, 200 steps a second",
        )
        yield _a_second(f"the point mass, {step_hz} steps a second", speed, POINT_MASS_TIMES)


def _a_second(of: str, speed: float, asked: float) -> Result:
    """What a simulated second takes, beside what it may take where so many times real time are
    asked for: an aim is the largest ratio, and a speed is the better the larger it is."""
    return Result(
        what=f"a second of {of}",
        value=1.0 / speed,
        reference=1.0 / asked,
        unit="s",
        reference_what=ALLOWED,
        aim=1.0,
    )


def beside_jsbsim() -> Iterator[Result]:
    """JSBSim's aircraft alone against our aircraft alone, and against our whole closed loop."""
    os.environ.setdefault("JSBSIM_DEBUG", "0")  # it greets otherwise
    try:
        import jsbsim
    except ImportError:
        print(NO_JSBSIM)
        return
    theirs = _jsbsim_speed(jsbsim)
    what = "JSBSim steps its aircraft alone"
    world, airframe = _plan().world(1), _plan().airframe
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    state, surfaces = world.state, SurfaceCommand(0.0, 0.0, 0.0)
    dt = 1.0 / world.step_hz
    steps = round(FLIGHT_S / dt)

    def aircraft_alone() -> str:
        now, wind = state, (8.5, 0.0, 1.4)
        for _ in range(steps):
            now = step(model, now, surfaces, wind, wind, dt)
        return ""

    yield Result(
        what="our aircraft alone, plain",
        value=_speed(1, aircraft_alone),
        reference=theirs,
        unit="s/s",
        reference_what=what,
    )
    yield Result(
        what="closed loop, nothing compiled",
        value=_plain_speed(),
        reference=theirs,
        unit="s/s",
        reference_what=what,
    )
    if available():
        prepared, values = prepare(world, FLIGHT_S), _plan().values
        fly_compiled(prepared, 1, values, [])
        everything = _speed(1, lambda: fly_compiled(prepared, 1, values, []).ended)
        yield Result(
            what="closed loop, all compiled",
            value=everything,
            reference=theirs,
            unit="s/s",
            reference_what=what,
        )


BENCHMARKS = (flights, beside_jsbsim)


def _jsbsim_speed(jsbsim: Any) -> float:
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    assert fdm.load_model("SGS")
    dt = 1.0 / _plan().step_hz
    fdm.set_dt(dt)
    fdm["ic/h-sl-ft"], fdm["ic/vc-kts"] = 5000.0, 45.0
    assert fdm.run_ic()
    fdm["atmosphere/wind-north-fps"], fdm["atmosphere/wind-down-fps"] = -28.0, -4.6
    steps = round(FLIGHT_S / dt)

    def aircraft_alone() -> str:
        run = fdm.run
        for _ in range(steps):
            run()
        return ""

    return _speed(1, aircraft_alone)


@cache
def _plain_speed() -> float:
    plan = _plan()
    return _speed(1, lambda: fly(plan.world(1), plan.values, [], FLIGHT_S).ended)


def _speed(flights: int, run: Callable[[], str]) -> float:
    """Simulated seconds per second of `flights` flights, the best of `ROUNDS`."""
    best = float("inf")
    for _ in range(ROUNDS):
        before = perf_counter()
        ended = run()
        best = min(best, perf_counter() - before)
        assert not ended, ended
    return flights * FLIGHT_S / best


@cache
def _plan() -> Plan:
    airframe_path, site_path = shipped(AIRFRAME), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    assert site.air is not None
    return Plan(
        airframe,
        site,
        values,
        duration_s=FLIGHT_S,
        turbulence=0.01,
        field=build_field(site.air),
    )

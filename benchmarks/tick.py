"""How long one tick of the laws takes.

Reference: parsing one ATTITUDE_QUATERNION with pymavlink, which every tick has to do as well.
Both are timed call by call in turn, so that whatever else the machine does meets both alike.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import perf_counter

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.autopilot import AutopilotState, initial_state, step
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.laws import laws_from
from tgl_soar.estimation.motion import motion_step
from tgl_soar.sim.flight import HELD_S
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.world import make_world
from tgl_soar.types import AutopilotStatus, Inputs

from . import caches
from .lengths import length
from .result import Result

TICKS, COLD_TICKS = 4000, 1000
WARM_UP = 600
WITH_IMU = Sensors(imu=MEMS_IMU)


def tick() -> Result:
    """Median time of `autopilot.step` while flying, the estimator left out."""
    whole, estimator, parse = _times()
    return Result(
        what="one tick of the laws, without the estimator",
        value=whole - estimator,
        reference=parse,
        unit="µs",
        reference_what="pymavlink parses one ATTITUDE_QUATERNION",
    )


def tick_with_estimator() -> Result:
    """Median time of all of `autopilot.step` while flying."""
    whole, _, parse = _times()
    return Result(
        what="one tick, all of it",
        value=whole,
        reference=parse,
        unit="µs",
        reference_what="pymavlink parses one ATTITUDE_QUATERNION",
    )


def tick_with_accelerations() -> Result:
    """The same with accelerometers of 200 Hz: a sample in every tick."""
    whole, _, parse = _times(WITH_IMU)
    return Result(
        what="one tick, all of it, accelerations fused",
        value=whole,
        reference=parse,
        unit="µs",
        reference_what="pymavlink parses one ATTITUDE_QUATERNION",
    )


def estimator_with_accelerations() -> Result:
    """Median time of the estimator's part of that."""
    _, estimator, parse = _times(WITH_IMU)
    return Result(
        what="the estimator, accelerations fused",
        value=estimator,
        reference=parse,
        unit="µs",
        reference_what="pymavlink parses one ATTITUDE_QUATERNION",
    )


def tick_with_empty_caches() -> Result:
    """The same, tick and reference each right after the caches were emptied."""
    whole, _, parse = _times(WITH_IMU, length(COLD_TICKS), caches.empty)
    return Result(
        what="one tick, all of it, accelerations fused, caches empty",
        value=whole,
        reference=parse,
        unit="µs",
        reference_what="pymavlink parses one ATTITUDE_QUATERNION, caches empty",
    )


BENCHMARKS = (
    tick,
    tick_with_estimator,
    tick_with_accelerations,
    estimator_with_accelerations,
    tick_with_empty_caches,
)


def _times(
    sensors: Sensors = USUAL_SENSORS,
    ticks: int = TICKS,
    before_each: Callable[[], None] = lambda: None,
) -> tuple[float, float, float]:
    """Median µs of a whole tick, of the estimator's part, and of the reference."""
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    world = make_world(airframe, site, seed=1, turbulence=0.01, sensors=sensors)
    world.held = True
    laws = laws_from(values, world.frame, world.aerodynamics)
    state: AutopilotState = initial_state()
    encoder, decoder = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None)
    command = None
    whole, estimator, parse = [], [], []
    for i in range(WARM_UP + ticks):
        now = world.time_s
        inputs = Inputs(
            time_s=now,
            position=world.position,
            attitude=world.attitude,
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=now >= HELD_S,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
        )
        frame = mavlink.MAVLink_attitude_quaternion_message(i, 1, 0, 0, 0, 0, 0, 0).pack(encoder)
        settled = i >= WARM_UP
        if settled:
            before_each()
        begun = perf_counter()
        motion_step(laws.motion, laws.frame, state.memory.motion, inputs)
        estimator_s = perf_counter() - begun
        if settled:
            before_each()
        begun = perf_counter()
        state, output = step(laws, state, inputs)
        whole_s = perf_counter() - begun
        if settled:
            before_each()
        begun = perf_counter()
        decoder.parse_buffer(frame)
        parse_s = perf_counter() - begun
        if settled:
            estimator.append(estimator_s)
            whole.append(whole_s)
            parse.append(parse_s)
        command = output.command
        if output.active:
            world.held = False
        world.step(command)
    return median(whole) * 1e6, median(estimator) * 1e6, median(parse) * 1e6

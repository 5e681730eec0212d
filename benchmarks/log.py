"""What the flight log costs a tick, how large it gets, and how fast it replays.

Two modules fly the same frames in turn, one with a log and one without: all that `tgl-soar sitl`
sends a module, accelerations and attitude 200 times a second, position and servo outputs 50 times,
airspeed 20 times.  A tick is all that a new
attitude sets off: decoding, estimating, deciding, sending.  Timed is the processor time of the
loop's own thread.  A replay's time is all that follows reading the log; what numba makes of the
laws is kept from one run to the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import thread_time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.analysis.replay.logged import replay
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard.flightlog.recorder import NO_RECORDER, Recorder
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import BATCH_TICKS, FlightRecorder
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim.sensor_messages import scaled_imu
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, Sensors
from tgl_soar.sim.world import make_world
from tgl_soar.types import SurfaceCommand

from .result import ALLOWED, NO_AIM, Result

WARM_UP_S, FLOWN_S = 3.0, 30.0
RATE_HZ = 200.0
FRACTION_ALLOWED = 0.1  # of the tick
ALLOWED_MB = 5.0  # a minute
ASKED_SPEED = 200.0  # times real time, of a replay


def log() -> Iterator[Result]:
    """Time of a tick with and without, megabytes a minute, and the replay."""
    with TemporaryDirectory() as folder:
        plain, logged = _fly(Path(folder))
        yield Result(
            what="what the flight log adds to a tick",
            value=logged - plain,
            reference=plain,
            unit="µs",
            reference_what="the tick without it",
            aim=FRACTION_ALLOWED,
        )
        path = next(Path(folder).rglob("*.ulg"))
        minutes = (WARM_UP_S + FLOWN_S) / 60.0
        for name, file in (("flight log", path), (".tlog of the wire", path.with_suffix(".tlog"))):
            size = file.stat().st_size / 1e6 / minutes
            yield Result(
                what=f"{name}, a minute at 200 Hz",
                value=size,
                reference=ALLOWED_MB,
                unit="MB",
                reference_what=ALLOWED,
                aim=1.0,
            )
        flight = read_log(path)
        for workers, compile, how in (
            (1, False, "one process"),
            (None, False, "as many as processors"),
            (1, True, "laws compiled before"),
        ):
            if compile:
                replay(flight, compile=True)
            result = replay(flight, workers=workers, compile=compile)
            assert not result.differences
            tick_us = 1e6 * result.took_s / len(result.time_s)
            asked_us = 1e6 / RATE_HZ / ASKED_SPEED
            what = f"{ASKED_SPEED:g} × real time"
            aim = 1.0 if compile else NO_AIM
            yield Result(
                what=f"replay of a tick, {how}",
                value=tick_us,
                reference=asked_us,
                unit="µs",
                reference_what=what,
                aim=aim,
            )


BENCHMARKS = (log,)

_PITOT = mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
_PITOT_IS_WELL = mavlink.MAVLink_sys_status_message(_PITOT, _PITOT, _PITOT, *(0,) * 10)


def _fly(folder: Path) -> tuple[float, float]:
    """µs of a tick, without and with a log."""
    files = {"airframe": shipped("airframes/eclipson_c.toml"), "site": shipped("sites/tunnel.toml")}
    texts = {name: path.read_text() for name, path in files.items()}
    recorder = FlightRecorder(folder, LogMetadata({"sys_name": "tgl_soar"}, texts), 0.0)
    recorder.start()
    airframe, site = load_airframe(files["airframe"]), load_site(files["site"])
    values = load_parameters(airframe, files["airframe"], site, files["site"])
    setup = setup_from(airframe, site, values)
    sensors = Sensors(imu=MEMS_IMU, airspeed=PITOT)
    world = make_world(airframe, site, seed=1, turbulence=0.01, sensors=sensors)
    world.held = True

    def module(keeper: Recorder) -> Onboard:
        return Onboard(
            setup, lambda _frame: True, 0.0, ModuleOptions(lockstep=True, recorder=keeper)
        )

    modules = (module(NO_RECORDER), module(recorder))
    times: tuple[list[float], list[float]] = ([], [])
    vehicle, station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
    command = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
    for i in range(round((WARM_UP_S + FLOWN_S) * RATE_HZ)):
        ms, at = round(world.time_s * 1e3), world.position
        frames = []
        if i % 200 == 0:
            frames.append(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3).pack(vehicle))
            frames.append(_PITOT_IS_WELL.pack(vehicle))
        if i == 400:
            engage = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
            frames.append(engage.pack(station))
        if i % 4 == 0:
            frames.append(
                mavlink.MAVLink_local_position_ned_message(
                    ms,
                    *(at.north_m, at.east_m, at.down_m),
                    *(at.velocity_north_mps, at.velocity_east_mps, at.velocity_down_mps),
                ).pack(vehicle)
            )
            pulses = (round(1500 + 400 * surface) for surface in command)
            servos = (ms * 1000, 0, *pulses, 1500, 0, 0, 0, 0)
            frames.append(mavlink.MAVLink_servo_output_raw_message(*servos).pack(vehicle))
        if i % 10 == 0 and world.airspeed.sequence:
            hud = (world.airspeed.airspeed_mps, 0.0, 0, 0, 0.0, 0.0)
            frames.append(mavlink.MAVLink_vfr_hud_message(*hud).pack(vehicle))
        if world.imu.sequence:
            frames.append(scaled_imu(world.imu, ms).pack(vehicle))
        attitude = mavlink.MAVLink_attitude_quaternion_message(ms, *world.attitude[2:])
        frame = bytes(attitude.pack(vehicle))
        order = (0, 1) if i % 2 else (1, 0)
        for which in order:
            for other in frames:
                modules[which].event(bytes(other), world.time_s)
            before = thread_time()
            modules[which].event(frame, world.time_s)
            if i >= WARM_UP_S * RATE_HZ:
                times[which].append(thread_time() - before)
        output = modules[0].output
        if output is not None and output.active:
            world.held = False
            command = output.command
        world.step(command)
    recorder.stop()
    plain, logged = (_median_tick(taken) for taken in times)
    return plain, logged


def _median_tick(taken: list[float]) -> float:
    """µs, of batches: the log packs several ticks together."""
    batches = zip(*(taken[i::BATCH_TICKS] for i in range(BATCH_TICKS)), strict=False)
    return 1e6 * float(median(sum(batch) / BATCH_TICKS for batch in batches))

"""One flight as a pure function: the module's tick and the world's step, from tick to tick.

What `sim.world` and `sim.closed_loop` do with objects is done here with named tuples and
arrays, so that numba can take it: the same laws, servos, sensors and aircraft, called in the
same order.  tests/sim/test_compiled.py holds one against the other to the last bit.

Randomness comes in as arrays of unit variance, drawn beforehand from the very streams that the
world's own sensors and turbulence draw from (`sim.batch`).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridTable3D, grid_wind_3d
from tgl_soar.air.gusts import DrydenParams, DrydenState, dryden_step
from tgl_soar.air.hill import Hill, hill_wind
from tgl_soar.air.jet import Jet, jet_wind
from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.control.laws import Laws
from tgl_soar.control.supervisor import FAILED, RELEASED
from tgl_soar.control.target_line import e_rho
from tgl_soar.geometry import SoaringFrame, euler_from_quaternion
from tgl_soar.sim.aircraft import AircraftModel, AircraftState, Wind, air_data, place_ahead
from tgl_soar.sim.aircraft import step as aircraft_step
from tgl_soar.sim.closed_loop import HELD_S
from tgl_soar.sim.sensors import (
    AirspeedParams,
    AttitudeParams,
    ImuParams,
    PositionParams,
    SensorTiming,
    Triple,
    measure_airspeed,
    measure_attitude,
    measure_imu,
    measure_position,
    samples_delivered,
)
from tgl_soar.sim.servos import ServoParams, ServoState, servo_step
from tgl_soar.types import (
    NAN,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    AirspeedSample,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    PositionFix,
    SurfaceCommand,
    SurfacesSample,
)

BoolArray = NDArray[np.bool_]

FLIES: Final = 0  # how a flight stands
CRASHED: Final = 1
HAND_OVER: Final = 2


HILL: Final = 0  # kinds of air
BOARD: Final = 1
GRID: Final = 2


class Air(NamedTuple):
    """One steady field: a hill, a board in a jet, or a grid.  Arrays are numpy's."""

    kind: int
    hill: Hill
    jet: Jet
    half_width_m: float  # of the jet
    grid: GridTable3D  # one that is the same at every y has two nodes along y
    solid: BoolArray  # (nx, ny, nz)
    goes_on: bool  # beyond the grid the wind is that of its nearest edge
    lost_mps: float  # if not, it is this


class Weather(NamedTuple):
    """What the air does in time, at every step of the simulation."""

    weight: FloatArray  # (n,) of the second field, 0 … 1; negative: there is none
    factor: FloatArray  # (n,) on both
    gust_mps: FloatArray  # (n, 3) added everywhere
    turbulent: bool
    dryden: DrydenParams


class Noise(NamedTuple):
    """White numbers of unit variance in the order in which they are used."""

    turbulence: FloatArray  # (n, 3) of every step
    position: FloatArray  # (n, 6 or 3) of every sample: place, velocity
    attitude: FloatArray  # (n, 6) of every sample: rotation, rates
    imu: FloatArray  # (n, 6) of every sample: force, rates
    airspeed: FloatArray  # (n,) of every sample: pressure


class Biases(NamedTuple):
    """What the sensors are wrong by in all of one flight."""

    position_m: Triple
    attitude_rad: Triple
    rate_radps: Triple
    force_mps2: Triple
    gyro_radps: Triple
    pressure_pa: float


class Setup(NamedTuple):
    """Everything that does not change in a flight."""

    step_hz: int
    model: AircraftModel
    servo: ServoParams
    frame: SoaringFrame
    first: Air
    second: Air
    half_width_m: float  # of the world
    position: PositionParams
    position_timing: SensorTiming
    attitude: AttitudeParams
    attitude_timing: SensorTiming
    has_imu: bool
    imu: ImuParams
    imu_timing: SensorTiming
    has_airspeed: bool
    airspeed: AirspeedParams
    airspeed_timing: SensorTiming
    has_surfaces: bool
    surfaces_timing: SensorTiming


class Instruments(NamedTuple):
    """Samples under way to the module; row k % n of each holds the one with sequence k + 1."""

    fixes: FloatArray  # (n, 7): time, place, velocity
    attitudes: FloatArray  # (n, 8): time, quaternion, rates
    imus: FloatArray  # (n, 7): time, force, rates
    airspeeds: FloatArray  # (n, 2): time, airspeed
    surfaces: FloatArray  # (n, 4): time, elevator, aileron, rudder


class Parts(NamedTuple):
    """All that one flight happens in."""

    setup: Setup
    weather: Weather
    noise: Noise
    biases: Biases
    instruments: Instruments  # written to at every step


class Cell(Protocol):
    """Something that keeps a value of one type between calls, as `compiled.cell`."""

    value: Any


class WorldNow(NamedTuple):
    """The world at one step."""

    aircraft: AircraftState
    elevator: ServoState
    aileron: ServoState
    rudder: ServoState
    wind: Wind  # at the aircraft
    turbulence: DrydenState
    crashed: bool


class Flight(NamedTuple):
    """Where a flight stands between two ticks."""

    steps: int
    standing: int  # FLIES, CRASHED or LET_GO
    reason: int  # of the last tick
    world: WorldNow
    command: SurfaceCommand
    held: bool
    autopilot: AutopilotState


def air_wind(air: Air, x_m: float, y_m: float, z_m: float) -> Wind:
    """Wind (u, v, w) [m/s] at one place, as the field's own `wind_at`."""
    if air.kind == HILL:
        u, w = hill_wind(air.hill, x_m, z_m)
        return u, 0.0, w
    if air.kind == BOARD:
        u, w = jet_wind(air.jet, x_m, z_m)
        return u, 0.0, w
    if not air.goes_on and not within_grid(air.grid, x_m, y_m, z_m):
        return air.lost_mps, air.lost_mps, air.lost_mps
    return grid_wind_3d(air.grid, x_m, y_m, z_m)


def air_inside(air: Air, x_m: float, y_m: float, z_m: float) -> bool:
    """Whether the field describes the air at this place, as the field's own `inside`."""
    if air.kind == HILL:
        radius = air.hill.radius_m
        return z_m >= 0.0 and x_m * x_m + z_m * z_m >= radius * radius
    if air.kind == BOARD:
        table = air.jet.table
        floor = x_m * air.jet.rise if 0.0 < x_m <= air.jet.tip_x_m else 0.0
        return (
            table.x0_m <= x_m <= table.x0_m + (table.nx - 1) * table.dx_m
            and floor <= z_m <= table.z0_m + (table.nz - 1) * table.dz_m
            and abs(y_m) <= air.half_width_m
        )
    grid = air.grid
    if not within_grid(grid, x_m, y_m, z_m):
        return False
    i = min(int((x_m - grid.x0_m) / grid.dx_m), grid.nx - 2)
    j = min(int((y_m - grid.y0_m) / grid.dy_m), grid.ny - 2)
    k = min(int((z_m - grid.z0_m) / grid.dz_m), grid.nz - 2)
    for corner in range(8):
        if air.solid[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)]:
            return False
    return True


def within_grid(grid: GridTable3D, x_m: float, y_m: float, z_m: float) -> bool:
    """Whether a place lies among the grid's nodes."""
    return (
        grid.x0_m <= x_m <= grid.x0_m + (grid.nx - 1) * grid.dx_m
        and grid.y0_m <= y_m <= grid.y0_m + (grid.ny - 1) * grid.dy_m
        and grid.z0_m <= z_m <= grid.z0_m + (grid.nz - 1) * grid.dz_m
    )


def wind_at(
    setup: Setup, weather: Weather, gust: Wind, n: int, x_m: float, y_m: float, z_m: float
) -> Wind:
    """Wind (u, v, w) [m/s] of both fields, the weather of step n and a turbulence [m/s]."""
    weight = weather.weight[n]
    u, v, w = air_wind(setup.first, x_m, y_m, z_m)
    if weight > 0.0:
        u2, v2, w2 = air_wind(setup.second, x_m, y_m, z_m)
        u, v, w = u + weight * (u2 - u), v + weight * (v2 - v), w + weight * (w2 - w)
    factor, added = weather.factor[n], weather.gust_mps
    return (
        factor * u + added[n, 0] + gust[0],
        factor * v + added[n, 1] + gust[1],
        factor * w + added[n, 2] + gust[2],
    )


def inside(setup: Setup, weather: Weather, n: int, x_m: float, y_m: float, z_m: float) -> bool:
    """Whether a place lies in the world, and in all fields that the weather is made of."""
    return (
        air_inside(setup.first, x_m, y_m, z_m)
        and (weather.weight[n] < 0.0 or air_inside(setup.second, x_m, y_m, z_m))
        and not abs(y_m) > setup.half_width_m
    )


def sense(
    parts: Parts, aircraft: AircraftState, wind: Wind, command: SurfaceCommand, rests: bool, n: int
) -> None:
    """Take the samples that are due at step n; as `World._sense`."""
    _sense_pose(parts, aircraft, n)
    if parts.setup.has_imu:
        _sense_imu(parts, aircraft, wind, rests, n)
    if parts.setup.has_airspeed:
        _sense_airspeed(parts, aircraft, wind, n)
    if parts.setup.has_surfaces:
        timing, surfaces = parts.setup.surfaces_timing, parts.instruments.surfaces
        if n % timing.period_steps == 0:
            row = surfaces[n // timing.period_steps % len(surfaces)]
            row[0] = n / timing.step_rate_hz
            row[1], row[2], row[3] = command.elevator, command.aileron, command.rudder


def _sense_imu(parts: Parts, aircraft: AircraftState, wind: Wind, rests: bool, n: int) -> None:
    setup, imus = parts.setup, parts.instruments.imus
    if n % setup.imu_timing.period_steps != 0:
        return
    k = n // setup.imu_timing.period_steps
    white, force, gyro = parts.noise.imu, parts.biases.force_mps2, parts.biases.gyro_radps
    sigma, rate_sigma = setup.imu.force_noise_mps2, setup.imu.rate_noise_radps
    sample = measure_imu(
        setup.model,
        aircraft,
        wind,
        rests,
        k + 1,
        n / setup.imu_timing.step_rate_hz,
        (
            force[0] + white[k, 0] * sigma,
            force[1] + white[k, 1] * sigma,
            force[2] + white[k, 2] * sigma,
        ),
        (
            gyro[0] + white[k, 3] * rate_sigma,
            gyro[1] + white[k, 4] * rate_sigma,
            gyro[2] + white[k, 5] * rate_sigma,
        ),
    )
    row = imus[k % len(imus)]
    row[0], row[1] = sample.time_s, sample.force_x_frd_mps2
    row[2], row[3] = sample.force_y_frd_mps2, sample.force_z_frd_mps2
    row[4] = sample.roll_rate_frd_radps
    row[5] = sample.pitch_rate_frd_radps
    row[6] = sample.yaw_rate_frd_radps


def _sense_airspeed(parts: Parts, aircraft: AircraftState, wind: Wind, n: int) -> None:
    setup, airspeeds = parts.setup, parts.instruments.airspeeds
    if n % setup.airspeed_timing.period_steps != 0:
        return
    k = n // setup.airspeed_timing.period_steps
    error = parts.biases.pressure_pa + parts.noise.airspeed[k] * setup.airspeed.pressure_noise_pa
    sample = measure_airspeed(
        setup.model, aircraft, wind, k + 1, n / setup.airspeed_timing.step_rate_hz, error
    )
    row = airspeeds[k % len(airspeeds)]
    row[0], row[1] = sample.time_s, sample.airspeed_mps


def _sense_pose(parts: Parts, aircraft: AircraftState, n: int) -> None:
    setup, noise = parts.setup, parts.noise
    biases, instruments = parts.biases, parts.instruments
    if n % setup.position_timing.period_steps == 0:
        k = n // setup.position_timing.period_steps
        params, white, bias = setup.position, noise.position, biases.position_m
        sigma, velocity_sigma = params.noise_m, params.velocity_noise_mps
        velocity_error = (NAN, NAN, NAN)
        if params.gives_velocity:
            velocity_error = (
                white[k, 3] * velocity_sigma,
                white[k, 4] * velocity_sigma,
                white[k, 5] * velocity_sigma,
            )
        fix = measure_position(
            setup.frame,
            aircraft,
            k + 1,
            n / setup.position_timing.step_rate_hz,
            (
                bias[0] + white[k, 0] * sigma,
                bias[1] + white[k, 1] * sigma,
                bias[2] + white[k, 2] * sigma,
            ),
            velocity_error,
        )
        row = instruments.fixes[k % len(instruments.fixes)]
        row[0], row[1], row[2], row[3] = fix.time_s, fix.north_m, fix.east_m, fix.down_m
        row[4] = fix.velocity_north_mps
        row[5] = fix.velocity_east_mps
        row[6] = fix.velocity_down_mps
    if n % setup.attitude_timing.period_steps == 0:
        k = n // setup.attitude_timing.period_steps
        white, turn, rate = noise.attitude, biases.attitude_rad, biases.rate_radps
        sigma, rate_sigma = setup.attitude.noise_rad, setup.attitude.rate_noise_radps
        sample = measure_attitude(
            setup.frame,
            aircraft,
            k + 1,
            n / setup.attitude_timing.step_rate_hz,
            (
                turn[0] + white[k, 0] * sigma,
                turn[1] + white[k, 1] * sigma,
                turn[2] + white[k, 2] * sigma,
            ),
            (
                rate[0] + white[k, 3] * rate_sigma,
                rate[1] + white[k, 4] * rate_sigma,
                rate[2] + white[k, 5] * rate_sigma,
            ),
        )
        row = instruments.attitudes[k % len(instruments.attitudes)]
        row[0], row[1], row[2] = sample.time_s, sample.qw, sample.qx
        row[3], row[4] = sample.qy, sample.qz
        row[5] = sample.roll_rate_frd_radps
        row[6] = sample.pitch_rate_frd_radps
        row[7] = sample.yaw_rate_frd_radps


def arrived_fix(parts: Parts, n: int) -> PositionFix:
    """The newest fix that has arrived by step n."""
    sequence = samples_delivered(parts.setup.position_timing, n)
    if sequence == 0:
        return NO_FIX
    fixes = parts.instruments.fixes
    row = fixes[(sequence - 1) % len(fixes)]
    return PositionFix(
        sequence=sequence,
        time_s=row[0],
        north_m=row[1],
        east_m=row[2],
        down_m=row[3],
        velocity_north_mps=row[4],
        velocity_east_mps=row[5],
        velocity_down_mps=row[6],
        source=0,
        sigma_m=NAN,
    )


def arrived_attitude(parts: Parts, n: int) -> AttitudeSample:
    """The newest attitude that has arrived by step n."""
    sequence = samples_delivered(parts.setup.attitude_timing, n)
    if sequence == 0:
        return NO_ATTITUDE
    attitudes = parts.instruments.attitudes
    row = attitudes[(sequence - 1) % len(attitudes)]
    return AttitudeSample(
        sequence=sequence,
        time_s=row[0],
        qw=row[1],
        qx=row[2],
        qy=row[3],
        qz=row[4],
        roll_rate_frd_radps=row[5],
        pitch_rate_frd_radps=row[6],
        yaw_rate_frd_radps=row[7],
    )


def arrived_imu(parts: Parts, n: int) -> ImuSample:
    """The newest accelerations that have arrived by step n."""
    if not parts.setup.has_imu:
        return NO_IMU
    sequence = samples_delivered(parts.setup.imu_timing, n)
    if sequence == 0:
        return NO_IMU
    imus = parts.instruments.imus
    row = imus[(sequence - 1) % len(imus)]
    return ImuSample(
        sequence=sequence,
        time_s=row[0],
        force_x_frd_mps2=row[1],
        force_y_frd_mps2=row[2],
        force_z_frd_mps2=row[3],
        roll_rate_frd_radps=row[4],
        pitch_rate_frd_radps=row[5],
        yaw_rate_frd_radps=row[6],
    )


def arrived_airspeed(parts: Parts, n: int) -> AirspeedSample:
    """The newest airspeed that has arrived by step n."""
    if not parts.setup.has_airspeed:
        return NO_AIRSPEED
    sequence = samples_delivered(parts.setup.airspeed_timing, n)
    if sequence == 0:
        return NO_AIRSPEED
    airspeeds = parts.instruments.airspeeds
    row = airspeeds[(sequence - 1) % len(airspeeds)]
    return AirspeedSample(sequence, row[0], row[1])


def arrived_surfaces(parts: Parts, n: int) -> SurfacesSample:
    """The newest surfaces that have been read back by step n."""
    if not parts.setup.has_surfaces:
        return NO_SURFACES
    sequence = samples_delivered(parts.setup.surfaces_timing, n)
    if sequence == 0:
        return NO_SURFACES
    surfaces = parts.instruments.surfaces
    row = surfaces[(sequence - 1) % len(surfaces)]
    return SurfacesSample(
        sequence=sequence, time_s=row[0], elevator=row[1], aileron=row[2], rudder=row[3]
    )


def world_step(
    parts: Parts, now: WorldNow, n: int, command: SurfaceCommand, held: bool
) -> WorldNow:
    """The world at step n, from the one before and the command since; as `World.step`."""
    setup, weather = parts.setup, parts.weather
    dt = 1.0 / setup.step_hz
    elevator = servo_step(setup.servo, now.elevator, command.elevator, dt)
    aileron = servo_step(setup.servo, now.aileron, command.aileron, dt)
    rudder = servo_step(setup.servo, now.rudder, command.rudder, dt)
    surfaces = SurfaceCommand(elevator.deflection, aileron.deflection, rudder.deflection)
    turbulence, gust = now.turbulence, (0.0, 0.0, 0.0)
    if weather.turbulent:
        white = parts.noise.turbulence[n]
        turbulence, gust = dryden_step(weather.dryden, turbulence, white[0], white[1], white[2])
    aircraft, crashed = now.aircraft, False
    if held:
        aircraft = aircraft._replace(
            elevator=surfaces.elevator, aileron=surfaces.aileron, rudder=surfaces.rudder
        )
    else:
        x, y, z = place_ahead(aircraft, dt)
        ahead = wind_at(setup, weather, gust, n, x, y, z)
        aircraft = aircraft_step(setup.model, aircraft, surfaces, now.wind, ahead, dt)
        crashed = not inside(setup, weather, n, aircraft.x_m, aircraft.y_m, aircraft.z_m)
    wind = wind_at(setup, weather, gust, n, aircraft.x_m, aircraft.y_m, aircraft.z_m)
    sense(parts, aircraft, wind, command, held or crashed, n)
    return WorldNow(
        aircraft=aircraft,
        elevator=elevator,
        aileron=aileron,
        rudder=rudder,
        wind=wind,
        turbulence=turbulence,
        crashed=crashed,
    )


REPORT_SIZE: Final = 53


def world_step_in_cells(
    parts_cell: Cell,
    now_cell: Cell,
    n: int,
    elevator: float,
    aileron: float,
    rudder: float,
    held: bool,
    report: FloatArray,
) -> None:
    """`world_step` for a caller in plain Python, to whom whole worlds are dear to hand over.

    report, shape (REPORT_SIZE,): the aircraft (16), the wind (3), crashed (1), the newest fix
    (8), attitude (9), accelerations (8), airspeed (3) and surfaces (5) that have arrived, in
    their fields' order.
    """
    parts: Parts = parts_cell.value
    now = world_step(parts, now_cell.value, n, SurfaceCommand(elevator, aileron, rudder), held)
    now_cell.value = now
    k = 0
    for value in now.aircraft:
        report[k] = value
        k += 1
    for value in now.wind:
        report[k] = value
        k += 1
    report[k] = 1.0 if now.crashed else 0.0
    fix, attitude = arrived_fix(parts, n), arrived_attitude(parts, n)
    report[20] = fix.sequence
    report[21], report[22], report[23], report[24] = fix[1:5]
    report[25], report[26], report[27] = fix[5:8]
    report[28] = attitude.sequence
    report[29], report[30], report[31], report[32], report[33] = attitude[1:6]
    report[34], report[35], report[36] = attitude[6:9]
    imu = arrived_imu(parts, n)
    report[37] = imu.sequence
    report[38], report[39], report[40], report[41] = imu[1:5]
    report[42], report[43], report[44] = imu[5:8]
    airspeed, surfaces = arrived_airspeed(parts, n), arrived_surfaces(parts, n)
    report[45] = airspeed.sequence
    report[46], report[47] = airspeed[1:3]
    report[48] = surfaces.sequence
    report[49], report[50], report[51], report[52] = surfaces[1:5]


TICK_REPORT_SIZE: Final = 6


def tick_in_cells(laws_cell: Cell, state_cell: Cell, inputs: Inputs, report: FloatArray) -> None:
    """The module's tick for a caller in plain Python, to whom laws and state are dear to hand over.

    report, shape (TICK_REPORT_SIZE,): mode, reason, active, elevator, aileron, rudder.
    """
    state: AutopilotState = state_cell.value
    laws: Laws = laws_cell.value
    state, output = autopilot_step(laws, state, inputs)
    state_cell.value = state
    report[0], report[1] = output.mode, output.reason
    report[2] = 1.0 if output.active else 0.0
    report[3], report[4], report[5] = output.command


def write_row(
    row: FloatArray, now_s: float, world: WorldNow, output: Output, target_changes: int
) -> None:
    """Fill the columns of `sim.closed_loop.Row`."""
    aircraft, wind = world.aircraft, world.wind
    roll, pitch, heading = euler_from_quaternion(aircraft.qw, aircraft.qx, aircraft.qy, aircraft.qz)
    air = air_data(aircraft, wind)
    row[0], row[1], row[2], row[3] = now_s, aircraft.x_m, aircraft.y_m, aircraft.z_m
    row[4] = e_rho(
        output.line.x_m, output.line.z_m, output.line.eta_rad, aircraft.x_m, aircraft.z_m
    )
    row[5] = 1.0 if output.line.moving or not output.active else 0.0
    row[6] = target_changes
    row[7], row[8] = pitch, output.setpoints.pitch_rad
    row[9], row[10] = roll, heading
    row[11] = output.command.elevator
    row[12], row[13] = air.airspeed_mps, air.alpha_rad
    row[14], row[15] = wind[0], wind[2]
    felt = output.air
    row[16], row[17], row[18] = felt.airspeed_mps, felt.alpha_rad, felt.wind_mps
    row[19], row[20] = felt.updraft_mps, felt.excess_mps
    row[21], row[22] = felt.wind_sigma_mps, felt.updraft_sigma_mps


def fly_ticks(
    parts: Parts,
    laws: Laws,
    flight: Flight,
    until_step: int,
    target_changes: int,
    rows: FloatArray,
) -> Flight:
    """Fly on to a step, or until the module lets go or the aircraft crashes.

    As `sim.closed_loop.fly`; `rows[n]` is filled for the tick at step n.
    """
    n, standing, reason = flight.steps, flight.standing, flight.reason
    world, autopilot = flight.world, flight.autopilot
    command, held = flight.command, flight.held
    dt = 1.0 / parts.setup.step_hz
    if n == 0:
        sense(parts, world.aircraft, world.wind, command, False, n)
    while n < until_step and standing == FLIES:
        now = n * dt
        inputs = Inputs(
            time_s=now,
            position=arrived_fix(parts, n),
            attitude=arrived_attitude(parts, n),
            autopilot=AutopilotStatus(
                time_s=now, accepts_surfaces=True, armed=True, failsafe=False, boots=0
            ),
            engage=now >= HELD_S,
            imu=arrived_imu(parts, n),
            airspeed=arrived_airspeed(parts, n),
            surfaces=arrived_surfaces(parts, n),
        )
        autopilot, output = autopilot_step(laws, autopilot, inputs)
        reason = output.reason
        if output.active:
            command = output.command
            held = False
        write_row(rows[n], now, world, output, target_changes)
        n += 1
        world = world_step(parts, world, n, command, held)
        if world.crashed:
            standing = CRASHED
        elif output.mode in (RELEASED, FAILED):
            standing = HAND_OVER
    return Flight(
        steps=n,
        standing=standing,
        reason=reason,
        world=world,
        command=command,
        held=held,
        autopilot=autopilot,
    )

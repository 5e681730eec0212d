"""A flight in a world, flown by the compiled kernel of `sim.flight`.

The world is taken apart into named tuples and arrays: its field into what `flight.air_wind`
knows, its times into columns, its randomness into white numbers from the very streams that its
sensors and its turbulence would draw from, for any seed.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from math import floor, inf, nan, pi
from typing import NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray, WindField
from tgl_soar.air.grid import (
    GridField,
    GridTable,
    GridTable3D,
    numpy_table,
    numpy_table_3d,
)
from tgl_soar.air.gusts import (
    DRYDEN_STILL,
    BlendedField,
    DrydenParams,
    GustyField,
    ScaledField,
    dryden_start,
    dryden_step,
)
from tgl_soar.air.hill import Hill, HillField
from tgl_soar.air.jet import Jet, SlopeJet
from tgl_soar.autopilot import Output, initial_state, reason_text
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.sim.aircraft import AircraftState
from tgl_soar.sim.closed_loop import Change, ClosedLoop, Row, Trajectory
from tgl_soar.sim.compiled import cell, compiled
from tgl_soar.sim.flight import (
    BOARD,
    CRASHED,
    FLIES,
    GRID,
    HAND_OVER,
    HILL,
    REPORT_SIZE,
    TICK_REPORT_SIZE,
    Air,
    Biases,
    Flight,
    Instruments,
    Noise,
    Parts,
    Setup,
    Weather,
    WorldNow,
    arrived_airspeed,
    arrived_attitude,
    arrived_fix,
    arrived_imu,
    arrived_surfaces,
    fly_ticks,
    sense,
    tick_in_cells,
    world_step_in_cells,
)
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import (
    AirspeedParams,
    ImuParams,
    SensorTiming,
    Triple,
    empty_line,
    sensor_timing,
)
from tgl_soar.sim.world import World
from tgl_soar.types import (
    NAN,
    NO_FIX,
    AirspeedSample,
    AttitudeSample,
    ImuSample,
    Inputs,
    PositionFix,
    SurfaceCommand,
    SurfacesSample,
)

_FAR_M = 1e6
_NO_AIR = Air(
    kind=HILL,
    hill=Hill(0.0, 0.0),
    jet=Jet(
        GridTable(x0_m=0.0, dx_m=1.0, nx=2, z0_m=0.0, dz_m=1.0, nz=2, values=np.zeros(8)), 0.0, 0.0
    ),
    half_width_m=inf,
    grid=GridTable3D(
        x0_m=0.0,
        dx_m=1.0,
        nx=2,
        y0_m=0.0,
        dy_m=1.0,
        ny=2,
        z0_m=0.0,
        dz_m=1.0,
        nz=2,
        values=np.zeros(24),
    ),
    solid=np.zeros((2, 2, 2), dtype=bool),
    goes_on=False,
    lost_mps=nan,
)
_NO_IMU_PARAMS = ImuParams(
    rate_hz=1.0,
    delay_s=0.0,
    force_noise_mps2=0.0,
    force_bias_mps2=0.0,
    rate_noise_radps=0.0,
    rate_bias_radps=0.0,
)
_NO_AIRSPEED_PARAMS = AirspeedParams(1.0, 0.0, 0.0, 0.0)


class Prepared(NamedTuple):
    """A world ready for compiled flights of up to some duration, with any seed."""

    world: World  # as it was made; its own seed plays no part
    setup: Setup
    weather: Weather
    ticks: int


class UnknownFieldError(ValueError):
    """A wind field that the compiled flight does not know; plain flights take any."""


def prepare(world: World, duration_s: float) -> Prepared:
    """Take a newly made world apart for flights of `duration_s` [s].

    Errors: `UnknownFieldError`; ValueError for a world that has already been stepped.
    """
    if world.steps:
        raise ValueError(f"world at step {world.steps}: a flight starts from a new one")
    ticks = round(duration_s * world.step_hz)
    times: FloatArray = np.arange(ticks + 1, dtype=np.float64) * (1.0 / world.step_hz)
    flat = _flat(world.field, times)
    position, attitude = world._position_sensor, world._attitude_sensor
    imu, airspeed, surfaces = world._imu_sensor, world._airspeed_sensor, world._surfaces_sensor
    never = sensor_timing("none", world.step_hz, 0.0, world.step_hz)
    setup = Setup(
        step_hz=world.step_hz,
        model=world.model,
        servo=world._servo,
        frame=world.frame,
        first=flat.first,
        second=flat.first if flat.second is None else flat.second,
        half_width_m=inf if world._bounds is None else world._bounds.half_width_m,
        position=position.params,
        position_timing=position.timing,
        attitude=attitude.params,
        attitude_timing=attitude.timing,
        has_imu=imu is not None,
        imu=_NO_IMU_PARAMS if imu is None else imu.params,
        imu_timing=never if imu is None else imu.timing,
        has_airspeed=airspeed is not None,
        airspeed=_NO_AIRSPEED_PARAMS if airspeed is None else airspeed.params,
        airspeed_timing=never if airspeed is None else airspeed.timing,
        has_surfaces=surfaces is not None,
        surfaces_timing=never if surfaces is None else surfaces.timing,
    )
    air = world._turbulence
    weather = Weather(
        weight=flat.weight,
        factor=flat.factor,
        gust_mps=flat.gust_mps,
        turbulent=air is not None,
        dryden=DrydenParams(1.0, 0.0, 0.0, 0.0) if air is None else air.params,
    )
    return Prepared(world, setup, weather, ticks)


def fly_compiled(
    prepared: Prepared, seed: int, values: ParameterSet, changes: Sequence[Change]
) -> Trajectory:
    """The flight that `closed_loop.fly` would make in a world of this seed, compiled."""
    world, ticks = prepared.world, prepared.ticks
    parts, start = _draw(prepared, seed)
    flight = Flight(
        steps=0,
        standing=FLIES,
        reason=0,
        world=start,
        command=SurfaceCommand(world.trim.elevator, 0.0, 0.0),
        held=True,
        autopilot=initial_state(),
    )
    rows = np.empty((ticks, len(Row._fields)))
    fly = compiled(fly_ticks)
    pending = sorted(changes, key=lambda change: change.time_s)
    dt = 1.0 / world.step_hz
    until_steps = [_first_step(change.time_s, dt) for change in pending]
    for done, until in enumerate([*until_steps, ticks]):
        if flight.standing != FLIES or flight.steps >= ticks:
            break
        if done > 0:
            values = values.changed(pending[done - 1].parameters, flying=True)
        if until > flight.steps:
            laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
            flight = fly(parts, laws, flight, min(until, ticks), done, rows)
    ended = ""
    if flight.standing == CRASHED:
        ended = world._why_lost(flight.world.aircraft)
    elif flight.standing == HAND_OVER:
        ended = f"let go: {reason_text(flight.reason)}"
    flown = rows[: flight.steps]
    columns = {name: flown[:, i] for i, name in enumerate(Row._fields)}
    return Trajectory(columns, ended, flight.steps)


def _first_step(time_s: float, dt_s: float) -> int:
    """The first step that is not before a time, as `closed_loop.fly` compares them."""
    n = max(0, floor(time_s / dt_s) - 1)
    while n * dt_s < time_s:
        n += 1
    return n


class CompiledWorld(World):
    """A world whose steps are compiled, for laws in plain Python: the world of `prepare`.

    It lasts as long as it was prepared for, and cannot be relaunched.
    """

    def __init__(self, prepared: Prepared, seed: int) -> None:
        vars(self).update(vars(prepared.world))  # in place of `World`'s own: it is made already
        parts, start = _draw(prepared, seed)
        compiled(sense)(parts, start.aircraft, start.wind, self._command, False, 0)
        self.position = arrived_fix(parts, 0)
        self.attitude = arrived_attitude(parts, 0)
        self.imu = arrived_imu(parts, 0)
        self.airspeed = arrived_airspeed(parts, 0)
        self.surfaces = arrived_surfaces(parts, 0)
        self.wind = start.wind
        self._ticks = prepared.ticks
        self._parts, self._now = cell(parts), cell(start)
        self._report = np.zeros(REPORT_SIZE)
        self._advance = compiled(world_step_in_cells)

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under a surface command."""
        if self.steps >= self._ticks:
            raise ValueError(f"this world was prepared for {self._ticks} steps and no more")
        self.steps += 1
        report = self._report
        held = self.held or self.crashed != ""
        self._advance(self._parts, self._now, self.steps, *command, held, report)
        values = report.tolist()
        self.state = AircraftState(*values[:16])
        self.wind = (values[16], values[17], values[18])
        if values[19] != 0.0:
            self.crashed = self._why_lost(self.state)
        if values[20] != self.position.sequence:
            at, speed = values[21:25], values[25:28]
            self.position = PositionFix(
                int(values[20]),
                *(at[0], at[1], at[2], at[3]),
                *(speed[0], speed[1], speed[2]),
                *(0, NAN),
            )
        self.attitude = AttitudeSample(int(values[28]), *values[29:37])
        self.imu = ImuSample(int(values[37]), *values[38:45])
        self.airspeed = AirspeedSample(int(values[45]), *values[46:48])
        self.surfaces = SurfacesSample(int(values[48]), *values[49:53])

    def relaunch(self) -> None:
        """Errors: ValueError, always."""
        raise ValueError("a compiled world cannot be relaunched: make another")


class CompiledLoop(ClosedLoop):
    """A closed loop whose laws are compiled too, for faults in plain Python between the two.

    Of an output it tells mode, reason, command and whether it is sent; all else is that of the
    first tick.
    """

    def __init__(
        self, world: World, values: ParameterSet, injection: Injection | None = None
    ) -> None:
        super().__init__(world, values, injection)
        self._laws_cell, self._state_cell = cell(self._laws), cell(self.state)
        self._tick_report = np.zeros(TICK_REPORT_SIZE)
        self._step = compiled(tick_in_cells)
        self._first: Output | None = None

    def change(self, parameters: dict[str, float]) -> None:
        """Set parameters between two ticks.  Errors: `ParameterError`."""
        super().change(parameters)
        self._laws_cell.value = self._laws

    def _decide(self, inputs: Inputs) -> Output:
        if self._first is None:
            _, self._first = autopilot_step(self._laws, self.state, inputs)
        self._step(self._laws_cell, self._state_cell, inputs, self._tick_report)
        mode, reason, active, *command = self._tick_report.tolist()
        return self._first._replace(
            time_s=inputs.time_s,
            mode=int(mode),
            reason=int(reason),
            active=active != 0.0,
            command=SurfaceCommand(*command),
        )


# --- randomness -------------------------------------------------------------------------------


def _draw(prepared: Prepared, seed: int) -> tuple[Parts, WorldNow]:
    """All that is random in a flight, and the world at its start in that air."""
    world, setup, weather, ticks = prepared
    white, turbulence, gust = np.zeros((1, 3)), DRYDEN_STILL, (0.0, 0.0, 0.0)
    if weather.turbulent:
        rng = np.random.default_rng([seed, 0])  # as `World` seeds its turbulence
        turbulence = dryden_start(weather.dryden, rng)
        white = rng.standard_normal(3 * (ticks + 1)).reshape(-1, 3)
        turbulence, gust = dryden_step(weather.dryden, turbulence, *white[0].tolist())
    position, attitude = setup.position, setup.attitude
    columns = 6 if position.gives_velocity else 3
    samples = ticks // setup.position_timing.period_steps + 1
    place = white_gauss(f"{seed}/position", 3 + columns * samples)
    samples = ticks // setup.attitude_timing.period_steps + 1
    turn = white_gauss(f"{seed}/attitude", 6 + 6 * samples)
    imu, airspeed = setup.imu, setup.airspeed
    samples = ticks // setup.imu_timing.period_steps + 1 if setup.has_imu else 0
    force = white_gauss(f"{seed}/imu", 6 + 6 * samples)
    samples = ticks // setup.airspeed_timing.period_steps + 1 if setup.has_airspeed else 0
    pressure = white_gauss(f"{seed}/airspeed", 1 + samples)
    state = world.state
    calm = world.field.wind_at(state.x_m, state.y_m, state.z_m, 0.0)
    parts = Parts(
        setup=setup,
        weather=weather,
        noise=Noise(
            turbulence=white,
            position=place[3:].reshape(-1, columns),
            attitude=turn[6:].reshape(-1, 6),
            imu=force[6:].reshape(-1, 6),
            airspeed=pressure[1:],
        ),
        biases=Biases(
            position_m=_triple(place[:3] * position.bias_m),
            attitude_rad=_triple(turn[:3] * attitude.bias_rad),
            rate_radps=_triple(turn[3:6] * attitude.rate_bias_radps),
            force_mps2=_triple(force[:3] * imu.force_bias_mps2),
            gyro_radps=_triple(force[3:6] * imu.rate_bias_radps),
            pressure_pa=float(pressure[0]) * airspeed.pressure_bias_pa,
        ),
        instruments=Instruments(
            fixes=_under_way(setup.position_timing, 7),
            attitudes=_under_way(setup.attitude_timing, 8),
            imus=_under_way(setup.imu_timing, 7),
            airspeeds=_under_way(setup.airspeed_timing, 2),
            surfaces=_under_way(setup.surfaces_timing, 4),
        ),
    )
    wind = (calm[0] + gust[0], calm[1] + gust[1], calm[2] + gust[2])
    elevator, aileron, rudder = world._servos
    return parts, WorldNow(
        aircraft=state,
        elevator=elevator,
        aileron=aileron,
        rudder=rudder,
        wind=wind,
        turbulence=turbulence,
        crashed=False,
    )


def _under_way(timing: SensorTiming, columns: int) -> FloatArray:
    """Room for the samples that may be on their way."""
    return np.zeros((len(empty_line(timing, NO_FIX)), columns))


def _triple(numbers: FloatArray) -> Triple:
    x, y, z = numbers.tolist()
    return x, y, z


def white_gauss(seed: str, count: int) -> FloatArray:
    """The first `count` numbers of `random.Random(seed).gauss(0, 1)`, shape (count,).

    The standard library draws pairs by Box and Muller's method from a Mersenne twister, which
    numpy has too.
    """
    _, internal, _ = random.Random(seed).getstate()
    twister = np.random.RandomState()
    key = np.array(internal[:-1], dtype=np.uint32)
    twister.set_state(("MT19937", key, internal[-1], 0, 0.0))
    uniform = twister.random_sample((-(-count // 2), 2))
    angle = uniform[:, 0] * (2.0 * pi)
    radius = np.sqrt(-2.0 * np.log(1.0 - uniform[:, 1]))
    return np.stack([np.cos(angle) * radius, np.sin(angle) * radius], axis=1).ravel()[:count]


# --- fields -----------------------------------------------------------------------------------


class _Flat(NamedTuple):
    """A field as one or two steady ones and what becomes of them in time."""

    first: Air
    second: Air | None
    weight: FloatArray  # negative: there is no second
    factor: FloatArray
    gust_mps: FloatArray


def _flat(field: WindField, times_s: FloatArray) -> _Flat:
    count = len(times_s)
    if isinstance(field, GustyField):
        flat = _flat(field.field, times_s)
        gusts = np.array([field.gust_at(t) for t in times_s.tolist()])
        return flat._replace(gust_mps=flat.gust_mps + gusts)
    if isinstance(field, ScaledField):
        flat = _flat(field.field, times_s)
        factor = np.array([field.factor.at(t) for t in times_s.tolist()])
        return flat._replace(
            factor=flat.factor * factor, gust_mps=flat.gust_mps * factor[:, np.newaxis]
        )
    if isinstance(field, BlendedField):
        weight = np.array([field.weight.at(t) for t in times_s.tolist()])
        return _Flat(
            first=as_air(field.first),
            second=as_air(field.second),
            weight=weight,
            factor=np.ones(count),
            gust_mps=np.zeros((count, 3)),
        )
    return _Flat(
        first=as_air(field),
        second=None,
        weight=np.full(count, -1.0),
        factor=np.ones(count),
        gust_mps=np.zeros((count, 3)),
    )


def as_air(field: WindField) -> Air:
    """A steady field as data.  Errors: `UnknownFieldError`."""
    if isinstance(field, HillField):
        return _NO_AIR._replace(kind=HILL, hill=field.hill)
    if isinstance(field, SlopeJet):
        return _NO_AIR._replace(
            kind=BOARD,
            jet=field.jet._replace(table=numpy_table(field.jet.table)),
            half_width_m=0.5 * field.shape.jet_width_m,
        )
    if isinstance(field, GridField):
        table, solid = field.table, field.solid
        if isinstance(table, GridTable):
            table, solid = _at_every_y(field, table), np.stack([solid, solid], axis=1)
        return _NO_AIR._replace(
            kind=GRID,
            grid=numpy_table_3d(table),
            solid=solid,
            goes_on=field.outside == "edge",
            lost_mps=0.0 if field.outside == "still" else nan,
        )
    raise UnknownFieldError(
        f"{type(field).__name__}: compiled flights know SlopeJet, HillField, GridField, and these"
        " blended, scaled or with gusts, in this order; fly it plain"
    )


def _at_every_y(field: GridField, table: GridTable) -> GridTable3D:
    """A grid in x and z, twice along y, farther apart than any flight goes."""
    x = table.x0_m + np.arange(table.nx)[:, np.newaxis] * table.dx_m
    z = table.z0_m + np.arange(table.nz) * table.dz_m
    nodes = np.stack(field.wind(x, 0.0, z), axis=-1)
    return GridTable3D(
        x0_m=table.x0_m, dx_m=table.dx_m, nx=table.nx,
        y0_m=-_FAR_M, dy_m=2.0 * _FAR_M, ny=2,
        z0_m=table.z0_m, dz_m=table.dz_m, nz=table.nz,
        values=np.stack([nodes, nodes], axis=1).ravel(),
    )  # fmt: skip

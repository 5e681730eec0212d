"""Drawn aircraft in flight: who stays up, and how near the line.

Each aircraft flies with the parameters that its own file would give and the gains to be judged, on
one line of a site, in turbulence; without accelerometers it carries them and does not use them
(EST_IMU = 0).  An aircraft that has no place to soar on the line is drawn again: the steady glide
would not hold it there, or only stalled, on the ground or outside the fence.  A command reaches
the servo whole ticks later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import lru_cache
from math import cos, degrees, nan, radians, sin, sqrt
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import Crossing, ZeucError, stable_crossing
from tgl_soar.analysis.experiments.scenario import place_at_speed_ratio, search_bounds
from tgl_soar.analysis.experiments.spread_along_line import Slide, dryden_dispersion, leverage
from tgl_soar.analysis.tuning.aircraft import TICK_S, Drawn, Ranges, drawn_aircraft
from tgl_soar.autopilot import mode_name, reason_text
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_site
from tgl_soar.config.lateral_gains import airframe_parameters
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site, Start
from tgl_soar.control.envelope import clearance, outside
from tgl_soar.control.found_gains import INERTIAL
from tgl_soar.control.laws import laws_from
from tgl_soar.control.pitch_design import own_gains
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.aircraft import aircraft_model, glide_at
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import (
    CompiledLoop,
    CompiledWorld,
    Prepared,
    fly_compiled,
    prepare,
)
from tgl_soar.sim.world import World, make_world, site_field
from tgl_soar.types import SurfaceCommand, polar_sink

DURATION_S: Final = 30.0
SETTLE_S: Final = 8.0  # from the start: e_rho is not scored before
START_M: Final = 0.3  # downstream of where it hovers by itself
REDRAWN_MAX: Final = 50
CLEAR_OF_STALL_RAD: Final = 0.035  # of a steady glide, or gusts of 3 % stall it now and then
CLEAR_OF_GROUND: Final = 2.0  # of the least clearance, where the low rule begins
# Of the dispersion along the line: half a minute holds some 20 independent values, and one value
# of 30,000 lies further down.
DEVIATIONS: Final = 4.0
SLOPE_MPS: Final = 0.05
_OVER: Final = ("released", "failed")


class DrawnFlight(NamedTuple):
    """What became of one flight."""

    up: bool  # to the end
    rms_e_rho_m: float  # from SETTLE_S on; of all, where it did not last so long
    duration_s: float
    ended: str  # why; ""
    rms_y_m: float = nan  # from the middle, likewise
    rms_bank_rad: float = nan  # likewise


class FlyingPlace(NamedTuple):
    """Where all fly."""

    airframe: Airframe
    site_path: Path
    ranges: Ranges
    duration_s: float = DURATION_S
    unknown_late_s: float = 0.0  # of every command, beyond what the module knows
    # Of each aircraft's own best glide: the line goes through the contour where the wind is so
    # fast. None: the line of the values, whoever flies.
    speed_ratio: float | None = None
    # The turbulence whose dispersion along the line must leave room to ground and fence.
    roughest: float = 0.0
    seeks: bool = False  # gains for each aircraft, as the module does; else those of the values


class Attempt(NamedTuple):
    """One flight to be flown."""

    values: ParameterSet  # gains and line
    kind: str  # with accelerometers or without
    seed: tuple[int, ...]  # of the aircraft and of the air
    turbulence: float


class LateWorld(World):
    """A world whose surfaces get every command some ticks later."""

    def __init__(self, world: World, ticks: int) -> None:
        vars(self).update(vars(world))  # in place of `World`'s own: it is made already
        self._waiting = _waiting(world, ticks)

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under the command of some ticks ago."""
        self._waiting.append(command)
        super().step(self._waiting.popleft())


class LateCompiledWorld(CompiledWorld):
    """The same, compiled."""

    def __init__(self, prepared: Prepared, seed: int, ticks: int) -> None:
        super().__init__(prepared, seed)
        self._waiting = _waiting(prepared.world, ticks)

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under the command of some ticks ago."""
        self._waiting.append(command)
        super().step(self._waiting.popleft())


def _waiting(world: World, ticks: int) -> deque[SurfaceCommand]:
    return deque([SurfaceCommand(world.trim.elevator, 0.0, 0.0)] * ticks)


def fly_attempt(field: FlyingPlace, attempt: Attempt) -> DrawnFlight:
    """One flight.  Errors: `ConfigError`; ValueError where no aircraft finds a place to soar."""
    site, air = _place(field.site_path)
    drawn, place, on_line = soaring_aircraft(field, attempt.values, attempt.seed)
    # Of the same bits as the first number of the aircraft (*seed, 0); but a seed is hashed.
    seed = int(np.random.default_rng(attempt.seed).integers(2**31))
    world = make_world(
        drawn.known,
        replace(site, start=Start(x_m=place.x_m + START_M, z_m=place.z_m)),
        seed=seed,
        turbulence=max(attempt.turbulence, 1e-6),  # one compiled kind of air for all
        field=air,
        sensors=drawn.sensors,
    )
    world.parts = world.parts._replace(model=drawn.true)
    late_s = drawn.latency_s + field.unknown_late_s
    values = values_of(on_line, drawn, attempt.kind, seeks=field.seeks)
    return fly_late(world, seed, values, late_s, field.duration_s)


def fly_late(
    world: World, seed: int, values: ParameterSet, late_s: float, duration_s: float
) -> DrawnFlight:
    """One flight in a world that was made with this seed, every command `late_s` [s] late."""
    ticks = round(late_s / TICK_S)
    line = line_of(values)
    if available():
        late: World = LateCompiledWorld(prepare(world, duration_s), seed, ticks)
        return _flown(CompiledLoop(late, values), line, duration_s)
    return _flown(ClosedLoop(LateWorld(world, ticks), values), line, duration_s)


def fly_whole(world: World, seed: int, values: ParameterSet, duration_s: float) -> DrawnFlight:
    """One flight in a world that was made with this seed, no command later than its servos are:
    compiled as a whole, ten times as fast as `fly_late`."""
    line = line_of(values)
    if not available():
        return _flown(ClosedLoop(world, values), line, duration_s)
    flown = fly_compiled(prepare(world, duration_s), seed, values, ())
    places = zip(flown["x_m"].tolist(), flown["z_m"].tolist(), strict=True)
    distances = np.array([e_rho(line[0], line[1], line[2], x, z) for x, z in places])
    settle = round(SETTLE_S * world.step_hz)
    if flown.ticks <= settle:
        settle = 0
    return DrawnFlight(
        up=not flown.ended,
        rms_e_rho_m=_rms(distances[settle:]),
        duration_s=flown.ticks / world.step_hz,
        ended=flown.ended.removeprefix("disengaged: "),
        rms_y_m=_rms(flown["y_m"][settle:]),
        rms_bank_rad=_rms(flown["roll_rad"][settle:]),
    )


def _flown(loop: ClosedLoop, line: tuple[float, float, float], duration_s: float) -> DrawnFlight:
    world = loop.world
    distances: list[float] = []
    sideways: list[float] = []
    banks: list[float] = []
    ended = ""
    for _ in range(round(duration_s * world.step_hz)):
        output = loop.tick()
        distances.append(e_rho(line[0], line[1], line[2], world.state.x_m, world.state.z_m))
        sideways.append(world.state.y_m)
        state = world.state
        banks.append(euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)[0])
        if world.crashed:
            ended = world.why_lost(world.state)
            break
        if mode_name(output.mode) in _OVER:
            ended = reason_text(output.reason)
            break
    settle = round(SETTLE_S * world.step_hz)
    return DrawnFlight(
        up=not ended,
        rms_e_rho_m=_rms(distances[settle:] or distances),
        duration_s=len(distances) / world.step_hz,
        ended=ended,
        rms_y_m=_rms(sideways[settle:] or sideways),
        rms_bank_rad=_rms(banks[settle:] or banks),
    )


def _rms(values: Sequence[float] | NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def line_of(values: ParameterSet) -> tuple[float, float, float]:
    """x0 [m], z0 [m], eta [rad] of the target line."""
    return values["TGL_X"], values["TGL_Z"], eta_from_lean(radians(values["TGL_LEAN"]))


def soaring_aircraft(
    field: FlyingPlace, values: ParameterSet, seed: tuple[int, ...]
) -> tuple[Drawn, Crossing, ParameterSet]:
    """The first drawn aircraft of a seed that has a place to soar on the line, the place, and the
    values with this line."""
    site, air = _place(field.site_path)
    for attempt in range(REDRAWN_MAX):
        drawn = drawn_aircraft(field.airframe, field.ranges, (*seed, attempt))
        try:
            on_line = _with_line(field, site, air, drawn, values)
        except ZeucError:  # the contour has no such wind
            continue
        place = _hovering(drawn, site, air, on_line, field.roughest)
        if place is not None:
            return drawn, place, on_line
    raise ValueError(
        f"of {REDRAWN_MAX} aircraft like {field.airframe.airframe.name!r} none has a place to soar"
        f" on this line of {field.site_path}: name another --site or --line, or --flights 0"
    )


def _with_line(
    field: FlyingPlace, site: Site, air: WindField, drawn: Drawn, values: ParameterSet
) -> ParameterSet:
    """The line of an aircraft.  Errors: `ZeucError`."""
    if field.speed_ratio is None:
        return values
    polar = drawn.known.polar.as_polar()
    x_m, z_m = place_at_speed_ratio(air, polar, search_bounds(site), field.speed_ratio)
    return values.changed({"TGL_X": x_m, "TGL_Z": z_m})


def _hovering(
    drawn: Drawn, site: Site, air: WindField, values: ParameterSet, roughest: float
) -> Crossing | None:
    """Where a steady glide holds an aircraft on the line; None: nowhere that is clear of the stall,
    and of ground and fence by as much as it is dispersed along the line."""
    at = stable_crossing(air, drawn.known.polar.as_polar(), line_of(values))
    if at is None:
        return None
    try:
        alpha_rad = glide_at(drawn.true, at.wind_mps).alpha_rad
    except ValueError:  # no such glide
        return None
    if alpha_rad >= drawn.true.stall_alpha_rad - CLEAR_OF_STALL_RAD:
        return None
    laws = laws_from(values, site.frame(), ground=site.known_ground())
    if clearance(laws.ground, at.x_m, at.z_m) < CLEAR_OF_GROUND * values["CLEAR_MIN"]:
        return None
    along_m = DEVIATIONS * _dispersion_m(drawn, site, air, at, laws.target.eta_rad, roughest)
    c, s = cos(laws.target.eta_rad), sin(laws.target.eta_rad)
    low, high = ((at.x_m + side * along_m * c, at.z_m + side * along_m * s) for side in (-1.0, 1.0))
    clear = clearance(laws.ground, *low) > values["CLEAR_MIN"]
    inside = not any(outside(laws.fence, x, 0.0, z) for x, z in (low, high))
    return at if clear and inside else None


def _dispersion_m(
    drawn: Drawn, site: Site, air: WindField, at: Crossing, eta_rad: float, turbulence: float
) -> float:
    """Standard deviation along the line, which no law that keeps the line still can make smaller
    (`experiments.spread_along_line`)."""
    assert site.air is not None
    polar, u = drawn.known.polar.as_polar(), at.wind_mps
    slope = (polar_sink(polar, u + SLOPE_MPS) - polar_sink(polar, u - SLOPE_MPS)) / (2 * SLOPE_MPS)
    slide = Slide(rate_per_s=1.0, polar_slope=slope, eta_rad=eta_rad)
    slide = slide._replace(rate_per_s=-at.excess_slope_per_s / leverage(slide))
    reference = air.reference_wind_mps
    length_m = site.air.turbulence.length_scale_m
    return dryden_dispersion(slide, turbulence * reference, length_m / reference)


def values_of(
    values: ParameterSet, drawn: Drawn, kind: str, *, seeks: bool = False
) -> ParameterSet:
    """The parameters that an aircraft flies with: as its own file has them.

    All that follows from the aircraft, the gains of roll and heading with it, follows from the one
    that was drawn; what the file gives in [parameters] is in `values`.  `seeks`: gains of pitch are
    sought for it, as for any other aircraft whose file has none of its own.
    """
    derived = airframe_parameters(drawn.known)
    known = {name: value for name, value in derived.items() if name not in drawn.known.parameters}
    model = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
    trim = degrees(glide_at(model, max(derived["DYN_BEST"], _slowest(drawn))).pitch_rad)
    shift = trim - values["PITCH_TRIM"]
    flown = values.changed(
        {
            **known,
            "CMD_DELAY": drawn.latency_s,
            "EST_IMU": 1.0 if kind == INERTIAL else 0.0,
            "PITCH_TRIM": trim,
            "PITCH_MIN": values["PITCH_MIN"] + shift,
            "PITCH_MAX": values["PITCH_MAX"] + shift,
            "REC_PITCH": values["REC_PITCH"] + shift,
        }
    )
    return flown.changed(own_gains(flown)) if seeks else flown


def _slowest(drawn: Drawn) -> float:
    return drawn.known.polar.speed_min_mps


@lru_cache(maxsize=2)
def _place(site_path: Path) -> tuple[Site, WindField]:
    """A site and its air.  Errors: `ConfigError`."""
    site = load_site(site_path)
    if site.air is None:
        raise ValueError(f"{site_path}: no [air] to fly in: name another --site, or --flights 0")
    return site, site_field(site, site_path.parent)


class Outcomes(NamedTuple):
    """Flights of one kind in one turbulence."""

    up: int
    of: int
    rms_e_rho_m: float  # root of the mean square of all, the lost ones as far as they flew


def survival(flown: Sequence[DrawnFlight]) -> Outcomes:
    """What became of them together."""
    square = sum(flight.rms_e_rho_m**2 for flight in flown) / max(1, len(flown))
    return Outcomes(sum(flight.up for flight in flown), len(flown), sqrt(square))

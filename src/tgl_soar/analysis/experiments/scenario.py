"""Scenario files: what is flown, where, in what air, and what changes when.

A scenario names an airframe and a site (or carries its own air), the target gradient lines,
and what changes in time: the operator's parameters and lines, the wind, the slope of the
board.  A line may be given by its point, as in a site file, or by where on the zero excess
updraft contour (ZEUC) the aircraft shall hover:

    speed_ratio   local wind over the speed of best glide, 0.9 is on the slow side
    pivot         the line passes through a point of another line, `below_m` under its crossing

so that a scenario means the same in another wind field.  Everything unknown, missing or out
of range is a `ConfigError` naming file, key, value and what is allowed.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from math import cos, degrees, isfinite, radians, sin
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from tgl_soar.air.field import FloatArray, WindField
from tgl_soar.air.gusts import BlendedField, ScaledField, Schedule
from tgl_soar.air.zeuc import (
    Bounds,
    Crossing,
    ZeucError,
    contour,
    excess_gradient,
    stable_crossing,
)
from tgl_soar.analysis.experiments.spread_along_line import Slide
from tgl_soar.config.airframe import Airframe, ModelKind
from tgl_soar.config.files import (
    ConfigError,
    line_parameters,
    load_airframe,
    load_file,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.line_changes import SIDES
from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.config.site import (
    HillAir,
    JetAir,
    Line,
    PolynomialAir,
    Site,
    SiteOrigin,
    Start,
    TurbulenceSettings,
)
from tgl_soar.config.strict import Strict
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.estimation.polar import best_glide_speed
from tgl_soar.sim.closed_loop import Change
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.sensors import (
    AUTOPILOT_POSITION,
    MEMS_IMU,
    PITOT,
    READ_BACK,
    PositionParams,
    Sensors,
)
from tgl_soar.sim.world import build_field, site_field
from tgl_soar.types import GlidePolar, polar_slope

Seconds = Annotated[float, Meta(ge=0, le=3600)]
Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]

CONTOUR_STEP_M = 0.02


class LineSpec(Strict, frozen=True):
    """A line: by its point, by the local wind at its crossing, or through another's."""

    x_m: Finite | None = None
    z_m: Finite | None = None
    speed_ratio: Annotated[float, Meta(ge=0.5, le=2.0)] | None = None
    pivot: str | None = None
    below_m: Finite = 0.0
    lean_deg: Annotated[float, Meta(ge=-60, le=60)] | None = None  # default: TGL_LEAN

    def __post_init__(self) -> None:
        by_point = self.x_m is not None or self.z_m is not None
        ways = by_point + (self.speed_ratio is not None) + (self.pivot is not None)
        if ways != 1 or (by_point and (self.x_m is None or self.z_m is None)):
            raise ValueError("a line needs x_m and z_m, or speed_ratio, or pivot, and only one")
        if self.below_m != 0.0 and self.pivot is None:
            raise ValueError("below_m goes with pivot")


class TimedChange(Strict, frozen=True):
    """What the operator does at a time: go to a line, set parameters, or both."""

    time_s: Seconds
    line: str | None = None
    parameters: dict[str, float] = {}  # noqa: RUF012 - msgspec copies it

    def __post_init__(self) -> None:
        if self.line is None and not self.parameters:
            raise ValueError("a change needs a line or parameters")


class WindSchedule(Strict, frozen=True):
    """The reference wind in time, piecewise linear."""

    times_s: list[Seconds]
    mps: list[Annotated[float, Meta(gt=0, le=50)]]

    def __post_init__(self) -> None:
        Schedule(self.times_s, self.mps)


class SlopeSchedule(Strict, frozen=True):
    """The slope of the board in time, piecewise linear."""

    times_s: list[Seconds]
    deg: list[Annotated[float, Meta(ge=15, le=35)]]

    def __post_init__(self) -> None:
        Schedule(self.times_s, self.deg)


class StartSpec(Strict, frozen=True):
    """Where the aircraft is disengaged: from the first line's crossing, or at a place."""

    downstream_m: Finite = 0.3
    up_m: Finite = 0.0
    x_m: Finite | None = None
    z_m: Finite | None = None

    def __post_init__(self) -> None:
        if (self.x_m is None) != (self.z_m is None):
            raise ValueError("a place needs both x_m and z_m")


class PositionSpec(Strict, frozen=True):
    """A source of position; without velocity_noise_mps it gives no velocity."""

    rate_hz: Annotated[float, Meta(ge=1, le=200)]
    delay_s: Annotated[float, Meta(ge=0, le=1)]
    noise_m: Annotated[float, Meta(ge=0, le=10)]
    bias_m: Annotated[float, Meta(ge=0, le=10)] = 0.0
    velocity_noise_mps: Annotated[float, Meta(ge=0, le=10)] | None = None
    drift_m: Annotated[float, Meta(ge=0, le=20)] = 0.0  # a receiver's slow error, horizontally
    drift_up_m: Annotated[float, Meta(ge=0, le=20)] = 0.0
    drift_s: Annotated[float, Meta(ge=1, le=36000)] = 300.0

    def __post_init__(self) -> None:
        if max(self.drift_m, self.drift_up_m) > 0.0 and self.noise_m == 0.0:
            raise ValueError("drift_m, drift_up_m: a drift needs noise_m above 0")

    def as_params(self) -> PositionParams:
        """The same, as the simulation has it."""
        noise = self.velocity_noise_mps
        return PositionParams(
            rate_hz=self.rate_hz,
            delay_s=self.delay_s,
            noise_m=self.noise_m,
            bias_m=self.bias_m,
            velocity_noise_mps=noise or 0.0,
            gives_velocity=noise is not None,
            drift_m=self.drift_m,
            drift_up_m=self.drift_up_m,
            drift_s=self.drift_s,
        )


class SensorSpec(Strict, frozen=True):
    """What the module is given: the autopilot's position and attitude, and what is named."""

    position: PositionSpec | None = None  # None: the autopilot's own
    imu: bool = False  # accelerations
    pitot: bool = False
    surfaces: bool = False  # read back

    def as_sensors(self) -> Sensors:
        """The same, as the simulation has it."""
        return Sensors(
            position=AUTOPILOT_POSITION if self.position is None else self.position.as_params(),
            imu=MEMS_IMU if self.imu else None,
            airspeed=PITOT if self.pitot else None,
            surfaces=READ_BACK if self.surfaces else None,
        )


class Scenario(Strict, frozen=True):
    """One scenario file."""

    title: str
    duration_s: Annotated[float, Meta(gt=0, le=3600)]
    first_line: str
    lines: dict[str, LineSpec]
    airframe: str = "airframes/eclipson_c.toml"  # beside this file, or of those shipped
    model: ModelKind | None = None  # None: the airframe file's
    site: str | None = None
    air: JetAir | HillAir | PolynomialAir | None = None
    parameters: dict[str, float] = {}  # noqa: RUF012 - msgspec copies it
    turbulence: TurbulenceSettings | None = None
    seeds: tuple[Annotated[int, Meta(ge=0)], ...] = (1,)
    start: StartSpec = StartSpec()
    sensors: SensorSpec = SensorSpec()
    changes: list[TimedChange] = []  # noqa: RUF012 - msgspec copies it
    wind: WindSchedule | None = None
    slope: SlopeSchedule | None = None
    faults: list[str] = []  # noqa: RUF012 - msgspec copies it; as `--fault` of the bridge
    # From, to: while wind or slope change.
    unscored_s: list[tuple[Seconds, Seconds]] = []  # noqa: RUF012 - msgspec copies it

    def __post_init__(self) -> None:
        if (self.site is None) == (self.air is None):
            raise ValueError("a scenario needs either a site or an [air] table")
        parse_faults(self.faults)
        if not self.seeds:
            raise ValueError("seeds: at least one is needed")
        for name in (self.first_line, *(c.line for c in self.changes if c.line is not None)):
            if name not in self.lines:
                raise ValueError(f"no line named {name!r}; there are {', '.join(self.lines)}")
        for name, line in self.lines.items():
            if line.pivot is not None and (
                line.pivot not in self.lines or self.lines[line.pivot].pivot is not None
            ):
                raise ValueError(
                    f"lines.{name}: pivot = {line.pivot!r}: must be a line that has no pivot"
                )
        late = [c.time_s for c in self.changes if c.time_s >= self.duration_s]
        if late:
            raise ValueError(f"a change at {late[0]:g} s is after the end, {self.duration_s:g} s")


class PlacedLine(NamedTuple):
    """A line of a scenario, and where the aircraft should hover on it at the start's air."""

    target: TargetLine
    crossing: Crossing | None


class PreparedScenario(NamedTuple):
    """A scenario ready to be flown."""

    scenario: Scenario
    airframe: Airframe
    site: Site
    values: ParameterSet  # with the first line
    field: WindField
    polar: GlidePolar
    lines: dict[str, PlacedLine]
    changes: list[Change]


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario file.  Airframe and site become full paths.  Errors: `ConfigError`."""
    scenario = load_file(path, Scenario)
    folder = Path(path).parent
    airframe = str(_beside(path, "airframe", scenario.airframe, folder))
    site = scenario.site and str(_beside(path, "site", scenario.site, folder))
    scenario = msgspec.structs.replace(scenario, airframe=airframe, site=site)
    try:
        prepare(scenario)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return scenario


def _beside(path: str | Path, key: str, name: str, folder: Path) -> Path:
    for candidate in (folder / name, shipped(name)):
        if candidate.is_file():
            return candidate.resolve()
    raise ConfigError(
        f"{path}: {key} = {name!r}: no such file beside the scenario or among those shipped"
    )


def prepare(scenario: Scenario) -> PreparedScenario:
    """Build the air, place the lines, check every parameter.  Errors: `ConfigError`."""
    return _prepare(msgspec.json.encode(scenario))


@lru_cache(maxsize=32)
def _prepare(text: bytes) -> PreparedScenario:
    scenario = msgspec.json.decode(text, type=Scenario)
    airframe = load_airframe(scenario.airframe).flown_as(scenario.model)
    polar = airframe.polar.as_polar()
    if scenario.site is not None:
        site = load_site(scenario.site)
        site_path = scenario.site
    else:
        site = Site(site=SiteOrigin(name=scenario.title), air=scenario.air)
        site_path = scenario.title
    if site.air is None:
        raise ConfigError(f"site {site.site.name}: a scenario needs an [air] table")
    if scenario.turbulence is not None:
        air = msgspec.structs.replace(site.air, turbulence=scenario.turbulence)
        site = msgspec.structs.replace(site, air=air)
    values = load_parameters(airframe, scenario.airframe, site, site_path)
    try:
        values = values.changed(scenario.parameters)
    except ParameterError as error:
        raise ConfigError(f"parameters.{error}") from None

    field = _field(scenario, site)
    bounds = search_bounds(site)
    lines = _place_lines(scenario, values, field, polar, bounds)
    first = lines[scenario.first_line]
    values = _changed(values, first.target, {}, f"lines.{scenario.first_line}")
    changes, check = [], values
    for timed in scenario.changes:
        parameters = dict(timed.parameters)
        if timed.line is not None:
            parameters = {**_line_values(lines[timed.line].target), **parameters}
        try:
            check = check.changed(parameters, flying=True)
        except ParameterError as error:
            raise ConfigError(f"changes at {timed.time_s:g} s: {error}") from None
        changes.append(Change(timed.time_s, parameters))
    site = msgspec.structs.replace(site, start=_start(scenario, first))
    return PreparedScenario(
        scenario=scenario,
        airframe=airframe,
        site=site,
        values=values,
        field=field,
        polar=polar,
        lines=lines,
        changes=changes,
    )


def _field(scenario: Scenario, site: Site) -> WindField:
    air = site.air
    assert air is not None
    field = site_field(site, None if scenario.site is None else Path(scenario.site).parent)
    if scenario.slope is not None:
        if not isinstance(air, JetAir):
            raise ConfigError("slope: only the board in a jet has a slope that changes")
        low, high = min(scenario.slope.deg), max(scenario.slope.deg)
        if low == high:
            field = build_field(msgspec.structs.replace(air, slope_deg=low))
        else:
            weight = [(deg - low) / (high - low) for deg in scenario.slope.deg]
            field = BlendedField(
                build_field(msgspec.structs.replace(air, slope_deg=low)),
                build_field(msgspec.structs.replace(air, slope_deg=high)),
                Schedule(scenario.slope.times_s, weight),
            )
    if scenario.wind is not None:
        reference = field.reference_wind_mps
        factor = Schedule(scenario.wind.times_s, [v / reference for v in scenario.wind.mps])
        field = ScaledField(field, factor)
    return field


def search_bounds(site: Site) -> Bounds:
    """Where a contour is looked for: x from, x to, z from, z to [m].  Errors: `ConfigError`."""
    if isinstance(site.air, JetAir):
        return (-1.2, 2.4, 0.05, 3.3)
    if isinstance(site.air, HillAir):
        radius = site.air.radius_m
        return (-4.0 * radius, 0.0, 0.05 * radius, 4.0 * radius)
    if isinstance(site.air, PolynomialAir):
        return (*site.air.x_m, *site.air.z_m)
    if missing := [name for name in SIDES if name not in site.parameters]:
        raise ConfigError(
            f"site {site.site.name}: name the bounds in which to look for the contour: a grid's are"
            f" those of the fence, and [parameters] lacks {', '.join(missing)}"
        )
    x_min, x_max, z_min, z_max = (site.parameters[name] for name in SIDES)
    return x_min, x_max, z_min, z_max


def contour_step(bounds: Bounds) -> float:
    """Width of the cells searched for a contour: fine enough for any bend of it [m]."""
    return max(CONTOUR_STEP_M, (bounds[1] - bounds[0]) / 160.0)


def _place_lines(
    scenario: Scenario,
    values: ParameterSet,
    field: WindField,
    polar: GlidePolar,
    bounds: Bounds,
) -> dict[str, PlacedLine]:
    lines: dict[str, PlacedLine] = {}
    # Lines on the contour and by their point first; then those that lean on others.
    ordered = sorted(scenario.lines.items(), key=lambda item: item[1].pivot is not None)
    for name, spec in ordered:
        lean = radians(spec.lean_deg if spec.lean_deg is not None else values["TGL_LEAN"])
        eta = eta_from_lean(lean)
        try:
            if spec.pivot is not None:
                base = lines[spec.pivot]
                if base.crossing is None:
                    raise ZeucError(f"line {spec.pivot!r} meets no contour to pivot about")
                at = base.crossing
                x = float(at.x_m) - spec.below_m * cos(base.target.eta_rad)
                z = float(at.z_m) - spec.below_m * sin(base.target.eta_rad)
            elif spec.speed_ratio is not None:
                x, z = place_at_speed_ratio(field, polar, bounds, spec.speed_ratio)
            else:
                assert spec.x_m is not None
                assert spec.z_m is not None
                x, z = spec.x_m, spec.z_m
        except ZeucError as error:
            raise ConfigError(f"lines.{name}: {error}") from None
        target = TargetLine(x, z, eta)
        lines[name] = PlacedLine(target, stable_crossing(field, polar, target))
    return lines


def place_at_speed_ratio(
    field: WindField, polar: GlidePolar, bounds: Bounds, speed_ratio: float, time_s: float = 0.0
) -> tuple[float, float]:
    """The lowest place (x, z) [m] of the contour where the wind is so many times best glide's.

    Only where excess updraft falls upwards, so that an upright line is stable there.
    Errors: `ZeucError` with the ratios that the contour has.
    """
    best = best_glide_speed(polar)
    if not isfinite(best):
        raise ZeucError("the glide polar has no best glide within its range")
    parts = contour(field, polar, bounds, contour_step(bounds), time_s=time_s)
    found: list[tuple[float, float]] = []
    least, most = float("inf"), 0.0
    for part in parts:
        if len(part) < 2:
            continue
        ratio = field.wind(part[:, 0], 0.0, part[:, 1], time_s)[0] / best
        upper = _falls_upwards(field, polar, part, time_s)
        for (a, b), (first, second) in zip(
            pairwise(range(len(part))), pairwise(ratio.tolist()), strict=True
        ):
            if not (upper[a] and upper[b]):
                continue
            least, most = min(least, first, second), max(most, first, second)
            if (first - speed_ratio) * (second - speed_ratio) <= 0.0 and first != second:
                fraction = (speed_ratio - first) / (second - first)
                x, z = part[a] + fraction * (part[b] - part[a])
                found.append((float(x), float(z)))
    if not found:
        raise ZeucError(
            f"speed_ratio = {speed_ratio:g}: the contour has local winds of {least:.3f} to"
            f" {most:.3f} times best glide's {best:.2f} m/s; choose one of these, or another wind"
        )
    return min(found, key=lambda place: place[1])


def _falls_upwards(
    field: WindField, polar: GlidePolar, part: FloatArray, time_s: float
) -> list[bool]:
    return [
        excess_gradient(field, polar, float(x), float(z), time_s=time_s)[1] < 0.0 for x, z in part
    ]


def perpendicular_lean(
    field: WindField, polar: GlidePolar, x_m: float, z_m: float, time_s: float = 0.0
) -> float:
    """Lean [rad] of the line perpendicular to the contour at a place of it."""
    gx, gz = excess_gradient(field, polar, x_m, z_m, time_s=time_s)
    # The upper end points where excess updraft falls: t = (−sin lean, cos lean) = −∇E / |∇E|.
    return float(np.arctan2(gx, -gz))


def slide_at(polar: GlidePolar, target: TargetLine, crossing: Crossing) -> Slide:
    """How an aircraft slides back to its place on a line."""
    slope = polar_slope(polar, crossing.wind_mps)
    leverage = sin(target.eta_rad) - slope * cos(target.eta_rad)
    return Slide(-crossing.excess_slope_per_s / leverage, slope, target.eta_rad)


def _line_values(target: TargetLine) -> dict[str, float]:
    line = Line(x_m=target.x_m, z_m=target.z_m, lean_deg=round(degrees(target.eta_rad) - 90.0, 9))
    return line_parameters(line)


def _changed(
    values: ParameterSet, target: TargetLine, more: dict[str, float], where: str
) -> ParameterSet:
    try:
        return values.changed({**_line_values(target), **more})
    except ParameterError as error:
        raise ConfigError(f"{where}: {error}") from None


def _start(scenario: Scenario, first: PlacedLine) -> Start:
    start = scenario.start
    if start.x_m is not None and start.z_m is not None:
        return Start(x_m=start.x_m, z_m=start.z_m)
    if first.crossing is None:
        raise ConfigError(
            f"lines.{scenario.first_line}: meets no stable place of the contour, so there is"
            " nowhere to start: give start.x_m and start.z_m, or another line"
        )
    at = first.crossing
    return Start(x_m=at.x_m + start.downstream_m, z_m=at.z_m + start.up_m)

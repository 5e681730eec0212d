"""The world as an object: air, turbulence, aircraft, servos and sensors, stepped together.

Its step is `sim.world_step`'s, which compiled flights share; here it meets a site file, a wind
field of any kind, and whoever holds the aircraft or puts it back to the start.  The air changes
at the same steps as the rest:

    wind(place, n) = field(place, n dt) + turbulence(n)

Everything random comes from one seed, each sensor and the turbulence from a stream of its own:
the same seed and the same commands give the same flight, bit for bit.

An aircraft that touches ground or board, or leaves the air that the field describes, is
`crashed`: it stays where it is until `relaunch`.
"""

from __future__ import annotations

from math import atan2, cos, inf, isfinite, pi, radians, sin, tan
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import asdict

from tgl_soar.air.field import WindField
from tgl_soar.air.grid import GridError
from tgl_soar.air.grid_files import Layout, read_grid
from tgl_soar.air.gusts import DrydenState
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import JetShape, SlopeJet
from tgl_soar.air.polynomial import (
    PolynomialError,
    PolynomialField,
    fit_polynomial,
    lowest_floor,
)
from tgl_soar.air.wind_record import (
    RecordedField,
    WindRecordError,
    oblique_field,
    read_wind_record,
    turned,
)
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError
from tgl_soar.config.site import (
    GridAir,
    HillAir,
    JetAir,
    PolynomialAir,
    Site,
    Start,
    Tether,
)
from tgl_soar.geometry import SoaringFrame, euler_from_quaternion
from tgl_soar.sim.aircraft import (
    AircraftState,
    Glide,
    Wind,
    air_data,
    aircraft_model,
    gliding_state,
)
from tgl_soar.sim.flight_turbulence import flight_turbulence
from tgl_soar.sim.flown_aircraft import FlownAircraft
from tgl_soar.sim.point_mass import PointMass, point_mass, polar_misfit
from tgl_soar.sim.sensor_sampling import NO_SAMPLES, flown_sensors
from tgl_soar.sim.sensors import USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import ServoParams, servo_params, servo_start
from tgl_soar.sim.tether import NO_TETHER, TetherParams, tether_params
from tgl_soar.sim.white_noise import drawn_as_needed
from tgl_soar.sim.world_step import (
    FieldAir,
    Parts,
    WorldNow,
    local_wind,
    world_begun,
    world_step,
)
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_GROUND,
    Aerodynamics,
    AttitudeSample,
    Ground,
    PositionFix,
    SurfaceCommand,
)

Outline = list[tuple[float, float]]

_HILL_HALF_WIDTH_M: Final = 500.0


class Truth(NamedTuple):
    """What really is, soaring frame."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float  # over the ground
    velocity_y_mps: float
    climb_mps: float
    roll_rad: float
    pitch_rad: float
    heading_rad: float  # from straight upwind
    wind_x_mps: float  # of the air at the aircraft, turbulence included
    wind_y_mps: float
    updraft_mps: float
    airspeed_mps: float
    alpha_rad: float
    elevator: float  # where the surfaces stand
    aileron: float
    rudder: float
    brake: float


class Bounds(NamedTuple):
    """What stands in the air's way, in words for whoever runs into it."""

    outline: Outline  # corners of the solid shape in the vertical plane; [] where there is none
    name: str
    floor_m: float  # height of the ground; −inf: none
    half_width_m: float


class World:
    """One aircraft in its air.

    field, frame   the wind, and where its soaring frame stands in local NED
    start          where the aircraft is released: at rest over the ground, facing upwind, with
                   the elevator and the pitch of a steady glide at the local wind's speed, or
                   a lower pitch where the updraft would stall it at rest
    turbulence     Dryden intensity as a fraction of the field's reference wind, and its scale
    roll_gusts     whether the turbulence rolls the aircraft too, by its span
    step_hz        steps per second; every sensor's rate must divide it
    sensors        what it carries; the autopilot's own position and attitude by default
    aerodynamics   what the module on board knows of the aircraft; the model is what is true
    ground         what it knows of the ground; the field and the bounds are what is true
    """

    def __init__(
        self,
        model: FlownAircraft,
        servo: ServoParams,
        field: WindField,
        frame: SoaringFrame,
        start: Start,
        *,
        seed: int = 1,
        turbulence: float = 0.0,
        length_scale_m: float = 1.5,
        roll_gusts: bool = True,
        step_hz: int = 200,
        bounds: Bounds | None = None,
        sensors: Sensors = USUAL_SENSORS,
        aerodynamics: Aerodynamics = NO_AERODYNAMICS,
        ground: Ground = NO_GROUND,
        tether: TetherParams = NO_TETHER,
    ) -> None:
        self.step_hz = step_hz
        self.steps = 0
        self.held = False  # somebody holds the aircraft where it is
        self.crashed = ""  # why it flies no more
        self.field, self.frame, self.start = field, frame, start
        self.aerodynamics = aerodynamics
        self.ground = ground
        self.sensors = sensors
        self.bounds = bounds
        self._dt_s = 1.0 / step_hz
        if not field.inside(start.x_m, start.y_m, start.z_m):
            raise ValueError(
                f"start at x {start.x_m:g}, y {start.y_m:g}, z {start.z_m:g} m:"
                " the wind field does not reach there, or it lies in the ground"
            )
        calm = field.wind_at(start.x_m, start.y_m, start.z_m, 0.0)
        self.trim = _trim(model, calm[0])
        unstalled = model.highest_pitch_glide().alpha_rad - atan2(calm[2], calm[0])
        self._launch_pitch_rad = min(self.trim.pitch_rad, unstalled)
        span_m = model.span_m if roll_gusts else None
        met = flight_turbulence(
            turbulence, field.reference_wind_mps, length_scale_m, span_m, self._dt_s, seed
        )
        self.parts = Parts(
            step_hz=step_hz,
            model=model,
            servo=servo,
            frame=frame,
            air=FieldAir(field, self._dt_s, inf if bounds is None else bounds.half_width_m),
            turbulence=met.turbulence,
            sensors=flown_sensors(sensors, step_hz, drawn_as_needed(seed), ground=ground),
            tether=tether,
        )
        self._polled_position = self._polled_attitude = 0
        self._begin(met.eddies, met.roll_gust_radps)

    def _begin(self, eddies: DrydenState, roll_gust_radps: float) -> None:
        surface = servo_start(self.parts.servo, self._dt_s, 0.0)
        now = WorldNow(
            aircraft=self._launched(),
            elevator=servo_start(self.parts.servo, self._dt_s, self.trim.elevator),
            aileron=surface,
            rudder=surface,
            brake=surface,
            throttle=0.0,
            turbulence=eddies,
            gust_mps=(0.0, 0.0, 0.0),
            roll_gust_radps=roll_gust_radps,
            wind=(0.0, 0.0, 0.0),
            crashed=False,
            samples=NO_SAMPLES,
        )
        self._take(world_begun(self.parts, now, SurfaceCommand(self.trim.elevator, 0.0, 0.0)))

    @property
    def model(self) -> FlownAircraft:
        """What is true of the aircraft."""
        return self.parts.model

    @property
    def state(self) -> AircraftState:
        """The aircraft as it is."""
        return self.now.aircraft

    @state.setter
    def state(self, state: AircraftState) -> None:
        self._set(self.now._replace(aircraft=state))

    @property
    def throttle(self) -> float:
        """What a propeller is commanded, 0 … 1."""
        return self.now.throttle

    @throttle.setter
    def throttle(self, throttle: float) -> None:
        if throttle != self.now.throttle:
            self._set(self.now._replace(throttle=throttle))

    @property
    def wind(self) -> Wind:
        """The wind at the aircraft."""
        return self.now.wind

    @property
    def trim_pitch_rad(self) -> float:
        """The pitch of a steady glide at the speed of the wind at the start."""
        return self.trim.pitch_rad

    @property
    def time_s(self) -> float:
        """Time since the world began."""
        return self.steps * self._dt_s

    def relaunch(self) -> None:
        """Put the aircraft back to the start; time and the air go on."""
        start, surface = self.start, servo_start(self.parts.servo, self._dt_s, 0.0)
        self.crashed = ""
        self._set(
            self.now._replace(
                aircraft=self._launched(),
                elevator=servo_start(self.parts.servo, self._dt_s, self.trim.elevator),
                aileron=surface,
                rudder=surface,
                brake=surface,
                throttle=0.0,
                wind=local_wind(
                    self.parts, self.now.gust_mps, self.steps, start.x_m, start.y_m, start.z_m
                ),
                crashed=False,
            )
        )

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under a surface command."""
        self.steps += 1
        self._take(self._stepped(command))
        if self.now.crashed and not self.crashed:
            self.crashed = self.why_lost(self.state)

    def _stepped(self, command: SurfaceCommand) -> WorldNow:
        return world_step(self.parts, self.now, self.steps, command, self.held)

    def _set(self, now: WorldNow) -> None:
        """Put the world into another state."""
        self.now = now

    def _take(self, now: WorldNow) -> None:
        """Take the state of a new step, and what has arrived in it."""
        self.now = now
        (
            self.position,
            self.attitude,
            self.imu,
            self.airspeed,
            self.surfaces,
            self.rangefinder,
        ) = now.samples

    def _launched(self) -> AircraftState:
        start, trim = self.start, self.trim
        still = (trim.horizontal_mps, 0.0, trim.sink_mps)  # its glide, seen from the ground
        glide = trim._replace(pitch_rad=self._launch_pitch_rad)
        return gliding_state(glide, still, start.x_m, start.y_m, start.z_m)

    def poll_attitude(self) -> AttitudeSample | None:
        """The newest attitude that has arrived, once; None: none since the last call."""
        if self.attitude.sequence == self._polled_attitude:
            return None
        self._polled_attitude = self.attitude.sequence
        return self.attitude

    def poll_position(self) -> PositionFix | None:
        """The newest position that has arrived, once; None: none since the last call."""
        if self.position.sequence == self._polled_position:
            return None
        self._polled_position = self.position.sequence
        return self.position

    @property
    def airspeed_mps(self) -> float:
        """The true airspeed."""
        return air_data(self.state, self.wind).airspeed_mps

    @property
    def truth(self) -> Truth:
        """Everything about this instant."""
        s, wind = self.state, self.wind
        roll, pitch, heading = euler_from_quaternion(s.qw, s.qx, s.qy, s.qz)
        air = air_data(s, wind)
        return Truth(
            time_s=self.time_s,
            x_m=s.x_m,
            y_m=s.y_m,
            z_m=s.z_m,
            velocity_x_mps=s.velocity_x_mps,
            velocity_y_mps=s.velocity_y_mps,
            climb_mps=s.velocity_z_mps,
            roll_rad=roll,
            pitch_rad=pitch,
            heading_rad=heading,
            wind_x_mps=wind[0],
            wind_y_mps=wind[1],
            updraft_mps=wind[2],
            airspeed_mps=air.airspeed_mps,
            alpha_rad=air.alpha_rad,
            elevator=s.elevator,
            aileron=s.aileron,
            rudder=s.rudder,
            brake=s.brake,
        )

    def why_lost(self, state: AircraftState) -> str:
        """What ended the flight of an aircraft that has crashed in this state."""
        x, y, z = state.x_m, state.y_m, state.z_m
        where = f"at x {x:.2f}, y {y:.2f}, z {z:.2f} m"
        if not (isfinite(x) and isfinite(y) and isfinite(z)):
            return "the simulation lost the aircraft: its place is not a number"
        bounds = self.bounds
        if bounds is not None:
            if abs(y) > bounds.half_width_m:
                return f"left the air sideways {where}"
            if z < bounds.floor_m:
                return f"hit the ground {where}"
            if _within(bounds.outline, x, z):
                return f"hit the {bounds.name} {where}"
        return f"left the air that the field describes {where}"


def _trim(model: FlownAircraft, wind_mps: float) -> Glide:
    """The glide at this horizontal airspeed, or at the slowest that the model flies."""
    slowest = model.highest_pitch_glide()
    return slowest if wind_mps <= slowest.horizontal_mps else model.glide_at(wind_mps)


def _within(outline: Outline, x: float, z: float) -> bool:
    """Whether a place lies inside a polygon: an odd number of edges lie to its right."""
    odd = False
    for (x1, z1), (x2, z2) in zip(outline, outline[1:] + outline[:1], strict=True):
        if (z1 > z) != (z2 > z) and x < x1 + (z - z1) * (x2 - x1) / (z2 - z1):
            odd = not odd
    return odd


# --- from a site file ------------------------------------------------------------------------

Air = JetAir | HillAir | GridAir | PolynomialAir


def site_field(
    site: Site, folder: Path | None = None, called: str | Path | None = None
) -> WindField:
    """The wind field of a site, in its soaring frame; `folder` is that of the site file.

    called: what errors call that file, where it is known.  Errors: `ConfigError`.
    """
    assert site.air is not None
    try:
        return build_field(site.air, folder, radians(site.site.oblique_deg()))
    except ConfigError as error:
        raise ConfigError(f"{called or f'site {site.site.name}'}: {error}") from None


def build_field(air: Air, folder: Path | None = None, oblique_rad: float = 0.0) -> WindField:
    """The wind field of a site's `[air]`; `folder` is that of the site file.

    oblique_rad: how far from the right of the frame's axis the wind comes; the field itself is of a
    straight ridge along y, which is blown at straight.  Errors: `ConfigError`.
    """
    if isinstance(air, JetAir):
        return SlopeJet(air.wind_mps, radians(air.slope_deg))
    if isinstance(air, HillAir):
        return _blown(HillField(air.wind_mps, air.radius_m), air.record, folder, oblique_rad)
    if isinstance(air, PolynomialAir):
        return _blown(_polynomial_field(air, folder), None, folder, oblique_rad)
    path = Path(air.file) if folder is None else folder / air.file
    try:
        grid = read_grid(
            path,
            Layout(**asdict(air.layout)),
            reference_wind_mps=air.wind_mps,
            zero_cells=air.zero_cells,
            step_m=air.mesh_step_m,
        )
    except (GridError, ImportError) as error:
        raise ConfigError(f"air.file: {error}") from None
    return _blown(grid, air.record, folder, oblique_rad)


def _blown(
    field: WindField, record: str | None, folder: Path | None, oblique_rad: float
) -> WindField:
    """A steady field in the wind of a record, where there is one, and from where it comes."""
    if record is None:
        return oblique_field(field, oblique_rad)
    path = Path(record) if folder is None else folder / record
    try:
        return RecordedField(field, turned(read_wind_record(path), oblique_rad))
    except WindRecordError as error:
        raise ConfigError(f"air.record: {error}") from None


def _polynomial_field(air: PolynomialAir, folder: Path | None) -> PolynomialField:
    """The polynomial next to the air that it follows, above that air's ground."""
    followed = build_field(air.of, folder)
    region = (*air.x_m, *air.z_m)
    outline = ground_outline(air.of)
    try:
        if outline is None:
            floor = lowest_floor(followed, region, air.step_m)
        else:
            corners = sorted(outline)
            floor = tuple(
                (x, max(z for at, z in corners if at == x)) for x in sorted({x for x, _ in corners})
            )
        return fit_polynomial(followed, region, air.degree, step_m=air.step_m, floor=floor)[0]
    except PolynomialError as error:
        raise ConfigError(f"air: {error}") from None


def wind_misfit_text(field: WindField) -> str:
    """How far a polynomial is from the air that it follows; "" for any other field."""
    if isinstance(field, RecordedField):
        field = field.field
    if not isinstance(field, PolynomialField) or field.misfit is None:
        return ""
    misfit = field.misfit
    return (
        f"wind: a polynomial of degree {field.polynomial.degree}, fitted at {misfit.places} places;"
        f" off by {misfit.u_rms_mps:.3f} m/s rms along the wind (at most {misfit.u_most_mps:.2f}),"
        f" {misfit.w_rms_mps:.3f} up (at most {misfit.w_most_mps:.2f})"
    )


def ground_outline(air: Air) -> Outline | None:
    """Corners (x, z) [m] of the board or the hill in the vertical plane; None: not known."""
    if isinstance(air, JetAir):
        shape = JetShape(slope_rad=radians(air.slope_deg))
        tip = shape.board_length_m * cos(shape.slope_rad)
        return [(0.0, 0.0), (tip, tip * tan(shape.slope_rad)), (tip, 0.0)]
    if isinstance(air, HillAir):
        angles = [pi * i / 90 for i in range(91)]
        return [(air.radius_m * cos(a), air.radius_m * sin(a)) for a in angles]
    if isinstance(air, PolynomialAir):
        return ground_outline(air.of)
    return None


def _bounds(air: Air) -> Bounds | None:
    if isinstance(air, PolynomialAir):
        return _bounds(air.of)
    outline = ground_outline(air)
    if isinstance(air, JetAir):
        return Bounds(
            outline or [],
            "board",
            0.0,
            0.5 * JetShape(slope_rad=radians(air.slope_deg)).jet_width_m,
        )
    if isinstance(air, HillAir):
        return Bounds(outline or [], "hill", 0.0, _HILL_HALF_WIDTH_M)
    return None


def flown_aircraft(airframe: Airframe) -> FlownAircraft:
    """What an airframe file's `[model]` flies as, by its `kind`.  Errors: ValueError."""
    figures = asdict(airframe.airframe)
    if airframe.model_kind == "point_mass":
        return point_mass(figures, airframe.model, airframe.polar.as_polar())
    return aircraft_model(figures, airframe.model)


def polar_misfit_text(airframe: Airframe) -> str:
    """How far a point mass's glides are from the airframe's polar; "" for the rigid body.

    Errors: ValueError.
    """
    model = flown_aircraft(airframe)
    if not isinstance(model, PointMass):
        return ""
    misfit = polar_misfit(model, airframe.polar.as_polar())
    return (
        f"point mass: its sink is off the airframe's polar by {misfit.rms_mps:.3f} m/s rms"
        f" (at most {misfit.most_mps:.3f})"
    )


def _tether_of(tether: Tether | None, mass_kg: float) -> TetherParams:
    if tether is None:
        return NO_TETHER
    anchor = tether.x_m, tether.y_m, tether.z_m
    return tether_params(anchor, tether.length_m, tether.stiffness_npm, mass_kg)


def make_world(
    airframe: Airframe,
    site: Site,
    *,
    seed: int = 1,
    turbulence: float | None = None,
    step_hz: int = 200,
    folder: Path | None = None,
    field: WindField | None = None,
    sensors: Sensors = USUAL_SENSORS,
    known: Airframe | None = None,
) -> World:
    """The world of an airframe and a site file.

    turbulence: its intensity where it is not the site's.  field: one that was built before, to
    save the time where many worlds share it.  sensors: what the aircraft carries.
    known: what the module takes the aircraft for, where it is not what flies.
    Errors: `ConfigError`.
    """
    if site.air is None:
        raise ConfigError(f"site {site.site.name}: no [air] table, so there is no wind to fly in")
    if site.start is None:
        raise ConfigError(f"site {site.site.name}: no [start] table, so nowhere to be released")
    try:
        model = flown_aircraft(airframe)
        return World(
            model,
            servo_params(airframe.model),
            field if field is not None else site_field(site, folder),
            site.frame(),
            site.start,
            seed=seed,
            turbulence=site.air.turbulence.intensity if turbulence is None else turbulence,
            length_scale_m=site.air.turbulence.length_scale_m,
            roll_gusts=site.air.turbulence.roll_gusts,
            step_hz=step_hz,
            bounds=_bounds(site.air),
            sensors=sensors,
            aerodynamics=(known or airframe).aerodynamics(),
            ground=site.known_ground(),
            tether=_tether_of(site.tether, model.mass_kg),
        )
    except ValueError as error:
        raise ConfigError(f"{site.site.name}, {airframe.airframe.name}: {error}") from None

"""The world: air, turbulence, aircraft, servos and sensors, stepped together at a fixed dt.

At step n (time n dt) the sensors see the aircraft as it is at that instant.  `step` takes the
surface command that acts from step n to n + 1.  The air changes at the same steps:

    wind(place, n) = field(place, n dt) + turbulence(n)

Everything random comes from one seed, each sensor and the turbulence from a stream of its own:
the same seed and the same commands give the same flight, bit for bit.

An aircraft that touches ground or board, or leaves the air that the field describes, is
`crashed`: it stays where it is until `relaunch`.
"""

from __future__ import annotations

from math import atan2, cos, isfinite, pi, radians, sin, tan
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import asdict

from tgl_soar.air.field import WindField
from tgl_soar.air.grid import GridError
from tgl_soar.air.grid_files import Layout, read_grid
from tgl_soar.air.gusts import Turbulence
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import JetShape, SlopeJet
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError
from tgl_soar.config.site import (
    GridAir,
    HillAir,
    JetAir,
    Site,
    Start,
)
from tgl_soar.geometry import SoaringFrame, euler_from_quaternion
from tgl_soar.sim.aircraft import (
    AircraftModel,
    AircraftState,
    Glide,
    Wind,
    air_data,
    aircraft_model,
    glide_at,
    gliding_state,
    highest_pitch_glide,
    step,
)
from tgl_soar.sim.sensors import (
    USUAL_SENSORS,
    AirspeedSensor,
    AttitudeSensor,
    ImuSensor,
    PositionSensor,
    Sensors,
    SurfacesSensor,
)
from tgl_soar.sim.servos import ServoParams, servo_params, servo_start, servo_step
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_GROUND,
    NO_IMU,
    NO_SURFACES,
    Aerodynamics,
    AirspeedSample,
    AttitudeSample,
    Ground,
    ImuSample,
    PositionFix,
    SurfaceCommand,
    SurfacesSample,
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


class Bounds(NamedTuple):
    """What stands in the air's way, in words for whoever runs into it."""

    outline: Outline  # corners of the solid shape in the vertical plane; [] where there is none
    name: str
    floor_m: float  # height of the ground; −inf: none
    half_width_m: float


class World:
    """One aircraft in its air.

    field, frame   the wind, and where its soaring frame stands in local NED
    start          where the aircraft is let go: at rest over the ground, facing upwind, with
                   the elevator and the pitch of a steady glide at the local wind's speed, or
                   a lower pitch where the updraft would stall it at rest
    turbulence     Dryden intensity as a fraction of the field's reference wind, and its scale
    step_hz        steps per second; every sensor's rate must divide it
    sensors        what it carries; the autopilot's own position and attitude by default
    aerodynamics   what the module on board is told of the aircraft; the model is what is true
    ground         what it is told of the ground; the field and the bounds are what is true
    """

    def __init__(
        self,
        model: AircraftModel,
        servo: ServoParams,
        field: WindField,
        frame: SoaringFrame,
        start: Start,
        *,
        seed: int = 1,
        turbulence: float = 0.0,
        length_scale_m: float = 1.5,
        step_hz: int = 200,
        bounds: Bounds | None = None,
        sensors: Sensors = USUAL_SENSORS,
        aerodynamics: Aerodynamics = NO_AERODYNAMICS,
        ground: Ground = NO_GROUND,
    ) -> None:
        self.step_hz = step_hz
        self.steps = 0
        self.held = False  # somebody holds the aircraft where it is
        self.crashed = ""  # why it flies no more
        self.field, self.frame, self.start = field, frame, start
        self.aerodynamics = aerodynamics
        self.ground = ground
        self.position: PositionFix = NO_FIX  # the newest that has arrived
        self.attitude: AttitudeSample = NO_ATTITUDE
        self.imu: ImuSample = NO_IMU
        self.airspeed: AirspeedSample = NO_AIRSPEED
        self.surfaces: SurfacesSample = NO_SURFACES
        self.model, self._servo = model, servo
        self._dt_s = 1.0 / step_hz
        self._bounds = bounds
        self._turbulence = (
            Turbulence(turbulence, length_scale_m, field.reference_wind_mps, self._dt_s, [seed, 0])
            if turbulence > 0.0
            else None
        )
        self._gust: Wind = (0.0, 0.0, 0.0)
        if self._turbulence is not None:
            self._gust = self._turbulence.step()
        imu, airspeed, surfaces = sensors.imu, sensors.airspeed, sensors.surfaces
        self._position_sensor = PositionSensor(sensors.position, frame, step_hz, seed)
        self._attitude_sensor = AttitudeSensor(sensors.attitude, frame, step_hz, seed)
        self._imu_sensor = None if imu is None else ImuSensor(imu, model, step_hz, seed)
        self._airspeed_sensor = (
            None if airspeed is None else AirspeedSensor(airspeed, model, step_hz, seed)
        )
        self._surfaces_sensor = (
            None if surfaces is None else SurfacesSensor(surfaces, step_hz, seed)
        )
        self._polled_position = self._polled_attitude = 0
        if not field.inside(start.x_m, start.y_m, start.z_m):
            raise ValueError(
                f"start at x {start.x_m:g}, y {start.y_m:g}, z {start.z_m:g} m:"
                " the wind field does not reach there, or it lies in the ground"
            )
        calm = field.wind_at(start.x_m, start.y_m, start.z_m, 0.0)
        self.trim = _trim(model, calm[0])
        unstalled = highest_pitch_glide(model).alpha_rad - atan2(calm[2], calm[0])
        self._launch_pitch_rad = min(self.trim.pitch_rad, unstalled)
        self._command = SurfaceCommand(self.trim.elevator, 0.0, 0.0)
        self.relaunch()
        self._sense()

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
        start, trim = self.start, self.trim
        still = (trim.horizontal_mps, 0.0, trim.sink_mps)  # its glide, seen from the ground
        glide = trim._replace(pitch_rad=self._launch_pitch_rad)
        self.state: AircraftState = gliding_state(glide, still, start.x_m, start.y_m, start.z_m)
        self._servos = [
            servo_start(self._servo, self._dt_s, deflection)
            for deflection in (trim.elevator, 0.0, 0.0)
        ]
        self.crashed = ""
        self.wind: Wind = self._wind_at(start.x_m, start.y_m, start.z_m)

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under a surface command."""
        dt, servo, state = self._dt_s, self._servo, self.state
        self._command = command
        servos = self._servos = [
            servo_step(servo, self._servos[0], command[0], dt),
            servo_step(servo, self._servos[1], command[1], dt),
            servo_step(servo, self._servos[2], command[2], dt),
        ]
        surfaces = SurfaceCommand(servos[0].deflection, servos[1].deflection, servos[2].deflection)
        self.steps += 1
        if self._turbulence is not None:
            self._gust = self._turbulence.step()
        if self.held or self.crashed:
            state = state._replace(elevator=surfaces[0], aileron=surfaces[1], rudder=surfaces[2])
        else:
            ahead = self._wind_at(
                state.x_m + state.velocity_x_mps * dt,
                state.y_m + state.velocity_y_mps * dt,
                state.z_m + state.velocity_z_mps * dt,
            )
            state = step(self.model, state, surfaces, self.wind, ahead, dt)
            if not self.field.inside(state.x_m, state.y_m, state.z_m) or (
                self._bounds is not None and abs(state.y_m) > self._bounds.half_width_m
            ):
                self.crashed = self._why_lost(state)
                state = _at_rest(state)
        self.state = state
        self.wind = self._wind_at(state.x_m, state.y_m, state.z_m)
        self._sense()

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
            self.time_s,
            s.x_m,
            s.y_m,
            s.z_m,
            s.velocity_x_mps,
            s.velocity_y_mps,
            s.velocity_z_mps,
            roll,
            pitch,
            heading,
            *wind,
            air.airspeed_mps,
            air.alpha_rad,
            s.elevator,
            s.aileron,
            s.rudder,
        )

    def _wind_at(self, x_m: float, y_m: float, z_m: float) -> Wind:
        u, v, w = self.field.wind_at(x_m, y_m, z_m, self.steps * self._dt_s)
        gust = self._gust
        return u + gust[0], v + gust[1], w + gust[2]

    def _sense(self) -> None:
        self.position = self._position_sensor.step(self.steps, self.state)
        self.attitude = self._attitude_sensor.step(self.steps, self.state)
        if self._imu_sensor is not None:
            rests = self.held or self.crashed != ""
            self.imu = self._imu_sensor.step(self.steps, self.state, self.wind, rests)
        if self._airspeed_sensor is not None:
            self.airspeed = self._airspeed_sensor.step(self.steps, self.state, self.wind)
        if self._surfaces_sensor is not None:
            self.surfaces = self._surfaces_sensor.step(self.steps, self._command)

    def _why_lost(self, state: AircraftState) -> str:
        x, y, z = state.x_m, state.y_m, state.z_m
        where = f"at x {x:.2f}, y {y:.2f}, z {z:.2f} m"
        if not (isfinite(x) and isfinite(y) and isfinite(z)):
            return "the simulation lost the aircraft: its place is not a number"
        bounds = self._bounds
        if bounds is not None:
            if abs(y) > bounds.half_width_m:
                return f"left the air sideways {where}"
            if z < bounds.floor_m:
                return f"hit the ground {where}"
            if _within(bounds.outline, x, z):
                return f"hit the {bounds.name} {where}"
        return f"left the air that the field describes {where}"


def _at_rest(state: AircraftState) -> AircraftState:
    return state._replace(
        velocity_x_mps=0.0,
        velocity_y_mps=0.0,
        velocity_z_mps=0.0,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    )


def _trim(model: AircraftModel, wind_mps: float) -> Glide:
    """The glide at this horizontal airspeed, or at the slowest that the model flies."""
    slowest = highest_pitch_glide(model)
    return slowest if wind_mps <= slowest.horizontal_mps else glide_at(model, wind_mps)


def _within(outline: Outline, x: float, z: float) -> bool:
    """Whether a place lies inside a polygon: an odd number of edges lie to its right."""
    odd = False
    for (x1, z1), (x2, z2) in zip(outline, outline[1:] + outline[:1], strict=True):
        if (z1 > z) != (z2 > z) and x < x1 + (z - z1) * (x2 - x1) / (z2 - z1):
            odd = not odd
    return odd


# --- from a site file ------------------------------------------------------------------------

Air = JetAir | HillAir | GridAir


def build_field(air: Air, folder: Path | None = None) -> WindField:
    """The wind field of a site's `[air]`; `folder` is that of the site file.

    Errors: `ConfigError`.
    """
    if isinstance(air, JetAir):
        return SlopeJet(air.wind_mps, radians(air.slope_deg))
    if isinstance(air, HillAir):
        return HillField(air.wind_mps, air.radius_m)
    path = Path(air.file) if folder is None else folder / air.file
    try:
        return read_grid(
            path,
            Layout(**asdict(air.layout)),
            reference_wind_mps=air.wind_mps,
            zero_cells=air.zero_cells,
            step_m=air.mesh_step_m,
        )
    except (GridError, ImportError) as error:
        raise ConfigError(f"air.file: {error}") from None


def ground_outline(air: Air) -> Outline | None:
    """Corners (x, z) [m] of the board or the hill in the vertical plane; None: not known."""
    if isinstance(air, JetAir):
        shape = JetShape(slope_rad=radians(air.slope_deg))
        tip = shape.board_length_m * cos(shape.slope_rad)
        return [(0.0, 0.0), (tip, tip * tan(shape.slope_rad)), (tip, 0.0)]
    if isinstance(air, HillAir):
        angles = [pi * i / 90 for i in range(91)]
        return [(air.radius_m * cos(a), air.radius_m * sin(a)) for a in angles]
    return None


def _bounds(air: Air) -> Bounds | None:
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
) -> World:
    """The world of an airframe and a site file.

    turbulence: its intensity where it is not the site's.  field: one that was built before, to
    save the time where many worlds share it.  sensors: what the aircraft carries.
    Errors: `ConfigError`.
    """
    if site.air is None:
        raise ConfigError(f"site {site.site.name}: no [air] table, so there is no wind to fly in")
    if site.start is None:
        raise ConfigError(f"site {site.site.name}: no [start] table, so nowhere to be let go")
    try:
        return World(
            aircraft_model(asdict(airframe.airframe), airframe.model),
            servo_params(airframe.model),
            field if field is not None else build_field(site.air, folder),
            site.frame(),
            site.start,
            seed=seed,
            turbulence=site.air.turbulence.intensity if turbulence is None else turbulence,
            length_scale_m=site.air.turbulence.length_scale_m,
            step_hz=step_hz,
            bounds=_bounds(site.air),
            sensors=sensors,
            aerodynamics=airframe.aerodynamics(),
            ground=site.known_ground(),
        )
    except ValueError as error:
        raise ConfigError(f"{site.site.name}, {airframe.airframe.name}: {error}") from None

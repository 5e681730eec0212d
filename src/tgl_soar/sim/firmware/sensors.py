"""What a real firmware's sensors read in our world: one truth seen by all of them.

    accelerometers, gyros   specific force and rates of the aircraft model (`measure_imu`)
    magnetometer            b = Rᵀ B, B the earth's field at the site by the World Magnetic Model
    barometer               p = p₀ (1 − L h / T₀)^(g / R L), h above mean sea level
    thermometer             T = p / (R ρ): of an air as dense as the one that carries the aircraft
    pitot tube              ½ ρ V², of the pitot's own airspeed (`measure_airspeed`)
    GPS                     the fix of the world's position sensor, late as that is

R FRD → NED.  A firmware's estimator compares them all: a magnetometer of another place, or a
pressure that does not fall as the fix rises, keeps it from aligning.

p₀, T₀, L, g and R are the standard atmosphere's (ISO 2533).  A site without `position.home` is
taken to lie at `SOMEWHERE`.
"""

from __future__ import annotations

import random
from datetime import datetime
from math import cos, radians, sin
from typing import Final, NamedTuple

from tgl_soar.config.site import HomePosition
from tgl_soar.geometry import ned_from_soaring, ned_vector_from_soaring, rotated
from tgl_soar.sim.sensor_messages import SEA_LEVEL_HPA, ZERO_CELSIUS_K, geodetic
from tgl_soar.sim.sensors import (
    MEMS_IMU,
    PITOT,
    AttitudeParams,
    PositionParams,
    Sensors,
    Triple,
    measure_attitude,
    samples_taken,
    sensor_timing,
)
from tgl_soar.sim.world import World
from tgl_soar.types import GRAVITY_MPS2, PositionFix

SOMEWHERE: Final = HomePosition(latitude_deg=51.990, longitude_deg=4.375, altitude_m=0.0)
FIELD_EPOCH: Final = datetime(2025, 1, 1)  # of the coefficients
FIELD_YEAR: Final = 2026.0  # a fixed one, so that flights repeat

SEA_LEVEL_PA: Final = 100.0 * SEA_LEVEL_HPA
SEA_LEVEL_K: Final = 288.15
LAPSE_KPM: Final = 0.0065
GAS_JPKGK: Final = 287.05287
GAUSS_PER_NT: Final = 1e-5

SLOW_HZ: Final = 50.0  # magnetometer, barometer and pitot tube
MAGNETIC_NOISE_GAUSS: Final = 0.0015
PRESSURE_NOISE_PA: Final = 1.0  # 8 cm of height

# A receiver of several constellations under an open sky, but for its slow error of some decimetres:
# that moves the line and the aircraft alike, while flights are scored from the truth.
GNSS = PositionParams(
    rate_hz=10.0,
    delay_s=0.1,
    noise_m=0.05,
    bias_m=0.0,
    velocity_noise_mps=0.05,
    gives_velocity=True,
)


class GpsPlace(NamedTuple):
    """Where a GPS fix is, and how fast it moves."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above mean sea level
    velocity_ned_mps: Triple


class Motion(NamedTuple):
    """The truth, for a firmware whose simulator makes sensors of its own."""

    position_ned_m: Triple
    velocity_ned_mps: Triple
    attitude: tuple[float, float, float, float]  # quaternion, FRD to NED
    airspeed_mps: float


class Readings(NamedTuple):
    """All that the sensors read at one step; None: nothing new."""

    time_s: float
    force_frd_mps2: Triple
    rate_frd_radps: Triple
    magnetic_frd_gauss: Triple | None
    pressure_pa: float | None
    height_m: float  # above mean sea level, by the pressure
    temperature_c: float
    differential_pressure_pa: float | None
    gps: GpsPlace | None
    motion: Motion
    gps_fixed: bool = True  # False: the receiver has no fix, `gps` is its last


def firmware_sensors(step_hz: int, *, pitot: bool = True) -> Sensors:
    """What the world must carry for `FirmwareSensors`: inertial sensors at every step."""
    return Sensors(
        position=GNSS,
        attitude=AttitudeParams(
            rate_hz=float(step_hz),
            delay_s=0.0,
            noise_rad=0.0,
            bias_rad=0.0,
            rate_noise_radps=0.0,
            rate_bias_radps=0.0,
        ),
        imu=MEMS_IMU._replace(rate_hz=float(step_hz)),
        airspeed=PITOT if pitot else None,
    )


class FirmwareSensors:
    """The sensors of one flight; `read` is called once after every step of the world."""

    def __init__(
        self, world: World, home: HomePosition | None, seed: int, *, gps: bool = True
    ) -> None:
        """gps: there are satellites to be seen.

        Errors: ValueError for a step rate that the slow sensors' does not divide.
        """
        self._has_gps = gps
        self.home = SOMEWHERE if home is None else home
        self._world = world
        self._gauss = random.Random(f"{seed}/firmware").gauss
        self._slow = sensor_timing("magnetometer", SLOW_HZ, 0.0, world.step_hz)
        self._field_ned_gauss = earth_field_ned_gauss(self.home)
        self._density_kgpm3 = world.model.air_density_kgpm3
        self._slow_taken = self._pitot_taken = self._fixes_taken = 0

    def read(self) -> Readings:
        """The sensors as they are now."""
        world = self._world
        height_m = self._height_m()
        pressure = pressure_pa(height_m)
        magnetic: Triple | None = None
        measured_pa: float | None = None
        if samples_taken(self._slow, world.steps) > self._slow_taken:
            self._slow_taken = samples_taken(self._slow, world.steps)
            measured_pa = self._gauss(pressure, PRESSURE_NOISE_PA)
            magnetic = self._magnetic()
        differential: float | None = None
        if world.airspeed.sequence > self._pitot_taken:
            self._pitot_taken = world.airspeed.sequence
            differential = 0.5 * self._density_kgpm3 * world.airspeed.airspeed_mps**2
        gps: GpsPlace | None = None
        if self._has_gps and world.position.sequence > self._fixes_taken:
            self._fixes_taken = world.position.sequence
            gps = self._place(world.position)
        imu = world.imu
        return Readings(
            time_s=world.time_s,
            force_frd_mps2=imu.force_frd_mps2,
            rate_frd_radps=imu.rates_frd_radps,
            magnetic_frd_gauss=magnetic,
            pressure_pa=measured_pa,
            height_m=height_m if measured_pa is None else height_of_pressure_m(measured_pa),
            temperature_c=pressure / (GAS_JPKGK * self._density_kgpm3) - ZERO_CELSIUS_K,
            differential_pressure_pa=differential,
            gps=gps,
            motion=self._motion(),
        )

    def _motion(self) -> Motion:
        world, state, none = self._world, self._world.state, (0.0, 0.0, 0.0)
        q = measure_attitude(world.frame, state, 1, world.time_s, none, none)
        velocity = state.velocity_x_mps, state.velocity_y_mps, state.velocity_z_mps
        return Motion(
            ned_from_soaring(world.frame, state.x_m, state.y_m, state.z_m),
            ned_vector_from_soaring(world.frame, *velocity),
            (q.qw, q.qx, q.qy, q.qz),
            world.airspeed_mps,
        )

    def _height_m(self) -> float:
        world, state = self._world, self._world.state
        down_m = ned_from_soaring(world.frame, state.x_m, state.y_m, state.z_m)[2]
        return self.home.altitude_m - down_m

    def _magnetic(self) -> Triple:
        world, none = self._world, (0.0, 0.0, 0.0)
        q = measure_attitude(world.frame, world.state, 1, world.time_s, none, none)
        x, y, z = rotated((q.qw, -q.qx, -q.qy, -q.qz), self._field_ned_gauss)
        noise = MAGNETIC_NOISE_GAUSS
        return self._gauss(x, noise), self._gauss(y, noise), self._gauss(z, noise)

    def _place(self, fix: PositionFix) -> GpsPlace:
        at = geodetic(self.home, fix.north_m, fix.east_m, fix.down_m)
        return GpsPlace(*at, fix.velocity_ned_mps)


def pressure_pa(height_m: float) -> float:
    """Of the standard atmosphere, at a height above mean sea level."""
    ratio = 1.0 - LAPSE_KPM * height_m / SEA_LEVEL_K
    return float(SEA_LEVEL_PA * ratio ** (GRAVITY_MPS2 / (GAS_JPKGK * LAPSE_KPM)))


def height_of_pressure_m(pressure: float) -> float:
    """The inverse of `pressure_pa`."""
    ratio = (pressure / SEA_LEVEL_PA) ** (GAS_JPKGK * LAPSE_KPM / GRAVITY_MPS2)
    return float((1.0 - ratio) * SEA_LEVEL_K / LAPSE_KPM)


def earth_field_ned_gauss(home: HomePosition) -> Triple:
    """The earth's magnetic field, true north, east and down, by the World Magnetic Model.

    Errors: ValueError where the model's package is missing.
    """
    try:
        from pygeomag import GeoMag
    except ImportError:
        raise ValueError(
            "the magnetometer needs the World Magnetic Model: pip install 'tgl_soar[firmware]'"
        ) from None
    field = GeoMag(base_year=FIELD_EPOCH).calculate(
        glat=home.latitude_deg,
        glon=home.longitude_deg,
        alt=home.altitude_m * 1e-3,
        time=FIELD_YEAR,
    )
    declination, inclination = radians(field.d), radians(field.i)
    strength = field.f * GAUSS_PER_NT
    level = strength * cos(inclination)
    return level * cos(declination), level * sin(declination), strength * sin(inclination)

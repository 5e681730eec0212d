"""The autopilot's sensor messages, in SI units and FRD.

| message        | acceleration            | rates             | stamp                |
|----------------|-------------------------|-------------------|----------------------|
| HIGHRES_IMU    | m/s², float             | rad/s, float      | us                   |
| SCALED_IMU 1-3 | mG: steps of 9.8 mm/s²  | mrad/s            | whole ms             |
| RAW_IMU        | by definition no unit; on ArduPilot as SCALED_IMU | us    |

A sample whose accelerations are all exactly zero comes from a sensor that is not there, one
beyond `FORCE_MAX_MPS2` or `RATE_MAX_RADPS` from none that is made: neither is a measurement.

A pitot tube measures a pressure, so an autopilot shows the *equivalent* airspeed, as if the air
had the density of sea level.  The aircraft flies through the air that there is:

    true = equivalent / sqrt(ρ/ρ0),    ρ/ρ0 = (1 - 2.25577e-5 h)^4.2559     (standard atmosphere)
    true = sqrt(2 dp / ρ),             ρ = p / (287.05 (T + 273.15))        (from HIGHRES_IMU)
"""

from __future__ import annotations

from math import sqrt
from struct import Struct
from typing import Final

from tgl_soar.link.messages import (
    ORIENTATION_DOWN,
    QUALITY_INVALID,
    DistanceSensor,
    HighresImu,
    RawImu,
    ScaledImu,
    VfrHud,
)
from tgl_soar.types import NAN, isfinite

MILLI_G_MPS2: Final = 9.80665e-3
FORCE_MAX_MPS2: Final = 400.0  # 40 g
RATE_MAX_RADPS: Final = 80.0
AIRSPEED_MAX_MPS: Final = 150.0
_ACCELERATIONS: Final = 0b111  # HIGHRES_IMU.fields_updated
_GYROS: Final = 0b111000
_DIFFERENTIAL_PRESSURE: Final = 1 << 10
_AIR_GAS_CONSTANT: Final = 287.05  # [J/(kg K)]

_six: Final = Struct("<6f").pack
_single: Final = Struct("<6f").unpack

Triple = tuple[float, float, float]


def imu_of(message: HighresImu | ScaledImu | RawImu) -> tuple[Triple, Triple] | None:
    """Specific force [m/s²] and body rates [rad/s] (NaN: none), or None: no measurement.

    All are numbers of single precision, which the flight log keeps as they are.
    """
    has_rates = True
    if isinstance(message, HighresImu):
        x, y, z = message.xacc, message.yacc, message.zacc
        p, q, r = message.xgyro, message.ygyro, message.zgyro
        if message.fields_updated & _ACCELERATIONS != _ACCELERATIONS:
            return None
        has_rates = message.fields_updated & _GYROS == _GYROS
    elif isinstance(message, ScaledImu):
        m = message  # and n: of one kind each, whose fields native code finds by their place
        x, y, z, p, q, r = _scaled(m.xacc, m.yacc, m.zacc, m.xgyro, m.ygyro, m.zgyro)
    else:
        n = message
        x, y, z, p, q, r = _scaled(n.xacc, n.yacc, n.zacc, n.xgyro, n.ygyro, n.zgyro)
    if not (abs(x) <= FORCE_MAX_MPS2 and abs(y) <= FORCE_MAX_MPS2 and abs(z) <= FORCE_MAX_MPS2):
        return None
    if x == 0.0 and y == 0.0 and z == 0.0:
        return None
    fits = abs(p) <= RATE_MAX_RADPS and abs(q) <= RATE_MAX_RADPS and abs(r) <= RATE_MAX_RADPS
    return (x, y, z), (p, q, r) if has_rates and fits else (NAN, NAN, NAN)


def _scaled(
    x_mg: int, y_mg: int, z_mg: int, p_mrad: int, q_mrad: int, r_mrad: int
) -> tuple[float, float, float, float, float, float]:
    """In m/s² and rad/s, of single precision."""
    mg, mrad = MILLI_G_MPS2, 1e-3
    turns = p_mrad * mrad, q_mrad * mrad, r_mrad * mrad
    x, y, z, p, q, r = _single(_six(x_mg * mg, y_mg * mg, z_mg * mg, *turns))
    return x, y, z, p, q, r


def airspeed_of_pressure(message: HighresImu) -> float | None:
    """True airspeed [m/s] of the differential pressure; None: it brings no new one."""
    if not message.fields_updated & _DIFFERENTIAL_PRESSURE:
        return None
    kelvin = message.temperature + 273.15
    if not kelvin > 0.0:
        return None
    density = 100.0 * message.abs_pressure / (_AIR_GAS_CONSTANT * kelvin)
    if not (0.3 <= density <= 1.8 and isfinite(message.diff_pressure)):
        return None  # no air that is soared in
    return _plausible(sqrt(max(0.0, 200.0 * message.diff_pressure) / density))


def airspeed_of_hud(message: VfrHud) -> float | None:
    """True airspeed [m/s] of the equivalent one that VFR_HUD shows; None: no measurement."""
    return true_airspeed(message.airspeed, message.alt)


def true_airspeed(equivalent_mps: float, altitude_m: float) -> float | None:
    """True airspeed [m/s] of an equivalent one, so high above the sea; None: no measurement.

    Where the altitude is not known it counts as that of the sea.
    """
    height_m = min(max(altitude_m, -500.0), 9000.0) if isfinite(altitude_m) else 0.0
    ratio = (1.0 - 2.25577e-5 * height_m) ** 4.2559
    return _plausible(equivalent_mps / sqrt(ratio))


def range_of(message: DistanceSensor) -> float | None:
    """Distance [m] along the body's third axis; None: no measurement of the ground below.

    A sensor shows what lies beyond its reach at its largest distance or farther, and what is too
    near at its smallest or below: both ends count as beyond.  Whether its variance is known or not
    is the same here: what is wrong with a height over the ground is the ground.
    """
    near, far, here = message.min_distance, message.max_distance, message.current_distance
    if message.orientation != ORIENTATION_DOWN or message.signal_quality == QUALITY_INVALID:
        return None
    return 0.01 * here if here > 0 and near < here < far else None


def _plausible(airspeed_mps: float) -> float | None:
    return airspeed_mps if 0.0 <= airspeed_mps <= AIRSPEED_MAX_MPS else None


def sigma_of(covariance: tuple[float, ...]) -> float:
    """Standard deviation [m] of the worst axis of a pose's covariance; NaN: not known."""
    if len(covariance) < 12:
        return NAN
    worst = max(covariance[0], covariance[6], covariance[11])  # the diagonal: x, y, z
    is_known = isfinite(sum(covariance[i] for i in (0, 6, 11))) and worst > 0.0
    return sqrt(worst) if is_known else NAN

"""An aircraft unlike its file in air unlike its site's: what a controller does not know.

Every figure below is drawn evenly within its range, for each flight by its own seed.  The ranges
are what is left after the aircraft has been identified and the site surveyed; where they come from
stands in docs/theory.md ("What a controller does not know").  `tuning.aircraft` draws
aircraft too: further apart, each with a file of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import radians, sqrt
from typing import Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.air.gusts import BlendedField, ScaledField
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.wind_record import RecordedField
from tgl_soar.analysis.experiments.random_jet import JetRanges, altered_jet
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.site import JetAir, Site
from tgl_soar.sim.sensors import USUAL_SENSORS, Sensors
from tgl_soar.sim.world import World, make_world, site_field

_STREAM: Final = 0xD15  # beside those of sensors and turbulence

Range = tuple[float, float]


class MismatchRanges(NamedTuple):
    """From and to; factors of the file's own unless a unit says otherwise."""

    lift: Range = (0.9, 1.1)
    drag: Range = (0.9, 1.1)
    stall_rad: Range = (-0.026, 0.026)  # added to the angle of attack at which it stalls
    inertia: Range = (0.85, 1.15)
    pitch_effect: Range = (0.9, 1.1)  # of the elevator
    turn_effect: Range = (0.8, 1.2)  # of aileron and rudder
    centre_of_gravity: Range = (-0.02, 0.02)  # in mean chords, aft
    servo_lag: Range = (0.8, 1.25)  # of its rate constant
    late_s: Range = (0.0, 0.0049)  # of every command, beyond what is known: less than a tick
    force_bias: Range = (0.5, 2.0)  # of the accelerometers' usual one
    pressure_bias: Range = (0.0, 3.0)  # of the pitot tube's usual one
    slope_rad: Range = (radians(-1.0), radians(1.0))  # of a board in a jet
    wind: Range = (0.97, 1.03)
    length: Range = (0.67, 1.5)  # of the turbulence
    brake: Range = (0.8, 1.2)  # of all that the brake does
    edge_m: Range = (-0.05, 0.05)  # added to the height of a jet's free edge
    shear_per_m: Range = (-0.03, 0.03)  # of a jet's wind, for each metre of height
    hill_radius: Range = (0.973, 1.027)  # of the flow over a hill, whose ground stays as it is
    hill_growth: Range = (0.0, 1.0 / 7.0)  # d ln U / d ln z of a hill's wind, at its height


RANGES: Final = MismatchRanges()

# Of the attitude and of the origin of positions, on each axis: sensors draw a bias from a normal
# distribution by the flight's seed, here of the standard deviation of an even draw within 2 degrees
# and 1 cm.
ALIGNMENT_RAD: Final = 0.035 / sqrt(3.0)
ORIGIN_M: Final = 0.01 / sqrt(3.0)


class Mismatch(NamedTuple):
    """One draw: the fields of `MismatchRanges`."""

    lift: float
    drag: float
    stall_rad: float
    inertia: float
    pitch_effect: float
    turn_effect: float
    centre_of_gravity: float
    servo_lag: float
    late_s: float
    force_bias: float
    pressure_bias: float
    slope_rad: float
    wind: float
    length: float
    brake: float
    edge_m: float
    shear_per_m: float
    hill_radius: float
    hill_growth: float


AS_FILED: Final = Mismatch(
    lift=1.0,
    drag=1.0,
    stall_rad=0.0,
    inertia=1.0,
    pitch_effect=1.0,
    turn_effect=1.0,
    centre_of_gravity=0.0,
    servo_lag=1.0,
    late_s=0.0,
    force_bias=1.0,
    pressure_bias=1.0,
    slope_rad=0.0,
    wind=1.0,
    length=1.0,
    brake=1.0,
    edge_m=0.0,
    shear_per_m=0.0,
    hill_radius=1.0,
    hill_growth=0.0,
)


def drawn_mismatch(seed: int, already: Iterable[str] = ()) -> Mismatch:
    """Of a flight's seed; already: the fields that an experiment draws by itself, and further from
    what the module is given: these are not drawn a second time."""
    draw = np.random.default_rng((seed, _STREAM))
    drawn = Mismatch._make((float(draw.uniform(low, high)) for low, high in RANGES))
    return drawn._replace(**{name: getattr(AS_FILED, name) for name in already})


def flown_world(
    known: Airframe,
    site: Site,
    seed: int,
    *,
    dispersed: bool,
    flies: Airframe | None = None,
    already: Iterable[str] = (),
    field: WindField | None = None,
    sensors: Sensors = USUAL_SENSORS,
    turbulence: float | None = None,
) -> World:
    """The world of a flight as the files have it or, dispersed, of what is drawn in their place;
    the module is given the files.

    flies: the aircraft that flies, where an experiment has one of its own; already: as of
    `drawn_mismatch`; the others, errors: as of `make_world`.
    """
    airframe = flies or known
    if dispersed:
        field = field if field is not None else site_field(site)
        airframe, site, field, sensors = mismatched(airframe, site, field, sensors, seed, already)
    return make_world(
        airframe,
        site,
        seed=seed,
        turbulence=turbulence,
        field=field,
        sensors=sensors,
        known=known,
    )


def mismatched(
    airframe: Airframe,
    site: Site,
    field: WindField,
    sensors: Sensors,
    seed: int,
    already: Iterable[str] = (),
) -> tuple[Airframe, Site, WindField, Sensors]:
    """What flies in the place of these, as drawn for a seed; already: as of `drawn_mismatch`."""
    drawn = drawn_mismatch(seed, already)
    return (
        flown_airframe(airframe, mismatched_figures(airframe, drawn)),
        mismatched_site(site, drawn),
        mismatched_field(field, site, drawn),
        mismatched_sensors(sensors, drawn),
    )


def mismatched_figures(airframe: Airframe, drawn: Mismatch) -> tuple[tuple[str, float], ...]:
    """The figures of the aircraft that flies, `section.key`, where the file has others.

    Its centre of gravity stays ahead of the neutral point.  Errors: KeyError for a [model] that is
    not complete.
    """
    bench, given = airframe.airframe, airframe.model
    moved = drawn.centre_of_gravity
    lift_slope, lift_0 = given["CL_alpha"] * drawn.lift, given["CL0"] * drawn.lift
    stiffness = min(0.5 * given["Cm_alpha"], given["Cm_alpha"] + moved * lift_slope)
    model = {
        "CL0": lift_0,
        "CL_alpha": lift_slope,
        "CL_elevator": given["CL_elevator"] * drawn.pitch_effect,
        "stall_alpha_rad": given["stall_alpha_rad"] + drawn.stall_rad,
        "CD0": given["CD0"] * drawn.drag,
        "CD_lift": given["CD_lift"] * drawn.drag,
        "Cm0": given["Cm0"] + moved * lift_0,
        "Cm_alpha": stiffness,
        "Cm_elevator": given["Cm_elevator"] * drawn.pitch_effect,
        "CY_rudder": given["CY_rudder"] * drawn.turn_effect,
        "Cl_aileron": given["Cl_aileron"] * drawn.turn_effect,
        "Cn_aileron": given["Cn_aileron"] * drawn.turn_effect,
        "Cn_rudder": given["Cn_rudder"] * drawn.turn_effect,
        "servo_lag_radps": given["servo_lag_radps"] * drawn.servo_lag,
        "servo_delay_s": given["servo_delay_s"] + drawn.late_s,
    }
    for key in ("CL_brake", "CD_brake", "Cm_brake"):
        if key in given:  # not every airframe has one
            model[key] = given[key] * drawn.brake
    inertia = {
        "ixx_kgm2": bench.ixx_kgm2 * drawn.inertia,
        "iyy_kgm2": bench.iyy_kgm2 * drawn.inertia,
        "izz_kgm2": bench.izz_kgm2 * drawn.inertia,
    }
    return (
        *((f"model.{key}", value) for key, value in model.items()),
        *((f"airframe.{key}", value) for key, value in inertia.items()),
    )


def mismatched_sensors(sensors: Sensors, drawn: Mismatch) -> Sensors:
    """The sensors that it carries; a bias is the standard deviation of what a flight draws."""
    imu, airspeed = sensors.imu, sensors.airspeed
    return sensors._replace(
        position=sensors.position._replace(bias_m=max(sensors.position.bias_m, ORIGIN_M)),
        attitude=sensors.attitude._replace(bias_rad=max(sensors.attitude.bias_rad, ALIGNMENT_RAD)),
        imu=imu and imu._replace(force_bias_mps2=imu.force_bias_mps2 * drawn.force_bias),
        airspeed=airspeed
        and airspeed._replace(pressure_bias_pa=airspeed.pressure_bias_pa * drawn.pressure_bias),
    )


def mismatched_field(field: WindField, site: Site, drawn: Mismatch) -> WindField:
    """The mean wind that blows: another wind; in a jet another slope, edge and shear; over a hill
    the flow of another radius, growing with height.

    A board that is tilted in flight is a blend of two slopes already, and keeps them.  What is not
    drawn leaves the field as it is.
    """
    field = _with_other_flow(field, site, drawn)
    return field if drawn.wind == AS_FILED.wind else ScaledField(field, drawn.wind)


def _with_other_flow(field: WindField, site: Site, drawn: Mismatch) -> WindField:
    if isinstance(field, ScaledField):
        return ScaledField(_with_other_flow(field.field, site, drawn), field.factor)
    if isinstance(field, RecordedField):
        return RecordedField(_with_other_flow(field.field, site, drawn), field.record)
    if isinstance(field, BlendedField):
        kept = drawn._replace(slope_rad=AS_FILED.slope_rad)
        first, second = (_with_other_flow(each, site, kept) for each in (field.first, field.second))
        return BlendedField(first, second, field.weight)
    if isinstance(field, HillField):
        return _other_hill(field, drawn)
    jet = (drawn.slope_rad, drawn.edge_m, drawn.shear_per_m)
    as_filed = jet == (AS_FILED.slope_rad, AS_FILED.edge_m, AS_FILED.shear_per_m)
    if as_filed or not (isinstance(field, SlopeJet) and isinstance(site.air, JetAir)):
        return field
    return altered_jet(
        field,
        JetRanges(slope_rad=RANGES.slope_rad, edge_m=RANGES.edge_m),
        slope_rad=drawn.slope_rad,
        edge_m=drawn.edge_m,
        shear_per_m=drawn.shear_per_m,
    )


def _other_hill(field: HillField, drawn: Mismatch) -> HillField:
    if (drawn.hill_radius, drawn.hill_growth) == (AS_FILED.hill_radius, AS_FILED.hill_growth):
        return field
    hill = field.hill
    return HillField(
        wind_mps=hill.wind_mps,
        radius_m=hill.radius_m * drawn.hill_radius,
        growth=drawn.hill_growth,
        ground_radius_m=hill.ground_radius_m,
    )


def mismatched_site(site: Site, drawn: Mismatch) -> Site:
    """Its turbulence with the length that flies; the module is given none of it."""
    assert site.air is not None
    turbulence = msgspec.structs.replace(
        site.air.turbulence, length_scale_m=site.air.turbulence.length_scale_m * drawn.length
    )
    return msgspec.structs.replace(
        site, air=msgspec.structs.replace(site.air, turbulence=turbulence)
    )

"""Aircraft like one, and unlike it: what a set of gains must bear.

Each aircraft is drawn about the airframe file that gains are sought for:

    what its own file would know      short period, lift, drag, inertia, elevator's effect, servo,
                                      latency: as `tgl-soar identify` and preflight measure them
    what no file knows                centre of gravity, a further error of the elevator's effect,
                                      the bias of the attitude

The schedule of gains is given the first, and has to bear the second.  The short period is drawn as
a factor of the airframe's own: 6 to 15 rad/s for the shipped aircraft, whose own is 11.5.

`Ranges()` is for gains that are to serve every aircraft by its file, as the shipped ones do.
Whoever tunes for one aircraft has `ranges_of_one`: there the file is right but for what an
identification leaves open, and no margin is paid for aircraft that are never flown with it.
"""

from __future__ import annotations

from math import radians, sqrt
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict, replace

from tgl_soar.config.airframe import Airframe, Polar
from tgl_soar.config.dynamics import MeasuredDynamics
from tgl_soar.sim.aircraft import AircraftModel, aircraft_model, glide_polar_fit
from tgl_soar.sim.sensors import MEMS_IMU, Sensors

TICK_S: Final = 0.005  # latencies are flown in whole ticks
# The standard deviation of a bias that is drawn evenly from ± 2 degrees.
ATTITUDE_BIAS_RAD: Final = radians(2.0) / sqrt(3.0)


class Ranges(NamedTuple):
    """Within which aircraft are drawn, evenly; factors of the airframe file's own."""

    short_period: tuple[float, float] = (6.0 / 11.5, 15.0 / 11.5)
    lift: tuple[float, float] = (0.7, 1.3)
    drag: tuple[float, float] = (0.7, 1.3)
    inertia: tuple[float, float] = (0.7, 1.3)
    effect: tuple[float, float] = (0.7, 1.3)  # of the elevator, known to the file
    servo_s: tuple[float, float] = (0.015, 0.080)
    latency_s: tuple[float, float] = (0.005, 0.040)
    unknown_effect: tuple[float, float] = (0.7, 1.3)
    # In mean chords: a battery of a tenth of the mass, put in a fifth of a chord away.
    centre_of_gravity: tuple[float, float] = (-0.02, 0.02)


# What the link of one aircraft may be later than measured on the bench: a busier day on it.
SLOWER_LINK_S: Final = 0.010


def ranges_of_one(airframe: Airframe, latency_s: float) -> Ranges:
    """Of one aircraft, whose file was identified.

    latency_s: of the command's way, measured.  The elevator's effect and the centre of gravity are
    drawn as `analysis.experiments.random_aircraft` has them, where the ranges are argued.
    Errors: ValueError for a [model] without a servo.
    """
    lag = airframe.model.get("servo_lag_radps", 0.0)
    if not lag > 0.0:
        raise ValueError("[model] servo_lag_radps: not known, and must be above 0")
    right = (1.0, 1.0)
    return Ranges(
        short_period=right,
        lift=right,
        drag=right,
        inertia=right,
        effect=right,
        servo_s=(1.0 / lag, 1.0 / lag),
        latency_s=(latency_s, latency_s + SLOWER_LINK_S),
        unknown_effect=(0.9, 1.1),
    )


class _Factors(NamedTuple):
    """One draw: the fields of `Ranges`, in their order."""

    short_period: float
    lift: float
    drag: float
    inertia: float
    effect: float
    servo_s: float
    latency_s: float
    unknown_effect: float
    centre_of_gravity: float


class Drawn(NamedTuple):
    """One aircraft."""

    known: Airframe  # with the file that it would have
    latency_s: float  # from the tick to the servo; known
    true: AircraftModel
    sensors: Sensors  # with accelerometers; they may go unused


def drawn_aircraft(airframe: Airframe, ranges: Ranges, seed: tuple[int, ...]) -> Drawn:
    """The aircraft of a seed.

    Errors: ValueError for a [model] that is not complete, or does not glide.
    """
    draw = np.random.default_rng(seed)
    factor = _Factors._make((draw.uniform(low, high) for low, high in ranges))
    bench = airframe.airframe
    turned = factor.inertia
    bench = replace(
        bench,
        ixx_kgm2=bench.ixx_kgm2 * turned,
        iyy_kgm2=bench.iyy_kgm2 * turned,
        izz_kgm2=bench.izz_kgm2 * turned,
    )
    given = airframe.model
    aircraft_model(asdict(bench), given)  # complete, or it says what is missing
    table = {
        **given,
        "CL_alpha": given["CL_alpha"] * factor.lift,
        "CL0": given["CL0"] * factor.lift,
        "CD0": given["CD0"] * factor.drag,
        "CD_lift": given["CD_lift"] * factor.drag,
        "Cm_elevator": given["Cm_elevator"] * factor.effect,
        "CL_elevator": given["CL_elevator"] * factor.effect,
        "servo_lag_radps": 1.0 / factor.servo_s,
        "servo_delay_s": 0.0,
    }
    table.update(_stiffness(airframe, replace(airframe, airframe=bench, model=table), factor))
    table.update(_trimmed_as(given, table))
    model = aircraft_model(asdict(bench), table)
    # Its best glide is at the airframe's own speed: drag's two parts are drawn as one.
    fit = glide_polar_fit(model, airframe.polar.speed_max_mps)
    polar = Polar(
        c0=fit.polar.c0,
        c1=fit.polar.c1,
        c2=fit.polar.c2,
        c3=fit.polar.c3,
        speed_min_mps=fit.polar.speed_min_mps,
        speed_max_mps=fit.polar.speed_max_mps,
    )
    known = replace(airframe, airframe=bench, model=table, polar=polar, dynamics=MeasuredDynamics())
    moved = factor.centre_of_gravity
    true = model._replace(
        Cm_alpha=min(0.5 * model.Cm_alpha, model.Cm_alpha + moved * model.CL_alpha),
        Cm0=model.Cm0 + moved * model.CL0,
        Cm_elevator=model.Cm_elevator * factor.unknown_effect,
    )
    plain = Sensors()
    sensors = Sensors(imu=MEMS_IMU, attitude=plain.attitude._replace(bias_rad=ATTITUDE_BIAS_RAD))
    latency = max(1, round(factor.latency_s / TICK_S)) * TICK_S
    return Drawn(known=known, latency_s=latency, true=true, sensors=sensors)


def _stiffness(nominal: Airframe, changed: Airframe, factor: _Factors) -> dict[str, float]:
    """C_mα and C_mq that give the changed aircraft its short period, damped as the nominal one."""
    own = replace(nominal, dynamics=MeasuredDynamics()).all_parameters()
    try:
        wanted, damping = own["DYN_FREQ"] * factor.short_period, own["DYN_DAMP"]
    except KeyError:
        raise ValueError("[model] has no short period: Cm_alpha, Cm_q or CL_alpha") from None
    speed = own["DYN_SPEED"]
    bench, model = changed.airframe, changed.model
    force = 0.5 * model["air_density_kgpm3"] * speed * speed * bench.wing_area_m2
    turning = force * bench.chord_m / bench.iyy_kgm2
    lift = force * model["CL_alpha"] / (bench.mass_kg * speed)
    damped = lift - 2.0 * damping * wanted  # M_q, negative unless lift alone damps more
    damped = min(damped, -0.1 * wanted)
    return {
        "Cm_q": damped * 2.0 * speed / (turning * bench.chord_m),
        "Cm_alpha": -(wanted * wanted + damped * lift) / turning,
    }


def _trimmed_as(given: dict[str, float], table: dict[str, float]) -> dict[str, float]:
    """C_m0 that leaves the elevator neutral at the lift at which it is neutral now: trimmed on the
    ground, as any aircraft is before it flies."""
    neutral = -given["Cm0"] / given["Cm_alpha"]  # the angle of attack
    lift = given["CL0"] + given["CL_alpha"] * neutral
    now = (lift - table["CL0"]) / table["CL_alpha"]
    return {"Cm0": -table["Cm_alpha"] * now}

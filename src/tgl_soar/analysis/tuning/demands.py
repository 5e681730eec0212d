"""What gains are asked for, and what a set of them gives: on the linear model.

    margin     the disk margin of the worse break, least of all demands: a grid of speed, lean and
               latency on the airframe itself, and drawn aircraft near the usual speed and lean
    e_rho      standard deviation in gusts, root of the mean square over three speeds at the
               reference lean, at the airframe's own latency
    activity   of the elevator, likewise

With accelerometers and without are two sets of gains, and two questions: each is asked alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, radians, sqrt
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict

from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import activity, close_loop, disk_margin
from tgl_soar.analysis.linear_plant import Condition, Gusts, Plant, linear_plant
from tgl_soar.analysis.tuning.aircraft import Ranges, drawn_aircraft
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.found_gains import INERTIAL
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import aircraft_model, highest_pitch_glide
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params

# As fractions of the best glide's speed: 7.6, 9.25 and 14 m/s on the shipped aircraft.
SLOWEST, FASTEST = 0.82, 1.51
USUAL: Final = (0.92, 1.15)  # where it soars in a tunnel and on a hill
# Coarser than a table of margins wants: a peak of |S - 1/2| is a few of these wide.
FREQUENCIES_RADPS: Final = np.geomspace(0.5, 200.0, 60)
# What aircraft are drawn for: none serves twice.
FOR_SEARCH, FOR_CHOICE, FOR_JUDGING = 0, 1, 2
_HERE: Final = SoaringFrame(0.0, 0.0, 0.0, 0.0)


class Demands(NamedTuple):
    """What is asked of gains."""

    airframe: Airframe
    values: ParameterSet  # of airframe and site; gains anchored to this airframe
    ranges: Ranges = Ranges()
    aircraft: int = 6  # drawn
    seed: int = 1
    grid: int = 3  # speeds, leans and latencies, each
    turbulence: float = 0.03


class Given(NamedTuple):
    """What a set of gains gives."""

    alpha: float  # least disk margin; 0: unstable somewhere
    e_rho_m: float  # inf: unstable
    elevator: float
    worst: str  # where the margin is least


class DemandedPlace(NamedTuple):
    """One condition, with what the schedule knows there."""

    plant: Plant
    known: Mapping[str, float]  # parameters
    name: str


class Places(NamedTuple):
    """Where one set of gains is asked for what."""

    margin: tuple[DemandedPlace, ...]
    gusts: tuple[DemandedPlace, ...]
    turbulence: Gusts


def places_of(demands: Demands, kind: str) -> Places:
    """All of a kind.

    Errors: ValueError for an airframe whose [model] is not complete, or does not glide so.
    """
    airframe, values = demands.airframe, demands.values
    best = values["DYN_BEST"]
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    slowest = max(SLOWEST * best, 1.001 * highest_pitch_glide(model).horizontal_mps)
    own = values["CMD_DELAY"]
    late = demands.ranges.latency_s
    leans = (values["TGL_LEAN_MIN"], values["RHO_LEAN"], values["TGL_LEAN_MAX"])
    margin = [
        _place(airframe, values, kind, speed, lean, delay)
        for speed in _few((slowest, best, FASTEST * best), demands.grid)
        for lean in _few(leans, demands.grid)
        for delay in _few((min(late[0], own), own, max(late[1], own)), demands.grid)
    ]
    margin += [
        drawn_place(demands, kind, (demands.seed, FOR_SEARCH, i)) for i in range(demands.aircraft)
    ]
    gusts = [
        _place(airframe, values, kind, factor * best, values["RHO_LEAN"], own)
        for factor in (USUAL[0], 1.0, USUAL[1])
    ]
    return Places(tuple(margin), tuple(gusts), Gusts(demands.turbulence, best))


def drawn_place(demands: Demands, kind: str, seed: tuple[int, ...]) -> DemandedPlace:
    """A drawn aircraft with its own file, at a speed and a lean near the usual ones."""
    drawn = drawn_aircraft(demands.airframe, demands.ranges, seed)
    draw = np.random.default_rng((*seed, 1))
    known = drawn.known.all_parameters()
    dynamics = {name: value for name, value in known.items() if name.startswith("DYN_")}
    values = demands.values.changed(dynamics)
    lean = demands.values["RHO_LEAN"] * draw.uniform(0.67, 2.0)  # 10 to 30 degrees about 15
    model = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
    slowest = 1.001 * highest_pitch_glide(model).horizontal_mps
    speed = max(slowest, values["DYN_BEST"] * draw.uniform(*USUAL))
    place = _place(drawn.known, values, kind, speed, lean, drawn.latency_s)
    return place._replace(known={**dynamics, **place.known}, name=f"aircraft {seed}, {place.name}")


def _few(choices: tuple[float, float, float], count: int) -> tuple[float, ...]:
    """The middle one, both ends, or all."""
    return {1: choices[1:2], 2: choices[::2]}.get(count, choices)


def _place(
    airframe: Airframe,
    values: ParameterSet,
    kind: str,
    speed_mps: float,
    lean_deg: float,
    delay_s: float,
) -> DemandedPlace:
    lean_deg = min(values["TGL_LEAN_MAX"], max(values["TGL_LEAN_MIN"], lean_deg))
    condition = Condition(
        model=aircraft_model(asdict(airframe.airframe), airframe.model),
        servo=servo_params(airframe.model),
        speed_mps=speed_mps,
        lean_rad=radians(lean_deg),
        sensors=Sensors(imu=MEMS_IMU) if kind == INERTIAL else USUAL_SENSORS,
        command_delay_s=delay_s,
    )
    gusts = Gusts(1.0, values["DYN_BEST"])  # of what size does not matter to the margin
    return DemandedPlace(
        plant=linear_plant(condition, gusts),
        known={"CMD_DELAY": delay_s, "TGL_LEAN": lean_deg},
        name=f"{speed_mps:.1f} m/s, lean {lean_deg:.0f} deg, {1e3 * delay_s:.3g} ms, {kind}",
    )


def given_by(places: Places, values: ParameterSet) -> Given:
    """What these values give on all demands of a kind."""
    alpha, worst = inf, ""
    for place in places.margin:
        here = place_margin(place, values)
        if here < alpha:
            alpha, worst = here, place.name
    squares = [0.0, 0.0]
    for place in places.gusts:
        try:
            found = activity(_laws(place, values), place.plant.condition, places.turbulence)
        except ValueError:  # unstable
            return Given(alpha=0.0, e_rho_m=inf, elevator=inf, worst=place.name)
        squares[0] += found.e_rho_m**2 / len(places.gusts)
        squares[1] += found.elevator**2 / len(places.gusts)
    return Given(alpha=alpha, e_rho_m=sqrt(squares[0]), elevator=sqrt(squares[1]), worst=worst)


def place_margin(place: DemandedPlace, values: ParameterSet) -> float:
    """The disk margin of the worse break at a place."""
    controller = linear_controller(_laws(place, values), place.plant.condition)
    return disk_margin(close_loop(place.plant, controller), FREQUENCIES_RADPS)


def _laws(place: DemandedPlace, values: ParameterSet) -> Laws:
    return laws_from(values.changed(place.known), _HERE)

"""`command_delay` and `dispersed`: aircraft and links that are not those of the files.

A command that comes later than the module knows costs phase at the crossover of both loops.  An
aircraft that is not its file's has another short period, another elevator, another servo, and
glides elsewhere.  Both are judged at each place by how many flights last; places are never pooled,
because the slowest, nearest to the stall, loses first.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from random import Random
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import asdict

from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.campaign import wilson
from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    ScenarioJob,
    flown_airframe,
    rms,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import PreparedScenario, Scenario, SensorSpec, prepare
from tgl_soar.config.airframe import Airframe
from tgl_soar.control.envelope import clearance
from tgl_soar.sim.aircraft import aircraft_model, glide_at, glide_polar

SENSORS: Final = {"without": SensorSpec(), "with": SensorSpec(imu=True)}  # accelerometers
DELAYS_S: Final = (0.0, 0.010, 0.020, 0.030)  # what an unmeasured telemetry link may add
DELAY_TURBULENCE: Final = 0.03
ROUGHNESSES: Final = (0.03, 0.05)
AIRCRAFT: Final = 48
# At 3 % the wing stays a standard deviation of gusts clear of the stall: a loss is the loop's, and
# 48 flights without one show a share of 93 % at 95 % confidence. At 5 % gusts alone reach the
# stall now and then.
LEAST_SURVIVORS: Final = {0.03: 0.99, 0.05: 0.90}

# How far an aircraft may be from its file.
SHORT_PERIOD_RADPS: Final = (6.0, 15.0)
WITHIN: Final = 0.30  # of lift, drag, inertia, effectiveness: textbook estimates from geometry
SERVO_S: Final = (0.015, 0.080)
REFERENCE_MPS: Final = 8.5  # at which the short period is meant
DAMPING: Final = 0.75  # of it, as the file's
START_M: Final = 0.3  # downstream of where it hovers by itself, as every scenario starts
CLEAR_OF_STALL_RAD: Final = 0.035  # two degrees: twice the stall's width


class PlaceScore(NamedTuple):
    """All flights of one kind at one place."""

    place: str
    flights: int
    survived: int
    rms_e_rho_m: float  # of those that were scored; NaN: none
    rms_y_m: float
    rms_bank_rad: float

    @property
    def share(self) -> float:
        """That lasted."""
        return self.survived / self.flights


def score_place(flights: Sequence[FlownScenario], place: str) -> PlaceScore:
    """Count who lasted; measure all that was flown on the line, lost flights included."""
    legs = [leg for flight in flights for leg in flight.legs]
    return PlaceScore(
        place=place,
        flights=len(flights),
        survived=sum(flight.survived for flight in flights),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs),
        rms_y_m=rms(leg.rms_y_m for leg in legs),
        rms_bank_rad=rms(leg.rms_bank_rad for leg in legs),
    )


def survival_claim(text: str, scores: Sequence[PlaceScore], least: float) -> Claim:
    """Enough of them lasted, at each place."""
    return Claim(
        text,
        bool(scores) and all(s.share >= least for s in scores),
        ", ".join(f"{s.survived} of {s.flights} at {s.place}" for s in scores),
    )


COLUMNS: Final = (
    "place", "flown to the end", "95 % interval", "rms e_rho [cm]", "rms y [cm]", "rms bank [°]",
)  # fmt: skip


def _cells(s: PlaceScore) -> tuple[str, ...]:
    low, high = wilson(s.survived, s.flights)
    lengths = (100 * s.rms_e_rho_m, 100 * s.rms_y_m, degrees(s.rms_bank_rad))
    return (
        s.place,
        f"{s.survived} of {s.flights}",
        f"{100 * low:.0f} to {100 * high:.0f} %",
        *("–" if value != value else f"{value:.2f}" for value in lengths),
    )


def _fly(
    context: Context, jobs: dict[Any, list[ScenarioJob]], places: dict[Any, str]
) -> dict[Any, PlaceScore]:
    flown = iter(context.fly_jobs([job for each in jobs.values() for job in each]))
    return {
        key: score_place([next(flown) for _ in each], places[key]) for key, each in jobs.items()
    }


def _at(scenario: Scenario, place: str, imu: str, turbulence: float) -> Scenario:
    here = msgspec.structs.replace(scenario, first_line=place, sensors=SENSORS[imu])
    return with_turbulence(here, turbulence)


# --- command_delay --------------------------------------------------------------------------------


def command_delay(context: Context) -> Result:
    """The same flights with a link that is later than the module knows, and with one it knows."""
    scenario = context.scenario("command_delay")
    base = prepare(scenario)
    places = list(scenario.lines)
    delays = DELAYS_S[:: len(DELAYS_S) - 1] if context.quick else DELAYS_S
    known_s = base.values["CMD_DELAY"]
    servo_s = base.airframe.model["servo_delay_s"]
    jobs: dict[Any, list[ScenarioJob]] = {}
    for imu in SENSORS:
        for known in ("unknown", "known"):
            for late in delays:
                if late == 0.0 and known == "known":
                    continue
                for place in places:
                    here = _at(scenario, place, imu, DELAY_TURBULENCE)
                    if known == "known":
                        parameters = {**here.parameters, "CMD_DELAY": known_s + late}
                        here = msgspec.structs.replace(here, parameters=parameters)
                    figures = (("model.servo_delay_s", servo_s + late),)
                    jobs[imu, known, late, place] = [
                        ScenarioJob(here, seed, figures) for seed in scenario.seeds
                    ]
    # Plain: another delay is another delay line, for which all would be compiled once more.
    flown = iter(context.flyer.fly([job for each in jobs.values() for job in each]))
    scores = {key: score_place([next(flown) for _ in each], key[3]) for key, each in jobs.items()}
    return Result(
        "command_delay",
        scenario.title,
        f"Still lines through the places {', '.join(places)} at {100 * DELAY_TURBULENCE:g} % of"
        " turbulence; between the tick and the servo a delay that the module does not know, or that"
        f" `CMD_DELAY` states. The seconds are those beyond the {1e3 * known_s:g} ms that the"
        " shipped value states.",
        tuple(
            survival_claim(
                f"no flight is lost where the command comes {1e3 * late:g} ms later,"
                f" {known} to the module ({imu} accelerometers)",
                [s for key, s in scores.items() if key[:3] == (imu, known, late)],
                1.0,
            )
            for imu, known, late in dict.fromkeys(key[:3] for key in scores)
        ),
        "",
        (
            Table(
                "",
                ("accelerometers", "later by [ms]", "the delay is", *COLUMNS),
                tuple(
                    (imu, f"{1e3 * late:g}", known, *_cells(s))
                    for (imu, known, late, _), s in scores.items()
                ),
            ),
        ),
        {", ".join(map(str, key)): s._asdict() for key, s in scores.items()},
        (),
        ("command_delay",),
        tuple(scenario.seeds),
    )


# --- dispersed ------------------------------------------------------------------------------------


def drawn_figures(airframe: Airframe, random: Random) -> tuple[tuple[str, float], ...]:
    """An aircraft that is not its file's, evenly drawn; `flown_airframe` makes it.

    Cm_α and Cm_q follow from the short period and its damping (config/dynamics.py has the
    formulas): Cm_q first, from 2 ζ ω = L' − D', then Cm_α from ω² = −M' − D' L'.
    """

    def about() -> float:
        return random.uniform(1.0 - WITHIN, 1.0 + WITHIN)

    model, body = airframe.model, airframe.airframe
    lift, drag, inertia, effect = about(), about(), about(), about()
    short_period = random.uniform(*SHORT_PERIOD_RADPS)
    servo_s = random.uniform(*SERVO_S)
    lift_slope = model["CL_alpha"] * lift
    iyy_kgm2 = body.iyy_kgm2 * inertia
    pressure = 0.5 * model["air_density_kgpm3"] * REFERENCE_MPS**2
    force = pressure * body.wing_area_m2
    turning = force * body.chord_m / iyy_kgm2
    lifting = force * lift_slope / (body.mass_kg * REFERENCE_MPS)
    damped = lifting - 2.0 * DAMPING * short_period
    stiff = -(short_period**2) - damped * lifting
    return (
        ("airframe.iyy_kgm2", iyy_kgm2),
        ("model.CL_alpha", lift_slope),
        ("model.CD0", model["CD0"] * drag),
        ("model.CD_lift", model["CD_lift"] * drag),
        # Trimmed by its pilot: neutral elevator holds the incidence that the file's aircraft has.
        ("model.Cm0", model["Cm0"] * stiff / turning / model["Cm_alpha"]),
        ("model.Cm_alpha", stiff / turning),
        ("model.Cm_q", damped / turning * 2.0 * REFERENCE_MPS / body.chord_m),
        ("model.Cm_elevator", model["Cm_elevator"] * effect),
        ("model.servo_lag_radps", 1.0 / servo_s),
    )


def hovers_at(
    prepared: PreparedScenario, figures: Sequence[tuple[str, float]], place: str
) -> tuple[float, float] | None:
    """Where a steady glide holds this aircraft on the line: x, z [m].

    None: nowhere that is clear of stall, ground and fence.
    """
    airframe = flown_airframe(prepared.airframe, figures)
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    try:
        polar = glide_polar(model)
        at = stable_crossing(prepared.field, polar, prepared.lines[place].target)
        if at is None:
            return None
        alpha_rad = glide_at(model, at.wind_mps).alpha_rad
    except ValueError:  # no such glide
        return None
    values = prepared.values
    x, z = at.x_m, at.z_m
    inside = values["FENCE_X_MIN"] < x < values["FENCE_X_MAX"] and z < values["FENCE_Z_MAX"]
    clear = clearance(prepared.site.known_ground(), x, z) > 2.0 * values["CLEAR_MIN"]
    unstalled = alpha_rad < model.stall_alpha_rad - CLEAR_OF_STALL_RAD
    return (x, z) if inside and clear and unstalled else None


class DrawnAircraft(NamedTuple):
    """An aircraft that is not its file's, and where it hovers."""

    figures: tuple[tuple[str, float], ...]
    x_m: float
    z_m: float


def draw_aircraft(
    prepared: PreparedScenario, place: str, count: int
) -> tuple[list[DrawnAircraft], int]:
    """So many that can hover there, and how many were drawn for them."""
    random = Random(f"dispersed/{place}")
    found: list[DrawnAircraft] = []
    drawn = 0
    while len(found) < count:
        figures = drawn_figures(prepared.airframe, random)
        drawn += 1
        at = hovers_at(prepared, figures, place)
        if at is not None:
            found.append(DrawnAircraft(figures, *at))
        if drawn >= 100 * count:
            raise ValueError(f"place {place}: {len(found)} of {drawn} aircraft can hover there")
    return found, drawn


def dispersed(context: Context) -> Result:
    """Aircraft that are not their file's, at each place."""
    scenario = context.scenario("dispersed")
    base = prepare(scenario)
    places = list(scenario.lines)
    roughnesses = ROUGHNESSES[:1] if context.quick else ROUGHNESSES
    drawn = {
        place: draw_aircraft(base, place, 2 if context.quick else AIRCRAFT) for place in places
    }
    jobs = {
        (imu, rough, place): [
            ScenarioJob(
                _at(scenario, place, imu, rough), seed, one.figures, (one.x_m + START_M, one.z_m)
            )
            for seed, one in enumerate(drawn[place][0], start=1)
        ]
        for imu in SENSORS
        for rough in roughnesses
        for place in places
    }
    scores = _fly(context, jobs, {key: key[2] for key in jobs})
    return Result(
        "dispersed",
        scenario.title,
        "The module goes by the airframe file; the aircraft that flies has a short period of"
        f" {SHORT_PERIOD_RADPS[0]:g} to {SHORT_PERIOD_RADPS[1]:g} rad/s at {REFERENCE_MPS:g} m/s,"
        f" lift, drag, inertia and elevator's effect within ± {100 * WITHIN:g} %, and a servo lag"
        f" of {1e3 * SERVO_S[0]:g} to {1e3 * SERVO_S[1]:g} ms, all evenly drawn. An aircraft whose"
        " steady glide does not hold it on the line, two degrees clear of the stall and clear of"
        " ground and fence, is drawn again: no law could keep it there. Drawn for the"
        f" {len(drawn[places[0]][0])} flown at each place: "
        + ", ".join(f"{count} at {place}" for place, (_, count) in drawn.items())
        + ".",
        tuple(
            survival_claim(
                f"at {100 * rough:g} % of turbulence {100 * LEAST_SURVIVORS[rough]:g} % or more"
                f" last at each place ({imu} accelerometers)",
                [s for key, s in scores.items() if key[:2] == (imu, rough)],
                LEAST_SURVIVORS[rough],
            )
            for imu, rough in dict.fromkeys(key[:2] for key in scores)
        ),
        "",
        (
            Table(
                "",
                ("accelerometers", "turbulence", *COLUMNS),
                tuple(
                    (imu, f"{100 * rough:g} %", *_cells(s)) for (imu, rough, _), s in scores.items()
                ),
            ),
        ),
        {", ".join(map(str, key)): s._asdict() for key, s in scores.items()},
        (),
        ("dispersed",),
        (1, len(drawn[places[0]][0])),
    )

"""`unseen`: the laws on an aircraft and in air that no gain was found on, beside a plain PID.

The aircraft of `config/scenarios/unseen` has a short period of 6.6 rad/s where gains were found on
11.5, a servo of 30 ms in place of 18.5, and a stall of its own; the air is that of another jet and
another board, with gusts that roll.  The module is given its airframe file, and seeks gains for it.

The plain PID is the paper's, with what the module lacks: gains that were sought for this very
aircraft (the least e_rho on the linear model at leans of 15 and 23 degrees with a disk margin of
0.5), flown as they stand and without accelerometers, and nothing that ends a flight: no fence, no
clearance, no forecast.  It flies until it hits the board, the floor or a wall.  The module's
flights end where it hands over, too.  Same seeds, same gusts.  What is not known to the airframe
file: commands that come later, a slower servo, and a gain that is off by a factor.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import sqrt
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import LINE_GAINS
from tgl_soar.analysis.experiments.random_aircraft import flown_world
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import Scenario, prepare
from tgl_soar.analysis.tuning.flights import DrawnFlight, fly_late, fly_whole
from tgl_soar.config.parameters import ParameterSet

WITH, WITHOUT, PLAIN = "with accelerometers", "without", "plain PID"
PILOTS: Final = (WITH, WITHOUT, PLAIN)
E_RHO_OF_PLAIN: Final = 0.5  # with accelerometers: what late fixes cost a velocity
ABC: Final = ("a", "b", "c")
LINK_S: Final = 0.005  # the 7.5 ms of `CMD_DELAY`, in whole ticks
PLAIN_GAINS: Final = {
    "RHO_SPEED": 0.0,
    "RHO_P": 0.71,
    "RHO_I": 0.21,
    "RHO_D": 0.246,
    "RHO_D_FILT": 30.0,
    "ELE_P": 7.25,
    "ELE_I": 4.35,
    "ELE_D": 0.70,
}
NOTHING_ENDS: Final = {
    "CLEAR_MIN": 0.0,
    "FENCE_X_MIN": -5000.0,
    "FENCE_X_MAX": 5000.0,
    "FENCE_Y_MAX": 5000.0,
    "FENCE_Z_MIN": -1000.0,
    "FENCE_Z_MAX": 5000.0,
    "FC_ACT": 0.0,
    "ALPHA_MAX": 45.0,
    "SPEED_MIN": 0.0,
    "SINK_MAX": 50.0,
    "CAPTURE_MAX": 10.0,
    "TILT_MAX": 80.0,
}


class UnseenRow(NamedTuple):
    """What is flown by all three."""

    name: str
    lean_deg: float
    turbulence: float
    places: tuple[str, ...] = ABC
    seeds: int = 6  # of each place
    duration_s: float = 30.0
    late_s: float = 0.0  # every command, beyond what the module knows
    servo_s: float = 0.0  # in place of the file's 30 ms; 0: those
    outer: float = 1.0  # factor of the outer loop's gains
    site: str = ""  # beside the scenario's own site; "": that
    speed_ratio: float = 0.0  # of the place, in place of the scenario's; 0: that


ROWS: Final = (
    UnseenRow(name="lean 23°, 3 %", lean_deg=23.0, turbulence=0.03, seeds=32, duration_s=60.0),
    UnseenRow(name="lean 23°, 5 %", lean_deg=23.0, turbulence=0.05, seeds=32, duration_s=60.0),
    UnseenRow(name="lean 15°, 5 %", lean_deg=15.0, turbulence=0.05, seeds=32, duration_s=60.0),
    UnseenRow(name="lean 35°, 1 %", lean_deg=35.0, turbulence=0.01, seeds=8),
    UnseenRow(name="lean 40°, 1 %", lean_deg=40.0, turbulence=0.01, seeds=8),
    UnseenRow(name="lean 45°, 1 %", lean_deg=45.0, turbulence=0.01, seeds=8),
    UnseenRow(name="lean 15°, 3 %, 10 ms later", lean_deg=15.0, turbulence=0.03, late_s=0.010),
    UnseenRow(name="lean 15°, 3 %, 20 ms later", lean_deg=15.0, turbulence=0.03, late_s=0.020),
    UnseenRow(name="lean 15°, 3 %, 30 ms later", lean_deg=15.0, turbulence=0.03, late_s=0.030),
    UnseenRow(name="lean 15°, 3 %, servo of 80 ms", lean_deg=15.0, turbulence=0.03, servo_s=0.080),
    UnseenRow(name="lean 23°, 3 %, outer gain × 1.4", lean_deg=23.0, turbulence=0.03, outer=1.4),
    UnseenRow(name="lean 23°, 3 %, outer gain × 1.8", lean_deg=23.0, turbulence=0.03, outer=1.8),
    UnseenRow(
        name="lean 15°, 1 %, fast",
        lean_deg=15.0,
        turbulence=0.01,
        places=("c",),
        seeds=8,
        site="faster.toml",
        speed_ratio=1.04,
    ),
    UnseenRow(
        name="lean 15°, 1 %, slow",
        lean_deg=15.0,
        turbulence=0.01,
        places=("a",),
        seeds=8,
        speed_ratio=0.87,
    ),
)


class UnseenJob(NamedTuple):
    """One flight."""

    scenario: Scenario
    row: UnseenRow
    pilot: str
    place: str
    seed: int
    dispersed: bool = False  # another aircraft than its file's, in other air than the site's


class UnseenScore(NamedTuple):
    """All flights of one pilot in a row."""

    up: dict[str, int]  # by place
    flights: int  # at each place
    rms_e_rho_m: float  # of all, the lost ones as far as they flew
    rms_y_m: float
    causes: tuple[tuple[str, int], ...]

    @property
    def lasted(self) -> int:
        """At all places together."""
        return sum(self.up.values())


def pilots_values(values: ParameterSet, pilot: str, outer: float) -> ParameterSet:
    """The parameters that a pilot flies with.  Errors: `ParameterError`."""
    changed = {"EST_IMU": 1.0 if pilot == WITH else 0.0}
    if pilot == PLAIN:
        changed |= {**PLAIN_GAINS, **NOTHING_ENDS}
    values = values.changed(changed)
    return values.changed({name: values[name] * outer for name in LINE_GAINS})


def scenario_of(job: UnseenJob) -> Scenario:
    """The scenario of one flight."""
    row, of = job.row, job.scenario
    line = msgspec.structs.replace(of.lines[job.place], lean_deg=row.lean_deg)
    if row.speed_ratio:
        line = msgspec.structs.replace(line, speed_ratio=row.speed_ratio)
    scenario = msgspec.structs.replace(
        with_turbulence(of, row.turbulence), lines={job.place: line}, first_line=job.place
    )
    if row.site:
        site = str(Path(of.site or "").with_name(row.site))
        scenario = msgspec.structs.replace(scenario, site=site)
    return scenario


def fly_unseen(job: UnseenJob) -> DrawnFlight:
    """One flight.  Errors: `ConfigError`."""
    row = job.row
    scenario = scenario_of(job)
    prepared = prepare(scenario)
    airframe = prepared.airframe
    model = dict(airframe.model)
    if row.servo_s:
        model["servo_lag_radps"] = 1.0 / row.servo_s
    if not row.late_s:
        model["servo_delay_s"] += LINK_S  # the same to the aircraft, and to be flown as a whole
    airframe = msgspec.structs.replace(airframe, model=model)
    world = flown_world(
        prepared.airframe,
        prepared.site,
        job.seed,
        dispersed=job.dispersed,
        flies=airframe,
        field=prepared.field,
        sensors=scenario.sensors.as_sensors(),
    )
    values = pilots_values(prepared.values, job.pilot, row.outer)
    if not row.late_s:
        return fly_whole(world, job.seed, values, row.duration_s)
    return fly_late(world, job.seed, values, LINK_S + row.late_s, row.duration_s)


def score_unseen(flown: dict[str, list[DrawnFlight]]) -> UnseenScore:
    """Flights by place, each place with as many."""
    every = [flight for flights in flown.values() for flight in flights]
    causes = Counter(flight.ended.split(" at x ")[0] for flight in every if not flight.up)
    return UnseenScore(
        up={place: sum(flight.up for flight in flights) for place, flights in flown.items()},
        flights=len(every) // len(flown),
        rms_e_rho_m=_rms([flight.rms_e_rho_m for flight in every]),
        rms_y_m=_rms([flight.rms_y_m for flight in every]),
        causes=tuple(causes.most_common()),
    )


def _rms(values: Sequence[float]) -> float:
    return sqrt(sum(value**2 for value in values) / len(values))


def fly_rows(
    context: Context,
    rows: Sequence[UnseenRow],
    pilots: Sequence[str] = PILOTS,
    seeds: int | None = None,
) -> dict[tuple[str, str], UnseenScore]:
    """By row's name and pilot.  seeds: of each place, if fewer than the row has."""
    scenario = context.scenario("unseen")
    first = scenario.seeds[0]

    def seeds_of(row: UnseenRow) -> range:
        return range(first, first + (row.seeds if seeds is None else min(seeds, row.seeds)))

    jobs = [
        UnseenJob(scenario=scenario, row=row, pilot=pilot, place=place, seed=seed)
        for row in rows
        for pilot in pilots
        for place in row.places
        for seed in seeds_of(row)
    ]
    flown = iter(context.each(fly_unseen, jobs, compiled=True))
    return {
        (row.name, pilot): score_unseen(
            {place: [next(flown) for _ in seeds_of(row)] for place in row.places}
        )
        for row in rows
        for pilot in pilots
    }


def unseen(context: Context) -> Result:
    """Every row with each of the three."""
    scores = fly_rows(context, ROWS, seeds=1 if context.quick else None)
    return Result(
        name="unseen",
        title=context.scenario("unseen").title,
        flown="A short period of 6.6 rad/s in place of the 11.5 that the shipped gains were found"
        " on, a servo of 30 ms, a stall of its own, another jet and board; the module has its"
        " airframe file, and seeks gains when it is loaded. Beside it a plain PID with gains that"
        " were sought for this very aircraft, which nothing but board, floor and walls ends. Places"
        " a, b and c: 8.5, 8.7 and 9.0 m/s; slow and fast: 8.0 and 9.5 m/s. The slowest steady"
        " glide is at 7.6 m/s."
        " e_rho and y are root mean squares of all flights, the lost ones as far as they flew.",
        claims=tuple(claim for row in ROWS for claim in row_claims(row, scores)),
        why="",
        tables=(
            Table(
                "",
                ("", *(f"{pilot}: {what}" for pilot in PILOTS for what in COLUMNS)),
                tuple(
                    (
                        f"{row.name}, of {scores[row.name, PLAIN].flights}",
                        *(cell for pilot in PILOTS for cell in cells(scores[row.name, pilot])),
                    )
                    for row in ROWS
                ),
            ),
        ),
        numbers={", ".join(key): score._asdict() for key, score in scores.items()},
        figures=(),
        scenarios=("unseen",),
        seeds=context.scenario("unseen").seeds,
    )


COLUMNS: Final = ("up", "e_rho [cm]", "y [cm]")


def cells(score: UnseenScore) -> tuple[str, str, str]:
    """Of a table."""
    up = " / ".join(map(str, score.up.values()))
    return up, f"{100 * score.rms_e_rho_m:.2f}", f"{100 * score.rms_y_m:.0f}"


def row_claims(row: UnseenRow, scores: dict[tuple[str, str], UnseenScore]) -> tuple[Claim, Claim]:
    """As many last with accelerometers as with the plain PID at each place, and some do; nearer to
    the line, which is undecided where any is lost: who is lost was farther away than the others."""
    inertial, plain = scores[row.name, WITH], scores[row.name, PLAIN]
    lasted = Claim(
        f"{row.name}: with accelerometers as many last at each place as with the plain PID",
        # Where both lose every flight neither has shown anything.
        inertial.lasted > 0 and all(inertial.up[place] >= plain.up[place] for place in row.places),
        f"{cells(inertial)[0]} and {cells(plain)[0]}, of {plain.flights}",
    )
    everyone = plain.flights * len(row.places)
    all_up = inertial.lasted == plain.lasted == everyone
    near, far = inertial.rms_e_rho_m, plain.rms_e_rho_m
    measured = f"{everyone - inertial.lasted} and {everyone - plain.lasted} lost"
    if all_up:
        measured = f"{100 * near:.2f} and {100 * far:.2f} cm: {near / far:.2f}"
    nearer = Claim(
        f"{row.name}: e_rho at most {E_RHO_OF_PLAIN:g} of the plain PID's",
        all_up and near / far <= E_RHO_OF_PLAIN,
        measured,
        undecided=not all_up,
    )
    return lasted, nearer

"""`margins`: what the loops can bear, by the linear model; nothing is flown.

    shipped    the shipped aircraft over speed, lean and latency, with accelerometers and without:
               pitch at elevator and e_rho, roll and heading at aileron and rudder
    age        the same at one place, with attitudes that arrive late, known to the schedule or not
    refused    drawn aircraft, each with its own file: on how many the rule on board refuses a line
               of each lean, with gains that yield to lag and without (`control.pitch_schedule`)
    drawn      others on the linear model: near the usual places, far from them, and with what no
               file knows
    rule       others by the rule on board for roll and heading, beside the linear model
               (`lateral_rule`)

Drawn as `tuning.aircraft` has them, by seeds that no gain and no law was chosen by.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import exp, log, radians
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.loop.lateral_rule import (
    OF_EACH,
    both_answers,
    rule_claims,
    rule_jobs,
    rule_table,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.lateral_model import lateral_loop
from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import (
    BREAKS,
    Margin,
    activity,
    close_loop,
    disk_margin,
    margin,
)
from tgl_soar.analysis.linear_plant import Condition, Gusts, linear_plant
from tgl_soar.analysis.tuning.aircraft import Drawn, Ranges, drawn_aircraft
from tgl_soar.analysis.tuning.demands import FREQUENCIES_RADPS
from tgl_soar.analysis.tuning.flights import values_of
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.config.parameters import ANCHORS, ParameterSet
from tgl_soar.control import loop_margin
from tgl_soar.control.found_gains import INERTIAL, PLAIN, SHIPPED
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.loop_margin import FLOOR, SPEEDS
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import AircraftModel, aircraft_model, highest_pitch_glide
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params

SPEEDS_MPS: Final = (7.7, 8.5, 10.0, 12.0, 14.0)
LEANS_DEG: Final = (5.0, 15.0, 30.0, 45.0)
DELAYS_S: Final = (0.0075, 0.0245, 0.040)
LATE_S: Final = (0.005, 0.020, 0.050, 0.100, 0.150, 0.200)  # of attitudes, to AGE_ATT_MAX
REFUSED_LEANS_DEG: Final = tuple(float(deg) for deg in range(5, 46, 5))
REFUSED_OF: Final = 1000
DRAWN: Final = {INERTIAL: 60, PLAIN: 30}
SEED: Final = 2027
# MIL-F-9490D's, at once and of one break at a time; `loop_margin.FLOOR` of all others.
GAIN_DB: Final = 6.0
PHASE_DEG: Final = 45.0
# A file that is right is refused a lean once in a hundred at most: who meets it may lean by less.
REFUSED_FRACTION: Final = 0.01
# Of what the schedule's gains have: no powers of its ratios that were sought had less.
SOUGHT_FRACTION: Final = 0.85
GUSTS: Final = 0.03
_HERE: Final = SoaringFrame(0.0, 0.0, 0.0, 0.0)


class TableJob(NamedTuple):
    """One condition of the shipped aircraft."""

    speed_mps: float
    lean_deg: float
    delay_s: float
    inertial: bool
    late_s: float | None = None  # of attitudes; None: as they usually are
    known: bool = True  # that age, to the schedule


# Where gains were found.
FOUND: Final = TableJob(speed_mps=8.5, lean_deg=15.0, delay_s=0.0075, inertial=True)


class TableFound(NamedTuple):
    """What it leaves."""

    elevator: Margin
    line: Margin
    aileron: float  # alpha, likewise
    rudder: float
    duration_s: float = 0.0  # nothing is flown

    @property
    def alpha(self) -> float:
        """Of pitch, the worse break."""
        return min(self.elevator.alpha, self.line.alpha)


class RefusedFound(NamedTuple):
    """On which of `REFUSED_LEANS_DEG` a drawn aircraft is refused."""

    before: tuple[bool, ...]  # with the shipped aircraft's gains, carried there, that do not yield
    now: tuple[bool, ...]
    duration_s: float = 0.0


class DrawnJob(NamedTuple):
    """A drawn aircraft on the linear model."""

    kind: str  # of `tuning.demands.SETS`
    number: int


class DrawnFound(NamedTuple):
    """The least alpha of three places each; and e_rho in gusts of 3 % at the best glide's speed and
    15 degrees, with the gains sought for it and with those that the schedule carries there."""

    near: float
    far: float
    with_errors: float
    e_rho_m: float
    carried_m: float
    duration_s: float = 0.0


@lru_cache(maxsize=1)
def _shipped() -> tuple[Airframe, ParameterSet]:
    path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, _, values = load_flight(path, site_path)
    return airframe, values


def table_margins(job: TableJob) -> TableFound:
    """By the linear models of pitch and of roll and heading."""
    airframe, values = _shipped()
    known = values.changed({"CMD_DELAY": job.delay_s, "TGL_LEAN": job.lean_deg})
    laws = laws_from(known, _HERE, airframe.aerodynamics())
    if not job.known:  # found with an elevator that late no gain is lost to age
        laws = laws._replace(schedule=laws.schedule._replace(late_found_s=1e3))
    condition = _condition(aircraft_model(asdict(airframe.airframe), airframe.model), airframe, job)
    loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
    sideways = lateral_loop(laws, condition) if job.late_s is None else None
    return TableFound(
        elevator=margin(loop, BREAKS[0]),
        line=margin(loop, BREAKS[1]),
        aileron=margin(sideways, "aileron").alpha if sideways else 0.0,
        rudder=margin(sideways, "rudder").alpha if sideways else 0.0,
    )


def _condition(model: AircraftModel, airframe: Airframe, job: TableJob) -> Condition:
    sensors = Sensors(imu=MEMS_IMU) if job.inertial else USUAL_SENSORS
    if job.late_s is not None:
        imu = sensors.imu
        sensors = sensors._replace(
            attitude=sensors.attitude._replace(delay_s=job.late_s),
            imu=imu._replace(delay_s=job.late_s) if imu is not None else None,
        )
    return Condition(
        model=model,
        servo=servo_params(airframe.model),
        speed_mps=job.speed_mps,
        lean_rad=radians(job.lean_deg),
        sensors=sensors,
        command_delay_s=job.delay_s,
    )


def refused(number: int) -> RefusedFound:
    """Of one drawn aircraft, by the rule on board."""
    airframe, base = _shipped()
    values = values_of(
        base, drawn_aircraft(airframe, Ranges(), (SEED, number)), INERTIAL, seeks=True
    )
    carried = _carried(values, base)
    before, now = [], []
    for lean_deg in REFUSED_LEANS_DEG:
        laws = laws_from(values.changed({"TGL_LEAN": lean_deg}), _HERE)
        firm = laws_from(carried.changed({"TGL_LEAN": lean_deg}), _HERE)
        firm = firm._replace(schedule=firm.schedule._replace(path_s=0.0))
        before.append(_least(firm, carried, lean_deg) < FLOOR)
        now.append(_least(laws, values, lean_deg) < FLOOR)
    return RefusedFound(tuple(before), tuple(now))


def _carried(values: ParameterSet, base: ParameterSet) -> ParameterSet:
    """The shipped aircraft's gains, for the schedule to carry them to another one."""
    return values.changed({name: base[name] for name in (*SHIPPED, *ANCHORS)})


def _least(laws: Laws, values: ParameterSet, lean_deg: float) -> float:
    return min(
        loop_margin.disk_margin(
            loop_margin.flown(laws, values, fraction * values["DYN_BEST"], lean_deg, inertial)
        )
        for inertial in (False, True)
        for fraction in SPEEDS
    )


def drawn_margins(job: DrawnJob) -> DrawnFound:
    """Of one drawn aircraft, by the linear model."""
    airframe, base = _shipped()
    # The first, (SEED, 1, 0), is the aircraft (SEED, 1) of `refused`: one of two tables that are
    # counted apart.
    seed = (SEED, 1, job.number)
    drawn = drawn_aircraft(airframe, Ranges(), seed)
    values = values_of(base, drawn, job.kind, seeks=True)
    draw = np.random.default_rng((*seed, 1))
    known = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
    near = [(draw.uniform(0.92, 1.15), draw.uniform(10.0, 30.0)) for _ in range(3)]
    far = [(draw.uniform(0.85, 1.5), draw.uniform(5.0, 45.0)) for _ in range(3)]

    def least(model: AircraftModel, places: Sequence[tuple[float, float]]) -> float:
        slowest = 1.001 * highest_pitch_glide(model).horizontal_mps
        return min(
            _drawn_alpha(
                drawn, model, values, max(slowest, fraction * values["DYN_BEST"]), lean, job
            )
            for fraction, lean in places
        )

    def e_rho_m(gains: ParameterSet) -> float:
        slowest = 1.001 * highest_pitch_glide(known).horizontal_mps
        speed, kind = max(slowest, values["DYN_BEST"]), job.kind == INERTIAL
        at = _condition(known, drawn.known, _case(speed, 15.0, drawn.latency_s, kind))
        laws = laws_from(gains.changed({"TGL_LEAN": 15.0}), _HERE, drawn.known.aerodynamics())
        return activity(laws, at, Gusts(GUSTS, values["DYN_BEST"])).e_rho_m

    return DrawnFound(
        near=least(known, near),
        far=least(known, far),
        with_errors=least(drawn.true, near),
        e_rho_m=e_rho_m(values),
        carried_m=e_rho_m(_carried(values, base)),
    )


def _drawn_alpha(
    drawn: Drawn,
    model: AircraftModel,
    values: ParameterSet,
    speed_mps: float,
    lean_deg: float,
    job: DrawnJob,
) -> float:
    at = _case(speed_mps, lean_deg, drawn.latency_s, job.kind == INERTIAL)
    condition = _condition(model, drawn.known, at)
    laws = laws_from(values.changed({"TGL_LEAN": lean_deg}), _HERE, drawn.known.aerodynamics())
    loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
    return disk_margin(loop, FREQUENCIES_RADPS)


def margins(context: Context) -> Result:
    """All of it."""
    quick = context.quick
    grid = [
        _case(speed, lean, delay, inertial)
        for speed in (SPEEDS_MPS[1:2] if quick else SPEEDS_MPS)
        for lean in (LEANS_DEG[1:2] if quick else LEANS_DEG)
        for delay in (DELAYS_S[:1] if quick else DELAYS_S)
        for inertial in (True, False)
    ]
    aged = [
        FOUND._replace(inertial=inertial, late_s=late_s, known=known)
        for inertial in (True, False)
        for known in (False, True)
        for late_s in (LATE_S[::5] if quick else LATE_S)
    ]
    found = context.flyer.each(table_margins, [*grid, *aged])
    cases = dict(zip([*grid, *aged], found, strict=True))
    numbers = range(2 if quick else REFUSED_OF)
    counted = context.flyer.each(refused, numbers)
    lists = {
        kind: [DrawnJob(kind, i) for i in range(2 if quick else of)] for kind, of in DRAWN.items()
    }
    drawn = {kind: context.flyer.each(drawn_margins, jobs) for kind, jobs in lists.items()}
    sideways = rule_jobs(SEED, 1 if quick else OF_EACH)
    answers = context.flyer.each(both_answers, sideways)
    shipped_cases = {job: cases[job] for job in grid}
    return Result(
        name="margins",
        title="what the loops can bear, by the linear model",
        flown=f"The shipped aircraft over speed, lean and latency, {len(counted)} drawn aircraft"
        f" by the rule on board, and {' and '.join(str(len(jobs)) for jobs in lists.values())}"
        f" others on the linear model; then {len(sideways)} more by both, for roll and heading."
        " α is the disk margin of the worse break; nothing is flown.",
        claims=(
            *shipped_claims(shipped_cases),
            *_age_claims(cases, aged),
            *drawn_claims(counted, drawn),
            *rule_claims(sideways, answers),
        ),
        why="",
        tables=(
            _pitch_table(shipped_cases),
            _lateral_table(shipped_cases),
            _age_table(cases, aged),
            refused_table(counted),
            _drawn_table(drawn),
            rule_table(sideways, answers),
        ),
        numbers={
            "least": {kind: [each.near for each in of] for kind, of in drawn.items()},
            "refused": [sum(column) for column in zip(*(e.now for e in counted), strict=True)],
            "sideways": [answer[:2] for answer in answers],
        },
        figures=(),
        scenarios=(),
        seeds=(SEED,),
    )


def _case(speed_mps: float, lean_deg: float, delay_s: float, inertial: bool) -> TableJob:
    return TableJob(speed_mps=speed_mps, lean_deg=lean_deg, delay_s=delay_s, inertial=inertial)


def _words(inertial: bool) -> str:
    return "with accelerometers" if inertial else "without"


def shipped_claims(cases: dict[TableJob, TableFound]) -> list[Claim]:
    """The floor everywhere, and 6 dB and 45 degrees where gains were found."""
    pitch = min(cases, key=lambda job: cases[job].alpha)
    side = min(cases, key=lambda job: min(cases[job].aileron, cases[job].rudder))
    claims = [
        Claim(
            f"{name}: α is {FLOOR:g} or more at every speed, lean and latency, with"
            " accelerometers and without",
            alpha >= FLOOR,
            f"{alpha:.2f} at least, at {at.speed_mps:g} m/s, {at.lean_deg:g}°,"
            f" {1e3 * at.delay_s:g} ms, {_words(at.inertial)}",
        )
        for name, at, alpha in (
            ("elevator and line", pitch, cases[pitch].alpha),
            ("aileron and rudder", side, min(cases[side].aileron, cases[side].rudder)),
        )
    ]
    for inertial in (True, False):
        found = cases[FOUND._replace(inertial=inertial)]
        both = (found.elevator, found.line)
        gain = float(min(min(each.gain_up_db, -each.gain_down_db) for each in both))
        phase = float(min(each.phase_deg for each in both))
        claims.append(
            Claim(
                f"at {FOUND.speed_mps:g} m/s, {FOUND.lean_deg:g}° and {1e3 * FOUND.delay_s:g} ms,"
                f" {_words(inertial)}: {GAIN_DB:g} dB and {PHASE_DEG:g}° at elevator and line",
                gain >= GAIN_DB and phase >= PHASE_DEG,
                f"{gain:.1f} dB and {phase:.0f}°",
            )
        )
    return claims


def _age_claims(cases: dict[TableJob, TableFound], aged: Sequence[TableJob]) -> list[Claim]:
    known = [job for job in aged if job.known]
    worst = min(known, key=lambda job: cases[job].alpha)
    return [
        Claim(
            f"attitudes late by up to {1e3 * LATE_S[-1]:g} ms, known to the schedule: α is"
            f" {FLOOR:g} or more",
            cases[worst].alpha >= FLOOR,
            f"{cases[worst].alpha:.2f} at least, {1e3 * (worst.late_s or 0.0):g} ms late,"
            f" {_words(worst.inertial)}",
        )
    ]


def drawn_claims(
    counted: Sequence[RefusedFound], drawn: dict[str, list[DrawnFound]]
) -> list[Claim]:
    """Each lean alone: leans are not pooled."""
    counts = [sum(column) for column in zip(*(each.now for each in counted), strict=True)]
    most = max(counts)
    at = REFUSED_LEANS_DEG[counts.index(most)]
    unstable = sum(
        min(each.near, each.far, each.with_errors) <= 0.0 for of in drawn.values() for each in of
    )
    return [
        Claim(
            f"at every lean the rule refuses at most {100 * REFUSED_FRACTION:g} % of drawn"
            " aircraft",
            most <= REFUSED_FRACTION * len(counted),
            f"at most {most} of {len(counted)}, at {at:g}°",
        ),
        Claim(
            "no drawn aircraft is unstable, errors of its file included",
            unstable == 0,
            f"{unstable} of {sum(len(of) for of in drawn.values())}",
        ),
        *(
            Claim(
                f"gains sought for each drawn aircraft, {_words(kind == INERTIAL)}: e_rho is at"
                f" most {SOUGHT_FRACTION:g} of what the schedule makes of the shipped ones (mean"
                " of logarithms)",
                _fraction(of) <= SOUGHT_FRACTION,
                f"{_fraction(of):.2f}",
            )
            for kind, of in drawn.items()
        ),
    ]


def _fraction(drawn: Sequence[DrawnFound]) -> float:
    return exp(sum(log(each.e_rho_m / each.carried_m) for each in drawn) / len(drawn))


def _pitch_table(cases: dict[TableJob, TableFound]) -> Table:
    places = list(dict.fromkeys((job.speed_mps, job.lean_deg) for job in cases))
    links = _links(cases)
    return Table(
        "The shipped aircraft: α of pitch",
        ("speed, lean", *_heads(links)),
        tuple(
            (
                f"{speed:g} m/s, {lean:g}°",
                *(
                    f"{cases[_case(speed, lean, delay, inertial)].alpha:.2f}"
                    for inertial, delay in links
                ),
            )
            for speed, lean in places
        ),
    )


def _lateral_table(cases: dict[TableJob, TableFound]) -> Table:
    links, lean = _links(cases), next(iter(cases)).lean_deg
    rows = []
    for speed in dict.fromkeys(job.speed_mps for job in cases):
        found = [cases[_case(speed, lean, delay, inertial)] for inertial, delay in links]
        rows.append((f"{speed:g} m/s", *(f"{e.aileron:.2f} / {e.rudder:.2f}" for e in found)))
    return Table(
        "The shipped aircraft: α at aileron / rudder, whatever the lean",
        ("speed", *_heads(links)),
        tuple(rows),
    )


def _links(cases: dict[TableJob, TableFound]) -> list[tuple[bool, float]]:
    found = dict.fromkeys((job.inertial, job.delay_s) for job in cases)
    return sorted(found, key=lambda link: (not link[0], link[1]))


def _heads(links: Sequence[tuple[bool, float]]) -> list[str]:
    return [f"{_words(inertial)}, {1e3 * delay:g} ms" for inertial, delay in links]


def _age_table(cases: dict[TableJob, TableFound], aged: Sequence[TableJob]) -> Table:
    lates = list(dict.fromkeys(job.late_s or 0.0 for job in aged))

    def alpha(inertial: bool, known: bool, late_s: float) -> float:
        return cases[FOUND._replace(inertial=inertial, late_s=late_s, known=known)].alpha

    return Table(
        f"α of pitch at {FOUND.speed_mps:g} m/s, {FOUND.lean_deg:g}° and {1e3 * FOUND.delay_s:g} ms"
        " with attitudes late by (0: unstable)",
        ("", *(f"{1e3 * late_s:g} ms" for late_s in lates)),
        tuple(
            (
                f"{_words(inertial)}, age {'in the schedule' if known else 'unknown'}",
                *(f"{alpha(inertial, known, late_s):.2f}" for late_s in lates),
            )
            for inertial in (True, False)
            for known in (False, True)
        ),
    )


def refused_table(counted: Sequence[RefusedFound]) -> Table:
    """Of all drawn aircraft, at each lean."""
    before = [sum(column) for column in zip(*(e.before for e in counted), strict=True)]
    now = [sum(column) for column in zip(*(e.now for e in counted), strict=True)]
    return Table(
        f"Of {len(counted)} drawn aircraft, each with its own file, refused at a lean of",
        ("", *(f"{deg:g}°" for deg in REFUSED_LEANS_DEG)),
        (
            ("with the shipped gains, scheduled, where they do not yield", *map(str, before)),
            ("with the gains that are flown", *map(str, now)),
        ),
    )


def _drawn_table(drawn: dict[str, list[DrawnFound]]) -> Table:
    def least(alphas: list[float]) -> str:
        in_order = sorted(alphas)
        return f"{in_order[0]:.2f} ({in_order[len(in_order) // 50]:.2f})"

    return Table(
        "Drawn aircraft on the linear model: α, least (a fiftieth is below), of three places each",
        (
            "",
            "0.92 to 1.15 of the best glide's speed, 10 to 30°",
            "0.85 to 1.5, 5 to 45°",
            "as the first, with what no file knows",
            "e_rho, of what it is with the schedule's gains",
        ),
        tuple(
            (
                f"{len(of)} aircraft, {_words(kind == INERTIAL)}",
                least([each.near for each in of]),
                least([each.far for each in of]),
                least([each.with_errors for each in of]),
                f"{_fraction(of):.2f}",
            )
            for kind, of in drawn.items()
        ),
    )

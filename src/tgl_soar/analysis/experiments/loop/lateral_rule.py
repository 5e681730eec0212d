"""Of `margins`: the rule on board that judges roll and heading, beside the linear model.

Aircraft are drawn about the shipped one by what the lateral motion knows: yaw and roll inertia,
every lateral coefficient, the servo; each has the gains that its own file gives.  The rule's answer
is the least of its loops (`loop_margin.lateral_margins`), the linear model's the least of the same
loops, at the aileron and at the rudder.

    own        with these gains: who is refused or warned of, though there is a margin?
    changed    with one of the gains up to ten times as large, or as small: who is accepted, though
               there is none?

The link is late by 5, 20 or 40 ms, and known to the schedule.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import radians
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict, replace

from tgl_soar.analysis.experiments.result import Claim, Table
from tgl_soar.analysis.lateral_model import lateral_loop
from tgl_soar.analysis.linear_model import disk_margin
from tgl_soar.analysis.linear_plant import Condition
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.lateral_gains import lateral_dynamics
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.control.loop_margin import FLOOR, RINGS, SPEEDS, lateral_margins
from tgl_soar.sim.aircraft import aircraft_model
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.servos import servo_params

LINKS_S: Final = (0.005, 0.020, 0.040)
OF_EACH: Final = 60  # aircraft of each link, with their own gains and with one changed
COEFFICIENTS: Final = (
    *("CY_beta", "CY_rudder", "Cl_beta", "Cl_p", "Cl_r", "Cl_aileron"),
    *("Cn_beta", "Cn_p", "Cn_r", "Cn_rudder", "Cn_aileron"),
)
WITHIN: Final = (0.7, 1.3)  # factors: what is known of such coefficients (config/airframes)
SERVO_S: Final = (0.015, 0.080)
GAINS: Final = ("AIL_P", "AIL_I", "AIL_D", "RUD_P", "RUD_D", "SIDE_P", "SIDE_I")
# What the elevator's rule is held to (tests/control/test_loop_margin.py): a tenth of the margin's
# scale from 0 to 1, and less than half of what stands between a refusal and a warning.
AGREES: Final = 0.1


class RuleJob(NamedTuple):
    """One drawn aircraft."""

    seed: tuple[int, ...]
    link_s: float
    changed: bool  # one of its gains


class RuleFound(NamedTuple):
    """The least alpha of all loops."""

    rule: float
    model: float
    duration_s: float = 0.0  # nothing is flown


def drawn_sideways(airframe: Airframe, draw: np.random.Generator) -> Airframe:
    """An aircraft that flies otherwise in roll and yaw, with the file that it would have."""
    bench, model = airframe.airframe, dict(airframe.model)
    for name in COEFFICIENTS:
        model[name] *= draw.uniform(*WITHIN)
    model["servo_lag_radps"] = 1.0 / draw.uniform(*SERVO_S)
    bench = replace(
        bench,
        ixx_kgm2=bench.ixx_kgm2 * draw.uniform(*WITHIN),
        izz_kgm2=bench.izz_kgm2 * draw.uniform(*WITHIN),
    )
    return replace(airframe, airframe=bench, model=model)


def one_gain_changed(values: ParameterSet, draw: np.random.Generator) -> ParameterSet:
    """By a factor of a tenth to ten, within the parameter's range."""
    name = GAINS[draw.integers(len(GAINS))]
    wanted = values[name] * 10.0 ** draw.uniform(-1.0, 1.0)
    return values.changed({name: min(PARAMETERS[INDEX[name]].maximum, wanted)})


@lru_cache(maxsize=1)
def _shipped() -> Airframe:
    return load_airframe(shipped("airframes/eclipson_c.toml"))


def both_answers(job: RuleJob) -> RuleFound:
    """The rule's and the linear model's, of one drawn aircraft."""
    draw = np.random.default_rng(job.seed)
    airframe, place = drawn_sideways(_shipped(), draw), shipped("sites/tunnel.toml")
    site = load_site(place)
    values = load_parameters(airframe, shipped("airframes/eclipson_c.toml"), site, place)
    values = values.changed({"CMD_DELAY": job.link_s})
    if job.changed:
        values = one_gain_changed(values, draw)
    rule = min(found.alpha for found in lateral_margins(values, lateral_dynamics(airframe)))
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    laws = laws_from(values, site.frame(), airframe.aerodynamics())
    conditions = [
        Condition(
            model=model,
            servo=servo_params(airframe.model),
            speed_mps=fraction * values["DYN_BEST"],
            lean_rad=radians(values["TGL_LEAN"]),
            sensors=sensors,
            command_delay_s=job.link_s,
        )
        for sensors in (Sensors(imu=MEMS_IMU), USUAL_SENSORS)
        for fraction in SPEEDS
    ]
    return RuleFound(rule, min(disk_margin(lateral_loop(laws, each)) for each in conditions))


class RuleCount(NamedTuple):
    """Of some aircraft; wrongly: by the linear model."""

    aircraft: int
    bad: int  # below RINGS by the linear model
    refused_wrongly: int
    accepted_wrongly: int
    little: int  # below FLOOR by the linear model
    warned_wrongly: int
    unwarned_wrongly: int
    below: float  # by how much the rule is below the linear model at most, where that counts
    above: float


def counted(found: Sequence[RuleFound]) -> RuleCount:
    """What the rule says, and what the linear model."""
    # Beyond what is refused or warned of nobody asks how large alpha is.
    asked = [each for each in found if min(each.rule, each.model) < FLOOR] or [RuleFound(0.0, 0.0)]
    return RuleCount(
        aircraft=len(found),
        bad=sum(each.model < RINGS for each in found),
        refused_wrongly=sum(each.rule < RINGS <= each.model for each in found),
        accepted_wrongly=sum(each.model < RINGS <= each.rule for each in found),
        little=sum(each.model < FLOOR for each in found),
        warned_wrongly=sum(each.rule < FLOOR <= each.model for each in found),
        unwarned_wrongly=sum(each.model < FLOOR <= each.rule for each in found),
        below=max(0.0, *(each.model - each.rule for each in asked)),
        above=max(0.0, *(each.rule - each.model for each in asked)),
    )


def rule_jobs(seed: int, of_each: int) -> list[RuleJob]:
    """So many of each link, with their own gains and with one changed."""
    return [
        RuleJob((seed, 2, number), link_s, changed)
        for changed in (False, True)
        for link_s in LINKS_S
        for number in range(of_each)
    ]


def rule_claims(jobs: Sequence[RuleJob], found: Sequence[RuleFound]) -> list[Claim]:
    """That nobody is refused or warned of without need, nor accepted who swings."""
    own, changed = (
        [each for job, each in zip(jobs, found, strict=True) if job.changed == which]
        for which in (False, True)
    )
    with_own, with_changed, of_all = counted(own), counted(changed), counted(found)
    return [
        Claim(
            "no drawn aircraft is refused or warned of in roll or heading with the gains of its own"
            " file, where the linear model has 0.5",
            with_own.refused_wrongly + with_own.warned_wrongly == 0,
            f"refused {with_own.refused_wrongly}, warned of {with_own.warned_wrongly} of"
            f" {with_own.aircraft}",
        ),
        Claim(
            "with one gain changed none that is unstable is accepted",
            not any(each.model <= 0.0 and each.rule >= RINGS for each in changed),
            f"{with_changed.bad} of {with_changed.aircraft} have less than {RINGS:g},"
            f" {sum(each.model <= 0.0 for each in changed)} of them are unstable; accepted wrongly"
            f" {with_changed.accepted_wrongly}, refused wrongly {with_changed.refused_wrongly}",
        ),
        Claim(
            f"where either has less than {FLOOR:g} in roll or heading both agree within {AGREES:g}",
            max(of_all.below, of_all.above) <= AGREES,
            f"the rule is below the linear model by {of_all.below:.2f} at most, above by"
            f" {of_all.above:.2f}",
        ),
    ]


def rule_table(jobs: Sequence[RuleJob], found: Sequence[RuleFound]) -> Table:
    """A row for each link, with own gains and with one changed."""
    rows = []
    for changed, link_s in dict.fromkeys((job.changed, job.link_s) for job in jobs):
        here = counted(
            [
                each
                for job, each in zip(jobs, found, strict=True)
                if (job.changed, job.link_s) == (changed, link_s)
            ]
        )
        gains = "one gain changed" if changed else "the gains of its file"
        rows.append((f"{gains}, {1e3 * link_s:g} ms", *map(str, here[:7])))
    return Table(
        "Drawn aircraft by the rule on board for roll and heading, beside the linear model",
        (
            "",
            "aircraft",
            f"α below {RINGS:g}",
            "refused wrongly",
            "accepted wrongly",
            f"α below {FLOOR:g}",
            "warned of wrongly",
            "not warned of wrongly",
        ),
        tuple(rows),
    )

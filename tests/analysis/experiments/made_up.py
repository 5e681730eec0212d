"""Made-up flights: for each job what its function would return, with numbers drawn from
the job, so that an experiment concludes from them in a moment what would else take hours.

A made-up flight is as a flight could be: a sixth are lost and say by what, errors are centimetres,
angles some degrees, and a path swings about its line.  `lost` makes a flight that is lost at once.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass, replace
from math import cos, inf, pi, sin
from random import Random
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.experiments.estimates.estimator_flights import EstimatorFlight, WatchedFlight
from tgl_soar.analysis.experiments.estimates.wind_estimate import ObservedFlight, WindFlight
from tgl_soar.analysis.experiments.flights import (
    KEEP_EVERY,
    FlownScenario,
    Flyer,
    ScenarioJob,
    score_legs,
)
from tgl_soar.analysis.experiments.lift.survey import SurveyedOnce, SurveyJob
from tgl_soar.analysis.experiments.loop.margin_tables import REFUSED_LEANS_DEG, RefusedFound
from tgl_soar.analysis.experiments.scenario import prepare
from tgl_soar.analysis.survey.contour_fit import DrawnContour
from tgl_soar.analysis.survey.survey_flight import SurveyFlight
from tgl_soar.control.found_gains import SETS
from tgl_soar.control.point_hold import HOLDS
from tgl_soar.control.supervisor import BREAKING_OFF, CAPTURING, SOARING
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.flight import Row

Floats = NDArray[np.float64]
LOST: Final = 1.0 / 6.0
LOST_AT_S: Final = 0.5
STEP_S: Final = 0.02
MOVES_S: Final = 1.0  # a line that is changed
# What a flight that goes well is, and what never was in a flight that does not.
GOOD: Final = ("up", "soared", "oracle_like", "aloft", "landing", "done", "in_time")
NEVER: Final = ("settled_s", "found_s", "claimed_s", "warned_s", "low_s", "floor_s")
ENDS: Final = ("hit the board at x 0.31, z 0.52 m", "disengaged: roll or pitch too large")


class MadeUp(Flyer):
    """Flies nothing, and answers at once."""

    def __init__(self, *, lost: bool = False) -> None:
        """lost: every flight."""
        super().__init__()
        self._lost = lost
        self.lists: list[tuple[str, int]] = []  # what was asked for: by which function, how many

    def each(self, fly: Callable[[Any], Any], jobs: Iterable[Any], **_: bool) -> list[Any]:
        """A made-up flight of each job."""
        queue = list(jobs)
        kind = typing.get_type_hints(fly)["return"]
        self.lists.append((fly.__name__, len(queue)))
        return [flown(kind, job, i, self._lost) for i, job in enumerate(queue)]


def flown(kind: Any, job: Any, number: int, lost: bool = False) -> Any:
    """The flight of one job, the so manyth of its list."""
    random = Random(f"{kind.__name__} {number}")
    lost = random.random() < LOST or lost
    special = SPECIAL.get(kind)
    return special(job, random, lost) if special else _Maker(job, random, lost).made(kind)


class _Maker:
    """Values for the fields of a flight."""

    def __init__(self, job: Any, random: Random, lost: bool) -> None:
        self._job, self._random, self._lost = job, random, lost

    def made(self, kind: Any, name: str = "") -> Any:
        """A value of a type; name: of the field."""
        origin, given = typing.get_origin(kind), typing.get_args(kind)
        if origin in (typing.Union, types.UnionType):
            return self.made(given[0], name)
        if origin is typing.Literal:
            return self._random.choice(given)
        if origin is tuple and given[-1] is not Ellipsis:
            return tuple(self.made(each, name) for each in given)
        if origin in (tuple, list):
            return origin(self.made(given[0], name) for _ in range(3))
        if origin is dict:
            keys = SETS if given[0] is str else range(2)
            return {key: self.made(given[1], name) for key in keys}
        if hasattr(kind, "_fields") or is_dataclass(kind):
            hints = typing.get_type_hints(kind)
            names = kind._fields if hasattr(kind, "_fields") else [f.name for f in fields(kind)]
            return kind(**{each: self._field(each, hints[each]) for each in names})
        return self._plain(kind, name)

    def _field(self, name: str, kind: Any) -> Any:
        """What the job says of it, or something made up."""
        given = getattr(self._job, name, None)
        if isinstance(given, kind if isinstance(kind, type) else object) and given is not None:
            return given
        return self.made(kind, name)

    def _plain(self, kind: Any, name: str) -> Any:
        random = self._random
        if name == "found":  # a start was
            return random.random() < 0.9
        if kind is bool:
            return not self._lost if name in GOOD else random.random() < 0.3
        if kind is int:
            return random.randrange(3)
        if kind is str:
            return self._words(name)
        if kind is float:
            return self._number(name)
        return np.array([self._number(name) for _ in range(8)])

    def _words(self, name: str) -> str:
        if name == "modes":
            return MODE_NAMES[self._random.choice((CAPTURING, SOARING, BREAKING_OFF))]
        if name in ("ended", "lost", "failed"):
            return self._random.choice(ENDS) if self._lost else ""
        if name in ("given_up", "handed_over", "cut_short"):
            return "" if self._random.random() < 0.7 else "no place was found"
        return f"{name} {self._random.randrange(4)}"

    def _number(self, name: str) -> float:
        random = self._random
        if name in ("duration_s", "flown_s", "lasted_s"):
            return LOST_AT_S if self._lost else random.uniform(20.0, 60.0)
        if name in NEVER and (self._lost or random.random() < 0.4):
            return inf
        for ending, (least, most) in RANGES.items():
            if name.endswith(ending):
                return random.uniform(least, most)
        return random.random()


# By the end of a field's name: what is usual.
RANGES: Final = {
    "e_rho_m": (0.002, 0.04),
    "over_ground_m": (0.5, 3.0),
    "along_m": (-6.0, 6.0),
    "across_m": (-3.0, 3.0),
    "off_m": (0.0, 3.0),
    "y_m": (0.02, 0.3),
    "_m2": (1e-6, 4e-4),
    "_m": (0.01, 2.0),
    "_mm": (1.0, 9.0),
    "bank_rad2": (1e-4, 1e-2),
    "_rad": (0.0, 0.1),
    "_deg": (0.0, 30.0),
    "sink_mps": (0.2, 1.9),
    "wind_mps": (5.0, 8.0),
    "_mps": (0.1, 2.0),
    "_2ps2": (0.1, 4.0),
    "delay_error_s": (-0.004, 0.004),
    "_error": (-0.05, 0.05),
    "_s": (0.5, 40.0),
    "_db": (4.0, 20.0),
    "alpha": (0.3, 1.2),
}


# --- flights with a path --------------------------------------------------------------------------


def scenario_flown(job: ScenarioJob, random: Random, lost: bool) -> FlownScenario:
    """Of a scenario: scored as a flight is, from a path that swings about each line's place."""
    prepared = prepare(job.scenario)
    until_s = LOST_AT_S if lost else job.scenario.duration_s
    time = np.arange(0.0, until_s, STEP_S)
    columns = {name: _swing(time, random, 0.05) for name in Row._fields}
    columns |= {"time_s": time, **_path(job, time, random)}
    columns["wind_mps"] = 8.5 + _swing(time, random, 0.1)
    columns["alpha_rad"] = 0.1 + _swing(time, random, 0.12)
    columns["air_alpha_rad"] = columns["alpha_rad"] + _swing(time, random, 0.02)
    columns["brake"] = np.clip(0.5 + _swing(time, random, 0.6), 0.0, 1.0)
    columns["point"] = np.full(len(time), float(HOLDS))
    trajectory = Trajectory(columns, random.choice(ENDS) if lost else "", len(time))
    path = {name: column[::KEEP_EVERY] for name, column in columns.items()}
    legs = score_legs(prepared, trajectory)
    return FlownScenario(
        seed=job.seed, ended=trajectory.ended, duration_s=float(time[-1]), legs=legs, path=path
    )


def _swing(time: Floats, random: Random, most: float) -> Floats:
    period_s, phase = random.uniform(2.0, 9.0), random.uniform(0.0, 2.0 * pi)
    return most * random.random() * np.sin(2.0 * pi * time / period_s + phase)


def _path(job: ScenarioJob, time: Floats, random: Random) -> dict[str, Floats]:
    """Where it is: about the place that the files give on the line of the moment."""
    prepared = prepare(job.scenario)
    ordered = sorted(job.scenario.changes, key=lambda change: change.time_s)
    name = job.scenario.first_line
    found = {each: np.zeros(len(time)) for each in ("x_m", "z_m", "line_moving", "target_changes")}
    along, across = _swing(time, random, 0.08), _swing(time, random, 0.02)
    beside = random.gauss(0.0, 0.01)
    for count, (begin_s, line) in enumerate([(0.0, None), *((c.time_s, c.line) for c in ordered)]):
        name = line or name
        target, crossing = prepared.lines[name]
        x_m, z_m = target[:2] if crossing is None else (crossing.x_m, crossing.z_m)
        now = time >= begin_s
        c, s = cos(target.eta_rad), sin(target.eta_rad)
        found["x_m"][now] = x_m + c * (along[now] + beside) - s * across[now]
        found["z_m"][now] = z_m + s * (along[now] + beside) + c * across[now]
        found["target_changes"][now] = count
        if line is not None:
            found["line_moving"][now & (time < begin_s + MOVES_S)] = 1.0
    return found | {"e_rho_m": across}


def watched(job: EstimatorFlight, random: Random, lost: bool) -> WatchedFlight:
    """Two estimators beside a flight: the one with accelerations is half as wrong."""
    time = np.arange(5.0, 20.0, 0.1)
    truth = np.stack([_swing(time, random, 1.0) for _ in range(6)], axis=1)
    read = {}
    for imu, wrong in ((True, 0.01), (False, 0.02)):
        errors = np.stack([_swing(time, random, wrong) for _ in range(6)], axis=1)
        read[imu] = np.column_stack([truth + errors, np.full((len(time), 2), 0.6 * wrong)])
    ended = ENDS[0] if lost else ""
    return WatchedFlight(
        flight=job,
        duration_s=LOST_AT_S if lost else job.duration_s,
        ended=ended,
        time_s=time,
        truth=truth,
        read=read,
    )


def observed(job: WindFlight, random: Random, lost: bool) -> ObservedFlight:
    """Estimators of the air that only watch."""
    time = np.arange(0.0, LOST_AT_S if lost else job.leg_s * len(job.lines), 0.1)
    usual = (8.5, 0.1, 8.5, 1.5, 0.0)
    truth = np.stack([mean + _swing(time, random, 0.1) for mean in usual], axis=1)
    read = {}
    for case in job.cases:
        errors = np.stack([_swing(time, random, 0.1) for _ in usual], axis=1)
        read[case] = np.column_stack([truth + errors, np.full((len(time), 2), 0.08)])
    plain = truth[:, 3] + _swing(time, random, 0.4)
    duration_s = float(time[-1]) + 0.1
    return ObservedFlight(
        flight=job,
        duration_s=duration_s,
        time_s=time,
        x_m=_swing(time, random, 1.0),
        truth=truth,
        plain=plain,
        read=read,
    )


def surveyed(job: SurveyJob, random: Random, lost: bool) -> SurveyedOnce:
    """A piece of contour, some centimetres off; of a lost survey none."""
    flight = _Maker(job, random, lost).made(SurveyFlight)
    if lost:
        return SurveyedOnce(
            job=job, flight=flight, drawn=None, why_not="too few places", errors_m=np.zeros(0)
        )
    x = np.linspace(0.0, random.uniform(0.6, 1.4), 30)
    time_s = np.linspace(0.0, flight.lasted_s, 30)
    line_x_m = 0.06 * np.maximum(time_s - 0.2 * flight.lasted_s, 0.0)  # it rests at first
    looks = {"true_x_m": x, "true_z_m": 1.01 + 0.6 * x, "time_s": time_s, "line_x_m": line_x_m}
    flight = replace(flight, looks={**looks, "line_z_m": np.full(30, 1.6)})
    drawn = DrawnContour(
        x_m=x,
        z_m=1.0 + 0.6 * x,
        sigma_m=np.full(30, random.uniform(0.005, 0.03)),
        return_per_s=random.uniform(0.2, 0.6),
        late_m=random.uniform(0.001, 0.02),
        drift_m=random.uniform(0.005, 0.03),
    )
    return SurveyedOnce(
        job=job, flight=flight, drawn=drawn, why_not="", errors_m=_swing(x, random, 0.05)
    )


def refused(_job: int, random: Random, _lost: bool) -> RefusedFound:
    """Of each lean whether it is refused."""
    now = tuple(random.random() < 0.1 for _ in REFUSED_LEANS_DEG)
    return RefusedFound(tuple(each or random.random() < 0.2 for each in now), now)


SPECIAL: Final[dict[Any, Callable[[Any, Random, bool], Any]]] = {
    FlownScenario: scenario_flown,
    WatchedFlight: watched,
    ObservedFlight: observed,
    SurveyedOnce: surveyed,
    RefusedFound: refused,
}

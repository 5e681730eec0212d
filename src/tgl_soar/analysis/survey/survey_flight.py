"""One survey in the module's own closed loop, its tick and the world compiled.

Between two looks (`LOOK_S`) nothing but the tick acts; at a look the survey sees what the module
has aboard, and its line goes into the parameters as the switch on board puts it there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tgl_soar.analysis.logs.flight_data import Floats
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.supervisor import SOARING
from tgl_soar.control.survey import (
    DONE,
    DOWNSTREAM,
    LOOK_S,
    STOPPED,
    SURVEY_TEXTS,
    SurveyState,
    is_cut_short,
    survey_begun,
    survey_moved,
    survey_task,
)
from tgl_soar.control.target_line import TargetLine
from tgl_soar.onboard.line_moves import moved
from tgl_soar.onboard.survey_switch import look_of
from tgl_soar.sim.compiled_flight import begun, fly_on, prepare, why_ended
from tgl_soar.sim.flight import FLIES, Row, inputs_at
from tgl_soar.sim.world import World

BEGIN_S: Final = 12.0  # the line is reached and the aircraft at its place: some 1 / lambda
LOOKED: Final = ("time_s", "x_m", "z_m", "line_x_m", "line_z_m", "standing", "true_x_m", "true_z_m")


@dataclass
class _MovedLine:
    """The line in the parameters, moved within its bounds."""

    values: ParameterSet
    bounds: LineBounds
    moves: int = 0

    def move(self, target: TargetLine) -> bool:
        """Put it there; whether it may be there."""
        there = moved(self.values, self.bounds, target)
        if there is None:
            return False
        self.values, self.moves = there, self.moves + 1
        return True


@dataclass(frozen=True)
class SurveyFlight:
    """What came of it."""

    ended: str  # why the flight ended early; ""
    turns: tuple[str, ...]  # why each way ended
    cut_short: str  # the oddity that ended it; ""
    done: bool  # it came home
    begun_s: float
    lasted_s: float
    eta_rad: float
    looks: dict[str, Floats]  # columns of `LOOKED`, of all looks of the survey


def fly_survey(world: World, values: ParameterSet, seed: int, longest_s: float) -> SurveyFlight:
    """Fly one.  world: newly made.  Errors: `ParameterError`."""
    parts, flight = begun(prepare(world, longest_s), seed)
    ticks = round(longest_s * world.step_hz)
    rows = np.empty((ticks, len(Row._fields)))
    every = round(LOOK_S * world.step_hz)
    bounds = LineBounds((), world.ground)
    state: SurveyState | None = None
    looks: list[tuple[float, ...]] = []
    turns: list[str] = []
    changes = 0
    while flight.steps < ticks and flight.standing == FLIES:
        laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        flight = fly_on(parts, laws, flight, min(flight.steps + every, ticks), changes, rows)
        now_s = flight.steps / world.step_hz
        # The tick is pure: what the module would report at this instant.
        inputs = inputs_at(now_s, flight.world.samples, True)
        _, output = autopilot_step(laws, flight.autopilot, inputs)
        look = look_of(output)
        if state is None:
            if output.mode == SOARING and now_s >= BEGIN_S:
                values = values.changed({"SRV_START": float(DOWNSTREAM)})
                state, changes = survey_begun(look), changes + 1
            continue
        line = _MovedLine(values, bounds)
        before, state = state, survey_moved(survey_task(laws), state, look, line.move)
        values, changes = line.values, changes + line.moves
        true = flight.world.aircraft
        here = (look.time_s, look.x_m, look.z_m, look.line.x_m, look.line.z_m)
        looks.append((*here, float(before.standing), true.x_m, true.z_m))
        if state.standing in (DONE, STOPPED):
            break
        if state.standing != before.standing:
            turns.append(SURVEY_TEXTS[state.reason])
    found = np.array(looks, dtype=float).reshape(len(looks), len(LOOKED))
    cut = state is not None and (state.standing == STOPPED or is_cut_short(state))
    return SurveyFlight(
        ended=why_ended(world, flight),
        turns=tuple(turns),
        cut_short=SURVEY_TEXTS[state.reason] if cut and state is not None else "",
        done=state is not None and state.standing == DONE,
        begun_s=float(found[0, 0]) if looks else float("nan"),
        lasted_s=float(found[-1, 0] - found[0, 0]) if looks else 0.0,
        eta_rad=state.start.eta_rad if state is not None else float("nan"),
        looks={name: found[:, n] for n, name in enumerate(LOOKED)},
    )

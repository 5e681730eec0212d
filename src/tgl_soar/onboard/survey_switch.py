"""SRV_START, the switch of the survey: what it looks at, where its line goes, what it says.

The law is `control.survey`.  Its line is taken as the search's is (`line_moves`), and slides at
SRV_SPEED as long as SRV_START is not 0.  All that it does is in the parameters, so that a log
repeats it, and shows by SRV_START when it went which way.
"""

from __future__ import annotations

from math import isfinite
from typing import Final

from tgl_soar.autopilot import Output
from tgl_soar.control.forecast import OFF
from tgl_soar.control.laws import SEARCH_NONE, SEARCH_OFF
from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.control.survey import (
    BEGINS,
    DONE,
    DOWNSTREAM,
    HOMEWARD,
    IDLE,
    LOOK_S,
    NOT_HELD,
    STOPPED,
    SURVEY_TEXTS,
    UPSTREAM,
    SurveyLook,
    SurveyState,
    is_cut_short,
    stopped,
    survey_begun,
    survey_moved,
    survey_place,
    survey_task,
)
from tgl_soar.control.target_line import LineTracking, TargetLine
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.line_moves import is_moved, open_fence
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup, bounds_of

NO_SEARCH: Final = (SEARCH_OFF, SEARCH_NONE)
PROGRESS_S: Final = 15.0  # between two words of where it is
WAYS: Final = {DOWNSTREAM: "downstream", UPSTREAM: "upstream", HOMEWARD: "home"}


def look_of(output: Output) -> SurveyLook:
    """What a survey sees of a tick."""
    vehicle = output.vehicle
    return SurveyLook(
        time_s=vehicle.time_s,
        x_m=vehicle.x_m,
        z_m=vehicle.z_m,
        climb_mps=vehicle.climb_mps,
        airspeed_mps=output.air.airspeed_mps,
        stall_rad=output.margins.stall_rad,
        line=output.line,
        forecast=output.forecast,
        held=output.mode in (CAPTURING, SOARING),
    )


# Whoever sets one of these has said where the line is to be.
PLACING: Final = frozenset(
    ("TGL_X", "TGL_Z", "TGL_LEAN", "TGL_PRESET", "TGL_PLACE", "TGL_HOLD", "TGL_ALONG")
)


class SurveySwitch:
    """Follows the survey from tick to tick."""

    def __init__(self, setup: ModuleSetup, settings: FlightSettings, outbox: Outbox) -> None:
        self._settings = settings
        self._outbox = outbox
        self._bounds = bounds_of(setup, ())
        self._state: SurveyState | None = None  # None: there is none
        self._output: Output | None = None  # of the last tick
        self._reported_s = 0.0  # when it said last where it is

    def refusal(self, value: float) -> str:
        """Why SRV_START may not be set to this; "" if it may."""
        values, output = self._settings.values, self._output
        if value == IDLE:
            return ""
        if value != DOWNSTREAM:
            return "set 1 to survey, 0 to end it: the others are what the module shows"
        if self._state is not None:
            return "a survey is under way"
        if values["SRCH_START"] not in NO_SEARCH:
            return "a search has the line: set SRCH_START to 0 first"
        if values["TGL_HOLD"] != 0.0:
            return "a point of the line is held, not the contour: set TGL_HOLD to 0 first"
        if output is None or output.mode != SOARING or output.line.moving:
            return "it does not soar on a line that stands still"
        return self._lacks()

    def _lacks(self) -> str:
        """What a survey's guards need and do not have, before it and under way; "" for nothing."""
        values = self._settings.values
        if not isfinite(self._settings.laws.wind.aerodynamics.polar.c0):
            return "the airframe file has no [polar] and [model] to foresee the air by"
        if values["FC_ACT"] == OFF:
            return "the forecast is off: set FC_ACT to 1 or more"
        if values["CLEAR_MIN"] == 0.0:
            return "CLEAR_MIN is 0: what a survey keeps from fence and ground follows from it"
        return open_fence(self._settings)

    def tick(self, output: Output) -> None:
        """A tick has gone by, and its command is on its way."""
        self._output = output
        wanted = self._settings.values["SRV_START"] != IDLE
        if not (wanted or self._state is not None):
            return
        if not output.active or self._settings.values["SRCH_START"] not in NO_SEARCH:
            over = "a search has begun" if output.active else SURVEY_TEXTS[NOT_HELD]
            self._end(SEVERITY_WARNING, f"survey ended: {over}")
        elif not wanted:
            assert self._state is not None
            stays = self._halt(self._state, output.line)
            self._end(SEVERITY_INFO, f"survey ended by the operator; the line {stays}")
        else:
            self._survey(output)

    def taken_back(self, name: str) -> None:
        """An operator has set a parameter of the line: it is theirs.  Where that says nothing of
        the line's place, the line stays where it is."""
        if self._state is None and self._settings.values["SRV_START"] == IDLE:
            return
        text = f"survey ended: {name} was set by hand"
        if name not in PLACING and self._state is not None and self._output is not None:
            stays = self._halt(self._state, self._output.line)
            text = f"survey ended by {name}: the line {stays}"
        self._end(SEVERITY_INFO, text)

    def _survey(self, output: Output) -> None:
        look, before = look_of(output), self._state
        if before is None:
            self._state, self._reported_s = survey_begun(look), look.time_s
            speed = self._settings.laws.line.speed_mps
            self._outbox.tell(SEVERITY_INFO, f"{BEGINS} {speed:.2g} m/s")
            return
        if 0.0 <= look.time_s - before.time_s < LOOK_S - 1e-6:
            return
        lacks = self._lacks()
        if lacks:
            stays = self._halt(before, output.line)
            self._end(SEVERITY_WARNING, f"survey ended: {lacks}; the line {stays}")
            return
        after = survey_moved(survey_task(self._settings.laws), before, look, self._move)
        stays = "stays"
        if after.standing == STOPPED:
            stays = self._halt(after, output.line)
        self._state = after
        if after.standing in WAYS:
            self._tell_way(before, after)
            return
        if after.standing == DONE and not is_cut_short(after):
            self._end(SEVERITY_INFO, "survey: done")
        else:
            where = "is home" if after.standing == DONE else stays
            reason = SURVEY_TEXTS[after.reason]
            self._end(SEVERITY_WARNING, f"survey ended: {reason}; the line {where}")

    def _tell_way(self, before: SurveyState, after: SurveyState) -> None:
        """Where it turns, and now and then where it is."""
        x_m, z_m = survey_place(after)
        place = f"x {x_m:.2f}, z {z_m:.2f} m"
        if after.standing != before.standing:
            severity = SEVERITY_WARNING if is_cut_short(after) else SEVERITY_INFO
            reason, way = SURVEY_TEXTS[after.reason], WAYS[after.standing]
            self._outbox.tell(severity, f"survey: {way} from {place}: {reason}")
            self._settings.assign("SRV_START", float(after.standing))
            self._reported_s = after.time_s
        elif not 0.0 <= after.time_s - self._reported_s < PROGRESS_S:
            self._outbox.tell(SEVERITY_INFO, f"survey: {WAYS[after.standing]}, {place}")
            self._reported_s = after.time_s

    def _halt(self, state: SurveyState, line: LineTracking) -> str:
        """The line goes no farther than it is; where the bounds do not have it there, through where
        the aircraft is in the mean.  What it does."""
        x_m, z_m = survey_place(state)
        for target in (
            stopped(state, line, IDLE).target,
            TargetLine(x_m, z_m, state.start.eta_rad),
            state.start,
        ):
            if self._move(target):
                return "goes home" if target == state.start else "stays"
        return "goes on to where it was sent: set it by hand"

    def _move(self, target: TargetLine) -> bool:
        return is_moved(self._settings, self._bounds, target)

    def _end(self, severity: int, text: str) -> None:
        self._outbox.tell(severity, text)
        self._state = None
        if self._settings.values["SRV_START"] != IDLE:
            self._settings.assign("SRV_START", IDLE)

"""SRCH_START, the switch of the search for lift: what is reported to it, and what it may do.

The map and its rollouts are beside the tick (`search_process`).  What the tick knows is reported to
them every `LOOK_S`, and what they answer is a line.  It is taken as an operator's: within fence and
clearance, in the parameters that everybody sees, and it slides at TGL_SLEW.  Two things are not
asked: the contour of the site, which is of another day's wind, and TGL_STEP_MAX, which guards
against slips of the hand.  An answer that is late or never comes ends the search; the line
goes on to where it was sent last.

Every answer says which glimpse it is of, and of which search: what an ended search or flight had
asked for is not obeyed, and late is who answers glimpses of LATE_S ago.

Where FC_ACT is 4 the module starts a search by itself when no place to settle is foreseen.  Where
it cannot, SRCH_START is SEARCH_NONE, so that the laws and a log know it, and that is reported.
"""

from __future__ import annotations

from math import cos, isfinite, radians, sin
from typing import Final, Protocol

from tgl_soar.autopilot import Output
from tgl_soar.control.forecast import SEARCH_FIRST, nowhere
from tgl_soar.control.laws import (
    SEARCH_GIVEN_UP,
    SEARCH_LOOKS,
    SEARCH_NONE,
    SEARCH_OFF,
    SEARCH_SOARS,
    Laws,
)
from tgl_soar.control.search.glimpse import (
    GIVEN_UP,
    LOOK_S,
    REASONS,
    SOARING,
    Glimpse,
    LineRequest,
    SearchTask,
    task_of,
)
from tgl_soar.control.supervisor import BEATING, HOLDING, LAUNCHING, RECOVERING, goes_home
from tgl_soar.control.target_line import TargetLine, e_rho, eta_from_lean
from tgl_soar.control.throttle import can_hold
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.line_moves import is_moved, open_fence
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.settings import FlightSettings
from tgl_soar.onboard.setup import ModuleSetup, bounds_of
from tgl_soar.types import NAN, VehicleState

# A plan is due once a second and takes a few hundredths: three of them missed is no search.
LATE_S: Final = 3.0
ACTS_AS_2: Final = "FC_ACT 4 acts as 2"
UNASKED: Final = (HOLDING, RECOVERING)  # without a place, or thrown about


class SearchEngine(Protocol):
    """Who has the map and the rollouts."""

    def begin(self, task: SearchTask) -> bool:
        """Another place, polar or slew than before; whether it was sent.  It never waits."""

    def send(self, glimpse: Glimpse | None) -> bool:
        """What the module knows; None: the flight is over.  Whether it was sent; it never waits."""

    def receive(self) -> LineRequest | None:
        """The newest answer, once; None: there is no new one.  It never waits."""

    @property
    def failure(self) -> str:
        """Why there will be none any more; "" while there may be."""


class SearchSwitch:
    """Follows the search from tick to tick."""

    def __init__(
        self,
        setup: ModuleSetup,
        settings: FlightSettings,
        outbox: Outbox,
        engine: SearchEngine | None,
    ) -> None:
        """`engine`: None: there is no search in this process."""
        self._settings = settings
        self._outbox = outbox
        self._engine = engine
        self._bounds = bounds_of(setup, ())
        self._laws: Laws | None = None  # that the engine knows
        self._task: SearchTask | None = None  # of these
        self._owes_end = False  # it does not know yet that the last flight is over
        self._before: VehicleState | None = None  # at the last glimpse
        self._wind = self._updraft = self._pushed = 0.0  # sums since then
        self._count = 0
        self._was_active = False
        self._goes_home = self._beats = False
        self._search = 0  # its number: another one for each that begins, and after each that ends
        self._seeks = False
        # Of the glimpse that was answered last, or when one was asked first; NaN: none was.
        self._answered_s = NAN
        self._target: TargetLine | None = None  # the last that was taken
        self._refused: TargetLine | None = None  # not reported to the search yet
        self._has_begun = False  # by itself, in this flight

    @property
    def _standing(self) -> int:
        return int(self._settings.values["SRCH_START"])

    @property
    def _is_wanted(self) -> bool:
        return self._standing in (SEARCH_LOOKS, SEARCH_SOARS)

    def refusal(self) -> str:
        """Why no search can begin now; "" if it can."""
        if self._goes_home:
            return "it goes home: set ESC_START to 2 first, to soar on"
        if self._beats:
            return "it beats along the ridge: no line is flown that a search could move"
        return self._lacks()

    def _lacks(self) -> str:
        """What a search needs and does not have, before it and under way; "" for nothing."""
        if self._engine is None:
            return "there is no search in this process"
        if self._engine.failure:
            return self._engine.failure
        if not isfinite(self._settings.laws.wind.aerodynamics.polar.c0):
            return "the airframe file has no [polar] and [model] to read the air by"
        if self._settings.values["CLEAR_MIN"] == 0.0:
            return "CLEAR_MIN is 0: the height for landing that a search keeps follows from it"
        return open_fence(self._settings)

    def tick(self, output: Output) -> None:
        """A tick has gone by, and its command is on its way."""
        self._goes_home, self._beats = goes_home(output.mode), output.mode == BEATING
        if not output.active:
            self._landed()
            return
        self._was_active = True
        if self._goes_home or self._beats:
            self._end_without_line()
            return
        self._show_whether_one_can_begin()
        engine = self._engine
        if engine is None:
            return
        if output.mode == LAUNCHING:  # a hand carries what the air does not: nothing is asked yet
            self._before, self._answered_s = None, NAN
            return
        if self._standing == SEARCH_OFF:
            self._start_by_forecast(output)
        if self._seeks != self._is_wanted:
            self._renew(seeks=self._is_wanted)
        self._look(engine, output)
        if self._seeks:
            self._follow(engine, output)

    def taken_back(self) -> None:
        """An operator has set a parameter of the line: it is theirs."""
        if self._is_wanted and self._was_active:
            self._end(SEVERITY_INFO, "search ended: the line was set by hand")

    def _landed(self) -> None:
        """The module is not in control: what was searched in that flight is over."""
        if not self._was_active:
            self._tell_end()
            return
        self._was_active = False
        self._before, self._laws, self._task = None, None, None
        self._has_begun, self._owes_end = False, True
        self._renew(seeks=False)
        self._tell_end()
        if self._standing != SEARCH_OFF:
            self._settings.assign("SRCH_START", SEARCH_OFF)

    def _end_without_line(self) -> None:
        """No line is flown there, and whoever soars on from there starts again."""
        if self._is_wanted:
            where = "goes home" if self._goes_home else "beats along the ridge"
            self._end(SEVERITY_INFO, f"search ended: it {where}")
        elif self._standing != SEARCH_OFF:
            self._settings.assign("SRCH_START", SEARCH_OFF)
        if self._seeks:
            self._renew(seeks=False)
        self._before = None

    def act_was_set(self) -> None:
        """An operator has set FC_ACT; in control the next tick sees it."""
        acts = self._settings.values["FC_ACT"] == SEARCH_FIRST
        if acts and not self._was_active and (why := self._lacks()):
            self._outbox.tell(SEVERITY_WARNING, f"{ACTS_AS_2}: {why}")

    def _show_whether_one_can_begin(self) -> None:
        """By itself, where FC_ACT is 4: once in a flight, so that nobody's line is taken away again
        who took it back."""
        standing, why = self._standing, ""
        if standing not in (SEARCH_OFF, SEARCH_NONE):
            return
        if self._settings.values["FC_ACT"] == SEARCH_FIRST:
            why = "its search is over" if self._has_begun else self._lacks()
        shown = SEARCH_NONE if why else SEARCH_OFF
        if shown != standing:
            self._settings.assign("SRCH_START", shown)
            if why:
                self._outbox.tell(SEVERITY_WARNING, f"{ACTS_AS_2}: {why}")

    def _start_by_forecast(self, output: Output) -> None:
        """FC_ACT 4: a line that holds no place is left for one that does."""
        if self._settings.values["FC_ACT"] == SEARCH_FIRST and nowhere(output.forecast):
            self._has_begun = True
            self._settings.assign("SRCH_START", SEARCH_LOOKS)
            self._outbox.tell(SEVERITY_WARNING, "no place to settle is foreseen: searching")

    def _look(self, engine: SearchEngine, output: Output) -> None:
        """A glimpse for the search, where one is due."""
        if output.mode in UNASKED:
            self._before = None
            return
        self._wind += output.air.wind_mps
        self._updraft += output.air.updraft_mps
        self._pushed += output.throttle.climb_mps
        self._count += 1
        before = self._before
        if before is not None and 0.0 <= output.time_s - before.time_s < LOOK_S - 1e-6:
            return
        if before is not None and not self._lacks():
            glimpse = Glimpse(
                before=before,
                now=output.vehicle,
                line=output.line,
                wind_mps=self._wind / self._count,
                updraft_mps=self._updraft / self._count,
                pitot=output.air.measured,
                seeks=self._seeks,
                refused=self._refused,
                pushed_mps=self._pushed / self._count,
                carried=can_hold(
                    self._settings.laws.throttle,
                    output.throttle.used_s,
                    min(0.0, output.vehicle.climb_mps),
                    output.air.airspeed_mps,
                ),
                search=self._search,
            )
            if self._is_reported_to(engine) and engine.send(glimpse):
                self._refused = None
        self._before = output.vehicle
        self._wind = self._updraft = self._pushed = 0.0
        self._count = 0

    def _tell_end(self) -> None:
        """What found no room is sent again."""
        if self._owes_end and self._engine is not None:
            self._owes_end = not self._engine.send(None)

    def _is_reported_to(self, engine: SearchEngine) -> bool:
        """Whether it knows that the flight before is over, and its task: sent until it is."""
        self._tell_end()
        if self._owes_end:
            return False
        laws = self._settings.laws
        if laws is not self._laws:
            task = self._task_of(laws)
            if task != self._task and not engine.begin(task):
                return False
            self._laws, self._task = laws, task
        return True

    def _task_of(self, laws: Laws) -> SearchTask:
        values = self._settings.values
        return task_of(laws)._replace(
            eta_min_rad=eta_from_lean(radians(values["TGL_LEAN_MIN"])),
            eta_max_rad=eta_from_lean(radians(values["TGL_LEAN_MAX"])),
        )

    def _renew(self, *, seeks: bool) -> None:
        """A search begins or is over: answers to what was asked before are not this one's."""
        self._search += 1
        self._seeks = seeks
        self._answered_s, self._target, self._refused = NAN, None, None

    def _follow(self, engine: SearchEngine, output: Output) -> None:
        """Take its answer; without one for too long, or without what it needs, it is over."""
        if lacks := self._lacks():
            self._end(SEVERITY_ERROR, f"search ended: {lacks}")
            return
        now_s = output.time_s
        # NaN: it was asked just now.  In these modes nobody is asked, so that nobody is late.
        if output.mode in UNASKED or not self._answered_s <= now_s:
            self._answered_s = now_s
        request = engine.receive()
        if (
            request is not None
            and request.search == self._search
            and 0.0 <= now_s - request.time_s <= LATE_S  # false for NaN
        ):
            self._answered_s = max(self._answered_s, request.time_s)
            self._obey(request)
        elif engine.failure:
            self._end(SEVERITY_ERROR, f"search ended: {engine.failure}")
        elif now_s - self._answered_s > LATE_S:
            self._end(SEVERITY_ERROR, f"search ended: no answer for {LATE_S:g} s")

    def _obey(self, request: LineRequest) -> None:
        settings, standing = self._settings, self._standing
        if request.status == GIVEN_UP:
            height = f"{request.over_ground_m:.1f} m over the ground"
            self._outbox.tell(SEVERITY_WARNING, f"search: {REASONS[request.reason]}; {height}")
            settings.assign("SRCH_START", SEARCH_GIVEN_UP)
            return
        if request.target != self._target:
            self._target = request.target
            self._move(request)
        now = SEARCH_SOARS if request.status == SOARING else SEARCH_LOOKS
        if now != standing:
            settings.assign("SRCH_START", now)

    def _move(self, request: LineRequest) -> None:
        """The line as the parameters have it; its point where the aircraft is to settle."""
        target = request.target
        places = (*_settled_on(target, request.place_x_m, request.place_z_m), target[:2])
        lines = (TargetLine(x_m, z_m, target.eta_rad) for x_m, z_m in places)
        if not any(is_moved(self._settings, self._bounds, line) for line in lines):
            self._refused = target

    def _end(self, severity: int, text: str) -> None:
        """The line goes on to where it was sent last."""
        self._outbox.tell(severity, text)
        self._settings.assign("SRCH_START", SEARCH_OFF)
        self._renew(seeks=False)


def _settled_on(target: TargetLine, x_m: float, z_m: float) -> tuple[tuple[float, float], ...]:
    """The point of the line nearest a place; nothing where that is not known."""
    if not isfinite(x_m + z_m):
        return ()
    across_m = e_rho(target.x_m, target.z_m, target.eta_rad, x_m, z_m)
    eta = target.eta_rad
    return ((x_m + across_m * sin(eta), z_m - across_m * cos(eta)),)

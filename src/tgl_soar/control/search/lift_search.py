"""The whole search: a glimpse of the flight goes in, a line comes out.

The map listens to every glimpse; a plan is made, and the line moved, only where one is wanted.
"""

from __future__ import annotations

from math import hypot, inf, isfinite, pi
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.control.search.glimpse import Glimpse, LineRequest, SearchTask
from tgl_soar.control.search.plan import (
    DRAWS,
    FLOWN_THROUGH_MPS,
    SPREAD,
    Leeway,
    LinePlan,
    horizon_of,
    likely_fields,
    plan_in,
)
from tgl_soar.control.search.rollout import Grid, Guards, Moving, RollOut, floor_at, roll_out
from tgl_soar.control.search.search import (
    SearchState,
    kept,
    plan_due,
    search_step,
    started,
)
from tgl_soar.control.target_line import LineState, TargetLine, e_rho
from tgl_soar.estimation.ground_range import ground_slope
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.lift_map import LiftMap, Reading
from tgl_soar.types import GRAVITY_MPS2, NAN, GlidePolar

AVERAGING_S: Final = 0.2  # of a reading: what is left of gusts has this much behind it
SPEED_MAX_MARGIN: Final = 1.0
LANDING: Final = 1.5  # of CLEAR_MIN: half of it is left when recovering would begin
# So long a line that was refused is left out: plans enough to move elsewhere or to give up.
REFUSED_S: Final = 10.0


class Sighting(NamedTuple):
    """A glimpse as the search takes it."""

    time_s: float
    dt_s: float  # since the last one
    reading: Reading  # averages since then
    moving: Moving
    climb_mps: float
    over_ground_m: float
    guards: Guards
    pitot: bool
    carried: bool


def guards_of(task: SearchTask) -> Guards:
    """What rollouts keep within."""
    fence = task.fence
    return Guards(
        box=Box(fence.x_min_m, fence.x_max_m, fence.z_min_m, fence.z_max_m),
        ground=task.ground,
        clearance_m=task.clearance_min_m,
        landing_m=LANDING * task.clearance_min_m,
        speed_min_mps=task.polar.speed_min_mps - FLOWN_THROUGH_MPS,
        speed_max_mps=task.polar.speed_max_mps + SPEED_MAX_MARGIN,
        line=task.line,
    )


def sighting_of(guards: Guards, glimpse: Glimpse) -> Sighting | None:
    """A glimpse with what follows from it; None: the position is not known."""
    old, new, line = glimpse.before, glimpse.now, glimpse.line
    dt = new.time_s - old.time_s
    if not (isfinite(new.x_m + new.z_m + old.x_m + old.z_m + line.x_m) and dt > 0.0):
        return None
    airspeed = glimpse.wind_mps - 0.5 * (old.velocity_x_mps + new.velocity_x_mps)
    climb = (new.z_m - old.z_m) / dt
    change = (new.velocity_x_mps - old.velocity_x_mps) / dt
    reading = Reading(
        x_m=0.5 * (old.x_m + new.x_m),
        z_m=0.5 * (old.z_m + new.z_m),
        wind_mps=glimpse.wind_mps,
        updraft_mps=glimpse.updraft_mps,
        airspeed_mps=airspeed,
        energy_mps=climb - glimpse.pushed_mps - airspeed / GRAVITY_MPS2 * change,
        since_s=dt,
    )
    across_mps = e_rho(0.0, 0.0, line.eta_rad, new.velocity_x_mps, new.climb_mps)
    flown = LineState(
        x_m=line.x_m,
        z_m=line.z_m,
        eta_rad=line.eta_rad,
        speed_mps=across_mps - line.e_rho_rate_mps if line.moving else 0.0,
        moving=line.moving,
    )
    return Sighting(
        time_s=new.time_s,
        dt_s=dt,
        reading=reading,
        moving=Moving(new.x_m, new.z_m, new.climb_mps, flown),
        climb_mps=climb,
        over_ground_m=new.z_m - float(floor_at(guards.ground, new.x_m, guards.box.z_min_m)),
        guards=guards,
        pitot=glimpse.pitot,
        carried=glimpse.carried,
    )


def landing_height(look: Sighting) -> float:
    """Height [m] over the ground here at which a search is over: that which landing needs, or where
    the ground is so steep that CLEAR_MIN, which is along its normal, is gone before, that one."""
    guards = look.guards
    slope = ground_slope(guards.ground, look.moving.x_m)
    return max(guards.landing_m, guards.clearance_m * hypot(1.0, slope))


class LiftSearch:
    """The search of one flight."""

    def __init__(self, polar: GlidePolar) -> None:
        self.polar = polar
        self.roll: RollOut = roll_out  # or the same compiled, in simulation
        self.state: SearchState | None = None  # None: no line was wanted yet
        self.plan: LinePlan | None = None  # the last
        self.leans_rad = (0.0, pi)  # the inclinations that a line may have
        self._refused: list[tuple[float, TargetLine]] = []  # since when, and the line
        self._last_reading_s = inf
        self._map: LiftMap | None = None
        self._grid: Grid | None = None
        self._normals = np.zeros((DRAWS, 0))
        self._trend_normals = np.zeros(DRAWS)

    @property
    def map(self) -> LiftMap:
        """What is known of the air.  Errors: ValueError before a reading of a wind."""
        if self._map is None:
            raise ValueError("no wind was read yet")
        return self._map

    @property
    def grid(self) -> Grid:
        """The nodes of the rollouts.  Errors: as `map`."""
        if self._grid is None:
            raise ValueError("no wind was read yet")
        return self._grid

    def listen(self, look: Sighting) -> None:
        """Take a reading; the first that has a wind begins the map."""
        reading = look.reading
        if self._map is None:
            if not reading.wind_mps > 0.0:
                return
            self._map = LiftMap(
                look.guards.ground, look.guards.box, self.polar, reading, pitot=look.pitot
            )
            self._grid = Grid(self._map.basis, look.guards.ground)
            rng = np.random.default_rng(0)
            self._normals = rng.normal(size=(DRAWS, self._map.basis.count))
            self._trend_normals = rng.normal(size=DRAWS)
        gap_s = look.time_s - look.dt_s - self._last_reading_s
        self._last_reading_s = look.time_s
        try:
            self._map.take(reading, gap_s if gap_s > 0.5 * look.dt_s else 0.0)
        except np.linalg.LinAlgError:  # what no aircraft measures
            self._map = self._grid = None

    def rest(self) -> None:
        """No line is wanted any more; the next search begins from the start, with the same map."""
        self.state = self.plan = None
        self._refused = []

    def stays(self, look: Sighting, refused: TargetLine) -> None:
        """A line that it requested was refused, and is left out: the line is where it is, unless
        another was requested since."""
        line = look.moving.line
        if self.state is not None:
            self._refused.append((look.time_s, refused))
            if self.state.target == refused:
                here = TargetLine(line.x_m, line.z_m, line.eta_rad)
                self.state = self.state._replace(target=here)

    def seek(self, look: Sighting, *, plans: bool = True) -> LineRequest:
        """Where the line is to go, after `listen`; plans: a plan may be made."""
        line = look.moving.line
        look = look._replace(carried=self._carried(look))
        if self.state is None:
            self.state = started(TargetLine(line.x_m, line.z_m, line.eta_rad))
        plan = None
        if plans and self._map is not None and plan_due(self.state):
            plan = self.plan = self.planned(look, self.state)
        self.state = search_step(
            self.state,
            look.guards._replace(landing_m=landing_height(look)),
            plan,
            look.climb_mps,
            look.over_ground_m,
            line.moving,
            look.dt_s,
            under_ceiling_m=look.guards.box.z_max_m - look.moving.z_m,
            carried=look.carried,
        )
        place = self.plan
        return LineRequest(
            target=self.state.target,
            status=self.state.status,
            reason=self.state.reason,
            place_x_m=NAN if place is None else place.place_x_m,
            place_z_m=NAN if place is None else place.place_z_m,
            over_ground_m=look.over_ground_m,
        )

    def _carried(self, look: Sighting) -> bool:
        """Whether power keeps it there.  Not in a wind too slow to hover in: whatever pushes it, it
        must fly faster than that not to stall, and so upstream."""
        if not look.carried or self._map is None:
            return look.carried
        wind_mps = self._map.at([look.moving.x_m], [look.moving.z_m]).wind_mps[0]
        return bool(wind_mps >= look.guards.speed_min_mps)

    def planned(self, look: Sighting, state: SearchState) -> LinePlan:
        """The best line by the map as it is."""
        draws = self.map.draws(self._normals, SPREAD)
        over_s = horizon_of(look.guards.box.height_m)
        drawn = self.map.draws_ahead(self._normals, self._trend_normals, over_s)
        fields = likely_fields(self.grid, self.map.mean(), draws, self.map.ahead(over_s), drawn)
        # With power no height runs out.
        guards = look.guards._replace(landing_m=0.0) if look.carried else look.guards
        self._refused = [r for r in self._refused if 0.0 <= look.time_s - r[0] < REFUSED_S]
        # White gusts: means over T have the variance 2 σ² τ / T, so D = σ² τ is half of it times T.
        diffusion = 0.5 * self.map.gusts_mps2 * AVERAGING_S
        return plan_in(
            self.grid,
            fields,
            self.polar,
            guards,
            now=look.moving,
            target=state.target,
            diffusion_m2ps=diffusion,
            keep=kept(state),
            roll=self.roll,
            leeway=Leeway(*self.leans_rad, tuple(line for _, line in self._refused)),
        )


class Seeker:
    """The search for a module that sends glimpses: one for all of its flights."""

    def __init__(self) -> None:
        self._task: SearchTask | None = None
        self._guards: Guards | None = None
        self.search: LiftSearch | None = None
        self._number = 0  # of the search that asked last

    def begin(self, task: SearchTask) -> None:
        """How the line may be moved has changed, or the place: then the map is reset."""
        before, self._task = self._task, task
        self._guards = guards_of(task)
        if (
            before is None
            or before.fence != task.fence
            or before.ground != task.ground
            or before.polar != task.polar
        ):
            self.search = None

    def take(self, glimpse: Glimpse | None, *, plans: bool = True) -> LineRequest | None:
        """A glimpse, in order; None: the flight is over, and what was measured in it is past.
        plans: not where it is known to be an old one."""
        if glimpse is None or self._guards is None or self._task is None:
            self.search = None
            return None
        look = sighting_of(self._guards, glimpse)
        if look is None:
            return None
        if self.search is None:
            self.search = LiftSearch(self._task.polar)
        self.search.leans_rad = (self._task.eta_min_rad, self._task.eta_max_rad)
        self.search.listen(look)
        if glimpse.search != self._number:
            self._number = glimpse.search
            self.search.rest()
        if glimpse.refused is not None:
            self.search.stays(look, glimpse.refused)
        if not glimpse.seeks:
            self.search.rest()
            return None
        request = self.search.seek(look, plans=plans)
        return request._replace(time_s=glimpse.now.time_s, search=glimpse.search)

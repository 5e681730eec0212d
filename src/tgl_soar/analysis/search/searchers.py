"""Who moves the line: the map with its rollouts, the oracle, and the baselines.

Baselines claim and give up by the same rules as the search, less what they have no map for: the
line has been still for CLAIM_S, the aircraft neither climbs nor sinks; and they give up when the
height that landing needs is near.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, pi, sin
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.analysis.search.compiled_rollouts import fastest_roll_out
from tgl_soar.analysis.search.episode import Searcher
from tgl_soar.analysis.search.places import Kind, SearchPlace
from tgl_soar.control.search.glimpse import (
    GIVEN_UP,
    LOOKING,
    NO_REASON,
    SOARING,
    TOO_LOW,
    LineRequest,
)
from tgl_soar.control.search.lift_search import (
    AVERAGING_S,
    LiftSearch,
    Sighting,
    landing_height,
)
from tgl_soar.control.search.plan import plan_in
from tgl_soar.control.search.rollout import Fields, Grid
from tgl_soar.control.search.search import (
    CLAIM_CLIMB_MPS,
    CLAIM_S,
    KEEP_CLIMB_MPS,
    REACTION_S,
    climb_s,
    plan_due,
    search_step,
    started,
)
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.estimation.lift_map.basis import FlowBasis
from tgl_soar.types import NAN, GlidePolar


class Snapshot(NamedTuple):
    """The map at one time, for figures."""

    time_s: float
    weights: np.ndarray
    excess_sd_mps: np.ndarray  # on the grid's nodes
    excess_mps: np.ndarray


class MapSearch(LiftSearch):
    """The search that flies, with its rollouts compiled, and its map kept for figures."""

    def __init__(self, polar: GlidePolar, keep: tuple[float, ...] = ()) -> None:
        super().__init__(polar)
        self.roll = fastest_roll_out()
        self.keep = list(keep)
        self.snapshots: list[Snapshot] = []

    def look(self, look: Sighting) -> LineRequest:
        self.listen(look)
        request = self.seek(look)
        self._keep(look)
        return request

    def watch(self, look: Sighting) -> None:
        """Listen alone."""
        self.listen(look)
        self._keep(look)

    def _keep(self, look: Sighting) -> None:
        if self.keep and look.time_s >= self.keep[0]:
            self.keep.pop(0)
            self.snapshots.append(self._snapshot(look.time_s))

    def _snapshot(self, time_s: float) -> Snapshot:
        x, z = np.meshgrid(self.grid.x_m, self.grid.z_m, indexing="ij")
        estimated = self.map.at(x.ravel(), z.ravel())
        return Snapshot(
            time_s,
            self.map.mean(),
            estimated.excess_sd_mps.reshape(x.shape),
            estimated.excess_mps.reshape(x.shape),
        )


class Oracle:
    """The same rollouts and guards in the true fields of now and the end, with the true polar."""

    def __init__(self, look: Sighting, polar: GlidePolar, place: SearchPlace) -> None:
        self.polar, self.place = polar, place
        self.grid = Grid(FlowBasis(look.guards.ground, look.guards.box), look.guards.ground)
        line = look.moving.line
        self.state = started(TargetLine(line.x_m, line.z_m, line.eta_rad))
        self.roll = fastest_roll_out()

    def look(self, look: Sighting) -> LineRequest:
        plan = None
        if plan_due(self.state):
            times = (look.time_s, self.place.duration_s)
            fields = [_true_field(self.grid, self.place.field, t) for t in times]
            both = Fields(
                wind_mps=np.stack([f[0] for f in fields]),
                updraft_mps=np.stack([f[1] for f in fields]),
                sink_scale=np.full(2, self.place.sink_factor),
                ends=np.ones(2),
            )
            gusts = self.place.site.air.turbulence.intensity  # type: ignore[union-attr]
            wind = self.place.field.reference_wind_mps
            diffusion = 0.5 * (gusts * wind) ** 2 * AVERAGING_S
            plan = plan_in(
                self.grid,
                both,
                self.polar,
                look.guards,
                look.moving,
                self.state.target,
                diffusion,
                roll=self.roll,
            )
        self.state = search_step(
            self.state,
            look.guards._replace(landing_m=landing_height(look)),
            plan,
            look.climb_mps,
            look.over_ground_m,
            look.moving.line.moving,
            look.dt_s,
            under_ceiling_m=look.guards.box.z_max_m - look.moving.z_m,
            carried=look.carried,
        )
        return _request(look, self.state.target, self.state.status, self.state.reason)


def _request(look: Sighting, target: TargetLine, status: int, reason: int) -> LineRequest:
    """Of a searcher that foresees no place."""
    return LineRequest(
        target=target,
        status=status,
        reason=reason,
        place_x_m=NAN,
        place_z_m=NAN,
        over_ground_m=look.over_ground_m,
    )


def _true_field(grid: Grid, field: WindField, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    x, z = np.meshgrid(grid.x_m, grid.z_m, indexing="ij")
    u, _, w = field.wind(x, 0.0, z, time_s)
    return u.ravel(), w.ravel()


class Baseline:
    """What all baselines have in common: claims and giving up."""

    def __init__(self, look: Sighting) -> None:
        line = look.moving.line
        self.begin = TargetLine(line.x_m, line.z_m, line.eta_rad)
        self.target = self.begin
        self.height = look.guards.box.height_m
        self.climb = 0.0
        self.still = 0.0
        self.soaring = False
        self.since = 0.0

    def move(self, look: Sighting) -> None:
        """Set the target."""

    def look(self, look: Sighting) -> LineRequest:
        before = self.target
        self.since += look.dt_s
        fraction = min(1.0, look.dt_s / climb_s(self.height))
        self.climb += fraction * (look.climb_mps - self.climb)
        self.move(look)
        moved = look.moving.line.moving or self.target != before
        self.still = 0.0 if moved else self.still + look.dt_s
        if self.soaring:
            self.soaring = not moved and abs(self.climb) < KEEP_CLIMB_MPS
        else:
            self.soaring = self.still >= CLAIM_S and abs(self.climb) < CLAIM_CLIMB_MPS
        left = look.over_ground_m - landing_height(look)
        low = left < REACTION_S * max(-look.climb_mps, 0.0)
        status = SOARING if self.soaring else LOOKING
        if low:
            return _request(look, self.target, GIVEN_UP, TOO_LOW)
        return _request(look, self.target, status, NO_REASON)

    def through(self, look: Sighting, aside_m: float) -> TargetLine:
        """The line at a distance downstream of the aircraft."""
        at = look.moving
        return TargetLine(at.x_m + aside_m, at.z_m, self.begin.eta_rad)


class StartLine(Baseline):
    """The line through the start, as it is."""


class ExtremumSeeking(Baseline):
    """A sine on the line's place, and its place up the slope of the excess updraft that it meets.

    Amplitude, period and gain are fractions of H (0.03 H, four times what the line's slew needs for
    it), the measured excess is high-passed over two periods.
    """

    def __init__(self, look: Sighting) -> None:
        super().__init__(look)
        self.amplitude = 0.03 * self.height
        self.omega = look.guards.line.speed_mps / (2.0 * self.amplitude)
        self.centre, self.slow, self.gradient, self.time = 0.0, 0.0, 0.0, 0.0
        self.settled = 0.0

    def move(self, look: Sighting) -> None:
        self.time += look.dt_s
        period = 2.0 * pi / self.omega
        self.slow += min(1.0, look.dt_s / (2.0 * period)) * (look.reading.energy_mps - self.slow)
        phase = sin(self.omega * self.time)
        product = 2.0 * (look.reading.energy_mps - self.slow) * phase / self.amplitude
        self.gradient += min(1.0, look.dt_s / period) * (product - self.gradient)
        self.settled = self.settled + look.dt_s if abs(self.climb) < CLAIM_CLIMB_MPS else 0.0
        if self.settled > 2.0 * period and self.time > 4.0 * period:
            return  # at rest: leave it
        step = 0.15 * self.height * self.gradient * look.dt_s
        most = 0.5 * look.guards.line.speed_mps * look.dt_s
        self.centre += max(-most, min(most, step))
        self.target = TargetLine(
            self.begin.x_m + self.centre + self.amplitude * phase,
            self.begin.z_m,
            self.begin.eta_rad,
        )


class Walk(Baseline):
    """AOSoar's walk with its public constants (tudelft/paparazzi, never_landing_drone), on a line.

    Eight neighbours of the place and a step back; cost 0.1 throttle + |vx| + |vz| + 10 |q|, of
    which without a throttle |vx| + |vz| is left (the loop's q is the same everywhere); steps of
    3–15 cm in a tunnel and 0.1–1 m on a hill; ten stays in a row end it.  A place in the plane
    becomes the line through it: that is all that can be held without a throttle.  How long it
    looks at a place, the annealing and its threshold on this cost are ours.
    """

    STAY_S: Final = 2.0

    STEPS_M: Final[dict[Kind, tuple[float, float]]] = {"tunnel": (0.03, 0.15), "hill": (0.1, 1.0)}

    def __init__(self, look: Sighting, kind: Kind, seed: int) -> None:
        super().__init__(look)
        self.rng = np.random.default_rng((seed, 8))
        self.steps = self.STEPS_M[kind]
        self.cost, self.sum, self.count = float("inf"), 0.0, 0
        self.at = self.best = (self.begin.x_m, self.begin.z_m)
        self.temperature = 0.3
        self.stays = 0

    def move(self, look: Sighting) -> None:
        self.sum += abs(look.climb_mps) + abs(look.reading.wind_mps - look.reading.airspeed_mps)
        self.count += 1
        if self.since < self.STAY_S or self.stays >= 10:
            return
        cost = self.sum / self.count
        accepted = cost < self.cost or self.rng.random() < exp(
            (self.cost - cost) / self.temperature
        )
        if accepted:
            self.best, self.cost = self.at, cost
        self.temperature *= 0.95
        self.since, self.sum, self.count = 0.0, 0.0, 0
        if cost < 0.1:  # good enough to stay: its threshold
            self.stays += 1
            return
        self.stays = 0
        angle = self.rng.integers(8) * 0.25 * pi
        step = float(self.rng.uniform(*self.steps))
        self.at = (self.best[0] + step * np.cos(angle), self.best[1] + step * np.sin(angle))
        self.target = TargetLine(float(self.at[0]), float(self.at[1]), self.begin.eta_rad)


class Upright(Baseline):
    """SAOS's rule: with the throttle at zero it drops z and holds x: an upright line."""

    def __init__(self, look: Sighting) -> None:
        super().__init__(look)
        self.target = self.begin._replace(eta_rad=eta_from_lean(0.0))


class RandomLines(Baseline):
    """A random line in the box, until the aircraft neither climbs nor sinks on one."""

    def __init__(self, look: Sighting, place: SearchPlace) -> None:
        super().__init__(look)
        self.rng = np.random.default_rng((place.seed, 9))
        self.stay_s = place.duration_s / 6.0
        self.box = place.box

    def move(self, look: Sighting) -> None:
        if self.since > self.stay_s and abs(self.climb) > CLAIM_CLIMB_MPS:
            self.since = 0.0
            x = float(self.rng.uniform(self.box.x_min_m, self.box.x_max_m))
            self.target = self.through(look, x - look.moving.x_m)


SEARCHERS: Final = (
    "map and rollouts",
    "line through the start",
    "extremum seeking",
    "AOSoar's walk",
    "SAOS's rule",
    "random lines",
    "oracle",
)


def searcher(name: str, place: SearchPlace, polar: GlidePolar, look: Sighting) -> Searcher:
    """A searcher by name, of the first look.  Errors: KeyError."""
    made: dict[str, Callable[[], Searcher]] = {
        "map and rollouts": lambda: MapSearch(polar),
        "line through the start": lambda: StartLine(look),
        "extremum seeking": lambda: ExtremumSeeking(look),
        "AOSoar's walk": lambda: Walk(look, place.kind, place.seed),
        "SAOS's rule": lambda: Upright(look),
        "random lines": lambda: RandomLines(look, place),
        "oracle": lambda: Oracle(look, polar, place),
    }
    return made[name]()

"""Baselines of the search and the oracle by their rules: each limit from both sides, each step
computed by hand, and what the oracle is given of the true air."""

from __future__ import annotations

from math import cos, pi, radians, sin
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.search import searchers as e
from tgl_soar.analysis.search.places import SearchPlace, place
from tgl_soar.analysis.search.searchers import Baseline, ExtremumSeeking, StartLine, Walk
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.glimpse import REASONS
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.control.search.rollout import Guards, Moving, roll_out
from tgl_soar.control.target_line import LineLimits, LineState, TargetLine, eta_from_lean
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.lift_map import Reading
from tgl_soar.types import Ground

ETA = eta_from_lean(radians(15.0))
POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
HEIGHT_M = 20.0
DT_S = 0.2
# The climb is averaged over a quarter of how far rollouts look ahead: 8 s, and H at 1.33 m/s.
AVERAGED_S = 0.25 * (8.0 + HEIGHT_M / 1.33)
FLAT = Ground(2, (-90.0, 90.0, *[90.0] * 6), (0.0,) * 8)
STEEP = Ground(2, (-90.0, 90.0, *[90.0] * 6), (-90.0, 90.0, *[90.0] * 6))
GUARDS = Guards(
    box=Box(x_min_m=-20.0, x_max_m=0.0, z_min_m=0.0, z_max_m=HEIGHT_M),
    ground=FLAT,
    clearance_m=1.0,
    landing_m=1.5,
    speed_min_mps=7.3,
    speed_max_mps=13.0,
    line=LineLimits(0.5, 0.5, radians(5.0)),
)


def sighting(
    climb_mps: float = 0.0,
    *,
    time_s: float = 0.0,
    energy_mps: float = 0.0,
    airspeed_mps: float = 9.0,
    over_ground_m: float = 10.0,
    moving: bool = False,
    guards: Guards = GUARDS,
) -> Sighting:
    """At x -5, z 10 m, in a wind of 9 m/s; the line stands 1 m downstream and 2 m lower."""
    line = LineState(x_m=-4.0, z_m=8.0, eta_rad=ETA, speed_mps=0.0, moving=moving)
    reading = Reading(
        x_m=-5.0,
        z_m=10.0,
        wind_mps=9.0,
        updraft_mps=1.4,
        airspeed_mps=airspeed_mps,
        energy_mps=energy_mps,
        since_s=DT_S,
    )
    return Sighting(
        time_s=time_s,
        dt_s=DT_S,
        reading=reading,
        moving=Moving(-5.0, 10.0, climb_mps, line),
        climb_mps=climb_mps,
        over_ground_m=over_ground_m,
        guards=guards,
        pitot=True,
        carried=False,
    )


def looked(baseline: Baseline, count: int, climb_mps: float = 0.0, **of: Any) -> Any:
    for _ in range(count):
        request = baseline.look(sighting(climb_mps, **of))
    return request


# --- what all have in common ----------------------------------------------------------------------


def test_a_baseline_begins_with_the_line_that_is_flown() -> None:
    line = StartLine(sighting())
    assert line.begin == line.target == TargetLine(-4.0, 8.0, ETA)
    request = line.look(sighting(over_ground_m=7.5))
    assert request.target == TargetLine(-4.0, 8.0, ETA)
    assert (request.over_ground_m, request.soaring, request.given_up) == (7.5, False, "")
    assert np.isnan([request.place_x_m, request.place_z_m]).all()
    assert not Baseline(sighting()).soaring


def test_the_climb_is_averaged_over_a_quarter_of_a_rollouts_horizon() -> None:
    line = StartLine(sighting())
    looked(line, 25, 0.8)
    assert line.climb == pytest.approx(0.8 * (1.0 - (1.0 - DT_S / AVERAGED_S) ** 25))
    assert line.since == pytest.approx(5.0)
    slow = StartLine(sighting())
    slow.look(sighting(0.8)._replace(dt_s=9.0))  # longer than it is averaged over
    assert slow.climb == 0.8


def test_a_claim_is_made_after_six_seconds_of_rest() -> None:
    line = StartLine(sighting())
    assert not looked(line, 29).soaring
    assert line.still == pytest.approx(5.8)
    assert looked(line, 2).soaring


@pytest.mark.parametrize(
    ("climb_mps", "claims"), [(0.049, True), (0.051, False), (-0.049, True), (-0.051, False)]
)
def test_a_claim_is_made_by_who_climbs_or_sinks_less_than_5_cm_a_second(
    climb_mps: float, claims: bool
) -> None:
    line = StartLine(sighting())
    line.climb = climb_mps
    assert looked(line, 40, climb_mps).soaring is claims


@pytest.mark.parametrize(
    ("climb_mps", "kept"), [(0.119, True), (0.121, False), (-0.119, True), (-0.121, False)]
)
def test_a_claim_is_kept_by_who_climbs_or_sinks_less_than_12_cm_a_second(
    climb_mps: float, kept: bool
) -> None:
    line = StartLine(sighting())
    assert looked(line, 40).soaring
    line.climb = climb_mps
    assert line.look(sighting(climb_mps)).soaring is kept


def test_a_line_that_slides_begins_its_rest_again_and_withdraws_the_claim() -> None:
    line = StartLine(sighting())
    assert looked(line, 40).soaring
    assert not line.look(sighting(moving=True)).soaring
    assert line.still == 0.0
    assert not looked(line, 29).soaring
    assert looked(line, 2).soaring


def test_a_line_that_is_sent_elsewhere_begins_its_rest_again() -> None:
    class Once(Baseline):
        def move(self, look: Sighting) -> None:
            if self.since > 7.9 and self.target == self.begin:
                self.target = self.through(look, 0.5)

    line = Once(sighting())
    assert looked(line, 38).soaring
    request = looked(line, 2)
    assert request.target == TargetLine(-4.5, 10.0, ETA)  # through the aircraft, half a metre down
    assert not request.soaring
    assert line.still < 0.3


@pytest.mark.parametrize(
    ("climb_mps", "height_m", "gives_up"),
    [  # two looks of 0.2 s before the height that landing needs
        (-1.5, 1.5 + 0.61, False), (-1.5, 1.5 + 0.59, True), (0.0, 1.51, False),
        (0.0, 1.49, True), (1.5, 1.51, False), (1.5, 1.49, True),
    ],
)  # fmt: skip
def test_it_is_given_up_two_looks_before_the_height_for_landing(
    climb_mps: float, height_m: float, gives_up: bool
) -> None:
    line = StartLine(sighting())
    request = line.look(sighting(climb_mps, over_ground_m=height_m))
    assert request.given_up == (REASONS[2] if gives_up else "")
    assert request.target == line.begin


def test_over_a_slope_the_clearance_along_its_normal_is_the_height_for_landing() -> None:
    guards = GUARDS._replace(ground=STEEP, clearance_m=1.2)  # 1.2 m times the root of two
    for height_m, gives_up in ((1.71, False), (1.68, True)):
        request = StartLine(sighting()).look(sighting(over_ground_m=height_m, guards=guards))
        assert bool(request.given_up) is gives_up


def test_who_has_claimed_gives_up_for_all_that() -> None:
    line = StartLine(sighting())
    assert looked(line, 40).soaring
    low = line.look(sighting(over_ground_m=1.0))
    assert low.given_up
    assert not low.soaring


# --- extremum seeking -----------------------------------------------------------------------------

AMPLITUDE_M = 0.03 * HEIGHT_M
OMEGA = 0.5 / (2.0 * AMPLITUDE_M)  # half of what the line's slew allows at most
PERIOD_S = 2.0 * pi / OMEGA


def test_extremum_seeking_swings_the_line_by_three_hundredths_of_the_height() -> None:
    seeking = ExtremumSeeking(sighting())
    found = np.array([seeking.look(sighting(0.3)).target for _ in range(100)])
    times = DT_S * np.arange(1, 101)
    assert found[:, 0] == pytest.approx(-4.0 + AMPLITUDE_M * np.sin(OMEGA * times))
    assert set(found[:, 1]) == {8.0}
    assert set(found[:, 2]) == {ETA}


def test_extremum_seeking_takes_the_slope_from_what_it_meets_in_phase() -> None:
    """One step by hand: high-passed over two periods, averaged over one."""
    seeking = ExtremumSeeking(sighting())
    energy = 0.02
    seeking.look(sighting(0.3, energy_mps=energy))
    left = energy * (1.0 - DT_S / (2.0 * PERIOD_S))
    phase = sin(OMEGA * DT_S)
    gradient = 2.0 * left * phase / AMPLITUDE_M * DT_S / PERIOD_S
    assert seeking.slow == pytest.approx(energy - left)
    assert seeking.gradient == pytest.approx(gradient)
    centre = 0.15 * HEIGHT_M * gradient * DT_S
    assert seeking.centre == pytest.approx(centre)
    assert seeking.target.x_m == pytest.approx(-4.0 + centre + AMPLITUDE_M * phase)
    # And one more, of nothing: both fade.
    seeking.look(sighting(0.3))
    slow = (energy - left) * (1.0 - DT_S / (2.0 * PERIOD_S))
    product = -2.0 * slow * sin(2.0 * OMEGA * DT_S) / AMPLITUDE_M
    assert seeking.gradient == pytest.approx(gradient + (product - gradient) * DT_S / PERIOD_S)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_extremum_seeking_moves_its_middle_at_half_the_lines_speed_at_most(side: float) -> None:
    seeking = ExtremumSeeking(sighting())
    seeking.gradient = side * 1e3
    looked(seeking, 5, 0.3)
    assert seeking.centre == pytest.approx(side * 5 * 0.5 * 0.5 * DT_S)


def test_extremum_seeking_rests_after_four_periods_of_which_two_were_calm() -> None:
    """It neither climbs nor sinks from the beginning: the fourth period's end is what it takes."""
    steps = int(4.0 * PERIOD_S / DT_S)
    seeking = ExtremumSeeking(sighting())
    looked(seeking, steps)
    before = seeking.target
    looked(seeking, 1)
    stays = seeking.target
    looked(seeking, 20)
    assert seeking.target == stays != TargetLine(-4.0, 8.0, ETA)
    assert before.x_m == pytest.approx(-4.0 + AMPLITUDE_M * sin(OMEGA * steps * DT_S))


def test_extremum_seeking_is_calm_from_its_first_look_on_and_not_before() -> None:
    """Two periods of calm, where four have gone by: 150.8 looks."""
    seeking = ExtremumSeeking(sighting())
    seeking.time = 4.0 * PERIOD_S
    places = [looked(seeking, 1).target.x_m for _ in range(155)]
    assert len(set(places[:150])) == 150
    assert len(set(places[150:])) == 1


def test_extremum_seeking_goes_on_where_it_was_calm_for_less_than_two_periods() -> None:
    seeking = ExtremumSeeking(sighting())
    steps = int(2.0 * PERIOD_S / DT_S)
    looked(seeking, 2 * steps, 1.0)
    assert seeking.settled == 0.0
    seeking.climb = 0.0
    places = {looked(seeking, 1).target.x_m for _ in range(steps - 1)}
    assert len(places) == steps - 1
    looked(seeking, 3)
    stays = seeking.target
    assert looked(seeking, 9).target == stays
    assert seeking.settled > 2.0 * PERIOD_S
    # It begins again as soon as it sinks.
    seeking.climb = -1.0
    assert looked(seeking, 1, -1.0).target != stays
    assert seeking.settled == 0.0


# --- a walk ---------------------------------------------------------------------------------------


class Drawn:
    """A generator of a walk that gives scripted values."""

    def __init__(self, chance: float = 1.0, eighths: int = 1, step_m: float = 0.5) -> None:
        self.chance, self.eighths, self.step_m = chance, eighths, step_m
        self.asked: list[Any] = []

    def random(self) -> float:
        return self.chance

    def integers(self, count: int) -> int:
        self.asked.append(count)
        return self.eighths

    def uniform(self, low: float, high: float) -> float:
        self.asked.append((low, high))
        return self.step_m


def walking(kind: Any = "hill", **drawn: Any) -> tuple[Walk, Drawn]:
    walk, rng = Walk(sighting(), kind, 3), Drawn(**drawn)
    walk.rng = rng  # type: ignore[assignment]
    return walk, rng


@pytest.mark.parametrize(("kind", "steps"), [("tunnel", (0.03, 0.15)), ("hill", (0.1, 1.0))])
def test_a_walk_goes_to_one_of_eight_neighbours_after_two_seconds(
    kind: str, steps: tuple[float, float]
) -> None:
    walk, rng = walking(kind, eighths=3)
    assert looked(walk, 9, 1.0).target == walk.begin
    target = looked(walk, 2, 1.0).target
    assert rng.asked == [8, steps]
    way = (0.5 * cos(0.75 * pi), 0.5 * sin(0.75 * pi))
    assert (target.x_m, target.z_m) == pytest.approx((-4.0 + way[0], 8.0 + way[1]))
    assert target.eta_rad == ETA
    assert walk.best == (-4.0, 8.0)


def test_a_walks_cost_is_the_mean_of_how_fast_it_moves_both_ways() -> None:
    walk, _ = walking()
    for n in range(11):
        sign = 1.0 if n % 2 else -1.0
        walk.look(sighting(0.4 * sign, airspeed_mps=9.0 + 0.3 * sign))
    assert walk.cost == pytest.approx(0.7)
    assert (walk.sum, walk.count) == (0.0, 0)


@pytest.mark.parametrize(("chance", "taken"), [(0.37, False), (0.36, True)])
def test_a_worse_place_is_taken_by_chance_and_else_the_best_is_gone_back_to(
    chance: float, taken: bool
) -> None:
    """0.285 worse at a temperature of 0.95 times 0.3: one in e."""
    walk, _ = walking(chance=chance, eighths=0)
    looked(walk, 11, 0.5)
    first = walk.at
    assert first == pytest.approx((-3.5, 8.0))
    assert walk.temperature == pytest.approx(0.285)
    looked(walk, 11, 0.785)
    assert walk.best == (first if taken else (-4.0, 8.0))
    assert walk.cost == pytest.approx(0.785 if taken else 0.5)
    assert walk.at == pytest.approx((walk.best[0] + 0.5, 8.0))
    assert walk.temperature == pytest.approx(0.3 * 0.95**2)


def test_a_better_place_is_always_taken() -> None:
    walk, _ = walking(chance=1.0, eighths=2)
    looked(walk, 11, 0.9)
    looked(walk, 11, 0.8)
    assert walk.best == pytest.approx((-4.0, 8.5))
    assert walk.at == pytest.approx((-4.0, 9.0))


@pytest.mark.parametrize(("climb_mps", "stays"), [(0.099, 1), (0.101, 0)])
def test_a_walk_stays_where_it_moves_by_less_than_a_tenth_of_a_metre_a_second(
    climb_mps: float, stays: int
) -> None:
    walk, _ = walking()
    looked(walk, 11, climb_mps)
    assert walk.stays == stays
    assert (walk.target == walk.begin) is bool(stays)
    looked(walk, 11, 0.5)
    assert walk.stays == 0


def test_ten_stays_in_a_row_end_a_walk() -> None:
    walk, rng = walking()
    looked(walk, 9 * 11)
    assert walk.stays == 9
    looked(walk, 11)
    assert walk.stays == 10
    looked(walk, 40, 0.9)
    assert walk.stays == 10
    assert walk.target == walk.begin
    assert rng.asked == []


def test_a_walk_is_drawn_by_its_seed() -> None:
    ways = [[looked(walk, 11, 0.5).target for _ in range(6)] for walk in (
        Walk(sighting(), "hill", 3), Walk(sighting(), "hill", 3), Walk(sighting(), "hill", 4)
    )]  # fmt: skip
    assert ways[0] == ways[1] != ways[2]


# --- the others -----------------------------------------------------------------------------------


def test_saos_keeps_the_place_and_stands_the_line_upright() -> None:
    assert e.Upright(sighting()).target == TargetLine(-4.0, 8.0, eta_from_lean(0.0))


def test_random_lines_are_drawn_through_the_height_of_the_aircraft() -> None:
    """After a sixth of the time, where it climbs or sinks."""
    there = place("hill", 3)
    lines = e.RandomLines(sighting(), there)
    steps = int(there.duration_s / 6.0 / DT_S)
    assert steps == 75
    assert looked(lines, steps - 1, 0.5).target == lines.begin
    drawn = [looked(lines, 2, 0.5).target]
    assert lines.since < 2.1 * DT_S
    drawn += [looked(lines, steps + 1, 0.5).target for _ in range(60)]
    x = np.array([each.x_m for each in drawn])
    box = there.box
    width = box.x_max_m - box.x_min_m
    assert len(set(x)) == 61
    assert box.x_min_m <= x.min() < box.x_min_m + 0.2 * width
    assert box.x_max_m - 0.2 * width < x.max() <= box.x_max_m
    assert {each.z_m for each in drawn} == {10.0}
    assert {each.eta_rad for each in drawn} == {ETA}


@pytest.mark.parametrize(("climb_mps", "moves"), [(0.052, True), (-0.052, True), (0.048, False)])
def test_a_random_line_is_left_by_who_climbs_or_sinks_on_it(climb_mps: float, moves: bool) -> None:
    lines = e.RandomLines(sighting(), place("hill", 3))
    lines.climb = climb_mps
    assert (looked(lines, 77, climb_mps).target != lines.begin) is moves


def test_random_lines_are_drawn_by_the_seed_of_the_place() -> None:
    def first(seed: int) -> float:
        lines = e.RandomLines(sighting(), place("hill", 3)._replace(seed=seed))
        return float(looked(lines, 77, 0.5).target.x_m)

    assert first(3) == first(3) != first(4)


NAMES = {
    "map and rollouts": e.MapSearch, "line through the start": StartLine,
    "extremum seeking": ExtremumSeeking, "AOSoar's walk": Walk, "SAOS's rule": e.Upright,
    "random lines": e.RandomLines, "oracle": e.Oracle,
}  # fmt: skip


def test_each_name_is_a_searcher() -> None:
    there = place("hill", 5)
    assert NAMES.keys() == set(e.SEARCHERS)
    assert len(e.SEARCHERS) == 7
    for name, kind in NAMES.items():
        assert type(e.searcher(name, there, POLAR, sighting())) is kind
    walk = e.searcher("AOSoar's walk", there, POLAR, sighting())
    assert isinstance(walk, Walk)
    assert walk.steps == (0.1, 1.0)
    same = Walk(sighting(), "hill", 5)
    assert [looked(walk, 11, 0.5).target for _ in range(3)] == [
        looked(same, 11, 0.5).target for _ in range(3)
    ]
    oracle = e.searcher("oracle", there, POLAR, sighting())
    assert isinstance(oracle, e.Oracle)
    assert (oracle.place, oracle.polar) == (there, POLAR)


# --- the oracle -----------------------------------------------------------------------------------


def here(there: SearchPlace, time_s: float, **of: Any) -> Sighting:
    """In the middle of a place's box."""
    box = there.box
    guards = GUARDS._replace(box=box, ground=there.ground)
    x_m, z_m = 0.5 * (box.x_min_m + box.x_max_m), 0.5 * (box.z_min_m + box.z_max_m)
    line = LineState(x_m=x_m, z_m=z_m, eta_rad=ETA, speed_mps=0.0, moving=False)
    look = sighting(time_s=time_s, guards=guards, **of)
    return look._replace(moving=Moving(x_m, z_m, 0.0, line))


def test_the_oracle_is_given_the_true_air_of_now_and_of_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arguments: list[tuple[Any, ...]] = []

    def plan_in(*given: Any, roll: Any) -> Any:
        arguments.append(given)
        assert roll is roll_out
        return None

    monkeypatch.setattr(e, "plan_in", plan_in)
    there = next(p for p in (place("hill", seed) for seed in range(9)) if p.change != 1.0)
    look = here(there, 4.0)
    oracle = e.Oracle(look, POLAR, there)
    oracle.roll = roll_out
    assert oracle.state.target == TargetLine(look.moving.line.x_m, look.moving.line.z_m, ETA)
    oracle.look(look)
    ((grid, fields, polar, guards, now, target, diffusion),) = arguments
    assert (polar, guards, now) == (POLAR, look.guards, look.moving)
    assert target == TargetLine(look.moving.line.x_m, look.moving.line.z_m, ETA)
    assert fields.sink_scale.tolist() == [there.sink_factor] * 2
    air: Any = there.site.air
    # White gusts: means over T have the variance 2 σ² τ / T, with τ = 0.2 s.
    assert diffusion == pytest.approx(0.5 * (air.turbulence.intensity * air.wind_mps) ** 2 * 0.2)
    nz = grid.z_m.size
    for i, j in ((0, nz - 1), (3, 4), (grid.x_m.size - 1, nz - 2)):
        x_m, z_m = float(grid.x_m[i]), float(grid.z_m[j])
        for row, time_s in ((0, 4.0), (1, there.duration_s)):
            u, _, w = there.field.wind_at(x_m, 0.0, z_m, time_s)
            assert fields.wind_mps[row][i * nz + j] == pytest.approx(u)
            assert fields.updraft_mps[row][i * nz + j] == pytest.approx(w)
    # The next plan is due 0.4 s after that one, two looks later.
    oracle.state = oracle.state._replace(since_plan_s=0.0)
    oracle.look(here(there, 4.2))
    oracle.look(here(there, 4.4))
    assert len(arguments) == 2


def test_the_oracle_flies_where_the_true_air_carries_it() -> None:
    """Of a hill of 7.2 m and a line through its box's middle: it settles on one in true lift."""
    there = place("hill", 3)
    look = here(there, 0.0)
    oracle = e.Oracle(look, POLAR, there)
    oracle.roll = roll_out
    request = oracle.look(look)
    assert request.given_up == ""
    assert request.over_ground_m == look.over_ground_m
    low = oracle.look(here(there, 0.2, over_ground_m=1.0, climb_mps=-1.0))
    assert low.given_up in REASONS[1:]


def test_the_oracle_gives_up_at_the_fences_ceiling_too() -> None:
    """A look before it, where no plan says that it will stay."""
    there = place("hill", 3)
    look = here(there, 0.0)
    for under_m, gives_up in ((0.39, True), (0.41, False)):
        oracle = e.Oracle(look, POLAR, there)
        oracle.state = oracle.state._replace(chance=0.0, since_plan_s=0.0)
        top = look.moving._replace(z_m=there.box.z_max_m - under_m)
        request = oracle.look(look._replace(moving=top, climb_mps=2.0))
        assert request.given_up == (REASONS[3] if gives_up else "")


# --- the map --------------------------------------------------------------------------------------


def test_a_map_is_kept_at_the_times_that_are_asked_for() -> None:
    search = e.MapSearch(POLAR, (0.3, 0.9))
    for n in range(8):
        search.watch(sighting(time_s=DT_S * n))
    assert [each.time_s for each in search.snapshots] == pytest.approx([0.4, 1.0])
    assert search.keep == []
    kept, grid = search.snapshots[-1], search.grid
    assert kept.excess_mps.shape == kept.excess_sd_mps.shape == (grid.x_m.size, grid.z_m.size)
    i, j = 3, grid.z_m.size - 2
    assert len(kept.weights) == search.map.basis.count
    for n in range(8, 12):  # the map goes on, what was kept does not
        search.watch(sighting(time_s=DT_S * n, energy_mps=0.4))
    x, z = np.array([grid.x_m[i]]), np.array([grid.z_m[j]])
    again = e.MapSearch(POLAR, (1.0,))
    for n in range(6):
        again.watch(sighting(time_s=DT_S * n))
    there = again.map.at(x, z)
    assert kept.excess_mps[i, j] == pytest.approx(there.excess_mps[0])
    assert kept.excess_sd_mps[i, j] == pytest.approx(there.excess_sd_mps[0])
    assert kept.weights == pytest.approx(again.map.mean())
    assert search.map.mean() != pytest.approx(kept.weights)


def test_who_looks_listens_and_seeks_and_who_watches_does_not_move_the_line() -> None:
    looks, watches = e.MapSearch(POLAR, (0.0,)), e.MapSearch(POLAR)
    looks.roll = roll_out
    request = looks.look(sighting())
    assert looks.state is not None
    assert request.target == looks.state.target
    assert len(looks.snapshots) == 1
    watches.watch(sighting())
    assert watches.state is None
    assert watches.snapshots == []
    assert watches.map.mean() == pytest.approx(looks.map.mean())

"""The plan: it goes where the fields soar, and counts those that do not."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest
from test_rollout import BOX, ETA, GRID, GUARDS, LEVEL, POLAR, at_rest

from tgl_soar.control.search.plan import (
    DISTANCES,
    FACTORS,
    HOLDS_S,
    Keep,
    Leeway,
    allowed,
    candidates,
    likely_fields,
    plan_in,
    worths,
)
from tgl_soar.control.search.rollout import Fields, Grid, Lines, Rollouts
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.lift_map.basis import Box, FlowBasis
from tgl_soar.types import Ground, polar_sink

HERE = TargetLine(0.0, 10.0, ETA)
assert LEVEL.points == 1


def lift_at(x_m: float, peak_mps: float, wind_mps: float = 9.0, copies: int = 4) -> Fields:
    """An updraft of 3 m half-width about a place, that falls upwards."""
    x, z = np.meshgrid(GRID.x_m, GRID.z_m, indexing="ij")
    w = peak_mps * np.exp(-0.5 * ((x - x_m) / 3.0) ** 2) - 0.05 * (z - 10.0)
    rows = np.repeat(w.reshape(1, -1), copies, axis=0)
    return Fields(np.full_like(rows, wind_mps), rows, np.ones(copies), np.ones(copies))


def test_it_stays_where_it_soars() -> None:
    plan = plan_in(GRID, lift_at(0.0, 1.6), POLAR, GUARDS, at_rest(), HERE, 0.01)
    assert plan.stays
    assert plan.target == HERE
    assert plan.chance == plan.stay_chance == 1.0
    assert plan.margin_m > 5.0


def test_over_a_slope_too_the_rim_is_the_height_at_which_it_gives_up() -> None:
    """Of 45 degrees: 5.5 m over it the clearance along its normal is 3.9 m, beyond CLEAR_MIN."""
    slope = Ground(2, (-8.0, 8.0, *(8.0,) * 6), (-6.0, 10.0, *(10.0,) * 6))
    guards = GUARDS._replace(
        ground=slope, box=Box(-8.0, 8.0, -6.0, 18.0), clearance_m=3.0, landing_m=4.5
    )
    grid = Grid(FlowBasis(slope, guards.box), slope)
    _, z = np.meshgrid(grid.x_m, grid.z_m, indexing="ij")
    w = polar_sink(POLAR, 9.0) + 0.3 * (7.5 - z.reshape(1, -1).repeat(4, axis=0))
    fields = Fields(np.full_like(w, 9.0), w, np.ones(4), np.ones(4))
    here = TargetLine(0.0, 7.5, ETA)
    still = at_rest()._replace(z_m=7.5)
    still = still._replace(line=still.line._replace(z_m=7.5))
    plan = plan_in(grid, fields, POLAR, guards, still, here, 0.001, keep=Keep(-9.0, weaker=False))
    assert plan.stay_chance == 1.0
    assert plan.holds_s > HOLDS_S
    assert plan.worth > 1.0


def test_it_goes_to_the_lift() -> None:
    plan = plan_in(GRID, lift_at(-4.0, 2.2), POLAR, GUARDS, at_rest(), HERE, 0.01)
    assert not plan.stays
    assert -9.0 < plan.target.x_m < -1.0
    assert plan.chance == 1.0
    assert plan.stay_chance < 1.0
    falls = polar_sink(POLAR, 9.0)
    # Where it ends in the mean field updraft meets sink.
    w = 2.2 * np.exp(-0.5 * ((plan.place_x_m + 4.0) / 3.0) ** 2) - 0.05 * (plan.place_z_m - 10.0)
    assert w == pytest.approx(falls, abs=0.15)


def test_it_says_where_there_is_nowhere() -> None:
    plan = plan_in(GRID, lift_at(0.0, -1.0), POLAR, GUARDS, at_rest(), HERE, 0.01)
    assert plan.most_chance == 0.0
    assert plan.worth < 0.0
    assert plan.lasts_s < 8.0


def test_the_chance_is_the_fraction_of_fields() -> None:
    good, bad = lift_at(0.0, 1.6, copies=3), lift_at(0.0, -2.5, copies=1)
    both = Fields(*(np.concatenate([a, b]) for a, b in zip(good, bad, strict=True)))
    plan = plan_in(GRID, both, POLAR, GUARDS, at_rest(), HERE, 0.01)
    assert plan.stay_chance == 0.75


def test_gusts_that_carry_it_out_make_a_place_worth_less() -> None:
    calm = plan_in(GRID, lift_at(0.0, 1.6), POLAR, GUARDS, at_rest(), HERE, 0.01)
    rough = plan_in(GRID, lift_at(0.0, 1.6), POLAR, GUARDS, at_rest(), HERE, 100.0)
    assert rough.worth < calm.worth - 0.5


def test_candidates_are_stay_stop_and_both_sides() -> None:
    lines = candidates(at_rest(), HERE, BOX.height_m, 0.5)
    assert tuple(column[0] for column in lines) == HERE
    beside = lines.x_m[2 : 2 + 2 * len(DISTANCES)]
    assert beside.min() == pytest.approx(-0.7 * BOX.height_m)
    assert sorted(beside) == pytest.approx(sorted(-beside))
    leans = {round(float(np.degrees(eta)) - 90.0) for eta in lines.eta_rad}
    assert leans == {10, 15, 25}
    moving = at_rest()._replace(line=at_rest().line._replace(speed_mps=0.5))
    stop = candidates(moving, HERE, BOX.height_m, 0.5).x_m[1]
    assert stop == pytest.approx(-0.25 * np.sin(ETA))  # v²/2a, upstream


def leans_of(lines: Lines) -> set[int]:
    return {round(float(np.degrees(eta)) - 90.0) for eta in lines.eta_rad}


def test_leans_beyond_what_a_line_may_have_are_no_candidates() -> None:
    lines = candidates(at_rest(), HERE, BOX.height_m, 0.5)
    between = Leeway(eta_min_rad=radians(104.0), eta_max_rad=radians(110.0))
    assert leans_of(allowed(lines, at_rest(), BOX.height_m, between)) == {15}
    end = Leeway(eta_min_rad=radians(100.0), eta_max_rad=radians(115.0))
    assert allowed(lines, at_rest(), BOX.height_m, end) is lines  # the ends are allowed
    assert allowed(lines, at_rest(), BOX.height_m, Leeway()) is lines
    none = allowed(lines, at_rest(), BOX.height_m, Leeway(eta_max_rad=radians(95.0)))
    assert tuple(column.tolist() for column in none) == tuple([v] for v in HERE)


def test_what_was_refused_is_no_candidate() -> None:
    """At another lean the lean, at the line's own that place."""
    lines = candidates(at_rest(), HERE, BOX.height_m, 0.5)
    steep = Leeway(refused=(TargetLine(0.0, 10.0, radians(115.0)),))
    kept = allowed(lines, at_rest(), BOX.height_m, steep)
    assert leans_of(kept) == {10, 15}
    assert len(kept.x_m) == len(lines.x_m) - 7
    own = Leeway(refused=(TargetLine(0.24 * BOX.height_m, 10.0, ETA),))
    kept = allowed(lines, at_rest(), BOX.height_m, own)
    assert leans_of(kept) == {10, 15, 25}
    assert len(kept.x_m) == len(lines.x_m) - 1
    assert tuple(column[0] for column in kept) == HERE


def test_what_is_no_candidate_gives_no_chance_either() -> None:
    """Lift at one place alone, which is refused: nowhere soars, and the search can give up."""
    air = lift_at(-4.0, 2.2)
    free = plan_in(GRID, air, POLAR, GUARDS, at_rest(), HERE, 0.01)
    assert free.most_chance == 1.0
    refused = [TargetLine(x, 10.0, ETA) for x in np.arange(-20.0, 20.1, 0.5).tolist()]
    refused += [TargetLine(0.0, 10.0, radians(90.0 + lean)) for lean in (10.0, 25.0)]
    plan = plan_in(
        GRID, air, POLAR, GUARDS, at_rest(), HERE, 0.01, leeway=Leeway(refused=tuple(refused))
    )
    assert plan.stays
    assert plan.most_chance == plan.stay_chance == 0.0


def test_worth_has_its_order() -> None:
    """Soars with room > soars without > sinks late > sinks soon > lost late > lost soon."""
    out = Rollouts(
        failed_s=np.array([[np.inf, np.inf, np.inf, np.inf, 9.0, 2.0]]),
        climb_mps=np.array([[0.0, 0.0, -0.1, -1.0, -1.0, -1.0]]),
        x_m=np.zeros((1, 6)),
        z_m=np.array([[10.0, 10.0, 10.0, 5.0, 1.0, 1.0]]),
        margin_m=np.array([[5.0, 0.1, 5.0, 3.0, -0.1, -0.1]]),
        speed_margin_mps=np.array([[1.0, 0.3, 1.0, 1.0, 1.0, 1.0]]),
    )
    worth = worths(out, 10.0, 20.0, 0.0, 0.0)[0]
    assert (np.diff(worth) < 0.0).all()
    assert worth[1] >= 1.0 > 0.5 >= worth[2] > 0.0 > worth[4]


def soaring(margin_m: float, speed_margin_mps: float, lull_mps: float) -> float:
    """The worth of one that soars."""
    out = Rollouts(
        failed_s=np.full((1, 1), np.inf),
        climb_mps=np.zeros((1, 1)),
        x_m=np.zeros((1, 1)),
        z_m=np.full((1, 1), 10.0),
        margin_m=np.full((1, 1), margin_m),
        speed_margin_mps=np.full((1, 1), speed_margin_mps),
    )
    return float(worths(out, 10.0, 20.0, 0.0, lull_mps)[0, 0])


def test_who_would_settle_slower_than_the_polar_is_worth_less() -> None:
    """0.3 m/s is the polar's slowest; a lull of 0.2 m/s has to be borne as well."""
    assert soaring(5.0, 0.3, 0.0) > 1.0
    assert soaring(5.0, 0.3, 0.2) < soaring(5.0, 0.5, 0.2) - 0.3
    assert soaring(5.0, 0.0, 0.0) == pytest.approx(soaring(5.0, 0.3, 0.0) - 0.5, abs=0.1)
    slow = plan_in(GRID, lift_at(0.0, 1.6, 7.5), POLAR, GUARDS, at_rest(), HERE, 0.001)
    assert slow.stay_chance == 0.0
    assert slow.most_chance == 1.0


def test_gusts_reach_the_guard_that_a_rollout_comes_near_to() -> None:
    """V sigma / g of 0.2 m/s is 0.2 m: at one of these from a guard 16 % leave it."""
    far, near = soaring(2.0, 2.0, 0.2), soaring(0.2, 2.0, 0.2)
    assert near < far - 0.16 * 1.5
    assert soaring(0.2, 2.0, 0.0) > 1.0


def test_likely_fields_are_the_mean_in_three_winds_and_the_draws() -> None:
    count = GRID.basis.count
    mean = np.zeros(count)
    mean[0] = 9.0
    draws = np.zeros((2, count))
    draws[:, 0], draws[1, GRID.basis.sink_scale] = 8.0, 0.1
    fields = likely_fields(GRID, mean, draws)
    assert fields.wind_mps[:, 0] == pytest.approx([9.0, 9.0, 9.0, 8.0, 8.0])
    assert fields.ends == pytest.approx([*FACTORS, 1.0, 1.0])
    assert fields.sink_scale == pytest.approx([1.0, 1.0, 1.0, 1.0, 1.1])
    assert radians(15.0) + 0.5 * np.pi == pytest.approx(ETA)


def test_fields_end_as_what_the_wind_s_trend_will_have_made_of_them() -> None:
    mean = np.zeros(GRID.basis.count)
    mean[0] = 9.0
    draws = np.tile(mean, (3, 1))
    fields = likely_fields(GRID, mean, draws, 0.95, np.array([0.9, 1.05, 0.5]))
    factors = [*(0.95 * f for f in FACTORS), 0.9, 1.05, 0.8]  # no trend is trusted without end
    assert fields.ends == pytest.approx(factors)
    assert fields.wind_mps[:, 0] == pytest.approx([9.0] * 6)


def test_a_line_on_which_it_would_have_given_up_does_not_soar() -> None:
    """At rest 1.3 m over the ground: over the clearance of 1 m, under the 1.5 m of landing."""
    air = lift_at(0.0, 1.6)
    falls = polar_sink(POLAR, 9.0)
    air = air._replace(updraft_mps=np.full_like(air.updraft_mps, falls))
    here = TargetLine(0.0, 1.3, ETA)
    low = plan_in(GRID, air, POLAR, GUARDS, at_rest(0.0, 1.3), here, 1e-6)
    assert low.stay_chance == 0.0
    free = GUARDS._replace(landing_m=0.0)
    assert plan_in(GRID, air, POLAR, free, at_rest(0.0, 1.3), here, 1e-6).stay_chance == 1.0


def test_it_knows_whether_a_weaker_wind_would_leave_it() -> None:
    """The second field is that of a wind of 0.9."""
    good, bad = lift_at(0.0, 1.6, copies=1), lift_at(0.0, -2.5, copies=1)
    for order, falls in (((good, good, bad), True), ((good, bad, good), False)):
        fields = Fields(*(np.concatenate(parts) for parts in zip(*order, strict=True)))
        plan = plan_in(GRID, fields, POLAR, GUARDS, at_rest(), HERE, 0.01)
        assert plan.stay_weaker is falls


def test_a_line_that_will_do_is_not_left_for_a_better_one() -> None:
    fields = lift_at(-1.5, 1.8)
    free = plan_in(GRID, fields, POLAR, GUARDS, at_rest(), HERE, 1e-4)
    assert not free.stays
    assert free.stay_chance == 1.0
    kept = plan_in(GRID, fields, POLAR, GUARDS, at_rest(), HERE, 1e-4, keep=Keep(0.5, weaker=False))
    assert kept.stays
    assert 0.5 < kept.worth < free.worth
    better = plan_in(
        GRID, fields, POLAR, GUARDS, at_rest(), HERE, 1e-4, keep=Keep(1.2, weaker=False)
    )
    assert better == free


def test_a_line_that_had_its_time_is_left_if_a_weaker_wind_would_leave_it() -> None:
    """It soars in every field but that of a wind of 0.9, the second."""
    good, weak = lift_at(-1.5, 1.8, copies=1), lift_at(-4.5, 1.8, copies=1)
    fields = Fields(*(np.concatenate(p) for p in zip(good, weak, good, good, strict=True)))
    given = (GRID, fields, POLAR, GUARDS, at_rest(), HERE, 1e-4)
    tried = plan_in(*given, keep=Keep(0.5, weaker=False))
    assert tried.stays
    assert not tried.stay_weaker
    left = plan_in(*given, keep=Keep(0.5, weaker=True))
    assert not left.stays
    assert left.worth > tried.worth + 0.3
    firm = plan_in(GRID, lift_at(-1.5, 1.8), *given[2:], keep=Keep(0.5, weaker=True))
    assert firm.stays
    assert firm.stay_weaker

"""Rollouts against what the equations say, in fields that can be solved by hand."""

from __future__ import annotations

from math import cos, inf, radians, sin, tan

import numpy as np
import pytest

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.control.envelope import clearance
from tgl_soar.control.search.rollout import (
    Fields,
    Grid,
    Guards,
    Lines,
    Moving,
    Rollouts,
    floor_at,
    grown,
    roll_out,
    turning,
    wells,
)
from tgl_soar.control.target_line import LineLimits, LineState, eta_from_lean
from tgl_soar.estimation.lift_map.basis import Box, FlowBasis
from tgl_soar.types import GRAVITY_MPS2, GROUND_POINTS, NO_GROUND, Ground, polar_sink, polar_slope

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
BOX = Box(x_min_m=-20.0, x_max_m=20.0, z_min_m=0.0, z_max_m=20.0)
LEVEL = Ground(1, (0.0,) * GROUND_POINTS, (0.0,) * GROUND_POINTS)
GUARDS = Guards(
    box=BOX,
    ground=LEVEL,
    clearance_m=1.0,
    landing_m=1.5,
    speed_min_mps=7.3,
    speed_max_mps=13.0,
    line=LineLimits(0.5, 0.5, radians(5.0)),
)
GRID = Grid(FlowBasis(LEVEL, BOX), LEVEL)
RAISED = GRID.above(GUARDS)  # for wells
ETA = eta_from_lean(radians(15.0))
WIND_MPS = 9.0


def fields(updraft_at_10_m: float, per_m: float, wind_mps: float = WIND_MPS) -> Fields:
    """Level wind everywhere, an updraft that changes with height."""
    _, z = np.meshgrid(GRID.x_m, GRID.z_m, indexing="ij")
    w = updraft_at_10_m + per_m * (z - 10.0)
    return Fields(np.full((1, z.size), wind_mps), w.reshape(1, -1), np.ones(1), np.ones(1))


def at_rest(x_m: float = 0.0, z_m: float = 10.0) -> Moving:
    line = LineState(x_m=x_m, z_m=z_m, eta_rad=ETA, speed_mps=0.0, moving=False)
    return Moving(x_m=x_m, z_m=z_m, climb_mps=0.0, line=line)


def flown(
    air: Fields, target_x_m: float = 0.0, horizon_s: float = 30.0, now: Moving | None = None
) -> Rollouts:
    lines = Lines(np.array([target_x_m]), np.array([10.0]), np.array([ETA]))
    return roll_out(
        GRID, air, POLAR, GUARDS, at_rest() if now is None else now, lines, horizon_s, 200
    )


def test_it_settles_where_updraft_meets_sink() -> None:
    """w = S(9 m/s) at 11 m, 0.3 /s less for each metre: 1 m up the line, and downstream of it by
    tan 15° less."""
    falls = polar_sink(POLAR, WIND_MPS)
    out = flown(fields(falls + 0.3, -0.3))
    assert out.z_m[0, 0] == pytest.approx(11.0, abs=0.02)
    assert out.x_m[0, 0] == pytest.approx(-tan(radians(15.0)), abs=0.02)
    assert abs(out.climb_mps[0, 0]) < 0.01
    assert out.failed_s[0, 0] == inf
    assert out.margin_m[0, 0] == pytest.approx(9.0 - 0.0, abs=0.1)  # 10 m less the clearance


def test_its_way_there_is_that_of_the_slide() -> None:
    """ṡ (sin η − S′ cos η) = E: an e-folding in leverage / 0.3 s along the line (zeuc.py)."""
    falls = polar_sink(POLAR, WIND_MPS)
    leverage = 1.0 - polar_slope(POLAR, WIND_MPS) * cos(ETA) / sin(ETA)
    fold_s = leverage / 0.3
    out = flown(fields(falls + 0.3, -0.3), horizon_s=fold_s)
    assert out.z_m[0, 0] == pytest.approx(11.0 - np.exp(-1.0), abs=0.04)


def test_without_lift_it_says_when_the_clearance_is_gone() -> None:
    """9 m at the sink of 9 m/s, and a little sooner where it leans: the airspeed grows."""
    falls = polar_sink(POLAR, WIND_MPS)
    out = flown(fields(0.0, 0.0))
    steady = falls / (1.0 - polar_slope(POLAR, WIND_MPS) * cos(ETA) / sin(ETA))
    assert out.failed_s[0, 0] == pytest.approx(9.0 / steady, rel=0.06)


def test_stopping_a_line_that_moves_downstream_costs_v_dv_over_g() -> None:
    """The aircraft starts with the line at 0.5 m/s downstream and ends at rest: V v / g of height,
    0.46 m, beside what it sinks: nothing here, as updraft meets sink everywhere."""
    falls = polar_sink(POLAR, WIND_MPS)
    air = fields(falls, 0.0)
    moving = LineState(x_m=0.0, z_m=10.0, eta_rad=ETA, speed_mps=-0.5, moving=True)
    now = Moving(x_m=0.0, z_m=10.0, climb_mps=0.0, line=moving)
    out = flown(air, 0.25 / sin(ETA), 6.0, now)
    lost = 10.0 - float(out.z_m[0, 0])
    # In the slower air while it moves it sinks as the polar has it; that changes little here.
    assert lost == pytest.approx(WIND_MPS * 0.5 / (sin(ETA) * GRAVITY_MPS2), rel=0.25)


def test_a_line_arrives_as_the_module_moves_it() -> None:
    falls = polar_sink(POLAR, WIND_MPS)
    out = flown(fields(falls, -0.5), 3.0, 30.0)
    across = sin(ETA) * (out.x_m[0, 0] - 3.0) - cos(ETA) * (out.z_m[0, 0] - 10.0)
    assert abs(across) < 0.02
    # 3 m at 0.5 m/s take 7 s: after 4 s it is not there yet.
    early = flown(fields(falls, -0.5), 3.0, 4.0)
    assert 1.0 < early.x_m[0, 0] < 2.2


@pytest.mark.parametrize("wind_mps", [6.8, 13.5])
def test_too_slow_and_too_fast_is_lost(wind_mps: float) -> None:
    assert flown(fields(3.0, -0.3, wind_mps)).failed_s[0, 0] < 1.0


def test_a_wind_that_weakens_does_so_on_the_way_and_not_at_once() -> None:
    """By 1 − e^(−t/5 s) of all there is in the horizon: from 8 m/s to 7.2, it is below the polar's
    slowest 7.3 when seven eighths are gone, or a little sooner, as it sinks down the line then; a
    step would have lost it in the first moment."""
    air = fields(polar_sink(POLAR, 8.0), 0.0, 8.0)._replace(ends=np.array([0.9]))
    out = flown(air, horizon_s=20.0)
    whole = 1.0 - np.exp(-20.0 / 5.0)
    slowest_s = -5.0 * np.log(1.0 - 0.875 * whole)
    assert 0.8 * slowest_s < out.failed_s[0, 0] < slowest_s
    gone = grown(20.0, 200)
    assert gone[-1] == 1.0
    assert gone[49] == pytest.approx((1.0 - np.exp(-1.0)) / whole)
    # Its updraft as well: at 12 m/s it sinks in the end by what a tenth less carries less.
    fast = fields(polar_sink(POLAR, 12.0), 0.0, 12.0)
    steady, weaker = flown(fast), flown(fast._replace(ends=np.array([0.97])))
    assert weaker.climb_mps[0, 0] == pytest.approx(
        (0.97 * polar_sink(POLAR, 12.0) - polar_sink(POLAR, 0.97 * 12.0))
        / (1.0 - polar_slope(POLAR, 0.97 * 12.0) * cos(ETA) / sin(ETA)),
        rel=0.1,
    )
    assert abs(steady.climb_mps[0, 0]) < 1e-6


def test_the_fence_and_a_hill_in_the_way_are_lost() -> None:
    assert np.isfinite(flown(fields(8.0, 0.0)).failed_s[0, 0])  # up through the ceiling
    ramp = Ground(2, (0.0, 10.0, *(10.0,) * 6), (0.0, 20.0, *(20.0,) * 6))
    grid = Grid(FlowBasis(ramp, BOX), ramp)
    lines = Lines(np.array([8.0]), np.array([10.0]), np.array([ETA]))
    falls = polar_sink(POLAR, WIND_MPS)
    out = roll_out(grid, fields(falls, 0.0), POLAR, GUARDS, at_rest(), lines, 30.0, 100)
    assert np.isfinite(out.failed_s[0, 0])


def test_over_raised_ground_the_clearance_is_the_height_that_landing_needs() -> None:
    """1.5 m in place of 1 m over level ground; on a slope of 45° 1.41 m is 1 m away from it."""
    falls = polar_sink(POLAR, WIND_MPS)
    lines = Lines(np.array([0.0]), np.array([10.0]), np.array([ETA]))
    raised = GRID.above(GUARDS)
    for grid, height_m in ((GRID, 10.0 - 1.0), (raised, 10.0 - 1.5)):
        out = roll_out(grid, fields(falls, 0.0), POLAR, GUARDS, at_rest(), lines, 5.0, 50)
        assert out.margin_m[0, 0] == pytest.approx(height_m, abs=0.05)
    assert GRID.above(GUARDS._replace(landing_m=0.0)).mesh.floor.height_m == pytest.approx(
        GRID.mesh.floor.height_m
    )
    ramp = Ground(2, (-20.0, 20.0, *(20.0,) * 6), (-30.0, 10.0, *(10.0,) * 6))
    steep = Grid(FlowBasis(ramp, BOX), ramp)
    at = np.array([[0.0]]), np.array([[-10.0 + 1.5]])
    assert steep.above(GUARDS).clearance(*at)[0, 0] == pytest.approx(1.0, abs=1e-6)
    assert steep.clearance(*at)[0, 0] == pytest.approx(1.5 * cos(radians(45.0)), abs=1e-6)


def ground_of(*points: tuple[float, float]) -> Ground:
    x, z = zip(*points, *[points[-1]] * (GROUND_POINTS - len(points)), strict=True)
    return Ground(len(points), x, z)


HILL = load_site(shipped("sites/hill.toml")).ground
assert HILL is not None
PROFILES = {
    "the shipped hill": ground_of(*HILL.profile),
    "a roof and a wall": ground_of((-9.0, 0.0), (-4.0, 6.0), (-3.9, 6.0), (2.0, 1.0), (2.05, 4.0)),
    "one point": ground_of((0.0, 3.0)),
}


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("reach_m", [30.0, 200.0, 5000.0])
def test_the_guards_ground_is_the_envelopes_however_long_the_fence_is(
    profile: str, reach_m: float
) -> None:
    """What rollouts keep clear of and what the tick judges by are one: to rounding, 1e-9 m.  A
    corner between the wind's nodes is met, and over no slope is a place allowed where the tick says
    that there is less than the clearance, nor one with less height than landing needs."""
    ground = PROFILES[profile]
    box = Box(x_min_m=-reach_m, x_max_m=0.5 * reach_m, z_min_m=0.0, z_max_m=24.0)
    grid = Grid(FlowBasis(ground, box), ground)
    guards = GUARDS._replace(box=box, ground=ground)
    random = np.random.default_rng(5)
    ends = (max(box.x_min_m, -40.0), min(box.x_max_m, 20.0))
    corners = np.array(ground.x_m[: ground.points])
    near = (corners[:, None] + np.array([-1e-6, 1e-6, -0.1, 0.1])).ravel()
    x = np.concatenate([random.uniform(*ends, 3000), near, near])
    z = floor_at(ground, x, 0.0) + random.uniform(-1.0, 6.0, x.size)
    true = np.array([clearance(ground, *place) for place in zip(x, z, strict=True)])
    assert np.abs(grid.clearance(x, z) - true).max() < 1e-9
    allowed = grid.above(guards).clearance(x, z) >= guards.clearance_m
    assert 0.1 < allowed.mean() < 0.9
    assert true[allowed].min() > guards.clearance_m - 1e-9
    assert (z - floor_at(ground, x, 0.0))[allowed].min() > guards.landing_m - 1e-9


def test_over_unknown_ground_the_fences_floor_is_level() -> None:
    grid = Grid(FlowBasis(NO_GROUND, BOX), NO_GROUND)
    x = np.array([-25.0, 0.0, 25.0])
    assert grid.clearance(x, np.full(3, 4.0)) == pytest.approx(4.0 - BOX.z_min_m)


def test_the_well_is_that_of_a_parabola() -> None:
    """E = −k (z − 10): λ = k sin η / c, and ΔV up to the guard: ½ λ (distance)²."""
    falls = polar_sink(POLAR, WIND_MPS)
    air = fields(falls, -0.2)
    lines = Lines(np.array([0.0]), np.array([10.0]), np.array([ETA]))
    leverage = sin(ETA) - polar_slope(POLAR, WIND_MPS) * cos(ETA)
    well = wells(RAISED, air, POLAR, GUARDS, lines, np.array([0.0]), np.array([10.0]), 2.0)
    rate = 0.2 * sin(ETA) / leverage
    assert well.rate_per_s[0] == pytest.approx(rate, rel=0.02)
    # Down to the height at which the search gives up: 8.5 m below.
    assert well.depth_m2ps[0] == pytest.approx(0.5 * rate * (8.5 / sin(ETA)) ** 2, rel=0.06)
    calm = wells(RAISED, air, POLAR, GUARDS, lines, np.array([0.0]), np.array([10.0]), 1e-6)
    rough = wells(RAISED, air, POLAR, GUARDS, lines, np.array([0.0]), np.array([10.0]), 50.0)
    assert calm.holds_s[0] > well.holds_s[0] > rough.holds_s[0]


def test_a_place_that_drives_away_holds_for_no_time() -> None:
    falls = polar_sink(POLAR, WIND_MPS)
    lines = Lines(np.array([0.0]), np.array([10.0]), np.array([ETA]))
    well = wells(
        GRID, fields(falls, 0.2), POLAR, GUARDS, lines, np.array([0.0]), np.array([10.0]), 0.05
    )
    assert well.rate_per_s[0] < 0.0
    assert well.holds_s[0] == 0.0


def test_a_line_turns_to_where_it_is_wanted_by_no_more_than_it_may() -> None:
    wanted = np.array([ETA + 0.25, ETA - 0.25, ETA + 0.04, ETA])
    lines = Lines(np.zeros(4), np.full(4, 10.0), wanted)
    sines, cosines = turning(at_rest(), lines, 0.1, 4)
    turned = np.arctan2(sines, cosines) - ETA
    assert turned[:, 0] == pytest.approx([0.1, 0.2, 0.25, 0.25])
    assert turned[:, 1] == pytest.approx([-0.1, -0.2, -0.25, -0.25])
    assert turned[:, 2] == pytest.approx([0.04] * 4)
    assert turned[:, 3] == pytest.approx([0.0] * 4)


@pytest.mark.parametrize(("diffusion_m2ps", "in_gusts_alone"), [(0.5, False), (400.0, True)])
def test_a_place_holds_for_kramers_time_or_for_that_of_gusts_alone(
    diffusion_m2ps: float, in_gusts_alone: bool
) -> None:
    """(2π/λ) e^(ΔV/D) or (L²/2D) e^(ΔV/D), of D over the leverage's square."""
    falls = polar_sink(POLAR, WIND_MPS)
    lines = Lines(np.array([0.0]), np.array([10.0]), np.array([ETA]))
    leverage = sin(ETA) - polar_slope(POLAR, WIND_MPS) * cos(ETA)
    air = fields(falls, -0.2)
    at = np.array([0.0]), np.array([10.0])
    well = wells(RAISED, air, POLAR, GUARDS, lines, *at, diffusion_m2ps)
    along = diffusion_m2ps / leverage**2
    way = 8.5 / sin(ETA)
    turn_s, spread_s = 2.0 * np.pi / float(well.rate_per_s[0]), way**2 / (2.0 * along)
    assert (spread_s < turn_s) == in_gusts_alone
    expected = min(turn_s, spread_s) * np.exp(float(well.depth_m2ps[0]) / along)
    assert well.holds_s[0] == pytest.approx(expected, rel=0.06 if in_gusts_alone else 1e-6)
    # In the first field alone, and with its own scale of the sink.
    both = Fields(*(np.concatenate([part, 3.0 * part]) for part in air))
    assert wells(RAISED, both, POLAR, GUARDS, lines, *at, diffusion_m2ps) == well
    # In the wind that there will be.
    ended = wells(
        RAISED, air._replace(ends=np.array([1.1])), POLAR, GUARDS, lines, *at, diffusion_m2ps
    )
    later = air._replace(wind_mps=1.1 * air.wind_mps, updraft_mps=1.1 * air.updraft_mps)
    expected_then = wells(RAISED, later, POLAR, GUARDS, lines, *at, diffusion_m2ps)
    assert np.array(ended) == pytest.approx(np.array(expected_then), rel=1e-9)
    assert ended.depth_m2ps[0] != pytest.approx(well.depth_m2ps[0], rel=0.01)
    sinking = wells(
        RAISED, air._replace(sink_scale=np.array([1.5])), POLAR, GUARDS, lines, *at, 1.5
    )
    assert sinking.depth_m2ps[0] < 0.7 * well.depth_m2ps[0]


@pytest.mark.parametrize(
    "changes",
    [
        {"landing_m": 7.0},
        {"clearance_m": 7.0},
        {"box": BOX._replace(z_max_m=13.0)},
        {"box": BOX._replace(z_min_m=7.0)},
        {"box": BOX._replace(x_max_m=3.0 / tan(radians(75.0)))},
        {"box": BOX._replace(x_min_m=-3.0 / tan(radians(75.0)))},
    ],
)
def test_a_rim_is_where_a_guard_is_left(changes: dict[str, object]) -> None:
    """Each of them 3 m below or above the place: ½ λ 3² / sin² η."""
    falls = polar_sink(POLAR, WIND_MPS)
    lines = Lines(np.array([0.0]), np.array([10.0]), np.array([ETA]))
    guards = GUARDS._replace(**changes)  # type: ignore[arg-type]
    # The grid's own box stays: the guards alone move.
    well = wells(
        *(RAISED, fields(falls, -0.2), POLAR, GUARDS._replace(box=BOX), lines),
        *(np.array([0.0]), np.array([10.0]), 1.0),
    )
    reach = 0.5 * guards.box.height_m
    near = wells(
        *(GRID.above(guards), fields(falls, -0.2), POLAR, guards, lines),
        *(np.array([0.0]), np.array([10.0]), 1.0),
    )
    rim = min(3.0 / sin(ETA), reach)
    assert near.depth_m2ps[0] == pytest.approx(0.5 * float(well.rate_per_s[0]) * rim**2, rel=0.15)
    assert near.depth_m2ps[0] < 0.3 * well.depth_m2ps[0]

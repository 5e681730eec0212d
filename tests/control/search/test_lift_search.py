"""The search's claims and its end, one condition at a time."""

from __future__ import annotations

from itertools import pairwise
from math import cos, sin

import pytest
from test_rollout import ETA, GUARDS, POLAR

from tgl_soar.control.envelope import Fence
from tgl_soar.control.search.glimpse import (
    GIVEN_UP,
    LOOKING,
    NO_PLACE,
    REASONS,
    SOARING,
    TOO_HIGH,
    TOO_LOW,
    Glimpse,
    SearchTask,
)
from tgl_soar.control.search.lift_search import (
    LiftSearch,
    Sighting,
    guards_of,
    landing_height,
    sighting_of,
)
from tgl_soar.control.search.plan import LinePlan
from tgl_soar.control.search.search import (
    CLAIM_CHANCE,
    CLAIM_S,
    FAILS_WORTH,
    KEEP_CHANCE,
    KEEP_CLIMB_MPS,
    SOARS_WORTH,
    SearchState,
    is_lost,
    kept,
    plan_due,
    search_step,
    started,
)
from tgl_soar.control.target_line import LineTracking, TargetLine
from tgl_soar.types import Ground, VehicleState

LINE = TargetLine(0.0, 10.0, ETA)
GOOD = LinePlan(
    target=LINE,
    stays=True,
    worth=1.3,
    chance=1.0,
    stay_chance=1.0,
    stay_weaker=True,
    most_chance=1.0,
    lasts_s=30.0,
    place_x_m=0.0,
    place_z_m=10.0,
    margin_m=5.0,
    holds_s=1e6,
)
DT_S = 0.2


def after(
    seconds: float,
    plan: LinePlan = GOOD,
    *,
    state: SearchState | None = None,
    climb_mps: float = 0.0,
    over_ground_m: float = 10.0,
    moving: bool = False,
    carried: bool = False,
) -> SearchState:
    """The state after some seconds of the same."""
    state = started(LINE) if state is None else state
    for _ in range(round(seconds / DT_S)):
        due = plan if plan_due(state) else None
        state = search_step(
            state, GUARDS, due, climb_mps, over_ground_m, moving, DT_S, carried=carried
        )
    return state


def test_plans_are_made_every_other_look_at_first_and_once_a_second_later() -> None:
    state, due = started(LINE), []
    for _ in range(60):
        if plan_due(state):
            due.append(state.time_s)
        state = after(DT_S, state=state)
    early = [t for t in due if t < 7.0]
    assert early == pytest.approx([0.4 * k for k in range(len(early))])
    late = [t for t in due if t > 8.5]
    assert [b - a for a, b in pairwise(late)] == pytest.approx([1.0] * (len(late) - 1))


def test_soaring_is_claimed_after_six_still_seconds() -> None:
    assert after(5.4).status == LOOKING
    assert after(8.0).status == SOARING


def test_a_line_that_is_to_go_elsewhere_has_its_six_seconds_there() -> None:
    """What the aircraft was still for belongs to the line before, though the new one should not
    have begun to slide by the next look."""
    there = GOOD._replace(target=TargetLine(3.0, 10.0, ETA))
    sent = search_step(
        after(CLAIM_S - 1.0), GUARDS, there._replace(stays=False), 0.0, 10.0, False, DT_S
    )
    assert after(CLAIM_S - 0.6, there, state=sent).status == LOOKING
    assert after(CLAIM_S + 2.0, there, state=sent).status == SOARING


@pytest.mark.parametrize(
    "hindered",
    [
        {"climb_mps": -0.08},
        {"climb_mps": 0.08},
        {"moving": True},
        {"plan": GOOD._replace(stay_chance=0.7)},
        {"plan": GOOD._replace(stays=False)},
        {"plan": GOOD._replace(stay_weaker=False)},
    ],
)
def test_it_is_not_claimed_where_it_is_not_so(hindered: dict[str, object]) -> None:
    assert after(20.0, **hindered).status == LOOKING  # type: ignore[arg-type]


def test_a_claim_is_withdrawn() -> None:
    soaring = after(8.0)
    assert after(3.0, state=soaring).status == SOARING
    lost = after(3.0, GOOD._replace(stay_chance=0.4), state=soaring)
    assert lost.status == LOOKING
    assert after(8.0, state=soaring, climb_mps=-0.4).status == LOOKING


def test_a_claim_ends_where_its_line_is_left() -> None:
    other = GOOD._replace(target=TargetLine(3.0, 10.0, ETA), stays=False)
    assert after(1.4, other, state=after(8.0)).status == LOOKING


def test_a_claim_is_withdrawn_where_it_sinks_and_a_weaker_wind_would_not_leave_it() -> None:
    claimed, weak = after(8.0), GOOD._replace(stay_weaker=False)
    assert after(4.0, weak, state=claimed).status == SOARING
    assert after(8.0, climb_mps=-0.04, state=claimed).status == SOARING
    assert after(8.0, weak, climb_mps=-0.04, state=claimed).status == LOOKING


def test_a_claim_is_withdrawn_between_two_plans() -> None:
    state = after(12.0)
    while not plan_due(state):
        state = after(DT_S, state=state)
    state = after(DT_S, state=state)
    assert state.status == SOARING
    assert not plan_due(state)
    state = state._replace(climb_mps=-KEEP_CLIMB_MPS)
    assert search_step(state, GUARDS, None, -1.0, 10.0, False, DT_S).status == LOOKING


def test_the_best_line_is_flown() -> None:
    other = GOOD._replace(target=TargetLine(3.0, 10.0, ETA), stays=False)
    assert after(1.0, other).target == other.target


def test_it_gives_up_where_no_field_soars_but_not_at_once() -> None:
    nowhere = GOOD._replace(chance=0.0, stay_chance=0.0, most_chance=0.0, stays=False)
    assert after(1.0, nowhere, climb_mps=-0.5).status == LOOKING
    given_up = after(4.0, nowhere, climb_mps=-0.5)
    assert (given_up.status, given_up.reason) == (GIVEN_UP, NO_PLACE)
    assert "no line" in REASONS[given_up.reason]
    # and that is the end of it
    assert after(9.0, GOOD, state=given_up) == given_up
    assert not plan_due(given_up)


def test_one_hopeless_plan_among_others_is_forgotten() -> None:
    nowhere = GOOD._replace(chance=0.0, stay_chance=0.0, most_chance=0.0, stays=False)
    state = after(1.4, nowhere, climb_mps=-0.5)
    state = after(0.6, GOOD, state=state, climb_mps=-0.5)
    assert after(1.4, nowhere, state=state, climb_mps=-0.5).status == LOOKING


def test_at_rest_it_does_not_give_up_whatever_the_map_says() -> None:
    nowhere = GOOD._replace(chance=0.0, stay_chance=0.0, most_chance=0.0, stays=False)
    assert after(20.0, nowhere).status == LOOKING


def test_where_by_two_plans_every_line_is_lost_soon_it_gives_up() -> None:
    """Under the ceiling and climbing, for one: there is height to land, and nothing to wait for.
    A rollout looks 23 s ahead here; in the highest box it is no longer than what is trusted."""
    lost = GOOD._replace(chance=0.0, most_chance=0.0, stays=False, lasts_s=1.7)
    assert after(0.2, lost, climb_mps=1.0).status == LOOKING  # a lull, perhaps
    given_up = after(0.6, lost, climb_mps=1.0)
    assert (given_up.status, given_up.reason) == (GIVEN_UP, NO_PLACE)
    between = after(0.4, GOOD, state=after(0.4, lost, climb_mps=1.0), climb_mps=1.0)
    assert after(0.4, lost, state=between, climb_mps=1.0).status == LOOKING
    assert after(1.0, lost._replace(lasts_s=2.0), climb_mps=1.0).status == LOOKING
    assert is_lost(lost._replace(lasts_s=1.9), 200.0)
    assert not is_lost(lost._replace(lasts_s=2.1), 200.0)
    assert after(1.0, lost._replace(most_chance=0.2), climb_mps=1.0).status == LOOKING
    assert after(1.0, lost, climb_mps=-0.5, carried=True).status == LOOKING


def test_it_gives_up_while_there_is_height_to_land() -> None:
    """At 1.5 m/s of sink and 0.4 s: 0.6 m above the landing height of 1.5 m."""
    poor = GOOD._replace(chance=0.3, stay_chance=0.3, most_chance=0.3, stays=False)
    assert after(1.0, poor, climb_mps=-1.5, over_ground_m=2.2).status == LOOKING
    low = after(1.0, poor, climb_mps=-1.5, over_ground_m=2.0)
    assert (low.status, low.reason) == (GIVEN_UP, TOO_LOW)
    assert low.time_s <= 0.4
    # A poor line that hardly sinks yet will: by half of a glide's sink, 0.28 m above.
    assert after(1.0, poor, over_ground_m=1.77).status == GIVEN_UP
    assert after(1.0, poor, over_ground_m=1.79).status == LOOKING


def task(ground: Ground) -> SearchTask:
    """In a wide fence; CLEAR_MIN is 1 m."""
    return SearchTask(
        fence=Fence(x_min_m=-40.0, x_max_m=20.0, y_max_m=10.0, z_min_m=-60.0, z_max_m=60.0),
        ground=ground,
        polar=POLAR,
        clearance_min_m=1.0,
        line=GUARDS.line,
    )


def sighting(
    before: VehicleState, now: VehicleState, line: LineTracking, ground: Ground
) -> Sighting:
    """Of a glimpse by that task."""
    glimpse = Glimpse(
        before=before,
        now=now,
        line=line,
        wind_mps=9.0,
        updraft_mps=0.0,
        pitot=True,
        seeks=True,
        refused=None,
    )
    look = sighting_of(guards_of(task(ground)), glimpse)
    assert look is not None
    return look


def test_rollouts_fly_through_air_a_little_beyond_both_ends_of_the_polar() -> None:
    guards = guards_of(task(GUARDS.ground))
    assert guards.speed_min_mps == pytest.approx(POLAR.speed_min_mps - 0.3)
    assert guards.speed_max_mps == pytest.approx(POLAR.speed_max_mps + 1.0)


@pytest.mark.parametrize(("x_m", "low_m"), [(-30.0, 1.5), (0.0, 5.0**0.5)])
def test_over_a_slope_it_gives_up_while_there_is_clearance_along_its_normal(
    x_m: float, low_m: float
) -> None:
    """CLEAR_MIN is 1 m.  Over a slope of 2 that is gone √5 m up, above the 1.5 m of landing."""
    steep = Ground(2, (-20.0, 20.0, *(20.0,) * 6), (-40.0, 40.0, *(40.0,) * 6))
    still = dict.fromkeys(VehicleState._fields, 0.0)
    over_m = low_m + 0.05
    now = VehicleState(
        **(still | {"time_s": 1.0, "x_m": x_m, "z_m": max(-40.0, 2.0 * x_m) + over_m})
    )
    line = LineTracking(
        x_m=x_m, z_m=now.z_m, eta_rad=ETA, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0
    )
    look = sighting(now._replace(time_s=0.8, z_m=now.z_m + 0.2), now, line, steep)
    assert look.over_ground_m == pytest.approx(over_m)
    assert landing_height(look) == pytest.approx(low_m)
    request = LiftSearch(POLAR).seek(look)  # without a map: it knows no line that would carry it
    assert request.reason == TOO_LOW
    assert request.over_ground_m == pytest.approx(over_m)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (-0.4, 0.3), (1.0, -0.5)])
def test_a_line_moves_as_fast_as_its_distance_does_not_say_of_the_aircraft(
    velocity: tuple[float, float],
) -> None:
    """e_rho' = V_across - the line's own speed, positive upward of it; a line at rest has none."""
    line_mps = 0.3
    across = cos(ETA) * velocity[1] - sin(ETA) * velocity[0]
    state = dict.fromkeys(VehicleState._fields, 0.0)
    moved = {"time_s": 1.0, "velocity_x_mps": velocity[0], "climb_mps": velocity[1]}
    now = VehicleState(**(state | moved))
    for moving, speed_mps in ((True, line_mps), (False, 0.0)):
        line = LineTracking(
            x_m=0.0, z_m=0.0, eta_rad=ETA, moving=moving, e_rho_m=0.0,
            e_rho_rate_mps=across - line_mps,
        )  # fmt: skip
        look = sighting(now._replace(time_s=0.8), now, line, GUARDS.ground)
        assert look.moving.line.speed_mps == pytest.approx(speed_mps)


def test_low_with_a_good_line_it_goes_on_while_it_does_not_sink() -> None:
    assert after(9.0, over_ground_m=1.9).status == SOARING
    # The rollouts have begun with this sink: a gust's dip is waited for, down to the look before
    # the height is gone.
    assert after(1.0, over_ground_m=1.75, climb_mps=-1.0).status == LOOKING
    assert after(1.0, over_ground_m=1.65, climb_mps=-1.0).status == GIVEN_UP
    # Where fewer fields soar the dive is not waited for.
    unlikely = GOOD._replace(chance=0.7)
    assert after(0.4, unlikely, over_ground_m=1.85, climb_mps=-1.0).status == GIVEN_UP


def test_height_runs_out_between_two_plans_as_well() -> None:
    """A second after a plan the next one is due; 0.2 s after it the height is gone."""
    state = after(20.0)
    while not plan_due(state):
        state = after(DT_S, state=state)
    state = after(DT_S, state=state)
    assert not plan_due(state)
    low = search_step(state, GUARDS, None, -1.0, 1.6, False, DT_S)
    assert (low.status, low.reason) == (GIVEN_UP, TOO_LOW)
    assert search_step(state, GUARDS, None, -1.0, 1.6, False, DT_S, carried=True).status == SOARING


def test_it_gives_up_before_it_leaves_through_the_ceiling() -> None:
    """At 1 m/s of climb a look before it, 0.2 m under it, where a third of all soars."""
    poor = GOOD._replace(chance=0.3, stay_chance=0.3, most_chance=0.3, stays=False)

    def step(plan: LinePlan, climb_mps: float, under_ceiling_m: float) -> SearchState:
        state = started(LINE)
        return search_step(
            state, GUARDS, plan, climb_mps, 9.0, False, DT_S, under_ceiling_m=under_ceiling_m
        )

    assert step(poor, 1.0, 0.19).reason == TOO_HIGH
    assert "ceiling" in REASONS[TOO_HIGH]
    fair = poor._replace(chance=0.4)
    for going_on in (step(poor, 1.0, 0.21), step(poor, 0.5, 0.19), step(fair, 1.0, 0.19)):
        assert going_on.status == LOOKING


def test_with_power_left_it_looks_on() -> None:
    poor = GOOD._replace(chance=0.3, stay_chance=0.3, most_chance=0.3, stays=False)
    on = after(3.0, poor, climb_mps=-1.5, over_ground_m=1.2, carried=True)
    assert on.status == LOOKING
    used_up = after(DT_S, poor, state=on, climb_mps=-1.5, over_ground_m=1.2)
    assert (used_up.status, used_up.reason) == (GIVEN_UP, TOO_LOW)
    nowhere = poor._replace(chance=0.0, stay_chance=0.0, most_chance=0.0)
    looks_on = after(4.0, nowhere, climb_mps=-1.5, over_ground_m=1.2, carried=True)
    assert looks_on.status == LOOKING
    given_up = after(DT_S, nowhere, state=looks_on, climb_mps=-1.5, over_ground_m=9.0)
    assert (given_up.status, given_up.reason) == (GIVEN_UP, NO_PLACE)


def test_low_and_rising_it_goes_on() -> None:
    poor = GOOD._replace(chance=0.3, stay_chance=0.3, most_chance=0.3, stays=False)
    assert after(1.0, poor, climb_mps=0.3, over_ground_m=1.7).status == LOOKING
    assert after(1.0, poor, climb_mps=0.0, over_ground_m=1.7).status == GIVEN_UP
    assert after(1.0, climb_mps=0.3, over_ground_m=1.45).status == LOOKING
    assert after(1.0, climb_mps=0.0, over_ground_m=1.45).status == GIVEN_UP


def test_a_line_has_to_be_as_good_as_a_claim_once_it_had_the_time_for_one() -> None:
    state = after(4.0)
    wait = after(CLAIM_S + 0.4, GOOD._replace(stay_chance=0.7))
    # Of a line that soars in so many fields and fails in the others.
    for at, chance in ((state, KEEP_CHANCE), (wait, CLAIM_CHANCE)):
        worth = chance * SOARS_WORTH + (1.0 - chance) * FAILS_WORTH
        assert kept(at).worth == pytest.approx(worth)
    assert kept(state).worth < 0.5 < kept(wait).worth


def test_a_line_is_tried_for_six_seconds_before_a_weaker_wind_counts_and_a_claim_stays() -> None:
    weak = GOOD._replace(stay_weaker=False)
    assert not kept(after(CLAIM_S - 0.4, weak)).weaker
    tried = after(CLAIM_S + 0.4, weak)
    assert tried.status == LOOKING
    assert kept(tried).weaker
    claimed = after(CLAIM_S + 0.4)
    assert claimed.status == SOARING
    assert not kept(claimed).weaker


def test_two_seconds_without_a_line_are_two_seconds_when_plans_are_rare_too() -> None:
    nowhere = GOOD._replace(chance=0.09, stay_chance=0.0, most_chance=0.09, stays=False)
    late = after(20.0)
    assert after(1.0, nowhere, state=late, climb_mps=-0.5).status != GIVEN_UP
    given_up = after(4.2, nowhere, state=late, climb_mps=-0.5)
    assert given_up.status == GIVEN_UP
    assert given_up.time_s - late.time_s <= 3.7  # three plans

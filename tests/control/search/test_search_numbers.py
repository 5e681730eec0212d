"""The search's numbers one by one: averages, chances and times on both sides.

Chances are fractions of eleven fields: the mean one in three winds, and eight draws.
"""

from __future__ import annotations

import pytest
from test_lift_search import DT_S, GOOD, LINE
from test_rollout import GUARDS

from tgl_soar.control.search.glimpse import GIVEN_UP, LOOKING, NO_PLACE, NO_REASON, SOARING
from tgl_soar.control.search.plan import LinePlan, horizon_of
from tgl_soar.control.search.rollout import Guards
from tgl_soar.control.search.search import (
    SearchState,
    climb_s,
    is_lost,
    kept,
    plan_due,
    search_step,
    started,
)

FIELDS = 11
HIGH_M = 10.0  # far from where a landing has to begin
TUNNEL_M = 1.6  # of height
TUNNEL = GUARDS._replace(box=GUARDS.box._replace(z_min_m=0.0, z_max_m=TUNNEL_M))
NOWHERE = GOOD._replace(chance=0.0, stay_chance=0.0, most_chance=0.0, stays=False)


def step(
    state: SearchState,
    plan: LinePlan | None = None,
    climb_mps: float = 0.0,
    *,
    guards: Guards = GUARDS,
    moving: bool = False,
    dt_s: float = DT_S,
) -> SearchState:
    return search_step(state, guards, plan, climb_mps, HIGH_M, moving, dt_s)


def still(seconds: float, status: int = LOOKING) -> SearchState:
    """The line has stood still for so long."""
    return started(LINE)._replace(status=status, still_s=seconds)


def test_at_its_start_nothing_has_lasted_and_nothing_is_amiss() -> None:
    begun = started(LINE)
    assert (begun.status, begun.reason, begun.target) == (LOOKING, NO_REASON, LINE)
    assert (begun.time_s, begun.climb_mps, begun.still_s, begun.hopeless_s) == (0.0, 0.0, 0.0, 0.0)
    assert begun.chance == 1.0
    assert not begun.lost
    assert plan_due(begun)  # with the first look


# --- the climb ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("height_m", "seconds"), [(TUNNEL_M, 3.0), (4.0, 3.0), (30.0, 0.25 * horizon_of(30.0))]
)
def test_the_climb_is_averaged_over_three_seconds_and_longer_in_a_large_box(
    height_m: float, seconds: float
) -> None:
    """A quarter of what rollouts look ahead: gusts are as large as the box."""
    assert climb_s(height_m) == pytest.approx(seconds)
    box = GUARDS.box._replace(z_min_m=0.0, z_max_m=height_m)
    risen = step(started(LINE), climb_mps=1.0, guards=GUARDS._replace(box=box), dt_s=0.3)
    assert risen.climb_mps == pytest.approx(0.3 / seconds)


def test_an_average_stays_where_nothing_changes_and_goes_no_farther_than_there() -> None:
    climbs = started(LINE)._replace(climb_mps=0.4)
    assert step(climbs, climb_mps=0.4).climb_mps == pytest.approx(0.4)
    assert step(climbs, climb_mps=1.0, guards=TUNNEL, dt_s=9.0).climb_mps == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("climb_mps", "keeps"), [(0.11, True), (-0.11, True), (0.13, False), (-0.13, False)]
)
def test_a_claim_is_kept_while_it_climbs_or_sinks_by_less_than_twelve_centimetres(
    climb_mps: float, keeps: bool
) -> None:
    state = still(9.0, SOARING)._replace(climb_mps=climb_mps)
    assert (step(state, climb_mps=climb_mps).status == SOARING) == keeps


@pytest.mark.parametrize(
    ("climb_mps", "claims"), [(0.04, True), (-0.04, True), (0.06, False), (-0.06, False)]
)
def test_a_claim_is_made_at_less_than_five(climb_mps: float, claims: bool) -> None:
    state = still(9.0)._replace(climb_mps=climb_mps)
    assert (step(state, GOOD, climb_mps).status == SOARING) == claims


@pytest.mark.parametrize(("climb_mps", "keeps"), [(-0.015, True), (-0.025, False)])
def test_who_would_not_fall_back_in_a_weaker_wind_may_sink_by_two(
    climb_mps: float, keeps: bool
) -> None:
    weak = GOOD._replace(stay_weaker=False)
    state = still(9.0, SOARING)._replace(climb_mps=climb_mps)
    assert (step(state, weak, climb_mps).status == SOARING) == keeps
    assert step(state, GOOD, climb_mps).status == SOARING


# --- how long it has stood still ----------------------------------------------------------------


def test_a_line_that_moves_has_not_stood_still_at_all() -> None:
    assert step(still(5.0), moving=True).still_s == 0.0
    assert step(still(5.0)).still_s == pytest.approx(5.0 + DT_S)
    elsewhere = GOOD._replace(target=LINE._replace(x_m=3.0), stays=False)
    sent = step(still(5.0), elsewhere)
    assert (sent.still_s, sent.target.x_m) == (0.0, 3.0)


@pytest.mark.parametrize(("seconds", "claims"), [(5.7, False), (5.81, True)])
def test_six_seconds_are_needed(seconds: float, claims: bool) -> None:
    assert (step(still(seconds), GOOD).status == SOARING) == claims


# --- chances ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fields", "claims"), [(8, False), (9, True)])
def test_four_fields_in_five_have_to_keep_it_for_a_claim(fields: int, claims: bool) -> None:
    plan = GOOD._replace(stay_chance=fields / FIELDS)
    assert (step(still(9.0), plan).status == SOARING) == claims
    assert step(still(9.0), GOOD._replace(stay_chance=0.8)).status == SOARING


@pytest.mark.parametrize(("fields", "keeps"), [(5, False), (6, True)])
def test_half_of_them_keep_a_claim(fields: int, keeps: bool) -> None:
    plan = GOOD._replace(stay_chance=fields / FIELDS)
    assert (step(still(9.0, SOARING), plan).status == SOARING) == keeps
    assert step(still(9.0, SOARING), GOOD._replace(stay_chance=0.5)).status == SOARING


def hopeless_after(fields: int, climb_mps: float = -0.5) -> float:
    """What one plan adds to the time without hope."""
    plan = NOWHERE._replace(most_chance=fields / FIELDS)
    return step(started(LINE)._replace(climb_mps=climb_mps), plan, climb_mps).hopeless_s


@pytest.mark.parametrize(("fields", "hopeless"), [(0, True), (1, True), (2, False)])
def test_one_field_in_eleven_is_no_hope(fields: int, hopeless: bool) -> None:
    """As a rule it is that of a wind a tenth stronger."""
    assert (hopeless_after(fields) > 0.0) == hopeless
    plan = NOWHERE._replace(most_chance=fields / FIELDS, lasts_s=0.1)
    assert is_lost(plan, TUNNEL_M) == hopeless
    assert hopeless_after(fields, climb_mps=0.04) == 0.0  # at rest there is nothing to lose


def test_the_worth_of_a_line_that_is_kept_is_that_of_its_chances() -> None:
    """Of one that soars, 1 and some margin, and of one that fails early, -1 and some time: the mean
    for as likely as not, and of four in five once it had its six seconds."""
    assert kept(still(5.9)).worth == pytest.approx(0.5 * 1.2 + 0.5 * -0.6)
    assert kept(still(6.1)).worth == pytest.approx(0.8 * 1.2 + 0.2 * -0.6)


# --- lost ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("height_m", "lost_s", "waited_s"), [(TUNNEL_M, 0.7, 0.78), (20.0, 1.8, 1.9), (90.0, 1.9, 2.1)]
)
def test_lost_is_who_leaves_every_line_within_a_twelfth_of_what_is_looked_ahead(
    height_m: float, lost_s: float, waited_s: float
) -> None:
    """In a tunnel that is two early plans; two seconds at most, when it would be accepted."""
    assert is_lost(NOWHERE._replace(lasts_s=lost_s), height_m)
    assert not is_lost(NOWHERE._replace(lasts_s=waited_s), height_m)


@pytest.mark.parametrize(
    ("climb_mps", "gives_up"), [(-0.5, True), (0.5, True), (0.04, False), (-0.04, False)]
)
def test_lost_by_two_plans_it_gives_up_rising_or_sinking(climb_mps: float, gives_up: bool) -> None:
    lost = NOWHERE._replace(lasts_s=0.5)
    once = step(started(LINE), lost, climb_mps)
    assert once.status == LOOKING
    twice = step(once, lost, climb_mps)
    assert (twice.status == GIVEN_UP) == gives_up
    assert twice.reason == (NO_PLACE if gives_up else NO_REASON)

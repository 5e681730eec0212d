"""The search from its first reading to its end: moves the line, claims, gives up.

    looking   the best candidate's line is flown
    soaring   claimed when the line has stood still for CLAIM_S, the aircraft neither climbs nor
              sinks, and CLAIM_CHANCE of the likely fields keep it there, and so does a wind a tenth
              weaker; withdrawn when it climbs, sinks, the line moves, half of the
              fields do not keep it, or it sinks a little where a weaker wind would not leave it
    given up  no likely field has a line that soars, or the height that landing needs is near, or
              the ceiling, and nothing that will do is found: with the reason, while there is height
              to land

`search_step` is pure: the time is that between two calls, what the map says comes in as a plan.
"""

from __future__ import annotations

from math import inf
from typing import Final, NamedTuple

from tgl_soar.control.search.glimpse import (
    GIVEN_UP,
    LOOK_S,
    LOOKING,
    NO_PLACE,
    NO_REASON,
    SOARING,
    TOO_HIGH,
    TOO_LOW,
)
from tgl_soar.control.search.plan import Keep, LinePlan, horizon_of
from tgl_soar.control.search.rollout import Guards
from tgl_soar.control.target_line import TargetLine

CLAIM_S: Final = 6.0
CLAIM_CLIMB_MPS: Final = 0.05
CLAIM_CHANCE: Final = 0.8
KEEP_CHANCE: Final = 0.5  # a claim is withdrawn below
KEEP_CLIMB_MPS: Final = 0.12
WEAKER_SINK_MPS: Final = 0.02  # so little where a weaker wind would not leave the place
CLIMB_S: Final = 3.0  # over which the climb is averaged, or CLIMB_FRACTION of a rollout's horizon:
CLIMB_FRACTION: Final = 0.25  # where the box is larger, so are the gusts, and all is slower
# Chance of the best line: that of one field in eleven, as a rule of a wind a tenth stronger.
HOPELESS: Final = 0.10
HOPELESS_S: Final = 2.0  # so long before it is accepted
SOARS_WORTH: Final = 1.2  # of a rollout, with some margin: `plan.worths`
FAILS_WORTH: Final = -0.6
PLAN_EARLY_S: Final = 0.4
PLAN_S: Final = 1.0
EARLY_S: Final = 8.0
REACTION_S: Final = 0.4  # two looks, before the height is needed
CEILING_S: Final = LOOK_S  # nothing is needed beyond it
CEILING_CHANCE: Final = 1.0 / 3.0  # near a limit two to one against it is enough, as in `forecast`
# Lost by every line within two early plans in a tunnel, as a share of a rollout's horizon, and
# before it would be accepted.
LOST_FRACTION: Final = 0.08
GLIDE_SINK_MPS: Final = 1.4  # what a glider sinks, where it does not climb


class SearchState(NamedTuple):
    """What the search remembers."""

    status: int
    reason: int
    target: TargetLine  # where the line is to go
    time_s: float  # since the start
    climb_mps: float  # averaged
    still_s: float  # since the line came to rest
    hopeless_s: float
    since_plan_s: float
    chance: float  # of the last plan's line
    lost: bool  # by the last plan every line was lost soon


def started(target: TargetLine) -> SearchState:
    """At the start, on a line."""
    return SearchState(
        status=LOOKING,
        reason=NO_REASON,
        target=target,
        time_s=0.0,
        climb_mps=0.0,
        still_s=0.0,
        hopeless_s=0.0,
        since_plan_s=PLAN_S,
        chance=1.0,
        lost=False,
    )


def plan_due(state: SearchState) -> bool:
    """Whether it is time for a plan at the look that comes now."""
    every = PLAN_EARLY_S if state.time_s < EARLY_S else PLAN_S
    return state.status != GIVEN_UP and state.since_plan_s + LOOK_S >= every - 1e-9


def kept(state: SearchState) -> Keep:
    """When the present line is kept.

    A line settles the aircraft wherever it has a crossing, and every move costs height and begins
    with little known: a line that will as likely as not do is given the time to show it.  After
    that it has to be one that can be claimed, in a weaker wind as well: else the aircraft hovers
    for ever on a line that never will be, beside a better one.  A line that is claimed is not left
    for that: the claim is withdrawn first.
    """
    tried = state.still_s >= CLAIM_S
    chance = CLAIM_CHANCE if tried else KEEP_CHANCE
    return Keep(
        worth=chance * SOARS_WORTH + (1.0 - chance) * FAILS_WORTH,
        weaker=tried and state.status != SOARING,
    )


def climb_s(height_m: float) -> float:
    """Over how long the climb is averaged [s] in a box of this height [m]."""
    return max(CLIMB_S, CLIMB_FRACTION * horizon_of(height_m))


def search_step(
    state: SearchState,
    guards: Guards,
    plan: LinePlan | None,
    climb_mps: float,
    over_ground_m: float,
    moving: bool,
    dt_s: float,
    *,
    under_ceiling_m: float = inf,
    carried: bool = False,
) -> SearchState:
    """Go on by dt_s; plan: a new one, or None; over_ground_m: height; moving: the line slides;
    carried: power can keep the aircraft from sinking; under_ceiling_m: to the fence's."""
    if state.status == GIVEN_UP:
        return state
    gain = min(1.0, dt_s / climb_s(guards.box.height_m))
    state = state._replace(
        time_s=state.time_s + dt_s,
        climb_mps=state.climb_mps + gain * (climb_mps - state.climb_mps),
        still_s=0.0 if moving else state.still_s + dt_s,
        since_plan_s=state.since_plan_s + dt_s,
    )
    lost = False
    if plan is not None:
        # A lull of a second looks as if all were lost: two plans one after the other are accepted.
        soon = abs(climb_mps) > CLAIM_CLIMB_MPS and is_lost(plan, guards.box.height_m)
        lost = soon and state.lost
        state = _planned(state, plan)._replace(lost=soon)
    reason = _why_not(state, guards, lost, climb_mps, over_ground_m, carried)
    # The module disengages at the fence: as well before it, in words.
    leaves = under_ceiling_m < CEILING_S * climb_mps and state.chance < CEILING_CHANCE
    if reason == NO_REASON and leaves:
        reason = TOO_HIGH
    if reason != NO_REASON:
        return state._replace(status=GIVEN_UP, reason=reason)
    return state._replace(status=SOARING if _soars(state, plan) else LOOKING)


def _planned(state: SearchState, plan: LinePlan) -> SearchState:
    """With what a new plan says."""
    # At rest there is nothing to lose: whatever the map says, the aircraft soars.
    hopeless = plan.most_chance < HOPELESS and abs(state.climb_mps) > CLAIM_CLIMB_MPS
    return state._replace(
        since_plan_s=0.0,
        hopeless_s=state.hopeless_s + state.since_plan_s if hopeless else 0.0,
        target=plan.target,
        still_s=state.still_s if plan.stays else 0.0,
        chance=plan.chance,
    )


def _soars(state: SearchState, plan: LinePlan | None) -> bool:
    """Whether the claim may be made, which takes a plan, or kept."""
    if state.status == SOARING:
        still = abs(state.climb_mps) < KEEP_CLIMB_MPS
        if plan is None:
            return still
        firm = plan.stay_weaker or state.climb_mps > -WEAKER_SINK_MPS
        return still and firm and plan.stays and plan.stay_chance >= KEEP_CHANCE
    return (
        plan is not None
        and state.still_s >= CLAIM_S
        and plan.stays
        and abs(state.climb_mps) < CLAIM_CLIMB_MPS
        and plan.stay_chance >= CLAIM_CHANCE
        and plan.stay_weaker
    )


def is_lost(plan: LinePlan, height_m: float) -> bool:
    """Whether on every line the aircraft leaves a guard before there is much more to know."""
    soon_s = min(HOPELESS_S, LOST_FRACTION * horizon_of(height_m))
    return plan.most_chance < HOPELESS and plan.lasts_s < soon_s


def _why_not(
    state: SearchState,
    guards: Guards,
    lost: bool,
    climb_mps: float,
    over_ground_m: float,
    carried: bool,
) -> int:
    """Why the search is over, if it is."""
    if carried:  # as long as there is power it can go and look elsewhere
        return NO_REASON
    if lost or state.hopeless_s >= HOPELESS_S:
        return NO_PLACE
    if climb_mps > CLAIM_CLIMB_MPS:  # no height runs out
        return NO_REASON
    sinks = max(-climb_mps, 0.0)
    left_m = over_ground_m - guards.landing_m
    if state.chance < KEEP_CHANCE:
        return TOO_LOW if left_m < REACTION_S * max(sinks, 0.5 * GLIDE_SINK_MPS) else NO_REASON
    # Rollouts have begun with this very sink and know how it ends: where nearly all of them soar a
    # gust's dip is waited for, until there is just the height at the next look.
    reaction_s = LOOK_S if state.chance >= CLAIM_CHANCE else REACTION_S
    return TOO_LOW if left_m < reaction_s * sinks else NO_REASON

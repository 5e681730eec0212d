"""The supervisor: which mode, decided by one table.

    boot        not every stream has arrived yet
    standby     the module watches, and something that engaging needs is missing
    ready       all of it is there: engaging would be granted now
    capturing   in control; the line it flies slides from the aircraft to its target
    soaring     the line stands still, or slides slowly in a survey, and the aircraft is on it
    holding     no confident position for a short, limited time: pitch, wings and heading are held
    recovering  nose down to the best glide, wings level, for a limited time: after a stall, too
                low, or after too long without a confident position
    released    it has disengaged by itself, and stays so until the operator has disengaged, too
    failed      a fault of its own: it has disengaged, and stays so until it is started again
    searching   in control; the search for lift moves the line (`control.search`)
    launching   in control from the hand on: waits for the throw, gains speed, glides to the line
    breaking off  out into the wind, away from the slope: height for the landing is all that counts
    landing     a straight glide to the landing place, and the flare (`control.landing`)
    beating     to and fro along the ridge, where it cannot stand (`control.ridge_beat`)

A row reads: from this mode, when all of these hold and none of those, go there, do that, and
say why.  Rows are tried in order and the first that fits is taken; none fits: stay.  Conditions
are bits of one number, so that a test can walk through all of them.

Fence and height are judged on the estimate in every mode in control, however uncertain it is:
where the position is lost the estimate is still the best that is known of the place.  No mode
without a confident position lasts: holding ends by its own timer, recovering by its own, and
before that where a glide in still air may have come down to the least clearance meanwhile.  Two
modes leave the fence upstream and come down on purpose, breaking off and landing: they end at its
downstream side, and where the position stays lost for as long as recovering may last.  Beating ends
so, too, and becomes breaking off at the other sides and where it is too low.

What must last counts in explicit timers of the state, so that noise cannot make it chatter:
capturing, soaring and searching are left for each other or for holding only after MINIMUM_S (for
capturing at once where a search is over), so is recovering for capturing, trouble must last
TROUBLE_S and its end CLEAR_S, and ready is given up only after READY_S without.

A new mode or fault is a new row.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.types import (
    BEATING,
    BOOT,
    BREAKING_OFF,
    CAPTURING,
    FAILED,
    HOLDING,
    INFINITE,
    LANDING,
    LAUNCHING,
    READY,
    RECOVERING,
    RELEASED,
    SEARCHING,
    SOARING,
    STANDBY,
)

MINIMUM_S: Final = 0.2
READY_S: Final = 1.0
TROUBLE_S: Final = 0.1
CLEAR_S: Final = 0.3
LONG_GAP_S: Final = 0.3  # of holding, after which the line is reset to the aircraft

# Conditions that the tick finds.
ENGAGE: Final = 1 << 0
STREAMS_ARRIVED: Final = 1 << 1
POSITION_FRESH: Final = 1 << 2
POSITION_KEPT: Final = 1 << 3
POSITION_SANE: Final = 1 << 4
ATTITUDE_FRESH: Final = 1 << 5
ATTITUDE_AGREES: Final = 1 << 6
AUTOPILOT_ALIVE: Final = 1 << 7
NO_FAILSAFE: Final = 1 << 8
SURFACES_OBEY: Final = 1 << 9
SURFACES_ANSWER: Final = 1 << 10
AIRSPEED_SANE: Final = 1 << 11
UPRIGHT: Final = 1 << 12
UPWIND: Final = 1 << 13
INSIDE_FENCE: Final = 1 << 14
LINE_VALID: Final = 1 << 15
LINE_MOVING: Final = 1 << 16
NEAR_LINE: Final = 1 << 17
ON_LINE: Final = 1 << 18
AIR_SAFE: Final = 1 << 19
HIGH_ENOUGH: Final = 1 << 20
CLEAR: Final = 1 << 21  # both of these, with a margin
FINITE: Final = 1 << 22
SANE: Final = 1 << 23
SETTLES: Final = 1 << 24
SEARCH: Final = 1 << 25
PLACE_FOUND: Final = 1 << 26
LAUNCH: Final = 1 << 27
THROWN: Final = 1 << 28
LINE_REACHED: Final = 1 << 29
THROW_AWAITED: Final = 1 << 30
THROWN_LEVEL: Final = 1 << 31
SPEED_GAINED: Final = 1 << 32
LAUNCH_HIGH: Final = 1 << 33
LINE_IN_REACH: Final = 1 << 34
BREAK_OFF: Final = 1 << 35
SOAR_ON: Final = 1 << 36
AWAY: Final = 1 << 37
ON_GROUND: Final = 1 << 38
INSIDE_LEE: Final = 1 << 39
NOT_BLIND: Final = 1 << 40
BEAT: Final = 1 << 41
BEAT_OVER: Final = 1 << 42
FOUND: Final = (1 << 43) - 1
# Conditions that the supervisor finds itself, by what it remembers.
SAME_BOOT: Final = 1 << 43
STAYS_ARMED: Final = 1 << 44
STILL_READY: Final = 1 << 45
SETTLED: Final = 1 << 46
LONG_GAP: Final = 1 << 47
TIME_UP: Final = 1 << 48
TROUBLED: Final = 1 << 49
CLEARED: Final = 1 << 50
CONDITIONS: Final = 51
ENTRY: Final = (
    AUTOPILOT_ALIVE
    | ATTITUDE_FRESH
    | ATTITUDE_AGREES
    | POSITION_FRESH
    | POSITION_SANE
    | NO_FAILSAFE
    | SURFACES_OBEY
    | SURFACES_ANSWER
    | AIRSPEED_SANE
    | UPRIGHT
    | UPWIND
    | INSIDE_FENCE
    | LINE_VALID
    | AIR_SAFE
    | HIGH_ENOUGH
)

_CALM: Final = AIR_SAFE | HIGH_ENOUGH

# What the tick does at a change of mode.
NOTHING: Final = 0
TAKE: Final = 1  # the surfaces; the line starts at the aircraft
NEW_LINE: Final = 2  # the line starts at the aircraft again
KEEP_LINE: Final = 3
HOLD: Final = 4  # pitch, wings level, heading
GLIDE: Final = 5  # nose down to the best glide, wings level
HAND_OVER: Final = 6
ACTION_TEXTS: Final = (
    "",
    "take the surfaces, start the line at the aircraft",
    "start the line at the aircraft",
    "fly the line on",
    "hold pitch, wings and heading",
    "best glide, wings level",
    "hand over",
)

# Reasons for a change of mode.
REASON_NONE: Final = 0
REASON_ENGAGED: Final = 1
REASON_OPERATOR: Final = 2
REASON_ON_LINE: Final = 3
REASON_LINE_MOVED: Final = 4
REASON_POSITION_GAP: Final = 5
REASON_POSITION_BACK: Final = 6
REASON_POSITION_LOST: Final = 7
REASON_ATTITUDE_LOST: Final = 8
REASON_AUTOPILOT_LOST: Final = 9
REASON_MODE_TAKEN: Final = 10
REASON_UPSET: Final = 11
REASON_OFF_LINE: Final = 12
REASON_NOT_FINITE: Final = 13
REASON_WITHDRAWN: Final = 14
REASON_ARRIVED: Final = 15
REASON_READY: Final = 16
REASON_POSITION_INSANE: Final = 17
REASON_ATTITUDE_DISAGREES: Final = 18
REASON_FAILSAFE: Final = 19
REASON_REBOOTED: Final = 20
REASON_DISARMED: Final = 21
REASON_SURFACES_DEAD: Final = 22
REASON_AIRSPEED: Final = 23
REASON_DOWNWIND: Final = 24
REASON_FENCE: Final = 25
REASON_LINE: Final = 26
REASON_STALL: Final = 27
REASON_LOW: Final = 28
REASON_RECOVERED: Final = 29
REASON_NOT_RECOVERED: Final = 30
REASON_INSANE: Final = 31
REASON_NOWHERE: Final = 32
REASON_SEARCH: Final = 33
REASON_PLACE_FOUND: Final = 34
REASON_SEARCH_OVER: Final = 35
REASON_NOT_FOUND: Final = 36
REASON_LAUNCH: Final = 37
REASON_LINE_REACHED: Final = 38
REASON_LAUNCH_OFF: Final = 39
REASON_NO_THROW: Final = 40
REASON_STEEP: Final = 41
REASON_NO_SPEED: Final = 42
REASON_LAUNCH_LOW: Final = 43
REASON_FAR: Final = 44
REASON_BREAK: Final = 45
REASON_AWAY: Final = 46
REASON_LANDED: Final = 47
REASON_SOAR_ON: Final = 48
REASON_BEAT: Final = 49
REASON_STANDS: Final = 50


class Transition(NamedTuple):
    """One row of the table."""

    source: int
    all_of: int
    none_of: int
    to: int
    action: int
    reason: int


# Every entry check and the reason given for it, in the order in which an operator would look.
_CHECKS: Final = (
    (AUTOPILOT_ALIVE, REASON_AUTOPILOT_LOST),
    (ATTITUDE_FRESH, REASON_ATTITUDE_LOST),
    (ATTITUDE_AGREES, REASON_ATTITUDE_DISAGREES),
    (POSITION_FRESH, REASON_POSITION_LOST),
    (POSITION_SANE, REASON_POSITION_INSANE),
    (NO_FAILSAFE, REASON_FAILSAFE),
    (SURFACES_OBEY, REASON_MODE_TAKEN),
    (SURFACES_ANSWER, REASON_SURFACES_DEAD),
    (AIRSPEED_SANE, REASON_AIRSPEED),
    (UPRIGHT, REASON_UPSET),
    (UPWIND, REASON_DOWNWIND),
    (INSIDE_FENCE, REASON_FENCE),
    (HIGH_ENOUGH, REASON_LOW),
    (AIR_SAFE, REASON_STALL),
    (LINE_VALID, REASON_LINE),
)


def _refusals(mode: int) -> tuple[Transition, ...]:
    """Asked to engage: every entry check has a row that refuses."""
    return tuple(
        Transition(mode, ENGAGE, check, RELEASED, HAND_OVER, reason) for check, reason in _CHECKS
    )


def _faults(mode: int) -> tuple[Transition, ...]:
    """What makes every mode in control disengage, worst first."""
    return (
        Transition(mode, 0, FINITE, FAILED, HAND_OVER, REASON_NOT_FINITE),
        Transition(mode, 0, SANE, FAILED, HAND_OVER, REASON_INSANE),
        Transition(mode, 0, ATTITUDE_FRESH, RELEASED, HAND_OVER, REASON_ATTITUDE_LOST),
        Transition(mode, 0, AUTOPILOT_ALIVE, RELEASED, HAND_OVER, REASON_AUTOPILOT_LOST),
        Transition(mode, 0, SAME_BOOT, RELEASED, HAND_OVER, REASON_REBOOTED),
        Transition(mode, 0, NO_FAILSAFE, RELEASED, HAND_OVER, REASON_FAILSAFE),
        Transition(mode, 0, SURFACES_OBEY, RELEASED, HAND_OVER, REASON_MODE_TAKEN),
        Transition(mode, 0, STAYS_ARMED, RELEASED, HAND_OVER, REASON_DISARMED),
        Transition(mode, 0, ENGAGE, STANDBY, HAND_OVER, REASON_OPERATOR),
        Transition(mode, 0, ATTITUDE_AGREES, RELEASED, HAND_OVER, REASON_ATTITUDE_DISAGREES),
        Transition(mode, 0, SURFACES_ANSWER, RELEASED, HAND_OVER, REASON_SURFACES_DEAD),
        Transition(mode, 0, UPRIGHT, RELEASED, HAND_OVER, REASON_UPSET),
        Transition(mode, 0, UPWIND, RELEASED, HAND_OVER, REASON_DOWNWIND),
    )


def _breaks_off(mode: int) -> Transition:
    """Every mode in the air ends so where the operator, or the height that is left, wants it."""
    return Transition(mode, BREAK_OFF, 0, BREAKING_OFF, NOTHING, REASON_BREAK)


def _on_the_line(mode: int, nowhere: int = REASON_NOWHERE) -> tuple[Transition, ...]:
    """What capturing, soaring and searching have in common; nowhere: the reason where it settles
    nowhere."""
    return (
        *_faults(mode),
        _breaks_off(mode),
        Transition(mode, SETTLED, POSITION_FRESH, HOLDING, HOLD, REASON_POSITION_GAP),
        Transition(mode, 0, INSIDE_FENCE, RELEASED, HAND_OVER, REASON_FENCE),
        Transition(mode, BEAT | SETTLED, 0, BEATING, NOTHING, REASON_BEAT),
        Transition(mode, BEAT, NEAR_LINE, BEATING, NOTHING, REASON_BEAT),
        Transition(mode, BEAT, SETTLES, BEATING, NOTHING, REASON_BEAT),
        Transition(mode, 0, NEAR_LINE, RELEASED, HAND_OVER, REASON_OFF_LINE),
        Transition(mode, 0, SETTLES, RELEASED, HAND_OVER, nowhere),
        Transition(mode, TROUBLED, AIR_SAFE, RECOVERING, GLIDE, REASON_STALL),
        Transition(mode, TROUBLED, HIGH_ENOUGH, RECOVERING, GLIDE, REASON_LOW),
    )


def _on_the_way_home(mode: int) -> tuple[Transition, ...]:
    """It ends over the slope or blind; the operator takes it back where the line can be flown."""
    back = SOAR_ON | POSITION_FRESH | INSIDE_FENCE | HIGH_ENOUGH | SETTLED
    return (
        *_faults(mode),
        Transition(mode, 0, INSIDE_LEE, RELEASED, HAND_OVER, REASON_FENCE),
        Transition(mode, 0, NOT_BLIND, RELEASED, HAND_OVER, REASON_POSITION_LOST),
        Transition(mode, back, 0, CAPTURING, NEW_LINE, REASON_SOAR_ON),
    )


def _launch(
    lost: int, reason: int, all_of: int = 0, to: int = BREAKING_OFF, action: int = NOTHING
) -> Transition:
    """A launch that cannot go on without what is lost: in the air it breaks off."""
    return Transition(LAUNCHING, all_of, lost, to, action, reason)


TRANSITIONS: Final[tuple[Transition, ...]] = (
    *_refusals(BOOT),
    Transition(BOOT, STREAMS_ARRIVED, 0, STANDBY, NOTHING, REASON_ARRIVED),
    *_refusals(STANDBY),
    Transition(STANDBY, ENTRY, 0, READY, NOTHING, REASON_READY),
    *_refusals(READY),
    Transition(READY, ENGAGE | LAUNCH, 0, LAUNCHING, TAKE, REASON_LAUNCH),
    Transition(READY, ENGAGE, 0, CAPTURING, TAKE, REASON_ENGAGED),
    *(
        Transition(READY, 0, STILL_READY | check, STANDBY, NOTHING, reason)
        for check, reason in _CHECKS
    ),
    *_on_the_line(CAPTURING),
    Transition(CAPTURING, SEARCH | SETTLED, 0, SEARCHING, NOTHING, REASON_SEARCH),
    Transition(CAPTURING, ON_LINE | SETTLED, LINE_MOVING, SOARING, NOTHING, REASON_ON_LINE),
    *_on_the_line(SOARING),
    Transition(SOARING, SEARCH | SETTLED, PLACE_FOUND, SEARCHING, NOTHING, REASON_SEARCH),
    Transition(SOARING, LINE_MOVING | SETTLED, SEARCH, CAPTURING, NOTHING, REASON_LINE_MOVED),
    *_faults(HOLDING),
    _breaks_off(HOLDING),
    Transition(HOLDING, 0, INSIDE_FENCE, RELEASED, HAND_OVER, REASON_FENCE),
    Transition(HOLDING, 0, POSITION_KEPT, RECOVERING, GLIDE, REASON_POSITION_LOST),
    Transition(HOLDING, TROUBLED, AIR_SAFE, RECOVERING, GLIDE, REASON_STALL),
    Transition(HOLDING, TROUBLED, HIGH_ENOUGH, RECOVERING, GLIDE, REASON_LOW),
    Transition(HOLDING, POSITION_FRESH | LONG_GAP, 0, CAPTURING, NEW_LINE, REASON_POSITION_BACK),
    Transition(HOLDING, POSITION_FRESH, 0, CAPTURING, KEEP_LINE, REASON_POSITION_BACK),
    Transition(HOLDING, TIME_UP, 0, RECOVERING, GLIDE, REASON_POSITION_LOST),
    *_faults(RECOVERING),
    _breaks_off(RECOVERING),
    Transition(RECOVERING, 0, INSIDE_FENCE, RELEASED, HAND_OVER, REASON_FENCE),
    Transition(RECOVERING, 0, POSITION_FRESH | HIGH_ENOUGH, RELEASED, HAND_OVER, REASON_LOW),
    Transition(
        RECOVERING, POSITION_FRESH | CLEARED | SETTLED, 0, CAPTURING, NEW_LINE, REASON_RECOVERED
    ),
    Transition(RECOVERING, TIME_UP, POSITION_FRESH, RELEASED, HAND_OVER, REASON_POSITION_LOST),
    Transition(RECOVERING, TIME_UP, HIGH_ENOUGH, RELEASED, HAND_OVER, REASON_LOW),
    Transition(RECOVERING, TIME_UP, AIR_SAFE, RELEASED, HAND_OVER, REASON_STALL),
    Transition(RECOVERING, TIME_UP, 0, RELEASED, HAND_OVER, REASON_NOT_RECOVERED),
    Transition(RELEASED, STREAMS_ARRIVED, ENGAGE, STANDBY, NOTHING, REASON_WITHDRAWN),
    Transition(RELEASED, 0, ENGAGE, BOOT, NOTHING, REASON_WITHDRAWN),
    *_on_the_line(SEARCHING, REASON_NOT_FOUND),
    Transition(SEARCHING, 0, SEARCH, CAPTURING, NOTHING, REASON_SEARCH_OVER),
    Transition(SEARCHING, PLACE_FOUND | ON_LINE | SETTLED, 0, SOARING, NOTHING, REASON_PLACE_FOUND),
    *_faults(LAUNCHING),
    _launch(INSIDE_FENCE, REASON_FENCE, to=RELEASED, action=HAND_OVER),
    _launch(THROW_AWAITED, REASON_NO_THROW, to=RELEASED, action=HAND_OVER),
    _launch(THROWN | LAUNCH, REASON_LAUNCH_OFF, to=RELEASED, action=HAND_OVER),
    _launch(THROWN | POSITION_KEPT, REASON_POSITION_LOST, to=RELEASED, action=HAND_OVER),
    Transition(LAUNCHING, THROWN | BREAK_OFF, 0, BREAKING_OFF, NOTHING, REASON_BREAK),
    _launch(THROWN_LEVEL, REASON_STEEP),
    _launch(SPEED_GAINED, REASON_NO_SPEED),
    _launch(LAUNCH_HIGH, REASON_LAUNCH_LOW),
    _launch(LINE_IN_REACH, REASON_FAR),
    _launch(POSITION_KEPT, REASON_POSITION_LOST),
    Transition(LAUNCHING, LINE_REACHED, 0, CAPTURING, KEEP_LINE, REASON_LINE_REACHED),
    *_on_the_way_home(BREAKING_OFF),
    Transition(BREAKING_OFF, ON_GROUND, 0, RELEASED, HAND_OVER, REASON_LANDED),
    Transition(BREAKING_OFF, AWAY | SETTLED, 0, LANDING, NOTHING, REASON_AWAY),
    *_on_the_way_home(LANDING),
    Transition(LANDING, ON_GROUND, 0, RELEASED, HAND_OVER, REASON_LANDED),
    *_faults(BEATING),
    _breaks_off(BEATING),
    Transition(BEATING, 0, INSIDE_LEE, RELEASED, HAND_OVER, REASON_FENCE),
    Transition(BEATING, 0, NOT_BLIND, RELEASED, HAND_OVER, REASON_POSITION_LOST),
    Transition(BEATING, 0, INSIDE_FENCE, BREAKING_OFF, NOTHING, REASON_FENCE),
    Transition(BEATING, TROUBLED, HIGH_ENOUGH, BREAKING_OFF, NOTHING, REASON_LOW),
    Transition(
        BEATING, BEAT_OVER | SETTLED | POSITION_FRESH, BEAT, CAPTURING, NEW_LINE, REASON_STANDS
    ),
)


class SupervisorState(NamedTuple):
    """What the supervisor remembers; times on the loop's clock."""

    mode: int
    since_s: float  # when this mode began; inf: with the next tick
    unready_s: float  # since when an entry check fails; inf: none does
    trouble_s: float  # since when the air or the height is not safe; inf: they are
    clear_s: float  # since when both are safe with a margin; inf: they are not
    boots: int  # of the autopilot, when it was last looked at
    armed: bool  # the autopilot, when it was last looked at
    conditions: int  # with which this mode stays as it is; -1: not looked at yet


class Decision(NamedTuple):
    """What to do in this tick, and why."""

    mode: int
    action: int
    reason: int


def initial_supervisor() -> SupervisorState:
    """Before the first tick."""
    return SupervisorState(
        mode=BOOT,
        since_s=INFINITE,
        unready_s=INFINITE,
        trouble_s=INFINITE,
        clear_s=INFINITE,
        boots=0,
        armed=False,
        conditions=-1,
    )


def supervise(
    state: SupervisorState,
    time_s: float,
    found: int,
    boots: int,
    armed: bool,
    hold_s: float,
    recover_s: float,
) -> tuple[SupervisorState, Decision]:
    """One look at what the tick has found, the bits up to SANE.

    boots, armed: of the autopilot, as it reports; hold_s, recover_s: the longest time in holding
    and in recovering.
    """
    # The minima: what began in the future, because the clock has gone back, counts from here.
    since_s = min(state.since_s, time_s)
    unready_s = INFINITE if found & ENTRY == ENTRY else min(state.unready_s, time_s)
    calm = found & _CALM == _CALM
    trouble_s = INFINITE if calm else min(state.trouble_s, time_s)
    clear_s = min(state.clear_s, time_s) if calm and found & CLEAR else INFINITE

    conditions = found
    lasted_s = time_s - since_s
    if boots == state.boots:
        conditions |= SAME_BOOT
    if armed or not state.armed:
        conditions |= STAYS_ARMED
    if time_s - unready_s < READY_S:
        conditions |= STILL_READY
    if lasted_s >= MINIMUM_S:
        conditions |= SETTLED
    if lasted_s >= LONG_GAP_S:
        conditions |= LONG_GAP
    if lasted_s >= (hold_s if state.mode == HOLDING else recover_s):
        conditions |= TIME_UP
    if time_s - trouble_s >= TROUBLE_S:
        conditions |= TROUBLED
    if time_s - clear_s >= CLEAR_S:
        conditions |= CLEARED

    # The same conditions need not be looked up twice, unless a timer was reset.
    as_before = since_s == state.since_s and trouble_s == state.trouble_s
    as_before = as_before and clear_s == state.clear_s and unready_s == state.unready_s
    if as_before and conditions == state.conditions and armed == state.armed:
        return state, Decision(state.mode, NOTHING, REASON_NONE)
    decision = next_mode(state.mode, conditions)
    if decision.mode != state.mode:
        since_s = time_s if time_s == time_s else INFINITE
        conditions = -1  # the new mode's rows were not tried yet
    return SupervisorState(
        mode=decision.mode,
        since_s=since_s,
        unready_s=unready_s,
        trouble_s=trouble_s,
        clear_s=clear_s,
        boots=boots,
        armed=armed,
        conditions=conditions,
    ), decision


def next_mode(mode: int, conditions: int) -> Decision:
    """What the table says; the same mode and REASON_NONE where it stays."""
    for row in TRANSITIONS:
        if (
            row.source == mode
            and conditions & row.all_of == row.all_of
            and conditions & row.none_of == 0
        ):
            return Decision(row.to, row.action, row.reason)
    return Decision(mode, NOTHING, REASON_NONE)


def is_flying(mode: int) -> bool:
    """Whether the module is in control in this mode."""
    return CAPTURING <= mode <= RECOVERING or SEARCHING <= mode <= BEATING


def goes_home(mode: int) -> bool:
    """Whether the module is on its way to the landing place."""
    return mode in (BREAKING_OFF, LANDING)


def flies_without_line(mode: int) -> bool:
    """Whether speed and heading are held in this mode, and no line."""
    return goes_home(mode) or mode == BEATING

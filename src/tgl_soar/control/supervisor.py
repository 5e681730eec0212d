"""The supervisor: which mode, decided by one table.

    standby     the module watches; the surfaces belong to the pilot and the autopilot
    capturing   it has the surfaces; the line it flies slides from the aircraft to its target
    soaring     the line stands still and the aircraft is on it
    holding     the position is lost for a short time: pitch, wings and heading are held
    released    it has let go by itself, and stays so until the operator has withdrawn the wish

A row reads: from this mode, when all of these hold and none of those, go there, because.
Rows are tried in order and the first that fits is taken; none fits: stay.  Conditions are
bits of one number, so that a test can walk through all of them.

A new mode or fault is a new row.
"""

from __future__ import annotations

from typing import Final, NamedTuple

# Modes.  Plain numbers: they go over the wire and into the log.
STANDBY: Final = 0
CAPTURING: Final = 1
SOARING: Final = 2
HOLDING: Final = 3
RELEASED: Final = 4
MODE_NAMES: Final = ("standby", "capturing", "soaring", "holding", "released")

# Conditions.
ENGAGE: Final = 1 << 0  # the operator wants the module to fly
POSITION_FRESH: Final = 1 << 1  # good enough to fly the line with
POSITION_KEPT: Final = 1 << 2  # not lost for longer than may be held through
ATTITUDE_FRESH: Final = 1 << 3
AUTOPILOT_ALIVE: Final = 1 << 4  # its heartbeat is heard
SURFACES_OBEY: Final = 1 << 5  # the autopilot is in a mode in which it obeys our surfaces
UPRIGHT: Final = 1 << 6  # roll and pitch within what the laws are made for
NEAR_LINE: Final = 1 << 7  # e_rho within what the laws are made for
ON_LINE: Final = 1 << 8  # the line is at its target and the aircraft has stayed on it
LINE_MOVING: Final = 1 << 9
FINITE: Final = 1 << 10  # the last surface command was a number
ALL_CONDITIONS: Final = (1 << 11) - 1

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
REASON_TEXTS: Final = (
    "",
    "engaged",
    "operator let go",
    "on the line",
    "line moves",
    "position gap, holding pitch",
    "position is back",
    "position lost",
    "attitude lost",
    "autopilot silent",
    "autopilot not in the mode that obeys",
    "roll or pitch beyond TILT_MAX",
    "e_rho beyond CAPTURE_MAX",
    "command not finite",
    "ready",
)


class Transition(NamedTuple):
    """One row of the table."""

    source: int
    all_of: int
    none_of: int
    to: int
    reason: int


def _faults(mode: int) -> tuple[Transition, ...]:
    """What makes every flying mode let go, worst first."""
    return (
        Transition(mode, 0, FINITE, RELEASED, REASON_NOT_FINITE),
        Transition(mode, 0, ATTITUDE_FRESH, RELEASED, REASON_ATTITUDE_LOST),
        Transition(mode, 0, AUTOPILOT_ALIVE, RELEASED, REASON_AUTOPILOT_LOST),
        Transition(mode, 0, SURFACES_OBEY, RELEASED, REASON_MODE_TAKEN),
        Transition(mode, 0, ENGAGE, STANDBY, REASON_OPERATOR),
        Transition(mode, 0, UPRIGHT, RELEASED, REASON_UPSET),
        Transition(mode, 0, POSITION_KEPT, RELEASED, REASON_POSITION_LOST),
    )


TRANSITIONS: Final[tuple[Transition, ...]] = (
    # Asked to engage: every entry check has a row that refuses, then the way in.
    Transition(STANDBY, ENGAGE, AUTOPILOT_ALIVE, RELEASED, REASON_AUTOPILOT_LOST),
    Transition(STANDBY, ENGAGE, ATTITUDE_FRESH, RELEASED, REASON_ATTITUDE_LOST),
    Transition(STANDBY, ENGAGE, POSITION_FRESH, RELEASED, REASON_POSITION_LOST),
    Transition(STANDBY, ENGAGE, SURFACES_OBEY, RELEASED, REASON_MODE_TAKEN),
    Transition(STANDBY, ENGAGE, UPRIGHT, RELEASED, REASON_UPSET),
    Transition(STANDBY, ENGAGE, 0, CAPTURING, REASON_ENGAGED),
    *_faults(CAPTURING),
    Transition(CAPTURING, 0, POSITION_FRESH, HOLDING, REASON_POSITION_GAP),
    Transition(CAPTURING, 0, NEAR_LINE, RELEASED, REASON_OFF_LINE),
    Transition(CAPTURING, ON_LINE, LINE_MOVING, SOARING, REASON_ON_LINE),
    *_faults(SOARING),
    Transition(SOARING, 0, POSITION_FRESH, HOLDING, REASON_POSITION_GAP),
    Transition(SOARING, 0, NEAR_LINE, RELEASED, REASON_OFF_LINE),
    Transition(SOARING, LINE_MOVING, 0, CAPTURING, REASON_LINE_MOVED),
    *_faults(HOLDING),
    Transition(HOLDING, POSITION_FRESH, 0, CAPTURING, REASON_POSITION_BACK),
    Transition(RELEASED, 0, ENGAGE, STANDBY, REASON_WITHDRAWN),
)


def next_mode(mode: int, conditions: int) -> tuple[int, int]:
    """(mode, reason) after one look at the conditions; (mode, REASON_NONE) where it stays."""
    for row in TRANSITIONS:
        if (
            row.source == mode
            and conditions & row.all_of == row.all_of
            and conditions & row.none_of == 0
        ):
            return row.to, row.reason
    return mode, REASON_NONE


def is_flying(mode: int) -> bool:
    """Whether the module has the surfaces in this mode."""
    return mode in (CAPTURING, SOARING, HOLDING)

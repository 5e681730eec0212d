"""Words stand under the supervisor's numbers: a station, a log and the page know the number alone.

What a text has to say is what its number is called after: the mode by name, the condition in the
sense in which it holds, the reason by what has happened.
"""

from __future__ import annotations

import pytest

from tgl_soar.control import supervisor
from tgl_soar.control.supervisor import TRANSITIONS
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES, REASON_TEXTS

# docs/modes.md lists them with these numbers.
MODES = {
    "BOOT": "boot",
    "STANDBY": "standby",
    "READY": "ready",
    "CAPTURING": "capturing",
    "SOARING": "soaring",
    "HOLDING": "holding",
    "RECOVERING": "recovering",
    "RELEASED": "released",
    "FAILED": "failed",
    "SEARCHING": "searching",
    "LAUNCHING": "launching",
    "BREAKING_OFF": "breaking off",
    "LANDING": "landing",
    "BEATING": "beating",
}
# By the name of a condition: what its text must say.
CONDITIONS = {
    "ENGAGE": "operator has engaged",
    "STREAMS_ARRIVED": "every stream",
    "POSITION_FRESH": "position fresh",
    "POSITION_KEPT": "position not lost for long",
    "POSITION_SANE": "position sane",
    "ATTITUDE_FRESH": "attitude fresh",
    "ATTITUDE_AGREES": "attitude sources agree",
    "AUTOPILOT_ALIVE": "heartbeat",
    "NO_FAILSAFE": "no failsafe",
    "SURFACES_OBEY": "obeys",
    "SURFACES_ANSWER": "answer",
    "AIRSPEED_SANE": "airspeed sane",
    "UPRIGHT": "upright",
    "UPWIND": "upwind",
    "INSIDE_FENCE": "inside the fence",
    "LINE_VALID": "line valid",
    "LINE_MOVING": "line moves",
    "NEAR_LINE": "near the line",
    "ON_LINE": "on the line",
    "AIR_SAFE": "angle of attack safe",
    "HIGH_ENOUGH": "high enough",
    "CLEAR": "with a margin",
    "FINITE": "finite",
    "SANE": "state sane",
    "SETTLES": "will settle",
    "SEARCH": "search is asked for",
    "PLACE_FOUND": "found a place",
    "LAUNCH": "launch is asked for",
    "THROWN": "thrown",
    "LINE_REACHED": "reached its line",
    "THROW_AWAITED": "throw may still come",
    "THROWN_LEVEL": "level enough",
    "SPEED_GAINED": "speed gained",
    "LAUNCH_HIGH": "after the throw",
    "LINE_IN_REACH": "can be reached",
    "BREAK_OFF": "break-off is due",
    "SOAR_ON": "soar on",
    "AWAY": "away from the slope",
    "ON_GROUND": "on the ground",
    "INSIDE_LEE": "downstream",
    "NOT_BLIND": "without a line",
    "BEAT": "beating is due",
    "BEAT_OVER": "hover again",
    "SAME_BOOT": "not restarted",
    "STAYS_ARMED": "not disarmed",
    "STILL_READY": "was ready",
    "SETTLED": "has settled",
    "LONG_GAP": "gap was long",
    "TIME_UP": "time is up",
    "TROUBLED": "trouble lasts",
    "CLEARED": "trouble is over",
}
# By the name of a reason: what has happened.
REASONS = {
    "NONE": "",
    "ENGAGED": "engaged",
    "OPERATOR": "operator disengaged",
    "ON_LINE": "on the line",
    "LINE_MOVED": "line moves",
    "POSITION_GAP": "gap",
    "POSITION_BACK": "position is back",
    "POSITION_LOST": "position lost",
    "ATTITUDE_LOST": "attitude lost",
    "AUTOPILOT_LOST": "silent",
    "MODE_TAKEN": "not in the mode",
    "UPSET": "TILT_MAX",
    "OFF_LINE": "CAPTURE_MAX",
    "NOT_FINITE": "not finite",
    "WITHDRAWN": "withdrawn",
    "ARRIVED": "are there",
    "READY": "can be engaged",
    "POSITION_INSANE": "position is not to be trusted",
    "ATTITUDE_DISAGREES": "accelerometers",
    "FAILSAFE": "in failsafe",
    "REBOOTED": "restarted",
    "DISARMED": "disarmed",
    "SURFACES_DEAD": "do not answer",
    "AIRSPEED": "airspeed is not",
    "DOWNWIND": "does not point upwind",
    "FENCE": "outside the fence",
    "LINE": "line not valid",
    "STALL": "stalling",
    "LOW": "too low",
    "RECOVERED": "recovered",
    "NOT_RECOVERED": "not recovered",
    "INSANE": "impossible",
    "NOWHERE": "no place to settle",
    "SEARCH": "searches",
    "PLACE_FOUND": "is found",
    "SEARCH_OVER": "search is over",
    "NOT_FOUND": "no place to soar",
    "LAUNCH": "waits for the throw",
    "LINE_REACHED": "launched",
    "LAUNCH_OFF": "called off",
    "NO_THROW": "no throw",
    "STEEP": "too steeply",
    "NO_SPEED": "no speed gained",
    "LAUNCH_LOW": "given up: too low",
    "FAR": "not reachable",
    "BREAK": "breaks off",
    "AWAY": "away from the slope",
    "LANDED": "on the ground",
    "SOAR_ON": "soars on",
    "BEAT": "beats along the ridge",
    "STANDS": "stands on its line",
}


@pytest.mark.parametrize("name", MODES)
def test_a_mode_is_called_as_the_page_of_modes_calls_it(name: str) -> None:
    assert MODE_NAMES[getattr(supervisor, name)] == MODES[name]


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_condition_s_text_stands_at_its_bit(name: str) -> None:
    bit = getattr(supervisor, name)
    assert CONDITIONS[name] in CONDITION_TEXTS[bit.bit_length() - 1]


@pytest.mark.parametrize("name", REASONS)
def test_a_reason_s_text_stands_at_its_number(name: str) -> None:
    text, word = REASON_TEXTS[getattr(supervisor, f"REASON_{name}")], REASONS[name]
    assert (word in text) if word else text == ""


def test_there_is_one_text_for_each_and_none_besides() -> None:
    assert len(MODE_NAMES) == len(MODES)
    assert len(CONDITION_TEXTS) == len(CONDITIONS) == supervisor.CONDITIONS
    reasons = [name for name in vars(supervisor) if name.startswith("REASON_")]
    assert len(REASON_TEXTS) == len(REASONS) == len(reasons)


@pytest.mark.parametrize("texts", [MODE_NAMES, CONDITION_TEXTS, REASON_TEXTS])
def test_no_two_of_them_read_the_same(texts: tuple[str, ...]) -> None:
    assert len(set(texts)) == len(texts)


def test_every_change_of_mode_says_why_in_characters_that_a_message_can_hold() -> None:
    """A STATUSTEXT is of plain characters."""
    for row in TRANSITIONS:
        reason = REASON_TEXTS[row.reason]
        assert reason
        assert f"{MODE_NAMES[row.to]}: {reason}".isascii()

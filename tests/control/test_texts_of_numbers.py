"""Numbers that go over the wire and into logs, and the words that are shown for them.

An old log and a station know the number alone: it must go on meaning the same, and the words must
stand in its place.
"""

from __future__ import annotations

from types import ModuleType

import pytest

from tgl_soar.control import (
    envelope,
    excitation,
    forecast,
    landing,
    launch,
    point_hold,
    survey,
    throttle,
)
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS
from tgl_soar.estimation import health

# Each in the order of its numbers, with a word of its text.
SURVEY = {
    "NO_REASON": "",
    "AT_FENCE": "fence",
    "AT_GROUND": "ground",
    "SLOW": "too slow",
    "FAST": "too fast",
    "NEAR_STALL": "stall",
    "WEAK": "weakly",
    "UNLIKELY": "likely",
    "REFUSED": "refused",
    "DRIFTS": "climbs or sinks",
    "OFF_LINE": "far from the line",
    "NOT_HELD": "not soar",
    "REACHED": "SRV_REACH",
}
EXCITATION = {
    "IDLE": "",
    "RUNNING": "",
    "DONE": "done",
    "WITHDRAWN": "operator",
    "NOT_SOARING": "not soaring",
    "LINE_MOVES": "line moves",
    "OFF_LINE": "far from the line",
    "BANKED": "bank",
    "FAULTY": "fault",
    "NEAR_STALL": "stall",
    "TOO_LOW": "low",
    "GAINS_CHANGE": "accelerations",
    "LIMITED": "limited",
    "CLOCK": "clock",
}
BRAKE = {
    "LINE_ONLY": "line alone",
    "HOLDS": "held",
    "ABOVE_BAND": "above the band",
    "BELOW_BAND": "below the band",
    "NO_BRAKE": "no brake",
    "DEAD": "not answer",
    "UNEVEN": "one side",
    "TRIES": "trying",
    "GIVES_WAY": "gives way",
    "RESTS": "not held yet",
}
FORECAST = {
    "UNKNOWN": "",
    "SETTLES": "settles",
    "TOO_LOW": "CLEAR_MIN",
    "OUTSIDE": "fence",
    "TOO_SLOW": "too slow",
    "TOO_FAST": "too fast",
}
CALLED = {"NOT_CALLED": "", "NOWHERE": "no place", "HOME": "way home", "LOW": "low"}


@pytest.mark.parametrize(
    ("module", "names", "texts"),
    [
        (survey, SURVEY, survey.SURVEY_TEXTS),
        (excitation, EXCITATION, excitation.EXCITATION_TEXTS),
        (point_hold, BRAKE, point_hold.POINT_TEXTS),
        (forecast, FORECAST, forecast.FORECAST_TEXTS),
        (throttle, CALLED, throttle.CALLED_TEXTS),
    ],
)
def test_each_number_has_its_own_words(
    module: ModuleType, names: dict[str, str], texts: tuple[str, ...]
) -> None:
    assert [getattr(module, name) for name in names] == list(range(len(texts)))
    for text, word in zip(texts, names.values(), strict=True):
        assert (word in text) if word else text == "", (word, text)


# docs/logs.md and the parameters' own texts say these numbers.
NUMBERS = (
    (survey, ("IDLE", "DOWNSTREAM", "UPSTREAM", "HOMEWARD", "DONE", "STOPPED")),
    (forecast, ("OFF", "REPORT", "DISENGAGE", "DISENGAGE_EARLY", "SEARCH_FIRST")),
    (throttle, ("OFF", "CLOSED", "OPEN", "USED_UP")),
    (landing, ("STAY", "BREAK", "SOAR_ON")),
    (launch, ("IDLE",)),
)


@pytest.mark.parametrize(("module", "names"), NUMBERS)
def test_what_is_set_or_logged_keeps_its_numbers(
    module: ModuleType, names: tuple[str, ...]
) -> None:
    assert [getattr(module, name) for name in names] == list(range(len(names)))


BITS = (
    (health, "GAP FROZEN JUMP NOT_FINITE BACKWARDS WRONG"),
    (envelope, "CUT_TRAVEL CUT_RATE CUT_NOT_FINITE CUT_MODE CUT_NOSE_UP CUT_NOSE_DOWN"),
    (envelope, "OUT_UPSTREAM OUT_DOWNSTREAM OUT_SIDE OUT_BELOW OUT_ABOVE"),
)


@pytest.mark.parametrize(("module", "names"), BITS)
def test_bits_follow_each_other(module: ModuleType, names: str) -> None:
    bits = [getattr(module, name) for name in names.split()]
    assert bits == [1 << i for i in range(len(bits))]


def test_a_fault_s_bit_has_its_words() -> None:
    words = {
        health.GAP: "position has gaps",
        health.FROZEN << health.ATTITUDE_SHIFT: "attitude frozen",
        health.WRONG << health.ATTITUDE_SHIFT: "quaternion",
        health.DISAGREES: "disagree",
        health.AIRSPEED: "airspeed",
        health.SURFACES: "surfaces do not follow",
        health.FAILSAFE: "failsafe",
        health.DISARMED: "disarmed",
        health.BRAKE: "brake",
        health.RECKONED: "dead reckoned",
        health.RANGE: "rangefinder",
    }
    assert all(word in health.fault_words(bit) for bit, word in words.items())
    assert health.fault_words(health.GAP | health.RANGE).count(",") >= 1
    streams = health.DISAGREES | health.AIRSPEED | health.RECKONED | health.RANGE | health.GAP
    assert health.STREAM_FAULTS & streams == streams
    assert not health.STREAM_FAULTS & (health.SURFACES | health.FAILSAFE | health.BRAKE)
    assert not health.INSANE & health.GAP  # a gap is no reason to disbelieve what comes
    for name in ("FROZEN", "JUMP", "NOT_FINITE", "BACKWARDS", "WRONG", "RECKONED"):
        assert health.INSANE & getattr(health, name), name


def test_modes_and_reasons_are_as_many_as_the_log_knows() -> None:
    assert (len(MODE_NAMES), len(REASON_TEXTS)) == (14, 51)
    assert MODE_NAMES[3] == "capturing"
    assert REASON_TEXTS[2] == "operator disengaged"
    assert REASON_TEXTS[37] == "waits for the throw"
    assert REASON_TEXTS[48] == "operator soars on"
    assert REASON_TEXTS[50] == "stands on its line again"

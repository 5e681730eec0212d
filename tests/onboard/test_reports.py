"""What is reported without a request: each text once, with its severity, and when it is due."""

from __future__ import annotations

from itertools import count
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.autopilot import Output
from tgl_soar.control.forecast import SETTLES
from tgl_soar.control.point_hold import HOLDS, LINE_ONLY, POINT_TEXTS, RESTS
from tgl_soar.control.supervisor import (
    CAPTURING,
    FAILED,
    HOLDING,
    READY,
    REASON_NONE,
    REASON_NOWHERE,
    REASON_OPERATOR,
    RECOVERING,
    RELEASED,
    SOARING,
)
from tgl_soar.control.throttle import CLOSED, HOME, LOW, NOT_CALLED, OFF, OPEN, USED_UP
from tgl_soar.estimation.health import JUMP
from tgl_soar.link.messages import SEVERITY_ERROR, SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.onboard.flightlog.topics import rebuilt
from tgl_soar.onboard.pacing import TickCounters
from tgl_soar.onboard.reports import (
    KEPT_IS_DAMAGED,
    ForecastWords,
    FrameWords,
    PointWords,
    PowerWords,
    ReckoningWords,
    Reports,
    mode_words,
    start_faults,
)

# What the reports read and send to only answers and records, which native code refuses.
pytestmark = pytest.mark.interpreted

T_S = 100.0
REPEAT_S = 10.0  # a person reads a word in less, and a log is not filled with them
# Nothing happens in it: no fault, no forecast, no shift, no point, no throttle.
BLANK: Output = rebuilt(Output, (0.0 for _ in count()))


def tick(**parts: Any) -> Output:
    """A tick in flight, with some parts of its parts changed: `point={"standing": 1}`."""
    output = BLANK._replace(active=True, mode=SOARING)
    for name, values in parts.items():
        changed = getattr(output, name)._replace(**values) if isinstance(values, dict) else values
        output = output._replace(**{name: changed})
    return output


class Scene:
    """Reports, their texts and receivers."""

    def __init__(self, *first_words: tuple[int, str], store: Any = None) -> None:
        self.console: list[str] = []
        self.texts: list[tuple[int, str]] = []
        self.over_link: list[tuple[int, str]] = []
        self.done: list[Any] = []
        self.logged: list[str] = []
        self.ticks = TickCounters()
        self.session = SimpleNamespace(has_heartbeat=False, round_trip_s=0.004, vehicle_time_s=7.0)
        self.shedding = SimpleNamespace(no_telemetry=False)
        outbox: Any = SimpleNamespace(
            console=self.console.append,
            tell=lambda *words: self.texts.append(words),
            tell_all=self.texts.extend,
            say_words=lambda *words: self.over_link.append(words),
            send_telemetry=lambda now_s, *, sheds: self.done.append(("sent", now_s, sheds)),
        )
        links: Any = SimpleNamespace(
            loss=0.25, measure_loss=lambda *given: self.done.append(("measured", *given))
        )
        panel: Any = SimpleNamespace(look=lambda *given: self.done.append(("shown", *given)))
        recorder: Any = SimpleNamespace(poll=lambda: self.logged)
        clocking: Any = SimpleNamespace(
            pacer=SimpleNamespace(counters=self.ticks), load_shedding=self.shedding
        )
        session: Any = self.session
        self.reports = Reports(
            session, clocking, links, outbox, panel, recorder, store, first_words
        )

    def load(self, after_s: float = 0.0, left_out: int = 0) -> list[tuple[int, str]]:
        """What is reported of the load, so long after the beginning."""
        self.texts.clear()
        self.reports.tell_load(T_S + after_s, left_out)
        return list(self.texts)


# --- what has to be reported ----------------------------------------------------------------------


def test_the_first_words_are_on_the_console_at_once_and_go_out_once_there_is_a_heartbeat() -> None:
    values: Any = None
    first = (SEVERITY_WARNING, "no --log"), (SEVERITY_ERROR, "restarted")
    scene = Scene(*first)
    assert scene.console == ["no --log", "restarted"]
    scene.reports.tell_words(T_S, values)
    assert scene.over_link == []
    scene.session.has_heartbeat = True
    for _ in range(2):
        scene.reports.tell_words(T_S, values)
    assert scene.over_link == list(first)
    assert scene.texts == []


def test_what_keeps_parameters_and_the_log_has_to_say_is_reported_as_a_warning() -> None:
    asked: list[Any] = []

    def poll(*given: Any) -> list[str]:
        asked.append(given)
        return ["disk full"]

    store: Any = SimpleNamespace(poll=poll)
    scene = Scene(store=store)
    scene.logged = ["log is cut off"]
    values: Any = "values"
    scene.reports.tell_words(T_S, values)
    assert scene.texts == [(SEVERITY_WARNING, "disk full"), (SEVERITY_WARNING, "log is cut off")]
    assert asked == [("values", T_S)]


def test_a_ticks_numbers_are_shown_after_its_words_and_shed_with_the_load() -> None:
    scene = Scene()
    scene.shedding.no_telemetry = True
    output, counters = tick(point={"standing": HOLDS}), object()
    given: Any = counters
    values: Any = {"VEER_MAX": 0.0}
    scene.reports.show(output, T_S, given, values)
    assert scene.texts == [(SEVERITY_INFO, "point: held")]
    assert scene.done == [
        ("measured", T_S, scene.ticks, counters),
        ("shown", output, 7.0, 0.25, 0.004),
        ("sent", T_S, True),
    ]


# --- load -----------------------------------------------------------------------------------------


def test_ten_late_or_skipped_ticks_are_worth_a_word_where_telemetry_is_shed() -> None:
    scene = Scene()
    scene.ticks.late, scene.ticks.skipped = 6, 4
    assert scene.load() == []  # it has caught up
    scene.shedding.no_telemetry = True
    assert scene.load() == [(SEVERITY_WARNING, "computer too busy: 10 ticks late")]
    other = Scene()
    other.shedding.no_telemetry = True
    other.ticks.late, other.ticks.skipped = 6, 3
    assert other.load() == []


def test_the_load_is_reported_again_after_ten_seconds_of_what_came_since() -> None:
    scene = Scene()
    scene.shedding.no_telemetry = True
    scene.ticks.late, scene.ticks.skipped = 15, 5
    assert len(scene.load()) == 1
    scene.ticks.late, scene.ticks.skipped = 30, 10
    assert scene.load(0.9 * REPEAT_S) == []
    expected = (SEVERITY_WARNING, "computer too busy: 20 ticks late")
    assert scene.load(1.1 * REPEAT_S) == [expected]
    assert scene.load(2.2 * REPEAT_S) == []  # none since


def test_ten_commands_that_were_left_out_are_a_line_that_is_too_slow() -> None:
    scene = Scene()
    assert scene.load(0.0, 9) == []
    ((severity, text),) = scene.load(0.1, 10)
    assert severity == SEVERITY_WARNING
    assert text.startswith("link too slow: 10 commands left out")
    assert "baud rate" in text
    assert "LOOP_RATE" in text
    assert scene.load(0.9 * REPEAT_S, 40) == []
    ((_, text),) = scene.load(1.2 * REPEAT_S, 40)
    assert "30 commands" in text
    assert scene.load(2.4 * REPEAT_S, 49) == []


# --- modes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "severity"),
    [
        (READY, SEVERITY_INFO),
        (CAPTURING, SEVERITY_INFO),
        (SOARING, SEVERITY_INFO),
        (HOLDING, SEVERITY_WARNING),
        (RECOVERING, SEVERITY_WARNING),
        (RELEASED, SEVERITY_ERROR),
        (FAILED, SEVERITY_ERROR),
    ],
)
def test_a_mode_is_reported_with_its_reason_and_where_it_is_trouble_with_what_ails(
    mode: int, severity: int
) -> None:
    output = tick(mode=mode, reason=REASON_OPERATOR, health={"faults": JUMP})
    (first, *rest) = mode_words(output)
    assert first[0] == severity
    assert first[1].endswith(": operator disengaged")
    assert [each[0] for each in rest] == [SEVERITY_WARNING] * (severity != SEVERITY_INFO)
    assert all(text for _, text in rest)


def test_a_mode_without_a_reason_is_its_name_and_without_a_fault_nothing_ails() -> None:
    assert mode_words(tick(mode=READY, reason=REASON_NONE)) == [(SEVERITY_INFO, "ready")]
    assert len(mode_words(tick(mode=HOLDING, reason=REASON_OPERATOR))) == 1


def foreseen(standing: int) -> dict[str, Any]:
    return {"standing": standing, "ahead_s": 4.0}


def test_why_there_is_no_place_to_settle_is_reported_where_that_ends_the_flight() -> None:
    nowhere = foreseen(SETTLES + 1)
    (_, (severity, text)) = mode_words(tick(mode=READY, reason=REASON_NOWHERE, forecast=nowhere))
    assert severity == SEVERITY_WARNING
    assert text.endswith("in 4.0 s")
    for reason, forecast in ((REASON_OPERATOR, nowhere), (REASON_NOWHERE, foreseen(SETTLES))):
        assert len(mode_words(tick(mode=READY, reason=reason, forecast=forecast))) == 1


# --- forecast -------------------------------------------------------------------------------------


def severities(words: Any, *outputs: Output) -> list[list[int]]:
    return [[severity for severity, _ in words.look(output)] for output in outputs]


def test_that_no_place_is_foreseen_is_reported_once_and_so_is_its_end() -> None:
    words = ForecastWords()
    good, bad = tick(forecast=foreseen(SETTLES)), tick(forecast=foreseen(SETTLES + 1))
    assert severities(words, good, bad, bad, good, good) == [
        [], [SEVERITY_WARNING], [], [SEVERITY_INFO], [],
    ]  # fmt: skip
    ((_, text),) = words.look(bad)
    assert text.startswith("no place to settle: ")
    assert words.look(good) == [(SEVERITY_INFO, "a place to settle is foreseen again")]


def test_what_ended_the_flight_is_not_reported_twice_nor_its_end_on_the_ground() -> None:
    words = ForecastWords()
    bad = tick(forecast=foreseen(SETTLES + 1))
    ended = bad._replace(reason=REASON_NOWHERE)
    on_the_ground = tick(forecast=foreseen(SETTLES))._replace(active=False)
    assert severities(words, ended, bad, on_the_ground) == [[], [], []]


def test_another_way_to_have_no_place_is_reported_again() -> None:
    words = ForecastWords()
    ways = [tick(forecast=foreseen(SETTLES + k)) for k in (1, 2)]
    assert severities(words, *ways) == [[SEVERITY_WARNING]] * 2


# --- position -------------------------------------------------------------------------------------


def shifted(x: float, y: float, z: float) -> Output:
    return tick(quality={"shift_x_m": x, "shift_y_m": y, "shift_z_m": z})


def test_each_reset_of_the_position_is_reported_by_how_much_it_moved_since_the_last() -> None:
    words = FrameWords()
    assert words.look(shifted(0.0, 0.0, 0.0)) == []
    ((severity, text),) = words.look(shifted(1.26, -2.0, -0.01))
    assert severity == SEVERITY_WARNING
    assert text == ("position was reset by +1.3 -2.0 +0.0 m (x y z): the line moves with it")
    assert words.look(shifted(1.26, -2.0, -0.01)) == []
    ((_, text),) = words.look(shifted(2.26, -2.0, 0.5))
    assert "+1.0 +0.0 +0.5 m" in text


@pytest.mark.parametrize("moved", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_from_the_first_tick_a_shift_in_flight_is_reported_and_on_the_ground_it_is_not(
    moved: tuple[float, float, float],
) -> None:
    assert len(FrameWords().look(shifted(*moved))) == 1
    words = FrameWords()
    assert words.look(shifted(*moved)._replace(active=False)) == []
    assert words.look(shifted(*moved)) == []  # it is known by then


def test_dead_reckoning_is_reported_once_and_its_end_too() -> None:
    words = ReckoningWords()
    measured, reckoned = (tick(quality={"reckoned_s": s}) for s in (0.0, 0.3))
    assert severities(words, measured, reckoned, reckoned, measured, measured) == [
        [], [SEVERITY_WARNING], [], [SEVERITY_INFO], [],
    ]  # fmt: skip
    assert words.look(reckoned) == [
        (SEVERITY_WARNING, "position is only dead reckoned: fixes are missing")
    ]
    assert words.look(measured) == [(SEVERITY_INFO, "position is measured again")]
    assert words.look(reckoned._replace(active=False)) == []


# --- point and throttle ---------------------------------------------------------------------------


def test_each_change_of_the_point_is_reported_and_what_is_not_as_asked_is_a_warning() -> None:
    words = PointWords()
    assert words.look(tick(point={"standing": LINE_ONLY})) == []
    for standing in (*range(1, len(POINT_TEXTS)), LINE_ONLY):
        output = tick(point={"standing": standing})
        good = standing in (LINE_ONLY, HOLDS, RESTS)
        severity = SEVERITY_INFO if good else SEVERITY_WARNING
        assert words.look(output) == [(severity, f"point: {POINT_TEXTS[standing]}")]
        assert words.look(output) == []


def power(standing: int, called: int = NOT_CALLED) -> Output:
    return tick(throttle={"standing": standing, "called": called, "used_s": 2.34})


def test_the_throttle_is_reported_as_it_opens_why_and_as_it_closes_with_what_it_used() -> None:
    words = PowerWords()
    reported = [
        words.look(power(*state))
        for state in (
            (CLOSED, NOT_CALLED),
            (OPEN, LOW),
            (OPEN, LOW),
            (OPEN, HOME),
            (CLOSED, NOT_CALLED),
            (CLOSED, NOT_CALLED),
        )
    ]
    assert reported == [
        [],
        [(SEVERITY_WARNING, "throttle: low and sinking")],
        [],
        [(SEVERITY_WARNING, "throttle: height for the way home")],
        [(SEVERITY_INFO, "throttle closed: 2.3 s used")],
        [],
    ]


@pytest.mark.parametrize("standing", [OPEN, CLOSED])
def test_a_budget_that_is_used_up_is_reported_once(standing: int) -> None:
    words = PowerWords()
    words.look(power(standing, HOME))
    assert words.look(power(USED_UP)) == [(SEVERITY_WARNING, "throttle used up: 2.3 s")]
    assert words.look(power(USED_UP)) == []


def test_one_that_opens_by_nothing_or_was_off_or_used_up_before_is_not_reported() -> None:
    """Ramps at its end call for nothing; a budget that is given in flight opens nothing."""
    words = PowerWords()
    assert words.look(power(OPEN)) == []
    for before in (OFF, USED_UP):
        words = PowerWords()
        words.look(power(before))
        assert words.look(power(CLOSED)) == []
    words = PowerWords()
    words.look(power(OFF))
    assert words.look(power(USED_UP)) == []


# --- at the start ---------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", ["", "the line leaves the fence"])
@pytest.mark.parametrize("damaged", [False, True])
def test_what_stands_against_the_flight_from_its_start(fault: str, damaged: bool) -> None:
    values = object()
    settings: Any = SimpleNamespace(
        values=values,
        server=SimpleNamespace(
            line=SimpleNamespace(fault=lambda given: fault if given is values else "?")
        ),
    )
    signing: Any = SimpleNamespace(kept_is_damaged=damaged)
    expected = [(SEVERITY_WARNING, f"cannot be engaged: {fault}")] if fault else []
    if damaged:
        expected.append((SEVERITY_WARNING, KEPT_IS_DAMAGED))
    assert start_faults(settings, signing) == expected

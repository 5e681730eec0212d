"""The simulated operator's times and words: how long it looks, waits, repeats and gives up, what it
takes for a line that stands, a search that has found, a survey that is over, and the way home."""

from __future__ import annotations

from math import isnan, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.parameters import as_wire_value
from tgl_soar.control.supervisor import BREAKING_OFF, LANDING, LAUNCHING
from tgl_soar.sim import operator as module
from tgl_soar.sim.operator import FlownLeg, LastTelemetry, Operator, OperatorError, PlannedLeg

LINE = {"TGL_X": 0.25, "TGL_Z": 1.5, "TGL_LEAN": 15.0}
LEG = PlannedLeg("a", LINE, stay_s=2.0)
SEARCH = PlannedLeg("s", {"SRCH_START": 1.0}, stay_s=2.0, searches=True)
SURVEY = PlannedLeg("y", {"SRV_START": 1.0}, stay_s=99.0, surveys=True)


class Wire:
    """What the operator receives and sends; values are confirmed unless a test says not."""

    def __init__(self, legs: list[PlannedLeg], **options: Any) -> None:
        self.operator = Operator(legs, 1, 191, **options)
        self.of_module = mavlink.MAVLink(None, 1, 191)
        self.of_autopilot = mavlink.MAVLink(None, 1, 1)
        self.sent: list[Any] = []
        self.confirms = True
        self.now_s = 0.0

    def say(self, message: Any, codec: Any = None) -> bool:
        codec = codec or self.of_module
        return self.operator.receive(bytes(message.pack(codec)))

    def shows(self, time_s: float, **values: float) -> None:
        for name, value in values.items():
            boot_ms = round(1e3 * time_s)
            self.say(self.of_module.named_value_float_encode(boot_ms, name.encode(), value))

    def has(self, **parameters: float) -> None:
        for name, value in parameters.items():
            self.say(self.of_module.param_value_encode(name.encode(), value, 9, 50, 0))

    def step(self, now_s: float) -> list[Any]:
        """What is sent now, but heartbeats."""
        self.now_s = now_s
        received = mavlink.MAVLink(None)
        found: list[Any] = []
        for data in self.operator.step(now_s):
            found += received.parse_buffer(bytearray(data)) or []
        sets = [m for m in found if m.get_type() == "PARAM_SET"]
        self.sent += sets
        for each in sets if self.confirms else []:
            self.has(**{each.param_id: each.param_value})
        return found

    def settle(self, now_s: float) -> None:
        """Until nothing more is sent."""
        while any(m.get_type() == "PARAM_SET" for m in self.step(now_s)):
            pass

    def alive(self) -> None:
        self.say(self.of_module.heartbeat_encode(18, 8, 0, 0, 4))

    def engaged(self, time_s: float = 1.0) -> None:
        """The leg has begun, its parameters and the switch are confirmed."""
        self.alive()
        self.shows(0.0, soar_x=0.0, soar_mode=4.0)
        self.settle(0.0)
        self.shows(time_s, soar_x=0.0)
        self.settle(time_s)
        assert self.operator.flown

    def stands(self, time_s: float) -> None:
        self.shows(time_s, line_x=0.25, line_z=1.5, line_lean=15.0)
        self.settle(time_s)

    @property
    def stage(self) -> str:
        return self.operator._stage

    def names(self) -> list[str]:
        return [m.param_id for m in self.sent]


def test_how_long_it_waits_for_what() -> None:
    assert (module.RETRY_S, module.GIVE_UP_S, module.LOOK_S) == (0.5, 10.0, 1.0)
    assert (module.LEG_TIMEOUT_S, module.HOME_TIMEOUT_S) == (40.0, 180.0)
    assert (module.SEARCH_TIMEOUT_S, module.WORDS_S, module.READY_S) == (120.0, 0.5, 60.0)
    assert (module.READY, module.HOMEWARD) == (2.0, (BREAKING_OFF, LANDING))
    assert (module.FOUND, module.OVER) == (2.0, (0.0, 4.0))
    assert module.LINE == {"TGL_X": "line_x", "TGL_Z": "line_z", "TGL_LEAN": "line_lean"}
    assert module.HICCUPS == ("attitude lost", "position lost", "autopilot silent")


def test_a_leg_that_is_planned_and_flown_has_nothing_that_nobody_gave() -> None:
    assert (LEG.searches, LEG.surveys) == (False, False)
    flown = FlownLeg(LEG, 1.0)
    assert isnan(flown.stopped_s)
    assert isnan(flown.ended_s)
    assert (flown.by_hand, flown.found) == (False, {})
    blank = LastTelemetry()
    assert isnan(blank.time_s)
    assert (blank.values, blank.stamps, blank.texts, blank.parameters) == ({}, {}, [], {})
    assert (blank.module_alive, blank.armed) == (False, False)


def test_what_the_module_has_reported_is_kept_with_its_time() -> None:
    wire = Wire([LEG])
    wire.shows(2.0, soar_x=0.0)
    wire.say(wire.of_autopilot.statustext_encode(6, b"of the autopilot"), wire.of_autopilot)
    wire.say(wire.of_module.statustext_encode(6, b"a long ", 7, 0))
    wire.shows(2.5, soar_x=0.0)
    wire.say(wire.of_module.statustext_encode(6, b"text", 7, 1))
    wire.say(wire.of_module.statustext_encode(6, b"another", 8, 0))
    telemetry = wire.operator.telemetry
    assert telemetry.reported == [(2.0, "a long text"), (2.5, "another")]
    assert telemetry.texts == ["of the autopilot", "a long text", "another"]


def test_it_is_a_ground_station_that_beats_once_a_second() -> None:
    wire = Wire([LEG])
    beats = [
        now
        for now in (0.0, 0.5, 0.99, 1.0, 1.5, 2.0, 0.0, 0.5)  # simulated time begins again
        for m in wire.step(now)
        if m.get_type() == "HEARTBEAT" and (m.type, m.autopilot, m.get_srcSystem()) == (6, 8, 254)
    ]
    assert beats == [0.0, 1.0, 2.0, 0.0]


def test_which_senders_are_received_and_what_is_kept() -> None:
    wire = Wire([LEG])
    other = mavlink.MAVLink(None, 2, 191)
    assert not wire.say(other.heartbeat_encode(18, 8, 0, 0, 4), other)
    assert wire.say(wire.of_autopilot.heartbeat_encode(1, 3, 128, 0, 4), wire.of_autopilot)
    telemetry = wire.operator.telemetry
    assert (telemetry.armed, telemetry.module_alive) == (True, False)
    wire.say(wire.of_autopilot.heartbeat_encode(1, 3, 1, 0, 4), wire.of_autopilot)
    assert not telemetry.armed
    wire.alive()
    assert (telemetry.armed, telemetry.module_alive) == (False, True)
    for i, message in enumerate(
        (
            wire.of_autopilot.attitude_encode(1000, *[0.0] * 6),
            wire.of_autopilot.attitude_quaternion_encode(2000, *[0.0] * 7),
            wire.of_autopilot.local_position_ned_encode(3000, *[0.0] * 6),
            wire.of_module.named_value_float_encode(4000, b"soar_x", 1.5),
        ),
        1,
    ):
        wire.say(message)
        assert telemetry.time_s == pytest.approx(float(i))
    assert (telemetry.values["soar_x"], telemetry.stamps["soar_x"]) == (1.5, 4.0)
    wire.say(wire.of_autopilot.param_value_encode(b"TGL_X", 9.0, 9, 50, 0), wire.of_autopilot)
    assert telemetry.parameters == {}  # of the autopilot
    wire.has(TGL_X=0.5)
    assert telemetry.parameters == {"TGL_X": 0.5}


def test_a_question_for_the_time_is_answered_and_an_answer_is_not() -> None:
    wire = Wire([LEG])
    wire.say(wire.of_autopilot.timesync_encode(0, 77), wire.of_autopilot)
    wire.say(wire.of_autopilot.timesync_encode(5, 88), wire.of_autopilot)
    answers = [(m.tc1, m.ts1) for m in wire.step(0.0) if m.get_type() == "TIMESYNC"]
    assert answers == [(77, 77)]


def test_a_long_text_is_put_together() -> None:
    wire = Wire([LEG])
    for text, number, chunk in (("a", 0, 0), ("b", 5, 0), ("c", 5, 1), ("d", 0, 1), ("e", 6, 0)):
        wire.say(wire.of_module.statustext_encode(6, text.encode(), number, chunk))
    assert wire.operator.telemetry.texts == ["a", "bc", "d", "e"]
    first = Wire([LEG])
    first.say(first.of_module.statustext_encode(6, b"x", 5, 1))
    assert first.operator.telemetry.texts == ["x"]


# --- waiting and setting --------------------------------------------------------------------------


@pytest.mark.parametrize("lacks", ["alive", "place", "armed"])
def test_it_looks_for_a_second_at_a_module_that_it_knows(lacks: str) -> None:
    wire = Wire([LEG], when_armed=True)
    if lacks != "alive":
        wire.alive()
    if lacks != "armed":
        wire.say(wire.of_autopilot.heartbeat_encode(1, 3, 128, 0, 4), wire.of_autopilot)
    for time_s in (0.0, 1.0, 2.0, 3.0):
        wire.shows(time_s, soar_x=nan if lacks == "place" else 0.0)
        wire.settle(time_s)
    assert wire.operator.flown == []
    wire.alive()
    wire.say(wire.of_autopilot.heartbeat_encode(1, 3, 128, 0, 4), wire.of_autopilot)
    for time_s, begun in ((3.0, False), (3.9, False), (4.0, True)):  # since it was not known
        wire.shows(time_s, soar_x=0.0)
        wire.settle(time_s)
        assert bool(wire.operator.flown) == begun


def test_who_was_not_to_wait_for_it_engages_a_vehicle_that_is_disarmed() -> None:
    wire = Wire([LEG])
    wire.engaged()
    assert wire.names() == ["TGL_X", "TGL_Z", "TGL_LEAN", "OP_ENGAGE"]
    assert [m.param_value for m in wire.sent] == pytest.approx([0.25, 1.5, 15.0, 1.0])
    assert all(
        (m.target_system, m.target_component, m.param_type) == (1, 191, 9) for m in wire.sent
    )
    assert wire.operator.flown[0].asked_s == 1.0


def test_what_is_set_already_is_not_set_again() -> None:
    wire = Wire([LEG])
    wire.has(TGL_X=0.25, TGL_LEAN=15.0)
    wire.engaged()
    assert wire.names() == ["TGL_Z", "OP_ENGAGE"]


def test_a_set_that_is_not_answered_is_sent_twice_a_second_and_for_ten_seconds() -> None:
    wire = Wire([LEG])
    wire.confirms = False
    wire.engaged()
    sent_at = [1.0]
    wire.sent.clear()
    wire.say(wire.of_module.statustext_encode(6, b"no"))
    for i in range(1, 101):
        now = 1.0 + 0.1 * i
        if any(m.get_type() == "PARAM_SET" for m in wire.step(now)):
            sent_at.append(now)
    assert sent_at == pytest.approx([1.0 + 0.5 * i for i in range(21)], abs=0.11)
    error = r"PARAM_SET TGL_X = 0\.25 was not confirmed within 10 s; the module says: no"
    with pytest.raises(OperatorError, match=error):
        wire.step(11.1)


def test_each_set_has_ten_seconds_of_its_own() -> None:
    wire = Wire([LEG])
    wire.confirms = False
    wire.engaged()
    wire.step(10.9)
    wire.has(TGL_X=0.25)
    wire.step(10.95)
    wire.step(20.9)
    with pytest.raises(OperatorError, match="PARAM_SET TGL_Z"):
        wire.step(21.0)


def test_a_module_that_has_said_nothing_is_quoted_so_and_else_by_its_last_three_texts() -> None:
    for texts, quoted in (([], "nothing"), (["a", "b", "c", "d"], "b; c; d")):
        wire = Wire([LEG])
        wire.confirms = False
        wire.engaged()
        for text in texts:
            wire.say(wire.of_module.statustext_encode(6, text.encode()))
        with pytest.raises(OperatorError, match=f"the module says: {quoted}$"):
            wire.step(20.0)


# --- a line ---------------------------------------------------------------------------------------


def test_a_line_that_stands_is_stayed_at_and_the_next_leg_begun() -> None:
    other = PlannedLeg("b", {"TGL_X": 0.5}, stay_s=1.0)
    wire = Wire([LEG, other])
    wire.engaged()
    wire.stands(2.0)
    assert wire.operator.flown[0].stopped_s == 2.0
    wire.stands(3.9)
    assert len(wire.operator.flown) == 1
    wire.stands(4.0)
    assert wire.operator.flown[0].ended_s == 4.0
    assert wire.operator.flown[1].asked_s == 4.0
    wire.shows(5.0, line_x=0.5)
    wire.settle(5.0)
    wire.shows(6.0, line_x=0.5)
    wire.settle(6.0)
    assert wire.operator.done
    assert wire.names().count("OP_ENGAGE") == 1
    assert not any(flown.by_hand for flown in wire.operator.flown)


@pytest.mark.parametrize("off", [{"line_x": 0.252}, {"line_z": 1.498}, {"line_lean": 15.002}])
def test_a_line_stands_within_a_millimetre(off: dict[str, float]) -> None:
    wire = Wire([LEG])
    wire.engaged()
    line = {"line_x": 0.25, "line_z": 1.5, "line_lean": 15.0}
    wire.shows(2.0, **{**line, **off})
    wire.settle(2.0)
    assert isnan(wire.operator.flown[0].stopped_s)
    near = {name: line[name] + 0.4 * (value - line[name]) for name, value in off.items()}
    wire.shows(3.0, **{**line, **near})
    wire.settle(3.0)
    assert wire.operator.flown[0].stopped_s == 3.0


def test_a_line_that_was_shown_before_it_was_engaged_does_not_count() -> None:
    """Before, the module shows the target itself."""
    wire = Wire([LEG])
    wire.alive()
    wire.shows(0.0, soar_x=0.0, line_x=0.25, line_z=1.5, line_lean=15.0)
    wire.settle(0.0)
    wire.shows(1.0, soar_x=0.0, line_x=0.25, line_z=1.5, line_lean=15.0)
    wire.settle(1.0)
    assert isnan(wire.operator.flown[0].stopped_s)
    wire.stands(1.1)
    assert wire.operator.flown[0].stopped_s == pytest.approx(1.1)


def test_a_line_that_does_not_move_is_waited_for_forty_seconds() -> None:
    wire = Wire([LEG])
    wire.engaged()
    for time_s in (2.0, 41.0):
        wire.shows(time_s, line_x=0.0, line_z=1.5, line_lean=15.0)
        wire.settle(time_s)
    wire.shows(41.5, line_x=0.1)  # it has moved
    wire.settle(41.5)
    wire.shows(81.5, line_x=0.1)
    wire.settle(81.5)
    wire.shows(81.6, line_x=0.1)
    with pytest.raises(
        OperatorError, match=r"leg a: the line did not come to its target within 40 s; the module"
    ):
        wire.settle(81.6)


def test_a_line_that_another_station_moves_counts_as_it_is() -> None:
    wire = Wire([LEG])
    wire.engaged()
    wire.has(TGL_Z=as_wire_value(1.7))
    wire.shows(2.0, soar_x=0.0)
    wire.settle(2.0)
    assert wire.operator.flown[0].by_hand
    assert wire.operator.flown[0].stopped_s == 2.0
    wire.has(TGL_Z=as_wire_value(1.5))
    wire.shows(4.0, soar_x=0.0)
    wire.settle(4.0)
    assert wire.operator.done
    assert wire.operator.flown[0].by_hand  # it was


# --- searches, surveys, the way home --------------------------------------------------------------


def test_a_search_has_found_when_it_says_so_and_is_soared_at() -> None:
    wire = Wire([SEARCH])
    wire.engaged()
    for time_s, start, mode in ((2.0, 1.0, 4.0), (3.0, 2.0, 3.0)):
        wire.has(SRCH_START=start)
        wire.shows(time_s, soar_mode=mode)
        wire.settle(time_s)
        assert isnan(wire.operator.flown[0].stopped_s)
    wire.shows(4.0, soar_mode=4.0, line_x=1.0, line_z=2.0, line_lean=3.0)
    wire.settle(4.0)
    flown = wire.operator.flown[0]
    assert flown.stopped_s == 4.0
    assert flown.found == {"TGL_X": 1.0, "TGL_Z": 2.0, "TGL_LEAN": 3.0}
    assert not flown.by_hand


def test_a_place_that_is_gone_is_searched_for_again() -> None:
    wire = Wire([SEARCH])
    wire.engaged()
    wire.has(SRCH_START=2.0)
    wire.shows(2.0, soar_mode=4.0, line_x=1.0)
    wire.settle(2.0)
    wire.has(SRCH_START=1.0)
    wire.shows(3.0, soar_mode=4.0)
    wire.settle(3.0)
    assert wire.stage == "move"
    wire.has(SRCH_START=2.0)
    wire.shows(5.0, soar_mode=4.0, line_x=9.0)
    wire.settle(5.0)
    assert wire.operator.flown[0].found["TGL_X"] == 9.0
    wire.shows(6.9, soar_mode=4.0)
    wire.settle(6.9)
    assert not wire.operator.done
    wire.shows(7.0, soar_mode=4.0)
    wire.settle(7.0)
    assert wire.operator.done


@pytest.mark.parametrize("over", [0.0, 4.0])
def test_a_search_that_is_over_is_another_operators(over: float) -> None:
    wire = Wire([SEARCH])
    wire.engaged()
    wire.has(SRCH_START=over)
    wire.shows(2.0, soar_mode=4.0)
    wire.settle(2.0)
    assert wire.operator.flown[0].by_hand
    assert wire.operator.flown[0].stopped_s == 2.0


def test_a_search_has_two_minutes_whatever_the_line_does() -> None:
    wire = Wire([SEARCH])
    wire.engaged()
    for i in range(12):
        wire.shows(1.0 + 10.0 * i, line_x=float(i))
        wire.settle(1.0 + 10.0 * i)
    wire.shows(121.0, line_x=99.0)
    wire.settle(121.0)
    wire.shows(121.1, line_x=98.0)
    with pytest.raises(OperatorError, match="leg s: no place to soar was found within 120 s"):
        wire.settle(121.1)


def test_a_survey_is_over_when_its_switch_is() -> None:
    wire = Wire([SURVEY])
    wire.engaged()
    wire.shows(2.0, soar_x=0.0)
    wire.settle(2.0)
    assert wire.stage == "stay"
    wire.shows(50.0, soar_x=0.0)
    wire.settle(50.0)
    assert not wire.operator.done
    wire.has(SRV_START=0.0)
    wire.shows(51.0, soar_x=0.0)
    wire.settle(51.0)
    assert wire.operator.done
    assert wire.operator.flown[0].ended_s == 51.0


def test_after_the_last_leg_it_breaks_off_and_is_done_on_the_ground() -> None:
    wire = Wire([LEG], goes_home=True)
    wire.engaged()
    wire.stands(2.0)
    wire.stands(4.0)
    assert not wire.operator.done
    assert (wire.sent[-1].param_id, wire.sent[-1].param_value) == ("ESC_START", 1.0)
    wire.shows(184.0, soar_x=0.0)
    wire.settle(184.0)
    wire.has(OP_ENGAGE=0.0)
    wire.settle(184.0)
    assert not wire.operator.done  # its words may come after it
    wire.say(wire.of_module.statustext_encode(3, b"released: on the ground"))
    wire.settle(184.0)
    assert wire.operator.done
    assert wire.operator.broke_off
    assert not wire.operator.flown[0].broken_off
    late = Wire([LEG], goes_home=True)
    late.engaged()
    late.stands(2.0)
    late.stands(4.0)
    late.shows(184.1, soar_x=0.0)
    with pytest.raises(OperatorError, match="not down within 180 s of breaking off: nothing"):
        late.settle(184.1)


def test_a_line_that_is_shown_before_the_throw_does_not_stand() -> None:
    """In the hand the module shows the target itself."""
    wire = Wire([PlannedLeg("a", LINE, stay_s=2.0, launches=True)])
    wire.engaged()
    assert wire.names()[-2:] == ["LNC_START", "OP_ENGAGE"]
    wire.shows(2.0, soar_mode=LAUNCHING)
    wire.stands(2.0)
    assert wire.stage == "move"
    wire.has(LNC_START=0.0)  # the launch is over
    wire.shows(5.0, soar_mode=3.0)
    wire.stands(5.0)
    assert wire.stage == "stay"
    assert not wire.operator.flown[0].by_hand


def on_its_way_home(stood: bool = True, **options: Any) -> Wire:
    """Another station has set ESC_START at 3 s, a second after the line stood."""
    wire = Wire([LEG, LEG], **options)
    wire.engaged()
    if stood:
        wire.stands(2.0)
    wire.shows(3.0, soar_mode=BREAKING_OFF)
    wire.settle(3.0)
    return wire


@pytest.mark.parametrize(("stood", "stopped_s"), [(True, 2.0), (False, nan)])
@pytest.mark.parametrize("again", [0, 3])
def test_a_leg_from_which_the_module_breaks_off_ends_and_the_landing_ends_the_flight(
    stood: bool, stopped_s: float, again: int
) -> None:
    """No other leg begins, and nothing is engaged again."""
    wire = on_its_way_home(stood, again=again)
    wire.shows(20.0, soar_mode=LANDING)
    wire.settle(20.0)
    released(wire, 30.0, "on the ground")
    operator = wire.operator
    assert (operator.done, operator.broke_off, operator.hiccups) == (True, True, [])
    assert wire.names().count("OP_ENGAGE") == 1
    (leg,) = operator.flown
    assert (leg.broken_off, leg.ended_s) == (True, 3.0)
    assert leg.stopped_s == stopped_s or not stood


def test_a_leg_whose_aircraft_is_called_back_goes_on() -> None:
    wire = on_its_way_home()
    wire.shows(5.0, soar_mode=3.0)
    wire.settle(5.0)
    assert not wire.operator.broke_off
    assert not wire.operator.flown[0].broken_off
    wire.stands(6.0)
    wire.stands(8.0)
    assert wire.operator.flown[0].ended_s == 8.0
    assert len(wire.operator.flown) == 2


def test_a_fault_on_the_way_home_is_no_landing() -> None:
    wire = on_its_way_home()
    released(wire, 10.0, "outside the fence")
    wire.shows(10.4, soar_x=0.0)
    wire.settle(10.4)
    wire.shows(10.5, soar_x=0.0)
    with pytest.raises(OperatorError, match="disengaged by itself: released: outside the fence"):
        wire.settle(10.5)


def test_where_its_words_are_lost_the_flight_is_over_all_the_same() -> None:
    wire = on_its_way_home()
    wire.shows(10.0, soar_x=0.0)
    wire.has(OP_ENGAGE=0.0)
    wire.settle(10.0)
    assert not wire.operator.done
    wire.shows(10.5, soar_x=0.0)
    wire.settle(10.5)
    assert wire.operator.done


def test_where_a_release_is_to_be_seen_a_break_off_ends_no_leg() -> None:
    wire = on_its_way_home(watch_s=1.0)
    assert wire.stage == "stay"
    assert not wire.operator.broke_off


@pytest.mark.parametrize(
    ("why", "is_of_machine"),
    [("attitude lost", True), ("autopilot silent", True), ("on the ground", False)],
)
def test_only_what_a_busy_machine_may_do_is_laid_to_it(why: str, is_of_machine: bool) -> None:
    wire = Wire([LEG])
    wire.engaged()
    with pytest.raises(OperatorError) as raised:
        released(wire, 2.0, why)
    assert raised.value.is_of_machine == is_of_machine


@pytest.mark.parametrize("says", ["TGL_Z: outside the fence", ""])
def test_a_set_that_is_refused_is_not_laid_to_the_machine(says: str) -> None:
    wire = Wire([PlannedLeg("a", {"TGL_Z": 1.5}, stay_s=2.0)])
    wire.confirms = False
    wire.engaged()
    wire.say(wire.of_module.statustext_encode(3, says.encode()))
    wire.step(1.5)
    with pytest.raises(OperatorError, match="was not confirmed") as raised:
        wire.step(11.6)
    assert raised.value.is_of_machine == (not says)


# --- a module that disengages ---------------------------------------------------------------------


def released(wire: Wire, time_s: float, why: str) -> None:
    wire.say(wire.of_module.statustext_encode(6, f"released: {why}".encode()))
    wire.shows(time_s, soar_x=0.0)
    wire.has(OP_ENGAGE=0.0)
    wire.settle(time_s)


def test_a_module_that_disengages_ends_the_flight_with_its_words() -> None:
    wire = Wire([LEG])
    wire.engaged()
    with pytest.raises(OperatorError, match="the module disengaged by itself: released: too slow"):
        released(wire, 2.0, "too slow")


def ends_at_five(wire: Wire) -> None:
    """Not a tenth of a second before."""
    for time_s, is_over in ((4.9, False), (5.0, True)):
        wire.shows(time_s, soar_x=0.0)
        wire.settle(time_s)
        assert wire.operator.done == is_over


def test_where_it_was_to_be_seen_it_is_watched_for_so_long() -> None:
    wire = Wire([LEG], watch_s=3.0)
    wire.engaged()
    released(wire, 2.0, "too slow")
    ends_at_five(wire)
    flown = wire.operator.flown[0]
    assert (flown.stopped_s, flown.ended_s) == (1.0, 2.0)  # as it was asked for, and released
    again = Wire([LEG], watch_s=0.0)
    again.engaged()
    again.stands(2.0)
    released(again, 3.0, "too slow")
    again.settle(3.0)
    assert again.operator.flown[0].stopped_s == 2.0


@pytest.mark.parametrize("why", ["too low", ""])
def test_where_a_fault_was_injected_a_module_that_disengages_ends_the_flight(why: str) -> None:
    wire = Wire([LEG], is_disturbed=True)
    wire.engaged()
    wire.stands(2.0)
    if why:
        released(wire, 3.0, why)
    else:
        wire.shows(3.0, soar_x=0.0)
        wire.has(OP_ENGAGE=0.0)
        wire.settle(3.0)
    ends_at_five(wire)
    flown = wire.operator.flown[0]
    assert (flown.ended_s, flown.released) == (3.0, why or "its reason was not received")


@pytest.mark.parametrize("why", ["attitude lost", "position lost", "autopilot silent"])
def test_after_a_hiccup_the_leg_is_repeated_once_the_module_is_ready(why: str) -> None:
    wire = Wire([LEG], again=1)
    wire.engaged()
    released(wire, 2.0, why)
    wire.shows(2.4, soar_mode=2.0)
    wire.settle(2.4)
    assert wire.operator.hiccups == []  # its words may come after it
    wire.shows(2.5, soar_mode=3.0)
    wire.settle(2.5)
    assert wire.operator.hiccups == [f"released: {why}"]
    assert wire.names().count("OP_ENGAGE") == 1
    wire.shows(9.0, soar_mode=2.0)
    wire.settle(9.0)
    assert wire.names().count("OP_ENGAGE") == 2
    assert [flown.asked_s for flown in wire.operator.flown] == [9.0]
    with pytest.raises(OperatorError, match="disengaged by itself"):
        released(wire, 12.0, why)


def test_another_reason_is_no_hiccup() -> None:
    wire = Wire([LEG], again=1)
    wire.engaged()
    wire.say(wire.of_module.statustext_encode(6, b"attitude lost once"))
    released(wire, 2.0, "outside the fence")
    wire.shows(2.5, soar_mode=2.0)
    with pytest.raises(OperatorError, match="outside the fence"):
        wire.settle(2.5)


def test_a_module_is_to_be_ready_again_within_a_minute() -> None:
    wire = Wire([LEG], again=1)
    wire.engaged()
    released(wire, 2.0, "attitude lost")
    for time_s in (2.5, 62.0):
        wire.shows(time_s, soar_mode=1.0)
        wire.settle(time_s)
    wire.shows(62.1, soar_mode=1.0)
    with pytest.raises(OperatorError, match="not ready again within 60 s: released: attitude lost"):
        wire.settle(62.1)

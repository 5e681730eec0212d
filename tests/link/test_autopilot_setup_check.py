"""Whether the autopilot is asked how it is set up, how often, and what its answers hold back."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilot_setup_check import ParameterReading, SetupInquiry
from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.autopilots.px4 import Px4
from tgl_soar.link.autopilots.requirements import MUST, SHOULD, Needs, Requirement, need
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Outbound, ParamRequestRead, ParamValue, Source

pytestmark = pytest.mark.interpreted  # it stands in for parts of what flies

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
NEEDS = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)
VEHICLE, OURS = 7, 255
SENDERS = ["SYSID_MYGCS", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI"]  # of an ArduPlane, old and new
ROWS = (
    need("A", "is", 1, "a thing", old=False),
    need("B OLD_B", "at most", 2, "another", old=False),
    need("C", "is", 3, "not in every release"),
    need("D", "is", 4, "only better", SHOULD, old=False),
)
GOOD: dict[str, float] = {"SYSID_MYGCS": 255.0, "A": 1.0, "B": 2.0, "C": 3.0}
STEP_S = 0.02  # of the loop that polls
QUARTER_S = 0.25


class Plane(ArduPilot):
    """An ArduPlane of which less is wanted."""

    rows: tuple[Requirement, ...] = ROWS

    def requirements(self, needs: Needs) -> tuple[Requirement, ...]:
        assert needs == NEEDS
        return self.rows


def value(name: str, number: float, kind: int = 9) -> ParamValue:
    return ParamValue(
        param_id=name, param_value=number, param_type=kind, param_count=1, param_index=0
    )


def reading(*names: str, burst: int = 2) -> ParameterReading:
    return ParameterReading(Plane(CHANNELS, VEHICLE), VEHICLE, names, burst)


def names_of(requests: list[ParamRequestRead] | list[Outbound]) -> list[str]:
    assert all(isinstance(request, ParamRequestRead) for request in requests)
    return [request.param_id for request in requests]  # type: ignore[union-attr]


# --- reading -------------------------------------------------------------------------------------


def test_a_parameter_is_asked_for_by_its_name_at_the_autopilot() -> None:
    (request,) = reading("A").poll(0.0)
    assert request == ParamRequestRead(
        target_system=VEHICLE,
        target_component=mavlink.MAV_COMP_ID_AUTOPILOT1,
        param_id="A",
        param_index=-1,  # "-1 to use the param ID field as identifier"
    )


def test_each_is_asked_for_four_times_four_fifths_of_a_second_apart() -> None:
    """3.2 s in all: a radio that loses half of all frames has answered 15 of 16 by then."""
    wanted = reading("A")
    asked_s = [tick * STEP_S for tick in range(500) if wanted.poll(tick * STEP_S)]
    assert asked_s == pytest.approx([0.0, 0.8, 1.6, 2.4], abs=2.5 * STEP_S)


def test_two_are_asked_for_at_once_unless_otherwise_said() -> None:
    default = ParameterReading(Plane(CHANNELS, VEHICLE), VEHICLE, "ABCDE")
    assert [names_of(default.poll(0.0)) for _ in range(4)] == [["A", "B"], ["C", "D"], ["E"], []]
    assert names_of(reading(*"ABCDE", burst=4).poll(0.0)) == ["A", "B", "C", "D"]


def test_a_name_that_is_given_twice_is_asked_for_once() -> None:
    assert names_of(reading("A", "B", "A", burst=9).poll(0.0)) == ["A", "B"]


def test_what_has_answered_is_asked_for_no_more_and_others_are() -> None:
    wanted = reading("A", "B")
    wanted.poll(0.0)
    assert wanted.take(value("A", 5.0))
    assert wanted.answers == {"A": 5.0}
    assert names_of(wanted.poll(1.0)) == ["B"]


def test_a_parameter_that_was_not_requested_is_not_ours() -> None:
    wanted = reading("A")
    assert not wanted.take(value("Z", 5.0))
    assert wanted.answers == {}
    assert names_of(wanted.poll(0.0)) == ["A"]


def test_a_value_that_comes_unasked_counts_too() -> None:
    """As when a station sets it: it was not being waited for, and is another one now."""
    wanted = reading("A")
    for number in (1.0, 2.0):
        assert wanted.take(value("A", number))
        assert wanted.answers == {"A": number}


def test_whole_numbers_are_read_as_the_firmware_sends_them() -> None:
    (as_float,) = struct.unpack("<f", struct.pack("<i", 3))
    wanted = ParameterReading(Px4(CHANNELS, VEHICLE), VEHICLE, ["COM_RC_IN_MODE"])
    wanted.take(value("COM_RC_IN_MODE", as_float, mavlink.MAV_PARAM_TYPE_INT32))
    assert wanted.answers == {"COM_RC_IN_MODE": 3.0}


def test_it_is_done_when_each_has_answered_or_has_had_time_to_after_the_last_request() -> None:
    wanted = reading("A", "B")
    assert not wanted.done(0.0)
    wanted.take(value("A", 1.0))
    for asked_s in (0.0, 1.0, 2.0, 3.0):
        assert not wanted.done(asked_s + 0.9)
        assert names_of(wanted.poll(asked_s)) == ["B"]
    assert not wanted.done(3.7)
    assert wanted.done(3.9)
    wanted.take(value("B", 1.0))
    assert wanted.done(3.0)


def test_of_some_it_is_known_once_they_were_asked_for_and_had_time() -> None:
    wanted = reading("A", "B", "C")
    assert not wanted.done(5.0, ["A"])  # not asked for yet
    wanted.poll(5.0)
    assert not wanted.done(5.7, ["A"])
    assert wanted.done(5.9, ["A"])
    assert wanted.done(5.9, ["A", "B"])
    assert not wanted.done(5.9, ["A", "C"])  # the third was not asked for
    wanted.take(value("C", 1.0))
    assert wanted.done(5.9, ["A", "C"])
    assert not wanted.done(5.9)  # not all of them four times


def test_after_a_restart_nothing_is_known_and_all_are_asked_for_again() -> None:
    wanted = reading("A", "B")
    wanted.poll(0.0)
    wanted.take(value("A", 1.0))
    wanted.restart()
    assert wanted.answers == {}
    assert names_of(wanted.poll(0.02)) == ["B", "A"]


def test_what_is_asked_for_again_stands_until_it_answers() -> None:
    wanted = reading("A", "B", burst=9)
    wanted.take(value("A", 1.0))
    wanted.take(value("B", 2.0))
    wanted.ask(["B"])
    assert wanted.answers == {"A": 1.0, "B": 2.0}
    assert names_of(wanted.poll(0.0)) == ["B"]
    wanted.take(value("B", 3.0))
    assert wanted.answers["B"] == 3.0


# --- the inquiry ---------------------------------------------------------------------------------


class Vehicle:
    """Answers with what it has, and with silence to the rest."""

    def __init__(self, parameters: Mapping[str, float]) -> None:
        self.parameters = dict(parameters)
        self.asked: list[tuple[float, list[str]]] = []
        self.notices: list[str] = []
        self.now_s = 10.0

    def run(self, inquiry: SetupInquiry, seconds: float = 12.0) -> Vehicle:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            requests, notices = inquiry.poll(self.now_s)
            if requests:
                self.asked.append((self.now_s, names_of(requests)))
            self.notices += notices
            for name in names_of(requests):
                if name in self.parameters:
                    inquiry.take(value(name, self.parameters[name]))
            self.now_s += STEP_S
        return self

    def names(self) -> set[str]:
        return {name for _, names in self.asked for name in names}


def inquiry(needs: Needs | None = NEEDS, rows: tuple[Requirement, ...] = ROWS) -> SetupInquiry:
    plane = Plane(CHANNELS, VEHICLE)
    plane.rows = rows
    return SetupInquiry(plane, VEHICLE, OURS, needs)


def test_what_must_be_is_asked_for_and_who_is_obeyed_and_nothing_else() -> None:
    assert Vehicle({}).run(inquiry()).names() == {*SENDERS, "A", "B", "OLD_B", "C"}
    assert {row.level for row in ROWS if "D" in row.names} == {SHOULD}
    assert {row.level for row in ROWS if "A" in row.names} == {MUST}


def test_without_needs_it_is_asked_only_whom_it_obeys() -> None:
    assert Vehicle({}).run(inquiry(None)).names() == {*SENDERS}


def test_no_more_than_640_bytes_a_second_are_asked_for() -> None:
    """The slowest radio bears it."""
    vehicle = Vehicle({}).run(inquiry(), 1.0)
    frame = Encoder(Source(1, 191)).encode(ParamRequestRead(VEHICLE, 1, "A" * 16, -1))
    times_s = [at_s for at_s, _ in vehicle.asked]
    gaps_s = [after_s - before_s for before_s, after_s in pairwise(times_s)]
    assert min(gaps_s) > 0.1 - 1e-9
    most = max(len(names) for _, names in vehicle.asked)
    assert most == 2
    assert most * len(frame) / 0.1 == pytest.approx(640.0)
    assert max(gaps_s[:2]) < 0.13  # and no slower either


def test_one_that_is_set_up_well_is_not_mentioned_and_not_asked_again() -> None:
    check = inquiry()
    vehicle = Vehicle(GOOD).run(check)
    assert vehicle.notices == []
    assert check.held_back() == ""
    vehicle.asked.clear()
    vehicle.run(check)
    assert vehicle.asked == []


def test_what_is_wrong_is_reported_once_and_holds_the_engagement_back() -> None:
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0}).run(check)
    (notice,) = vehicle.notices
    assert notice == "cannot be engaged: set A to 1, it is 9: a thing"
    assert check.held_back() == "set A to 1, it is 9: a thing"


@pytest.mark.parametrize(("others", "more"), [({"B": 8.0}, 1), ({"B": 8.0, "C": 0.0}, 2)])
def test_of_several_that_are_wrong_the_first_is_named_and_the_others_counted(
    others: dict[str, float], more: int
) -> None:
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0, **others}).run(check)
    words = f"set A to 1, it is 9: a thing, and {more} more (tgl-soar preflight)"
    assert vehicle.notices == [f"cannot be engaged: {words}"]
    assert check.held_back() == words


def test_what_only_some_releases_have_is_wrong_where_it_is_and_nothing_where_it_is_not() -> None:
    without = {name: number for name, number in GOOD.items() if name != "C"}
    assert Vehicle(without).run(inquiry()).notices == []
    check = inquiry()
    Vehicle({**GOOD, "C": 4.0}).run(check)
    assert check.held_back() == "set C to 3, it is 4: not in every release"


def test_what_did_not_answer_is_reported_but_holds_nothing_back() -> None:
    check = inquiry()
    vehicle = Vehicle({"SYSID_MYGCS": 255.0, "A": 1.0}).run(check)
    assert vehicle.notices == [
        "not known how the autopilot is set up: B did not answer (tgl-soar preflight)"
    ]
    assert check.held_back() == ""


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (2, "P0, P1 did not answer"),
        (3, "P0, P1, P2 did not answer"),
        (4, "P0, P1, P2 and 1 more did not answer"),
        (9, "P0, P1, P2 and 6 more did not answer"),
    ],
)
def test_of_many_that_did_not_answer_three_are_named(count: int, words: str) -> None:
    """A status text has 50 characters, and a radio little time."""
    rows = tuple(need(f"P{i}", "is", 1, "why", old=False) for i in range(count))
    (notice,) = Vehicle({"SYSID_MYGCS": 255.0}).run(inquiry(rows=rows)).notices
    assert words in notice


def test_a_name_with_two_rows_is_named_once() -> None:
    rows = (
        need("P", "is not", 1, "why", old=False),
        need("P", "is not", 2, "why", old=False),
        need("Q", "is", 1, "why", old=False),
    )
    (notice,) = Vehicle({"SYSID_MYGCS": 255.0}).run(inquiry(rows=rows)).notices
    assert "P, Q did not answer" in notice


def test_an_older_name_is_an_answer_too() -> None:
    old = {("OLD_B" if name == "B" else name): number for name, number in GOOD.items()}
    check = inquiry()
    assert Vehicle(old).run(check).notices == []
    assert check.held_back() == ""


def test_that_commands_are_ignored_is_reported_once() -> None:
    check = inquiry()
    vehicle = Vehicle({**GOOD, "SYSID_MYGCS": 254.0}).run(check)
    (notice,) = vehicle.notices
    assert "SYSID_MYGCS" in notice
    assert check.held_back() == notice
    vehicle.run(check)
    assert vehicle.notices == [notice]


def test_who_is_obeyed_is_known_only_once_all_the_names_had_time_to_answer() -> None:
    """The upper end of the range may come behind the lower one."""
    check = inquiry(None)
    vehicle = Vehicle({"MAV_GCS_SYSID": 250.0})
    vehicle.run(check, 0.7)
    assert vehicle.notices == []
    vehicle.parameters["MAV_GCS_SYSID_HI"] = 255.0
    vehicle.run(check, 5.0)
    assert vehicle.notices == []
    assert check.held_back() == ""


def test_what_was_wrong_is_asked_for_again_when_an_engagement_is_tried() -> None:
    """It may have been corrected meanwhile."""
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0, "SYSID_MYGCS": 254.0}).run(check)
    assert "SYSID_MYGCS" in check.held_back()
    vehicle.parameters |= GOOD
    vehicle.asked.clear()
    check.ask_again()
    vehicle.run(check)
    assert vehicle.names() == {"A", "SYSID_MYGCS"}  # and not what this firmware lacks
    assert check.held_back() == ""


def test_an_engagement_that_is_not_held_back_asks_nothing() -> None:
    check = inquiry()
    vehicle = Vehicle(GOOD).run(check)
    vehicle.asked.clear()
    assert check.held_back() == ""
    check.ask_again()
    vehicle.run(check)
    assert vehicle.asked == []


def test_who_looks_whether_it_is_held_back_asks_nothing_and_delays_no_report() -> None:
    """The entry is shown once a second from the start."""
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0, "SYSID_MYGCS": 254.0})
    for _ in range(20):
        vehicle.run(check, 1.0)
        check.held_back()
    assert any("SYSID_MYGCS" in notice for notice in vehicle.notices)
    assert any(notice.startswith("cannot be engaged: set A") for notice in vehicle.notices)
    counts = Counter(name for _, names in vehicle.asked for name in names)
    assert max(counts.values()) <= 4
    assert counts["A"] == counts["SYSID_MYGCS"] == 1


def test_what_is_being_asked_for_is_not_begun_again_by_who_asks_to_engage() -> None:
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0}).run(check)
    vehicle.parameters.clear()  # it answers no more
    vehicle.asked.clear()
    check.ask_again()
    for _ in range(3):
        vehicle.run(check, 0.5)
        check.ask_again()
    vehicle.run(check, 5.0)
    assert [names for _, names in vehicle.asked] == [["A"]] * 4


def test_what_was_corrected_and_is_wrong_again_is_reported_again() -> None:
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0}).run(check)
    check.take(value("A", 1.0))  # as when a station sets it
    vehicle.run(check, 1.0)
    check.take(value("A", 9.0))
    vehicle.run(check, 1.0)
    assert vehicle.notices == ["cannot be engaged: set A to 1, it is 9: a thing"] * 2


def test_after_a_restart_everything_is_asked_for_at_once() -> None:
    check = inquiry()
    vehicle = Vehicle({**GOOD, "A": 9.0}).run(check)
    check.poll(vehicle.now_s)
    check.restart()
    assert check.held_back() == ""
    requests, _ = check.poll(vehicle.now_s)
    assert len(requests) == 2
    vehicle.asked.clear()
    vehicle.run(check)
    assert check.held_back() == "set A to 1, it is 9: a thing"


def test_a_firmware_that_obeys_everybody_is_not_asked_whom() -> None:
    check = SetupInquiry(Px4(CHANNELS, VEHICLE), VEHICLE, OURS)
    vehicle = Vehicle({}).run(check, QUARTER_S)
    assert vehicle.asked == []
    assert vehicle.notices == []
    assert check.held_back() == ""

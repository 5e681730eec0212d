"""What is counted of commands, how long one is kept, how many answers a flood gets."""

from __future__ import annotations

from dataclasses import asdict

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.commands import ABORT, ENGAGE, NOTHING, RELEASE, CommandAnswer, CommandServer
from tgl_soar.link.messages import (
    AutopilotVersion,
    CommandAck,
    CommandInt,
    CommandLong,
    MessageInterval,
    NamedValueFloat,
    Outbound,
    Source,
)
from tgl_soar.link.telemetry import Flow, Telemetry

OWN, STATION = Source(1, 191), Source(255, 190)
REQUEST_MESSAGE = mavlink.MAV_CMD_REQUEST_MESSAGE
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
GET_INTERVAL = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
CAPABILITIES = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED


@pytest.fixture
def server() -> CommandServer:
    flow = Flow(251, 1, 0.2, lambda turn: NamedValueFloat(0, "n", turn))
    return CommandServer(OWN, Telemetry((flow,)), (1, 2, 3))


def command(number: int, *params: float, confirmation: int = 0) -> CommandLong:
    one, two = (*params, 0.0, 0.0)[:2]
    return CommandLong(
        target_system=1,
        target_component=191,
        command=number,
        confirmation=confirmation,
        params=(one, two, 0.0, 0.0, 0.0, 0.0, 0.0),
    )


def result_of(answer: CommandAnswer) -> int:
    (ack, *_) = answer.outbound
    assert isinstance(ack, CommandAck)
    return ack.result


# --- counted --------------------------------------------------------------------------------------


def counted(server: CommandServer) -> dict[str, int]:
    return {name: count for name, count in asdict(server.counters).items() if count}


def test_each_kind_of_command_is_counted_once(server: CommandServer) -> None:
    assert counted(server) == {}
    server.handle(STATION, command(RELEASE), 0.0)
    assert counted(server) == {"commands": 1}
    server.handle(STATION, command(RELEASE, confirmation=1), 1.0)
    assert counted(server) == {"commands": 2, "repeated": 1}
    server.handle(STATION, command(ENGAGE), 2.0, held_back="aborted")
    assert counted(server) == {"commands": 3, "repeated": 1, "refused": 1}
    server.handle(STATION, command(ABORT), 3.0, forbidden="no operator")
    server.handle(STATION, command(SET_INTERVAL, 251.0, 1e6), 3.0, forbidden="no operator")
    assert server.counters.refused == 3
    server.handle(STATION, command(400), 4.0)  # MAV_CMD_COMPONENT_ARM_DISARM
    assert server.counters.unsupported == 1
    assert (server.counters.commands, server.counters.unanswered) == (6, 0)


def test_what_a_flood_leaves_unanswered_is_counted(server: CommandServer) -> None:
    answers = [server.handle(STATION, command(GET_INTERVAL, 251.0), 5.0) for _ in range(25)]
    assert [bool(answer.outbound) for answer in answers] == [True] * 20 + [False] * 5
    assert server.counters.unanswered == 5
    assert answers[-1] == ([], NOTHING, "")


# --- a flood --------------------------------------------------------------------------------------


def test_twenty_are_answered_at_once_and_twenty_a_second_after_that(server: CommandServer) -> None:
    assert [server.may_answer(8.0) for _ in range(21)] == [True] * 20 + [False]
    assert not server.may_answer(8.0 + 0.04)
    assert server.may_answer(8.0 + 0.06)
    assert not server.may_answer(8.0 + 0.06)
    assert [server.may_answer(8.0 + 0.32) for _ in range(6)] == [True] * 5 + [False]
    assert sum(server.may_answer(100.0) for _ in range(30)) == 20  # saved up: no more than these


def test_time_that_stands_still_or_goes_back_earns_nothing(server: CommandServer) -> None:
    assert all(server.may_answer(8.0) for _ in range(20))
    assert not server.may_answer(5.0)
    assert not server.may_answer(8.0)
    assert server.may_answer(8.06)


def test_what_flies_is_answered_whatever_the_flood(server: CommandServer) -> None:
    while server.may_answer(8.0):
        pass
    assert result_of(server.handle(STATION, command(RELEASE), 8.0)) == ACCEPTED
    assert server.counters.unanswered == 0


# --- kept -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("after_s", "is_repetition"), [(9.9, True), (10.1, False)])
def test_a_confirmation_repeats_a_command_of_ten_seconds_ago(
    server: CommandServer, after_s: float, is_repetition: bool
) -> None:
    server.handle(STATION, command(RELEASE), 20.0)
    again = server.handle(STATION, command(RELEASE, confirmation=1), 20.0 + after_s)
    assert (again.request == NOTHING) is is_repetition
    assert result_of(again) == ACCEPTED


def test_only_a_confirmation_makes_a_repetition(server: CommandServer) -> None:
    server.handle(STATION, command(RELEASE), 20.0)
    assert server.handle(STATION, command(RELEASE), 20.1).request == RELEASE
    whole = CommandInt(1, 191, RELEASE, (0.0,) * 4)  # has none
    assert server.handle(STATION, whole, 20.2).request == RELEASE


@pytest.mark.parametrize(
    ("number", "engaged", "is_done"),
    [(RELEASE, True, True), (RELEASE, False, False), (ABORT, True, True), (ABORT, False, True)],
)
def test_releasing_is_done_again_while_there_is_something_to_release(
    server: CommandServer, number: int, engaged: bool, is_done: bool
) -> None:
    server.handle(STATION, command(number), 20.0)
    again = server.handle(STATION, command(number, confirmation=1), 20.5, engaged=engaged)
    assert (again.request == number) is is_done
    assert server.counters.repeated == (not is_done)


def test_while_it_is_in_progress_a_repetition_stays_one(server: CommandServer) -> None:
    server.handle(STATION, command(ENGAGE), 20.0)
    for second in range(1, 15):
        assert len(server.poll(20.0 + second)) == 1
    late = server.handle(STATION, command(ENGAGE, confirmation=1), 35.0)
    assert (late.request, result_of(late)) == (NOTHING, mavlink.MAV_RESULT_IN_PROGRESS)


def test_it_is_reported_once_a_second_that_an_engagement_is_in_progress(
    server: CommandServer,
) -> None:
    server.handle(STATION, command(ENGAGE), 20.0)
    reported_s = [i / 16 for i in range(16 * 4) if server.poll(20.0 + i / 16)]
    assert reported_s == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(("senders", "is_forgotten"), [(16, False), (17, True)])
def test_sixteen_are_remembered_and_the_oldest_is_forgotten_first(
    server: CommandServer, senders: int, is_forgotten: bool
) -> None:
    for system in range(1, senders + 1):
        server.handle(Source(system, 7), command(RELEASE), 20.0)
    for system, is_done in ((2, False), (senders, False), (1, is_forgotten)):
        again = server.handle(Source(system, 7), command(RELEASE, confirmation=1), 20.0)
        assert (again.request == RELEASE) is is_done


def test_who_commands_again_is_the_newest(server: CommandServer) -> None:
    for system in (*range(1, 17), 1, 17):
        server.handle(Source(system, 7), command(RELEASE), 20.0)
    for system, is_done in ((1, False), (2, True)):
        again = server.handle(Source(system, 7), command(RELEASE, confirmation=1), 20.0)
        assert (again.request == RELEASE) is is_done


def test_another_clock_ends_all_waiting_and_a_flood_s_account(server: CommandServer) -> None:
    server.handle(STATION, command(ENGAGE), 1000.0)
    while server.may_answer(1000.0):
        pass
    server.rebase()
    assert server.poll(2000.0) == []
    assert sum(server.may_answer(5.0) for _ in range(30)) == 20
    assert server.may_answer(5.1)


# --- answers --------------------------------------------------------------------------------------


def test_an_answer_names_the_command_its_sender_and_no_progress(server: CommandServer) -> None:
    assert server.handle(Source(7, 9), command(RELEASE), 0.0).outbound == [
        CommandAck(
            command=RELEASE, result=ACCEPTED, target_system=7, target_component=9, progress=0
        )
    ]


@pytest.mark.parametrize("asked", [command(CAPABILITIES, 1.0), command(REQUEST_MESSAGE, 148.0)])
def test_what_it_can_do_and_its_version_are_reported(
    server: CommandServer, asked: CommandLong
) -> None:
    ack, version = server.handle(STATION, asked, 0.0).outbound
    assert isinstance(version, AutopilotVersion)
    assert version.capabilities == (
        mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    )
    assert version.flight_sw_version.to_bytes(4, "big") == bytes((1, 2, 3, 0))
    assert isinstance(ack, CommandAck)
    assert ack.result == ACCEPTED


@pytest.mark.parametrize(
    ("number", "intervals_us"),
    [
        (0.0, [1_000_000]),  # the heartbeat
        (65535.0, [0]),
        (65536.0, []),
        (-1.0, []),
        (0.5, []),
    ],
)
def test_the_interval_of_any_message_that_there_can_be_may_be_asked_for(
    server: CommandServer, number: float, intervals_us: list[int]
) -> None:
    for asked in (command(GET_INTERVAL, number), command(REQUEST_MESSAGE, 244.0, number)):
        answer = server.handle(STATION, asked, 0.0)
        assert result_of(answer) == (ACCEPTED if intervals_us else DENIED)
        rest: list[Outbound] = answer.outbound[1:]
        assert rest == [MessageInterval(int(number), each) for each in intervals_us]


class Asked:
    """A source of telemetry that has a message for every number."""

    def __init__(self) -> None:
        self.numbers: list[int] = []

    def once(self, message_id: int) -> Outbound | None:
        self.numbers.append(message_id)
        return MessageInterval(message_id, 0)

    def set_interval(self, message_id: int, interval_us: float) -> bool:
        self.numbers.append(message_id)
        return interval_us >= -1.0

    def interval_us(self, message_id: int) -> int:
        return message_id


@pytest.mark.parametrize("number", [REQUEST_MESSAGE, SET_INTERVAL])
def test_a_message_is_asked_for_by_a_whole_number_of_sixteen_bits(number: int) -> None:
    source = Asked()
    server = CommandServer(OWN, source, (0, 0, 1))
    results = [
        result_of(server.handle(STATION, command(number, about, 1e6), 0.0))
        for about in (0.0, 65535.0, -1.0, 65536.0, 1.5)
    ]
    assert results == [ACCEPTED, ACCEPTED, DENIED, DENIED, DENIED]
    assert source.numbers == [0, 65535]

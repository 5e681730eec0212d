"""Commands as ground stations send them; time is an argument."""

from __future__ import annotations

from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.link.commands import ABORT, ENGAGE, NOTHING, RELEASE, Command, CommandServer
from tgl_soar.link.engagement import SILENCE_S, Engagement, PilotSwitch
from tgl_soar.link.messages import (
    AutopilotVersion,
    CommandAck,
    CommandInt,
    CommandLong,
    MessageInterval,
    NamedValueFloat,
    Outbound,
    RcChannels,
    Source,
)
from tgl_soar.link.telemetry import Flow, Telemetry

OWN = Source(1, 191)
STATION, OTHER = Source(255, 190), Source(245, 190)
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = 0, 1, 2, 3, 4, 5, 6


def server() -> CommandServer:
    flow = Flow(251, 1, 0.2, lambda turn: NamedValueFloat(0, "n", turn))
    return CommandServer(OWN, Telemetry((flow,)), (1, 2, 3))


def command(
    number: int, *params: float, confirmation: int = 0, target: tuple[int, int] = OWN
) -> CommandLong:
    padded = (*params, *[0.0] * (7 - len(params)))
    return CommandLong(
        target_system=target[0],
        target_component=target[1],
        command=number,
        confirmation=confirmation,
        params=padded[:7],  # type: ignore[arg-type]
    )


def results(messages: list[Outbound] | list[CommandAck]) -> list[int]:
    return [m.result for m in messages if isinstance(m, CommandAck)]


def flying(commands: CommandServer, *, settled: bool = False) -> list[int]:
    return results(commands.engagement(flying=True, settled=settled, withdrawn=False))


def release(commands: CommandServer, *, withdrawn: bool) -> list[int]:
    return results(commands.engagement(flying=False, settled=False, withdrawn=withdrawn))


# --- by target --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "number", "ours"),
    [
        ((1, 191), ENGAGE, True),
        ((0, 191), ENGAGE, True),
        ((1, 0), ENGAGE, False),  # all components are never engaged
        ((0, 0), ENGAGE, False),
        ((1, 0), RELEASE, True),  # but may tell all to release
        ((0, 0), ABORT, True),
        ((1, 0), 400, False),
        ((1, 1), ABORT, False),
        ((2, 191), ABORT, False),
    ],
)
def test_engaging_must_name_us_and_letting_go_need_not(
    target: tuple[int, int], number: int, ours: bool
) -> None:
    commands = server()
    assert commands.is_for_us(STATION, command(number, target=target)) == ours
    assert commands.is_for_us(STATION, CommandInt(*target, number, (0.0,) * 4)) == ours
    assert not commands.is_for_us(OWN, command(number, target=target))


# --- engage -----------------------------------------------------------------------------------


def test_an_engagement_is_in_progress_until_the_aircraft_is_on_its_line() -> None:
    commands = server()
    answer = commands.handle(STATION, command(ENGAGE), 10.0)
    assert (answer.outbound, answer.request) == ([], ENGAGE)  # the entry checks come first
    assert flying(commands) == [IN_PROGRESS]
    assert commands.poll(10.9) == []
    assert commands.poll(11.0) == [
        CommandAck(
            command=ENGAGE,
            result=IN_PROGRESS,
            target_system=255,
            target_component=190,
            progress=255,
        )
    ]
    assert commands.poll(11.5) == []
    assert flying(commands) == []  # holding, capturing again: nothing new
    assert flying(commands, settled=True) == [ACCEPTED]
    assert commands.poll(20.0) == []
    assert release(commands, withdrawn=True) == []  # it has been answered


def test_entry_checks_that_wait_for_a_tick_are_in_progress() -> None:
    commands = server()
    commands.handle(STATION, command(ENGAGE), 10.0)
    assert results(commands.poll(11.0)) == [IN_PROGRESS]


def test_a_refused_entry_check_is_a_temporary_rejection() -> None:
    commands = server()
    commands.handle(STATION, command(ENGAGE), 10.0)
    assert release(commands, withdrawn=False) == [REJECTED]


@pytest.mark.parametrize(("withdrawn", "result"), [(False, FAILED), (True, CANCELLED)])
def test_an_engagement_that_ends_before_its_line_failed_or_was_cancelled(
    withdrawn: bool, result: int
) -> None:
    commands = server()
    commands.handle(STATION, command(ENGAGE), 10.0)
    flying(commands)
    assert release(commands, withdrawn=withdrawn) == [result]


def test_what_holds_an_engagement_back_is_reported() -> None:
    commands = server()
    answer = commands.handle(STATION, command(ENGAGE), 10.0, held_back="aborted")
    assert (results(answer.outbound), answer.request, answer.reason) == (
        [REJECTED],
        NOTHING,
        "aborted",
    )


@pytest.mark.parametrize("number", [ENGAGE, RELEASE, ABORT])
def test_a_stranger_is_denied(number: int) -> None:
    answer = server().handle(STATION, command(number), 10.0, forbidden="not an operator")
    assert (results(answer.outbound), answer.request) == ([DENIED], NOTHING)
    assert answer.reason == "not an operator"


# --- repeated commands ------------------------------------------------------------------------


def test_a_repeated_command_is_answered_the_same_and_not_done_twice() -> None:
    commands = server()
    assert commands.handle(STATION, command(ENGAGE), 10.0).request == ENGAGE
    again = commands.handle(STATION, command(ENGAGE, confirmation=1), 11.0)
    assert (results(again.outbound), again.request) == ([IN_PROGRESS], NOTHING)
    flying(commands, settled=True)
    assert commands.handle(STATION, command(RELEASE), 12.0).request == RELEASE
    # This one was on its way for long: it must not engage what was released since.
    late = commands.handle(STATION, command(ENGAGE, confirmation=2), 13.0)
    assert (results(late.outbound), late.request) == ([ACCEPTED], NOTHING)
    released = commands.handle(STATION, command(RELEASE, confirmation=1), 13.0)
    assert (results(released.outbound), released.request) == ([ACCEPTED], NOTHING)


def test_a_repetition_whose_first_was_lost_is_done() -> None:
    commands = server()
    assert commands.handle(STATION, command(ENGAGE, confirmation=1), 10.0).request == ENGAGE
    assert commands.handle(OTHER, command(ENGAGE, confirmation=1), 10.0).request == ENGAGE
    assert commands.handle(STATION, command(RELEASE, confirmation=3), 50.0).request == RELEASE
    assert commands.handle(STATION, command(RELEASE, confirmation=3), 70.0).request == RELEASE


def test_every_station_that_waits_is_answered() -> None:
    commands = server()
    commands.handle(STATION, command(ENGAGE), 10.0)
    commands.handle(OTHER, CommandInt(*OWN, ENGAGE, (0.0,) * 4), 10.0)
    acks = commands.engagement(flying=True, settled=True, withdrawn=False)
    assert [(m.target_system, m.result) for m in acks] == [(255, ACCEPTED), (245, ACCEPTED)]


def test_senders_are_remembered_in_bounds() -> None:
    commands = server()
    for system in range(1, 250):
        commands.handle(Source(system, 7), command(ENGAGE), 10.0)
    assert len(commands.poll(12.0)) == 16


def test_refused_strangers_crowd_out_no_memory() -> None:
    commands = server()
    assert commands.handle(STATION, command(ENGAGE), 10.0).request == ENGAGE
    assert commands.handle(STATION, command(RELEASE), 10.5).request == RELEASE
    for system in range(20):
        stranger = Source(system, 7)
        answer = commands.handle(stranger, command(ABORT), 11.0 + system, forbidden="no")
        assert results(answer.outbound) == [DENIED]
    late = commands.handle(STATION, command(ENGAGE, confirmation=1), 19.0)
    assert late.request == NOTHING  # a late repetition must not undo the release


def test_strangers_set_no_rates() -> None:
    commands = server()
    answer = commands.handle(STATION, command(511, 251.0, -1.0), 0.0, forbidden="not an operator")
    assert (results(answer.outbound), answer.reason) == ([DENIED], "not an operator")
    _, interval = commands.handle(STATION, command(510, 251.0), 0.0, forbidden="no").outbound
    assert interval == MessageInterval(251, 200_000)  # reading is free


def test_a_flood_is_answered_in_bounds_and_keeps_nobody_from_letting_go() -> None:
    commands = server()
    answers = 0
    for i in range(4000):
        now_s = i / 2000
        answers += len(commands.handle(STATION, command(400), now_s).outbound)
        answers += len(commands.handle(OTHER, command(ENGAGE), now_s, forbidden="no").outbound)
    assert answers <= 20 + 2 * 20 + 1
    assert commands.handle(STATION, command(RELEASE), 2.0).request == RELEASE
    assert commands.handle(STATION, command(ABORT), 2.0).request == ABORT
    assert commands.handle(STATION, command(ENGAGE), 2.0).request == ENGAGE


# --- messages ---------------------------------------------------------------------------------


def test_messages_are_sent_on_request() -> None:
    commands = server()
    ack, version = commands.handle(STATION, command(512, 148.0), 0.0).outbound
    assert isinstance(version, AutopilotVersion)
    assert version.flight_sw_version == 1 << 24 | 2 << 16 | 3 << 8
    ack, value = commands.handle(STATION, command(512, 251.0), 0.0).outbound
    assert isinstance(value, NamedValueFloat)
    ack, interval = commands.handle(STATION, command(512, 244.0, 251.0), 0.0).outbound
    assert interval == MessageInterval(251, 200_000)
    ack, interval = commands.handle(STATION, command(510, 30.0), 0.0).outbound
    assert interval == MessageInterval(30, 0)
    assert results([ack]) == [ACCEPTED]


@pytest.mark.parametrize(
    ("interval_us", "result", "then"),
    [
        (100_000.0, ACCEPTED, 100_000),
        (-1.0, ACCEPTED, -1),
        (0.0, ACCEPTED, 200_000),
        (19_000.0, DENIED, 200_000),  # more than 50 Hz
        (-2.0, DENIED, 200_000),
        (nan, DENIED, 200_000),
    ],
)
def test_the_rate_of_our_own_telemetry_can_be_set(
    interval_us: float, result: int, then: int
) -> None:
    commands = server()
    assert results(commands.handle(STATION, command(511, 251.0, interval_us), 0.0).outbound) == [
        result
    ]
    _, interval = commands.handle(STATION, command(510, 251.0), 0.0).outbound
    assert interval == MessageInterval(251, then)


@pytest.mark.parametrize("params", [(30.0,), (nan,), (-1.0,), (1e9,), (250.5,)])
def test_what_we_do_not_send_cannot_be_asked_for(params: tuple[float, ...]) -> None:
    commands = server()
    assert results(commands.handle(STATION, command(512, *params), 0.0).outbound) == [DENIED]
    assert results(commands.handle(STATION, command(511, *params, 1e6), 0.0).outbound) == [DENIED]


@given(
    st.integers(0, 65535),
    st.lists(st.floats(width=32), min_size=7, max_size=7),
    st.integers(0, 255),
    st.booleans(),
)
def test_whatever_is_commanded_gets_one_answer_at_most(
    number: int, params: list[float], confirmation: int, whole: bool
) -> None:
    message: Command = command(number, *params, confirmation=confirmation)
    if whole:
        message = CommandInt(*OWN, number, tuple(params[:4]))  # type: ignore[arg-type]
    ours = server()
    answer = ours.handle(STATION, message, 0.0)
    assert len(results(answer.outbound)) == (number != ENGAGE)
    assert ours.counters.unsupported == results(answer.outbound).count(UNSUPPORTED)
    if number not in (ENGAGE, RELEASE, ABORT):
        assert answer.request == NOTHING
    if not 510 <= number <= 520 and answer.request == NOTHING:
        assert results(answer.outbound) == [UNSUPPORTED]


# --- the pilot's switch -----------------------------------------------------------------------

ON_US, OFF_US = 1700.0, 1300.0
LOW, MIDDLE, HIGH, GONE = 1100, 1500, 1900, 65535


def take(switch: PilotSwitch, pulse_us: int, now_s: float, channel: int = 8) -> int:
    channels = [1500] * 18
    channels[7] = pulse_us
    return switch.take(RcChannels(18, tuple(channels)), now_s, channel, ON_US, OFF_US)


def test_the_way_up_engages_once_and_low_always_releases() -> None:
    switch = PilotSwitch()
    assert [take(switch, p, i * 0.1) for i, p in enumerate((LOW, LOW, MIDDLE, HIGH, HIGH))] == [
        *(RELEASE, RELEASE, NOTHING, ENGAGE, NOTHING)
    ]
    assert take(switch, MIDDLE, 0.6) == NOTHING
    assert take(switch, HIGH, 0.7) == NOTHING  # not from low
    assert take(switch, LOW, 0.8) == RELEASE
    assert switch.is_low
    assert take(switch, HIGH, 0.9) == ENGAGE
    assert not switch.is_low


def test_a_switch_that_is_up_at_the_start_does_not_engage() -> None:
    switch = PilotSwitch()
    assert [take(switch, HIGH, i * 0.1) for i in range(20)] == [NOTHING] * 20


def test_silence_engages_nothing_even_when_the_switch_comes_back_up() -> None:
    switch = PilotSwitch()
    take(switch, LOW, 0.0)
    assert take(switch, HIGH, 1.5) == NOTHING
    take(switch, LOW, 1.6)
    assert [take(switch, GONE, 1.6 + i * 0.1) for i in range(20)] == [NOTHING] * 20
    assert take(switch, HIGH, 3.7) == NOTHING


def stamped(switch: PilotSwitch, pulse_us: int, now_s: float, stamp_ms: int) -> int:
    message = RcChannels(18, (pulse_us,) * 18, stamp_ms)
    return switch.take(message, now_s, 8, ON_US, OFF_US)


def test_a_message_that_was_overtaken_does_not_undo_the_pilot_s_way_out() -> None:
    switch = PilotSwitch()
    stamped(switch, HIGH, 0.0, 10_000)
    assert stamped(switch, LOW, 0.1, 10_200) == RELEASE
    for late_ms in (10_100, 10_200, 10_000):  # overtaken, twice, an old one once more
        assert stamped(switch, HIGH, 0.2, late_ms) == NOTHING
        assert switch.is_low
    assert stamped(switch, HIGH, 0.3, 10_300) == ENGAGE


@pytest.mark.parametrize(
    ("before_ms", "after_ms"), [(2**32 - 100, 50), (500_000, 3_000)], ids=["wrap", "restart"]
)
def test_stamps_that_begin_again_are_new_ones(before_ms: int, after_ms: int) -> None:
    switch = PilotSwitch()
    assert stamped(switch, LOW, 0.0, before_ms) == RELEASE
    assert stamped(switch, HIGH, 0.1, after_ms) == ENGAGE


def test_no_channel_and_no_pulse_is_no_switch() -> None:
    switch = PilotSwitch()
    for channel in (0, 19, -3):
        assert take(switch, LOW, 0.0, channel) == NOTHING
    assert take(switch, 0, 0.0) == NOTHING
    assert not switch.is_low


def test_a_switch_that_is_not_received_says_why() -> None:
    switch = PilotSwitch()
    assert switch.missing(0.0, 0) == ""  # there is none
    assert "no RC_CHANNELS" in switch.missing(0.0, 8)
    take(switch, MIDDLE, 0.0)
    assert switch.missing(SILENCE_S, 8) == ""
    assert "no RC_CHANNELS" in switch.missing(SILENCE_S + 0.1, 8)
    assert "no RC_CHANNELS" in switch.missing(0.1, 7)  # another channel was looked at
    for pulse_us in (GONE, 0):
        take(switch, pulse_us, 5.0)
        assert f"no pulses on its channel: {pulse_us} us" in switch.missing(5.0, 8)
    few = RcChannels(4, (1500,) * 18)
    assert switch.take(few, 10.0, 8, ON_US, OFF_US) == NOTHING
    assert "RC_CHANNELS have 4 channels (OP_RC_CHAN = 8)" in switch.missing(10.0, 8)


@given(st.lists(st.sampled_from((LOW, MIDDLE, HIGH, GONE, 0)), max_size=60))
def test_every_engagement_follows_a_low_that_was_seen(pulses: list[int]) -> None:
    switch = PilotSwitch()
    lows = engagements = 0
    for i, pulse in enumerate(pulses):
        request = take(switch, pulse, i * 0.1)
        lows += request == RELEASE
        engagements += request == ENGAGE
        assert engagements <= lows
        assert (request == RELEASE) == (pulse == LOW)


def test_an_abort_stands_until_a_release() -> None:
    engagement = Engagement()
    assert engagement.held_back() == ""
    engagement.abort("system 255")
    assert "aborted by system 255" in engagement.held_back()
    engagement.clear()
    assert engagement.held_back() == ""
    take(engagement.switch, LOW, 0.0)
    assert "switch is low" in engagement.held_back()

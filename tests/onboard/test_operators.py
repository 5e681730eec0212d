"""Operators, links and keys, as the whole module meets them: frames in, frames out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, setup, simulator, texts

from tgl_soar.control.supervisor import CAPTURING, READY, SOARING, STANDBY
from tgl_soar.estimation.health import ATTITUDE_SHIFT, DISARMED, WRONG
from tgl_soar.link.signing import EPOCH_S, Signing
from tgl_soar.onboard import operators, realtime
from tgl_soar.onboard import process as module
from tgl_soar.onboard.command_line import RunOptions
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.telemetry_values import ARRAY

ENGAGE, RELEASE, ABORT = 31010, 31011, 31012
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = 0, 1, 2, 3, 4, 5, 6
KEY = bytes(range(1, 33))


@pytest.fixture
def flight() -> Flight:
    made = Flight()
    made.run(1.0)
    made.outbound()
    return made


def order(flight: Flight, number: int, *, component: int = 191, confirmation: int = 0) -> None:
    flight.receive(
        mavlink.MAVLink_command_long_message(
            1, component, number, confirmation, 0, 0, 0, 0, 0, 0, 0
        ),
        station=True,
    )


def acks(messages: list[Any]) -> list[tuple[int, int]]:
    return [(m.command, m.result) for m in messages if m.get_type() == "COMMAND_ACK"]


# --- a staged move that is left ---------------------------------------------------------------


@pytest.mark.interpreted
def test_a_staged_move_that_is_left_is_dropped_and_reported(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The station's link drops in the middle of it; another one sets 0 an hour later."""
    assert operators.STAGE_S == 60.0  # as docs/operator.md, docs/safety.md and TGL_STAGE say
    monkeypatch.setattr(operators, "STAGE_S", 2.0)
    values, there = flight.onboard.parameters, flight.onboard.parameters.values["TGL_X"]
    flight.set("TGL_STAGE", 1.0)
    flight.run(1.5)
    flight.set("TGL_X", 1.0)  # goes on with it
    flight.run(1.5)
    flight.set("TGL_Z", 5000.0)  # refused: nothing is staged by it
    flight.run(0.4)
    assert values.values["TGL_STAGE"] == 1.0
    flight.outbound()
    flight.run(0.2)
    assert values.values["TGL_STAGE"] == 2.0
    messages = flight.outbound()
    shown = {m.param_id: m.param_value for m in messages if m.get_type() == "PARAM_VALUE"}
    assert shown == {"TGL_STAGE": 2.0, "TGL_X": there}
    assert "".join(texts(messages)) == "staged move dropped: nothing was staged for 2 s"
    # Its link is back, and it goes on with the second half: that is no move by itself.
    line = values.values["TGL_X"], values.values["TGL_Z"]
    flight.set("TGL_Z", line[1] + 0.1)
    assert "a staged move was dropped: set TGL_STAGE to 1" in "".join(texts(flight.outbound()))
    flight.set("TGL_STAGE", 0.0)
    flight.set("TGL_X", line[0] + 0.1)
    assert (values.values["TGL_X"], values.values["TGL_Z"]) == line
    flight.set("TGL_STAGE", 2.0)
    flight.set("TGL_X", 2.0)
    assert (values.values["TGL_STAGE"], values.values["TGL_X"]) == (2.0, 2.0)
    flight.outbound()
    flight.run(3.0)
    assert "staged move" not in "".join(texts(flight.outbound()))  # once


@pytest.mark.interpreted
def test_in_lockstep_a_staged_move_is_left_by_the_clock_that_begins_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(operators, "STAGE_S", 1.0)
    flight = Flight(lockstep=True)
    for i in simulator(flight, 400):
        if i == 390:
            flight.set("TGL_STAGE", 1.0)
    stage = [flight.onboard.parameters.values["TGL_STAGE"] for _ in simulator(flight, 300)]
    assert (stage[150], stage[-1]) == (1.0, 2.0)


# --- commands ---------------------------------------------------------------------------------


def test_engage_and_release_by_command(flight: Flight) -> None:
    order(flight, ENGAGE)
    flight.run(0.05)
    messages = flight.outbound()
    assert acks(messages) == [(ENGAGE, IN_PROGRESS)]
    assert flight.mode_now == CAPTURING
    assert [m.param_value for m in messages if m.get_type() == "PARAM_VALUE"] == [1.0]
    flight.run(4.0)
    assert flight.mode_now == SOARING
    results = acks(flight.outbound())
    assert results[-1] == (ENGAGE, ACCEPTED)
    assert set(results[:-1]) <= {(ENGAGE, IN_PROGRESS)}
    order(flight, ENGAGE)
    assert acks(flight.outbound()) == [(ENGAGE, ACCEPTED)]  # it flies already
    order(flight, RELEASE)
    flight.run(0.05)
    messages = flight.outbound()
    assert acks(messages) == [(RELEASE, ACCEPTED)]
    assert flight.mode_now == READY
    assert "standby: operator disengaged" in texts(messages)


def test_engaged_it_shows_1_for_a_second_and_then_what_a_file_may_hold(
    flight: Flight,
) -> None:
    """A station that has set 1 gets it confirmed; a file that keeps it later engages nothing."""
    order(flight, ENGAGE)
    flight.run(0.9)
    assert flight.onboard.settings.values["OP_ENGAGE"] == 1.0
    flight.outbound()
    flight.run(0.2)
    assert flight.onboard.settings.values["OP_ENGAGE"] == 2.0
    shown = [m.param_value for m in flight.outbound() if m.get_type() == "PARAM_VALUE"]
    assert shown == [2.0]


def test_an_entry_check_that_refuses_is_a_rejection_with_its_reason(flight: Flight) -> None:
    flight.mode = 10
    flight.run(1.0)
    flight.outbound()
    order(flight, ENGAGE)
    flight.run(0.1)
    messages = flight.outbound()
    assert acks(messages) == [(ENGAGE, REJECTED)]
    assert "released: autopilot not in the mode that obeys" in texts(messages)


def test_a_capture_that_is_lost_failed(flight: Flight) -> None:
    order(flight, ENGAGE)
    flight.run(0.1)
    flight.attitude_hz = 0.0
    flight.run(0.6)
    assert acks(flight.outbound())[-1] == (ENGAGE, FAILED)


def test_a_capture_that_an_operator_ends_was_cancelled(flight: Flight) -> None:
    order(flight, ENGAGE)
    flight.run(0.1)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.1)
    assert acks(flight.outbound())[-1] == (ENGAGE, CANCELLED)


def test_an_engagement_that_is_aborted_within_the_same_tick_was_cancelled(flight: Flight) -> None:
    order(flight, ENGAGE)
    order(flight, ABORT)
    flight.run(0.1)
    assert (ENGAGE, CANCELLED) in acks(flight.outbound())
    flight.run(5.0)
    assert acks(flight.outbound()) == []  # it is not waited for


def test_what_asked_for_one_engagement_does_not_ask_for_the_next(flight: Flight) -> None:
    """A station whose PARAM_SET was not confirmed repeats it, a second apart."""
    flight.engaged().attitude_hz = 0.0
    flight.run(1.0)
    assert flight.mode_now == STANDBY
    flight.attitude_hz = 200.0
    flight.run(0.5)
    for _ in range(3):
        flight.set("OP_ENGAGE", 1.0)
        flight.run(1.2)
        assert flight.mode_now == READY
    assert "try again after 4 s" in "".join(texts(flight.outbound()))  # of two chunks
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert flight.mode_now == CAPTURING


@pytest.mark.parametrize("way_out", [RELEASE, ABORT])
def test_a_way_out_whose_first_frame_was_lost_is_no_repetition_of_an_earlier_one(
    flight: Flight, way_out: int
) -> None:
    """On the bench: engaged, out, engaged again; the next way out arrives by its repetition."""
    order(flight, ENGAGE)
    flight.run(0.5)
    order(flight, way_out)
    flight.run(0.5)
    order(flight, RELEASE)  # what an abort needs
    flight.run(0.5)
    order(flight, ENGAGE)
    flight.run(0.5)
    assert flight.mode_now == CAPTURING
    order(flight, way_out, confirmation=1)
    flight.run(0.1)
    assert flight.mode_now == READY
    if way_out == ABORT:
        flight.outbound()
        order(flight, ENGAGE)
        assert acks(flight.outbound()) == [(ENGAGE, REJECTED)]


def test_an_abort_stands_against_every_way_to_engage(flight: Flight) -> None:
    order(flight, ENGAGE)
    flight.run(0.1)
    order(flight, ABORT, component=0)
    flight.run(0.05)
    assert flight.mode_now == READY
    messages = flight.outbound()
    assert (ABORT, ACCEPTED) in acks(messages)
    assert any("aborted by system 255" in text for text in texts(messages))
    flight.set("OP_ENGAGE", 1.0)
    order(flight, ENGAGE)
    flight.run(0.1)
    messages = flight.outbound()
    assert flight.mode_now == READY
    assert [m.param_value for m in messages if m.get_type() == "PARAM_VALUE"] == [0.0]
    assert acks(messages) == [(ENGAGE, REJECTED)]
    flight.set("OP_ENGAGE", 0.0)
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.mode_now == CAPTURING


def test_a_refused_zero_does_not_take_an_abort_back(flight: Flight) -> None:
    order(flight, ABORT)
    real64 = 10  # a type that is refused
    flight.receive(
        mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 0.0, real64), station=True
    )
    order(flight, ENGAGE)
    flight.run(0.1)
    messages = flight.outbound()
    assert any("send it as REAL32" in text for text in texts(messages))
    assert acks(messages)[-1] == (ENGAGE, REJECTED)
    assert flight.mode_now == READY


def test_other_commands_to_us_are_unsupported_and_to_others_not_ours(flight: Flight) -> None:
    order(flight, 400)
    order(flight, 400, component=0)
    order(flight, ENGAGE, component=1)
    flight.run(0.05)
    assert acks(flight.outbound()) == [(400, UNSUPPORTED)]


def test_only_operators_may_set_and_command(flight: Flight) -> None:
    flight._station = mavlink.MAVLink(None, 77, 190)
    flight.set("TGL_X", 0.5)
    order(flight, ENGAGE)
    flight.receive(mavlink.MAVLink_param_request_read_message(1, 191, b"TGL_Z", -1), station=True)
    flight.run(0.1)
    messages = flight.outbound()
    values = {m.param_id: m.param_value for m in messages if m.get_type() == "PARAM_VALUE"}
    assert values == {"TGL_X": 0.0, "TGL_Z": 0.0}  # refused; reading is free
    assert acks(messages) == [(ENGAGE, DENIED)]
    assert "system 77 is not among autopilot.operators" in "".join(texts(messages))
    assert flight.mode_now == READY


def test_a_file_saved_in_flight_does_not_engage_when_it_is_loaded(flight: Flight) -> None:
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.5)
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 1.0  # the station gets its own value
    flight.run(1.0)
    shown = [m.param_value for m in flight.outbound("PARAM_VALUE") if m.param_id == "OP_ENGAGE"]
    assert shown == [1.0, 2.0]
    flight.set("OP_ENGAGE", 2.0)
    flight.run(0.1)
    assert flight.mode_now in (CAPTURING, SOARING)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.1)
    flight.outbound()
    flight.set("OP_ENGAGE", 2.0)  # the file is loaded
    flight.run(0.1)
    messages = flight.outbound()
    assert flight.mode_now == READY
    assert [m.param_value for m in messages if m.get_type() == "PARAM_VALUE"] == [0.0]
    assert any("set 1" in text for text in texts(messages))


# --- the pilot's switch -----------------------------------------------------------------------


def switch(flight: Flight, pulse_us: int, seconds: float = 0.5, *, system: int = 1) -> None:
    vehicle = mavlink.MAVLink(None, system, 1)
    for _ in range(round(seconds / 0.1)):
        channels = [1500] * 7 + [pulse_us] + [65535] * 10
        frame = mavlink.MAVLink_rc_channels_message(0, 8, *channels, 254).pack(vehicle)
        flight.onboard.event(bytes(frame), flight.now_s)
        flight.run(0.1)


def test_the_pilot_s_switch_engages_releases_and_holds_back(flight: Flight) -> None:
    flight.set("OP_RC_CHAN", 8.0)
    flight.run(2.5)
    assert any(m.param1 == 65.0 for m in flight.outbound("COMMAND_LONG"))  # the stream is asked for
    switch(flight, 1900)
    assert flight.mode_now == READY
    switch(flight, 1100)
    order(flight, ENGAGE)
    flight.run(0.1)
    messages = flight.outbound()
    assert acks(messages) == [(ENGAGE, REJECTED)]
    assert any("switch is low" in text for text in texts(messages))
    switch(flight, 1900, system=9)  # another vehicle's
    assert flight.mode_now == READY
    switch(flight, 1900)
    assert flight.mode_now == CAPTURING
    flight.run(1.5)  # a gap of RC_CHANNELS
    assert flight.mode_now in (CAPTURING, SOARING)
    switch(flight, 1100, 0.1)
    assert flight.mode_now == READY
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0


OTHER = mavlink.MAVLink(None, 245, 190)


@pytest.mark.parametrize("way_out", ["another station", "its command", "the pilot"])
def test_what_asked_for_an_engagement_does_not_ask_for_it_again_after_others_have_ended_it(
    flight: Flight, way_out: str
) -> None:
    """A station whose OP_ENGAGE 1 was not confirmed repeats it, a second apart."""
    flight.set("OP_RC_CHAN", 8.0)
    switch(flight, 1500)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.5)
    assert flight.mode_now == CAPTURING
    if way_out == "the pilot":
        switch(flight, 1100, 0.1)
        switch(flight, 1500, 0.1)
    else:
        release = (
            mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 0.0, 9)
            if way_out == "another station"
            else mavlink.MAVLink_command_long_message(1, 191, RELEASE, 0, *[0] * 7)
        )
        flight.onboard.event(bytes(release.pack(OTHER)), flight.now_s)
    flight.run(0.2)
    assert flight.mode_now == READY
    switch(flight, 1500, 0.5)
    flight.set("OP_ENGAGE", 1.0)
    order(flight, ENGAGE, confirmation=1)
    flight.run(0.2)
    assert flight.mode_now == READY
    assert "somebody else has released" in "".join(texts(flight.outbound()))
    switch(flight, 1500, 4.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.2)
    assert flight.mode_now == CAPTURING


def test_who_has_released_may_engage_again_at_once(flight: Flight) -> None:
    for _ in range(3):
        flight.set("OP_ENGAGE", 1.0)
        flight.run(0.3)
        assert flight.mode_now == CAPTURING
        flight.set("OP_ENGAGE", 0.0)
        flight.run(0.3)
        assert flight.mode_now == READY
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.3)
    flight.outbound()
    engage = mavlink.MAVLink_command_long_message(1, 191, ENGAGE, 0, *[0] * 7)
    flight.onboard.event(bytes(engage.pack(OTHER)), flight.now_s)  # it flies already
    flight.run(0.1)
    assert acks(flight.outbound()) == [(ENGAGE, IN_PROGRESS)]


def with_switch(channel: float) -> Flight:
    """A module that starts with a switch, as from its stored parameters."""
    values = setup()
    made = Flight(
        flown=values._replace(parameters=values.parameters.changed({"OP_RC_CHAN": channel}))
    )
    made.run(1.0)
    return made


def test_a_switch_that_was_never_received_is_asked_for_and_engages_nothing() -> None:
    flight = with_switch(8.0)
    assert any(m.param1 == 65.0 for m in flight.outbound("COMMAND_LONG"))
    order(flight, ENGAGE)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.2)
    messages = flight.outbound()
    assert acks(messages) == [(ENGAGE, REJECTED)]
    words = "the pilot's switch: no RC_CHANNELS are received (OP_RC_CHAN = 8)"
    assert words in "".join(texts(messages))
    assert flight.mode_now == READY
    switch(flight, 1500)
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.mode_now == CAPTURING


@pytest.mark.parametrize("pulse_us", [0, 65535])
def test_a_channel_that_is_not_there_engages_nothing(pulse_us: int) -> None:
    flight = with_switch(8.0)
    switch(flight, pulse_us)
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.mode_now == READY
    flight.set("OP_RC_CHAN", 9.0)  # of eight
    switch(flight, 1500)
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.mode_now == READY
    words = "".join(texts(flight.outbound()))
    assert f"no pulses on its channel: {pulse_us} us" in words
    assert "RC_CHANNELS have 8 channels" in words


@pytest.mark.parametrize("pulse_us", [None, 0, 65535])
def test_a_switch_that_falls_silent_is_reported_and_ends_the_engagement(
    pulse_us: int | None,
) -> None:
    flight = with_switch(8.0)
    switch(flight, 1500)
    order(flight, ENGAGE)
    flight.run(0.1)
    flight.outbound()

    def silent(seconds: float) -> str:
        if pulse_us is None:
            flight.run(seconds)
        else:
            switch(flight, pulse_us, seconds)
        return "".join(texts(flight.outbound()))

    assert "silent" not in silent(0.8)
    assert "the pilot's switch is silent, disengaging in 2 s" in silent(1.0)
    assert flight.mode_now in (CAPTURING, SOARING)
    assert "disengaged: the pilot's switch is silent" in silent(1.5)
    assert flight.mode_now == READY
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.mode_now == READY


def test_a_silence_that_ends_in_time_is_reported_again_the_next_time() -> None:
    flight = with_switch(8.0)
    switch(flight, 1500)
    order(flight, ENGAGE)
    for _ in range(3):
        flight.run(2.0)
        switch(flight, 1500)
    words = "".join(texts(flight.outbound()))
    assert words.count("disengaging in 2 s") == 3
    assert flight.mode_now in (CAPTURING, SOARING)


def test_a_channel_that_moves_a_surface_is_no_switch() -> None:
    flight = Flight()
    values = setup()._replace(surface_channels=frozenset((1, 2, 4)))
    flight.onboard = Onboard(values, flight._send, flight.now_s)
    flight.run(0.1)
    for channel in (1, 2, 4):
        flight.set("OP_RC_CHAN", channel)
        assert flight.onboard.parameters.values["OP_RC_CHAN"] == 0.0
    words = "".join(texts(flight.outbound()))
    assert "this channel moves a surface: 1 to 18 but none of 1, 2, 4; 0: no switch" in words
    flight.set("OP_RC_CHAN", 3)
    assert flight.onboard.parameters.values["OP_RC_CHAN"] == 3.0


def test_a_budget_without_a_propeller_is_refused_in_flight_too(flight: Flight) -> None:
    flight.engaged()
    flight.set("THR_BUDGET", 10.0)
    assert flight.onboard.parameters.values["THR_BUDGET"] == 0.0
    words = "".join(texts(flight.outbound()))
    assert "no propeller: the airframe file needs [surfaces.throttle]" in words
    flight.set("THR_BUDGET", 0.0)
    assert "no propeller" not in "".join(texts(flight.outbound()))


def test_a_budget_with_a_propeller_is_taken_in_flight() -> None:
    flight = Flight()
    aerodynamics = setup().aerodynamics._replace(propeller_thrust_n=4.0)
    values = setup()._replace(aerodynamics=aerodynamics)
    flight.onboard = Onboard(values, flight._send, flight.now_s)
    flight.run(0.1)
    flight.set("THR_BUDGET", 10.0)
    assert flight.onboard.parameters.values["THR_BUDGET"] == 10.0


# --- telemetry --------------------------------------------------------------------------------


@pytest.mark.parametrize("budget", [200.0, 800.0, 2400.0])
def test_telemetry_stays_within_its_bytes_on_the_wire(flight: Flight, budget: float) -> None:
    flight.set("TEL_BUDGET", budget)
    flight.engaged()
    before = len(flight.frames)
    seconds = 20.0
    flight.run(seconds)
    reported = (62, 251, 253, 350)  # NAV_CONTROLLER_OUTPUT, NAMED_VALUE_FLOAT, STATUSTEXT, …ARRAY
    size = sum(len(f) for f in flight.frames[before:] if f[7] | f[8] << 8 | f[9] << 16 in reported)
    assert size <= budget * (seconds + 0.2) + 280
    assert size >= min(budget * seconds * 0.9, 1000 * seconds)


def test_all_terms_come_in_one_array(flight: Flight) -> None:
    flight.engaged().run(1.0)
    arrays = flight.outbound("DEBUG_FLOAT_ARRAY")
    assert arrays[-1].name == "tgl_soar"
    shown = dict(zip(ARRAY, arrays[-1].data, strict=False))
    assert shown["mode"] in (CAPTURING, SOARING)
    assert shown["health"] == 7.0
    assert abs(shown["age_att"]) < 0.01
    output = flight.onboard.output
    assert output is not None
    assert shown["faults"] == output.health.faults
    assert len(ARRAY) <= len(arrays[-1].data)
    assert shown["elevator"] == pytest.approx(output.command.elevator, abs=0.05)


def test_a_fault_of_a_stream_is_reported_by_its_bit(flight: Flight) -> None:
    flight.engaged().run(1.5)
    assert {m.value for m in flight.outbound("NAMED_VALUE_FLOAT") if m.name == "faults"} == {
        DISARMED
    }
    flight.quaternion = [0.9, 0.0, 0.0, 0.0]  # its norm is not one
    flight.run(1.5)
    reported = [m.value for m in flight.outbound("NAMED_VALUE_FLOAT") if m.name == "faults"]
    assert reported[-1] == DISARMED | WRONG << ATTITUDE_SHIFT


def test_lost_frames_are_reported_as_a_fraction(flight: Flight) -> None:
    codec = flight._vehicle
    for i in range(4000):
        flight.run(0.0005)
        if i % 5 == 0:
            codec.seq = (codec.seq + 1) % 256  # a frame that never came
    flight.run(2.0)
    reported = [m.value for m in flight.outbound("NAMED_VALUE_FLOAT") if m.name == "loss"]
    assert max(reported) > 0.3


# --- links ------------------------------------------------------------------------------------


class Station:
    """A ground station on a link of its own."""

    def __init__(self, flight: Flight, system: int = 255, *, old: bool = False) -> None:
        self.frames: list[bytes] = []
        self._flight = flight
        self._codec = mavlink.MAVLink(None, system, 190)
        self._old = old
        self._link = flight.onboard.add_link(self._take)

    def _take(self, frame: bytes) -> bool:
        self.frames.append(frame)
        return True

    def say(self, message: Any) -> None:
        frame = bytes(message.pack(self._codec, force_mavlink1=self._old))
        self._flight.onboard.event(frame, self._flight.now_s, self._link)

    def received(self) -> list[Any]:
        frames, self.frames = self.frames, []
        return [mavlink.MAVLink(None).decode(bytearray(f)) for f in frames]


def kinds(messages: list[Any]) -> set[str]:
    return {m.get_type() for m in messages}


def test_an_answer_goes_where_the_question_came_from_and_telemetry_everywhere(
    flight: Flight,
) -> None:
    one, two = Station(flight), Station(flight, 254)
    flight.run(1.0)
    assert one.received()[0].get_type() == two.received()[0].get_type() == "HEARTBEAT"
    flight.outbound()
    one.say(mavlink.MAVLink_param_request_list_message(1, 191))
    one.say(mavlink.MAVLink_timesync_message(0, 5))
    two.say(mavlink.MAVLink_command_long_message(1, 191, ENGAGE, 0, 0, 0, 0, 0, 0, 0, 0))
    flight.run(2.0)
    first, second, serial = one.received(), two.received(), flight.outbound()
    assert len({m.param_index for m in first if m.get_type() == "PARAM_VALUE"}) > 50
    assert {m.param_id for m in second if m.get_type() == "PARAM_VALUE"} == {"OP_ENGAGE"}
    assert {m.param_id for m in serial if m.get_type() == "PARAM_VALUE"} == {"OP_ENGAGE"}
    assert "TIMESYNC" in kinds(first)
    assert "TIMESYNC" not in kinds(second)
    assert acks(first) == acks(serial) == []
    assert acks(second)[0] == (ENGAGE, IN_PROGRESS)
    for messages in (first, second, serial):
        assert {"HEARTBEAT", "NAMED_VALUE_FLOAT", "STATUSTEXT"} <= kinds(messages)
    assert "RC_CHANNELS_OVERRIDE" in kinds(serial)
    assert "RC_CHANNELS_OVERRIDE" not in kinds(first) | kinds(second)
    for frames in (first, second):
        seqs = [m.get_seq() for m in frames]
        assert seqs == [(seqs[0] + i) % 256 for i in range(len(seqs))]


def test_a_station_is_answered_however_many_others_were_received_before(flight: Flight) -> None:
    """A swarm on one radio; or a peer that counts through all ids."""
    for system in (*range(2, 100), 255):
        for component in range(1, 41) if system == 255 else (1,):
            beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
            flight.onboard.event(
                bytes(beat.pack(mavlink.MAVLink(None, system, component))), flight.now_s
            )
    flight.outbound()
    order(flight, ENGAGE)
    flight.run(0.05)
    assert acks(flight.outbound()) == [(ENGAGE, IN_PROGRESS)]


def test_nobody_but_the_autopilot_s_own_link_measures(flight: Flight) -> None:
    liar = Station(flight, 1)
    liar._codec = mavlink.MAVLink(None, 1, 1)
    before = flight.onboard.session.attitude
    liar.say(mavlink.MAVLink_heartbeat_message(1, 3, 81, 10, 4, 3))
    liar.say(mavlink.MAVLink_attitude_quaternion_message(10**6, 0, 1, 0, 0, 0, 0, 0))
    assert flight.onboard.session.attitude == before
    assert flight.onboard.session.status.accepts_surfaces


def test_mavlink_1_is_answered_in_mavlink_1(flight: Flight) -> None:
    old = Station(flight, old=True)
    flight.run(0.1)
    old.frames.clear()
    old.say(mavlink.MAVLink_param_set_message(1, 191, b"TGL_X", 0.5, 9))
    flight.run(2.0)
    assert {f[0] for f in old.frames} == {0xFE}
    messages = old.received()
    assert {"PARAM_VALUE", "HEARTBEAT", "NAMED_VALUE_FLOAT"} <= kinds(messages)
    assert {f[0] for f in flight.frames} == {0xFD}
    old._old = False
    old.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    flight.run(1.0)
    assert {f[0] for f in old.frames} == {0xFD}


# --- keys -------------------------------------------------------------------------------------


def signed_flight(
    *, unsigned_autopilot: bool, keep: Callable[[bytes], None] | None = None
) -> Flight:
    flight = Flight()
    signing = Signing(KEY, EPOCH_S + 1e8, flight.now_s)
    flight.onboard = Onboard(
        setup(),
        flight._send,
        flight.now_s,
        ModuleOptions(
            console=flight.console.append,
            signing=signing,
            unsigned_autopilot=unsigned_autopilot,
            keep_key=keep,
        ),
    )
    return flight


def sign(codec: Any, flight: Flight, key: bytes = KEY) -> None:
    codec.signing.secret_key = key
    codec.signing.sign_outgoing = True
    codec.signing.timestamp = flight.onboard.signing.timestamp


def test_with_a_key_only_the_signed_are_received() -> None:
    flight = signed_flight(unsigned_autopilot=True)
    flight.run(1.0)
    flight.set("TGL_X", 0.5)
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.onboard.parameters.values["TGL_X"] == 0.0
    assert flight.mode_now == READY
    sign(flight._station, flight)
    flight.set("TGL_X", 0.5)
    order(flight, ENGAGE)
    flight.run(0.1)
    assert flight.onboard.parameters.values["TGL_X"] == 0.5
    assert flight.mode_now == CAPTURING
    assert all(f[2] == 1 for f in flight.frames)  # overrides too


def test_with_a_key_an_unsigned_autopilot_is_not_accepted_unless_that_was_allowed() -> None:
    flight = signed_flight(unsigned_autopilot=False)
    flight.run(1.0)
    assert not flight.onboard.session.has_heartbeat
    sign(flight._vehicle, flight)
    flight.run(1.0)
    assert flight.onboard.session.has_heartbeat


def setup_signing(flight: Flight, key: bytes, ticks: int = 10**13) -> None:
    flight.receive(mavlink.MAVLink_setup_signing_message(1, 191, list(key), ticks), station=True)


def test_a_key_over_the_air_is_refused(flight: Flight) -> None:
    setup_signing(flight, KEY)
    setup_signing(flight, KEY)
    assert not flight.onboard.signing.is_on
    reported = [text for text in texts(flight.outbound()) if "SETUP_SIGNING refused" in text]
    assert len(reported) == 1


def test_a_damaged_timestamp_is_reported(flight: Flight) -> None:
    damaged = Signing(None, EPOCH_S, 0.0, kept=2**48 - 1)
    flight.onboard = Onboard(setup(), flight._send, flight.now_s, ModuleOptions(signing=damaged))
    flight.run(1.5)
    assert "timestamp that was kept is damaged" in "".join(texts(flight.outbound()))


def test_a_key_over_the_air_is_taken_where_that_was_allowed() -> None:
    kept: list[bytes] = []
    flight = signed_flight(unsigned_autopilot=True, keep=kept.append)
    flight.run(1.0)
    new = bytes(range(3, 35))
    setup_signing(flight, new)  # unsigned
    assert kept == []
    sign(flight._station, flight)
    setup_signing(flight, bytes(32))
    setup_signing(flight, new, 2**48 - 1)  # no working clock: nothing could be signed after it
    assert kept == []
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    setup_signing(flight, new)
    assert kept == []  # not while it flies
    flight.set("OP_ENGAGE", 0.0)
    flight.run(6.0)
    setup_signing(flight, new)
    assert kept == [new]
    assert flight.onboard.signing.key == new


# --- the process ------------------------------------------------------------------------------


class BreakingLink:
    """A link that carries a flight for a while, and then something raises."""

    name = "udp:127.0.0.1:1"
    is_stream = False
    generation = 0

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self._codec = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._calls = 0

    def fileno(self) -> int:
        return -1

    def send(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def hold(self, now_s: float) -> None:
        pass

    def send_command(self, data: bytes) -> bool:
        return self.send(data)

    def clear_for_release(self) -> bool:
        return False

    def receive(self, now_s: float, most: int = 64) -> list[bytes]:  # noqa: ARG002
        self._calls += 1
        stamp = round(now_s * 1e3) & 0xFFFFFFFF
        noise = 1e-6 * (stamp % 7)  # nothing that is measured repeats itself
        messages = [
            mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3),
            mavlink.MAVLink_attitude_quaternion_message(stamp, 1, noise, 0, 0, 0, 0, 0),
            mavlink.MAVLink_local_position_ned_message(stamp, 0, 0, noise, 0, 0, 0),
        ]
        frames = [bytes(m.pack(self._codec)) for m in messages]
        if self._calls == 20:
            engage = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
            frames.append(bytes(engage.pack(self._station)))
        if self.overrides():
            raise RuntimeError("something that nobody has thought of")
        assert self._calls < 5000
        return frames

    def overrides(self) -> list[Any]:
        messages = [mavlink.MAVLink(None).decode(bytearray(f)) for f in self.sent[-40:]]
        return [m for m in messages if m.get_type() == "RC_CHANNELS_OVERRIDE"]

    def close(self) -> None:
        return


def test_whatever_is_raised_the_pilot_gets_the_surfaces(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # It would give its priority to this process, and to all that later tests start from it.
    monkeypatch.setattr(realtime, "prepare", lambda *_, **__: [])
    link = BreakingLink()
    opened = module.Opened(setup=setup(), transports=[link])  # type: ignore[list-item]
    with pytest.raises(RuntimeError, match="nobody has thought of"):
        module._fly(opened, RunOptions(airframe="", site="", links=()), lambda: False)
    assert [m.chan2_raw for m in link.overrides()][-5:] == [0] * 5
    assert "tgl_soar stopped" in capfd.readouterr().err

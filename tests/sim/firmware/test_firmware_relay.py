"""A firmware's links: what passes, what is learnt on the way, and how long a step waits."""

from __future__ import annotations

import io
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.firmware import relay as relay_module
from tgl_soar.sim.firmware.mission import MissionItem, MissionUpload
from tgl_soar.sim.firmware.relay import FirmwareLink, Relay

SYSTEM, STEP_HZ = 21, 200
GROUND, COMPANION, OTHER_GROUND = 1, 2, 3
LOCAL = ("127.0.0.1", 0)


def udp() -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(LOCAL)
    end.settimeout(5.0)
    return end


class Firmware:
    """The firmware's ends of its two links, and the relay between them and ours."""

    def __init__(self, **options: Any) -> None:
        self.codec = mavlink.MAVLink(None, SYSTEM, 1)
        self.ground, self.companion = udp(), udp()
        links = (
            FirmwareLink(self.ground.getsockname()),
            FirmwareLink(self.companion.getsockname()),
        )
        self.ours = {self.ground: links[0].local, self.companion: links[1].local}
        self.relay = Relay(SYSTEM, STEP_HZ, *links, **options)
        self.relay.add_link(GROUND, ground=True)
        self.relay.add_link(COMPANION, ground=False)

    def send(self, end: socket.socket, *messages: Any, codec: Any = None) -> None:
        for message in messages:
            end.sendto(bytes(message.pack(codec or self.codec)), self.ours[end])

    def received(self, end: socket.socket) -> list[Any]:
        end.setblocking(False)
        found: list[Any] = []
        codec = mavlink.MAVLink(None)
        try:
            while True:
                found += codec.parse_buffer(bytearray(end.recv(65536))) or []
        except OSError:
            return found

    def close(self) -> None:
        self.relay.close()
        self.ground.close()
        self.companion.close()


@pytest.fixture
def firmware() -> Iterator[Firmware]:
    made = Firmware()
    yield made
    made.close()


def beat(mode: int = 5, *, armed: bool = False) -> Any:
    return mavlink.MAVLink_heartbeat_message(1, 3, 128 if armed else 1, mode, 4, 3)


def status(health: int) -> Any:
    return mavlink.MAVLink_sys_status_message(0, 0, health, 0, 0, -1, -1, 0, 0, 0, 0, 0, 0)


def attitude(time_ms: int) -> Any:
    """Turned, so that no byte beside the time's is 0."""
    return mavlink.MAVLink_attitude_quaternion_message(time_ms, 0.6, 0.8, 0, 0, 0.1, 0, 0)


def from_module(*messages: Any, component: int = 191) -> bytes:
    codec = mavlink.MAVLink(None, SYSTEM, component)
    return b"".join(bytes(message.pack(codec)) for message in messages)


def override(*pulses: int) -> Any:
    return mavlink.MAVLink_rc_channels_override_message(SYSTEM, 1, *(pulses or [1500] * 8))


# --- a link ---------------------------------------------------------------------------------------


def test_a_link_answers_whoever_spoke_to_it_last() -> None:
    link = FirmwareLink(None)
    with udp() as first, udp() as second:
        link.send(b"lost")  # no peer is known yet
        first.sendto(b"one", link.local)
        assert link.receive() == b"one"
        link.send(b"to the first")
        assert first.recv(100) == b"to the first"
        second.sendto(b"two", link.local)
        assert link.receive() == b"two"
        link.send(b"to the second")
        assert second.recv(100) == b"to the second"
        first.setblocking(False)
        with pytest.raises(BlockingIOError):
            first.recv(100)
    assert link.receive() is None
    link.close()
    assert link.receive() is None
    link.send(b"gone")


def test_a_link_listens_at_the_port_it_is_given() -> None:
    with udp() as taken:
        port = taken.getsockname()
    link = FirmwareLink(None, port)
    assert link.local == port
    link.close()
    unnamed = FirmwareLink(None)
    assert unnamed.local[0] == "127.0.0.1"
    assert unnamed.local[1] > 0
    unnamed.close()


def test_a_datagram_as_large_as_any_comes_whole() -> None:
    link = FirmwareLink(None)
    with udp() as end:
        end.sendto(bytes(4096), link.local)
        assert link.receive() == bytes(4096)
    link.close()


# --- towards the bridge's ports -------------------------------------------------------------------


def test_nothing_is_known_before_the_firmware_speaks(firmware: Firmware) -> None:
    relay = firmware.relay
    assert (relay.armed, relay.ready, relay.custom_mode) == (False, False, -1)
    assert (relay.commands, relay.last_command, relay.commanded_step) == ({}, "", -1)
    assert not relay.is_commanded
    assert relay.takes_stations
    assert (relay.heartbeats(COMPANION), relay.timesync_answer_ns(COMPANION)) == (0, 0)
    relay.announce()
    assert relay.take_datagrams() == []


def test_each_side_receives_its_own_link_of_the_firmware(firmware: Firmware) -> None:
    relay = firmware.relay
    relay.add_link(OTHER_GROUND, ground=True)
    firmware.send(firmware.ground, beat(1))
    firmware.send(firmware.companion, beat(2), attitude(5))
    taken = relay.take_datagrams()
    assert [link for link, _ in taken] == [GROUND, COMPANION, COMPANION, OTHER_GROUND]
    assert taken[0][1] == taken[3][1] != taken[1][1]
    assert relay.take_datagrams() == []
    firmware.send(firmware.ground, beat(1))
    assert [link for link, _ in relay.take_datagrams([OTHER_GROUND])] == [OTHER_GROUND]
    assert [link for link, _ in relay.take_datagrams([GROUND, COMPANION])] == [GROUND]


def test_a_link_that_is_gone_receives_nothing(firmware: Firmware) -> None:
    relay = firmware.relay
    relay.remove_link(GROUND)
    relay.remove_link(GROUND)  # a second removal does no harm
    firmware.send(firmware.ground, beat())
    assert relay.take_datagrams() == []
    assert relay.custom_mode == 5  # the relay still listens


def test_what_comes_over_a_companions_link_goes_over_the_firmwares(firmware: Firmware) -> None:
    relay = firmware.relay
    relay.receive(COMPANION, from_module(override()))
    relay.receive(GROUND, from_module(beat(), component=190))
    relay.receive(99, from_module(status(0), component=190))  # of no known link: a ground station's
    kinds = [[m.get_type() for m in firmware.received(end)] for end in (firmware.ground,)]
    assert kinds == [["HEARTBEAT", "SYS_STATUS"]]
    assert [m.get_type() for m in firmware.received(firmware.companion)] == ["RC_CHANNELS_OVERRIDE"]


def test_the_newest_heartbeat_of_the_firmware_is_shown_again(firmware: Firmware) -> None:
    firmware.send(firmware.ground, beat(1), beat(9))
    firmware.relay.take_datagrams()
    firmware.relay.announce()
    shown = firmware.relay.take_datagrams()
    assert [link for link, _ in shown] == [GROUND, COMPANION]
    for _, data in shown:
        assert mavlink.MAVLink(None).decode(bytearray(data)).custom_mode == 9


def test_the_bridge_speaks_as_a_component_of_its_own(firmware: Firmware) -> None:
    firmware.relay.broadcast(mavlink.MAVLink_named_value_float_message(7, b"updraft", 1.5))
    [(link, data)] = firmware.relay.take_datagrams()
    sent = mavlink.MAVLink(None).decode(bytearray(data))
    assert link == GROUND
    assert (sent.get_srcSystem(), sent.get_srcComponent()) == (
        SYSTEM,
        240,
    )  # MAV_COMP_ID_UDP_BRIDGE
    assert (sent.time_boot_ms, sent.name, sent.value) == (7, "updraft", 1.5)


@pytest.mark.parametrize(
    ("answer", "passes"),
    [((1, 5_000), False), ((0, 5_000), True), ((1, 4_999), True)],
)
def test_only_the_answer_to_its_own_question_goes_no_further(
    firmware: Firmware, answer: tuple[int, int], passes: bool
) -> None:
    relay = firmware.relay
    relay.send(COMPANION, mavlink.MAVLink_timesync_message(0, 5_000))
    relay.receive(COMPANION, from_module(mavlink.MAVLink_timesync_message(*answer)))
    assert relay.timesync_answer_ns(COMPANION) == (0 if passes else 5_000)
    assert relay.timesync_answer_ns(GROUND) == 0
    assert bool(firmware.received(firmware.companion)) == passes


def test_heartbeats_are_counted_by_link(firmware: Firmware) -> None:
    firmware.relay.receive(COMPANION, from_module(beat(), beat(), override()))
    firmware.relay.receive(GROUND, from_module(beat(), component=190))
    assert firmware.relay.heartbeats(COMPANION) == 2
    assert firmware.relay.heartbeats(GROUND) == 1


def test_commands_of_a_companion_are_counted_by_message(firmware: Firmware) -> None:
    relay = firmware.relay
    target = mavlink.MAVLink_set_attitude_target_message(
        0, SYSTEM, 1, 7, [1.0, 0, 0, 0], 0, 0, 0, 0
    )
    manual = mavlink.MAVLink_manual_control_message(SYSTEM, 0, 0, 0, 0, 0)
    actuator = mavlink.MAVLink_set_actuator_control_target_message(0, 0, SYSTEM, 1, [0.0] * 8)
    relay.receive(COMPANION, from_module(override(), target, manual, actuator, override(), beat()))
    assert relay.commands == {
        "RC_CHANNELS_OVERRIDE": 2,
        "SET_ATTITUDE_TARGET": 1,
        "MANUAL_CONTROL": 1,
        "SET_ACTUATOR_CONTROL_TARGET": 1,
    }
    assert relay.last_command == "RC_CHANNELS_OVERRIDE"


def test_a_ground_stations_sticks_command_no_surface(firmware: Firmware) -> None:
    firmware.relay.receive(GROUND, from_module(override(), component=190))
    assert firmware.relay.commands == {}
    assert not firmware.relay.is_commanded
    assert len(firmware.received(firmware.ground)) == 1


LEFT = 65535


@pytest.mark.parametrize(
    ("pulses", "commands"),
    [
        ((0, 0, LEFT, 0, LEFT, LEFT, LEFT, LEFT), False),  # as the module disengages
        ((LEFT,) * 8, False),
        ((0, 0, LEFT, 1500, LEFT, LEFT, LEFT, LEFT), True),
        ((LEFT,) * 8 + (0, LEFT, 65534), False),  # beyond the eighth 0 leaves and 65534 releases
        ((LEFT,) * 8 + (1100,), True),
    ],
)
def test_who_gives_all_channels_back_commands_none(
    firmware: Firmware, pulses: tuple[int, ...], commands: bool
) -> None:
    relay = firmware.relay
    relay.receive(COMPANION, from_module(override(*pulses)))
    assert relay.is_commanded is commands
    assert relay.commands == ({"RC_CHANNELS_OVERRIDE": 1} if commands else {})
    assert len(firmware.received(firmware.companion)) == 1  # it is passed on all the same


def test_it_is_commanded_for_a_tenth_of_a_second(firmware: Firmware) -> None:
    """20 of its 200 steps a second."""
    relay = firmware.relay
    relay.step(0.0)
    relay.receive(COMPANION, from_module(override()))
    assert relay.commanded_step == 1
    for _ in range(20):
        assert relay.is_commanded
        relay.step(0.0)
    assert relay.is_commanded
    relay.step(0.0)
    assert not relay.is_commanded


def test_a_command_before_the_first_step_counts(firmware: Firmware) -> None:
    firmware.relay.receive(COMPANION, from_module(override()))
    assert firmware.relay.commanded_step == 0
    assert firmware.relay.is_commanded


def test_stations_that_are_not_taken_do_not_arrive(firmware: Firmware) -> None:
    relay = firmware.relay
    relay.takes_stations = False
    relay.receive(GROUND, from_module(beat(), component=190))
    relay.greet()
    assert firmware.received(firmware.ground) == []
    relay.receive(COMPANION, from_module(override()))
    kinds = [m.get_type() for m in firmware.received(firmware.companion)]
    assert kinds == ["HEARTBEAT", "RC_CHANNELS_OVERRIDE"]  # the greeting, and what is its own


def test_the_pace_is_asked_for_in_microseconds(firmware: Firmware) -> None:
    firmware.relay.set_pace(GROUND)
    firmware.relay.set_pace(99)
    assert firmware.received(firmware.companion) == []
    firmware.relay.set_pace(COMPANION)
    [asked] = firmware.received(firmware.companion)
    assert (asked.target_system, asked.target_component) == (SYSTEM, 1)
    assert (asked.command, asked.confirmation) == (511, 0)  # MAV_CMD_SET_MESSAGE_INTERVAL
    assert (asked.param1, asked.param2) == (31, 5000.0)
    rest = [asked.param3, asked.param4, asked.param5, asked.param6, asked.param7]
    assert rest == [0.0] * 5
    assert firmware.received(firmware.ground) == []


def test_the_pace_may_be_slower_than_the_steps() -> None:
    firmware = Firmware(attitude_hz=50)
    assert (firmware.relay.attitude_hz, firmware.relay.step_hz) == (50, 200)
    firmware.relay.set_pace(COMPANION)
    [asked] = firmware.received(firmware.companion)
    assert asked.param2 == 20000.0
    firmware.close()


# --- towards the firmware -------------------------------------------------------------------------


def test_it_is_greeted_as_by_a_ground_station(firmware: Firmware) -> None:
    firmware.relay.greet()
    [greeting] = firmware.received(firmware.ground)
    assert (greeting.type, greeting.autopilot) == (6, 8)  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID
    assert (greeting.base_mode, greeting.custom_mode, greeting.system_status) == (0, 0, 4)
    assert (greeting.get_srcSystem(), greeting.get_srcComponent()) == (SYSTEM, 240)
    assert len(firmware.received(firmware.companion)) == 1


def test_the_companions_link_is_greeted_until_a_companion_has_spoken(firmware: Firmware) -> None:
    relay = firmware.relay
    relay.receive(GROUND, from_module(beat(), component=190))  # a station's does not count
    firmware.received(firmware.ground)
    relay.greet()
    assert len(firmware.received(firmware.companion)) == 1
    relay.receive(COMPANION, from_module(beat()))
    firmware.received(firmware.companion)
    relay.greet()
    assert firmware.received(firmware.companion) == []
    assert len(firmware.received(firmware.ground)) == 2  # one of each greeting


def test_armed_and_mode_are_the_autopilots_own(firmware: Firmware) -> None:
    relay = firmware.relay
    firmware.send(firmware.ground, beat(5, armed=True))
    relay.step(0.0)
    assert (relay.armed, relay.custom_mode) == (True, 5)
    gimbal = mavlink.MAVLink(None, SYSTEM, 154)
    other = mavlink.MAVLink(None, SYSTEM + 1, 1)
    firmware.send(firmware.ground, beat(7), codec=gimbal)
    firmware.send(firmware.ground, beat(8), codec=other)
    firmware.send(firmware.companion, beat(9))  # nothing is learnt there
    relay.step(0.0)
    assert (relay.armed, relay.custom_mode) == (True, 5)
    firmware.send(firmware.ground, beat(0))
    relay.step(0.0)
    assert (relay.armed, relay.custom_mode) == (False, 0)


def test_it_is_ready_when_all_that_it_needs_is_healthy() -> None:
    firmware = Firmware(ready=0b110)
    for health, ready in ((0b111, True), (0b100, False), (0b110, True), (0b1000, False)):
        firmware.send(firmware.ground, status(health))
        firmware.relay.step(0.0)
        assert firmware.relay.ready == ready
    firmware.close()


def test_usually_the_checks_before_arming_are_what_it_needs(firmware: Firmware) -> None:
    for health, ready in ((1 << 28, True), (~(1 << 28) & 0x7FFFFFFF, False)):
        firmware.send(firmware.ground, status(health))
        firmware.relay.step(0.0)
        assert firmware.relay.ready == ready


def test_a_text_is_reported_once_and_remembered(firmware: Firmware) -> None:
    firmware.send(firmware.ground, mavlink.MAVLink_statustext_message(6, b"EKF3 is ready"))
    firmware.relay.step(0.0)
    assert firmware.relay.take_events() == ["it reports: EKF3 is ready"]
    assert firmware.relay.take_events() == []
    assert firmware.relay.texts == {"EKF3 is ready"}


def test_its_questions_for_the_mission_are_answered(firmware: Firmware) -> None:
    item = MissionItem(
        frame=3,
        command=16,
        parameters=(0.0, 0.0, 0.0, 0.0),
        latitude_deg=52.0,
        longitude_deg=4.0,
        height_m=10.0,
    )
    request = mavlink.MAVLink_mission_request_int_message(SYSTEM, 240, 0)
    firmware.send(firmware.ground, request)
    firmware.relay.step(0.0)
    assert firmware.received(firmware.ground) == []  # there is no mission
    firmware.relay.mission = MissionUpload((item,), SYSTEM)
    acknowledged = mavlink.MAVLink_mission_ack_message(SYSTEM, 240, 0)
    firmware.send(firmware.ground, request, acknowledged)
    firmware.relay.step(0.0)
    [answer] = firmware.received(firmware.ground)
    assert (answer.get_type(), answer.seq, answer.x) == ("MISSION_ITEM_INT", 0, 520000000)
    assert firmware.relay.mission.accepted


def test_the_companions_link_is_kept_both_ways_with_the_time_of_each_step(
    firmware: Firmware,
) -> None:
    relay = firmware.relay
    kept = relay.record = io.BytesIO()
    for _ in range(3):
        relay.step(0.0)
    firmware.send(firmware.companion, attitude(7), attitude(8))
    firmware.send(firmware.ground, beat())
    relay.step(0.0)
    relay.receive(COMPANION, from_module(override()))
    data = kept.getvalue()
    stamps = []
    codec = mavlink.MAVLink(None)
    kinds = []
    while data:
        stamps.append(int.from_bytes(data[:8], "big"))
        length = 12 + data[9]
        kinds.append(codec.decode(bytearray(data[8 : 8 + length])).get_type())
        data = data[8 + length :]
    assert stamps == [20_000, 20_000, 20_000]  # the fourth step of 5 ms
    assert kinds == ["ATTITUDE_QUATERNION", "ATTITUDE_QUATERNION", "RC_CHANNELS_OVERRIDE"]


# --- the pace of a step ---------------------------------------------------------------------------


class Waiting:
    """Counts how often a step waits for the companion's link, without any time passing by itself.

    The clock goes on by 30 ms at each wait, and in the wait of a given number an attitude comes.
    """

    def __init__(self, firmware: Firmware, monkeypatch: pytest.MonkeyPatch) -> None:
        self.waits: list[float] = []
        self.comes: dict[int, int] = {}  # in which wait the attitude of which time [ms]
        self._now = 100.0
        self._firmware = firmware
        clock = SimpleNamespace(monotonic=lambda: self._now)
        monkeypatch.setattr(relay_module, "time", clock)
        monkeypatch.setattr(FirmwareLink, "wait", lambda _, seconds: self._wait(seconds))

    def _wait(self, seconds: float) -> None:
        self.waits.append(seconds)
        self._now += 0.03
        if len(self.waits) in self.comes:
            time_ms = self.comes[len(self.waits)]
            self._firmware.send(self._firmware.companion, attitude(time_ms))


@pytest.fixture
def waiting(firmware: Firmware, monkeypatch: pytest.MonkeyPatch) -> Waiting:
    return Waiting(firmware, monkeypatch)


def streamed(firmware: Firmware, *times_ms: int) -> None:
    firmware.send(firmware.companion, *(attitude(time_ms) for time_ms in times_ms))


def test_a_step_waits_for_an_attitude_that_is_late_for_50_ms_at_most(
    firmware: Firmware, waiting: Waiting
) -> None:
    streamed(firmware, 980, 985)
    firmware.relay.step(1.0)  # of 200 Hz, so 990 is the oldest that will do
    assert waiting.waits == pytest.approx([0.05, 0.02])


def test_an_attitude_of_two_steps_ago_will_do(firmware: Firmware, waiting: Waiting) -> None:
    streamed(firmware, 985, 990)
    firmware.relay.step(1.0)
    assert waiting.waits == []


def test_the_attitude_that_comes_ends_the_wait(firmware: Firmware, waiting: Waiting) -> None:
    waiting.comes = {1: 990}
    streamed(firmware, 980, 985)
    firmware.relay.step(1.0)
    assert len(waiting.waits) == 1
    assert [link for link, _ in firmware.relay.take_datagrams()] == [COMPANION] * 3


@pytest.mark.parametrize(
    ("times_ms", "waits"),
    [
        ((), 0),  # nothing streams
        ((900,), 0),  # one attitude is no stream
        ((900, 921), 0),  # further apart than 20 ms: no stream to wait for
        ((900, 920), 2),
        ((920, 900), 0),  # time went back: it has rebooted
    ],
)
def test_only_a_stream_is_waited_for(
    firmware: Firmware, waiting: Waiting, times_ms: tuple[int, ...], waits: int
) -> None:
    streamed(firmware, *times_ms)
    firmware.relay.step(1.0)
    assert len(waiting.waits) == waits


def test_a_firmware_without_threads_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    firmware = Firmware(has_threads=False)
    waiting = Waiting(firmware, monkeypatch)
    streamed(firmware, 900, 905)
    firmware.relay.step(1.0)
    assert waiting.waits == []
    firmware.close()


def test_other_messages_and_old_frames_set_no_pace(firmware: Firmware, waiting: Waiting) -> None:
    for time_ms in (900, 905):
        firmware.send(firmware.companion, mavlink.MAVLink_attitude_message(time_ms, *[0.0] * 6))
        frame = attitude(time_ms).pack(mavlink.MAVLink(None, SYSTEM, 1), force_mavlink1=True)
        firmware.companion.sendto(bytes(frame), firmware.ours[firmware.companion])
        firmware.send(firmware.ground, attitude(time_ms))  # of the other link
    firmware.relay.step(1.0)
    assert waiting.waits == []

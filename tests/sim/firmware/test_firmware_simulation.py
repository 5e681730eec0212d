"""The launch of an aircraft behind a firmware, and the relay of its links, without a firmware."""

from __future__ import annotations

import socket
import struct
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_site
from tgl_soar.link.autopilots.base import BYTEWISE
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.firmware.relay import OWN, FirmwareLink, Relay
from tgl_soar.sim.firmware.sensors import Readings
from tgl_soar.sim.firmware.simulation import (
    NO_PULSES,
    THROTTLE_LOW,
    FirmwareSimulation,
    Sticks,
)
from tgl_soar.sim.simulation import Options, TimedSetting
from tgl_soar.types import SurfaceCommand

CONFIG = Path(__file__).parents[3] / "config"
STEP_HZ = 250
MANUAL, OBEYS = 7, 42
GROUND, COMPANION = 1, 2


class FakePhysics:
    """A firmware that puts out the trim, or what its pilot asks for."""

    name = "Fake"
    throttle = 0.0
    step_hz = STEP_HZ
    first_item = 0
    manual_mode = MANUAL
    obeys: Mapping[str, int] = {"SET_ATTITUDE_TARGET": OBEYS}
    codec = BYTEWISE
    reads_ours = True

    def __init__(self) -> None:
        self.readings: list[Readings] = []
        self.sticks: list[Sticks] = []
        self.closed = False

    def helped(self, _readings: Readings, _reported: Collection[str]) -> None:
        return None

    def exchange(self, readings: Readings, sticks: Sticks) -> SurfaceCommand:
        self.readings.append(readings)
        self.sticks.append(sticks)
        return sticks.deflections

    def ask_for_mode(self, system: int, custom_mode: int) -> Any:
        return mavlink.MAVLink_command_long_message(
            system, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, custom_mode, 0, 0, 0, 0, 0
        )

    def close(self) -> None:
        self.closed = True


class FakeLinks:
    """The firmware's ends of its two links."""

    def __init__(self) -> None:
        self.codec = mavlink.MAVLink(None, 1, 1)
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for end in self._sockets:
            end.bind(("127.0.0.1", 0))
            end.settimeout(5.0)
        self.ground, self.companion = self._sockets
        self.relay = Relay(
            1,
            STEP_HZ,
            FirmwareLink(self.ground.getsockname()),
            FirmwareLink(self.companion.getsockname()),
        )
        self.relay.add_link(GROUND, ground=True)
        self.relay.add_link(COMPANION, ground=False)
        self.relay.command(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        _, self._relays_ground = self.ground.recvfrom(4096)

    def send(self, *messages: Any) -> None:
        """On the link to a ground station."""
        for message in messages:
            self.ground.sendto(bytes(message.pack(self.codec)), self._relays_ground)

    def received(self, end: socket.socket) -> list[Any]:
        """What has come, all of it."""
        found: list[Any] = []
        end.setblocking(False)
        codec = mavlink.MAVLink(None)
        while True:
            try:
                data = end.recv(4096)
            except OSError:
                return found
            found += codec.parse_buffer(bytearray(data)) or []

    def close(self) -> None:
        for end in self._sockets:
            end.close()


@pytest.fixture
def links() -> Iterator[FakeLinks]:
    made = FakeLinks()
    yield made
    made.relay.close()
    made.close()


def simulation(
    links: FakeLinks, *faults: str, later: tuple[TimedSetting, ...] = ()
) -> tuple[FirmwareSimulation, FakePhysics]:
    physics = FakePhysics()
    made = FirmwareSimulation(
        load_airframe(CONFIG / "airframes/eclipson_c.toml"),
        load_site(CONFIG / "sites/tunnel.toml"),
        Options(faults=parse_faults(faults), later=later),
        CONFIG / "sites",
        physics,
        links.relay,
    )
    return made, physics


def heartbeat(mode: int, *, armed: bool) -> Any:
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    )
    return mavlink.MAVLink_heartbeat_message(1, 12, flags, mode, 4, 3)


def sys_status(*, ready: bool) -> Any:
    health = mavlink.MAV_SYS_STATUS_PREARM_CHECK if ready else 0
    return mavlink.MAVLink_sys_status_message(0, 0, health, 0, 0, -1, -1, 0, 0, 0, 0, 0, 0)


def from_companion(message: Any) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, 1, 191)))


def attitude_target() -> Any:
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1.0, 0, 0, 0], 0, 0, 0, 0)


def test_the_launch_goes_step_by_step(links: FakeLinks) -> None:
    sim, physics = simulation(links)
    relay = links.relay

    def steps(n: int) -> list[str]:
        events = []
        for _ in range(n):
            sim.step()
            events += sim.take_events()
        return events

    assert "waiting for Fake to boot" in steps(1)[0]
    assert not sim.booted
    links.send(heartbeat(3, armed=False), sys_status(ready=False))
    assert any("has booted" in event for event in steps(3))
    assert sim.booted
    assert steps(STEP_HZ) == []  # not aligned, so nothing is asked
    links.received(links.ground)
    links.send(sys_status(ready=True))
    assert "aligned: arming it" in steps(3)
    steps(STEP_HZ)
    asked = [m for m in links.received(links.ground) if m.get_type() == "COMMAND_LONG"]
    assert [(m.command, m.param2) for m in asked] == [(mavlink.MAV_CMD_DO_SET_MODE, MANUAL)]
    links.send(heartbeat(MANUAL, armed=False))
    steps(STEP_HZ + 1)
    asked = [m for m in links.received(links.ground) if m.get_type() == "COMMAND_LONG"]
    assert [(m.command, m.param1) for m in asked] == [(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)]
    links.send(heartbeat(MANUAL, armed=True))
    assert any("held until a companion" in event for event in steps(3))
    relay.receive(COMPANION, from_companion(attitude_target()))
    assert steps(3) == []  # commanded, but in no mode that obeys
    assert sim.world.held
    relay.receive(COMPANION, from_companion(attitude_target()))
    links.send(heartbeat(OBEYS, armed=True))
    assert any("launched: it obeys SET_ATTITUDE_TARGET" in event for event in steps(3))
    assert sim.flying
    assert physics.sticks[-1].deflections == (0.0, 0.0, 0.0, 0.0)
    assert "SET_ATTITUDE_TARGET" in sim.summary()
    sim.close()
    assert physics.closed


def test_the_pilot_flies_when_the_companion_falls_silent(links: FakeLinks) -> None:
    sim, physics = simulation(links)
    links.send(heartbeat(MANUAL, armed=True), sys_status(ready=True))
    for _ in range(5):
        sim.step()
    links.relay.receive(COMPANION, from_companion(attitude_target()))
    links.send(heartbeat(OBEYS, armed=True))
    for _ in range(3):
        sim.step()
    assert sim.flying
    for _ in range(STEP_HZ // 10 + 2):
        sim.step()
    assert any(abs(d) > 0.0 for d in physics.sticks[-1].deflections)
    for _ in range(3 * STEP_HZ):
        sim.step()
    assert sim.crashes == 0
    sim.close()


def test_the_pilots_switch_is_a_fault_to_inject(links: FakeLinks) -> None:
    sim, physics = simulation(links, "pilot.takes start=0.1 for=0.1")
    for _ in range(STEP_HZ // 2):
        sim.step()
    taken = [i / STEP_HZ for i, sticks in enumerate(physics.sticks) if sticks.takes]
    assert len(physics.readings) == STEP_HZ // 2
    assert taken[0] == pytest.approx(0.1, abs=0.008)
    assert taken[-1] == pytest.approx(0.2, abs=0.008)
    sim.close()


def test_the_pilots_transmitter_and_the_stations_can_fall_silent(links: FakeLinks) -> None:
    sim, physics = simulation(
        links,
        "transmitter.silent start=0.1 for=0.1",
        "transmitter.failsafe start=0.3 for=0.1",
        "station.silent start=0.1 for=0.1",
    )
    station_received = []
    station = bytes(heartbeat(0, armed=False).pack(mavlink.MAVLink(None, 254, 190)))
    links.received(links.ground)
    for _ in range(STEP_HZ // 2):
        sim.step()
        sim.receive(GROUND, station)
        station_received.append(any(m.get_srcSystem() == 254 for m in links.received(links.ground)))
    signals = [sticks.signal for sticks in physics.sticks]
    for after_s, signal in ((0.05, 0), (0.15, NO_PULSES), (0.25, 0), (0.35, THROTTLE_LOW)):
        assert signals[round(after_s * STEP_HZ)] == signal
        assert station_received[round(after_s * STEP_HZ)] == (signal != NO_PULSES)
    assert signals[-1] == 0
    sim.close()


def test_a_parameter_of_the_firmware_is_set_in_flight(links: FakeLinks) -> None:
    sim, _ = simulation(
        links, later=(TimedSetting("SIM_B", 2.0, 0.2), TimedSetting("SIM_A", 1.0, 0.1))
    )
    links.received(links.ground)
    sim.step()
    assert links.received(links.ground) == []  # it has not booted
    links.send(heartbeat(MANUAL, armed=True))
    kinds = {"SIM_A": mavlink.MAV_PARAM_TYPE_INT32, "SIM_B": mavlink.MAV_PARAM_TYPE_REAL32}
    settings, events = [], []
    for step in range(1, STEP_HZ // 2):
        sim.step()
        events += sim.take_events()
        for message in links.received(links.ground):
            name = message.param_id if message.get_type().startswith("PARAM_") else ""
            if not name:
                continue
            value = message.param_value if message.get_type() == "PARAM_SET" else 0.0
            links.send(mavlink.MAVLink_param_value_message(name.encode(), value, kinds[name], 2, 0))
            if message.get_type() == "PARAM_SET":
                settings.append((name, value, message.param_type, step / STEP_HZ))
    one = struct.unpack("<f", struct.pack("<i", 1))[0]
    assert [each[:3] for each in settings] == [("SIM_A", one, 6), ("SIM_B", 2.0, 9)]
    assert [at_s for *_, at_s in settings] == pytest.approx([0.1, 0.2], abs=0.01)
    words = [event for event in events if "SIM_" in event]
    assert words == ["sets SIM_A = 1", "SIM_A is 1", "sets SIM_B = 2", "SIM_B is 2"]
    sim.close()


def test_frames_pass_as_they_are_and_barriers_go_no_further(links: FakeLinks) -> None:
    relay = links.relay
    relay.send(COMPANION, mavlink.MAVLink_timesync_message(0, 5_000))
    ((link, asked),) = relay.take_datagrams([COMPANION])
    question = mavlink.MAVLink(None).decode(bytearray(asked))
    assert (link, question.get_srcComponent(), question.ts1) == (COMPANION, OWN, 5_000)
    answer = from_companion(mavlink.MAVLink_timesync_message(1, 5_000))
    other = from_companion(mavlink.MAVLink_timesync_message(1, 77))
    target = from_companion(attitude_target())
    relay.receive(COMPANION, answer + other + target)
    assert relay.timesync_answer_ns(COMPANION) == 5_000
    assert links.companion.recv(4096) == other + target
    assert links.received(links.ground) == []


def test_what_passes_the_companions_link_can_be_kept(links: FakeLinks, tmp_path: Path) -> None:
    """As a .tlog: eight bytes of microseconds before every frame."""
    relay = links.relay
    with (tmp_path / "companion.tlog").open("wb") as relay.record:
        for i in range(5):
            relay.step(i / STEP_HZ)
        relay.receive(COMPANION, from_companion(attitude_target()))
        relay.receive(GROUND, from_companion(sys_status(ready=True)))
    kept = (tmp_path / "companion.tlog").read_bytes()
    assert int.from_bytes(kept[:8], "big") == 20_000
    assert kept[8:] == from_companion(attitude_target())


def test_all_peers_receive_their_side_of_the_firmware(links: FakeLinks) -> None:
    relay = links.relay
    relay.add_link(9, ground=True)
    links.send(heartbeat(MANUAL, armed=True))
    taken = relay.take_datagrams()
    assert sorted(link for link, _ in taken) == [GROUND, 9]
    relay.announce()
    assert sorted(link for link, _ in relay.take_datagrams()) == [GROUND, COMPANION, 9]
    relay.remove_link(9)
    relay.broadcast(mavlink.MAVLink_named_value_float_message(0, b"updraft", 1.0))
    assert [link for link, _ in relay.take_datagrams()] == [GROUND]


def test_the_pace_of_lockstep_is_the_attitude_of_every_step(links: FakeLinks) -> None:
    links.relay.set_pace(GROUND)
    assert links.received(links.companion) == []
    links.relay.set_pace(COMPANION)
    [asked] = links.received(links.companion)
    assert asked.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert (asked.param1, asked.param2) == (31, 1e6 / STEP_HZ)

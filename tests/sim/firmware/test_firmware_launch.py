"""The stages in which an aircraft behind a firmware is launched: what is asked of the firmware in
each and when, what a mission needs, and who holds the sticks."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.link.autopilots.base import CAST
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.sim.firmware.mission import MissionItem
from tgl_soar.sim.firmware.relay import FirmwareLink, Relay
from tgl_soar.sim.firmware.sensors import Readings
from tgl_soar.sim.firmware.simulation import (
    ASK_S,
    NO_PULSES,
    RECEIVED,
    SIGNALS,
    THROTTLE_LOW,
    FirmwareSimulation,
    Sticks,
    arm,
)
from tgl_soar.sim.simulation import Options, TimedSetting
from tgl_soar.sim.vehicle.level_flight import PITCH_STICK_RAD
from tgl_soar.types import SurfaceCommand

STEP_HZ = 50  # few steps, as a test has many seconds; the sensors' 50 Hz divide it
MANUAL, OBEYS = 7, 42
AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
SITE = load_site(shipped("sites/hill.toml"))
HOME = MissionItem(
    frame=0,
    command=16,
    parameters=(0.0, 0.0, 0.0, 0.0),
    latitude_deg=52.0,
    longitude_deg=4.0,
    height_m=10.0,
)
LAND = MissionItem(
    frame=3,
    command=21,
    parameters=(0.0, 0.0, 0.0, 0.0),
    latitude_deg=52.1,
    longitude_deg=4.1,
    height_m=0.0,
)


class Physics:
    """A firmware that puts out what the sticks ask for, and keeps the sticks of each step."""

    name = "Fake"
    step_hz = STEP_HZ
    first_item = 0
    manual_mode = MANUAL
    obeys: Mapping[str, int] = {"SET_ATTITUDE_TARGET": OBEYS}
    codec = CAST
    reads_ours = True

    def __init__(self, first_item: int = 0) -> None:
        self.first_item = first_item
        self.throttle = 0.0
        self.help: Any = None
        self.texts: list[set[str]] = []
        self.readings: list[Readings] = []
        self.sticks: list[Sticks] = []
        self.answer: SurfaceCommand | None = None

    def helped(self, _readings: Readings, texts: Collection[str]) -> Any:
        self.texts.append(set(texts))
        return self.help

    def exchange(self, readings: Readings, sticks: Sticks) -> SurfaceCommand:
        self.readings.append(readings)
        self.sticks.append(sticks)
        return self.answer or sticks.deflections

    def ask_for_mode(self, system: int, custom_mode: int) -> Any:
        return mavlink.MAVLink_command_long_message(
            system, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, custom_mode, 0, 0, 0, 0, 0
        )

    def close(self) -> None:
        pass


class FirmwareRelay(Relay):
    """A relay whose firmware reports what the test sets, without a socket between."""

    def __init__(self) -> None:
        super().__init__(1, STEP_HZ, FirmwareLink(None), FirmwareLink(None))
        self.asked: list[Any] = []
        self.greeted: list[int] = []

    def command(self, message: Any) -> None:
        self.asked.append(message)

    def greet(self) -> None:
        self.greeted.append(self._step)

    def reports(self, mode: int, *, armed: bool = False, ready: bool = True) -> None:
        self.custom_mode, self.armed, self.ready = mode, armed, ready

    def commanded(self, by: str = "SET_ATTITUDE_TARGET") -> None:
        self.last_command, self.commanded_step = by, self._step


class Flight:
    """A simulation with its fake firmware."""

    def __init__(
        self,
        *,
        mission: tuple[MissionItem, ...] = (),
        first_item: int = 0,
        faults: tuple[str, ...] = (),
        **options: Any,
    ) -> None:
        self.physics, self.relay = Physics(first_item), FirmwareRelay()
        self.sim = FirmwareSimulation(
            AIRFRAME,
            SITE,
            Options(faults=parse_faults(faults), turbulence=0.0, **options),
            shipped("sites"),
            self.physics,
            self.relay,
            mission,
        )
        self.sim.take_events()

    def steps(self, n: int = 1) -> list[str]:
        events = []
        for _ in range(n):
            self.sim.step()
            events += self.sim.take_events()
        return events

    def asked(self) -> list[Any]:
        asked, self.relay.asked = self.relay.asked, []
        return asked

    def booted(self) -> None:
        self.relay.reports(3, ready=False)
        assert self.steps() == [
            "Fake has booted: waiting until its estimator has aligned",
        ]

    def aligned(self) -> None:
        self.booted()
        self.relay.reports(3)
        assert self.steps() == ["aligned: arming it"]

    def launched(self) -> None:
        self.aligned()
        self.relay.reports(OBEYS, armed=True)
        assert self.steps() == ["armed: held until a companion commands the surfaces"]
        self.relay.commanded()
        assert self.steps() == ["launched: it obeys SET_ATTITUDE_TARGET"]


@pytest.fixture
def flight() -> Flight:
    return Flight()


def test_it_is_held_until_it_boots_and_says_so_at_first() -> None:
    physics, relay = Physics(), FirmwareRelay()
    sim = FirmwareSimulation(AIRFRAME, SITE, Options(), shipped("sites"), physics, relay)
    assert sim.take_events() == ["waiting for Fake to boot; the aircraft is held"]
    assert sim.world.held
    assert not sim.booted
    assert not sim.flying
    for mode, booted in ((-1, False), (0, True)):
        relay.custom_mode = mode
        assert sim.booted == booted


def test_nothing_is_asked_before_it_could_be_armed(flight: Flight) -> None:
    flight.booted()
    assert flight.steps(3 * STEP_HZ) == []
    assert flight.asked() == []


def test_it_is_asked_once_a_second_for_its_mode_and_then_to_arm(flight: Flight) -> None:
    assert ASK_S == 1.0
    flight.aligned()
    flight.asked()
    flight.steps(3 * STEP_HZ)
    asked = flight.asked()
    assert [(each.command, each.param2) for each in asked] == [(176, MANUAL)] * 3  # DO_SET_MODE
    flight.relay.reports(MANUAL)
    flight.steps(2 * STEP_HZ)
    assert [(each.command, each.param1) for each in flight.asked()] == [(400, 1.0)] * 2
    flight.relay.reports(MANUAL, armed=True)
    assert flight.steps() == ["armed: held until a companion commands the surfaces"]
    flight.steps(2 * STEP_HZ)
    assert flight.asked() == []


def test_the_command_to_arm_has_no_other_parameter() -> None:
    sent = arm(21)
    assert (sent.target_system, sent.target_component, sent.confirmation) == (21, 1, 0)
    assert (sent.command, sent.param1) == (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    rest = [sent.param2, sent.param3, sent.param4, sent.param5, sent.param6, sent.param7]
    assert rest == [0.0] * 6


@pytest.mark.parametrize("lacking", ["armed", "command", "mode", "kind"])
def test_it_is_freed_only_armed_and_commanded_in_the_mode_that_obeys(
    flight: Flight, lacking: str
) -> None:
    flight.aligned()
    flight.relay.reports(OBEYS, armed=True)
    flight.steps()
    flight.relay.reports(5 if lacking == "mode" else OBEYS, armed=lacking != "armed")
    if lacking != "command":
        flight.relay.commanded("MANUAL_CONTROL" if lacking == "kind" else "SET_ATTITUDE_TARGET")
    assert flight.steps() == []
    assert flight.sim.world.held
    flight.relay.reports(OBEYS, armed=True)
    flight.relay.commanded()
    assert flight.steps() == ["launched: it obeys SET_ATTITUDE_TARGET"]
    assert not flight.sim.world.held
    assert flight.sim.flying


def test_a_mission_is_announced_every_second_until_it_is_accepted() -> None:
    flight = Flight(mission=(HOME, LAND))
    flight.booted()
    flight.steps(2 * STEP_HZ)
    assert flight.asked() == []  # not ready
    flight.relay.reports(3)
    assert flight.steps(2 * STEP_HZ) == []
    begun = flight.asked()
    assert [(each.get_type(), each.count) for each in begun] == [("MISSION_COUNT", 2)] * 2
    assert flight.relay.mission is not None
    flight.relay.mission.answer(mavlink.MAVLink_mission_ack_message(1, 190, 0))
    assert flight.steps() == ["aligned: arming it"]
    flight.asked()
    flight.relay.reports(MANUAL, armed=True)
    flight.steps()
    [home] = flight.asked()
    assert (home.get_type(), home.command, home.x) == ("COMMAND_INT", 179, 520000000)


def test_a_firmware_that_has_its_home_by_itself_is_given_the_other_items() -> None:
    flight = Flight(mission=(HOME, LAND), first_item=1)
    mission = flight.relay.mission
    assert mission is not None
    assert mission.begin().count == 1
    answer = mission.answer(mavlink.MAVLink_mission_request_int_message(1, 190, 0))
    assert answer is not None
    assert answer.command == 21


def test_without_a_mission_no_home_is_set(flight: Flight) -> None:
    flight.aligned()
    flight.relay.reports(MANUAL, armed=True)
    flight.asked()
    flight.steps()
    assert flight.asked() == []


def test_a_mission_that_is_refused_ends_the_flight() -> None:
    flight = Flight(mission=(HOME, LAND))
    flight.booted()
    flight.relay.reports(3)
    assert flight.relay.mission is not None
    flight.relay.mission.answer(mavlink.MAVLink_mission_ack_message(1, 190, 4))
    with pytest.raises(FirmwareError, match="Fake refuses the mission: MAV_MISSION_RESULT 4"):
        flight.steps(STEP_HZ)


def test_it_is_greeted_once_a_second(flight: Flight) -> None:
    flight.steps(3 * STEP_HZ)
    assert len(flight.relay.greeted) == 3
    assert set(np.diff(flight.relay.greeted)) == {STEP_HZ}


def test_help_goes_to_the_firmware_and_is_given_what_it_reported(flight: Flight) -> None:
    flight.relay.texts.add("EKF3 begins")
    flight.steps()
    assert flight.asked() == []
    flight.physics.help = arm(1)
    flight.steps(2)
    assert flight.asked() == [flight.physics.help] * 2
    assert flight.physics.texts == [{"EKF3 begins"}] * 3


def test_truth_goes_to_ground_stations_five_times_a_second() -> None:
    for truth, times in ((True, 5), (False, 0)):
        flight = Flight(truth=truth)
        flight.relay.add_link(1, ground=True)
        flight.steps(STEP_HZ)
        codec = mavlink.MAVLink(None)
        sent = [codec.decode(bytearray(data)) for _, data in flight.relay.take_datagrams()]
        updrafts = [message for message in sent if message.get_type() == "NAMED_VALUE_FLOAT"]
        assert len(updrafts) == 6 * times
        if truth:
            assert {message.name for message in updrafts} == {
                *("updraft", "sink", "true_x", "true_y", "true_z", "airspeed")
            }
            stamps = sorted({message.time_boot_ms for message in updrafts})
            assert stamps == [200, 400, 600, 800, 1000]


def test_a_motors_throttle_reaches_the_world(flight: Flight) -> None:
    flight.physics.throttle = 0.75
    flight.steps()
    assert flight.sim.world.throttle == 0.75


def test_the_surfaces_follow_the_firmwares_answer(flight: Flight) -> None:
    flight.launched()
    flight.physics.answer = SurfaceCommand(0.0, 1.0, 0.0)
    before = flight.sim.world.truth.roll_rad
    flight.steps(STEP_HZ // 2)
    assert flight.sim.world.truth.roll_rad > before + 0.2
    assert flight.physics.readings[-1].rate_frd_radps[0] > 0.5


@pytest.mark.parametrize("mode", [OBEYS, MANUAL])
def test_the_pilot_flies_unless_a_command_is_obeyed(flight: Flight, mode: int) -> None:
    flight.launched()
    flight.steps()
    assert flight.physics.sticks[-1].deflections == (0.0, 0.0, 0.0, 0.0)
    flight.relay.custom_mode = mode
    for _ in range(STEP_HZ // 2):
        flight.relay.commanded()
        flight.steps()
    flown = any(flight.physics.sticks[-1].deflections)
    assert flown == (mode == MANUAL)  # there the command is not obeyed


def test_the_pilot_holds_the_place_where_they_took_over_last(flight: Flight) -> None:
    """5 m up and downwind of where they held it before: it is held there and not flown back to, so
    their stick asks for no pitch of 0.15 rad."""
    flight.launched()
    flight.relay.reports(5, armed=True)  # in a mode that helps, their stick asks for a pitch
    flight.steps(10)
    flight.relay.custom_mode = OBEYS
    flight.relay.commanded()
    flight.steps()
    world = flight.sim.world
    state = world.state
    world.state = state._replace(x_m=state.x_m + 5.0, z_m=state.z_m + 5.0)
    flight.relay.reports(5, armed=True)
    flight.steps()
    v_x, v_z = world.state.velocity_x_mps, world.state.velocity_z_mps
    damping_rad = 0.25 * (-v_x * sin(radians(105.0)) + v_z * cos(radians(105.0)))
    asked_rad = flight.physics.sticks[-1].deflections.elevator * PITCH_STICK_RAD
    assert asked_rad == pytest.approx(max(-0.15, min(0.15, damping_rad)), abs=0.02)
    assert abs(asked_rad) < 0.1


def test_the_pilot_flies_once_no_command_comes(flight: Flight) -> None:
    flight.launched()
    flight.steps(STEP_HZ // 10 - 1)
    assert not any(flight.physics.sticks[-1].deflections)
    flight.steps(STEP_HZ // 2)
    assert any(flight.physics.sticks[-1].deflections)


def test_in_manual_the_pilot_moves_the_elevator_and_the_ailerons_themselves(
    flight: Flight,
) -> None:
    """In a mode that helps, their stick asks for no bank: wings level are its middle."""
    for mode, by_hand in ((MANUAL, True), (5, False)):
        flight.launched() if by_hand else None
        flight.relay.reports(mode, armed=True)
        state = flight.sim.world.state
        flight.sim.world.state = state._replace(qx=0.1)
        flight.steps(STEP_HZ // 4)
        assert (flight.physics.sticks[-1].deflections.aileron != 0.0) == by_hand


def test_the_signals_of_a_transmitter_have_names() -> None:
    assert (RECEIVED, NO_PULSES, THROTTLE_LOW) == (0, 1, 2)
    assert SIGNALS == {"transmitter.silent": NO_PULSES, "transmitter.failsafe": THROTTLE_LOW}


def test_what_the_pilot_takes_and_what_is_received_is_reported_while_held_too() -> None:
    flight = Flight(faults=("pilot.takes start=0.2 for=0.2", "transmitter.silent start=0.2 for=1"))
    flight.steps(STEP_HZ // 2)
    sticks = flight.physics.sticks
    assert [s.takes for s in sticks[:9]] == [False] * 9
    assert all(s.takes for s in sticks[11:19])
    assert not any(s.takes for s in sticks[22:])
    assert {s.signal for s in sticks[11:]} == {NO_PULSES}
    assert {s.deflections for s in sticks} == {SurfaceCommand(0.0, 0.0, 0.0, 0.0)}


def test_one_that_was_lost_lies_for_ten_seconds_and_is_held_and_launched_again(
    flight: Flight,
) -> None:
    flight.launched()
    world = flight.sim.world
    world.state = world.state._replace(z_m=-100.0)  # below the ground
    flight.relay.reports(MANUAL, armed=True)
    [lost] = flight.steps()
    assert lost.startswith("lost: ")
    assert (flight.sim.crashes, flight.sim.flying) == (1, False)
    assert flight.steps(10 * STEP_HZ - 1) == []
    assert flight.steps(2) == ["carried back and held at the start again"]
    assert world.held
    assert world.crashed == ""
    flight.relay.reports(OBEYS, armed=True)
    flight.relay.commanded()
    assert flight.steps() == ["launched: it obeys SET_ATTITUDE_TARGET"]
    assert flight.sim.crashes == 1


def test_one_that_is_lost_need_not_boot_again(flight: Flight) -> None:
    flight.launched()
    flight.steps()
    flight.sim.world.state = flight.sim.world.state._replace(z_m=-100.0)
    flight.steps(3 * STEP_HZ + 2)
    flight.relay.reports(3)  # disarmed: it is not armed again before a companion flies
    flight.asked()
    flight.steps(2 * STEP_HZ)
    assert flight.asked() == []


def test_the_summary_counts_what_the_companion_sent(flight: Flight) -> None:
    assert flight.sim.summary() == "commands: none"
    flight.relay.commands = {"SET_ATTITUDE_TARGET": 3, "MANUAL_CONTROL": 1}
    assert flight.sim.summary() == "commands: 3 SET_ATTITUDE_TARGET, 1 MANUAL_CONTROL"


def test_log_and_record_are_written_and_closed(tmp_path: Path) -> None:
    log, record = tmp_path / "truth.csv", tmp_path / "record.tlog"
    flight = Flight(log=log, log_hz=25, record=record)
    flight.relay.reports(OBEYS, armed=True)
    flight.steps(STEP_HZ)
    assert flight.relay.record is not None
    flight.sim.close()
    assert flight.relay.record.closed
    assert record.read_bytes() == b""
    assert log.stat().st_size > 0


def test_a_parameter_is_set_with_the_components_own_message(flight: Flight) -> None:
    timed = Flight(later=(TimedSetting("SIM_X", 2.5, 0.1),))
    timed.booted()
    [asked] = [m for m in timed.asked() if m.get_type() == "PARAM_REQUEST_READ"]
    assert (asked.target_system, asked.target_component, asked.param_id) == (1, 1, "SIM_X")
    assert timed.relay.parameters is not None
    timed.relay.parameters.take(mavlink.MAVLink_param_value_message(b"SIM_X", 0.0, 9, 1, 0))
    events = timed.steps(STEP_HZ // 5)
    assert events == ["sets SIM_X = 2.5"]
    [sent] = timed.asked()
    assert (sent.target_system, sent.target_component) == (1, 1)
    assert (sent.param_id, sent.param_value, sent.param_type) == ("SIM_X", 2.5, 9)  # REAL32
    assert flight.asked() == []


def test_a_sensor_fails_on_its_way_to_the_firmware() -> None:
    flight = Flight(faults=("compass.silent start=0.2 for=0.2", "position.bias start=0"))
    for _ in range(STEP_HZ):
        flight.sim.step()
    arrived = [r.time_s for r in flight.physics.readings if r.magnetic_frd_gauss is not None]
    assert max(t for t in arrived if t < 0.3) < 0.2
    assert min(t for t in arrived if t > 0.3) == pytest.approx(0.4, abs=0.03)


def test_a_firmware_that_makes_its_own_sensors_has_none_that_fail_by_us(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Physics, "reads_ours", False)
    Flight(faults=("pilot.takes start=0.2",))
    with pytest.raises(FirmwareError, match=r"compass\.bias: Fake simulates its sensors itself"):
        Flight(faults=("compass.bias start=0.2",))


def test_time_is_the_firmwares_own(flight: Flight) -> None:
    """A pause of the bridge adds nothing to it: its stamps come from the steps."""
    flight.steps(5)
    flight.sim.pass_over(10.0)
    flight.steps(5)
    assert flight.sim.time_s == pytest.approx(10 / STEP_HZ)
    assert flight.physics.readings[-1].time_s == pytest.approx(10 / STEP_HZ)

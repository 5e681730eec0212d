"""Flying by attitude targets: into the firmware's mode, setpoints, out of it again."""

from math import radians
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import CHANNELS, Flight, setup, texts

from tgl_soar.control.supervisor import CAPTURING, READY, is_flying
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.link.autopilots import flavour
from tgl_soar.link.messages import RESULT_CANCELLED, Source

PLANE, PX4 = (1, 3), (1, 12)
FBWA, GUIDED = 5, 15
STABILIZED, OFFBOARD = 7 << 16, 6 << 16


class Guided(Flight):
    """A vehicle whose own loops hold attitudes, and which enters its mode when asked."""

    def __init__(self, firmware: str = "ardupilot") -> None:
        pilot = flavour(firmware, "attitude", CHANNELS, 1)
        super().__init__(flown=setup()._replace(flavour=pilot, override=Source(1, 191)))
        self.kind, self.mode = (PLANE, FBWA) if firmware == "ardupilot" else (PX4, STABILIZED)
        self.enters = True
        self.quickens = True  # its heartbeat, where it is asked to
        self.asked: list[tuple[float, ...]] = []
        self.targets: list[Any] = []
        self.acks: list[int] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            super().run(0.05)
            for message in self.outbound():
                if message.get_type() == "SET_ATTITUDE_TARGET":
                    self.targets.append(message)
                if message.get_type() == "COMMAND_ACK":
                    self.acks.append(message.result)
                if message.get_type() != "COMMAND_LONG":
                    continue
                if self.quickens and (message.command, message.param1) == (511, 0.0):
                    self.heartbeat_hz = 1e6 / message.param2
                if message.command == 176:
                    self.asked.append((message.param1, message.param2, message.param3))
                    if self.enters:
                        main = int(message.param2)
                        self.mode = main if self.kind == PLANE else main << 16


@pytest.mark.parametrize(("firmware", "mode"), [("ardupilot", GUIDED), ("px4", OFFBOARD)])
def test_it_enters_flies_and_goes_back(firmware: str, mode: int) -> None:
    flight = Guided(firmware)
    before = flight.mode
    flight.run(1.2)
    assert flight.mode_now == READY
    assert flight.targets == []
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert len(flight.targets) > 5  # setpoints stream before the mode has come
    flight.run(1.2)
    assert flight.mode == mode
    assert flight.mode_now == CAPTURING
    assert all((m.get_srcSystem(), m.get_srcComponent()) == (1, 191) for m in flight.targets)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.4)
    assert flight.mode == before
    reported = len(flight.targets)
    flight.run(2.0)
    assert len(flight.targets) == reported
    assert len(flight.asked) == 2  # in and out


def test_setpoints_are_those_of_the_laws() -> None:
    flight = Guided()
    flight.quaternion = list(quaternion_from_euler(0.0, radians(3.0), radians(10.0)))
    flight.run(1.2)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    output = flight.onboard.output
    assert output is not None
    roll, pitch, yaw = euler_from_quaternion(*flight.targets[-1].q)
    assert roll == pytest.approx(0.0, abs=1e-6)
    assert pitch == pytest.approx(output.setpoints.pitch_rad, abs=1e-5)
    assert yaw < 0.0  # left rudder: the nose is right of upwind
    assert yaw == pytest.approx(output.command.rudder * radians(45.0), abs=1e-5)
    assert output.command.elevator != output.command.elevator  # it is not ours


def test_a_firmware_that_turns_by_banking_is_asked_for_a_bank() -> None:
    flight = Guided("px4")
    flight.quaternion = list(quaternion_from_euler(0.0, 0.0, radians(10.0)))
    flight.run(1.2)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    roll, _, yaw = euler_from_quaternion(*flight.targets[-1].q)
    assert roll == pytest.approx(radians(-10.0), abs=1e-3)
    assert yaw == pytest.approx(0.0, abs=1e-6)


def test_a_mode_that_does_not_come_engages_nothing() -> None:
    flight = Guided()
    flight.enters = False
    flight.run(1.2)
    engage = mavlink.MAVLink_command_long_message(1, 191, 31010, 0, 0, 0, 0, 0, 0, 0, 0)
    flight.receive(engage, station=True)
    flight.run(5.0)
    assert flight.mode_now == READY
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert any("does not enter GUIDED" in text for text in flight.console)
    assert len(flight.asked) == 3
    assert flight.acks[-1] == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


@pytest.mark.parametrize("way", ["release", "abort", "parameter"])
def test_an_engagement_that_is_withdrawn_before_the_mode_comes_is_answered(way: str) -> None:
    """No change of the module's mode would show its end."""

    def command(number: int) -> mavlink.MAVLink_command_long_message:
        return mavlink.MAVLink_command_long_message(1, 191, number, 0, 0, 0, 0, 0, 0, 0, 0)

    flight = Guided()
    flight.enters = False
    flight.run(1.2)
    flight.receive(command(31010), station=True)
    flight.run(0.3)
    assert flight.mode_now == READY
    assert flight.acks == []  # nothing is known of it yet
    if way == "parameter":
        flight.set("OP_ENGAGE", 0.0)
    else:
        flight.receive(command(31011 if way == "release" else 31012), station=True)
    flight.run(0.2)
    assert RESULT_CANCELLED in flight.acks
    answered = len(flight.acks)
    flight.run(12.0)
    assert len(flight.acks) == answered  # the request has ended
    flight.enters = True
    flight.receive(command(31011), station=True)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(4.0)
    assert is_flying(flight.mode_now)
    assert flight.acks[answered:] == [mavlink.MAV_RESULT_ACCEPTED]  # of the second release


SLOW_OR_FAST = pytest.mark.parametrize("quickens", [False, True], ids=["1 Hz", "5 Hz"])
POSITION, LOITER = 3 << 16, 12


@SLOW_OR_FAST
@pytest.mark.parametrize(
    ("firmware", "chosen"), [("ardupilot", LOITER), ("px4", POSITION)], ids=["ArduPlane", "PX4"]
)
def test_a_mode_that_the_pilot_chooses_while_it_enters_stays(
    firmware: str, chosen: int, quickens: bool
) -> None:
    flight = Guided(firmware)
    flight.quickens, flight.enters = quickens, False  # the request is lost, or not obeyed yet
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(1.0)
    assert len(flight.asked) > 0
    flight.enters = True
    flight.mode = chosen
    asked = len(flight.asked)
    flight.run(6.0)
    assert flight.mode == chosen
    assert len(flight.asked) == asked
    assert flight.mode_now == READY
    assert flight.onboard.parameters.values["OP_ENGAGE"] == 0.0
    assert any("pilot has chosen another mode" in text for text in flight.console)


@SLOW_OR_FAST
@pytest.mark.parametrize(
    ("firmware", "chosen"), [("ardupilot", LOITER), ("px4", POSITION)], ids=["ArduPlane", "PX4"]
)
def test_a_mode_that_the_pilot_chooses_as_it_disengages_stays(
    firmware: str, chosen: int, quickens: bool
) -> None:
    """The module disengages by itself between the pilot's choice and the heartbeat that shows
    it."""
    flight = Guided(firmware)
    flight.quickens = quickens
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert is_flying(flight.mode_now)
    asked, session = len(flight.asked), flight.onboard.session
    heartbeats = session.counters.heartbeats
    while session.counters.heartbeats == heartbeats:
        flight.run(0.05)
    flight.mode = chosen  # the next heartbeat will show it
    flight.attitude_hz = 0.0
    flight.run(0.8)
    assert not is_flying(flight.mode_now)
    flight.attitude_hz = 200.0
    flight.run(6.0)
    assert flight.mode == chosen
    assert len(flight.asked) == asked


@pytest.mark.parametrize(
    ("firmware", "chosen"), [("ardupilot", LOITER), ("px4", POSITION)], ids=["ArduPlane", "PX4"]
)
def test_a_station_that_repeats_itself_does_not_overwrite_the_pilot_s_choice(
    firmware: str, chosen: int
) -> None:
    """Stations set OP_ENGAGE up to three times more, a second apart, where no answer reaches
    them: that is the request of before the pilot's choice."""
    flight = Guided(firmware)
    flight.enters = False
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.5)
    assert len(flight.asked) == 1
    flight.enters, flight.mode = True, chosen
    for _ in range(3):
        flight.run(1.0)
        flight.set("OP_ENGAGE", 1.0)
    flight.run(3.0)
    assert flight.mode == chosen
    assert len(flight.asked) == 1
    flight.set("OP_ENGAGE", 1.0)  # asked for once more, after a while
    flight.run(1.0)
    assert is_flying(flight.mode_now)


def test_after_the_pilot_s_takeover_the_mode_of_before_counts_no_more() -> None:
    flight = Guided()
    flight.mode = 10  # AUTO, from which the first engagement comes
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert is_flying(flight.mode_now)
    flight.mode = FBWA  # the pilot takes over,
    flight.run(5.0)
    assert flight.mode_now == READY
    flight.mode = GUIDED  # and later chooses the mode that obeys themselves
    flight.run(1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(1.0)
    assert is_flying(flight.mode_now)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(1.0)
    assert flight.mode == FBWA  # the route's own: AUTO would fly a mission without a propeller
    assert [mode for _, mode, _ in flight.asked] == [GUIDED, FBWA]


def test_acknowledgements_say_nothing_of_the_mode() -> None:
    """PX4 answers twice, the first time always ACCEPTED; on a bad link none comes at all."""
    flight = Guided("px4")
    flight.enters = False
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.3)
    for result in (0, 1):  # ACCEPTED, TEMPORARILY_REJECTED
        flight.receive(mavlink.MAVLink_command_ack_message(176, result, 0, 0, 1, 191))
    flight.run(0.3)
    assert flight.mode_now == READY
    flight.enters = True
    flight.run(1.0)  # the second request
    assert flight.mode_now == CAPTURING
    assert len(flight.asked) == 2


def test_engaged_again_while_it_still_leaves_does_not_fight_itself() -> None:
    flight = Guided()
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert is_flying(flight.mode_now)
    flight.set("OP_ENGAGE", 0.0)
    flight.run(0.05)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(3.0)
    assert is_flying(flight.mode_now)
    assert flight.mode == GUIDED
    assert [mode for _, mode, _ in flight.asked] == [GUIDED, FBWA, GUIDED]


def test_a_stop_after_the_pilot_s_choice_changes_nothing() -> None:
    flight = Guided()
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    flight.mode = LOITER
    flight.run(0.3)
    flight.outbound()
    flight.onboard.stop()
    assert [m for m in flight.outbound() if m.get_type() == "COMMAND_LONG"] == []


def test_the_pilot_s_mode_ends_the_flight_and_is_not_changed() -> None:
    flight = Guided()
    flight.run(1.2)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert is_flying(flight.mode_now)
    asked = len(flight.asked)
    flight.mode = 11  # RTL
    flight.run(2.0)
    assert not is_flying(flight.mode_now)
    assert flight.mode == 11
    assert len(flight.asked) == asked


def flown_into_a_failsafe(flight: Guided) -> None:
    """Its short failsafe puts FBWA in the place of GUIDED, as ArduPlane's does."""
    flight.mode = 0  # MANUAL, from which it is engaged
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert is_flying(flight.mode_now)
    flight.mode, flight.status = FBWA, mavlink.MAV_STATE_CRITICAL
    flight.run(1.0)
    assert not is_flying(flight.mode_now)


def asked_modes(flight: Guided) -> list[float]:
    return [mode for _, mode, _ in flight.asked]


@SLOW_OR_FAST
def test_a_mode_that_a_failsafe_gives_back_is_left(quickens: bool) -> None:
    """ArduPlane restores GUIDED by itself where its radio is back; without a controller."""
    flight = Guided()
    flight.quickens = quickens
    flown_into_a_failsafe(flight)
    flight.mode, flight.status = GUIDED, mavlink.MAV_STATE_ACTIVE
    flight.run(2.4)
    assert flight.mode == FBWA  # and not MANUAL of before: whether a pilot is there is not known
    assert asked_modes(flight) == [GUIDED, FBWA]
    assert any("back in GUIDED" in text for text in flight.console)
    flight.mode = GUIDED  # later the pilot chooses it
    flight.run(3.0)
    assert asked_modes(flight) == [GUIDED, FBWA]


@pytest.mark.parametrize("silent_s", [1.0, 8.0, 30.0])
def test_a_mode_that_a_lost_link_kept_is_left_when_the_link_is_back(silent_s: float) -> None:
    """Setpoints have ended, and GUIDED would circle over the place where it was entered."""
    flight = Guided()
    flight.mode = FBWA
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    assert is_flying(flight.mode_now)
    never = flight.now_s + silent_s + 0.01
    flight._due = dict.fromkeys(flight._due, never)
    flight.enters = False  # nor does it take requests
    flight.run(silent_s)
    assert not is_flying(flight.mode_now)
    flight.enters = True
    flight.run(3.0)
    assert flight.mode == FBWA
    assert asked_modes(flight)[-1] == FBWA
    is_reported = any("still in GUIDED" in text for text in flight.console)
    assert is_reported == (silent_s > 5.0)


def test_a_mode_that_is_chosen_in_a_failsafe_or_after_it_stays() -> None:
    for others in (
        [(GUIDED, mavlink.MAV_STATE_CRITICAL)],  # no mode is restored while it lasts
        [(LOITER, mavlink.MAV_STATE_CRITICAL), (GUIDED, mavlink.MAV_STATE_ACTIVE)],
        [(FBWA, mavlink.MAV_STATE_ACTIVE), (GUIDED, mavlink.MAV_STATE_ACTIVE)],
    ):
        flight = Guided()
        flown_into_a_failsafe(flight)
        for mode, status in others:
            flight.mode, flight.status = mode, status
            flight.run(1.2)
        assert flight.mode == GUIDED
        assert asked_modes(flight) == [GUIDED]


def test_a_failsafe_that_keeps_the_mode_is_left_for_one_that_flies_alone() -> None:
    flight = Guided()
    flight.mode = 0  # MANUAL, whose sticks may be unattended now
    flight.run(1.6)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    flight.status = mavlink.MAV_STATE_CRITICAL
    flight.run(1.2)
    assert not is_flying(flight.mode_now)
    assert flight.mode == FBWA


def test_another_firmware_is_never_commanded() -> None:
    flight = Guided()
    flight.kind = PX4
    flight.mode = GUIDED
    flight.run(1.2)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(4.0)
    assert not is_flying(flight.mode_now)
    assert flight.asked == []
    assert any("not an ArduPilot" in text for text in flight.console)


def test_the_end_of_the_process_leaves_the_mode() -> None:
    flight = Guided()
    flight.run(1.2)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    flight.onboard.stop()
    messages = flight.outbound()
    assert "tgl_soar stopped" in texts(messages)
    assert [m.param2 for m in messages if m.get_type() == "COMMAND_LONG"] == [FBWA] * 5


def test_mavlink_has_the_numbers_that_are_used() -> None:
    assert mavlink.MAV_CMD_DO_SET_MODE == 176
    assert PX4[1] == mavlink.MAV_AUTOPILOT_PX4
    assert mavlink.MAV_AUTOPILOT_PPZ == 9
    assert mavlink.PLANE_MODE_GUIDED == GUIDED


def test_an_elevator_gain_that_nobody_flies_is_taken_and_said_not_to_be_judged() -> None:
    flight = Guided()
    flight.run(1.2)
    flight.set("ELE_D", 3.0)
    Flight.run(flight, 0.5)  # Guided's own takes the outbound messages
    words = "".join(texts(flight.outbound()))
    assert "no margin is judged: the autopilot's own loops hold the attitude" in words
    assert "ELE_D = 3" not in words  # as a refusal begins

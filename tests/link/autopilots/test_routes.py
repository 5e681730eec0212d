"""Each firmware by each of its routes: what it is told, when it obeys, who it must be."""

import struct
from itertools import pairwise
from math import inf, isfinite, nan, pi

import pytest

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.autopilots import FIRMWARES, flavour, routes
from tgl_soar.link.autopilots.base import Flavour, SurfaceChannel, SurfaceChannels, value_bytewise
from tgl_soar.link.autopilots.requirements import RELATIONS, Requirement, compare, remedy
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import (
    CommandLong,
    Heartbeat,
    ManualControl,
    ParamValue,
    RcChannelsOverride,
    SetActuatorControlTarget,
    SetAttitudeTarget,
    Source,
)
from tgl_soar.link.mode_change import ANSWER_S, PATIENCE_S, TRIES, ModeChange
from tgl_soar.types import NO_SETPOINTS, OURS, THEIRS_WITH_RUDDER, Setpoints, SurfaceCommand

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
ALL = [(firmware, route.name) for firmware in FIRMWARES for route in routes(firmware)]
AUTOPILOT = {"ardupilot": 3, "bridge": 3, "px4": 12, "paparazzi": 9}
GUIDED, FBWA, LOITER = 15, 5, 12
OFFBOARD, STABILIZED = 6 << 16, 7 << 16
UP = SurfaceCommand(0.5, -0.25, 1.0)
NOSE_UP = Setpoints(0.2, -0.1, 0.0)


def target(firmware: str, route: str | None = None) -> Flavour:
    return flavour(firmware, route, CHANNELS, 1)


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_whatever_is_asked_for_can_be_sent(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    encoder = Encoder(Source(1, 191))
    nan = float("nan")
    broken = SurfaceCommand(nan, float("inf"), nan)
    for surfaces in (UP, broken, SurfaceCommand(-7.0, 7.0, 7.0)):
        for message in (*pilot.commands(surfaces, NOSE_UP), *pilot.release()):
            assert encoder.encode(message)
    mode = pilot.route.mode_to_leave if pilot.route.mode_to_enter is None else 3
    assert encoder.encode(pilot.ask_for_mode(mode))


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_another_firmware_or_vehicle_is_no_match(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    for autopilot in (0, 3, 8, 9, 12):
        found = pilot.mismatch(
            Heartbeat(type=1, autopilot=autopilot, base_mode=81, custom_mode=0, system_status=4)
        )
        assert (found == "") == (autopilot == AUTOPILOT[firmware])
    assert "no fixed wing" in pilot.mismatch(
        Heartbeat(
            type=2, autopilot=AUTOPILOT[firmware], base_mode=81, custom_mode=0, system_status=4
        )
    )


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_a_route_that_is_entered_obeys_there(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    if pilot.route.mode_to_enter is not None:
        assert pilot.obeys(
            Heartbeat(
                type=1,
                autopilot=3,
                base_mode=81,
                custom_mode=pilot.route.mode_to_enter,
                system_status=4,
            )
        )
        assert not pilot.obeys(
            Heartbeat(
                type=1,
                autopilot=3,
                base_mode=81,
                custom_mode=pilot.route.mode_to_leave,
                system_status=4,
            )
        )
    assert not pilot.obeys(
        Heartbeat(
            type=1,
            autopilot=3,
            base_mode=0,
            custom_mode=pilot.route.mode_to_enter or 0,
            system_status=4,
        )
    )


def test_an_unknown_route_is_named_with_those_that_are() -> None:
    with pytest.raises(ValueError, match="attitude, manual_control, actuators"):
        target("px4", "override")


def test_arduplane_takes_the_yaw_of_an_attitude_for_its_rudder() -> None:
    (said,) = target("ardupilot", "attitude").commands(UP, NOSE_UP)
    assert isinstance(said, SetAttitudeTarget)
    roll, pitch, yaw = euler_from_quaternion(*said.q)
    assert (roll, pitch, yaw) == pytest.approx((-0.1, 0.2, pi / 4.0))
    assert said.type_mask == 0b01000111  # the attitude alone: no rates, no thrust
    assert target("ardupilot", "attitude").route.loops == THEIRS_WITH_RUDDER


def test_px4_s_attitude_is_level_in_yaw() -> None:
    (said,) = target("px4").commands(UP, NOSE_UP)
    assert isinstance(said, SetAttitudeTarget)
    assert euler_from_quaternion(*said.q) == pytest.approx((-0.1, 0.2, 0.0))


def test_px4_s_stick_is_pushed_to_lower_the_nose() -> None:
    (said,) = target("px4", "manual_control").commands(UP, NO_SETPOINTS)
    assert said == ManualControl(target=1, x=-500, y=-250, z=0, r=1000)


def test_px4_s_actuators_are_roll_pitch_yaw() -> None:
    (said,) = target("px4", "actuators").commands(UP, NO_SETPOINTS)
    assert isinstance(said, SetActuatorControlTarget)
    assert said.controls[:3] == (-0.25, 0.5, 1.0)


@pytest.mark.parametrize("fraction", [-1.0, -0.5, 0.0, 0.3, 1.0])
def test_paparazzi_s_eight_bits_have_the_sign_and_the_size_that_were_meant(fraction: float) -> None:
    (said,) = target("paparazzi").commands(
        SurfaceCommand(fraction, fraction, fraction), NO_SETPOINTS
    )
    assert isinstance(said, RcChannelsOverride)
    roll_us, pitch_us, throttle_us, yaw_us = said.channels[:4]
    # What its mavlink.c makes of them; its division truncates.
    roll = int(-(roll_us - 1500) * 255 / 1100 / 2)
    pitch = int(-(pitch_us - 1500) * 255 / 1100 / 2)
    yaw = int(-(yaw_us - 1500) * 255 / 1100)
    assert (roll, pitch, yaw) == pytest.approx((127 * fraction,) * 3, abs=1.0)
    assert (throttle_us - 950) * 127 // 1100 == 0
    assert target("paparazzi").release() == ()  # a 0 would be a full deflection


def test_paparazzi_obeys_with_manual_input_and_no_stabilisation() -> None:
    pilot = target("paparazzi")
    assert pilot.obeys(
        Heartbeat(type=1, autopilot=9, base_mode=1 | 64 | 128, custom_mode=0, system_status=4)
    )
    assert not pilot.obeys(
        Heartbeat(type=1, autopilot=9, base_mode=1 | 64 | 16, custom_mode=0, system_status=4)
    )  # AUTO1
    assert not pilot.obeys(
        Heartbeat(type=1, autopilot=9, base_mode=1 | 4, custom_mode=0, system_status=4)
    )  # AUTO2


@pytest.mark.parametrize(("value", "kind"), [(1, 6), (-7, 6), (255, 1), (2**31, 5), (-5, 2)])
def test_whole_numbers_sent_as_their_bytes(value: int, kind: int) -> None:
    raw = struct.unpack("<f", struct.pack("<i" if value < 0 else "<I", value))[0]
    assert (
        value_bytewise(
            ParamValue(param_id="X", param_value=raw, param_type=kind, param_count=1, param_index=0)
        )
        == value
    )
    assert (
        value_bytewise(
            ParamValue(param_id="X", param_value=2.5, param_type=9, param_count=1, param_index=0)
        )
        == 2.5
    )


# --- into the mode and out of it ---------------------------------------------------------------


def asked_mode(said: tuple[object, ...]) -> float | None:
    if not said:
        return None
    (request,) = said
    assert isinstance(request, CommandLong)
    assert request.command == 176
    return request.params[1]


class Beats:
    """A mode change, and the heartbeats that it looks at; polled at 100 Hz."""

    def __init__(self, change: ModeChange, *, mode: int, obeying: int, every_s: float) -> None:
        self.change = change
        self.mode, self.obeying, self.every_s = mode, obeying, every_s
        self.now_s = self.received_s = 10.0
        self.shown = mode
        self.asked: list[tuple[float, float | None]] = []  # when, and for what

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now_s = round(self.now_s + 0.01, 6)
            if self.now_s - self.received_s >= self.every_s - 1e-9:
                self.received_s, self.shown = self.now_s, self.mode
            obeys = self.shown == self.obeying
            said = self.change.poll(self.now_s, self.received_s, obeys, self.shown)
            if said:
                self.asked.append((self.now_s, asked_mode(said)))


def guided(every_s: float = 0.2) -> Beats:
    return Beats(
        ModeChange(target("ardupilot", "attitude")), mode=FBWA, obeying=GUIDED, every_s=every_s
    )


def test_the_mode_is_asked_for_after_a_heartbeat_and_once() -> None:
    beats = guided()
    beats.run(0.05)
    beats.change.enter(beats.now_s, beats.received_s, FBWA)
    beats.run(0.15)
    assert beats.asked == [(10.2, GUIDED)]
    assert beats.change.is_entering
    beats.mode = GUIDED
    beats.run(3.0)
    assert len(beats.asked) == 1
    assert not beats.change.is_changing
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(0.2)
    assert [mode for _, mode in beats.asked] == [GUIDED, FBWA]  # where it came from
    beats.mode = FBWA
    beats.run(3.0)
    assert len(beats.asked) == 2
    assert beats.change.failed == ""


@pytest.mark.parametrize("every_s", [0.2, 1.0])
def test_a_lost_request_is_repeated_after_a_heartbeat_that_answers_it(every_s: float) -> None:
    beats = guided(every_s)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(PATIENCE_S + 1.0)
    times = [time_s for time_s, _ in beats.asked]
    assert len(times) == TRIES
    assert all(later - earlier >= ANSWER_S for earlier, later in pairwise(times))
    beats_since = [(time_s - 10.0) / every_s for time_s in times]
    assert beats_since == pytest.approx([round(n) for n in beats_since])
    assert "does not enter GUIDED (asked 3 times)" in beats.change.failed
    assert not beats.change.is_changing


def test_without_heartbeats_nothing_is_asked_for() -> None:
    beats = guided(1e9)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(PATIENCE_S + 0.1)
    assert beats.asked == []
    assert "no heartbeat" in beats.change.failed


@pytest.mark.parametrize("when_s", [0.05, 0.3, 0.5, 0.9])
@pytest.mark.parametrize("every_s", [0.2, 1.0])
def test_the_pilot_s_choice_ends_the_asking(when_s: float, every_s: float) -> None:
    beats = guided(every_s)
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(when_s)
    before = list(beats.asked)
    beats.mode = LOITER
    beats.run(PATIENCE_S + 1.0)
    assert beats.asked == before
    assert "pilot has chosen another mode" in beats.change.failed


@pytest.mark.parametrize("every_s", [0.2, 1.0])
def test_the_pilot_s_choice_is_not_overwritten_on_the_way_out(every_s: float) -> None:
    beats = guided(every_s)
    beats.mode = beats.shown = GUIDED
    beats.change.leave(10.0, 10.0)
    beats.mode = LOITER  # chosen since the last heartbeat
    beats.run(PATIENCE_S + 1.0)
    assert beats.asked == []
    assert beats.change.failed == ""


def test_an_entry_that_was_withdrawn_is_left_when_it_comes_late() -> None:
    beats = guided()
    beats.change.enter(10.0, 10.0, FBWA)
    beats.run(0.2)
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(0.2)  # a heartbeat that cannot have heard of the request yet
    beats.mode = GUIDED
    beats.run(0.2)
    assert [mode for _, mode in beats.asked] == [GUIDED, FBWA]
    beats.mode = FBWA
    beats.run(3.0)
    assert len(beats.asked) == 2
    unasked = guided()
    unasked.change.enter(10.0, 10.0, FBWA)
    unasked.change.leave(10.1, 10.0)
    assert not unasked.change.is_changing


def test_the_last_word_leaves_our_mode_and_no_other() -> None:
    beats = guided()
    beats.change.enter(10.0, 10.0, FBWA)
    assert beats.change.parting(obeys=False) == ()  # nothing was asked for yet
    beats.run(0.2)
    assert asked_mode(beats.change.parting(obeys=False)) == FBWA  # it may be on its way
    beats.mode = GUIDED
    beats.run(0.2)
    assert asked_mode(beats.change.parting(obeys=True)) == FBWA
    assert beats.change.parting(obeys=False) == ()  # the pilot's


def test_the_mode_of_before_is_that_of_this_engagement() -> None:
    beats = guided()
    beats.change.enter(10.0, 10.0, 2)
    beats.mode = LOITER
    beats.run(1.0)
    beats.mode = beats.shown = GUIDED  # chosen by the pilot: nothing was entered
    beats.change.leave(beats.now_s, beats.received_s)
    beats.run(0.2)
    assert beats.asked[-1][1] == FBWA  # the route's own


def test_px4_s_modes_have_two_parts() -> None:
    change = ModeChange(target("px4"))
    change.enter(0.0, 0.0, 4 << 16 | 3 << 24)
    (request,) = change.poll(0.1, 0.1, False, 4 << 16 | 3 << 24)
    assert isinstance(request, CommandLong)
    assert request.params[:3] == (1.0, 6.0, 0.0)
    change.leave(1.0, 0.1)
    (back,) = change.poll(1.1, 1.1, True, OFFBOARD)
    assert isinstance(back, CommandLong)
    assert back.params[:3] == (1.0, 4.0, 3.0)


def test_a_mode_that_the_pilot_must_choose_is_never_asked_for() -> None:
    change = ModeChange(target("ardupilot"))
    change.enter(0.0, 0.0, FBWA)
    assert not change.is_entering
    assert change.poll(0.1, 0.1, False, FBWA) == ()
    assert change.parting() == ()


# --- what parameters must be -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("relation", "wanted", "good", "bad"),
    [
        ("is", 0.1, 0.10000000149, 0.2),
        ("is not", 0.0, 1.0, 0.0),
        ("at most", 0.5, 0.5, 3.0),
        ("at least", 250.0, 400.0, 50.0),
        ("has bit", 1.0, 34.0, 32.0),
        ("lacks bit", 1.0, 32.0, 34.0),
    ],
)
def test_a_requirement_holds_or_says_what_to_set(
    relation: str, wanted: float, good: float, bad: float
) -> None:
    row = Requirement(names=("NEW", "OLD"), relation=relation, wanted=wanted, why="because")
    (fine,), (wrong,), (silent,) = (
        compare((row,), answers) for answers in ({"OLD": good}, {"NEW": bad}, {"OTHER": 1.0})
    )
    assert fine.ok
    assert fine.name == "OLD"
    assert not wrong.ok
    assert "NEW" in remedy(wrong)
    assert silent.value is None
    assert not silent.ok
    assert compare((row._replace(missing_ok=True),), {})[0].ok


@pytest.mark.parametrize("relation", RELATIONS)
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_what_is_no_number_meets_no_requirement(relation: str, value: float) -> None:
    """An autopilot's parameter, or what somebody sends in its name, ends no flight."""
    row = Requirement(names=("X",), relation=relation, wanted=1.0, why="because")
    (found,) = compare((row,), {"X": value})
    assert not found.ok
    assert "X" in remedy(found)


def test_every_route_says_all_that_people_must_know() -> None:
    for firmware, name in ALL:
        route = target(firmware, name).route
        assert all(getattr(route, field) for field in ("message", "mode", "after_silence"))
        assert route.takeover
        assert isfinite(route.silence_s)
    assert all(routes(firmware)[0].name == target(firmware).route.name for firmware in FIRMWARES)
    assert all(any(r.loops == OURS for r in routes(firmware)) for firmware in FIRMWARES)

"""The check of the surfaces in numbers: its stops, its times, each tolerance on both sides."""

from __future__ import annotations

from math import isnan, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.autopilots.base import BrakeChannel, SurfaceChannel, SurfaceChannels
from tgl_soar.link.checks.surface_check import SIGHTS, Stop, SurfaceCheck, SurfaceFinding, finding
from tgl_soar.link.messages import Heartbeat, LocalPositionNed, RcChannelsOverride, ServoOutputRaw

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900, reversed=True),
    rudder=SurfaceChannel(channel=4, pwm_min=1000, pwm_trim=1450, pwm_max=2000),
)
MANUAL = Heartbeat(
    type=mavlink.MAV_TYPE_FIXED_WING,
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    base_mode=mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    custom_mode=0,
    system_status=mavlink.MAV_STATE_STANDBY,
)
ARMED = MANUAL._replace(base_mode=MANUAL.base_mode | mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
HOLD_S = 1.0


def check(*, armed_on_ground: bool = False) -> SurfaceCheck:
    pilot = flavour("ardupilot", "override", CHANNELS, 1)
    made = SurfaceCheck(CHANNELS, pilot, 0.5, HOLD_S, armed_on_ground=armed_on_ground)
    made.take(MANUAL, 100.0)
    return made


def outputs(**pulses: int) -> ServoOutputRaw:
    servos = [1500] * 8
    for name, pulse_us in pulses.items():
        servos[int(name[1:]) - 1] = pulse_us
    return ServoOutputRaw(time_usec=1, port=0, servos=tuple(servos))


def pulses(sent: Any) -> tuple[int, ...]:
    (message,) = sent
    assert isinstance(message, RcChannelsOverride)
    return tuple(message.channels[i] for i in (1, 0, 3))  # elevator, aileron, rudder


# --- stop by stop ---------------------------------------------------------------------------------


def test_each_surface_goes_one_way_the_other_and_back_and_a_person_reads_what_to_see() -> None:
    made, sent, sights = check(), [], []
    while not made.done:
        sent.append(pulses(made.step(100.0)))
        sights.append(made.sight)
        made.move_on()
    still = (1500, 1500, 1450)
    assert sent == [
        *(still, (1700, 1500, 1450), (1300, 1500, 1450), still),
        *(still, (1500, 1300, 1450), (1500, 1700, 1450), still),
        *(still, (1500, 1500, 1725), (1500, 1500, 1225), still),
    ]
    assert sights == [
        *("", SIGHTS["elevator", 1], SIGHTS["elevator", -1], ""),
        *("", SIGHTS["aileron", 1], SIGHTS["aileron", -1], ""),
        *("", SIGHTS["rudder", 1], SIGHTS["rudder", -1], ""),
    ]
    assert len(set(SIGHTS.values())) == 6
    assert (made.step(100.0), made.sight) == ((), "")
    assert [stop.expected_us for stop in made.stops[4:8]] == [1500, 1300, 1700, 1500]


@pytest.mark.parametrize(
    ("after_s", "read_after_s", "is_held"),
    [
        (0.9, 0.5, False),  # the servo has its time
        (1.1, 0.5, True),
        (1.1, 0.19, False),  # outputs of before it could go there
        (1.1, 0.21, True),
        (2.9, 0.19, False),
        (3.1, 0.19, True),  # two seconds more, then without
    ],
)
def test_a_stop_lasts_until_it_was_held_and_read_back_or_patience_ends(
    after_s: float, read_after_s: float, is_held: bool
) -> None:
    made = check()
    made.step(100.0)
    made.take(outputs(), 100.0 + read_after_s)
    assert made.held(100.0 + after_s) is is_held
    made.move_on()
    assert bool(made.stops[0].servos_us) is (read_after_s > 0.2)


def test_a_command_goes_out_twenty_times_a_second_and_with_each_stop_at_once() -> None:
    made = check()
    assert made.step(100.0)
    assert not made.step(100.04)
    assert made.step(100.06)
    assert not made.step(100.1)
    made.move_on()
    assert made.step(100.1)


# --- when nothing may be moved --------------------------------------------------------------------


def test_before_the_first_heartbeat_nothing_may_be_moved() -> None:
    pilot = flavour("ardupilot", "override", CHANNELS, 1)
    assert SurfaceCheck(CHANNELS, pilot, 0.5, 1.0).refusal(0.0) == "no heartbeat of the autopilot"


@pytest.mark.parametrize(("age_s", "is_received"), [(2.9, True), (3.1, False)])
def test_a_heartbeat_counts_for_three_seconds(age_s: float, is_received: bool) -> None:
    refusal = check().refusal(100.0 + age_s)
    assert refusal == ("" if is_received else "no heartbeat of the autopilot")


@pytest.mark.parametrize(
    ("velocity", "words"),
    [
        ((0.0, 0.0, 0.99), ""),
        ((0.6, 0.0, 0.7), ""),
        ((0.0, 0.0, -1.01), "the aircraft is armed and moves at 1.0 m/s"),
        ((0.0, 2.0, 0.0), "the aircraft is armed and moves at 2.0 m/s"),
        ((3.0, 4.0, 12.0), "the aircraft is armed and moves at 13.0 m/s"),
        (None, "the aircraft is armed, and no speed of it was received"),
    ],
)
def test_an_armed_aircraft_must_stand_still(
    velocity: tuple[float, float, float] | None, words: str
) -> None:
    made = check(armed_on_ground=True)
    made.take(ARMED, 100.0)
    if velocity is not None:
        vx, vy, vz = velocity
        made.take(LocalPositionNed(time_boot_ms=1, x=9, y=9, z=9, vx=vx, vy=vy, vz=vz), 100.0)
    assert made.refusal(100.0) == words


@pytest.mark.parametrize(("age_s", "words"), [
    (2.9, ""), (3.1, "the aircraft is armed, and no speed of it was received"),
])  # fmt: skip
def test_a_speed_counts_for_three_seconds(age_s: float, words: str) -> None:
    made = check(armed_on_ground=True)
    made.take(LocalPositionNed(time_boot_ms=1, x=9, y=9, z=9, vx=0, vy=0, vz=0), 100.0)
    made.take(ARMED, 100.0 + age_s)
    assert made.refusal(100.0 + age_s) == words


def test_armed_it_must_be_said_to_stand_on_the_ground_and_obey() -> None:
    made = check()
    made.take(ARMED, 100.0)
    assert "give --armed-on-ground" in made.refusal(100.0)
    made.take(MANUAL._replace(custom_mode=5), 100.0)
    assert made.refusal(100.0).endswith("the mode in which it obeys: put it into MANUAL")


# --- latencies ------------------------------------------------------------------------------------


def test_before_any_step_no_latency_is_known() -> None:
    made = check()
    assert all(map(isnan, made.latencies_s))
    made.step(100.0)
    made.take(outputs(_2=1900), 100.1)  # at neutral no motion is expected
    assert all(map(isnan, made.latencies_s))


@pytest.mark.parametrize(
    ("pulse_us", "is_shown"), [(1590, False), (1600, True), (1610, True), (0, False)]
)
def test_half_of_a_step_shows_it_once(pulse_us: int, is_shown: bool) -> None:
    """Of 200 us."""
    made = check()
    made.step(100.0)
    made.move_on()
    made.step(101.0)
    made.take(outputs(_2=pulse_us), 101.08)
    least_s, most_s = made.latencies_s
    if not is_shown:
        assert isnan(least_s)
        return
    assert least_s == most_s == pytest.approx(0.08)
    made.take(outputs(_2=1700), 101.5)
    assert made.latencies_s[1] == pytest.approx(0.08)


def test_each_step_there_and_back_has_its_latency_from_its_first_command() -> None:
    made = check()
    latencies = iter((0.1, 0.3, 0.2))
    for at, (begin_s, pulse_us) in enumerate(
        ((100.0, 1500), (110.0, 1700), (120.0, 1300), (130.0, 1500))
    ):
        made.step(begin_s)
        made.step(begin_s + 0.06)  # the same once more
        if at > 0:
            made.take(outputs(_2=pulse_us), begin_s + next(latencies))
        made.move_on()
    assert made.latencies_s == pytest.approx((0.1, 0.3))


def test_outputs_that_do_not_reach_so_far_show_nothing() -> None:
    made = check()
    made.step(100.0)
    made.move_on()
    made.step(101.0)
    made.take(ServoOutputRaw(time_usec=1, port=0, servos=(1700,)), 101.1)
    assert isnan(made.latencies_s[0])


# --- what is found --------------------------------------------------------------------------------


def found(
    trim: int = 1500, high: int = 1700, low: int = 1300, again: int | None = None, **other: int
) -> SurfaceFinding:
    """Of an elevator on output 2 that goes half of 400 us each way; the others: at high, low."""
    measured = (trim, high, low, trim if again is None else again)
    stops = []
    for i, (deflection, expected_us) in enumerate(((0, 1500), (1, 1700), (-1, 1300), (0, 1500))):
        servos = [1500, measured[i], 1500, 1500]
        servos[2] += other.get("third", 0) * (i == 1)
        stops.append(Stop("elevator", 0.5 * deflection, expected_us, tuple(servos)))
    return finding("elevator", CHANNELS.elevator, stops)


def test_as_in_the_file_there_is_no_fault_and_its_ends_are_reported() -> None:
    assert found() == SurfaceFinding(
        surface="elevator", faults=(), trim_us=1500, low_us=1300, high_us=1700
    )


@pytest.mark.parametrize(
    ("measured", "faults"),
    [
        ({"high": 1760}, []),
        ({"high": 1640}, []),
        ({"high": 1761}, ["travel to +: 1761 us, the file says 1700 us"]),
        ({"high": 1639}, ["travel to +: 1639 us, the file says 1700 us"]),
        ({"low": 1240}, []),
        ({"low": 1361}, ["travel to -: 1361 us, the file says 1300 us"]),
        ({"low": 1239}, ["travel to -: 1239 us, the file says 1300 us"]),
        ({"trim": 1525}, []),
        ({"trim": 1475}, []),
        ({"trim": 1526}, ["trim: 1526 us, the file says 1500 us"]),
        ({"trim": 1474}, ["trim: 1474 us, the file says 1500 us"]),
        ({"again": 1520}, []),
        ({"again": 1480}, []),
        ({"again": 1521}, ["does not come back: 1521 us, was 1500 us"]),
        ({"again": 1479}, ["does not come back: 1479 us, was 1500 us"]),
        ({"third": 19}, []),
        ({"third": -19}, []),
        ({"third": 20}, ["moves output 3 too: a mixer, or a channel used twice"]),
        ({"third": -20}, ["moves output 3 too: a mixer, or a channel used twice"]),
    ],
)
def test_each_difference_from_the_file_has_its_tolerance(
    measured: dict[str, int], faults: list[str]
) -> None:
    assert list(found(**measured).faults) == faults


@pytest.mark.parametrize(
    ("high", "low", "words"),
    [
        (1519, 1500, "output 2 does not move"),
        (1500, 1519, "output 2 does not move"),
        (1520, 1500, "travel to +: 1520 us"),
        (1300, 1700, "output 2 moves the other way than the file says"),
        (1500, 1520, "output 2 moves the other way than the file says"),
    ],
)
def test_less_than_twenty_microseconds_are_no_movement_and_a_sign_is_reported(
    high: int, low: int, words: str
) -> None:
    first = found(high=high, low=low).faults[0]
    assert first.startswith(words)
    assert ("change surfaces.elevator.reversed of" in first) is ("other way" in words)


@pytest.mark.parametrize("servos", [(), (1500,), (1500, 0, 1500)])
def test_an_output_that_is_not_there_or_not_driven_cannot_be_read_back(
    servos: tuple[int, ...],
) -> None:
    stops = [Stop("elevator", 0.0, 1500, (1500, 1500))] * 3 + [Stop("elevator", 0.0, 1500, servos)]
    each = finding("elevator", CHANNELS.elevator, stops)
    assert each.faults == ("output 2 cannot be read back: no SERVO_OUTPUT_RAW, or not driven",)
    assert all(isnan(us) for us in (each.trim_us, each.low_us, each.high_us))


def test_of_a_surface_that_was_not_at_all_stops_nothing_is_found() -> None:
    made = check()
    for count in range(1, 10):
        made.step(nan)
        made.move_on()
        assert [each.surface for each in made.findings()] == ["elevator", "aileron"][: count // 4]


def test_a_brake_beside_them_is_no_surface_that_is_tried() -> None:
    brake = SurfaceChannel(channel=6, pwm_min=1100, pwm_trim=1500, pwm_max=1900)
    channels = CHANNELS._replace(brake=BrakeChannel(brake))
    made = SurfaceCheck(channels, flavour("ardupilot", "override", channels, 1), 0.5, HOLD_S)
    while not made.done:
        made.step(100.0)
        made.move_on()
    assert [each.surface for each in made.findings()] == ["elevator", "aileron", "rudder"]


@pytest.mark.parametrize(
    ("turned", "is_moved", "words"),
    [
        (1, True, ""),
        (-1, True, "the right one: output 6 moves the other way than the file says"),
        (1, False, "the right one: output 6 does not move"),
    ],
)
def test_of_two_ailerons_both_are_compared(turned: int, is_moved: bool, words: str) -> None:
    right = SurfaceChannel(channel=6, pwm_min=1100, pwm_trim=1500, pwm_max=1900)
    channels = CHANNELS._replace(brake=BrakeChannel(right, 0.5))
    made = SurfaceCheck(channels, flavour("ardupilot", "override", channels, 1), 0.5, HOLD_S)
    now_s, servos = 100.0, [1500] * 16
    while not made.done:
        now_s += 0.1
        for message in made.step(now_s):
            sent = message.channels  # type: ignore[union-attr]
            for channel in (surface.channel for surface in channels.driven()):
                servos[channel - 1] = sent[channel - 1]
            servos[5] = 1500 + turned * is_moved * (sent[5] - 1500)
        made.take(ServoOutputRaw(0, 0, tuple(servos)), now_s)
        if made.held(now_s):
            made.move_on()
    faults = {each.surface: each.faults for each in made.findings()}
    assert faults["elevator"] == faults["rudder"] == ()
    assert len(faults["aileron"]) == bool(words)
    assert all(fault.startswith(words) for fault in faults["aileron"])

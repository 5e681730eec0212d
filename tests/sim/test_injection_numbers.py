"""Faults at work, number by number: what is late by how much, what a wrong sample has, where a bad
servo goes, when the autopilot sends heartbeats and reboots, and what the duplicate reports."""

from __future__ import annotations

from math import atan2, cos, isnan, pi, radians, sin
from random import Random
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tgl_soar.air.field import WindField
from tgl_soar.sim import injection as module
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.glide_test import EvenAir
from tgl_soar.sim.injection import (
    DirectLink,
    FaultChannel,
    Injection,
    Measured,
    of_duplicate,
)
from tgl_soar.types import (
    NO_AIRSPEED,
    NO_IMU,
    NO_RANGE,
    AirspeedSample,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    Inputs,
    PositionFix,
    RangeSample,
    SurfaceCommand,
    SurfacesSample,
)

NEUTRAL = SurfaceCommand(0.0, 0.0, 0.0, 0.0)
TRIM = SurfaceCommand(0.1, 0.0, 0.0, 0.0)


class Always(Random):
    """A draw that always falls the same way."""

    def __init__(self, value: float) -> None:
        super().__init__(1)
        self.value = value

    def random(self) -> float:
        return self.value

    def uniform(self, a: float, b: float) -> float:
        return a + self.value * (b - a)


def channel(*faults: str, draws: float = 0.5) -> FaultChannel[str]:
    made: FaultChannel[str] = FaultChannel(parse_faults(faults), "1")
    made._random = Always(draws)
    return made


# --- a way ----------------------------------------------------------------------------------------


def test_what_can_happen_on_a_way() -> None:
    assert module.MEASURED == ("position", "attitude", "imu", "airspeed", "rangefinder")
    assert module.BOTH_WAYS == ("delay", "jitter", "reorder", "duplicate", "loss", "corrupt")
    assert module.SURFACES == ("elevator", "aileron", "rudder", "brake")
    assert (module.HEARTBEAT_S, module.OVERRIDE_TIME_S) == (1.0, 0.5)


@pytest.mark.parametrize("way", ["position.dropout", "link.down", "link.up", "autopilot.reboot"])
def test_nothing_passes_a_silent_way(way: str) -> None:
    made = channel(f"{way} start=1 for=1")
    for now in (0.999, 1.0, 1.999, 2.0):
        made.send(now, f"{now}")
    assert made.arrived(9.0) == ["0.999", "2.0"]


def test_delays_add_up_and_keep_the_order() -> None:
    made = channel("link.delay start=0 for=1 by=0.5", "link.jitter start=0 for=1 by=0.2")
    made.send(0.9, "a")
    made.send(1.0, "b")  # nothing acts any more, but a was sent before
    assert made.arrived(1.4999) == []
    assert made.arrived(1.5) == ["a", "b"]
    assert made.arrived(9.0) == []
    made.send(2.0, "c")
    assert made.arrived(2.0) == ["c"]


@pytest.mark.parametrize(("draws", "lost"), [(0.29, True), (0.31, False)])
def test_a_fraction_is_of_all_that_passes(draws: float, lost: bool) -> None:
    made = channel("link.loss start=0 for=1 fraction=0.3", draws=draws)
    made.send(0.0, "a")
    assert made.arrived(9.0) == ([] if lost else ["a"])


def test_one_that_is_overtaken_holds_up_no_other() -> None:
    made = channel("link.reorder start=0 for=1 fraction=1 by=0.3")
    made.send(0.9, "a")
    made.send(1.0, "b")
    assert made.arrived(1.1) == ["b"]
    assert made.arrived(1.19) == []
    assert made.arrived(1.2) == ["a"]


def test_one_that_comes_twice_comes_so_much_later_again() -> None:
    made = channel(
        "link.duplicate start=0 for=1 fraction=1 by=0.2", "link.delay start=0 for=1 by=0.1"
    )
    made.send(0.0, "a")
    assert made.arrived(0.1) == ["a"]
    assert made.arrived(0.29) == []
    assert made.arrived(0.31) == ["a"]


def test_what_arrives_at_once_keeps_its_order() -> None:
    made = channel("link.delay start=0 for=1 by=0.5")
    for word in ("c", "a", "b"):
        made.send(0.0, word)
    assert made.arrived(1.0) == ["c", "a", "b"]


def test_what_is_corrupted_beyond_use_is_refused_and_else_goes_on() -> None:
    refused = channel("link.corrupt start=0 for=1 fraction=1")
    refused.send(0.0, "a")
    assert refused.arrived(9.0) == []
    turned: FaultChannel[str] = FaultChannel(
        parse_faults(["link.corrupt start=0 for=1 fraction=1"]), "1", lambda item, _: item.upper()
    )
    turned.send(0.0, "a")
    turned.send(1.0, "b")
    assert turned.arrived(9.0) == ["A", "b"]


def test_faults_of_other_kinds_do_not_hold_it_up() -> None:
    made = channel("position.freeze start=0 for=1", "autopilot.second start=0 for=1")
    made.send(0.5, "a")
    assert made.arrived(0.5) == ["a"]


def test_one_to_eight_bits_of_a_datagram_are_turned() -> None:
    """Over 400 datagrams all eight numbers and all bits are met; a bit turned twice is turned
    back."""
    wire = Injection(parse_faults(["link.corrupt start=0 for=999 fraction=1"])).wire("up")
    assert wire is not None
    for _ in range(400):
        wire.send(0.0, (3, bytes(50)))
    wire.send(0.0, (4, b""))
    *found, (link, empty) = wire.arrived(0.0)
    assert (link, empty) == (4, b"")
    counts = [sum(byte.bit_count() for byte in data) for _, data in found]
    assert {*counts} >= set(range(1, 9)) or {*counts} >= set(range(1, 8))
    assert max(counts) <= 8
    assert {byte for _, data in found for byte in data} >= {1 << i for i in range(8)}
    assert {i for _, data in found for i, byte in enumerate(data) if byte} == set(range(50))


# --- a sample -------------------------------------------------------------------------------------


def fix(sequence: int, time_s: float = 0.0) -> PositionFix:
    return PositionFix(
        sequence=sequence,
        time_s=time_s,
        north_m=10.0 * sequence,
        east_m=20.0,
        down_m=30.0,
        velocity_north_mps=1.0,
        velocity_east_mps=2.0,
        velocity_down_mps=3.0,
        source=4,
        sigma_m=0.5,
        reckoned=False,
    )


def attitude(sequence: int = 1, turn: Any = (0.3, -0.2, 0.1)) -> AttitudeSample:
    qx, qy, qz, qw = Rotation.from_rotvec(turn).as_quat()
    return AttitudeSample(
        sequence=sequence,
        time_s=0.0,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        roll_rate_frd_radps=0.1,
        pitch_rate_frd_radps=0.2,
        yaw_rate_frd_radps=0.3,
    )


def imu(sequence: int = 1) -> ImuSample:
    return ImuSample(
        sequence=sequence,
        time_s=0.0,
        force_x_frd_mps2=1.0,
        force_y_frd_mps2=2.0,
        force_z_frd_mps2=3.0,
        roll_rate_frd_radps=4.0,
        pitch_rate_frd_radps=5.0,
        yaw_rate_frd_radps=6.0,
    )


def injected(text: str, sample: Any, now_s: float = 0.0) -> Any:
    of = text.partition(".")[0]
    return Injection(parse_faults([text])).sample(of, now_s, sample)


def test_a_biased_position_is_off_on_each_axis() -> None:
    found = injected("position.bias start=0 for=1 north=1 east=2 down=3", fix(1))
    assert found == fix(1)._replace(north_m=11.0, east_m=22.0, down_m=33.0)


def test_a_biased_attitude_is_turned_about_its_own_axes() -> None:
    found = injected("attitude.bias start=0 for=1 roll=10 pitch=20 heading=30", attitude())
    by = Rotation.from_euler("ZYX", [30.0, 20.0, 10.0], degrees=True)
    expected = Rotation.from_rotvec((0.3, -0.2, 0.1)) * by
    turned = Rotation.from_quat([found.qx, found.qy, found.qz, found.qw])
    assert (turned * expected.inv()).magnitude() == pytest.approx(0.0, abs=1e-7)
    assert found[6:] == attitude()[6:]


def test_biased_accelerations_are_off_on_each_axis_and_rates_are_not() -> None:
    found = injected("imu.bias start=0 for=1 x=0.5 y=-0.5 z=0.25", imu())
    assert found[2:] == (1.5, 1.5, 3.25, 4.0, 5.0, 6.0)


@pytest.mark.parametrize(("by", "reads"), [(1.5, 6.5), (-2.0, 3.0), (-6.0, 0.0)])
def test_a_biased_speed_or_distance_is_not_below_0(by: float, reads: float) -> None:
    speed = injected(f"airspeed.bias start=0 for=1 ahead={by}", AirspeedSample(1, 0.0, 5.0))
    assert speed == (1, 0.0, reads)
    distance = injected(f"rangefinder.bias start=0 for=1 away={by}", RangeSample(1, 0.0, 5.0))
    assert distance == (1, 0.0, reads)


def test_noise_is_of_each_axis_its_own() -> None:
    injection = Injection(parse_faults(["position.noise start=0 for=9 sigma=2"]))
    errors = np.array(
        [
            np.subtract(injection.sample("position", 0.0, fix(i))[2:5], fix(i)[2:5])
            for i in range(1, 2001)
        ]
    )
    assert np.std(errors, axis=0) == pytest.approx([2.0] * 3, rel=0.08)
    assert np.mean(errors, axis=0) == pytest.approx([0.0] * 3, abs=0.2)
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 0.1


def test_where_numbers_are_lost_stamps_source_and_kind_stay() -> None:
    found = injected("position.nan start=0 for=1 fraction=1", fix(1, 0.25))
    assert (found.sequence, found.time_s, found.source, found.reckoned) == (1, 0.25, 4, False)
    assert all(isnan(value) for value in (*found[2:8], found.sigma_m))
    assert injected("position.nan start=0 for=1 fraction=0", fix(1)) == fix(1)


def test_a_dead_reckoned_position_drifts_by_half_the_error_times_the_square_of_the_time() -> None:
    text = "position.reckoned start=10 for=20 north=0.2 east=-0.4 reported=5"
    for now_s, says in ((12.0, False), (14.99, False), (15.0, True), (20.0, True)):
        found = injected(text, fix(1), now_s)
        t = now_s - 10.0
        assert found.north_m - 10.0 == pytest.approx(0.1 * t * t)
        assert found.east_m - 20.0 == pytest.approx(-0.2 * t * t)
        assert found.velocity_north_mps - 1.0 == pytest.approx(0.2 * t)
        assert found.velocity_east_mps - 2.0 == pytest.approx(-0.4 * t)
        assert found.reckoned == says
        assert found.down_m == 30.0
    assert injected(text, fix(1), 9.99) == fix(1)
    assert injected(text, fix(1), 30.0) == fix(1)


def test_what_is_frozen_is_the_first_sample_of_the_time_that_it_lasts() -> None:
    injection = Injection(
        parse_faults(["position.freeze start=1 for=1", "position.freeze start=3 for=1"])
    )
    north = [
        injection.sample("position", now, fix(i, now)).north_m
        for i, now in enumerate((0.5, 1.0, 1.5, 2.0, 3.0, 3.5, 4.0), 1)
    ]
    assert north == [10.0, 20.0, 20.0, 40.0, 50.0, 50.0, 70.0]


def test_a_number_counts_what_has_arrived() -> None:
    measured: Measured[PositionFix] = Measured(
        "position", parse_faults(["position.dropout start=1 for=1"]), 1
    )
    found = [
        measured.take(now, fix(i, now)).sequence
        for i, now in enumerate((0.0, 0.5, 1.0, 1.5, 2.0, 2.5), 1)
    ]
    assert found == [1, 2, 2, 2, 3, 4]
    assert measured.take(2.6, fix(6, 2.5)).sequence == 4  # it is the same sample
    assert measured.take(2.7, fix(6, 2.5)).time_s == 2.5


def test_before_anything_has_arrived_the_number_is_0() -> None:
    measured: Measured[PositionFix] = Measured(
        "position", parse_faults(["position.dropout start=0 for=9"]), 1
    )
    assert measured.take(0.0, fix(7)).sequence == 0


# --- the duplicate --------------------------------------------------------------------------------


def test_the_duplicate_stands_five_metres_away_and_is_turned() -> None:
    assert of_duplicate(fix(1))[2:5] == (13.0, 24.0, 30.0)
    found = of_duplicate(attitude(turn=(0.0, 0.0, 0.0)))
    assert 2.0 * atan2(found.qz, found.qw) == pytest.approx(1.2)
    assert of_duplicate(imu()) == imu()


def test_both_are_received_while_there_is_a_second_autopilot() -> None:
    measured: Measured[PositionFix] = Measured(
        "link position", parse_faults(["autopilot.second start=1 for=1"]), 1
    )
    found = [measured.take(now, fix(i)) for i, now in enumerate((0.5, 1.0, 2.0), 1)]
    assert [each.sequence for each in found] == [1, 3, 4]
    assert [each.north_m for each in found] == [10.0, 23.0, 30.0]


# --- servos ---------------------------------------------------------------------------------------


def test_without_a_fault_of_a_servo_the_surfaces_go_where_they_are_commanded() -> None:
    command = SurfaceCommand(0.1, 0.2, 0.3, 0.4)
    assert Injection().surfaces(0.0, command, 0.01) == command


@pytest.mark.parametrize("surface", ["elevator", "aileron", "rudder", "brake"])
def test_a_stuck_surface_stays_where_it_was_and_a_slow_one_goes_at_its_rate(surface: str) -> None:
    half = {"elevator": 0.5, "aileron": 0.5, "rudder": 0.5, "brake": 0.5}
    for fault, moved in ((f"{surface}.stuck start=1 for=1", 0.0), (f"{surface}.slow start=1", 0.2)):
        words = fault if "stuck" in fault else f"{fault} for=1 rate=2"
        injection = Injection(parse_faults([words]))
        assert injection.surfaces(0.9, NEUTRAL, 0.1) == NEUTRAL
        for i, sign in ((1, 1.0), (2, 1.0), (3, -1.0)):
            wanted = SurfaceCommand(**{**half, surface: sign})
            found = injection.surfaces(1.0 + 0.1 * i, wanted, 0.1)
            stands = moved * (i if i < 3 else 1)
            assert found == pytest.approx(SurfaceCommand(**{**half, surface: stands}))
        assert injection.surfaces(2.0, SurfaceCommand(1.0, 1.0, 1.0, 1.0), 0.1) == (1.0,) * 4


def test_half_a_brake_that_stays_moves_by_half_and_rolls_by_the_difference() -> None:
    injection = Injection(parse_faults(["brake.one_side start=1 for=1 roll=0.5"]))
    injection.surfaces(0.9, SurfaceCommand(0.0, 0.0, 0.0, 0.2), 0.1)
    for brake in (0.6, 1.0, 0.0):
        found = injection.surfaces(1.0, SurfaceCommand(0.1, 0.3, 0.2, brake), 0.1)
        assert found.brake == pytest.approx(0.2 + 0.5 * (brake - 0.2))
        assert found.aileron == pytest.approx(0.3 + 0.5 * (brake - 0.2))
        assert (found.elevator, found.rudder) == (0.1, 0.2)
    for aileron, stops in ((0.9, 1.0), (-1.0, -0.6)):
        found = injection.surfaces(1.0, SurfaceCommand(0.0, aileron, 0.0, 1.0), 0.1)
        assert found.aileron == pytest.approx(stops)
    full = Injection(parse_faults(["brake.one_side start=0 for=1 roll=-2"]))
    assert full.surfaces(0.0, SurfaceCommand(0.0, 0.0, 0.0, 1.0), 0.1).aileron == -1.0


# --- when and where -------------------------------------------------------------------------------


def test_each_turn_is_reported_once() -> None:
    injection = Injection(parse_faults(["link.up start=1 for=1", "link.down start=1 for=2"]))
    first, second = injection.faults
    reported = [injection.turns(now) for now in (0.0, 1.0, 1.5, 2.0, 3.0, 4.0)]
    assert reported == [
        [],
        [(first, True), (second, True)],
        [],
        [(first, False)],
        [(second, False)],
        [],
    ]


def test_a_fault_that_is_over_before_anybody_looks_is_reported_whole() -> None:
    injection = Injection(parse_faults(["link.up start=1 for=0.001"]))
    assert [begins for _, begins in injection.turns(5.0)] == [True, False]


def test_faults_of_the_link_are_of_one_direction_or_of_both() -> None:
    texts = ["link.up", "link.down", "link.loss", "position.loss", "link.corrupt", "link.delay"]
    injection = Injection(parse_faults(texts), 5)
    for silence in ("up", "down"):
        names = [fault.kind.name for fault in injection.of_link(silence)]
        assert names == sorted(
            [f"link.{silence}", "link.loss", "link.corrupt", "link.delay"],
            key=lambda name: texts.index(name),
        )
    assert Injection(parse_faults(["link.up"])).wire("down") is None
    assert Injection(parse_faults(["link.up"])).wire("up") is not None
    assert injection.seed == 5
    assert Injection().seed == 1
    assert [fault.kind.name for fault in injection.named("link.loss")] == ["link.loss"]


def test_faults_of_all_measurements_act_on_each() -> None:
    injection = Injection(parse_faults(["all.dropout start=0 for=9"]))
    assert injection.sample("position", 1.0, fix(1)).sequence == 0
    assert injection.sample("imu", 1.0, imu()).sequence == 0
    assert injection.sample("attitude", 1.0, attitude()).sequence == 0
    assert injection.sample("surfaces", 1.0, fix(1)) == fix(1)
    assert Injection(parse_faults(["imu.dropout"])).sample("position", 11.0, fix(1)) == fix(1)


def winds(field: WindField, *times_s: float) -> list[tuple[float, float, float]]:
    return [field.wind_at(0.0, 0.0, 1.0, time_s) for time_s in times_s]


def test_a_gust_is_half_of_one_less_the_cosine_in_all_of_the_air() -> None:
    text = "air.gust start=2 for=4 along=3 across=1 up=-2"
    field = Injection(parse_faults([text])).field(EvenAir(8.0))
    for t in (0.0, 1.0, 2.0, 3.0, 4.0):
        shape = 0.5 * (1.0 - cos(2.0 * pi * t / 4.0))
        [wind] = winds(field, 2.0 + t)
        assert wind == pytest.approx((8.0 + 3.0 * shape, shape, -2.0 * shape))
    assert winds(field, 1.9, 6.1) == [(8.0, 0.0, 0.0)] * 2


def test_the_wind_falls_over_a_time_stays_and_rises_over_as_much() -> None:
    field = Injection(parse_faults(["air.stop start=2 for=5 to=0.25 over=2"])).field(EvenAir(8.0))
    speeds = [u for u, _, _ in winds(field, 0.0, 2.0, 3.0, 4.0, 6.9, 7.0, 8.001, 9.01, 20.0)]
    assert speeds == pytest.approx([8.0, 8.0, 5.0, 2.0, 2.0, 2.0, 5.0, 8.0, 8.0], abs=0.01)
    short = Injection(parse_faults(["air.stop start=2 for=1 to=0 over=2"])).field(EvenAir(8.0))
    speeds = [u for u, _, _ in winds(short, 3.0, 4.0, 5.001, 6.01)]
    assert speeds == pytest.approx([4.0, 0.0, 4.0, 8.0], abs=0.01)


def test_the_air_without_faults_is_the_same_object() -> None:
    air = EvenAir(8.0)
    assert Injection(parse_faults(["link.up"])).field(air) is air


# --- one process ----------------------------------------------------------------------------------


def inputs(now_s: float, *, armed: bool = True, surfaces: int = 0) -> Inputs:
    return Inputs(
        time_s=now_s,
        position=fix(1),
        attitude=attitude(),
        autopilot=AutopilotStatus(time_s=now_s, accepts_surfaces=True, armed=armed),
        engage=False,
        imu=NO_IMU,
        airspeed=NO_AIRSPEED,
        surfaces=SurfacesSample(
            sequence=surfaces, time_s=now_s, elevator=0.9, aileron=0.9, rudder=0.9, brake=0.9
        ),
        rangefinder=NO_RANGE,
    )


def direct(*faults: str) -> DirectLink:
    return DirectLink(Injection(parse_faults(faults)), TRIM)


def beats(link: DirectLink, *times_s: float, **status: bool) -> list[float]:
    return [link.inputs(inputs(now, **status)).autopilot.time_s for now in times_s]


def test_the_autopilot_beats_once_a_second_and_when_its_status_changes() -> None:
    link = direct()
    assert beats(link, 0.0, 0.5, 0.99, 1.0, 1.5) == [0.0, 0.0, 0.0, 1.0, 1.0]
    assert beats(link, 1.6, armed=False) == [1.6]
    assert beats(link, 1.7, armed=False) == [1.6]
    assert beats(link, 1.8) == [1.8]


def test_before_the_first_beat_the_autopilot_is_not_known() -> None:
    silent = direct("link.down start=0 for=9").inputs(inputs(0.0)).autopilot
    assert isnan(silent.time_s)
    assert not silent.accepts_surfaces
    assert not silent.armed


def test_a_command_stands_for_half_a_second_and_then_it_obeys_nobody() -> None:
    link = direct()
    command = SurfaceCommand(0.5, 0.0, 0.0, 0.0)
    assert link.surfaces(0.0, None) == TRIM
    assert link.surfaces(0.1, command) == command
    assert link.surfaces(0.59, None) == command
    assert link.surfaces(0.61, None) == TRIM
    assert link.surfaces(0.7, command) == TRIM  # it is in a mode of its own
    assert not link.inputs(inputs(0.7)).autopilot.accepts_surfaces


def test_the_pilot_who_takes_it_has_it_while_they_do() -> None:
    link = direct("pilot.takes start=1 for=1")
    command = SurfaceCommand(0.5, 0.0, 0.0, 0.0)
    taken = [link.surfaces(now, command) == TRIM for now in (0.9, 1.0, 1.3, 1.6, 1.9, 2.0, 2.1)]
    assert taken == [False, True, True, True, True, False, False]
    status = [link.inputs(inputs(now)).autopilot.accepts_surfaces for now in (0.5, 1.0, 1.9, 2.0)]
    assert status == [True, False, False, True]


def test_a_reboot_forgets_the_command_and_counts() -> None:
    link = direct("autopilot.reboot start=1 for=1")
    command = SurfaceCommand(0.5, 0.0, 0.0, 0.0)
    assert link.inputs(inputs(0.9)).autopilot.boots == 0
    assert link.surfaces(0.9, command) == command
    assert link.surfaces(1.0, command) == TRIM
    assert link.inputs(inputs(1.5)).autopilot.time_s == 0.9  # silence
    assert link.surfaces(1.9, command) == TRIM
    status = link.inputs(inputs(2.0)).autopilot
    assert (status.boots, status.accepts_surfaces, status.time_s) == (1, True, 2.0)
    assert link.surfaces(2.1, command) == command


@pytest.mark.parametrize(
    "fault",
    ["link.up start=1 for=9", "pilot.takes start=1 for=9", "autopilot.reboot start=1 for=9"],
)
def test_the_throttle_takes_the_way_of_the_surfaces(fault: str) -> None:
    link = direct(fault)
    command = SurfaceCommand(0.5, 0.0, 0.0, 0.0)
    assert link.throttle == 0.0
    link.surfaces(0.0, command, 0.75)
    assert link.throttle == 0.75
    for now in (1.0, 1.7):
        link.surfaces(now, command, 1.0)
    assert link.throttle == 0.0


def test_a_late_throttle_stands_until_it_comes_and_with_its_command() -> None:
    link = direct("link.delay start=0 for=9 by=0.2")
    command = SurfaceCommand(0.5, 0.0, 0.0, 0.0)
    link.surfaces(0.0, command, 0.75)
    assert link.throttle == 0.0
    link.surfaces(0.2, None)
    assert link.throttle == 0.75
    link.surfaces(0.71, None)  # it was not repeated
    assert link.throttle == 0.0


def test_what_is_read_back_is_what_was_commanded() -> None:
    link = direct()
    command = SurfaceCommand(0.5, 0.25, -0.5, 0.125)
    link.surfaces(0.0, command)
    assert link.inputs(inputs(0.0, surfaces=3)).surfaces[2:] == command
    assert link.inputs(inputs(0.0, surfaces=0)).surfaces[2:] == (0.9,) * 4


def test_a_link_that_is_down_brings_no_sample_and_one_that_is_up_no_command() -> None:
    link = direct("link.down start=1 for=1")
    assert link.inputs(inputs(0.0)).position.sequence == 1
    received = link.inputs(inputs(1.0)._replace(position=fix(2)))
    assert received.position.sequence == 1
    command = SurfaceCommand(0.5, 0.0, 0.0, 0.0)
    assert link.surfaces(1.0, command) == command
    deaf = direct("link.up start=1 for=1")
    assert deaf.surfaces(1.0, command) == TRIM
    assert deaf.inputs(inputs(1.0)._replace(position=fix(2))).position == fix(2)


def test_angles_are_given_in_degrees() -> None:
    found = injected(
        "attitude.bias start=0 for=1 roll=0 heading=90", attitude(turn=(0.0, 0.0, 0.0))
    )
    assert (found.qw, found.qz) == pytest.approx((cos(radians(45)), sin(radians(45))))

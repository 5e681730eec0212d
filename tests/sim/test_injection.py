"""Faults at work: on anything that passes, on samples, servos and the air, in one process."""

from __future__ import annotations

from itertools import pairwise
from math import degrees, hypot, isnan
from random import Random
from typing import Any

import pytest
from samples import attitude_sample

from tgl_soar.air.hill import HillField
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.geometry import euler_from_quaternion, quaternion_from_euler
from tgl_soar.sim.closed_loop import ClosedLoop, fly
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.injection import DirectLink, FaultChannel, Injection, Measured
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors
from tgl_soar.sim.world import make_world
from tgl_soar.types import (
    NAN,
    AttitudeSample,
    AutopilotStatus,
    Inputs,
    PositionFix,
    SurfaceCommand,
)

DT = 0.01
AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
ALL_SENSORS = Sensors(imu=MEMS_IMU, airspeed=PITOT, surfaces=READ_BACK)


def passed(*faults: str, count: int = 300, seed: str = "1") -> list[tuple[float, int]]:
    """(arrival, item) of items 0, 1, 2 … sent every 10 ms."""
    channel: FaultChannel[int] = FaultChannel([parse_fault(text) for text in faults], seed)
    arrivals = []
    for i in range(count + 100):
        now = i * DT
        if i < count:
            channel.send(now, i)
        arrivals += [(now, item) for item in channel.arrived(now)]
    return arrivals


# --- what passes -------------------------------------------------------------------------------


def test_without_a_fault_all_passes_at_once() -> None:
    assert passed() == [(i * DT, i) for i in range(300)]


def test_nothing_passes_a_dropout_and_all_before_and_after() -> None:
    items = [item for _, item in passed("position.dropout start=1 for=0.5")]
    assert items == [*range(100), *range(150, 300)]


def test_a_delay_is_kept_to_the_step_and_keeps_the_order() -> None:
    arrivals = passed("position.delay start=1 for=1 by=0.055")
    assert [item for _, item in arrivals] == list(range(300))
    late = {item: arrival - item * DT for arrival, item in arrivals}
    assert late[99] == 0.0
    assert late[150] == pytest.approx(0.06)  # the first step that is not before it
    assert late[250] == 0.0


def test_jitter_delays_each_by_another_time_up_to_its_bound() -> None:
    late = [arrival - item * DT for arrival, item in passed("link.jitter start=0 for=9 by=0.05")]
    assert 0.0 <= min(late) < 0.01
    assert 0.03 < max(late) <= 0.05 + DT


def test_reordering_lets_later_ones_overtake_and_loses_none() -> None:
    items = [item for _, item in passed("link.reorder start=0 for=9 fraction=0.3 by=0.03")]
    assert sorted(items) == list(range(300))
    assert items != sorted(items)


def test_duplicates_come_twice_and_in_the_fraction_asked_for() -> None:
    items = [item for _, item in passed("link.duplicate start=0 for=9 fraction=0.3 by=0.02")]
    assert set(items) == set(range(300))
    # 300 draws of 0.3: three standard deviations are 24.
    assert len(items) - 300 == pytest.approx(90, abs=24)


def test_loss_takes_the_fraction_asked_for() -> None:
    items = [item for _, item in passed("link.loss start=0 for=9 fraction=0.3")]
    assert len(set(items)) == len(items) == pytest.approx(210, abs=24)


def test_the_same_seed_gives_the_same_faults_and_another_does_not() -> None:
    loss = "link.loss start=0 for=9 fraction=0.5"
    assert passed(loss) == passed(loss)
    assert passed(loss) != passed(loss, seed="2")


def test_datagrams_keep_their_length_where_bits_are_turned() -> None:
    injection = Injection([parse_fault("link.corrupt start=0 for=9 fraction=1")])
    wire = injection.wire("down")
    assert wire is not None
    wire.send(0.0, (7, bytes(40)))
    [(link, data)] = wire.arrived(0.0)
    assert link == 7
    assert len(data) == 40
    assert 1 <= sum(byte.bit_count() for byte in data) <= 8


# --- what is measured --------------------------------------------------------------------------


def fix(sequence: int) -> PositionFix:
    return PositionFix(
        sequence=sequence,
        time_s=sequence * DT,
        north_m=1.0 * sequence,
        east_m=2.0,
        down_m=-3.0,
        velocity_north_mps=0.1,
        velocity_east_mps=0.2,
        velocity_down_mps=0.3,
    )


def level(sequence: int) -> AttitudeSample:
    return attitude_sample(sequence, sequence * DT, quaternion_from_euler(0.1, 0.2, 0.3))


def positions(*faults: str, count: int = 50) -> list[PositionFix]:
    injection = Injection([parse_fault(text) for text in faults])
    return [injection.sample("position", i * DT, fix(i)) for i in range(1, count)]


def test_a_frozen_position_repeats_under_new_stamps() -> None:
    reported = positions("position.freeze start=0.095 for=0.2")
    assert [f.sequence for f in reported] == list(range(1, 50))
    assert [f.time_s for f in reported] == [fix(i).time_s for i in range(1, 50)]
    assert [f.north_m for f in reported[8:30]] == [9.0, *(20 * [10.0]), 30.0]


def test_a_position_that_freezes_again_stays_where_it_is_then() -> None:
    twice = ("position.freeze start=0.095 for=0.1", "position.freeze start=0.295 for=0.1")
    reported = [f.north_m for f in positions(*twice)]
    assert reported[9:19] == 10 * [10.0]
    assert reported[19:29] == [float(i) for i in range(20, 30)]
    assert reported[29:39] == 10 * [30.0]
    assert reported[39] == 40.0


def test_numbers_are_lost_and_stamps_go_on() -> None:
    reported = positions("position.nan start=0.095 for=0.2 fraction=1")
    lost = [f for f in reported if isnan(f.north_m)]
    assert len(lost) == 20
    assert all(isnan(f.velocity_down_mps) and f.time_s > 0.0 for f in lost)


def test_a_bias_is_added_in_the_units_that_it_is_given_in() -> None:
    [reported, *_] = positions("position.bias start=0 for=9 north=0.5 east=-0.25 down=1")
    assert reported[2:5] == (1.5, 1.75, -2.0)
    injection = Injection([parse_fault("attitude.bias start=0 for=9 roll=5 pitch=0 heading=0")])
    turned = injection.sample("attitude", 0.01, level(1))
    roll, pitch, _ = euler_from_quaternion(*turned[2:6])
    assert degrees(roll) == pytest.approx(degrees(0.1) + 5.0)
    assert degrees(pitch) == pytest.approx(degrees(0.2))


def test_a_dead_reckoned_position_drifts_away_says_so_late_and_comes_back() -> None:
    # At half steps: arithmetic decides no comparison.
    found = positions("position.reckoned start=0.095 for=0.3 north=8 east=-2 reported=0.2")
    for here in found:
        true, at_s = fix(here.sequence), here.sequence * DT
        lasted_s = at_s - 0.095 if 0.095 <= at_s < 0.395 else 0.0
        assert here.north_m - true.north_m == pytest.approx(4.0 * lasted_s**2)
        assert here.east_m - true.east_m == pytest.approx(-(lasted_s**2))
        north_mps = here.velocity_north_mps - true.velocity_north_mps
        assert north_mps == pytest.approx(8.0 * lasted_s)
        assert here.reckoned == (0.295 <= at_s < 0.395)


def test_noise_has_the_standard_deviation_asked_for() -> None:
    reported = positions("position.noise start=0 for=99 sigma=0.2", count=2000)
    errors = [f.east_m - 2.0 for f in reported]
    rms = hypot(*errors) / len(errors) ** 0.5
    assert rms == pytest.approx(0.2, rel=0.06)  # 2,000 draws: 3 σ are 5 %


def test_other_sensors_pass_as_they_are() -> None:
    injection = Injection([parse_fault("position.dropout start=0 for=9")])
    sample = level(3)
    assert injection.sample("attitude", 1.0, sample) is sample


def test_a_duplicate_is_an_old_stamp_under_a_new_number() -> None:
    reported = positions("position.duplicate start=0 for=9 fraction=1 by=0.005")
    again = [(a, b) for a, b in pairwise(reported) if b.time_s <= a.time_s]
    assert reported[-1].sequence > fix(49).sequence
    assert all(b.sequence > a.sequence for a, b in again)


# --- servos, air, autopilot --------------------------------------------------------------------


def test_a_stuck_surface_stays_and_the_others_move() -> None:
    injection = Injection([parse_fault("elevator.stuck start=1 for=1")])
    assert injection.surfaces(0.0, SurfaceCommand(0.3, 0.1, 0.0), DT)[:3] == (0.3, 0.1, 0.0)
    assert injection.surfaces(1.0, SurfaceCommand(0.9, -0.1, 0.5), DT)[:3] == (0.3, -0.1, 0.5)
    assert injection.surfaces(2.0, SurfaceCommand(0.9, -0.1, 0.5), DT)[:3] == (0.9, -0.1, 0.5)


def test_a_slow_surface_goes_at_its_rate() -> None:
    injection = Injection([parse_fault("rudder.slow start=0 for=9 rate=2")])
    gone = [injection.surfaces(i * DT, SurfaceCommand(0.0, 0.0, 1.0), DT).rudder for i in range(60)]
    assert gone[0] == pytest.approx(2 * DT)
    assert gone[24] == pytest.approx(0.5)
    assert gone[59] == 1.0


def test_gusts_and_lulls_are_in_the_air_and_nowhere_else() -> None:
    still = HillField(10.0, 50.0)
    injection = Injection(
        [
            parse_fault("air.gust start=1 for=2 along=1.5 up=0.5"),
            parse_fault("air.stop start=10 for=5 to=0.2 over=1"),
        ]
    )
    field = injection.field(still)
    place = (-60.0, 0.0, 40.0)
    u, _, w = still.wind_at(*place, 0.0)
    assert field.wind_at(*place, 2.0) == pytest.approx((u + 1.5, 0.0, w + 0.5))
    assert field.wind_at(*place, 12.0) == pytest.approx((0.2 * u, 0.0, 0.2 * w))
    assert field.wind_at(*place, 20.0) == pytest.approx((u, 0.0, w))


def status_of(faults: list[str], until_s: float, sends: bool = True) -> AutopilotStatus:
    """What the module has of the autopilot at a time, commanding all the while or not."""
    injection = Injection([parse_fault(text) for text in faults])
    link = DirectLink(injection, SurfaceCommand(0.0, 0.0, 0.0))
    received = AutopilotStatus(time_s=NAN, accepts_surfaces=False, armed=False)
    for i in range(round(until_s / DT) + 1):
        now = i * DT
        inputs = Inputs(
            time_s=now,
            position=fix(i),
            attitude=level(i),
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=True,
        )
        received = link.inputs(inputs).autopilot
        link.surfaces(now, SurfaceCommand(0.1, 0.0, 0.0) if sends else None)
    return received


def test_the_autopilot_beats_once_a_second() -> None:
    assert status_of(["position.loss"], 3.5) == AutopilotStatus(
        time_s=3.0, accepts_surfaces=True, armed=True, failsafe=False, boots=0
    )


def test_a_pilot_who_takes_the_aircraft_is_received_at_once() -> None:
    status = status_of(["pilot.takes start=2.5 for=9"], 2.6)
    assert not status.accepts_surfaces
    assert status.time_s == pytest.approx(2.5)


def test_a_rebooted_autopilot_is_silent_then_says_so() -> None:
    assert status_of(["autopilot.reboot start=2.5 for=1"], 3.4).time_s == 2.0
    after = status_of(["autopilot.reboot start=2.5 for=1"], 3.6)
    assert after.boots == 1
    assert after.time_s == pytest.approx(3.5)


def test_overrides_that_do_not_arrive_expire() -> None:
    assert status_of(["link.up start=2 for=0.4"], 2.9).accepts_surfaces
    assert not status_of(["link.up start=2 for=0.6"], 2.9).accepts_surfaces


def test_a_bad_servo_is_not_seen_in_what_is_read_back() -> None:
    injection = Injection([parse_fault("elevator.stuck start=0 for=9")])
    world = make_world(AIRFRAME, SITE, seed=1, sensors=ALL_SENSORS)
    loop = ClosedLoop(world, VALUES, injection)
    for _ in range(200):
        loop.tick()
    assert loop.output is not None
    assert loop.output.command.elevator != world.state.elevator
    link = loop._link
    assert link is not None
    inputs = link.inputs(
        Inputs(
            time_s=world.time_s,
            position=world.position,
            attitude=world.attitude,
            autopilot=AutopilotStatus(time_s=1.0, accepts_surfaces=True, armed=True),
            engage=True,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
        )
    )
    assert inputs.surfaces.elevator == loop.output.command.elevator


# --- whole flights -----------------------------------------------------------------------------


def flown(text: str | None, duration_s: float = 8.0, seed: int = 1) -> str:
    """How a flight with a fault ended; "" if it flew to the end."""
    injection = Injection([parse_fault(text)], seed) if text else None
    world = make_world(AIRFRAME, SITE, seed=seed, turbulence=0.01)
    if injection is not None:
        air = injection.field(world.field)
        world = make_world(AIRFRAME, SITE, seed=seed, turbulence=0.01, field=air)
    return fly(world, VALUES, [], duration_s, injection).ended


def test_a_gap_in_the_position_is_flown_through_and_one_in_the_attitude_is_not() -> None:
    assert flown("position.dropout start=4 for=0.5") == ""
    assert "attitude lost" in flown("attitude.dropout start=4 for=1")


def test_the_pilot_has_the_aircraft_when_they_want_it() -> None:
    assert flown("pilot.takes start=4 for=2").startswith("disengaged")


def test_one_half_of_a_brake_that_stays_halves_the_rest_and_rolls() -> None:
    injection = Injection([parse_fault("brake.one_side start=1 for=1 roll=0.2")])
    assert injection.surfaces(0.0, SurfaceCommand(0.1, 0.0, 0.0, 0.4), DT).brake == 0.4
    for _ in range(3):  # the half that is stuck stays where it was, however long
        went = injection.surfaces(1.0, SurfaceCommand(0.1, 0.0, 0.0, 1.0), DT)
        assert went == pytest.approx((0.1, 0.12, 0.0, 0.7))
    assert injection.surfaces(2.0, SurfaceCommand(0.1, 0.0, 0.0, 1.0), DT)[3] == 1.0


def test_a_brake_that_is_stuck_stays() -> None:
    injection = Injection([parse_fault("brake.stuck start=1 for=1")])
    injection.surfaces(0.0, SurfaceCommand(0.0, 0.0, 0.0, 0.4), DT)
    assert injection.surfaces(1.0, SurfaceCommand(0.0, 0.1, 0.0, 1.0), DT) == (0.0, 0.1, 0.0, 0.4)


@pytest.mark.parametrize("of", ["position", "attitude", "imu", "airspeed"])
def test_what_a_fault_draws_is_not_what_the_sensor_drew(of: str) -> None:
    """One stream for both tied a sensor's bias to which of its samples were lost."""
    lossy = parse_fault(f"{of}.loss start=0 for=9 fraction=0.5")
    channel = Measured[Any](of, (lossy,), 3)._fault_channel
    assert channel._random.random() != Random(f"3/{of}").random()

"""The two sets of gains, flown: with accelerations, without, and from one to the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from tgl_soar.autopilot import Output
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.world import World, build_field, make_world

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
HZ = 200
WITH_IMU = Sensors(imu=MEMS_IMU)
OF_THE_IMU = (
    *("RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU", "RHO_DF_IMU"),
    *("ELE_P_IMU", "ELE_I_IMU", "ELE_D_IMU"),
)


@lru_cache(maxsize=1)
def shipped_values() -> ParameterSet:
    airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
    values = load_parameters(airframe, AIRFRAME_PATH, site, SITE_PATH)
    return values.changed(line_parameters(site.lines["a"]))


def world(seed: int, turbulence: float, sensors: Sensors) -> World:
    airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
    assert site.air is not None
    return make_world(
        airframe,
        site,
        seed=seed,
        turbulence=turbulence,
        field=build_field(site.air),
        sensors=sensors,
    )


def ticks(loop: ClosedLoop, seconds: float) -> list[Output]:
    return [loop.tick() for _ in range(round(seconds * HZ))]


def rms_e_rho_m(outputs: list[Output]) -> float:
    return float(np.sqrt(np.mean([output.line.e_rho_m**2 for output in outputs])))


def pitch_setpoint_rad(output: Output) -> float:
    return output.setpoints.pitch_rad


def elevator(output: Output) -> float:
    return output.command.elevator


def largest_change(flight: list[Output], number: Callable[[Output], float]) -> float:
    """Of a number from one tick to the next."""
    return max(abs(number(after) - number(before)) for before, after in pairwise(flight))


def test_without_accelerations_the_other_gains_play_no_part() -> None:
    """Bit for bit, in 3 % turbulence: the same flight as with an airframe that has none."""
    values = shipped_values()
    assert all(values[name] > 0.0 for name in OF_THE_IMU)
    none = values.changed(dict.fromkeys(OF_THE_IMU, 0.0))
    flights = [ticks(ClosedLoop(world(3, 0.03, USUAL_SENSORS), v), 8.0) for v in (values, none)]
    assert flights[0][-1].active
    assert {output.imu_weight for output in flights[0]} == {0.0}
    commands = [[output.command for output in flight] for flight in flights]
    assert commands[0] == commands[1]


def test_with_accelerations_the_line_is_held_closer() -> None:
    """With the gains of its own against those without: 0.45 and 0.96 over many flights."""
    loops = [
        ClosedLoop(world(3, 0.03, sensors), shipped_values())
        for sensors in (USUAL_SENSORS, WITH_IMU)
    ]
    plain, imu = (rms_e_rho_m(ticks(loop, 16.0)[6 * HZ :]) for loop in loops)
    assert imu < 0.7 * plain


@pytest.mark.parametrize("factor", [0.5, 1.8])
def test_the_outer_gains_with_accelerations_keep_their_margin(factor: float) -> None:
    """As those without: airspeed and mass are never known.  In calm air it settles on the line."""
    values = shipped_values()
    outer = {name: factor * values[name] for name in ("RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU")}
    loop = ClosedLoop(world(1, 0.0, WITH_IMU), values.changed(outer))
    flight = ticks(loop, 14.0)
    assert flight[-1].imu_weight == 1.0
    assert all(abs(output.line.e_rho_m) <= 0.01 for output in flight[-4 * HZ :])


def test_a_switch_in_steady_flight_makes_no_jump() -> None:
    """In calm air a tick changes the commands no more than the sensors' noise does anyhow."""
    loop = ClosedLoop(world(1, 0.0, WITH_IMU), shipped_values())
    ticks(loop, 7.0)
    with_imu = ticks(loop, 3.0)
    loop.change({"EST_IMU": 0})
    lost = ticks(loop, 0.3)
    ticks(loop, 1.0)
    without = ticks(loop, 3.0)
    loop.change({"EST_IMU": 1})
    back = ticks(loop, 0.8)
    assert (with_imu[-1].imu_weight, lost[-1].imu_weight) == (1.0, 0.0)
    assert (without[-1].imu_weight, back[-1].imu_weight) == (0.0, 1.0)

    for number in (pitch_setpoint_rad, elevator):
        usual = max(largest_change(with_imu, number), largest_change(without, number))
        assert largest_change([with_imu[-1], *lost], number) <= 1.2 * usual
        assert largest_change([without[-1], *back], number) <= 1.2 * usual


@pytest.mark.parametrize("seed", [1, 2])
def test_accelerations_lost_in_flight_are_flown_without(seed: int) -> None:
    """In 3 % turbulence, for good, between one sample and the next."""
    faults = parse_faults(["imu.dropout start=5 for=60"])
    loop = ClosedLoop(world(seed, 0.03, WITH_IMU), shipped_values(), Injection(faults, seed))
    flight = ticks(loop, 14.0)
    fraction = [output.imu_weight for output in flight]
    assert fraction[5 * HZ - 1] == 1.0
    assert fraction[round(5.2 * HZ)] == 0.0  # 50 ms until silence is noticed, 100 ms to go
    assert set(fraction[round(5.2 * HZ) :]) == {0.0}
    assert flight[-1].active
    assert rms_e_rho_m(flight[6 * HZ :]) < 0.03

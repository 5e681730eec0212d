"""Held in the middle: roll gusts, and a roll angle that is wrong by a constant."""

from __future__ import annotations

from math import degrees, radians

import numpy as np
import pytest
from msgspec.structs import replace

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.geometry import quaternion_from_euler, quaternion_product
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.sensors import MEMS_IMU, READ_BACK, Sensors
from tgl_soar.sim.world import World, build_field, make_world
from tgl_soar.sim.world_step import WorldNow
from tgl_soar.types import AttitudeSample

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
LEVEL_WINGS = {"SIDE_P": 0.0, "SIDE_I": 0.0}


class Misaligned(World):
    """An autopilot whose roll angle is wrong by a constant."""

    roll_error_rad = 0.0

    def _take(self, now: WorldNow) -> None:
        super()._take(now)
        a = self.attitude
        if a.sequence > 0 and a is not self._turned:
            q = quaternion_product(
                a.qw, a.qx, a.qy, a.qz, *quaternion_from_euler(self.roll_error_rad, 0.0, 0.0)
            )
            self.attitude = self._turned = a._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3])

    _turned: AttitudeSample | None = None


def flown(
    seed: int, turbulence: float, roll_error_deg: float, seconds: float, **changes: float
) -> Trajectory:
    airframe, site = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
    assert site.air is not None
    rolls = replace(site.air.turbulence, roll_gusts=True)
    site = replace(site, air=replace(site.air, turbulence=rolls))
    assert site.air is not None
    world = make_world(
        airframe,
        site,
        seed=seed,
        turbulence=turbulence,
        field=build_field(site.air),
        sensors=Sensors(imu=MEMS_IMU, surfaces=READ_BACK),
    )
    world.__class__ = Misaligned
    assert isinstance(world, Misaligned)
    world.roll_error_rad = radians(roll_error_deg)
    values = load_parameters(airframe, AIRFRAME_PATH, site, SITE_PATH).changed(changes)
    return fly(world, values, (), seconds)


def rms_y_m(flight: Trajectory) -> float:
    later = flight["time_s"] > 5.0
    return float(np.sqrt(np.mean(flight["y_m"][later] ** 2)))


@pytest.mark.parametrize("seed", [1, 2])
def test_roll_gusts_move_it_to_the_side_by_a_quarter_of_a_metre_at_most(seed: int) -> None:
    flight = flown(seed, 0.03, 0.0, 15.0)
    assert flight.ended == ""
    assert rms_y_m(flight) < 0.25
    assert degrees(np.std(flight["roll_rad"])) < 5.0


@pytest.mark.parametrize("error_deg", [-2.0, 2.0])
def test_a_roll_angle_that_is_wrong_leaves_nothing_in_the_end(error_deg: float) -> None:
    """g 2 degrees / (V side force) is 0.1 rad of sideslip, 0.6 m on the way to the waypoint."""
    flight = flown(1, 0.0, error_deg, 25.0)
    assert flight.ended == ""
    assert np.abs(flight["y_m"][-400:]).max() < 0.05
    assert np.abs(flight["y_m"]).max() < 0.4


def test_a_law_without_a_schedule_leads_to_the_middle_as_well() -> None:
    """The same, of gains that are flown as they stand: V of the law is the airspeed."""
    flight = flown(1, 0.0, 2.0, 25.0, RHO_SPEED=0.0)
    assert flight.ended == ""
    assert np.abs(flight["y_m"][-400:]).max() < 0.05


def test_level_wings_are_flown_where_the_gains_are_zero() -> None:
    flight = flown(1, 0.0, 2.0, 15.0, **LEVEL_WINGS)
    assert abs(flight["y_m"][-1]) > 0.4

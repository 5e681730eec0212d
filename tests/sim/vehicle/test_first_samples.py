"""What the autopilot takes itself for before its first sample, and what it does with that."""

from __future__ import annotations

import pytest

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.sensed import GROUNDED, Sensed
from tgl_soar.types import NO_AIRSPEED, NO_IMU, NO_RANGE

SURFACES = load_airframe(shipped("airframes/eclipson_c.toml")).surfaces


def test_before_its_first_sample_it_is_level_and_still_at_the_origin() -> None:
    assert GROUNDED.attitude[:2] == (0, 0.0)
    assert GROUNDED.attitude[2:] == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert GROUNDED.position[:8] == (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert not GROUNDED.position.reckoned
    assert (GROUNDED.airspeed_mps, GROUNDED.flying) == (0.0, False)
    assert (GROUNDED.imu, GROUNDED.pitot, GROUNDED.rangefinder) == (NO_IMU, NO_AIRSPEED, NO_RANGE)


def nose_low(sequence: int) -> Sensed:
    """With the nose 0.1 rad below where it is held."""
    qw, qx, qy, qz = quaternion_from_euler(0.0, -0.1, 0.0)
    attitude = GROUNDED.attitude._replace(sequence=sequence, qw=qw, qx=qx, qy=qy, qz=qz)
    return GROUNDED._replace(attitude=attitude)


@pytest.mark.parametrize(("sequence", "moves"), [(0, False), (1, True), (2, True)])
def test_level_flight_begins_with_the_first_attitude(sequence: int, moves: bool) -> None:
    pixhawk = Pixhawk(SURFACES, 200)
    assert pixhawk.set_mode(FBWA, "the test")
    pixhawk.step(nose_low(sequence))
    assert (pixhawk.surfaces.elevator > 0.1) == moves
    assert pixhawk.set_mode(MANUAL, "the test")
    pixhawk.step(nose_low(sequence))
    assert pixhawk.surfaces.elevator == pytest.approx(0.0, abs=0.01)

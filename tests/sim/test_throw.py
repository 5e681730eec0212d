"""The hand that holds the aircraft and throws it."""

from __future__ import annotations

from math import hypot, radians, sin

import pytest

from tgl_soar.config.files import airframe_file, load_airframe, load_site, site_file
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.sensors import ImuParams, Sensors
from tgl_soar.sim.throw import PUSH_S, SHOULDER_M, Throw, ThrownWorld, place_to_throw
from tgl_soar.sim.world import make_world
from tgl_soar.types import SurfaceCommand

COMMAND = SurfaceCommand(0.0, 0.0, 0.0)
IMU = ImuParams(
    rate_hz=200.0,
    delay_s=0.0,
    force_noise_mps2=0.0,
    force_bias_mps2=0.0,
    rate_noise_radps=0.0,
    rate_bias_radps=0.0,
)


def world(speed_mps: float) -> ThrownWorld:
    made = make_world(
        load_airframe(airframe_file("eclipson_c")),
        load_site(site_file("hill")),
        seed=3,
        turbulence=0.0,
        sensors=Sensors(imu=IMU),
    )
    throw = Throw(
        time_s=0.5,
        speed_mps=speed_mps,
        roll_rad=0.0,
        pitch_rad=radians(10.0),
        heading_rad=radians(-15.0),
    )
    return ThrownWorld(made, throw)


def test_it_stands_as_it_will_be_thrown_and_feels_its_weight() -> None:
    held = world(4.0)
    for _ in range(80):
        held.step(COMMAND)
    state = held.state
    assert (state.x_m, state.y_m, state.z_m) == (held.start.x_m, 0.0, held.start.z_m)
    angles = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
    assert angles == pytest.approx((0.0, radians(10.0), radians(-15.0)))
    assert held.imu.force_x_frd_mps2 == pytest.approx(9.80665 * sin(radians(10.0)), abs=1e-6)
    assert not held.is_free


def test_it_leaves_the_hand_with_its_speed_along_its_nose() -> None:
    thrown = world(4.0)
    measured = []
    while not thrown.is_free:
        thrown.step(COMMAND)
        measured.append(thrown.imu.force_x_frd_mps2)
    state = thrown.state
    assert thrown.time_s == pytest.approx(0.5 + PUSH_S, abs=0.011)
    assert hypot(state.velocity_x_mps, state.velocity_y_mps) == pytest.approx(3.94, abs=0.15)
    assert state.velocity_y_mps < 0.0 > state.velocity_x_mps  # to the left, upwind
    assert max(measured) == pytest.approx(9.80665 * sin(radians(10.0)) + 4.0 / PUSH_S, abs=1e-6)
    way = hypot(state.x_m - thrown.start.x_m, state.y_m, state.z_m - thrown.start.z_m)
    assert way == pytest.approx(0.5 * 4.0 * PUSH_S, abs=0.05)


def test_without_a_speed_it_is_released() -> None:
    released = world(0.0)
    while not released.is_free:
        released.step(COMMAND)
        assert released.imu.force_x_frd_mps2 < 2.0
    assert released.time_s == pytest.approx(0.5, abs=0.006)


def test_a_hand_is_near_the_crest_on_its_windward_side() -> None:
    """Over a dell at 1 m: nine tenths of the 10 m up to the crest, on the last slope before it."""
    ground = ((-40.0, 2.0), (-30.0, 1.0), (-20.0, 10.5), (-15.0, 9.0), (-5.0, 11.0), (5.0, 1.0))
    x_m, z_m = place_to_throw(ground)
    assert x_m == pytest.approx(-10.0)
    assert z_m == pytest.approx(10.0 + SHOULDER_M)
    for flat in (((-9.0, 1.0), (9.0, 1.0)), ((-9.0, 3.0), (9.0, 1.0))):
        with pytest.raises(ValueError, match="does not rise towards a crest"):
            place_to_throw(flat)


def test_from_the_hand_over_the_shipped_hill() -> None:
    """Where `outdoors` throws from, within a metre and a half."""
    ground = load_site(site_file("hill")).ground
    assert ground is not None
    x_m, z_m = place_to_throw(ground.profile)
    assert x_m == pytest.approx(-4.5, abs=1.5)
    assert z_m == pytest.approx(8.4, abs=0.6)

"""A propeller in the simulated aircraft: its thrust, its lag, and what an aircraft without is."""

from __future__ import annotations

from math import cos, exp, nan, sin

import numpy as np
import pytest
from msgspec.structs import asdict

from tgl_soar.config.files import (
    ConfigError,
    airframe_from,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.sim.aircraft import aircraft_model, glide_at, gliding_state, specific_force_frd, step
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.point_mass import point_mass
from tgl_soar.sim.propeller import spun, thrust
from tgl_soar.sim.world import make_world
from tgl_soar.types import SurfaceCommand

PATH = shipped("airframes/eclipson_c_propeller.toml")
TEXT = PATH.read_text(encoding="utf-8")
PLANE = load_airframe(PATH)
MODEL = aircraft_model(asdict(PLANE.airframe), PLANE.model)
STILL = (0.0, 0.0, 0.0)


def test_thrust_falls_by_a_straight_line_to_none() -> None:
    assert thrust(MODEL, 1.0, 0.0) == 4.0
    assert thrust(MODEL, 1.0, 9.0) == pytest.approx(2.0)
    assert thrust(MODEL, 0.5, 9.0) == pytest.approx(1.0)
    assert thrust(MODEL, 1.0, 18.0) == thrust(MODEL, 1.0, 40.0) == 0.0
    assert thrust(MODEL, 1.0, -5.0) == 4.0  # tumbling backwards


def test_it_follows_by_its_lag_and_nonsense_closes_it() -> None:
    assert spun(MODEL, 0.0, 1.0, 0.15) == pytest.approx(1.0 - exp(-1.0))
    halves = spun(MODEL, spun(MODEL, 0.2, 0.8, 0.05), 0.8, 0.10)
    assert halves == pytest.approx(spun(MODEL, 0.2, 0.8, 0.15))  # whatever the step
    assert spun(MODEL, 1.0, nan, 0.15) == pytest.approx(exp(-1.0))
    assert spun(MODEL, 0.0, 7.0, 100.0) == 1.0
    without = MODEL._replace(propeller_thrust_n=0.0)
    assert spun(without, 1.0, 1.0, 0.01) == thrust(without, 1.0, 0.0) == 0.0
    assert spun(MODEL._replace(propeller_lag_s=0.0), 0.0, 0.3, 0.01) == 0.3


def test_it_pulls_along_the_nose_and_turns_nothing() -> None:
    glide = glide_at(MODEL, 9.0)
    still = gliding_state(glide, STILL)
    driven = still._replace(throttle=0.5)
    moved = SurfaceCommand(glide.elevator, 0.0, 0.0)
    without = step(MODEL, still, moved, STILL, STILL, 1e-4)
    after = step(MODEL, driven, moved, STILL, STILL, 1e-4)
    pull = thrust(MODEL, 0.5, glide.airspeed_mps * cos(glide.alpha_rad)) / MODEL.mass_kg
    assert pull > 1.0
    upstream = -(after.velocity_x_mps - without.velocity_x_mps) / 1e-4
    assert upstream == pytest.approx(pull * cos(glide.pitch_rad), rel=1e-3)
    up = (after.velocity_z_mps - without.velocity_z_mps) / 1e-4
    assert up == pytest.approx(pull * sin(glide.pitch_rad), abs=1e-2)
    assert after.pitch_rate_frd_radps == pytest.approx(without.pitch_rate_frd_radps, abs=1e-6)
    measured, gliding = (specific_force_frd(MODEL, s, STILL) for s in (driven, still))
    assert measured[0] - gliding[0] == pytest.approx(pull)
    assert measured[1:] == gliding[1:]


def flown(name: str) -> Trajectory:
    path, site_path = shipped(f"airframes/{name}.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(path), load_site(site_path)
    values = load_parameters(airframe, path, site, site_path)
    return fly(make_world(airframe, site, seed=5, turbulence=0.02), values, [], 3.0)


def test_an_aircraft_that_does_not_use_its_propeller_flies_as_one_without() -> None:
    plain, other = flown("eclipson_c"), flown("eclipson_c_propeller")
    for name, column in plain.columns.items():
        assert np.array_equal(column, other[name], equal_nan=True), name


def test_what_stands_in_the_world_drives_it_on() -> None:
    site = load_site(shipped("sites/hill.toml"))
    worlds = [make_world(PLANE, site, seed=1, turbulence=0.0) for _ in range(2)]
    worlds[1].throttle = 1.0
    for world in worlds:
        for _ in range(100):
            world.step(SurfaceCommand(world.trim.elevator, 0.0, 0.0))
    still, driven = (world.state for world in worlds)
    assert still.throttle == 0.0
    assert driven.throttle == pytest.approx(1.0 - exp(-0.5 / 0.15), rel=1e-6)
    assert driven.velocity_x_mps < still.velocity_x_mps - 0.5  # further upwind
    worlds[1].relaunch()
    assert worlds[1].throttle == worlds[1].state.throttle == 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("propeller_thrust_n = 4.0", "propeller_thrust_n = -4.0", "must be from 0 to 10000"),
        ("propeller_thrust_n = 4.0", "#", "propeller_thrust_n: missing, where"),
        ("propeller_speed_mps = 18.0", "#", "propeller_speed_mps: missing, where"),
        ("propeller_speed_mps = 18.0", "propeller_speed_mps = 0.0", "must be from 1 to 200"),
        ("propeller_lag_s = 0.15", "propeller_lag_s = 3.0", "must be from 0 to 2"),
        ("throttle = { channel = 3", "throttle = { channel = 2", "shares channel 2"),
        ("pwm_min = 1000, pwm_max = 2000", "pwm_min = 2000, pwm_max = 1000", "must hold"),
    ],
)
def test_half_a_propeller_and_a_wrong_one_are_refused(old: str, new: str, words: str) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(ConfigError, match=words):
        airframe_from(TEXT.replace(old, new), "plane.toml")


def test_a_point_mass_has_no_throttle() -> None:
    with pytest.raises(ValueError, match="a throttle moves the rigid body only"):
        point_mass(asdict(PLANE.airframe), PLANE.model, PLANE.polar.as_polar())


def test_without_a_channel_nobody_knows_of_the_propeller() -> None:
    line = "throttle = { channel = 3, pwm_min = 1000, pwm_max = 2000 }\n"
    assert PLANE.aerodynamics().propeller_thrust_n == 4.0
    assert airframe_from(TEXT.replace(line, ""), "p.toml").aerodynamics().propeller_thrust_n == 0.0
    assert 3 in PLANE.surfaces.channels()

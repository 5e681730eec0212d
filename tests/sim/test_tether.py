"""The tether: a force while it is taut, measured by the accelerometers, on either aircraft."""

from __future__ import annotations

from math import dist, hypot

import msgspec
import pytest

from tgl_soar.config.airframe import ModelKind
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.site import Site, Tether
from tgl_soar.sim.sensors import ImuParams, Sensors
from tgl_soar.sim.tether import pull_frd, tether_params, tether_pull
from tgl_soar.sim.world import World, make_world
from tgl_soar.types import SurfaceCommand

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
SITE = load_site(shipped("sites/tunnel.toml"))
EXACT = Sensors(
    imu=ImuParams(
        rate_hz=200.0,
        delay_s=0.0,
        force_noise_mps2=0.0,
        force_bias_mps2=0.0,
        rate_noise_radps=0.0,
        rate_bias_radps=0.0,
    )
)
KINDS: tuple[ModelKind, ...] = ("rigid_body", "point_mass")
ANCHOR = (0.6, 0.0, 1.2)  # the start
LENGTH_M = 0.25


def world(tether: Tether | None, kind: ModelKind = "rigid_body") -> World:
    site = msgspec.structs.replace(SITE, tether=tether)
    return make_world(AIRFRAME.flown_as(kind), site, seed=1, turbulence=0.02, sensors=EXACT)


def short() -> Tether:
    x, y, z = ANCHOR
    return Tether(x_m=x, y_m=y, z_m=z, length_m=LENGTH_M)


def distance(flown: World) -> float:
    s = flown.state
    return dist((s.x_m, s.y_m, s.z_m), ANCHOR)


@pytest.mark.parametrize("kind", KINDS)
def test_a_slack_tether_is_none(kind: ModelKind) -> None:
    free, slack = world(None, kind), world(Tether(x_m=0.6, z_m=0.9, length_m=20.0), kind)
    for _ in range(400):
        for flown in (free, slack):
            flown.step(SurfaceCommand(flown.trim.elevator, 0.0, 0.0))
        assert slack.state == free.state
        assert slack.imu == free.imu


@pytest.mark.parametrize("kind", KINDS)
def test_a_taut_tether_keeps_an_aircraft_that_nobody_flies(kind: ModelKind) -> None:
    """Half-way to the board it stays; without the tether it falls onto it.

    Air of 10 m/s pulls with 16 N at most (C_L of 1.5). Its work over 0.25 m and over the stretch s
    is in the line at most: 140 N/m s² / 2 = 16 N (0.25 m + s), s = 0.38 m.
    """
    up = SurfaceCommand(-1.0, 0.0, 0.0)
    free, tied = world(None, kind), world(short(), kind)
    distances_m = []
    for _ in range(600):
        free.step(up)
        tied.step(up)
        distances_m.append(distance(tied))
    assert free.crashed
    assert not tied.crashed
    assert distance(free) > 0.5
    assert LENGTH_M < max(distances_m) < LENGTH_M + 0.38


@pytest.mark.parametrize("kind", KINDS)
def test_accelerometers_feel_the_pull(kind: ModelKind) -> None:
    """At the same state and wind, the force differs by the pull turned into the body."""
    flown = world(short(), kind)
    taut_ticks = 0
    for _ in range(200):
        flown.step(SurfaceCommand(-1.0, 0.1, 0.0))
        if flown.crashed:
            break
        pull = tether_pull(flown.parts.tether, flown.state)
        if hypot(*pull) < 1.0:
            continue
        imu, air = flown.imu, flown.model.specific_force_frd(flown.state, flown.wind)
        measured = (imu.force_x_frd_mps2, imu.force_y_frd_mps2, imu.force_z_frd_mps2)
        extra = tuple(m - a for m, a in zip(measured, air, strict=True))
        # The pull of the step was that before its own velocity was taken into account.
        assert hypot(*extra) == pytest.approx(hypot(*pull), rel=0.3)
        turned = pull_frd(flown.state, pull)
        along = sum(a * b for a, b in zip(extra, turned, strict=True))
        assert along > 0.999 * hypot(*extra) * hypot(*turned)
        taut_ticks += 1
    assert taut_ticks > 5


def test_it_pulls_towards_its_point_by_what_it_is_stretched() -> None:
    flown = world(None)
    still = flown.state._replace(
        x_m=3.0, y_m=4.0, z_m=0.0, velocity_x_mps=0.0, velocity_y_mps=0.0, velocity_z_mps=0.0
    )
    tether = tether_params((0.0, 0.0, 0.0), 4.0, 140.0, 0.7)
    assert tether_pull(tether, still) == pytest.approx((-120.0, -160.0, 0.0))
    # Damped while it stretches, and never a push however fast it slackens.
    outward = still._replace(velocity_x_mps=0.6, velocity_y_mps=0.8)
    assert hypot(*tether_pull(tether, outward)) == pytest.approx(200.0 + (140.0 / 0.7) ** 0.5)
    inward = still._replace(velocity_x_mps=-60.0, velocity_y_mps=-80.0)
    assert hypot(*tether_pull(tether, inward)) == 0.0
    assert tether_pull(tether, still._replace(x_m=0.0)) == (0.0, 0.0, 0.0)


def test_along_the_bodys_axes_a_pull_is_as_long_as_it_was() -> None:
    state = world(None).state._replace(qw=0.8, qx=0.2, qy=-0.4, qz=0.4)
    assert hypot(*pull_frd(state, (3.0, -4.0, 12.0))) == pytest.approx(13.0)
    level = state._replace(qw=1.0, qx=0.0, qy=0.0, qz=0.0)
    assert pull_frd(level, (3.0, -4.0, 12.0)) == pytest.approx((-3.0, -4.0, -12.0))


def test_a_tether_that_does_not_reach_the_start_is_refused() -> None:
    with pytest.raises(ValueError, match=r"tether\.length_m = 0\.2: must reach \[start\]"):
        Site(site=SITE.site, start=SITE.start, tether=Tether(x_m=0.6, z_m=0.9, length_m=0.2))

"""A throw's way and speed at every moment in the hand, and what a leg's score counts from when to
when."""

from __future__ import annotations

from math import cos, inf, isnan, nan, pi, radians, sin
from typing import Any

import numpy as np
import pytest

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim import score as score_module
from tgl_soar.sim.score import LegScore, score_leg, settling_time
from tgl_soar.sim.throw import PUSH_S, Throw, ThrownWorld
from tgl_soar.sim.world import make_world
from tgl_soar.types import SurfaceCommand

NEUTRAL = SurfaceCommand(0.0, 0.0, 0.0)


def thrown(**changes: float) -> ThrownWorld:
    throw = Throw(
        **{
            "time_s": 0.1,
            "speed_mps": 4.0,
            "roll_rad": 0.2,
            "pitch_rad": radians(10.0),
            "heading_rad": radians(-15.0),
            **changes,
        }
    )
    site = load_site(shipped("sites/hill.toml"))
    airframe = load_airframe(shipped("airframes/eclipson_c.toml"))
    return ThrownWorld(make_world(airframe, site, turbulence=0.0), throw)


def test_an_arm_swings_for_a_quarter_of_a_second() -> None:
    assert PUSH_S == 0.25


def test_in_the_hand_it_speeds_up_evenly_along_its_nose() -> None:
    """v = a t and s = a t² / 2, a = 16 m/s²; upwind is towards -x, the right is +y."""
    world = thrown()
    nose = np.array(
        [
            -cos(radians(10.0)) * cos(radians(15.0)),
            -cos(radians(10.0)) * sin(radians(15.0)),
            sin(radians(10.0)),
        ]
    )
    start = np.array([world.start.x_m, world.start.y_m, world.start.z_m])
    for step in range(1, 70):
        world.step(NEUTRAL)
        state = world.state
        t = max(0.0, 0.005 * step - 0.1)
        assert np.array(state[3:6]) == pytest.approx(16.0 * t * nose, abs=1e-9)
        assert np.array(state[:3]) - start == pytest.approx(8.0 * t * t * nose, abs=1e-9)
        angles = euler_from_quaternion(*state[6:10])
        assert angles == pytest.approx((0.2, radians(10.0), radians(-15.0)))
        assert state[10:13] == (0.0, 0.0, 0.0)
        assert not world.is_free


def test_it_is_free_once_the_arm_has_swung_or_at_once_where_it_is_released() -> None:
    for speed, free_after in ((4.0, 0.35), (0.0, 0.1)):
        world = thrown(speed_mps=speed)
        while not world.is_free:
            world.step(NEUTRAL)
        assert world.time_s == pytest.approx(free_after, abs=0.0051)
        before = world.state
        world.step(NEUTRAL)
        assert world.state.velocity_z_mps != before.velocity_z_mps  # it flies


def test_it_stands_in_the_hand_from_the_first_as_it_will_be_thrown() -> None:
    world = thrown()
    assert euler_from_quaternion(*world.state[6:10]) == pytest.approx(
        (0.2, radians(10.0), radians(-15.0))
    )
    assert world.state[3:6] == pytest.approx((0.0, 0.0, 0.0))


# --- a leg ----------------------------------------------------------------------------------------

TIME = np.linspace(0.0, 20.0, 2001)


def scored(e_rho: Any, along: Any = 0.0, **more: Any) -> LegScore:
    """Of a line through (1, 2) that leans: eta is 105 degrees."""
    eta = radians(105.0)
    e, s = np.broadcast_to(e_rho, TIME.shape), np.broadcast_to(along, TIME.shape)
    x = 1.0 - sin(eta) * e + cos(eta) * s
    z = 2.0 + cos(eta) * e + sin(eta) * s
    return score_leg("a", (1.0, 2.0, eta), more.pop("crossing", None), TIME, x, z, **more)


def test_the_times_and_the_band_of_a_score() -> None:
    assert (score_module.SETTLED_M, score_module.SETTLED_FOR_S) == (0.05, 2.0)
    assert (score_module.SETTLE_S, score_module.TAIL_S) == (3.0, 8.0)


def test_e_rho_is_scored_from_three_seconds_on() -> None:
    found = scored(np.where(TIME < 2.99, 1.0, 0.03))
    assert found.rms_e_rho_m == pytest.approx(0.03)
    assert found.peak_e_rho_m == pytest.approx(0.03)
    late = scored(np.where(TIME < 3.01, 1.0, 0.03))
    assert late.peak_e_rho_m == pytest.approx(1.0)
    assert scored(-0.2).peak_e_rho_m == pytest.approx(0.2)


def test_place_and_dispersion_are_of_the_last_eight_seconds() -> None:
    along = np.where(TIME < 11.99, 9.0, np.where(TIME < 16.0, 1.0, -1.0))
    found = scored(0.0, along, crossing=(1.0, 2.0))
    assert found.dispersion_m == pytest.approx(1.0, abs=0.01)
    assert (found.mean_x_m, found.mean_z_m) == pytest.approx((1.0, 2.0), abs=0.01)
    assert found.crossing_m == pytest.approx(0.0, abs=0.01)
    apart = scored(0.0, 3.0, crossing=(1.0, 2.0))
    assert apart.crossing_m == pytest.approx(3.0)
    assert isnan(scored(0.0).crossing_m)


def test_sideways_and_bank_are_scored_where_they_are_known() -> None:
    first = np.where(TIME < 2.99, 9.0, -0.5)
    found = scored(0.0, y_m=first, bank_rad=0.5 * first)
    assert (found.rms_y_m, found.rms_bank_rad) == pytest.approx((0.5, 0.25))
    unknown = scored(0.0)
    assert isnan(unknown.rms_y_m)
    assert isnan(unknown.rms_bank_rad)


def test_a_short_leg_is_scored_by_its_last_moment() -> None:
    time, zero = np.array([0.0, 1.0, 2.0]), np.zeros(3)
    x = np.array([5.0, 5.0, 0.02])
    found = score_leg("a", (0.0, 0.0, pi / 2), None, time, x, zero)
    assert found.rms_e_rho_m == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("quiet", "settles_s"),
    [
        ([(0.0, 20.0)], 0.0),
        ([(4.0, 20.0)], 3.99),
        ([(1.0, 2.9), (5.0, 7.2), (9.0, 20.0)], 4.99),
        ([(1.0, 2.9)], inf),
        ([(18.5, 20.0)], inf),
        ([], inf),
    ],
)
def test_it_has_settled_at_the_first_two_seconds_within_five_centimetres(
    quiet: list[tuple[float, float]], settles_s: float
) -> None:
    e = np.full(TIME.shape, 0.051)
    for begin, end in quiet:
        e[(begin <= TIME) & (end >= TIME)] = -0.049
    assert settling_time(TIME + 7.0, e) == pytest.approx(settles_s, abs=0.011)
    e[:] = nan
    assert settling_time(TIME, e) == inf


@pytest.mark.parametrize(
    ("settling_s", "rms_m", "settled"),
    [(1.0, 0.05, True), (1.0, 0.0501, False), (inf, 0.01, False), (nan, 0.01, False)],
)
def test_a_leg_has_settled_that_came_to_the_line_and_stayed(
    settling_s: float, rms_m: float, settled: bool
) -> None:
    made = LegScore(
        name="a",
        settling_s=settling_s,
        rms_e_rho_m=rms_m,
        peak_e_rho_m=0.1,
        mean_x_m=0.0,
        mean_z_m=0.0,
        dispersion_m=0.0,
        crossing_m=nan,
    )
    assert made.settled == settled
    assert isnan(made.rms_y_m)
    assert isnan(made.rms_bank_rad)

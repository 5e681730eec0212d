"""The forecast on a plant of one degree of freedom: an aircraft that a line holds without error.

    c s' = E(s) + (V/g) cos(eta) s''    with E, the wind and first-order gusts given

so that E is known everywhere, and with it where the aircraft must stop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, exp, inf, isnan, log, nan, radians, sin, sqrt

import numpy as np
import pytest

from tgl_soar.control import forecast as f
from tgl_soar.control.envelope import Fence
from tgl_soar.control.forecast import (
    Forecast,
    ForecastParams,
    ForecastState,
    forecast_step,
    initial_forecast,
)
from tgl_soar.control.line_room import line_room
from tgl_soar.types import (
    GRAVITY_MPS2,
    NO_AIR,
    NO_GROUND,
    GlidePolar,
    Ground,
    VehicleState,
    polar_sink,
)

# Minimum sink 1.3 m/s at 8 m/s; no airframe of the project.
POLAR = GlidePolar(c0=5.14, c1=-0.96, c2=0.06, c3=0.0, speed_min_mps=7.0, speed_max_mps=13.0)
ETA = radians(90.0 + 15.0)
CLEAR_M = 0.4
PARAMS = ForecastParams(
    act=f.DISENGAGE, time_s=1.0, chance=0.05, clearance_min_m=CLEAR_M, speed_min_mps=6.0,
    polar=POLAR,
)  # fmt: skip
WIDE = Fence(x_min_m=-50.0, x_max_m=50.0, y_max_m=5.0, z_min_m=-50.0, z_max_m=50.0)
LEVEL = Ground(1, (0.0,) * 8, (0.0,) * 8)
DT_S = 0.005
STILL = VehicleState(
    time_s=0.0, x_m=0.0, y_m=0.0, z_m=0.0, velocity_x_mps=0.0, velocity_y_mps=0.0, climb_mps=0.0,
    roll_rad=0.0, pitch_rad=0.0, heading_rad=0.0, roll_rate_radps=0.0, pitch_rate_radps=0.0,
    heading_rate_radps=0.0,
)  # fmt: skip


@dataclass
class Slide:
    """One flight along a line from (0, z)."""

    excess: Callable[[float], float]  # by the height
    z_m: float
    wind_mps: float = 8.5
    gusts: float = 0.0  # of the wind
    scale_m: float = 1.5
    updraft_bias_mps: float = 0.0  # of the estimate
    seed: int = 1
    eta_rad: float = ETA
    moving: bool = False
    params: ForecastParams = PARAMS
    fence: Fence = WIDE
    ground: Ground = LEVEL

    def fly(self, duration_s: float) -> list[tuple[float, float, ForecastState]]:
        """(time, height, state) of every tick, until it would hand over or is at the clearance."""
        rng = np.random.default_rng(self.seed)
        state, reported = initial_forecast(), []
        s = speed = 0.0
        keeps = exp(-DT_S * self.wind_mps / self.scale_m)
        sd = self.gusts * self.wind_mps
        gust = sd * rng.normal(size=2)
        for k in range(round(duration_s / DT_S)):
            x, z = s * cos(self.eta_rad), self.z_m + s * sin(self.eta_rad)
            updraft = self.excess(z) + polar_sink(POLAR, self.wind_mps)
            vx, climb = speed * cos(self.eta_rad), speed * sin(self.eta_rad)
            noise = rng.normal(size=4)
            vehicle = STILL._replace(
                time_s=k * DT_S,
                x_m=x + 0.002 * noise[0],
                z_m=z + 0.002 * noise[1],
                velocity_x_mps=vx + 0.01 * noise[2],
                climb_mps=climb + 0.01 * noise[3],
            )
            air = NO_AIR._replace(
                wind_mps=self.wind_mps + gust[0],
                updraft_mps=updraft + gust[1] + self.updraft_bias_mps,
                wind_sigma_mps=0.15,
                updraft_sigma_mps=0.1,
            )
            state = forecast_step(
                self.params, self.fence, self.ground, state, vehicle, air, 0.02, self.eta_rad,
                self.moving,
            )  # fmt: skip
            reported.append((k * DT_S, z, state))
            if f.nowhere(state.foreseen) or z < CLEAR_M:
                break
            airspeed = self.wind_mps + gust[0] - vx
            excess = updraft + gust[1] - polar_sink(POLAR, airspeed)
            force = sin(self.eta_rad) * speed - excess
            speed += DT_S * force * GRAVITY_MPS2 / (airspeed * cos(self.eta_rad))
            s += DT_S * speed
            gust = keeps * gust + sd * sqrt(1.0 - keeps * keeps) * rng.normal(size=2)
        return reported

    def last(self, duration_s: float) -> tuple[float, float, Forecast]:
        """Time, height and forecast in the end."""
        time_s, z_m, state = self.fly(duration_s)[-1]
        return time_s, z_m, state.foreseen


def crossing(z_m: float, slope_per_s: float) -> Callable[[float], float]:
    """Excess updraft that vanishes at a height and falls going up."""
    return lambda z: -slope_per_s * (z - z_m)


@pytest.mark.parametrize("start_m", [-0.7, -0.3, 0.3, 0.7])
@pytest.mark.parametrize("gusts", [0.01, 0.03])
def test_a_line_that_crosses_the_contour_is_foreseen_to_settle_there(
    start_m: float, gusts: float
) -> None:
    """It is never reported otherwise, and the place is right within three of its own standard
    deviations, or 15 cm: what the gusts of 3 % move the aircraft by in three seconds."""
    for seed in range(8):
        flown = Slide(crossing(1.6, 1.0), 1.6 + start_m, gusts=gusts, seed=seed).fly(4.0)
        assert flown[-1][0] > 3.9, flown[-1]
        foreseen = flown[-1][2].foreseen
        assert foreseen.standing == f.SETTLES
        assert abs(foreseen.z_m - 1.6) < max(0.15, 3.0 * foreseen.sigma_m)
        assert foreseen.chance > 0.7


@pytest.mark.parametrize("excess_mps", [-0.45, -0.6, -1.0])
@pytest.mark.parametrize("gusts", [0.0, 0.01, 0.03])
def test_a_line_without_a_crossing_is_reported_in_time_and_with_height_in_hand(
    excess_mps: float, gusts: float
) -> None:
    """Excess updraft that is the same all the way down: no slope's air, and the hardest to tell, as
    near the ground a slope's grows fast.  Fast sinking is found 1.5 s after the window is full or
    0.3 s before the clearance, slow sinking above it."""
    for seed in range(8):
        slide = Slide(lambda _: excess_mps, 1.5, gusts=gusts, seed=seed)
        time_s, z_m, foreseen = slide.last(10.0)
        assert foreseen.standing == f.TOO_LOW
        left_s = (z_m - CLEAR_M) / -excess_mps
        if excess_mps < -0.5:
            assert time_s <= f.WINDOW_S + 1.5 or left_s > 0.3, (seed, time_s, left_s)
        assert z_m > CLEAR_M


def test_a_hope_that_fades_on_the_way_is_reported_above_the_clearance() -> None:
    """Level ground upstream of a slope: excess updraft grows going down, and then no more."""
    for seed in range(8):
        slide = Slide(lambda z: -0.15 - 0.5 * abs(z - 1.0), 1.6, gusts=0.01, seed=seed)
        _, z_m, foreseen = slide.last(10.0)
        assert foreseen.standing == f.TOO_LOW
        assert z_m > CLEAR_M + 0.05


def test_no_bias_of_updraft_or_polar_makes_a_resting_aircraft_sink() -> None:
    """Half of all updraft not measured: at rest E is 0 all the same."""
    slide = Slide(crossing(1.2, 1.0), 1.2, updraft_bias_mps=-0.6, gusts=0.01)
    time_s, _, foreseen = slide.last(6.0)
    assert time_s > 5.9
    assert foreseen.standing == f.SETTLES
    assert abs(foreseen.excess_mps) < 0.1
    assert abs(foreseen.z_m - 1.2) < 0.15


def test_the_uncertainty_of_excess_and_place_is_right() -> None:
    """Errors over their standard deviations: near 1 rms, 40 flights in 3 %; a fifth of a second's
    worth of gusts is unknown by a factor of two, and the place is no linear function of it."""
    misses, places = [], []
    for seed in range(40):
        time_s, z_m, state = Slide(crossing(1.5, 1.0), 1.9, gusts=0.03, seed=seed).fly(2.0)[-1]
        assert time_s > 1.9
        misses.append((state.lift.a_mps - (1.5 - z_m)) / sqrt(state.lift.p_aa))
        places.append((state.foreseen.z_m - 1.5) / state.foreseen.sigma_m)
    assert 0.5 < float(np.sqrt(np.mean(np.square(misses)))) < 1.5
    assert 0.4 < float(np.sqrt(np.mean(np.square(places)))) < 1.5


def test_a_line_on_its_way_waits_for_the_last_moment() -> None:
    """It may be moved to lift: only the time that is left ends that.  0.8 m/s of sink from 6 m."""
    still = Slide(lambda z: 0.3 * (z - 8.7), 6.0).last(20.0)
    moving = Slide(lambda z: 0.3 * (z - 8.7), 6.0, moving=True).last(20.0)
    assert still[2].standing == moving[2].standing == f.TOO_LOW
    assert still[1] > moving[1] + 0.3
    assert CLEAR_M + 0.5 < moving[1] < CLEAR_M + 3.0 * PARAMS.time_s


def test_lift_all_the_way_up_ends_at_the_fence() -> None:
    fence = WIDE._replace(z_max_m=3.0)
    _, z_m, foreseen = Slide(lambda _: 0.6, 1.5, fence=fence).last(10.0)
    assert foreseen.standing == f.OUTSIDE
    assert z_m < 3.0
    assert foreseen.z_m == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(
    ("side", "z_m"),
    [({"x_max_m": 0.2}, 3.0 - 0.2 / 0.268), ({"z_min_m": 1.5}, 1.5)],
)
def test_sinking_out_of_the_fence_before_the_clearance(side: dict[str, float], z_m: float) -> None:
    """tan 15 degrees is 0.268: by so much a metre of height leads downstream."""
    _, at_m, foreseen = Slide(lambda _: -0.6, 3.0, fence=WIDE._replace(**side)).last(10.0)
    assert foreseen.standing == f.OUTSIDE
    assert foreseen.z_m == pytest.approx(z_m, abs=0.01)
    assert at_m > z_m


@pytest.mark.parametrize(
    ("wind_mps", "standing"),
    [(6.0, f.TOO_SLOW), (7.1, f.SETTLES), (12.8, f.SETTLES), (13.8, f.TOO_FAST)],
)
def test_a_place_where_the_polar_has_ended_is_none(wind_mps: float, standing: int) -> None:
    state = initial_forecast()
    for k in range(40):
        vehicle = STILL._replace(time_s=0.1 * k, z_m=1.5)
        sink = polar_sink(POLAR, min(13.0, max(7.0, wind_mps)))
        air = NO_AIR._replace(
            wind_mps=wind_mps, updraft_mps=sink, wind_sigma_mps=0.15, updraft_sigma_mps=0.1
        )
        state = forecast_step(PARAMS, WIDE, LEVEL, state, vehicle, air, 0.02, ETA, False)
    assert state.foreseen.standing == standing


def test_without_ground_and_fence_no_place_is_too_low() -> None:
    slide = Slide(lambda _: -0.6, 1.5, ground=NO_GROUND, fence=WIDE._replace(z_min_m=-1000.0))
    assert all(not f.nowhere(state.foreseen) for _, _, state in slide.fly(1.5))


def test_the_ground_is_a_slope() -> None:
    """Down the line x grows, and with it the ground: the clearance is the distance to the plane."""
    ground = Ground(2, (0.0, 10.0, *[10.0] * 6), (0.0, 5.0, *[5.0] * 6))
    limits = line_room(CLEAR_M, WIDE, ground, 2.0, 4.0, ETA)
    x, z = 2.0 - limits.down_m * cos(ETA), 4.0 - limits.down_m * sin(ETA)
    assert (z - 0.5 * x) * cos(np.arctan(0.5)) == pytest.approx(CLEAR_M, abs=0.005)
    assert limits.down_m >= 0.0
    assert limits.depth_m == pytest.approx(limits.down_m + CLEAR_M)
    assert not limits.down_is_fence
    below = line_room(CLEAR_M, WIDE, ground, 2.0, 1.2, ETA)
    assert below.down_m == 0.0


def test_a_ridge_bars_the_line_that_comes_out_behind_it() -> None:
    """Through the ridge and out at its back the fence's bottom is clear of the ground again."""
    ground = Ground(5, (-10.0, 0.0, 6.0, 8.0, 9.0, *[9.0] * 3), (0.0, 0.0, 6.0, 6.0, *[0.0] * 4))
    fence = WIDE._replace(z_min_m=0.5)
    eta = radians(90.0 + 45.0)
    limits = line_room(CLEAR_M, fence, ground, 3.0, 7.0, eta)
    assert not limits.down_is_fence
    # The slope of 1 is 4 m below the aircraft, and meets the line at right angles.
    assert limits.down_m == pytest.approx(4.0 * cos(radians(45.0)) - CLEAR_M, abs=0.005)
    # Where the line passes over the ridge, the fence is what ends it.
    over = line_room(CLEAR_M, fence, ground, 8.0, 16.0, eta)
    assert over.down_is_fence
    assert over.down_m == pytest.approx(15.5 / sin(eta), abs=1e-9)


# --- the law ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("a", "b", "down", "up", "goes", "time_s", "stops"),
    [
        (-0.5, -1.0, 1.0, 9.0, -0.5, 3.0, True),  # sinks to the crossing
        (0.5, -1.0, 1.0, 9.0, 0.5, 3.0, True),  # climbs to it
        (-0.5, -0.4, 1.0, 9.0, -1.0, log(1.0 + -0.4 * -1.0 / -0.5) / -0.4, False),  # too far below
        (-0.5, 0.0, 1.0, 9.0, -1.0, 2.0, False),
        (-0.5, 0.5, 1.0, 9.0, -1.0, log(2.0) / 0.5, False),
        (0.5, 0.5, 1.0, 9.0, 9.0, log(10.0) / 0.5, False),
        (-0.5, -0.5, 1.0, 9.0, -1.0, inf, False),  # it would stop at the limit itself
        (-0.5, 0.5, 0.0, 9.0, 0.0, 0.0, False),
        (0.0, 0.5, 1.0, 9.0, 0.0, inf, False),
    ],
)
def test_where_it_goes(
    a: float, b: float, down: float, up: float, goes: float, time_s: float, stops: bool
) -> None:
    there, when, ends = f.stop_on_way(a, b, 1.0, down, up)
    assert there == pytest.approx(goes)
    assert when == pytest.approx(time_s)
    assert ends is stops


def test_the_time_to_a_limit_is_that_of_the_slide() -> None:
    """Against the slide integrated step by step."""
    a, b, c, s, time_s = -0.4, -0.3, 0.9, 0.0, 0.0
    while s > -0.8:
        s += 1e-4 * (a + b * s) / c
        time_s += 1e-4
    assert f.stop_on_way(a, b, c, 0.8, 5.0)[1] == pytest.approx(time_s, abs=1e-3)


# --- what it needs ----------------------------------------------------------------------------


def stepped(state: ForecastState, time_s: float, wind_mps: float = 8.5) -> ForecastState:
    air = NO_AIR._replace(
        wind_mps=wind_mps, updraft_mps=0.5, wind_sigma_mps=0.1, updraft_sigma_mps=0.1
    )
    vehicle = STILL._replace(time_s=time_s, z_m=1.5)
    return forecast_step(PARAMS, WIDE, LEVEL, state, vehicle, air, 0.02, ETA, False)


@pytest.mark.parametrize(("ahead_s", "stands"), [(5.0, False), (0.9, True)])
def test_a_line_that_begins_to_move_is_not_judged_as_it_stood(ahead_s: float, stands: bool) -> None:
    """But by the time that is left: at once, and not with the next reading."""
    bad = f.NO_FORECAST._replace(standing=f.TOO_LOW, ahead_s=ahead_s, chance=0.01, excess_mps=-0.2)
    read = f.initial_forecast()._replace(begun_s=0.0, time_s=1.0, held=5, foreseen=bad)
    air = NO_AIR._replace(wind_mps=8.5, updraft_mps=0.5, wind_sigma_mps=0.1)
    for moving in (False, True):
        after = forecast_step(
            PARAMS, WIDE, LEVEL, read, STILL._replace(time_s=1.005), air, 0.02, ETA, moving
        )
        assert f.nowhere(after.foreseen) == (stands or not moving)
        assert (after.time_s, after.lift) == (1.0, read.lift)


def test_it_reads_every_tenth_of_a_second_and_foresees_after_its_window() -> None:
    state, read, first_s = initial_forecast(), 0, nan
    for k in range(200):
        before, state = state, stepped(state, k * DT_S)
        read += state.time_s != before.time_s
        if isnan(first_s) and state.foreseen.standing != f.UNKNOWN:
            first_s = k * DT_S
    assert read == 10
    assert first_s == pytest.approx(f.WINDOW_S)


def test_a_gap_in_the_air_begins_it_again_and_a_short_one_does_not() -> None:
    state = initial_forecast()
    for k in range(8):
        state = stepped(state, 0.1 * k)
    short = stepped(state, 1.0, wind_mps=nan)
    assert short == state
    assert stepped(short, 1.1).begun_s == 0.0
    assert isnan(stepped(state, 1.3, wind_mps=nan).begun_s)
    assert stepped(state, 1.3).begun_s == 1.3


def test_no_airspeed_however_small_is_divided_by() -> None:
    """The smallest number there is, times a tenth of a second, is zero."""
    state = stepped(initial_forecast(), 0.0)
    assert stepped(state, 0.1, wind_mps=5e-324) == state


def test_a_clock_that_goes_back_begins_it_again() -> None:
    state = initial_forecast()
    for k in range(8):
        state = stepped(state, 10.0 + 0.1 * k)
    assert stepped(state, 3.0).begun_s == 3.0


def test_nothing_is_foreseen_without_air_without_polar_or_switched_off() -> None:
    vehicle = STILL._replace(z_m=1.5)
    air = NO_AIR._replace(wind_mps=8.5, updraft_mps=0.5, wind_sigma_mps=0.1, updraft_sigma_mps=0.1)
    for params, air_now in (
        (PARAMS._replace(act=f.OFF), air),
        (PARAMS, NO_AIR),
        (PARAMS._replace(polar=POLAR._replace(c0=nan)), air),
    ):
        state = initial_forecast()
        for k in range(20):
            now = vehicle._replace(time_s=0.1 * k)
            state = forecast_step(params, WIDE, LEVEL, state, now, air_now, 0.02, ETA, False)
            assert state.foreseen.standing == f.UNKNOWN


def test_one_reading_alone_says_nothing() -> None:
    """The standing changes with the second of HOLDS readings, numbers with each."""
    flown = Slide(lambda _: -1.0, 2.5).fly(10.0)
    standings = [state.foreseen.standing for _, _, state in flown]
    held = [state.held for _, _, state in flown]
    assert standings[-1] == f.TOO_LOW
    assert held[-1] == f.HOLDS
    assert all(standing <= f.SETTLES for standing in standings[:-1])


def test_its_words() -> None:
    low = f.NO_FORECAST._replace(standing=f.TOO_LOW, ahead_s=1.24)
    assert f.forecast_words(low) == "sinks below CLEAR_MIN in 1.2 s"
    assert f.forecast_words(low._replace(ahead_s=inf)) == "sinks below CLEAR_MIN"
    assert f.forecast_words(low._replace(standing=f.SETTLES)) == ""
    assert len(set(f.FORECAST_TEXTS)) == 1 + f.TOO_FAST


@pytest.mark.parametrize(
    ("ahead_s", "chance", "last"),
    [(0.99, 0.049, True), (1.01, 0.049, False), (0.99, 0.051, False), (-1.0, 0.0, True)],
)
def test_the_last_moment_is_a_second_before_and_almost_certain(
    ahead_s: float, chance: float, last: bool
) -> None:
    """Of a place to settle a chance of a twentieth."""
    forecast = f.NO_FORECAST._replace(standing=f.TOO_LOW, ahead_s=ahead_s, chance=chance)
    assert f.is_the_last_moment(PARAMS, forecast) is last


def test_there_is_nowhere_to_settle_where_a_reason_is_foreseen() -> None:
    for standing, text in enumerate(f.FORECAST_TEXTS):
        forecast = f.NO_FORECAST._replace(standing=standing, ahead_s=2.25)
        assert f.nowhere(forecast) is (standing not in (f.NO_FORECAST.standing, f.SETTLES))
        if f.nowhere(forecast):
            assert f.forecast_words(forecast) == f"{text} in 2.2 s"
            assert f.forecast_words(forecast._replace(ahead_s=nan)) == text
        else:
            assert f.forecast_words(forecast) == ""

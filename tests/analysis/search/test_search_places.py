"""Random places: the flow over an ellipse is a potential flow along it, and a seed is one place."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from tgl_soar.air.gusts import DrydenState, dryden_params, dryden_step, roll_gust_params
from tgl_soar.air.hill import HillField
from tgl_soar.analysis.search.places import (
    CHANGE,
    LAUNCH_WIND_MPS,
    PUBLISHED,
    TUNED_ON,
    SearchPlace,
    _air,
    ellipse_wind,
    place,
)
from tgl_soar.sim.white_noise import roll_gusts_before, turbulence_before

SEEDS = 4000
STEPS = 200  # a second
CHANCE = 3.5 / SEEDS**0.5  # a rank correlation of independent numbers, in 18 of them


def test_a_circle_is_the_hill_of_the_paper() -> None:
    x, z = np.array([-12.0, -6.0, -3.0, 4.0]), np.array([3.0, 9.0, 14.0, 10.0])
    u, w = ellipse_wind(8.0, 8.0, 8.0 - 1e-9, x, z)
    expected_u, _, expected_w = HillField(8.0, 8.0).wind(x, 0.0, z)
    assert u == pytest.approx(expected_u, abs=1e-6)
    assert w == pytest.approx(expected_w, abs=1e-6)


@pytest.mark.parametrize("height", [1.2, 4.0, 9.0])
def test_the_ellipse_is_a_streamline_and_the_far_wind_is_the_wind(height: float) -> None:
    half = 10.0
    angle = np.linspace(0.1, np.pi - 0.1, 15)
    out = 1.0 + 1e-9
    x, z = out * half * np.cos(angle), out * height * np.sin(angle)
    u, w = ellipse_wind(9.0, half, height, x, z)
    through = u * np.cos(angle) / half + w * np.sin(angle) / height
    assert np.hypot(u, w).max() > 9.0
    assert through == pytest.approx(np.zeros(15), abs=1e-6)
    # Fastest over the crest: U (1 + height / half).
    top = ellipse_wind(9.0, half, height, np.array([0.0]), np.array([out * height]))
    assert top[0][0] == pytest.approx(9.0 * (1.0 + height / half), rel=1e-6)
    far = ellipse_wind(9.0, half, height, np.array([-1e4]), np.array([1e4]))
    assert (far[0][0], far[1][0]) == pytest.approx((9.0, 0.0), abs=1e-4)


def test_the_ellipse_s_flow_has_neither_source_nor_curl() -> None:
    h = 1e-4
    x, z = np.array([-15.0, -9.0, -2.0, 5.0]), np.array([4.0, 6.0, 8.0, 9.0])

    def at(dx: float, dz: float) -> tuple[np.ndarray, np.ndarray]:
        return ellipse_wind(9.0, 10.0, 4.0, x + dx, z + dz)

    divergence = at(h, 0.0)[0] - at(-h, 0.0)[0] + at(0.0, h)[1] - at(0.0, -h)[1]
    curl = at(0.0, h)[0] - at(0.0, -h)[0] - at(h, 0.0)[1] + at(-h, 0.0)[1]
    assert np.abs(divergence / (2.0 * h)).max() < 1e-5
    assert np.abs(curl / (2.0 * h)).max() < 1e-5


@pytest.mark.parametrize("kind", ["tunnel", "hill"])
def test_a_place_tells_nothing_of_the_gusts_that_share_its_stream(kind: str) -> None:
    """[s, 0] and [s, 1] are also the seeds of turbulence and roll gusts: the rank correlations of
    wind, gusts and change with the mean and the size of a first second's gusts are no more than
    chance makes them."""
    drawn = [_air(np.random.default_rng((s, kind == "hill")), 40.0) for s in range(SEEDS)]
    air = np.array([[wind, intensity, last] for wind, intensity, _, last in drawn])
    if kind == "tunnel":
        turbulence = dryden_params(0.03, 9.0, 1.5, 0.005)
        begun = [turbulence_before(turbulence, s, STEPS - 1) for s in range(SEEDS)]
        states, white = (np.array(each) for each in zip(*begun, strict=True))
        state, blown = DrydenState._make(states.T), []
        for k in range(STEPS):  # of all seeds at once
            state, gust = dryden_step(turbulence, state, *white[:, k].T)
            blown.append(np.array(gust))
    else:
        rolling = roll_gust_params(0.03, 9.0, 1.5, 1.0, 0.005)
        rolls = [roll_gusts_before(rolling, s, STEPS - 1) for s in range(SEEDS)]
        roll, white = (np.array(each) for each in zip(*rolls, strict=True))
        blown = []
        for k in range(STEPS):
            roll = rolling.a * roll + rolling.gain_radps * white[:, k, 0]
            blown.append(roll[None])
    gusts = np.array(blown)  # (steps, axes, seeds)
    sizes = np.sqrt(np.mean(gusts**2, axis=0))
    numbers = np.vstack([air.T, np.mean(gusts, axis=0), sizes])
    apart = np.abs(np.asarray(spearmanr(numbers.T).statistic)[:3, 3:])
    assert apart.shape == ((3, 6) if kind == "tunnel" else (3, 2))
    assert apart.max() < CHANCE


def test_a_normal_number_of_the_bits_of_a_uniform_one_would_be_found() -> None:
    streams = [(np.random.default_rng((s, 0)), np.random.default_rng((s, 0))) for s in range(SEEDS)]
    sizes = [abs(float(first.standard_normal())) for first, _ in streams]
    uniform = [float(second.uniform()) for _, second in streams]
    assert abs(float(spearmanr(sizes, uniform).statistic)) > 1.3 * CHANCE


def hills(count: int) -> list[SearchPlace]:
    return [place("hill", seed) for seed in range(500, 500 + count)]


def test_a_seed_is_one_place() -> None:
    first, again, other = place("hill", 7), place("hill", 7), place("hill", 8)
    assert first.words == again.words != other.words
    assert first.site == again.site
    assert first.sink_factor == again.sink_factor
    assert abs(TUNED_ON - PUBLISHED) >= 1000


def test_places_are_drawn_within_their_ranges() -> None:
    changes = []
    for there in hills(12):
        start = there.site.start
        assert start is not None
        assert there.field.inside(start.x_m, 0.0, start.z_m)
        wind = there.field.wind_at(start.x_m, 0.0, start.z_m, 0.0)[0]
        assert LAUNCH_WIND_MPS[0] <= wind <= LAUNCH_WIND_MPS[1]
        assert 0.9 <= there.sink_factor <= 1.1
        assert CHANGE[0] <= there.change <= CHANGE[1]
        changes.append(there.change)
        late = there.field.wind_at(start.x_m, 0.0, start.z_m, there.duration_s)[0]
        assert late == pytest.approx(wind * there.change)
        assert there.ground.points == 8
    assert 2 <= sum(change != 1.0 for change in changes) <= 10

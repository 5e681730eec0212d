"""Random places: the flow over an ellipse is a potential flow along it, and a seed is one place."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from tgl_soar.air.gusts import dryden_params, dryden_step, roll_gust_params
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
from tgl_soar.sim.white import roll_gusts_before, turbulence_before


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
    """[s, 0] and [s, 1] are also the seeds of turbulence and roll gusts: of 500 seeds the rank
    correlations of wind, gusts and change with the mean and the size of a first second's gusts are
    no more than chance makes them (3.5 standard errors, of 18 and 6 numbers)."""
    turbulence = dryden_params(0.03, 9.0, 1.5, 0.005)
    rolling = roll_gust_params(0.03, 9.0, 1.5, 1.0, 0.005)
    rows = []
    for seed in range(500):
        wind, intensity, _, last = _air(np.random.default_rng((seed, kind == "hill")), 40.0)
        blown: list[tuple[float, ...]] = []
        if kind == "tunnel":
            state, white = turbulence_before(turbulence, seed, 199)
            for k in range(200):
                state, gust = dryden_step(turbulence, state, *white[k])
                blown.append(gust)
        else:
            roll, white = roll_gusts_before(rolling, seed, 199)
            for k in range(200):
                roll = rolling.a * roll + rolling.gain_radps * white[k][0]
                blown.append((roll,))
        found = np.array(blown)
        sizes = np.sqrt(np.mean(found**2, axis=0))
        rows.append([wind, intensity, last, *np.mean(found, axis=0), *sizes])
    apart = np.abs(np.asarray(spearmanr(np.array(rows)).statistic)[:3, 3:])
    assert apart.shape == ((3, 6) if kind == "tunnel" else (3, 2))
    assert apart.max() < 3.5 / 500**0.5


def hills(count: int) -> list[SearchPlace]:
    return [place("hill", seed) for seed in range(500, 500 + count)]


def test_a_seed_is_one_place() -> None:
    first, again, other = place("hill", 7), place("hill", 7), place("hill", 8)
    assert first.words == again.words != other.words
    assert first.site == again.site
    assert first.sink_factor == again.sink_factor
    assert abs(TUNED_ON - PUBLISHED) >= 1000


def test_places_are_what_is_said_of_them() -> None:
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

"""`lift_map`: what is glided through and read, where errors are taken, and how they are judged."""

from __future__ import annotations

from math import hypot, sqrt
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.lift import lift_map as e
from tgl_soar.analysis.search.places import place
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.types import NO_GROUND, Ground, polar_sink

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
BOX = Box(x_min_m=-10.0, x_max_m=10.0, z_min_m=0.0, z_max_m=10.0)
GROUND = Ground(2, (-20.0, 20.0, *[20.0] * 6), (1.0,) * 8)


class Even:
    """The same air everywhere."""

    reference_wind_mps = 8.0

    def __init__(self, wind_mps: float, updraft_mps: float) -> None:
        self.given = wind_mps, 0.0, updraft_mps

    def wind_at(self, *_: float) -> tuple[float, float, float]:
        return self.given

    def wind(self, x: Any, *_: Any) -> Any:
        return tuple(np.full(np.shape(x), each) for each in self.given)


def there(wind_mps: float, updraft_mps: float, gusts: float = 0.0, seed: int = 1) -> Any:
    start = SimpleNamespace(x_m=1.0, z_m=5.0)
    air = SimpleNamespace(turbulence=SimpleNamespace(intensity=gusts))
    return SimpleNamespace(
        seed=seed,
        site=SimpleNamespace(start=start, air=air),
        field=Even(wind_mps, updraft_mps),
        sink_factor=1.1,
        box=BOX,
        ground=GROUND,
    )


class Keeps:
    """A map that keeps what it was given."""

    def __init__(self, ground: Any, box: Any, polar: Any, first: Any, *, pitot: bool) -> None:
        self.made_of = ground, box, polar, first, pitot
        self.taken: list[Any] = []

    def take(self, reading: Any) -> None:
        self.taken.append(reading)


def glided(
    monkeypatch: pytest.MonkeyPatch, at: Any, duration_s: float = 1.0
) -> tuple[Keeps, list[tuple[float, float]]]:
    monkeypatch.setattr(e, "LiftMap", Keeps)
    lift, path = e.glide(at, POLAR, NO_GROUND, duration_s)
    return cast("Keeps", lift), path


def test_a_glide_goes_down_a_line_of_15_degrees_by_the_excess(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """27 cm upstream for each metre up; a reading every 0.2 s, the first at the start."""
    lift, path = glided(monkeypatch, there(9.0, 0.3))
    climb = 0.3 - 1.1 * polar_sink(POLAR, 9.0)
    assert len(path) == len(lift.taken) == 6
    for k, (x_m, z_m) in enumerate(path):
        assert z_m == pytest.approx(5.0 + 0.2 * k * climb)
        assert x_m == pytest.approx(1.0 - 0.27 * 0.2 * k * climb)
    assert len(glided(monkeypatch, there(9.0, 0.3), 4.0)[1]) == 21
    ground, box, polar, first, pitot = lift.made_of
    assert (ground, box, polar, pitot) == (NO_GROUND, BOX, POLAR, True)
    assert first is lift.taken[0]


def test_a_reading_is_of_the_air_the_airspeed_and_the_energy_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lift, path = glided(monkeypatch, there(9.0, 0.3))
    climb = 0.3 - 1.1 * polar_sink(POLAR, 9.0)
    biases = set()
    for reading, (x_m, z_m) in zip(lift.taken, path, strict=True):
        assert (reading.x_m, reading.z_m) == (x_m, z_m)
        assert reading.wind_mps == pytest.approx(9.0)
        assert reading.airspeed_mps == pytest.approx(9.0 + 0.27 * climb)
        sinks = 1.1 * polar_sink(POLAR, 9.0 + 0.27 * climb)
        assert reading.energy_mps == pytest.approx(0.3 - sinks)
        assert reading.since_s == 0.2
        biases.add(round(reading.updraft_mps - 0.3, 9))
    (bias,) = biases  # one for the whole glide
    assert 0.0 < abs(bias) <= 0.06


def test_an_updraft_is_off_by_up_to_6_cm_per_second_to_either_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    off = [
        glided(monkeypatch, there(9.0, 0.3, seed=seed), 0.2)[0].taken[0].updraft_mps - 0.3
        for seed in range(80)
    ]
    assert -0.06 <= min(off) < -0.055
    assert 0.055 < max(off) <= 0.06


def test_gusts_are_a_fraction_of_the_fields_wind_in_each_axis(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mean over a reading: 5 % of 8 m/s, over the square root of two."""
    lift, path = glided(monkeypatch, there(9.0, 0.3, gusts=0.05), 160.0)
    wind = np.array([reading.wind_mps - 9.0 for reading in lift.taken])
    updraft = np.array([reading.updraft_mps for reading in lift.taken])
    sigma = 0.05 * 8.0 / sqrt(2.0)
    assert np.std(wind) == pytest.approx(sigma, rel=0.1)  # of 801 readings: 2.5 %
    assert np.std(updraft) == pytest.approx(sigma, rel=0.1)
    assert abs(np.corrcoef(wind, updraft)[0, 1]) < 0.15
    climb = 0.3 - 1.1 * polar_sink(POLAR, 9.0)
    assert path[-1][1] == pytest.approx(5.0 + 160.0 * climb)  # they do not move it
    for reading in lift.taken[:20]:
        assert reading.airspeed_mps - reading.wind_mps == pytest.approx(0.27 * climb)
        still = 1.1 * polar_sink(POLAR, 9.0 + 0.27 * climb)
        assert reading.energy_mps == pytest.approx(0.3 - still, abs=5.0 * sigma)
    first = lift.taken[0]
    gust_w = first.updraft_mps - np.mean(updraft)
    still = 1.1 * polar_sink(POLAR, 9.0 + 0.27 * climb)
    assert first.energy_mps == pytest.approx(0.3 + gust_w - still, abs=0.03)


# --- where errors are taken -----------------------------------------------------------------------


def test_places_are_those_of_the_box_clear_of_the_ground() -> None:
    """6 % of the box's height over the ground's profile; 30 by 30 of them."""
    x, z, truth = e._nodes(there(9.0, 0.3), POLAR)
    assert z.min() > 1.0 + 0.6
    heights = np.linspace(0.0, 10.0, 30)
    assert sorted(set(z.tolist())) == pytest.approx([h for h in heights if h > 1.6])
    assert len(set(x.tolist())) == 30
    assert (x.min(), x.max(), z.max()) == (-10.0, 10.0, 10.0)
    assert truth == pytest.approx(np.full(len(x), 0.3 - 1.1 * polar_sink(POLAR, 9.0)))


def test_a_profile_is_followed_between_its_points() -> None:
    at = there(9.0, 0.3)
    at.ground = Ground(3, (-10.0, 0.0, 10.0, *[10.0] * 5), (0.0, 0.0, 5.0, *[5.0] * 5))
    x, z, _ = e._nodes(at, POLAR)
    assert np.all(z > np.maximum(0.0, 0.5 * x) + 0.6)
    assert np.any((x > 9.9) & (z < 6.0))
    assert np.any((x < 0.0) & (z < 1.0))


def test_errors_are_gathered_in_rings_about_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each place the mean of squares in each ring, and over the claimed variance."""
    nodes = np.array([0.0, 0.5, 2.0, 4.0, 6.9, 7.0, 9.0])
    path = [(0.0, 5.0), (0.0, 5.0)]

    class Map:
        def at(self, x: Any, _z: Any) -> Any:
            return SimpleNamespace(excess_mps=1.0 + 0.1 * x, excess_sd_mps=np.full(len(x), 0.5))

    monkeypatch.setattr(e, "glide", lambda *_: (Map(), path))
    monkeypatch.setattr(
        e, "_nodes", lambda *_: (nodes, np.full(len(nodes), 5.0), np.ones(len(nodes)))
    )
    inner, middle, outer = e.rings_of([there(9.0, 0.3)] * 2, POLAR, [GROUND] * 2, 1.0)
    for ring, xs in ((inner, [0.0, 0.5]), (middle, [2.0]), (outer, [4.0, 6.9])):
        wanted = float(np.mean([(0.1 * x) ** 2 for x in xs]))
        assert ring.squares == pytest.approx([wanted] * 2)
        assert ring.normalised == pytest.approx([wanted / 0.25] * 2)


def test_distance_is_to_the_nearest_of_the_path_in_both_axes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[Any, float]] = []

    class Map:
        def at(self, x: Any, _z: Any) -> Any:
            return SimpleNamespace(excess_mps=np.asarray(x), excess_sd_mps=np.ones(len(x)))

    def glide(_there: Any, _polar: Any, ground: Any, after_s: float) -> Any:
        asked.append((ground, after_s))
        return Map(), [(0.0, 0.0), (3.0, 4.0)]

    monkeypatch.setattr(e, "glide", glide)
    x, z = np.array([3.0, 0.4, 8.0]), np.array([4.4, 0.2, 9.0])
    monkeypatch.setattr(e, "_nodes", lambda *_: (x, z, np.zeros(3)))
    inner, middle, outer = e.rings_of([there(9.0, 0.3)], POLAR, [GROUND], 4.0)
    assert asked == [(GROUND, 4.0)]
    assert inner.squares == pytest.approx([(9.0 + 0.16) / 2.0])
    assert middle.squares == []
    assert hypot(5.0, 5.0) > 7.0  # farther than the last ring
    assert outer.squares == []


def test_a_ring_that_no_place_lies_in_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(e, "RINGS", ((0.0, 0.1), (5.0, 6.0)))
    _, far = e.rings_of([place("hill", 10_000)], POLAR, [NO_GROUND], 0.2)
    assert (far.squares, far.normalised) == ([], [])


def test_each_map_knows_its_own_of_the_ground() -> None:
    one = there(9.0, 0.3)
    one.ground = Ground(2, (-20.0, 20.0, *[20.0] * 6), (1.0, 2.0, *[2.0] * 6))
    assert e._grounds([one], "as it flies") == [one.ground]
    assert e._grounds([one, one], "without the ground") == [NO_GROUND] * 2
    (low,) = e._grounds([one], "with the ground 20 % too low")
    assert low.z_m == pytest.approx((0.8, 1.6, *[1.6] * 6))
    assert low.x_m == one.ground.x_m


# --- how it is judged -----------------------------------------------------------------------------


def judged(
    monkeypatch: pytest.MonkeyPatch, rings: list[e.Ring], quick: bool = False
) -> tuple[Any, list[tuple[str, int, float]]]:
    asked: list[tuple[str, int, float]] = []
    seeds: list[int] = []

    def drawn(kind: str, seed: int) -> Any:
        seeds.append(seed)
        return SimpleNamespace(kind=kind, ground=GROUND)

    def found(places: list[Any], _polar: Any, _grounds: Any, after_s: float) -> list[e.Ring]:
        asked.append((places[0].kind, len(places), after_s))
        return rings

    monkeypatch.setattr(e, "place", drawn)
    monkeypatch.setattr(e, "rings_of", found)
    result = e.run(Context(Flyer(), quick=quick))
    assert seeds[0] == 1001
    return result, asked


def rings(errors: tuple[float, ...], chi2: float) -> list[e.Ring]:
    """Two places each, one without error."""
    return [e.Ring([0.0, 2.0 * error**2], [0.0, 2.0 * chi2]) for error in errors]


def test_errors_are_held_against_the_prototype_ring_by_ring(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tunnel, hill = (0.14, 0.27, 0.50), (0.14, 0.23, 0.26)
    for errors, wanted in (
        (tuple(0.999 * each for each in hill), [True] * 6),
        (tuple(1.001 * each for each in hill), [False, True, True, False, False, False]),
        (tuple(1.001 * each for each in tunnel), [False] * 6),
    ):
        result, _ = judged(monkeypatch, rings(errors, 1.0))
        of_error = [claim.holds for claim in result.claims if "rms" in claim.text]
        assert of_error == wanted
    assert result.claims[0].text == (
        "tunnel: rms error at 0–0.1 H no more than the prototype's 0.14 m/s"
    )
    assert result.claims[10].text.startswith("hill: rms error at 0.3–0.7 H no more")


def test_chi_squared_may_be_two(monkeypatch: pytest.MonkeyPatch) -> None:
    for chi2, holds in ((1.999, True), (2.001, False)):
        result, _ = judged(monkeypatch, rings((0.1, 0.1, 0.1), chi2))
        of_chi2 = [claim for claim in result.claims if "χ²" in claim.text]
        assert [claim.holds for claim in of_chi2] == [holds] * 6
        assert of_chi2[0].measured == "2.00"
    assert of_chi2[1].text == "tunnel: χ² at 0.1–0.3 H at most 2"


def test_tables_and_numbers_have_a_row_for_each_map(monkeypatch: pytest.MonkeyPatch) -> None:
    result, asked = judged(monkeypatch, rings((0.1, 0.2, 0.3), 0.5))
    tunnel, hill = result.tables
    assert tunnel.title.startswith("tunnel: predicted")
    assert [row[0] for row in hill.rows] == [
        "as it flies", "without the ground", "with the ground 20 % too low",
    ]  # fmt: skip
    assert hill.rows[0][1:] == (
        "0.10 / 0.20 / 0.30", "0.50 / 0.50 / 0.50", "0.50 / 0.50 / 0.50",
    )  # fmt: skip
    assert result.numbers["hill"]["as it flies"] == pytest.approx(
        [(0.1, 0.5), (0.2, 0.5), (0.3, 0.5)]
    )
    assert asked == [("tunnel", 20, 1.0)] * 3 + [("hill", 40, 4.0)] * 3
    assert result.seeds == tuple(range(1001, 1041))
    _, asked = judged(monkeypatch, rings((0.1, 0.2, 0.3), 0.5), quick=True)
    assert asked == [("tunnel", 3, 1.0)] * 3 + [("hill", 3, 4.0)] * 3

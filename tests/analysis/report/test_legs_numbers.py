"""The legs of a flight at each limit, and how well the mean of one is known."""

from __future__ import annotations

from math import cos, isnan, nan, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.air.zeuc import Crossing
from tgl_soar.analysis.logs.flight_data import FlightData, LoggedMode, Series
from tgl_soar.analysis.report import legs
from tgl_soar.analysis.report.legs import (
    FLYING,
    HOLDING_LINE,
    Line,
    holding_line_at,
    legs_of,
    mean_sigma,
    stands,
)

STEP_S = 0.1
LINE: Line = (1.0, 2.0, radians(105.0))

Floats = NDArray[np.float64]


def flight(seconds: float = 10.0, modes: tuple[LoggedMode, ...] = (), **changes: Any) -> FlightData:
    """On a line that stands; changes: of its columns, or of the path's."""
    time = STEP_S * np.arange(float(round(seconds / STEP_S) + 1))
    one = np.ones_like(time)
    line = {
        "x_m": LINE[0] * one,
        "z_m": LINE[1] * one,
        "eta_rad": LINE[2] * one,
        "moving": 0.0 * one,
    }
    path = {"x_m": LINE[0] * one, "y_m": 0.0 * one, "z_m": LINE[1] * one}
    for name, values in changes.items():
        where = path if name in ("path_x_m", "path_z_m") else line
        where[name.removeprefix("path_")] = values
    return FlightData("", "", path=Series(time, path, ""), line=Series(time, line, ""), modes=modes)


def times(seconds: float = 10.0) -> Floats:
    return np.asarray(STEP_S * np.arange(float(round(seconds / STEP_S) + 1)))


# --- where the line stood -----------------------------------------------------------------------


def test_a_line_that_stands_is_one_leg_from_its_first_sample_to_its_last() -> None:
    ((begin, end, line),) = stands(flight())
    assert (begin, end) == pytest.approx((0.0, 10.0))
    assert line == LINE
    assert stands(FlightData("", "")) == []


@pytest.mark.parametrize(("seconds", "count"), [(1.9, 0), (2.1, 1)])
def test_a_stand_of_less_than_two_seconds_is_no_leg(seconds: float, count: int) -> None:
    assert len(stands(flight(seconds))) == count


@pytest.mark.parametrize(("moved_until_s", "begins_s"), [(8.1, []), (7.9, [8.0])])
def test_a_stand_is_as_long_as_it_lasts_however_late_it_begins(
    moved_until_s: float, begins_s: list[float]
) -> None:
    """Of ten seconds the last: 1.8 s of them, or 2.0 s and a hair."""
    moving = np.where(times() < moved_until_s + 0.05, 1.0, 0.0)
    assert [leg[0] for leg in stands(flight(moving=moving))] == pytest.approx(begins_s)


@pytest.mark.parametrize("name", ["x_m", "z_m", "eta_rad"])
@pytest.mark.parametrize(("by", "count"), [(0.9e-4, 1), (1.1e-4, 2), (-1.1e-4, 2)])
def test_a_line_that_goes_elsewhere_is_another_leg(name: str, by: float, count: int) -> None:
    """A tenth of a millimetre, or of a thousandth of a radian, from one sample to the next."""
    first = dict(zip(("x_m", "z_m", "eta_rad"), LINE, strict=True))[name]
    moved: dict[str, Any] = {name: first + np.where(times() > 4.95, by, 0.0)}
    found = stands(flight(**moved))
    assert len(found) == count
    if count == 2:
        assert [leg[:2] for leg in found] == [
            pytest.approx((0.0, 4.9)),
            pytest.approx((5.0, 10.0)),
        ]


def test_while_the_line_moves_or_is_not_known_there_is_no_leg() -> None:
    moving = np.where((times() > 2.95) & (times() < 4.05), 1.0, 0.0)
    assert [leg[:2] for leg in stands(flight(moving=moving))] == [
        pytest.approx((0.0, 2.9)),
        pytest.approx((4.1, 10.0)),
    ]
    lost = np.where((times() > 2.95) & (times() < 4.05), nan, LINE[0])
    assert [leg[0] for leg in stands(flight(x_m=lost))] == pytest.approx([0.0, 4.1])


def test_a_line_is_held_from_the_change_of_mode_on() -> None:
    modes = (LoggedMode(2.0, "soaring"), LoggedMode(6.0, "landing"), LoggedMode(8.0, "capturing"))
    at = np.array([0.0, 1.9, 2.0, 5.9, 6.0, 7.9, 8.0, 50.0])
    held = holding_line_at(flight(modes=modes), at)
    assert held.tolist() == [False, False, True, True, False, False, True, True]
    assert holding_line_at(flight(), at).all()


def test_modes_in_which_a_line_is_held_are_some_of_those_that_fly() -> None:
    assert HOLDING_LINE == ("capturing", "soaring", "holding", "recovering")
    assert set(HOLDING_LINE) < set(FLYING)
    assert not {"ready", "standby", "released", "failed"} & set(FLYING)


# --- what a leg is called -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dx_m", "dz_m", "turned_rad", "is_same"),
    [
        (0.0, 0.0, 0.0, True),
        (0.0049, 0.0, 0.0, True),
        (0.0051, 0.0, 0.0, False),
        (0.004, -0.004, 0.0, False),  # 5.7 mm
        (0.0, 0.0, 0.0099, True),
        (0.0, 0.0, 0.0101, False),
        (0.0, 0.0, -0.0101, False),
    ],
)
def test_a_leg_has_the_name_of_the_sites_line_that_it_lies_on(
    dx_m: float, dz_m: float, turned_rad: float, is_same: bool
) -> None:
    named = {"far": (9.0, 9.0, 1.0), "b": (LINE[0] + dx_m, LINE[1] + dz_m, LINE[2] + turned_rad)}
    (leg,) = legs_of(flight(), named, None)
    assert leg.name == ("b" if is_same else "1")


def test_legs_without_a_name_are_numbered_and_those_without_a_path_left_out() -> None:
    x = LINE[0] + np.where(times(15.0) > 4.95, 0.5, 0.0) + np.where(times(15.0) > 9.95, 0.5, 0.0)
    lost = np.where((times(15.0) > 4.95) & (times(15.0) < 9.95), nan, 1.0)
    found = legs_of(flight(15.0, x_m=x, path_x_m=lost), {}, None)
    assert [leg.name for leg in found] == ["1", "2"]
    assert [leg.begin_s for leg in found] == pytest.approx([0.0, 10.0])
    assert all(leg.place is None and isnan(leg.crossing_sigma_m) for leg in found)
    assert legs_of(FlightData("", "", line=flight().line), {}, None) == []
    assert legs_of(FlightData("", "", path=flight().path), {}, None) == []


@pytest.mark.parametrize(("places", "count"), [(2, 1), (1, 0), (0, 0)])
def test_a_leg_has_two_places_at_least(places: int, count: int) -> None:
    x = np.full_like(times(), nan)
    x[30 : 30 + places] = LINE[0]
    found = legs_of(flight(path_x_m=x), {}, None)
    assert [leg.end_s for leg in found] == pytest.approx([3.1] * count)


# --- how well the mean is known -----------------------------------------------------------------


def test_the_mean_of_white_noise_is_known_to_its_deviation_over_the_root_of_its_number() -> None:
    values = 0.5 * np.random.default_rng(3).standard_normal(4000)
    found = mean_sigma(STEP_S * np.arange(4000.0), values)
    assert found == pytest.approx(0.5 / sqrt(4000.0), rel=0.1)


def test_of_samples_that_say_the_same_one_counts() -> None:
    """Each of 2000 numbers held for ten samples; a triangle of correlation, of ten samples."""
    numbers = np.random.default_rng(4).standard_normal(2000)
    found = mean_sigma(STEP_S * np.arange(20000.0), np.repeat(numbers, 10))
    assert found == pytest.approx(1.0 / sqrt(2000.0), rel=0.15)


def test_a_signal_that_keeps_its_memory_is_one_sample() -> None:
    time = STEP_S * np.arange(200.0)
    slow = np.cos(np.pi * time / 20.0)  # half a turn: one sample of it, or a few
    assert 0.3 * slow.std() < mean_sigma(time, slow) <= slow.std()
    assert mean_sigma(time, np.full(200, 3.0)) == 0.0
    alternating = np.where(np.arange(200) % 2, 1.0, -1.0)
    assert mean_sigma(time, alternating) == pytest.approx(1.0 / sqrt(200.0))


@pytest.mark.parametrize(("count", "known"), [(7, False), (8, True)])
def test_a_few_samples_or_no_time_say_nothing(count: int, known: bool) -> None:
    values = np.random.default_rng(5).standard_normal(count)
    assert isnan(mean_sigma(STEP_S * np.arange(float(count)), values)) is not known
    assert isnan(mean_sigma(np.zeros(20), np.arange(20.0)))


@pytest.mark.parametrize(
    ("along_m", "across_m"), [(1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, 0.8), (0.0, 0.0)]
)
def test_a_distance_is_known_as_well_as_the_mean_in_its_direction(
    monkeypatch: pytest.MonkeyPatch, along_m: float, across_m: float
) -> None:
    """Scattering by 2 cm along the line, by 1 cm across: white, of the last seconds' samples."""
    count = 300
    random = np.random.default_rng(6)
    c, s = cos(LINE[2]), sin(LINE[2])
    along, across = (
        size * (noise - noise[-81:].mean())
        for size, noise in zip((0.02, 0.01), random.standard_normal((2, count)), strict=True)
    )
    x = LINE[0] + c * along - s * across
    z = LINE[1] + s * along + c * across
    place = (LINE[0] - along_m * c + across_m * s, LINE[1] - along_m * s - across_m * c)
    crossing = Crossing._make(
        {"x_m": place[0], "z_m": place[1]}.get(name, nan) for name in Crossing._fields
    )
    monkeypatch.setattr(legs, "stable_crossing", lambda *_: crossing)
    air: Any = (None, None)
    seconds = (count - 1) * STEP_S
    (leg,) = legs_of(flight(seconds, path_x_m=x, path_z_m=z), {}, air)
    assert leg.place == pytest.approx(place)
    time = times(seconds)[-81:]
    sigmas = mean_sigma(time, along[-81:]), mean_sigma(time, across[-81:])
    assert sigmas[0] > 1.3 * sigmas[1] > 0.0
    way = (along_m, across_m) if along_m or across_m else (1.0, 1.0)
    assert leg.crossing_sigma_m == pytest.approx(
        np.hypot(sigmas[0] * way[0], sigmas[1] * way[1]), rel=1e-6
    )

"""Panels: the level ground beyond a profile, one panel's flow, and what counts as ground."""

from __future__ import annotations

from math import atan2, log, pi

import numpy as np
import pytest

from tgl_soar.air.panels import PanelField, _growing, _with_level_ground

WIND = 8.0
# A ramp that rises by five metres on ten, and level ground behind it.
X, Z = np.array([0.0, 2.0, 4.0, 8.0, 12.0]), np.array([0.0, 1.0, 2.0, 4.0, 4.0])


def test_beyond_the_profile_the_ground_is_level_for_thirty_of_its_lengths() -> None:
    """Twelve metres long: 360 m to either side, and less than a panel more."""
    x, z = _with_level_ground(X, Z)
    before, after = np.flatnonzero(x < 0.0), np.flatnonzero(x > 12.0)
    assert (z[before] == 0.0).all()
    assert (z[after] == 4.0).all()
    inner = slice(len(before), len(x) - len(after))
    assert x[inner].tolist() == X.tolist()
    assert z[inner].tolist() == Z.tolist()
    assert (np.diff(x) > 0.0).all()
    # The last panel but one ends before that, the last one behind it.
    assert x[1] > -360.0 >= x[0]
    assert x[-2] < 372.0 <= x[-1]


def test_panels_grow_by_three_tenths_with_the_distance() -> None:
    x, _ = _with_level_ground(X, Z)
    steps = np.diff(x)
    count = int(np.sum(x < 0.0))
    before, after = steps[:count][::-1], steps[count + 4 :]
    # The first is as long as its neighbour in the profile.
    assert (before[0], after[0]) == pytest.approx((2.0, 4.0))
    assert before[1:] / before[:-1] == pytest.approx(1.3)
    assert after[1:] / after[:-1] == pytest.approx(1.3)


@pytest.mark.parametrize(
    ("first_m", "reach_m", "ends"),
    [(1.0, 0.5, [1.0]), (1.0, 0.99, [1.0]), (1.0, 1.1, [1.0, 2.3]), (2.0, 7.9, [2.0, 4.6, 7.98]),
     (1.0, 4.0, [1.0, 2.3, 3.99, 6.187])],
)  # fmt: skip
def test_there_are_no_more_panels_than_reach_so_far(
    first_m: float, reach_m: float, ends: list[float]
) -> None:
    assert _growing(first_m, reach_m) == pytest.approx(ends)


def test_one_panel_blows_as_its_equation_says() -> None:
    """By its strength along and across, with the place in the panel's own axes by hand."""
    field = PanelField(X, Z, WIND)
    n = int(np.flatnonzero(np.abs(field._x0 - 4.0) < 1e-9)[0])  # from (4, 2) to (8, 4)
    length = 20.0**0.5
    assert field._length[n] == pytest.approx(length)
    along, up = np.array([2.0, 1.0]) / 5.0**0.5, np.array([-1.0, 2.0]) / 5.0**0.5
    for place in ((1.0, 7.0), (5.0, 6.0), (9.0, 5.0), (4.0, 9.0)):
        away = np.array(place) - (4.0, 2.0)
        t, q = float(away @ along), float(away @ up)
        kt = log((t**2 + q**2) / ((t - length) ** 2 + q**2)) / (4.0 * pi)
        kn = (atan2(q, t - length) - atan2(q, t)) / (2.0 * pi)
        unit = field._unit_winds(np.array([place[0]]), np.array([place[1]]))
        assert [unit[0][0, n], unit[1][0, n]] == pytest.approx(list(kt * along + kn * up))


def test_no_air_goes_through_the_middle_of_any_panel() -> None:
    field = PanelField(X, Z, WIND)
    x = np.concatenate([field._x0, [field._x0[-1] + field._length[-1]]])
    _, z = _with_level_ground(X, Z)
    middle_x, middle_z = 0.5 * (x[1:] + x[:-1]), 0.5 * (z[1:] + z[:-1])
    rise = np.diff(z) / np.diff(x)
    above = 1e-9 * field._length
    u, _, w = field.wind(middle_x - above * rise, 0.0, middle_z + above)
    assert (w - u * rise) / np.hypot(1.0, rise) == pytest.approx(0.0, abs=1e-6)
    assert u.min() > 0.0


def test_far_away_the_wind_is_the_free_one() -> None:
    field = PanelField(X, Z, WIND)
    u, v, w = field.wind_at(6.0, 0.0, 5000.0, 0.0)
    # What the ramp adds falls as that of a source of 8 m/s · 4 m: 32 / (pi · 5000) = 0.002 m/s.
    assert (u, v, w) == pytest.approx((WIND, 0.0, 0.0), abs=0.01)
    assert field.reference_wind_mps == WIND


def test_a_wind_twice_as_strong_is_twice_the_field() -> None:
    one, two = PanelField(X, Z, WIND), PanelField(X, Z, 2.0 * WIND)
    assert two.wind_at(3.0, 0.0, 4.0, 0.0) == pytest.approx(
        tuple(2.0 * part for part in one.wind_at(3.0, 0.0, 4.0, 0.0))
    )


def test_more_places_than_are_worked_out_at_once_are_as_few() -> None:
    field = PanelField([0.0, 10.0, 20.0], [0.0, 3.0, 0.0], WIND)
    x = np.linspace(-20.0, 40.0, 9000)
    u, v, w = field.wind(x, 0.0, 6.0)
    some = [0, 4095, 4096, 4097, 8191, 8192, 8999]
    one = np.array([field.wind_at(float(x[n]), 0.0, 6.0, 0.0) for n in some])
    assert np.column_stack([u[some], v[some], w[some]]) == pytest.approx(one, abs=1e-12)


def test_places_have_the_shape_that_they_are_given_in() -> None:
    field = PanelField(X, Z, WIND)
    x, z = np.array([[1.0], [3.0], [6.0]]), np.array([5.0, 6.0])
    u, v, w = field.wind(x, 0.0, z)
    assert u.shape == v.shape == w.shape == (3, 2)
    assert (u[2, 1], v[2, 1], w[2, 1]) == pytest.approx(field.wind_at(6.0, 0.0, 6.0, 0.0))


def test_the_ground_is_a_line_from_point_to_point_and_level_beyond() -> None:
    field = PanelField(X, Z, WIND)
    assert field.ground_m([-5.0, 0.0, 1.0, 6.0, 10.0, 50.0]).tolist() == [
        0.0, 0.0, 0.5, 3.0, 4.0, 4.0,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("x", "z", "is_inside"),
    [(0.0, 0.0, True), (12.0, 4.0, True), (6.0, 3.0, True), (6.0, 2.9, False),
     (-0.1, 5.0, False), (12.1, 5.0, False), (1.0, 0.6, True), (1.0, 0.4, False)],
)  # fmt: skip
def test_inside_is_above_the_profile_and_between_its_ends(
    x: float, z: float, is_inside: bool
) -> None:
    assert PanelField(X, Z, WIND).inside(x, 7.0, z) is is_inside


def test_on_the_ground_there_is_wind_and_below_it_none() -> None:
    field = PanelField(X, Z, WIND)
    assert field.wind_at(-3.0, 0.0, 0.0, 0.0)[0] > 1.0
    assert field.wind_at(-3.0, 0.0, -1e-6, 0.0) == (0.0, 0.0, 0.0)
    assert field.wind_at(15.0, 0.0, 3.9, 0.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("x", "z", "words"),
    [
        ([[0.0, 1.0]], [[0.0, 1.0]], r"profile of shapes \(1, 2\) and \(1, 2\): two points"),
        ([0.0, 1.0], [0.0, 1.0, 2.0], r"shapes \(2,\) and \(3,\)"),
        ([0.0, float("inf")], [0.0, 1.0], "must be finite"),
        ([0.0, 2.0, 1.0], [0.0, 1.0, 2.0], "grow in x from point to point"),
    ],
)
def test_what_is_no_line_of_points_is_refused(x: object, z: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        PanelField(x, z, WIND)  # type: ignore[arg-type]


@pytest.mark.parametrize("wind", [0.0, -8.0, float("inf"), float("nan")])
def test_a_wind_that_is_none_is_refused_by_its_number(wind: float) -> None:
    with pytest.raises(ValueError, match=f"wind {wind} m/s: must be positive"):
        PanelField(X, Z, wind)


def test_two_points_are_a_profile_and_any_wind_that_blows_will_do() -> None:
    assert PanelField([0.0, 1.0], [0.0, 0.0], 0.5).wind_at(0.5, 0.0, 1.0, 0.0) == pytest.approx(
        (0.5, 0.0, 0.0)
    )

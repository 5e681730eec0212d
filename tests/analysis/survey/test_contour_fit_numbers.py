"""The parts of a contour's fit one by one: hats, what parts foretell, correlated residuals, the
lag, the posterior, and from where to where a survey went both ways."""

from __future__ import annotations

from math import exp, sqrt
from typing import Any

import numpy as np
import pytest
from slid_contour import ETA, flown

from tgl_soar.analysis.survey import contour_fit as module
from tgl_soar.analysis.survey.contour_fit import (
    KNOTS,
    PARTS,
    WIDTHS,
    DrawnContour,
    SurveyError,
    drawn_contour,
)

KNOTS_AT = np.linspace(0.0, 2.0, KNOTS)


# --- pieces of the fit ----------------------------------------------------------------------------


def test_a_place_between_two_knots_belongs_to_both_by_its_distance() -> None:
    knots = np.array([0.0, 0.5, 1.0])
    found = module._hats(np.array([0.0, 0.1, 0.5, 0.9, 1.0]), knots)
    assert found == pytest.approx(
        np.array([[1, 0, 0], [0.8, 0.2, 0], [0, 1, 0], [0, 0.2, 0.8], [0, 0, 1]])
    )


def test_residuals_are_alike_up_to_the_first_that_are_not() -> None:
    """Of a row of constant sign blocks of three, by hand: correlations 4/6 … of the whole sum."""
    left = np.array([1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
    lag_1 = float(left[:-1] @ left[1:]) / 12.0  # 6 pairs alike, 5 not
    assert lag_1 == pytest.approx(1.0 / 12.0)
    # The next are opposite; they end the sum, and what comes behind them does not count.
    assert module._alike(left) == pytest.approx(1.0 + 2.0 * lag_1)
    assert module._alike(np.array([1.0, -1.0] * 6)) == 1.0
    # A quarter of the length is summed at most: of 12, lags 1 and 2.
    ones = np.ones(12)
    assert module._alike(ones) == pytest.approx(1.0 + 2.0 * (11.0 + 10.0) / 12.0)


def test_a_part_is_predicted_by_the_others() -> None:
    """One knot's height, which each part alone has: by hand, the mean of the other nine."""
    time_s = np.arange(20.0)
    y = np.repeat(np.arange(10.0), 2)  # two samples a part, of 10 parts
    hats = np.ones((20, 1))
    found = module._prediction_error(hats, y, time_s, np.zeros((1, 1)))
    others = [(45.0 - n) / 9.0 for n in range(PARTS)]
    expected = np.mean([(n - mean) ** 2 for n, mean in enumerate(others)])
    assert found == pytest.approx(expected, rel=1e-6)
    # With a penalty on it the others foretell less: of 18 samples and a ridge of 18 the half.
    halved = module._prediction_error(hats, y, time_s, np.full((1, 1), 18.0))
    assert halved == pytest.approx(
        np.mean([(n - 0.5 * mean) ** 2 for n, mean in enumerate(others)]), rel=1e-6
    )


def test_an_aircraft_is_late_by_what_drove_it_and_it_has_not_come_back_from() -> None:
    """A line that moves by 0.1 m along a slope of 2 a step of 0.5 s, then stands."""
    knots = np.array([0.0, 1.0, 2.0])
    slope = np.array([2.0, 2.0, 2.0])
    moved = np.array([0.7, 0.1, 0.1, 0.0])  # what stands at the first counts for nothing
    line: Any = module._Slid(
        time_s=np.array([3.0, 3.5, 4.0, 5.0]), q=np.array([0.0, 0.1, 0.2, 0.2]),
        along=np.zeros(4), moved=moved, inside=np.ones(4, dtype=bool),
    )  # fmt: skip
    found = module._late(line, knots, slope, 0.8)
    kept = exp(-0.4)
    late_1 = -0.2
    late_2 = kept * late_1 - 0.2
    assert found == pytest.approx([0.0, late_1, late_2, exp(-0.8) * late_2])
    steeper = module._late(line, knots, np.array([1.0, 3.0, 3.0]), 0.8)
    assert steeper[1] == pytest.approx(-0.1 * 1.2)  # the slope between the knots


def slid(y: Any, q: Any, time_s: Any = None) -> Any:
    return module._Slid(
        time_s=np.arange(float(len(q))) if time_s is None else time_s, q=q, along=y,
        moved=np.zeros(len(q)), inside=np.ones(len(q), dtype=bool),
    )  # fmt: skip


def noisy() -> Any:
    random = np.random.default_rng(3)
    q = np.tile(np.concatenate([np.linspace(0.0, 2.0, 100), np.linspace(2.0, 0.0, 100)]), 2)
    return slid(-0.6 * q - 0.25 * q * q + 0.02 * random.standard_normal(len(q)), q)


def test_a_parabola_costs_nothing() -> None:
    q = np.linspace(0.0, 2.0, 300)
    parabola = 0.3 - 0.6 * KNOTS_AT - 0.25 * KNOTS_AT**2
    # What a broken line through the parabola has at the samples is fitted whatever the width.
    found = module._fitted(slid(np.interp(q, KNOTS_AT, parabola), q), KNOTS_AT, 0.0 * q, (48.0,))
    assert found.f == pytest.approx(parabola, abs=1e-4)  # mu is 1e11: rounding
    assert found.left < 1e-4


def test_f_and_its_sigma_are_those_of_the_penalised_least_squares() -> None:
    """The penalty mu on third differences, mu the width's sixth power times the samples at a knot;
    variance times alike over free residuals, by the posterior covariance."""
    made, late = noisy(), np.full(400, 0.01)
    found = module._fitted(made, KNOTS_AT, late, (12.0,))
    hats = module._hats(made.q, KNOTS_AT)
    mu = 400.0 / KNOTS * 12.0**6
    third = np.zeros((KNOTS - 3, KNOTS))
    for row in range(KNOTS - 3):
        third[row, row : row + 4] = (-1.0, 3.0, -3.0, 1.0)
    stacked = np.vstack([hats, sqrt(mu) * third])
    wanted = np.concatenate([made.along - 0.01, np.zeros(KNOTS - 3)])
    f = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
    assert found.f == pytest.approx(f, abs=1e-7)
    left = made.along - 0.01 - hats @ f
    assert found.left == pytest.approx(sqrt(float(np.mean(left**2))), rel=1e-6)
    inverse = np.linalg.inv(hats.T @ hats + mu * third.T @ third)
    alike = module._alike(left)
    free = 1.0 - float(np.trace(hats @ inverse @ hats.T)) * alike / 400.0
    assert free > 0.5
    variance = float(np.mean(left**2)) * alike / free
    assert found.sigma == pytest.approx(np.sqrt(variance * np.diag(inverse)), rel=1e-4)
    assert found.width == 12.0
    penalty = mu * third.T @ third
    reported = module._prediction_error(hats, made.along - 0.01, made.time_s, penalty)
    assert found.prediction_error == pytest.approx(reported)


def test_the_width_is_that_which_foretells_best() -> None:
    made = noisy()
    each = {w: module._fitted(made, KNOTS_AT, 0.0 * made.q, (w,)).prediction_error for w in WIDTHS}
    found = module._fitted(made, KNOTS_AT, 0.0 * made.q, WIDTHS)
    assert found.width == min(each, key=lambda width: each[width])
    assert found.prediction_error == pytest.approx(min(each.values()))


def test_residuals_that_are_all_followed_leave_a_tenth_of_them_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 300 samples 95 are alike each: a parabola follows three, and hardly one is left."""
    monkeypatch.setattr(module, "_alike", lambda _left: 95.0)
    q = np.linspace(0.0, 2.0, 300)
    drift = 0.1 * np.sin(np.linspace(0.0, 3.0 * np.pi, 300))
    found = module._fitted(slid(drift, q), KNOTS_AT, 0.0 * q, (48.0,))
    hats = module._hats(q, KNOTS_AT)
    bend = np.diff(np.eye(KNOTS), 3, axis=0)
    inverse = np.linalg.inv(hats.T @ hats + 300.0 / KNOTS * 48.0**6 * bend.T @ bend)
    assert 1.0 - float(np.trace(hats.T @ hats @ inverse)) * 95.0 / 300.0 < 0.1
    variance = float(np.mean((drift - hats @ found.f) ** 2)) * 95.0 / 0.1
    assert found.sigma == pytest.approx(np.sqrt(variance * np.diag(inverse)), rel=1e-3)


# --- what was passed both ways --------------------------------------------------------------------


def covered(down: Any, up: Any, step_s: float = 1.0) -> tuple[float, float]:
    q = np.concatenate([down, up])
    upstream = np.arange(len(q)) >= len(down)
    return module._covered(step_s * np.arange(float(len(q))), q, upstream)


def test_the_piece_is_that_which_both_ways_passed() -> None:
    down, up = np.linspace(0.0, -2.0, 30), np.linspace(-1.5, 1.0, 30)
    assert covered(down, up) == (-1.5, 0.0)
    assert covered(up, down) == (-1.5, 0.0)


@pytest.mark.parametrize("way", ["downstream", "upstream"])
@pytest.mark.parametrize(("seconds", "enough"), [(9.9, False), (10.1, True)])
def test_ten_seconds_of_each_way_are_needed(way: str, seconds: float, enough: bool) -> None:
    """Twelve steps of the long way, and as many as that of the other."""
    short, long = np.linspace(0.0, 1.0, 12), np.linspace(0.0, 1.0, 30)
    # Of the first way a step belongs to the sample that ends it: one less than it has samples.
    step_s = seconds / (11.0 if way == "downstream" else 12.0)
    ways = (short, long) if way == "downstream" else (long, short)
    if enough:
        assert covered(*ways, step_s) == (0.0, 1.0)
    else:
        with pytest.raises(SurveyError, match=rf"^10 s of survey on the way {way}: 10 s and more"):
            covered(*ways, step_s)


def test_a_way_that_was_not_flown_has_no_seconds() -> None:
    with pytest.raises(SurveyError, match=r"^0 s of survey on the way upstream"):
        covered(np.linspace(0.0, 1.0, 30), np.zeros(0))


@pytest.mark.parametrize(("length_m", "enough"), [(0.099, False), (0.101, True)])
def test_ten_centimetres_passed_both_ways_are_needed(length_m: float, enough: bool) -> None:
    down, up = np.linspace(0.0, -2.0, 30), np.linspace(-length_m, 1.0, 30)
    if enough:
        assert covered(down, up) == (-length_m, 0.0)
    else:
        with pytest.raises(SurveyError, match=r"^0\.10 m of the way were passed both ways: 0\.1 m"):
            covered(down, up)
    with pytest.raises(SurveyError, match=r"^0\.00 m of the way"):
        covered(np.linspace(-1.0, -2.0, 30), np.linspace(0.0, 1.0, 30))


# --- the whole ------------------------------------------------------------------------------------


def test_a_contours_length_is_along_it() -> None:
    made = DrawnContour(
        x_m=np.array([0.0, 3.0, 3.0]), z_m=np.array([0.0, 4.0, 6.0]), sigma_m=np.zeros(3),
        return_per_s=0.4, late_m=0.0, drift_m=0.0,
    )  # fmt: skip
    assert made.length_m == pytest.approx(7.0)


def test_samples_that_are_not_known_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """One rate, one width and one pass: what differs is the samples alone."""
    monkeypatch.setattr(module, "RETURNS_PER_S", (0.8,))
    monkeypatch.setattr(module, "WIDTHS", (16.0,))
    monkeypatch.setattr(module, "TIMES", 1)
    path = flown(0.8)
    kept = np.arange(len(path.time_s)) % 7 != 3
    names = ("time_s", "x_m", "z_m", "line_x_m", "line_z_m", "standing")
    thinner = path._replace(**{name: getattr(path, name)[kept] for name in names})
    columns = {name: getattr(path, name).copy() for name in names}
    for name in names[1:5]:  # each lacks some of them
        columns[name][np.flatnonzero(~kept)[names.index(name) :: 4]] = np.nan
    columns["x_m"][~kept] = np.nan
    one, other = drawn_contour(thinner), drawn_contour(path._replace(**columns))
    assert other.x_m == pytest.approx(one.x_m)
    assert other.sigma_m == pytest.approx(one.sigma_m)
    assert other.late_m == pytest.approx(one.late_m)
    # The contour lies in the frame again: s along the line, q across it.
    q = np.cos(ETA) * one.z_m - np.sin(ETA) * one.x_m
    s = np.cos(ETA) * one.x_m + np.sin(ETA) * one.z_m
    assert np.diff(q) == pytest.approx(np.full(KNOTS - 1, np.ptp(q) / (KNOTS - 1)))
    assert s == pytest.approx(-0.6 * q - 0.25 * q * q, abs=0.02)
    assert one.drift_m < 0.02
    # Behind by q' f' / lambda while it slides.
    assert one.late_m == pytest.approx(0.06 * 0.6 / 0.8, rel=0.5)

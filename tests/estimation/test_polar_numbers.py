"""The polar's numbers by matrices: its coefficients and errors, its family, and each limit of what
a table or a window of a log may be, from both sides."""

from __future__ import annotations

from contextlib import suppress
from math import nan, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from tgl_soar.estimation.polar import (
    GlideStretch,
    best_glide_speed,
    fit_polar,
    fit_polar_family,
    glides_from_log,
    sink_band,
    sink_standard_error,
)
from tgl_soar.types import GRAVITY_MPS2, GlidePolar

Numbers = NDArray[np.float64]
SPEED: Numbers = np.array([7.5, 8.0, 8.6, 9.0, 9.7, 10.5, 11.2, 12.0, 13.0])
NOISE: Numbers = np.array([3.0, -2.0, -4.0, 5.0, 1.0, -3.0, 2.0, -4.0, 2.0]) * 1e-3
SINK: Numbers = 0.5 + 0.02 * (SPEED - 8.5) ** 2 + 0.002 * (SPEED - 8.5) ** 3 + NOISE


def by_matrices(columns: Numbers, sink: Numbers) -> tuple[Numbers, Numbers]:
    """Coefficients, and their covariance."""
    inverse = np.linalg.inv(columns.T @ columns)
    found = inverse @ columns.T @ sink
    left = sink - columns @ found
    return found, inverse * float(left @ left) / (len(sink) - columns.shape[1])


# --- a table ------------------------------------------------------------------------------------


def test_coefficients_errors_and_residuals_are_those_of_the_normal_equations() -> None:
    fit = fit_polar(SPEED.tolist(), SINK.tolist())
    # About the middle, where powers are told apart, and written out by numpy.
    found, covariance = by_matrices(np.vander(SPEED - 10.0, 4, increasing=True), SINK)
    plain = np.polynomial.Polynomial(found)(np.polynomial.Polynomial([-10.0, 1.0])).coef
    assert tuple(fit.polar)[:4] == pytest.approx(tuple(plain), rel=1e-6)
    assert tuple(fit.polar)[4:] == (7.5, 13.0)
    turn = np.array([
        [1.0, -10.0, 100.0, -1000.0], [0.0, 1.0, -20.0, 300.0], [0.0, 0.0, 1.0, -30.0],
        [0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip
    errors = np.sqrt(np.diag(turn @ covariance @ turn.T))
    assert fit.standard_errors == pytest.approx(tuple(errors), rel=1e-6)
    left = SINK - np.polynomial.Polynomial(found)(SPEED - 10.0)
    assert fit.residuals_mps == pytest.approx(tuple(left), abs=1e-9)
    assert fit.residual_max_mps == pytest.approx(np.abs(left).max())
    assert fit.residual_rms_mps == pytest.approx(sqrt(float(left @ left) / 5.0))
    assert (fit.degrees_of_freedom, fit.speeds) == (5, 9)
    assert (fit.centre_mps, fit.scale_mps) == (10.25, 2.75)


def test_a_fourth_power_that_a_cubic_leaves_out_is_the_difference_of_both_fits() -> None:
    fit = fit_polar(SPEED.tolist(), SINK.tolist())
    scaled = (SPEED - 10.25) / 2.75
    three, four = (np.polynomial.Polynomial.fit(scaled, SINK, n, domain=[-1, 1]) for n in (3, 4))
    for u in (7.5, 8.2, 10.0, 12.9):
        s = (u - 10.25) / 2.75
        beyond = sum(c * s**k for k, c in enumerate(fit.left_out))
        assert beyond == pytest.approx(float(four(s) - three(s)), abs=1e-9)
        error = sink_standard_error(fit, u)
        t = float(stats.t.ppf(0.95, 5))  # 0.9 in the middle
        middle = float(three(s))
        half = sqrt((t * error) ** 2 + beyond**2 + (0.01 * middle) ** 2)
        assert sink_band(fit, u, 0.9) == pytest.approx((middle - half, middle + half), rel=1e-4)
    usual = sink_band(fit, 9.0)
    assert usual == sink_band(fit, 9.0, 0.95)


def test_a_slowest_glide_may_be_the_one_of_least_sink_where_that_is_known() -> None:
    rising = (0.3 + 0.03 * SPEED + NOISE).tolist()
    fit = fit_polar(SPEED.tolist(), rising, to_the_slowest=True)
    assert fit.min_sink_speed_mps == 7.5
    with pytest.raises(ValueError, match="it grows from the slowest glide on; add slower glides"):
        fit_polar(SPEED.tolist(), rising)
    # Where there is a minimum it is found all the same.
    assert fit_polar(SPEED.tolist(), SINK.tolist(), to_the_slowest=True) == fit_polar(
        SPEED.tolist(), SINK.tolist()
    )


@pytest.mark.parametrize(("fastest", "taken"), [(1.149, False), (1.151, True)])
def test_the_fastest_is_faster_by_three_twentieths(fastest: float, taken: bool) -> None:
    speed = np.linspace(8.0, 8.0 * fastest, 9)
    sink = (0.5 + 0.05 * (speed - 9.0) ** 2).tolist()
    if taken:
        assert fit_polar(speed.tolist(), sink).speeds == 9
    else:
        with pytest.raises(ValueError, match=r"between 8\.00 and 9\.19 m/s; the fastest must"):
            fit_polar(speed.tolist(), sink)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ((99.9, 0.5), ""), ((100.0, 0.5), r"glide 2 has speed 100\.0 m/s: must be from 0 to 100"),
        ((0.0, 0.5), r"glide 2 has speed 0\.0 m/s"), ((9.0, 0.0), r"glide 2 has sink 0\.0 m/s"),
        ((9.0, 9.0), r"glide 2 sinks 9\.0 m/s at 9\.0 m/s: steeper than 45"),
        ((nan, 0.5), r"glide 2 is \(nan, 0\.5\): not finite"),
        ((9.0, nan), r"glide 2 is \(9\.0, nan\): not finite"),
    ],
)  # fmt: skip
def test_a_glide_is_refused_by_its_row(row: tuple[float, float], words: str) -> None:
    speed, sink = SPEED.tolist(), SINK.tolist()
    speed[2], sink[2] = row
    with pytest.raises(ValueError, match=words or "polar: "):
        fit_polar(speed, sink)


def test_the_best_glide_is_where_a_line_from_nothing_touches_the_polar() -> None:
    polar = GlidePolar(c0=2.0, c1=-0.4, c2=0.03, c3=0.0, speed_min_mps=7.0, speed_max_mps=12.0)
    assert best_glide_speed(polar) == pytest.approx(sqrt(2.0 / 0.03))
    at = sqrt(2.0 / 0.03)
    for low, high, inside in (
        (at - 0.01, 12.0, True), (at + 0.01, 12.0, False), (7.0, at + 0.01, True),
        (7.0, at - 0.01, False),
    ):  # fmt: skip
        found = best_glide_speed(polar._replace(speed_min_mps=low, speed_max_mps=high))
        assert (found == found) is inside


# --- a family -----------------------------------------------------------------------------------


BRAKE: Numbers = np.array([0.0, 0.5, 1.0, 0.0, 0.25, 0.75, 1.0, 0.0, 0.5])
BRAKED: Numbers = SINK + 4e-4 * BRAKE * SPEED**3


def family(brake: Numbers = BRAKE, sink: Numbers = BRAKED) -> Any:
    return fit_polar_family(SPEED.tolist(), sink.tolist(), brake.tolist())


def test_the_brake_of_a_family_and_its_error_are_those_of_the_normal_equations() -> None:
    columns = np.column_stack([np.vander(SPEED - 10.0, 4, increasing=True), BRAKE * SPEED**3])
    found, covariance = by_matrices(columns, BRAKED)
    fitted = family()
    assert fitted.brake_sink == pytest.approx(found[4], rel=1e-6)
    assert fitted.brake_sink_error == pytest.approx(sqrt(covariance[4, 4]), rel=1e-6)
    clean = fit_polar(SPEED.tolist(), (BRAKED - found[4] * BRAKE * SPEED**3).tolist())
    assert tuple(fitted.fit.polar) == pytest.approx(tuple(clean.polar), rel=1e-6)


@pytest.mark.parametrize(("brake", "taken"), [(-0.021, False), (-0.019, True), (1.019, True),
                                              (1.021, False)])  # fmt: skip
def test_a_brake_is_from_nothing_to_all_of_it(brake: float, taken: bool) -> None:
    given = BRAKE.copy()
    given[4] = brake
    if taken:
        assert family(given, SINK + 4e-4 * given * SPEED**3).brake_sink == pytest.approx(4e-4, 0.1)
    else:
        with pytest.raises(ValueError, match=rf"glide 4 has brake {brake}: must be from 0 to 1"):
            family(given)


@pytest.mark.parametrize(("span", "taken"), [(0.24, False), (0.26, True)])
def test_a_brake_has_to_have_moved(span: float, taken: bool) -> None:
    given = span * BRAKE
    sink = SINK + 4e-4 * given * SPEED**3
    if taken:
        assert family(given, sink).brake_sink > 0.0
    else:
        with pytest.raises(ValueError, match=r"stays within 0\.00 and 0\.24; glide with it"):
            family(given, sink)


def test_a_brake_that_lifts_is_refused_and_so_are_too_few_glides() -> None:
    with pytest.raises(ValueError, match="with the brake out it sinks less"):
        family(sink=SINK - 1e-4 * BRAKE * SPEED**3)
    with pytest.raises(ValueError, match="9 glides and 8 brakes: one each"):
        fit_polar_family(SPEED.tolist(), BRAKED.tolist(), BRAKE.tolist()[:8])
    five = [each[:5].tolist() for each in (SPEED, BRAKED, BRAKE)]
    with pytest.raises(ValueError, match="5 glides are too few for a family: fly six or more"):
        fit_polar_family(*five)


# --- a log --------------------------------------------------------------------------------------


def log(seconds: float = 2.0, rate_hz: float = 10.0, **changed: Any) -> dict[str, Any]:
    """One window of a steady glide: 10 m/s, 0.5 m/s down."""
    time = np.arange(0.0, seconds - 1e-9, 1.0 / rate_hz)
    columns = {
        "time_s": time,
        "pitch_rad": np.full_like(time, -0.05),
        "speed_mps": np.full_like(time, 10.0),
        "climb_mps": np.full_like(time, -0.5),
        "brake": np.full_like(time, 0.25),
    }
    return {**columns, **changed}


def glides(**columns: Any) -> tuple[GlideStretch, ...]:
    """None where no window is steady."""
    with suppress(ValueError):
        return glides_from_log(**columns)
    with pytest.raises(ValueError, match="is a steady glide"):
        glides_from_log(**columns)
    return ()


def test_a_steady_window_is_its_means() -> None:
    [glide] = glides(**log())
    assert tuple(glide) == pytest.approx((-0.05, 10.0, 0.5, 1.9, 0.25))
    columns = log()
    columns.pop("brake")
    assert glides(**columns)[0].brake == 0.0
    assert len(glides(**log(8.0))) == 4
    assert len(glides(**log(8.0), window_s=4.0)) == 2


@pytest.mark.parametrize("slope", [0.19, -0.19, 0.0])
def test_speed_that_changes_is_taken_out_by_the_energy_height(slope: float) -> None:
    """Along the path, of which 0.5 m/s down is hardly any."""
    columns = log()
    t = columns["time_s"] - 0.95
    [glide] = glides(**{**columns, "speed_mps": 10.0 + slope * t})
    path = np.hypot(10.0 + slope * t, 0.5)
    along = float(np.polyfit(t, path, 1)[0])
    assert glide.sink_mps == pytest.approx(0.5 - path.mean() * along / GRAVITY_MPS2)
    assert glide.speed_mps == pytest.approx(10.0)


def drifting(name: str, slope: float) -> dict[str, Any]:
    columns = log()
    return {**columns, name: columns[name] + slope * (columns["time_s"] - 0.95)}


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("speed_mps", 0.195, 0.205),  # 0.2 m/s² along the path
        ("climb_mps", 0.0195, 0.0205),  # 0.02 m/s²
        ("pitch_rad", 0.0171, 0.0175),  # 0.01 rad of deviation: 0.577 of a ramp
        ("brake", 0.0105, 0.0106),  # 0.02 in 1.9 s
    ],
)
def test_a_window_is_steady_within_a_limit(name: str, least: float, most: float) -> None:
    for sign in (1.0, -1.0):
        assert len(glides(**drifting(name, sign * least))) == 1
        assert glides(**drifting(name, sign * most)) == ()


@pytest.mark.parametrize(
    ("name", "limit"),
    [("speed_mps", "speed_change_mps2"), ("climb_mps", "climb_change_mps2"),
     ("pitch_rad", "pitch_spread_rad")],
)  # fmt: skip
def test_a_limit_may_be_chosen(name: str, limit: str) -> None:
    unsteady: dict[str, Any] = drifting(name, 0.3)
    assert glides(**unsteady) == ()
    assert len(glides(**unsteady, **{limit: 1.0})) == 1


@pytest.mark.parametrize(("rate_hz", "counts"), [(2.0, 0), (2.5, 1)])
def test_a_window_has_five_rows(rate_hz: float, counts: int) -> None:
    assert len(glides(**log(2.0, rate_hz))) == counts


@pytest.mark.parametrize(("seconds", "counts"), [(1.7, 1), (1.6, 0)])
def test_rows_cover_four_fifths_of_a_window(seconds: float, counts: int) -> None:
    """Of 10 a second the last is a tenth of a second before the end."""
    assert len(glides(**log(seconds))) == counts


@pytest.mark.parametrize(("missing", "counts"), [(3, 1), (5, 0)])
def test_a_gap_of_a_quarter_of_a_window_is_too_long(missing: int, counts: int) -> None:
    columns = log()
    kept = np.r_[0:8, 8 + missing : 20]
    assert len(glides(**{name: each[kept] for name, each in columns.items()})) == counts


@pytest.mark.parametrize("window_s", [0.0, -1.0, 1e4, nan])
def test_a_window_lasts(window_s: float) -> None:
    with pytest.raises(ValueError, match=f"window_s = {window_s}: must be positive"):
        glides_from_log(**log(), window_s=window_s)


def test_a_time_that_stands_or_of_one_row_alone_is_refused() -> None:
    columns = log()
    stands = columns["time_s"].copy()
    stands[7] = stands[6]
    for bad in ({**columns, "time_s": stands}, {n: each[:1] for n, each in columns.items()}):
        with pytest.raises(ValueError, match="must increase from row to row, over at least two"):
            glides_from_log(**bad)
    assert len(glides(**{n: each[:2] for n, each in columns.items()})) == 0


def test_no_glide_at_all_is_reported_with_the_limits() -> None:
    with pytest.raises(
        ValueError,
        match=r"none of 4 windows of 2\.0 s .*0\.01 rad.*0\.2 m/s².*0\.02 m/s²\): hold each",
    ):
        glides_from_log(**{**log(8.0), "speed_mps": np.linspace(5.0, 20.0, 80)})

"""The polar from glides: what it recovers, its uncertainty, and what it refuses."""

from __future__ import annotations

from math import isnan, nan
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import asdict

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.polar import (
    PolarFit,
    fit_polar,
    glides_from_log,
    sink_band,
    sink_standard_error,
    student_t,
)
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.aircraft import aircraft_model, glide_at, gliding_state, step
from tgl_soar.types import GRAVITY_MPS2, GlidePolar, SurfaceCommand, polar_sink

# 1.3 + 0.12 (u − 8.6)² − 0.006 (u − 8.6)³: an aircraft with room between least sink and stall
TRUE = GlidePolar(
    c0=13.991536, c1=-3.395280, c2=0.274800, c3=-0.006000, speed_min_mps=7.2, speed_max_mps=12.0
)
SPEEDS = (7.2, 7.6, 8.1, 8.7, 9.4, 10.1, 11.0, 12.0)


def _sinks(speeds: tuple[float, ...] = SPEEDS) -> list[float]:
    return [TRUE.c0 + u * (TRUE.c1 + u * (TRUE.c2 + u * TRUE.c3)) for u in speeds]


def _measured(seed: int, noise_mps: float) -> PolarFit:
    draw = Random(seed)
    return fit_polar(SPEEDS, [s + draw.gauss(0.0, noise_mps) for s in _sinks()])


def test_a_cubic_is_recovered() -> None:
    fit = fit_polar(SPEEDS, _sinks())
    assert list(fit.polar) == pytest.approx(list(TRUE), rel=1e-8)
    assert fit.residual_max_mps < 1e-12
    assert (fit.speeds, fit.degrees_of_freedom) == (8, 4)
    # Powers of a speed about the middle of the range are told apart best.
    assert (fit.centre_mps, fit.scale_mps) == pytest.approx((9.6, 2.4))


def test_least_sink_and_best_glide_are_those_of_the_curve() -> None:
    fit = fit_polar(SPEEDS, _sinks())
    speeds = [7.2 + 0.001 * i for i in range(4800)]
    sinks = {u: polar_sink(TRUE, u) for u in speeds}
    assert fit.min_sink_speed_mps == pytest.approx(min(sinks, key=lambda u: sinks[u]), abs=0.002)
    assert fit.min_sink_mps == pytest.approx(min(sinks.values()), abs=1e-6)
    best = max(sinks, key=lambda u: u / sinks[u])
    assert fit.best_glide_speed_mps == pytest.approx(best, abs=0.002)
    assert fit.best_glide_ratio == pytest.approx(best / sinks[best], abs=1e-5)


@given(st.lists(st.floats(7.2, 12.0), min_size=3, max_size=20))
def test_the_order_of_the_glides_does_not_matter(more: list[float]) -> None:
    speeds = (*SPEEDS, *more)
    turned = tuple(reversed(speeds))
    forth, back = fit_polar(speeds, _sinks(speeds)), fit_polar(turned, _sinks(turned))
    for u in (7.2, 9.0, 12.0):
        assert polar_sink(forth.polar, u) == pytest.approx(polar_sink(back.polar, u), abs=1e-9)


def test_outside_its_range_it_is_not_a_number() -> None:
    fit = fit_polar(SPEEDS, _sinks())
    for speed in (7.19, 12.01, 0.0, -9.0, nan):
        assert isnan(polar_sink(fit.polar, speed))
        assert isnan(sink_standard_error(fit, speed))
        assert all(isnan(limit) for limit in sink_band(fit, speed))
    assert not isnan(polar_sink(fit.polar, 7.2))
    assert not isnan(polar_sink(fit.polar, 12.0))


# --- its uncertainty ------------------------------------------------------------------------


def test_the_band_holds_the_truth_at_least_as_often_as_it_says() -> None:
    # 400 tables: 95 % is 380, of which the count strays by 4.4; four times that is allowed below.
    # With four degrees of freedom, 1.96 in place of Student's 2.78 would give 88 %; what a fourth
    # power finds in the noise of a true cubic widens the band by a few per cent, no more.
    for speed in (7.2, 8.5, 11.5):
        inside, widths, noise = 0, 0.0, 0.0
        for seed in range(400):
            fit = _measured(seed, 0.03)
            low, high = sink_band(fit, speed)
            inside += low <= polar_sink(TRUE, speed) <= high
            widths += high - low
            noise += 2.0 * student_t(0.95, 4) * sink_standard_error(fit, speed)
        assert inside >= 380 - 18
        assert 1.0 < widths / noise < 1.15


def test_the_band_holds_what_a_fourth_power_shows_that_a_cubic_leaves_out() -> None:
    def sink(u: float) -> float:
        return polar_sink(TRUE, u) + 0.03 * (u - 9.6) ** 4

    often = 10 * SPEEDS  # until next to nothing is left of the coefficients' uncertainty
    fit = fit_polar(often, [sink(u) for u in often])
    cubic_alone = fit._replace(left_out=(0.0,) * 5)
    held, missed = 0, 0
    for u in np.linspace(SPEEDS[0], SPEEDS[-1], 100):
        low, high = sink_band(fit, u)
        held += low <= sink(u) <= high
        low, high = sink_band(cubic_alone, u)
        missed += not low <= sink(u) <= high
    assert held == 100
    assert missed > 50


@pytest.mark.parametrize("more", [0.0, 0.009, -0.009, 0.011])
def test_the_band_holds_a_hundredth_that_all_glides_share(more: float) -> None:
    """Of a sideslip, for example, which their scatter does not show."""
    fit = fit_polar(SPEEDS, [(1.0 + more) * sink for sink in _sinks()])
    for u in SPEEDS:
        low, high = sink_band(fit, u)
        assert (low <= polar_sink(TRUE, u) <= high) == (abs(more) < 0.01)


def test_standard_errors_are_the_spread_of_the_coefficients() -> None:
    fits = [_measured(seed, 0.02) for seed in range(400)]
    for k in range(4):
        values = [fit.polar[k] for fit in fits]
        mean = sum(values) / len(values)
        spread = (sum((v - mean) ** 2 for v in values) / (len(values) - 1)) ** 0.5
        claimed = (sum(fit.standard_errors[k] ** 2 for fit in fits) / len(fits)) ** 0.5
        # each known to 3.5 % (400 fits) and 3.5 % (400 times 4 degrees of freedom)
        assert claimed == pytest.approx(spread, rel=0.15)
        assert mean == pytest.approx(TRUE[k], abs=4.0 * spread / 20.0)


def test_the_standard_error_is_that_of_the_textbook() -> None:
    fit = _measured(1, 0.03)
    powers = np.vander(np.array(SPEEDS), 4, increasing=True)
    inverse = np.linalg.inv(powers.T @ powers)
    for u in (7.2, 7.9, 8.5, 10.4, 11.7, 12.0):
        x = np.array([1.0, u, u**2, u**3])
        expected = fit.residual_rms_mps * float(np.sqrt(x @ inverse @ x))
        # powers of u up to 12³ squared leave about six digits
        assert sink_standard_error(fit, u) == pytest.approx(expected, rel=1e-4)


def test_the_residual_is_the_noise() -> None:
    variances = [_measured(seed, 0.02).residual_rms_mps ** 2 for seed in range(400)]
    # 1,600 degrees of freedom in all: known to 3.5 %
    assert sum(variances) / 400.0 == pytest.approx(0.02**2, rel=0.14)


def test_residuals_stand_in_the_order_of_the_glides() -> None:
    sinks = _sinks()
    sinks[3] += 0.2
    fit = fit_polar(SPEEDS, sinks)
    sizes = [abs(r) for r in fit.residuals_mps]
    assert sizes.index(max(sizes)) == 3
    assert fit.residuals_mps[3] > 0.0
    assert fit.residual_max_mps == max(sizes)


@pytest.mark.parametrize(
    ("confidence", "freedom", "t"),
    # two-sided values of Student's distribution as every table prints them
    [
        (0.95, 1, 12.706),
        (0.95, 2, 4.303),
        (0.95, 4, 2.776),
        (0.99, 4, 4.604),
        (0.95, 10, 2.228),
        (0.90, 30, 1.697),
        (0.95, 1000, 1.962),
    ],
)
def test_students_t(confidence: float, freedom: int, t: float) -> None:
    assert student_t(confidence, freedom) == pytest.approx(t, abs=0.001 if freedom > 1 else 0.01)


@pytest.mark.parametrize(("confidence", "freedom"), [(0.0, 4), (1.0, 4), (nan, 4), (0.95, 0)])
def test_no_band_without_sense(confidence: float, freedom: int) -> None:
    with pytest.raises(ValueError, match="confidence"):
        student_t(confidence, freedom)


# --- what it refuses ------------------------------------------------------------------------


def test_too_few_speeds() -> None:
    with pytest.raises(ValueError, match=r"5 distinct speeds .* at least 6: glide at more pitch"):
        fit_polar(SPEEDS[:5], _sinks(SPEEDS[:5]))
    # the same five attitudes flown ten times each are still five
    many = tuple(u + 0.001 * i for u in SPEEDS[:5] for i in range(10))
    with pytest.raises(ValueError, match="5 distinct speeds"):
        fit_polar(many, _sinks(many))
    with pytest.raises(ValueError, match="0 distinct speeds"):
        fit_polar([], [])


def test_too_narrow() -> None:
    narrow = tuple(8.0 + 0.12 * i for i in range(8))
    with pytest.raises(ValueError, match=r"between 8\.00 and 8\.84 m/s.*1\.15"):
        fit_polar(narrow, _sinks(narrow))


def test_no_minimum() -> None:
    fast = tuple(8.8 + 0.45 * i for i in range(8))
    with pytest.raises(ValueError, match=r"no minimum of sink .* add slower glides"):
        fit_polar(fast, _sinks(fast))
    with pytest.raises(ValueError, match=r"no minimum of sink .* still falls"):
        fit_polar(SPEEDS, [20.0 / u for u in SPEEDS])
    # falling, rising, falling: the fast end is no polar, whatever stands between
    with pytest.raises(ValueError, match="no minimum of sink"):
        fit_polar(
            SPEEDS, [2.0 - 0.01 * (u - 8.0) * (u - 9.0) * (u - 12.0) * 3 - u / 20 for u in SPEEDS]
        )


def test_a_curve_that_dips_below_nothing() -> None:
    speeds = (7.0, 7.2, 7.4, 7.6, 11.6, 11.8, 12.0, 12.2)
    sinks = [0.5 + 0.6 * ((u - 9.6) ** 2 - 4.2) for u in speeds]
    with pytest.raises(ValueError, match="less than nothing"):
        fit_polar(speeds, sinks)


@pytest.mark.parametrize(
    ("row", "speed", "sink", "message"),
    [
        (2, nan, 1.3, r"glide 2 is \(nan, 1\.3\): not finite"),
        (3, 8.8, nan, "glide 3 .*not finite"),
        (0, float("inf"), 1.3, "glide 0 .*not finite"),
        (1, -8.0, 1.3, r"speed -8\.0 m/s"),
        (1, 0.0, 1.3, r"speed 0\.0 m/s"),
        (4, 9.4, -1.4, "sink is positive down"),
        (4, 9.4, 0.0, "rising air"),
        (5, 1.3, 9.0, "swapped"),
    ],
)
def test_rows_that_are_no_glides(row: int, speed: float, sink: float, message: str) -> None:
    speeds, sinks = list(SPEEDS), _sinks()
    speeds[row], sinks[row] = speed, sink
    with pytest.raises(ValueError, match=message):
        fit_polar(speeds, sinks)


def test_columns_of_unequal_length() -> None:
    with pytest.raises(ValueError, match="8 speeds and 7 sinks"):
        fit_polar(SPEEDS, _sinks()[:-1])


def test_where_best_glide_lies_outside_it_is_not_a_number() -> None:
    slow = tuple(7.2 + 0.3 * i for i in range(7))  # to 9.0: least sink inside, best glide beyond
    fit = fit_polar(slow, _sinks(slow))
    assert isnan(fit.best_glide_speed_mps)
    assert isnan(fit.best_glide_ratio)
    assert fit.min_sink_speed_mps == pytest.approx(8.6)


# --- from a log -----------------------------------------------------------------------------


def _log(
    speeds: tuple[float, ...], change_mps2: float = 0.0, hold_s: float = 6.0
) -> tuple[list[float], list[float], list[float], list[float]]:
    """Glides one after another, each with a pitch of its own; 50 rows a second."""
    time, pitch, speed, climb = [], [], [], []
    for number, u in enumerate(speeds):
        for k in range(round(hold_s * 50)):
            t = k / 50.0
            now = u + change_mps2 * (t - 0.5 * hold_s)
            # what slows down rises by as much: dh/dt = −sink − (V / g) dV/dt
            rise = -polar_sink(TRUE, u) - now * change_mps2 / GRAVITY_MPS2
            time.append(100.0 + number * hold_s + t)  # logs do not begin at zero
            pitch.append(0.02 - 0.02 * number)
            speed.append(now)
            climb.append(rise)
    return time, pitch, speed, climb


def test_a_log_of_glides_gives_the_polar() -> None:
    speeds = (7.8, 8.2, 8.7, 9.2, 9.8, 10.6, 11.6)
    glides = glides_from_log(*_log(speeds))
    assert len(glides) == 21  # three windows of 2 s each
    assert all(g.duration_s == pytest.approx(1.98) for g in glides)
    fit = fit_polar([g.speed_mps for g in glides], [g.sink_mps for g in glides])
    for u in (7.81, *speeds[1:-1], 11.59):
        assert polar_sink(fit.polar, u) == pytest.approx(polar_sink(TRUE, u), abs=1e-6)
    assert sorted({round(g.pitch_rad, 6) for g in glides}, reverse=True)[0] == 0.02


def test_speed_that_still_changes_is_taken_out() -> None:
    # 0.1 m/s² at 9 m/s is 0.09 m/s of climb, 7 % of the sink
    glides = glides_from_log(*_log((9.2,), change_mps2=-0.1, hold_s=2.0))
    assert len(glides) == 1
    assert -_log((9.2,), change_mps2=-0.1, hold_s=2.0)[3][50] < polar_sink(TRUE, 9.2) - 0.08
    # the path is steeper than the horizontal speed says by sink² / 2u², 1 % of that
    assert glides[0].sink_mps == pytest.approx(polar_sink(TRUE, 9.2), abs=0.003)


def test_unsteady_flight_is_left_out() -> None:
    time, pitch, speed, climb = _log((8.2, 9.2))
    for k in range(300, 600):
        pitch[k] += 0.05 * (-1.0) ** k  # porpoising through the second glide
    assert {round(g.speed_mps, 1) for g in glides_from_log(time, pitch, speed, climb)} == {8.2}
    with pytest.raises(ValueError, match="hold each pitch longer"):
        glides_from_log(*_log((8.2, 9.2), change_mps2=0.5))


def test_a_window_with_rows_missing_is_left_out() -> None:
    log = _log((8.2, 9.2))
    assert len(glides_from_log(*log)) == 6
    for lost in (range(130, 195), range(100, 140), range(170, 200)):  # inside, before, after
        kept = [[v for k, v in enumerate(column) if k not in lost] for column in log]
        assert len(glides_from_log(kept[0], kept[1], kept[2], kept[3])) == 5


def test_flown_glides_give_the_polar_of_the_airframe_file() -> None:
    # The paper's way, in simulation: set the elevator, wait until the phugoid has died to 2 %
    # (30 s at 0.13 rad/s), glide 10 s, next pitch.
    airframe = load_airframe(shipped("airframes/eclipson_c.toml"))
    model = aircraft_model(asdict(airframe.airframe), airframe.model)
    still, dt = (0.0, 0.0, 0.0), 0.005
    log: tuple[list[float], ...] = ([], [], [], [])
    for number, u in enumerate((7.6, 7.9, 8.3, 8.8, 9.4, 10.2, 11.1, 12.0)):
        state = gliding_state(glide_at(model, u), (-0.2, 0.0, 0.0))
        surfaces = SurfaceCommand(state.elevator, 0.0, 0.0)
        for k in range(8000):
            state = step(model, state, surfaces, still, still, dt)
            if k >= 6000 and k % 10 == 0:
                _, pitch, _ = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
                row = (100.0 * number + k * dt, pitch, -state.velocity_x_mps, state.velocity_z_mps)
                for column, value in zip(log, row, strict=True):
                    column.append(value)
    glides = glides_from_log(log[0], log[1], log[2], log[3])
    fit = fit_polar([g.speed_mps for g in glides], [g.sink_mps for g in glides])
    assert fit.speeds == 8
    for u in (7.8, 8.5, 9.2, 10.0, 11.0, 11.9):
        # two cubics through one curve that is none: each is off by its residual
        assert polar_sink(fit.polar, u) == pytest.approx(
            polar_sink(airframe.polar.as_polar(), u), abs=0.02
        )


@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_a_log_with_holes_is_refused(column: int) -> None:
    name = ("time_s", "pitch_rad", "speed_mps", "climb_mps")[column]
    log = _log((8.2,))
    log[column][7] = nan
    with pytest.raises(ValueError, match=rf"log: {name}\[7\] = nan"):
        glides_from_log(*log)
    short = list(_log((8.2,)))
    short[column] = short[column][:-1]
    with pytest.raises(ValueError, match="one row each"):
        glides_from_log(*short)


def test_a_log_whose_time_stands_is_refused() -> None:
    time, pitch, speed, climb = _log((8.2,))
    time[5] = time[4]
    with pytest.raises(ValueError, match="must increase"):
        glides_from_log(time, pitch, speed, climb)
    with pytest.raises(ValueError, match="window_s"):
        glides_from_log(*_log((8.2,)), window_s=0.0)


def test_importing_it_needs_no_numpy() -> None:
    import subprocess
    import sys

    code = "import sys, tgl_soar.estimation.polar; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

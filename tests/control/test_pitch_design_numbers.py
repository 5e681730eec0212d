"""What the search for gains judges by: gusts solved as matrices, the margin of a loop by its very
numbers, and what it takes, rounds, bounds and leaves as it is."""

from __future__ import annotations

from math import atan, cos, exp, log, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control import pitch_design
from tgl_soar.control.found_gains import INERTIAL, PLAIN, SOUGHT, gains_of
from tgl_soar.control.laws import dynamics_of, laws_from
from tgl_soar.control.loop_margin import Flown, flown
from tgl_soar.control.pitch_design import (
    ACTIVITY_M,
    DesignCost,
    answers,
    gust_variances,
    later,
)
from tgl_soar.geometry import SoaringFrame

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
VALUES = load_parameters(
    load_airframe(AIRFRAME_PATH), AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH
).changed({"DYN_LIFT": -6.0, "ELE_DSP_IMU": 0.4})
HERE = SoaringFrame(0.0, 0.0, 0.0, 0.0)
RADPS: NDArray[np.float64] = np.geomspace(0.3, 30.0, 12)
G = 9.80665
TICK_S = 0.005


def loop_at(speed_mps: float, lean_deg: float, inertial: bool) -> Flown:
    return flown(laws_from(VALUES, HERE), VALUES, speed_mps, lean_deg, inertial)


def disturbed(loop: Flown, lean_deg: float, radps: float) -> NDArray[np.complex128]:
    """e_rho and elevator (rows) by a gust w up and a headwind u of 1 m/s (columns), closed.

    Unknowns: speed along the path, its angle, pitch, the elevator.
    """
    known, v, s = dynamics_of(VALUES), loop.speed_mps, 1j * radps
    ratio, square = v / known.speed_mps, (v / known.best_glide_mps) ** 2
    falls = atan((square + 1.0 / square) / (2.0 * known.glide_ratio))
    lift = v * ratio / known.path_s
    per_lift = 1.0 / (known.glide_ratio * square)
    omega = known.short_period_radps * ratio
    damped = lift / v - 2.0 * known.damping * omega
    stiff = -(omega**2) - damped * lift / v
    lifted = loop.lift_mps2 * ratio**2
    down, along = G * sin(falls), G * cos(falls)
    old = late = 0.0
    if not loop.inertial:
        old, late = 0.05, 0.005
    outer, inner = loop.soaring, loop.pitch
    lean = radians(lean_deg) - falls
    rate = np.array([cos(lean), -v * sin(lean), 0.0, 0.0])
    asks = np.exp(-s * old) * (
        (outer.kp + outer.ki / s) * (1.0 + s * old) / s
        + outer.kd / (1.0 + s / outer.rate_filter_radps)
    )
    error, turns = inner.kp + inner.ki / s, inner.kd * s / (1.0 + s / inner.rate_filter_radps)
    # A rate of the setpoint by ticks, and the filter's: y = y' + w T (x - y) / ...
    z, w = np.exp(s * TICK_S), inner.rate_filter_radps
    by_rate = (1.0 - 1.0 / z) / TICK_S * w * TICK_S / (1.0 + w * TICK_S - 1.0 / z)
    follows = error + loop.setpoint_weight * inner.kd * by_rate
    holds = np.exp(-s * late) * (error * (1.0 + s * late) + turns)
    servo = np.exp(-s * (loop.delay_s + 0.5 * TICK_S)) / (1.0 + s * loop.lag_s)
    pitch = np.array([0.0, 0.0, 1.0, 0.0])
    rows = np.array([
        [s + 2.0 * down / v, along - lift * per_lift, lift * per_lift, lifted * per_lift],
        [-2.0 * along / v, v * s + lift + down, -lift, -lifted],
        [0.0, stiff, s * s - damped * s - stiff, -known.effect_radps2 * ratio**2],
        -(follows * asks * rate - holds * pitch) * servo + np.array([0.0, 0.0, 0.0, 1.0]),
    ])  # fmt: skip
    blown = np.array([
        [(along - lift * per_lift) / v, -2.0 * down / v], [lift / v, 2.0 * along / v],
        [stiff / v, 0.0], [0.0, 0.0],
    ])  # fmt: skip
    moved = np.linalg.solve(rows, blown.astype(np.complex128))
    return np.array([rate @ moved / s, moved[3]])


@pytest.mark.parametrize("inertial", [True, False])
@pytest.mark.parametrize(("speed_mps", "lean_deg"), [(8.5, 15.0), (11.0, 30.0)])
def test_gusts_move_the_aircraft_and_its_elevator_as_the_rows_say(
    inertial: bool, speed_mps: float, lean_deg: float
) -> None:
    """Dryden's spectra, w and u beside one another; of e_rho the mean of 1.5 m and 6 m."""
    loop = loop_at(speed_mps, lean_deg, inertial)
    moved = np.array([np.abs(disturbed(loop, lean_deg, w)) ** 2 for w in RADPS])
    both: list[Any] = []
    for length_m in (1.5, 6.0):
        t = length_m / speed_mps
        q = 1.0 + (t * RADPS) ** 2
        up, ahead = t / pi * (3.0 * q - 2.0) / q**2, 2.0 * t / pi / q
        spectra = moved[:, :, 0] * up[:, None] + moved[:, :, 1] * ahead[:, None]
        both.append(np.trapezoid(spectra, RADPS, axis=0))
    (e_short, elevator), (e_long, _) = both
    known = answers(VALUES, speed_mps, lean_deg, RADPS)
    found = gust_variances(loop, known, 0.3)
    assert found[0] == pytest.approx(0.09 * float(e_short * e_long) ** 0.5, rel=1e-6)
    assert found[1] == pytest.approx(0.09 * float(elevator), rel=1e-6)


def test_commands_that_come_later_turn_the_elevator_alone() -> None:
    known = answers(VALUES, 9.0, 15.0, RADPS)
    late = later(known, 0.03)
    assert np.allclose(late.surface, known.surface * np.exp(-0.03j * RADPS))
    assert late._replace(surface=known.surface) == known


# --- what is sought -----------------------------------------------------------------------------


class Judge:
    """Of gains by the factors of those that it began with: what a test says."""

    def __init__(self, kind: str, wanted: list[float], short: float = 0.0) -> None:
        self.first = np.array(gains_of(VALUES, kind))
        self.kind, self.wanted, self.short = kind, np.array(wanted), short
        self.tried: list[list[float]] = []

    def judged(self, values: ParameterSet) -> DesignCost:
        gains = gains_of(values, self.kind)
        self.tried.append(gains)
        moved = [i for i in range(5) if i != 2]  # all but the filter
        apart = np.log(np.array(gains) / self.first)[moved] - self.wanted
        return DesignCost(exp(float(apart @ apart)), 0.0, self.short)


def sought(judge: Judge) -> list[float] | None:
    task: Any = judge
    return pitch_design._searched(task, VALUES, judge.kind)


@pytest.mark.parametrize("kind", [PLAIN, INERTIAL])
def test_the_least_is_found_and_the_filter_is_left_as_it_is(kind: str) -> None:
    wanted = [0.2, -0.4, 0.3, -0.1]
    judge = Judge(kind, wanted)
    found = sought(judge)
    assert found is not None
    moved = [i for i in range(5) if i != 2]
    factors = np.log(np.array(found) / judge.first)
    assert factors[moved] == pytest.approx(wanted, abs=0.03)
    assert found[2] == pytest.approx(judge.first[2], rel=1e-3)
    assert "FILT" in SOUGHT[PLAIN][2]
    assert "_DF_" in SOUGHT[INERTIAL][2]
    for gain in found:  # three digits, which any computer finds
        assert gain == float(f"{gain:.3g}")
    assert [gains_of(VALUES, kind)[0]] != found[:1]


def test_no_gain_goes_six_times_as_far_as_it_was() -> None:
    """A factor of exp(1.8)."""
    found = sought(Judge(PLAIN, [-2.5, 0.0, 0.0, 0.0]))
    first = gains_of(VALUES, PLAIN)
    assert found is None or log(found[0] / first[0]) > -1.82
    near = sought(Judge(PLAIN, [-1.7, 0.0, 0.0, 0.0]))
    assert near is not None
    assert log(near[0] / first[0]) == pytest.approx(-1.7, abs=0.03)


@pytest.mark.parametrize(("short", "taken"), [(0.009, True), (0.011, False)])
def test_gains_that_lack_a_hundredth_of_their_margins_are_none(short: float, taken: bool) -> None:
    assert (sought(Judge(PLAIN, [0.1, 0.1, 0.1, 0.1], short)) is not None) is taken


def test_the_elevator_counts_by_three_hundredths_of_a_metre() -> None:
    """Beside an e_rho that is the same everywhere, what moves it least is found."""

    class Busy(Judge):
        def judged(self, values: ParameterSet) -> DesignCost:
            quiet = super().judged(values)
            return DesignCost(0.03, quiet.e_rho_m, 0.0)

    found = sought(Busy(PLAIN, [0.0, 0.2, -0.2, 0.0]))
    assert found is not None
    assert ACTIVITY_M == 0.03
    first = gains_of(VALUES, PLAIN)
    assert log(found[1] / first[1]) == pytest.approx(0.2, abs=0.03)

"""Turbulence, gusts and schedules number by number: each sum, each bound, each component."""

from __future__ import annotations

from math import inf, nan, sqrt
from typing import cast

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.gusts import (
    DRYDEN_STILL,
    NO_ROLL_GUST,
    BlendedField,
    DrydenParams,
    DrydenState,
    Gust,
    GustyField,
    ScaledField,
    Schedule,
    dryden_params,
    dryden_start,
    dryden_step,
    gust_fraction,
    roll_gust_params,
    roll_gust_start,
    roll_gust_step,
)
from tgl_soar.air.hill import HillField

PARAMS = dryden_params(0.05, 9.0, 1.5, 0.02)
UNIT = np.eye(3).tolist()
PLACE = (-25.0, 3.0, 10.0)
SLOW, FAST = HillField(8.0, 20.0), HillField(10.0, 25.0)


class _OneDraw:
    """A generator all of whose numbers are zero, but for one that is 1."""

    def __init__(self, which: int) -> None:
        self._left = which

    def standard_normal(self, count: int | None = None) -> FloatArray | float:
        drawn = np.zeros(count or 1)
        if 0 <= self._left < len(drawn):
            drawn[self._left] = 1.0
        self._left -= len(drawn)
        return drawn if count else float(drawn[0])


def _stationary(params: DrydenParams) -> FloatArray:
    """Covariance of the state that a step leaves as it is."""
    from scipy.linalg import solve_discrete_lyapunov

    still = (0.0, 0.0, 0.0)
    move = np.array([dryden_step(params, DrydenState._make(e), *still)[0] for e in np.eye(5)]).T
    noise = np.array([dryden_step(params, DRYDEN_STILL, *row)[0] for row in UNIT]).T
    result: FloatArray = solve_discrete_lyapunov(move, noise @ noise.T)
    return result


@pytest.mark.parametrize("dt_s", [0.004, 0.02, 0.2])
def test_the_state_at_the_start_has_exactly_the_covariance_that_a_step_keeps(dt_s: float) -> None:
    """A start is linear in seven independent numbers: its covariance is the sum over them."""
    params = dryden_params(0.05, 9.0, 1.5, dt_s)
    draws = [dryden_start(params, cast("np.random.Generator", _OneDraw(k))) for k in range(7)]
    covariance = sum(np.outer(draw, draw) for draw in draws)
    assert covariance == pytest.approx(_stationary(params), abs=1e-9)


def test_each_number_pushes_the_air_its_own_way_and_no_other() -> None:
    for k, white in enumerate(UNIT):
        _, wind = dryden_step(PARAMS, DRYDEN_STILL, *white)
        assert wind[k] > 0.0
        assert [wind[other] for other in range(3) if other != k] == [0.0, 0.0]


def test_what_is_remembered_and_what_is_new_add_up() -> None:
    state = DrydenState(u=0.3, v1=-0.2, v2=0.1, w1=0.4, w2=-0.3)
    white = (0.7, -1.1, 0.6)
    both = np.concatenate(dryden_step(PARAMS, state, *white))
    remembered = np.concatenate(dryden_step(PARAMS, state, 0.0, 0.0, 0.0))
    new = np.concatenate(dryden_step(PARAMS, DRYDEN_STILL, *white))
    assert both == pytest.approx(remembered + new)


def test_still_air_is_still() -> None:
    assert DRYDEN_STILL == (0.0,) * 5
    assert dryden_step(PARAMS, DRYDEN_STILL, 0.0, 0.0, 0.0) == (DRYDEN_STILL, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("intensity", [0.0, 1.0])
def test_an_intensity_is_a_fraction_bounds_included(intensity: float) -> None:
    gain = dryden_params(intensity, 9.0, 1.5, 0.02).gain_long
    assert gain == pytest.approx(intensity * dryden_params(1.0, 9.0, 1.5, 0.02).gain_long)


@pytest.mark.parametrize("intensity", [-0.01, 1.01, nan])
def test_no_other_number_is_an_intensity(intensity: float) -> None:
    with pytest.raises(ValueError, match="a fraction from 0 to 1"):
        dryden_params(intensity, 9.0, 1.5, 0.02)


@pytest.mark.parametrize("value", [0.0, -1.0, inf, nan])
@pytest.mark.parametrize(
    ("which", "says"),
    [(1, r"reference wind \[m/s\]"), (2, r"length scale \[m\]"), (3, r"time step \[s\]")],
)
def test_each_number_of_the_turbulence_must_be_positive(
    which: int, says: str, value: float
) -> None:
    numbers = [0.03, 9.0, 1.5, 0.02]
    numbers[which] = value
    with pytest.raises(ValueError, match=f"{says} .*must be positive"):
        dryden_params(*numbers)


# --- roll gusts ----------------------------------------------------------------------------------


def test_a_roll_gust_keeps_the_variance_that_it_starts_with() -> None:
    params = roll_gust_params(0.03, 8.5, 1.5, 1.1, 0.02)
    sigma = roll_gust_start(params, 1.0)
    kept, new = roll_gust_step(params, sigma, 0.0), roll_gust_step(params, 0.0, 1.0)
    assert new > 0.0
    assert kept**2 + new**2 == pytest.approx(sigma**2)
    assert roll_gust_step(params, sigma, 1.0) == pytest.approx(kept + new)
    assert roll_gust_step(NO_ROLL_GUST, sigma, 1.0) == 0.0


@pytest.mark.parametrize("which", range(5))
def test_a_roll_gust_is_refused_what_turbulence_is(which: int) -> None:
    numbers = [0.03, 8.5, 1.5, 1.1, 0.02]
    numbers[which] = nan
    with pytest.raises(ValueError, match="turbulence"):
        roll_gust_params(*numbers)


# --- discrete gusts ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time_s", "fraction"),
    # sin² of half the phase: 30°, 45°, 60° and 90° of π.
    [(10.5, 0.25), (10.75, 0.5), (11.0, 0.75), (11.5, 1.0), (12.25, 0.5), (9.9, 0.0), (13.1, 0.0)],
)
def test_a_gust_rises_and_falls_as_the_square_of_a_sine(time_s: float, fraction: float) -> None:
    gust = Gust(start_s=10.0, duration_s=3.0)
    assert gust_fraction(gust, time_s) == pytest.approx(fraction)
    assert gust[2:] == (0.0, 0.0, 0.0)  # without a component it blows nowhere


def test_gusts_add_up_component_by_component() -> None:
    first = Gust(start_s=0.0, duration_s=3.0, u_mps=2.0, v_mps=-4.0, w_mps=6.0)
    second = Gust(start_s=0.5, duration_s=1.0, u_mps=0.5, v_mps=0.25, w_mps=-0.125)
    field = GustyField(SLOW, [first, second])
    # At 1 s the first is at sin² 60° and the second at its greatest.
    expected = (2.0, -2.75, 4.375)
    assert field.gust_at(1.0) == pytest.approx(expected)
    calm = SLOW.wind_at(*PLACE, 0.0)
    assert np.subtract(field.wind_at(*PLACE, 1.0), calm) == pytest.approx(expected)
    blown = [float(part) for part in field.wind(*PLACE, 1.0)]
    assert np.subtract(blown, calm) == pytest.approx(expected)
    assert np.subtract([float(p) for p in field.wind(*PLACE)], calm) == pytest.approx(
        field.gust_at(0.0)
    )
    assert field.reference_wind_mps == SLOW.reference_wind_mps
    assert field.inside(*PLACE)
    assert not field.inside(0.0, 0.0, 10.0)


@pytest.mark.parametrize(
    "change",
    [
        *({"duration_s": value} for value in (0.0, -1.0, inf, nan)),
        *({name: nan} for name in ("start_s", "u_mps", "v_mps", "w_mps")),
    ],
)
def test_a_gust_that_is_none_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="finite and the duration positive"):
        GustyField(SLOW, [Gust(start_s=1.0, duration_s=1.0)._replace(**change)])


# --- slow changes --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("times", "values", "says"),
    [
        ([], [], "0 times and 0 values"),
        ([0.0, 1.0], [1.0], "2 times and 1 values"),
        ([0.0, 2.0, 1.0], [1.0, 1.0, 1.0], "must increase"),
        ([0.0, 1.0, 1.0], [1.0, 1.0, 1.0], "must increase"),
        ([0.0, inf], [1.0, 1.0], "all must be finite"),
        ([0.0, 1.0], [nan, 1.0], "all must be finite"),
    ],
)
def test_a_schedule_that_is_none_says_why(
    times: list[float], values: list[float], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        Schedule(times, values)


def test_a_schedule_is_linear_in_intervals_of_any_length() -> None:
    ramp = Schedule([-1.0, 3.0, 4.0], [4.0, 12.0, 2.0])
    assert [ramp.at(t) for t in (-2.0, 0.0, 2.0, 3.25, 3.5, 9.0)] == [4.0, 6.0, 10.0, 9.5, 7.0, 2.0]


def test_a_factor_scales_each_component_and_may_be_zero_but_not_less() -> None:
    base = GustyField(SLOW, [Gust(start_s=-1.0, duration_s=2.0, v_mps=1.0)])  # so that v is not 0
    wind = base.wind_at(*PLACE, 0.0)
    assert all(abs(part) > 0.5 for part in wind)
    for factor in (0.0, 0.25, 3.0):
        scaled = ScaledField(base, factor)
        expected = tuple(factor * part for part in wind)
        assert scaled.wind_at(*PLACE, 0.0) == pytest.approx(expected)
        assert [float(part) for part in scaled.wind(*PLACE)] == pytest.approx(expected)
        assert scaled.reference_wind_mps == 8.0 * factor
    with pytest.raises(ValueError, match="must not be negative"):
        ScaledField(base, Schedule([0.0, 1.0], [1.0, -0.01]))


def test_what_a_scaled_field_is_called_by_is_what_it_begins_with() -> None:
    scaled = ScaledField(SLOW, Schedule([5.0, 6.0], [0.5, 2.0]))
    assert scaled.reference_wind_mps == 4.0
    assert not scaled.inside(0.0, 0.0, 10.0)


def test_without_a_time_a_factor_and_a_weight_are_those_at_zero() -> None:
    ramp = Schedule([-1.0, 1.0], [0.0, 1.0])  # a half at zero
    scaled, blend = ScaledField(SLOW, ramp), BlendedField(SLOW, FAST, ramp)
    for field in (scaled, blend):
        now = [float(part) for part in field.wind(*PLACE)]
        assert now == pytest.approx(field.wind_at(*PLACE, 0.0))
        assert now[0] != pytest.approx(field.wind_at(*PLACE, 0.5)[0], rel=0.01)
    assert scaled.wind_at(*PLACE, 0.0) == pytest.approx(
        tuple(0.5 * part for part in SLOW.wind_at(*PLACE, 0.0))
    )


class _Uniform:
    """The same wind everywhere, and everywhere inside, or nowhere."""

    def __init__(self, wind: tuple[float, float, float], *, inside: bool = True) -> None:
        self.reference_wind_mps = wind[0]
        self._wind, self._inside = wind, inside

    def wind_at(self, *_: float) -> tuple[float, float, float]:
        return self._wind

    def wind(self, *_: object) -> tuple[FloatArray, ...]:
        return tuple(np.array([part]) for part in self._wind)

    def inside(self, *_: float) -> bool:
        return self._inside


def _blend(weight: float, first: object, second: object) -> BlendedField:
    return BlendedField(first, second, Schedule([0.0], [weight]))  # type: ignore[arg-type]


@pytest.mark.parametrize("weight", [0.0, 0.25, 1.0])
def test_a_blend_lies_between_its_fields_by_its_weight_in_each_component(weight: float) -> None:
    blend = _blend(weight, _Uniform((8.0, 1.0, -2.0)), _Uniform((12.0, -3.0, 6.0)))
    expected = (8.0 + 4.0 * weight, 1.0 - 4.0 * weight, -2.0 + 8.0 * weight)
    assert blend.wind_at(*PLACE, 0.0) == pytest.approx(expected)
    assert [part[0] for part in blend.wind(*PLACE)] == pytest.approx(expected)
    assert blend.reference_wind_mps == pytest.approx(8.0 + 4.0 * weight)


@pytest.mark.parametrize(("weight", "which"), [(0.0, 0), (1.0, 1)])
def test_a_blend_that_is_one_of_its_fields_does_not_ask_the_other(
    weight: float, which: int
) -> None:
    fields = [_Uniform((8.0, 1.0, -2.0)), _Uniform((nan, nan, nan))]
    if which:
        fields.reverse()
    assert _blend(weight, *fields).wind_at(*PLACE, 0.0) == (8.0, 1.0, -2.0)


@pytest.mark.parametrize(("first", "second"), [(True, True), (True, False), (False, True)])
def test_inside_a_blend_is_inside_both(first: bool, second: bool) -> None:
    wind = (8.0, 0.0, 0.0)
    blend = _blend(0.5, _Uniform(wind, inside=first), _Uniform(wind, inside=second))
    assert blend.inside(*PLACE) is (first and second)


@pytest.mark.parametrize("weights", [(-0.01, 0.5), (0.5, 1.01)])
def test_a_weight_beyond_one_of_its_bounds_is_refused(weights: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="from 0 to 1"):
        BlendedField(SLOW, FAST, Schedule([0.0, 1.0], weights))


def test_no_gust_is_expected_of_a_wing_wider_than_all_eddies() -> None:
    """For a wide wing the roll variance falls with the span as b^(−4/3)."""

    def sigma(span_m: float) -> float:
        return roll_gust_start(roll_gust_params(0.03, 8.5, 1.5, span_m, 0.001), 1.0)

    assert sigma(8.0) / sigma(1.0) == pytest.approx(sqrt(8.0 ** (-4.0 / 3.0)))
    slower = (
        roll_gust_params(0.03, 8.5, 1.5, 8.0, 0.02),
        roll_gust_params(0.03, 8.5, 1.5, 1.0, 0.02),
    )
    assert slower[0].a == pytest.approx(slower[1].a ** (1.0 / 8.0))  # as long as a span takes

"""The loop from a log that is made of known tones: each equation of the page, each limit of what
counts as a period, and margins of loops that are straight lines over the logarithm of frequency."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, log10, pi
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t as student

from tgl_soar.analysis import loop_response
from tgl_soar.analysis.logs.flight_data import Series
from tgl_soar.analysis.loop_response import (
    AT_ELEVATOR,
    AT_SETPOINT,
    DRAWS,
    TONES_RADPS,
    LoopResponse,
    _bounded,
    _disk_margin,
    interpolated,
    loop_responses,
    margins_between_tones,
    open_loop_discs,
)

RUNNING = 1  # as the log has it
LEAD_S, PERIOD_S, PERIODS = 2.0, 5.0, 4
WINDOW_S = 20.0
DT_S = 0.05
N = round(25.0 / DT_S)
PER_PERIOD = round(PERIOD_S / DT_S)
FIRST = round(LEAD_S / DT_S)  # tick of the first period
KP, KI = 0.8, 1.7
S = np.array([0.4 - 0.3j, 0.9 + 0.3j, 1.5 + 1.0j, 1.2 - 1.1j, 1.6 - 0.2j, 1.1 + 0.1j])
S_ELEVATOR = np.array([0.3 + 0.2j, 0.8 - 0.3j, 1.4 + 0.6j, 1.3 - 0.9j, 1.2 - 0.4j, 1.05 + 0.2j])
R = 0.006 * np.exp(1j * np.array([0.3, 1.9, -2.0, 2.5, -0.7, 1.1]))  # of what is injected
TIME_S = DT_S * np.arange(float(N))

Complex = NDArray[np.complex128]


def sounding(amplitudes: NDArray[Any]) -> NDArray[np.float64]:
    """The sum of tones of these amplitudes, counted from the first period's beginning."""
    waves = amplitudes[:, None] * np.exp(1j * TONES_RADPS[:, None] * (TIME_S - LEAD_S))
    return np.asarray(waves.real.sum(axis=0))


def made(each: Complex | None = None) -> Series:
    """One multisine; each: the sensitivities of the four periods, shape (4, tones)."""
    sensitivities = np.tile(S, (PERIODS, 1)) if each is None else each
    setpoint = sounding(R * sensitivities[0])
    for k in range(1, PERIODS):
        rows = slice(FIRST + k * PER_PERIOD, FIRST + (k + 1) * PER_PERIOD)
        setpoint[rows] = sounding(R * sensitivities[k])[rows]
    error = sounding(0.01 * np.exp(1j * np.arange(6.0)))
    path = KP + KI * DT_S / (1.0 - np.exp(-1j * TONES_RADPS * DT_S))
    columns = {
        "standing": np.where((TIME_S > 1e-9) & (TIME_S < 23.0), RUNNING, 0).astype(float),
        "injected_rad": sounding(R),
        "setpoint_rad": setpoint,
        "pitch_rad": setpoint - error,
        "elevator": sounding(S_ELEVATOR * path * R),
        "elevator_p": KP * error,
        "elevator_i": np.cumsum(KI * DT_S * error),
    }
    columns["standing"][0] = RUNNING
    return Series(TIME_S, columns, "made")


def changed(series: Series, **columns: NDArray[np.float64]) -> Series:
    return replace(series, columns={**series.columns, **columns})


def without(series: Series, ticks: list[int]) -> Series:
    """With a gap at these ticks."""
    kept = np.setdiff1d(np.arange(len(series.time_s)), ticks)
    columns = {name: values[kept] for name, values in series.columns.items()}
    return Series(series.time_s[kept], columns, "made")


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where margins are not asked for, most of the time would be theirs."""
    monkeypatch.setattr(loop_response, "DRAWS", 2)


def counted(series: Series) -> int:
    """Periods that count."""
    found = loop_responses(series)
    return found[0].periods if found else 0


def test_the_tones_are_whole_periods_of_twenty_seconds() -> None:
    expected = [2.0 * pi * n / WINDOW_S for n in (8, 12, 20, 28, 40, 60)]
    assert TONES_RADPS.tolist() == pytest.approx(expected)


# --- from the log to sensitivities --------------------------------------------------------------


@pytest.mark.usefixtures("few_draws")
def test_both_breaks_are_found_from_one_flight() -> None:
    """At the elevator S = U / (F R), with the gains that the law's own terms show."""
    at_setpoint, at_elevator = loop_responses(made())
    assert (at_setpoint.at, at_elevator.at) == (AT_SETPOINT, AT_ELEVATOR)
    assert (AT_SETPOINT, AT_ELEVATOR) == ("pitch setpoint", "elevator")
    assert at_setpoint.sensitivity == pytest.approx(S, abs=1e-9)
    assert at_elevator.sensitivity == pytest.approx(S_ELEVATOR, abs=1e-9)
    assert at_setpoint.open_loop == pytest.approx(1.0 / S - 1.0, abs=1e-8)
    assert at_setpoint.periods == at_elevator.periods == PERIODS
    assert at_setpoint.variance == pytest.approx(np.zeros(6), abs=1e-15)


@pytest.mark.usefixtures("few_draws")
def test_a_mean_and_a_trend_are_no_part_of_the_tones() -> None:
    series = made()
    drifting = series["setpoint_rad"] + 0.3 + 0.02 * TIME_S
    found = loop_responses(changed(series, setpoint_rad=drifting))[0]
    assert found.sensitivity == pytest.approx(S, abs=1e-9)


@pytest.mark.usefixtures("few_draws")
def test_what_periods_differ_by_is_the_variance() -> None:
    """S is their mean; its variance that of one, over their number; the coherence what is left."""
    deltas = np.outer([0.3, -0.1, -0.4, 0.2], np.array([1.0, 1j, -1.0, 0.5j, 0.2, 0.1 + 0.1j]))
    each = S + deltas
    found = loop_responses(made(each))[0]
    assert found.sensitivity == pytest.approx(S, abs=1e-9)
    squares = (0.09 + 0.01 + 0.16 + 0.04) * np.abs(deltas[0] / 0.3) ** 2
    assert found.variance == pytest.approx(squares / 3.0 / 4.0)
    assert found.coherence == pytest.approx(4.0 * np.abs(S) ** 2 / np.sum(np.abs(each) ** 2, 0))


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("name", ["kp", "pitch", "error"])
def test_where_the_pitch_law_does_not_act_the_elevator_tells_nothing(name: str) -> None:
    series = made()
    spoilt = {
        "kp": changed(series, elevator_p=-series["elevator_p"]),
        "pitch": changed(series, pitch_rad=np.full(N, np.nan)),
        "error": changed(series, pitch_rad=series["setpoint_rad"]),
    }[name]
    assert [found.at for found in loop_responses(spoilt)] == [AT_SETPOINT]


# --- which periods count ------------------------------------------------------------------------


@pytest.mark.usefixtures("few_draws")
def test_one_period_alone_says_nothing_of_its_uncertainty() -> None:
    """The last tick of the second period is at 12 s less a tick."""
    series = made()
    for ticks, periods in ((239, 0), (240, 2), (339, 2), (340, 3), (440, 4)):
        standing = np.where(np.arange(N) < ticks, RUNNING, 3).astype(float)
        assert counted(changed(series, standing=standing)) == periods, ticks


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("name", ["injected_rad", "setpoint_rad"])
def test_a_period_with_a_tick_that_is_not_known_does_not_count(name: str) -> None:
    for tick, periods in ((FIRST - 1, 4), (FIRST, 3), (FIRST + 99, 3), (FIRST + 400, 4)):
        values = made()[name].copy()
        values[tick] = np.nan
        assert counted(changed(made(), **{name: values})) == periods, tick


@pytest.mark.usefixtures("few_draws")
def test_of_a_periods_ticks_two_in_a_hundred_may_be_missing() -> None:
    assert counted(without(made(), [FIRST + 130, FIRST + 131])) == 4
    assert counted(without(made(), [FIRST + 130, FIRST + 131, FIRST + 160])) == 3


@pytest.mark.usefixtures("few_draws")
def test_each_multisine_of_a_flight_counts_from_its_own_beginning() -> None:
    """Another one after a rest, at no whole number of periods from the first."""
    one = made()
    later = one.time_s + 25.0 + 1.35
    columns = {name: np.concatenate([one[name], one[name]]) for name in one.columns}
    both = Series(np.concatenate([one.time_s, later]), columns, "made")
    found = loop_responses(both)[0]
    assert found.periods == 8
    assert found.sensitivity == pytest.approx(S, abs=1e-9)


def test_a_flight_without_a_multisine_shows_nothing() -> None:
    assert loop_responses(changed(made(), standing=np.zeros(N))) == []
    assert loop_responses(changed(made(), standing=np.full(N, 2.0))) == []


# --- margins ------------------------------------------------------------------------------------

X = np.log(TONES_RADPS)


def through(size: list[float], phase_deg: list[float]) -> Complex:
    """S of the loop with these sizes and phases at the tones."""
    loop = np.array(size) * np.exp(1j * np.radians(phase_deg))
    return np.asarray(1.0 / (1.0 + loop))


def test_between_the_tones_size_and_phase_are_lines_over_the_logarithm() -> None:
    loop = (3.0 * TONES_RADPS**-0.8 * np.exp(-1j * 1.1 * X)).astype(np.complex128)
    radps, values = interpolated(loop)
    assert radps[[0, -1]] == pytest.approx(TONES_RADPS[[0, -1]])
    assert np.diff(np.log(radps)) == pytest.approx(
        np.full(len(radps) - 1, np.log(radps[1] / radps[0]))
    )
    assert values == pytest.approx(3.0 * radps**-0.8 * np.exp(-1j * 1.1 * np.log(radps)))


def test_a_phase_that_goes_on_beyond_minus_180_degrees_is_followed() -> None:
    """The argument jumps there by a whole turn; the loop does not."""
    loop = np.exp(-1j * 2.0 * X).astype(np.complex128)
    _, values = interpolated(loop)
    assert np.abs(np.diff(np.angle(values))).max() > 6.0
    assert np.abs(np.diff(values)).max() < 0.1


@pytest.mark.parametrize("slope", [0.6, 1.4])
def test_margins_of_a_loop_that_is_a_line(slope: float) -> None:
    """|L| = (3.5 / w)^slope, phase −180° at 8 rad/s, 60° for each unit of ln w."""
    phase_deg = -180.0 - 60.0 * np.log(TONES_RADPS / 8.0)
    s = through(((3.5 / TONES_RADPS) ** slope).tolist(), phase_deg.tolist())
    gain_db, phase, _ = margins_between_tones(s)
    assert gain_db == pytest.approx(20.0 * slope * log10(8.0 / 3.5), abs=1e-3)
    assert phase == pytest.approx(60.0 * np.log(8.0 / 3.5), rel=1e-9)


def test_the_least_of_several_crossings_is_the_margin() -> None:
    """The phase passes −180° three times, the gain 1 three times; of the latter 20° is nearest."""
    size = [0.5, 0.4, 0.8, 0.3, 0.2, 0.1]
    turned = through(size, [-170.0, -190.0, -190.0, -170.0, -170.0, -190.0])
    _, loop = interpolated(1.0 / turned - 1.0)
    near = np.abs(np.abs(np.degrees(np.angle(loop))) - 180.0) < 0.3
    most = float(np.abs(loop[near]).max())
    assert margins_between_tones(turned)[0] == pytest.approx(-20.0 * log10(most), abs=0.1)
    gained = through([2.0, 0.5, 0.5, 2.0, 2.0, 0.5], [-100.0, -100.0, -160.0, -160.0, -120, -120])
    assert margins_between_tones(gained)[1] == pytest.approx(20.0, abs=1e-6)


def test_crossings_of_the_positive_axis_and_beyond_minus_one_are_no_gain_margin() -> None:
    positive = through([0.5] * 6, [30.0, 10.0, -10.0, -30.0, -40.0, -50.0])
    assert isnan(margins_between_tones(positive)[0])
    beyond = through([3.0] * 6, [-170.0, -175.0, -185.0, -190.0, -190.0, -190.0])
    assert isnan(margins_between_tones(beyond)[0])


def test_a_phase_margin_counts_to_both_sides() -> None:
    lead = through([2.0, 1.5, 1.2, 0.8, 0.5, 0.3], [150.0] * 6)
    lag = through([2.0, 1.5, 1.2, 0.8, 0.5, 0.3], [-150.0] * 6)
    assert margins_between_tones(lead)[1] == pytest.approx(30.0)
    assert margins_between_tones(lag)[1] == pytest.approx(30.0)


def test_the_disk_margin_is_reported_only_where_it_is_least_within_the_tones() -> None:
    """By the greatest |S − 1/2|, here at the fourth tone: L = −0.5 there, S = 2."""
    within = through([0.1, 0.1, 0.2, 0.5, 0.2, 0.1], [-180.0] * 6)
    assert margins_between_tones(within)[2] == pytest.approx(1.0 / 1.5, rel=0.01)
    rising = through([0.1, 0.1, 0.2, 0.3, 0.4, 0.5], [-180.0] * 6)
    assert isnan(margins_between_tones(rising)[2])
    falling = through([0.5, 0.4, 0.3, 0.2, 0.1, 0.1], [-180.0] * 6)
    assert isnan(margins_between_tones(falling)[2])


@pytest.mark.parametrize(("place", "is_reported"), [(0, False), (1, True), (2, True), (3, False)])
def test_only_the_very_first_and_last_may_be_less_further_on(place: int, is_reported: bool) -> None:
    """Of four points, L = −0.5 at one: S = 2 there, 1.5 from a half."""
    loop = np.full(4, -0.1 + 0.0j)
    loop[place] = -0.5
    found = _disk_margin(loop)
    assert found == pytest.approx(1.0 / 1.5) if is_reported else isnan(found)


def test_a_flight_without_noise_has_margins_without_a_band() -> None:
    found = loop_responses(made())[0]
    expected = margins_between_tones(S)
    for margin, value in zip(found.margins, expected, strict=True):
        assert margin.value == pytest.approx(value, abs=1e-6, nan_ok=True)
        if not isnan(value):
            assert (margin.low, margin.high) == pytest.approx((value, value), abs=1e-5)


def test_the_band_of_a_margin_is_what_its_sensitivity_may_be_wrong_by() -> None:
    """Uncertain at one tone alone, at which L = −0.5: the disk margin is 1 / |S − 1/2| there.

    To first order only S's real part counts: a t of six degrees of freedom, as of four periods.
    """
    s = through([0.1, 0.1, 0.2, 0.5, 0.2, 0.1], [-180.0] * 6)
    deltas = np.zeros((PERIODS, 6), dtype=np.complex128)
    deltas[:, 3] = 0.03 * np.array([1.0, -1.0, 1j, -1j])
    found = loop_responses(made(s + deltas))[0]
    sd = np.sqrt(0.5 * found.variance[3])
    assert sd == pytest.approx(0.03 * np.sqrt(0.5 * 4.0 / 3.0 / 4.0))
    half = student.ppf(0.975, 6) * sd / 1.5**2
    alpha = found.margins.alpha
    assert 0.5 * (alpha.high - alpha.low) == pytest.approx(half, rel=0.25)
    assert alpha.low < alpha.value < alpha.high


def test_of_two_periods_alone_the_band_is_as_wide_as_two_degrees_of_freedom_make_it() -> None:
    """A t of two: 4.3 standard deviations to either side, where many periods have 2."""
    s = through([0.1, 0.1, 0.2, 0.5, 0.2, 0.1], [-180.0] * 6)
    deltas = np.zeros((PERIODS, 6), dtype=np.complex128)
    deltas[:2, 3] = 0.002, -0.002
    standing = np.where(np.arange(N) < FIRST + 2 * PER_PERIOD, RUNNING, 0).astype(float)
    series = changed(made(s + deltas), standing=standing, pitch_rad=np.full(N, np.nan))
    (found,) = loop_responses(series)
    assert found.periods == 2
    sd = np.sqrt(0.5 * found.variance[3])
    assert sd == pytest.approx(0.002 * np.sqrt(0.5 * 2.0 / 2.0))
    alpha = found.margins.alpha
    half = student.ppf(0.975, 2) * sd / 1.5**2
    assert 0.5 * (alpha.high - alpha.low) == pytest.approx(half, rel=0.4)


def test_a_band_holds_the_middle_95_per_cent_of_the_draws() -> None:
    drawn = [float(i) for i in range(DRAWS)]
    whole = _bounded(200.0, drawn)
    assert (whole.value, whole.low, whole.high) == pytest.approx((200.0, 0.025 * 399, 0.975 * 399))
    half = [*drawn[:200], *[float("nan")] * 200]
    assert _bounded(100.0, half).high == pytest.approx(0.975 * 199.0)
    fewer = _bounded(100.0, [*drawn[:199], *[float("nan")] * 201])
    assert fewer.value == 100.0
    assert isnan(fewer.low)
    assert isnan(fewer.high)
    none = _bounded(float("nan"), drawn)
    assert isnan(none.value)
    assert isnan(none.low)


@pytest.mark.usefixtures("few_draws")
def test_where_s_may_be_nought_the_open_loop_may_be_anything() -> None:
    """Else its disc is that of 1 / S − 1: from 1 / 1.2 − 1 to 1 / 0.8 − 1 for S = 1 ± 0.2."""
    known = loop_responses(made())[0]
    one = np.ones(6, dtype=np.complex128)
    radius_of_one = known._replace(sensitivity=one, variance=np.full(6, 1.0)).radius[0]
    exact: LoopResponse = known._replace(
        sensitivity=one, variance=np.full(6, (0.2 / radius_of_one) ** 2)
    )
    centres, radii = open_loop_discs(exact)
    ends = 1.0 / 1.2 - 1.0, 1.0 / 0.8 - 1.0
    assert centres.real == pytest.approx(np.full(6, 0.5 * sum(ends)))
    assert radii == pytest.approx(np.full(6, 0.5 * (ends[1] - ends[0])))
    lost = exact._replace(sensitivity=np.asarray(0.19 * one))
    assert np.isnan(open_loop_discs(lost)[1]).all()

"""What counts as a manoeuvre: each limit from both sides, on made-up sticks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.manoeuvres import LongitudinalLog, brakings, manoeuvres

STEP_S = 0.01
N = 1000  # ten seconds
BEGIN = 400


def log(elevator: Any = 0.0, **columns: Any) -> LongitudinalLog:
    """A level glide at 9 m/s down a slope of 6 degrees, by a stick."""
    one = np.ones(N)
    still = LongitudinalLog(
        time_s=STEP_S * np.arange(float(N)),
        elevator=elevator * one,
        pitch_rad=-0.05 * one,
        pitch_rate_radps=0.0 * one,
        roll_rad=0.0 * one,
        airspeed_mps=9.0 * one,
        path_angle_rad=-0.1 * one,
    )
    return replace(still, **columns)


def doublet(
    up: float = 0.1, down: float = -0.1, half: int = 20, begin: int = BEGIN, rest: float = 0.0
) -> Any:
    stick = np.full(N, rest)
    stick[begin : begin + half] += up
    stick[begin + half : begin + 2 * half] += down
    return stick


def test_a_doublet_lasts_from_a_tenth_of_a_second_before_to_rest_after_it() -> None:
    (rows,) = manoeuvres(log(doublet()))
    assert rows == slice(BEGIN - 10, BEGIN + 40 + 120)


def test_a_doublet_begins_out_of_any_rest() -> None:
    assert manoeuvres(log(doublet(rest=-0.3))) == manoeuvres(log(doublet()))


def test_two_doublets_within_a_second_and_a_half_are_one() -> None:
    far = doublet() + doublet(begin=BEGIN + 150)
    near = doublet() + doublet(begin=BEGIN + 149)
    assert [rows.start for rows in manoeuvres(log(far))] == [BEGIN - 10, BEGIN + 140]
    assert manoeuvres(log(near)) == [slice(BEGIN - 10, BEGIN + 150 + 120)]


@pytest.mark.parametrize(
    ("up", "down", "counts"),
    [
        (0.05, -0.05, True),
        (-0.05, 0.05, True),  # first down
        (0.05, -0.035, False),  # eight hundredths from side to side, half of that to each
        (0.035, -0.05, False),
        (0.1, 0.0, False),
        (0.1, 0.1, False),
    ],
)
def test_a_doublet_goes_far_enough_to_both_sides(up: float, down: float, counts: bool) -> None:
    assert len(manoeuvres(log(doublet(up, down)))) == counts


@pytest.mark.parametrize(("half", "counts"), [(4, False), (5, True), (74, True)])
def test_a_doublet_lasts_a_tenth_of_a_second_or_more(half: int, counts: bool) -> None:
    assert len(manoeuvres(log(doublet(half=half)))) == counts


def test_of_a_stick_that_stays_away_a_second_and_a_half_are_looked_at() -> None:
    late = doublet(half=149)  # the other side comes in the last hundredth
    assert manoeuvres(log(late)) == [slice(BEGIN - 10, BEGIN + 150 + 120)]
    assert manoeuvres(log(doublet(half=150))) == []


@pytest.mark.parametrize(("restless", "counts"), [(0.019, True), (0.021, False)])
def test_the_stick_stands_for_three_tenths_of_a_second_before(
    restless: float, counts: bool
) -> None:
    """To and fro about its mean, so that neither is the beginning of a move."""
    for first, expected in ((BEGIN - 30, counts), (BEGIN - 32, True)):
        stick = doublet()
        stick[first : first + 2] += 0.5 * restless, -0.5 * restless
        assert len(manoeuvres(log(stick))) == expected


@pytest.mark.parametrize(("begin", "counts"), [(29, False), (30, True), (839, True), (881, False)])
def test_a_doublet_lies_in_the_log_with_what_belongs_to_it(begin: int, counts: bool) -> None:
    found = manoeuvres(log(doublet(begin=begin)))
    assert len(found) == counts
    assert all(rows.stop <= N and rows.start == begin - 10 for rows in found)


def test_a_short_log_holds_none() -> None:
    short = log(doublet(begin=31))
    names = ("time_s", "elevator", "pitch_rad", "pitch_rate_radps", "roll_rad", "airspeed_mps")
    cut = {name: getattr(short, name)[:150] for name in (*names, "path_angle_rad")}
    assert manoeuvres(LongitudinalLog(**cut)) == []


@pytest.mark.parametrize(
    ("column", "value", "counts"),
    [
        ("roll_rad", 0.34, True),
        ("roll_rad", 0.36, False),
        ("roll_rad", -0.36, False),
        ("path_angle_rad", -0.39, True),  # an angle of attack of 0.34
        ("path_angle_rad", -0.41, False),
        ("path_angle_rad", 0.31, False),
        ("pitch_rad", 0.26, False),
        ("airspeed_mps", 1.1, True),
        ("airspeed_mps", 0.9, False),
        ("pitch_rate_radps", np.nan, False),
        ("pitch_rad", np.nan, False),
        ("path_angle_rad", np.nan, False),
        ("airspeed_mps", np.nan, False),
        ("brake", np.nan, False),
    ],
)
def test_wings_are_level_flow_attached_and_all_is_measured(
    column: str, value: float, counts: bool
) -> None:
    whole = log(doublet(), brake=np.zeros(N))
    for at in (BEGIN - 10, BEGIN + 159):  # first and last of the manoeuvre
        values = getattr(whole, column).copy()
        values[at] = value
        changes: dict[str, Any] = {column: values}
        assert len(manoeuvres(replace(whole, **changes))) == counts
    for at in (BEGIN - 11, BEGIN + 160):  # beside it
        values = getattr(whole, column).copy()
        values[at] = value
        changes = {column: values}
        assert len(manoeuvres(replace(whole, **changes))) == 1


# --- the brake -------------------------------------------------------------------------------


def pulse(out: float, begin: int = 700, n: int = 50) -> Any:
    brake = np.zeros(N)
    brake[begin : begin + n] = out
    return brake


@pytest.mark.parametrize(("out", "counts"), [(0.24, False), (0.26, True), (1.0, True)])
def test_a_brake_that_leaves_its_rest_by_a_quarter_is_a_manoeuvre(out: float, counts: bool) -> None:
    """Later than what belongs to the doublet: it takes until its 160th sample."""
    moved = log(doublet(), brake=pulse(out))
    expected = [slice(700 - 10, 750 + 120)] if counts else []
    assert brakings(moved, manoeuvres(moved)) == expected


def test_a_brake_that_comes_in_is_one_as_well() -> None:
    moved = log(doublet(), brake=1.0 - pulse(0.5))
    assert brakings(moved, manoeuvres(moved)) == [slice(690, 870)]


def test_a_brake_within_a_doublet_or_another_braking_is_not_counted_twice() -> None:
    within = log(doublet(), brake=pulse(1.0, begin=BEGIN + 165, n=30))
    assert brakings(within, manoeuvres(within)) == []
    beside = log(doublet(), brake=pulse(1.0, begin=BEGIN + 171, n=30))
    assert len(brakings(beside, manoeuvres(beside))) == 1
    twice = log(doublet(begin=50), brake=pulse(1.0, 400) + pulse(1.0, 400 + 50 + 125))
    assert len(brakings(twice, manoeuvres(twice))) == 1
    apart = log(doublet(begin=50), brake=pulse(1.0, 400) + pulse(1.0, 400 + 50 + 131))
    assert len(brakings(apart, manoeuvres(apart))) == 2


def test_without_a_brake_or_a_doublet_nothing_tells_of_it() -> None:
    assert brakings(log(doublet()), manoeuvres(log(doublet()))) == []
    alone = log(brake=pulse(1.0))
    assert brakings(alone, manoeuvres(alone)) == []


def glided(brake: Any, **columns: Any) -> list[slice]:
    """Steady flight with the brake elsewhere than in the doublet, which takes until 210."""
    flown = log(doublet(begin=50), brake=brake, **columns)
    return brakings(flown, manoeuvres(flown))


def elsewhere(out: float) -> Any:
    """It creeps there too slowly to be a move: a hundredth in every tenth of a second."""
    brake = np.clip(0.001 * (np.arange(N) - 300.0), 0.0, out)
    brake[:210] = 0.0
    return brake


@pytest.mark.parametrize(("out", "found"), [(0.24, []), (0.26, [slice(600, 800)])])
def test_steady_glides_of_two_seconds_with_it_elsewhere_tell_of_it(
    out: float, found: list[slice]
) -> None:
    assert glided(elsewhere(out)) == found


def test_a_glide_is_steady_measured_and_no_part_of_a_doublet() -> None:
    restless = elsewhere(0.26)
    restless[700] += 0.021
    assert glided(restless) == []
    calm = elsewhere(0.26)
    calm[700] += 0.019
    assert glided(calm) == [slice(600, 800)]
    banked = np.zeros(N)
    banked[700] = 0.5
    assert glided(elsewhere(0.26), roll_rad=banked) == []


def test_of_many_glides_eight_at_most_are_taken_evenly() -> None:
    n = 200 * 21
    one = np.ones(n)
    brake = np.concatenate([np.zeros(400), np.full(n - 400, np.nan)])
    brake[600:] = 1.0
    stick = np.zeros(n)
    stick[50:70], stick[70:90] = 0.1, -0.1
    flown = LongitudinalLog(
        time_s=STEP_S * np.arange(float(n)),
        elevator=stick,
        pitch_rad=-0.05 * one,
        pitch_rate_radps=0.0 * one,
        roll_rad=0.0 * one,
        airspeed_mps=9.0 * one,
        path_angle_rad=-0.1 * one,
        brake=brake,
    )
    found = brakings(flown, manoeuvres(flown))
    begins = [rows.start for rows in found]
    assert begins == [*range(600, n - 200, 3 * 200)]  # of seventeen each third
    assert all(rows.stop - rows.start == 200 for rows in found)

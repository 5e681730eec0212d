"""Whether a brake pulls to one side: its averages by hand, and each of the limits that show it."""

from __future__ import annotations

from math import inf, nan, sqrt

import pytest

from tgl_soar.control.brake_watch import NOT_WATCHED, EvenState, even_step, pulls


def test_the_first_sample_is_the_mean_and_moves_nothing() -> None:
    state = even_step(NOT_WATCHED, 0.4, -0.1, 0.5)
    assert (state.brake, state.aileron) == (0.4, -0.1)
    assert (state.brake_2, state.both, state.aileron_2) == (0.0, 0.0, 0.0)
    assert state.watched == pytest.approx(0.5 / 20.5)


def test_means_follow_in_two_seconds_and_squares_in_twenty() -> None:
    """Of a window that is full."""
    full = EvenState(brake=0.4, aileron=0.1, brake_2=0.04, both=0.01, aileron_2=0.02, watched=1.0)
    state = even_step(full, 0.9, -0.4, 0.5)
    near, slow = 0.5 / 2.5, 0.5 / 20.5
    b, a = 0.5 * (1.0 - near), -0.5 * (1.0 - near)
    assert state.brake == pytest.approx(0.4 + 0.5 * near)
    assert state.aileron == pytest.approx(0.1 - 0.5 * near)
    assert state.brake_2 == pytest.approx(0.04 + slow * (b * b - 0.04))
    assert state.both == pytest.approx(0.01 + slow * (a * b - 0.01))
    assert state.aileron_2 == pytest.approx(0.02 + slow * (a * a - 0.02))
    assert state.watched == 1.0


def test_of_a_window_that_is_not_full_all_counts_alike() -> None:
    """The mean of three samples is the mean of three; the second moves the squares by half."""
    state = NOT_WATCHED
    for brake in (0.0, 0.6, 0.3):
        state = even_step(state, brake, 0.0, 1e-3)
    assert state.brake == pytest.approx(0.3, abs=1e-3)
    two = even_step(even_step(NOT_WATCHED, 0.0, 0.0, 1e-3), 0.6, 0.2, 1e-3)
    assert two.brake_2 == pytest.approx(0.5 * 0.09, rel=1e-3)
    assert two.both == pytest.approx(0.5 * 0.03, rel=1e-3)


@pytest.mark.parametrize(
    ("brake", "aileron", "dt_s"),
    [(nan, 0.0, 0.1), (0.1, nan, 0.1), (inf, 0.0, 0.1), (0.1, 0.0, 0.0), (0.1, 0.0, -0.1),
     (0.1, 0.0, nan)],
)  # fmt: skip
def test_what_is_no_number_and_no_time_is_passed_over(
    brake: float, aileron: float, dt_s: float
) -> None:
    state = even_step(NOT_WATCHED, 0.4, -0.1, 0.5)
    assert even_step(state, brake, aileron, dt_s) == state


def watched(
    slope: float, *, brake_2: float = 0.01, sigmas: float = 10.0, watched: float = 1.0
) -> EvenState:
    """A brake and an aileron that follows it by a slope, known within so many deviations."""
    samples = watched * 20.0 / 0.3
    # s² = (<a a> - slope <a b>) / (<b b> n)
    left = (slope / sigmas) ** 2 * brake_2 * samples
    both = slope * brake_2
    return EvenState(
        brake=0.5, aileron=0.0, brake_2=brake_2, both=both, aileron_2=slope * both + left,
        watched=watched,
    )  # fmt: skip


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("slope", "found"), [(0.079, False), (0.081, True)])
def test_less_than_a_twelfth_of_the_aileron_is_no_pull(
    slope: float, found: bool, side: float
) -> None:
    assert pulls(watched(side * slope)) is found


@pytest.mark.parametrize(("sigmas", "found"), [(3.95, False), (4.05, True)])
def test_a_slope_is_known_by_four_deviations(sigmas: float, found: bool) -> None:
    assert pulls(watched(0.3, sigmas=sigmas)) is found
    assert pulls(watched(-0.3, sigmas=sigmas)) is found


@pytest.mark.parametrize(("rms", "found"), [(0.0199, False), (0.0201, True)])
def test_a_brake_that_hardly_moves_tells_nothing(rms: float, found: bool) -> None:
    assert pulls(watched(0.3, brake_2=rms * rms)) is found
    assert sqrt(watched(0.3, brake_2=rms * rms).brake_2) == pytest.approx(rms)


@pytest.mark.parametrize(("fraction", "found"), [(0.449, False), (0.45, True), (0.451, True)])
def test_nine_seconds_of_it_are_thirty_samples(fraction: float, found: bool) -> None:
    assert pulls(watched(0.3, watched=fraction)) is found

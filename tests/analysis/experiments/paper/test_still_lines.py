"""Lines held still: what is claimed of place, settling and dispersion, of made-up legs."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import pytest
from by_hand import PLAIN, signs

from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    mean_of_flights,
    rms_error,
)
from tgl_soar.analysis.experiments.paper.still_lines import (
    MISS_MOST_M,
    LegSummary,
    MissOfFlight,
    dispersion_note,
    known_place_note,
    place_claim,
    settled_claim,
)
from tgl_soar.control.target_line import TargetLine, eta_from_lean


def leg(
    miss_m: float = 0.01,
    settling_s: float = 1.0,
    error_m: float = 0.002,
    one_m: float | None = None,
    one_error_m: float = 0.006,
) -> LegSummary:
    one = MissOfFlight(miss_m if one_m is None else one_m, one_error_m)
    return LegSummary(
        line="a",
        flights=8,
        settling_s=settling_s,
        rms_e_rho_m=0.005,
        peak_e_rho_m=0.02,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        miss_m=miss_m,
        miss_error_m=error_m,
        apart_m=0.09,
        own_miss_m=miss_m,
        own_error_m=error_m,
        worst_own=one,
        worst_file=one,
        worst_glide_m=0.001,
        known_to_m=one_error_m,
        dispersion_m=0.03,
        dispersion_formula_m=0.03,
        stalled_fraction=0.0,
        mean_x_m=0.0,
        mean_z_m=1.0,
    )


@pytest.mark.parametrize(
    ("legs", "sign"),
    [
        ((leg(0.01), leg(-0.02)), "✓"),
        ((leg(0.01), leg(MISS_MOST_M + 0.006)), "✗"),
        ((leg(0.01), leg(-MISS_MOST_M - 0.006)), "✗"),
        ((leg(0.01), leg(MISS_MOST_M - 0.004)), "?"),  # 2.4 errors of 2 mm go beyond
        ((leg(0.01, error_m=0.03),), "?"),  # the mean of flights that are far apart
        ((leg(0.0, one_m=0.09),), "✗"),  # each is 9 cm off, the mean of all is not
        ((leg(0.0, one_error_m=0.016),), "?"),  # one flight is not known to half the bound
        ((leg(0.01), leg(nan)), "✗"),  # the line meets no contour
        ((), "✗"),
    ],
)
def test_it_hovers_at_the_crossing_on_every_leg(legs: tuple[LegSummary, ...], sign: str) -> None:
    assert signs([place_claim(list(legs))]) == sign


def test_with_the_files_alone_it_is_reported_how_far_off_each_aircraft_is() -> None:
    far = known_place_note([leg(0.0, one_m=-0.157)])
    assert "at most 15.7 ± 0.6 cm away (line a, at 1 % of turbulence)" in far
    assert "9.0 cm apart" in far
    assert known_place_note([]) == ""


def test_the_error_of_a_mean_is_that_of_the_flights_and_not_of_their_samples() -> None:
    """Two aircraft that each stay where they are, 18 cm apart: ± 9 cm, not nothing."""
    one, other = (
        replace(flight(1).legs[0], along_m=along, dispersion_m=1e-4) for along in (-0.09, 0.09)
    )
    mean = mean_of_flights(each.along_m for each in (one, other))
    assert mean.mean == pytest.approx(0.0)
    assert mean.error == pytest.approx(0.09)
    assert mean_of_flights([0.1]).error == inf
    assert rms_error([1.0, 1.0]) == 0.0
    assert rms_error([1.0]) == inf


def test_dispersion_that_is_not_the_formulas_is_not_laid_on_the_stall_where_none_stalled() -> None:
    much = leg()._replace(dispersion_m=0.06)
    assert "the stall is not the reason" in dispersion_note({0.01: [much]})
    stalled = much._replace(stalled_fraction=0.185)
    assert "beyond the stall's incidence 18.5 % of the time" in dispersion_note({0.05: [stalled]})
    assert "has no stall" in dispersion_note({0.05: [stalled]}, stalls=False)
    assert "stall" not in dispersion_note({0.01: [leg()]})
    calm = leg()._replace(dispersion_formula_m=0.0, apart_m=0.086)
    assert "differs by 8.6 cm (standard" in dispersion_note({0.0: [calm], 0.01: [leg()]})


def flight(legs: int, ended: str = "") -> FlownScenario:
    leaning = TargetLine(0.0, 1.0, eta_from_lean(0.3))
    scored = replace(PLAIN, target=leaning, predicted_along_m=nan)
    return FlownScenario(seed=1, ended=ended, duration_s=20.0, legs=(scored,) * legs, path={})


@pytest.mark.parametrize(
    ("flights", "settling_s", "holds"),
    [
        ([flight(2), flight(2)], 4.9, True),
        ([flight(2), flight(2)], 5.1, False),  # to the line, too late
        ([flight(2), flight(2)], inf, False),  # never
        ([flight(2), flight(1)], 1.0, False),  # a line not reached
        ([flight(2), flight(2, "hit the board")], 1.0, False),
    ],
)
def test_settled_is_on_every_line_in_time_and_to_the_end(
    flights: list[FlownScenario], settling_s: float, holds: bool
) -> None:
    assert settled_claim(flights, [leg(), leg(settling_s=settling_s)], 2).holds is holds

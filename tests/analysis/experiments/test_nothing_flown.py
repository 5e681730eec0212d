"""Where nothing was flown, or nothing was measured, no claim holds."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import pytest
from by_hand import signs

from tgl_soar.analysis.experiments.estimates.estimator_flights import Ratios
from tgl_soar.analysis.experiments.estimates.wind_use import Compared, worth_claim
from tgl_soar.analysis.experiments.lift import search
from tgl_soar.analysis.experiments.loop.leans import LeanCase, LeanCount, lean_count_claims
from tgl_soar.analysis.experiments.outdoors import beating, hour
from tgl_soar.analysis.experiments.paper.changing_air import Shift, slope_claims
from tgl_soar.analysis.experiments.paper.gust_response import WindEffect, sensitivity_claims
from tgl_soar.analysis.search.scoring import Score


@pytest.mark.parametrize("at", [5.0, 10.0, 15.0])
def test_a_lean_of_which_none_flew_long_enough_is_not_held(at: float) -> None:
    good = LeanCount(flights=96, lost=0, rms_e_rho_m=0.01, rms_y_m=0.1, ended="")
    counts = {LeanCase("with", 0.01, deg): good for deg in (5.0, 10.0, 15.0)}
    counts[LeanCase("with", 0.01, at)] = good._replace(lost=96, rms_e_rho_m=nan)
    claim = lean_count_claims(counts)[1]
    assert not claim.holds
    assert claim.measured == f"at most nan cm, at {at:g}°"


def test_without_a_ratio_nothing_is_known_of_a_laws_worth() -> None:
    none = Compared(Ratios(nan, nan, 32), 32, 32)
    claim = worth_claim({"neither": none, "trim": none})
    assert not claim.holds
    assert not claim.undecided
    assert worth_claim({"neither": Compared(Ratios(1.0, 1.0), 0, 0), "trim": none}).holds


def test_a_search_where_the_oracle_soars_nowhere_shows_nothing() -> None:
    nowhere = Score(
        kind="tunnel", seed=1001, words="", change=1.0, begins=0.5, searcher="", soared=False,
        settled_s=inf, found_s=inf, claimed_s=inf, false_claim=False, given_up="", in_time=True,
        aloft=False, ended="", height_left_m=1.0, height_lost_m=1.0, room_m=nan, flown_s=40.0,
    )  # fmt: skip
    scores = [replace(nowhere, searcher=name) for name in (*search.MANY, search.PATIENT)]
    held = [claim.text for claim in search._claims("tunnel", scores) if claim.holds]
    assert held == [
        "tunnel: false claims in ≤ 2 %",
        "tunnel: given up in time in ≥ 95 % where the oracle does not soar",
    ]


def test_of_no_flights_nothing_is_shown_outdoors() -> None:
    assert not any(claim.holds for claim in beating._claims([]))
    home = next(c for c in hour._claims([]) if "touch down" in c.text)
    assert (home.holds, home.measured) == (False, "none broke off")


def test_shifts_of_those_that_lasted_alone_show_no_rise() -> None:
    same = Shift(
        line="a", flown_m=0.16, predicted_m=0.16, up_m=0.15, error_m=0.002, off_m=0.0,
        off_error_m=0.002, worst_off_m=0.01, worst_glide_m=0.01,
    )  # fmt: skip
    assert signs(slope_claims([same])) == "✓✓"
    assert signs(slope_claims([same], lost=1)) == "✓✗"


def test_an_answer_to_a_gust_is_that_of_all_flights() -> None:
    slow = WindEffect(
        line="a", wind_mps=8.0, sink_mps=1.0, updraft_gain=0.2, sink_gain=0.1, at_once_m=0.03,
        highest_m=0.04, in_the_end_m=0.04, predicted_m=0.04, at_once_error_m=0.001,
        highest_error_m=0.001, in_the_end_error_m=0.001,
    )  # fmt: skip
    assert signs(sensitivity_claims([slow], 9.0))[1:] == "✓✓"
    assert signs(sensitivity_claims([slow._replace(lost=1)], 9.0))[1:] == "✗✗"

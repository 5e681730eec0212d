"""What of a case's margins is reported: of four breaks the least, either way."""

from __future__ import annotations

import pytest

from tgl_soar.analysis.linear_model import Margin
from tgl_soar.analysis.margins import (
    CaseMargins,
    MarginCase,
    least_delay_s,
    least_gain_db,
    least_phase_deg,
    worst,
)

WIDE = Margin(
    alpha=1.0, at_radps=5.0, gain_up_db=9.5, gain_down_db=-9.5, phase_deg=53.0, delay_s=0.1
)


def case(**breaks: Margin) -> CaseMargins:
    """One with large margins at its other loop breaks."""
    return CaseMargins(
        case=MarginCase(8.5, 15.0, 0.0075, True),
        **{name: breaks.get(name, WIDE) for name in ("elevator", "line", "aileron", "rudder")},
        e_rho_m=0.01,
        activity=0.1,
    )


@pytest.mark.parametrize("name", ["elevator", "line", "aileron", "rudder"])
def test_the_least_of_each_is_reported_wherever_it_is(name: str) -> None:
    """In decibels from where the gain is, upwards or downwards: a loop may bear less of either."""
    assert least_gain_db(case(**{name: WIDE._replace(gain_up_db=4.0)})) == 4.0
    assert least_gain_db(case(**{name: WIDE._replace(gain_down_db=-3.0)})) == 3.0
    assert least_phase_deg(case(**{name: WIDE._replace(phase_deg=20.0)})) == 20.0
    assert least_delay_s(case(**{name: WIDE._replace(delay_s=0.02)})) == 0.02
    low = case(**{name: WIDE._replace(alpha=0.3)})
    assert low.alpha == 0.3
    assert worst([case(), low, case()]) is low


def test_an_unstable_loop_bears_no_gain_at_all() -> None:
    """Whatever its other breaks would bear."""
    unstable = WIDE._replace(alpha=0.0, gain_up_db=0.0, gain_down_db=0.0)
    assert least_gain_db(case(line=unstable)) == 0.0

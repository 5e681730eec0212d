"""`identification`: what it compares, of aircraft that are not the file's."""

import pytest

from tgl_soar.analysis.experiments.aircraft.identification import (
    CHECKED_MPS,
    GlideJob,
    checked_speeds,
    flies,
)
from tgl_soar.sim.aircraft import glide_at


def test_polars_are_compared_at_the_speeds_that_the_page_names() -> None:
    assert checked_speeds(flies(GlideJob(1)).model) == pytest.approx(CHECKED_MPS)
    assert CHECKED_MPS[0] == 8.2


def test_no_polar_is_compared_below_the_slowest_glide_of_an_aircraft() -> None:
    slow = flies(GlideJob(75, dispersed=True)).model
    with pytest.raises(ValueError, match=r"no steady glide at 8\.2 m/s"):
        glide_at(slow, CHECKED_MPS[0])
    speeds = checked_speeds(slow)
    assert 8.2 < speeds[0] < 8.6
    assert speeds[1:] == pytest.approx(CHECKED_MPS[1:])
    assert all(glide_at(slow, speed).sink_mps > 0.0 for speed in speeds)

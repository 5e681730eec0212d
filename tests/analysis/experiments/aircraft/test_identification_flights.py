"""`identification`: what it compares, of aircraft that are not the file's."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan
from typing import Any

import pytest

from tgl_soar.analysis.experiments.aircraft.identification import (
    CHECKED_MPS,
    Examined,
    GlideJob,
    checked_speeds,
    flies,
    identification,
)
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.sim.aircraft import glide_at
from tgl_soar.types import GlidePolar

WIDE = GlidePolar(c0=0.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=7.0, speed_max_mps=12.0)


def test_polars_are_compared_at_the_speeds_that_the_page_names() -> None:
    assert checked_speeds(flies(GlideJob(1)).model, WIDE) == pytest.approx(CHECKED_MPS)
    assert CHECKED_MPS[0] == 8.2


def test_no_polar_is_compared_below_the_slowest_glide_of_an_aircraft() -> None:
    slow = flies(GlideJob(75, dispersed=True)).model
    with pytest.raises(ValueError, match=r"no steady glide at 8\.2 m/s"):
        glide_at(slow, CHECKED_MPS[0])
    speeds = checked_speeds(slow, WIDE)
    assert 8.2 < speeds[0] < 8.6
    assert speeds[1:] == pytest.approx(CHECKED_MPS[1:])
    assert all(glide_at(slow, speed).sink_mps > 0.0 for speed in speeds)


def test_no_polar_is_compared_where_no_glide_was_flown() -> None:
    """Outside of its range it is not defined, and would be compared with nothing."""
    reached = WIDE._replace(speed_min_mps=8.27, speed_max_mps=10.5)
    speeds = checked_speeds(flies(GlideJob(1)).model, reached)
    assert speeds[:2] == (8.27, CHECKED_MPS[1])
    assert speeds[-2:] == (10.5, 10.5)


def examined(error: float) -> Examined:
    """As well as that."""
    lost = error == inf
    return Examined(
        duration_s=0.0 if lost else 116.0,
        sink_error=error,
        sink_held=(not lost,) * len(CHECKED_MPS),
        period_error=-error,
        effect_error=error,
        delay_error_s=0.01 * error,
        held=(not lost,) * 3,
        explained=nan if lost else 0.99,
    )


def concluded(monkeypatch: pytest.MonkeyPatch, flights: Sequence[Examined]) -> Any:
    monkeypatch.setattr(Context, "each", lambda _self, _function, _jobs: flights)
    return identification(Context(flyer=Flyer(), quick=False))


def test_a_log_that_is_refused_misses_every_claim(monkeypatch: pytest.MonkeyPatch) -> None:
    """And is reported as refused: no number is made of it."""
    good = concluded(monkeypatch, [examined(0.01)] * 100)
    assert all(claim.holds for claim in good.claims)
    assert good.claims[0].measured == "at most 1.0 %"
    two = concluded(monkeypatch, [examined(0.01)] * 98 + [examined(inf)] * 2)
    within, held = two.claims[:4], two.claims[4:]
    assert not any(claim.holds for claim in within)
    assert all(claim.holds for claim in held)
    assert two.claims[1].measured == "at most 1.0 %; 2 of 100 logs refused"
    assert two.claims[5].measured == "in 100%; 2 of 100 logs refused"
    assert {row[3] for row in two.tables[0].rows} == {"1.00 %", "0.10 ms"}
    eleven = concluded(monkeypatch, [examined(0.01)] * 89 + [examined(inf)] * 11)
    assert not any(claim.holds for claim in eleven.claims)
    with pytest.raises(ValueError, match="no log of 3 could be identified"):
        concluded(monkeypatch, [examined(inf)] * 3)

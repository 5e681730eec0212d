"""A way home is the same compiled: the figures of `outdoors` and `hour` are of compiled flights,
and their quick tests are not."""

from __future__ import annotations

import pytest

from tgl_soar.analysis.experiments.outdoors import hour, outdoors
from tgl_soar.analysis.experiments.outdoors.hour import HourCase, HourJob, fly_hour
from tgl_soar.analysis.experiments.outdoors.outdoors import PassageJob, fly_passage
from tgl_soar.sim.compiled import available

pytestmark = [
    pytest.mark.long,
    pytest.mark.xdist_group("kernels"),
    pytest.mark.skipif(not available(), reason="it needs numba"),
]


def test_a_break_off_in_a_dying_wind_ends_on_the_same_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job = HourJob(HourCase(8.0), 4, 60.0)
    compiled = fly_hour(job)
    monkeypatch.setattr(hour, "available", lambda: False)
    assert compiled.landing
    assert compiled == fly_hour(job)


def test_a_break_off_by_command_ends_on_the_same_place(monkeypatch: pytest.MonkeyPatch) -> None:
    job = PassageJob(outdoors.LAND, 1)
    compiled = fly_passage(job)
    monkeypatch.setattr(outdoors, "available", lambda: False)
    plain = fly_passage(job)
    assert compiled.landed
    assert (compiled.along_m, compiled.across_m, compiled.sink_mps) == (
        plain.along_m,
        plain.across_m,
        plain.sink_mps,
    )

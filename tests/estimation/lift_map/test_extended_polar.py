"""The polar for arrays agrees with the polar, and is no better beyond its ends."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.estimation.lift_map.extended_polar import sink, sink_slope
from tgl_soar.types import polar_sink, polar_slope

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()


def test_within_its_range_it_is_the_polar() -> None:
    speeds = np.linspace(POLAR.speed_min_mps, POLAR.speed_max_mps, 12)
    assert sink(POLAR, speeds) == pytest.approx([polar_sink(POLAR, v) for v in speeds])
    assert sink_slope(POLAR, speeds) == pytest.approx([polar_slope(POLAR, v) for v in speeds])


@pytest.mark.parametrize(("end", "beyond"), [(7.6, -1.5), (12.0, 1.5)])
def test_beyond_its_ends_it_sinks_more_than_its_tangent(end: float, beyond: float) -> None:
    straight = polar_sink(POLAR, end) + polar_slope(POLAR, end) * beyond
    assert float(sink(POLAR, end + beyond)) > straight + 0.5
    h = 1e-5
    slope = (sink(POLAR, end + beyond + h) - sink(POLAR, end + beyond - h)) / (2.0 * h)
    assert float(sink_slope(POLAR, end + beyond)) == pytest.approx(float(slope), rel=1e-6)

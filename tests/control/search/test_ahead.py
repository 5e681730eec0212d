"""The line of a rollout moves as the flown one does, to whichever side it has to go."""

from __future__ import annotations

from math import cos, inf, radians, sin, sqrt

import numpy as np
import pytest

from tgl_soar.control.search.ahead import LineWay, Within, line_speed

ETA = radians(105.0)
SPEED_MPS, ACCELERATION_MPS2, DT_S = 0.5, 0.4, 0.1
WITHIN = Within(
    x_min_m=-inf,
    x_max_m=inf,
    z_min_m=-inf,
    z_max_m=inf,
    clearance_m=0.0,
    speed_min_mps=0.0,
    speed_max_mps=inf,
    slide_mps=SPEED_MPS,
    acceleration_mps2=ACCELERATION_MPS2,
)


@pytest.mark.parametrize("upstream_m", [-3.0, -0.1, 0.1, 3.0])
@pytest.mark.parametrize("along_m", [-2.0, 0.0, 5.0])
def test_how_fast_it_goes_is_of_the_way_across_it_alone(upstream_m: float, along_m: float) -> None:
    """Where on its line the target is named makes no difference."""
    x, z = 1.5, 10.0
    way = LineWay(
        x_m=x - upstream_m * sin(ETA) + along_m * cos(ETA),
        z_m=z + upstream_m * cos(ETA) + along_m * sin(ETA),
        sine=sin(ETA),
        cosine=cos(ETA),
        sine_now=sin(ETA),
        cosine_now=cos(ETA),
    )
    fastest = min(SPEED_MPS, sqrt(2.0 * ACCELERATION_MPS2 * abs(upstream_m)))
    wanted = np.copysign(fastest, upstream_m)
    assert line_speed(WITHIN, way, x, z, wanted, DT_S) == pytest.approx(wanted)
    begun = line_speed(WITHIN, way, x, z, 0.0, DT_S)
    assert begun == pytest.approx(np.copysign(ACCELERATION_MPS2 * DT_S, upstream_m))
    # One that goes the other way is slowed down first.
    turned = line_speed(WITHIN, way, x, z, -wanted, DT_S)
    assert turned == pytest.approx(-wanted + np.copysign(ACCELERATION_MPS2 * DT_S, upstream_m))

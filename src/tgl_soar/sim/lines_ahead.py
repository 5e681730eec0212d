"""Lines flown ahead one by one, for numba: the step is that of `control.search.ahead`.

`control.search.rollout.roll_out` takes the same step with arrays of all of them; tests compare the
two to the last bit.
"""

from __future__ import annotations

from math import inf

from tgl_soar.air.field import FloatArray
from tgl_soar.control.search.ahead import Ahead, LineWay, Mesh, Within, ahead_step
from tgl_soar.types import GlidePolar


def fly_lines(
    mesh: Mesh,
    wind: FloatArray,
    updraft: FloatArray,
    scale: FloatArray,
    ends: FloatArray,
    grown: FloatArray,
    polar: GlidePolar,
    within: Within,
    begin: Ahead,
    targets: FloatArray,
    sines: FloatArray,
    cosines: FloatArray,
    dt_s: float,
    flown: FloatArray,
) -> None:
    """Fly n lines in m fields (m · nodes,) of these scales (m,) of sink.

    ends, (m,): the wind at the end, as a multiple of that at the beginning; grown, (steps,): how
    much of that there is in each step.
    targets, (4, n): x, z, sine and cosine of the inclination; sines, cosines, (steps, n): of the
    line in each step; flown, (m, n, 6), is filled: when it failed, climb, x, z, margin and the
    airspeed's margin.
    """
    for i in range(len(scale)):
        for j in range(targets.shape[1]):
            at, failed_s, margin_m = begin, inf, inf
            for n in range(len(sines)):
                slide = LineWay(
                    x_m=targets[0, j],
                    z_m=targets[1, j],
                    sine=targets[2, j],
                    cosine=targets[3, j],
                    sine_now=sines[n, j],
                    cosine_now=cosines[n, j],
                )
                at = ahead_step(
                    mesh,
                    wind,
                    updraft,
                    i * mesh.nx * mesh.nz,
                    polar=polar,
                    scale=scale[i],
                    within=within,
                    slide=slide,
                    now=at,
                    change=1.0 + (ends[i] - 1.0) * grown[n],
                    dt_s=dt_s,
                )
                margin_m = min(margin_m, at.margin_m)
                if at.margin_m < 0.0 or at.aside_mps < 0.0:
                    failed_s = (n + 1) * dt_s
                    break
            flown[i, j, 0] = failed_s
            flown[i, j, 1] = at.climb_mps
            flown[i, j, 2] = at.x_m
            flown[i, j, 3] = at.z_m
            flown[i, j, 4] = margin_m
            flown[i, j, 5] = at.aside_mps

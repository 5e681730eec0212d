"""What rollouts compile, flown as plain Python: line by line what `roll_out` flies at once."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from tgl_soar.analysis.search import compiled_rollouts as e
from tgl_soar.analysis.search.places import place
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.plan import candidates
from tgl_soar.control.search.rollout import Fields, Grid, Guards, Lines, Moving, roll_out
from tgl_soar.control.target_line import LineLimits, LineState, TargetLine, eta_from_lean
from tgl_soar.estimation.lift_map.basis import FlowBasis

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()


@pytest.mark.parametrize(("horizon_s", "steps"), [(6.0, 24), (3.0, 20)])
def test_what_is_compiled_flies_as_the_arrays_do(
    horizon_s: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In rough random fields, with a line that slides and an aircraft that climbs."""
    monkeypatch.setattr(e, "compiled", lambda function: function)
    there = place("hill", 10_003)
    rng = np.random.default_rng(4)
    grid = Grid(FlowBasis(there.ground, there.box), there.ground)
    nodes, height = grid.x_m.size * grid.z_m.size, there.box.height_m
    fields = Fields(
        9.0 + 0.6 * rng.normal(size=(3, nodes)),
        np.linspace(-0.5, 3.0, 3)[:, None] + 0.3 * rng.normal(size=(3, nodes)),
        rng.uniform(0.9, 1.1, 3),
    )
    guards = Guards(
        box=there.box,
        ground=there.ground,
        clearance_m=0.02 * height,
        landing_m=0.03 * height,
        speed_min_mps=7.3,
        speed_max_mps=13.0,
        line=LineLimits(0.5, 0.5, radians(5.0)),
    )
    x_m, z_m = there.box.x_min_m + 0.4 * height, there.box.z_min_m + 0.5 * height
    eta_rad = eta_from_lean(radians(20.0))
    line = LineState(x_m=x_m, z_m=z_m, eta_rad=eta_rad, speed_mps=-0.2, moving=True)
    now = Moving(x_m=x_m, z_m=z_m, climb_mps=0.1, line=line)
    every = candidates(now, TargetLine(x_m + 0.3, z_m, eta_rad), height, 0.5)
    lines = Lines._make(np.asarray(column)[::5] for column in every)
    given = grid, fields, POLAR, guards, now, lines, horizon_s, steps
    arrays, plain = roll_out(*given), e.roll_out_compiled(*given)
    assert plain._fields == arrays._fields
    for name in arrays._fields:
        np.testing.assert_array_equal(getattr(plain, name), getattr(arrays, name), err_msg=name)
    assert plain.x_m.shape == (3, len(lines.x_m))


@pytest.mark.parametrize("there", [True, False])
def test_rollouts_are_compiled_where_that_is_possible(
    there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(e, "available", lambda: there)
    assert e.fastest_roll_out() is (e.roll_out_compiled if there else roll_out)

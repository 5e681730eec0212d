"""Lines flown ahead one by one, in plain Python, are those that are flown as arrays; and what
drifts in a row of white noise is a Gauss-Markov process."""

from __future__ import annotations

from math import exp, radians, sqrt

import numpy as np
import pytest

from tgl_soar.analysis.search import compiled_rollouts
from tgl_soar.analysis.search.places import place
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.plan import candidates, horizon_of
from tgl_soar.control.search.rollout import Fields, Grid, Guards, Moving, roll_out
from tgl_soar.control.target_line import LineLimits, LineState, TargetLine, eta_from_lean
from tgl_soar.estimation.lift_map.basis import FlowBasis
from tgl_soar.sim.lines_ahead import fly_lines
from tgl_soar.sim.white_noise import RowsAsNeeded, with_drift

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
STEPS = 12


def test_line_by_line_is_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three rough fields, in which some lines fail, some not, and not all at the same step."""
    monkeypatch.setattr(compiled_rollouts, "compiled", lambda function: function)
    assert compiled_rollouts.fly_lines is fly_lines  # type: ignore[attr-defined]
    there = place("hill", 10_003)
    rng = np.random.default_rng(4)
    grid = Grid(FlowBasis(there.ground, there.box), there.ground)
    nodes, height = grid.x_m.size * grid.z_m.size, there.box.height_m
    fields = Fields(
        9.0 + 0.6 * rng.normal(size=(3, nodes)),
        np.array([[-0.5], [1.0], [3.0]]) + 0.3 * rng.normal(size=(3, nodes)),
        np.array([0.9, 1.0, 1.1]),
        np.array([1.1, 0.85, 1.0]),
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
    line = LineState(
        x_m=x_m, z_m=z_m, eta_rad=eta_from_lean(radians(20.0)), speed_mps=-0.2, moving=True
    )
    now = Moving(x_m=x_m, z_m=z_m, climb_mps=0.1, line=line)
    target = TargetLine(x_m + 0.3, z_m, line.eta_rad)
    lines = candidates(now, target, height, guards.line.acceleration_mps2)
    given = grid, fields, POLAR, guards, now, lines, horizon_of(height), STEPS
    plain, one_by_one = roll_out(*given), compiled_rollouts.roll_out_compiled(*given)
    for name in plain._fields:
        np.testing.assert_allclose(
            getattr(one_by_one, name), getattr(plain, name), rtol=1e-12, err_msg=name
        )
    failed_s = plain.failed_s[np.isfinite(plain.failed_s)]
    assert 0 < failed_s.size < plain.failed_s.size
    assert np.unique(failed_s).size > 1


# --- drift ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("drawn_before", [True, False])
def test_what_drifts_decays_and_is_fed_so_that_its_size_stays(drawn_before: bool) -> None:
    """d[0] = start, d[k] = e^-f d[k-1] + √(1 - e^-2f) step: added to the first numbers, by size."""
    rng = np.random.default_rng(1)
    rows, steps = rng.normal(size=(40, 5)), rng.normal(size=(40, 3))
    start, sizes, fraction = (0.5, -1.0, 2.0), (2.0, 3.0, 0.5), 0.3

    def as_needed(name: str, table: np.ndarray) -> RowsAsNeeded:
        numbers = iter(table.ravel().tolist())
        return RowsAsNeeded(name, lambda: next(numbers), table.shape[1])

    if drawn_before:
        found = with_drift(rows, steps, start, sizes, fraction)
    else:
        found = with_drift(
            as_needed("rows", rows), as_needed("steps", steps), start, sizes, fraction
        )
    drift = np.array(start)
    for k in range(40):
        if k > 0:
            drift = exp(-fraction) * drift + sqrt(1.0 - exp(-2.0 * fraction)) * steps[k]
        expected = rows[k].copy()
        expected[:3] += np.array(sizes) * drift
        assert list(found[k]) == pytest.approx(list(expected))


def test_a_drifts_deviation_is_one_for_ever() -> None:
    rng = np.random.default_rng(2)
    none = np.zeros((200, 1))
    ends = [
        with_drift(none, rng.normal(size=(200, 1)), (float(rng.normal()),), (1.0,), 0.05)[199][0]
        for _ in range(300)
    ]
    assert np.std(ends) == pytest.approx(1.0, abs=0.13)

"""What an experiment compiles, against what flies: the same numbers."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from tgl_soar.analysis.search.compiled_rollouts import fastest_roll_out, roll_out_compiled
from tgl_soar.analysis.search.episode import Episode, fly_episode
from tgl_soar.analysis.search.places import place
from tgl_soar.analysis.search.searchers import searcher
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.plan import STEPS, candidates, horizon_of
from tgl_soar.control.search.rollout import Fields, Grid, Guards, Moving, roll_out
from tgl_soar.control.target_line import LineLimits, LineState, TargetLine, eta_from_lean
from tgl_soar.estimation.lift_map.basis import FlowBasis

pytest.importorskip("numba")

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
POLAR = AIRFRAME.polar.as_polar()


@pytest.mark.parametrize("kind", ["tunnel", "hill"])
def test_compiled_rollouts_are_the_plain_ones_to_the_last_bit(kind: str) -> None:
    """In rough random fields, in which some soar and some leave each of the guards."""
    there = place(kind, 10_003)  # type: ignore[arg-type]
    rng = np.random.default_rng(4)
    grid = Grid(FlowBasis(there.ground, there.box), there.ground)
    nodes, height = grid.x_m.size * grid.z_m.size, there.box.height_m
    fields = Fields(
        9.0 + 0.6 * rng.normal(size=(11, nodes)),
        np.linspace(-0.5, 3.0, 11)[:, None] + 0.3 * rng.normal(size=(11, nodes)),
        rng.uniform(0.9, 1.1, 11),
        rng.uniform(0.8, 1.2, 11),
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
    target = TargetLine(x_m + 0.3, z_m, line.eta_rad)
    lines = candidates(now, target, height, guards.line.acceleration_mps2)
    given = grid, fields, POLAR, guards, now, lines, horizon_of(height), STEPS
    plain, fast = roll_out(*given), roll_out_compiled(*given)
    for name in plain._fields:
        np.testing.assert_array_equal(getattr(fast, name), getattr(plain, name), err_msg=name)
    lost = np.isfinite(plain.failed_s)
    assert 0.05 < lost.mean() < 0.95
    assert fastest_roll_out() is roll_out_compiled


def test_an_episode_compiled_is_the_plain_one() -> None:
    """A search of two seconds, in which the line moves: the same plans on the same flight."""
    there = place("tunnel", 10_009)._replace(duration_s=2.4)

    def flown(plain: bool) -> Episode:
        def made(first):  # type: ignore[no-untyped-def]
            made_now = searcher("map and rollouts", there, POLAR, first)
            if plain:
                made_now.roll = roll_out  # type: ignore[attr-defined]
            return made_now

        return fly_episode(there, AIRFRAME, "somebody", made, plain=plain)

    slow, fast = flown(True), flown(False)
    assert (slow.ended, slow.given_up, slow.flown_s) == (fast.ended, fast.given_up, fast.flown_s)
    assert slow.path["target_changes"][-1] >= 1.0
    for name in ("x_m", "z_m", "e_rho_m", "air_updraft_mps", "mode", "target_changes"):
        np.testing.assert_allclose(fast.path[name], slow.path[name], rtol=0.0, atol=1e-6)
    assert fast.height_left_m == pytest.approx(slow.height_left_m, abs=1e-6)
    assert fast.claims == slow.claims

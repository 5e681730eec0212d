"""The same functions, compiled: numba takes the hot path as it stands and agrees with it."""

from __future__ import annotations

from types import FunctionType

import numpy as np
import pytest

from tgl_soar.air.grid import (
    GridField,
    GridTable3D,
    bake,
    grid_wind,
    grid_wind_3d,
    numpy_table,
    numpy_table_3d,
)
from tgl_soar.air.gusts import DRYDEN_STILL, Gust, dryden_params, dryden_step, gust_fraction
from tgl_soar.air.hill import Hill, _taken_back, hill_wind
from tgl_soar.air.jet import Jet, jet_wind

numba = pytest.importorskip("numba")


# numba compiles a function whose callee is compiled: bind the callee in its module.
HILL_WIND = FunctionType(
    hill_wind.__code__, {**hill_wind.__globals__, "_taken_back": numba.njit(_taken_back)}
)


def test_hill_and_grids_and_turbulence_compile_and_agree() -> None:
    hill = Hill(9.0, 20.0)
    x, z = np.arange(-60.0, -24.0), np.arange(5.0, 50.0)
    field_u = np.array([[hill_wind(hill, a, b)[0] for b in z] for a in x])
    field_w = np.array([[hill_wind(hill, a, b)[1] for b in z] for a in x])
    table = bake(-60.0, 5.0, 1.0, field_u, field_w)
    y = np.array([-1.0, 0.0, 1.0])
    in_y = np.ones((1, 3, 1))
    block = GridField(
        x, y, z, field_u[:, None] * in_y, 0.1 * field_u[:, None] * in_y, field_w[:, None] * in_y,
        reference_wind_mps=9.0,
    ).table  # fmt: skip
    assert isinstance(block, GridTable3D)
    fast_hill, fast_grid = numba.njit(HILL_WIND), numba.njit(grid_wind)
    fast_block = numba.njit(grid_wind_3d)
    for place in [(-40.0, 20.3), (-33.3, 7.7), (-99.0, 99.0), (float("nan"), 3.0)]:
        for growth in (0.0, 0.14):
            over = hill._replace(growth=growth)
            assert fast_hill(over, *place) == pytest.approx(hill_wind(over, *place), nan_ok=True)
        assert fast_grid(numpy_table(table), *place) == pytest.approx(grid_wind(table, *place))
        assert fast_block(numpy_table_3d(block), place[0], 0.4, place[1]) == pytest.approx(
            grid_wind_3d(block, place[0], 0.4, place[1])
        )
    params = dryden_params(0.03, 9.0, 1.5, 0.004)
    fast_step = numba.njit(dryden_step)
    slow_state = fast_state = DRYDEN_STILL
    for white in np.random.default_rng(1).standard_normal((200, 3)).tolist():
        slow_state, slow_gust = dryden_step(params, slow_state, *white)
        fast_state, fast_gust = fast_step(params, fast_state, *white)
        assert fast_gust == pytest.approx(slow_gust, rel=1e-12)
    gust = Gust(start_s=1.0, duration_s=2.0, u_mps=1.0, v_mps=0.0, w_mps=0.5)
    assert numba.njit(gust_fraction)(gust, 1.7) == pytest.approx(gust_fraction(gust, 1.7))


def test_the_jets_query_compiles_with_what_it_calls() -> None:
    """numba compiles a function whose callee is compiled: bind the callee in its module."""
    table = bake(-1.0, 0.0, 1.0, np.full((5, 4), 9.0), np.arange(20.0).reshape(5, 4))
    jet = Jet(table, 2.2, 0.4)
    compiled = FunctionType(
        jet_wind.__code__, {**jet_wind.__globals__, "grid_wind": numba.njit(grid_wind)}
    )
    fast, numeric = numba.njit(compiled), jet._replace(table=numpy_table(table))
    for place in [(0.5, 1.3), (2.0, 0.5), (2.5, 0.5), (-0.5, -0.1), (99.0, 9.0)]:
        assert fast(numeric, *place) == pytest.approx(jet_wind(jet, *place))

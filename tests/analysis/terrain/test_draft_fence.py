"""A draft's fence and its written wind, from air and ground that are made up: steps, bounds, and
what of the air counts as lift."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_draft import POLAR
from test_draft import REQUEST as USUAL

from tgl_soar.analysis.terrain.draft import DraftError, _fence, _written_field

REQUEST = USUAL._replace(ceiling_m=40.0)
X: Any = np.linspace(-200.0, 200.0, 81)


class Air:
    """An updraft over a ground that lies 60 m below the crest, and 80 m far upwind."""

    reference_wind_mps = 7.5
    x_m = X

    def __init__(self, updraft: Any) -> None:
        self._updraft = updraft

    def ground_m(self, x_m: Any) -> Any:
        return np.where(np.asarray(x_m) < -150.0, -80.0, -60.0)

    def wind(self, x_m: Any, y_m: Any, z_m: Any, time_s: float = 0.0) -> Any:
        assert y_m == time_s == 0.0
        x, z = np.broadcast_arrays(np.asarray(x_m, dtype=float), np.asarray(z_m, dtype=float))
        return np.full(x.shape, 9.0), np.zeros(x.shape), self._updraft(x, z)


def fence(updraft: Any, **changes: Any) -> Any:
    air: Any = Air(updraft)
    return _fence(air, 0.0, POLAR, REQUEST._replace(**changes), X, air.ground_m(X))


def within(x_min: float = -1e3, z_max: float = 1e3, mps: float = 2.0) -> Any:
    return lambda x, z: np.where((x >= x_min) & (z <= z_max), mps, 0.0)


def test_a_fence_holds_the_lift_and_a_step_of_the_search_more_in_whole_metres() -> None:
    """Looked for each 2.5 m along and 2 m up: found from -100 on and up to 30."""
    x_min, x_max, z_min, z_max = fence(within(-101.0, 31.0))
    assert (x_min, x_max) == (-103.0, 0.0)
    assert z_max == 32.0
    assert z_min == -57.5  # half of the clearance above the ground within it


def test_a_fence_ends_with_the_profile_and_the_ceiling() -> None:
    assert fence(within()) == (-200.0, 0.0, -77.5, 40.0)
    assert fence(within(-199.0)) == (-200.0, 0.0, -77.5, 40.0)


@pytest.mark.parametrize(("x_min_m", "lowest_m"), [(-148.0, -60.0), (-157.0, -80.0)])
def test_the_lowest_ground_is_that_within_the_fence(x_min_m: float, lowest_m: float) -> None:
    assert fence(within(x_min_m))[2] == lowest_m + 2.5
    assert fence(within(x_min_m), clearance_m=4.1)[2] == pytest.approx(lowest_m + 2.0, abs=0.051)


@pytest.mark.parametrize(("mps", "lifts"), [(1.29, False), (1.31, True)])
def test_lift_is_as_much_as_the_least_sink(mps: float, lifts: bool) -> None:
    if lifts:
        assert fence(within(mps=mps)) == (-200.0, 0.0, -77.5, 40.0)
    else:
        words = "wind of 9 m/s: no updraft of 1.30 m/s, the least sink, 5 m or more over this"
        with pytest.raises(DraftError, match=words) as error:
            fence(within(mps=mps))
        assert "and below 40 m over the crest: a stronger wind" in str(error.value)


@pytest.mark.parametrize(("thick_m", "lifts"), [(5.9, False), (6.1, True)])
def test_lift_nearer_to_the_ground_than_the_clearance_is_none(thick_m: float, lifts: bool) -> None:
    """Looked for 0, 2, 4 and 6 m over the ground: six are five or more."""

    def creeping(x: Any, z: Any) -> Any:
        return np.where(z - Air.ground_m(Air(None), x) <= thick_m, 2.0, 0.0)

    if lifts:
        assert fence(creeping)[3] == -52.0  # eight over the higher ground
    else:
        with pytest.raises(DraftError, match="no updraft"):
            fence(creeping)


# --- the wind as it is written --------------------------------------------------------------------

BOUNDS = (-100.0, 0.0, -30.0, 20.0)  # 15 hundredths of the width are 15 m around it
CURVED = 0.01  # m/s for each m²


def written(bounds: Any = BOUNDS, spacing_m: float = 5.0, updraft: Any = None) -> Any:
    air: Any = Air(updraft or (lambda x, z: CURVED * x * x + 0.0 * z))
    return _written_field(air, bounds, spacing_m)


def test_the_written_wind_reaches_a_fraction_of_the_fences_longer_side_beyond_it() -> None:
    found = written()
    assert found.reference_wind_mps == 7.5
    for x, z in ((-114.99, 0.0), (13.0, 0.0), (-50.0, -44.99), (-50.0, 33.0)):
        assert found.inside(x, 0.0, z)
    for x, z in ((-115.01, 0.0), (15.01, 0.0), (-50.0, -45.01), (-50.0, 35.01)):
        assert not found.inside(x, 0.0, z)
    tall = written((-30.0, 0.0, -50.0, 50.0))
    assert tall.inside(-44.9, 0.0, 0.0)
    assert not tall.inside(-45.1, 0.0, 0.0)


def test_it_ends_with_the_profile() -> None:
    found = written((-195.0, -95.0, -30.0, 20.0))
    assert found.inside(-199.9, 0.0, 0.0)
    assert not found.inside(-200.1, 0.0, 0.0)
    ahead = written((95.0, 195.0, -30.0, 20.0))
    assert ahead.inside(198.0, 0.0, 0.0)
    assert not ahead.inside(200.1, 0.0, 0.0)


@pytest.mark.parametrize(
    ("spacing_m", "step_m"), [(5.0, 130.0 / 140.0), (9.0, 130.0 / 140.0), (20.0, 2.0), (30.0, 3.0)]
)
def test_its_nodes_are_as_close_as_140_along_it_or_a_tenth_of_the_profiles(
    spacing_m: float, step_m: float
) -> None:
    """Between two nodes a parabola is cut off by the square of half the step."""
    found = written(spacing_m=spacing_m)
    for n in (0, 7):
        x = -115.0 + (n + 0.5) * step_m
        _, _, w = found.wind_at(x, 0.0, 0.0, 0.0)
        assert w - CURVED * x * x == pytest.approx(CURVED * (0.5 * step_m) ** 2, rel=1e-6)
    high = written(spacing_m=spacing_m, updraft=lambda x, z: CURVED * z * z + 0.0 * x)
    z = -45.0 + 3.5 * step_m
    _, _, w = high.wind_at(-50.0, 0.0, z, 0.0)
    assert w - CURVED * z * z == pytest.approx(CURVED * (0.5 * step_m) ** 2, rel=1e-6)


def test_what_lies_below_the_ground_is_no_air() -> None:
    found = written((-100.0, 0.0, -75.0, 20.0), spacing_m=10.0)
    assert found.inside(-50.0, 0.0, -58.0)
    assert not found.inside(-50.0, 0.0, -62.0)
    u, _, w = found.wind_at(-50.0, 0.0, -40.0, 0.0)
    assert (u, w) == pytest.approx((9.0, 25.0), abs=0.01)

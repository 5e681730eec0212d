"""The measurement of searches: their sites, and who flies them with which budget."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import pytest
from measure_search import (
    POWERED_START,
    POWERED_WIND_MPS,
    STARTS,
    Search,
    options,
    searches,
    site_text,
)

from tgl_soar.config.files import load_site, shipped
from tgl_soar.config.site import HillAir

HILL = shipped("sites/hill.toml").read_text(encoding="utf-8")
GIVEN = Namespace(autopilot="builtin", firmware=None, route=None)


@pytest.mark.parametrize("budget_s", [None, 0.0, 25.0])
def test_each_search_begins_at_its_place_in_its_wind(
    tmp_path: Path, budget_s: float | None
) -> None:
    path = tmp_path / "start.toml"
    path.write_text(site_text(HILL, Search((-5.5, 12.25), 1, budget_s)))
    site, shipped_one = load_site(path), load_site(shipped("sites/hill.toml"))
    assert isinstance(site.air, HillAir)
    assert isinstance(shipped_one.air, HillAir)
    assert site.start is not None
    assert (site.start.x_m, site.start.z_m) == (-5.5, 12.25)
    wind_mps = shipped_one.air.wind_mps if budget_s is None else POWERED_WIND_MPS
    assert site.air.wind_mps == wind_mps
    assert (site.contour is None) == (budget_s is not None)


def test_every_start_is_flown_with_every_seed_or_every_budget_with_every_seed() -> None:
    assert searches([], [1, 2]) == [Search(start, seed) for start in STARTS for seed in (1, 2)]
    assert searches([0.0, 25.0], [4]) == [
        Search(POWERED_START, 4, 0.0),
        Search(POWERED_START, 4, 25.0),
    ]


@pytest.mark.parametrize(("budget_s", "settings"), [(None, ()), (25.0, (("THR_BUDGET", 25.0),))])
def test_a_budget_is_flown_by_who_has_a_propeller(
    tmp_path: Path, budget_s: float | None, settings: tuple[tuple[str, float], ...]
) -> None:
    asked = options(GIVEN, Search(POWERED_START, 3, budget_s), tmp_path / "new")
    assert asked.settings == settings
    assert asked.seed == 3
    assert asked.airframe.stem.endswith("_propeller") == (budget_s is not None)
    assert asked.site.is_file()

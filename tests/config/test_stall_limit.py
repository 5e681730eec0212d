"""ALPHA_MAX, from the stall of the airframe file."""

from __future__ import annotations

from math import degrees, exp

import pytest
from msgspec.structs import replace

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.stall_limit import stall_limit
from tgl_soar.estimation.aerodynamics import lift_drag

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)


def test_the_limit_is_where_lift_has_a_quarter_of_its_slope_left() -> None:
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
    assert values["ALPHA_MAX"] == pytest.approx(12.6)
    aero = AIRFRAME.aerodynamics()
    _, slope, _, _ = lift_drag(aero, aero.stall_alpha_rad + aero.stall_width_rad, 0.0)
    assert slope / aero.CL_alpha == pytest.approx(1.0 / (1.0 + exp(1.0)))
    assert degrees(aero.stall_alpha_rad + aero.stall_width_rad) == pytest.approx(12.6, abs=0.05)


def test_an_airframe_that_stalls_sooner_is_limited_sooner() -> None:
    sooner = {**AIRFRAME.model, "stall_alpha_rad": 0.15, "stall_width_rad": 0.01}
    values = load_parameters(replace(AIRFRAME, model=sooner), AIRFRAME_PATH, SITE, SITE_PATH)
    assert values["ALPHA_MAX"] == pytest.approx(9.2)


def test_the_parameter_comes_before_the_stall_and_a_default_where_there_is_none() -> None:
    chosen = replace(AIRFRAME, parameters={**AIRFRAME.parameters, "ALPHA_MAX": 14.0})
    assert load_parameters(chosen, AIRFRAME_PATH, SITE, SITE_PATH)["ALPHA_MAX"] == 14.0
    assert stall_limit({}) == {}
    assert "ALPHA_MAX" not in replace(AIRFRAME, model={}).all_parameters()


def test_the_limit_stays_within_the_range_of_the_parameter() -> None:
    assert stall_limit({"stall_alpha_rad": 0.01, "stall_width_rad": 0.01}) == {"ALPHA_MAX": 3.0}
    assert stall_limit({"stall_alpha_rad": 1.0, "stall_width_rad": 0.1}) == {"ALPHA_MAX": 45.0}

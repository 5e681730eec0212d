"""Where a line would settle, when, and why it would be refused."""

from __future__ import annotations

from functools import cache
from math import hypot, nan, radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from page_flight import AIRFRAME, SITE, SOARING, Flown

from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.cli.page.scene import Place, place_of
from tgl_soar.cli.page.settling_preview import Foresight, GhostLine, GhostStart
from tgl_soar.config.files import (
    airframe_file,
    load_airframe,
    load_parameters,
    load_site,
    preset_lines,
    site_file,
)
from tgl_soar.config.line_changes import LineChanges
from tgl_soar.config.parameters import ParameterError
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.onboard.setup import bounds_from
from tgl_soar.sim.world import build_field, site_field

A, C = GhostLine(0.20, 1.15, 15.0), GhostLine(1.05, 2.00, 15.0)


@cache
def tunnel() -> Place:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    return place_of(airframe, site, load_parameters(airframe, AIRFRAME, site, SITE), SITE.parent)


def test_it_settles_where_the_line_crosses_the_contour_of_the_air() -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    assert site.air is not None
    field, polar = build_field(site.air, SITE.parent), airframe.polar.as_polar()
    crossing = stable_crossing(field, polar, (C.x_m, C.z_m, eta_from_lean(radians(C.lean_deg))))
    ghost = tunnel().foresight.ghost(tunnel().values, C, GhostStart(0.2, 1.2, A), flying=True)
    assert ghost.refusal == ghost.words == ""
    assert crossing is not None
    assert ghost.place == pytest.approx((crossing.x_m, crossing.z_m), abs=0.02)
    # 1.04 m across the line at TGL_SLEW's 0.3 m/s take 3.5 s; what is left of the slide is short.
    assert ghost.settles_s is not None
    assert 3.0 < ghost.settles_s < 8.0


def test_before_an_oblique_ridge_it_settles_by_the_whole_wind(tmp_path: Path) -> None:
    """From 40° beside, the component across the ridge alone is less than the slowest glide."""
    text = site_file("hill").read_text(encoding="utf-8")
    for old, new in (
        ("wind_from_deg = 270.0\n", "wind_from_deg = 310.0\nridge_deg = 0.0\n"),
        ("wind_mps = 7.0", "wind_mps = 7.4"),
        ("[parameters]\n", "[parameters]\nVEER_MAX = 60.0\n"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "site.toml"
    path.write_text(text, encoding="utf-8")
    airframe, site = load_airframe(AIRFRAME), load_site(path)
    place = place_of(airframe, site, load_parameters(airframe, AIRFRAME, site, path), tmp_path)
    line = GhostLine(site.lines["b"].x_m, site.lines["b"].z_m, 15.0)
    eta_rad, polar = eta_from_lean(radians(15.0)), airframe.polar.as_polar()
    crossing = stable_crossing(site_field(site, tmp_path), polar, (line.x_m, line.z_m, eta_rad))
    assert crossing is not None
    u, _, _ = site_field(site, tmp_path).wind_at(crossing.x_m, 0.0, crossing.z_m, 0.0)
    assert u < polar.speed_min_mps < crossing.wind_mps
    start = GhostStart(crossing.x_m + 0.1, crossing.z_m - 0.4, line)
    ghost = place.foresight.ghost(place.values, line, start, flying=True)
    assert ghost.words == ""
    assert ghost.place == pytest.approx((crossing.x_m, crossing.z_m), abs=0.15)


def test_the_simulated_aircraft_settles_at_the_ghost() -> None:
    """Through the whole module, from b to c: the same place to the noise of its fixes."""
    flown = Flown()
    flown.run(5.0)
    settings = flown.onboard.settings
    settings.assign("TGL_X", 0.6)
    settings.assign("TGL_Z", 1.6)
    settings.assign("OP_ENGAGE", 1.0)
    flown.run(10.0)
    assert flown.mode == SOARING
    start = GhostStart(*flown.place, GhostLine(0.6, 1.6, 15.0))
    ghost = tunnel().foresight.ghost(settings.values, C, start, flying=True)
    settings.assign("TGL_X", C.x_m)
    settings.assign("TGL_Z", C.z_m)
    assert ghost.place is not None
    assert ghost.settles_s is not None
    flown.run(ghost.settles_s + 3.0)  # the loops lag the line by about a second
    x, z = flown.place
    # 10 cm is what the ghost calls settled; the estimate of place has 5 cm on a calm line.
    assert hypot(x - ghost.place[0], z - ghost.place[1]) < 0.15


@given(st.floats(-2.0, 4.0), st.floats(-0.5, 4.0), st.floats(-70.0, 70.0), st.booleans())
def test_it_is_refused_exactly_where_the_module_refuses_it(
    x_m: float, z_m: float, lean_deg: float, flying: bool
) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = tunnel().values
    bounds = LineBounds(site.contour_for(airframe.airframe.name), site.known_ground())
    module = LineChanges(preset_lines(site, values), bounds.fault)
    refused = False
    try:
        values = module.set(values, "TGL_STAGE", 1.0, flying=flying).values
        for name, value in (("TGL_X", x_m), ("TGL_Z", z_m), ("TGL_LEAN", lean_deg)):
            values = module.set(values, name, value, flying=flying).values
        answer = module.set(values, "TGL_STAGE", 0.0, flying=flying)
        refused = bool(answer.refusal)
    except ParameterError:
        refused = True
    refusal, _ = tunnel().foresight.verdict(
        tunnel().values, GhostLine(x_m, z_m, lean_deg), flying=flying
    )
    assert bool(refusal) == refused


def test_a_refusal_names_the_bound_and_the_way_out() -> None:
    refusal, _ = tunnel().foresight.verdict(tunnel().values, GhostLine(1.0, 9.0, 15.0), flying=True)
    assert refusal == (
        "the line's point is outside the fence (FENCE_Z_MAX is 2.85 m); OP_FORCE 1 overrides once"
    )


def test_a_line_off_the_air_has_no_place() -> None:
    upstream = GhostLine(-3.0, 1.0, 15.0)  # of the nozzle
    start = GhostStart(0.0, 1.0, A)
    ghost = tunnel().foresight.ghost(tunnel().values, upstream, start, flying=True)
    assert ghost.place is None
    assert ghost.words == "the aircraft would leave the air that is known"


def test_without_a_model_the_place_is_the_known_contours() -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values, contour = tunnel().values, site.contour_for(airframe.airframe.name)
    blind = Foresight(preset_lines(site, values), contour, bounds_from(airframe, site), None)
    ghost = blind.ghost(values, C, GhostStart(0.2, 1.2, A), flying=True)
    modelled = tunnel().foresight.ghost(values, C, GhostStart(0.2, 1.2, A), flying=True)
    assert ghost.settles_s is None
    assert ghost.place is not None
    assert modelled.place is not None
    # The file's contour is drawn in steps of up to 0.5 m along it.
    assert ghost.place == pytest.approx(modelled.place, abs=0.03)


def test_an_aircraft_whose_place_is_not_known_has_no_time() -> None:
    ghost = tunnel().foresight.ghost(tunnel().values, C, GhostStart(nan, nan, None), flying=False)
    assert ghost.settles_s is None
    assert ghost.place is not None
    assert ghost.path == ()


def test_a_landing_place_is_in_view() -> None:
    airframe_path, site_path = airframe_file("eclipson_c"), site_file("hill")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    view = place_of(airframe, site, values, site_path.parent).scene["view"]
    assert view[0] < values["LND_X"] < values["FENCE_X_MIN"]
    without = place_of(airframe, site, values.changed({"LND_LEN": 0.0}), site_path.parent)
    assert without.scene["view"][0] > values["LND_X"]

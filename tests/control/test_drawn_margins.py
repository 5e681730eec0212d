"""The rule on board, of aircraft that nothing was chosen by."""

from __future__ import annotations

from tgl_soar.analysis.tuning.aircraft import Ranges, drawn_aircraft
from tgl_soar.analysis.tuning.flights import values_of
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.found_gains import INERTIAL
from tgl_soar.control.loop_margin import margin_fault

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")


def test_of_drawn_aircraft_hardly_one_is_refused() -> None:
    """40 that nothing was chosen by: without gains that yield, about 6 at 5 degrees and 2 at 45."""
    airframe = load_airframe(AIRFRAME_PATH)
    shipped_values = load_parameters(airframe, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)
    refused = 0
    for i in range(40):
        drawn = drawn_aircraft(airframe, Ranges(), (1104, i))
        values = values_of(shipped_values, drawn, INERTIAL, seeks=True)
        for lean in (5.0, 10.0, 15.0, 25.0, 35.0, 45.0):
            refused += margin_fault(values.changed({"TGL_LEAN": lean})) != ""
    assert refused <= 1  # of 240; about 1 in 200 aircraft at 5 and at 45 degrees

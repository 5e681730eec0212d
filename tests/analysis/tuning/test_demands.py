"""What is asked of gains, on the linear model."""

from __future__ import annotations

import pytest

from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import close_loop, disk_margin
from tgl_soar.analysis.linear_plant import linear_plant
from tgl_soar.analysis.tuning.demands import (
    Demands,
    drawn_place,
    given_by,
    place_margin,
    places_of,
)
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control.found_gains import (
    INERTIAL,
    PLAIN,
    SETS,
    anchored,
    with_gains,
)
from tgl_soar.control.laws import laws_from

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
START = anchored(VALUES, 15.0)
FEW = Demands(airframe=AIRFRAME, values=START, aircraft=1, grid=1)


@pytest.mark.parametrize("kind", SETS)
def test_the_margin_is_that_of_the_linear_model(kind: str) -> None:
    """Over a coarser row of frequencies: within 0.02, a twentieth of the floor."""
    place = places_of(FEW, kind).margin[0]
    condition = place.plant.condition
    laws = laws_from(START.changed(place.known), SITE.frame())
    loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
    assert place_margin(place, START) == pytest.approx(disk_margin(loop), abs=0.02)


def test_the_least_of_all_places_is_given_and_named() -> None:
    places = places_of(FEW, PLAIN)
    given = given_by(places, START)
    alphas = {place.name: place_margin(place, START) for place in places.margin}
    assert given.alpha == min(alphas.values()) == alphas[given.worst]
    assert 0.003 < given.e_rho_m < 0.05
    assert 0.01 < given.elevator < 0.3


@pytest.mark.parametrize("own_s", [0.0, 0.125])
def test_the_airframe_s_own_delay_is_demanded_though_it_is_out_of_the_range(own_s: float) -> None:
    low, high = FEW.ranges.latency_s
    assert not low <= own_s <= high
    few = FEW._replace(values=START.changed({"CMD_DELAY": own_s}), aircraft=0, grid=2)
    delays = {place.known["CMD_DELAY"] for place in places_of(few, PLAIN).margin}
    assert delays == {min(low, own_s), max(high, own_s)}


def test_gains_that_ring_have_neither_margin_nor_e_rho() -> None:
    wild = with_gains(START, PLAIN, [1.0, 2.0, 8.5, 20.0, 3.0])
    given = given_by(places_of(FEW, PLAIN), wild)
    assert given.alpha == 0.0
    assert given.e_rho_m == float("inf")


def test_the_schedule_knows_a_drawn_aircraft_by_its_own_file() -> None:
    place = drawn_place(FEW, INERTIAL, (1, 0, 5))
    assert place.known["DYN_FREQ"] != VALUES["DYN_FREQ"]
    assert place.known["CMD_DELAY"] == place.plant.condition.command_delay_s
    unaware = {name: place.known[name] for name in ("CMD_DELAY", "TGL_LEAN")}
    assert place_margin(place._replace(known=unaware), START) != place_margin(place, START)

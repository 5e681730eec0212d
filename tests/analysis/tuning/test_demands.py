"""What is asked of gains, on the linear model."""

from __future__ import annotations

from math import radians

import pytest

from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import close_loop, disk_margin
from tgl_soar.analysis.linear_plant import linear_plant
from tgl_soar.analysis.tuning.demands import (
    INERTIAL,
    PLAIN,
    SETS,
    Demands,
    anchored,
    drawn_place,
    gains_of,
    given_by,
    place_margin,
    places_of,
    with_gains,
)
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.control.pitch_schedule import pitch_gains, soaring_gains
from tgl_soar.control.target_line import eta_from_lean

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
START = anchored(VALUES, 15.0)
FEW = Demands(airframe=AIRFRAME, values=START, aircraft=1, grid=1)


def flown_at(values: ParameterSet, speed_mps: float, lean_deg: float) -> list[float]:
    """All gains that fly there."""
    laws = laws_from(values, SITE.frame())
    eta = eta_from_lean(radians(lean_deg))
    found = []
    for weight, soaring, pitch in (
        (0.0, laws.soaring, laws.pitch),
        (1.0, laws.soaring_imu, laws.pitch_imu),
    ):
        outer = soaring_gains(soaring, laws.schedule, weight, speed_mps, eta).pid
        inner = pitch_gains(pitch, laws.schedule, speed_mps)
        found += [outer.kp, outer.ki, outer.kd, outer.rate_filter_radps]
        found += [inner.kp, inner.ki, inner.kd]
    return found


@pytest.mark.parametrize("lean", [10.0, 15.0, 30.0])
def test_anchored_gains_fly_as_they_did_where_they_are_anchored(lean: float) -> None:
    start = anchored(VALUES, lean)
    assert start["RHO_SPEED"] == VALUES["DYN_SPEED"] != VALUES["RHO_SPEED"]
    assert flown_at(start, VALUES["DYN_SPEED"], lean) == pytest.approx(
        flown_at(VALUES, VALUES["DYN_SPEED"], lean), rel=1e-4
    )


def test_an_airframe_that_is_not_known_is_refused_with_what_lacks() -> None:
    with pytest.raises(ValueError, match=r"DYN_FREQ = 0: .*\[dynamics\]"):
        anchored(VALUES.changed({"DYN_FREQ": 0.0}), 15.0)


@pytest.mark.parametrize(
    "changes", [{"RHO_D": 0.0}, {"ELE_D": 0.0}, {"RHO_D": 0.0, "RHO_D_IMU": 0.0}]
)
def test_a_gain_of_nothing_is_named(changes: dict[str, float]) -> None:
    """Of IMU gains 0 means those without, and is none of nothing."""
    with pytest.raises(ValueError, match=f"{next(iter(changes))} = 0: gains are sought as factors"):
        anchored(VALUES.changed(changes), 15.0)
    assert anchored(VALUES.changed({"RHO_D_IMU": 0.0}), 15.0)["RHO_D_IMU"] > 0.0


@pytest.mark.parametrize("kind", SETS)
def test_integrals_keep_their_time(kind: str) -> None:
    larger = with_gains(START, kind, [1.5 * gain for gain in gains_of(START, kind)])
    suffix = "_IMU" if kind == INERTIAL else ""
    for loop in ("RHO", "ELE"):
        for letter in "PID":
            name = f"{loop}_{letter}{suffix}"
            assert larger[name] == pytest.approx(1.5 * START[name], rel=1e-6)
    other = "_IMU" if kind == PLAIN else ""
    assert larger[f"RHO_P{other}"] == START[f"RHO_P{other}"]


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

"""Wind fields taken apart into data give the same wind and the same bounds as the fields
themselves, of each kind, at places inside, outside and on their edges, and over time."""

from __future__ import annotations

from math import inf, isnan, nan, radians
from typing import Any

import numpy as np
import pytest

from tgl_soar.air.field import WindField
from tgl_soar.air.grid import GridField
from tgl_soar.air.gusts import BlendedField, Gust, GustyField, ScaledField, Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.air.polynomial import PolynomialField, fit_polynomial
from tgl_soar.air.wind_record import RecordedField, WindRecord
from tgl_soar.sim import compiled_air as module
from tgl_soar.sim.compiled_air import (
    Air,
    UnknownFieldError,
    air_inside,
    air_wind,
    as_air,
    known_air,
)
from tgl_soar.sim.glide_test import EvenAir
from tgl_soar.sim.world_step import FieldAir

JET = SlopeJet(8.5, radians(23.0))  # of the shipped site: its table is ready
HILL = HillField(8.0, 10.0)
POLYNOMIAL, _ = fit_polynomial(HILL, (-16.0, -11.0, 2.0, 12.0), 4, floor=((-16.0, 3.0), (-11, 4)))


def grid(*, deep: bool, outside: Any) -> GridField:
    """Nodes of random wind, some of them solid."""
    random = np.random.default_rng(4)
    x, y, z = np.linspace(-2.0, 2.0, 6), np.linspace(-1.0, 2.0, 5), np.linspace(0.0, 3.0, 7)
    shape = (6, 5, 7) if deep else (6, 7)
    u, v, w = (random.uniform(-3.0, 9.0, shape) for _ in range(3))
    solid = np.zeros(shape, dtype=bool)
    solid[2:4, ..., :2] = True
    if deep:
        solid[1, 1, 3] = solid[4, 3, 3] = True
    return GridField(
        x,
        y if deep else None,
        z,
        u,
        v,
        w,
        reference_wind_mps=8.0,
        solid=solid,
        outside=outside,
    )


FIELDS: dict[str, tuple[WindField, tuple[float, float, float, float, float, float]]] = {
    # A box of places for each, somewhat larger than the field.
    "hill": (HILL, (-20.0, 20.0, -5.0, 5.0, -1.0, 25.0)),
    "jet": (JET, (-1.0, 3.5, -1.8, 1.8, -0.2, 3.5)),
    "polynomial": (POLYNOMIAL, (-17.0, -10.0, -5.0, 5.0, 1.0, 13.0)),
    **{
        f"grid {'3d' if deep else '2d'} {outside}": (
            grid(deep=deep, outside=outside),
            (-2.5, 2.5, -1.5, 2.5, -0.5, 3.5),
        )
        for deep in (False, True)
        for outside in ("nan", "edge", "still")
    },
}


def places(box: tuple[float, ...], count: int = 300) -> list[tuple[float, float, float]]:
    random = np.random.default_rng(7)
    low, high = np.array(box[::2]), np.array(box[1::2])
    return [(float(x), float(y), float(z)) for x, y, z in random.uniform(low, high, (count, 3))]


@pytest.mark.parametrize("name", FIELDS)
def test_the_wind_of_the_data_is_the_fields_own(name: str) -> None:
    field, box = FIELDS[name]
    air = as_air(field)
    numbers = 0
    for x, y, z in places(box):
        expected, found = field.wind_at(x, y, z, 0.0), air_wind(air, x, y, z)
        assert found == pytest.approx(expected, abs=1e-9, nan_ok=True)
        numbers += not isnan(found[0])
    assert numbers > 50


@pytest.mark.parametrize("name", FIELDS)
def test_the_bounds_of_the_data_are_the_fields_own(name: str) -> None:
    field, box = FIELDS[name]
    air = as_air(field)
    inside = [(field.inside(*place), air_inside(air, *place)) for place in places(box)]
    assert all(theirs == ours for theirs, ours in inside)
    assert 20 < sum(ours for _, ours in inside) < 280


@pytest.mark.parametrize("outside", ["nan", "edge", "still"])
def test_the_edges_of_a_grid_belong_to_it(outside: str) -> None:
    field, _ = FIELDS[f"grid 3d {outside}"]
    air = as_air(field)
    for x in (-2.0, 2.0):
        for y in (-1.0, 2.0):
            for z in (0.0, 3.0):
                assert air_inside(air, x, y, z)
                assert air_wind(air, x, y, z) == pytest.approx(field.wind_at(x, y, z, 0.0))
    for place in ((-2.01, 0.0, 2.9), (0.0, -1.01, 2.9), (0.0, 0.0, 3.01), (2.01, 0.0, 2.9)):
        assert not air_inside(air, *place)
    beyond = air_wind(air, 2.01, 0.0, 2.9)
    if outside == "nan":
        assert all(isnan(each) for each in beyond)
    elif outside == "still":
        assert beyond == (0.0, 0.0, 0.0)
    else:
        assert beyond == pytest.approx(field.wind_at(2.0, 0.0, 2.9, 0.0))


def test_the_foot_of_the_hill_and_the_boards_end_belong_to_the_air() -> None:
    hill, jet = as_air(HILL), as_air(JET)
    assert air_inside(hill, 10.0, 0.0, 0.0)
    assert not air_inside(hill, 9.99, 0.0, 0.0)
    assert not air_inside(hill, 11.0, 0.0, -0.01)
    assert not air_inside(hill, 9.0, 99.0, 4.3)
    tip = jet.jet.tip_x_m
    height = tip * jet.jet.rise
    assert air_inside(jet, tip, 0.0, height + 0.001)
    assert not air_inside(jet, tip, 0.0, height - 0.001)
    assert air_inside(jet, tip + 0.001, 0.0, 0.01)  # in the wake the ground is the floor
    assert air_inside(jet, 0.0, 0.0, 0.0)
    half = 0.5 * JET.shape.jet_width_m
    assert air_inside(jet, 0.0, half, 1.0)
    assert not air_inside(jet, 0.0, -half - 0.001, 1.0)


def test_kinds_have_their_numbers_and_the_rest_of_the_data_is_empty() -> None:
    assert (module.HILL, module.BOARD, module.GRID, module.POLYNOMIAL) == (0, 1, 2, 3)
    kinds: list[Air] = [as_air(FIELDS[name][0]) for name in ("hill", "jet", "polynomial")]
    assert [air.kind for air in kinds] == [0, 1, 3]
    for air in kinds:
        assert not air.solid.any()
        assert not air.goes_on
        assert isnan(air.lost_mps)
    assert as_air(HILL).half_width_m == inf
    nodes = np.asarray(as_air(HILL).grid.values)
    assert nodes.shape == (24,)
    assert not nodes.any()


@pytest.mark.parametrize(
    ("outside", "goes_on", "lost_mps"),
    [("nan", False, nan), ("edge", True, nan), ("still", False, 0.0)],
)
def test_what_a_grid_answers_beyond_itself(outside: str, goes_on: bool, lost_mps: float) -> None:
    for depth in ("2d", "3d"):
        air = as_air(FIELDS[f"grid {depth} {outside}"][0])
        assert air.kind == module.GRID
        assert air.goes_on == goes_on
        assert air.lost_mps == pytest.approx(lost_mps, nan_ok=True)


def test_a_flat_grid_is_the_same_at_every_y_that_a_flight_reaches() -> None:
    air = as_air(FIELDS["grid 2d nan"][0])
    assert air.grid.ny == 2
    for y in (-1e5, -3.0, 0.0, 1e5):
        assert air_wind(air, 0.1, y, 2.2) == pytest.approx(air_wind(air, 0.1, 1.0, 2.2))
        assert air_inside(air, 1.9, y, 2.9)


# --- over time ------------------------------------------------------------------------------------

TIMES = np.linspace(0.0, 8.0, 33)
OTHER = grid(deep=True, outside="edge")
SAME_BOX = grid(deep=False, outside="edge")
RECORD = WindRecord(Schedule([0.0, 8.0], [6.0, 10.0]), Schedule([0.0, 8.0], [-0.3, 0.4]))
GUSTS = [
    Gust(start_s=1.0, duration_s=3.0, u_mps=2.0, v_mps=-1.0, w_mps=0.5),
    Gust(start_s=3.0, duration_s=4.0, u_mps=-1.0, v_mps=0.5, w_mps=1.0),
]
BLEND = BlendedField(OTHER, SAME_BOX, Schedule([1.0, 7.0], [0.0, 1.0]))
FACTOR = Schedule([2.0, 6.0], [1.0, 0.5])
OVER_TIME: dict[str, WindField] = {
    "steady": OTHER,
    "gusts": GustyField(OTHER, GUSTS),
    "scaled": ScaledField(OTHER, FACTOR),
    "blended": BLEND,
    "recorded": RecordedField(OTHER, RECORD),
    "gusts in a lull": ScaledField(GustyField(BLEND, GUSTS), FACTOR),
    "a lull with gusts": GustyField(ScaledField(BLEND, FACTOR), GUSTS),
    "a lull in a lull": ScaledField(ScaledField(OTHER, 0.5), FACTOR),
    "a record of gusts": RecordedField(GustyField(OTHER, GUSTS), RECORD),
    "gusts on a record": GustyField(RecordedField(ScaledField(OTHER, 0.5), RECORD), GUSTS),
}


@pytest.mark.parametrize("name", OVER_TIME)
def test_over_time_the_data_blow_as_the_field_does(name: str) -> None:
    field = OVER_TIME[name]
    air, plain = known_air(field, TIMES), FieldAir(field, 0.25, inf)
    for n in range(len(TIMES)):
        for place in ((0.3, 0.2, 1.9), (-1.4, 1.5, 2.6)):
            assert air.wind_at(n, *place) == pytest.approx(plain.wind_at(n, *place), abs=1e-9)


def test_a_blend_is_flyable_where_both_of_its_fields_are() -> None:
    """The second has more solid nodes than the first."""
    field = BlendedField(SAME_BOX, OTHER, Schedule([0.0], [0.5]))
    air, one = known_air(field, TIMES), known_air(SAME_BOX, TIMES)
    assert (air.weight == 0.5).all()
    assert (one.weight == -1.0).all()
    found = set()
    for place in places((-2.2, 2.2, -1.2, 2.2, -0.2, 3.2)):
        expected = SAME_BOX.inside(*place) and OTHER.inside(*place)
        assert air.flyable(0, *place) == expected
        assert one.flyable(0, *place) == SAME_BOX.inside(*place)
        found.add((expected, SAME_BOX.inside(*place)))
    assert found == {(True, True), (False, True), (False, False)}


def test_the_world_ends_at_its_half_width() -> None:
    air, plain = known_air(HILL, TIMES, 3.0), FieldAir(HILL, 0.25, 3.0)
    for y, inside in ((3.0, True), (-3.0, True), (3.001, False), (-3.001, False)):
        assert air.flyable(0, -15.0, y, 12.0) == inside
        assert plain.flyable(0, -15.0, y, 12.0) == inside
    assert not plain.flyable(0, 0.0, 0.0, 1.0)
    assert known_air(HILL, TIMES).half_width_m == inf


def test_steady_air_has_no_factor_and_no_gust() -> None:
    air = known_air(HILL, TIMES)
    assert (air.factor == 1.0).all()
    assert not air.gust_mps.any()
    assert air.gust_mps.shape == (33, 3)


def test_another_field_is_named_with_those_that_are_known() -> None:
    with pytest.raises(
        UnknownFieldError, match="EvenAir: compiled flights know SlopeJet, HillField, GridField"
    ):
        as_air(EvenAir(8.0))


def test_a_polynomial_keeps_its_floor() -> None:
    air = as_air(POLYNOMIAL)
    assert isinstance(POLYNOMIAL, PolynomialField)
    assert air.floor_x_m.tolist() == [-16.0, -11.0]
    assert air.floor_z_m.tolist() == [3.0, 4.0]
    assert not air_inside(air, -13.5, 0.0, 3.49)
    assert air_inside(air, -13.5, 0.0, 3.51)

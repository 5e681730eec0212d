"""The measured air in numbers: what two samples of telemetry give, and what of the map is drawn.

A made-up map answers where the drawing is tested, so that what is to be drawn is known.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgl_soar.cli.page import measured_air
from tgl_soar.cli.page.measured_air import AirSample, MeasuredAir, box_of, zero_segments
from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.lift_map import LiftMap, Reading
from tgl_soar.types import NO_GROUND, GlidePolar, Ground

VIEW = [-1.0, 3.0, 0.0, 3.2]
FENCE = {"FENCE_X_MIN": -0.5, "FENCE_X_MAX": 2.5, "FENCE_Z_MIN": 0.25, "FENCE_Z_MAX": 2.75}
POLAR = GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=15.0)


def air(ground: Ground = NO_GROUND, view: list[float] | None = None) -> MeasuredAir:
    return MeasuredAir(ground, POLAR, view or VIEW)


def sample(time_s: float, **changed: float) -> AirSample:
    still = {"x_m": 0.3, "z_m": 1.2, "velocity_x_mps": 0.0, "wind_mps": 8.5, "updraft_mps": 0.6}
    return AirSample(time_s=time_s, **{**still, **changed})


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[Reading]:
    """The readings that a map is given."""
    readings: list[Reading] = []
    monkeypatch.setattr(LiftMap, "take", lambda _map, reading: readings.append(reading))
    return readings


# --- readings ----------------------------------------------------------------------------------


def test_two_samples_give_their_middle_and_their_differences(taken: list[Reading]) -> None:
    measured = air()
    measured.take(
        sample(2.0, x_m=0.2, z_m=1.0, velocity_x_mps=-0.4, wind_mps=8.0, updraft_mps=0.5,
               pushed_mps=0.1), flying=True,
    )  # fmt: skip
    measured.take(
        sample(2.5, x_m=0.4, z_m=1.3, velocity_x_mps=0.6, wind_mps=9.0, updraft_mps=0.9,
               pushed_mps=0.3), flying=True,
    )  # fmt: skip
    (reading,) = taken
    # Airspeed: 8.5 of wind less 0.1 downstream; 1.0 m/s in 0.5 s of change; 0.6 m/s of climb, of
    # which a propeller gave 0.2; V v' / g of it was speed that is given up.
    airspeed, change, climb = 8.5 - 0.1, 1.0 / 0.5, 0.3 / 0.5 - 0.2
    assert reading._asdict() == pytest.approx(
        {
            "x_m": 0.3,
            "z_m": 1.15,
            "wind_mps": 8.5,
            "updraft_mps": 0.7,
            "airspeed_mps": airspeed,
            "energy_mps": climb - airspeed * change / 9.80665,
            "since_s": 0.5,
        }
    )


def test_a_reading_says_how_long_ago_the_one_before_was(taken: list[Reading]) -> None:
    measured = air()
    for t in (0.0, 0.5, 1.25, 5.0, 5.75):
        measured.take(sample(t), flying=True)
    assert [r.since_s for r in taken] == [0.5, 0.75, 4.5]
    measured.begin_again()
    for t in (9.0, 9.25):
        measured.take(sample(t), flying=True)
    assert taken[-1].since_s == 0.25


@pytest.mark.parametrize(("dt_s", "count"), [(-0.5, 0), (0.0, 0), (0.1, 1), (1.2, 1), (1.21, 0)])
def test_one_sample_of_two_a_second_may_be_lost(
    dt_s: float, count: int, taken: list[Reading]
) -> None:
    measured = air()
    measured.take(sample(0.0), flying=True)
    measured.take(sample(dt_s), flying=True)
    assert len(taken) == count


@pytest.mark.parametrize(("name", "value", "is_one"), [
    ("x_m", -1.0, True), ("x_m", -1.01, False), ("x_m", 3.0, True), ("x_m", 3.01, False),
    ("z_m", 0.0, True), ("z_m", -0.01, False), ("z_m", 3.2, True), ("z_m", 3.21, False),
    ("wind_mps", 0.0, False), ("wind_mps", 0.01, True), ("wind_mps", 99.9, True),
    ("wind_mps", 100.0, False), ("updraft_mps", 99.9, True), ("updraft_mps", -99.9, True),
    ("updraft_mps", -100.0, False), ("updraft_mps", 100.0, False),
    ("velocity_x_mps", 99.9, True), ("velocity_x_mps", -99.9, True),
    ("velocity_x_mps", 100.0, False), ("velocity_x_mps", -100.0, False),
    ("pushed_mps", 99.9, True), ("pushed_mps", -99.9, True), ("pushed_mps", 100.0, False),
    ("pushed_mps", -100.0, False),
])  # fmt: skip
def test_what_no_aircraft_measures_is_left_out(
    name: str, value: float, is_one: bool, taken: list[Reading]
) -> None:
    measured = air()
    measured.take(sample(0.0), flying=True)
    measured.take(sample(0.5, **{name: value}), flying=True)
    assert len(taken) == is_one
    measured.take(sample(1.0), flying=True)  # with what was left out there is no difference
    assert len(taken) == 2 * is_one


def test_a_sample_in_the_hand_is_none_of_a_pair(taken: list[Reading]) -> None:
    measured = air()
    measured.take(sample(0.0), flying=False)
    measured.take(sample(0.5), flying=True)
    assert taken == []
    measured.take(sample(1.0), flying=True)
    assert len(taken) == 1


def test_a_reading_that_the_map_cannot_take_begins_it_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = air()
    for t in (0.0, 0.5):
        measured.take(sample(t), flying=True)
    assert measured.readings == 1

    def fails(*_given: Any) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(LiftMap, "take", fails)
    measured.take(sample(1.0), flying=True)
    assert measured.readings == 0


def test_the_map_counts_with_the_wider_bias_of_a_wind_without_a_pitot_tube() -> None:
    """Telemetry does not report whether there is one."""
    measured = air()
    for t in (0.0, 0.5):
        measured.take(sample(t), flying=True)
    reading = Reading(
        x_m=0.3, z_m=1.2, wind_mps=8.5, updraft_mps=0.6, airspeed_mps=8.5, energy_mps=0.0,
        since_s=0.5,
    )  # fmt: skip
    places = np.array([0.3, 1.0]), np.array([1.2, 2.0])
    claimed = []
    for pitot in (False, True):
        other = LiftMap(NO_GROUND, Box._make(VIEW), POLAR, reading, pitot=pitot)
        other.take(reading)
        claimed.append(other.at(*places).excess_sd_mps)
    assert measured._map is not None
    assert measured._map.at(*places).excess_sd_mps == pytest.approx(claimed[0])
    assert (claimed[0] > 1.01 * claimed[1]).any()


# --- the box -----------------------------------------------------------------------------------


@pytest.mark.parametrize("i", range(4))
@pytest.mark.parametrize("value", [float("nan"), float("inf"), None])
def test_a_side_that_is_not_set_is_the_drawn_one(i: int, value: float | None) -> None:
    name = list(FENCE)[i]
    unset = PARAMETERS[INDEX[name]].default if value is None else value
    expected = [*FENCE.values()]
    expected[i] = VIEW[i]
    assert list(box_of({**FENCE, name: unset}, VIEW)) == expected


@pytest.mark.parametrize(("changed", "kept"), [
    ({}, False), ({"FENCE_X_MIN": 2.5}, True), ({"FENCE_Z_MIN": 2.75}, True),
    ({"FENCE_X_MIN": 2.4}, False), ({"FENCE_Z_MAX": 0.2}, True),
])  # fmt: skip
def test_another_box_begins_the_map_again_where_it_is_one(
    changed: dict[str, float], kept: bool
) -> None:
    measured = air()
    for t in (0.0, 0.5):
        measured.take(sample(t), flying=True)
    measured.bound({**FENCE, **changed})
    assert measured.readings == int(kept)


def test_the_same_box_keeps_the_map() -> None:
    measured = air()
    measured.bound(FENCE)
    for t in (0.0, 0.5):
        measured.take(sample(t), flying=True)
    measured.bound(FENCE)
    assert measured.readings == 1


# --- the drawing -------------------------------------------------------------------------------


class MadeUp:
    """A map with the test's values at each place."""

    def __init__(self, **fields: Any) -> None:
        self.readings, self.loose = 7, 0.12345
        self._fields: dict[str, Any] = {
            "wind_mps": 8.0, "updraft_mps": 0.5, "excess_mps": -0.5, "excess_sd_mps": 0.1, **fields
        }  # fmt: skip

    def at(self, x_m: Any, z_m: Any) -> Any:
        known = {
            name: np.asarray(f(x_m, z_m)) if callable(f) else np.full(x_m.shape, f)
            for name, f in self._fields.items()
        }
        return SimpleNamespace(**known)


def drawn(measured: MeasuredAir, made: MadeUp, *, near: bool = True) -> dict[str, Any]:
    measured._map = made  # type: ignore[assignment]
    measured._is_near[:] = near
    measured.draw_whole()
    assert measured.drawing is not None
    return measured.drawing


def test_the_grid_has_forty_nodes_along_its_longer_side() -> None:
    found = drawn(air(), MadeUp())
    cells = found["cells"]
    assert len(cells[0]) == 40
    assert len(cells) == 32  # 3.2 of 4 m
    assert (found["x"], found["z"]) == (-1.0, 0.0)
    assert found["step"] == pytest.approx(4.0 / 39)
    assert found["step_z"] == pytest.approx(3.2 / 31)
    assert (found["readings"], found["loose"]) == (7, 0.12)


@pytest.mark.parametrize(("view", "columns", "rows"), [
    ([0.0, 10.0, 0.0, 2.0], 40, 16), ([0.0, 2.0, 0.0, 10.0], 16, 40), ([0.0, 4.0, 0.0, 4.0], 40, 40)
])  # fmt: skip
def test_the_shorter_side_has_sixteen_at_least(view: list[float], columns: int, rows: int) -> None:
    cells = drawn(air(view=view), MadeUp())["cells"]
    assert (len(cells[0]), len(cells)) == (columns, rows)


def test_updraft_is_in_whole_centimetres_a_second_row_by_row_from_below() -> None:
    found = drawn(air(), MadeUp(updraft_mps=lambda x, z: x + 10.0 * z))
    rows = range(len(found["cells"]))
    for j in (0, 5, rows[-1]):
        for i in (0, 7, 39):
            x, z = found["x"] + i * found["step"], found["z"] + j * found["step_z"]
            assert found["cells"][j][i] == pytest.approx(100.0 * (x + 10.0 * z), abs=0.51)


@pytest.mark.parametrize(("sd_mps", "is_known"), [(0.49, True), (0.51, False)])
def test_a_place_is_drawn_where_its_error_is_half_of_the_sink_or_less(
    sd_mps: float, is_known: bool
) -> None:
    """The made-up aircraft sinks 1 m/s at every speed."""
    found = drawn(air(), MadeUp(excess_sd_mps=sd_mps, excess_mps=lambda x, _z: x))
    assert all((w is not None) == is_known for row in found["cells"] for w in row)
    assert bool(found["contour"]) == is_known


def test_nothing_is_drawn_that_no_reading_is_near() -> None:
    found = drawn(air(), MadeUp(excess_mps=lambda x, _z: x), near=False)
    assert {w for row in found["cells"] for w in row} == {None}
    assert found["contour"] == []


def test_near_is_three_tenths_of_the_boxs_height_from_the_readings() -> None:
    measured = air()
    for t in (0.0, 0.5):
        measured.take(sample(t, x_m=0.3, z_m=1.2), flying=True)
    x, z = np.linspace(-1.0, 3.0, 40), np.linspace(0.0, 3.2, 32)
    away = np.sqrt((x[None, :] - 0.3) ** 2 + (z[:, None] - 1.2) ** 2)
    assert np.array_equal(measured._is_near, away <= 0.3 * 3.2)
    measured.take(sample(1.0, x_m=2.3, z_m=1.2), flying=True)  # and what was near stays so
    away = np.minimum(away, np.sqrt((x[None, :] - 1.3) ** 2 + (z[:, None] - 1.2) ** 2))
    assert np.array_equal(measured._is_near, away <= 0.3 * 3.2)


def test_the_contour_is_where_excess_updraft_is_zero_in_millimetres() -> None:
    found = drawn(air(), MadeUp(excess_mps=lambda x, z: x + 0.5 * z - 1.23456))
    points = [point for segment in found["contour"] for point in segment]
    assert points
    for x, z in points:
        assert x + 0.5 * z == pytest.approx(1.23456, abs=0.001)
        assert (round(x, 3), round(z, 3)) == (x, z)


def test_over_the_ground_it_is_drawn_and_one_row_below_its_edge() -> None:
    level = Ground(2, (-9.0, 9.0, *[9.0] * 6), (1.0,) * 8)
    found = drawn(air(level), MadeUp(excess_mps=lambda x, _z: x - 0.5))
    step = 3.2 / 31
    heights = [j * step for j, row in enumerate(found["cells"]) if row[20] is not None]
    assert 1.0 - step < min(heights) < 1.0
    assert min(z for segment in found["contour"] for _, z in segment) > 1.0


def test_it_is_drawn_again_only_with_new_readings() -> None:
    measured, made = air(), MadeUp()
    first = drawn(measured, made)
    measured.draw_whole()
    assert measured.drawing is first
    made.readings += 1
    measured.draw_on()
    assert measured.drawing is first  # a row at a time
    measured.draw_whole()
    assert measured.drawing is not first
    assert measured.drawing["readings"] == 8


def test_nothing_measured_is_no_drawing() -> None:
    measured = air()
    measured.draw_whole()
    assert measured.drawing is None
    assert measured.readings == 0
    drawn(measured, MadeUp())
    measured.begin_again()
    assert measured.drawing is None


@pytest.mark.parametrize("low_m", [0.0, 100.0, -200.0])
def test_the_longer_side_of_the_fence_has_forty_nodes_wherever_it_is(low_m: float) -> None:
    """Heights count from home, which may lie far below the slope, or above it."""
    box = Box(-60.0, 0.0, low_m, low_m + 30.0)
    x, z = measured_air._axis(-60.0, 0.0, box), measured_air._axis(*box[2:], box)
    assert (len(x), len(z)) == (40, 20)
    assert (x[0], x[-1], z[0], z[-1]) == (*box,)
    turned = Box(low_m, low_m + 30.0, -60.0, 0.0)
    assert len(measured_air._axis(*turned[:2], turned)) == 20


# --- pieces of the contour ---------------------------------------------------------------------


def test_a_plane_is_cut_on_a_straight_line() -> None:
    x, z = np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 3.0])
    values = 2.0 * x[None, :] - z[:, None] - 0.5  # zero at z = 2 x - 0.5
    found = zero_segments(x, z, values)
    for start, end in found:
        for px, pz in (start, end):
            assert pz == pytest.approx(2.0 * px - 0.5)
    # From (0.25, 0) to (1.75, 3): through the cells of x 0-1, z 0-2; x 1-3, z 0-2; x 1-3, z 2-3.
    corners = sorted({(round(px, 6), round(pz, 6)) for pair in found for px, pz in pair})
    assert corners == [(0.25, 0.0), (1.0, 1.5), (1.25, 2.0), (1.75, 3.0)]
    assert len(found) == 3


def test_each_cell_of_a_grid_is_cut_by_its_own_corners() -> None:
    """As if it were a grid of its own, of whatever values."""
    rng = np.random.default_rng(5)
    for rows, columns in ((5, 7), (7, 5)):
        x, z = np.arange(float(columns)), np.arange(float(rows))
        values = rng.normal(size=(rows, columns))
        alone = [
            piece
            for j in range(rows - 1)
            for i in range(columns - 1)
            for piece in zero_segments(x[i : i + 2], z[j : j + 2], values[j : j + 2, i : i + 2])
        ]
        assert len(alone) > 20
        assert zero_segments(x, z, values) == alone


@pytest.mark.parametrize("corner", range(4))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_corner_of_another_sign_is_cut_off(corner: int, sign: float) -> None:
    values = np.full((2, 2), -3.0 * sign)
    j, i = divmod(corner, 2)
    values[j, i] = sign  # a quarter of the way to its neighbours is zero
    ((start, end),) = zero_segments(np.array([0.0, 1.0]), np.array([0.0, 1.0]), values)
    own = (float(i), float(j))
    for point in (start, end):
        away = sorted(abs(a - b) for a, b in zip(point, own, strict=True))
        assert away == pytest.approx([0.0, 0.25])


@pytest.mark.parametrize("corner", range(4))
def test_a_cell_with_an_unknown_corner_has_no_piece(corner: int) -> None:
    values = np.array([[1.0, -1.0], [1.0, -1.0]])
    assert len(zero_segments(np.arange(2.0), np.arange(2.0), values)) == 1
    values[divmod(corner, 2)] = np.nan
    assert zero_segments(np.arange(2.0), np.arange(2.0), values) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_sign_alone_has_no_zero(sign: float) -> None:
    assert zero_segments(np.arange(2.0), np.arange(2.0), np.full((2, 2), sign)) == []


def test_the_bounds_are_those_of_the_page() -> None:
    known = (measured_air.CELLS, measured_air.FEWEST, measured_air.GAP_S, measured_air.KNOWN)
    assert known == (40, 16, 1.2, 0.5)

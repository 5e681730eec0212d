"""The slides of `forecast`: their places, how starts are drawn, the equation that is integrated,
and what the forecast is given and says of one."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, exp, hypot, pi, radians, sin, sqrt, tan
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tgl_soar.air.hill import HillField
from tgl_soar.air.jet import SlopeJet
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.lift import forecast as e
from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.control import forecast as law
from tgl_soar.control.envelope import Fence, clearance
from tgl_soar.control.forecast import NO_FORECAST, OUTSIDE, TOO_LOW
from tgl_soar.types import GRAVITY_MPS2, Ground, polar_sink

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
LEVEL = Ground(2, (-50.0, 50.0, *[50.0] * 6), (0.0,) * 8)
FENCE = Fence(x_min_m=-20.0, x_max_m=20.0, y_max_m=9.0, z_min_m=0.5, z_max_m=20.0)
ETA = radians(105.0)
WIND = 9.0


class Air:
    """An even wind; its updraft is about the sink there at 10 m, and falls by 0.3 m/s a metre."""

    reference_wind_mps = 10.0

    def __init__(self, slope_per_s: float = 0.3, wind_mps: float = WIND) -> None:
        self.slope_per_s, self.wind_mps = slope_per_s, wind_mps

    def wind(self, x: Any, _y: Any, z: Any, _time_s: float = 0.0) -> Any:
        held = polar_sink(POLAR, min(max(self.wind_mps, 8.0), 11.5))
        w = held - self.slope_per_s * (np.asarray(z) - 10.0)
        return np.full_like(w, self.wind_mps) + 0.0 * x, 0.0 * w, w


def at(air: Air | None = None, **changes: Any) -> e.SlidePlace:
    made = e.SlidePlace(
        name="level",
        field=cast("Any", air or Air()),
        ground=LEVEL,
        fence=FENCE,
        clearance_min_m=2.0,
        scale_m=4.0,
        duration_s=16.0,
        step_m=0.01,
    )
    return made._replace(**changes)


START = e.SlideStart(
    x_m=0.0, z_m=9.0, eta_rad=ETA, wind=1.0, change=1.0, gusts=0.02, sink=1.0
)  # fmt: skip


class Same:
    """A generator that draws one number only, and says how many times it was asked."""

    def __init__(self, drawn: float) -> None:
        self.drawn, self.asked = drawn, 0

    def normal(self, size: tuple[int, int]) -> NDArray[np.float64]:
        self.asked += 1
        return np.full(size, self.drawn)


def still() -> Any:
    return Same(0.0)


# --- the places -----------------------------------------------------------------------------------


def test_the_board_is_that_of_the_tunnel_three_degrees_steeper() -> None:
    board, _ = e.places()
    tunnel = load_site(shipped("sites/tunnel.toml"))
    given = tunnel.parameters
    assert board.name == "board at 26°"
    assert isinstance(board.field, SlopeJet)
    assert board.field.wind_mps == 8.5
    assert board.field.shape.slope_rad == pytest.approx(radians(26.0))
    slope = radians(26.0)
    assert clearance(board.ground, -1.5, 0.2) == pytest.approx(0.2)
    # The ground is nearest at a right angle to the slope.
    assert clearance(board.ground, 1.1, 1.1 * tan(slope) + 0.2) == pytest.approx(0.2 * cos(slope))
    assert board.clearance_min_m == given["CLEAR_MIN"] == 0.3
    assert board.fence == Fence(x_min_m=-0.5, x_max_m=2.2, y_max_m=1.3, z_min_m=0.15, z_max_m=2.85)
    # The slide's time constant is a second or two there; a gust is as long as the site's.
    assert (board.scale_m, board.duration_s, board.step_m) == (1.5, 8.0, 0.01)


def test_the_board_ends_at_the_fence() -> None:
    board, _ = e.places()
    n = board.ground.points
    assert board.ground.x_m[:n] == (-2.0, 0.0, 2.2)
    assert board.ground.z_m[:n] == pytest.approx((0.0, 0.0, 2.2 * tan(radians(26.0))))


def test_the_large_hill_is_the_shipped_one_by_its_radius() -> None:
    _, hill = e.places()
    given = load_site(shipped("sites/hill.toml")).parameters
    assert hill.name == "hill of 14 m"
    assert isinstance(hill.field, HillField)
    assert (hill.field.hill.wind_mps, hill.field.hill.radius_m) == (8.0, 14.0)
    n = hill.ground.points
    radii = [hypot(x, z) for x, z in zip(hill.ground.x_m[:n], hill.ground.z_m[:n], strict=True)]
    turns = [atan2(z, x) for x, z in zip(hill.ground.x_m[:n], hill.ground.z_m[:n], strict=True)]
    assert radii == pytest.approx([14.0] * 8)
    assert turns == pytest.approx([pi - pi * i / 7.0 for i in range(8)], abs=1e-9)
    by = 14.0 / 8.0
    assert hill.fence.x_min_m == by * given["FENCE_X_MIN"]
    assert hill.fence.x_max_m == given["FENCE_X_MAX"] == 0.0
    assert hill.fence.y_max_m == by * given["FENCE_Y_MAX"]
    assert hill.fence.z_max_m == by * given["FENCE_Z_MAX"]
    assert hill.fence.z_min_m == given["FENCE_Z_MIN"]
    assert (hill.clearance_min_m, hill.scale_m) == (1.5, 8.0)
    assert (hill.duration_s, hill.step_m) == (30.0, 0.05)


@pytest.mark.parametrize(("quick", "count"), [(True, 40), (False, 500)])
def test_so_many_starts_are_flown(quick: bool, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each kind of line with a generator of its own, settling ones second."""
    asked: list[tuple[str, bool]] = []
    flown: list[tuple[str, int]] = []
    draws: list[float] = []

    def drawn(place: e.SlidePlace, _polar: Any, settles: bool, rng: Any) -> e.SlideStart:
        if (place.name, settles) not in asked:
            asked.append((place.name, settles))
            draws.append(float(rng.random()))
        return START

    def fly(place: e.SlidePlace, _polar: Any, starts: Sequence[Any], _rng: Any) -> list[e.Slid]:
        flown.append((place.name, len(starts)))
        foreseen_now = NO_FORECAST._replace(standing=TOO_LOW, ahead_s=2.0)
        return [
            e.Slid(start=START, foreseen=foreseen_now, time_s=1.0, left_m=0.5, is_outside=False)
            for _ in starts
        ]

    monkeypatch.setattr(e, "places", lambda: (at(name="one"), at(name="two")))
    monkeypatch.setattr(e, "drawn", drawn)
    monkeypatch.setattr(e, "fly", fly)
    found = e.run(Context(Flyer(), quick=quick))
    assert asked == [("one", False), ("one", True), ("two", False), ("two", True)]
    assert flown == [("one", count)] * 2 + [("two", count)] * 2
    assert len(set(draws)) == 4
    assert f"At each place {count} starts" in found.flown
    assert found.numbers["without"] == {name: [1.0] * count for name in ("one", "two")}
    assert found.numbers["false"] == {"one": count, "two": count}
    assert [claim.holds for claim in found.claims] == [True, False]


# --- where a line has a place ---------------------------------------------------------------------


def test_a_place_is_where_the_excess_falls_through_zero() -> None:
    (up_m,) = e.stops(at(), POLAR, START, 1.0)
    assert 9.0 + up_m * sin(ETA) == pytest.approx(10.0, abs=0.011)
    (down_m,) = e.stops(at(), POLAR, START._replace(z_m=11.0), 1.0)
    assert 11.0 + down_m * sin(ETA) == pytest.approx(10.0, abs=0.011)
    assert e.stops(at(Air(slope_per_s=-0.3)), POLAR, START, 1.0) == []  # unstable: it grows upwards


def test_who_sinks_more_has_its_place_lower() -> None:
    (up_m,) = e.stops(at(), POLAR, START._replace(sink=1.1), 1.0)
    lower_m = 0.1 * polar_sink(POLAR, WIND) / 0.3
    assert 9.0 + up_m * sin(ETA) == pytest.approx(10.0 - lower_m, abs=0.011)


@pytest.mark.parametrize(("wind", "change"), [(1.1, 1.0), (1.0, 1.1), (1.25, 0.88)])
def test_a_stronger_wind_carries_higher(wind: float, change: float) -> None:
    """Updraft and wind are both so many times the field's."""
    by = wind * change
    (up_m,) = e.stops(at(), POLAR, START._replace(wind=wind), change)
    wanted = polar_sink(POLAR, by * WIND) / by  # of the field's own updraft
    z_m = 10.0 + (polar_sink(POLAR, WIND) - wanted) / 0.3
    assert 9.0 + up_m * sin(ETA) == pytest.approx(z_m, abs=0.011)


def test_there_is_no_place_in_a_wind_beyond_the_polar() -> None:
    for wind_mps, some in (
        (POLAR.speed_min_mps - 0.05, False),
        (POLAR.speed_min_mps + 0.05, True),
        (POLAR.speed_max_mps - 0.05, True),
        (POLAR.speed_max_mps + 0.05, False),
    ):
        found = e.stops(at(Air(0.3, wind_mps)), POLAR, START, 1.0)
        assert bool(found) is some, wind_mps


def test_there_is_no_place_out_of_the_fence_nor_under_the_clearance() -> None:
    place = at()
    for fence, some in (
        (FENCE._replace(z_max_m=10.05), True),
        (FENCE._replace(z_max_m=9.95), False),
        (FENCE._replace(x_max_m=-0.2), True),  # the line leans upstream: x = -0.27 m at the place
        (FENCE._replace(x_max_m=-0.3), False),
        (FENCE._replace(x_min_m=-0.3), True),
        (FENCE._replace(x_min_m=-0.2), False),
    ):
        assert bool(e.stops(place._replace(fence=fence), POLAR, START, 1.0)) is some, fence
    assert e.stops(place._replace(clearance_min_m=9.95), POLAR, START, 1.0)
    assert not e.stops(place._replace(clearance_min_m=10.05), POLAR, START, 1.0)


def test_beyond_its_ends_a_polar_sinks_as_much_as_at_them() -> None:
    low, high = POLAR.speed_min_mps, POLAR.speed_max_mps
    found = e.sinks(POLAR, np.array([low - 1.0, low, high, high + 1.0]), 1.1)
    ends = [1.1 * polar_sink(POLAR, low), 1.1 * polar_sink(POLAR, high)]
    assert found == pytest.approx([ends[0], *ends, ends[1]])


def test_what_is_left_is_over_the_clearance_and_nothing_outside() -> None:
    assert e._left(at(), 0.0, 5.0) == pytest.approx(3.0)
    assert e._left(at(), 0.0, 1.5) == pytest.approx(-0.5)
    for x_m, z_m in ((-20.1, 5.0), (20.1, 5.0), (0.0, 20.1), (0.0, 0.4)):
        assert e._left(at(), x_m, z_m) == -1.0


# --- the draw -------------------------------------------------------------------------------------


def many(settles: bool, count: int) -> list[e.SlideStart]:
    rng = np.random.default_rng(11)
    place = at(step_m=0.05)
    return [e.drawn(place, POLAR, settles, rng) for _ in range(count)]


def test_a_start_without_a_place_is_over_a_fifth_of_the_clearance_in_a_wind_that_stays() -> None:
    place = at(Air(wind_mps=8.2), step_m=0.05)
    rng = np.random.default_rng(5)
    starts = [e.drawn(place, POLAR, False, rng) for _ in range(60)]
    assert all(e.stops(place, POLAR, start, 1.0) == [] for start in starts)
    heights = [start.z_m for start in starts]
    assert min(heights) >= 2.4  # CLEAR_MIN and a fifth
    assert min(heights) < 4.5
    assert max(heights) > 17.0
    sides = [start.x_m for start in starts]
    assert min(sides) < -15.0
    assert max(sides) > 15.0
    assert {start.change for start in starts} == {1.0}
    assert {start.gusts for start in starts} == {0.01, 0.03, 0.05}
    leans = {round(np.degrees(start.eta_rad) - 90.0) for start in starts}
    assert leans == {10, 15, 20, 25}
    winds, sinks = [s.wind for s in starts], [s.sink for s in starts]
    assert 0.75 <= min(winds) < max(winds) <= 1.15
    assert 0.9 <= min(sinks) < 0.92
    assert 1.08 < max(sinks) <= 1.1


def test_a_start_with_a_place_is_within_0_7_m_of_it_and_clear_of_ground_and_fence() -> None:
    place = at(step_m=0.05)
    starts = many(True, 80)
    away = [min(map(abs, e.stops(place, POLAR, start, 1.0))) for start in starts]
    assert max(away) <= 0.7 + 0.05
    assert max(away) > 0.6
    assert min(away) < 0.1
    assert all(e._left(place, start.x_m, start.z_m) >= 1.0 for start in starts)
    changing = [start for start in starts if start.change != 1.0]
    assert 20 < len(changing) < 60
    assert all(0.85 <= start.change <= 1.2 for start in changing)
    assert min(start.change for start in changing) < 0.9
    assert max(start.change for start in changing) > 1.12
    for start in changing:
        (up_m,) = e.stops(place, POLAR, start, start.change)  # in the changed wind too
        x_m, z_m = start.x_m + up_m * cos(start.eta_rad), start.z_m + up_m * sin(start.eta_rad)
        assert e._left(place, x_m, z_m) >= 1.0


def test_a_place_without_room_in_the_changed_wind_is_drawn_again() -> None:
    """Where the fence is half a metre over the place in the wind of the beginning, none whose wind
    grows is kept."""
    place = at(step_m=0.05, fence=FENCE._replace(z_max_m=11.0))
    rng = np.random.default_rng(2)
    starts = [e.drawn(place, POLAR, True, rng) for _ in range(40)]
    for start in starts:
        (up_m,) = e.stops(place, POLAR, start, start.change)
        assert start.z_m + up_m * sin(start.eta_rad) <= 11.0
        assert start.z_m + up_m * sin(start.eta_rad) >= 3.0


class Low(Air):
    """The same 6.7 m lower: its place is 1.3 m over the clearance, and lower in less wind."""

    def wind(self, x: Any, _y: Any, z: Any, _time_s: float = 0.0) -> Any:
        return super().wind(x, _y, np.asarray(z) + 6.7)


def test_a_place_that_a_weaker_wind_lowers_to_the_clearance_is_drawn_again() -> None:
    """Half the clearance is to be left over it, at the start and in both winds."""
    place = at(Low(), step_m=0.05)
    rng = np.random.default_rng(4)
    starts = [e.drawn(place, POLAR, True, rng) for _ in range(60)]
    heights = []
    for start in starts:
        (up_m,) = e.stops(place, POLAR, start, start.change)
        heights.append(start.z_m + up_m * sin(start.eta_rad))
        assert heights[-1] >= 3.0
        assert start.z_m >= 3.0
    assert min(heights) < 3.1
    assert any(start.change < 1.0 for start in starts)


# --- the slide ------------------------------------------------------------------------------------


def slid(start: e.SlideStart, place: e.SlidePlace, rng: Any = None) -> NDArray[np.float64]:
    return e.slides(place, POLAR, [start], rng or still())[:, :, 0]


def test_who_begins_at_its_place_stays() -> None:
    rows = slid(START._replace(z_m=10.0), at())
    assert rows.shape == (160, 6)  # ten readings a second
    assert np.abs(rows[:, 0]).max() < 1e-9
    assert rows[:, 1] == pytest.approx(np.full(160, 10.0))
    assert rows[:, 4] == pytest.approx(np.full(160, WIND))
    assert rows[:, 5] == pytest.approx(np.full(160, polar_sink(POLAR, WIND)))


def test_a_slide_is_the_docstrings_equation() -> None:
    """(V/g) cos(eta) s'' = sin(eta) s' − w + S(V), and V = u − cos(eta) s', by another solver."""
    place = at(duration_s=4.0)

    def change(_t: float, state: Any) -> tuple[float, float]:
        s, speed = state
        airspeed = WIND - cos(ETA) * speed
        w = polar_sink(POLAR, WIND) - 0.3 * (START.z_m + s * sin(ETA) - 10.0)
        away = sin(ETA) * speed - w + 1.05 * polar_sink(POLAR, airspeed)
        return speed, away * GRAVITY_MPS2 / (airspeed * cos(ETA))

    times = 0.1 * np.arange(40)
    truth = solve_ivp(change, (0.0, 4.0), (0.0, 0.0), t_eval=times, rtol=1e-8, atol=1e-10).y
    rows = slid(START._replace(sink=1.05), place)
    # Steps of 20 ms of a mode that lasts a quarter of a second.
    assert rows[:, 0] == pytest.approx(truth[0] * cos(ETA), abs=0.004)
    assert rows[:, 1] == pytest.approx(START.z_m + truth[0] * sin(ETA), abs=0.01)
    assert rows[:, 2] == pytest.approx(truth[1] * cos(ETA), abs=0.008)
    assert rows[:, 3] == pytest.approx(truth[1] * sin(ETA), abs=0.03)
    assert truth[0][-1] > 0.4  # it moves by more than that


def test_a_change_of_wind_lasts_from_the_second_to_the_tenth_second() -> None:
    rows = slid(START._replace(change=1.2, wind=0.95), at())
    at_s = {time_s: rows[round(time_s / 0.1), 4] for time_s in (0.0, 2.0, 4.0, 6.0, 10.0, 15.0)}
    grown = {0.0: 1.0, 2.0: 1.0, 4.0: 1.05, 6.0: 1.1, 10.0: 1.2, 15.0: 1.2}
    for time_s, by in grown.items():
        assert at_s[time_s] == pytest.approx(0.95 * WIND * by), time_s


def test_gusts_and_errors_of_the_estimate_are_as_large_as_they_are_said_to_be() -> None:
    """Of a generator that draws ones: sigma is gusts times the wind that names the field, and fades
    over the scale; the bias is 0.15 m/s of wind, 0.06 of updraft, and 5 cm/s of noise are added."""
    rng = Same(1.0)
    start = START._replace(z_m=10.0, wind=1.1)
    rows = slid(start, at(duration_s=1.0), rng)
    sigma = 0.02 * 1.1 * 10.0
    keeps = exp(-0.02 * 10.0 / 4.0)
    gust = sigma
    w = 1.1 * polar_sink(POLAR, WIND)
    assert rows[0, 4] == pytest.approx(1.1 * WIND + gust + 0.15 + 0.05)
    assert rows[0, 5] == pytest.approx(w + gust + 0.06 + 0.05)
    for _ in range(5):
        gust = keeps * gust + sigma * sqrt(1.0 - keeps**2)
    assert rows[1, 4] == pytest.approx(1.1 * WIND + gust + 0.15 + 0.05)
    # Gust and bias once, then one draw of gusts a step, and of noise a reading.
    assert rng.asked == 2 + 50 + 10


def test_gusts_move_the_aircraft() -> None:
    rows = slid(START._replace(z_m=10.0, gusts=0.05), at(), Same(1.0))
    assert rows[3, 3] > 0.0  # an updraft of half a metre a second more
    assert rows[-1, 1] > 10.5


def test_many_slides_at_once_are_each_as_alone() -> None:
    other = START._replace(x_m=1.0, z_m=8.0, eta_rad=radians(110.0), wind=1.05, sink=0.95)
    both = e.slides(at(), POLAR, [START, other], still())
    assert both.shape == (160, 6, 2)
    assert both[:, :, 0] == pytest.approx(slid(START, at()))
    assert both[:, :, 1] == pytest.approx(slid(other, at()))


def test_a_slide_that_is_cut_within_a_reading_has_that_reading() -> None:
    assert len(slid(START, at(duration_s=0.22))) == 3  # at 0, 0.1 and 0.2 s


# --- the forecast of one --------------------------------------------------------------------------


def rows_of(x_m: Any, z_m: Any, climb: float, excess: float, count: int = 60) -> Any:
    """A path that moves evenly, and what is read of the air on it."""
    ones = np.ones(count)
    return np.column_stack(
        [x_m * ones, z_m * ones, 0.0 * ones, climb * ones, WIND * ones,
         (polar_sink(POLAR, WIND) + excess) * ones]
    )  # fmt: skip


def test_a_slide_ends_at_the_clearance_unreported_or_out_of_the_fence() -> None:
    times = 0.1 * np.arange(60)
    falls = rows_of(0.0, 2.35 - 1.0 * times, -1.0, 0.0)
    found = e.foreseen(at(), POLAR, START, falls, still())
    assert found.foreseen is None
    assert found.start == START
    assert found.time_s == pytest.approx(0.4)
    assert found.left_m == pytest.approx(-0.05)
    assert not found.is_outside
    leaves = rows_of(0.0, 19.75 + 1.0 * times, 1.0, 0.0)
    found = e.foreseen(at(), POLAR, START, leaves, still())
    assert found.foreseen is None
    assert found.time_s == pytest.approx(0.3)
    assert (found.left_m, found.is_outside) == (-1.0, True)


def test_who_stands_still_in_its_lift_is_never_reported() -> None:
    found = e.foreseen(at(), POLAR, START, rows_of(0.0, 10.0, 0.0, 0.0), still())
    assert found.foreseen is None
    assert found.time_s == pytest.approx(5.9)
    assert found.left_m == pytest.approx(8.0)
    assert not found.is_outside


def test_who_sinks_without_end_is_reported_when_it_is_foreseen() -> None:
    times = 0.1 * np.arange(60)
    sinks = rows_of(0.0, 9.0 - 1.0 * times, -1.0, -1.0)
    found = e.foreseen(at(), POLAR, START, sinks, still())
    assert found.foreseen is not None
    assert found.foreseen.standing == TOO_LOW
    assert law.WINDOW_S <= found.time_s < 6.5  # before it is there
    assert found.left_m == pytest.approx(9.0 - found.time_s - 2.0)
    assert not found.is_outside


def test_the_forecast_is_given_the_truth_with_the_noise_of_an_estimate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """3 mm of place and 2 cm/s of velocity, of a generator that draws ones."""
    given: list[dict[str, Any]] = []

    def step(params: Any, fence: Any, ground: Any, state: Any, **rest: Any) -> Any:
        given.append({"params": params, "fence": fence, "ground": ground, **rest})
        return law.forecast_step(params, fence, ground, state, **rest)

    monkeypatch.setattr(e, "forecast_step", step)
    rows = rows_of(0.4, 10.0, 0.25, 0.1, count=3)
    rows[:, 2] = -0.5
    e.foreseen(at(), POLAR, START, rows, cast("Any", Same(1.0)))
    assert [each["vehicle"].time_s for each in given] == pytest.approx([0.0, 0.1, 0.2])
    last = given[-1]
    vehicle, air, params = last["vehicle"], last["air"], last["params"]
    assert (vehicle.x_m, vehicle.y_m, vehicle.z_m) == pytest.approx((0.403, 0.0, 10.003))
    assert (vehicle.velocity_x_mps, vehicle.climb_mps) == pytest.approx((-0.48, 0.27))
    assert vehicle.velocity_y_mps == 0.0
    assert (vehicle.roll_rad, vehicle.pitch_rad, vehicle.heading_rad) == (0.0, 0.0, 0.0)
    rates = (vehicle.roll_rate_radps, vehicle.pitch_rate_radps, vehicle.heading_rate_radps)
    assert rates == (0.0, 0.0, 0.0)
    assert air.wind_mps == WIND
    assert air.updraft_mps == pytest.approx(polar_sink(POLAR, WIND) + 0.1)
    assert (air.wind_sigma_mps, air.updraft_sigma_mps) == (0.15, 0.06)
    assert (last["velocity_sigma_mps"], last["eta_rad"], last["moving"]) == (0.03, ETA, False)
    assert (last["fence"], last["ground"]) == (FENCE, LEVEL)
    defaults = {p.name: p.default for p in PARAMETERS}
    assert params.act == law.DISENGAGE
    assert params.time_s == defaults["FC_TIME"]
    assert params.chance == defaults["FC_CHANCE"]
    assert params.speed_min_mps == defaults["SPEED_MIN"]
    assert params.clearance_min_m == 2.0
    assert params.polar == POLAR


def test_every_start_is_slid_and_forecast() -> None:
    starts = [START, START._replace(z_m=12.0), START._replace(z_m=3.0)]
    place = at(duration_s=3.0)
    found = e.fly(place, POLAR, starts, np.random.default_rng(1))
    assert [each.start for each in found] == starts
    assert all(each.time_s <= 3.0 for each in found)


# --- what is reported -----------------------------------------------------------------------------


def ended(time_s: float, left_m: float, ahead_s: float | None = None, out: bool = False) -> e.Slid:
    foreseen_now = None
    if ahead_s is not None:
        foreseen_now = NO_FORECAST._replace(standing=TOO_LOW, ahead_s=ahead_s)
    return e.Slid(start=START, foreseen=foreseen_now, time_s=time_s, left_m=left_m, is_outside=out)


def test_the_row_of_lines_without_a_place_counts_each_end_once() -> None:
    early = [ended(time_s, 0.5, ahead_s=3.0) for time_s in (0.6, 1.0, 1.9)]
    near = ended(2.2, 0.3, ahead_s=0.9)  # late, but a second before the limit or less
    long_after = ended(4.0, 0.1, ahead_s=1.1)
    sunk = [ended(1.0, -0.1), ended(2.5, -0.1)]
    left = ended(3.0, -1.0, out=True)
    neither = [ended(8.0, 0.4), ended(8.0, 0.4), ended(8.0, 0.4)]
    row = e._reported_row("here", [*early, near, long_after, *sunk, left, *neither])
    assert row == (
        "here",
        "5 of 11",
        "2, 1 of them late",
        "1",
        "3",
        "1.9",
        "3.3",  # of 0.6, 1.0, 1.9, 2.2 and 4.0 s: 0.6 of the way from the fourth to the fifth
        "4",
        "0.50",
    )


def test_at_the_clearance_is_below_it_and_not_at_it() -> None:
    assert not e.sank(ended(3.0, 0.0))
    assert e.sank(ended(3.0, -0.001))
    assert not e.late(ended(law.WINDOW_S + e.REPORTED_S, -0.1))
    assert e.late(ended(law.WINDOW_S + e.REPORTED_S + 0.01, -0.1))
    assert e.REPORTED_S == 1.5


def test_the_row_of_lines_with_a_place_says_what_was_reported_wrongly() -> None:
    good = [ended(8.0, 0.5) for _ in range(97)]
    low, out = ended(1.0, 0.5, ahead_s=1.0), ended(1.0, 0.5, ahead_s=1.0)
    assert out.foreseen is not None
    out = out._replace(foreseen=out.foreseen._replace(standing=OUTSIDE))
    row = e._false_row("there", [*good, low, out, low])
    assert row[:3] == ("there", "100", "3")
    # Wilson's interval of 3 of 100.
    assert row[3:] == ("1.0 to 8.5 %", "2 sinks below CLEAR_MIN, 1 leaves the fence")
    assert e._false_row("there", good)[2:] == ("0", "0.0 to 3.8 %", "–")


def test_less_than_one_in_a_hundred_may_be_reported_wrongly_at_each_place() -> None:
    good, wrong = ended(8.0, 0.5), ended(1.0, 0.5, ahead_s=1.0)
    few = [good] * 100 + [wrong]
    for having, holds in (
        ({"a": few, "b": few}, True),
        ({"a": few, "b": [good] * 99 + [wrong]}, False),
        ({"a": [good] * 99 + [wrong], "b": few}, False),
    ):
        assert e.claims({"a": [good]}, having)[1].holds is holds
    late = ended(2.5, -0.1)
    for without, holds in (
        ({"a": [good], "b": [good]}, True),
        ({"a": [good], "b": [good, late]}, False),
    ):
        claim = e.claims(without, {"a": [good]})[0]
        assert claim.holds is holds
    assert claim.measured == "0 of 1, a, 1 of 2, b"
    assert e.claims({"a": [good]}, {"a": few})[1].measured == "1 of 101, a"

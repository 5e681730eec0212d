"""A search that is sent glimpses: when it restarts, what it keeps, and what it answers."""

from __future__ import annotations

from typing import Any

import pytest
from samples import STILL
from test_rollout import ETA, GUARDS, POLAR

from tgl_soar.control.envelope import Fence
from tgl_soar.control.search.glimpse import Glimpse, LineRequest, SearchTask
from tgl_soar.control.search.lift_search import LiftSearch, Seeker, Sighting, sighting_of
from tgl_soar.control.search.plan import LinePlan
from tgl_soar.control.search.search import SearchState
from tgl_soar.control.target_line import LineLimits, LineTracking, TargetLine
from tgl_soar.types import GRAVITY_MPS2, GROUND_POINTS, Ground

BOX = GUARDS.box
TASK = SearchTask(
    fence=Fence(
        x_min_m=BOX.x_min_m,
        x_max_m=BOX.x_max_m,
        y_max_m=5.0,
        z_min_m=BOX.z_min_m,
        z_max_m=BOX.z_max_m,
    ),
    ground=GUARDS.ground,
    polar=POLAR,
    clearance_min_m=1.0,
    line=GUARDS.line,
    eta_min_rad=1.6,
    eta_max_rad=2.0,
)
LINE = LineTracking(x_m=0.0, z_m=10.0, eta_rad=ETA, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0)

PLAN = LinePlan(
    target=TargetLine(0.0, 10.0, ETA),
    stays=True,
    worth=1.0,
    chance=1.0,
    stay_chance=1.0,
    stay_weaker=True,
    most_chance=1.0,
    lasts_s=9.0,
    place_x_m=0.0,
    place_z_m=10.0,
    margin_m=5.0,
    holds_s=1e9,
)


def glimpse(time_s: float, **changed: Any) -> Glimpse:
    """At rest in 9 m/s, 10 m up."""
    usual: dict[str, Any] = {
        "before": STILL._replace(time_s=time_s - 0.2, z_m=10.0),
        "now": STILL._replace(time_s=time_s, z_m=10.0),
        "line": LINE,
        "wind_mps": 9.0,
        "updraft_mps": 0.5,
        "pitot": True,
        "seeks": True,
        "refused": None,
    }
    return Glimpse(**{**usual, **changed})


@pytest.fixture
def seeker() -> Seeker:
    made = Seeker()
    made.begin(TASK)
    return made


def asked(seeker: Seeker, time_s: float, **changed: Any) -> LineRequest | None:
    return seeker.take(glimpse(time_s, **changed), plans=False)


def test_an_answer_says_of_which_glimpse_and_search_it_is(seeker: Seeker) -> None:
    request = asked(seeker, 3.0, search=4)
    assert request is not None
    assert (request.time_s, request.search) == (3.0, 4)
    assert request.target == TargetLine(0.0, 10.0, ETA)
    assert request.over_ground_m == pytest.approx(10.0)


def test_before_it_has_a_place_and_after_a_flight_it_answers_nothing(
    seeker: Seeker,
) -> None:
    assert asked(Seeker(), 1.0) is None
    assert asked(seeker, 1.0) is not None
    assert seeker.take(None) is None
    assert seeker.search is None


def test_a_glimpse_without_a_place_is_passed_over(seeker: Seeker) -> None:
    asked(seeker, 1.0)
    known = seeker.search
    nowhere = STILL._replace(time_s=1.2, x_m=float("nan"))
    assert asked(seeker, 1.2, now=nowhere) is None
    assert asked(seeker, 1.2, before=STILL._replace(time_s=1.2)) is None  # no time has passed
    assert seeker.search is known


def test_who_only_listens_keeps_the_map_and_restarts_when_a_line_is_wanted(
    seeker: Seeker,
) -> None:
    asked(seeker, 1.0)
    assert seeker.search is not None
    known = seeker.search.map
    assert asked(seeker, 1.2, seeks=False) is None
    assert (seeker.search.state, seeker.search.map) == (None, known)


def test_a_map_is_older_by_as_long_as_nothing_was_received(seeker: Seeker) -> None:
    """As after minutes of beating: a trend is over, and of the wind less is known."""
    for n in range(40):
        seeker.take(glimpse(1.0 + 0.2 * n, wind_mps=9.0 * 0.996**n, seeks=False))
    assert seeker.search is not None
    known = seeker.search.map
    falls, before_mps = known.trend[0], float(known.at([0.0], [10.0]).wind_sd_mps[0])
    gusts = known.gusts_mps2
    seeker.take(glimpse(600.0, wind_mps=9.0, seeks=False))
    assert falls < -0.005
    assert abs(known.trend[0]) < 1e-6
    assert float(known.at([0.0], [10.0]).wind_sd_mps[0]) > 1.5 * before_mps
    assert known.gusts_mps2 == pytest.approx(gusts, rel=0.1)  # one reading says little of them


def test_a_clock_that_goes_back_makes_a_map_no_older(seeker: Seeker) -> None:
    other = Seeker()
    other.begin(TASK)
    for n in range(10):
        seeker.take(glimpse(601.0 + 0.2 * n, seeks=False))
        other.take(glimpse(1.0 + 0.2 * n, seeks=False))
    for each in (seeker, other):
        each.take(glimpse(3.0, seeks=False))
    assert seeker.search is not None
    assert other.search is not None
    assert seeker.search.map.trend == pytest.approx(other.search.map.trend)


@pytest.mark.parametrize("newer", [False, True])
def test_what_was_refused_is_left_out_and_not_what_was_asked_for_since(
    seeker: Seeker, monkeypatch: pytest.MonkeyPatch, newer: bool
) -> None:
    """A slow search has asked for B before it receives that A was refused."""
    a, b = TargetLine(2.0, 10.0, ETA), TargetLine(-2.0, 10.0, ETA)
    asks = [a, b] if newer else [a]

    def planned(_search: LiftSearch, _look: Sighting, state: SearchState) -> LinePlan:
        target = asks.pop(0) if asks else state.target
        return PLAN._replace(target=target, stays=target == state.target)

    monkeypatch.setattr(LiftSearch, "planned", planned)
    for k in range(3):
        seeker.take(glimpse(1.0 + 0.2 * k))
    request = seeker.take(glimpse(1.6, refused=a))
    assert request is not None
    assert request.target == (b if newer else TargetLine(0.0, 10.0, ETA))
    assert seeker.search is not None
    assert [line for _, line in seeker.search._refused] == [a]


def test_another_search_begins_from_the_start_with_the_same_map(seeker: Seeker) -> None:
    asked(seeker, 1.0, search=1)
    assert seeker.search is not None
    search, known = seeker.search, seeker.search.map
    for n in range(5):
        asked(seeker, 1.2 + 0.2 * n, search=1)
    assert search.state is not None
    assert search.state.time_s == pytest.approx(1.2)
    asked(seeker, 2.2, search=2)
    assert search.state.time_s == pytest.approx(0.2)
    asked(seeker, 2.4, search=2)
    assert search.state.time_s == pytest.approx(0.4)
    assert seeker.search.map is known


def test_a_line_that_was_refused_stays_where_it_is(seeker: Seeker) -> None:
    asked(seeker, 1.0)
    search = seeker.search
    assert search is not None
    assert search.state is not None
    there = TargetLine(2.0, 10.0, ETA)
    search.state = search.state._replace(target=there)
    assert asked(seeker, 1.2).target.x_m == 2.0  # type: ignore[union-attr]
    assert asked(seeker, 1.4, refused=there).target.x_m == 0.0  # type: ignore[union-attr]


HILL = Ground(1, (0.0,) * GROUND_POINTS, (1.0,) * GROUND_POINTS)


@pytest.mark.parametrize(
    ("changed", "is_reset"),
    [
        ({}, False),
        ({"fence": TASK.fence._replace(x_max_m=19.0)}, True),
        ({"ground": HILL}, True),
        ({"polar": POLAR._replace(speed_max_mps=11.0)}, True),
        ({"clearance_min_m": 2.0}, False),
        ({"line": LineLimits(0.1, 0.1, 0.1)}, False),
        ({"eta_min_rad": 1.7}, False),
    ],
)
def test_a_map_is_of_one_place_and_one_aircraft(
    seeker: Seeker, changed: dict[str, Any], is_reset: bool
) -> None:
    asked(seeker, 1.0)
    seeker.begin(TASK._replace(**changed))
    assert (seeker.search is None) is is_reset
    asked(seeker, 1.2)
    assert seeker.search is not None
    etas = changed.get("eta_min_rad", 1.6), 2.0
    assert seeker.search.leans_rad == etas


def test_what_a_glimpse_says_is_the_mean_of_its_two_ends() -> None:
    """Slowed and carried up by 0.3 m/s of a propeller, over level ground at 0 m."""
    before = STILL._replace(time_s=1.0, x_m=1.0, z_m=10.0, velocity_x_mps=-0.4)
    now = STILL._replace(time_s=1.2, x_m=0.9, z_m=10.1, velocity_x_mps=-0.6, climb_mps=0.7)
    look = sighting_of(
        GUARDS, glimpse(1.2, before=before, now=now, pushed_mps=0.3, carried=True, pitot=False)
    )
    assert look is not None
    reading = look.reading
    assert (reading.x_m, reading.z_m) == pytest.approx((0.95, 10.05))
    assert (reading.wind_mps, reading.updraft_mps) == (9.0, 0.5)
    assert reading.airspeed_mps == pytest.approx(9.5)
    # Height and speed: climbing at 0.5 m/s, and its airspeed grows by 1 m/s².
    assert reading.energy_mps == pytest.approx(0.5 - 0.3 + 9.5 / GRAVITY_MPS2 * 1.0)
    assert (look.time_s, look.dt_s, reading.since_s) == pytest.approx((1.2, 0.2, 0.2))
    assert look.climb_mps == pytest.approx(0.5)
    assert look.over_ground_m == pytest.approx(10.1)
    assert (look.moving.x_m, look.moving.z_m, look.moving.climb_mps) == (0.9, 10.1, 0.7)
    assert (look.pitot, look.carried) == (False, True)

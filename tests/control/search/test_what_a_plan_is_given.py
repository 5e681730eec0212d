"""What the search hands over to a plan: the guards, the gusts, the leans and what was refused."""

from __future__ import annotations

from typing import Any

import pytest
from test_rollout import ETA, GUARDS, POLAR, at_rest

from tgl_soar.control.search import lift_search
from tgl_soar.control.search.glimpse import GIVEN_UP, LOOKING
from tgl_soar.control.search.lift_search import LiftSearch, Sighting
from tgl_soar.control.search.plan import LinePlan, plan_in
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.lift_map.lift_map import Reading

READING = Reading(
    x_m=0.0, z_m=10.0, wind_mps=9.0, updraft_mps=0.6, airspeed_mps=9.0, energy_mps=0.0, since_s=0.2
)


def look(time_s: float = 1.0, *, carried: bool = False) -> Sighting:
    """At rest 10 m over level ground, where landing needs 1.5 m."""
    return Sighting(
        time_s=time_s,
        dt_s=0.2,
        reading=READING,
        moving=at_rest(),
        climb_mps=0.0,
        over_ground_m=10.0,
        guards=GUARDS,
        pitot=True,
        carried=carried,
    )


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the last plan was given beyond grid, fields and polar."""
    arguments: dict[str, Any] = {}

    def plan(*places: Any, **names: Any) -> LinePlan:
        arguments.update(names, guards=places[3])
        return plan_in(*places, **names)

    monkeypatch.setattr(lift_search, "plan_in", plan)
    return arguments


@pytest.fixture
def search() -> LiftSearch:
    """One that knows the air where it is."""
    made = LiftSearch(POLAR)
    made.listen(look())
    return made


@pytest.mark.parametrize(("carried", "landing_m"), [(False, 1.5), (True, 0.0)])
def test_with_power_no_height_for_landing_is_kept(
    search: LiftSearch, given: dict[str, Any], carried: bool, landing_m: float
) -> None:
    search.seek(look(carried=carried))
    assert given["guards"] == GUARDS._replace(landing_m=landing_m)


@pytest.mark.parametrize(("slower_mps", "landing_m"), [(0.1, 0.0), (-0.1, 1.5)])
def test_power_carries_no_aircraft_in_a_wind_too_slow_to_hover_in(
    given: dict[str, Any], slower_mps: float, landing_m: float
) -> None:
    """By the map where it is, and not by the wind of this instant."""
    slow = LiftSearch(POLAR)
    wind_mps = GUARDS.speed_min_mps + slower_mps
    for _ in range(50):
        slow.listen(look()._replace(reading=READING._replace(wind_mps=wind_mps)))
    assert slow.map.at([0.0], [10.0]).wind_mps[0] == pytest.approx(wind_mps, abs=0.05)
    gust = look(carried=True)
    slow.seek(gust._replace(reading=READING._replace(wind_mps=20.0)))
    assert given["guards"] == GUARDS._replace(landing_m=landing_m)


def test_in_such_a_wind_a_search_with_power_gives_up_in_words() -> None:
    for wind_mps, status in ((9.0, LOOKING), (6.5, GIVEN_UP)):
        search = LiftSearch(POLAR)
        for tick in range(1, 40):
            sinks = look(0.2 * tick, carried=True)._replace(
                reading=READING._replace(wind_mps=wind_mps, updraft_mps=-0.5, energy_mps=-1.9),
                climb_mps=-1.5,
            )
            search.listen(sinks)
            search.seek(sinks)
        assert search.state is not None
        assert search.state.status == status


def test_half_of_the_gusts_of_a_reading_of_a_fifth_of_a_second_carries_it(
    search: LiftSearch, given: dict[str, Any]
) -> None:
    search.seek(look())
    assert given["diffusion_m2ps"] == pytest.approx(0.1 * search.map.gusts_mps2)
    assert search.map.gusts_mps2 > 0.0


def test_a_plan_is_made_where_it_is_for_where_the_line_goes(
    search: LiftSearch, given: dict[str, Any]
) -> None:
    search.seek(look())
    assert given["now"] == at_rest()
    assert given["target"] == TargetLine(0.0, 10.0, ETA)


def test_what_was_refused_is_left_out_for_ten_seconds(
    search: LiftSearch, given: dict[str, Any]
) -> None:
    search.leans_rad = (1.6, 1.9)
    search.seek(look(2.0))
    assert search.state is not None
    there = TargetLine(3.0, 10.0, ETA)
    search.state = search.state._replace(target=there)
    search.stays(look(3.0), there)
    assert search.state.target == TargetLine(0.0, 10.0, ETA)  # the line is where it is
    for time_s, refused in ((3.0, (there,)), (12.9, (there,)), (13.1, ()), (3.5, ())):
        search.planned(look(time_s), search.state)
        assert given["leeway"] == (1.6, 1.9, refused)  # what is forgotten is forgotten


@pytest.mark.parametrize("time_s", [2.9, -50.0])
def test_a_clock_that_goes_back_forgets_what_was_refused(
    search: LiftSearch, given: dict[str, Any], time_s: float
) -> None:
    search.seek(look(2.0))
    search.stays(look(3.0), TargetLine(3.0, 10.0, ETA))
    assert search.state is not None
    search.planned(look(time_s), search.state)
    assert given["leeway"].refused == ()


def test_a_search_that_rests_restarts_with_the_same_map(
    search: LiftSearch, given: dict[str, Any]
) -> None:
    search.seek(look(2.0))
    search.stays(look(2.0), TargetLine(3.0, 10.0, ETA))
    known = search.map
    search.rest()
    assert (search.state, search.plan) == (None, None)
    search.seek(look(2.2))
    assert given["leeway"].refused == ()
    assert search.map is known


def test_no_plan_is_made_where_none_is_wanted(search: LiftSearch, given: dict[str, Any]) -> None:
    request = search.seek(look(), plans=False)
    assert given == {}
    assert request.place_x_m != request.place_x_m  # not known
    assert request.target == TargetLine(0.0, 10.0, ETA)


def test_before_a_wind_is_read_nothing_is_known() -> None:
    made = LiftSearch(POLAR)
    made.listen(look()._replace(reading=READING._replace(wind_mps=0.0)))
    for part in ("map", "grid"):
        with pytest.raises(ValueError, match="no wind was read yet"):
            getattr(made, part)

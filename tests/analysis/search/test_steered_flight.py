"""The loop that is looked at and steered: a second of it flown, what a look is made of, how the
line is moved, and what an episode comes to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from math import radians
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tgl_soar.analysis.search import steered_flight
from tgl_soar.analysis.search.episode import (
    SEARCHING,
    Episode,
    EpisodeFlight,
    flown_by,
    fly_episode,
    obeyed,
)
from tgl_soar.analysis.search.places import SearchPlace, place
from tgl_soar.analysis.search.steered_flight import COLUMN
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.parameters import PARAMETERS, ParameterError
from tgl_soar.control.search.glimpse import GIVEN_UP, LOOKING, NO_PLACE, SOARING, LineRequest
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.sim import compiled_flight
from tgl_soar.sim.flight import CRASHED, FLIES, HANDED_OVER
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK
from tgl_soar.types import NAN

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
HZ = 200
LOOKED_S = 0.2


@cache
def there() -> SearchPlace:
    return place("tunnel", 10_009)


@pytest.fixture(scope="module", autouse=True)
def plain_lists() -> Iterator[None]:
    """The delay lines of sensors as lists: those for compiled functions take long to compile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_flight, "_line", lambda nothing, length: [nothing] * length)
        yield


def new(duration_s: float, **given: Any) -> EpisodeFlight:
    parameters = given.pop("parameters", SEARCHING)
    at = given.pop("place", there())._replace(duration_s=duration_s)
    return EpisodeFlight(at, AIRFRAME, parameters, plain=True, **given)


@pytest.fixture(scope="module")
def flown() -> tuple[EpisodeFlight, list[Sighting | None], list[float]]:
    """0.9 s of it; from the third look on the line is 2 cm elsewhere."""
    flight = new(0.9)
    looks: list[Sighting | None] = []
    times: list[float] = []
    assert flight.time_s == 0.0
    while flight.flies:
        looks.append(flight.look())
        times.append(flight.time_s)
        if len(looks) == 3:
            x = float(np.float32(flight.values["TGL_X"] + 0.02))
            for _ in range(2):  # the second time it is there already
                flight.set({"TGL_X": x, "SRCH_START": 1.0})
    return flight, looks, times


Flown = tuple[EpisodeFlight, list[Sighting | None], list[float]]


# --- a second of it -------------------------------------------------------------------------------


def test_it_is_looked_at_each_fifth_of_a_second_and_at_the_end(flown: Flown) -> None:
    flight, looks, times = flown
    assert times == pytest.approx([0.2, 0.4, 0.6, 0.8, 0.9])
    assert looks[0] is None  # there was none before it
    assert all(look is not None for look in looks[1:])
    assert [look.dt_s for look in looks if look] == pytest.approx([0.2, 0.2, 0.2, 0.1])
    assert flight.rows.shape == (180, len(COLUMN))
    assert not flight.flies
    assert flight.used_s == 0.0


def test_a_look_is_the_mean_of_what_was_estimated_since_the_one_before(flown: Flown) -> None:
    flight, looks, _ = flown
    look = looks[2]
    assert look is not None
    since = flight.rows[80:120]
    assert look.reading.wind_mps == pytest.approx(since[:, COLUMN["air_wind_mps"]].mean())
    assert look.reading.updraft_mps == pytest.approx(since[:, COLUMN["air_updraft_mps"]].mean())
    last = flight.rows[119]
    # What the module knows of its place is a few hundredths of a second old.
    assert look.moving.x_m == pytest.approx(last[COLUMN["x_m"]], abs=0.05)
    assert look.moving.z_m == pytest.approx(last[COLUMN["z_m"]], abs=0.05)
    assert look.pitot
    assert not look.carried
    assert look.guards == flight.guards


def test_the_line_is_moved_between_two_looks_and_once(flown: Flown) -> None:
    flight, looks, _ = flown
    begin = there().site.parameters["TGL_X"]
    changes = flight.rows[:, COLUMN["target_changes"]]
    assert changes[:120].tolist() == [0.0] * 120
    assert changes[120:].tolist() == [1.0] * 60
    before, after = looks[2], looks[3]
    assert before is not None
    assert after is not None
    assert before.moving.line.x_m == pytest.approx(begin)
    assert flight.values["TGL_X"] == pytest.approx(begin + 0.02)
    assert after.moving.line.moving


def test_what_was_flown_is_reported_at_any_rate(flown: Flown) -> None:
    flight, _, _ = flown
    each, tenth = flight.trajectory(), flight.trajectory(20)
    assert len(each.columns["time_s"]) == 180
    assert tenth.columns["time_s"] == pytest.approx(0.1 * np.arange(9))
    assert tenth.columns["x_m"].tolist() == each.columns["x_m"][::20].tolist()
    assert list(each.columns) == list(COLUMN)
    assert (each.ended, each.ticks) == ("", 180)


def test_the_same_seed_is_the_same_flight_and_plain_is_what_flies_it(flown: Flown) -> None:
    again = new(0.3)
    first, second = again.look(), again.look()
    assert first is None
    assert second is not None
    np.testing.assert_array_equal(again.rows[:60], flown[0].rows[:60])
    other = new(0.1, place=there()._replace(seed=10_010))
    other.look()
    wind = COLUMN["wind_mps"]
    assert other.rows[10, wind] != again.rows[10, wind]


# --- what a look is made of, of flights that are made up ------------------------------------------


class Scripted:
    """Flies a script: at each look it is in control or not, and stands as it does."""

    def __init__(self, flight: EpisodeFlight, looks: list[Any]) -> None:
        self.looks = iter(looks)
        self.until: list[int] = []
        self.truth = flight.world.truth
        flight._fly = cast("Any", self.fly)

    def fly(
        self, _parts: Any, _laws: Any, _flight: Any, until: int, _changes: int, rows: Any
    ) -> Any:
        begin = self.until[-1] if self.until else 0
        self.until.append(until)
        scripted_now: dict[str, Any] = {
            "active": True, "standing": FLIES, "steps": until, "pushed_mps": 0.0, "throttle": 0.0,
            "climb": 0.0, **next(self.looks),
        }  # fmt: skip
        rows[begin : scripted_now["steps"]] = 0.0
        rows[begin : scripted_now["steps"], COLUMN["air_wind_mps"]] = 9.0
        rows[begin : scripted_now["steps"], COLUMN["throttle"]] = scripted_now["throttle"]
        truth = self.truth
        vehicle = SimpleNamespace(
            time_s=until / HZ,
            x_m=0.0,
            z_m=1.5,
            velocity_x_mps=0.25,
            climb_mps=scripted_now["climb"],
        )
        line = SimpleNamespace(
            x_m=0.0, z_m=1.5, eta_rad=2.0, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0
        )
        return SimpleNamespace(
            steps=scripted_now["steps"],
            standing=scripted_now["standing"],
            reason=0,
            aircraft=truth,
            active=scripted_now["active"],
            forecast=0,
            vehicle=vehicle,
            line=line,
            pushed_mps=scripted_now["pushed_mps"],
        )


def scripted(looks: list[Any], duration_s: float = 2.0) -> tuple[EpisodeFlight, list[Any]]:
    flight = new(duration_s)
    Scripted(flight, looks)
    found = []
    while flight.flies:
        found.append(flight.look())
    return flight, found


def test_a_look_needs_two_instants_in_control() -> None:
    off: dict[str, Any] = {"active": False}
    _, found = scripted([off, {}, {}, off, {}, {}, {}, {}, {}, {}])
    assert [look is not None for look in found] == [
        False, False, True, False, False, True, True, True, True, True,
    ]  # fmt: skip


@pytest.mark.parametrize("standing", [CRASHED, HANDED_OVER])
def test_a_flight_is_over_when_it_is_lost_or_handed_over(standing: int) -> None:
    flight, found = scripted([{}, {}, {"standing": standing, "steps": 101}])
    assert len(found) == 3
    assert flight.time_s == pytest.approx(101 / HZ)
    assert not flight.flies


def test_what_a_propeller_gave_is_the_mean_of_both_instants_and_no_lift() -> None:
    _, found = scripted([{}, {"pushed_mps": 0.6}, {"pushed_mps": 0.2}, *[{}] * 7])
    # It neither climbs nor speeds up: what is left of the climb is what the propeller did not give.
    energies = [look.reading.energy_mps for look in found[1:4]]
    assert energies == pytest.approx([-0.3, -0.4, -0.1])


def test_the_throttle_is_counted_in_seconds_of_full_throttle() -> None:
    flight, _ = scripted([{"throttle": 0.5}, {"throttle": 1.0}, *[{}] * 8])
    assert flight.used_s == pytest.approx(0.1 + 0.2)


def test_whether_the_throttle_can_carry_it_is_asked_of_its_budget_sink_and_airspeed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[Any, ...]] = []

    def can_hold(params: Any, used_s: float, excess_mps: float, airspeed_mps: float) -> bool:
        asked.append((params, used_s, excess_mps, airspeed_mps))
        return len(asked) == 2

    monkeypatch.setattr(steered_flight, "can_hold", can_hold)
    flight, found = scripted(
        [{"throttle": 0.5}, {"climb": -0.75}, {"climb": 0.5, "throttle": 0.25}, *[{}] * 7]
    )
    assert asked[0][1:] == pytest.approx((0.1, -0.75, 9.0 - 0.25))
    assert asked[1][1:] == pytest.approx((0.15, 0.0, 9.0 - 0.25))
    assert asked[0][0] == flight._throttle
    assert [look.carried for look in found[1:4]] == [False, True, False]


def test_a_parameter_that_is_already_so_is_no_change() -> None:
    flight = new(0.1)
    flight.set({"TGL_X": flight.values["TGL_X"], "SRCH_START": 1.0})
    assert flight._changes == 0
    laws = flight._laws
    flight.set({"SRCH_START": 2.0, "TGL_X": flight.values["TGL_X"]})
    assert flight._changes == 1
    assert flight.values["SRCH_START"] == 2.0
    assert flight._laws is not laws


def test_in_flight_no_parameter_may_be_set_that_waits_for_a_restart() -> None:
    flight = new(0.1)
    fixed = next(each for each in PARAMETERS if not each.in_flight)
    with pytest.raises(ParameterError, match="not while flying"):
        flight.set({fixed.name: 0.5 * (fixed.minimum + fixed.maximum)})


# --- the aircraft at a place ----------------------------------------------------------------------


def test_it_flies_with_the_drag_of_the_place_and_the_module_knows_its_file() -> None:
    for factor in (1.1, 0.9):
        flight = new(0.1, place=there()._replace(sink_factor=factor))
        truth: Any = flight.world.model
        assert factor * AIRFRAME.model["CD0"] == pytest.approx(truth.CD0)
        assert factor * AIRFRAME.model["CD_lift"] == pytest.approx(truth.CD_lift)
        assert flight.world.aerodynamics == AIRFRAME.aerodynamics()
    sensors = flight.world.sensors
    assert (sensors.imu, sensors.airspeed, sensors.surfaces) == (MEMS_IMU, PITOT, READ_BACK)
    assert flight.pitot
    assert flight.values["TGL_LEAN_MIN"] == -5.0
    assert flight.values["SRCH_START"] == 1.0
    assert flight.values["CLEAR_MIN"] == pytest.approx(0.3)
    assert flight.world.field is there().field


def test_without_a_pitot_a_flight_has_no_airspeed_sensor() -> None:
    flight = new(0.1, pitot=False)
    assert flight.world.sensors.airspeed is None
    assert not flight.pitot


def test_a_dispersed_aircraft_keeps_what_was_drawn_with_the_place() -> None:
    """Its drag, and the wind of the place: both are of the place, the rest is drawn."""
    plain, other = new(0.1), new(0.1, place=there()._replace(dispersed=True))
    a, b = cast("Any", plain.world.model), cast("Any", other.world.model)
    assert (b.CD0, b.CD_lift) == (a.CD0, a.CD_lift)
    assert b.ixx_kgm2 != a.ixx_kgm2
    at = (0.4, 0.0, 1.4, 0.0)
    assert other.world.field.wind_at(*at) == pytest.approx(plain.world.field.wind_at(*at))


# --- an episode -----------------------------------------------------------------------------------

HERE = TargetLine(0.1, 1.2, eta_from_lean(radians(15.0)))


def request(status: int, reason: int = 0) -> LineRequest:
    return LineRequest(
        target=HERE,
        status=status,
        reason=reason,
        place_x_m=NAN,
        place_z_m=NAN,
        over_ground_m=1.0,
    )


class Flies:
    """A flight that takes what is set."""

    def __init__(self, looks: int = 10) -> None:
        self.place, self.looks, self.left = there(), 0, looks
        self.guards = SimpleNamespace(landing_m=0.45)
        self.sets: list[dict[str, float]] = []

    @property
    def time_s(self) -> float:
        return LOOKED_S * self.looks

    @property
    def flies(self) -> bool:
        return self.looks < self.left

    def look(self) -> Any:
        self.looks += 1
        return None if self.looks == 1 else f"look {self.looks}"

    def set(self, wanted: dict[str, float]) -> None:
        self.sets.append(wanted)

    def ended(self, episode: Episode) -> Episode:
        return replace(episode, flown_s=self.time_s)


def begun(flight: Flies) -> Episode:
    return Episode(
        place=flight.place, searcher="x", ended="", given_up="", flown_s=0.0, path={}
    )  # fmt: skip


def test_a_line_is_moved_as_it_is_requested_and_the_claim_is_reported_in_mode() -> None:
    flight: Any = Flies()
    episode = begun(flight)
    for standing, status in ((1.0, LOOKING), (2.0, SOARING)):
        assert obeyed(flight, episode, request(status))
        assert flight.sets[-1] == pytest.approx(
            {"TGL_X": 0.1, "TGL_Z": 1.2, "TGL_LEAN": 15.0, "SRCH_START": standing}
        )


def test_claims_are_kept_where_they_change() -> None:
    flight: Any = Flies()
    episode = begun(flight)
    for status in (LOOKING, LOOKING, SOARING, SOARING, LOOKING, SOARING):
        flight.looks += 1
        assert obeyed(flight, episode, request(status))
    assert [claim for _, claim in episode.claims] == [True, False, True]
    assert [time_s for time_s, _ in episode.claims] == pytest.approx([0.6, 1.0, 1.2])


def test_a_search_that_gives_up_moves_nothing_more_and_withdraws_its_claim() -> None:
    flight: Any = Flies()
    episode = begun(flight)
    assert obeyed(flight, episode, request(SOARING))
    flight.looks += 1
    assert not obeyed(flight, episode, request(GIVEN_UP, NO_PLACE))
    assert episode.given_up == "no line soars in any wind that fits the readings"
    assert episode.claims == [(0.0, True), (LOOKED_S, False)]
    assert len(flight.sets) == 1


@pytest.mark.parametrize(("gives_up_at", "looks"), [(0, 10), (6, 6)])
def test_a_searcher_is_made_of_the_first_look_that_shows_something(
    gives_up_at: int, looks: int
) -> None:
    flight = Flies()
    made: list[Any] = []
    looks_given: list[Any] = []

    class Searcher:
        def look(self, look: Any) -> LineRequest:
            looks_given.append(look)
            over = flight.looks == gives_up_at
            return request(GIVEN_UP if over else LOOKING, NO_PLACE if over else 0)

    def maker(look: Any) -> Searcher:
        made.append(look)
        return Searcher()

    episode = flown_by(cast("Any", flight), "who", maker)
    assert made == ["look 2"]
    assert looks_given == [f"look {n}" for n in range(2, looks + 1)]
    assert (episode.searcher, episode.landing_m) == ("who", 0.45)
    assert episode.place is flight.place
    assert episode.flown_s == pytest.approx(LOOKED_S * looks)
    assert bool(episode.given_up) is bool(gives_up_at)
    assert (episode.claims, episode.height_left_m, episode.ended) == ([], 0.0, "")


def test_an_episode_is_looked_at_ten_times_a_second_with_the_height_that_is_left() -> None:
    looks: list[Sighting] = []

    class Stays:
        def look(self, look: Sighting) -> LineRequest:
            looks.append(look)
            return request(LOOKING)._replace(target=TargetLine(*look.moving.line[:3]))

    short = there()._replace(duration_s=0.5)
    episode = fly_episode(short, AIRFRAME, "who", lambda _look: Stays(), pitot=False, plain=True)
    assert [look.time_s for look in looks] == pytest.approx([0.4, 0.5])
    assert not looks[0].pitot
    assert (episode.ended, episode.flown_s, episode.given_up) == ("", 0.5, "")
    assert episode.path["time_s"] == pytest.approx(0.1 * np.arange(5))
    assert episode.landing_m == pytest.approx(0.45)  # one and a half of CLEAR_MIN
    # Upstream of the board the ground is level, and it sinks by centimetres in a tenth of a second.
    start: Any = short.site.start
    assert start.x_m < 0.0
    assert episode.height_left_m == pytest.approx(episode.path["z_m"][-1], abs=0.15)
    assert episode.height_left_m < episode.path["z_m"][-1] < start.z_m


def test_over_the_board_the_height_left_is_over_the_board() -> None:
    flight, _ = scripted([{}], 0.1)
    assert flight.now is not None
    truth = flight.now.aircraft._replace(x_m=1.0, z_m=1.6)
    flight.now = cast("Any", SimpleNamespace(**{**vars(flight.now), "aircraft": truth}))
    profile: Any = there().site.ground
    (_, _), (x0, z0), (x1, z1) = profile.profile
    episode = flight.ended(begun(Flies()))
    assert episode.height_left_m == pytest.approx(1.6 - z0 - (z1 - z0) / (x1 - x0) * (1.0 - x0))

"""One episode of a search: a flight at a random place, and what moves its line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.experiments.random_aircraft import flown_world
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.analysis.search.steered_flight import SteeredFlight
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_parameters
from tgl_soar.control.laws import SEARCH_LOOKS, SEARCH_SOARS
from tgl_soar.control.search.glimpse import LineRequest
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.control.search.rollout import floor_at
from tgl_soar.onboard.line_moves import line_parameters_of
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors

# Of a place: drawn with it, and known to no file.
ALREADY: Final = ("drag", "wind", "slope_rad", "edge_m", "shear_per_m")
# SAOS's upright line; and whoever searches flies in mode searching.
SEARCHING: Final = {"TGL_LEAN_MIN": -5.0, "SRCH_START": float(SEARCH_LOOKS)}


class Searcher(Protocol):
    """What moves the line."""

    def look(self, look: Sighting) -> LineRequest:
        """Called every `LOOK_S`."""


@dataclass
class Episode:
    """What came of it."""

    place: SearchPlace
    searcher: str
    ended: str  # why it ended early; "" if it flew to the end or was given up
    given_up: str  # the reason; ""
    flown_s: float
    path: dict[str, FloatArray]  # columns of `Row`, 10 a second
    claims: list[tuple[float, bool]] = field(default_factory=list)  # changes of the claim
    height_left_m: float = 0.0  # over the ground at the end
    landing_m: float = 0.0


class EpisodeFlight(SteeredFlight):
    """The module's closed loop at a place, looked at every `LOOK_S`."""

    def __init__(
        self,
        place: SearchPlace,
        airframe: Airframe,
        parameters: dict[str, float],
        *,
        pitot: bool = True,
        plain: bool = False,
    ) -> None:
        """parameters: beside those of the site; plain: as of `SteeredFlight`.

        Errors: `ConfigError`; ImportError without numba.
        """
        self.place = place
        factor = place.sink_factor
        drag = [(f"model.{key}", airframe.model[key] * factor) for key in ("CD0", "CD_lift")]
        world = flown_world(
            airframe,
            place.site,
            place.seed,
            dispersed=place.dispersed,
            flies=flown_airframe(airframe, drag),
            already=ALREADY,
            field=place.field,
            sensors=Sensors(imu=MEMS_IMU, airspeed=PITOT if pitot else None, surfaces=READ_BACK),
        )
        name = place.site.site.name
        values = load_parameters(airframe, name, place.site, name).changed(parameters)
        polar = airframe.polar.as_polar()
        super().__init__(world, values, polar, place.duration_s, place.seed, plain=plain)

    def ended(self, episode: Episode) -> Episode:
        """The episode with what the flight came to."""
        now, place = self.now, self.place
        assert now is not None
        flown = self.trajectory(self.world.step_hz // 10)
        episode.ended = flown.ended
        episode.flown_s = self.time_s
        episode.path = {name: column.copy() for name, column in flown.columns.items()}
        floor_m = float(floor_at(place.ground, now.aircraft.x_m, place.box.z_min_m))
        episode.height_left_m = now.aircraft.z_m - floor_m
        return episode


def fly_episode(
    place: SearchPlace,
    airframe: Airframe,
    name: str,
    searcher: Callable[[Sighting], Searcher],
    *,
    pitot: bool = True,
    plain: bool = False,
) -> Episode:
    """Fly one episode; searcher: as of `flown_by`.

    pitot, plain, errors: as of `EpisodeFlight`.
    """
    flight = EpisodeFlight(place, airframe, SEARCHING, pitot=pitot, plain=plain)
    return flown_by(flight, name, searcher)


def flown_by(flight: EpisodeFlight, name: str, searcher: Callable[[Sighting], Searcher]) -> Episode:
    """Fly an episode to its end; the searcher is made of the first look."""
    episode = Episode(
        place=flight.place,
        searcher=name,
        ended="",
        given_up="",
        flown_s=0.0,
        path={},
        landing_m=flight.guards.landing_m,
    )
    search: Searcher | None = None
    while flight.flies:
        look = flight.look()
        if look is None:
            continue
        if search is None:
            search = searcher(look)
        if not obeyed(flight, episode, search.look(look)):
            break
    return flight.ended(episode)


def obeyed(flight: EpisodeFlight, episode: Episode, request: LineRequest) -> bool:
    """Move the line as it is requested; whether the search goes on."""
    claimed = bool(episode.claims) and episode.claims[-1][1]
    if request.soaring != claimed:
        episode.claims.append((flight.time_s, request.soaring))
    if request.given_up:
        episode.given_up = request.given_up
        return False
    standing = SEARCH_SOARS if request.soaring else SEARCH_LOOKS
    flight.set(line_parameters_of(request.target) | {"SRCH_START": float(standing)})
    return True

"""The preview in made-up air, whose slide along a line has a formula: places, times and words."""

from __future__ import annotations

from functools import cache
from math import cos, hypot, isnan, log, radians, sin
from typing import Any

import pytest
from page_flight import AIRFRAME, SITE

from tgl_soar.cli.page.settling_preview import Foresight, GhostLine, GhostStart, _thin
from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.types import GlidePolar

UPRIGHT = GhostLine(0.0, 1.0, 0.0)
SINK = GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=5.0, speed_max_mps=15.0)


@cache
def values() -> ParameterSet:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    return load_parameters(airframe, AIRFRAME, site, SITE)


class MadeUpAir:
    """A level wind of 8 m/s, with an excess updraft that falls by so much for each metre up."""

    reference_wind_mps = 8.0

    def __init__(self, per_s: float, zero_m: float = 2.0, top_m: float = 99.0) -> None:
        self._per_s, self._zero_m, self._top_m = per_s, zero_m, top_m

    def wind_at(self, _x: float, _y: float, z_m: float, _t: float) -> tuple[float, float, float]:
        return 8.0, 0.0, 1.0 + self._per_s * (self._zero_m - z_m)

    def inside(self, _x: float, _y: float, z_m: float) -> bool:
        return z_m < self._top_m


def foresight(air: Any, polar: GlidePolar = SINK, contour: Any = ()) -> Foresight:
    return Foresight((), contour, LineBounds(), None if air is None else (air, polar))


def ghost_of(air: Any, line: GhostLine, start: GhostStart, polar: GlidePolar = SINK) -> Any:
    return foresight(air, polar).ghost(values(), line, start, flying=start.line is not None)


def test_up_an_upright_line_the_aircraft_comes_to_rest_exponentially() -> None:
    """dz/dt = k (z0 - z) from 1 m below: within 0.1 m after ln(10) / k, and slower than 3 mm/s
    after ln(k / 0.003) / k; steps of 0.1 s make k of it -ln(1 - 0.1 k) / 0.1."""
    k = 0.5
    ghost = ghost_of(MadeUpAir(k), UPRIGHT, GhostStart(0.0, 1.0, UPRIGHT))
    rate = -log(1.0 - 0.1 * k) / 0.1
    assert ghost.words == ""
    assert ghost.place[0] == pytest.approx(0.0, abs=1e-9)
    assert 0.003 * 0.5 < (2.0 - ghost.place[1]) * k < 0.003
    within_s = log(1.0 / (2.0 - ghost.place[1] + 0.1)) / rate
    assert ghost.settles_s == pytest.approx(within_s, abs=0.1)
    assert ghost.path[0] == (0.0, 1.0)
    assert ghost.path[-1] == ghost.place


def test_an_aircraft_that_is_there_has_settled() -> None:
    ghost = ghost_of(MadeUpAir(0.5), UPRIGHT, GhostStart(0.0, 1.95, UPRIGHT))
    assert ghost.settles_s == 0.0
    assert ghost.place[1] == pytest.approx(2.0, abs=0.01)


def test_from_above_it_sinks_there() -> None:
    ghost = ghost_of(MadeUpAir(0.5), UPRIGHT, GhostStart(0.0, 3.0, UPRIGHT))
    assert ghost.place[1] == pytest.approx(2.0, abs=0.01)
    assert ghost.place[1] > 2.0


@pytest.mark.parametrize("slope", [0.0, 0.2, -0.3])
def test_on_a_leaning_line_it_slides_by_the_polars_slope(slope: float) -> None:
    """s' (sin eta - S' cos eta) = E."""
    polar = SINK._replace(c0=1.0 - 8.0 * slope, c1=slope)  # sinks 1 m/s at 8 m/s
    eta = radians(90.0 + 20.0)
    line = GhostLine(0.0, 1.0, 20.0)
    start = GhostStart(0.0, 1.0, line)
    (x0, z0), (x1, z1), *_ = foresight(MadeUpAir(0.05), polar)._way(values(), line, start)
    assert hypot(x1 - x0, z1 - z0) / 0.1 == pytest.approx(
        0.05 * (2.0 - 1.0) / (sin(eta) - slope * cos(eta)), rel=1e-6
    )
    assert z1 > z0
    assert x1 < x0  # upwind, up the line
    assert (x1 - x0) / (z1 - z0) == pytest.approx(cos(eta) / sin(eta), rel=1e-6)


def test_while_the_line_moves_the_aircraft_is_held_across_it() -> None:
    """1.2 m downstream at TGL_SLEW, begun and ended at TGL_ACCEL; no excess updraft anywhere."""
    slew, accel = values()["TGL_SLEW"], values()["TGL_ACCEL"]
    there = UPRIGHT._replace(x_m=1.2)
    ghost = ghost_of(MadeUpAir(0.0), there, GhostStart(0.0, 1.0, UPRIGHT))
    assert ghost.place == pytest.approx((1.2, 1.0), abs=1e-6)
    # The last 0.1 m are braked at a: v dv = a dx.
    assert ghost.settles_s == pytest.approx(
        1.2 / slew + slew / accel - (2.0 * 0.1 / accel) ** 0.5, abs=0.25
    )


def test_not_engaged_it_starts_on_the_line_at_the_aircraft() -> None:
    """Where it is engaged, a line of the wanted lean is put through the aircraft first."""
    ghost = ghost_of(MadeUpAir(0.0), UPRIGHT, GhostStart(-0.9, 1.4, None))
    assert ghost.path[0] == (-0.9, 1.4)
    assert ghost.place == pytest.approx((0.0, 1.4), abs=1e-6)


def test_a_line_turns_at_its_rate() -> None:
    rate_degps = values()["TGL_ROT_SLEW"]
    leaning = UPRIGHT._replace(lean_deg=30.0)
    ghost = ghost_of(MadeUpAir(0.0, 1.0), leaning, GhostStart(0.0, 1.0, UPRIGHT))
    assert ghost.words == ""
    assert ghost.place == pytest.approx((0.0, 1.0), abs=1e-6)
    steps = len(ghost.path) - 1  # the end stands twice
    assert steps * 0.1 == pytest.approx(30.0 / rate_degps, abs=0.35)


def test_an_aircraft_that_slides_on_for_two_minutes_has_no_place() -> None:
    class Rising(MadeUpAir):
        def wind_at(self, _x: float, _y: float, _z: float, _t: float) -> tuple[float, ...]:  # type: ignore[override]
            return 8.0, 0.0, 1.004

    ghost = ghost_of(Rising(0.0), UPRIGHT, GhostStart(0.0, 1.0, UPRIGHT))
    assert (ghost.place, ghost.settles_s) == (None, None)
    assert ghost.words == "the aircraft is still sliding after 120 s"
    assert ghost.path[-1][1] == pytest.approx(1.0 + 0.004 * 120.0, abs=0.001)
    assert len(ghost.path) <= 62


def test_slower_than_three_millimetres_a_second_is_at_rest() -> None:
    class Hardly(MadeUpAir):
        def wind_at(self, _x: float, _y: float, _z: float, _t: float) -> tuple[float, ...]:  # type: ignore[override]
            return 8.0, 0.0, 1.002

    ghost = ghost_of(Hardly(0.0), UPRIGHT, GhostStart(0.0, 1.0, UPRIGHT))
    assert ghost.words == ""
    assert ghost.place == pytest.approx((0.0, 1.0), abs=0.01)


def test_out_of_the_known_air_there_is_no_place_but_the_way_there() -> None:
    ghost = ghost_of(MadeUpAir(0.5, top_m=1.5), UPRIGHT, GhostStart(0.0, 1.0, UPRIGHT))
    assert (ghost.place, ghost.settles_s) == (None, None)
    assert ghost.words == "the aircraft would leave the air that is known"
    assert all(not isnan(x + z) for x, z in ghost.path)
    assert ghost.path[-1][1] >= 1.5  # where it was last, just out of it
    assert ghost.path[-2][1] < 1.5


@pytest.mark.parametrize("place", [(float("nan"), 1.0), (0.0, float("nan"))])
def test_an_unknown_place_has_no_time(place: tuple[float, float]) -> None:
    ghost = ghost_of(MadeUpAir(0.5), UPRIGHT, GhostStart(*place, UPRIGHT))
    assert ghost.words == "where the aircraft is now is not known"
    assert (ghost.settles_s, ghost.path) == (None, ())


def test_of_a_contours_crossings_the_nearest_where_it_settles_counts() -> None:
    """Rising air is on a part's left: below a part that runs upstream, above one that runs
    downstream.  Going up the line excess updraft falls at the first kind only."""
    contour = (
        ((9.0, 4.0), (-9.0, 4.0)),
        ((9.0, 1.5), (-9.0, 1.5)),
        ((-9.0, 1.1), (9.0, 1.1)),
    )
    blind = foresight(None, contour=contour)
    ghost = blind.ghost(values(), UPRIGHT, GhostStart(0.0, 1.0, UPRIGHT), flying=True)
    assert ghost.place == pytest.approx((0.0, 1.5))
    assert ghost.words == "without a model of the air the time is not known"
    assert (ghost.settles_s, ghost.path) == (None, ())
    leaning = (((19.0, 1.5), (7.0, 1.5)), ((14.0, 2.4), (11.0, 3.4)))
    aside = foresight(None, contour=leaning)
    line = GhostLine(12.0, 1.0, 0.0)
    ghost = aside.ghost(values(), line, GhostStart(0.0, 1.0, None), flying=False)
    assert ghost.place == pytest.approx((12.0, 1.5))
    nowhere = foresight(None).ghost(values(), UPRIGHT, GhostStart(0.0, 1.0, None), flying=False)
    assert nowhere.place is None


def test_a_line_as_it_goes_over_the_wire_is_shown() -> None:
    ghost = ghost_of(None, GhostLine(0.1, 1.1, 15.0), GhostStart(0.0, 1.0, None))
    assert ghost.line.x_m == 0.100000001490116119384765625
    assert ghost.line.x_m != 0.1


def test_a_staged_move_of_another_station_is_not_in_the_previews_way() -> None:
    staging = values().changed({"TGL_STAGE": 1.0})
    line = GhostLine(0.6, 1.6, 15.0)
    preview = foresight(None)
    for flying in (False, True):
        assert preview.verdict(staging, line, flying=flying) == ("", "")


def test_a_line_far_from_the_one_that_stands_is_refused_in_flight_only() -> None:
    far = values()["TGL_STEP_MAX"] + 0.1
    line = GhostLine(values()["TGL_X"] + far, values()["TGL_Z"], 15.0)
    near = line._replace(x_m=line.x_m - 0.2)
    preview = foresight(None)
    wide = values().changed({"FENCE_X_MAX": 50.0})
    assert "TGL_STEP_MAX" in preview.verdict(wide, line, flying=True)[0]
    assert preview.verdict(wide, near, flying=True)[0] == ""
    assert preview.verdict(wide, line, flying=False)[0] == ""


@pytest.mark.parametrize(("count", "kept"), [
    (1, 2), (60, 61), (119, 120), (120, 61), (600, 61), (1201, 62),
])  # fmt: skip
def test_a_path_is_thinned_to_about_sixty_points_and_its_end(count: int, kept: int) -> None:
    path = tuple((float(i), 0.0) for i in range(count))
    thin = _thin(path)
    assert len(thin) == kept
    assert (thin[0], thin[-1]) == (path[0], path[-1])

"""The survey look by look: its means, what bars a way, and where the line is sent."""

from __future__ import annotations

from math import cos, inf, nan, pi, radians, sin, sqrt
from typing import Any

import pytest

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control import survey as v
from tgl_soar.control.envelope import MARGIN_FULL, Fence
from tgl_soar.control.forecast import NO_FORECAST, SETTLES
from tgl_soar.control.laws import laws_from
from tgl_soar.control.survey import (
    SurveyLook,
    SurveyState,
    SurveyTask,
    survey_begun,
    survey_moved,
    survey_step,
    survey_task,
)
from tgl_soar.control.target_line import LineTracking, TargetLine
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import NO_GROUND, Ground

ETA = pi / 2.0 + radians(20.0)
SPEED = 0.05
TASK = SurveyTask(
    fence=Fence(x_min_m=-20.0, x_max_m=20.0, y_max_m=5.0, z_min_m=-20.0, z_max_m=20.0),
    ground=NO_GROUND,
    clearance_min_m=0.4,
    speed_mps=SPEED,
    reach_m=3.0,
    slowest_mps=8.0,
    fastest_mps=12.0,
    off_max_m=0.5,
)
START = TargetLine(1.0, 2.0, ETA)
MEAN_S, TREND_S, AHEAD_S = 3.0, 10.0, 4.0


def place(q_m: float, s_m: float) -> tuple[float, float]:
    """q across the line, upstream and up; s up along it."""
    return 1.0 - q_m * sin(ETA) + s_m * cos(ETA), 2.0 + q_m * cos(ETA) + s_m * sin(ETA)


def look(time_s: float, q_m: float = 0.0, s_m: float = 0.3, **changes: Any) -> SurveyLook:
    """The line at q, the aircraft on it at s; lambda 1.5 per second."""
    x, z = place(q_m, 0.0)
    own_x, own_z = place(q_m, s_m)
    usual = SurveyLook(
        time_s=time_s,
        x_m=own_x,
        z_m=own_z,
        climb_mps=0.0,
        airspeed_mps=9.5,
        stall_rad=0.2,
        line=LineTracking(x_m=x, z_m=z, eta_rad=ETA, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0),
        forecast=NO_FORECAST._replace(standing=SETTLES, chance=0.9, slope_per_s=-1.5 * sin(ETA)),
        held=True,
    )
    return usual._replace(**changes)


def begun() -> SurveyState:
    return survey_begun(look(100.0))


def test_it_begins_downstream_at_rest_with_nothing_odd() -> None:
    state = begun()
    assert (state.standing, state.reason, state.odd_s) == (v.DOWNSTREAM, v.NO_REASON, 0.0)
    assert (state.since_s, state.time_s) == (100.0, 100.0)
    assert state.start == state.target == START
    means = state.means
    assert (means.q_m, means.q_long_m, means.slope, means.drift_m2) == (0.0,) * 4
    assert (means.climb_mps, means.climb_long_mps) == (0.0, 0.0)
    assert means.s_m == means.s_long_m == pytest.approx(0.3)
    assert (means.airspeed_mps, means.stall_rad, means.chance) == (9.5, 0.2, 0.9)
    assert means.return_per_s == pytest.approx(1.5)


@pytest.mark.parametrize(("passed_s", "dt"), [(0.2, 0.2), (5.0, 1.0), (-1.0, 0.0)])
def test_the_means_are_over_three_and_ten_seconds(passed_s: float, dt: float) -> None:
    """A look that is late counts a second at the most."""
    look_now = look(
        100.0 + passed_s, q_m=0.06, s_m=0.5, climb_mps=0.1, airspeed_mps=9.0, stall_rad=0.1
    )
    old, new = begun().means, survey_step(TASK, begun(), look_now).means
    short, long = dt / (MEAN_S + dt), dt / (TREND_S + dt)
    assert new.q_m == pytest.approx(short * 0.06)
    assert new.s_m == pytest.approx(0.3 + short * 0.2)
    assert new.airspeed_mps == pytest.approx(9.5 - short * 0.5)
    assert new.stall_rad == pytest.approx(0.2 - short * 0.1)
    assert new.climb_mps == pytest.approx(short * 0.1)
    assert new.climb_long_mps == pytest.approx(long * 0.1)
    assert new.q_long_m == pytest.approx(long * 0.06)
    assert new.s_long_m == pytest.approx(0.3 + long * 0.2)
    assert new.drift_m2 == pytest.approx(long * (0.5 - new.s_m) ** 2)
    assert new.return_per_s == pytest.approx(old.return_per_s)


def test_what_is_not_known_leaves_the_means_or_begins_them() -> None:
    look_now = look(100.2, airspeed_mps=nan, stall_rad=inf)
    found = survey_step(TASK, begun(), look_now).means
    assert (found.airspeed_mps, found.stall_rad) == (9.5, 0.2)
    unknown = survey_begun(look(100.0, airspeed_mps=nan, stall_rad=inf))
    found = survey_step(TASK, unknown, look(100.2)).means
    assert (found.airspeed_mps, found.stall_rad) == (9.5, 0.2)


def test_the_contour_s_slope_is_read_while_the_line_is_under_way() -> None:
    """s over q, of what the short mean is ahead of the long one; 3 at the most."""
    means = begun().means._replace(q_m=-0.5, s_m=0.6, q_long_m=-0.2, s_long_m=0.45)
    state = begun()._replace(means=means)
    found = survey_step(TASK, state, look(100.2, q_m=-0.55, s_m=0.6)).means
    assert found.slope == pytest.approx((found.s_m - found.s_long_m) / (found.q_m - found.q_long_m))
    steep = state._replace(means=means._replace(s_m=9.0))
    assert survey_step(TASK, steep, look(100.2, q_m=-0.55, s_m=9.0)).means.slope == -3.0
    # About a turn both are at the same place, and nothing is read.
    turning = state._replace(means=means._replace(q_m=-0.5, q_long_m=-0.49, slope=0.7))
    assert survey_step(TASK, turning, look(100.2, q_m=-0.55)).means.slope == 0.7


def under_way(
    standing: int = v.DOWNSTREAM, q_m: float = -0.5, **means: float
) -> tuple[SurveyState, SurveyLook]:
    """A state and a look in which the survey goes on, with all means at rest."""
    rest = begun().means._replace(q_m=q_m, q_long_m=q_m, s_m=0.3, s_long_m=0.3, **means)
    target = TargetLine(*place(q_m, 0.3), ETA)
    state = begun()._replace(standing=standing, means=rest, target=target)
    return state, look(110.0, q_m=q_m)


@pytest.mark.parametrize(("standing", "sign"), [(v.DOWNSTREAM, -1.0), (v.UPSTREAM, 1.0)])
def test_the_line_is_sent_four_seconds_ahead_along_the_contour(standing: int, sign: float) -> None:
    state, look_now = under_way(standing, sign * 0.5, slope=0.4)
    found = survey_step(TASK, state, look_now)
    there = sign * (0.5 + AHEAD_S * SPEED)
    s_m = found.means.s_m + 0.4 * (there - found.means.q_m)
    assert found.target == pytest.approx((*place(there, s_m), ETA))
    # While half of that is still ahead it is left as it is.
    near = TargetLine(*place(sign * (0.5 + 0.55 * AHEAD_S * SPEED), 0.3), ETA)
    assert survey_step(TASK, state._replace(target=near), look_now).target == near
    nearer = TargetLine(*place(sign * (0.5 + 0.45 * AHEAD_S * SPEED), 0.3), ETA)
    assert survey_step(TASK, state._replace(target=nearer), look_now).target == found.target


def test_after_a_turn_it_rests_for_five_seconds() -> None:
    state, look_now = under_way()
    for rested_s, goes in ((4.9, False), (5.1, True)):
        found = survey_step(TASK, state._replace(since_s=look_now.time_s - rested_s), look_now)
        assert (found.target != state.target) == goes


@pytest.mark.parametrize(
    ("task", "means", "q_m", "reason"),
    [
        ({}, {}, -0.5, v.NO_REASON),
        ({}, {}, -2.75, v.NO_REASON),
        ({}, {}, -2.85, v.REACHED),  # with the four seconds ahead beyond SRV_REACH
        ({}, {"airspeed_mps": 7.9}, -0.5, v.SLOW),
        ({}, {"airspeed_mps": 8.1}, -0.5, v.NO_REASON),
        ({}, {"airspeed_mps": 12.1}, -0.5, v.FAST),
        ({}, {"airspeed_mps": 11.9}, -0.5, v.NO_REASON),
        ({}, {"stall_rad": 0.49 * MARGIN_FULL}, -0.5, v.NEAR_STALL),
        ({}, {"stall_rad": 0.53 * MARGIN_FULL}, -0.5, v.NO_REASON),
        ({}, {"return_per_s": 0.22}, -0.5, v.WEAK),  # half of CLEAR_MIN at this lambda: 0.044
        ({}, {"return_per_s": 0.27}, -0.5, v.NO_REASON),
        ({}, {"chance": 0.45}, -0.5, v.UNLIKELY),
        ({}, {"chance": 0.53}, -0.5, v.NO_REASON),
        ({"speed_mps": 0.32}, {}, -0.5, v.WEAK),
    ],
)
def test_what_bars_a_way(
    task: dict[str, Any], means: dict[str, float], q_m: float, reason: int
) -> None:
    state, look_now = under_way(v.DOWNSTREAM, q_m, **means)
    found = survey_step(TASK._replace(**task), state, _as_the_means(look_now, means))
    assert found.reason == reason
    assert found.standing == (v.DOWNSTREAM if reason == v.NO_REASON else v.UPSTREAM)
    if reason != v.NO_REASON:
        assert found.target == pytest.approx((*place(q_m, 0.0), ETA))  # where the line is
        assert found.since_s == look_now.time_s


def _as_the_means(look_now: SurveyLook, means: dict[str, float]) -> SurveyLook:
    """The same as has been, so that the means stay."""
    known: dict[str, Any] = {k: means[k] for k in ("airspeed_mps", "stall_rad") if k in means}
    forecast = look_now.forecast
    if "chance" in means:
        forecast = forecast._replace(chance=means["chance"])
    if "return_per_s" in means:
        forecast = forecast._replace(slope_per_s=-means["return_per_s"] * sin(ETA))
    return look_now._replace(forecast=forecast, **known)


@pytest.mark.parametrize("drift_m", [0.0, 0.1])
@pytest.mark.parametrize("edge", ["x_min_m", "x_max_m", "z_min_m", "z_max_m"])
def test_the_fence_is_kept_by_half_the_clearance_or_four_sigma_of_the_drift(
    drift_m: float, edge: str
) -> None:
    """A mean over 3 s has followed what lasts for 1 / lambda: so much is put back."""
    state, look_now = under_way(v.DOWNSTREAM, -0.5, drift_m2=drift_m**2)
    q_m = -0.5 - AHEAD_S * SPEED
    variance = survey_step(TASK, state, look_now).means.drift_m2
    room = max(0.2, 4.0 * sqrt(variance * (1.0 + 1.0 / (1.5 * MEAN_S))))
    x, z = place(q_m, 0.3)
    side = -1.0 if edge.endswith("min_m") else 1.0
    at = x if edge.startswith("x") else z
    for off_m, reason in ((0.01, v.NO_REASON), (-0.01, v.AT_FENCE)):
        fence = TASK.fence._replace(**{edge: at + side * (room + off_m)})
        found = survey_step(TASK._replace(fence=fence), state, look_now)
        assert found.reason == reason
    for off_m, reason in ((0.01, v.NO_REASON), (-0.01, v.AT_GROUND)):
        level = z - 0.4 - room - off_m
        ground = Ground(1, (0.0,) * 8, (level,) * 8)
        assert survey_step(TASK._replace(ground=ground), state, look_now).reason == reason


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("climb", "means", "reason"),
    [
        (0.0, {"climb_mps": 0.31}, v.DRIFTS),
        (0.0, {"climb_mps": 0.29}, v.NO_REASON),
        (0.0, {"climb_long_mps": 0.155}, v.DRIFTS),
        (0.0, {"climb_long_mps": 0.145}, v.NO_REASON),
    ],
)
def test_what_climbs_or_sinks_in_the_mean_is_no_slide(
    sign: float, climb: float, means: dict[str, float], reason: int
) -> None:
    signed = {name: sign * size for name, size in means.items()}
    state, look_now = under_way(v.DOWNSTREAM, -0.5, **signed)
    found = survey_step(
        TASK, state, look_now._replace(climb_mps=sign * max(means.values()) + climb)
    )
    assert found.reason == reason
    assert found.standing == (v.HOMEWARD if reason else v.DOWNSTREAM)
    for e_rho, off in ((0.49, False), (0.51, True)):
        state, look_now = under_way()
        line = look_now.line._replace(e_rho_m=sign * e_rho)
        found = survey_step(TASK, state, look_now._replace(line=line))
        assert (found.reason == v.OFF_LINE) == off
        assert found.odd_s == 0.0


def homeward(q_m: float, **changes: Any) -> SurveyState:
    state, _ = under_way(v.HOMEWARD, q_m)
    return state._replace(reason=v.AT_FENCE, **changes)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_homeward_it_goes_back_to_where_it_began_from_either_side(sign: float) -> None:
    look_now = look(110.0, q_m=sign * 0.5)
    found = survey_step(TASK, homeward(sign * 0.5), look_now)
    there = sign * (0.5 - AHEAD_S * SPEED)
    assert found.target == pytest.approx((*place(there, found.means.s_m), ETA), abs=1e-9)
    near = look(110.0, q_m=sign * 0.19)
    assert survey_step(TASK, homeward(sign * 0.19), near).target == START
    # Only there it is done, and only at rest.
    away = survey_step(TASK, homeward(sign * 0.01), look(110.0, q_m=sign * 0.01))
    assert away.standing == v.HOMEWARD
    there_ = look(110.0, q_m=sign * 5e-5)
    assert survey_step(TASK, homeward(0.0), there_).standing == v.DONE
    moving = there_._replace(line=there_.line._replace(moving=True))
    assert survey_step(TASK, homeward(0.0), moving).standing == v.HOMEWARD


def test_homeward_something_odd_for_ten_seconds_ends_it_where_it_is() -> None:
    look_now = look(110.2, q_m=0.5)
    odd = look_now._replace(line=look_now.line._replace(e_rho_m=0.6))
    for odd_s, standing in ((9.7, v.HOMEWARD), (9.9, v.STOPPED)):
        state = homeward(0.5, odd_s=odd_s, time_s=110.0)
        found = survey_step(TASK, state, odd)
        assert found.standing == standing
        assert found.odd_s == pytest.approx(odd_s + 0.2)
        assert survey_step(TASK, state, look_now).odd_s == 0.0
    assert found.reason == v.OFF_LINE
    assert found.target == pytest.approx((*place(0.5, 0.0), ETA))


def test_homeward_it_rests_first_unless_it_was_cut_short() -> None:
    state, look_now = homeward(0.5, since_s=106.0), look(110.0, q_m=0.5)
    assert survey_step(TASK, state, look_now).target == state.target
    for reason in (v.DRIFTS, v.OFF_LINE, v.NOT_HELD):
        cut = state._replace(reason=reason)
        assert survey_step(TASK, cut, look_now).target != state.target
        assert v.is_cut_short(cut)
    assert not v.is_cut_short(state)


@pytest.mark.parametrize("name", ["x_m", "z_m", "climb_mps"])
def test_what_is_not_known_ends_it_with_the_line_where_it_is(name: str) -> None:
    state, look_now = under_way()
    unknown: dict[str, Any] = {name: nan}
    found = survey_step(TASK, state, look_now._replace(**unknown))
    assert (found.standing, found.reason) == (v.STOPPED, v.NOT_HELD)
    assert found.target == pytest.approx((*place(-0.5, 0.0), ETA))
    lost = survey_step(TASK, state, look_now._replace(line=look_now.line._replace(x_m=nan)))
    assert (lost.standing, lost.target) == (v.STOPPED, state.target)
    assert survey_step(TASK, found, look_now) is found
    assert survey_step(TASK, state, look_now._replace(held=False)).standing == v.STOPPED


def test_a_line_that_may_not_be_flown_turns_it_and_homeward_stops_it() -> None:
    state, look_now = under_way()
    asked: list[TargetLine] = []

    def never(line: TargetLine) -> bool:
        asked.append(line)
        return False

    found = survey_moved(TASK, state, look_now, never)
    assert (found.standing, found.reason) == (v.UPSTREAM, v.REFUSED)
    assert asked[-1] == found.target == pytest.approx((*place(-0.5, 0.0), ETA))
    home = survey_moved(TASK, homeward(0.5), look(110.0, q_m=0.5), never)
    assert (home.standing, home.reason) == (v.STOPPED, v.REFUSED)


def test_of_the_laws_it_takes_speeds_with_a_margin_and_half_of_what_is_near() -> None:
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = load_airframe(airframe_path), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    laws = laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), airframe.aerodynamics())
    polar = laws.wind.aerodynamics.polar
    task = survey_task(laws)
    slow = max(polar.speed_min_mps, laws.envelope.speed_min_mps)
    assert task.slowest_mps == pytest.approx(slow + 0.2)
    assert task.fastest_mps == pytest.approx(polar.speed_max_mps - 0.2)
    assert task.off_max_m == 0.5 * laws.guards.e_rho_max_m
    assert (task.fence, task.reach_m) == (laws.fence, laws.survey_reach_m)

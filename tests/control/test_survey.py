"""The survey on a plant that is the slide itself: it goes there, back past its start, and home."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, inf, isfinite, nan, radians, sin, tan
from statistics import median

import pytest

from tgl_soar.control.envelope import Fence
from tgl_soar.control.forecast import NO_FORECAST, SETTLES
from tgl_soar.control.survey import (
    AHEAD_S,
    AT_FENCE,
    AT_GROUND,
    DONE,
    DOWNSTREAM,
    DRIFTS,
    FAST,
    HOMEWARD,
    LOOK_S,
    NEAR_STALL,
    NOT_HELD,
    OFF_LINE,
    REACHED,
    REFUSED,
    REST_S,
    SLOW,
    STOPPED,
    SURVEY_TEXTS,
    UNLIKELY,
    UPSTREAM,
    WEAK,
    SurveyLook,
    SurveyState,
    SurveyTask,
    is_cut_short,
    survey_begun,
    survey_place,
    survey_refused,
    survey_step,
)
from tgl_soar.control.target_line import (
    LineLimits,
    LineState,
    LineTracking,
    TargetLine,
    eta_from_lean,
    line_step,
)
from tgl_soar.types import GROUND_POINTS, NO_GROUND, Ground

ETA = eta_from_lean(radians(15.0))
SPEED_MPS, RETURN_PER_S = 0.06, 1.0
TASK = SurveyTask(
    fence=Fence(x_min_m=-1.0, x_max_m=1.5, y_max_m=1.3, z_min_m=0.2, z_max_m=2.9),
    ground=NO_GROUND,
    clearance_min_m=0.3,
    speed_mps=SPEED_MPS,
    reach_m=50.0,
    slowest_mps=7.8,
    fastest_mps=11.8,
    off_max_m=0.5,
)
Alter = Callable[[SurveyLook], SurveyLook]


def as_it_is(look: SurveyLook) -> SurveyLook:
    return look


class Slide:
    """An aircraft at its place on the line, which is late by 1 / lambda on the contour z = 1.5 + x
    tan 30 deg, and a line that follows its target as the flown one does."""

    def __init__(self, task: SurveyTask = TASK, alter: Alter = as_it_is) -> None:
        self.task, self.alter = task, alter
        self.time_s = 0.0
        self.x_m, self.z_m = 0.0, 1.5
        self.climb_mps = 0.0
        self.line = LineState(x_m=0.0, z_m=1.5, eta_rad=ETA, speed_mps=0.0, moving=False)
        self.limits = LineLimits(SPEED_MPS, 0.5, 0.1)
        self.state = survey_begun(self.look())
        self.passed: list[tuple[int, float]] = []  # standing and x at every look
        self.ends: list[tuple[int, int, float]] = []  # standing, reason and x at every turn

    def look(self) -> SurveyLook:
        line = LineTracking(
            x_m=self.line.x_m,
            z_m=self.line.z_m,
            eta_rad=ETA,
            moving=self.line.moving,
            e_rho_m=0.0,
            e_rho_rate_mps=0.0,
        )
        look = SurveyLook(
            time_s=self.time_s,
            x_m=self.x_m,
            z_m=self.z_m,
            climb_mps=self.climb_mps,
            airspeed_mps=9.0,
            stall_rad=0.1,
            line=line,
            forecast=NO_FORECAST._replace(
                standing=SETTLES, chance=0.9, slope_per_s=-RETURN_PER_S * sin(ETA)
            ),
            held=True,
        )
        return self.alter(look)

    def step(self) -> SurveyState:
        before = self.state
        for _ in range(10):
            dt = LOOK_S / 10
            target = self.state.target
            self.line = line_step(self.limits, self.line, target, self.x_m, self.z_m, dt)
            # On the line, and towards where that crosses the contour.
            q = cos(ETA) * self.line.z_m - sin(ETA) * self.line.x_m
            s = cos(ETA) * self.x_m + sin(ETA) * self.z_m
            rise = radians(30.0)
            c, t = cos(rise), sin(rise)
            # n·p = q and -x t + z c = 1.5 c
            x = (cos(ETA) * 1.5 - q) / (sin(ETA) - cos(ETA) * t / c)
            place = cos(ETA) * x + sin(ETA) * (1.5 + x * t / c)
            s += RETURN_PER_S * (place - s) * dt
            z = sin(ETA) * s + cos(ETA) * q
            self.climb_mps = (z - self.z_m) / dt
            self.x_m, self.z_m = cos(ETA) * s - sin(ETA) * q, z
            self.time_s += dt
        self.state = survey_step(self.task, self.state, self.look())
        self.passed.append((before.standing, self.x_m))
        if self.state.standing != before.standing:
            self.ends.append((self.state.standing, self.state.reason, self.x_m))
        return self.state

    def run(self, seconds: float) -> SurveyState:
        for _ in range(round(seconds / LOOK_S)):
            if self.state.standing in (DONE, STOPPED):
                break
            self.step()
        return self.state


@pytest.mark.parametrize("standing", [DOWNSTREAM, UPSTREAM])
def test_the_contour_s_slope_is_known_on_the_way_there_and_on_the_way_back(standing: int) -> None:
    """ds/dq along z = 1.5 + x tan 30 deg, whichever way the line goes first."""
    rise = tan(radians(30.0))
    expected = (cos(ETA) + sin(ETA) * rise) / (cos(ETA) * rise - sin(ETA))
    slide, found = Slide(), []
    for _ in range(400):
        state = slide.step()
        if state.standing == standing:
            found.append(state.means.slope)
            if standing == UPSTREAM:  # as if nothing had been measured on the way there
                slide.state = state._replace(means=state.means._replace(slope=0.0))
    assert median(found[len(found) // 2 :]) == pytest.approx(expected, rel=0.1)


def test_it_goes_downstream_back_past_its_start_and_home() -> None:
    slide = Slide()
    state = slide.run(300.0)
    assert (state.standing, state.reason) == (DONE, AT_FENCE)
    assert not is_cut_short(state)
    assert [standing for standing, _, _ in slide.ends] == [UPSTREAM, HOMEWARD, DONE]
    (_, _, downstream), (_, _, upstream), (_, _, home) = slide.ends
    # Room is half of CLEAR_MIN, and AHEAD_S of way is looked ahead.
    assert TASK.fence.x_max_m - downstream == pytest.approx(0.15 + 0.24 / 0.8, abs=0.15)
    assert upstream - TASK.fence.x_min_m == pytest.approx(0.15 + 0.24 / 0.8, abs=0.15)
    assert home == pytest.approx(0.0, abs=0.02)
    assert state.target == state.start
    # Every place between its ends was passed both ways.
    up = [x for standing, x in slide.passed if standing == UPSTREAM]
    down = [x for standing, x in slide.passed if standing != UPSTREAM]
    assert max(up) == pytest.approx(max(down), abs=0.1)
    assert min(up) == pytest.approx(min(down), abs=0.1)
    across = sin(ETA) - cos(ETA) * 0.577  # of the line for a metre of x
    seconds = 2.0 * (downstream - upstream) * across / SPEED_MPS
    assert slide.time_s == pytest.approx(seconds + 3.0 * REST_S, rel=0.05)


def test_its_target_is_never_far_ahead_and_the_line_never_brakes_on_its_way() -> None:
    slide = Slide()
    speeds = []
    while slide.state.standing in (DOWNSTREAM, UPSTREAM):
        slide.step()
        target, line = slide.state.target, slide.line
        ahead = cos(ETA) * (target.z_m - line.z_m) - sin(ETA) * (target.x_m - line.x_m)
        assert abs(ahead) <= AHEAD_S * SPEED_MPS + 1e-9
        speeds.append(abs(line.speed_mps))
    at_speed = [speed for speed in speeds if speed == pytest.approx(SPEED_MPS)]
    assert (
        len(speeds) - len(at_speed) < 3.5 * REST_S / LOOK_S
    )  # at rest where it turns, and no more


def test_it_rests_before_it_starts_and_where_it_turns() -> None:
    slide = Slide()
    slide.run(4.8)
    assert slide.line.x_m == 0.0
    while slide.state.standing == DOWNSTREAM:
        slide.step()
    there = slide.line
    slide.run(4.8)
    assert abs(slide.line.x_m - there.x_m) < 0.01  # but for braking
    slide.run(2.0)
    assert slide.line.x_m < there.x_m - 0.05


GROUND = Ground(2, (-9.0, 9.0, *[9.0] * 6), (1.0, 1.0, *[1.0] * 6))
assert len(GROUND.x_m) == GROUND_POINTS


@pytest.mark.parametrize(
    ("task", "alter", "reason"),
    [
        (TASK._replace(reach_m=0.3), as_it_is, REACHED),
        (TASK, as_it_is, AT_FENCE),
        (TASK._replace(ground=GROUND), as_it_is, AT_FENCE),  # downstream it climbs away from it
        (TASK, lambda look: look._replace(airspeed_mps=9.0 - 2.0 * look.x_m), SLOW),
        (TASK, lambda look: look._replace(airspeed_mps=9.0 + 4.0 * look.x_m), FAST),
        (TASK, lambda look: look._replace(stall_rad=0.1 - 0.2 * look.x_m), NEAR_STALL),
        (
            TASK,
            lambda look: look._replace(
                forecast=look.forecast._replace(slope_per_s=-1.0 + look.x_m)
            ),
            WEAK,
        ),
        (
            TASK,
            lambda look: look._replace(forecast=look.forecast._replace(chance=0.9 - look.x_m)),
            UNLIKELY,
        ),
        (TASK, lambda look: look._replace(forecast=NO_FORECAST), WEAK),
    ],
)
def test_every_guard_ends_the_way(task: SurveyTask, alter: Alter, reason: int) -> None:
    slide = Slide(task, alter)
    slide.run(60.0)
    assert slide.ends[0][:2] == (UPSTREAM, reason)
    assert slide.ends[0][2] < 1.3
    assert SURVEY_TEXTS[reason]


def test_the_ground_ends_the_way_upstream() -> None:
    slide = Slide(TASK._replace(ground=GROUND))
    slide.run(300.0)
    _, reason, x_m = slide.ends[1]
    assert reason == AT_GROUND
    assert 1.5 + 0.577 * x_m - 1.0 > 0.3 + 0.15 - 0.05


def test_a_guard_is_not_asked_again_on_the_way_back() -> None:
    """What barred the way lasts in the means; over what was passed it goes all the same."""
    slow = False

    def alter(look: SurveyLook) -> SurveyLook:
        return look._replace(airspeed_mps=7.0) if slow else look

    slide = Slide(alter=alter)
    slide.run(15.0)
    slow = True
    slide.run(9.0)
    assert [end[:2] for end in slide.ends] == [(UPSTREAM, SLOW)]
    slide.run(6.0)
    assert slide.state.standing == UPSTREAM
    slide.run(60.0)  # at its start it is asked again, and goes home, where it is
    assert [end[:2] for end in slide.ends[1:]] == [(HOMEWARD, SLOW), (DONE, SLOW)]


@pytest.mark.parametrize(
    ("oddity", "reason"),
    [
        (lambda look: look._replace(climb_mps=-0.5), DRIFTS),
        (lambda look: look._replace(climb_mps=0.5), DRIFTS),
        (lambda look: look._replace(line=look.line._replace(e_rho_m=0.6)), OFF_LINE),
        (lambda look: look._replace(line=look.line._replace(e_rho_m=nan)), OFF_LINE),
    ],
)
@pytest.mark.parametrize("lasts", [False, True])
def test_what_is_odd_sends_it_home_and_stops_it_where_it_lasts(
    oddity: Alter, reason: int, lasts: bool
) -> None:
    odd = False

    def alter(look: SurveyLook) -> SurveyLook:
        return oddity(look) if odd else look

    slide = Slide(alter=alter)
    slide.run(20.0)
    odd = True
    while slide.state.standing == DOWNSTREAM:
        slide.step()
        assert slide.time_s < 26.0
    assert (slide.state.standing, slide.state.reason) == (HOMEWARD, reason)
    assert is_cut_short(slide.state)
    odd = lasts
    slide.run(10.5)
    if lasts:
        assert (slide.state.standing, slide.state.reason) == (STOPPED, reason)
        assert slide.state.target.x_m == slide.line.x_m
    else:
        assert slide.run(60.0).standing == DONE
        assert is_cut_short(slide.state)
        assert slide.x_m == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(
    "alter",
    [
        lambda look: look._replace(held=False),
        lambda look: look._replace(z_m=nan),
        lambda look: look._replace(climb_mps=inf),
    ],
)
def test_where_it_is_not_held_by_the_line_any_more_it_ends_and_the_line_stays(
    alter: Alter,
) -> None:
    """Where the line is, not where it was sent, which is ahead of it."""
    slide = Slide()
    slide.run(20.0)
    line = slide.look().line
    ended = survey_step(TASK, slide.state, alter(slide.look()))
    assert (ended.standing, ended.reason) == (STOPPED, NOT_HELD)
    assert ended.target == TargetLine(line.x_m, line.z_m, ETA)
    assert ended.target != slide.state.target
    assert survey_step(TASK, ended, slide.look()) == ended


def test_a_line_that_is_refused_turns_it_and_on_the_way_home_stops_it() -> None:
    slide = Slide()
    slide.run(20.0)
    tracking = slide.look().line
    turned = survey_refused(slide.state, tracking)
    assert (turned.standing, turned.reason) == (UPSTREAM, REFUSED)
    assert turned.target == TargetLine(tracking.x_m, tracking.z_m, ETA)
    home = survey_refused(turned, tracking)
    assert home.standing == HOMEWARD
    assert survey_refused(home, tracking).standing == STOPPED


def test_gusts_that_carry_it_farther_end_the_way_earlier() -> None:
    swings = [0.0]

    def alter(look: SurveyLook) -> SurveyLook:
        swings.append(-swings[-1])
        return look._replace(z_m=look.z_m + swings[-1])

    calm = Slide(alter=alter)
    calm.run(60.0)
    swings.append(0.12)
    rough = Slide(alter=alter)
    rough.run(60.0)
    assert calm.ends[0][2] - rough.ends[0][2] > 0.12


def test_the_place_is_on_the_contour_and_all_is_finite() -> None:
    slide = Slide()
    slide.run(20.0)
    x_m, z_m = survey_place(slide.state)
    assert z_m == pytest.approx(1.5 + 0.577 * x_m, abs=0.05)
    assert all(isfinite(value) for value in slide.state.means)

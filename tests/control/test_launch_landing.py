"""The inputs of launch, way home and beating in a tick, and what the supervisor is given."""

from __future__ import annotations

from math import cos, inf, nan, sin
from typing import Any

import pytest
from samples import STILL
from test_power import GOOD, HEALTHY

import tgl_soar.control.launch_landing
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control import launch
from tgl_soar.control import supervisor as modes
from tgl_soar.control.airspeed_hold import NO_GLIDE
from tgl_soar.control.envelope import OUT_ABOVE, OUT_DOWNSTREAM, OUT_UPSTREAM, Margins
from tgl_soar.control.estimates import Estimates
from tgl_soar.control.glide_home import NO_ESCAPE
from tgl_soar.control.launch_landing import (
    NO_LAUNCH_LANDING,
    NO_LULL,
    LaunchLandingState,
    Lull,
    can_beat,
    hand_conditions,
    keeps_level,
    knows_place,
    phase_conditions,
    phase_step,
)
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.ridge_beat import NO_BEAT
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.control.target_line import LineState
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    NO_ATTITUDE,
    NO_FIX,
    AutopilotStatus,
    Inputs,
    VehicleState,
)

way: Any = tgl_soar.control.launch_landing
DT = 0.005
NOW_S = 50.0
CLEAR_M = 1.2
POS_MAX_S, RECOVER_S, RECKONED_S = 1.5, 2.0, 2.0
AERO = load_airframe(shipped("airframes/eclipson_c.toml")).aerodynamics()
SLOWEST_MPS = AERO.polar.speed_min_mps
GIVEN = {
    "LND_X": -40.0, "LND_LEN": 20.0, "ESC_X": -20.0, "ESC_CLEAR": 3.0, "CLEAR_MIN": CLEAR_M,
    "BEAT_WIDTH": 30.0, "FENCE_Y_MAX": 60.0, "AGE_POS_MAX": POS_MAX_S, "REC_TIME": RECOVER_S,
    "AGE_POS_HOLD": 0.25, "AGE_POS_DR": RECKONED_S, "EST_SD_MAX": 0.1,
}  # fmt: skip


def laws_with(**changes: float) -> Laws:
    values = ParameterSet().changed({**GIVEN, **changes})
    return laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), AERO)


LAWS = laws_with()
ETA = LAWS.target.eta_rad
VEHICLE = STILL._replace(time_s=NOW_S, x_m=-5.0, z_m=8.0)
AIR = GOOD.air._replace(airspeed_mps=9.0, wind_mps=8.5, updraft_mps=1.0, cross_wind_mps=0.0)
HERE = GOOD._replace(
    vehicle=VEHICLE,
    air=AIR._replace(wind_sigma_mps=0.3),
    margins=Margins(inf, 10.0, 0),
    memory=GOOD.memory._replace(confident_s=NOW_S - 0.1),
)
LINE = LineState(x_m=-4.0, z_m=7.0, eta_rad=ETA, speed_mps=0.0, moving=False)
SILENT = AutopilotStatus(time_s=NOW_S, accepts_surfaces=True, armed=True)
INPUTS = Inputs(time_s=NOW_S, position=NO_FIX, attitude=NO_ATTITUDE, autopilot=SILENT, engage=True)


def at_hand(
    vehicle: VehicleState = VEHICLE, clearance_m: float = 10.0, outside: int = 0, **changes: Any
) -> Estimates:
    margins = Margins(inf, clearance_m, outside)
    return HERE._replace(vehicle=vehicle, margins=margins, **changes)


def with_health(**changes: Any) -> Estimates:
    return at_hand(health=HEALTHY._replace(**changes))


def launched(standing: int, since_s: float = NOW_S - 1.0) -> LaunchLandingState:
    before = launch.NO_LAUNCH._replace(standing=standing, since_s=since_s)
    return NO_LAUNCH_LANDING._replace(launch=before)


def homeward(**changes: Any) -> LaunchLandingState:
    """The height for the way home is watched, and there is some."""
    usual: dict[str, Any] = {"armed": True, "left_m": 4.0, "counts_m": 4.0, "since_s": NOW_S - 9.0}
    return NO_LAUNCH_LANDING._replace(escape=NO_ESCAPE._replace(**{**usual, **changes}))


def asked_of(monkeypatch: pytest.MonkeyPatch, name: str) -> list[Any]:
    """What a part is given, call by call: in order, and by name."""
    asked: list[Any] = []
    part = getattr(way, name)

    def listens(*given: Any, **named: Any) -> Any:
        asked.append((given, named))
        return part(*given, **named)

    monkeypatch.setattr(way, name, listens)
    return asked


def stepped(
    mode: int,
    state: LaunchLandingState = NO_LAUNCH_LANDING,
    now: Estimates = HERE,
    line: LineState = LINE,
    laws: Laws = LAWS,
) -> LaunchLandingState:
    return phase_step(laws, state, mode, INPUTS, now, line, DT)


# --- what is watched in a tick ------------------------------------------------------------------


@pytest.mark.interpreted
def test_a_launch_sees_how_far_the_line_has_to_go_and_how_far_off_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Across, along the line's normal: to the target from the line, and to it from the aircraft."""
    asked = asked_of(monkeypatch, "launch_step")
    laws = laws_with(TGL_X=-1.0, TGL_Z=6.0)
    stepped(modes.LAUNCHING, launched(launch.HELD), laws=laws)
    (((params, before, launching, view, dt_s), _),) = asked
    assert (params, before, dt_s) == (laws.launch, launched(launch.HELD).launch, DT)
    assert launching
    upstream = (-sin(ETA), cos(ETA))
    off_m = upstream[0] * (VEHICLE.x_m - LINE.x_m) + upstream[1] * (VEHICLE.z_m - LINE.z_m)
    to_go_m = upstream[0] * (-1.0 - LINE.x_m) + upstream[1] * (6.0 - LINE.z_m)
    assert (view.off_m, view.to_go_m) == pytest.approx((off_m, to_go_m))
    assert (view.vehicle, view.imu) == (VEHICLE, INPUTS.imu)
    assert (view.airspeed_mps, view.measured) == (9.0, False)
    assert (view.clearance_m, view.clearance_min_m) == pytest.approx((10.0, CLEAR_M))
    assert view.speed_min_mps == laws.envelope.speed_min_mps
    assert view.off_max_m == laws.guards.e_rho_max_m
    assert view.position_ok
    assert view.line_rests


@pytest.mark.interpreted
def test_a_launch_is_given_that_its_line_moves_and_that_the_place_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = asked_of(monkeypatch, "launch_step")
    lost = with_health(position_ok=False)
    stepped(modes.LAUNCHING, launched(launch.HELD), lost, LINE._replace(moving=True))
    view = asked[0][0][3]
    assert not view.line_rests
    assert not view.position_ok


@pytest.mark.interpreted
def test_a_launch_begins_with_its_mode_and_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = asked_of(monkeypatch, "launch_step")
    assert stepped(modes.SOARING).launch == launch.NO_LAUNCH
    assert asked == []
    assert stepped(modes.LAUNCHING).launch.standing == launch.HELD
    assert stepped(modes.CAPTURING, launched(launch.REACHED)).launch == launch.NO_LAUNCH
    assert [given[2] for given, _ in asked] == [True, False]


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("mode", "moving", "goes_home", "soars"),
    [
        (modes.SOARING, False, False, True),
        (modes.SOARING, True, False, False),
        (modes.CAPTURING, False, False, False),
        (modes.BEATING, False, False, True),
        (modes.BEATING, True, False, True),
        (modes.BREAKING_OFF, False, True, False),
        (modes.LANDING, False, True, False),
    ],
)
def test_the_watch_of_the_height_knows_whether_a_line_at_rest_carries_it(
    monkeypatch: pytest.MonkeyPatch, mode: int, moving: bool, goes_home: bool, soars: bool
) -> None:
    asked = asked_of(monkeypatch, "escape_step")
    stepped(mode, line=LINE._replace(moving=moving))
    params, _, view, vehicle, air, dt_s = asked[0][0]
    assert (params, vehicle, air, dt_s) == (LAWS.landing, VEHICLE, HERE.air, DT)
    assert view.flying
    assert view.place_known
    assert (view.goes_home, view.soars) == (goes_home, soars)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("standing", "flies"),
    [
        (launch.HELD, False),
        (launch.THROWN, True),
        (launch.GLIDING, True),
        (launch.NO_THROW, False),
    ],
)
def test_nothing_of_the_air_is_watched_in_a_hand(
    monkeypatch: pytest.MonkeyPatch, standing: int, flies: bool
) -> None:
    asked = asked_of(monkeypatch, "escape_step")
    state = launched(standing)._replace(beat=NO_BEAT._replace(oblique_s=0.5))
    monkeypatch.setattr(way, "launch_step", lambda *given: given[1])
    after = stepped(modes.LAUNCHING, state)
    assert asked[0][0][2].flying == flies
    assert (after.beat != NO_BEAT) == flies


@pytest.mark.interpreted
def test_a_watch_of_the_height_without_a_place_knows_so(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = asked_of(monkeypatch, "escape_step")
    stepped(modes.SOARING, now=with_health(position_ok=False))
    assert not asked[0][0][2].place_known


@pytest.mark.parametrize("mode", range(len(MODE_NAMES)), ids=MODE_NAMES)
def test_a_glide_is_remembered_in_the_modes_that_glide(mode: int) -> None:
    gliding = NO_LAUNCH_LANDING._replace(glide=NO_GLIDE._replace(speed_mps=9.0))
    glides = MODE_NAMES[mode] in ("breaking off", "landing", "beating")
    kept = stepped(mode, gliding).glide
    assert kept == (gliding.glide if glides else NO_GLIDE)


# --- a lull -------------------------------------------------------------------------------------


def lull(
    mode: int = modes.SOARING,
    *,
    wind_mps: float = 20.0,
    cross_mps: float = 0.0,
    sigma_mps: float = 0.5,
    climb_mps: float = 0.0,
    clearance_m: float = 10.0,
    before: Lull = Lull(0.1, 0.1),  # noqa: B008 -- a tuple
    laws: Laws = LAWS,
) -> Lull:
    air = AIR._replace(wind_mps=wind_mps, cross_wind_mps=cross_mps, wind_sigma_mps=sigma_mps)
    now = at_hand(VEHICLE._replace(climb_mps=climb_mps), clearance_m, air=air)
    return stepped(mode, NO_LAUNCH_LANDING._replace(lull=before), now, laws=laws).lull


MORE, LESS = pytest.approx(0.1 + DT), pytest.approx(0.1 - DT)
ON_LINE = (modes.CAPTURING, modes.SOARING, modes.SEARCHING)


@pytest.mark.parametrize("mode", range(len(MODE_NAMES)), ids=MODE_NAMES)
def test_a_wind_that_is_slower_than_the_slowest_glide_counts_on_a_line(mode: int) -> None:
    """By more than its standard deviation; where it beats it does not stand anyway."""
    slow = lull(mode, wind_mps=SLOWEST_MPS - 0.6).slow_s
    if mode in ON_LINE:
        assert slow == MORE
        assert lull(mode, wind_mps=SLOWEST_MPS - 0.4).slow_s == LESS
    elif mode == modes.HOLDING:  # a gap of one tick is no other wind
        assert slow == 0.1
    else:
        assert slow == (LESS if mode == modes.BEATING else 0.0)


def test_a_wind_is_that_of_both_axes_and_what_is_not_known_is_not_slow() -> None:
    slow_mps = SLOWEST_MPS - 0.6
    assert lull(wind_mps=slow_mps, cross_mps=-0.05 * slow_mps).slow_s == MORE
    assert lull(wind_mps=slow_mps, cross_mps=-0.7 * slow_mps).slow_s == LESS
    assert lull(wind_mps=nan).slow_s == LESS
    assert lull(wind_mps=slow_mps, sigma_mps=nan).slow_s == LESS


@pytest.mark.parametrize("mode", [modes.SOARING, modes.BEATING])
def test_sinking_to_the_least_height_within_two_seconds_counts(mode: int) -> None:
    """ESC_CLEAR of 3 m; from 7 m that is 2 m/s, and rising is no sinking."""
    assert lull(mode, climb_mps=-2.1, clearance_m=7.0).low_s == MORE
    assert lull(mode, climb_mps=-1.9, clearance_m=7.0).low_s == LESS
    assert lull(mode, climb_mps=5.0, clearance_m=2.9).low_s == MORE
    assert lull(mode, climb_mps=0.0, clearance_m=3.1).low_s == LESS
    assert lull(mode, clearance_m=inf, climb_mps=-9.0).low_s == LESS


def test_neither_a_capture_nor_a_survey_is_low_along_its_line() -> None:
    """The first is on its way, the second turns there by itself."""
    for mode in (modes.CAPTURING, modes.SEARCHING):
        assert lull(mode, clearance_m=1.0).low_s == LESS
    assert lull(clearance_m=1.0, laws=laws_with(SRV_START=1.0)).low_s == LESS


@pytest.mark.parametrize(
    ("mode", "standing", "level"),
    [
        (modes.HOLDING, launch.IDLE, True),
        (modes.RECOVERING, launch.IDLE, True),
        (modes.LAUNCHING, launch.HELD, True),
        (modes.LAUNCHING, launch.THROWN, True),
        (modes.LAUNCHING, launch.GLIDING, False),
        (modes.CAPTURING, launch.IDLE, False),
        (modes.BEATING, launch.IDLE, False),
        (modes.LANDING, launch.IDLE, False),
    ],
)
def test_the_wings_are_level_where_the_modes_say_so(mode: int, standing: int, level: bool) -> None:
    """Also of a firmware that turns by banking."""
    state = NO_LAUNCH_LANDING._replace(launch=NO_LAUNCH_LANDING.launch._replace(standing=standing))
    assert keeps_level(mode, state) == level


@pytest.mark.parametrize("mode", [modes.LAUNCHING, modes.RECOVERING, modes.LANDING])
def test_without_a_line_a_lull_is_forgotten(mode: int) -> None:
    assert lull(mode, wind_mps=0.0, clearance_m=0.1) == NO_LULL == (0.0, 0.0)


def test_a_lull_counts_to_twice_what_ends_a_flight_and_back_to_nothing() -> None:
    """Two seconds of it, and three tenths of sinking (`throttle.LOW_S`), end one."""
    longest = lull(wind_mps=0.0, clearance_m=1.0, before=Lull(3600.0, 3600.0))
    assert longest == pytest.approx((4.0, 0.6))
    assert lull(before=Lull(0.001, 0.001)) == (0.0, 0.0)


# --- in a hand ----------------------------------------------------------------------------------

ASKED = laws_with(LNC_START=1.0)
HAND_M = 2.0


def test_a_launch_asks_for_neither_height_nor_speed_in_a_hand() -> None:
    margins = Margins(inf, HAND_M, 0)
    found = hand_conditions(ASKED, VEHICLE, HEALTHY, margins)
    assert found == modes.LAUNCH | modes.AIR_SAFE | modes.HIGH_ENOUGH
    assert hand_conditions(LAWS, VEHICLE, HEALTHY, margins) == 0


def test_what_flies_already_is_in_no_hand() -> None:
    fast = VEHICLE._replace(velocity_x_mps=-3.0)
    low, high = Margins(inf, HAND_M, 0), Margins(inf, 5.0, 0)
    assert hand_conditions(ASKED, fast, HEALTHY, low) == 0
    assert hand_conditions(ASKED, VEHICLE, HEALTHY, high) == 0
    lost = HEALTHY._replace(position_ok=False)
    assert hand_conditions(ASKED, fast, lost, high) != 0


# --- what the supervisor is given ---------------------------------------------------------------


def found(
    mode: int = modes.SOARING,
    state: LaunchLandingState = NO_LAUNCH_LANDING,
    now: Estimates = HERE,
    **changes: float,
) -> int:
    return phase_conditions(laws_with(**changes), mode, state, now)


LAUNCH_BITS = {
    launch.NO_THROW: modes.THROW_AWAITED,
    launch.STEEP: modes.THROWN_LEVEL,
    launch.SLOW: modes.SPEED_GAINED,
    launch.LOW: modes.LAUNCH_HIGH,
    launch.FAR: modes.LINE_IN_REACH,
}


@pytest.mark.parametrize("standing", range(launch.FAR + 1))
def test_why_a_launch_is_given_up_is_one_condition_that_it_lacks(standing: int) -> None:
    bits = found(modes.LAUNCHING, launched(standing))
    for given_up, bit in LAUNCH_BITS.items():
        assert bool(bits & bit) == (standing != given_up)
    assert bool(bits & modes.LINE_REACHED) == (standing == launch.REACHED)
    aloft = standing not in (launch.IDLE, launch.HELD, launch.NO_THROW)
    assert bool(bits & modes.THROWN) == aloft
    assert not bits & modes.LAUNCH
    assert found(LNC_START=1.0) & modes.LAUNCH
    assert not bits & modes.ENGAGE  # which is the operator's


SHORT = {"counts_m": -0.1, "left_m": -0.1, "since_s": NOW_S - 0.6}  # for longer than half a second


@pytest.mark.parametrize(
    ("asked", "auto", "short", "breaks"),
    [
        (0.0, 0.0, False, False),
        (0.0, 0.0, True, False),
        (0.0, 1.0, False, False),
        (0.0, 1.0, True, True),
        (1.0, 0.0, False, True),
        (2.0, 1.0, True, False),
    ],
)
def test_it_breaks_off_when_commanded_or_when_the_height_is_gone_and_it_may(
    asked: float, auto: float, short: bool, breaks: bool
) -> None:
    state = homeward(**SHORT) if short else homeward()
    bits = found(state=state, ESC_START=asked, ESC_AUTO=auto)
    assert bool(bits & modes.BREAK_OFF) == breaks
    assert bool(bits & modes.SOAR_ON) == (asked == 2.0)


def reckoned(seconds: float, **changes: Any) -> Estimates:
    """Dead reckoned alone for so long: no longer confident in its place, and young."""
    health = HEALTHY._replace(position_ok=False, **changes)
    return at_hand(health=health, quality=HERE.quality._replace(reckoned_s=seconds))


def test_a_height_that_nobody_can_know_breaks_nothing_off() -> None:
    lost = with_health(position_ok=False)
    assert not found(state=homeward(**SHORT), now=lost, ESC_AUTO=1.0) & modes.BREAK_OFF


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("state", "seconds", "breaks"),
    [
        (homeward(), RECKONED_S + 0.1, True),
        (homeward(), RECKONED_S - 0.1, False),
        (homeward(armed=False), RECKONED_S + 0.1, False),
        (homeward(left_m=-0.1), RECKONED_S + 0.1, False),
        (homeward(left_m=0.0), RECKONED_S + 0.1, True),
        (homeward(left_m=nan), RECKONED_S + 0.1, False),
    ],
)
def test_who_has_reckoned_for_too_long_goes_home_where_there_is_height(
    state: LaunchLandingState, seconds: float, breaks: bool
) -> None:
    bits = found(state=state, now=reckoned(seconds), ESC_AUTO=1.0)
    assert bool(bits & modes.BREAK_OFF) == breaks


@pytest.mark.interpreted
def test_a_place_that_is_reckoned_is_one_to_go_home_by() -> None:
    assert knows_place(LAWS, HERE)
    assert not knows_place(LAWS, with_health(position_ok=False))
    assert knows_place(LAWS, reckoned(60.0))
    assert not knows_place(LAWS, reckoned(60.0, position_age_s=0.3))  # beyond AGE_POS_HOLD
    assert knows_place(LAWS, reckoned(60.0, position_age_s=0.2))
    jumped = reckoned(60.0)
    quality = jumped.quality._replace(jumped=True)
    assert not knows_place(LAWS, jumped._replace(quality=quality))


@pytest.mark.parametrize(
    ("x_m", "clearance_m", "clear_min_m", "away"),
    [
        (-20.1, 10.0, CLEAR_M, True),  # upstream of ESC_X
        (-19.9, 10.0, CLEAR_M, False),
        (-5.0, 2.3, CLEAR_M, True),  # twice CLEAR_MIN over the ground: nowhere else to go
        (-5.0, 2.5, CLEAR_M, False),
        (-5.0, 0.49, 0.1, True),  # where it flares
        (-5.0, 0.51, 0.1, False),
    ],
)
def test_it_is_away_from_the_slope_upstream_of_a_place_or_low(
    x_m: float, clearance_m: float, clear_min_m: float, away: bool
) -> None:
    now = at_hand(VEHICLE._replace(x_m=x_m), clearance_m)
    bits = found(modes.BREAKING_OFF, now=now, CLEAR_MIN=clear_min_m)
    assert bool(bits & modes.AWAY) == away
    lost = now._replace(health=HEALTHY._replace(position_ok=False))
    assert not found(modes.BREAKING_OFF, now=lost, CLEAR_MIN=clear_min_m) & modes.AWAY


def test_it_lies_on_the_ground_on_its_way_home_alone() -> None:
    """For a second, within a hand's breadth or two."""
    lies, low = homeward(still_s=NOW_S - 1.1), at_hand(clearance_m=0.2)
    assert found(modes.LANDING, lies, low) & modes.ON_GROUND
    assert found(modes.BREAKING_OFF, lies, low) & modes.ON_GROUND
    assert not found(modes.SOARING, lies, low) & modes.ON_GROUND
    assert not found(modes.LANDING, homeward(still_s=NOW_S - 0.9), low) & modes.ON_GROUND
    lost = low._replace(health=HEALTHY._replace(position_ok=False))
    assert not found(modes.LANDING, lies, lost) & modes.ON_GROUND


@pytest.mark.parametrize(
    ("outside", "inside"),
    [(0, True), (OUT_UPSTREAM | OUT_ABOVE, True), (OUT_DOWNSTREAM | OUT_ABOVE, False)],
)
def test_only_the_downstream_side_of_the_fence_ends_the_way_home(
    outside: int, inside: bool
) -> None:
    bits = found(modes.LANDING, now=at_hand(outside=outside))
    assert bool(bits & modes.INSIDE_LEE) == inside


BLIND_S = POS_MAX_S + RECOVER_S


@pytest.mark.parametrize(
    ("age_s", "confident_s", "blind"),
    [
        (0.1, 0.1, False),
        (BLIND_S - 0.1, BLIND_S - 0.1, False),
        (BLIND_S + 0.1, 0.1, True),
        (0.1, BLIND_S + 0.1, True),
        (0.1, -0.04, False),  # clocks are mapped to some hundredths of a second
        (0.1, -0.06, True),
        (0.1, nan, True),
    ],
)
def test_no_mode_is_blind_for_longer_than_holding_and_recovering(
    age_s: float, confident_s: float, blind: bool
) -> None:
    now = with_health(position_ok=False, position_age_s=age_s)
    now = now._replace(memory=now.memory._replace(confident_s=NOW_S - confident_s))
    assert bool(found(modes.LANDING, now=now) & modes.NOT_BLIND) != blind
    sees = now._replace(health=now.health._replace(position_ok=True))
    assert found(modes.LANDING, now=sees) & modes.NOT_BLIND


def test_beating_is_over_where_it_is_wanted_back_and_is_back() -> None:
    """In the middle, nose into the wind."""
    assert found(modes.BEATING) & modes.BEAT_OVER
    assert not found(modes.SOARING) & modes.BEAT_OVER
    assert not found(modes.BEATING, BEAT_START=1.0) & modes.BEAT_OVER
    aside = at_hand(VEHICLE._replace(y_m=20.0))
    assert not found(modes.BEATING, now=aside) & modes.BEAT_OVER


def test_it_beats_when_commanded_where_there_is_room() -> None:
    assert not found() & modes.BEAT
    assert found(BEAT_START=1.0) & modes.BEAT
    assert not found(now=at_hand(clearance_m=5.9), BEAT_START=1.0) & modes.BEAT


@pytest.mark.parametrize(
    ("clear_min_m", "esc_clear_m", "needed_m"), [(CLEAR_M, 3.0, 6.0), (4.0, 3.0, 8.0)]
)
def test_beating_needs_twice_the_least_height(
    clear_min_m: float, esc_clear_m: float, needed_m: float
) -> None:
    laws = laws_with(CLEAR_MIN=clear_min_m, ESC_CLEAR=esc_clear_m)
    assert can_beat(laws, at_hand(clearance_m=needed_m + 0.1))
    assert not can_beat(laws, at_hand(clearance_m=needed_m - 0.1))
    assert not can_beat(laws, at_hand(clearance_m=nan))
    assert not can_beat(laws_with(BEAT_WIDTH=0.0), HERE)
    assert can_beat(laws_with(BEAT_WIDTH=0.5), HERE)
    assert not can_beat(laws, with_health(position_ok=False))

"""When a propeller may be used, its command, and what the laws and the air are given of it."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isnan, nan, radians
from typing import Any

import pytest
from samples import STILL

import tgl_soar.control.power
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control import forecast as foreseen
from tgl_soar.control import supervisor as modes
from tgl_soar.control.envelope import Margins
from tgl_soar.control.estimates import Estimates, initial_memory
from tgl_soar.control.forecast import NO_FORECAST, Forecast
from tgl_soar.control.launch_landing import NO_LAUNCH_LANDING, LaunchLandingState
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.power import (
    is_allowed,
    power_conditions,
    power_off,
    power_step,
    with_power,
    with_push,
)
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.control.throttle import (
    CLOSED,
    HOME,
    NO_THROTTLE,
    NOT_CALLED,
    NOWHERE,
    OFF,
    OPEN,
    USED_UP,
    ThrottleView,
)
from tgl_soar.estimation.ground_range import GroundRange
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    NO_AERODYNAMICS,
    NO_AIR,
    NO_ATTITUDE,
    NO_FIX,
    AutopilotStatus,
    Health,
    Inputs,
    MotionQuality,
    VehicleState,
)

power: Any = tgl_soar.control.power
DT = 0.005
TILT_DEG = 60.0
CLEAR_M = 1.5
BUDGET_S = 20.0
# At 9 m/s it gives 5 m/s² (1 - 9/18), a climb of 2.3 m/s.
PLANE = NO_AERODYNAMICS._replace(
    mass_kg=0.8, propeller_thrust_n=4.0, propeller_speed_mps=18.0, propeller_lag_s=0.1
)


def laws(budget_s: float = BUDGET_S) -> Laws:
    values = {"THR_BUDGET": budget_s, "TILT_MAX": TILT_DEG, "CLEAR_MIN": CLEAR_M}
    return laws_from(ParameterSet().changed(values), SoaringFrame(0.0, 0.0, 0.0, 0.0), PLANE)


LAWS = laws()
SINKS = NO_FORECAST._replace(standing=foreseen.TOO_LOW, excess_mps=-0.5)
SETTLES = NO_FORECAST._replace(standing=foreseen.SETTLES, excess_mps=-0.1)
HEALTHY = Health(
    position_age_s=0.01, attitude_age_s=0.01, heartbeat_age_s=0.1, position_ok=True,
    attitude_ok=True, autopilot_ok=True, rejected=0, position_interval_s=0.01,
    position_jitter_s=0.0, attitude_interval_s=0.01, attitude_jitter_s=0.0, gaps=0,
    surfaces_answer=1, faults=0,
)  # fmt: skip


def estimates(
    vehicle: VehicleState = STILL,
    health: Health = HEALTHY,
    airspeed_mps: float = 9.0,
    clearance_m: float = 10.0,
) -> Estimates:
    """What a tick has of an aircraft that flies well."""
    return Estimates(
        vehicle=vehicle,
        quality=MotionQuality._make([0] * len(MotionQuality._fields)),
        health=health,
        air=NO_AIR._replace(airspeed_mps=airspeed_mps),
        margins=Margins(inf, clearance_m, 0),
        ground_range=GroundRange._make([0] * len(GroundRange._fields)),
        veer_rad=0.0,
        memory=initial_memory(),
    )


GOOD = estimates()


def escape(*, armed: bool, left_m: float) -> LaunchLandingState:
    before = NO_LAUNCH_LANDING.escape
    return NO_LAUNCH_LANDING._replace(escape=before._replace(armed=armed, left_m=left_m))


def inputs(*, armed: bool) -> Inputs:
    status = AutopilotStatus(time_s=1.0, accepts_surfaces=True, armed=armed)
    return Inputs(time_s=1.0, position=NO_FIX, attitude=NO_ATTITUDE, autopilot=status, engage=False)


# --- when it may be used ------------------------------------------------------------------------


@pytest.mark.parametrize("mode", range(len(MODE_NAMES)), ids=MODE_NAMES)
def test_power_is_for_modes_whose_pitch_follows_a_line_or_an_airspeed(mode: int) -> None:
    """There it climbs; recovering holds a pitch, and would leave the fence upstream."""
    powered = {"capturing", "soaring", "searching", "breaking off"}
    assert is_allowed(LAWS, mode, GOOD) == (MODE_NAMES[mode] in powered)


@pytest.mark.parametrize("field", ["position_ok", "attitude_ok", "autopilot_ok"])
def test_nothing_may_be_uncertain(field: str) -> None:
    health = HEALTHY._replace(**{field: False})
    assert not is_allowed(LAWS, modes.SOARING, estimates(health=health))


@pytest.mark.parametrize("axis", ["roll_rad", "pitch_rad"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_is_for_an_aircraft_that_is_upright(axis: str, sign: float) -> None:
    for tilt_deg, allowed in ((TILT_DEG - 1.0, True), (TILT_DEG + 1.0, False), (nan, False)):
        vehicle = STILL._replace(**{axis: sign * radians(tilt_deg)})
        assert is_allowed(LAWS, modes.SOARING, estimates(vehicle)) == allowed


# --- a place to settle --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("standing", "excess_mps", "needed"),
    [
        ("TOO_LOW", -0.5, False),
        ("OUTSIDE", -0.5, False),
        ("TOO_LOW", 0.0, True),
        ("OUTSIDE", 0.5, True),
        ("TOO_SLOW", -0.5, True),
        ("TOO_FAST", -0.5, True),
        ("SETTLES", -0.5, True),
        ("UNKNOWN", -0.5, True),
    ],
)
def test_who_sinks_for_want_of_lift_needs_no_place_to_settle_while_there_is_power(
    standing: str, excess_mps: float, needed: bool
) -> None:
    """Against too much wind, or where it climbs out of the fence, power is no help."""
    ahead = NO_FORECAST._replace(standing=getattr(foreseen, standing), excess_mps=excess_mps)
    found = power_conditions(LAWS, modes.SOARING, NO_THROTTLE, ahead, GOOD)
    assert found == (0 if needed else modes.SETTLES)


@pytest.mark.parametrize(
    "without",
    [
        {"given": laws(0.0)},
        {"used_s": BUDGET_S - 0.1},
        {"mode": modes.RECOVERING},
        {"now": estimates(airspeed_mps=nan)},
        {"now": estimates(airspeed_mps=17.9)},  # the propeller has nothing left to give
        {"now": estimates(health=HEALTHY._replace(position_ok=False))},
        {"ahead": SINKS._replace(excess_mps=-5.0)},  # more than it could carry
    ],
)
def test_it_needs_one_where_power_cannot_carry_it(without: dict[str, Any]) -> None:
    def found(
        given: Laws = LAWS,
        mode: int = modes.SOARING,
        used_s: float = 0.0,
        ahead: Forecast = SINKS,
        now: Estimates = GOOD,
    ) -> int:
        return power_conditions(given, mode, NO_THROTTLE._replace(used_s=used_s), ahead, now)

    assert found() == modes.SETTLES
    assert found(**without) == 0


# --- what the throttle is given -----------------------------------------------------------------


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch) -> Callable[..., ThrottleView]:
    """What the throttle's law is given in a tick."""
    views: list[ThrottleView] = []
    part = power.throttle_step

    def listens(params: Any, state: Any, view: ThrottleView, dt_s: float) -> Any:
        views.append(view)
        return part(params, state, view, dt_s)

    monkeypatch.setattr(power, "throttle_step", listens)

    def given(
        mode: int = modes.SOARING,
        ahead: Forecast = SETTLES,
        way: LaunchLandingState = NO_LAUNCH_LANDING,
        now: Estimates = GOOD,
    ) -> ThrottleView:
        power_step(LAWS, NO_THROTTLE, mode, ahead, way, now, DT)
        return views[-1]

    return given


@pytest.mark.interpreted
def test_it_is_given_how_fast_one_that_soars_is_brought_back(
    view: Callable[..., ThrottleView],
) -> None:
    back = SETTLES._replace(slope_per_s=-1.2)
    assert view(ahead=back).returns_per_s == 1.2
    assert view(ahead=back._replace(excess_mps=-0.39)).returns_per_s == 1.2
    # An aircraft that sinks like that, or is driven away, or has no place, is not brought back.
    for lost in (
        back._replace(excess_mps=-0.41),
        back._replace(slope_per_s=0.3),
        back._replace(standing=foreseen.TOO_LOW),
        SETTLES,
        NO_FORECAST,
    ):
        assert view(ahead=lost).returns_per_s == 0.0


@pytest.mark.interpreted
def test_it_is_given_the_state_of_the_aircraft(view: Callable[..., ThrottleView]) -> None:
    now = estimates(STILL._replace(climb_mps=-0.7), airspeed_mps=8.25, clearance_m=4.0)
    shown = view(now=now)
    assert shown.allowed
    assert not view(mode=modes.HOLDING).allowed
    assert (shown.climb_mps, shown.airspeed_mps) == (-0.7, 8.25)
    assert shown.room_m == pytest.approx(4.0 - CLEAR_M)
    assert not shown.nowhere
    assert view(ahead=SINKS).nowhere


SHORT = escape(armed=True, left_m=-2.0)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("mode", "ahead", "way", "is_known"),
    [
        (modes.SOARING, SETTLES, SHORT, False),
        # A third of a glider's sink: what sinks by more does not soar, whatever is foreseen.
        (modes.SOARING, SETTLES._replace(excess_mps=-0.39), SHORT, False),
        (modes.SOARING, SETTLES._replace(excess_mps=-0.41), SHORT, True),
        (modes.SOARING, SINKS._replace(excess_mps=-0.1), SHORT, True),
        (modes.BREAKING_OFF, SETTLES, SHORT, True),
        (modes.BREAKING_OFF, SETTLES, escape(armed=False, left_m=-2.0), False),
        (modes.SOARING, SINKS, escape(armed=False, left_m=-2.0), False),
    ],
)
def test_the_height_for_the_way_home_is_for_who_goes_home_or_does_not_soar(
    view: Callable[..., ThrottleView],
    mode: int,
    ahead: Forecast,
    way: LaunchLandingState,
    is_known: bool,
) -> None:
    shown = view(mode, ahead, way)
    assert isnan(shown.home_m) != is_known
    assert isnan(shown.home_s) != is_known
    if is_known:
        assert shown.home_m == -2.0
        assert shown.home_s == power.time_left(way.escape)


def test_it_opens_for_want_of_lift_and_for_the_way_home() -> None:
    for ahead, way, called in (
        (SETTLES, NO_LAUNCH_LANDING, NOT_CALLED),
        (SINKS, NO_LAUNCH_LANDING, NOWHERE),
        (NO_FORECAST, SHORT, NOT_CALLED),
    ):
        after = power_step(LAWS, NO_THROTTLE, modes.SOARING, ahead, way, GOOD, DT)
        assert after.called == called
        assert (after.fraction > 0.0) == (called != NOT_CALLED)


@pytest.mark.parametrize(
    ("mode", "climb_mps", "called"),
    [
        (modes.SOARING, -0.3, NOT_CALLED),
        (modes.SOARING, -0.5, HOME),
        (modes.CAPTURING, -0.3, NOT_CALLED),
        (modes.BREAKING_OFF, 0.0, HOME),
    ],
)
def test_where_nothing_is_foreseen_it_goes_by_what_the_aircraft_does(
    mode: int, climb_mps: float, called: int
) -> None:
    """As for half a second after each gap of the position, and always with FC_ACT 0."""
    now = GOOD._replace(vehicle=GOOD.vehicle._replace(climb_mps=climb_mps))
    assert power_step(LAWS, NO_THROTTLE, mode, NO_FORECAST, SHORT, now, DT).called == called


def test_the_last_second_of_a_budget_is_power_yet() -> None:
    """What sinks by a tenth of a metre per second it holds for longer."""
    barely, short = SINKS._replace(excess_mps=-0.1), laws(0.9)
    found = power_conditions(short, modes.SOARING, NO_THROTTLE, barely, GOOD)
    assert found == modes.SETTLES


@pytest.mark.parametrize("budget_s", [0.0, 0.9, BUDGET_S])
def test_without_a_budget_it_stays_off(budget_s: float) -> None:
    way = NO_LAUNCH_LANDING
    after = power_step(laws(budget_s), NO_THROTTLE, modes.SOARING, SINKS, way, GOOD, DT)
    assert after.standing == (OPEN if budget_s else OFF)


# --- without control ----------------------------------------------------------------------------

RUNS = NO_THROTTLE._replace(
    standing=OPEN, called=NOWHERE, fraction=0.6, turns=0.5, push_mps2=1.2, climb_mps=0.8,
    pitch_rad=0.12, integral_mps=0.3, quiet_s=0.1, low_s=0.2, used_s=4.0,
)  # fmt: skip


@pytest.mark.parametrize(("armed", "used_s"), [(True, 4.0), (False, 0.0)])
def test_who_hands_over_closes_it_and_who_disarms_begins_another_flight(
    armed: bool, used_s: float
) -> None:
    """Nothing is left of its pull either: another pilot's throttle is not known."""
    assert power_off(LAWS, RUNS, inputs(armed=armed)) == NO_THROTTLE._replace(
        standing=CLOSED, used_s=used_s
    )


def test_a_budget_that_was_used_up_is_new_once_disarmed() -> None:
    spent = RUNS._replace(used_s=BUDGET_S)
    assert power_off(LAWS, spent, inputs(armed=True)).standing == USED_UP
    again = power_off(LAWS, spent, inputs(armed=False))
    assert (again.standing, again.used_s) == (CLOSED, 0.0)


# --- what the others are given ------------------------------------------------------------------


def test_the_air_is_read_without_the_propeller_s_pull() -> None:
    pushed = with_push(LAWS, RUNS)
    assert (pushed.wind.push_mps2, pushed.forecast.pushed_mps) == (1.2, 0.8)
    assert pushed._replace(wind=LAWS.wind, forecast=LAWS.forecast) == LAWS
    assert with_push(LAWS, NO_THROTTLE) is LAWS


def test_the_pitch_that_holds_the_line_and_its_upper_limit_are_turned_up() -> None:
    """At the same incidence; no other limit is."""
    gains, effect = LAWS.soaring, BrakeEffect(0.01, -0.2)
    up, turned = with_power(gains, effect, RUNS)
    assert up.pid.output_max == pytest.approx(gains.pid.output_max + 0.12)
    assert up.pid._replace(output_max=gains.pid.output_max) == gains.pid
    assert up.slew_radps == gains.slew_radps
    assert turned == pytest.approx((0.13, -0.2))
    assert with_power(gains, effect, NO_THROTTLE) == (gains, effect)

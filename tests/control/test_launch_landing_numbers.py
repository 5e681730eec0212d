"""Way home and beating in the place of what would end a flight; the line of a launch; and what
these modes ask of pitch, bank and heading."""

from __future__ import annotations

from math import atan, cos, degrees, isnan, nan, pi, radians, sin
from typing import Any, NamedTuple

import pytest
from test_launch_landing import (
    AERO,
    DT,
    ETA,
    HERE,
    LAWS,
    LINE,
    NOW_S,
    ON_LINE,
    RECOVER_S,
    VEHICLE,
    asked_of,
    at_hand,
    homeward,
    launched,
    laws_with,
    way,
    with_health,
)

from tgl_soar.control import landing, launch
from tgl_soar.control import supervisor as modes
from tgl_soar.control.airspeed_hold import NO_GLIDE, GlideSetpoints
from tgl_soar.control.envelope import Limited, unlimited
from tgl_soar.control.estimates import Estimates
from tgl_soar.control.landing import slowest_known
from tgl_soar.control.launch_landing import (
    NO_LAUNCH_LANDING,
    LaunchLandingState,
    Lull,
    flies_no_line,
    is_in_hand,
    launch_line,
    loops_in_hand,
    most_trim_alpha,
    phase_guide,
    phase_report,
    starts_line,
    turning_bank,
    with_way_home,
)
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidState, PidTerms
from tgl_soar.control.ridge_beat import NO_BEAT
from tgl_soar.control.soaring import SoaringState
from tgl_soar.control.supervisor import initial_supervisor
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.control.surface_loops import LoopsState
from tgl_soar.control.target_line import LineState
from tgl_soar.estimation.aerodynamics import glide_alpha, glide_pitch
from tgl_soar.types import NO_AERODYNAMICS, OURS, THEIRS, THEIRS_WITH_RUDDER, SurfaceCommand

# --- in the place of what would end a flight ----------------------------------------------------

FLOWN = modes.SETTLES | modes.NEAR_LINE


def added(
    mode: int = modes.SOARING,
    found: int = FLOWN,
    slow_s: float = 0.0,
    low_s: float = 0.0,
    oblique_s: float = 0.0,
    since_s: float = NOW_S - 9.0,
    now: Estimates = HERE,
    state: LaunchLandingState | None = None,
    **changes: float,
) -> int:
    """What with_way_home adds to the conditions."""
    supervisor = initial_supervisor()._replace(mode=mode, since_s=since_s)
    state = homeward() if state is None else state
    state = state._replace(lull=Lull(slow_s, low_s), beat=NO_BEAT._replace(oblique_s=oblique_s))
    return with_way_home(laws_with(**changes), supervisor, state, now, found) & ~found


HOME: dict[str, Any] = {"ESC_AUTO": 1.0}
BEATS: dict[str, Any] = {"BEAT_AUTO": 2.0}


@pytest.mark.parametrize("mode", range(len(MODE_NAMES)), ids=MODE_NAMES)
def test_a_line_that_is_given_up_is_left_for_home(mode: int) -> None:
    gone = modes.BREAK_OFF if mode in ON_LINE else 0
    assert added(mode, modes.NEAR_LINE, since_s=NOW_S, **HOME) == gone
    assert added(mode, modes.SETTLES, since_s=NOW_S, **HOME) == gone
    assert added(mode, since_s=NOW_S, **HOME) == 0


@pytest.mark.parametrize(
    "without",
    [
        {"ESC_AUTO": 0.0},
        {"ESC_START": 2.0},
        {"state": homeward(armed=False)},
        {"state": homeward(left_m=-0.1)},
        {"state": homeward(left_m=nan)},
        {"now": with_health(position_ok=False)},
    ],
)
def test_it_goes_home_only_where_it_may_and_can(without: dict[str, Any]) -> None:
    assert added(found=modes.SETTLES, **{**HOME, **without}) == 0
    assert added(found=modes.SETTLES, state=homeward(left_m=0.0), **HOME) == modes.BREAK_OFF


@pytest.mark.parametrize(
    ("lasted", "goes"),
    [
        ({"slow_s": 1.99}, False),
        ({"slow_s": 2.0}, True),
        ({"low_s": 0.29}, False),
        ({"low_s": 0.3}, True),
        ({"mode": modes.RECOVERING, "since_s": NOW_S - 0.49 * RECOVER_S}, False),
        ({"mode": modes.RECOVERING, "since_s": NOW_S - 0.51 * RECOVER_S}, True),
        ({"mode": modes.HOLDING, "since_s": NOW_S - 9.0}, False),
    ],
)
def test_what_lasts_sends_it_home(lasted: dict[str, Any], goes: bool) -> None:
    assert added(**lasted, **HOME) == (modes.BREAK_OFF if goes else 0)


@pytest.mark.parametrize(
    ("what", "beats"),
    [
        ({"slow_s": 2.0}, True),
        ({"slow_s": 1.99}, False),
        ({"slow_s": 1.0, "found": modes.SETTLES}, True),  # it falls off its line meanwhile
        ({"slow_s": 0.99, "found": modes.SETTLES}, False),
        ({"oblique_s": 5.0}, True),
        ({"oblique_s": 4.99}, False),
        ({"oblique_s": 5.0, "mode": modes.HOLDING}, False),
        ({"slow_s": 2.0, "low_s": 0.3}, False),  # it sinks: there is no lift to beat in
        ({"slow_s": 2.0, "now": at_hand(clearance_m=5.9)}, False),
        ({"slow_s": 2.0, "BEAT_AUTO": 0.0}, False),
    ],
)
def test_where_it_cannot_stand_it_beats(what: dict[str, Any], beats: bool) -> None:
    assert added(**{**BEATS, **what}) == (modes.BEAT if beats else 0)


def test_where_it_may_do_either_it_beats() -> None:
    assert added(slow_s=2.0, **HOME, **BEATS) == modes.BEAT
    assert added(slow_s=2.0, low_s=0.3, **HOME, **BEATS) == modes.BREAK_OFF
    assert added(found=modes.SETTLES, **HOME, **BEATS) == modes.BREAK_OFF


# --- the line of a launch -----------------------------------------------------------------------

GLIDES = launched(launch.GLIDING, NOW_S)


def test_a_line_to_be_launched_on_starts_at_the_aircraft_with_its_speed_across() -> None:
    moving = VEHICLE._replace(velocity_x_mps=-2.0, climb_mps=0.5)
    begun = launch_line(LAWS, GLIDES, LINE, moving, DT)
    assert (begun.x_m, begun.z_m, begun.eta_rad) == (VEHICLE.x_m, VEHICLE.z_m, ETA)
    assert begun.speed_mps == pytest.approx(2.0 * sin(ETA) + 0.5 * cos(ETA))
    assert begun.moving
    assert starts_line(GLIDES, moving)


def test_then_it_slides_to_the_target_as_a_launch_s_line_does() -> None:
    later = VEHICLE._replace(time_s=NOW_S + DT)
    laws = laws_with(LNC_SLEW=0.6, LNC_ACCEL=1.5, TGL_X=-9.0)
    away = LINE._replace(speed_mps=0.6, moving=True)
    slid = launch_line(laws, GLIDES, away, later, DT)
    assert not starts_line(GLIDES, later)
    moved_m = upstream_m(slid, away)
    assert moved_m == pytest.approx(0.6 * DT, rel=1e-3)


def upstream_m(after: LineState, before: LineState) -> float:
    """How far a line has moved upstream across itself [m]."""
    return -sin(ETA) * (after.x_m - before.x_m) + cos(ETA) * (after.z_m - before.z_m)


@pytest.mark.parametrize("standing", [launch.IDLE, launch.HELD, launch.THROWN, launch.REACHED])
def test_no_other_tick_moves_it(standing: int) -> None:
    assert launch_line(LAWS, launched(standing, NOW_S), LINE, VEHICLE, DT) is LINE


@pytest.mark.parametrize("mode", range(len(MODE_NAMES)), ids=MODE_NAMES)
def test_a_line_is_flown_but_on_the_way_home_beating_or_before_a_launch_glides(mode: int) -> None:
    name = MODE_NAMES[mode]
    for standing in range(launch.FAR + 1):
        line_less = name in ("breaking off", "landing", "beating")
        if name == "launching":
            line_less = standing not in (launch.GLIDING, launch.REACHED)
        assert flies_no_line(mode, launched(standing)) == line_less


def test_whether_it_is_in_the_hand_is_known_from_the_launch() -> None:
    assert is_in_hand(launched(launch.HELD))
    assert not is_in_hand(launched(launch.THROWN))
    assert not is_in_hand(NO_LAUNCH_LANDING)


def test_what_is_shown_of_a_tick() -> None:
    state = homeward(left_m=6.0, rate_mps=-0.5)._replace(launch=launched(launch.THROWN).launch)
    assert phase_report(state) == pytest.approx((2, 6.0, 12.0))
    nothing = phase_report(NO_LAUNCH_LANDING)
    assert nothing.launch == 0
    assert isnan(nothing.height_left_m)
    assert isnan(nothing.time_left_s)
    assert pi / 2.0 < ETA < pi  # the line of these tests leans upstream


# --- pitch, bank and heading --------------------------------------------------------------------

TICK_S = 0.25  # long enough for the pitch to be there: PITCH_SLEW is 120 degrees a second
LEVEL = SoaringState(PidState(0.0, 0.0), 0.0, 0)
AT_REST = PidState(0.0, 0.0)
FREE = unlimited(SurfaceCommand(0.0, 0.0, 0.0, 0.0))


class Guided(NamedTuple):
    """What a tick asks for."""

    state: LaunchLandingState
    soaring: SoaringState
    terms: PidTerms
    sideways: PidState
    bank: PidTerms
    heading_rad: float


def guided(
    mode: int,
    state: LaunchLandingState = NO_LAUNCH_LANDING,
    now: Estimates = HERE,
    laws: Laws = LAWS,
    soaring: SoaringState = LEVEL,
    limited: Limited = FREE,
) -> Guided:
    return Guided._make(phase_guide(laws, state, mode, now, soaring, AT_REST, limited, TICK_S))


def flying_at(airspeed_mps: float, **changes: Any) -> Estimates:
    return at_hand(VEHICLE._replace(**changes), air=HERE.air._replace(airspeed_mps=airspeed_mps))


@pytest.mark.parametrize(("airspeed_mps", "pitch_deg"), [(7.9, -5.0), (8.1, 4.0), (nan, 4.0)])
def test_a_launch_holds_its_pitch_and_the_glide_s_while_it_is_slow(
    airspeed_mps: float, pitch_deg: float
) -> None:
    """Slower than the best glide the nose is no higher than that one's."""
    laws = laws_with(LNC_PITCH=4.0, REC_PITCH=-5.0, DYN_BEST=8.0)
    found = guided(modes.LAUNCHING, launched(launch.THROWN), flying_at(airspeed_mps), laws)
    assert found.soaring.pitch_setpoint_rad == pytest.approx(radians(pitch_deg), abs=1e-6)


def test_a_launch_that_dives_as_commanded_stays_so_where_it_is_slow() -> None:
    laws = laws_with(LNC_PITCH=-8.0, REC_PITCH=-5.0, DYN_BEST=8.0)
    found = guided(modes.LAUNCHING, launched(launch.THROWN), flying_at(7.0), laws)
    assert found.soaring.pitch_setpoint_rad == pytest.approx(radians(-8.0), abs=1e-6)


def test_a_launch_has_its_wings_level_and_its_nose_to_the_waypoint() -> None:
    laws = laws_with(WPT_X=-25.0)
    found = guided(modes.LAUNCHING, launched(launch.THROWN), flying_at(9.0, y_m=4.0), laws)
    assert found.heading_rad == pytest.approx(-atan(4.0 / 20.0))
    assert found.bank.output == 0.0
    assert found.state == launched(launch.THROWN)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("mode", [modes.BREAKING_OFF, modes.LANDING])
def test_on_the_way_home_the_bank_takes_it_to_its_track(mode: int, side: float) -> None:
    """From where it is carried aside it comes back, by SIDE_P for each metre per second."""
    laws = laws_with(SIDE_P=0.1, SIDE_I=0.0, SIDE_BANK=30.0)
    air = HERE.air._replace(measured=True)
    carried = at_hand(VEHICLE._replace(velocity_y_mps=0.5 * side), air=air)
    found, on_track = (guided(mode, now=now, laws=laws) for now in (carried, at_hand(air=air)))
    filtered = 20.0 * TICK_S / (1.0 + 20.0 * TICK_S)  # of the error, in a tick
    back = found.bank.output - on_track.bank.output
    assert back == pytest.approx(-0.1 * 0.5 * side * filtered)


def test_a_bank_that_the_aileron_cannot_follow_is_not_learnt_from() -> None:
    carried = flying_at(9.0, velocity_y_mps=-0.5)
    laws = laws_with(SIDE_I=0.1, SIDE_BANK=30.0)
    free = guided(modes.LANDING, now=carried, laws=laws)
    blocked = guided(
        modes.LANDING, now=carried, laws=laws, limited=FREE._replace(aileron_blocked=1)
    )
    assert free.sideways.integral > 0.0
    assert blocked.sideways.integral == 0.0


@pytest.mark.parametrize(
    "levels",
    [
        {"now": with_health(position_ok=False)._replace(vehicle=VEHICLE)},
        {"laws": LAWS._replace(loops=THEIRS)},
    ],
)
@pytest.mark.parametrize("mode", [modes.LANDING, modes.BEATING])
def test_blind_or_with_a_firmware_that_turns_its_wings_are_held_level(
    mode: int, levels: dict[str, Any]
) -> None:
    found = guided(mode, **levels)
    assert (found.sideways, found.bank.output) == (AT_REST, 0.0)


@pytest.mark.parametrize(("loops", "banks"), [(OURS, True), (THEIRS_WITH_RUDDER, True)])
def test_who_is_banked_by_us_is_banked(loops: int, banks: bool) -> None:
    carried = flying_at(9.0, velocity_y_mps=0.5)
    found = guided(modes.LANDING, now=carried, laws=LAWS._replace(loops=loops))
    assert (found.bank.output != 0.0) == banks


@pytest.mark.parametrize("side_bank_deg", [10.0, 25.0])
def test_beating_banks_by_eighteen_degrees_or_what_is_allowed_if_more(
    side_bank_deg: float,
) -> None:
    """Half of TILT_MAX at most: gusts and overshoots have the other half."""
    carried = flying_at(9.0, velocity_y_mps=-30.0)
    for tilt_deg, most_deg in ((60.0, 18.0), (30.0, 15.0)):
        laws = laws_with(SIDE_BANK=side_bank_deg, SIDE_P=1.0, TILT_MAX=tilt_deg)
        most = max(side_bank_deg, most_deg)
        to_right = guided(modes.BEATING, now=carried, laws=laws).bank.output
        assert degrees(to_right) == pytest.approx(most)
        other = flying_at(9.0, velocity_y_mps=30.0)
        to_left = guided(modes.BEATING, now=other, laws=laws).bank.output
        assert degrees(to_left) == pytest.approx(-most)
        straight = guided(modes.LANDING, now=carried, laws=laws).bank.output
        assert degrees(straight) == pytest.approx(side_bank_deg)


@pytest.mark.interpreted
@pytest.mark.parametrize(("steeper", "bank_deg"), [(0.0, 10.0), (0.2, 12.0), (0.5, 15.0)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_weave_that_may_be_steeper_banks_by_so_much_more_to_either_side(
    monkeypatch: pytest.MonkeyPatch, steeper: float, bank_deg: float, side: float
) -> None:
    setpoints = GlideSetpoints(0.0, 0.0, 30.0 * side, steeper)
    monkeypatch.setattr(way, "glide_setpoints", lambda *_: setpoints)
    found = guided(modes.LANDING, laws=laws_with(SIDE_BANK=10.0, SIDE_P=1.0))
    assert degrees(found.bank.output) == pytest.approx(side * bank_deg)


@pytest.mark.parametrize("mode", [modes.SOARING, modes.BEATING])
def test_a_firmware_that_turns_is_given_a_bank_by_the_heading(mode: int) -> None:
    laws = laws_with(BANK_P=0.8, BANK_MAX=12.0, TILT_MAX=60.0)
    most_deg = 18.0 if mode == modes.BEATING else 12.0
    assert turning_bank(laws, mode, 0.3, 0.2) == pytest.approx(0.08)
    assert degrees(turning_bank(laws, mode, 1.5, 0.0)) == pytest.approx(most_deg)
    assert degrees(turning_bank(laws, mode, -1.5, 0.0)) == pytest.approx(-most_deg)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("mode", "part", "outward"),
    [
        (modes.BREAKING_OFF, "glide_step", True),
        (modes.LANDING, "glide_step", False),
        (modes.BEATING, "beat_step", None),
    ],
)
def test_each_glide_is_given_what_it_needs(
    monkeypatch: pytest.MonkeyPatch, mode: int, part: str, outward: bool | None
) -> None:
    asked = asked_of(monkeypatch, part)
    state = homeward()._replace(glide=NO_GLIDE._replace(speed_mps=8.8))
    guided(mode, state, at_hand(clearance_m=7.0))
    ((given, named),) = asked
    assert (named["vehicle"], named["air"], named["dt_s"]) == (VEHICLE, HERE.air, TICK_S)
    if part == "glide_step":
        assert given == (LAWS.landing, state.glide, outward, True)
        assert named["clearance_m"] == 7.0
    else:
        assert given == (LAWS.beat, LAWS.landing, LAWS.target, state.glide)
        assert named["position_ok"]
        assert named["returns"]  # it was not asked for
    lost = with_health(position_ok=False)
    guided(mode, state, lost)
    given, named = asked[1]
    assert not (given[3] if part == "glide_step" else named["position_ok"])


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("below_rad", "blocked", "held"),
    [(0.036, 1, True), (0.034, 1, False), (0.036, 0, False), (0.036, -1, False)],
)
def test_a_nose_is_held_two_degrees_below_its_setpoint_with_all_of_the_elevator(
    monkeypatch: pytest.MonkeyPatch, below_rad: float, blocked: int, held: bool
) -> None:
    for mode, part in ((modes.LANDING, "glide_step"), (modes.BEATING, "beat_step")):
        with monkeypatch.context() as patch:
            asked = asked_of(patch, part)
            soaring = LEVEL._replace(pitch_setpoint_rad=0.1)
            now = at_hand(VEHICLE._replace(pitch_rad=0.1 - below_rad))
            guided(mode, now=now, soaring=soaring, limited=FREE._replace(elevator_blocked=blocked))
            assert asked[0][1]["nose_held"] == held


@pytest.mark.interpreted
@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize(
    ("mode", "part"), [(modes.LANDING, "glide_setpoints"), (modes.BEATING, "beat_setpoints")]
)
def test_the_pitches_are_those_of_steady_glides(
    monkeypatch: pytest.MonkeyPatch, mode: int, part: str, measured: bool
) -> None:
    """Of the setpoint within the polar, of the slowest glide, and of the polar's fast end; and the
    angle of attack that the elevator may hold."""
    asked = asked_of(monkeypatch, part)
    laws = laws_with(ELE_TRIM=0.08, DYN_BEST=9.25)
    polar = laws.landing.polar
    stepped = "glide_step" if part == "glide_setpoints" else "beat_step"
    for speed in (polar.speed_min_mps - 1.0, 9.5, polar.speed_max_mps + 1.0):
        glide = NO_GLIDE._replace(speed_mps=9.5)
        monkeypatch.setattr(way, stepped, lambda *_, speed=speed, glide=glide, **__: (glide, speed))
        now = at_hand(air=HERE.air._replace(measured=measured))
        found = guided(mode, now=now, laws=laws)
        assert found.state.glide == glide
        pitches = asked[-1][0][3 if part == "beat_setpoints" else 4]
        within = min(max(speed, polar.speed_min_mps), polar.speed_max_mps)
        slowest = slowest_known(laws.landing, measured)
        steady = [glide_pitch(AERO, each) for each in (within, slowest, polar.speed_max_mps)]
        most = most_trim_alpha(AERO, 0.08, laws.landing)
        assert most > glide_alpha(AERO, landing.slowest(laws.landing))
        assert pitches == pytest.approx([*steady, most])


def test_what_the_elevator_may_hold_allows_for_moments_that_read_too_high_at_its_trim() -> None:
    """A file whose moments and trim agree allows the slowest approach's angle of attack; where the
    trim needs more elevator than the moments say, it is read as more incidence, and allowed."""
    home = LAWS.landing._replace(best_glide_mps=9.25)
    slowest, best = (
        glide_alpha(AERO, speed) for speed in (landing.slowest(home), home.best_glide_mps)
    )
    agrees = -(AERO.Cm0 + AERO.Cm_alpha * best) / AERO.Cm_elevator
    assert most_trim_alpha(AERO, agrees, home) == pytest.approx(slowest)
    more = agrees - 0.05 * AERO.Cm_alpha / AERO.Cm_elevator
    assert most_trim_alpha(AERO, more, home) == pytest.approx(slowest + 0.05)
    less = agrees + 0.05 * AERO.Cm_alpha / AERO.Cm_elevator
    assert most_trim_alpha(AERO, less, home) == pytest.approx(slowest)
    assert isnan(most_trim_alpha(NO_AERODYNAMICS, 0.0, home))


def test_the_pitch_is_approached_by_the_slew_rate() -> None:
    found = guided(modes.LAUNCHING, launched(launch.THROWN), laws=laws_with(PITCH_SLEW=4.0))
    assert found.soaring.pitch_setpoint_rad == pytest.approx(radians(4.0) * TICK_S)


def test_in_a_hand_the_loops_have_learnt_nothing_and_know_how_it_turns() -> None:
    """A derivative that begins at the present rate makes no step; the last command stays."""
    turning = VEHICLE._replace(roll_rate_radps=0.3, pitch_rate_radps=-0.2, heading_rate_radps=0.1)
    learnt = PidState(0.4, 9.0)
    before = LoopsState(
        pitch=learnt, roll=learnt, heading=learnt, limited=FREE, pitch_setpoint_rad=0.1
    )
    pitch_setpoint_rad = before.pitch_setpoint_rad
    loops = loops_in_hand(before, turning)
    assert loops.pitch_setpoint_rad != loops.pitch_setpoint_rad  # none was followed
    assert loops._replace(pitch_setpoint_rad=pitch_setpoint_rad) == LoopsState(
        pitch=PidState(0.0, 0.2),
        roll=PidState(0.0, -0.3),
        heading=PidState(0.0, -0.1),
        limited=FREE,
        pitch_setpoint_rad=pitch_setpoint_rad,
    )

"""The conditions that the supervisor's table is fed with, on both sides of each limit."""

from __future__ import annotations

from math import inf, nan, pi, radians
from typing import Any

import pytest
from samples import STILL

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control import conditions as c
from tgl_soar.control import excitation as x
from tgl_soar.control import forecast as f
from tgl_soar.control import laws as w
from tgl_soar.control import supervisor as s
from tgl_soar.control.envelope import MARGIN_FULL, OUT_SIDE, Margins
from tgl_soar.control.laws import laws_from
from tgl_soar.control.pid import PidState
from tgl_soar.control.soaring import SoaringState
from tgl_soar.control.target_line import LineState, LineTracking, eta_from_lean
from tgl_soar.estimation import health as h
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    NO_AIR,
    NO_ATTITUDE,
    NO_FIX,
    STEPPED_SOURCE,
    AutopilotStatus,
    Health,
    Inputs,
    MotionQuality,
)

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
LAWS = laws_from(VALUES, SoaringFrame(0.0, 0.0, 0.0, 0.0), AIRFRAME.aerodynamics())
GUARDS = LAWS.guards._replace(
    position_age_max_s=1.0, position_sd_max_m=0.2, reckoned_max_s=5.0, recover_s=4.0
)
SOUND = Health(
    position_age_s=0.1,
    attitude_age_s=0.0,
    heartbeat_age_s=0.0,
    position_ok=True,
    attitude_ok=True,
    autopilot_ok=True,
    rejected=0,
    position_interval_s=0.02,
    position_jitter_s=0.0,
    attitude_interval_s=0.005,
    attitude_jitter_s=0.0,
    gaps=0,
    surfaces_answer=1,
    faults=0,
)
NOUGHT: dict[str, Any] = dict.fromkeys(MotionQuality._fields, 0)
CONFIDENT = MotionQuality(**NOUGHT)._replace(position_sigma_m=0.1, inertial=True, jumped=False)
LEVEL = STILL._replace(time_s=50.0, z_m=10.0)
CLEAR = Margins(stall_rad=0.2, clearance_m=20.0, outside=0)


@pytest.mark.parametrize(
    ("health", "quality", "known"),
    [
        ({}, {}, True),
        ({}, {"position_sigma_m": 0.59}, True),  # young: three times as uncertain is enough
        ({}, {"position_sigma_m": 0.61}, False),
        ({}, {"jumped": True}, False),
        ({"position_ok": False}, {}, True),  # carried on by accelerations
        ({"position_ok": False}, {"inertial": False}, False),
        ({"position_ok": False}, {"position_sigma_m": 0.21}, False),
        ({"position_ok": False, "position_age_s": 1.1}, {}, False),
        ({"position_ok": False, "faults": h.FROZEN}, {}, True),  # what is frozen is not taken in
        ({"position_ok": False, "faults": h.FROZEN}, {"source": STEPPED_SOURCE}, False),
        ({"position_ok": False, "faults": h.GAP}, {"source": STEPPED_SOURCE}, True),
        ({"position_ok": False, "faults": h.GAP}, {}, True),
        ({"position_ok": False}, {"position_sigma_m": nan}, False),
    ],
)
def test_whether_the_place_is_known(
    health: dict[str, Any], quality: dict[str, Any], known: bool
) -> None:
    sound, found = SOUND._replace(**health), CONFIDENT._replace(**quality)
    assert c.is_place_known(GUARDS, sound, found, flying=True) == known
    assert c.with_uncertainty(GUARDS, sound, found, flying=True).position_ok == known
    # Without control what is frozen is taken in, from any source.
    frozen = bool(sound.faults & h.FROZEN)
    assert c.is_place_known(GUARDS, sound, found, flying=False) == (known and not frozen)


@pytest.mark.parametrize(("reckoned_s", "confident"), [(0.0, True), (4.9, True), (5.1, False)])
def test_what_is_only_reckoned_is_flown_with_for_a_time(reckoned_s: float, confident: bool) -> None:
    found = c.with_uncertainty(
        GUARDS, SOUND, CONFIDENT._replace(reckoned_s=reckoned_s), flying=True
    )
    assert found.position_ok == confident


def inputs(**status: Any) -> Inputs:
    usual = AutopilotStatus(time_s=50.0, accepts_surfaces=True, armed=True)
    return Inputs(
        time_s=50.0,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=usual._replace(**status),
        engage=True,
    )


ALL = (
    s.ENGAGE
    | s.STREAMS_ARRIVED
    | s.POSITION_FRESH
    | s.POSITION_KEPT
    | s.POSITION_SANE
    | s.ATTITUDE_FRESH
    | s.ATTITUDE_AGREES
    | s.AIRSPEED_SANE
    | s.AUTOPILOT_ALIVE
    | s.NO_FAILSAFE
    | s.SURFACES_OBEY
    | s.SURFACES_ANSWER
)


@pytest.mark.parametrize(
    ("health", "status", "confident_s", "lacks"),
    [
        ({}, {}, 49.9, 0),
        ({}, {}, 48.9, s.POSITION_KEPT),
        ({}, {}, nan, s.POSITION_KEPT),
        ({}, {}, 51.0, s.POSITION_KEPT),  # the clock has gone back
        ({"position_age_s": 1.1}, {}, 49.9, s.POSITION_KEPT),
        ({"position_age_s": inf}, {}, 49.9, s.STREAMS_ARRIVED | s.POSITION_KEPT),
        ({"attitude_age_s": inf}, {}, 49.9, s.STREAMS_ARRIVED),
        ({"heartbeat_age_s": inf}, {}, 49.9, s.STREAMS_ARRIVED),
        ({"position_ok": False}, {}, 49.9, s.POSITION_FRESH),
        ({"attitude_ok": False}, {}, 49.9, s.ATTITUDE_FRESH),
        ({"autopilot_ok": False}, {}, 49.9, s.AUTOPILOT_ALIVE),
        ({"faults": h.JUMP}, {}, 49.9, s.POSITION_SANE),
        ({"faults": h.RECKONED}, {}, 49.9, s.POSITION_SANE),
        ({"faults": h.GAP | h.BRAKE | h.RANGE}, {}, 49.9, 0),
        ({"faults": h.DISAGREES}, {}, 49.9, s.ATTITUDE_AGREES),
        ({"faults": h.AIRSPEED}, {}, 49.9, s.AIRSPEED_SANE),
        ({"surfaces_answer": 0}, {}, 49.9, s.SURFACES_ANSWER),
        ({"surfaces_answer": -1}, {}, 49.9, 0),  # unknown
        ({}, {"failsafe": True}, 49.9, s.NO_FAILSAFE),
        ({}, {"accepts_surfaces": False}, 49.9, s.SURFACES_OBEY),
    ],
)
def test_what_holds_of_the_streams(
    health: dict[str, Any], status: dict[str, Any], confident_s: float, lacks: int
) -> None:
    found = c.stream_conditions(GUARDS, inputs(**status), SOUND._replace(**health), confident_s)
    assert found == ALL & ~lacks
    asleep = inputs(**status)._replace(engage=False)
    assert not c.stream_conditions(GUARDS, asleep, SOUND, confident_s) & s.ENGAGE


def test_a_blind_glide_lasts_since_the_fix_or_since_it_recovers() -> None:
    recovering = s.initial_supervisor()._replace(mode=s.RECOVERING, since_s=48.0)
    blind = SOUND._replace(position_ok=False, position_age_s=1.5)
    assert c.blind_glide_s(recovering, blind, 50.0) == 1.5
    assert c.blind_glide_s(recovering, blind._replace(position_age_s=9.0), 50.0) == 2.0
    assert c.blind_glide_s(recovering, blind, 47.0) == 0.0
    assert c.blind_glide_s(recovering, SOUND, 50.0) == 0.0
    assert c.blind_glide_s(recovering._replace(mode=s.SOARING), blind, 50.0) == 0.0


def test_what_is_not_seen_to_sink_counts_as_lost() -> None:
    """A glide sinks by its speed over its glide ratio: what of that is not in the estimate."""
    schedule = LAWS.schedule._replace(drag=0.5 / 8.0, best_glide_mps=10.0)
    laws = LAWS._replace(schedule=schedule)
    assert c.blind_sink_m(laws, LEVEL, 2.0) == pytest.approx(2.0 * 10.0 / 8.0)
    sinking = LEVEL._replace(climb_mps=-0.5)
    assert c.blind_sink_m(laws, sinking, 2.0) == pytest.approx(2.0 * (1.25 - 0.5))
    assert c.blind_sink_m(laws, LEVEL._replace(climb_mps=-1.3), 2.0) == 0.0
    assert c.blind_sink_m(laws, LEVEL._replace(climb_mps=nan), 2.0) == 0.0
    clear_m = LAWS.envelope.clearance_min_m
    high = CLEAR._replace(clearance_m=clear_m + 2.4)
    assert c.flight_conditions(laws, LEVEL, high, 0.0) & s.HIGH_ENOUGH
    assert c.flight_conditions(laws, LEVEL, high, 1.9) & s.HIGH_ENOUGH
    assert not c.flight_conditions(laws, LEVEL, high, 2.0) & s.HIGH_ENOUGH


@pytest.mark.parametrize("angle", ["roll_rad", "pitch_rad"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_upright_and_upwind(angle: str, sign: float) -> None:
    most = LAWS.guards.tilt_max_rad
    for turned, upright in ((0.99 * most, True), (1.01 * most, False)):
        vehicle = LEVEL._replace(**{angle: sign * turned})
        assert bool(c.flight_conditions(LAWS, vehicle, CLEAR) & s.UPRIGHT) == upright
    for turned, upwind in ((0.49 * pi, True), (0.51 * pi, False)):
        vehicle = LEVEL._replace(heading_rad=sign * turned)
        assert bool(c.flight_conditions(LAWS, vehicle, CLEAR) & s.UPWIND) == upwind
    inside = c.flight_conditions(LAWS, LEVEL, CLEAR)
    assert inside & s.INSIDE_FENCE
    assert not c.flight_conditions(LAWS, LEVEL, CLEAR._replace(outside=OUT_SIDE)) & s.INSIDE_FENCE


def test_the_line_is_near_within_its_limit_on_both_sides() -> None:
    most = LAWS.guards.e_rho_max_m
    for sign in (-1.0, 1.0):
        assert c.line_conditions(LAWS.guards, sign * 0.99 * most, False, False) == s.NEAR_LINE
        assert c.line_conditions(LAWS.guards, sign * 1.01 * most, False, False) == 0
    assert c.line_conditions(LAWS.guards, 0.0, True, True) == (
        s.NEAR_LINE | s.ON_LINE | s.LINE_MOVING
    )


def test_a_line_needs_an_upstream_side_and_a_place_inside_the_fence() -> None:
    assert c.target_conditions(LAWS) == s.LINE_VALID
    for lean_deg, valid in ((84.0, True), (85.0, False), (-84.0, True)):
        target = LAWS.target._replace(eta_rad=eta_from_lean(radians(lean_deg)))
        assert c.line_valid(LAWS._replace(target=target)) == valid, lean_deg
    fence = LAWS.fence._replace(x_min_m=LAWS.target.x_m + 0.1)
    assert not c.line_valid(LAWS._replace(fence=fence))


@pytest.mark.parametrize("mode", range(s.BEATING + 1))
def test_a_jump_near_the_line_is_unsettled_in_a_young_mode_on_it_alone(mode: int) -> None:
    """A fifth of a second is the least that a mode on the line lasts."""
    line = LineState(x_m=0.0, z_m=10.0, eta_rad=0.5 * pi, speed_mps=0.0, moving=False)
    most = GUARDS.e_rho_max_m

    def unsettled(since_s: float = 49.9, off_m: float = 0.0, jump_s: float = 50.0) -> bool:
        flown = s.initial_supervisor()._replace(mode=mode, since_s=since_s)
        return c.jumps_unsettled(GUARDS, flown, line, LEVEL._replace(x_m=off_m), jump_s)

    on_it = mode in (s.CAPTURING, s.SOARING, s.SEARCHING)
    assert unsettled() is on_it
    assert unsettled(49.81) is on_it
    assert not unsettled(49.79)
    for sign in (1.0, -1.0):
        assert unsettled(off_m=0.99 * sign * most) is on_it
        assert not unsettled(off_m=1.01 * sign * most)
    assert not unsettled(jump_s=49.99)  # it was before
    assert not unsettled(jump_s=nan)


@pytest.mark.parametrize("mode", range(s.BEATING + 1))
def test_what_is_foreseen_is_of_a_line_that_is_flown(mode: int) -> None:
    """In other modes it is reset."""
    line = LineState(x_m=0.0, z_m=10.0, eta_rad=1.8, speed_mps=0.0, moving=False)
    feels = NO_AIR._replace(wind_mps=9.0, wind_sigma_mps=0.2, updraft_mps=0.8, airspeed_mps=9.0)
    laws = LAWS._replace(forecast=LAWS.forecast._replace(act=f.REPORT))
    state = f.initial_forecast()
    for n in range(3):
        vehicle = LEVEL._replace(time_s=50.0 + 0.01 * n)
        state = c.forecast_of(laws, mode, state, line, vehicle, feels, CONFIDENT)
    follows = mode in (s.CAPTURING, s.SOARING, s.SEARCHING)
    assert (repr(state) != repr(f.initial_forecast())) is follows


def doomed(ahead_s: float = 3.0) -> f.Forecast:
    return f.NO_FORECAST._replace(standing=f.TOO_LOW, ahead_s=ahead_s, chance=0.0)


@pytest.mark.parametrize(
    ("mode", "act", "search", "ahead_s", "settles"),
    [
        (s.SOARING, f.OFF, w.SEARCH_OFF, 0.1, True),
        (s.SOARING, f.REPORT, w.SEARCH_OFF, 0.1, True),
        (s.SOARING, f.DISENGAGE, w.SEARCH_OFF, 3.0, True),  # the last moment is waited for
        (s.SOARING, f.DISENGAGE, w.SEARCH_OFF, 0.9, False),
        (s.SOARING, f.DISENGAGE, w.SEARCH_OFF, 1.1, True),
        (s.CAPTURING, f.DISENGAGE, w.SEARCH_OFF, 3.0, False),
        (s.SOARING, f.DISENGAGE_EARLY, w.SEARCH_OFF, 3.0, False),
        (s.SEARCHING, f.DISENGAGE_EARLY, w.SEARCH_LOOKS, 3.0, True),
        (s.SEARCHING, f.DISENGAGE_EARLY, w.SEARCH_LOOKS, 0.9, False),
        (s.CAPTURING, f.SEARCH_FIRST, w.SEARCH_OFF, 3.0, True),
        (s.CAPTURING, f.SEARCH_FIRST, w.SEARCH_NONE, 3.0, False),  # as 2
        (s.SOARING, f.SEARCH_FIRST, w.SEARCH_LOOKS, 0.9, False),
    ],
)
def test_what_a_forecast_ends(
    mode: int, act: int, search: int, ahead_s: float, settles: bool
) -> None:
    params = LAWS.forecast._replace(act=act, chance=0.05)
    laws = LAWS._replace(forecast=params, search=search)
    found = c.forecast_conditions(laws, mode, doomed(ahead_s))
    assert found == (s.SETTLES if settles else 0)
    good = f.NO_FORECAST._replace(standing=f.SETTLES)
    assert c.forecast_conditions(laws, mode, good) == s.SETTLES


def test_what_holds_of_the_search() -> None:
    wanted = {
        w.SEARCH_OFF: 0,
        w.SEARCH_LOOKS: s.SEARCH,
        w.SEARCH_SOARS: s.SEARCH | s.PLACE_FOUND,
        w.SEARCH_GIVEN_UP: s.SEARCH,
        w.SEARCH_NONE: 0,
    }
    for search, found in wanted.items():
        laws = LAWS._replace(search=search)
        assert c.search_conditions(laws, False) == found
        assert c.search_conditions(laws, True) == found & ~s.PLACE_FOUND
    given_up = LAWS._replace(search=w.SEARCH_GIVEN_UP)
    good = f.NO_FORECAST._replace(standing=f.SETTLES)
    assert c.forecast_conditions(given_up, s.SEARCHING, good) == 0
    assert c.forecast_conditions(given_up, s.SOARING, good) == s.SETTLES


# --- a multisine ------------------------------------------------------------------------------

AMPLITUDE = radians(1.0)
EXCITED = LAWS._replace(excitation=LAWS.excitation._replace(amplitude_rad=AMPLITUDE))
CAPTURE_M = LAWS.guards.capture_distance_m
ON_LINE = LineTracking(x_m=0.0, z_m=0.0, eta_rad=1.8, moving=False, e_rho_m=0.0, e_rho_rate_mps=0.0)


def hindrance(begun: bool, **changes: Any) -> int:
    options: dict[str, Any] = {
        "mode": s.SOARING,
        "tracking": ON_LINE,
        "on_line": True,
        "vehicle": LEVEL,
        "margins": CLEAR,
        "faults": 0,
        "imu_weight": 1.0,
        "pitch_rad": 0.0,
        "slewing": 0,
        "blocked": 0,
    }
    options |= changes
    soaring = SoaringState(PidState(0.0, 0.0), options["pitch_rad"], options["slewing"])
    return c.excitation_hindrance(
        *(EXCITED, begun, options["mode"], options["tracking"], options["on_line"]),
        *(options["vehicle"], options["margins"], options["faults"], options["imu_weight"]),
        *(soaring, options["blocked"]),
    )


def off(e_rho_m: float, moving: bool = False) -> LineTracking:
    return ON_LINE._replace(e_rho_m=e_rho_m, moving=moving)


FULL = MARGIN_FULL
HIGH_M = 2.0 * LAWS.envelope.clearance_min_m
SINK = 0.5 * LAWS.envelope.sink_max_mps


@pytest.mark.parametrize(
    ("changes", "to_begin", "to_go_on"),
    [
        ({}, x.IDLE, x.IDLE),
        ({"mode": s.CAPTURING}, x.NOT_SOARING, x.NOT_SOARING),
        ({"tracking": off(0.0, moving=True)}, x.LINE_MOVES, x.LINE_MOVES),
        ({"on_line": False}, x.OFF_LINE, x.IDLE),
        ({"tracking": off(0.99 * CAPTURE_M)}, x.IDLE, x.IDLE),
        ({"tracking": off(-1.01 * CAPTURE_M)}, x.OFF_LINE, x.IDLE),
        ({"tracking": off(2.99 * CAPTURE_M)}, x.OFF_LINE, x.IDLE),
        ({"tracking": off(3.01 * CAPTURE_M)}, x.OFF_LINE, x.OFF_LINE),
        ({"vehicle": LEVEL._replace(roll_rad=-0.17)}, x.IDLE, x.IDLE),
        ({"vehicle": LEVEL._replace(roll_rad=0.18)}, x.BANKED, x.IDLE),
        ({"vehicle": LEVEL._replace(roll_rad=0.34)}, x.BANKED, x.IDLE),
        ({"vehicle": LEVEL._replace(roll_rad=-0.36)}, x.BANKED, x.BANKED),
        ({"faults": h.GAP}, x.FAULTY, x.FAULTY),
        ({"margins": CLEAR._replace(stall_rad=FULL + AMPLITUDE + 1e-4)}, x.IDLE, x.IDLE),
        ({"margins": CLEAR._replace(stall_rad=FULL + AMPLITUDE - 1e-4)}, x.NEAR_STALL, x.IDLE),
        ({"margins": CLEAR._replace(stall_rad=0.51 * FULL)}, x.NEAR_STALL, x.IDLE),
        ({"margins": CLEAR._replace(stall_rad=0.49 * FULL)}, x.NEAR_STALL, x.NEAR_STALL),
        ({"margins": CLEAR._replace(clearance_m=1.01 * HIGH_M)}, x.IDLE, x.IDLE),
        ({"margins": CLEAR._replace(clearance_m=0.99 * HIGH_M)}, x.TOO_LOW, x.TOO_LOW),
        ({"vehicle": LEVEL._replace(climb_mps=-0.99 * SINK)}, x.IDLE, x.IDLE),
        ({"vehicle": LEVEL._replace(climb_mps=-1.01 * SINK)}, x.TOO_LOW, x.TOO_LOW),
        ({"imu_weight": 0.5}, x.GAINS_CHANGE, x.GAINS_CHANGE),
        ({"imu_weight": 0.0}, x.IDLE, x.IDLE),
        ({"blocked": 1}, x.LIMITED, x.LIMITED),
        ({"slewing": -1}, x.LIMITED, x.LIMITED),
    ],
)
def test_what_hinders_a_multisine(changes: dict[str, Any], to_begin: int, to_go_on: int) -> None:
    assert hindrance(False, **changes) == to_begin
    assert hindrance(True, **changes) == to_go_on


def test_a_multisine_needs_room_above_and_below_the_setpoint() -> None:
    pitch = LAWS.soaring.pid
    for edge, sign in ((pitch.output_max, 1.0), (pitch.output_min, -1.0)):
        inside, beyond = edge - sign * 1.01 * AMPLITUDE, edge - sign * 0.99 * AMPLITUDE
        assert hindrance(False, pitch_rad=inside) == x.IDLE
        assert hindrance(False, pitch_rad=beyond) == x.LIMITED

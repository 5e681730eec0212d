"""What health reports, as the supervisor takes it: refused, released, or recovering for what."""

from __future__ import annotations

from math import inf, nan

import pytest
from test_supervisor import FLYING, RECOVER_S, WELL, Flown, walk

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.control import supervisor as s
from tgl_soar.control.conditions import stream_conditions
from tgl_soar.control.envelope import OUT_BELOW, Fence
from tgl_soar.control.envelope_margins import margins_of
from tgl_soar.control.laws import laws_from
from tgl_soar.estimation import health as h
from tgl_soar.estimation.ground_range import NO_GROUND_RANGE
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.world import make_world
from tgl_soar.types import (
    NO_AIR,
    NO_GROUND,
    AirspeedSample,
    AutopilotStatus,
    Ground,
    Health,
    Inputs,
    VehicleState,
)

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
LAWS = laws_from(VALUES, FRAME, AIRFRAME.aerodynamics())
NOW_S = 100.0
WORLD = make_world(AIRFRAME, SITE, seed=1)
INPUTS = Inputs(
    time_s=NOW_S,
    position=WORLD.position,
    attitude=WORLD.attitude,
    autopilot=AutopilotStatus(time_s=NOW_S, accepts_surfaces=True, armed=True),
    engage=True,
)
SOUND = Health(
    position_age_s=0.0,
    attitude_age_s=0.0,
    heartbeat_age_s=0.0,
    position_ok=True,
    attitude_ok=True,
    autopilot_ok=True,
    rejected=0,
    faults=0,
    position_interval_s=0.02,
    position_jitter_s=0.0,
    attitude_interval_s=0.005,
    attitude_jitter_s=0.0,
    gaps=0,
    surfaces_answer=1,
)


STILL = VehicleState(
    time_s=NOW_S,
    x_m=0.6,
    y_m=0.0,
    z_m=1.6,
    velocity_x_mps=0.0,
    velocity_y_mps=0.0,
    climb_mps=0.0,
    roll_rad=0.0,
    pitch_rad=0.0,
    heading_rad=0.0,
    roll_rate_radps=0.0,
    pitch_rate_radps=0.0,
    heading_rate_radps=0.0,
)


def streams(health: Health) -> int:
    return stream_conditions(LAWS.guards, INPUTS, health, NOW_S)


def missing(health: Health) -> int:
    """What does not hold of the streams with this health, and does of a sound one."""
    return streams(SOUND) & ~streams(health)


@pytest.mark.parametrize(
    ("health", "reason"),
    [
        (SOUND._replace(faults=h.WRONG), s.REASON_POSITION_INSANE),
        (SOUND._replace(faults=h.FROZEN), s.REASON_POSITION_INSANE),
        (SOUND._replace(faults=h.JUMP), s.REASON_POSITION_INSANE),
        (SOUND._replace(faults=h.DISAGREES), s.REASON_ATTITUDE_DISAGREES),
        (SOUND._replace(faults=h.AIRSPEED), s.REASON_AIRSPEED),
        (SOUND._replace(surfaces_answer=0), s.REASON_SURFACES_DEAD),
    ],
)
def test_engaging_is_refused_with_what_health_reports(health: Health, reason: int) -> None:
    flown = Flown().look(WELL & ~s.ENGAGE, 0.1)
    assert flown.state.mode == s.READY
    flown.look(WELL & ~missing(health), 0.1)
    assert flown.changes[-1][1:] == (s.RELEASED, reason)


@pytest.mark.parametrize("mode", FLYING)
@pytest.mark.parametrize(
    "health", [SOUND._replace(faults=h.DISAGREES), SOUND._replace(surfaces_answer=0)]
)
def test_in_control_it_is_released_for_them(health: Health, mode: int) -> None:
    lacking = missing(health)
    assert lacking
    everything = walk(mode)
    kept = (everything.to >= s.CAPTURING) & (everything.to <= s.RECOVERING)
    assert not any(kept & everything.lacks(lacking))


@pytest.mark.parametrize(
    ("alone", "recovers"),
    [(s.AIR_SAFE, True), (s.HIGH_ENOUGH, True), (s.CLEAR, False)],
)
def test_trouble_of_either_kind_is_recovered_from_and_then_released(
    alone: int, recovers: bool
) -> None:
    """Stalled, slow or sinking fast are no safe air; too low is not high enough."""
    flown = Flown().look(WELL & ~s.ENGAGE, 0.1).look(WELL | s.ON_LINE, 1.0)
    flown.changes.clear()
    flown.look(WELL & ~alone & ~s.CLEAR, RECOVER_S + 1.0)
    assert flown.modes() == ([s.RECOVERING, s.RELEASED] if recovers else [])


def test_an_implausible_airspeed_is_not_what_keeps_it_from_the_stall() -> None:
    """A reading of 5 m/s says that it stalls; the same one, found implausible, says nothing."""
    inputs = INPUTS._replace(airspeed=AirspeedSample(1, NOW_S, 5.0))
    unmoved = NO_AIR, (0.0, 0.0, 0.0), NO_GROUND_RANGE, True
    assert margins_of(LAWS, inputs, STILL, SOUND, *unmoved).stall_rad < 0.0
    faulty = SOUND._replace(faults=h.AIRSPEED)
    assert margins_of(LAWS, inputs, STILL, faulty, *unmoved).stall_rad == inf


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_where_the_source_says_it_is_counts_too(axis: int) -> None:
    """Whatever is taken off a position, a metre or a little: outside in either frame is outside."""
    upper, place = ("x_max_m", "y_max_m", "z_max_m"), (STILL.x_m, STILL.y_m, STILL.z_m)
    wide = Fence(x_min_m=-10.0, x_max_m=10.0, y_max_m=10.0, z_min_m=-10.0, z_max_m=10.0)
    for off_m in (1.0, 1e-3):
        fence = wide._replace(**{upper[axis]: place[axis] + 0.5 * off_m})
        laws = LAWS._replace(fence=fence)
        dx, dy, dz = (off_m if n == axis else 0.0 for n in range(3))
        for shift, is_outside in (((0.0, 0.0, 0.0), False), ((dx, dy, dz), True)):
            found = margins_of(laws, INPUTS, STILL, SOUND, NO_AIR, shift, NO_GROUND_RANGE, True)
            assert bool(found.outside) == is_outside


@pytest.mark.parametrize(
    ("bound_m", "clearance_m"), [(-2.0, 3.0), (0.0, 5.0), (2.0, 5.0), (nan, 5.0)]
)
@pytest.mark.parametrize("known", [True, False])
def test_a_nearer_ground_counts_as_clearance_and_a_farther_one_does_not(
    bound_m: float, clearance_m: float, known: bool
) -> None:
    """5 m over a level ground; where that is not known it is as far as the rangefinder measures."""
    level = Ground(2, (-50.0, 50.0, *(50.0,) * 6), (0.0,) * 8)
    laws = LAWS._replace(ground=level if known else NO_GROUND)
    ranged = NO_GROUND_RANGE._replace(bound_m=bound_m)
    at = STILL._replace(x_m=0.0, z_m=5.0)
    found = margins_of(laws, INPUTS, at, SOUND, NO_AIR, (0.0, 0.0, 0.0), ranged, True)
    if known:
        assert found.clearance_m == clearance_m
    else:
        assert found.clearance_m == (inf if bound_m != bound_m else 5.0 + bound_m)


def test_a_corrected_height_is_what_clearance_and_fence_go_by() -> None:
    level = Ground(2, (-50.0, 50.0, *(50.0,) * 6), (0.0,) * 8)
    fence = Fence(x_min_m=-50.0, x_max_m=50.0, y_max_m=50.0, z_min_m=4.0, z_max_m=40.0)
    laws = LAWS._replace(ground=level, fence=fence)
    at = STILL._replace(x_m=0.0, z_m=5.0)
    lower = NO_GROUND_RANGE._replace(bound_m=-1.5, correction_m=-1.5)
    found = margins_of(laws, INPUTS, at, SOUND, NO_AIR, (0.0, 0.0, 0.0), lower, True)
    assert found.clearance_m == 3.5
    assert found.outside == OUT_BELOW

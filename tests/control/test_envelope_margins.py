"""How far it is to stall, ground and fence, as far as that is known, and what the pitch keeps."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, nan, radians, sin, sqrt
from typing import Any

import pytest
from samples import STILL
from test_power import HEALTHY

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.envelope import (
    CUT_NOSE_DOWN,
    CUT_NOSE_UP,
    OUT_ABOVE,
    OUT_DOWNSTREAM,
    OUT_SIDE,
    OUT_UPSTREAM,
    Margins,
)
from tgl_soar.control.envelope_margins import margins_of, pitch_kept, stall_uncertainty
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.estimation.ground_range import GroundRange
from tgl_soar.estimation.health import AIRSPEED, GAP
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    GROUND_POINTS,
    NO_AIR,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_GROUND,
    AirEstimate,
    AirspeedSample,
    AutopilotStatus,
    Ground,
    Health,
    Inputs,
    VehicleState,
)

ALPHA_MAX, SPEED_MIN_MPS, GLIDE_DEG, CLEAR_M, SINK_MAX_MPS = 12.0, 6.0, -4.0, 1.0, 5.0
VALUES = ParameterSet().changed(
    {
        "ALPHA_MAX": ALPHA_MAX, "SPEED_MIN": SPEED_MIN_MPS, "REC_PITCH": GLIDE_DEG,
        "CLEAR_MIN": CLEAR_M, "SINK_MAX": SINK_MAX_MPS, "FENCE_X_MIN": -10.0, "FENCE_X_MAX": 10.0,
        "FENCE_Y_MAX": 8.0, "FENCE_Z_MIN": 0.5, "FENCE_Z_MAX": 20.0,
    }
)  # fmt: skip
SLOPE = 0.75  # 3 to 4: a metre over it is 0.8 m off
GROUND = Ground(
    2, (-40.0, 40.0, *[40.0] * (GROUND_POINTS - 2)), (-30.0, 30.0, *[30.0] * (GROUND_POINTS - 2))
)
FRAME = SoaringFrame(0.0, 0.0, 0.0, 0.0)
LAWS = laws_from(VALUES, FRAME, ground=GROUND)
FLAT_LAWS = laws_from(VALUES, FRAME)  # of no known ground
PLACE = STILL._replace(x_m=2.0, y_m=1.0, z_m=6.0, pitch_rad=0.05)
STATUS = AutopilotStatus(time_s=0.0, accepts_surfaces=True, armed=True)
STILL_THERE = (0.0, 0.0, 0.0)  # the source's frame
NO_RANGE = GroundRange(standing=0, bound_m=nan, correction_m=0.0, refused=False)
# 9 m/s at an incidence of 0.1, as estimated with accelerometers.
AIR = NO_AIR._replace(
    airspeed_mps=9.0, alpha_rad=0.1, wind_sigma_mps=0.2, updraft_sigma_mps=0.15, measured=False
)


def margins(
    vehicle: VehicleState = PLACE,
    *,
    laws: Laws = LAWS,
    health: Health = HEALTHY,
    air: AirEstimate = AIR,
    pitot_mps: float = nan,
    shift: tuple[float, float, float] = STILL_THERE,
    ground_range: GroundRange = NO_RANGE,
    flying: bool = True,
) -> Margins:
    tube = AirspeedSample(1, 0.0, pitot_mps) if pitot_mps == pitot_mps else NO_AIRSPEED
    inputs = Inputs(
        time_s=0.0,
        position=NO_FIX,
        attitude=NO_ATTITUDE,
        autopilot=STATUS,
        engage=True,
        airspeed=tube,
    )
    return margins_of(laws, inputs, vehicle, health, air, shift, ground_range, flying)


# --- the stall ----------------------------------------------------------------------------------

BY_ALPHA = radians(ALPHA_MAX) - 0.1


def test_an_air_that_is_certain_in_flight_says_how_far_the_stall_is() -> None:
    """By the incidence or by the airspeed, 0.05 rad for each metre per second."""
    assert margins().stall_rad == pytest.approx(BY_ALPHA)
    slow = AIR._replace(airspeed_mps=7.0)
    assert margins(air=slow).stall_rad == pytest.approx(0.05)


def test_what_is_worked_out_in_a_hand_says_nothing() -> None:
    assert margins(flying=False).stall_rad == inf
    # A pitot tube's air is measured wherever it is.
    assert margins(flying=False, air=AIR._replace(measured=True)).stall_rad == pytest.approx(
        BY_ALPHA
    )


@pytest.mark.parametrize(("sigma_deg", "counts"), [(1.9, True), (2.1, False)])
def test_an_air_that_is_uncertain_by_more_than_two_degrees_does_not_count(
    sigma_deg: float, counts: bool
) -> None:
    level = PLACE._replace(pitch_rad=AIR.alpha_rad)  # its path through the air is level
    sigma_mps = 9.0 * radians(sigma_deg)
    air = AIR._replace(updraft_sigma_mps=sigma_mps, wind_sigma_mps=0.1)
    assert (margins(level, air=air).stall_rad < inf) == counts
    # Measured it counts however uncertain the wind is.
    assert margins(level, air=air._replace(measured=True)).stall_rad < inf


def test_an_air_of_which_nothing_is_known_leaves_the_tube_s_own_airspeed() -> None:
    unknown = NO_AIR
    assert margins(air=unknown).stall_rad == inf
    assert margins(air=unknown, pitot_mps=6.4).stall_rad == pytest.approx(0.02)
    assert margins(air=unknown, pitot_mps=6.4, flying=False).stall_rad == pytest.approx(0.02)


@pytest.mark.parametrize(("faults", "accepted"), [(AIRSPEED, False), (GAP, True)])
def test_a_tube_that_lies_says_nothing(faults: int, accepted: bool) -> None:
    health = HEALTHY._replace(faults=faults)
    assert (margins(health=health, air=NO_AIR, pitot_mps=6.4).stall_rad < inf) == accepted


# --- how certain that is ------------------------------------------------------------------------


@pytest.mark.parametrize("pitch_rad", [-0.3, 0.05, 0.4])
@pytest.mark.parametrize(
    ("wind_sigma", "updraft_sigma"), [(0.3, 0.0), (0.0, 0.3), (0.25, 0.4), (2.0, 0.1)]
)
def test_the_margin_is_as_uncertain_as_wind_and_updraft_make_it(
    pitch_rad: float, wind_sigma: float, updraft_sigma: float
) -> None:
    """By differences: what a little more wind or updraft does to path and airspeed."""
    speed, alpha, small = 9.0, 0.1, 1e-6
    gamma = pitch_rad - alpha
    forward, up = speed * cos(gamma), speed * sin(gamma)

    def turned(more_wind: float, more_updraft: float) -> tuple[float, float]:
        """Of the path, and of the airspeed."""
        u, w = forward + more_wind, up - more_updraft
        return (atan2(w, u) - gamma) / small, (hypot(u, w) - speed) / small

    by_wind, by_updraft = turned(small, 0.0), turned(0.0, small)
    of_path, of_speed = (
        hypot(by_wind[i] * wind_sigma, by_updraft[i] * updraft_sigma) for i in (0, 1)
    )
    air = AIR._replace(wind_sigma_mps=wind_sigma, updraft_sigma_mps=updraft_sigma)
    expected = max(of_path, 0.05 * of_speed)  # rad for each m/s: `envelope.PITCH_PER_SPEED`
    assert stall_uncertainty(air, pitch_rad) == pytest.approx(expected, rel=1e-4)


# --- the ground ---------------------------------------------------------------------------------


def over(x_m: float, z_m: float) -> float:
    return (z_m - SLOPE * x_m) / sqrt(1.0 + SLOPE**2)


def test_the_ground_is_as_near_as_a_line_square_to_it_is_long() -> None:
    assert margins().clearance_m == pytest.approx(over(2.0, 6.0))
    assert margins(laws=FLAT_LAWS).clearance_m == inf


@pytest.mark.parametrize(
    ("shift", "other"),
    [
        ((0.0, 0.0, 1.0), False),
        ((0.0, 0.0, -1.0), True),
        ((1.0, 0.0, 0.0), True),
        ((-1.0, 0.0, 0.0), False),
        ((0.0, 5.0, 0.0), False),
    ],
)
def test_of_two_frames_the_one_in_which_the_ground_is_nearer_counts(
    shift: tuple[float, float, float], other: bool
) -> None:
    """It is unknown in which of them it is right."""
    there = over(2.0 + shift[0], 6.0 + shift[2])
    here = over(2.0, 6.0)
    assert margins(shift=shift).clearance_m == pytest.approx(there if other else here)


def test_a_rangefinder_s_correction_is_added_to_the_height() -> None:
    lower = NO_RANGE._replace(correction_m=-0.5)
    assert margins(ground_range=lower).clearance_m == pytest.approx(over(2.0, 5.5))
    shifted = margins(ground_range=lower, shift=(0.5, 0.0, -0.5))
    assert shifted.clearance_m == pytest.approx(over(2.5, 5.0))
    out = margins(PLACE._replace(z_m=20.2), ground_range=lower)
    assert out.outside == 0


@pytest.mark.parametrize(("bound_m", "z_m"), [(-1.5, 4.5), (1.5, 6.0)])
def test_where_a_rangefinder_sees_the_ground_nearer_that_counts(bound_m: float, z_m: float) -> None:
    bounded = NO_RANGE._replace(bound_m=bound_m)
    assert margins(ground_range=bounded).clearance_m == pytest.approx(over(2.0, z_m))
    # Of the position's own height, to which the correction is not added.
    corrected = bounded._replace(correction_m=0.25)
    expected = min(over(2.0, 6.25), over(2.0, 6.0 + bound_m))
    assert margins(ground_range=corrected).clearance_m == pytest.approx(expected)


def test_ground_of_which_the_site_knows_nothing_is_as_near_as_it_is_seen() -> None:
    ranged = NO_RANGE._replace(bound_m=-2.5)  # 3.5 m of the height above the frame's origin
    assert FLAT_LAWS.ground == NO_GROUND
    assert margins(laws=FLAT_LAWS, ground_range=ranged).clearance_m == pytest.approx(3.5)


def test_level_ground_of_a_known_height_is_seen_from_there() -> None:
    """A profile of one point: the rangefinder's distance is over it."""
    level = Ground(1, (0.0,) * GROUND_POINTS, (2.0,) * GROUND_POINTS)
    ranged = NO_RANGE._replace(bound_m=-2.5)
    laws = LAWS._replace(ground=level)
    assert margins(laws=laws, ground_range=ranged).clearance_m == pytest.approx(6.0 - 2.5 - 2.0)


# --- the fence ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("at", "shift", "bits"),
    [
        ({}, STILL_THERE, 0),
        ({"x_m": 10.1}, STILL_THERE, OUT_DOWNSTREAM),
        ({"x_m": 10.1}, (-1.0, 0.0, 0.0), OUT_DOWNSTREAM),
        ({"x_m": 9.5}, (1.0, 0.0, 0.0), OUT_DOWNSTREAM),
        ({"x_m": -9.5}, (-1.0, 0.0, 0.0), OUT_UPSTREAM),
        ({"y_m": 7.5}, (0.0, 1.0, 0.0), OUT_SIDE),
        ({"y_m": -7.5}, (0.0, -1.0, 0.0), OUT_SIDE),
        ({"z_m": 19.5}, (0.0, 0.0, 1.0), OUT_ABOVE),
        ({"x_m": 10.1, "z_m": 19.5}, (-1.0, 0.0, 1.0), OUT_DOWNSTREAM | OUT_ABOVE),
    ],
)
def test_what_is_outside_in_either_frame_is_outside(
    at: dict[str, Any], shift: tuple[float, float, float], bits: int
) -> None:
    assert margins(PLACE._replace(**at), shift=shift).outside == bits


@pytest.mark.parametrize("axis", ["x_m", "y_m", "z_m"])
def test_a_lost_place_that_nobody_can_estimate_is_not_outside(axis: str) -> None:
    """Its age ends the flight, with a reason of its own; one that is estimated yet still counts."""
    lost = HEALTHY._replace(position_ok=False)
    unknown = PLACE._replace(**{axis: nan})
    assert margins(unknown, health=lost).outside == 0
    assert margins(unknown).outside != 0
    beyond = PLACE._replace(x_m=11.0)
    assert margins(beyond, health=lost).outside == OUT_DOWNSTREAM


# --- the pitch ----------------------------------------------------------------------------------

FAR = Margins(stall_rad=1.0, clearance_m=10.0, outside=0)
GLIDE_RAD = radians(GLIDE_DEG)


def kept(
    wanted_rad: float,
    margins: Margins = FAR,
    climb_mps: float = 0.0,
    held_rad: float = 0.0,
    behind_m: float = 0.0,
) -> tuple[float, int]:
    vehicle = PLACE._replace(climb_mps=climb_mps)
    return pitch_kept(LAWS, margins, vehicle, wanted_rad, held_rad, behind_m)


def test_a_pitch_that_is_within_the_envelope_is_flown_as_it_is() -> None:
    assert kept(0.1) == (0.1, 0)
    assert kept(-0.3) == (-0.3, 0)


def test_near_the_stall_the_nose_comes_up_by_the_margin_alone() -> None:
    """From the pitch that there is, and no further down than the best glide's."""
    near = FAR._replace(stall_rad=0.02)
    assert kept(0.1, near) == pytest.approx((PLACE.pitch_rad + 0.02, CUT_NOSE_UP))
    beyond = FAR._replace(stall_rad=-0.5)
    assert kept(0.1, beyond) == pytest.approx((GLIDE_RAD, CUT_NOSE_UP))
    assert kept(-0.2, near) == (-0.2, 0)


LOW = FAR._replace(clearance_m=1.2 * CLEAR_M)


@pytest.mark.parametrize(("margins", "climb_mps"), [(LOW, -0.5), (FAR, -SINK_MAX_MPS - 0.1)])
def test_low_or_sinking_fast_the_nose_goes_down_to_the_glide_alone(
    margins: Margins, climb_mps: float
) -> None:
    floor = pytest.approx((GLIDE_RAD, CUT_NOSE_DOWN))
    assert kept(-0.3, margins, climb_mps, held_rad=0.0) == floor
    # Or to what holds the line, where that is lower; by 2 rad more for each metre behind it.
    assert kept(-0.3, margins, climb_mps, held_rad=-0.1) == (-0.1, CUT_NOSE_DOWN)
    behind = kept(-0.3, margins, climb_mps, held_rad=-0.1, behind_m=0.05)
    assert behind == pytest.approx((-0.2, CUT_NOSE_DOWN))
    assert kept(-0.02, margins, climb_mps) == (-0.02, 0)
